from __future__ import annotations

import pickle
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from bodysense.body.arms import HAND_POINTS, SIDES
from bodysense.body.pose import standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.capture.landmarks import BODY_LANDMARKS, Bodies, Hands, Landmarker
from bodysense.capture.person import PersonState, follow
from bodysense.capture.video import Picture, VideoBrokenError
from bodysense.estimators.arms import Arms, ArmSettings, load_arms
from bodysense.estimators.landmark_body import landmark_body
from bodysense.estimators.video_body import VideoBody, VideoSettings
from bodysense.estimators.video_path import Completed, complete_video

SKELETON = default_skeleton()
BODY = landmark_body(SKELETON)
RATE = 30.0


class Standing:
    """A landmarker that finds the same person in every picture, and their hands where it is told to."""

    def __init__(self, has_hands: Any = lambda time: True) -> None:
        pose = standing_pose(SKELETON)
        points = pose.root_position + SKELETON.path @ SKELETON.rest_offset
        names = [name if name in SKELETON.points else "head" for name in BODY_LANDMARKS]
        world = points[SKELETON.indices(names)] - pose.root_position
        # A T-pose would lie in one plane; a face has a depth.
        world[BODY_LANDMARKS.index("nose"), 2] += 0.1
        for sign, side in zip((1, -1), SIDES, strict=True):
            world[BODY_LANDMARKS.index(f"{side}_ear"), 0] += 0.07 * sign
        self.world, self.has_hands = world, has_hands
        hands = [[f"{side}_{name}" for name in HAND_POINTS] for side in SIDES]
        self.hands = np.stack([points[SKELETON.indices(hand)] for hand in hands])
        self.hands = self.hands - self.hands.mean(axis=1, keepdims=True)

    def find(self, picture: Picture) -> tuple[Bodies, Hands]:
        places = self.world[None, :, :2] / 3
        bodies = Bodies(self.world[None], places, np.ones((1, len(BODY_LANDMARKS))))
        world = self.hands if self.has_hands(picture.time) else self.hands[:0]
        wrists = places[0, [BODY_LANDMARKS.index(f"{side}_wrist") for side in SIDES][: len(world)]]
        at = wrists[:, None] + (world - world[:, :1])[..., :2] / 3
        return bodies, Hands(world, at, np.array([0.9, 0.1])[: len(world)])


def pictures(count: int) -> Iterator[Picture]:
    for k in range(count):
        yield Picture(k / RATE, np.zeros((8, 12, 3), np.uint8))


def completed(source: Iterator[Picture], landmarker: Standing, arms: Arms | None, ahead: float) -> Iterator[Completed]:
    return complete_video(
        source, cast(Landmarker, landmarker), lambda aspect: VideoBody(BODY, arms, aspect, VideoSettings(ahead))
    )


@pytest.fixture(scope="module")
def network(small_arms: Path) -> Arms:
    return Arms(SKELETON, load_arms(small_arms), ArmSettings(look_ahead=0.1))


@pytest.mark.parametrize("ahead", [0.0, 0.1])
def test_every_picture_is_answered_once_as_late_as_is_said(ahead: float) -> None:
    newest, answered = -1.0, []

    def seen() -> Iterator[Picture]:
        nonlocal newest
        for picture in pictures(20):
            newest = picture.time
            yield picture

    for done in completed(seen(), Standing(), None, ahead):
        assert done.frames.time.tolist() == [picture.time for picture in done.pictures]
        if newest < 19 / RATE:
            assert all(time == pytest.approx(newest - ahead) for time in done.frames.time)
        answered += done.frames.time.tolist()
    np.testing.assert_allclose(answered, np.arange(20) / RATE)


def test_where_a_video_breaks_what_waited_comes_first() -> None:
    def broken() -> Iterator[Picture]:
        yield from pictures(9)
        raise VideoBrokenError("it breaks off")

    answered = []
    with pytest.raises(VideoBrokenError, match="it breaks off"):
        for done in completed(broken(), Standing(), None, 0.1):
            answered += done.frames.time.tolist()
    assert len(answered) == 9


def test_a_hand_that_leaves_for_three_seconds_comes_back(network: Arms) -> None:
    away = Standing(lambda time: not 1.0 <= time < 4.0)
    parts = list(completed(pictures(135), away, network, 0.1))
    time = np.concatenate([done.frames.time for done in parts])
    np.testing.assert_allclose(time, np.arange(135) / RATE)
    hidden = np.concatenate([done.frames.estimate.occluded for done in parts])[:, SKELETON.index("left_index2")]
    np.testing.assert_array_equal(hidden, (time >= 1.0) & (time < 4.0))
    rotation = np.concatenate([done.frames.pose.rotation for done in parts])
    np.testing.assert_allclose(np.linalg.norm(rotation, axis=-1), 1.0, atol=1e-6)


@pytest.mark.parametrize("with_network", [True, False], ids=["network", "landmarks"])
def test_memory_does_not_grow_with_the_video(network: Arms, with_network: bool) -> None:
    """Pictures are let go, and what is remembered is as large after five seconds as after three."""
    alive, most = weakref.WeakSet[Picture](), 0

    def counted() -> Iterator[Picture]:
        for picture in pictures(60):
            alive.add(picture)
            yield picture

    for _ in completed(counted(), Standing(), network if with_network else None, 0.1):
        most = max(most, len(alive))
    assert most <= 6  # three that wait, those just answered, and the next

    body = VideoBody(BODY, network if with_network else None, 1.5, VideoSettings(0.1))
    landmarker, state, person_state, sizes = Standing(), body.start(), PersonState(), []
    for picture in pictures(150):
        person, person_state = follow(picture, *landmarker.find(picture), person_state)
        _, state = body.step(person, state)
        sizes.append(len(pickle.dumps((state, person_state))))
    assert max(sizes[100:]) <= max(sizes[50:100])
