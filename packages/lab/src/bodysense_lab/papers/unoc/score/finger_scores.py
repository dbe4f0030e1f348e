"""The finger synthesis table: fingers from the motion of the body alone (UNOC, Table 5, right; reproduce.md 1.16).

Errors are those of finger joints and fingertips from their wrist, in its axes, cm. Scored on clips with recorded
fingers. Two baselines know the train split: the mean hand, and the hand of the frame whose body is nearest. Both are
scaled by the length of the wearer's hand. Mirrored frames count as train frames too, for network and baselines alike.

Nearest is by Euclidean distance of a single frame's features, no window: the positions of the body's joints from the
head, in the axes of its heading, at one stature (m), and where both hands point (the wrist's ±X)
and their backs (+Y).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.body.resting import hand_length, local_offset
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    heading,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_rotate,
)
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.quality.metrics import joint_error
from bodysense_lab.core.score_table import ScoreColumn, ScoreRow, ScoreTable, score_report
from bodysense_lab.core.scoring import RATE, Tally
from bodysense_lab.core.table import Report
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.data.augment import mirrored
from bodysense_lab.data.datasets import Census, DataSet
from bodysense_lab.papers.unoc.fingers import FingerSynthesis, synthesize
from bodysense_lab.papers.unoc.point_model import PointModel

METHODS = ("network", "bodysense", "mean_pose", "nearest")  # 'bodysense': after smoothing, on the wearer's rigid bones
TABLE = ScoreTable(
    name="finger-synthesis",
    title="Finger synthesis",
    axes=("method",),
    places={"fingers": ScoreRow(())},
    methods={method: method.replace("_", " ") for method in METHODS},
    figures=(
        ScoreColumn("RMSJPE", "error", "rmsjpe", "{method}_rmsjpe_cm"),
        ScoreColumn("MPJPE", "error", "mpjpe", "{method}_mpjpe_cm"),
    ),
    caption="Finger joints and fingertips from their wrist, cm.",
    digits=2,
)
_CHUNK = 256  # frames that are compared with all train frames at once


@dataclass(frozen=True, eq=False)
class Examples:
    """All train frames."""

    features: np.ndarray  # (N, F) float32
    hand: np.ndarray  # (N, O, 3) float32, offsets in hand lengths

    @property
    def mean(self) -> np.ndarray:
        """(O, 3) the mean hand, in hand lengths."""
        return self.hand.mean(axis=0)

    def nearest(self, features: np.ndarray) -> np.ndarray:
        """(T, O, 3) the hands of the frames nearest to features (T, F)."""
        squared = (self.features**2).sum(axis=1)
        chunks = [features[k : k + _CHUNK] for k in range(0, len(features), _CHUNK)]
        places = [np.argmin(squared - 2 * chunk @ self.features.T, axis=1) for chunk in chunks]
        return self.hand[np.concatenate(places)]


def examples_of(clips: Iterable[Clip]) -> Examples:
    """The frames of canonical clips with fingers at 30 Hz, as recorded and mirrored."""
    features, hands = [], []
    for clip in (resample(clip, RATE) for clip in clips if clip.has_fingers):
        for one in (clip, mirrored(clip)):
            features.append(body_features(one))
            hands.append(finger_offsets(one) / hand_length(one.pose.skeleton))
    if not features:
        raise BodysenseError(
            "finger synthesis: no clip of the train split has fingers; give motion with recorded fingers"
        )
    return Examples(np.concatenate(features).astype(np.float32), np.concatenate(hands).astype(np.float32))


def finger_errors(clip: Clip, examples: Examples, model: PointModel) -> Tallies:
    """Errors (cm) of network and baselines on a clip with fingers, by group, 'fingers', method and measure."""
    clip = resample(clip, RATE)
    truth = finger_offsets(clip)
    found = Tallies()
    for method, offset in answers(clip, examples, model).items():
        found.add(("main", "fingers", method, "error"), joint_error(offset, truth))
    return found


def finger_report(found: Mapping[tuple, Tally], census: Census, data: DataSet) -> Report:
    """Return the table. Raises BodysenseError if no clip was scored."""
    if not found:
        raise BodysenseError("finger synthesis: no clip of the split has fingers; give motion with recorded fingers")
    table = replace(
        TABLE, title=f"{data.name}, {data.split}: {census.clips} clips with fingers, {census.seconds / 60:.1f} minutes"
    )
    return score_report(table, found, census, (), numbers={"seconds": round(census.seconds, 1)})


def answers(clip: Clip, examples: Examples, model: PointModel) -> dict[str, np.ndarray]:
    """Offsets (T, O, 3) m of every method on a clip at 30 Hz."""
    skeleton = clip.pose.skeleton
    method, size = FingerSynthesis(skeleton, model, half_life=0), hand_length(skeleton)
    predicted, _ = method.step(clip.pose, clip.time, method.start())
    order = np.argsort(method.places)
    return {
        "network": predicted[:, order],
        "bodysense": finger_offsets(synthesize(clip, model)),
        "mean_pose": np.broadcast_to(size * examples.mean, predicted.shape),
        "nearest": size * examples.nearest(body_features(clip).astype(np.float32)),
    }


def finger_offsets(clip: Clip) -> np.ndarray:
    """(T, O, 3) m: finger points in the skeleton's order, from their wrist in its axes."""
    skeleton = clip.pose.skeleton
    return local_offset(skeleton, *forward_kinematics(clip.pose))[:, skeleton.wrist_of >= 0]


def body_features(clip: Clip) -> np.ndarray:
    """(T, F) what the nearest body is found by (see the module's text)."""
    skeleton = clip.pose.skeleton
    position, rotation = forward_kinematics(clip.pose)
    head, *wrists = skeleton.indices(["head", "left_wrist", "right_wrist"])
    body = [k for k in range(len(skeleton.joints)) if skeleton.wrist_of[k] < 0 and k != head]
    place = local_offset(skeleton, position, rotation)[:, body] * (1.7 / skeleton.extent)
    away = quaternion_conjugate(heading(rotation[:, head]))[:, None]
    turned = quaternion_multiply(np.repeat(away, len(wrists), axis=1), rotation[:, wrists])
    pointing = np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    axes = [
        quaternion_rotate(turned, np.broadcast_to(axis, (*turned.shape[:-1], 3)))
        for axis in (pointing, np.array([0.0, 1.0, 0.0]))
    ]
    return np.concatenate([part.reshape(len(position), -1) for part in (place, *axes)], axis=1)
