"""Rendered takes: motions of a character in front of a camera. A rendered set is a folder of NAME.mp4 and NAME.npz.

The .npz has the truth of the video. Scripted gestures that are hard to track: arms out to the sides, up, toward the
camera, punches, waving next to the face, waving in front of the face at a webcam, and gestures with a moving camera.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from fractions import Fraction
from pathlib import Path

import numpy as np

from bodysense.body.keypoints import ArmKeypoints, Camera
from bodysense.body.pose import Pose, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError, how_to_install
from bodysense.files import written_beside
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_exp, quaternion_rotate, shortest_arc, slerp
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense_lab.papers.pahmt.camera_view import VIEW_POINTS, CameraRange, view, view_points
from bodysense_lab.rendering.character import FIGURES, load_figure
from bodysense_lab.rendering.renderer import open_renderer
from bodysense_lab.rendering.scene import (
    ROOM,
    WEBCAM,
    WEBCAM_RISE,
    WHOLE,
    Scene,
    move_camera,
    sample_camera,
    sample_scene,
)
from bodysense_lab.synthesis.paths import minimum_jerk

_ARM = tuple[tuple[float, float, float], tuple[float, float, float]]
# Directions of upper arm and forearm of the left arm, for a chest that faces +z; those of the right arm are mirrored.
_HANG: _ARM = ((0.15, -1.0, 0.0), (0.1, -1.0, 0.15))
_OUT: _ARM = ((1.0, 0.0, 0.0), (1.0, 0.0, 0.0))
_UP: _ARM = ((0.3, 1.0, 0.0), (0.15, 1.0, 0.0))
_AHEAD: _ARM = ((0.0, 0.0, 1.0), (0.0, 0.0, 1.0))
_GUARD: _ARM = ((0.2, -0.85, 0.4), (-0.35, 0.75, 0.6))
_BLOW: _ARM = ((-0.1, 0.0, 1.0), (-0.15, 0.05, 1.0))
_HOOK: _ARM = ((0.75, 0.0, 0.65), (-0.75, 0.0, 0.65))
_UPPERCUT: _ARM = ((0.1, -0.3, 0.95), (-0.1, 0.9, 0.4))
_CHIN: _ARM = ((0.35, -0.55, 0.75), (-0.6, 0.75, 0.2))
_BESIDE: _ARM = ((0.35, -0.55, 0.75), (0.05, 0.97, 0.2))
_REST: _ARM = ((0.25, -0.95, 0.2), (-0.35, -0.1, 0.95))  # on a desk
_FACE: _ARM = ((0.5, 0.4, 0.75), (-0.9, 0.35, 0.2))  # wrist and hand are in front of the face
_NEXT: _ARM = ((0.55, 0.1, 0.8), (-0.45, 0.88, 0.1))  # the hand is next to it
# Each key: time in s, left arm, right arm, rotation of the chest to the left in degrees.
_Key = tuple[float, _ARM, _ARM, float]
GESTURES: dict[str, tuple[_Key, ...]] = {
    "t_pose": ((0.0, _HANG, _HANG, 0), (0.7, _HANG, _HANG, 0), (1.4, _OUT, _OUT, 0), (3.0, _OUT, _OUT, 0),
               (3.8, _HANG, _HANG, 0), (4.5, _HANG, _HANG, 0)),
    "arms_up": ((0.0, _HANG, _HANG, 0), (0.6, _HANG, _HANG, 0), (1.5, _UP, _UP, 0), (2.6, _UP, _UP, 0),
                (3.3, _OUT, _OUT, 0), (4.0, _HANG, _HANG, 0), (4.5, _HANG, _HANG, 0)),
    "arms_ahead": ((0.0, _HANG, _HANG, 0), (0.6, _HANG, _HANG, 0), (1.4, _AHEAD, _AHEAD, 0), (2.6, _AHEAD, _AHEAD, 0),
                   (3.4, _OUT, _OUT, 0), (4.5, _HANG, _HANG, 0)),
    "punches": ((0.0, _GUARD, _GUARD, 0), (0.6, _GUARD, _GUARD, 0), (0.8, _BLOW, _GUARD, -20), (1.1, _GUARD, _GUARD, 0),
                (1.3, _GUARD, _BLOW, 20), (1.6, _GUARD, _GUARD, 0), (1.85, _HOOK, _GUARD, -30),
                (2.2, _GUARD, _GUARD, 0), (2.45, _GUARD, _HOOK, 30), (2.8, _GUARD, _GUARD, 0),
                (3.0, _UPPERCUT, _GUARD, -15), (3.3, _GUARD, _GUARD, 0), (3.5, _GUARD, _UPPERCUT, 15),
                (3.8, _GUARD, _GUARD, 0), (4.1, _GUARD, _OUT, 0), (4.5, _GUARD, _GUARD, 0)),
    "waves": ((0.0, _HANG, _HANG, 0), (0.5, _HANG, _HANG, 0), (1.2, _CHIN, _HANG, 0), (1.5, _BESIDE, _HANG, 0),
              (1.8, _CHIN, _HANG, 0), (2.1, _BESIDE, _HANG, 0), (2.4, _CHIN, _HANG, 0), (2.7, _BESIDE, _HANG, 0),
              (3.0, _CHIN, _HANG, 0), (3.8, _HANG, _HANG, 0), (4.5, _HANG, _HANG, 0)),
    "waves_at_desk": ((0.0, _REST, _REST, 0), (0.3, _REST, _REST, 0), (0.9, _FACE, _REST, 0), (1.2, _NEXT, _REST, 0),
                      (1.5, _FACE, _REST, 0), (1.8, _NEXT, _REST, 0), (2.1, _FACE, _REST, 0), (2.6, _REST, _REST, 0),
                      (3.1, _REST, _FACE, 0), (3.4, _REST, _NEXT, 0), (3.7, _REST, _FACE, 0), (4.0, _REST, _NEXT, 0),
                      (4.5, _REST, _FACE, 0)),
    "moving_camera": ((0.0, _GUARD, _OUT, 0), (0.5, _OUT, _UP, 0), (1.0, _CHIN, _OUT, 0), (1.4, _BESIDE, _HANG, 0),
                      (1.8, _CHIN, _AHEAD, 0), (2.4, _HANG, _OUT, 0), (3.0, _OUT, _HANG, 0), (3.6, _UP, _CHIN, 0),
                      (4.0, _OUT, _BESIDE, 0), (4.5, _HANG, _HANG, 0)),
}  # fmt: skip
_SPINE = ("spine1", "spine2", "spine3")


def gesture(name: str) -> Clip:
    """Return the motion of one of `GESTURES` on the default body, with fingers; its category is its name."""
    keys, skeleton = GESTURES[name], default_skeleton()
    times = np.array([key[0] for key in keys])
    time = np.arange(round(times[-1] * RATE) + 1) / RATE
    after = np.clip(np.searchsorted(times, time, side="right"), 1, len(keys) - 1)
    share = minimum_jerk((time - times[after - 1]) / (times[after] - times[after - 1]))
    pose = standing_pose(skeleton)
    rotation = np.tile(pose.rotation, (len(time), 1, 1))
    if name == "punches":
        for joint, place in ((joint, skeleton.index(joint)) for joint in skeleton.joints if joint[-1] in "123"):
            if skeleton.wrist_of[place] >= 0 and "thumb" not in joint:
                rotation[:, place] = quaternion_exp(np.array([0.0, 0.0, -1.4 if joint.startswith("left") else 1.4]))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        turned = np.array([_arm(left if side == "left" else right, sign) for _, left, right, _ in keys])
        for joint, direction in zip(("shoulder", "elbow"), np.moveaxis(turned, 1, 0), strict=True):
            rotation[:, skeleton.index(f"{side}_{joint}")] = slerp(direction[after - 1], direction[after], share)
    turn = np.radians([key[3] for key in keys])
    turn = turn[after - 1] + share * (turn[after] - turn[after - 1])
    for joint in _SPINE:
        rotation[:, skeleton.index(joint)] = quaternion_exp(turn[:, None] / len(_SPINE) * [0.0, 1.0, 0.0])
    root = np.tile(pose.root_position, (len(time), 1))
    return Clip(name, Pose(skeleton, root, rotation), RATE, has_fingers=True, category=name)


def _arm(directions: _ARM, sign: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the local rotations (4,) of a shoulder and an elbow."""
    bone, mirror = np.array([sign, 0.0, 0.0]), np.array([sign, 1.0, 1.0])
    upper, fore = (np.array(direction) * mirror for direction in directions)
    shoulder = shortest_arc(bone, upper)
    elbow = shortest_arc(bone, np.asarray(quaternion_rotate(quaternion_conjugate(shoulder), fore)))
    return np.asarray(shoulder), np.asarray(elbow)


FORMAT = "bodysense take 1"
RATE = 30.0  # Hz
_TRIES = 30  # maximum number of cameras that are drawn for a take
_PATH_ENDS = 8  # cameras that are drawn for the end of a camera's path; the farthest one is used
_MIN_VISIBLE = 0.9  # share of frames in which each arm must be in the picture
_MIN_SPEED = 0.05  # m/s; takes with a lower mean speed of the wrists are omitted


@dataclass(frozen=True, eq=False)
class RenderedTake:
    """Truth of a rendered video."""

    name: str
    figure: str
    pose: Pose = field(repr=False)  # (T, …) on the figure's skeleton, world
    time: np.ndarray = field(repr=False)  # (T,) s
    camera: Camera = field(repr=False)  # if it moves, its position and axes have an axis of time, (T, …)
    category: str = ""  # of the motion; empty if unknown

    @property
    def moves(self) -> bool:
        """Whether the camera moves."""
        return self.camera.position.ndim > 1

    def camera_at(self, frame: int) -> Camera:
        """Return the camera of one picture."""
        if not self.moves:
            return self.camera
        return replace(self.camera, position=self.camera.position[frame], axes=self.camera.axes[frame])

    def keypoints(self) -> ArmKeypoints:
        """Return the true key-points of the pictures."""
        points = view_points(self.pose)
        if not self.moves:
            return view(points, self.time, self.camera)
        seen = view(points[:, None], np.zeros(1), self.camera)  # a window of one picture for each camera
        found = {one.name: getattr(seen, one.name)[:, 0] for one in fields(seen) if one.name != "time"}
        return ArmKeypoints(time=self.time, **found)


def plan_takes(
    clip: Clip,
    count: int,
    seconds: float,
    rng: np.random.Generator,
    first: int = 0,
    where: CameraRange = ROOM,
    rise: float = 0.0,
) -> list[tuple[RenderedTake, Scene]]:
    """Return up to `count` takes of a clip and their scenes: pieces of `seconds`, or the whole clip if it is shorter.

    Pieces do not overlap. Hands move in them, and both arms are nearly always in the picture. Characters alternate,
    starting at index `first`. Cameras are drawn from the range `where`, and point `rise` m above the middle of the
    trunk. Raises BodysenseError for a clip without fingers.
    """
    if not clip.has_fingers:
        raise BodysenseError(f"{clip.name}: it has no finger motion; a rendered set needs it")
    clip = resample(clip, RATE)
    length = min(len(clip), round(seconds * RATE))
    starts = rng.permutation(np.arange(0, len(clip) - length + 1, length))
    taken: list[tuple[RenderedTake, Scene]] = []
    for start in starts:
        if len(taken) == count:
            break
        piece = clip.pose[start : start + length]
        if _speed(piece) < _MIN_SPEED:
            continue
        scene = sample_scene(rng, FIGURES[(first + len(taken)) % len(FIGURES)])
        pose = load_figure(scene.figure).retarget(piece)
        camera = _camera(pose, rng, where, rise)
        if camera is not None:
            name = f"{clip.name}_{start}_{scene.figure}"
            taken.append(
                (RenderedTake(name, scene.figure, pose, np.arange(length) / RATE, camera, clip.category), scene)
            )
    return taken


def plan_gestures(rng: np.random.Generator) -> list[tuple[RenderedTake, Scene]]:
    """Return takes of all `GESTURES` by all characters, and their scenes, with the whole body except at a desk."""
    planned: list[tuple[RenderedTake, Scene]] = []
    for clip in map(gesture, GESTURES):
        where, rise = (WEBCAM, WEBCAM_RISE) if clip.name == "waves_at_desk" else (WHOLE, 0.0)
        for number in range(len(FIGURES)):
            taken = plan_takes(clip, 1, np.ceil(clip.seconds), rng, number, where, rise)
            if clip.name == "moving_camera":
                taken = [(_with_moving_camera(take, rng), scene) for take, scene in taken]
            planned += taken
    return planned


def _with_moving_camera(take: RenderedTake, rng: np.random.Generator) -> RenderedTake:
    """Return a take with a camera that moves and turns to another place from the first picture to the last."""
    drawn = [camera for camera in (_camera(take.pose, rng, WHOLE) for _ in range(_PATH_ENDS)) if camera is not None]
    farthest = max(drawn, key=lambda camera: float(np.linalg.norm(camera.position - take.camera.position)))
    return replace(take, camera=move_camera(take.camera, farthest, len(take.time)))


def render_take(
    take: RenderedTake, scene: Scene, folder: Path, height: int = 480, advance: Callable[[], object] = lambda: None
) -> Path:
    """Draw a take into NAME.mp4 (H.264) in a folder and its truth into NAME.npz; returns the video's path.

    `advance` is called after every picture. Raises BodysenseError if a package or OpenGL is missing.
    """
    try:
        import av
    except ImportError:
        raise BodysenseError(f"writing videos needs PyAV; {how_to_install('packages/lab[render]')}") from None
    path, around = folder / f"{take.name}.mp4", np.median(take.pose.root_position, axis=0)
    with written_beside(path) as beside, open_renderer(scene, take.camera_at(0), height, around) as renderer:
        with av.open(str(beside), "w") as container:
            stream = container.add_stream("h264", rate=Fraction(RATE))
            stream.width, stream.height, stream.pix_fmt = *renderer.size, "yuv420p"
            stream.options = {"crf": "20", "preset": "veryfast"}
            stream.thread_count = 1
            for k in range(len(take.time)):
                if take.moves:
                    renderer.point(take.camera_at(k))
                picture = av.VideoFrame.from_ndarray(renderer.draw(take.pose[k]), format="rgb24")
                container.mux(stream.encode(picture))
                advance()
            container.mux(stream.encode(None))
        write_take(path.with_suffix(".npz"), take)
    return path


def write_take(path: Path, take: RenderedTake) -> None:
    """Write the truth of a video as .npz."""
    with written_beside(path) as beside:
        np.savez_compressed(
            beside,
            format=FORMAT,
            name=take.name,
            figure=take.figure,
            category=take.category,
            rest_offset=take.pose.skeleton.rest_offset,
            root_position=take.pose.root_position.astype(np.float32),
            rotation=take.pose.rotation.astype(np.float32),
            time=take.time,
            camera_position=take.camera.position,
            camera_axes=take.camera.axes,
            camera_focal=take.camera.focal,
            camera_aspect=take.camera.aspect,
        )


def read_take(path: Path) -> RenderedTake:
    """Read the truth of a video from its .npz. Raises BodysenseError for other files."""
    try:
        with np.load(path) as data:
            if str(data["format"]) != FORMAT:
                raise BodysenseError(f"{path}: its format is {data['format']!s}, not {FORMAT!r}; render the set again")
            skeleton = default_skeleton().with_offsets(data["rest_offset"])
            pose = Pose(skeleton, data["root_position"].astype(float), data["rotation"].astype(float))
            camera = Camera(*(data[f"camera_{name}"] for name in ("position", "axes", "focal", "aspect")))
            return RenderedTake(
                str(data["name"]), str(data["figure"]), pose, data["time"], camera, str(data["category"])
            )
    except (OSError, ValueError, KeyError) as error:
        raise BodysenseError(f"{path}: not the truth of a rendered video ({error}); render the set again") from None


def list_takes(folder: Path) -> list[Path]:
    """Return the truths (.npz) of the videos of a rendered set. Raises BodysenseError if there are no videos."""
    found = sorted(path for path in folder.glob("*.npz") if path.with_suffix(".mp4").is_file())
    if not found:
        raise BodysenseError(f"{folder}: no rendered videos in it; make some with `bodysense data render`")
    return found


def _camera(pose: Pose, rng: np.random.Generator, where: CameraRange, rise: float = 0.0) -> Camera | None:
    """Draw a camera with both arms nearly always in its picture; None if many draws fail."""
    points = view_points(pose)
    for _ in range(_TRIES):
        camera = sample_camera(pose, rng, where, rise)
        seen = view(points, np.arange(len(points)) / RATE, camera)
        if seen.has_arm.mean(axis=0).min() >= _MIN_VISIBLE:
            return camera
    return None


def _speed(pose: Pose) -> float:
    """Return the mean speed of the wrists relative to the shoulders, m/s."""
    points = view_points(pose)
    shoulders = points[:, :, VIEW_POINTS.index("shoulder")].mean(axis=1)
    wrist = points[:, :, VIEW_POINTS.index("wrist")] - shoulders[:, None]
    return float(np.linalg.norm(np.diff(wrist, axis=0), axis=-1).mean() * RATE)
