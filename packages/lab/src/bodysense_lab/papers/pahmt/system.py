"""PAHMT on a video: landmarks, windows of 32 frames, rotations of arms and hands on a body that stands (section 3)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bodysense.body.keypoints import ArmKeypoints
from bodysense.body.person import Person
from bodysense.devices.video.arms import ArmModel, Arms, load_arms
from bodysense.devices.video.landmarker_files import LandmarkerFiles, find_landmarkers
from bodysense.devices.video.landmarks import Landmarker, LandmarkerSettings
from bodysense.devices.video.person import PersonLandmarks, PersonState, arm_keypoints, follow, joined_landmarks
from bodysense.devices.video.pictures import open_video
from bodysense.errors import BodysenseError
from bodysense.geometry.series import smoothed
from bodysense.io.clip import Clip
from bodysense.io.resample import at_constant_rate
from bodysense.sources.open import MotionSource, Opened, VideoSource
from bodysense_lab.papers.pahmt.camera_view import FRONT, sample_cameras, view, view_points
from bodysense_lab.papers.paper_options import PaperOptions, Variant, missing_weights_error

KINDS: tuple[Variant, ...] = ("cnn", "ahmt", "pahmt")
PACKAGED: Variant = "cnn"
FOLLOWING = 0.5  # s, standard deviation of the course that a simulated camera follows


def complete(opened: Opened, options: PaperOptions) -> Clip:
    """Return arms and hands on a standing body, from a video, or from a motion that a simulated camera films.

    Raises BodysenseError for other sources, for networks without packaged weights and for a file of another kind.
    """
    if options.device is not None or options.noise is not None:
        raise BodysenseError("--method pahmt: a camera watches; leave --device and --noise out")
    model = _model(options)
    if isinstance(opened, VideoSource):
        keypoints, skeleton = filmed(opened.name, options.landmarkers), Person(height=options.height).skeleton
    elif isinstance(opened, MotionSource):
        clip = opened.clip
        keypoints, skeleton = seen_from_front(clip), clip.pose.skeleton
    else:
        raise BodysenseError(f"{opened.name}: --method pahmt reads videos; give a video, or a motion to film")
    written = seen_part(keypoints, opened.name)
    frames = Arms(skeleton, model).complete(keypoints)
    assert frames.estimate.pose is not None
    pose, time = frames.estimate.pose[written], frames.time[written]
    rate = 1 / float(np.median(np.diff(time))) if len(time) > 1 else float(model.card["rate"])
    return at_constant_rate(Clip(opened.name, pose, rate), time)


def seen_from_front(clip: Clip) -> ArmKeypoints:
    """Return the key-points of a motion that a camera films from the front, without a detector's errors.

    The camera follows the person, as people film: it turns and travels with the course of the last and next second.
    """
    points = view_points(clip.pose)
    course = smoothed(points, FOLLOWING * clip.frame_rate)
    cameras = sample_cameras(course, np.random.default_rng(0), FRONT)
    seen = view(points[:, None], clip.time[:1], cameras)  # a camera a frame
    return ArmKeypoints(clip.time, *(getattr(seen, name)[:, 0] for name in list(vars(seen))[1:]))


def seen_part(frames: ArmKeypoints, name: str) -> slice:
    """Return the frames from the first to the last with a person in the picture, and print the share that is seen.

    Raises BodysenseError if the video has no person.
    """
    seen = frames.has_torso | frames.has_arm.any(axis=-1) | frames.has_hand.any(axis=-1)
    if not seen.any():
        raise BodysenseError(f"{name}: no person is seen in its {len(seen)} frames; film one person from the front")
    first, last = int(np.argmax(seen)), len(seen) - int(np.argmax(seen[::-1]))
    print(f"the person is seen in {seen.mean():.0%} of {len(seen)} frames, arms in {frames.has_arm.mean():.0%}")
    if last - first < len(seen):
        print(f"written: frames {first} to {last - 1}; nobody is seen before and after")
    return slice(first, last)


def filmed(name: str, landmarkers: Path | None = None) -> ArmKeypoints:
    """Return the key-points of the largest person in a video; `landmarkers` is a folder of MediaPipe's networks."""
    parts = watched(name, find_landmarkers(landmarkers), LandmarkerSettings())
    if not any(part.has_body.any() for part in parts):
        raise BodysenseError(
            f"{name}: no person was found in its {len(parts)} pictures; film one person from the front"
        )
    return arm_keypoints(joined_landmarks(parts))


def watched(name: str, files: LandmarkerFiles, settings: LandmarkerSettings) -> list[PersonLandmarks]:
    """Return the landmarks of the person that is followed through each picture of a video."""
    state, parts = PersonState(), []
    with open_video(name) as video, Landmarker(files, settings) as landmarker:
        if video.count is None and name.isdecimal():
            raise BodysenseError(f"{name}: a webcam never ends; give a video file")
        for picture in video.pictures:
            person, state = follow(picture, *landmarker.find(picture), state)
            parts.append(person)
    return parts


def _model(options: PaperOptions) -> ArmModel:
    kind = options.choose_variant("pahmt", KINDS, "pahmt")
    if options.networks is None and kind != PACKAGED:
        raise missing_weights_error(
            f"--variant {kind}",
            f"bodysense train arms --data DIR --model {kind} -o {kind}.onnx",
            f"--networks {kind}.onnx, or use the packaged network with --variant {PACKAGED}",
        )
    model = load_arms(options.networks)
    found = model.card["network"]["kind"]
    if found != kind and not (options.variant is None and found in KINDS):
        raise BodysenseError(f"--variant {kind}: {model.network.name} is a {found}; give --variant {found}")
    return model
