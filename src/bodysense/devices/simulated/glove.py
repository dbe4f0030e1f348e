"""Simulated optical capture of gloves (two-hands, 2.1): markers are seen or hidden, noisy and sometimes wrong.

A marker is a light outside the skin, offset along its facing direction, so that its own finger or palm hides it only
from behind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bodysense.body.capsules import PosedPrimitives, Primitives, fit_primitives, pose_primitives
from bodysense.body.hands.glove import Glove, default_glove, glove_of, marker_positions, side_of, template
from bodysense.body.hands.glove_set import GloveSet, standard_set
from bodysense.body.hands.hand import Side, hand_pose, joint_bases, mirrored_vectors
from bodysense.body.hands.hand_capsules import capsule_axes, hand_capsules
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.devices.simulated.camera_ring import CameraRing, seen_lights
from bodysense.devices.simulated.noise import hide
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_rotate
from bodysense.observing.observation import EXACT_ACCURACY, Observation, accuracy_like

_HANDS: tuple[Side, Side] = ("left", "right")
_TIP = np.array([0.6, 0.8, 0.0])  # direction that a light on a fingertip faces, in the joint's own axes
_CLEAR = 0.002  # m, distance of a light from the capsules
_HIGHEST = 0.06  # m, more than the thickness of any capsule
_MEAN_DISTANCE = (8 / np.pi) ** 0.5  # mean length of normal noise in space, in deviations along one axis


@dataclass(frozen=True)
class GloveCapture:
    """Settings of glove capture. By default every marker is found without error."""

    cameras: CameraRing | None = None  # None: no marker is hidden
    noise: float = 0.0  # m, standard deviation along each axis
    spikes: float = 0.0  # share of wrong samples
    spike_size: float = 0.08  # m, mean distance of a wrong sample from the marker
    losses: float = 0.0  # losses of a visible marker per minute
    loss: float = 0.05  # s, mean length of a loss

    def __post_init__(self) -> None:
        for name in ("noise", "spikes", "spike_size", "losses", "loss"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise BodysenseError(f"glove capture: {name} {value:g}; give 0 or more")
        if self.spikes > 1:
            raise BodysenseError(f"glove capture: spikes {self.spikes:g} is a share; give 0 to 1")


def observe(
    pose: Pose,
    time: np.ndarray,
    capture: GloveCapture = GloveCapture(),
    rng: np.random.Generator | None = None,
    marker_set: GloveSet | None = None,
) -> Observation:
    """Return the markers of both gloves of a person (T, …) at `time` (T,) s. The body hides markers behind it.

    Points are named 'left_glove_pinky_base' …, left before right. `marker_set` is the standard one if omitted, and
    `rng` is needed for random settings. Raises BodysenseError for a skeleton without fingers, and if poses and times
    differ in number.
    """
    return observe_hands({side: hand_pose(pose, side) for side in _HANDS}, time, capture, rng, pose, marker_set)


def observe_hands(
    hands: Mapping[str, Pose],
    time: np.ndarray,
    capture: GloveCapture = GloveCapture(),
    rng: np.random.Generator | None = None,
    body: Pose | None = None,
    marker_set: GloveSet | None = None,
) -> Observation:
    """Return the markers of hands (T, …) by name, 'left', 'right', 'left2' …; see `observe`.

    Each hand is a left one in its own mirrored world (`body.hand`). `body`, if given, hides markers behind it.
    """
    time = np.asarray(time, dtype=float)
    for name, pose in hands.items():
        if time.shape != pose.root_position.shape[:-1]:
            raise BodysenseError(
                f"{name}: poses of shape {pose.root_position.shape[:-1]} need as many times, not {time.shape}"
            )
    marker_set = standard_set() if marker_set is None else marker_set
    gloves = {name: glove_of(marker_set, pose.skeleton) for name, pose in hands.items()}
    position = np.concatenate(
        [mirrored_vectors(marker_positions(gloves[name], pose), side_of(name)) for name, pose in hands.items()],
        axis=-2,
    )
    known = np.ones(position.shape[:-1], dtype=bool)
    if capture.cameras is not None:
        known = visible(hands, capture.cameras, body, gloves=gloves)
    if rng is None and (capture.noise or capture.spikes or capture.losses):
        raise BodysenseError("glove capture: noise, spikes and losses are random; give a generator, rng=…")
    if rng is not None:
        position = _add_noise(position, capture, rng)
        known &= ~_random_losses(time, position.shape[1], capture, rng)
    rotation = np.full((*position.shape[:-1], 4), np.nan)
    points = tuple(f"{name}_glove_{marker}" for name in hands for marker in marker_set.names)
    whole = np.ones(known.shape, dtype=bool)
    observation = Observation(
        points=points,
        position=position,
        rotation=rotation,
        has_position=whole,
        has_rotation=~whole,
        accuracy=accuracy_like(whole, max(EXACT_ACCURACY, _MEAN_DISTANCE * capture.noise)),
        time=time,
    )
    return hide(observation, ~known)


def visible(
    hands: Mapping[str, Pose],
    cameras: CameraRing,
    body: Pose | None = None,
    others: Sequence[tuple[Pose, Side]] = (),
    gloves: Mapping[str, Glove] | None = None,
) -> np.ndarray:
    """Return the mask (F, M) of markers that cameras find on hands (F, …), in the order of `hands`.

    The hands have the default glove or those in `gloves`. The hands, `others` without gloves, and the body, if given,
    hide markers behind them. The ring is centred on the mean position of the markers.
    """
    lit = [_lights(pose, side_of(name), (gloves or {}).get(name, default_glove())) for name, pose in hands.items()]
    light, facing = (np.concatenate(parts, axis=1) for parts in zip(*lit, strict=True))
    solid = [*((pose, side_of(name)) for name, pose in hands.items()), *others]
    return seen_lights(cameras, light.mean(axis=(0, 1)), light, facing, _solids(solid, body))


def _add_noise(position: np.ndarray, capture: GloveCapture, rng: np.random.Generator) -> np.ndarray:
    """Return positions (T, R, 3) m with noise and spikes."""
    position = position + capture.noise * rng.standard_normal(position.shape)
    wrong = rng.random(position.shape[:-1]) < capture.spikes
    direction = rng.standard_normal(position.shape)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    far = rng.exponential(capture.spike_size, position.shape[:-1])
    return position + (wrong * far)[..., None] * direction


def _random_losses(time: np.ndarray, count: int, capture: GloveCapture, rng: np.random.Generator) -> np.ndarray:
    """Return the mask (T, R) of random losses."""
    lost = np.zeros((len(time), count), dtype=bool)
    for marker, spans in enumerate(rng.poisson(capture.losses * (time[-1] - time[0]) / 60, count)):
        begin = rng.uniform(time[0], time[-1], (spans, 1))
        lost[:, marker] = ((time >= begin) & (time < begin + rng.exponential(capture.loss, (spans, 1)))).any(axis=0)
    return lost


def _lights(pose: Pose, side: Side, glove: Glove) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (F, M, 3) m of the lights of a hand (F, …), and their unit facing directions, in the world."""
    offset, facing = _mounting(pose.skeleton, glove)
    position, world = forward_kinematics(pose)
    carrier = pose.skeleton.indices(glove.carried_by)
    light = position[:, carrier] + quaternion_rotate(world[:, carrier], offset)
    return mirrored_vectors(light, side), mirrored_vectors(quaternion_rotate(world[:, carrier], facing), side)


@lru_cache(maxsize=64)
def _mounting(hand: Skeleton, glove: Glove) -> tuple[np.ndarray, np.ndarray]:
    """Return offsets (M, 3) m of the markers' lights from their carrying joints, and unit facing directions (M, 3).

    Lights are moved out of the flat hand's capsules along that direction.
    """
    capsules = hand_capsules(hand)
    rest = hand.path @ hand.rest_offset
    carrier = hand.indices(glove.carried_by)
    bases = np.array([(1.0, 0.0, 0.0, 0.0), *joint_bases()])
    own = np.array([_TIP if point.endswith("_tip") else [0.0, 1.0, 0.0] for point in glove.points])
    facing = quaternion_rotate(bases[carrier], own)
    height = np.arange(0.0, _HIGHEST, 0.0005)
    point = template(glove, hand)[:, None] + height[:, None] * facing[:, None]  # (9, heights, 3)
    start = rest[capsules.joint] + capsules.start
    bone = capsules.end - capsules.start
    from_start = point[:, :, None] - start
    share = np.clip(np.einsum("mhcx,cx->mhc", from_start, bone) / np.einsum("cx,cx->c", bone, bone), 0, 1)
    clear = np.linalg.norm(from_start - share[..., None] * bone, axis=-1) - capsules.radius
    inside = (clear < _CLEAR).any(axis=-1)
    highest = np.where(inside.any(axis=1), len(height) - np.argmax(inside[:, ::-1], axis=1), 0)
    light = point[np.arange(len(carrier)), np.minimum(highest, len(height) - 1)]
    return light - rest[carrier], facing


def _solids(hands: Sequence[tuple[Pose, Side]], body: Pose | None) -> PosedPrimitives:
    """Return occluders: capsules of hands, and primitives of a body except its hands."""
    start, end, radius = [], [], []
    for pose, side in hands:
        begins, bones = capsule_axes(pose)
        start.append(mirrored_vectors(begins, side))
        end.append(mirrored_vectors(begins + bones, side))
        radius.append(hand_capsules(pose.skeleton).radius)
    frames = len(start[0])
    boxes = np.zeros((frames, 0, 3)), np.zeros((frames, 0, 3, 3)), np.zeros((0, 3))
    if body is not None:
        posed = pose_primitives(fit_primitives(body.skeleton), *(np.asarray(part) for part in forward_kinematics(body)))
        capsules, other = _outside_hands(body.skeleton)
        start.append(posed.start[:, capsules])
        end.append(posed.end[:, capsules])
        radius.append(posed.primitives.radius[capsules])
        boxes = posed.center[:, other], posed.axes[:, other], posed.primitives.half_size[other]
    center, axes, half_size = boxes
    starts, ends, radii = np.concatenate(start, axis=1), np.concatenate(end, axis=1), np.concatenate(radius)
    count = len(radii) + len(half_size)
    primitives = Primitives(
        skeleton=hands[0][0].skeleton,
        names=("",) * count,
        joint=np.zeros(count, dtype=int),
        start=starts[0],
        end=ends[0],
        radius=radii,
        center=center[0],
        half_size=half_size,
        nose=np.zeros(3),
    )
    return PosedPrimitives(primitives, starts, ends, center, axes)


@lru_cache(maxsize=64)
def _outside_hands(skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """Return indices of a body's capsules and boxes outside its hands."""
    body = fit_primitives(skeleton)
    wrists = skeleton.indices(["left_wrist", "right_wrist"])
    hand = np.any(skeleton.path[body.joint][:, wrists] > 0, axis=1)
    capsules = len(body.radius)
    return np.flatnonzero(~hand[:capsules]), np.flatnonzero(~hand[capsules:])
