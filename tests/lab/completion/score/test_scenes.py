"""Scenes: unseen bodies of a split, batches of limited size, and the knowledge that the tracker is given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from bodysense.body.pose import Pose
from bodysense.body.shape import sample_bodies, stature
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.io.clip import Clip
from bodysense.observing.checks import check_observation
from bodysense_lab.completion.score.scenes import (
    UNSEEN_BODIES,
    TrackedScene,
    batches,
    body_split,
    person_of,
    scene_of,
    stack_observations,
    unseen_body,
)


def test_unseen_bodies_are_in_no_other_split() -> None:
    bodies = {
        split: sample_bodies(split, UNSEEN_BODIES).reshape(UNSEEN_BODIES, -1)
        for split in ("train", "validation", "test")
    }
    for split in ("train", "validation"):
        assert cdist(bodies["test"], bodies[split]).min() > 1e-3
    assert (body_split("test"), body_split("all"), body_split("val"), body_split("train")) == (
        "test",
        "test",
        "validation",
        "train",
    )


def test_a_clip_always_has_the_same_unseen_body(clips: list[Clip]) -> None:
    bodies = sample_bodies("test", UNSEEN_BODIES)
    one = unseen_body(clips[0], "test")
    assert any((one.rest_offset == body).all() for body in bodies)
    np.testing.assert_array_equal(
        unseen_body(replace(clips[0], pose=clips[1].pose), "test").rest_offset, one.rest_offset
    )
    assert (unseen_body(clips[1], "test").rest_offset != one.rest_offset).any()
    assert (unseen_body(clips[0], "val").rest_offset != one.rest_offset).any()


def test_the_person_has_only_what_the_tracker_may_know(clips: list[Clip]) -> None:
    skeleton = unseen_body(clips[0], "test")
    for body in ("own", "stranger"):
        person = person_of(body, skeleton)
        assert person.skeleton is skeleton and not person.bone_deviation.any()
    of_height, of_nothing = person_of("height", skeleton), person_of("nothing", skeleton)
    assert float(stature(of_height.skeleton.rest_offset)) == pytest.approx(
        float(stature(skeleton.rest_offset)), abs=0.002
    )
    assert (of_height.skeleton.rest_offset != skeleton.rest_offset).any()
    other = person_of("nothing", unseen_body(clips[1], "test"))
    np.testing.assert_array_equal(of_nothing.skeleton.rest_offset, other.skeleton.rest_offset)
    assert of_nothing.bone_deviation.mean() > of_height.bone_deviation.mean() > 0


def test_batches_have_clips_of_similar_length(clips: list[Clip]) -> None:
    def of_frames(frames: int) -> Clip:
        pose = clips[0].pose
        return replace(clips[0], pose=Pose(pose.skeleton, np.zeros((frames, 3)), np.zeros((frames, 52, 4))))

    lengths = [40, 7000, 50, 9000, 45, *[60] * 40]
    found = list(batches(map(of_frames, lengths)))
    assert sorted(len(clip) for batch in found for clip in batch) == sorted(lengths)
    assert [len(clip) for batch in found for clip in batch] == sorted(lengths, reverse=True)
    for batch in found:
        assert len(batch) == 1 or (len(batch) <= 32 and len(batch) * len(batch[0]) <= 24_000)
    assert list(batches([])) == []


def test_shorter_observations_end_with_their_last_frame(scenes: list[TrackedScene]) -> None:
    seen = [scene.observe(SENSOR_SETS["headset_camera"]) for scene in scenes]
    batch = check_observation(stack_observations(seen))
    assert batch.position.shape == (len(scenes), 90, 65, 3)
    for index, one in enumerate(seen):
        np.testing.assert_array_equal(batch.position[index, : len(one)], one.position)
        np.testing.assert_array_equal(
            batch.has_position[index, len(one) :], np.tile(one.has_position[-1], (90 - len(one), 1))
        )


def test_a_scene_is_at_thirty_hertz(clips: list[Clip]) -> None:
    scene = scene_of(replace(clips[0], frame_rate=60.0), "own", "test")
    assert len(scene) == 45 and scene.time[1] == pytest.approx(1 / 30)
    assert len(scene.beginning(10)) == 10 and scene.beginning(10).group == "main"
