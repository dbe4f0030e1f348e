"""Checks of every reader's motion: right motion passes, and each kind of damaged motion is found."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.demo import packaged_performance, performance_of_unseen_body
from bodysense.io.clip import Clip
from bodysense.observing.world import moments
from bodysense.quality.plausible import doubts_about, facing, floor_doubt

Places = dict[str, np.ndarray]


def places_of(clip: Clip) -> tuple[Places, Places, float]:
    """Return the joints in some frames, and a moment later."""
    place = np.asarray(forward_kinematics(clip.pose)[0])[:, clip.pose.skeleton.indices(BODY)]
    first, later, moment = moments(len(clip), clip.frame_rate)
    return *({name: place[at, k] for k, name in enumerate(BODY)} for at in (first, later)), moment  # type: ignore[return-value]


def kinds(place: Places, later: Places, moment: float, rate: float = 30.0) -> set[str]:
    return {doubt.kind for doubt in doubts_about(place, later, moment, rate)}


def swapped(place: Places) -> Places:
    other = {"left": "right", "right": "left"}
    return {
        name: place[f"{other[side]}_{part}" if side in other else name]
        for name in place
        for side, _, part in [name.partition("_")]
    }


@pytest.mark.parametrize("make", [packaged_performance, performance_of_unseen_body])
def test_people_pass(make: Callable[[], Clip]) -> None:
    place, later, moment = places_of(make())
    assert kinds(place, later, moment) == set()
    feet, knees = facing(place)
    assert feet > 0.5 and knees > 0.5


@pytest.mark.parametrize("hidden", [(), ("foot",), ("head", "wrist", "elbow")])
def test_exchanged_sides_and_mirrors_are_told(hidden: tuple[str, ...]) -> None:
    place, later, moment = places_of(packaged_performance())
    place, later = ({name: p for name, p in one.items() if not name.endswith(hidden or "?")} for one in (place, later))
    mirrored = [{name: p * [-1.0, 1.0, 1.0] for name, p in one.items()} for one in (place, later)]
    assert kinds(swapped(place), swapped(later), moment) == {"mirror"}
    assert kinds(mirrored[0], mirrored[1], moment) == {"mirror"}
    assert kinds(swapped(mirrored[0]), swapped(mirrored[1]), moment) == set(), "both together are a body"


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_points_of_one_camera_are_flat(axis: int) -> None:
    place, later, moment = places_of(packaged_performance())
    level = np.ones(3)
    level[axis] = 0
    first, second = ({name: p * level for name, p in one.items()} for one in (place, later))
    assert "flat" in kinds(first, second, moment)


def test_units_and_rates() -> None:
    place, later, moment = places_of(packaged_performance())
    first, second = ({name: 100 * p for name, p in one.items()} for one in (place, later))
    assert kinds(first, second, moment) >= {"size"}
    assert kinds(place, {name: p + np.array([0.9, 0, 0]) for name, p in place.items()}, moment) == {"speed"}
    assert kinds(place, later, moment, rate=0.03) == {"rate"} == kinds(place, later, moment, rate=1200.0)
    assert floor_doubt(2.9) is None
    doubt = floor_doubt(-86.0)
    assert doubt is not None and "--unit" in doubt.text
