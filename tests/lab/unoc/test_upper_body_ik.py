"""Upper body by analytic IK: hands reached, bones kept, elbows natural, symmetric, continuous, any hand missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.devices.simulated.noise import hide
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import THREE_POINT
from bodysense.geometry.rotation import quaternion_canonical, quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.io.clip import Clip
from bodysense.io.datasets.sources import list_sources, read_source
from bodysense.observing.checks import check_observation
from bodysense.observing.observation import Observation
from bodysense.takes.last_known import Hold
from bodysense_lab.papers.unoc import upper_body_ik
from bodysense_lab.papers.unoc.ik_tracker import Estimator, IkTracker
from bodysense_lab.papers.unoc.upper_body_ik import UpperBodyIk

SKELETON = default_skeleton()
IK = UpperBodyIk(SKELETON)
HEAD, CHEST = SKELETON.index("head"), SKELETON.index("spine3")
SHOULDERS, ELBOWS, WRISTS = (
    SKELETON.indices([f"left_{part}", f"right_{part}"]) for part in ("shoulder", "elbow", "wrist")
)
STANDING = np.asarray(forward_kinematics(standing_pose(SKELETON))[0])
ARM = float(SKELETON.bone_length[[ELBOWS[0], WRISTS[0]]].sum())
LEFT_TO_RIGHT = np.array([-1.0, 1.0, 1.0])


def complete(observation: Observation, ik: UpperBodyIk = IK) -> PointEstimate:
    return ik.step(observation, ik.start())[0]


def people(count: int, seed: int = 0, reach: float = 0.9) -> Observation:
    """Standing people who look about and hold their hands anywhere before and beside them, one a frame."""
    rng = np.random.default_rng(seed)
    head = STANDING[HEAD] + rng.uniform([-1, -0.1, -1], [1, 0.02, 1], (count, 3))
    facing = quaternion_exp(rng.uniform(-np.pi, np.pi, (count, 1)) * np.array([0.0, 1, 0]))
    look = quaternion_multiply(facing, quaternion_exp(rng.uniform(-0.4, 0.4, (count, 3))))
    direction = np.abs(rng.standard_normal((count, 2, 3)))
    direction[:, 1, 0] *= -1
    direction[..., 1] -= 1
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    far = reach * ARM * rng.uniform(0.35, 1, (count, 2, 1))
    hands = STANDING[SHOULDERS] - STANDING[HEAD] + far * direction
    position = np.concatenate([head[:, None], head[:, None] + quaternion_rotate(facing[:, None], hands)], axis=1)
    turned = quaternion_exp(rng.uniform(-0.6, 0.6, (count, 2, 3)))
    rotation = np.concatenate([look[:, None], quaternion_multiply(facing[:, None], turned)], axis=1)
    known = np.ones((count, 3), dtype=bool)
    points = ("head", "left_wrist", "right_wrist")
    rotation = quaternion_canonical(rotation)
    accuracy, time = np.full(known.shape, 0.001), np.arange(count) / 30
    return check_observation(Observation(points, position, rotation, known, known.copy(), accuracy, time))


def from_shoulder(estimate: PointEstimate, points: np.ndarray) -> np.ndarray:
    """(T, 2, 3) m: places from the shoulders, in the upper chest's frame."""
    assert estimate.pose is not None
    chest = forward_kinematics(estimate.pose)[1][:, CHEST]
    turn = np.stack([chest, chest], axis=1) * [1, -1, -1, -1]
    return quaternion_rotate(turn, estimate.position[:, points] - estimate.position[:, SHOULDERS])


# --- what is measured, and bones


def test_hands_within_reach_are_reached() -> None:
    seen = people(2000, reach=1.15)
    estimate = complete(seen)
    missed = np.linalg.norm(estimate.position[:, WRISTS] - seen.position[:, 1:], axis=-1)
    upper, fore = SKELETON.bone_length[ELBOWS[0]], SKELETON.bone_length[WRISTS[0]]
    away = np.linalg.norm(seen.position[:, 1:] - estimate.position[:, SHOULDERS], axis=-1)
    reachable = (away <= upper + fore) & (away >= abs(upper - fore))
    assert 0.8 < reachable.mean() < 1, "the sample holds both"
    assert missed[reachable].max() <= 1e-6
    np.testing.assert_allclose(missed[~reachable & (away > ARM)], away[~reachable & (away > ARM)] - ARM, atol=1e-9)
    np.testing.assert_allclose(estimate.confidence[:, WRISTS], missed, atol=1e-12)
    np.testing.assert_allclose(estimate.position[:, HEAD], seen.position[:, 0], atol=1e-9)


def test_a_far_hand_pulls_the_collarbone() -> None:
    """A hand at 103 % of the arm's length in front is reached, by a shoulder that comes along."""
    near, far = people(1), people(1)
    for seen, share in ((near, 0.9), (far, 1.03)):
        shoulders = complete(seen).position[0, SHOULDERS]
        seen.position[0, 1:] = shoulders + share * ARM * quaternion_rotate(seen.rotation[0, 0], np.array([0.0, 0, 1]))
    moved = [complete(seen).position[0] for seen in (near, far)]
    np.testing.assert_allclose(moved[1][WRISTS], far.position[0, 1:], atol=1e-6)
    assert (np.linalg.norm(moved[1][SHOULDERS] - moved[0][SHOULDERS], axis=-1) > 0.005).all()


@pytest.mark.parametrize("height", [1.4, 2.0])
def test_bone_lengths_are_kept(waving_clip: Clip, height: float) -> None:
    ik = UpperBodyIk(SKELETON.scaled(height))
    for seen in (people(200, reach=1.3), observe(waving_clip.pose, waving_clip.time, THREE_POINT)):
        estimate = complete(seen, ik)
        parents = np.array(SKELETON.parents)[1:]
        length = np.linalg.norm(estimate.position[:, 1:] - estimate.position[:, parents], axis=-1)
        np.testing.assert_allclose(length, np.tile(ik.skeleton.bone_length[1:], (len(seen), 1)), atol=1e-12)
        assert estimate.pose is not None
        np.testing.assert_allclose(forward_kinematics(estimate.pose)[0], estimate.position, atol=1e-12)


def test_measured_rotations_are_the_joints_own() -> None:
    seen = people(50)
    pose = complete(seen).pose
    assert pose is not None
    world = forward_kinematics(pose)[1][:, [HEAD, *WRISTS]]
    turned = Rotation.from_quat(world.reshape(-1, 4)[:, [1, 2, 3, 0]])
    wanted = Rotation.from_quat(seen.rotation.reshape(-1, 4)[:, [1, 2, 3, 0]])
    assert (turned * wanted.inv()).magnitude().max() < 1e-9


# --- elbows


def test_elbows_bend_about_their_hinge_and_never_backward() -> None:
    pose = complete(people(2000)).pose
    assert pose is not None
    for elbow, sign in zip(ELBOWS, (-1, 1), strict=True):
        turn = Rotation.from_quat(pose.rotation[:, elbow][:, [1, 2, 3, 0]]).as_rotvec()
        np.testing.assert_allclose(turn[:, [0, 2]], 0, atol=1e-6)
        assert (sign * turn[:, 1] > 0).all() and np.ptp(turn[:, 1]) > 1


def test_elbows_are_where_people_have_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """For level hands ahead, elbows hang below the line from shoulder to hand, outside the chest.

    Below overhead hands they point outward and forward of straight behind. Above hanging hands they point backward.
    """
    for name in ("_SWIVEL_BY_TWIST", "_SWIVEL_BY_FLEXION"):  # so that the hand's rotation does not turn the elbow
        monkeypatch.setattr(upper_body_ik, name, 0.0)
    directions = {
        "ahead": (0.1, -0.1, 0.7),
        "up": (0.1, 0.75, 0.25),
        "down": (0.15, -0.8, 0.1),
        "across": (-0.4, 0, 0.4),
    }
    elbows = {}
    for name, direction in directions.items():
        hands = ARM * np.stack([np.array(direction), np.array(direction) * LEFT_TO_RIGHT])
        seen = people(1)
        seen.position[0] = np.stack([STANDING[HEAD], *(STANDING[SHOULDERS] + hands)])
        seen.rotation[0] = [1, 0, 0, 0]
        estimate = complete(seen, IK)
        hand, elbow = from_shoulder(estimate, WRISTS)[0, 0], from_shoulder(estimate, ELBOWS)[0, 0]
        along = hand / np.linalg.norm(hand)
        elbows[name] = elbow - elbow @ along * along
    outward, up, forward = range(3)
    assert elbows["ahead"][up] < -0.08 and elbows["ahead"][outward] > 0
    assert elbows["up"][outward] > 0.08
    assert elbows["down"][forward] < -0.02
    assert elbows["across"][outward] > 0.02 and elbows["across"][up] < 0


def test_a_bent_wrist_turns_the_elbow_toward_its_limits() -> None:
    """Palms pushed up against a wall ask for lower elbows than hands that hang from raised wrists."""
    elbow = []
    for bend in (-0.8, 0.0, 0.8):
        seen = people(1)
        hands = ARM * np.array([[0.05, -0.05, 0.5], [-0.05, -0.05, 0.5]])
        seen.position[0] = np.stack([STANDING[HEAD], *(STANDING[SHOULDERS] + hands)])
        seen.rotation[0, 0] = [1, 0, 0, 0]
        for hand, side in ((1, 1), (2, -1)):  # fingers forward, palms down, then bent about the wrist's own axis
            ahead = quaternion_exp(np.array([0.0, -side * np.pi / 2, 0.0]))
            seen.rotation[0, hand] = quaternion_multiply(ahead, quaternion_exp(np.array([0.0, 0.0, side * bend])))
        elbow.append(complete(seen).position[0, ELBOWS, 1])
    assert (elbow[0] > elbow[1] + 0.01).all() and (elbow[1] > elbow[2] + 0.01).all()


# --- symmetries


def test_left_and_right_are_mirror_images() -> None:
    seen = people(500)
    mirrored = replace(
        seen,
        position=seen.position[:, [0, 2, 1]] * LEFT_TO_RIGHT,
        rotation=seen.rotation[:, [0, 2, 1]] * [1, 1, -1, -1],
    )
    expected = complete(seen).position[:, SKELETON.mirror] * LEFT_TO_RIGHT
    np.testing.assert_allclose(complete(mirrored).position, expected, atol=1e-12)


def test_turning_and_moving_the_input_turns_and_moves_the_output() -> None:
    seen = people(100)
    for angle in (0.7, 2.5, -3.0):
        yaw, shift = quaternion_exp(np.array([0.0, angle, 0.0])), np.array([3.0, 0.0, -2.0])
        moved = replace(
            seen,
            position=quaternion_rotate(yaw, seen.position) + shift,
            rotation=quaternion_canonical(quaternion_multiply(yaw, seen.rotation)),
        )
        expected = quaternion_rotate(yaw, complete(seen).position) + shift
        np.testing.assert_allclose(complete(moved).position, expected, atol=1e-9)


def test_a_body_of_another_size_moves_alike() -> None:
    seen, tall = people(100), UpperBodyIk(SKELETON.scaled(SKELETON.height * 1.2))
    grown = replace(seen, position=seen.position * 1.2)
    np.testing.assert_allclose(complete(grown, tall).position, 1.2 * complete(seen).position, atol=1e-9)


# --- over time


def test_small_changes_of_the_input_change_the_output_little() -> None:
    rng = np.random.default_rng(3)
    seen, size = people(2000), 1e-7
    nudged = replace(
        seen,
        position=seen.position + size * rng.uniform(-1, 1, seen.position.shape),
        rotation=quaternion_multiply(seen.rotation, quaternion_exp(size * rng.uniform(-1, 1, seen.position.shape))),
    )
    upper = SKELETON.indices(["neck", "spine3", *(SKELETON.points[p] for p in (*SHOULDERS, *ELBOWS, *WRISTS))])
    change = np.linalg.norm(complete(nudged).position - complete(seen).position, axis=-1)[:, upper] / size
    assert np.median(change) < 2 and change.max() < 20


def test_frames_are_calls(waving_clip: Clip) -> None:
    seen = observe(waving_clip.pose, waving_clip.time, THREE_POINT)
    hidden = np.random.default_rng(2).random(seen.has_position.shape) < 0.4
    seen = hide(seen, hidden)
    whole, end = IK.step(seen, IK.start())
    for sizes in ([1] * 90, [7, 1, 40, 42]):
        state, rows, first = IK.start(), [], 0
        for size in sizes:
            estimate, state = IK.step(seen[first : first + size], state)
            rows.append(estimate)
            first += size
        for name in ("position", "occluded", "confidence"):
            rebuilt = np.concatenate([getattr(row, name) for row in rows])
            np.testing.assert_allclose(getattr(whole, name), rebuilt, atol=1e-12)
        for name, value in vars(end).items():
            np.testing.assert_allclose(value, getattr(state, name), atol=1e-12)
    assert np.isfinite(whole.position).all()
    np.testing.assert_array_equal(whole.occluded[:, [HEAD, *WRISTS]], hidden)


# --- what is missing


def without(seen: Observation, *points: str, since: int = 0) -> Observation:
    hidden = np.zeros(seen.has_position.shape, dtype=bool)
    hidden[since:, [seen.points.index(point) for point in points]] = True
    return hide(seen, hidden)


@pytest.mark.parametrize("lost", [("left_wrist",), ("right_wrist",), ("left_wrist", "right_wrist")])
def test_a_hand_that_was_never_seen_hangs(lost: tuple[str, ...]) -> None:
    estimate = complete(without(people(200), *lost))
    for point in lost:
        side = 0 if point.startswith("left") else 1
        hand = from_shoulder(estimate, WRISTS)[:, side]
        assert (hand[:, 1] < -0.9 * ARM).all()
        assert (estimate.occluded[:, WRISTS[side]] == 1).all() and (estimate.confidence[:, WRISTS[side]] > 0.05).all()


@pytest.mark.parametrize("lost", [("left_wrist",), ("left_wrist", "right_wrist")])
def test_a_hand_that_is_lost_stays_with_the_chest(lost: tuple[str, ...]) -> None:
    """Seen once, then the body walks on and turns; the trunk keeps its turn from the head."""
    rng = np.random.default_rng(5)
    seen = people(1)
    turns = quaternion_exp(np.cumsum(rng.uniform(0, 0.04, (20, 1)), axis=0) * np.array([0.0, 1, 0]))
    moved = seen.position[0] + np.arange(20)[:, None, None] * [0.03, 0.0, 0.02]
    rotation = np.tile(seen.rotation[0], (20, 1, 1))
    rotation[:, 0] = quaternion_canonical(quaternion_multiply(turns, rotation[:, 0]))
    known = np.ones((20, 3), dtype=bool)
    walk = Observation(seen.points, moved, rotation, known, known, np.full(known.shape, 0.001), np.arange(20) / 30)
    estimate = complete(without(walk, *lost, since=1))
    for point in lost:
        side = 0 if point.startswith("left") else 1
        hand = from_shoulder(estimate, WRISTS)[:, side]
        np.testing.assert_allclose(hand, np.tile(hand[0], (20, 1)), atol=1e-9)
    if len(lost) == 1:
        np.testing.assert_allclose(estimate.position[:, WRISTS[1]], moved[:, 2], atol=1e-6)


def test_a_hand_without_orientation_keeps_the_last_one() -> None:
    seen = people(3)
    seen.rotation[1:, 1:], seen.has_rotation[1:, 1:] = np.nan, False
    estimate = complete(seen)
    np.testing.assert_allclose(estimate.position[:, WRISTS], seen.position[:, 1:], atol=1e-6)
    assert estimate.pose is not None
    chest, *wrists = np.moveaxis(forward_kinematics(estimate.pose)[1][:, [CHEST, *WRISTS]], 1, 0)
    for wrist in wrists:
        turn = quaternion_canonical(quaternion_multiply(chest * [1, -1, -1, -1], wrist))
        np.testing.assert_allclose(turn, np.tile(turn[0], (3, 1)), atol=1e-9)


def test_a_head_that_is_lost_stays_in_the_world() -> None:
    seen = people(1)
    still = replace(
        seen,
        **{name: np.repeat(getattr(seen, name), 5, axis=0) for name in ("position", "rotation")},
        **{name: np.ones((5, 3), dtype=bool) for name in ("has_position", "has_rotation")},
        time=np.arange(5) / 30,
    )
    estimate = complete(without(still, "head", since=2))
    np.testing.assert_allclose(estimate.position, np.tile(estimate.position[0], (5, 1, 1)), atol=1e-12)


def test_before_anything_is_seen_a_body_stands_at_the_origin() -> None:
    estimate = complete(without(people(4), "head", "left_wrist", "right_wrist"))
    np.testing.assert_allclose(estimate.position[:, HEAD], np.tile(STANDING[HEAD], (4, 1)), atol=1e-9)
    assert np.isfinite(estimate.position).all() and (estimate.occluded == 1).all()


@pytest.mark.parametrize("offset", [np.zeros(3), np.array([1e-9, 0, 0]), np.array([-0.42, 0.32, -0.85]) * ARM])
def test_hands_at_places_without_direction(offset: np.ndarray) -> None:
    """On the shoulder itself, and where the reference of the elbow is undefined: an answer, and one with its bones."""
    seen = people(1)
    shoulder = complete(seen).position[0, SHOULDERS[0]]
    seen.position[0, 1] = shoulder + offset
    estimate = complete(seen)
    assert np.isfinite(estimate.position).all()
    length = np.linalg.norm(estimate.position[0, WRISTS[0]] - estimate.position[0, ELBOWS[0]])
    assert length == pytest.approx(SKELETON.bone_length[WRISTS[0]], abs=1e-9)


# --- tracker, real motion


def test_the_tracker_takes_it(waving_clip: Clip) -> None:
    seen = observe(waving_clip.pose, waving_clip.time, THREE_POINT)[:10]
    tracker = IkTracker(IK)
    pose, estimate, _ = tracker.step(seen, tracker.start())
    assert isinstance(pose, Pose)
    reached = np.asarray(forward_kinematics(pose)[0])[:, [HEAD, *WRISTS]]
    assert np.linalg.norm(reached - seen.position, axis=-1).max() < 0.05
    np.testing.assert_array_equal(estimate.position, complete(seen).position)


def test_it_is_better_than_a_standing_body(motion_data) -> None:
    """Real motion: errors of neck, shoulders and elbows against those of a standing body under the head."""
    sources = [source for source in list_sources(motion_data) if source.category in ("talk_gesture", "everyday")]
    joints = SKELETON.indices(["neck", *(SKELETON.points[p] for p in (*SHOULDERS, *ELBOWS))])
    errors = []
    for source in sources[::300]:
        clip = read_source(source)
        truth, seen = (
            np.asarray(forward_kinematics(clip.pose)[0]),
            observe(clip.pose, clip.time, THREE_POINT),
        )
        methods: list[Estimator] = [UpperBodyIk(clip.pose.skeleton), Hold(clip.pose.skeleton)]
        for method in methods:
            estimate, _ = method.step(seen[:300], method.start())
            errors.append(np.linalg.norm(estimate.position - truth[:300], axis=-1)[:, joints].mean())
    ours, standing = np.array(errors).reshape(-1, 2).mean(axis=0)
    assert ours < 0.06 and ours < 0.6 * standing
