"""PAHMT's Figures 3 and 4: pictures of rendered videos, next to arms and hands that methods found in them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bodysense.body.arms import ARM_JOINTS, with_arms
from bodysense.body.keypoints import ArmKeypoints, arms_from_torso, body_torso
from bodysense.body.pose import standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.video.arms import ArmModel
from bodysense.devices.video.landmarker_files import LandmarkerFiles
from bodysense.devices.video.person import arm_keypoints
from bodysense.devices.video.pictures import open_video
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_canonical, quaternion_conjugate, quaternion_multiply
from bodysense.pictures.animation import draw_pose
from bodysense.pictures.camera import FollowingCamera, Lens
from bodysense.pictures.comparison import caption
from bodysense_lab.papers.pahmt.camera_view import VIEW_POINTS, view_points
from bodysense_lab.papers.pahmt.errors import arm_errors
from bodysense_lab.papers.pahmt.network import ArmNetwork
from bodysense_lab.papers.pahmt.options import FINGERS
from bodysense_lab.rendering.tables import complete_by_all_methods, find_landmarks
from bodysense_lab.rendering.take import RenderedTake, list_takes, read_take

FILM = "film of a synthesised person"
ARMS_AND_HANDS, HANDS_ALONE, LANDMARKS = "arms and hands", "hands alone, IK", "landmarks, IK"
_LENS = Lens(width=220, height=240, distance=2.6, eye=1.45, aim=1.3, view_height=1.5)
_WRISTS = [ARM_JOINTS.index(f"{side}_wrist") for side in ("left", "right")]
_STRIDE = 8  # frames between windows of the network of hands


@dataclass(frozen=True, eq=False)
class FilmedTake:
    """A rendered video with its truth and the rotations (T, 38, 4), as of `arms_from_torso`, by method."""

    path: Path
    take: RenderedTake
    rotation: dict[str, np.ndarray]

    def errors(self, method: str) -> dict[str, float]:
        """Return mean errors by measure (`arm_errors`)."""
        found = arm_errors(self.rotation[method], arms_from_torso(self.take.pose), self.take.pose.skeleton)
        return {name: float(values.mean()) for name, values in found.items()}


def read_film(truth: Path, files: LandmarkerFiles, model: ArmModel, hands: ArmNetwork | None = None) -> FilmedTake:
    """Complete a rendered video, given its .npz, by the network of arms and hands and by landmarks with IK.

    With `hands`, a network of hands alone, its fingers on the arms by IK are a third method.
    """
    take = read_take(truth)
    person = find_landmarks(truth.with_suffix(".mp4"), files)
    found, _ = complete_by_all_methods(take, person, model)
    rotation = {ARMS_AND_HANDS: found["network"], LANDMARKS: found["landmarks_ik"]}
    if hands is not None:
        alone = found["landmarks_ik"].copy()
        alone[:, list(FINGERS)] = hands_alone(arm_keypoints(person), hands)
        rotation[HANDS_ALONE] = alone
    return FilmedTake(truth.with_suffix(".mp4"), take, rotation)


def read_films(
    folder: Path,
    files: LandmarkerFiles,
    model: ArmModel,
    hands: ArmNetwork | None = None,
    advance: Callable[[str], object] = lambda name: None,
) -> list[FilmedTake]:
    """Return the completed videos of a rendered set; `advance` is called with the name of each."""
    films = []
    for truth in list_takes(folder):
        films.append(read_film(truth, files, model, hands))
        advance(truth.stem)
    return films


def hands_alone(keypoints: ArmKeypoints, network: ArmNetwork) -> np.ndarray:
    """Return rotations (T, 30, 4) of fingers by a network of hands alone.

    Each frame is predicted by the window in which it is nearest the middle. Raises BodysenseError for a network that
    reads arms, and for videos shorter than its window.
    """
    import torch

    from bodysense_lab.papers.pahmt.features import window_of

    length, count = network.config.frames, len(keypoints)
    if network.config.input != "hands":
        raise BodysenseError("this network reads arms; train one with `bodysense train arms --input hands`")
    if count < length:
        raise BodysenseError(f"a video of {count} frames is shorter than the network's window of {length}")
    starts = np.unique([*range(0, count - length + 1, _STRIDE), count - length])
    frames = starts[:, None] + np.arange(length)
    windows = ArmKeypoints(**{name: np.asarray(value)[frames] for name, value in vars(keypoints).items()})
    with torch.no_grad():
        predicted = network.quaternions(network(window_of(windows))).numpy()
    away = np.abs(starts + (length - 1) / 2 - np.arange(count)[:, None])
    best = away.argmin(axis=1)
    return np.asarray(quaternion_canonical(predicted[best, np.arange(count) - starts[best]].astype(float)))


def draw_figure_3(films: Sequence[FilmedTake], moments: int) -> np.ndarray:
    """Draw Figure 3, (H, W, 3) uint8: film, arms with hands, hands alone with IK, and both with straight wrists."""
    columns = {method: (method, False) for method in (ARMS_AND_HANDS, HANDS_ALONE)}
    columns |= {"arms, straight wrists": (ARMS_AND_HANDS, True), "IK, straight wrists": (HANDS_ALONE, True)}
    return _draw(films, moments, columns)


def draw_figure_4(films: Sequence[FilmedTake], moments: int) -> np.ndarray:
    """Draw Figure 4, (H, W, 3) uint8: film, MediaPipe's landmarks with IK, the network, and the truth."""
    return _draw(films, moments, {name: (name, False) for name in (LANDMARKS, ARMS_AND_HANDS, "truth")})


def raised(take: RenderedTake, moments: int) -> list[int]:
    """Return a frame of each of `moments` equal parts of a take: the one in which a wrist is highest."""
    height = view_points(take.pose)[:, :, VIEW_POINTS.index("wrist"), 1].max(axis=1)
    parts = np.array_split(np.arange(len(height)), min(moments, len(height)))
    return [int(part[np.argmax(height[part])]) for part in parts]


def _draw(films: Sequence[FilmedTake], moments: int, columns: Mapping[str, tuple[str, bool]]) -> np.ndarray:
    """Draw a row for each moment of each film: its picture, then a body for each column (method, straight wrists)."""
    rows, width = [], round(_LENS.height * 4 / 3)
    for film in films:
        frames = raised(film.take, moments)
        pictures = pictures_at(film.path, frames, (width, _LENS.height))
        torso = film.take.keypoints().torso
        rotation = film.rotation | {"truth": arms_from_torso(film.take.pose)}
        for frame in frames:
            bodies = [_body(torso[frame], rotation[method][frame], straight) for method, straight in columns.values()]
            rows.append(np.concatenate([pictures[frame], *bodies], axis=1))
    titles = [caption([FILM], width), *(caption([title], _LENS.width) for title in columns)]
    return np.concatenate([np.concatenate(titles, axis=1), *rows])


def pictures_at(video: Path, frames: Sequence[int], size: tuple[int, int]) -> dict[int, np.ndarray]:
    """Return pictures (H, W, 3) uint8 of a video by frame, scaled to a size (W, H)."""
    from PIL import Image

    found = {}
    with open_video(str(video)) as opened:
        for number, picture in enumerate(opened.pictures):
            if number in frames:
                found[number] = np.asarray(Image.fromarray(picture.pixels).resize(size))
    return found


def _body(torso: np.ndarray, rotation: np.ndarray, straight: bool) -> np.ndarray:
    """Draw a standing body turned as the torso (4,), with arms (38, 4), from the direction of the film's camera."""
    standing = standing_pose(default_skeleton())
    if straight:
        rotation = rotation.copy()
        rotation[_WRISTS] = [1.0, 0.0, 0.0, 0.0]
    pose = with_arms(standing, rotation[None])
    pose.rotation[:, 0] = quaternion_multiply(torso, quaternion_conjugate(body_torso(standing)))
    camera = FollowingCamera(_LENS, np.zeros((1, 2)), 0.0, 0.0, pose.skeleton.height / 1.7)
    return next(draw_pose(pose, camera))
