/** Avatars by name: one is worn, the oldest gives way. */

import { Group } from "three";
import { expect, it } from "vitest";
import type { Avatar } from "../../src/view/avatar";
import { OWN, Wardrobe } from "../../src/view/wardrobe";

function avatar(): Avatar {
  const group = new Group();
  return { group, dispose: () => group.removeFromParent() } as unknown as Avatar;
}

it("shows the one that is worn, and keeps the others", () => {
  const stage = new Group();
  const wardrobe = new Wardrobe(stage);
  expect(wardrobe.current).toBeNull();
  const [own, other] = [avatar(), avatar()];
  wardrobe.add(OWN, own);
  wardrobe.add("other.vrm", other);
  expect([own.group.visible, other.group.visible]).toEqual([false, true]);
  wardrobe.wear(OWN);
  expect(wardrobe.current).toBe(own);
  expect([own.group.visible, other.group.visible]).toEqual([true, false]);
  wardrobe.wear("nobody.vrm");
  expect(wardrobe.currentName).toBe(OWN);
});

it("replaces one of the same name, and lets the oldest go that is not the page's own", () => {
  const stage = new Group();
  const wardrobe = new Wardrobe(stage);
  for (const name of [OWN, "a", "a", "b", "c", "d", "e"]) wardrobe.add(name, avatar());
  expect(wardrobe.names).toEqual([OWN, "c", "d", "e"]);
  expect(stage.children).toHaveLength(4);
  expect(wardrobe.currentName).toBe("e");
});
