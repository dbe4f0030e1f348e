"""The joining network at run time: independence of side, heading and rate; tracked rotations are kept."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.device import simulate
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.io.clip import Clip
from bodysense.takes.joining import keep_tracked_rotations
from bodysense.takes.joining_network import (
    FORMAT,
    JoiningNetwork,
    PassPair,
    features,
    load_joining,
    mirror_image,
    packaged_joining,
    shift_share,
)
from bodysense.takes.two_way import TwoWayTracker
from bodysense.tracking.tracker import TrackerSettings

PACKAGED = packaged_joining()


@pytest.fixture(scope="module")
def passes(waving_clip: Clip) -> PassPair:
    tracker = TwoWayTracker(Person(waving_clip.pose.skeleton), None, TrackerSettings())
    seen = simulate(waving_clip, "three_point")
    forward, _ = tracker.tracker.step(seen, tracker.tracker.start())
    return tracker.passes(forward, tracker.backward(seen), tracker.turned(seen), 1 / 30)


def moved(passes: PassPair, yaw: float, shift: np.ndarray) -> PassPair:
    """Turn passes about +Y and move them."""
    turn = quaternion_exp(np.array([0.0, yaw, 0.0]))

    def turned(rotation: np.ndarray) -> np.ndarray:
        rotation = rotation.copy()
        rotation[:, 0] = quaternion_multiply(turn, rotation[:, 0])
        return rotation

    return replace(
        passes,
        past=turned(passes.past),
        future=turned(passes.future),
        past_points=quaternion_rotate(turn, passes.past_points) + shift,
        future_points=quaternion_rotate(turn, passes.future_points) + shift,
    )


def test_features_are_independent_of_heading_and_position(passes: PassPair) -> None:
    elsewhere = moved(passes, 2.1, np.array([3.0, 0.0, -7.0]))
    np.testing.assert_allclose(features(elsewhere), features(passes), atol=2e-4)


def test_features_have_heights_above_the_floor(passes: PassPair) -> None:
    upstairs = replace(moved(passes, 0.0, np.array([0.0, 2.5, 0.0])), floor=2.5)
    np.testing.assert_allclose(features(upstairs), features(passes), atol=1e-5)
    assert np.abs(features(replace(upstairs, floor=0.0)) - features(passes)).max() > 1


def mirrored(passes: PassPair) -> PassPair:
    """Return both passes mirrored at x = 0, on the mirrored body."""
    points, flip, other_side = np.asarray(passes.skeleton.mirror), np.array([-1.0, 1.0, 1.0]), [2, 3, 0, 1]
    joints = points[: len(passes.skeleton.joints)]
    changed = {
        field.name: getattr(passes, field.name)[:, joints if field.name in ("past", "future", "turned") else points]
        for field in fields(passes)
        if field.name.partition("_")[2] in ("", "points", "error", "bound")
        and field.name not in ("skeleton", "share", "floor", "seconds")
    }
    for name in ("past", "future"):
        changed[name] = changed[name] * np.array([1.0, 1.0, -1.0, -1.0])
        changed[f"{name}_points"] = changed[f"{name}_points"] * flip
        changed[f"{name}_contact"] = getattr(passes, f"{name}_contact")[:, other_side]
    skeleton = passes.skeleton.with_offsets(passes.skeleton.rest_offset[points] * flip)
    return replace(passes, skeleton=skeleton, **changed)


def test_features_of_the_mirror_image_are_those_of_mirrored_passes(passes: PassPair) -> None:
    """Equal bit for bit, on a body whose sides differ, with tracked points and errors that differ between sides."""
    rng = np.random.default_rng(3)
    skeleton, shape = passes.skeleton, passes.measured.shape
    crooked = replace(
        passes,
        skeleton=skeleton.with_offsets(skeleton.rest_offset * rng.uniform(0.9, 1.1, (shape[1], 1))),
        measured=rng.uniform(size=shape) < 0.5,
        turned=rng.uniform(size=passes.turned.shape) < 0.5,
        past_error=rng.uniform(0.01, 0.5, shape),
        future_contact=rng.uniform(size=passes.future_contact.shape),
    )
    order, sign = mirror_image(crooked.skeleton)
    np.testing.assert_array_equal(features(crooked)[:, order] * sign, features(mirrored(crooked)))


def test_mirrored_input_gives_mirrored_output(passes: PassPair) -> None:
    """The output for a mirror image is the mirror image of the output."""
    partner = np.asarray(passes.skeleton.mirror)[: len(passes.skeleton.joints)]
    found, other = PACKAGED(passes), PACKAGED(mirrored(passes))
    np.testing.assert_allclose(other.share[:, partner], found.share, atol=1e-5)
    np.testing.assert_allclose(other.turn[:, partner] * [1.0, -1.0, -1.0], found.turn, atol=1e-5)
    np.testing.assert_allclose(other.error[:, passes.skeleton.mirror], found.error, atol=1e-5)
    np.testing.assert_allclose(other.bound[:, passes.skeleton.mirror], found.bound, atol=1e-5)
    assert np.abs(found.turn).max() > 0.02


def test_the_result_is_independent_of_the_frame_rate(passes: PassPair) -> None:
    """With every frame twice at twice the rate the output is nearly unchanged."""

    def doubled(values: np.ndarray) -> np.ndarray:
        between = values.copy()
        if values.dtype != bool:
            between[:-1] = (values[:-1] + values[1:]) / 2
        return np.stack([values, between], axis=1).reshape(-1, *values.shape[1:])[: 2 * len(values) - 1]

    arrays = {f.name: getattr(passes, f.name) for f in fields(passes)}
    twice = {name: doubled(values) for name, values in arrays.items() if isinstance(values, np.ndarray)}
    found, expected = PACKAGED(replace(passes, **twice, seconds=passes.seconds / 2)), PACKAGED(passes)
    assert np.abs(found.share[::2] - expected.share).max() < 0.05
    assert np.abs(found.turn[::2] - expected.turn).max() < 0.03
    assert np.abs(np.log(found.error[::2] / expected.error)).max() < 0.1


@pytest.mark.parametrize("frames", [1, 2, 7])
def test_few_frames(passes: PassPair, frames: int) -> None:
    arrays = {f.name: getattr(passes, f.name) for f in fields(passes)}
    few = replace(passes, **{name: one[:frames] for name, one in arrays.items() if isinstance(one, np.ndarray)})
    found = PACKAGED(few)
    assert len(found.share) == frames and ((found.share > 0) & (found.share < 1)).all()
    assert np.isfinite(found.turn).all() and (found.error > 0).all() and (found.bound > 0).all()


def test_zero_output_gives_the_mean(passes: PassPair) -> None:
    silent = {
        name: values * ("outward" not in name and "offset" not in name) for name, values in PACKAGED.tensors.items()
    }
    found = JoiningNetwork(silent, {})(passes)
    np.testing.assert_allclose(found.share, np.broadcast_to(passes.share[:, None], found.share.shape), atol=1e-6)
    assert not found.turn.any()
    mean = np.sqrt(passes.past_error * passes.future_error)
    body, hidden = passes.skeleton.indices(BODY), ~passes.measured
    np.testing.assert_allclose(found.error[:, body][hidden[:, body]], mean[:, body][hidden[:, body]], rtol=1e-6)


def test_errors_of_tracked_points_and_fingers_are_means(passes: PassPair) -> None:
    found, fingers = PACKAGED(passes), ~np.isin(np.arange(65), passes.skeleton.indices(BODY))
    kept = passes.measured | fingers
    np.testing.assert_allclose(found.error[kept], ((passes.past_error + passes.future_error) / 2)[kept])
    np.testing.assert_allclose(found.bound[kept], ((passes.past_bound + passes.future_bound) / 2)[kept])
    changed = np.abs(found.error - (passes.past_error + passes.future_error) / 2)[~kept]
    assert (changed > 1e-4).mean() > 0.9


def test_a_bound_changes_with_its_error(passes: PassPair) -> None:
    """Offsets are logarithms: that of errors changes error and bound, that of bounds only the bound."""
    hidden = np.ix_(np.arange(len(passes.share)), passes.skeleton.indices(["left_knee", "pelvis"]))
    found = PACKAGED(passes)
    for name, factor in (("error_offset", 2.0), ("bound_offset", 1.0)):
        tensors = {**PACKAGED.tensors, name: PACKAGED.tensors[name] + np.log(2, dtype=np.float32)}
        other = JoiningNetwork(tensors, {})(passes)
        np.testing.assert_allclose(other.error[hidden], factor * found.error[hidden], rtol=1e-5)
        np.testing.assert_allclose(other.bound[hidden], 2 * found.bound[hidden], rtol=1e-5)


def test_fingers_follow_the_mean(passes: PassPair) -> None:
    found = PACKAGED(passes)
    share, beyond = found.share, found.turn
    fingers = np.setdiff1d(np.arange(share.shape[1]), passes.skeleton.indices(BODY))
    np.testing.assert_array_equal(share[:, fingers], np.repeat(passes.share[:, None], len(fingers), axis=1))
    assert not beyond[:, fingers].any()


def test_a_tracked_trunk_follows_the_mean(passes: PassPair) -> None:
    skeleton, measured = passes.skeleton, passes.measured.copy()
    measured[30:60, skeleton.indices(["pelvis", "spine3", "head"])] = True
    measured[60:, skeleton.indices(["pelvis", "head"])] = True
    found = PACKAGED(replace(passes, measured=measured))
    share, beyond = found.share, found.turn
    trunk = skeleton.indices(["spine1", "spine2", "spine3", "neck"])
    held = np.arange(len(share)) // 30 == 1
    assert not beyond[held][:, trunk].any() and np.abs(beyond[~held][:, trunk]).max() > 0.01
    np.testing.assert_array_equal(share[held][:, trunk], np.repeat(passes.share[held][:, None], 4, axis=1))
    assert np.abs(beyond[held, skeleton.index("left_shoulder")]).max() > 0.001


def test_shares_are_shifted_by_odds() -> None:
    np.testing.assert_allclose(shift_share(np.array([0.5, 0.2]), np.array([0.0, 0.0])), [0.5, 0.2])
    assert shift_share(np.array(0.5), np.log(3.0)) == pytest.approx(0.75)


def test_tracked_joints_keep_their_world_rotation(passes: PassPair) -> None:
    rng = np.random.default_rng(4)
    skeleton, frames = passes.skeleton, len(passes.share)
    wanted = rng.normal(size=passes.past.shape)
    wanted /= np.linalg.norm(wanted, axis=-1, keepdims=True)
    turned = rng.random(passes.past.shape[:2]) < 0.3
    kept = keep_tracked_rotations(skeleton, passes.past, wanted, turned)
    world = np.asarray(forward_kinematics(Pose(skeleton, np.zeros((frames, 3)), kept))[1])
    assert geodesic_angle(world, wanted)[turned].max() < 1e-6
    np.testing.assert_array_equal(kept[~turned], passes.past[~turned])


def test_other_files_are_refused(tmp_path: Path) -> None:
    weights = Path(__file__).parents[2] / "src" / "bodysense" / "weights"
    with pytest.raises(BodysenseError, match=r"no such model file; give the .safetensors that .*completion-joining"):
        load_joining(tmp_path / "none.safetensors")
    with pytest.raises(BodysenseError, match=r"no joining network .*bodysense-completion"):
        load_joining(weights / "completion.safetensors")
    cut = tmp_path / "cut.safetensors"
    cut.write_bytes((weights / "completion_joining.safetensors").read_bytes()[:1000])
    with pytest.raises(BodysenseError, match="not a readable safetensors file"):
        load_joining(cut)
    header = json.dumps({"__metadata__": {"format": FORMAT}}).encode()
    cut.write_bytes(len(header).to_bytes(8, "little") + header)
    with pytest.raises(BodysenseError, match="without some of its tensors"):
        load_joining(cut)
