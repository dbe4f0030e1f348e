"""Packages add commands; commands of missing packages print the install line."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

import pytest
from tyro.extras import SubcommandApp

from bodysense.cli import main, packages
from bodysense.cli.application import application

from ..conftest import Command, Refused


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The library without any of the packages."""
    monkeypatch.setattr(packages, "entry_points", lambda group: ())


@pytest.mark.parametrize(
    ("command", "package"),
    [
        ("serve --port 0", "live"),
        ("--quiet serve", "live"),
        ("conform x.bvh", "conform"),
        ("train gloves", "lab"),
        ("data prepare x", "lab"),
    ],
)
@pytest.mark.usefixtures("alone")
def test_a_command_of_a_missing_package_gives_the_install_line(command: str, package: str, refused: Refused) -> None:
    line = refused(*command.split())
    assert f"this command is part of bodysense-{package}, which is not installed; in a clone of" in line
    assert line.endswith(f"pip install -c constraints.txt -e packages/{package}")


@pytest.mark.usefixtures("alone")
def test_the_library_runs_without_the_packages(run: Command) -> None:
    assert "CMU" in run("data", "sources")
    assert set(application(packages.installed())._subcommands) == set(packages.OWN)


@pytest.mark.usefixtures("alone")
def test_a_store_needs_the_laboratory(tmp_path: Path, refused: Refused) -> None:
    (tmp_path / "zarr.json").write_text("{}")
    line = refused("data", "info", tmp_path)
    assert "a prepared store of motion, which packages/lab reads; in a clone of the repository: pip install" in line


def test_help_lists_commands_by_their_first_paragraph(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["data", "--help"])
    listed = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "how each file was read." in listed and "Unreadable files" not in listed
    with pytest.raises(SystemExit):
        main(["data", "info", "--help"])
    assert "Unreadable files" in capsys.readouterr().out


@pytest.mark.usefixtures("alone")
def test_help_lists_what_is_not_installed(capsys: pytest.CaptureFixture[str]) -> None:
    output = help_text(capsys)
    assert output.count("Not installed:") == 3
    for package in packages.PACKAGES:
        assert f"pip install -c constraints.txt -e packages/{package.name}" in output
        for name, what in package.commands.items():
            assert f"{' '.join(name)} ({what})" in output


def test_with_all_packages_help_describes_every_command_in_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    output = help_text(capsys)
    assert "Not installed" not in output
    for name in application(packages.installed())._subcommands:
        assert any(words[:2] == ["•", name] and len(words) > 3 for words in map(str.split, _inside(output))), name


def help_text(capsys: pytest.CaptureFixture[str]) -> str:
    """Return the text of `bodysense --help` without line breaks."""
    with pytest.raises(SystemExit):
        main(["--help"])
    return capsys.readouterr().out


def _inside(text: str) -> list[str]:
    return [line.strip("│ ") for line in text.splitlines()]


def test_every_command_of_a_package_is_known_where_it_is_not_installed() -> None:
    for package in packages.PACKAGES:
        root, data = SubcommandApp(), SubcommandApp()
        (point,) = entry_points(group=packages.GROUP, name=package.name)
        point.load()(root, data)
        added = {(name,) for name in root._subcommands} | {("data", name) for name in data._subcommands}
        assert added - {("data", "info")} == set(package.commands)


def test_a_third_party_package_adds_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint("other", "bodysense_conform.command:add_commands", packages.GROUP)
    monkeypatch.setattr(packages, "entry_points", lambda group: (point,))
    assert "conform" in application(packages.installed())._subcommands


def test_a_command_of_the_library_loads_no_package_that_cannot_run_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A package that is unknown may replace the command, and `data` has commands of the laboratory."""
    names = ["live", "conform", "lab", "other"]
    points = [EntryPoint(name, f"{name}:add_commands", packages.GROUP) for name in names]
    monkeypatch.setattr(packages, "entry_points", lambda group: points)
    found = packages.installed()
    assert list(packages.needed(found, ["track", "serve"])) == ["other"]
    assert list(packages.needed(found, ["data", "info"])) == ["lab", "other"]
    for words in ([], ["--help"], ["serve"], ["trak"]):
        assert packages.needed(found, words) == found


def test_tracking_starts_without_the_server_and_the_laboratory() -> None:
    code = (
        "import sys\nfrom bodysense.cli import main\nstatus = main(['track', 'no.bvh', '-o', 'out.bvh'])\n"
        "print(status, {name.partition('.')[0] for name in sys.modules} & {'bodysense_live', 'bodysense_lab'})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "2 set()"
