"""The three-point table: an upper body from a headset and two controllers (UNOC, Table 6; papers.md 1.15).

Errors are in the world, in cm, of four groups of joints. `neck` is our joint of that name, between upper chest and
head; `all` is neck, shoulders and elbows, for over these five the paper's own rows of Parger et al. come out (both
measures, all poses and standing). Head and hands are measured and count nowhere.

A body stands where its pelvis is at least `STANDING_HEIGHT` of its height in the rest pose above the floor (y = 0) and
the line from pelvis to neck leans by less than `STANDING_LEAN`. The paper does not say what it counts as standing.

Clips without recorded hands have stiff wrists, so that a controller's direction gives the forearm away and with it
the elbow. The group `bending_wrists` are the clips of the main categories with recorded hands.

The upper body from a headset and two controllers by a network (UNOC, section 5.2); legs stand under it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from bodysense.body.pose import forward_kinematics, resting_offset, standing_pose
from bodysense.body.rotation import (
    quaternion_exp,
    quaternion_rotate,
)
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import Estimator, PointEstimate
from bodysense.devices.simulated.three_point import POINTS, observe
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.metrics import joint_error
from bodysense.observation import Observation, observed_points
from bodysense.papers.ik_tracker import MEASURED_ERROR
from bodysense.papers.point_model import HeadAndHands, PointModel, PointRunner, PointState, load_point_model
from bodysense.scoring import GROUPS, RATE, Tally, group_of
from bodysense_lab.chart import BarPanel, plain_bars
from bodysense_lab.datasets import Census, DataSet, describe, gathered, missing
from bodysense_lab.table import Cell, Report, cell, finite, ordering
from bodysense_lab.unoc.upper_body_ik import UpperBodyIk
from bodysense_lab.weights import packaged

METHODS = {"network": "network", "ik": "IK"}
POSES = {"all": "all poses", "standing": "standing"}
SETS = ("UNOC", "Mixamo")
_PUBLISHED = {  # RMSJPE/MPJPE of neck, shoulders, elbows, all: on UNOC, then on Mixamo
    ("network", "all"): "1.1/0.9 2.7/2.3 3.5/2.9 2.3/1.7 1.7/1.4 4.8/4.0 6.1/4.9 4.0/2.7",
    ("ik", "all"): "3.9/3.5 7.5/6.2 10.3/7.8 8.3/6.3 4.1/3.7 13.7/11.3 16.0/12.7 13.4/10.4",
    ("ik", "standing"): "2.5/2.4 7.1/5.7 7.8/5.9 6.7/5.1 3.3/3.0 12.2/10.0 13.9/11.4 11.8/9.2",
}


def published(method: str, poses: str, joints: str, data: str) -> tuple[float, float] | None:
    """RMSJPE and MPJPE, cm, of a cell of the paper's table; None where it has none."""
    row = _PUBLISHED.get((method, poses))
    if row is None:
        return None
    rmsjpe, mpjpe = row.split()[4 * SETS.index(data) + list(JOINTS).index(joints)].split("/")
    return float(rmsjpe), float(mpjpe)


def upper_body_report(table: UpperBodyTable, census: Census, data: DataSet) -> Report:
    """The table of inverse kinematics and, if it was scored, the network."""
    groups = [group for group in ("bending_wrists", *GROUPS[1:]) if table.get(group, "all", "ik", "neck").count]
    return Report(
        name="unoc-table6",
        title="UNOC, Table 6: upper body from a headset and two controllers",
        columns=(
            *("joints", "method", "RMSJPE", "MPJPE"),
            *(f"{measure} on {name}" for name in SETS for measure in ("UNOC's RMSJPE", "UNOC's MPJPE")),
            *(f"{group.replace('_', ' ')} RMSJPE" for group in groups),
        ),
        rows=tuple(_rows(table, groups)),
        numbers=finite(table.numbers()) | census.numbers(),
        data=(describe(data, census), *missing(SETS, [data])),
        remarks=tuple(_remarks(table)),
        caption="cm, in the world. Over sitting, gestures, everyday motion and locomotion; bending wrists: those of "
        "them with recorded hands. In the others the wrist is stiff and gives the elbow away.",
        panels=tuple(_panels(table)),
    )


def _rows(table: UpperBodyTable, groups: list[str]) -> Iterator[tuple[Cell, ...]]:
    for poses, where in POSES.items():
        for joints in JOINTS:
            for method, name in METHODS.items():
                ours = table.get("main", poses, method, joints)
                theirs = [value for one in SETS for value in published(method, poses, joints, one) or (None, None)]
                others = (cell(table.get(group, poses, method, joints).rmsjpe) for group in groups)
                if ours.count or theirs[0] is not None:
                    yield (f"{joints}, {where}", name, cell(ours.rmsjpe), cell(ours.mpjpe), *theirs, *others)


def _remarks(table: UpperBodyTable) -> Iterator[str]:
    for poses, where in POSES.items():
        for joints in JOINTS:
            network, ik = (table.get("main", poses, m, joints).named(METHODS[m], "rmsjpe") for m in ("network", "ik"))
            verdict = ordering(f"{joints}, {where}: the network is better than IK", network, [ik], "cm")
            if verdict is not None:
                yield verdict
    of_ik = {where: table.get("main", poses, "ik", "all") for poses, where in POSES.items()}
    every, standing = (tally.named(where, "rmsjpe") for where, tally in of_ik.items())
    verdict = ordering("IK is better at standing poses", standing, [every], "cm")
    if verdict is not None:
        yield verdict
    if not table.get("main", "all", "network", "all").count:
        yield "The network was not scored: give one with --model."


def _panels(table: UpperBodyTable) -> Iterator[BarPanel]:
    for method, name in METHODS.items():
        ours = [cell(table.get("main", "all", method, joints).rmsjpe) for joints in JOINTS]
        series = [plain_bars("ours", ours)]
        for one in SETS:
            theirs = [published(method, "all", joints, one) for joints in JOINTS]
            series.append(plain_bars(f"published, {one}", [pair[0] if pair else None for pair in theirs]))
        yield BarPanel(f"{name}, all poses", tuple(JOINTS), tuple(series), "RMSJPE, cm")


JOINTS = {
    "neck": ("neck",),
    "shoulders": ("left_shoulder", "right_shoulder"),
    "elbows": ("left_elbow", "right_elbow"),
    "all": ("neck", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow"),
}
STANDING_HEIGHT = 0.9
STANDING_LEAN = math.radians(30)

MakeEstimator = Callable[[Skeleton], Estimator]
Tallies = dict[tuple[str, str, str, str], Tally]  # by group of clips, poses ('all', 'standing'), method, joints


@dataclass(frozen=True)
class UpperBodyTable:
    """Errors of every method by group of clips, poses and joints."""

    tallies: Tallies = field(repr=False)
    clips: int
    seconds: float

    def numbers(self) -> dict[str, float]:
        """One flat object: `ik_neck_rmsjpe_cm`, then `_standing`, then `_sport` …; without the last: main."""
        result: dict[str, float] = {"clips": self.clips, "seconds": round(self.seconds, 1)}
        for (group, poses, method, joints), tally in self.tallies.items():
            suffix = ("_standing" if poses == "standing" else "") + ("" if group == "main" else f"_{group}")
            for measure in ("rmsjpe", "mpjpe"):
                if tally.count:
                    result[f"{method}_{joints}_{measure}_cm{suffix}"] = getattr(tally, measure)
        for group in (*GROUPS, "bending_wrists"):
            every, standing = (self.get(group, poses, "ik", "neck") for poses in ("all", "standing"))
            if every.count:
                result["standing_share" + ("" if group == "main" else f"_{group}")] = standing.count / every.count
        return result

    def get(self, group: str, poses: str, method: str, joints: str) -> Tally:
        """One cell; empty where nothing was counted."""
        return self.tallies.get((group, poses, method, joints), Tally())


def evaluate_upper_body(
    clips: Iterable[Clip], network: MakeEstimator | None, advance: Callable[[Clip], None]
) -> UpperBodyTable:
    """Score inverse kinematics and, where one is given, a network on what headset and controllers track of clips.

    `network` makes the estimator for a wearer's skeleton. `advance` is called after every clip.
    """
    methods: dict[str, MakeEstimator] = (
        {"ik": UpperBodyIk} if network is None else {"network": network, "ik": UpperBodyIk}
    )
    tallies, census = gathered(partial(score_clip, methods=methods), clips, 1, advance)
    return UpperBodyTable(tallies, census.clips, census.seconds)


def score_clip(clip: Clip, methods: Mapping[str, MakeEstimator]) -> Tallies:
    """Errors of every method on one clip, at 30 Hz."""
    clip = resample(clip, RATE)
    skeleton = clip.pose.skeleton
    truth, observation = np.asarray(forward_kinematics(clip.pose)[0]), observe(clip.pose, clip.time)
    shares = {"all": np.full(len(clip), True), "standing": is_standing(skeleton, truth)}
    tallies: Tallies = {}
    for method, make in methods.items():
        estimator = make(skeleton)
        estimate, _ = estimator.step(observation, estimator.start())
        error = joint_error(estimate.position, truth)
        for joints, names in JOINTS.items():
            chosen = error[:, skeleton.indices(names)]
            for poses, mask in shares.items():
                for group in _groups(clip):
                    tallies.setdefault((group, poses, method, joints), Tally()).add(chosen[mask], clip.person)
    return tallies


def is_standing(skeleton: Skeleton, position: np.ndarray) -> np.ndarray:
    """(…) bool: whether a body of points (…, P, 3) m stands, as the module's text says."""
    pelvis, neck = (position[..., skeleton.index(name), :] for name in ("pelvis", "neck"))
    rest = (skeleton.path @ skeleton.rest_offset)[:, 1]  # heights below and above the pelvis
    high = pelvis[..., 1] >= -STANDING_HEIGHT * rest.min()
    trunk = neck - pelvis
    return high & (trunk[..., 1] > math.cos(STANDING_LEAN) * np.linalg.norm(trunk, axis=-1))


def _groups(clip: Clip) -> list[str]:
    """The groups in which a clip counts."""
    group = group_of(clip)
    return [group, "bending_wrists"] if group == "main" and clip.has_fingers else [group]


LOST_ERROR = 0.15  # m: of a hand that is not tracked now
FINGER_ERROR = 0.03  # m: of a relaxed finger about its wrist
LEG_ERROR = 0.5  # m: of legs, of which nothing is known
_FITS = 3  # rounds in which an arm is fitted to its bones


def load_upper_body(path: Path | None = None) -> PointModel:
    """Load a network of the upper body: a path, or None for the packaged one. Raises as `load_point_model` does."""
    return load_point_model("upper-body", path or packaged("upper_body.onnx"))


@dataclass(frozen=True, eq=False)
class LearnedUpperBodyState:
    """State of the network, and the last poses of head and hands."""

    network: PointState
    last: HeadAndHands


@dataclass(frozen=True)
class LearnedUpperBody:
    """Upper body of a skeleton from `head`, `left_wrist` and `right_wrist`, each where tracked.

    A hand that is lost stays where it was relative to the head; one that was never seen hangs. Fingers are relaxed. The
    legs stand under the pelvis, turned as the shoulders are, with a large expected error. What the network says of the
    arms is fitted to their bones and the measured hands.
    """

    skeleton: Skeleton
    model: PointModel

    @cached_property
    def _runner(self) -> PointRunner:
        return PointRunner(self.model, self.skeleton)

    @cached_property
    def _places(self) -> np.ndarray:
        return self.skeleton.indices(self.model.places)

    @cached_property
    def _oriented(self) -> np.ndarray:
        return self.skeleton.indices(POINTS)

    @cached_property
    def _order(self) -> list[int]:
        return [POINTS.index(name) for name in self.model.reads]

    @cached_property
    def _expected_error(self) -> np.ndarray:
        """(P,) m, of points that neither the device nor the network gives."""
        error = np.where(self.skeleton.wrist_of >= 0, FINGER_ERROR, LEG_ERROR)
        error[self._oriented] = LOST_ERROR
        error[self.skeleton.index("head_top")] = MEASURED_ERROR
        return error

    def start(self) -> LearnedUpperBodyState:
        """Nothing seen yet: a standing body that faces +Z."""
        return LearnedUpperBodyState(self._runner.start(), HeadAndHands.standing(self.skeleton))

    def step(
        self, observation: Observation, state: LearnedUpperBodyState
    ) -> tuple[PointEstimate, LearnedUpperBodyState]:
        """Complete T frames, one after the other."""
        position, rotation, has_position, has_rotation = observed_points(observation, self.skeleton)
        known = self._oriented
        positions, errors = [], []
        for t, time in enumerate(observation.time):
            seen = (values[t, known] for values in (position, rotation, has_position, has_rotation))
            whole, error, state = self._complete(float(time), replace(state, last=state.last.seen(*seen)))
            positions.append(np.where(has_position[t, :, None], position[t], whole))
            errors.append(np.where(has_position[t], MEASURED_ERROR, error))
        estimate = PointEstimate(self.skeleton, np.stack(positions), (~has_position).astype(float), np.stack(errors))
        return estimate, state

    def _complete(
        self, time: float, state: LearnedUpperBodyState
    ) -> tuple[np.ndarray, np.ndarray, LearnedUpperBodyState]:
        """Positions (P, 3) m and expected errors (P,) m of the whole body in one frame."""
        skeleton = self.skeleton
        position, rotation = state.last.world
        placed, expected, network = self._runner.step(position[self._order], rotation, time, state.network)

        whole = np.zeros((len(skeleton.points), 3))
        whole[self._places], whole[self._oriented] = placed, position
        shoulders, elbows, wrists = self._arms
        upper, fore = self.skeleton.bone_length[elbows, None], self.skeleton.bone_length[wrists, None]
        whole[shoulders], whole[elbows] = fitted_arms(whole[shoulders], whole[elbows], whole[wrists], upper, fore)
        left, right, pelvis = skeleton.indices(["left_shoulder", "right_shoulder", "pelvis"])
        across = whole[left] - whole[right]
        turn = quaternion_exp(np.array([0.0, np.arctan2(-across[2], across[0]), 0.0]))
        legs = self._legs
        whole[legs] = whole[pelvis] + quaternion_rotate(np.tile(turn, (len(legs), 1)), self._standing[legs])
        head_top = skeleton.index("head_top")
        whole[head_top] = position[0] + quaternion_rotate(rotation[0], skeleton.rest_offset[head_top])
        for k, finger in enumerate(self._fingers):
            about = np.tile(rotation[k + 1], (len(finger), 1))
            whole[finger] = position[k + 1] + quaternion_rotate(about, self._relaxed[finger])
        error = self._expected_error.copy()
        error[self._places] = expected
        return whole, error, replace(state, network=network)

    @cached_property
    def _arms(self) -> list[np.ndarray]:
        """Left and right shoulder, elbow, wrist."""
        parts = ("shoulder", "elbow", "wrist")
        return [self.skeleton.indices([f"left_{part}", f"right_{part}"]) for part in parts]

    @cached_property
    def _standing(self) -> np.ndarray:
        """(P, 3) m from the pelvis of a standing body."""
        position, _ = forward_kinematics(standing_pose(self.skeleton))
        return position - position[self.skeleton.index("pelvis")]

    @cached_property
    def _relaxed(self) -> np.ndarray:
        return resting_offset(self.skeleton)

    @cached_property
    def _fingers(self) -> list[np.ndarray]:
        """Points of the left and the right hand's fingers."""
        return [np.flatnonzero(self.skeleton.wrist_of == wrist) for wrist in self._oriented[1:]]

    @cached_property
    def _legs(self) -> np.ndarray:
        """Every point that nothing else gives."""
        other = {*self._places.tolist(), *self._oriented.tolist(), self.skeleton.index("head_top")}
        other |= set(np.flatnonzero(self.skeleton.wrist_of >= 0).tolist())
        return np.array([point for point in range(len(self.skeleton.points)) if point not in other])


def fitted_arms(
    shoulder: np.ndarray, elbow: np.ndarray, wrist: np.ndarray, upper: np.ndarray, fore: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Shoulders and elbows (N, 3) moved a little so that bones (N, 1) fit measured wrists (N, 3), all metres.

    The forearm has its length; the upper arm nearly, its error shared by both ends (after FABRIK, Aristidou 2011).
    """
    elbow = wrist + _with_length(elbow - wrist, fore)
    for _ in range(_FITS):
        bone = elbow - shoulder
        change = (_with_length(bone, upper) - bone) / 2
        shoulder = shoulder - change
        elbow = wrist + _with_length(elbow + change - wrist, fore)
    return shoulder, elbow


def _with_length(vector: np.ndarray, length: np.ndarray) -> np.ndarray:
    return vector * (length / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-9))
