"""Write the tables of README.md and of pages in docs/ from the numbers that the commands wrote.

    bodysense evaluate unoc-table2 --data DIR --json FIGURES/headset.json
    bodysense evaluate unoc-table2 --data DIR --networks NETWORKS --stride 8 --json FIGURES/unoc-table2.json
    … unoc-table3, unoc-table4, unoc-smoothness likewise, unoc-table5 with a folder of networks for each set
    bodysense evaluate completion --data DIR --json FIGURES/completion.json
    … the same with --limit 36 --takes --lattice, into FIGURES/completion-takes.json
    … the same with --split val --bodies own, into FIGURES/validation.json, for the card of the network
    bodysense evaluate holes --data DIR --json FIGURES/holes.json
    bodysense evaluate hmd-vae --data DIR --networks VAES --json FIGURES/hmd-vae.json
    bodysense evaluate unoc-table6 --data DIR --json FIGURES/unoc-table6.json
    bodysense evaluate finger-synthesis --data DIR --json FIGURES/finger-synthesis.json
    bodysense evaluate transitions --data DIR --json FIGURES/transitions.json        (and reliability)
    bodysense bench step --json FIGURES/step.json        (and ik, occlusion, bvh, import, training)
    bodysense data info DIR --occlusion --split test --json FIGURES/hidden.json
    … the same with --camera.solid-scale 0.8, with --camera.nose-distance 0, with both, into FIGURES/hidden_….json
    bodysense demo --out FIGURES/demo
    python scripts/readme_figures.py FIGURES

VAES comes from `bodysense train hmd-vae --sweep --grid one`, NETWORKS from `bodysense train unoc-tables
--window-stride 24 --batch-scale 0.25`. If a file is missing, its table stays unchanged.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from bodysense.cli.show import processor
from bodysense.devices.simulated.sensors import SENSOR_SETS, TABLE_SETS
from bodysense_lab.hmd_vae.tables import PUBLISHED as THREE_POINT
from bodysense_lab.holes import PARTS as HOLES
from bodysense_lab.holes import SECONDS
from bodysense_lab.model_card import fields_read, network_lines, read_network
from bodysense_lab.score_table import ScoreTable
from bodysense_lab.unoc.occlusion import PUBLISHED
from bodysense_lab.unoc.smoothness import PUBLISHED as STRONG
from bodysense_lab.unoc.tables import PLACES, TABLE_3, TABLE_4
from bodysense_lab.unoc.variants import TABLES, VARIANTS

ROOT = Path(__file__).parents[1]
README, OCCLUSION = ROOT / "README.md", ROOT / "docs" / "occlusion.md"
COMPLETION = ROOT / "docs" / "completion.md"
FILES = ROOT / "docs" / "files.md"
DEMO = ROOT / "docs" / "figures" / "demo.webp"
CARD = ROOT / "src" / "bodysense" / "weights" / "completion.md"
BODIES = ("own", "stranger", "height", "nothing")
EVALUATION, PAPERS = ROOT / "docs" / "evaluation.md", ROOT / "docs" / "papers"
UNOC, VAE = PAPERS / "unoc.md", PAPERS / "hmd-vae.md"
GROUPS = {"": "main", "_sport": "sport", "_dance": "dance", "_other": "other"}
CATEGORIES = ("talk_gesture", "sit", "everyday", "locomotion", "all")
CAMERAS = {
    "hidden": "as it ships",
    "hidden_thin": "solids of 0.8",
    "hidden_thinner": "solids of 0.7",
    "hidden_back": "camera at the nose",
    "hidden_both": "solids of 0.7, camera at the nose",
    "hidden_tilted": "tilted down by 30°",
}
GROUPS_HIDDEN = ("shoulder", "elbow", "hand", "hip", "knee", "foot", "body", "all")
PARTS = {"body": "body", "finger": "fingers, from the wrist", "body_and_finger": "body and fingers"}


def main(folder: Path) -> None:
    """Replace the text between every pair of markers whose figures are in `folder`."""
    read = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("*.json")}
    if (folder / "demo" / "demo.webp").is_file():
        shutil.copyfile(folder / "demo" / "demo.webp", DEMO)
    CARD.write_text(put(CARD.read_text(encoding="utf-8"), "network", network(read.get("validation"))), encoding="utf-8")
    if {"completion", "completion-takes"} <= set(read):
        write_completion(read["completion"], read["completion-takes"])
    if "holes" in read:
        FILES.write_text(put(FILES.read_text(encoding="utf-8"), "holes", holes(read["holes"])), encoding="utf-8")
    tables = EVALUATION.read_text(encoding="utf-8")
    if "completion" in read:
        tables = put(tables, "sight", sight(read["completion"]))
    if {"step", "ik", "occlusion", "bvh", "import"} <= set(read):
        tables = put(tables, "speed", speed(read))
    EVALUATION.write_text(tables, encoding="utf-8")
    tables = UNOC.read_text(encoding="utf-8")
    if "headset" in read:
        tables = put(tables, "headset", headset(read["headset"]))
    if "unoc-table2" in read:
        tables = put(tables, "networks", networks(read["unoc-table2"]))
    if {"unoc-table6", "finger-synthesis"} <= set(read):
        tables = put(tables, "applications", applications(read["unoc-table6"], read["finger-synthesis"]))
    if "unoc-table3" in read:
        places = {"body, hidden": "body_occluded", "body, all": "body_all", "fingers, hidden": "finger_occluded"}
        tables = put(tables, "table3", ablations(read["unoc-table3"], TABLES["3"], places, TABLE_3))
    if "unoc-table5" in read:
        tables = put(tables, "table5", crossed(read["unoc-table5"]))
    if "unoc-smoothness" in read:
        tables = put(tables, "smoothness", smoothness(read["unoc-smoothness"]))
    if "unoc-table4" in read:
        bones = {"body, hidden": "body_occluded", "bones, body": "parent_body", "bone lengths, body": "bone_body"}
        tables = put(tables, "table4", ablations(read["unoc-table4"], TABLES["4"], bones, TABLE_4))
    if {"transitions", "reliability", "training"} <= set(read):
        tables = put(tables, "beyond", beyond(read["transitions"], read["reliability"], read["training"]))
    UNOC.write_text(tables, encoding="utf-8")
    if "hmd-vae" in read:
        VAE.write_text(put(VAE.read_text(encoding="utf-8"), "hmd-vae", vaes(read["hmd-vae"])), encoding="utf-8")
    rates = OCCLUSION.read_text(encoding="utf-8")
    if "hidden" in read:
        rates = put(rates, "occlusion", hidden(read["hidden"]))
    if set(CAMERAS) <= set(read):
        rates = put(rates, "cameras", cameras(read))
    OCCLUSION.write_text(rates, encoding="utf-8")


def write_completion(numbers: dict[str, float], sample: dict[str, float]) -> None:
    """Replace the tables of `evaluate completion` in the README, the page of completion and the network's card.

    `numbers` are of all clips; `sample` has takes and the lattice of sensor sets, of some.
    """
    short = completion(numbers | {key: sample[key] for key in sample if key.startswith("lattice_")})
    for path in (README, CARD):
        path.write_text(put(path.read_text(encoding="utf-8"), "completion", short), encoding="utf-8")
    text = COMPLETION.read_text(encoding="utf-8")
    tables = {"completion": completion_measures(numbers), "published": published(numbers), "takes": takes(sample)}
    for name, table in tables.items():
        text = put(text, name, table)
    COMPLETION.write_text(text, encoding="utf-8")


def network(validation: dict[str, float] | None) -> str:
    """Return what the completion network's file says of itself, and its validation figures if there are any."""
    fields, _ = read_network(CARD.with_suffix(".safetensors"))
    lines = network_lines(fields_read(fields))
    if validation is not None:
        figures = ", ".join(
            f"{_sensors(name)} {_figure(validation, f'{name}_own_{_position(name)}')}" for name in TABLE_SETS
        )
        lines.append(f"- validation people, known bodies, cm: {figures}")
    return "\n".join(lines)


def takes(numbers: dict[str, float]) -> str:
    """Live and with past and future, by sensors; of a headset's cameras the hidden joints."""
    rows = []
    for name in TABLE_SETS:
        error = "occluded_mpjpe_cm" if name == "headset_camera" else "mpjpe_cm"
        keys = [
            f"{name}_own_{error}",
            f"{name}_own_take_{error}",
            f"{name}_nothing_{error}",
            f"{name}_nothing_take_{error}",
        ]
        keys += [f"{name}_own_take_rotation_deg", f"{name}_own_take_jumps_per_minute"]
        if keys[1] in numbers:
            rows.append([name.replace("_", " "), *(f"{numbers[key]:.2f}" if key in numbers else "–" for key in keys)])
    head = ["sensors", "known body, live cm", "take cm", "unknown body, live cm", "take cm", "take rotation °"]
    command = f"`bodysense evaluate completion --data DIR{_limit(numbers)} --takes`: {numbers['clips']:.0f} clips."
    return f"{markdown([*head, 'take jumps/min'], rows)}\n\n{command}"


def holes(numbers: dict[str, float]) -> str:
    """Errors of filled holes by part and length, and those of the best other method."""
    rows = []
    for part in HOLES:
        cells = []
        for seconds in SECONDS:
            key = f"{part}_{seconds:g}"
            found = f"{key}_cm" in numbers
            cells.append(f"{numbers[f'{key}_cm']:.2f} ({numbers[f'{key}_best_other_cm']:.2f})" if found else "–")
        rows.append([part.replace("_", " "), *cells])
    return markdown(["part", *(f"{seconds:g} s" for seconds in SECONDS)], rows)


def headset(numbers: dict[str, float]) -> str:
    """Errors by motion, part and joints."""
    rows = []
    for suffix, group in GROUPS.items():
        for part, label in PARTS.items():
            for share in ("occluded", "all"):
                key = PLACES[part, share].key
                if f"tracker_{key}_rmsjpe_cm{suffix}" not in numbers:
                    continue
                pairs = [
                    [numbers[f"{who}_{key}_{measure}_cm{suffix}"] for measure in ("rmsjpe", "mpjpe")]
                    for who in ("last_known", "tracker")
                ]
                cells = [f"{rmsjpe:.1f} / {mpjpe:.1f}" for rmsjpe, mpjpe in pairs]
                ratio = " / ".join(f"{ours / known:.2f}" for known, ours in zip(*pairs, strict=True))
                rows.append([group, label, share, *cells, ratio])
    head = ["motion", "part", "joints", "last known", "bodysense", "ratio"]
    command = (
        f"`bodysense evaluate unoc-table2 --data DIR`: {numbers['clips']:.0f} clips, {numbers['seconds'] / 60:.0f} min"
    )
    return f"{markdown(head, rows)}\n\nRMSJPE / MPJPE in cm. {command}."


def completion(numbers: dict[str, float]) -> str:
    """Sensor sets by bodies, short: mean errors of joints, and what holds of confidence and of more sensors."""
    rows = [
        [_sensors(name), *(_figure(numbers, f"{name}_{body}_{_position(name)}") for body in BODIES)]
        for name in TABLE_SETS
    ]
    head = ["sensors", "own body", "stranger's", "only height known", "nothing known"]
    text = [
        f"`bodysense evaluate completion --data DIR{_limit(numbers)}`: {numbers['clips']:.0f} clips, main motions, cm.",
        "22 joints from the head; of the headset's cameras the joints that they do not see, in the world.",
    ]
    if "headset_camera_stranger_ratio" in numbers:
        ratio = [numbers[f"headset_camera_{body}_ratio"] for body in ("own", "stranger")]
        text.append(
            f"These are {ratio[0]:.2f} (own body) and {ratio[1]:.2f} (stranger's) of the best way to keep the last "
            "known place (RMSJPE)."
        )
    if "lattice_edges" in numbers:
        text.append(
            f"One sensor more is worse by over 1 % in {numbers['lattice_violations']:.0f} of "
            f"{numbers['lattice_edges']:.0f} random pairs of sensor sets."
        )
    return f"{markdown(head, rows)}\n\n" + "\n".join(text)


def _limit(numbers: dict[str, float]) -> str:
    """Return the option of a command that scored some of the clips; empty if it scored all."""
    return f" --limit {numbers['clips']:.0f}" if numbers["clips"] < numbers["clips_in_split"] else ""


def completion_measures(numbers: dict[str, float]) -> str:
    """Every measure of every set, told bodies; and confidence."""
    measures = {
        "rotation °": "rotation_deg",
        "lower cm": "lower_mpjpe_cm",
        "upper cm": "upper_mpjpe_cm",
        "velocity cm/s": "velocity_cm_s",
        "jitter": "jitter",
        "skate cm/s": "skate_cm_s",
        "under floor cm": "depth_cm",
        "jumps/min": "jumps_per_minute",
    }
    rows = [
        [
            _sensors(name),
            body,
            _figure(numbers, f"{name}_{body}_{_position(name)}"),
            *(_figure(numbers, f"{name}_{body}_{measure}") for measure in measures.values()),
        ]
        for name in TABLE_SETS
        for body in BODIES
        if f"{name}_{body}_mpjpe_cm" in numbers
    ]
    trust = [
        [
            _sensors(name),
            _figure(numbers, f"{name}_ece", 3),
            _figure(numbers, f"{name}_cover90", 3),
            _figure(numbers, f"{name}_spearman"),
        ]
        for name in TABLE_SETS
        if f"{name}_ece" in numbers
    ]
    sure = [
        [
            _sensors(name),
            body,
            _between(numbers, f"{name}_{body}"),
            "" if body == "own" else _between(numbers, f"{name}_{body}_minus_own", signed=True),
        ]
        for name in TABLE_SETS
        for body in BODIES
        if f"{name}_{body}_low_cm" in numbers
    ]
    first = markdown(["sensors", "body", "MPJPE cm", *measures], rows)
    second = markdown(["expected errors", "ECE", "within the 90 % interval", "rank correlation with the true"], trust)
    text = f"{first}\n\nJitter in 10² m/s³; skate of feet that truly stand.\n\n"
    if sure:
        text += markdown(["sensors", "body", "MPJPE lies between, cm", "more than own, cm"], sure)
        text += "\n\n95 % intervals by bootstrap over people. "
        text += "A difference with 0 in its interval is not significant.\n\n"
    return text + second


def _between(numbers: dict[str, float], key: str, signed: bool = False) -> str:
    sign = "+" if signed else ""
    return f"{numbers[f'{key}_low_cm']:{sign}.2f} to {numbers[f'{key}_high_cm']:{sign}.2f}"


SIGHT = {  # measures of sight: column, and the factor of its figures
    "jumps_per_minute": ("jumps/min", 1),
    "jumps_at_change_per_minute": ("at a change", 1),
    "extra_jumps_per_minute": ("by a blink", 1),
    "frozen_share": ("frozen %", 100),
    "float_share": ("float %", 100),
    "knee_excess_deg": ("knee over °", 1),
    "false_steps_per_minute": ("false steps/min", 1),
    "missed_steps_share": ("missed %", 100),
    "wrong_foot_share": ("wrong %", 100),
    "reentry_speed_m_s": ("re-entry m/s", 1),
    "pj_ratio": ("PJ", 1),
    "measured_p95_cm": ("seen p95 cm", 1),
    "measured_covered": ("in its bound %", 100),
}


def sight(numbers: dict[str, float]) -> str:
    """Return the measures of sight of every scored sensor set, with known proportions."""
    rows = [
        [
            _sensors(sensors),
            *(_scaled(numbers, f"{sensors}_own_{name}", factor) for name, (_, factor) in SIGHT.items()),
        ]
        for sensors in TABLE_SETS
        if f"{sensors}_own_jumps_per_minute" in numbers
    ]
    head = ("sensors", *(name for name, _ in SIGHT.values()))
    return (
        f"{markdown(head, rows)}\n\nThe recording's own body, known; main categories of {numbers['clips']:.0f} clips."
    )


def _scaled(numbers: dict[str, float], key: str, factor: float) -> str:
    return f"{factor * numbers[key]:.2f}" if key in numbers else "–"


def published(numbers: dict[str, float]) -> str:
    """Return the figures of three points, next to published ones."""
    columns = ("mpjpe_cm", "velocity_cm_s", "jitter")
    rows = [
        [f"bodysense, {body}", *(_figure(numbers, f"three_point_{body}_{column}") for column in columns)]
        for body in BODIES
        if f"three_point_{body}_mpjpe_cm" in numbers
    ]
    for name, (_, position, velocity, jerk) in THREE_POINT.items():
        rows.append([name, f"{position:.2f}", f"{velocity:.2f}", "–" if jerk is None else f"{jerk:.2f}"])
    return markdown(["three points", "MPJPE cm", "velocity cm/s", "jitter 10² m/s³"], rows)


def _sensors(name: str) -> str:
    return name.replace("_", " ")


def _position(name: str) -> str:
    return "occluded_mpjpe_cm" if SENSOR_SETS[name].camera else "mpjpe_cm"


def _figure(numbers: dict[str, float], key: str, digits: int = 2) -> str:
    return f"{numbers[key]:.{digits}f}" if key in numbers else "–"


def vaes(numbers: dict[str, float]) -> str:
    """HMD-VAE's models 1 to 4: full body and legs."""
    labels = {1: "1, head and hands now", 2: "2, their history", 3: "3, as 1, pretrained", 4: "4, as 2, pretrained"}
    measures = ("position_cm", "velocity_cm_s", "acceleration_m_s2")
    rows = [
        [
            label,
            *(f"{numbers[f'model{model}_{part}_{measure}']:.2f}" for part in ("full", "legs") for measure in measures),
        ]
        for model, label in labels.items()
    ]
    head = ["model", *(f"{part} {unit}" for part in ("full body", "legs") for unit in ("cm", "cm/s", "m/s²"))]
    return markdown(head, rows)


def networks(numbers: dict[str, float]) -> str:
    """UNOC's Table 2: hidden joints, ours (and the ratio to last known) and the paper's."""
    # Published RMSJPE, cm: body and fingers of GRU, RNN, LSTM, TCN, last known (Table 2).
    published = {"gru": (5.9, 4.1), "rnn": (6.1, 4.4), "lstm": (6.4, 4.3), "tcn": (6.2, 4.4), "last_known": (13.1, 5.0)}
    labels = {"gru": "GRU", "rnn": "RNN", "lstm": "LSTM", "tcn": "TCN", "best": "packaged", "last_known": "last known"}
    rows = []
    for name, label in labels.items():
        cells = []
        for column, part in enumerate(("body", "finger")):
            for measure in ("rmsjpe", "mpjpe"):
                ours, known = (numbers[f"{who}_{part}_occluded_{measure}_cm"] for who in (name, "last_known"))
                cells.append(f"{ours:.1f} ({ours / known:.2f})")
            theirs, known = published.get(name, (0, 0))[column], published["last_known"][column]
            cells.append(f"{theirs:.1f} ({theirs / known:.2f})" if theirs else "–")
        rows.append([label, *cells])
    head = ["network", "body RMSJPE", "MPJPE", "published RMSJPE", "finger RMSJPE", "MPJPE", "published RMSJPE"]
    return f"{markdown(head, rows)}\n\nOccluded joints, cm, and the ratio to last known in brackets."


def applications(upper: dict[str, float], fingers: dict[str, float]) -> str:
    """UNOC's Table 6 and finger synthesis: network, baselines, and the published figures."""
    # Published RMSJPE / MPJPE, cm, on UNOC's data: network, inverse kinematics (Table 6); fingers (Table 5, right).
    published = {
        "neck": ("1.1 / 0.9", "3.9 / 3.5"),
        "shoulders": ("2.7 / 2.3", "7.5 / 6.2"),
        "elbows": ("3.5 / 2.9", "10.3 / 7.8"),
        "all": ("2.3 / 1.7", "8.3 / 6.3"),
    }

    def pair(numbers: dict[str, float], name: str) -> str:
        return f"{numbers[f'{name}_rmsjpe_cm']:.1f} / {numbers[f'{name}_mpjpe_cm']:.1f}"

    rows = [
        [
            joints,
            pair(upper, f"network_{joints}"),
            pair(upper, f"ik_{joints}"),
            f"{upper[f'network_{joints}_rmsjpe_cm'] / upper[f'ik_{joints}_rmsjpe_cm']:.2f}",
            *theirs,
        ]
        for joints, theirs in published.items()
    ]
    first = markdown(["three points", "network", "inverse kinematics", "ratio", "published", "published IK"], rows)
    names = {"network": "network", "mean_pose": "mean hand", "nearest": "hand of the nearest body"}
    second = markdown(
        ["fingers from the body", "RMSJPE / MPJPE", "network below it by"],
        [
            [
                label,
                pair(fingers, name),
                ""
                if name == "network"
                else f"{100 * (1 - fingers['network_rmsjpe_cm'] / fingers[f'{name}_rmsjpe_cm']):.0f} %",
            ]
            for name, label in names.items()
        ],
    )
    return f"{first}\n\n{second}\n\nRMSJPE / MPJPE, cm. The paper's fingers: 1.5 / 0.8 on its own data."


def ablations(numbers: dict[str, float], names: Sequence[str], parts: dict[str, str], paper: ScoreTable) -> str:
    """UNOC's Tables 3 and 4: RMSJPE in cm of other forms of the network, the change from the GRU, published figures."""
    rows = []
    for name in names:
        cells = []
        for key in parts.values():
            ours, gru = numbers[f"{name}_{key}_rmsjpe_cm"], numbers[f"gru_{key}_rmsjpe_cm"]
            cells.append(f"{ours:.2f}" + ("" if name == "gru" else f" ({100 * (ours / gru - 1):+.0f} %)"))
            cells += published_cells(paper, name, key)
        rows.append([VARIANTS[name].title, *cells])
    heads = [
        head for part, key in parts.items() for head in (part, *["published"] * len(published_cells(paper, "gru", key)))
    ]
    return markdown(["network", *heads], rows)


def published_cells(paper: ScoreTable, name: str, key: str) -> list[str]:
    """The published RMSJPE of a cell in a list; empty where the paper has no such cell."""
    at = next((at for at in paper.rows or () if PLACES[at].key == key), None)
    figures = paper.published[0].cells.get((at, name))
    return [] if figures is None else [f"{figures[0]:.2f}"]


def crossed(numbers: dict[str, float]) -> str:
    """UNOC's Table 5: hidden joints of the body and synthesized fingers, trained on one set and tested on another."""
    parts = {"body_occluded": "body, hidden", "finger_synthesis": "fingers from the body"}
    sets = {"cmu": "CMU", "rocketbox": "Rocketbox"}
    rows = []
    for part, label in parts.items():
        for test, name in sets.items():
            cells = []
            for key in (*(f"{train}_to_{test}_{part}" for train in sets), f"last_known_on_{test}_{part}"):
                known = f"{key}_rmsjpe_cm" in numbers
                cells.append(f"{numbers[f'{key}_rmsjpe_cm']:.1f} / {numbers[f'{key}_mpjpe_cm']:.1f}" if known else "–")
            if any(cell != "–" for cell in cells):
                rows.append([label, name, *cells])
    head = ["joints", "tested on", *(f"trained on {name}" for name in sets.values()), "last known"]
    return f"{markdown(head, rows)}\n\nRMSJPE / MPJPE, cm."


def smoothness(numbers: dict[str, float]) -> str:
    """Shares of strong accelerations before and after inverse kinematics and smoothing (reproduce.md 1.14)."""
    labels = {"gru": "GRU, mask predicted", "mask_given": "GRU, mask given", "best": "packaged"}
    after = {"gru": "gru_tracker", "mask_given": "mask_given_tracker", "best": "tracker"}
    rows = [
        [
            label,
            *(f"{numbers[f'{who}_strong_acceleration_percent']:.1f} %" for who in (name, after[name])),
            f"{STRONG[name]:.1f} %" if name in STRONG else "–",
        ]
        for name, label in labels.items()
    ]
    rows.append(["truth", f"{numbers['truth_strong_acceleration_percent']:.1f} %", "", f"{STRONG['truth']:.1f} %"])
    amount = f"{numbers['clips']:.0f} clips, {numbers['minutes']:.1f} min"
    return (
        markdown(["stronger than 9 m/s²", "network", "after the tracker", "published, network"], rows)
        + f"\n\nOf {amount}."
    )


def beyond(jerk: dict[str, float], trust: dict[str, float], training: dict[str, float]) -> str:
    """Return figures that the paper does not have: re-entry, calibrated confidence, and how fast sequences train."""
    peaks = [jerk[f"{who}_regained_peak_jerk"] for who in ("truth", "last_known", "best", "tracker")]
    errors = [jerk[f"{who}_occluded_rmsjpe_cm"] for who in ("best", "tracker")]
    head = ["peak jerk in the second after a joint is seen again", "m/s³"]
    names = ("truth", "last known", "packaged network, before IK", "packaged, smoothed by the tracker")
    rows = [[name, f"{peak:,.0f}"] for name, peak in zip(names, peaks, strict=True)]
    bins = [
        [f"{trust[f'body_bin{k}_expected_cm']:.1f}", f"{trust[f'body_bin{k}_error_cm']:.1f}"]
        for k in range(1, 11)
        if f"body_bin{k}_expected_cm" in trust
    ]
    return "\n".join(
        [
            markdown(head, rows),
            "",
            f"The tracker's peak is {peaks[3] / peaks[2]:.2f} of the network's; hidden joints go from "
            f"{errors[0]:.2f} to {errors[1]:.2f} cm (RMSJPE).",
            "",
            markdown(["expected error of hidden joints, cm, in ten bins", "true error"], bins),
            "",
            f"Training (`bodysense bench training`, one thread): {training['window_frames_per_second']:,.0f} windows/s "
            f"(a window teaches one frame) and {training['sequence_frames_per_second']:,.0f} frames/s of sequences, "
            f"{training['ratio']:.0f} times as many.",
        ]
    )


def hidden(numbers: dict[str, float]) -> str:
    """Shares of time hidden, ours by category and the published ones."""
    categories = [name for name in CATEGORIES if f"{name}_shoulder_hidden" in numbers]
    rows = []
    for group in GROUPS_HIDDEN:
        ours = [f"{100 * numbers[f'{category}_{group}_hidden']:.0f} %" for category in categories]
        published = [column.hiding[group].ratio for column in PUBLISHED]
        rows.append([group, *ours, *("–" if ratio is None else f"{100 * ratio:.0f} %" for ratio in published)])
    for name, label in (("self_contact", "self-contact"), ("hand_contact", "hand-body contact")):
        ours = [f"{100 * numbers[f'{category}_{name}']:.0f} %" for category in categories]
        published = [getattr(column, name) for column in PUBLISHED]
        rows.append([label, *ours, *("–" if ratio is None else f"{100 * ratio:.0f} %" for ratio in published)])
    return markdown(["", *categories, *(f"{column.name}, published" for column in PUBLISHED)], rows)


def cameras(read: dict[str, dict[str, float]]) -> str:
    """Shares of time hidden while people talk and sit, by what the paper leaves open or its cameras could differ in."""
    rows = [
        [
            label,
            *(
                " / ".join(f"{100 * read[name][f'{kind}_{group}_hidden']:.0f}" for kind in ("talk_gesture", "sit"))
                for group in GROUPS_HIDDEN[:6]
            ),
        ]
        for name, label in CAMERAS.items()
    ]
    ratios = [[column.hiding[group].ratio for column in PUBLISHED] for group in GROUPS_HIDDEN[:6]]
    found = [[ratio for ratio in row if ratio is not None] for row in ratios]
    rows.append(["published, by data set", *(f"{100 * min(row):.0f}-{100 * max(row):.0f}" for row in found)])
    return markdown(["%, talk_gesture / sit", *GROUPS_HIDDEN[:6]], rows)


def speed(read: dict[str, dict[str, float]]) -> str:
    """Return the figures of the bench commands."""
    step, ik = read["step"], read["ik"]
    rows = [
        ["`bench step`", "a frame, whole", f"p50 {step['p50_ms']:.2f} ms, p99 {step['p99_ms']:.2f} ms"],
        ["", "a frame of each of 16 wearers in a batch", f"{step['batch16_ms']:.2f} ms each"],
        ["", "peak resident memory; the network's file", f"{step['rss_mb']:.0f} MB; {step['file_mb']:.1f} MB"],
        ["`bench ik`", "whole body and hands, warm start", f"p50 {ik['p50_ms']:.2f} ms, p99 {ik['p99_ms']:.2f} ms"],
        ["`bench occlusion`", "frames seen by the headset", f"{read['occlusion']['frames_per_second']:,.0f} /s"],
        [
            "`bench import`",
            "`import bodysense`; with the tracker",
            f"{1000 * read['import']['package_seconds']:.0f} ms; {read['import']['seconds']:.2f} s",
        ],
        [
            "`bench bvh`",
            "reading, beside parsing the floats alone",
            f"{read['bvh']['mb_per_second']:.0f} of {read['bvh']['bare_parse_mb_per_second']:.0f} MB/s",
        ],
    ]
    return f"{markdown(['command', 'what', 'figure'], rows)}\n\n{processor()}."


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    return "\n".join(f"| {' | '.join(row)} |" for row in [head, ["---"] * len(head), *rows])


def put(text: str, name: str, body: str) -> str:
    """Replace what stands between the markers of `name`."""
    begin, end = f"<!-- begin {name} -->", f"<!-- end {name} -->"
    before, _, rest = text.partition(begin)
    _, _, after = rest.partition(end)
    return f"{before}{begin}\n{body}\n{end}{after}"


if __name__ == "__main__":
    main(Path(sys.argv[1]))
