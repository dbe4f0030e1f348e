"""Model cards: descriptions, test figures, and refused figures for every kind of network file."""

from __future__ import annotations

import json
from collections import defaultdict
from importlib.resources import files
from pathlib import Path

import pytest

from bodysense.errors import BodysenseError
from bodysense_lab.core.model_card import (
    CARD_TEMPLATES,
    card_template,
    card_text,
    describe,
    front_matter,
    network_lines,
    parse_fields,
    read_network,
)

WEIGHTS = Path(str(files("bodysense.weights")))
SHIPPED = sorted([*WEIGHTS.glob("*.onnx"), *WEIGHTS.glob("*.safetensors")])
SHIPPED += sorted(Path(str(files("bodysense_lab.weights"))).glob("*.onnx"))


def copied(path: Path, folder: Path) -> Path:
    copy = folder / path.name
    copy.write_bytes(path.read_bytes())
    return copy


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_card_stores_its_figures_in_the_network_file(path: Path, tmp_path: Path) -> None:
    network = copied(path, tmp_path)
    fields, _ = read_network(network)
    kind, model = card_template(network, fields), parse_fields(fields).get("model")
    _, used = kind.fill_rows(defaultdict(float), model)
    figures = {name: 1 + place / 4 for place, name in enumerate(sorted(used))}
    rows, _ = kind.fill_rows(figures, model)
    text = describe(network, {**figures, "another": 7.0}).read_text(encoding="utf-8")
    assert rows and all(f"| {' | '.join(row)} |" in text for row in rows)
    assert kind.measured_by in text and "another" not in text
    again = describe(network, figures).read_text(encoding="utf-8")
    assert again == text


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_packaged_card_describes_the_packaged_file(path: Path) -> None:
    """Size, training data and seed equal those in the file; the card names packaged networks only."""
    card = path.with_suffix(".md").read_text(encoding="utf-8")
    fields, _ = read_network(path)
    read = parse_fields(fields)
    assert set(network_lines(read)) <= set(card.splitlines())
    assert "seed" in read and f"; seed {read['seed']}" in card
    if path.suffix == ".onnx":  # figures of the completion network are not in its file
        assert "- validation: " in card
    assert card_template(path, fields).not_for.partition(";")[0] in card


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_packaged_card_equals_the_text_from_its_file(path: Path) -> None:
    """Cards whose tables are between markers have more lines, but also those of the file, in order."""
    card = path.with_suffix(".md").read_text(encoding="utf-8")
    fields, _ = read_network(path)
    text = card_text(path.name, card_template(path, fields), fields)
    if path.suffix == ".onnx":
        assert card == text
    else:
        lines = iter(card.splitlines())
        assert all(line in lines for line in text.splitlines())


def test_figures_of_another_network_are_refused(tmp_path: Path) -> None:
    network = copied(WEIGHTS / "body_vae.onnx", tmp_path)
    fields, _ = read_network(network)
    read = parse_fields(fields)
    key, own = f"model{read['model']}_validation_position_cm", read["validation"]["position_cm"]
    assert describe(network, {**read["test"], key: own}).is_file()
    with pytest.raises(BodysenseError, match=r"the figures are of another network \(in validation 5\.5 cm"):
        describe(network, {**read["test"], key: 5.5})


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_figures_of_another_command_are_refused(path: Path, tmp_path: Path) -> None:
    network = copied(path, tmp_path)
    with pytest.raises(
        BodysenseError, match=r"the figures have no '.*'; write them with `bodysense evaluate .* --json"
    ):
        describe(network, {"seconds": 1.0})
    assert network.read_bytes() == path.read_bytes() and not network.with_suffix(".md").exists()


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_card_starts_with_front_matter_for_model_hubs(path: Path) -> None:
    yaml = pytest.importorskip("yaml")
    fields, _ = read_network(path)
    text = path.with_suffix(".md").read_text(encoding="utf-8")
    assert text.startswith(front_matter(path.name, card_template(path, fields), fields) + f"# {path.name}\n")
    head = yaml.safe_load(text.split("---")[1])
    assert head["license"] == json.loads(fields["licence"]).lower() == "apache-2.0"
    assert head["library_name"] == "bodysense" and path.suffix[1:] in head["tags"] and "motion-capture" in head["tags"]


def test_files_without_a_card_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text.onnx").write_text("nothing of the kind")
    with pytest.raises(BodysenseError, match=r"text\.onnx: not a readable ONNX model"):
        describe(tmp_path / "text.onnx", {})
    with pytest.raises(BodysenseError, match="no card for a network of format 'none'; there are cards for "):
        card_template(tmp_path / "text.onnx", {})
    assert {kind.measured_by for kind in CARD_TEMPLATES.values()} >= {"bodysense evaluate unoc-table2"}
