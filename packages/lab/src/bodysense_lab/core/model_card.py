"""Model cards: test figures in a network file, and a Markdown description next to the file."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import onnx

from bodysense.devices.gloves import networks as glove
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.devices.video import arms
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.papers import hmd_vae as body_vae
from bodysense.papers import point_model
from bodysense.takes import joining_network
from bodysense_lab.completion.networks import weights_file
from bodysense_lab.completion.training.options import BODIES, BODY_TITLES, TABLE_SETS
from bodysense_lab.papers.unoc import learned

Numbers = Mapping[str, float]
_FIGURE = re.compile(r"\{([^{}:]+):([^{}]+)\}")  # in a cell: name and format


@dataclass(frozen=True)
class CardTemplate:
    """Text and table of the cards of one kind of network."""

    description: str
    measured_by: str  # the command whose --json gives the figures
    over: str  # heading of the table: people, motions, measure, unit
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]  # cells, with figures as `{name:.2f}`, in which `MODEL` is the card's model
    not_for: str
    tags: tuple[str, ...] = ("human-pose", "virtual-reality")  # of the front matter, after the first
    has_optional_rows: bool = False  # whether rows after the first are omitted if their figures are missing

    def fill_rows(self, figures: Numbers, model: object) -> tuple[list[tuple[str, ...]], set[str]]:
        """Return the rows with their figures, and the names of the figures. Raises KeyError for a missing figure."""
        rows, used = list[tuple[str, ...]](), set[str]()
        for number, row in enumerate(self.rows):
            cells = [cell.replace("MODEL", str(model)) for cell in row]
            names = {name for cell in cells for name, _ in _FIGURE.findall(cell)}
            if number and self.has_optional_rows and not names <= figures.keys():
                continue
            rows.append(tuple(_FIGURE.sub(lambda found: format(figures[found[1]], found[2]), cell) for cell in cells))
            used |= names
        return rows, used


def describe(path: Path, figures: Numbers) -> Path:
    """Write test figures into a network file and a model card (Markdown) next to it. Returns the card's path.

    `figures` are those that the command for such networks wrote with --json; only those of the card's table are kept.
    Raises BodysenseError for a kind of file without cards, and for figures of another command or network.
    """
    fields, write = read_network(path)
    kind, read = card_template(path, fields), parse_fields(fields)
    own = read.get("validation", {}).get("position_cm")
    scored = figures.get(f"model{read.get('model')}_validation_position_cm", own)
    if scored != own:
        raise BodysenseError(
            f"{path}: the figures are of another network (in validation {scored:g} cm, this one {own:g}); "
            f"write them with `bodysense evaluate hmd-vae --networks {path} --json FILE`"
        )
    try:
        _, used = kind.fill_rows(figures, read.get("model"))
    except KeyError as error:
        raise BodysenseError(f"the figures have no {error}; write them with `{kind.measured_by} --json FILE`") from None
    fields["test"] = json.dumps({name: round(figures[name], 3) for name in sorted(used)})
    with written_beside(path) as beside:
        write(beside, fields)
    card = path.with_suffix(".md")
    with written_beside(card) as beside:
        beside.write_text(card_text(path.name, kind, fields), encoding="utf-8")
    return card


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


def card_template(path: Path, fields: Mapping[str, str]) -> CardTemplate:
    """Return the card template of a file, selected by its metadata."""
    key = (fields.get("format", "none"), json.loads(fields.get("task", '""')))
    if key not in CARD_TEMPLATES:
        known = ", ".join(" ".join(key).strip() for key in CARD_TEMPLATES)
        raise BodysenseError(f"{path}: no card for a network of format {key[0]!r}; there are cards for {known}")
    return CARD_TEMPLATES[key]


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


def card_text(name: str, kind: CardTemplate, fields: Mapping[str, str]) -> str:
    """Return the model card of a network file from its metadata, with a table if it contains test figures."""
    read, table_lines = parse_fields(fields), list[str]()
    if "test" in read:
        rows = (kind.head, ("---",) * len(kind.head), *kind.fill_rows(read["test"], read.get("model"))[0])
        table_lines = [
            "",
            f"{kind.over} (`{kind.measured_by} --data DIR`):",
            "",
            *(f"| {' | '.join(row)} |" for row in rows),
        ]
    not_for_line = f"Not for: {kind.not_for}; identifying people, medical judgement."
    lines = [f"# {name}", "", kind.description, "", *network_lines(read), *table_lines, "", not_for_line, ""]
    return front_matter(name, kind, fields) + "\n".join(lines)


def front_matter(name: str, kind: CardTemplate, fields: Mapping[str, str]) -> str:
    """Return the YAML at the head of a card, by which model hubs list a network."""
    tags = ("motion-capture", *kind.tags, "onnx" if name.endswith(".onnx") else "safetensors")
    licence = parse_fields(fields)["licence"]
    return "\n".join(
        [
            *("---", "library_name: bodysense", f"license: {licence.lower()}", "tags:"),
            *(f"- {tag}" for tag in tags),
            *("---", "", ""),
        ]
    )


def parse_fields(fields: Mapping[str, str]) -> dict[str, Any]:
    """Parse the metadata of a file."""
    return {key: json.loads(value) for key, value in fields.items() if key != "format"}


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


def _error_pair(key: str) -> str:
    return f"{{{key}_rmsjpe_cm:.2f}} / {{{key}_mpjpe_cm:.2f}}"


_BODY_ROWS = tuple(
    (label, share, *(f"{{{method}_{part}_{share}_rmsjpe_cm:.1f}}" for method in ("last_known", "tracker")))
    for part, label in {"body": "body", "finger": "finger", "all": "body and finger"}.items()
    for share in ("occluded", "all")
)
_FINGER_ROWS = (
    ("this network", _error_pair("network")),
    ("this network, smoothed, on rigid bones", _error_pair("bodysense")),
    ("mean hand of the train split", _error_pair("mean_pose")),
    ("hand of the nearest body of the train split", _error_pair("nearest")),
)
_UPPER_BODY_ROWS = tuple(
    (joints, _error_pair(f"network_{joints}"), _error_pair(f"ik_{joints}"))
    for joints in ("neck", "shoulders", "elbows", "all")
)
_COMPLETION = tuple(
    (
        name.replace("_", " "),
        *(f"{{{name}_{body}_{'occluded_' if SENSOR_SETS[name].camera else ''}mpjpe_cm:.2f}}" for body in BODIES),
    )
    for name in TABLE_SETS
)
_TAKE_ROWS = tuple(
    (
        name.replace("_", " "),
        *(
            f"{{{name}_own_{take}{'occluded_' if SENSOR_SETS[name].camera else ''}mpjpe_cm:.2f}}"
            for take in ("", "take_")
        ),
        f"{{{name}_own_take_rotation_deg:.2f}}",
    )
    for name in TABLE_SETS
)
_VAE_ROWS = tuple(
    (
        label,
        *(f"{{modelMODEL_{part}_{measure}:.2f}}" for measure in ("position_cm", "velocity_cm_s", "acceleration_m_s2")),
    )
    for part, label in {"full": "full body", "legs": "legs"}.items()
)
_DURATION_HEAD = ("hidden markers", "0.1 s", "0.2 s", "0.5 s", "1 s", "2 s")
_GLOVE_ROWS = tuple(
    (str(hidden), *(f"{{nn_{hidden}_{duration}_cm:.2f}}" for duration in ("0.1", "0.2", "0.5", "1.0", "2.0")))
    for hidden in (1, 2, 3, 4)
)
_ARM_ROWS = tuple(
    (label, f"{{shipped_{key}:.{digits}f}}", f"{{ik_{key}:.{digits}f}}")
    for label, key, digits in (
        ("position of all joints of arms and hands, from the chest, cm", "overall_cm", 1),
        ("position of finger joints and tips, from their wrist, cm", "hands_cm", 2),
        ("rotation of collars, upper arms, forearms, hands, degrees", "arms_deg", 1),
        ("rotation of finger joints, degrees", "fingers_deg", 1),
        ("twist of the upper arm, degrees", "upper_arm_twist_deg", 1),
        ("twist of the forearm, degrees", "forearm_twist_deg", 1),
    )
)
CARD_TEMPLATES = {
    (learned.FORMAT, ""): CardTemplate(
        "Completes a body and its fingers from what a headset's cameras see (UNOC, Parger et al. 2021).",
        "bodysense evaluate unoc-table2",
        "Test people, main motions, RMSJPE in cm, through the tracker",
        ("part", "joints", "last known", "this network"),
        _BODY_ROWS,
        "bodies whose limbs differ from the skeleton's; hands that hold things, because fingers were learned from half "
        "an hour of avatar animation",
        has_optional_rows=True,
    ),
    (point_model.FORMAT, "fingers"): CardTemplate(
        "Predicts the fingers of a body from the motion of that body (UNOC, Parger et al. 2021, section 5.3).",
        "bodysense evaluate finger-synthesis",
        "Test actions, main motions, finger joints and tips from their wrist, RMSJPE / MPJPE in cm",
        ("method", "cm"),
        _FINGER_ROWS,
        "gestures that mean something, hands that hold or use things",
    ),
    (point_model.FORMAT, "upper-body"): CardTemplate(
        "Predicts the upper body from a headset and two controllers (UNOC, Parger et al. 2021, section 5.2).",
        "bodysense evaluate unoc-table6",
        "Test people, main motions, RMSJPE / MPJPE in cm, compared with inverse kinematics after Parger et al. 2018",
        ("joints", "network", "inverse kinematics"),
        _UPPER_BODY_ROWS,
        "legs, which it does not predict; floors that are not at y = 0",
    ),
    (weights_file.FORMAT, ""): CardTemplate(
        "Completes a whole body, in rotations, from any points that are tracked, on any adult's proportions.",
        "bodysense evaluate completion",
        "Test people and test bodies, main motions: MPJPE from the head, cm, with a camera that of hidden joints; "
        "the recording's own body and an unseen body are known",
        ("sensors", *(BODY_TITLES[body] for body in BODIES)),
        _COMPLETION,
        "children; people who carry or use things",
    ),
    (joining_network.FORMAT, ""): CardTemplate(
        "Joins two completions of a recording, one that knows its past and one that knows its future, to one body.",
        "bodysense evaluate completion --takes",
        "Test people, known bodies, main motions: MPJPE from the head, cm, with a camera that of hidden joints, live "
        "and with the future, and local rotations with it, degrees",
        ("sensors", "live cm", "take cm", "take rotation °"),
        _TAKE_ROWS,
        "live tracking; children; people who carry or use things",
    ),
    (glove.MARKER_FORMAT, ""): CardTemplate(
        "Predicts hidden markers of a glove from visible ones (Pavllo et al. 2019, section 3.2.2).",
        "bodysense evaluate gloves-table3",
        "Test actions, main motions, error of hidden markers on the last frame before they return, cm",
        _DURATION_HEAD,
        _GLOVE_ROWS,
        "gloves with markers in other places; hands that hold things",
        ("hand-tracking", "gloves"),
    ),
    (glove.JOINT_FORMAT, ""): CardTemplate(
        "Predicts the 26 angles of a hand from the nine markers of a glove (Pavllo et al. 2019, section 3.2.3).",
        "bodysense evaluate gloves-table4",
        "Test actions, main motions, error of the joints of fingers through the whole pipeline, cm",
        _DURATION_HEAD,
        (("0", "{nn_0_cm:.2f}", "", "", "", ""), *_GLOVE_ROWS),
        "gloves with markers in other places; hands that hold things",
        ("hand-tracking", "gloves"),
    ),
    (arms.FORMAT, ""): CardTemplate(
        "Predicts rotations of arms and hands from key-points of a video (PAHMT, Liu et al. 2022).",
        "bodysense evaluate pahmt-table1",
        "Test actions, main motions, in front of simulated cameras, with errors of the detector",
        ("error", "this network", "inverse kinematics on the true positions"),
        _ARM_ROWS,
        "hands that hold things, because fingers were learned from avatar animation",
        ("human-pose", "video"),
    ),
    (body_vae.FORMAT, ""): CardTemplate(
        "Samples whole bodies, several for one signal of head and hands or without a signal (HMD-VAE, Dittadi et al. "
        "2021).",
        "bodysense evaluate hmd-vae",
        "Test people, main motions, at the posterior's mean; the network of this model that was best in validation",
        ("joints", "position error, cm", "velocity error, cm/s", "acceleration, m/s²"),
        _VAE_ROWS,
        "the most accurate body, which the tracker gives; floors that are not at y = 0",
    ),
}
