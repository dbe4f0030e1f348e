"""Scores: averages over frames, fingers measured from their wrist, groups of categories."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.io.clip import Clip
from bodysense.takes.last_known import KNOWN
from bodysense_lab.core.scoring import Tally, group_of, part_errors
from bodysense_lab.papers.unoc.ik_tracker import IkTrackerSettings
from bodysense_lab.papers.unoc.learned import track_clip

SKELETON = default_skeleton()


@pytest.fixture(scope="module")
def truth(waving_clip: Clip) -> np.ndarray:
    return np.asarray(forward_kinematics(waving_clip.pose)[0])


def mean_errors(position: np.ndarray, truth: np.ndarray, fingers: bool = True) -> dict[str, float]:
    """Return the mean error of each part, cm."""
    return {name: values.mean() for name, (values, _) in part_errors(position, truth, SKELETON, fingers).items()}


def test_fingers_are_measured_from_their_wrist(truth: np.ndarray) -> None:
    """An error of the whole hand does not change the error of its fingers."""
    found = mean_errors(truth + np.array([0.02, 0.0, 0.0]), truth)
    wanted = {"body": 2.0, "every_point": 2.0, "finger": 0.0, "body_and_finger": 2.0}
    assert found == pytest.approx(wanted, abs=1e-6)


def test_each_part_counts_its_own_joints(truth: np.ndarray) -> None:
    """The part 'body' counts knees but not the spine; no part counts the head, which is measured."""

    def parts(point: str) -> set[str]:
        wrong = truth.copy()
        wrong[:, SKELETON.index(point)] += 0.1
        return {part for part, error in mean_errors(wrong, truth).items() if error > 1e-6} - {"body_and_finger"}

    assert parts("left_knee") == {"body", "every_point"}
    assert parts("spine2") == {"every_point"}
    assert parts("left_index2") == {"finger"}
    assert parts("head") == set()


def test_clips_without_fingers_have_no_finger_errors(truth: np.ndarray) -> None:
    assert mean_errors(truth, truth, fingers=False).keys() == {"body", "every_point"}


@pytest.mark.parametrize(
    ("category", "group"),
    [("", "main"), ("sit", "main"), ("sport", "sport"), ("dance", "dance"), ("juggling", "other")],
)
def test_categories_belong_to_groups(waving_clip: Clip, category: str, group: str) -> None:
    assert group_of(replace(waving_clip, category=category)) == group


def test_averages_are_over_frames() -> None:
    long, short = Tally(), Tally()
    long.add(np.full((9, 1), 1.0))
    short.add(np.full((1, 1), 3.0))
    long.merge(short)
    assert long.mpjpe == pytest.approx(1.2)
    assert long.rmsjpe == pytest.approx(np.sqrt(18 / 10))
    assert np.isnan(Tally().mpjpe) and np.isnan(Tally().rmsjpe)


def test_a_tracked_clip_has_the_positions_of_each_method(waving_clip: Clip, small_network) -> None:
    done = track_clip(replace(waving_clip, pose=waving_clip.pose[:12]), small_network, IkTrackerSettings())
    seen = done.observation.has_position
    for method in ("network", *KNOWN):
        np.testing.assert_array_equal(done.position[method][seen], done.observation.position[seen])
    skeleton, tracked = done.clip.pose.skeleton, done.position["bodysense"]
    bones = tracked[:, 1:] - tracked[:, skeleton.parents[1:]]
    np.testing.assert_allclose(np.linalg.norm(bones, axis=-1), np.tile(skeleton.bone_length[1:], (len(tracked), 1)))


def test_a_tally_has_the_errors_of_each_person() -> None:
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
