"""Model cards: descriptions, test figures, and refused figures for every kind of network file."""

from __future__ import annotations

import json
from collections import defaultdict
from importlib.resources import files
from pathlib import Path

import pytest

from bodysense.errors import BodysenseError
from bodysense_lab.core.model_card import card_template, card_text, describe, filled_table, parse_fields, read_network

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
    with pytest.raises(
        BodysenseError, match=r"the figures have no '.*'; write them with `bodysense evaluate .* --json"
    ):
        describe(network, {"seconds": 1.0})
    assert network.read_bytes() == path.read_bytes() and not network.with_suffix(".md").exists()
    fields, _ = read_network(network)
    template, model = card_template(network, fields), parse_fields(fields).get("model")
    _, used = filled_table(template, defaultdict(float), model)
    figures = {name: 1 + place / 4 for place, name in enumerate(sorted(used))}
    rows, _ = filled_table(template, figures, model)
    text = describe(network, {**figures, "another": 7.0}).read_text(encoding="utf-8")
    assert len(rows) > 2 and set(rows) <= set(text.splitlines()) and "{" not in text
    assert "another" not in json.loads(read_network(network)[0]["test"])
    assert describe(network, figures).read_text(encoding="utf-8") == text


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_packaged_card_equals_the_text_from_its_file(path: Path) -> None:
    """Cards whose tables are between markers have more lines, but also those of the file, in order."""
    card = path.with_suffix(".md").read_text(encoding="utf-8")
    fields, _ = read_network(path)
    text = card_text(path.name, card_template(path, fields), fields)
    if path.suffix == ".onnx":
        assert card == text and "- validation: " in card
    else:
        lines = iter(card.splitlines())
        assert all(line in lines for line in text.splitlines())
    yaml = pytest.importorskip("yaml")
    head = yaml.safe_load(card.split("---")[1])
    assert head["license"] == json.loads(fields["licence"]).lower() == "apache-2.0"
    assert head["library_name"] == "bodysense" and path.suffix[1:] in head["tags"] and "motion-capture" in head["tags"]


def test_figures_of_another_network_are_refused(tmp_path: Path) -> None:
    network = copied(WEIGHTS / "body_vae.onnx", tmp_path)
    read = parse_fields(read_network(network)[0])
    key, own = f"model{read['model']}_validation_position_cm", read["validation"]["position_cm"]
    assert describe(network, {**read["test"], key: own}).is_file()
    with pytest.raises(BodysenseError, match=r"the figures are of another network \(in validation 5\.5 cm"):
        describe(network, {**read["test"], key: 5.5})


def test_files_without_a_card_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text.onnx").write_text("nothing of the kind")
    with pytest.raises(BodysenseError, match=r"text\.onnx: not a readable ONNX model"):
        describe(tmp_path / "text.onnx", {})
    with pytest.raises(BodysenseError, match="no card for a network of format 'none'; there are cards for "):
        card_template(tmp_path / "text.onnx", {})
