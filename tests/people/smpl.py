"""Made-up SMPL-shaped model files and AMASS files of people who walk and squat, skinned by a few lines of NumPy.

Nothing of the package computes them but the default skeleton's names and parents.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bodysense.body.pose import Pose
from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import default_skeleton

SKELETON = default_skeleton()
RATE = 120.0
PELVIS = np.array([0.002, -0.24, 0.03])  # of the model's own frame
PER_UNIT = 0.05  # share by which a unit of the first coefficient makes a body larger
FEET = ("left", "right")
CORNERS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) * 0.01


@dataclass(frozen=True)
class Model:
    """A model: four vertices around each joint, and three under each foot."""

    vertices: np.ndarray  # (V, 3) m
    bone: np.ndarray  # (V,) joint that each vertex follows
    regressor: np.ndarray  # (52, V)
    directions: np.ndarray  # (V, 3, 2): size, and longer legs
    parents: np.ndarray  # (52,)

    def shaped(self, betas: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vertices and joints at rest."""
        vertices = self.vertices + self.directions @ betas
        return vertices, self.regressor @ vertices

    def posed(self, betas: np.ndarray, poses: np.ndarray, trans: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (T, V, 3) and joints (T, 52, 3) by linear blend skinning with one bone a vertex."""
        vertices, joints = self.shaped(betas)
        local = Rotation.from_rotvec(poses.reshape(-1, 3)).as_matrix().reshape(len(poses), 52, 3, 3)
        turn, place = local.copy(), np.zeros((len(poses), 52, 3))
        place[:, 0] = joints[0]
        for joint in range(1, 52):
            parent = self.parents[joint]
            turn[:, joint] = turn[:, parent] @ local[:, joint]
            place[:, joint] = place[:, parent] + turn[:, parent] @ (joints[joint] - joints[parent])
        skin = place[:, self.bone] + np.einsum("tvij,vj->tvi", turn[:, self.bone], vertices - joints[self.bone])
        return skin + trans[:, None], place + trans[:, None]

    def save(self, path: Path, **changes: Any) -> Path:
        """Write it as model files are laid out."""
        path.parent.mkdir(parents=True, exist_ok=True)
        table = np.array([self.parents % 2**32, np.arange(len(self.parents))], dtype=np.uint32)
        arrays: dict[str, Any] = {"J_regressor": self.regressor, "v_template": self.vertices}
        arrays |= {"shapedirs": self.directions, "kintree_table": table}
        np.savez(path, **(arrays | changes))
        return path


def made_up_model(body: int = 0) -> Model:
    """A model of the proportions of one of the shape space's test bodies."""
    offset = sample_bodies("test", body + 1)[body]
    place = SKELETON.path @ offset + offset[0]
    index = SKELETON.index
    soles = [(f"{side}_{name}", f"{side}_{bone}") for side in FEET for name, bone in SOLES]
    under = [place[index(name)] * [1, 0, 1] for name, _ in soles]
    vertices = np.concatenate([(place[:52, None] + CORNERS).reshape(-1, 3), under])
    bone = np.concatenate([np.repeat(np.arange(52), 4), [index(bone) for _, bone in soles]])
    regressor = np.zeros((52, len(vertices)))
    for joint in range(52):
        regressor[joint, 4 * joint : 4 * joint + 4] = 0.25
    vertices = vertices - place[0] + PELVIS
    legs = np.clip((PELVIS[1] - vertices[:, 1]) / 0.8, 0, 1)[:, None] * [0.0, -0.02, 0.0]
    directions = np.stack([PER_UNIT * vertices, legs], axis=-1)
    return Model(vertices, bone, regressor, directions, np.array(SKELETON.parents[:52]))


SOLES = (("ankle", "ankle"), ("foot", "ankle"), ("toe", "foot"))  # a vertex under a point, and the bone it follows


def betas_of(model: Model, height: float) -> np.ndarray:
    """Coefficients of a body whose crown, 12 cm over the head's joint at 1.70 m, is `height` m over its soles."""
    vertices, joints = model.shaped(np.zeros(2))
    tall = joints[SKELETON.index("head"), 1] - vertices[:, 1].min()
    return np.array([(height / (tall * 1.70 / 1.58) - 1) / PER_UNIT, 0.0])


def walk(model: Model, betas: np.ndarray, seconds: float = 6.0) -> tuple[np.ndarray, np.ndarray]:
    """Poses (T, 156) and trans (T, 3), Z up: a walk and then a squat, one foot at a time planted on z = 0."""
    time = np.arange(round(seconds * RATE)) / RATE
    poses = np.zeros((len(time), 52, 3))
    poses[:, 0] = [np.pi / 2, 0, 0]
    moving = np.clip(4.0 - time, 0, 1)
    squat = np.sin(np.clip((time - 4.2) / 1.6, 0, 1) * np.pi)
    for side, sign in (("left", 1), ("right", -1)):
        swing = np.sin(2 * np.pi * 0.9 * time) * sign * moving
        hip = -0.40 * swing - 0.9 * squat
        knee = 0.7 * np.clip(np.cos(2 * np.pi * 0.9 * time) * sign, 0, 1) * moving + 1.6 * squat
        poses[:, SKELETON.index(f"{side}_hip"), 0] = hip
        poses[:, SKELETON.index(f"{side}_knee"), 0] = knee
        poses[:, SKELETON.index(f"{side}_ankle"), 0] = -(hip + knee)
        poses[:, SKELETON.index(f"{side}_shoulder"), 2] = -sign * 1.2
        poses[:, SKELETON.index(f"{side}_index1"), 2] = -0.3 * sign
    poses = poses.reshape(len(time), 156)
    skin, _ = model.posed(betas, poses, np.zeros((len(time), 3)))
    first = len(model.vertices) - 2 * len(SOLES)
    soles = skin[:, first:].reshape(len(time), 2, len(SOLES), 3)
    trans = np.zeros((len(time), 3))
    trans[:, 2] = -skin[..., 2].min(axis=1)
    stance = soles[..., 2].min(axis=-1).argmin(axis=-1)
    for t in range(1, len(time)):
        ball = soles[t - 1 : t + 1, stance[t], 1, :2]
        trans[t, :2] = trans[t - 1, :2] - (ball[1] - ball[0])
    return poses, trans


def save_walk(
    path: Path, poses: np.ndarray, trans: np.ndarray, betas: np.ndarray, floor: float = 0.0, gender: str = "neutral"
) -> Path:
    """Write a motion as AMASS does, with the floor at a height (m)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, poses=poses, trans=trans + np.array([0, 0, floor]), betas=betas, gender=gender, mocap_framerate=RATE)
    return path


def lowest_soles(pose: Pose) -> np.ndarray:
    """(T,) m of the lowest ankle, ball or toe over y = 0, from its height over the soles at rest."""
    skeleton = pose.skeleton
    turn = [Rotation.from_quat(pose.rotation[:, 0], scalar_first=True)]
    place = [np.array(pose.root_position)]
    for point in range(1, len(skeleton.points)):
        parent = skeleton.parents[point]
        place.append(place[parent] + turn[parent].apply(np.array(skeleton.rest_offset[point])))
        if point < len(skeleton.joints):
            turn.append(turn[parent] * Rotation.from_quat(pose.rotation[:, point], scalar_first=True))
    rest = skeleton.path @ skeleton.rest_offset + skeleton.rest_offset[0]
    points = [skeleton.index(f"{side}_{name}") for side in FEET for name, _ in SOLES]
    return np.min([place[point][:, 1] - rest[point, 1] for point in points], axis=0)
