"""Landmarks of all people in a picture, by MediaPipe's pose and hand landmarkers.

The camera's axes are x to the picture's right, y up, z toward the camera. Positions in a picture are measured from its
middle in heights of the picture, x to the right, y up. Left and right are the person's.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np

from bodysense.devices.video.landmarker_files import LandmarkerFiles
from bodysense.devices.video.pictures import Picture
from bodysense.devices.video.silence import silence
from bodysense.errors import BodysenseError, missing_package

# fmt: off
BODY_LANDMARKS = (  # landmarks of MediaPipe's pose landmarker (BlazePose), in its order
    "nose", "left_eye_inner", "left_eye", "left_eye_outer", "right_eye_inner", "right_eye", "right_eye_outer",
    "left_ear", "right_ear", "left_mouth", "right_mouth", "left_shoulder", "right_shoulder", "left_elbow",
    "right_elbow", "left_wrist", "right_wrist", "left_pinky", "right_pinky", "left_index", "right_index",
    "left_thumb", "right_thumb", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
    "left_heel", "right_heel", "left_toe", "right_toe",
)
# fmt: on
_TO_OURS = np.array([1.0, -1.0, -1.0])  # MediaPipe's x, y, z point right, down and away from the camera
_BODY_CONFIDENCE = 0.5  # least probability of a detected body
_HAND_CONFIDENCE = 0.4  # least probability of a detected hand


@dataclass(frozen=True, eq=False)
class Bodies:
    """N bodies in a picture, with 33 `BODY_LANDMARKS` each."""

    world: np.ndarray  # (N, 33, 3) m, from the middle of the hips, camera's axes
    picture: np.ndarray  # (N, 33, 2) positions in the picture
    visible: np.ndarray  # (N, 33) probability that the landmark is in the picture and not hidden


@dataclass(frozen=True, eq=False)
class HandLandmarks:
    """N hands in a picture, with 21 points each (`body.arms.HAND_POINTS`)."""

    world: np.ndarray  # (N, 21, 3) m, from the middle of the hand, camera's axes
    picture: np.ndarray  # (N, 21, 2) positions in the picture
    left: np.ndarray  # (N,) probability that it is a left hand


@dataclass(frozen=True)
class LandmarkerSettings:
    """Settings of the landmarkers."""

    people: int = 2  # maximum number of people; 1 is more than twice as fast, but may switch to a person in front

    def __post_init__(self) -> None:
        if self.people < 1:
            raise BodysenseError(f"--people {self.people}: give at least 1")


class Landmarker:
    """Pose and hand landmarkers as a context manager.

    Pictures must be in order of time, because the landmarkers track people from one to the next.
    """

    def __init__(self, files: LandmarkerFiles, settings: LandmarkerSettings = LandmarkerSettings()) -> None:
        try:
            import mediapipe  # pyright: ignore[reportMissingImports]
            from mediapipe.tasks.python import BaseOptions, vision  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise missing_package(error) from None

        self._image: Any = mediapipe
        self._moment = -1  # ms
        with ExitStack() as stack:
            stack.enter_context(silence())
            try:
                self._pose = vision.PoseLandmarker.create_from_options(
                    vision.PoseLandmarkerOptions(
                        base_options=BaseOptions(model_asset_path=str(files.pose)),
                        running_mode=vision.RunningMode.VIDEO,
                        num_poses=settings.people,
                        min_pose_detection_confidence=_BODY_CONFIDENCE,
                    )
                )
                stack.callback(self._pose.close)
                self._hand = vision.HandLandmarker.create_from_options(
                    vision.HandLandmarkerOptions(
                        base_options=BaseOptions(model_asset_path=str(files.hand)),
                        running_mode=vision.RunningMode.VIDEO,
                        num_hands=2 * settings.people,
                        min_hand_detection_confidence=_HAND_CONFIDENCE,
                    )
                )
                stack.callback(self._hand.close)
            except (RuntimeError, ValueError, OSError) as error:
                raise BodysenseError(
                    f"{files.pose.parent}: the landmarkers there cannot be used ({str(error).splitlines()[0]}); "
                    "get them again (docs/video.md)"
                ) from None
            stack.pop_all()

    def __enter__(self) -> Landmarker:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close both landmarkers. Their destructors must not run at the interpreter's exit."""
        self._pose.close()
        self._hand.close()

    def find(self, picture: Picture) -> tuple[Bodies, HandLandmarks]:
        """Return the bodies and hands of all people in the next picture."""
        first = self._moment < 0
        self._moment = max(round(1000 * picture.time), self._moment + 1)
        image = self._image.Image(image_format=self._image.ImageFormat.SRGB, data=np.ascontiguousarray(picture.pixels))
        with silence(first):
            pose = self._pose.detect_for_video(image, self._moment)
            hand = self._hand.detect_for_video(image, self._moment)
        aspect = picture.pixels.shape[1] / picture.pixels.shape[0]
        bodies = Bodies(
            world=_world(pose.pose_world_landmarks, len(BODY_LANDMARKS)),
            picture=_places(pose.pose_landmarks, len(BODY_LANDMARKS), aspect),
            visible=np.array([[min(p.visibility, p.presence) for p in body] for body in pose.pose_landmarks]).reshape(
                -1, len(BODY_LANDMARKS)
            ),
        )
        # MediaPipe's labels are right for pictures that are not mirrored.
        left = [side.score if side.category_name == "Left" else 1 - side.score for (side, *_) in hand.handedness]
        return bodies, HandLandmarks(
            _world(hand.hand_world_landmarks, 21), _places(hand.hand_landmarks, 21, aspect), np.array(left)
        )


def _world(found: list[Any], count: int) -> np.ndarray:
    points = np.array([[(p.x, p.y, p.z) for p in one] for one in found], dtype=float).reshape(-1, count, 3)
    return points * _TO_OURS


def _places(found: list[Any], count: int, aspect: float) -> np.ndarray:
    share = np.array([[(p.x, p.y) for p in one] for one in found], dtype=float).reshape(-1, count, 2)
    return (share - 0.5) * [aspect, -1.0]
