"""Protocol 1 of AvatarPoser on AMASS: its published split, one body for all people, and the measures of later papers.

Jiang et al., AvatarPoser, ECCV 2022: CMU, BMLrub and HDM05 at 60 Hz, split by the file names in `data_split` of
github.com/eth-siplab/AvatarPoser. The same people are in both parts. All people have the mean body of one model
(without `betas`), with 22 joints. The measures are those of AGRoL (Du et al., CVPR 2023): means over frames and joints
of a clip, then over clips, with the predicted head moved to the true one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY, LOWER_BODY
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import THREE_POINT
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp, quaternion_log
from bodysense.io.clip import Clip
from bodysense.io.datasets.sources import Source
from bodysense.io.datasets.splits import Split, hash_share
from bodysense.io.formats.amass import read_amass
from bodysense.io.formats.body_model import read_model
from bodysense.io.placement import apply_placement, footing_of, placement_of
from bodysense.io.resample import resample
from bodysense.quality.metrics import jitter, joint_error, velocity_error
from bodysense_lab.completion.score.tracking import TrackPeople
from bodysense_lab.core.intervals import Interval
from bodysense_lab.core.scoring import Tally
from bodysense_lab.core.table import Cell, Report
from bodysense_lab.papers.hmd_vae.tables import PUBLISHED

RATE = 60.0  # Hz
SET_FOLDERS = {  # folder of the lists: folders of AMASS's releases
    "CMU": ("CMU",),
    "BioMotionLab_NTroje": ("BioMotionLab_NTroje", "BMLrub"),
    "MPI_HDM05": ("MPI_HDM05", "HDM05"),
}
VALIDATION_SHARE = 0.05  # share of the training files that are the validation split
JOINT_GROUPS = {  # joints of the position errors
    "mpjpe_cm": BODY,
    "hand_cm": ("left_wrist", "right_wrist"),
    "upper_cm": tuple(name for name in BODY if name not in LOWER_BODY),
    "lower_cm": LOWER_BODY,
    "root_cm": ("pelvis",),
}
COLUMNS = {
    "MPJRE °": "mpjre_deg",
    "MPJPE cm": "mpjpe_cm",
    "MPJVE cm/s": "mpjve_cm_s",
    "hand": "hand_cm",
    "upper": "upper_cm",
    "lower": "lower_cm",
    "root": "root_cm",
    "jitter": "jitter",
}
_PARTS: tuple[tuple[str, Split], ...] = (("train", "train"), ("test", "test"))
_NAME_ENDING = re.compile(r"(poses|stageii)$")  # of a name, in the first releases and the newer ones


def listed_sources(directory: Path, lists: Path) -> tuple[list[Source], int]:
    """Return the files of AMASS in `directory` that the lists name, with their split, and the number of missing files.

    Differences of spelling between AMASS's releases are ignored: `_poses` and `_stageii`, spaces and underscores. A
    twentieth of the training files, by the hash of the name, is the validation split. Raises BodysenseError if a list
    is missing, or if no file of the training or of the test list is found.
    """
    files = {
        (name, *_normalized_path(path.relative_to(directory / folder))): path
        for name, folders in SET_FOLDERS.items()
        for folder in folders
        for path in (directory / folder).rglob("*.npz")
    }
    sources: list[Source] = []
    missing = 0
    for part, split in _PARTS:
        found = len(sources)
        for name in SET_FOLDERS:
            for line in _lines(lists / name / f"{part}_split.txt"):
                path_in_set = _path_in_set(line, name)
                path = files.get((name, *_normalized_path(path_in_set)))
                if path is not None:
                    is_validation = split == "train" and hash_share(path_in_set.as_posix()) < VALIDATION_SHARE
                    person = f"{name}_{path_in_set.parts[0]}"
                    sources.append(Source(path, person, "val" if is_validation else split))
                elif path_in_set.name != "shape.npz":  # it contains a body's shape, no motion
                    missing += 1
        if len(sources) == found:
            raise BodysenseError(
                f"{directory}: no file of the {part} lists of {lists} is in it; give the folder that contains AMASS's "
                f"{', '.join(SET_FOLDERS)} (or {', '.join(folders[-1] for folders in SET_FOLDERS.values())})"
            )
    return sources, missing


def _lines(path: Path) -> list[str]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise BodysenseError(
            f"--split-lists: {path} cannot be read ({error.strerror}); give the folder data_split of a clone of "
            "github.com/eth-siplab/AvatarPoser"
        ) from None
    return [line.strip() for line in lines if line.strip()]


def _path_in_set(line: str, name: str) -> PurePosixPath:
    """Return the path of a listed file, relative to the folder of its set."""
    parts = PurePosixPath(line).parts
    if name not in parts[:-1]:
        raise BodysenseError(
            f"--split-lists: {line!r} is not a file in a folder {name}; correct the list, or download it again"
        )
    return PurePosixPath(*parts[parts.index(name) + 1 :])


def _normalized_path(path: Path | PurePosixPath) -> tuple[str, ...]:
    plain = [re.sub(r"[\W_]", "", part.lower()) for part in path.with_suffix("").parts]
    return (*plain[:-1], _NAME_ENDING.sub("", plain[-1]))


def read_clip(source: Source, model: Path | None) -> Clip:
    """Read a motion at `RATE` on the mean body of a model (None: the default body), with its soles on the floor."""
    if model is None:
        clip = read_amass(source.path)
    else:
        shape = read_model(model).shape(np.zeros(0))
        clip = read_amass(source.path, shape.skeleton, shape.pelvis)
    clip = resample(clip, RATE)
    return replace(apply_placement(clip, placement_of(footing_of(clip), has_bones=True)), person=source.person)


def score_source(source: Source, model: Path | None, track: TrackPeople) -> dict[str, float]:
    """Return the measures of a file's motion, tracked from head and hands frame by frame, on its known body."""
    clip = read_clip(source, model)
    pose = clip.pose
    truth = np.asarray(forward_kinematics(pose)[0])[:, :22]
    seen = observe(pose, clip.time, THREE_POINT)
    (tracked,) = track([Person(pose.skeleton)], [seen])
    return measure(tracked.position[:, :22], tracked.rotation[:, :22], truth, pose.rotation[:, :22])


def measure(
    position: np.ndarray, rotation: np.ndarray, true_position: np.ndarray, true_rotation: np.ndarray
) -> dict[str, float]:
    """Return the measures of positions (T, 22, 3) m and local rotations (T, 22, 4) at `RATE`."""
    head = BODY.index("head")
    position = position - position[:, [head]] + true_position[:, [head]]
    error = joint_error(position, true_position)
    found = {key: float(error[:, [BODY.index(one) for one in names]].mean()) for key, names in JOINT_GROUPS.items()}
    # 21 joints, without the root.
    difference = quaternion_log(true_rotation[:, 1:]) - quaternion_log(rotation[:, 1:])
    difference = quaternion_log(quaternion_exp(difference))
    return found | {
        "mpjre_deg": float(np.degrees(np.abs(difference)).mean()),
        "mpjve_cm_s": velocity_error(position, true_position, RATE),
        "jitter": jitter(position, RATE),
        "truth_jitter": jitter(true_position, RATE),
    }


def mpjpe_interval(people: Sequence[str], scores: Sequence[dict[str, float]]) -> Interval:
    """Return the mean MPJPE over clips, cm, and its bootstrap interval; `people` has the person of each clip."""
    errors = Tally()
    for person, one in zip(people, scores, strict=True):
        errors.add(np.array(one["mpjpe_cm"]), person)
    return errors.interval()


def protocol_report(scores: Sequence[dict[str, float]], remarks: Sequence[str], network: str) -> Report:
    """Return the table: means over clips, next to the published figures."""
    means = {key: float(np.mean([one[key] for one in scores])) for key in scores[0]}
    none: tuple[Cell, ...] = (None,) * 4
    rows: list[tuple[Cell, ...]] = [("", f"bodysense, {network}", *(means[key] for key in COLUMNS.values()))]
    rows.append(("", "the motion itself", *(None,) * (len(COLUMNS) - 1), means["truth_jitter"]))
    rows += [("published", name, *three, *none, jerk) for name, (*three, jerk) in PUBLISHED.items()]
    return Report(
        name="amass-p1",
        title="AMASS, protocol 1: head and hands",
        columns=("", "method", *COLUMNS),
        rows=tuple(rows),
        numbers=means | {"clips": len(scores)},
        data=tuple(remarks),
        caption="22 joints at 60 Hz, means over clips. Local rotations without the root's, mean difference of "
        "axis-angle components; cm from the true head; jitter 10² m/s³. bodysense is given the floor and the body.",
        digits=2,
    )
