"""Names that errors suggest."""

from __future__ import annotations

from string import ascii_lowercase, ascii_uppercase

from hypothesis import given
from hypothesis import strategies as st

from bodysense.errors import did_you_mean


@given(st.permutations(ascii_lowercase), st.integers(5, 20), st.sets(st.integers(0, 19)), st.booleans())
def test_a_name_is_meant_if_four_fifths_of_its_letters_are_right(
    letters: list[str], count: int, wrong: set[int], capitals: bool
) -> None:
    name = "".join(letters[:count])
    typed = "".join("0" if k in wrong else letter for k, letter in enumerate(name))
    right = count - typed.count("0")
    meant = did_you_mean(typed.upper() if capitals else typed, (ascii_uppercase[:4], name, "unlike"))
    assert meant == (f"did you mean {name}?" if 5 * right >= 4 * count else "")
