"""Markers on the skin of our body: spots found by going from inside outward until the body's primitives end.

The body carries them; how joints follow from markers is not asked here, so that the recipes can be held against it.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton, default_body, default_skeleton
from bodysense.geometry.rotation import quaternion_rotate
from bodysense.io.clip import Clip
from bodysense.io.markers.body import body_of
from bodysense.io.markers.marker_sets import recognised
from bodysense.io.markers.raw_markers import MarkerFormat, RawMarkers

RADIUS = 0.007  # m, of a marker

# Spot: the joint that carries it, the joint from which the way outward begins, an offset from there, the way. Left.
SPOTS = {
    "thigh": ("left_hip", "left_hip", (0.0, -0.2, 0.0), (1.0, 0.0, 0.2)),
    "knee": ("left_hip", "left_knee", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
    "knee_in": ("left_hip", "left_knee", (0.0, 0.0, 0.0), (-1.0, 0.0, 0.0)),
    "shin": ("left_knee", "left_knee", (0.0, -0.2, 0.0), (1.0, 0.0, 0.1)),
    "ankle": ("left_knee", "left_ankle", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
    "ankle_in": ("left_knee", "left_ankle", (0.0, 0.0, 0.0), (-1.0, 0.0, 0.0)),
    "heel": ("left_ankle", "left_ankle", (0.0, -0.035, 0.0), (0.0, 0.0, -1.0)),
    "second_metatarsal": ("left_ankle", "left_foot", (0.005, 0.0, -0.01), (0.0, 1.0, 0.0)),
    "first_metatarsal": ("left_ankle", "left_foot", (0.0, 0.0, 0.0), (-1.0, 0.0, 0.0)),
    "fifth_metatarsal": ("left_ankle", "left_foot", (0.0, 0.0, -0.02), (1.0, 0.0, 0.0)),
    "toe_tip": ("left_foot", "left_toe", (0.0, 0.0, -0.02), (0.0, 1.0, 0.0)),
    "acromion": ("left_collar", "left_shoulder", (-0.01, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "shoulder_back": ("left_collar", "left_shoulder", (-0.03, 0.0, 0.0), (0.0, 0.0, -1.0)),
    "upper_arm": ("left_shoulder", "left_shoulder", (0.13, 0.0, 0.0), (0.0, 1.0, -0.5)),
    "elbow": ("left_shoulder", "left_elbow", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "elbow_in": ("left_shoulder", "left_elbow", (0.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
    "forearm": ("left_elbow", "left_elbow", (0.1, 0.0, 0.0), (0.0, 1.0, 0.3)),
    "wrist_thumb": ("left_wrist", "left_wrist", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "wrist_pinky": ("left_wrist", "left_wrist", (0.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
    "hand": ("left_wrist", "left_middle1", (-0.01, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "hand_pinky": ("left_wrist", "left_pinky1", (-0.015, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "head_front": ("head", "head", (0.055, 0.08, 0.0), (0.2, 0.0, 1.0)),
    "head_back": ("head", "head", (0.045, 0.08, 0.0), (0.2, 0.0, -1.0)),
    "head_side": ("head", "head", (0.0, 0.06, 0.0), (1.0, 0.0, 0.0)),
    "c7": ("spine3", "neck", (0.0, 0.0, 0.0), (0.0, 0.2, -1.0)),
    "t10": ("spine3", "spine3", (0.0, -0.06, 0.05), (0.0, 0.0, -1.0)),
    "clavicle": ("spine3", "spine3", (0.0, 0.09, 0.03), (0.0, 0.0, 1.0)),
    "sternum": ("spine3", "spine3", (0.0, -0.04, 0.03), (0.0, 0.0, 1.0)),
    "back_side": ("spine3", "spine3", (0.09, -0.05, 0.04), (0.0, 0.0, -1.0)),
    "head_top": ("head", "head", (0.0, 0.05, 0.0), (0.0, 1.0, 0.0)),
    "forehead": ("head", "head", (0.0, 0.08, 0.0), (0.0, 0.0, 1.0)),
}

PLUG_IN_GAIT = {
    "asis": "LASI", "psis": "LPSI", "thigh": "LTHI", "knee": "LKNE", "shin": "LTIB", "ankle": "LANK", "heel": "LHEE",
    "second_metatarsal": "LTOE", "acromion": "LSHO", "upper_arm": "LUPA", "elbow": "LELB", "forearm": "LFRM",
    "wrist_thumb": "LWRA", "wrist_pinky": "LWRB", "hand": "LFIN", "head_front": "LFHD", "head_back": "LBHD",
    "c7": "C7", "t10": "T10", "clavicle": "CLAV", "sternum": "STRN",
}  # fmt: skip
RIZZOLI = {
    "asis": "L_IAS", "psis": "L_IPS", "thigh": "L_FTC", "knee": "L_FLE", "knee_in": "L_FME", "ankle": "L_FAL",
    "ankle_in": "L_TAM", "heel": "L_FCC", "first_metatarsal": "L_FM1", "second_metatarsal": "L_FM2",
    "fifth_metatarsal": "L_FM5", "acromion": "L_SAE", "elbow": "L_HLE", "elbow_in": "L_HME", "wrist_thumb": "L_RSP",
    "wrist_pinky": "L_USP", "hand": "L_HM2", "hand_pinky": "L_HM5", "head_front": "LFHD", "head_back": "LBHD",
    "c7": "CV7", "t10": "TV10", "clavicle": "SJN", "sternum": "SXS",
}  # fmt: skip
BASELINE = {
    "asis": "WaistLFront", "psis": "WaistLBack", "thigh": "LThigh", "knee": "LKneeOut", "shin": "LShin",
    "ankle": "LAnkleOut", "heel": "LHeel", "fifth_metatarsal": "LToeOut", "first_metatarsal": "LToeIn",
    "toe_tip": "LToeTip", "acromion": "LShoulderTop", "shoulder_back": "LShoulderBack", "upper_arm": "LUArmHigh",
    "elbow": "LElbowOut", "wrist_thumb": "LWristOut", "wrist_pinky": "LWristIn", "hand_pinky": "LHandOut",
    "head_top": "HeadTop", "forehead": "HeadFront", "head_side": "HeadSide", "c7": "BackTop", "clavicle": "Chest",
    "back_side": "BackLeft",
}  # fmt: skip
OPENSIM = {
    "asis": "L.ASIS", "sacrum": "V.Sacral", "thigh": "L.Thigh.Front", "knee": "L.Knee.Lat", "knee_in": "L.Knee.Med",
    "shin": "L.Shank.Front", "ankle": "L.Ankle.Lat", "ankle_in": "L.Ankle.Med", "heel": "L.Heel",
    "toe_tip": "L.Toe.Tip", "fifth_metatarsal": "L.Toe.Lat", "first_metatarsal": "L.Toe.Med", "acromion": "L.Acromium",
    "upper_arm": "L.Bicep", "elbow": "L.Elbow", "wrist_thumb": "L.Wrist.Lat", "wrist_pinky": "L.Wrist.Med",
    "clavicle": "Sternum", "head_top": "Top.Head",
}  # fmt: skip
RAJAGOPAL = {
    "asis": "LASI", "psis": "LPSI", "thigh": "LTH1", "knee": "LLFC", "knee_in": "LMFC", "shin": "LTB1",
    "ankle": "LLMAL", "ankle_in": "LMMAL", "heel": "LCAL", "first_metatarsal": "LTOE", "fifth_metatarsal": "LMT5",
    "acromion": "LACR", "upper_arm": "LUA1", "elbow": "LLEL", "elbow_in": "LMEL", "wrist_thumb": "LFAradius",
    "wrist_pinky": "LFAulna", "c7": "C7", "clavicle": "CLAV",
}  # fmt: skip
OPENCAP = {
    "asis": "L.ASIS_study", "psis": "L.PSIS_study", "thigh": "L_thigh1_study", "knee": "L_knee_study",
    "knee_in": "L_mknee_study", "shin": "L_sh1_study", "ankle": "L_ankle_study", "ankle_in": "L_mankle_study",
    "heel": "L_calc_study", "first_metatarsal": "L_toe_study", "fifth_metatarsal": "L_5meta_study",
    "acromion": "L_shoulder_study", "elbow": "L_lelbow_study", "elbow_in": "L_melbow_study",
    "wrist_thumb": "L_lwrist_study", "wrist_pinky": "L_mwrist_study", "c7": "C7_study",
}  # fmt: skip
PAIRS = {
    "asis": "LASI", "psis": "LPSI", "knee": "LLKN", "knee_in": "LMKN", "ankle": "LLAK", "ankle_in": "LMAK",
    "heel": "LHEE", "first_metatarsal": "LMT1", "fifth_metatarsal": "LMT5", "acromion": "LSHO", "elbow": "LLEL",
    "elbow_in": "LMEL", "wrist_thumb": "LLWR", "wrist_pinky": "LMWR", "c7": "C7", "clavicle": "CLAV", "sternum": "STRN",
    "t10": "T10", "head_front": "LFHD", "head_back": "LBHD",
}  # fmt: skip
IOR = {
    "asis": "LASIS", "psis": "LPSIS", "thigh": "LGT", "knee": "LLE", "knee_in": "LME", "ankle": "LLM",
    "ankle_in": "LMM", "heel": "LCA", "first_metatarsal": "LFM1", "second_metatarsal": "LFM2",
    "fifth_metatarsal": "LFM5", "acromion": "LA", "elbow": "LHLE", "elbow_in": "LHME", "wrist_thumb": "LRSP",
    "wrist_pinky": "LUSP", "c7": "C7", "clavicle": "SJN", "sternum": "SXS", "t10": "T10",
}  # fmt: skip
STANFORD = {  # Hamner's laboratory, later
    "asis": "L.ASIS", "psis": "L.PSIS", "thigh": "L.TH1", "knee": "L.Knee", "knee_in": "L.MKnee", "shin": "L.SH1",
    "ankle": "L.Ankle", "ankle_in": "L.MAnkle", "heel": "L.Heel", "first_metatarsal": "L.Toe",
    "fifth_metatarsal": "L.MT5", "acromion": "L.Shoulder", "upper_arm": "L.Biceps", "elbow": "L.Elbow",
    "elbow_in": "L.MElbow", "forearm": "L.Forearm", "c7": "C7", "clavicle": "Clavicle",
}  # fmt: skip
QUALISYS = {**RIZZOLI, "wrist_pinky": "L_UHE"}
LEGS = {
    spot: label for spot, label in PAIRS.items() if spot[:4] in ("asis", "psis", "knee", "ankl", "heel", "firs", "fift")
}
SETS = {"Plug-in Gait": PLUG_IN_GAIT, "Rizzoli (IOR)": RIZZOLI, "OptiTrack Baseline": BASELINE}
LABORATORIES = {
    "OpenSim gait2354 and Hamner": OPENSIM,
    "Rajagopal": RAJAGOPAL,
    "OpenCap": OPENCAP,
    "anatomical pairs": PAIRS,
    "Rizzoli (IOR)": QUALISYS,
}
# Other labels and other markers of these: a set, and the labels.
VARIANTS = {
    "IOR": ("Rizzoli (IOR)", IOR),
    "IOR with CAST's names of bones": (
        "Rizzoli (IOR)",
        {**IOR, "knee": "LFLE", "knee_in": "LFME", "ankle": "LFAL", "ankle_in": "LTAM", "heel": "LFCC"},
    ),
    "LKN and MKN": ("anatomical pairs", {**PAIRS, "knee": "LKN", "ankle": "LAK"}),
    "LLKNE and LMKNE": (
        "anatomical pairs",
        {**PAIRS, "knee": "LLKNE", "knee_in": "LMKNE", "ankle": "LLANK", "ankle_in": "LMANK"},
    ),
    "LEL and LMEL": ("anatomical pairs", {**PAIRS, "elbow": "LEL", "wrist_thumb": "LWR"}),
    "MKnee": ("OpenSim gait2354 and Hamner", STANFORD),
    "a walking trial of gait2354": (
        "OpenSim gait2354 and Hamner",
        {spot: label for spot, label in OPENSIM.items() if spot[:4] not in ("knee", "ankl")},
    ),
}
MIDDLE = ("sacrum", "c7", "t10", "clavicle", "sternum", "head_top", "forehead")
ONE_SIDE = ("head_side",)


# The spines of the pelvis are felt as bone: in front by Bell et al. 1990 (Journal of Biomechanics 23, 617-621), whose
# hip is 14 % of the pelvis's width inward, 30 % below and 22 % behind; behind so that the pelvis is 15.5 cm deep.
WIDTH = 2 * 0.1056 / (1 - 2 * 0.14)
BONES = {
    "asis": ("pelvis", "left_hip", (0.14 * WIDTH, 0.30 * WIDTH, 0.22 * WIDTH)),
    "psis": ("pelvis", "left_hip", (0.045 - 0.1056, 0.30 * WIDTH + 0.027, 0.22 * WIDTH - 0.153)),
    "sacrum": ("pelvis", "left_hip", (-0.1056, 0.30 * WIDTH + 0.027, 0.22 * WIDTH - 0.153)),
}


def marker_positions(pose: Pose, names: dict[str, str]) -> dict[str, np.ndarray]:
    """Return the positions (T, 3) m of the markers of a set on a posed body."""
    position, rotation = forward_kinematics(pose)
    places: dict[str, np.ndarray] = {}
    for spot, label in names.items():
        joint, local = _spot(pose.skeleton, spot)
        sides = ((1.0, "left"),) if spot in (*MIDDLE, *ONE_SIDE) else ((1.0, "left"), (-1.0, "right"))
        for sign, side in sides:
            k = pose.skeleton.index(joint.replace("left", side))
            offset = np.broadcast_to(local * [sign, 1, 1], position[:, k].shape)
            places[label if side == "left" else _right(label)] = position[:, k] + quaternion_rotate(
                rotation[:, k], offset
            )
    return places


def _right(label: str) -> str:
    if label.startswith("Waist"):
        return label.replace("WaistL", "WaistR")
    return "BackRight" if label == "BackLeft" else "R" + label[1:]


def _spot(skeleton: Skeleton, spot: str) -> tuple[str, np.ndarray]:
    """Return the joint that carries a spot, and its offset in that joint's frame, which grows with the body."""
    size = skeleton.height / default_skeleton().height
    real = (skeleton.path @ skeleton.rest_offset) + skeleton.rest_offset[0]
    joint, start = BONES[spot][:2] if spot in BONES else SPOTS[spot][:2]
    beside = np.array(BONES[spot][2]) if spot in BONES else _skin(spot)
    return joint, real[skeleton.index(start)] - real[skeleton.index(joint)] + size * beside


@cache
def _skin(spot: str) -> np.ndarray:
    """Return the offset of a spot from its joint: the outermost skin along the spot's direction."""
    joint, start, offset, way = SPOTS[spot]
    body = default_skeleton()
    place = (body.path @ body.rest_offset) + body.rest_offset[0]
    begin, step = place[body.index(start)] + offset, np.array(way) / np.linalg.norm(way)
    along = begin + np.arange(0, 0.2, 0.0005)[:, None] * step
    inside = np.flatnonzero(_distance(along, joint, place, body) < RADIUS)
    return along[inside[-1]] - place[body.index(start)]


def _distance(points: np.ndarray, joint: str, place: np.ndarray, body: Skeleton) -> np.ndarray:
    """(N,) m from the skin of the segments around a joint, negative within."""
    trunk = ("pelvis", "spine1", "spine2", "spine3", "neck")
    least = np.full(len(points), 1.0)
    for row in default_body()["primitives"]:
        near = row["joint"] in trunk if joint in trunk else _part(row["joint"]) == _part(joint)
        if not near:
            continue
        own = place[body.index(row["joint"])]
        if row["kind"] == "capsule":
            a, b = own + row["start"], own + row["end"]
            share = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-12), 0, 1)
            apart = np.linalg.norm(points - a - share[:, None] * (b - a), axis=-1) - row["radius"]
        else:
            q = np.abs(points - own - row["center"]) - row["half_size"]
            apart = np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(axis=-1), 0)
        least = np.minimum(least, apart)
    return least


def _part(joint: str) -> str:
    for part, names in {
        "arm": ("collar", "shoulder", "elbow", "wrist"),
        "leg": ("hip", "knee"),
        "foot": ("ankle", "foot"),
        "head": ("head",),
    }.items():
        if joint.removeprefix("left_") in names:
            return part
    return joint


def raw_of(clip: Clip, names: dict[str, str], scale: float = 1.0, unit: str = "m") -> RawMarkers:
    places = marker_positions(clip.pose, names)
    position = np.stack(list(places.values()), axis=1) * scale
    return RawMarkers(tuple(places), position, clip.time, clip.frame_rate, unit)  # type: ignore[arg-type]


def found(raw: RawMarkers, form: MarkerFormat = MarkerFormat()):
    known = recognised(raw.names)
    assert known is not None
    return body_of(raw, form, known, "walk.c3d")


def errors(raw: RawMarkers, clip: Clip, form: MarkerFormat = MarkerFormat()) -> dict[str, float]:
    """Mean error of each joint, m."""
    seen, truth = found(raw, form).observation, np.asarray(forward_kinematics(clip.pose)[0])
    apart = np.linalg.norm(seen.position - truth[:, clip.pose.skeleton.indices(seen.points)], axis=-1)
    known = np.asarray(seen.has_position.any(axis=0))
    return {name: float(np.nanmean(apart[:, k])) for k, name in enumerate(seen.points) if known[k]}
