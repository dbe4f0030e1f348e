"""Other languages' copies of the core's header: structs, enum and functions as the C compiler has them."""

from __future__ import annotations

import ctypes
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

from bodysense.body.skeleton import default_skeleton
from bodysense.tracking import core

ROOT = Path(__file__).parents[2]
HEADER, EXTRAS = ROOT / "core" / "include" / "bodysense.h", ROOT / "extras"
NATIVE = (EXTRAS / "unity" / "Runtime" / "BodySenseNative.cs").read_text(encoding="utf-8")
STRUCTS = ("bs_length", "bs_mount", "bs_person", "bs_settings", "bs_observation", "bs_estimate")
CONSTANTS = ("BS_VERSION", "BS_JOINTS", "BS_POINTS", "BS_CONTACTS", "BS_LENGTHS")
SIZES = {"int": 4, "byte": 1, "double": 8}  # of C#'s plain types
Layout = dict[str, tuple[int, int]]  # of a struct: member → offset and size, bytes; "" → 0 and the whole size


def header() -> str:
    """The header without comments."""
    return re.sub(r"/\*.*?\*/", "", HEADER.read_text(encoding="utf-8"), flags=re.DOTALL)


def members(struct: str) -> list[str]:
    """Names of a struct's members, in order."""
    found = re.search(rf"typedef struct {struct} {{(.*?)}} {struct};", header(), re.DOTALL)
    assert found is not None, struct
    names = []
    for declaration in found[1].split(";")[:-1]:
        names += [re.search(r"(\w+)\s*(\[.*)?$", part.strip())[1] for part in declaration.split(",")]  # pyright: ignore[reportOptionalSubscript]
    return names


def results() -> list[str]:
    """Names of the enum's values, in order."""
    return re.findall(
        r"\b(BS_[A-Z_]+)\b(?: = 0)?(?=,|\s*})", header().partition("typedef enum bs_result")[2].partition(";")[0]
    )


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[int]]:
    """Offset and size of each member, size of each struct and value of each name, from the C compiler."""
    lines = []
    for struct in STRUCTS:
        lines.append(f'printf("{struct} 0 %zu\\n", sizeof({struct}));')
        for name in members(struct):
            size = f"sizeof((({struct} *)0)->{name})"
            lines.append(f'printf("{struct}.{name} %zu %zu\\n", offsetof({struct}, {name}), {size});')
    lines += [f'printf("{name} %d\\n", (int){name});' for name in (*results(), *CONSTANTS)]
    folder = tmp_path_factory.mktemp("layout")
    source = folder / "layout.c"
    source.write_text('#include <stdio.h>\n#include "bodysense.h"\nint main(void) {\n' + "\n".join(lines) + "\n}\n")
    subprocess.run(["cc", "-std=c11", f"-I{HEADER.parent}", str(source), "-o", str(folder / "layout")], check=True)
    done = subprocess.run([folder / "layout"], capture_output=True, text=True, check=True)
    return {name: [int(value) for value in rest] for name, *rest in map(str.split, done.stdout.splitlines())}


def layout_of(struct: str, compiled: dict[str, list[int]]) -> Layout:
    found = {name.partition(".")[2]: values for name, values in compiled.items() if name.partition(".")[0] == struct}
    return {name: (offset, size) for name, (offset, size) in found.items()}


def csharp_layouts() -> dict[str, Layout]:
    """The structs of the C# listing, laid out as `LayoutKind.Sequential` does."""
    found: dict[str, Layout] = {}
    kinds = {name: (size, size) for name, size in SIZES.items()}  # size and alignment
    for name, body in re.findall(
        r"LayoutKind\.Sequential\)\]\s+public unsafe struct (\w+)\s+{(.*?)\n    }", NATIVE, re.DOTALL
    ):
        place, alignment, layout = 0, 1, {}
        for line in filter(None, map(str.strip, body.split(";"))):
            match = re.fullmatch(
                r"(?:\[MarshalAs\(UnmanagedType\.ByValArray, SizeConst = (\d+)\)\] )?"
                r"public (?:fixed )?(\w+)(\*?|\[\]) ([\w, ]+?)(?:\[([\d *]+)\])?",
                line,
            )
            assert match is not None, line
            size, aligned = (8, 8) if match[3] == "*" else kinds[match[2]]
            count = int(match[1] or 1)
            for factor in (match[5] or "1").split("*"):
                count *= int(factor)
            for member in match[4].split(", "):
                place = -(-place // aligned) * aligned
                layout[member] = (place, size * count)
                place, alignment = place + size * count, max(alignment, aligned)
        whole = -(-place // alignment) * alignment
        kinds[name] = (whole, alignment)
        found[snake(name)] = {"": (0, whole)} | layout
    return found


def snake(name: str) -> str:
    """BsPerson → bs_person."""
    return re.sub(r"(?<!^)([A-Z])", r"_\1", name).lower()


@dataclass(frozen=True)
class Function:
    """Kinds of a function's result and parameters: 'int', 'size', 'double', 'pointer', 'result', 'settings', 'void'."""

    result: str
    parameters: tuple[str, ...]


_C_KINDS = {"int": "int", "size_t": "size", "double": "double", "void": "void", "bs_result": "result"}
_CSHARP_KINDS = {"int": "int", "UIntPtr": "size", "double": "double", "void": "void", "BsResult": "result"}


def kind(text: str, kinds: dict[str, str]) -> str:
    """The kind of a type, without the name of what has it."""
    text = text.removeprefix("const ").strip()
    if "*" in text or text.startswith("ref ") or text == "IntPtr":
        return "pointer"
    return kinds.get(text, "settings" if snake(text.replace("_", "")) in ("bssettings", "bs_settings") else text)


def functions(text: str, pattern: str, kinds: dict[str, str]) -> dict[str, Function]:
    found = {}
    for result, name, given in re.findall(pattern, text):
        rows = (
            []
            if given.strip() in ("", "void")
            else [re.sub(r"\w+$", "", " ".join(row.split())) for row in given.split(",")]
        )
        found[name] = Function(kind(result, kinds), tuple(kind(row.strip(), kinds) for row in rows))
    return found


def c_functions() -> dict[str, Function]:
    return functions(header(), r"\n((?:const )?\w+ ?\*?)\s*\b(bs_\w+)\(([^)]*)\);", _C_KINDS)


def test_structs_of_csharp(compiled: dict[str, list[int]]) -> None:
    found = csharp_layouts()
    assert found.keys() == set(STRUCTS)
    for struct in STRUCTS:
        assert found[struct] == layout_of(struct, compiled), struct


def test_functions_of_csharp() -> None:
    found = functions(NATIVE, r"static extern ([\w*]+) (bs_\w+)\(([^)]*)\);", _CSHARP_KINDS)
    assert len(found) == 17
    assert found == c_functions()


def test_results_and_version_of_csharp(compiled: dict[str, list[int]]) -> None:
    listed = re.findall(r"(BS_[A-Z_]+)", NATIVE.partition("enum BsResult")[2].partition("}")[0])
    assert {name: [value] for value, name in enumerate(listed)} == {name: compiled[name] for name in results()}
    assert f"Version = {compiled['BS_VERSION'][0]};" in NATIVE


def test_structs_of_python(compiled: dict[str, list[int]]) -> None:
    structs = {
        "bs_length": core.Length,
        "bs_mount": core.Mount,
        "bs_person": core.PersonStruct,
        "bs_settings": core.SettingsStruct,
        "bs_observation": core.ObservationStruct,
    }
    for name, struct in structs.items():
        fields = {row[0]: getattr(struct, row[0]) for row in struct._fields_}
        found = {name: (field.offset, field.size) for name, field in fields.items()}
        assert {"": (0, ctypes.sizeof(struct)), **found} == layout_of(name, compiled), name
    assert list(core.ESTIMATE) == members("bs_estimate")
    numbers = (core.VERSION, core.JOINTS, core.POINTS, core.CONTACTS, core.LENGTHS)
    assert {name: [value] for name, value in zip(CONSTANTS, numbers, strict=True)} == {
        n: compiled[n] for n in CONSTANTS
    }


def test_functions_of_python() -> None:
    known = {**core._FUNCTIONS}
    for name, function in c_functions().items():
        if name == "bs_default_settings":  # a struct as a result; Python gives all settings itself
            continue
        result, parameters = known.pop(name)
        kinds = {ctypes.c_int: "int", ctypes.c_size_t: "size", ctypes.c_double: "double", None: "void"}
        found = [kinds.get(one, "pointer") for one in (result, *parameters)]
        assert found == [one.replace("result", "int") for one in (function.result, *function.parameters)], name
    assert not known


@pytest.mark.parametrize("listing", ["unity/Runtime/Body.cs", "engines/bodysense.hpp"])
def test_parents_of_listings(listing: str) -> None:
    text = (EXTRAS / listing).read_text(encoding="utf-8")
    found = re.search(r"(?:Parents|PARENTS)[^{;]*=\s*{(.*?)}", text, re.DOTALL)
    assert found is not None
    assert [int(word) for word in found[1].split(",")] == list(default_skeleton().parents[: core.JOINTS])
