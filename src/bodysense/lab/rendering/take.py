"""Take: a motion on a figure before a camera. A rendered set is a folder of them: NAME.mp4, and its truth, NAME.npz."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.camera_view import VIEW_POINTS, Camera, CameraRange, view, view_points
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.lab.rendering.figure import FIGURES, load_figure
from bodysense.lab.rendering.gestures import GESTURES, gesture
from bodysense.lab.rendering.scene import ROOM, WHOLE, Scene, sample_camera, sample_scene
from bodysense.lab.rendering.stage import open_stage

FORMAT = "bodysense take 1"
RATE = 30.0  # Hz
_TRIES = 30  # cameras that are drawn for a take
_SEEN = 0.9  # share of frames in which an arm should be in the picture
_LIVELY = 0.05  # m/s: wrists that move less on average are no motion to speak of


@dataclass(frozen=True, eq=False)
class RenderedTake:
    """Everything that a video shows of a person's motion."""

    name: str
    figure: str
    pose: Pose = field(repr=False)  # (T, …) on the figure's skeleton, world
    time: np.ndarray = field(repr=False)  # (T,) s
    camera: Camera = field(repr=False)  # one, which stands still
    category: str = ""  # of the motion, where its data set says


def plan_takes(
    clip: Clip, count: int, seconds: float, rng: np.random.Generator, first: int = 0, where: CameraRange = ROOM
) -> list[tuple[RenderedTake, Scene]]:
    """Up to `count` takes of a clip and the scenes for them: pieces of `seconds`, or the whole where it is shorter.

    Pieces do not overlap; hands move in them, and both arms are nearly always in the picture. Figures go by turns,
    from the `first` on; cameras stand `where` is said. Raises BodysenseError for a clip without fingers.
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
        if _speed(piece) < _LIVELY:
            continue
        scene = sample_scene(rng, FIGURES[(first + len(taken)) % len(FIGURES)])
        pose = load_figure(scene.figure).wear(piece)
        camera = _camera(pose, rng, where)
        if camera is not None:
            name = f"{clip.name}_{start}_{scene.figure}"
            taken.append(
                (RenderedTake(name, scene.figure, pose, np.arange(length) / RATE, camera, clip.category), scene)
            )
    return taken


def plan_gestures(rng: np.random.Generator) -> list[tuple[RenderedTake, Scene]]:
    """Every one of `GESTURES` by every figure, seen whole, and the scenes for them."""
    planned: list[tuple[RenderedTake, Scene]] = []
    for clip in map(gesture, GESTURES):
        for number in range(len(FIGURES)):
            planned += plan_takes(clip, 1, np.ceil(clip.seconds), rng, number, WHOLE)
    return planned


def film(
    take: RenderedTake, scene: Scene, folder: Path, height: int = 480, advance: Callable[[], object] = lambda: None
) -> Path:
    """Draw a take into NAME.mp4 (H.264) of a folder and its truth into NAME.npz; returns the video's path.

    `advance` is called after every picture. Raises BodysenseError where nothing can be drawn or written.
    """
    try:
        import av
    except ImportError:
        raise BodysenseError("writing videos needs PyAV; install bodysense[video]") from None
    path, around = folder / f"{take.name}.mp4", np.median(take.pose.root_position, axis=0)
    with written_beside(path) as beside, open_stage(scene, take.camera, height, around) as stage:
        with av.open(str(beside), "w") as container:
            stream = container.add_stream("h264", rate=Fraction(RATE))
            stream.width, stream.height, stream.pix_fmt = *stage.size, "yuv420p"
            stream.options = {"crf": "20", "preset": "veryfast"}
            stream.thread_count = 1
            for k in range(len(take.time)):
                picture = av.VideoFrame.from_ndarray(stage.draw(take.pose[k]), format="rgb24")
                container.mux(stream.encode(picture))
                advance()
            container.mux(stream.encode(None))
        write_take(path.with_suffix(".npz"), take)
    return path


def write_take(path: Path, take: RenderedTake) -> None:
    """Write the truth of a video."""
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
    """The truth of a video, from its .npz. Raises BodysenseError for another file."""
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
    """The truths (.npz) of the videos of a rendered set. Raises BodysenseError where there is none."""
    found = sorted(path for path in folder.glob("*.npz") if path.with_suffix(".mp4").is_file())
    if not found:
        raise BodysenseError(f"{folder}: no rendered videos in it; make some with `bodysense data render`")
    return found


def _camera(pose: Pose, rng: np.random.Generator, where: CameraRange) -> Camera | None:
    """A camera that nearly always has both arms in its picture; None where none of many has."""
    points = view_points(pose)
    for _ in range(_TRIES):
        camera = sample_camera(pose, rng, where)
        seen = view(points, np.arange(len(points)) / RATE, camera)
        if seen.has_arm.mean(axis=0).min() >= _SEEN:
            return camera
    return None


def _speed(pose: Pose) -> float:
    """Mean speed of the wrists from the chest, m/s."""
    points = view_points(pose)
    shoulders = points[:, :, VIEW_POINTS.index("shoulder")].mean(axis=1)
    wrist = points[:, :, VIEW_POINTS.index("wrist")] - shoulders[:, None]
    return float(np.linalg.norm(np.diff(wrist, axis=0), axis=-1).mean() * RATE)
