"""Files as people bring them, made of one known motion: layouts of points, orders of axes, logs, several people."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rig_files import motion, write
from rig_layouts import LAYOUTS

from bodysense.body.pose import forward_kinematics
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp, quaternion_rotate
from bodysense.io.formats.headset_log import is_headset_log, read_headset_log
from bodysense.io.formats.motion_arrays import places_of_vectors
from bodysense.io.formats.point_layouts import LAYOUTS as POINTS
from bodysense.io.formats.smpl import joint_places
from bodysense.io.markers.options import MarkerOptions
from bodysense.io.reading_options import ReadingOptions
from bodysense.io.rigged import read_rigged
from bodysense.sources.open import MarkerSource, RecordingSource, open_source

COMMON = [
    f"{side}_{part}" for side in ("left", "right") for part in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
]


def places() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return (T, 22, 3) m of a moving person, and the same by name with points of the face and the feet."""
    clip = motion(60, 4)
    place, points = np.asarray(forward_kinematics(clip.pose)[0]), clip.pose.skeleton.points
    at = {name: place[:, k] for k, name in enumerate(points)}
    ahead = np.cross(at["left_hip"] - at["right_hip"], at["neck"] - at["pelvis"])
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    face = at["head"] + 0.08 * ahead
    more = {"nose": face, "mid_hip": (at["left_hip"] + at["right_hip"]) / 2, "spine base": at["pelvis"]}
    for side in ("left", "right"):
        more |= {f"{side}_foot_index": at[f"{side}_toe"], f"{side}_big_toe": at[f"{side}_toe"]}
    return place[:, :22], at | more


@pytest.mark.parametrize("layout", [name for name in POINTS if name != "smpl"])
def test_a_layout_names_the_points_of_an_array(tmp_path: Path, layout: str) -> None:
    _, at = places()
    down = np.array([1.0, -1.0, -1.0]) if layout == "mediapipe" else np.ones(3)
    array = np.stack([at.get(name, at["head"]) for name in POINTS[layout]], axis=1) * down
    np.save(tmp_path / "points.npy", array)
    with pytest.raises(BodysenseError, match=f"layout is not told; give it: .*--points {layout}"):
        open_source(tmp_path / "points.npy")
    opened = open_source(tmp_path / "points.npy", markers=MarkerOptions(points=layout, rate=30.0))  # type: ignore[arg-type]
    assert isinstance(opened, MarkerSource)
    seen = opened.recording.observation
    for name in COMMON:
        off = seen.position[:, seen.points.index(name)] - at[name]
        assert np.abs(off - off.mean(axis=0)).max() < 1e-6 and np.abs(off.mean(axis=0)[[0, 2]]).max() < 1e-6, name


@pytest.mark.parametrize("shape", ["(1, T, 22, 3)", "(22, 3, T)", "(1, 22, 3, T)"])
def test_orders_of_axes(tmp_path: Path, shape: str) -> None:
    place, _ = places()
    first = np.moveaxis(place, 0, -1)
    np.save(
        tmp_path / "a.npy", {"(1, T, 22, 3)": place[None], "(22, 3, T)": first, "(1, 22, 3, T)": first[None]}[shape]
    )
    found = joint_places(tmp_path / "a.npy")
    assert found is not None
    np.testing.assert_array_equal(found.place, place)


def test_several_motions_need_a_choice(tmp_path: Path) -> None:
    place, _ = places()
    np.save(tmp_path / "a.npy", np.stack([place, place + 1.0]))
    with pytest.raises(BodysenseError, match=r"a\.npy: 2 motions .* choose one with --figure 1"):
        joint_places(tmp_path / "a.npy")
    found = joint_places(tmp_path / "a.npy", figure=2)
    assert found is not None
    np.testing.assert_array_equal(found.place, place + 1.0)


def vectors_of(place: np.ndarray) -> np.ndarray:
    """Encode places (T, 22, 3) as HumanML3D does: heading and steps of the root, places relative to it."""
    across = place[:, 1] - place[:, 2]
    heading = np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))
    heading -= heading[0]
    half = heading / 2  # its quaternions have half of the turn
    back = quaternion_exp(np.stack([0 * heading, -heading, 0 * heading], axis=-1))
    vectors = np.zeros((len(place), 263))
    vectors[:-1, 0] = -np.diff(half)
    step = np.zeros((len(place), 3))
    step[:-1] = np.diff(place[:, 0], axis=0)
    vectors[:-1, 1:3] = quaternion_rotate(back[1:], step[:-1])[:, [0, 2]]
    vectors[:, 3] = place[:, 0, 1]
    local = place[:, 1:] - place[:, :1] * [1, 0, 1]
    vectors[:, 4:67] = quaternion_rotate(back[:, None], local).reshape(len(place), -1)
    return vectors


def test_vectors_of_text_to_motion_give_their_places(tmp_path: Path) -> None:
    place, _ = places()
    vectors = vectors_of(place)
    np.testing.assert_allclose(places_of_vectors(vectors), place - place[:1, :1] * [1, 0, 1], atol=1e-9)
    np.save(tmp_path / "vectors.npy", vectors.astype(np.float32))
    opened = open_source(tmp_path / "vectors.npy", markers=MarkerOptions(rate=20.0))
    assert isinstance(opened, MarkerSource)
    seen = opened.recording.observation
    off = seen.position[:, seen.points.index("left_wrist")] - place[:, 20]
    assert np.abs(off - off.mean(axis=0)).max() < 1e-4


def test_normalised_vectors_are_refused_with_the_way_to_undo_it(tmp_path: Path) -> None:
    vectors = vectors_of(places()[0])
    np.save(tmp_path / "vectors.npy", (vectors - vectors.mean(axis=0)) / (vectors.std(axis=0) + 1e-2))
    with pytest.raises(BodysenseError, match=r"recover_from_ric.*Std\.npy and add its Mean\.npy, .*--points humanml3d"):
        open_source(tmp_path / "vectors.npy")


@pytest.mark.parametrize(
    "columns",
    [
        ("head.pos.{}", "head.rot.{}", "leftHand.pos.{}", "leftHand.rot.{}"),
        ("HMD_position_{}", "HMD_rotation_{}", "LeftController_position_{}", "LeftController_rotation_{}"),
        ("Headset {}", "Headset Q{}", "left_hand {}", "left_hand q{}"),
    ],
)
@pytest.mark.parametrize("left_handed", [False, True])
def test_logs_of_headsets_are_recordings(tmp_path: Path, columns: tuple[str, ...], left_handed: bool) -> None:
    rng = np.random.default_rng(1)
    place, turn = rng.normal(size=(5, 2, 3)), rng.normal(size=(5, 2, 4))
    turn /= np.linalg.norm(turn, axis=-1, keepdims=True)  # x y z w
    names = [
        template.format(axis) for template, axes in zip(columns, ("xyz", "xyzw") * 2, strict=True) for axis in axes
    ]
    rows = np.hstack([np.arange(5)[:, None] / 30, place[:, 0], turn[:, 0], place[:, 1], turn[:, 1]])
    text = ",".join(["time", *names]) + "\n" + "\n".join(",".join(f"{x:.9f}" for x in row) for row in rows)
    path = tmp_path / "log.csv"
    path.write_text(text)
    assert is_headset_log(path)
    seen = read_headset_log(path, left_handed=left_handed).observation
    assert seen.points == ("headset", "left_controller")
    mirror = np.array([1.0, 1.0, -1.0]) if left_handed else np.ones(3)
    np.testing.assert_allclose(seen.position, place * mirror, atol=1e-8)
    point = rng.normal(size=3)
    turned = quaternion_rotate(turn[..., [3, 0, 1, 2]], np.broadcast_to(point * mirror, (5, 2, 3))) * mirror
    np.testing.assert_allclose(quaternion_rotate(seen.rotation, np.broadcast_to(point, (5, 2, 3))), turned, atol=1e-7)
    assert isinstance(open_source(path, ReadingOptions(left_handed=left_handed)), RecordingSource)


def test_of_two_people_one_is_chosen(tmp_path: Path) -> None:
    place, _ = places()
    labels = [f"{who}:{name}" for who in ("Anna", "Ben") for name in COMMON]
    _, at = places()
    one = np.stack([at[name] for name in COMMON], axis=1)
    both = np.concatenate([one, one + np.array([1.0, 0, 0])], axis=1)
    names = ",".join(f"{label}.{axis}" for label in labels for axis in "xyz")
    rows = (",".join(f"{x:.6f}" for x in [k / 30, *row.ravel()]) for k, row in enumerate(both))
    (tmp_path / "two.csv").write_text(f"time,{names}\n" + "\n".join(rows))
    with pytest.raises(BodysenseError, match=r"2 bodies in it: 1 \(Anna\), 2 \(Ben\); choose one with --figure 1"):
        open_source(tmp_path / "two.csv")
    seen = [open_source(tmp_path / "two.csv", ReadingOptions(figure=k)).recording.observation for k in (1, 2)]  # type: ignore[union-attr]
    np.testing.assert_allclose(
        seen[1].position - seen[0].position, np.broadcast_to([1.0, 0, 0], seen[0].position.shape), atol=1e-5
    )
    assert len(place)


def rigged(text: str) -> np.ndarray:
    return np.asarray(forward_kinematics(read_rigged(text.encode(), Path("take.bvh")).clip.pose)[0])


def test_bvh_files_with_comments_and_numbered_ends() -> None:
    text = write(LAYOUTS["Mixamo"], motion(6, 50))
    numbered = text
    for k in range(numbered.count("End Site\n")):
        numbered = numbered.replace("End Site\n", f"End Site{k} \n", 1)
    for odd in ("# a comment\n// another\n" + text, numbered):
        np.testing.assert_array_equal(rigged(odd), rigged(text))


@pytest.mark.parametrize("part", ["Leg", "Arm", "ForeArm"])
def test_a_joint_that_no_name_tells_is_taken_from_its_chain(part: str) -> None:
    text = write(LAYOUTS["Mixamo"], motion(6, 50))
    other = text
    for side in ("Left", "Right"):
        other = other.replace(f":{side}{part}\n", f":{side}Qwx\n")
    assert other != text
    np.testing.assert_allclose(rigged(other), rigged(text), atol=1e-6)


def test_wrong_rows_and_rates_say_what_they_are() -> None:
    text = write(LAYOUTS["Mixamo"], motion(6, 50))
    head, _, rows = text.partition("Frame Time:")
    first, *lines = rows.strip().splitlines()
    wide = "\n".join(line + " 1 2 3" for line in lines)
    with pytest.raises(BodysenseError, match="but each row has"):
        rigged(f"{head}Frame Time: {first}\n{wide}\n")
    with pytest.raises(BodysenseError, match=r"Frame Time is 30 seconds, .* write Frame Time: 0\.0333333"):
        rigged(f"{head}Frame Time: 30\n" + "\n".join(lines) + "\n")
