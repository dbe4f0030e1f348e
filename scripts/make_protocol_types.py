"""Write what the page shares with the packages as TypeScript: the protocol's types, and numbers of the video device.

python scripts/make_protocol_types.py [--check]
    writes web/src/server/protocol.ts and web/src/sources/webcam/constants.ts
python scripts/make_protocol_types.py --solarxr [--check]    # SolarXR's Python code from its schemas, by flatc 2.0.8
"""

from __future__ import annotations

import argparse
import ast
import inspect
import subprocess
import sys
import tempfile
from dataclasses import MISSING, fields, is_dataclass
from itertools import pairwise
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from bodysense.devices.video import posture_constants
from bodysense.io.formats import protocol
from bodysense_live.server import messages

ROOT = Path(__file__).parents[1]
PLACE = ROOT / "web" / "src" / "server" / "protocol.ts"
CONSTANTS = ROOT / "web" / "src" / "sources" / "webcam" / "constants.ts"
SOLARXR = ROOT / "packages" / "live" / "src" / "bodysense_live" / "protocols" / "solarxr"


def text() -> str:
    """Return the text of the file."""
    numbers = {
        **{k: getattr(protocol, k) for k in ("VERSION", "SIGNAL", "POSE", "TRUTH", "HAS_POSITION", "HAS_ROTATION")},
        "SIGNAL_HEAD_BYTES": protocol.SIGNAL_HEAD.size,
        "POINT_BYTES": protocol.POINT.itemsize,
        "ACCURACY_UNIT": protocol.ACCURACY_UNIT,
        "POSE_HEAD_BYTES": protocol.POSE_HEAD.size,
        "CONTACTS": protocol.CONTACTS,
    }
    parts = ["// Written by scripts/make_protocol_types.py from bodysense_live; see docs/protocol.md. Do not edit.\n"]
    parts.append("".join(f"export const {name} = {value};\n" for name, value in numbers.items()))
    parts.append(f'export const SUBPROTOCOL = "{protocol.SUBPROTOCOL}";\n')
    for name in ("Region", "Posture", "Source"):
        parts.append(f"export type {name} = {union(getattr(messages, name))};\n")
    parts += [
        interface(kind, None) for kind in (messages.Worn, messages.KnownLength, messages.Settings, messages.Resume)
    ]
    for table in (messages.CLIENT, messages.SERVER):
        parts += [interface(kind, name) for name, kind in table.items()]
    for name, table in (("ClientMessage", messages.CLIENT), ("ServerMessage", messages.SERVER)):
        parts.append(f"export type {name} = {' | '.join(kind.__name__ for kind in table.values())};\n")
    return "\n".join(parts)


def constants_text() -> str:
    """Return the numbers of `posture_constants` as TypeScript, with their comments."""
    lines = inspect.getsource(posture_constants).partition('"""\n\n')[2].splitlines()
    parts = [
        "// Written by scripts/make_protocol_types.py from bodysense.devices.video.posture_constants. Do not edit.",
        "",
    ]
    for line in lines:
        name, _, rest = line.partition(" = ")
        if not rest:
            parts.append(line.replace("# ", "// ", 1))
            continue
        value, comment = getattr(posture_constants, name), rest.partition("  # ")[2]
        number = f"[{', '.join(f'{part:g}' for part in value)}] as const" if isinstance(value, tuple) else f"{value:g}"
        parts += [f"/** {comment} */", f"export const {name} = {number};"]
    return "\n".join(parts) + "\n"


def solarxr_code() -> dict[Path, str]:
    """Return the text of SolarXR's files of code, by their paths. Needs flatc (apt install flatbuffers-compiler)."""
    schemas = sorted((SOLARXR / "schema").glob("*.fbs"))
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["flatc", "--python", "--gen-onefile", "-o", folder, *map(str, schemas)], check=True)
        made = sorted(Path(folder).glob("*_generated.py"))
        return {SOLARXR / "generated" / path.name: path.read_text(encoding="utf-8") for path in made}


def interface(kind: type, tag: str | None) -> str:
    """Return a dataclass as an interface; `tag` is its `type`."""
    if kind is messages.UpdateSettings:
        return f'{remark(kind.__doc__)}export type UpdateSettings = {{ type: "{tag}" }} & Partial<Settings>;\n'
    hints, remarks = get_type_hints(kind), remarks_of(kind)
    lines = [f'  type: "{tag}";\n'] if tag else []
    for field in fields(kind):
        # A client may omit fields, which then have their default. A server sends every field.
        optional = "?" if tag in messages.CLIENT and field.default is not MISSING else ""
        type_ = typescript(hints[field.name])
        if optional and type_ == "Settings":
            type_ = "Partial<Settings>"
        lines.append(f"{remark(remarks.get(field.name), '  ')}  {field.name}{optional}: {type_};\n")
    return f"{remark(kind.__doc__)}export interface {kind.__name__} {{\n{''.join(lines)}}}\n"


def remarks_of(kind: type) -> dict[str, str]:
    """Return the docstrings under the fields of a dataclass."""
    body = next(node for node in ast.parse(inspect.getsource(kind)).body if isinstance(node, ast.ClassDef)).body
    found = {}
    for before, node in pairwise(body):
        if isinstance(before, ast.AnnAssign) and isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            assert isinstance(before.target, ast.Name)
            found[before.target.id] = str(node.value.value)
    return found


def remark(text: str | None, indent: str = "") -> str:
    """Return a comment, or an empty string without text."""
    return f"{indent}/** {text} */\n" if text else ""


def quoted(text: str) -> str:
    """Return a TypeScript string."""
    return f'"{text}"'


def union(literal: Any) -> str:
    """Return the choices of a Literal."""
    return " | ".join(map(quoted, get_args(literal)))


def typescript(hint: Any) -> str:
    """Return the TypeScript type of a field."""
    if get_origin(hint) in (UnionType, Union):
        return " | ".join(typescript(kind) for kind in get_args(hint))
    if get_origin(hint) is tuple:
        inner = get_args(hint)
        if inner[-1] is Ellipsis:
            entry = typescript(inner[0])
            return f"({entry})[]" if " " in entry else f"{entry}[]"
        return f"[{', '.join(map(typescript, inner))}]"
    if get_origin(hint) is Literal:
        names = {getattr(messages, name): name for name in ("Region", "Posture", "Source")}
        return names.get(hint, union(hint))
    if is_dataclass(hint):
        return hint.__name__  # type: ignore[union-attr]
    return {str: "string", bool: "boolean", int: "number", float: "number", NoneType: "null"}[hint]


def main() -> int:
    """Write the file, or report whether it is up to date."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="only report whether the files are up to date")
    parser.add_argument("--solarxr", action="store_true", help="SolarXR's code in place of the page's types")
    asked = parser.parse_args()
    files = solarxr_code() if asked.solarxr else {PLACE: text(), CONSTANTS: constants_text()}
    if asked.check:
        return (
            0 if all(path.is_file() and path.read_text(encoding="utf-8") == new for path, new in files.items()) else 1
        )
    for path, new in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
