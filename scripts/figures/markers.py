"""Tables of docs/markers.md."""

from __future__ import annotations

from .blocks import Block, Numbers, figure, markdown

TRACKED = {"Plug-in Gait": "Plug-in Gait", "Rizzoli (IOR)": "Rizzoli", "OptiTrack Baseline": "Baseline"}
LABORATORIES = ("OpenSim gait2354 and Hamner", "Rajagopal", "OpenCap", "anatomical pairs")
JOINTS = {
    "hip": "hip",
    "knee": "knee",
    "ankle": "ankle",
    "foot": "ball of the foot",
    "shoulder": "shoulder",
    "elbow": "elbow",
    "wrist": "wrist",
    "head": "head",
}
GAPS = ("0.2", "0.5", "1", "2", "5")  # s


def tracked_sets(numbers: Numbers) -> str:
    """Return errors of tracked bodies by marker set."""
    joints = [joint for joint in JOINTS if joint != "foot"]
    rows = [
        [
            title,
            *(figure(numbers, f"{name}_{joint}_cm", 1) for joint in joints),
            f"{figure(numbers, f'{name}_tracked_cm', 1)} ({figure(numbers, f'{name}_tracked_p95_cm', 1)})",
        ]
        for name, title in TRACKED.items()
    ]
    head = ["set", *(JOINTS[joint] for joint in joints), "22 joints after tracking, mean (95 %)"]
    spines = [numbers[f"{name}_tracked_spine_cm"] for name in TRACKED]
    spine = f"The middle of the spine, which has no markers, is at most {max(spines):.1f} cm off."
    return f"{markdown(head, rows)}\n\n{spine}"


def laboratories(numbers: Numbers) -> str:
    """Return errors of joints by marker set of laboratories."""
    rows = [[name, *(figure(numbers, f"{name}_{joint}_cm", 1) for joint in JOINTS)] for name in LABORATORIES]
    return markdown(["set", *JOINTS.values()], rows)


def gaps(numbers: Numbers) -> str:
    """Return errors of filled gaps of a marker."""
    rows = [
        [f"{gap} s", *(figure(numbers, f"{method}_{gap}_cm", 1) for method in ("filled", "spline", "line"))]
        for gap in GAPS
    ]
    return markdown(["gap", "filled cm", "cubic spline cm", "straight line cm"], rows)


_PAGE = "docs/markers.md"
BLOCKS = (
    Block(_PAGE, "marker-gaps", gaps, ("marker-gaps",)),
    Block(_PAGE, "marker-sets", tracked_sets, ("marker-sets",)),
    Block(_PAGE, "laboratories", laboratories, ("marker-sets",)),
)
