"""Write the tables of README.md and docs/occlusion.md from the numbers that the commands wrote.

    bodysense evaluate headset --data DIR --json FIGURES/headset.json
    bodysense evaluate headset --data DIR --model paper.onnx --json FIGURES/paper.json
    bodysense bench step --json FIGURES/step.json        (and ik, occlusion, bvh, import)
    bodysense data info DIR --occlusion --split test --json FIGURES/hidden.json
    python scripts/readme_figures.py FIGURES

`paper.onnx` comes from `bodysense train body-gru --form paper --window-stride 8 --passes 1`. Files that are not there
leave their table as it is.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from bodysense.cli.show import processor
from bodysense.occlusion.statistics import PUBLISHED

ROOT = Path(__file__).parents[1]
README, OCCLUSION = ROOT / "README.md", ROOT / "docs" / "occlusion.md"
GROUPS = {"": "main", "_sport": "sport", "_dance": "dance", "_other": "other"}
CATEGORIES = ("talk_gesture", "sit", "everyday", "locomotion", "all")
GROUPS_HIDDEN = ("shoulder", "elbow", "hand", "hip", "knee", "foot", "body", "all")
PARTS = {"body": "body", "finger": "fingers, from the wrist", "body_and_finger": "body and fingers"}


def main(folder: Path) -> None:
    """Replace the text between every pair of markers whose figures are in `folder`."""
    read = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("*.json")}
    text = README.read_text(encoding="utf-8")
    if "headset" in read:
        text = put(text, "headset", headset(read["headset"]))
    if {"headset", "paper"} <= set(read):
        text = put(text, "forms", forms(read["headset"], read["paper"]))
    if {"step", "ik", "occlusion", "bvh", "import"} <= set(read):
        text = put(text, "speed", speed(read))
    README.write_text(text, encoding="utf-8")
    if "hidden" in read:
        body = hidden(read["hidden"])
        OCCLUSION.write_text(put(OCCLUSION.read_text(encoding="utf-8"), "occlusion", body), encoding="utf-8")


def headset(numbers: dict[str, float]) -> str:
    """Errors by motion, part and joints."""
    rows = []
    for suffix, group in GROUPS.items():
        for part, label in PARTS.items():
            for share in ("occluded", "all"):
                key = f"{part}_{share}"
                if f"{key}_rmsjpe_cm{suffix}" not in numbers:
                    continue
                cells = [
                    f"{numbers[f'{who}{key}_rmsjpe_cm{suffix}']:.1f} / {numbers[f'{who}{key}_mpjpe_cm{suffix}']:.1f}"
                    for who in ("baseline_", "")
                ]
                ratio = [numbers[f"{key}_{measure}_ratio{suffix}"] for measure in ("rmsjpe", "mpjpe")]
                rows.append([group, label, share, *cells, f"{ratio[0]:.2f} / {ratio[1]:.2f}"])
    head = ["motion", "part", "joints", "last known", "bodysense", "ratio"]
    command = (
        f"`bodysense evaluate headset --data DIR`: {numbers['clips']:.0f} clips, {numbers['seconds'] / 60:.0f} min"
    )
    return f"{markdown(head, rows)}\n\nRMSJPE / MPJPE in cm. {command}."


def forms(shipped: dict[str, float], paper: dict[str, float]) -> str:
    """The shipped form, the paper's form, and the paper's own figures."""
    keys = ("body_occluded_rmsjpe", "body_occluded_mpjpe", "finger_occluded_rmsjpe", "finger_occluded_mpjpe")
    rows = [
        [name, *(f"{numbers[f'{key}_cm']:.1f} ({numbers[f'{key}_ratio']:.2f})" for key in keys)]
        for name, numbers in (
            ("carried state, headset's orientation", shipped),
            ("windows of 27, positions only", paper),
        )
    ]
    # UNOC, Table 2: GRU over last known.
    published = ((5.9, 13.1), (4.0, 8.5), (4.1, 5.0), (3.0, 3.2))
    rows.append(["published, on UNOC's data", *(f"{ours:.1f} ({ours / known:.2f})" for ours, known in published)])
    head = ["form", "body RMSJPE", "body MPJPE", "finger RMSJPE", "finger MPJPE"]
    return f"{markdown(head, rows)}\n\nOccluded joints, cm, and the ratio to last known in brackets."


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


def speed(read: dict[str, dict[str, float]]) -> str:
    """What the bench commands measured."""
    step, ik = read["step"], read["ik"]
    rows = [
        [
            "`bench step`",
            "a frame: network, IK, smoothing",
            f"p50 {step['p50_ms']:.2f} ms, p99 {step['p99_ms']:.2f} ms",
        ],
        ["", "peak resident memory", f"{step['rss_mb']:.0f} MB"],
        ["`bench ik`", "whole body and hands, warm start", f"p50 {ik['p50_ms']:.2f} ms, p99 {ik['p99_ms']:.2f} ms"],
        ["`bench occlusion`", "frames seen by the headset", f"{read['occlusion']['frames_per_second']:,.0f} /s"],
        ["`bench import`", "`import bodysense` and the tracker", f"{read['import']['seconds']:.2f} s"],
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
