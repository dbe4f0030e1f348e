"""Commands of the laboratory say what to install where it is not."""

from __future__ import annotations

import pytest

from bodysense.cli import packages as laboratory
from bodysense.cli.application import application

from ..conftest import Command, Refused


@pytest.mark.parametrize("command", ["train gloves", "evaluate holes", "bench step", "study build", "data prepare x"])
def test_without_the_laboratory_its_commands_say_what_to_install(
    command: str, refused: Refused, run: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(laboratory, "find_spec", lambda name: None)
    told = refused(*command.split())
    assert "part of the laboratory; install it: pip install 'bodysense[lab]', or in a clone" in told
    assert "CMU" in run("data", "sources")  # all others are there
    assert "train" not in application()._subcommands


def test_with_it_they_are_there() -> None:
    assert {"train", "evaluate", "bench", "study", "demo"} <= set(application()._subcommands)
