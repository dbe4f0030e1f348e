"""Options of `bodysense papers track` for every paper's system. The command line imports them, so without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bodysense.devices.simulated.device import DeviceName
from bodysense.errors import BodysenseError
from bodysense.sources.open import MotionSource, Opened

Method = Literal["unoc", "hmd_vae", "pahmt", "two_hands", "completion"]
Variant = Literal["0", "1", "2", "3", "4", "cnn", "ahmt", "pahmt", "paper", "shipped"]


@dataclass(frozen=True)
class PaperOptions:
    """Settings of one run of a paper's system."""

    networks: Path | None = None  # a network file, for two_hands a folder of two; the packaged ones if None
    variant: Variant | None = None  # form of the network
    device: DeviceName | None = None  # simulated device for a motion
    noise: int | None = None  # random seed of the device's errors; None: exact tracking
    height: float | None = None  # m, of the wearer
    calibration: Path | None = None  # flat-hand calibration, for two_hands
    landmarkers: Path | None = None  # folder of MediaPipe's landmarkers, for pahmt

    def choose_variant(self, method: Method, valid: tuple[Variant, ...], default: Variant) -> Variant:
        """Return the variant, `default` if none was given. Raises BodysenseError for one that the method lacks."""
        if self.variant is None or self.variant in valid:
            return self.variant or default
        options = f"valid are {', '.join(valid)}" if valid else "leave it out"
        raise BodysenseError(f"--variant {self.variant}: --method {method} has no such variant; {options}")

    def choose_device(self, opened: Opened, default: DeviceName) -> DeviceName | None:
        """Return the simulated device: for a motion `default` if none was given, for other sources None."""
        return self.device or (default if isinstance(opened, MotionSource) else None)


def missing_weights_error(what: str, command: str, option: str) -> BodysenseError:
    """Return the error for weights that are not packaged."""
    return BodysenseError(f"{what}: no weights are packaged; train them: {command}, then give {option}")
