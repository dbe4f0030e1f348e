"""Measure tables that need no motion data and no trained networks, on the made-up wearers of the tests.

python scripts/measure_figures.py FIGURES/marker-sets.json       # or marker-gaps, mounts, gloves-expected
python scripts/write_figures.py FIGURES
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from bodysense.body.hand_family import draw_hand
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.cli.show import write_numbers
from bodysense.demo import performance_of_stranger
from bodysense.devices.gloves.hands import HandsSettings, load_glove_models
from bodysense.io.clip import Clip
from bodysense.io.markers.c3d import write_c3d
from bodysense.io.markers.raw_markers import points_alone
from bodysense.take import Take, track
from bodysense_lab.synthesis.hands import synthesize_hand
from bodysense_lab.two_hands.trials import cut, hands_of, observed

TESTS = Path(__file__).parents[1] / "tests"
NOISE = 0.0005  # m, of every marker whose gaps are filled
GAPS = (0.2, 0.5, 1.0, 2.0, 5.0)  # s
EXPECTED = (0.4, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0)  # cm: bounds of the bins of expected errors


def marker_sets() -> dict[str, float]:
    """Errors of joints by set, cm, and of the 22 joints after tracking."""
    from virtual import LABORATORIES, SETS, errors, raw_of, worn  # pyright: ignore[reportMissingImports]

    clip, found = performance_of_stranger(), {}
    for name, labels in (SETS | LABORATORIES).items():
        for joint, error in _of_both_sides(errors(raw_of(clip, labels), clip)).items():
            found[f"{name}_{joint}_cm"] = 100 * error
    truth = np.asarray(forward_kinematics(clip.pose)[0])[:, clip.pose.skeleton.indices(BODY)]
    for name, labels in SETS.items():
        places = worn(clip.pose, labels)
        take = _tracked(clip, tuple(places), np.stack(list(places.values()), axis=1))
        off = 100 * np.linalg.norm(take.estimate.points[:, clip.pose.skeleton.indices(BODY)] - truth, axis=-1)
        found |= {f"{name}_tracked_cm": off.mean(), f"{name}_tracked_p95_cm": np.percentile(off, 95)}
        found[f"{name}_tracked_spine_cm"] = off[:, [BODY.index(f"spine{k}") for k in (1, 2)]].mean()
    return found


def marker_gaps() -> dict[str, float]:
    """Errors of filled gaps of a marker, cm: by the tracker, a cubic spline, a straight line; one marker at a time."""
    from virtual import PLUG_IN_GAIT, worn  # pyright: ignore[reportMissingImports]

    clip = performance_of_stranger()
    places = worn(clip.pose, PLUG_IN_GAIT)
    truth = np.stack(list(places.values()), axis=1)
    noisy = truth + np.random.default_rng(0).normal(0, NOISE, truth.shape)
    found = {}
    frames, markers = truth.shape[:2]
    for seconds in GAPS:
        off: dict[str, list[np.ndarray]] = {"filled": [], "spline": [], "line": []}
        for hidden in _one_at_a_time(frames, markers, round(seconds * clip.frame_rate)):
            take = _tracked(clip, tuple(places), np.where(hidden[..., None], np.nan, noisy))
            assert take.markers is not None and take.markers.found is not None
            back = take.markers.found.world.to_ours(take.markers.found.raw.position)
            shift = np.nanmean(back - noisy, axis=(0, 1))  # of a floor that was moved
            off["filled"].append((take.filled_markers.position - shift - truth)[hidden])
            for marker in np.flatnonzero(hidden.any(axis=0)):
                away = hidden[:, marker]
                time, known = np.arange(len(away)), np.flatnonzero(~away)
                spline = CubicSpline(known, noisy[known, marker])(time[away])
                line = np.stack([np.interp(time[away], known, axis) for axis in noisy[known, marker].T], axis=-1)
                off["spline"].append(spline - truth[away, marker])
                off["line"].append(line - truth[away, marker])
        for method, apart in off.items():
            found[f"{method}_{seconds:g}_cm"] = 100 * np.linalg.norm(np.concatenate(apart), axis=-1).mean()
    return found


def mounts() -> dict[str, float]:
    """Errors of where joints are under their trackers, cm."""
    from worn_trackers import numbers  # pyright: ignore[reportMissingImports]

    return numbers()


def gloves_expected(hands: int = 40, seconds: float = 12.0) -> dict[str, float]:
    """Errors of wrists and fingertips, cm, by their expected errors: drawn hands, markers hidden for 0.05 to 3 s."""
    rng, models = np.random.default_rng(7), load_glove_models()
    found: dict[str, list[np.ndarray]] = {"wrist": [], "tip": []}
    for _ in range(hands):
        hand = draw_hand(rng)
        trials = cut([synthesize_hand(hand.skeleton, seconds, rng)], 240, rng, hand)
        if trials is None:
            continue
        away = rng.random((len(trials), 9)) < rng.choice([0.15, 0.5, 1.0], size=(len(trials), 1))
        solver = hands_of(trials, models, HandsSettings(contact=None))
        answers, _ = solver.step(observed(trials, away), solver.start())
        for k, answer in enumerate(answers.values()):
            frames = slice(0, trials.frames[k])
            apart = np.linalg.norm(answer.position - trials.points[:, k], axis=-1)[frames]
            both = 100 * np.stack([answer.confidence[frames], apart])
            found["wrist"].append(both[:, :, 0])
            found["tip"].append(both[:, :, -5:].reshape(2, -1))
    numbers = {}
    for part, pairs in found.items():
        expected, error = np.concatenate(pairs, axis=1)
        for low, high in pairwise(EXPECTED):
            chosen = (expected >= low) & (expected < high)
            if chosen.any():
                numbers[f"{part}_{low:g}_{high:g}_cm"] = error[chosen].mean()
    return numbers


def _of_both_sides(errors: dict[str, float]) -> dict[str, float]:
    """Return mean errors of the left and the right joint."""
    parts = dict.fromkeys(name.removeprefix("left_").removeprefix("right_") for name in errors)
    return {part: float(np.mean([one for name, one in errors.items() if name.endswith(part)])) for part in parts}


def _one_at_a_time(frames: int, markers: int, gap: int) -> Iterator[np.ndarray]:
    """Yield (T, M) masks in which every marker is hidden once, no two at a time, and never at the ends."""
    starts = range(5, frames - gap - 5, gap + 5)
    for first in range(0, markers, len(starts)):
        hidden = np.zeros((frames, markers), dtype=bool)
        for marker, start in zip(range(first, markers), starts, strict=False):
            hidden[start : start + gap, marker] = True
        yield hidden


def _tracked(clip: Clip, names: tuple[str, ...], position: np.ndarray) -> Take:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "walk.c3d"
        write_c3d(path, points_alone(names, position, clip.time), clip.frame_rate)
        return track(path)


MEASURES: dict[str, Callable[[], dict[str, float]]] = {
    "marker-sets": marker_sets,
    "marker-gaps": marker_gaps,
    "mounts": mounts,
    "gloves-expected": gloves_expected,
}


def main(out: Path) -> None:
    """Measure what a file is named after, and write it."""
    if out.stem not in MEASURES:
        raise SystemExit(f"{out}: name it {', '.join(f'{name}.json' for name in MEASURES)}")
    sys.path[:0] = [str(TESTS), str(TESTS / "io" / "markers")]  # their made-up wearers
    write_numbers(out, {name: float(value) for name, value in MEASURES[out.stem]().items()})
    print(f"wrote {out}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
