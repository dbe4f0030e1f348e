from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.keypoints import Camera
from bodysense.body.pose import rest_pose
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense_lab.papers.pahmt.camera_view import view, view_points
from bodysense_lab.rendering.character import FIGURES, load_figure
from bodysense_lab.rendering.renderer import Renderer, open_renderer
from bodysense_lab.rendering.scene import Scene, move_camera, sample_camera, sample_scene
from bodysense_lab.rendering.take import RATE, list_takes, plan_takes, read_take, render_take, write_take

HEIGHT = 120  # pixels


def scene_of_a_man() -> Scene:
    return replace(sample_scene(np.random.default_rng(3), "man"), noise=0.0)


def camera_before_a_man() -> Camera:
    return sample_camera(rest_pose(load_figure("man").skeleton, (1,)), np.random.default_rng(3))


@pytest.fixture
def stage() -> Iterator[Renderer]:
    pytest.importorskip("moderngl")
    try:
        with open_renderer(scene_of_a_man(), camera_before_a_man(), HEIGHT, np.zeros(3)) as opened:
            yield opened
    except BodysenseError as error:
        pytest.skip(str(error))


def test_scenes_differ_and_are_reproducible() -> None:
    scenes = [sample_scene(np.random.default_rng(seed)) for seed in (1, 1, 2)]
    assert repr(scenes[0]) == repr(scenes[1]) != repr(scenes[2])
    for seed in range(50):
        scene = sample_scene(np.random.default_rng(seed))
        assert scene.figure in FIGURES
        for color in (scene.skin, scene.hair, scene.wall, scene.floor, scene.clothes.shirt):
            assert all(0 <= value <= 1 for value in color)
        for lamp in scene.lamps:
            assert np.linalg.norm(lamp.toward) == pytest.approx(1)
            assert lamp.toward[1] > 0, "lamps hang above"


def test_takes_do_not_overlap_and_show_both_arms(waving_clip: Clip) -> None:
    planned = plan_takes(waving_clip, 5, 1.0, np.random.default_rng(0))
    assert 1 <= len(planned) <= 3
    assert len({take.name for take, _ in planned}) == len(planned)
    assert [take.figure for take, _ in planned] == list(FIGURES[: len(planned)])
    for take, scene in planned:
        assert len(take.time) == round(RATE) and take.figure == scene.figure
        assert take.pose.skeleton.height == load_figure(scene.figure).skeleton.height
        assert view(view_points(take.pose), take.time, take.camera).has_arm.mean(axis=0).min() >= 0.9


def test_still_motion_and_motion_without_fingers_are_not_rendered(waving_clip: Clip) -> None:
    still = replace(waving_clip, pose=waving_clip.pose[np.zeros(60, dtype=int)])
    assert not plan_takes(still, 3, 1.0, np.random.default_rng(0))
    with pytest.raises(BodysenseError, match="no finger motion"):
        plan_takes(replace(waving_clip, has_fingers=False), 3, 1.0, np.random.default_rng(0))


def test_the_truth_is_read_back(waving_clip: Clip, tmp_path: Path) -> None:
    take = replace(plan_takes(waving_clip, 1, 1.0, np.random.default_rng(0))[0][0], category="sit")
    write_take(tmp_path / "take.npz", take)
    read = read_take(tmp_path / "take.npz")
    assert (read.name, read.figure, read.category) == (take.name, take.figure, "sit")
    assert np.allclose(read.pose.rotation, take.pose.rotation, atol=1e-6)
    assert np.allclose(read.pose.root_position, take.pose.root_position, atol=1e-6)
    assert np.array_equal(read.pose.skeleton.rest_offset, take.pose.skeleton.rest_offset)
    for ours, true in zip(vars(read.camera).values(), vars(take.camera).values(), strict=True):
        assert np.array_equal(ours, true)


def test_the_path_of_a_camera_is_read_back(waving_clip: Clip, tmp_path: Path) -> None:
    take = plan_takes(waving_clip, 1, 1.0, np.random.default_rng(0))[0][0]
    there = replace(take.camera, position=take.camera.position + np.array([1.0, 0.0, 0.0]))
    take = replace(take, camera=move_camera(take.camera, there, len(take.time)))
    write_take(tmp_path / "take.npz", take)
    read = read_take(tmp_path / "take.npz")
    assert read.moves and np.array_equal(read.camera.position, take.camera.position)
    np.testing.assert_allclose(read.camera_at(0).position, take.camera.position[0])
    np.testing.assert_allclose(read.camera_at(-1).position, there.position)
    np.testing.assert_allclose(read.camera_at(-1).axes, there.axes, atol=1e-6)


def test_other_files_are_refused_as_truth(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("no")
    np.savez(tmp_path / "other.npz", format="bodysense take 0")
    with pytest.raises(BodysenseError, match="not the truth of a rendered video"):
        read_take(tmp_path / "text.npz")
    with pytest.raises(BodysenseError, match="its format is bodysense take 0"):
        read_take(tmp_path / "other.npz")
    with pytest.raises(BodysenseError, match="no rendered videos in it"):
        list_takes(tmp_path)


def test_a_body_is_drawn_where_the_camera_sees_its_joints(stage: Renderer) -> None:
    """The pixels that change when the body leaves the room are those of the body and its shadow."""
    figure, camera = stage.figure, camera_before_a_man()
    there = rest_pose(figure.skeleton)
    gone = replace(there, root_position=there.root_position + np.array([0.0, 100.0, 0.0]))
    picture, empty = stage.draw(there).astype(int), stage.draw(gone).astype(int)
    assert picture.shape == (HEIGHT, stage.size[0], 3)
    changed = np.abs(picture - empty).max(axis=-1) > 12
    local = (figure.rest - camera.position) @ camera.axes
    place = HEIGHT * (float(camera.focal) * local[:, :2] / -local[:, 2:] * [1, -1] + [float(camera.aspect) / 2, 0.5])
    column, row = np.round(place - 0.5).astype(int).T
    inside = (column >= 0) & (column < stage.size[0]) & (row >= 0) & (row < HEIGHT)
    names = [f"{side}_{name}" for side in ("left", "right") for name in ("shoulder", "elbow", "hip", "knee")]
    visible = [k for k in figure.skeleton.indices(["spine2", "head", *names]) if inside[k]]
    assert len(visible) >= 5
    assert changed[row[visible], column[visible]].all()
    assert 0.02 < changed.mean() < 0.6


def test_a_moved_camera_draws_like_a_new_camera_there(stage: Renderer) -> None:
    there, pose = camera_before_a_man(), rest_pose(load_figure("man").skeleton)
    begin = stage.draw(pose).astype(int)
    stage.point(replace(there, position=there.position + np.array([0.3, 0.1, 0.0])))
    drawn_after_move = stage.draw(pose).astype(int)
    stage.point(there)
    assert np.abs(drawn_after_move - begin).mean() > 4.0
    assert np.abs(stage.draw(pose).astype(int) - begin).max() <= 1


def test_skin_is_visible_where_clothes_end(stage: Renderer) -> None:
    """The hands have the colour order of skin, red above green above blue, in any light."""
    red, green, blue = (stage.draw(rest_pose(stage.figure.skeleton))[..., k].astype(int) for k in range(3))
    assert ((red > green + 8) & (green > blue)).sum() > 50


def test_a_video_contains_the_drawn_pictures(waving_clip: Clip, tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    pytest.importorskip("moderngl")
    take, scene = plan_takes(waving_clip, 1, 1.0, np.random.default_rng(0))[0]
    take = replace(take, pose=take.pose[:6], time=take.time[:6])
    drawn: list[None] = []
    try:
        path = render_take(take, scene, tmp_path, HEIGHT, lambda: drawn.append(None))
    except BodysenseError as error:
        pytest.skip(str(error))
    assert list_takes(tmp_path) == [path.with_suffix(".npz")] and len(drawn) == 6
    with av.open(str(path)) as container:
        frames = list(container.decode(video=0))
    assert [frame.time for frame in frames] == pytest.approx(take.time.tolist())
    with open_renderer(scene, take.camera, HEIGHT, np.median(take.pose.root_position, axis=0)) as stage:
        first = stage.draw(take.pose[0]).astype(int)
    assert np.abs(frames[0].to_ndarray(format="rgb24").astype(int) - first).mean() < 6  # of 255; H.264 loses a little
