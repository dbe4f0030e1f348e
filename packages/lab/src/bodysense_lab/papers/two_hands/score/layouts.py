"""Gloves of other marker sets: finger joints by the whole run time, on hands drawn from the family.

Every hand wears each set where a set's accuracy lets it, and moves for twenty seconds of synthesised motion: the first
ten calibrate it, the others are scored, with all markers and with one after the other hidden for a second.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.hands.glove import MARKERS, glove_of, marker_positions
from bodysense.body.hands.glove_set import GloveSet, parse_set, standard_set
from bodysense.body.hands.hand import FINGERS
from bodysense.body.hands.hand_family import GlovedHand, draw_hand, transfer_pose
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.gloves.calibration import fit_hand
from bodysense.devices.gloves.device import glove_device
from bodysense.devices.gloves.hands import GloveModels, load_glove_models
from bodysense_lab.core.table import Report, finite
from bodysense_lab.papers.two_hands.trials import FINGER_POINTS, HandErrors
from bodysense_lab.synthesis.glove_stream import observed_markers
from bodysense_lab.synthesis.hands import synthesize_hand
from bodysense_lab.synthesis.motion import RATE

SECONDS = 10.0  # that calibrate, and that are scored
NOISE = 3e-4  # m along each axis
_SEED = 4242  # of hands that no network was trained on
_SETTLED = 30  # frames after which a hand is scored
_TIPS = [
    {"label": f"*_{finger}", "segment": f"{finger}3", "along": 0.7, "offset": [0, 0.007, 0], "accuracy": 0.004}
    for finger in FINGERS
]
_THUMB = {"label": "*_joint", "segment": "thumb2", "along": 0.2, "offset": [0, 0.008, 0], "accuracy": 0.004}
_SIX = [*_TIPS, _THUMB]


@dataclass(frozen=True)
class Layout:
    """A marker set that is scored."""

    key: str
    title: str
    glove_set: GloveSet
    side: float | None = None  # m: of its plate


def layouts() -> tuple[Layout, ...]:
    """Return our layout and four others."""
    plate, back = {"labels": ["*_P1", "*_P2", "*_P3"]}, [{"label": f"*_{name}", "is": name} for name in MARKERS]
    knuckles = ("pinky_base", "index_base")
    return (
        Layout("standard", "our nine", standard_set()),
        Layout("plate3", "plate of 3 cm, six on fingers", _set([plate], _SIX), 0.03),
        Layout("plate5", "plate of 5.5 cm, six on fingers", _set([plate], _SIX), 0.055),
        Layout("knuckles", "ours without knuckles", _set([], [row for row in back if row["is"] not in knuckles])),
        Layout("tips", "plate of 4 cm, five fingertips", _set([plate], _TIPS), 0.04),
    )


def layout_table(hands: int, advance: Callable[[], None]) -> Report:
    """Score `hands` hands in each set."""
    models, means = load_glove_models(), HandErrors()
    for number in range(hands):
        for layout in layouts():
            for way, hidden, error in _scored(layout, number, models):
                means.add((layout.key, way, hidden), error)
            advance()
    rows, numbers = [], {}
    for layout in layouts():
        figures = [means.mean(layout.key, way, hidden) for way in _WAYS for hidden in (0, 1)]
        rows.append((layout.title, len(layout.glove_set.markers), *figures))
        numbers |= {f"{layout.key}_{way}_{n}_cm": means.mean(layout.key, way, n) for way in _WAYS for n in (0, 1)}
    return Report(
        name="gloves-layouts",
        title="Gloves of other marker sets: joints of fingers",
        columns=("markers", "count", "hand known", "… one hidden", "calibrated", "… one hidden"),
        rows=tuple(rows),
        numbers=finite(numbers),
        data=(f"{hands} hands drawn from the family (seed {_SEED}), synthesised motion at {RATE:g} Hz.",),
        caption="Mean error of the second and third joint and the tip of every finger, in the world, cm. Calibrated by "
        f"the {SECONDS:g} s before; one hidden: each marker in turn for a second.",
        digits=2,
    )


_WAYS = ("told", "calibrated")


def wear_glove(layout: Layout, bare: GlovedHand, rng: np.random.Generator) -> GlovedHand:
    """Put the markers of a layout on a hand, displaced at random by their accuracy; a plate anywhere on its back."""
    glove = glove_of(layout.glove_set, bare.skeleton, bare.axes)
    offset = glove.offset + rng.normal(size=glove.offset.shape) * [
        marker.accuracy for marker in layout.glove_set.markers
    ]
    if layout.side is not None:
        turn = 2 * np.pi * np.arange(3) / 3 + rng.uniform(0, 2 * np.pi)
        middle = np.array([0.055, 0.035, 0.0]) + rng.normal(size=3) * [0.01, 0.005, 0.008]
        corner = np.stack([np.cos(turn), 0.1 * rng.normal(size=3), np.sin(turn)], axis=1)
        offset[:3] = middle + layout.side / np.sqrt(3) * corner
    return replace(bare, glove=replace(glove, offset=offset))


def _scored(layout: Layout, number: int, models: GloveModels) -> Iterator[tuple[str, int, np.ndarray]]:
    """Yield the way, the number of hidden markers, and the errors (F,) cm of the scored frames."""
    rng = np.random.default_rng([_SEED, number])
    hand = wear_glove(layout, draw_hand(rng), rng)
    pose = transfer_pose(synthesize_hand(hand.skeleton, 2 * SECONDS, rng, RATE).pose, hand)
    markers = np.asarray(marker_positions(hand.glove, pose))
    markers = markers + rng.normal(0.0, NOISE, markers.shape)
    truth = np.asarray(forward_kinematics(pose)[0])[:, hand.skeleton.indices(FINGER_POINTS)]
    half = round(SECONDS * RATE)
    for way in _WAYS:
        known = hand if way == "told" else fit_hand(markers[:half], layout.glove_set, models.joints).hand
        for hidden in (0, 1):
            seen = markers[half:].copy()
            if hidden:
                order = rng.permutation(len(layout.glove_set.markers))
                for second, marker in enumerate(np.resize(order, round(SECONDS))):
                    start = round(second * RATE)
                    seen[start + _SETTLED : start + round(RATE), marker] = np.nan
            yield way, hidden, _errors(known, seen, truth[half:], models, hidden)


def _errors(known: GlovedHand, seen: np.ndarray, truth: np.ndarray, models: GloveModels, hidden: int) -> np.ndarray:
    """Return errors (F,) cm; with a hidden marker, of the frames before it returns."""
    device = glove_device(default_skeleton(), ("left",), models, calibrated={"left": known})
    points = tuple(f"left_glove_{name}" for name in known.glove.markers)
    answer, _ = device.step(observed_markers(points, seen), device.start())
    places = [answer.points.index(f"left_{point}") for point in FINGER_POINTS]
    error = 100 * np.linalg.norm(answer.position[:, places] - truth, axis=-1).mean(axis=1)
    if not hidden:
        return error[_SETTLED:]
    return error[round(RATE) - 1 :: round(RATE)]


def _set(plates: list[dict], markers: list[dict]) -> GloveSet:
    return parse_set({"name": "scored", "plates": plates, "markers": markers}, "scored", standard_set())
