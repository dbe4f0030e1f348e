"""Last known positions: the frame in which each baseline keeps hidden points, on small examples."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp
from bodysense.io.clip import Clip
from bodysense.observing.observation import Observation
from bodysense.takes.last_known import Hold

SKELETON = default_skeleton()
FORWARD = [1.0, 0.0, 0.0, 0.0]
LEFT = quaternion_exp(np.array([0.0, np.pi / 2, 0.0])).tolist()  # a quarter turn about +Y: what was +Z is now +X
NOD = quaternion_exp(np.array([0.6, 0.0, 0.0])).tolist()
HEAD, ELBOW, WRIST, TIP = (SKELETON.index(name) for name in ("head", "left_elbow", "left_wrist", "left_index_tip"))


def positions(hold: Hold, observation: Observation) -> np.ndarray:
    return hold.step(observation, hold.start())[0].position


@pytest.mark.parametrize(
    ("frame", "elbow", "head", "turns", "expected"),
    [
        ("world", [0.2, 1.1, 0.3], [1, 1.6, 2], [FORWARD, LEFT], [0.2, 1.1, 0.3]),
        ("head", [0.0, 1.1, 0.3], [1, 1.7, 2], [FORWARD, LEFT], [1.0, 1.2, 2.3]),  # it moves with the head
        ("heading", [0.0, 1.1, 0.3], [1, 1.7, 2], [FORWARD, LEFT], [1.3, 1.2, 2.0]),  # and turns with its heading
        (
            "heading",
            [0.3, 1.1, -0.1],
            [0, 1.6, 0],
            [LEFT, FORWARD],
            [0.1, 1.1, 0.3],
        ),  # seen while the head was turned aside
        ("heading", [0.2, 1.1, 0.3], [0, 1.6, 0], [FORWARD, NOD], [0.2, 1.1, 0.3]),
    ],
)
def test_a_hidden_point_is_kept_in_a_frame(make_observation, frame, elbow, head, turns, expected) -> None:
    seen = make_observation([{"head": [0, 1.6, 0], "left_elbow": elbow}, {"head": head}], [0, 0.1], turns)
    np.testing.assert_allclose(positions(Hold(SKELETON, frame), seen)[:, ELBOW], [elbow, expected], atol=1e-12)


@pytest.mark.parametrize(
    ("frame", "expected"), [("world", [0.5, 1.0, 0.3]), ("head", [0.5, 1.0, 0.3]), ("heading", [0.7, 1.0, 0.1])]
)
def test_hidden_fingers_move_with_the_wrist(make_observation, frame, expected: list[float]) -> None:
    """The fingertip was 20 cm in front of the wrist; then the wrist moves and the head turns left."""
    head = {"head": [0, 1.6, 0]}
    seen = make_observation(
        [
            head | {"left_wrist": [0.2, 1.0, 0.3], "left_index_tip": [0.2, 1.0, 0.5]},
            head | {"left_wrist": [0.5, 1.0, 0.1]},
        ],
        [0, 0.1],
        [FORWARD, LEFT],
    )
    hold = positions(Hold(SKELETON, frame), seen)
    np.testing.assert_allclose(hold[1, TIP], expected, atol=1e-12)
    np.testing.assert_allclose(hold[1, WRIST], [0.5, 1.0, 0.1])


@pytest.mark.parametrize("frame", ["world", "head", "heading"])
def test_a_finger_seen_without_its_wrist_is_output_but_not_stored(make_observation, frame) -> None:
    head = {"head": [0, 1.6, 0]}
    seen = make_observation([head | {"left_index_tip": [0.2, 1.0, 0.5]}, head], [0, 0.1], [FORWARD] * 2)
    hold = positions(Hold(SKELETON, frame), seen)
    np.testing.assert_allclose(hold[0, TIP], [0.2, 1.0, 0.5])
    never = positions(Hold(SKELETON, frame), make_observation([head], [0], [FORWARD]))
    np.testing.assert_allclose(hold[1], never[0])


@pytest.mark.parametrize("frame", ["world", "head", "heading"])
def test_points_that_were_never_seen_are_below_the_head(make_observation, frame) -> None:
    standing, _ = forward_kinematics(standing_pose(SKELETON))
    seen = make_observation([{"head": [1, 1.2, 3]}, {"head": [1, 1.2, 3]}], [0, 0.1], [FORWARD, LEFT])
    hold = positions(Hold(SKELETON, frame), seen)
    offset = standing - standing[HEAD]
    np.testing.assert_allclose(hold[0], np.array([1, 1.2, 3]) + offset, atol=1e-12)
    turned = np.stack([offset[:, 2], offset[:, 1], -offset[:, 0]], axis=-1)
    np.testing.assert_allclose(hold[1], np.array([1, 1.2, 3]) + turned, atol=1e-12)


def test_without_a_head_the_body_is_at_the_origin(make_observation) -> None:
    standing, _ = forward_kinematics(standing_pose(SKELETON))
    hold = positions(Hold(SKELETON), make_observation([{"left_elbow": [9, 9, 9]}], [0]))
    others = np.arange(len(standing)) != ELBOW
    np.testing.assert_allclose(hold[0, others], standing[others], atol=1e-12)


@pytest.mark.parametrize("frame", ["world", "head", "heading"])
def test_measured_points_are_unchanged_and_one_call_equals_many(waving_clip: Clip, frame) -> None:
    observation = observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)
    hold = Hold(SKELETON, frame)
    whole, end = hold.step(observation, hold.start())
    state, rows = hold.start(), []
    for t in range(len(observation)):
        estimate, state = hold.step(observation[t : t + 1], state)
        rows.append(estimate)
    for field in ("position", "occluded", "confidence"):
        np.testing.assert_array_equal(getattr(whole, field), np.concatenate([getattr(row, field) for row in rows]))
    for name, value in vars(end).items():
        np.testing.assert_array_equal(value, vars(state)[name])
    seen = observation.has_position
    np.testing.assert_array_equal(whole.position[seen], observation.position[seen])
    assert np.isfinite(whole.position).all()
    assert not whole.occluded[seen].any() and whole.occluded[~seen].all()


def test_later_frames_do_not_change_earlier_ones(waving_clip: Clip) -> None:
    """The baseline is causal."""
    observation = observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)
    np.testing.assert_array_equal(
        positions(Hold(SKELETON), observation)[:30], positions(Hold(SKELETON), observation[:30])
    )


def test_an_unknown_point_is_refused(make_observation) -> None:
    seen = make_observation([{"head": [0, 1.6, 0], "left_ellbow": [0, 1, 0]}], [0])
    with pytest.raises(BodysenseError, match=r"unknown joint 'left_ellbow'; this skeleton has left_elbow"):
        positions(Hold(SKELETON), seen)
