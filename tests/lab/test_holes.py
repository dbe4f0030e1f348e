"""The table of filled holes: its gaps, methods and names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.geometry.rotation import quaternion_exp
from bodysense.io.clip import Clip
from bodysense.io.holes import missing_items
from bodysense.sources.partial_motion import open_partial
from bodysense.takes.track import track
from bodysense_lab.completion.score import holes
from bodysense_lab.core.tallies import Tallies


def clip_of(seconds: float) -> Clip:
    clip = packaged_performance()
    return replace(clip, name="a", pose=clip.pose[: int(seconds * clip.frame_rate)])


@pytest.mark.slow
def test_every_part_is_removed_from_clips_that_are_long_enough() -> None:
    seen: list[Clip] = []
    gaps = holes.score_holes([clip_of(2.6)], advance=seen.append)
    assert len(seen) == 1
    assert set(gaps) == {(p, s, m) for p in holes.PARTS for s in (0.1, 0.2, 0.5) for m in holes.METHODS}
    assert all(tally.count == 1 and 0 <= tally.mpjpe < 100 for tally in gaps.values())


def test_numbers_have_part_length_and_the_best_other_method(tmp_path: Path) -> None:
    errors = {"bodysense": 0.01, "slerp": 0.03, "cubic spline": 0.02, "inertialised": 0.025}
    errors |= {"intercorrelated": 0.035, "causal": 0.04}
    gaps = Tallies()
    for part in holes.PARTS:
        for method, error in errors.items():
            for person in ("one", "other"):
                gaps.add((part, 0.5, method), np.array(100 * error), person)
    report = holes.holes_report(gaps, "made up")
    assert [row[:3] for row in report.rows] == [(part.replace("_", " "), "0.5 s", 2) for part in holes.PARTS]
    assert report.numbers["upper_body_0.5_cm"] == pytest.approx(1.0)
    assert report.numbers["upper_body_0.5_best_other_cm"] == pytest.approx(2.0)
    assert report.rows[0][-1] == "-1.00 to -1.00"


@pytest.mark.parametrize(("fill", "power"), [(holes.slerped, 1), (holes.inertialised, 1), (holes.splined, 3)])
def test_interpolations_are_exact_for_the_motion_that_they_assume(fill, power: int) -> None:
    """Slerp is exact for a constant angular speed about one axis, the spline for an angle that is a cubic of time."""
    time = np.linspace(-1, 1, 30)
    rotation = np.asarray(quaternion_exp(np.stack([time**power, 0 * time, 0 * time], axis=1)))
    filled = fill(rotation[:, None], 10, 20)[:, 0]
    np.testing.assert_allclose(np.abs((filled * rotation[10:20]).sum(axis=1)), 1, atol=1e-12)


def test_inertialisation_keeps_the_speeds_at_both_sides() -> None:
    time = np.linspace(-1, 1, 240)
    rotation = np.asarray(quaternion_exp(np.stack([time**2, 0 * time, 0 * time], axis=1)))[:, None]
    filled = np.concatenate([rotation[:60], holes.inertialised(rotation, 60, 200), rotation[200:]])
    speed = 2 * np.arccos(np.minimum(1, np.abs((filled[1:] * filled[:-1]).sum(axis=-1))))[:, 0]
    assert abs(speed[59] - speed[58]) < 0.05 * speed[58] and abs(speed[199] - speed[200]) < 0.05 * speed[200]


def test_the_intercorrelation_predicts_joints_from_others() -> None:
    """If both arms swing alike, the known arm gives elbow and wrist of the other in a gap."""
    clip = clip_of(8.0)
    skeleton, time = clip.pose.skeleton, np.arange(len(clip)) / clip.frame_rate
    swing = np.asarray(
        quaternion_exp(np.stack([0 * time, 0.5 * np.sin(3 * time) * np.sin(5 * time), 0 * time], axis=1))
    )
    rotation = np.zeros_like(clip.pose.rotation)
    rotation[..., 0] = 1
    rotation[:, skeleton.indices(["left_shoulder", "right_shoulder"])] = swing[:, None]
    pose = replace(clip.pose, rotation=rotation)
    position = np.asarray(forward_kinematics(pose)[0])
    carrier, gone = skeleton.index("left_collar"), skeleton.indices(["left_elbow", "left_wrist"])
    found = holes.intercorrelated(pose, carrier, gone.tolist(), 100, 160)
    straight = np.linspace(0, 1, 62)[1:-1, None, None]
    line = (1 - straight) * position[99, gone] + straight * position[160, gone]
    off, of_line = (np.linalg.norm(one - position[100:160, gone], axis=-1).mean() for one in (found[:, gone], line))
    assert off < 0.2 * of_line and of_line > 0.05
    others = np.setdiff1d(np.arange(len(skeleton.points)), gone)
    np.testing.assert_array_equal(found[:, others], position[100:160, others])


def test_the_forward_pass_of_a_take_equals_live_tracking_within_a_gap() -> None:
    clip, span = clip_of(3.0), slice(30, 60)
    partial = open_partial(clip, missing_items("left_shoulder+:30-59"))
    live = track(clip, missing="left_shoulder+:30-59", causal=True).estimate.pose.rotation
    assert partial.missing[span].any()
    np.testing.assert_allclose(
        holes.fill_by_all_methods(partial)["causal"][partial.missing], live[partial.missing], atol=1e-6
    )


def test_the_table_fills_gaps_as_the_command_does() -> None:
    clip = clip_of(3.0)
    partial = open_partial(clip, missing_items("left_hip+:30-59"))
    filled = track(clip, missing="left_hip+:30-59").clip.pose.rotation
    np.testing.assert_allclose(holes.fill_by_all_methods(partial)["bodysense"], filled, atol=1e-9)
