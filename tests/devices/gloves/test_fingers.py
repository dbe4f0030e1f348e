"""Kinematics of fingers in batches, against forward kinematics and plain loops."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.hands.glove import default_glove, marker_positions
from bodysense.body.hands.hand import FINGERS, rotations_of
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.fingers import aim_fingers, hand_shape, place_hands, shortest_arcs
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_multiply,
    shortest_arc,
)
from bodysense_lab.synthesis.hands import varied_hand


def test_positions_equal_forward_kinematics(hand: Skeleton) -> None:
    rng = np.random.default_rng(0)
    hands = [hand, hand.with_offsets(1.2 * hand.rest_offset), hand]
    rotation, root = rng.normal(size=(3, 16, 4)), rng.normal(size=(3, 3))
    rotation /= np.linalg.norm(rotation, axis=-1, keepdims=True)
    offsets = np.stack([one.rest_offset for one in hands])
    expected, _ = forward_kinematics(Pose(hand, root, rotation), offsets)
    shape = hand_shape(hands, [default_glove()] * 3)
    np.testing.assert_allclose(place_hands(shape, root, rotation).position, expected, atol=1e-12)


def test_shortest_arcs_equal_those_of_rotation() -> None:
    u, v = np.random.default_rng(2).normal(scale=0.1, size=(2, 40, 5, 3))
    np.testing.assert_allclose(shortest_arcs(u, v), shortest_arc(u, v), atol=1e-12)
    identity = np.tile([1.0, 0, 0, 0], (1, 5, 1))
    np.testing.assert_allclose(shortest_arcs(u[:1], -u[:1]), identity, atol=1e-3)  # opposite vectors: no turn
    np.testing.assert_allclose(shortest_arcs(u[:1], 0 * u[:1]), identity, atol=1e-12)


def test_restraint_reduces_large_arcs() -> None:
    angle = np.radians([1.0, 10.0, 20.0, 60.0, 120.0, 179.0, 180.0, 181.0])
    u = np.tile([0.1, 0.0, 0.0], (1, len(angle), 1))
    v = 0.03 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)[None]
    arc = shortest_arcs(u, v, restraint=4.0)[0]
    turned = 2 * np.arctan2(arc[:, 3], arc[:, 0])
    np.testing.assert_allclose(turned[:3], angle[:3], rtol=0.011)
    assert 0.5 * angle[3] < turned[3] < 0.7 * angle[3]
    assert (np.abs(turned[3:]) < angle[3] * 0.7).all()
    np.testing.assert_allclose(turned[5:], [-turned[7], 0, turned[7]], atol=1e-9)
    assert abs(turned[7]) < 0.01


def test_aimed_fingers_equal_a_reference(hand: Skeleton) -> None:
    rng, glove = np.random.default_rng(3), default_glove()
    hands = [hand, varied_hand(hand, 0.1, rng), varied_hand(hand, 0.1, rng)]
    angles = rng.normal(scale=0.3, size=(3, 26))
    markers = np.stack([np.asarray(marker_positions(glove, _posed(one, angles[k]))) for k, one in enumerate(hands)])
    markers += rng.normal(scale=0.01, size=markers.shape)
    local, points = aim_fingers(rotations_of(angles), markers, hand_shape(hands, [glove] * 3))
    for k, one in enumerate(hands):
        turned = _posed(one, angles[k]).rotation.copy()
        position, _ = forward_kinematics(Pose(one, np.zeros(3), turned))
        for finger in FINGERS:
            base = position[one.index(f"{finger}1")]
            tip = position[one.index(f"{finger}_tip")]
            marker = markers[k, glove.markers.index(f"{finger}_tip")]
            place = one.index(f"{finger}1")
            if finger == "thumb":  # at its middle marker, which is at joint 2 of the default glove, then at its tip's
                joint, middle = position[one.index("thumb2")], markers[k, glove.markers.index("thumb_middle")]
                turned[place] = quaternion_multiply(shortest_arc(joint - base, middle - base), turned[place])
                position, world = forward_kinematics(Pose(one, np.zeros(3), turned))
                base, place = position[one.index("thumb2")], one.index("thumb2")
                tip = position[one.index("thumb_tip")]
                arc = shortest_arc(tip - base, marker - base)
                turned[place] = quaternion_multiply(
                    quaternion_conjugate(world[place - 1]),
                    quaternion_multiply(arc, quaternion_multiply(world[place - 1], turned[place])),
                )
                continue
            arc = shortest_arc(tip - base, marker - base)
            turned[place] = quaternion_multiply(arc, turned[place])
        wanted, _ = forward_kinematics(Pose(one, np.zeros(3), turned))
        np.testing.assert_allclose(points[k], wanted, atol=1e-12)
        np.testing.assert_allclose(quaternion_canonical(local[k]), quaternion_canonical(turned[1:]), atol=1e-12)


def test_gloves_without_a_fingertip_marker_are_refused(hand: Skeleton) -> None:
    from dataclasses import replace

    glove = default_glove()
    elsewhere = replace(glove, points=tuple("ring3" if point == "ring_tip" else point for point in glove.points))
    with pytest.raises(BodysenseError, match="'ring_tip' is at 'ring3'"):
        hand_shape([hand], [elsewhere])


def _posed(hand: Skeleton, angles: np.ndarray) -> Pose:
    return Pose(hand, np.zeros(3), np.concatenate([[[1.0, 0, 0, 0]], rotations_of(angles)]))
