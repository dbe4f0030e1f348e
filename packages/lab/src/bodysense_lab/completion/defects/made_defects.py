"""Made-up defects: spikes, frozen limbs, swapped limbs and sliding feet in true motion, at random places and sizes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.reach import reach
from bodysense.geometry.gaps import runs
from bodysense.geometry.rotation import (
    geodesic_angle,
    quaternion_canonical,
    quaternion_exp,
    quaternion_multiply,
)
from bodysense.geometry.series import fade_out
from bodysense.io.clip import Clip
from bodysense.quality.foot_defects import foot_motion
from bodysense.quality.joint_defects import LIMBS

SPIKED = tuple(f"{s}_{p}" for s in ("left", "right") for p in ("shoulder", "elbow", "hip", "knee", "ankle"))
_MIRROR = np.array([1.0, 1.0, -1.0, -1.0])  # of a quaternion, left for right
TRIES = 30  # draws of a place before a clip is left without a defect
LEAD = 0.3  # s of true motion before and after a defect
VISIBLE = np.deg2rad(60.0)  # least sum of angles between two limbs that are swapped, at both edges
MOVED = 0.03  # m; least mean error of a frozen limb
FARTHEST, REACHED = 0.25, 0.01  # m: longest slide, and largest distance that the leg is too short for it
STANDS = 0.05  # m/s; a foot that stands in truth is slower


@dataclass(frozen=True, eq=False)
class MadeDefect:
    """A clip with one defect."""

    kind: str
    clip: Clip
    joints: tuple[str, ...]  # that are wrong
    first: int  # frames, both included
    last: int


def spike(clip: Clip, rng: np.random.Generator) -> MadeDefect | None:
    """Turn one joint by 15° to 60° for one to three frames."""
    joint, width = str(rng.choice(SPIKED)), int(rng.integers(1, 4))
    first = _place(clip, width, rng)
    axis = rng.normal(size=3)
    angle = np.deg2rad(rng.uniform(15, 60))
    turn = quaternion_exp(axis / np.linalg.norm(axis) * angle)
    rotation, index = np.array(clip.pose.rotation), clip.pose.skeleton.index(joint)
    frames = slice(first, first + width)
    rotation[frames, index] = quaternion_canonical(
        quaternion_multiply(rotation[frames, index], np.broadcast_to(turn, (width, 4)))
    )
    return MadeDefect("spike", _with_rotation(clip, rotation), (joint,), first, first + width - 1)


def freeze(clip: Clip, rng: np.random.Generator) -> MadeDefect | None:
    """Hold a limb that moves for 0.5 to 2 s."""
    for _ in range(TRIES):
        parts = LIMBS[str(rng.choice(list(LIMBS)))][1 if rng.random() < 0.5 else 0 :][:3]
        side = str(rng.choice(["left", "right"]))
        count = round(rng.uniform(0.5, 2.0) * clip.frame_rate)
        first = _place(clip, count, rng)
        joints = tuple(f"{side}_{part}" for part in parts)
        rotation, index = np.array(clip.pose.rotation), clip.pose.skeleton.indices(joints)
        rotation[first : first + count, index] = rotation[first - 1, index]
        made = _with_rotation(clip, rotation)
        truth, frozen = (np.asarray(forward_kinematics(one.pose)[0])[first : first + count] for one in (clip, made))
        if np.linalg.norm((truth - frozen)[:, index[-1]], axis=-1).mean() > MOVED:
            return MadeDefect("freeze", made, joints, first, first + count - 1)
    return None


def swap(clip: Clip, rng: np.random.Generator) -> MadeDefect | None:
    """Exchange the motion of left and right arm or leg for 0.3 to 2 s, where they differ at both edges."""
    for _ in range(TRIES):
        parts = LIMBS[str(rng.choice(list(LIMBS)))]
        count = round(rng.uniform(0.3, 2.0) * clip.frame_rate)
        first = _place(clip, count, rng)
        rotation, index = np.array(clip.pose.rotation), clip.pose.skeleton.indices
        left, right = (index([f"{side}_{part}" for part in parts]) for side in ("left", "right"))
        edges = [first - 1, first + count]
        differ = 2 * geodesic_angle(rotation[edges][:, left], rotation[edges][:, right] * _MIRROR).sum(axis=1)
        if differ.min() < VISIBLE:
            continue
        frames = slice(first, first + count)
        across = rotation[frames][:, right] * _MIRROR
        rotation[frames, right] = rotation[frames][:, left] * _MIRROR
        rotation[frames, left] = across
        joints = tuple(f"{side}_{part}" for side in ("left", "right") for part in parts)
        return MadeDefect("swap", _with_rotation(clip, rotation), joints, first, first + count - 1)
    return None


def slide(clip: Clip, rng: np.random.Generator) -> MadeDefect | None:
    """Let a foot that stands drift at 15 to 50 cm/s for 0.3 to 1 s; it returns to its path in 0.3 s."""
    place = np.asarray(forward_kinematics(clip.pose)[0])
    spans = []
    for side in ("left", "right"):
        foot = place[:, clip.pose.skeleton.indices([f"{side}_ankle", f"{side}_foot"])]
        speed = np.linalg.norm(np.gradient(foot, axis=0), axis=-1).max(axis=1) * clip.frame_rate
        stands = foot_motion(clip.pose, clip.frame_rate, side).stands & (speed < STANDS)
        spans += [(side, *span) for span in runs(stands)]
    least, fade = round(0.35 * clip.frame_rate), round(0.3 * clip.frame_rate)
    spans = [(s, a, b) for s, a, b in spans if b - a >= least and a > 3 and b + fade < len(clip) - 3]
    if not spans:
        return None
    for _ in range(TRIES):
        side, start, stop = spans[rng.integers(len(spans))]
        count = min(stop - start - 2, round(rng.uniform(0.3, 1.0) * clip.frame_rate))
        first = int(rng.integers(start + 1, stop - count))
        angle, speed = rng.uniform(0, 2 * np.pi), rng.uniform(0.15, 0.5)
        speed = min(speed, FARTHEST / (count / clip.frame_rate))
        drift = np.zeros(len(clip))
        drift[first : first + count] = (np.arange(count) + 1) * speed / clip.frame_rate
        drift[first + count : stop] = drift[first + count - 1]
        drift[stop : stop + fade] = drift[stop - 1] * fade_out(fade)
        wanted = place[:, clip.pose.skeleton.index(f"{side}_ankle")]
        wanted = wanted + drift[:, None] * [np.cos(angle), 0.0, np.sin(angle)]
        made = _with_ankle(clip, side, wanted, drift > 0)
        reached = np.asarray(forward_kinematics(made.pose)[0])[:, clip.pose.skeleton.index(f"{side}_ankle")]
        if np.linalg.norm(reached - wanted, axis=1)[drift > 0].max() < REACHED:  # its leg is long enough
            leg = tuple(f"{side}_{part}" for part in ("hip", "knee", "ankle"))
            return MadeDefect("slide", made, leg, first, first + count - 1)
    return None


def _with_ankle(clip: Clip, side: str, wanted: np.ndarray, where: np.ndarray) -> Clip:
    """Return the clip with an ankle at (T, 3) m in some frames (T,)."""
    bent = np.asarray(reach(clip.pose, f"{side}_ankle", wanted).rotation)
    rotation = np.array(clip.pose.rotation)
    for joint in clip.pose.skeleton.indices([f"{side}_{part}" for part in ("hip", "knee", "ankle")]):
        rotation[where, joint] = bent[where, joint]
    return _with_rotation(clip, rotation)


MAKERS: dict[str, Callable[[Clip, np.random.Generator], MadeDefect | None]] = {
    "spike": spike,
    "freeze": freeze,
    "swap": swap,
    "slide": slide,
}


def _place(clip: Clip, count: int, rng: np.random.Generator) -> int:
    """Return the first frame of `count`, with true motion on both sides."""
    lead = round(LEAD * clip.frame_rate)
    return int(rng.integers(lead, max(lead + 1, len(clip) - count - lead)))


def _with_rotation(clip: Clip, rotation: np.ndarray) -> Clip:
    return replace(clip, pose=Pose(clip.pose.skeleton, clip.pose.root_position, rotation))
