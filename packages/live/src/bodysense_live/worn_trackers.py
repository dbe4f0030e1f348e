"""Trackers whose serials name no joint: the joints that they are worn on, kept in a person's file and found by place.

A calibration second decides which joint each nameless tracker is strapped to. A person's file keeps this by serial, so
that the trackers are used at once after a restart. Serials may change, so other nameless trackers are matched by place,
while the wearer stands, to the joints whose mounts the person's file has.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.body.person import Person
from bodysense.completion.calibration import TRACKER_JOINTS, assign_trackers
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.observation import Observation, chosen_points, concatenated_frames
from bodysense_live.webxr import UNDECIDED

_KEY = "trackers"  # in a person's file: serial → joint
_STANDING = 0.5  # s for which the wearer stands before trackers are matched
_UPRIGHT = 0.08  # m between the head and its height in standing
_STILL = 0.05  # m by which the head of a standing wearer moves at most
_AGAIN = 2.0  # s until the next try after trackers were not found


def save_wearer(person: Person, trackers: Mapping[str, str], path: Path) -> None:
    """Write a person's file with the joints of nameless trackers by serial. Raises BodysenseError if it cannot."""
    text = person.to_json()
    if trackers:
        text = text.rstrip().removesuffix("}").rstrip() + f',\n"{_KEY}": {json.dumps(trackers)}\n}}\n'
    with written_beside(path) as beside:
        beside.write_text(text, encoding="utf-8")


def read_trackers(path: Path) -> dict[str, str]:
    """Return the joints of nameless trackers by serial from a person's file; none if it has none.

    Raises BodysenseError for any other table.
    """
    try:
        stored: Any = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise BodysenseError(f"{path} is not a person's file ({error}); give one, or leave --person out") from None
    table = stored.get(_KEY, {}) if isinstance(stored, dict) else {}
    if not isinstance(table, dict) or not all(isinstance(joint, str) for joint in table.values()):
        raise BodysenseError(f"{path}: {_KEY!r} must be a table, serial to one of {', '.join(TRACKER_JOINTS)}")
    unknown = [joint for joint in table.values() if joint not in TRACKER_JOINTS]
    if unknown:
        raise BodysenseError(f"{path}: {_KEY!r} has {unknown[0]!r}; a tracker is worn on {', '.join(TRACKER_JOINTS)}")
    return table


@dataclass(frozen=True, eq=False)
class PlaceMatch:
    """Frames of a standing wearer whose nameless trackers are to be matched."""

    stood: tuple[Observation, ...] = ()
    not_before: float = -np.inf  # s, the next try

    def step(
        self, observation: Observation, person: Person, head_height: float
    ) -> tuple[PlaceMatch, Mapping[str, str]]:
        """Take a frame. Returns the state after it, and the joints of trackers once they are found.

        `head_height`: m, of the head's joint of this person in standing. Only joints whose mounts the person has, and
        that nothing else tracks, are matched.
        """
        time = float(observation.time[0])
        if time < self.not_before or not _waits(observation, person):
            return self, {}
        place = observation.position[0, observation.points.index("head")]
        first = self.stood[0].position[0, self.stood[0].points.index("head")] if self.stood else place
        if abs(place[1] - head_height) > _UPRIGHT or np.linalg.norm(place - first) > _STILL:
            return replace(self, stood=()), {}
        if self.stood and self.stood[0].points != observation.points:
            return replace(self, stood=(observation,)), {}
        stood = (*self.stood, observation)
        if time - float(stood[0].time[0]) < _STANDING:
            return replace(self, stood=stood), {}
        whole = concatenated_frames(stood)
        whole = chosen_points(whole, np.flatnonzero(whole.has_position.any(axis=0)).tolist())
        nameless = [name for name in whole.points if name in UNDECIDED]
        found = assign_trackers(whole, nameless, person)
        worn = {name: joint for name, joint in found.items() if joint in person.mounts}
        return PlaceMatch(not_before=time + _AGAIN), worn


def _waits(observation: Observation, person: Person) -> bool:
    """Whether the head is tracked, a nameless tracker is, and a joint with a mount is free for it."""
    seen = {name for k, name in enumerate(observation.points) if observation.has_position[0, k]}
    head = observation.points.index("head") if "head" in seen else None
    return (
        head is not None
        and bool(observation.has_rotation[0, head])
        and not seen.isdisjoint(UNDECIDED)
        and any(joint in TRACKER_JOINTS and joint not in seen for joint in person.mounts)
    )
