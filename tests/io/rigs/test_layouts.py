"""Published data sets in their layouts: read by one command, or refused in one line."""

from __future__ import annotations

import re
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense.io.datasets.layouts import LAYOUTS, layout_of
from bodysense.io.datasets.sources import list_sources, read_source
from bodysense.io.datasets.splits import split_of
from bodysense.io.formats.archive import motion_files
from bodysense.sources.reading import read
from bodysense_lab.data.clips import open_clips

MILLIMETRE = 1e-3


def furthest(clip: Clip, truth: Clip, leaving_out: tuple[str, ...] = ()) -> float:
    """Return the largest distance between points of a clip and the written motion."""
    points = [k for k, name in enumerate(default_skeleton().points) if not name.endswith(leaving_out or ("-",))]
    there, here = (forward_kinematics(which.pose)[0][:, points] for which in (truth, clip))
    return float(np.linalg.norm(here - there, axis=-1).max())


def test_unoc(unoc) -> None:
    assert layout_of(unoc.folder, motion_files(unoc.folder)) == "unoc"
    sources = list_sources(unoc.folder)
    assert {source.key(unoc.folder) for source in sources} == set(unoc.truth), "body motion and nothing else"
    for source in sources[::3]:
        clip, truth = read_source(source), unoc.truth[source.key(unoc.folder)]
        assert furthest(clip, truth) < MILLIMETRE
        assert geodesic_angle(clip.pose.rotation, truth.pose.rotation).max() < 1e-3
        assert (clip.frame_rate, clip.has_fingers, len(clip)) == (120.0, True, len(truth))
        assert clip.person == source.key(unoc.folder).partition("/")[0]


def test_the_last_two_participants_of_a_whole_unoc_are_its_test_set(unoc) -> None:
    split = {source.person: source.split for source in list_sources(unoc.folder)}
    assert [person for person in split if split[person] == "test"] == ["P12", "P13"], "P2 comes before P10"
    assert [person for person in split if split[person] == "val"] == ["P11"]
    (unoc.folder / "P3").rename(unoc.folder.parent / "P3")
    assert all(source.split == split_of(source.person) for source in list_sources(unoc.folder)), "a part: by name"
    own = list_sources(unoc.folder.parent / "P3")  # a participant's own folder
    assert [(source.person, source.split) for source in own] == [("P3", split_of("P3"))]


def test_talking_with_hands_in_zip_files(talking_with_hands) -> None:
    release = talking_with_hands
    assert layout_of(release.folder, motion_files(release.folder)) == "twh"
    before = sorted(release.folder.rglob("*"))
    sources = list_sources(release.folder)
    assert {source.key(release.folder) for source in sources} == set(release.truth)
    assert [(s.person, s.category) for s in sources] == [
        ("deep5", "other"),
        ("shallow26", "other"),
        ("deep5", "conversation"),
        ("shallow27", "conversation"),
    ]
    assert all(s.split == split_of(s.person) for s in sources), "a speaker of several sessions is in one split"
    clips = list(open_clips(release.folder))
    assert sorted(release.folder.rglob("*")) == before, "nothing is unpacked"
    for source, clip in zip(sources, clips, strict=True):
        truth = release.truth[source.key(release.folder)]
        assert furthest(clip, truth, ("_foot", "_toe")) < MILLIMETRE  # the set has no toes
        assert (clip.frame_rate, clip.has_fingers, len(clip)) == (90.0, True, len(truth))
    assert [clip.person for clip in open_clips(release.folder, categories=["conversation"])] == ["deep5", "shallow27"]


def test_the_motion_replaces_an_unusable_rest_pose(talking_with_hands) -> None:
    """Frames of the rig are random, so twists are only as accurate as the person stands straight."""
    names = default_skeleton().joints
    for source in list_sources(talking_with_hands.folder):
        clip, truth = read_source(source), talking_with_hands.truth[source.key(talking_with_hands.folder)]
        there, here = (forward_kinematics(which.pose)[1] for which in (truth, clip))
        off = np.rad2deg(geodesic_angle(there, here).max(axis=0))
        off = {name: off[k] for k, name in enumerate(names) if not name.endswith("_foot")}
        assert max(off["pelvis"], off["head"]) < 8, "the head by its eyes, in the hips' direction"
        assert max(off.values()) < 35
        assert np.median(list(off.values())) < 12


def test_mixamo(mixamo) -> None:
    assert layout_of(mixamo.folder, motion_files(mixamo.folder)) == "mixamo"
    sources = list_sources(mixamo.folder)
    people = {source.key(mixamo.folder): source.person for source in sources}
    assert people.pop("Jump/Jump.bvh") == "Jump"
    assert set(people.values()) == {"Walking"}, "a motion is in one split, whoever performs it"
    for source in sources:
        clip, truth = read_source(source), mixamo.truth[source.key(mixamo.folder)]
        assert furthest(clip, truth) < MILLIMETRE
        assert geodesic_angle(clip.pose.rotation, truth.pose.rotation).max() < 1e-3
        assert (clip.frame_rate, clip.has_fingers) == (30.0, True)


def test_an_ambiguous_layout_must_be_given(mixamo, unoc) -> None:
    for path in mixamo.folder.rglob("*.bvh"):
        path.write_text(path.read_text().replace("mixamorig:", ""))
    assert {source.person for source in list_sources(mixamo.folder)} == {"Jump", "Walking", "Walking (1)", "more"}
    assert {source.person for source in list_sources(mixamo.folder, "mixamo")} == {"Jump", "Walking"}
    assert len(list_sources(unoc.folder, "folder")) == len(unoc.truth) + 2


@pytest.mark.parametrize(("layout", "message"), [
    ("unoc", r"Mixamo: not laid out as UNOC's release: there is no folder 'merged bvh' in it; give the folder"),
    ("twh", r"Mixamo: not laid out as Talking With Hands: no file names a speaker, as .*; give its folder mocap_data"),
    ("fbx", r"unknown layout 'fbx'; valid are unoc, twh, mixamo, folder"),
])  # fmt: skip
def test_a_folder_of_another_layout(mixamo, layout, message: str) -> None:
    with pytest.raises(BodysenseError, match=message) as error:
        list_sources(mixamo.folder, layout)
    assert "\n" not in str(error.value)
    assert len(LAYOUTS) == 4


def test_a_store_of_zip_files_is_that_of_the_same_files_unpacked(talking_with_hands, tmp_path: Path) -> None:
    pytest.importorskip("zarr", reason="needs packages/lab")
    from bodysense_lab.data.preparation import prepare

    folder = talking_with_hands.folder
    zipped = prepare(folder, tmp_path / "zipped.zarr", rate=30.0, workers=1)
    for path in (folder / "mocap_data").rglob("*.zip"):  # as the set's README does it
        with zipfile.ZipFile(path) as archive:
            archive.extractall(path.with_suffix(""))
    both = list_sources(folder)
    assert [source.member for source in both] == [""] * len(zipped.table.clips), "the unpacked copy is read, once"
    unpacked = prepare(folder, tmp_path / "unpacked.zarr", rate=30.0, workers=1)
    for one, other in zip(zipped.table.clips, unpacked.table.clips, strict=True):
        assert one.sha256 == other.sha256 and one.source.replace(".zip", "") == other.source
        assert (one.person, one.split, one.category) == (other.person, other.split, other.category)
    np.testing.assert_array_equal(zipped.rotation[:], unpacked.rotation[:])
    assert zipped.table.rate == 30.0 and all(row.has_fingers for row in zipped.table.clips)


# --- zip files ---


def zipped(path: Path, **members: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in members.items():
            archive.writestr(name.replace("__", "/") + ".bvh", text)
    return path


def test_people_in_a_zip_file(tmp_path: Path) -> None:
    zipped(tmp_path / "anna.zip", a="", b="")
    zipped(tmp_path / "all.zip", ben__a="", carl__deeper__a="")
    zipped(tmp_path / "dora" / "takes.zip", a="")
    assert sorted(source.person for source in list_sources(tmp_path)) == ["anna", "anna", "ben", "carl", "dora"]


def damaged(path: Path) -> None:
    """Turn over a byte in the middle of the only member's compressed bytes."""
    data = bytearray(path.read_bytes())
    data[200] ^= 0xFF
    path.write_bytes(data)


BAD = {
    "text": (lambda path: path.write_text("version https://git-lfs.github.com/spec/v1"), "File is not a zip file"),
    "nothing": (lambda path: path.write_bytes(b""), "the file is empty"),
    "cut short": (lambda path: path.write_bytes(path.read_bytes()[:-30]), "File is not a zip file"),
    "a byte": (damaged, r"bad.zip/a.bvh: cannot be read as a zip file \(.*\); copy or download it again"),
    "no member": (zipped, r"no .bvh file among the 0 in this zip file; take it out of the folder"),
    "no motion": (
        lambda path: zipped(path, **{"a.wav": ""}) and path.write_bytes(path.read_bytes().replace(b".bvh", b".wav")),
        r"no .bvh file among the 1 in this zip file; take it out of the folder or download it again",
    ),
    "an empty member": (lambda path: zipped(path, a=""), r"bad.zip/a.bvh: is not a BVH file"),
    "text in it": (lambda path: zipped(path, a="x"), r"bad.zip/a.bvh: is not a BVH file: it does not begin with"),
}


@pytest.mark.parametrize("what", BAD)
def test_bad_zip_files_are_refused_in_one_line(tmp_path: Path, what: str) -> None:
    spoil, message = BAD[what]
    rng = np.random.default_rng(0)
    path = zipped(tmp_path / "bad.zip", a="HIERARCHY\n" + " ".join(map(str, rng.normal(size=500))))
    spoil(path)
    (source,) = list_sources(tmp_path)
    with pytest.raises(BodysenseError, match=message) as error:
        read_source(source)
    assert str(error.value).startswith(str(path)) and "\n" not in str(error.value)
    assert re.search("; |: is not a BVH file", str(error.value))
    with pytest.raises(BodysenseError, match=message):
        next(open_clips(tmp_path))


def test_a_zip_file_for_a_motion(tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.zip", a="", b="")
    with pytest.raises(BodysenseError, match=r"a.zip: a zip file of 2 motions, not one; give the folder it lies in"):
        read(path)


def test_a_bad_zip_file_is_skipped_by_prepare_and_named(talking_with_hands, tmp_path: Path, capsys) -> None:
    pytest.importorskip("zarr", reason="needs packages/lab")
    from bodysense_lab.data import preparation

    folder = talking_with_hands.folder
    (folder / "mocap_data" / "session2" / "take4.zip").write_text("not a zip file")
    table = preparation.prepare(folder, tmp_path / "a.zarr", workers=1).table
    assert [row.source for row in table.skipped] == ["mocap_data/session2/take4.zip"]
    assert len(table.clips) == len(talking_with_hands.truth)
    assert "skipped mocap_data/session2/take4.zip: " in capsys.readouterr().out
    assert len(preparation.prepare(folder, tmp_path / "a.zarr", workers=1).table.clips) == len(table.clips)


def test_a_list_of_conversations_that_cannot_be_read(talking_with_hands) -> None:
    (talking_with_hands.folder / "configs" / "conversations.json").write_text('["session1"')
    with pytest.raises(BodysenseError, match=r"conversations.json: cannot be read .*; download it again or remove it"):
        list_sources(talking_with_hands.folder)
    (talking_with_hands.folder / "configs" / "conversations.json").unlink()
    assert {source.category for source in list_sources(talking_with_hands.folder / "mocap_data")} == {""}


# --- the one command ---


def test_one_command(mixamo, tmp_path: Path, monkeypatch, capsys) -> None:
    pytest.importorskip("zarr", reason="needs packages/lab")
    from bodysense.cli import main

    monkeypatch.setenv("COLUMNS", "200")
    store = tmp_path / "store.zarr"
    assert main(["data", "prepare", str(mixamo.folder), "-o", str(store), "--workers", "1"]) == 0
    assert "skipped" not in capsys.readouterr().out
    rows = []
    for place in (mixamo.folder, store):
        assert main(["data", "info", str(place)]) == 0
        rows.append(capsys.readouterr().out.splitlines()[-2].split())  # │ all │ people │ clips │ …
        assert rows[-1][5] == str(len(mixamo.truth))
    assert rows[0][:6] == rows[1][:6]


def test_unoc_is_prepared_by_one_command(unoc, tmp_path: Path, monkeypatch, capsys) -> None:
    """A whole release: splits by participant, fingers, motion as written; a wrong file is skipped with its reason."""
    pytest.importorskip("zarr", reason="needs packages/lab")
    from bodysense.cli import main

    monkeypatch.setenv("COLUMNS", "200")
    store = tmp_path / "unoc.zarr"
    fewer, broken = (unoc.folder / f"P{k}" / "merged bvh" / f"take_{k - 1}_merged.bvh" for k in (2, 7))
    fewer.write_text(fewer.read_text().replace("Frames: 5", "Frames: 4"))  # one frame fewer than there are
    broken.write_text(broken.read_text().replace("Frames: 5", "Frames: 9"))
    assert main(["data", "prepare", str(unoc.folder), "-o", str(store), "--workers", "1"]) == 0
    printed = capsys.readouterr().out
    assert "P7/merged bvh/take_6_merged.bvh" in printed and "'Frames: 9' announces" in printed
    people = {split: {clip.person for clip in open_clips(store, split)} for split in ("train", "val", "test")}
    assert people == {"train": {f"P{k}" for k in range(1, 11)} - {"P7"}, "val": {"P11"}, "test": {"P12", "P13"}}
    for clip in open_clips(store):
        (truth,) = (one for key, one in unoc.truth.items() if key.startswith(f"{clip.person}/"))
        assert (clip.frame_rate, clip.has_fingers, len(clip)) == (30.0, True, 2)
        assert furthest(clip, replace(truth, pose=truth.pose[::4])) < MILLIMETRE


def test_a_layout_of_the_command(mixamo, capsys) -> None:
    from bodysense.cli import main

    assert main(["data", "info", str(mixamo.folder), "--layout", "unoc"]) == 2
    assert "Mixamo: not laid out as UNOC's release" in capsys.readouterr().err
