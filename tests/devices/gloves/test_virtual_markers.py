"""Gloves of other marker sets: the solved hand yields the standard markers, except those without evidence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.hands.glove import MARKERS, glove_points, marker_positions
from bodysense.body.hands.hand_family import GlovedHand, draw_hand, transfer_pose
from bodysense.body.person import Person
from bodysense.body.pose import Pose
from bodysense.devices.gloves.calibration import checked_fit
from bodysense.devices.gloves.device import (
    calibrated_hands,
    check_calibrated,
    glove_device,
    has_standard_gloves,
    markers_of,
    set_of,
)
from bodysense.devices.gloves.virtual_markers import SolvedHand, VirtualGlove
from bodysense.errors import BodysenseError
from bodysense.observing.observation import Observation
from bodysense_lab.papers.two_hands.score.layouts import layouts, wear_glove
from bodysense_lab.synthesis.glove_stream import observed_markers
from bodysense_lab.synthesis.hands import synthesize_hand

SETS = {layout.key: layout for layout in layouts()}
RATE = 60.0


@pytest.fixture(scope="module", params=["plate3", "knuckles", "tips"])
def hand(request: pytest.FixtureRequest) -> GlovedHand:
    rng = np.random.default_rng(3)
    return wear_glove(SETS[request.param], draw_hand(rng), rng)


@pytest.fixture(scope="module")
def plated() -> GlovedHand:
    rng = np.random.default_rng(3)
    return wear_glove(SETS["plate3"], draw_hand(rng), rng)


def moving(hand: GlovedHand, seconds: float) -> Pose:
    return transfer_pose(synthesize_hand(hand.skeleton, seconds, np.random.default_rng(4), RATE).pose, hand)


def standard_markers(hand: GlovedHand, markers: np.ndarray) -> np.ndarray:
    glove, state, found = VirtualGlove(hand), SolvedHand(), []
    for frame, seen in enumerate(markers):
        virtual, state = glove.step(seen, frame / RATE, state)
        found.append(virtual)
    return np.array(found)


def test_a_known_hand_yields_its_standard_markers(hand: GlovedHand) -> None:
    pose = moving(hand, 0.3)
    found = standard_markers(hand, np.asarray(marker_positions(hand.glove, pose)))
    there = np.asarray(marker_positions(VirtualGlove(hand).standard.glove, pose))
    assert not np.isnan(found[:, :3]).any()
    error = np.linalg.norm(found - there, axis=-1)
    assert np.nanmedian(error) < 0.006 and np.nanmax(error[:, :3]) < 0.02


def test_standard_markers_without_evidence_are_hidden(plated: GlovedHand) -> None:
    markers = np.asarray(marker_positions(plated.glove, moving(plated, 0.1)))
    names = list(plated.glove.markers)
    markers[2:, names.index("ring")] = np.nan
    markers[3:, names.index("plate1_1")] = np.nan
    markers[4:] = np.nan
    hidden = np.isnan(standard_markers(plated, markers)[..., 0])
    assert not hidden[:2].any()
    assert [MARKERS[k] for k in np.flatnonzero(hidden[2])] == ["ring_tip"]
    assert [MARKERS[k] for k in np.flatnonzero(hidden[3])] == ["pinky_base", "wrist", "index_base", "ring_tip"]
    assert hidden[4:].all()


def test_a_wrong_marker_has_no_effect_on_others(plated: GlovedHand) -> None:
    markers = np.asarray(marker_positions(plated.glove, moving(plated, 0.2)))
    right = standard_markers(plated, markers)
    index = list(plated.glove.markers).index("index")
    markers[5, index] += 0.08
    found = standard_markers(plated, markers)
    others = [k for k, name in enumerate(MARKERS) if name != "index_tip"]
    assert np.nanmax(np.linalg.norm(found[5, others] - right[5, others], axis=-1)) < 0.02


def test_standard_markers_move_rigidly_with_the_hand(plated: GlovedHand) -> None:
    markers = np.asarray(marker_positions(plated.glove, moving(plated, 0.1)))
    turn, way = Rotation.random(rng=np.random.default_rng(1)), np.array([1.0, -2.0, 3.0])
    turned = turn.apply(markers.reshape(-1, 3)).reshape(markers.shape) + way
    expected = turn.apply(standard_markers(plated, markers).reshape(-1, 3)).reshape(len(markers), 9, 3) + way
    np.testing.assert_allclose(standard_markers(plated, turned), expected, atol=1e-4)


def seen_of(hand: GlovedHand, seconds: float) -> Observation:
    points = tuple(f"left_glove_{name}" for name in hand.glove.markers)
    return observed_markers(points, np.asarray(marker_positions(hand.glove, moving(hand, seconds))))


def test_the_device_accepts_any_marker_set(plated: GlovedHand) -> None:
    seen = seen_of(plated, 0.2)
    person = Person(hands={"left": plated})
    device = glove_device(person.skeleton, ("left",), calibrated=person.hands)
    whole, _ = device.step(seen, device.start())
    assert "left_index_tip" in whole.points and not any("glove" in point for point in whole.points)
    state, parts = device.start(), []
    for frame in range(len(seen)):
        part, state = device.step(seen[frame : frame + 1], state)
        parts.append(part.position)
    np.testing.assert_array_equal(np.concatenate(parts), whole.position)
    with pytest.raises(BodysenseError, match="not calibrated with the markers of its glove"):
        check_calibrated(seen.points, ("left",), {})
    check_calibrated(seen.points, ("left",), person.hands)
    check_calibrated(glove_points("left"), ("left",), {})


def test_a_saved_person_has_gloves_of_any_marker_set(plated: GlovedHand, tmp_path) -> None:
    Person(hands={"right": plated}).save(tmp_path / "one.json")
    again = Person.load(tmp_path / "one.json").hands["right"]
    assert again.glove.markers == plated.glove.markers and again.glove.carried_by == plated.glove.carried_by
    np.testing.assert_allclose(again.glove.offset, plated.glove.offset)
    text = (tmp_path / "one.json").read_text().replace('"index3"', '"nose"')
    (tmp_path / "two.json").write_text(text)
    with pytest.raises(BodysenseError, match="give its name, a point of the hand"):
        Person.load(tmp_path / "two.json")


def test_the_marker_set_of_a_recording(plated: GlovedHand) -> None:
    seen = seen_of(plated, 0.1)
    assert not has_standard_gloves(seen) and set_of(glove_points("right")).name == "bodysense"
    with pytest.raises(BodysenseError, match="'idx', which no known set has; give --marker-set"):
        set_of(["left_glove_idx"])
    markers = markers_of(seen, "left", SETS["plate3"].glove_set)
    np.testing.assert_array_equal(markers, seen.position)
    with pytest.raises(BodysenseError, match="calibrating needs 6"):
        calibrated_hands(replace(seen, has_position=np.zeros_like(seen.has_position)), SETS["plate3"].glove_set)


@pytest.mark.slow
def test_calibration_with_a_plate(plated: GlovedHand) -> None:
    markers = np.asarray(marker_positions(plated.glove, moving(plated, 6.0)))
    found = checked_fit(markers, SETS["plate3"].glove_set, "left")
    assert found.error < 0.002 and found.hand.glove.markers == plated.glove.markers


@pytest.mark.slow
@pytest.mark.xfail(strict=True, reason="with a plate and six markers a hand in a mirror fits as well as a true one")
def test_a_mirrored_plate_is_refused(plated: GlovedHand) -> None:
    markers = np.asarray(marker_positions(plated.glove, moving(plated, 6.0)))
    with pytest.raises(BodysenseError, match=r"only in a mirror.*--left-handed"):
        checked_fit(markers * [-1.0, 1.0, 1.0], SETS["plate3"].glove_set, "left")
