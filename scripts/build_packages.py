"""Build what ecosystems install, from one machine: python scripts/build_packages.py --out dist/packages

    blender/                             the extension, an archive for each system, and `index.json`: a repository
    org.bodysense.body-VERSION.tgz       the package for Unity
    bodysense-godot-VERSION.zip          the add-on for Godot

Needs the packages `build` and `ziglang`, which brings the compiler for all systems, and pip with a package index. Equal
sources give equal archives. `tests/extras/test_packages.py` checks them by the rules of each ecosystem.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import io
import json
import subprocess
import sys
import tarfile
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from build_wheels import TARGETS, Target, build_library, build_wheel, native_wheel, require_zig

from bodysense.cli.show import write_numbers

ROOT = Path(__file__).resolve().parents[1]
EXTRAS, LICENSE = ROOT / "extras", ROOT / "LICENSE"
WEIGHTS = ROOT / "src" / "bodysense" / "weights" / "completion.safetensors"
PURE = "array-api-compat"  # the wheel beside ours that an extension needs; NumPy is Blender's
BLENDER = {  # Blender's names of systems
    "linux-x86_64": "linux-x64",
    "macos-x86_64": "macos-x64",
    "macos-arm64": "macos-arm64",
    "windows-x86_64": "windows-x64",
}
UNITY = {  # Unity's names: player, system of the editor, processor
    "linux-x86_64": ("Linux64", "Linux", "x86_64"),
    "macos-x86_64": ("OSXUniversal", "OSX", "x86_64"),
    "macos-arm64": ("OSXUniversal", "OSX", "ARM64"),
    "windows-x86_64": ("Win64", "Windows", "x86_64"),
}
PLAYERS = ("Linux64", "OSXUniversal", "Win", "Win64")
Files = Mapping[str, bytes]  # path in an archive → content
_DATE = (2020, 1, 1, 0, 0, 0)


def library_name(target: Target, name: str = "bodysense") -> str:
    """Return the file name of a library on a system."""
    return f"{'' if target.ending == '.dll' else 'lib'}{name}{target.ending}"


def write_zip(path: Path, files: Files) -> None:
    """Write a .zip."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:
        for name, content in sorted(files.items()):
            info = ZipInfo(name, _DATE)
            info.external_attr = 0o644 << 16
            archive.writestr(info, content, ZIP_DEFLATED)


def write_tgz(path: Path, files: Files) -> None:
    """Write a .tgz, as `npm pack` does: all files below `package/`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with (
        path.open("wb") as out,
        gzip.GzipFile("", "wb", mtime=0, fileobj=out) as packed,
        tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as archive,
    ):
        for name, content in sorted(files.items()):
            info = tarfile.TarInfo(f"package/{name}")
            info.size, info.mode = len(content), 0o644
            archive.addfile(info, io.BytesIO(content))


def tree(folder: Path, endings: Sequence[str]) -> dict[str, bytes]:
    """Return the files of a folder with one of these endings, by their path in it."""
    found = [path for path in sorted(folder.rglob("*")) if path.suffix in endings or path.name == "LICENSE"]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


# ---- Blender ---------------------------------------------------------------------------------------------------------


def blender_manifest(platform: str, wheels: Sequence[str]) -> str:
    """Return the manifest of a system's archive."""
    text = (EXTRAS / "blender" / "blender_manifest.toml").read_text(encoding="utf-8")
    places = json.dumps([f"./wheels/{name}" for name in wheels])
    head, table, rest = text.partition("\n[permissions]")
    return f'{head}platforms = ["{platform}"]\nwheels = {places}\n{table}{rest}'


def blender_entry(manifest: str, archive: Path) -> dict[str, object]:
    """Return the entry of an archive in the listing of a repository."""
    content = archive.read_bytes()
    fields = {name: value for name, value in tomllib.loads(manifest).items() if name not in ("wheels", "build")}
    place = {"archive_size": len(content), "archive_hash": f"sha256:{hashlib.sha256(content).hexdigest()}"}
    return {**fields, "python_versions": ["3"], **place, "archive_url": f"./{archive.name}"}


def build_blender(targets: Sequence[Target], out: Path, work: Path) -> list[Path]:
    """Write the extension for each system that Blender has, and the listing."""
    constraints = ("-c", str(ROOT / "constraints.txt"))
    pip = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--only-binary", ":all:", *constraints]
    subprocess.run([*pip, "-d", str(work / "pure"), PURE], check=True)
    pure, native = next((work / "pure").glob("*.whl")), native_wheel(work / "native")
    code, archives, listed = tree(EXTRAS / "blender", (".py",)), [], []
    for target in targets:
        if target.name not in BLENDER:
            continue
        built = {name: build_library(target, work / f"{target.name}{name}", name) for name in ("_core", "_fbx")}
        wheels = [pure, build_wheel(native, built, target, work)]
        manifest = blender_manifest(BLENDER[target.name], [wheel.name for wheel in wheels])
        version = tomllib.loads(manifest)["version"]
        archive = out / "blender" / f"bodysense-{version}-{BLENDER[target.name].replace('-', '_')}.zip"
        inside = {f"wheels/{wheel.name}": wheel.read_bytes() for wheel in wheels}
        write_zip(archive, {**code, **inside, "blender_manifest.toml": manifest.encode()})
        archives.append(archive)
        listed.append(blender_entry(manifest, archive))
    listing = {"version": "v1", "blocklist": [], "data": listed}
    (out / "blender" / "index.json").write_text(json.dumps(listing, indent=1) + "\n", encoding="utf-8")
    return archives


# ---- Unity -----------------------------------------------------------------------------------------------------------


def unity_meta(package: str, path: str, *, folder: bool = False, plugin: tuple[str, str, str] | None = None) -> bytes:
    """Return the .meta file of an asset: an identifier made of its path, and the systems of a library."""
    guid = hashlib.md5(f"{package}/{path}".encode(), usedforsecurity=False).hexdigest()
    lines = ["fileFormatVersion: 2", f"guid: {guid}"]
    if folder:
        lines += ["folderAsset: yes", "DefaultImporter:", "  externalObjects: {}"]
    if plugin is not None:
        player, system, processor = plugin
        lines += ["PluginImporter:", "  externalObjects: {}", "  serializedVersion: 2", "  isOverridable: 0"]
        lines += ["  platformData:", *_platform(": Any", False, {f"Exclude {p}": int(p != player) for p in PLAYERS})]
        lines += _platform("Any: ", False, {})
        lines += _platform("Editor: Editor", True, {"CPU": processor, "DefaultValueInitialized": "true", "OS": system})
        lines += _platform(f"Standalone: {player}", True, {"CPU": processor})
    return ("\n".join(lines) + "\n").encode()


def _platform(name: str, enabled: bool, settings: Mapping[str, object]) -> list[str]:
    given = [f"        {key}: {value}" for key, value in settings.items()]
    head = ["  - first:", f"      {name}", "    second:", f"      enabled: {int(enabled)}"]
    return [*head, *(["      settings:", *given] if given else ["      settings: {}"])]


def unity_files(libraries: Mapping[str, Path]) -> dict[str, bytes]:
    """Return the files of the package, from the core's library for each of Unity's systems."""
    files = tree(EXTRAS / "unity", (".cs", ".asmdef", ".json", ".md"))
    package = json.loads(files["package.json"])["name"]
    files["LICENSE.md"] = LICENSE.read_bytes()
    files[f"StreamingAssets~/{WEIGHTS.name}"] = WEIGHTS.read_bytes()
    plugins = {}
    for target in TARGETS:
        if target.name in libraries and target.name in UNITY:
            place = f"Runtime/Plugins/{target.name}/{library_name(target)}"
            files[place], plugins[place] = libraries[target.name].read_bytes(), UNITY[target.name]
    shown = [path for path in files if "~/" not in path]
    folders = {parent.as_posix() for path in shown for parent in Path(path).parents if parent.name}
    metas = {f"{path}.meta": unity_meta(package, path, plugin=plugins.get(path)) for path in shown}
    return {**files, **metas, **{f"{path}.meta": unity_meta(package, path, folder=True) for path in folders}}


def build_unity(targets: Sequence[Target], out: Path, work: Path) -> list[Path]:
    """Write the package of Unity's package manager."""
    wanted = [target for target in targets if target.name in UNITY]
    files = unity_files({target.name: build_library(target, work / f"unity-{target.name}") for target in wanted})
    about = json.loads(files["package.json"])
    archive = out / f"{about['name']}-{about['version']}.tgz"
    write_tgz(archive, files)
    return [archive]


# ---- Godot -----------------------------------------------------------------------------------------------------------


def build_godot(targets: Sequence[Target], out: Path, work: Path) -> list[Path]:
    """Write the add-on, with a library that has the core in it for each system."""
    source = EXTRAS / "godot"
    files = {
        f"addons/bodysense/{name}": content for name, content in tree(source, (".gd", ".cfg", ".gdextension")).items()
    }
    files["addons/bodysense/LICENSE"] = LICENSE.read_bytes()
    files[f"addons/bodysense/{WEIGHTS.name}"] = WEIGHTS.read_bytes()
    for target in targets:
        library = build_library(target, work / f"godot-{target.name}", more=[source / "bodysense_godot.c"])
        files[f"addons/bodysense/bin/{target.name}/{library_name(target)}"] = library.read_bytes()
    version = files["addons/bodysense/plugin.cfg"].decode().partition('version="')[2].partition('"')[0]
    archive = out / f"bodysense-godot-{version}.zip"
    write_zip(archive, files)
    return [archive]


BUILDERS: dict[str, Callable[[Sequence[Target], Path, Path], list[Path]]] = {
    "blender": build_blender,
    "unity": build_unity,
    "godot": build_godot,
}


def main() -> None:
    """Build the packages and print their sizes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    names = [target.name for target in TARGETS]
    parser.add_argument("packages", nargs="*", metavar="PACKAGE", help=f"{', '.join(BUILDERS)}; all if omitted")
    parser.add_argument("--out", type=Path, default=ROOT / "dist" / "packages", help="folder of the packages")
    parser.add_argument("--targets", nargs="+", choices=names, default=names, help="systems to build for")
    parser.add_argument("--json", type=Path, help="file to write the sizes into")
    given = parser.parse_args()
    if unknown := sorted(set(given.packages) - set(BUILDERS)):
        raise SystemExit(f"{', '.join(unknown)}: no such package; the packages are {', '.join(BUILDERS)}")
    require_zig()
    targets = [target for target in TARGETS if target.name in given.targets]
    sizes = {}
    with TemporaryDirectory(prefix="bodysense-") as work:
        for name in given.packages or BUILDERS:
            for archive in BUILDERS[name](targets, given.out, Path(work)):
                megabytes = archive.stat().st_size / 1e6
                sizes[f"{name}_mb"] = max(megabytes, sizes.get(f"{name}_mb", 0.0))
                print(f"{archive}: {megabytes:.1f} MB", flush=True)
    write_numbers(given.json, sizes)


if __name__ == "__main__":
    main()
