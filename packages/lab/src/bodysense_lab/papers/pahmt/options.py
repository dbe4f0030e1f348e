"""Options of the networks of arms and hands and of their training. The command line reads them, so without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from tyro.conf import Suppress, arg

from bodysense.body.arms import ARM_JOINTS, HAND_POINTS
from bodysense.errors import BodysenseError
from bodysense.ranges import Count, Seed
from bodysense_lab.core.options import Card, Flat, MotionRun, check_ending
from bodysense_lab.papers.pahmt.camera_view import CameraRange
from bodysense_lab.papers.pahmt.keypoint_noise import DetectorNoise

Kind = Literal["cnn", "ahmt", "pahmt"]
Input = Literal["hands", "arms-hands"]
Loss = Literal["rotation", "smooth", "fk", "gan", "motion"]
PAPER_LOSSES: tuple[Loss, ...] = ("rotation", "smooth", "fk", "gan")
FINGERS = tuple(k for k, name in enumerate(ARM_JOINTS) if name[-1] in "123")  # of `ARM_JOINTS`


@dataclass(frozen=True)
class ArmNetworkConfig:
    """Architecture of the network; the defaults are the paper's (section 3.3)."""

    kind: Annotated[Kind, arg(name="model")] = "pahmt"
    """convolutions over time, a transformer over time, or that with a branch over joints"""
    input: Input = "arms-hands"
    """'hands' reads hands alone and predicts fingers alone (Table 1, h2h)"""
    width: Count = 512
    """width of the features over time, D_t; a multiple of --heads and of 16"""
    layers: Count = 4
    """layers over time, L_t"""
    heads: Count = 8
    """attention heads over time"""
    feed_forward: Count = 2
    """width of the feed-forward layers, times --width"""
    spatial_width: Count = 64
    """width of a token of the branch over joints, D_s"""
    spatial_layers: Count = 2
    """layers of that branch, L_s"""
    spatial_heads: Count = 4
    """attention heads of that branch"""
    dropout: float = 0.1
    """dropout of all networks"""
    frames: int = 32
    """frames of a window, f"""
    rotation: Literal["axis-angle", "6d"] = "axis-angle"
    """what is regressed"""
    more_inputs: bool = False
    """also read the torso's rotation, the hands' place and size, and the detection masks; not part of the table"""
    from_directions: bool = False
    """blend with arms whose elbows are hinges and whose bones have the measured directions; needs '6d'"""
    from_palms: bool = False
    """blend with wrist rotations estimated from the pictures of palms; needs --from-directions"""

    def __post_init__(self) -> None:
        if self.width % self.heads or self.spatial_width % self.spatial_heads:
            raise BodysenseError(f"width {self.width} must be a multiple of {self.heads} heads, and so over joints")
        if self.frames < 2 or (self.frames % 16 and self.kind == "cnn"):
            raise BodysenseError(f"frames is {self.frames}; give at least 2, and a multiple of 16 for a cnn")
        if self.input == "hands" and self.more_inputs:
            raise BodysenseError("more_inputs are of arms; leave them out with input 'hands'")
        if self.from_directions and (self.input == "hands" or self.rotation != "6d"):
            raise BodysenseError("from_directions needs input 'arms-hands' and rotation '6d'")
        if self.from_palms and not self.from_directions:
            raise BodysenseError("from_palms needs from_directions: palms are turned against forearms")

    @property
    def joints(self) -> tuple[int, ...]:
        """Indices of the `ARM_JOINTS` that it predicts."""
        return FINGERS if self.input == "hands" else tuple(range(len(ARM_JOINTS)))

    @property
    def tokens(self) -> int:
        """Points a frame: the paper's arms and hands, 2 · 2 + 2 · 21, and ours, ten and eight."""
        arms = 4 if self.input == "arms-hands" else 0
        return arms + 2 * len(HAND_POINTS) + 10 * self.more_inputs + 8 * self.from_palms

    @property
    def shares(self) -> int:
        """Number of blending weights: four directions of bones, and for each hand the regressed wrist and two palms."""
        return 4 * self.from_directions + 6 * self.from_palms

    @property
    def size(self) -> int:
        """Numbers of a rotation."""
        return 3 if self.rotation == "axis-angle" else 6


@dataclass(frozen=True)
class VideoSimulation:
    """Simulation of a video: cameras, errors of the detector, and videos that have just begun."""

    cameras: Suppress[CameraRange] = CameraRange()
    keypoints: Literal["detected", "perfect"] = "detected"
    """with the errors of a detector, or without any"""
    mirrored: Suppress[bool] = True  # half of the windows in a mirror
    begun: Suppress[float] = 0.1  # share of windows at the beginning of a video, padded with its first frame

    @property
    def noise(self) -> DetectorNoise | None:
        """The detector's errors; None for perfect key-points."""
        return DetectorNoise() if self.keypoints == "detected" else None


@dataclass(frozen=True)
class ArmSchedule:
    """Schedule and losses of a training; the defaults are the paper's (section 4.2)."""

    epochs: Count = 300
    """passes over all windows, each with new cameras"""
    steps: Count | None = None
    """optimiser steps at most; all epochs if omitted"""
    batch: Count = 128
    """windows a step"""
    learning_rate: float = 1e-3
    """at the start"""
    halve_every: Count = 50
    """epochs after which it is halved"""
    weight_decay: float = 5e-4
    """of Adam"""
    momentum: float = 0.95
    """of Adam"""
    losses: tuple[Loss, ...] = PAPER_LOSSES
    """rotation, smooth, fk and gan are the paper's; motion compares the change of positions"""
    rotation: Annotated[float, arg(name="rotation-weight")] = 1.0
    """weight of the loss of rotations, per radian"""
    arms: Annotated[float, arg(name="arms-factor")] = 1.0
    """weight of an arm's joint, wrists included, relative to a finger's"""
    smooth: Annotated[float, arg(name="smooth-weight")] = 1.0
    """weight γ of the change from frame to frame"""
    fk: Annotated[float, arg(name="fk-weight")] = 1.0
    """weight β of joint positions, per metre"""
    gan: Annotated[float, arg(name="gan-weight")] = 0.05
    """weight λ of the adversarial loss"""
    motion: Annotated[float, arg(name="motion-weight")] = 10.0
    """weight of the difference between estimated and true change, per metre; only where --losses has motion"""
    without_hands: float = 0.0
    """share of windows without recorded fingers, which train the arms alone"""
    average_decay: float = 0.99
    """decay of the moving average of the weights, which is saved"""
    check_every: Count = 250
    """steps between checkpoints, each of which measures the average and keeps it if it is best"""
    studio: Flat[VideoSimulation] = VideoSimulation()
    seed: Seed = 1
    """random seed"""

    def __post_init__(self) -> None:
        if not 0 <= self.without_hands < 1:
            raise BodysenseError(f"--without-hands {self.without_hands:g}: give a share from 0 to below 1")


@dataclass(frozen=True, kw_only=True)
class ArmRun(MotionRun, Card):
    """A training of one network or of several; the clips with fingers are learned."""

    config: Flat[ArmNetworkConfig] = ArmNetworkConfig()
    schedule: Flat[ArmSchedule] = ArmSchedule()
    bodies: Count = 1
    """copies of each clip; all but the first are augmented: other proportions, arms that wander, arms of other clips"""


@dataclass(frozen=True, kw_only=True)
class ArmTraining(ArmRun):
    """Options of `bodysense train arms`."""

    def __post_init__(self) -> None:
        check_ending(self.out, ".onnx", ".pt")
        if self.config.input == "hands" and self.out.suffix == ".onnx":
            raise BodysenseError(
                f"{self.out}: a network of hands alone is for the table only; give a name that ends in .pt"
            )


@dataclass(frozen=True)
class TableRow:
    """A row of Table 1: the network, its input and losses, and the published figures."""

    title: str
    kind: Kind = "cnn"
    input: Input = "arms-hands"
    losses: tuple[Loss, ...] = PAPER_LOSSES
    published: tuple[float, ...] = ()  # MPJPE of hands and overall, m; MPJRE of arms; of hands alone only the first


# The table does not print which marks the rows of the CNN carry; by the text the third and fourth of arms and hands
# differ from the first two by the loss of positions, and the last has both.
TABLE_1 = {
    "cnn-hands": TableRow("CNN, hands alone", "cnn", "hands", ("rotation", "gan"), (0.0300,)),
    "cnn-plain": TableRow("CNN", "cnn", losses=("rotation", "gan"), published=(0.0130, 0.0517, 0.0604)),
    "cnn-smooth": TableRow("CNN", "cnn", losses=("rotation", "smooth", "gan"), published=(0.0133, 0.0519, 0.0603)),
    "cnn-fk": TableRow("CNN", "cnn", losses=("rotation", "fk", "gan"), published=(0.0129, 0.0413, 0.0579)),
    "cnn": TableRow("CNN", "cnn", published=(0.0127, 0.0408, 0.0577)),
    "ahmt": TableRow("AHMT", "ahmt", published=(0.0098, 0.0316, 0.0445)),
    "pahmt": TableRow("PAHMT", "pahmt", published=(0.0087, 0.0274, 0.0375)),
}


@dataclass(frozen=True, kw_only=True)
class ArmTableTraining(ArmRun):
    """Options of `bodysense train arms-table`."""

    networks: tuple[str, ...] = ()
    """some of them only: cnn-hands, cnn-plain, cnn-smooth, cnn-fk, cnn, ahmt, pahmt"""

    def __post_init__(self) -> None:
        default = ArmNetworkConfig()
        if (self.config.kind, self.config.input) != (default.kind, default.input):
            raise BodysenseError("--model and --input are each network's own in the table; leave them out")
        if self.schedule.losses != PAPER_LOSSES:
            raise BodysenseError("--losses are each network's own in the table; leave them out")
