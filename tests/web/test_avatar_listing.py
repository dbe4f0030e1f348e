"""The listing for three.js: bones of an avatar are where the completed body's joints are."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import geodesic_angle, quaternion_multiply
from bodysense.tracking.model import PACKAGED

ROOT = Path(__file__).parents[2]
NAMES = {
    "pelvis": "Hips",
    "spine3": "Chest",
    "head": "Head",
    "left_shoulder": "Arm",
    "left_elbow": "Fore",
    "left_knee": "Shin",
}
PROGRAM = """
import { readFile } from "node:fs/promises";
import { Object3D, Quaternion, Vector3 } from "three";
import { avatar } from "./avatar.js";
const names = JSON.parse(process.argv[3]);
const scene = new Object3D();
const joints = {};
let turn = 0;
for (const [joint, parent] of Object.entries(JSON.parse(process.argv[4]))) {
  joints[joint] = new Object3D();
  joints[joint].name = names[joint];
  joints[joint].rotation.set(0.3 + turn, -0.2 * turn, (turn += 0.4));
  joints[joint].position.set(0.1, 0.3, 0);
  (joints[parent] ?? scene).add(joints[joint]);
}
scene.position.set(0, 0.1, 0);
scene.rotation.y = 0.7;
const turned = (one) => one.getWorldQuaternion(new Quaternion());
const world = () => Object.values(joints).map(turned).map(({ x, y, z, w }) => [w, x, y, z]);
const rest = world();
const step = await avatar(await readFile(process.argv[2]), scene, names, { height: 1.7 });
const head = new Object3D();
let body;
for (let k = 0; k < 20; k++) {
  head.position.set(0.01 * k, 1.55, 0);
  head.rotation.y = 0.05 * k;
  body = step(k / 30, { head });
}
const root = joints.pelvis.getWorldPosition(new Vector3()).toArray();
console.log(JSON.stringify({ rest, world: world(), root, body: [...body.rootPosition], rotation: [...body.rotation] }));
"""


@pytest.mark.slow
def test_the_bones_follow_the_body(web: Path, tmp_path: Path) -> None:
    modules = tmp_path / "node_modules"
    package = modules / "@bodysense" / "core"
    package.mkdir(parents=True)
    (modules / "three").symlink_to(web / "node_modules" / "three")
    subprocess.run(["npx", "tsc", "--outDir", package / "dist"], cwd=web / "core", check=True)
    for name in ("core.wasm", "package.json"):
        shutil.copy(web / "core" / name, package)
    shutil.copy(ROOT / "extras" / "engines" / "threejs" / "avatar.js", tmp_path)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "run.js").write_text(PROGRAM)
    parents = {"pelvis": None, "spine3": "pelvis", "head": "spine3"}
    parents |= {"left_shoulder": "spine3", "left_elbow": "left_shoulder", "left_knee": "pelvis"}
    weights = ROOT / "src" / "bodysense" / "weights" / PACKAGED
    done = subprocess.run(
        ["node", "run.js", weights, json.dumps(NAMES), json.dumps(parents)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    found = {name: np.array(values) for name, values in json.loads(done.stdout).items()}
    skeleton = default_skeleton()
    _, turned = forward_kinematics(Pose(skeleton, np.zeros(3), found["rotation"].reshape(-1, 4)))
    expected = quaternion_multiply(turned[skeleton.indices(list(parents))], found["rest"])
    assert np.asarray(geodesic_angle(expected, found["world"])).max() < 1e-6
    np.testing.assert_allclose(found["root"], found["body"], atol=1e-9)
    assert np.asarray(geodesic_angle(found["world"], found["rest"])).max() > 0.3
