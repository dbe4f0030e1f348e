"""The three-point table: an upper body from a headset and two controllers (UNOC, Table 6; papers.md 1.15).

Errors are in the world, in cm, of four groups of joints. `neck` is our joint of that name, between upper chest and
head; `all` is neck, shoulders and elbows, for over these five the paper's own rows of Parger et al. come out (both
measures, all poses and standing). Head and hands are measured and count nowhere.

A body stands where its pelvis is at least `STANDING_HEIGHT` of its height in the rest pose above the floor (y = 0) and
the line from pelvis to neck leans by less than `STANDING_LEAN`. The paper does not say what it counts as standing.

Clips without recorded hands have stiff wrists, so that a controller's direction gives the forearm away and with it
the elbow. The group `bending_wrists` are the clips of the main categories with recorded hands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.data.clip import Clip
from bodysense.data.resample import resample
from bodysense.estimators.estimate import Estimator
from bodysense.lab.metrics import joint_error
from bodysense.lab.unoc.headset import GROUPS, RATE, Tally, group_of
from bodysense.lab.unoc.upper_body_ik import UpperBodyIk
from bodysense.occlusion.three_point import observe

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

    `network` makes the estimator for a wearer's skeleton. `advance` is told of every clip that is done.
    """
    methods: dict[str, MakeEstimator] = (
        {"ik": UpperBodyIk} if network is None else {"network": network, "ik": UpperBodyIk}
    )
    tallies: Tallies = {}
    count, seconds = 0, 0.0
    for clip in clips:
        for key, tally in score_clip(clip, methods).items():
            tallies.setdefault(key, Tally()).merge(tally)
        count, seconds = count + 1, seconds + clip.seconds
        advance(clip)
    return UpperBodyTable(tallies, count, seconds)


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
                    tallies.setdefault((group, poses, method, joints), Tally()).add(chosen[mask])
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
