"""Armatures: poses to rows of BVH, and rows to keyframes of a new action.

A row has rotations about the armature's axes, relative to the rest pose. Each bone's own rotation is that turned into
the axes of the bone at rest.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence

import bpy
from mathutils import Euler, Quaternion, Vector

from .bvh import Joint, safe_names
from .fault import Fault

_ROTATIONS = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}
_BONE = re.compile(r'pose\.bones\["(.*)"\]\.(\w+)')


def active_armature(context: bpy.types.Context) -> bpy.types.Object:
    """Return the active armature."""
    thing = context.object
    if thing is None or thing.type != "ARMATURE":
        raise Fault("the active object is not an armature; click the armature first")
    return thing


def action_frames(thing: bpy.types.Object) -> tuple[int, int]:
    """Return the first and last frame of the armature's action."""
    action = thing.animation_data.action if thing.animation_data else None
    if action is None:
        raise Fault(f"{thing.name} has no action; give it one in the Action Editor")
    first, last = action.frame_range
    return math.floor(first), math.ceil(last)


def curves(thing: bpy.types.Object) -> Sequence[bpy.types.FCurve]:
    """Return the curves of the armature's action, in old Blenders and in those whose actions have slots."""
    data = thing.animation_data
    if hasattr(data.action, "fcurves"):
        return data.action.fcurves
    bags = [strip.channelbag(data.action_slot) for layer in data.action.layers for strip in layer.strips]
    return [curve for bag in bags if bag for curve in bag.fcurves]


def keyed_frames(thing: bpy.types.Object) -> dict[str, set[int]]:
    """Return the frames at which the rotation of each bone has a key."""
    keys: dict[str, set[int]] = {}
    for curve in curves(thing):
        found = _BONE.fullmatch(curve.data_path)
        if found and found[2].startswith("rotation"):
            keys.setdefault(found[1], set()).update(round(point.co[0]) for point in curve.keyframe_points)
    return keys


def tree(thing: bpy.types.Object) -> list[bpy.types.PoseBone]:
    """Return the bones below the root that has most of them, the root first, each before its children."""
    trees = [_below(bone) for bone in thing.pose.bones if bone.parent is None]
    if not trees:
        raise Fault(f"{thing.name} has no bones")
    return max(trees, key=len)


def _below(bone: bpy.types.PoseBone) -> list[bpy.types.PoseBone]:
    return [bone, *(one for child in bone.children for one in _below(child))]


def joints(bones: Sequence[bpy.types.PoseBone]) -> list[Joint]:
    """Return the bones at rest."""
    names, index = safe_names([bone.name for bone in bones]), {bone.name: k for k, bone in enumerate(bones)}
    found = []
    for k, one in enumerate(bones):
        rest, parent = one.bone, one.parent.bone.head_local if k else Vector()
        found.append(
            Joint(
                names[k],
                index[one.parent.name] if k else -1,
                tuple(rest.head_local - parent),
                tuple(rest.tail_local - rest.head_local),
            )
        )
    return found


def row(bones: Sequence[bpy.types.PoseBone]) -> list[float]:
    """Return the pose of the current frame: the root's place, and three angles (degrees) of each bone."""
    numbers = list(bones[0].matrix.translation)
    for k, bone in enumerate(bones):
        turned = bone.matrix.to_quaternion() @ _rest(bone).inverted()
        if k:
            turned = _rest(bone.parent) @ bone.parent.matrix.to_quaternion().inverted() @ turned
        angles = turned.to_euler("YXZ")  # Blender turns about the first letter first: Z · X · Y
        numbers += [math.degrees(angles[axis]) for axis in (2, 0, 1)]
    return numbers


def rotation(numbers: Sequence[float], bone: int) -> Quaternion:
    """Return the rotation of a bone of a row."""
    z, x, y = (math.radians(number) for number in numbers[3 + 3 * bone : 6 + 3 * bone])
    return Euler((x, y, z), "YXZ").to_quaternion()


def place(bone: bpy.types.PoseBone, position: Vector) -> None:
    """Put a root at a position in the armature's axes."""
    bone.location = _rest(bone).inverted() @ (position - bone.bone.head_local)


def turn(bone: bpy.types.PoseBone, turned: Quaternion) -> str:
    """Give a bone a rotation about the armature's axes relative to rest; return the property that was set."""
    own = _rest(bone).inverted() @ turned @ _rest(bone)
    if bone.rotation_mode == "QUATERNION":
        own.make_compatible(bone.rotation_quaternion)
        bone.rotation_quaternion = own
    elif bone.rotation_mode == "AXIS_ANGLE":
        axis, angle = own.to_axis_angle()
        bone.rotation_axis_angle = (angle, *axis)
    else:
        bone.rotation_euler = own.to_euler(bone.rotation_mode, bone.rotation_euler)
    return _ROTATIONS.get(bone.rotation_mode, "rotation_euler")


def _rest(bone: bpy.types.PoseBone) -> Quaternion:
    return bone.bone.matrix_local.to_quaternion()


def copy_action(thing: bpy.types.Object, name: str) -> None:
    """Give the armature a copy of its action, with a new name; the old one stays in the file."""
    data = thing.animation_data
    slot, old = getattr(data, "action_slot", None), data.action
    old.use_fake_user = True
    data.action = old.copy()
    data.action.name = name
    if slot is not None:
        data.action_slot = data.action.slots[slot.identifier]


def keyed(
    thing: bpy.types.Object,
    bones: Sequence[bpy.types.PoseBone],
    rows: Sequence[Sequence[float]],
    first: int,
    holes: Mapping[str, set[int]],
) -> Iterator[int]:
    """Key the holes, bone after bone, and yield how many bones are done.

    Args:
        thing: the armature, whose action is changed.
        bones: those of the rows.
        rows: the pose of each frame from `first`.
        first: the frame of the first row.
        holes: bone → frames. No key of another frame is changed.
    """
    _drop_between(thing, holes)
    for k, bone in enumerate(bones):
        for frame in sorted(holes.get(bone.name, ())):
            numbers = rows[frame - first]
            path = turn(bone, rotation(numbers, k))
            bone.keyframe_insert(path, frame=frame, group=bone.name)
            if not k:
                place(bone, Vector(numbers[:3]))
                bone.keyframe_insert("location", frame=frame, group=bone.name)
        yield k + 1


def _drop_between(thing: bpy.types.Object, holes: Mapping[str, set[int]]) -> None:
    """Remove keys between whole frames inside holes: they would stay among the new ones."""
    for curve in curves(thing):
        found = _BONE.fullmatch(curve.data_path)
        frames = holes.get(found[1], ()) if found and found[2].startswith(("rotation", "location")) else ()
        points = curve.keyframe_points
        for k in range(len(points) - 1, -1, -1):
            at = points[k].co[0]
            if at != round(at) and math.floor(at) in frames and math.ceil(at) in frames:
                points.remove(points[k])
