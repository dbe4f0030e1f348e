"""A wearer of an emulated headset: measured, remembered, sitting and standing up."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.io.formats.bvh import read_bvh

pytestmark = pytest.mark.slow

Scenario = Callable[..., dict[str, Any]]
Visit = tuple[Path, dict[str, Any]]


@pytest.fixture(scope="module")
def visit(scenario: Scenario, site: Path, tmp_path_factory: pytest.TempPathFactory) -> Visit:
    folder = tmp_path_factory.mktemp("wearer")
    return folder, scenario("headset/wearer", site, folder)


def body_of(path: Path) -> tuple[float, np.ndarray]:
    """Height of a saved body, and how high its lower ankle is over a standing one's in each frame; m."""
    clip = read_bvh(path)
    skeleton, usual = clip.pose.skeleton, default_skeleton()

    def lower(pose: Pose) -> np.ndarray:
        ankles = pose.skeleton.indices(["left_ankle", "right_ankle"])
        return np.asarray(forward_kinematics(pose)[0])[..., ankles, 1].min(axis=-1)

    standing = lower(standing_pose(usual)) * skeleton.height / usual.height
    return skeleton.height, lower(clip.pose) - standing


def box_pixels(path: Path) -> int:
    """Return the number of pixels before the mirror's foot that have the colour of a seat."""
    picture = np.asarray(Image.open(path).convert("RGB"), dtype=int)[150:250, 200:290]
    red, green, blue = picture[..., 0], picture[..., 1], picture[..., 2]
    return int(((red - blue > 8) & (abs(red - green) < 16) & (red > 90) & (red < 210)).sum())


def test_a_tall_wearer_stands_on_the_floor_from_the_first_frame(visit: Visit) -> None:
    height, ankles = body_of(visit[0] / "tall.bvh")
    assert height > 1.8
    assert ankles[0] < 0.14


def test_a_crouch_is_not_believed(visit: Visit) -> None:
    assert visit[1]["crouch"].startswith("Your head is only 1.18 m high: stand upright and measure again.")


def test_measuring_counts_down(visit: Visit) -> None:
    assert visit[1]["countdown"] == ["3", "2", "1"]


def test_a_measured_wearer_stays_measured_over_sources_and_visits(visit: Visit) -> None:
    facts = visit[1]
    assert facts["measured"] == "You are measured."
    assert facts["hint"].startswith("You are measured: head 1.66 m high, arms 1.4")
    assert facts["kept"] == facts["hint"]
    assert abs(body_of(visit[0] / "measured.bvh")[0] - 1.81) < 0.04  # eyes at 1.70 m


def test_a_wearer_can_be_forgotten(visit: Visit) -> None:
    hint, is_offered = visit[1]["forgotten"]
    assert hint.strip().startswith("Stand upright") and not is_offered


def test_taller_begins_at_the_height_of_the_body(visit: Visit) -> None:
    assert abs(float(visit[1]["taller"]) - 1.82) < 0.04


def test_sitting_counts_before_vr_and_the_box_follows_the_menu(visit: Visit) -> None:
    assert visit[1]["seatedBox"] == [True, False, True]
    assert body_of(visit[0] / "seated.bvh")[1][-1] < 0.06  # eyes at 1.18 m: without it the knees would be bent


def test_a_wearer_who_stands_up_stays_on_the_floor(visit: Visit) -> None:
    assert body_of(visit[0] / "risen.bvh")[1].max() < 0.08


def test_nothing_of_one_session_is_left_in_the_next(scenario: Scenario, site: Path, tmp_path: Path) -> None:
    """A room, then VR with hands taken off while it measures, then VR after another source."""
    facts = scenario("headset/order", site, tmp_path)
    assert facts["menus"] == 3 * ["Point and pinch, or pull the trigger."]
    assert facts["silent"] == [True, True]
    assert facts["nothingOn"].startswith("No headset is on, and nothing else measures you.")
    # Seated wearers are mirrored on a box, which is warm grey.
    assert box_pixels(tmp_path / "no_mirror.png") < 60 and box_pixels(tmp_path / "seated.png") > 150
