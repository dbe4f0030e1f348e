"""Headset camera: a brute-force reference on random poses, hand-made poses, batches and errors."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body import capsules
from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.simulated import headset_camera
from bodysense.devices.simulated.headset_camera import (
    BODY_JOINTS,
    FOOT_POINTS,
    SIDES,
    HeadsetCamera,
    Reason,
    camera_pose,
    see,
)
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_canonical, quaternion_exp
from bodysense.observing.checks import check_observation

EDGE = 2e-6  # m (for the cone, cosine): within this of a tie single precision may give either result
FINGERS = ("index", "middle", "pinky", "ring", "thumb")


def reasons(pose: Pose, camera: HeadsetCamera = HeadsetCamera()) -> dict[str, Reason]:
    """Return the reason of every point of one body by name."""
    found = see(pose, camera).reason
    return {name: Reason(value) for name, value in zip(pose.skeleton.points, found, strict=True)}


def random_poses(skeleton: Skeleton, count: int, seed: int) -> Pose:
    """Return poses with various arms, bent knees and hips, turned heads and any heading."""
    generator = np.random.default_rng(seed)
    vector = generator.normal(size=(count, len(skeleton.joints), 3)) * 0.2
    for side, sign in (("left", -1), ("right", 1)):
        shoulder, elbow, hip, knee = skeleton.indices([f"{side}_{n}" for n in ("shoulder", "elbow", "hip", "knee")])
        vector[:, shoulder, 2] += sign * generator.uniform(-0.5, 1.4, count)
        vector[:, shoulder, 1] += sign * generator.uniform(-0.3, 1.3, count)
        vector[:, elbow, 1] += sign * generator.uniform(0, 2.3, count)
        vector[:, hip, 0] -= generator.uniform(-0.2, 1.8, count)
        vector[:, knee, 0] += generator.uniform(0, 2, count)
        for finger in FINGERS[:4]:
            for k in (1, 2, 3):
                vector[:, skeleton.index(f"{side}_{finger}{k}"), 2] += sign * generator.uniform(0, 1.2, count)
    vector[:, skeleton.index("head"), 0] += generator.uniform(-0.3, 1.0, count)
    vector[:, 0, 1] += generator.uniform(-np.pi, np.pi, count)
    return Pose(skeleton, generator.normal(size=(count, 3)), quaternion_exp(vector))


@cache
def skeletons() -> dict[str, Skeleton]:
    """Return the default body, a scaled one, and two of other proportions."""
    default = default_skeleton()
    generator = np.random.default_rng(7)
    bodies = {"default": default, "small": default.scaled(1.3)}
    for name in ("odd", "odder"):
        factor = generator.uniform(0.85, 1.2, size=default.rest_offset.shape)
        shift = generator.normal(size=default.rest_offset.shape) * 0.004
        offset = default.rest_offset * factor + shift
        bodies[name] = default.with_offsets((offset + offset[default.mirror] * [-1, 1, 1]) / 2)
    return bodies


# The reference tests every ray against every primitive, by names, as the module's docstring and the paper define it.

Solids = tuple[list[tuple[np.ndarray, np.ndarray, float]], list[tuple[np.ndarray, np.ndarray, np.ndarray]]]


class Reference:
    """Reference for the view of a headset, by plain loops."""

    def __init__(self, skeleton: Skeleton, camera: HeadsetCamera) -> None:
        self.skeleton, self.camera = skeleton, camera
        self.primitives = capsules.fit_primitives(skeleton)
        self.parent = {
            name: skeleton.points[k] if k >= 0 else None
            for name, k in zip(skeleton.points, skeleton.parents, strict=True)
        }
        self.carrier = [skeleton.points[j] for j in self.primitives.joint]
        self.hand = {side: [name for name in skeleton.points if self.is_below(name, f"{side}_wrist")] for side in SIDES}
        self.joints = [f"{side}_{name}" for side in SIDES for name in (*BODY_JOINTS, *FOOT_POINTS)]
        self.primitive_targets = [
            n
            for n, carrier in enumerate(self.carrier)
            if self.side_of_hand(carrier) or any(self.is_attached(n, name) for name in self.joints)
        ]
        self.passes = self.holding_at_rest() <= 0  # (R, N) primitives that a ray passes through
        for r, name in enumerate(self.joints):
            self.passes[r] |= [self.is_attached(n, name) for n in range(len(self.carrier))]
        for r, n in enumerate(self.primitive_targets, start=len(self.joints)):
            own, side = self.carrier[n], self.side_of_hand(self.carrier[n])
            for k, other in enumerate(self.carrier):
                one_hand = side is not None and other in self.hand[side] and not camera.hand_hides_itself
                self.passes[r, k] |= bool(self.ends(own) & self.ends(other)) or one_hand

    def is_below(self, name: str | None, joint: str) -> bool:
        while name is not None and name != joint:
            name = self.parent[name]
        return name == joint

    def side_of_hand(self, name: str) -> str | None:
        return next((side for side in SIDES if name in self.hand[side]), None)

    def ends(self, joint: str) -> set[str]:
        """Return the joint and its children."""
        return {joint} | {name for name, parent in self.parent.items() if parent == joint}

    def is_attached(self, primitive: int, point: str) -> bool:
        return point in self.ends(self.carrier[primitive])

    def targets(self, position: np.ndarray, solids: Solids) -> np.ndarray:
        middles = [(start + end) / 2 for start, end, _ in solids[0]] + [center for center, _, _ in solids[1]]
        joints = [position[self.skeleton.index(name)] for name in self.joints]
        return np.array(joints + [middles[n] for n in self.primitive_targets])

    def holding_at_rest(self) -> np.ndarray:
        """Return distances (R, N) m of the rays' targets from primitives in the rest pose of the default body."""
        position, rotation = forward_kinematics(rest_pose(default_skeleton()))
        solids = solids_of(capsules.fit_primitives(default_skeleton()), position, rotation)
        return np.array(
            [
                gaps(
                    np.zeros((1, 3)), *solids_of(capsules.fit_primitives(default_skeleton()), position - here, rotation)
                )[0]
                for here in self.targets(position, solids)
            ]
        )

    def see(self, position: np.ndarray, rotation: np.ndarray, slack: float) -> tuple[dict[str, bool], dict[str, bool]]:
        """Return whether each point is known if ties within `slack` hide it, and if they do not."""
        head = self.skeleton.index("head")
        turn = Rotation.from_quat(rotation[head], scalar_first=True)
        origin = position[head] + turn.apply(self.primitives.nose + np.array([0, 0, self.camera.nose_distance]))
        axis = turn.apply(Rotation.from_euler("x", self.camera.tilt, degrees=True).apply([0, 0, 1]))
        solids = solids_of(self.primitives, position - origin, rotation)
        targets = self.targets(position - origin, solids)
        far = np.linalg.norm(targets, axis=1)
        inside = targets @ axis / far - np.cos(np.radians(self.camera.field_of_view / 2))
        clear = np.where(self.passes, np.inf, gaps(targets, *solids)).min(axis=1)
        room = np.minimum(np.minimum(inside, far - self.camera.near), clear)
        return self.combine(room > slack), self.combine(room > -slack)

    def combine(self, free: np.ndarray) -> dict[str, bool]:
        joint = dict(zip(self.joints, free[: len(self.joints)], strict=True))
        part = dict(zip(self.primitive_targets, free[len(self.joints) :], strict=True))
        known = {name: name in ("head", "head_top") for name in self.skeleton.points}
        for name in self.joints:
            known[name] = joint[name] and any(part[n] for n in self.primitive_targets if self.is_attached(n, name))
        for side in SIDES:
            foot = [f"{side}_{name}" for name in FOOT_POINTS]
            known |= dict.fromkeys(foot, any(known[name] for name in foot))
            fingers = [part[n] for n in self.primitive_targets if self.carrier[n] in self.hand[side]]
            enough = sum(fingers) >= self.camera.hand_visible_share * len(fingers)
            known |= dict.fromkeys(self.hand[side], enough)
        return known


def solids_of(primitives: capsules.Primitives, position: np.ndarray, rotation: np.ndarray) -> Solids:
    """Return capsules (start, end, radius) and boxes (center, axes, half_size) in the world."""
    turns = [Rotation.from_quat(q, scalar_first=True).as_matrix() for q in rotation]
    rounds, boxes = [], []
    for n, j in enumerate(primitives.joint):
        if n < len(primitives.radius):
            start, end = (position[j] + turns[j] @ local[n] for local in (primitives.start, primitives.end))
            rounds.append((start, end, float(primitives.radius[n])))
        else:
            b = n - len(primitives.radius)
            boxes.append((position[j] + turns[j] @ primitives.center[b], turns[j], primitives.half_size[b]))
    return rounds, boxes


def gaps(targets: np.ndarray, rounds: list, boxes: list) -> np.ndarray:
    """Return the distances (R, N) m of N primitives from the segments between the origin and R targets.

    Two segments are nearest at one of their four ends, or at the common perpendicular if it meets both.
    """
    a, b, radius = (np.array(part) for part in zip(*rounds, strict=True))
    d, target = b - a, targets[:, None]

    def to_axis(point: np.ndarray) -> np.ndarray:
        s = np.clip(((point - a) * d).sum(-1) / (d * d).sum(-1), 0, 1)
        return np.linalg.norm(a + s[..., None] * d - point, axis=-1)

    def to_ray(point: np.ndarray) -> np.ndarray:
        t = np.clip((point * target).sum(-1) / np.maximum((target * target).sum(-1), 1e-30), 0, 1)
        return np.linalg.norm(point - t[..., None] * target, axis=-1)

    nearest = np.minimum(np.minimum(to_axis(0 * target), to_axis(target)), np.minimum(to_ray(a), to_ray(b)))
    normal = np.cross(target, d)
    square = np.maximum((normal * normal).sum(-1), 1e-30)
    t, s = (np.cross(a, d) * normal).sum(-1) / square, (np.cross(a, target) * normal).sum(-1) / square
    both = (t > 0) & (t < 1) & (s > 0) & (s < 1)
    nearest = np.where(both, np.minimum(nearest, np.abs((a * normal).sum(-1)) / np.sqrt(square)), nearest)
    return np.concatenate([nearest - radius, *(box_gaps(targets, *box)[:, None] for box in boxes)], axis=1)


def box_gaps(targets: np.ndarray, center: np.ndarray, axes: np.ndarray, half_size: np.ndarray) -> np.ndarray:
    """Return by how much (R,) the sides of a box must move out to meet the segments from the origin to R targets.

    Along a segment the largest excess over the three half sizes is convex and piecewise linear. Its minimum is at an
    end or at a crossing of two of its six lines.
    """
    a, d = -center @ axes, targets @ axes
    slope, level = np.concatenate([d, -d], axis=1), np.concatenate([a - half_size, -a - half_size])
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (level[None] - level[:, None]) / (slope[:, :, None] - slope[:, None])
    t = np.clip(np.nan_to_num(t.reshape(len(targets), 36)), 0, 1)  # includes the ends: a line does not cross itself
    t[:, 0] = 1.0
    return (level[:, None] + slope[:, :, None] * t[:, None]).max(axis=1).min(axis=1)


@pytest.mark.parametrize("name", ["default", "small", "odd", "odder"])
def test_visibility_equals_the_reference_on_random_poses(name: str) -> None:
    cameras = {
        "default": HeadsetCamera(),
        "small": HeadsetCamera(hand_visible_share=0.5),  # 8 of 16 are enough
        "odd": HeadsetCamera(field_of_view=170, tilt=30, near=0.2, nose_distance=0.07),
        "odder": HeadsetCamera(hand_hides_itself=True),
    }
    compare_with_reference(random_poses(skeletons()[name], 12, seed=len(name)), cameras[name])


def test_a_hand_is_seen_by_default_if_65_percent_of_it_are() -> None:
    poses = random_poses(skeletons()["default"], 60, seed=5)
    seen = {share: see(poses, HeadsetCamera(hand_visible_share=share)).visible for share in (0.6, 0.65, 0.7)}
    np.testing.assert_array_equal(see(poses).visible, seen[0.65])
    assert (seen[0.6] != seen[0.65]).any() and (seen[0.65] != seen[0.7]).any()


def compare_with_reference(pose: Pose, camera: HeadsetCamera) -> None:
    visible = see(pose, camera).visible
    reference = Reference(pose.skeleton, camera)
    position, rotation = forward_kinematics(pose)
    ties = 0
    for frame in range(len(visible)):
        least, most = reference.see(position[frame], rotation[frame], EDGE)
        for k, point in enumerate(pose.skeleton.points):
            if least[point] == most[point]:
                assert visible[frame, k] == least[point], (frame, point)
            else:
                ties += 1
    assert ties <= 1e-3 * visible.size
    tested = visible[:, ~(see(pose, camera).reason == Reason.INSIDE).all(axis=0)]
    assert 0.2 < tested.mean() < 0.85  # the poses have both seen and hidden points


def test_feet_are_visible_in_the_rest_pose() -> None:
    found = reasons(rest_pose(default_skeleton()))
    for name in ("pelvis", "spine1", "spine2", "spine3", "neck", "left_collar", "right_collar"):
        assert found[name] is Reason.INSIDE
    assert found["head"] is found["head_top"] is Reason.VISIBLE
    assert found["left_toe"] is found["left_ankle"] is Reason.VISIBLE
    assert found["left_hip"] is Reason.OCCLUDED  # by the belly
    assert found["left_shoulder"] is Reason.OUT_OF_VIEW


def test_a_hand_at_the_camera_is_too_close() -> None:
    skeleton = default_skeleton()
    position, rotation = forward_kinematics(rest_pose(skeleton))
    camera = HeadsetCamera()
    center, axis = camera_pose(capsules.fit_primitives(skeleton), position, rotation, camera)
    shifted = position.copy()
    hand = skeleton.path[:, skeleton.index("left_wrist")] > 0
    shifted[hand] += center + 0.08 * axis - position[skeleton.index("left_middle1")]
    found = headset_camera.see_points(skeleton, shifted, rotation, camera)
    assert found.reason[skeleton.index("left_wrist")] == Reason.TOO_CLOSE
    tracked = headset_camera.see_points(skeleton, shifted, rotation, replace(camera, near=0.0))
    assert tracked.visible[skeleton.index("left_wrist")]


@pytest.mark.parametrize("name", ["default", "small", "odd", "odder"])
def test_the_camera_is_outside_the_body(name: str) -> None:
    skeleton = skeletons()[name]
    position, rotation = forward_kinematics(rest_pose(skeleton))
    solids = capsules.fit_primitives(skeleton)
    center, _ = camera_pose(solids, position, rotation, HeadsetCamera())
    assert gaps(np.zeros((1, 3)), *solids_of(solids, position - center, rotation)).min() > 0.02


def test_thicker_solids_hide_more() -> None:
    pose = random_poses(default_skeleton(), 300, seed=3)
    thin, natural, thick = (see(pose, HeadsetCamera(solid_scale=scale)).visible for scale in (0.8, 1.0, 1.2))
    np.testing.assert_array_equal(natural, see(pose).visible)
    for more, less in ((thin, natural), (natural, thick)):
        assert not (less & ~more).any()
        assert less.sum() < more.sum()


@pytest.mark.parametrize("batch", [(), (3, 1, 2), (0,)])
def test_any_leading_axes(batch: tuple[int, ...]) -> None:
    skeleton = default_skeleton()
    flat = random_poses(skeleton, int(np.prod(batch)), seed=5)
    pose = Pose(skeleton, flat.root_position.reshape(*batch, 3), flat.rotation.reshape(*batch, 52, 4))
    found = see(pose)
    assert found.reason.shape == (*batch, len(skeleton.points))
    assert np.array_equal(found.reason.reshape(-1, len(skeleton.points)), see(flat).reason)


def test_long_clips_equal_single_frames() -> None:
    pose = random_poses(default_skeleton(), 300, seed=6)
    whole = see(pose).reason
    assert np.array_equal(whole, np.stack([see(pose[k]).reason for k in range(300)]))


@pytest.mark.parametrize("batch", [(), (2,)])
def test_observe_hides_unseen_points(batch: tuple[int, ...]) -> None:
    skeleton = default_skeleton()
    flat = random_poses(skeleton, 20 * int(np.prod(batch)), seed=8)
    pose = Pose(skeleton, flat.root_position.reshape(*batch, 20, 3), flat.rotation.reshape(*batch, 20, -1, 4))
    observation = check_observation(observe(pose, np.arange(20) / 30, HEADSET_CAMERA))
    position, rotation = forward_kinematics(pose)
    visible = see(pose).visible
    head = skeleton.index("head")
    assert observation.points == skeleton.points
    assert np.array_equal(observation.has_position, visible)
    np.testing.assert_array_equal(observation.position[visible], position[visible])
    assert np.isnan(observation.position[~visible]).all()
    assert observation.has_position[..., head].all()
    assert observation.has_rotation[..., head].all()
    assert observation.has_rotation.sum() == visible[..., 0].size
    np.testing.assert_array_equal(observation.rotation[..., head, :], quaternion_canonical(rotation[..., head, :]))
    assert np.isnan(np.delete(observation.rotation, head, axis=-2)).all()


def test_bad_settings_and_poses_are_refused() -> None:
    skeleton = default_skeleton()
    with pytest.raises(BodysenseError, match="field_of_view 0 must be above 0 and at most 360 degrees"):
        HeadsetCamera(field_of_view=0)
    with pytest.raises(BodysenseError, match=r"hand_visible_share 65 must be above 0 and at most 1"):
        HeadsetCamera(hand_visible_share=65)
    with pytest.raises(BodysenseError, match=r"near -0.1 m must be 0 or more; 0 tracks at every distance"):
        HeadsetCamera(near=-0.1)
    pose = random_poses(skeleton, 5, seed=9)
    pose.root_position[3] = np.nan
    with pytest.raises(BodysenseError, match="the pose of frame 3 is not finite; fill or drop such frames first"):
        see(pose)
    other = Skeleton(("hips", "head"), (), (-1, 0), np.array([[0, 1, 0], [0, 0.6, 0]]))
    with pytest.raises(BodysenseError, match="need a point 'pelvis', which this skeleton lacks"):
        see(rest_pose(other))
