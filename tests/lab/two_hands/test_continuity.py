"""The paper's continuity: offsets are kept while a marker is hidden, and decay linearly when it is found."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.body.hands.glove import default_glove, marker_positions
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.gap_fillers import NetworkGapFiller
from bodysense_lab.papers.two_hands.continuity import Continuity
from bodysense_lab.synthesis.hands import synthesize_hand

MARKER = 5
INTERVAL = 1 / 60  # s
SPEED = 0.25  # m/s


class Wrong:
    """A network that predicts every marker at one place, far from the true one."""

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        return np.full_like(markers, 0.03)


def output(hand: Skeleton, seed: int, hidden: int, seen: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return true markers (T, 9, 3) m, output ones, and offsets; `MARKER` is hidden for some frames, then seen."""
    motion = synthesize_hand(hand, 2.5, np.random.default_rng(seed))
    true = np.asarray(marker_positions(default_glove(), motion.pose))[: 1 + hidden + seen]
    markers = true.copy()
    markers[1 : 1 + hidden, MARKER] = np.nan
    method = Continuity(NetworkGapFiller(Wrong(), [hand], fading=None))
    state, found, offset = method.start(1), [], []
    for frame in markers:
        filled, state = method.fill(frame[None], INTERVAL, state)
        found.append(filled[0])
        offset.append(state.offset[0])
    return true, np.array(found), np.array(offset)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 99), hidden=st.integers(5, 40), seen=st.integers(5, 60))
def test_a_found_marker_approaches_the_measured_one_in_a_straight_line(
    hand: Skeleton, seed: int, hidden: int, seen: int
) -> None:
    true, found, offset = output(hand, seed, hidden, seen)
    np.testing.assert_allclose(found[0], true[0], atol=1e-12)
    assert not offset[: 1 + hidden].any()
    after, length = offset[1 + hidden :, MARKER], np.linalg.norm(offset[1 + hidden :, MARKER], axis=-1)
    np.testing.assert_allclose(found[1 + hidden :], true[1 + hidden :] + offset[1 + hidden :], atol=1e-12)
    steps = np.arange(len(length)) * SPEED * INTERVAL
    np.testing.assert_allclose(length, np.maximum(length[0] - steps, 0.0), atol=1e-9)
    np.testing.assert_allclose(after * length[0], np.outer(length, after[0]), atol=1e-12)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 99), hidden=st.integers(5, 40))
def test_no_frame_has_a_jump(hand: Skeleton, seed: int, hidden: int) -> None:
    """A wrong prediction is centimetres off; in a frame the marker moves with the hand and by the decay alone."""
    true, found, _ = output(hand, seed, hidden, 30)
    hand_step = np.linalg.norm(np.diff(true, axis=0), axis=-1).max(axis=1)
    step = np.linalg.norm(np.diff(found[:, MARKER], axis=0), axis=-1)
    assert (step <= 2 * hand_step + SPEED * INTERVAL + 1e-3).all()
