/** A source: it gives the page observations to complete, or completed bodies. */

export interface Source {
  readonly title: string; // for the person
  readonly guide?: string | undefined; // what the person does now, in one line
  readonly isYou?: boolean; // tracks the person at this page, who may be measured
  readonly sensors: readonly string[]; // points that it tracks, as far as they are known
  /** Once a picture, at `milliseconds` of the page's clock. */
  frame?(milliseconds: number, frame?: XRFrame): void;
  stop?(): void;
}
