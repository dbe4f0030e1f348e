"""Features of sequences, compared with their definitions."""

import pytest
import torch
from torch import Tensor

from bodysense.body.skeleton import INERTIAL_POINTS
from bodysense_lab.completion.data.points import SPIN_INDICES, reference_offsets
from bodysense_lab.completion.networks.features import WIDTHS, Before, TrackedSignal, mirror_indices, mirror_signs
from bodysense_lab.completion.networks.network import CompletionConfig, CompletionNetwork

PEOPLE, FRAMES = 3, 5


@pytest.fixture
def signal() -> TrackedSignal:
    torch.manual_seed(1)

    def normal(*shape: int) -> Tensor:
        return torch.randn(PEOPLE, FRAMES, *shape)

    def some(*shape: int) -> Tensor:
        return torch.rand(PEOPLE, FRAMES, *shape) > 0.4

    def rotations(*shape: int) -> Tensor:
        return torch.linalg.qr(normal(*shape, 3, 3))[0]

    return TrackedSignal(
        position=normal(27, 3),
        rotation=rotations(22),
        has_position=some(27),
        has_rotation=some(22),
        accuracy=torch.rand(PEOPLE, FRAMES, 27) / 10 + 1e-3,
        interval=torch.rand(PEOPLE, FRAMES) / 30 + 5e-3,
        turn=rotations(),
        origin=normal(3),
        before=Before(normal(27, 3), some(27), rotations(3), some(3)),
        rest_offset=torch.randn(PEOPLE, 25, 3),
        certainty=torch.rand(PEOPLE, 25),
        size=torch.rand(PEOPLE) + 0.5,
        acceleration=60 * normal(len(INERTIAL_POINTS), 3),
        has_acceleration=some(len(INERTIAL_POINTS)),
    )


def direct_features(of: TrackedSignal) -> dict[str, Tensor]:
    size, into, interval = of.size[:, None, None, None], of.turn.mT[:, :, None], of.interval[..., None]
    both = (of.has_position & of.before.has_position)[..., None]
    known = of.has_rotation[..., None, None]
    spun = (of.has_rotation[..., SPIN_INDICES] & of.before.has_rotation)[..., None, None]
    velocity = (of.position - of.before.position) @ of.turn / (size * interval[..., None])
    spin = into @ (of.rotation[:, :, SPIN_INDICES] - of.before.rotation)[..., :2] / interval[..., None, None]
    bones = (of.rest_offset / of.size[:, None, None] - torch.tensor(reference_offsets()).float()) * 20
    bones[:, 0] = 0
    return {
        "position": (of.position - of.origin[:, :, None]) @ of.turn / size * of.has_position[..., None],
        "has_position": of.has_position.float(),
        "velocity": velocity.clamp(-5, 5) * both,
        "accuracy": (torch.log10(of.accuracy) + 3) * of.has_position,
        "axes": into @ of.rotation[..., :2] * known,
        "has_rotation": of.has_rotation.float(),
        "spin": spin.clamp(-15, 15) * spun,
        "bones": bones[:, None].expand(-1, FRAMES, -1, -1),
        "certainty": (20 * of.certainty)[:, None].expand(-1, FRAMES, -1),
        "interval": interval * 30,
        "acceleration": (of.acceleration @ of.turn / size).clamp(-50, 50) / 10 * of.has_acceleration[..., None],
        "has_acceleration": of.has_acceleration.float(),
    }


def test_features_equal_their_definitions(signal: TrackedSignal) -> None:
    features = CompletionNetwork(CompletionConfig(hidden=8)).read(signal)
    for (name, wanted), part in zip(
        direct_features(signal).items(), features.split(list(WIDTHS.values()), dim=-1), strict=True
    ):
        assert torch.allclose(part, wanted.flatten(2), atol=2e-5), name


def test_both_features_and_their_mirror_image_are_returned(signal: TrackedSignal) -> None:
    network = CompletionNetwork(CompletionConfig(hidden=8))
    features = network.read(signal)
    both = network.read_both(signal)
    assert torch.equal(both[..., 0, :], features)
    image = features[..., mirror_indices()] * torch.tensor(mirror_signs())
    assert torch.allclose(both[..., 1, :], image, atol=1e-6)
    assert torch.allclose(image[..., mirror_indices()] * torch.tensor(mirror_signs()), features)
