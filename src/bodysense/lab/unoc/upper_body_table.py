"""UNOC's Table 6: an upper body from a headset and two controllers, ours beside the published figures."""

from __future__ import annotations

from collections.abc import Iterator

from bodysense.lab.chart import BarPanel, plain_bars
from bodysense.lab.datasets import Census, DataSet, describe, missing
from bodysense.lab.table import Cell, Named, Report, cell, finite, ordering
from bodysense.lab.unoc.headset import GROUPS
from bodysense.lab.unoc.upper_body_scores import JOINTS, UpperBodyTable

METHODS = {"network": "network", "ik": "IK"}
POSES = {"all": "all poses", "standing": "standing"}
SETS = ("UNOC", "Mixamo")
_PUBLISHED = {  # RMSJPE/MPJPE of neck, shoulders, elbows, all: on UNOC, then on Mixamo
    ("network", "all"): "1.1/0.9 2.7/2.3 3.5/2.9 2.3/1.7 1.7/1.4 4.8/4.0 6.1/4.9 4.0/2.7",
    ("ik", "all"): "3.9/3.5 7.5/6.2 10.3/7.8 8.3/6.3 4.1/3.7 13.7/11.3 16.0/12.7 13.4/10.4",
    ("ik", "standing"): "2.5/2.4 7.1/5.7 7.8/5.9 6.7/5.1 3.3/3.0 12.2/10.0 13.9/11.4 11.8/9.2",
}


def published(method: str, poses: str, joints: str, data: str) -> tuple[float, float] | None:
    """RMSJPE and MPJPE, cm, of a cell of the paper's table; None where it has none."""
    row = _PUBLISHED.get((method, poses))
    if row is None:
        return None
    rmsjpe, mpjpe = row.split()[4 * SETS.index(data) + list(JOINTS).index(joints)].split("/")
    return float(rmsjpe), float(mpjpe)


def upper_body_report(table: UpperBodyTable, census: Census, data: DataSet) -> Report:
    """The table of inverse kinematics and, if it was scored, the network."""
    groups = [group for group in ("bending_wrists", *GROUPS[1:]) if table.get(group, "all", "ik", "neck").count]
    return Report(
        name="unoc-table6",
        title="UNOC, Table 6: upper body from a headset and two controllers",
        columns=(
            *("joints", "method", "RMSJPE", "MPJPE"),
            *(f"{measure} on {name}" for name in SETS for measure in ("UNOC's RMSJPE", "UNOC's MPJPE")),
            *(f"{group.replace('_', ' ')} RMSJPE" for group in groups),
        ),
        rows=tuple(_rows(table, groups)),
        numbers=finite(table.numbers()) | census.numbers(),
        data=(describe(data, census), *missing(SETS, [data])),
        remarks=tuple(_remarks(table)),
        caption="cm, in the world. Over sitting, gestures, everyday motion and locomotion; bending wrists: those of "
        "them with recorded hands. In the others the wrist is stiff and gives the elbow away.",
        panels=tuple(_panels(table)),
    )


def _rows(table: UpperBodyTable, groups: list[str]) -> Iterator[tuple[Cell, ...]]:
    for poses, where in POSES.items():
        for joints in JOINTS:
            for method, name in METHODS.items():
                ours = table.get("main", poses, method, joints)
                theirs = [value for one in SETS for value in published(method, poses, joints, one) or (None, None)]
                others = (cell(table.get(group, poses, method, joints).rmsjpe) for group in groups)
                if ours.count or theirs[0] is not None:
                    yield (f"{joints}, {where}", name, cell(ours.rmsjpe), cell(ours.mpjpe), *theirs, *others)


def _remarks(table: UpperBodyTable) -> Iterator[str]:
    for poses, where in POSES.items():
        for joints in JOINTS:
            network, ik = (Named(METHODS[m], table.get("main", poses, m, joints).rmsjpe) for m in ("network", "ik"))
            verdict = ordering(f"{joints}, {where}: the network is better than IK", network, [ik], "cm")
            if verdict is not None:
                yield verdict
    every, standing = (Named(where, table.get("main", poses, "ik", "all").rmsjpe) for poses, where in POSES.items())
    verdict = ordering("IK is better at standing poses", standing, [every], "cm")
    if verdict is not None:
        yield verdict
    if not table.get("main", "all", "network", "all").count:
        yield "The network was not scored: give one with --model."


def _panels(table: UpperBodyTable) -> Iterator[BarPanel]:
    for method, name in METHODS.items():
        ours = [cell(table.get("main", "all", method, joints).rmsjpe) for joints in JOINTS]
        series = [plain_bars("ours", ours)]
        for one in SETS:
            theirs = [published(method, "all", joints, one) for joints in JOINTS]
            series.append(plain_bars(f"published, {one}", [pair[0] if pair else None for pair in theirs]))
        yield BarPanel(f"{name}, all poses", tuple(JOINTS), tuple(series), "RMSJPE, cm")
