"""MVNX files: a made-up person written as MVN writes it, and files that are damaged or hostile."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.io.clip import Clip
from bodysense.io.mvnx import parse_mvnx
from bodysense.io.reading_options import ReadingOptions
from bodysense.sources.reading import read

SEGMENTS = {  # and the joint of ours in each
    **{"Pelvis": "pelvis", "L5": "spine1", "L3": "spine2", "T12": "", "T8": "spine3", "Neck": "neck", "Head": "head"},
    **{
        f"{side}{theirs}": f"{side.lower()}_{ours}"
        for side in ("Right", "Left")
        for theirs, ours in (
            *(("Shoulder", "collar"), ("UpperArm", "shoulder"), ("ForeArm", "elbow"), ("Hand", "wrist")),
            *(("UpperLeg", "hip"), ("LowerLeg", "knee"), ("Foot", "ankle"), ("Toe", "foot")),
        )
    },
}
Z_UP = quaternion_exp(np.array([np.pi / 2, 0.0, 0.0]))
BODY = tuple(name for name in SEGMENTS.values() if name not in ("", "spine2"))  # four joints of a spine become three


def mvnx(pose: Pose, rate: float = 60.0, people: int = 1) -> str:
    """Return a motion as MVNX: our T-pose as the identity of segments, in a world with +Z up."""
    place, turn = (np.asarray(part) for part in forward_kinematics(pose))
    back = np.broadcast_to(quaternion_conjugate(Z_UP), turn.shape)
    turn = quaternion_multiply(quaternion_multiply(np.broadcast_to(Z_UP, turn.shape), turn), back)
    place = quaternion_rotate(np.broadcast_to(Z_UP, (*place.shape[:-1], 4)), place)
    index = [pose.skeleton.index(name or "spine3") for name in SEGMENTS.values()]
    offset = np.array([[0, 0, 0] if name else [0, 0, -0.05] for name in SEGMENTS.values()])
    place = place[:, index] + quaternion_rotate(turn[:, index], np.broadcast_to(offset, (len(turn), len(index), 3)))
    turn = turn[:, index]
    segments = "".join(f'<segment label="{name}" id="{k}"/>' for k, name in enumerate(SEGMENTS, start=1))

    def frame(kind: str, turns: np.ndarray, places: np.ndarray) -> str:
        texts = (" ".join(f"{x:.6f}" for x in part.flat) for part in (turns, places))
        return '<frame type="{}"><orientation>{}</orientation><position>{}</position></frame>'.format(kind, *texts)

    identity = np.tile([1.0, 0, 0, 0], (len(index), 1))
    frames = frame("identity", identity, place[0]) + "".join(map(frame, ["normal"] * len(turn), turn, place))
    subject = (
        f'<subject label="a" frameRate="{rate:g}"><segments>{segments}</segments><frames>{frames}</frames></subject>'
    )
    return f'<?xml version="1.0" encoding="UTF-8"?><mvnx version="4">{subject * people}</mvnx>'


def test_a_motion_is_read_without_options(tmp_path: Path, short_clip: Clip) -> None:
    path = tmp_path / "take.mvnx"
    path.write_text(mvnx(short_clip.pose))
    clip = read(path)
    assert isinstance(clip, Clip)
    found, truth = (
        np.asarray(forward_kinematics(pose)[0])[:, pose.skeleton.indices(BODY)] for pose in (clip.pose, short_clip.pose)
    )
    found, truth = (place - place.mean(axis=(0, 1)) for place in (found, truth))  # the floor may be moved
    assert clip.frame_rate == 60 and len(clip) == len(short_clip) and not clip.warnings
    assert np.linalg.norm(found - truth, axis=-1).max() < 0.002


def test_of_two_people_one_is_chosen(tmp_path: Path, short_clip: Clip) -> None:
    path = tmp_path / "take.mvnx"
    path.write_text(mvnx(short_clip.pose, people=2))
    with pytest.raises(BodysenseError, match=r"2 bodies in it: .*; choose one with --figure 1"):
        read(path)
    second = read(path, ReadingOptions(figure=2))
    assert isinstance(second, Clip) and len(second) == len(short_clip)


BOMB = '<?xml version="1.0"?><!DOCTYPE mvnx [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]><mvnx>&b;</mvnx>'
DAMAGED: dict[str, tuple[Callable[[str], str], str]] = {
    "entities": (lambda _: BOMB, "declares entities"),
    "depth": (lambda _: "<mvnx>" + "<a>" * 100_000, "more than 32 elements in one another"),
    "another root": (lambda text: text.replace("mvnx", "html"), "begins with <html>"),
    "cut short": (lambda text: text[: len(text) // 2], "not XML of MVN"),
    "no frames": (lambda text: text.replace("normal", "tpose"), "no frames of motion"),
    "a missing number": (lambda text: text.replace("<position>", "<position>1 ", 2), "a frame has not 23 orientations"),
    "no number": (lambda text: text.replace("<position>", "<position>x", 2), "not numbers in <position>"),
    "not finite": (lambda text: text.replace("<orientation>1.0", "<orientation>1e999 -1.0", 2), ""),
    "no rate": (lambda text: text.replace('frameRate="60"', 'frameRate="fast"'), "frameRate is 'fast'"),
    "other segments": (lambda text: text.replace('label="Pelvis"', 'label="Base"'), "not those of MVN"),
}


@pytest.mark.parametrize("what", DAMAGED)
def test_damaged_and_hostile_files_are_refused_in_one_line(what: str, short_clip: Clip) -> None:
    change, message = DAMAGED[what]
    with pytest.raises(BodysenseError, match=f"take.mvnx: .*{message}"):
        parse_mvnx(change(mvnx(short_clip.pose[:3])).encode(), Path("take.mvnx"))
