"""Measures of clips, merged over clips."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.skeleton import default_skeleton
from bodysense_lab.completion.score.measures import motion_measures
from bodysense_lab.completion.score.scores import RunningScores

BODY = default_skeleton()
FEET = [BODY.index(f"{side}_foot") for side in ("left", "right")]


def sliding(frames: int, standing: int, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Return predicted and true positions (T, P, 3): true feet stand, then hang; the predicted body slides."""
    truth = np.ones((frames, len(BODY.points), 3))
    truth[:standing, FEET, 1] = 0.0
    predicted = truth.copy()
    predicted[..., 0] += speed / 30 * np.arange(frames)[:, None]
    return predicted, truth


def test_skate_is_averaged_over_standing_frames_not_over_clips() -> None:
    whole = RunningScores()
    for frames, standing, speed in ((61, 61, 0.01), (201, 21, 0.1)):
        whole.merge(motion_measures(*sliding(frames, standing, speed), BODY))
    assert whole.get("skate_cm_s") == pytest.approx((60 * 1.0 + 20 * 10.0) / 80)
