"""Table of docs/reproduce.md: processor hours of trainings and of whole commands."""

from __future__ import annotations

from bodysense_lab.papers.hmd_vae.options import MODELS, BodyVaeConfig
from bodysense_lab.papers.hmd_vae.train import sweep_configs

from .blocks import Block, Numbers, markdown

SWEPT_STEPS = 20  # of each network of the whole grid
RATE = 30 * 60  # frames of a minute of motion
MINUTES, WITH_FINGERS = 404 + 23, 23  # minutes of the train split (see the cards of the networks)
EPOCHS, BATCH = 5, 256  # of the paper's body network
# Steps of whole commands, and their derivation. The body network uses clips twice, clips with fingers eight times.
STEPS = {
    "train body-gru --form paper": (
        EPOCHS * RATE * (2 * MINUTES + 6 * WITH_FINGERS) // BATCH,
        "5 epochs of 427 minutes, twice (with fingers eight times), in steps of 256",
    ),
    "train unoc-tables": (
        EPOCHS * RATE * MINUTES // 24 // BATCH,
        "one GRU; 5 epochs of every 24th window of 427 minutes, in steps of 256",
    ),
    "train hmd-vae": (6000, "one network"),
    "train arms --model ahmt": (300 * RATE * WITH_FINGERS // 128, "300 epochs of 23 minutes, in steps of 128"),
    "train arms --model pahmt": (300 * RATE * WITH_FINGERS // 128, "300 epochs of 23 minutes, in steps of 128"),
    "train hmd-vae --sweep --grid one": (6000 * len(MODELS), f"{len(MODELS)} networks"),
    "train hmd-vae --sweep --grid all": (
        SWEPT_STEPS * len(sweep_configs(BodyVaeConfig(), "all")),
        f"{len(sweep_configs(BodyVaeConfig(), 'all'))} networks, {SWEPT_STEPS} steps each",
    ),
    "train gloves --form paper --network markers": (20_000, ""),
    "train gloves --form paper --network joints": (20_000, ""),
}
BOTH = "train gloves --form paper"  # trains the network of markers and that of joints
LIKE = {  # the same networks
    "train unoc-tables": "train body-gru --form paper",
    "train hmd-vae --sweep --grid one": "train hmd-vae",
    "train hmd-vae --sweep --grid all": "train hmd-vae",
}
WHOLE = ("papers generate", "papers track --method two_hands")  # on the packaged performance of 25 s


def hours(measured: Numbers) -> str:
    """Return seconds of a step, steps and hours of each training that was measured."""
    rows, gloves = [], 0.0
    for name, (steps, remark) in STEPS.items():
        seconds = measured.get(f"{LIKE.get(name, name)}_seconds_a_step")
        if seconds is not None:
            whole = seconds * steps / 3600
            gloves += whole if name.startswith(BOTH) else 0.0
            rows.append(
                [f"`{name}`", f"{seconds:.3f}", f"{steps:,}", f"{whole:.0f}" if whole >= 10 else f"{whole:.2g}", remark]
            )
    if gloves:
        rows.append([f"`{BOTH}`", "–", "–", f"{gloves:.2g}", "both networks"])
    for name in WHOLE:
        if f"{name}_seconds" in measured:
            taken = measured[f"{name}_seconds"] / 3600
            rows.append([f"`{name}`", "–", "–", f"{taken:.2g}", "the whole command"])
    return markdown(("training", "s a step", "steps", "CPU hours", ""), rows)


BLOCKS = [Block("docs/reproduce.md", "hours", hours, ("hours",))]
