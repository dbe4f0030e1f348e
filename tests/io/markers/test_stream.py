"""A layout that is learned from some frames converts every frame alone, as a whole take is converted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from virtual_markers import LEGS, PLUG_IN_GAIT, SETS, raw_of

from bodysense.body.pose import forward_kinematics
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.markers.raw_markers import MarkerFormat, RawMarkers
from bodysense.io.markers.recording import recording_of
from bodysense.io.markers.stream import StreamLayout, learn_layout

Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # our axes, rows, in those of most laboratories


def in_laboratory(raw: RawMarkers) -> RawMarkers:
    """Return markers in millimetres, +Z up, 3 m from the origin, some hidden at times."""
    position = (raw.position @ Z_UP + [3.0, -2.0, 0.4]) * 1000
    position[np.random.default_rng(3).random(position.shape[:2]) < 0.1] = np.nan
    return replace(raw, position=position, unit="mm", axes=Z_UP)


def one_by_one(layout: StreamLayout, raw: RawMarkers) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and rotations of all frames, converted one at a time."""
    columns = layout.columns_in(raw.names)
    frames = [
        layout.observe(
            columns,
            raw.position[k : k + 1],
            None if raw.rotation is None else raw.rotation[k : k + 1],
            raw.time[k : k + 1],
        )
        for k in range(len(raw.time))
    ]
    return tuple(np.concatenate([getattr(one, name) for one in frames]) for name in ("position", "rotation"))  # type: ignore[return-value]


@pytest.mark.parametrize("name", [*SETS, "legs"])
def test_frames_alone_equal_the_take(unseen_body: Clip, name: str) -> None:
    raw = in_laboratory(raw_of(unseen_body, LEGS if name == "legs" else SETS[name]))
    take = recording_of(raw, MarkerFormat(), "take").observation
    layout = learn_layout(raw, MarkerFormat(), "stream")
    position, rotation = one_by_one(layout, raw)
    np.testing.assert_allclose(position, take.position, atol=1e-9)
    np.testing.assert_allclose(rotation, take.rotation, atol=1e-7)


def test_the_first_second_is_enough(unseen_body: Clip) -> None:
    """Joints of a layout from the first frames are those of the whole take, within what its mean lengths change."""
    raw = in_laboratory(raw_of(unseen_body, PLUG_IN_GAIT))
    first = replace(raw, position=raw.position[:10], time=raw.time[:10])
    layout = learn_layout(first, MarkerFormat(), "stream")
    position, _ = one_by_one(layout, raw)
    truth = np.asarray(forward_kinematics(unseen_body.pose)[0])
    assert layout.body is not None
    joints = [name for name in layout.body.accuracy if name.endswith(("hip", "knee", "ankle", "shoulder"))]
    points = layout.observe(layout.columns_in(raw.names), raw.position[:1], None, raw.time[:1]).points
    found = position[:, [points.index(name) for name in joints]]
    apart = found - truth[:, unseen_body.pose.skeleton.indices(joints)]
    moved = np.nanmean(apart, axis=(0, 1))  # the laboratory's origin is elsewhere
    assert len(joints) == 8
    assert np.nanmean(np.linalg.norm(apart - moved * [1, 0, 1], axis=-1)) < 0.02


def test_frames_may_have_other_markers(unseen_body: Clip) -> None:
    """Markers are found by name; those that a frame lacks are hidden."""
    raw = raw_of(unseen_body, PLUG_IN_GAIT)
    layout = learn_layout(raw, MarkerFormat(), "stream")
    whole, _ = one_by_one(layout, raw)
    keep = [k for k, name in reversed(list(enumerate(raw.names))) if name != "LANK"]
    other = replace(raw, names=tuple(raw.names[k] for k in keep), position=raw.position[:, keep])
    fewer, _ = one_by_one(layout, other)
    points = layout.observe(layout.columns_in(raw.names), raw.position[:1], None, raw.time[:1]).points
    for name in ("right_ankle", "left_hip", "head"):
        np.testing.assert_allclose(fewer[:, points.index(name)], whole[:, points.index(name)], atol=1e-12)
    assert np.isnan(fewer[:, points.index("left_ankle")]).all()


def test_rigid_bodies_named_as_joints_count_without_a_set(unseen_body: Clip) -> None:
    place, turn = (np.asarray(values) for values in forward_kinematics(unseen_body.pose))
    names = {"Head": "head", "LeftHand": "left_wrist", "RightHand": "right_wrist"}
    columns = unseen_body.pose.skeleton.indices(tuple(names.values()))
    raw = RawMarkers(tuple(names), place[:, columns], unseen_body.time, 10.0, rotation=turn[:, columns])
    layout = learn_layout(raw, MarkerFormat(), "stream")
    position, _ = one_by_one(layout, raw)
    points = layout.observe(layout.columns_in(raw.names), raw.position[:1], raw.rotation[:1], raw.time[:1]).points  # type: ignore[index]
    assert set(points) == set(names.values())
    for theirs, ours in names.items():
        np.testing.assert_allclose(position[:, points.index(ours)], raw.position[:, raw.names.index(theirs)])


def test_a_stream_without_a_person_is_refused() -> None:
    raw = RawMarkers(("M1", "M2"), np.zeros((5, 2, 3)), np.arange(5) / 100, 100.0)
    with pytest.raises(BodysenseError, match="--names"):
        learn_layout(raw, MarkerFormat(), "stream")
