"""The page in headless Chromium, against a server of its own kind and against the real one."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from bodysense.body.rotation import quaternion_log
from bodysense.body.skeleton import default_skeleton
from bodysense.data.bvh import read_bvh, write_bvh
from bodysense.data.clip import Clip

pytestmark = pytest.mark.slow

Scenario = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def address(waving_clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A real server that replays somebody who waves, watched by a headset and two controllers."""
    pytest.importorskip("starlette", reason="needs bodysense[serve]")
    motion = tmp_path_factory.mktemp("replay") / "waving.bvh"
    write_bvh(motion, waving_clip)
    command = [sys.executable, "-m", "bodysense", "serve", "--port", "0"]
    command += ["--replay", str(motion), "--device", "three_point"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        found = next(filter(None, (re.search(r"http://\S+", line) for line in server.stdout)), None)
        assert found is not None
        yield found.group()
        server.terminate()


def picture_of(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path).convert("RGB"), dtype=np.float64)


def error_of(facts: dict[str, Any]) -> float:
    """The true error in cm that the page shows."""
    found = re.search(r"true error ([\d.]+) cm", facts["shown"])
    assert found is not None, facts
    return float(found.group(1))


def test_a_replay_is_watched_and_sensors_are_switched_off(scenario: Scenario, address: str, tmp_path: Path) -> None:
    said = scenario("watch", address, tmp_path / "watch.png")
    assert "left wrist, right wrist measured" in said["before"]["status"]
    assert "head measured" in said["headOnly"]["status"] and said["headOnly"]["off"] == 2
    assert error_of(said["headOnly"]) > error_of(said["before"])
    assert not said["notice"]
    stage = picture_of(tmp_path / "watch.png")[60:700, :900]
    blue = (stage[..., 2] > stage[..., 0] + 40).mean()  # a body that is sure of itself
    assert blue > 0.005


def test_a_wearer_sees_themselves(scenario: Scenario, address: str, tmp_path: Path) -> None:
    said = scenario("wear", address, tmp_path / "vr.png")
    assert "left wrist, right wrist measured" in said["controllers"]["status"]
    assert "There and back" in said["controllers"]["there"]
    assert said["hands"]["joints"] == 51  # the viewer and 25 joints a hand
    assert not said["notice"], said["said"]
    controllers, hands = picture_of(tmp_path / "vr.png"), picture_of(tmp_path / "vr_hands.png")
    assert controllers.std() > 3  # something is drawn
    assert np.abs(controllers - hands).mean() > 0.01  # the arms moved


@pytest.fixture(scope="module")
def used(scenario: Scenario, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("use")
    return folder, scenario("use", folder)


Used = tuple[Path, dict[str, Any]]


def test_every_control_has_a_name(used: Used) -> None:
    assert used[1]["unnamed"] == []


def test_keys_steer_the_timeline(used: Used) -> None:
    keys = used[1]["keys"]
    assert 0 < keys["stepped"] < 0.2  # s: a frame
    assert keys["whilePaused"] == "false"
    assert keys["button"] == "Pause"


def test_settings_go_to_the_server_and_stay(used: Used) -> None:
    told = [message for message in used[1]["told"] if message["type"] == "settings"]
    assert [message for message in used[1]["told"] if message["type"] == "recentre"]
    assert {"type": "settings", "height": 1.83} in told
    assert {"type": "settings", "posture": "seated"} in told
    assert {"type": "settings", "hidden": ["left_controller"]} in told
    settings = used[1]["helloAfterReload"]["settings"]
    assert (settings["height"], settings["posture"]) == (1.83, "seated")
    assert settings["regions"] == ["torso", "head", "arms", "legs"]
    assert used[1]["themeAfterReload"] == "dark"


def test_a_file_that_is_no_avatar_is_refused_in_one_line(used: Used) -> None:
    assert "song.mp3 is no VRM avatar; drop a .vrm file" in used[1]["wrongAvatar"]
    assert used[1]["hugeAvatar"].startswith("huge.vrm has 300 MB; an avatar may have 200 MB")
    assert "\n" not in used[1]["wrongAvatar"] + used[1]["hugeAvatar"]
    assert used[1]["noticeAfterAvatar"] is False


def test_the_saved_bvh_is_the_motion(used: Used) -> None:
    """The fake server swings both shoulders about z (web/tests/browser/fake_server.mjs)."""
    clip, skeleton = read_bvh(used[0] / "motion.bvh"), default_skeleton()
    assert abs(clip.frame_rate - 12) < 1
    read, joints = clip.pose.skeleton, skeleton.joints
    assert set(read.joints) == set(joints)
    offset = read.rest_offset[read.indices(joints)][1:]
    np.testing.assert_allclose(offset, skeleton.rest_offset[1 : len(joints)], atol=1e-5)
    turn = quaternion_log(clip.pose.rotation[:, read.index("left_shoulder")])
    np.testing.assert_allclose(turn[:, :2], 0, atol=1e-3)
    # However late it was saved: 0.2 times a sine of four seconds, which three frames in a row tell from anything else.
    sine = turn[:, 2] / -1.1 - 1.1
    assert len(sine) > 3 and np.abs(sine).max() < 0.21 and np.ptp(sine) > 0
    share = 2 * np.cos(np.pi / 2 / clip.frame_rate)
    np.testing.assert_allclose(sine[2:] + sine[:-2], share * sine[1:-1], atol=2e-3)


def test_the_saved_gltf_is_valid(used: Used, web: Path) -> None:
    code = (
        "const { validateBytes } = require('gltf-validator');"
        "validateBytes(require('fs').readFileSync(process.argv[1])).then(({ issues, info }) =>"
        " console.log(issues.numErrors, issues.numWarnings, info.animationCount, info.drawCallCount))"
    )
    command = ["node", "-e", code, str(used[0] / "motion.glb")]
    done = subprocess.run(command, cwd=web, capture_output=True, text=True, check=True)
    errors, warnings, animations, draws = map(int, done.stdout.split())
    assert (errors, warnings, animations) == (0, 0, 1)
    assert draws > 20


def test_what_a_server_does_wrong_is_said_in_one_line(scenario: Scenario) -> None:
    said = scenario("refusals")["said"]
    assert said["refused"] == {"text": "protocol version 1; this server speaks 2: reload the page", "canRetry": True}
    for case in ("nonsense", "cut"):
        assert said[case]["text"].startswith("The server sent what this page does not understand")
    assert "is `bodysense serve` running" in said["gone"]["text"]
    assert not said["gone"]["canRetry"]  # the page tries by itself


def test_a_line_that_breaks_is_taken_up_again(scenario: Scenario) -> None:
    facts = scenario("resume")
    asked = [hello["resume"] for hello in facts["hellos"] if hello["watch"] == "replay"]
    assert len(asked) == 3 and asked[0] is None
    assert asked[1] == asked[2] == {"session": "s1", "token": "t1"}
    assert facts["status"].endswith("points measured") and not facts["notice"]
