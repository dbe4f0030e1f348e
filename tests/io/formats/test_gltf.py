"""glTF and VRM animations: round trips, and positions in other programs' files."""

from __future__ import annotations

import base64
import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.demo import performance_of_unseen_body
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense.io.formats.gltf.motion import figure_of_gltf, read_gltf
from bodysense.io.formats.gltf.tracks import Track, sampled
from bodysense.io.motion_files import write_motion
from bodysense.io.reading_options import ReadingOptions
from bodysense.io.rigs.rig import recognise
from bodysense.sources.reading import read

MIXAMO = {
    "pelvis": "mixamorig:Hips", "spine1": "mixamorig:Spine", "spine2": "mixamorig:Spine1", "spine3": "mixamorig:Spine2",
    "neck": "mixamorig:Neck", "head": "mixamorig:Head",
} | {
    f"{side.lower()}_{ours}": f"mixamorig:{side}{theirs}"
    for side in ("Left", "Right")
    for ours, theirs in (
        ("collar", "Shoulder"), ("shoulder", "Arm"), ("elbow", "ForeArm"), ("wrist", "Hand"),
        ("hip", "UpLeg"), ("knee", "Leg"), ("ankle", "Foot"), ("foot", "ToeBase"),
    )
}  # fmt: skip


@pytest.fixture(scope="module")
def unseen_body() -> Clip:
    clip = performance_of_unseen_body()
    return replace(clip, pose=clip.pose[300:340], name="walk")


@pytest.mark.parametrize("ending", [".glb", ".vrma"])
def test_written_motions_are_read_back(tmp_path: Path, waving_clip: Clip, ending: str) -> None:
    write_motion(tmp_path / f"a{ending}", waving_clip)
    clip = read(tmp_path / f"a{ending}")
    assert isinstance(clip, Clip) and clip.frame_rate == waving_clip.frame_rate and len(clip) == len(waving_clip)
    assert clip.pose.skeleton.points == waving_clip.pose.skeleton.points
    np.testing.assert_allclose(clip.pose.skeleton.rest_offset, waving_clip.pose.skeleton.rest_offset, atol=1e-6)
    np.testing.assert_allclose(clip.pose.root_position, waving_clip.pose.root_position, atol=1e-6)
    assert geodesic_angle(clip.pose.rotation, waving_clip.pose.rotation).max() < 1e-5


@pytest.mark.parametrize("ending", [".glb", ".vrma"])
def test_bodies_of_other_proportions_keep_their_positions(tmp_path: Path, unseen_body: Clip, ending: str) -> None:
    write_motion(tmp_path / f"a{ending}", unseen_body)
    clip, remarks = read_gltf(tmp_path / f"a{ending}")
    joints = len(clip.pose.skeleton.joints)  # a VRM animation has no end sites
    kept = slice(joints if ending == ".vrma" else None)
    places = [np.asarray(forward_kinematics(one.pose)[0])[:, kept] for one in (clip, unseen_body)]
    np.testing.assert_allclose(places[0], places[1], atol=1e-6)
    assert remarks == ()


def foreign(path: Path, clip: Clip, kind: str = "LINEAR") -> None:
    """As another program writes it: Mixamo's names, every node turned at rest, centimetres under a scaled root."""
    skeleton, rng = clip.pose.skeleton, np.random.default_rng(3)
    rows = [skeleton.index(name) for name in BODY]
    place, turn = (np.asarray(part)[:, rows] for part in forward_kinematics(clip.pose))
    rest_place = (skeleton.path @ skeleton.rest_offset + skeleton.rest_offset[0])[rows]
    own = Rotation.random(len(BODY), rng=rng)  # axes of every node at rest
    above_of = {name: skeleton.points[skeleton.parents[skeleton.index(name)]] for name in BODY}
    parents = [-1 if name == "pelvis" else BODY.index(above_of[name]) for name in BODY]
    root = Rotation.from_euler("x", -90, degrees=True)
    nodes: list[dict[str, Any]] = []
    data, views, accessors, samplers, channels = bytearray(), [], [], [], []

    def add(values: np.ndarray, shape: str) -> int:
        values = np.ascontiguousarray(values, dtype="<f4")
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
        accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "count": len(values), "type": shape})
        data.extend(values.tobytes())
        return len(accessors) - 1

    times = add(clip.time, "SCALAR")
    for k, name in enumerate(BODY):
        above = root if parents[k] < 0 else own[parents[k]]
        way = rest_place[k] - (rest_place[parents[k]] if parents[k] >= 0 else 0)
        node = {"name": MIXAMO[name], "translation": (above.inv().apply(way) * 100).tolist()}
        node["rotation"] = (above.inv() * own[k]).as_quat().tolist()
        nodes.append(node)
        world = Rotation.from_quat(turn[:, k][:, [1, 2, 3, 0]]) * own[k]
        if parents[k] >= 0:
            nodes[parents[k]].setdefault("children", []).append(k)
            over = Rotation.from_quat(turn[:, parents[k]][:, [1, 2, 3, 0]]) * own[parents[k]]
        else:
            over = root
            samplers.append({"input": times, "output": add(root.inv().apply(place[:, k]) * 100, "VEC3")})
            channels.append({"sampler": len(samplers) - 1, "target": {"node": k, "path": "translation"}})
        values = (over.inv() * world).as_quat()
        if kind == "CUBICSPLINE":
            values = np.stack([np.zeros_like(values), values, np.zeros_like(values)], axis=1).reshape(-1, 4)
        samplers.append({"input": times, "output": add(values, "VEC4"), "interpolation": kind})
        channels.append({"sampler": len(samplers) - 1, "target": {"node": k, "path": "rotation"}})
    nodes.append({"name": "Armature", "children": [0], "rotation": root.as_quat().tolist(), "scale": [0.01] * 3})
    document = {
        "asset": {"version": "2.0"},
        "nodes": nodes,
        "animations": [{"samplers": samplers, "channels": channels}],
        "buffers": [{"byteLength": len(data), "uri": "data:;base64," + base64.b64encode(data).decode()}],
        "bufferViews": views,
        "accessors": accessors,
    }
    path.write_text(json.dumps(document))


@pytest.mark.parametrize("kind", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_files_of_other_programs(tmp_path: Path, unseen_body: Clip, kind: str) -> None:
    foreign(tmp_path / "a.gltf", unseen_body, kind)
    clip, remarks = read_gltf(tmp_path / "a.gltf")
    assert remarks == () and clip.frame_rate == unseen_body.frame_rate
    rows = clip.pose.skeleton.indices(BODY)
    places = [np.asarray(forward_kinematics(one.pose)[0])[:, rows] for one in (clip, unseen_body)]
    np.testing.assert_allclose(places[0], places[1], atol=1e-5)


def test_a_joint_map_is_followed(tmp_path: Path, unseen_body: Clip) -> None:
    """A spine joint omitted by the map is omitted; files that name their joints refuse a map."""
    path, table = tmp_path / "a.glb", tmp_path / "joints.json"
    foreign(path, unseen_body)
    rig = recognise(figure_of_gltf(path), ReadingOptions(up="y", floor=0.0))
    names = {given: ours for ours, given in rig.joints.items()}
    table.write_text(json.dumps(names | {MIXAMO["spine2"]: ""}))
    options = ReadingOptions(joints=table)
    clip, plain = read(path, options), read(path)
    assert isinstance(clip, Clip) and isinstance(plain, Clip)
    places = [np.asarray(forward_kinematics(one.pose)[0]) for one in (clip, plain)]
    spine = clip.pose.skeleton.index("spine2")
    others = [clip.pose.skeleton.index(name) for name in ("pelvis", "left_wrist", "right_ankle", "neck")]
    np.testing.assert_allclose(places[0][:, others], places[1][:, others], atol=5e-3)
    assert np.abs(places[0][:, spine] - places[1][:, spine]).max() > 1e-3
    table.write_text(json.dumps(names | {"tail": "head"}))
    with pytest.raises(BodysenseError, match="the file has no joint 'tail'"):
        read(path, options)
    write_motion(tmp_path / "a.vrma", unseen_body)
    with pytest.raises(BodysenseError, match="a VRM file names its joints; leave --joints out"):
        read(tmp_path / "a.vrma", options)
    with pytest.raises(BodysenseError, match=r"glTF files hold one body, .*; leave --figure out"):
        read(path, ReadingOptions(figure=2))


def test_frames_at_odd_times_are_resampled(tmp_path: Path, unseen_body: Clip) -> None:
    foreign(tmp_path / "a.gltf", unseen_body)
    document = json.loads((tmp_path / "a.gltf").read_text())
    data = bytearray(base64.b64decode(document["buffers"][0]["uri"].partition(",")[2]))
    times = np.frombuffer(bytes(data[: 4 * len(unseen_body)]), "<f4").copy()
    times[20:] += 0.5  # a gap
    data[: times.nbytes] = times.tobytes()
    document["buffers"][0]["uri"] = "data:;base64," + base64.b64encode(data).decode()
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    clip, _ = read_gltf(tmp_path / "a.gltf")
    assert len(clip) == len(unseen_body) + 15 and clip.frame_rate == 30


def changed(tmp_path: Path, clip: Clip, change: Any) -> Path:
    foreign(tmp_path / "a.gltf", clip)
    document = json.loads((tmp_path / "a.gltf").read_text())
    change(document)
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    return tmp_path / "a.gltf"


WRONG = {
    "no animation": (lambda d: d.pop("animations"), "nothing in it is animated"),
    "old": (lambda d: d["asset"].update(version="1.0"), "not glTF 2.0"),
    "no human": (lambda d: [node.pop("children", None) for node in d["nodes"]], "not a humanoid"),
    "a circle": (lambda d: d["nodes"][0]["children"].append(22), "in a circle"),
    "two parents": (lambda d: d["nodes"][22]["children"].append(5), "has two parents"),
    "an array too long": (lambda d: d["accessors"][3].update(count=10**9), "array 3 cannot be read .beyond the end"),
    "elsewhere": (lambda d: d["buffers"][0].update(uri="../secret.bin"), "needs the file '../secret.bin' next to it"),
    "scaled to nothing": (lambda d: d["nodes"][22].update(scale=[0, 0, 0]), "scaled to nothing or mirrored"),
    "mirrored": (lambda d: d["nodes"][22].update(scale=[-0.01, 0.01, 0.01]), "scaled to nothing or mirrored"),
}


@pytest.mark.parametrize("what", WRONG)
def test_errors_name_the_problem(tmp_path: Path, unseen_body: Clip, what: str) -> None:
    change, message = WRONG[what]
    path = changed(tmp_path, unseen_body, change)
    with pytest.raises(BodysenseError, match=message) as caught:
        read_gltf(path)
    assert "a.gltf" in str(caught.value) and "\n" not in str(caught.value)


def test_a_glb_with_a_wrong_length_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(struct.pack("<4sII", b"glTF", 2, 100) + struct.pack("<II", 1 << 31, 0x4E4F534A))
    with pytest.raises(BodysenseError, match="it ends within a part of 2147483648 bytes"):
        read_gltf(tmp_path / "a.glb")


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_a_spline_leaves_and_reaches_its_keys_with_their_tangents(seed: int) -> None:
    """SciPy's polynomials between two keys are the oracle; in- and out-tangent of a key differ."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.05, 0.6, 5))
    into, values, out = rng.normal(size=(3, 5, 3))
    track = Track(times, np.stack([into, values, out], axis=1).reshape(-1, 3), "CUBICSPLINE")
    for k in range(4):
        time = rng.uniform(times[k], times[k + 1], 9)
        curve = BPoly.from_derivatives(times[k : k + 2], [[values[k], out[k]], [values[k + 1], into[k + 1]]])
        np.testing.assert_allclose(sampled(track, time, False), curve(time), atol=1e-9)
