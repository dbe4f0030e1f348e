"""Skeletons: what is refused and how, and what is derived from a tree."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.shape import sample_bodies, stature
from bodysense.body.skeleton import Skeleton, default_body, default_skeleton, skeleton_from_table
from bodysense.errors import BodysenseError

JOINTS = ("root", "left_hip", "right_hip", "left_knee")
SITES = ("left_toe", "tail")
PARENTS = (-1, 0, 0, 1, 3, 0)
OFFSET = np.array([[0, 1, 0], [0.1, 0, 0], [-0.1, 0, 0], [0, -0.4, 0], [0, -0.4, 0.1], [0, 0, -0.2]], dtype=float)


def small() -> Skeleton:
    return Skeleton(JOINTS, SITES, PARENTS, OFFSET)


def table(*rows: tuple[str, str | None]) -> list[dict]:
    return [{"name": name, "parent": parent, "offset": [0.0, 0.1, 0.0]} for name, parent in rows]


def test_points_and_indices() -> None:
    skeleton = small()
    assert skeleton.points == JOINTS + SITES
    assert skeleton.index("tail") == 5
    np.testing.assert_array_equal(skeleton.indices(["left_toe", "root"]), [4, 0])
    assert skeleton.indices([]).shape == (0,)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"joints": ("root", "left_hip", "right_hip", "left_hip")}, "the name 'left_hip' appears twice; .* rename one"),
        ({"end_sites": ("root", "tail")}, "the name 'root' appears twice"),
        ({"parents": (-1, 0, 0)}, r"6 points need 6 parents and offsets \(6, 3\), but got 3 and \(6, 3\)"),
        ({"rest_offset": OFFSET[:5]}, r"but got 6 and \(5, 3\)"),
        ({"parents": (0, 0, 0, 1, 3, 0)}, "the first joint must be the root, with parent -1"),
        ({"parents": (-1, 0, -1, 1, 3, 0)}, "the parent of 'right_hip' is -1; it must be a joint that comes before it"),
        ({"parents": (-1, 3, 0, 1, 3, 0)}, "the parent of 'left_hip' is 3; it must be a joint that comes before it"),
        ({"parents": (-1, 0, 0, 1, 3, 4)}, "the parent of 'tail' is 4; it must be a joint"),
        (
            {"rest_offset": np.where(OFFSET == 0.1, np.nan, OFFSET)},
            "the offset of 'left_hip' is not finite; give three",
        ),
    ],
)
def test_broken_trees_are_refused_by_name(change: dict, text: str) -> None:
    with pytest.raises(BodysenseError, match=text):
        dataclasses.replace(small(), **change)


def test_skeleton_without_joints_is_refused() -> None:
    with pytest.raises(BodysenseError, match="the first joint must be the root"):
        Skeleton((), (), (), np.zeros((0, 3)))


def test_unknown_names_are_refused_with_the_nearest_ones() -> None:
    with pytest.raises(BodysenseError, match="unknown joint 'left_ship'; this skeleton has left_hip"):
        small().index("left_ship")
    with pytest.raises(BodysenseError, match="unknown joint '§'; this skeleton has root, left_hip, right_hip"):
        small().index("§")


def test_table_names_an_unknown_parent() -> None:
    with pytest.raises(BodysenseError, match="'tip' hangs on 'hand', which is not among its joints"):
        skeleton_from_table(table(("root", None)), table(("tip", "hand")))


def test_table_becomes_a_skeleton() -> None:
    skeleton = skeleton_from_table(table(("root", None), ("arm", "root")), table(("tip", "arm")))
    assert skeleton.joints == ("root", "arm")
    assert skeleton.parents == (-1, 0, 1)
    np.testing.assert_array_equal(skeleton.rest_offset, np.tile([0, 0.1, 0], (3, 1)))


def test_offsets_are_immutable() -> None:
    mine = OFFSET.copy()
    skeleton = Skeleton(JOINTS, SITES, PARENTS, mine)
    mine[0] = 7
    np.testing.assert_array_equal(skeleton.rest_offset, OFFSET)
    with pytest.raises(ValueError, match="read-only"):
        skeleton.rest_offset[0] = 7


def test_levels_hold_every_joint_once_below_its_parent() -> None:
    for skeleton in (small(), default_skeleton()):
        joints = np.concatenate([joints for joints, _ in skeleton.levels])
        np.testing.assert_array_equal(np.sort(joints), np.arange(len(skeleton.joints)))
        for (above, _), (joints, places) in zip(skeleton.levels[:-1], skeleton.levels[1:], strict=True):
            np.testing.assert_array_equal(above[places], np.array(skeleton.parents)[joints])


def test_path_sums_bones_from_the_root() -> None:
    for skeleton in (small(), default_skeleton()):
        bones = np.random.default_rng(0).normal(size=(len(skeleton.points), 3))
        position = np.zeros_like(bones)
        for point in range(1, len(bones)):
            position[point] = position[skeleton.parents[point]] + bones[point]
        np.testing.assert_allclose(skeleton.path @ bones, position, atol=1e-12)


def test_mirror_pairs_the_sides() -> None:
    np.testing.assert_array_equal(small().mirror, [0, 2, 1, 3, 4, 5])  # a side that is missing is its own partner
    skeleton = default_skeleton()
    mirror = skeleton.mirror
    np.testing.assert_array_equal(mirror[mirror], np.arange(len(skeleton.points)))
    for point, partner in zip(skeleton.points, mirror, strict=True):
        expected = point.replace("left_", "§").replace("right_", "left_").replace("§", "right_")
        assert skeleton.points[partner] == expected
    parents = np.array(skeleton.parents)
    np.testing.assert_array_equal(mirror[parents[1:]], parents[mirror[1:]])


def test_bone_lengths_and_height() -> None:
    skeleton = small()
    np.testing.assert_allclose(skeleton.bone_length, [0, 0.1, 0.1, 0.4, np.hypot(0.4, 0.1), 0.2])
    assert skeleton.height == pytest.approx(1.0)
    assert skeleton.extent == pytest.approx(0.8)


def test_height_is_the_stature_of_people() -> None:
    """One height for a body: that of people, of `Person(height)` and of the shape space, which sums bones by itself."""
    for offset in sample_bodies("test", 20):
        skeleton = default_skeleton().with_offsets(offset)
        assert skeleton.height == pytest.approx(float(stature(offset)), abs=1e-9)
        assert skeleton.scaled(1.83).height == pytest.approx(Person(skeleton.scaled(1.83)).stature)


@pytest.mark.parametrize("height", [0.5, 1.2, 2.1])
def test_scaling_keeps_proportions(height: float) -> None:
    skeleton = default_skeleton()
    scaled = skeleton.scaled(height)
    assert scaled.height == pytest.approx(height)
    assert scaled.joints == skeleton.joints
    np.testing.assert_allclose(scaled.rest_offset, skeleton.rest_offset * height / skeleton.height)


@pytest.mark.parametrize("height", [0.0, -1.7, 17.0, 170.0, float("nan")])
def test_impossible_heights_are_refused(height: float) -> None:
    with pytest.raises(
        BodysenseError, match=rf"height {height:g} m is not a person's; give metres between 0.3 and 3.0"
    ):
        default_skeleton().scaled(height)


def test_other_offsets_keep_the_tree() -> None:
    other = small().with_offsets(OFFSET * 2)
    assert other.parents == PARENTS
    np.testing.assert_array_equal(other.rest_offset, OFFSET * 2)
    with pytest.raises(BodysenseError, match="6 points need"):
        small().with_offsets(OFFSET[:3])


def test_default_skeleton_is_an_adult_in_t_pose() -> None:
    skeleton = default_skeleton()
    assert len(skeleton.joints) == 52
    assert len(skeleton.end_sites) == 13
    assert skeleton is default_skeleton()
    assert 1.5 < skeleton.height < 1.9
    place = skeleton.path @ skeleton.rest_offset
    at = dict(zip(skeleton.points, place, strict=True))
    assert at["left_wrist"][0] > 0.5 > -0.5 > at["right_wrist"][0]
    assert at["head_top"][1] == place[:, 1].max()
    assert at["left_toe"][2] > at["left_ankle"][2]
    np.testing.assert_allclose(place[skeleton.mirror] * [-1, 1, 1], place, atol=2e-3)
    ends = {skeleton.parents[k] for k in range(len(skeleton.joints), len(skeleton.points))}
    leaves = set(range(len(skeleton.joints))) - set(skeleton.parents[: len(skeleton.joints)])
    assert ends == leaves
    assert {row["name"] for row in default_body()["joints"]} == set(skeleton.joints)
