"""Results of SMPL, SMPL-H and SMPL-X from video tools, .npz or .npy, with up axis and floor inferred.

Supported are whole poses (`poses`, `pose`, `smpl_poses` …: 22, 24, 52 or 55 joints) or parts (`global_orient` with
`body_pose`, `left_hand_pose`, `right_hand_pose`), as axis-angle or matrices; `transl` or `trans`; `fps`. The body is
the default one unless a body model (`io.body_model`) gives it the bones of its `betas`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from bodysense.arrays import array_shapes
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.shape import stature
from bodysense.body.skeleton import BODY as BODY_JOINTS
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import sound
from bodysense.geometry.rotation import (
    matrix_to_quaternion,
    quaternion_canonical,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
)
from bodysense.io.clip import Clip
from bodysense.io.fingers import is_finger, with_fingers
from bodysense.io.formats.body_model import shape_in_file
from bodysense.io.formats.motion_arrays import (
    MOTION,
    VECTOR,
    as_frames,
    is_pickled,
    motion_arrays,
    places_of_vectors,
)
from bodysense.io.formats.pickled import ENDINGS as PICKLES
from bodysense.io.formats.point_layouts import DOWN, LAYOUTS, Y_DOWN, JointPlaces, Layout, layouts_of
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.observing.world import (
    USUAL,
    clearance_of,
    doubts,
    judged_up,
    moments,
    signed,
    told_warning,
)
from bodysense.observing.world_axes import TURNS, UpAxis
from bodysense.quality.plausible import path_in_metres

USUAL_RATE = 30.0  # Hz, for files without a rate
WHOLE = ("poses", "pose", "smpl_poses", "fullpose", "full_pose", "poses_body", "pose_world", "pose_aa", "smpl_thetas")
ORIENT = ("global_orient", "root_orient", "root_pose", "global_orient_world")
BODY = ("body_pose", "pose_body")
HANDS = {"left": ("left_hand_pose", "lhand_pose"), "right": ("right_hand_pose", "rhand_pose")}
PLACE = ("transl", "trans", "smpl_trans", "trans_world", "translation", "root_trans", "global_transl", "cam_trans")
SCALING = "smpl_scaling"  # of a set of dances: units of `smpl_trans` in a metre
RATE = ("fps", "mocap_framerate", "mocap_frame_rate", "frame_rate", "framerate")
_KEYS = (*WHOLE, *ORIENT, *BODY, *HANDS["left"], *HANDS["right"], *PLACE, *RATE, SCALING)
_AMASS = {156, 165}  # widths of `poses` that `io.amass` reads
_FLOOR = 0.1  # m: a floor closer to 0 is taken as 0
_SQUARE = 0.05  # largest deviation of a matrix from a rotation
_LARGEST = 6 * np.pi  # rad; longer rotation vectors are degrees, or no rotations
_LIMBS = ("knee", "ankle", "elbow", "wrist")
# Bones of joint places. Places of recorded people are within these limits even with 3 cm of noise; rotation vectors,
# read as places, are not.
_ALIKE = 0.9  # least correlation of their lengths with ours
_EVEN = 0.17  # largest deviation of the logarithms of the limbs' sizes, as factors of ours
_RIGID = 0.25  # largest share of its length by which a limb's bone usually varies
_FEWEST = 14  # bones that are seen


def is_smpl(path: str | Path) -> bool:
    """Whether a file is SMPL but not AMASS: an .npy, or an .npz with such arrays."""
    path = Path(path)
    if path.suffix.lower() in (".npy", *PICKLES):
        return True
    if path.suffix.lower() != ".npz":
        return False
    shapes = array_shapes(path)
    names = set(shapes)
    if not names & {*WHOLE, *ORIENT, *BODY} or "has_position" in names:
        return False
    rated = bool(names & {"mocap_framerate", "mocap_frame_rate"}) and "trans" in names
    whole = "poses" in shapes and shapes["poses"][1:] in {(width,) for width in _AMASS}
    return not (rated and (whole or {"root_orient", "pose_body", "pose_hand"} <= names))


def joint_places(
    path: str | Path, rate: float | None = None, layout: Layout | None = None, figure: int | None = None
) -> JointPlaces | None:
    """Return joint places of a file that holds these, in SMPL's order or in that of a layout; else None.

    An array (T, joints, 3) or (T, 3 joints) may hold rotations (axis-angle) or positions. The usual distances between
    joints that a bone connects are those of a body, up to its size, if they are positions; those of rotation vectors
    are not. Positions that are not finite are missing (NaN). `rate` is used in place of the file's; `figure` chooses
    one of several motions.

    Raises BodysenseError for an array of another layout than the given one, and for one that needs a layout.
    """
    path = Path(path)
    if not is_smpl(path):
        return None
    try:
        arrays = motion_arrays(path, (*_KEYS, MOTION), (*WHOLE, *ORIENT), figure)
    except BodysenseError:
        if is_pickled(path):
            raise
        return None  # reading it reports the error
    found = _first(arrays, (MOTION, *WHOLE))
    if found is None or found[1].dtype.kind not in "fiu" or not len(found[1]):
        return None
    values = as_frames(found[1], str(path), figure)
    if MOTION in arrays and "lengths" in arrays and arrays["lengths"].size == len(found[1]):
        values = values[: int(arrays["lengths"].reshape(-1)[(figure or 1) - 1])]
    remarks: list[str] = []
    if layout in (None, "humanml3d") and values.shape[1:] == (VECTOR,):
        place = places_of_vectors(values.astype(np.float64))
        if layout is None and not _is_body(place):
            raise BodysenseError(
                f"{path}: an array {values.shape} of HumanML3D's vectors, whose joints (recover_from_ric) are not a "
                "body's; multiply it by the data set's Std.npy and add its Mean.npy, or read it unchanged with "
                "--points humanml3d"
            )
        remarks.append("read as HumanML3D's vectors, 263 numbers a frame")
        return JointPlaces(place, default_skeleton().joints[:22], _rate(path, arrays, rate, remarks), tuple(remarks))
    if layout is not None:
        names = LAYOUTS.get(layout, ())
        if values.shape[1:] not in {(len(names), 3), (3 * len(names),)}:
            raise BodysenseError(
                f"{path}: --points {layout}: its points are (T, {len(names) or VECTOR}{', 3' if names else ''}), but "
                f"the array is {values.shape}; give the layout that it has: {', '.join(layouts_of(values) or LAYOUTS)}"
            )
        place = _finite(values.reshape(len(values), -1, 3))
        axes = DOWN if layout in Y_DOWN else None
        return JointPlaces(place, names, _rate(path, arrays, rate, remarks), tuple(remarks), axes)
    if fitting := layouts_of(values):
        raise BodysenseError(
            f"{path}: an array {values.shape} of points, whose layout is not told; give it: "
            f"{' or '.join(f'--points {name}' for name in fitting)}"
        )
    if values.shape[1:] not in {shape for count in (22, 24, 52, 55) for shape in ((count, 3), (3 * count,))}:
        return None
    place = _finite(values.reshape(len(values), -1, 3)[:, :22])
    if not _is_body(place):
        return None
    return JointPlaces(place, default_skeleton().joints[:22], _rate(path, arrays, rate, remarks), tuple(remarks))


def _finite(place: np.ndarray) -> np.ndarray:
    place = place.astype(np.float64)
    return np.where(sound(place).all(axis=-1, keepdims=True), place, np.nan)


def _is_body(place: np.ndarray) -> bool:
    """Whether points (T, 22, 3) are as far apart as the joints of a body, whatever its size."""
    skeleton = default_skeleton()
    bone = np.linalg.norm(place[:, 1:] - place[:, list(skeleton.parents[1:22])], axis=-1)
    seen = np.flatnonzero(np.isfinite(bone).any(axis=0))
    if len(seen) < _FEWEST:
        return False
    usual = np.linalg.norm(skeleton.rest_offset[1:22], axis=-1)[seen]
    length = np.nanmedian(bone[:, seen], axis=0)
    if not (length > 1e-3 * length.max()).all() or not np.corrcoef(length, usual)[0, 1] > _ALIKE:
        return False
    limbs = [k for k, joint in enumerate(seen) if skeleton.joints[joint + 1].endswith(_LIMBS)]
    varies = np.nanmedian(np.abs(bone[:, seen] - length), axis=0) / length
    return bool(np.log(length / usual)[limbs].std() < _EVEN and np.median(varies[limbs]) < _RIGID)


def read_smpl(
    path: str | Path, rate: float | None = None, options: ReadingOptions = AS_FOUND
) -> tuple[Clip, tuple[str, ...]]:
    """Read the motion of a file in canonical form, and remarks; `rate` Hz is used in place of the file's.

    `options` give the body model, the upward axis, the unit of the path, and which of several motions.

    Raises BodysenseError, naming the file and the fix, if the file holds no such motion.
    """
    path = Path(path)
    arrays = motion_arrays(path, _KEYS, (*WHOLE, *ORIENT), options.figure)
    remarks: list[str] = []
    turns, rows = _rotations(path, arrays)
    skeleton, pelvis = default_skeleton(), np.zeros(3)
    if options.smpl_model is not None:
        if path.suffix.lower() != ".npz":
            raise BodysenseError(f"{path}: an array of poses has no betas for --smpl-model; leave it out")
        shape = shape_in_file(path, options.smpl_model)
        skeleton, pelvis = shape.skeleton, shape.pelvis
        remarks.append(f"bones by the body model, {float(stature(skeleton.rest_offset)):.2f} m tall")
    rotation = np.zeros((len(turns), len(skeleton.joints), 4))
    rotation[..., 0] = 1
    rotation[:, rows] = turns
    place = _first(arrays, PLACE)
    hertz = _rate(path, arrays, rate, remarks)
    root, warnings = np.zeros((len(rotation), 3)), list[str]()
    if place is not None:
        path_metres, warnings = _path(path, place, arrays, len(rotation), hertz, options, remarks)
        root = path_metres + pelvis
    up, doubts_about_up = _up(Pose(skeleton, root, rotation), place is not None, hertz, options.up)
    if up != "y":
        camera = ", as in a camera's axes" if up == "-y" else ""
        remarks.append(f"{signed(up)} is up{camera}: turned to +Y")
    turn = TURNS[up]
    rotation[:, 0] = quaternion_multiply(turn, rotation[:, 0])
    root = quaternion_rotate(turn, root)
    missing = [name for name in skeleton.joints if is_finger(name) and skeleton.index(name) not in rows]
    pose, has_fingers = with_fingers(Pose(skeleton, root, quaternion_canonical(rotation)), missing)
    root = root + _lift_to_floor(pose, place is not None, remarks)
    clip = Clip(path.stem, Pose(skeleton, root, pose.rotation), hertz, has_fingers=has_fingers)
    return replace(clip, warnings=(*warnings, *doubts_about_up)), tuple(remarks)


def _first(arrays: Mapping[str, np.ndarray], names: tuple[str, ...]) -> tuple[str, np.ndarray] | None:
    return next(((name, arrays[name]) for name in names if name in arrays), None)


def _rotations(path: Path, arrays: Mapping[str, np.ndarray]) -> tuple[np.ndarray, list[int]]:
    """Return rotations (T, N, 4), and the names of their joints."""
    body = list(range(22))
    hands = list(range(22, 52))
    whole = _first(arrays, WHOLE)
    if whole is not None:
        turns = _turns(path, *whole, counts=(22, 24, 52, 55))
        count = turns.shape[1]
        if count == 52:
            return turns, [*body, *hands]
        return (turns[:, [*body, *range(25, 55)]], [*body, *hands]) if count == 55 else (turns[:, :22], body)
    orient, rest = _first(arrays, ORIENT), _first(arrays, BODY)
    if orient is None or rest is None:
        raise BodysenseError(
            f"{path}: no poses in it; give 'poses' (T, 72), or 'global_orient' (T, 3) and 'body_pose' (T, 63 or 69)"
        )
    parts = [_turns(path, *orient, counts=(1,)), _turns(path, *rest, counts=(21, 23))[:, :21]]
    rows = body
    for k, names in enumerate(HANDS.values()):
        hand = _first(arrays, names)
        if hand is not None and hand[1].size == len(parts[0]) * 45 * (3 if hand[1].shape[-2:] == (3, 3) else 1):
            parts.append(_turns(path, *hand, counts=(15,)))  # other widths are of a basis that is not included
            rows = [*rows, *hands[15 * k : 15 * k + 15]]
    if len({len(part) for part in parts}) != 1:
        raise BodysenseError(f"{path}: parts of its poses have {', '.join(str(len(part)) for part in parts)} frames")
    return np.concatenate(parts, axis=1), rows


def _turns(path: Path, name: str, values: np.ndarray, counts: tuple[int, ...]) -> np.ndarray:
    """Return rotations (T, N, 4) from axis-angle (T, 3 N), (T, N, 3) or matrices (T, N, 3, 3)."""
    values = _numbers(path, name, values)
    shape = values.shape
    if shape[-2:] == (3, 3) and values.size in {len(values) * count * 9 for count in counts}:
        matrices = values.reshape(len(values), -1, 3, 3)
        if not np.abs(matrices @ np.swapaxes(matrices, -1, -2) - np.eye(3)).max(initial=0) < _SQUARE:
            raise BodysenseError(f"{path}: {name!r} has shape {shape}, but holds no rotation matrices; export it again")
        return matrix_to_quaternion(matrices)
    lasts = {3, *(3 * count for count in counts)}
    if values.ndim < 2 or values.size not in {len(values) * count * 3 for count in counts} or shape[-1] not in lasts:
        widths = " or ".join(str(3 * count) for count in counts)
        raise BodysenseError(
            f"{path}: {name!r} has shape {shape}; give one person's, (T, {widths}) axis-angle or (T, joints, 3, 3), "
            "or joint places (T, 22, 3)"
        )
    vectors = values.reshape(len(values), -1, 3)
    longest = float(np.linalg.norm(vectors, axis=-1).max())
    if longest > _LARGEST:
        raise BodysenseError(
            f"{path}: {name!r} has rotation vectors of up to {longest:.3g} rad, and is not joint places of a body "
            "either; give radians, or places (T, 22, 3) in SMPL's order of joints"
        )
    return quaternion_exp(vectors)


def _numbers(path: Path, name: str, values: np.ndarray) -> np.ndarray:
    if values.dtype.kind not in "fiu" or not values.size:
        raise BodysenseError(f"{path}: {name!r} is {values.shape} of {values.dtype}; it must be numbers, a row a frame")
    values = values.astype(np.float64)
    if not sound(values).all():
        row = int(np.argwhere(~sound(values))[0][0]) if values.ndim else 0
        raise BodysenseError(f"{path}: {name!r} is not finite in frame {row}; cut or mend that frame")
    return values


def _path(
    path: Path,
    place: tuple[str, np.ndarray],
    arrays: Mapping[str, np.ndarray],
    frames: int,
    rate: float,
    options: ReadingOptions,
    remarks: list[str],
) -> tuple[np.ndarray, list[str]]:
    """Return the places (T, 3) m of the root, and warnings: in the unit of the options, scaled, or in centimetres."""
    name, values = place
    values = _numbers(path, name, values)
    if values.size != frames * 3:
        raise BodysenseError(f"{path}: {name!r} has shape {values.shape}; {frames} frames need ({frames}, 3)")
    metres = values.reshape(frames, 3)
    if SCALING in arrays and options.unit is None:
        scale = arrays[SCALING]
        if scale.size != 1 or not float(scale.reshape(-1)[0]) > 0:
            raise BodysenseError(f"{path}: {SCALING!r} is {str(scale)[:40]}; it must be one positive number")
        remarks.append(f"{place[0]!r} is divided by {SCALING!r}, {float(scale.reshape(-1)[0]):g}")
        return metres / float(scale.reshape(-1)[0]), []
    return path_in_metres(metres, rate, options.metres, place[0])


def _up(pose: Pose, has_path: bool, rate: float, told: UpAxis | None) -> tuple[UpAxis, list[str]]:
    """Return the upward axis of a file, and warnings. +Y is usual; a camera's is -Y."""
    first, later, moment = moments(len(pose.root_position), rate)
    skeleton = pose.skeleton
    names = [*BODY_JOINTS, "left_toe", "right_toe"]
    at = skeleton.indices(names)
    one, other = (np.asarray(forward_kinematics(pose[frames])[0])[:, at] for frames in (first, later))
    ankles, shoulders = (
        one[:, [names.index(f"{side}_{part}") for side in ("left", "right")]].mean(axis=1)
        for part in ("ankle", "shoulder")
    )
    if not has_path:  # the pelvis stays where it is, so that feet slide
        one, other = one * np.nan, other * np.nan
    words: dict[UpAxis, float] = {"y": USUAL}
    body, clearance = shoulders - ankles, clearance_of(names)
    if told is not None:
        return told, told_warning(told, judged_up(one, other, moment, body, clearance=clearance))
    found = judged_up(one, other, moment, body, clearance=clearance, words=words)
    return found.axis, doubts(found, "SMPL") if found.axis == "y" or found.is_unsure else []


def _lift_to_floor(pose: Pose, has_translation: bool, remarks: list[str]) -> np.ndarray:
    """Return (3,) or (T, 3) m by which a body must move so that its feet stand on y = 0."""
    skeleton = pose.skeleton
    feet = skeleton.indices([f"{side}_{name}" for side in ("left", "right") for name in ("ankle", "foot", "toe")])
    usual = (skeleton.path @ skeleton.rest_offset)[feet, 1] + skeleton.rest_offset[0, 1]
    lowest = (np.asarray(forward_kinematics(pose)[0])[:, feet, 1] - usual).min(axis=1)
    if not has_translation:
        remarks.append("no translation in it: the body stays at its place, its lower foot on the floor")
        return np.stack([0 * lowest, -lowest, 0 * lowest], axis=-1)
    floor = float(np.percentile(lowest, 5))
    if abs(floor) <= _FLOOR:
        return np.zeros(3)
    remarks.append(f"the feet stand at y = {floor:.2f} m: moved to 0")
    return np.array([0.0, -floor, 0.0])


def _rate(path: Path, arrays: Mapping[str, np.ndarray], given_rate: float | None, remarks: list[str]) -> float:
    if given_rate is not None:
        return given_rate
    given = _first(arrays, RATE)
    if given is None:
        remarks.append(f"no frame rate in it: {USUAL_RATE:g} Hz is taken (--rate)")
        return USUAL_RATE
    name, value = given
    if value.size != 1 or value.dtype.kind not in "fiu" or not 0 < float(value.item()) < 1e5:
        raise BodysenseError(f"{path}: {name!r} is {str(value)[:40]}; it must be a positive number of Hz: give --rate")
    return float(value.item())
