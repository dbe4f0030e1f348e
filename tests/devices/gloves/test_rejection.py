"""Rejection of wrong markers: spikes, exchanged identifiers and impossible positions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.hands.glove import MARKERS, default_glove
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.gap_fillers import RigidGapFiller
from bodysense.devices.gloves.labels.rejection import Rejection, RejectionSettings
from bodysense.errors import BodysenseError

RATE = 60.0
INDEX, PINKY = MARKERS.index("index_tip"), MARKERS.index("pinky_tip")


def check_all(hand: Skeleton, frames: np.ndarray, rate: float = RATE, **settings: float) -> np.ndarray:
    """Return markers (T, 9, 3) m after rejection, NaN where dropped; a `RigidGapFiller` fills hidden ones."""
    rejection = Rejection((hand,), default_glove(), RejectionSettings(**settings))
    state, hidden = rejection.start(), np.full((1, 9), 1e6)
    gap_filler = RigidGapFiller(np.nan_to_num(frames[0]))
    shape, kept = gap_filler.start(1), []
    for frame in frames[:, None]:
        checked, state = rejection.check(frame, 1 / rate, hidden, state)
        known = ~np.isnan(checked[..., 0])
        whole, shape = gap_filler.fill(checked, 1 / rate, shape)
        state = rejection.remember(whole, known, 1 / rate, state)
        hidden = np.where(known, 0.0, hidden + 1 / rate)
        kept.append(checked[0])
    return np.stack(kept)


def test_true_motion_is_accepted(hand: Skeleton, markers: np.ndarray) -> None:
    noisy = markers + np.random.default_rng(0).normal(scale=0.0005, size=markers.shape)
    np.testing.assert_array_equal(check_all(hand, noisy), noisy)
    flung = markers @ Rotation.from_rotvec([0.0, 2.0, 0.0]).as_matrix().T + 0.7
    np.testing.assert_array_equal(check_all(hand, np.concatenate([markers[:50], flung[50:100]]))[50:], flung[50:100])


def test_hands_are_judged_independently(hand: Skeleton, markers: np.ndarray) -> None:
    flung = np.concatenate([markers[:20], markers[20:40] + 0.5])
    flung[10, INDEX] += 0.1
    both = np.stack([flung, markers[100:140]], axis=1)

    def checked(frames: np.ndarray) -> np.ndarray:
        hands = frames.shape[1]
        rejection, gap_filler = Rejection((hand,) * hands, default_glove()), RigidGapFiller(np.nan_to_num(frames[0]))
        state, shape, kept = rejection.start(), gap_filler.start(hands), []
        for frame in frames:
            seen, state = rejection.check(frame, 1 / RATE, np.zeros((hands, 9)), state)
            whole, shape = gap_filler.fill(seen, 1 / RATE, shape)
            state = rejection.remember(whole, ~np.isnan(seen[..., 0]), 1 / RATE, state)
            kept.append(seen)
        return np.stack(kept)

    together = checked(both)
    np.testing.assert_array_equal(together[:, :1], checked(both[:, :1]))
    np.testing.assert_array_equal(together[:, 1:], both[:, 1:])
    assert np.isnan(together[10, 0, INDEX]).all() and np.isnan(together).sum() == 3


def test_recorded_motion_is_accepted(motion_data: object) -> None:
    from bodysense.body.hands.glove import marker_positions
    from bodysense_lab.data.clips import open_clips
    from bodysense_lab.synthesis.motion import hand_motions

    for motion in hand_motions(open_clips(f"{motion_data}/rocketbox", "train", at_most=3)):
        true = np.asarray(marker_positions(default_glove(), motion.pose))[:400]
        np.testing.assert_array_equal(check_all(motion.pose.skeleton, true), true)


@pytest.mark.parametrize("share", [0.01, 0.05])
def test_spikes_are_dropped(hand: Skeleton, markers: np.ndarray, share: float) -> None:
    rng = np.random.default_rng(1)
    wrong = rng.random(markers.shape[:2]) < share
    wrong[:3] = False
    away = rng.normal(size=markers.shape)
    away *= rng.uniform(0.05, 0.3, size=(*markers.shape[:2], 1)) / np.linalg.norm(away, axis=-1, keepdims=True)
    kept = ~np.isnan(check_all(hand, markers + wrong[..., None] * away)[..., 0])
    assert (kept & wrong).sum() < 0.05 * wrong.sum()
    assert (~kept & ~wrong).sum() < 0.01 * (~wrong).sum()


def test_spikes_of_a_swinging_hand_are_dropped(hand: Skeleton, markers: np.ndarray) -> None:
    """The hand swings faster than its fingers move in it, as in running and cheering."""
    markers, rng = markers[:300], np.random.default_rng(2)
    time = np.arange(len(markers)) / RATE
    turn = Rotation.from_rotvec(np.sin(2 * np.pi * 2 * time)[:, None] * [0.0, 1.0, 0.5]).as_matrix()
    swing = 0.3 * np.sin(2 * np.pi * 3 * time)[:, None, None] * np.array([1.0, 0.0, 0.3])
    swung = (markers - markers.mean(axis=1, keepdims=True)) @ turn.swapaxes(1, 2) + swing
    second_difference = np.diff(swung, 2, axis=0)
    assert np.linalg.norm(second_difference, axis=-1).max() > 0.025  # m, too much for a prediction by constant velocity
    np.testing.assert_array_equal(check_all(hand, swung), swung)
    wrong = rng.random(markers.shape[:2]) < 0.05
    wrong[:3] = False
    away = rng.normal(size=markers.shape)
    away *= rng.uniform(0.02, 0.3, size=(*markers.shape[:2], 1)) / np.linalg.norm(away, axis=-1, keepdims=True)
    kept = ~np.isnan(check_all(hand, swung + wrong[..., None] * away)[..., 0])
    assert (kept & wrong).sum() < 0.05 * wrong.sum()
    assert (~kept & ~wrong).sum() < 0.01 * (~wrong).sum()


def test_a_marker_that_was_filled_has_no_velocity(hand: Skeleton, markers: np.ndarray) -> None:
    """The filled position is 2 cm off, so that the step from there to the found marker is no motion."""
    rejection = Rejection((hand,), default_glove())
    still, filled = markers[:1].copy(), markers[:1].copy()
    filled[0, INDEX] += [0.0, -0.02, 0.0]
    known = np.ones((1, 9), dtype=bool)
    hidden = known.copy()
    hidden[0, INDEX] = False
    state = rejection.start()
    for place, seen in ((still, known), (filled, hidden), (still, known)):
        state = rejection.remember(place, seen, 1 / RATE, state)
    spike = still.copy()
    spike[0, INDEX] += [0.0, 0.02, 0.0]  # the position that this step would predict
    checked, _ = rejection.check(spike, 1 / RATE, np.zeros((1, 9)), state)
    assert np.isnan(checked[0, INDEX]).all()


def test_exchanged_identifiers_are_corrected(hand: Skeleton, markers: np.ndarray) -> None:
    frames = markers[:120].copy()
    apart = np.linalg.norm(frames[:, INDEX] - frames[:, PINKY], axis=-1)
    start = int(np.flatnonzero(apart > 0.04)[0]) + 5
    exchanged = frames.copy()
    exchanged[start:, [INDEX, PINKY]] = frames[start:, [PINKY, INDEX]]
    np.testing.assert_array_equal(check_all(hand, exchanged), frames)


def test_one_of_two_identifiers_in_the_same_position_is_dropped(hand: Skeleton, markers: np.ndarray) -> None:
    frames = np.tile(markers[0], (60, 1, 1))
    assert np.linalg.norm(frames[0, INDEX] - frames[0, PINKY]) > 0.03
    frames[20:, INDEX] = frames[20:, PINKY]
    checked = check_all(hand, frames)
    assert np.isnan(checked[20:, INDEX]).all()
    np.testing.assert_array_equal(np.delete(checked, INDEX, axis=1), np.delete(frames, INDEX, axis=1))


def test_an_unexpected_marker_that_stays_is_accepted(hand: Skeleton, markers: np.ndarray) -> None:
    """A finger may have moved while its marker was hidden, so wrong rejection must not last."""
    frames = np.tile(markers[0], (60, 1, 1))
    frames[20:, INDEX] += 0.3 * (frames[0, 1] - frames[0, INDEX])  # toward the wrist
    checked = check_all(hand, frames, patience=0.1)
    assert np.isnan(checked[20:26, INDEX]).all()
    np.testing.assert_array_equal(checked[28:, INDEX], frames[28:, INDEX])


def test_an_impossible_marker_is_never_accepted(hand: Skeleton, markers: np.ndarray) -> None:
    frames = np.tile(markers[0], (60, 1, 1))
    frames[:, PINKY] += 1.0  # from the first frame on, and it stays
    checked = check_all(hand, frames)
    assert np.isnan(checked[:, PINKY]).all()
    np.testing.assert_array_equal(np.delete(checked, PINKY, axis=1), np.delete(frames, PINKY, axis=1))


def test_millimetres_are_rejected(hand: Skeleton, markers: np.ndarray) -> None:
    checked = check_all(hand, 1000 * markers[:5])  # millimetres
    assert (~np.isnan(checked[..., 0])).sum(axis=1).max() <= 1


def test_negative_settings_are_refused() -> None:
    with pytest.raises(BodysenseError, match="tolerance is -1; it must be 0 or more"):
        RejectionSettings(tolerance=-1.0)
    with pytest.raises(BodysenseError, match="haste is -1; it must be 0 or more"):
        RejectionSettings(haste=-1.0)
