"""The joining network: for each joint the weight of both passes, an additional turn, and the expected error.

features of both passes → 30 Hz → blocks of dilated convolutions, two seconds wide → each joint's share, turn and error
→ the rate of the frames

The network runs on the body and on its mirror image, so that its results are symmetric.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY, Skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    heading,
    mean_rotation,
    quaternion_conjugate,
    quaternion_log,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_matrix,
)
from bodysense.tensors import tensors_of

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

Array = np.ndarray
PACKAGED, COMMAND = "completion_joining.safetensors", "bodysense train completion-joining"
FORMAT = "bodysense-joining-2"
RATE = 30.0  # Hz at which the network works
DILATIONS = (1, 2, 4, 8, 16)  # frames between the three taps of each block's convolution
_BLOCKS = {str(block) for block in range(len(DILATIONS))}
JOINTS = len(BODY)
OUTPUTS = 5 * JOINTS  # three numbers of turn for each joint, then one of share for each, then one of error for each
_TRUNK, _HOLDING = ("spine1", "spine2", "spine3", "neck"), ("pelvis", "spine3", "head")
_FLIP = np.array([-1.0, 1.0, 1.0])  # mirrors a position at x = 0
_LEAST_ERROR = 1e-3  # m
_OTHER_SIDE = [2, 3, 0, 1]  # of `CONTACT_POINTS`


@dataclass(frozen=True, eq=False)
class PassPair:
    """Estimates of the same T frames by the forward pass (past) and the backward pass (future)."""

    skeleton: Skeleton
    past: Array  # (T, J, 4) wxyz, local rotations
    future: Array  # (T, J, 4)
    past_points: Array  # (T, P, 3) m, world, +Y up
    future_points: Array  # (T, P, 3)
    past_error: Array  # (T, P) m, expected errors
    future_error: Array  # (T, P)
    past_bound: Array  # (T, P) m, above nine in ten errors
    future_bound: Array  # (T, P)
    past_contact: Array  # (T, 4) probability
    future_contact: Array  # (T, 4)
    share: Array  # (T,) weight of the future in a plain mean
    measured: Array  # (T, P) bool: points whose position is tracked
    turned: Array  # (T, J) bool: joints whose rotation is tracked
    floor: float  # m
    seconds: float  # between frames


@dataclass(frozen=True, eq=False)
class Joining:
    """Weights and errors by which both passes become one estimate."""

    share: Array  # (T, J) weight of the future
    turn: Array  # (T, J, 3) rad beyond the mean
    error: Array  # (T, P) m, expected
    bound: Array  # (T, P) m, above nine in ten errors


def features(passes: PassPair) -> Array:
    """Return the network's input (T, F): the mean body, the difference of the passes, and the tracked points.

    Positions are in the heading of the mean pelvis, so that they do not depend on the walking direction. Numbers are
    scaled to about 1.
    """
    skeleton, frames = passes.skeleton, len(passes.share)
    body, head = skeleton.indices(BODY), skeleton.index("head")
    mean = mean_rotation(passes.past, passes.future, passes.share[:, None, None])
    position = np.asarray(forward_kinematics(Pose(skeleton, np.zeros((frames, 3)), mean))[0])
    level = quaternion_conjugate(heading(mean[:, 0]))
    top = joined_head(passes)

    def ahead(vector: Array) -> Array:
        return quaternion_rotate(level.reshape(-1, *(1,) * (vector.ndim - 2), 4), vector)

    turn = np.concatenate([quaternion_multiply(level, mean[:, 0])[:, None], mean[:, body[1:]]], axis=1)
    from_head = position[:, body] - position[:, [head]]
    apart = quaternion_log(quaternion_multiply(quaternion_conjugate(passes.past[:, body]), passes.future[:, body]))
    between = passes.future_points[:, body] - passes.past_points[:, body]
    speed = np.diff(top, axis=0, prepend=top[:1]) / passes.seconds
    length = np.linalg.norm(skeleton.rest_offset[body], axis=-1)
    parts = (
        quaternion_to_matrix(turn)[..., :2],
        2 * apart,
        2 * ahead(from_head),
        5 * ahead(between),
        passes.measured[:, body],
        passes.turned[:, body],
        *((np.log(np.maximum(one[:, body], _LEAST_ERROR)) + 3) / 2 for one in (passes.past_error, passes.future_error)),
        passes.past_contact,
        passes.future_contact,
        passes.share[:, None],
        1.5 * (top[:, None, 1] + from_head[..., 1] - passes.floor),
        ahead(speed),
        np.broadcast_to(3 * length, (frames, len(length))),
    )
    return np.concatenate([np.asarray(part, dtype=np.float32).reshape(frames, -1) for part in parts], axis=1)


def mirror_image(skeleton: Skeleton) -> tuple[Array, Array]:
    """Return which feature (F,) of a body is each feature of its mirror image at x = 0, and with which sign (F,).

    Features of the mirror image are exactly these: sums of numbers with other signs are rounded alike.
    """
    axes, one = np.outer(_FLIP, _FLIP[:2]).ravel(), np.ones(1)
    sides, other = _partners(skeleton), np.array(_OTHER_SIDE)
    each_joint = (axes, -_FLIP, _FLIP, _FLIP, one, one, one, one)  # turns are mirrored with the other sign
    parts = [(sides, signs) for signs in each_joint]
    parts += [(other, one), (other, one), ([0], one), (sides, one), ([0], _FLIP), (sides, one)]
    order, signs, first = [], [], 0
    for places, sign in parts:
        width = len(sign)
        order.append((first + width * np.asarray(places)[:, None] + np.arange(width)).ravel())
        signs.append(np.tile(sign, len(places)))
        first += width * len(places)
    return np.concatenate(order), np.concatenate(signs).astype(np.float32)


def _partners(skeleton: Skeleton) -> Array:
    """Return the places (22,) in `BODY` of the joints on the other side."""
    body = skeleton.indices(BODY)
    places = {joint: place for place, joint in enumerate(np.asarray(body).tolist())}
    return np.array([places[int(skeleton.mirror[joint])] for joint in body])


def joined_head(passes: PassPair) -> Array:
    """Return the position (T, 3) m of the joined head: measured if it is tracked, else between both passes."""
    head = passes.skeleton.index("head")
    past, future = passes.past_points[:, head], passes.future_points[:, head]
    share = np.where(passes.measured[:, head], 0.5, passes.share)[:, None]
    return (1 - share) * past + share * future


@dataclass(frozen=True, eq=False)
class JoiningNetwork:
    """A joining network at run time."""

    tensors: Mapping[str, Array]  # float32
    card: dict[str, Any]  # the file's metadata

    @cached_property
    def _kernels(self) -> list[list[Array]]:
        """Matrices (inputs, outputs) of the three taps of each convolution. Products with slices would copy them."""
        kernels = [self.tensors[f"convolutions.{block}.weight"] for block in range(len(DILATIONS))]
        return [[np.ascontiguousarray(kernel[..., tap].T) for tap in range(3)] for kernel in kernels]

    def __call__(self, passes: PassPair) -> Joining:
        """Return the weights and errors for both passes.

        Joints outside `BODY` follow the plain mean, and so does a trunk with tracked pelvis, chest and head.
        """
        skeleton = passes.skeleton
        body, swap = np.array(skeleton.indices(BODY)), _partners(skeleton)
        (turn, other_turn), (odds, other_odds), (larger, other_larger) = self._run(passes)
        turn = (turn + other_turn[:, swap] * -_FLIP) / 2
        odds = (odds + other_odds[:, swap]) / 2
        larger = (larger + other_larger[:, swap]) / 2
        share = np.repeat(passes.share[:, None], len(skeleton.joints), axis=1)
        beyond = np.zeros((*share.shape, 3))
        share[:, body] = shift_share(share[:, body], odds)
        beyond[:, body] = turn
        held = passes.measured[:, skeleton.indices(_HOLDING)].all(axis=1)
        for joint in skeleton.indices(_TRUNK).tolist():
            share[held, joint], beyond[held, joint] = passes.share[held], 0.0
        return Joining(share, beyond, *self._errors(passes, larger))

    def _errors(self, passes: PassPair, larger: Array) -> tuple[Array, Array]:
        """Return expected errors (T, P) m and their bounds; `larger` (T, 22) is added to logarithms of the errors."""
        body = passes.skeleton.indices(BODY)
        error = (passes.past_error + passes.future_error) / 2
        bound = (passes.past_bound + passes.future_bound) / 2
        hidden, (middle, spread) = ~passes.measured[:, body], expected_log_errors(passes)
        found = np.exp(middle + larger + self.tensors["error_offset"])
        error[:, body] = np.where(hidden, found, error[:, body])
        bound[:, body] = np.where(hidden, found * np.exp(spread + self.tensors["bound_offset"]), bound[:, body])
        return error, bound

    def _run(self, passes: PassPair) -> tuple[tuple[Array, Array], ...]:
        """Return turns (T, 22, 3) rad, and changes (T, 22) of log odds of shares and of logarithms of errors.

        Each is a pair: of the body, and of its mirror image.
        """
        frames = len(passes.share)
        time = np.arange(frames) * passes.seconds
        ticks = np.arange(int(np.ceil(time[-1] * RATE - 1e-6)) + 1) / RATE
        read = _interpolated(ticks, features(passes), time)
        order, sign = mirror_image(passes.skeleton)
        found = [_interpolated(time, self.outputs(one), ticks) for one in (read, read[:, order] * sign)]
        turn, odds, larger = zip(*(np.split(one, [3 * JOINTS, 4 * JOINTS], axis=1) for one in found), strict=True)
        return tuple(one.reshape(frames, JOINTS, 3) for one in turn), odds, larger

    def outputs(self, read: Array) -> Array:
        """Return the network's `OUTPUTS` numbers for features (T, F), frames at `RATE`."""
        given, frames = self.tensors, len(read)
        hidden = read @ given["inward.weight"].T + given["inward.bias"]
        beside = max(DILATIONS)
        taps = np.zeros((frames + 2 * beside, hidden.shape[1]), hidden.dtype)  # zeros before and after the frames
        for block, dilation in enumerate(DILATIONS):
            taps[beside : beside + frames] = hidden
            bent, *others = (
                taps[beside + tap * dilation :][:frames] @ kernel
                for tap, kernel in zip((-1, 0, 1), self._kernels[block], strict=True)
            )
            for more in (*others, given[f"convolutions.{block}.bias"]):
                bent += more
            hidden += _silu(bent) @ given[f"mixing.{block}.weight"].T
            hidden += given[f"mixing.{block}.bias"]
        return _silu(hidden) @ given["outward.weight"].T + given["outward.bias"]


def expected_log_errors(passes: PassPair) -> tuple[Array, Array]:
    """Return the mean logarithms (T, 22) of both expected errors in m, and of the ratios of bounds to errors."""
    body = passes.skeleton.indices(BODY)
    one, other, low, high = (
        np.log(np.maximum(values[:, body], _LEAST_ERROR))
        for values in (passes.past_error, passes.future_error, passes.past_bound, passes.future_bound)
    )
    return (one + other) / 2, (low + high - one - other) / 2


def shift_share(share: Array, odds: Array) -> Array:
    """Return shares (...) with `odds` added to their log odds."""
    share = np.clip(share, 1e-3, 1 - 1e-3)
    return 1 / (1 + (1 - share) / share * np.exp(-odds))


def load_joining(path: str | Path) -> JoiningNetwork:
    """Open a joining network's file (.safetensors). Raises BodysenseError for any other file."""
    return _opened(Path(path))


@lru_cache(maxsize=1)
def packaged_joining() -> JoiningNetwork:
    """Return the joining network that comes with the package, loaded once."""
    from importlib.resources import files

    return _opened(files("bodysense.weights").joinpath(PACKAGED))


def _opened(source: Traversable) -> JoiningNetwork:
    wanted = f"give the .safetensors that `{COMMAND}` wrote"
    if not source.is_file():
        raise BodysenseError(f"{source}: no such model file; {wanted}")
    tensors, card = tensors_of(source.read_bytes(), str(source))
    if card.get("format") != FORMAT:
        found = card.get("format", "not given")
        raise BodysenseError(f"{source}: no joining network (format {found!r}, wanted {FORMAT!r}); {wanted}")
    network = JoiningNetwork(
        {name: values.astype(np.float32) for name, values in tensors.items()},
        {name: text if name == "format" else json.loads(text) for name, text in card.items()},
    )
    blocks = {name.split(".")[1] for name in tensors if name.startswith("convolutions.")}
    if more := sorted(blocks - _BLOCKS):
        known = f"blocks 0 to {len(DILATIONS) - 1} are known"
        raise BodysenseError(f"{source}: a joining network with a block {more[0]}; {known}; {wanted}")
    try:
        network.outputs(np.zeros((1, network.tensors["inward.weight"].shape[1]), dtype=np.float32))
        (network.tensors["error_offset"] + network.tensors["bound_offset"]).reshape(JOINTS)
    except (KeyError, ValueError, IndexError) as error:
        raise BodysenseError(f"{source}: a joining network without some of its tensors ({error}); {wanted}") from None
    return network


def _silu(values: Array) -> Array:
    below = np.maximum(values, -60)
    np.exp(np.negative(below, out=below), out=below)
    below += 1
    return np.divide(values, below, out=below)


def _interpolated(at: Array, values: Array, known: Array) -> Array:
    """Interpolate values (T, N) of times `known` (T,) linearly at times `at` (S,); the last value is extended."""
    if len(known) == 1:
        return np.repeat(values, len(at), axis=0)
    before = np.clip(np.searchsorted(known, at, side="right") - 1, 0, len(known) - 2)
    share = np.clip((at - known[before]) / (known[before + 1] - known[before]), 0.0, 1.0)[:, None]
    share = share.astype(values.dtype)
    return (1 - share) * values[before] + share * values[before + 1]
