"""Marker files of gloves: round trips, conversion of other conventions, and errors."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import ezc3d
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bodysense.body.hands.glove import MARKERS, glove_points
from bodysense.body.hands.glove_set import packaged_sets
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.formats.recording import Recording, read_recording, write_recording
from bodysense.io.markers.checks import check_gloves
from bodysense.io.markers.files import read_unlabelled, write_markers
from bodysense.io.markers.formats.csv_table import read_csv
from bodysense.io.markers.options import is_marker_file
from bodysense.io.markers.raw_markers import MarkerFormat, points_alone, read_names
from bodysense.io.markers.recording import read_markers, with_hands_of
from bodysense.observing.observation import Observation
from bodysense.observing.points import chosen_points, without_gloves

RATE = 30.0
RELEASE = packaged_sets()["two-hands"]
RELEASE_NAMES = RELEASE.points([marker.labels["left"] for marker in RELEASE.markers])


def assert_same(read: Observation, written: Observation, metres: float) -> None:
    assert read.points == written.points
    np.testing.assert_array_equal(read.has_position, written.has_position)
    np.testing.assert_allclose(read.position, written.position, atol=metres, equal_nan=True)
    np.testing.assert_allclose(read.time, written.time, atol=1e-5)


@pytest.mark.parametrize("ending", [".csv", ".c3d"])
def test_written_gloves_are_read_back(tmp_path: Path, hidden_gloves: Observation, ending: str) -> None:
    path = tmp_path / f"gloves{ending}"
    write_markers(path, hidden_gloves, RATE)
    assert is_marker_file(path)
    found = read_markers(path)
    assert_same(found.observation, hidden_gloves, 1e-6)
    assert found.frame_rate == pytest.approx(RATE, rel=1e-3)
    assert found.remarks == ()
    assert found.sizes == {"left": pytest.approx(1.0, abs=0.08), "right": pytest.approx(1.0, abs=0.08)}


@pytest.mark.parametrize("ending", [".npz", ".jsonl"])
def test_a_recording_holds_gloves_too(tmp_path: Path, hidden_gloves: Observation, ending: str) -> None:
    path = tmp_path / f"gloves{ending}"
    write_recording(path, Recording(hidden_gloves, default_skeleton()))
    assert_same(read_recording(path).observation, hidden_gloves, 1e-5)


def test_a_recording_still_refuses_unknown_points(tmp_path: Path, gloves: Observation) -> None:
    strange = replace(gloves, points=("left_nose", *gloves.points[1:]))
    with pytest.raises(BodysenseError, match="unknown joint 'left_nose'"):
        write_recording(tmp_path / "a.npz", Recording(strange, default_skeleton()))


def test_gloves_are_taken_from_among_other_points(tmp_path: Path, gloves: Observation) -> None:
    more = replace(gloves, points=("head", *gloves.points[1:]))
    assert without_gloves(more).points == ("head",)
    write_markers(tmp_path / "a.csv", more, RATE)
    assert read_csv(tmp_path / "a.csv").names == gloves.points[1:]
    with pytest.raises(BodysenseError, match="no markers of a glove"):
        write_markers(tmp_path / "b.csv", without_gloves(more), RATE)
    assert not (tmp_path / "b.csv").exists()


def release(path: Path, gloves: Observation, time: bool = True) -> np.ndarray:
    """The left glove as the paper's release has it: its names, NaN where missing, in Unity's left-handed world."""
    left = chosen_points(gloves, [gloves.points.index(name) for name in RELEASE_NAMES.values()])
    header = [f"{name}.{part}" for name in RELEASE_NAMES for part in ("pos.x", "pos.y", "pos.z", "isValid")]
    rows = []
    for t, place in enumerate(left.position):
        row = [f"{left.time[t]:.4f}"] if time else []
        for point in place * [-1, 1, 1]:
            row += [*("NaN" if np.isnan(value) else f"{value:.6f}" for value in point), str(int(point[0] == point[0]))]
        rows.append(",".join(row))
    path.write_text("\n".join([",".join(["time"] * time + header), *rows]) + "\n")
    return left.position


def test_the_layout_of_the_release(tmp_path: Path, hidden_gloves: Observation) -> None:
    place = release(tmp_path / "out_mocap_1.csv", hidden_gloves)
    found = read_markers(tmp_path / "out_mocap_1.csv", MarkerFormat(left_handed=True))
    assert found.observation.points == glove_points("left")
    np.testing.assert_allclose(found.observation.position, place, atol=1e-6)


@given(
    separator=st.sampled_from([",", ";", "\t"]),
    style=st.sampled_from(["{}.pos.{}", "{}.{}", "{}_{}", "{}:{}", "{} {}", "{} ({})", "{}.position.{}", "{}-{}"]),
    capital=st.booleans(),
    clock=st.sampled_from(["time", "Time", "t", "timestamp", "Time (s)", "time_s"]),
    missing=st.sampled_from(["", "NaN", "nan", " ", "null"]),
    comment=st.booleans(),
    seed=st.integers(0, 1000),
)
@settings(max_examples=20)
def test_headers_may_differ(
    tmp_path_factory: pytest.TempPathFactory,
    separator: str,
    style: str,
    capital: bool,
    clock: str,
    missing: str,
    comment: bool,
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    frames, names = 3, ("LEHAR", "left_glove_wrist", "thing 4")
    place = np.round(rng.normal(size=(frames, 3, 3)), 6)
    place[rng.random((frames, 3)) < 0.4] = np.nan
    axes = "XYZ" if capital else "xyz"
    lines = ["# exported"] if comment else []
    lines.append(separator.join([clock, *(style.format(name, axis) for name in names for axis in axes)]))
    for t in range(frames):
        values = [missing if np.isnan(value) else repr(float(value)) for value in place[t].ravel()]
        lines.append(separator.join([str(t / 60), *values]))
    path = tmp_path_factory.mktemp("csv") / "a.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8-sig" if capital else "utf-8")
    raw = read_csv(path)
    assert raw.names == names and raw.frame_rate == pytest.approx(60)
    np.testing.assert_array_equal(raw.position, place)
    np.testing.assert_array_equal(raw.time, np.arange(frames) / 60)


def test_units_and_axes(tmp_path: Path, gloves: Observation) -> None:
    z_up = gloves.position[..., [0, 2, 1]] * [1, -1, 1] * 100
    write_markers(tmp_path / "a.csv", replace(gloves, position=z_up), RATE)
    found = read_markers(tmp_path / "a.csv", MarkerFormat(unit="cm", up="z"))
    np.testing.assert_allclose(found.observation.position, gloves.position, atol=1e-7)


def test_numbers_too_large_to_square_are_refused(tmp_path: Path, gloves: Observation) -> None:
    write_markers(tmp_path / "a.csv", replace(gloves, position=gloves.position * 1e200), RATE)
    with pytest.raises(BodysenseError, match=r"a\.csv"):
        read_markers(tmp_path / "a.csv")


def c3d(path: Path, position: np.ndarray, labels: list[str], unit: str, screens: tuple[str, str] | None) -> None:
    """A file of another program."""
    file = ezc3d.c3d()
    points = np.ones((4, position.shape[1], len(position)))
    points[:3] = position.transpose(2, 1, 0)
    file["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    file["parameters"]["POINT"]["UNITS"]["value"] = [unit]
    file["parameters"]["POINT"]["LABELS"]["value"] = labels
    for name, axis in zip(("X_SCREEN", "Y_SCREEN"), screens or (), strict=False):
        file.add_parameter("POINT", name, [axis])
    file["data"]["points"] = points
    file.write(str(path))


def test_c3d_says_unit_and_axes(tmp_path: Path, gloves: Observation) -> None:
    z_up = gloves.position[..., [0, 2, 1]] * [1, -1, 1]
    names = [f"Anna:{name}" for name in gloves.points]
    c3d(tmp_path / "a.c3d", z_up * 1000, names, "mm", None)
    c3d(tmp_path / "b.c3d", z_up, names, "m", ("+X", "+Z"))
    turned = gloves.position[..., [2, 0, 1]]  # its +X runs along our +Z, its +Y along our +X
    c3d(tmp_path / "c.c3d", turned, names, "m", ("+Y", "+Z"))
    for name in "abc":
        found = read_markers(tmp_path / f"{name}.c3d")
        assert found.frame_rate == 100
        np.testing.assert_allclose(found.observation.position, gloves.position, atol=1e-6)


def test_names_by_a_table(tmp_path: Path, gloves: Observation) -> None:
    theirs = {f"M{k:02}": name for k, name in enumerate(gloves.points)}
    renamed = points_alone(tuple(theirs), gloves.position, gloves.time)
    (tmp_path / "a.json").write_text(json.dumps(theirs))
    (tmp_path / "a.csv").write_text("\n".join(f"{a}, {b}" for a, b in theirs.items()))
    from bodysense.io.markers.formats.csv_table import write_csv

    write_csv(tmp_path / "m.csv", renamed)
    for table in ("a.json", "a.csv"):
        found = read_markers(tmp_path / "m.csv", MarkerFormat(names=read_names(tmp_path / table)))
        assert_same(found.observation, gloves, 1e-6)
    with pytest.raises(
        BodysenseError,
        match=r"no marker of a glove and no marker set of a body among 'M00', .* and 12 more: .* --names",
    ):
        read_markers(tmp_path / "m.csv")
    assert read_unlabelled(tmp_path / "m.csv")[0].points == tuple(theirs)


TABLES = {
    "a list": ("[1, 2]", "a table of names has pairs"),
    "not JSON": ("{", "not JSON; give an object of names"),
    "nothing": ("{}", "a table of names has pairs"),
    "a number": ('{"a": 1}', "a table of names has pairs"),
    "a marker that is none": ('{"a": "left_glove_nose"}', "'left_glove_nose' .* is no marker; give .* pinky_base"),
    "no hand": ('{"a": "glove_wrist"}', "is no marker"),
    "ours twice": ('{"a": "left_glove_wrist", "b": "left_glove_wrist"}', "'left_glove_wrist' stands twice"),
    "theirs twice": ('{"a": "left_glove_wrist", "a": "left_glove_index_tip"}', "'a' stands twice"),
}


@pytest.mark.parametrize("what", TABLES)
def test_invalid_name_tables_are_refused(tmp_path: Path, what: str) -> None:
    text, message = TABLES[what]
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(BodysenseError, match=message):
        read_names(tmp_path / "a.json")


HEADER = "time," + ",".join(f"{name}.pos.{axis}" for name in RELEASE_NAMES for axis in "xyz")
ROW = ",".join(["0"] * 28)
WRONG = {
    "nothing": ("", "the file is empty"),
    "no frames": (HEADER, "columns but no frames"),
    "no markers": ("time,a\n0,1", "no marker in the first line"),
    "a column twice": (f"{HEADER},LEHAR.pos.x\n{ROW},0", r"the column 'LEHAR\.pos\.x' stands twice"),
    "a marker twice": (f"{HEADER},LEHAR.x\n{ROW},0", "is given by two columns"),
    "two names of one marker": (
        f"{HEADER},left_glove_wrist.x,left_glove_wrist.y,left_glove_wrist.z\n{ROW},0,0,0",
        "'LEHAL', 'left_glove_wrist' are both 'left_glove_wrist'; every marker has one name",
    ),
    "no z": ("time,LEHAR.x,LEHAR.y\n0,1,2", "'LEHAR' has no column 'z'"),
    "a line cut short": (f"{HEADER}\n{ROW}\n0,1,2", "line 3 has 3 values, the first line names 28 columns"),
    "a word": (f"{HEADER}\n{ROW.replace('0', 'abc')}", r"line 2, column 'LEHAR\.pos\.x': 'abc' is not a number"),
    "no time in a line": (f"{HEADER}\n{ROW}\n{ROW[1:]}", "line 3 has no time; give seconds"),
    "0 Hz": (f"{HEADER}\n{ROW}\n{ROW}", "time goes from 0 s to 0 s at frame 1; times must increase"),
    "time backwards": (
        f"{HEADER}\n{'1' + ROW[1:]}\n{ROW}",
        "time goes from 1 s to 0 s at frame 1; times must increase",
    ),
    "no times": (f"{HEADER[5:]}\n{ROW[2:]}", "no column of times; give .* --rate"),
    "other markers": (
        "time,a.x,a.y,a.z\n0,1,2,3",
        "no marker of a glove and no marker set .* among 'a': none is .*; give a table of names with --names",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_invalid_files_are_refused(tmp_path: Path, what: str) -> None:
    text, message = WRONG[what]
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(BodysenseError, match=message) as caught:
        read_markers(tmp_path / "a.csv")
    assert "a.csv" in str(caught.value) and "\n" not in str(caught.value)


def test_rates(tmp_path: Path, gloves: Observation) -> None:
    release(tmp_path / "a.csv", gloves, time=False)
    found = read_markers(tmp_path / "a.csv", MarkerFormat(left_handed=True, rate=1000.0))
    assert found.frame_rate == pytest.approx(1000) and found.observation.time[-1] == pytest.approx(0.089)
    with pytest.raises(BodysenseError, match="0 Hz is no frame rate"):
        MarkerFormat(rate=0.0)


@pytest.mark.parametrize("content", [b"", b"hello" * 200, b"\x02\x50" + bytes(510), b"\x02\x50" + b"\xff" * 3000])
def test_files_that_are_not_c3d_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.c3d").write_bytes(content)
    with pytest.raises(
        BodysenseError,
        match=r"a\.c3d: (the file is empty|not a C3D|cannot be read as C3D|it holds no points|was the file cut)",
    ):
        read_markers(tmp_path / "a.c3d")


def test_c3d_files_that_are_cut_short(tmp_path: Path, gloves: Observation) -> None:
    write_markers(tmp_path / "a.c3d", gloves, RATE)
    content = (tmp_path / "a.c3d").read_bytes()
    for size in np.linspace(1, len(content) * 0.9, 12).astype(int):
        (tmp_path / "b.c3d").write_bytes(content[:size])
        with pytest.raises(BodysenseError, match=r"b\.c3d"):
            read_markers(tmp_path / "b.c3d")


@pytest.mark.parametrize(("factor", "unit"), [(1000.0, "mm"), (100.0, "cm")])
def test_a_wrong_declared_unit_is_reported(gloves: Observation, factor: float, unit: str) -> None:
    with pytest.raises(BodysenseError, match=f"the numbers are {unit}, not m; give --unit {unit}"):
        check_gloves(replace(gloves, position=gloves.position * factor), "a.csv")
    with pytest.raises(BodysenseError, match=f"the numbers are m, not {unit}; give --unit m"):
        check_gloves(replace(gloves, position=gloves.position / factor), "a.csv", unit)  # type: ignore[arg-type]


def test_an_impossible_hand(gloves: Observation) -> None:
    with pytest.raises(BodysenseError, match=r"on a hand it is about 0\.08 m: see that the names are right"):
        check_gloves(replace(gloves, position=gloves.position * 8), "a.csv")


def test_a_mirrored_world_is_reported(gloves: Observation) -> None:
    for mirror in ([-1, 1, 1], [1, -1, 1], [1, 1, -1]):
        with pytest.raises(BodysenseError, match="the left and the right glove looks like a hand only in a mirror"):
            check_gloves(replace(gloves, position=gloves.position * mirror), "a.csv")


def test_swapped_hands_are_reported(gloves: Observation) -> None:
    with pytest.raises(BodysenseError, match="--left-handed; otherwise the names take left for right"):
        check_gloves(replace(gloves, points=(*glove_points("right"), *glove_points("left"))), "a.csv")


@pytest.mark.parametrize(("one", "other"), [("index_tip", "middle_tip"), ("wrist", "index_base")])
def test_swapped_markers_are_reported(gloves: Observation, one: str, other: str) -> None:
    points = list(gloves.points)
    a, b = MARKERS.index(one), MARKERS.index(other)
    points[a], points[b] = points[b], points[a]
    remarks = check_gloves(replace(gloves, points=tuple(points)), "a.csv").remarks
    assert len(remarks) == 1 and repr(one) in remarks[0] and repr(other) in remarks[0] and "left glove" in remarks[0]


@pytest.mark.parametrize("seed", range(2))
def test_no_remark_on_good_gloves_wherever_they_are(gloves: Observation, seed: int) -> None:
    rng = np.random.default_rng(seed)
    position = gloves.position[::9] @ Rotation.random(rng=rng).as_matrix() + rng.normal(size=3)
    size = rng.uniform(0.8, 1.2)
    check = check_gloves(points_alone(gloves.points, position * size, gloves.time[::9]), "a.csv")
    assert check.remarks == ()
    assert check.sizes["left"] == pytest.approx(size, rel=0.08)


def test_a_rarely_seen_glove_is_ignored(gloves: Observation) -> None:
    few = chosen_points(gloves, [0, 1, 2, 3, 4])
    check = check_gloves(few, "a.csv")
    assert check.sizes == {} and "never shows 7 markers" in check.remarks[0]


def test_bodies_get_hands_of_the_gloves_size() -> None:
    body = default_skeleton()
    larger = with_hands_of(body, {"left": 1.1, "right": 1.0})
    hand, arm = larger.wrist_of >= 0, larger.wrist_of < 0
    np.testing.assert_allclose(larger.rest_offset[hand], 1.05 * body.rest_offset[hand])
    np.testing.assert_array_equal(larger.rest_offset[arm], body.rest_offset[arm])
    assert with_hands_of(body, {}) is body
