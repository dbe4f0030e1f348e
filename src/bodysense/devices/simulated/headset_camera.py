"""View of a headset's cameras of its wearer (Parger et al. 2021, UNOC, section 4.1).

The paper does not publish its primitives, nor which of them a ray passes through. Here:

- A ray runs to every shoulder, elbow, hip, knee, ankle, foot and toe, and to the middle of every primitive that is
  attached to one of them or belongs to a hand. A primitive is attached to its carrying joint and to that joint's
  children: the upper arm to shoulder and elbow.
- Primitives hide neither their own bones nor neighbouring ones, because neighbours overlap. A ray to a joint passes
  through the primitives attached to it. A ray to a primitive passes through all that share a joint with it. Both pass
  through primitives that contain their target in the default body's rest pose (the upper chest contains the shoulders).
- The primitives of a hand do not hide each other unless `hand_hides_itself` is set. With it, and fingers of natural
  thickness, a hand seen from its edge counts as hidden, and in conversation hands are hidden four fifths of the time;
  the paper reports 14 to 24 %.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import lru_cache

import numpy as np

from bodysense.body.capsules import Primitives, fit_primitives, pose_primitives
from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.simulated.rays import blocked, segment_meets_box, segment_meets_capsule
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_rotate

SIDES = ("left", "right")
BODY_JOINTS = ("shoulder", "elbow", "hip", "knee")  # joints of each side that are seen or hidden independently
FOOT_POINTS = ("ankle", "foot", "toe")  # points of a foot, which are all seen if one is
HEAD_POINTS = ("head", "head_top")  # points that carry the camera and are always known
_BLOCK = 384  # frames at a time, so that the arrays stay in the processor's cache
_KEPT = 31 << 20  # bytes, just below the size from which glibc always returns freed blocks to the system


class Reason(IntEnum):
    """Visibility of a point, or the reason why it is not seen."""

    VISIBLE = 0
    OUT_OF_VIEW = 1
    TOO_CLOSE = 2
    OCCLUDED = 3
    INSIDE = 4  # pelvis, spine, neck and collars: no camera ever sees them


@dataclass(frozen=True)
class HeadsetCamera:
    """The virtual camera of a headset, with the constants of UNOC, section 4.1."""

    nose_distance: float = 0.04  # m, in front of the tip of the nose
    field_of_view: float = 200.0  # degrees, the full angle of a circular cone
    tilt: float = 15.0  # degrees downward from the head's forward direction
    near: float = 0.12  # m; closer points are not tracked
    hand_visible_share: float = 0.65  # least share of a hand's primitives that must be seen for the hand to be seen
    hand_hides_itself: bool = False  # whether the primitives of a hand hide each other
    solid_scale: float = 1.0  # factor on the thickness of all primitives; 1 is the skin of the default body

    def __post_init__(self) -> None:
        if not 0 < self.field_of_view <= 360:
            raise BodysenseError(f"field_of_view {self.field_of_view:g} must be above 0 and at most 360 degrees")
        if not 0 < self.hand_visible_share <= 1:
            raise BodysenseError(f"hand_visible_share {self.hand_visible_share:g} must be above 0 and at most 1")
        if not self.solid_scale > 0:
            raise BodysenseError(f"solid_scale {self.solid_scale:g} must be above 0; 1 is the body's natural thickness")
        if not self.near >= 0:
            raise BodysenseError(f"near {self.near:g} m must be 0 or more; 0 tracks at every distance")


@dataclass(frozen=True, eq=False)
class Visibility:
    """Visibility of every point of a skeleton from a camera."""

    skeleton: Skeleton
    reason: np.ndarray  # (..., P) uint8, values of Reason

    @property
    def visible(self) -> np.ndarray:
        """(..., P) bool: the point is seen or carries the camera."""
        return self.reason == Reason.VISIBLE


def see(pose: Pose, camera: HeadsetCamera = HeadsetCamera()) -> Visibility:
    """Compute which points of posed bodies (...) the headset sees, and why the others are hidden (UNOC, section 4.1).

    A target is seen if it is in the cone, not too close, and no primitive is in front of it. A joint is seen if it and
    a primitive attached to it are. A foot's points are all seen if one is, a hand's points if enough of its primitives
    are. The hidden points of a hand have the reason of most of its primitives.

    Raises BodysenseError for a skeleton with another tree than the default body's, and for a pose that is not finite.
    """
    batch = pose.root_position.shape[:-1]
    rotation = pose.rotation.reshape(-1, *pose.rotation.shape[-2:])
    # The body's position does not matter. Near its root single precision is exact to a micrometre, and faster.
    root = (pose.root_position * 0.0).reshape(-1, 3).astype(np.float32)
    frames = Pose(pose.skeleton, root, rotation.astype(np.float32))
    # Freeing a large block makes glibc keep later ones for reuse. Otherwise each block causes new page faults.
    np.empty(_KEPT, dtype=np.uint8)
    # Process one block at a time, so that all data stay in the processor's cache.
    seen = [
        see_points(pose.skeleton, *forward_kinematics(frames[first : first + _BLOCK]), camera).reason
        for first in range(0, max(len(frames.rotation), 1), _BLOCK)
    ]
    return Visibility(pose.skeleton, np.concatenate(seen).reshape(*batch, len(pose.skeleton.points)))


def see_points(
    skeleton: Skeleton, position: np.ndarray, rotation: np.ndarray, camera: HeadsetCamera = HeadsetCamera()
) -> Visibility:
    """Run `see` on `position` (..., P, 3) m and world `rotation` (..., J, 4) from forward kinematics."""
    primitives = _scaled_primitives(skeleton, camera.solid_scale)
    batch = position.shape[:-2]
    position = position.reshape(-1, *position.shape[-2:])
    rotation = rotation.reshape(-1, *rotation.shape[-2:])
    if not np.isfinite(position.sum() + rotation.sum()):
        frame = int(np.argmin(np.isfinite(position.sum(axis=(1, 2)) + rotation.sum(axis=(1, 2)))))
        raise BodysenseError(f"the pose of frame {frame} is not finite; fill or drop such frames first")
    reason = np.empty(position.shape[:2], dtype=np.uint8)
    for first in range(0, len(position), _BLOCK):
        block = slice(first, first + _BLOCK)
        reason[block] = _see_block(primitives, position[block], rotation[block], camera)
    return Visibility(skeleton, reason.reshape(*batch, len(skeleton.points)))


@lru_cache(maxsize=64)
def _scaled_primitives(skeleton: Skeleton, solid_scale: float) -> Primitives:
    """Return the skeleton's primitives, scaled in thickness."""
    natural = fit_primitives(skeleton)
    if solid_scale == 1:
        return natural
    return replace(natural, radius=natural.radius * solid_scale, half_size=natural.half_size * solid_scale)


def camera_pose(
    primitives: Primitives, position: np.ndarray, rotation: np.ndarray, camera: HeadsetCamera
) -> tuple[np.ndarray, np.ndarray]:
    """Return the camera's centre (..., 3) m and unit axis (..., 3) in the world; arguments as for `see_points`."""
    head = primitives.skeleton.index("head")
    turn = rotation[..., head, :]
    tilt = np.radians(camera.tilt)
    center = primitives.nose + np.array([0.0, 0.0, camera.nose_distance])
    axis = np.array([0.0, -np.sin(tilt), np.cos(tilt)])
    return position[..., head, :] + quaternion_rotate(turn, center), quaternion_rotate(turn, axis)


@dataclass(frozen=True, eq=False)
class _Rays:
    """The R rays of a body, first to J joints, then to primitives, and the data to combine their results."""

    joints: np.ndarray  # (J,) points with a ray
    primitives: np.ndarray  # (R - J,) primitives with a ray to their middle
    blocks: np.ndarray  # (R, N) bool: primitive n can hide the target of ray r
    attached: np.ndarray  # (R - J, J) 0/1: the primitive is attached to the joint
    feet: tuple[np.ndarray, ...]  # for each side, indices among `joints`
    hands: tuple[np.ndarray, ...]  # for each side, indices among `primitives`
    hand_points: tuple[np.ndarray, ...]  # for each side, wrist, finger joints and tips
    inside: np.ndarray  # (P,) bool: points that are never seen


@lru_cache(maxsize=2)
def _rays(hand_hides_itself: bool) -> _Rays:
    """Return the rays of the default body's tree; the module's docstring defines which primitives block them."""
    skeleton = default_skeleton()
    body = fit_primitives(skeleton)
    feet = [skeleton.indices([f"{side}_{name}" for name in FOOT_POINTS]) for side in SIDES]
    hands = [np.flatnonzero(skeleton.path[:, skeleton.index(f"{side}_wrist")]) for side in SIDES]
    joints = np.concatenate([skeleton.indices([f"{side}_{name}" for side in SIDES for name in BODY_JOINTS]), *feet])
    in_hand = [np.isin(body.joint, hand) for hand in hands]
    primitives = np.flatnonzero(body.attached[:, joints].any(axis=1) | np.any(in_hand, axis=0))

    share_a_joint = body.attached.astype(int) @ body.attached.T > 0
    transparent = np.concatenate([body.attached[:, joints].T, share_a_joint[primitives]])
    transparent |= _holds_target(body, joints, primitives)
    if not hand_hides_itself:
        for own in in_hand:
            transparent[len(joints) :] |= own[primitives, None] & own

    known = np.concatenate([joints, *hands, skeleton.indices(HEAD_POINTS)])
    return _Rays(
        joints=joints,
        primitives=primitives,
        blocks=~transparent,
        attached=body.attached[primitives][:, joints].astype(np.float32),
        feet=tuple(np.flatnonzero(np.isin(joints, foot)) for foot in feet),
        hands=tuple(np.flatnonzero(own[primitives]) for own in in_hand),
        hand_points=tuple(hands),
        inside=~np.isin(np.arange(len(skeleton.points)), known),
    )


def _holds_target(body: Primitives, joints: np.ndarray, primitives: np.ndarray) -> np.ndarray:
    """Return (R, N) bool: the primitive contains the ray's target in the rest pose."""
    position, rotation = forward_kinematics(rest_pose(body.skeleton))
    targets = np.concatenate([position[joints], pose_primitives(body, position, rotation).middle[primitives]])
    around = pose_primitives(
        body, position - targets[:, None], np.broadcast_to(rotation, (len(targets), *rotation.shape))
    )
    here = np.zeros((3, 1, 1))  # a ray without length
    start, end, center = (np.moveaxis(part, -1, 0) for part in (around.start, around.end, around.center))
    axes = np.moveaxis(around.axes, (-2, -1), (0, 1))
    in_capsule = segment_meets_capsule(here, start, end - start, body.radius)
    in_box = segment_meets_box(here, center, axes, body.half_size.T[:, None])
    return np.concatenate([in_capsule, in_box], axis=1)


def _see_block(primitives: Primitives, position: np.ndarray, rotation: np.ndarray, camera: HeadsetCamera) -> np.ndarray:
    """Return reasons (F, P) of a block of frames."""
    rays = _rays(camera.hand_hides_itself)
    origin, axis = camera_pose(primitives, position, rotation, camera)
    # Near the camera single precision is exact to a micrometre, and twice as fast.
    position, axis = (position - origin[:, None]).astype(np.float32), axis.astype(np.float32)
    solids = pose_primitives(primitives, position, rotation.astype(np.float32))
    target = np.concatenate([position[:, rays.joints], solids.middle[:, rays.primitives]], axis=1)

    distance = np.sqrt(np.einsum("frc,frc->fr", target, target))
    edge = np.float32(np.cos(np.radians(camera.field_of_view / 2)))
    out_of_view = np.einsum("frc,fc->fr", target, axis) < distance * edge
    too_close = distance < camera.near
    occluded = blocked(target, solids, ~(out_of_view | too_close), rays.blocks)
    answer = np.full(occluded.shape, Reason.VISIBLE, dtype=np.uint8)
    answer[occluded] = Reason.OCCLUDED
    answer[too_close] = Reason.TOO_CLOSE
    answer[out_of_view] = Reason.OUT_OF_VIEW
    return _combine(rays, answer, camera)


def _combine(rays: _Rays, answer: np.ndarray, camera: HeadsetCamera) -> np.ndarray:
    """Return reasons (F, P) of all points from the reasons (F, R) of all rays."""
    joint, primitive = answer[:, : len(rays.joints)].copy(), answer[:, len(rays.joints) :]
    no_attached = (primitive == Reason.VISIBLE) @ rays.attached == 0
    joint[(joint == Reason.VISIBLE) & no_attached] = Reason.OCCLUDED
    for foot in rays.feet:
        seen = (joint[:, foot] == Reason.VISIBLE).any(axis=1, keepdims=True)
        joint[:, foot] = np.where(seen, Reason.VISIBLE, joint[:, foot])
    reason = np.full((len(answer), len(rays.inside)), Reason.VISIBLE, dtype=np.uint8)
    reason[:, rays.inside] = Reason.INSIDE
    reason[:, rays.joints] = joint
    for own, hand in zip(rays.hands, rays.hand_points, strict=True):
        seen, *hidden = ((primitive[:, own] == why).sum(axis=1) for why in list(Reason)[:4])
        most = 1 + np.argmax(hidden, axis=0)
        whole = np.where(seen >= camera.hand_visible_share * len(own), Reason.VISIBLE, most)
        reason[:, hand] = whole[:, None]
    return reason
