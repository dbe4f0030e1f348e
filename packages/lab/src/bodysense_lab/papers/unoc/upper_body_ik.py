"""Upper body from a headset and two controllers without a network, after Parger et al. 2018 (reproduce.md 1.15).

M. Parger, J. H. Mueller, D. Schmalstieg, M. Steinberger: Human upper-body inverse kinematics for increased embodiment
in consumer-grade virtual reality, VRST 2018. The steps are those of the code that its authors released (VRArmIK, MIT
licence): neck under the head, a trunk that turns and leans with head and hands, collarbones that follow a reaching
hand, a two-bone arm whose elbow turns about the line from shoulder to hand by a weighted sum of the hand's coordinates
and is put right by the hand's orientation. Three things differ.

- The trunk turns with the line between the hands. The released code turns it to the bisector of the hands' directions,
  which on a sample of our train split misses the chest's heading by 26° (root mean square); the head's own heading
  misses it by 21°, the line between the hands by 16°. The line is the same before and behind the body, so that hands
  behind the back need no case of their own.
- Bones keep their lengths: where the released code moves the shoulder off the body to reach a far hand, here the
  collarbone turns toward it, and a hand that is still too far is pointed at.
- The elbow's turn is counted from a reference that follows the hand everywhere it can go, and the hand's orientation
  enters through sines. So everything moves continuously with the hands, without filters that would lag behind.

Constants named "released" are those of VRArmIK; all others were chosen on the train split. The floor is at y = 0: how
far the head is below its standing height says how far the trunk leans. That fails for a sitting body (as UNOC says,
section 5.2) and the legs, of which nothing is known, stand under the trunk.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.geometry.rotation import (
    heading,
    matrix_to_quaternion,
    normalize,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_matrix,
    shortest_arc,
)
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points

# m: mean error of points of either side on the train split; of wrists and head while they are lost, for up to a second.
EXPECTED_ERROR = {
    **{"head": 0.17, "head_top": 0.17, "neck": 0.02, "spine3": 0.05, "spine2": 0.06, "spine1": 0.08, "pelvis": 0.09},
    **{"collar": 0.03, "shoulder": 0.04, "elbow": 0.04, "wrist": 0.11},
    **{"hip": 0.10, "knee": 0.17, "ankle": 0.24, "foot": 0.25, "toe": 0.26},
}
FINGER_ERROR = 0.01  # m, of a relaxed finger's place in its hand


# The weights of the method: lengths as shares of the arm's, angles in radians. `_SWIVEL_BY_FLEXION` was chosen on clips
# with recorded hands alone: where a wrist never bends, it gives the forearm away, and no gain would be too high.

# Trunk: turn by the line between the hands, lean by the head.
_TURN_GAIN = 0.56  # share of the turn of the line between the hands that the trunk takes
_TURN_SOFTNESS = 0.18  # width below which hands are too near to each other to say much
_LEAN_REST = 0.08  # of a standing body that looks straight ahead
_LEAN_BY_PITCH = 0.2  # per radian that the head looks down
_LEAN_BY_DROP = math.radians(142)  # per share of its standing height that the head is lower; released
_LEAN_LIMIT = math.radians(50)  # released
_TILT_BY_ROLL = 0.6  # sideways, per radian that the head is tilted
_NECK_SHARE = 0.2  # of the turn from trunk to head that the neck takes

# Collarbones: radians per share that the hand is beyond `_COLLAR_START`, in front and above.
_COLLAR_START = 0.5  # released
_COLLAR_GAIN = math.radians(30)  # released
_COLLAR_LIMIT = math.radians(33)  # released
_REACH = 0.995  # of the arm's length: where a farther hand pulls the collarbone; released
_REACH_LIMIT = math.radians(33)  # as `_COLLAR_LIMIT`

# Elbow: turn about the line from shoulder to hand, outward, for a hand at (outward, up, forward).
_SWIVEL_REST = math.radians(27)
_SWIVEL_BY_OUTWARD = math.radians(-24)
_SWIVEL_BY_UP = math.radians(24)
_SWIVEL_BY_FORWARD = math.radians(-30)
_SWIVEL_BY_TWIST = 0.25  # per sine of the forearm's twist that the hand asks for
_SWIVEL_BY_FLEXION = 0.4  # per sine of the wrist's bending toward the palm or away from it

# Where the reference of the elbow's turn starts: a hand in front of the body, its elbow down, back and outward. Turned
# by the shortest arc to where the hand is, it is undefined only for a hand behind its shoulder, a little above it.
_HAND = normalize(np.array([0.4, -0.3, 0.8]))
_ELBOW = normalize(np.array([0.3, -1.0, -1.0]) - np.dot([0.3, -1.0, -1.0], _HAND) * _HAND)
_MIRROR, _TURN_MIRROR = np.array([[1.0, 1, 1], [-1, 1, 1]]), np.array([[1.0, 1, 1, 1], [1, 1, -1, -1]])  # left, right


@dataclass(frozen=True, eq=False)
class UpperBodyIkState:
    """Last known poses."""

    head_position: np.ndarray  # (3,) m, world
    head_rotation: np.ndarray  # (4,) wxyz, world ← head
    turn: np.ndarray  # () rad, of the trunk from the head's heading
    wrist_position: np.ndarray  # (2, 3) m, left and right, from the upper chest in its frame
    wrist_rotation: np.ndarray  # (2, 4) wxyz, upper chest ← wrist


@dataclass(frozen=True)
class UpperBodyIk:
    """Analytic upper body of a skeleton from `head`, `left_wrist` and `right_wrist`, each where tracked.

    A hand that is lost stays where it was relative to the upper chest; one that was never seen hangs. The head stays
    where it was in the world. Bone lengths are kept exactly; the head is where it was measured, a hand too unless it
    is out of reach.
    """

    skeleton: Skeleton

    @cached_property
    def _standing(self) -> Pose:
        return standing_pose(self.skeleton)

    @cached_property
    def _standing_height(self) -> float:
        """Height of the standing head above the soles, metres."""
        position, _ = forward_kinematics(self._standing)
        return float(position[self.skeleton.index("head"), 1] - position[:, 1].min())

    @cached_property
    def _arms(self) -> np.ndarray:
        """(2, 4) joints: left and right; collar, shoulder, elbow, wrist."""
        parts = ("collar", "shoulder", "elbow", "wrist")
        return np.array([self.skeleton.indices([f"{side}_{part}" for part in parts]) for side in ("left", "right")])

    @cached_property
    def _expected_error(self) -> np.ndarray:
        """(P,) m, of points that are not tracked."""
        parts = [name.removeprefix("left_").removeprefix("right_") for name in self.skeleton.points]
        return np.array([EXPECTED_ERROR.get(part, FINGER_ERROR) for part in parts])

    def start(self) -> UpperBodyIkState:
        """Nothing seen yet: a standing body that faces +Z."""
        position, rotation = forward_kinematics(self._standing)
        head, chest, *wrists = self.skeleton.indices(["head", "spine3", "left_wrist", "right_wrist"])
        return UpperBodyIkState(
            head_position=position[head],
            head_rotation=rotation[head],
            turn=np.zeros(()),
            wrist_position=position[wrists] - position[chest],
            wrist_rotation=rotation[wrists],
        )

    def step(self, observation: Observation, state: UpperBodyIkState) -> tuple[PointEstimate, UpperBodyIkState]:
        """Complete T frames at once."""
        position, rotation, has_position, has_rotation = observed_points(observation, self.skeleton)
        head, chest, *wrists = self.skeleton.indices(["head", "spine3", "left_wrist", "right_wrist"])
        head_position = _held(position[:, head], has_position[:, head], state.head_position)
        head_rotation = _held(rotation[:, head], has_rotation[:, head], state.head_rotation)
        front = heading(head_rotation)
        turn = _held(self._turn(front, position[:, wrists]), np.all(has_position[:, wrists], axis=1), state.turn)

        pose, place, world = self._trunk(head_position, head_rotation, front, turn)
        inverse = quaternion_conjugate(world[:, chest, None])
        from_chest = quaternion_rotate(inverse, position[:, wrists] - place[:, chest, None])
        wrist_position = _held(from_chest, has_position[:, wrists], state.wrist_position)
        turned = quaternion_multiply(inverse, rotation[:, wrists])
        wrist_rotation = _held(turned, has_rotation[:, wrists], state.wrist_rotation)

        pose.rotation[:, self._arms] = self._reach(wrist_position, wrist_rotation)
        pose = Pose(self.skeleton, pose.root_position, quaternion_canonical(pose.rotation))
        reached, _ = forward_kinematics(pose)
        missed = np.linalg.norm(reached - np.where(has_position[..., None], position, reached), axis=-1)
        estimate = PointEstimate(
            skeleton=self.skeleton,
            position=reached,
            occluded=(~has_position).astype(float),
            confidence=np.where(has_position, missed, self._expected_error),
            pose=pose,
        )
        after = UpperBodyIkState(head_position[-1], head_rotation[-1], turn[-1], wrist_position[-1], wrist_rotation[-1])
        return estimate, after

    def _turn(self, front: np.ndarray, wrists: np.ndarray) -> np.ndarray:
        """(T,) rad: how far the trunk is turned from the head's heading (T, 4), by both wrists (T, 2, 3)."""
        arm_length = float(self.skeleton.bone_length[self._arms[0, 2:]].sum())
        line = quaternion_rotate(quaternion_conjugate(front), wrists[:, 0] - wrists[:, 1]) / arm_length
        # Crossed hands say no more than hands one before the other.
        across = np.maximum(line[:, 0], 0) + _TURN_SOFTNESS
        return _TURN_GAIN * np.arctan2(-line[:, 2], across)

    def _trunk(
        self, head_position: np.ndarray, head_rotation: np.ndarray, front: np.ndarray, turn: np.ndarray
    ) -> tuple[Pose, np.ndarray, np.ndarray]:
        """A standing body (T,), trunk turned and leaned, head as measured; its points and joints in the world."""
        index = self.skeleton.index
        nod = quaternion_log(quaternion_multiply(quaternion_conjugate(front), head_rotation))
        drop = np.maximum(1 - head_position[:, 1] / self._standing_height, 0)
        lean = _LEAN_REST + _LEAN_BY_PITCH * nod[:, 0] + _LEAN_BY_DROP * drop
        lean = np.clip(lean, -_LEAN_LIMIT, _LEAN_LIMIT)
        bend = np.stack([lean, 0 * lean, _TILT_BY_ROLL * nod[:, 2]], axis=-1)

        upright = quaternion_multiply(front, quaternion_exp(turn[:, None] * np.array([0.0, 1.0, 0.0])))
        chest = quaternion_multiply(upright, quaternion_exp(bend))
        toward = quaternion_multiply(quaternion_conjugate(chest), head_rotation)
        neck = quaternion_exp(_NECK_SHARE * quaternion_log(toward))
        rotation = np.tile(self._standing.rotation, (len(turn), 1, 1))
        rotation[:, index("pelvis")] = upright
        rotation[:, [index(f"spine{k}") for k in (1, 2, 3)]] = quaternion_exp(bend / 3)[:, None]
        rotation[:, index("neck")] = neck
        rotation[:, index("head")] = quaternion_multiply(quaternion_conjugate(neck), toward)
        place, world = forward_kinematics(Pose(self.skeleton, np.zeros_like(head_position), rotation))
        root = head_position - place[:, index("head")]
        return Pose(self.skeleton, root, rotation), place + root[:, None], world

    def _reach(self, wrist: np.ndarray, wrist_rotation: np.ndarray) -> np.ndarray:
        """Local rotations (T, 2, 4, 4) of collars, shoulders, elbows and wrists that bring the wrists to their places.

        Wrists (T, 2, 3) m and (T, 2, 4) are in the upper chest's frame. Right arms are solved as left ones, in the
        mirror: x runs outward, y up, z forward.
        """
        hand, hand_rotation = wrist * _MIRROR, wrist_rotation * _TURN_MIRROR
        root, collarbone, upper, fore = np.moveaxis(self.skeleton.rest_offset[self._arms] * _MIRROR[:, None], 1, 0)
        lengths = _length(upper), _length(fore)
        length = lengths[0] + lengths[1]

        far = _COLLAR_GAIN * ((hand - root - collarbone) / length - _COLLAR_START)
        far = np.clip(far, 0, _COLLAR_LIMIT)
        collar = quaternion_exp(np.stack([0 * far[..., 0], -far[..., 2], far[..., 1]], axis=-1))
        bone = quaternion_rotate(collar, np.broadcast_to(collarbone, hand.shape))
        farther = _turn_to_reach(bone, hand - root, _REACH * length, _REACH_LIMIT)
        collar = quaternion_multiply(farther, collar)
        to_hand = hand - root - quaternion_rotate(farther, bone)

        by_place = np.array([_SWIVEL_BY_OUTWARD, _SWIVEL_BY_UP, _SWIVEL_BY_FORWARD])
        swivel = _SWIVEL_REST + (to_hand / length @ by_place)[..., None]
        forearm_to_hand = np.swapaxes(_two_bones(to_hand, swivel, *lengths)[..., 1, :, :], -1, -2)
        forearm_to_hand = forearm_to_hand @ quaternion_to_matrix(hand_rotation)  # hinge frame of the forearm ← hand
        twist, flexion = (
            (forearm_to_hand[..., 2, 1] - forearm_to_hand[..., 1, 2]) / 2,
            forearm_to_hand[..., 1, 0],
        )  # sines
        swivel += (_SWIVEL_BY_TWIST * twist - _SWIVEL_BY_FLEXION * flexion)[..., None]
        bones = matrix_to_quaternion(_two_bones(to_hand, swivel, *lengths))
        bones = quaternion_multiply(bones, shortest_arc(np.stack([upper, fore], axis=1), np.array([1.0, 0.0, 0.0])))

        chain = np.stack([collar, bones[..., 0, :], bones[..., 1, :], hand_rotation], axis=-2)
        chain[..., 1:, :] = quaternion_multiply(quaternion_conjugate(chain[..., :-1, :]), chain[..., 1:, :])
        return chain * _TURN_MIRROR[:, None]


def _turn_to_reach(bone: np.ndarray, hand: np.ndarray, reach: np.ndarray, limit: float) -> np.ndarray:
    """Turn (..., 4) of a bone (..., 3) toward a hand (..., 3), both from its start, until its end is `reach` from it.

    No turn where the hand is near enough, and none beyond `limit`. By the law of cosines.
    """
    radius, distance = _length(bone), np.maximum(_length(hand), 1e-9)
    across = np.cross(bone, hand)
    angle = np.arctan2(_length(across), (bone * hand).sum(axis=-1, keepdims=True))
    enough = np.arccos(np.clip((radius**2 + distance**2 - reach**2) / (2 * radius * distance), -1, 1))
    return quaternion_exp(normalize(across) * np.clip(angle - enough, 0, limit))


def _two_bones(to_hand: np.ndarray, swivel: np.ndarray, upper: np.ndarray, fore: np.ndarray) -> np.ndarray:
    """Frames (..., 2, 3, 3) of upper arm and forearm of a left arm whose hand is at `to_hand` (..., 3) m.

    Columns are the bone's direction, the hinge and where the elbow bends to. The law of cosines places the elbow, of
    bones `upper` and `fore` (..., 1) m long, on a circle; `swivel` (..., 1) says where on it: 0 at the reference,
    positive outward. Both bones turn about their plane's normal, so that the elbow never bends backward.
    """
    distance = np.clip(_length(to_hand), np.maximum(np.abs(upper - fore), 1e-6), upper + fore)
    along = normalize(to_hand)
    # The reference, by the shortest arc from `_HAND` to the hand's direction.
    middle = _HAND + along
    down = _ELBOW - middle * ((along @ _ELBOW) / np.maximum(1 + along @ _HAND, 1e-12))[..., None]
    side = np.cos(swivel) * down + np.sin(swivel) * np.cross(along, down)
    hinge = np.cross(along, side)
    foot = (upper**2 - fore**2 + distance**2) / (2 * distance)
    elbow = foot * along + np.sqrt(np.maximum(upper**2 - foot**2, 0)) * side
    direction = np.stack([elbow / upper, (distance * along - elbow) / fore], axis=-2)
    hinge = np.broadcast_to(hinge[..., None, :], direction.shape)
    return np.stack([direction, hinge, np.cross(direction, hinge)], axis=-1)


def _length(vector: np.ndarray) -> np.ndarray:
    """(..., 3) → (..., 1)."""
    return np.linalg.norm(vector, axis=-1, keepdims=True)


def _held(value: np.ndarray, known: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Values (T, …) with those that are not known (T,) or (T, K) replaced by the last that was, at first `before`."""
    frame = np.arange(1, len(value) + 1).reshape(-1, *[1] * (known.ndim - 1))
    last = np.maximum.accumulate(np.where(known, frame, 0), axis=0)
    history = np.concatenate([before[None], value])
    return history[last] if known.ndim == 1 else history[last, np.arange(known.shape[1])]
