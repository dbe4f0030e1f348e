"""Arms and hands from key-points of a video by a window network: `bodysense_lab/papers/pahmt/network.py`, ONNX Runtime.

The network takes windows of 32 frames, one second. Windows start every `stride` seconds and overlap. Their predictions
of a frame are blended, with more weight for the middle of a window than for its ends. A frame is output when a frame
has arrived that is `look_ahead` later; this is the latency of live use. With 0 each frame is output at once, from one
window that ends with it. One call with many frames equals many calls with one.

Frames may come at any rate; windows are resampled at the network's rate. After `longest_gap` without a frame everything
is reset.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.body.arms import ARM_JOINTS, SIDES, with_arms
from bodysense.body.keypoints import ArmKeypoints, body_torso, check_keypoints
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.devices.video.arm_geometry.window import TIME_TOLERANCE, ArmFrame, align_signs, smooth_window, window_of
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import normalize, quaternion_canonical, quaternion_conjugate, quaternion_multiply
from bodysense.observing.checks import check_order
from bodysense.weights.formats import ARMS
from bodysense.weights.network import Network

UNSEEN_ERROR = 0.5  # m, expected error of points other than arms and hands, which always stand
_ENDS = 0.1  # weight of a window's last frame relative to its middle
_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class ArmModel:
    """A network of arms and hands."""

    network: Network

    @property
    def card(self) -> Mapping[str, Any]:
        """The network file's metadata."""
        return self.network.card

    def rotations(self, window: dict[str, np.ndarray]) -> np.ndarray:
        """Return local rotations (T, 38, 4) for a window's key-points (T, …) by field, which must be finite."""
        return self.network.run({name: value[None] for name, value in window.items()})["rotation"][0].astype(float)


def load_arms(path: str | Path | None = None) -> ArmModel:
    """Load a network from a path, or the packaged one for None. Raises BodysenseError for other files."""
    network = Network.open(path, ARMS)
    if tuple(network.card["joints"]) != ARM_JOINTS:
        raise BodysenseError(
            f"{network.name}: its joints are not those of this version; export it again with `{ARMS.command}`"
        )
    return ArmModel(network)


@dataclass(frozen=True)
class ArmSettings:
    """Settings of the windows."""

    look_ahead: float = 0.25  # s to wait for later frames; 0 outputs at once
    stride: float = 0.1  # s from one window to the next
    smoothing: float = 0.03  # s, standard deviation of the smoothing of a window's key-points over time
    longest_gap: float = 0.5  # s without frames after which everything is reset

    def __post_init__(self) -> None:
        if not 0 <= self.look_ahead <= 0.5:
            raise BodysenseError(f"look-ahead {self.look_ahead:g} s; give 0 to 0.5, half of the network's window")
        if not self.smoothing > 0:
            raise BodysenseError(f"smoothing of key-points over {self.smoothing:g} s; give more than 0")
        if not (self.stride > 0 and 0 < self.longest_gap <= 0.5):
            raise BodysenseError(f"stride {self.stride:g} s, longest gap {self.longest_gap:g} s: give up to 0.5 each")


@dataclass(frozen=True, eq=False)
class ArmFrames:
    """Completed frames in the camera's axes, +y up."""

    time: np.ndarray  # (T,) s
    estimate: PointEstimate  # a standing body, rotated as the torso, with the network's arms and hands

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True, eq=False)
class ArmState:
    """Frames of the last second, some of which wait for output."""

    frames: tuple[ArmFrame, ...] = ()
    waiting: int = 0  # number of last frames that wait for output
    window: float = -np.inf  # s, time of the last window's last frame


@dataclass(frozen=True, eq=False)
class Arms:
    """Estimator of both arms and hands of a skeleton from key-points. Immutable; state is an argument."""

    skeleton: Skeleton
    model: ArmModel
    settings: ArmSettings = field(default_factory=ArmSettings)

    def start(self) -> ArmState:
        """Return the initial state."""
        return ArmState()

    def complete(self, keypoints: ArmKeypoints) -> ArmFrames:
        """Complete all frames at once: `step`, then `finish`."""
        ready, state = self._add_frames(keypoints, self.start())
        return self._to_body([*ready, *self._flush(state)])

    def step(self, keypoints: ArmKeypoints, state: ArmState) -> tuple[ArmFrames, ArmState]:
        """Add T ≥ 1 frames; return the frames that are ready, and the state.

        Raises BodysenseError for malformed key-points (`check_keypoints`), and if time does not increase.
        """
        ready, state = self._add_frames(keypoints, state)
        return self._to_body(ready), state

    def finish(self, state: ArmState) -> ArmFrames:
        """Return the remaining frames at the end of a video."""
        return self._to_body(self._flush(state))

    def _add_frames(self, keypoints: ArmKeypoints, state: ArmState) -> tuple[list[ArmFrame], ArmState]:
        """Add frames one by one; return those that are ready, and the state."""
        ready: list[ArmFrame] = []
        for frame in _frames(check_keypoints(keypoints)):
            last = state.frames[-1] if state.frames else frame
            check_order(frame.time, state.frames[-1].time if state.frames else None, "arms")
            if frame.time - last.time > self.settings.longest_gap:
                ready += self._flush(state)
                state, last = self.start(), frame
            torso = frame.torso if frame.values["has_torso"] else last.torso
            frames = (*state.frames, replace(frame, torso=torso))
            state = replace(state, frames=frames, waiting=state.waiting + 1)
            due = sum(one.time + self.settings.look_ahead <= frame.time + TIME_TOLERANCE for one in _waiting(state))
            ready_now = slice(len(state.frames) - state.waiting, len(state.frames) - state.waiting + due)
            is_late = due > 0 and state.window < state.frames[ready_now][-1].time
            if is_late or frame.time - state.window >= self.settings.stride - TIME_TOLERANCE:
                state = self._run_window(state)
            ready += state.frames[ready_now]
            state = self._drop_old(replace(state, waiting=state.waiting - due))
        return ready, state

    @property
    def _span(self) -> float:
        """Time (s) from a window's first frame to its last."""
        return (int(self.model.card["frames"]) - 1) / float(self.model.card["rate"])

    def _flush(self, state: ArmState) -> list[ArmFrame]:
        """Return the waiting frames, predicted with the frames so far."""
        if state.waiting and state.window < state.frames[-1].time:
            state = self._run_window(state)
        return list(_waiting(state))

    def _drop_old(self, state: ArmState) -> ArmState:
        """Drop frames that no window needs; keep one earlier frame for interpolation."""
        first = 0
        while first + 1 < len(state.frames) - state.waiting and (
            state.frames[first + 1].time < state.frames[-1].time - self._span
        ):
            first += 1
        return replace(state, frames=state.frames[first:])

    def _run_window(self, state: ArmState) -> ArmState:
        """Add the prediction of a window that ends with the last frame to the waiting frames."""
        count, rate = int(self.model.card["frames"]), float(self.model.card["rate"])
        now = state.frames[-1].time
        time = now - np.arange(count - 1, -1, -1) / rate
        predicted = self.model.rotations(smooth_window(window_of(state.frames, time), time, self.settings.smoothing))
        begin = len(state.frames) - state.waiting
        frames = list(state.frames[:begin])
        for frame in _waiting(state):
            place = max(count - 1 - (now - frame.time) * rate, 0.0)
            before = min(int(place + TIME_TOLERANCE), count - 2)
            share = place - before
            after = align_signs(predicted[before + 1], predicted[before])
            turn = np.asarray(normalize(predicted[before] + share * (after - predicted[before])))
            middle = (count - 1) / 2
            weight = _ENDS + (1 - _ENDS) * (1 - abs(place - middle) / middle)
            total = (
                weight * turn
                if frame.rotation_sum is None
                else frame.rotation_sum + weight * align_signs(turn, frame.rotation_sum)
            )
            frames.append(replace(frame, rotation_sum=total))
        return ArmState(tuple(frames), state.waiting, now)

    @cached_property
    def _standing(self) -> tuple[Pose, np.ndarray]:
        """The standing body, and the rotation (4,) from its torso's axes to its root's."""
        pose = standing_pose(self.skeleton)
        return pose, np.asarray(quaternion_conjugate(body_torso(pose)))

    @cached_property
    def _kind(self) -> np.ndarray:
        """(P,) kind of each point: 0 and 1 left and right arm, 2 and 3 left and right fingers, 4 others."""
        arm = ("shoulder", "elbow", "wrist")
        kinds = []
        for point, name in enumerate(self.skeleton.points):
            side, _, part = name.partition("_")
            hand = self.skeleton.wrist_of[point] >= 0
            kinds.append(4 if not (hand or part in arm) else SIDES.index(side) + 2 * hand)
        return np.array(kinds)

    def _to_body(self, frames: list[ArmFrame]) -> ArmFrames:
        """Return the skeleton's body in frames with predicted rotations."""
        pose, from_torso = self._standing
        predicted = np.zeros((0, len(ARM_JOINTS), 4))
        if frames:
            predicted = np.stack([one.rotation_sum for one in frames if one.rotation_sum is not None])
        turned = with_arms(pose, np.asarray(quaternion_canonical(normalize(predicted))))
        torso = np.array([one.torso for one in frames]).reshape(-1, 4)
        root = quaternion_multiply(torso, np.broadcast_to(from_torso, torso.shape))
        turned.rotation[:, 0] = quaternion_canonical(root)
        found = np.ones((len(frames), 5))
        for t, one in enumerate(frames):
            found[t, :4] = 1.0 - np.concatenate([one.values["has_arm"], one.values["has_hand"]])
        figures = self.model.card["validation"]
        error = np.array([figures["overall_m"]] * 2 + [figures["overall_m"] + figures["hands_m"]] * 2 + [UNSEEN_ERROR])
        estimate = PointEstimate(
            skeleton=self.skeleton,
            position=np.asarray(forward_kinematics(turned)[0]),
            occluded=found[:, self._kind],
            confidence=np.broadcast_to(error[self._kind], (len(frames), len(self._kind))).copy(),
            pose=turned,
        )
        return ArmFrames(np.array([one.time for one in frames]), estimate)


def _frames(keypoints: ArmKeypoints) -> Iterator[ArmFrame]:
    """Iterate over key-points frame by frame; missing values are replaced by finite ones."""
    masks = {"arm": "has_arm", "torso": "has_torso", "hand": "has_hand"}
    values = {name: np.nan_to_num(np.asarray(getattr(keypoints, name), dtype=np.float32)) for name in masks}
    values |= {mask: np.asarray(getattr(keypoints, mask), dtype=bool) for mask in masks.values()}
    values["torso"][np.logical_not(values["has_torso"])] = _UPRIGHT
    for t, time in enumerate(keypoints.time):
        row = {name: value[t] for name, value in values.items()}
        yield ArmFrame(float(time), row, row["torso"].astype(float))


def _waiting(state: ArmState) -> Sequence[ArmFrame]:
    return state.frames[len(state.frames) - state.waiting :]
