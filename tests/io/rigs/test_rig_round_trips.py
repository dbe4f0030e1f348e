"""On the rig of a file and back: the same file; and its holes are filled in its own channels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rig_files import held_still, mapped, motion, read_plainly, write
from rig_layouts import LAYOUTS

from bodysense.body.pose import forward_kinematics
from bodysense.body.shape import sample_bodies
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense.io.formats.bvh_text import BvhFile, open_bvh
from bodysense.io.rigged import read_rigged
from bodysense.io.target_rigs.named import on_rig as under_names
from bodysense.io.target_rigs.named import renamed
from bodysense.io.target_rigs.own_rig import on_rig, write_on_rig_of
from bodysense.sources.reading import read
from bodysense.takes.track import track

EXACT = (
    "Mixamo",
    "CMU, its own unit",
    "Bandai-Namco",
    "Unreal",
    "classic",
    "Spine3, Neck1",
    "Perception Neuron",
    "OpenNI",
)


def of(text: str, path: Path):
    path.write_text(text)
    return open_bvh(path), read_rigged(text.encode(), path)


@pytest.mark.filterwarnings("ignore:Gimbal lock")
@pytest.mark.parametrize("name", EXACT)
def test_source_to_ours_to_source_is_the_same(name: str, tmp_path: Path) -> None:
    """Orders of channels, units, axes, extra roots, places on every joint."""
    layout = LAYOUTS[name]
    text = write(layout, held_still(motion(6), layout))
    file, rigged = of(text, tmp_path / "take.bvh")
    again = on_rig(file, rigged, rigged.clip)
    assert isinstance(again, BvhFile)
    turned = np.rad2deg(geodesic_angle(file.rotation, again.rotation)).max(axis=0)
    ours = [file.joints.index(given) for given in rigged.rig.joints.values() if given in file.joints]
    assert turned[ours].max() < 1e-4
    before, after = read_plainly(text), read_plainly(again.text().decode())
    for joint, place in before.items():
        assert np.abs(place - after[joint]).max() * rigged.rig.unit < 1e-4, joint


@pytest.mark.parametrize("name", ["Mixamo", "CMU, its own unit", "Bandai-Namco", "Unreal", "SMPL"])
def test_holes_of_any_rig_are_filled_in_its_own_channels(name: str, tmp_path: Path) -> None:
    layout = LAYOUTS[name]
    clip = held_still(motion(30, 1), layout)
    file, rigged = of(write(layout, clip), tmp_path / "take.bvh")
    done = track(tmp_path / "take.bvh", missing="left_elbow:8-20,right_knee:10-22")
    done.save(tmp_path / "out.bvh")
    after = open_bvh(tmp_path / "out.bvh")
    gone = {file.joints.index(mapped(layout)[ours]) for ours in ("left_elbow", "right_knee")}
    for t, (a, b) in enumerate(zip(file.lines, after.lines, strict=True)):
        columns = {c for c, (x, y) in enumerate(zip(a.split(), b.split(), strict=True)) if x != y}
        assert columns <= {c for joint in gone for c in file.columns_of(joint, "rotation")}
        assert not columns or 8 <= t <= 22
    found = forward_kinematics(read_rigged(after.text(), after.path).clip.pose)[0]
    truth = forward_kinematics(rigged.clip.pose)[0]
    assert np.linalg.norm(found - truth, axis=-1).max() < 0.15


def test_a_motion_on_the_rig_of_another_body(tmp_path: Path) -> None:
    """Feet on the floor, hands where they were, names of the rig."""
    clip = motion(8, 40)
    body = clip.pose.skeleton.with_offsets(sample_bodies("test", 2)[1])
    layout = LAYOUTS["Mixamo"]
    other = Clip("other", type(clip.pose)(body, clip.pose.root_position, clip.pose.rotation), 30.0)
    (tmp_path / "rig.bvh").write_text(write(layout, other))
    write_on_rig_of(tmp_path / "out.bvh", clip, tmp_path / "rig.bvh")
    found = read(tmp_path / "out.bvh")
    assert isinstance(found, Clip) and len(found) == 8
    np.testing.assert_allclose(found.pose.skeleton.bone_length[1:22], body.bone_length[1:22], atol=2e-3)
    soles = found.pose.skeleton.indices(["left_foot", "right_foot"])
    assert np.abs(forward_kinematics(found.pose)[0][:, soles, 1].min(axis=1)).max() < 0.05


@pytest.mark.parametrize("rig", ["bodysense", "smplh", "mixamo", "vrm"])
def test_rigs_by_name_are_read_back(rig: str, tmp_path: Path) -> None:
    clip = motion(6)
    write_bvh(tmp_path / "out.bvh", renamed(*under_names(clip, rig)))
    back = read(tmp_path / "out.bvh")
    assert isinstance(back, Clip)
    points = clip.pose.skeleton.indices(clip.pose.skeleton.joints)
    truth, found = (forward_kinematics(one.pose)[0][:, points] for one in (clip, back))
    assert np.linalg.norm(truth - found, axis=-1).max() < 1e-3
