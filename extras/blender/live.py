"""Operator that receives VMC over UDP, poses an armature, and can record keyframes.

VMC's rotations are relative to a T-pose that faces Unity's +Z. The armature's rest pose has to be a T-pose that faces
-Y in Blender's world.
"""

import socket
import time

import bpy
from mathutils import Quaternion, Vector

from . import armature
from .fault import Fault
from .humanoid import UNITY, joints_of
from .osc import BonePose, Poses

_TICK = 1 / 60  # s
_MOST = 256  # datagrams in one tick
_LARGEST = 65_536  # bytes


def to_world(bone_pose: BonePose) -> tuple[Vector, Quaternion]:
    """Return position and rotation in Blender's world, where bodies face -Y."""
    (x, y, z), (i, j, k, w) = bone_pose.position, bone_pose.rotation
    return Vector((-x, -z, y)), Quaternion((w, i, k, -j)).normalized()


def pose_armature(
    thing: bpy.types.Object, bones: dict[str, str], pose: dict[str, BonePose], scale: float
) -> list[tuple]:
    """Pose an armature.

    Args:
        thing: the armature.
        bones: Unity's name → the armature's bone.
        pose: Unity's name, or 'Root', → the pose from VMC.
        scale: of positions, armature by sender.

    Returns the (bone, property) that were set.
    """
    axes, changed = thing.matrix_world.to_quaternion().inverted(), []
    origin, heading = to_world(pose["Root"]) if "Root" in pose else (Vector(), Quaternion())
    for name, bone_pose in pose.items():
        if name not in bones:
            continue
        bone = thing.pose.bones[bones[name]]
        position, turned = to_world(bone_pose)
        if name == "Hips":
            place = (origin + heading @ position) * scale
            armature.place(bone, thing.matrix_world.inverted() @ place)
            turned = heading @ turned
            changed.append((bone, "location"))
        changed.append((bone, armature.turn(bone, axes @ turned @ axes.inverted())))
    return changed


class BODYSENSE_OT_receive(bpy.types.Operator):
    """Pose the active armature by VMC until Esc."""

    bl_idname = "bodysense.receive"
    bl_label = "Receive live (VMC)"
    bl_options = {"UNDO"}  # noqa: RUF012 (Blender asks for a set)

    address: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Address", description="127.0.0.1 for this computer, 0.0.0.0 for the network", default="127.0.0.1"
    )
    port: bpy.props.IntProperty(name="Port", default=39539, min=1, max=65535)  # type: ignore[valid-type]
    scale: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Scale", description="Size of the armature by that of the sender's body", default=1.0, min=0.001
    )
    record: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Record", description="Key the poses from the current frame on, in a new action"
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the port."""
        return context.window_manager.invoke_props_dialog(self)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Open the port and begin."""
        try:
            self._begin(context)
        except Fault as fault:
            self.report({"ERROR"}, str(fault))
            return {"CANCELLED"}
        manager = context.window_manager
        self._timer = manager.event_timer_add(_TICK, window=context.window)
        manager.modal_handler_add(self)
        context.workspace.status_text_set(f"waiting for VMC at {self.address}:{self.port} (Esc ends)")
        return {"RUNNING_MODAL"}

    def _begin(self, context: bpy.types.Context) -> None:
        if bpy.app.background:
            raise Fault("live poses need Blender's window; start Blender without --background")
        self._thing, self._poses, self._received, self._started = armature.active_armature(context), Poses(), 0, None
        self._first = context.scene.frame_current
        found = joints_of([bone.name for bone in self._thing.pose.bones])
        self._bones = {UNITY[ours]: bone for ours, bone in found.items()}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((self.address, self.port))
        except OSError as error:
            self._socket.close()
            raise Fault(f"{self.address}:{self.port}: {error.strerror}; another program may listen there") from None
        if self.record:
            data = self._thing.animation_data or self._thing.animation_data_create()
            data.action = bpy.data.actions.new(f"{self._thing.name} live")

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Pose the armature by the newest received pose; record all at their frames."""
        if event.type == "ESC":
            return self._ended(context)
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        received = self._received_poses()
        try:
            for pose in received if self.record else received[-1:]:
                self._show(context, pose)
        except (ReferenceError, KeyError):
            self.report({"ERROR"}, "the armature was changed or removed while it received poses; start again")
            return self._ended(context)
        return {"PASS_THROUGH"}

    def _received_poses(self) -> list[dict[str, BonePose]]:
        """Return the poses received since the last tick; malformed datagrams are skipped."""
        received: list[dict[str, BonePose]] = []
        for _ in range(_MOST):
            try:
                packet = self._socket.recv(_LARGEST)
            except (BlockingIOError, ConnectionResetError):
                break
            try:
                received += self._poses.take(packet)
            except ValueError as error:
                self.report({"WARNING"}, f"a datagram was left out: {error}")
        return received

    def _show(self, context: bpy.types.Context, pose: dict[str, BonePose]) -> None:
        changed = pose_armature(self._thing, self._bones, pose, self.scale)
        self._received += 1
        if self.record:
            now = time.perf_counter()
            self._started = now if self._started is None else self._started
            rate = context.scene.render.fps / context.scene.render.fps_base
            frame = self._first + round((now - self._started) * rate)
            for bone, path in changed:
                bone.keyframe_insert(path, frame=frame, group=bone.name)
        context.workspace.status_text_set(f"VMC: {self._received} poses{' recorded' * self.record} (Esc ends)")

    def _ended(self, context: bpy.types.Context) -> set[str]:
        self._socket.close()
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)
        return {"FINISHED"}
