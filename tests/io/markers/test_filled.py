"""Marker files with filled gaps: close to the truth, without steps, every other byte unchanged."""

from __future__ import annotations

import csv
import json
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import ezc3d
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from virtual_markers import PLUG_IN_GAIT, marker_positions

from bodysense.cli import main
from bodysense.demo import performance_of_unseen_body
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.markers.files import read_raw
from bodysense.io.markers.filled import fillable, write_filled
from bodysense.io.markers.formats.c3d import write_c3d
from bodysense.io.markers.raw_markers import points_alone
from bodysense.takes.track import track

RATE = 30.0
GAPS = {"LKNE": (20, 50), "LTHI": (0, 15), "C7": (70, 90), "LFHD": (30, 33), "RANK": (40, 70)}  # frames


@pytest.fixture(scope="module")
def clip() -> Clip:
    whole = performance_of_unseen_body()
    return replace(whole, pose=whole.pose[300:390])


@pytest.fixture(scope="module")
def truth(clip: Clip) -> dict[str, np.ndarray]:
    """(T, 3) mm of every marker, +Z up as most laboratories have it."""
    return {name: 1000 * place[:, [2, 0, 1]] for name, place in marker_positions(clip.pose, PLUG_IN_GAIT).items()}


@pytest.fixture(scope="module")
def with_gaps(truth: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    gapped = {name: place.copy() for name, place in truth.items()}
    for name, (first, end) in GAPS.items():
        gapped[name][first:end] = np.nan
    return gapped | {"ball": np.cumsum(np.random.default_rng(1).normal(0, 60, (90, 3)), axis=0) + 900}


def cells(row: list[np.ndarray]) -> list[str]:
    return ["" if np.isnan(value) else f"{value:.3f}" for place in row for value in place]


def trc(markers: dict[str, np.ndarray]) -> bytes:
    names, frames = list(markers), len(next(iter(markers.values())))
    lines = ["PathFileType\t4\t(X/Y/Z)\twalk.trc"]
    lines.append("DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames")
    lines.append(f"{RATE}\t{RATE}\t{frames}\t{len(names)}\tmm\t{RATE}\t1\t{frames}")
    lines.append("Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t")
    lines += ["\t\t" + "\t".join(f"{axis}{k + 1}" for k in range(len(names)) for axis in "XYZ"), ""]
    for t in range(frames):
        lines.append("\t".join([str(t + 1), f"{t / RATE:.5f}", *cells([at[t] for at in markers.values()])]))
    return ("\r\n".join(lines) + "\r\n").encode()


def motive(markers: dict[str, np.ndarray]) -> bytes:
    frames, count = len(next(iter(markers.values()))), 3 * len(markers)
    head = f"Format Version,1.23,Export Frame Rate,{RATE},Rotation Type,Quaternion,Length Units,Millimeters"
    lines = [head, ",Type,Rigid Body,Rigid Body,Rigid Body" + ",Marker" * count]
    lines.append(",Name,Plate,Plate,Plate" + "".join(3 * f",Anna:{name}" for name in markers))
    lines += [
        ",ID" + ",1" * (count + 3),
        "," + ",Position" * (count + 3),
        "Frame,Time (Seconds)" + ",X,Y,Z" * (len(markers) + 1),
    ]
    for t in range(frames):
        rows = cells([at[t] for at in markers.values()])
        lines.append(",".join([str(t), f"{t / RATE:.6f}", *(["", "", ""] if t == 3 else ["1", "2", "3"]), *rows]))
    return ("\r\n".join(lines) + "\r\n").encode()


def plain(markers: dict[str, np.ndarray]) -> bytes:
    """A file with a column of validity; invalid markers keep their last position."""
    frames = len(next(iter(markers.values())))
    lines = ["time," + ",".join(f"{name}.x,{name}.y,{name}.z,{name}.isValid" for name in markers)]
    for t in range(frames):
        row = [f"{t / RATE:.6f}"]
        for at in markers.values():
            seen = not np.isnan(at[t]).any()
            row += [*(f"{value / 1000:.6f}" if seen else "9.9" for value in at[t]), str(int(seen))]
        lines.append(",".join(row))
    return ("\n".join(lines)).encode()  # the last line does not end


TEXTS: dict[str, tuple[str, Callable[[dict[str, np.ndarray]], bytes]]] = {
    "TRC": ("a.trc", trc),
    "Motive": ("a.csv", motive),
    "CSV": ("a.csv", plain),
}


@pytest.mark.parametrize("layout", TEXTS)
def test_cells_of_filled_markers_change_and_nothing_else(
    tmp_path: Path, with_gaps: dict[str, np.ndarray], layout: str
) -> None:
    name, write = TEXTS[layout]
    old = write(with_gaps)
    (tmp_path / name).write_bytes(old)
    raw = read_raw(tmp_path / name)
    filled = ~np.isfinite(raw.position).all(axis=-1) & fillable(raw)
    assert filled.sum() == sum(end - first for first, end in GAPS.values())
    number = np.arange(raw.position.size).reshape(raw.position.shape) / 7
    write_filled(tmp_path / name, tmp_path / f"out{Path(name).suffix}", raw, number, filled)
    new = (tmp_path / f"out{Path(name).suffix}").read_bytes()
    delimiter = "\t" if b"\t" in old else ","  # both texts as tables, by Python's own reader
    before, after = (list(csv.reader(text.decode().splitlines(), delimiter=delimiter)) for text in (old, new))
    assert [len(row) for row in before] == [len(row) for row in after]
    flags = 4 if layout == "CSV" else 3
    changed = sum(a != b for one, other in zip(before, after, strict=True) for a, b in zip(one, other, strict=True))
    assert changed == flags * filled.sum()
    untouched = [k for k, (one, other) in enumerate(zip(before, after, strict=True)) if one == other]
    lines = old.split(b"\n"), new.split(b"\n")
    assert all(lines[0][k] == lines[1][k] for k in untouched) and len(lines[0]) == len(lines[1])
    again = read_raw(tmp_path / f"out{Path(name).suffix}")
    digits = 6 if layout == "CSV" else 3
    np.testing.assert_allclose(again.position[filled], number[filled], atol=0.51 * 10**-digits)
    np.testing.assert_array_equal(again.position[~filled], raw.position[~filled])


SEPARATORS = {"trc": ["\t", ";", ","], "tsv": ["\t"], "nexus": [",", ";"], "motive": [","], "csv": [",", ";", "\t"]}


@dataclass(frozen=True)
class Written:
    """A file of a program; its last lines are the frames."""

    ending: str  # of its name
    lines: list[str]
    end: str  # of each line but the last
    tail: str  # after the last frame
    mark: str  # at its begin
    columns: list[list[int]]  # of x, y and z of each marker
    gone: np.ndarray  # (T, M) bool

    @property
    def text(self) -> str:
        """The whole file."""
        return self.mark + self.end.join(self.lines) + self.tail


@st.composite
def written(draw: st.DrawFn) -> Written:
    """Small files in every layout, with every usual separator, number and missing value."""
    layout = draw(st.sampled_from(sorted(SEPARATORS)))
    separator = draw(st.sampled_from(SEPARATORS[layout]))
    frames, count = draw(st.integers(1, 5)), draw(st.integers(1, 4))
    has_quotes = layout in ("nexus", "motive", "csv") and draw(st.booleans())
    point = draw(st.sampled_from([".", ","])) if separator != "," or has_quotes else "."
    absent = draw(st.sampled_from(["", "  ", "nan", "NaN", "#N/A", "0.0", *(['""', '" "'] if has_quotes else [])]))
    form = draw(st.sampled_from(["{:.3f}", "{:.1f}", "{:.6f}", "{:.5e}", "{:+.2f}", " {:.3f} "]))
    form = f'"{form.strip()}"' if has_quotes else form
    unit = draw(st.sampled_from(["mm", "m", "cm"]))
    gone = draw(arrays(bool, (frames, count)))
    values = draw(arrays(float, (frames, count, 3), elements=st.floats(-3000, 3000).filter(lambda x: abs(x) > 1)))
    trailing = separator if draw(st.booleans()) and layout in ("trc", "tsv") else ""
    names = [f"M{k}" for k in range(count)]
    triples = [cell for name in names for cell in (name, "", "")]
    cells = [
        [absent if gone[t, k] else form.format(v).replace(".", point) for k in range(count) for v in values[t, k]]
        for t in range(frames)
    ]
    quote = '"' if point == separator else ""
    before = [[str(t + 1), quote + f"{t / 100:.3f}".replace(".", point) + quote] for t in range(frames)]
    if layout == "trc":
        head = [["PathFileType", "4"], ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units"]]
        head += [["100", "100", str(frames), str(count), unit], ["Frame#", "Time", *triples]]
        head += [["", "", *(f"{axis}{k + 1}" for k in range(count) for axis in "XYZ")], []]
    elif layout == "tsv":
        head = [["NO_OF_FRAMES", str(frames)], ["FREQUENCY", "100"], ["MARKER_NAMES", *names]]
        before = before if draw(st.booleans()) else [[]] * frames
    elif layout == "nexus":
        head = [["Trajectories"], ["100"], ["", "", *triples], ["Frame", "Sub Frame", *["X", "Y", "Z"] * count]]
        head.append(["", "", *[unit] * (3 * count)])
    elif layout == "motive":
        head = [["Format Version", "1.23", "Export Frame Rate", "100", "Length Units", "Millimeters"]]
        head += [["", "Type", *["Marker"] * (3 * count)], ["", "Name", *(name for name in names for _ in "XYZ")]]
        head.append(["", "", *["Position"] * (3 * count)])
        head.append(["Frame", "Time (Seconds)", *["X", "Y", "Z"] * count])
    else:
        head = [["time", *(f"{name}.{axis}" for name in names for axis in "xyz")]]
        before = [[row[1]] for row in before]
    rows = [*head, *(one + more for one, more in zip(before, cells, strict=True))]
    lines = [separator.join(row) + (trailing if k >= len(head) else "") for k, row in enumerate(rows)]
    columns = [[len(before[0]) + 3 * k + axis for axis in range(3)] for k in range(count)]
    end = draw(st.sampled_from(["\n", "\r\n"]))
    tails = ["", end, *([f"{end}{end}Events{end}"] if layout == "nexus" else [])]
    ending = layout if layout in ("trc", "tsv") else "csv"
    mark = draw(st.sampled_from(["", "\ufeff"]))
    return Written(ending, lines, end, draw(st.sampled_from(tails)), mark, columns, gone)


def split_at(delimiter: str, line: str) -> list[str]:
    """A line's cells with their quotes."""
    return re.findall(rf'(?:^|{delimiter})("[^"]*"|[^{delimiter}]*)', line)


@given(file=written(), data=st.data())
def test_every_byte_outside_filled_cells_stays(
    tmp_path_factory: pytest.TempPathFactory, file: Written, data: st.DataObject
) -> None:
    path, gone = tmp_path_factory.getbasetemp() / f"drawn.{file.ending}", file.gone
    out = path.with_stem("out")
    path.write_bytes(file.text.encode())
    raw = read_raw(path)
    np.testing.assert_array_equal(np.isnan(raw.position).all(axis=-1), gone)
    filled = gone & data.draw(arrays(bool, gone.shape))
    assert raw.cells is not None
    write_filled(path, out, raw, np.where(filled[..., None], 1234.5, raw.position), filled)
    changed = out.read_bytes().decode()
    assert changed.startswith(file.mark) and changed.endswith(file.tail)
    after = changed[len(file.mark) : len(changed) - len(file.tail)].split(file.end)
    first = len(file.lines) - len(gone)
    assert len(after) == len(file.lines) and after[:first] == file.lines[:first]
    for t in range(len(gone)):
        old, new = (split_at(raw.cells.delimiter, rows[first + t]) for rows in (file.lines, after))
        assert len(old) == len(new)
        allowed = {column for k in np.flatnonzero(filled[t]).tolist() for column in file.columns[k]}
        assert {column for column in range(len(old)) if old[column] != new[column]} == allowed
        assert all(
            float(new[column].strip('"').replace(",", ".")) == pytest.approx(1234.5, abs=0.5) for column in allowed
        )
    np.testing.assert_array_equal(read_raw(out).position[~filled], raw.position[~filled])


def test_blank_cells_are_filled_and_decimal_commas_quoted(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text('time,a.x,a.y,a.z\n0,"1,5","2,5","3,5"\n1,  ,"",nan\n')
    raw = read_raw(tmp_path / "a.csv")
    filled = np.isnan(raw.position[..., 0])
    write_filled(tmp_path / "a.csv", tmp_path / "b.csv", raw, np.full((2, 1, 3), 4.0), filled)
    assert (tmp_path / "b.csv").read_text().splitlines()[1:] == ['0,"1,5","2,5","3,5"', '1,"4,0","4,0","4,0"']


def test_filled_gaps_are_near_the_truth_and_without_steps(
    tmp_path: Path, truth: dict[str, np.ndarray], with_gaps: dict[str, np.ndarray]
) -> None:
    hole = with_gaps["ball"].copy()
    hole[50:60] = np.nan
    (tmp_path / "a.trc").write_bytes(trc(with_gaps | {"ball": hole}))
    take = track(tmp_path / "a.trc")
    take.save(tmp_path / "out.trc")
    rows = [line.split("\t") for line in (tmp_path / "out.trc").read_text().splitlines()[6:]]
    names = list(with_gaps)
    for name, (first, end) in GAPS.items():
        k = 2 + 3 * names.index(name)
        found = np.array([[float(cell) for cell in row[k : k + 3]] for row in rows])
        off = np.linalg.norm(found - truth[name], axis=-1)
        assert off[first:end].mean() < 20 and off[first:end].max() < 40, name  # mm
        assert (np.delete(off, range(first, end)) < 1e-3).all()
        steps = np.linalg.norm(np.diff(found, axis=0), axis=-1)
        real = np.linalg.norm(np.diff(truth[name], axis=0), axis=-1)
        edges = [edge - 1 for edge in (first, end) if 0 < edge < 90]
        assert all(steps[edge] < real[edge] + 6 for edge in edges), name
    k = 2 + 3 * names.index("ball")
    assert all(cell == "" for row in rows[50:60] for cell in row[k : k + 3])  # it is not worn


def test_gaps_that_remain_are_a_warning(
    tmp_path: Path, with_gaps: dict[str, np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    hole = with_gaps["ball"].copy()
    hole[50:60] = np.nan
    (tmp_path / "a.trc").write_bytes(trc(with_gaps | {"ball": hole}))
    paths = [str(tmp_path / name) for name in ("a.trc", "out.trc", "out.json")]
    main(["track", paths[0], "-o", paths[1], "--json", paths[2], "--quiet"])
    values, stderr = json.loads((tmp_path / "out.json").read_text()), capsys.readouterr().err
    assert f"WARNING: {values['warnings'][-1]}" in stderr and stderr.rstrip().endswith("'ball'")
    assert values["filled_frames"] == {name: end - first for name, (first, end) in GAPS.items()}


def c3d_of(path: Path, markers: dict[str, np.ndarray]) -> None:
    position = np.stack(list(markers.values()), axis=1)[:, :, [1, 2, 0]] / 1000
    write_c3d(path, points_alone(tuple(markers), position, np.arange(90) / RATE), RATE)


def test_a_filled_c3d_file_keeps_its_other_data(
    tmp_path: Path, truth: dict[str, np.ndarray], with_gaps: dict[str, np.ndarray]
) -> None:
    c3d_of(tmp_path / "a.c3d", with_gaps)
    track(tmp_path / "a.c3d").save(tmp_path / "out.c3d")
    old, new = ((tmp_path / name).read_bytes() for name in ("a.c3d", "out.c3d"))
    before, after = (ezc3d.c3d(str(tmp_path / name)) for name in ("a.c3d", "out.c3d"))
    names = before["parameters"]["POINT"]["LABELS"]["value"]
    assert names == after["parameters"]["POINT"]["LABELS"]["value"] == list(with_gaps)
    places = after["data"]["points"]  # (4, M, T)
    touched = np.zeros(places.shape[1:], dtype=bool)
    for name, (first, end) in GAPS.items():
        k = names.index(name)
        touched[k, first:end] = True
        off = np.linalg.norm(places[:3, k].T - truth[name][:, [1, 2, 0]], axis=-1)
        assert off[first:end].mean() < 20, name
    assert (after["data"]["meta_points"]["residuals"][0][touched] == 0).all()
    np.testing.assert_array_equal(before["data"]["points"][:3, ~touched], places[:3, ~touched])
    assert len(old) == len(new)
    start, count = len(old) - -(-90 * 16 * len(names) // 512) * 512, 16 * len(names)
    assert old[:start] == new[:start]
    numbers = [np.frombuffer(data[start : start + 90 * count], "u1").reshape(90, len(names), 16) for data in (old, new)]
    assert ((numbers[0] != numbers[1]).any(axis=-1) <= touched.T).all()


@pytest.mark.parametrize(("processor", "mark"), [(84, "<"), (86, ">"), (85, "<")])
def test_numbers_of_every_processor_are_read_and_written(tmp_path: Path, processor: int, mark: str) -> None:
    """Whole numbers of Intel's and MIPS's, reals of DEC's."""
    real = processor == 85
    head = struct.pack(f"{mark}BBHHHHHfHHf", 2, 0x50, 1, 0, 1, 2, 0, 0.5, 3, 0, 50.0)
    if real:
        as_dec = lambda value: np.array([value * 4], "<f4").view("<u2").reshape(-1, 2)[:, ::-1].tobytes()  # noqa: E731
        head = struct.pack("<BBHHHHH", 2, 0x50, 1, 0, 1, 2, 0) + as_dec(-0.5) + struct.pack("<HH", 3, 0) + as_dec(50.0)
        body = b"".join(as_dec(value) for value in (10, -20, 30, 0, 1, 2, 3, -1))
    else:
        body = struct.pack(f"{mark}8h", 10, -20, 30, 0, 1, 2, 3, -1)
    parameters = bytes([1, 0x50, 1, processor]).ljust(512, b"\0")
    (tmp_path / "a.c3d").write_bytes(head.ljust(512, b"\0") + parameters + body + b"rest")
    raw = read_raw(tmp_path / "a.c3d")
    filled = np.isnan(raw.position[..., 0])
    np.testing.assert_array_equal(raw.position[0], [[10, -20, 30] if real else [5, -10, 15]])
    assert filled.tolist() == [[False], [True]] and raw.frame_rate == 50 and raw.names == ("unlabelled 1",)
    write_filled(tmp_path / "a.c3d", tmp_path / "b.c3d", raw, np.full((2, 1, 3), [7.5, -4.0, 0.5]), filled)
    again = read_raw(tmp_path / "b.c3d")
    np.testing.assert_array_equal(again.position[0], raw.position[0])
    np.testing.assert_allclose(again.position[1, 0], [7.5, -4.0, 0.5])
    assert (tmp_path / "b.c3d").read_bytes().endswith(b"rest")


LONG = 70_000  # frames, beyond the 16 bits of the header


@pytest.mark.parametrize(
    "parameters",
    [
        {"POINT": {"LONG_FRAMES": [float(LONG)]}},
        {"POINT": {"FRAMES": [float(LONG)]}},
        {"TRIAL": {"ACTUAL_START_FIELD": [1.0, 0.0], "ACTUAL_END_FIELD": [float(LONG % 65536), 1.0]}},
        {"TRIAL": {"ACTUAL_START_FIELD": [1.0], "ACTUAL_END_FIELD": [float(LONG)]}},
    ],
)
def test_a_long_file_is_read_whole_by_any_of_its_counts(tmp_path: Path, parameters: dict) -> None:
    path = long_c3d(tmp_path / "long.c3d", parameters)
    raw = read_raw(path)
    assert len(raw.position) == LONG and not raw.warnings
    np.testing.assert_array_equal(raw.position[[0, -1], 0, 0], [0, LONG - 1])


def test_frames_that_a_file_does_not_announce_are_a_warning(tmp_path: Path) -> None:
    raw = read_raw(long_c3d(tmp_path / "long.c3d", {}))
    assert len(raw.position) == 65535
    (warning,) = raw.warnings
    announced = r"65535 frames are announced and read, but the file has data of 700\d\d; .*LONG_FRAMES"
    assert re.search(announced, warning)


def long_c3d(path: Path, parameters: dict[str, dict[str, list[float]]]) -> Path:
    """Write a point that moves by 1 mm a frame over `LONG` frames; the header announces 65535."""
    records = [struct.pack("bb", 5, -1) + b"POINT" + struct.pack("<hb", 3, 0)]
    records += [struct.pack("bb", 5, -2) + b"TRIAL" + struct.pack("<hb", 3, 0)]
    for number, group in enumerate(("POINT", "TRIAL"), start=1):
        for name, values in parameters.get(group, {}).items():
            content = struct.pack("bBB", 4, 1, len(values)) + np.array(values, "<f4").tobytes()
            records.append(struct.pack("bb", len(name), number) + name.encode())
            records[-1] += struct.pack("<h", 2 + len(content) + 1) + content + b"\0"
    body = np.zeros((LONG, 4), "<f4")
    body[:, :2] = np.arange(LONG)[:, None] + [0, 5]
    head = struct.pack("<BBHHHHHfHHf", 2, 0x50, 1, 0, 1, 65535, 0, -1.0, 3, 0, 100.0).ljust(512, b"\0")
    path.write_bytes(head + (bytes([1, 0x50, 1, 84]) + b"".join(records)).ljust(512, b"\0") + body.tobytes())
    return path


def test_unfillable_files_are_refused(tmp_path: Path, with_gaps: dict[str, np.ndarray], clip: Clip) -> None:
    (tmp_path / "a.trc").write_bytes(trc(with_gaps))
    take = track(tmp_path / "a.trc")
    with pytest.raises(BodysenseError, match=r"same kind of file as a\.trc; give a name that ends in \.trc"):
        take.save(tmp_path / "out.csv")
    with pytest.raises(BodysenseError, match="markers have no rig; leave --rig out"):
        take.save(tmp_path / "out.trc", "mixamo")
    with pytest.raises(BodysenseError, match="only a file of labelled markers comes back as markers"):
        track(clip).save(tmp_path / "out.trc")
    assert not (tmp_path / "out.csv").exists() and not (tmp_path / "out.trc").exists()


def test_bytes_of_a_latin_label_stay(tmp_path: Path) -> None:
    path, out = tmp_path / "a.trc", tmp_path / "b.trc"
    path.write_bytes(
        trc({"Stérn": np.ones((3, 3)), "C7": np.array([[1.0, 2, 3], [np.nan] * 3, [1, 2, 3]])})
        .decode()
        .encode("latin-1")
    )
    raw = read_raw(path)
    filled = np.isnan(raw.position[..., 0])
    write_filled(path, out, raw, np.full(raw.position.shape, 5.0), filled)
    before, after = path.read_bytes().splitlines(), out.read_bytes().splitlines()
    assert [a == b for a, b in zip(before, after, strict=True)] == [True] * 7 + [False, True]
    assert after[7].endswith(b"\t5.000\t5.000\t5.000")
