"""BVH: comparison with scipy, round trips, and damaged files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import read_bvh, write_bvh

SMALL = """HIERARCHY
ROOT Hips
{
	OFFSET 1 90 2
	CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
	JOINT Left Leg
	{
		OFFSET 10 -80 0
		CHANNELS 3 Zrotation Xrotation Yrotation
		End Site
		{
			OFFSET 0 -10 5
		}
	}
	JOINT Spine
	{
		OFFSET 0 60 0
		CHANNELS 3 Zrotation Xrotation Yrotation
		End Site
		{
			OFFSET 0 25 0
		}
	}
}
MOTION
Frames: 2
Frame Time: 0.0333333
0 92 0 10 20 30 40 50 60 -10 -20 -30
1 93 2 11 21 31 41 51 61 -11 -21 -31
"""


@pytest.fixture
def small(tmp_path: Path) -> Path:
    path = tmp_path / "small.bvh"
    path.write_text(SMALL)
    return path


def changed(path: Path, old: str, new: str) -> Path:
    assert old in SMALL
    path.write_text(SMALL.replace(old, new))
    return path


def test_a_file_in_its_own_hierarchy_and_metres(small: Path) -> None:
    clip = read_bvh(small)
    skeleton = clip.pose.skeleton
    assert skeleton.joints == ("Hips", "Left Leg", "Spine")
    assert skeleton.end_sites == ("Left Leg_end", "Spine_end")
    assert skeleton.parents == (-1, 0, 0, 1, 2)
    np.testing.assert_allclose(skeleton.rest_offset[1], [0.1, -0.8, 0])
    np.testing.assert_allclose(clip.pose.root_position, [[0, 0.92, 0], [0.01, 0.93, 0.02]])
    assert (clip.name, clip.frame_rate, len(clip)) == ("small", 30.0, 2)


@pytest.mark.parametrize("order", ["XYZ", "ZXY", "YZX", "X", "ZY"])
def test_channels_turn_in_the_order_listed(tmp_path: Path, order: str) -> None:
    angles = np.random.default_rng(len(order)).uniform(-180, 180, size=(5, len(order)))
    channels = " ".join(f"{axis}rotation" for axis in order)
    rows = "\n".join(" ".join(f"{x:.9f}" for x in row) for row in angles)
    path = tmp_path / "one.bvh"
    path.write_text(
        f"HIERARCHY\nROOT A\n{{\nOFFSET 0 0 0\nCHANNELS {len(order)} {channels}\nEnd Site\n{{\nOFFSET 0 170 0\n}}\n}}\n"
        f"MOTION\nFrames: 5\nFrame Time: 0.01\n{rows}\n"
    )
    ours = read_bvh(path).pose.rotation[:, 0]
    theirs = Rotation.from_euler(order, angles, degrees=True).as_quat(scalar_first=True)  # capitals: intrinsic
    assert geodesic_angle(ours, theirs).max() < 1e-9


def test_world_positions_against_a_chain_of_scipy_rotations(small: Path) -> None:
    position, _ = forward_kinematics(read_bvh(small).pose)
    hips = Rotation.from_euler("ZXY", [11, 21, 31], degrees=True)
    leg = hips * Rotation.from_euler("ZXY", [41, 51, 61], degrees=True)
    knee = np.array([1, 93, 2]) + hips.apply([10, -80, 0])
    np.testing.assert_allclose(position[1, 1], knee / 100, atol=1e-12)
    np.testing.assert_allclose(position[1, 3], (knee + leg.apply([0, -10, 5])) / 100, atol=1e-12)


def test_line_ends_tabs_exponents_and_braces_on_one_line_do_not_matter(small: Path, tmp_path: Path) -> None:
    text = SMALL.replace("\n{", " {").replace("1 93 2", "1.0e0\t+93.\t.2e1").replace("Zrotation", "ZROTATION")
    other = tmp_path / "small_dos.bvh"
    other.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    a, b = read_bvh(small), read_bvh(other)
    assert a.pose.skeleton.points == b.pose.skeleton.points
    np.testing.assert_array_equal(a.pose.rotation, b.pose.rotation)
    np.testing.assert_array_equal(a.pose.root_position, b.pose.root_position)
    other.write_bytes(text.replace("MOTION", "Motion").replace("\n", "\r").encode())
    np.testing.assert_array_equal(read_bvh(other).pose.rotation, b.pose.rotation)


def with_knee_at(path: Path, places: list[str]) -> Path:
    """The small file with position channels on the leg."""
    text = SMALL.replace("-80 0\n\t\tCHANNELS 3", "-80 0\n\t\tCHANNELS 6 Yposition Xposition Zposition")
    for row, place in zip((" 40 50", " 41 51"), places, strict=True):
        text = text.replace(row, f" {place}{row}")
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("places", "offset"),
    [
        (["-75 11 1"] * 2, [0.11, -0.75, 0.01]),
        (["0 0 0"] * 2, [0.1, -0.8, 0]),  # nothing is added
        (["-80 10 0", "-82 10 0"], [0.1, -0.81, 0]),  # the median
    ],
)
def test_positions_of_a_joint_become_its_offset(small: Path, places: list[str], offset: list[float]) -> None:
    np.testing.assert_allclose(read_bvh(with_knee_at(small, places)).pose.skeleton.rest_offset[1], offset)


def test_zero_length_end_sites_are_dropped_and_names_stay_unique(small: Path) -> None:
    assert read_bvh(changed(small, "OFFSET 0 25 0", "OFFSET 0 0 0")).pose.skeleton.end_sites == ("Left Leg_end",)
    path = changed(small, "JOINT Spine", "JOINT Left Leg_end")
    assert read_bvh(path).pose.skeleton.end_sites == ("Left Leg_end2", "Left Leg_end_end")


def test_a_frame_time_is_taken_as_printed_but_for_rounding(small: Path) -> None:
    assert read_bvh(changed(small, "0.0333333", "0.008333")).frame_rate == 120.0
    assert read_bvh(changed(small, "0.0333333", "0.0333667")).frame_rate == pytest.approx(29.97, abs=1e-3)


BROKEN = [
    ("HIERARCHY", "HIERARCHIE", "does not begin with HIERARCHY"),
    ("MOTION", "MOTIO", "no MOTION section; the file is cut off"),
    ("\tOFFSET 10 -80 0", "\tOFFSET 10 -80", r"line 8: OFFSET '10 -80 CHANNELS' is not three numbers"),
    ("OFFSET 10 -80 0", "OFFSETS 10 -80 0", "line 8: 'OFFSETS' is not understood here"),
    ("OFFSET 10 -80 0", "OFFSET 10 x 0", "line 8: OFFSET '10 x 0' is not three numbers"),
    ("OFFSET 10 -80 0", "OFFSET 10 nan 0", "line 8: OFFSET '10 nan 0' is not finite"),
    ("\tOFFSET 0 60 0\n", "", "a joint without OFFSET"),
    ("CHANNELS 6", "CHANNELS 5", "CHANNELS announces 5 but lists Xposition"),
    ("CHANNELS 6 Xposition", "CHANNELS 6 Zposition", "CHANNELS announces 6 but lists Zposition"),
    ("Zrotation Xrotation Yrotation\n\tJOINT", "Zrotation Xrotation Wrotation\n\tJOINT", "CHANNELS announces 6"),
    ("ROOT Hips\n{", "ROOT Hips\n", "line 4: '{' is missing after 'Hips'"),
    ("ROOT Hips\n", "ROOT \n", "a joint without a name"),
    ("}\nMOTION", "}\n}\nMOTION", "a '}' too many"),
    ("\n}\nMOTION", "\nMOTION", "the hierarchy is cut off before its last '}'"),
    ("}\nMOTION", "}\nROOT Other\n{\nOFFSET 0 0 0\n}\nMOTION", r"2 figures \(Hips, Other\), not one; split the file"),
    ("Frames: 2", "Frames: 3", r"'Frames: 3' announces 36 values \(12 channels\), but there are 2 whole frames;"),
    ("Frames: 2", "Frames: 4", "'Frames: 4' announces 48 values .* there are 2 whole frames; correct that number"),
    ("-11 -21 -31", "-11 -21", "there are 1 whole frames and 11 values"),
    ("Frames: 2", "Frames: 0", "0 frames of 12 channels are no motion"),
    ("Frames: 2", "Frames: two", "'Frames:' and 'Frame Time:' must follow MOTION"),
    ("0.0333333", "0", "Frame Time is '0'; it must be seconds"),
    ("0.0333333", "abc", "Frame Time is 'abc'"),
    ("1 93 2", "1 nan 2", "frame 1 is not finite"),
    ("1 93 2", "1 -nan(ind) 2", "frame 1 is not finite; cut or mend it, or fill it: bodysense track small.bvh"),
    ("OFFSET 10 -80 0", "OFFSET 10,5 -80,0 0", "OFFSET '10,5 -80,0 0' has commas for decimal points"),
    ("1 93 2", "1 9e999 2", "frame 1 is not finite"),
    ("1 93 2", "1 93,5 2", "'93,5' in the motion is not a number"),
]


@pytest.mark.parametrize(("old", "new", "message"), BROKEN)
def test_errors_name_the_problem(small: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(BodysenseError, match=message) as error:
        read_bvh(changed(small, old, new))
    assert str(small) in str(error.value)


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match=r"cannot be read .No such file"):
        read_bvh(tmp_path / "none.bvh")


def test_a_truncated_file_is_refused(small: Path) -> None:
    for cut in range(0, SMALL.rindex("-31"), 7):
        small.write_text(SMALL[:cut])
        with pytest.raises(BodysenseError, match=str(small)):
            read_bvh(small)


def test_a_deep_hierarchy_is_read(tmp_path: Path) -> None:
    depth = 1500
    channels = "CHANNELS 3 Zrotation Xrotation Yrotation"
    joints = "".join(f"JOINT j{k}\n{{\nOFFSET 0 .1 0\n{channels}\n" for k in range(depth))
    path = tmp_path / "deep.bvh"
    path.write_text(
        f"HIERARCHY\nROOT r\n{{\nOFFSET 0 0 0\n{channels}\n{joints}"
        + "}\n" * (depth + 1)
        + "MOTION\nFrames: 1\nFrame Time: .1\n"
        + "0 " * 3 * (depth + 1)
    )
    assert len(read_bvh(path).pose.skeleton.joints) == depth + 1


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.permutations("XYZ"),
    st.sampled_from([1.0, 0.01, 0.001]),
    st.integers(0, 99),
)
def test_a_round_trip_is_exact(tmp_path: Path, make_clip, order: list[str], unit: float, seed: int) -> None:
    rate = (24.0, 59.94, 120.0)[seed % 3]
    clip = make_clip(frames=5, seed=seed, spread=1.5, rate=rate)
    write_bvh(tmp_path / "a.bvh", clip, unit=unit, order="".join(order))
    back = read_bvh(tmp_path / "a.bvh", unit=unit)
    there = back.pose.skeleton.indices(clip.pose.skeleton.joints)  # a file lists joints depth first
    assert np.rad2deg(geodesic_angle(back.pose.rotation[:, there], clip.pose.rotation)).max() < 1e-4
    np.testing.assert_allclose(back.pose.root_position, clip.pose.root_position, atol=1e-6)
    offset = clip.pose.skeleton.rest_offset[: len(there)]
    np.testing.assert_allclose(back.pose.skeleton.rest_offset[there], offset, atol=1e-6)
    assert sorted(back.pose.skeleton.joints) == sorted(clip.pose.skeleton.joints)
    assert back.frame_rate == pytest.approx(rate, rel=1e-9)


@pytest.mark.parametrize("middle", [90.0, -90.0, 89.9999])
def test_a_round_trip_in_gimbal_lock(tmp_path: Path, make_clip, middle: float) -> None:
    clip = make_clip(frames=3)
    turns = Rotation.from_euler("ZXY", [[30, middle, 50]] * 3, degrees=True).as_quat(scalar_first=True)
    clip.pose.rotation[:, 5] = turns
    write_bvh(tmp_path / "a.bvh", clip)
    back = read_bvh(tmp_path / "a.bvh").pose
    joint = back.skeleton.index(clip.pose.skeleton.joints[5])
    assert np.rad2deg(geodesic_angle(back.rotation[:, joint], turns)).max() < 1e-4


def test_a_round_trip_of_a_real_file(motion_data: Path, tmp_path: Path) -> None:
    clip = read_bvh(motion_data / "rocketbox" / "f_cheer_03.bvh")
    assert clip.pose.skeleton.end_sites.count("LeftHandIndex3_end") == 1
    write_bvh(tmp_path / "a.bvh", clip)
    back = read_bvh(tmp_path / "a.bvh")
    assert (back.pose.skeleton.points, back.pose.skeleton.parents) == (
        clip.pose.skeleton.points,
        clip.pose.skeleton.parents,
    )
    assert np.rad2deg(geodesic_angle(back.pose.rotation, clip.pose.rotation)).max() < 1e-4


def test_a_failed_write_names_the_problem_and_keeps_the_old_file(tmp_path: Path, make_clip) -> None:
    clip, path = make_clip(), tmp_path / "a.bvh"
    path.write_text("old")
    broken = Clip("b", Pose(clip.pose.skeleton, clip.pose.root_position, clip.pose.rotation * np.nan), 30.0)
    with pytest.raises(
        BodysenseError, match=r"a.bvh: .* finite numbers, rotation \(T, J, 4\); got \(12, 52, 4\), not all"
    ):
        write_bvh(path, broken)
    with pytest.raises(BodysenseError, match=r"got \(52, 4\)"):
        write_bvh(path, Clip("b", clip.pose[0], 30.0))
    with pytest.raises(BodysenseError, match=r"order 'XYX' must name X, Y and Z once each"):
        write_bvh(path, clip, order="XYX")
    with pytest.raises(BodysenseError, match=r"unit 0 m must be positive"):
        write_bvh(path, clip, unit=0.0)
    with pytest.raises(BodysenseError, match=r"does not exist; create it"):
        write_bvh(tmp_path / "no" / "a.bvh", clip)
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_joints_that_keep_still_are_written_as_others_are(tmp_path: Path) -> None:
    """Rows of a file whose numbers do not change in some blocks: each number as Python formats it alone."""
    rng, skeleton = np.random.default_rng(2), default_skeleton()
    turns = Rotation.random(600 * len(skeleton.joints), rng=rng).as_quat(scalar_first=True)
    rotation = turns.reshape(600, len(skeleton.joints), 4)
    rotation[:, 5], rotation[:, 7], rotation[:300, 9] = rotation[0, 5], [1.0, 0.0, 0.0, 0.0], rotation[0, 9]
    clip = Clip("still", Pose(skeleton, rng.standard_normal((600, 3)) * [1.0, 0.0, 1.0], rotation), 30.0)
    write_bvh(tmp_path / "all.bvh", clip)
    rows = (tmp_path / "all.bvh").read_text().partition("Frame Time")[2].splitlines()[1:]
    for frame in range(0, 600, 37):
        write_bvh(tmp_path / "one.bvh", replace(clip, pose=clip.pose[[frame]]))
        assert (tmp_path / "one.bvh").read_text().splitlines()[-1] == rows[frame]
