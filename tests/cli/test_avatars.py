"""`bodysense track -o OUT.glb | OUT.vrma`."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import pytest


def header(path: Path) -> dict:
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + length])


@pytest.mark.parametrize("ending", ["GLB", "vrma"])
def test_a_completed_motion_is_an_animation(tmp_path: Path, motion: Path, run, ending: str) -> None:
    out = tmp_path / f"waves.{ending}"
    assert "20 frames" in run("track", motion, "--device", "three_point", "-o", out)
    document = header(out)
    (animation,) = document["animations"]
    assert animation["name"] == "waves"
    times = document["accessors"][animation["samplers"][0]["input"]]
    assert times["count"] == 20 and times["max"] == pytest.approx([19 / 30])
    assert ("VRMC_vrm_animation" in document.get("extensions", {})) == (ending == "vrma")


def test_samples_and_fingers_are_written_as_animations(tmp_path: Path, motion: Path, run) -> None:
    options = ("--device", "three_point", "--count", 2)
    run("papers", "sample", motion, *options, "-o", tmp_path / "body.glb")
    assert [header(tmp_path / f"body_{k}.glb")["animations"][0]["name"] for k in (1, 2)] == ["body_1", "body_2"]
    run("papers", "fingers", motion, "-o", tmp_path / "hands.vrma")
    assert len(header(tmp_path / "hands.vrma")["animations"][0]["channels"]) == 53


def test_invalid_outputs_are_refused(tmp_path: Path, motion: Path, refused) -> None:
    output = refused("track", motion, "--device", "three_point", "-o", tmp_path / "a.gltf")
    assert output.endswith(
        "a.gltf: the output ends in '.gltf'; give a name that ends in .bvh, .fbx, .glb, .vrma or .mcap"
    )
    output = refused("track", tmp_path / "film.mp4", "-o", tmp_path / "a.gltf")
    wanted = "the output ends in '.gltf'; give a name that ends in .bvh, .fbx, .glb, .vrma or .mcap"
    assert output.endswith(f"a.gltf: {wanted}")
