"""Blender's side of the test of the add-on: run by Blender, writes what it found as JSON."""

# ruff: noqa: SIM115
# pyright: reportMissingImports=false

import json
import socket
import sys
import time
import types
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import bpy

folder, take, packets, out = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.preferences.addon_enable(module="io_anim_bvh")
if hasattr(bpy.ops, "extensions") and bpy.app.version >= (4, 2):  # installed from the listing, as from a repository
    bpy.context.preferences.system.use_online_access = True  # Blender asks for it before any repository
    repositories = bpy.context.preferences.extensions.repos
    listing = (Path(folder) / "index.json").as_uri()
    repository = repositories.new(name="bodysense", module="ours", remote_url=listing)
    index = list(repositories).index(repository)
    bpy.ops.extensions.repo_sync(repo_index=index)
    bpy.ops.extensions.package_install(repo_index=index, pkg_id="bodysense", enable_on_install=True)
    PACKAGE = "bl_ext.ours.bodysense"
else:  # Debian's Blender 3.4 has no extension system: the archive is unpacked, its wheels, too
    # It runs on Python 3.11, which no longer knows the mode 'rU' that its own reader of BVH asks for.
    import io_anim_bvh.import_bvh

    io_anim_bvh.import_bvh.open = lambda path, mode="r", **more: open(path, mode.replace("U", ""), **more)
    sys.path[:0] = [folder, str(Path(folder) / "wheels")]
    PACKAGE = "bodysense_addon"
    bpy.context.preferences.addons.new().module = PACKAGE
    import_module(PACKAGE).register()
addon: Any = import_module(PACKAGE)
NAMES = ("armature", "live", "operators", "osc", "process", "humanoid")
modules: tuple[Any, ...] = tuple(import_module(f"{PACKAGE}.{name}") for name in NAMES)
armature, live, operators, osc, process, humanoid = modules
UNITY, joints_of = humanoid.UNITY, humanoid.joints_of

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
    for bone in thing.pose.bones:  # Blender 5 keeps the selection with the pose
        (bone if hasattr(bone, "select") else bone.bone).select = bone.name in names


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
select(ARM)
searched, process.find_spec = process.find_spec, lambda name: None
found["refused"].append(refused(holes="SELECTED", first=41, last=81))
process.find_spec = searched
plain, process.command.__defaults__ = process.command.__defaults__, ("/no/python",)
found["refused"].append(refused(holes="SELECTED", first=41, last=81))
process.command.__defaults__ = plain


# A Blender without a window has no timer: what it would call is called here.
class Window:
    """The part of a context that operators use, with the timer and the status bar."""

    def __init__(self) -> None:
        self.object, self.scene, self.preferences = thing, bpy.context.scene, bpy.context.preferences
        self.window, self.window_manager, self.workspace, self.texts = None, self, self, []
        self.modal_handler_add = self.event_timer_remove = lambda given: None
        self.status_text_set = self.texts.append

    def event_timer_add(self, seconds: float, window: object) -> str:
        """A timer."""
        return "timer"


def ticked(operator: type, stop: Callable[[list], bool], **given: object) -> dict[str, object]:
    """Execute an operator, tick until it ends or until `stop(texts)`, then press Esc."""
    ours = [base for base in reversed(operator.__mro__) if base.__module__.startswith(PACKAGE)]
    plain = {
        name: value for base in ours for name, value in vars(base).items() if isinstance(value, types.FunctionType)
    }
    reports, window = [], Window()
    one: Any = type("Driven", (), {**plain, "report": lambda self, level, text: reports.append(text), **given})()
    assert one.execute(window) == {"RUNNING_MODAL"}, reports
    ended, longest = {"PASS_THROUGH"}, 0.0
    while ended == {"PASS_THROUGH"}:
        key = "ESC" if stop(window.texts) else "TIMER"
        begun = time.perf_counter()
        ended = one.modal(window, types.SimpleNamespace(type=key))
        longest = max(longest, time.perf_counter() - begun)
        time.sleep(0.01)
    return {"ended": list(ended), "texts": window.texts, "longest": longest, "reports": reports}


interface = types.SimpleNamespace(app=types.SimpleNamespace(background=False), types=bpy.types, data=bpy.data)
operators.bpy = live.bpy = interface
hole = {"holes": "SELECTED", "first": 41, "last": 81}
thing.animation_data.action = whole
select(ARM, FOREARM)
found["ticked"] = ticked(addon.BODYSENSE_OT_fill, lambda texts: False, **hole)
found["ticked"]["action"] = thing.animation_data.action.name
thing.animation_data.action = whole
found["cancelled"] = ticked(addon.BODYSENSE_OT_fill, lambda texts: "bodysense starts (Esc cancels)" in texts, **hole)
found["cancelled"]["same"] = thing.animation_data.action == whole

sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
    free.bind(("127.0.0.1", 0))
    port = free.getsockname()[1]
waiting = [b"no OSC", *(bytes.fromhex(packet) for packet in json.loads(Path(packets).read_text()))]
count = len(waiting) - 1


def heard(texts: list) -> bool:
    """Send the next datagram; whether all have arrived."""
    if waiting:
        sender.sendto(waiting.pop(0), ("127.0.0.1", port))
    return any(text and text.startswith(f"VMC: {count} poses recorded") for text in texts)


bpy.context.scene.frame_set(5)
receive = {"address": "127.0.0.1", "port": port, "scale": 1.0, "record": True}
found["received"] = ticked(addon.BODYSENSE_OT_receive, heard, **receive)
found["received"]["keys"] = curves()

thing.animation_data.action = None
bones = {UNITY[ours]: bone for ours, bone in joints_of([bone.name for bone in thing.pose.bones]).items()}
poses, found["live"] = osc.Poses(), []
for packet in json.loads(Path(packets).read_text()):
    for pose in poses.take(bytes.fromhex(packet)):
        live.pose_armature(thing, bones, pose, 1.0)
        bpy.context.view_layer.update()
        found["live"].append(
            {
                ours: list(thing.matrix_world @ thing.pose.bones[bones[UNITY[ours]]].head)
                for ours in ("pelvis", "head", "left_wrist", "right_ankle", "left_index3")
            }
        )
addon.unregister()
Path(out).write_text(json.dumps(found))
