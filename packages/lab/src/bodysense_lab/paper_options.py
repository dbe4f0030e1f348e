"""Options of `bodysense papers track`, which every paper's system takes; read by the command line, so no PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bodysense.devices.simulated.device import DeviceName
from bodysense.errors import BodysenseError
from bodysense.open import MotionSource, Opened

Method = Literal["unoc", "hmd_vae", "pahmt", "two_hands", "completion"]
Variant = Literal["0", "1", "2", "3", "4", "cnn", "ahmt", "pahmt", "paper", "shipped"]


@dataclass(frozen=True)
class PaperOptions:
    """Settings of one run of a paper's system."""

    networks: Path | None = None  # a network file, for two_hands a folder of two; the packaged ones if None
    variant: Variant | None = None  # form of the network
    device: DeviceName | None = None  # simulated device that watches a motion
    noise: int | None = None  # random seed of the device's errors; None tracks exactly
    height: float | None = None  # m, of the wearer
    calibration: Path | None = None  # flat-hand calibration, for two_hands

    def chosen(self, method: Method, valid: tuple[Variant, ...], usual: Variant) -> Variant:
        """Return the variant, `usual` if none was given. Raises BodysenseError for one that the method lacks."""
        if self.variant is None or self.variant in valid:
            return self.variant or usual
        options = f"valid are {', '.join(valid)}" if valid else "leave it out"
        raise BodysenseError(f"--variant {self.variant}: --method {method} has no such variant; {options}")

    def watched_by(self, opened: Opened, usual: DeviceName) -> DeviceName | None:
        """Return the simulated device: of a motion `usual` if none was given, of other sources None."""
        return self.device or (usual if isinstance(opened, MotionSource) else None)


def missing_weights_error(what: str, command: str, option: str) -> BodysenseError:
    """Return the error for weights that are not packaged."""
    return BodysenseError(f"{what}: no weights are packaged; train them: {command}, then give {option}")
