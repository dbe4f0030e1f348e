"""The hand solver of gloves: batches, streams, hidden hands, calibration and bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bodysense.body.hands.glove import ALIGNMENT, MARKERS, default_glove, glove_points, marker_positions
from bodysense.body.hands.hand import angles_of, mirrored_rotations, mirrored_vectors
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.devices.gloves.hands import GloveModels, Hands, HandsSettings, load_glove_models, natural_pose
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.observing.observation import Observation
from bodysense_lab.papers.two_hands.score.baselines import LastKnown
from bodysense_lab.synthesis.hands import synthesize_hand
from bodysense_lab.synthesis.motion import HandMotion

FREE = HandsSettings()


class ConstantNetwork:
    """A network with a constant output."""

    def __init__(self, answer: np.ndarray) -> None:
        self.answer = answer.astype(np.float32)

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        return np.tile(self.answer, (len(markers), 1))


def track(hands: Hands, observation: Observation) -> dict[str, PointEstimate]:
    return hands.step(observation, hands.start())[0]


def hide(markers: np.ndarray, seed: int, share: float = 0.2, length: int = 10) -> np.ndarray:
    """Return markers (T, 9, 3) of which some are hidden for `length` frames at a time."""
    hidden = np.random.default_rng(seed).random((len(markers) // length + 1, 9)) < share
    hidden[0] = False
    return np.where(np.repeat(hidden, length, axis=0)[: len(markers), :, None], np.nan, markers)


def check_estimate(estimate: PointEstimate, frames: int) -> None:
    pose = estimate.pose
    assert pose is not None
    for values in (estimate.position, estimate.occluded, estimate.confidence, pose.root_position, pose.rotation):
        assert len(values) == frames
        assert np.isfinite(values).all()
    assert (pose.rotation[..., 0] >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(pose.rotation, axis=-1), 1, atol=1e-9)
    assert (estimate.confidence > 0).all() and (estimate.occluded >= 0).all() and (estimate.occluded <= 1 + 1e-9).all()
    np.testing.assert_allclose(forward_kinematics(pose)[0], estimate.position, atol=1e-9)


def test_positions_are_forward_kinematics_of_the_poses(
    small_models: GloveModels, hand: Skeleton, markers: np.ndarray, observe_gloves
) -> None:
    seen = observe_gloves(left=hide(markers[:90], 0), right=hide(markers[200:290], 1), left2=markers[300:390])
    bigger = hand.with_offsets(1.1 * hand.rest_offset)
    estimates = track(Hands({"left": hand, "right": bigger, "left2": hand}, small_models), seen)
    assert list(estimates) == ["left", "right", "left2"]
    for estimate in estimates.values():
        check_estimate(estimate, 90)


def test_one_call_equals_many(small_models: GloveModels, hand: Skeleton, markers: np.ndarray, observe_gloves) -> None:
    seen = observe_gloves(left=hide(markers[:60], 0), right=hide(markers[200:260], 1))
    hands = Hands({"left": hand, "right": hand}, small_models)
    batch, state = track(hands, seen), hands.start()
    for frame in range(60):
        one, state = hands.step(seen[frame : frame + 1], state)
        for name, estimate in one.items():
            np.testing.assert_array_equal(estimate.position[0], batch[name].position[frame])
            np.testing.assert_array_equal(estimate.confidence[0], batch[name].confidence[frame])


def test_a_right_hand_is_a_mirrored_left_one(
    small_models: GloveModels, hand: Skeleton, markers: np.ndarray, observe_gloves
) -> None:
    frames = hide(markers[:90], 3)
    left = track(Hands({"left": hand}, small_models), observe_gloves(left=frames))["left"]
    right = track(Hands({"right": hand}, small_models), observe_gloves(right=frames))["right"]
    np.testing.assert_allclose(right.position, mirrored_vectors(left.position, "right"), atol=1e-12)
    assert left.pose is not None and right.pose is not None
    np.testing.assert_allclose(
        right.pose.rotation, mirrored_rotations(np.asarray(left.pose.rotation), "right"), atol=1e-12
    )
    np.testing.assert_allclose(right.skeleton.rest_offset, hand.rest_offset * [-1, 1, 1])
    np.testing.assert_array_equal(left.confidence, right.confidence)


def test_distant_hands_are_solved_independently(
    small_models: GloveModels, hand: Skeleton, markers: np.ndarray, observe_gloves
) -> None:
    one, other = hide(markers[:90], 7), hide(markers[200:290], 8)
    both = track(Hands({"left": hand, "right": hand}, small_models, FREE), observe_gloves(left=one, right=other))
    alone = track(Hands({"left": hand}, small_models, FREE), observe_gloves(left=one))["left"]
    np.testing.assert_allclose(both["left"].position, alone.position, atol=1e-6)


def test_alignment_markers_locate_the_hand_and_fingers_point_at_their_markers(
    hand: Skeleton, motion: HandMotion, markers: np.ndarray, observe_gloves
) -> None:
    """With predicted angles of 0, tips are on the lines from the fingers' bases (thumb: joint 2) to their markers."""
    models = GloveModels(ConstantNetwork(np.zeros(27)), ConstantNetwork(np.zeros(26)))
    whole = replace(FREE, restraint=0.0)
    estimate = track(Hands({"left": hand}, models, whole), observe_gloves(left=markers[:50]))["left"]
    truth, world = forward_kinematics(motion.pose[:50])
    np.testing.assert_allclose(estimate.position[:, 0], truth[:, 0], atol=1e-6)
    assert estimate.pose is not None
    assert geodesic_angle(np.asarray(estimate.pose.rotation)[:, 0], world[:, 0]).max() < 1e-4
    for finger in ("index", "pinky", "thumb"):
        base = estimate.position[:, hand.index("thumb2" if finger == "thumb" else f"{finger}1")]
        tip = estimate.position[:, hand.index(f"{finger}_tip")] - base
        to_marker = markers[:50, MARKERS.index(f"{finger}_tip")] - base
        cosine = (tip * to_marker).sum(axis=-1) / np.linalg.norm(tip, axis=-1) / np.linalg.norm(to_marker, axis=-1)
        np.testing.assert_allclose(cosine, 1, atol=1e-9)


@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.integers(0, 511), min_size=12, max_size=12), st.sampled_from([1000.0, 60.0, 5.0]))
def test_any_subset_of_markers_gives_finite_hands(
    small_models: GloveModels, hand: Skeleton, markers: np.ndarray, observe_gloves, masks: list[int], rate: float
) -> None:
    frames = markers[:12].copy()
    for frame, mask in enumerate(masks):
        frames[frame, [bool(mask >> k & 1) for k in range(9)]] = np.nan
    seen = observe_gloves(rate, left=frames)
    check_estimate(track(Hands({"left": hand}, small_models), seen)["left"], 12)


@pytest.mark.parametrize("hidden", [ALIGNMENT, tuple(range(8)), tuple(range(9))])
def test_a_still_hand_does_not_move_when_markers_are_hidden(
    small_models: GloveModels, hand: Skeleton, markers: np.ndarray, observe_gloves, hidden: tuple[int, ...]
) -> None:
    frames = np.tile(markers[5], (40, 1, 1))
    frames[20:, list(hidden)] = np.nan
    without_fading = replace(FREE, fading=None)
    estimate = track(Hands({"left": hand}, small_models, without_fading), observe_gloves(left=frames))["left"]
    np.testing.assert_allclose(estimate.position[20:], np.tile(estimate.position[19], (20, 1, 1)), atol=2e-4)


def test_a_lost_hand_relaxes_and_its_expected_error_grows(hand: Skeleton, markers: np.ndarray, observe_gloves) -> None:
    relaxed = natural_pose(hand)
    models = GloveModels(ConstantNetwork(np.zeros(27)), ConstantNetwork(np.asarray(angles_of(relaxed.rotation[1:]))))
    frames = np.tile(markers[5], (200, 1, 1))
    frames[50:] = np.nan
    estimate = track(Hands({"left": hand}, models, FREE), observe_gloves(left=frames))["left"]
    step = np.linalg.norm(np.diff(estimate.position, axis=0), axis=-1).max(axis=1)
    assert step[:50].max() < 1e-6  # 0.5 s …
    assert step[50:78].max() < 1e-6
    assert 0 < step[85:130].max() < 0.005  # … then 1 s
    assert step[145:].max() < 1e-6
    wanted = forward_kinematics(relaxed)[0]
    own = estimate.position[-1] - estimate.position[-1, 0]
    turn = Rotation.align_vectors(own[1:], (wanted - wanted[0])[1:])[0]
    np.testing.assert_allclose(
        own, turn.apply(wanted - wanted[0]), atol=4e-3
    )  # angles cannot represent all of the pose
    error = estimate.confidence[:, 0]
    assert error[49] < 0.002 and (np.diff(error[50:]) >= 0).all() and error[-1] > 0.05
    np.testing.assert_array_equal(estimate.occluded[49], 0)
    np.testing.assert_allclose(estimate.occluded[50:], 1)


def test_a_hand_that_was_never_seen_is_relaxed_at_the_origin(
    small_models: GloveModels, hand: Skeleton, observe_gloves
) -> None:
    estimate = track(Hands({"right": hand}, small_models), observe_gloves(right=np.full((3, 9, 3), np.nan)))["right"]
    check_estimate(estimate, 3)
    assert np.linalg.norm(estimate.position, axis=-1).max() < 0.3
    assert (estimate.confidence >= 0.3).all()


def test_other_points_are_ignored_and_missing_or_impossible_ones_are_hidden(
    small_models: GloveModels, hand: Skeleton, markers: np.ndarray, observe_gloves
) -> None:
    hands = Hands({"left": hand}, small_models)
    seen = observe_gloves(left=markers[:20])
    more = observe_gloves(right=markers[:20], left=markers[:20])
    np.testing.assert_allclose(track(hands, more)["left"].position, track(hands, seen)["left"].position, atol=1e-12)
    keep = [k for k, point in enumerate(seen.points) if point != "left_glove_thumb_tip"]
    fewer = replace(
        seen,
        points=tuple(seen.points[k] for k in keep),
        position=seen.position[:, keep],
        rotation=seen.rotation[:, keep],
        has_position=seen.has_position[:, keep],
        has_rotation=seen.has_rotation[:, keep],
    )
    hidden = markers[:20].copy()
    hidden[:, MARKERS.index("thumb_tip")] = np.nan
    wanted = track(hands, observe_gloves(left=hidden))["left"]
    np.testing.assert_array_equal(track(hands, fewer)["left"].position, wanted.position)
    far = seen.position.copy()
    far[:, MARKERS.index("thumb_tip")] = [1e6, np.inf, np.nan]
    impossible = replace(seen, position=far)
    np.testing.assert_array_equal(track(hands, impossible)["left"].position, wanted.position)
    nothing = replace(
        seen,
        points=("head",),
        position=seen.position[:, :1],
        rotation=seen.rotation[:, :1],
        has_position=seen.has_position[:, :1],
        has_rotation=seen.has_rotation[:, :1],
    )
    check_estimate(track(hands, nothing)["left"], 20)


def test_time_must_increase_and_gaps_reset_the_state(
    small_models: GloveModels, hand: Skeleton, markers: np.ndarray, observe_gloves
) -> None:
    hands = Hands({"left": hand}, small_models)
    seen = observe_gloves(left=markers[:10])
    _, state = hands.step(seen, hands.start())
    with pytest.raises(BodysenseError, match=r"a frame at 0\.15 s came after one at 0\.15 s; give frames in order"):
        hands.step(replace(seen[:1], time=seen.time[-1:]), state)
    with pytest.raises(BodysenseError, match="a frame at nan s"):
        hands.step(replace(seen[:1], time=np.array([np.nan])), hands.start())
    later = replace(seen, time=seen.time + 10)
    after, _ = hands.step(later, state)
    np.testing.assert_allclose(after["left"].position, track(hands, seen)["left"].position, atol=1e-12)


def test_bad_names_and_settings_are_refused(
    small_models: GloveModels, hand: Skeleton, markers: np.ndarray, observe_gloves
) -> None:
    with pytest.raises(BodysenseError, match="the hand 'third' is neither left nor right"):
        Hands({"third": hand}, small_models)
    with pytest.raises(BodysenseError, match="no hand is named"):
        Hands({}, small_models)
    seen = observe_gloves(left=markers[:2])
    twice = replace(seen, points=(*glove_points("left")[:-1], glove_points("left")[0]))
    with pytest.raises(BodysenseError, match="'left_glove_pinky_base' is named twice"):
        track(Hands({"left": hand}, small_models), twice)
    with pytest.raises(BodysenseError, match="speed is 0; it must be positive"):
        HandsSettings(speed=0.0)
    with pytest.raises(BodysenseError, match="longest_gap is -1; it must be positive"):
        HandsSettings(longest_gap=-1.0)
    with pytest.raises(BodysenseError, match=r"hold is -0\.1; it must be 0 or more"):
        HandsSettings(hold=-0.1)


def test_a_custom_gap_filler_without_rejection(
    small_models: GloveModels, hand: Skeleton, markers: np.ndarray, observe_gloves
) -> None:
    frames = markers[:30].copy()
    frames[10:, 5] = np.nan
    unfilled = np.where(np.isnan(frames), frames[9], frames)
    plain = HandsSettings(rejection=None)
    estimates = track(Hands({"left": hand}, small_models, plain, gap_filler=LastKnown()), observe_gloves(left=frames))
    wanted = track(Hands({"left": hand}, small_models, plain), observe_gloves(left=unfilled))
    np.testing.assert_allclose(estimates["left"].position, wanted["left"].position, atol=1e-9)


def test_a_flat_hand_is_flat_after_calibration(small_models: GloveModels, hand: Skeleton, observe_gloves) -> None:
    """After calibration the predicted rotations of the flat hand are the identity (4.4)."""
    rotation = np.zeros((5, 16, 4))
    rotation[..., 0] = 1.0
    flat = Pose(hand, np.linspace(0, 1, 15).reshape(5, 3), rotation)
    seen = observe_gloves(left=np.asarray(marker_positions(default_glove(), flat)))
    hands = Hands({"left": hand}, small_models, FREE)
    before, after = track(hands, seen)["left"], track(hands.calibrated(seen), seen)["left"]
    assert before.pose is not None and after.pose is not None
    identity = np.array([1.0, 0, 0, 0])
    assert geodesic_angle(np.asarray(before.pose.rotation)[:, 1:], identity).max() > 0.1
    assert geodesic_angle(np.asarray(after.pose.rotation)[:, 1:], identity).max() < 1e-4
    np.testing.assert_allclose(after.position, forward_kinematics(flat)[0], atol=1e-5)
    hidden = replace(seen, has_position=np.zeros_like(seen.has_position))
    with pytest.raises(BodysenseError, match="in none of 5 frames are all markers of left seen"):
        hands.calibrated(hidden)


def test_moving_hands_cannot_be_calibrated(hand: Skeleton, observe_gloves) -> None:
    rng = np.random.default_rng(1)
    moving = synthesize_hand(hand, 4.0, rng).pose
    seen = observe_gloves(left=np.asarray(marker_positions(default_glove(), moving)))
    with pytest.raises(
        BodysenseError, match=r"finger joints turn by \d+° on average, at most 5° in a calibration; hold"
    ):
        Hands({"left": hand}, load_glove_models(), FREE).calibrated(seen)
