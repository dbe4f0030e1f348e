"""Expected errors of all frames at once, against the rule point by point."""

from __future__ import annotations

import numpy as np

from bodysense.body.glove import ALIGNMENT, MARKERS, default_glove
from bodysense.body.hand import FINGERS, HAND_JOINTS
from bodysense.devices.gloves import expectation
from bodysense.devices.gloves.expectation import expected_error, influence


def slow(hidden: np.ndarray, share: np.ndarray) -> np.ndarray:
    """(21,) m from (9,) s."""
    root = np.sqrt(np.minimum(hidden, expectation.LONGEST))
    lost = expectation.LOST_ERROR * np.sqrt(hidden.min())
    back = expectation.BACK_ERROR * root[list(ALIGNMENT)].min()
    error = []
    for point in range(21):
        tip = point >= len(HAND_JOINTS)
        grown = (expectation.TIP_HIDDEN_ERROR if tip else expectation.HIDDEN_ERROR) * float(root @ share[:, point])
        shown = expectation.TIP_SHOWN_ERROR if tip else expectation.SHOWN_ERROR
        error.append(min(grown + expectation.OTHERS_ERROR * root.mean() + back + shown + lost, 0.3))
    return np.array(error)


def test_errors_grow_with_what_is_hidden() -> None:
    rng, of = np.random.default_rng(0), influence(default_glove())
    hidden = rng.exponential(0.5, size=(5, 3, 9)) * (rng.random((5, 3, 9)) < 0.4)
    hidden[1, :, list(ALIGNMENT)], hidden[2] = 0.3, 1e6
    hidden[3] = 0.0
    error, occluded = expected_error(hidden, of)
    np.testing.assert_allclose(error, np.apply_along_axis(slow, -1, hidden, of.share), atol=1e-12)
    np.testing.assert_allclose(occluded, (hidden > 0) @ of.share, atol=1e-12)
    np.testing.assert_allclose(of.share.sum(axis=0), 1)
    assert (error[2] == expectation.LARGEST_ERROR).all() and (occluded[3] == 0).all()


def test_a_fingertip_is_known_from_its_marker_alone() -> None:
    share = influence(default_glove()).share
    for place, finger in enumerate(FINGERS):
        tip = share[:, len(HAND_JOINTS) + place]
        assert tip[MARKERS.index(f"{finger}_tip")] == 1
