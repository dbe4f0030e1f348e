"""The page in headless Chromium: alone, with an emulated headset, with a fake webcam, and with a server."""

from __future__ import annotations

import contextlib
import re
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from bodysense.body.pose import forward_kinematics
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import read_bvh, write_bvh
from bodysense.io.formats.gltf.motion import read_gltf

pytestmark = [pytest.mark.slow, pytest.mark.alone]

Scenario = Callable[..., dict[str, Any]]
SOON = 10  # s until a body moves, on a busy machine without a graphics card; docs/page.md: 2 s


def picture_of(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path).convert("RGB"), dtype=np.float64)


@pytest.fixture(scope="module")
def used(
    scenario: Scenario, site: Path, waving_clip: Clip, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("use")
    write_bvh(folder / "walk.bvh", waving_clip)
    return folder, scenario("alone/use", site, folder, folder / "walk.bvh")


Used = tuple[Path, dict[str, Any]]
Record = Callable[[str, object], None]


def test_a_visit_fetches_little(used: Used, record_property: Record) -> None:
    record_property("visit_mb", used[1]["sent"] / 1e6)
    assert 4e6 < used[1]["sent"] <= 5e6  # bytes, by the page and by its service worker, of a host that packs nothing
    assert "3 points tracked" in used[1]["summary"]


def test_a_person_moves_soon(scenario: Scenario, site: Path, tmp_path: Path) -> None:
    first = scenario("alone/first", site, tmp_path / "first.png")
    if first["moving"] >= SOON:
        first = scenario("alone/first", site, tmp_path / "first.png")
    assert first["words"] < first["moving"] < SOON
    assert not set(first["before"]) & {"avatar.js", "avatar.vrm.gz"}
    assert picture_of(tmp_path / "first.png")[:, 560:720].std() > 20  # a body is drawn


def test_axe_finds_no_serious_fault(used: Used) -> None:
    assert used[1]["faults"] == []


def test_impossible_heights_are_refused_and_the_timeline_stays(used: Used) -> None:
    for height, notice in zip(("0.2", "9"), used[1]["heights"], strict=True):
        assert notice == f"A height of {height} m is not a person's; give 1 to 2.3 m."
    assert used[1]["timelineKept"]


def test_space_ticks_a_box_and_stops_the_motion_elsewhere(used: Used) -> None:
    assert used[1]["spaceOnBox"] == ["playing", False]
    assert used[1]["spaceOnStage"] == "paused"


def test_unusable_files_are_reported_in_one_line(used: Used) -> None:
    for name in ("song", "film", "broken", "dog", "hound", "headset"):
        assert used[1][name] and "\n" not in used[1][name]


def test_the_webcam_is_offered_where_its_files_are(used: Used, site: Path) -> None:
    assert used[1]["webcam"] == (site / "pose_landmarker_full.task").is_file()


def test_no_legend_stays_when_colours_mean_nothing(used: Used) -> None:
    assert used[1]["legend"] == [False, False]


def test_a_motion_that_is_dropped_is_completed(used: Used) -> None:
    error = re.search(r"([\d.]+) cm from the truth", used[1]["dropped"])
    assert error is not None and float(error.group(1)) < 25


def test_a_dropped_avatar_joins_the_pages_own(used: Used) -> None:
    assert used[1]["avatars"] == ["The page's own", "other.vrm"]


def test_without_a_network_everything_still_works(used: Used) -> None:
    assert "cm from the truth" in used[1]["offline"]


def test_the_saved_bvh_is_a_person(used: Used) -> None:
    clip = read_bvh(used[0] / "motion.bvh")
    assert len(clip) > 2 and len(clip.pose.skeleton.joints) == 52
    assert 1.4 < clip.pose.skeleton.height < 1.9


def test_the_saved_gltf_is_an_armature(used: Used) -> None:
    read = read_gltf(used[0] / "motion.glb")[0]
    assert len(read.pose.skeleton.joints) >= 52


def test_a_wearer_sees_themselves_and_keeps_their_take(scenario: Scenario, site: Path, tmp_path: Path) -> None:
    facts = scenario("headset/headset", site, tmp_path)
    assert "as soon as your head is tracked" in facts["before"]
    assert facts["controllers"]["notice"] == "You are measured."
    assert "43 points" in facts["hands"]["summary"]  # the head, two wrists, and 20 points a hand
    assert re.match(r"The headset is off\. Your take of [\d.]+ s is kept", facts["after"])
    assert facts["refused"].startswith("The headset did not let this page in") and facts["take"] == facts["stillThere"]
    assert facts["room"] == {"isOffered": True, "blend": "alpha-blend"}
    take = read_bvh(tmp_path / "take.bvh")
    assert len(take) > 2
    position, rotation = map(np.asarray, forward_kinematics(take.pose))
    assert np.hypot(*position[0, 0, [0, 2]]) < 0.5  # in the middle, however the wearer stood
    facing = rotation[0, 0]  # wxyz: +Z is turned by less than a right angle
    assert 1 - 2 * (facing[1] ** 2 + facing[2] ** 2) > 0.5
    assert picture_of(tmp_path / "vr.png").std() > 3  # something is drawn


def test_vr_can_be_entered_again_and_again(scenario: Scenario, site: Path, tmp_path: Path) -> None:
    facts = scenario("headset/again", site, tmp_path)
    assert facts["entries"] == [True, True, True]
    assert facts["isOver"]


def test_a_headset_is_followed_at_its_own_rate_without_growth(scenario: Scenario, site: Path) -> None:
    facts = scenario("headset/endurance", site, 20)
    assert facts["rate"] > 50  # Hz, of 72, on a busy machine; docs/page.md has ten minutes
    assert facts["p50"] < 10  # ms
    assert facts["page"]["p50"] < 10  # ms of a frame on the page's own thread: it waits for no step
    assert facts["growth"]["process"] < 0.05  # the timeline is filling up
    assert "3 points tracked" in facts["summary"]


Kept = tuple[Path, dict[str, Any]]


@pytest.fixture(scope="module")
def kept(scenario: Scenario, site: Path, tmp_path_factory: pytest.TempPathFactory) -> Kept:
    folder = tmp_path_factory.mktemp("kept")
    return folder, scenario("alone/kept", site, folder / "take.bvh")


def test_a_take_is_there_after_a_reload(kept: Kept) -> None:
    folder, facts = kept
    seconds = [float(re.findall(r"Take 1: ([\d.]+) s", facts[when])[0]) for when in ("before", "after")]
    assert seconds[0] == seconds[1] > 0.5
    clip = read_bvh(folder / "take.bvh")
    # The file's last frame comes a frame sooner at most, and the page says tenths.
    assert abs((len(clip) - 1) / clip.frame_rate - seconds[0]) < 1 / clip.frame_rate + 0.05
    assert facts["full"] == (
        "This browser's storage is full: your take is kept until you leave the page; save it as a file."
    )
    assert facts["still"] == "Take 1.bvh"


def test_takes_have_names_and_are_cut_and_deleted(kept: Kept) -> None:
    folder, facts = kept
    assert facts["names"] == ["Take 1", "Take 2"]
    assert facts["named"] == "Walk.bvh" and facts["cut"].startswith("Walk: ")
    whole, part = (read_bvh(folder / name) for name in ("take.bvh", "take.bvh.part.bvh"))
    assert abs(len(part) - len(whole) / 2) <= 3
    assert facts["kept"] == {"take": facts["cut"], "count": 1}  # over a reload


def test_a_body_goes_by_a_bridge_to_an_avatar(scenario: Scenario, site: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as avatar:
        avatar.bind(("127.0.0.1", 0))
        avatar.settimeout(1)
        out = f"127.0.0.1:{avatar.getsockname()[1]}"
        with served("--bridge", "--vmc-out", out, found=r"ws://\S+") as address:
            facts = scenario("server/bridge", site, address)
        packets = [avatar.recv(2000) for _ in range(10)]
    assert any(b"/VMC/Ext/Bone/Pos" in packet for packet in packets)
    assert facts["before"]["address"] == address
    assert facts["sending"]["hint"].startswith("Your body is sent there, live. Others watch it at http://")
    assert facts["sending"]["button"] == "Stop sending"
    assert facts["watched"] == "Another wearer"
    assert facts["after"] == {"hint": facts["before"]["hint"], "button": "Send"}
    assert facts["wrong"].startswith("“not an address” is no address of a bridge")
    assert facts["token"]["notice"].startswith("Something answers there, but not to this token: paste the address")
    assert facts["token"]["button"] == "Send"
    assert facts["gone"] == "No bridge answers there; the page keeps trying."


@contextlib.contextmanager
def served(*options: str, found: str) -> Iterator[str]:
    """A real server; what it prints that matches."""
    pytest.importorskip("starlette", reason="needs packages/live")
    command = [sys.executable, "-m", "bodysense", "serve", "--port", "0", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        match = next(filter(None, (re.search(found, line) for line in server.stdout)), None)
        assert match is not None
        try:
            yield match.group()
        finally:
            server.terminate()


@pytest.fixture(scope="module")
def address(waving_clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A real server that replays a waving person, watched by a headset and two controllers."""
    motion = tmp_path_factory.mktemp("replay") / "waving.bvh"
    write_bvh(motion, waving_clip)
    with served("--replay", str(motion), "--device", "three_point", found=r"http://\S+") as found:
        yield found


def test_a_servers_replay_is_watched_and_parts_are_switched_off(
    scenario: Scenario, address: str, tmp_path: Path
) -> None:
    facts = scenario("server/watch", address, tmp_path / "watch.png")
    assert facts["before"]["source"] == "The server's own input"
    errors = [
        float(found.group(1))
        for summary in (facts["before"]["summary"], facts["headOnly"])
        if (found := re.search(r"([\d.]+) cm from the truth", summary))
    ]
    assert len(errors) == 2 and errors[1] > errors[0]
    assert not facts["notice"]


def test_errors_of_a_server_are_reported_in_one_line(scenario: Scenario, site: Path) -> None:
    facts = scenario("server/refusals", site)["notices"]
    reason = "messages of version 1; this server speaks version 2: load its page again, or use its client"
    assert facts["refused"] == {"text": reason, "canRetry": True}
    for case in ("nonsense", "cut"):
        assert facts[case]["text"].startswith("The server sent what this page does not understand")
    assert "is `bodysense serve` running" in facts["gone"]["text"]
    assert not facts["gone"]["canRetry"]  # the page tries by itself


def test_a_line_that_breaks_is_taken_up_again(scenario: Scenario, site: Path) -> None:
    facts = scenario("server/resume", site)
    resumed = [hello["resume"] for hello in facts["hellos"] if hello["watch"] == "replay"]
    assert len(resumed) == 3 and resumed[0] is None
    assert resumed[1] == resumed[2] == {"session": "s1", "token": "t1"}
    assert facts["source"] == "The server's own input"


@pytest.fixture(scope="module")
def behind_a_server(scenario: Scenario, site: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return scenario("server/served", site, tmp_path_factory.mktemp("served"))


def test_the_page_of_a_server_opens_on_the_performance_until_an_input_comes(behind_a_server: dict[str, Any]) -> None:
    first = behind_a_server["without"]["first"]
    assert first["lead"].startswith("This server has no input of its own") and not first["isNoticed"]
    assert first["source"] == behind_a_server["before"]["source"] == "The page's own performance"
    assert behind_a_server["after"]["source"] == "The server's own input"


def test_a_notice_is_never_over_the_headline(behind_a_server: dict[str, Any]) -> None:
    assert not behind_a_server["without"]["isOverHeadline"]


def test_a_server_measures_recentres_and_raises_its_wearer(behind_a_server: dict[str, Any]) -> None:
    assert behind_a_server["requests"] == [
        {"type": "calibrate", "arms_out": True},
        {"type": "recentre"},
        {"type": "settings", "posture": "seated"},
    ]
    assert behind_a_server["notice"] == "Stand upright, arms out to the sides, and hold still: the server measures."


@pytest.fixture(scope="module")
def linked(
    scenario: Scenario, site: Path, waving_clip: Clip, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("linked")
    write_bvh(folder / "walk.bvh", waving_clip)
    return folder, scenario("alone/linked", site, folder / "walk.bvh", folder / "clear.png")


def test_an_address_names_motion_avatar_and_a_background_that_is_none(linked: Used) -> None:
    assert linked[1]["avatar"] == "other.vrm" and linked[1]["isBare"]
    alpha = np.asarray(Image.open(linked[0] / "clear.png").convert("RGBA"))[..., 3]
    assert alpha[:, :100].max() == 0  # the stage next to the body is transparent
    assert alpha.max() == 255
    assert linked[1]["missing"]["notice"].startswith("nowhere.bvh cannot be fetched: ")


def test_a_transparent_page_draws_the_body_into_the_middle_of_a_tall_window(linked: Used) -> None:
    """On a phone the figure is above the text, but here nothing is below it."""
    colour = np.asarray(Image.open(linked[0] / "clear-tall.png").convert("RGBA"), dtype=int)
    alpha = colour[..., 3]
    rows = np.flatnonzero((alpha == 255).any(axis=1)) / len(alpha)
    assert abs((rows[0] + rows[-1]) / 2 - 0.5) < 0.1
    assert alpha[:40].max() == alpha[-40:].max() == 0
    is_ghost = (alpha > 60) & (colour[..., 1] - colour[..., 0] > 90)  # bright green, as controllers are drawn
    assert not is_ghost.any()


def test_settings_take_the_focus_and_escape_gives_it_back(linked: Used) -> None:
    assert linked[1]["missing"]["keys"] == [True, "panel", False, "settings"]
    assert re.fullmatch(r"[\d.]+ of [\d.]+ seconds", linked[1]["missing"]["slider"])
