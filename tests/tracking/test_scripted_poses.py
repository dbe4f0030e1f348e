"""Scripted poses that once failed: squats, raised knees, standing still, lost and found points."""

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.demo import performance_of_unseen_body
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import SENSOR_SETS, THREE_POINT, WRISTS
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.io.formats.recording import Recording
from bodysense.takes.track import track
from bodysense.tracking.tracker import Tracker, TrackerSettings

RATE, SECONDS = 30, 6
FEET = ("left_ankle", "left_foot", "left_toe", "right_ankle", "right_foot", "right_toe")


def unseen_body(body: int) -> Skeleton:
    return default_skeleton().with_offsets(sample_bodies("test", body + 1)[body])


def performed(skeleton: Skeleton, flexion: dict[str, float], arms: dict[str, np.ndarray] | None = None) -> Pose:
    """Stand for a second, then go to a pose and back, twice; the lowest sole stays on the floor.

    `flexion` are degrees about x at full depth, by joint; `arms` rotation vectors, rad.
    """
    frames = np.arange(RATE * SECONDS) / RATE
    depth = np.where(frames < 1, 0.0, 0.5 - 0.5 * np.cos(2 * np.pi * (frames - 1) / 2.5))
    pose = standing_pose(skeleton)
    rotation = np.tile(pose.rotation, (len(frames), 1, 1))
    vectors = {name: np.array([np.radians(angle), 0.0, 0.0]) for name, angle in flexion.items()} | (arms or {})
    for name, vector in vectors.items():
        joint = skeleton.index(name)
        rotation[:, joint] = quaternion_multiply(rotation[:, joint], quaternion_exp(depth[:, None] * vector))
    root = np.tile(pose.root_position, (len(frames), 1))
    feet = skeleton.indices(FEET)
    resting = (skeleton.path @ skeleton.rest_offset)[feet, 1] + skeleton.rest_offset[0, 1]
    placed = forward_kinematics(Pose(skeleton, root, rotation))[0]
    root[:, 1] -= (placed[:, feet, 1] - resting).min(axis=1)
    # The feet stay where they are: the pelvis goes back as the knees go forward.
    ankles = skeleton.indices(["left_ankle", "right_ankle"])
    standing = placed[:, ankles, 2] - placed[:1, ankles, 2]
    root[:, 2] -= standing[np.arange(len(frames)), np.argmin(placed[:, ankles, 1], axis=1)]
    return Pose(skeleton, root, rotation)


SQUAT = {f"{side}_{part}": angle for side in ("left", "right") for part, angle in (("hip", -80.0), ("knee", 110.0))}
SQUAT |= {"left_ankle": -30.0, "right_ankle": -30.0}
RAISED_KNEE: dict[str, float] = {"left_hip": -85.0, "left_knee": 90.0}


def tracked(pose: Pose, sensors: str):
    time = np.arange(len(pose.root_position)) / RATE
    observation = observe(pose, time, SENSOR_SETS[sensors])
    tracker = Tracker(Person(pose.skeleton))
    return tracker.step(observation, tracker.start())[0], observation, forward_kinematics(pose)


def knee_angles(position: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return the bend (T, 2) of the knees in degrees."""
    angles = []
    for side in ("left", "right"):
        hip, knee, ankle = (position[:, skeleton.index(f"{side}_{part}")] for part in ("hip", "knee", "ankle"))
        thigh, shin = knee - hip, ankle - knee
        cosine = (thigh * shin).sum(-1) / np.linalg.norm(thigh, axis=-1) / np.linalg.norm(shin, axis=-1)
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return np.stack(angles, axis=-1)


def knees_forward(estimate, skeleton: Skeleton) -> np.ndarray:
    """Return the distance (T, 2) m of the knees in front of the line from hip to ankle, in the pelvis's direction."""
    _, rotation = forward_kinematics(estimate.pose)
    ahead = quaternion_rotate(rotation[:, 0], np.tile([0.0, 0.0, 1.0], (len(rotation), 1)))
    sides = []
    for side in ("left", "right"):
        hip, knee, ankle = (estimate.points[:, skeleton.index(f"{side}_{part}")] for part in ("hip", "knee", "ankle"))
        sides.append(((knee - (hip + ankle) / 2) * ahead).sum(-1))
    return np.stack(sides, axis=-1)


@pytest.mark.parametrize("body", [0, 3])
def test_a_squat_with_tracked_pelvis_and_ankles_has_the_true_depth(body: int) -> None:
    pose = performed(unseen_body(body), SQUAT)
    estimate, _, (truth, _) = tracked(pose, "six_point")
    apart = knee_angles(estimate.points, pose.skeleton) - knee_angles(truth, pose.skeleton)
    assert np.abs(apart[RATE:]).max() < 12
    assert knees_forward(estimate, pose.skeleton)[2 * RATE].min() > 0.1


@pytest.mark.parametrize("body", [1, 4])
def test_a_raised_knee_bends_forward(body: int) -> None:
    pose = performed(unseen_body(body), RAISED_KNEE)
    estimate, _, (truth, _) = tracked(pose, "six_point")
    knee = pose.skeleton.index("left_knee")
    assert np.linalg.norm(estimate.points[:, knee] - truth[:, knee], axis=-1).max() < 0.15  # m; once 0.52


@pytest.mark.parametrize("body", [0, 2])
def test_a_squat_seen_by_cameras_keeps_pelvis_and_head(body: int) -> None:
    pose = performed(unseen_body(body), SQUAT)
    estimate, _, (truth, rotation) = tracked(pose, "headset_camera")
    turned = forward_kinematics(estimate.pose)[1]
    assert np.degrees(geodesic_angle(turned[:, 0], rotation[:, 0])).max() < 60
    head = pose.skeleton.index("head")
    assert np.linalg.norm(estimate.points[:, head] - truth[:, head], axis=-1).max() < 1e-3
    hips = pose.skeleton.indices(["left_hip", "right_hip"])
    across = estimate.points[:, hips[0]] - estimate.points[:, hips[1]]
    assert (across[:, 0] > 0).all()  # never crossed: the wearer faces +Z


@pytest.mark.parametrize("sensors", ["three_point", "headset_camera", "six_point"])
def test_a_still_wearer_does_not_move(sensors: str) -> None:
    pose = performed(unseen_body(5), {})
    estimate, _, (truth, _) = tracked(pose, sensors)
    feet = pose.skeleton.indices(FEET)
    settled = slice(RATE, None)
    moved = np.linalg.norm(np.diff(estimate.points[settled][:, feet], axis=0), axis=-1) * RATE
    assert moved.max() < 0.1
    assert estimate.points[settled][:, feet, 1].min() > -0.005
    assert np.abs(knee_angles(estimate.points[settled], pose.skeleton)).max() < 25
    assert np.linalg.norm(estimate.points[settled] - truth[settled], axis=-1)[:, :22].mean() < 0.08


@pytest.mark.parametrize(("amplitude", "frequency"), [(0.06, 0.25), (0.08, 0.15)])
def test_feet_do_not_follow_a_wearer_who_sways(amplitude: float, frequency: float) -> None:
    """The speed of feet over a tenth of a second is small while head and hands sway sideways (m, Hz)."""
    pose = standing_pose(default_skeleton())
    time = np.arange(900) / 60
    still = Pose(pose.skeleton, np.tile(pose.root_position, (900, 1)), np.tile(pose.rotation, (900, 1, 1)))
    seen = observe(still, time, THREE_POINT)
    sway = amplitude * np.sin(2 * np.pi * frequency * time)[:, None] * [1.0, 0.6, 0.6]
    position = seen.position.copy()
    position[..., 0] += sway
    tracker = Tracker(Person(pose.skeleton))
    points = tracker.step(replace(seen, position=position), tracker.start())[0].points
    feet = points[300:, pose.skeleton.indices(("left_ankle", "right_ankle"))]
    assert np.linalg.norm(feet[6:] - feet[:-6], axis=-1).max() / 0.1 < 0.018  # m/s


def test_a_found_point_is_at_its_measured_position() -> None:
    pose = performed(unseen_body(6), RAISED_KNEE)
    time = np.arange(len(pose.root_position)) / RATE
    observation = observe(pose, time, SENSOR_SETS["six_point"])
    has = observation.has_position.copy()
    ankle = observation.points.index("left_ankle")
    has[40:80, ankle] = False
    lost = replace(observation, has_position=has, has_rotation=observation.has_rotation & has)
    truth = forward_kinematics(pose)[0][:, pose.skeleton.index("left_ankle")]
    for ease, settled in ((0.0, 0), (0.25, 8)):  # s, and the frames that they last
        tracker = Tracker(Person(pose.skeleton), settings=TrackerSettings(ease=ease))
        estimate, _ = tracker.step(lost, tracker.start())
        off = np.linalg.norm(estimate.points[:, pose.skeleton.index("left_ankle")] - truth, axis=-1)
        assert off[:40].max() < 5e-3 and off[80 + settled :].max() < 5e-3
        path = np.linalg.norm(np.diff(estimate.points[79:90, pose.skeleton.index("left_ankle")], axis=0), axis=-1)
        assert ease == 0.0 or path.max() * RATE < 10.5  # m/s: it is eased in


def hands_lost(body: int, frames: slice, ease: float = 0.25) -> tuple[Skeleton, np.ndarray, np.ndarray]:
    """Both arms go up sideways, to 60° over the shoulders at 2.25 s, and down again; the hands are lost in some frames.

    Returns the skeleton, and points (T, P, 3) m: output and true.
    """
    arms = {f"{side}_shoulder": sign * np.radians([0.0, 0.0, 135.0]) for side, sign in (("left", 1), ("right", -1))}
    pose = performed(unseen_body(body), {}, arms)
    observation = observe(pose, np.arange(len(pose.root_position)) / RATE, THREE_POINT)
    has = observation.has_position.copy()
    has[frames, [[observation.points.index(name)] for name in WRISTS]] = False
    lost = replace(observation, has_position=has, has_rotation=has)
    tracker = Tracker(Person(pose.skeleton), settings=TrackerSettings(ease=ease))
    return pose.skeleton, tracker.step(lost, tracker.start())[0].points, np.asarray(forward_kinematics(pose)[0])


def speeds(points: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return speeds (T - 1, P) m/s."""
    return np.linalg.norm(np.diff(points[:, places], axis=0), axis=-1) * RATE


@pytest.mark.parametrize("body", [0, 3, 6])
def test_lost_raised_hands_stay_raised(body: int) -> None:
    top = round(2.25 * RATE)
    skeleton, output, _ = hands_lost(body, slice(top + 1, None))
    arm = output[:, skeleton.indices(WRISTS)] - output[:, skeleton.indices(["left_shoulder", "right_shoulder"])]
    over = np.degrees(np.arctan2(arm[..., 1], np.hypot(arm[..., 0], arm[..., 2])))
    assert over[top].min() > 55 and over[top : top + 45].min() > 50  # for 1.5 s


@pytest.mark.parametrize(("pace", "least", "most"), [(0.0, 50, 90), (1.0, -90, 20)])
def test_arms_raised_out_of_view_stay_raised_while_the_head_is_still(pace: float, least: float, most: float) -> None:
    """Arms stay raised 8 s after both hands are lost, and sink when the wearer walks on."""
    up = {f"{side}_shoulder": sign * np.radians([0.0, 0.0, 135.0]) for side, sign in (("left", 1), ("right", -1))}
    time = np.arange(12 * RATE) / RATE
    pose = performed(unseen_body(0), {}, up)[np.minimum(np.arange(12 * RATE), round(2.25 * RATE))]
    pose.root_position[:, 2] += pace * time
    seen = observe(pose, time, THREE_POINT)
    has = seen.has_position.copy()
    has[4 * RATE :, [seen.points.index(name) for name in WRISTS]] = False
    tracker = Tracker(Person(pose.skeleton))
    output = tracker.step(replace(seen, has_position=has, has_rotation=has), tracker.start())[0].points[-1]
    arm = output[pose.skeleton.indices(WRISTS)] - output[pose.skeleton.indices(["left_shoulder", "right_shoulder"])]
    over = np.degrees(np.arctan2(arm[:, 1], np.hypot(arm[:, 0], arm[:, 2])))
    assert least < over.min() and over.max() < most


@pytest.mark.parametrize("body", [0, 3, 6])
def test_hands_keep_their_speed_in_the_frame_in_which_they_are_lost_or_found(body: int) -> None:
    lost, found = 48, 54
    skeleton, output, _ = hands_lost(body, slice(lost, found))
    speed = speeds(output, skeleton.indices(WRISTS))
    assert speed[lost - 2].min() > 1.0
    for frame in (lost, found):
        assert (speed[frame - 1] > 0.6 * speed[frame - 2]).all()


@pytest.mark.parametrize("body", [0, 3, 6])
def test_hands_found_elsewhere_move_there_at_most_at_10_m_s(body: int) -> None:
    """Hands are lost low and found raised, with any ease."""
    found = round(2.25 * RATE)
    skeleton, output, truth = hands_lost(body, slice(20, found), ease=0.05)
    wrists = skeleton.indices(WRISTS)
    assert np.linalg.norm(output[found - 1, wrists] - truth[found, wrists], axis=-1).min() > 0.7
    assert speeds(output, wrists).max() < 10.5
    assert np.linalg.norm(output[found + 9 :, wrists] - truth[found + 9 :, wrists], axis=-1).max() < 8e-3


@pytest.mark.parametrize("body", [0, 3, 6])
def test_shins_keep_their_measured_rotation_while_ankles_are_free(body: int) -> None:
    pose = performed(unseen_body(body), SQUAT)
    estimate, _, (_, truth) = tracked(pose, "three_point_imu_feet")
    shins = pose.skeleton.indices(["left_knee", "right_knee"])
    rotation = np.asarray(forward_kinematics(estimate.pose)[1])
    assert np.degrees(geodesic_angle(rotation[:, shins], truth[:, shins])).max() < 0.5


def test_a_wearer_who_waves_stands_with_straight_knees():
    """Both feet rest while an arm waves; feet that floated by 2 cm would bend the knees by 10° more."""
    clip = performance_of_unseen_body()
    skeleton, waves = clip.pose.skeleton, slice(round(7 * clip.frame_rate), round(8 * clip.frame_rate))
    seen = observe(clip.pose, np.arange(len(clip)) / clip.frame_rate, THREE_POINT)
    tracked_pose = track(Recording(seen, skeleton), person=Person(skeleton)).clip.pose
    knees = skeleton.indices(["left_knee", "right_knee"])
    bent, truly = (
        np.degrees(2 * np.arccos(np.abs(pose.rotation[waves, knees, 0]))).mean() for pose in (tracked_pose, clip.pose)
    )
    assert bent < truly + 5


@pytest.mark.parametrize("device", ["head", "three_point"])
def test_a_wearer_who_sits_down_keeps_a_foot_on_the_floor(device: str) -> None:
    """From standing to a chair within 1.5 s, and seated: both feet once rose by 8 cm while the head went down."""
    clip = performance_of_unseen_body()
    seat = replace(clip, pose=clip.pose[6 * RATE : 14 * RATE])
    truth, _ = forward_kinematics(seat.pose)
    points = track(seat, device=device, person=Person(seat.pose.skeleton), causal=True).estimate.points
    feet = seat.pose.skeleton.indices(FEET)
    over = points[:, feet, 1].reshape(-1, 2, 3) - truth[:1, feet, 1].reshape(2, 3)  # m over a standing foot
    assert over.min(axis=(1, 2)).max() < 0.03
