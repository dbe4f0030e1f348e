"""Persons: from a height, from lengths, from a file, and what is refused."""

from __future__ import annotations

import copy
import json
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bodysense.body.person import FORMAT, Person
from bodysense.body.shape import Measured, shape_space, stature
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rigid import RigidTransform

SETTINGS = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
MOUNTS = {
    "head": RigidTransform(np.array([0.0, 0.1, 0.05]), np.array([0.9, 0.1, 0.2, -0.3])),
    "pelvis": RigidTransform(),
}


def same(a: Person, b: Person) -> None:
    assert a.skeleton.joints == b.skeleton.joints
    assert a.skeleton.end_sites == b.skeleton.end_sites
    assert a.skeleton.parents == b.skeleton.parents
    np.testing.assert_array_equal(a.skeleton.rest_offset, b.skeleton.rest_offset)
    np.testing.assert_array_equal(a.bone_deviation, b.bone_deviation)
    assert list(a.mounts) == list(b.mounts)
    for joint, mount in a.mounts.items():
        np.testing.assert_array_equal(mount.translation, b.mounts[joint].translation)
        np.testing.assert_array_equal(mount.rotation, b.mounts[joint].rotation)


def bone(person: Person, name: str) -> float:
    return float(person.skeleton.bone_length[person.skeleton.index(name)])


@pytest.mark.parametrize("height", [1.0, 1.3, 1.45, 1.6, 1.8, 2.05, 2.3])
def test_stature_equals_the_known_height(height: float) -> None:
    person = Person(height=height)
    assert stature(person.skeleton.rest_offset) == pytest.approx(height, abs=2e-3)
    assert (person.skeleton.bone_length[1:] > 0).all()
    assert (person.bone_deviation[1:] > 0).all()


def test_a_person_without_arguments_is_the_mean_adult() -> None:
    person = Person()
    np.testing.assert_array_equal(person.skeleton.rest_offset, shape_space().mean)
    assert (Person(height=1.7).bone_deviation <= person.bone_deviation).all()  # whose height is known is known better
    assert not person.mounts


def test_known_proportions_are_certain() -> None:
    person = Person.known(default_skeleton())
    assert person.skeleton is default_skeleton()
    np.testing.assert_array_equal(person.bone_deviation, 0)


def test_lengths_are_known_or_measured() -> None:
    thigh = ("left_hip", "left_knee")
    exact = Person(lengths={thigh: 0.46}, height=Measured(1.75, 0.001))
    assert bone(exact, "left_knee") == pytest.approx(0.46, abs=1e-3)
    assert bone(exact, "right_knee") == pytest.approx(bone(exact, "left_knee"), abs=1e-12)
    assert stature(exact.skeleton.rest_offset) == pytest.approx(1.75, abs=2e-3)
    guessed, measured = Person(height=1.75), Person(lengths={thigh: Measured(0.46, 0.02)}, height=1.75)
    assert 1.75 < stature(Person(lengths={thigh: 0.46}, height=1.75).skeleton.rest_offset) < 1.8  # it yields
    assert bone(guessed, "left_knee") < bone(measured, "left_knee") < bone(exact, "left_knee")
    knee = exact.skeleton.index("left_knee")
    assert exact.bone_deviation[knee] < measured.bone_deviation[knee] < guessed.bone_deviation[knee]


def test_small_people_keep_known_lengths() -> None:
    """Outside the statures of adults the space is scaled, and known lengths still hold."""
    child = Person(lengths={("left_elbow", "left_wrist"): 0.17}, height=Measured(1.2, 0.001))
    assert bone(child, "left_wrist") == pytest.approx(0.17, abs=1e-3)
    assert stature(child.skeleton.rest_offset) == pytest.approx(1.2, abs=2e-3)


def test_persons_can_be_changed_and_sent() -> None:
    person = Person(height=1.8, mounts=MOUNTS)
    changed = replace(person, mounts={})
    assert not changed.mounts
    same(replace(changed, mounts=MOUNTS), person)
    same(pickle.loads(pickle.dumps(person)), person)
    same(copy.deepcopy(person), person)
    assert Person(mounts=MOUNTS).mounts == MOUNTS
    with pytest.raises(AttributeError):
        person.skeleton = default_skeleton()  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(ValueError, match="read-only"):
        person.bone_deviation[0] = 1


numbers = st.floats(-2, 2, allow_subnormal=False)
transforms = st.builds(
    RigidTransform,
    st.lists(numbers, min_size=3, max_size=3).map(np.array),
    st.lists(st.floats(0.1, 1), min_size=4, max_size=4).map(np.array),
)


@SETTINGS
@given(
    st.lists(st.floats(-2, 2), min_size=16, max_size=16),
    st.lists(st.floats(0, 0.1), min_size=65, max_size=65),
    st.dictionaries(st.sampled_from(default_skeleton().joints), transforms, max_size=6),
)
def test_files_keep_every_bit(tmp_path: Path, shape: list[float], deviation: list[float], mounts: Any) -> None:
    skeleton = shape_space().skeleton_of(np.array(shape))
    person = Person(skeleton, bone_deviation=np.array(deviation), mounts=mounts)
    person.save(tmp_path / "wearer.json")
    same(Person.load(tmp_path / "wearer.json"), person)
    assert [path.name for path in tmp_path.iterdir()] == ["wearer.json"]


def test_skeletons_of_any_kind_are_kept(tmp_path: Path) -> None:
    stick = Skeleton(('a "b"', "ü\n"), ("top",), (-1, 0, 1), np.array([[0, 0, 0], [0, 0.8, 0], [0, 0.8, 0]]))
    person = Person(stick, mounts={"ü\n": RigidTransform()})
    person.save(tmp_path / "stick.json")
    same(Person.load(tmp_path / "stick.json"), person)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("person") / "wearer.json"
    Person(height=1.8, mounts=MOUNTS).save(path)
    return path.read_text(encoding="utf-8")


def test_files_are_for_people_to_read(stored: str) -> None:
    lines = stored.splitlines()
    assert lines[1] == f'"format": "{FORMAT}",'
    assert sum('"name": "left_knee"' in line for line in lines) == 1  # one point a line
    assert json.loads(stored)["mounts"][0]["joint"] == "head"


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


@SETTINGS
@given(st.data())
def test_other_contents_are_refused_in_one_line(tmp_path: Path, stored: str, data: st.DataObject) -> None:
    """Any value may be replaced by any other."""
    contents = json.loads(stored)
    place: Any = contents
    while True:
        key = data.draw(st.sampled_from(sorted(place)) if isinstance(place, dict) else st.integers(0, len(place) - 1))
        if not isinstance(place[key], (dict, list)) or not place[key] or data.draw(st.integers(0, 2)) == 0:
            break
        place = place[key]
    if isinstance(place, dict) and data.draw(st.booleans()):
        del place[key]
    else:
        place[key] = data.draw(json_values)
    path = tmp_path / "other.json"
    path.write_text(json.dumps(contents), encoding="utf-8")
    load_or_refuse(path)


def load_or_refuse(path: Path) -> None:
    try:
        Person.load(path)
    except BodysenseError as error:
        assert str(path) in str(error)
        assert "\n" not in str(error)


def rewritten(stored: str, path: Path, **changes: Any) -> Path:
    path.write_text(json.dumps(json.loads(stored) | changes), encoding="utf-8")
    return path


def test_files_that_are_refused(tmp_path: Path, stored: str) -> None:
    def refused(text: str, path: Path) -> None:
        with pytest.raises(BodysenseError, match=text):
            Person.load(path)

    path = tmp_path / "wearer.json"
    refused("cannot be read .*; give a person's file", tmp_path / "none.json")
    refused("cannot be read", tmp_path)
    path.write_bytes(b"\xff\xfe")
    refused("is not JSON", path)
    path.write_text("[" * 100_000, encoding="utf-8")
    refused("is not JSON", path)
    path.write_text("[]", encoding="utf-8")
    refused("format None; it must be 'bodysense-person-1'", path)
    refused("format 'bodysense-person-9'; it must be", rewritten(stored, path, format="bodysense-person-9"))
    refused("'mounts' must be a list of rows with joint, translation, rotation", rewritten(stored, path, mounts=None))
    sites = json.loads(stored)["end_sites"]
    del sites[1]["parent"]
    mount = {"joint": "head", "translation": [0, 0, 0], "rotation": [1, 0, 0, 0]}
    refused("row 2 of 'end_sites': 'parent' is missing", rewritten(stored, path, end_sites=sites))
    refused("two rows of 'mounts' are of 'head'; remove one", rewritten(stored, path, mounts=[mount, mount]))
    refused(
        "row 1 of 'mounts': 'rotation' is .*; it must be 4 finite numbers",
        rewritten(stored, path, mounts=[mount | {"rotation": [1, 0, 0]}]),
    )
    rows = json.loads(stored)["joints"]
    rows[4] |= {"offset": [0, float("nan"), 0]}
    refused("row 5 of 'joints': 'offset' is .*; it must be 3 finite numbers", rewritten(stored, path, joints=rows))
    rows[4] |= {"offset": [0, -40, 0]}
    refused("a skeleton 4.* m high; people are 1.0 to 2.3 m", rewritten(stored, path, joints=rows))


def test_invalid_arguments_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match=r"height 180 m; people are 1\.0 to 2\.3 m high, give metres"):
        Person(height=180)
    for height in (0.99, 2.31, Measured(0.5, 0.1)):
        with pytest.raises(BodysenseError, match="people are"):
            Person(height=height)
    for height in (float("nan"), -1.0):
        with pytest.raises(BodysenseError, match="must be positive"):
            Person(height=height)
    with pytest.raises(BodysenseError, match="both a skeleton and a height or lengths were given"):
        Person(default_skeleton(), height=1.8)
    with pytest.raises(BodysenseError, match=r"a skeleton 170 m high; people are .* give offsets in metres"):
        Person(default_skeleton().with_offsets(default_skeleton().rest_offset * 170 / default_skeleton().height))
    with pytest.raises(BodysenseError, match=r"deviations \(3,\); give one for each of the 65 points"):
        Person(default_skeleton(), bone_deviation=np.zeros(3))
    with pytest.raises(BodysenseError, match="deviation of 'left_hip' is -1 m; give 0 or more"):
        Person(default_skeleton(), bone_deviation=np.array([0, -1.0, *np.zeros(63)]))
    with pytest.raises(BodysenseError, match="unknown joint 'heat'; this skeleton has head"):
        Person(height=1.8, mounts={"heat": RigidTransform()})
    with pytest.raises(BodysenseError, match="worn on 'left_toe', which is no joint"):
        Person(height=1.8, mounts={"left_toe": RigidTransform()})
    with pytest.raises(BodysenseError, match=r"the folder .* does not exist"):
        Person().save(tmp_path / "none" / "wearer.json")
