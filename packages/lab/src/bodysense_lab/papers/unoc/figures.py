"""UNOC's Figures 5 and 7: bodies that a headset's cameras see in part, and fingers predicted from the body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bodysense.body.arms import SIDES
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.geometry.rotation import quaternion_log
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.observing.points import observed_points
from bodysense.pictures.animation import draw_pose
from bodysense.pictures.camera import FollowingCamera, Lens, follow_body
from bodysense.pictures.comparison import View, caption, draw_rows
from bodysense.quality.metrics import joint_error
from bodysense.takes.last_known import last_known
from bodysense_lab.core.scoring import RATE, scored_points
from bodysense_lab.papers.unoc.fingers import synthesize
from bodysense_lab.papers.unoc.ik_tracker import IkTracker
from bodysense_lab.papers.unoc.learned import Learned, load_model
from bodysense_lab.papers.unoc.point_model import PointModel

LENS = Lens(width=190, height=226, aim=0.84, view_height=2.25)
_BODY = Lens(width=190, height=368, aim=0.88, view_height=2.2)  # as high as two hands with their captions
_HAND = Lens(width=150, height=150, distance=0.8, eye=1.0, aim=0.88, view_height=0.3)
_IN_A_ROW = 2  # examples of Figure 7


@dataclass(frozen=True, eq=False)
class Completions:
    """A motion at 30 Hz, the points that a headset sees of it, and its completions."""

    truth: Clip
    seen: np.ndarray  # (T, P) bool
    position: dict[str, np.ndarray]  # (T, P, 3) m: "last known", "network"
    solved: Pose  # (T,) by inverse kinematics, smoothed

    def errors(self) -> dict[str, float]:
        """Return the RMSJPE (cm) of hidden joints of the body by method."""
        truth, points = np.asarray(forward_kinematics(self.truth.pose)[0]), scored_points(self.truth.pose.skeleton)
        found = self.position | {"inverse kinematics": np.asarray(forward_kinematics(self.solved)[0])}
        hidden = ~self.seen[:, points]
        squared = {name: joint_error(one, truth)[:, points][hidden] ** 2 for name, one in found.items()}
        return {name: float(np.sqrt(one.mean())) if one.size else 0.0 for name, one in squared.items()}


def completions(clip: Clip, model: Path | None = None) -> Completions:
    """Complete a motion that a simulated headset sees; `model` is a network file, None the packaged one."""
    clip = resample(clip, RATE)
    skeleton, observation = clip.pose.skeleton, observe(clip.pose, clip.time, HEADSET_CAMERA)
    tracker = IkTracker(Learned(load_model(model), skeleton))
    pose, estimate, _ = tracker.step(observation, tracker.start())
    known = last_known(observation, skeleton)["heading"]
    seen = observed_points(observation, skeleton)[2]
    return Completions(clip, seen, {"last known": known, "network": estimate.position}, pose)


def most_hidden(seen: np.ndarray, count: int) -> list[int]:
    """Return a frame of each of `count` equal parts of a motion: the one in which most points (T, P) are hidden."""
    return [int(part[np.argmin(seen[part].sum(axis=1))]) for part in _parts(len(seen), count)]


def draw_figure_5(found: Completions, frames: Sequence[int], lens: Lens = LENS) -> np.ndarray:
    """Draw Figure 5, (H, W, 3) uint8: truth, last known positions, network, and its IK; hidden joints are red."""
    pose, seen = found.truth.pose, found.seen
    sticks = [View(name, pose, seen, position) for name, position in found.position.items()]
    views = [View("truth", pose, seen), *sticks, View("network, IK", found.solved, seen)]
    return draw_rows(views, RATE, frames, lens)


@dataclass(frozen=True)
class Example:
    """A hand in a frame."""

    frame: int
    side: str


def most_bent(clip: Clip, count: int) -> list[Example]:
    """Return an example of each of `count` equal parts of a motion: the hand whose fingers are bent most."""
    skeleton = clip.pose.skeleton
    wrists = skeleton.wrist_of[: len(skeleton.joints)]
    hands = [np.flatnonzero(wrists == skeleton.index(f"{side}_wrist")) for side in SIDES]
    angle = np.linalg.norm(quaternion_log(np.asarray(clip.pose.rotation)), axis=-1)
    bent = np.stack([angle[:, joints].sum(axis=-1) for joints in hands], axis=-1)  # (T, 2) rad
    examples = []
    for part in _parts(len(clip), count):
        frame, side = np.unravel_index(np.argmax(bent[part]), (len(part), 2))
        examples.append(Example(int(part[frame]), SIDES[side]))
    return examples


def finger_error(truth: Clip, predicted: Clip) -> float:
    """Return the MPJPE (cm) of finger joints and tips from their wrist."""
    wrist = truth.pose.skeleton.wrist_of
    finger = np.flatnonzero(wrist >= 0)
    true, found = (np.asarray(forward_kinematics(one.pose)[0]) for one in (truth, predicted))
    return float(
        joint_error(found[:, finger] - found[:, wrist[finger]], true[:, finger] - true[:, wrist[finger]]).mean()
    )


def predicted_fingers(clip: Clip, model: PointModel | None = None) -> tuple[Clip, Clip]:
    """Return a motion at 30 Hz, and the same body with predicted fingers."""
    clip = resample(clip, RATE)
    return clip, synthesize(clip, model)


def draw_figure_7(truth: Pose, predicted: Pose, examples: Sequence[Example]) -> np.ndarray:
    """Draw Figure 7, (H, W, 3) uint8: for each example the true body, its hand, and the predicted hand below it."""
    blocks = [_block(truth, predicted, example) for example in examples]
    blocks += [np.full_like(blocks[0], 255)] * (-len(blocks) % _IN_A_ROW)
    return np.concatenate([np.concatenate(blocks[k : k + _IN_A_ROW], axis=1) for k in range(0, len(blocks), _IN_A_ROW)])


def _block(truth: Pose, predicted: Pose, example: Example) -> np.ndarray:
    now = slice(example.frame, example.frame + 1)
    camera = follow_body(truth[now], RATE, _BODY)
    body = next(draw_pose(truth[now], camera))
    hands = []
    for title, pose in (("truth", truth[now]), ("from the body", predicted[now])):
        middle = np.asarray(forward_kinematics(pose)[0])[0, pose.skeleton.index(f"{example.side}_middle1")]
        scale = pose.skeleton.height / 1.7
        height = float(middle[1]) - scale * _HAND.aim
        near = FollowingCamera(_HAND, middle[None, [0, 2]], camera.turn, height, scale)
        hands += [caption([title], _HAND.width), next(draw_pose(pose, near))]
    return np.concatenate([body, np.concatenate(hands)], axis=1)


def _parts(length: int, count: int) -> list[np.ndarray]:
    return np.array_split(np.arange(length), min(count, length))
