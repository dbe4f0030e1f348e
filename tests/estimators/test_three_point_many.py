"""Many wearers at once: each gets what they get alone, whoever else is there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.data.clip import Clip
from bodysense.errors import BodysenseError
from bodysense.estimators.estimate import PointEstimate
from bodysense.estimators.three_point import ThreePoint
from bodysense.estimators.three_point_answers import load_three_point
from bodysense.estimators.three_point_many import step_together
from bodysense.estimators.three_point_state import ThreePointSettings
from bodysense.observation import Observation
from bodysense.occlusion.dropout import hide
from bodysense.occlusion.three_point import HEAD_ONLY, observe

SKELETON = default_skeleton()


def check_same(one: PointEstimate, other: PointEstimate) -> None:
    assert one.pose is not None and other.pose is not None
    for a, b in (
        (one.position, other.position),
        (one.confidence, other.confidence),
        (one.occluded, other.occluded),
        (one.pose.rotation, other.pose.rotation),
        (one.pose.root_position, other.pose.root_position),
    ):
        np.testing.assert_allclose(a, b, atol=1e-6)


def signals(clip: Clip, wearers: int) -> list[Observation]:
    """Of the same motion: later and later parts, rates and clocks of their own, points lost at random, gaps."""
    random, found = np.random.default_rng(1), []
    for k in range(wearers):
        seen = observe(clip.pose, clip.time) if k % 4 else observe(clip.pose, clip.time, HEAD_ONLY)
        rate = (30, 60, 72, 90)[k % 4]
        time = 10.0 * k + np.arange(len(seen)) / rate
        time[50:] += 0.0 if k % 3 else 1.5  # more than a second without a frame
        lost = np.repeat(random.random((len(seen) // 10 + 1, len(seen.points))) < 0.3, 10, axis=0)[: len(seen)]
        found.append(hide(replace(seen, time=time), lost)[k:])
    return found


@pytest.fixture(scope="module")
def wearers(small_three_point: Path) -> list[ThreePoint]:
    model = load_three_point(small_three_point)
    heights = (1.5, 1.62, 1.7, 1.98)
    skeletons: list[Skeleton] = [SKELETON, SKELETON, *map(SKELETON.scaled, heights)]
    made = [ThreePoint(skeleton, model) for skeleton in skeletons]
    return [*made, ThreePoint(SKELETON, model, ThreePointSettings(feet=None))]  # a batch of its own


def test_together_is_alone(wearers: list[ThreePoint], waving_clip: Clip) -> None:
    """Frame by frame, while wearers come late, go early and miss turns."""
    seen = signals(waving_clip, len(wearers))
    alone = [one.step(observation, one.start())[0] for one, observation in zip(wearers, seen, strict=True)]
    states, place = [one.start() for one in wearers], [0] * len(wearers)
    random = np.random.default_rng(2)
    while True:
        turn = [k for k in range(len(wearers)) if place[k] < len(seen[k]) and random.random() < 0.8]
        if all(place[k] >= len(seen[k]) for k in range(len(wearers))):
            break
        jobs = [(wearers[k], seen[k][place[k] : place[k] + 1], states[k]) for k in turn]
        for k, (estimate, state) in zip(turn, step_together(jobs), strict=True):
            whole = alone[k]
            assert whole.pose is not None
            now = slice(place[k], place[k] + 1)
            one = PointEstimate(
                whole.skeleton, whole.position[now], whole.occluded[now], whole.confidence[now], whole.pose[now]
            )
            check_same(estimate, one)
            assert estimate.skeleton is wearers[k].skeleton
            states[k], place[k] = state, place[k] + 1


def test_frames_of_several_lengths(wearers: list[ThreePoint], waving_clip: Clip) -> None:
    """T may differ from wearer to wearer; no wearer at all is no error."""
    seen = [observation[: 3 + 2 * k] for k, observation in enumerate(signals(waving_clip, len(wearers)))]
    together = step_together([(one, each, one.start()) for one, each in zip(wearers, seen, strict=True)])
    for one, observation, (estimate, state) in zip(wearers, seen, together, strict=True):
        alone, after = one.step(observation, one.start())
        check_same(estimate, alone)
        assert state.time == after.time
    assert step_together([]) == []


def test_states_of_a_batch_do_not_change_later(wearers: list[ThreePoint], waving_clip: Clip) -> None:
    """A state may be gone on from twice."""
    seen = observe(waving_clip.pose, waving_clip.time)
    states = [state for _, state in step_together([(one, seen[:5], one.start()) for one in wearers])]
    jobs = [(one, seen[5:9], state) for one, state in zip(wearers, states, strict=True)]
    for (first, _), (second, _) in zip(step_together(jobs), step_together(jobs), strict=True):
        np.testing.assert_array_equal(first.position, second.position)


def test_a_file_for_one_at_a_time_is_refused_by_name(
    wearers: list[ThreePoint], waving_clip: Clip, small_three_point: Path, tmp_path: Path
) -> None:
    import onnx

    written = onnx.load(str(small_three_point))
    for value in (*written.graph.input, *written.graph.output):
        value.type.tensor_type.shape.dim[0].dim_value = 1
    onnx.save(written, str(tmp_path / "one.onnx"))
    model = load_three_point(tmp_path / "one.onnx")
    seen = observe(waving_clip.pose, waving_clip.time)[:1]
    jobs = [(one, seen, one.start()) for one in (ThreePoint(SKELETON, model), ThreePoint(SKELETON, model))]
    check_same(step_together(jobs[:1])[0][0], wearers[0].step(seen, wearers[0].start())[0])
    with pytest.raises(BodysenseError, match=r"one\.onnx answers one wearer at a time; free its batch axis"):
        step_together(jobs)
