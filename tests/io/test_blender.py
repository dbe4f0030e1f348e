"""Blender, an independent reader, opens our BVH and places every joint where we do."""

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
from bodysense.io.formats.bvh import write_bvh
from bodysense.io.rigged import read_rigged

IMPORT = """
import bpy, json, sys
path, out, frames = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.preferences.addon_enable(module="io_anim_bvh")
# Debian's Blender 3.4 runs on Python 3.11, which no longer knows the mode 'rU' that its own reader asks for.
import io_anim_bvh.import_bvh
io_anim_bvh.import_bvh.open = lambda path, mode="r", **more: open(path, mode.replace("U", ""), **more)
bpy.ops.import_anim.bvh(
    filepath=path, global_scale=0.01, axis_forward="-Z", axis_up="Y", use_fps_scale=False, update_scene_fps=True,
    update_scene_duration=True, rotate_mode="NATIVE",
)
armature = next(thing for thing in bpy.data.objects if thing.type == "ARMATURE")
found = {}
for frame in range(int(frames)):
    bpy.context.scene.frame_set(frame + 1)
    found[frame] = {bone.name: list(armature.matrix_world @ bone.head) for bone in armature.pose.bones}
json.dump(found, open(out + ".json", "w"))
bpy.context.view_layer.objects.active = armature
bpy.ops.export_anim.bvh(filepath=out + ".bvh", frame_start=1, frame_end=int(frames), root_transform_only=True)
"""


@pytest.mark.slow
@pytest.mark.blender
def test_blender_places_joints_where_we_do_and_what_it_writes_is_read(tmp_path: Path) -> None:
    """Its own BVH has Z up, metres, and a rest pose that stands along Z."""
    blender = shutil.which("blender")
    if blender is None:
        pytest.skip("no blender on this machine: apt-get install blender")
    clip = packaged_performance()
    clip = Clip("performance", clip.pose[:: len(clip) // 12], clip.frame_rate)
    path, out, script = tmp_path / "clip.bvh", tmp_path / "blender", tmp_path / "script.py"
    write_bvh(path, clip)
    script.write_text(IMPORT)
    command = f"{blender} --background --factory-startup --python-exit-code 3 --python {script} --".split()
    ran = subprocess.run(
        [*command, path, out, str(len(clip))], capture_output=True, text=True, timeout=240, check=False
    )
    assert ran.returncode == 0, ran.stdout[-2000:] + ran.stderr[-2000:]
    ours, _ = forward_kinematics(clip.pose)
    for frame, bones in json.loads(out.with_suffix(".json").read_text()).items():
        assert set(bones) == set(clip.pose.skeleton.joints)
        for name, place in bones.items():
            # Blender's world has Z up: (x, y, z) there is (x, z, −y) here.
            found = np.array([place[0], place[2], -place[1]])
            assert np.linalg.norm(found - ours[int(frame), clip.pose.skeleton.index(name)]) < 1e-3, (frame, name)
    rigged = read_rigged(out.with_suffix(".bvh").read_bytes(), out.with_suffix(".bvh"))
    assert (rigged.rig.up, rigged.rig.unit_name, rigged.rig.lift) == ("z", "metres", 0)
    joints = clip.pose.skeleton.indices(clip.pose.skeleton.joints)
    places = forward_kinematics(rigged.clip.pose)[0][:, joints]
    assert np.linalg.norm(places - ours[:, joints], axis=-1).max() < 1e-3
