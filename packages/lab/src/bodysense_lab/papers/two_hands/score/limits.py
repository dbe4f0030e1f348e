"""Measurements of the limits that the paper states for its gloves (two-hands, section 7).

Two hands are watched by a ring of cameras and completed by the run time as users have it; again with wrong samples
among their markers, believed or rejected; and again with markers that have no names.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bodysense.body.hands.hand import FINGERS, Side, mirrored_rotations, mirrored_vectors
from bodysense.body.hands.hand_capsules import GIVE, NAMES, hand_capsules, mutual_depth, own_depth, own_pairs
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.hands import GloveModels, Hands, HandsSettings, load_glove_models
from bodysense.devices.gloves.labels.labelling import Labeller
from bodysense.devices.simulated.camera_ring import CameraRing
from bodysense.devices.simulated.glove import GloveCapture, observe_hands
from bodysense.errors import BodysenseError
from bodysense.observing.observation import Observation
from bodysense.quality.metrics import joint_error
from bodysense_lab.core.scoring import Tally
from bodysense_lab.core.table import finite
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.papers.two_hands.score.hand_pairs import HandPair

COUNTED = 0.001  # m: a deeper penetration counts
TOUCHING = 0.002  # m: fingertips whose surfaces are nearer touch
JUMP = 0.005  # m: a point that goes so much farther than in truth jumps
SPIKES = (0.0, 0.01, 0.05)  # shares of the samples that are wrong
SYNTHESISED_PIECES = 6
_TIPS = [NAMES.index(f"{finger}3") for finger in FINGERS]


@dataclass
class Findings:
    """Means and largest values under names."""

    means: Tallies = field(default_factory=Tallies)
    largest: dict[str, float] = field(default_factory=dict)

    def add(self, name: str, values: np.ndarray) -> None:
        """Add values of any shape to a mean; there may be no values."""
        self.means.add((name,), values)

    def add_largest(self, name: str, values: np.ndarray) -> None:
        """Keep the largest of values of any shape."""
        self.largest[name] = float(np.max(values, initial=self.largest.get(name, -np.inf)))

    def merge(self, other: Findings) -> None:
        """Add the findings of another instance."""
        self.means.merge(other.means)
        for name, value in other.largest.items():
            self.add_largest(name, np.array(value))

    def numbers(self) -> dict[str, float]:
        """Return the figures as one flat object; missing ones are left out."""
        return finite({name: tally.mpjpe for (name,), tally in self.means.items()} | self.largest)


def measure_limits(
    pair: HandPair, rng: np.random.Generator, cameras: CameraRing, markers: Path | None, joints: Path | None
) -> Findings:
    """Measure everything of one recording by networks of files (None: the packaged ones)."""
    return measure_pair(pair, load_glove_models(markers, joints), cameras, rng)


def measure_pair(pair: HandPair, models: GloveModels, cameras: CameraRing, rng: np.random.Generator) -> Findings:
    """Measure everything of one recording, under the keys of `limits_report`."""
    findings = Findings()
    watched = observe_hands(pair.hands, pair.time, GloveCapture(cameras), rng, pair.body)
    output = completed(pair, watched, models, HandsSettings())
    for name, motion in (("truth", pair), ("output", output)):
        count_penetration(findings, name, motion)
    count_touches(findings, output, pair)
    predicted, true = points_of(output), points_of(pair)
    findings.add("error_cm_output", joint_error(predicted, true))
    count_jumps(findings, predicted, true)
    for share in SPIKES:
        noisy = observe_hands(pair.hands, pair.time, GloveCapture(spikes=share), rng)
        for name, rejection in (("rejected", HandsSettings().rejection), ("believed", None)):
            predicted = completed(pair, noisy, models, HandsSettings(rejection=rejection))
            error = joint_error(points_of(predicted), points_of(pair))
            findings.add(f"spikes_{100 * share:g}_error_cm_{name}", error)
    score = label_accuracy(watched, {name: pose.skeleton for name, pose in pair.hands.items()}, rng)
    for name, share in (("label_accuracy_share", score.right), ("label_wrong_share", score.wrong)):
        findings.means.merge({(name,): Tally(score.markers, score.markers * share)})
    return findings


def completed(pair: HandPair, observation: Observation, models: GloveModels, settings: HandsSettings) -> HandPair:
    """Solve both hands from their markers, as left hands in their own worlds."""
    hands = Hands({name: pose.skeleton for name, pose in pair.hands.items()}, models, settings)
    answers, _ = hands.step(observation, hands.start())

    def as_left(side: Side) -> Pose:
        predicted = answers[side].pose
        assert predicted is not None
        root, rotation = np.asarray(predicted.root_position), np.asarray(predicted.rotation)
        skeleton = pair.hands[side].skeleton
        return Pose(skeleton, mirrored_vectors(root, side), mirrored_rotations(rotation, side))

    return HandPair(as_left("left"), as_left("right"))


def points_of(pair: HandPair) -> np.ndarray:
    """Return all points (T, 2, 21, 3) m, each hand in its own world."""
    return np.stack([np.asarray(forward_kinematics(pose)[0]) for pose in pair.hands.values()], axis=1)


def count_penetration(findings: Findings, name: str, pair: HandPair) -> None:
    """Count frames in which a hand penetrates itself or the other: their share, and the mean and largest depth, mm."""
    own = np.maximum(own_depth(pair.left).max(axis=-1), own_depth(pair.right).max(axis=-1))
    mutual = mutual_depth(pair.left, pair.right).max(axis=(-1, -2))
    for kind, depth in (("own", own), ("mutual", mutual), ("any", np.maximum(own, mutual))):
        inside = depth > COUNTED
        findings.add(f"{kind}_penetrating_share_{name}", inside)
        findings.add(f"{kind}_penetration_mm_{name}", 1000 * depth[inside])
        findings.add_largest(f"{kind}_deepest_mm_{name}", 1000 * np.maximum(depth, 0.0))


def count_touches(findings: Findings, pair: HandPair, truth: HandPair) -> None:
    """Measure the gaps, mm, between fingertips that truly touch, and between thumb and index finger alone."""
    predicted, true = fingertip_gaps(pair), fingertip_gaps(truth)
    touching = true < TOUCHING
    findings.add("touch_gap_mm_output", 1000 * np.maximum(predicted, 0.0)[touching])
    findings.add("touch_kept_share_output", predicted[touching] < TOUCHING)
    pinch = touching[:, [0, len(FINGERS) - 1]]  # of each hand the first pair is thumb and index
    gap = predicted[:, [0, len(FINGERS) - 1]][pinch]
    findings.add("pinch_gap_mm_output", 1000 * np.maximum(gap, 0.0))
    findings.add("pinch_error_mm_output", 1000 * np.abs(gap - true[:, [0, len(FINGERS) - 1]][pinch]))


def fingertip_gaps(pair: HandPair) -> np.ndarray:
    """Return gaps (T, 4 + 4 + 25) m between surfaces: of thumb and fingertips of each hand, then between both hands."""
    first, second = own_pairs()
    rows = [
        int(np.flatnonzero((first == _TIPS[0]) & (second == tip))[0]) for tip in _TIPS[1:]
    ]  # the thumb's capsules come first
    radius = [hand_capsules(pose.skeleton).radius[_TIPS] for pose in pair.hands.values()]
    gaps = [
        -own_depth(pose)[:, rows] - GIVE * (thick[0] + thick[1:])
        for pose, thick in zip(pair.hands.values(), radius, strict=True)
    ]
    depth = mutual_depth(pair.left, pair.right)[:, _TIPS][:, :, _TIPS]
    mutual = -depth - GIVE * (radius[0][:, None] + radius[1])
    return np.concatenate([*gaps, mutual.reshape(len(depth), -1)], axis=1)


def count_jumps(findings: Findings, predicted: np.ndarray, true: np.ndarray) -> None:
    """Count how much farther points (T, 2, 21, 3) m go in a frame than in truth, and how their error changes, mm.

    Every frame counts with its largest point.
    """
    step, truth = (np.linalg.norm(np.diff(points, axis=0), axis=-1) for points in (predicted, true))
    beyond = (step - truth).max(axis=(1, 2), initial=0.0)
    error = np.linalg.norm(np.diff(predicted - true, axis=0), axis=-1)
    findings.add_largest("largest_jump_mm_output", 1000 * beyond)
    findings.add("jump_share_output", beyond > JUMP)
    findings.add_largest("largest_error_step_mm_output", 1000 * error)
    findings.add("error_step_share_output", error.max(axis=(1, 2), initial=0.0) > JUMP)


@dataclass(frozen=True)
class LabelScore:
    """How well points were labelled, as shares of the markers that were there to be seen."""

    right: float
    wrong: float  # got another marker's label
    markers: int


def label_accuracy(
    observation: Observation,
    hands: Mapping[str, Skeleton],
    rng: np.random.Generator,
    ghosts: int = 0,
) -> LabelScore:
    """Take the names off the gloves' markers of an observation (T frames), shuffle them, label them, and compare.

    `ghosts` points a frame that are no markers are added, anywhere within 0.3 m of the gloves. `hands` gives every hand
    whose markers are in the observation its skeleton, as a left hand.
    """
    labeller = Labeller(hands)
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
    return LabelScore(right / total, wrong / total, total)
