"""A network at run time: any input rate, measured points untouched, and files that are not ours refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.observing.observation import Observation
from bodysense_lab.papers.ik.target_ik import MEASURED_ERROR
from bodysense_lab.papers.unoc.learned import Learned, LearnedState, load_model

SKELETON = default_skeleton()


@pytest.fixture(scope="module")
def learned(small_network: Path) -> Learned:
    return Learned(load_model(small_network), SKELETON)


def at_times(clip: Clip, time: np.ndarray) -> Observation:
    """Observe a clip's frames, repeated, at the given times by a simulated headset."""
    return observe(clip.pose[np.arange(len(time)) % len(clip)], time, HEADSET_CAMERA)


def steps(learned: Learned, observation: Observation) -> tuple[np.ndarray, list[float]]:
    """Positions, frame by frame, and the times at which the network advanced."""
    state, positions, advanced = learned.start(), [], []
    for t in range(len(observation)):
        before = state
        estimate, state = learned.step(observation[t : t + 1], state)
        positions.append(estimate.position[0])
        if state.time != before.time:
            assert state.time == observation.time[t]
            advanced.append(state.time)
        else:
            assert all(state.network[name] is before.network[name] for name in state.network)
    return np.stack(positions), advanced


def test_measured_points_pass_through_unchanged(learned: Learned, waving_clip: Clip) -> None:
    observation = observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)
    estimate, _ = learned.step(observation, learned.start())
    seen = observation.has_position
    assert seen.any() and not seen.all()
    np.testing.assert_array_equal(estimate.position[seen], observation.position[seen])
    assert (estimate.confidence[seen] == MEASURED_ERROR).all() and (estimate.confidence[~seen] > 0).all()
    assert np.isfinite(estimate.position).all()
    assert ((estimate.occluded >= 0) & (estimate.occluded <= 1)).all()


def test_frames_are_calls(learned: Learned, waving_clip: Clip) -> None:
    observation = at_times(resample(waving_clip, 90.0), np.arange(60) / 90)
    whole, end = learned.step(observation, learned.start())
    rows, _ = steps(learned, observation)
    np.testing.assert_array_equal(whole.position, rows)
    assert isinstance(end, LearnedState) and end.time is not None


@settings(max_examples=12)
@given(st.lists(st.floats(0.004, 0.2), min_size=2, max_size=60))
def test_irregular_times_and_dropped_frames(learned: Learned, waving_clip: Clip, gaps: list[float]) -> None:
    observation = at_times(waving_clip, np.cumsum(gaps))
    positions, advanced = steps(learned, observation)
    assert np.isfinite(positions).all()
    expected, last = [], -1.0
    for time in observation.time:
        if last < 0 or time - last >= 0.8 / 30:
            expected.append(time)
            last = time
    assert advanced == expected


def test_frames_between_steps_do_not_change_what_comes_after(learned: Learned, waving_clip: Clip) -> None:
    """At 120 Hz every fourth answer is that of 30 Hz."""
    fast = resample(waving_clip, 120.0)
    observation = observe(fast.pose, fast.time, HEADSET_CAMERA)
    every = np.arange(0, len(fast), 4)
    slow = observe(fast.pose[every], fast.time[every], HEADSET_CAMERA)
    often, _ = steps(learned, observation)
    seldom, _ = steps(learned, slow)
    np.testing.assert_allclose(often[every], seldom, atol=1e-6)
    between = np.setdiff1d(np.arange(len(fast)), every)
    hidden = ~observation.has_position[between]
    assert np.abs(np.diff(often, axis=0)).max(axis=(1, 2)).min() > 0, "in between the answer moves on"
    assert hidden.any()


def test_before_the_first_signal_the_body_stands(learned: Learned) -> None:
    state = learned.start()
    standing, _ = forward_kinematics(standing_pose(SKELETON))
    np.testing.assert_allclose(state.head_position, standing[SKELETON.index("head")])
    nothing = np.zeros((1, 1), dtype=bool)
    empty = Observation(
        points=("head",),
        position=np.full((1, 1, 3), np.nan),
        rotation=np.full((1, 1, 4), np.nan),
        has_position=nothing,
        has_rotation=nothing,
        accuracy=np.ones((1, 1)),
        time=np.zeros(1),
    )
    estimate, _ = learned.step(empty, state)
    assert np.isfinite(estimate.position).all()
    np.testing.assert_allclose(estimate.position[0, SKELETON.index("head")], state.head_position, atol=1e-6)


def test_a_head_that_is_lost_stays(learned: Learned, waving_clip: Clip) -> None:
    observation = observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)[:4]
    head = SKELETON.index("head")
    for field in ("position", "rotation"):
        getattr(observation, field)[2:, head] = np.nan
        getattr(observation, f"has_{field}")[2:, head] = False
    estimate, state = learned.step(observation, learned.start())
    np.testing.assert_allclose(estimate.position[2:, head], [observation.position[1, head]] * 2, atol=1e-6)
    np.testing.assert_array_equal(state.head_rotation, observation.rotation[1, head])


def test_a_body_of_another_size(small_network: Path, waving_clip: Clip) -> None:
    """A body half as tall again in such a world: the same answer, half as large again."""
    model, observation = load_model(small_network), observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)
    answers = []
    for size in (1.0, 1.5):
        learned = Learned(model, SKELETON.scaled(1.1 * size))
        scaled = replace(observation, position=observation.position * size)
        answers.append(learned.step(scaled, learned.start())[0].position / size)
    np.testing.assert_allclose(answers[0], answers[1], atol=1e-4)


# --- files that are not ours


def test_other_files_than_onnx_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        BodysenseError, match=r"missing\.onnx: no such model file; give the \.onnx that `bodysense train body-gru`"
    ):
        load_model(tmp_path / "missing.onnx")
    for content in (b"", b"hello", bytes(range(256))):
        (tmp_path / "a.onnx").write_bytes(content)
        with pytest.raises(BodysenseError, match=r"a\.onnx: not a") as raised:
            load_model(tmp_path / "a.onnx")
        assert "\n" not in str(raised.value)


def foreign(path: Path, fields: dict[str, str]) -> Path:
    """A whole ONNX model of another project."""
    value = [onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1]) for name in ("x", "y")]
    graph = onnx.helper.make_graph([onnx.helper.make_node("Identity", ["x"], ["y"])], "g", value[:1], value[1:])
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=9)
    onnx.helper.set_model_props(model, fields)
    onnx.save(model, str(path))
    return path


def test_a_foreign_network_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        BodysenseError, match=r"a\.onnx: not a bodysense body network \(format 'not given', wanted 'body"
    ):
        load_model(foreign(tmp_path / "a.onnx", {}))
    with pytest.raises(
        BodysenseError, match=r"\(format 'bodysense body 9', wanted 'bodysense body 1'\); give the \.onnx"
    ):
        load_model(foreign(tmp_path / "a.onnx", {"format": "bodysense body 9"}))


def test_a_network_without_its_card_is_refused(tmp_path: Path) -> None:
    fields = {"format": "bodysense body 1", "points": "[]", "rate": "30.0", "fastest_rate": "60.0"}
    with pytest.raises(BodysenseError, match=r"a\.onnx: its card has no 'state'; export the network again"):
        load_model(foreign(tmp_path / "a.onnx", fields))


def test_a_skeleton_with_other_points_is_refused(small_network: Path) -> None:
    model = load_model(small_network)
    other = Skeleton(("head", "tail"), (), (-1, 0), np.zeros((2, 3)))
    with pytest.raises(
        BodysenseError, match=r"small\.onnx completes a skeleton of 65 points; .* has 2 \(differs in .*\)"
    ):
        Learned(model, other)
    joints = (SKELETON.joints[0], SKELETON.joints[2], SKELETON.joints[1], *SKELETON.joints[3:])
    swapped = Skeleton(joints, SKELETON.end_sites, SKELETON.parents, SKELETON.rest_offset)
    with pytest.raises(BodysenseError, match=r"has 65 \(differs in their order\): bring the motion to the default"):
        Learned(model, swapped)
