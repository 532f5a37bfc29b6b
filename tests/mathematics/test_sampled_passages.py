"""Passages between samples of a normal process, against closed forms and counting."""

import math

import numpy as np
import pytest
from scipy.special import owens_t

from stochvi.mathematics.sampled_passages import moments_of_rises
from stochvi.results.estimates import Estimate
from stochvi.testing import assert_agrees


@pytest.mark.parametrize("level", [-1.0, 0.0, 2.0, 5.0, 8.0])
@pytest.mark.parametrize("change", [1e-6, 0.05, 0.9])
def test_chance_and_mean_rise_have_closed_forms(level: float, change: float) -> None:
    chance, rise, _ = moments_of_rises(3.0 * level, 9.0, change)
    assert chance == pytest.approx(
        2.0 * owens_t(level, math.sqrt(change / (2.0 - change))), rel=1e-8
    )
    density = math.exp(-0.5 * level**2) / math.sqrt(2.0 * math.pi)
    assert rise == pytest.approx(3.0 * density * change, rel=1e-8)


def test_squares_of_rises_by_counting() -> None:
    random = np.random.default_rng(2)
    change = 0.3
    first, second = random.normal(size=(2, 10**6))
    second = (1.0 - change) * first + math.sqrt(1.0 - (1.0 - change) ** 2) * second
    passed = (first < 1.5) & (second >= 1.5)
    squares = np.where(passed, (second - first) ** 2, 0.0)
    counted = Estimate(value=squares.mean(), standard_error=squares.std() / 1e3)
    assert_agrees(counted, moments_of_rises(1.5, 1.0, change)[2])
