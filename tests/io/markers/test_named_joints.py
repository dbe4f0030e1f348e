"""Joints of a body that a marker file names: key points of a video, names of joints, segments of Qualisys, tables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from virtual_markers import (
    LEGS,
    errors,
    found,
    marker_positions,
    raw_of,
)

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_multiply
from bodysense.io.clip import Clip
from bodysense.io.markers.formats.c3d import write_c3d
from bodysense.io.markers.marker_sets import recognised
from bodysense.io.markers.raw_markers import MarkerFormat, points_alone, read_names
from bodysense.io.markers.recording import read_markers

Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # our axes → those of most laboratories
NAMED = {
    "words": ["LeftElbow", "LeftWrist", "LeftShoulder", "Head", "RightHip", "LeftKnee"],
    "short": ["l_elbow", "l_wrist", "l_shoulder", "head", "r_hip", "l_knee"],
    "centres": ["LEJC", "LWJC", "LSJC", "Head", "RHJC", "LKJC"],
    "behind": ["elbow_l", "wrist_l", "shoulder_l", "head", "hip_r", "knee_l"],
    "ours": ["left_elbow", "left_wrist", "left_shoulder", "head", "right_hip", "left_knee"],
}


def key_points(clip: Clip) -> dict[str, np.ndarray]:
    """(T, 3) of HALPE_26's key points, with toes, nose and the top of the head where our skin has them."""
    place, points = np.asarray(forward_kinematics(clip.pose)[0]), clip.pose.skeleton.points
    at = {name: place[:, k] for k, name in enumerate(points)}
    skin = marker_positions(clip.pose, {"heel": "LHeel", "forehead": "Nose"})
    found = {"Hip": (at["left_hip"] + at["right_hip"]) / 2, "Neck": at["neck"], "Head": at["head_top"], **skin}
    for side, own in (("left", "L"), ("right", "R")):
        for part in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist"):
            found[f"{own}{part.title()}"] = at[f"{side}_{part}"]
        found |= {f"{own}BigToe": at[f"{side}_toe"], f"{own}SmallToe": at[f"{side}_foot"]}
    return found


def test_key_points_of_a_video(unseen_body: Clip) -> None:
    """The middle of the hips is not the pelvis, the head is its top, and toes are not balls of the feet."""
    marks = key_points(unseen_body)
    raw = replace(raw_of(unseen_body, LEGS), names=tuple(marks), position=np.stack(list(marks.values()), axis=1))
    known = recognised(raw.names)
    assert known is not None and known.markers.name == "key points of a video"
    far = errors(raw, unseen_body)
    assert {"head", "left_foot", "right_wrist"} <= set(far) and "pelvis" not in far
    for joint, error in far.items():
        assert error < {"head": 0.045, "foot": 0.03}.get(joint.rpartition("_")[2], 0.001), joint


def test_the_mid_hip_key_point_is_not_the_pelvis(unseen_body: Clip) -> None:
    marks = {
        name.replace("L", "left_").replace("R", "right_"): place for name, place in key_points(unseen_body).items()
    }
    limbs = {name: marks[name] for name in marks if name.endswith(("Hip", "Knee", "Ankle"))}
    raw = replace(raw_of(unseen_body, LEGS), names=tuple(limbs), position=np.stack(list(limbs.values()), axis=1))
    assert "left_hip" in errors(raw, unseen_body) and "pelvis" not in errors(raw, unseen_body)
    assert "the pelvis is left out" in found(raw).remarks[1]
    raised = replace(raw, position=raw.position + np.array([name == "Hip" for name in limbs])[:, None] * [0, 0.087, 0])
    assert errors(raised, unseen_body)["pelvis"] < 0.03


@pytest.mark.parametrize("style", NAMED)
def test_markers_that_are_named_as_joints(style: str) -> None:
    known = recognised([f"A:{name}" for name in NAMED[style]])
    assert known is not None and known.markers.name == "markers named as joints"
    assert list(known.columns) == NAMED["ours"] and list(known.columns.values()) == list(range(6))


def skeleton_tsv(clip: Clip) -> str:
    """A skeleton as Qualisys writes it: each segment's name, place (mm) and rotation (x, y, z, w), Z up."""
    sided = {"collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand"}
    sided |= {"hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase"}
    names = {
        "pelvis": "Hips",
        "spine1": "Spine",
        "spine2": "Spine1",
        "spine3": "Spine2",
        "neck": "Neck",
        "head": "Head",
    }
    names |= {
        f"{side}_{ours}": side.capitalize() + theirs for side in ("left", "right") for ours, theirs in sided.items()
    }
    position, rotation = (np.asarray(part) for part in forward_kinematics(clip.pose))
    turn = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])  # our axes → Z up
    lines = [f"NO_OF_FRAMES\t{len(clip)}", f"FREQUENCY\t{clip.frame_rate:g}", "REFERENCE\tGLOBAL", "SCALE\t1.0"]
    lines.append("\t".join(["Frame", "Time", *(f"{name}\tX\tY\tZ\tQX\tQY\tQZ\tQW" for name in names.values())]))
    for t in range(len(clip)):
        row = [f"{t + 1}", f"{t / clip.frame_rate:.5f}"]
        for k in clip.pose.skeleton.indices(tuple(names)):
            back = turn * [1, -1, -1, -1]
            w, x, y, z = quaternion_multiply(quaternion_multiply(turn, rotation[t, k]), back)
            row += ["", *(f"{1000 * v:.3f}" for v in Z_UP @ position[t, k]), *(f"{v:.6f}" for v in (x, y, z, w))]
        lines.append("\t".join(row))
    return "\n".join(lines) + "\n"


def test_a_skeleton_of_qualisys_is_read_with_its_rotations(unseen_body: Clip, tmp_path: Path) -> None:
    path, text = tmp_path / "anna.tsv", skeleton_tsv(unseen_body)
    path.write_text(text)
    seen = read_markers(path).observation
    truth = forward_kinematics(unseen_body.pose)
    here = unseen_body.pose.skeleton.indices(seen.points)
    np.testing.assert_allclose(seen.position[:, :, [0, 2]], np.asarray(truth[0])[:, here][:, :, [0, 2]], atol=1e-3)
    turned = [k for k, name in enumerate(seen.points) if seen.has_rotation[:, k].all()]
    assert {seen.points[k] for k in turned} >= {"pelvis", "spine3", "head", "left_wrist", "right_ankle"}
    for k in turned:
        assert geodesic_angle(seen.rotation[:, k], np.asarray(truth[1])[:, here[k]]).max() < 1e-3
    path.write_text(text.replace("GLOBAL", "LOCAL"))
    with pytest.raises(BodysenseError, match=r"anna.tsv: its segments are given in their parents; export .* global"):
        read_markers(path)


def test_a_table_names_joints(tmp_path: Path, unseen_body: Clip) -> None:
    truth = np.asarray(forward_kinematics(unseen_body.pose)[0])
    joints = [name for name in BODY if "spine" not in name]
    position = truth[:, unseen_body.pose.skeleton.indices(joints)]
    names = {f"M{k}": name for k, name in enumerate(joints)}
    write_c3d(tmp_path / "a.c3d", points_alone(tuple(names), position, unseen_body.time), 10.0)
    (tmp_path / "names.csv").write_text("\n".join(f"{a},{b}" for a, b in names.items()))
    with pytest.raises(BodysenseError, match=r"no marker set of a body among 'M0', .*: none is of a marker set"):
        read_markers(tmp_path / "a.c3d")
    seen = read_markers(tmp_path / "a.c3d", MarkerFormat(names=read_names(tmp_path / "names.csv"), up="y"))
    order = [seen.observation.points.index(name) for name in joints]
    np.testing.assert_allclose(seen.observation.position[:, order], position, atol=1e-5)
    assert seen.has_body
