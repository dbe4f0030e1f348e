"""Scores: averages are over frames, fingers from their wrist, categories apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.devices.simulated.sensors import HEADSET_CAMERA, observe
from bodysense.io.clip import Clip
from bodysense.papers.ik_tracker import IkTrackerSettings
from bodysense.scoring import KNOWN, Tallies, Tally, TrackedClip, score
from bodysense_lab.unoc.learned import track_clip


@pytest.fixture(scope="module")
def tracked(waving_clip: Clip) -> TrackedClip:
    """As if four methods had been run: the first is off by 2 cm, the others by 1, 4 and 3 cm, all to one side."""
    truth = np.asarray(forward_kinematics(waving_clip.pose)[0])
    errors = {"bodysense": 0.02, "network": 0.01, "world": 0.04, "head": 0.03}
    position = {method: truth + np.array([error, 0.0, 0.0]) for method, error in errors.items()}
    seen = observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)
    return TrackedClip(waving_clip, seen, waving_clip.pose, position)


def table(tallies: Tallies) -> dict[str, float]:
    """By part, share and group: ours without a name before it, others with."""
    names = {"bodysense": "", "network": "network_", "world": "world_", "head": "head_"}
    return {
        f"{names[method]}{part}_{share}_{measure}_cm" + ("" if group == "main" else f"_{group}"): getattr(
            tally, measure
        )
        for (group, part, share, method), tally in tallies.items()
        for measure in ("rmsjpe", "mpjpe")
    }


def test_errors_and_ratios(tracked: TrackedClip) -> None:
    numbers = table(score(tracked))
    for share in ("occluded", "known", "all"):
        assert numbers[f"body_{share}_rmsjpe_cm"] == pytest.approx(2.0)
        assert numbers[f"body_{share}_mpjpe_cm"] == pytest.approx(2.0)
        assert numbers[f"network_body_{share}_rmsjpe_cm"] == pytest.approx(1.0)
        assert numbers[f"head_body_{share}_rmsjpe_cm"] == pytest.approx(3.0)
    # Fingers are measured from their wrist: an error of the whole hand is none of theirs.
    assert numbers["finger_occluded_rmsjpe_cm"] == pytest.approx(0.0, abs=1e-6)
    assert numbers["body_and_finger_occluded_rmsjpe_cm"] == pytest.approx(2.0)


def test_what_counts_as_occluded(tracked: TrackedClip) -> None:
    """An error where a point is seen is in 'all', not in 'occluded'; one before it was ever seen not in 'known'."""
    hidden = ~tracked.observation.has_position
    truth = tracked.position["bodysense"] - [0.02, 0.0, 0.0]
    never = hidden & (np.cumsum(~hidden, axis=0) == 0)
    cases = {"seen": ~hidden, "never seen": never, "hidden again": hidden & ~never}
    counted = {"seen": ["all"], "never seen": ["all", "occluded"], "hidden again": ["all", "occluded", "known"]}
    for case, mask in cases.items():
        wrong = truth + np.where(mask[..., None], 0.1, 0.0)
        numbers = table(score(replace(tracked, position=tracked.position | {"bodysense": wrong})))
        for share in ("occluded", "known", "all"):
            error = numbers[f"every_point_{share}_rmsjpe_cm"]
            assert (error > 1e-6) == (share in counted[case]), (case, share)


def test_which_joints_count(tracked: TrackedClip) -> None:
    """An error of the spine is none of 'body', one of a knee is; the head, which is measured, is in no part."""
    truth = tracked.position["bodysense"] - [0.02, 0.0, 0.0]
    skeleton = tracked.clip.pose.skeleton

    def parts(point: str) -> set[str]:
        wrong = truth.copy()
        wrong[:, skeleton.index(point)] += 0.1
        numbers = table(score(replace(tracked, position=tracked.position | {"bodysense": wrong})))
        return {part for part in ("body", "every_point", "finger") if numbers[f"{part}_all_rmsjpe_cm"] > 1e-6}

    assert parts("left_knee") == {"body", "every_point"}
    assert parts("spine2") == {"every_point"}
    assert parts("left_index2") == {"finger"}
    assert parts("head") == set()


def test_clips_without_fingers_say_nothing_of_them(tracked: TrackedClip) -> None:
    numbers = table(score(replace(tracked, clip=replace(tracked.clip, has_fingers=False))))
    assert not [key for key in numbers if "finger" in key] and "body_all_rmsjpe_cm" in numbers


@pytest.mark.parametrize(
    ("category", "suffix"), [("", ""), ("sit", ""), ("sport", "_sport"), ("dance", "_dance"), ("juggling", "_other")]
)
def test_categories_are_scored_apart(tracked: TrackedClip, category: str, suffix: str) -> None:
    numbers = table(score(replace(tracked, clip=replace(tracked.clip, category=category))))
    assert {key for key in numbers if key.startswith("body_all_rmsjpe_cm")} == {f"body_all_rmsjpe_cm{suffix}"}


def test_averages_are_over_frames() -> None:
    long, short = Tally(), Tally()
    long.add(np.full((9, 1), 1.0))
    short.add(np.full((1, 1), 3.0))
    long.merge(short)
    assert long.mpjpe == pytest.approx(1.2)
    assert long.rmsjpe == pytest.approx(np.sqrt(18 / 10))
    assert np.isnan(Tally().mpjpe) and np.isnan(Tally().rmsjpe)


def test_a_tracked_clip(waving_clip: Clip, small_network) -> None:
    done = track_clip(replace(waving_clip, pose=waving_clip.pose[:12]), small_network, IkTrackerSettings())
    seen = done.observation.has_position
    for method in ("network", *KNOWN):
        np.testing.assert_array_equal(done.position[method][seen], done.observation.position[seen])
    np.testing.assert_allclose(done.position["bodysense"], forward_kinematics(done.pose)[0])


def test_a_tally_knows_whose_errors_it_counts() -> None:
    whole, one, rng = Tally(), Tally(), np.random.default_rng(0)
    for person, level in (("a", 1.0), ("b", 2.0), ("c", 3.0)):
        for part in (whole, one):
            part.add(rng.normal(level, 0.1, 50), person)
    one.merge(whole)
    assert one.count == 300 and set(one.people) == {"a", "b", "c"}
    assert sum(tally.total for tally in one.people.values()) == pytest.approx(one.total)
    for measure in ("mpjpe", "rmsjpe"):
        found = one.interval(measure)
        assert found.value == pytest.approx(getattr(one, measure))
        assert 1.0 < found.low < found.value < found.high < 3.1
    whole.people.clear()
    assert np.isnan(whole.interval().low)
