/** The window of the page that embeds this one: commands come from it, events go to it, by its origin alone. */

import type { EmbedCommand, EmbedEvent } from "@bodysense/core/embed";

const ANY = "*";
const COMMANDS = ["hello", "play", "pause", "seek", "load", "background"];

/** Return the origin of the page that embeds this one: the one that `?embed=` names, or else the referrer's.
 *
 * Throws an Error of one line if it is not known.
 */
export function originOf(named: string, referrer: string): string {
  if (named === ANY) return ANY;
  const address = named || referrer;
  if (URL.canParse(address) && new URL(address).origin !== "null") return new URL(address).origin;
  throw new Error(
    named
      ? `embed=${named}: give an origin such as https://example.org, or * for any.`
      : "It is not known which page embeds this one: name its origin, as in ?embed=https://example.org, or * for any.",
  );
}

/** Check a command; null for an unrelated message. Throws an Error of one line that lists valid commands. */
export function commandFrom(data: unknown): EmbedCommand | null {
  if (typeof data !== "object" || data === null || !("bodysense" in data)) return null;
  const given = data as Readonly<Record<string, unknown>>;
  const kind = given["bodysense"];
  const check = (isValid: boolean, name: string, wanted: string): void => {
    if (!isValid) throw new Error(`${String(kind)}: ${name} is ${String(given[name])}; give ${wanted}.`);
  };
  const isFile = (value: unknown): boolean => typeof value === "string" || value instanceof File;
  if (kind === "play") check(["boolean", "undefined"].includes(typeof given["repeat"]), "repeat", "true or false");
  else if (kind === "seek") check(Number.isFinite(given["time"]), "time", "seconds from the motion's beginning");
  else if (kind === "background") check(typeof given["transparent"] === "boolean", "transparent", "true or false");
  else if (kind === "load") {
    const names = ["motion", "avatar"].filter((name) => given[name] !== undefined);
    check(names.length > 0, "motion", "an address or a File as motion, avatar or both");
    for (const name of names) check(isFile(given[name]), name, "an address or a File");
  } else if (!COMMANDS.includes(String(kind)))
    throw new Error(`${String(kind)}: no such command; send one of ${COMMANDS.join(", ")}.`);
  return given as unknown as EmbedCommand;
}

export class Embedder {
  constructor(private readonly origin: string) {}

  /** Call back with commands of the embedding page, and with errors of invalid ones. */
  listen(heard: (command: EmbedCommand) => void, refused: (error: unknown) => void): void {
    addEventListener("message", ({ source, origin, data }: MessageEvent<unknown>) => {
      if (source !== parent || (this.origin !== ANY && origin !== this.origin)) return;
      try {
        const command = commandFrom(data);
        if (command) heard(command);
      } catch (error) {
        refused(error);
      }
    });
  }

  send(event: EmbedEvent): void {
    parent.postMessage(event, this.origin);
  }
}
