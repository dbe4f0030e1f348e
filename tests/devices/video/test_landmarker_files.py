"""Model files of MediaPipe: fetched once, checked, or in a given folder."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from bodysense.devices.video import landmarker_files
from bodysense.devices.video.landmarker_files import (
    HAND_LANDMARKER,
    POSE_LANDMARKER,
    find_landmarkers,
    landmarker_folder,
)
from bodysense.errors import BodysenseError


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in place of Google's site, and an empty cache."""
    folder, official = tmp_path / "site", {}
    folder.mkdir()
    for name in (POSE_LANDMARKER, HAND_LANDMARKER):
        (folder / name).write_bytes(name.encode())
        official[name] = ((folder / name).as_uri(), hashlib.sha256(name.encode()).hexdigest())
    monkeypatch.setattr(landmarker_files, "OFFICIAL", official)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return folder


def test_files_are_fetched_once(site: Path) -> None:
    files = find_landmarkers()
    assert files.pose.read_bytes() == POSE_LANDMARKER.encode() and files.hand.parent == landmarker_folder()
    for name in (POSE_LANDMARKER, HAND_LANDMARKER):
        (site / name).unlink()
    assert find_landmarkers() == files


def test_a_file_with_another_checksum_is_not_kept(site: Path) -> None:
    (site / HAND_LANDMARKER).write_bytes(b"another")
    with pytest.raises(BodysenseError, match="came with the checksum"):
        find_landmarkers()
    assert [path.name for path in landmarker_folder().iterdir()] == [POSE_LANDMARKER]


def test_the_error_without_a_network_names_the_fix(site: Path) -> None:
    (site / POSE_LANDMARKER).unlink()
    with pytest.raises(BodysenseError, match=r"cannot be fetched .*--landmarkers"):
        find_landmarkers()


def test_files_of_a_given_folder(tmp_path: Path) -> None:
    (tmp_path / POSE_LANDMARKER).write_bytes(b"")
    with pytest.raises(BodysenseError, match=rf"there is no {HAND_LANDMARKER}"):
        find_landmarkers(tmp_path)
    (tmp_path / HAND_LANDMARKER).write_bytes(b"")
    assert find_landmarkers(tmp_path).pose == tmp_path / POSE_LANDMARKER
