"""Gap fillers of hidden markers, and the paper's baselines."""

from __future__ import annotations

import numpy as np
import pytest
from filled_frames import filled_frames
from scipy.spatial.transform import Rotation

from bodysense.body.hands.glove import default_glove, template
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.gap_fillers import GapFiller, GapFillerStack, NetworkGapFiller, RigidGapFiller
from bodysense.devices.gloves.hands import natural_markers
from bodysense.errors import BodysenseError
from bodysense_lab.papers.two_hands.score.baselines import AffineCombination, LastKnown, MovingAverage


def hide(markers: np.ndarray, start: int, stop: int, *which: int) -> np.ndarray:
    """Return markers (T, 9, 3) as one hand (T, 1, 9, 3), with some hidden in frames `start` to `stop`."""
    frames = markers[:, None].copy()
    frames[start:stop, :, list(which)] = np.nan
    return frames


def test_last_known_position_is_kept(markers: np.ndarray) -> None:
    filled = filled_frames(LastKnown(), hide(markers, 20, 40, 3, 5))[:, 0]
    np.testing.assert_array_equal(filled[20:40, 3], np.tile(markers[19, 3], (20, 1)))
    np.testing.assert_array_equal(filled[40:], markers[40:])
    never = filled_frames(LastKnown(), hide(markers, 0, 5, 2))
    assert np.isnan(never[:5, 0, 2]).all()


def test_moving_average_continues_an_accelerated_path() -> None:
    # A marker moves by 1, 2, 3 … mm a frame. The mean of its last 20 steps continues.
    place = np.cumsum(np.arange(60)) * 1e-3
    frames = np.zeros((60, 1, 9, 3))
    frames[..., 0] = place[:, None, None]
    frames[40:50, :, 2] = np.nan
    filled = filled_frames(MovingAverage(), frames)[:, 0, 2, 0]
    step = (place[39] - place[19]) / 20
    np.testing.assert_allclose(filled[40:50], place[39] + step * np.arange(1, 11), atol=1e-12)
    np.testing.assert_array_equal(filled[50:], place[50:])
    # Twice the frame rate.
    double = np.repeat(frames, 2, axis=0)[1:]
    assert np.isfinite(filled_frames(MovingAverage(), double, 1 / 120)).all()


def test_moving_average_restarts_when_a_marker_is_found_again() -> None:
    frames = np.zeros((10, 1, 9, 3))
    frames[3:5, 0, 0] = np.nan
    frames[5:, 0, 0, 1] = 5.0  # 5 m away, which must not count as a step
    frames[6:, 0, 0] = np.nan
    np.testing.assert_array_equal(filled_frames(MovingAverage(), frames)[6:, 0, 0], np.tile([0.0, 5.0, 0.0], (4, 1)))


def test_affine_combination_equals_ridge_regression(markers: np.ndarray) -> None:
    hidden, known = [2, 6], [0, 1, 3, 4, 5, 7, 8]
    filled = filled_frames(AffineCombination(), hide(markers, 20, 40, *hidden))[:, 0]
    before = markers[19] - markers[19, known].mean(axis=0)
    rows = np.concatenate([before[known], np.ones((7, 1))], axis=1)
    wanted = np.concatenate([before[hidden], np.ones((2, 1))], axis=1)
    # Ridge as least squares with √λ rows below: independent of equation 8.
    stacked = np.concatenate([rows.T, np.sqrt(1e-8) * np.eye(7)])
    weights = np.linalg.lstsq(stacked, np.concatenate([wanted.T, np.zeros((7, 2))]), rcond=None)[0].T
    for t in range(20, 40):
        center = markers[t, known].mean(axis=0)
        np.testing.assert_allclose(filled[t, hidden], weights @ (markers[t, known] - center) + center, atol=1e-9)
    equation8 = wanted @ rows.T @ np.linalg.inv(rows @ rows.T + 1e-8 * np.eye(7))
    np.testing.assert_allclose(weights, equation8, atol=1e-5)


def test_affine_combination_is_exact_for_rigid_motion_and_rotates_with_the_hand(markers: np.ndarray) -> None:
    still = np.tile(markers[10], (30, 1, 1))
    turns = Rotation.from_rotvec(np.linspace(0, 2, 30)[:, None] * [0.2, 1.0, 0.3]).as_matrix()
    moving = still @ turns.swapaxes(1, 2) + np.linspace(0, 1, 30)[:, None, None]
    filled = filled_frames(AffineCombination(), hide(moving, 5, 30, 1, 4))[:, 0]
    np.testing.assert_allclose(filled, moving, atol=1e-4)
    frames = hide(markers[:60], 20, 50, 0, 8)
    turn, shift = Rotation.from_quat(np.random.default_rng(0).normal(size=4)).as_matrix(), np.array([3.0, -1.0, 10.0])
    np.testing.assert_allclose(
        filled_frames(AffineCombination(), frames @ turn.T + shift),
        filled_frames(AffineCombination(), frames) @ turn.T + shift,
        atol=1e-7,
    )


def test_affine_combination_uses_the_frame_before_and_needs_one_marker(markers: np.ndarray) -> None:
    frames = hide(markers[:60], 20, 40, 3)
    frames[30:45, :, 5] = np.nan  # a second marker is hidden, then the first one is found
    filled = filled_frames(AffineCombination(), frames)
    assert np.isfinite(filled).all()
    np.testing.assert_array_equal(filled[~np.isnan(frames)], frames[~np.isnan(frames)])
    nothing = hide(markers[:30], 20, 30, *range(9))
    assert np.isnan(filled_frames(AffineCombination(), nothing)[20:]).all()
    one = hide(markers[:30], 20, 30, *range(1, 9))
    alone = np.repeat(markers[20:30, :1], 9, axis=1)  # the only combination of one marker
    np.testing.assert_allclose(filled_frames(AffineCombination(), one)[20:, 0], alone, atol=1e-6)


class ConstantNetwork:
    """A network that predicts the same shape for every hand and records its inputs."""

    def __init__(self, shape: np.ndarray) -> None:
        self.shape = shape
        self.seen: list[np.ndarray] = []

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        assert markers.dtype == hand.dtype == np.float32
        assert markers.shape == (len(markers), 27) and hand.shape == (len(markers), 87)
        self.seen.append(markers)
        return np.tile(self.shape.reshape(-1), (len(markers), 1)).astype(np.float32)


def test_the_network_receives_registered_markers_and_its_output_is_transformed_back(hand: Skeleton) -> None:
    big = hand.with_offsets(1.2 * hand.rest_offset)
    flat = template(default_glove(), hand)
    model = ConstantNetwork(flat)
    gap_filler = NetworkGapFiller(model, (big,))
    turn, place = (
        Rotation.from_quat(np.random.default_rng(1).normal(size=(3, 4))).as_matrix(),
        np.arange(9.0).reshape(3, 3),
    )
    world = 1.2 * flat @ turn.swapaxes(1, 2) + place[:, None]
    frames = world.copy()
    frames[:, [2, 7]] = np.nan
    filled, state = gap_filler.fill(frames, 1 / 60, gap_filler.start(3))
    np.testing.assert_allclose(filled, world, atol=1e-6)  # this hand is flat
    seen = model.seen[0].reshape(3, 9, 3)
    np.testing.assert_array_equal(seen[:, [2, 7]], 0)
    np.testing.assert_allclose(
        np.delete(seen, [2, 7], axis=1), np.delete(np.tile(flat, (3, 1, 1)), [2, 7], 1), atol=1e-6
    )
    np.testing.assert_allclose(state.rotation, turn, atol=1e-6)


def test_the_network_does_not_fill_hands_with_few_markers(hand: Skeleton, markers: np.ndarray) -> None:
    gap_filler = NetworkGapFiller(ConstantNetwork(template(default_glove(), hand)), (hand,))
    frame = np.stack([markers[0], markers[1], markers[2]])
    frame[0, 3:] = np.nan
    frame[1, 2:] = np.nan
    frame[2] = np.nan
    filled, _ = gap_filler.fill(frame, 1 / 60, gap_filler.start(3))
    assert np.isfinite(filled[0]).all()
    np.testing.assert_array_equal(filled[1:], frame[1:])
    with pytest.raises(BodysenseError, match="made for 2 hands, started for 3"):
        NetworkGapFiller(ConstantNetwork(frame[0]), (hand, hand)).start(3)
    with pytest.raises(BodysenseError, match="fewest is 5"):
        NetworkGapFiller(ConstantNetwork(frame[0]), (hand,), fewest=5)


def test_the_rigid_gap_filler_moves_and_relaxes_the_last_shape(hand: Skeleton, markers: np.ndarray) -> None:
    natural = natural_markers(default_glove(), hand)
    gap_filler = RigidGapFiller(natural, hold=0.5, relaxing=1.0)
    frames = hide(np.concatenate([markers[:30], np.tile(markers[30], (120, 1, 1))]), 30, 150, *range(9))
    filled = filled_frames(gap_filler, frames)[:, 0]
    np.testing.assert_allclose(filled[30:58], np.tile(markers[29], (28, 1, 1)), atol=1e-9)
    between = np.linalg.norm(filled[-1][:, None] - filled[-1], axis=-1)
    np.testing.assert_allclose(between, np.linalg.norm(natural[:, None] - natural, axis=-1), atol=1e-9)
    np.testing.assert_allclose(filled[-1, :3], markers[29, :3], atol=1e-3)  # the back of the hand stays
    assert np.linalg.norm(np.diff(filled[30:], axis=0), axis=-1).max() < 0.005
    one = hide(markers[:40], 30, 40, *range(1, 9))
    shift = (markers[30:40, 0] - markers[29, 0])[:, None]
    np.testing.assert_allclose(filled_frames(gap_filler, one)[30:40, 0], markers[29] + shift, atol=1e-9)
    never = filled_frames(gap_filler, np.full((3, 1, 9, 3), np.nan))
    np.testing.assert_allclose(never, np.tile(natural, (3, 1, 1, 1)), atol=1e-9)


def test_a_stack_fills_markers_that_are_still_missing(hand: Skeleton, markers: np.ndarray) -> None:
    frames = hide(markers[:40], 20, 30, *range(9))
    frames[10:15, :, 3] = np.nan
    stack = GapFillerStack((AffineCombination(), LastKnown()))
    filled = filled_frames(stack, frames)
    np.testing.assert_array_equal(
        filled[10:15], filled_frames(AffineCombination(), frames)[10:15]
    )  # filled by the first
    np.testing.assert_array_equal(filled[20:30, 0], np.tile(markers[19], (10, 1, 1)))
    other = filled_frames(GapFillerStack((LastKnown(), AffineCombination())), frames)
    np.testing.assert_array_equal(other, filled_frames(LastKnown(), frames))


@pytest.mark.parametrize("gap_filler", [LastKnown(), MovingAverage(), AffineCombination()])
def test_hands_of_a_batch_are_independent(gap_filler: GapFiller, markers: np.ndarray) -> None:
    one, other = hide(markers[:60], 20, 40, 1, 2), hide(markers[60:120], 10, 45, 0, 5, 8)
    both = filled_frames(gap_filler, np.concatenate([one, other], axis=1))
    np.testing.assert_allclose(both[:, :1], filled_frames(gap_filler, one), atol=1e-9)
    np.testing.assert_allclose(both[:, 1:], filled_frames(gap_filler, other), atol=1e-9)
