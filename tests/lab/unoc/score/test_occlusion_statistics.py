"""Table 1: what is counted, how it adds up, how it is printed; rates on real motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import Pose, rest_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.headset_camera import HeadsetCamera, Visibility, see
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp
from bodysense.io.datasets.sources import list_sources, read_source
from bodysense_lab.papers.unoc.score import occlusion as statistics
from bodysense_lab.papers.unoc.score.occlusion import GROUPS, PUBLISHED, column, count, group_points


def waving(frames: int, seed: int = 0) -> Pose:
    generator = np.random.default_rng(seed)
    pose = rest_pose(default_skeleton(), (frames,))
    steps = generator.normal(size=(frames, 52, 3)) * 0.05
    return Pose(pose.skeleton, pose.root_position, quaternion_exp(np.cumsum(steps, axis=0)))


def test_spans_of_hiding(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hidden for 3 frames, then 1, then 2 up to the end, on one knee; the other knee always: 4 spans, 14 frames."""
    skeleton = default_skeleton()
    reason = np.zeros((8, len(skeleton.points)), dtype=np.uint8)
    reason[[0, 1, 2, 4, 6, 7], skeleton.index("left_knee")] = 3
    reason[:, skeleton.index("right_knee")] = 1
    monkeypatch.setattr(statistics, "see", lambda *_: Visibility(skeleton, reason))
    counts = count(rest_pose(skeleton, (8,)), frame_rate=2.0)
    knee = GROUPS.index("knee")
    assert counts.hidden[knee] == pytest.approx(7.0)
    assert counts.spans[knee] == 4
    assert counts.seconds == 4.0
    figures = column("x", [counts]).figures
    assert figures["knee_hidden"] == pytest.approx(14 / 16)
    assert figures["knee_seconds"] == pytest.approx(7 / 4)
    assert figures["elbow_hidden"] == 0
    assert "elbow_seconds" not in figures
    assert figures["body_hidden"] == pytest.approx(14 / (8 * 14))


def test_counts_agree_with_what_the_camera_sees() -> None:
    pose = waving(200)
    visible = see(pose).visible
    found = column("one", [count(pose, 30.0)])
    for name, points in group_points(pose.skeleton).items():
        assert found.figures[f"{name}_hidden"] == pytest.approx(1 - visible[:, points].mean())
    other = column("two", [count(pose, 30.0, HeadsetCamera(field_of_view=120))])
    assert (other.figures["all_hidden"]) > (found.figures["all_hidden"])


def test_recordings_add_up_by_time() -> None:
    """Twice the frames at twice the rate weigh the same."""
    slow, fast = waving(60, seed=1), waving(240, seed=2)
    parts = [count(slow, 30.0), count(fast, 120.0)]
    alone = [column("", [part]) for part in parts]
    both = column("both", parts)
    assert both.frames == 300
    assert both.frame_rates == (30.0, 120.0)
    for name in GROUPS:
        assert both.figures[f"{name}_hidden"] == pytest.approx(sum(one.figures[f"{name}_hidden"] for one in alone) / 2)
    assert both.figures["hand_contact"] == pytest.approx(sum(one.figures["hand_contact"] for one in alone) / 2)


def test_the_published_table() -> None:
    unoc, talking, mixamo = PUBLISHED
    assert (unoc.figures["hip_hidden"], unoc.figures["hip_seconds"]) == (0.53, 7.28)
    assert (talking.figures["shoulder_hidden"], talking.figures["hand_contact"]) == (0.03, 0.039)
    assert (mixamo.frames, mixamo.frame_rates) == (261_000, (30.0,)) and "hand_hidden" not in mixamo.figures
    # The paper's rows body and all are what these points, counted equally, make of its other rows.
    size = {name: len(points) for name, points in group_points(default_skeleton()).items()}
    for data, rounding in ((unoc, 0.01), (talking, 0.025)):
        for whole, parts in (("body", ("shoulder", "elbow", "hip", "knee", "foot")), ("all", ("body", "hand"))):
            mean = sum(data.figures[f"{name}_hidden"] * size[name] for name in parts) / size[whole]
            assert data.figures[f"{whole}_hidden"] == pytest.approx(mean, abs=rounding)


def test_errors_say_what_to_do() -> None:
    with pytest.raises(BodysenseError, match="frame_rate 0 must be above 0 frames a second"):
        count(waving(3), 0.0)
    for nothing in ([], [count(waving(0), 30.0)]):
        with pytest.raises(BodysenseError, match="CMU: there are no frames to count; give at least one recording"):
            column("CMU", nothing)


def test_conversation_hides_about_as_much_as_published(motion_data: Path) -> None:
    """Hands, hips, knees and feet lie between the paper's data sets, within 0.1.

    Shoulders and the elbows of hanging arms do not: an upright wearer has them at or beyond the edge of the cone.
    """
    sources = [
        source
        for source in list_sources(motion_data)
        if source.category == "talk_gesture" and source.path.name.startswith("m_")
    ]
    clips = [read_source(source) for source in sources[::8]]
    figures = column("conversation", [count(clip.pose, clip.frame_rate) for clip in clips]).figures
    for name in ("hand", "hip", "knee", "foot"):
        key = f"{name}_hidden"
        known = [data.figures[key] for data in PUBLISHED if key in data.figures]
        assert min(known) - 0.1 < figures[key] < max(known) + 0.1, name
