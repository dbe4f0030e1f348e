"""VRM animation (.vrma, VRMC_vrm_animation 1.0): a motion that any VRM avatar can play.

A glTF file without a mesh whose nodes are VRM's humanoid bones in VRM's T-pose, standing on y = 0. Bones turn; only
the hips move. Players scale that way by the height of the hips, so that short and tall avatars take fitting steps.
Source: vrm-c/vrm-specification, `VRMC_vrm_animation-1.0` and `VRMC_vrm-1.0/tpose.md`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.gltf.humanoid import VRM_BONES, check_humanoid, t_posed
from bodysense.io.formats.gltf.writer import Arrays, animation, check_motion, skeleton_nodes, write_binary

_EXTENSION = "VRMC_vrm_animation"


def write_vrma(path: str | Path, clip: Clip) -> None:
    """Write a clip as a VRM animation of all 52 bones.

    The file appears whole or not at all. Raises BodysenseError for a clip that is not one finite motion, for a skeleton
    that is no humanoid, and for a folder that cannot be written.
    """
    check_motion(path, clip)
    check_humanoid(clip.pose.skeleton)
    if not clip.pose.skeleton.rest_offset[0, 1] > 0:
        raise BodysenseError(
            f"{path}: the rest pose has its pelvis at y = {clip.pose.skeleton.rest_offset[0, 1]:g} m; it must stand on "
            "y = 0: bring the motion to the default skeleton with `bodysense.io.rigs.canonical`"
        )
    clip, arrays = replace(clip, pose=t_posed(clip.pose)), Arrays()
    skeleton = clip.pose.skeleton
    names = tuple(VRM_BONES.get(joint, joint) for joint in skeleton.joints)
    nodes = skeleton_nodes(skeleton, names)
    bones = {VRM_BONES[joint]: {"node": place} for place, joint in enumerate(skeleton.joints) if joint in VRM_BONES}
    document = {
        "extensionsUsed": [_EXTENSION],
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "animations": [animation(clip, [bone["node"] for bone in bones.values()], arrays)],
        "extensions": {_EXTENSION: {"specVersion": "1.0", "humanoid": {"humanBones": bones}}},
    }
    write_binary(path, document, arrays)
