"""Files dropped on the page: what is taken, and what is refused before it costs anything."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytestmark = pytest.mark.slow

Scenario = Callable[..., dict[str, Any]]
SOON = 10  # s, on a busy machine


def performance() -> dict[str, np.ndarray]:
    packed = files("bodysense.demo").joinpath("performance.npz").read_bytes()
    return dict(np.load(io.BytesIO(packed)))


def fortran(path: Path) -> None:
    """Write a motion as AMASS does: in Fortran order, with arrays that the page ignores."""
    motion = performance()
    np.savez_compressed(
        path,
        poses=np.asfortranarray(motion["poses"]),
        trans=motion["trans"],
        mocap_framerate=motion["mocap_framerate"],
        marker_labels=np.array([b"LFHD   ", b"RFHD"]),
        marker_data=np.zeros((3, 2), np.float16),
        labels_obs=np.array([["a", None]], dtype=object),
    )


def texts(path: Path) -> None:
    """Half a megabyte that unpacks to half a gigabyte of text."""
    np.savez_compressed(path, format=np.array(["x" * 20_000_000] * 6), points=np.array(["head"]), time=np.arange(3.0))


def zeros(path: Path) -> None:
    """A quarter of a megabyte that unpacks to a quarter of a gigabyte of poses."""
    poses, trans = np.zeros((400_000, 156), np.float32), np.zeros((400_000, 3), np.float32)
    np.savez_compressed(path, poses=poses, trans=trans, mocap_framerate=np.array(60.0))


def line(path: Path) -> None:
    """A recording whose second line is 3 MB long."""
    path.write_text(json.dumps({"format": "bodysense recording 1"}) + "\n[" + "[" * 3_000_000)


@pytest.fixture(scope="module")
def made(scenario: Scenario, site: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("files")
    written = {"texts.npz": texts, "zeros.npz": zeros, "line.jsonl": line, "fortran.npz": fortran}
    for name, write in written.items():
        write(folder / name)
    return scenario("alone/files", site, folder, *(folder / name for name in written))["made"]


def test_motion_of_amass_in_fortrans_order_with_more_arrays_is_taken(made: dict[str, Any]) -> None:
    assert made["fortran.npz"]["notice"] is None
    assert made["fortran.npz"]["source"] == "fortran.npz"
    assert "from the truth" in made["fortran.npz"]["summary"]


def test_an_avatar_compressed_with_draco_is_displayed(made: dict[str, Any]) -> None:
    assert made["packed.vrm"]["avatar"] == "packed.vrm" and made["packed.vrm"]["notice"] is None


@pytest.mark.parametrize("name", ["texts.npz", "zeros.npz", "line.jsonl"])
def test_small_files_that_unpack_to_much_are_refused_at_once(made: dict[str, Any], name: str) -> None:
    assert made[name]["notice"].startswith(f"{name} cannot be used: its ")
    assert made[name]["seconds"] < SOON
