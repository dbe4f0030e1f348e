"""Simulated capture of gloves: names, noise, spikes, losses, and lights that the hand hides only from behind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.hands.glove import MARKERS, default_glove, glove_points, hand_size, marker_positions, template
from bodysense.body.hands.hand import hand_pose, hand_skeleton, mirrored_vectors
from bodysense.body.hands.hand_capsules import hand_capsules
from bodysense.body.pose import Pose, rest_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.camera_ring import CameraRing
from bodysense.devices.simulated.glove import GloveCapture, _mounting, observe, observe_hands, visible
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp
from bodysense.io.clip import Clip
from bodysense.observing.checks import check_observation

HAND = hand_skeleton(default_skeleton(), "left")
ABOVE, BELOW = CameraRing(heights=(2.0,), radius=0.8), CameraRing(heights=(-2.0,), radius=0.8)


def flat_hand(frames: int = 2, turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Pose:
    pose = rest_pose(HAND, (frames,))
    pose.rotation[:, 0] = quaternion_exp(np.array(turn))
    return pose


def test_markers_are_exact_by_default(waving_clip: Clip) -> None:
    found = check_observation(observe(waving_clip.pose, waving_clip.time))
    assert found.points == (*glove_points("left"), *glove_points("right")) and found.has_position.all()
    for k, side in enumerate(("left", "right")):
        own = marker_positions(default_glove(), hand_pose(waving_clip.pose, side))
        np.testing.assert_array_equal(found.position[:, 9 * k : 9 * k + 9], mirrored_vectors(own, side))
    assert not found.has_rotation.any() and np.isnan(found.rotation).all()


def test_any_number_of_hands() -> None:
    hands = {"right2": flat_hand(5), "left": flat_hand(5), "left_b": flat_hand(5)}
    found = check_observation(observe_hands(hands, np.arange(5) / 60))
    assert found.points == tuple(point for name in hands for point in glove_points(name))
    np.testing.assert_allclose(found.position[:, :9], found.position[:, 9:18] * [-1, 1, 1])
    np.testing.assert_array_equal(found.position[:, 9:18], found.position[:, 18:])


def test_lights_are_on_the_skin_and_face_away_from_it() -> None:
    """Each light is just outside the capsules of the flat hand, within a finger's thickness of its marker."""
    glove = default_glove()
    offset, facing = _mounting(HAND, glove)
    rest, capsules = HAND.path @ HAND.rest_offset, hand_capsules(HAND)
    light = rest[HAND.indices(glove.carried_by)] + offset
    np.testing.assert_allclose(np.linalg.norm(facing, axis=1), 1, atol=1e-9)
    assert np.linalg.norm(light - template(glove, HAND), axis=1).max() < 0.03
    for k in range(len(MARKERS)):
        gaps = []
        for joint, start, end, radius in zip(
            capsules.joint, capsules.start, capsules.end, capsules.radius, strict=True
        ):
            axis = rest[joint] + start + np.linspace(0, 1, 400)[:, None] * (end - start)
            gaps.append(np.linalg.norm(axis - light[k], axis=1).min() - radius)
        assert 0.0015 < min(gaps) < 0.035, MARKERS[k]
    assert (facing[:7, 1] > 0.5).all(), "all but those of the thumb face up from a flat hand"


def test_a_hand_hides_its_markers_only_from_behind() -> None:
    backs = [MARKERS.index(name) for name in ("pinky_base", "wrist", "index_base", "middle_tip", "ring_tip")]
    assert visible({"left": flat_hand()}, ABOVE)[:, backs].all()
    assert not visible({"left": flat_hand()}, BELOW)[:, backs].any()
    over = flat_hand(turn=(np.pi, 0.0, 0.0))  # palm up
    assert not visible({"left": over}, ABOVE)[:, backs].any() and visible({"left": over}, BELOW)[:, backs].all()


def test_left_and_right_hands_are_seen_equally() -> None:
    """The ring of cameras is its own mirror image."""
    rng = np.random.default_rng(0)
    pose = Pose(HAND, rng.normal(scale=0.1, size=(30, 3)), quaternion_exp(rng.normal(size=(30, 16, 3)) * 0.5))
    ring = CameraRing(count=8, heights=(0.3,))
    np.testing.assert_array_equal(visible({"left": pose}, ring), visible({"right": pose}, ring))


def test_one_hand_hides_the_other() -> None:
    """A hand over the back of another one hides the markers there, which are seen without it."""
    below, over = flat_hand(), flat_hand()
    over.root_position[:] = [0.0, 0.06, 0.0]
    backs = [MARKERS.index("pinky_base"), MARKERS.index("index_base")]
    steep = CameraRing(heights=(3.0,), radius=0.02)
    assert visible({"left": below}, steep)[:, backs].all()
    together = visible({"left": below, "left2": over}, steep)
    assert not together[:, backs].any() and together[:, [9 + k for k in backs]].all()
    assert not visible({"left": below}, steep, others=[(over, "left")])[:, backs].any()


def test_the_body_hides_hands_behind_it() -> None:
    """A camera in front sees hands behind the back only if there is no body."""
    body = rest_pose(default_skeleton(), (1,))
    behind = np.array([[-0.09, 1.1, -0.25]])  # in a left hand's world; the fingers of both hands point to the middle
    hands = {side: replace(hand_pose(body, side), root_position=behind) for side in ("left", "right")}
    in_front = CameraRing(count=1, radius=3.0, heights=(0.0,), least=1, beam=180.0)
    assert visible(hands, in_front).mean() > 0.5 and not visible(hands, in_front, body).any()


def test_noise_and_spikes() -> None:
    time_of = np.arange(4000) / 60
    hands = {"left": flat_hand(4000)}
    truth = observe_hands(hands, time_of).position
    rng = np.random.default_rng(1)
    noisy = observe_hands(hands, time_of, GloveCapture(noise=0.001), rng).position - truth
    assert noisy.std() == pytest.approx(0.001, rel=0.03) and abs(noisy.mean()) < 1e-4
    spiky = np.linalg.norm(observe_hands(hands, time_of, GloveCapture(spikes=0.05), rng).position - truth, axis=-1)
    wrong = spiky > 0
    assert wrong.mean() == pytest.approx(0.05, abs=0.005)
    assert spiky[wrong].mean() == pytest.approx(GloveCapture().spike_size, rel=0.1)


def test_losses_have_the_given_rate_and_length() -> None:
    rate, seconds = 120.0, 300.0
    time_of = np.arange(round(rate * seconds)) / rate
    found = check_observation(
        observe_hands({"left": flat_hand(len(time_of))}, time_of, GloveCapture(losses=6.0), np.random.default_rng(2))
    )
    begins = (np.diff(found.has_position.astype(int), axis=0) == -1).sum()
    assert begins == pytest.approx(9 * 6 * seconds / 60, rel=0.2)
    assert (~found.has_position).mean() == pytest.approx(6 / 60 * 0.05, rel=0.25)


def test_a_capture_hides_some_markers_and_is_reproducible(waving_clip: Clip) -> None:
    some = GloveCapture(cameras=CameraRing(count=6), noise=0.0005)
    first = observe(waving_clip.pose, waving_clip.time, some, np.random.default_rng(4))
    again = observe(waving_clip.pose, waving_clip.time, some, np.random.default_rng(4))
    check_observation(first)
    np.testing.assert_array_equal(first.position, again.position)
    assert 0.2 < first.has_position.mean() < 1
    assert hand_size(HAND) > 0.1


def test_bad_settings_are_refused() -> None:
    with pytest.raises(BodysenseError, match="noise -1"):
        GloveCapture(noise=-1.0)
    with pytest.raises(BodysenseError, match="spikes 2 is a share"):
        GloveCapture(spikes=2.0)
    with pytest.raises(BodysenseError, match="give a generator"):
        observe_hands({"left": flat_hand()}, np.arange(2.0), GloveCapture(noise=0.001))
    with pytest.raises(BodysenseError, match="need as many times"):
        observe_hands({"left": flat_hand()}, np.arange(3.0))
    with pytest.raises(BodysenseError, match="neither left nor right"):
        observe_hands({"third": flat_hand()}, np.arange(2.0))
