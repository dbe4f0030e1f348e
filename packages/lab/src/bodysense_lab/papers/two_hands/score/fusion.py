"""Fusion of inertial sensors with markers (two-hands, section 2.2; reproduce.md 4.3): fingers whose markers are hidden.

Each trial is two seconds with all markers, then five in which all markers of some fingers are hidden. The hand is one
that no network learned, its shape known. Its sensors drift for a minute before (`glove_imu`). Three methods: markers
alone; the sensors alone, calibrated a minute before, with resting spread, because they measure flexion; both.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from zlib import crc32

import numpy as np

from bodysense.body.hands.glove import ALIGNMENT, MARKERS
from bodysense.body.hands.hand import FINGERS, HAND_JOINTS, joint_rotations, own_axes
from bodysense.devices.estimate import PointEstimate
from bodysense.devices.gloves import inertial
from bodysense.devices.gloves.fingers import hand_shape, place_hands
from bodysense.devices.gloves.hands import GloveModels, HandsSettings, load_glove_models
from bodysense.devices.simulated.glove_imu import GloveImuNoise, add_errors
from bodysense.observing.observation import EXACT_ACCURACY, Observation
from bodysense.observing.points import joined_points
from bodysense.quality.metrics import joint_error
from bodysense_lab.core.scoring import GROUPS
from bodysense_lab.core.table import Report, cell, finite
from bodysense_lab.data.datasets import describe_data
from bodysense_lab.papers.two_hands.score.foreign import FOREIGN, PLACES, UNSEEN, ForeignModels, unseen_hand
from bodysense_lab.papers.two_hands.score.hand_pairs import SYNTHESISED
from bodysense_lab.papers.two_hands.score.scores import ALONE, SYNTHETIC_SECONDS, GloveTable, HandTask
from bodysense_lab.papers.two_hands.trials import (
    FINGER_POINTS,
    HandErrors,
    Trials,
    cut,
    hands_of,
    hide_some,
    observed,
    together,
)
from bodysense_lab.synthesis.motion import RATE

METHODS = {"markers": "markers alone", "imu": "sensors alone", "fused": "fused"}
FUSION_PLACES = {
    FOREIGN: PLACES[FOREIGN],
    UNSEEN: PLACES[UNSEEN],
    SYNTHESISED: "unseen hands, synthesised motion",
}
FINGER_COUNTS = (1, 2, 3, 4, 5)  # fingers whose markers are hidden
SECONDS = (0.1, 0.5, 1.0, 2.0, 5.0)  # s for which they are
SEEN = 120  # frames with all markers before
SCORED = tuple(SEEN + round(seconds * RATE) - 1 for seconds in SECONDS)
BACK = {MARKERS[k] for k in ALIGNMENT}
STRIDE = 240  # frames from one trial to the next


def measure_fusion(
    task: HandTask, markers: Path | None = None, joints: Path | None = None, left_out: Path | None = None
) -> HandErrors:
    """Errors of hidden fingers, cm, under (place, method, hidden fingers, seconds)."""
    motions, group, person = task
    means, files = HandErrors(person), ForeignModels(markers, joints, left_out)
    places = (FOREIGN, UNSEEN) if group == GROUPS[0] else (SYNTHESISED,) if group == SYNTHESISED else ()
    for place in places:
        found = files.of(place, person)
        if found is None:
            continue
        models = load_glove_models(*found)
        rng, parts = np.random.default_rng([crc32(motions[0].name.encode()), len(place)]), []
        for motion in motions:
            hand = unseen_hand(FOREIGN if place == FOREIGN else UNSEEN, motion, rng)
            if (trials := cut([motion], STRIDE, rng, hand, SCORED)) is not None:
                parts.append(trials)
        if parts:
            _add(means, place, together(parts), models, rng)
    return means


def _add(means: HandErrors, place: str, trials: Trials, models: GloveModels, rng: np.random.Generator) -> None:
    """Score trials with every number of hidden fingers, all at once."""
    lost = np.concatenate([hide_some(len(trials), count, rng, len(FINGERS)) for count in FINGER_COUNTS])
    several = together([trials] * len(FINGER_COUNTS))
    for method, errors in fusion_errors(several, lost, models, rng).items():
        for k, count in enumerate(FINGER_COUNTS):
            rows = slice(k * len(trials), (k + 1) * len(trials))
            for seconds, error in zip(SECONDS, errors[:, rows], strict=True):
                means.add((place, method, count, seconds), error)


def fusion_errors(
    trials: Trials, lost: np.ndarray, models: GloveModels, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Return errors of the second and third joint and the tip of fingers, by method, cm: (5, H) by seconds.

    The markers of fingers `lost` (H, 5) are hidden. NaN where the motion ends before.
    """
    seen, sensors = observed(trials, _hidden(lost), SEEN), add_errors(sensed(trials), GloveImuNoise(), rng)
    hands, frames = hands_of(trials, models, ALONE), list(SCORED)
    alone, _ = hands.step(seen, hands.start())
    both, _ = hands.step(joined_points(seen, sensors), hands.start())
    poses = [answer.pose for answer in alone.values() if answer.pose is not None]
    root = np.stack([pose.root_position[frames] for pose in poses], axis=1)
    wrist = np.stack([pose.rotation[frames, 0] for pose in poses], axis=1)
    turns = sensors.rotation[frames].reshape(len(frames), len(trials), -1, 4)
    return {
        "markers": _errors(trials, lost, _scored(alone)),
        "imu": _errors(trials, lost, _by_sensors(trials, turns, root, wrist)),
        "fused": _errors(trials, lost, _scored(both)),
    }


def fused_errors(
    trials: Trials, lost: np.ndarray, models: GloveModels, rng: np.random.Generator, settings: HandsSettings
) -> np.ndarray:
    """Return the errors of `fusion_errors` of the fused hands alone, with other settings."""
    hands = hands_of(trials, models, settings)
    seen = joined_points(observed(trials, _hidden(lost), SEEN), add_errors(sensed(trials), GloveImuNoise(), rng))
    return _errors(trials, lost, _scored(hands.step(seen, hands.start())[0]))


def _hidden(lost: np.ndarray) -> np.ndarray:
    """(H, 9) bool: the markers of lost fingers (H, 5)."""
    finger = np.array([-1 if name in BACK else FINGERS.index(name.partition("_")[0]) for name in MARKERS])
    return lost[:, finger] & (finger >= 0)


def _scored(answers: Mapping[str, PointEstimate]) -> np.ndarray:
    """Return all points (F, H, 21, 3) m on the frames that are scored."""
    return np.stack([answer.position[list(SCORED)] for answer in answers.values()], axis=1)


def _errors(trials: Trials, lost: np.ndarray, predicted: np.ndarray) -> np.ndarray:
    """Return mean errors (5, H) cm of the joints of lost fingers, of points (F, H, 21, 3) m."""
    points, frames = trials.hands[0].indices(FINGER_POINTS), list(SCORED)
    counted = np.repeat(lost, 3, axis=1)
    error = joint_error(predicted[:, :, points], trials.points[frames][:, :, points])
    mean = (error * counted).sum(axis=-1) / counted.sum(axis=-1)
    return np.where(trials.frames > np.array(frames)[:, None], mean, np.nan)


def sensed(trials: Trials) -> Observation:
    """Return exact sensors of all trials."""
    frames, hands = trials.turned.shape[:2]
    known = np.ones((frames, hands * len(HAND_JOINTS)), dtype=bool)
    return Observation(
        points=tuple(f"left{k}_{joint}" for k in range(hands) for joint in HAND_JOINTS),
        position=np.full((*known.shape, 3), np.nan),
        rotation=trials.turned.reshape(frames, -1, 4),
        has_position=~known,
        has_rotation=known,
        accuracy=np.full(known.shape, EXACT_ACCURACY),
        time=np.arange(1, frames + 1) / RATE,
    )


def _by_sensors(trials: Trials, rotation: np.ndarray, root: np.ndarray, wrist: np.ndarray) -> np.ndarray:
    """Return points (F, H, 21, 3) m of hands placed by their markers, with the flexion of sensors (F, H, 16, 4)."""
    axes = own_axes(np.stack([hand.axes for hand in trials.gloved_hands]))
    flexion = inertial.sensor_flexion(rotation, axes).flexion
    local = joint_rotations(np.stack([flexion, 0 * flexion, 0 * flexion], axis=-1), axes)
    shape = hand_shape(trials.hands, trials.gloves)
    turned = np.concatenate([wrist[:, :, None], local], axis=2)
    return np.stack([place_hands(shape, *frame).position for frame in zip(root, turned, strict=True)])


def fusion_report(table: GloveTable) -> Report:
    """Errors of hidden fingers by markers, by sensors and by both."""
    made = f"Synthesised: {table.synthesised} hands, {SYNTHETIC_SECONDS:g} s each, of a seed of their own."
    figures = {
        f"{place}_{method}_{count}_{seconds:.1f}_cm": table.means.mean(place, method, count, seconds)
        for place, method, count, seconds in table.means
    }
    return Report(
        name="gloves-fusion",
        title="Two hands, section 2.2: fingers whose markers are hidden, with inertial sensors",
        columns=("hand", "method", "fingers hidden", *(f"{seconds:g} s" for seconds in SECONDS)),
        rows=tuple(_rows(table)),
        numbers=finite(figures) | table.census.numbers(),
        data=(made,) if table.data is None else (describe_data(table.data, table.census), made),
        caption="Mean error of the second and third joint and the tip of the fingers whose markers are hidden, cm. No "
        "network learned these hands.",
        digits=2,
    )


def _rows(table: GloveTable) -> Iterator[tuple[str | float | None, ...]]:
    for place, label in FUSION_PLACES.items():
        for count in FINGER_COUNTS:
            for method, name in METHODS.items():
                row = [table.means.mean(place, method, count, seconds) for seconds in SECONDS]
                if np.isfinite(row).any():
                    yield label, name, str(count), *map(cell, row)
