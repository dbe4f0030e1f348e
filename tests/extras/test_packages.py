"""Packages of ecosystems, as `scripts/build_packages.py` writes them: layout, listings, and libraries that are run.

Blender's own tool checks the extension if `BPY_PYTHONS` names a Python with the module `bpy`. Unity's layout is the
documented one, and Mono compiles the scripts. No package index has Godot 4: the library of the add-on is loaded, and a
model of Godot's documented interface creates the node and calls its methods.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import os
import re
import shutil
import subprocess
import tarfile
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import build_packages
import build_wheels
import numpy as np
import pytest

import bodysense as bs
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import THREE_POINT
from bodysense.geometry.rotation import quaternion_to_matrix

ROOT = Path(__file__).parents[2]
SHIMS = ROOT / "tests" / "extras" / "engine_shims" / "unity.cs"
# Some of the licences that Blender's platform takes.
LICENCES = {"GPL-2.0-or-later", "GPL-3.0-or-later", "LGPL-2.1-or-later", "LGPL-3.0-or-later", "MIT", "MIT-0"}
pytestmark = pytest.mark.slow


# ---- Blender ---------------------------------------------------------------------------------------------------------


def blender_tool() -> list[str] | None:
    """The command of Blender's tool for extensions, in the first Python of `BPY_PYTHONS`."""
    pythons = [Path(path) for path in os.environ.get("BPY_PYTHONS", "").split(os.pathsep) if path]
    found = [tool for python in pythons for tool in python.parents[1].rglob("bl_pkg/cli/blender_ext.py")]
    return [str(pythons[0]), str(found[0])] if found else None


def test_the_extension_has_all_that_it_needs_but_numpy(packages: Path) -> None:
    (archive,) = (packages / "blender").glob("*.zip")
    with ZipFile(archive) as extension:
        names = set(extension.namelist())
        manifest = tomllib.loads(extension.read("blender_manifest.toml").decode())
        assert {"__init__.py", "worker.py", "LICENSE"} <= names
        assert {name.removeprefix("./") for name in manifest["wheels"]} == {n for n in names if n.endswith(".whl")}
    assert set(manifest["license"]) <= {f"SPDX:{name}" for name in LICENCES}
    assert manifest["platforms"] == [archive.stem.partition("-0.1.0-")[2].replace("_", "-")]
    wheels = [Path(name).name.partition("-")[0] for name in manifest["wheels"]]
    assert wheels == ["array_api_compat", "bodysense"]  # and NumPy is Blender's


def test_the_listing_is_that_of_blenders_tool(packages: Path, tmp_path: Path) -> None:
    ours = json.loads((packages / "blender" / "index.json").read_text())
    for entry in ours["data"]:
        content = (packages / "blender" / entry["archive_url"]).read_bytes()
        assert entry["archive_hash"] == "sha256:" + hashlib.sha256(content).hexdigest()
        assert entry["archive_size"] == len(content)
    tool = blender_tool()
    if tool is None:
        pytest.skip("needs a Python with the module bpy in BPY_PYTHONS")
    folder = shutil.copytree(packages / "blender", tmp_path / "repository")
    (folder / "index.json").unlink()
    environment = {**os.environ, "PYTHONPATH": ""}
    for archive in folder.glob("*.zip"):
        subprocess.run([*tool, "validate", archive], check=True, env=environment)
    subprocess.run([*tool, "server-generate", "--repo-dir", folder], check=True, env=environment)
    assert json.loads((folder / "index.json").read_text()) == ours


# ---- Unity -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def unity(packages: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The unpacked package."""
    folder = tmp_path_factory.mktemp("unity")
    (archive,) = packages.glob("*.tgz")
    with tarfile.open(archive) as package:
        package.extractall(folder, filter="data")
    assert [path.name for path in folder.iterdir()] == ["package"]
    return folder / "package"


def test_the_manifest_of_unitys_package(unity: Path) -> None:
    about = json.loads((unity / "package.json").read_text())
    assert re.fullmatch(r"[a-z0-9][a-z0-9-]*(\.[a-z0-9][a-z0-9-]*){2}", about["name"])
    assert about["version"] == bs.__version__ and re.fullmatch(r"\d{4}\.\d", about["unity"])
    assert about["displayName"] and about["description"] and about["license"] == "Apache-2.0"
    for sample in about["samples"]:
        assert sample["path"].startswith("Samples~/") and list((unity / sample["path"]).glob("*.cs"))
    for path in unity.rglob("*.asmdef"):
        given = json.loads(path.read_text())
        assert given["name"] == path.stem
        assert set(given.get("references", [])) <= {one.stem for one in unity.rglob("*.asmdef")}
        assert (path.parent.name == "Editor") == (given.get("includePlatforms") == ["Editor"])
    weights = unity / "StreamingAssets~" / "completion.safetensors"
    assert weights.read_bytes() == build_packages.WEIGHTS.read_bytes()
    source = (unity / "Runtime" / "Weights.cs").read_text()
    assert f'"Packages/{about["name"]}/{weights.relative_to(unity).as_posix()}"' in source


def test_every_asset_of_unity_has_its_meta_file(unity: Path) -> None:
    """Unity leaves out assets of packages that have none; folders whose name ends with ~ are not assets."""
    paths = [path for path in unity.rglob("*") if not any(p.endswith("~") for p in path.relative_to(unity).parts)]
    assets = {path for path in paths if path.suffix != ".meta"}
    metas = {path for path in paths if path.suffix == ".meta"}
    assert {path.with_name(path.name + ".meta") for path in assets} == metas
    texts = [path.read_text() for path in metas]
    guids = [re.findall(r"^guid: ([0-9a-f]{32})$", text, re.MULTILINE) for text in texts]
    assert all(len(found) == 1 for found in guids) and len({found[0] for found in guids}) == len(metas)


def test_each_library_of_unity_is_for_one_player(tmp_path: Path) -> None:
    """On all systems: two libraries must not serve the same player and processor."""
    yaml = pytest.importorskip("yaml", reason="needs the extra deploy")
    libraries = {name: tmp_path / name for name in build_packages.UNITY}
    for path in libraries.values():
        path.write_bytes(b"")
    files = build_packages.unity_files(libraries)
    served = []
    for target in build_wheels.TARGETS:
        if target.name not in build_packages.UNITY:
            continue
        meta = files[f"Runtime/Plugins/{target.name}/{build_packages.library_name(target)}.meta"].decode()
        plugin = yaml.safe_load(meta.replace("      : Any", "      null: Any"))["PluginImporter"]["platformData"]
        enabled = [(next(iter(one["first"].items())), one["second"]) for one in plugin if one["second"]["enabled"]]
        (editor, editor_settings), (player, player_settings) = enabled
        assert editor == ("Editor", "Editor") and player[0] == "Standalone"
        assert editor_settings["settings"]["CPU"] == player_settings["settings"]["CPU"]
        system = {"linux": "Linux", "macos": "OSX", "windows": "Windows"}[target.name.partition("-")[0]]
        assert editor_settings["settings"]["OS"] == system and player[1].startswith(system[:3])
        served.append((player[1], player_settings["settings"]["CPU"]))
    assert len(set(served)) == len(served) == 4


@pytest.mark.skipif(not shutil.which("mcs"), reason="needs Mono")
def test_the_scripts_of_unity_compile(unity: Path, tmp_path: Path) -> None:
    """Each assembly with the references that its definition gives, and the sample, against a model of Unity."""
    options = ("-unsafe", "-langversion:7.2", "-target:library")
    engine, runtime = tmp_path / "UnityEngine.dll", tmp_path / "BodySense.dll"
    steps = [
        (engine, [SHIMS], []),
        (runtime, sorted((unity / "Runtime").glob("*.cs")), [engine]),
        (tmp_path / "BodySense.Editor.dll", sorted((unity / "Editor").glob("*.cs")), [engine, runtime]),
        (tmp_path / "Sample.dll", sorted((unity / "Samples~").rglob("*.cs")), [engine, runtime]),
    ]
    for out, sources, references in steps:
        command = ["mcs", *options, f"-out:{out}", *(f"-r:{one}" for one in references), *map(str, sources)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr[-2000:]


def loaded(library: bytes, path: Path) -> ctypes.CDLL:
    """Write and load a library."""
    path.write_bytes(library)
    return ctypes.CDLL(str(path))


def test_the_library_of_unity_is_the_core(unity: Path) -> None:
    (path,) = [path for path in (unity / "Runtime" / "Plugins").rglob("*") if path.suffix in (".so", ".dll", ".dylib")]
    assert ctypes.CDLL(str(path)).bs_version() == 1


# ---- Godot -----------------------------------------------------------------------------------------------------------


def test_the_addon_names_files_that_exist(packages: Path) -> None:
    with ZipFile(next(packages.glob("bodysense-godot-*.zip"))) as addon:
        files = {name: addon.read(name) for name in addon.namelist()}
    folder = "addons/bodysense/"
    assert all(name.startswith(folder) for name in files)
    plugin = dict(re.findall(r'^(\w+)="(.*)"$', files[folder + "plugin.cfg"].decode(), re.MULTILINE))
    assert set(plugin) == {"name", "description", "author", "version", "script"}
    assert plugin["version"] == bs.__version__ and folder + plugin["script"] in files
    listed = re.findall(r'^[\w.]+ = "(bin/(.*)/.*)"$', files[folder + "bodysense.gdextension"].decode(), re.MULTILINE)
    assert listed == [
        (f"bin/{target.name}/{build_packages.library_name(target)}", target.name) for target in build_wheels.TARGETS
    ]
    here = [target.name for target in build_wheels.TARGETS if target.is_here]
    assert {place for place, name in listed if name in here} == {
        name.removeprefix(folder) for name in files if name.startswith(folder + "bin/")
    }


class Variant(ctypes.Structure):
    """A value of the model: `index` of a Python value, which a typed value in memory holds, too."""

    _fields_ = [("kind", ctypes.c_uint64), ("index", ctypes.c_uint64), ("unused", ctypes.c_uint64)]


POINTER, INT64, BYTE = ctypes.c_void_p, ctypes.c_int64, ctypes.c_uint8
# Numbers of Godot: bool, int, float, Vector3, Quaternion, Transform3D. Other kinds: 4 String, 27 Dictionary, 29 bytes.
NUMBERS = {1: (BYTE, 1), 2: (INT64, 1), 3: (ctypes.c_double, 1), 9: (ctypes.c_float, 3), 15: (ctypes.c_float, 4)}
NUMBERS[18] = (ctypes.c_float, 12)


class Godot:
    """A model of Godot's documented C interface, of the part that the add-on uses."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self.values: list[Any] = []
        self.errors: list[str] = []
        self.methods: dict[str, tuple[Any, ...]] = {}
        self.kept: list[Any] = []
        self.instance: int | None = None
        self.create: Callable[[], int | None] = lambda: None
        self.destroy: Callable[[], None] = lambda: None
        functions = self.functions()
        getter = ctypes.CFUNCTYPE(POINTER, ctypes.c_char_p)
        self.get = getter(lambda name: ctypes.cast(functions[name.decode()], POINTER).value)
        self.kept += functions.values()
        start = (POINTER * 4)()
        library.bodysense_init.restype = BYTE
        assert library.bodysense_init(self.get, POINTER(1), start)
        assert ctypes.cast(start, ctypes.POINTER(ctypes.c_int32))[0] == 2
        assert start[2] is not None
        ctypes.CFUNCTYPE(None, POINTER, ctypes.c_int32)(start[2])(None, 2)
        assert self.create() == 77

    def put(self, at: int, value: Any) -> None:
        """Write a new opaque value."""
        self.values.append(value)
        ctypes.c_uint64.from_address(at).value = len(self.values)

    def held(self, at: int | None) -> Any:
        """Return an opaque value."""
        assert at is not None
        return self.values[ctypes.c_uint64.from_address(at).value - 1]

    def write(self, at: int, kind: int, value: Any) -> None:
        """Write a typed value."""
        if kind in NUMBERS:
            number, count = NUMBERS[kind]
            (number * count).from_address(at)[:] = [value] if count == 1 else value
        else:
            self.put(at, value)

    def read(self, at: int, kind: int) -> Any:
        if kind not in NUMBERS:
            return self.held(at)
        number, count = NUMBERS[kind]
        found = list((number * count).from_address(at))
        return found if count > 1 else found[0]

    def to_variant(self, at: int, kind: int, value: Any) -> None:
        self.values.append(value)
        variant = Variant.from_address(at)
        variant.kind, variant.index = kind, len(self.values)

    def of_variant(self, at: int) -> Any:
        return self.values[Variant.from_address(at).index - 1]

    def functions(self) -> dict[str, Any]:
        def of(result: Any, *kinds: Any) -> Callable[[Any], Any]:
            return ctypes.CFUNCTYPE(result, *kinds)

        def text(string: int, to: int, size: int) -> int:
            name = self.held(string).encode()
            ctypes.memmove(to, name, min(len(name), size))
            return len(name)

        def call(own: int, name: int, arguments: int, count: int, result: int, error: int) -> None:
            assert self.held(name) == "size"
            self.to_variant(result, 2, len(self.of_variant(own)))

        def first(own: int, at: int, valid: int) -> int:
            self.to_variant(at, 2, 0)
            return len(self.of_variant(own)) > 0

        def following(own: int, at: int, valid: int) -> int:
            self.to_variant(at, 2, self.of_variant(at) + 1)
            return self.of_variant(at) < len(self.of_variant(own))

        def key(own: int, at: int, to: int, valid: int) -> None:
            name = list(self.of_variant(own))[self.of_variant(at)]
            self.to_variant(to, 4 if isinstance(name, str) else 2, name)

        def value(own: int, key: int, to: int, valid: int) -> None:
            self.to_variant(to, 18, self.of_variant(own)[self.of_variant(key)])

        def byte(array: int, index: int) -> int:
            content = ctypes.create_string_buffer(self.held(array), len(self.held(array)))
            self.kept.append(content)
            return ctypes.addressof(content) + index

        def set_instance(thing: int, name: int, instance: int) -> None:
            assert thing == 77 and self.held(name) == "BodysenseBody"
            self.instance = instance

        def register(library: int, name: int, parent: int, info: int) -> None:
            assert (self.held(name), self.held(parent)) == ("BodysenseBody", "Node")
            create, destroy = (POINTER.from_address(info + 8 * k).value for k in (12, 13))
            self.create = lambda: of(POINTER, POINTER)(create)(None)
            self.destroy = lambda: of(None, POINTER, POINTER)(destroy)(None, self.instance)

        def register_method(library: int, owner: int, info: int) -> None:
            name, userdata, plain, typed = (POINTER.from_address(info + 8 * k).value for k in range(4))
            result = POINTER.from_address(info + 40).value or 0
            self.methods[self.held(name)] = userdata, plain, typed, ctypes.c_int32.from_address(result).value

        def from_type(kind: int) -> int:
            made = of(None, POINTER, POINTER)(lambda to, at: self.to_variant(to, kind, self.read(at, kind)))
            self.kept.append(made)
            return ctypes.cast(made, POINTER).value or 0

        def to_type(kind: int) -> int:
            made = of(None, POINTER, POINTER)(lambda to, at: self.write(to, kind, self.of_variant(at)))
            self.kept.append(made)
            return ctypes.cast(made, POINTER).value or 0

        forgets = of(None, POINTER)(lambda at: None)
        destroyer = ctypes.cast(forgets, POINTER).value or 0
        p = POINTER
        return {
            "string_name_new_with_latin1_chars": of(None, p, ctypes.c_char_p, BYTE)(
                lambda to, name, static: self.put(to, name.decode())
            ),
            "string_new_with_utf8_chars": of(None, p, ctypes.c_char_p)(lambda to, name: self.put(to, name.decode())),
            "string_to_utf8_chars": of(INT64, p, p, INT64)(text),
            "variant_destroy": forgets,
            "variant_get_type": of(ctypes.c_int32, p)(lambda at: Variant.from_address(at).kind),
            "variant_call": of(None, p, p, p, INT64, p, p)(call),
            "variant_iter_init": of(BYTE, p, p, p)(first),
            "variant_iter_next": of(BYTE, p, p, p)(following),
            "variant_iter_get": of(None, p, p, p, p)(key),
            "variant_get_keyed": of(None, p, p, p, p)(value),
            "packed_byte_array_operator_index_const": of(p, p, INT64)(byte),
            "classdb_construct_object": of(p, p)(lambda name: 77),
            "object_set_instance": of(None, p, p, p)(set_instance),
            "classdb_register_extension_class2": of(None, p, p, p, p)(register),
            "classdb_register_extension_class_method": of(None, p, p, p)(register_method),
            "classdb_unregister_extension_class": of(None, p, p)(lambda library, name: None),
            "print_error": of(None, ctypes.c_char_p, ctypes.c_char_p, ctypes.c_char_p, ctypes.c_int32, BYTE)(
                lambda said, function, file, line, notify: self.errors.append(said.decode())
            ),
            "get_variant_from_type_constructor": of(p, ctypes.c_int32)(from_type),
            "get_variant_to_type_constructor": of(p, ctypes.c_int32)(to_type),
            "variant_get_ptr_destructor": of(p, ctypes.c_int32)(lambda kind: destroyer),
        }

    def typed(self, name: str, *arguments: tuple[int, Any]) -> Any:
        """Call a method with typed arguments (kind, value), as compiled scripts do."""
        userdata, _, function, result = self.methods[name]
        memory = [(ctypes.c_uint64 * 8)() for _ in arguments]
        for place, (kind, value) in zip(memory, arguments, strict=True):
            self.write(ctypes.addressof(place), kind, value)
        given = (POINTER * max(len(memory), 1))(*map(ctypes.addressof, memory))
        made = (ctypes.c_uint64 * 8)()
        ctypes.CFUNCTYPE(None, POINTER, POINTER, POINTER, POINTER)(function)(
            userdata, self.instance, ctypes.addressof(given), ctypes.addressof(made)
        )
        return self.read(ctypes.addressof(made), result)

    def plain(self, name: str, *arguments: tuple[int, Any]) -> tuple[Any, int]:
        """Call a method with variants, as other scripts do; return its result and the error of the call."""
        userdata, function, _, _ = self.methods[name]
        memory = [Variant() for _ in arguments]
        for place, (kind, value) in zip(memory, arguments, strict=True):
            self.to_variant(ctypes.addressof(place), kind, value)
        given = (POINTER * max(len(memory), 1))(*map(ctypes.addressof, memory))
        made, error = Variant(), (ctypes.c_int32 * 3)()
        ctypes.CFUNCTYPE(None, POINTER, POINTER, POINTER, INT64, POINTER, POINTER)(function)(
            userdata,
            self.instance,
            ctypes.addressof(given),
            len(memory),
            ctypes.addressof(made),
            ctypes.addressof(error),
        )
        return (self.values[made.index - 1] if made.index else None), error[0]


@pytest.fixture(scope="module")
def godot(packages: Path, tmp_path_factory: pytest.TempPathFactory) -> Godot:
    with ZipFile(next(packages.glob("bodysense-godot-*.zip"))) as addon:
        (name,) = [name for name in addon.namelist() if "/bin/" in name]
        library = loaded(addon.read(name), tmp_path_factory.mktemp("godot") / Path(name).name)
    return Godot(library)


def test_the_node_of_godot_completes_what_python_completes(godot: Godot) -> None:
    """By typed calls and by calls with variants, a scaled basis included."""
    assert set(godot.methods) == {"start", "step", "root_position", "rotation_of", "point"}
    assert godot.typed("start", (29, build_packages.WEIGHTS.read_bytes()), (3, 1.7))
    whole = packaged_performance()
    seen = observe(whole.pose[:40], whole.time[:40], THREE_POINT)
    tracker = bs.Tracker(bs.Person(height=1.7))
    expected = tracker.step(seen, tracker.start())[0].pose
    skeleton = expected.skeleton
    points, _ = bs.forward_kinematics(expected)
    turned = quaternion_to_matrix(seen.rotation)
    for k in range(len(seen)):
        scale = 2.0 if k % 2 else 1.0
        tracked = {name: [*(scale * turned[k, p]).ravel(), *seen.position[k, p]] for p, name in enumerate(seen.points)}
        arguments = (3, float(seen.time[k])), (27, tracked)
        assert godot.typed("step", *arguments) if k % 3 else godot.plain("step", *arguments) == (1, 0)
    np.testing.assert_allclose(godot.typed("root_position"), expected.root_position[-1], atol=1e-4)
    for joint in ("pelvis", "left_elbow", "right_knee", "left_index2"):
        found = np.array(godot.typed("rotation_of", (4, joint)))[[3, 0, 1, 2]]
        np.testing.assert_allclose(found, expected.rotation[-1, skeleton.index(joint)], atol=1e-3)
        np.testing.assert_allclose(
            godot.plain("point", (4, joint))[0], np.asarray(points)[-1, skeleton.index(joint)], atol=1e-3
        )


def test_the_node_of_godot_refuses_what_is_wrong(godot: Godot) -> None:
    identity = [1.0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 1.6, 0]
    assert godot.typed("start", (29, build_packages.WEIGHTS.read_bytes()), (3, 0.0))
    for tracked in ({"nose": identity}, {"n" * 200: identity}, {3: identity}):
        godot.errors.clear()
        assert not godot.typed("step", (3, 0.1), (27, tracked))
        assert len(godot.errors) == 1
    assert godot.typed("step", (3, 0.2), (27, {}))
    assert godot.plain("step", (3, 0.3))[1] == 4  # too few arguments
    assert godot.plain("step", (4, "a"), (27, {}))[1] == 2  # an argument of another type
    assert not godot.typed("start", (29, b"no weights"), (3, 1.7))
    assert not godot.typed("step", (3, 0.4), (27, {"head": identity}))  # nothing was started
    assert not godot.typed("start", (29, b""), (3, 1.7))
    godot.destroy()
