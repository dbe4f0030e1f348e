"""Gloves as a device: markers of hands in; wrists, finger joints and fingertips out, as observed points.

The solver (`hands.py`) fills hidden markers, rejects wrong ones and keeps hands from jumping. Its output is observed
like any other point, with its expected error: 1-2 mm if markers are seen, more the longer they are hidden. After all
markers of a hand have been hidden for 0.1 s, the hand is not observed and the tracker completes it. Rotations from
inertial sensors are still observed. If only gloves are tracked, a head is assumed (`standing_head`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bodysense.body.hands.glove import MARKERS, side_of
from bodysense.body.hands.glove_set import GloveSet, packaged_sets
from bodysense.body.hands.hand import (
    FINGERTIPS,
    HAND_JOINTS,
    Side,
    glove_hands,
    glove_marker,
    hand_skeleton,
    mirrored_vectors,
)
from bodysense.body.hands.hand_family import GlovedHand, plain_hand
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.calibration import checked_fit, enough_frames
from bodysense.devices.gloves.hands import GloveModels, Hands, HandsSettings, HandsState, load_glove_models
from bodysense.devices.gloves.standing_head import ACCURACY, StandingHead, StandingHeadState
from bodysense.devices.gloves.virtual_markers import SolvedHand, VirtualGlove, VirtualMarkers, is_standard
from bodysense.errors import BodysenseError, expect
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_multiply
from bodysense.io.markers.raw_markers import points_alone
from bodysense.observing.observation import OPTICAL_ACCURACY, Observation
from bodysense.observing.points import joined_points, without_gloves

SIDES: tuple[Side, ...] = ("left", "right")


_LOST = 0.05  # m; a hand with a larger expected error of its wrist is not observed


class GloveState(NamedTuple):
    """State for the next frame."""

    hands: HandsState
    head: StandingHeadState
    virtual: tuple[SolvedHand, ...] = ()  # of hands with other than the standard markers

    def __repr__(self) -> str:
        return f"GloveState({'no frame' if self.hands.time is None else f'at {self.hands.time:.4g} s'})"


@dataclass(frozen=True, eq=False)
class GloveDevice:
    """A glove on one hand or both. Immutable; state is an argument.

    `hands` solves the hands 'left' and 'right', or one of them; `glove_device` makes a device for a wearer. Raises
    BodysenseError for hands with other names.
    """

    hands: Hands
    wearer: StandingHead | None = None  # head that is assumed if only gloves are tracked; None: no assumed head
    virtual: VirtualMarkers = VirtualMarkers({})  # of hands with other than the standard markers

    def __post_init__(self) -> None:
        strange = [name for name in self.hands.hands if name not in SIDES]
        if strange:
            raise BodysenseError(f"gloves: the hand {strange[0]!r} is not of this body; it has 'left' and 'right'")

    def __repr__(self) -> str:
        return f"GloveDevice({' and '.join(self.hands.hands)} hand)"

    @cached_property
    def points(self) -> tuple[str, ...]:
        """The observed points: the wrist, 15 finger joints and five fingertips of every hand."""
        return tuple(f"{side}_{name}" for side in self.hands.hands for name in (*HAND_JOINTS, *FINGERTIPS))

    def start(self) -> GloveState:
        """Return the state before the first frame."""
        return GloveState(self.hands.start(), StandingHeadState(), self.virtual.start())

    def step(self, observation: Observation, state: GloveState) -> tuple[Observation, GloveState]:
        """Replace the gloves' markers of T frames by points of the hands; one call equals T calls with one frame.

        Other points are unchanged. If another device observes the same points, the glove's replace them in frames in
        which it tracks the hand. Raises BodysenseError for a point that is named twice and for time that does not
        increase.
        """
        virtual = state.virtual
        if self.virtual.gloves:
            observation, virtual = self.virtual.step(observation, virtual)
        answers, hands = self.hands.step(observation, state.hands)
        others = without_gloves(observation)
        # Nothing but inertial sensors of gloves: joints of hands with a rotation only.
        joints = {f"{side}_{name}" for side in self.hands.hands for name in HAND_JOINTS}
        places = others.has_position.any(axis=0)
        alone = self.wearer is not None and joints.issuperset(others.points) and not places.any()
        assumed = ("head",) if alone else ()
        points = tuple(dict.fromkeys((*others.points, *self.points, *assumed)))
        more = points[len(others.points) :]
        unseen = np.full((len(observation), len(more), 3), np.nan)
        merged = joined_points(others, points_alone(more, unseen, observation.time))
        for side, answer in answers.items():
            seen = np.flatnonzero(answer.confidence[:, 0] <= _LOST)  # the wrist's
            place = np.array([points.index(f"{side}_{name}") for name in (*HAND_JOINTS, *FINGERTIPS)])
            joints = place[: len(HAND_JOINTS)]
            assert answer.pose is not None
            rotation = np.asarray(forward_kinematics(answer.pose)[1])
            self._turn_by_sensors(merged, joints, rotation)
            merged.position[np.ix_(seen, place)] = answer.position[seen]
            merged.has_position[np.ix_(seen, place)] = True
            merged.accuracy[np.ix_(seen, place)] = np.maximum(answer.confidence[seen], OPTICAL_ACCURACY)
            merged.rotation[np.ix_(seen, joints)] = rotation[seen]
            merged.has_rotation[np.ix_(seen, joints)] = True
        head = self._with_head(merged, state.head) if alone else state.head
        return merged, GloveState(hands, head, virtual)

    @staticmethod
    def _turn_by_sensors(observation: Observation, joints: np.ndarray, rotation: np.ndarray) -> None:
        """Replace, in place, the rotations of a hand's sensors: solved fingers on the measured back of the hand.

        `joints` (16,) are the hand's joints among the points, `rotation` (T, 16, 4) their solved rotations in the
        world.
        """
        is_sensor = observation.has_rotation[:, joints] & ~observation.has_position[:, joints]
        held = is_sensor & is_sensor[:, :1]
        if held.any():
            wrist = observation.rotation[:, joints[:1]]
            turned = quaternion_multiply(quaternion_multiply(wrist, quaternion_conjugate(rotation[:, :1])), rotation)
            observation.rotation[:, joints] = np.where(held[..., None], turned, observation.rotation[:, joints])

    def _with_head(self, observation: Observation, state: StandingHeadState) -> StandingHeadState:
        """Fill in the assumed head, in place, if a hand is observed."""
        assert self.wearer is not None
        wrists = [observation.points.index(f"{side}_wrist") if side in self.hands.hands else -1 for side in SIDES]
        is_gloved, head = np.array([place >= 0 for place in wrists]), observation.points.index("head")
        for t, now in enumerate(observation.time.tolist()):
            known = observation.has_position[t, wrists] & is_gloved
            if known.any():
                place, turn, state = self.wearer.follow(
                    observation.position[t, wrists], observation.rotation[t, wrists], known, now, state
                )
                observation.position[t, head], observation.rotation[t, head] = place, turn
                observation.has_position[t, head] = observation.has_rotation[t, head] = True
                observation.accuracy[t, head] = ACCURACY
        return state


def has_standard_gloves(observation: Observation) -> bool:
    """Whether all gloves have the standard markers, so that the hand need not be calibrated."""
    return all(found[1] in MARKERS for found in map(glove_marker, observation.points) if found)


def gloved_sides(points: Iterable[str]) -> tuple[Side, ...]:
    """Return the sides of the gloves among the points. Raises BodysenseError without gloves."""
    found = glove_hands(points)
    sides: tuple[Side, ...] = tuple(side for side in SIDES if side in found)
    if not sides:
        names = ", ".join(map(repr, found)) or "missing"
        raise BodysenseError(f"the gloves are {names}; name the body's hands 'left' and 'right'")
    return sides


def glove_device(
    skeleton: Skeleton,
    sides: Iterable[Side] = SIDES,
    models: GloveModels | None = None,
    settings: HandsSettings = HandsSettings(),
    calibrated: Mapping[str, GlovedHand] | None = None,
) -> GloveDevice:
    """Return the glove device of a wearer.

    Args:
        skeleton: the wearer's skeleton.
        sides: hands that wear a glove.
        models: networks of the solver; the packaged ones if omitted.
        settings: settings of the solver.
        calibrated: calibrated hands (`calibrated_hands`) by side.
    """
    expect(skeleton, Skeleton, "glove_device", "the wearer's Skeleton, such as Person(height=1.75).skeleton")
    gloved = {side: plain_hand(hand_skeleton(skeleton, side_of(side))) for side in sides}
    gloved |= {side: hand for side, hand in (calibrated or {}).items() if side in gloved}
    virtual = {side: VirtualGlove(hand) for side, hand in gloved.items() if not is_standard(hand)}
    gloved |= {side: glove.standard for side, glove in virtual.items()}
    solver = Hands(
        {side: hand.skeleton for side, hand in gloved.items()},
        load_glove_models() if models is None else models,
        settings,
        gloves={side: hand.glove for side, hand in gloved.items()},
        axes=np.stack([hand.axes for hand in gloved.values()]),
    )
    return GloveDevice(solver, wearer=StandingHead(skeleton), virtual=VirtualMarkers(virtual))


def check_calibrated(points: Iterable[str], sides: Iterable[Side], calibrated: Mapping[str, GlovedHand]) -> None:
    """Raise BodysenseError if a glove's marker set is neither standard nor that of a calibrated hand."""
    for side in sides:
        names = {found[1] for found in map(glove_marker, points) if found and found[0] == side}
        known = calibrated[side].glove.markers if side in calibrated else MARKERS
        if not names & set(known):
            raise BodysenseError(
                f"the {side} hand is not calibrated with the markers of its glove ({', '.join(sorted(names)[:4])} …): "
                "calibrate it by bodysense track TAKE.c3d --marker-set FILE -o OUT.bvh --save-person ME.json"
            )


def calibrated_hands(observation: Observation, marker_set: GloveSet | None = None) -> dict[str, GlovedHand]:
    """Calibrate the hands of a body from their gloves, by side; hands with too few seen markers are left out.

    `marker_set` is found among the packaged sets by the points' names if omitted. Raises BodysenseError if too few
    markers of a glove with another than the standard set are seen, because it cannot be used without calibration.
    """
    found, marker_set = {}, set_of(observation.points) if marker_set is None else marker_set
    for side in gloved_sides(observation.points):
        markers = markers_of(observation, side, marker_set)
        if enough_frames(markers, marker_set) or marker_set.names != MARKERS:
            found[side] = checked_fit(markers, marker_set, side).hand
    return found


def set_of(points: Iterable[str]) -> GloveSet:
    """Return the packaged set with the names of the gloves' points. Raises BodysenseError if no set matches."""
    names = {found[1] for found in map(glove_marker, points) if found}
    for one in packaged_sets().values():
        if names <= set(one.names):
            return one
    unknown = sorted(names - set(MARKERS))
    raise BodysenseError(f"the gloves have the marker {unknown[0]!r}, which no known set has; give --marker-set FILE")


def markers_of(observation: Observation, side: Side, marker_set: GloveSet) -> np.ndarray:
    """Return the markers (T, M, 3) m of a hand, mirrored if right; NaN where hidden."""
    markers = np.full((len(observation), len(marker_set.names), 3), np.nan)
    for row, name in enumerate(marker_set.names):
        if (point := f"{side}_glove_{name}") in observation.points:
            place = observation.points.index(point)
            markers[:, row] = np.where(observation.has_position[:, place, None], observation.position[:, place], np.nan)
    return mirrored_vectors(markers, side)
