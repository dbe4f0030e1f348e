/** A source: it gives the page observations to complete, or completed bodies. */

export interface Source {
  readonly title: string; // for the person
  readonly guide?: string | undefined; // instruction for the user, one line
  readonly isYou?: boolean; // tracks the user of this page, so measuring is possible
  readonly isWebcam?: boolean; // the wearer sees their own picture, which is mirrored by a setting of its own
  readonly isAbsent?: boolean; // no person is tracked now, so no body is drawn
  readonly sensors: readonly string[]; // points that it tracks, if known
  readonly trackers?: readonly string[]; // points that are tracked now, if they are not `sensors`
  /** Once a picture, at `milliseconds` of the page's clock. */
  frame?(milliseconds: number, frame?: XRFrame): void;
  stop?(): void;
}
