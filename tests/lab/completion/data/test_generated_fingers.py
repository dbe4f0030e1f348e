"""Generated fingers: seeded, within joint limits, at realistic speeds; their file and command."""

from pathlib import Path

import numpy as np
import pytest

from bodysense.body.hands.hand import HAND_JOINTS, angles_of, limits, mirrored_rotations, rotations_of
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.cli import main
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense_lab.completion.data.generated_fingers import RATE, generate_fingers, read_fingers, write_fingers
from bodysense_lab.synthesis.hands import FASTEST_FINGER

HOURS = 0.03


@pytest.fixture(scope="module")
def fingers() -> np.ndarray:
    return generate_fingers(HOURS)


def left_and_right(fingers: np.ndarray) -> list[np.ndarray]:
    """Return local rotations (N, 15, 4) of both hands as left ones, in the order of `HAND_JOINTS`."""
    skeleton = default_skeleton()
    hands = []
    for side in ("left", "right"):
        places = skeleton.indices([f"{side}_{name}" for name in HAND_JOINTS[1:]]) - len(BODY)
        hands.append(mirrored_rotations(fingers[:, places].astype(float), side))
    return hands


def test_the_duration_is_exact_and_longer_motion_begins_equally(fingers: np.ndarray) -> None:
    assert fingers.shape == (round(HOURS * 3600 * RATE), 30, 4)
    np.testing.assert_array_equal(generate_fingers(0.01), fingers[: round(0.01 * 3600 * RATE)])
    assert not np.array_equal(generate_fingers(0.01, seed=2), fingers[: round(0.01 * 3600 * RATE)])


def test_joints_are_within_their_limits(fingers: np.ndarray) -> None:
    low, high = limits()
    for hand in left_and_right(fingers):
        angles = angles_of(hand)
        assert (angles > low - 0.02).all() and (angles < high + 0.02).all()
        assert geodesic_angle(rotations_of(angles), hand).max() < 0.02  # nothing but these angles; half precision


def test_hands_move_differently_and_at_speeds_of_fingers(fingers: np.ndarray) -> None:
    left, right = left_and_right(fingers)
    assert np.abs(left - right).mean() > 0.02
    within = np.ones(len(fingers) - 1, dtype=bool)
    within[round(30 * RATE) - 1 :: round(30 * RATE)] = False  # pieces do not join
    for hand in (left, right):
        speed = geodesic_angle(hand[1:], hand[:-1])[within] * RATE
        assert np.percentile(speed, 99.9) < 2 * FASTEST_FINGER and speed.mean() > 0.1


def test_files_are_read_back_and_others_are_refused(fingers: np.ndarray, tmp_path: Path) -> None:
    write_fingers(tmp_path / "some" / "fingers.npz", fingers)
    np.testing.assert_array_equal(read_fingers(tmp_path / "some" / "fingers.npz"), fingers)
    np.savez(tmp_path / "other.npz", values=np.zeros(3))
    (tmp_path / "text.npz").write_text("no")
    for name in ("other.npz", "text.npz", "absent.npz"):
        with pytest.raises(BodysenseError, match=f"{name}: no generated fingers"):
            read_fingers(tmp_path / name)


def test_no_time_is_refused() -> None:
    for hours in (0.0, -1.0, float("nan"), 1e9):
        with pytest.raises(BodysenseError, match="--hours"):
            generate_fingers(hours)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "fingers.npz"
    assert main(["data", "fingers", "-o", str(out), "--hours", "0.005"]) == 0
    assert read_fingers(out).shape == (540, 30, 4) and "540 frames" in capsys.readouterr().out
    for arguments, expected in ((["-o", str(out), "--hours", "0"], "--hours 0"), (["-o", "a.bvh"], "written as .npz")):
        assert main(["data", "fingers", *arguments]) == 2
        assert expected in capsys.readouterr().err
