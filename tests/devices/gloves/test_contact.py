"""Hand contact: hands do not overlap, corrections are as small as possible, and fingertips touch."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.hands.glove import default_glove, marker_positions
from bodysense.body.hands.hand import FINGERS, angles_of, hand_skeleton, limits, rotations_of
from bodysense.body.hands.hand_capsules import GIVE, NAMES, hand_capsules, mutual_depth, own_depth, own_pairs
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.gloves.contact import Contact
from bodysense.devices.gloves.contact_rows import ContactSettings
from bodysense.devices.gloves.fingers import HandPoses
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle

HAND = hand_skeleton(default_skeleton(), "left")
LARGE = HAND.with_offsets(1.1 * HAND.rest_offset)
INTERVAL = 1 / 60
NO_MARKERS, NONE_KNOWN = np.full((2, 9, 3), np.nan), np.zeros((2, 9), bool)


def posed(root: np.ndarray, angles: np.ndarray, hands: tuple = (HAND, HAND)) -> HandPoses:
    """Return two hands with fingers toward each other; the left one's are along +x."""
    wrist = np.broadcast_to([1.0, 0, 0, 0], (len(root), 1, 4))
    rotation = np.concatenate([wrist, rotations_of(angles)], axis=1)
    position = [forward_kinematics(Pose(hand, root[k], rotation[k]))[0] for k, hand in enumerate(hands)]
    return HandPoses(root, rotation, np.stack(position))


def interlaced(seed: int) -> HandPoses:
    """Return two hands with interlaced fingers, bent at random."""
    rng = np.random.default_rng(seed)
    root = np.array([[-0.14, 0.01, 0.0], [-0.14, 0.0, 0.01]])
    return posed(root, np.clip(rng.normal(scale=0.25, size=(2, 26)), *limits()))


def pose_of(hands: HandPoses, hand: int) -> Pose:
    return Pose(HAND, hands.root[hand], hands.rotation[hand])


def depth(hands: HandPoses) -> float:
    left, right = pose_of(hands, 0), pose_of(hands, 1)
    return max(own_depth(left).max(), own_depth(right).max(), mutual_depth(left, right).max())


def resolved(contact: Contact, hands: HandPoses, frames: int = 3) -> HandPoses:
    state, result = contact.start(), hands
    for _ in range(frames):
        result, state = contact.step(hands, NO_MARKERS, NONE_KNOWN, INTERVAL, state)
    return result


def both() -> Contact:
    return Contact([HAND, HAND], ["left", "right"])


def test_hands_that_do_not_touch_are_unchanged() -> None:
    contact = both()
    for apart in (0.5, -0.04):  # far, and near with the fingers of one before those of the other
        hands = posed(np.array([[apart, 0.0, 0], [apart, 0.08, 0]]), np.zeros((2, 26)))
        result, state = contact.step(hands, NO_MARKERS, NONE_KNOWN, INTERVAL, contact.start())
        assert result is hands
        assert contact.step(hands, NO_MARKERS, NONE_KNOWN, INTERVAL, state)[0] is hands


@pytest.mark.parametrize("seed", range(3))
def test_overlap_is_resolved(seed: int) -> None:
    hands = interlaced(seed)
    assert depth(hands) > 0.005
    assert depth(resolved(both(), hands)) < 0.001


@pytest.mark.parametrize("seed", range(2))
def test_corrected_hands_keep_limits_and_bone_lengths(seed: int) -> None:
    hands = interlaced(seed)
    result = resolved(both(), hands)
    for hand in range(2):
        position, _ = forward_kinematics(pose_of(result, hand))
        np.testing.assert_allclose(result.position[hand], position, atol=1e-9)
    angles, (low, high) = angles_of(result.rotation[:, 1:]), limits()
    assert (angles >= low - 1e-6).all() and (angles <= high + 1e-6).all()
    np.testing.assert_array_equal(result.rotation[:, 0], hands.rotation[:, 0])  # wrists do not turn
    assert np.linalg.norm(result.root - hands.root, axis=-1).max() < 0.02


def test_the_order_of_hands_does_not_matter() -> None:
    hands = interlaced(0)
    swapped = HandPoses(*(part[::-1] for part in hands))
    one, other = resolved(both(), hands, 1), resolved(both(), swapped, 1)
    np.testing.assert_allclose(one.position, other.position[::-1], atol=1e-6)


def test_only_colliding_fingers_move() -> None:
    angles = np.zeros((2, 26))
    angles[0, 6 + 1] = 0.4  # the left index leans onto the middle finger
    hands = posed(np.array([[0.3, 0.0, 0], [0.3, 0.0, 0]]), angles)
    assert own_depth(pose_of(hands, 0)).max() > 0.002
    result = resolved(both(), hands, 1)
    assert own_depth(pose_of(result, 0)).max() < 0.001
    np.testing.assert_array_equal(result.position[1], hands.position[1])
    np.testing.assert_array_equal(result.rotation[1], hands.rotation[1])
    still = [1 + 3 * FINGERS.index(finger) + k for finger in ("thumb", "pinky") for k in range(3)]
    np.testing.assert_array_equal(result.rotation[0, still], hands.rotation[0, still])
    change = geodesic_angle(result.rotation[0], hands.rotation[0])
    assert 0.01 < change.max() < 0.5


def test_a_finger_with_a_hidden_marker_moves_more() -> None:
    angles = np.zeros((2, 26))
    angles[0, 6 + 1] = 0.4
    hands = posed(np.array([[0.3, 0.0, 0], [0.3, 0.0, 0]]), angles)
    change = []
    for hidden in ("index_tip", "middle_tip"):
        known = np.ones((2, 9), bool)
        known[0, default_glove().markers.index(hidden)] = False
        contact = both()
        result, _ = contact.step(hands, NO_MARKERS, known, INTERVAL, contact.start())
        change.append(np.linalg.norm(result.position - hands.position, axis=-1)[0, [17, 18]])
    assert change[0][0] > change[1][0] and change[1][1] > change[0][1]


def test_no_point_is_corrected_faster_than_the_speed() -> None:
    settings = ContactSettings(speed=0.1)
    contact = Contact([HAND, HAND], ["left", "right"], settings)
    free = posed(np.array([[0.3, 0.0, 0], [0.3, 0.0, 0]]), np.zeros((2, 26)))
    _, state = contact.step(free, NO_MARKERS, NONE_KNOWN, INTERVAL, contact.start())
    hands, before, steps = interlaced(0), np.zeros((2, 21, 3)), []
    result = hands
    for _ in range(40):
        result, state = contact.step(hands, NO_MARKERS, NONE_KNOWN, INTERVAL, state)
        correction = result.position - hands.position
        steps.append(np.linalg.norm(correction - before, axis=-1).max())
        before = correction
        assert state.change is not None and state.displacement == pytest.approx(contact._displacement(state.change))
    assert max(steps) <= 0.1 * INTERVAL * 1.05  # turns are not linear
    assert depth(result) < 0.001


def test_an_unnecessary_correction_fades() -> None:
    contact, state = both(), both().start()
    hands, free = interlaced(1), posed(np.array([[0.3, 0.0, 0], [0.3, 0.0, 0]]), np.zeros((2, 26)))
    _, state = contact.step(hands, NO_MARKERS, NONE_KNOWN, INTERVAL, state)
    assert contact.step(free, NO_MARKERS, NONE_KNOWN, INTERVAL, state)[0] is not free
    result = hands
    for _ in range(90):
        result, state = contact.step(free, NO_MARKERS, NONE_KNOWN, INTERVAL, state)
    assert result is free


def pinching(gap: float) -> tuple[HandPoses, np.ndarray, np.ndarray]:
    """Return a hand about to pinch, its markers with thumb and index at a `gap`, and their offset (3,) m."""
    angles = np.zeros((1, 26))
    angles[0, [0, 1, 3, 5]] = np.radians([20, -20, 20, 20])  # thumb: flexion, abduction, middle, last
    angles[0, [6, 9, 10]] = np.radians([35, 45, 25])
    hands = posed(np.zeros((1, 3)), angles, (HAND,))
    markers = marker_positions(default_glove(), Pose(HAND, hands.root, hands.rotation))
    thumb, index = (default_glove().markers.index(name) for name in ("thumb_tip", "index_tip"))
    offset = markers[0, index] - markers[0, thumb]
    offset *= gap / np.linalg.norm(offset)
    middle = (markers[0, index] + markers[0, thumb]) / 2
    markers[0, thumb], markers[0, index] = middle - offset / 2, middle + offset / 2
    return hands, markers, offset


def test_fingertips_touch_if_their_markers_do() -> None:
    hands, markers, offset = pinching(0.016)
    before = hands.position[0, 17] - hands.position[0, 16]
    assert np.linalg.norm(before) > 0.03
    contact, known = Contact([HAND], ["left"]), np.ones((1, 9), bool)
    result, state = hands, contact.start()
    for _ in range(3):
        result, state = contact.step(hands, markers, known, INTERVAL, state)
    after = result.position[0, 17] - result.position[0, 16]
    np.testing.assert_allclose(after, offset, atol=0.002)
    assert own_depth(pose_of(result, 0)).max() < 0.001
    still = [1 + 3 * FINGERS.index(finger) + k for finger in ("ring", "pinky") for k in range(3)]
    np.testing.assert_array_equal(result.rotation[0, still], hands.rotation[0, still])


def test_filled_markers_do_not_bring_fingertips_together() -> None:
    hands, markers, _ = pinching(0.016)
    contact = Contact([HAND], ["left"])
    assert contact.step(hands, markers, np.zeros((1, 9), bool), INTERVAL, contact.start())[0] is hands


def test_a_touch_is_kept_while_other_fingers_are_separated() -> None:
    last = [NAMES.index(name) for name in ("thumb3", "index3")]
    first, second = own_pairs()
    touch = int(np.flatnonzero((first == last[0]) & (second == last[1]))[0])
    radius = hand_capsules(HAND).radius[last].sum()
    near = np.zeros((1, 26))
    near[0, [0, 1, 3, 5, 6, 9, 10]] = np.radians([25, -30, 25, 25, 45, 50, 30])
    angles = near + np.random.default_rng(879).normal(scale=0.25, size=(1, 26))  # a touch and, elsewhere, a collision
    hands = posed(np.zeros((1, 3)), np.clip(angles, *limits()), (HAND,))
    markers, known, gaps = np.full((1, 9, 3), np.nan), np.zeros((1, 9), bool), []
    for keeping in (1e-9, 0.005):
        contact = Contact([HAND], ["left"], ContactSettings(keeping=keeping))
        result, _ = contact.step(hands, markers, known, INTERVAL, contact.start())
        gaps.append(-own_depth(pose_of(result, 0))[touch] - GIVE * radius)
    assert -own_depth(pose_of(hands, 0))[touch] - GIVE * radius < 0.001
    assert gaps[0] > 0.003 and gaps[1] < 0.001


def test_fingertips_with_distant_markers_are_unchanged() -> None:
    hands, markers, _ = pinching(0.05)
    contact = Contact([HAND], ["right"])
    result, _ = contact.step(hands, markers, np.ones((1, 9), bool), INTERVAL, contact.start())
    assert result is hands


def test_four_hands_of_two_sizes() -> None:
    one = interlaced(2)
    root = np.concatenate([one.root, one.root + np.array([1.0, 0, 0])])
    angles = np.concatenate([angles_of(one.rotation[:, 1:])] * 2)
    hands = posed(root, angles, (HAND, LARGE, HAND, LARGE))
    contact = Contact([HAND, LARGE, HAND, LARGE], ["left", "right", "left", "right"])
    markers, known = np.full((4, 9, 3), np.nan), np.zeros((4, 9), bool)
    result, _ = contact.step(hands, markers, known, INTERVAL, contact.start())
    for first in (0, 2):
        left = Pose(HAND, result.root[first], result.rotation[first])
        right = Pose(LARGE, result.root[first + 1], result.rotation[first + 1])
        assert mutual_depth(left, right).max() < 0.002
        assert max(own_depth(left).max(), own_depth(right).max()) < 0.002


@pytest.mark.parametrize("field", ["tolerance", "speed", "half_life", "seen_weight"])
def test_settings_are_positive(field: str) -> None:
    with pytest.raises(BodysenseError, match=f"{field} is 0; it must be positive"):
        ContactSettings(**{field: 0})


def test_bad_settings_are_refused() -> None:
    with pytest.raises(BodysenseError, match=r"touching is 0\.04 m and apart 0\.03 m; apart must be more"):
        ContactSettings(touching=0.04)
    with pytest.raises(BodysenseError, match="2 hands and 1 sides; give one side a hand"):
        Contact([HAND, HAND], ["left"])


def test_a_correction_fades_without_near_pairs() -> None:
    contact = Contact([HAND], ["left"])
    angles = np.zeros((1, 26))
    angles[0, [6, 9]] = np.radians([90, 110])  # the index curls far into the palm
    angles[0, 10] = np.radians(80)
    markers, known = np.full((1, 9, 3), np.nan), np.zeros((1, 9), bool)
    bent = posed(np.zeros((1, 3)), angles, (HAND,))
    result, state = contact.step(bent, markers, known, INTERVAL, contact.start())
    assert own_depth(pose_of(bent, 0)).max() > 0.002 > own_depth(pose_of(result, 0)).max()
    spread = np.zeros((1, 26))
    spread[0, [7, 17, 22]] = np.radians([-20, 20, 25])  # no two fingers near each other
    flat = posed(np.zeros((1, 3)), spread, (HAND,))
    result, state = contact.step(flat, markers, known, INTERVAL, state)
    assert np.isfinite(result.position).all()
