"""SMPL results of video tools: layouts, axes, missing arrays and refused files."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense.io.formats.smpl import is_smpl, read_smpl
from bodysense.sources.reading import read

BODY, HAND = 22, 15


@pytest.fixture(scope="module")
def vectors(waving_clip: Clip) -> np.ndarray:
    """Axis-angle (T, 52, 3) of a waving person."""
    rotation = np.asarray(waving_clip.pose.rotation)[:, :, [1, 2, 3, 0]]
    return Rotation.from_quat(rotation.reshape(-1, 4)).as_rotvec().reshape(len(rotation), 52, 3)


def matrices(vectors: np.ndarray) -> np.ndarray:
    return Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(*vectors.shape, 3)


def layouts(v: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    frames, none = len(v), np.zeros((len(v), 2, 3))
    body = np.concatenate([v[:, :BODY], none], axis=1)  # SMPL ends with two hands
    smplx = np.concatenate([v[:, :BODY], none, none[:, :1], v[:, BODY:]], axis=1)
    return {
        "SMPL": {"poses": body.reshape(frames, 72)},
        "SMPL of AIST++": {"smpl_poses": body.reshape(frames, 72)},
        "SMPL of ROMP": {"smpl_thetas": body.reshape(frames, 72)},
        "joints": {"pose": body},
        "matrices": {"poses": matrices(body)},
        "SMPL-H": {"poses": v.reshape(frames, 156)},
        "SMPL-X": {"poses": smplx.reshape(frames, 165)},
        "parts": {"global_orient": v[:, 0], "body_pose": body[:, 1:].reshape(frames, 69)},
        "parts of SMPL-X": {
            "global_orient": v[:, :1],
            "body_pose": v[:, 1:BODY],
            "left_hand_pose": v[:, BODY : BODY + HAND].reshape(frames, 45),
            "right_hand_pose": v[:, BODY + HAND :],
        },
        "parts as matrices": {"global_orient": matrices(v[:, :1]), "body_pose": matrices(body[:, 1:])},
        "one of 4D-Humans": {"global_orient": matrices(v[:, 0]), "body_pose": matrices(body[:, 1:])},
        "hands by coefficients": {
            "global_orient": v[:, 0],
            "body_pose": v[:, 1:BODY].reshape(frames, 63),
            "left_hand_pose": np.zeros((frames, 6)),
        },
    }


@pytest.mark.parametrize("layout", layouts(np.zeros((1, 52, 3))))
def test_layouts(tmp_path: Path, waving_clip: Clip, vectors: np.ndarray, layout: str) -> None:
    path = tmp_path / "a.npz"
    arrays = layouts(vectors)[layout]
    everything = {"transl": waving_clip.pose.root_position, "fps": np.array(30), "betas": np.zeros(10), **arrays}
    np.savez(path, **everything)  # type: ignore[arg-type]
    assert is_smpl(path)
    clip, remarks = read_smpl(path)
    assert remarks == () and clip.frame_rate == 30
    joints = 52 if any(values.shape[1:] != (72,) and "hand" in name for name, values in arrays.items()) else BODY
    joints = 52 if layout in ("SMPL-H", "SMPL-X", "parts of SMPL-X") else min(joints, BODY)
    angle = geodesic_angle(clip.pose.rotation, waving_clip.pose.rotation)[:, :joints]
    assert angle.max() < 1e-6
    np.testing.assert_allclose(clip.pose.root_position, waving_clip.pose.root_position, atol=1e-9)
    assert clip.has_fingers == (joints == 52)


AXES = {"+Y": [0, 0, 0], "-Y": [180, 0, 0], "+Z": [90, 0, 0], "-Z": [-90, 0, 0], "+X": [0, 0, -90], "-X": [0, 0, 90]}


@pytest.mark.parametrize("up", ["+Y", "-Y", "+Z", "-X"])
def test_the_up_axis_is_found(tmp_path: Path, waving_clip: Clip, vectors: np.ndarray, up: str) -> None:
    """Cameras look along +Z with +Y down; some tools have +Z up; whichever it is, the body stands."""
    turn = Rotation.from_euler("xyz", AXES[up], degrees=True)
    turned = vectors.copy()
    turned[:, 0] = (turn * Rotation.from_rotvec(vectors[:, 0])).as_rotvec()
    place = turn.apply(np.asarray(waving_clip.pose.root_position))
    np.savez(tmp_path / "a.npz", poses=turned.reshape(-1, 156), trans=place, fps=30.0)
    clip, remarks = read_smpl(tmp_path / "a.npz")
    assert any(f"{up} is up" in remark for remark in remarks) == (up != "+Y")
    ours, truth = (np.asarray(forward_kinematics(one.pose)[0]) for one in (clip, waving_clip))
    np.testing.assert_allclose(ours[..., 1], truth[..., 1], atol=1e-6)


def test_the_floor_is_found(tmp_path: Path, waving_clip: Clip, vectors: np.ndarray) -> None:
    np.savez(tmp_path / "a.npz", poses=vectors.reshape(-1, 156), trans=np.tile([0.0, 7.0, 3.0], (90, 1)), fps=30.0)
    clip, remarks = read_smpl(tmp_path / "a.npz")
    lowest = np.asarray(forward_kinematics(clip.pose)[0])[..., 1].min()
    assert "moved to 0" in remarks[0] and abs(lowest) < 0.06
    assert clip.pose.root_position[0, 2] == pytest.approx(3)


def test_missing_arrays_are_reported(tmp_path: Path, vectors: np.ndarray) -> None:
    np.save(tmp_path / "a.npy", vectors[:, :24].reshape(-1, 72))
    clip, remarks = read_smpl(tmp_path / "a.npy")
    assert any("no translation" in remark for remark in remarks) and any("30 Hz" in remark for remark in remarks)
    assert read_smpl(tmp_path / "a.npy", rate=25.0)[0].frame_rate == 25
    feet = default_skeleton().indices(["left_toe", "right_toe", "left_foot", "right_foot"])
    assert np.abs(np.asarray(forward_kinematics(clip.pose)[0])[:, feet, 1].min(axis=1)).max() < 0.06
    read_back = read(tmp_path / "a.npy")
    assert isinstance(read_back, Clip) and len(read_back) == 90


def test_amass_stays_amass(tmp_path: Path, vectors: np.ndarray) -> None:
    place = np.zeros((90, 3))
    np.savez(tmp_path / "a.npz", poses=vectors.reshape(-1, 156), trans=place, mocap_framerate=60.0)
    assert not is_smpl(tmp_path / "a.npz")
    assert not is_smpl(tmp_path / "a.bvh")


def wrong(v: np.ndarray) -> dict[str, tuple[dict[str, object], str]]:
    poses = v[:, :24].reshape(-1, 72)
    hole = poses.copy()
    hole[7, 3] = np.nan
    return {
        "no poses": ({"global_orient": v[:, 0]}, "no poses in it; give 'poses'"),
        "a wrong width": ({"poses": poses[:, :70]}, r"'poses' has shape \(90, 70\); give one person's, \(T, 66 or 72"),
        "axes before joints": ({"poses": np.ones((90, 3, 22))}, r"or joint places \(T, 22, 3\)"),
        "degrees": (
            {"poses": np.rad2deg(np.ones_like(poses))},
            r"rotation vectors of up to 99.2 rad.*give radians, or",
        ),
        "several people": ({"poses": np.stack([poses, poses])}, "give one person's"),
        "a hole": ({"poses": hole}, "'poses' is not finite in frame 7; cut or mend"),
        "texts": ({"poses": np.array([["a"] * 72])}, "it must be numbers"),
        "no matrices": ({"poses": np.ones((5, 24, 3, 3))}, "holds no rotation matrices"),
        "other frames": ({"poses": poses, "transl": np.zeros((3, 3))}, r"'transl' has shape \(3, 3\); 90 frames need"),
        "no rate": ({"poses": poses, "fps": -1.0}, "'fps' is -1.0; it must be a positive number of Hz: give --rate"),
        "parts of other lengths": (
            {"global_orient": v[:5, 0], "body_pose": v[:, 1:22]},
            "parts of its poses have 5, 90 frames",
        ),
        "objects": (
            {"poses": np.array([{"a": 1}], dtype=object)},
            "objects of Python.*convert it once: python -c",
        ),
    }


@pytest.mark.parametrize("what", wrong(np.zeros((90, 52, 3))))
def test_errors_name_the_problem(tmp_path: Path, vectors: np.ndarray, what: str) -> None:
    arrays, message = wrong(vectors)[what]
    np.savez(tmp_path / "a.npz", **arrays)  # type: ignore[arg-type]
    with pytest.raises(BodysenseError, match=message) as caught:
        read_smpl(tmp_path / "a.npz")
    assert "a.npz" in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["a.pkl", "a.npy"])
def test_dictionaries_in_pickles_are_read(tmp_path: Path, vectors: np.ndarray, name: str) -> None:
    kept = {"poses": vectors[:, :24].reshape(-1, 72), "transl": np.zeros((90, 3)), "faces": None}
    nested = {"meta": {"tool": "x"}, "camera": {"poses": 0 * kept["poses"]}, "person": {"world": kept}}
    if name.endswith(".npy"):
        np.save(tmp_path / name, np.array(nested, dtype=object), allow_pickle=True)
    else:
        (tmp_path / name).write_bytes(pickle.dumps(nested))
    np.savez(tmp_path / "plain.npz", poses=kept["poses"], transl=kept["transl"])
    found, plain = (read_smpl(tmp_path / one)[0] for one in (name, "plain.npz"))
    np.testing.assert_array_equal(found.pose.rotation, plain.pose.rotation)


def test_a_short_motion_of_three_frames_is_no_matrix(tmp_path: Path, vectors: np.ndarray) -> None:
    few = vectors[:3]
    np.savez(tmp_path / "a.npz", global_orient=few[:, 0], body_pose=few[:, 1:22].reshape(3, 63), fps=30)
    clip, _ = read_smpl(tmp_path / "a.npz")
    angle = geodesic_angle(clip.pose.rotation[:, 0], Rotation.from_rotvec(few[:, 0]).as_quat()[:, [3, 0, 1, 2]])
    assert len(replace(clip, name="x")) == 3 and angle.max() < 1e-6
