"""FBX files in any convention are read as the body that was written into them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_fbx import AXES, MadeFile, direction, made_body

from bodysense.body.pose import forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense.io.formats.fbx.motion import parse_fbx
from bodysense.io.reading_options import ReadingOptions
from bodysense.io.rigged import read_rigged

PATH = Path("take.fbx")


@pytest.fixture(scope="module")
def short() -> Clip:
    clip = packaged_performance()
    return Clip("short", clip.pose[100:148:12], 25.0)


def errors(clip: Clip, found: Clip) -> tuple[float, float]:
    """Return the largest distance (m) and angle (degrees) between the joints of two clips."""
    (place, turn), (other, turned) = (map(np.asarray, forward_kinematics(one.pose)) for one in (clip, found))
    assert found.frame_rate == clip.frame_rate
    return float(np.linalg.norm(place - other, axis=-1).max()), float(np.rad2deg(geodesic_angle(turn, turned)).max())


@given(
    st.sampled_from(
        [(up, front) for up in AXES for front in AXES if abs(np.dot(direction(up), direction(front))) < 0.5]
    ),
    st.booleans(),
    st.sampled_from([1.0, 0.01, 0.001, 0.0254]),
    st.integers(0, 2**32 - 1),
    st.sampled_from([1.0, 100.0, 0.01]),
)
@settings(max_examples=10)
def test_any_axes_unit_and_bind_pose(
    short: Clip, axes: tuple[str, str], left_handed: bool, unit: float, seed: int, root_scale: float
) -> None:
    up, front = axes
    data = made_body(short, up=up, front=front, left_handed=left_handed, unit=unit, seed=seed, root_scale=root_scale)
    distance, angle = errors(short, read_rigged(data, PATH).clip)
    assert distance < 1e-4 and angle < 0.05


def test_the_bind_pose_counts_not_the_first_frame(short: Clip) -> None:
    """Without a bind pose, the nodes at rest are one: here the same."""
    for has_bind in (True, False):
        distance, angle = errors(short, read_rigged(made_body(short, seed=5, has_bind=has_bind), PATH).clip)
        assert distance < 1e-4 and angle < 0.05


def test_the_unit_of_the_file_unless_no_person_fits_it(short: Clip) -> None:
    """Metres that are called centimetres are recognised, and said."""
    good = read_rigged(made_body(short, unit=0.0254), PATH).rig
    assert good.unit_name == "inches" and not [note for note in good.notes if "as the file says" in note]
    file = made_body(short, unit=1.0).replace(np.float64(100).tobytes(), np.float64(1).tobytes())
    wrong = read_rigged(file, PATH).rig
    assert wrong.unit_name == "metres" and "not units of 0.01 m, as the file says" in wrong.notes[-1]
    asked = read_rigged(made_body(short), PATH, ReadingOptions(height=1.5)).clip
    assert asked.pose.skeleton.height == pytest.approx(1.5)


def two_animations(clip: Clip) -> bytes:
    """A file of a body whose second animation moves the hips alone."""
    file = MadeFile(rate=clip.frame_rate)
    bones: list[int] = []
    layers = [file.stack(name, (len(clip) - 1) / clip.frame_rate) for name in ("Walk", "Idle")]
    for point, name in enumerate(clip.pose.skeleton.points):
        parent = clip.pose.skeleton.parents[point]
        place = 100 * clip.pose.skeleton.rest_offset[point]
        rows = (("Lcl Translation", "Lcl Translation", "", "A", *map(float, place)),)
        bones.append(file.bone(name, bones[parent] if parent >= 0 else 0, rows=rows))
    swing = np.zeros((len(clip), 3))
    swing[:, 0] = np.linspace(0, 40, len(clip))
    for name in ("left_shoulder", "right_hip"):
        file.curves(layers[0], bones[clip.pose.skeleton.index(name)], "Lcl Rotation", swing)
    file.curves(layers[1], bones[0], "Lcl Rotation", swing)
    return file.bytes


def test_animations_by_name(short: Clip) -> None:
    data = two_animations(short)
    first, named, other = (parse_fbx(data, PATH, name) for name in (None, "Walk", "Idle"))
    assert first.animation == named.animation == "Walk" and np.array_equal(first.values, named.values)
    moved = {
        one.animation: {
            one.joints[k] for k in range(len(one.joints)) if np.ptp(one.rotation[:, k], axis=0).max() > 1e-6
        }
        for one in (named, other)
    }
    assert moved == {"Walk": {"left_shoulder", "right_hip"}, "Idle": {"pelvis"}}
    with pytest.raises(BodysenseError, match=r"--animation Run: no animation has this name; there are: Walk, Idle"):
        parse_fbx(data, PATH, "Run")
    with pytest.raises(BodysenseError, match=r"--skin body: no skinned mesh has this name; there are: none"):
        parse_fbx(data, PATH, None, "body")


def test_two_bodies_are_told_apart(short: Clip) -> None:
    file = MadeFile(rate=short.frame_rate)
    layer = file.stack("Take 001", (len(short) - 1) / short.frame_rate)
    for prefix in ("Ann:", "Ben:"):
        bones: list[int] = []
        for point, name in enumerate(short.pose.skeleton.points):
            parent = short.pose.skeleton.parents[point]
            rows = (("Lcl Translation", "", "", "A", *map(float, 100 * short.pose.skeleton.rest_offset[point])),)
            bones.append(file.bone(prefix + name, bones[parent] if parent >= 0 else 0, rows=rows))
        file.curves(layer, bones[0], "Lcl Translation", np.tile([0.0, 90.0, 0.0], (len(short), 1)))
    with pytest.raises(BodysenseError, match=r"2 bodies in it: 1 \(Ann:pelvis\), 2 \(Ben:pelvis\)"):
        read_rigged(file.bytes, PATH)
    second = read_rigged(file.bytes, PATH, ReadingOptions(figure=2))
    assert second.rig.joints["left_knee"] == "Ben:left_knee"


def test_a_moving_joint_keeps_its_path(short: Clip) -> None:
    """A hand that is carried by positions, not by its elbow, is where the file puts it."""
    skeleton = short.pose.skeleton
    file = MadeFile(rate=short.frame_rate)
    layer = file.stack("Take 001", (len(short) - 1) / short.frame_rate)
    bones: list[int] = []
    for point, name in enumerate(skeleton.points):
        parent = skeleton.parents[point]
        rows = (("Lcl Translation", "", "", "A", *map(float, 100 * skeleton.rest_offset[point])),)
        bones.append(file.bone(name, bones[parent] if parent >= 0 else 0, rows=rows))
    wrist = skeleton.index("left_wrist")
    path = 100 * skeleton.rest_offset[wrist] + np.linspace([0, 0, 0], [4, 6, 5], len(short))
    file.curves(layer, bones[wrist], "Lcl Translation", path)
    found = parse_fbx(file.bytes, PATH)
    np.testing.assert_allclose(found.place(found.joints.index("left_wrist")), path, atol=1e-3)
    moving = [name for name, own in zip(found.joints, found.channels, strict=True) if len(own) == 6]
    assert moving == ["pelvis", "left_wrist"]


def test_blenders_end_bones_are_no_toes(short: Clip) -> None:
    """`toe_end`, which Blender adds behind a last bone, is not the toe."""
    skeleton = short.pose.skeleton
    data = made_body(short)
    file = MadeFile(rate=short.frame_rate)
    layer = file.stack("Take 001", (len(short) - 1) / short.frame_rate)
    bones: list[int] = []
    for point, name in enumerate(skeleton.points):
        parent = skeleton.parents[point]
        rows = (("Lcl Translation", "", "", "A", *map(float, 100 * skeleton.rest_offset[point])),)
        bones.append(file.bone(name, bones[parent] if parent >= 0 else 0, rows=rows))
        if name in skeleton.end_sites:
            file.bone(f"{name}_end", bones[-1], rows=(("Lcl Translation", "", "", "A", 0.0, 0.0, 6.0),))
    file.curves(layer, bones[0], "Lcl Rotation", np.linspace([0.0, 0, 0], [0, 20, 0], len(short)))
    plain = read_rigged(data, PATH).rig.joints
    assert read_rigged(file.bytes, PATH).rig.joints == plain


def test_rates(short: Clip) -> None:
    """A rate that the format has a number for, and one that it has none for."""
    for rate in (30.0, 29.5):
        clip = replace(short, frame_rate=rate)
        assert read_rigged(made_body(clip), PATH).clip.frame_rate == pytest.approx(rate)
