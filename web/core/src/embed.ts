/** Messages between the page in an `<iframe src="…?embed">` and the page around it. */

/** Sent to the frame: `frame.contentWindow.postMessage(command, origin)`. */
export type EmbedCommand =
  | { readonly bodysense: "hello" } // asks for `ready` again
  | { readonly bodysense: "play"; readonly repeat?: boolean } // true if omitted; false: stop at the end
  | { readonly bodysense: "pause" }
  | { readonly bodysense: "seek"; readonly time: number } // s from the beginning of the motion
  | { readonly bodysense: "load"; readonly motion?: string | File; readonly avatar?: string | File }
  | { readonly bodysense: "background"; readonly transparent: boolean };

/** Heard from the frame. */
export type EmbedEvent =
  | { readonly bodysense: "ready" } // commands are heard from now on
  | {
      readonly bodysense: "loaded";
      readonly kind: "motion" | "recording";
      readonly name: string;
      readonly seconds: number;
    }
  | { readonly bodysense: "loaded"; readonly kind: "avatar"; readonly name: string }
  | { readonly bodysense: "time"; readonly time: number; readonly playing: boolean } // s: a frame was drawn
  | { readonly bodysense: "ended" } // the last frame was drawn
  | { readonly bodysense: "error"; readonly reason: string }; // one line
