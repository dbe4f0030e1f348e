"""Measure tables on synthetic wearers of the tests, compare short trainings, and count training windows.

python scripts/measure_figures.py FIGURES/marker-sets.json       # or marker-gaps, mounts, gloves-expected, gloves-steps
python scripts/measure_figures.py FIGURES/arm-windows.json DATA              # or unoc-loss-sums, unoc-avatars
python scripts/measure_figures.py FIGURES/hmd-vae-sweep.json FOLDER
python scripts/write_figures.py FIGURES

DATA is a folder with `splits.json` (docs/data.md). FOLDER comes from `bodysense train hmd-vae --sweep`.
"""

from __future__ import annotations

import csv
import json
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from bodysense.body.hands.glove import ALIGNMENT, MARKERS, Glove, glove_points, hand_size, marker_positions
from bodysense.body.hands.hand import HAND_JOINTS, hand_skeleton
from bodysense.body.hands.hand_family import GlovedHand, draw_hand, plain_hand
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.cli.show import write_numbers
from bodysense.demo import performance_of_unseen_body
from bodysense.devices.gloves.device import glove_device
from bodysense.devices.gloves.hands import GloveModels, Hands, HandsSettings, load_glove_models
from bodysense.devices.simulated.glove import observe
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense.io.markers.formats.c3d import write_c3d
from bodysense.io.markers.raw_markers import points_alone
from bodysense.observing.observation import EXACT_ACCURACY, Observation
from bodysense.quality.metrics import joint_error
from bodysense.takes.last_known import KNOWN
from bodysense.takes.take import Take
from bodysense.takes.track import track
from bodysense_lab.core.scoring import group_of
from bodysense_lab.data.augment import mirrored
from bodysense_lab.data.clips import clips_of, open_clips, training_clips
from bodysense_lab.data.datasets import gather_results
from bodysense_lab.papers.pahmt.recordings import read_arm_recordings
from bodysense_lab.papers.paper_options import PaperOptions
from bodysense_lab.papers.two_hands.system import SETTINGS, networks_of
from bodysense_lab.papers.two_hands.trials import cut, hands_of, observed
from bodysense_lab.papers.unoc.options import FingersTraining, TablesTraining
from bodysense_lab.papers.unoc.point_model import load_point_model
from bodysense_lab.papers.unoc.score.finger_scores import examples_of, finger_errors
from bodysense_lab.papers.unoc.score.kept_scores import better_last_known
from bodysense_lab.papers.unoc.score.tables import PLACES
from bodysense_lab.papers.unoc.score.variant_scores import Work, score_clip, scores_of
from bodysense_lab.papers.unoc.train import train_points
from bodysense_lab.papers.unoc.train_tables import train_tables
from bodysense_lab.synthesis.hands import synthesize_hand
from bodysense_lab.synthesis.motion import RATE

TESTS = Path(__file__).parents[1] / "tests"
NOISE = 0.0005  # m, of every marker with filled gaps
GAPS = (0.2, 0.5, 1.0, 2.0, 5.0)  # s
SLIP = 0.006  # m, displacement of the markers of a badly worn glove
GLOVE_FITS = ("well", "slipped", "turned", "unknown")  # see `_fitted_glove`
LOSS_CLIPS, LOSS_STEPS = 32, 200  # of trainings with losses as means and as sums over joints
LOSS_BATCHES, LOSS_STRIDE = 0.25, 8  # share of the paper's batches, and every n-th frame that is scored
LOSS_PLACES = (("body", "occluded"), ("finger", "occluded"), ("parent_body", "all"), ("bone_body", "all"))
AVATARS = {"female": "f", "male": "m"}  # of Rocketbox, with the first letter of their clips' names
EXPECTED = (0.4, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0)  # cm: bounds of the bins of expected errors


def marker_sets() -> dict[str, float]:
    """Return the errors of joints by marker set, cm, and of the 22 joints after tracking."""
    from virtual_markers import LABORATORIES, SETS, errors, raw_of  # pyright: ignore[reportMissingImports]
    from virtual_markers import marker_positions as marker_places  # pyright: ignore[reportMissingImports]

    clip, found = performance_of_unseen_body(), {}
    for name, labels in (SETS | LABORATORIES).items():
        for joint, error in _of_both_sides(errors(raw_of(clip, labels), clip)).items():
            found[f"{name}_{joint}_cm"] = 100 * error
    truth = np.asarray(forward_kinematics(clip.pose)[0])[:, clip.pose.skeleton.indices(BODY)]
    for name, labels in SETS.items():
        places = marker_places(clip.pose, labels)
        take = _tracked(clip, tuple(places), np.stack(list(places.values()), axis=1))
        off = 100 * np.linalg.norm(take.estimate.points[:, clip.pose.skeleton.indices(BODY)] - truth, axis=-1)
        found |= {f"{name}_tracked_cm": off.mean(), f"{name}_tracked_p95_cm": np.percentile(off, 95)}
        found[f"{name}_tracked_spine_cm"] = off[:, [BODY.index(f"spine{k}") for k in (1, 2)]].mean()
    return found


def marker_gaps() -> dict[str, float]:
    """Return the errors of filled gaps of a marker, cm: by the tracker, a cubic spline and a straight line."""
    from virtual_markers import PLUG_IN_GAIT  # pyright: ignore[reportMissingImports]
    from virtual_markers import marker_positions as marker_places  # pyright: ignore[reportMissingImports]

    clip = performance_of_unseen_body()
    places = marker_places(clip.pose, PLUG_IN_GAIT)
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
            shift = np.nanmean(back - noisy, axis=(0, 1))  # of the moved floor
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
    """Return the errors of joints' positions relative to their trackers, cm."""
    from worn_trackers import numbers  # pyright: ignore[reportMissingImports]

    return numbers()


def gloves_expected(hands: int = 40, seconds: float = 12.0) -> dict[str, float]:
    """Return errors of wrists and fingertips, cm, by expected error; drawn hands, markers hidden for 0.05 to 3 s."""
    rng, models = np.random.default_rng(7), load_glove_models()
    found: dict[str, list[np.ndarray]] = {"wrist": [], "tip": []}
    for _ in range(hands):
        hand = draw_hand(rng)
        trials = cut([synthesize_hand(hand.skeleton, seconds, rng)], 240, rng, hand)
        if trials is None:
            continue
        away = rng.random((len(trials), 9)) < rng.choice([0.15, 0.5, 1.0], size=(len(trials), 1))
        solver = hands_of(trials, models, HandsSettings())
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


def gloves_steps(hands: int = 20, seconds: float = 6.0) -> dict[str, float]:
    """Measure flat-hand calibration of badly worn gloves (4.4), and right hands against mirrored left ones (4.10).

    Drawn hands in synthesised motion, by the paper's steps with networks of the paper's form: finger joints, cm, and
    their rotations, degrees.
    """
    models, found = networks_of(PaperOptions()), {}
    for fit in GLOVE_FITS:
        rng, rows = np.random.default_rng(3), []
        for _ in range(hands):
            hand = draw_hand(rng)
            pose = synthesize_hand(hand.skeleton, seconds, rng).pose
            known, glove = _fitted_glove(fit, hand)
            solver = Hands({"left": known.skeleton}, models, SETTINGS, glove=known.glove, axes=known.axes[None])
            flat = Pose(hand.skeleton, np.zeros((1, 3)), np.tile([1.0, 0, 0, 0], (1, len(HAND_JOINTS), 1)))
            moves = [(one, _markers_of(glove, one)) for one in (flat, pose)]
            solvers = (solver, solver.calibrated(moves[0][1]))
            rows.append([[_fingers_off(one, seen, true) for one in solvers] for true, seen in moves])
        for motion, pair in zip(("flat", "motion"), np.mean(rows, axis=0), strict=True):
            for when, (error, angle) in zip(("before", "after"), pair, strict=True):
                found |= {f"{fit}_{motion}_{when}_cm": error, f"{fit}_{motion}_{when}_deg": angle}
    return found | {"mirror_cm": _mirror_difference(models)}


def arm_windows(data: Path) -> dict[str, float]:
    """Return the number of windows of `train arms` in the train split of a data set (3.7)."""
    learned = read_arm_recordings(clip for clip in training_clips(data, "train") if clip.has_fingers)
    return {"clips": len(learned), "minutes": learned.minutes, "windows": len(learned.windows())}


def unoc_loss_sums(data: Path) -> dict[str, float]:
    """Return errors on validation people, cm, after few steps with losses as means and as sums over joints (1.7).

    Both trainings see the same windows in the same order, from the same first weights.
    """
    with tempfile.TemporaryDirectory() as folder:
        means, sums = (Path(folder) / form for form in ("means", "sums"))
        run = TablesTraining(
            data=data,
            out=means,
            networks=("gru",),
            limit=LOSS_CLIPS,
            steps=LOSS_STEPS,
            batch_scale=LOSS_BATCHES,
            threads=1,
        )
        train_tables(run)
        sums.mkdir()
        (means / "episodes").rename(sums / "episodes")  # they do not depend on the losses
        train_tables(replace(run, out=sums, loss_sum=True))
        networks = {one.name: one / "gru.pt" for one in (means, sums)}
        work = partial(score_clip, work=Work(networks, stride=LOSS_STRIDE, threads=1))
        found, census = gather_results(work, training_clips(data, "val", LOSS_CLIPS), 1, lambda clip: None)
    scores = {name: scores_of(name, found, census) for name in (*networks, *(f"last_known_{frame}" for frame in KNOWN))}
    methods = {name: name for name in networks} | {f"last_known_{better_last_known(scores)}": "last_known"}
    numbers = {
        f"{label}_{PLACES[at].key}_rmsjpe_cm": scores[method].get(*at).rmsjpe
        for method, label in methods.items()
        for at in LOSS_PLACES
    }
    return numbers | census.numbers() | {"steps": LOSS_STEPS, "training_clips": LOSS_CLIPS}


def unoc_avatars(data: Path) -> dict[str, float]:
    """Return errors of synthesised fingers, cm, for networks of one Rocketbox avatar on each (Table 5, right)."""
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        sets = {name: _clips_of(data, letter, Path(folder) / name) for name, letter in AVATARS.items()}
        for learned, place in sets.items():
            out = Path(folder) / f"{learned}.onnx"
            run = FingersTraining(data=place, out=out, threads=1)
            train_points(run, clips_of(run))
            examples, model = examples_of(open_clips(place, "train")), load_point_model("fingers", out)
            work = partial(finger_errors, examples=examples, model=model)
            for tested, other in sets.items():
                scored = (clip for clip in open_clips(other, "test") if clip.has_fingers and group_of(clip) == "main")
                errors, census = gather_results(work, scored, 1, lambda clip: None)
                found |= {f"{tested}_{key}": value for key, value in census.numbers().items()}
                for method in ("network", "mean_pose"):
                    tally = errors["main", "fingers", method, "error"]
                    found |= {
                        f"{learned}_to_{tested}_{method}_{measure}_cm": getattr(tally, measure)
                        for measure in ("rmsjpe", "mpjpe")
                    }
    return found


def _clips_of(data: Path, letter: str, place: Path) -> Path:
    """Make and return a folder of the Rocketbox clips whose names begin with a letter."""
    clips = place / "rocketbox"
    clips.mkdir(parents=True)
    for path in (data / "rocketbox").glob(f"{letter}_*"):
        (clips / path.name).symlink_to(path.resolve())
    splits = json.loads((data / "splits.json").read_text(encoding="utf-8"))
    (place / "splits.json").write_text(json.dumps({"rocketbox": splits["rocketbox"]}), encoding="utf-8")
    for name in ("categories.csv", "skeletons.json"):
        shutil.copyfile(data / name, place / name)
    return place


def hmd_vae_sweep(folder: Path) -> dict[str, float]:
    """Return the validation errors of the networks of a sweep, cm (2.9)."""
    with (folder / "results.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    found = {"networks": len(rows), "steps": max(float(row["steps"]) for row in rows)}
    for row in rows:
        key = "_".join(f"{name}{row[name]}" for name in ("model", "beta", "latent", "blocks"))
        found[f"{key}_cm"] = float(row["validation_position_cm"])
    return found


def _fitted_glove(fit: str, hand: GlovedHand) -> tuple[GlovedHand, Glove]:
    """Return the hand that the solver assumes, and the true glove."""
    offset = hand.glove.offset.copy()
    if fit == "slipped":  # every finger's markers are nearer the wrist
        offset[~np.isin(np.arange(len(MARKERS)), ALIGNMENT), 0] -= SLIP
    elif fit == "turned":  # the back of the glove is turned about the hand's length
        offset[[MARKERS.index("pinky_base"), MARKERS.index("wrist")], 1] += (SLIP, -SLIP)
    elif fit == "unknown":  # a hand of default shape, of the same size, is assumed
        skeleton = hand_skeleton(default_skeleton(), "left")
        scale = hand_size(hand.skeleton) / hand_size(skeleton)
        return plain_hand(skeleton.with_offsets(skeleton.rest_offset * scale)), hand.glove
    return hand, replace(hand.glove, offset=offset)


def _markers_of(glove: Glove, pose: Pose) -> Observation:
    """Return all markers of a left hand."""
    position = np.asarray(marker_positions(glove, pose))
    known = np.ones(position.shape[:2], dtype=bool)
    rotation, accuracy = np.full((*known.shape, 4), np.nan), np.full(known.shape, EXACT_ACCURACY)
    time = np.arange(1, len(known) + 1) / RATE
    return Observation(glove_points("left"), position, rotation, known, ~known, accuracy, time)


def _fingers_off(hands: Hands, seen: Observation, true: Pose) -> tuple[float, float]:
    """Return mean errors of finger joints and tips, cm, and of the rotations of finger joints, degrees."""
    answer = hands.step(seen, hands.start())[0]["left"]
    assert answer.pose is not None
    points = np.asarray(forward_kinematics(true)[0])
    apart = geodesic_angle(np.asarray(answer.pose.rotation)[:, 1:], np.asarray(true.rotation)[:, 1:])
    return float(joint_error(answer.position, points)[:, 1:].mean()), float(np.degrees(apart).mean())


def _mirror_difference(models: GloveModels) -> float:
    """Return the distance of hands of a mirrored performance from the mirrored hands of the performance, cm."""
    answers, performance = [], performance_of_unseen_body()
    for clip in (performance, mirrored(performance)):
        hands = glove_device(clip.pose.skeleton, models=models, settings=SETTINGS).hands
        answers.append(hands.step(observe(clip.pose, clip.time), hands.start())[0])
    first, second = answers
    image = np.array([-1.0, 1.0, 1.0])
    return max(
        float(joint_error(first[one].position * image, second[other].position).max())
        for one, other in (("left", "right"), ("right", "left"))
    )


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
    "gloves-steps": gloves_steps,
}


FROM: dict[str, Callable[[Path], dict[str, float]]] = {  # measurements with a folder of data
    "arm-windows": arm_windows,
    "unoc-loss-sums": unoc_loss_sums,
    "unoc-avatars": unoc_avatars,
    "hmd-vae-sweep": hmd_vae_sweep,
}


def main(out: Path, folder: Path | None = None) -> None:
    """Run the measurement that is named like the file, and write the file."""
    known = MEASURES if folder is None else FROM
    if out.stem not in known:
        raise SystemExit(f"{out}: name it {', '.join(f'{name}.json' for name in known)}")
    sys.path.insert(0, str(TESTS))  # the synthetic wearers of the tests
    numbers = MEASURES[out.stem]() if folder is None else FROM[out.stem](folder)
    write_numbers(out, {name: float(value) for name, value in numbers.items()})
    print(f"wrote {out}")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
