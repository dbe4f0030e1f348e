"""Gloves on the command line: simulated, recorded as .csv, .c3d and recordings, tracked, merged, refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.hands.glove import glove_points
from bodysense.body.hands.hand import FREEDOMS, HAND_JOINTS, angles_of, mirrored_rotations
from bodysense.body.pose import forward_kinematics
from bodysense.cli import main
from bodysense.devices.gloves import calibration, device, hands
from bodysense.devices.simulated import sensing
from bodysense.devices.simulated.glove import observe
from bodysense.devices.simulated.noise import hide
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import read_bvh
from bodysense.io.formats.recording import Recording, read_recording, write_recording
from bodysense.io.markers.files import write_markers
from bodysense.io.markers.formats.c3d import write_c3d
from bodysense.io.markers.raw_markers import points_alone
from bodysense.io.markers.recording import read_markers
from bodysense.observing.observation import Observation
from bodysense.observing.points import chosen_points

Command = Callable[..., str]


class Fixed:
    """A network with a constant output, because these tests are of the command."""

    def __init__(self, values: int) -> None:
        self.values = values

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        return np.zeros((len(markers), self.values))


@pytest.fixture(autouse=True)
def small_models(monkeypatch: pytest.MonkeyPatch) -> None:
    """No network of gloves is needed, and calibrations take few frames and steps."""
    for module in (hands, device):
        monkeypatch.setattr(module, "load_glove_models", lambda: hands.GloveModels(Fixed(27), Fixed(26)))
    for name, count in (("FRAMES", 8), ("_TRIED", 4), ("_STEPS", 8), ("_ROUNDS", 1), ("_AGAIN", 2)):
        monkeypatch.setattr(calibration, name, count)


@pytest.fixture(scope="module")
def gloves(short_clip: Clip) -> Observation:
    """Both gloves of the short clip, with every marker seen."""
    return observe(short_clip.pose, short_clip.time)


@pytest.fixture
def files(tmp_path: Path, gloves: Observation, short_clip: Clip) -> Path:
    """A folder with gloves.csv, .c3d and .npz."""
    for name in ("gloves.csv", "gloves.c3d"):
        write_markers(tmp_path / name, gloves, 30.0)
    write_recording(tmp_path / "gloves.npz", Recording(gloves, short_clip.pose.skeleton))
    return tmp_path


def backs(path: Path) -> np.ndarray:
    """(T, 2, 3) m: the wrists of a BVH file."""
    pose = read_bvh(path).pose
    return np.asarray(forward_kinematics(pose)[0])[:, pose.skeleton.indices(["left_wrist", "right_wrist"])]


def test_a_guessed_limb_is_a_warning(tmp_path: Path, short_clip: Clip, capsys: pytest.CaptureFixture[str]) -> None:
    """The warning is on the error stream, with --quiet too, in the JSON summary, and nowhere else."""
    legs = [f"{side}_{part}" for side in ("left", "right") for part in ("hip", "knee", "ankle", "foot")]
    place = np.asarray(forward_kinematics(short_clip.pose)[0])[:, short_clip.pose.skeleton.indices(legs)]
    file, out, summary = (str(tmp_path / name) for name in ("legs.c3d", "out.bvh", "out.json"))
    write_c3d(Path(file), points_alone(tuple(legs), place, short_clip.time), short_clip.frame_rate)
    for more in ([], ["--quiet"]):
        assert main(["track", file, "-o", out, "--json", summary, *more]) == 0
        captured = capsys.readouterr()
        (line,) = json.loads(Path(summary).read_text())["warnings"]
        assert captured.err == f"WARNING: {line}\n" and line.startswith("left arm and right arm: hang at the sides")
        assert "arm" not in captured.out


def test_gloves_become_a_body(files: Path, motion: Path, run: Command) -> None:
    output = run("track", files / "gloves.csv", "-o", files / "hands.bvh")
    assert "wrote" in output and "note" not in output
    # The hands of a file without its wearer's skeleton are as large as its gloves look, to within a few percent.
    np.testing.assert_allclose(backs(files / "hands.bvh"), backs(motion), atol=0.02)


def test_finger_columns_are_gloves(
    files: Path, motion: Path, run: Command, gloves: Observation, short_clip: Clip
) -> None:
    from bodysense.body.hands.hand import hand_skeleton
    from bodysense.geometry.rotation import geodesic_angle

    output = run("track", files / "gloves.npz", "-o", files / "hands.bvh")
    assert "wrote" in output and "note" not in output
    np.testing.assert_allclose(backs(files / "hands.bvh"), backs(motion), atol=0.002)
    pose, skeleton = read_bvh(files / "hands.bvh").pose, short_clip.pose.skeleton
    several = hands.Hands({"left": hand_skeleton(skeleton, "left")}, hands.load_glove_models())
    answer = several.step(gloves, several.start())[0]["left"]
    assert answer.pose is not None
    joints = pose.skeleton.indices([f"left_{name}" for name in HAND_JOINTS[1:]])
    assert np.degrees(geodesic_angle(pose.rotation[:, joints], answer.pose.rotation[:, 1:])).max() < 0.5
    assert np.degrees(geodesic_angle(pose.rotation[0, joints], pose.rotation[10, joints])).max() > 1  # they move


@pytest.mark.parametrize("ending", ["c3d", "jsonl"])
def test_gloves_are_simulated(tmp_path: Path, motion: Path, run: Command, ending: str) -> None:
    out = tmp_path / f"seen.{ending}"
    assert "20 frames" in run("simulate", motion, "--device", "gloves", "-o", out)
    found = read_recording(out) if ending in ("npz", "jsonl") else read_markers(out)
    assert set(found.observation.points) == {*glove_points("left"), *glove_points("right")}
    assert 0.3 < found.observation.has_position.mean() <= 1
    if ending == "jsonl":  # `test_gloves_become_a_body` tracks the others
        run("track", out, "-o", tmp_path / "hands.bvh")


def test_a_headset_and_gloves(
    tmp_path: Path, short_clip: Clip, gloves: Observation, motion: Path, run: Command
) -> None:
    head = sensing.observe(short_clip.pose, short_clip.time, SENSOR_SETS["head"])
    fields = ("position", "rotation", "has_position", "has_rotation", "accuracy")
    joined = {name: np.concatenate([getattr(head, name), getattr(gloves, name)], axis=1) for name in fields}
    both = Observation(points=(*head.points, *gloves.points), time=head.time, **joined)
    write_recording(tmp_path / "both.npz", Recording(both, short_clip.pose.skeleton))
    run("track", tmp_path / "both.npz", "-o", tmp_path / "body.bvh")
    np.testing.assert_allclose(backs(tmp_path / "body.bvh"), backs(motion), atol=0.012)


def test_names_units_and_axes(files: Path, motion: Path, gloves: Observation, run: Command, refused: Command) -> None:
    theirs = tuple(f"M{k}" for k in range(18))
    # As of another program: millimetres, +Z up, left-handed, names of its own.
    other = gloves.position[..., [0, 2, 1]] * [-1, -1, 1] * 1000
    from bodysense.io.markers.formats.csv_table import write_csv

    write_csv(files / "other.csv", replace(gloves, points=theirs, position=other))
    (files / "names.json").write_text(json.dumps(dict(zip(theirs, gloves.points, strict=True))))
    arguments = ["track", files / "other.csv", "-o", files / "b.bvh"]
    assert "give a table of names with --names" in refused(*arguments)
    arguments += ["--names", files / "names.json"]
    assert "the numbers are mm, not m; give --unit mm" in refused(*arguments)
    arguments += ["--unit", "mm", "--up", "z"]
    assert "if the axes are left-handed (Unity, Unreal), give --left-handed" in refused(*arguments)
    run(*arguments, "--left-handed")
    np.testing.assert_allclose(backs(files / "b.bvh"), backs(motion), atol=0.02)


def test_wrong_markers_give_one_line(files: Path, motion: Path, refused: Command) -> None:
    out = files / "out.bvh"
    arguments = ("track", files / "gloves.csv", "-o", out)
    assert "no such model file" in refused(*arguments, "--model", files / "a.onnx")
    assert "0 Hz is no frame rate" in refused(*arguments, "--rate", 0)
    assert refused(*arguments, "--up", "x") == "--up x: of marker files it is one of y, z"
    assert "cannot be read" in refused(*arguments, "--names", files / "missing.json")
    assert "--figure is for motions" in refused("track", files / "gloves.npz", "-o", out, "--figure", 1)
    assert "no such file" in refused("track", files / "missing.c3d", "-o", out)
    (files / "text.c3d").write_text("hello")
    assert "not a C3D file" in refused("track", files / "text.c3d", "-o", out)
    text = (files / "gloves.csv").read_text()
    (files / "twice.csv").write_text(text.replace("left_glove_wrist", "left_glove_index_base"))
    assert "stands twice; every marker has one name" in refused("track", files / "twice.csv", "-o", out)
    assert "a.csv: signals of headset_camera are written as" in refused("simulate", motion, "-o", files / "a.csv")
    assert not out.exists()


def test_a_third_hand_is_left_out(files: Path, gloves: Observation, short_clip: Clip, run: Command) -> None:
    more = chosen_points(gloves, range(9))
    three = Observation(
        points=(*gloves.points, *glove_points("left2")),
        time=gloves.time,
        **{
            name: np.concatenate([getattr(gloves, name), getattr(more, name)], axis=1)
            for name in ("position", "rotation", "has_position", "has_rotation", "accuracy")
        },
    )
    write_recording(files / "three.npz", Recording(three, short_clip.pose.skeleton))
    assert "left out 'left2'" in run("track", files / "three.npz", "-o", files / "a.bvh")


def test_gloves_with_inertial_sensors_go_from_a_motion_to_a_body(
    tmp_path: Path, short_clip: Clip, motion: Path, run: Command, refused: Command
) -> None:
    """Fingers move although only markers on the back of the right hand are seen."""
    run("simulate", motion, "--device", "gloves_imu", "-o", tmp_path / "seen.npz")
    found = read_recording(tmp_path / "seen.npz")
    hidden = np.zeros(found.observation.has_position.shape, dtype=bool)
    for place, name in enumerate(found.observation.points):
        hidden[:, place] = name.startswith("right_glove_") and not name.endswith(("_base", "_wrist"))
    write_recording(tmp_path / "fewer.jsonl", replace(found, observation=hide(found.observation, hidden)))
    run("track", tmp_path / "fewer.jsonl", "-o", tmp_path / "hands.bvh")
    assert found.observation.has_position[:, 9:12].all()
    pose, true = read_bvh(tmp_path / "hands.bvh").pose, short_clip.pose
    joints = pose.skeleton.indices([f"right_{name}" for name in HAND_JOINTS[1:]])
    angle = [np.asarray(angles_of(mirrored_rotations(one.rotation[:, joints], "right"))) for one in (pose, true)]
    bent = [k for k, row in enumerate(FREEDOMS) if row.angle == "flexion"]
    assert np.degrees(np.abs(angle[0] - angle[1])[12:, bent]).mean() < 3.0
    assert "marker files have no sensors; give a recording" in refused(
        "simulate", motion, "--device", "gloves_imu", "-o", tmp_path / "seen.c3d"
    )
