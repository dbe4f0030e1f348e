"""Make the page's default avatar (VRM 1.0): a CC0 figure with our own face, hair, clothes and shoes.

    python scripts/make_avatar.py [OUT]        # web/public/avatar.vrm.gz

Everything is made by rule from one of the packaged figures (docs/credits.md): its skin is cut into regions, clothes and
hair are the skin moved outward and closed at their hems, colours are of vertices. A hem moves as the skin does.
"""

from __future__ import annotations

import gzip
import json
import struct
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bodysense.files import written_beside
from bodysense.io.formats.gltf.humanoid import VRM_BONES
from bodysense_lab.rendering.character import Character, load_figure

OUTPUT = Path(__file__).parents[1] / "web" / "public" / "avatar.vrm.gz"
SKIN, SHIRT, TROUSERS, SHOES, HAIR = range(5)
SMILE = 0.007  # m by which the corners of the mouth are raised
THICKNESS = {SHIRT: 0.013, TROUSERS: 0.010}  # m


def srgb(text: str) -> np.ndarray:
    """Return the linear red, green and blue of '#rrggbb'."""
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
    """Triangles with all attributes of their vertices."""

    position: list[np.ndarray] = field(default_factory=list)
    colour: list[np.ndarray] = field(default_factory=list)
    source: list[np.ndarray] = field(default_factory=list)  # vertex of the figure with the weights of each vertex
    triangles: list[np.ndarray] = field(default_factory=list)
    count: int = 0

    def add(self, position: np.ndarray, colour: np.ndarray, source: np.ndarray, triangles: np.ndarray) -> None:
        """Add a part; the indices of its triangles start at its first vertex."""
        self.position.append(position)
        self.colour.append(colour)
        self.source.append(source)
        self.triangles.append(triangles + self.count)
        self.count += len(position)


@dataclass(frozen=True)
class Cut:
    """Part of the figure's surface, cut along a line; every vertex is on an edge of the figure."""

    first: np.ndarray  # (N,) vertices of the figure
    second: np.ndarray  # (N,)
    share: np.ndarray  # (N, 1) position between the first and the second
    triangles: np.ndarray  # (F, 3)

    def of(self, values: np.ndarray) -> np.ndarray:
        """Interpolate values (V, …) of the figure's vertices at those of the cut."""
        return values[self.first] * (1 - self.share) + values[self.second] * self.share

    @property
    def source(self) -> np.ndarray:
        """Return the nearer vertex (N,) of the figure."""
        return np.where(self.share[:, 0] < 0.5, self.first, self.second)


def cut(triangles: np.ndarray, inside: np.ndarray) -> Cut:
    """Return the surface where `inside` (V,) is positive."""
    rows: dict[tuple[int, int], int] = {}
    first: list[int] = []
    second: list[int] = []
    share: list[float] = []

    def vertex(i: int, j: int) -> int:
        key = (min(i, j), max(i, j))
        if key not in rows:
            rows[key] = len(first)
            a, b = key
            first.append(a)
            second.append(b)
            share.append(0.0 if a == b else float(inside[a] / (inside[a] - inside[b])))
        return rows[key]

    found = []
    for triangle in triangles[(inside[triangles] > 0).any(axis=1)].tolist():
        ring = []
        for i, j in zip(triangle, triangle[1:] + triangle[:1], strict=True):
            if inside[i] > 0:
                ring.append(vertex(i, i))
            if (inside[i] > 0) != (inside[j] > 0):
                ring.append(vertex(i, j))
        found += [[ring[0], ring[k], ring[k + 1]] for k in range(1, len(ring) - 1)]
    return Cut(np.array(first), np.array(second), np.array(share)[:, None], np.array(found))


def smoothed(values: np.ndarray, triangles: np.ndarray, rounds: int) -> np.ndarray:
    """Return values of vertices, averaged with those of their neighbours."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    edges = np.concatenate([edges, edges[:, ::-1]])
    for _ in range(rounds):
        total, count = values.copy(), np.ones(len(values))
        np.add.at(total, edges[:, 0], values[edges[:, 1]])
        np.add.at(count, edges[:, 0], 1)
        values = total / count.reshape(-1, *[1] * (values.ndim - 1))
    return values


def fields(figure: Character) -> dict[int, np.ndarray]:
    """Return, for clothes and hair, the distance (V,) m of each vertex of the figure inside their edges."""
    rest, x = figure.rest, figure.vertices

    def at(name: str) -> np.ndarray:
        return rest[figure.skeleton.index(name)]

    hem, neck, wide = at("pelvis")[1] - 0.045, at("neck"), np.abs(x[:, 0])
    sleeve = at("left_shoulder")[0] + 0.55 * (at("left_elbow")[0] - at("left_shoulder")[0])
    low = neck[1] - 0.018 - 0.55 * np.maximum(x[:, 2] - neck[2], 0)
    collar = np.maximum(np.hypot(x[:, 0], 0.9 * (x[:, 2] - neck[2])) - 0.078, low - x[:, 1])
    shirt = np.minimum.reduce([x[:, 1] - hem, sleeve - wide, collar, neck[1] + 0.03 - x[:, 1]])
    cuff = at("left_ankle")[1] + 0.03
    trousers = np.minimum(hem + 0.05 - x[:, 1], x[:, 1] - cuff)
    trousers[wide > 0.3] = -1.0
    behind = figure.eye[2] - x[:, 2]  # m
    line = np.interp(
        behind,
        [-0.03, 0.02, 0.05, 0.066, 0.078, 0.086, 0.118, 0.132, 0.16, 0.2],
        [0.066, 0.062, 0.042, 0.002, -0.012, 0.018, 0.014, -0.03, -0.066, -0.07],
    )
    scalp = x[:, 1] - figure.eye[1] - line
    ear = (wide > 0.072) & (behind > 0.06) & (behind < 0.13) & (x[:, 1] < figure.eye[1] + 0.024)
    scalp[ear | (figure.part != 0)] = -0.02
    return {SHIRT: shirt, TROUSERS: trousers, HAIR: scalp}


def outward(figure: Character, triangles: np.ndarray, rounds: int) -> np.ndarray:
    """Return smooth unit normals (V, 3)."""
    normal = smoothed(figure.normals, triangles, rounds)
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)


def garment(
    mesh: Mesh, figure: Character, inside: np.ndarray, kind: int, trim: np.ndarray | None, under: np.ndarray | float
) -> None:
    """Add cloth: the skin moved outward and smoothed, with a trim along its edge, which turns inward.

    Where it lies `under` another one, (V,) m from that one's edge, it is close to the skin.
    """
    near = figure.triangles[(inside[figure.triangles] > -0.03).any(axis=1)]
    normal, loose = outward(figure, near, 4), smoothed(figure.vertices, near, 8)
    lift = THICKNESS[kind] + 0.0025 * np.exp(-np.maximum(inside, 0) / 0.012)
    full = loose + normal * (lift * (1 - 0.9 * np.clip(under / 0.02, 0, 1)))[:, None]
    part = cut(figure.triangles, inside)
    position, depth = part.of(full), part.of(inside[:, None])[:, 0]
    colour = np.tile(COLOURS[kind], (len(position), 1))
    if trim is not None:
        colour[depth < 0.009] = trim
    mesh.add(position, colour, part.source, part.triangles)
    hem(
        mesh,
        position,
        part.of(figure.vertices - 0.006 * figure.normals),
        part,
        (COLOURS[kind] if trim is None else trim) * 0.75,
    )


def hem(mesh: Mesh, outer: np.ndarray, inner: np.ndarray, part: Cut, colour: np.ndarray) -> None:
    """Add walls along the edge of a cut, from its outer to its inner side."""
    rim = boundary(part.triangles)
    n, (first, second) = len(rim), rim.T
    ring = np.concatenate([outer[first], outer[second], inner[first], inner[second]])
    a, b, c, d = (np.arange(n) + k * n for k in range(4))
    walls = np.concatenate([np.stack([b, a, c], 1), np.stack([b, c, d], 1)])
    source = part.source[np.concatenate([first, second, first, second])]
    mesh.add(ring, np.tile(colour, (4 * n, 1)), source, walls)


def boundary(triangles: np.ndarray) -> np.ndarray:
    """Return the directed edges (E, 2) that belong to a single triangle."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    key = np.sort(edges, axis=1) @ np.array([1 << 20, 1])
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    return edges[first[count == 1]]


def skin(mesh: Mesh, figure: Character, covered: list[np.ndarray]) -> None:
    """Add the bare skin and 2 cm of the covered skin, with smiling lips, brows and a blush."""
    bare = 0.02 - np.maximum.reduce(covered)  # 2 cm continue under the cloth
    bare[figure.part == 1] = -1.0
    ankle = figure.rest[figure.skeleton.index("left_ankle")][1]
    bare[(figure.vertices[:, 1] < ankle - 0.03)] = -1.0  # in the shoes
    part = cut(figure.triangles, bare)
    x, source = part.of(figure.vertices), part.source
    colour = np.tile(COLOURS[SKIN], (len(x), 1))
    wide, eye = np.abs(x[:, 0]), figure.eye
    face = (x[:, 2] > eye[2] - 0.04) & (x[:, 1] > eye[1] - 0.12)
    blush = np.exp(-(((wide - 0.042) / 0.018) ** 2) - ((x[:, 1] - eye[1] + 0.038) / 0.018) ** 2) * face
    colour += blush[:, None] * (srgb("#cd7a66") - colour) * 0.4
    colour[figure.part[source] == 2] = LIPS
    along = (wide - 0.4 * eye[0]) / (1.6 * eye[0])
    arch = eye[1] + 0.0195 + 0.006 * np.sin(np.pi * np.clip(1.1 * along, 0, 1)) - 0.004 * np.clip(along, 0, 1)
    thick = 0.0036 * (1.15 - 0.7 * np.clip(along, 0, 1))
    brow = np.exp(-(((x[:, 1] - arch) / thick) ** 4)) * ((along > 0) & (along < 1)) * face
    colour += brow[:, None] * (BROWS - colour)
    mesh.add(x + smile(x, figure.part[source] == 2, face), colour, source, part.triangles)


def smile(x: np.ndarray, lips: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Return the offsets (N, 3) m of the skin for a smile: the corners of the mouth move up and apart."""
    wide, corner = np.abs(x[:, 0]), np.abs(x[lips, 0]).max()
    height = x[lips, 1][np.abs(x[lips, 0]) > 0.8 * corner].mean()
    near = np.exp(-(((wide - corner) / 0.016) ** 2) - ((x[:, 1] - height) / 0.016) ** 2) * face
    return np.stack([0.0015 * np.sign(x[:, 0]) * near, SMILE * near, -0.001 * near], axis=1)


def grid(rows: int, columns: int) -> np.ndarray:
    """Return the triangles of a tube of `rows` rings."""
    k = np.arange(rows - 1)[:, None] * columns + np.arange(columns)[None]
    after = np.arange(rows - 1)[:, None] * columns + (np.arange(columns)[None] + 1) % columns
    quads = np.stack([k, after, after + columns, k + columns], axis=-1).reshape(-1, 4)
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def shoes(mesh: Mesh, figure: Character) -> None:
    """Add shoes: rings across each foot with its width and height, round in front and behind, flat below."""
    for side in ("left", "right"):
        ankle, ball = (figure.skeleton.index(f"{side}_{part}") for part in ("ankle", "foot"))
        own = np.isin(figure.joint[:, 0], [ankle, ball]) & (figure.vertices[:, 1] < figure.rest[ankle][1] + 0.02)
        x = figure.vertices[own]
        heel, tip = x[:, 2].min() - 0.006, x[:, 2].max() + 0.01
        rows, columns = 26, 28
        along = (1 - np.cos(np.linspace(0, np.pi, rows))) / 2
        place = heel + along * (tip - heel)
        bins = np.linspace(heel, tip, 15)
        which = np.clip(np.digitize(x[:, 2], bins) - 1, 0, 13)
        some = [k for k in range(14) if (which == k).any()]
        middle = (bins[:-1] + bins[1:])[some] / 2
        low, high = (np.array([f(x[which == k, 0]) for k in some]) for f in (np.min, np.max))
        top = np.array([np.quantile(x[which == k, 1], 0.97) for k in some])
        top = np.minimum(np.minimum.accumulate(top[::1].clip(0.045)), figure.rest[ankle][1] + 0.012)
        wide = np.interp(place, middle, (high - low) / 2) + 0.005
        centre = np.interp(place, middle, (high + low) / 2)
        tall = np.interp(place, middle, top) + 0.008
        for _ in range(3):
            wide, centre, tall = (
                np.convolve(np.pad(v, 1, "edge"), [0.25, 0.5, 0.25], "valid") for v in (wide, centre, tall)
            )
        round_ = np.sqrt(np.clip(1 - np.abs(2 * along - 1) ** 5, 0, 1))
        turn = np.linspace(0, 2 * np.pi, columns, endpoint=False)
        cosine, sine = np.cos(turn), np.sin(turn)
        across = np.sign(cosine) * np.abs(cosine) ** 0.75
        upward = np.where(sine > 0, np.abs(sine) ** 0.9, -(np.abs(sine) ** 0.35))
        half = tall / 2
        y = half[:, None] + upward[None] * half[:, None] * np.where(sine > 0, (0.45 + 0.55 * round_)[:, None], 1.0)
        ring = np.stack(
            [centre[:, None] + wide[:, None] * round_[:, None] * across[None], y, place[:, None] + 0 * y], axis=-1
        ).reshape(-1, 3)
        colour = np.where((ring[:, 1] < 0.021)[:, None], SOLE, COLOURS[SHOES])
        colour = np.where(((ring[:, 1] > 0.021) & (ring[:, 1] < 0.027))[:, None], COLOURS[SHOES] * 0.8, colour)
        of_ball = int(np.flatnonzero(figure.joint[:, 0] == ball)[0])
        of_ankle = int(np.flatnonzero((figure.joint[:, 0] == ankle) & (figure.weight[:, 0] > 0.95))[0])
        whole_ball = np.flatnonzero((figure.joint[:, 0] == ball) & (figure.weight[:, 0] > 0.95))
        of_ball = int(whole_ball[0]) if len(whole_ball) else of_ball
        source = np.where(ring[:, 2] > figure.rest[ball][2], of_ball, of_ankle)
        mesh.add(ring, colour, source, grid(rows, columns))


def eyes(mesh: Mesh, figure: Character) -> None:
    """Add white balls with an iris and a pupil, because the figure's eyes are too coarse for painting."""
    head = head_vertex(figure)
    rows, columns = 24, 32
    tilt = np.linspace(0.0, 0.62 * np.pi, rows)[:, None]
    turn = np.linspace(0, 2 * np.pi, columns, endpoint=False)[None]
    ball = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt) + 0 * turn], -1)
    angle = np.repeat(tilt[:, 0], columns)
    colour = np.where((angle < 0.56)[:, None], IRIS, WHITE)
    colour = np.where(((angle > 0.47) & (angle < 0.56))[:, None], IRIS * 0.35, colour)
    colour = np.where((angle < 0.26)[:, None], PUPIL, colour)
    own = figure.vertices[figure.part == 1]
    for sign in (1, -1):
        side = own[own[:, 0] * sign > 0]
        middle = (side.max(axis=0) + side.min(axis=0)) / 2
        radius = (side.max(axis=0) - side.min(axis=0))[1] / 2
        mesh.add(
            middle + ball.reshape(-1, 3) * radius, colour, np.full(len(colour), head), grid(rows, columns)[:, ::-1]
        )


def head_vertex(figure: Character) -> int:
    """Return a vertex that follows only the head."""
    head = figure.skeleton.index("head")
    return int(np.flatnonzero((figure.joint[:, 0] == head) & (figure.weight[:, 0] > 0.99))[0])


def hair(mesh: Mesh, figure: Character, inside: np.ndarray) -> None:
    """Add hair: the scalp moved outward, fuller on top and behind, combed back into a bun."""
    x, eye = figure.vertices, figure.eye
    near = figure.triangles[(inside[figure.triangles] > -0.03).any(axis=1)]
    behind = eye[2] - x[:, 2]
    full = 0.012 + 0.010 * np.clip((x[:, 1] - eye[1]) / 0.1, 0, 1) + 0.006 * np.clip(behind / 0.15, 0, 1)
    edge = 0.35 + 0.65 * np.clip(inside / 0.022, 0, 1)
    strand = np.sin(70 * np.arctan2(x[:, 0], x[:, 1] - eye[1] + 0.03))
    position = smoothed(x, near, 3) + outward(figure, near, 10) * ((full + 0.0012 * strand) * edge)[:, None]
    part = cut(figure.triangles, inside)
    outer = part.of(position)
    shade = part.of((1 + 0.16 * strand)[:, None])
    mesh.add(outer, COLOURS[HAIR] * shade, part.source, part.triangles)
    hem(mesh, outer, part.of(x - 0.004 * figure.normals), part, COLOURS[HAIR] * 0.7)
    rows, columns = 16, 24
    tilt, turn = (
        np.linspace(0.001, np.pi - 0.001, rows)[:, None],
        np.linspace(0, 2 * np.pi, columns, endpoint=False)[None],
    )
    wave = np.sin(4 * turn + 5 * tilt)
    ball = np.stack([np.sin(tilt) * np.cos(turn), np.cos(tilt) + 0 * turn, np.sin(tilt) * np.sin(turn)], -1)
    back = outer[outer[:, 2].argmin()]
    bun = [0.0, back[1] + 0.05, back[2] - 0.008] + (ball * (1 + 0.05 * wave[..., None])).reshape(-1, 3) * 0.036
    tint = COLOURS[HAIR] * (1 + 0.16 * wave.reshape(-1, 1))
    mesh.add(bun, tint, np.full(len(bun), head_vertex(figure)), grid(rows, columns))


def normals_of(position: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return unit normals (V, 3)."""
    a, b, c = (position[triangles[:, k]] for k in range(3))
    normal = np.zeros_like(position)
    for k in range(3):
        np.add.at(normal, triangles[:, k], np.cross(b - a, c - a))
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)


def glb(figure: Character, mesh: Mesh) -> bytes:
    """Return the bytes of the .vrm."""
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
        "materials": [
            {"name": "cloth and skin", "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0.82}}
        ],
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
    figure, mesh = load_figure("woman"), Mesh()
    inside = fields(figure)
    skin(mesh, figure, [inside[SHIRT], inside[TROUSERS], inside[HAIR]])
    garment(mesh, figure, inside[SHIRT], SHIRT, COLLAR, 0.0)
    garment(mesh, figure, inside[TROUSERS], TROUSERS, None, inside[SHIRT])
    shoes(mesh, figure)
    eyes(mesh, figure)
    hair(mesh, figure, inside[HAIR])
    content = glb(figure, mesh)
    with written_beside(out) as beside:
        beside.write_bytes(gzip.compress(content, 9, mtime=0))
    print(f"{out}: {mesh.count} vertices, {len(content)} bytes, packed {out.stat().st_size}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else OUTPUT)
