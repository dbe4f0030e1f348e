"""Make the page's default avatar, VRM 1.0: a CC0 figure that gets a face, hair, clothes and shoes of our own.

    python scripts/make_avatar.py [OUT]        # web/public/avatar.vrm.gz

Everything is made by rule from one of the packaged figures (docs/credits.md): its skin is cut into regions, clothes and
hair are the skin moved outward and closed at their hems, colours are of vertices. The motion of a hem is the skin's own.
"""

from __future__ import annotations

import gzip
import json
import struct
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bodysense.export.humanoid import VRM_BONES
from bodysense.export.render.figure import Figure, load_figure
from bodysense.files import written_beside

OUTPUT = Path(__file__).parents[1] / "web" / "public" / "avatar.vrm.gz"
SKIN, SHIRT, TROUSERS, SHOES, HAIR, EYES = range(6)
THICKNESS = {SHIRT: 0.009, TROUSERS: 0.008, SHOES: 0.007}  # m
RED, GREEN, BLUE = range(3)


def srgb(text: str) -> np.ndarray:
    """Linear red, green, blue of '#rrggbb'."""
    values = np.array([int(text[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


COLOURS = {
    SKIN: srgb("#d9a283"),
    SHIRT: srgb("#2b7f78"),
    TROUSERS: srgb("#39414f"),
    SHOES: srgb("#ece7dc"),
    HAIR: srgb("#3a2820"),
}
COLLAR, SOLE, LIPS, BROWS = srgb("#1f625d"), srgb("#c9c1b2"), srgb("#b8685c"), srgb("#3d2a20")
WHITE, IRIS, PUPIL = srgb("#f3efe9"), srgb("#4a6d52"), srgb("#15110f")


@dataclass
class Mesh:
    """Triangles with everything that vertices have."""

    position: list[np.ndarray] = field(default_factory=list)
    colour: list[np.ndarray] = field(default_factory=list)
    source: list[np.ndarray] = field(default_factory=list)  # vertex of the figure whose weights each has
    triangles: list[np.ndarray] = field(default_factory=list)
    count: int = 0

    def add(self, position: np.ndarray, colour: np.ndarray, source: np.ndarray, triangles: np.ndarray) -> None:
        """Add a part; its triangles count from its own first vertex."""
        self.position.append(position)
        self.colour.append(colour)
        self.source.append(source)
        self.triangles.append(triangles + self.count)
        self.count += len(position)


def regions(figure: Figure) -> np.ndarray:
    """(V,) which region each vertex is of."""
    names = np.array(figure.skeleton.joints)[figure.joint[np.arange(len(figure.joint)), figure.weight.argmax(axis=1)]]
    rest, x = figure.rest, figure.vertices

    def at(name: str) -> np.ndarray:
        return rest[figure.skeleton.index(name)]

    part = np.array([name.partition("_")[2] or name for name in names])
    region = np.full(len(x), SKIN)
    hem = at("pelvis")[1] - 0.02
    torso = np.isin(part, ["pelvis", "spine1", "spine2", "spine3", "collar"])
    region[torso & (x[:, 1] > hem)] = SHIRT
    region[(torso & (x[:, 1] <= hem)) | np.isin(part, ["hip"])] = TROUSERS
    sleeve = at("left_shoulder")[0] + 0.58 * (at("left_elbow")[0] - at("left_shoulder")[0])
    region[(part == "shoulder") & (np.abs(x[:, 0]) < sleeve)] = SHIRT
    region[(part == "knee") & (x[:, 1] > at("left_ankle")[1] + 0.055)] = TROUSERS
    region[(part == "knee") & (x[:, 1] <= at("left_ankle")[1] + 0.055)] = SKIN
    region[np.isin(part, ["ankle", "foot"]) & (x[:, 1] < at("left_ankle")[1] + 0.012)] = SHOES
    neck = np.linalg.norm((x - at("neck")) * [1.0, 0.9, 0.9], axis=1)
    opening = (x[:, 1] > at("neck")[1] - 0.035 - 0.35 * np.maximum(x[:, 2] - at("neck")[2], 0)) & (neck < 0.12)
    region[(region == SHIRT) & opening] = SKIN
    region[figure.part == 1] = EYES
    return region


def smoothed(figure: Figure, values: np.ndarray, those: np.ndarray, rounds: int) -> np.ndarray:
    """Values of vertices, averaged with their neighbours' among `those` triangles."""
    edges = np.concatenate([those[:, [0, 1]], those[:, [1, 2]], those[:, [2, 0]]])
    edges = np.concatenate([edges, edges[:, ::-1]])
    for _ in range(rounds):
        total = values.copy()
        count = np.ones(len(values))
        np.add.at(total, edges[:, 0], values[edges[:, 1]])
        np.add.at(count, edges[:, 0], 1)
        values = total / count.reshape(-1, *[1] * (values.ndim - 1))
    return values


def garment(mesh: Mesh, figure: Figure, region: np.ndarray, kind: int, trim: np.ndarray | None) -> None:
    """Cloth over a region: the skin moved outward, smoothed, with a hem that turns in; and a trim along it."""
    inside = (region[figure.triangles] == kind).all(axis=1)
    triangles = figure.triangles[inside]
    used = np.unique(triangles)
    normal = smoothed(figure, figure.normals, triangles, 3)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    loose = smoothed(figure, figure.vertices, triangles, 6 if kind != SHOES else 3)
    ends = edge_of(triangles)
    near = smoothed(figure, np.isin(np.arange(len(region)), ends).astype(float), triangles, 4)
    position = loose + normal * (THICKNESS[kind] + 0.003 * (near > 0.05))[:, None]
    if kind == SHOES:  # a flat sole
        position[:, 1] = np.maximum(position[:, 1], 0.0)
    place = np.full(len(region), -1)
    place[used] = np.arange(len(used))
    colour = np.tile(COLOURS[kind], (len(used), 1))
    if trim is not None:
        colour[near[used] > 0.18] = trim
    if kind == SHOES:
        colour[position[used, 1] < 0.022] = SOLE
    mesh.add(position[used], colour, used, place[triangles])
    rim = boundary(triangles)
    first, second = rim[:, 0], rim[:, 1]
    under = figure.vertices - figure.normals * 0.004
    ring = np.concatenate([position[first], position[second], under[first], under[second]])
    n = len(rim)
    a, b, c, d = (np.arange(n) + k * n for k in range(4))
    walls = np.concatenate([np.stack([b, a, c], 1), np.stack([b, c, d], 1)])
    shade = np.tile((trim if trim is not None else COLOURS[kind]) * 0.8, (4 * n, 1))
    mesh.add(ring, shade, np.concatenate([first, second, first, second]), walls)


def boundary(triangles: np.ndarray) -> np.ndarray:
    """(E, 2) directed edges that only one triangle has."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    key = np.sort(edges, axis=1) @ np.array([1 << 20, 1])
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    return edges[first[count == 1]]


def edge_of(triangles: np.ndarray) -> np.ndarray:
    """Vertices on the boundary."""
    return np.unique(boundary(triangles))


def skin(mesh: Mesh, figure: Figure, region: np.ndarray) -> None:
    """What clothes leave bare, and a little of what they cover; with lips, brows and blushes."""
    bare = region == SKIN
    shown = bare.copy()
    for _ in range(2):
        touching = bare[figure.triangles].any(axis=1)
        shown[figure.triangles[touching]] = True
        bare = shown.copy()
    shown &= figure.part != 1
    triangles = figure.triangles[shown[figure.triangles].all(axis=1)]
    used = np.unique(triangles)
    place = np.full(len(region), -1)
    place[used] = np.arange(len(used))
    x = figure.vertices[used]
    colour = np.tile(COLOURS[SKIN], (len(used), 1))
    mirrored = np.abs(x[:, 0])
    cheek = np.linalg.norm((x - [0, 0, 0] - figure.eye * [0, 1, 1]) * [0, 1, 1] + [0, 0.035, 0], axis=1)
    blush = np.exp(-(((mirrored - 0.042) / 0.02) ** 2) - (cheek / 0.03) ** 2)
    colour += blush[:, None] * (srgb("#cf7f68") - colour) * 0.45
    colour[figure.part[used] == 2] = LIPS
    inner, outer = 0.35 * figure.eye[0], 1.95 * figure.eye[0]
    along = np.clip((mirrored - inner) / (outer - inner), 0, 1)
    arch = figure.eye[1] + 0.019 + 0.007 * np.sin(np.pi * np.clip(along * 1.15, 0, 1))
    brow = (mirrored > inner) & (mirrored < outer) & (np.abs(x[:, 1] - arch) < 0.0042 * (1.25 - 0.7 * along))
    brow &= x[:, 2] > figure.eye[2] - 0.03
    colour[brow] = BROWS
    mesh.add(x, colour, used, place[triangles])


def eyes(mesh: Mesh, figure: Figure) -> None:
    """White balls with an iris and a pupil, made anew: the figure's are too coarse to be painted."""
    head = int(np.flatnonzero(figure.joint[:, 0] == figure.skeleton.index("head"))[0])
    rows, columns = 24, 32
    tilt = np.linspace(0, 0.62 * np.pi, rows)[:, None]
    turn = np.linspace(0, 2 * np.pi, columns, endpoint=False)[None]
    ball = np.stack(
        [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt) + 0 * turn], axis=-1
    ).reshape(-1, 3)
    angle = np.repeat(tilt[:, 0], columns)
    colour = np.where((angle < 0.5)[:, None], IRIS, WHITE)
    colour = np.where(((angle > 0.43) & (angle < 0.5))[:, None], IRIS * 0.35, colour)
    colour = np.where((angle < 0.23)[:, None], PUPIL, colour)
    k = np.arange(rows - 1)[:, None] * columns + np.arange(columns)[None]
    after = np.arange(rows - 1)[:, None] * columns + (np.arange(columns)[None] + 1) % columns
    quads = np.stack([k, k + columns, after + columns, after], axis=-1).reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    own = figure.vertices[figure.part == 1]
    for sign in (1, -1):
        side = own[own[:, 0] * sign > 0]
        middle = (side.max(axis=0) + side.min(axis=0)) / 2
        radius = (side.max(axis=0) - side.min(axis=0))[1] / 2
        mesh.add(middle + ball * radius, colour, np.full(len(ball), head), triangles)


def hair(mesh: Mesh, figure: Figure) -> None:
    """A short cut: the scalp moved outward, fuller on top and behind, with a bun."""
    x, head = figure.vertices, figure.rest[figure.skeleton.index("head")]
    eye = figure.eye
    behind = eye[2] - x[:, 2]  # m
    line = eye[1] + 0.062 - 0.95 * np.maximum(behind - 0.045, 0) + 0.25 * np.maximum(0.02 - behind, 0)
    line = np.maximum(line, head[1] - 0.012)
    scalp = (figure.joint[:, 0] == figure.skeleton.index("head")) & (x[:, 1] > line) & (figure.part == 0)
    ears = (np.abs(x[:, 0]) > 0.067) & (x[:, 1] < eye[1] + 0.03) & (behind < 0.115)
    scalp &= ~ears
    triangles = figure.triangles[scalp[figure.triangles].all(axis=1)]
    used = np.unique(triangles)
    normal = smoothed(figure, figure.normals, triangles, 8)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    rim = np.isin(np.arange(len(x)), edge_of(triangles)).astype(float)
    depth = np.clip(1 - 1.6 * smoothed(figure, rim, triangles, 7), 0.12, 1)
    full = 0.013 + 0.010 * np.clip((x[:, 1] - eye[1]) / 0.1, 0, 1) + 0.006 * np.clip(behind / 0.15, 0, 1)
    strand = 0.0016 * np.sin(95 * np.arctan2(x[:, 0], x[:, 1] - eye[1] + 0.02) + 14 * behind)
    position = smoothed(figure, x, triangles, 2) + normal * ((full + strand) * depth)[:, None]
    place = np.full(len(x), -1)
    place[used] = np.arange(len(used))
    shade = 0.86 + 110 * strand[used]
    mesh.add(position[used], COLOURS[HAIR] * shade[:, None], used, place[triangles])
    source = int(used[0])
    rows, columns = 14, 20
    tilt, turn = np.linspace(0, np.pi, rows)[:, None], np.linspace(0, 2 * np.pi, columns, endpoint=False)[None]
    wave = 1 + 0.05 * np.sin(5 * turn + 6 * tilt)
    ball = np.stack([np.sin(tilt) * np.cos(turn), np.cos(tilt) + 0 * turn, np.sin(tilt) * np.sin(turn)], -1)
    ball = (ball * wave[..., None]).reshape(-1, 3)
    top = position[used][position[used, 2].argmin()]
    k = np.arange(rows - 1)[:, None] * columns + np.arange(columns)[None]
    after = np.arange(rows - 1)[:, None] * columns + (np.arange(columns)[None] + 1) % columns
    quads = np.stack([k, after, after + columns, k + columns], axis=-1).reshape(-1, 4)
    bun = np.array([0.0, top[1] + 0.045, top[2] - 0.012]) + ball * [0.036, 0.033, 0.033]
    tint = COLOURS[HAIR] * (0.92 + 2 * (wave.ravel()[:, None] - 1))
    mesh.add(bun, tint, np.full(len(bun), source), np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))


def normals_of(position: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(V, 3) unit normals."""
    a, b, c = (position[triangles[:, k]] for k in range(3))
    normal = np.zeros_like(position)
    for k in range(3):
        np.add.at(normal, triangles[:, k], np.cross(b - a, c - a))
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)


def glb(figure: Figure, mesh: Mesh) -> bytes:
    """The bytes of the .vrm."""
    position = np.round(np.concatenate(mesh.position) * 16384) / 16384
    triangles, source = np.concatenate(mesh.triangles), np.concatenate(mesh.source)
    normal = np.round(normals_of(position, triangles) * 127) / 127
    normal = np.where(np.linalg.norm(normal, axis=1, keepdims=True) > 0.5, normal, [0.0, 1.0, 0.0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    colour = np.clip(np.concatenate(mesh.colour), 0, 1)
    colour = np.concatenate([np.round(colour * 65535), np.full((len(colour), 1), 65535)], axis=1)
    weight = np.round(figure.weight[source] * 255).astype(int)
    weight[:, 0] += 255 - weight.sum(axis=1)
    joint = np.where(weight > 0, figure.joint[source], 0)
    joints = len(figure.skeleton.joints)
    bind = np.tile(np.eye(4), (joints, 1, 1))
    bind[:, 3, :3] = -figure.rest[:joints]
    data, views, accessors = bytearray(), [], []

    def accessor(values: np.ndarray, kind: str, component: int, target: int | None, bounds: bool = False) -> int:
        content = values.tobytes()
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(content)})
        if target is not None:
            views[-1]["target"] = target
        data.extend(content + bytes(-len(content) % 4))
        row = {"bufferView": len(views) - 1, "componentType": component, "count": len(values), "type": kind}
        if bounds:
            row |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        if component in (5121, 5123) and kind == "VEC4" and values is not joint8:
            row["normalized"] = True
        accessors.append(row)
        return len(accessors) - 1

    joint8 = joint.astype("<u1")
    attributes = {
        "POSITION": accessor(position.astype("<f4"), "VEC3", 5126, 34962, bounds=True),
        "NORMAL": accessor(normal.astype("<f4"), "VEC3", 5126, 34962),
        "COLOR_0": accessor(colour.astype("<u2"), "VEC4", 5123, 34962),
        "JOINTS_0": accessor(joint8, "VEC4", 5121, 34962),
        "WEIGHTS_0": accessor(weight.astype("<u1"), "VEC4", 5121, 34962),
    }
    indices = accessor(triangles.astype("<u2").reshape(-1), "SCALAR", 5123, 34963)
    binds = accessor(bind.astype("<f4").reshape(joints, 16), "MAT4", 5126, None)
    parents = figure.skeleton.parents[:joints]
    nodes = []
    for k, name in enumerate(figure.skeleton.joints):
        offset = figure.skeleton.rest_offset[k]
        node = {"name": name, "translation": [round(float(v), 6) for v in offset]}
        if children := [child for child, parent in enumerate(parents) if parent == k]:
            node["children"] = children
        nodes.append(node)
    nodes.append({"name": "figure", "mesh": 0, "skin": 0})
    humanoid = {bone: {"node": figure.skeleton.index(name)} for name, bone in VRM_BONES.items()}
    document = {
        "asset": {"version": "2.0", "generator": "bodysense scripts/make_avatar.py"},
        "extensionsUsed": ["VRMC_vrm"],
        "scene": 0,
        "scenes": [{"nodes": [0, joints]}],
        "nodes": nodes,
        "meshes": [{"name": "figure", "primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}],
        "materials": [{"name": "cloth and skin", "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0.82}}],
        "skins": [{"joints": list(range(joints)), "inverseBindMatrices": binds, "skeleton": 0}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
        "extensions": {
            "VRMC_vrm": {
                "specVersion": "1.0",
                "meta": {
                    "name": "bodysense",
                    "version": "1",
                    "authors": ["the bodysense developers"],
                    "licenseUrl": "https://vrm.dev/licenses/1.0/",
                    "otherLicenseUrl": "https://creativecommons.org/publicdomain/zero/1.0/",
                    "avatarPermission": "everyone",
                    "commercialUsage": "corporation",
                    "creditNotation": "unnecessary",
                    "allowRedistribution": True,
                    "modification": "allowModificationRedistribution",
                },
                "humanoid": {"humanBones": humanoid},
            }
        },
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + len(data)
    head = struct.pack("<III", 0x46546C67, 2, total) + struct.pack("<II", len(text), 0x4E4F534A)
    return head + text + struct.pack("<II", len(data), 0x004E4942) + bytes(data)


def main(out: Path) -> None:
    """Write the avatar."""
    figure = load_figure("woman")
    region, mesh = regions(figure), Mesh()
    skin(mesh, figure, region)
    garment(mesh, figure, region, SHIRT, COLLAR)
    garment(mesh, figure, region, TROUSERS, None)
    garment(mesh, figure, region, SHOES, None)
    eyes(mesh, figure)
    hair(mesh, figure)
    content = glb(figure, mesh)
    with written_beside(out) as beside:
        beside.write_bytes(gzip.compress(content, 9, mtime=0))
    print(f"{out}: {mesh.count} vertices, {len(content)} bytes, packed {out.stat().st_size}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else OUTPUT)
