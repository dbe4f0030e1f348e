"""Bodies: the figures of a file that are people, whether each has a root of its own or several hang on one."""

from __future__ import annotations

from dataclasses import replace

from bodysense.errors import BodysenseError
from bodysense.io.rigs.figure import Figure
from bodysense.io.rigs.flat import hung
from bodysense.io.rigs.limbs import Tree
from bodysense.io.rigs.options import ReadingOptions
from bodysense.io.rigs.rig import sampled
from bodysense.io.rigs.structure import find_body

_FEWEST = 14  # joints of a body
_DEEPEST = 3  # joints above several bodies


def bodies_of(figures: list[Figure], options: ReadingOptions) -> list[Figure]:
    """The figures that are people. One alone is given back untried, so that recognising it says what is wrong."""
    figures = hung(figures, options)
    if options.joints is not None and len(figures) == 1:
        return figures
    found = [body for figure in figures for body in _apart(figure, _DEEPEST)]
    if len(found) == len(figures) == 1:
        return found
    bodies = [figure for figure in found if _is_body(figure)]
    return bodies or figures[:1]


def _apart(figure: Figure, deepest: int) -> list[Figure]:
    """The bodies that hang on one root; the figure itself where it does not hold two."""
    branches = [child for child in figure.children[0] if _size(figure, child) >= _FEWEST]
    if len(branches) > 1:
        parts = [figure.below(child) for child in branches]
        bodies = [part for part in parts if _is_body(part)]
        if len(bodies) > 1:
            return [replace(body, name=figure.name) for body in bodies]
    if len(branches) == 1 and deepest and len(figure.children[0]) == 1:
        inner = _apart(figure.below(branches[0]), deepest - 1)
        return inner if len(inner) > 1 else [figure]
    return [figure]


def _size(figure: Figure, point: int) -> int:
    """How many joints hang on a point, itself counted."""
    count, todo = 0, [point]
    while todo:
        here = todo.pop()
        count += here < len(figure.joints)
        todo += figure.children[here]
    return count


def _is_body(figure: Figure) -> bool:
    try:
        find_body(Tree(figure, sampled(figure).world()[0]))
    except BodysenseError:
        return False
    return True
