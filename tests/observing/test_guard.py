"""The guard of live input: right worlds give no notice, and the fixes of wrong ones lead to the right one."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from people.made import LYING
from people.worlds import SETS, UPRIGHT, Body, World, drawn_body, exchanged, written

from bodysense.errors import BodysenseError
from bodysense.observing.guard import Guard, watch
from bodysense.observing.observation import Observation, observe
from bodysense.observing.world_axes import TURNS, UNITS, convert_world
from bodysense.tracking.tracker import Tracker, TrackerSettings
from bodysense_lab.synthesis.scenes import KINDS

EVERY = (*KINDS, *LYING, "jump", "child", "seated child")
FLOORS = (-10.0, -1.6, 3.6, 12.0)
WRONG = (
    *(World(up=up) for up in TURNS if up != "y"),
    *(World(unit=unit) for unit in UNITS if unit != "m"),
    *(World(floor=floor) for floor in FLOORS),
    World(swapped=True),
    World(second=1e-3),
    World(second=1e-6),
)


def notices(seen: Observation, floor: float = 0.0) -> tuple[str, ...]:
    return watch(Guard(), seen, float("nan"), floor)[0]


@lru_cache
def upright(seed: int, kind: str | None = None) -> Body:
    rng = np.random.default_rng(seed)
    return drawn_body(kind or str(rng.choice(UPRIGHT)), rng)


@pytest.mark.parametrize("kind", EVERY)
def test_right_worlds_give_no_notice(kind: str) -> None:
    rng = np.random.default_rng(list(EVERY).index(kind))
    body = drawn_body(kind, rng)
    for floor in (0.0, 0.5):
        for points, turned in SETS.values():
            assert notices(written(body.seen(points, turned), World(floor=floor)), floor) == ()


@pytest.mark.parametrize("world", WRONG, ids=str)
def test_wrong_worlds_give_a_notice(world: World) -> None:
    """A world is passed over only if its heights are those of a body that lies, reaches or looks down."""
    passed = looked = 0
    for seed in range(12):
        body = upright(seed)
        for name, (points, turned) in SETS.items():
            if world.swapped and not (turned and "left_wrist" in points):
                continue
            seen = written(body.seen(points, turned), world)
            looked += 1
            if notices(seen):
                continue
            passed += 1
            low, high = seen.position[..., 1].min(), seen.position[..., 1].max()
            least, most = (-0.3, 2.8) if name in ("three places", "head") else (-0.1, 1.95)
            assert world.swapped or (world.up not in ("y", "-y") and least < low and high < most), (name, body.kind)
    assert passed <= 0.4 * looked


def fixed(seen: Observation, notice: str, floor: float) -> tuple[Observation, float]:
    """Return the observation, and the floor of the settings, after the fix that a notice names."""
    if found := re.search(r"up='(-?[xyz])'", notice):
        return convert_world(seen, None, found[1]), floor
    if found := re.search(r"floor=(-?[\d.]+)", notice):
        return seen, float(found[1])
    if found := re.search(r"unit='([a-z]+)'", notice):
        return convert_world(seen, found[1], None), floor
    if "milliseconds" in notice:
        return replace(seen, time=seen.time / 1000), floor
    assert "exchange them" in notice, notice
    return exchanged(seen), floor


@pytest.mark.parametrize("seed", range(12))
def test_fixes_that_notices_name_lead_to_the_right_world(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    world = World(
        up=str(rng.choice(["y", "z", "-y", "x"])),
        unit=str(rng.choice(["m", "m", "cm", "mm", "ft"])),
        floor=float(rng.choice([0.0, 0.0, *FLOORS])),
        swapped=bool(rng.integers(2)),
        second=float(rng.choice([1.0, 1e-3])),
    )
    right = upright(100 + seed, "walk").seen(*SETS["six points"])
    seen, floor = written(right, world), 0.0
    for _ in range(8):
        try:
            first = {name: (seen.position[0, k], seen.rotation[0, k]) for k, name in enumerate(seen.points)}
            observe(float(seen.time[0]), first)
            found = notices(seen, floor)
        except BodysenseError as error:
            found = (str(error),)
        if not found:
            break
        seen, floor = fixed(seen, found[0], floor)
    assert np.abs(seen.position - [0.0, floor, 0.0] - right.position).max() < 0.2, (world, floor)
    assert np.allclose(seen.time, right.time)


@pytest.mark.parametrize("unit", [unit for unit in UNITS if unit != "m"])
def test_observe_names_every_unit(unit: str) -> None:
    seen = written(upright(1, "stand").seen(*SETS["three points"]), World(unit=unit))
    poses = {name: (seen.position[0, k], None) for k, name in enumerate(seen.points)}
    if unit == "ft":
        assert notices(seen)
        return
    with pytest.raises(BodysenseError, match=f"unit='{unit}'") as error:
        observe(0.0, poses)
    assert all(name in str(error.value) for name in UNITS)


def test_points_of_other_people_are_named() -> None:
    seen = upright(3, "stand").seen(*SETS["six points"])
    far = seen.position.copy()
    far[:, seen.points.index("left_wrist")] += [3.0, 0, 0]
    (notice,) = notices(replace(seen, position=far))
    assert notice.startswith("left_wrist is ") and "of this person" in notice


def test_one_pause_is_no_other_unit_of_time() -> None:
    seen = upright(4, "stand").seen(*SETS["three points"])
    paused = replace(seen, time=seen.time + np.where(np.arange(len(seen)) < 40, 0.0, 30.0))
    assert notices(paused) == ()
    _, guard = watch(Guard(), seen[:40], float("nan"), 0.0)
    after = replace(seen[40:], time=seen[40:].time + 30.0)
    assert watch(guard, after, float(seen.time[39]), 0.0)[0] == ()


def test_frames_one_by_one_give_the_notices_of_all_at_once() -> None:
    seen = written(upright(5, "walk").seen(*SETS["three points"]), World(up="z", second=1e-3))
    guard, before, found = Guard(), float("nan"), []
    for k in range(len(seen)):
        if guard.is_due(seen[k : k + 1], before):
            texts, guard = watch(guard, seen[k : k + 1], before, 0.0)
            found += texts
        before = float(seen.time[k])
    assert sorted(found) == sorted(notices(seen)) and len(found) == len(set(found)) == 2


def test_the_tracker_asks_once_for_a_state() -> None:
    seen = upright(6, "stand").seen(*SETS["three points"])
    tracker = Tracker(settings=TrackerSettings())
    high = written(seen, World(unit="ft"))
    first, state = tracker.step(high[:1], tracker.start())
    again, state = tracker.step(high[1:2], state)
    assert first.notices and again.notices == ()
    for k, late in ((2, 16.7), (3, 33.4)):
        estimate, state = tracker.step(replace(high[k : k + 1], time=high.time[k : k + 1] + late), state)
    assert any("milliseconds" in notice for notice in estimate.notices)
    restored = tracker.restore(state.to_bytes())
    later = replace(high[4:5], time=high.time[4:5] + 33.5)
    assert tracker.step(later, restored)[0].notices == ()


@pytest.mark.parametrize("times", [(0.0, 1e18, 1e18), (np.nan, np.nan, 1.0), (3.0, 2.0, 1.0), (0.0, np.inf, np.inf)])
def test_impossible_times_end_the_look(times: tuple[float, ...]) -> None:
    """They are refused by the step; the guard must only come back."""
    seen = replace(upright(1, "stand").seen(*SETS["head"])[: len(times)], time=np.array(times))
    assert len(notices(seen)) <= 1


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300, 0.0])
def test_impossible_values_end_the_look(value: float) -> None:
    seen = upright(1, "stand").seen(*SETS["six points"])[:3]
    bad = replace(seen, position=np.full_like(seen.position, value), rotation=np.full_like(seen.rotation, value))
    assert len(notices(bad)) <= 1
