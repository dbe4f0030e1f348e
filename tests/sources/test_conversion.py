"""Conversion of a motion to other joint names, files and rates."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bodysense
from bodysense.body.pose import forward_kinematics
from bodysense.devices.simulated.device import simulate
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense.io.target_rigs.named import MIXAMO, RIGIFY, UNREAL
from bodysense.sources.open import Source


@pytest.fixture
def take(tmp_path: Path, waving_clip: Clip) -> Path:
    write_bvh(tmp_path / "take.bvh", waving_clip)
    return tmp_path / "take.bvh"


def places(clip: Clip) -> np.ndarray:
    return np.asarray(forward_kinematics(clip.pose)[0])


def names_in(path: Path) -> set[str]:
    """Names of joints, by a reader that knows nothing of ours."""
    if path.suffix == ".glb":
        data = path.read_bytes()
        length = struct.unpack("<I", data[12:16])[0]
        return {node["name"] for node in json.loads(data[20 : 20 + length])["nodes"]}
    words = path.read_text().split()
    return {words[k + 1] for k, word in enumerate(words) if word in ("ROOT", "JOINT")}


@pytest.mark.parametrize("ending", [".bvh", ".glb"])
@pytest.mark.parametrize(("rig", "names"), [("mixamo", MIXAMO), ("unreal", UNREAL), ("rigify", RIGIFY)])
def test_the_motion_is_the_same_under_other_names(
    take: Path, tmp_path: Path, waving_clip: Clip, ending: str, rig: str, names: dict[str, str]
) -> None:
    out = tmp_path / f"out{ending}"
    bodysense.convert(take, out, rig=rig)
    assert {names[joint] for joint in waving_clip.pose.skeleton.joints} <= names_in(out)
    back = bodysense.read(out)
    assert isinstance(back, Clip) and back.frame_rate == pytest.approx(30)
    np.testing.assert_allclose(places(back), places(waving_clip), atol=1e-3)


def test_another_rate_keeps_the_time(take: Path, tmp_path: Path, waving_clip: Clip) -> None:
    done = bodysense.convert(take, tmp_path / "out.glb", rate=60)
    assert done.frame_rate == 60 and len(done) == 2 * len(waving_clip) - 1
    back = bodysense.read(tmp_path / "out.glb")
    assert isinstance(back, Clip) and back.frame_rate == pytest.approx(60)
    np.testing.assert_allclose(places(back)[::2], places(waving_clip), atol=1e-3)


def test_the_rig_of_the_file_is_kept(tmp_path: Path, take: Path, waving_clip: Clip) -> None:
    bodysense.convert(take, tmp_path / "mixamo.bvh", rig="mixamo")
    bodysense.convert(tmp_path / "mixamo.bvh", tmp_path / "slow.bvh", rig="source", rate=15)
    assert names_in(tmp_path / "slow.bvh") == names_in(tmp_path / "mixamo.bvh")
    back = bodysense.read(tmp_path / "slow.bvh")
    assert isinstance(back, Clip)
    np.testing.assert_allclose(places(back), places(waving_clip)[::2], atol=1e-3)


def test_invalid_conversions_are_refused(tmp_path: Path, take: Path, waving_clip: Clip) -> None:
    out = tmp_path / "out.bvh"
    seen = simulate(waving_clip, "three_point", None)
    cases: tuple[tuple[Source, dict[str, Any], str], ...] = (
        (replace(waving_clip, lacks=("legs",)), {}, "the body has no legs; complete it: bodysense track"),
        (seen, {}, "observation: not a motion, and conversion tracks nothing; complete it: bodysense track"),
        (take, {"rate": 0.0}, "frame rate 0 Hz cannot be"),
        (take, {"rig": "maya"}, "unknown rig 'maya'; valid are bodysense"),
        (waving_clip, {"rig": "source"}, r"only a \.bvh or \.fbx file has a rig of its own"),
    )
    for given, options, message in cases:
        with pytest.raises(BodysenseError, match=message):
            bodysense.convert(given, out, **options)
    with pytest.raises(BodysenseError, match=r"give a name that ends in \.bvh, \.fbx, \.glb"):
        bodysense.convert(take, tmp_path / "out.dae")
    assert not out.exists()
