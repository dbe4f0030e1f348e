"""bodysense for Blender: fill holes of an armature's take, and receive live bodies."""

from __future__ import annotations

import bpy

from .live import BODYSENSE_OT_receive
from .operators import BODYSENSE_OT_complete, BODYSENSE_OT_fill

_CLASSES = (BODYSENSE_OT_fill, BODYSENSE_OT_complete, BODYSENSE_OT_receive)


def _draw(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    menu.layout.separator()
    for operator in _CLASSES:
        menu.layout.operator_context = "INVOKE_DEFAULT"
        menu.layout.operator(operator.bl_idname)


def register() -> None:
    """Add the operators to the menus Object and Pose."""
    for one in _CLASSES:
        bpy.utils.register_class(one)
    bpy.types.VIEW3D_MT_object.append(_draw)
    bpy.types.VIEW3D_MT_pose.append(_draw)


def unregister() -> None:
    """Remove them."""
    bpy.types.VIEW3D_MT_pose.remove(_draw)
    bpy.types.VIEW3D_MT_object.remove(_draw)
    for one in reversed(_CLASSES):
        bpy.utils.unregister_class(one)
