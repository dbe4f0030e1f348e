"""A glTF 2.0 file, .glb or .gltf: its document, its arrays and its nodes, all checked."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import LARGEST_TEXT, check_plain, read_bytes

MOST_NODES = 5000
JSON, BINARY = 0x4E4F534A, 0x004E4942  # kinds of a .glb's parts
_COMPRESSED = frozenset(("EXT_meshopt_compression", "KHR_meshopt_compression"))  # of any array, keyframes too
_KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@dataclass(frozen=True, eq=False)
class GltfFile:
    """A glTF file in memory."""

    path: Path
    document: dict[str, Any]
    buffers: tuple[bytes, ...]
    moved: Mapping[int, int] = field(default_factory=dict)  # nodes that hang elsewhere → the joint that they belong to

    def array(self, accessor: int) -> np.ndarray:
        """Return an accessor as (count, width) float64. Raises BodysenseError if its numbers are not in the file."""
        try:
            about = self.document["accessors"][accessor]
            view = self.document["bufferViews"][about["bufferView"]]
            kind, width, count = np.dtype(_KINDS[about["componentType"]]), _WIDTHS[about["type"]], int(about["count"])
            data = self.buffers[view.get("buffer", 0)]
            start = int(view.get("byteOffset", 0)) + int(about.get("byteOffset", 0))
            row = kind.itemsize * width
            step = int(view.get("byteStride") or row)
            if "sparse" in about or count < 1 or start < 0 or step < row:
                raise ValueError("not a plain array")
            if start + step * (count - 1) + row > len(data):
                raise ValueError("beyond the end of the file")
            raw = np.lib.stride_tricks.as_strided(
                np.frombuffer(data, "u1", offset=start), (count, row), (step, 1), writeable=False
            )
            with np.errstate(invalid="ignore"):  # damaged numbers become NaN
                values = np.ascontiguousarray(raw).view(kind).astype(np.float64)
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise BodysenseError(f"{self.path}: array {accessor} cannot be read ({error}); export it again") from None
        if about.get("normalized") and kind.kind != "f":
            values = np.maximum(values / np.iinfo(kind).max, -1.0)
        return values

    @cached_property
    def nodes(self) -> list[dict[str, Any]]:
        """Nodes of the document. Raises BodysenseError if they are too many or not objects."""
        nodes = self.document.get("nodes", [])
        if not isinstance(nodes, list) or not all(isinstance(node, dict) for node in nodes):
            raise BodysenseError(f"{self.path}: its nodes are not a list of objects; export it again")
        if len(nodes) > MOST_NODES:
            raise BodysenseError(f"{self.path}: {len(nodes)} nodes, more than {MOST_NODES}; export the body alone")
        return nodes

    @cached_property
    def parents(self) -> list[int]:
        """Parent of each node, -1 for a root. Raises BodysenseError if the nodes are not trees."""
        parents = [-1] * len(self.nodes)
        for k, node in enumerate(self.nodes):
            for child in node.get("children", []):
                if not isinstance(child, int) or not 0 <= child < len(parents) or parents[child] >= 0 or child == k:
                    raise BodysenseError(
                        f"{self.path}: node {child} has two parents, or none is there; export it again"
                    )
                parents[child] = k
        if len(self._below_roots(parents)) != len(parents):
            raise BodysenseError(f"{self.path}: its nodes hang on each other in a circle; export it again")
        return parents

    @cached_property
    def carriers(self) -> list[int]:
        """The joint that each node belongs to: its parent, unless it was moved."""
        return [self.moved.get(k, parent) for k, parent in enumerate(self.parents)]

    @cached_property
    def carried_order(self) -> list[int]:
        """Nodes, carriers first."""
        below: dict[int, list[int]] = {}
        for k, carrier in enumerate(self.carriers):
            below.setdefault(carrier, []).append(k)
        order = list(below.get(-1, []))
        for k in order:
            order += below.get(k, [])
        return order

    @cached_property
    def order(self) -> list[int]:
        """Nodes, parents first."""
        return self._below_roots(self.parents)

    def _below_roots(self, parents: list[int]) -> list[int]:
        order = [k for k, parent in enumerate(parents) if parent < 0]
        for k in order:
            order += self.nodes[k].get("children", [])
        return order


def open_gltf(path: Path) -> GltfFile:
    """Open a file. Raises BodysenseError if it is not glTF, cut short, or has buffers outside its folder."""
    data = read_bytes(path, fix="export the skeleton without meshes")
    check_plain(data[:64] if data[:4] != b"glTF" else b"", path)
    text, binary = _chunks(path, data) if data[:4] == b"glTF" else (data, b"")
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        raise BodysenseError(f"{path}: not a glTF file (its JSON cannot be read); export it again") from None
    if not isinstance(document, dict) or not str(_entry(document, "asset").get("version", "")).startswith("2"):
        raise BodysenseError(f"{path}: not glTF 2.0; export it as glTF 2.0")
    _check_extensions(path, document)
    buffers = document.get("buffers", [])
    if not isinstance(buffers, list) or not all(isinstance(one, dict) for one in buffers):
        raise BodysenseError(f"{path}: its buffers are not a list of objects; export it again")
    return GltfFile(path, document, tuple(_buffer(path, one, binary) for one in buffers))


def _check_extensions(path: Path, document: dict[str, Any]) -> None:
    """Refuse a file whose arrays are compressed by an extension; compressed meshes are not read."""
    views = document.get("bufferViews", [])
    used = {name for view in views if isinstance(view, dict) for name in _entry(view, "extensions")}
    if used & _COMPRESSED:
        raise BodysenseError(
            f"{path}: its arrays are compressed by {sorted(used & _COMPRESSED)[0]}; decompress it, as with: "
            f"npx @gltf-transform/cli copy {path.name} plain.glb, or export it again without compression"
        )


def _entry(document: dict[str, Any], name: str) -> dict[str, Any]:
    value = document.get(name)
    return value if isinstance(value, dict) else {}


def _chunks(path: Path, data: bytes) -> tuple[bytes, bytes]:
    """Return the JSON and the binary part of a .glb."""
    parts: dict[int, bytes] = {}
    at = 12
    while at + 8 <= len(data):
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > len(data):
            raise BodysenseError(f"{path}: it ends within a part of {size} bytes; was it cut short? Copy it again")
        parts.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    if JSON not in parts:
        raise BodysenseError(f"{path}: a .glb file without its JSON; was it cut short? Copy it again")
    return parts[JSON], parts.get(BINARY, b"")


def _buffer(path: Path, about: dict[str, Any], binary: bytes) -> bytes:
    """Return the bytes of a buffer: in the file, in its text, or in a file next to it."""
    uri = about.get("uri")
    if uri is None:
        return binary
    if not isinstance(uri, str):
        raise BodysenseError(f"{path}: a buffer has no place; export it again")
    if uri.startswith("data:"):
        try:
            return base64.b64decode(uri.partition(",")[2], validate=False)
        except (ValueError, binascii.Error):
            raise BodysenseError(f"{path}: a buffer in it is not base64; export it again") from None
    beside = path.parent / unquote(uri)
    if beside.resolve().parent != path.parent.resolve() or not beside.is_file():
        raise BodysenseError(f"{path}: needs the file {uri[:60]!r} next to it; copy both, or export it as .glb")
    if beside.stat().st_size > LARGEST_TEXT:
        raise BodysenseError(f"{beside}: larger than {LARGEST_TEXT >> 30} GiB; export the skeleton without meshes")
    return beside.read_bytes()
