"""The layers of docs/architecture.md: allowed imports, and packages that the run time never imports."""

from __future__ import annotations

import ast
import subprocess
import sys

from import_graph import MODULES, SOURCES, circles, imported, ours, package, parsed

MAY_IMPORT = {  # which other packages one may import
    "bodysense": set(),
    "bodysense_live": {"bodysense"},
    "bodysense_conform": {"bodysense"},
    "bodysense_lab": {"bodysense", "bodysense_live", "bodysense_conform"},  # for its benchmarks
}
FLOORS: dict[str, float] = {
    "errors": -2,
    "files": -1,
    "ranges": -1,  # of options
    "weights": -0.9,
    "arrays": -0.5,
    "parallel": -0.5,
    "tensors": -0.5,
    "geometry": -0.3,
    "body": 0,
    "observing": 1,
    "quality": 1,
    "io": 2,
    "tracking": 2,
    "devices": 3,
    "demo": 3,
    "pictures": 4,
    "sources": 5,
    "takes": 6,
    "cli": 8,
    "__main__": 9,
}
LIBRARY = "bodysense"  # imports each public name when it is first used
LIGHT = {"numpy", "array_api_compat", "tyro", "rich"}  # what run-time modules may import at once
LIGHT_LIVE = {*LIGHT, "flatbuffers"}  # the same for the server: 3 ms, for the code that flatc writes


def room(module: str) -> str:
    return module.partition(".")[2].partition(".")[0]


def test_every_package_has_import_rules() -> None:
    assert set(SOURCES) == set(MAY_IMPORT)
    assert {package(module) for module in MODULES} == set(MAY_IMPORT)


def test_every_module_of_the_library_has_a_floor() -> None:
    modules = [module for module in MODULES if package(module) == "bodysense" and module != LIBRARY]
    assert not [module for module in modules if room(module) not in FLOORS]


def test_imported_modules_exist() -> None:
    offenders = [
        f"{module} imports {other}"
        for module in MODULES
        for other in ours(imported(module, when="any"))
        if other not in MODULES
    ]
    assert not offenders


def test_modules_of_the_library_import_from_lower_floors_only() -> None:
    offenders = []
    for module in MODULES:
        if package(module) != "bodysense" or module == LIBRARY:
            continue
        for other in ours(imported(module, when="any")) - {LIBRARY}:
            if room(other) != room(module) and FLOORS.get(room(other), 10) >= FLOORS[room(module)]:
                offenders.append(f"{module} imports {other}")
    assert not offenders


def test_packages_import_only_allowed_packages() -> None:
    """The library and its commands import no other package; other packages import those of `MAY_IMPORT`."""
    offenders = [
        f"{module} imports {other}"
        for module in MODULES
        for other in ours(imported(module, when="any"))
        if package(other) != package(module) and package(other) not in MAY_IMPORT[package(module)]
    ]
    assert not offenders


def test_only_commands_import_commands() -> None:
    offenders = [
        f"{module} imports {other}"
        for module in MODULES
        if room(module) not in ("commands", "command", "cli", "__main__")
        for other in ours(imported(module, when="any"))
        if room(other) in ("commands", "command", "cli")
    ]
    assert not offenders


def test_the_commands_of_the_laboratory_load_without_the_server_and_the_referee() -> None:
    code = (
        "import sys; sys.modules.update(bodysense_live=None, bodysense_conform=None)\n"
        "from tyro.extras import SubcommandApp\n"
        "from bodysense_lab.commands import add_commands\n"
        "add_commands(SubcommandApp(), SubcommandApp())"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_no_modules_import_each_other() -> None:
    """Modules have an order in which each imports only from earlier ones, inside functions, too."""
    arrows = {f"{one} → {other}" for one, other in circles()}
    assert not arrows, f"in circles: {', '.join(sorted(arrows))}"


def heavy(module: str, seen: set[str]) -> set[str]:
    """Return the packages outside the standard library that the import of a module loads."""
    if module in seen:
        return set()
    seen.add(module)
    names = imported(module, when="import")
    packages = {".".join(module.split(".")[:k]) for k in range(1, module.count(".") + 1)}
    outside = {name.split(".")[0] for name in names - ours(names)} - sys.stdlib_module_names
    return outside.union(*(heavy(other, seen) for other in (ours(names) | packages) & set(MODULES)))


def test_no_two_classes_share_a_name() -> None:
    found: dict[str, list[str]] = {}
    for module in MODULES:
        if module.endswith("_generated"):  # by flatc, from schemas that share names
            continue
        for node in ast.walk(parsed(module)):
            if isinstance(node, ast.ClassDef):
                found.setdefault(node.name, []).append(module)
    assert not {name: modules for name, modules in found.items() if len(modules) > 1}


def test_run_time_modules_import_only_light_packages() -> None:
    light = {"bodysense": LIGHT, "bodysense_conform": LIGHT, "bodysense_live": LIGHT_LIVE}
    heavier = {name: heavy(name, set()) - light[package(name)] for name in MODULES if package(name) in light}
    assert not {name: packages for name, packages in heavier.items() if packages}
    assert heavy(LIBRARY, set()) == set()


def test_the_check_finds_heavy_packages() -> None:
    assert "torch" in heavy("bodysense_lab.papers.unoc.network.network", set())
    assert {"torch", "onnx"} <= heavy("bodysense_lab.papers.unoc.network.export", set())


def test_the_command_starts_without_the_libraries_of_training() -> None:
    names = modules_after("import bodysense, bodysense.cli.application; bodysense.track, bodysense.Tracker")
    assert "tyro" in names
    assert not names & {"torch", "zarr", "dask", "onnx", "scipy", "onnxruntime", "matplotlib"}


def test_the_tracker_starts_with_numpy_and_little_else() -> None:
    """The set of modules is checked, because the import time differs among machines."""
    added = modules_after("import bodysense; bodysense.Tracker") - modules_after("import numpy")
    packages = {name.partition(".")[0] for name in added} - sys.stdlib_module_names
    assert packages == {"bodysense", "array_api_compat"}
    assert not added & {"importlib.resources", "tempfile", "zipfile", "tomllib", "bodysense.body.hands.glove"}
    code = [name for name in added if name in MODULES and MODULES[name].name != "__init__.py"]
    assert "bodysense.tracking.tracker" in code and len(code) < 17


def test_a_motion_is_tracked_without_the_solver_of_gloves() -> None:
    code = "clip = bs.demo.packaged_performance(); clip = bs.Clip('', clip.pose[:3], clip.frame_rate)"
    names = modules_after(f"import bodysense as bs; {code}; bs.track(clip, device='three_point')")
    assert "bodysense.takes.take" in names
    assert not [name for name in names if name.startswith("bodysense.devices.gloves")]


def modules_after(code: str) -> set[str]:
    """Names of the modules that a fresh Python has imported after some code."""
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"], capture_output=True, text=True, check=True
    )
    return set(done.stdout.split())
