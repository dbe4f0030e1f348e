"""Protocol 1 on a synthetic AMASS folder: the split by lists, one body for all people, and the measures."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from people.smpl import betas_of, made_up_model, save_walk, walk
from scipy.spatial.transform import Rotation

from bodysense.errors import BodysenseError
from bodysense.tracking.model import PACKAGED
from bodysense_lab.completion.score.amass_p1 import listed_sources, measure, mpjpe_interval, read_clip
from bodysense_lab.papers.hmd_vae.tables import PUBLISHED

PLACE = "/home/somebody/amass"
MODEL = made_up_model(4)


@pytest.fixture(scope="module")
def amass(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write three sets, two in the spelling of newer releases, with shapes of bodies, and the lists that name them."""
    folder = tmp_path_factory.mktemp("amass")
    names = {
        "CMU": ("CMU", "01/01_0{}_poses.npz", "01/01_0{}_poses.npz"),
        "BioMotionLab_NTroje": ("BMLrub", "rub001/000{}_normal walk_poses.npz", "rub001/000{}_normal_walk_stageii.npz"),
        "MPI_HDM05": ("HDM05", "bk/HDM_bk_01-0{}_01_120_poses.npz", "bk/HDM_bk_01-0{}_01_120_stageii.npz"),
    }
    betas = betas_of(MODEL, 1.9)
    poses, trans = walk(MODEL, betas, seconds=2.0)
    for name, (ours, listed, spelled) in names.items():
        for part, which in (("train", (1, 2, 3)), ("test", (4,))):
            lines = [f"{PLACE}/{name}/{listed.format(k)}" for k in which]
            lines.append(f"{PLACE}/{name}/{listed.split('/')[0]}/shape.npz")
            path = folder / "data_split" / name / f"{part}_split.txt"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("\n".join(lines) + "\n")
            for k in which:
                save_walk(folder / "amass" / ours / spelled.format(k), poses, trans, betas, gender="male")
        save_walk(folder / "amass" / ours / listed.split("/")[0] / "unlisted_poses.npz", poses, trans, betas)
    (folder / "amass" / "BMLrub" / "rub001" / "0002_normal_walk_stageii.npz").unlink()
    MODEL.save(folder / "smplh" / "male" / "model.npz")
    return folder


def test_the_lists_split_the_files_in_any_spelling(amass: Path) -> None:
    sources, missing = listed_sources(amass / "amass", amass / "data_split")
    assert missing == 1  # one of BMLrub; shapes of bodies are not counted
    test = {source.path.relative_to(amass / "amass").as_posix() for source in sources if source.split == "test"}
    assert test == {
        "CMU/01/01_04_poses.npz",
        "BMLrub/rub001/0004_normal_walk_stageii.npz",
        "HDM05/bk/HDM_bk_01-04_01_120_stageii.npz",
    }
    assert len(sources) == 3 * 4 - 1 and not any("unlisted" in source.path.name for source in sources)
    assert {source.person for source in sources} == {"CMU_01", "BioMotionLab_NTroje_rub001", "MPI_HDM05_bk"}


def test_a_share_of_the_training_files_is_the_validation_split(amass: Path, monkeypatch) -> None:
    for share, split in ((0.0, "train"), (1.0, "val")):
        monkeypatch.setattr("bodysense_lab.completion.score.amass_p1.VALIDATION_SHARE", share)
        sources, _ = listed_sources(amass / "amass", amass / "data_split")
        assert {source.split for source in sources} == {split, "test"}


def test_missing_lists_and_files_are_named(amass: Path, tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match=r"CMU/train_split.txt cannot be read .*data_split of a clone of github"):
        listed_sources(amass / "amass", tmp_path)
    with pytest.raises(BodysenseError, match=r"no file of the train lists .*CMU, BioMotionLab_NTroje, MPI_HDM05"):
        listed_sources(tmp_path, amass / "data_split")


def test_all_people_have_the_mean_body_on_the_floor_at_60_hz(amass: Path) -> None:
    sources, _ = listed_sources(amass / "amass", amass / "data_split")
    clip = read_clip(sources[0], amass / "smplh" / "male" / "model.npz")
    _, joints = MODEL.shaped(np.zeros(2))
    np.testing.assert_allclose(clip.pose.skeleton.rest_offset[1:22], (joints - joints[MODEL.parents])[1:22], atol=1e-9)
    assert clip.frame_rate == 60.0 and len(clip) == 120


def test_measures_equal_those_computed_by_scipy() -> None:
    """A clip with known errors; the reference is computed by SciPy."""
    rng = np.random.default_rng(3)
    frames = 30
    truth = np.cumsum(rng.normal(scale=0.01, size=(frames, 22, 3)), axis=0)
    guess = truth + rng.normal(scale=0.02, size=truth.shape)
    turn, other = (Rotation.random(frames * 22, rng=rng) for _ in range(2))
    quaternions = [one.as_quat(canonical=True, scalar_first=True).reshape(frames, 22, 4) for one in (other, turn)]
    found = measure(guess, quaternions[0], truth, quaternions[1])
    guess = guess - guess[:, 15:16] + truth[:, 15:16]
    error = 100 * np.sqrt(((guess - truth) ** 2).sum(-1))
    groups = {
        "mpjpe_cm": range(22),
        "hand_cm": (20, 21),
        "upper_cm": (3, 6, 9, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21),
        "lower_cm": (0, 1, 2, 4, 5, 7, 8, 10, 11),
        "root_cm": (0,),
    }
    for key, joints in groups.items():
        assert found[key] == pytest.approx(error[:, list(joints)].mean())
    apart = (turn.as_rotvec() - other.as_rotvec()).reshape(frames, 22, 3)[:, 1:].reshape(-1, 3)
    wrapped = Rotation.from_rotvec(apart).as_rotvec()
    assert found["mpjre_deg"] == pytest.approx(np.degrees(np.abs(wrapped).mean()))
    speed = 60 * np.diff(guess - truth, axis=0)
    assert found["mpjve_cm_s"] == pytest.approx(100 * np.linalg.norm(speed, axis=-1).mean())
    for key, position in (("jitter", guess), ("truth_jitter", truth)):
        jerk = position[3:] - 3 * position[2:-1] + 3 * position[1:-2] - position[:-3]
        assert found[key] == pytest.approx(np.linalg.norm(jerk, axis=-1).mean() * 60**3 / 100)


def test_the_command_scores_next_to_published_figures(amass: Path, run: object, tmp_path: Path) -> None:
    options = ["--amass", amass / "amass", "--split-lists", amass / "data_split"]
    model = ["--smpl-model", amass / "smplh" / "male" / "model.npz"]
    text = run("evaluate", "amass-p1", *options, *model, "--json", tmp_path / "p1.json")  # type: ignore[operator]
    numbers = json.loads((tmp_path / "p1.json").read_text())
    assert numbers["clips"] == 3 and 0 < numbers["hand_cm"] < 1.0 < numbers["lower_cm"] < 30
    assert all(name in text for name in PUBLISHED) and "4.18" in text and "1 of the files in the lists are not" in text
    text = run("evaluate", "amass-p1", *options, "--limit", 1)  # type: ignore[operator]
    assert "1 of 3 test clips" in text and "The default body instead of the published one" in text


def test_a_sample_has_its_interval(amass: Path, run: object, tmp_path: Path) -> None:
    options = ["--amass", amass / "amass", "--split-lists", amass / "data_split", "--json", tmp_path / "a.json"]
    text = " ".join(run("evaluate", "amass-p1", *options, "--limit", 2).split())  # type: ignore[operator]
    numbers = json.loads((tmp_path / "a.json").read_text())
    bounds = re.search(r"A sample: 2 of 3 clips. MPJPE: between (\S+) and (\S+) cm \(95 %\)", text)
    assert bounds and float(bounds[1]) - 0.01 < numbers["mpjpe_cm"] < float(bounds[2]) + 0.01
    assert (numbers["clips"], numbers["clips_in_split"]) == (2, 3)
    assert "sample" not in run("evaluate", "amass-p1", *options)  # type: ignore[operator]


def test_intervals_are_over_people_not_clips() -> None:
    """The interval of two people is between their means, for any number of clips."""
    scores = [{"mpjpe_cm": error} for error in (1.0, 3.0, 4.0)]
    found = mpjpe_interval(["a", "a", "b"], scores)
    assert (found.value, found.low, found.high) == pytest.approx((8 / 3, 2.0, 4.0))


def test_the_given_network_is_scored(amass: Path, refused: object, tmp_path: Path) -> None:
    options = ["--amass", amass / "amass", "--split-lists", amass / "data_split", "--limit", 1]
    output = refused("evaluate", "amass-p1", *options, "--model", tmp_path / "missing.safetensors")  # type: ignore[operator]
    assert "missing.safetensors: no such" in output


def test_training_data_can_be_prepared_by_the_lists(amass: Path, run: object, tmp_path: Path) -> None:
    pytest.importorskip("zarr", reason="needs packages/lab")
    from bodysense_lab.data.store import read_store

    options = ["--split-lists", amass / "data_split", "--smpl-model", amass / "smplh"]
    text = run("data", "prepare", amass / "amass", "-o", tmp_path / "p1.zarr", *options, "--workers", 1)  # type: ignore[operator]
    assert "11 files of the lists; 1 are not in" in text
    rows = read_store(tmp_path / "p1.zarr").table.clips
    assert len(rows) == 11 and sum(row.split == "test" for row in rows) == 3


def packaged_in_place(body: object, fingers: object, data: Path, out: Path, *card: object) -> None:
    """Write the packaged weights in place of trained ones."""
    shutil.copyfile(str(files("bodysense.weights") / PACKAGED), out)


@pytest.mark.slow
@pytest.mark.usefixtures("quick_completion")
def test_a_network_is_trained_and_scored_by_the_lists(
    amass: Path, run: Callable, refused: Callable, tmp_path: Path, monkeypatch
) -> None:
    """The documented commands work, with one step of training."""
    pytest.importorskip("torch", reason="needs packages/lab")
    monkeypatch.setattr("bodysense_lab.completion.score.amass_p1.VALIDATION_SHARE", 0.5)  # there are few files
    # Calibration takes long; tests/cli/test_trials.py publishes a network.
    monkeypatch.setattr("bodysense_lab.completion.networks.publish.publish", packaged_in_place)
    lists, store, network = ["--split-lists", amass / "data_split"], tmp_path / "p1.zarr", tmp_path / "p1.safetensors"
    run("data", "prepare", amass / "amass", "-o", store, *lists, "--smpl-model", amass / "smplh", "--workers", 1)
    train = ["train", "completion", "--data", store, "-o", network, "--steps", 1, "--limit", 2]
    assert "no training clip has fingers that move; give --finger-steps 0" in refused(*train)
    run(*train, "--finger-steps", 0)
    model = ["--smpl-model", amass / "smplh" / "male" / "model.npz", "--model", network, "--limit", 1]
    text = run("evaluate", "amass-p1", "--amass", amass / "amass", *lists, *model)
    assert "bodysense, p1" in text and "1 of 3 test clips" in text
    (row,) = [line for line in text.splitlines() if "RPM" in line]
    assert "4.08" in row and "4.21" in row
