"""Calibration of a hand: it meets its markers, is closer to the truth than the mean hand, and refuses bad input."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.hands.glove import hand_size, marker_positions
from bodysense.body.hands.hand import mirrored_vectors
from bodysense.body.hands.hand_family import COUNT, GlovedHand, draw_hand, hand_of, transfer_pose
from bodysense.body.person import Person
from bodysense.devices.gloves.calibration import fit_hand
from bodysense.devices.gloves.device import calibrated_hands, glove_device
from bodysense.devices.simulated.glove import observe
from bodysense.errors import BodysenseError
from bodysense_lab.papers.two_hands.frames import frames_of
from bodysense_lab.synthesis.hands import synthesize_hand


@pytest.fixture(scope="module")
def true_hand() -> GlovedHand:
    return draw_hand(np.random.default_rng(11))


@pytest.fixture(scope="module")
def markers(true_hand: GlovedHand) -> np.ndarray:
    motion = synthesize_hand(true_hand.skeleton, 8.0, np.random.default_rng(12), 30.0)
    return np.asarray(marker_positions(true_hand.glove, transfer_pose(motion.pose, true_hand)))


def test_the_fitted_hand_meets_its_markers(true_hand: GlovedHand, markers: np.ndarray) -> None:
    found = fit_hand(markers[::24])
    assert found.error < 0.0015
    middle = hand_of(np.zeros(COUNT))

    def bone_error(hand: GlovedHand) -> float:
        return float(abs(hand.skeleton.bone_length - true_hand.skeleton.bone_length).mean())

    assert bone_error(found.hand) < bone_error(middle)
    assert hand_size(found.hand.skeleton) == pytest.approx(hand_size(true_hand.skeleton), rel=0.08)


@dataclass(frozen=True, eq=False)
class _KnownAngles:
    """A network with known frames: it predicts the angles of the frame with the most similar markers."""

    markers: np.ndarray  # (T, 27) m, in the hand's axes, from its wrist, at the default size
    angles: np.ndarray  # (T, 26) rad

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        far = np.linalg.norm(markers[:, None] - self.markers, axis=-1)
        return self.angles[far.argmin(axis=1)].astype(np.float32)


def test_angles_of_a_network_improve_bone_lengths(true_hand: GlovedHand) -> None:
    motion = synthesize_hand(true_hand.skeleton, 8.0, np.random.default_rng(12), 30.0)
    frames = frames_of(motion, true_hand)
    known = _KnownAngles(frames.markers.reshape(len(frames), -1), frames.angles)
    markers = np.asarray(marker_positions(true_hand.glove, transfer_pose(motion.pose, true_hand)))[::24]

    def bone_error(network: _KnownAngles | None) -> float:
        found = fit_hand(markers, network=network).hand.skeleton
        return float(abs(found.bone_length - true_hand.skeleton.bone_length).mean())

    assert bone_error(known) < 0.9 * bone_error(None)


def test_calibration_needs_most_markers(markers: np.ndarray) -> None:
    some = markers.copy()
    some[::2, 4] = np.nan
    assert fit_hand(some[::34]).error < 0.0015
    with pytest.raises(BodysenseError, match="calibrating needs 6"):
        fit_hand(np.where(np.arange(9)[:, None] < 5, markers, np.nan))


def test_a_saved_person_has_the_calibrated_hands(true_hand: GlovedHand, tmp_path: Path) -> None:
    person = Person(hands={"left": true_hand, "right": true_hand})
    person.save(tmp_path / "one.json")
    again = Person.load(tmp_path / "one.json")
    for side in ("left", "right"):
        np.testing.assert_allclose(again.hands[side].axes, true_hand.axes)
        np.testing.assert_allclose(again.hands[side].skeleton.rest_offset, true_hand.skeleton.rest_offset)
    np.testing.assert_allclose(again.skeleton.rest_offset, person.skeleton.rest_offset)
    left = again.skeleton.index("left_index2")
    np.testing.assert_allclose(
        again.skeleton.rest_offset[left],
        mirrored_vectors(true_hand.skeleton.rest_offset[true_hand.skeleton.index("index2")], "left"),
    )
    device = glove_device(again.skeleton, calibrated=again.hands)
    assert device.hands.gloves["left"].offset.shape == (9, 3)
    with pytest.raises(BodysenseError, match="the hand 'middle'"):
        Person(hands={"middle": true_hand})


@pytest.mark.slow
def test_hands_of_an_observation_are_calibrated() -> None:
    from bodysense.demo import packaged_performance

    clip = packaged_performance()
    seen = observe(clip.pose[:300], clip.time[:300])
    found = calibrated_hands(seen)
    assert set(found) <= {"left", "right"} and found
    nothing = replace(seen, has_position=np.zeros_like(seen.has_position))
    assert calibrated_hands(nothing) == {}
