"""The catalogue: names and addresses of missing data sets."""

from __future__ import annotations

from pathlib import Path

import pytest

from bodysense.errors import BodysenseError
from bodysense.io.datasets.catalogue import CATALOGUE
from bodysense_lab.data.datasets import catalogue_entry, require_data


def test_every_set_says_where_it_is_and_under_which_licence() -> None:
    assert len({one.name for one in CATALOGUE}) == len(CATALOGUE)
    for one in CATALOGUE:
        assert one.what and one.format and one.fingers and one.licence and "." in one.where, one.name
        assert catalogue_entry(one.name.upper()) is one


def test_the_tables_of_unoc_have_their_sets() -> None:
    assert {one.name for one in CATALOGUE if one.tables.startswith("UNOC")} == {"UNOC", "TWH16.2M", "Mixamo"}


def test_a_present_set(unoc, tmp_path: Path) -> None:
    assert require_data("unoc", str(unoc.folder)) == unoc.folder
    (tmp_path / "a.zarr").mkdir()
    (tmp_path / "a.zarr" / "zarr.json").write_text("{}")
    assert require_data("UNOC", tmp_path / "a.zarr") == tmp_path / "a.zarr"


@pytest.mark.parametrize(("name", "place", "message"), [
    ("UNOC", None, r"the data set UNOC is missing \(no folder of it is given\); get it at github.com/facebookresearch/"
                   r"UNOC \(licence: MIT\) and give its folder, or a store made of it by `bodysense data prepare`"),
    ("TWH16.2M", "none", r"TWH16.2M is missing \(.*none: no such folder\); get it at .*32M \(licence: CC BY-NC 4.0\)"),
    ("Mixamo", "empty", r"Mixamo is missing \(.*empty: no .bvh or .npz file in it\); get it at mixamo.com \(lic"),
])  # fmt: skip
def test_a_missing_set_is_reported(tmp_path: Path, name: str, place: str | None, message: str) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(BodysenseError, match=message) as error:
        require_data(name, place and tmp_path / place)
    assert "\n" not in str(error.value)


def test_an_unknown_set_is_refused() -> None:
    with pytest.raises(BodysenseError, match=r"unknown data set 'CMUU'; valid are UNOC, TWH16.2M, Mixamo, AMASS, CMU"):
        require_data("CMUU", None)
