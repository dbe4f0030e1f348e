"""A whole training run of HMD-VAE: one network, or the paper's sweep over many (section 5.3), resumable."""

from __future__ import annotations

import hashlib
import itertools
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from lightning_fabric import Fabric

from bodysense.errors import BodysenseError
from bodysense.files import check_folder, check_place, make_folder
from bodysense_lab.core.checkpoint import identity, write_weights_file
from bodysense_lab.core.fit import Report, announce_run, fit, set_seed_and_threads
from bodysense_lab.core.options import SplitReader
from bodysense_lab.core.sweep import is_trained_as_configured, sweep
from bodysense_lab.core.table import write_rows
from bodysense_lab.data.windows import Windows
from bodysense_lab.papers.hmd_vae.frames import (
    TRAIN_LENGTH,
    BodyFrames,
    held_out,
    read_body_frames,
)
from bodysense_lab.papers.hmd_vae.network import BodyVae, pretrained, read_vae
from bodysense_lab.papers.hmd_vae.options import MODELS, BodyVaeConfig, Grid, VaeRun
from bodysense_lab.papers.hmd_vae.split_list import read_split_file
from bodysense_lab.papers.hmd_vae.task import VaeTask, joint_errors

BETAS, LATENTS, BLOCKS = (0.0001, 0.01, 0.1, 1.0, 5.0), (15, 30, 60), (3, 6)  # the paper's 30 settings
FEW_BETAS, FEW_LATENTS = (0.01, 1.0), (30,)  # of these, what a small machine trains: 4 settings


@dataclass(frozen=True, eq=False)
class VaeData:
    """Training and validation data of a run."""

    frames: BodyFrames
    train: Windows
    within: Windows  # of sequences of the training people that were held out
    validation: tuple[BodyFrames, Windows]  # other people; with a split list, `within`

    @property
    def note(self) -> str:
        """For a card."""
        people = len(set(self.frames.person))
        return f"{len(self.frames)} sequences of {people} people, {self.frames.minutes:.0f} minutes at 30 Hz"


def read_data(run: VaeRun, clips: SplitReader) -> VaeData:
    """The training split, 5 % of its sequences held out, and the validation people."""
    frames = read_body_frames(clips("train"))
    kept_out = held_out(frames.person, np.random.default_rng(run.schedule.seed))
    within = frames.windows(TRAIN_LENGTH, clips=np.flatnonzero(kept_out))
    learned = frames.windows(TRAIN_LENGTH, clips=np.flatnonzero(~kept_out))
    if run.split_file is not None:
        if not len(within):
            raise BodysenseError(f"{run.split_file}: one training sequence cannot also be held out; list more")
        return VaeData(frames, learned, within, (frames, within))
    others = read_body_frames(clips("val"))
    return VaeData(frames, learned, within, (others, others.windows(TRAIN_LENGTH)))


def run_vae(run: VaeRun, clips: SplitReader) -> None:
    """Train one network; the weights (.pt), log (.jsonl) and checkpoint (.ckpt) are written next to `run.out`."""
    check_place(run.out)
    weights, whole = run.out.with_suffix(".pt"), whole_body(run)
    fabric = announce_run(run, VaeTask)
    if not is_trained(run, weights, whole):
        data = read_data(run, clips)
        fabric.print(f"{data.note}; {len(data.train)} windows")
        train_network(run, weights, whole, data, fabric)
    if not fabric.is_global_zero:
        return
    network, card = read_vae(weights)
    if run.out.suffix == ".onnx":
        from bodysense_lab.papers.hmd_vae.export import write_vae_onnx

        write_vae_onnx(network, run.out, card)
    print(f"wrote {run.out} ({run.out.stat().st_size / 1e6:.1f} MB)")


def whole_body(run: VaeRun) -> BodyVae | None:
    """The model 0 whose decoder models 3 and 4 take. Raises BodysenseError where it is missing or of no use."""
    if not run.config.pretrained:
        if run.decoder is not None:
            raise BodysenseError(f"--decoder is for models 3 and 4; model {run.config.model} trains its own")
        return None
    if run.decoder is None:
        raise BodysenseError(
            f"model {run.config.model} takes the decoder of a model 0: train that first "
            "(`bodysense train hmd-vae --model 0 …`) and give its .pt as --decoder"
        )
    whole, _ = read_vae(run.decoder)
    pretrained(run.config, whole)
    return whole


def train_network(
    run: VaeRun, weights: Path, whole: BodyVae | None, data: VaeData, fabric: Fabric, report: Report | None = None
) -> None:
    """Train one network and write its weights, with a card that says what they are."""
    set_seed_and_threads(run.schedule.seed, run.threads)
    network = BodyVae(run.config) if whole is None else pretrained(run.config, whole)
    begun, source = time.monotonic(), source_of(run, whole, data)
    task = VaeTask(network, run.schedule, data.frames, data.train, data.validation, source)
    fit(task, weights.with_suffix(".ckpt"), report, fabric, report)
    network = network.cpu()
    error = joint_errors(network, *data.validation)
    card = {
        "identity": identity(network.config, run.schedule, source),
        "model": run.config.model,
        "licence": run.licence,
        "training_data": run.data_note or data.note,
        "seed": run.schedule.seed,
        "steps": run.schedule.steps,
        "seconds": round(time.monotonic() - begun, 1),
        "validation_position_cm": round(100 * float(error.mean()), 3),
        "within_position_cm": round(100 * float(joint_errors(network, data.frames, data.within).mean()), 3),
        "expected_error": [round(float(value), 4) for value in error],
    }
    if fabric.is_global_zero:
        write_weights_file(network, weights, card)
    fabric.barrier()


def source_of(run: VaeRun, whole: BodyVae | None, data: VaeData | None = None) -> dict[str, Any]:
    """Return the sources of a run for its identity, with their amount if the data have been read."""
    source: dict[str, Any] = {
        "data": str(run.data.resolve()),
        "split_file": None,
        "decoder": None,
        **run.trial_settings,
    }
    if run.split_file is not None:
        source["split_file"] = _digest(json.dumps(read_split_file(run.split_file)).encode())
    if whole is not None:
        source["decoder"] = _digest(*(value.numpy().tobytes() for value in whole.decoder.state_dict().values()))
    if data is not None:
        source["learned"] = {"sequences": len(data.frames), "frames": int(data.frames.length.sum())}
    return source


def is_trained(run: VaeRun, weights: Path, whole: BodyVae | None, data: VaeData | None = None) -> bool:
    """Whether the weights are there, trained as this run asks. Raises BodysenseError if trained otherwise.

    How much was learned is compared where `data` is given.
    """
    if not weights.is_file():
        return False
    saved = json.loads(read_vae(weights)[1]["identity"])
    if data is None:
        saved.get("source", {}).pop("learned", None)
    now = identity(run.config, run.schedule, source_of(run, whole, data))
    return is_trained_as_configured(weights, json.dumps(saved), now)


def sweep_name(config: BodyVaeConfig) -> str:
    """Return the name of a network's files in a sweep; settings outside the grid appear if they are not the default."""
    name = f"model{config.model}-beta{config.beta:g}-latent{config.latent}-blocks{config.blocks}"
    name += f"-{config.origin}" if config.origin != BodyVaeConfig.origin else ""
    return name + (f"-samples{config.samples}" if config.samples != BodyVaeConfig.samples else "")


def swept(run: VaeRun, config: BodyVaeConfig) -> VaeRun:
    """The run of one network of a sweep."""
    decoder = run.out / f"{sweep_name(replace(config, model=0))}.pt" if config.pretrained else None
    plain = {one.name: getattr(run, one.name) for one in fields(VaeRun)}
    return VaeRun(**plain | {"config": config, "out": run.out / f"{sweep_name(config)}.pt", "decoder": decoder})


def sweep_configs(config: BodyVaeConfig, grid: Grid) -> list[BodyVaeConfig]:
    """The networks of a sweep, a setting's model 0 before its others; what is not swept is `config`'s."""
    settings = {
        "one": ((config.beta,), (config.latent,), (config.blocks,)),
        "few": (FEW_BETAS, FEW_LATENTS, BLOCKS),
        "all": (BETAS, LATENTS, BLOCKS),
    }
    return [
        replace(config, model=model, beta=beta, latent=latent, blocks=blocks)
        for beta, latent, blocks in itertools.product(*settings[grid])
        for model in MODELS
    ]


def run_sweep(run: VaeRun, configs: Sequence[BodyVaeConfig], clips: SplitReader) -> None:
    """Train what is not trained yet into the folder `run.out`; the results of all in its results.csv."""
    runs = {sweep_name(config): swept(run, config) for config in configs}
    paths = [one.out for one in runs.values()]
    check_folder(run.out)
    fabric = announce_run(run, VaeTask)
    if not all(is_swept(one) for one in runs.values()):
        data = read_data(run, clips)
        make_folder(run.out)

        def train(name: str, report: Report) -> str:
            one = runs[name]
            train_network(one, one.out, whole_body(one), data, fabric, report)
            if fabric.is_global_zero:
                write_results(run.out / "results.csv", paths)
            return f"trained {name}: validation {read_vae(one.out)[1]['validation_position_cm']:.2f} cm"

        steps = dict.fromkeys(runs, run.schedule.steps)
        sweep(steps, train, lambda name: is_swept(runs[name], data), run.out, quiet=not fabric.is_global_zero)
    if fabric.is_global_zero:
        write_results(run.out / "results.csv", paths)
    fabric.print(f"{len(runs)} networks in {run.out}, results in {run.out / 'results.csv'}")


def is_swept(run: VaeRun, data: VaeData | None = None) -> bool:
    """`is_trained` of a network of a sweep; not before its decoder is, on which it depends."""
    if run.decoder is not None and not run.decoder.is_file():
        return False
    return is_trained(run, run.out, whole_body(run), data)


def _digest(*parts: bytes) -> str:
    return hashlib.sha256(b"".join(parts)).hexdigest()[:12]


def write_results(path: Path, weights: Sequence[Path]) -> None:
    """A row a network that is trained: its setting, time and errors."""
    settings = ("model", "beta", "latent", "blocks", "samples", "origin")
    columns = (*settings, "steps", "seconds", "validation_position_cm", "within_position_cm", "seed")
    rows = []
    for one in weights:
        if one.is_file():
            network, card = read_vae(one)
            values: dict[str, Any] = {**vars(network.config), **card}
            rows.append((one.stem, *(values[name] for name in columns)))
    write_rows(path, ("network", *columns), rows)
