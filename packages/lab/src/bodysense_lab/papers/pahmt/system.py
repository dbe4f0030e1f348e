"""PAHMT on a video: landmarks, windows of 32 frames, rotations of arms and hands on a body that stands (section 3)."""

from __future__ import annotations

import numpy as np

from bodysense.body.keypoints import ArmKeypoints
from bodysense.body.person import Person
from bodysense.devices.video.arms import ArmModel, Arms, load_arms
from bodysense.devices.video.landmarker_files import LandmarkerFiles, find_landmarkers
from bodysense.devices.video.landmarks import Landmarker, LandmarkerSettings
from bodysense.devices.video.person import PersonLandmarks, PersonState, arm_keypoints, follow, joined_landmarks
from bodysense.devices.video.pictures import open_video
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.resample import at_constant_rate
from bodysense.sources.open import MotionSource, Opened, VideoSource
from bodysense_lab.papers.pahmt.camera_view import FRONT, sample_cameras, view, view_points
from bodysense_lab.papers.paper_options import PaperOptions, Variant, missing_weights_error

KINDS: tuple[Variant, ...] = ("cnn", "ahmt", "pahmt")
PACKAGED: Variant = "cnn"


def complete(opened: Opened, options: PaperOptions) -> Clip:
    """Return arms and hands on a standing body, from a video, or from a motion that a simulated camera films.

    Raises BodysenseError for other sources, for networks without packaged weights and for a file of another kind.
    """
    if options.device is not None or options.noise is not None:
        raise BodysenseError("--method pahmt: a camera watches; leave --device and --noise out")
    model = _model(options)
    if isinstance(opened, VideoSource):
        keypoints, skeleton = filmed(opened.name), Person(height=options.height).skeleton
    elif isinstance(opened, MotionSource):
        clip = opened.clip
        keypoints, skeleton = seen_from_front(clip), clip.pose.skeleton
    else:
        raise BodysenseError(f"{opened.name}: --method pahmt reads videos; give a video, or a motion to film")
    frames = Arms(skeleton, model).complete(keypoints)
    assert frames.estimate.pose is not None
    rate = 1 / float(np.median(np.diff(frames.time))) if len(frames) > 1 else float(model.card["rate"])
    return at_constant_rate(Clip(opened.name, frames.estimate.pose, rate), frames.time)


def seen_from_front(clip: Clip) -> ArmKeypoints:
    """Return the key-points of a motion that a camera films from the front, without a detector's errors."""
    points = view_points(clip.pose)
    seen = view(points[None], clip.time, sample_cameras(points[:1], np.random.default_rng(0), FRONT))
    return ArmKeypoints(seen.time, *(getattr(seen, name)[0] for name in list(vars(seen))[1:]))


def filmed(name: str) -> ArmKeypoints:
    """Return the key-points of the largest person in a video."""
    parts = watched(name, find_landmarkers(None), LandmarkerSettings())
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
