"""Streams of sequences contain every frame once, in order."""

from hypothesis import given
from hypothesis import strategies as st

from bodysense_lab.core.fit import stream_sequences


@given(lengths=st.lists(st.integers(1, 9), min_size=1, max_size=8), count=st.integers(1, 3), chunk=st.integers(1, 5))
def test_every_frame_is_in_a_stream_once_and_in_order(lengths: list[int], count: int, chunk: int) -> None:
    drawn: list[range] = []

    def draw() -> range:
        first = sum(len(one) for one in drawn)
        drawn.append(range(first, first + lengths[len(drawn) % len(lengths)]))
        return drawn[-1]

    heard: list[list[int]] = [[] for _ in range(count)]
    for _, (pieces, begins) in zip(range(12), stream_sequences(draw, count, chunk), strict=False):
        for k, (one, start) in enumerate(pieces):
            assert begins[k] == (start == 0)
            heard[k] += one[start : start + chunk]
    for frames in heard:
        starts = [frame for frame in frames if any(frame == one.start for one in drawn)]
        played_here = [one for one in drawn if one.start in starts]
        expected = [frame for one in played_here for frame in one]
        assert frames == expected[: len(frames)] and len(set(frames)) == len(frames)
