"""`bodysense serve` and `calibrate` on the command line."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.devices.simulated.device import simulate
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.recording import Recording, write_recording
from bodysense.io.reading_options import ReadingOptions
from bodysense_live.commands import serve_settings
from bodysense_live.commands.serve_options import AccessOptions, LoadOptions
from bodysense_live.commands.serve_settings import access_of, address_of, playable_of, shared_of
from bodysense_live.security.safety import Access
from bodysense_live.server.settings import ServerSettings

from ..conftest import Refused
from .conftest import Serving

pytest.importorskip("uvicorn", reason="needs packages/live")


def test_a_port_in_use(refused: Refused) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert refused("serve", "--port", port) == (
            f"--port {port} is in use by another program; stop it or choose another --port (0 takes any)"
        )


def test_a_udp_port_in_use(refused: Refused) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        line = refused("serve", "--port", 0, "--vmc-in", port)
        assert line == f"--vmc-in {port} is in use by another program; stop it or choose another --vmc-in (0 takes any)"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--workers", 2, "--vmc-in", 39539), "UDP needs a single process"),
        (("--vrchat-out", "localhost:99999"), "give HOST:PORT"),
        (("--vmc-out", "no.such.host.invalid:39539"), "--vmc-out no.such.host.invalid:39539"),
        (("--allow-record", "no/such/folder"), "no such folder"),
        (("--replay", "no-such-file.npz"), "no such file"),
        (("--device", "three_point"), "give it with --replay"),
        (("--device-names", "names.json"), "give --vmc-in, --vmt or --slimevr"),
        (("--vrchat", "--vrchat-host", "no.such.host.invalid"), "--vrchat-host no.such.host.invalid: no such host"),
        (("--slimevr", "--slimevr-host", "no.such.host.invalid"), "--slimevr-host no.such.host.invalid: no such host"),
        (("--workers", 2, "--camera", 0), "--camera needs a single process"),
        (("--camera", -1), "--camera -1: give the index of a webcam"),
        (("--landmarkers", "models"), "--landmarkers models: is for a webcam; give --camera"),
        (("--workers", 2, "--solarxr"), "UDP needs a single process"),
        (("--workers", 2, "--slimevr"), "UDP needs a single process"),
        (("--markers", "host"), "--markers host: give natnet://HOST (OptiTrack), qtm://HOST"),
        (("--markers", "qtm://no.such.host.invalid"), "--markers no.such.host.invalid: no such host"),
        (("--markers", "qtm://localhost", "--markers-in", 9123), "give one of them"),
        (("--workers", 2, "--markers", "qtm://localhost"), "--markers needs a single process"),
        (("--record", "take.csv"), "--record: for --markers"),
        (("--markers", "qtm://localhost", "--record", "take.c3d"), "recorded as .csv"),
        (("--markers", "qtm://localhost", "--up", "x"), "--up x: of marker files it is one of y, z"),
        (("--bridge",), "--bridge has nowhere to send to; give --vmc-out"),
        (("--vmt", "--vmt-host", "no.such.host.invalid"), "--vmt-host no.such.host.invalid"),
        (("--vmt", "--vmt-first", -1), "give 0 to 48"),
        (("--vmt", "--vmt-first", 49), "give 0 to 48"),
    ],
)
def test_wrong_options_are_refused(refused: Refused, arguments: tuple[object, ...], expected: str) -> None:
    port = () if "--port" in arguments else ("--port", 0)
    assert expected in refused("serve", *port, *arguments)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (None, "--token-file {file}: cannot be read ("),
        ("", "--token-file {file}: 0 words; give a text file with one secret"),
        ("two words of-it", "--token-file {file}: 3 words; give a text file with one secret"),
        ("short", "--token: give at least 8 characters"),
    ],
)
def test_a_wrong_token_file_is_refused(refused: Refused, tmp_path: Path, text: str | None, expected: str) -> None:
    file = tmp_path / "token"
    if text is not None:
        file.write_text(text)
    line = refused("serve", "--port", 0, "--token-file", file)
    assert line.startswith(expected.format(file=file)) and "of-it" not in line


def test_the_printed_address_has_the_token_if_there_is_one() -> None:
    assert address_of(Access(), 8765, lan=False) == "http://127.0.0.1:8765/"
    assert address_of(Access(host="::1", token="secret-token"), 80, lan=False) == "http://[::1]:80/?token=secret-token"


def test_secrets_are_read_from_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "token").write_text("a-secret-token\n")
    (tmp_path / "valkey").write_text("a/pass@word\n")
    options = AccessOptions(token_file=tmp_path / "token", trusted_proxy=("10.0.0.0/8",))
    found = access_of(options, ())
    assert found.token == "a-secret-token" and found.trusted_proxies == ("10.0.0.0/8",)
    with pytest.raises(BodysenseError, match="give one of them"):
        access_of(replace(options, token="another-token"), ())
    monkeypatch.setattr(serve_settings, "check_store", lambda address: address)
    load = LoadOptions(shared="redis://here:6379/0", shared_password_file=tmp_path / "valkey")
    assert shared_of(load) == "redis://:a%2Fpass%40word@here:6379/0"
    for wrong in (replace(load, shared=None), replace(load, shared="redis://:x@here")):
        with pytest.raises(BodysenseError, match="--shared"):
            shared_of(wrong)


def test_a_system_without_a_socket_folder_is_refused(refused: Refused, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("XDG_RUNTIME_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    assert "XDG_RUNTIME_DIR is not set" in refused("serve", "--port", 0, "--solarxr")


@pytest.mark.parametrize(
    ("table", "option", "expected"),
    [
        ('{"AA:01:02:03:04:05": "left_knee"}', "--vmt", "AA:01:02:03:04:05 is a SlimeVR tracker; give --slimevr"),
        ('{"AA:01:02:03:04:05": "left_toe"}', "--slimevr", "'left_toe' (for 'AA:01:02:03:04:05') is not a joint"),
        ('{"LHR-1": "left_knee"}', "--slimevr", "'LHR-1' is a device of VMC or SteamVR; give --vmc-in or --vmt"),
    ],
)
def test_a_table_of_devices_of_another_input_is_refused(
    refused: Refused, tmp_path: Path, table: str, option: str, expected: str
) -> None:
    path = tmp_path / "names.json"
    path.write_text(table)
    assert expected in refused("serve", "--port", 0, option, "--device-names", path)


def test_a_motion_needs_a_device(refused: Refused, motion: Path) -> None:
    assert "for a motion, choose a device that tracks it: --device" in refused("serve", "--port", 0, "--replay", motion)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("workers", "end"), [(1, signal.SIGINT), (2, signal.SIGINT), (2, signal.SIGTERM), (2, signal.SIGKILL)]
)
def test_serve_runs_until_it_is_ended(workers: int, end: signal.Signals) -> None:
    command = [sys.executable, "-m", "bodysense", "serve", "--port", "0", "--workers", str(workers)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stderr is not None
        try:
            line = process.stdout.readline()
            address = re.search(r"http://127\.0\.0\.1:\d+/", line)
            assert address is not None, line
            for _ in range(4):
                with urllib.request.urlopen(f"{address[0]}healthz", timeout=20) as response:
                    assert response.read() == b"ok\n"
            with urllib.request.urlopen(f"{address[0]}metrics", timeout=20) as response:
                assert b"bodysense_frames" in response.read()
                if end == signal.SIGKILL:  # while a worker's report of the ended connection is unread
                    process.send_signal(signal.SIGSTOP)
            time.sleep(0.3)
        finally:
            process.send_signal(end)
        try:
            # The output ends only when no worker holds it any more.
            errors = process.communicate(timeout=30)[1]
        finally:
            process.kill()  # a process that continues fails here, without blocking the tests
        assert process.returncode in (0, 130, -end) and "Traceback" not in errors


def test_calibrate_distinguishes_a_wrong_token_from_a_missing_server(refused: Refused, server_of: Serving) -> None:
    server = server_of(ServerSettings(Access(token="secret-token")))
    for address in (f"{server.http}/", f"{server.http}/?token=wrong-token"):
        reason = refused("calibrate", address)
        assert "the server refuses this address (the token is missing or wrong); give the address that" in reason


def test_calibrate_needs_a_tracked_wearer(refused: Refused) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    assert "is `bodysense serve` running?" in refused("calibrate", f"http://127.0.0.1:{port}/")
    for address in ("localhost", "http://", "ftp://127.0.0.1/", "http://[::1", "http://127.0.0.1:99999/"):
        assert refused("calibrate", address).startswith(f"{address}: give the address that `bodysense serve` printed")


def test_a_replayed_recording_follows_the_reading_options(tmp_path: Path, waving_clip: Clip, refused: Refused) -> None:
    seen, path = simulate(waving_clip, "three_point"), tmp_path / "seen.npz"
    write_recording(path, Recording(replace(seen, position=seen.position * 100), waving_clip.pose.skeleton))
    played = playable_of(path, None, ReadingOptions(unit="cm"), Person())
    assert played is not None
    np.testing.assert_allclose(played.observation.position, seen.position, rtol=1e-6)
    assert "--figure is for motions, not for recordings" in refused("serve", "--replay", path, "--figure", 1)
