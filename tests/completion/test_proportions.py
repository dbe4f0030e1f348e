"""Proportions are inferred from what sensors measure, without a jump, and what was told stays."""

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import Pose, standing_pose
from bodysense.body.shape import sample_bodies, stature
from bodysense.body.skeleton import default_skeleton
from bodysense.completion.inputs import frames_of
from bodysense.completion.proportions import Proportions, proportions_of
from bodysense.devices.simulated.sensors import SENSOR_SETS, SensorSet, observe

RATE, SECONDS = 30, 6
EVERYTHING = SensorSet(default_skeleton().points, ("head",))


def inferred(
    body: int, person: Person, sensors: SensorSet, lowered: float = 0.0
) -> tuple[list[Proportions], np.ndarray]:
    """What is believed, frame by frame, of a stranger who stands, `lowered` by so many metres; their rest offsets."""
    skeleton = default_skeleton().with_offsets(sample_bodies("test", body + 1)[body])
    pose = standing_pose(skeleton)
    frames = RATE * SECONDS
    root = np.tile(pose.root_position - np.array([0.0, lowered, 0.0]), (frames, 1))
    moving = Pose(skeleton, root, np.tile(pose.rotation, (frames, 1, 1)))
    seen = frames_of(observe(moving, np.arange(frames) / RATE, sensors), (person,), batched=False)
    believed = [proportions_of((person,))]
    for t in range(frames):
        believed.append(believed[-1].updated(seen[t], np.full(1, 1 / RATE), 0.0))
    return believed, skeleton.rest_offset


@pytest.mark.parametrize("body", range(5))
def test_the_height_is_found_from_the_head(body: int) -> None:
    believed, truth = inferred(body, Person(), SENSOR_SETS["head"])
    assert abs(stature(believed[-1].rest_offset[0]) - stature(truth)) < 0.05


@pytest.mark.parametrize("body", range(3))
def test_seen_bones_are_measured(body: int) -> None:
    believed, truth = inferred(body, Person(), EVERYTHING)
    names = ("left_elbow", "left_wrist", "right_knee", "right_ankle")
    places = default_skeleton().indices(names)
    lengths = [np.linalg.norm(offset[places], axis=-1) for offset in (believed[-1].rest_offset[0], truth)]
    assert np.abs(lengths[0] - lengths[1]).max() < 0.012
    assert (believed[-1].deviation[0][places] < believed[0].deviation[0][places]).all()


def test_nothing_jumps() -> None:
    believed, _ = inferred(1, Person(), EVERYTHING)
    steps = np.abs(np.diff([one.rest_offset[0] for one in believed], axis=0))
    assert steps.max() < 0.01


def test_what_was_told_stays() -> None:
    skeleton = default_skeleton().with_offsets(sample_bodies("test", 9)[8])
    believed, _ = inferred(2, Person(skeleton), EVERYTHING)
    assert np.array_equal(believed[-1].rest_offset[0], skeleton.rest_offset)
    believed, _ = inferred(2, Person(height=1.62), SENSOR_SETS["head"])
    assert abs(stature(believed[-1].rest_offset[0]) - 1.62) < 0.01


def test_whoever_sits_is_no_small_person() -> None:
    believed, _ = inferred(3, Person(), SENSOR_SETS["head"], lowered=0.45)
    assert abs(stature(believed[-1].rest_offset[0]) - stature(Person().skeleton.rest_offset)) < 0.01


def test_whoever_stands_on_something_is_no_giant() -> None:
    believed, _ = inferred(3, Person(), SENSOR_SETS["head"], lowered=-0.8)
    assert abs(stature(believed[-1].rest_offset[0]) - stature(Person().skeleton.rest_offset)) < 0.01


def test_a_person_learned_is_a_person_told() -> None:
    believed, _ = inferred(4, Person(), EVERYTHING)
    person = believed[-1].person(0, {})
    assert np.allclose(person.skeleton.rest_offset, believed[-1].believed[0])
    assert np.allclose(person.bone_deviation, believed[-1].deviation[0])
