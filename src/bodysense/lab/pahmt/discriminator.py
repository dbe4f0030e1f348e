"""What the networks of arms and hands play against (PAHMT, section 3.4)."""

from __future__ import annotations

from torch import Tensor, nn

from bodysense.lab.pahmt.network import ArmNetworkConfig


class Discriminator(nn.Module):
    """Tells recorded sequences of rotations from estimated ones (section 3.4): three convolutions over time."""

    def __init__(self, config: ArmNetworkConfig, width: int = 128) -> None:
        super().__init__()
        count = config.size * len(config.joints)
        self.layers = nn.Sequential(
            *(nn.Conv1d(count, width, 4, 2, 1), nn.LeakyReLU(0.2)),
            *(nn.Conv1d(width, width, 4, 2, 1), nn.LeakyReLU(0.2)),
            nn.Conv1d(width, 1, 3, padding=1),
        )

    def forward(self, rotation: Tensor) -> Tensor:
        """Rotations (B, T, joints, 3 or 6) → logits (B, T / 4) of being recorded."""
        return self.layers(rotation.flatten(-2).mT)[:, 0]
