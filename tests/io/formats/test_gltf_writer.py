"""Written glTF and VRM animations, read by an independent reader: every joint keeps its position."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.body.surface import fit_surface
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.gltf.vrma import write_vrma
from bodysense.io.formats.gltf.writer import write_glb
from bodysense.io.motion_files import ENDINGS, check_ending, write_motion

TYPES = {5126: "<f4", 5121: "u1", 5123: "<u2"}
WIDTH = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@dataclass
class File:
    """A .glb file, read."""

    document: dict[str, Any]
    binary: bytes

    def array(self, accessor: int) -> np.ndarray:
        about = self.document["accessors"][accessor]
        view = self.document["bufferViews"][about["bufferView"]]
        width = WIDTH[about["type"]]
        assert view["byteOffset"] % 4 == 0
        values = np.frombuffer(self.binary, TYPES[about["componentType"]], about["count"] * width, view["byteOffset"])
        assert values.nbytes == view["byteLength"]
        return values.reshape(about["count"], width)

    def places(self, time: float) -> dict[str, np.ndarray]:
        """World matrices (4, 4) of all nodes at a time, by scipy."""
        nodes, (motion,) = self.document["nodes"], self.document["animations"]
        local = {k: (Rotation.identity(), node.get("translation", [0, 0, 0])) for k, node in enumerate(nodes)}
        for channel in motion["channels"]:
            sampler, target = motion["samplers"][channel["sampler"]], channel["target"]
            times, values = self.array(sampler["input"])[:, 0], self.array(sampler["output"])
            turn, place = local[target["node"]]
            if target["path"] == "rotation":
                turn = (
                    Slerp(times, Rotation.from_quat(values))(time) if len(times) > 1 else Rotation.from_quat(values[0])
                )
            else:
                place = [np.interp(time, times, column) for column in values.T]
            local[target["node"]] = (turn, place)
        found: dict[str, np.ndarray] = {}

        def walk(node: int, above: np.ndarray) -> None:
            matrix = np.eye(4)
            matrix[:3, :3], matrix[:3, 3] = local[node][0].as_matrix(), local[node][1]
            found[nodes[node]["name"]] = above @ matrix
            for child in nodes[node].get("children", []):
                walk(child, above @ matrix)

        for root in self.document["scenes"][0]["nodes"]:
            walk(root, np.eye(4))
        return found


def read(path: Path) -> File:
    data = path.read_bytes()
    magic, version, size = struct.unpack_from("<4sII", data)
    assert (magic, version, size) == (b"glTF", 2, len(data))
    length, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON" and length % 4 == 0
    document = json.loads(data[20 : 20 + length])
    rest, kind = struct.unpack_from("<I4s", data, 20 + length)
    assert kind == b"BIN\0" and document["buffers"] == [{"byteLength": rest}] and 28 + length + rest == size
    return File(document, data[28 + length :])


@pytest.fixture(scope="module")
def roaming(waving_clip: Clip) -> Clip:
    """The waving clip with every joint turned, far from the origin, some quaternions with the other sign."""
    random = np.random.default_rng(4)
    frames, joints = waving_clip.pose.rotation.shape[:2]
    sway = np.sin(np.arange(frames)[:, None, None] / 30 + random.uniform(0, 6, (1, joints, 3)))
    turn = Rotation.from_rotvec((0.5 * sway).reshape(-1, 3)) * Rotation.from_quat(
        waving_clip.pose.rotation[..., [1, 2, 3, 0]].reshape(-1, 4)
    )
    rotation = turn.as_quat()[:, [3, 0, 1, 2]].reshape(frames, joints, 4)
    rotation *= random.choice([-1.0, 1.0], (frames, joints, 1))
    return replace(
        waving_clip,
        pose=Pose(waving_clip.pose.skeleton, waving_clip.pose.root_position + np.array([2, 0.1, -3]), rotation),
    )


def check_places(file: File, clip: Clip, names: dict[str, str]) -> None:
    ours, _ = forward_kinematics(clip.pose)
    for frame in (0, 17, len(clip) - 1):
        found = file.places(clip.time[frame])
        for joint, name in names.items():
            place = ours[frame, clip.pose.skeleton.index(joint)]
            np.testing.assert_allclose(found[name][:3, 3], place, atol=3e-6, err_msg=f"{name}, frame {frame}")


@pytest.mark.parametrize("height", [1.7, 1.4])
def test_a_glb_file_keeps_every_point(roaming: Clip, tmp_path: Path, height: float) -> None:
    skeleton = roaming.pose.skeleton.scaled(height)
    clip = replace(roaming, pose=Pose(skeleton, roaming.pose.root_position, roaming.pose.rotation))
    write_glb(tmp_path / "a.glb", clip)
    file = read(tmp_path / "a.glb")
    check_places(file, clip, {name: name for name in skeleton.points})
    (motion,) = file.document["animations"]
    assert motion["name"] == "waving" and len(motion["channels"]) == 53
    for sampler in motion["samplers"][1:]:  # also players that know no shorter arc take it
        values = file.array(sampler["output"])
        assert ((values[1:] * values[:-1]).sum(axis=1) > 0).all()


def test_the_surface_moves_with_its_joints(roaming: Clip, tmp_path: Path) -> None:
    """Skinned by the format's rule, each vertex is where the drawn surface has it."""
    write_glb(tmp_path / "a.glb", roaming)
    file, frame = read(tmp_path / "a.glb"), 40
    (primitive,) = file.document["meshes"][0]["primitives"]
    position, joint, weight = (file.array(primitive["attributes"][k]) for k in ("POSITION", "JOINTS_0", "WEIGHTS_0"))
    np.testing.assert_array_equal(weight.sum(axis=1), 255)
    skin = file.document["skins"][0]
    bind = file.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
    found = file.places(roaming.time[frame])
    world = np.array([found[file.document["nodes"][node]["name"]] for node in skin["joints"]])
    matrix = np.einsum("vk,vkij->vij", weight / 255, (world @ bind)[joint])
    skinned = np.einsum("vij,vj->vi", matrix, np.c_[position, np.ones(len(position))])[:, :3]
    (drawn,) = fit_surface(roaming.pose.skeleton).placed(roaming.pose[frame : frame + 1])
    np.testing.assert_allclose(skinned, drawn.position, atol=2e-5)


def test_a_vrm_animation_has_vrms_bones_in_its_t_pose(roaming: Clip, tmp_path: Path) -> None:
    write_vrma(tmp_path / "a.vrma", roaming)
    file = read(tmp_path / "a.vrma")
    assert file.document["extensionsUsed"] == ["VRMC_vrm_animation"]
    about, nodes = file.document["extensions"]["VRMC_vrm_animation"], file.document["nodes"]
    assert about["specVersion"] == "1.0"
    bones = {bone: nodes[row["node"]]["name"] for bone, row in about["humanoid"]["humanBones"].items()}
    assert len(bones) == 52 and all(bone == name for bone, name in bones.items())
    assert not any("rotation" in node or "scale" in node for node in nodes)
    assert nodes[0]["translation"] == pytest.approx(default_skeleton().rest_offset[0])
    channels = file.document["animations"][0]["channels"]
    moving = [
        nodes[channel["target"]["node"]]["name"] for channel in channels if channel["target"]["path"] != "rotation"
    ]
    assert moving == ["hips"]
    from bodysense.io.formats.gltf.humanoid import VRM_BONES

    check_places(file, roaming, VRM_BONES)


def test_one_frame_is_a_motion(waving_clip: Clip, tmp_path: Path) -> None:
    clip = replace(waving_clip, pose=waving_clip.pose[3:4])
    for ending in ENDINGS:
        write_motion(tmp_path / f"one{ending}", clip)
    check_places(read(tmp_path / "one.glb"), replace(clip, pose=clip.pose[[0] * 18]), {"head": "head"})


def test_invalid_motions_are_refused_and_leave_no_file(waving_clip: Clip, tmp_path: Path) -> None:
    pose = waving_clip.pose
    with_gaps = replace(waving_clip, pose=Pose(pose.skeleton, np.full((90, 3), np.nan), pose.rotation))
    stump = Skeleton(("pelvis", "head"), (), (-1, 0), np.array([[0.0, 1, 0], [0, 0.6, 0]]))
    other = Clip("other", Pose(stump, pose.root_position, pose.rotation[:, :2]), 30.0)
    floating = pose.skeleton.with_offsets(np.r_[[[0.0, 0.0, 0.0]], pose.skeleton.rest_offset[1:]])
    for ending in (".glb", ".vrma"):
        path = tmp_path / f"a{ending}"
        with pytest.raises(BodysenseError, match=r"one motion of finite numbers .* got \(90, 52, 4\), not all finite"):
            write_motion(path, with_gaps)
        with pytest.raises(BodysenseError, match=r"got \(52, 4\)"):
            write_motion(path, replace(waving_clip, pose=pose[0]))
        with pytest.raises(BodysenseError, match="at 0 Hz"):
            write_motion(path, replace(waving_clip, frame_rate=0.0))
        with pytest.raises(BodysenseError):
            write_motion(path, other)
    with pytest.raises(BodysenseError, match="pelvis at y = 0 m; it must stand on y = 0"):
        write_vrma(tmp_path / "a.vrma", replace(waving_clip, pose=Pose(floating, pose.root_position, pose.rotation)))
    with pytest.raises(BodysenseError, match=r"ends in '.dae'; give a name that ends in .bvh, .fbx, .glb, .vrma or"):
        check_ending(tmp_path / "a.dae")
    with pytest.raises(BodysenseError, match="does not exist; create it"):
        check_ending(tmp_path / "nowhere" / "a.glb")
    assert not list(tmp_path.iterdir())
