"""The parts of the Blender add-on that need no Blender: datagrams, command lines, names, BVH, the manifest."""

from __future__ import annotations

import importlib
import json
import re
import struct
import subprocess
import sys
import tomllib
import types
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import bodysense
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import read_bvh
from bodysense.io.formats.gltf.humanoid import VRM_BONES, unity_bone
from bodysense.io.formats.osc import bundled, message_bytes
from bodysense.io.holes import missing_items
from bodysense.io.motion_files import write_motion
from bodysense.io.target_rigs.named import MIXAMO, RIGIFY, UNREAL
from bodysense_live.protocols.vmc import vmc_packets

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "extras" / "blender"


@pytest.fixture(scope="module")
def addon() -> Iterator[types.SimpleNamespace]:
    """The modules of pure Python; the package's own __init__ imports Blender's."""
    package = ModuleType("bodysense_addon")
    package.__path__ = [str(FOLDER)]
    sys.modules["bodysense_addon"] = package
    names = ("bvh", "fault", "holes", "humanoid", "osc", "process")
    yield types.SimpleNamespace(**{name: importlib.import_module(f"bodysense_addon.{name}") for name in names})
    for name in [name for name in sys.modules if name.partition(".")[0] == "bodysense_addon"]:
        del sys.modules[name]


def test_the_servers_datagrams_are_poses(addon: types.SimpleNamespace) -> None:
    poses = addon.osc.Poses()
    for k in range(3):
        (packet,) = vmc_packets(packaged_performance().pose[k], k / 30)
        (pose,) = poses.take(packet)
        assert set(pose) == {"Root", *(unity_bone(bone) for bone in VRM_BONES.values())}
        assert pose["Root"].rotation == (0, 0, 0, 1)
        assert np.linalg.norm(pose["LeftUpperArm"].rotation) == pytest.approx(1, abs=1e-5)
        height = float(packaged_performance().pose[k].root_position[1])
        assert pose["Hips"].position[1] == pytest.approx(height, abs=1e-5)


def _bone(name: str) -> bytes:
    return message_bytes("/VMC/Ext/Bone/Pos", "sfffffff", name, 0, 1, 0, 0, 0, 0, 1)


def test_a_pose_ends_at_ok_at_t_or_with_its_bundle(addon: types.SimpleNamespace) -> None:
    ok, t = message_bytes("/VMC/Ext/OK", "i", 1), message_bytes("/VMC/Ext/T", "f", 1.0)
    for end in (ok, t):
        poses = addon.osc.Poses()
        assert poses.take(_bone("Hips")) == []
        assert poses.take(_bone("Head")) == []
        assert [set(pose) for pose in poses.take(end)] == [{"Hips", "Head"}]
        assert poses.take(end) == []
    (bundle,) = bundled([_bone("Hips"), _bone("Head")])
    assert [set(pose) for pose in addon.osc.Poses().take(bundle)] == [{"Hips", "Head"}]
    (two,) = bundled([_bone("Hips"), ok, t, _bone("Head")])
    assert [set(pose) for pose in addon.osc.Poses().take(two)] == [{"Hips"}, {"Head"}]


@pytest.mark.parametrize(
    "packet",
    [
        b"",
        b"#bundle\0" + bytes(8) + struct.pack(">i", -8),
        b"#bundle\0" + bytes(8) + struct.pack(">i", 0),
        b"#bundle\0" + bytes(8) + b"\0",
        _bone("Hips")[:-1],
        message_bytes("/VMC/Ext/Bone/Pos", "sffffff", "Hips", 0, 1, 0, 0, 0, 0),
        message_bytes("/VMC/Ext/Bone/Pos", "sfffffff", "Hips", 0, 1, 0, 0, 0, 0, 0),
        message_bytes("/VMC/Ext/Bone/Pos", "sfffffff", "Hips", float("nan"), 1, 0, 0, 0, 0, 1),
        b"/a\xff\0,\0\0\0",
    ],
)
def test_malformed_datagrams_are_refused(addon: types.SimpleNamespace, packet: bytes) -> None:
    with pytest.raises(ValueError, match=r"."):
        addon.osc.Poses().take(packet)


def test_random_bytes_only_raise_value_errors(addon: types.SimpleNamespace) -> None:
    rng, (packet,) = np.random.default_rng(1), vmc_packets(packaged_performance().pose[0], 0.0)
    refused = 0
    for _ in range(500):
        broken = bytearray(packet)
        for place in rng.integers(0, len(packet), 3):
            broken[place] = rng.integers(0, 256)
        try:
            addon.osc.Poses().take(bytes(broken))
        except ValueError:
            refused += 1
    assert 0 < refused < 500


def test_the_command_is_that_of_blenders_python(addon: types.SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> None:
    process = addon.process
    words = process.command("in.bvh", "out.bvh", "/blender/python")
    packages = str(Path(bodysense.__file__).parents[1])
    assert words == ["/blender/python", str(FOLDER / "worker.py"), packages, "in.bvh", "out.bvh"]
    monkeypatch.setattr(process, "find_spec", lambda name: None)
    with pytest.raises(addon.fault.Fault, match="wheels are not installed; use Get Extensions"):
        process.command("in.bvh", "out.bvh")


def run_worker(addon: types.SimpleNamespace, folder: Path, given: dict[str, str]) -> tuple[int, str]:
    """Status and output of the worker on the performance in Mixamo's rig."""
    take, out = folder / "take.bvh", folder / "out.bvh"
    write_motion(take, Clip("performance", packaged_performance().pose[:60], 30.0), "mixamo")
    words = addon.process.command(str(take), str(out))
    done = subprocess.run(words, input=json.dumps(given), capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def test_the_worker_completes_a_take_in_its_own_rig(addon: types.SimpleNamespace, tmp_path: Path) -> None:
    status, printed = run_worker(addon, tmp_path, {"missing": "LeftArm,LeftForeArm:20-30"})
    assert (status, addon.process.progress(printed)) == (0, 100)
    filled, whole = read_bvh(tmp_path / "out.bvh"), read_bvh(tmp_path / "take.bvh")
    assert filled.pose.skeleton.joints == whole.pose.skeleton.joints
    arm = whole.pose.skeleton.index("mixamorig:LeftArm")
    moved = np.abs(filled.pose.rotation - whole.pose.rotation)[:, arm].max(axis=-1) > 1e-4
    assert moved[20:31].any() and not moved[:20].any() and not moved[31:].any()


def test_the_workers_error_is_one_line(addon: types.SimpleNamespace, tmp_path: Path) -> None:
    status, printed = run_worker(addon, tmp_path, {"missing": "tail:3-9"})
    assert status == 1
    assert "tail" in addon.process.error_line(printed, status)
    assert "Traceback" not in printed


def test_progress_and_the_last_line_of_an_error(addon: types.SimpleNamespace) -> None:
    process = addon.process
    assert process.progress("") is None
    assert process.progress("0 %\n7 %\n43 %\n") == 43
    assert process.error_line("0 %\n12 %\ntake.bvh: no body\n13 %\n", 1) == "take.bvh: no body"
    assert process.error_line("", 9) == "bodysense ended with status 9 and no message"
    assert process.environment({"A": "b"})["A"] == "b"


def test_holes_are_those_that_bodysense_reads(addon: types.SimpleNamespace) -> None:
    keys = {"arm": {1, 2, 6, 7, 9}, "hand": {1, 2, 6, 7, 8, 9}, "hips": set(range(1, 10)), "eye": set()}
    holes = addon.holes.unkeyed(keys, 1, 9)
    assert holes == {"arm": {3, 4, 5, 8}, "hand": {3, 4, 5}}
    text = addon.holes.missing_text(holes, 1)
    assert text == "arm,hand:2-4,arm:7-7"
    read = [(item.name, item.frames) for item in missing_items(text)]
    assert read == [("arm", (2, 4)), ("hand", (2, 4)), ("arm", (7, 7))]


@pytest.mark.parametrize(
    ("family", "prefix"), [(MIXAMO, ""), (UNREAL, ""), (RIGIFY, ""), (RIGIFY, "DEF-"), (VRM_BONES, "Armature:")]
)
def test_bones_of_known_rigs(addon: types.SimpleNamespace, family: dict[str, str], prefix: str) -> None:
    joints = [joint for joint in VRM_BONES if joint in family]
    found = addon.humanoid.joints_of([*(prefix + family[joint] for joint in joints), "tail"])
    assert found == {joint: prefix + family[joint] for joint in joints}


def test_unitys_names_are_the_servers(addon: types.SimpleNamespace) -> None:
    assert {joint: unity_bone(bone) for joint, bone in VRM_BONES.items()} == addon.humanoid.UNITY


def test_the_device_of_selected_bones(addon: types.SimpleNamespace) -> None:
    bones = [MIXAMO[joint] for joint in VRM_BONES]
    for device, joints in addon.humanoid.DEVICES.items():
        assert set(joints) == set(SENSOR_SETS[device].points)
        assert addon.humanoid.device_of([MIXAMO[joint] for joint in joints], bones) == device
    with pytest.raises(
        addon.fault.Fault, match=r"no device tracks left_wrist; select the bones of head, or head \+ wrists"
    ):
        addon.humanoid.device_of(["mixamorig:LeftHand"], bones)
    with pytest.raises(addon.fault.Fault, match="of no known humanoid"):
        addon.humanoid.device_of(["a"], ["a", "b"])


def test_bvh_is_read_back_by_bodysense_and_the_addon(addon: types.SimpleNamespace, tmp_path: Path) -> None:
    bvh, rng = addon.bvh, np.random.default_rng(2)
    whole = packaged_performance()
    clip = Clip("performance", whole.pose[:4], 30.0)
    write_motion(tmp_path / "theirs.bvh", clip)
    skeleton = read_bvh(tmp_path / "theirs.bvh").pose.skeleton
    rest, names = np.asarray(skeleton.rest_offset), skeleton.joints
    parents = [int(parent) for parent in skeleton.parents[: len(names)]]
    joints = [
        bvh.Joint(name, parent, tuple(rest[k].tolist()), (0.0, 0.1, 0.0))
        for k, (name, parent) in enumerate(zip(names, parents, strict=True))
    ]
    rows = rng.uniform(-40, 40, (4, 3 + 3 * len(joints))).round(6)
    text = bvh.write_bvh(joints, rows.tolist(), 1 / 24)
    assert np.array_equal(bvh.read_rows(text, joints), rows)
    (tmp_path / "ours.bvh").write_text(text)
    read = read_bvh(tmp_path / "ours.bvh")
    assert read.frame_rate == pytest.approx(24, abs=1e-3)
    assert read.pose.skeleton.joints == names
    with pytest.raises(addon.fault.Fault, match="other bones than it read"):
        bvh.read_rows(text.replace("JOINT left_knee", "JOINT knee"), joints)
    assert bvh.safe_names(["a b", "c,d", "e"]) == ["a_b", "c_d", "e"]
    with pytest.raises(addon.fault.Fault, match="two bones would be named a_b"):
        bvh.safe_names(["a b", "a_b"])


def test_the_manifest_is_of_schema_1() -> None:
    manifest = tomllib.loads((FOLDER / "blender_manifest.toml").read_text())
    required = "schema_version id version name tagline maintainer type blender_version_min license"
    assert set(required.split()) <= set(manifest)
    assert manifest["schema_version"] == "1.0.0"
    assert re.fullmatch(r"[a-z_][a-z0-9_]*", manifest["id"])
    assert re.fullmatch(r"\d+\.\d+\.\d+", manifest["version"])
    assert manifest["license"] == ["SPDX:MIT"] and (FOLDER / "LICENSE").read_text().startswith("MIT License")
    assert manifest["version"] == bodysense.__version__
    assert manifest["type"] == "add-on"
    assert manifest["blender_version_min"] == "4.2.0"
    # Blender refuses longer taglines and reasons, and those that end with punctuation.
    for text in (manifest["tagline"], *manifest["permissions"].values()):
        assert 0 < len(text) <= 64
        assert text[-1].isalnum()
    assert "wheels" not in manifest and "platforms" not in manifest  # `scripts/build_packages.py` adds them
