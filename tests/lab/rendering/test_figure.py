from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.io.clip import Clip
from bodysense_lab.rendering.character import FIGURES, FigureName, load_figure


@pytest.mark.parametrize("name", FIGURES)
def test_in_the_t_pose_the_skin_surrounds_the_joints(name: FigureName) -> None:
    figure = load_figure(name)
    vertices, normals = figure.skin(rest_pose(figure.skeleton))
    assert np.allclose(vertices, figure.vertices, atol=1e-5)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-4)
    for point, place in zip(figure.skeleton.points, figure.rest, strict=True):
        nearest = np.linalg.norm(vertices - place, axis=1).min()
        assert nearest < 0.16, f"{point} is {nearest:.2f} m from any skin"
    assert 1.5 < figure.skeleton.height < 1.9
    assert abs(np.ptp(vertices[:, 1]) - figure.skeleton.height) < 0.03


@pytest.mark.parametrize("name", FIGURES)
def test_normals_point_outward(name: FigureName) -> None:
    figure = load_figure(name)
    a, b, c = (figure.vertices[figure.triangles[:, k]].astype(float) for k in range(3))
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6  # by the divergence theorem
    assert 0.03 < volume < 0.15  # m³; a person has about the density of water


def test_the_skin_follows_rigid_motion_of_the_body() -> None:
    figure = load_figure("man")
    bent = rest_pose(figure.skeleton)
    rng = np.random.default_rng(0)
    bent.rotation[:] = quaternion_exp(rng.normal(0, 0.3, (len(bent.rotation), 3)))
    turn, shift = quaternion_exp(np.array([0.4, -1.1, 0.3])), np.array([1.0, 0.2, -3.0])
    turned = bent.rotation.copy()
    turned[0] = quaternion_multiply(turn, bent.rotation[0])
    transformed = Pose(figure.skeleton, quaternion_rotate(turn, bent.root_position) + shift, turned)
    for ours, before, offset in zip(figure.skin(transformed), figure.skin(bent), (shift, 0.0), strict=True):
        assert np.allclose(ours, quaternion_rotate(turn, before.astype(float)) + offset, atol=1e-4)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_twist_of_a_hand_spreads_along_the_forearm(side: str) -> None:
    figure = load_figure("woman")
    elbow, wrist = (figure.rest[figure.skeleton.index(f"{side}_{name}")] for name in ("elbow", "wrist"))
    pose = rest_pose(figure.skeleton)
    pose.rotation[figure.skeleton.index(f"{side}_wrist")] = quaternion_exp(np.array([np.pi / 2, 0.0, 0.0]))
    vertices, _ = figure.skin(pose)
    along = (figure.vertices - elbow) @ (wrist - elbow) / ((wrist - elbow) @ (wrist - elbow))
    for low, high, degrees in ((0.05, 0.15, 9.0), (0.45, 0.55, 45.0), (0.85, 0.95, 81.0)):
        ring = (along > low) & (along < high) & (np.linalg.norm(figure.vertices - elbow, axis=1) < 0.4)
        before, after = (one[ring][:, 1:] - wrist[1:] for one in (figure.vertices, vertices))
        angle = np.angle((after[:, 0] + 1j * after[:, 1]) / (before[:, 0] + 1j * before[:, 1]), deg=True)
        assert abs(np.median(angle) - degrees) < 8


def test_retargeting_keeps_rotations_and_feet_on_the_floor(waving_clip: Clip) -> None:
    figure = load_figure("heavy")
    retargeted = figure.retarget(waving_clip.pose)
    assert np.array_equal(retargeted.rotation, waving_clip.pose.rotation)
    soles = [np.asarray(forward_kinematics(pose)[0])[..., 1].min(axis=-1) for pose in (retargeted, waving_clip.pose)]
    assert np.abs(soles[0] - soles[1]).max() < 0.03


def test_other_joints_and_other_figures_are_refused() -> None:
    skeleton = default_skeleton()
    renamed = type(skeleton)(
        tuple(name.upper() for name in skeleton.joints), skeleton.end_sites, skeleton.parents, skeleton.rest_offset
    )
    with pytest.raises(BodysenseError, match="other joints"):
        load_figure("man").retarget(rest_pose(renamed, (2,)))
    with pytest.raises(BodysenseError, match="unknown figure 'dog'; valid are woman, man, heavy"):
        load_figure("dog")  # type: ignore[arg-type]
