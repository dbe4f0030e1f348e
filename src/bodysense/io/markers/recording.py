"""Marker files as Observations: gloves, a body, or both."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from bodysense.body.hands.hand import FINGERS
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.io.markers.body import body_of
from bodysense.io.markers.checks import check_gloves
from bodysense.io.markers.files import read_raw
from bodysense.io.markers.marker_sets import nearest, recognised
from bodysense.io.markers.raw_markers import (
    MarkerFormat,
    MarkerRecording,
    RawMarkers,
    Unit,
    glove_labels,
    listed,
    observed_markers,
    world_of,
)
from bodysense.observing.checks import check_observation
from bodysense.observing.points import joined_points

_SHARED = 5  # labels that two subjects share if both are people
_FARTHEST = 1e9  # m from the origin: well over what a wrong unit makes, which has a better message


def read_markers(path: str | Path, form: MarkerFormat = MarkerFormat()) -> MarkerRecording:
    """Read a marker file, convert names, unit and axes to ours, and check that it is plausible.

    Raises BodysenseError naming the file, what is wrong, and the fix.
    """
    return recording_of(read_raw(path, form.rate, form.unit), form, str(path))


def recording_of(raw: RawMarkers, form: MarkerFormat, place: str) -> MarkerRecording:
    """Convert markers of a file or of a stream's frames; `place` names the source in messages.

    Raises BodysenseError naming what is wrong, and the fix.
    """
    raw = _of_one_subject(raw, form, place)
    _check_table(raw, form, place)
    of_gloves = glove_labels(raw, form)
    gloves = _gloves(raw, form, place) if of_gloves else None
    known = recognised(raw.names, form.names)
    if known is None:
        if gloves is None:
            raise BodysenseError(
                f"{place}: no marker of a glove and no marker set of a body among {listed(raw.names)}: "
                f"{nearest(raw.names)}; give a table of names with --names (docs/markers.md), or a glove's --marker-set"
            )
        return gloves
    found = body_of(raw, form, known, place, of_gloves)
    if not found.observation.points:
        raise BodysenseError(f"{place}: no joint follows from what is seen of {known.markers.name}; label more markers")
    check_observation(found.observation, place)
    body = replace(found, remarks=(*raw.remarks, *found.remarks), warnings=(*raw.warnings, *found.warnings))
    if gloves is None:
        return body
    # The body determines unit, axes and floor better than the gloves.
    position = found.world.to_ours(gloves.world.to_file(gloves.observation.position))
    both = joined_points(found.observation, replace(gloves.observation, position=position))
    remarks = (*found.remarks, *(remark for remark in gloves.remarks if not remark.startswith("left out")))
    return replace(body, observation=both, sizes=gloves.sizes, remarks=remarks)


def _of_one_subject(raw: RawMarkers, form: MarkerFormat, place: str) -> RawMarkers:
    """Return the markers of one person, of a file whose labels name several: 'Anna:LASI', 'Ben:LASI'.

    Raises BodysenseError for several people without a choice.
    """
    people: dict[str, set[str]] = {}
    for name in raw.names:
        subject, _, label = name.rpartition(":")
        if subject:
            people.setdefault(subject, set()).add(label.strip().lower())
    alike = [one for one in people if sum(len(people[one] & people[two]) >= _SHARED for two in people) > 1]
    if len(alike) < 2:
        if form.figure is not None:
            raise BodysenseError(f"{place}: --figure {form.figure}: its markers are of one person; leave it out")
        return raw
    names = ", ".join(f"{k} ({subject})" for k, subject in enumerate(alike, start=1))
    if form.figure is None:
        raise BodysenseError(f"{place}: {len(alike)} bodies in it: {names}; choose one with --figure 1")
    if form.figure > len(alike):
        raise BodysenseError(f"{place}: --figure {form.figure}: there is no such body; there are {names}")
    others = [subject for subject in alike if subject != alike[form.figure - 1]]
    keep = [k for k, name in enumerate(raw.names) if name.rpartition(":")[0] not in others]
    cells = (
        None
        if raw.cells is None
        else replace(
            raw.cells,
            columns=raw.cells.columns[keep],
            valid={keep.index(k): column for k, column in raw.cells.valid.items() if k in keep},
        )
    )
    return replace(
        raw,
        names=tuple(raw.names[k] for k in keep),
        position=raw.position[:, keep],
        rotation=None if raw.rotation is None else raw.rotation[:, keep],
        cells=cells,
    )


def with_hands_of(skeleton: Skeleton, sizes: dict[str, float]) -> Skeleton:
    """Return a body whose hands have the mean size of its gloves.

    `sizes` are factors of the default skeleton's hand.
    """
    if not sizes:
        return skeleton
    size = float(np.mean(list(sizes.values())))
    fingers = [name.partition("_")[2].startswith(FINGERS) for name in skeleton.points]
    return skeleton.with_offsets(np.where(np.array(fingers)[:, None], size, 1.0) * skeleton.rest_offset)


def _gloves(raw: RawMarkers, form: MarkerFormat, place: str) -> MarkerRecording:
    """Return the gloves of a file."""
    observation, remarks = observed_markers(raw, form, place)
    check_observation(observation, place, farthest=_FARTHEST)
    unit: Unit = form.unit or raw.unit
    check = check_gloves(observation, place, unit, left_handed=form.left_handed)
    check_observation(observation, place)
    world = world_of(raw, form)
    return MarkerRecording(
        observation,
        raw.frame_rate,
        check.sizes,
        (*raw.remarks, *remarks, *check.remarks),
        raw,
        world,
        warnings=raw.warnings,
    )


def _check_table(raw: RawMarkers, form: MarkerFormat, place: str) -> None:
    """Refuse a table of names that are not in the file."""
    absent = [theirs for theirs in form.names or {} if theirs not in raw.names]
    if absent:
        raise BodysenseError(
            f"{place}: no marker is named {absent[0]!r}, which the table of names has; there are {listed(raw.names)}"
        )
