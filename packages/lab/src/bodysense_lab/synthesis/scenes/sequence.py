"""Random scenes of people at home, with truth by construction: planted feet, steps, phases and every joint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.pose import Pose, local_rotation, standing_pose
from bodysense.body.shape import SHORTEST, TALLEST, shape_space, stature
from bodysense.body.skeleton import BODY, Skeleton, default_skeleton
from bodysense.geometry.rotation import matrix_to_quaternion
from bodysense_lab.synthesis.scenes import arm_postures, low_scenes, seated_scenes, standing_scenes, table_scenes
from bodysense_lab.synthesis.scenes.kinematics import frame_of, solve
from bodysense_lab.synthesis.scenes.moves import Draw
from bodysense_lab.synthesis.scenes.script import PHASES, FootStep, Phase, Script

KINDS: dict[str, Callable[[Script], None]] = {
    "stand": standing_scenes.stand,
    "shuffle": standing_scenes.shuffle,
    "step_back": standing_scenes.step_back,
    "step_aside": standing_scenes.step_aside,
    "step_ahead": standing_scenes.step_ahead,
    "turn": standing_scenes.turn,
    "foot_forward": standing_scenes.foot_forward,
    "bow": standing_scenes.bow,
    "weight_on_one_leg": standing_scenes.weight_on_one_leg,
    "crossed_ankles": standing_scenes.crossed_ankles,
    "lean_on_wall": standing_scenes.lean_on_wall,
    "hands_behind_back": standing_scenes.hands_behind_back,
    "hands_behind_head": standing_scenes.hands_behind_head,
    "hands_on_hips": standing_scenes.hands_on_hips,
    "arms_crossed": standing_scenes.arms_crossed,
    "reach": standing_scenes.reach,
    "walk": standing_scenes.walk,
    "work_at_a_table": table_scenes.work_at_a_table,
    "lean_on_a_table": table_scenes.lean_on_a_table,
    "squat": low_scenes.squat,
    "pick_up": low_scenes.pick_up,
    "kneel_on_one": low_scenes.kneel_on_one,
    "kneel_on_both": low_scenes.kneel_on_both,
    "sit": seated_scenes.sit,
    "lean_back": seated_scenes.lean_back,
    "legs_crossed": seated_scenes.legs_crossed,
    "ankle_on_knee": seated_scenes.ankle_on_knee,
    "feet_under_the_chair": seated_scenes.feet_under_the_chair,
    "at_a_table": seated_scenes.at_a_table,
}
TRAINING_MARGIN = 0.08  # share of every range that training leaves out at each end
_MIDDLE_START = 0.5  # share of sequences that begin in the middle of the first scene
_LEAST_BEFORE = 1.5  # s of standing before the first scene


@dataclass(frozen=True, eq=False)
class ScriptedScene:
    """A scene: motion of the joints of `BODY` with its truth. World: +Y up, the floor at y = 0."""

    kinds: tuple[str, ...]  # scenes in it, in order
    rate: float  # Hz
    rotation: np.ndarray  # (T, 22, 4) wxyz, world ← joint
    root: np.ndarray  # (T, 3) m, the pelvis
    rest_offset: np.ndarray  # (65, 3) m
    planted: np.ndarray  # (T, 2) bool: left and right foot are on the floor and do not move
    steps: tuple[FootStep, ...]  # in s from the first frame
    phase: np.ndarray  # (T, 4) bool, of `PHASES`

    def __len__(self) -> int:
        return len(self.root)

    @cached_property
    def skeleton(self) -> Skeleton:
        """Proportions of the body."""
        return default_skeleton().with_offsets(self.rest_offset)

    @cached_property
    def pose(self) -> Pose:
        """Poses (T,) with relaxed fingers."""
        rest = standing_pose(self.skeleton).rotation
        fingers = np.tile(rest[len(BODY) :], (len(self), 1, 1))
        local = local_rotation(default_skeleton(), self._with_hands)
        return Pose(self.skeleton, self.root, np.concatenate([local[:, : len(BODY)], fingers], axis=1))

    @cached_property
    def _with_hands(self) -> np.ndarray:
        skeleton, body = self.skeleton, len(BODY)
        wrists = [skeleton.wrist_of[joint] for joint in range(body, len(skeleton.joints))]
        return np.concatenate([self.rotation, self.rotation[:, wrists]], axis=1)

    def in_phase(self, name: Phase) -> np.ndarray:
        """Return (T,) bool: frames of a phase of `PHASES`."""
        return self.phase[:, PHASES.index(name)]


def sequence(
    rng: np.random.Generator,
    frames: int,
    rate: float,
    *,
    kind: str | None = None,
    margin: float = TRAINING_MARGIN,
    rest_offset: np.ndarray | None = None,
) -> ScriptedScene:
    """Draw a scene of `frames` frames at `rate` Hz.

    Args:
        rng: source of every random choice.
        frames: number of frames.
        rate: Hz.
        kind: scene of `KINDS`, repeated until the frames are full; None draws each scene.
        margin: share of every range that is left out at both ends. Evaluation draws with 0.
        rest_offset: (65, 3) m, the body; None draws one of the shape space.
    """
    draw = Draw(rng, margin)
    offset = draw_body(draw) if rest_offset is None else rest_offset
    script = Script.begin(frame_of(offset), draw)
    for side, posture in enumerate(arm_postures.EVERYDAY[int(draw.rng.integers(len(arm_postures.EVERYDAY)))](draw)):
        script.arm(side, posture, 0.0, 0.0)
    script.clock = _LEAST_BEFORE
    seconds, names = frames / rate, []
    begin = 0.0
    while script.clock < begin + seconds or not names:
        name = kind or str(rng.choice(list(KINDS)))
        before = script.clock
        KINDS[name](script)
        if not names and draw.chance(_MIDDLE_START):
            begin = draw.between(0.0, 0.8) * (script.clock - before) + before - 0.5 * _LEAST_BEFORE
        names.append(name)
    standing_scenes.glance(script, 0.0, begin + seconds)
    time = begin + np.arange(frames) / rate
    motion = solve(script, offset, time, rng)
    return ScriptedScene(
        kinds=tuple(names),
        rate=rate,
        rotation=matrix_to_quaternion(motion.rotation),
        root=motion.root,
        rest_offset=offset,
        planted=_planted(script, time),
        steps=tuple(FootStep(one.side, one.begin - begin, one.end - begin) for one in script.steps
                    if one.end > time[0] and one.begin < time[-1]),
        phase=np.stack([_within([(a, b) for which, a, b in script.phases if which == name], time)
                        for name in PHASES], axis=-1),
    )  # fmt: skip


def draw_body(draw: Draw) -> np.ndarray:
    """Draw the rest offsets (65, 3) m of a person from the shape space."""
    space = shape_space()
    while True:
        limit = 2.5 * (1 - 2 * draw.margin)
        offset = space.offsets(np.clip(draw.rng.standard_normal(space.size), -limit, limit))
        if SHORTEST <= float(stature(offset)) <= TALLEST:
            return offset


def _planted(script: Script, time: np.ndarray) -> np.ndarray:
    """Return (T, 2) bool: feet that do not step and are not raised."""
    return np.stack(
        [~_within([(one.begin, one.end) for one in (*script.steps, *script.lifted) if one.side == side], time)
         for side in (0, 1)], axis=-1,
    )  # fmt: skip


def _within(spans: list[tuple[float, float]], time: np.ndarray) -> np.ndarray:
    """Return (T,) bool: times within any of the spans."""
    inside = np.zeros(len(time), dtype=bool)
    for begin, end in spans:
        inside |= (time > begin) & (time < end)
    return inside
