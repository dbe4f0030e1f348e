"""Smoothing of landmarks over neighbouring frames."""

from __future__ import annotations

import numpy as np

from bodysense.devices.video.person import PersonLandmarks

REACH = 3.0  # width of the smoothing to either side, in its standard deviations


def neighbours(time: np.ndarray, frame: int, deviation: float, ahead: float = 0.0) -> np.ndarray:
    """Return the weights (T,) of the frames at `time` (T,) s in the average of one of them (`smooth_frame`)."""
    later = time - time[frame]
    return np.exp(-0.5 * (later / deviation) ** 2) * (np.abs(later) <= REACH * deviation) * (later <= ahead + 1e-6)


def smooth_frame(person: PersonLandmarks, frame: int, deviation: float, ahead: float) -> PersonLandmarks:
    """Average one frame with its neighbours, up to `ahead` s later, by a Gaussian of standard deviation `deviation` s.

    Returns one frame. It has no body if no frame in reach has one.
    """
    near = neighbours(person.time, frame, deviation, ahead)

    def mean(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
        weight = np.where(mask, near.reshape(-1, *[1] * (mask.ndim - 1)), 0.0)
        total = weight.sum(axis=0)
        weight = weight / np.where(total > 0, total, 1.0)
        spread = weight.reshape(*weight.shape, *[1] * (values.ndim - weight.ndim))
        return (np.where(spread > 0, values, 0.0) * spread).sum(axis=0, keepdims=True)

    body, hand = person.has_body, person.has_hand
    return PersonLandmarks(
        time=person.time[frame : frame + 1],
        world=mean(person.world, body),
        picture=mean(person.picture, body),
        visible=mean(person.visible, body),
        has_body=np.array([bool((near * body).any())]),
        hand=mean(person.hand, hand),
        hand_world=mean(person.hand_world, hand),
        has_hand=np.asarray((near[:, None] * hand > 0).any(axis=0))[None],
    )
