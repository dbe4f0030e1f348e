/** Loaded avatars by name, one of which is displayed. */

import type { Object3D } from "three";
import { unpacked } from "../engine/files";
import type { Avatar } from "./avatar";

export const OWN = "The page's own"; // is never removed
const OWN_FILE = "avatar.vrm.gz";
const MOST = 4; // avatars at a time, because each holds its textures

export class Wardrobe {
  private readonly avatars = new Map<string, Avatar>(); // in the order of addition
  currentName: string | null = null; // null: no avatar yet

  constructor(private readonly stage: Object3D) {}

  get names(): readonly string[] {
    return [...this.avatars.keys()];
  }

  get current(): Avatar | null {
    return this.avatars.get(this.currentName ?? "") ?? null;
  }

  /** Add and display an avatar. It replaces one of the same name, or the oldest if there are too many. */
  add(name: string, avatar: Avatar): void {
    this.remove(name);
    const oldest = this.names.find((other) => other !== OWN);
    if (this.avatars.size >= MOST && oldest !== undefined) this.remove(oldest);
    this.avatars.set(name, avatar);
    this.stage.add(avatar.group);
    this.wear(name);
  }

  /** Display a loaded avatar. */
  wear(name: string): void {
    if (!this.avatars.has(name)) return;
    this.currentName = name;
    for (const [other, { group }] of this.avatars) group.visible = other === name;
  }

  private remove(name: string): void {
    this.avatars.get(name)?.dispose();
    this.avatars.delete(name);
  }
}

/** Add the page's own avatar; display it unless another one was loaded before. */
export async function addOwn(wardrobe: Wardrobe, base: string): Promise<void> {
  const { Avatar, readGlb } = await import("./avatar"); // three-vrm is fetched when it is wanted
  const avatar = Avatar.of(await readGlb(await unpacked(base, OWN_FILE), OWN_FILE), OWN_FILE);
  const chosen = wardrobe.currentName;
  if (avatar) wardrobe.add(OWN, avatar);
  if (chosen !== null) wardrobe.wear(chosen);
}
