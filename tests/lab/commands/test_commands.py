"""Commands of the laboratory, on small data."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path

import pytest

from bodysense.cli.show import processor
from bodysense_lab.papers.unoc.learned import load_model
from bodysense_lab.weights import packaged


@pytest.mark.slow
def test_table_2_scores_the_packaged_predictor_without_networks(
    two_people: Path, tmp_path: Path, small_network: Path, run
) -> None:
    """UNOC's Table 2 then compares the predictor with the last known position, in one or two processes."""
    numbers = {}
    for jobs in (1, 2):
        out = tmp_path / f"{jobs}.json"
        given = (
            "--split",
            "all",
            "--model",
            small_network,
            "--jobs",
            jobs,
            "--json",
            out,
            "--out",
            tmp_path / str(jobs),
        )
        assert "last known" in run("evaluate", "unoc-table2", "--data", two_people, *given)
        numbers[jobs] = json.loads(out.read_text())
        assert numbers[jobs].pop("cpu_seconds") > 0
    assert numbers[1] == pytest.approx(numbers[2]) and numbers[1]["clips"] == 3
    for who in ("tracker", "best", "last_known"):
        for key in ("body_occluded_rmsjpe_cm", "body_occluded_mpjpe_cm", "finger_occluded_rmsjpe_cm"):
            assert numbers[1][f"{who}_{key}"] > 0
        assert numbers[1][f"{who}_body_all_rmsjpe_cm"] < numbers[1][f"{who}_body_occluded_rmsjpe_cm"]


def test_data_info_with_occlusion(two_people: Path, tmp_path: Path, run) -> None:
    output = run("data", "info", two_people, "--occlusion", "--json", tmp_path / "a.json")
    assert "self-contact" in output
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert 0 <= numbers["all_hand_hidden"] <= 1 and 0 <= numbers["all_self_contact"] <= 1


@pytest.mark.parametrize(
    ("command", "keys"),
    [
        (("ik", "--frames", 10, "--noise", 0.02), {"p50_ms", "p95_ms", "p99_ms"}),
        (
            ("take", "--minutes", 0.1),
            {f"{causal}frames_per_{processor}second" for causal in ("", "causal_") for processor in ("", "processor_")},
        ),
        (("training", "--steps", 1, "--processes", 0), {"draw_frames_per_second", "step_frames_per_second"}),
        pytest.param(
            ("training", "--steps", 1, "--processes", 1),
            {"draw_frames_per_second", "step_frames_per_second"},
            marks=pytest.mark.slow,
        ),
    ],
    ids=lambda value: "_".join(map(str, value)) if isinstance(value, tuple) else "",
)
@pytest.mark.usefixtures("quick_completion")
def test_benchmarks_write_their_numbers(tmp_path: Path, run, command: tuple[object, ...], keys: set[str]) -> None:
    run("bench", *command, "--json", tmp_path / "a.json")
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert numbers.pop("processor") == processor() and numbers.pop("cpu_seconds") > 0
    assert set(numbers) == keys
    assert all(value > 0 for key, value in numbers.items() if key != "torch_imported"), numbers
    assert numbers.get("torch_imported", 0) == 0


@pytest.mark.slow
def test_bench_step_writes_its_numbers(tmp_path: Path, run) -> None:
    run("bench", "step", "--frames", 8, "--people", 2, "--device", "headset_camera", "--json", tmp_path / "a.json")
    numbers = json.loads((tmp_path / "a.json").read_text())
    times = {
        "observe_ms",
        "live_ms",
        "hot_ms",
        "paced_ms",
        "p50_ms",
        "p99_ms",
        "batch2_ms",
        "batch2_p99_ms",
        "floor_ms",
        "reference_ms",
    }
    assert set(numbers) == times | {"processor", "cpu_seconds", "mflop", "rss_mb", "file_mb"}
    assert 0 < numbers["p50_ms"] <= numbers["p99_ms"] and numbers["rss_mb"] > 10 and numbers["file_mb"] > 0.1
    assert (
        0 < numbers["observe_ms"] < min(numbers["hot_ms"], numbers["live_ms"])
        and numbers["hot_ms"] == numbers["p50_ms"]
        and numbers["paced_ms"] > 0
    )
    assert 0 < numbers["floor_ms"] < numbers["p50_ms"] and numbers["mflop"] > 10


@pytest.mark.slow
def test_the_packaged_network_is_better_than_the_last_known_position(tmp_path: Path, run) -> None:
    (tmp_path / "motion").mkdir()
    (tmp_path / "motion" / "performance.npz").write_bytes((files("bodysense.demo") / "performance.npz").read_bytes())
    given = ("--split", "all", "--jobs", 1, "--json", tmp_path / "a.json", "--out", tmp_path)
    run("evaluate", "unoc-table2", "--data", tmp_path / "motion", *given)
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert numbers["tracker_body_occluded_rmsjpe_cm"] < numbers["last_known_body_occluded_rmsjpe_cm"]


def test_card_writes_test_figures_into_the_network_and_a_card(tmp_path: Path, run) -> None:
    network, figures = tmp_path / "copy.onnx", tmp_path / "figures.json"
    network.write_bytes(packaged("body_gru.onnx").read_bytes())
    key = "body_occluded_rmsjpe_cm"
    figures.write_text(json.dumps({f"tracker_{key}": 5.0, f"last_known_{key}": 10.0}))
    assert "wrote" in run("train", "card", network, "--figures", figures)
    assert load_model(network).card["test"][f"tracker_{key}"] == 5.0
    assert "| body | occluded | 10.0 | 5.0 |" in network.with_suffix(".md").read_text()


def test_trainings_refuse_invalid_options_at_once(tmp_path: Path, refused) -> None:
    for command in ("fingers", "upper-body"):
        arguments = ("train", command, "--data", tmp_path)
        assert "give a name with this ending" in refused(*arguments, "-o", tmp_path / "a.pt")
        assert "--steps 0: give a whole number" in refused(*arguments, "-o", tmp_path / "a.onnx", "--steps", 0)
        assert "create it or choose another" in refused(*arguments, "-o", tmp_path / "no" / "a.onnx")
