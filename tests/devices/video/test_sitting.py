"""People who sit and stand before a camera: landmarks of bodies with known truth, and rendered films."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.devices.video.device import POINTS, VideoDevice, VideoSettings
from bodysense.devices.video.landmarks import BODY_LANDMARKS, Landmarker, LandmarkerSettings
from bodysense.devices.video.person import PersonLandmarks, PersonState, follow, joined_landmarks
from bodysense.devices.video.pictures import Picture
from bodysense.devices.video.posture_constants import SEAT
from bodysense.tracking.tracker import Tracker, TrackerSettings

from ...people.desk import Desk, desk_landmarks, draw_desk
from ...people.filmed import HIP_OVER_SEAT, RATE, Film, pictures, seated_pose, truth
from ..conftest import SKELETON, seen_by

LEGS = ("knee", "ankle", "heel", "toe")
KNEES, ANKLES = (SKELETON.indices([f"{side}_{part}" for side in ("left", "right")]) for part in ("knee", "ankle"))


def still(pose: Pose, frames: int = 8) -> Pose:
    return Pose(pose.skeleton, np.tile(pose.root_position, (frames, 1)), np.tile(pose.rotation, (frames, 1, 1)))


def hide(person: PersonLandmarks, parts: tuple[str, ...], visible: float = 0.02) -> PersonLandmarks:
    """Return landmarks without parts of the legs, which lie where landmarkers guess them: anywhere."""
    marks = [BODY_LANDMARKS.index(f"{side}_{part}") for side in ("left", "right") for part in parts]
    seen, picture = person.visible.copy(), person.picture.copy()
    seen[:, marks] = visible
    picture[:, marks] += np.random.default_rng(len(parts)).normal(0, 0.2, (len(marks), 2))
    return replace(person, visible=seen, picture=picture)


def sat_on(device: VideoDevice, person: PersonLandmarks) -> tuple[float, bool]:
    """Return the height of the pelvis over the floor, m, and whether the last frame sits."""
    frames, state = device.step(person, device.start())
    assert len(frames) == len(person)
    return float(state.root[1]), bool(state.levels[-1, 2])


def before_camera(desk: Desk, make_device: Any) -> tuple[np.ndarray, np.ndarray, bool, float]:
    """Return the pelvis height, the bends of both knees, whether it sits, and how surely knees are seen at the end."""
    device = replace(make_device(0.0), skeleton=desk.pose.skeleton, aspect=4 / 3)
    device = replace(device, arms=replace(device.arms, skeleton=device.skeleton))
    person = desk_landmarks(desk, device.focal)
    frames, state = device.step(person, device.start())
    position = frames.observation.position[-1]
    knee, ankle = ([POINTS.index(f"{side}_{part}") for side in ("left", "right")] for part in LEGS[:2])
    bends = np.degrees(angle(position[ankle] - position[knee], np.array([0.0, -1.0, 0.0])))
    known = person.visible[-1, [BODY_LANDMARKS.index(f"{side}_knee") for side in ("left", "right")]].min()
    return state.root[1], bends, bool(state.levels[-1, 2]), float(known)


@pytest.mark.parametrize("at_table", [False, True])
@pytest.mark.parametrize("seat", [0.35, 0.4, 0.45, 0.5, 0.55, 0.6])
def test_people_at_any_desk_sit(seat: float, at_table: bool, make_device: Any) -> None:
    """The height is never farther from the seat's than a usual seat's, and nearer to it if knees are seen.

    Knees that are seen over the hips, as on the lowest benches, are taken for guesses on the edge of a table.
    """
    rng = np.random.default_rng(round(1000 * seat) + at_table)
    for _ in range(4):
        desk = draw_desk(rng, seat, at_table)
        height, _, is_seated, known = before_camera(desk, make_device)
        error = abs(height - desk.pose.root_position[1])
        assert is_seated, desk
        assert error < abs(seat - SEAT) + 0.04, desk
        assert seat < 0.4 or known < 0.6 or error < 0.6 * abs(seat - SEAT) + 0.04, desk


@pytest.mark.parametrize("seed", range(8))
def test_people_on_foot_before_any_camera_stand_straight(seed: int, make_device: Any) -> None:
    desk = draw_desk(np.random.default_rng(seed), None, False)
    height, bends, is_seated, _ = before_camera(desk, make_device)
    assert not is_seated and height == pytest.approx(desk.pose.root_position[1], abs=0.03)
    assert bends.max() < 8


@pytest.mark.parametrize("tilt", [0.0, 15.0])
def test_legs_that_were_never_seen_sit_on_a_usual_seat(tilt: float, make_device: Any) -> None:
    device = make_device(0.0, tilt=tilt)
    pose = still(seated_pose(SKELETON, SEAT))
    height, is_seated = sat_on(device, hide(seen_by(pose, device.focal, np.radians(tilt)), LEGS))
    assert is_seated and height == pytest.approx(pose.root_position[0, 1], abs=0.02)


@pytest.mark.parametrize("seat", [0.4, 0.6])
@pytest.mark.parametrize("hidden", [(), LEGS[1:]])
def test_who_was_seen_standing_sits_at_the_height_of_the_floor(
    seat: float, hidden: tuple[str, ...], make_device: Any
) -> None:
    device = make_device(0.0, tilt=10.0)
    upright = seen_by(still(standing_pose(SKELETON), 30), device.focal, np.radians(10))
    sat = still(seated_pose(SKELETON, seat), 40)
    seated = hide(seen_by(sat, device.focal, np.radians(10)), LEGS)
    _, state = device.step(hide(upright, hidden) if hidden else upright, device.start())
    _, state = device.step(replace(seated, time=seated.time + 1.0), state)
    assert state.root[1] == pytest.approx(sat.root_position[0, 1], abs=0.04)
    standing = hide(upright, LEGS)
    _, state = device.step(replace(standing, time=standing.time + 3.0), state)
    assert state.root[1] == pytest.approx(SKELETON.rest_offset[0, 1], abs=0.04)


def angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    sizes = np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1)
    return np.arccos(np.clip((a * b).sum(axis=-1) / sizes, -1, 1))


FILMS = {
    "chair": Film(0.45, height=1.1, distance=1.5, seed=1),
    "stool": Film(0.60, height=1.0, distance=2.2, seed=2),
    "table": Film(0.45, tilt=15, height=1.4, distance=1.9, at_table=True, seed=3),
    "standing": Film(None, height=1.2, distance=3.0, seed=4),
    "standing, tilted": Film(None, tilt=15, height=1.6, distance=1.7, seed=5),
    "woman at a table": Film(0.60, tilt=15, height=1.25, distance=1.0, figure="woman", at_table=True, seed=6),
    "woman": Film(0.45, tilt=15, height=1.25, distance=1.0, figure="woman", seed=6),
    "coming and going": Film(0.45, height=1.1, distance=1.6, present=(0.3, 0.7), seconds=3, seed=7),
}


def watched(film: Film, files: Any) -> Iterator[PersonLandmarks]:
    state = PersonState()
    with Landmarker(files, LandmarkerSettings(people=1)) as landmarker:
        for k, pixels in enumerate(pictures(film)):
            picture = Picture(k / RATE, pixels)
            person, state = follow(picture, *landmarker.find(picture), state)
            yield person


@pytest.mark.slow
@pytest.mark.parametrize("name", FILMS)
def test_rendered_people_sit_and_stand(name: str, landmarkers: Path) -> None:
    from bodysense.devices.video.arms import Arms, ArmSettings, load_arms
    from bodysense.devices.video.landmarker_files import find_landmarkers

    pytest.importorskip("moderngl")
    film = FILMS[name]
    person = joined_landmarks(list(watched(film, find_landmarkers(landmarkers))))
    assert not person.has_body[~film.is_present].any() and person.has_body[film.is_present].mean() > 0.9
    true = truth(film)
    wearer = Person(height=true.skeleton.height)
    tracker = Tracker(wearer, settings=TrackerSettings(infer=False))
    device = VideoDevice(
        wearer.skeleton, Arms(wearer.skeleton, load_arms(None), ArmSettings(0.0)), 4 / 3, VideoSettings(0.0)
    )
    frames, _ = device.step(person, device.start())
    points, _ = tracker.step(frames.observation, tracker.start())
    late = np.flatnonzero(film.is_present)[15:]
    found, known = points.points[late], np.asarray(forward_kinematics(true)[0])[late]
    assert np.abs(np.median(found[:, 0, 1] - known[:, 0, 1])) < 0.08
    hips = SKELETON.indices(("left_hip", "right_hip"))
    bends = [
        np.degrees(angle(places[:, KNEES] - places[:, hips], places[:, ANKLES] - places[:, KNEES]))
        for places in (found, known)
    ]
    assert np.abs(np.median(bends[0] - bends[1], axis=0)).max() < (8 if film.seat is None else 15)


def test_hips_of_the_films_are_over_their_seats() -> None:
    position = np.asarray(forward_kinematics(seated_pose(SKELETON, 0.45))[0])
    assert position[SKELETON.index("left_hip"), 1] == pytest.approx(0.45 + HIP_OVER_SEAT)
    assert position[ANKLES, 1] == pytest.approx(
        np.asarray(forward_kinematics(standing_pose(SKELETON))[0])[ANKLES, 1], abs=1e-6
    )
