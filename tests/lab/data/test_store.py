"""The store: complete or absent, resumable, with the motion of the files."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from people.smpl import betas_of, lowest_soles, made_up_model, save_walk, walk

from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.formats.bvh import write_bvh
from bodysense.io.reading_options import ReadingOptions
from bodysense.io.resample import resample
from bodysense_lab.data import preparation
from bodysense_lab.data.clips import open_clips
from bodysense_lab.data.preparation import prepare
from bodysense_lab.data.store import is_store, read_store

pytest.importorskip("zarr", reason="needs packages/lab")


@pytest.fixture
def folder(tmp_path: Path, make_clip) -> Path:
    """Write seven files of four people; two of them contain no motion."""
    for k, person in enumerate(("anna", "anna", "ben", "carl", "dora")):
        path = tmp_path / "files" / person / f"take_{k}.bvh"
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bvh(path, make_clip(frames=20 + 3 * k, seed=k, rate=60.0))
    (tmp_path / "files" / "ben" / "broken.bvh").write_text("HIERARCHY\nROOT Hips\n")
    (tmp_path / "files" / "ben" / "empty.npz").write_text("")
    return tmp_path / "files"


def stopped(*_: object) -> None:
    raise KeyboardInterrupt


def test_a_store_contains_the_motion_of_the_files(folder: Path, tmp_path: Path, capsys) -> None:
    store = prepare(folder, tmp_path / "motion.zarr", rate=30.0, workers=1)
    assert [row.source for row in store.table.clips] == [
        f"{p}/take_{k}.bvh" for k, p in enumerate(("anna", "anna", "ben", "carl", "dora"))
    ]
    assert store.rotation.shape == (sum(row.length for row in store.table.clips), 52, 4)
    assert store.rotation.dtype == np.float32 and store.rotation.chunks == (512, 52, 4)
    (folder / "ben" / "broken.bvh").unlink()
    (folder / "ben" / "empty.npz").unlink()
    for clip, row, index in zip(open_clips(folder), store.table.clips, range(5), strict=True):
        thirty, stored = resample(clip, 30.0), store.clip(index)
        assert (stored.name, stored.person, stored.frame_rate) == (clip.name, clip.person, 30.0)
        assert len(stored) == len(thirty) == row.length
        assert geodesic_angle(stored.pose.rotation, thirty.pose.rotation).max() < 1e-3
        np.testing.assert_allclose(stored.pose.root_position, thirty.pose.root_position, atol=1e-6)
        np.testing.assert_allclose(stored.pose.skeleton.rest_offset, thirty.pose.skeleton.rest_offset, atol=1e-6)
    printed = capsys.readouterr().out
    assert "skipped ben/broken.bvh:" in printed and "there is no MOTION section" in printed
    assert [row.source for row in store.table.skipped] == ["ben/broken.bvh", "ben/empty.npz"]
    assert "the file is empty" in store.table.skipped[1].reason


@pytest.mark.slow
def test_workers_of_a_scheduler_need_only_the_folder(folder: Path, tmp_path: Path, monkeypatch) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.chdir(tmp_path)
    model = made_up_model()
    betas = betas_of(model, 1.7)
    save_walk(Path("people/anna/walk.npz"), *walk(model, betas, 2.0), betas)
    given = ReadingOptions(smpl_model=model.save(Path("model.npz")))
    alone = {"files": prepare("files", "files-1.zarr", workers=1)}
    alone["people"] = prepare("people", "people-1.zarr", workers=1, options=given)
    away = tmp_path / "away"
    away.mkdir()
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    anywhere = "127.0.0.1:0"  # by default each cluster's page takes port 8787
    with distributed.LocalCluster(n_workers=0, dashboard_address=anywhere) as cluster:
        command = [sys.executable, "-m", "distributed.cli.dask_worker", cluster.scheduler_address, "--no-dashboard"]
        workers = [subprocess.Popen([*command, "--nthreads", "1"], cwd=away, env=environment) for _ in range(2)]
        try:
            with distributed.Client(cluster.scheduler_address) as client:
                client.wait_for_workers(2, timeout=60)
            address = cluster.scheduler_address
            found = {"files": prepare("files", "files-2.zarr", scheduler=address)}
            found["people"] = prepare("people", "people-2.zarr", scheduler=address, options=given)
        finally:
            for worker in workers:
                worker.terminate()
                worker.wait()
    for name, store in found.items():
        ours, theirs = store.table, alone[name].table
        assert (ours.clips, ours.bodies, len(ours.skipped)) == (theirs.clips, theirs.bodies, len(theirs.skipped))
        np.testing.assert_array_equal(store.rotation[:], alone[name].rotation[:])
        np.testing.assert_array_equal(store.rest_offset, alone[name].rest_offset)


def test_open_clips_reads_stores_and_folders_alike(folder: Path, tmp_path: Path) -> None:
    store = prepare(folder, tmp_path / "motion.zarr", workers=1)
    assert [c.name for c in open_clips(tmp_path / "motion.zarr")] == [row.name for row in store.table.clips]
    split = store.table.clips[0].split
    assert {c.person for c in open_clips(tmp_path / "motion.zarr", split)} == {
        r.person for r in store.table.clips if r.split == split
    }


@pytest.mark.parametrize("moment", ["within the batch", "before the rename"])
def test_a_killed_run_resumes_and_is_not_a_finished_store(
    folder: Path, tmp_path: Path, monkeypatch, moment: str
) -> None:
    whole = prepare(folder, tmp_path / "whole.zarr", workers=1)
    monkeypatch.setattr(preparation, "BATCH", 2)
    path, seen = tmp_path / "motion.zarr", []
    prepared, append = preparation._prepare_source, preparation._append

    def counted(item, rate, options):
        seen.append(item[1].path.name)
        return prepared(item, rate, options)

    def killed(group, table, batch):
        if len(table.clips) < 2 or moment == "before the rename":
            return append(group, table, batch)
        if moment == "within the batch":  # the arrays are written, the table is not
            before = group.attrs.asdict()
            append(group, table, batch)
            group.attrs.update(before)
        raise KeyboardInterrupt

    monkeypatch.setattr(preparation, "_prepare_source", counted)
    with monkeypatch.context() as patch:
        patch.setattr(preparation, "_append", killed)
        patch.setattr(preparation, "_publish", stopped)
        with pytest.raises(KeyboardInterrupt):
            prepare(folder, path, workers=1)
    assert not path.exists() and not is_store(path)
    if moment != "before the rename":
        with pytest.raises(BodysenseError, match=r"not a finished store"):
            read_store(tmp_path / "motion.zarr.part")
    first = list(seen)
    seen.clear()
    store = prepare(folder, path, workers=1)
    assert not (tmp_path / "motion.zarr.part").exists()
    done = first[:-2] if moment != "before the rename" else first
    assert not set(done) & set(seen)  # no file is read twice
    assert [row.source for row in store.table.clips] == [row.source for row in whole.table.clips]
    assert [row.source for row in store.table.skipped] == [row.source for row in whole.table.skipped]
    np.testing.assert_array_equal(store.rotation[:], whole.rotation[:])
    np.testing.assert_array_equal(store.root_position[:], whole.root_position[:])
    np.testing.assert_array_equal(store.rest_offset, whole.rest_offset)


def test_a_finished_store_is_not_changed(folder: Path, tmp_path: Path, monkeypatch, make_clip) -> None:
    path = tmp_path / "motion.zarr"
    prepare(folder, path, workers=1)
    with pytest.raises(BodysenseError, match=r"empty\.npz: the file is empty; copy or export it again"):
        prepare(folder, tmp_path / "other.zarr", options=ReadingOptions(smpl_model=folder / "ben" / "empty.npz"))
    prepare(folder, tmp_path / "other.zarr", workers=1, options=ReadingOptions(smpl_model=tmp_path))
    with pytest.raises(BodysenseError, match=rf"made with other options \(--smpl-model {tmp_path}\); give another"):
        prepare(folder, tmp_path / "other.zarr", workers=1)
    monkeypatch.setattr(preparation, "_prepare_source", None)
    assert len(prepare(folder, path, workers=1).table.clips) == 5
    with pytest.raises(BodysenseError, match=r"is at 30 Hz, not 60; give another place or remove it"):
        prepare(folder, path, rate=60.0, workers=1)
    with pytest.raises(BodysenseError, match=r"was made with other options .none.; give another place"):
        prepare(folder, path, workers=1, options=ReadingOptions(unit="m"))
    write_bvh(folder / "anna" / "new.bvh", make_clip())
    with pytest.raises(BodysenseError, match=r"was made from 7 files, but there are 8 now"):
        prepare(folder, path, workers=1)


def test_changed_files_are_detected_when_a_run_resumes(folder: Path, tmp_path: Path, monkeypatch, make_clip) -> None:
    monkeypatch.setattr(preparation, "BATCH", 2)
    with monkeypatch.context() as patch:
        patch.setattr(preparation, "_publish", stopped)
        with pytest.raises(KeyboardInterrupt):
            prepare(folder, tmp_path / "motion.zarr", workers=1)
    write_bvh(folder / "anna" / "take_0.bvh", make_clip(seed=9))
    with pytest.raises(BodysenseError, match=r"was made from another version of anna/take_0.bvh"):
        prepare(folder, tmp_path / "motion.zarr", workers=1)


def test_invalid_stores_and_options_are_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match=r"not a store of motion; make one with `bodysense data prepare"):
        read_store(tmp_path / "none.zarr")
    with pytest.raises(BodysenseError, match=r"exists and is not a store"):
        prepare(folder, folder, workers=1)
    with pytest.raises(BodysenseError, match=r"0 workers are not possible; give at least 1"):
        prepare(folder, tmp_path / "a.zarr", workers=0)
    with pytest.raises(BodysenseError, match=r"frame rate -1 Hz is not possible"):
        prepare(folder, tmp_path / "b.zarr", rate=-1.0, workers=1)
    only_bad = tmp_path / "bad"
    only_bad.mkdir()
    (only_bad / "a.bvh").write_text("x")
    with pytest.raises(BodysenseError, match=r"none of its 1 files can be read; the first: .*is not a BVH file"):
        prepare(only_bad, tmp_path / "c.zarr", workers=1)


@pytest.mark.parametrize("damage", ['{"zarr_format": 3, "node_type": "group"}', "{"])
def test_a_damaged_store_is_refused(folder: Path, tmp_path: Path, damage: str) -> None:
    prepare(folder, tmp_path / "a.zarr", workers=1)
    (tmp_path / "a.zarr" / "zarr.json").write_text(damage)
    with pytest.raises(BodysenseError, match=r"a.zarr: .*prepare"):
        read_store(tmp_path / "a.zarr")


def test_a_missing_zarr_names_its_install_line(folder: Path, tmp_path: Path, monkeypatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(BodysenseError, match=r"needs the package zarr; in a clone .* packages/lab"):
        prepare(folder, tmp_path / "a.zarr")


def test_people_of_amass_stand_on_the_floor_at_their_height(tmp_path: Path, capsys) -> None:
    """Heights of 1.55 and 1.90 m, floors 10 cm up and 12 cm down; with a body model, and without one from steps."""
    model = made_up_model(3)
    for name, height, floor in (("short", 1.55, 0.10), ("tall", 1.90, -0.12)):
        betas = betas_of(model, height)
        poses, trans = walk(model, betas)
        save_walk(tmp_path / "CMU" / name / "walk.npz", poses, trans, betas, floor)
        save_walk(tmp_path / "CMU" / name / "still.npz", poses[:9], trans[:1].repeat(9, axis=0), betas, floor)
        np.savez(tmp_path / "CMU" / name / "shape.npz", betas=betas, gender="neutral")
    file = model.save(tmp_path / "models" / "model.npz")
    for options, text in ((ReadingOptions(smpl_model=file), "by the body model"), (ReadingOptions(), "by its steps")):
        place = tmp_path / f"{text.split()[-1]}.zarr"
        store = prepare(tmp_path / "CMU", place, workers=1, options=options)
        printed = capsys.readouterr().out
        assert f"short: {'' if options.smpl_model is None else 'bones '}" in printed and printed.count(text) == 2
        assert "skipped 2 files such as short/shape.npz: no 'poses' in it" in printed
        assert printed.count("skipped") == 1
        for index, row in enumerate(store.table.clips):
            clip = store.clip(index)
            assert np.abs(lowest_soles(clip.pose)).max() < 0.015
            joints = model.shaped(betas_of(model, {"short": 1.55, "tall": 1.90}[row.person]))[1]
            thigh = np.linalg.norm(joints[4] - joints[1])
            exact = 1e-5 if options.smpl_model is not None else 0.1
            assert np.linalg.norm(clip.pose.skeleton.rest_offset[4]) == pytest.approx(thigh, rel=exact)


def test_the_rate_and_bodies_of_a_store_are_printed(tmp_path: Path, run) -> None:
    model = made_up_model()
    poses, trans = walk(model, np.zeros(2))
    save_walk(tmp_path / "CMU" / "anna" / "walk.npz", poses, trans, np.zeros(2), 0.2)
    prepare(tmp_path / "CMU", tmp_path / "motion.zarr", rate=25.0, workers=1)
    text = run("data", "info", tmp_path / "motion.zarr")
    assert "prepared at 25 Hz" in text and "anna: " in text and "moved to 0" in text and "walk: store, 25 Hz" in text
