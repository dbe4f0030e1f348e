"""Marker sets of gloves: the packaged ones, one's own files, recognition by labels, and what is wrong with a file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bodysense.body.hands.glove import default_glove, glove_of, template
from bodysense.body.hands.glove_set import packaged_sets, parse_set, read_set, standard_set
from bodysense.body.hands.hand import hand_skeleton
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError

HAND = hand_skeleton(default_skeleton(), "left")
PLATE = {"labels": ["*_P1", "*_P2", "*_P3"]}
TIP = {"label": "*_IDX", "segment": "index3", "along": 0.5, "offset": [0, 0.007, 0]}


def stored(**changes: Any) -> dict[str, Any]:
    return {"name": "mine", "plates": [PLATE], "markers": [TIP]} | changes


def test_packaged_sets() -> None:
    assert list(packaged_sets()) == ["bodysense", "two-hands"]
    release = packaged_sets()["two-hands"]
    assert release.points(["Ann:LEHAR", "LTHF", "C7"]) == {
        "Ann:LEHAR": "left_glove_pinky_base",
        "LTHF": "left_glove_thumb_tip",
    }
    np.testing.assert_array_equal(glove_of(release, HAND).offset, default_glove().offset)


@pytest.mark.parametrize("ending", [".toml", ".json"])
def test_a_file_of_ones_own(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"mine{ending}"
    written = stored(markers=[TIP, {"label": {"left": "M1", "right": "M7"}, "name": "knuckle", "segment": "hand"}])
    lines = ['name = "mine"', "[[plates]]", 'labels = ["*_P1", "*_P2", "*_P3"]', "[[markers]]", 'label = "*_IDX"']
    lines += ['segment = "index3"', "along = 0.5", "offset = [0, 0.007, 0]", "[[markers]]"]
    lines += ['label = {left = "M1", right = "M7"}', 'name = "knuckle"', 'segment = "hand"']
    path.write_text(json.dumps(written) if ending == ".json" else "\n".join(lines))
    found = read_set(path)
    assert found.names == ("plate1_1", "plate1_2", "plate1_3", "idx", "knuckle") and found.on_hand == (0, 1, 2, 4)
    assert found.points(["l_p2", "Bo:R_IDX", "M7", "M8"]) == {
        "l_p2": "left_glove_plate1_2",
        "Bo:R_IDX": "right_glove_idx",
        "M7": "right_glove_knuckle",
    }
    worn, rest = template(glove_of(found, HAND), HAND), HAND.path @ HAND.rest_offset
    middle = (rest[HAND.index("index3")] + rest[HAND.index("index_tip")]) / 2
    np.testing.assert_allclose(worn[3, [0, 2]], middle[[0, 2]], atol=2e-3)
    assert worn[3, 1] - middle[1] == pytest.approx(0.007, abs=1e-3), "above the back of the finger"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": 3}, "has a name"),
        ({"colour": "red"}, "'colour' is unknown; valid are markers, name"),
        ({"sides": {"up": "U"}}, "give the letter of each side"),
        ({"markers": "many"}, r"must be a list of tables, \[\[markers\]\]"),
        ({"markers": [TIP | {"segment": "index4"}]}, "marker 1: segment 'index4'; valid are hand, thumb1"),
        ({"markers": [TIP | {"along": 1.5}]}, "along 1.5; give 0 to 1"),
        ({"markers": [TIP | {"offset": [0, 7, 0]}]}, "three numbers in metres"),
        ({"markers": [TIP | {"accuracy": 0}]}, "must be positive"),
        ({"markers": [TIP | {"label": "IDX"}]}, r"put \* in place of the side"),
        ({"markers": [TIP | {"name": "A b"}]}, "give small letters"),
        ({"markers": [TIP, TIP | {"label": "*-idx", "name": "other"}]}, "'lidx' is used twice"),
        ({"markers": [{"label": "*_A", "is": "nose"}]}, "is 'nose'; valid are pinky_base"),
        ({"plates": [{"labels": ["*_P1"]}]}, "three markers or more"),
        ({"plates": []}, "1 markers; a hand needs 4"),
    ],
)
def test_what_is_wrong_is_said(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(BodysenseError, match=message) as error:
        parse_set(stored(**changes), "mine.toml", standard_set())
    assert "\n" not in str(error.value) and str(error.value).startswith("mine.toml")


def test_a_file_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match=r"give a \.toml or \.json file .* or one of bodysense, two-hands"):
        read_set("nothing")
    (tmp_path / "a.toml").write_text("[[[")
    with pytest.raises(BodysenseError, match="not TOML"):
        read_set(tmp_path / "a.toml")


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@given(key=st.sampled_from(["label", "name", "is", "segment", "near", "along", "offset", "accuracy"]), value=JSON)
def test_any_value_is_read_or_refused(key: str, value: Any) -> None:
    try:
        parse_set(stored(markers=[TIP | {key: value}]), "mine.json", standard_set())
    except BodysenseError as error:
        assert "\n" not in str(error)
