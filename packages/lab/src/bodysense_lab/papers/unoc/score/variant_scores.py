"""Scoring the networks of UNOC's Tables 2 to 4 on a data set, all in one pass, each frame from its own window."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.observing.observation import Observation
from bodysense.takes.last_known import KNOWN, last_known
from bodysense_lab.core.scoring import RATE, Tally, group_of, part_errors, scored_points
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.data.datasets import Census, DataSet, gather_results
from bodysense_lab.papers.unoc.ik_tracker import IkTrackerSettings
from bodysense_lab.papers.unoc.learned import PACKAGED, track_clip
from bodysense_lab.papers.unoc.network.network import BodyNetwork, TrackedBody, read_weights, tracked_of
from bodysense_lab.papers.unoc.score.constant_velocity import constant_velocity
from bodysense_lab.papers.unoc.score.kept_scores import Scores, identity_of, read_scores, scores_path, write_scores
from bodysense_lab.weights import packaged

_WINDOWS = 256  # that are computed together


@dataclass(frozen=True)
class Shipped:
    """The predictor that users run: its network (None: the packaged one), and how the tracker makes motion of it."""

    model: Path | None = None
    settings: IkTrackerSettings = IkTrackerSettings()


@dataclass(frozen=True)
class Work:
    """Scored methods: networks by name at every `stride`-th frame, and the shipped predictor, if any."""

    networks: Mapping[str, Path]
    shipped: Shipped | None = None
    stride: int = 1
    threads: int | None = None  # of PyTorch; None: its own choice


@dataclass(frozen=True)
class ClipReading:
    """A clip as networks read it that have the same inputs; T frames, a batch of one."""

    tracked: TrackedBody
    features: Tensor  # (1, T, F)
    known: Tensor  # (1, T, P, 3)
    into: Tensor  # (1, T, 3, 3)


def read_observation(model: BodyNetwork, observation: Observation, skeleton: Skeleton) -> ClipReading:
    """Return the inputs of a network for an observation of a wearer with `skeleton`."""
    tracked = tracked_of(observation, skeleton)
    with torch.no_grad():
        features, known, into, _ = model.prepare(tracked, model.start(1))
    return ClipReading(tracked, features, known, into)


def complete(model: BodyNetwork, reading: ClipReading, frames: np.ndarray) -> np.ndarray:
    """World positions (N, P, 3) m that a window network gives N frames, each answered from the window that ends there.

    A window that begins before the clip begins with repetitions of its first frame.
    """
    window = model.config.window
    if window is None:
        raise BodysenseError("this network carries its state; only networks that see windows are scored here")
    back = np.arange(-window + 1, 1)
    result = []
    with torch.no_grad():
        for first in range(0, len(frames), _WINDOWS):
            ends = frames[first : first + _WINDOWS]
            seen = reading.features[0, np.maximum(ends[:, None] + back, 0)]
            hidden = model.recurrent.last(seen)
            answer = model.answer(reading.features[:, ends], hidden[None], reading.known[:, ends])
            where = reading.tracked._replace(head_position=reading.tracked.head_position[:, ends])
            result.append(model.place_in_world(answer, reading.into[:, ends], where).position[0].numpy())
    return np.concatenate(result).astype(np.float64)


def positions_of(
    networks: Mapping[str, Path], observation: Observation, skeleton: Skeleton, frames: np.ndarray
) -> dict[str, np.ndarray]:
    """World positions (N, P, 3) m of every network at N frames; networks of the same inputs share what they read."""
    readings: dict[tuple[str, str, str], ClipReading] = {}
    result = {}
    for name, path in networks.items():
        model = _network(path)
        inputs = (model.config.inputs, model.config.frame, model.config.finger_origin)
        if inputs not in readings:
            readings[inputs] = read_observation(model, observation, skeleton)
        result[name] = complete(model, readings[inputs], frames)
    return result


def score_clip(clip: Clip, work: Work) -> Tallies:
    """Errors on one clip by method, group, part and share.

    Methods are networks, 'last_known_<frame>' and, if asked for, 'best' and 'tracker'.
    """
    if work.threads is not None:
        torch.set_num_threads(work.threads)
    if work.shipped is None:
        clip = resample(clip, RATE)
        observation = observe(clip.pose, clip.time, HEADSET_CAMERA)
        position = last_known(observation, clip.pose.skeleton)
    else:
        tracked = track_clip(clip, work.shipped.model, work.shipped.settings)
        clip, observation, position = tracked.clip, tracked.observation, dict(tracked.position)
    skeleton, frames = clip.pose.skeleton, np.arange(0, len(clip), work.stride)
    shipped = {"best": "network", "tracker": "bodysense"}
    methods = {name: position.pop(key)[frames] for name, key in shipped.items() if key in position}
    methods |= {f"last_known_{frame}": values[frames] for frame, values in position.items()}
    methods["constant_velocity"] = constant_velocity(observation, skeleton)[frames]
    methods |= positions_of(work.networks, observation, skeleton, frames)
    truth = np.asarray(forward_kinematics(clip.pose)[0])[frames]
    hidden = ~observation.has_position[frames]
    found = {(m, *key): one for m, at in methods.items() for key, one in errors_of(at, truth, hidden, clip).items()}
    return Tallies(found)


def errors_of(position: np.ndarray, truth: np.ndarray, hidden: np.ndarray, clip: Clip) -> Tallies:
    """Errors of one method on a clip: positions and truth (N, P, 3) m, which points were hidden (N, P).

    Beside the parts of the headset table, for Table 4: 'parent_body', the error of the vectors to the tested points
    from their parents, 'parent_all', to points of fingers as well; 'bone_body' and 'bone_all', that of their lengths.
    """
    skeleton, group = clip.pose.skeleton, group_of(clip)
    tallies = Tallies()
    for part, (values, chosen) in part_errors(position, truth, skeleton, clip.has_fingers).items():
        for share, mask in (("occluded", hidden[:, chosen]), ("all", np.full(values.shape, True))):
            tallies.add((group, part, share), values[mask], clip.person)
    tested = scored_points(skeleton)
    bones = {"body": tested}
    if clip.has_fingers:
        bones["all"] = tested + np.flatnonzero(skeleton.wrist_of >= 0).tolist()
    for part, chosen in bones.items():
        parents = [skeleton.parents[point] for point in chosen]
        ours, true = (points[:, chosen] - points[:, parents] for points in (position, truth))
        length = np.abs(np.linalg.norm(ours, axis=-1) - np.linalg.norm(true, axis=-1))
        for name, error in (("parent", np.linalg.norm(ours - true, axis=-1)), ("bone", length)):
            tallies.add((group, f"{name}_{part}", "all"), 100 * error, clip.person)
    return tallies


def scores_of(method: str, tallies: Mapping[tuple, Tally], census: Census) -> Scores:
    """Return the scores of one method from the tallies of `score_clip`, gathered over clips."""
    return Scores(Tallies({key[1:]: tally for key, tally in tallies.items() if key[0] == method}), census)


def score(data: DataSet, folder: Path, work: Work, jobs: int, advance: Callable[[Clip], None]) -> dict[str, Scores]:
    """Scores of every method of `score_clip` on a data set: read from `folder` where they are kept, else counted.

    `advance` is called after every clip.
    """
    files = _files(work)
    settings = {name: repr(work.shipped) for name in ("best", "tracker") if work.shipped is not None}
    identities = {n: identity_of(data, work.stride, file, settings.get(n, "")) for n, file in files.items()}
    found = {name: read_scores(scores_path(folder, name, data), identities[name]) for name in files}
    known = {name: scores for name, scores in found.items() if scores is not None}
    todo = [name for name in files if name not in known]
    if todo:
        networks = {name: path for name, path in work.networks.items() if name in todo}
        shipped = work.shipped if {"best", "tracker"} & set(todo) else None
        left = Work(networks, shipped, work.stride, 1 if jobs > 1 else work.threads)
        tallies, census = gather_results(partial(score_clip, work=left), data.clips(), jobs, advance)
        for name in todo:
            known[name] = scores_of(name, tallies, census)
            write_scores(scores_path(folder, name, data), known[name], identities[name])
    return {name: known[name] for name in files}


def score_pairs(
    sets: Sequence[DataSet],
    networks: Mapping[str, Path],
    folder: Path,
    stride: int,
    jobs: int,
    advance: Callable[[Clip], None],
) -> tuple[dict[tuple[str, str], Scores], dict[str, dict[str, Scores]]]:
    """Networks, by the name of what they were trained on, on every set: scores by (trained on, tested on).

    And by set the scores of the last known positions. All are kept in `folder`.
    """
    pairs: dict[tuple[str, str], Scores] = {}
    last: dict[str, dict[str, Scores]] = {}
    for data in sets:
        named = {f"trained-on-{train}": path for train, path in networks.items()}
        scores = score(data, folder, Work(named, stride=stride), jobs, advance)
        pairs |= {(train, data.name): scores[f"trained-on-{train}"] for train in networks}
        last[data.name] = {name: one for name, one in scores.items() if name not in named}
    return pairs, last


def networks_in(folder: Path, names: Sequence[str]) -> dict[str, Path]:
    """The files of networks. Raises BodysenseError, naming the command that trains them, where one is missing."""
    paths = {name: folder / f"{name}.pt" for name in names}
    missing = [name for name, path in paths.items() if not path.is_file()]
    if missing:
        raise BodysenseError(
            f"{folder}: no network {', '.join(missing)} in it; train with `bodysense train unoc-tables --data DATA "
            f"--out {folder} --networks {' '.join(missing)}`"
        )
    return paths


def _files(work: Work) -> dict[str, Path | None]:
    """Every method that is to be scored, and the file it depends on."""
    result: dict[str, Path | None] = {
        **work.networks,
        **{f"last_known_{frame}": None for frame in KNOWN},
        "constant_velocity": None,
    }
    if work.shipped is not None:
        result |= dict.fromkeys(("best", "tracker"), work.shipped.model or packaged(PACKAGED))
    return result


@lru_cache(maxsize=16)
def _network(path: Path) -> BodyNetwork:
    return read_weights(path, default_skeleton())
