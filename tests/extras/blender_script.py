"""Blender's side of the test of the add-on: run by Blender, writes what it found as JSON."""

import json
import sys
from pathlib import Path

import bpy

folder, take, program, packets, out = sys.argv[sys.argv.index("--") + 1 :]
sys.path.insert(0, folder)
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.preferences.addon_enable(module="io_anim_bvh")
# Debian's Blender 3.4 runs on Python 3.11, which no longer knows the mode 'rU' that its own reader asks for.
import io_anim_bvh.import_bvh

io_anim_bvh.import_bvh.open = lambda path, mode="r", **more: open(path, mode.replace("U", ""), **more)
# It has no extension system: the package is an add-on there.
bpy.context.preferences.addons.new().module = "bodysense_addon"
import bodysense_addon

bodysense_addon.register()
bpy.context.preferences.addons["bodysense_addon"].preferences.path = program
from bodysense_addon import armature, live, osc
from bodysense_addon.humanoid import UNITY, joints_of

ARM, FOREARM, HAND = (f"mixamorig:Left{part}" for part in ("Arm", "ForeArm", "Hand"))
bpy.context.scene.render.fps = 30
bpy.ops.import_anim.bvh(
    filepath=take, global_scale=0.01, axis_forward="-Z", axis_up="Y", use_fps_scale=False, rotate_mode="QUATERNION"
)
thing = bpy.context.view_layer.objects.active = bpy.context.object
first, last = armature.action_frames(thing)


def curves() -> dict[str, list]:
    """Keys of each curve, by path and index."""
    return {
        f"{curve.data_path} {curve.array_index}": [list(point.co) for point in curve.keyframe_points]
        for curve in armature.curves(thing)
    }


def places(*names: str) -> dict[str, list]:
    """World places of the heads of bones in every frame."""
    found = {name: [] for name in names}
    for frame in range(first, last + 1):
        bpy.context.scene.frame_set(frame)
        for name in names:
            found[name].append(list(thing.matrix_world @ thing.pose.bones[name].head))
    return found


def select(*names: str) -> None:
    """Select these bones alone."""
    for bone in thing.data.bones:
        bone.select = bone.name in names


def refused(**given: object) -> str:
    """The message of an operator that is refused."""
    try:
        bpy.ops.bodysense.fill(**given)
    except RuntimeError as error:
        return str(error)
    return ""


WATCHED = ("mixamorig:Hips", "mixamorig:Head", HAND, "mixamorig:RightHand", "mixamorig:LeftFoot")
found = {"first": first, "last": last, "truth": places(*WATCHED), "keys": curves()}
whole = thing.animation_data.action

thing.animation_data.action = whole.copy()
select(ARM, FOREARM)
for bone in (ARM, FOREARM):  # the hole's own numbers must not matter
    for frame in range(41, 82):
        thing.pose.bones[bone].rotation_quaternion = (1, 0, 0, 0)
        thing.pose.bones[bone].keyframe_insert("rotation_quaternion", frame=frame)
bpy.ops.bodysense.fill(holes="SELECTED", first=41, last=81)
found["selected"] = {"keys": curves(), "places": places(*WATCHED), "action": thing.animation_data.action.name}

thing.animation_data.action = whole.copy()
for curve in armature.curves(thing):
    if f'"{ARM}"' in curve.data_path or f'"{FOREARM}"' in curve.data_path:
        for point in reversed(curve.keyframe_points):
            if 41 <= point.co[0] <= 81:
                curve.keyframe_points.remove(point)
bpy.ops.bodysense.fill(holes="UNKEYED")
found["unkeyed"] = {"keys": curves(), "places": places(*WATCHED)}

thing.animation_data.action = whole
select("mixamorig:Head", HAND, "mixamorig:RightHand")
bpy.ops.bodysense.complete(device="SELECTED")
found["completed"] = {"places": places(*WATCHED)}

thing.animation_data.action = whole
found["refused"] = [refused(holes="SELECTED", first=41, last=9999), refused(holes="UNKEYED")]
bpy.context.preferences.addons["bodysense_addon"].preferences.path = program + "x"
select(ARM)
found["refused"].append(refused(holes="SELECTED", first=41, last=81))

thing.animation_data.action = None
bones = {UNITY[ours]: bone for ours, bone in joints_of([bone.name for bone in thing.pose.bones]).items()}
poses, found["live"] = osc.Poses(), []
for packet in json.loads(Path(packets).read_text()):
    for pose in poses.take(bytes.fromhex(packet)):
        live.pose_armature(thing, bones, pose, 1.0)
        bpy.context.view_layer.update()
        found["live"].append({ours: list(thing.matrix_world @ thing.pose.bones[bones[UNITY[ours]]].head) for ours in (
            "pelvis", "head", "left_wrist", "right_ankle", "left_index3")})
bodysense_addon.unregister()
Path(out).write_text(json.dumps(found))
