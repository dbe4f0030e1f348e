"""VMC and VRChat: packets, read by python-osc, reconstruct the posed body."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pythonosc.osc_packet import OscPacket
from scipy.spatial.transform import Rotation

from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.gltf.humanoid import VRM_BONES, unity_bone
from bodysense.io.formats.osc import DATAGRAM
from bodysense_live.protocols.virtual_trackers import TURNED_BY
from bodysense_live.protocols.vmc import vmc_packets
from bodysense_live.protocols.vrchat import PARTS, parts_of, vrchat_packets

MIRROR = np.diag([-1.0, 1.0, 1.0])
# Unity's documentation, HumanBodyBones, without eyes and jaw.
FINGERS = [
    f"{f}{p}" for f in ("Thumb", "Index", "Middle", "Ring", "Little") for p in ("Proximal", "Intermediate", "Distal")
]
SIDED = ["UpperLeg", "LowerLeg", "Foot", "Toes", "Shoulder", "UpperArm", "LowerArm", "Hand", *FINGERS]
HUMAN_BODY_BONES = {"Hips", "Spine", "Chest", "UpperChest", "Neck", "Head"} | {
    s + b for s in ("Left", "Right") for b in SIDED
}


def read(packets: list[bytes]) -> list[tuple[str, list[Any]]]:
    return [(one.message.address, one.message.params) for packet in packets for one in OscPacket(packet).messages]


def posed(clip: Clip, frame: int) -> Pose:
    """Return a pose with a small random rotation of every joint and a random position."""
    random = np.random.default_rng(frame)
    turn = Rotation.from_rotvec(random.normal(scale=0.3, size=(len(clip.pose.skeleton.joints), 3)))
    whole = turn * Rotation.from_quat(np.asarray(clip.pose.rotation[frame])[:, [1, 2, 3, 0]])
    return Pose(clip.pose.skeleton, random.normal((0.0, 1.0, 0.0)), whole.as_quat()[:, [3, 0, 1, 2]])


@pytest.mark.parametrize("frame", [0, 30, 89])
def test_a_receiver_reconstructs_every_joint(waving_clip: Clip, frame: int) -> None:
    """Forward kinematics of the bones in Unity's world, mirrored, gives the positions of our joints."""
    pose = posed(waving_clip, frame)
    skeleton, (position, _) = pose.skeleton, forward_kinematics(pose)
    bones = {params[0]: params[1:] for address, params in read(vmc_packets(pose, 1.0)) if address.endswith("Bone/Pos")}
    place, turn = {}, {}
    for joint, name in enumerate(skeleton.joints):
        bone = bones[unity_bone(VRM_BONES[name])]
        local, offset = Rotation.from_quat(bone[3:]), np.array(bone[:3])
        above = skeleton.parents[joint]
        turn[joint] = turn[above] * local if joint else local
        place[joint] = place[above] + turn[above].apply(offset) if joint else offset
        np.testing.assert_allclose(MIRROR @ place[joint], position[joint], atol=2e-6, err_msg=name)


def test_all_of_unitys_bones_are_sent_by_their_names_and_then_ok_and_time(waving_clip: Clip) -> None:
    packets = vmc_packets(posed(waving_clip, 5), 12.5, tracked=False)
    assert len(packets) == 1 and round(len(packets[0]) / 1000, 1) == 4.4  # kB, as docs/avatars.md says
    messages = read(packets)
    assert messages[0] == ("/VMC/Ext/Root/Pos", ["root", 0, 0, 0, 0, 0, 0, 1])
    assert messages[-2:] == [("/VMC/Ext/OK", [1, 3, 0, 0]), ("/VMC/Ext/T", [12.5])]
    assert [address for address, _ in messages[1:-2]] == ["/VMC/Ext/Bone/Pos"] * 52
    names = [params[0] for _, params in messages[1:-2]]
    assert len(set(names)) == 52 and set(names) == HUMAN_BODY_BONES
    lengths = [np.linalg.norm(params[4:]) for _, params in messages[1:-2]]
    np.testing.assert_allclose(lengths, 1, atol=1e-6)


def test_the_t_pose_has_identity_rotations_except_for_thumbs() -> None:
    """Our rest pose equals VRM's T-pose except for thumbs, which are 40 to 60 degrees lower."""
    bones = {p[0]: p for address, p in read(vmc_packets(rest_pose(default_skeleton()), 0.0)) if "Bone" in address}
    for name, values in bones.items():
        angle = np.rad2deg(Rotation.from_quat(values[4:]).magnitude())
        assert (angle < 1e-4) == ("Thumb" not in name), name
    assert 40 < np.rad2deg(Rotation.from_quat(bones["LeftThumbProximal"][4:]).magnitude()) < 60


@pytest.mark.parametrize("frame", [0, 44])
def test_vrchats_trackers_are_joints_in_unitys_world(waving_clip: Clip, frame: int) -> None:
    pose = posed(waving_clip, frame)
    position, rotation = forward_kinematics(pose)
    packets = vrchat_packets(pose, parts=PARTS)
    assert len(packets) == 1 and len(packets[0]) <= DATAGRAM
    found = dict(read(packets))
    assert set(found) == {
        f"/tracking/trackers/{k}/{w}" for k in (*range(1, 9), "head") for w in ("position", "rotation")
    }
    trackers = {number: point for named in PARTS.values() for number, point in named.items()} | {"head": "head"}
    for name, place in trackers.items():
        turn = TURNED_BY.get(place, place)
        there = np.array(found[f"/tracking/trackers/{name}/position"])
        np.testing.assert_allclose(MIRROR @ there, position[pose.skeleton.index(place)], atol=1e-6)
        x, y, z = found[f"/tracking/trackers/{name}/rotation"]
        turned = Rotation.from_euler("zxy", [z, x, y], degrees=True).as_matrix()
        wanted = Rotation.from_quat(rotation[pose.skeleton.index(turn)][[1, 2, 3, 0]]).as_matrix()
        np.testing.assert_allclose(MIRROR @ turned @ MIRROR, wanted, atol=1e-6)


def test_vrchat_is_sent_hip_and_feet_unless_more_parts_are_chosen(waving_clip: Clip) -> None:
    """VRChat's documentation advises against always sending all eight."""

    def numbers(*parts: str) -> set[str]:
        packets = vrchat_packets(posed(waving_clip, 5), parts=parts) if parts else vrchat_packets(posed(waving_clip, 5))
        return {address.split("/")[3] for address, _ in read(packets)}

    assert numbers() == {"1", "2", "3", "head"}
    assert numbers(*parts_of("knees, chest")) == {"4", "5", "6", "head"}
    with pytest.raises(BodysenseError, match="'hips' is not a tracker of VRChat; give a list of hip, feet, knees"):
        parts_of("hips,feet")


def test_only_finite_poses_of_humanoids_are_sent(waving_clip: Clip) -> None:
    pose = waving_clip.pose
    broken = Pose(pose.skeleton, np.array([0.0, np.nan, 0.0]), pose.rotation[0])
    stump = Skeleton(("pelvis", "head"), (), (-1, 0), np.array([[0.0, 1, 0], [0, 0.6, 0]]))
    for send in (lambda pose: vmc_packets(pose, 0.0), vrchat_packets):
        with pytest.raises(BodysenseError, match=r"one finite pose at a time, rotations \(J, 4\); got \(90, 52, 4\)"):
            send(pose)
        with pytest.raises(BodysenseError, match="one finite pose"):
            send(broken)
        with pytest.raises(BodysenseError, match=r"lacks; bring the motion|unknown joint"):
            send(rest_pose(stump))
