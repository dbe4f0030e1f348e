"""Folders of motion: the described layout, other layouts, and errors for empty folders."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.datasets.sources import Source, list_sources, read_source, skeleton_from_entry
from bodysense.io.datasets.splits import SPLITS, split_of
from bodysense.io.formats.bvh import write_bvh
from bodysense_lab.data.clips import open_clips


def save_amass(path: Path, frames: int = 5, seed: int = 0) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    np.savez(path, poses=rng.normal(size=(frames, 156)), trans=rng.normal(size=(frames, 3)), mocap_framerate=24.0)
    return path


def save_bvh(path: Path, clip) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bvh(path, clip)
    return path


@pytest.fixture
def described(tmp_path: Path, make_clip) -> Path:
    """A folder with splits.json, categories.csv and skeletons.json."""
    save_amass(tmp_path / "cmu" / "01" / "01_01.npz")
    save_amass(tmp_path / "cmu" / "02" / "02_01.npz")
    save_amass(tmp_path / "cmu" / "99" / "99_01.npz")  # in no split
    save_bvh(tmp_path / "rocketbox" / "f_wave.bvh", make_clip())
    ours = default_skeleton()
    rows = {
        name: {"parent": None if p < 0 else ours.joints[p], "offset": list(1.1 * ours.rest_offset[k])}
        for k, (name, p) in enumerate(zip(ours.points, ours.parents, strict=True))
        if k < 22
    }
    sites = {
        "head_top": {"parent": "head", "offset": [0, 0.3, 0]},
        "left_middle_knuckle": {"parent": "left_wrist", "offset": [0.09, 0, 0]},
        "left_thumb_base": {"parent": "left_wrist", "offset": [0.02, 0, 0.02]},
    }
    entry = {"pelvis_height": 1.05, "joints": rows, "end_sites": sites}
    (tmp_path / "skeletons.json").write_text(json.dumps({"cmu": entry}))
    splits = {
        "cmu": {"train": ["01"], "val": [], "test": ["02"]},
        "rocketbox": {"train": [], "val": ["f_wave"], "test": []},
    }
    (tmp_path / "splits.json").write_text(json.dumps(splits))
    (tmp_path / "categories.csv").write_text(
        "clip,source,category\n01_01,cmu,sit\n02_01,cmu,sport\nf_wave,rocketbox,sit\n"
    )
    return tmp_path


def test_the_folder_of_one_set_is_described_too(described: Path) -> None:
    """People, splits, categories and bodies come from the description in the folder above."""
    whole = [source for source in list_sources(described) if source.path.parent.parent.name == "cmu"]
    part = list_sources(described / "cmu")
    assert [source.path for source in part] == [source.path for source in whole]
    for ours, theirs in zip(part, whole, strict=True):
        assert (ours.person, ours.split, ours.category) == (theirs.person, theirs.split, theirs.category)
        assert ours.skeleton is not None and theirs.skeleton is not None
        np.testing.assert_array_equal(ours.skeleton.rest_offset, theirs.skeleton.rest_offset)
    (described / "other").mkdir()
    (described / "other" / "x_1.npz").write_bytes((described / "cmu" / "01" / "01_01.npz").read_bytes())
    assert list_sources(described / "other")[0].person == "x", "not a set of the description"


def test_a_described_folder(described: Path) -> None:
    clips = list(open_clips(described))
    assert [(c.name, c.person, c.category, c.frame_rate) for c in clips] == [
        ("01_01", "cmu_01", "sit", 24.0),
        ("02_01", "cmu_02", "sport", 24.0),
        ("f_wave", "rocketbox_f", "sit", 30.0),
    ]
    assert all(clip.pose.skeleton.joints == default_skeleton().joints for clip in clips)
    assert [c.name for c in open_clips(described, "train")] == ["01_01"]
    assert [c.name for c in open_clips(described, categories=["sit"])] == ["01_01", "f_wave"]
    assert [c.name for c in open_clips(described, "test", {"sport"})] == ["02_01"]


def test_the_described_skeleton_is_used_and_completed(described: Path) -> None:
    skeleton = next(open_clips(described)).pose.skeleton
    ours, index = default_skeleton(), default_skeleton().index
    np.testing.assert_allclose(skeleton.rest_offset[1:22], 1.1 * ours.rest_offset[1:22])
    np.testing.assert_allclose(skeleton.rest_offset[0], [0, 1.05, 0])
    np.testing.assert_allclose(skeleton.rest_offset[index("head_top")], [0, 0.3, 0])
    np.testing.assert_allclose(skeleton.rest_offset[index("left_middle1")], [0.09, 0, 0])
    hand = 0.09 / ours.rest_offset[index("left_middle1"), 0]
    np.testing.assert_allclose(
        skeleton.rest_offset[index("left_pinky2")], hand * ours.rest_offset[index("left_pinky2")]
    )


def test_any_other_folder_is_split_by_person(tmp_path: Path, make_clip) -> None:
    people = [f"p{k:02}" for k in range(40)]
    for person in people:
        save_amass(tmp_path / person / "session" / "a.npz", frames=1)
        save_amass(tmp_path / person / "b.npz", frames=1)
    save_bvh(tmp_path / "anna_walks.bvh", make_clip(frames=2))
    save_amass(tmp_path / "walk1_subject5.npz", frames=1)
    sources = list_sources(tmp_path)
    assert len(sources) == 82 and {s.person for s in sources} == {*people, "anna", "subject5"}
    split = {person: {s.split for s in sources if s.person == person} for person in people}
    assert all(len(found) == 1 for found in split.values())
    found = [clip.person for which in SPLITS for clip in open_clips(tmp_path, which)]
    assert sorted(found) == sorted(s.person for s in sources)


def test_splits_are_stable_and_have_the_documented_shares() -> None:
    assert (split_of("anna"), split_of("")) == ("train", "val")  # fixed for ever: a change would leak people
    share = [sum(split_of(str(k)) == which for k in range(3000)) / 3000 for which in SPLITS]
    np.testing.assert_allclose(share, [0.8, 0.1, 0.1], atol=0.02)


def test_a_folder_without_motion_is_refused(tmp_path: Path, described: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(BodysenseError, match=r"empty: no .bvh or .npz file in it; give a folder of motion files"):
        open_clips(tmp_path / "empty")
    with pytest.raises(BodysenseError, match=r"none: no such folder"):
        open_clips(tmp_path / "none")
    with pytest.raises(
        BodysenseError, match=r"none of its 3 clips is in split 'val' and in sport; its categories are sit, sport"
    ):
        open_clips(described, "val", ["sport"])
    with pytest.raises(BodysenseError, match=r"unknown split 'dev'; valid are train, val, test and all"):
        open_clips(described, "dev")  # type: ignore[arg-type]


def test_files_without_motion_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.dae").write_text("x")
    (tmp_path / "b.bvh").write_text("")
    (tmp_path / "c.npz").write_text("not a zip file")
    for name, message in (
        ("a.dae", "unknown kind of file '.dae'; valid are .bvh, .npz"),
        ("b.bvh", "the file is empty"),
        ("c.npz", "cannot be read as an .npz file"),
        ("d.bvh", "cannot be read .No such file"),
    ):
        with pytest.raises(BodysenseError, match=message) as error:
            read_source(Source(tmp_path / name, person="", split="test"))
        assert name in str(error.value)


@pytest.mark.parametrize("name", ["splits.json", "categories.csv", "skeletons.json"])
def test_a_description_that_is_damaged(described: Path, name: str) -> None:
    (described / name).write_text('{"cmu": [1')
    with pytest.raises(BodysenseError, match=r"splits.json, categories.csv and skeletons.json do not fit together"):
        open_clips(described)


def test_the_real_folder(motion_data: Path) -> None:
    sources = list_sources(motion_data)
    people = {which: {s.person for s in sources if s.split == which} for which in SPLITS}
    assert not {p for p in people["train"] if p.startswith("cmu")} & (people["val"] | people["test"])
    assert {s.category for s in sources} == {"sit", "talk_gesture", "everyday", "locomotion", "sport", "dance", "other"}
    clip = next(open_clips(motion_data, "val", ["locomotion"]))
    assert clip.category == "locomotion" and 1.6 < clip.pose.skeleton.height < 1.9
    entry = json.loads((motion_data / "skeletons.json").read_text())["cmu"]
    assert skeleton_from_entry(entry).height == pytest.approx(entry["total_height"], abs=0.02)


def test_errors_of_a_folder_name_the_file(tmp_path: Path, small_bvh_text: str) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "box.bvh").write_text(small_bvh_text)
    with pytest.raises(BodysenseError, match=r"a/box.bvh: not a humanoid: two legs and two arms were not found"):
        next(open_clips(tmp_path))


def test_in_a_tree_of_amass_people_are_those_of_its_sets(tmp_path: Path) -> None:
    for place in ("CMU/01/01_01_poses.npz", "CMU/02/02_01_poses.npz", "KIT/3/walk_poses.npz", "mine/a/b.npz"):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_bytes(b"not read")
    people = [source.person for source in list_sources(tmp_path)]
    assert people == ["CMU_01", "CMU_02", "KIT_3", "mine"]
