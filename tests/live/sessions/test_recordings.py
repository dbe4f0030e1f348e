"""Recordings on disks that fail: valid files, a notice, and no wearer who waits."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest

from bodysense.io.formats.bvh import BvhWriter, mend_bvh, read_bvh
from bodysense_live.security.safety import Limits, RecordingLimits
from bodysense_live.server.messages import RecordSwitch
from bodysense_live.server.settings import ServerSettings
from bodysense_live.sessions import recorder as module
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.recorder import LONGEST_GAP, RATE, Recorder, mend_recordings
from bodysense_live.sessions.session import Session

from ..conftest import DEVICES, Client, Connecting, Serving, signal

OPERATIONS = ("write", "seek", "truncate", "close")
ERRORS = (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EROFS, errno.ESTALE)
LIMITS = RecordingLimits()
SESSION = 16 * "a"


class Killed(BaseException):
    """The process ends here."""


@dataclass
class Disk:
    """Files whose `count`-th call of `operation`, and all later ones if `stays`, call `fail`; writes may be partial."""

    operation: str
    count: int
    fail: Callable[[], object]
    stays: bool = True
    part: float = 1.0  # share of the bytes of each write that is taken
    failing_part: float = 0.5  # share of the bytes that a failing write takes before it fails
    calls: int = 0
    opened: list[IO[bytes]] = field(default_factory=list)

    def meets(self, operation: str) -> bool:
        if operation != self.operation:
            return False
        self.calls += 1
        return self.calls == self.count or (self.stays and self.calls > self.count)

    def open(self, path: Path) -> Any:
        if self.meets("open"):
            self.fail()
        self.opened.append(path.open("xb", buffering=0))
        return FaultyFile(self.opened[-1], self)


class FaultyFile:
    """An unbuffered file on a failing disk."""

    def __init__(self, file: IO[bytes], disk: Disk) -> None:
        self._file, self._disk = file, disk

    def write(self, data: Any) -> int:
        if self._disk.meets("write"):
            self._file.write(data[: int(len(data) * self._disk.failing_part)])
            self._disk.fail()
        return self._file.write(data[: max(1, int(len(data) * self._disk.part))])

    def seek(self, *place: int) -> int:
        if self._disk.meets("seek"):
            self._disk.fail()
        return self._file.seek(*place)

    def truncate(self) -> int:
        if self._disk.meets("truncate"):
            self._disk.fail()
        return self._file.truncate()

    def close(self) -> None:
        self._file.close()
        if self._disk.meets("close"):
            self._disk.fail()


def raising(number: int) -> Callable[[], None]:
    def fail() -> None:
        raise OSError(number, os.strerror(number))

    return fail


@cache
def answers(count: int = 200) -> tuple[Answer, ...]:
    """Return answers at 60 Hz."""
    session, found = Session(DEVICES), []
    for k in range(count):
        session.receive(signal(k, k / RATE), k / RATE)
        answer = session.step()
        assert answer is not None
        found.append(answer)
    return tuple(found)


def at_moments(moments: list[float]) -> list[Answer]:
    return [replace(answer, moment=moment) for answer, moment in zip(answers(), moments, strict=False)]


def recorder_in(folder: Path, limits: RecordingLimits = LIMITS) -> Recorder:
    return Recorder(folder, SESSION, answers()[0].pose.skeleton, limits)


def faults() -> Iterator[tuple[str, int, int]]:
    """Yield calls that fail, their number and their error: every early call of each kind, and some later ones."""
    rng = np.random.default_rng(7)
    for operation in ("open", *OPERATIONS):
        for count in (1, 2, 3, 4, *rng.integers(5, 20, 2).tolist()):
            yield operation, count, int(rng.choice(ERRORS))


@pytest.mark.parametrize("stays", [True, False])
def test_an_error_of_the_disk_ends_with_a_valid_file_and_a_notice(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, stays: bool
) -> None:
    for case, (operation, count, number) in enumerate(faults()):
        folder = tmp_path / str(case)
        folder.mkdir()
        check_fault(monkeypatch, folder, operation, count, number, stays)


def check_fault(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, operation: str, count: int, number: int, stays: bool
) -> None:
    disk = Disk(operation, count, raising(number), stays, part=0.7)
    monkeypatch.setattr(module, "open_file", disk.open)
    one = recorder_in(tmp_path)
    notices = [one.open(), *(one.write(answers()[k : k + 20]) for k in range(0, 200, 20)), one.close()]
    told = [text for text in notices if text is not None]
    has_failed = disk.calls >= count
    assert len(told) == (2 if "recording to" in told[0] else 1)
    assert (os.strerror(number) in told[-1]) == has_failed
    cut_short = operation == "truncate" or (operation == "seek" and stays)  # the file cannot be cut back
    files = list(tmp_path.iterdir())
    for file in files:
        if cut_short:
            assert has_failed or operation == "truncate"
            mend_bvh(file)
        assert f"{len(read_bvh(file))} frames to {file.name}" in told[-1] or cut_short
    assert files or "nothing was recorded" in told[-1]
    assert has_failed or len(read_bvh(files[0])) == 200


@pytest.mark.parametrize(("operation", "part"), [("write", 0.0), ("write", 0.3), ("write", 1.0), ("seek", 0.0)])
def test_the_remains_of_a_killed_server_are_a_motion(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, operation: str, part: float
) -> None:
    """The server is killed in each of the first 23 calls."""

    def end() -> None:
        raise Killed

    for count in range(1, 24):
        disk, folder = Disk(operation, count, end, failing_part=part), tmp_path / str(count)
        folder.mkdir()
        monkeypatch.setattr(module, "open_file", disk.open)
        one, written = recorder_in(folder), 0
        with pytest.raises(Killed):
            one.open()
            for k in range(0, 200, 10):
                one.write(answers()[k : k + 10])
                written = k + 10
        disk.opened[0].close()
        (file,) = folder.iterdir()
        left = file.read_bytes()
        mend_recordings(folder)
        assert file.read_bytes() == left  # its writer may still run
        os.utime(file, (time.time() - 60, time.time() - 60))
        mend_recordings(folder)
        if written:
            clip = read_bvh(file)
            assert written <= len(clip) <= written + 10, count
            assert np.abs(clip.pose.root_position[:, 1] - clip.pose.root_position[0, 1]).max() < 0.2, count
        assert not mend_bvh(file) or not written, f"{count}: mended once"


def test_a_finished_file_is_never_mended(tmp_path: Path) -> None:
    one = recorder_in(tmp_path)
    one.open()
    one.write(answers())
    one.close()
    (file,) = tmp_path.iterdir()
    before = file.read_bytes()
    assert not mend_bvh(file) and file.read_bytes() == before
    other = tmp_path / "other.bvh"
    other.write_bytes(b"HIERARCHY\n" + before[20:])
    assert not mend_bvh(other)


def test_a_file_is_valid_after_each_write(tmp_path: Path) -> None:
    path = tmp_path / "a.bvh"
    with path.open("xb", buffering=0) as file:
        writer = BvhWriter(file, answers()[0].pose.skeleton, RATE)
        for k, answer in enumerate(answers()[:80]):
            pose = replace(
                answer.pose, root_position=answer.pose.root_position[None], rotation=answer.pose.rotation[None]
            )
            writer.append(np.array([answer.moment]), pose)
            if k:
                assert len(read_bvh(path)) == writer.frames >= k


@pytest.mark.parametrize("seed", range(6))
def test_a_recording_is_cut_at_gaps(tmp_path: Path, seed: int) -> None:
    """Steps of any length: files hold the pieces between gaps, and no row for the time of a gap."""
    rng = np.random.default_rng(seed)
    steps = rng.choice([1 / 60, 1 / 30, 0.2, 0.95, 1.05, 2.0], 150, p=[0.5, 0.2, 0.1, 0.05, 0.05, 0.1])
    moments = np.cumsum(steps)
    one = recorder_in(tmp_path)
    one.open()
    size = int(rng.integers(1, 64))
    row = at_moments(moments.tolist())
    for k in range(0, len(row), size):
        assert one.write(row[k : k + size]) is None
    one.close()
    pieces = np.split(moments, np.flatnonzero(np.diff(moments) > LONGEST_GAP) + 1)
    lengths = [len(read_bvh(file)) for file in tmp_path.iterdir()]
    expected = [max(1, (piece[-1] - piece[0]) * RATE) for piece in pieces]
    np.testing.assert_allclose(sorted(lengths), sorted(expected), atol=1.01)


def test_gaps_without_end_end_the_recording(tmp_path: Path) -> None:
    one = recorder_in(tmp_path)
    one.open()
    text = one.write(at_moments((2.0 * np.arange(200)).tolist()))
    assert text is not None and "100 gaps" in text and "99 more files" in text
    assert len(list(tmp_path.iterdir())) == 100


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        (RecordingLimits(seconds=2.0), "maximum length, 2 s"),
        (RecordingLimits(megabytes=0.05), "maximum size, 0.05 MB"),
        (RecordingLimits(folder_megabytes=0.05), "has its 0.05 MB"),
    ],
)
def test_recordings_are_bounded(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, limits: RecordingLimits, expected: str
) -> None:
    monkeypatch.setattr(module, "_MEASURE_INTERVAL", 0.0)
    one = recorder_in(tmp_path, limits)
    one.open()
    notices = [one.write(answers()[k : k + 10]) for k in range(0, 200, 10)]
    (text,) = [text for text in notices if text is not None]
    assert expected in text and len(notices) > notices.index(text) + 1
    (file,) = tmp_path.iterdir()
    assert file.stat().st_size < 300_000 and len(read_bvh(file)) < 200
    assert one.close() is None


def test_a_folder_with_too_many_files_takes_no_recording(tmp_path: Path) -> None:
    for _ in range(3):
        one = recorder_in(tmp_path)
        one.open()
        one.write(answers())
        one.close()
    assert len({file.name for file in tmp_path.iterdir()}) == 3  # of one session, within a second
    assert "has its 3 files" in recorder_in(tmp_path, RecordingLimits(folder_files=3)).open()


def notice(client: Client, word: str) -> str:
    """Return the next notice with a word."""
    while word not in (text := client.text("said")["text"]):
        pass
    return text


@pytest.mark.parametrize("case", ["open", "write", "close", "bug", "hangs at once", "hangs later"])
def test_no_fault_of_the_disk_reaches_a_wearer(
    server_of: Serving, connect: Connecting, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, case: str
) -> None:
    released = threading.Event()

    def bug() -> None:
        raise ZeroDivisionError

    if case.startswith("hangs"):
        disk = Disk("open" if "once" in case else "write", 1 if "once" in case else 4, lambda: released.wait(60))
    else:
        operation = "write" if case == "bug" else case
        disk = Disk(operation, 1 if case in ("open", "close") else 4, bug if case == "bug" else raising(errno.ENOSPC))
    monkeypatch.setattr(module, "open_file", disk.open)
    monkeypatch.setattr("bodysense_live.sessions.recordings._BATCH", 4)  # poses, so that few frames fill the queue
    server = server_of(ServerSettings(allow_record=tmp_path, limits=replace(Limits(), messages_a_second=10_000.0)))
    recording, other = connect(server), connect(server)
    recording.send_message(RecordSwitch(True))
    for k in range(70):
        for one in (recording, other):  # which wait for 10 s, less than a disk hangs
            assert one.answered(signal(k, k / 72)).sequence == k
    third = connect(server)
    assert third.answered(signal(0, 0.0)).sequence == 0
    recording.send_message(RecordSwitch(False))
    if case.startswith("hangs"):
        assert "too slow" in notice(recording, "the recording ended")
    else:
        notice(recording, "the recording ended" if case != "bug" else "failed to write it")
    released.set()
    assert recording.answered(signal(800, 20.0)).sequence == 800


def test_a_killed_server_leaves_what_was_recorded(tmp_path: Path) -> None:
    """A real process, ended by SIGKILL while it writes."""
    code = (
        "import os, signal, sys\n"
        "from tests.live.sessions.test_recordings import answers, recorder_in\n"
        "from pathlib import Path\n"
        "one = recorder_in(Path(sys.argv[1]))\n"
        "one.open()\n"
        "one.write(answers()[:64]); one.write(answers()[64:128])\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False, cwd=Path(__file__).parents[3])
    (file,) = tmp_path.iterdir()
    assert not file.name.startswith(".") and len(read_bvh(file)) == 128
