"""HMD-VAE's Figs 5 to 7 as a table and pictures, and what holds of what the paper reads from them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from operator import attrgetter

from bodysense_lab.core.scoring import GROUPS, suffix_of
from bodysense_lab.core.table import Cell, Report, bound_cells, cell, finite, ordering
from bodysense_lab.data.datasets import Census, DataSet, describe_data, missing_data_remarks
from bodysense_lab.papers.hmd_vae.scores import Scored

MODELS = {1: "1 static", 2: "2 sequence", 3: "3 static, pretrained", 4: "4 sequence, pretrained"}
PARTS = {"full": "full body", "legs": "legs"}
MEASURES = {
    "position_cm": ("position error", "cm"),
    "velocity_cm_s": ("velocity error", "cm/s"),
    "acceleration_m_s2": ("acceleration", "m/s²"),
}
# AMASS, 60 Hz, as quoted by the later papers: component rotation error °, MPJPE cm, velocity cm/s, jitter.
PUBLISHED = {
    "HMD-VAE (as quoted)": (4.11, 6.83, 37.99, None),
    "AvatarPoser": (3.08, 4.18, 27.70, 14.49),
    "AGRoL (offline)": (2.66, 3.71, 18.59, 7.26),
    "EgoPoser": (2.90, 3.80, 24.26, 14.89),
    "AvatarJLM": (2.90, 3.35, 20.79, 8.39),
    "SAGE": (2.53, 3.28, 20.62, 6.55),
    "HMD-Poser": (2.29, 3.15, 17.52, 6.21),
    "RPM": (None, 4.08, None, 4.21),  # online
    "KineST": (2.25, 2.86, 15.26, 5.97),
    "FisherPoser": (2.04, 2.97, 20.52, 5.33),
}
LATER = (  # measures of later papers
    "mpjre_component_deg",
    "full_position_cm",
    "full_velocity_cm_s",
    "jitter",
    "rotation_deg",
    "upper_position_cm",
    "lower_position_cm",
    "skate_cm_s",
    "penetration_cm",
)
# Claims of section 5.3 on Figs 6 and 7, all on legs: text, measure, the lower model, the higher ones.
CLAIMS = (
    ("History helps the position, from scratch", "position_cm", 2, (1,)),
    ("History helps the position, pretrained", "position_cm", 4, (3,)),
    ("History helps the velocity, from scratch", "velocity_cm_s", 2, (1,)),
    ("History helps the velocity, pretrained", "velocity_cm_s", 4, (3,)),
    ("Model 2 has the lowest position error", "position_cm", 2, (1, 3, 4)),
    ("A pretrained decoder and history have the lowest velocity error", "velocity_cm_s", 4, (1, 2)),
    ("A pretrained decoder moves more smoothly, static", "acceleration_m_s2", 3, (1,)),
    ("A pretrained decoder moves more smoothly, sequence", "acceleration_m_s2", 4, (2,)),
    ("History moves more smoothly, from scratch", "acceleration_m_s2", 2, (1,)),
    ("History moves more smoothly, pretrained", "acceleration_m_s2", 4, (3,)),
)


def vae_report(scored: Sequence[Scored], census: Census, data: DataSet) -> Report:
    """Figs 5 to 7: a row a network and set of joints."""
    groups = [g for g in GROUPS[1:] if any(math.isfinite(one.get("full_position_cm", g)) for one in scored)]
    main = "main" if any(math.isfinite(one.get("full_position_cm")) for one in scored) else groups[0]
    figures = tuple(f"{title}, {unit}" for title, unit in MEASURES.values())
    setting = ("β", "d", "blocks", "origin")
    rows: list[tuple[Cell, ...]] = []
    for part, joints in PARTS.items():
        for one in sorted(
            scored, key=lambda one: attrgetter("origin", "beta", "latent", "blocks", "model")(one.config)
        ):
            c = one.config
            ours = (cell(one.get(f"{part}_{measure}", main)) for measure in MEASURES)
            others = (cell(one.get(f"{part}_position_cm", g)) for g in groups if g != main)
            within = one.card.get("within_position_cm") if part == "full" else None
            settings = (f"{c.beta:g}", str(c.latent), str(c.blocks), c.origin)
            sure = bound_cells(one.tallies[main, f"{part}_position_cm"].interval())
            rows.append((joints, MODELS[c.model], *settings, *ours, *sure, within, *others))
        truth = cell(scored[0].get(f"{part}_truth_acceleration_m_s2", main))
        rows.append(
            (joints, "truth", "", "", "", "", None, None, truth, None, None, None, *(None for g in groups if g != main))
        )
    return Report(
        name="hmd-vae",
        title="HMD-VAE, Figs 5 to 7: static and sequence, from scratch and pretrained",
        columns=(
            *("joints", "model", *setting, *figures, "position low", "high", "within, cm"),
            *(f"{g}, cm" for g in groups if g != main),
        ),
        rows=tuple(rows),
        numbers=_numbers(scored) | census.numbers(),
        data=(describe_data(data, census), *missing_data_remarks(("AMASS",), [data])),
        remarks=tuple(_remarks(scored, main)),
        caption="Means over frames, each answered from the window that ends with it. Positions from the head; legs are "
        "knees, ankles and feet; acceleration is the mean L1 norm of the prediction's. Within: sequences of the "
        "training people that were held out. Low and high: 95 % by bootstrap over people. Of several settings of a "
        "model the figures below are of the one that was best in validation.",
        digits=2,
    )


def metrics_report(scored: Sequence[Scored], census: Census, data: DataSet) -> Report:
    """Measures of later papers: of the best network of each model, next to published ones."""
    rows: list[tuple[Cell, ...]] = []
    best = best_of(scored)
    for (origin, model), one in best.items():
        label = MODELS[model] + ("" if origin == "head" else f", origin {origin}")
        rows.append(("ours", label, *(cell(one.get(name)) for name in LATER)))
    truth = (cell(one.get("truth_jitter")) for one in list(best.values())[:1])
    rows.append(("ours", "truth", None, None, None, *truth, *(None,) * 5))
    rows += [("published", name, *values, *(None,) * 5) for name, values in PUBLISHED.items()]
    return Report(
        name="hmd-vae-metrics",
        title="HMD-VAE beside later methods",
        columns=(
            *("", "method", "component", "MPJPE", "velocity", "jitter", "rotation", "upper", "lower", "skate", "under"),
        ),
        rows=tuple(rows),
        numbers={},
        data=(describe_data(data, census),),
        caption="22 joints. Mean difference of axis-angle components, °; cm from the head; cm/s; jitter 10² m/s³; "
        "geodesic local rotation, °; upper and lower body, cm; skate of standing feet, cm/s; depth of balls under the "
        "floor, cm. From the 16th frame on of clips of 64 or more. Ours at 30 Hz, the published on AMASS at 60 Hz: "
        "other people, other motion, another rate. The tracker's own figures: bodysense evaluate completion.",
        digits=2,
    )


def best_of(scored: Sequence[Scored]) -> dict[tuple[str, int], Scored]:
    """The network of each origin and model that was best in validation, by (origin, model)."""
    best: dict[tuple[str, int], Scored] = {}
    for one in sorted(scored, key=lambda one: float(one.card["validation_position_cm"])):
        best.setdefault((one.config.origin, one.config.model), one)
    return dict(sorted(best.items()))


def _numbers(scored: Sequence[Scored]) -> dict[str, float]:
    """One flat object: 'model<k>_…' of the best in validation; 'pelvis_model<k>_…' of those with the paper's origin."""
    result: dict[str, float] = {"networks": len(scored)}
    for (origin, model), one in best_of(scored).items():
        prefix = f"model{model}" if origin == "head" else f"{origin}_model{model}"
        for group, measure in one.tallies:
            key = f"{prefix}_{measure}{suffix_of(group)}"
            result |= one.tallies.figures(key, group, measure)
        result[f"{prefix}_within_position_cm"] = float(one.card["within_position_cm"])
        result[f"{prefix}_validation_position_cm"] = float(one.card["validation_position_cm"])
    bests = [one.get("full_position_cm") for (origin, _), one in best_of(scored).items() if origin == "head"]
    if bests:
        result["paper_best_mpjpe_cm"] = min(bests)
    return finite(result)


def _remarks(scored: Sequence[Scored], main: str) -> Iterator[str]:
    """The paper's claims on the best of each model, and in how many settings they hold."""
    origin = "head" if any(one.config.origin == "head" for one in scored) else "pelvis"
    best = {model: one for (where, model), one in best_of(scored).items() if where == origin}
    for text, measure, low, high in CLAIMS:
        if low not in best or not set(high) <= set(best):
            continue
        name, unit = f"legs_{measure}", MEASURES[measure][1]
        others = [best[k].tallies[main, name].named(f"model {k}") for k in high]
        verdict = ordering(f"Legs: {text}", best[low].tallies[main, name].named(f"model {low}"), others, unit)
        if verdict is None:
            continue
        settings = [at for at in _settings(scored, origin) if {low, *high} <= set(at)]
        held = sum(all(at[low].get(name, main) < at[k].get(name, main) for k in high) for at in settings)
        yield verdict + f" At equal settings it holds in {held} of {len(settings)}."
    deeper = [one for one in scored if one.config.blocks == 6 and one.config.origin == origin]
    for measure in ("position_cm", "velocity_cm_s"):
        pairs = [(one, other) for one in deeper for other in scored if other.config == replace(one.config, blocks=3)]
        if pairs:
            name, unit = f"legs_{measure}", MEASURES[measure][1]
            held = sum(one.get(name, main) < other.get(name, main) for one, other in pairs)
            mean = [sum(pair[k].get(name, main) for pair in pairs) / len(pairs) for k in (0, 1)]
            yield (
                f"Legs: six blocks have a lower {MEASURES[measure][0]} than three: in {held} of {len(pairs)} pairs of "
                f"equal settings (means {mean[0]:.2f} and {mean[1]:.2f} {unit})."
            )
    for part, measure in ((part, measure) for part in PARTS for measure in MEASURES):
        name = f"{part}_{measure}"
        apart = [
            one
            for one in best.values()
            if abs(one.get(name, main) - one.get(f"{name}_sequences", main)) > 0.02 * abs(one.get(name, main))
        ]
        if apart:
            figures = ", ".join(f"model {one.config.model} {one.get(f'{name}_sequences', main):.2f}" for one in apart)
            yield f"Over sequences of 64 frames as in the paper: {PARTS[part]}, {MEASURES[measure][0]}: {figures}."


def _settings(scored: Sequence[Scored], origin: str) -> list[dict[int, Scored]]:
    """The models of each setting."""
    found: dict[tuple, dict[int, Scored]] = {}
    for one in scored:
        if one.config.origin == origin:
            found.setdefault((one.config.beta, one.config.latent, one.config.blocks), {})[one.config.model] = one
    return list(found.values())
