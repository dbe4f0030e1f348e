"""The body as a machine of hinges, driven by named degrees of freedom for the choreography.

Every joint is a product of hinges about its own axes, so a pose is one plain vector, its derivatives are vector
products, and limits and smoothness are linear. Positive angles have an anatomical meaning, the same on both sides.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.geometry.rotation import matrix_to_quaternion

FINGERS = ("index", "middle", "ring", "pinky")
# joint, axis, degree of freedom that turns it, share of the degree of freedom's angle; in the order of turning.
# Sides are written for the left; on the right, turns about Y and Z change sign.
_SPINE = (("+Y", "turn"), ("+X", "bend"), ("+Z", "side"))
_HEAD = (("+Y", "head_turn"), ("+X", "head_nod"), ("+Z", "head_side"))
_CENTRE = [
    ("pelvis", "+Y", "heading", 1.0),
    ("pelvis", "+X", "tilt", 1.0),
    ("pelvis", "+Z", "roll", 1.0),
    *((f"spine{k}", axis, name, 1 / 3) for k in (1, 2, 3) for axis, name in _SPINE),
    *((part, axis, name, 0.5) for part in ("neck", "head") for axis, name in _HEAD),
]
_SIDE = [
    ("collar", "+Z", "collar_raise", 1.0),
    ("collar", "-Y", "collar_forward", 1.0),
    ("shoulder", "+Z", "arm_raise", 1.0),  # from the T-pose: -80 hangs
    ("shoulder", "-Y", "arm_forward", 1.0),
    ("shoulder", "+X", "arm_twist", 1.0),  # inward
    ("elbow", "-Y", "elbow", 1.0),
    ("elbow", "+X", "pronation", 0.5),
    ("wrist", "+X", "pronation", 0.5),
    ("wrist", "-Z", "wrist_flex", 1.0),
    ("wrist", "-Y", "wrist_side", 1.0),  # toward the thumb
    ("hip", "-X", "hip_flex", 1.0),
    ("hip", "+Z", "hip_out", 1.0),
    ("hip", "+Y", "hip_twist", 1.0),  # toes outward
    ("knee", "+X", "knee", 1.0),
    ("ankle", "-X", "ankle", 1.0),  # toes up
    ("ankle", "+Z", "ankle_side", 1.0),
    ("foot", "-X", "toes", 1.0),
    *(
        row
        for finger in FINGERS
        for row in (
            (f"{finger}1", "-Y", f"{finger}_spread", 1.0),
            (f"{finger}1", "-Z", f"{finger}_knuckle", 1.0),
            (f"{finger}2", "-Z", f"{finger}_curl", 1.0),
            (f"{finger}3", "-Z", f"{finger}_curl", 0.65),
        )
    ),
    ("thumb1", "+Y", "thumb_close", 1.0),
    ("thumb1", "-Z", "thumb_down", 1.0),
    ("thumb2", "+Y", "thumb_curl", 0.6),
    ("thumb3", "+Y", "thumb_curl", 1.0),
]
# Comfortable ranges of a person, degrees.
_LIMITS = {
    "turn": (-45, 45), "bend": (-20, 60), "side": (-25, 25),
    "head_turn": (-60, 60), "head_nod": (-30, 35), "head_side": (-25, 25),
    "collar_raise": (-8, 25), "collar_forward": (-12, 25), "arm_raise": (-95, 75), "arm_forward": (-40, 110),
    "arm_twist": (-85, 85), "elbow": (3, 148), "pronation": (-80, 80), "wrist_flex": (-60, 60), "wrist_side": (-18, 25),
    "hip_flex": (-20, 105), "hip_out": (-15, 30), "hip_twist": (-25, 35), "knee": (8, 120), "ankle": (-35, 28),
    "ankle_side": (-15, 15), "toes": (-5, 45),
    "thumb_close": (-30, 35), "thumb_down": (-15, 45), "thumb_curl": (-10, 60),
    **{f"{finger}_spread": (-14, 14) for finger in FINGERS},
    **{f"{finger}_knuckle": (-8, 88) for finger in FINGERS},
    **{f"{finger}_curl": (0, 100) for finger in FINGERS},
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class FigureState:
    """Positions, rotations and axes of the machine in T frames."""

    origin: np.ndarray  # (J + 1, T, 3) m, world; the last joint is the world itself
    rotation: np.ndarray  # (J + 1, T, 3, 3) world ← joint
    local: np.ndarray  # (J, T, 3, 3) parent ← joint
    axis: np.ndarray  # (H, T, 3) world


@dataclass(frozen=True, eq=False)
class Machine:
    """A skeleton whose joints turn on hinges."""

    skeleton: Skeleton
    names: tuple[str, ...]  # N degrees of freedom; the first three are the root's place: x, y, z
    joint: np.ndarray  # (H,) joint of each hinge, parents first
    axis: np.ndarray  # (H, 3) in the joint
    share: np.ndarray  # (H, N) how far each hinge turns with each degree of freedom

    @cached_property
    def carries(self) -> np.ndarray:
        """(J + 1, H) 1 if a hinge moves a joint; the row of the world is 0."""
        joints = len(self.skeleton.joints)
        above = self.skeleton.path[:joints, :joints].copy()
        above[:, 0] = 1
        above[np.arange(joints), np.arange(joints)] = 1
        return np.vstack([above, np.zeros(joints)])[:, self.joint]

    @cached_property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest values (N,), radians."""
        pairs = [_LIMITS.get(name.removeprefix("left_").removeprefix("right_"), (-1e6, 1e6)) for name in self.names]
        low, high = np.deg2rad(np.array(pairs, dtype=float)).T
        return low, high

    def index(self, joint: str) -> int:
        """Index of a joint, or of the 'world'."""
        return len(self.skeleton.joints) if joint == "world" else self.skeleton.index(joint)

    def vector(self, posture: Mapping[str, float], start: np.ndarray | None = None) -> np.ndarray:
        """Return values (N,) from degrees (m for x, y, z) by name; others are as in `start`, or zero."""
        value = np.zeros(len(self.names)) if start is None else start.copy()
        for name, number in posture.items():
            value[self.names.index(name)] = number if name in "xyz" else np.deg2rad(number)
        return value

    def place(self, value: np.ndarray) -> FigureState:
        """Forward kinematics of values (T, N)."""
        skeleton, frames = self.skeleton, len(value)
        joints = len(skeleton.joints)
        origin = np.zeros((joints + 1, frames, 3))
        rotation = np.tile(np.eye(3), (joints + 1, frames, 1, 1))
        local = np.tile(np.eye(3), (joints, frames, 1, 1))
        axis = np.empty((len(self.joint), frames, 3))
        angle = value @ self.share.T
        for joint in range(joints):
            parent = skeleton.parents[joint]
            before = rotation[parent] if joint else rotation[-1]
            origin[joint] = value[:, :3] if joint == 0 else origin[parent] + before @ skeleton.rest_offset[joint]
            for hinge in np.flatnonzero(self.joint == joint):
                axis[hinge] = before @ local[joint] @ self.axis[hinge]
                local[joint] = local[joint] @ _turn(self.axis[hinge], angle[:, hinge])
            rotation[joint] = before @ local[joint]
        return FigureState(origin, rotation, local, axis)

    def point(self, state: FigureState, joint: int, offset: np.ndarray) -> np.ndarray:
        """Return the position (T, 3) of a point fixed to a joint, with offset (3,) or (T, 3)."""
        return (
            state.origin[joint]
            + (state.rotation[joint] @ np.broadcast_to(offset, state.origin[joint].shape)[..., None])[..., 0]
        )

    def point_slope(self, state: FigureState, joint: int, point: np.ndarray, frames: np.ndarray) -> np.ndarray:
        """(F, 3, N) derivative of a joint's points (F, 3) at some frames."""
        joints = np.flatnonzero(self.carries[joint])
        lever = point - state.origin[self.joint[joints]][:, frames]
        slope = np.cross(state.axis[joints][:, frames], lever).transpose(1, 2, 0) @ self.share[joints]
        if joint < len(self.skeleton.joints):
            slope[:, :, :3] += np.eye(3)
        return slope

    def direction_slope(self, state: FigureState, joint: int, direction: np.ndarray, frames: np.ndarray) -> np.ndarray:
        """(F, 3, N) derivative of world directions (F, 3) fixed to a joint at some frames."""
        joints = np.flatnonzero(self.carries[joint])
        return np.cross(state.axis[joints][:, frames], direction).transpose(1, 2, 0) @ self.share[joints]

    def pose(self, value: np.ndarray) -> Pose:
        """The poses (T, ...) of values (T, N)."""
        local = self.place(value).local.swapaxes(0, 1)
        return Pose(self.skeleton, value[:, :3].copy(), matrix_to_quaternion(local))


def machine() -> Machine:
    """The default skeleton on hinges."""
    rows = list(_CENTRE)
    for side in ("left", "right"):
        for joint, axis, name, share in _SIDE:
            flip = side == "right" and axis[1] != "X"
            sign = "-" if (axis[0] == "-") != flip else "+"
            rows.append((f"{side}_{joint}", sign + axis[1], f"{side}_{name}", share))
    skeleton = default_skeleton()
    names = ("x", "y", "z", *dict.fromkeys(row[2] for row in rows))
    axes = np.eye(3)
    return Machine(
        skeleton,
        names,
        joint=skeleton.indices([row[0] for row in rows]),
        axis=np.array([(1 if row[1][0] == "+" else -1) * axes["XYZ".index(row[1][1])] for row in rows]),
        share=np.array([[row[3] * (name == row[2]) for name in names] for row in rows]),
    )


def _turn(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """(T, 3, 3) rotations about a unit axis (3,) by angles (T,). Rodrigues' formula."""
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + sine * skew + (1 - cosine) * (skew @ skew)
