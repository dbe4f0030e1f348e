"""Written FBX files: skeletons, curves, rigs by name, and takes whose holes are filled in the file's own rig."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_fbx import made_body

import bodysense as bs
from bodysense.body.pose import forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense.io.formats.fbx.motion import parse_fbx
from bodysense.io.motion_files import write_motion
from bodysense.io.target_rigs.named import RIGS

IMPORT = """
import bpy, json, sys
path, out = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.fbx(filepath=path)
armature = next(thing for thing in bpy.data.objects if thing.type == "ARMATURE")
bones = armature.pose.bones
first, last = (int(frame) for frame in armature.animation_data.action.frame_range)
places, turns = [], []
for frame in range(first, last + 1):
    bpy.context.scene.frame_set(frame)
    world = [armature.matrix_world @ bone.matrix for bone in bones]
    rest = [armature.matrix_world @ bone.bone.matrix_local for bone in bones]
    places.append([list(matrix.translation) for matrix in world])
    turns.append([list(a.to_quaternion() @ b.to_quaternion().inverted()) for a, b in zip(world, rest)])
json.dump({"names": [bone.name for bone in bones], "places": places, "turns": turns,
           "rate": bpy.context.scene.render.fps / bpy.context.scene.render.fps_base}, open(out, "w"))
"""
EXPORT = """
import bpy, sys
path, folder = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.fbx(filepath=path)
armature = next(thing for thing in bpy.data.objects if thing.type == "ARMATURE")
bpy.context.scene.frame_end = int(armature.animation_data.action.frame_range[1])
corners, faces = [], []
for bone in armature.data.bones:  # a skin, which brings the bind pose
    x, y, z = bone.head_local
    faces.append(tuple(range(len(corners), len(corners) + 3)))
    corners += [(x + 1, y, z), (x, y + 1, z), (x, y, z + 1)]
mesh = bpy.data.meshes.new("skin")
mesh.from_pydata(corners, [], faces)
skin = bpy.data.objects.new("skin", mesh)
bpy.context.collection.objects.link(skin)
skin.parent = armature
for k, bone in enumerate(armature.data.bones):
    skin.vertex_groups.new(name=bone.name).add(faces[k], 1.0, "REPLACE")
skin.modifiers.new("armature", "ARMATURE").object = armature
for name, options in {
    "default": {},
    "unreal": dict(axis_forward="-Y", axis_up="Z", primary_bone_axis="X", secondary_bone_axis="-Y"),
    "z_up": dict(axis_forward="Y", axis_up="Z"),
    "x_up": dict(axis_forward="Y", axis_up="X"),
    "metres": dict(apply_scale_options="FBX_SCALE_ALL"),
    "units": dict(apply_scale_options="FBX_SCALE_UNITS"),
    "unscaled": dict(apply_unit_scale=False, armature_nodetype="ROOT"),
}.items():
    bpy.ops.export_scene.fbx(
        filepath=f"{folder}/{name}.fbx", bake_anim_simplify_factor=0.0, bake_anim_use_all_actions=False,
        bake_anim_use_nla_strips=False, **options
    )
"""


@pytest.fixture(scope="module")
def short() -> Clip:
    clip = packaged_performance()
    return Clip("short", clip.pose[100:160], clip.frame_rate)


def worst(clip: Clip, found: Clip) -> tuple[float, float]:
    """Return the largest distance (m) and angle (degrees) between joints of two clips."""
    (place, turn), (other, turned) = (map(np.asarray, forward_kinematics(one.pose)) for one in (clip, found))
    assert len(place) == len(other) and clip.frame_rate == found.frame_rate
    return float(np.linalg.norm(place - other, axis=-1).max()), float(np.rad2deg(geodesic_angle(turn, turned)).max())


@pytest.mark.parametrize(
    ("rig", "ending"), [(name, (".fbx", ".bvh")[k % 2]) for k, name in enumerate(RIGS) if name != "source"]
)
def test_every_named_rig_is_read_back(rig: str, ending: str, short: Clip, tmp_path: Path) -> None:
    path = tmp_path / f"take{ending}"
    write_motion(path, short, rig)
    found = bs.read(path)
    assert isinstance(found, Clip)
    distance, angle = worst(short, found)
    assert distance < 1e-4 and (angle < 0.05 or rig == "vrm")  # VRM's thumbs rest otherwise


def test_names_of_rigs(short: Clip, tmp_path: Path) -> None:
    """Names that the makers of the rigs document."""
    wanted = {
        "lafan1": ("Hips", "LeftUpLeg", "LeftToe", "Spine2", "RightForeArm"),
        "soma": ("Hips", "LeftLeg", "LeftShin", "Chest", "Neck1", "LeftHandIndex2", "HeadEnd"),
        "mhr": ("root", "l_upleg", "l_lowleg", "c_spine3", "r_uparm", "c_head", "l_index1"),
        "metahuman": ("pelvis", "spine_05", "clavicle_l", "calf_r", "index_01_l"),
        "vrchat": ("Hips", "Chest", "Left elbow", "Right knee", "IndexFinger1_L", "Thumb0_R"),
    }
    for rig, names in wanted.items():
        write_motion(tmp_path / "take.fbx", short, rig)
        assert set(names) <= set(parse_fbx((tmp_path / "take.fbx").read_bytes(), tmp_path / "take.fbx").joints)


def records(data: bytes, at: int = 27, end: int | None = None) -> list[tuple[str, list[Any], list]]:
    """Parse binary FBX 7.4 by its description: names, properties, records within."""
    found = []
    while at < (len(data) if end is None else end):
        stop, count, size, name = struct.unpack_from("<IIIB", data, at)
        if stop == 0:
            break
        start = at + 13 + name
        values, place = [], start
        for _ in range(count):
            kind, place = chr(data[place]), place + 1
            if kind in "SR":
                (length,) = struct.unpack_from("<I", data, place)
                values.append(data[place + 4 : place + 4 + length])
                place += 4 + length
            elif kind in "fdli":
                number, packed, length = struct.unpack_from("<III", data, place)
                raw = data[place + 12 : place + 12 + length]
                raw = zlib.decompress(raw) if packed else raw
                values.append(np.frombuffer(raw, {"f": "<f4", "d": "<f8", "l": "<i8", "i": "<i4"}[kind]))
                assert len(values[-1]) == number
                place += 12 + length
            else:
                form = {"I": "<i", "L": "<q", "D": "<d", "C": "<?"}[kind]
                values.extend(struct.unpack_from(form, data, place))
                place += struct.calcsize(form)
        assert place == start + size
        found.append((data[at + 13 : start].decode(), values, records(data, place, stop)))
        at = stop
    return found


def test_the_container_is_that_of_the_format(short: Clip, tmp_path: Path) -> None:
    """Read by an independent parser: kinds of objects, one key a frame at the frames' times, a closed end."""
    bs.write(tmp_path / "take.fbx", short)
    data = (tmp_path / "take.fbx").read_bytes()
    assert data.startswith(b"Kaydara FBX Binary  \x00\x1a\x00" + struct.pack("<I", 7400))
    top = {name: inner for name, _, inner in records(data)}
    kinds = [name for name, _, _ in top["Objects"]]
    points, joints = len(short.pose.skeleton.points), len(short.pose.skeleton.joints)
    assert kinds.count("Model") == kinds.count("NodeAttribute") == points
    assert kinds.count("AnimationCurve") == 3 * (joints + 1)
    keys = [dict((n, v) for n, v, _ in inner)["KeyTime"][0] for n, _, inner in top["Objects"] if n == "AnimationCurve"]
    np.testing.assert_allclose(keys[0] / 46_186_158_000, short.time, atol=1e-9)
    assert len(data) % 16 in range(16) and data.endswith(bytes.fromhex("f85a8c6adef5d97eece90ce3758f290b"))


def test_holes_are_filled_in_the_files_own_rig(short: Clip, tmp_path: Path) -> None:
    """A take in inches, Z up, with turned joint axes: only the hole changes; names, tree and rate stay."""
    path, out = tmp_path / "take.fbx", tmp_path / "filled.fbx"
    path.write_bytes(made_body(short, up="z", front="-y", unit=0.0254, seed=3, prefix="Ann:"))
    take = bs.track(path, missing="Ann:left_elbow+:20-35")
    take.save(out)
    before, after = (parse_fbx(one.read_bytes(), one) for one in (path, out))
    names = [name for name in before.joints if name != "Ann:Armature"]
    assert set(names) <= set(after.joints) and after.unit == "in" and after.up == "z"
    changed = {name for name in names if angle(before, after, name).max() > 0.05}
    assert "Ann:left_elbow" in changed and all(name.startswith("Ann:left_") for name in changed)
    assert all(angle(before, after, name)[[*range(20), *range(36, 60)]].max() < 1e-3 for name in names)
    np.testing.assert_allclose(
        after.place(after.joints.index("Ann:pelvis")), before.place(before.joints.index("Ann:pelvis")), atol=1e-3
    )
    clip = bs.read(out)
    assert isinstance(clip, Clip)
    still = np.r_[0:20, 36:60]
    kept = Clip("a", short.pose[still], 30.0), Clip("b", clip.pose[still], 30.0)
    distance, turned = worst(*kept)
    assert distance < 1e-4 and turned < 0.05


def angle(before: Any, after: Any, name: str) -> np.ndarray:
    """Return degrees (T,) between the local rotations of a joint in two files."""
    turns = [file.rotation[:, file.joints.index(name)] for file in (before, after)]
    return np.rad2deg(np.asarray(geodesic_angle(*turns)))


def test_conversion_both_ways(short: Clip, tmp_path: Path) -> None:
    bs.write(tmp_path / "a.fbx", short)
    for source, out in (("a.fbx", "b.bvh"), ("b.bvh", "c.fbx"), ("c.fbx", "d.glb"), ("d.glb", "e.fbx")):
        bs.convert(tmp_path / source, tmp_path / out)
    found = bs.read(tmp_path / "e.fbx")
    assert isinstance(found, Clip)
    distance, turned = worst(short, found)
    assert distance < 1e-4 and turned < 0.05


def test_the_rig_of_another_fbx_file(short: Clip, tmp_path: Path) -> None:
    """A motion comes onto the joints, unit and axes of another file; other endings are refused before any work."""
    rig = tmp_path / "rig.fbx"
    rig.write_bytes(made_body(short, up="z", front="-y", unit=1.0, seed=8, prefix="b_"))
    moved = replace(short, pose=short.pose[::-1])
    bs.convert(moved, tmp_path / "out.fbx", rig=rig)
    found = bs.read(tmp_path / "out.fbx")
    assert isinstance(found, Clip)
    distance, turned = worst(moved, found)
    assert distance < 1e-3 and turned < 0.1
    assert parse_fbx((tmp_path / "out.fbx").read_bytes(), rig).joints[1] == "b_pelvis"
    with pytest.raises(BodysenseError, match=r"out\.bvh: --rig .*rig\.fbx is written as \.fbx; end the name so"):
        bs.convert(moved, tmp_path / "out.bvh", rig=rig)


@pytest.mark.parametrize("rate", [30.0, 24.0, 23.976, 120.0])
def test_rates(rate: float, short: Clip, tmp_path: Path) -> None:
    bs.write(tmp_path / "take.fbx", replace(short, frame_rate=rate))
    found = bs.read(tmp_path / "take.fbx")
    assert isinstance(found, Clip) and found.frame_rate == pytest.approx(rate, rel=1e-6) and len(found) == len(short)


def test_motion_that_is_not_finite_is_refused(short: Clip, tmp_path: Path) -> None:
    root = short.pose.root_position.copy()
    root[3] = np.nan
    with pytest.raises(BodysenseError, match="one motion of finite numbers"):
        bs.write(tmp_path / "take.fbx", replace(short, pose=replace(short.pose, root_position=root)))
    assert not list(tmp_path.iterdir())


@pytest.fixture
def blender(tmp_path: Path) -> Callable[..., None]:
    """Run a script in Debian's Blender."""
    program = shutil.which("blender")
    if program is None:
        pytest.skip("no blender on this machine: apt-get install blender")

    def run(script: str, *arguments: Path) -> None:
        path = tmp_path / "script.py"
        path.write_text(script)
        command = [program, "--background", "--factory-startup", "--python-exit-code", "3", "--python", str(path), "--"]
        done = subprocess.run(
            [*command, *map(str, arguments)], capture_output=True, text=True, timeout=240, check=False
        )
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]

    return run


@pytest.mark.slow
@pytest.mark.blender
def test_blender_places_and_turns_joints_where_we_do(blender: Callable[..., None], short: Clip, tmp_path: Path) -> None:
    bs.write(tmp_path / "take.fbx", short)
    blender(IMPORT, tmp_path / "take.fbx", tmp_path / "found.json")
    found = json.loads((tmp_path / "found.json").read_text())
    place, turn = (np.asarray(part) for part in forward_kinematics(short.pose))
    skeleton, names = short.pose.skeleton, found["names"]
    assert sorted(names) == sorted(skeleton.points) and found["rate"] == pytest.approx(30.0)
    to_ours = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # Blender's Z is up
    order = [names.index(name) for name in skeleton.points]
    places = np.array(found["places"])[:, order] @ to_ours.T
    assert np.linalg.norm(places - place, axis=-1).max() < 1e-4
    turns = np.array(found["turns"])[:, order[: len(skeleton.joints)]]
    turned = np.concatenate([turns[..., :1], turns[..., 1:] @ to_ours.T], axis=-1)
    assert np.rad2deg(np.asarray(geodesic_angle(turned, turn))).max() < 0.05


@pytest.mark.slow
@pytest.mark.blender
def test_what_blender_writes_is_read(blender: Callable[..., None], short: Clip, tmp_path: Path) -> None:
    """Its default, axes of Unreal, Z and X up, metres, and an armature that is a bone."""
    write_motion(tmp_path / "take.fbx", short, "mixamo")
    folder = tmp_path / "exports"
    folder.mkdir()
    blender(EXPORT, tmp_path / "take.fbx", folder)
    paths = sorted(folder.iterdir())
    assert len(paths) == 7
    for path in paths:
        found = bs.read(path)
        assert isinstance(found, Clip)
        distance, turned = worst(short, found)
        assert distance < 1e-4 and turned < 0.05, path.name
        named = bs.read(path, bs.ReadingOptions(skin="skin"))
        assert isinstance(named, Clip) and worst(short, named)[0] < 1e-4
