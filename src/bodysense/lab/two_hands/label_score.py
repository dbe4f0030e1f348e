"""How well passive markers are labelled: names are taken off, found again, and compared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.labelling import Labeller, LabellingSettings
from bodysense.errors import BodysenseError
from bodysense.observation import Observation


@dataclass(frozen=True)
class LabelScore:
    """How well points were labelled, as shares of the markers that were there to be seen."""

    right: float
    wrong: float  # got another marker's label
    missed: float  # got none
    markers: int


def label_accuracy(
    observation: Observation,
    hands: Mapping[str, Skeleton],
    rng: np.random.Generator,
    ghosts: int = 0,
    settings: LabellingSettings = LabellingSettings(),
) -> LabelScore:
    """Take the names off the gloves' markers of an observation (T frames), shuffle them, label them, and compare.

    `ghosts` points a frame that are no markers are added, anywhere within 0.3 m of the gloves. `hands` gives every hand
    whose markers are in the observation its skeleton, as a left hand.
    """
    labeller = Labeller(hands, settings)
    truth = [observation.points.index(name) for name in labeller.points]
    right = wrong = total = 0
    state = labeller.start()
    for t, now in enumerate(np.asarray(observation.time, dtype=float).tolist()):
        seen = np.flatnonzero(observation.has_position[t, truth])
        points = observation.position[t, truth][seen]
        more = np.zeros((0, 3))
        if ghosts and len(points):
            more = points[rng.integers(len(points), size=ghosts)] + rng.uniform(-0.3, 0.3, (ghosts, 3))
        order = rng.permutation(len(points) + len(more))
        names = np.concatenate([seen, np.full(len(more), -1)])[order]
        labels, state = labeller.label(np.concatenate([points, more])[order], now, state)
        marker = names >= 0
        right += int((labels[marker] == names[marker]).sum())
        wrong += int(((labels != names) & (labels >= 0)).sum())
        total += int(marker.sum())
    if not total:
        raise BodysenseError("labelling: no marker is seen in any frame; there is nothing to label")
    return LabelScore(right / total, wrong / total, 1 - (right + wrong) / total, total)
