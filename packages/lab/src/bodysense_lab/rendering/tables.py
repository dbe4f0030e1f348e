"""Table of arms and hands from pixels, on rendered videos with their truth (PAHMT, Table 3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

import numpy as np

from bodysense.body.arms import arm_rotations
from bodysense.body.keypoints import Camera, arms_from_torso
from bodysense.body.person import Person
from bodysense.body.pose import Pose
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.video.arms import ArmModel, Arms
from bodysense.devices.video.device import VideoDevice
from bodysense.devices.video.landmarker_files import LandmarkerFiles
from bodysense.devices.video.landmarks import LandmarkerSettings
from bodysense.devices.video.person import PersonLandmarks, arm_keypoints, joined_landmarks
from bodysense.errors import BodysenseError
from bodysense.tracking.model import CompletionModel
from bodysense.tracking.tracker import Tracker, TrackerSettings
from bodysense_lab.core.intervals import NamedFigure
from bodysense_lab.core.scoring import GROUPS, group_named, suffix_of
from bodysense_lab.core.table import Cell, Report, cell, finite, ordering
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.papers.pahmt.errors import arm_errors
from bodysense_lab.papers.pahmt.system import watched
from bodysense_lab.papers.pahmt.tables import solved_from_positions
from bodysense_lab.rendering.keypoint_errors import MEASURES as BONES
from bodysense_lab.rendering.keypoint_errors import (
    ArmBones,
    Errors,
    bone_errors,
    bones_of,
    bones_of_landmarks,
    keypoint_errors,
    noise_figures,
)
from bodysense_lab.rendering.landmark_ik import LandmarkIk
from bodysense_lab.rendering.take import GESTURES, RenderedTake, read_take

METHODS = {  # labels in the table
    "network": "video: network",
    "landmarks_ik": "video: MediaPipe's 3-D landmarks, IK",
    "network_true": "true key-points: network",
    "positions_ik": "true positions: IK",
}
MEASURES = {
    "overall_cm": "overall, cm",
    "hands_cm": "hands, cm",
    "arms_deg": "arms, °",
    "arms_rad": "arms, rad",
    "upper_arm_twist_deg": "twist of upper arm, °",
    "forearm_twist_deg": "of forearm, °",
}
# Table 3 of the paper, on its own rendered characters.
PUBLISHED = {
    "FrankMocap, published": {"overall_cm": 15.56, "arms_rad": 0.2779},
    "ExPose, published": {"overall_cm": 15.30, "arms_rad": 0.2984},
    "PAHMT, published": {"overall_cm": 13.75, "arms_rad": 0.1614},
}
_FIRST = "_first"  # suffix of the group with only the first second of videos
# Methods whose bones are compared. For IK these are the bones of its input: the landmarks, the true positions.
BONE_METHODS = ("network", "landmarks_ik", "positions_ik")


@dataclass(frozen=True, eq=False)
class VideoTable:
    """Tallies of errors by group, method and measure, and detection rates."""

    tallies: Tallies = field(default_factory=Tallies)
    found: Tallies = field(default_factory=Tallies)  # shares by group: "body", "hand"
    detector: list[Errors] = field(default_factory=list)  # of each video
    videos: list[str] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def get(self, method: str, measure: str, group: str = "main") -> float:
        """Return the mean over frames and joints; NaN without errors."""
        return self.tallies.mean(group, method, measure)

    def add(self, take: RenderedTake, person: PersonLandmarks, rotations: dict[str, np.ndarray]) -> None:
        """Add a video: its detections, and rotations (T, 38, 4) by method, as of `arms_from_torso`."""
        group, truth = _group(take), arms_from_torso(take.pose)
        for method, rotation in rotations.items():
            for measure, values in arm_errors(rotation, truth, take.pose.skeleton).items():
                self.tallies.add((group, method, measure), values)
        true = take.keypoints()
        self.detector.append(keypoint_errors(arm_keypoints(person), true))
        self.found.add((group, "body"), person.has_body.astype(float))
        self.found.add((group, "hand"), person.has_hand[true.has_hand].astype(float))
        self.videos.append(take.name)
        self.seconds.append(float(take.time[-1] - take.time[0]))

    def add_bones(self, take: RenderedTake, rotations: dict[str, ArmBones]) -> None:
        """Add the directions of arm bones by method; for a moving camera also those of the first second."""
        truth, interval = bones_of(take.pose, take.camera), float(np.median(np.diff(take.time)))
        pieces = {_group(take): slice(None)}
        if take.moves:
            pieces[f"{_group(take)}{_FIRST}"] = slice(int((take.time < take.time[0] + 1.0).sum()))
        for (group, piece), (method, bones) in product(pieces.items(), rotations.items()):
            for measure, values in bone_errors(bones[piece], truth[piece], interval).items():
                self.tallies.add((group, method, measure), values)

    @property
    def groups(self) -> list[str]:
        """Groups of categories, and gestures, that have videos."""
        return [group for group in (*GROUPS, *GESTURES) if (group, "body") in self.found]

    def numbers(self) -> dict[str, float]:
        """Return one flat object; main categories have no suffix, and `detector_…` is over all videos."""
        numbers: dict[str, float] = {"videos": len(self.videos), "minutes": sum(self.seconds) / 60}
        numbers |= {f"detector_{name}": value for name, value in noise_figures(self.detector).items()}
        for group in self.groups:
            suffix = suffix_of(group)
            for method in METHODS:
                for measure in (*MEASURES, *BONES):
                    numbers[f"{method}_{measure}{suffix}"] = self.get(method, measure, group)
            for key, name in (("detection_rate", "body"), ("hand_detection_rate", "hand")):
                numbers[f"{key}{suffix}"] = self.found.mean(group, name)
        for (group, method, measure), tally in self.tallies.items():
            if group.endswith(_FIRST):
                numbers[f"{method}_{measure}_{group}"] = tally.mpjpe
        return finite(numbers)


def score_videos(
    truths: list[Path], files: LandmarkerFiles, model: ArmModel, advance: Callable[[str], object] = lambda name: None
) -> VideoTable:
    """Score the videos of a rendered set, given the .npz of each; `advance` is called with each name.

    Raises BodysenseError if a video and its truth have different lengths.
    """
    table = VideoTable()
    for path in truths:
        take = read_take(path)
        person = find_landmarks(path.with_suffix(".mp4"), files)
        if len(person) != len(take.time):
            raise BodysenseError(
                f"{path}: the video has {len(person)} pictures, the truth {len(take.time)}; render it again"
            )
        rotations, bones = complete_by_all_methods(take, person, model)
        table.add(take, person, rotations)
        table.add_bones(take, bones)
        advance(take.name)
    return table


def find_landmarks(video: Path, files: LandmarkerFiles) -> PersonLandmarks:
    """Return the landmarks (T,) of the person in all pictures of a video."""
    return joined_landmarks(watched(str(video), files, LandmarkerSettings(people=1)))


def complete_by_all_methods(
    take: RenderedTake, person: PersonLandmarks, model: ArmModel, tracker: CompletionModel | None = None
) -> tuple[dict[str, np.ndarray], dict[str, ArmBones]]:
    """Complete a video's landmarks and its true key-points by every method.

    Returns rotations (T, 38, 4) as of `arms_from_torso`, and bones of arms, both by method. `tracker` is the completion
    network; the packaged one if None.
    """
    arms = Arms(default_skeleton(), model)
    true = arms.complete(take.keypoints()).estimate.pose
    assert true is not None
    pose, camera = track_body(VideoDevice(default_skeleton(), arms, float(take.camera.aspect)), person, tracker)
    rotations = {
        "network": arms_from_torso(pose),
        "landmarks_ik": arms_from_torso(LandmarkIk(default_skeleton()).complete(person)),
        "network_true": arm_rotations(true),  # the network's rotations are already from the torso
        "positions_ik": solved_from_positions(take.pose),
    }
    bones = (bones_of(pose, camera), bones_of_landmarks(person), bones_of(take.pose, take.camera))
    return rotations, dict(zip(BONE_METHODS, bones, strict=True))


def track_body(
    device: VideoDevice, person: PersonLandmarks, network: CompletionModel | None = None
) -> tuple[Pose, Camera]:
    """Return the body in world axes and the camera (T,) that `bodysense track` gives for landmarks (T,)."""
    early, state = device.step(person, device.start())
    tracker = Tracker(Person(device.skeleton), network=network, settings=TrackerSettings(infer=False))
    tracking, poses, cameras = tracker.start(), [], []
    for frames in (early, device.finish(state)):
        if len(frames):
            estimate, tracking = tracker.step(frames.observation, tracking)
            poses.append(estimate.pose)
            cameras.append(frames.camera)
    pose = Pose(
        device.skeleton,
        np.concatenate([pose.root_position for pose in poses]),
        np.concatenate([pose.rotation for pose in poses]),
    )
    names = ("position", "axes", "focal", "aspect")
    return pose, Camera(*(np.concatenate([getattr(camera, name) for camera in cameras]) for name in names))


def video_report(table: VideoTable, name: str) -> Report:
    """Return the table and remarks about the paper's claims."""
    rows: list[tuple[Cell, ...]] = []
    measures = MEASURES | BONES
    for group in table.groups:
        label = () if len(table.groups) == 1 else (group,)
        rows += [
            (*label, title, *(cell(table.get(method, measure, group)) for measure in measures))
            for method, title in METHODS.items()
        ]
    label = () if len(table.groups) == 1 else ("the paper's",)
    rows += [(*label, name, *(figures.get(measure) for measure in measures)) for name, figures in PUBLISHED.items()]
    numbers = table.numbers()
    suffix = "" if "main" in table.groups else f"_{table.groups[0]}"
    remarks = []
    for measure, claim in (
        ("arms_deg", "Arms are turned less wrongly by the network than by inverse kinematics"),
        ("upper_arm_twist_deg", "So is the upper arm about itself"),
        ("forearm_twist_deg", "So is the forearm about itself"),
    ):
        for ours, theirs in (("network", "landmarks_ik"), ("network_true", "positions_ik")):
            lower, higher = (NamedFigure(METHODS[method], table.get(method, measure)) for method in (ours, theirs))
            remarks.append(ordering(claim, lower, [higher], "°", digits=1))
    rates = ", ".join(
        f"{word} in {numbers[key + suffix]:.1%}"
        for key, word in (("detection_rate", "the person"), ("hand_detection_rate", "hands in the picture"))
        if key + suffix in numbers
    )
    return Report(
        name="video_rendered",
        title="Arms and hands from rendered videos (PAHMT, Table 3)",
        columns=(*(("motion",) if len(table.groups) > 1 else ()), "from", *measures.values()),
        rows=tuple(rows),
        numbers=numbers,
        data=(f"{name}: {len(table.videos)} videos, {sum(table.seconds) / 60:.1f} minutes; found: {rates}.",),
        remarks=tuple(remark for remark in remarks if remark),
        caption=(
            "overall: mean position error of all joints of arms and hands from the torso; hands: of fingers from "
            "their wrist, in its axes; arms: mean angle of collars (from the torso), upper arms, forearms and hands "
            "(from their parents), and in rad the mean difference of their axis-angle components (the paper's MPJRE); "
            "all frames. Bones in the picture: if more than a third of the bone is visible. For IK, the bones of its "
            "input are compared: the landmarks, and the truth."
        ),
        digits=2,
    )


def _group(take: RenderedTake) -> str:
    """Return the group of a video."""
    return take.category if take.category in GESTURES else group_named(take.category)
