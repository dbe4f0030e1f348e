"""The figures of docs/reproduce.md: cells of tables of other pages, lines of model cards, and settings of the code."""

from __future__ import annotations

import re
from collections.abc import Callable
from inspect import signature
from pathlib import Path

from bodysense.body.arms import HAND_POINTS
from bodysense.body.hands.glove import ALIGNMENT, MARKERS
from bodysense.body.hands.hand import FREEDOMS
from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.headset_camera import HeadsetCamera
from bodysense_lab.commands.paper_bodies import generate
from bodysense_lab.papers.hmd_vae.frames import HELD_OUT, TRAIN_LENGTH
from bodysense_lab.papers.hmd_vae.options import BodyVaeConfig
from bodysense_lab.papers.pahmt.options import ArmNetworkConfig, ArmSchedule
from bodysense_lab.papers.two_hands.score.occlusion import SHORT
from bodysense_lab.papers.two_hands.system import SETTINGS
from bodysense_lab.papers.two_hands.task import PAPER_JOINT_SCHEDULE
from bodysense_lab.papers.unoc.network.losses import LossWeights
from bodysense_lab.papers.unoc.network.network import PAPER
from bodysense_lab.papers.unoc.task import BodySchedule

from .blocks import ROOT

CAMERA, LOSSES, SCHEDULE = HeadsetCamera(), LossWeights(), BodySchedule()
VAE, ARMS, ARM_LOSSES = BodyVaeConfig(), ArmNetworkConfig(), ArmSchedule()
PAGE = Path("docs") / "reproduce.md"
COLUMN, HOURS_COLUMN = 3, 7  # of a row's cells: its figure, and the hours of its training
_BLOCK = re.compile(r"<!-- begin (\S+) -->\n(.*?)<!-- end \1 -->", re.DOTALL)
_PROCESSOR = re.compile(r"^Processor: (.*?)(?:; (\S+) CPU hours)?\.$", re.MULTILINE)
_WEIGHTS, _ERROR = r"([\d,]+) weights", r"error_cm ([\d.]+)"  # in model cards
Cells = Callable[..., str]  # name of a block, heading of a column, labels of the row → the cell

FIGURES: dict[str, Callable[[Cells], str]] = {  # by row of the page
    "1.1": lambda at: f"{CAMERA.field_of_view:g}°, {CAMERA.tilt:g}°, {100 * CAMERA.near:g} cm",
    "1.2": lambda at: f"joints hidden {at('occlusion', 'all', 'all')} of the time",
    "1.3": lambda at: f"self-contact {at('occlusion', 'all', 'self-contact')}",
    "1.4": lambda at: ", ".join(f"{name} {at('occlusion', 'all', name)}" for name in ("shoulder", "hand", "foot")),
    "1.5": lambda at: f"{PAPER.window} frames at 30 Hz",
    "1.6": lambda at: f"{at('table3', 'body, hidden', 'GRU')} cm, body",
    "1.7": lambda at: (
        f"{LOSSES.body:g}, {LOSSES.finger:g}, {LOSSES.parent:g}, {LOSSES.body_bone:g} and {LOSSES.finger_bone:g}, "
        f"× {LOSSES.occluded:g} if occluded, {LOSSES.occlusion:g}; hidden body "
        f"{at('loss-sums', 'body, hidden', MEANS)} cm after few steps, "
        f"{at('loss-sums', 'body, hidden', SUMS)} with sums"
    ),
    "1.8": lambda at: f"{SCHEDULE.epochs} epochs, batches of {', '.join(map(str, SCHEDULE.epoch_batches))}",
    "1.9": lambda at: ", ".join(
        f"{name} {at('networks', 'body, hidden', name).split()[0]} cm" for name in ("last known", "constant velocity")
    ),
    "1.10": lambda at: f"GRU {_bracket(at('networks', 'body, hidden', 'GRU'))} of last known, body",
    "1.11": lambda at: ", ".join(
        f"{name} {_bracket(at(table, 'body, hidden', name))}"
        for table, name in (
            ("table3", "without skip connections"),
            ("table3", "81 frames"),
            ("table4", "w/o bone length"),
        )
    ),
    "1.12": lambda at: f"{at('speed', 'figure', '`bench ik`').split(',')[0]} ({at('speed', 'processor')})",
    "1.13": lambda at: (
        f"peak jerk {at('beyond', 'm/s³', 'packaged network, before IK')} to "
        f"{at('beyond', 'm/s³', 'packaged, smoothed by the tracker')} m/s³"
    ),
    "1.14": lambda at: (
        f"{at('smoothness', 'network', 'GRU, mask predicted')}, truth {at('smoothness', 'network', 'truth')}"
    ),
    "1.15": lambda at: "; ".join(
        f"{poses} {at('applications', 'network', 'all', table=head)}, "
        f"IK {at('applications', 'inverse kinematics', 'all', table=head)} cm"
        for poses, head in (("all poses", "three points"), ("standing", "three points, standing"))
    ),
    "1.16": lambda at: f"{at('applications', 'RMSJPE / MPJPE', 'network')} cm",
    "1.17": lambda at: (
        f"Rocketbox, body and fingers, {at('table5', 'trained on Rocketbox', BOTH, 'Rocketbox')}; its body by CMU's "
        f"network {at('table5', 'trained on CMU', 'body, hidden', 'Rocketbox')}; fingers from the body, male avatar, "
        f"{at('table5-fingers', 'network of the male', 'male avatar')}, by the female's "
        f"{at('table5-fingers', 'network of the female', 'male avatar')} cm"
    ),
    "1.18": lambda at: (
        f"simulated raters: truth over ours {at('study', 'simulated raters, mean vote', 'truth over ours')}"
    ),
    "2.1": lambda at: f"{len(BODY)} joints",
    "2.2": lambda at: f"{TRAIN_LENGTH} frames, {100 * HELD_OUT:g} % held out",
    "2.3": lambda at: f"s₁ {100 * VAE.position_deviation:g} cm, s₂ {VAE.angle_deviation:g} rad",
    "2.4": lambda at: f"{VAE.width} wide, {6 * len(BODY)} numbers out",
    "2.5": lambda at: f"{at('hmd-vae', 'full body cm', '1, head and hands now')} cm",
    "2.6": lambda at: f"{at('hmd-vae', 'full body cm', '2, their history')} cm",
    "2.7": lambda at: f"{_card('body_vae.md', _WEIGHTS)} weights, model 4 of {VAE.blocks} blocks",
    "2.8": lambda at: f"{at('hmd-vae', 'full body cm', '3, as 1, pretrained')} cm, model 3",
    "2.9": lambda at: re.findall(r"\n\n(\d+ networks, \d+ steps each)", at("hmd-vae-sweep", "text"))[0],
    "2.10": lambda at: f"{at('hmd-vae', 'full body cm', '4, as 2, pretrained')} cm, model 4",
    "2.11": lambda at: f"{_default(generate, 'count')} bodies in a picture, each of {VAE.latent} numbers",
    "2.12": lambda at: f"{at('completion', 'MPJPE cm', 'head', 'nothing known')} cm, the tracker, head alone",
    "3.1": lambda at: f"{ARMS.frames} frames of {ARMS.tokens} points",
    "3.2": lambda at: f"{len(HAND_POINTS)} points a hand",
    "3.3": lambda at: f"overall {at('table1', 'overall m', 'AHMT')} m",
    "3.4": lambda at: f"overall {at('table1', 'overall m', 'PAHMT')} m",
    "3.5": lambda at: f"{ARM_LOSSES.rotation:g}, {ARM_LOSSES.smooth:g}, {ARM_LOSSES.fk:g}, {ARM_LOSSES.gan:g}",
    "3.6": lambda at: (
        f"packaged: overall {_card('arms.md', r'overall_m ([0-9.]+)')} m, arms "
        f"{float(_card('arms.md', r'arms_deg ([0-9.]+)')):.1f}° in validation"
    ),
    "3.7": lambda at: f"{at('arm-windows', 'windows', 'Rocketbox')} windows of Rocketbox",
    "3.8": lambda at: (
        f"PAHMT: hands {at('table1', 'hands m', 'PAHMT')}, overall {at('table1', 'overall m', 'PAHMT')} m"
    ),
    "3.9": lambda at: f"fingers {at('video', 'fingers cm', 'bodysense, from the video')} cm",
    "3.10": lambda at: f"{at('video', 'arms and hands cm', 'bodysense, from the video')} cm",
    "4.1": lambda at: f"{len(MARKERS)} markers, {len(FREEDOMS)} angles",
    "4.2": lambda at: f"{len(ALIGNMENT)} of {len(MARKERS)} markers place the hand",
    "4.3": lambda at: (
        f"{_range(at, 'gloves-fusion', '5 s', UNSEEN, '1', 'fused')}, a finger hidden for 0.1 to 5 s, {UNSEEN}"
    ),
    "4.4": lambda at: f"a slipped glove's flat hand {at('gloves-steps', 'flat hand, °', SLIPPED)}°",
    "4.5": lambda at: (
        f"last known {_range(at, 'gloves-table3', '2 s', 'recorded', 'last known', '1')}, affine "
        f"{_range(at, 'gloves-table3', '2 s', 'recorded', 'affine', '1')}"
    ),
    "4.6": lambda at: f"{_range(at, 'gloves-paper', '2 s', '1', UNSEEN)}, one hidden, {UNSEEN}",
    "4.7": lambda at: f"{100 * SETTINGS.speed:g} cm/s",
    "4.8": lambda at: f"{_card('glove_joints_paper.md', _ERROR)} cm in validation",
    "4.9": lambda at: (
        f"batches of {PAPER_JOINT_SCHEDULE.batch}, halved after {PAPER_JOINT_SCHEDULE.patience} checks; markers "
        f"{_card('glove_markers_paper.md', _ERROR)} cm in validation"
    ),
    "4.10": lambda at: f"{_MIRRORED.findall(at('gloves-steps', 'text'))[0]} cm from the mirror image",
    "4.11": lambda at: f"{_range(at, 'gloves-table3', '2 s', UNSEEN, 'hand known', '1')}, one hidden, {UNSEEN}",
    "4.12": lambda at: f"{at('gloves-table4', '0.1 s', UNSEEN, 'hand known', '0')} cm, nothing hidden, {UNSEEN}",
    "4.13": lambda at: (
        f"one hand: {at('gloves-occlusion', 'one hand', f'spans below {SHORT:g} s, %')} % of spans below {SHORT:g} s, "
        f"one of 1 to 4 hidden markers {at('gloves-occlusion', 'one hand', '1 hidden, % of the time with 1 to 4')} %"
    ),
    "4.14": lambda at: (
        f"{at('gloves-speed', 'one hand', 'one marker hidden a hand')}, "
        f"{at('gloves-speed', 'two hands', 'one marker hidden a hand')} ms; "
        f"{', '.join(f'{_weights(name).stat().st_size / 1e3:.0f}' for name in GLOVE_FILES)} kB"
    ),
    "4.15": lambda at: (
        f"hands in each other {at('gloves-limits', 'output', 'recorded', 'hands in each other', 'frames, %')} "
        "% of frames"
    ),
}
EVALUATED = {  # by row: the block whose commands' hours it has
    **dict.fromkeys(("1.1", "1.2", "1.3", "1.4"), "occlusion"),
    **dict.fromkeys(("1.9", "1.10"), "networks"),
    **dict.fromkeys(("1.6", "1.11"), "table3"),
    "1.7": "loss-sums",
    "1.12": "speed",
    "1.13": "beyond",
    "1.14": "smoothness",
    **dict.fromkeys(("1.15", "1.16"), "applications"),
    "1.17": "table5",
    "1.18": "study",
    "2.10": "hmd-vae",
    "2.12": "completion",
    "3.7": "arm-windows",
    **dict.fromkeys(("3.3", "3.4", "3.8"), "table1"),
    **dict.fromkeys(("3.9", "3.10"), "video"),
    "4.3": "gloves-fusion",
    "4.6": "gloves-paper",
    **dict.fromkeys(("4.4", "4.10"), "gloves-steps"),
    **dict.fromkeys(("4.5", "4.11"), "gloves-table3"),
    "4.12": "gloves-table4",
    "4.13": "gloves-occlusion",
    "4.14": "gloves-speed",
    "4.15": "gloves-limits",
}
HOURS = {  # by row: the training or command whose hours it has
    "1.5": "train body-gru --form paper",
    "1.8": "train unoc-tables",
    **dict.fromkeys(("2.1", "2.2", "2.3", "2.4", "2.5", "2.6", "2.7"), "train hmd-vae"),
    "2.8": "train hmd-vae --sweep --grid one",
    "2.9": "train hmd-vae --sweep --grid all",
    "2.11": "papers generate",
    **dict.fromkeys(("3.1", "3.2", "3.5", "3.6"), "train arms --model pahmt"),
    "4.8": "train gloves --form paper --network joints",
    "4.9": "train gloves --form paper",
    **dict.fromkeys(("4.1", "4.2", "4.7"), "papers track --method two_hands"),
}
MEANS, SUMS = "means over joints", "sums over joints (`--loss-sum`)"
UNSEEN = "unseen hands"
BOTH = "body and fingers, hidden"
GLOVE_FILES = ("glove_joints.onnx", "glove_markers.onnx")
SLIPPED = "finger markers 6 mm nearer the wrist"
_MIRRORED = re.compile(r"are\s([\d.]+)\scm")


def write_rows(root: Path = ROOT) -> None:
    """Replace the figures of all rows."""
    page = root / PAGE
    page.write_text(with_figures(page.read_text(encoding="utf-8"), root), encoding="utf-8")


def with_figures(text: str, root: Path = ROOT) -> str:
    """Return the page with the figures that the tables have now. Raises ValueError for a missing row or cell."""
    blocks = {
        name: body
        for path in sorted((root / "docs").rglob("*.md"))
        for name, body in _BLOCK.findall(path.read_text(encoding="utf-8"))
    }

    def at(block: str, column: str, *labels: str, table: str | None = None) -> str:
        return cell_of(blocks[block], column, *labels, head=table)

    for row, figure in FIGURES.items():
        text = with_figure(text, row, figure(at))
    for row, block in EVALUATED.items():
        text = with_figure(text, row, at(block, "CPU hours"), HOURS_COLUMN)
    for row, training in HOURS.items():
        if f"`{training}`" in blocks["hours"]:
            text = with_figure(text, row, at("hours", "CPU hours", f"`{training}`"), HOURS_COLUMN)
    return text


def cell_of(block: str, column: str, *labels: str, head: str | None = None) -> str:
    """Return the cell of the first row that begins with labels, a block's processor, CPU hours or text.

    `head` is the first heading of the row's table, None any. Raises ValueError.
    """
    if column == "processor":
        return _PROCESSOR.findall(block)[-1][0]
    if column == "CPU hours" and not labels:
        return _PROCESSOR.findall(block)[-1][1] or "–"
    if column == "text":
        return block
    for table in re.findall(r"(?:^\|.*\n)+", block, re.MULTILINE):
        heads, _, *rows = ([cell.strip() for cell in line[1:-1].split("|")] for line in table.splitlines())
        for row in rows:
            if column in heads and head in (None, heads[0]) and tuple(row[: len(labels)]) == labels:
                return row[heads.index(column)]
    raise ValueError(f"no cell {column!r} of {labels}")


def with_figure(text: str, row: str, figure: str, column: int = COLUMN) -> str:
    """Return the page with another figure in a row. Raises ValueError if the page has no such row."""
    lines = text.split("\n")
    place = next((k for k, line in enumerate(lines) if line.startswith(f"| {row} |")), None)
    if place is None:
        raise ValueError(f"{PAGE}: no row {row}")
    cells = lines[place].strip("| ").split(" | ")
    cells[column] = figure
    lines[place] = f"| {' | '.join(cells)} |"
    return "\n".join(lines)


def _card(name: str, pattern: str) -> str:
    """The first match of a pattern in a model card."""
    return re.findall(pattern, _weights(name).read_text(encoding="utf-8"))[0]


def _weights(name: str) -> Path:
    """The place of a packaged network or card."""
    (path,) = [*ROOT.glob(f"src/bodysense/weights/{name}"), *ROOT.glob(f"packages/lab/src/*/weights/{name}")]
    return path


def _default(command: Callable[..., None], option: str) -> object:
    return signature(command).parameters[option].default


def _bracket(cell: str) -> str:
    return re.findall(r"\((.*)\)", cell)[0] if "(" in cell else cell


def _range(at: Cells, block: str, last: str, *labels: str) -> str:
    return f"{at(block, '0.1 s', *labels)} to {at(block, last, *labels)} cm"
