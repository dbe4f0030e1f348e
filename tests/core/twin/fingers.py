"""Fingers: one network for both hands, each in its wrist's frame, the right one in a mirror; then what is measured."""

from collections.abc import Mapping

import numpy as np

from .body import Body
from .features import FASTEST, MIRROR, USUAL_RATE, Head
from .layers import FEATURE, STATE, branch_of, recurrent_of, rounded, softplus
from .network import Memory
from .points import HAND_JOINTS, HAND_POINTS, HEAD, PARENT, WRISTS
from .tracked import Tracked
from .vectors import frame_of, length, mix, turned_onto

SMALLEST_ERROR, ERROR_BIAS = 0.001, -4.0  # m; of the expected error before it is made positive
BONE_SCALE = 10.0
SMALLEST_HAND = 1e-3  # m, from wrist to middle finger
MIDDLE = 3  # of a hand's points: the first joint of the middle finger
LEAST_DOUBT = 1e-6  # m
FLIP = [np.ones(3), MIRROR]  # of the left and of the right hand


def directed(seen: Tracked, joint: int, child: int, rotation: np.ndarray) -> np.ndarray:
    """Turn a rotation so that the joint points at its measured child.

    The direction is unreliable if the points' error e is near their distance b, so its weight is b² / (b² + (2 e)²).
    """
    if not seen.has_position[joint] or not seen.has_position[child]:
        return rotation
    bone = rotation @ seen.rest_offset[child]
    doubt = 2 * (seen.accuracy[joint] + seen.accuracy[child]) + LEAST_DOUBT
    trust = bone @ bone / (bone @ bone + doubt**2)
    return turned_onto(rotation, bone, mix(bone, seen.position[child] - seen.position[joint], trust))


def hand_features(
    of: Mapping[str, np.ndarray], seen: Tracked, head: Head, body: Body, memory: Memory, hand: int
) -> np.ndarray:
    """Features (258,) of a hand, in its wrist's frame; lengths of points count in the hand's size."""
    wrist, points, joints, flip = WRISTS[hand], HAND_POINTS[hand], HAND_JOINTS[hand], FLIP[hand]
    turn, into, both = body.rotation[wrist], head.turn.T, flip[:, None] * flip[:2]
    size = max(length(seen.rest_offset[points[MIDDLE]]), SMALLEST_HAND)
    has = seen.has_position[points] & seen.has_position[wrist]
    place = (seen.position[points] - seen.position[wrist]) @ turn / size * has[:, None]
    turned = seen.has_rotation[joints]
    axes = (turn.T @ seen.rotation[joints])[..., :2] * turned[:, None, None]
    before = body.point[wrist] if memory.wrists is None else memory.wrists[hand]
    velocity = into @ (body.point[wrist] - before) / seen.interval
    parts = [
        place * flip,
        has,
        axes * both,
        turned,
        BONE_SCALE * (seen.rest_offset[points] / size * flip - of["fingers.usual_bones"]),
        (into @ (body.point[wrist] - body.point[HEAD])).clip(-FASTEST, FASTEST) * flip,
        velocity.clip(-FASTEST, FASTEST) * flip,
        (into @ turn)[:, :2] * both,
        USUAL_RATE * memory.elapsed,
    ]
    return np.concatenate([np.ravel(part).astype(float) for part in parts])


def place_hand(of: Mapping[str, np.ndarray], seen: Tracked, hand: int, output: np.ndarray, body: Body) -> np.ndarray:
    """Turn and place a hand by outputs (110,) of the network. Returns expected errors (20,) m without the wrist's."""
    joints, points, flip = HAND_JOINTS[hand], HAND_POINTS[hand], FLIP[hand]
    axes = (output[:90].reshape(15, 3, 2) + of["fingers.relaxed"].reshape(15, 3, 2)) * flip[:, None] * flip[:2]
    for k, joint in enumerate(joints):
        child = joints[k + 1] if k % 3 < 2 else points[15 + k // 3]
        turn = body.rotation[WRISTS[hand]] @ frame_of(axes[k, :, 0], axes[k, :, 1])
        turn = directed(seen, joint, child, turn)
        body.rotation[joint] = seen.rotation[joint] if seen.has_rotation[joint] else turn
    for point in points:
        parent = PARENT[point]
        body.point[point] = body.point[parent] + body.rotation[parent] @ seen.rest_offset[point]
    return softplus(output[90:] + ERROR_BIAS) + SMALLEST_ERROR


def complete_fingers(of: Mapping[str, np.ndarray], seen: Tracked, head: Head, body: Body, memory: Memory) -> np.ndarray:
    """Complete the fingers of a body in place. Returns expected errors (2, 20) m without the wrist's own."""
    x = rounded(np.stack([hand_features(of, seen, head, body, memory, hand) for hand in (0, 1)], axis=1), FEATURE)
    after = recurrent_of(of, "fingers", 0).step(x, memory.hands)
    read = memory.core[1] if memory.core and memory.advances else after
    outputs = branch_of(of, "fingers.branch").outputs(rounded(read, STATE), x)
    error = np.array([place_hand(of, seen, hand, outputs[:, hand], body) for hand in (0, 1)])
    if memory.advances:
        memory.hands, memory.elapsed = after, 0.0
    memory.wrists = body.point[list(WRISTS)].copy()
    return error
