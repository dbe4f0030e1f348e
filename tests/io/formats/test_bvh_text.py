"""Text of a BVH file: bytes that are not replaced are unchanged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.formats.bvh_text import BvhFile, open_bvh
from bodysense.io.rigs.joint_file import euler_near

TEXT = """HIERARCHY\r
ROOT Hips\r
{\r
\tOFFSET 0 90 0\r
\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\r
\tJOINT Leg\r
\t{\r
\t\tOFFSET 0 -40 0\r
\t\tCHANNELS 3 Yrotation Xrotation Zrotation\r
\t\tJOINT Shin\r
\t\t{\r
\t\t\tOFFSET 0 -40 0\r
\t\t\tCHANNELS 1 Xrotation\r
\t\t\tEnd Site\r
\t\t\t{\r
\t\t\t\tOFFSET 0 -10 5\r
\t\t\t}\r
\t\t}\r
\t}\r
}\r
MOTION\r
Frames: 3\r
Frame Time: 0.0333333\r
0  92.000000000001 0 10 20 30  1e1 50 60\t7 \r
0 92 0 +11 21 31 nan 51 61 8\r
0.0 92 -0 12 22.50 32 42 52 -1.#IND 9"""


def opened(folder: Path, text: str = TEXT) -> BvhFile:
    path = folder / "take.bvh"
    path.write_bytes(text.encode())
    return open_bvh(path)


def test_an_unchanged_file_is_written_byte_for_byte(tmp_path: Path) -> None:
    sound = TEXT.replace("nan", "41").replace("-1.#IND", "62")
    assert opened(tmp_path, sound).text() == sound.encode()
    one_line = sound.replace("7 \r\n", "7 ")  # frames need not be lines
    assert (opened(tmp_path, one_line).values == opened(tmp_path, sound).values).all()


def test_channels_of_an_end_site_are_of_no_joint(tmp_path: Path) -> None:
    site = TEXT[TEXT.index("\t\t\tEnd Site") : TEXT.index("\t\t}\r\n\t}\r\n}")]
    first = site.replace("10 5\r\n", "10 5\r\n\t\t\t\tCHANNELS 1 Xrotation\r\n")
    text = TEXT.replace(site, "").replace("\tJOINT Leg", f"{first}\tJOINT Leg")
    for row in ("0  92.000000000001 0 10 20 30", "0 92 0 +11 21 31", "0.0 92 -0 12 22.50 32"):
        text = text.replace(row, f"{row} 99")
    found, plain = opened(tmp_path, text), opened(tmp_path)
    assert found.joints == plain.joints and found.values.shape == (3, 11)
    np.testing.assert_array_equal(found.has_number, plain.has_number)
    np.testing.assert_array_equal(found.rotation, plain.rotation)


def test_cells_without_numbers_are_mended(tmp_path: Path) -> None:
    file = opened(tmp_path)
    assert (opened(tmp_path, TEXT.replace("-1.#IND", "-nan(ind)")).has_number == file.has_number).all()
    assert file.joints == ("Hips", "Leg", "Shin") and file.parents == (-1, 0, 1) and file.order == ("ZXY", "YXZ", "X")
    np.testing.assert_array_equal(~file.has_number, [[False] * 3, [False, True, False], [False, True, False]])
    assert file.mended.values[1, 6] == pytest.approx(26) and file.mended.values[2, 8] == pytest.approx(61)
    lines = file.mended.text().splitlines(keepends=True)
    assert lines[-3] == b"0  92.000000000001 0 10 20 30  1e1 50 60\t7 \r\n"
    assert lines[-2] == b"0 92 0 +11 21 31 26.000000 51 61 8\r\n"


@given(st.integers(0, 2**20), st.sets(st.tuples(st.integers(0, 2), st.integers(0, 2)), min_size=1))
def test_only_what_changes_is_written(tmp_path_factory: pytest.TempPathFactory, seed: int, places: set) -> None:
    file = opened(tmp_path_factory.mktemp("bvh"))
    changed = np.zeros((3, 3), dtype=bool)
    changed[tuple(np.array(sorted(places)).T)] = True
    turned = np.random.default_rng(seed).normal(size=(3, 3, 4))
    turned /= np.linalg.norm(turned, axis=-1, keepdims=True)
    result = file.mended.with_rotation(dict(enumerate(turned.swapaxes(0, 1))), changed)
    for before, after, row in zip(file.mended.lines, result.lines, changed, strict=True):
        fresh = {c for joint in np.flatnonzero(row).tolist() for c in file.columns_of(joint, "rotation")}
        for column, (a, b) in enumerate(zip(before.split(), after.split(), strict=True)):
            assert a == b or column in fresh
        if not row.any():
            assert before == after
    whole = changed.copy()
    whole[:, 2] = False  # a hinge turns only as far as it can
    assert geodesic_angle(result.rotation, turned)[whole].max(initial=0) < 1e-7


@pytest.mark.parametrize("order", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
def test_angles_do_not_jump(order: str) -> None:
    """Through gimbal lock and over whole turns, beside scipy's rotations."""
    time = np.linspace(0, 4, 400)
    turned = Rotation.from_euler(order, np.stack([3 * time, 1.9 * np.sin(2 * time), -2 * time], axis=1))
    angles = euler_near(turned.as_quat(scalar_first=True), order, np.zeros(3))
    back = Rotation.from_euler(order, angles)
    assert (back * turned.inv()).magnitude().max() < 1e-6
    assert np.abs(np.diff(angles, axis=0)).max() < 0.5


def test_a_file_that_announces_one_frame_fewer_is_read_with_a_warning(tmp_path: Path) -> None:
    sound = TEXT.replace("nan", "41").replace("-1.#IND", "62")
    file = opened(tmp_path, sound.replace("Frames: 3", "Frames: 2"))
    assert len(file.values) == 3 and file.text() == sound.encode()
    assert "'Frames: 2' announces one frame fewer than there are; all 3 are read" in file.warnings
    assert opened(tmp_path, sound).warnings == ()


def test_damaged_files_are_refused_by_name(tmp_path: Path) -> None:
    sound = TEXT.replace("nan", "41").replace("-1.#IND", "62")
    for spoilt, message in (
        (sound.replace("Frames: 3", "Frames: 4"), "announces"),
        (sound.replace("21 31", "21 x31"), "not a number"),
        (sound.replace("CHANNELS 1 Xrotation", "CHANNELS 2 Xrotation Yrotation"), "'Frames: 3' announces 33 values"),
        (TEXT.replace("HIERARCHY", "HIERARCH"), "not a BVH file"),
        (TEXT.replace("CHANNELS 1 Xrotation", "CHANNELS 2 Xrotation"), "CHANNELS"),
        ("", "the file is empty"),
    ):
        with pytest.raises(BodysenseError, match=message):
            opened(tmp_path, spoilt)
    with pytest.raises(BodysenseError, match="cannot be read"):
        open_bvh(tmp_path / "none.bvh")
