"""The drawn skin of a body: balls and links, built from its primitives."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise

import numpy as np

from bodysense.body.capsules import Primitives, fit_primitives
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.rotation import quaternion_to_matrix

SKIN, HAIR, SHIRT, TROUSERS, SHOES, UNSEEN = range(6)
COLORS = np.array(  # red, green, blue, 0 to 1, of each
    [
        [0.86, 0.68, 0.57],
        [0.30, 0.23, 0.19],
        [0.28, 0.56, 0.62],
        [0.34, 0.39, 0.50],
        [0.22, 0.22, 0.25],
        [0.85, 0.38, 0.36],
    ],
    np.float32,
)
_CLOTHES = {
    "cranium": HAIR,
    "upper_arm": SHIRT,
    "collar": SHIRT,
    "waist": SHIRT,
    "chest": SHIRT,
    "abdomen": SHIRT,
    "pelvis": TROUSERS,
    "thigh": TROUSERS,
    "shin": TROUSERS,
    "foot": SHOES,
    "instep": SHOES,
    "toes": SHOES,
}
_TRUNK = ("pelvis_lower", "pelvis", "abdomen", "waist", "chest", "chest_upper")
_LIMBS = (
    ("thigh_upper", "thigh_lower", "shin_upper", "shin_lower"),
    ("upper_arm_upper", "upper_arm_lower", "forearm_upper", "forearm_lower"),
)


@dataclass(frozen=True, eq=False)
class BodySkin:
    """N balls, each rigid in the frame of a joint, and L links: the skin is the hull of each link's two balls."""

    joint: np.ndarray = field(repr=False)  # (N,) index of the joint that carries each ball
    center: np.ndarray = field(repr=False)  # (N, 3) m, in the joint's frame
    radius: np.ndarray = field(repr=False)  # (N,) m
    link: np.ndarray = field(repr=False)  # (L, 2) balls
    color: np.ndarray = field(repr=False)  # (L,) index into COLORS
    part: np.ndarray = field(repr=False)  # (L,) number of the part of the body: trunk, head, a limb, a hand …


@lru_cache(maxsize=64)
def fit_skin(skeleton: Skeleton) -> BodySkin:
    """Build a skeleton's skin: its primitives, tapered along limbs and joined along the trunk.

    Raises BodysenseError for a skeleton with other points or parents.
    """
    primitives = fit_primitives(skeleton)
    balls: list[tuple[int, np.ndarray, float]] = []
    links: list[tuple[int, int, str]] = []
    ends: dict[str, tuple[int, int]] = {}

    def add(name: str, joint: int, start: np.ndarray, end: np.ndarray, radius: float) -> None:
        ends[name] = (len(balls), len(balls) + 1)
        balls.extend([(joint, start, radius), (joint, end, radius)])
        links.append((*ends[name], name))

    capsules = len(primitives.radius)
    for n, name in enumerate(primitives.names[:capsules]):
        add(name, int(primitives.joint[n]), primitives.start[n], primitives.end[n], float(primitives.radius[n]))
    for n, name in enumerate(primitives.names[capsules:]):
        for k, (start, end, radius) in enumerate(_rods(primitives, n)):
            add(f"{name}{k}", int(primitives.joint[capsules + n]), start, end, radius)

    def join(first: int, second: int, name: str) -> None:
        links.append((first, second, name))

    for below, above in pairwise(_TRUNK):
        for low, high in zip(ends[below], ends[above], strict=True):
            join(low, high, below)
    sides = {"right": 0, "left": 1}  # ends of the trunk's capsules, which run from right to left
    for side, end in sides.items():
        collar, hip = ends[f"{side}_collar"], ends[f"{side}_thigh_upper"][0]
        join(ends["neck"][0], collar[1], "collar")
        join(collar[1], ends[f"{side}_upper_arm_upper"][0], "collar")
        join(ends["chest_upper"][end], collar[1], "collar")
        join(ends["pelvis_lower"][end], hip, "pelvis")
        join(ends[f"{side}_shin_lower"][1], ends[f"{side}_instep"][0], "instep")
    scale = skeleton.height / 1.7
    head = skeleton.index("head")
    nose = primitives.nose - np.array([0.0, 0.0, 0.011]) * scale
    bridge = primitives.nose + np.array([0.0, 0.032, -0.025]) * scale
    add("nose", head, nose, bridge, 0.011 * scale)

    radius = np.array([size for _, _, size in balls])
    joint, center = np.array([joint for joint, _, _ in balls]), np.array([center for _, center, _ in balls])
    center[ends["face"][0]] -= np.array([0.0, 0.028, 0.0]) * scale  # the forehead ends where the hair begins
    radius[ends["cranium"][1]] += 0.004 * scale
    rest = (skeleton.path @ skeleton.rest_offset)[joint]
    for limb in _LIMBS:
        for side in sides:
            parts = [ends[f"{side}_{part}"] for part in limb]
            for (_, end), (start, _) in pairwise(parts):
                # Adjacent capsules of a limb share thickness and position where they meet.
                radius[[end, start]] = radius[[end, start]].mean()
                center[[end, start]] = (center + rest)[[end, start]].mean(axis=0) - rest[[end, start]]
    link = np.array([(first, second) for first, second, _ in links])
    parts = [_part(skeleton, name, *joint[[first, second]].tolist()) for first, second, name in links]
    return BodySkin(
        joint=joint,
        center=center,
        radius=radius,
        link=link,
        color=np.array(
            [next((color for part, color in _CLOTHES.items() if part in name), SKIN) for _, _, name in links]
        ),
        part=np.unique(parts, return_inverse=True)[1],
    )


def place_skin(skin: BodySkin, pose: Pose) -> np.ndarray:
    """Return the centres (..., N, 3) m, world, of the balls of posed bodies."""
    position, rotation = forward_kinematics(pose)
    turn = quaternion_to_matrix(rotation)[..., skin.joint, :, :]
    return position[..., skin.joint, :] + np.einsum("...nij,nj->...ni", turn, skin.center)


def _part(skeleton: Skeleton, name: str, *joints: int) -> str:
    """Return the part of the body of a link between balls of two joints: trunk, nose, limb, hand …"""
    owners = [skeleton.joints[joint] for joint in joints]
    if any(owner.partition("_")[2] in ("", "collar") and owner != "head" for owner in owners):
        return "trunk"
    if owners[-1] == "head":
        return name
    wrist = skeleton.wrist_of[joints[-1]]
    return owners[-1] if wrist < 0 else skeleton.joints[wrist]


def _rods(primitives: Primitives, box: int) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Return parallel capsules along a box's longest axis, which fill it except for its edges."""
    half = primitives.half_size[box]
    thin, wide, long = np.argsort(half)
    radius = float(half[thin])
    along, across = np.eye(3)[long] * max(half[long] - radius, 0.0), np.eye(3)[wide] * max(half[wide] - radius, 0.0)
    count = int(np.ceil(half[wide] / radius)) + 1
    middles = primitives.center[box] + np.linspace(-1, 1, count)[:, None] * across
    return [(middle - along, middle + along, radius) for middle in middles]
