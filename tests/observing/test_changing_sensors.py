"""Sensors that are lost and found: measured points are reached, and the rest of the body does not jump."""

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics
from bodysense.body.retarget import retarget
from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import SENSOR_SETS, THREE_POINT
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense.observing.observation import Observation
from bodysense.tracking.tracker import Tracker, TrackerSettings

ALWAYS = ("head", "left_wrist", "right_wrist")


def performance(body: int, frames: int) -> Clip:
    """The packaged performance on a body that was never in training."""
    clip = packaged_performance()
    skeleton = default_skeleton().with_offsets(sample_bodies("test", body + 1)[body])
    return replace(clip, pose=retarget(clip.pose[:frames], skeleton))


def completed(clip: Clip, observation: Observation, ease: float = 0.25) -> np.ndarray:
    """Points of the body (T, 22, 3) m, of a known person."""
    tracker = Tracker(Person(clip.pose.skeleton), settings=TrackerSettings(ease=ease))
    return tracker.step(observation, tracker.start())[0].points[:, : len(BODY)]


def seen_at_times(clip: Clip, points: tuple[str, ...], has: np.ndarray) -> Observation:
    """True positions of points, seen in some frames (T, P)."""
    truth = np.asarray(forward_kinematics(clip.pose)[0])
    return Observation(
        points=points,
        position=truth[:, clip.pose.skeleton.indices(points)],
        rotation=np.tile([1.0, 0.0, 0.0, 0.0], (*has.shape, 1)),
        has_position=has,
        has_rotation=np.zeros_like(has),
        accuracy=np.where(has, 1e-3, np.inf),
        time=clip.time,
    )


@pytest.mark.parametrize(
    ("parts", "most"), [(("knee",), 0.14), (("hip", "knee"), 0.07), (("elbow",), 0.088), (("knee", "ankle"), 0.12)]
)
def test_a_body_does_not_jump_when_points_are_lost_or_found(parts: tuple[str, ...], most: float) -> None:
    """Joints are seen for about half a second at a time; hidden ones keep moving."""
    clip = performance(1, 900)
    truth = np.asarray(forward_kinematics(clip.pose)[0])
    points = (*ALWAYS, *(f"{side}_{part}" for part in parts for side in ("left", "right")))
    rng, has = np.random.default_rng(1), np.ones((len(truth), len(points)), dtype=bool)
    for k in range(len(ALWAYS), len(points)):
        has[:, k] = np.cumsum(rng.uniform(size=len(truth)) < 0.06) % 2 == 0
    observation = seen_at_times(clip, points, has)
    path, true_path = (
        np.linalg.norm(np.diff(values[:, : len(BODY)], axis=0), axis=-1)
        for values in (completed(clip, observation), truth)
    )
    changed = (has[1:] != has[:-1]).any(axis=-1)
    beyond = (path - true_path).max(axis=-1)[changed]
    assert len(beyond) > 50
    assert np.percentile(beyond, 99) < most  # m in a frame


def with_shins(clip: Clip, has: np.ndarray) -> Observation:
    """Return the tracking of head, hands and shin rotations of a clip; shins only in the frames `has` (T,)."""
    sensors = SENSOR_SETS["three_point_imu_feet"]
    seen = observe(clip.pose, clip.time, sensors)
    shins = [name.endswith("knee") for name in seen.points]
    return replace(seen, has_rotation=seen.has_rotation & (has[:, None] | ~np.array(shins)))


@pytest.mark.parametrize("frames", [5, 7, 12])
def test_knees_do_not_bend_backward_when_shin_rotations_are_lost_or_found(frames: int) -> None:
    clip = performance(0, 750)
    tracker = Tracker(Person(clip.pose.skeleton))
    seen = with_shins(clip, np.arange(len(clip)) // frames % 2 == 0)
    rotation = tracker.step(seen, tracker.start())[0].pose.rotation
    for side in ("left", "right"):
        w, x, *_ = rotation[:, clip.pose.skeleton.index(f"{side}_knee")].T
        assert np.degrees(2 * np.arctan2(np.sign(w) * x, np.abs(w))).min() > -2


def test_a_shin_does_not_jump_when_its_rotation_is_found_again() -> None:
    clip = performance(0, 750)
    tracker = Tracker(Person(clip.pose.skeleton))
    has = np.arange(len(clip)) // 15 % 2 == 0
    pose = tracker.step(with_shins(clip, has), tracker.start())[0].pose
    knee = clip.pose.skeleton.index("left_knee")
    output, truth = (np.asarray(forward_kinematics(one)[1])[:, knee] for one in (pose, clip.pose))
    step, true_step = (np.degrees(geodesic_angle(one[1:], one[:-1])) for one in (output, truth))
    found = has[1:] & ~has[:-1]
    jump = (step - true_step)[found]
    assert np.quantile(jump, 0.9) < 2.0 and jump.max() < 5.0  # measured: 1.2 and 4.9
    met = np.flatnonzero(found)[:, None] + np.arange(9, 14)  # a quarter of a second later, and on
    np.testing.assert_allclose(geodesic_angle(output[met], truth[met]), 0, atol=1e-3)


def test_the_rest_of_a_body_keeps_moving_when_a_hand_is_found_again() -> None:
    """The jerk of trunk and legs at a return is compared with that without a loss."""
    ratios = []
    for body in (1, 2):
        clip = performance(body, 600)
        observation = observe(clip.pose, clip.time, THREE_POINT)
        rest = clip.pose.skeleton.indices(["pelvis", "spine1", *(f"left_{n}" for n in ("hip", "knee", "ankle"))])
        found = np.arange(50, 590, 40)
        near = (found[:, None] + np.arange(-3, 4)).ravel()

        def jerk(seen: Observation, clip: Clip = clip, rest: np.ndarray = rest) -> np.ndarray:
            return np.linalg.norm(np.diff(completed(clip, seen)[:, rest], 3, axis=0), axis=-1).max(axis=-1)

        usual = jerk(observation)
        for side in ("left", "right"):
            hand = [k for k, name in enumerate(observation.points) if name.startswith(side)]
            has_position, has_rotation = observation.has_position.copy(), observation.has_rotation.copy()
            for frame in found:
                has_position[frame - 20 : frame, hand] = has_rotation[frame - 20 : frame, hand] = False
            lost = replace(observation, has_position=has_position, has_rotation=has_rotation)
            ratios.append(jerk(lost)[near].mean() / usual[near].mean())
    assert np.mean(ratios) < 1.8


@pytest.mark.parametrize(
    "parts", [("foot",), ("knee",), ("ankle",), ("shoulder",), ("elbow",), ("knee", "ankle", "foot")]
)
def test_a_found_point_is_reached_at_once_without_ease(parts: tuple[str, ...]) -> None:
    """The error in the frame of return equals that of a point that was never lost."""
    clip = performance(1, 600)
    points = (*ALWAYS, *(f"{side}_{part}" for part in parts for side in ("left", "right")))
    rng, has = np.random.default_rng(2), np.ones((600, len(points)), dtype=bool)
    has[:, len(ALWAYS) :] = np.cumsum(rng.uniform(size=(600, len(points) - len(ALWAYS))) < 0.06, axis=0) % 2 == 0
    truth, joints = np.asarray(forward_kinematics(clip.pose)[0]), clip.pose.skeleton.indices(points)
    lost, never = (
        np.linalg.norm((completed(clip, seen_at_times(clip, points, mask), ease=0.0) - truth[:, : len(BODY)]), axis=-1)
        for mask in (has, np.ones_like(has))
    )
    found = np.zeros_like(has)
    found[1:] = has[1:] & ~has[:-1]
    assert found.sum() > 25
    assert np.percentile(lost[:, joints][found], 95) < np.percentile(never[:, joints][found], 95) + 0.01  # m


def test_a_blinking_finger_moves_nothing_and_a_lasting_one_leads_its_hand() -> None:
    clip = performance(1, 300)
    points, has = ("head", "left_index1"), np.ones((300, 2), dtype=bool)
    frames, truth = np.arange(300), np.asarray(forward_kinematics(clip.pose)[0])
    outputs = {}
    for name, seen in (("never", frames < 0), ("blinks", frames // 3 % 2 == 1), ("stays", frames > 30)):
        has[:, 1] = seen
        outputs[name] = completed(clip, seen_at_times(clip, points, has.copy()))
    np.testing.assert_array_equal(outputs["blinks"], outputs["never"])
    wrist = clip.pose.skeleton.index("left_wrist")
    error = {
        name: np.linalg.norm(out - truth[:, : len(BODY)], axis=-1)[60:, wrist].mean() for name, out in outputs.items()
    }
    assert error["stays"] < error["never"] / 2
