"""Training sequences: a recorded clip on a random body, tracked by noisy sensors, with partly known proportions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.devices.simulated.headset_camera import see_points
from bodysense.devices.simulated.inertial import ALONG as STRAPPED_ALONG
from bodysense.devices.simulated.inertial import accelerations, strapped_positions
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.geometry.rotation import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_matrix,
)
from bodysense_lab.completion.data.corpus import Corpus, interpolate
from bodysense_lab.completion.data.hands import (
    RECORDED,
    DrawFingers,
    TrainingHands,
    hand_kinematics,
    with_finger_noise,
    with_wrist_error,
)
from bodysense_lab.completion.data.points import (
    ACCELERATION_POINTS,
    BODY_POINTS,
    CONTACT,
    HAND_POINTS,
    HEAD,
    INPUT_POINT_COUNT,
    JOINTS,
    KNUCKLES,
    SIDES,
    WRISTS,
    body_indices,
    bone_parents,
    partners,
    path_from_head,
    stature,
)
from bodysense_lab.completion.data.postures.postures import apply_posture
from bodysense_lab.completion.data.postures.straight_legs import straightened
from bodysense_lab.completion.data.postures.upright import set_upright
from bodysense_lab.completion.data.sensor_draws import (
    SensorMasks,
    draw_sensors,
    fixed_sensors,
)
from bodysense_lab.completion.data.smooth_noise import smooth_noise
from bodysense_lab.completion.data.training_bodies import TrainingBody

_PLACES = body_indices()
_PARENTS = bone_parents()
_PATH = path_from_head() - path_from_head()[0]  # relative to the pelvis
_KNUCKLES = [
    default_skeleton().indices([f"{side}_{finger}1" for finger in ("index", "middle", "ring", "pinky")])
    for side in SIDES
]
_SOLES = [BODY_POINTS.index(f"{side}_{part}") for side in SIDES for part in ("ankle", "foot", "toe")]
_CONTACT = [BODY.index(name) for name in CONTACT]
PELVIS = BODY.index("pelvis")
_LINES = [[BODY.index(f"{side}_{part}") for side in SIDES] for part in ("hip", "shoulder", "ankle")]
_SHORTEST_LINE = 0.1  # m; shorter lines from right to left points give no heading, as in the core
_MIRROR, _MIRROR_65 = partners(BODY), default_skeleton().mirror
# Contact of a foot: largest height over rest, largest speed, and half the window of the speed. Standing feet
# in the CMU recordings slide at 0.13 m/s.
_LOW, _SLOW, _HALF_WINDOW = 0.05, 0.3, 0.04  # m, m/s, s
# Angles of wrists about the forearm, sideways and toward the palm, radians: deviation of the constant part, deviation
# of the motion, and limit.
_HELD_ANGLE = np.radians([40.0, 7.0, 17.0])
_MOVING_ANGLE = np.radians([25.0, 10.0, 25.0])
_ANGLE_LIMIT = np.radians([100.0, 25.0, 60.0])
_STRAPPED_ALONG = (0.3, 0.95)  # position of a strapped sensor along its bone, from and to
_ACCELERATION_NOISE = (0.03, 0.5)  # m/s², standard deviation, from and to, log-uniform


@dataclass(frozen=True, eq=False)
class Sequence:
    """A clip as training data. World: +Y up, the floor at y = 0."""

    true_position: np.ndarray  # (T, 25, 3) float32 m
    true_rotation: np.ndarray  # (T, 22, 4) float32 wxyz, world ← joint
    contact: np.ndarray  # (T, 4) bool
    position: np.ndarray  # (T, 27, 3) float32 m, as tracked
    rotation: np.ndarray  # (T, 22, 4) float32 wxyz, as tracked
    has_position: np.ndarray  # (T, 27) bool
    has_rotation: np.ndarray  # (T, 22) bool
    acceleration: np.ndarray  # (T, 12, 3) float32 m/s², world, of `ACCELERATION_POINTS`
    has_acceleration: np.ndarray  # (T, 12) bool
    anchor: np.ndarray  # (T, 4) float32: the frame under the head; cosine and sine of its heading, x and z
    accuracy: np.ndarray  # (27,) float32 m
    rest_offset: np.ndarray  # (25, 3) float32 m, as known to the tracker
    certainty: np.ndarray  # (25,) float32 m, standard deviation of the known bone lengths
    size: float  # known stature divided by the reference stature
    interval: float  # s
    hands: TrainingHands | None = None  # None: not used

    def __len__(self) -> int:
        return len(self.contact)


DrawSensors = Callable[[np.ndarray, float, np.random.Generator], SensorMasks]
CAMERA = partial(fixed_sensors, HEADSET_CAMERA)  # stands for any device that tracks hands


@dataclass(frozen=True)
class SequenceAugmentation:
    """Augmentation of a clip: its body, sensors, time, posture and noise."""

    body: TrainingBody
    sensors: DrawSensors = draw_sensors
    rate: float = 30.0  # Hz
    pace: float = 1.0  # factor of the playback speed
    begin: float = 0.0  # s of the clip
    longest: float = np.inf  # s of the clip
    mirrored: bool = False
    free_wrists: bool = False  # wrists turn freely
    posture: str | None = None  # of `postures.KINDS`; None: as recorded
    straightening: float = 0.0  # share by which standing legs are straightened; 1: fully
    stance_shift: float = 0.0  # m by which the pelvis of a standing body moves forward (`upright`)
    noisy: bool = False
    backward: bool = False  # time runs backward
    fingers: DrawFingers | None = None  # None: hands are left out
    finger_noise: bool = False  # fingers have random motion in addition


def make_sequence(corpus: Corpus, clip: int, augmentation: SequenceAugmentation, rng: np.random.Generator) -> Sequence:
    """Make the sequence of a clip with an augmentation; `rng` draws noise and masks."""
    rate, body = augmentation.rate, augmentation.body
    rotation, root, visible = _resampled(corpus, clip, augmentation)
    own = corpus.rest_offset[clip].astype(float)
    if augmentation.posture is not None:
        rotation, root = apply_posture(rotation, root, own, augmentation.posture, rate, rng)
        visible = visible_points(rotation, root, own)
    if augmentation.stance_shift:
        feet = _retargeted(rotation, root, own, own)[0][:, _CONTACT]
        contact = in_contact(feet, _rest_heights(own)[_CONTACT], rate)
        rotation, root = set_upright(
            rotation, root, own, augmentation.stance_shift, contact[:, :2] & contact[:, 2:], rate
        )
    if augmentation.straightening:
        rotation, root = straightened(rotation, root, own, augmentation.straightening, rate)
    if augmentation.mirrored:
        rotation = rotation[:, _MIRROR] * np.array([1.0, 1.0, -1.0, -1.0])
        root, visible = root * [-1.0, 1.0, 1.0], visible[:, _MIRROR_65]
    if augmentation.free_wrists:
        rotation = _with_turned_wrists(rotation, rate, rng)
    if augmentation.backward:
        rotation, root, visible = rotation[::-1], root[::-1], visible[::-1]
    true_position, matrix = _retargeted(rotation, root, own, body.true)
    knuckles = np.stack(
        [
            true_position[:, wrist] + matrix[:, wrist] @ body.true[places].mean(axis=0)
            for wrist, places in zip(WRISTS, _KNUCKLES, strict=True)
        ],
        axis=1,
    )
    points = np.concatenate([true_position, knuckles], axis=1)
    seen = np.concatenate([visible[:, _PLACES], visible[:, [places[0] for places in _KNUCKLES]]], axis=1)
    tracked = augmentation.sensors(seen, 1 / rate, rng)
    position, turned, accuracy = points, rotation, np.full(points.shape[1], 0.001)
    if augmentation.noisy:
        accuracy = _accuracy(rng)
        radians = np.minimum(np.radians(accuracy[:JOINTS] * 200), np.radians(4.0))  # 1 mm: 0.2°, 2 cm: 4°
        position = points + _position_noise(points.shape, rate, rng) * accuracy[:, None] * rng.uniform(0.7, 1.3)
        turned = _with_rotation_noise(rotation, radians, rate, rng)
    order = slice(None, None, -1 if augmentation.backward else 1)  # accelerations are measured forward in time
    acceleration, is_known = (
        values[order] for values in _accelerations(true_position[order], rate, rng, augmentation.noisy)
    )
    anchor = _head_frame(turned, position, tracked, rng, rate)
    known = body.known[_PLACES]
    sequence = Sequence(
        true_position=true_position.astype(np.float32),
        true_rotation=rotation.astype(np.float32),
        contact=in_contact(true_position[:, _CONTACT], _rest_heights(body.true)[_CONTACT], rate),
        position=position.astype(np.float32),
        rotation=turned.astype(np.float32),
        has_position=tracked.has_position,
        has_rotation=tracked.has_rotation,
        acceleration=acceleration.astype(np.float32),
        has_acceleration=tracked.has_acceleration & is_known[:, None],
        anchor=anchor.astype(np.float32),
        accuracy=accuracy.astype(np.float32),
        rest_offset=known.astype(np.float32),
        certainty=body.certainty[_PLACES].astype(np.float32),
        size=float(stature(known)),
        interval=1 / rate,
    )
    if augmentation.fingers is None:
        return sequence
    return replace(sequence, hands=_hands(corpus, clip, augmentation, sequence, seen[:, -len(KNUCKLES) :], rng))


def _hands(
    corpus: Corpus,
    clip: int,
    augmentation: SequenceAugmentation,
    body: Sequence,
    visible: np.ndarray,
    rng: np.random.Generator,
) -> TrainingHands:
    """Return the hands of a sequence; `visible` (T, 2) are frames in which cameras see them."""
    assert augmentation.fingers is not None
    local = _recorded_fingers(corpus, clip, augmentation)
    if augmentation.finger_noise:
        local = with_finger_noise(local, augmentation.rate, rng)
    true_rotation, true_position = hand_kinematics(local, augmentation.body.true[HAND_POINTS])
    tracked = augmentation.fingers(visible, 1 / augmentation.rate, rng)
    true_wrist, true_place = body.true_rotation[:, WRISTS].astype(float), body.true_position[:, WRISTS].astype(float)
    wrist, place = with_wrist_error(true_wrist, true_place, augmentation.rate, rng)
    wrist = np.where(tracked.has_wrist[..., None], body.rotation[:, WRISTS], wrist)
    place = np.where(tracked.has_wrist[..., None], body.position[:, WRISTS], place)

    # The network reads fingers in the frame of the tracked wrist, so convert to the world first, then to that frame.
    position = quaternion_rotate(true_wrist[:, :, None], true_position) + true_place[:, :, None]
    rotation = quaternion_multiply(true_wrist[:, :, None], true_rotation)
    if augmentation.noisy:
        accuracy = np.array(np.exp(rng.uniform(np.log(0.001), np.log(0.012))))  # m; 1 mm: 0.7°, 1 cm: 7°
        position = position + _position_noise(position.shape, augmentation.rate, rng) * accuracy
        rotation = _with_rotation_noise(rotation, np.radians(accuracy * 700), augmentation.rate, rng)
    into = quaternion_conjugate(wrist)[:, :, None]
    moving = np.diff(place, axis=0, prepend=place[:1]) * augmentation.rate
    angle = np.arctan2(body.anchor[:, 1], body.anchor[:, 0])
    turn = quaternion_exp(angle[:, None, None] * [0.0, -1.0, 0.0])  # frame under the head ← world
    values = {
        "true_position": true_position,
        "true_rotation": true_rotation,
        "position": quaternion_rotate(into, position - place[:, :, None]),
        "rotation": quaternion_multiply(into, rotation),
        "wrist": quaternion_rotate(turn, place - body.position[:, HEAD : HEAD + 1]),
        "wrist_rotation": quaternion_multiply(turn, wrist),
        "wrist_velocity": quaternion_rotate(turn, np.clip(moving, -5, 5)),
        "rest_offset": augmentation.body.known[HAND_POINTS],
    }
    return TrainingHands(
        **{name: np.asarray(value, dtype=np.float32) for name, value in values.items()},
        has_position=tracked.has_position & tracked.has_wrist[..., None],
        has_rotation=tracked.has_rotation,
    )


def _resampled(
    corpus: Corpus, clip: int, augmentation: SequenceAugmentation
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return world rotations (T, 22, 4), root positions (T, 3) m and visibility (T, 65) of the part of a clip."""
    first = int(corpus.start[clip])
    low, high, share = _frames_of(corpus, clip, augmentation)
    mixed = interpolate(corpus.rotation[first + low], corpus.rotation[first + high], share)
    root = corpus.root[first + low] * (1 - share[:, None]) + corpus.root[first + high] * share[:, None]
    return mixed, root, corpus.visible[first + low]


def _recorded_fingers(corpus: Corpus, clip: int, augmentation: SequenceAugmentation) -> np.ndarray:
    """Return local finger rotations (T, 2, 15, 4) of the part of a clip."""
    low, high, share = _frames_of(corpus, clip, augmentation)
    first = int(corpus.finger_start[clip])
    hands = interpolate(corpus.fingers[first + low], corpus.fingers[first + high], share)[:, RECORDED]
    if augmentation.mirrored:
        hands = hands[:, ::-1] * np.array([1.0, 1.0, -1.0, -1.0])
    return hands[::-1] if augmentation.backward else hands


def _frames_of(
    corpus: Corpus, clip: int, augmentation: SequenceAugmentation
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the clip's frames (T,) before and after each frame of its sequence, and the weight (T,) of the latter."""
    count, own = int(corpus.length[clip]), float(corpus.rate[clip]) * augmentation.pace
    begin = min(augmentation.begin * own, max(0.0, count - 1 - 2 * own))
    end = min(count - 1, begin + augmentation.longest * own)
    place = np.arange(begin, end + 1e-6, own / augmentation.rate)
    low = np.minimum(place.astype(int), count - 1)
    return low, np.minimum(low + 1, count - 1), place - low


def _retargeted(
    rotation: np.ndarray, root: np.ndarray, own: np.ndarray, other: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (T, 25, 3) m of the motion on another body, and matrices (T, 22, 3, 3), as `body.retarget`."""
    matrix = quaternion_to_matrix(rotation)
    carrying = matrix[:, _PARENTS]

    def from_pelvis(offset: np.ndarray) -> np.ndarray:
        return _PATH @ (carrying @ offset[_PLACES][1:, :, None])[..., 0]

    if other is own:
        return from_pelvis(own) + root[:, None], matrix
    before, after = from_pelvis(own) + root[:, None], from_pelvis(other)
    legs = other[0, 1] / own[0, 1]
    clearance = (before[:, _SOLES, 1] - _rest_heights(own)[_SOLES]).min(axis=1) * legs
    position = after + (root * legs)[:, None]
    lift = clearance - (position[:, _SOLES, 1] - _rest_heights(other)[_SOLES]).min(axis=1)
    position[..., 1] += lift[:, None]
    return position, matrix


def _rest_heights(offset: np.ndarray) -> np.ndarray:
    """Return heights (25,) m of the points over the floor in the rest pose."""
    return (default_skeleton().path @ offset)[_PLACES, 1] + offset[0, 1]


def in_contact(feet: np.ndarray, standing: np.ndarray, rate: float) -> np.ndarray:
    """Return (T, 4) bool: contact of ankles and balls of the feet (T, 4, 3) m, with rest heights `standing` (4,) m."""
    reach = max(1, round(_HALF_WINDOW * rate))
    place = np.arange(len(feet))
    before, after = np.maximum(place - reach, 0), np.minimum(place + reach, len(feet) - 1)
    time = np.maximum(after - before, 1)[:, None] / rate
    speed = np.linalg.norm(feet[after] - feet[before], axis=-1) / time
    return (feet[..., 1] < standing + _LOW) & (speed < _SLOW)


def _with_turned_wrists(rotation: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Turn the wrists about the forearm (palms down, inward or up) and across it.

    Arms are unchanged; recorded bending of the wrists remains.
    """
    held = rng.normal(0, 1, (2, 3)) * _HELD_ANGLE
    if rng.uniform() < 0.5:  # both hands alike
        held[1] = held[0] * [1, -1, -1]
    moving = (
        smooth_noise(len(rotation), 2 * 3, rate, float(rng.uniform(0.4, 2.5)), rng).reshape(-1, 2, 3) * _MOVING_ANGLE
    )
    bend = np.clip(held + moving * rng.uniform(0.2, 1.0), -_ANGLE_LIMIT, _ANGLE_LIMIT)
    twist = quaternion_exp(bend * [1.0, 0.0, 0.0])
    turned = rotation.copy()
    across = quaternion_exp(bend * [0.0, 1.0, 1.0])
    turned[:, WRISTS] = quaternion_multiply(quaternion_multiply(rotation[:, WRISTS], twist), across)
    return turned


def visible_points(rotation: np.ndarray, root: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Return (T, 65) bool: points that a headset's cameras see of a body with straight fingers."""
    skeleton = default_skeleton().with_offsets(offset)
    count = len(skeleton.joints)
    carriers = np.where(np.arange(count) < len(BODY), np.arange(count), skeleton.wrist_of[:count])
    world = rotation[:, carriers]
    bones = quaternion_rotate(world[:, [max(parent, 0) for parent in skeleton.parents]], offset)
    bones[:, 0] = 0.0
    return see_points(skeleton, skeleton.path @ bones + root[:, None], world).visible


def _accelerations(
    points: np.ndarray, rate: float, rng: np.random.Generator, noisy: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return accelerations (T, 12, 3) m/s² of strapped sensors on points (T, 25, 3) m, and valid frames (T,), bool."""
    along = (
        rng.uniform(*_STRAPPED_ALONG, len(ACCELERATION_POINTS))
        if noisy
        else np.full(len(ACCELERATION_POINTS), STRAPPED_ALONG)
    )
    acceleration, known = accelerations(strapped_positions(points, BODY_POINTS, along), 1 / rate)
    if noisy:
        shape = acceleration.shape
        acceleration = acceleration + np.exp(rng.uniform(*np.log(_ACCELERATION_NOISE))) * rng.standard_normal(shape)
        acceleration += 0.15 * rng.standard_normal(shape[1:])
    return acceleration, known


def _accuracy(rng: np.random.Generator) -> np.ndarray:
    """Draw the accuracies (27,) m of tracked points."""
    accuracy = np.exp(rng.uniform(np.log(0.002), np.log(0.025), INPUT_POINT_COUNT))
    accuracy[HEAD] = 0.001
    if rng.uniform() < 0.5:
        accuracy[WRISTS] = 0.002
    return accuracy


def _position_noise(shape: tuple[int, ...], rate: float, rng: np.random.Generator) -> np.ndarray:
    """Draw errors (T, ..., 3) of trackers with accuracy 1: offset, drift and tremor."""
    drift = smooth_noise(shape[0], math.prod(shape[1:]), rate, 1.0, rng).reshape(shape) * 0.4
    drift += rng.standard_normal(shape[1:]) * 0.4
    return drift + rng.standard_normal(shape) * (0.15 if rng.uniform() < 0.3 else 0.02)


def _with_rotation_noise(
    rotation: np.ndarray, radians: np.ndarray, rate: float, rng: np.random.Generator
) -> np.ndarray:
    """Add smooth random drift to rotations (T, ..., 4); `radians` (...) scale it."""
    shape = (*rotation.shape[:-1], 3)
    turns = smooth_noise(shape[0], math.prod(shape[1:]), rate, 1.0, rng).reshape(shape) * radians[..., None] * 0.6
    return quaternion_multiply(quaternion_exp(turns), rotation)


def _head_frame(
    rotation: np.ndarray, position: np.ndarray, tracked: SensorMasks, rng: np.random.Generator, rate: float
) -> np.ndarray:
    """Return the frame under the head (T, 4), found as the core finds it.

    Its heading is that of the head's rotation, or else the pelvis's, or else that of lines from right to left points.
    In other frames it has the errors of an estimate, and so has the position of a head that is not tracked.
    """
    error = smooth_noise(len(rotation), 3, rate, 2.0, rng) * [np.radians(12.0), 0.04, 0.04]
    axis = _heading_axis(rotation[:, HEAD])
    angle = np.arctan2(axis[:, 1], axis[:, 0]) + error[:, 0]
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    line = np.zeros((len(rotation), 3))
    for left, right in _LINES:
        both = (tracked.has_position[:, left] & tracked.has_position[:, right])[:, None]
        line += np.where(both, position[:, left] - position[:, right], 0.0)
    lines = np.stack([line[:, 0], -line[:, 2]], axis=-1)
    direction = np.where((np.linalg.norm(lines, axis=-1) > _SHORTEST_LINE)[:, None], lines, direction)
    for joint in (PELVIS, HEAD):
        direction = np.where(tracked.has_rotation[:, [joint]], _heading_axis(rotation[:, joint]), direction)
    angle = np.arctan2(direction[:, 1], direction[:, 0])
    where = position[:, HEAD][:, [0, 2]].astype(float)
    where = np.where(tracked.has_position[:, [HEAD]], where, where + error[:, 1:])
    return np.column_stack([np.cos(angle), np.sin(angle), where])


def _heading_axis(rotation: np.ndarray) -> np.ndarray:
    """Return cosine and sine (T, 2), not normalised, of the heading of rotations (T, 4) wxyz."""
    return np.stack([rotation[:, 0] ** 2 - rotation[:, 2] ** 2, 2 * rotation[:, 0] * rotation[:, 2]], axis=-1)
