"""Windows of motion as HMD-VAE sees them: in axes of their own, as recorded or in the mirror.

Where the origin is. The paper puts it at the pelvis of every frame and faces the pelvis' heading in the last one: that
tells the network where the pelvis is and where it faces, what no headset knows. `origin='pelvis'` is that, for
comparison; with 'head', the default, the origin is under the head in the last frame of the window, +Z is the head's
heading there, heights are over the floor, and positions in the likelihood are from the head.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from bodysense.body.body_joints import body_skeleton
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.geometry.rotation import heading, quaternion_conjugate, quaternion_multiply, quaternion_rotate
from bodysense_lab.data.windows import Windows
from bodysense_lab.papers.hmd_vae.frames import BodyFrames
from bodysense_lab.papers.hmd_vae.options import BodyVaeConfig, Origin


class Joints(NamedTuple):
    """Joints over time."""

    position: Tensor  # (B, T, P, 3) m
    rotation: Tensor  # (B, T, P, 4) wxyz


class HeadFrame(NamedTuple):
    """Where the axes of a window stand in the world."""

    start: Tensor  # (B, 1 or T, 3) m
    facing: Tensor  # (B, 4) wxyz, world ← frame: a turn about +Y


def frame_of(origin: Origin, position: Tensor, rotation: Tensor) -> HeadFrame:
    """The axes of a window from the joint `origin` in it: (B, T, 3) m, (B, T, 4) wxyz, world."""
    if origin == "pelvis":
        return HeadFrame(position, heading(rotation[:, -1]))
    return HeadFrame(position[:, -1:] * position.new_tensor([1.0, 0.0, 1.0]), heading(rotation[:, -1]))


def seen_from(frame: HeadFrame, joints: Joints) -> Joints:
    """Joints of the world in the axes of a window."""
    away = quaternion_conjugate(frame.facing)[:, None, None].expand_as(joints.rotation)
    position = quaternion_rotate(away, joints.position - frame.start[:, :, None])
    return Joints(position, quaternion_multiply(away, joints.rotation))


class VaeBatch(NamedTuple):
    """Windows in their own axes."""

    seen: Joints  # (B, T, P): what the encoder reads
    truth: Joints  # (B, 22): the last frame
    rest_offset: Tensor  # (B, 22, 3) m
    frame: HeadFrame


def make_batch(config: BodyVaeConfig, frames: BodyFrames, windows: Windows, which: np.ndarray) -> VaeBatch:
    """Some windows, by their numbers; an encoder that sees one frame gets the last."""
    reads = [BODY.index(name) for name in config.reads]
    history = windows.frames(which)[:, -config.frames :]
    last = history[:, -1]
    origin = BODY.index(config.origin)
    frame = frame_of(
        config.origin,
        torch.from_numpy(frames.position[history, origin]),
        torch.from_numpy(frames.rotation[history, origin]),
    )
    seen = Joints(
        torch.from_numpy(frames.position[history[..., None], reads]),
        torch.from_numpy(frames.rotation[history[..., None], reads]),
    )
    truth = Joints(torch.from_numpy(frames.position[last, None]), torch.from_numpy(frames.rotation[last, None]))
    now = HeadFrame(frame.start[:, -1:], frame.facing)
    truth = Joints(*(values[:, 0] for values in seen_from(now, truth)))
    offset = torch.from_numpy(frames.rest_offset[windows.clip[which]])
    return VaeBatch(seen_from(frame, seen), truth, offset, frame)


def mirrored(config: BodyVaeConfig, batch: VaeBatch, which: Tensor) -> VaeBatch:
    """The batch with the windows (B,) bool of `which` in the mirror: left is right, x turns its sign."""
    partner = _mirror()
    reads = config.reads
    swap = [reads.index(BODY[partner[BODY.index(name)]]) for name in reads]

    def flip(joints: Joints, order: list[int]) -> Joints:
        flipped = (
            joints.position[..., order, :] * joints.position.new_tensor([-1, 1, 1]),
            joints.rotation[..., order, :] * joints.rotation.new_tensor([1, 1, -1, -1]),
        )
        shape = (-1, *(1,) * (joints.position.ndim - 1))
        return Joints(*(torch.where(which.view(shape), new, old) for new, old in zip(flipped, joints, strict=True)))

    whole = partner.tolist()
    offset = batch.rest_offset[:, whole] * batch.rest_offset.new_tensor([-1, 1, 1])
    return VaeBatch(
        flip(batch.seen, swap),
        flip(batch.truth, whole),
        torch.where(which[:, None, None], offset, batch.rest_offset),
        batch.frame,
    )


@lru_cache(maxsize=1)
def _mirror() -> np.ndarray:
    """(22,) the partner of each joint on the other side."""
    return body_skeleton(default_skeleton()).mirror
