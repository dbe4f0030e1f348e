"""The packaged performance: plausible motion of a wearer."""

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import default_body, default_skeleton
from bodysense.geometry.rotation import geodesic_angle, quaternion_rotate
from bodysense.io.fingers import is_finger
from bodysense.io.formats.amass import read_amass

FILE = Path(str(files("bodysense.demo").joinpath("performance.npz")))
SKELETON = default_skeleton()
CLIP = read_amass(FILE, SKELETON)
POSITION, ROTATION = (np.asarray(part) for part in forward_kinematics(CLIP.pose))


def during(start: float, end: float) -> slice:
    """Return the frames from one time to another, s."""
    return slice(round(start * CLIP.frame_rate), round(end * CLIP.frame_rate))


def at(name: str, offset: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    """Return the world position (T, 3) of a point, or of an offset (m) in a joint's frame."""
    index = SKELETON.index(name)
    if not any(offset):
        return POSITION[:, index]
    return POSITION[:, index] + quaternion_rotate(ROTATION[:, index], np.array(offset, dtype=float))


def distance_to_segment(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(T,) m."""
    along = ((point - start) * (end - start)).sum(-1) / ((end - start) ** 2).sum(-1)
    return np.linalg.norm(point - start - np.clip(along, 0, 1)[:, None] * (end - start), axis=-1)


def test_file_is_small_and_names_its_source():
    assert FILE.stat().st_size < 400_000
    with np.load(FILE, allow_pickle=False) as file:
        assert file["poses"].shape == (len(CLIP), 156)
        assert file["trans"].shape == (len(CLIP), 3)
        assert str(file["gender"]) == "neutral"
        assert not file["betas"].any()
        assert "Apache-2.0" in str(file["licence"])
        assert "own work" in str(file["source"])
        assert np.array_equal(file["poses"] * 2**12, np.round(file["poses"] * 2**12))


def test_is_twenty_to_thirty_seconds_with_fingers():
    assert CLIP.frame_rate == 30
    assert 20 <= CLIP.seconds <= 30
    assert CLIP.has_fingers
    assert np.isfinite(POSITION).all()


def test_starts_upright_at_the_origin_and_faces_forward():
    forward = quaternion_rotate(ROTATION[0, 0], np.array([0.0, 0.0, 1.0]))
    assert forward[2] > 0.98
    assert np.abs(POSITION[0, 0, [0, 2]]).max() < 0.1
    assert 1.6 < POSITION[0, SKELETON.index("head_top"), 1] < 1.72


def test_leans_over_the_foot_that_stands():
    """While walking the head moves over the standing foot; while standing the hips are in front of the ankles."""
    heading = quaternion_rotate(ROTATION[:, 0], np.array([0.0, 0.0, 1.0])) * [1, 0, 1]
    ankles = (at("left_ankle") + at("right_ankle")) / 2
    lifted = at("right_ankle")[:, 1] - at("left_ankle")[:, 1]  # above 0: the left foot stands
    walks = during(1.2, 2.6)  # straight ahead, along +Z
    assert np.corrcoef(at("head")[walks, 0], lifted[walks])[0, 1] > 0.3
    ahead = ((at("pelvis") - ankles) * heading).sum(-1)
    for when in (during(0, 0.4), during(7, 8), during(24.4, 25)):
        assert 0.01 < ahead[when].mean() < 0.08


def test_no_frame_jumps():
    step = np.linalg.norm(np.diff(POSITION, axis=0), axis=-1)
    assert step.max() < 0.16  # 4.8 m/s: a toe that swings, a fast hand
    assert geodesic_angle(CLIP.pose.rotation[:-1], CLIP.pose.rotation[1:]).max() < np.deg2rad(20)
    acceleration = np.linalg.norm(np.diff(POSITION[:, : len(SKELETON.joints)], 2, axis=0), axis=-1) * CLIP.frame_rate**2
    assert (acceleration > 15).mean() < 0.01  # feet that swing


def test_joints_stay_in_their_ranges():
    for side, inward in (("left", -1.0), ("right", 1.0)):
        elbow = quaternion_rotate(CLIP.pose.rotation[:, SKELETON.index(f"{side}_elbow")], np.array([-inward, 0.0, 0.0]))
        knee = quaternion_rotate(CLIP.pose.rotation[:, SKELETON.index(f"{side}_knee")], np.array([0.0, -1.0, 0.0]))
        assert elbow[:, 2].min() > -0.02  # the forearm bends forward of the upper arm
        assert knee[:, 2].max() < 0.02  # the shin bends back
        hand = quaternion_rotate(CLIP.pose.rotation[:, SKELETON.index(f"{side}_wrist")], np.array([-inward, 0.0, 0.0]))
        assert np.rad2deg(np.arccos(np.abs(hand[:, 0]).min())) < 80
        for finger in ("index", "middle", "ring", "pinky"):
            turn = CLIP.pose.rotation[:, SKELETON.index(f"{side}_{finger}2")]
            assert (turn[:, 3] * inward).min() > -0.02  # curls toward the palm


@pytest.mark.parametrize("side", ["left", "right"])
def test_feet_stand_still_while_they_stand_and_stay_above_the_floor(side: str):
    foot, ankle, toe = (at(f"{side}_{name}") for name in ("foot", "ankle", "toe"))
    standing = (foot[:, 1] < 0.029) & (ankle[:, 1] < 0.0785)
    spans = np.split(np.arange(len(CLIP)), np.flatnonzero(np.diff(standing)) + 1)
    spans = [span for span in spans if standing[span[0]] and len(span) >= 6]
    assert len(spans) >= 3
    for span in spans:
        assert np.ptp(foot[span], axis=0).max() < 0.01
    assert foot[:, 1].min() > 0.022 and ankle[:, 1].min() > 0.07 and toe[:, 1].min() > 0.005


@pytest.mark.parametrize("solid", ["pelvis", "abdomen", "waist", "chest", "chest_upper", "cranium", "face"])
def test_hands_stay_out_of_trunk_and_head(solid: str):
    row = next(row for row in default_body()["primitives"] if row["name"] == solid)
    start, end = at(row["joint"], row["start"]), at(row["joint"], row["end"])
    for name in SKELETON.points:
        if is_finger(name) or name.endswith(("_tip", "_wrist")):
            depth = row["radius"] - distance_to_segment(at(name), start, end)
            assert depth.max() < 0.003, name


def test_held_poses_move_a_little():
    for start, end in ((6.9, 8.0), (10.0, 10.8), (11.7, 13.0), (24.3, 25.0)):
        when = during(start, end)
        assert np.ptp(at("head_top")[when], axis=0).max() > 0.002
        fingers = [index for index, name in enumerate(SKELETON.joints) if is_finger(name)]
        turned = geodesic_angle(CLIP.pose.rotation[when, fingers][:1], CLIP.pose.rotation[when, fingers])
        assert np.rad2deg(turned.max(axis=0)).mean() > 0.5
