"""Gloves on unseen hands: of a person left out of training, drawn hands, and the hand of the paper's glove.

The motion is that of the test clips. *Foreign*: a clip on its own hand, by networks that were trained without its
person (`bodysense train gloves --leave-one-out`). *Stranger*: on a hand drawn from the hand shape space. *Template*:
on a hand with the markers of the template in the paper's release. Every hand is scored with its
exact shape, with its size alone, and with the shape that a calibration by the clip's own markers finds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from zlib import crc32

import numpy as np

from bodysense.body.hands.glove import Glove, default_glove, hand_size, marker_positions
from bodysense.body.hands.hand import FINGERS, hand_skeleton
from bodysense.body.hands.hand_family import COUNT, GlovedHand, draw_hand, hand_of, plain_hand, transfer_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.gloves.calibration import FEWEST, fit_hand
from bodysense.devices.gloves.gap_fillers import GapFiller, NetworkGapFiller
from bodysense.devices.gloves.hands import HandsSettings, load_glove_models
from bodysense.devices.gloves.networks import (
    JOINT_NETWORK,
    MARKER_NETWORK,
    HandNetwork,
    load_joint_network,
    load_marker_network,
)
from bodysense.errors import BodysenseError
from bodysense_lab.papers.two_hands.trials import (
    DURATIONS,
    HandErrors,
    Trials,
    cut,
    finger_error,
    hide_some,
    marker_error,
)
from bodysense_lab.synthesis.motion import HandMotion

FOREIGN, UNSEEN, TEMPLATE = "foreign", "stranger", "template"
PLACES = {FOREIGN: "left-out hand", UNSEEN: "unseen hands", TEMPLATE: "the paper's hand"}
WAYS = {"nn": "hand known", "untold": "size known", "calibrated": "hand calibrated"}
ALONE = "network_alone"  # known hand; the offset at hiding is not kept
_AT_ONCE = 1e-9  # s, half-life of that error
FEW_MANY = (1, 4)  # markers hidden at once
_LOOKED = 600  # frames that a calibration looks at: ten seconds


# The template of the paper's release, metres: y toward the wrist, x into the palm, z toward the thumb.
_TEMPLATE = (
    *((-0.0059, -0.0796, -0.0325), (-0.0300, 0.0, 0.0), (-0.0155, -0.0869, 0.0319)),
    *((-0.0006, -0.1787, -0.0125), (0.0037, -0.1562, -0.0293), (-0.0013, -0.1761, 0.0250)),
    *((-0.0052, -0.1889, 0.0067), (-0.0014, -0.0512, 0.0558), (0.0116, -0.1038, 0.0948)),
)


@dataclass(frozen=True)
class ForeignModels:
    """Networks that are scored on unseen hands; paths, or None for packaged ones."""

    markers: Path | None = None
    joints: Path | None = None
    left_out: Path | None = None  # a folder of networks that were trained without a person

    def of(self, place: str, person: str) -> tuple[Path | None, Path | None] | None:
        """Return the marker and the joint network for a place, or None if there are no such networks."""
        if place != FOREIGN:
            return self.markers, self.joints
        if self.left_out is None or not person:
            return None
        folder = self.left_out / f"without-{person}"
        if not folder.is_dir():
            raise BodysenseError(f"{folder}: no such folder; train with: bodysense train gloves --leave-one-out")
        return folder / MARKER_NETWORK, folder / JOINT_NETWORK


def foreign_markers(motions: list[HandMotion], person: str, models: ForeignModels, stride: int) -> HandErrors:
    """Errors of hidden markers, cm, under (place, way, hidden, duration)."""
    means = HandErrors(person)
    for place, files, trials, ways in _settings(motions, person, models, stride, calibrate=False):
        network = load_marker_network(files[0])
        fillers: dict[str, GapFiller] = {
            way: NetworkGapFiller(network, taken.hands, taken.gloves) for way, taken in ways.items()
        }
        fillers[ALONE] = NetworkGapFiller(network, trials.hands, trials.gloves, fading=_AT_ONCE)
        for count in FEW_MANY:
            hidden = hide_some(len(trials), count, np.random.default_rng(count))
            for way, filler in fillers.items():
                for duration, error in zip(DURATIONS, marker_error(trials, hidden, filler), strict=True):
                    means.add((place, way, count, duration), error)
    return means


def foreign_fingers(
    motions: list[HandMotion], person: str, models: ForeignModels, settings: HandsSettings, stride: int
) -> HandErrors:
    """Errors of the joints of fingers, cm, under (place, way, hidden, duration); nothing hidden: (…, 0, 0.0)."""
    means = HandErrors(person)
    for place, files, trials, ways in _settings(motions, person, models, stride, calibrate=True):
        loaded = load_glove_models(*files)
        for count in FEW_MANY:
            hidden = hide_some(len(trials), count, np.random.default_rng(count))
            for way, taken in ways.items():
                assumed = replace(taken, markers=trials.markers, points=trials.points)
                still, *errors = finger_error(assumed, hidden, loaded, settings)
                means.add((place, way, 0, 0.0), still)
                for duration, error in zip(DURATIONS, errors, strict=True):
                    means.add((place, way, count, duration), error)
    return means


def foreign_numbers(means: HandErrors) -> dict[str, float]:
    """Return figures by flat keys: foreign_nn_1_0.1_cm, stranger_untold_…, foreign_network_alone_cm …"""
    numbers = {}
    for place, way, count, duration in means:
        if place in PLACES and way in WAYS:
            name = f"{place}_{way}_{count}" if count == 0 else f"{place}_{way}_{count}_{duration:.1f}"
            numbers[f"{name}_cm"] = means.mean(place, way, count, duration)
    for place in PLACES:
        for count, suffix in zip(FEW_MANY, ("", f"_{FEW_MANY[-1]}"), strict=True):
            worst = [means.mean(place, ALONE, count, duration) for duration in DURATIONS]
            if np.isfinite(worst).any():
                numbers[f"{place}_{ALONE}{suffix}_cm"] = float(np.nanmax(worst))
    return numbers


def _settings(
    motions: list[HandMotion], person: str, models: ForeignModels, stride: int, calibrate: bool
) -> Iterator[tuple[str, tuple[Path | None, Path | None], Trials, dict[str, Trials]]]:
    """Yield each place with its networks, its trials, and the trials with the hands that each way assumes."""
    for place in PLACES:
        files = models.of(place, person)
        if files is None:
            continue
        for motion in motions:
            rng = np.random.default_rng([crc32(motion.name.encode()), motion.side == "right"])
            hand = unseen_hand(place, motion, rng)
            trials = cut([motion], stride, rng, hand)
            if trials is None:
                continue
            taken = {"nn": hand, "untold": _sized(hand)}
            if calibrate and (found := _calibrated(motion, hand, load_joint_network(files[1]), rng)) is not None:
                taken["calibrated"] = found
            ways = {way: replace(trials, gloved_hands=(one,) * len(trials)) for way, one in taken.items()}
            yield place, files, trials, ways


def unseen_hand(place: str, motion: HandMotion, rng: np.random.Generator) -> GlovedHand:
    """Return the hand of a place that makes a motion: the motion's own, a drawn one, or the paper's."""
    if place == FOREIGN:
        return plain_hand(motion.pose.skeleton)
    return draw_hand(rng) if place == UNSEEN else template_hand()


def _sized(hand: GlovedHand) -> GlovedHand:
    """The default hand at the size of another one."""
    default = hand_skeleton(default_skeleton(), "left")
    return plain_hand(default.with_offsets(default.rest_offset * (hand_size(hand.skeleton) / hand_size(default))))


def _calibrated(
    motion: HandMotion, hand: GlovedHand, network: HandNetwork, rng: np.random.Generator
) -> GlovedHand | None:
    """Calibrate a hand by ten seconds of its markers, exact to 0.3 mm. Return None if the motion is too short."""
    some = replace(motion, pose=motion.pose[:_LOOKED])
    if len(some) < FEWEST:
        return None
    markers = np.asarray(marker_positions(hand.glove, transfer_pose(some.pose, hand)))
    return fit_hand(markers + rng.normal(0.0, 3e-4, markers.shape), network=network).hand


@lru_cache(maxsize=1)
def template_hand() -> GlovedHand:
    """A hand of the middle of the family whose markers are, when it is flat, those of the paper's template.

    Fingers are moved and the thumb is stretched to reach its markers; the thumb's middle one is worn 1 cm above.
    """
    glove, middle = default_glove(), hand_of(np.zeros(COUNT)).skeleton
    wanted = dict(zip(glove.markers, np.array(_TEMPLATE)[:, [1, 0, 2]] * [-1, -1, 1], strict=True))  # in our axes
    rest = middle.rest_offset * (np.linalg.norm(wanted["middle_tip"]) / hand_size(middle))
    reached = middle.path @ rest
    for finger in FINGERS[1:]:
        rest[middle.index(f"{finger}1")] += wanted[f"{finger}_tip"] - reached[middle.index(f"{finger}_tip")]
    above = np.array([0.0, 0.01, 0.0])
    rest[middle.index("thumb1")] += wanted["thumb_middle"] - above - reached[middle.index("thumb2")]
    last = [middle.index("thumb3"), middle.index("thumb_tip")]
    missing = wanted["thumb_tip"] - (middle.path @ rest)[last[1]]
    rest[last] += missing / 2
    hand = middle.with_offsets(rest)
    reached = hand.path @ hand.rest_offset
    offset = np.stack(
        [wanted[name] - reached[hand.index(point)] for name, point in zip(glove.markers, glove.points, strict=True)]
    )
    stretched = Glove(glove.markers, glove.points, glove.carried_by, offset, hand_size(hand))
    return replace(plain_hand(hand), glove=stretched)
