"""Feet of a joined body: standing feet are held on the floor, and others are unchanged."""

from __future__ import annotations

import numpy as np
import pytest
from body_poses import no_points, places_of

from bodysense.body.footing import side_clearance
from bodysense.body.pose import Pose
from bodysense.geometry.rotation import quaternion_exp
from bodysense.takes.feet import plant_feet, sustained
from bodysense.tracking.estimate import CONTACT_POINTS

SECONDS = 1 / 30


def hovering(pose: Pose, sides: tuple[str, ...]) -> Pose:
    """A body that stands still, with some legs bent so that their feet are flat and higher up."""
    rotation = np.array(pose.rotation)
    for joint, angle in (("hip", -0.4), ("knee", 0.8), ("ankle", -0.4)):
        where = pose.skeleton.indices([f"{side}_{joint}" for side in sides])
        rotation[:, where] = quaternion_exp(np.array([angle, 0.0, 0.0]))
    return Pose(pose.skeleton, np.broadcast_to(pose.root_position[0], pose.root_position.shape), rotation)


def heights(pose: Pose, chance: float, floor: float) -> tuple[np.ndarray, np.ndarray]:
    """Return heights (T,) of the soles above the floor, before and after feet with these contacts are held."""
    shins = np.zeros((len(pose.rotation), len(pose.skeleton.joints)), dtype=bool)
    contact = np.full((len(pose.rotation), len(CONTACT_POINTS)), chance)
    held = plant_feet(pose, contact, no_points(pose), shins, floor, SECONDS)
    before, after = (side_clearance(places_of(one)[0], pose.skeleton, "left") - floor for one in (pose, held))
    return before, after


def test_a_standing_foot_is_on_the_floor(pose: Pose) -> None:
    """A foot in contact is lowered; another foot is unchanged while the first is on the floor."""
    bent = hovering(pose, ("left",))
    floor = float(side_clearance(places_of(bent)[0], pose.skeleton, "right")[0])
    for chance in (0.0, 1.0):
        before, after = heights(bent, chance, floor)
        assert before.min() > 0.03
        if chance:
            assert after.max() < 0.025 and after.min() > -1e-3
        else:
            np.testing.assert_allclose(after, before, atol=1e-9)


@pytest.mark.parametrize("does", ["stands", "jumps", "sits"])
def test_a_standing_body_does_not_hover(pose: Pose, does: str) -> None:
    """Both feet are lowered without contact, unless the body jumps or sits."""
    floor, bent = float(side_clearance(places_of(pose)[0], pose.skeleton, "left")[0]), hovering(pose, ("left", "right"))
    if does == "jumps":
        time = np.arange(len(bent.root_position))[:, None] * SECONDS
        bent = Pose(bent.skeleton, bent.root_position + time * [0.0, 1.5, 0.0], bent.rotation)
    elif does == "sits":
        rotation = np.array(bent.rotation)
        for joint, angle in (("hip", -2.0), ("knee", 2.4)):
            where = bent.skeleton.indices([f"{side}_{joint}" for side in ("left", "right")])
            rotation[:, where] = quaternion_exp(np.array([angle, 0.0, 0.0]))
        bent = Pose(bent.skeleton, bent.root_position, rotation)
        floor = float(side_clearance(places_of(bent)[0], bent.skeleton, "left").min()) - 0.05
    before, after = heights(bent, 0.0, floor)
    assert before.min() > 0.03
    if does == "stands":
        assert after.max() < 0.025 and after.min() > -1e-3
    else:
        np.testing.assert_allclose(after, before, atol=1e-9)


@pytest.mark.parametrize("still", [True, False])
def test_still_feet_are_lowered_to_the_floor(pose: Pose, still: bool) -> None:
    """Feet at a height of 9 mm are lowered only if both stand for some time."""
    bent = hovering(pose, ("left", "right"))
    floor = float(side_clearance(places_of(bent)[0], pose.skeleton, "left")[0]) - 0.009
    contact = np.ones((len(bent.rotation), len(CONTACT_POINTS)))
    if not still:
        contact[:, [place for place, name in enumerate(CONTACT_POINTS) if name.startswith("right")]] = 0.0
    shins = np.zeros((len(bent.rotation), len(pose.skeleton.joints)), dtype=bool)
    held = plant_feet(bent, contact, no_points(bent), shins, floor, SECONDS)
    height = side_clearance(places_of(held)[0], pose.skeleton, "left") - floor
    assert height.max() < 0.006 if still else height.min() > 0.0085


def test_a_tracked_foot_under_the_floor_comes_up_gradually(pose: Pose) -> None:
    """Tracked feet stay 2 cm under the floor; next to these frames feet rise within a quarter second."""
    floor = float(side_clearance(places_of(pose)[0], pose.skeleton, "left").max()) + 0.02
    measured = no_points(pose)
    measured[30:60, pose.skeleton.index("left_ankle")] = True
    shins = np.zeros((len(pose.rotation), len(pose.skeleton.joints)), dtype=bool)
    contact = np.zeros((len(pose.rotation), len(CONTACT_POINTS)))
    held = plant_feet(pose, contact, measured, shins, floor, SECONDS)
    height = side_clearance(places_of(held)[0], pose.skeleton, "left") - floor
    before = side_clearance(places_of(pose)[0], pose.skeleton, "left") - floor
    np.testing.assert_allclose(height[30:60], before[30:60], atol=1e-3)
    assert height[:20].min() > -2e-3 and height[70:].min() > -2e-3
    assert np.abs(np.diff(height)).max() < 0.3 * np.abs(before).max()


def test_sustained_shares() -> None:
    """A third of a second counts, a tenth does not, and the change is gradual."""
    share = np.zeros(90)
    share[10:13] = 1.0
    share[40:60] = 1.0
    found = sustained(share, SECONDS)
    assert found[:30].max() < 0.01 and found[46:54].min() > 0.9
    assert np.abs(np.diff(found)).max() < 0.15


def test_standing_feet_are_held_unless_their_shins_are_tracked(pose: Pose) -> None:
    skeleton, frames = pose.skeleton, len(pose.root_position)
    sliding = Pose(skeleton, pose.root_position + np.linspace(0, 0.1, frames)[:, None] * [1.0, 0.0, 0.0], pose.rotation)
    contact, shins = np.ones((frames, len(CONTACT_POINTS))), np.zeros((frames, len(skeleton.joints)), dtype=bool)
    shins[:, skeleton.index("left_knee")] = True
    low = places_of(pose)[0][..., 1].min()
    held = plant_feet(sliding, contact, no_points(pose), shins, low, SECONDS)
    left, right = (
        [skeleton.index(f"{side}_{part}") for part in ("hip", "knee", "ankle")] for side in ("left", "right")
    )
    np.testing.assert_array_equal(held.rotation[:, left], sliding.rotation[:, left])
    assert (held.rotation[:, right] != sliding.rotation[:, right]).any()
    ball = skeleton.index("right_foot")
    way, before = (np.ptp(places_of(one)[0][:, ball, 0]) for one in (held, sliding))
    assert way < 0.6 * before
