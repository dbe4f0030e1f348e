"""Building a study: conditions, scenes, and served files."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bodysense.body.pose import forward_kinematics
from bodysense.devices.simulated.sensors import HEADSET_CAMERA, observe
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.pictures.camera import Lens
from bodysense_lab.study.scenes import StudySettings, build_study, complete_clip, cut_scenes
from bodysense_lab.study.study import read_key

TINY = Lens(width=24, height=30)


@pytest.fixture(scope="module")
def settings(small_network: Path) -> StudySettings:
    return StudySettings(longest=0.7, scenes=2, model=small_network, lens=TINY)


@pytest.fixture(scope="module")
def clip(waving_clip: Clip) -> Clip:
    return replace(waving_clip, pose=waving_clip.pose[:60])


def test_conditions_are_truth_and_two_completions(clip: Clip, settings: StudySettings) -> None:
    motion = complete_clip(clip, settings)
    position = {name: np.asarray(forward_kinematics(pose)[0]) for name, pose in motion.pose.items()}
    truth, skeleton = np.asarray(forward_kinematics(clip.pose)[0]), clip.pose.skeleton
    np.testing.assert_array_equal(position["truth"], truth)
    assert motion.error["truth"] == 0 and min(motion.error["ours"], motion.error["baseline"]) > 0
    for name in ("ours", "baseline"):
        bones = np.linalg.norm(position[name][:, 1:] - position[name][:, list(skeleton.parents[1:])], axis=-1)
        np.testing.assert_allclose(bones, np.tile(skeleton.bone_length[1:], (60, 1)), atol=1e-6)
        # All methods track the head equally, so that it does not reveal the method.
        head = skeleton.index("head")
        assert np.linalg.norm(position[name][:, head] - truth[:, head], axis=-1).max() < 0.15
    seen = observe(clip.pose, clip.time, HEADSET_CAMERA).has_position
    left = skeleton.index("left_wrist")
    assert not seen[:, left].all() and seen[:, left].any()
    assert motion.hidden.shape == (60, 14)


def test_scenes_are_pieces_of_the_completed_clip(clip: Clip, settings: StudySettings) -> None:
    """Scenes have equal lengths, and the tracker has run through the whole clip."""
    whole = complete_clip(clip, settings)
    scenes = cut_scenes(whole, 0.7)
    assert [(scene.name, len(scene.hidden)) for scene in scenes] == [(f"waving-{k}", 20) for k in (1, 2, 3)]
    for name, pose in whole.pose.items():
        joined = np.concatenate([scene.pose[name].rotation for scene in scenes])
        np.testing.assert_array_equal(joined, pose.rotation)
    (one,) = cut_scenes(whole, 2.0)
    assert one is whole
    with pytest.raises(BodysenseError, match=r"waving-1: 0\.33 s cannot be judged"):
        cut_scenes(replace(scenes[0], hidden=scenes[0].hidden[:10]), 6.0)


@pytest.mark.slow
def test_served_files_do_not_reveal_the_key(tmp_path: Path, clip: Clip, settings: StudySettings) -> None:
    steps: list[tuple[int, int]] = []
    out = tmp_path / "study"
    key, scenes = build_study(
        out, [clip], settings, np.random.default_rng(0), 1, lambda done, of: steps.append((done, of))
    )
    assert steps == [(k, 6) for k in range(7)]
    assert read_key(out / "key.json") == key
    assert [scene.name for scene in scenes] == [scene.name for scene in key.scenes] and len(scenes) == 2
    served = sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file())
    clips = sorted(f"site/clips/{clip}.webp" for clip in key.scene_of)
    assert served == ["key.json", *clips, "site/index.html", "site/study.js", "site/style.css"]
    for scene, motion in zip(key.scenes, scenes, strict=True):
        paths = [out / "site" / "clips" / f"{clip}.webp" for clip in scene.ring]
        assert len({hashlib.sha256(path.read_bytes()).digest() for path in paths}) == 3
        for path in paths:
            with Image.open(path) as image:
                assert image.size == (24, 30) and 0 < getattr(image, "n_frames", 1) <= len(motion.hidden)
    text = (out / "site" / "index.html").read_text()
    assert key.study in text and not any(word in text for word in ("truth", "baseline", "waving"))
    assert [path.name for path in tmp_path.iterdir()] == ["study"]

    with pytest.raises(BodysenseError, match="study exists; name a new folder, so that no study loses its"):
        build_study(out, [clip], settings, np.random.default_rng(0), 1, lambda *_: None)


def test_a_failed_study_leaves_no_files(tmp_path: Path, clip: Clip, settings: StudySettings) -> None:
    def stop(done: int, of: int) -> None:
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build_study(tmp_path / "s", [clip], settings, np.random.default_rng(0), 1, stop)
    with pytest.raises(BodysenseError, match="two clips are called 'waving'; rename one"):
        build_study(tmp_path / "s", [clip, clip], settings, np.random.default_rng(0), 1, stop)
    assert not list(tmp_path.iterdir())
