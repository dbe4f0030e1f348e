"""Damaged files of every kind that is written here are read, or refused in one line that names them."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bodysense.body.person import Person
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.device import simulate
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.recording import Recording
from bodysense.io.markers.files import write_markers
from bodysense.observing.observation import Observation
from bodysense.sources.reading import read, write
from bodysense_conform.sources.mcap_take import read_mcap

WRITTEN = ("a.bvh", "a.glb", "a.vrma", "a.mcap")
RECORDED = ("a.npz", "a.jsonl")
MARKERS = ("a.csv", "a.c3d")
READERS: dict[str, Callable[[Path], object]] = {
    name: read for name in (*WRITTEN, *RECORDED, *MARKERS, "a.npy", "smpl.npz", "amass.npz")
}
READERS |= {"a.mcap": read_mcap, "person.json": Person.load}
WORDS = [b"nan", b"-1", b"1e308", b"99999999999", b"0", b"null", b"{}", b"[]", b'"x"', b""]
SPOTS = re.compile(rb"-?\d+\.?\d*|null|true|\"[^\"]{1,30}\"")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, hidden_gloves: Observation) -> Path:
    """A folder with a sound file of each kind."""
    folder = tmp_path_factory.mktemp("whole")
    clip = packaged_performance()
    clip = Clip("take", clip.pose[:40:8], 30.0)
    for name in WRITTEN:
        write(folder / name, clip)
    seen = Recording(simulate(clip, "three_point"), clip.pose.skeleton)
    for name in RECORDED:
        write(folder / name, seen)
    for name in MARKERS:
        write_markers(folder / name, hidden_gloves[:6], 30.0)
    np.save(folder / "a.npy", np.zeros((4, 72)))
    np.savez(folder / "smpl.npz", poses=np.zeros((4, 72)), transl=np.zeros((4, 3)), fps=30)
    np.savez(folder / "amass.npz", poses=np.ones((4, 156)), trans=np.zeros((4, 3)), mocap_framerate=30.0)
    Person(height=1.8).save(folder / "person.json")
    return folder


@st.composite
def damages(draw: st.DrawFn) -> Callable[[bytes], bytes]:
    """Damage a file: replace numbers and words, and change, remove or repeat bytes."""
    at, value = draw(st.integers(0, 1 << 20)), draw(st.binary(min_size=1, max_size=4))
    how, length = draw(st.sampled_from(["word", "change", "cut", "gone", "twice"])), draw(st.sampled_from([1, 4, 40]))
    word = draw(st.sampled_from(WORDS))

    def damaged(data: bytes) -> bytes:
        start = at % len(data)
        spots = [spot.span() for spot in SPOTS.finditer(data[start : start + 2000])] if how == "word" else []
        if spots:
            first, last = spots[at % len(spots)]
            return data[: start + first] + word + data[start + last :]
        if how == "cut":
            return data[: max(start, 1)]
        if how == "gone":
            return data[:start] + data[start + length :]
        if how == "twice":
            return data[: start + length] + data[start:]
        return data[:start] + value + data[start + len(value) :]

    return damaged


@pytest.mark.parametrize("kind", READERS)
@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(done=st.lists(damages(), min_size=1, max_size=3))
def test_a_damaged_file_is_read_or_refused_in_one_line(
    tmp_path: Path, whole: Path, kind: str, done: list[Callable[[bytes], bytes]]
) -> None:
    path, data = tmp_path / kind, (whole / kind).read_bytes()
    for damage in done:
        data = damage(data) or b"x"
    path.write_bytes(data)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)  # which would be lines of their own
        try:
            READERS[kind](path)
        except BodysenseError as error:
            assert kind in str(error) and "\n" not in str(error).strip()
