"""Tracking of one person, with their hands, among the people in a video.

Axes and positions in the picture are those of `landmarks`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import product

import numpy as np

from bodysense.body.arms import ARM_POINTS, SIDES
from bodysense.body.keypoints import ArmKeypoints, arm_directions, torso_rotation
from bodysense.devices.video.landmarks import BODY_LANDMARKS, Bodies, HandLandmarks
from bodysense.devices.video.pictures import Picture
from bodysense.devices.video.posture_constants import VISIBLE
from bodysense.devices.video.sides import SideState, detect_exchange, exchange, update_sides
from bodysense.errors import BodysenseError

_LONGEST_AHEAD = 0.5  # s for which an unseen person is assumed to keep their velocity
_MEMORY = 0.3  # s over which motion, size and colour are averaged
_ARMS = np.array([[BODY_LANDMARKS.index(f"{side}_{point}") for point in ARM_POINTS] for side in SIDES])  # (2, 3)
_WRISTS = _ARMS[:, -1]
_SHOULDERS = _ARMS[:, 0]
_HIPS = np.array([BODY_LANDMARKS.index(f"{side}_hip") for side in SIDES])
# Samples of the clothes' colour between shoulders and hips: shares across and down.
_PATCH = np.stack(np.meshgrid(np.linspace(0.25, 0.75, 5), np.linspace(0.15, 0.75, 6)), axis=-1).reshape(-1, 2)
# Differences between people: 1 is a distance of their size in the picture, or a factor e of their size.
_FARTHEST = 1.2  # difference above which it is another person
_SPEED = 2.0  # 1/s, distance per second of an unseen person that does not count as a difference
_COLOUR = 3.0  # difference of black and white clothes
_ABSENCE = 3.0  # 1/s, added per second for people who are not seen
_PATIENCE = 3.0  # s without the person until another one is chosen
_HAND_REACH = 0.4  # largest distance from an arm's wrist to that of its hand, in sizes of the person
_WRONG_SIDE = 0.25  # added for a hand that is certainly of the other side


@dataclass(frozen=True, eq=False)
class PersonLandmarks:
    """One person's landmarks over time; NaN where the mask is False."""

    time: np.ndarray  # (T,) s
    world: np.ndarray  # (T, 33, 3) m, from the middle of the hips, camera's axes
    picture: np.ndarray  # (T, 33, 2) positions in the picture
    visible: np.ndarray  # (T, 33) probability that a landmark is in the picture and not hidden
    has_body: np.ndarray  # (T,) bool
    hand: np.ndarray  # (T, 2, 21, 2) positions of left and right hand in the picture
    hand_world: np.ndarray  # (T, 2, 21, 3) m, from the middle of the hand, camera's axes
    has_hand: np.ndarray  # (T, 2) bool

    def __getitem__(self, key: slice) -> PersonLandmarks:
        """Return the frames of a slice."""
        return PersonLandmarks(**{field.name: getattr(self, field.name)[key] for field in fields(self)})

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True)
class PersonSettings:
    """Settings of following a person."""

    number: int | None = None  # number of the followed person, from 1; None: the largest person

    def __post_init__(self) -> None:
        if self.number is not None and self.number < 1:
            raise BodysenseError(f"--follow {self.number}: people are numbered from 1")


@dataclass(frozen=True, eq=False)
class PersonTrack:
    """Track of one person in the picture.

    People are numbered from 1 in the order in which they are first seen; those of one picture from left to right.
    """

    time: float  # s, last sighting
    place: np.ndarray  # (2,) middle of the trunk in the picture
    velocity: np.ndarray  # (2,) per second
    size: float  # length of the trunk in the picture
    colour: np.ndarray  # (3,) colour of the clothes, 0 to 1
    number: int = 0


@dataclass(frozen=True, eq=False)
class PersonState:
    """Tracks of the followed person, and of all others, so that people are not confused."""

    person: PersonTrack | None = None
    others: tuple[PersonTrack, ...] = ()
    sides: SideState | None = None
    count: int = 0  # number of people so far

    def seen_at(self, time: float) -> tuple[PersonTrack, ...]:
        """Return the tracks of all people seen at `time` s."""
        people = self.others if self.person is None else (self.person, *self.others)
        return tuple(one for one in people if one.time == time)


def follow(
    picture: Picture,
    bodies: Bodies,
    hands: HandLandmarks,
    state: PersonState,
    settings: PersonSettings = PersonSettings(),
) -> tuple[PersonLandmarks, PersonState]:
    """Return the person's landmarks in the next picture, one frame, and the state.

    The largest person is chosen at first, and again after 3 s without the followed one. With a number in `settings`,
    only the person with that number is followed, however long they are away. People are matched between pictures by
    position, motion, size and colour of clothes.
    """
    sides = state.sides
    chosen, state = _choose(picture, bodies, state, settings)
    empty = _no_person(picture.time)
    if chosen is None:
        return empty, replace(state, sides=sides)
    hand_of = _hands_of(chosen, bodies, hands)
    labels = sum((1 - 2 * side) * (2 * float(hands.left[k]) - 1) for side, k in enumerate(hand_of) if k is not None)
    size = float(_size(bodies.picture[chosen : chosen + 1])[0])
    is_exchanged = detect_exchange(picture.time, bodies.picture[chosen], size, labels, sides)
    if is_exchanged:
        bodies = _exchange_sides(bodies, chosen)
        hand_of = _hands_of(chosen, bodies, hands)
    state = replace(state, sides=update_sides(picture.time, bodies.picture[chosen], size, is_exchanged, sides))
    for side, place in enumerate(hand_of):
        if place is not None:
            empty.hand[0, side], empty.hand_world[0, side] = hands.picture[place], hands.world[place]
            empty.has_hand[0, side] = True
    body = np.s_[chosen : chosen + 1]
    return (
        replace(
            empty,
            world=bodies.world[body],
            picture=bodies.picture[body],
            visible=bodies.visible[body],
            has_body=np.ones(1, dtype=bool),
        ),
        state,
    )


def _exchange_sides(bodies: Bodies, chosen: int) -> Bodies:
    """Return the bodies with left and right of body `chosen` exchanged."""
    values = [np.array(value) for value in (bodies.world, bodies.picture, bodies.visible)]
    world, picture, visible = exchange(*(value[chosen] for value in values))
    for value, one in zip(values, (world, picture, visible), strict=True):
        value[chosen] = one
    return Bodies(*values)


def joined_landmarks(parts: Sequence[PersonLandmarks]) -> PersonLandmarks:
    """Concatenate landmarks in time."""
    names = [field.name for field in fields(PersonLandmarks)]
    return PersonLandmarks(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def arm_keypoints(person: PersonLandmarks) -> ArmKeypoints:
    """Return the input of the network of arms and hands. An arm is found if shoulder, elbow and wrist are seen."""
    arms = person.world[:, _ARMS]
    seen = person.has_body[:, None] & (person.visible[:, _ARMS].min(axis=-1) >= VISIBLE)
    return ArmKeypoints(
        time=person.time,
        arm=arm_directions(arms),
        has_arm=seen,
        torso=torso_rotation(person.world[:, _SHOULDERS], person.world[:, _HIPS]),
        has_torso=person.has_body & (person.visible[:, _SHOULDERS].min(axis=-1) >= VISIBLE),
        hand=person.hand,
        has_hand=person.has_hand,
    )


def _no_person(time: float) -> PersonLandmarks:
    count = len(BODY_LANDMARKS)
    return PersonLandmarks(
        time=np.array([time]),
        world=np.full((1, count, 3), np.nan),
        picture=np.full((1, count, 2), np.nan),
        visible=np.zeros((1, count)),
        has_body=np.zeros(1, dtype=bool),
        hand=np.full((1, 2, 21, 2), np.nan),
        hand_world=np.full((1, 2, 21, 3), np.nan),
        has_hand=np.zeros((1, 2), dtype=bool),
    )


def _choose(
    picture: Picture, bodies: Bodies, state: PersonState, settings: PersonSettings
) -> tuple[int | None, PersonState]:
    """Return the index of the followed person's body, or None, and the new state."""
    seen = _people(picture, bodies)
    known = [one for one in state.others if picture.time - one.time <= _PATIENCE]
    person = state.person
    if person is not None and (settings.number or picture.time - person.time <= _PATIENCE):
        known = [person, *known]
    else:
        person = None
    difference = np.array([[_difference(one, new) for new in seen] for one in known]).reshape(len(known), len(seen))
    absent = _ABSENCE * np.array([picture.time - one.time for one in known])
    free_known, free_seen, matches = set(range(len(known))), set(range(len(seen))), {}
    for place in np.argsort((difference + absent[:, None]).ravel()).tolist():
        one, new = divmod(place, len(seen))
        if one in free_known and new in free_seen and difference[one, new] <= _FARTHEST:
            free_known.remove(one)
            free_seen.remove(new)
            matches[one] = new
    now = {new: _update_track(known[one], seen[new]) for one, new in matches.items()}
    for number, new in enumerate(sorted(free_seen, key=lambda new: seen[new].place[0]), start=state.count + 1):
        now[new] = replace(seen[new], number=number)
    if person is not None:
        chosen = matches.get(0)
    elif settings.number is not None:
        chosen = next((new for new, one in now.items() if one.number == settings.number), None)
    else:
        chosen = max(now, key=lambda new: now[new].size, default=None)
    kept = [known[one] for one in free_known if one or person is None]
    others = [one for new, one in now.items() if new != chosen] + kept
    person = person if chosen is None else now[chosen]
    return chosen, replace(state, person=person, others=tuple(others), count=state.count + len(free_seen))


def _people(picture: Picture, bodies: Bodies) -> list[PersonTrack]:
    """Return a track of every person in a picture."""
    trunk = bodies.picture[:, np.concatenate([_SHOULDERS, _HIPS])].reshape(-1, 2, 2, 2)  # body, shoulders and hips, …
    return [
        PersonTrack(picture.time, corners.mean(axis=(0, 1)), np.zeros(2), float(size), _colour(picture.pixels, corners))
        for corners, size in zip(trunk, _size(bodies.picture), strict=True)
    ]


def _difference(one: PersonTrack, new: PersonTrack) -> float:
    """Return the difference of a known person and a seen one."""
    gap = new.time - one.time
    # An unseen person walks on or stays. After a jump they come down again.
    ahead = one.velocity * min(gap, _LONGEST_AHEAD)
    away = min(float(np.linalg.norm(new.place - one.place - step)) for step in (ahead, 0.0 * ahead)) / one.size
    # A small share of the distance always counts, to distinguish people who are all within reach.
    difference = max(away - _SPEED * gap, 0.1 * away) + abs(np.log(new.size / one.size))
    return difference + _COLOUR * float(np.linalg.norm(new.colour - one.colour)) / np.sqrt(3)


def _update_track(one: PersonTrack, new: PersonTrack) -> PersonTrack:
    """Return the track of a known person after a new sighting; motion, size and colour are averaged."""
    gap = new.time - one.time
    keep = np.exp(-gap / _MEMORY)
    return PersonTrack(
        time=new.time,
        place=new.place,
        velocity=keep * one.velocity + (1 - keep) * (new.place - one.place) / max(gap, 1e-3),
        size=float(keep * one.size + (1 - keep) * new.size),
        colour=keep * one.colour + (1 - keep) * new.colour,
        number=one.number,
    )


def _hands_of(chosen: int, bodies: Bodies, hands: HandLandmarks) -> list[int | None]:
    """Return the indices of the hands on the left and right arm of a body, None if missing: the most likely pair."""
    count = len(hands.left)
    if not count:
        return [None, None]
    wrist = hands.picture[:, 0]
    away = np.linalg.norm(bodies.picture[:, _WRISTS, None] - wrist, axis=-1) / _size(bodies.picture)[:, None, None]
    likely = np.stack([hands.left, 1 - hands.left])
    difference = away + _WRONG_SIDE * (1 - likely)  # (N, 2, hands)
    mine = difference[chosen]
    others = np.delete(difference, chosen, axis=0).min(axis=(0, 1), initial=np.inf)
    allowed = (away[chosen] <= _HAND_REACH) & (mine < others)
    extent = np.linalg.norm(np.ptp(hands.picture, axis=1), axis=-1)
    apart = np.linalg.norm(hands.picture[:, None] - hands.picture, axis=-1).mean(axis=-1) / extent

    def cost(pair: tuple[int | None, int | None]) -> float:
        left, right = pair
        if left is not None and right is not None and apart[left, right] < 0.15:
            return np.inf  # one hand, found twice
        worst = _HAND_REACH + _WRONG_SIDE  # worse than any allowed hand
        return sum(worst if one is None else float(mine[side, one]) for side, one in enumerate(pair))

    options = [[None, *np.flatnonzero(row).tolist()] for row in allowed]
    best = min(product(*options), key=cost)
    return [best[0], best[1]]


def _size(places: np.ndarray) -> np.ndarray:
    """Return sizes (N,) of bodies (N, 33, 2) in the picture: the trunk's length, from its width if it is bent."""
    shoulders, hips = places[:, _SHOULDERS], places[:, _HIPS]
    length = np.linalg.norm(shoulders.mean(axis=1) - hips.mean(axis=1), axis=-1)
    width = np.linalg.norm(shoulders[:, 0] - shoulders[:, 1], axis=-1)
    return np.maximum(np.maximum(length, 1.4 * width), 1e-3)


def _colour(pixels: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the median colour (3,), 0 to 1, between shoulders and hips, corners (2, 2, 2)."""
    across, down = _PATCH.T[:, :, None]
    (left, right), (low_left, low_right) = corners
    places = (1 - down) * ((1 - across) * left + across * right) + down * ((1 - across) * low_left + across * low_right)
    high, wide = pixels.shape[:2]
    x = (places[:, 0] * high + wide / 2).astype(int).clip(0, wide - 1)
    y = ((0.5 - places[:, 1]) * high).astype(int).clip(0, high - 1)
    return np.median(pixels[y, x], axis=0) / 255.0
