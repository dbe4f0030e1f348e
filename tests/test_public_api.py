"""Public names of `bodysense`: observations from numbers, points by name, custom devices, reprs."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import bodysense as bs
from bodysense.body.skeleton import default_body
from bodysense.geometry.rotation import quaternion_multiply, quaternion_rotate

TURN = np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0])  # −90° about X: from +Z up to +Y up


@pytest.fixture(scope="module")
def short() -> bs.Clip:
    clip = bs.demo.packaged_performance()
    return replace(clip, pose=clip.pose[:40])


def test_every_public_name_exists() -> None:
    assert set(bs.__all__) <= set(dir(bs))
    assert not [name for name in bs.__all__ if getattr(bs, name) is None]
    with pytest.raises(AttributeError, match="no attribute 'tracks'"):
        _ = bs.tracks  # pyright: ignore[reportAttributeAccessIssue]


# Observations from numbers


def test_arrays_equal_single_frames() -> None:
    rng = np.random.default_rng(0)
    head, wrist = rng.normal([0, 1.6, 0], 0.05, (5, 3)), rng.normal([0.2, 1, 0.2], 0.05, (5, 3))
    wrist[2] = np.nan
    turn = rng.normal(size=(5, 4))
    turn /= np.linalg.norm(turn, axis=-1, keepdims=True)
    whole = bs.Observation.from_arrays({"head": head, "left_wrist": wrist}, {"head": turn, "pelvis": turn}, rate=50)
    assert whole.points == ("head", "left_wrist", "pelvis") and np.allclose(np.diff(whole.time), 0.02)
    for k in range(5):
        poses = {
            "head": (head[k], turn[k]),
            "left_wrist": (None if k == 2 else wrist[k], None),
            "pelvis": (None, turn[k]),
        }
        one = bs.observe(0.02 * k, poses)
        for name in ("position", "rotation", "has_position", "has_rotation", "accuracy"):
            np.testing.assert_array_equal(getattr(one, name), getattr(whole, name)[k : k + 1])


def test_several_people_in_one_frame_equal_each_alone() -> None:
    head = np.array([[0.0, 1.6, 0.0], [1.0, 1.75, 0.5]])
    wrist = np.array([[np.nan] * 3, [1.2, 1.0, 0.6]])
    both = bs.observe(3.0, {"head": (head, None), "left_wrist": (wrist, None)})
    assert both.position.shape == (2, 1, 2, 3) and both.has_position[:, 0].tolist() == [[True, False], [True, True]]
    tracker = bs.Tracker([bs.Person(), bs.Person(height=1.8)])
    together, _ = tracker.step(both, tracker.start())
    for k, person in enumerate(tracker.people):
        alone = bs.Tracker(person)
        poses = {"head": (head[k], None), "left_wrist": (None if k == 0 else wrist[k], None)}
        estimate, _ = alone.step(bs.observe(3.0, poses), alone.start())
        np.testing.assert_allclose(together["left_elbow"].position[k], estimate["left_elbow"].position, atol=1e-12)


@pytest.mark.parametrize(("unit", "scale"), [("cm", 100.0), ("in", 1 / 0.0254), ("0.5", 2.0)])
def test_units_and_axes_are_converted(unit: str, scale: float) -> None:
    head, turn = np.array([[0.1, 1.6, -0.3]] * 3), np.array([[1.0, 0, 0, 0]] * 3)
    ours = bs.Observation.from_arrays({"head": head}, {"head": turn})
    lying = np.stack([head[:, 0], -head[:, 2], head[:, 1]], axis=1)  # x, y ahead-to-back, z up
    back = np.asarray(quaternion_multiply(np.tile(TURN * [1, -1, -1, -1], (3, 1)), turn))
    found = bs.Observation.from_arrays({"head": scale * lying}, {"head": back}, unit=unit, up="z")
    np.testing.assert_allclose(found.position, ours.position, atol=1e-12)
    np.testing.assert_allclose(found.rotation, ours.rotation, atol=1e-12)
    frame = bs.observe(0.0, {"head": (scale * lying[0], back[0])}, unit=unit, up="z")
    np.testing.assert_allclose(frame.position, ours.position[:1], atol=1e-12)


HEAD, WRIST = np.tile([0.0, 1.65, 0.3], (60, 1)), np.tile([0.25, 1.0, 0.4], (60, 1))
UP, AT_EYES = np.array([0.0, 60, 0]), np.array([0.0, -1.65, 1.3])  # a tower; an origin at the eyes
Z_UP = [0, 2, 1]  # the columns of data with +Z up


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: bs.observe(0.0, {"head": (100 * HEAD[0], None)}), "observe: the head is 165 m above the floor; give"),
        (lambda: bs.observe(0.0, {"headset": (1000 * HEAD[0] / 2, None)}), "say the unit: unit='mm' (--unit mm)"),
        (lambda: bs.Observation.from_arrays({"head": 100 * HEAD}), "say the unit: unit='cm' (--unit cm); unit='m'"),
        (
            lambda: bs.Observation.from_arrays({"head": 100 * HEAD[:, Z_UP], "left_wrist": 100 * WRIST[:, Z_UP]}),
            "the head is 70.36 m from the other points; give metres, or say the unit: unit='cm'",
        ),
        (
            lambda: bs.Observation.from_arrays({"head": HEAD[:, Z_UP], "left_wrist": WRIST[:, Z_UP]}),
            "the head is 0.30 m high and 1.65 m along z, as of a body that stands along +Z; give data with +Y up, or "
            "say the axis: up='z' (--up z); up='y' (--up y) if the body lies",
        ),
        (lambda: bs.Observation.from_arrays({"head": HEAD[:, Z_UP]}), "say the axis: up='z'"),
        (lambda: bs.Observation.from_arrays({"head": HEAD}, unit="ell"), "unit ell: give m, cm, mm, in, ft, or the"),
        (lambda: bs.Observation.from_arrays({"head": HEAD}, up="w"), "up w: give the upward axis, y, z, -z, -y, x, -x"),
        (lambda: bs.Observation.from_arrays({"head": HEAD[:, :2]}), "head has shape (60, 2); give (..., T, 3)"),
        (lambda: bs.observe(0.0, {"head": HEAD[0]}), "observe: head is array([0.  , 1.65, 0.3 ]); give a pair"),  # pyright: ignore[reportArgumentType]
        (lambda: bs.track(3), "3: no source; give a file's path, or a Clip"),  # pyright: ignore[reportArgumentType]
        (lambda: bs.simulate("walk.bvh", "head"), "simulate: 'walk.bvh' is no motion; give a Clip, as read('walk"),  # pyright: ignore[reportArgumentType]
        (lambda: bs.ReadingOptions(up="q"), "--up q: give the upward axis, y, z,"),  # pyright: ignore[reportArgumentType]
        (lambda: bs.Observation.from_arrays({"head": HEAD}, rate=0), "rate 0; give frames a second, such as 30"),
        (
            lambda: bs.Observation.from_arrays({"head": HEAD, "left_wrist": WRIST[1:]}),
            "left_wrist has shape (59, 3), but head has (60, 3); give (..., T, 3), with equally many",
        ),
        (
            lambda: bs.observe(0.0, {"head": (HEAD[:2], None), "pelvis": (HEAD[0], None)}),
            "pelvis has shape (1, 3), but head has (2, 1, 3)",
        ),
    ],
)  # fmt: skip
def test_invalid_observations_are_refused(make: Callable[[], Any], text: str) -> None:
    with pytest.raises(bs.BodysenseError, match=re.escape(text)):
        make()


@pytest.mark.parametrize(
    "make",
    [
        lambda: bs.Observation.from_arrays({"head": HEAD + UP}, unit="m"),  # on a tower
        lambda: bs.Observation.from_arrays({"head": HEAD + UP, "left_wrist": WRIST + UP}),
        lambda: bs.Observation.from_arrays({"head": HEAD[:, Z_UP], "left_wrist": WRIST[:, Z_UP]}, up="y"),  # lies
        lambda: bs.Observation.from_arrays({"head": HEAD + AT_EYES, "left_wrist": WRIST + AT_EYES}),
        lambda: bs.observe(0.0, {"head": (HEAD[0, Z_UP], None), "left_wrist": (WRIST[0, Z_UP], None)}),  # one frame
    ],
)
def test_odd_positions_pass_with_explicit_units(make: Callable[[], bs.Observation]) -> None:
    assert make().has_position.all()


def test_a_take_is_refused_or_converted_alike(short: bs.Clip, tmp_path) -> None:
    seen = bs.simulate(short, "three_point")
    wrong = replace(seen, position=100 * seen.position)
    with pytest.raises(bs.BodysenseError, match=r"observation: the head is .* say the unit: unit='cm' \(--unit cm\)"):
        bs.track(wrong)
    options = bs.ReadingOptions(unit="cm")
    whole, right = bs.track(wrong, reading=options, causal=True), bs.track(seen, causal=True)
    np.testing.assert_allclose(whole.estimate.points, right.estimate.points, atol=1e-9)
    bs.write(tmp_path / "seen.npz", wrong)
    read = bs.read(tmp_path / "seen.npz", options)
    assert isinstance(read, bs.Recording) and not read.known
    np.testing.assert_allclose(read.observation.position, seen.position, atol=1e-5)


# Raw poses


def test_raw_device_poses_become_joints() -> None:
    """Oracle: a body that faces +Z in the T-pose has its eyes and palms at the landmarks of the default body."""
    skeleton = bs.default_skeleton()
    place = skeleton.path @ skeleton.rest_offset + [0.0, 1.0, 0.0]
    offset = {row["name"]: np.array(row["offset"]) for row in default_body()["landmarks"]}
    half = np.sqrt(0.5)
    devices = {  # in the T-pose: the viewer looks along its −Z; −Z of a grip is forward, +X of a right one up
        "headset": ("head", "between_eyes", [0.0, 0.0, 1.0, 0.0]),
        "left_controller": ("left_wrist", "left_palm", [0.0, half, -half, 0.0]),
        "right_controller": ("right_wrist", "right_palm", [0.0, half, half, 0.0]),
    }
    poses = {name: (place[skeleton.index(joint)] + offset[mark], turn) for name, (joint, mark, turn) in devices.items()}
    for name, along in (("headset", [0, 0, 1]), ("left_controller", [0, 0, 1]), ("right_controller", [0, 0, 1])):
        ahead = quaternion_rotate(np.array(poses[name][1]), np.array([0.0, 0.0, -1.0]))
        np.testing.assert_allclose(ahead, along, atol=1e-12)
    tracker = bs.Tracker(bs.Person(skeleton))
    estimate, _ = tracker.step(bs.observe(0.0, poses), tracker.start())
    for joint, _, _ in devices.values():
        assert estimate[joint].measured.all()
        np.testing.assert_allclose(estimate[joint].position[0], place[skeleton.index(joint)], atol=1e-3)
        turned = estimate[joint].rotation
        assert turned is not None and abs(turned[0, 0]) > 0.9999  # the T-pose


def test_a_raw_pose_and_its_joint_exclude_each_other() -> None:
    tracker = bs.Tracker()
    both = bs.observe(0.0, {"head": ([0, 1.6, 0], None), "headset": ([0, 1.65, 0.1], None)})
    with pytest.raises(bs.BodysenseError, match="'headset' and 'head' are the same point; give one of them"):
        tracker.step(both, tracker.start())


# Estimates, devices, reprs


def test_points_of_an_estimate_have_names(short: bs.Clip) -> None:
    tracker = bs.Tracker(bs.Person(short.pose.skeleton))
    estimate, _ = tracker.step(bs.simulate(short, "three_point"), tracker.start())
    position, rotation = bs.forward_kinematics(estimate.pose)
    k = short.pose.skeleton.index("left_elbow")
    elbow = estimate["left_elbow"]
    np.testing.assert_allclose(elbow.position, position[:, k], atol=1e-6)
    assert elbow.rotation is not None and elbow.rotation.shape == (40, 4)
    np.testing.assert_allclose(np.abs((elbow.rotation * rotation[:, k]).sum(axis=-1)), 1, atol=1e-6)
    np.testing.assert_array_equal(elbow.bound, estimate.bound[:, k])
    assert not elbow.measured.any() and estimate["left_wrist"].measured.all()
    assert estimate["left_index_tip"].rotation is None
    with pytest.raises(bs.BodysenseError, match="unknown joint 'left_elbo'; this skeleton has left_elbow"):
        _ = estimate["left_elbo"]


class OneInTwo:
    """A device that tracks the head in every other frame."""

    def observe(self, clip: bs.Clip, rng: np.random.Generator | None) -> bs.Observation:
        seen = bs.simulate(clip, "head")
        seen.has_position[1::2] = seen.has_rotation[1::2] = False
        if rng is not None:
            seen.position[:] += rng.normal(0, 0.01, seen.position.shape)
        return seen


def test_a_custom_device_is_used(short: bs.Clip) -> None:
    take = bs.track(short, device=OneInTwo())
    assert take.estimate["head"].measured.tolist() == [True, False] * 20
    exact, noisy, again = (bs.simulate(short, OneInTwo(), noise) for noise in (None, 3, 3))
    assert not np.allclose(exact.position, noisy.position)
    np.testing.assert_array_equal(noisy.position, again.position)


def test_an_invalid_device_is_refused(short: bs.Clip) -> None:
    class Short:
        def observe(self, clip: bs.Clip, rng: np.random.Generator | None) -> bs.Observation:
            return bs.simulate(clip, "head")[:7]

    with pytest.raises(bs.BodysenseError, match="device Short: its observation has 7 frames, the clip 40; return one"):
        bs.simulate(short, Short())
    with pytest.raises(bs.BodysenseError, match=r"has no method observe\(clip, rng\); add one, or give one of head"):
        bs.simulate(short, 3)  # pyright: ignore[reportArgumentType]


def test_reprs_are_short(short: bs.Clip) -> None:
    seen = bs.simulate(short, "six_point")
    take = bs.track(seen, person=bs.Person(height=1.8))
    tracker = bs.Tracker(bs.Person(height=1.8))
    estimate, state = tracker.step(seen, tracker.start())
    with pytest.raises(bs.BodysenseError, match=r"estimate: of one person alone, .* leave of\(\) out"):
        estimate.of(0)
    assert repr(tracker.start()) == "TrackerState(Person(1.80 m, known height) no frame)"
    gloves = bs.glove_device(short.pose.skeleton)
    assert f"{gloves} {gloves.start()}" == "GloveDevice(left and right hand) GloveState(no frame)"
    assert repr(state) == "TrackerState(Person(1.80 m, known height) at 1.3 s)"
    assert re.fullmatch(r"EstimatedPoint\(head, 40 frames, expected error \d\.\d cm\)", repr(take.estimate["head"]))
    assert repr(seen) == (
        "Observation(40 frames at 30 Hz, 100% tracked: head, left_wrist, right_wrist, pelvis, left_ankle, right_ankle)"
    )
    assert repr(bs.simulate(short, "ten_point")[:1]).endswith("left_ankle, right_ankle and 5 more)")
    assert repr(bs.default_skeleton()) == "Skeleton(52 joints, 13 end sites, 1.70 m)"
    assert repr(tracker) == "Tracker(Person(1.80 m, known height), packaged network)"
    assert repr(bs.Tracker([bs.Person(), bs.Person()])) == "Tracker(2 people, packaged network)"
    assert repr(bs.Person()).startswith("Person(1.") and repr(bs.Person()).endswith(" m, inferred)")
    assert re.fullmatch(
        r"Estimate\(40 frames of 65 points, 9% measured, expected error \d\.\d cm\)", repr(take.estimate)
    )
    assert re.fullmatch(r"Take\(Clip\(.*40 frames at 30 Hz, 1\.3 s\), Person\(.*\), expected error .* cm\)", repr(take))


# Arguments of another kind

UNTYPED: Any = bs  # calls that a type checker would refuse


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: UNTYPED.Person(1.75),
            "Person: 1.75 is of type float; give a Skeleton, or a height in metres as Person",
        ),
        (lambda: UNTYPED.Person(height="1.75"), "height: '1.75' is of type str; give a number of metres"),
        (
            lambda: UNTYPED.Person(lengths={("left_hip", "left_knee"): "long"}),
            "left_hip–left_knee: 'long' is of type str",
        ),
        (lambda: UNTYPED.Tracker(1.75), "Tracker: 1.75 is of type float; give a Person, such as Person"),
        (lambda: UNTYPED.Tracker([bs.Person(), "me"]), "Tracker: 'me' is of type str"),
        (
            lambda: UNTYPED.Tracker().step({}, bs.Tracker().start()),
            "Tracker.step: .* of type dict; give an Observation",
        ),
        (lambda: UNTYPED.Tracker().step(bs.observe(0, {"head": ((0, 1.6, 0), None)}), None), "at first tracker.start"),
        (lambda: UNTYPED.write(bs.demo.packaged_performance(), "a.bvh"), "write: Clip.* give the path first"),
        (lambda: UNTYPED.convert("a.bvh", 4), "convert: 4 is of type int; give the path of the output"),
        (lambda: UNTYPED.write("a.bvh", "b.bvh"), "write: 'b.bvh' is of type str; give a Clip"),
        (lambda: UNTYPED.forward_kinematics(bs.default_skeleton()), "forward_kinematics: Skeleton.* give a Pose"),
        (lambda: UNTYPED.glove_device("me"), "glove_device: 'me' is of type str; give the wearer's Skeleton"),
    ],
)
def test_arguments_of_another_kind_name_the_right_call(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(bs.BodysenseError, match=message):
        call()
