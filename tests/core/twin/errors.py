"""Expected errors, made true by a map that was fitted to what the network errs.

log e = W [k, tanh(V k + c)] + b, with inputs k: log errors and differences that the networks predict, masks of the
tracked points, and deviations of the bones
"""

from collections.abc import Mapping

import numpy as np

from .network import Prediction
from .points import (
    BODY,
    BODY_POINTS,
    HAND_JOINTS,
    HAND_POINTS,
    HEAD,
    JOINTS,
    PARENT,
    PATH,
    PELVIS,
    POINTS,
    WRISTS,
    rest_height,
)
from .tracked import Tracked

TRACKED_ERROR = 0.001  # m: stands for the expected error of points that are tracked
TRACKED_UNLIKE = 0.01  # stands for how much predictions of tracked joints differ
NORMAL_BOUND = 1.567  # 90 % quantile of the length of normal errors in space, by their mean
LOW_FROM, LOW_AT = 0.8, 0.5  # of the standing height: a head that is lower is rare, and this low
LOW_MORE, TILTED_MORE = 0.5, 0.8  # by how much bounds are larger for heads as low as `LOW_AT`, and for those that lie
TILTED_FROM = 0.9  # cosine of a head's tilt: a head that is tilted farther is rare
MISSED_MOST = 4.0  # expected distances of measured joints from the predicted body: predicted errors grow until here


def rarity(seen: Tracked) -> float:
    """By how much bounds are larger because a pose is rare: 1 for those who stand."""
    low = tilted = 0.0
    if seen.has_position[HEAD]:
        height = (seen.position[HEAD][1] - seen.floor) / rest_height(seen.rest_offset, HEAD)
        low = np.clip((LOW_FROM - height) / (LOW_FROM - LOW_AT), 0, 1)
    if seen.has_rotation[HEAD]:
        tilted = np.clip((TILTED_FROM - seen.rotation[HEAD][1, 1]) / TILTED_FROM, 0, 1)
    return 1 + LOW_MORE * low + TILTED_MORE * tilted


def missed_distance(seen: Tracked, predicted: Prediction) -> float:
    """Return the mean distance of measured joints from the predicted body, in expected distances; 0 without any."""
    rotation = np.empty((JOINTS, 3, 3))
    for joint in range(BODY):
        rotation[joint] = seen.rotation[joint] if seen.turned(joint) else predicted.rotation[joint]
    for wrist, joints in zip(WRISTS, HAND_JOINTS, strict=True):
        rotation[joints] = rotation[wrist]
    point = PATH[:, 1:] @ (rotation[PARENT[1:]] @ seen.rest_offset[1:, :, None])[..., 0]
    has, off = seen.has_position.copy(), seen.position - (point - point[HEAD] + predicted.head)
    placed = HEAD if has[HEAD] else PELVIS
    if has.any():
        off = off - (off[placed] if has[placed] else off[has].mean(axis=0))
    has[placed] = False
    missed = np.linalg.norm(off[:BODY], axis=-1) / (predicted.error[:BODY] + seen.accuracy[:BODY])
    return float(missed[has[:BODY]].mean()) if has[:BODY].any() else 0.0


def expected_errors(
    of: Mapping[str, np.ndarray], seen: Tracked, predicted: Prediction, finger_error: np.ndarray, off: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Expected errors of all points (65,) m, and bounds that nine of ten errors keep.

    No measured point is expected to err by less than it is off (65,) m.
    """
    has, joints = seen.has_position[BODY_POINTS], seen.has_position[:BODY]
    strange = np.clip(missed_distance(seen, predicted), 1, MISSED_MOST)
    known = np.concatenate(
        [
            np.log(np.where(has, TRACKED_ERROR, strange * predicted.error)),
            has,
            seen.has_rotation[:BODY],
            seen.deviation[BODY_POINTS],
            np.log(np.where(joints, TRACKED_UNLIKE, predicted.unlike)),
        ]
    )
    inside = np.tanh(of["errors.inward.weight"] @ known + of["errors.inward.bias"])
    mean, most = np.split(np.exp(of["errors.weight"] @ np.concatenate([known, inside]) + of["errors.bias"]), 2)
    most = rarity(seen) * most
    confidence, bound = np.zeros(POINTS), np.zeros(POINTS)
    confidence[BODY_POINTS], bound[BODY_POINTS] = mean, most
    for wrist, points, errors in zip(WRISTS, HAND_POINTS, finger_error, strict=True):
        confidence[points] = mean[wrist] + errors  # a finger is misplaced by its wrist's error as well
        bound[points] = most[wrist] + errors * NORMAL_BOUND
    measured = np.maximum(seen.accuracy, off)
    has = seen.has_position
    return np.where(has, measured, confidence), np.where(has, NORMAL_BOUND * measured, bound)
