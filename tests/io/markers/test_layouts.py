"""Marker files of each program, written by hand after its public description, and damaged ones: one line each."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import ezc3d
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bodysense.errors import BodysenseError
from bodysense.io.markers.files import read_raw
from bodysense.io.markers.formats.c3d import read_c3d, write_c3d
from bodysense.io.markers.raw_markers import points_alone
from bodysense.io.markers.recording import read_markers

NAMES = ("LASI", "RASI", "C7")
PLACE = np.round(np.random.default_rng(0).uniform(100, 900, (4, 3, 3)), 3)
PLACE[1, 2] = np.nan
RATE = 120.0


def cells(row: np.ndarray, missing: str = "") -> list[str]:
    return [missing if np.isnan(value) else f"{value:.3f}" for value in row.ravel()]


def trc(missing: str = "", blank: bool = True) -> str:
    lines = ["PathFileType\t4\t(X/Y/Z)\twalk.trc"]
    lines.append("DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames")
    lines.append("120.0\t120.0\t4\t3\tmm\t120.0\t1\t4")
    lines.append("Frame#\tTime\t" + "\t\t\t".join(NAMES) + "\t\t")
    lines.append("\t\t" + "\t".join(f"{axis}{k}" for k in (1, 2, 3) for axis in "XYZ"))
    lines += [""] * blank
    lines += ["\t".join([str(t + 1), f"{t / RATE:.5f}", *cells(row, missing)]) for t, row in enumerate(PLACE)]
    return "\n".join(lines) + "\n"


def workstation() -> str:
    """A file of Vicon's older programs, which has no sub-frames and no units."""
    lines = ["TRAJECTORIES", "120,Hz", "," + ",,,".join(f"Anna:{name}" for name in NAMES) + ",,"]
    lines.append("Field #," + ",".join(["X", "Y", "Z"] * 3))
    return "\n".join([*lines, *(",".join([str(t + 1), *cells(row)]) for t, row in enumerate(PLACE))]) + "\n"


def tsv(columns: bool = False, front: bool = False, missing: str = "0.000") -> str:
    lines = ["NO_OF_FRAMES\t4", "NO_OF_CAMERAS\t8", "NO_OF_MARKERS\t3", "FREQUENCY\t120", "NO_OF_ANALOG\t0"]
    lines += ["ANALOG_FREQUENCY\t0", "DESCRIPTION\t--", "TIME_STAMP\t2022-06-03, 10:47:36.627\t94247.454"]
    lines += [
        "DATA_INCLUDED\t3D",
        "MARKER_NAMES\t" + "\t".join(NAMES),
        "TRAJECTORY_TYPES\tMeasured\tMeasured\tMeasured",
    ]
    if columns:
        named = ["Frame", "Time"] * front + [f"{name} {axis}" for name in NAMES for axis in "XYZ"]
        lines.append("\t".join(named))
    for t, row in enumerate(PLACE):
        lines.append("\t".join([str(t + 1), f"{t / RATE:.5f}"] * front + cells(row, missing)))
    return "\n".join(lines) + "\n"


def bodies() -> str:
    lines = ["NO_OF_FRAMES\t4", "NO_OF_CAMERAS\t8", "NO_OF_BODIES\t3", "FREQUENCY\t120", "DATA_INCLUDED\t6D"]
    lines += ["BODY_NAMES\t" + "\t".join(NAMES)]
    for row in PLACE:
        more = [f"{k}.5" for k in range(13)]
        lines.append("\t".join(cell for place in row for cell in [*cells(place, "0.000"), *more]))
    return "\n".join(lines) + "\n"


def nexus(delimiter: str = ",") -> str:
    lines = ["Trajectories", "120"]
    lines.append(delimiter.join(["", "", *(cell for name in NAMES for cell in (f"Anna:{name}", "", ""))]))
    lines.append(delimiter.join(["Frame", "Sub Frame", *["X", "Y", "Z"] * 3]))
    lines.append(delimiter.join(["", "", *["mm"] * 9]))
    lines += [delimiter.join([str(t + 1), "0", *cells(row)]) for t, row in enumerate(PLACE)]
    return "\n".join([*lines, "", "Events", "120", "Subject,Context,Name"]) + "\n"


def motive(parents: bool = False, kind: str = "Marker") -> str:
    lines = [
        "Format Version,1.23,Take Name,Walk,Capture Frame Rate,120.000000,Export Frame Rate,120.000000,"
        "Total Frames in Take,4,Rotation Type,Quaternion,Length Units,Millimeters,Coordinate Space,Global",
        "",
    ]
    turned, name = ["Rigid Body"] * 8, ["Plate"] * 8
    lines.append(",".join(["", "Type", *turned, *[kind] * 9]))
    lines.append(",".join(["", "Name", *name, *(f"Anna:{name}" for name in NAMES for _ in range(3))]))
    lines.append(",".join(["", "ID", *["1"] * 8, *["2"] * 9]))
    if parents:
        lines.append(",".join(["", "Parent", *["0"] * 8, *["0"] * 9]))
    lines.append(",".join(["", "", *["Rotation"] * 4, *["Position"] * 3, "Mean Marker Error", *["Position"] * 9]))
    lines.append(",".join(["Frame", "Time (Seconds)", "X", "Y", "Z", "W", "X", "Y", "Z", "", *["X", "Y", "Z"] * 3]))
    for t, row in enumerate(PLACE):
        plate = ["0.5", "0.5", "0.5", "0.5", "1", "2", str(t + 3), "0.01"]
        lines.append(",".join([str(t), f"{t / RATE:.6f}", *plate, *cells(row)]))
    return "\n".join(lines) + "\n"


def by_halves(frames: str, header: str) -> str:
    """A TRC file whose header has another separator than its frames."""
    head, rows = trc().split("\n\n")
    return head.replace("\t", header) + "\n\n" + rows.replace("\t", frames)


LAYOUTS: dict[str, tuple[str, Callable[[], str]]] = {
    "TRC": ("a.trc", trc),
    "TRC, no blank line, nan": ("a.trc", lambda: trc("nan", blank=False)),
    "TRC of commas": ("a.trc", lambda: trc().replace("\t", ",")),
    "TRC of semicolons and decimal commas": (
        "a.trc",
        lambda: re.sub(r"(\d)\.(\d)", r"\1,\2", trc()).replace("\t", ";"),
    ),
    "TRC with a header of commas": ("a.trc", lambda: by_halves("\t", ",")),
    "TRC with frames of commas": ("a.trc", lambda: by_halves(",", "\t")),
    "TRC of quoted cells": ("a.trc", lambda: re.sub(r"[^,\n]+", r'"\g<0>"', trc().replace("\t", ","))),
    "TRC with names in neighbouring cells": ("a.trc", lambda: re.sub(r"(LASI|RASI|C7)\t+", r"\1\t", trc())),
    "TRC in capitals, with brackets": (
        "a.trc",
        lambda: (
            trc().replace("DataRate", " DATARATE ").replace("\tmm", "\t (mm) ").replace("120.0\t120.0", "120 Hz\t?")
        ),
    ),
    "TRC with places for what is not seen": ("a.trc", lambda: trc("9999999.0")),
    "TRC with N/A": ("a.trc", lambda: trc("#N/A")),
    "TRC without X1 Y1 Z1": ("a.trc", lambda: re.sub(r"\t\tX1.*\n", "", trc())),
    "TRC with decimal commas": ("a.trc", lambda: re.sub(r"(\d)\.(\d)", r"\1,\2", trc())),
    "TRC without its first line": ("a.trc", lambda: trc().split("\n", 1)[1]),
    "TRC that counts wrongly": ("a.trc", lambda: trc().replace("\t3\tmm", "\t7\tmm")),
    "TRC without counts": ("a.trc", lambda: trc().replace("NumFrames\tNumMarkers", "A\tB")),
    "TRC with tabs at line ends": ("a.trc", lambda: trc().replace("\n", "\t\n")),
    "Vicon Workstation": ("a.csv", workstation),
    "Vicon Workstation of a spreadsheet": (
        "a.csv",
        lambda: workstation().replace("TRAJECTORIES", "TRAJECTORIES,,,,").replace("\n", "\r\n"),
    ),
    "Vicon Workstation with semicolons": ("a.csv", lambda: workstation().replace(",", ";")),
    "Nexus after its devices": ("a.csv", lambda: "Devices\n1000\n,,\nFrame,Sub Frame,A\n,,V\n1,0,3\n\n" + nexus()),
    "TSV": ("a.tsv", tsv),
    "TSV with columns": ("a.tsv", lambda: tsv(columns=True)),
    "TSV with frame and time": ("a.tsv", lambda: tsv(columns=True, front=True, missing="")),
    "TSV with frame and time unnamed": ("a.tsv", lambda: tsv(front=True)),
    "TSV of bodies": ("a.tsv", bodies),
    "Nexus": ("a.csv", nexus),
    "Nexus with semicolons": ("a.csv", lambda: nexus(";")),
    "Motive": ("a.csv", motive),
    "Motive 3": ("a.csv", lambda: motive(parents=True)),
    "Motive, marked as of a body": ("a.csv", lambda: motive(kind="Rigid Body Marker")),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_layout_is_read(tmp_path: Path, layout: str) -> None:
    name, write = LAYOUTS[layout]
    (tmp_path / name).write_text(write(), encoding="utf-8")
    raw = read_raw(tmp_path / name)
    tails = [label.rpartition(":")[2] for label in raw.names]
    assert [label for label in tails if label != "Plate"] == list(NAMES)
    np.testing.assert_array_equal(raw.position[:, [tails.index(label) for label in NAMES]], PLACE)
    assert raw.frame_rate == RATE and raw.unit == "mm"
    np.testing.assert_allclose(raw.time, np.arange(4) / RATE)
    if "Plate" in tails:
        assert raw.rotation is not None
        np.testing.assert_array_equal(raw.rotation[:, tails.index("Plate")], np.full((4, 4), 0.5))


def test_bones_of_motive_are_joints(tmp_path: Path) -> None:
    """A T-pose that faces +Z: positions and rotations of bones become those of joints."""
    from bodysense.body.skeleton import default_skeleton

    skeleton = default_skeleton()
    place = skeleton.path @ skeleton.rest_offset + skeleton.rest_offset[0]
    bones = {"Hip": "pelvis", "Chest": "spine3", "Neck": "neck", "Head": "head"}
    for side, hand in (("L", "left"), ("R", "right")):
        bones |= {f"{side}UArm": f"{hand}_shoulder", f"{side}FArm": f"{hand}_elbow", f"{side}Hand": f"{hand}_wrist"}
        bones |= {f"{side}Thigh": f"{hand}_hip", f"{side}Shin": f"{hand}_knee", f"{side}Foot": f"{hand}_ankle"}
    top = ["Bone"] * (7 * len(bones)), [f"Anna:{bone}" for bone in bones for _ in range(7)]
    lines = ["Format Version,1.23,Export Frame Rate,60,Rotation Type,Quaternion,Length Units,Meters"]
    lines += [",".join(["", "Type", *top[0]]), ",".join(["", "Name", *top[1]]), ",".join(["", "ID", *top[0]])]
    lines.append(",".join(["", "", *(["Rotation"] * 4 + ["Position"] * 3) * len(bones)]))
    lines.append(",".join(["Frame", "Time (Seconds)", *["X", "Y", "Z", "W", "X", "Y", "Z"] * len(bones)]))
    row = [cell for joint in bones.values() for cell in ("0", "0", "0", "1", *map(str, place[skeleton.index(joint)]))]
    lines += [",".join([str(t), f"{t / 60:.6f}", *row]) for t in range(3)]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    found = read_markers(tmp_path / "a.csv")
    seen = found.observation
    assert "bones of Motive: 16 markers" in found.remarks[0] and found.has_body
    has_position = seen.has_position[0]
    assert {name for k, name in enumerate(seen.points) if has_position[k]} == {*bones.values()} - {"spine3"}
    np.testing.assert_allclose(
        seen.position[0, has_position], place[skeleton.indices(seen.points)][has_position], atol=1e-9
    )
    turned = {name for k, name in enumerate(seen.points) if seen.has_rotation[0, k]}
    assert turned == {"pelvis", "spine3", "head", "left_wrist", "right_wrist", "left_ankle", "right_ankle"}
    np.testing.assert_allclose(seen.rotation[seen.has_rotation], np.tile([1.0, 0, 0, 0], (21, 1)), atol=1e-9)


def test_c3d_files_match_ezc3d(tmp_path: Path) -> None:
    observation = points_alone(NAMES, PLACE / 1000, np.arange(4) / RATE)
    write_c3d(tmp_path / "ours.c3d", observation, RATE)
    theirs = ezc3d.c3d(str(tmp_path / "ours.c3d"))
    np.testing.assert_allclose(theirs["data"]["points"][:3].transpose(2, 1, 0), PLACE, rtol=1e-6)
    assert theirs["parameters"]["POINT"]["LABELS"]["value"] == list(NAMES)
    assert theirs["parameters"]["POINT"]["UNITS"]["value"] == ["mm"]
    assert theirs["header"]["points"]["frame_rate"] == RATE
    theirs["data"]["meta_points"]["residuals"][0, 1, 2] = -1.0
    theirs.add_parameter("POINT", "ANGLES", ["C7"])
    theirs["parameters"]["POINT"]["LABELS"]["value"] = ["LASI", "RASI", "C7"]
    theirs["data"]["analogs"] = np.zeros((1, 0, 4))
    theirs.write(str(tmp_path / "theirs.c3d"))
    raw = read_c3d(tmp_path / "theirs.c3d")
    assert raw.names == ("LASI", "RASI")  # what a model computed is no marker
    assert np.isnan(raw.position[2, 1]).all()
    np.testing.assert_allclose(raw.position[[0, 1, 3], :2], PLACE[[0, 1, 3], :2], rtol=1e-6)


WRONG = {
    "TRC cut short": ("a.trc", lambda: "\n".join(trc().splitlines()[:-1]), "NumFrames is 4, but there are 3; was the"),
    "TRC of other markers": (
        "a.trc",
        lambda: trc().replace("\t3\tmm", "\t7\tmm").replace("\tC7", "\t"),
        "NumMarkers is 7, but line 4 names 2, and a frame has 3",
    ),
    "TRC in cubits": ("a.trc", lambda: trc().replace("\tmm", "\tcubit"), "its unit is 'cubit'; m, cm, mm, in, ft are"),
    "TRC with blanks": ("a.trc", lambda: trc().replace("\t", " "), "the cells of line 2 are separated by blanks"),
    "TRC without rate": ("a.trc", lambda: trc().replace("120.0\t120.0\t4", "?\t120.0\t4"), "DataRate is '?'.*--rate"),
    "TRC with a word": ("a.trc", lambda: trc().replace("0.00833", "abc"), "line 8, column 2: 'abc' is not a number"),
    "no TRC": ("a.trc", lambda: "hello", "not a TRC file"),
    "TSV cut short": ("a.tsv", lambda: tsv().replace("FRAMES\t4", "FRAMES\t9"), "NO_OF_FRAMES is 9, but there are 4"),
    "no TSV": ("a.tsv", lambda: "a\tb\n1\t2\n", "not a TSV file of Qualisys.* export it from QTM with its header"),
    "Nexus without trajectories": ("a.csv", lambda: "Devices\n1000\n", "no section 'Trajectories'"),
    "Motive without columns": ("a.csv", lambda: motive().split("Frame,Time")[0], "no line 'Frame, Time"),
    "UTF-16": ("a.csv", lambda: "\ufeff" + motive(), "UTF-16; save it as UTF-8: iconv"),
}


@pytest.mark.parametrize("what", WRONG)
def test_errors_name_the_problem(tmp_path: Path, what: str) -> None:
    name, write, message = WRONG[what]
    (tmp_path / name).write_text(write(), encoding="utf-16-le" if what == "UTF-16" else "utf-8")
    with pytest.raises(BodysenseError, match=message) as caught:
        read_raw(tmp_path / name)
    assert name in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("written", ["cubit", ""])
def test_a_given_unit_overrides_the_header(tmp_path: Path, written: str) -> None:
    (tmp_path / "a.trc").write_text(trc().replace("\tmm", f"\t{written}"))
    assert read_raw(tmp_path / "a.trc", unit="cm").unit == "cm"
    (tmp_path / "a.csv").write_text(motive().replace("Millimeters", written))
    assert read_raw(tmp_path / "a.csv", unit="cm").unit == "cm"


def test_inches_and_feet_are_read(tmp_path: Path) -> None:
    for written, unit in (("inches", "in"), ("ft", "ft")):
        (tmp_path / "a.trc").write_text(trc().replace("\tmm", f"\t{written}"))
        assert read_raw(tmp_path / "a.trc").unit == unit


def test_labels_may_be_latin(tmp_path: Path) -> None:
    (tmp_path / "a.trc").write_bytes(trc().replace("LASI", "Stérn").encode("latin-1"))
    assert read_raw(tmp_path / "a.trc").names[0] == "Stérn"


def test_jumping_times_are_reported(tmp_path: Path) -> None:
    (tmp_path / "a.trc").write_text(trc().replace("0.02500", "1.02500"))
    assert "the times jump by 1.01 s at line 10" in read_raw(tmp_path / "a.trc").remarks[0]
    (tmp_path / "a.trc").write_text(trc())
    assert read_raw(tmp_path / "a.trc").remarks == ()


def test_zeros_in_csv_are_gaps_unless_marked_valid(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time,a.x,a.y,a.z,b.x,b.y,b.z,b.isValid\n0,0,0,0,0,0,0,1\n0.1,0,0,1,0,0,0,0\n")
    position = read_raw(tmp_path / "a.csv").position
    np.testing.assert_array_equal(np.isfinite(position).all(axis=-1), [[False, True], [True, False]])


def test_gzip_is_named(tmp_path: Path) -> None:
    import gzip

    (tmp_path / "a.trc").write_bytes(gzip.compress(trc().encode()))
    with pytest.raises(BodysenseError, match=r"a\.trc: compressed by gzip; unpack it: gunzip"):
        read_raw(tmp_path / "a.trc")


TEXTS = [(name, write().encode()) for name, write in LAYOUTS.values()]
TIMED = list(LAYOUTS).index("TSV with frame and time")


@example(which=TIMED, changes=[(1931, 10)], cut=None)
@example(which=TIMED, changes=[(1913, 10)], cut=None)
@given(
    which=st.integers(0, len(TEXTS)),
    changes=st.lists(st.tuples(st.integers(0, 4000), st.integers(0, 255)), max_size=6),
    cut=st.one_of(st.none(), st.integers(0, 4000)),
)
def test_damaged_files_are_read_or_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, which: int, changes: list[tuple[int, int]], cut: int | None
) -> None:
    folder = tmp_path_factory.getbasetemp()
    if which == len(TEXTS):
        name = "damaged.c3d"
        write_c3d(folder / name, points_alone(NAMES, PLACE / 1000, np.arange(4) / RATE), RATE)
        data = bytearray((folder / name).read_bytes())
    else:
        name, text = f"damaged{Path(TEXTS[which][0]).suffix}", TEXTS[which][1]
        data = bytearray(text)
    for place, value in changes:
        data[place % len(data)] = value
    (folder / name).write_bytes(data[:cut])
    try:
        raw = read_raw(folder / name)
    except BodysenseError as error:
        assert name in str(error) and "\n" not in str(error)
    else:
        assert raw.position.shape == (len(raw.time), len(raw.names), 3)
