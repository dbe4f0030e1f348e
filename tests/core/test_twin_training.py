"""Features and networks of training, in PyTorch, are the twin's and with it the core's."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from bodysense_lab.completion.networks.features import Before, TrackedSignal, mirror_indices, mirror_signs
from bodysense_lab.completion.networks.fingers import FingerNetwork, FingerSignal
from bodysense_lab.completion.networks.network import CompletionNetwork, orthonormal
from bodysense_lab.completion.networks.weights_file import read_weights

from .twin import features
from .twin.body import Body, empty_body, place
from .twin.cases import DEVICES, Case, cases, observation_of, person_of
from .twin.fingers import hand_features, place_hand
from .twin.layers import FEATURE, branch_of, recurrent_of, rounded, tables
from .twin.network import Memory, first_memory, outputs_of
from .twin.points import BODY_POINTS, HAND_JOINTS, HAND_POINTS, HEAD, WRISTS
from .twin.step import WEIGHTS
from .twin.tracked import Tracked, choose_base, find_knuckles, gather, imply_rotations
from .twin.vectors import frame_of

ROUNDED = 5e-3  # outputs differ by no more because the core rounds what products read to 16 bits


@pytest.fixture(scope="module")
def networks() -> tuple[CompletionNetwork, FingerNetwork]:
    body, fingers = read_weights(WEIGHTS)
    return body.eval(), fingers.eval()


@dataclass(frozen=True)
class Frame:
    """A tracked frame, and what features are made of."""

    seen: Tracked
    head: features.Head
    before: features.Before | None


def frames_of(case: Case) -> Iterator[Frame]:
    """Frames whose memories all advance."""
    observation, person, before = observation_of(case), person_of(case), None
    base, turn = choose_base(observation, 0, 0.0), np.eye(3, dtype=np.float32)
    for t in range(case.frames):
        seen = gather(observation, t, base, 1 / case.rate, 0.0)
        seen.rest_offset, seen.deviation = person.skeleton.rest_offset, person.bone_deviation
        find_knuckles(seen)
        imply_rotations(seen)
        head = features.find_head(seen, turn)
        yield Frame(seen, head, before)
        before, turn = features.remember(seen), head.turn


def tensor(values: object) -> Tensor:
    array = np.asarray(values)
    return torch.tensor(array if array.dtype == bool else array.astype(np.float32))


def signal_of(frames: list[Frame]) -> TrackedSignal:
    """One sequence as training has it."""
    now = [features.remember(frame.seen) for frame in frames]
    old = [frame.before or features.Before(one.place, one.has_place & False, one.axes, one.has_axes & False)
           for frame, one in zip(frames, now, strict=True)]  # fmt: skip
    third = [np.concatenate([one.axes, np.cross(one.axes[:, :1], one.axes[:, 1:])], axis=1) for one in old]
    seen, joints, strapped = [frame.seen for frame in frames], range(22), features.STRAPPED
    whole = {
        "position": [one.place for one in now],
        "rotation": [one.rotation[:22] for one in seen],
        "has_position": [one.has_place for one in now],
        "has_rotation": [[one.turned(joint) for joint in joints] for one in seen],
        "accuracy": [features.accuracies(one) for one in seen],
        "interval": [one.interval for one in seen],
        "turn": [frame.head.turn for frame in frames],
        "origin": [frame.head.origin for frame in frames],
        "acceleration": [one.acceleration[strapped] for one in seen],
        "has_acceleration": [one.has_acceleration[strapped] for one in seen],
    }
    before = Before(
        tensor([one.place for one in old])[None],
        tensor([one.has_place for one in old])[None],
        tensor(third).mT[None],
        tensor([one.has_axes for one in old])[None],
    )
    return TrackedSignal(
        **{name: tensor(values)[None] for name, values in whole.items()},
        before=before,
        rest_offset=tensor(seen[0].rest_offset[BODY_POINTS])[None],
        certainty=tensor(seen[0].deviation[BODY_POINTS])[None],
        size=tensor([features.stature(seen[0].rest_offset)]),
    )


@given(data=st.data())
@settings(max_examples=6, derandomize=True)
def test_features_and_the_network_are_the_twins(
    networks: tuple[CompletionNetwork, FingerNetwork], data: st.DataObject
) -> None:
    network, of = networks[0], tables(WEIGHTS)
    frames = list(frames_of(data.draw(cases(data.draw(st.sampled_from(DEVICES)), 6))))
    signal = signal_of(frames)
    with torch.no_grad():
        read = network.read(signal)[0]
        image = read[:, mirror_indices()] * torch.tensor(mirror_signs())
        memory, predicted = network.begin(2), list[Tensor]()
        for t in range(len(frames)):
            raw, memory = network.predict(torch.stack([read[t], image[t]])[:, None], memory)
            predicted.append(torch.cat(raw, dim=-1)[:, 0].T)
    layers = [np.zeros((network.config.hidden, 2)) for _ in range(network.config.layers)]
    for t, frame in enumerate(frames):
        reading = features.read(
            frame.seen, frame.head, frame.before, np.float32(frame.seen.interval), of["body.usual_bones"]
        )
        both = np.stack([features.features(reading), features.features(features.mirrored(reading))], axis=1)
        bounded = torch.stack([read[t], image[t]], dim=1).clamp(-features.REACH, features.REACH)
        np.testing.assert_allclose(both, bounded.numpy(), rtol=0, atol=2e-4)
        layers, *outputs = outputs_of(of, reading, rounded(both, FEATURE), layers, FEATURE)
        np.testing.assert_allclose(np.concatenate(outputs), predicted[t].numpy(), rtol=0, atol=ROUNDED)


def fingers_of(frame: Frame, body: Body, memory: Memory) -> FingerSignal:
    """One frame of both hands as training has it."""
    seen, parts = frame.seen, dict[str, list[np.ndarray]]()
    into = frame.head.turn.T
    for hand, wrist in enumerate(WRISTS):
        turn, points, joints = body.rotation[wrist], HAND_POINTS[hand], HAND_JOINTS[hand]
        has = seen.has_position[points] & seen.has_position[wrist]
        turned = seen.has_rotation[joints]
        before = body.point[wrist] if memory.wrists is None else memory.wrists[hand]
        own = {
            "position": (seen.position[points] - seen.position[wrist]) @ turn * has[:, None],
            "has_position": has,
            "rotation": turn.T @ seen.rotation[joints] * turned[:, None, None],
            "has_rotation": turned,
            "rest_offset": seen.rest_offset[points],
            "wrist": into @ (body.point[wrist] - body.point[HEAD]),
            "wrist_rotation": into @ turn,
            "wrist_velocity": into @ (body.point[wrist] - before) / seen.interval,
        }
        for name, values in own.items():
            parts.setdefault(name, []).append(values)
    of_frame = {name: tensor(np.stack(values))[None, None] for name, values in parts.items()}
    of_frame["rest_offset"] = of_frame["rest_offset"][0]
    return FingerSignal(**of_frame, interval=tensor([[memory.elapsed]]))


@given(data=st.data())
@settings(max_examples=4, derandomize=True)
def test_finger_features_and_network_are_the_twins(
    networks: tuple[CompletionNetwork, FingerNetwork], data: st.DataObject
) -> None:
    network, of = networks[1], tables(WEIGHTS)
    device = data.draw(st.sampled_from(("headset_camera", "three_point", "lattice")))
    memory = first_memory(of)
    hidden = network.begin(1)
    for frame in frames_of(data.draw(cases(device, 5))):
        body, seen = empty_body(), frame.seen
        body.rotation[:22] = seen.rotation[:22]
        place(body, seen, seen.position[HEAD])
        memory.elapsed = seen.interval
        signal = fingers_of(frame, body, memory)
        with torch.no_grad():
            read = network.read(signal)[0, :, 0]
            rotation, error, hidden = network(signal, hidden)
        own = np.stack([hand_features(of, seen, frame.head, body, memory, hand) for hand in (0, 1)], axis=1)
        np.testing.assert_allclose(own, read.T.numpy(), rtol=0, atol=2e-4)
        memory.hands = recurrent_of(of, "fingers", 0).step(rounded(own, FEATURE), memory.hands, FEATURE)
        outputs = branch_of(of, "fingers.branch").outputs(rounded(memory.hands, FEATURE), rounded(own, FEATURE))
        memory.wrists = body.point[list(WRISTS)].copy()
        seen.has_position[:], seen.has_rotation[:] = False, False  # what is predicted, without what is measured
        for hand, joints in enumerate(HAND_JOINTS):
            expected = place_hand(of, seen, hand, outputs[:, hand], body)
            np.testing.assert_allclose(expected, error[0, 0, hand].numpy(), rtol=0, atol=ROUNDED)
            local = body.rotation[WRISTS[hand]].T @ body.rotation[joints]
            np.testing.assert_allclose(local, rotation[0, 0, hand].numpy(), rtol=0, atol=ROUNDED)


def test_axes_become_rotations_alike() -> None:
    axes = np.random.default_rng(1).normal(size=(20, 3, 2))
    wanted = [frame_of(x_y[:, 0], x_y[:, 1]) for x_y in axes]
    np.testing.assert_allclose(orthonormal(torch.tensor(axes)).numpy(), wanted, atol=1e-12)
