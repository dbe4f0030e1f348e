"""Make the moving pictures of docs/gallery.md from the packaged performance.

    python scripts/make_gallery.py [NAME …]

`video` needs `'.[video]'`, `packages/lab[render]` and MediaPipe's models (scripts/build_landmarkers.py).
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

import bodysense as bs
from bodysense.body.skeleton import Skeleton
from bodysense.cli import main as bodysense
from bodysense.demo import packaged_performance, performance_of_unseen_body
from bodysense.files import written_beside
from bodysense.io.resample import resample
from bodysense.observing.observation import Observation
from bodysense.pictures.camera import Lens
from bodysense.pictures.comparison import View, draw_views

FIGURES = Path(__file__).resolve().parents[1] / "docs" / "figures"
RATE = 30.0  # Hz, of the motion
STEP = 3  # frames of the motion for one picture
LENS = Lens(width=170, height=230, aim=0.86, view_height=2.25)
QUALITY = 40  # of WebP
LARGEST = 350_000  # bytes of a picture
WALK, REACH, FILM = (2.0, 7.0), (5.5, 10.0), (6.0, 11.5)  # s of the performance
FILM_WIDTH = 560  # pixels of a picture of the film and the body next to it
FROM, TURNED = 2.7, np.radians(125)  # m from the figure to the camera, and the camera's turn about +Y


def part(seconds: tuple[float, float]) -> bs.Clip:
    """Return a part of the performance, on a body that no network was trained on."""
    clip = resample(performance_of_unseen_body(), RATE)
    first, last = (round(RATE * second) for second in seconds)
    return replace(clip, pose=clip.pose[first:last])


def tracked(seen: Observation, skeleton: Skeleton) -> np.ndarray:
    """Return whether each point of a skeleton was tracked, (T, P) bool."""
    found = np.zeros((len(seen.time), len(skeleton.points)), dtype=bool)
    for column, name in enumerate(seen.points):
        if name in skeleton.points:
            found[:, skeleton.points.index(name)] = seen.has_position[:, column]
    return found


def sensors() -> Iterable[np.ndarray]:
    """Draw the wearer, and the body from the head, from head and hands, and from six trackers."""
    clip = part(WALK)
    views = [View("the wearer", clip.pose)]
    for device, title in (("head", "head"), ("three_point", "head and hands"), ("six_point", "six trackers")):
        seen = bs.simulate(clip, device)
        take = bs.track(seen, person=bs.Person(clip.pose.skeleton))
        views.append(View(title, take.clip.pose, tracked(seen, clip.pose.skeleton)))
    return draw_views(views, RATE, range(0, len(clip), STEP), LENS)


def hole() -> Iterable[np.ndarray]:
    """Draw a motion whose left arm is missing for two seconds, and the filled one."""
    clip = part(REACH)
    arm = [clip.pose.skeleton.points.index(name) for name in ("left_shoulder", "left_elbow", "left_wrist")]
    there = np.ones((len(clip), len(clip.pose.skeleton.points)), dtype=bool)
    with tempfile.TemporaryDirectory() as folder:
        whole, filled = Path(folder) / "take.bvh", Path(folder) / "filled.bvh"
        bs.write(whole, clip)
        joints, hidden = "left_shoulder,left_elbow,left_wrist", (round(RATE), round(3 * RATE))
        there[hidden[0] : hidden[1] + 1, arm] = False
        bodysense(["track", str(whole), "--missing", f"{joints}:{hidden[0]}-{hidden[1]}", "-o", str(filled), "--quiet"])
        read = bs.read(filled)
        assert isinstance(read, bs.Clip)
        pose = read.pose
    views = [View("the motion", clip.pose), View("red: missing, filled", pose, there)]
    return draw_views(views, RATE, range(0, len(clip), STEP), LENS)


def video() -> Iterable[np.ndarray]:
    """Draw a film of a rendered character, with the tracked body over it and next to it."""
    import av

    with tempfile.TemporaryDirectory() as folder:
        film, seen = Path(folder) / "film.mp4", Path(folder) / "seen.mp4"
        write_film(film)
        bodysense(["track", str(film), "-o", str(Path(folder) / "take.bvh"), "--overlay", str(seen), "--quiet"])
        with av.open(str(seen)) as container:
            pictures = [frame.to_image() for frame in container.decode(video=0)]
    return [np.asarray(one.resize((FILM_WIDTH, FILM_WIDTH * one.height // one.width))) for one in pictures]


def write_film(path: Path) -> None:
    """Write a film of the performance on a rendered character, seen by a camera in a room."""
    import av

    from bodysense.body.keypoints import Camera
    from bodysense_lab.rendering.character import load_figure
    from bodysense_lab.rendering.renderer import open_renderer
    from bodysense_lab.rendering.scene import sample_scene

    clip = resample(packaged_performance(), RATE / STEP)
    first, last = (round(RATE / STEP * second) for second in FILM)
    pose = load_figure("woman").retarget(clip.pose[first:last])
    middle = np.median(pose.root_position, axis=0)
    away, right = np.array([np.sin(TURNED), 0, np.cos(TURNED)]), np.array([np.cos(TURNED), 0, -np.sin(TURNED)])
    axes = np.stack([right, (0, 1, 0), away], axis=1)
    camera = Camera(middle + FROM * away, axes, np.array(1.1), np.array(4 / 3))
    scene = sample_scene(np.random.default_rng(5), "woman")
    with av.open(str(path), "w") as container, open_renderer(scene, camera, 480, middle) as stage:
        stream = container.add_stream("libx264", rate=round(RATE / STEP))
        stream.width, stream.height, stream.pix_fmt = 640, 480, "yuv420p"
        for k in range(len(pose.root_position)):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(stage.draw(pose[k]), format="rgb24")))
        container.mux(stream.encode(None))


PICTURES: dict[str, Callable[[], Iterable[np.ndarray]]] = {"sensors": sensors, "hole": hole, "video": video}


def main() -> None:
    """Draw and write the pictures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(PICTURES)}; all if omitted")
    names = parser.parse_args().names or list(PICTURES)
    unknown = [name for name in names if name not in PICTURES]
    if unknown:
        raise SystemExit(f"{unknown[0]}: give {', '.join(PICTURES)}")
    for name in names:
        first, *more = [Image.fromarray(picture) for picture in PICTURES[name]()]
        out = FIGURES / f"gallery-{name}.webp"
        with written_beside(out) as beside:
            options = {"save_all": True, "append_images": more, "loop": 0, "duration": round(1000 * STEP / RATE)}
            first.save(beside, "WEBP", quality=QUALITY, method=6, **options)
        size = out.stat().st_size
        print(f"{out}: {1 + len(more)} pictures of {first.width} × {first.height}, {size / 1e3:.0f} kB")
        if size > LARGEST:
            raise SystemExit(f"{out}: more than {LARGEST} bytes; draw fewer pictures")


if __name__ == "__main__":
    main()
