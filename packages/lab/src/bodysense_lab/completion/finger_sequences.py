"""Training sequences of fingers: a recorded clip on varied hands, seen from wrists that are tracked or estimated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import quaternion_conjugate, quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense_lab.completion.corpus import Corpus
from bodysense_lab.completion.fingers import FINGER_JOINTS, FINGER_POINTS, HAND_JOINTS, HAND_POINTS, SIDES
from bodysense_lab.completion.generated_fingers import RATE
from bodysense_lab.completion.points import HEAD, INPUT_POINTS, KNUCKLES
from bodysense_lab.completion.sensor_draws import spans, worn
from bodysense_lab.completion.sequences import (
    LONGEST,
    Draw,
    TrainingBody,
    between,
    draw_body,
    frames_of,
    make_sequence,
    wander,
)

# Kinds of sequences and how often each is drawn.
KINDS = {
    "nothing": 0.40,  # controllers, or no hands at all: fingers are synthesised
    "tracked": 0.25,  # gloves or hand tracking: all positions, all rotations, or both
    "camera": 0.25,  # what a headset's cameras see
    "random": 0.10,  # some joints and tips, each with a position, a rotation or both
}
_WRISTS = [BODY.index(f"{side}_wrist") for side in SIDES]
_KNUCKLES = [INPUT_POINTS.index(name) for name in KNUCKLES]
_BODY_JOINTS = len(BODY)
_PARENTS = default_skeleton().parents
_FINGERS = ("index", "middle", "pinky", "ring", "thumb")
_MIRRORED = np.array([-1.0, 1.0, 1.0])
_FINGER_OF = np.array(
    [_FINGERS.index(default_skeleton().points[p].split("_")[1].rstrip("123")) for p in HAND_POINTS[0]]
)
_FIRST = np.array([default_skeleton().joints[j].endswith("1") for j in HAND_JOINTS[0]])  # joints at the knuckles
_WRIST_DEGREES, _WRIST_PLACE = 15.0, 0.06  # standard deviation, degrees and m, of a wrist that is only estimated


@dataclass(frozen=True, eq=False)
class FingerSequence:
    """Both hands of one clip, ready to learn from; the hand axis is left, right. Absent values are finite."""

    true_position: np.ndarray  # (T, 2, 20, 3) float32 m, from the wrist, in its frame
    true_rotation: np.ndarray  # (T, 2, 15, 4) float32 wxyz, wrist ← joint
    position: np.ndarray  # (T, 2, 20, 3) float32 m, as tracked, from the wrist as tracked
    rotation: np.ndarray  # (T, 2, 15, 4) float32 wxyz, as tracked
    has_position: np.ndarray  # (T, 2, 20) bool
    has_rotation: np.ndarray  # (T, 2, 15) bool
    wrist: np.ndarray  # (T, 2, 3) float32 m, in the frame under the head, from the head
    wrist_rotation: np.ndarray  # (T, 2, 4) float32 wxyz, frame under the head ← wrist
    wrist_velocity: np.ndarray  # (T, 2, 3) float32 m/s, in that frame
    rest_offset: np.ndarray  # (2, 20, 3) float32 m, as known to the tracker
    interval: float  # s

    def __len__(self) -> int:
        return len(self.wrist)


@dataclass(frozen=True)
class FingersTracked:
    """Masks of one sequence."""

    has_position: np.ndarray  # (T, 2, 20) bool
    has_rotation: np.ndarray  # (T, 2, 15) bool
    has_wrist: np.ndarray  # (T, 2) bool: measured, not estimated


# Draw what is tracked, from the frames in which cameras see each hand (T, 2), the interval in s, and random numbers.
TrackFingers = Callable[[np.ndarray, float, np.random.Generator], FingersTracked]


def clips_with_fingers(corpus: Corpus) -> np.ndarray:
    """Indices (N,) of the clips whose fingers were recorded."""
    return np.flatnonzero(corpus.finger_start >= 0)


def draw_finger_sequence(
    corpus: Corpus, clip: int, rng: np.random.Generator, generated: np.ndarray | None = None
) -> FingerSequence:
    """Draw everything that may differ about a clip, and make its sequence.

    A clip whose fingers were not recorded moves those of some part of `generated` (N, 30, 4). No clip is mirrored: the
    network reads right hands in a mirror, so that a clip and its mirror image are the same.
    """
    seconds = float(corpus.length[clip] / corpus.rate[clip])
    own = corpus.rest_offset[clip].astype(float)
    drawn = Draw(
        body=with_other_hands(draw_body(own, rng), rng),
        rate=30.0 if rng.uniform() < 0.4 else float(np.exp(rng.uniform(np.log(22), np.log(60)))),
        begin=max(0.0, float(rng.uniform(-LONGEST / 2, seconds - LONGEST / 2))),
        longest=LONGEST,
        bent=bool(rng.uniform() < 0.35),
        noisy=bool(rng.uniform() < 0.6),
    )
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    moved = kind in ("tracked", "random") and bool(rng.uniform() < 0.5)
    local = None
    if corpus.finger_start[clip] < 0:
        assert generated is not None
        local = _generated(generated, len(frames_of(corpus, clip, drawn)[0]), drawn.rate, rng)
    return make_finger_sequence(corpus, clip, drawn, partial(draw_fingers_tracked, kind), rng, local, moved=moved)


def make_finger_sequence(
    corpus: Corpus,
    clip: int,
    draw: Draw,
    track: TrackFingers,
    rng: np.random.Generator,
    local: np.ndarray | None = None,
    *,
    moved: bool = False,
) -> FingerSequence:
    """Make the sequence of a clip as drawn, but for `draw.track`, which is of the body.

    Args:
        corpus: recorded motion.
        clip: index of a clip.
        draw: body, rate and part of the clip.
        track: what is tracked of the hands.
        rng: random numbers.
        local: (T, 2, 15, 4) wxyz, parent ← joint, of the drawn part; None: as recorded.
        moved: whether random motion is added to the recorded fingers.
    """
    # The headset's cameras stand for every device here: what they see of the hands is in the masks that come back.
    body = make_sequence(corpus, clip, replace(draw, track=partial(worn, HEADSET_CAMERA)), rng)
    rate = draw.rate
    local = _resampled(corpus, clip, draw) if local is None else local
    if moved:
        local = with_moved_fingers(local, rate, rng)
    true_rotation, true_position = hand_kinematics(local, draw.body.true[HAND_POINTS])
    tracked = track(body.has_position[:, _KNUCKLES], 1 / rate, rng)

    true_wrist = body.true_rotation[:, _WRISTS].astype(float)
    true_place = body.true_position[:, _WRISTS].astype(float)
    wrist, place = _estimated(true_wrist, true_place, rate, rng)
    wrist = np.where(tracked.has_wrist[..., None], body.rotation[:, _WRISTS], wrist)
    place = np.where(tracked.has_wrist[..., None], body.position[:, _WRISTS], place)

    # The graph reads fingers in the frame of the tracked wrist, so convert to the world first, then to that frame.
    position = quaternion_rotate(true_wrist[:, :, None], true_position) + true_place[:, :, None]
    rotation = quaternion_multiply(true_wrist[:, :, None], true_rotation)
    if draw.noisy:
        position, rotation = _disturbed(position, rotation, rate, rng)
    into = quaternion_conjugate(wrist)[:, :, None]
    moving = np.diff(place, axis=0, prepend=place[:1]) * rate
    angle = np.arctan2(body.anchor[:, 1], body.anchor[:, 0])
    turn = quaternion_exp(angle[:, None, None] * [0.0, -1.0, 0.0])  # frame under the head ← world
    told = draw.body.told[HAND_POINTS]
    values = {
        "true_position": true_position,
        "true_rotation": true_rotation,
        "position": quaternion_rotate(into, position - place[:, :, None]),
        "rotation": quaternion_multiply(into, rotation),
        "wrist": quaternion_rotate(turn, place - body.position[:, HEAD : HEAD + 1]),
        "wrist_rotation": quaternion_multiply(turn, wrist),
        "wrist_velocity": quaternion_rotate(turn, np.clip(moving, -5, 5)),
        "rest_offset": told,
    }
    return FingerSequence(
        **{name: np.asarray(value, dtype=np.float32) for name, value in values.items()},
        has_position=tracked.has_position & tracked.has_wrist[..., None],
        has_rotation=tracked.has_rotation,
        interval=1 / rate,
    )


def draw_fingers_tracked(kind: str, visible: np.ndarray, interval: float, rng: np.random.Generator) -> FingersTracked:
    """Draw what is tracked of the hands in frames every `interval` s, of which cameras see `visible` (T, 2)."""
    frames = len(visible)
    has_position = np.zeros((frames, 2, FINGER_POINTS), dtype=bool)
    has_rotation = np.zeros((frames, 2, FINGER_JOINTS), dtype=bool)
    has_wrist = np.ones((frames, 2), dtype=bool)

    def hidden(per_minute: float, longest: float = 3.0) -> np.ndarray:
        return np.stack([spans(frames, interval, rng, per_minute, longest) for _ in SIDES], axis=1)

    if kind == "nothing":
        drawn = rng.uniform()
        if drawn < 0.15:  # a headset alone
            has_wrist[:] = False
        elif drawn < 0.35:
            has_wrist = ~hidden(8.0)
    elif kind == "tracked":
        drawn = rng.uniform()
        has_position[:], has_rotation[:] = drawn < 0.7, drawn > 0.4
        if rng.uniform() < 0.5:
            lost = hidden(8.0) if rng.uniform() < 0.7 else hidden(3.0, 8.0)
            has_position[lost], has_rotation[lost] = False, False
            has_wrist = ~lost | (rng.uniform() < 0.5)
    elif kind == "camera":
        seen = visible.copy() if rng.uniform() < 0.7 else np.ones_like(visible)
        seen &= ~hidden(8.0)
        has_position[:] = seen[..., None]
        has_rotation[:] = (seen & (rng.uniform() < 0.3))[..., None]
        has_wrist = seen | (rng.uniform() < 0.25)
    else:
        _some(has_position, has_rotation, rng)
        if rng.uniform() < 0.3:
            lost = hidden(8.0)
            has_position[lost], has_rotation[lost] = False, False
    return FingersTracked(has_position, has_rotation, has_wrist)


def _some(has_position: np.ndarray, has_rotation: np.ndarray, rng: np.random.Generator) -> None:
    """Tips alone, whole fingers, or any joints and tips; alike on both hands."""
    drawn, what = rng.uniform(), rng.uniform()
    if drawn < 0.3:
        points, what = np.arange(FINGER_POINTS) >= FINGER_JOINTS, 0.0  # tips have no rotation
    elif drawn < 0.55:
        points = rng.uniform(size=len(_FINGERS))[_FINGER_OF] < 0.5
    else:
        points = rng.uniform(size=FINGER_POINTS) < rng.uniform(0.1, 0.9)
    has_position[:] = points & (what < 0.75)
    has_rotation[:] = points[:FINGER_JOINTS] & (what > 0.5)


def with_other_hands(body: TrainingBody, rng: np.random.Generator) -> TrainingBody:
    """Vary the hands of a body: their size, the lengths of fingers and the directions in which these rest.

    If the proportions are known, the varied hands are known too; otherwise the known offsets stay unchanged.
    """
    true = body.true.copy()
    left = true[HAND_POINTS[0]]
    scale = np.exp(rng.normal(0, 0.05)) * rng.uniform(0.92, 1.08, len(_FINGERS))[_FINGER_OF, None]
    turn = quaternion_exp(rng.normal(0, np.radians(2.5), left.shape))
    changed = quaternion_rotate(turn, left) * scale
    true[HAND_POINTS[0]], true[HAND_POINTS[1]] = changed, changed * _MIRRORED
    return TrainingBody(true, body.told if body.certainty.any() else true, body.certainty)


def with_moved_fingers(local: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Add slow random bending and spreading to local finger rotations (T, 2, 15, 4)."""
    frames = len(local)
    count = len(_FINGERS)
    noise = wander(frames, 2 * count * 3, rate, 0.8, rng).reshape(frames, 2, count, 3)
    # Fingers bend about z: those of the left hand the negative way. They spread about y, at the knuckles.
    bend = (noise[..., 0] * 0.35 + rng.normal(0, 0.3, (2, count)))[..., _FINGER_OF[:FINGER_JOINTS]]
    spread = (noise[..., 1] * 0.12)[..., _FINGER_OF[:FINGER_JOINTS]] * _FIRST
    roll = (noise[..., 2] * 0.08)[..., _FINGER_OF[:FINGER_JOINTS]] * _FIRST
    side = np.array([-1.0, 1.0])[:, None]
    vector = np.stack([roll, spread * side, bend * side], axis=-1)
    return quaternion_multiply(local, quaternion_exp(vector))


def hand_kinematics(local: np.ndarray, rest_offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations wrist ← joint (T, 2, 15, 4) and positions (T, 2, 20, 3) m from the wrist, in its frame.

    Args:
        local: (T, 2, 15, 4) wxyz, parent ← joint.
        rest_offset: (2, 20, 3) m.
    """
    rotation = np.tile([1.0, 0.0, 0.0, 0.0], (len(local), len(default_skeleton().joints), 1))
    offset = np.zeros_like(default_skeleton().rest_offset)  # of a body whose wrists are at the origin
    rotation[:, HAND_JOINTS], offset[HAND_POINTS] = local, rest_offset
    hands = Pose(default_skeleton().with_offsets(offset), np.zeros((len(local), 3)), rotation)
    position, world = forward_kinematics(hands)
    return np.asarray(world)[:, HAND_JOINTS], np.asarray(position)[:, HAND_POINTS]


def _parent_places() -> list[int]:
    """(20,) for each point of a hand its parent's place among the 15 joints; -1 for the wrist."""
    joints = HAND_JOINTS[0].tolist()
    return [joints.index(_PARENTS[point]) if _PARENTS[point] in joints else -1 for point in HAND_POINTS[0]]


PARENT_PLACES = _parent_places()


def _resampled(corpus: Corpus, clip: int, draw: Draw) -> np.ndarray:
    """Local rotations (T, 2, 15, 4) of the part of a clip that is drawn."""
    low, high, share = frames_of(corpus, clip, draw)
    first = int(corpus.finger_start[clip])
    mixed = between(corpus.fingers[first + low], corpus.fingers[first + high], share)
    hands = mixed[:, HAND_JOINTS - _BODY_JOINTS]
    if draw.mirrored:
        hands = hands[:, ::-1] * np.array([1.0, 1.0, -1.0, -1.0])
    return hands


def _generated(fingers: np.ndarray, frames: int, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Local rotations (T, 2, 15, 4) of some part of generated fingers (N, 30, 4), at `rate` Hz."""
    place = np.arange(frames) * (RATE / rate)
    place += rng.uniform(0, max(0.0, len(fingers) - 2 - place[-1]))
    low = np.minimum(place.astype(int), len(fingers) - 1)
    mixed = between(fingers[low], fingers[np.minimum(low + 1, len(fingers) - 1)], place - low)
    return mixed[:, HAND_JOINTS - _BODY_JOINTS]


def _estimated(
    wrist: np.ndarray, place: np.ndarray, rate: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Wrists turned (T, 2, 4) at (T, 2, 3) m as a body that is completed has them."""
    frames = len(wrist)
    error = wander(frames, 2 * 6, rate, 1.5, rng).reshape(frames, 2, 6)
    turn = quaternion_exp(error[..., :3] * np.radians(_WRIST_DEGREES))
    return quaternion_multiply(turn, wrist), place + error[..., 3:] * _WRIST_PLACE


def _disturbed(
    position: np.ndarray, rotation: np.ndarray, rate: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T, 2, 20, 3) m and rotations (T, 2, 15, 4) as hand tracking of some accuracy gives them."""
    frames = len(position)
    accuracy = np.exp(rng.uniform(np.log(0.001), np.log(0.012)))  # m
    drift = wander(frames, position[0].size, rate, 1.0, rng).reshape(position.shape) * 0.4
    drift += rng.standard_normal(position.shape[1:]) * 0.4
    quick = rng.standard_normal(position.shape) * (0.15 if rng.uniform() < 0.3 else 0.02)
    radians = np.radians(accuracy * 700)  # 1 mm: 0.7°, 1 cm: 7°
    turns = wander(frames, rotation[0, ..., 0].size * 3, rate, 1.0, rng).reshape(*rotation.shape[:-1], 3) * 0.6
    return position + (drift + quick) * accuracy, quaternion_multiply(quaternion_exp(turns * radians), rotation)
