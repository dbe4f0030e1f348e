"""Files of random conventions: one made-up person in any axes, unit, order of rotations, rest pose, names and format.

A file is right if its joints are at the known places, up to the heading, where the person stands and the floor's
height. Else it must be refused or read with a warning; a wrong body without a word is the one thing that must not be.
`pytest -s -m slow tests/io/test_random_conventions.py` prints the counts.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from further_layouts import FURTHER
from made_fbx import made_body
from more_layouts import MORE
from rig_files import held_still, motion, of_other_size
from rig_files import write as bvh
from rig_layouts import LAYOUTS
from scipy.spatial.transform import Rotation
from virtual_markers import LABORATORIES, SETS, raw_of

import bodysense
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.markers.formats.c3d import write_c3d
from bodysense.io.markers.raw_markers import points_alone
from bodysense.sources.open import MarkerSource, MotionSource, open_source

DRAWS = 200
NEAR = 0.03  # m, mean distance of the joints; those of markers on the skin are 1 to 2 cm off
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
RIGS = [layout for layout in (LAYOUTS | MORE | FURTHER).values() if layout.has_known_unit]
UP = {"y": Rotation.identity(), "z": Rotation.from_euler("X", 90, degrees=True)}  # of the file's world ← ours
Draw = Callable[[np.random.Generator, Clip, Path], tuple[Path, Clip]]


def drawn_bvh(rng: np.random.Generator, clip: Clip, folder: Path) -> tuple[Path, Clip]:
    layout = RIGS[rng.integers(len(RIGS))]
    prefix = str(rng.choice(["", "mixamorig7:", "Armature|", "Hero_"]))
    bones = [
        tuple(name if name in ("-", "End Site") else prefix + name for name in bone[:2]) + bone[2:]
        for bone in layout.bones
    ]
    drawn = replace(
        layout,
        bones=bones,
        unit=float(rng.choice(list(UNITS.values()))),
        up=str(rng.choice(["y", "z", "-y"])),
        orders=(str(rng.choice(["ZXY", "XYZ", "ZYX", "YXZ", "YZX", "XZY"])),),
        rest=layout.rest if layout.has_positions else str(rng.choice(["T", "A", "hanging", layout.rest])),
    )
    held = held_still(clip, drawn)
    path = folder / "take.bvh"
    path.write_text(bvh(drawn, held))
    return path, held


def drawn_fbx(rng: np.random.Generator, clip: Clip, folder: Path) -> tuple[Path, Clip]:
    up, front = [("y", "z"), ("z", "-y"), ("z", "y"), ("z", "x")][rng.integers(4)]
    unit, seed = float(rng.choice(list(UNITS.values()))), int(rng.integers(1000))
    path = folder / "take.fbx"
    path.write_bytes(made_body(clip, up=up, front=front, unit=unit, seed=seed, prefix=str(rng.choice(["", "Hero:"]))))
    return path, clip


def drawn_glb(rng: np.random.Generator, clip: Clip, folder: Path) -> tuple[Path, Clip]:
    bodysense.write(folder / "take.glb", clip)
    return folder / "take.glb", clip


def drawn_trc(rng: np.random.Generator, clip: Clip, folder: Path) -> tuple[Path, Clip]:
    labels = list((SETS | LABORATORIES).values())[rng.integers(len(SETS | LABORATORIES))]
    unit, up = str(rng.choice(["m", "cm", "mm"])), str(rng.choice(list(UP)))
    raw = raw_of(clip, labels)
    position = UP[up].apply(raw.position.reshape(-1, 3)).reshape(len(raw.time), -1) / UNITS[unit]
    count = len(raw.names)
    rows = [
        "PathFileType\t4\t(X/Y/Z)\ttake.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{clip.frame_rate}\t{clip.frame_rate}\t{len(position)}\t{count}\t{unit}\t{clip.frame_rate}\t1\t{len(position)}",
        "Frame#\tTime\t" + "\t\t\t".join(raw.names),
        "\t\t" + "\t".join(f"X{k}\tY{k}\tZ{k}" for k in range(1, count + 1)),
        "",
    ]
    rows += [
        f"{k + 1}\t{at:.6f}\t" + "\t".join(f"{x:.7f}" for x in row)
        for k, (at, row) in enumerate(zip(raw.time, position, strict=True))
    ]
    (folder / "take.trc").write_text("\n".join(rows) + "\n")
    return folder / "take.trc", clip


def drawn_c3d(rng: np.random.Generator, clip: Clip, folder: Path) -> tuple[Path, Clip]:
    labels = list((SETS | LABORATORIES).values())[rng.integers(len(SETS | LABORATORIES))]
    raw = raw_of(clip, labels)
    write_c3d(folder / "take.c3d", points_alone(raw.names, raw.position, raw.time), clip.frame_rate)
    return folder / "take.c3d", clip


def drawn_arrays(rng: np.random.Generator, clip: Clip, folder: Path) -> tuple[Path, Clip]:
    """Joint places, or rotation vectors with a path, both in SMPL's order; the latter do not tell the body's size."""
    turn, name = UP[str(rng.choice(list(UP)))], folder / str(rng.choice(["take.npy", "take.npz"]))
    if name.suffix == ".npz":
        clip = of_other_size(clip, default_skeleton().height / clip.pose.skeleton.height)
    place, rotation = np.asarray(forward_kinematics(clip.pose)[0])[:, :22], np.asarray(clip.pose.rotation)[:, :22]
    if name.suffix == ".npy":
        array = turn.apply(place.reshape(-1, 3)).reshape(place.shape) / UNITS[str(rng.choice(["m", "cm", "mm"]))]
        array = [array, array[None], np.moveaxis(array, 0, 2), array.reshape(len(array), -1)][rng.integers(4)]
        np.save(name, array)
        return name, clip
    turns = Rotation.from_quat(rotation.reshape(-1, 4), scalar_first=True)
    poses = turns.as_rotvec().reshape(len(rotation), 22, 3)
    poses[:, 0] = (turn * Rotation.from_quat(rotation[:, 0], scalar_first=True)).as_rotvec()
    np.savez(name, poses=poses.reshape(len(poses), -1), trans=turn.apply(place[:, 0]), fps=clip.frame_rate)
    return name, clip


FORMATS: dict[str, tuple[Draw, float]] = {  # with the share of the draws
    "BVH": (drawn_bvh, 0.4),
    "FBX": (drawn_fbx, 0.15),
    "glTF": (drawn_glb, 0.05),
    "TRC": (drawn_trc, 0.15),
    "C3D": (drawn_c3d, 0.05),
    "arrays": (drawn_arrays, 0.2),
}


def person(rng: np.random.Generator) -> Clip:
    """Return a motion of a person of random size who starts anywhere and faces anywhere."""
    clip = of_other_size(motion(24, 20, int(rng.integers(0, 200))), float(rng.uniform(0.85, 1.12)))
    turn = Rotation.from_euler("Y", rng.uniform(0, 360), degrees=True)
    rotation = np.array(clip.pose.rotation)
    rotation[:, 0] = (turn * Rotation.from_quat(rotation[:, 0], scalar_first=True)).as_quat(scalar_first=True)
    root = turn.apply(clip.pose.root_position) + rng.uniform(-2, 2, 3) * [1.0, 0.0, 1.0]
    return replace(clip, pose=replace(clip.pose, root_position=root, rotation=rotation))


def read_places(path: Path) -> tuple[dict[str, np.ndarray], bool]:
    """Return joint places of a file, and whether it gives a warning."""
    opened = open_source(path)
    if isinstance(opened, MotionSource):
        clip = opened.clip
        place, points = np.asarray(forward_kinematics(clip.pose)[0]), clip.pose.skeleton.points
        return {name: place[:, points.index(name)] for name in BODY}, bool(clip.warnings or opened.warnings)
    assert isinstance(opened, MarkerSource)
    seen = opened.recording.observation
    whole = {name: seen.position[:, k] for k, name in enumerate(seen.points) if seen.has_position[:, k].all()}
    return whole, bool(opened.warnings)


LIMBS = [
    f"{side}_{part}" for side in ("left", "right") for part in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
]


def distance(found: dict[str, np.ndarray], truth: Clip) -> float:
    """Return the mean distance of the limbs' joints from the truth, m, after the best heading and translation."""
    names = [name for name in LIMBS if name in found]
    true = np.asarray(forward_kinematics(truth.pose)[0])[:, truth.pose.skeleton.indices(names)]
    ours = np.stack([found[name] for name in names], axis=1)
    if len(ours) != len(true) or len(names) < 8:
        return float("inf")
    ours, true = (place.reshape(-1, 3) - place.reshape(-1, 3).mean(axis=0) for place in (ours, true))
    level = [ours[:, 0] + 1j * ours[:, 2], true[:, 0] + 1j * true[:, 2]]
    turn = (np.conj(level[0]) * level[1]).sum()
    level[0] = level[0] * turn / abs(turn)
    off = np.stack([(level[0] - level[1]).real, ours[:, 1] - true[:, 1], (level[0] - level[1]).imag])
    return float(np.linalg.norm(off, axis=0).mean())


def outcome(seed: int, folder: Path) -> tuple[str, str, str]:
    """Return the format of a draw, what happens ('right', 'refused', 'warned' or 'silent'), and how."""
    rng = np.random.default_rng(seed)
    shares = np.array([share for _, share in FORMATS.values()])
    kind = list(FORMATS)[rng.choice(len(FORMATS), p=shares / shares.sum())]
    path, truth = FORMATS[kind][0](rng, person(rng), folder)
    try:
        found, is_warned = read_places(path)
    except BodysenseError as error:
        return kind, "refused", str(error)
    off = distance(found, truth)
    if off < NEAR:
        return kind, "right", ""
    return kind, "warned" if is_warned else "silent", f"{100 * off:.0f} cm off"


@pytest.mark.slow
def test_files_of_random_conventions(tmp_path: Path) -> None:
    counts: Counter[tuple[str, str]] = Counter()
    others = []
    for seed in range(DRAWS):
        folder = tmp_path / str(seed)
        folder.mkdir()
        kind, what, how = outcome(seed, folder)
        counts[kind, what] += 1
        if what != "right":
            others.append(f"{seed} {kind}: {what}, {how}")
    print("", *(f"{kind:7} {what:8} {count}" for (kind, what), count in sorted(counts.items())), *others, sep="\n")
    totals = Counter({what: 0 for _, what in counts})
    for (_, what), count in counts.items():
        totals[what] += count
    assert not totals["silent"], others
    assert totals["right"] >= 0.99 * DRAWS, others


def test_the_measure_sees_other_bodies() -> None:
    """A mirrored, a lying and a larger body are far; a turned, moved one is the same."""
    clip = person(np.random.default_rng(0))
    place = np.asarray(forward_kinematics(clip.pose)[0])
    turn = Rotation.from_euler("Y", 40, degrees=True)

    def off(change: Callable[[np.ndarray], np.ndarray]) -> float:
        skeleton = clip.pose.skeleton
        return distance({name: change(place[:, skeleton.index(name)]) for name in BODY}, clip)

    assert off(lambda one: turn.apply(one) + np.array([1.0, 0.5, 0.0])) < 1e-6
    assert min(off(lambda one: one * [-1, 1, 1]), off(lambda one: one[:, [0, 2, 1]] * [1, 1, -1])) > NEAR
    assert off(lambda one: 1.2 * one) > NEAR
