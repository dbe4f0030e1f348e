/** Trackers strapped to the body: where each is worn, and what it is called. */

/** Joints that carry trackers, and their names for the user. */
export const PLACES: Readonly<Record<string, string>> = {
  pelvis: "Hips",
  spine3: "Chest",
  left_ankle: "Left ankle",
  right_ankle: "Right ankle",
  left_knee: "Left knee",
  right_knee: "Right knee",
  left_elbow: "Left elbow",
  right_elbow: "Right elbow",
};
const MIDDLE: Readonly<Record<string, string>> = { hip: "pelvis", waist: "pelvis", chest: "spine3" };

/** Joints of trackers by their names in the signal, where they are not the usual ones; "": the tracker is ignored. */
export type Worn = Readonly<Record<string, string>>;

/** The joint of a tracker by its name; "" if its name says none; null if the point is not a strapped tracker. */
export function usualPlace(tracker: string): string | null {
  const joint = MIDDLE[tracker] ?? tracker.replace(/_tracker$/, "");
  if (joint in PLACES) return joint;
  return /^tracker_\d$/.test(tracker) ? "" : null;
}

export function placeOf(tracker: string, worn: Worn): string {
  return worn[tracker] ?? usualPlace(tracker) ?? "";
}

/** Return where `trackers` are worn after one has moved to a joint; a tracker that was there takes its place. */
export function moved(trackers: readonly string[], worn: Worn, tracker: string, joint: string): Worn {
  const other = trackers.find((name) => name !== tracker && joint !== "" && placeOf(name, worn) === joint);
  const swapped = other === undefined ? {} : { [other]: placeOf(tracker, worn) };
  const all = Object.entries({ ...worn, ...swapped, [tracker]: joint });
  return Object.fromEntries(all.filter(([name, place]) => place !== usualPlace(name)));
}

/** The name of a tracker if the user gave none. */
export function nameOf(tracker: string): string {
  return PLACES[tracker] ?? tracker.replaceAll("_", " ").replace(/^./, (first) => first.toUpperCase());
}
