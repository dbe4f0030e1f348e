"""A body as VMC (Virtual Motion Capture protocol) sends it to avatars: the bones of a humanoid (docs/avatars.md).

Source: protocol.vmc.info, *Marionette*: /VMC/Ext/OK (2.5), T, Root/Pos (2.0) and Bone/Pos, named as Unity's
`HumanBodyBones`, local to the parent, quaternions x, y, z, w. Rotations are relative to VRM's T-pose.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.rotation import normalize
from bodysense.body.skeleton import Skeleton
from bodysense.io.gltf.humanoid import VRM_BONES, check_humanoid, t_posed, unity_bone
from bodysense.serve.osc import PacketForm
from bodysense.serve.unity import one_finite_pose, unity_position, unity_rotation

PORT = 39539  # where receivers ("marionettes") listen
_SEVEN = "s" + 7 * "f"
_CALIBRATED, _NORMAL = 3, 0


def vmc_packets(pose: Pose, time: float, tracked: bool = True) -> list[bytes]:
    """One pose as packets of OSC, each a datagram; `time` is the sender's, in s.

    The root stays at the origin and the hips carry the body's place. `tracked` says whether the signals that the body
    follows are there. Raises BodysenseError for a skeleton that is no humanoid, and for a pose that is not one frame of
    finite numbers.
    """
    one_finite_pose(pose)
    joints = _joints(pose.skeleton)
    posed = t_posed(pose)
    place = posed.skeleton.rest_offset[: len(pose.skeleton.joints)].copy()
    place[0] = pose.root_position
    values = np.concatenate([unity_position(place), unity_rotation(normalize(posed.rotation))], axis=1)
    return _form(tracked).filled(np.append(time, values[joints]))


@lru_cache(maxsize=64)
def _joints(skeleton: Skeleton) -> np.ndarray:
    """The joints that are sent."""
    check_humanoid(skeleton)
    return skeleton.indices(list(VRM_BONES))


@lru_cache
def _form(tracked: bool) -> PacketForm:
    """What is sent but for the time and the bones."""
    return PacketForm(
        [
            ("/VMC/Ext/OK", "iiii", (1, _CALIBRATED, _NORMAL, int(tracked))),
            ("/VMC/Ext/T", "f", ()),
            ("/VMC/Ext/Root/Pos", _SEVEN, ("root", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)),
            *(("/VMC/Ext/Bone/Pos", _SEVEN, (unity_bone(bone),)) for bone in VRM_BONES.values()),
        ]
    )
