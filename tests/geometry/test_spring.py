"""The critically damped spring against its differential equation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bodysense.geometry.spring import spring_step


@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(0.01, 1.0), st.floats(0, 1), st.floats(0, 1))
def test_two_steps_are_one(offset: float, velocity: float, half_life: float, first: float, second: float) -> None:
    start = np.array(offset), np.array(velocity)
    twice = spring_step(*spring_step(*start, half_life, first), half_life, second)
    np.testing.assert_allclose(twice, spring_step(*start, half_life, first + second), atol=1e-9)


def test_half_is_closed_after_the_half_life() -> None:
    offset, _ = spring_step(np.array([1.0, -2.0]), np.zeros(2), 0.1, 0.1)
    np.testing.assert_allclose(offset, [0.5, -1.0], atol=1e-12)


@pytest.mark.parametrize("time", [0.0, 0.05, 0.3])
def test_it_is_critically_damped(time: float) -> None:
    """x″ = −2 y x′ − y² x, by differences."""
    half_life, start = 0.1, (np.array(1.0), np.array(-3.0))
    y, step = 1.6783469900166605 / half_life, 1e-5
    x, speed = spring_step(*start, half_life, time)
    after, faster = spring_step(*start, half_life, time + step)
    assert (after - x) / step == pytest.approx(speed, rel=1e-2, abs=1e-3)
    assert (faster - speed) / step == pytest.approx(-2 * y * speed - y * y * x, rel=1e-2, abs=1e-2)
