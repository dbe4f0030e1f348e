"""Operators that call bodysense: fill the holes of an armature, complete it from tracked bones."""

import time
from collections.abc import Mapping
from typing import Any

import bpy

from . import armature, job
from .fault import Fault
from .holes import missing_text, unkeyed
from .humanoid import DEVICES, device_of

_TICK = 0.05  # s between two polls of the process
_SLICE = 0.03  # s of work in one poll
_WAIT = 0.02  # s between two polls without an interface


class _Modal:
    """The common part of both operators: a timer that runs the steps of a job."""

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Begin the job; without an interface, run it to its end."""
        try:
            self._steps = self.steps(context)
            if not bpy.app.background:
                manager = context.window_manager
                self._timer = manager.event_timer_add(_TICK, window=context.window)
                manager.modal_handler_add(self)
                return {"RUNNING_MODAL"}
            for _, waits in self._steps:
                time.sleep(_WAIT if waits else 0)
        except Fault as fault:
            self.report({"ERROR"}, str(fault))
            return {"CANCELLED"}
        return {"FINISHED"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Do some steps at each tick."""
        if event.type == "ESC":
            return self._ended(context, "CANCELLED")
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        end, waits = time.perf_counter() + _SLICE, False
        try:
            while not waits and time.perf_counter() < end:
                text, waits = next(self._steps)
                context.workspace.status_text_set(text)
        except StopIteration:
            return self._ended(context, "FINISHED")
        except ReferenceError:
            self.report({"ERROR"}, "the armature was changed or removed while bodysense ran; start again")
            return self._ended(context, "CANCELLED")
        except Fault as fault:
            self.report({"ERROR"}, str(fault))
            return self._ended(context, "CANCELLED")
        return {"PASS_THROUGH"}

    def _ended(self, context: bpy.types.Context, how: str) -> set[str]:
        self._steps.close()
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)
        return {how}


class BODYSENSE_OT_fill(_Modal, bpy.types.Operator):
    """Fill the holes of the active armature's action, in a new action."""

    bl_idname = "bodysense.fill"
    bl_label = "Fill holes of this armature"
    bl_options = {"UNDO"}  # noqa: RUF012 (Blender asks for a set)

    holes: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Holes",
        items=[
            ("SELECTED", "Selected bones", "The selected pose bones, in the frames below"),
            ("UNKEYED", "Frames without keys", "Frames at which a bone that has keys has none"),
        ],
    )
    first: bpy.props.IntProperty(name="First frame", description="Of selected bones")  # type: ignore[valid-type]
    last: bpy.props.IntProperty(name="Last frame", description="Of selected bones, included")  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask which frames are missing."""
        try:
            self.first, self.last = armature.action_frames(armature.active_armature(context))
        except Fault as fault:
            self.report({"ERROR"}, str(fault))
            return {"CANCELLED"}
        return context.window_manager.invoke_props_dialog(self)

    def steps(self, context: bpy.types.Context) -> job.Steps:
        """Return the steps of the job."""
        thing = armature.active_armature(context)
        frames = armature.action_frames(thing)
        bones = [bone.name for bone in armature.tree(thing)]
        if self.holes == "UNKEYED":
            found = unkeyed(armature.keyed_frames(thing), *frames)
        else:
            if not frames[0] <= self.first <= self.last <= frames[1]:
                raise Fault(
                    f"frames {self.first}-{self.last}: the action has {frames[0]}-{frames[1]}; give a part of it"
                )
            chosen = {bone.name for bone in selected(thing)}
            found = {bone: set(range(self.first, self.last + 1)) for bone in bones if bone in chosen}
        found = {bone: found[bone] for bone in bones if bone in found}
        if not found:
            raise Fault("nothing is missing; select pose bones below the root, or choose frames without keys")

        def settings(names: Mapping[str, str]) -> dict[str, Any]:
            holes = {names[bone]: frames for bone, frames in found.items()}
            return {"missing": missing_text(holes, frames[0])}

        name = f"{thing.animation_data.action.name} filled"
        return job.steps(context.scene, thing, frames, found, settings, name)


class BODYSENSE_OT_complete(_Modal, bpy.types.Operator):
    """Complete the active armature from the bones that are tracked, in a new action."""

    bl_idname = "bodysense.complete"
    bl_label = "Complete from tracked bones"
    bl_options = {"UNDO"}  # noqa: RUF012 (Blender asks for a set)

    device: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Tracked",
        items=[
            ("SELECTED", "Selected bones", "The selected pose bones"),
            *((device, device, ", ".join(joints)) for device, joints in DEVICES.items()),
        ],
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the device."""
        return context.window_manager.invoke_props_dialog(self)

    def steps(self, context: bpy.types.Context) -> job.Steps:
        """Return the steps of the job."""
        thing = armature.active_armature(context)
        frames = armature.action_frames(thing)
        bones = [bone.name for bone in armature.tree(thing)]
        device = self.device
        if device == "SELECTED":
            device = device_of([bone.name for bone in selected(thing)], bones)
        every = set(range(frames[0], frames[1] + 1))

        name = f"{thing.animation_data.action.name} completed"
        return job.steps(
            context.scene, thing, frames, dict.fromkeys(bones, every), lambda names: {"device": device}, name
        )


def selected(thing: bpy.types.Object) -> list[bpy.types.PoseBone]:
    """Return the selected pose bones; Blender 5 keeps the selection with the pose, older ones with the bone."""
    return [bone for bone in thing.pose.bones if (bone.select if hasattr(bone, "select") else bone.bone.select)]
