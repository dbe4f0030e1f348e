"""The npm package `@bodysense/core`: its WebAssembly, its files, and that it computes what the library does."""

from __future__ import annotations

import json
import re
import runpy
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics
from bodysense.body.shape import Measured
from bodysense.demo import performance_of_unseen_body
from bodysense.devices.simulated.device import simulate
from bodysense.geometry.rigid import RigidTransform
from bodysense.geometry.rotation import geodesic_angle
from bodysense.observing.observation import Observation
from bodysense.tracking.estimate import Estimate
from bodysense.tracking.tracker import Tracker, TrackerSettings

Scenario = Callable[..., dict[str, Any]]
ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "xr_body"
PACKAGE, SCRIPTS = ROOT / "web" / "core", ROOT / "web" / "tests" / "core_package"
WASM = PACKAGE / "core.wasm"
LARGEST = 300_000  # bytes of core.wasm
WRAPPER, LONGEST = ("index.ts", "memory.ts", "types.ts"), 300  # lines of the wrapper
FRAMES = 600
ARRAYS = ("rootPosition", "confidence", "bound", "contact", "restOffset")  # of the package's bodies
# m and degrees between bodies of the package and of the library; 0.02 degrees move the end of a spine bone by 25 µm
FARTHEST, MOST_TURNED = 1e-4, 0.02
_LOWER_LEFT, _LOWER_RIGHT = ("left_hip", "left_knee"), ("right_knee", "right_ankle")
_MOUNT = RigidTransform(np.array([0.02, -0.05, 0.03]), np.array([0.5, 0.5, 0.5, 0.5]))


@dataclass(frozen=True)
class Case:
    """A recording, and the known person."""

    device: str
    person: Person = Person()
    settings: TrackerSettings = TrackerSettings()


CASES = {
    "nothing known": Case("three_point"),
    "height": Case("headset_camera", Person(height=1.83), TrackerSettings(floor=0.25, hold_feet=False)),
    "lengths": Case("head", Person(lengths={_LOWER_LEFT: Measured(0.41, 0.01), _LOWER_RIGHT: Measured(0.4, 0.02)})),
    "mounts": Case("six_point", Person(height=Measured(1.7, 0.03), mounts={"left_ankle": _MOUNT})),
    "sensors": Case("three_point_imu_feet", Person(performance_of_unseen_body().pose.skeleton)),
}


@pytest.fixture(scope="module")
def project(web: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An empty npm project into which the packed package was installed."""
    folder = tmp_path_factory.mktemp("project")
    packed = run_in(PACKAGE, "npm", "pack", "--silent", "--pack-destination", str(folder))
    (folder / "package.json").write_text('{"private": true, "type": "module"}')
    run_in(folder, "npm", "install", "--silent", "--offline", "--no-audit", "--no-fund", packed.split()[-1])
    for path in SCRIPTS.iterdir():
        shutil.copy(path, folder)
    return folder


def run_in(folder: Path, *command: str) -> str:
    """Run a program that must succeed, and return its output."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
    return done.stdout


def observed(case: Case) -> Observation:
    return simulate(performance_of_unseen_body(), case.device, noise=1)[:FRAMES]


def recording(case: Case, observation: Observation) -> dict[str, Any]:
    """A case as the package takes it, in plain objects."""
    person, settings = case.person, case.settings
    known: dict[str, Any] = {
        "lengths": [
            {"start": start, "end": end, "value": one.value, "deviation": one.deviation}
            for (start, end), one in person.lengths.items()
        ],
        "mounts": [
            {"joint": joint, "translation": mount.translation.tolist(), "rotation": mount.rotation.tolist()}
            for joint, mount in person.mounts.items()
        ],
    }
    if person.height is not None:
        known |= {"height": person.height.value, "heightDeviation": person.height.deviation}
    if person.is_known:
        known["restOffset"] = person.skeleton.rest_offset.ravel().tolist()
    frames = [frame(observation, t) for t in range(len(observation))]
    return {"person": known, "frames": frames, "settings": {"floor": settings.floor, "holdFeet": settings.hold_feet}}


def frame(observation: Observation, t: int) -> dict[str, Any]:
    points = []
    for k, name in enumerate(observation.points):
        point: dict[str, Any] = {"name": name}
        if observation.has_position[t, k]:
            point |= {"position": observation.position[t, k].tolist(), "accuracy": float(observation.accuracy[t, k])}
        if observation.has_rotation[t, k]:
            point["rotation"] = observation.rotation[t, k].tolist()
        if observation.acceleration is not None and np.isfinite(observation.acceleration[t, k]).all():
            point["acceleration"] = observation.acceleration[t, k].tolist()
        points.append(point)
    return {"time": float(observation.time[t]), "points": points}


def bodies(done: dict[str, Any], name: str, *shape: int) -> np.ndarray:
    """One array (T, …) of a package's bodies."""
    return np.array([body[name] for body in done["bodies"]]).reshape(len(done["bodies"]), *(shape or (-1,)))


def assert_equal_bodies(done: dict[str, Any], estimate: Estimate, names: Sequence[str] = ARRAYS) -> None:
    apart = np.linalg.norm(bodies(done, "points", 65, 3) - estimate.points, axis=-1)
    assert apart.max() <= FARTHEST
    turned = geodesic_angle(bodies(done, "rotation", 52, 4), estimate.pose.rotation)
    assert np.rad2deg(np.asarray(turned)).max() <= MOST_TURNED
    assert np.array_equal(bodies(done, "measured", 65).astype(bool), estimate.measured)
    expected = {
        "rootPosition": estimate.pose.root_position,
        "confidence": estimate.confidence,
        "bound": estimate.bound,
        "contact": estimate.contact,
        "restOffset": estimate.rest_offset,
    }
    for name in names:
        array = expected[name]
        np.testing.assert_allclose(bodies(done, name, *array.shape[1:]), array, atol=FARTHEST, err_msg=name)


def test_the_core_is_small_and_stands_alone(web: Path) -> None:
    assert WASM.stat().st_size <= LARGEST
    assert sum(len((PACKAGE / "src" / name).read_text("utf-8").splitlines()) for name in WRAPPER) <= LONGEST
    build = runpy.run_path(str(ROOT / "scripts" / "build_wasm.py"))
    assert outside(web, WASM) == {"imports": [], "exports": sorted(["_initialize", "memory", *build["interface"]()])}


def outside(web: Path, wasm: Path) -> dict[str, list[str]]:
    """Return the names that a WebAssembly module imports and exports."""
    script = """const module = new WebAssembly.Module(require("node:fs").readFileSync(process.argv[1]));
    const names = (all) => all.map(({ name }) => name).sort();
    const { imports, exports } = WebAssembly.Module;
    console.log(JSON.stringify({ imports: names(imports(module)), exports: names(exports(module)) }));"""
    return json.loads(run_in(web, "node", "-e", script, str(wasm)))


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_the_package_completes_the_bodies_of_the_library(project: Path, tmp_path: Path, name: str) -> None:
    case = CASES[name]
    observation = observed(case)
    (tmp_path / "recording.json").write_text(json.dumps(recording(case, observation)))
    run_in(project, "node", "node.mjs", str(tmp_path / "recording.json"), str(tmp_path / "result.json"))
    done = json.loads((tmp_path / "result.json").read_text())
    tracker = Tracker(case.person, settings=case.settings)
    estimate, state = tracker.step(observation, tracker.start())
    assert done["kernel"] == "simd128" and done["points"] == list(estimate.pose.skeleton.points)
    assert_equal_bodies(done, estimate)
    believed = state.person()
    offset = np.array(done["person"]["restOffset"]).reshape(65, 3)
    np.testing.assert_allclose(offset, believed.skeleton.rest_offset, atol=FARTHEST)
    np.testing.assert_allclose(done["person"]["deviation"], believed.bone_deviation, atol=FARTHEST)
    for mount in done["person"]["mounts"]:
        expected = believed.mounts[mount["joint"]]
        np.testing.assert_allclose(mount["translation"], expected.translation, atol=FARTHEST)


@pytest.mark.slow
def test_what_is_refused_is_named(project: Path) -> None:
    facts = json.loads(run_in(project, "node", "node.mjs", "--refusals"))
    names = facts["unknown"].removeprefix('unknown point "hat"; give one of ').split(", ")
    assert len(names) == 65 and {"head", "left_toe"} <= set(names)
    value = (
        "frame: a tracked value is not finite, a position beyond 1 km, an accuracy not above 0, or a quaternion not of "
        "length 1; clear its mask, or give metres"
    )
    assert facts == {
        "damaged": "weights: the weights are truncated or not a safetensors file; copy the file again",
        "time": "frame: time is not finite or does not increase; give frames in order of time, in seconds",
        "unknown": facts["unknown"],
        "position": value,
        "accuracy": value,
        "rotation": value,
        "vector": "head: position: 2 numbers; give 3",
        "many": "frame: 66 points; give at most 65",
        "height": "person: no person has these offsets, deviations, lengths or mounts; give metres",
        "lengths": "person: 33 lengths; give at most 32",
        "mount": 'person: a tracker on "left_toe", which is no joint; name its parent',
        "setting": "frame: a setting is not finite or out of its range; begin with bs_default_settings",
        "closed": "state: it was closed; start a new one",
    }


@pytest.mark.slow
def test_the_readme_s_example_runs(project: Path) -> None:
    code = re.findall(r"```js\n(.*?)```", (PACKAGE / "README.md").read_text("utf-8"), re.DOTALL)
    (project / "example.js").write_text("\n".join(code))
    printed = run_in(project, "node", "example.js")
    assert printed.startswith("Float64Array(3)")


@pytest.mark.slow
def test_the_package_has_types(project: Path, web: Path) -> None:
    options = ["--strict", "--noEmit", "--target", "es2022", "--module", "nodenext", "--types", ""]
    run_in(project, str(web / "node_modules" / ".bin" / "tsc"), *options, "typed.ts")


@pytest.mark.slow
def test_the_package_runs_in_a_browser(scenario: Scenario, project: Path, tmp_path: Path) -> None:
    case = CASES["nothing known"]
    observation = observed(case)[:200]
    (project / "recording.json").write_text(json.dumps(recording(case, observation)))
    facts = scenario("core_package", project, "recording.json", tmp_path / "result.json")
    assert facts["frames"] == len(observation)
    tracker = Tracker(case.person, settings=case.settings)
    assert_equal_bodies(
        json.loads((tmp_path / "result.json").read_text()), tracker.step(observation, tracker.start())[0]
    )


@pytest.mark.slow
def test_the_package_has_a_body_for_webxr(project: Path) -> None:
    facts = json.loads(run_in(project, "node", "webxr.mjs"))
    assert facts["refused"] == "this browser has no WebXR; open the page by https in a headset's browser"
    joints = {name: np.array(place) for name, place in facts["joints"].items()}
    assert len(joints) == 83 and all(np.isfinite(place).all() for place in joints.values())
    assert np.linalg.norm(joints["head"] - (0, 1.6, 0)) < 0.15
    assert joints["hips"][1] > 0.7 and 0 < joints["left-foot-ankle"][1] < 0.4
    assert joints["left-hand-wrist"][0] < 0 < joints["right-hand-wrist"][0]  # the wearer looks along −Z


@pytest.fixture(scope="module")
def example(project: Path, web: Path) -> Path:
    """The example of WebXR's body, checked and built by Vite with the packed package, beside npm's three.js."""
    for name in ("three", "vite", "@types"):
        (project / "node_modules" / name).symlink_to(web / "node_modules" / name)
    shutil.copytree(EXAMPLE, project / "xr_body")
    options = ["--strict", "--noEmit", "--target", "es2022", "--module", "esnext", "--moduleResolution", "bundler"]
    programs = web / "node_modules" / ".bin"
    snippets = re.findall(r"```ts\n(.*?)```", (PACKAGE / "README.md").read_text("utf-8"), re.DOTALL)
    assert snippets
    (project / "snippet.ts").write_text("\n".join(snippets))
    for source in ("xr_body/main.ts", "snippet.ts"):
        run_in(project, str(programs / "tsc"), *options, "--types", "vite/client,webxr", source)
    run_in(project / "xr_body", str(programs / "vite"), "build", "--logLevel", "error")
    return project / "xr_body" / "dist"


@pytest.mark.slow
def test_the_example_shows_a_body_in_a_browser_without_body_tracking(
    scenario: Scenario, example: Path, tmp_path: Path
) -> None:
    facts = scenario("headset/xr_body", example, tmp_path)
    for name in ("first", "raised", "second"):
        body = facts[name]
        assert body["size"] == 83 and "body-tracking" in body["enabledFeatures"]
        assert np.linalg.norm(np.subtract(body["head"], (0.4, 1.6, 0.2))) < 0.15  # behind and below the eyes
        assert 0.7 < body["hips"][1] < 1.1
        assert max(body["left-foot-ball"][1], body["right-foot-ball"][1]) < 0.15
    wrists = [facts[name]["left-hand-wrist"] for name in ("first", "raised", "second")]
    assert np.linalg.norm(np.subtract(wrists[0], (0.15, 1.05, -0.1))) < 0.1
    assert np.linalg.norm(np.subtract(wrists[1], (0.1, 1.75, 0.1))) < 0.1
    assert np.linalg.norm(np.subtract(wrists[2], wrists[0])) < 0.02
    assert facts["raised"]["left-arm-lower"][1] > facts["first"]["left-arm-lower"][1] + 0.2  # the elbow goes along


@pytest.mark.slow
@pytest.mark.parametrize("name", ["height", "sensors"])
def test_the_page_completes_the_bodies_of_the_library(
    scenario: Scenario, site: Path, tmp_path: Path, name: str
) -> None:
    case = replace(CASES[name], settings=replace(CASES[name].settings, floor=0.0))  # as the page has it
    observation = observed(case)
    (tmp_path / "recording.json").write_text(json.dumps(recording(case, observation)))
    facts = scenario("tracker", site, tmp_path / "recording.json", tmp_path / "result.json")
    assert facts["frames"] == len(observation)
    done = json.loads((tmp_path / "result.json").read_text())
    tracker = Tracker(case.person, settings=case.settings)
    estimate, _ = tracker.step(observation, tracker.start())
    assert_equal_bodies(done, estimate, ("rootPosition", "confidence", "restOffset"))
    world = np.asarray(forward_kinematics(estimate.pose)[1])
    assert np.rad2deg(np.asarray(geodesic_angle(bodies(done, "world", 52, 4), world))).max() <= 2 * MOST_TURNED


@pytest.mark.slow
def test_the_core_is_what_its_source_says(project: Path, web: Path, tmp_path: Path) -> None:
    if find_spec("ziglang") is None:
        pytest.skip("no compiler for WebAssembly: pip install ziglang")
    build = runpy.run_path(str(ROOT / "scripts" / "build_wasm.py"))["build"]
    built = build(tmp_path / "core.wasm", [sys.executable, "-m", "ziglang", "cc"])
    assert outside(web, built) == outside(web, WASM), "run `python scripts/build_wasm.py`"
    case = CASES["nothing known"]
    (tmp_path / "recording.json").write_text(json.dumps(recording(case, observed(case))))
    done = []
    for wasm in (built, WASM):
        run_in(project, "node", "node.mjs", str(tmp_path / "recording.json"), str(tmp_path / "result.json"), str(wasm))
        done.append(json.loads((tmp_path / "result.json").read_text()))
    rebuilt, kept = done
    for name in kept["bodies"][0]:
        np.testing.assert_allclose(
            bodies(kept, name), bodies(rebuilt, name), atol=1e-9, err_msg=f"{name}: run `python scripts/build_wasm.py`"
        )
