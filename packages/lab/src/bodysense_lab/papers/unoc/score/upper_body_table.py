"""The three-point table: an upper body from a headset and two controllers (UNOC, Table 6; reproduce.md 1.15).

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
from collections.abc import Callable, Mapping

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import THREE_POINT
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.quality.metrics import joint_error
from bodysense_lab.core.score_table import (
    Claim,
    Compared,
    Published,
    ScoreColumn,
    ScoreRow,
    ScoreTable,
    claim,
    pairs,
    score_report,
)
from bodysense_lab.core.scoring import GROUPS, RATE, Tally, group_of, suffix_of
from bodysense_lab.core.table import Report
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.data.datasets import Census, DataSet, describe_data, missing_data_remarks
from bodysense_lab.papers.unoc.ik_tracker import Estimator

METHODS = {"network": "network", "ik": "IK"}
POSES = {"all": "all poses", "standing": "standing"}
SETS = ("UNOC", "Mixamo")
JOINTS = {
    "neck": ("neck",),
    "shoulders": ("left_shoulder", "right_shoulder"),
    "elbows": ("left_elbow", "right_elbow"),
    "all": ("neck", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow"),
}
STANDING_HEIGHT = 0.9
STANDING_LEAN = math.radians(30)
# RMSJPE/MPJPE of neck, shoulders, elbows, all: on UNOC, then on Mixamo. `other_set`: trained on the other of the two.
_PUBLISHED = {
    ("network", "all"): "1.1/0.9 2.7/2.3 3.5/2.9 2.3/1.7 1.7/1.4 4.8/4.0 6.1/4.9 4.0/2.7",
    ("other_set", "all"): "1.7/1.5 4.9/1.5 6.4/5.7 4.1/3.0 2.7/2.3 6.7/5.8 9.9/8.7 6.3/4.6",
    ("ik", "all"): "3.9/3.5 7.5/6.2 10.3/7.8 8.3/6.3 4.1/3.7 13.7/11.3 16.0/12.7 13.4/10.4",
    ("ik", "standing"): "2.5/2.4 7.1/5.7 7.8/5.9 6.7/5.1 3.3/3.0 12.2/10.0 13.9/11.4 11.8/9.2",
}

MakeEstimator = Callable[[Skeleton], Estimator]
At = tuple[str, str]  # poses, joints


def published_on(data: str) -> dict[tuple[At, str], tuple[float, ...]]:
    """Return the paper's RMSJPE and MPJPE, cm, on one of `SETS`, by (poses, joints) and method."""
    first = 4 * SETS.index(data)
    return {
        ((poses, joints), method): pair
        for (method, poses), row in _PUBLISHED.items()
        for joints, pair in zip(JOINTS, pairs(row)[first : first + 4], strict=True)
    }


TABLE = ScoreTable(
    name="unoc-table6",
    title="UNOC, Table 6: upper body from a headset and two controllers",
    axes=("joints", "method"),
    places={
        (poses, joints): ScoreRow(f"{joints}, {label}", joints, "_standing" if poses == "standing" else "")
        for poses, label in POSES.items()
        for joints in JOINTS
    },
    methods=METHODS,
    figures=(
        ScoreColumn("RMSJPE", "error", "rmsjpe", "{method}_{place.key}_rmsjpe_cm{place.ending}"),
        ScoreColumn("MPJPE", "error", "mpjpe", "{method}_{place.key}_mpjpe_cm{place.ending}"),
    ),
    caption="cm, in the world. Over sitting, gestures, everyday motion and locomotion; bending wrists: those of "
    "them with recorded hands. In the others the wrist is stiff and gives the elbow away.",
    published=tuple(
        Published((f"UNOC's RMSJPE on {data}", f"UNOC's MPJPE on {data}"), published_on(data)) for data in SETS
    ),
    claims=(
        *(
            claim(f"{joints}, {label}: the network is better than IK", METHODS, (poses, joints), "network", "ik")
            for poses, label in POSES.items()
            for joints in JOINTS
        ),
        Claim(
            "IK is better at standing poses",
            Compared("standing", ("standing", "all"), "ik"),
            (Compared("all poses", ("all", "all"), "ik"),),
        ),
    ),
    groups=("bending_wrists", *GROUPS[1:]),
)


def upper_body_errors(clip: Clip, methods: Mapping[str, MakeEstimator]) -> Tallies:
    """Errors (cm) of every method on one clip, at 30 Hz; a method makes the estimator for a wearer's skeleton."""
    clip = resample(clip, RATE)
    skeleton = clip.pose.skeleton
    truth, observation = (
        np.asarray(forward_kinematics(clip.pose)[0]),
        observe(clip.pose, clip.time, THREE_POINT),
    )
    shares = {"all": np.full(len(clip), True), "standing": is_standing(skeleton, truth)}
    group = group_of(clip)
    groups = [group, "bending_wrists"] if group == "main" and clip.has_fingers else [group]
    found = Tallies()  # by group of clips, place, method and measure
    for method, make in methods.items():
        estimator = make(skeleton)
        estimate, _ = estimator.step(observation, estimator.start())
        error = joint_error(estimate.position, truth)
        for joints, names in JOINTS.items():
            chosen = error[:, skeleton.indices(names)]
            for poses, mask in shares.items():
                for one in groups:
                    found.add((one, (poses, joints), method, "error"), chosen[mask], clip.person)
    return found


def is_standing(skeleton: Skeleton, position: np.ndarray) -> np.ndarray:
    """(…) bool: whether a body of points (…, P, 3) m stands, as the module's text says."""
    pelvis, neck = (position[..., skeleton.index(name), :] for name in ("pelvis", "neck"))
    rest = (skeleton.path @ skeleton.rest_offset)[:, 1]  # heights below and above the pelvis
    high = pelvis[..., 1] >= -STANDING_HEIGHT * rest.min()
    trunk = neck - pelvis
    return high & (trunk[..., 1] > math.cos(STANDING_LEAN) * np.linalg.norm(trunk, axis=-1))


def upper_body_report(found: Mapping[tuple, Tally], census: Census, data: DataSet) -> Report:
    """Return the table of the network and inverse kinematics."""
    numbers = {"seconds": round(census.seconds, 1)}
    for group in (*GROUPS, "bending_wrists"):
        every, standing = (found.get((group, (poses, "neck"), "ik", "error"), Tally()).count for poses in POSES)
        if every:
            numbers[f"standing_share{suffix_of(group)}"] = standing / every
    return score_report(
        TABLE, found, census, (describe_data(data, census), *missing_data_remarks(SETS, [data])), numbers=numbers
    )
