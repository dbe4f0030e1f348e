"""Table 6: the published figures in their places, and what is said of network and inverse kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.scoring import Tally
from bodysense_lab.datasets import Census, DataSet
from bodysense_lab.unoc.upper_body_table import JOINTS, Errors, published_on, upper_body_report


def made(errors: dict[str, float]) -> Errors:
    found: Errors = {}
    for method, error in errors.items():
        for poses, factor in (("all", 1.0), ("standing", 0.5)):
            for joints in JOINTS:
                tally = found["main", (poses, joints), method, "error"] = Tally()
                tally.add(np.full(4, error * factor))
    found["bending_wrists", ("all", "neck"), "ik", "error"] = found["main", ("all", "neck"), "ik", "error"]
    return found


@pytest.mark.parametrize(
    ("method", "poses", "joints", "data", "figures"),
    [
        ("network", "all", "neck", "UNOC", (1.1, 0.9)),
        ("network", "all", "all", "Mixamo", (4.0, 2.7)),
        ("ik", "all", "elbows", "UNOC", (10.3, 7.8)),
        ("ik", "standing", "shoulders", "Mixamo", (12.2, 10.0)),
        ("network", "standing", "neck", "UNOC", None),
    ],
)
def test_published(method: str, poses: str, joints: str, data: str, figures: tuple[float, float] | None) -> None:
    assert published_on(data).get(((poses, joints), method)) == figures


def test_the_report(data: DataSet) -> None:
    report = upper_body_report(made({"network": 2.0, "ik": 6.0}), Census(2, frozenset("a"), 60.0), data)
    rows = {row[:2]: row[2:] for row in report.rows}
    assert rows["elbows, all poses", "IK"][:6] == (6.0, 6.0, 10.3, 7.8, 16.0, 12.7)
    assert rows["neck, standing", "network"][:4] == (1.0, 1.0, None, None)
    bending = report.columns.index("bending wrists RMSJPE") - 2
    assert rows["neck, all poses", "IK"][bending] == 6.0 and rows["neck, all poses", "network"][bending] is None
    assert report.numbers["network_all_rmsjpe_cm"] == 2.0 and report.numbers["ik_neck_rmsjpe_cm_standing"] == 3.0
    assert all(": holds (" in text for text in report.remarks) and len(report.remarks) == 9
    worse = upper_body_report(made({"network": 7.0, "ik": 6.0}), Census(), data).remarks
    assert sum("does not hold" in text for text in worse) == 8
