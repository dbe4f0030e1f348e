"""Markers that a body wears: the joint that carries each, its offset there, and the lengths of the bones.

A marker is fixed to the joint with which it moves most rigidly on the tracker's poses. Then its offset, the bones and
the poses of some frames are fitted together to the markers (bundle adjustment): Gauss-Newton steps, from which the
poses are eliminated by the Schur complement. The tracker's poses are only the start of that fit: their errors are the
same in many frames, so they would bias it as a prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.rotation import (
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_to_matrix,
)

Array = np.ndarray
SPINE = ("spine1", "spine2", "spine3")  # bends evenly: markers determine only the sum of its bends
MARKER = 0.006  # m; deviation of a marker from its place on the body, until it is known
TURN = 0.3  # rad; deviation of a joint's rotation from the tracker's, of a spine's joint from an even bend
ROOT = 0.05  # m; deviation of the pelvis from the tracker's
OFFSET = 0.03  # m; deviation of a marker's offset from its offset on the tracker's poses
ALONG, ACROSS = 0.03, 0.01  # m; deviations of a bone along its direction and across
SHORT = 0.005  # m; deviation of bones of spine and collar, whose lengths and bends are hard to tell apart
_SHORT = (*SPINE, "collar")  # joints at the ends of these bones
_NOISE = (0.003, 0.015)  # m; range of that deviation
_CORRELATED = 2.5  # times by which it is larger than what a fit misses: skin slides with the pose, and a fit follows
_FREE_TURN = 3.0  # rad; as TURN, at the end of the fit of offsets and bones
_POSES = 48  # frames from which offsets and bones are fitted
_CANDIDATES = 1500  # frames from which these are chosen
_ROUNDS = 6  # steps of that fit
_FEWEST_MARKERS = 3  # of a body that is fitted
_FEWEST = 20  # frames in which a marker must be seen
_SAMPLES = 300  # frames from which the rigidity of a marker on joints is estimated
HAND = 0.09  # m, from the wrist to the knuckles
_HEEL = 0.5  # length of the heel, as a share of that from the ankle to the ball
_WITHOUT_MARKERS = ("spine1", "spine2", "foot")  # joints whose rotation no usual marker determines
_PER_METRE = 0.3  # m of deviation that count as much as a metre between a marker and a bone
_CONDYLE = 0.075  # m; markers of a condyle or a malleolus are nearer to the joint
_BESIDE = 0.7  # share of that distance along the axis of the knee or ankle
_LOOSER = 0.03  # m by which they may deviate more on the bone above, whose pose is less accurate
_MIRROR = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True, eq=False)
class WornMarkers:
    """Markers of a body."""

    skeleton: Skeleton
    joint: Array  # (M,) int, the joint that carries each
    offset: Array  # (M, 3) m, in that joint's axes
    deviation: Array  # (M,) m, of each offset from the first one
    noise: Array  # (M,) m, of each position
    columns: Array  # (M,) int, index of each among the points of a take

    @cached_property
    def above(self) -> Array:
        """Return (J, J) bool: whether the first joint is the second one or above it."""
        above = np.eye(len(self.skeleton.joints), dtype=bool)
        for joint in range(1, len(above)):
            above[:, joint] |= above[:, self.skeleton.parents[joint]]
        return above

    def start(self, poses: BodyPoses) -> BodyPoses:
        """Return the tracker's poses with a spine that bends evenly, if markers above it determine the chest."""
        joints = self.skeleton.indices(SPINE)
        if not self.above[joints[-1], self.joint].any():
            return poses
        local = np.array(poses.local)
        bend = local[:, joints[0]]
        for joint in joints[1:]:
            bend = quaternion_multiply(bend, local[:, joint])
        even = np.asarray(quaternion_log(quaternion_canonical(bend))) / len(SPINE)
        local[:, joints] = np.asarray(quaternion_exp(even))[:, None]
        return BodyPoses(poses.root, local)

    def place(self, joints: Array, turn: Array) -> Array:
        """Return positions (T, M, 3) m of the markers on joints (T, J, 3) m with rotations (T, J, 3, 3)."""
        return joints[:, self.joint] + np.einsum("tmab,mb->tma", turn[:, self.joint], self.offset)


@dataclass(frozen=True, eq=False)
class SeenMarkers:
    """Markers of a take, and the joint centres that follow from those of each frame alone.

    A centre is one more marker of its joint: part of its error is the same in all frames, an offset in its axes.
    """

    position: Array  # (T, M, 3) m, world; NaN where hidden
    joints: tuple[str, ...]  # of the centres
    centre: Array  # (T, C, 3) m, world; NaN where hidden
    accuracy: Array  # (C,) m

    def columns(self, columns: Array, frames: Array | slice = slice(None)) -> Array:
        """Return places (N, M, 3) m in some frames of some columns of markers, which centres follow."""
        count, found = self.position.shape[1], np.empty((len(self.position[frames, 0]), len(columns), 3))
        for place, column in enumerate(columns.tolist()):
            source, own = (self.position, column) if column < count else (self.centre, column - count)
            found[:, place] = source[frames, own]
        return found


@dataclass(frozen=True, eq=False)
class BodyPoses:
    """Poses of frames, in steps of a fit."""

    root: Array  # (T, 3) m, world
    local: Array  # (T, J, 4) wxyz, parent ← joint

    @staticmethod
    def of(pose: Pose) -> BodyPoses:
        """Return the poses (T,) of a body."""
        return BodyPoses(np.asarray(pose.root_position), np.asarray(pose.rotation))

    def __getitem__(self, rows: Array | slice) -> BodyPoses:
        """Return some frames."""
        return BodyPoses(self.root[rows], self.local[rows])

    def kinematics(self, skeleton: Skeleton) -> tuple[Array, Array]:
        """Return positions (T, J, 3) m and rotations (T, J, 3, 3) of the joints, world."""
        position, rotation = forward_kinematics(Pose(skeleton, self.root, self.local))
        return np.asarray(position)[:, : len(skeleton.joints)], quaternion_to_matrix(np.asarray(rotation))

    def moved(self, step: Array, turn: Array) -> BodyPoses:
        """Return the poses after a step (T, 3 + 3 J): translation of the root, and turns of joints in world axes."""
        own = np.einsum("tjba,tjb->tja", turn, step[:, 3:].reshape(*self.local.shape[:2], 3))
        local = quaternion_canonical(quaternion_multiply(self.local, quaternion_exp(own)))
        return BodyPoses(self.root + step[:, :3], np.asarray(local))

    def step_to(self, other: BodyPoses, turn: Array) -> Array:
        """Return the step (T, 3 + 3 J) to other poses of the same frames."""
        own = quaternion_log(quaternion_multiply(quaternion_conjugate(self.local), other.local))
        turns = np.einsum("tjab,tjb->tja", turn, np.asarray(own))
        return np.concatenate([other.root - self.root, turns.reshape(len(turns), -1)], axis=1)


def fit_worn_markers(pose: Pose, seen: SeenMarkers, *, is_known: bool) -> WornMarkers | None:
    """Fit the offsets of markers, and the bones unless they are known.

    Args:
        pose: (T,) of the tracker; its skeleton is the likeliest one.
        seen: markers of these frames.
        is_known: whether the skeleton is the wearer's own.

    Returns None if too few markers are seen.
    """
    worn = carried_markers(pose, seen)
    if len(worn.columns) < _FEWEST_MARKERS:
        return None
    chosen = _different_frames(pose, seen.columns(worn.columns))
    poses, position = worn.start(BodyPoses.of(pose)[chosen]), seen.columns(worn.columns, chosen)
    _, missed = _adjusted(worn, poses[::2], position[::2], is_known=is_known)
    noise = float(np.clip(_CORRELATED * missed, *_NOISE))
    worn = replace(worn, noise=np.where(worn.columns < seen.position.shape[1], noise, worn.noise))
    return _adjusted(worn, poses, position, is_known=is_known)[0]


def carried_markers(pose: Pose, seen: SeenMarkers) -> WornMarkers:
    """Fix markers to the joints with which they move most rigidly, and centres to their own joints."""
    poses, skeleton = BodyPoses.of(pose), pose.skeleton
    position = np.concatenate([seen.position, seen.centre], axis=1)
    is_seen, markers = np.asarray(np.isfinite(position).all(axis=-1)), seen.position.shape[1]
    columns = np.flatnonzero(is_seen.sum(axis=0) >= _FEWEST)
    columns = columns[
        (columns < markers)
        | np.isin(columns - markers, [k for k, name in enumerate(seen.joints) if name in skeleton.joints])
    ]
    carriers, offsets = [], []
    for marker in columns.tolist():
        if marker >= markers:
            carriers.append(skeleton.index(seen.joints[marker - markers]))
            offsets.append(np.zeros(3))
            continue
        frames = np.flatnonzero(is_seen[:, marker])
        frames = frames[np.unique(np.linspace(0, len(frames) - 1, min(len(frames), _SAMPLES)).astype(int))]
        joints, turn = poses[frames].kinematics(skeleton)
        local = np.einsum("tjba,tjb->tja", turn, position[frames, marker][:, None] - joints)
        middle = np.median(local, axis=0)
        spread = np.sqrt(((local - middle) ** 2).sum(axis=-1).mean(axis=0))
        carriers.append(_carrier(skeleton, spread, middle))
        offsets.append(middle[carriers[-1]])
    deviation = np.concatenate([np.full(markers, OFFSET), seen.accuracy])[columns]
    noise = np.concatenate([np.full(markers, MARKER), seen.accuracy])[columns]
    offset = np.array(offsets).reshape(-1, 3)
    return WornMarkers(skeleton, np.array(carriers, dtype=int), offset, deviation, noise, columns)


def _carrier(skeleton: Skeleton, spread: Array, offset: Array) -> int:
    """Return the joint that carries a marker, whose offset (J, 3) m from each joint deviates by `spread` (J,) m.

    It is the joint with the most rigid and nearest bone. Condyles and malleoli, at the sides of a joint, are ends of
    the bone above it.
    """
    apart = np.array([_from_bones(skeleton, joint, offset[joint]) for joint in range(len(offset))])
    bare = np.array([name.endswith(_WITHOUT_MARKERS) for name in skeleton.joints])
    joint = int(np.argmin(np.where(bare, np.inf, spread + _PER_METRE * apart)))
    part, parent = skeleton.joints[joint].rpartition("_")[2], skeleton.parents[joint]
    far = np.linalg.norm(offset[joint])
    beside = part == "elbow" or (part in ("knee", "ankle") and abs(offset[joint, 0]) > _BESIDE * far)
    return parent if beside and far < _CONDYLE and spread[parent] < spread[joint] + _LOOSER else joint


def _from_bones(skeleton: Skeleton, joint: int, offset: Array) -> float:
    """Return the distance in metres of a place in a joint's axes from the bones that begin there."""
    ends = [skeleton.rest_offset[k] for k, parent in enumerate(skeleton.parents) if parent == joint]
    if not ends:  # a hand without fingers continues its forearm
        ends = [HAND * skeleton.rest_offset[joint] / np.linalg.norm(skeleton.rest_offset[joint])]
    least = -_HEEL if skeleton.joints[joint].endswith("ankle") else 0.0
    shares = [np.clip(offset @ end / max(end @ end, 1e-12), least, 1) for end in ends]
    return min(float(np.linalg.norm(offset - share * end)) for share, end in zip(shares, ends, strict=True))


def _different_frames(pose: Pose, position: Array) -> Array:
    """Return the frames whose poses differ most, among those with most markers (T, M, 3)."""
    count = np.isfinite(position[..., 0]).sum(axis=1)
    usable = np.flatnonzero(count >= np.median(count))
    usable = usable[np.unique(np.linspace(0, len(usable) - 1, min(len(usable), _CANDIDATES)).astype(int))]
    turns = quaternion_to_matrix(np.asarray(pose.rotation)[usable, 1:]).reshape(len(usable), -1)
    chosen = [int(np.argmin(((turns - turns.mean(axis=0)) ** 2).sum(axis=1)))]
    apart = ((turns - turns[chosen[0]]) ** 2).sum(axis=1)
    while len(chosen) < min(_POSES, len(usable)) and apart.max() > 0:
        chosen.append(int(np.argmax(apart)))
        apart = np.minimum(apart, ((turns - turns[chosen[-1]]) ** 2).sum(axis=1))
    return np.sort(usable[chosen])


@dataclass(frozen=True, eq=False)
class _FittedBones:
    """Bones that are fitted: those of the middle, and pairs of both sides, which mirror each other."""

    pairs: tuple[tuple[int, ...], ...]  # joints at the bones' ends
    usual: Array  # (P, N, 3) m by point: rest offsets of the likeliest skeleton
    information: Array  # (N, 3, 3) 1/m²

    @staticmethod
    def of(skeleton: Skeleton, *, is_known: bool) -> _FittedBones:
        pairs = tuple(
            (k, skeleton.index(name.replace("left_", "right_"))) if name.startswith("left_") else (k,)
            for k, name in enumerate(skeleton.joints)
            if k and not name.startswith("right_") and not is_known
        )
        information = np.zeros((len(pairs), 3, 3))
        for k, (joint, *_) in enumerate(pairs):
            way = skeleton.rest_offset[joint]
            along = np.outer(way, way) / max(way @ way, 1e-12)
            information[k] = along / ALONG**2 + (np.eye(3) - along) / ACROSS**2
            if skeleton.joints[joint].endswith(_SHORT):
                information[k] = np.eye(3) / SHORT**2
        return _FittedBones(pairs, skeleton.rest_offset, information)

    def changed(self, skeleton: Skeleton, change: Array) -> Skeleton:
        """Return a skeleton whose bones change by (N, 3) m."""
        rest = np.array(skeleton.rest_offset)
        for joints, step in zip(self.pairs, change, strict=True):
            for side, joint in enumerate(joints):
                rest[joint] += _MIRROR * step if side else step
        return replace(skeleton, rest_offset=rest)


def _adjusted(worn: WornMarkers, start: BodyPoses, position: Array, *, is_known: bool) -> tuple[WornMarkers, float]:
    """Fit offsets and bones to the markers (T, M, 3) of some frames.

    Also return by how much the fit misses the most accurate points, m, root mean square of a coordinate.
    """
    bones, poses = _FittedBones.of(worn.skeleton, is_known=is_known), start
    count, joints = 3 * len(worn.joint), len(worn.skeleton.joints)
    spine = np.repeat(np.isin(np.arange(joints), worn.skeleton.indices(SPINE)), 3)
    usual = worn.offset
    for turn_deviation in np.geomspace(TURN, _FREE_TURN, _ROUNDS):
        weight = np.r_[np.full(3, 1 / ROOT**2), 1 / np.where(spine, TURN, turn_deviation) ** 2]
        rows, turn = _linearised(worn, poses, position, bones)
        pull = weight * poses.step_to(start, turn)
        with_pose = rows.poses.mT @ rows.poses
        with_pose[:, range(len(weight)), range(len(weight))] += weight
        across = rows.poses.mT @ rows.body  # (T, D, G)
        inner = np.concatenate([across, (rows.poses.mT @ rows.rest[..., None]) + pull[..., None]], axis=2)
        solved = np.linalg.solve(with_pose, inner)
        flat = rows.body.reshape(-1, rows.body.shape[-1])
        matrix = flat.T @ flat - np.tensordot(across, solved[..., :-1], axes=((0, 1), (0, 1)))
        vector = flat.T @ rows.rest.reshape(-1) - np.tensordot(across, solved[..., -1], axes=((0, 1), (0, 1)))
        matrix[range(count), range(count)] += np.repeat(1 / worn.deviation**2, 3)
        vector[:count] += ((usual - worn.offset) / worn.deviation[:, None] ** 2).reshape(-1)
        for k, (joint, *_) in enumerate(bones.pairs):
            at = slice(count + 3 * k, count + 3 * k + 3)
            matrix[at, at] += bones.information[k]
            vector[at] += bones.information[k] @ (bones.usual[joint] - worn.skeleton.rest_offset[joint])
        change = np.linalg.solve(matrix, vector)
        poses = poses.moved(solved[..., -1] - solved[..., :-1] @ change, turn)
        skeleton = bones.changed(worn.skeleton, change[count:].reshape(-1, 3))
        worn = replace(worn, skeleton=skeleton, offset=worn.offset + change[:count].reshape(-1, 3))
    joints, turn = poses.kinematics(worn.skeleton)
    off = (position - worn.place(joints, turn))[:, worn.noise == worn.noise.min()]
    return worn, float(np.sqrt(np.nanmean(off**2)))


@dataclass(frozen=True, eq=False)
class _Rows:
    """A linearised fit: a row for each coordinate of a marker in each frame, in units of its deviation."""

    poses: Array  # (T, 3 M, 3 + 3 J), by steps of the poses
    body: Array  # (T, 3 M, 3 M + 3 N), by offsets and bones
    rest: Array  # (T, 3 M), by which the markers are missed


def _linearised(worn: WornMarkers, poses: BodyPoses, position: Array, bones: _FittedBones) -> tuple[_Rows, Array]:
    """Return the rows of markers (T, M, 3), and the rotations (T, J, 3, 3) of the joints."""
    joints, turn = poses.kinematics(worn.skeleton)
    frames, markers = position.shape[:2]
    place, above = worn.place(joints, turn), worn.above
    share = (np.isfinite(position).all(axis=-1) / worn.noise)[..., None]
    by_pose = np.zeros((frames, markers, 3, 3 + 3 * joints.shape[1]))
    by_pose[..., :3] = np.eye(3)
    arms = (place[:, :, None] - joints[:, None]) * above.T[worn.joint][..., None]
    by_pose[..., 3:] = -np.moveaxis(cross_matrix(arms), 2, 3).reshape(frames, markers, 3, -1)
    by_body = np.zeros((frames, markers, 3, 3 * markers + 3 * len(bones.pairs)))
    for marker, joint in enumerate(worn.joint.tolist()):
        by_body[:, marker, :, 3 * marker : 3 * marker + 3] = turn[:, joint]
    for k, pair in enumerate(bones.pairs):
        at = slice(3 * (markers + k), 3 * (markers + k) + 3)
        for side, joint in enumerate(pair):
            moved = np.flatnonzero(above[joint, worn.joint])
            by_bone = turn[:, worn.skeleton.parents[joint]] * (_MIRROR if side else 1.0)
            by_body[:, moved, :, at] += by_bone[:, None]
    return _Rows(
        (by_pose * share[..., None]).reshape(frames, 3 * markers, -1),
        (by_body * share[..., None]).reshape(frames, 3 * markers, -1),
        (np.nan_to_num(position - place) * share).reshape(frames, -1),
    ), turn


def cross_matrix(v: Array) -> Array:
    """Return matrices (..., 3, 3) of cross products with vectors (..., 3): matrix @ u = v × u."""
    matrix = np.zeros((*v.shape, 3))
    for row, column, axis in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[..., row, column], matrix[..., column, row] = -v[..., axis], v[..., axis]
    return matrix
