"""Training sequences: a recorded clip on a body of the family, seen by noisy sensors, proportions known in part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bodysense.body.rotation import (
    quaternion_canonical,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_matrix,
)
from bodysense.body.shape import Measured, shape_space
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.devices.simulated.headset_camera import see_points
from bodysense.devices.simulated.inertial import ALONG as STRAPPED_ALONG
from bodysense.devices.simulated.inertial import accelerations, strapped_places
from bodysense_lab.completion.corpus import Corpus
from bodysense_lab.completion.points import (
    ACCELERATED,
    BODY_POINTS,
    CONTACT,
    HEAD,
    JOINTS,
    body_places,
    bone_parents,
    partners,
    path_from_head,
    stature,
)
from bodysense_lab.completion.postures import draw_kind, settled
from bodysense_lab.completion.sensor_draws import DrawnSensors, draw_tracked
from bodysense_lab.completion.straight_legs import straightened
from bodysense_lab.completion.wandering import wander

_PLACES = body_places()
_PARENTS = bone_parents()
_PATH = path_from_head() - path_from_head()[0]  # from the pelvis
_KNUCKLES = [
    default_skeleton().indices([f"{side}_{finger}1" for finger in ("index", "middle", "ring", "pinky")])
    for side in ("left", "right")
]
_WRISTS = [BODY.index("left_wrist"), BODY.index("right_wrist")]
_SOLES = [BODY_POINTS.index(f"{side}_{part}") for side in ("left", "right") for part in ("ankle", "foot", "toe")]
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
# Distances that sensors measure while they run.
LENGTHS = (
    ("left_shoulder", "left_elbow"),
    ("left_elbow", "left_wrist"),
    ("left_hip", "left_knee"),
    ("left_knee", "left_ankle"),
    ("left_hip", "left_ankle"),
    ("left_shoulder", "right_shoulder"),
    ("left_hip", "right_hip"),
    ("pelvis", "head"),
)
LONGEST, LONGEST_SETTLED = 15.0, 30.0  # s of a sequence, and of one in a posture that lasts
_STRAIGHT = 0.3  # share of sequences whose standing legs are straightened
_BENT = 0.45  # share of sequences whose wrists turn freely
_STRAPPED_ALONG = (0.3, 0.95)  # where along a bone a sensor is strapped
_ACCELERATION_NOISE = (0.03, 0.5)  # m/s², from and to
_OWN, _BETWEEN = 0.2, 0.3  # shares of sequences on the recording's own body, and on one between it and a family's


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

    def __len__(self) -> int:
        return len(self.contact)


@dataclass(frozen=True)
class TrainingBody:
    """Rest offsets of a body (65, 3) m: the true ones, and those known to the tracker."""

    true: np.ndarray
    told: np.ndarray
    certainty: np.ndarray  # (65,) m


def draw_body(own: np.ndarray, rng: np.random.Generator) -> TrainingBody:
    """Draw proportions: the recording's own, a body of the family, or one between; known, known in part, or unknown."""
    space = shape_space()
    drawn = rng.uniform()
    true = own.copy()
    if drawn >= _OWN:
        true = space.offsets(np.clip(rng.standard_normal(len(space.components)), -2.5, 2.5))
        if drawn < _OWN + _BETWEEN:
            share = rng.uniform(-0.2, 1.0)
            true = share * own + (1 - share) * true * (_height(own) / _height(true))
        true = _jittered(true, rng)
    return TrainingBody(true, *_told(true, rng))


def _told(true: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw what is known of a body: all of it, its height, a guess of the height, or some lengths too."""
    drawn = rng.uniform()
    if drawn < 0.55:
        return true, np.zeros(len(true))
    height, lengths = _height(true), {}
    if drawn < 0.78:
        measured = Measured(height, 0.005)
    elif drawn < 0.9:
        measured = Measured(height * (1 + rng.normal(0, 0.035)), 0.06)
    else:
        measured = Measured(height * (1 + rng.normal(0, 0.015)), 0.03)
        place = default_skeleton().path @ true
        for pair in LENGTHS:
            if rng.uniform() < 0.5:
                a, b = default_skeleton().indices(pair)
                lengths[pair] = Measured(float(np.linalg.norm(place[a] - place[b])) * (1 + rng.normal(0, 0.01)), 0.01)
    likeliest = shape_space().likeliest(lengths, measured)
    return shape_space().offsets(likeliest.coefficients), likeliest.bone_deviation


def _jittered(offset: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Offsets whose directions and lengths differ a little, alike on both sides."""
    turn = quaternion_exp(rng.normal(0, np.radians(2.5), (len(offset), 3)))
    scale = np.exp(rng.normal(0, 0.03, (len(offset), 1)))
    changed = quaternion_rotate(turn, offset) * scale
    mirrored = changed[_MIRROR_65] * np.array([-1.0, 1.0, 1.0])
    # The left point of each pair decides; points of the middle stay in the middle.
    left = np.array([name.startswith("left_") for name in default_skeleton().points])[:, None]
    right = np.array([name.startswith("right_") for name in default_skeleton().points])[:, None]
    changed = np.where(left, changed, np.where(right, mirrored, (changed + mirrored) / 2))
    path = default_skeleton().path  # leaves out the root's own offset
    sunk = (path @ offset)[:, 1].min() - (path @ changed)[:, 1].min()
    changed[0] = offset[0] + [0.0, sunk, 0.0]
    return changed


def _height(offset: np.ndarray) -> float:
    return float(np.ptp((default_skeleton().path @ offset)[:, 1]))


Track = Callable[[np.ndarray, float, np.random.Generator], DrawnSensors]


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
            for wrist, places in zip(_WRISTS, _KNUCKLES, strict=True)
        ],
        axis=1,
    )
    points = np.concatenate([true_position, knuckles], axis=1)
    seen = np.concatenate([visible[:, _PLACES], visible[:, [places[0] for places in _KNUCKLES]]], axis=1)
    tracked = draw.track(seen, 1 / rate, rng)
    position, turned, accuracy = points, rotation, np.full(points.shape[1], 0.001)
    if draw.noisy:
        position, turned, accuracy = _disturbed(points, rotation, rate, rng)
    order = slice(None, None, -1 if draw.backward else 1)  # accelerations are measured forward in time
    felt, has_felt = (values[order] for values in _felt(true_position[order], rate, rng, draw.noisy))
    anchor = _anchor(turned[:, HEAD], position[:, HEAD], tracked.head_known, rng, rate)
    told = body.told[_PLACES]
    return Sequence(
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


def _resampled(corpus: Corpus, clip: int, draw: Draw) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """World rotations (T, 22, 4), the root's path (T, 3) and visibility (T, 65) of the part of a clip that is drawn."""
    first = int(corpus.start[clip])
    low, high, share = frames_of(corpus, clip, draw)
    mixed = between(corpus.rotation[first + low], corpus.rotation[first + high], share)
    root = corpus.root[first + low] * (1 - share[:, None]) + corpus.root[first + high] * share[:, None]
    return mixed, root, corpus.visible[first + low]


def frames_of(corpus: Corpus, clip: int, draw: Draw) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames (T,) of a clip before and after each frame of its sequence, and the share (T,) of the latter."""
    count, own = int(corpus.length[clip]), float(corpus.rate[clip]) * draw.pace
    begin = min(draw.begin * own, max(0.0, count - 1 - 2 * own))
    end = min(count - 1, begin + draw.longest * own)
    place = np.arange(begin, end + 1e-6, own / draw.rate)
    low = np.minimum(place.astype(int), count - 1)
    return low, np.minimum(low + 1, count - 1), place - low


def between(a: np.ndarray, b: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Rotations (T, J, 4) that are `share` (T,) of the way from a to b: float64."""
    a, b = a.astype(float), b.astype(float)
    b *= np.where((a * b).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
    mixed = a + share[:, None, None] * (b - a)
    return mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)


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
    turned[:, _WRISTS] = quaternion_multiply(quaternion_multiply(rotation[:, _WRISTS], twist), across)
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
    felt, known = accelerations(strapped_places(points, BODY_POINTS, along), 1 / rate)
    if noisy:
        shape = felt.shape
        felt = felt + np.exp(rng.uniform(*np.log(_ACCELERATION_NOISE))) * rng.standard_normal(shape)
        felt += 0.15 * rng.standard_normal(shape[1:])
    return felt, known


def _disturbed(
    points: np.ndarray, rotation: np.ndarray, rate: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions and rotations as trackers of some accuracy give them, and that accuracy (27,) m."""
    accuracy = np.exp(rng.uniform(np.log(0.002), np.log(0.025), points.shape[1]))
    accuracy[HEAD] = 0.001
    if rng.uniform() < 0.5:
        accuracy[_WRISTS] = 0.002
    shape = points.shape
    drift = wander(shape[0], shape[1] * 3, rate, 1.0, rng).reshape(shape) * 0.4
    drift += rng.standard_normal(shape[1:]) * 0.4
    quick = rng.standard_normal(shape) * (0.15 if rng.uniform() < 0.3 else 0.02)
    sigma = accuracy[:, None] * rng.uniform(0.7, 1.3)
    degrees = np.minimum(np.radians(accuracy[:JOINTS] * 200), np.radians(4.0))  # 1 mm: 0.2°, 2 cm: 4°
    turns = wander(shape[0], JOINTS * 3, rate, 1.0, rng).reshape(-1, JOINTS, 3) * degrees[:, None] * 0.6
    turned = quaternion_multiply(quaternion_exp(turns), rotation)
    return points + (drift + quick) * sigma, quaternion_canonical(turned), accuracy


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
