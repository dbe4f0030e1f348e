"""Model files of SMPL: bones from shape coefficients, and refused files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from people.smpl import PELVIS, SKELETON, betas_of, made_up_model

from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.formats.body_model import model_for, read_model


def test_bones_and_soles_are_those_of_the_shaped_template(tmp_path: Path) -> None:
    model = made_up_model(2)
    betas = np.array([1.5, -2.0])
    vertices, joints = model.shaped(betas)
    shape = read_model(model.save(tmp_path / "model.npz")).shape(betas)
    np.testing.assert_allclose(shape.pelvis, joints[0], atol=1e-12)
    offset = shape.skeleton.rest_offset
    np.testing.assert_allclose(offset[1:52], (joints - joints[model.parents])[1:], atol=1e-12)
    assert offset[0, 1] == pytest.approx(joints[0, 1] - vertices[:, 1].min(), abs=1e-12)
    assert offset[0, [0, 2]].tolist() == [0, 0]


def test_smplx_has_jaw_and_eyes_and_directions_of_the_face(tmp_path: Path) -> None:
    model = made_up_model()
    order = np.r_[0:22, [15, 15, 15], 22:52]
    parents = np.r_[model.parents[:22], [15, 15, 15], [p if p < 22 else p + 3 for p in model.parents[22:]]]
    face = np.full((*model.vertices.shape, 10), 0.5)
    path = model.save(
        tmp_path / "SMPLX_NEUTRAL.npz",
        J_regressor=model.regressor[order],
        kintree_table=np.array([parents % 2**32, np.arange(55)], dtype=np.uint32),
        shapedirs=np.concatenate([model.directions, np.zeros((*model.vertices.shape, 8)), face], axis=-1),
    )
    betas = np.r_[1.0, -1.0, np.zeros(8), np.ones(6)]  # those beyond the tenth would be of the face
    _, joints = model.shaped(betas[:2])
    offset = read_model(path).shape(betas).skeleton.rest_offset
    np.testing.assert_allclose(offset[1:52], (joints - joints[model.parents])[1:], atol=1e-12)


def test_smpl_has_no_fingers(tmp_path: Path) -> None:
    model = made_up_model()
    path = model.save(
        tmp_path / "SMPL_MALE.npz",
        J_regressor=model.regressor[[*range(22), 25, 40]],
        kintree_table=np.array([[*(model.parents[:22] % 2**32), 20, 21], range(24)], dtype=np.uint32),
    )
    skeleton = read_model(path).shape(betas_of(model, 1.9)).skeleton
    _, joints = model.shaped(betas_of(model, 1.9))
    np.testing.assert_allclose(skeleton.rest_offset[1:22], (joints - joints[model.parents])[1:22], atol=1e-12)
    finger = SKELETON.index("left_index2")
    longer = np.linalg.norm(skeleton.rest_offset[finger]) / np.linalg.norm(default_skeleton().rest_offset[finger])
    assert 1.0 < longer < 1.3


def test_a_changed_file_is_read_again(tmp_path: Path) -> None:
    path = made_up_model(0).save(tmp_path / "model.npz")
    first = read_model(path).shape(np.zeros(2)).skeleton.rest_offset
    made_up_model(1).save(path)
    assert np.abs(read_model(path).shape(np.zeros(2)).skeleton.rest_offset - first).max() > 1e-3


def test_the_gender_chooses_a_file_of_a_folder(tmp_path: Path) -> None:
    for body, gender in enumerate(("female", "male")):
        made_up_model(body).save(tmp_path / "smplh" / gender / "model.npz")
    assert model_for(tmp_path, "male").path == tmp_path / "smplh" / "male" / "model.npz"
    assert model_for(tmp_path, "female").path == tmp_path / "smplh" / "female" / "model.npz"
    assert model_for(tmp_path / "smplh" / "male" / "model.npz", "female").path.parent.name == "male"
    with pytest.raises(BodysenseError, match=r"no .npz file for a neutral body, of female, male; add it"):
        model_for(tmp_path, "neutral")


def test_a_pickle_is_never_read_and_its_conversion_works(tmp_path: Path) -> None:
    import pickle
    import re
    import subprocess
    import sys

    model = made_up_model()
    content = {"J_regressor": model.regressor, "v_template": model.vertices, "shapedirs": model.directions}
    table = np.array([model.parents % 2**32, np.arange(52)], dtype=np.uint32)
    path = tmp_path / "SMPLH_MALE.pkl"
    path.write_bytes(pickle.dumps(content | {"kintree_table": table}))
    with pytest.raises(BodysenseError, match=r"a pickle may run any code") as error:
        read_model(path)
    command = re.search(r'python -c "(.*)"', str(error.value))
    assert command is not None
    subprocess.run([sys.executable, "-c", command[1]], cwd=tmp_path, check=True)
    assert read_model(tmp_path / "SMPLH_MALE.npz").shape(np.zeros(2)).pelvis == pytest.approx(PELVIS, abs=0.01)


BROKEN = [
    ({"kintree_table": np.zeros((2, 52), dtype=np.uint32)}, "hangs joint 4 on 0, but SMPL's 'left_knee' hangs on 1"),
    ({"J_regressor": np.zeros((17, 214))}, r"a model of 17 joints; valid are SMPL \(24\), SMPL-H \(52\) and SMPL-X"),
    ({"v_template": np.zeros((214, 2))}, r"'v_template' has shape \(214, 2\)"),
    ({"shapedirs": np.array([{}])}, "'shapedirs' holds objects of Python, which only unpickling reads"),
]


@pytest.mark.parametrize(("change", "message"), BROKEN)
def test_other_files_are_refused(tmp_path: Path, change: dict[str, np.ndarray], message: str) -> None:
    path = made_up_model().save(tmp_path / "model.npz", **change)
    with pytest.raises(BodysenseError, match=message):
        read_model(path)
