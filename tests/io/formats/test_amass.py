"""AMASS files of both models and all key names, and the skeletons of the models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp
from bodysense.io.fingers import is_finger, relaxed_rotation
from bodysense.io.formats.amass import read_amass

TO_Z_UP = Rotation.from_euler("X", 90, degrees=True)  # the rest body of our world, stood up in AMASS's


def motion(frames: int = 4, seed: int = 0) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    return {
        "poses": rng.normal(scale=0.4, size=(frames, 156)).astype(np.float32),
        "trans": rng.normal(size=(frames, 3)).astype(np.float32),
        "mocap_framerate": 120.0,
        "gender": "neutral",
        "betas": np.zeros(16),
    }


def saved(path: Path, arrays: dict[str, Any]) -> Path:
    np.savez(path, **arrays)
    return path


def test_rotations_of_every_joint_are_those_of_the_file(tmp_path: Path) -> None:
    arrays = motion()
    clip = read_amass(saved(tmp_path / "walk.npz", arrays))
    assert clip.pose.skeleton.joints == default_skeleton().joints
    assert (clip.name, clip.frame_rate, clip.has_fingers, len(clip)) == ("walk", 120.0, True, 4)
    theirs = Rotation.from_rotvec(arrays["poses"].reshape(-1, 3)).as_quat(scalar_first=True).reshape(4, 52, 4)
    assert geodesic_angle(clip.pose.rotation[:, 1:], theirs[:, 1:]).max() < 1e-6
    assert (clip.pose.rotation[..., 0] >= 0).all()


def test_a_body_that_faces_minus_y_there_faces_plus_z_here(tmp_path: Path) -> None:
    arrays = motion() | {"poses": np.zeros((4, 156))}
    arrays["poses"][:, :3] = TO_Z_UP.as_rotvec()
    clip = read_amass(saved(tmp_path / "a.npz", arrays))
    x, y, z = arrays["trans"].T
    np.testing.assert_allclose(clip.pose.root_position, np.stack([x, z, -y], axis=-1), atol=1e-12)
    assert geodesic_angle(clip.pose.rotation[:, 0], np.array([1.0, 0, 0, 0])).max() < 1e-9
    position, _ = forward_kinematics(clip.pose)
    index = clip.pose.skeleton.index
    assert (position[:, index("left_wrist"), 0] > position[:, index("right_wrist"), 0] + 1).all()
    assert (position[:, index("left_toe"), 2] > position[:, index("left_ankle"), 2] + 0.1).all()
    assert (position[:, index("head_top"), 1] > position[:, index("pelvis"), 1] + 0.5).all()


def test_smplx_drops_jaw_and_eyes(tmp_path: Path) -> None:
    arrays = motion()
    wide = np.concatenate([arrays["poses"][:, :66], np.full((4, 9), 9.0), arrays["poses"][:, 66:]], axis=1)
    a = read_amass(saved(tmp_path / "h.npz", arrays))
    b = read_amass(saved(tmp_path / "x_stageii.npz", arrays | {"poses": wide, "surface_model_type": "smplx"}))
    np.testing.assert_array_equal(a.pose.rotation, b.pose.rotation)


def test_separate_arrays_and_the_other_name_of_the_rate(tmp_path: Path) -> None:
    arrays = motion()
    poses = arrays.pop("poses")
    arrays |= {"root_orient": poses[:, :3], "pose_body": poses[:, 3:66], "pose_hand": poses[:, 66:]}
    arrays["mocap_frame_rate"] = np.array([arrays.pop("mocap_framerate")])
    a = read_amass(saved(tmp_path / "a.npz", arrays))
    np.testing.assert_array_equal(a.pose.rotation, read_amass(saved(tmp_path / "b.npz", motion())).pose.rotation)
    assert a.frame_rate == 120.0


def test_the_pelvis_of_amass_proper_is_trans_and_the_models_own(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.npz", motion())
    offset = [0.01, -0.23, 0.03]
    shift = read_amass(path, trans_to_pelvis=offset).pose.root_position - read_amass(path).pose.root_position
    np.testing.assert_allclose(shift, [[0.01, 0.03, 0.23]] * 4, atol=1e-12)


def test_fingers_that_were_not_recorded_are_relaxed(tmp_path: Path) -> None:
    arrays = motion()
    arrays["poses"][:, 66:] = 0
    clip = read_amass(saved(tmp_path / "a.npz", arrays))
    assert not clip.has_fingers
    for index, joint in enumerate(clip.pose.skeleton.joints):
        if is_finger(joint):
            np.testing.assert_array_equal(clip.pose.rotation[:, index], [relaxed_rotation(joint)] * 4)
    arrays["poses"][:, 66:] = 0.2  # a model's mean hand: kept, but no motion of fingers
    kept = read_amass(saved(tmp_path / "b.npz", arrays))
    assert not kept.has_fingers
    assert geodesic_angle(kept.pose.rotation[:, 22:], quaternion_exp(np.full(3, 0.2))).max() < 1e-6


def test_a_relaxed_hand_curls_toward_the_palm_and_is_symmetric() -> None:
    for joint in filter(is_finger, default_skeleton().joints):
        turn = Rotation.from_quat(relaxed_rotation(joint), scalar_first=True)
        along = turn.apply([1.0 if joint.startswith("left") else -1.0, 0, 0])
        assert along[1] <= 1e-9, joint  # palms face down
        if joint.startswith("left"):
            other = relaxed_rotation("right" + joint[4:])
            np.testing.assert_allclose(other, relaxed_rotation(joint) * [1, 1, -1, -1])


BROKEN = [
    ({"poses": np.zeros((4, 72))}, r"'poses' has shape \(4, 72\); valid widths are 156 .* and 165"),
    ({"poses": np.zeros(156)}, r"'poses' has shape \(156,\) of float64; it must be numbers \(N, N\)"),
    ({"poses": np.zeros((0, 156)), "trans": np.zeros((0, 3))}, "no frames in it"),
    ({"trans": np.zeros((5, 3))}, r"'trans' has shape \(5, 3\) of float64; it must be numbers \(4, 3\)"),
    ({"trans": np.full((4, 3), np.nan)}, "'trans' is not finite in row 0; cut or mend that frame"),
    ({"poses": np.full((4, 156), "x")}, "of <U1; it must be numbers"),
    ({"trans": None}, "no 'trans' in it; it is needed, with shape"),
    ({"poses": None}, "no 'poses' in it .nor 'root_orient'.; save them as 'poses'"),
    ({"mocap_framerate": None}, "neither 'mocap_framerate' nor 'mocap_frame_rate' in it; add the rate"),
    ({"mocap_framerate": 0.0}, "mocap_framerate is 0.0; it must be one positive number"),
    ({"mocap_framerate": np.array([1.0, 2.0])}, "it must be one positive number"),
    ({"mocap_framerate": "fast"}, "it must be one positive number"),
    ({"poses": np.array([{}])}, "'poses' holds objects of Python, which only unpickling reads"),
]


@pytest.mark.parametrize(("change", "message"), BROKEN)
def test_errors_name_the_problem(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    arrays = {key: value for key, value in (motion() | change).items() if value is not None}
    path = saved(tmp_path / "a.npz", arrays)
    with pytest.raises(BodysenseError, match=message) as error:
        read_amass(path)
    assert str(path) in str(error.value)


def test_no_file_and_the_wrong_skeleton(tmp_path: Path, reframe, make_clip) -> None:
    with pytest.raises(BodysenseError, match=r"no such file"):
        read_amass(tmp_path / "none.npz")
    other = reframe(make_clip(), {}, {"pelvis": "Hips"}).pose.skeleton
    with pytest.raises(BodysenseError, match=r"must have the 52 joints of SMPL-H; 'Hips' differs"):
        read_amass(saved(tmp_path / "a.npz", motion()), other)


def test_a_real_clip_stands_on_the_ground_facing_where_it_walks(motion_data: Path) -> None:
    from bodysense.io.datasets.sources import list_sources, read_source

    walk = next(source for source in list_sources(motion_data) if source.path.stem == "02_01")
    clip = read_source(walk)
    position, _ = forward_kinematics(clip.pose)
    index = clip.pose.skeleton.index
    feet = position[:, [index("left_foot"), index("right_foot"), index("left_toe"), index("right_toe")], 1].min(axis=1)
    assert abs(np.median(feet)) < 0.05
    across = position[:, index("left_hip")] - position[:, index("right_hip")]
    forward = np.cross(across, [0, 1, 0])
    assert (forward[0] @ (position[-1, 0] - position[0, 0])) > 0.5 * np.linalg.norm(forward[0])
    assert clip.frame_rate == 24.0 and not clip.has_fingers
