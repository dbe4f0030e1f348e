"""Training sequences: a recorded clip on a body of the family, seen by noisy sensors, proportions known in part."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from bodysense.body.rotation import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_matrix,
)
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.devices.simulated.headset_camera import see_points
from bodysense.devices.simulated.inertial import ALONG as STRAPPED_ALONG
from bodysense.devices.simulated.inertial import accelerations, strapped_positions
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense_lab.completion.corpus import Corpus, between
from bodysense_lab.completion.hands import (
    RECORDED,
    TrackFingers,
    TrainingHands,
    estimated,
    generated_part,
    hand_kinematics,
    with_moved_fingers,
)
from bodysense_lab.completion.points import (
    ACCELERATED,
    BODY_POINTS,
    CONTACT,
    HAND_POINTS,
    HEAD,
    JOINTS,
    KNUCKLES,
    READ,
    SIDES,
    WRISTS,
    body_places,
    bone_parents,
    partners,
    path_from_head,
    stature,
)
from bodysense_lab.completion.postures import draw_kind, settled
from bodysense_lab.completion.sensor_draws import FINGER_KINDS, DrawnSensors, draw_fingers, draw_tracked, worn
from bodysense_lab.completion.straight_legs import straightened
from bodysense_lab.completion.training_bodies import TrainingBody, draw_body, with_other_hands
from bodysense_lab.completion.wandering import wander

_PLACES = body_places()
_PARENTS = bone_parents()
_PATH = path_from_head() - path_from_head()[0]  # from the pelvis
_KNUCKLES = [
    default_skeleton().indices([f"{side}_{finger}1" for finger in ("index", "middle", "ring", "pinky")])
    for side in SIDES
]
_SOLES = [BODY_POINTS.index(f"{side}_{part}") for side in SIDES for part in ("ankle", "foot", "toe")]
_CONTACT = [BODY.index(name) for name in CONTACT]
_MIRROR, _MIRROR_65 = partners(BODY), default_skeleton().mirror
# A foot is in contact while it is at most this far above its rest height and at most this fast; standing feet of the
# CMU recordings slide by 0.13 m/s.
_LOW, _SLOW, _HALF_WINDOW = 0.05, 0.3, 0.04  # m, m/s, s
# radians: wrists about the forearm, sideways and toward the palm: spread of the held angle, spread of the motion, and
# limit
_HELD = np.radians([40.0, 7.0, 17.0])
_MOVING = np.radians([25.0, 10.0, 25.0])
_FARTHEST = np.radians([100.0, 25.0, 60.0])
LONGEST, LONGEST_SETTLED = 15.0, 30.0  # s of a sequence, and of one in a posture that lasts
_STRAIGHT = 0.3  # share of sequences whose standing legs are straightened
_BENT = 0.45  # share of sequences whose wrists turn freely
_STRAPPED_ALONG = (0.3, 0.95)  # where along a bone a sensor is strapped
_ACCELERATION_NOISE = (0.03, 0.5)  # m/s², from and to


@dataclass(frozen=True, eq=False)
class Sequence:
    """One clip, ready to learn from. World: +Y up, the floor at y = 0."""

    true_position: np.ndarray  # (T, 25, 3) float32 m
    true_rotation: np.ndarray  # (T, 22, 4) float32 wxyz, world ← joint
    contact: np.ndarray  # (T, 4) bool
    position: np.ndarray  # (T, 27, 3) float32 m, as tracked
    rotation: np.ndarray  # (T, 22, 4) float32 wxyz, as tracked
    has_position: np.ndarray  # (T, 27) bool
    has_rotation: np.ndarray  # (T, 22) bool
    acceleration: np.ndarray  # (T, 12, 3) float32 m/s², world, of `ACCELERATED`
    has_acceleration: np.ndarray  # (T, 12) bool
    anchor: np.ndarray  # (T, 4) float32: cosine and sine of the heading, x and z of the frame under the head
    accuracy: np.ndarray  # (27,) float32 m
    rest_offset: np.ndarray  # (25, 3) float32 m, as known to the tracker
    certainty: np.ndarray  # (25,) float32 m
    size: float
    interval: float  # s
    hands: TrainingHands | None = None  # where they are learned from

    def __len__(self) -> int:
        return len(self.contact)


Track = Callable[[np.ndarray, float, np.random.Generator], DrawnSensors]
CAMERA = partial(worn, HEADSET_CAMERA)  # which stands for every device that tracks hands


@dataclass(frozen=True)
class Draw:
    """Choices that vary between sequences of one clip."""

    body: TrainingBody
    track: Track = draw_tracked
    rate: float = 30.0  # Hz
    pace: float = 1.0  # how fast the motion is played
    begin: float = 0.0  # s
    longest: float = np.inf  # s
    mirrored: bool = False
    bent: bool = False  # wrists turn freely
    posture: str | None = None  # of `postures.KINDS`; None: as recorded
    straight: float = 0.0  # how much standing legs are straightened; 1: wholly
    noisy: bool = False
    backward: bool = False  # time runs backward
    fingers: TrackFingers | None = None  # None: hands are left out
    local: np.ndarray | None = None  # (T, 2, 15, 4) wxyz, parent ← joint, of the drawn part; None: as recorded
    moved: bool = False  # fingers move at random, too


def draw_sequence(
    corpus: Corpus, clip: int, rng: np.random.Generator, settles: bool = False, backward: bool = False
) -> Sequence:
    """Draw everything that may differ about a clip of the corpus, and make its sequence.

    With `settles`, a standing person takes another posture.
    """
    posture = draw_kind(rng) if settles else None
    longest = LONGEST if posture is None else LONGEST_SETTLED
    seconds = float(corpus.length[clip] / corpus.rate[clip])
    drawn = Draw(
        body=draw_body(corpus.rest_offset[clip].astype(float), rng),
        rate=30.0 if rng.uniform() < 0.5 else float(np.exp(rng.uniform(np.log(22), np.log(60)))),
        pace=float(np.exp(rng.uniform(-0.2, 0.2))) if rng.uniform() < 0.5 else 1.0,
        begin=max(0.0, float(rng.uniform(-longest / 2, seconds - longest / 2))),
        longest=longest,
        mirrored=bool(rng.uniform() < 0.5),
        bent=bool(rng.uniform() < _BENT),
        posture=posture,
        straight=float(rng.uniform(0.3, 1.0)) if rng.uniform() < _STRAIGHT else 0.0,
        noisy=bool(rng.uniform() < 0.6),
        backward=backward,
    )
    return make_sequence(corpus, clip, drawn, rng)


def draw_hands(corpus: Corpus, clip: int, rng: np.random.Generator, generated: np.ndarray | None = None) -> Sequence:
    """Draw what may differ about a clip for its hands, whose wrists cameras see, and make its sequence.

    A clip whose fingers were not recorded moves those of some part of `generated` (N, 30, 4). No clip is mirrored: the
    network reads right hands in a mirror, so that a clip and its mirror image are the same.
    """
    seconds = float(corpus.length[clip] / corpus.rate[clip])
    drawn = Draw(
        body=with_other_hands(draw_body(corpus.rest_offset[clip].astype(float), rng), rng),
        track=CAMERA,
        rate=30.0 if rng.uniform() < 0.4 else float(np.exp(rng.uniform(np.log(22), np.log(60)))),
        begin=max(0.0, float(rng.uniform(-LONGEST / 2, seconds - LONGEST / 2))),
        longest=LONGEST,
        bent=bool(rng.uniform() < 0.35),
        noisy=bool(rng.uniform() < 0.6),
    )
    kind = str(rng.choice(list(FINGER_KINDS), p=list(FINGER_KINDS.values())))
    moved = kind in ("tracked", "random") and bool(rng.uniform() < 0.5)
    local = None
    if corpus.finger_start[clip] < 0:
        assert generated is not None
        local = generated_part(generated, len(_frames_of(corpus, clip, drawn)[0]), drawn.rate, rng)
    drawn = replace(drawn, fingers=partial(draw_fingers, kind), local=local, moved=moved)
    return make_sequence(corpus, clip, drawn, rng)


def make_sequence(corpus: Corpus, clip: int, draw: Draw, rng: np.random.Generator) -> Sequence:
    """The sequence of a clip as drawn."""
    rate, body = draw.rate, draw.body
    rotation, root, visible = _resampled(corpus, clip, draw)
    own = corpus.rest_offset[clip].astype(float)
    if draw.posture is not None:
        rotation, root = settled(rotation, root, own, draw.posture, rate, rng)
        visible = _seen(rotation, root, own)
    if draw.straight:
        rotation, root = straightened(rotation, root, own, draw.straight, rate)
    if draw.mirrored:
        rotation = rotation[:, _MIRROR] * np.array([1.0, 1.0, -1.0, -1.0])
        root, visible = root * [-1.0, 1.0, 1.0], visible[:, _MIRROR_65]
    if draw.bent:
        rotation = _with_turned_wrists(rotation, rate, rng)
    if draw.backward:
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
    tracked = draw.track(seen, 1 / rate, rng)
    position, turned, accuracy = points, rotation, np.full(points.shape[1], 0.001)
    if draw.noisy:
        accuracy = _accuracy(rng)
        radians = np.minimum(np.radians(accuracy[:JOINTS] * 200), np.radians(4.0))  # 1 mm: 0.2°, 2 cm: 4°
        position = points + _noise(points.shape, rate, rng) * accuracy[:, None] * rng.uniform(0.7, 1.3)
        turned = _shaken(rotation, radians, rate, rng)
    order = slice(None, None, -1 if draw.backward else 1)  # accelerations are measured forward in time
    felt, has_felt = (values[order] for values in _felt(true_position[order], rate, rng, draw.noisy))
    anchor = _anchor(turned[:, HEAD], position[:, HEAD], tracked.head_known, rng, rate)
    told = body.told[_PLACES]
    sequence = Sequence(
        true_position=true_position.astype(np.float32),
        true_rotation=rotation.astype(np.float32),
        contact=in_contact(true_position[:, _CONTACT], _standing(body.true)[_CONTACT], rate),
        position=position.astype(np.float32),
        rotation=turned.astype(np.float32),
        has_position=tracked.has_position,
        has_rotation=tracked.has_rotation,
        acceleration=felt.astype(np.float32),
        has_acceleration=tracked.has_acceleration & has_felt[:, None],
        anchor=anchor.astype(np.float32),
        accuracy=accuracy.astype(np.float32),
        rest_offset=told.astype(np.float32),
        certainty=body.certainty[_PLACES].astype(np.float32),
        size=float(stature(told)),
        interval=1 / rate,
    )
    if draw.fingers is None:
        return sequence
    return replace(sequence, hands=_hands(corpus, clip, draw, sequence, seen[:, -len(KNUCKLES) :], rng))


def _hands(
    corpus: Corpus, clip: int, draw: Draw, body: Sequence, visible: np.ndarray, rng: np.random.Generator
) -> TrainingHands:
    """Return the hands of a sequence, which cameras see in some frames (T, 2)."""
    assert draw.fingers is not None
    local = _recorded_fingers(corpus, clip, draw) if draw.local is None else draw.local
    if draw.moved:
        local = with_moved_fingers(local, draw.rate, rng)
    true_rotation, true_position = hand_kinematics(local, draw.body.true[HAND_POINTS])
    tracked = draw.fingers(visible, 1 / draw.rate, rng)
    true_wrist, true_place = body.true_rotation[:, WRISTS].astype(float), body.true_position[:, WRISTS].astype(float)
    wrist, place = estimated(true_wrist, true_place, draw.rate, rng)
    wrist = np.where(tracked.has_wrist[..., None], body.rotation[:, WRISTS], wrist)
    place = np.where(tracked.has_wrist[..., None], body.position[:, WRISTS], place)

    # The graph reads fingers in the frame of the tracked wrist, so convert to the world first, then to that frame.
    position = quaternion_rotate(true_wrist[:, :, None], true_position) + true_place[:, :, None]
    rotation = quaternion_multiply(true_wrist[:, :, None], true_rotation)
    if draw.noisy:
        accuracy = np.array(np.exp(rng.uniform(np.log(0.001), np.log(0.012))))  # m; 1 mm: 0.7°, 1 cm: 7°
        position = position + _noise(position.shape, draw.rate, rng) * accuracy
        rotation = _shaken(rotation, np.radians(accuracy * 700), draw.rate, rng)
    into = quaternion_conjugate(wrist)[:, :, None]
    moving = np.diff(place, axis=0, prepend=place[:1]) * draw.rate
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
        "rest_offset": draw.body.told[HAND_POINTS],
    }
    return TrainingHands(
        **{name: np.asarray(value, dtype=np.float32) for name, value in values.items()},
        has_position=tracked.has_position & tracked.has_wrist[..., None],
        has_rotation=tracked.has_rotation,
    )


def _resampled(corpus: Corpus, clip: int, draw: Draw) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """World rotations (T, 22, 4), the root's path (T, 3) and visibility (T, 65) of the part of a clip that is drawn."""
    first = int(corpus.start[clip])
    low, high, share = _frames_of(corpus, clip, draw)
    mixed = between(corpus.rotation[first + low], corpus.rotation[first + high], share)
    root = corpus.root[first + low] * (1 - share[:, None]) + corpus.root[first + high] * share[:, None]
    return mixed, root, corpus.visible[first + low]


def _recorded_fingers(corpus: Corpus, clip: int, draw: Draw) -> np.ndarray:
    """Local rotations (T, 2, 15, 4) of the part of a clip that is drawn, in the order of its frames."""
    low, high, share = _frames_of(corpus, clip, draw)
    first = int(corpus.finger_start[clip])
    hands = between(corpus.fingers[first + low], corpus.fingers[first + high], share)[:, RECORDED]
    if draw.mirrored:
        hands = hands[:, ::-1] * np.array([1.0, 1.0, -1.0, -1.0])
    return hands[::-1] if draw.backward else hands


def _frames_of(corpus: Corpus, clip: int, draw: Draw) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames (T,) of a clip before and after each frame of its sequence, and the share (T,) of the latter."""
    count, own = int(corpus.length[clip]), float(corpus.rate[clip]) * draw.pace
    begin = min(draw.begin * own, max(0.0, count - 1 - 2 * own))
    end = min(count - 1, begin + draw.longest * own)
    place = np.arange(begin, end + 1e-6, own / draw.rate)
    low = np.minimum(place.astype(int), count - 1)
    return low, np.minimum(low + 1, count - 1), place - low


def _retargeted(
    rotation: np.ndarray, root: np.ndarray, own: np.ndarray, other: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T, 25, 3) of the motion on another body, and matrices (T, 22, 3, 3): the twin of `body.retarget`."""
    matrix = quaternion_to_matrix(rotation)
    carrying = matrix[:, _PARENTS]

    def placed(offset: np.ndarray) -> np.ndarray:
        return _PATH @ (carrying @ offset[_PLACES][1:, :, None])[..., 0]

    if other is own:
        return placed(own) + root[:, None], matrix
    before, after = placed(own) + root[:, None], placed(other)
    legs = other[0, 1] / own[0, 1]
    clearance = (before[:, _SOLES, 1] - _standing(own)[_SOLES]).min(axis=1) * legs
    moved = after + (root * legs)[:, None]
    lift = clearance - (moved[:, _SOLES, 1] - _standing(other)[_SOLES]).min(axis=1)
    moved[..., 1] += lift[:, None]
    return moved, matrix


def _standing(offset: np.ndarray) -> np.ndarray:
    """(25,) m: how high the points rest above the floor."""
    return (default_skeleton().path @ offset)[_PLACES, 1] + offset[0, 1]


def in_contact(feet: np.ndarray, standing: np.ndarray, rate: float) -> np.ndarray:
    """(T, 4) bool: whether ankles and balls of the feet (T, 4, 3) m stand, which rest `standing` (4,) m high."""
    reach = max(1, round(_HALF_WINDOW * rate))
    place = np.arange(len(feet))
    before, after = np.maximum(place - reach, 0), np.minimum(place + reach, len(feet) - 1)
    time = np.maximum(after - before, 1)[:, None] / rate
    speed = np.linalg.norm(feet[after] - feet[before], axis=-1) / time
    return (feet[..., 1] < standing + _LOW) & (speed < _SLOW)


def _with_turned_wrists(rotation: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Wrists that turn freely: about the forearm, as palms are held down, inward or up, and across it.

    Only the wrists change; arms and recorded bending stay.
    """
    held = rng.normal(0, 1, (2, 3)) * _HELD
    if rng.uniform() < 0.5:  # both hands alike
        held[1] = held[0] * [1, -1, -1]
    moving = wander(len(rotation), 2 * 3, rate, float(rng.uniform(0.4, 2.5)), rng).reshape(-1, 2, 3) * _MOVING
    bend = np.clip(held + moving * rng.uniform(0.2, 1.0), -_FARTHEST, _FARTHEST)
    twist = quaternion_exp(bend * [1.0, 0.0, 0.0])
    turned = rotation.copy()
    across = quaternion_exp(bend * [0.0, 1.0, 1.0])
    turned[:, WRISTS] = quaternion_multiply(quaternion_multiply(rotation[:, WRISTS], twist), across)
    return turned


def _seen(rotation: np.ndarray, root: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """(T, 65) bool: what a headset's cameras see of a body with straight fingers."""
    skeleton = default_skeleton().with_offsets(offset)
    count = len(skeleton.joints)
    carriers = np.where(np.arange(count) < len(BODY), np.arange(count), skeleton.wrist_of[:count])
    world = rotation[:, carriers]
    bones = quaternion_rotate(world[:, [max(parent, 0) for parent in skeleton.parents]], offset)
    bones[:, 0] = 0.0
    return see_points(skeleton, skeleton.path @ bones + root[:, None], world).visible


def _felt(points: np.ndarray, rate: float, rng: np.random.Generator, noisy: bool) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations (T, 12, 3) m/s² of sensors strapped to a body of points (T, 25, 3), and from when (T,) bool."""
    along = rng.uniform(*_STRAPPED_ALONG, len(ACCELERATED)) if noisy else np.full(len(ACCELERATED), STRAPPED_ALONG)
    felt, known = accelerations(strapped_positions(points, BODY_POINTS, along), 1 / rate)
    if noisy:
        shape = felt.shape
        felt = felt + np.exp(rng.uniform(*np.log(_ACCELERATION_NOISE))) * rng.standard_normal(shape)
        felt += 0.15 * rng.standard_normal(shape[1:])
    return felt, known


def _accuracy(rng: np.random.Generator) -> np.ndarray:
    """Draw accuracies (27,) m of the body's trackers."""
    accuracy = np.exp(rng.uniform(np.log(0.002), np.log(0.025), READ))
    accuracy[HEAD] = 0.001
    if rng.uniform() < 0.5:
        accuracy[WRISTS] = 0.002
    return accuracy


def _noise(shape: tuple[int, ...], rate: float, rng: np.random.Generator) -> np.ndarray:
    """Return errors (T, ..., 3) of trackers of accuracy 1: constant ones, drift and tremor."""
    drift = wander(shape[0], math.prod(shape[1:]), rate, 1.0, rng).reshape(shape) * 0.4
    drift += rng.standard_normal(shape[1:]) * 0.4
    return drift + rng.standard_normal(shape) * (0.15 if rng.uniform() < 0.3 else 0.02)


def _shaken(rotation: np.ndarray, radians: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Return rotations (T, ..., 4) that drift; `radians` (...) scale how far."""
    shape = (*rotation.shape[:-1], 3)
    turns = wander(shape[0], math.prod(shape[1:]), rate, 1.0, rng).reshape(shape) * radians[..., None] * 0.6
    return quaternion_multiply(quaternion_exp(turns), rotation)


def _anchor(
    head: np.ndarray, place: np.ndarray, known: np.ndarray, rng: np.random.Generator, rate: float
) -> np.ndarray:
    """The frame under the head (T, 4); where the head is not tracked, one that errs as an estimate of it does."""
    twist = np.stack([head[:, 0] ** 2 - head[:, 2] ** 2, 2 * head[:, 0] * head[:, 2]], axis=-1)
    angle = np.arctan2(twist[:, 1], twist[:, 0])
    where = place[:, [0, 2]].astype(float)
    if not known.all():
        error = wander(len(head), 3, rate, 2.0, rng) * [np.radians(12.0), 0.04, 0.04]
        angle = np.where(known, angle, angle + error[:, 0])
        where = np.where(known[:, None], where, where + error[:, 1:])
    return np.column_stack([np.cos(angle), np.sin(angle), where])
