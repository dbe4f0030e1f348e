"""Hand solver of gloves: markers, some of them hidden or wrong, become posed hands with all their joints.

Right hands are mirrored, and all hands are solved as left ones in one batch. The steps of a frame:

1. Drop wrong markers (`rejection`).
2. Fill hidden markers without jumps (`gap_fillers`).
3. Register the hand to its alignment markers and pose its fingers (`joints`).
4. Pose joints with hidden markers by inertial sensors, if there are any (`inertial`).
5. Blend to markers that are found again (`blending`).

Special cases:

- If all markers of a hand are hidden, it stays in place for 0.5 s, then relaxes within 1 s around its wrist
(`RigidGapFiller`). Its expected error grows. When found again, it moves there at 24 cm/s, or within 0.5 s if that is
far (`blending`). A hand that was never seen is relaxed, at the origin.
- If alignment markers are hidden, the filled ones locate the hand. With fewer than three known markers the hand keeps
its last shape, moved onto the known ones.
- Exchanged identifiers of markers are corrected. One of two markers in the same place is dropped (`rejection`).
- A marker that is not finite, farther than `FARTHEST` from the origin or missing in an observation counts as hidden.
- After more than `longest_gap` without a frame everything is reset. A point that is named twice, and time that does
not increase, are errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bodysense.body.hands.glove import Glove, default_glove, glove_points, marker_positions, side_of
from bodysense.body.hands.hand import HAND_JOINTS, default_axes, mirrored_vectors, own_axes
from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.devices.gloves import inertial
from bodysense.devices.gloves.blending import Blend, BlendState
from bodysense.devices.gloves.expected_error import Influence, expected_error, influence
from bodysense.devices.gloves.fingers import POINT_COUNT, HandPoses
from bodysense.devices.gloves.gap_fillers import (
    FADING,
    GapFiller,
    GapFillerStack,
    NetworkGapFiller,
    RigidGapFiller,
    missing,
)
from bodysense.devices.gloves.inertial import Fusion, InertialSettings, InertialState, SensorFlexion
from bodysense.devices.gloves.joints import JointReader
from bodysense.devices.gloves.labels.rejection import Rejection, RejectionSettings, RejectionState
from bodysense.devices.gloves.networks import HandNetwork, load_joint_network, load_marker_network
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_canonical, quaternion_conjugate
from bodysense.io.fingers import relaxed_rotation
from bodysense.observing.checks import FARTHEST, check_order
from bodysense.observing.observation import Observation

FIRST_INTERVAL = 1 / 60  # s: the time step of the first frame
STILL = 5.0  # degrees: how far finger joints may turn in a calibration, on average
NEVER = 1e6  # s: hidden time of a marker that was never seen


@dataclass(frozen=True)
class GloveModels:
    """The networks that complete hands."""

    markers: HandNetwork
    joints: HandNetwork


def load_glove_models(markers: str | Path | None = None, joints: str | Path | None = None) -> GloveModels:
    """Load both networks from paths, or the packaged ones for None. Raises BodysenseError for other files."""
    return GloveModels(load_marker_network(markers), load_joint_network(joints))


@dataclass(frozen=True)
class HandsSettings:
    """Settings of the hand solver."""

    rejection: RejectionSettings | None = field(default_factory=RejectionSettings)  # if None, every marker is accepted
    speed: float = 0.24  # m/s of a hand toward markers that are found again (`blending`); the paper: 0.25 (4.7)
    unseen_speed: float = 0.12  # m/s, the same for points with hidden markers
    fading: float | None = (
        FADING  # s, half-life of a network's error of a hidden marker (`gap_fillers`); None: no fading
    )
    hold: float = 0.5  # s for which a hand without seen markers stays in place
    relaxing: float = 1.0  # s in which it then relaxes
    restraint: float = 4.0  # reduction of large turns of fingers to their markers (`fingers.shortest_arcs`); 0: none
    inertial: InertialSettings = InertialSettings()
    longest_gap: float = 1.0  # s without frames after which everything is reset

    def __post_init__(self) -> None:
        for name in ("speed", "unseen_speed", "relaxing", "longest_gap"):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"gloves: {name} is {getattr(self, name):g}; it must be positive")
        for name in ("hold", "restraint"):
            if not getattr(self, name) >= 0:
                raise BodysenseError(f"gloves: {name} is {getattr(self, name):g}; it must be 0 or more")


class HandsState(NamedTuple):
    """State for the next frame."""

    time: float | None  # s, of the last frame
    rejection: RejectionState
    gap_filler: Any
    hidden: np.ndarray  # (H, 9) s for which each marker has been hidden
    blend: BlendState | None  # before the first frame: None
    inertial: InertialState


@dataclass(frozen=True, eq=False)
class Hands:
    """Solver of posed hands from the markers of gloves.

    `hands` maps the name of every hand ('left', 'right', 'left2' …) to its skeleton as a left hand (`hand_skeleton`).
    `gap_filler` replaces the default one. `calibrated` finds the `calibration`.
    Raises BodysenseError without hands, or for a name that begins with neither 'left' nor 'right'.
    """

    hands: Mapping[str, Skeleton]
    models: GloveModels
    settings: HandsSettings = HandsSettings()
    glove: Glove = field(default_factory=default_glove)
    gloves: Mapping[str, Glove] = field(default_factory=dict)  # of hands without `glove`
    gap_filler: GapFiller | None = None
    calibration: np.ndarray | None = None  # (H, 15, 4) rotation that follows each joint's predicted one
    axes: np.ndarray | None = None  # (H, 15, 4) rotation of each joint's axes from the default hand's

    def __post_init__(self) -> None:
        if not self.hands:
            raise BodysenseError("gloves: no hand is named; give {'left': …, 'right': …}")
        for name in self.hands:
            side_of(name)

    @cached_property
    def skeletons(self) -> dict[str, Skeleton]:
        """The skeleton of every hand's estimate, mirrored back."""
        return {
            name: hand.with_offsets(mirrored_vectors(hand.rest_offset, side_of(name)))
            for name, hand in self.hands.items()
        }

    @cached_property
    def _flip(self) -> np.ndarray:
        """(H, 1, 3) factors that mirror positions of right hands."""
        return np.stack([mirrored_vectors(np.ones((1, 3)), side_of(name)) for name in self.hands])

    @cached_property
    def _turned_over(self) -> np.ndarray:
        """(H, 1, 4) factors that mirror rotations of right hands."""
        return np.concatenate([np.ones_like(self._flip[..., :1]), self._flip[..., :1] * self._flip], axis=-1)

    @cached_property
    def _gloves(self) -> tuple[Glove, ...]:
        """The glove of every hand."""
        return tuple(self.gloves.get(name, self.glove) for name in self.hands)

    @cached_property
    def _reader(self) -> JointReader:
        hands, settings = tuple(self.hands.values()), self.settings
        return JointReader(self.models.joints, hands, self._gloves, settings.restraint, self.calibration, self.axes)

    @cached_property
    def _gap_filler(self) -> GapFiller:
        if self.gap_filler is not None:
            return self.gap_filler
        hands = tuple(self.hands.values())
        natural = np.stack([natural_markers(glove, hand) for glove, hand in zip(self._gloves, hands, strict=True)])
        last = RigidGapFiller(natural, self.settings.hold, self.settings.relaxing)
        network = NetworkGapFiller(self.models.markers, hands, self._gloves, self.settings.fading)
        return GapFillerStack((network, last))

    @cached_property
    def _rejection(self) -> Rejection:
        return Rejection(tuple(self.hands.values()), self.glove, self.settings.rejection or RejectionSettings())

    @cached_property
    def _blend(self) -> Blend:
        return Blend(self._reader.shape, self.glove, self.settings.speed, self.settings.unseen_speed)

    @cached_property
    def _fusion(self) -> Fusion:
        axes = default_axes() if self.axes is None else own_axes(self.axes)
        axes = np.broadcast_to(axes, (len(self.hands), *axes.shape[-3:]))
        return Fusion(self._reader.shape, axes, self.settings.inertial)

    @cached_property
    def _influence(self) -> Influence:
        return influence(self.glove)

    def start(self) -> HandsState:
        """Return the state before the first frame."""
        hidden, gap_filler = (
            np.full((len(self.hands), len(self.glove.markers)), NEVER),
            self._gap_filler.start(len(self.hands)),
        )
        return HandsState(None, self._rejection.start(), gap_filler, hidden, None, self._fusion.start())

    def step(self, observation: Observation, state: HandsState) -> tuple[dict[str, PointEstimate], HandsState]:
        """Complete T frames in order; return an estimate of every hand on its skeleton, with its pose, and the state.

        Raises BodysenseError for a point that is named twice and if time does not increase.
        """
        markers, _ = self._measured(observation)
        sensed = self._sensors(observation)
        frames, hands = len(observation.time), len(self.hands)
        root, rotation = np.empty((frames, hands, 3)), np.empty((frames, hands, len(HAND_JOINTS), 4))
        position = np.empty((frames, hands, POINT_COUNT, 3))
        hidden = np.empty((frames, hands, len(self.glove.markers)))
        for frame, now in enumerate(observation.time.tolist()):
            interval, state = self._time_step(now, state)
            sensed_now = None if sensed is None else SensorFlexion(sensed.flexion[frame], sensed.vertical[frame])
            pose, state = self.complete(markers[frame], interval, state, sensed_now)
            state = HandsState(now, *state[1:])
            root[frame], rotation[frame], position[frame] = pose
            hidden[frame] = state.hidden
        has_sensor = None if sensed is None else inertial.sensed_markers(sensed, self._reader.shape, hidden.shape)
        error, occluded = expected_error(hidden, self._influence, has_sensor)
        root *= self._flip[:, 0]
        position *= self._flip
        rotation *= self._turned_over * np.copysign(1.0, rotation[..., :1])
        return {
            name: PointEstimate(
                skeleton,
                position[:, k],
                occluded[:, k],
                error[:, k],
                Pose(skeleton, root[:, k], rotation[:, k]),
            )
            for k, (name, skeleton) in enumerate(self.skeletons.items())
        }, state

    def calibrated(self, observation: Observation) -> Hands:
        """Return these hands with a calibration: the inverse of the rotations predicted for flat hands (4.4).

        Uses the frames with all markers of all hands. Raises BodysenseError if there are no such frames, and for hands
        that move.
        """
        markers, known = self._measured(observation)
        whole = known.all(axis=(1, 2))
        if not whole.any():
            raise BodysenseError(
                f"gloves: in none of {len(known)} frames are all markers of {', '.join(self.hands)} seen; "
                "calibrate with flat hands that every camera sees"
            )
        reader = replace(self._reader, calibration=None)
        each = np.stack([reader.local_rotations(frame) for frame in markers[whole]])
        each /= np.linalg.norm(each, axis=-1, keepdims=True)
        mean = each.mean(axis=0)
        mean /= np.linalg.norm(mean, axis=-1, keepdims=True)
        turned = np.degrees(geodesic_angle(each, mean)).mean()
        if turned > STILL:
            raise BodysenseError(
                f"gloves: finger joints turn by {turned:.0f}° on average, at most {STILL:g}° in a calibration; hold "
                "the hands flat and still, and cut the take to that part"
            )
        return replace(self, calibration=np.asarray(quaternion_conjugate(mean)))

    def complete(
        self, markers: np.ndarray, interval: float, state: HandsState, sensed: SensorFlexion | None = None
    ) -> tuple[HandPoses, HandsState]:
        """Complete one frame of H left hands, each in its own mirrored world.

        Args:
            markers: (H, 9, 3) m, NaN where hidden.
            interval: seconds since the frame before.
            state: after the frame before.
            sensed: flexion that inertial sensors measure; None without sensors.

        Returns:
            The hands, and the state for the next frame.
        """
        rejection, checking = state.rejection, self.settings.rejection is not None
        if checking:
            markers, rejection = self._rejection.check(markers, interval, state.hidden, rejection)
        known = ~missing(markers)
        filled, gap_filler = self._gap_filler.fill(markers, interval, state.gap_filler)
        if checking:
            rejection = self._rejection.remember(
                np.where(known[..., None], markers, filled), known, interval, rejection
            )
        hidden = (state.hidden + interval) * ~known
        solved = self._reader.read(filled)
        without, sensors = self._without_found(solved, filled, known, interval, state), state.inertial
        if sensed is not None:
            by_markers = solved
            solved, sensors = self._fusion.fuse(by_markers, sensed, hidden, interval, state.inertial)
            if without is by_markers:
                without = solved
            elif state.blend is not None:
                longer = (state.hidden + interval) * ~(known & state.blend.known)
                without, _ = self._fusion.fuse(without, sensed, longer, interval, state.inertial)
        poses, blend = self._blend.step(solved, without, known, interval, state.blend)
        return poses, HandsState(state.time, rejection, gap_filler, hidden, blend, sensors)

    def _without_found(
        self, solved: HandPoses, filled: np.ndarray, known: np.ndarray, interval: float, state: HandsState
    ) -> HandPoses:
        """Return the hands without the markers (H, 9, 3) m that were found in this frame; `solved` without such."""
        if state.blend is None or not (found := known & ~state.blend.known).any():
            return solved
        found = found & (state.hidden < NEVER).any(axis=1, keepdims=True)
        kept = np.where((known & ~found)[..., None], filled, np.nan)
        fewer, _ = self._gap_filler.fill(kept, interval, state.gap_filler)
        return self._reader.read(np.where(np.isnan(fewer), filled, fewer))

    def _time_step(self, now: float, state: HandsState) -> tuple[float, HandsState]:
        """Return the time step (s) and the state, which is reset after a gap."""
        check_order(now, state.time, "gloves")
        if state.time is None:
            return FIRST_INTERVAL, state
        if now - state.time > self.settings.longest_gap:
            return FIRST_INTERVAL, self.start()
        return now - state.time, state

    def _measured(self, observation: Observation) -> tuple[np.ndarray, np.ndarray]:
        """Return markers (T, H, 9, 3) m, mirrored for right hands and NaN where hidden, and a mask (T, H, 9)."""
        place = _places(observation.points, tuple(map(glove_points, self.hands)))
        known = observation.has_position[:, place] & (place >= 0)
        markers = np.where(known[..., None], observation.position[:, place] * self._flip, np.nan)
        known = np.linalg.norm(markers, axis=-1) < FARTHEST  # NaN compares false
        return np.where(known[..., None], markers, np.nan), known

    def _sensors(self, observation: Observation) -> SensorFlexion | None:
        """Return the flexion (T, H, 15) that inertial sensors measure; None without sensors.

        A sensor is a joint's rotation without a position.
        """
        joints = tuple(tuple(f"{hand}_{joint}" for joint in HAND_JOINTS) for hand in self.hands)
        place = _places(observation.points, joints)
        known = (observation.has_rotation & ~observation.has_position)[:, place] & (place >= 0)
        if not known.any():
            return None
        rotation = observation.rotation[:, place] * self._turned_over
        return inertial.sensor_flexion(np.where(known[..., None], rotation, np.nan), self._fusion.axes)


def natural_pose(hand: Skeleton) -> Pose:
    """Return a relaxed left-model hand at the origin."""
    rotation = np.zeros((len(HAND_JOINTS), 4))
    rotation[0, 0] = 1.0
    rotation[1:] = [relaxed_rotation(f"left_{joint}") for joint in HAND_JOINTS[1:]]
    return Pose(hand, np.zeros(3), np.asarray(quaternion_canonical(rotation)))


def natural_markers(glove: Glove, hand: Skeleton) -> np.ndarray:
    """Return markers (9, 3) m on a relaxed left-model hand at the origin."""
    return np.asarray(marker_positions(glove, natural_pose(hand)))


@lru_cache(maxsize=64)
def _places(points: tuple[str, ...], names: tuple[tuple[str, ...], ...]) -> np.ndarray:
    """Return the indices of hands' names among the points (H, N), -1 if missing."""
    index = {point: place for place, point in enumerate(points)}
    if len(index) < len(points):
        twice = next(point for point in points if points.count(point) > 1)
        raise BodysenseError(f"gloves: the point {twice!r} is named twice; names must differ")
    return np.array([[index.get(name, -1) for name in hand] for hand in names])
