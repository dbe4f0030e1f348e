"""Options of HMD-VAE's networks and training; read by the command line, so without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.sensors import THREE_POINTS
from bodysense.errors import BodysenseError
from bodysense.ranges import Count, Seed
from bodysense_lab.core.options import Card, Flat, MethodDefault, MotionRun, check_ending

Model = Literal[0, 1, 2, 3, 4]
MODELS: tuple[Model, ...] = get_args(Model)
Origin = Literal["head", "pelvis"]
Grid = Literal["one", "few", "all"]


@dataclass(frozen=True)
class BodyVaeConfig:
    """One of the paper's settings (sections 4 and 5)."""

    model: Model = 2
    """0 sees the whole body; 1 head and hands now; 2 their last half second; 3 and 4 are 1 and 2 with the decoder of a
    model 0, which is frozen; a sweep trains all"""
    latent: Count = 30
    """numbers that make a body, d; the paper's sweep has 15, 30, 60"""
    blocks: Count = 3
    """residual blocks of encoder and decoder; the paper's sweep has 3, 6"""
    beta: float = 0.01
    """weight of the divergence from the prior (eq. 7)"""
    samples: Count = 1
    """draws of the posterior a step, S (eq. 7)"""
    position_deviation: float = 0.02
    """deviation s₁ of positions in metres"""
    angle_deviation: float = 0.1
    """deviation s₂ of rotations in radians"""
    width: Count = 256
    """width of the layers"""
    sequence_width: Count = 128
    """width of the layers over time"""
    length: Count = 16
    """frames of history at 30 Hz, L"""
    origin: Origin = "head"
    """'head' is under the headset; 'pelvis', the paper's, knows where the pelvis is and faces, as no headset does, and
    cannot be exported"""

    def __post_init__(self) -> None:
        if not (self.beta >= 0 and self.position_deviation > 0 and self.angle_deviation > 0):
            raise BodysenseError("beta must be 0 or more, and both deviations positive")

    @property
    def reads(self) -> tuple[str, ...]:
        """The joints that the encoder sees."""
        return BODY if self.model == 0 else THREE_POINTS

    @property
    def frames(self) -> int:
        """How many frames the encoder sees."""
        return self.length if self.model in (2, 4) else 1

    @property
    def pretrained(self) -> bool:
        """Whether the decoder is that of a model 0."""
        return self.model in (3, 4)


@dataclass(frozen=True)
class VaeSchedule:
    """How long and on what. The paper does not print its own."""

    steps: Count = MethodDefault(6000)
    """optimiser steps"""
    batch: Count = 256
    """windows a step"""
    learning_rate: float = 3e-3
    """the highest of one cycle"""
    weight_decay: float = 0.01
    """of the optimiser"""
    average_decay: float = 0.995
    """of the moving average of the weights, which is what is kept; 0 keeps the last ones"""
    mirrored: bool = True
    """half of the windows in the mirror, which the paper does not do"""
    check_every: Count = 500
    """steps between checkpoints"""
    seed: Seed = 1
    """random seed"""
    last_share = 0.001  # of one cycle (Smith & Topin 2019): up in the first tenth, then a cosine down to a thousandth

    @property
    def warm_up(self) -> float:
        """Steps until the highest rate is reached."""
        return self.steps / 10


@dataclass(frozen=True, kw_only=True)
class VaeRun(MotionRun, Card):
    """A training of one network; of the learned sequences of each data set 5 % are held out."""

    config: Flat[BodyVaeConfig] = BodyVaeConfig()
    schedule: Flat[VaeSchedule] = VaeSchedule()
    decoder: Path | None = None
    """the .pt of a trained model 0, for models 3 and 4"""
    split_file: Path | None = None
    """lines 'PATH train' or 'PATH test' instead of the split by person, for a published protocol; the sequences that
    are held out are then watched"""


@dataclass(frozen=True, kw_only=True)
class VaeTraining(VaeRun):
    """Train HMD-VAE, as NAME.onnx and NAME.pt, or NAME.pt alone, or many networks of a sweep into a folder."""

    sweep: bool = False
    """train models 0 to 4 of many settings into the folder --out, with results.csv; what is there is kept"""
    grid: Grid | None = None
    """settings of a sweep. 'one': the setting of --latent, --beta, --blocks. 'few', the default: beta 0.01 and 1,
    latent 30, blocks 3 and 6: 20 networks. 'all': the paper's 30 settings, 150 networks"""

    def __post_init__(self) -> None:
        check_list(self.split_file)
        if not self.sweep:
            self._check_one()
            return
        if self.out.suffix in (".onnx", ".pt") or self.decoder is not None:
            raise BodysenseError(
                "--sweep trains its own decoders into a folder; give a folder as --out, and no --decoder"
            )
        default = BodyVaeConfig()
        if self.config.model != default.model:
            raise BodysenseError(f"--sweep trains models 0 to 4; leave --model {self.config.model} out")
        swept = {name: getattr(self.config, name) for name in ("latent", "beta", "blocks")}
        given = [f"--{name} {value}" for name, value in swept.items() if value != getattr(default, name)]
        if self.grid != "one" and given:
            raise BodysenseError(
                f"--grid {self.grid or 'few'} has settings of its own; leave {' '.join(given)} out, or give --grid one"
            )

    def _check_one(self) -> None:
        check_ending(self.out, ".onnx", ".pt")
        if self.grid is not None:
            raise BodysenseError(f"--grid {self.grid} is of a sweep; add --sweep, or leave --grid out")
        if self.out.suffix == ".onnx" and self.config.origin != "head":
            raise BodysenseError(
                f"{self.out}: no device tracks the {self.config.origin}, so a network with that origin is not "
                "exported; give a name that ends in .pt, or --origin head"
            )


def check_list(path: Path | None) -> None:
    """Raise BodysenseError if the list of a split is missing."""
    if path is not None and not path.is_file():
        raise BodysenseError(f"--split-file {path}: no such file; give a list of lines 'PATH train' or 'PATH test'")
