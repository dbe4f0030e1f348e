from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from bodysense.body.arms import ARM_JOINTS, HAND_POINTS, SIDES
from bodysense.body.keypoints import arms_from_torso
from bodysense.body.pose import forward_kinematics
from bodysense.devices.video.arms import ArmModel
from bodysense.devices.video.landmarks import BODY_LANDMARKS
from bodysense.devices.video.person import PersonLandmarks
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_rotate
from bodysense.io.clip import Clip
from bodysense.tracking.model import CompletionModel
from bodysense_lab.papers.pahmt.camera_view import view, view_points
from bodysense_lab.papers.pahmt.errors import arm_errors
from bodysense_lab.rendering import tables as video_rendered
from bodysense_lab.rendering.keypoint_errors import bones_of
from bodysense_lab.rendering.scene import move_camera
from bodysense_lab.rendering.tables import (
    VideoTable,
    complete_by_all_methods,
    find_landmarks,
    score_videos,
    video_report,
)
from bodysense_lab.rendering.take import RenderedTake, plan_takes, render_take, write_take

FACE = {"nose": (0.0, 0.04, 0.13), "left_ear": (0.07, 0.06, 0.0), "right_ear": (-0.07, 0.06, 0.0)}  # m, from the head
STANDS_FOR = {"pinky": "pinky1", "index": "index1", "thumb": "thumb2", "heel": "ankle"}


class Still:
    """Network that predicts identity rotations for every window."""

    card: ClassVar[dict[str, Any]] = {"frames": 32, "rate": 30.0, "validation": {"overall_m": 0.1, "hands_m": 0.02}}

    def run(self, inputs: dict[str, Any]) -> dict[str, np.ndarray]:
        assert np.isfinite(inputs["arm"]).all()
        rotation = np.zeros((1, inputs["arm"].shape[1], len(ARM_JOINTS), 4))
        rotation[..., 0] = 1
        return {"rotation": rotation}


MODEL = ArmModel(Still())  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def take(waving_clip: Clip) -> RenderedTake:
    return plan_takes(waving_clip, 1, 0.5, np.random.default_rng(2))[0][0]


def perfect(take: RenderedTake) -> PersonLandmarks:
    """Return landmarks without errors."""
    position, rotation = (np.asarray(values) for values in forward_kinematics(take.pose))
    skeleton, frames = take.pose.skeleton, len(take.time)
    head = skeleton.index("head")
    marks = np.zeros((frames, len(BODY_LANDMARKS), 3))
    for k, name in enumerate(BODY_LANDMARKS):
        side, _, part = name.partition("_")
        point = f"{side}_{STANDS_FOR.get(part, part)}"
        if point in skeleton.points:
            marks[:, k] = position[:, skeleton.index(point)]
        else:
            offset = np.array(FACE.get(name, FACE["nose"]))
            marks[:, k] = position[:, head] + quaternion_rotate(rotation[:, head], np.tile(offset, (frames, 1)))
    seen = view(view_points(take.pose), take.time, take.camera)
    hands = position[:, [[skeleton.index(f"{side}_{name}") for name in HAND_POINTS] for side in SIDES]]
    local = (marks - take.camera.position) @ take.camera.axes
    return PersonLandmarks(
        time=take.time,
        world=local - local[:, [BODY_LANDMARKS.index(f"{side}_hip") for side in SIDES]].mean(axis=1, keepdims=True),
        picture=float(take.camera.focal) * local[..., :2] / -local[..., 2:],
        visible=np.ones((frames, len(BODY_LANDMARKS))),
        has_body=np.ones(frames, dtype=bool),
        hand=seen.hand,
        hand_world=hands @ take.camera.axes,
        has_hand=seen.has_hand,
    )


def test_perfect_landmarks_give_fingers_but_not_twist(take: RenderedTake, completion: CompletionModel) -> None:
    table = VideoTable()
    person = perfect(take)
    rotations, bones = complete_by_all_methods(take, person, MODEL, completion)
    table.add(take, person, rotations)
    table.add_bones(take, bones)
    numbers = table.numbers()
    for bone in ("upper_arm", "forearm"):
        assert numbers[f"landmarks_ik_{bone}_picture_deg"] < 1 and numbers[f"positions_ik_{bone}_space_deg"] < 1e-3
        assert numbers[f"network_{bone}_picture_deg"] < 6
        assert numbers[f"network_{bone}_space_deg"] < 25
    assert numbers["videos"] == 1 and numbers["minutes"] == pytest.approx(14 / 30 / 60)
    assert numbers["detection_rate"] == numbers["hand_detection_rate"] == 1.0
    assert numbers["detector_arm_drift"] == pytest.approx(0, abs=1e-4)
    assert numbers["landmarks_ik_hands_cm"] < 1.0
    assert numbers["landmarks_ik_overall_cm"] < 4.0  # IK does not know bone lengths, and smooths over time
    assert numbers["positions_ik_overall_cm"] < 0.1
    assert numbers["positions_ik_upper_arm_twist_deg"] > 2.0
    still = np.zeros((len(take.time), len(ARM_JOINTS), 4))
    still[..., 0] = 1
    errors = arm_errors(still, arms_from_torso(take.pose), take.pose.skeleton)
    for measure, values in ((name, errors[name]) for name in video_rendered.MEASURES):
        # Landmarks give the directions of arms, but not their twist.
        share = numbers[f"network_{measure}"] / values.mean()
        assert {"overall_cm": share < 0.7, "hands_cm": 0.9 < share < 1.1, "arms_deg": share < 1.15}.get(measure, True)
        assert numbers[f"network_true_{measure}"] == pytest.approx(values.mean(), rel=1e-5)


def test_the_first_second_of_a_moving_camera_is_also_scored_alone(take: RenderedTake) -> None:
    time = np.arange(len(take.time)) / 10.0  # 1.4 s
    moving = replace(take, time=time, camera=move_camera(take.camera, take.camera, len(time)), category="moving_camera")
    truth, table = bones_of(moving.pose, moving.camera), VideoTable()
    wrong = replace(truth, space=np.concatenate([truth.space[:10], truth.space[10:] * [-1.0, 1.0, 1.0]]))
    table.add_bones(moving, {"network": wrong})
    table.add_bones(replace(take, time=time), {"network": wrong})
    for one in (moving, replace(take, time=time)):
        table.add(one, perfect(take), {})
    numbers = table.numbers()
    assert numbers["network_forearm_space_deg_moving_camera_first"] == pytest.approx(0, abs=1e-3)
    assert numbers["network_forearm_space_deg_moving_camera"] > 5
    assert "network_forearm_space_deg_main_first" not in numbers


def test_missed_people_and_hands_are_counted(take: RenderedTake) -> None:
    table, person = VideoTable(), perfect(take)
    half = np.arange(len(person)) < len(person) // 2
    person = replace(person, has_body=half, has_hand=person.has_hand & half[:, None])
    truth = arms_from_torso(take.pose)
    table.add(replace(take, category="dance"), person, {"network": truth})
    numbers = table.numbers()
    assert numbers["detection_rate_dance"] == pytest.approx(7 / 15)
    assert 0.4 < numbers["hand_detection_rate_dance"] < 0.6
    assert numbers["network_arms_deg_dance"] == pytest.approx(0, abs=1e-4)
    assert "network_arms_deg" not in numbers and "detection_rate" not in numbers


def test_the_report_has_remarks_and_published_rows(take: RenderedTake) -> None:
    table, truth, rest = VideoTable(), arms_from_torso(take.pose), np.zeros((len(take.time), len(ARM_JOINTS), 4))
    rest[..., 0] = 1
    methods = {"network": truth, "landmarks_ik": rest, "network_true": truth, "positions_ik": rest}
    table.add(take, perfect(take), methods)
    report = video_report(table, "set")
    assert len(report.rows) == 7 and len(report.rows[0]) == len(report.columns)
    assert dict(zip(report.columns, report.rows[4], strict=True))["arms, rad"] == 0.2779  # FrankMocap's
    assert len(report.remarks) == 6 and all(": holds (" in remark for remark in report.remarks)
    for who in ("network", "landmarks_ik"):
        for measure in ("overall_cm", "hands_cm", "arms_deg"):
            assert f"{who}_{measure}" in report.numbers


def test_a_video_that_does_not_match_its_truth_is_refused(
    take: RenderedTake, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_take(tmp_path / "take.npz", take)
    monkeypatch.setattr(video_rendered, "find_landmarks", lambda path, files: perfect(take)[:10])
    with pytest.raises(BodysenseError, match="the video has 10 pictures, the truth 15; render it again"):
        score_videos([tmp_path / "take.npz"], None, MODEL)  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_rendered_person_is_found(waving_clip: Clip, landmarkers: Path, tmp_path: Path) -> None:
    from bodysense.devices.video.landmarker_files import find_landmarkers

    for name in ("moderngl", "av"):
        pytest.importorskip(name)
    found = []
    for planned, scene in plan_takes(waving_clip, 2, 0.5, np.random.default_rng(2)):
        path = render_take(planned, scene, tmp_path)
        person = find_landmarks(path, find_landmarkers(landmarkers))
        true = view(view_points(planned.pose), planned.time, planned.camera)
        assert person.has_body.mean() > 0.9
        both = person.has_hand & true.has_hand
        error = np.linalg.norm(person.hand[both] - true.hand[both], axis=-1)
        assert error.size == 0 or np.median(error) < 0.03  # of the picture's height
        found.append(both.mean())
    assert max(found) > 0.3
