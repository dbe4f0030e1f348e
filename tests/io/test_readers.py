"""Independent readers open our files: Khronos' validator, three-vrm, and Blender, which also renders a picture."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.io.clip import Clip
from bodysense.io.formats.gltf.humanoid import VRM_BONES, t_posed
from bodysense.io.formats.gltf.vrma import write_vrma
from bodysense.io.formats.gltf.writer import write_glb

MODULES = Path(__file__).parents[2] / "web" / "node_modules"
VALIDATE = """
const validator = require(process.argv[2] + '/gltf-validator');
const bytes = new Uint8Array(require('fs').readFileSync(process.argv[3]));
validator.validateBytes(bytes).then((report) => console.log(JSON.stringify(report.issues)));
"""
READ_VRMA = """
import { readFileSync } from 'node:fs';
import { pathToFileURL } from 'node:url';
const [modules, path] = process.argv.slice(2);
const load = (file) => import(pathToFileURL(`${modules}/${file}`));
const { GLTFLoader } = await load('three/examples/jsm/loaders/GLTFLoader.js');
const { VRMAnimationLoaderPlugin } = await load('@pixiv/three-vrm-animation/lib/three-vrm-animation.module.js');
const loader = new GLTFLoader();
loader.register((parser) => new VRMAnimationLoaderPlugin(parser));
const bytes = readFileSync(path);
const gltf = await loader.parseAsync(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length), '');
const [found] = gltf.userData.vrmAnimations;
const tracks = (map) => Object.fromEntries([...map].map(([name, track]) => [name, Array.from(track.values)]));
console.log(JSON.stringify({
  duration: found.duration,
  hips: found.restHipsPosition.toArray(),
  translation: tracks(found.humanoidTracks.translation),
  rotation: tracks(found.humanoidTracks.rotation),
}));
"""
BLENDER = """
import bpy, json, math, sys
import numpy
numpy.bool = bool  # Debian's Blender 3.4 asks its newer NumPy for a name that is gone
path, out, picture, rate, frames = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.preferences.addon_enable(module="io_scene_gltf2")
scene = bpy.context.scene
scene.render.fps = int(rate)
bpy.ops.import_scene.gltf(filepath=path)
armature = next(thing for thing in bpy.data.objects if thing.type == "ARMATURE")
found = {}
for frame in json.loads(frames):
    scene.frame_set(frame)
    found[frame] = {bone.name: list(armature.matrix_world @ bone.head) for bone in armature.pose.bones}
json.dump(found, open(out, "w"))

def put(name, data, place, turn):
    thing = bpy.data.objects.new(name, data)
    thing.location, thing.rotation_euler = place, turn
    scene.collection.objects.link(thing)
    return thing

x, y, _ = found[frame]["pelvis"]
scene.camera = put("camera", bpy.data.cameras.new("camera"), (x, y - 4, 0.9), (math.pi / 2, 0, 0))
sun = put("sun", bpy.data.lights.new("sun", "SUN"), (0, 0, 3), (0.7, 0.2, 0.4))
sun.data.energy = 4
scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 4, False
scene.render.film_transparent = True
scene.render.resolution_x, scene.render.resolution_y, scene.render.filepath = 120, 160, picture
bpy.ops.render.render(write_still=True)
"""


@pytest.fixture(scope="module")
def clip() -> Clip:
    """A dozen moments of the packaged performance, a frame each."""
    whole = packaged_performance()
    pose = whole.pose[:: len(whole) // 12]
    return Clip("performance", pose, 24.0)


def run_node(folder: Path, name: str, script: str, needs: str, path: Path) -> dict:
    node = shutil.which("node")
    if node is None or not (MODULES / needs).is_dir():
        pytest.skip(f"no {'node' if node is None else needs} on this machine: apt-get install npm; npm ci in web/")
    (folder / name).write_text(script)
    command = [node, str(folder / name), str(MODULES), str(path)]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert ran.returncode == 0, ran.stderr[-2000:]
    return json.loads(ran.stdout)


@pytest.mark.slow
def test_khronos_validator_finds_nothing_wrong(clip: Clip, tmp_path: Path) -> None:
    for name, write in (("a.glb", write_glb), ("a.vrma", write_vrma)):
        write(tmp_path / name, clip)
        issues = run_node(tmp_path, "validate.cjs", VALIDATE, "gltf-validator", tmp_path / name)
        assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]
        # It does not know VRM's extension; the outermost bones of an animation have neither children nor a mesh.
        known = set() if name == "a.glb" else {"UNSUPPORTED_EXTENSION", "NODE_EMPTY"}
        assert {message["code"] for message in issues["messages"]} == known
        assert not issues["truncated"]


@pytest.mark.slow
def test_three_vrm_reads_our_animation(clip: Clip, tmp_path: Path) -> None:
    """The rotations for an avatar's normalised bones reproduce the motion in our kinematics."""
    write_vrma(tmp_path / "a.vrma", clip)
    found = run_node(tmp_path, "read.mjs", READ_VRMA, "@pixiv/three-vrm-animation", tmp_path / "a.vrma")
    assert found["duration"] == pytest.approx(clip.time[-1])
    assert set(found["rotation"]) == set(VRM_BONES.values()) and set(found["translation"]) == {"hips"}
    skeleton = t_posed(clip.pose).skeleton
    np.testing.assert_allclose(found["hips"], skeleton.rest_offset[0], atol=1e-6)
    turns = [np.array(found["rotation"][VRM_BONES[joint]]).reshape(-1, 4)[:, [3, 0, 1, 2]] for joint in skeleton.joints]
    root = np.array(found["translation"]["hips"]).reshape(-1, 3)
    position, _ = forward_kinematics(Pose(skeleton, root, np.stack(turns, axis=1)))
    np.testing.assert_allclose(position, forward_kinematics(clip.pose)[0], atol=5e-6)


@pytest.mark.slow
@pytest.mark.blender
def test_blender_places_joints_where_we_do_and_shows_a_body(clip: Clip, tmp_path: Path) -> None:
    blender = shutil.which("blender")
    if blender is None:
        pytest.skip("no blender on this machine: apt-get install blender python3-numpy")
    path, out, picture, script = (tmp_path / name for name in ("a.glb", "found.json", "picture.png", "script.py"))
    write_glb(path, clip)
    script.write_text(BLENDER)
    frames = list(range(len(clip)))
    rest = [str(path), str(out), str(picture), f"{clip.frame_rate:.0f}", json.dumps(frames)]
    command = f"{blender} --background --factory-startup --threads 1 --python-exit-code 3 --python {script} --".split()
    ran = subprocess.run([*command, *rest], capture_output=True, text=True, timeout=240, check=False)
    if "No module named 'numpy'" in ran.stdout + ran.stderr:
        pytest.skip("Blender's glTF importer has no NumPy here: apt-get install python3-numpy")
    assert ran.returncode == 0, ran.stdout[-2000:] + ran.stderr[-2000:]
    ours, _ = forward_kinematics(clip.pose)
    for frame, bones in json.loads(out.read_text()).items():
        assert set(bones) == set(clip.pose.skeleton.points)
        for name, place in bones.items():
            # Blender's world has Z up: (x, y, z) there is (x, z, −y) here.
            found = np.array([place[0], place[2], -place[1]])
            assert np.linalg.norm(found - ours[int(frame), clip.pose.skeleton.index(name)]) < 1e-5, (frame, name)
    with Image.open(picture) as image:
        opaque = np.asarray(image)[..., 3] > 128
    assert 0.02 < opaque.mean() < 0.5
