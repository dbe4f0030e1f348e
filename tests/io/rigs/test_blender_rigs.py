"""Blender, an independent reader, opens filled files and rigs by name, and places every joint where we do."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import read_bvh, write_bvh
from bodysense.io.motion_files import write_motion
from bodysense.takes.track import track

pytestmark = [pytest.mark.slow, pytest.mark.blender]
FRAMES = 10

SCRIPT = """
import bpy, json, numpy, sys
numpy.bool = bool  # Debian's Blender 3.4 asks its newer NumPy for a name that is gone
path, out, frames = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.context.scene.render.fps = 30
if path.endswith(".glb"):
    bpy.ops.preferences.addon_enable(module="io_scene_gltf2")
    bpy.ops.import_scene.gltf(filepath=path)
    first = 0
else:
    bpy.ops.preferences.addon_enable(module="io_anim_bvh")
    # Debian's Blender 3.4 runs on Python 3.11, which no longer knows the mode 'rU' that its own reader asks for.
    import io_anim_bvh.import_bvh
    io_anim_bvh.import_bvh.open = lambda path, mode="r", **more: open(path, mode.replace("U", ""), **more)
    bpy.ops.import_anim.bvh(
        filepath=path, global_scale=0.01, axis_forward="-Z", axis_up="Y", update_scene_duration=True,
        rotate_mode="NATIVE",
    )
    first = 1
armature = next(thing for thing in bpy.data.objects if thing.type == "ARMATURE")
found = {}
for frame in range(int(frames)):
    bpy.context.scene.frame_set(frame + first)
    found[frame] = {bone.name: list(armature.matrix_world @ bone.head) for bone in armature.pose.bones}
json.dump(found, open(out, "w"))
"""


def opened(path: Path, folder: Path) -> dict[str, np.ndarray]:
    """Places (T, 3) of Blender's bones in our world."""
    blender = shutil.which("blender")
    if blender is None:
        pytest.skip("no blender on this machine: apt-get install blender")
    out, script = folder / "found.json", folder / "script.py"
    script.write_text(SCRIPT)
    begin = f"{blender} --background --factory-startup --python-exit-code 3 --python {script} --".split()
    ran = subprocess.run(
        [*begin, str(path), str(out), str(FRAMES)], capture_output=True, text=True, timeout=240, check=False
    )
    assert ran.returncode == 0, ran.stdout[-2000:] + ran.stderr[-2000:]
    frames = json.loads(out.read_text()).values()
    names = next(iter(json.loads(out.read_text()).values()))
    # Blender's world has Z up: (x, y, z) there is (x, z, −y) here.
    return {name: np.array([frame[name] for frame in frames])[:, [0, 2, 1]] * [1, 1, -1] for name in names}


@pytest.fixture(scope="module")
def clip() -> Clip:
    whole = packaged_performance()
    return Clip("performance", whole.pose[: 30 * FRAMES : 30], 30.0)


def test_a_filled_file_on_its_own_rig(clip: Clip, tmp_path: Path) -> None:
    write_bvh(tmp_path / "take.bvh", clip, order="YXZ")
    track(tmp_path / "take.bvh", missing="left_shoulder+:2-6,right_knee:4-9").save(tmp_path / "filled.bvh")
    ours = read_bvh(tmp_path / "filled.bvh").pose
    position = forward_kinematics(ours)[0]
    found = opened(tmp_path / "filled.bvh", tmp_path)
    assert set(found) == set(ours.skeleton.joints)
    for name, place in found.items():
        assert np.linalg.norm(place - position[:, ours.skeleton.index(name)], axis=-1).max() < 1e-3, name


@pytest.mark.parametrize("name", ["out.bvh", "out.glb"])
def test_mixamos_names(clip: Clip, tmp_path: Path, name: str) -> None:
    write_motion(tmp_path / name, clip, "mixamo")
    found, position = opened(tmp_path / name, tmp_path), forward_kinematics(clip.pose)[0]
    for theirs, ours in (("Hips", "pelvis"), ("LeftHand", "left_wrist"), ("RightToeBase", "right_foot")):
        place = position[:, clip.pose.skeleton.index(ours)]
        assert np.linalg.norm(found[f"mixamorig:{theirs}"] - place, axis=-1).max() < 1e-3, theirs
