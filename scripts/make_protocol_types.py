"""Write web/src/protocol.ts, the protocol as TypeScript, from bodysense_live.

python scripts/make_protocol_types.py [--check]
"""

from __future__ import annotations

import argparse
import ast
import inspect
import sys
from dataclasses import MISSING, fields, is_dataclass
from itertools import pairwise
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from bodysense.io import protocol
from bodysense_live import messages

PLACE = Path(__file__).parents[1] / "web" / "src" / "protocol.ts"

FRAMES = """\
/** A point of a signal frame: by its place in the hello, in the signal's own world. Quaternions are w x y z. */
export interface SignalPoint {
  point: number;
  position: readonly [number, number, number] | null;
  rotation: readonly [number, number, number, number] | null;
  /** m, the expected error of the position; left out or 0, the server assumes what is usual for such a point. */
  accuracy?: number;
}

export interface SignalFrame {
  sequence: number;
  /** s, of the client's own clock. */
  time: number;
  points: SignalPoint[];
}

export interface PoseFrame {
  kind: typeof POSE | typeof TRUTH;
  /** That of the signal that it answers. */
  sequence: number;
  /** s, of that signal. */
  time: number;
  /** (3) m, world. */
  rootPosition: Float32Array;
  /** (joints · 4) w x y z, parent ← joint. */
  rotation: Float32Array;
  /** (points) m; null in a truth. */
  expectedError: Float32Array | null;
  /** (points) 0 … 255, the probability that a point was hidden: 255 where it was not measured; null in a truth. */
  hidden: Uint8Array | null;
  /** (4) 0 … 255, the probability that left and right ankle, left and right ball of the foot rest; null in a truth. */
  contact: Uint8Array | null;
  /** Spent in the server. */
  microseconds: number;
}

/** The bytes of a signal frame. */
export function writeSignal(frame: SignalFrame): ArrayBuffer {
  const buffer = new ArrayBuffer(SIGNAL_HEAD_BYTES + frame.points.length * POINT_BYTES);
  const view = new DataView(buffer);
  view.setUint8(0, SIGNAL);
  view.setUint16(2, frame.points.length, true);
  view.setUint32(4, frame.sequence >>> 0, true);
  view.setFloat64(8, frame.time, true);
  frame.points.forEach((point, index) => {
    const at = SIGNAL_HEAD_BYTES + index * POINT_BYTES;
    view.setUint8(at, point.point);
    view.setUint8(at + 1, (point.position ? HAS_POSITION : 0) | (point.rotation ? HAS_ROTATION : 0));
    view.setUint16(at + 2, Math.min(Math.round((point.accuracy ?? 0) / ACCURACY_UNIT), 0xffff), true);
    point.position?.forEach((value, k) => view.setFloat32(at + 4 + 4 * k, value, true));
    point.rotation?.forEach((value, k) => view.setFloat32(at + 16 + 4 * k, value, true));
  });
  return buffer;
}

/** Return the kind of a binary message of the server. */
export function kindOf(buffer: ArrayBuffer): number {
  return new DataView(buffer).getUint8(0);
}

/** A signal that the server played itself (`watch`). */
export function readSignal(buffer: ArrayBuffer): SignalFrame {
  const view = new DataView(buffer);
  const points: SignalPoint[] = [];
  for (let index = 0; index < view.getUint16(2, true); index++) {
    const at = SIGNAL_HEAD_BYTES + index * POINT_BYTES;
    const has = view.getUint8(at + 1);
    const number = (k: number) => view.getFloat32(at + 4 + 4 * k, true);
    points.push({
      point: view.getUint8(at),
      accuracy: view.getUint16(at + 2, true) * ACCURACY_UNIT,
      position: has & HAS_POSITION ? [number(0), number(1), number(2)] : null,
      rotation: has & HAS_ROTATION ? [number(3), number(4), number(5), number(6)] : null,
    });
  }
  return { sequence: view.getUint32(4, true), time: view.getFloat64(8, true), points };
}

/** Read a pose or a truth of a skeleton with `points` points. */
export function readPose(buffer: ArrayBuffer, points: number): PoseFrame {
  const view = new DataView(buffer);
  const kind = view.getUint8(0) as typeof POSE | typeof TRUTH;
  const joints = view.getUint16(2, true);
  const floats = (at: number, count: number) => new Float32Array(buffer.slice(at, at + 4 * count));
  const errors = POSE_HEAD_BYTES + 12 + 16 * joints;
  const hidden = errors + 4 * points;
  const contact = hidden + points;
  return {
    kind,
    sequence: view.getUint32(4, true),
    time: view.getFloat64(8, true),
    rootPosition: floats(POSE_HEAD_BYTES, 3),
    rotation: floats(POSE_HEAD_BYTES + 12, 4 * joints),
    expectedError: kind === POSE ? floats(errors, points) : null,
    hidden: kind === POSE ? new Uint8Array(buffer, hidden, points) : null,
    contact: kind === POSE ? new Uint8Array(buffer, contact, CONTACTS) : null,
    microseconds: kind === POSE ? view.getUint32(contact + CONTACTS, true) : 0,
  };
}
"""


def text() -> str:
    """The whole file."""
    numbers = {
        **{name: getattr(protocol, name) for name in ("VERSION", "SIGNAL", "POSE", "TRUTH")},
        **{name: getattr(protocol, name) for name in ("HAS_POSITION", "HAS_ROTATION", "MOST_POINTS")},
        "SIGNAL_HEAD_BYTES": protocol.SIGNAL_HEAD.size,
        "POINT_BYTES": protocol.POINT.itemsize,
        "ACCURACY_UNIT": protocol.ACCURACY_UNIT,
        "POSE_HEAD_BYTES": protocol.POSE_HEAD.size,
        "CONTACTS": protocol.CONTACTS,
    }
    parts = ["// Written by scripts/make_protocol_types.py from bodysense_live; see docs/protocol.md. Do not edit.\n"]
    parts.append("".join(f"export const {name} = {value};\n" for name, value in numbers.items()))
    parts.append(
        f'export const SUBPROTOCOL = "{protocol.SUBPROTOCOL}";\n'
        f"export const REGIONS = [{', '.join(map(quoted, messages.REGIONS))}] as const;\n"
    )
    for name in ("Region", "Posture", "Source"):
        parts.append(f"export type {name} = {union(getattr(messages, name))};\n")
    parts += [interface(messages.Settings, None), interface(messages.Resume, None)]
    for table in (messages.CLIENT, messages.SERVER):
        parts += [interface(kind, name) for name, kind in table.items()]
    for name, table in (("ClientMessage", messages.CLIENT), ("ServerMessage", messages.SERVER)):
        parts.append(f"export type {name} = {' | '.join(kind.__name__ for kind in table.values())};\n")
    return "\n".join([*parts, FRAMES])


def interface(kind: type, tag: str | None) -> str:
    """One dataclass as an interface; `tag` is its `type`."""
    if kind is messages.Change:
        return f'{remark(kind.__doc__)}export type Change = {{ type: "{tag}" }} & Partial<Settings>;\n'
    hints, remarks = get_type_hints(kind), remarks_of(kind)
    lines = [f'  type: "{tag}";\n'] if tag else []
    for field in fields(kind):
        # Fields that a client leaves out have their default; a server sends every field.
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
    """A comment, if there is anything to say."""
    return f"{indent}/** {text} */\n" if text else ""


def quoted(text: str) -> str:
    """A string of TypeScript."""
    return f'"{text}"'


def union(literal: Any) -> str:
    """The choices of a Literal."""
    return " | ".join(map(quoted, get_args(literal)))


def typescript(hint: Any) -> str:
    """The TypeScript of a field's type."""
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
    """Write the file, or say whether it is up to date."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="only say whether the file is up to date")
    if parser.parse_args().check:
        return 0 if PLACE.is_file() and PLACE.read_text(encoding="utf-8") == text() else 1
    PLACE.parent.mkdir(parents=True, exist_ok=True)
    PLACE.write_text(text(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
