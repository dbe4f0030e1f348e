"""Joints of unassigned trackers, those whose serials name no joint: read from a person's file, or found by position.

Calibration finds the joint of each unassigned tracker. The person's file keeps the joints by serial, so that the
trackers are used at once after a restart. Serials may change. Trackers with unknown serials are therefore matched by
position, while the wearer stands, to joints whose mounts the person's file has.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bodysense.body.person import Person
from bodysense.errors import BodysenseError
from bodysense.files import read_json, written_beside
from bodysense.observing.observation import Observation
from bodysense.observing.points import chosen_points, concatenated_frames
from bodysense.tracking.calibration import TRACKER_JOINTS, assign_trackers
from bodysense_live.protocols.webxr import UNASSIGNED

_KEY = "trackers"  # in a person's file: serial → joint
_STANDING = 0.5  # s for which the wearer must stand before trackers are matched
_UPRIGHT = 0.08  # m, largest distance of the head from its standing height
_STILL = 0.05  # m, largest motion of a standing wearer's head
_AGAIN = 2.0  # s from one match to the next


def save_wearer(person: Person, trackers: Mapping[str, str], path: Path) -> None:
    """Write a person's file with the joints of unassigned trackers by serial. Raises OSError or BodysenseError."""
    text = person.to_json()
    if trackers:
        text = text.rstrip().removesuffix("}").rstrip() + f',\n"{_KEY}": {json.dumps(trackers)}\n}}\n'
    with written_beside(path) as beside:
        beside.write_text(text, encoding="utf-8")


def read_trackers(path: Path) -> dict[str, str]:
    """Return the joints of unassigned trackers by serial from a person's file; empty if it has none.

    Raises BodysenseError for an unreadable file or an invalid table.
    """
    stored = read_json(path, "give a person's file, or leave --person out")
    table = stored.get(_KEY, {}) if isinstance(stored, dict) else {}
    if not isinstance(table, dict) or not all(isinstance(joint, str) for joint in table.values()):
        raise BodysenseError(f"{path}: {_KEY!r} must be a table, serial to one of {', '.join(TRACKER_JOINTS)}")
    unknown = [joint for joint in table.values() if joint not in TRACKER_JOINTS]
    if unknown:
        raise BodysenseError(f"{path}: {_KEY!r} has {unknown[0]!r}; a tracker is worn on {', '.join(TRACKER_JOINTS)}")
    return table


@dataclass(frozen=True, eq=False)
class PlaceMatch:
    """The matching of unassigned trackers: frames in which the wearer stands."""

    standing: tuple[Observation, ...] = ()
    not_before: float = -np.inf  # s, earliest time of the next match

    def step(
        self, observation: Observation, person: Person, head_height: float
    ) -> tuple[PlaceMatch, Mapping[str, str]]:
        """Take a frame. Return the next state, and the joints of trackers that were found, usually none.

        Only joints are matched whose mounts the person has and that nothing else tracks. `head_height`: height in m of
        the head's joint if this person stands.
        """
        time = float(observation.time[0])
        if time < self.not_before or not _can_match(observation, person):
            return self, {}
        place = observation.position[0, observation.points.index("head")]
        first = self.standing[0].position[0, self.standing[0].points.index("head")] if self.standing else place
        if abs(place[1] - head_height) > _UPRIGHT or np.linalg.norm(place - first) > _STILL:
            return replace(self, standing=()), {}
        if self.standing and self.standing[0].points != observation.points:
            return replace(self, standing=(observation,)), {}
        standing = (*self.standing, observation)
        if time - float(standing[0].time[0]) < _STANDING:
            return replace(self, standing=standing), {}
        whole = concatenated_frames(standing)
        whole = chosen_points(whole, np.flatnonzero(whole.has_position.any(axis=0)).tolist())
        unassigned = [name for name in whole.points if name in UNASSIGNED]
        found = assign_trackers(whole, unassigned, person)
        joints = {name: joint for name, joint in found.items() if joint in person.mounts}
        return PlaceMatch(not_before=time + _AGAIN), joints


def _can_match(observation: Observation, person: Person) -> bool:
    """Return whether head and an unassigned tracker are tracked, and a joint with a mount is free."""
    seen = {name for k, name in enumerate(observation.points) if observation.has_position[0, k]}
    head = observation.points.index("head") if "head" in seen else None
    return (
        head is not None
        and bool(observation.has_rotation[0, head])
        and not seen.isdisjoint(UNASSIGNED)
        and any(joint in TRACKER_JOINTS and joint not in seen for joint in person.mounts)
    )
