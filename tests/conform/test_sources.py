"""Files and streams as subjects: all formats give the same body; unreadable files are refused in one line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from bodysense.body.pose import Pose
from bodysense.cli import main
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.mcap_take import BODY_JOINTS, BODY_LAYOUT
from bodysense.io.formats.mcap_take import record as mcap_record
from bodysense.io.formats.protocol import PoseFrame, write_pose
from bodysense.io.motion_files import write_motion
from bodysense_conform.evaluate import judge
from bodysense_conform.report.html import page
from bodysense_conform.report.text import record
from bodysense_conform.script import read_script
from bodysense_conform.sources.files import clip_subject, read_subject
from bodysense_conform.sources.mcap_take import read_mcap, read_record
from bodysense_conform.sources.vmc import vmc_subject
from bodysense_conform.sources.websocket import messages_subject
from bodysense_conform.subject import Step, Subject
from bodysense_live.protocols.vmc import vmc_packets

from .conftest import RATE


@pytest.fixture(scope="module")
def clip(performed: tuple[Pose, list[Step]]) -> Clip:
    return Clip("stands", performed[0][:120], RATE)


@pytest.mark.parametrize("ending", ["bvh", "glb", "vrma", "mcap"])
def test_every_format_gives_the_same_body(ending: str, clip: Clip, tmp_path: Path) -> None:
    path = tmp_path / f"take.{ending}"
    write_motion(path, clip)
    subject, truth = read_subject(path), clip_subject(clip, "")
    same = [truth.points.index(name) for name in subject.points]
    off = np.abs(subject.position - truth.position[:, same])
    assert off[:, subject.rotated].max() < 1e-5  # not every format has end sites, which are made of usual lengths
    turned = [k for k, name in enumerate(subject.points) if subject.rotated[k] and "thumb" not in name]
    cosine = np.abs((subject.rotation * truth.rotation[:, same]).sum(axis=-1))[:, turned]
    assert cosine.min() > 1 - 1e-5
    assert judge(subject).judgement == "pass"


def test_vmc_gives_the_same_body_and_counts_what_it_cannot_read(clip: Clip) -> None:
    packets = [(k / RATE, p) for k in range(60) for p in vmc_packets(clip.pose[k], k / RATE)]
    subject = vmc_subject([*packets[:30], (0.5, b"nonsense"), *packets[30:]], "vmc:1")
    truth = clip_subject(clip, "")
    same = [truth.points.index(name) for name in subject.points]
    assert np.abs(subject.position - truth.position[: len(subject), same]).max() < 1e-3
    assert subject.transport.malformed == 1
    assert {one.check.id for one in judge(subject).of("fail")} == {"stream.malformed"}


@given(st.binary(max_size=900))
def test_no_bytes_break_the_reader_of_records(data: bytes) -> None:
    read_record(data, BODY_LAYOUT, len(BODY_JOINTS))


@given(st.integers(0, 900), st.integers(0, 255))
def test_a_changed_byte_breaks_no_record(place: int, value: int) -> None:
    data = bytearray(mcap_record(np.zeros(len(BODY_JOINTS), dtype=BODY_LAYOUT), (1, 2, 3)))
    data[place % len(data)] = value
    read_record(bytes(data), BODY_LAYOUT, len(BODY_JOINTS))


def test_a_record_without_a_body_is_one_that_tracks_nothing() -> None:
    found = read_record(mcap_record(None, (5, 6, 7)), BODY_LAYOUT, len(BODY_JOINTS))
    assert found is not None
    assert not found[0]["valid"].any()
    assert tuple(found[1].tolist()) == (5, 6, 7)


def test_reports_hold_every_finding(clean: Subject) -> None:
    verdict = judge(replace(clean, rotation=1.01 * clean.rotation, name="<a & b>\x00"))
    report = json.loads(json.dumps(record(verdict), allow_nan=False))
    assert report["judgement"] == "fail"
    assert len(report["findings"]) == len(verdict.findings)
    assert report["unanswered"] == verdict.unanswered and verdict.unanswered
    text = page(verdict)
    assert "data.unit_quaternions" in text and "&lt;a &amp; b&gt;" in text
    assert all(reason in text for reason in ("time.lag", "no reference"))


def test_a_take_that_unpacks_to_far_more_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "take.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start()
        channel = writer.register_channel("/body", "flatbuffer", writer.register_schema("x", "flatbuffer", b""))
        writer.add_message(channel, 0, bytes(300 << 20), 0)
        writer.finish()
    with pytest.raises(BodysenseError, match="was it made to fill memory"):
        read_mcap(path)


def test_the_command_says_by_its_status_what_was_found(clip: Clip, tmp_path: Path) -> None:
    good, bad = tmp_path / "good.mcap", tmp_path / "bad.mcap"
    write_motion(good, clip)
    root = clip.pose.root_position.copy()
    root[60:, 0] += 1.0
    write_motion(bad, replace(clip, pose=replace(clip.pose, root_position=root)))
    assert main(["conform", str(good), "--html", str(tmp_path / "a.html"), "--json", str(tmp_path / "a.json")]) == 0
    assert main(["conform", str(bad)]) == 1
    assert main(["conform", str(tmp_path), "--json", str(tmp_path / "all.json")]) == 1
    assert json.loads((tmp_path / "all.json").read_text())["counts"] == {"pass": 1, "fail": 1}
    (tmp_path / "good.labels.json").write_text(json.dumps({"steps": [{"label": "squat", "start": 1, "end": 4}]}))
    assert main(["conform", str(good)]) == 2  # a missing squat: to be taken again


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.mcap", b"no container", "not a whole MCAP file"),
        ("a.glb", b"glTF\x02", "a .glb file without its JSON"),
        ("a.gltf", b"[]", "not glTF 2.0"),
        ("a.gltf", b'{"asset": {"version": "2.0"}}', "nothing in it is animated"),
        ("a.xyz", b"x", "unknown kind of file"),
        ("a.bvh", b"nothing", "is not a BVH file"),
    ],
)
def test_unreadable_files_are_refused(name: str, content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BodysenseError, match=message):
        read_subject(tmp_path / name)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nothing", "is not JSON"),
        ("[]", "has no 'steps'"),
        (json.dumps({"steps": [{"start": 1}]}), "has no 'label'"),
        (json.dumps({"steps": [{"label": "hop", "start": 1, "end": 2}]}), "unknown label 'hop'"),
        (json.dumps({"steps": [{"label": "squat", "start": 1}]}), "has no 'end'"),
    ],
)
def test_a_broken_script_is_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "s.json"
    path.write_text(text)
    with pytest.raises(BodysenseError, match=message):
        read_script(path)


def test_scripts_of_others_are_read(tmp_path: Path) -> None:
    path = tmp_path / "s.json"
    path.write_text(json.dumps({"steps": [{"label": "squat_x2", "start_ns": 10**9, "end_ns": 3 * 10**9}]}))
    assert read_script(path) == (Step("squat", 1.0, 3.0),)


def test_the_server_gives_the_same_body_and_says_what_it_completes(clip: Clip) -> None:
    skeleton, count = clip.pose.skeleton, len(clip.pose.skeleton.points)
    welcome = {
        "type": "welcome",
        "joints": skeleton.joints,
        "points": skeleton.points,
        "parents": skeleton.parents,
        "rest_offset": skeleton.rest_offset.tolist(),
        "settings": {"floor": 0.0},
    }
    hidden = np.zeros(count)
    hidden[skeleton.index("left_wrist")] = 1.0
    frames = [
        write_pose(
            PoseFrame(k, k / RATE, clip.pose.root_position[k], clip.pose.rotation[k], hidden, hidden, np.zeros(4))
        )
        for k in range(60)
    ]
    subject = messages_subject([json.dumps(welcome), *frames, b"\x02cut off"], "ws://here")
    assert np.abs(subject.position - clip_subject(clip, "").position[:60]).max() < 1e-5
    assert subject.measured is not None
    assert not subject.measured[:, subject.points.index("left_wrist")].any() and subject.measured[:, 0].all()
    assert subject.transport.malformed == 1
    with pytest.raises(BodysenseError, match="no pose"):
        messages_subject([json.dumps(welcome)], "ws://here")
