"""Tables of docs/papers/unoc.md and docs/papers/hmd-vae.md, of the user study, and of windows of arms."""

from __future__ import annotations

from collections.abc import Sequence

from bodysense_lab.core.score_table import ScoreTable
from bodysense_lab.papers.hmd_vae import train as hmd_vae
from bodysense_lab.papers.hmd_vae.tables import PUBLISHED as QUOTED
from bodysense_lab.papers.unoc.network.variants import TABLES, VARIANTS
from bodysense_lab.papers.unoc.score.cross_table import PUBLISHED_BODY, PUBLISHED_FINGERS
from bodysense_lab.papers.unoc.score.cross_table import SETS as PAPER_SETS
from bodysense_lab.papers.unoc.score.smoothness import PUBLISHED as STRONG
from bodysense_lab.papers.unoc.score.tables import PLACES, TABLE_2, TABLE_3, TABLE_4
from bodysense_lab.papers.unoc.score.upper_body_table import JOINTS as UPPER_JOINTS
from bodysense_lab.papers.unoc.score.upper_body_table import SETS as PAPER_UPPER_SETS
from bodysense_lab.papers.unoc.score.upper_body_table import published_on

from .blocks import Block, Numbers, figure, markdown, sampled

SETS = {"cmu": "CMU", "rocketbox": "Rocketbox"}
ACROSS = tuple((train, test) for train in SETS for test in SETS)
GROUPS = {"": "main", "_sport": "sport", "_dance": "dance", "_other": "other"}


PARTS = {"body": "body", "finger": "fingers, from the wrist", "body_and_finger": "body and fingers"}


def table3(numbers: Numbers) -> str:
    """Return UNOC's Table 3: other forms of the network."""
    places = {"body, hidden": "body_occluded", "body, all": "body_all", "fingers, hidden": "finger_occluded"}
    return ablations(numbers, TABLES["3"], places, TABLE_3)


def table4(numbers: Numbers) -> str:
    """Return UNOC's Table 4: other losses."""
    bones = {"body, hidden": "body_occluded", "bones, body": "parent_body", "bone lengths, body": "bone_body"}
    return ablations(numbers, TABLES["4"], bones, TABLE_4)


def headset(numbers: Numbers) -> str:
    """Return errors by motion, part and joints."""
    rows = []
    for suffix, group in GROUPS.items():
        for part, label in PARTS.items():
            for share in ("occluded", "all"):
                key = PLACES[part, share].key
                if f"tracker_{key}_rmsjpe_cm{suffix}" not in numbers:
                    continue
                pairs = [
                    [numbers[f"{who}_{key}_{measure}_cm{suffix}"] for measure in ("rmsjpe", "mpjpe")]
                    for who in ("constant_velocity", "last_known", "tracker")
                ]
                cells = [f"{rmsjpe:.1f} / {mpjpe:.1f}" for rmsjpe, mpjpe in pairs]
                ratio = " / ".join(f"{ours / known:.2f}" for known, ours in zip(*pairs[1:], strict=True))
                rows.append([group, label, share, *cells, ratio])
    head = ["motion", "part", "joints", "constant velocity", "last known", "bodysense", "ratio"]
    command = f"`bodysense evaluate unoc-table2 --data DIR`: {numbers['clips']:.0f} clips, {numbers['minutes']:.0f} min"
    return f"{markdown(head, rows)}\n\nRMSJPE / MPJPE in cm. {command}."


def networks(numbers: Numbers) -> str:
    """Return UNOC's Table 2: hidden joints, then all, next to the paper's, with the ratio to last known positions."""
    labels = {"gru": "GRU", "rnn": "RNN", "lstm": "LSTM", "tcn": "TCN", "best": "packaged", "last_known": "last known"}
    labels |= {"constant_velocity": "constant velocity"}
    theirs, paper = TABLE_2.published[0].cells, []
    for share, joints in (("occluded", "hidden"), ("all", "all")):
        rows = []
        for name, label in labels.items():
            cells = []
            for part in PARTS:
                known, key = (part, share), PLACES[part, share].key
                ours, least = (
                    [numbers[f"{who}_{key}_{measure}_cm"] for measure in ("rmsjpe", "mpjpe")]
                    for who in (name, "last_known")
                )
                cells += [_with_ratio(ours, least), _with_ratio(theirs.get((known, name)), theirs[known, "last_known"])]
            rows.append([label, *cells])
        heads = [head for label in PARTS.values() for head in (f"{label.split(',')[0]}, {joints}", "published")]
        paper.append(markdown(["network", *heads], rows))
    return "\n\n".join([*paper, "RMSJPE / MPJPE, cm, and the ratio of RMSJPE to last known in brackets."])


def _with_ratio(figures: Sequence[float | None] | None, known: Sequence[float | None]) -> str:
    """RMSJPE / MPJPE, and the ratio of the first to that of the last known positions."""
    if figures is None or figures[0] is None or figures[1] is None or not known[0]:
        return "–"
    return f"{figures[0]:.1f} / {figures[1]:.1f} ({figures[0] / known[0]:.2f})"


def ablations(numbers: Numbers, names: Sequence[str], parts: dict[str, str], paper: ScoreTable) -> str:
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
    """Return the published RMSJPE of a cell in a list; empty if the paper has no such cell."""
    at = next((at for at in paper.rows or () if PLACES[at].key == key), None)
    figures = paper.published[0].cells.get((at, name))
    return [] if figures is None else [f"{figures[0]:.2f}"]


def crossed(numbers: Numbers) -> str:
    """Return UNOC's Table 5: hidden joints and synthesised fingers, trained on one set and tested on another."""
    parts = {
        "body_occluded": "body, hidden",
        "all_occluded": "body and fingers, hidden",
        "finger_synthesis": "fingers from the body",
    }
    rows = []
    for part, label in parts.items():
        for test, name in SETS.items():
            cells = []
            for key in (*(f"{train}_to_{test}_{part}" for train in SETS), f"last_known_on_{test}_{part}"):
                known = f"{key}_rmsjpe_cm" in numbers
                cells.append(f"{numbers[f'{key}_rmsjpe_cm']:.1f} / {numbers[f'{key}_mpjpe_cm']:.1f}" if known else "–")
            if any(cell != "–" for cell in cells):
                rows.append([label, name, *cells])
    head = ["joints", "tested on", *(f"trained on {name}" for name in SETS.values()), "last known"]
    return f"{markdown(head, rows)}\n\n{_published_crossed()}\n\nRMSJPE / MPJPE, cm."


def _published_crossed() -> str:
    """Return UNOC's Table 5 as published, both halves."""
    trained = {f"trained on {name}": name for name in PAPER_SETS} | {"last known": ""}
    rows = [
        [label, test, *(_pair(pairs.get((train, test))) for train in trained.values())]
        for label, pairs in (
            ("body and fingers, hidden", PUBLISHED_BODY),
            ("fingers from the body", PUBLISHED_FINGERS),
        )
        for test in PAPER_SETS
    ]
    return markdown(["published", "tested on", *trained], rows)


def _pair(figures: tuple[float, ...] | None) -> str:
    return "–" if figures is None else f"{figures[0]:.1f} / {figures[1]:.1f}"


def synthesis_across(numbers: Numbers) -> str:
    """UNOC's Table 5, right: synthesised fingers, trained on one avatar of Rocketbox and tested on another."""

    def pair(learned: str, tested: str, method: str) -> str:
        return " / ".join(f"{numbers[f'{learned}_to_{tested}_{method}_{one}_cm']:.2f}" for one in ("rmsjpe", "mpjpe"))

    who = ("female", "male")
    rows = [
        [f"{tested} avatar", *(pair(one, tested, method) for method in ("network", "mean_pose") for one in who)]
        for tested in who
    ]
    head = ["tested on", *(f"{what} of the {one}" for what in ("network", "mean hand") for one in who)]
    amount = " and ".join(f"{numbers[f'{one}_clips']:.0f}" for one in who)
    minutes = sum(numbers[f"{one}_minutes"] for one in who)
    return f"{markdown(head, rows)}\n\nRMSJPE / MPJPE, cm, of {amount} clips, {minutes:.1f} min."


def loss_sums(numbers: Numbers) -> str:
    """Return errors after few steps with losses of bones and occlusion as means and as sums over joints (1.7)."""
    labels = {"means": "means over joints", "sums": "sums over joints (`--loss-sum`)", "last_known": "last known"}
    columns = {
        "body, hidden": "body_occluded",
        "fingers, hidden": "finger_occluded",
        "bones, body": "parent_body",
        "bone lengths, body": "bone_body",
    }
    rows = [
        [label, *(figure(numbers, f"{form}_{key}_rmsjpe_cm") for key in columns.values())]
        for form, label in labels.items()
    ]
    return (
        f"{markdown(['losses of bones and occlusion', *columns], rows)}\n\nRMSJPE, cm, after "
        f"{numbers['steps']:.0f} steps on {numbers['training_clips']:.0f} clips; {numbers['clips']:.0f} clips of "
        f"validation people, {numbers['minutes']:.1f} min."
    )


def smoothness(numbers: Numbers) -> str:
    """Return shares of strong accelerations before and after inverse kinematics and smoothing (reproduce.md 1.14)."""
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
    amount = f"{sampled(numbers)}, {numbers['minutes']:.1f} min"
    return (
        markdown(["stronger than 9 m/s²", "network", "after the tracker", "published, network"], rows)
        + f"\n\nMeasured on {amount}."
    )


def applications(upper: Numbers, fingers: Numbers) -> str:
    """UNOC's Table 6, all poses and standing ones, and finger synthesis: network, baselines, and published figures."""

    def pair(numbers: Numbers, name: str, ending: str = "") -> str:
        return _pair((numbers[f"{name}_rmsjpe_cm{ending}"], numbers[f"{name}_mpjpe_cm{ending}"]))

    tables = []
    published = published_on("UNOC")
    for poses, head in (("all", "three points"), ("standing", "three points, standing")):
        ending = "" if poses == "all" else f"_{poses}"
        rows = [
            [
                joints,
                pair(upper, f"network_{joints}", ending),
                pair(upper, f"ik_{joints}", ending),
                f"{upper[f'network_{joints}_rmsjpe_cm{ending}'] / upper[f'ik_{joints}_rmsjpe_cm{ending}']:.2f}",
                *(_pair(published.get(((poses, joints), method))) for method in ("network", "ik")),
            ]
            for joints in UPPER_JOINTS
        ]
        tables.append(markdown([head, "network", "inverse kinematics", "ratio", "published", "published IK"], rows))
    names = {"network": "network", "mean_pose": "mean hand", "nearest": "hand of the nearest body"}
    tables.append(
        markdown(
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
    )
    theirs = _pair(PUBLISHED_FINGERS["UNOC", "UNOC"])
    return "\n\n".join([*tables, f"RMSJPE / MPJPE, cm. The paper's fingers: {theirs} on its own data."])


def across(*scores: Numbers) -> str:
    """UNOC's Table 6 with networks trained on one set and tested on another, next to inverse kinematics."""

    def pair(numbers: Numbers, method: str) -> str:
        return _pair((numbers[f"{method}_all_rmsjpe_cm"], numbers[f"{method}_all_mpjpe_cm"]))

    found = dict(zip(ACROSS, scores, strict=True))
    rows = [
        [name, *(pair(found[train, test], "network") for train in SETS), pair(found[test, test], "ik")]
        for test, name in SETS.items()
    ]
    table = markdown(["tested on", *(f"trained on {name}" for name in SETS.values()), "inverse kinematics"], rows)
    at = ("all", "all")
    theirs = [
        [data, *(_pair(published_on(data).get((at, method))) for method in ("network", "other_set", "ik"))]
        for data in PAPER_UPPER_SETS
    ]
    paper = markdown(["published, on", "trained on it", "trained on the other set", "inverse kinematics"], theirs)
    sentences = " ".join(f"On {name}: {sampled(found[test, test])}" for test, name in SETS.items())
    return f"{table}\n\n{paper}\n\nNeck, shoulders and elbows, RMSJPE / MPJPE, cm. {sentences}"


def beyond(jerk: Numbers, trust: Numbers) -> str:
    """Return figures that the paper lacks: re-entry and calibrated confidence."""
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
        ]
    )


def vaes(numbers: Numbers) -> str:
    """Return errors of HMD-VAE's models 1 to 4 on body and legs, and figures of the paper as quoted by later papers."""
    labels = {1: "1, head and hands now", 2: "2, their history", 3: "3, as 1, pretrained", 4: "4, as 2, pretrained"}
    measures = ("position_cm", "velocity_cm_s", "acceleration_m_s2")
    rows = [
        [
            label,
            *(f"{numbers[f'model{model}_{part}_{measure}']:.2f}" for part in ("full", "legs") for measure in measures),
            figure(numbers, f"model{model}_mpjre_component_deg"),
        ]
        for model, label in labels.items()
    ]
    degrees, position, velocity, _ = QUOTED["HMD-VAE (as quoted)"]
    rows.append(["as quoted, on AMASS", f"{position:.2f}", f"{velocity:.2f}", *["–"] * 4, f"{degrees:.2f}"])
    units = [f"{part} {unit}" for part in ("full body", "legs") for unit in ("cm", "cm/s", "m/s²")]
    return (
        f"{markdown(['model', *units, 'rotations °'], rows)}\n\n{numbers['networks']:.0f} networks were scored; of "
        "each model the one that was best in validation. Rotations: mean difference of axis-angle components."
    )


def swept(numbers: Numbers) -> str:
    """Validation errors of every setting of HMD-VAE's sweep (reproduce.md 2.9), of models 1 to 4."""
    rows = []
    for latent in hmd_vae.LATENTS:
        for blocks in hmd_vae.BLOCKS:
            keys = [
                [f"model{model}_beta{beta}_latent{latent}_blocks{blocks}_cm" for model in range(1, 5)]
                for beta in hmd_vae.BETAS
            ]
            cells = [", ".join(figure(numbers, key, 1) for key in row) for row in keys]
            rows.append([f"{latent}", f"{blocks}", *cells])
    table = markdown(["d", "blocks", *(f"β {beta:g}" for beta in hmd_vae.BETAS)], rows)
    return f"{table}\n\n{numbers['networks']:.0f} networks, {numbers['steps']:.0f} steps each."


def windows(numbers: Numbers) -> str:
    """Return the number of windows of `train arms` (reproduce.md 3.7), next to the paper's."""
    ours = [f"{numbers[key]:,.0f}" for key in ("clips", "minutes", "windows")]
    return markdown(
        ["training motion", "clips", "minutes", "windows"], [["Rocketbox", *ours], ["published", "–", "–", "30,000"]]
    )


def study(numbers: Numbers) -> str:
    """Return mean votes of a user study with simulated raters, next to the paper's (Fig. 6)."""
    # Mean votes of 39 raters (UNOC, section 5.1).
    published = {"truth_over_ours": 0.46, "ours_over_baseline": 0.65, "truth_over_baseline": 0.76}
    rows = []
    for key, theirs in published.items():
        p = numbers[f"{key}_p"]
        found = f"{numbers[f'{key}_mean']:+.2f} ± {numbers[f'{key}_standard_error']:.2f}"
        rows.append([key.replace("_", " "), found, "< .001" if p < 0.001 else f"{p:.3f}", f"{theirs:+.2f}"])
    table = markdown(["comparison", "simulated raters, mean vote", "p", "published, mean vote"], rows)
    return f"{table}\n\n{numbers['raters']:.0f} simulated raters, {numbers['scenes']:.0f} scenes."


_UNOC = "docs/papers/unoc.md"
BLOCKS = (
    Block(_UNOC, "headset", headset, ("headset",)),
    Block(_UNOC, "networks", networks, ("unoc-table2",)),
    Block(_UNOC, "table3", table3, ("unoc-table3",)),
    Block(_UNOC, "table4", table4, ("unoc-table4",)),
    Block(_UNOC, "loss-sums", loss_sums, ("unoc-loss-sums",)),
    Block(_UNOC, "table5", crossed, ("unoc-table5",)),
    Block(_UNOC, "table5-fingers", synthesis_across, ("unoc-avatars",)),
    Block(_UNOC, "smoothness", smoothness, ("unoc-smoothness",)),
    Block(_UNOC, "applications", applications, ("unoc-table6", "finger-synthesis")),
    Block(_UNOC, "table6-across", across, tuple(f"unoc-table6-{train}-{test}" for train, test in ACROSS)),
    Block(_UNOC, "beyond", beyond, ("transitions", "reliability")),
    Block("docs/study.md", "study", study, ("study",)),
    Block("docs/papers/hmd-vae.md", "hmd-vae", vaes, ("hmd-vae",)),
    Block("docs/papers/hmd-vae.md", "hmd-vae-sweep", swept, ("hmd-vae-sweep",)),
    Block("docs/papers/pahmt.md", "arm-windows", windows, ("arm-windows",)),
)
