"""Recordings: round trips, and one clear line for any other file."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.formats.recording import FORMAT, Recording, is_recording, read_recording, write_recording
from bodysense.observing.observation import HEADSET_ACCURACY, TRACKER_ACCURACY, Observation

SKELETON = Skeleton(
    ("pelvis", "neck", "head"),
    ("head_top",),
    (-1, 0, 1, 2),
    np.array([[0, 1, 0], [0, 0.4, 0], [0, 0.1, 0], [0, 0.2, 0]]),
)
FIELDS = ("position", "rotation", "has_position", "has_rotation", "accuracy")


def example(frames: int = 6, seed: int = 0) -> Recording:
    """A head and a neck, hidden at random, at irregular times."""
    rng = np.random.default_rng(seed)
    points = ("head", "neck")
    seen, turned = (rng.uniform(size=(frames, 2)) < share for share in (0.6, 0.3))
    rotation = rng.normal(size=(frames, 2, 4))
    rotation /= np.linalg.norm(rotation, axis=-1, keepdims=True)
    observation = Observation(
        points=points,
        position=np.where(seen[..., None], rng.normal(scale=2.0, size=(frames, 2, 3)), np.nan),
        rotation=np.where(turned[..., None], rotation, np.nan),
        has_position=seen,
        has_rotation=turned,
        accuracy=np.where(rng.uniform(size=(frames, 2)) < 0.5, 0.001, 0.02),
        time=np.cumsum(rng.uniform(0.001, 0.1, size=frames)),
    )
    return Recording(observation, SKELETON)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("recordings")


def assert_refused(path: Path, text: str = "") -> None:
    with pytest.raises(BodysenseError, match=text) as raised:
        read_recording(path)
    assert str(path) in str(raised.value) and "\n" not in str(raised.value)


def read_or_refuse(path: Path) -> Recording | None:
    """Damaged in whatever way, a file is read or refused by name."""
    try:
        return read_recording(path)
    except BodysenseError as error:
        assert str(path) in str(error)
        assert "\n" not in str(error)
        return None


@pytest.mark.parametrize("ending", [".npz", ".jsonl"])
@settings(max_examples=10)
@given(frames=st.integers(1, 12), seed=st.integers(0, 999))
def test_a_round_trip(folder: Path, ending: str, frames: int, seed: int) -> None:
    recording, path = example(frames, seed), folder / f"round{ending}"
    write_recording(path, recording)
    assert is_recording(path)
    back = read_recording(path)
    ours, theirs = recording.observation, back.observation
    assert theirs.points == ours.points
    np.testing.assert_array_equal(theirs.has_position, ours.has_position)
    np.testing.assert_array_equal(theirs.has_rotation, ours.has_rotation)
    np.testing.assert_allclose(theirs.position, ours.position, atol=1e-5)
    np.testing.assert_allclose(theirs.rotation, ours.rotation, atol=1e-6)
    np.testing.assert_allclose(theirs.time, ours.time, atol=1e-6)
    np.testing.assert_allclose(theirs.accuracy[ours.has_position], ours.accuracy[ours.has_position], rtol=1e-3)
    assert back.skeleton.points == SKELETON.points and back.skeleton.parents == SKELETON.parents
    np.testing.assert_allclose(back.skeleton.rest_offset, SKELETON.rest_offset, atol=1e-6)


def test_without_a_skeleton_it_is_the_default_one(tmp_path: Path) -> None:
    """The example of docs/recording.md."""
    path = tmp_path / "a.jsonl"
    path.write_text(
        '{"format": "bodysense recording 1", "points": ["head", "left_wrist", "right_wrist"]}\n'
        '{"time": 0.0, "position": {"head": [0, 1.6, 0], "left_wrist": [0.3, 1.0, 0.2]}, '
        '"rotation": {"head": [1, 0, 0, 0]}}\n'
        "\n"
        '{"time": 0.033, "position": {"head": [0, 1.6, 0]}, "rotation": {"head": [1, 0, 0, 0]}}\n'
    )
    recording = read_recording(path)
    assert recording.skeleton is default_skeleton()
    assert recording.observation.has_position.tolist() == [[True, True, False], [True, False, False]]
    assert recording.observation.has_rotation.tolist() == [[True, False, False]] * 2
    np.testing.assert_array_equal(recording.observation.time, [0.0, 0.033])
    np.testing.assert_array_equal(recording.observation.accuracy, HEADSET_ACCURACY)


def test_accuracy_of_a_point_and_of_a_frame(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    lines = [
        '{"format": "bodysense recording 1", "points": ["head", "left_knee"], "accuracy": {"head": 0.005}}',
        '{"time": 0, "position": {"head": [0, 1.6, 0]}}',
        '{"time": 1, "position": {"head": [0, 1.6, 0]}, "accuracy": {"head": 0.3}}',
    ]
    path.write_text("\n".join(lines))
    np.testing.assert_array_equal(
        read_recording(path).observation.accuracy, [[0.005, TRACKER_ACCURACY], [0.3, TRACKER_ACCURACY]]
    )
    for bad, text in (('"2 mm"', "give metres"), ("0", "is 0; give the expected error"), ("-1", "is -1; give")):
        path.write_text("\n".join(lines).replace("0.3", bad))
        assert_refused(path, text)
    path.write_text("\n".join(lines).replace('"head": 0.3', '"nose": 0.3'))
    assert_refused(path, "frame 1 has accuracy of 'nose', which the header's points do not list")


def test_an_old_npz_has_the_usual_accuracy(tmp_path: Path) -> None:
    write_recording(tmp_path / "new.npz", example())
    with np.load(tmp_path / "new.npz") as archive:
        arrays = {name: archive[name] for name in archive.files if name != "accuracy"}
    np.savez(tmp_path / "old.npz", **arrays)
    accuracy = read_recording(tmp_path / "old.npz").observation.accuracy
    np.testing.assert_array_equal(accuracy, np.tile([HEADSET_ACCURACY, TRACKER_ACCURACY], (6, 1)))


@pytest.mark.parametrize("ending", [".npz", ".jsonl"])
def test_unix_time_is_a_time(tmp_path: Path, ending: str) -> None:
    recording, path = example(), tmp_path / f"a{ending}"
    time = recording.observation.time + 1.7e9
    write_recording(path, replace(recording, observation=replace(recording.observation, time=time)))
    np.testing.assert_allclose(read_recording(path).observation.time, time, rtol=0, atol=1e-6)


# --- damage of any kind


@settings(max_examples=20)
@given(share=st.floats(0, 1))
def test_a_file_cut_short(folder: Path, share: float) -> None:
    for ending in (".npz", ".jsonl"):
        whole, path = folder / f"whole{ending}", folder / f"cut{ending}"
        write_recording(whole, example(20))
        content = whole.read_bytes()
        path.write_bytes(content[: int(share * len(content))])
        recording = read_or_refuse(path)
        if ending == ".npz" or share < 0.01:
            assert recording is None or share == 1
        elif recording is not None:  # cut between two lines, it is a shorter recording
            length = len(recording.observation)
            np.testing.assert_allclose(recording.observation.time, example(20).observation.time[:length], atol=1e-6)


KEYS = ("format", "points", *FIELDS, "time", "joints", "end_sites", "parents", "rest_offset")
SHAPES = arrays.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=6)


@given(key=st.sampled_from(KEYS), data=st.data())
def test_an_array_of_any_kind(folder: Path, key: str, data: st.DataObject) -> None:
    """One array is replaced by one of any shape and type, or left out."""
    kinds = st.one_of(arrays.scalar_dtypes(), arrays.unicode_string_dtypes(max_len=6))
    path = folder / "array.npz"
    write_recording(path, example(3))
    with np.load(path) as archive:
        content = dict(archive)
    shape = data.draw(st.one_of(st.just(content[key].shape), SHAPES))
    content[key] = data.draw(arrays.arrays(data.draw(kinds), shape))
    if data.draw(st.booleans()):
        del content[key]
    np.savez(path, **content)
    read_or_refuse(path)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.sampled_from(["head", "neck"]),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.sampled_from(["head", "x"]), inner, max_size=3),
    max_leaves=8,
)


@given(
    key=st.sampled_from(["format", "points", "skeleton", "joints", "parents", "rest_offset", *FIELDS[:2], "time"]),
    value=JSON,
)
def test_json_of_any_kind(folder: Path, key: str, value: Any) -> None:
    path = folder / "json.jsonl"
    write_recording(path, example(3))
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    row = rows[0]["skeleton"] if key in rows[0]["skeleton"] else rows[0] if key in rows[0] else rows[1]
    row[key] = value
    path.write_text("\n".join(json.dumps(row) for row in rows))
    read_or_refuse(path)


# --- errors in plain words

Change = Callable[[dict[str, np.ndarray]], object]
WRONG_ARRAYS: dict[str, tuple[Change, str]] = {
    "no time": (lambda a: a.pop("time"), "not a recording, it has no 'time'; see docs/recording.md for the layout"),
    "another format": (lambda a: a.update(format=np.array("x")), f"format 'x', but this version reads '{FORMAT}'"),
    "half a skeleton": (
        lambda a: a.pop("parents"),
        "its skeleton has no 'parents'; give joints, end_sites, parents, rest",
    ),
    "complex positions": (
        lambda a: a.update(position=a["position"] * 1j),
        "position is of type complex64; positions, rot",
    ),
    "masks of numbers": (
        lambda a: a.update(has_position=a["has_position"] * 1),
        "has_position is of type int64; .* masks bool",
    ),
    "one frame too few": (
        lambda a: a.update(rotation=a["rotation"][1:]),
        r"rotation has shape \(5, 2, 4\); 6 frames of 2 points need \(6, 2, 4\)",
    ),
    "batches": (
        lambda a: a.update({name: a[name][None] for name in FIELDS}),
        r"position has shape \(1, 6, 2, 3\); a recording is of one motion, \(6, 2, 3\)",
    ),
    "no frames": (lambda a: a.update(time=np.zeros(0)), "time and points must be lists of at least one value"),
    "a point twice": (
        lambda a: a.update(points=np.array(["head", "head"])),
        "a point is named twice; names must differ",
    ),
    "NaN marked as seen": (
        lambda a: a["has_position"].__setitem__((2, 1), True) or a["position"].__setitem__((2, 1), np.nan),
        "has_position says that 'neck' is tracked at frame 2, but its position is not finite; clear the mask there",
    ),
    "parents that are no numbers": (lambda a: a.update(parents=np.array(list("abcd"))), "its skeleton cannot be read"),
    "a loop of parents": (
        lambda a: a.update(parents=np.array([-1, 2, 1, 2])),
        "skeleton: the parent of 'neck' is 2; it must be a joint that comes before it",
    ),
}


@pytest.mark.parametrize("what", WRONG_ARRAYS)
def test_wrong_arrays(tmp_path: Path, what: str) -> None:
    change, text = WRONG_ARRAYS[what]
    path = tmp_path / "a.npz"
    write_recording(path, example())
    with np.load(path) as archive:
        content = dict(archive)
    change(content)
    np.savez(path, **content)
    assert_refused(path, r"a\.npz: .*" + text)


HEADER = json.dumps({"format": FORMAT, "points": ["head", "left_wrist"]})
WRONG_LINES = {
    "nothing": ("", "the file is empty; copy or export it again"),
    "another format": ('{"format": "x"}', "must be a header with format 'bodysense recording 1', but it has 'x'"),
    "no points": (json.dumps({"format": FORMAT}), "the header needs 'points', a list of names"),
    "no frames": (HEADER, "a header but no frames; each further line is one frame with its 'time'"),
    "not JSON": (f"{HEADER}\n{{'time': 0}}", r"line 2 is not JSON; was the file cut short\? Remove the line"),
    "not an object": (f"{HEADER}\n[0]", "line 2 is not a JSON object"),
    "deep": (f"{HEADER}\n" + "[" * 100_000, "line 2 is not JSON"),
    "no time": (f'{HEADER}\n{{"position": {{}}}}', "frame 0 has no 'time'; give seconds"),
    "misspelt": (
        f'{HEADER}\n{{"time": 0, "pozition": {{}}}}',
        "frame 0 has 'pozition', which no frame has; valid are acceleration, accuracy, position, rotation, time",
    ),
    "time as text": (f'{HEADER}\n{{"time": "0"}}', "frame 0 has no 'time'; give seconds"),
    "a number of 5000 digits": (f'{HEADER}\n{{"time": {"1" * 5000}}}', "line 2 is not JSON"),
    "an unlisted point": (
        f'{HEADER}\n{{"time": 0, "position": {{"neck": [0, 0, 0]}}}}',
        "frame 0 has position of 'neck', which the header's points do not list",
    ),
    "two numbers": (
        f'{HEADER}\n{{"time": 0, "position": {{"head": [0, 1]}}}}',
        r"frame 0: position of 'head' is \[0, 1\]; give 3 numbers",
    ),
    "a number beyond all bounds": (
        f'{HEADER}\n{{"time": 0, "position": {{"head": [1{"0" * 400}, 0, 0]}}}}',
        r"frame 0: position of 'head' is \[10+; give 3 numbers",
    ),
    "a list for an object": (
        f'{HEADER}\n{{"time": 0, "position": []}}',
        "frame 0: position must be an object from point names to numbers",
    ),
    "a skeleton of text": (
        json.dumps({"format": FORMAT, "points": ["head"], "skeleton": "mine"}) + '\n{"time": 0}',
        "the header's 'skeleton' must be an object with joints, end_sites, parents, rest_offset",
    ),
    "time backwards": (
        f'{HEADER}\n{{"time": 1}}\n{{"time": 1}}',
        "time goes from 1 s to 1 s at frame 1; times must incr",
    ),
}


@pytest.mark.parametrize("what", WRONG_LINES)
def test_wrong_lines(tmp_path: Path, what: str) -> None:
    content, text = WRONG_LINES[what]
    path = tmp_path / "a.jsonl"
    path.write_text(content)
    assert_refused(path, r"a\.jsonl: .*" + text)


def test_files_that_are_no_recordings(tmp_path: Path) -> None:
    assert_refused(tmp_path / "a.csv", r"a\.csv: a recording ends in \.npz or \.jsonl, not in '\.csv'")
    assert_refused(tmp_path / "a", r"a recording ends in \.npz or \.jsonl, not in 'nothing'")
    assert_refused(tmp_path / "a.npz", r"a\.npz: no such file")
    (tmp_path / "a.jsonl").write_bytes(b"{\xff\xfe")
    assert_refused(tmp_path / "a.jsonl", r"a\.jsonl: not text in UTF-8; export it again")
    with (tmp_path / "array.npz").open("wb") as file:
        np.save(file, np.zeros(3))
    assert_refused(tmp_path / "array.npz", r"array\.npz: cannot be read as an .npz file \(.*\)")
    np.savez(tmp_path / "pickled.npz", points=np.array([{}], dtype=object))
    assert_refused(
        tmp_path / "pickled.npz", r"pickled\.npz: 'points' holds objects of Python, which only unpickling reads"
    )


def test_a_motion_is_not_a_recording(tmp_path: Path) -> None:
    np.savez(tmp_path / "motion.npz", poses=np.zeros((2, 156)), trans=np.zeros((2, 3)))
    assert not is_recording(tmp_path / "motion.npz")
    assert not is_recording(tmp_path / "missing.npz")
    assert_refused(tmp_path / "motion.npz", "not a recording, it has no 'format'")


# --- writing


@pytest.mark.parametrize("ending", [".npz", ".jsonl"])
def test_unreadable_recordings_are_not_written(tmp_path: Path, ending: str) -> None:
    good = example()
    path = tmp_path / f"a{ending}"
    seen = good.observation
    bad = {
        "time goes from": replace(seen, time=seen.time[::-1]),
        "is tracked at frame": replace(seen, has_position=np.ones_like(seen.has_position)),
        "is of one motion": replace(seen, **{name: getattr(seen, name)[None] for name in FIELDS}),
        "unknown joint 'nose'": replace(seen, points=("head", "nose")),
    }
    for text, observation in bad.items():
        with pytest.raises(BodysenseError, match=text) as raised:
            write_recording(path, Recording(observation, SKELETON))
        assert str(path) in str(raised.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", [".npz", ".jsonl"])
def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str) -> None:
    path = tmp_path / f"a{ending}"
    write_recording(path, example(3))
    before = path.read_bytes()

    def full(*arguments: object, **options: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(BodysenseError, match=r"cannot be written \(No space left on device\); choose a place that can"):
        write_recording(path, example(4))
    assert [found.name for found in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == before


@pytest.mark.parametrize("ending", [".npz", ".jsonl"])
def test_accelerations_come_back(tmp_path: Path, ending: str) -> None:
    recording = example()
    felt = np.round(np.random.default_rng(2).normal(size=recording.observation.position.shape), 3)
    felt[1:3, 0] = np.nan
    path = tmp_path / f"felt{ending}"
    write_recording(path, replace(recording, observation=replace(recording.observation, acceleration=felt)))
    back = read_recording(path).observation.acceleration
    assert back is not None
    np.testing.assert_allclose(back, felt, atol=1e-3)
    write_recording(path, recording)
    assert read_recording(path).observation.acceleration is None
