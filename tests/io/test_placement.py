"""Height and floor of AMASS bodies, with and without their body model, against linear blend skinning."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from people.smpl import SKELETON, betas_of, lowest_soles, made_up_model, save_walk, walk

import bodysense as bs
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.shape import stature
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.datasets.sources import Source, read_source
from bodysense.io.placement import BodyPlacement, footing_of, placement_of, read_with_placement, standing_floor
from bodysense.io.reading_options import ReadingOptions
from bodysense.sources.open import open_source
from bodysense_lab.data.bodies import body_lines, pool_footings
from bodysense_lab.data.clips import open_clips

TO_Y_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
PEOPLE = [(1.55, 0.10), (1.90, -0.12)]  # height, and that of the floor in the file, m


@pytest.mark.parametrize(("height", "floor"), PEOPLE)
def test_bodies_with_their_model_are_where_skinning_puts_them(tmp_path: Path, height: float, floor: float) -> None:
    model = made_up_model(3)
    betas = betas_of(model, height) + np.array([0.0, 1.0])
    poses, trans = walk(model, betas)
    file = save_walk(tmp_path / "walk.npz", poses, trans, betas, floor)
    options = ReadingOptions(smpl_model=model.save(tmp_path / "model.npz"))
    clip = bs.read(file, options)
    assert isinstance(clip, Clip)
    _, joints = model.posed(betas, poses, trans)
    ours = np.asarray(forward_kinematics(clip.pose)[0])[:, :22]
    assert np.abs(ours - joints[:, :22] @ TO_Y_UP.T).max() < 1e-3
    assert np.abs(lowest_soles(clip.pose)).max() < 0.015
    kept = bs.read(file, ReadingOptions(smpl_model=options.smpl_model, floor=0.0))
    assert isinstance(kept, Clip)
    np.testing.assert_allclose(kept.pose.root_position[:, 1] - clip.pose.root_position[:, 1], floor, atol=2e-3)


@pytest.mark.parametrize(("height", "floor", "body"), [(*PEOPLE[0], 0), (*PEOPLE[1], 3), (*PEOPLE[0], 7)])
def test_bodies_without_a_model_are_as_tall_as_their_steps_show(
    tmp_path: Path, height: float, floor: float, body: int
) -> None:
    model = made_up_model(body)
    betas = betas_of(model, height)
    poses, trans = walk(model, betas)
    opened = open_source(save_walk(tmp_path / "walk.npz", poses, trans, betas, floor))
    soles = lowest_soles(opened.clip.pose)  # type: ignore[union-attr]
    assert np.abs(soles).max() < 0.015
    joints = model.shaped(betas)[1]
    legs = np.linalg.norm(joints[4] - joints[1]) + np.linalg.norm(joints[7] - joints[4])
    ours = opened.clip.pose.skeleton.bone_length[[4, 7]].sum()  # type: ignore[union-attr]
    assert ours == pytest.approx(legs, rel=0.03)
    assert "m tall by its steps" in opened.remarks[0] and "moved to 0" in opened.remarks[0]  # type: ignore[union-attr]


def test_a_body_that_stands_still_keeps_the_default_height(tmp_path: Path) -> None:
    model = made_up_model()
    poses, trans = walk(model, np.zeros(2), seconds=2.0)
    poses[:] = poses[0]
    path = save_walk(tmp_path / "still.npz", poses, 0 * trans, np.zeros(2), 1.2)
    clip, found = read_with_placement(path)
    assert found.source == "default" and "too few steps" in found.remark
    assert clip.pose.skeleton.height == pytest.approx(SKELETON.height)
    assert np.abs(lowest_soles(clip.pose)).max() < 1e-6


@pytest.mark.parametrize("floor", [-0.05, 0.0, 0.04])
@pytest.mark.parametrize("turn", [0.3, 0.7])
def test_the_floor_is_where_feet_stand_however_deep_toes_go(floor: float, turn: float) -> None:
    """Feet without a toe joint go through the floor at the end of a step: here in a third of the frames."""
    clip = _on_toes(floor, turn)
    assert np.percentile(lowest_soles(clip.pose), 5) < floor - 0.02
    assert standing_floor(clip) == pytest.approx(floor, abs=2e-3)
    assert placement_of(footing_of(clip), has_bones=True).floor == pytest.approx(floor, abs=2e-3)


def test_a_box_and_a_flight_are_no_floor() -> None:
    on_box = _on_toes(0.3, 0.3)
    assert standing_floor(on_box) == 0.0
    flying = replace(on_box, pose=replace(on_box.pose, root_position=0.9 + _rising(len(on_box))))
    assert standing_floor(flying) == 0.0


def test_a_climber_starts_on_the_floor() -> None:
    """A third of the time on the floor and the rest on a step of 12 cm: the floor is the lower one."""
    clip = _on_toes(0.02, 0.3)
    root = clip.pose.root_position.copy()
    root[len(root) // 3 :, 1] += 0.12
    assert standing_floor(replace(clip, pose=replace(clip.pose, root_position=root))) == pytest.approx(0.02, abs=2e-3)


@pytest.mark.parametrize("floor", [None, 0.0, 0.01])
def test_files_of_a_known_skeleton_get_their_floor_too(tmp_path: Path, floor: float | None) -> None:
    model = made_up_model()
    poses, trans = walk(model, np.zeros(2), seconds=2.0)
    poses[:] = poses[0]
    path = save_walk(tmp_path / "still.npz", poses, 0 * trans, np.zeros(2), 0.0)
    known = Source(path, "somebody", "test", skeleton=SKELETON)
    before = read_source(known, ReadingOptions(floor=0.0))
    over = float(lowest_soles(before.pose)[0])
    lifted = save_walk(tmp_path / "lifted.npz", poses, 0 * trans + [0, 0, 0.03 - over], np.zeros(2), 0.0)
    clip = read_source(replace(known, path=lifted), ReadingOptions(floor=floor))
    np.testing.assert_allclose(lowest_soles(clip.pose), 0.0 if floor is None else 0.03 - floor, atol=1e-4)


def test_recorded_feet_stand_on_the_floor(motion_data: Path) -> None:
    """CMU's motions were placed by their deepest toes, so that feet stood 2 to 5 cm over the floor."""
    heights = []
    for clip in open_clips(motion_data / "cmu", "train", at_most=40):
        footing = footing_of(clip)
        heights.append((footing.pelvis + footing.sole)[footing.stands])
    assert abs(np.median(np.concatenate(heights))) < 0.01


def _on_toes(floor: float, turn: float) -> Clip:
    """A body that stands flat on a floor, and in every third second turns its feet about their ankles by `turn`."""
    frames = 180
    skeleton = default_skeleton()
    rotation = np.zeros((frames, len(skeleton.joints), 4))
    rotation[..., 0] = 1.0
    down = np.arange(frames) // 30 % 3 == 2
    for side in ("left", "right"):
        rotation[down, skeleton.index(f"{side}_ankle")] = [np.cos(turn / 2), np.sin(turn / 2), 0.0, 0.0]
    root = np.tile([0.1, skeleton.rest_offset[0, 1] + floor, 0.2], (frames, 1))
    return Clip("on_toes", Pose(skeleton, root, rotation), 30.0)


def _rising(frames: int) -> np.ndarray:
    """A path (T, 3) upward at 1 m/s."""
    return np.arange(frames)[:, None] / 30.0 * [0.0, 1.0, 0.0]


def test_motions_of_a_person_are_pooled(tmp_path: Path) -> None:
    """A motion without steps takes size and floor from the others: on a box, soles stay over the floor."""
    model = made_up_model(1)
    betas = betas_of(model, 1.9)
    poses, trans = walk(model, betas, seconds=4.0)
    steps = save_walk(tmp_path / "steps.npz", poses, trans, betas)
    box = save_walk(tmp_path / "box.npz", poses[:40], trans[:1].repeat(40, axis=0), betas, 0.3)
    together = placement_of(pool_footings([footing_of(_bare(steps)), footing_of(_bare(box))]), has_bones=False)
    clip, used = read_with_placement(box, known=together)
    assert used == together and together.source == "steps"
    assert lowest_soles(clip.pose)[0] == pytest.approx(0.3, abs=0.03)
    assert stature(clip.pose.skeleton.rest_offset) == pytest.approx(1.9, abs=0.1)


def _bare(path: Path) -> Clip:
    from bodysense.io.formats.amass import read_amass

    return read_amass(path)


def test_lines_name_a_few_people_and_count_many() -> None:
    few = {"anna": BodyPlacement(1.62, 0.93, "steps", 0.08), "ben": BodyPlacement(1.74, 1.0, "default", 0.0)}
    assert body_lines(few)[0].startswith("anna: 1.62 m tall by its steps") and "soles at 0.08 m" in body_lines(few)[0]
    assert "ben: too few steps" in body_lines(few)[1] and "soles at 0" in body_lines(few)[1]
    many = {f"p{k}": BodyPlacement(1.5 + k / 100, 1.0, "steps", -0.01 * k) for k in range(20)}
    assert [line.split(" with ")[0] for line in body_lines(many)] == [
        "20 people",
        "soles of 19 people at -0.19 to -0.01 m: moved to 0",
    ]
    assert "1.50 to 1.69 m" in body_lines(many)[0]


def test_models_are_for_amass_and_smpl_files(tmp_path: Path, make_clip) -> None:
    model = made_up_model()
    path = model.save(tmp_path / "model.npz")
    bs.write(tmp_path / "walk.bvh", make_clip())
    with pytest.raises(BodysenseError, match=r"walk.bvh: --smpl-model is for AMASS and SMPL files"):
        bs.read(tmp_path / "walk.bvh", ReadingOptions(smpl_model=path))
    poses, trans = walk(model, np.zeros(2), seconds=1.0)
    np.savez(tmp_path / "bare.npz", poses=poses, trans=trans, mocap_framerate=120.0)
    with pytest.raises(BodysenseError, match=r"no 'betas' in it; it is needed"):
        bs.read(tmp_path / "bare.npz", ReadingOptions(smpl_model=path))


def test_results_of_video_tools_get_their_bones_too(tmp_path: Path) -> None:
    model = made_up_model(5)
    betas = betas_of(model, 1.9)
    poses, trans = walk(model, betas, seconds=2.0)
    _, joints = model.posed(betas, poses, trans)
    frames = np.tile(betas, (len(poses), 1)) + np.linspace(-0.01, 0.01, len(poses))[:, None]
    np.savez(tmp_path / "video.npz", poses=poses[:, :66], trans=trans, betas=frames, fps=120.0)
    options = ReadingOptions(smpl_model=model.save(tmp_path / "model.npz"))
    opened = open_source(tmp_path / "video.npz", options)
    ours = np.asarray(forward_kinematics(opened.clip.pose)[0])[:, :22]  # type: ignore[union-attr]
    assert np.abs(ours - joints[:, :22] @ TO_Y_UP.T).max() < 1e-3
    assert any("bones by the body model" in line for line in opened.remarks)  # type: ignore[union-attr]
