"""Conversion of the choreography to a problem for the solver: references, contacts, steps, glances and collisions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from bodysense.body.skeleton import default_body

from .choreography import FRAME_RATE, PASSING, STEPS, WALKS, Action, actions, frame_times, on
from .figure import FINGERS, Machine
from .spacetime import Aim, Probe, Problem, Solid, Spot, Touch, at_frame, solve
from .walking import sway

CONTACT = 2e5  # 1/m²: about 2 mm weigh as much as a posture's spread
_SPREAD = {
    "x": 0.04,
    "y": 0.08,
    "z": 0.04,
    "bend": 0.12,
    "turn": 0.12,
    "side": 0.08,
    "tilt": 0.15,
    "roll": 0.03,
    "heading": 0.2,
}
_OTHER_SPREAD = 0.25  # rad: how far a degree of freedom may stray from its reference
_ACCELERATION = {"x": 3.0, "y": 3.0, "z": 3.0}  # m/s²
_OTHER_ACCELERATION = 15.0  # rad/s²


def perform(machine: Machine, iterations: int) -> np.ndarray:
    """Return the performance (T, N): solve the held postures one by one, then the whole motion through them."""
    plan = actions()
    postures = np.stack([machine.vector(action.posture) for action in plan])
    task = problem(machine, plan, postures)
    for place, action in enumerate(plan):
        frame = round((action.start + action.end) / 2 * FRAME_RATE)
        still = at_frame(task, frame)
        postures[place] += (solve(still, still.reference, iterations) - still.reference)[0]
    task = problem(machine, plan, postures)
    return solve(task, task.reference, iterations)


def problem(machine: Machine, plan: Sequence[Action], postures: np.ndarray) -> Problem:
    """Return the problem of the whole performance, with preferred postures (A, N) of its actions."""
    time = frame_times()
    reference = _reference(machine, plan, postures)
    terms: list[Touch | Aim] = []
    for action in plan:
        held = window(time, action.start, action.end)
        for meeting in action.meetings:
            weight = CONTACT * meeting.share * held
            terms.append(
                Aim(meeting.a, meeting.b, weight) if meeting.direction else Touch(meeting.a, meeting.b, weight)
            )
    terms += [*_feet(machine), *_gaze(plan)]
    return Problem(
        machine,
        reference,
        reference_weight=np.broadcast_to(_weights(machine, _SPREAD, _OTHER_SPREAD), reference.shape),
        acceleration_weight=_weights(machine, _ACCELERATION, _OTHER_ACCELERATION) * FRAME_RATE**4,
        terms=terms,
        probes=_probes(),
        apart_weight=CONTACT / 2,
        limit_weight=2e3,
    )


def window(time: np.ndarray, start: float, end: float, ramp: float = 0.25) -> np.ndarray:
    """0 … 1 … 0, 1 from `start` to `end`; cubed, because weights matter over orders of magnitude."""
    return (ease((time - start) / ramp + 1) * ease((end - time) / ramp + 1)) ** 3


def ease(s: np.ndarray) -> np.ndarray:
    """Minimum jerk from 0 at s ≤ 0 to 1 at s ≥ 1. Flash and Hogan 1985."""
    s = np.clip(s, 0, 1)
    return s**3 * (10 - 15 * s + 6 * s**2)


def _weights(machine: Machine, spread: Mapping[str, float], otherwise: float) -> np.ndarray:
    """(N,) 1 / spread², by the name of the degree of freedom."""
    return np.array([spread.get(name, otherwise) ** -2 for name in machine.names])


def _reference(machine: Machine, plan: Sequence[Action], postures: np.ndarray) -> np.ndarray:
    """(T, N) posture to posture, minimum jerk between; then what never rests: breath, sway, idle fingers."""
    time = frame_times()
    # The head leads, the left arm moves before the right: limbs that start together look like a puppet's.
    early = np.array([0.15 * (not name.startswith("right_")) for name in machine.names])
    late = np.array([0.10 * name.startswith("right_") for name in machine.names])
    value = np.tile(postures[0], (len(time), 1))
    for (before, after), change in zip(pairwise(plan), np.diff(postures, axis=0), strict=True):
        value += ease((time[:, None] - before.end - late) / (after.start - early - before.end - late)) * change
    for passing in PASSING:
        bump = window(time, passing.time, passing.time, passing.ramp)[:, None] ** (1 / 3)
        value += bump * machine.vector(passing.posture)
    value += _walk(machine)
    return value + _idle(machine)


def _walk(machine: Machine) -> np.ndarray:
    """(T, N) what the walks add: the pelvis over the feet, swinging arms."""
    time = frame_times()
    value = np.zeros((len(time), len(machine.names)))
    path = WALKS[0].at(time)
    for walk in WALKS[1:]:
        path += walk.at(time) - [walk.x, walk.z, walk.heading]
    names = machine.names
    value[:, names.index("x")], value[:, names.index("z")] = path[:, 0], path[:, 1]
    value[:, names.index("heading")] = np.deg2rad(path[:, 2])
    for name, added in sway(WALKS, time).items():
        value[:, names.index(name)] += added
    for side in ("left", "right"):
        for before, after in pairwise([fall for fall in STEPS if fall.side == side]):
            share = np.clip((time - before.end) / (after.start - before.end), 0, 1)
            swing = np.sin(np.pi * share**0.8) ** 2  # the knee bends most before the foot passes the other
            value[:, names.index(f"{side}_knee")] += 1.05 * swing
            value[:, names.index(f"{side}_hip_flex")] += 0.45 * swing
    return value


def _idle(machine: Machine) -> np.ndarray:
    """(T, N) slow sums of sines, a phase of its own for each degree of freedom; breath moves spine and collars."""
    time = frame_times()[:, None]
    generator = np.random.default_rng(7)
    count = len(machine.names)
    value = np.zeros((len(time), count))
    degrees = np.array([_idle_degrees(name) for name in machine.names])
    for frequency in (0.21, 0.37, 0.63):
        spread = generator.uniform(0.85, 1.15, count)
        phase = generator.uniform(0, 2 * np.pi, count)
        value += np.deg2rad(degrees) * np.sin(2 * np.pi * frequency * spread * time + phase) / 2
    value[:, :3] += np.array([0.006, 0.0, 0.004]) * np.sin(2 * np.pi * np.array([0.19, 0.2, 0.27]) * time + [0.5, 0, 2])
    breath = np.sin(2 * np.pi * 0.27 * time[:, 0])
    for name, amount in (("bend", -0.8), ("left_collar_raise", 1.2), ("right_collar_raise", 1.2), ("head_nod", 0.5)):
        value[:, machine.names.index(name)] += np.deg2rad(amount) * breath
    return value


def _idle_degrees(name: str) -> float:
    if name in "xyz" or any(part in name for part in ("hip", "knee", "ankle", "toes", "heading")):
        return 0.0
    if any(part in name for part in ("knuckle", "curl")):
        return 4.0
    return 1.2


def _feet(machine: Machine) -> list[Touch | Aim]:
    """Return the goals of feet: soles that do not move while they stand, and swing in an arc between."""
    time = frame_times()
    terms: list[Touch | Aim] = []
    offset = machine.skeleton.rest_offset
    for side in ("left", "right"):
        falls = [fall for fall in STEPS if fall.side == side]
        ball = offset[machine.index(f"{side}_foot")]
        heel = np.array([ball[0], ball[1], -0.05])
        for fall in falls:
            turn = np.deg2rad(fall.heading)
            matrix = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
            ankle = np.array([fall.x, 0.0746, fall.z])
            for part, early, late in ((heel, 0.0, 0.0), (ball, 0.06, 0.12)):
                held = window(time, fall.start + early, fall.end + late, 0.1)
                terms.append(
                    Touch(Spot(f"{side}_ankle", part), Spot("world", ankle + matrix @ part), 2 * CONTACT * held)
                )
            flat = window(time, fall.start + 0.06, fall.end + 0.12, 0.1)
            level = Spot("world", matrix @ np.array([0.0, 0, 1.0]))
            terms.append(Aim(on(f"{side}_foot", 0, 0, 1), level, 200 * flat))
        for before, after in pairwise(falls):
            share = ease((time - before.end - 0.05) / (after.start - before.end - 0.02))[:, None]
            place = np.array([before.x, 0.0746, before.z]) * (1 - share) + np.array([after.x, 0.0746, after.z]) * share
            place[:, 1] += 0.08 * 16 * (share * (1 - share))[:, 0] ** 2 + 0.03 * np.sin(np.pi * share[:, 0])
            held = window(time, before.end + 0.2, after.start - 0.1, 0.1)
            terms.append(Touch(on(f"{side}_ankle", 0, 0, 0), Spot("world", place), 0.008 * CONTACT * held))
    return terms


def _gaze(plan: Sequence[Action]) -> list[Touch | Aim]:
    """Return the goals of the face, which turns toward the gaze a little before the body."""
    time = frame_times()
    direction = np.tile(np.array(plan[0].gaze), (len(time), 1))
    for before, after in pairwise(plan):
        share = ease((time - before.end + 0.1) / (0.75 * (after.start - before.end)))[:, None]
        direction = direction + share * (np.array(after.gaze) - np.array(before.gaze))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return [Aim(on("head", 0, 0, 1), Spot("world", direction), np.full(len(time), 60.0))]


def _probes() -> list[Probe]:
    """Return balls along the arms and hands, and the solids that each avoids; the feet stay above the floor."""
    capsules: dict[str, Solid] = {}
    for row in default_body()["primitives"]:
        if row["kind"] == "capsule":
            capsules[row["name"]] = Solid(row["joint"], np.array(row["start"]), np.array(row["end"]), row["radius"])
    trunk = [
        capsules[name]
        for name in ("pelvis_lower", "pelvis", "abdomen", "waist", "chest", "chest_upper", "neck", "cranium", "face")
    ]
    thighs = [capsules[f"{side}_thigh_{part}"] for side in ("left", "right") for part in ("upper", "lower")]
    probes = []
    for side, other, sign in (("left", "right", 1.0), ("right", "left", -1.0)):
        arm = [
            capsules[f"{other}_{part}"]
            for part in ("upper_arm_upper", "upper_arm_lower", "forearm_upper", "forearm_lower")
        ]
        x = np.array([sign, 1.0, 1.0])
        palms = [
            Solid(f"{other}_wrist", np.array([-0.015 * sign, -0.005, z]), np.array([-0.085 * sign, -0.005, z]), 0.016)
            for z in (-0.022, 0.0, 0.02)
        ]
        forearm = [
            Probe(f"{side}_elbow", x * [k, 0, 0], r, (*trunk, *thighs, *arm))
            for k, r in ((0, 0.036), (0.08, 0.034), (0.16, 0.028))
        ]
        palm_balls = [
            Probe(f"{side}_wrist", x * [k, -0.005, z], 0.016, (*trunk, *thighs, *arm, *palms))
            for k, z in ((0.0, 0.0), (0.035, 0.015), (0.035, -0.02), (0.09, 0.025), (0.09, 0.0), (0.085, -0.03))
        ]
        fingers = [
            Probe(f"{side}_{finger}{k}", x * [along, 0, 0], 0.0085, (*trunk, *thighs, *arm, *palms))
            for finger in FINGERS
            for k, along in ((2, 0.0), (3, 0.0), (3, 0.016))
        ]
        thumb = [
            Probe(f"{side}_thumb3", x * v, 0.010, (*trunk, *thighs, *arm, *palms))
            for v in ((0.0, 0.0, 0.0), (0.016, -0.01, 0.003))
        ]
        elbow = Probe(f"{side}_shoulder", x * [0.19, 0, 0], 0.040, tuple(trunk))
        knee = Probe(f"{side}_knee", x * [0, 0, 0], 0.054, tuple(k for k in thighs if k.joint == f"{other}_hip"))
        sole = [Probe(f"{side}_ankle", x * [0.0, -0.0478, z], 0.0264, ()) for z in (-0.05, 0.14)]
        toe = Probe(f"{side}_foot", x * [0.0, -0.0107, 0.045], 0.0134, ())
        probes += [*forearm, *palm_balls, *fingers, *thumb, elbow, knee, *sole, toe]
    return probes
