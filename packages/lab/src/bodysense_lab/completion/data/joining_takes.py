"""Training data of the joining network: forward and backward estimates of simulated takes, and the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.retarget import retarget
from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import BODY, LEG
from bodysense.devices.simulated.noise import hide
from bodysense.devices.simulated.sensors import SENSOR_SETS, SensorSet
from bodysense.io.clip import Clip
from bodysense.io.datasets.splits import Split
from bodysense.io.resample import resample
from bodysense.observing.observation import Observation
from bodysense.takes.bridging import bridge_gaps
from bodysense.takes.joining_network import PassPair, expected_log_errors, features, joined_head
from bodysense.takes.two_way import TwoWayTracker
from bodysense.tracking.tracker import TrackerSettings
from bodysense_lab.completion.data.blinks import lose_hands
from bodysense_lab.completion.data.postures.straight_legs import straightened_pose
from bodysense_lab.completion.data.sensor_draws import spans
from bodysense_lab.completion.data.signal_kinds import TRAINING_SIGNALS, draw_signal, observed_set
from bodysense_lab.completion.kinds.lattice import Edge, random_edges
from bodysense_lab.completion.score.scenes import TrackedScene, body_split
from bodysense_lab.core.scoring import RATE
from bodysense_lab.data.augment import mirrored

# Shares of the kinds of takes: sensor sets, sets of the lattice, kinds of signals, and motions with missing limbs.
KINDS = {
    "three_point": 0.25,
    "head": 0.10,
    "headset_camera": 0.24,
    "six_point": 0.04,
    "four_point": 0.04,
    "three_point_imu_feet": 0.06,
    "lattice": 0.08,
    "signals": 0.13,
    "holes": 0.06,
}
LONGEST, SHORTEST = 900, 30  # frames of a take
_STRAIGHT = 0.3  # share of training takes whose standing legs are straightened, by 0.3 to 1
_LOST = 0.35  # share of takes with hands in which hands are lost at times (`blinks.lose_hands`)
_UNSEEN_BODIES = 256  # bodies of the shape space for every other take
# Gaps per minute of a limb, longest gap in s, and share of limbs with gaps.
_GAPS, _LONGEST_GAP, _IN_HOLES = 6.0, 8.0, 0.4
_ARM = ("shoulder", "elbow", "wrist")


@dataclass(frozen=True, eq=False)
class JoinedTake:
    """Forward and backward estimates of a take at `RATE`, and the truth; joints are those of `BODY`."""

    features: np.ndarray  # (T, F) float16
    past: np.ndarray  # (T, 22, 4) float16 wxyz, local rotations of the forward estimate
    future: np.ndarray  # (T, 22, 4) float16 wxyz, local rotations of the backward estimate
    share: np.ndarray  # (T,) float32, weight of the backward estimate in the plain mean
    world: np.ndarray  # (T, 22, 4) float16 wxyz, world rotations; valid if `turned`
    turned: np.ndarray  # (T, 22) bool: the rotation is tracked
    head: np.ndarray  # (T, 3) float32 m, of the joined body
    truth: np.ndarray  # (T, 22, 4) float16, local rotations
    true_head: np.ndarray  # (T, 3) float32 m
    rest_offset: np.ndarray  # (22, 3) float32 m
    hidden: np.ndarray  # (T, 22) bool: points whose position is not tracked
    expected: np.ndarray  # (T, 22) float16: logarithm of the mean of both expected errors, m
    spread: np.ndarray  # (T, 22) float16: logarithm of the 90 % bound, minus `expected`

    def __len__(self) -> int:
        return len(self.share)

    def save(self, path: Path) -> None:
        """Write the take as .npz."""
        np.savez(path, **vars(self))

    @classmethod
    def load(cls, path: Path) -> JoinedTake:
        """Read a take."""
        with np.load(path) as saved:
            return cls(**{field.name: saved[field.name] for field in fields(cls)})


def draw_takes(clips: Sequence[Clip], split: Split, rng: np.random.Generator) -> Iterator[JoinedTake]:
    """Yield takes of the clips in random order, without end, completed by the packaged networks."""
    bodies = sample_bodies(body_split(split), _UNSEEN_BODIES)
    while True:
        for place in rng.permutation(len(clips)):
            clip = clips[place] if rng.uniform() < 0.5 else mirrored(clips[place])
            clip = resample(clip, RATE)
            if len(clip) < SHORTEST:
                continue
            first = int(rng.integers(0, max(1, len(clip) - LONGEST + 1)))
            pose = clip.pose[first : first + LONGEST]
            if split == "train" and rng.uniform() < _STRAIGHT:
                pose = straightened_pose(pose, float(rng.uniform(0.3, 1.0)), RATE)
            if rng.uniform() < 0.5:
                pose = retarget(pose, pose.skeleton.with_offsets(bodies[int(rng.integers(_UNSEEN_BODIES))]))
            scene = TrackedScene(clip.name, "", pose)
            yield complete_take(scene, draw_observation(scene, rng))


def draw_observation(scene: TrackedScene, rng: np.random.Generator) -> Observation:
    """Return the observation of a scene by sensors of a random kind of `KINDS`."""
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    if kind == "lattice":
        edges = _edges()
        return scene.observe(observed_set(edges[int(rng.integers(len(edges)))].more))
    if kind == "signals":
        return scene.observe(observed_set(draw_signal(rng, TRAINING_SIGNALS)))
    if kind == "holes":
        return _with_holes(scene, rng)
    seen = scene.observe(SENSOR_SETS[kind])
    return lose_hands(seen, rng) if kind != "head" and rng.uniform() < _LOST else seen


@lru_cache(maxsize=1)
def _edges() -> tuple[Edge, ...]:
    return random_edges(400, np.random.default_rng(5))


def _with_holes(scene: TrackedScene, rng: np.random.Generator) -> Observation:
    """Return the observation of all joints with gaps of whole limbs: an arm, a leg or both legs."""
    seen = scene.observe(SensorSet((*BODY, "left_toe", "right_toe"), BODY))
    limbs = [[f"{side}_{part}" for part in parts] for side in ("left", "right") for parts in (_ARM, LEG)]
    hidden = np.zeros(seen.has_position.shape, dtype=bool)
    for limb in (*limbs, [*limbs[1], *limbs[3]]):
        if rng.uniform() < _IN_HOLES:
            lost = spans(len(scene), 1 / RATE, rng, _GAPS, longest=_LONGEST_GAP)
            places = np.array([seen.points.index(name) for name in limb if name in seen.points])
            hidden[np.ix_(lost, places)] = True
    return hide(seen, hidden)


def complete_take(scene: TrackedScene, seen: Observation) -> JoinedTake:
    """Complete a scene of a known body forward and backward in time, and add the truth."""
    tracker = TwoWayTracker(Person(scene.skeleton), None, TrackerSettings())
    seen = bridge_gaps(seen, 1 / RATE)
    forward, _ = tracker.tracker.step(seen, tracker.tracker.start())
    passes = tracker.passes(forward, tracker.backward(seen), tracker.turned(seen), 1 / RATE)
    world = np.asarray(forward_kinematics(forward.pose)[1])
    return _training_take(passes, world, scene.pose)


def _training_take(passes: PassPair, world: np.ndarray, truth: Pose) -> JoinedTake:
    skeleton = passes.skeleton
    body = skeleton.indices(BODY)
    place = np.asarray(forward_kinematics(truth)[0])[:, skeleton.index("head")]
    half, single = np.float16, np.float32
    middle, spread = expected_log_errors(passes)
    return JoinedTake(
        features=features(passes).astype(half),
        past=passes.past[:, body].astype(half),
        future=passes.future[:, body].astype(half),
        share=passes.share.astype(single),
        world=world[:, body].astype(half),
        turned=passes.turned[:, body],
        head=joined_head(passes).astype(single),
        truth=np.asarray(truth.rotation)[:, body].astype(half),
        true_head=place.astype(single),
        rest_offset=skeleton.rest_offset[body].astype(single),
        hidden=~passes.measured[:, body],
        expected=middle.astype(half),
        spread=spread.astype(half),
    )


def cached_takes(
    folder: Path,
    draw: Callable[[], Iterator[JoinedTake]],
    frames: int,
    source: str = "",
) -> list[JoinedTake]:
    """Return takes with `frames` frames in total, from a folder if it has them, else from `draw`.

    New takes are written to the folder. Takes in it are drawn again if `frames` or `source` differ, or if the run that
    wrote them did not finish.
    """
    folder.mkdir(parents=True, exist_ok=True)
    is_whole, request = folder / "whole", f"{frames} frames of {source}"
    takes, count, there = list[JoinedTake](), 0, sorted(folder.glob("*.npz"))
    if is_whole.is_file() and is_whole.read_text(encoding="utf-8") == request:
        return [JoinedTake.load(path) for path in there]
    is_whole.unlink(missing_ok=True)
    for path in there:
        path.unlink()
    for place, take in enumerate(draw()):
        take.save(folder / f"{place:06d}.npz")
        takes.append(take)
        count += len(take)
        if count >= frames:
            break
    is_whole.write_text(request, encoding="utf-8")
    return takes
