"""HMD-VAE at run time: streaming is batching, any rate, the measured head, several bodies, never a NaN."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.body.body_joints import body_skeleton
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import THREE_POINT, THREE_POINTS
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.observing.observation import Observation
from bodysense_lab.papers.hmd_vae.body_vae import (
    BodyVaeEstimator,
    BodyVaeModel,
    load_body_vae,
    sample_noise,
    sample_prior,
)

SKELETON = default_skeleton()


@pytest.fixture(scope="module")
def model(small_vae: Path) -> BodyVaeModel:
    return load_body_vae(small_vae)


@pytest.fixture(scope="module")
def signal(waving_clip: Clip) -> Observation:
    return observe(waving_clip.pose, waving_clip.time, THREE_POINT)


def run(estimator: BodyVaeEstimator, observation: Observation, sizes: list[int] | None = None) -> PointEstimate:
    """Estimate the whole observation in pieces of some frames."""
    state, parts, first = estimator.start(), [], 0
    for size in sizes or [len(observation)]:
        estimate, state = estimator.step(observation[first : first + size], state)
        parts.append(estimate)
        first += size
    return replace(parts[0], **{n: np.concatenate([getattr(p, n) for p in parts]) for n in ("position", "confidence")})


@settings(max_examples=3)
@given(cut=st.lists(st.integers(1, 23), min_size=1, max_size=5, unique=True))
def test_pieces_are_the_whole(model: BodyVaeModel, signal: Observation, cut: list[int]) -> None:
    sizes = np.diff([0, *sorted(cut), 24]).tolist()
    whole, pieces = (run(BodyVaeEstimator(SKELETON, model), signal[:24], given) for given in (None, sizes))
    np.testing.assert_array_equal(whole.position, pieces.position)
    np.testing.assert_array_equal(whole.confidence, pieces.confidence)


def test_at_its_own_rate_it_reads_the_frames(model: BodyVaeModel, signal: Observation) -> None:
    estimate = run(BodyVaeEstimator(SKELETON, model), signal)
    window = slice(60 + 1 - model.frames, 61)
    offset = body_skeleton(SKELETON).rest_offset
    root, _ = model.body(signal.position[window], signal.rotation[window], 1.0, np.zeros(model.latent), offset)
    np.testing.assert_allclose(estimate.position[60, SKELETON.index("pelvis")], root, atol=1e-5)


@pytest.mark.parametrize("rate", [72.0])
def test_any_rate_gives_the_same_body(model: BodyVaeModel, waving_clip: Clip, rate: float) -> None:
    fast = resample(waving_clip, rate)
    slow = run(BodyVaeEstimator(SKELETON, model), observe(waving_clip.pose, waving_clip.time, THREE_POINT)).position
    quick = run(BodyVaeEstimator(SKELETON, model), observe(fast.pose, fast.time, THREE_POINT)).position
    together = np.arange(0, 90, 5)  # at these both have a frame
    np.testing.assert_allclose(quick[np.round(together * rate / 30).astype(int)], slow[together], atol=1e-3)


def test_head_and_hands_are_as_measured(model: BodyVaeModel, signal: Observation) -> None:
    estimate = run(BodyVaeEstimator(SKELETON, model), signal)
    places = SKELETON.indices(THREE_POINTS)
    np.testing.assert_array_equal(estimate.position[:, places], signal.position)
    pose = BodyVaeEstimator(SKELETON, model).step(signal, BodyVaeEstimator(SKELETON, model).start())[0].pose
    assert pose is not None
    position, rotation = forward_kinematics(pose)
    np.testing.assert_allclose(position[:, places[0]], signal.position[:, 0], atol=1e-5)
    assert geodesic_angle(rotation[:, places], signal.rotation).max() < 1e-5


@settings(max_examples=8)
@given(seed=st.integers(0, 9999))
def test_garbage_gives_numbers(model: BodyVaeModel, signal: Observation, seed: int) -> None:
    rng = np.random.default_rng(seed)
    some = signal[:12]
    position, rotation = some.position.copy(), some.rotation.copy()
    position[rng.random(position.shape) < 0.1] = np.nan
    position[rng.random(position.shape[:-1]) < 0.05] = np.inf
    position[rng.random(position.shape[:-1]) < 0.05] = 1e39
    rotation[rng.random(rotation.shape[:-1]) < 0.1] = 0
    rotation[rng.random(rotation.shape[:-1]) < 0.1] = 1e200
    masks = {name: rng.random(position.shape[:-1]) < rng.random() for name in ("has_position", "has_rotation")}
    time = np.cumsum(rng.choice([0.001, 0.02, 0.4, 3.0], len(some)))
    broken = replace(some, position=position, rotation=rotation, time=time, **masks)
    estimate = run(BodyVaeEstimator(SKELETON, model), broken)
    assert np.isfinite(estimate.position).all() and np.isfinite(estimate.confidence).all()
    length = np.linalg.norm(estimate.position - estimate.position[:, [0]], axis=-1)
    assert length.max() < 20  # a measured hand may be anywhere in the clip, but no joint flies away


def test_a_hand_that_is_lost_stays_by_the_head(model: BodyVaeModel, signal: Observation) -> None:
    lost = signal.has_position.copy()
    lost[30:, 1] = False
    there = BodyVaeEstimator(SKELETON, model).step(
        replace(signal, has_position=lost), BodyVaeEstimator(SKELETON, model).start()
    )[1]
    before = BodyVaeEstimator(SKELETON, model).step(signal[:30], BodyVaeEstimator(SKELETON, model).start())[1]
    np.testing.assert_allclose(there.last.wrist_offset[0], before.last.wrist_offset[0])
    assert not np.allclose(there.last.wrist_offset[1], before.last.wrist_offset[1])


def test_a_gap_resets_the_state(model: BodyVaeModel, signal: Observation) -> None:
    time = signal.time.copy()
    time[40:] += 3.0
    late = run(BodyVaeEstimator(SKELETON, model), replace(signal, time=time)).position[40:]
    np.testing.assert_allclose(late, run(BodyVaeEstimator(SKELETON, model), signal[40:]).position, atol=1e-9)


def test_time_goes_forward(model: BodyVaeModel, signal: Observation) -> None:
    with pytest.raises(BodysenseError, match="a frame at 0 s came after one at 0 s; give frames in order of time"):
        run(BodyVaeEstimator(SKELETON, model), replace(signal, time=np.zeros(len(signal))))


def test_samples_differ_and_are_drawn_again(model: BodyVaeModel, signal: Observation) -> None:
    noises = sample_noise(model, 2, np.random.default_rng(7))
    np.testing.assert_array_equal(noises, sample_noise(model, 2, np.random.default_rng(7)))
    one = [run(BodyVaeEstimator(SKELETON, model, noise), signal[:5]) for noise in noises]
    knee = SKELETON.index("left_knee")
    assert np.linalg.norm(one[0].position[:, knee] - one[1].position[:, knee], axis=-1).min() > 1e-4
    still = replace(signal[:5], position=np.tile(signal.position[:1], (5, 1, 1)))
    still = replace(still, rotation=np.tile(signal.rotation[:1], (5, 1, 1)))
    body = run(BodyVaeEstimator(SKELETON, model, noises[0]), still).position
    np.testing.assert_allclose(body, np.tile(body[:1], (5, 1, 1)), atol=1e-6)  # no jitter


@pytest.mark.parametrize("height", [1.5, 1.9])
def test_the_prior_stands_on_the_floor(model: BodyVaeModel, height: float) -> None:
    skeleton = SKELETON.scaled(height)
    pose = sample_prior(skeleton, model, 4, np.random.default_rng(3))
    position, _ = forward_kinematics(pose)
    assert position.shape == (4, len(skeleton.points), 3)
    np.testing.assert_allclose(position[..., 1].min(axis=-1), 0, atol=1e-9)
    assert len(np.unique(pose.rotation[:, skeleton.index("left_knee")].round(6), axis=0)) == 4
    bone = np.linalg.norm(position[:, 1:] - position[:, list(skeleton.parents[1:])], axis=-1)
    np.testing.assert_allclose(bone, np.broadcast_to(skeleton.bone_length[1:], bone.shape), atol=1e-9)


def test_confidence_is_the_cards_and_bad_input_is_refused(model: BodyVaeModel, signal: Observation) -> None:
    estimate = run(BodyVaeEstimator(SKELETON, model), signal)
    card = dict(zip(BODY, model.card["expected_error"], strict=True))
    knee, wrist, finger = SKELETON.indices(["left_knee", "left_wrist", "left_index3"])
    assert estimate.confidence[3, knee] == card["left_knee"]
    assert estimate.confidence[3, wrist] < estimate.confidence[3, knee] < estimate.confidence[3, finger]
    with pytest.raises(BodysenseError, match=r"model0\.onnx: a model 0 reads the whole body, not a device"):
        network = replace(model, card={**model.card, "reads": list(BODY)}, source=Path("model0.onnx"))
        BodyVaeEstimator(SKELETON, network)
    with pytest.raises(BodysenseError, match=r"noise has shape \(9,\); model2\.onnx needs \(4,\)"):
        BodyVaeEstimator(SKELETON, model, np.zeros(9))
    with pytest.raises(BodysenseError, match="0 samples; give at least 1"):
        sample_noise(model, 0, np.random.default_rng(0))


def test_other_files_are_refused(small_network: Path, tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match="not a bodysense body VAE"):
        load_body_vae(small_network)
    with pytest.raises(
        BodysenseError, match=r"no such model file; give the \.onnx that `bodysense train hmd-vae` wrote"
    ):
        load_body_vae(tmp_path / "gone.onnx")
