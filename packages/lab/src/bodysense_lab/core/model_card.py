"""Model cards: test figures in a network file, and a Markdown description next to it from `model_cards.toml`."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import onnx

from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense_lab.completion.networks import weights_file

Numbers = Mapping[str, float]
_FIGURE = re.compile(r"\{([^{}:]+):([^{}]+)\}")  # in a table: name and format


def describe(path: Path, figures: Numbers) -> Path:
    """Write test figures into a network file and a model card (Markdown) next to it. Returns the card's path.

    `figures` are those that the command for such networks wrote with --json; only those of the card's table are kept.
    Raises BodysenseError for a kind of file without cards, and for figures of another command or network.
    """
    fields, write = read_network(path)
    template, read = card_template(path, fields), parse_fields(fields)
    own = read.get("validation", {}).get("position_cm")
    scored = figures.get(f"model{read.get('model')}_validation_position_cm", own)
    if scored != own:
        raise BodysenseError(
            f"{path}: the figures are of another network (in validation {scored:g} cm, this one {own:g}); "
            f"write them with `bodysense evaluate hmd-vae --networks {path} --json FILE`"
        )
    try:
        _, used = filled_table(template, figures, read.get("model"))
    except KeyError as error:
        command = template["measured_by"]
        raise BodysenseError(f"the figures have no {error}; write them with `{command} --json FILE`") from None
    fields["test"] = json.dumps({name: round(figures[name], 3) for name in sorted(used)})
    with written_beside(path) as beside:
        write(beside, fields)
    card = path.with_suffix(".md")
    with written_beside(card) as beside:
        beside.write_text(card_text(path.name, template, fields), encoding="utf-8")
    return card


def card_templates() -> list[dict[str, Any]]:
    """Read the rows of `model_cards.toml`."""
    return tomllib.loads((files("bodysense_lab.core") / "model_cards.toml").read_text(encoding="utf-8"))["card"]


def card_template(path: Path, fields: Mapping[str, str]) -> dict[str, Any]:
    """Return the card template of a file, selected by its metadata."""
    key = (fields.get("format", "none"), json.loads(fields.get("task", '""')))
    known = {(row["format"], row.get("task", "")): row for row in card_templates()}
    if key not in known:
        names = ", ".join(" ".join(one).strip() for one in known)
        raise BodysenseError(f"{path}: no card for a network of format {key[0]!r}; there are cards for {names}")
    return known[key]


def filled_table(template: Mapping[str, Any], figures: Numbers, model: object) -> tuple[list[str], set[str]]:
    """Return the lines of a table with their figures, and the names of the figures.

    Rows after the first are omitted without their figures if the template has optional rows. Raises KeyError for
    another missing figure.
    """
    lines, used = list[str](), set[str]()
    for line in template["table"].replace("{model}", str(model)).splitlines():
        names = {name for name, _ in _FIGURE.findall(line)}
        if used and template.get("has_optional_rows", False) and not names <= figures.keys():
            continue
        lines.append(_FIGURE.sub(lambda match: format(figures[match[1]], match[2]), line))
        used |= names
    return lines, used


def card_text(name: str, template: Mapping[str, Any], fields: Mapping[str, str]) -> str:
    """Return the model card of a network file from its metadata, with a table if it contains test figures."""
    read = parse_fields(fields)
    tags = ("motion-capture", *template["tags"], "onnx" if name.endswith(".onnx") else "safetensors")
    head = ["---", "library_name: bodysense", f"license: {read['licence'].lower()}", "tags:", *(f"- {t}" for t in tags)]
    lines = [*head, "---", "", f"# {name}", "", template["description"], "", *network_lines(read), ""]
    if "test" in read:
        command = f"`{template['measured_by']} --data DIR`"
        lines += [
            f"{template['over']} ({command}):",
            "",
            *filled_table(template, read["test"], read.get("model"))[0],
            "",
        ]
    return "\n".join([*lines, f"Not for: {template['not_for']}; identifying people, medical judgement.", ""])


def network_lines(read: Mapping[str, Any]) -> list[str]:
    """Return the lines of a card about the network itself, from its metadata."""
    if "fastest_rate" in read:
        rate = f"up to {read['fastest_rate']:g} Hz"
    else:
        rate = f"{read['rate']:g} Hz" if "rate" in read else "any rate"
    seed = f"; seed {read['seed']}" if "seed" in read else ""
    validation = ", ".join(f"{key} {value}" for key, value in read.get("validation", {}).items())
    return [
        f"- {describe_network(read)}, {read['weights']:,} weights, steps at {rate}",
        f"- trained on: {read.get('training_data', 'unknown')}",
        f"- licence: {read.get('licence', 'unknown')}{seed}",
        *([f"- validation: {validation}"] if validation else []),
    ]


def describe_network(card: Mapping[str, Any]) -> str:
    """Return the kind and size of a network."""
    network = card.get("network")
    if network is None:
        return "a network"
    if "reads_hand" in network:
        memory = f"GRU of {network['memory']}, then " if network.get("memory") else ""
        return f"{card['form']}: {memory}layers of {', '.join(str(width) for width in network['layers'])}"
    if "spatial_width" in network:
        spatial = f", over joints {network['spatial_layers']} × {network['spatial_width']}"
        size = f"{network['layers']} × {network['width']} over time{spatial if network['kind'] == 'pahmt' else ''}"
        return f"{network['kind'].upper()}, windows of {network['frames']} frames: {size}"
    if "dilations" in network:
        return f"{len(network['dilations'])} blocks of convolutions, {network['width']} wide"
    if "hidden" not in network:
        return f"model {network['model']}: β {network['beta']:g}, d {network['latent']}, {network['blocks']} blocks"
    layers = network.get("layers", 1)
    size = f"{network['hidden']}" if layers == 1 else f"{layers} × {network['hidden']}"
    return (f"{card['form']}: " if "form" in card else "") + f"GRU of {size}"


def read_network(path: Path) -> tuple[dict[str, str], Callable[[Path, dict[str, str]], None]]:
    """Return the metadata of a network file, and a function that writes the file with other metadata."""
    if path.suffix == ".safetensors":
        tensors, fields = weights_file.read_safetensors(path)

        def write_tensors(out: Path, card: dict[str, str]) -> None:
            out.write_bytes(weights_file.safetensors_bytes(tensors, card))

        return fields, write_tensors
    try:
        model = onnx.load(str(path))
    except Exception as error:  # protobuf's own classes
        raise BodysenseError(f"{path}: not a readable ONNX model ({type(error).__name__})") from None

    def write(out: Path, card: dict[str, str]) -> None:
        onnx.helper.set_model_props(model, card)
        onnx.save(model, str(out))

    return {row.key: row.value for row in model.metadata_props}, write


def parse_fields(fields: Mapping[str, str]) -> dict[str, Any]:
    """Parse the metadata of a file."""
    return {key: json.loads(value) for key, value in fields.items() if key != "format"}
