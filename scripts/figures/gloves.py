"""Tables of docs/gloves.md and docs/papers/two-hands.md, and README's sentence on gloves."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from textwrap import fill

from bodysense_lab.papers.two_hands.score.choice import CANDIDATES, value_text
from bodysense_lab.papers.two_hands.score.foreign import FEW_MANY, WAYS
from bodysense_lab.papers.two_hands.score.foreign import PLACES as FOREIGN_PLACES
from bodysense_lab.papers.two_hands.score.fusion import FINGER_COUNTS, FUSION_PLACES, SECONDS
from bodysense_lab.papers.two_hands.score.fusion import METHODS as FUSION_METHODS
from bodysense_lab.papers.two_hands.score.layouts import layouts
from bodysense_lab.papers.two_hands.score.limits_report import LINES
from bodysense_lab.papers.two_hands.score.occlusion import PUBLISHED_AT_ONCE, PUBLISHED_SHORT, SHORT
from bodysense_lab.papers.two_hands.score.tables import PUBLISHED_MARKERS, PUBLISHED_POINTS, PUBLISHED_STILL
from bodysense_lab.papers.two_hands.trials import DURATIONS, HIDDEN

from .blocks import Block, Numbers, between, figure, markdown, sampled

PAGE, PAPER = "docs/gloves.md", "docs/papers/two-hands.md"
METHODS = {"lk": "last known", "ls": "last shape of the hand", "ma": "moving average", "ac": "affine", "nn": "network"}
EXPECTED = ("0.4", "0.7", "1", "1.5", "2", "3", "5")  # cm: bounds of bins
UNITS = {"deg": "°", "cm": "cm"}
PLACES = {"": "recorded", "_synthesised": "synthesised"}


def paper(numbers: Numbers) -> str:
    """Return errors of the paper's marker network on hands in and outside its training, next to published figures."""
    rows = []
    for hidden in HIDDEN:
        for hands, method in (("trained avatars", "nn"), ("unseen hands", "stranger_nn")):
            keys = [f"{method}_{hidden}_{duration:.1f}_cm" for duration in DURATIONS]
            if set(keys) <= set(numbers):
                rows.append([str(hidden), hands, *(f"{numbers[key]:.2f}" for key in keys)])
        rows.append([str(hidden), "published", *(f"{value:.2f}" for value in PUBLISHED_MARKERS["nn", hidden])])
    return markdown(["hidden", "", *(f"{duration:g} s" for duration in DURATIONS)], rows)


def paper_joints(numbers: Numbers) -> str:
    """Return errors of finger joints by both networks of the paper, next to published figures."""
    still = (("trained avatars", numbers["nn_0_cm"]), ("unseen hands", numbers["stranger_nn_0_cm"]))
    blank = ["–"] * (len(DURATIONS) - 1)
    rows = [["0", hands, f"{value:.2f}", *blank] for hands, value in still]
    rows.append(["0", "published", f"{PUBLISHED_STILL['nn']:.2f}", *blank])
    for hidden in HIDDEN:
        for hands, method in (("trained avatars", "nn"), ("unseen hands", "stranger_nn")):
            keys = [f"{method}_{hidden}_{duration:.1f}_cm" for duration in DURATIONS]
            if all(key in numbers for key in keys):
                rows.append([str(hidden), hands, *(f"{numbers[key]:.2f}" for key in keys)])
        rows.append([str(hidden), "published", *(f"{value:.2f}" for value in PUBLISHED_POINTS[hidden])])
    sentence = f"Measured on {sampled(numbers)}, without synthesised hands."
    sentence += between(numbers, "nn_0_cm_low", "nn_0_cm_high", "Nothing hidden, trained avatars")
    return markdown(["hidden", "", *(f"{duration:g} s" for duration in DURATIONS)], rows) + "\n\n" + sentence


def sentence(table3: Numbers, table4: Numbers) -> str:
    """Return README's sentence about hands that were left out of training."""
    text = (
        "Gloves, on an avatar's hand that was left out of training: a marker hidden for a second is "
        f"{table3['foreign_nn_1_1.0_cm']:.2f} cm off, one of four {table3['foreign_nn_4_1.0_cm']:.2f}; finger joints "
        f"are {table4['foreign_nn_0_cm']:.2f} cm off if the hand's shape is known, "
        f"{table4['foreign_calibrated_0_cm']:.2f} where ten seconds of its markers calibrate it."
    )
    return fill(text, 120)


def other_sets(numbers: Numbers) -> str:
    """Return errors of gloves with other marker sets."""
    rows = [
        [
            layout.title,
            *(f"{numbers[f'{layout.key}_{way}_{n}_cm']:.2f}" for way in ("told", "calibrated") for n in (0, 1)),
        ]
        for layout in layouts()
    ]
    return markdown(["markers", "hand known", "one hidden", "calibrated", "one hidden"], rows)


def summary(table3: Numbers, table4: Numbers, frame: Numbers) -> str:
    """Return the main figures, next to the paper's."""
    rows = []
    for hidden in (HIDDEN[0], HIDDEN[-1]):
        rows.append([f"a hidden marker, {hidden} hidden, after 0.1 and 2 s, cm"])
        rows[-1] += _row(table3, hidden)
        rows[-1].append(_outer(PUBLISHED_MARKERS["nn", hidden]))
    still = [f"{table4[key]:.2f}" for key in ("nn_0_cm", "foreign_nn_0_cm", "nn_0_cm_synthesised")]
    rows.append(["finger joints, nothing hidden, cm", *still, f"{PUBLISHED_STILL['nn']:.2f}"])
    rows.append(["… as its markers calibrate it", "", f"{table4['foreign_calibrated_0_cm']:.2f}", "", ""])
    for hidden in (HIDDEN[0], HIDDEN[-1]):
        rows.append([f"finger joints, {hidden} hidden, after 0.1 and 2 s, cm"])
        rows[-1] += _row(table4, hidden)
        rows[-1].append(_outer(PUBLISHED_POINTS[hidden]))
    times = f"{frame['one_hand_p50_ms']:.2f}, {frame['two_hands_p50_ms']:.2f}"
    rows.append(["a frame of one hand, of two, p50, ms", "", "", times, "1.2, 2.2"])
    return markdown(["", "recorded", "left-out hand", "synthesised", "published"], rows)


def _row(numbers: Numbers, hidden: int) -> list[str]:
    """Return errors after the shortest and the longest gap: recorded hands, left-out hands, synthesised hands."""
    keys = (("", ""), ("foreign_", ""), ("", "_synthesised"))
    return [
        ", ".join(f"{numbers[f'{before}nn_{hidden}_{duration:.1f}_cm{after}']:.2f}" for duration in DURATIONS[::4])
        for before, after in keys
    ]


def _foreign(numbers: Numbers) -> list[list[str]]:
    """Return rows of hands that were left out of training."""
    rows = []
    for place, label in FOREIGN_PLACES.items():
        for way, name in WAYS.items():
            if f"{place}_{way}_0_cm" in numbers:
                rows.append([label, name, "0", f"{numbers[f'{place}_{way}_0_cm']:.2f}", *["–"] * (len(DURATIONS) - 1)])
            for hidden in FEW_MANY:
                cells = [numbers.get(f"{place}_{way}_{hidden}_{duration:.1f}_cm") for duration in DURATIONS]
                if all(value is not None for value in cells):
                    rows.append([label, name, str(hidden), *(f"{value:.2f}" for value in cells if value is not None)])
    return rows


def _outer(values: Sequence[float]) -> str:
    return f"{values[0]:.2f}, {values[-1]:.2f}"


def markers(numbers: Numbers) -> str:
    """Return Table 3: errors of hidden markers."""
    rows = []
    for suffix, motion in PLACES.items():
        for method, label in METHODS.items():
            for hidden in (HIDDEN[0], HIDDEN[-1]):
                cells = [numbers.get(f"{method}_{hidden}_{duration:.1f}_cm{suffix}") for duration in DURATIONS]
                if all(value is not None for value in cells):
                    rows.append([motion, label, str(hidden), *(f"{value:.2f}" for value in cells if value is not None)])
    rows += _foreign(numbers)
    for method, label in METHODS.items():
        for hidden in (HIDDEN[0], HIDDEN[-1]):
            published = PUBLISHED_MARKERS.get((method, hidden))
            if published:
                rows.append(["published", label, str(hidden), *(f"{value:.2f}" for value in published)])
    return markdown(["motion", "method", "hidden", *(f"{duration:g} s" for duration in DURATIONS)], rows)


def points(numbers: Numbers) -> str:
    """Return Table 4: errors of finger joints."""
    rows = []
    for suffix, motion in PLACES.items():
        for key, label in (("ik", "CCD, no limits"), ("ik_tuned", "CCD, tuned limits"), ("nn_0", "network")):
            if f"{key}_cm{suffix}" in numbers:
                rows.append([motion, label, "0", f"{numbers[f'{key}_cm{suffix}']:.2f}", *["–"] * (len(DURATIONS) - 1)])
        for hidden in HIDDEN:
            cells = [numbers.get(f"nn_{hidden}_{duration:.1f}_cm{suffix}") for duration in DURATIONS]
            if all(value is not None for value in cells):
                rows.append([motion, "network", str(hidden), *(f"{value:.2f}" for value in cells if value is not None)])
    rows += _foreign(numbers)
    for key, label in (("ik", "CCD, no limits"), ("ik_tuned", "CCD, tuned limits"), ("nn", "network")):
        rows.append(["published", label, "0", f"{PUBLISHED_STILL[key]:.2f}", *["–"] * (len(DURATIONS) - 1)])
    for hidden in HIDDEN:
        rows.append(["published", "network", str(hidden), *(f"{value:.2f}" for value in PUBLISHED_POINTS[hidden])])
    return markdown(["motion", "method", "hidden", *(f"{duration:g} s" for duration in DURATIONS)], rows)


def occlusion(numbers: Numbers) -> str:
    """Return Figs 13 and 14: hidden markers of one hand and of two hands."""
    lines = {
        "0_share": ("no marker hidden, % of the time", 100),
        "several_share": ("three or more, % of the time", 100),
        "short_share": (f"spans below {SHORT:g} s, %", 100),
        "mean_s": ("mean span, s", 1),
    }
    published = {"short_share": f"{100 * PUBLISHED_SHORT:.0f}"}
    rows = [
        [
            label,
            *(f"{factor * numbers[f'{setting}_{key}']:.2f}" for setting in ("one", "each", "both")),
            published.get(key, "–"),
        ]
        for key, (label, factor) in lines.items()
    ]
    for n, share in enumerate(PUBLISHED_AT_ONCE, start=1):
        cells = []
        for setting in ("one", "each", "both"):
            few = sum(numbers[f"{setting}_{k}_share"] for k in range(1, len(PUBLISHED_AT_ONCE) + 1))
            cells.append(f"{100 * numbers[f'{setting}_{n}_share'] / few:.2f}")
        rows.append([f"{n} hidden, % of the time with 1 to 4", *cells, f"{100 * share:.0f}"])
    return markdown(["", "one hand", "each of two", "both", "published"], rows)


def limits(numbers: Numbers) -> str:
    """Return the limits of the paper's gloves."""
    rows = []
    for prefix, motion in (("", "recorded"), ("synthesised_", "synthesised")):
        for line in LINES:
            cells = [None if key is None else numbers.get(f"{prefix}{key}") for key in line.keys]
            if any(value is not None for value in cells):
                figures = ["–" if value is None else f"{line.factor * value:.2f}" for value in cells]
                rows.append([motion, line.limit, line.figure, *figures])
    return markdown(["motion", "limit", "figure", "truth", "without rejection", "output"], rows)


def fusion(numbers: Numbers) -> str:
    """Return errors of fingers with hidden markers, with and without inertial sensors."""
    rows = []
    for place, label in FUSION_PLACES.items():
        for count in FINGER_COUNTS:
            for method, name in FUSION_METHODS.items():
                cells = [numbers.get(f"{place}_{method}_{count}_{seconds:.1f}_cm") for seconds in SECONDS]
                if all(value is not None for value in cells):
                    rows.append([label, str(count), name, *(f"{value:.2f}" for value in cells if value is not None)])
    return markdown(["hand", "fingers hidden", "by", *(f"{seconds:g} s" for seconds in SECONDS)], rows)


def steps(numbers: Numbers) -> str:
    """Return errors before and after the paper's flat-hand calibration (4.4), and the error of mirroring (4.10)."""
    labels = {
        "well": "worn as assumed",
        "slipped": "finger markers 6 mm nearer the wrist",
        "turned": "markers on the back 6 mm up and down",
        "unknown": "a hand of unknown shape",
    }
    columns = [(motion, unit) for motion in ("flat", "motion") for unit in ("deg", "cm")]
    rows = [
        [
            label,
            *(
                f"{numbers[f'{fit}_{motion}_before_{unit}']:.2f} → {numbers[f'{fit}_{motion}_after_{unit}']:.2f}"
                for motion, unit in columns
            ),
        ]
        for fit, label in labels.items()
    ]
    head = ["glove", *(f"{'flat hand' if motion == 'flat' else motion}, {UNITS[unit]}" for motion, unit in columns)]
    table = markdown(head, rows)
    return (
        f"{table}\n\nWithout calibration → with it. The hands of a mirrored performance are "
        f"{numbers['mirror_cm']:.3f} cm from the mirror image of the performance's hands, at most."
    )


def chosen_settings(numbers: Numbers) -> str:
    """Return mean errors for each value of some settings."""
    rows = []
    for name, candidates in CANDIDATES.items():
        for value in candidates.values:
            label = f"{value_text(value)}{', the default' if value == candidates.default else ''}"
            rows.append([candidates.title, label, f"{numbers[f'{name}_{value_text(value)}_cm']:.3f}"])
    return markdown(["setting", "value", "mean error"], rows)


def expected(numbers: Numbers) -> str:
    """Return errors of hands by expected error."""
    parts = {"wrist": "wrist is off by", "tip": "fingertips"}
    bins = list(pairwise(EXPECTED))
    rows = [
        [label, *(figure(numbers, f"{part}_{low}_{high}_cm", 1) for low, high in bins)] for part, label in parts.items()
    ]
    return markdown(["expected, cm", *(f"{low}-{high}" for low, high in bins)], rows)


def speed(numbers: Numbers) -> str:
    """Return the time of a frame of gloves."""
    labels = {
        "": "one marker hidden a hand",
        "_all": "nothing hidden",
    }
    rows = [
        [label, *(f"{numbers[f'{hands}{key}_p50_ms']:.2f}" for hands in ("one_hand", "two_hands"))]
        for key, label in labels.items()
    ]
    return markdown(["p50, ms", "one hand", "two hands"], rows)


BLOCKS = (
    Block("README.md", "gloves", sentence, ("gloves-table3", "gloves-table4")),
    Block(PAGE, "gloves", summary, ("gloves-table3", "gloves-table4", "gloves-speed")),
    Block(PAGE, "gloves-speed", speed, ("gloves-speed",)),
    Block(PAGE, "gloves-layouts", other_sets, ("gloves-layouts",)),
    Block(PAGE, "gloves-fusion", fusion, ("gloves-fusion",)),
    Block(PAGE, "gloves-settings", chosen_settings, ("gloves-settings",)),
    Block(PAGE, "gloves-expected", expected, ("gloves-expected",)),
    Block(PAPER, "gloves-paper", paper, ("gloves-paper",)),
    Block(PAPER, "gloves-paper-joints", paper_joints, ("gloves-paper-joints",)),
    Block(PAPER, "gloves-table3", markers, ("gloves-table3",)),
    Block(PAPER, "gloves-table4", points, ("gloves-table4",)),
    Block(PAPER, "gloves-steps", steps, ("gloves-steps",)),
    Block(PAPER, "gloves-occlusion", occlusion, ("gloves-occlusion",)),
    Block(PAPER, "gloves-limits", limits, ("gloves-limits",)),
)
