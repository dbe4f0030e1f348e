"""Properties of the packaged tracker on scripted scenes: standing people do not glide, step or cross their legs."""

from __future__ import annotations

import pytest

from bodysense_lab.completion.score.scores import RunningScores
from bodysense_lab.completion.score.scripted.scene_scoring import SceneWork, scene_jobs
from bodysense_lab.completion.score.tracking import PeopleTracker

STANDING = ("stand", "weight_on_one_leg", "hands_behind_head", "arms_crossed")
STEPPING = ("turn", "shuffle", "step_aside", "step_back")


def scored(sets: tuple[str, ...], kinds: tuple[str, ...]) -> dict[str, RunningScores]:
    work = SceneWork(PeopleTracker(None), sets)
    scores = {name: RunningScores() for name in work.sets}
    for job in scene_jobs("val", kinds, 6):
        for name, one in work(job).items():
            scores[name].merge(one)
    return scores


@pytest.fixture(scope="module")
def standing() -> dict[str, RunningScores]:
    return scored(("three_point", "six_point"), STANDING)


@pytest.mark.slow
def test_people_who_turn_and_shuffle_step() -> None:
    """Without the lift of feet that move, 5 % of frames glide; if steps begin at twice the strain, 33 % are missing."""
    three = scored(("three_point",), STEPPING)["three_point"]
    print({name: three.get(name) for name in ("gliding_share", "missed_steps_share", "false_steps_per_minute")})
    assert three.get("gliding_share") < 0.002  # measured: 0.0006
    assert three.get("missed_steps_share") < 0.31  # measured: 0.293
    assert three.get("crossed_share") == 0


@pytest.mark.slow
def test_feet_that_cameras_find_step_to_where_they_are_seen() -> None:
    """Without the lift of feet that are eased, 16 % of frames glide."""
    seen = scored(("headset_camera",), ("turn", "shuffle"))["headset_camera"]
    print(seen.get("gliding_share"))
    assert seen.get("gliding_share") < 0.108  # measured: 0.098


@pytest.mark.slow
def test_feet_of_standing_people_stay_where_they_are(standing: dict[str, RunningScores]) -> None:
    """Without the hold of standing feet, gliding is 0.022 and false steps are 10 a minute.

    Better data of upright people in training make these smaller.
    """
    three = standing["three_point"]
    print({name: round(three.get(name), 4) for name in ("gliding_share", "float_standing_share", "error_cm")})
    assert three.get("gliding_share") < 0.002  # measured: 0.0002
    assert three.get("float_standing_share") < 0.01  # measured: 0.0025
    assert three.get("false_steps_per_minute") < 2.7  # measured: 2.5, of people who bend as they look down
    assert three.get("crossed_share") == 0 and three.get("under_floor_share") == 0


@pytest.mark.slow
def test_tracked_feet_are_true(standing: dict[str, RunningScores]) -> None:
    six = standing["six_point"]
    assert six.get("legs_cm") < 0.20  # measured: 0.18
    for name in ("gliding_share", "float_standing_share", "false_steps_per_minute", "crossed_share"):
        assert six.get(name) == 0, name
