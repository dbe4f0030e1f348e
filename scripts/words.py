"""Word gauge: list lines of comments, docstrings and pages that need plainer English.

    python scripts/words.py [FILE …]            all tracked files if omitted; fails if a line is listed

Each row of `RULES` has a pattern and what to write instead. A line with `words: ok` is left out.
"""

from __future__ import annotations

import io
import re
import subprocess
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RULES = {  # pattern: what to write instead
    r"\b(is|are|was|were) none\b|\bthat (is|are) none\b|\bnone (is|are|of|where|at all)\b": "is missing; NaN; without",
    r"\bno number\b": "NaN",
    r"\b[Ww]hoever\b|\bof whom\b|\bnobody\b|\bsomebody\b": "a person, a wearer, nobody's name",
    r"\bso many\b": "the number",
    r"\b(as|is|was|are|were|be|been) told\b|\btold (of|about|anew|as|apart|exactly|nothing)\b|\bnothing (is )?told\b"
    r"|\bto be told\b": "given, known, set",
    r"\bas (it|they) (was|were|is|are)\b": "unchanged",
    r"\bthe same (without|where|with what)\b": "name the thing again",
    r"\bwhat (nobody|comes|goes|is no)\b|\bwhat (is|are|was|were|may|can) (told|tracked|known|seen|drawn|given|wanted"
    r"|missed)\b": "a noun: points, joints, frames",
    r"\bwho (sits|glides|wears|stands|goes)\b": "a seated body, a wearer",
    r"\b(may|can|must) be[ .;,]*$": "a whole verb",
    r"\bgo(es)? on with\b": "continue",
    r"\bbecame known\b": "was given, was found",
    r"\bsaid of\b|\bis shown as\b": "displayed as, called",
    r"\bbeside (the|it|what|other|our|its|each)\b": "next to, compared with",
    r"\b(left|leave) a \w+ no\b": "remaining, without",
    r"^\W*(What|Who|Whose|Whom|Of|So many|None|Nobody|The same) (?!it is\b)": "a thing with a name as the subject",
}
_ALLOWED = "words: ok"
_C_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
SUFFIXES = {".py", ".md", ".ts", ".c", ".h"}
_OTHERS = ("bodysense_live/page/", "core/vendor/")  # the built page, and code of others


def prose(path: Path) -> Iterator[tuple[int, str]]:
    """Yield numbers and texts of the lines of a file's comments, docstrings or pages."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        generated = False  # between the markers of a table of figures
        for number, line in enumerate(text.splitlines(), 1):
            generated = line.startswith("<!-- begin ") or (generated and not line.startswith("<!-- end "))
            if not generated:
                yield number, line
    elif path.suffix == ".py":
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            is_docstring = token.type == tokenize.STRING and token.string.endswith('"""')
            if token.type == tokenize.COMMENT or is_docstring:
                yield from enumerate(token.string.strip('"').splitlines(), token.start[0])
    else:
        for match in _C_COMMENT.finditer(text):
            yield from enumerate(match[0].splitlines(), text.count("\n", 0, match.start()) + 1)


def findings(path: Path) -> list[str]:
    """Return a line for each text of a file that a rule matches, with what to write instead."""
    if path.suffix not in SUFFIXES or path.name == Path(__file__).name:
        return []
    if any(folder in path.as_posix() for folder in _OTHERS):
        return []
    return [
        f"{path}:{number}: {text.strip()[:120]} [write: {better}]"
        for number, text in prose(path)
        if _ALLOWED not in text
        for pattern, better in RULES.items()
        if re.search(pattern, text)
    ]


def tracked() -> list[Path]:
    """Return the tracked files that have prose."""
    names = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    return [ROOT / name for name in names]


def main() -> None:
    """Run the command."""
    files = [Path(name) for name in sys.argv[1:]] or tracked()
    lines = [line for path in files if path.is_file() for line in findings(path)]
    print(*lines, f"{len(lines)} lines to rewrite", sep="\n")
    sys.exit(bool(lines))


if __name__ == "__main__":
    main()
