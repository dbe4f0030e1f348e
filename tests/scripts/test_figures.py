"""Tables of figures: each is between markers that the script writes, names its processor, and has its command."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from figures import rows, tables
from figures.described import DESCRIPTIONS, checks, network_card
from figures.measure_hours import STEPS, WHOLE
from figures.tables import (
    ROOT,
    Block,
    Measured,
    filled,
    limit_option,
    put,
    read_commands,
    read_measured,
    read_templates,
    repeated,
    sampled,
    write_blocks,
)

BLOCKS, ROWS = read_templates()
COMMANDS = read_commands()
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
WRITTEN = re.compile(r"<!-- begin (\S+) -->\n(.*?)<!-- end \1 -->", re.DOTALL)
_NUMBER = r"[−+-]?\d[\d,]*(?:\.\d+)?"
_UNIT = r"(?:cm|mm|m|ms|s|°|%|cm/s|m/s|MB|MB/s|/s)"
# A figure: numbers alone, at least one with decimals or a unit: `0.91`, `1.8, 4.3 cm`, `13.3 (0.63)`, `37 %`.
FIGURE = re.compile(rf"(?=.*(?:\.\d| {_UNIT}|°)){_NUMBER}(?: ?{_UNIT})?(?:[ ,/(]+(?:to )?{_NUMBER}(?: ?{_UNIT})?\)?)*")
CONSTANTS = {  # tables by the first cell of their head and page: no figures of ours were measured for them
    ("docs/reproduce.md", "row"),  # repeats cells of other tables (`rows`), next to those of the papers
    ("docs/markers.md", "joint"),  # accuracies that marker sets assume
    ("docs/video.md", "option"),  # defaults of options
}


def every_figure(block: Block) -> dict[str, Measured]:
    """Return files with every figure that the text of a block has, each with a processor of its own."""
    numbers: dict[str, dict[str, float]] = {file: {} for file in (*block.files, *block.more)}
    for place in re.findall(r"\{([^{}]+?)(?::[^{}:/']*)?\}", repeated(block.text)):
        quoted = re.findall(r"n\('([^']*)'\)", place)
        for key in quoted or (
            re.findall(r"\b[a-z]\w*_\w+|clips", place) if re.search(r" [-+*/<] ", place) else [place]
        ):
            file, _, name = key.rpartition("/")
            numbers[file or next(iter(numbers))][name] = 1.25
    return {file: Measured(found | {"clips": 1.25}, f"cpu {k}") for k, (file, found) in enumerate(numbers.items())}


def tables_of(text: str) -> Iterator[list[list[str]]]:
    """The cells of every table that is not between markers."""
    for table in re.findall(r"(?:^\|.*\n)+", WRITTEN.sub("", text), re.MULTILINE):
        yield [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in table.splitlines()]


def test_tables_with_figures_are_between_markers() -> None:
    for page in PAGES:
        name = page.relative_to(ROOT).as_posix()
        for head, _, *body in tables_of(page.read_text(encoding="utf-8")):
            figures = [cell for row in body for cell in row[1:] if FIGURE.fullmatch(cell)]
            assert not figures or (name, head[0]) in CONSTANTS, f"{name}, {head}: put {figures[:3]} between markers"


def test_numbers_that_count_as_figures() -> None:
    assert all(
        map(FIGURE.fullmatch, ("0.91", "1.8, 4.3 cm", "13.3 (0.63)", "37 %", "0.22, 0.32 ms", "8.4 / 5.7", "-0.98"))
    )
    assert not any(map(FIGURE.fullmatch, ("8192", "–", "", "1.75 m tall", "`0.5`", "2, 3", "by 0.5 cm")))


def test_every_pair_of_markers_has_a_block_that_writes_it() -> None:
    found = {
        (page.relative_to(ROOT).as_posix(), name)
        for page in [*PAGES, *(ROOT / "src").rglob("*.md"), *(ROOT / "packages").rglob("*.md")]
        for name in re.findall(r"<!-- begin (\S+) -->", page.read_text(encoding="utf-8"))
    }
    named = [*((block.page, block.name) for block in BLOCKS), *DESCRIPTIONS]
    assert set(named) == found and len(named) == len(found)


def test_blocks_name_their_processors_and_commands() -> None:
    assert all(f"FIGURES/{name.partition('/')[0]}" in command for name, command in COMMANDS.items())
    for block in BLOCKS:
        text = dict(WRITTEN.findall((ROOT / block.page).read_text(encoding="utf-8")))[block.name]
        if block.files and text:
            assert re.search(r"\n\nProcessor: \S.*\.\n$", text), block
        for file in (*block.files, *block.more):
            assert f"FIGURES/{file}.json" in COMMANDS.get(file, ""), f"no command for {file}.json"


def test_blocks_are_made_of_their_files(tmp_path: Path) -> None:
    """Rows are as wide as their table, every file is needed, and the processors of all files are named."""
    for block in (block for block in BLOCKS if block.files):
        check_block(block, tmp_path / block.page, tmp_path)


def test_hours_have_every_number_that_their_scripts_write() -> None:
    """The steps of arms are those of the code's windows: 300 epochs of 5,497 windows in batches of 128."""
    (block,) = (block for block in BLOCKS if block.name == "hours")
    seconds = {f"{name}_seconds_a_step": 1.0 for name in STEPS} | {f"{name}_seconds": 1.0 for name in WHOLE}
    windows = {"clips": 168.0, "minutes": 17.99, "windows": 5497.0}  # `arm_windows` of measure_figures.py
    text = block.rendered({"hours": Measured(seconds, "a cpu"), "arm-windows": Measured(windows, "a cpu")})
    for model in ("ahmt", "pahmt"):
        assert f"| `train arms --model {model}` | 1.000 | 12,600 | 3.5 | 300 epochs of 18 minutes" in text
    assert text.count("–") == repeated(block.text).count("–"), "no figure is missing"


def check_block(block: Block, page: Path, tmp_path: Path) -> None:
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(f"a\n<!-- begin {block.name} -->\n<!-- end {block.name} -->\nb\n")
    measured = every_figure(block)
    for missing in block.files:
        write_blocks([block], {file: one for file, one in measured.items() if file != missing}, tmp_path)
        assert page.read_text().count("\n") == 4, "unchanged"
    write_blocks([block], measured, tmp_path)
    text = page.read_text()
    assert text.count("–") == repeated(block.text).count("–"), "every figure has its place"
    assert text.startswith(f"a\n<!-- begin {block.name} -->\n") and text.endswith(f"<!-- end {block.name} -->\nb\n")
    assert text.count(f"Processor: {', '.join(sorted(one.processor for one in measured.values()))}.\n") == 1
    for table in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        assert len({line.count("|") for line in table.splitlines()}) == 1
    assert re.search(r"\d", text.replace("cpu", ""))


def test_a_block_without_any_of_its_files_is_unchanged(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- begin x -->\nkept\n<!-- end x -->\n")
    block = Block("page.md", "x", "written {a:.1f}", (), more=("one",))
    write_blocks([block], {"other": Measured({}, "a cpu")}, tmp_path)
    assert "kept" in page.read_text()
    write_blocks([block], {"one": Measured({"a": 1.0}, "a cpu")}, tmp_path)
    assert "written 1.0" in page.read_text() and "Processor: a cpu.\n" in page.read_text()


def test_a_block_has_the_hours_of_its_commands_if_each_was_timed() -> None:
    block = Block("page.md", "x", "written", ("one", "two"))
    timed, older = Measured({}, "a cpu", 900.0), Measured({}, "a cpu")
    assert block.rendered({"one": timed, "two": timed}) == "written\n\nProcessor: a cpu; 0.5 CPU hours."
    assert block.rendered({"one": timed, "two": older}) == "written\n\nProcessor: a cpu."
    assert timed.line == "Processor: a cpu; 0.25 CPU hours."


def test_missing_figures_are_dashes_and_rows_without_any_are_omitted() -> None:
    text = """
| of | a | b |
| --- | --- | --- |
@@ x; y = the other
@ low; high
| $4, $2 | {$3_$1_cm:.1f} | {100 * n('$3_$1.share'):.0f} % |
| published | 3 | – |

The first is {x_low_cm:.2f} cm, the second file's {two/x_low_cm:.1f}.
Mean error: {gone:.2f} cm.

| only | missing |
| --- | --- |
| one | {gone:.1f} |"""
    first, second = {"x_low_cm": 1.25, "x_low.share": 0.5, "y_high_cm": 7.0}, {"x_low_cm": 9.0}
    assert filled(text.strip("\n"), {"one": first, "two": second}).splitlines() == [
        "| of | a | b |",
        "| --- | --- | --- |",
        "| x, low | 1.2 | 50 % |",
        "| the other, high | 7.0 | – |",
        "| published | 3 | – |",
        "",
        "The first is 1.25 cm, the second file's 9.0.",
    ]
    with pytest.raises(KeyError, match="gone"):
        tables.filled_line("{gone:.1f}", first)


def test_figures_without_a_processor_are_refused(tmp_path: Path) -> None:
    (tmp_path / "step.json").write_text(json.dumps({"p50_ms": 1.0}))
    with pytest.raises(ValueError, match=r"step\.json: no processor; measure again"):
        read_measured(tmp_path)
    (tmp_path / "step.json").write_text(json.dumps({"processor": "a cpu", "p50_ms": 1.0}))
    assert read_measured(tmp_path) == {"step": Measured({"p50_ms": 1.0}, "a cpu")}
    (tmp_path / "step.json").write_text(json.dumps({"processor": "a cpu", "cpu_seconds": 9.5, "p50_ms": 1.0}))
    assert read_measured(tmp_path) == {"step": Measured({"p50_ms": 1.0}, "a cpu", 9.5)}


def test_text_around_markers_stays() -> None:
    text = put("a\n<!-- begin x -->\nold\n<!-- end x -->\nb\n", "x", "new")
    assert text == "a\n<!-- begin x -->\nnew\n<!-- end x -->\nb\n"
    with pytest.raises(ValueError, match="no markers of y"):
        put(text, "y", "new")


def test_figures_of_the_papers_rows_are_cells_of_the_tables() -> None:
    page = (ROOT / rows.PAGE).read_text(encoding="utf-8")
    assert rows.with_figures(page, ROWS) == page, "run: python scripts/write_figures.py FIGURES"
    figures = re.findall(r"^\| \d\.\d+ \|[^|]*\|[^|]*\|([^|]*)\|", page, re.MULTILINE)
    assert len(figures) == 55 and not [cell for cell in figures if "–" in cell], "every row has its figures"
    with pytest.raises(ValueError, match=r"no row 9\.9"):
        rows.with_figure(page, "9.9", "1")
    block = "| a | b | c |\n| --- | --- | --- |\n| x | y | 1 |\n| x | z | 2 |\n\nProcessor: a cpu.\n"
    assert rows.cell_of(block, "c", "x", "z") == "2" and rows.cell_of(block, "processor") == "a cpu"
    assert rows.cell_of(block, "CPU hours") == "–"
    timed = block.replace("a cpu.", "a cpu; 0.25 CPU hours.")
    assert (rows.cell_of(timed, "processor"), rows.cell_of(timed, "CPU hours")) == ("a cpu", "0.25")
    with pytest.raises(ValueError, match="no cell 'd'"):
        rows.cell_of(block, "d", "x")


def test_a_row_names_the_command_that_prints_its_figure() -> None:
    page = (ROOT / rows.PAGE).read_text(encoding="utf-8")
    named = {cells[0]: cells[2] for line in page.splitlines() if len(cells := line.strip("| ").split(" | ")) == 8}
    files = {block.name: block.files for block in BLOCKS if block.page.startswith("docs/")}

    def prints(file: str) -> str:
        """The words of a row by which it names the command that wrote a file."""
        if "measure_figures.py" in COMMANDS[file]:
            return f"measure_figures.py {file}.json"
        found = re.search(r"(evaluate|bench|study|data) [a-z0-9-]+", COMMANDS[file])
        return found[0] if found else file

    for row, template in ROWS["figures"].items():
        for block in re.findall(r"(?:at|text|change|span)\('([^']+)'(?!, 'processor')", template):
            assert any(prints(file) in named[row] for file in files[block]), (row, named[row], files[block])


def test_a_table_of_a_sample_is_marked() -> None:
    some, whole = {"clips": 36.0, "clips_in_split": 285.0}, {"clips": 285.0, "clips_in_split": 285.0}
    assert (limit_option(some), limit_option(whole)) == (" --limit 36", "")
    assert filled("{sample}{limit}", {"a": some}) == "a sample of 36 of 285 clips --limit 36"
    assert filled("{sample}; {b/sample}", {"a": whole, "b": some}) == "285 clips; a sample of 36 of 285 clips"
    quick = {"clips": 12.0, "quick": 1.0}
    assert sampled(quick) == "a sample, the first seconds of 12 clips (`--quick`)"
    assert sampled({**quick, "clips_in_split": 38.0}) == "a sample, the first seconds of 12 of 38 clips (`--quick`)"
    assert sampled({"clips": 12.0}) == "12 clips"


# Tables whose published half the papers print: labels of rows, and what the paper's Tables 1, 2, 5 and 6 have.
PUBLISHED = {
    "networks": ("9.3 / 5.9 (0.58)", "7.6 / 2.2 (1.00)", "4.9 / 3.7"),
    "table5": ("15.6 / 10.3", "2.1 / 1.1", "1.5 / 0.8", "23.1 / 14.7"),
    "table6-across": ("4.1 / 3.0", "6.3 / 4.6"),
    "applications": ("6.7 / 5.1", "8.3 / 6.3"),
    "occlusion": ("207.27", "1,800,000 frames at 120 Hz"),
    "hmd-vae": ("6.83", "4.11"),
    "gloves-occlusion": ("| 90 |",),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_figures_are_next_to_ours(name: str) -> None:
    block = next(block for block in BLOCKS if block.name == name and block.page.startswith("docs/"))
    page = dict(WRITTEN.findall((ROOT / block.page).read_text(encoding="utf-8")))[name]
    for text in (page, block.rendered(every_figure(block))):
        assert all(figure in text for figure in PUBLISHED[name]), name


def test_the_card_of_the_network() -> None:
    validation = Measured({"head_own_mpjpe_cm": 1.25}, "a cpu")
    text = network_card("completion", "", "", {"validation": validation})
    assert text is not None and "seed" in text and "- validation people, known bodies, cm: head 1.25\n" in text
    assert network_card("completion", "", "", {}) is None


def test_the_page_has_the_referees_table() -> None:
    page = (ROOT / "docs" / "conform.md").read_text(encoding="utf-8")
    assert put(page, "checks", checks({})) == page, "run: python scripts/write_figures.py FIGURES"


def test_hours_are_short() -> None:
    assert [tables.hours(3600 * value) for value in (0.0571, 9.94, 10.4, 269.4)] == ["0.057", "9.9", "10", "269"]
