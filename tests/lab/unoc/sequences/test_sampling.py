"""Lanes walk through whole clips; windows end at every frame."""

from __future__ import annotations

from itertools import islice

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bodysense_lab.papers.unoc.sequences.body_sequences import (
    BodyBatch,
    BodySequence,
    carried_batches,
    collate,
    windows,
)

LENGTHS = st.lists(st.integers(2, 30), min_size=1, max_size=5)


def sequences(lengths: list[int]) -> list[BodySequence]:
    """Sequences whose features say which clip and frame they are of."""
    return [
        BodySequence(
            features=np.stack([np.full(length, k), np.arange(length)], axis=-1).astype(np.float32),
            known=np.full((length, 2, 3), k, dtype=np.float32),
            offset=np.zeros((length, 2, 3), dtype=np.float32),
            visible=np.ones((length, 2), dtype=bool),
            fingers=k % 2 == 0,
        )
        for k, length in enumerate(lengths)
    ]


def frames_of(batch: BodyBatch, row: int) -> tuple[int, list[int]]:
    """Which clip and which frames a row holds; never of two clips."""
    clip = set(batch.features[row, :, 0].tolist()) | set(batch.known[row].flatten().tolist())
    assert len(clip) == 1
    return int(clip.pop()), batch.features[row, :, 1].int().tolist()


def test_clips_are_drawn_by_weight() -> None:
    drawn = carried_batches(sequences([4, 4, 4]), np.array([1.0, 0.0, 3.0]), 8, 4, np.random.default_rng(0))
    clips = [frames_of(batch, row)[0] for batch in islice(drawn, 200) for row in range(8)]
    share = np.bincount(clips, minlength=3) / len(clips)
    np.testing.assert_allclose(share, [0.25, 0.0, 0.75], atol=0.04)


@given(LENGTHS, st.integers(1, 9), st.integers(1, 4), st.integers(1, 16), st.integers(0, 99))
def test_an_epoch_ends_a_window_at_each_frame_once(
    lengths: list[int], window: int, stride: int, batch_size: int, seed: int
) -> None:
    batches = list(windows(sequences(lengths), window, stride, batch_size, np.random.default_rng(seed)))
    ends: dict[int, list[int]] = {}
    for batch in batches:
        assert len(batch.features) <= batch_size
        for row in range(len(batch.features)):
            clip, frames = frames_of(batch, row)
            ends.setdefault(clip, []).append(frames[-1])
            assert frames == [max(0, frame) for frame in range(frames[-1] - window + 1, frames[-1] + 1)]
            assert bool(batch.valid[row].all()) and bool(batch.begins[row])
    for clip, length in enumerate(lengths):
        found = sorted(ends[clip])
        assert found[0] < stride
        assert found == list(range(found[0], length, stride))


def test_an_epoch_is_shuffled() -> None:
    (batch,) = windows(sequences([60]), 3, 1, 100, np.random.default_rng(0))
    ends = batch.features[:, -1, 1].int().tolist()
    assert sorted(ends) == list(range(60)) and ends != list(range(60))


def test_collate_repeats_the_ends() -> None:
    (sequence,) = sequences([5])
    batch = collate([(sequence, -2), (sequence, 3)], 4, np.array([True, False]))
    assert batch.features[0, :, 1].tolist() == [0, 0, 0, 1] and batch.valid[0].all()
    assert batch.features[1, :, 1].tolist() == [3, 4, 4, 4]
    assert batch.valid[1].tolist() == [True, True, False, False]
    assert batch.begins.tolist() == [True, False]
