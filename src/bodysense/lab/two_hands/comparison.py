"""A network of both hands against two of one, a recurrent one against one that is not (two-hands, section 8)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bodysense.body.glove import default_glove, marker_positions
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.continuity import Continuous
from bodysense.devices.gloves.fillers import Filler, LastShape, NetworkFiller, Stack
from bodysense.devices.gloves.hands import natural_markers
from bodysense.devices.gloves.labelling import Labeller, LabellingSettings
from bodysense.devices.gloves.networks import load_marker_network
from bodysense.devices.simulated.camera_ring import CameraRing
from bodysense.devices.simulated.glove import visible
from bodysense.errors import BodysenseError
from bodysense.lab.metrics import joint_error
from bodysense.lab.synthesis.hand_motion import RATE, HandMotion
from bodysense.lab.two_hands.trials import DURATIONS, HIDDEN, KeyedMeans, cut, hide_some, marker_error
from bodysense.lab.two_hands.variants import MEMORY_NETWORK, TWO_HANDS_NETWORK, load_memory, load_two_hands
from bodysense.observation import Observation

_STRIDE = 30  # frames from one trial to the next


def compare_two_hands(
    pairs: Iterable[tuple[HandMotion, HandMotion]],
    networks: Path,
    model: Path | None = None,
    ring: CameraRing = CameraRing(),
) -> dict[str, float]:
    """Errors of markers that two hands hide from a ring of cameras, cm, by a network of both hands and by two of one.

    Both with continuity. `networks` is the folder in which `bodysense train gloves --network two-hands` wrote. Keys:
    single_hidden_cm, two_hands_hidden_cm and, of hands of which four markers or fewer are seen, single_mutual_cm and
    two_hands_mutual_cm; hidden_share, mutual_share. Raises BodysenseError where there is no such network.
    """
    means = KeyedMeans()
    for left, right in pairs:
        hands = (left.pose.skeleton, right.pose.skeleton)
        markers = np.stack([marker_positions(default_glove(), hand.pose) for hand in (left, right)], axis=1)
        seen = visible({"left": left.pose, "right": right.pose}, ring, None).reshape(markers.shape[:3])
        hidden = ~seen
        few = (seen.sum(axis=-1) <= 4)[..., None] & hidden
        means.add(("hidden_share",), hidden.astype(float))
        means.add(("mutual_share",), few.any(axis=-1).astype(float))
        natural = LastShape(np.stack([natural_markers(default_glove(), hand) for hand in hands]))
        fillers = {
            "single": NetworkFiller(load_marker_network(model), hands),
            "two_hands": load_two_hands(networks / TWO_HANDS_NETWORK, hands),
        }
        for name, filler in fillers.items():
            error = _errors(markers, seen, Continuous(Stack((filler, natural))))
            means.add((name, "hidden"), error[hidden])
            means.add((name, "mutual"), error[few])
    numbers = {
        f"{name}_{of}_cm": means.get(name, of) for name in ("single", "two_hands") for of in ("hidden", "mutual")
    }
    return numbers | {name: means.get(name) for name in ("hidden_share", "mutual_share")}


def compare_memory(
    motions: Iterable[HandMotion], networks: Path, model: Path | None = None, seed: int = 1
) -> dict[str, float]:
    """Errors of hidden markers, cm, as in Table 3, by a network that remembers and by one that does not.

    Both with continuity and without. `networks` is the folder in which `bodysense train gloves --network recurrent`
    wrote. Keys: feed_forward_1_0.1_cm …, recurrent_…, feed_forward_alone_…, recurrent_alone_…
    """
    means, rng = KeyedMeans(), np.random.default_rng(seed)
    for motion in motions:
        trials = cut([motion], _STRIDE, rng)
        if trials is None:
            continue
        alone: dict[str, Filler] = {
            "feed_forward": NetworkFiller(load_marker_network(model), trials.hands),
            "recurrent": load_memory(networks / MEMORY_NETWORK, trials.hands),
        }
        for count in HIDDEN:
            hidden = hide_some(len(trials), count, rng)
            for name, filler in alone.items():
                for label, way in ((f"{name}_alone", filler), (name, Continuous(filler))):
                    for duration, error in zip(DURATIONS, marker_error(trials, hidden, way), strict=True):
                        means.add((label, count, duration), error)
    return {f"{name}_{n}_{duration:.1f}_cm": means.get(name, n, duration) for name, n, duration in means.sums}


def _errors(markers: np.ndarray, seen: np.ndarray, filler: Filler) -> np.ndarray:
    """Errors (T, H, 9) cm of markers (T, H, 9, 3) m of which some are `seen` (T, H, 9)."""
    state, filled = filler.start(markers.shape[1]), []
    for now, known in zip(markers, seen, strict=True):
        told, state = filler.fill(np.where(known[..., None], now, np.nan), 1 / RATE, state)
        filled.append(told)
    return joint_error(np.stack(filled), markers)


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
