"""Write the tables of README.md and docs/occlusion.md from the numbers that the commands wrote.

    bodysense evaluate headset --data DIR --json FIGURES/headset.json
    bodysense evaluate unoc-table2 --data DIR --networks NETWORKS --stride 8 --json FIGURES/unoc-table2.json
    bodysense bench step --json FIGURES/step.json        (and ik, occlusion, bvh, import)
    bodysense data info DIR --occlusion --split test --json FIGURES/hidden.json
    … the same with --camera.solid-scale 0.8, with --camera.nose-distance 0, with both, into FIGURES/hidden_….json
    python scripts/readme_figures.py FIGURES

NETWORKS comes from `bodysense train unoc-tables --window-stride 24 --batch-scale 0.25`. Files that are not there leave
their table as it is.
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
    text = README.read_text(encoding="utf-8")
    if "headset" in read:
        text = put(text, "headset", headset(read["headset"]))
    if "unoc-table2" in read:
        text = put(text, "networks", networks(read["unoc-table2"]))
    if {"step", "ik", "occlusion", "bvh", "import"} <= set(read):
        text = put(text, "speed", speed(read))
    README.write_text(text, encoding="utf-8")
    rates = OCCLUSION.read_text(encoding="utf-8")
    if "hidden" in read:
        rates = put(rates, "occlusion", hidden(read["hidden"]))
    if set(CAMERAS) <= set(read):
        rates = put(rates, "cameras", cameras(read))
    OCCLUSION.write_text(rates, encoding="utf-8")


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
