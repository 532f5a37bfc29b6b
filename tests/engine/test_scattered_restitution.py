"""Restitutions that are drawn, and the numbers that they are drawn by."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from stochvi import Restitution
from stochvi.engine.compiled_laws import functions_of, row_of_numbers
from stochvi.engine.compiling import kernel
from stochvi.engine.law import is_rigid, rebound
from stochvi.engine.law_calls import mean_rebound_of, rebound_of
from stochvi.engine.laws.scattered_restitution import CELLS
from stochvi.engine.uniform_numbers import uniform_of
from support import naive


@kernel
def chances(words, number, found):
    """The number of one event of many words."""
    for i in range(len(words)):
        found[i] = uniform_of(words[i], number)


def drawn(words: np.ndarray, number: int) -> np.ndarray:
    found = np.empty(len(words))
    chances(words, number, found)
    return found


def test_chances_are_those_of_the_plain_twin() -> None:
    words = np.random.default_rng(1).integers(0, 2**64, 50, dtype=np.uint64)
    for number in (0, 1, 999, 10_000):
        twin = [naive.uniform(int(word), number) for word in words]
        assert drawn(words, number).tolist() == twin


@pytest.mark.parametrize("step", [1, 2**32, 0x9E3779B97F4A7C15])
def test_chances_of_neighbours_are_uniform_and_independent(step: int) -> None:
    """Of words that follow one another, of numbers that do, and of both in pairs."""
    count = 20_000
    words = np.arange(count, dtype=np.uint64) * np.uint64(step)
    first, second = drawn(words, 0), drawn(words, 1)
    for one in (first, second):
        assert stats.kstest(one, "uniform").pvalue > 1e-4
    for one, other in ((first, second), (first[1:], first[:-1]), (first[1:], second[:-1])):
        assert abs(np.corrcoef(one, other)[0, 1]) < 4.5 / np.sqrt(count)
    of_numbers = np.array([drawn(words[:1], number)[0] for number in range(2000)])
    assert stats.kstest(of_numbers, "uniform").pvalue > 1e-4


@pytest.mark.parametrize("mean", [0.3, 0.7])
def test_rebounds_have_the_beta_distribution(mean: float) -> None:
    law = Restitution(coefficient={"mean": mean, "std": 0.2})
    assert law.scatter is not None
    compiled = law.compiled()
    assert is_rigid(compiled)
    # one number in the middle of each of ten parts of every cell
    u = (np.arange(10 * CELLS) + 0.5) / (10 * CELLS)
    r = np.array([rebound(compiled, 2.0, each) for each in u]) / 2.0
    known = stats.beta(law.scatter.alpha, law.scatter.beta)
    assert np.abs(known.cdf(r) - u).max() < 1.0 / CELLS
    # the middles of ten parts miss 1 % of the variance within a cell
    assert r.mean() == pytest.approx(mean, rel=1e-12)
    assert np.mean(r**2) == pytest.approx(law.restitution_mean_square, rel=1e-6)


def test_kernels_read_it_from_a_table_of_numbers() -> None:
    laws = [Restitution(coefficient={"mean": mean, "std": 0.1}).compiled() for mean in (0.4, 0.8)]
    rows = [row_of_numbers(law) for law in laws]
    table, functions = np.stack(rows), functions_of(laws[:1])
    for row, law in enumerate(laws):
        assert mean_rebound_of(functions, 0, table, row, 2.0) == pytest.approx(0.8 * (1 + row))
        for uniform in (1e-16, 0.3, 1.0 - 1e-16):
            found = rebound_of(functions, 0, table, row, 2.0, uniform)
            assert found == rebound(law, 2.0, uniform) and 0.0 <= found <= 2.0


def test_without_scatter_it_is_the_plain_law() -> None:
    plain = Restitution(coefficient=0.7)
    assert Restitution(coefficient={"mean": 0.7, "std": 0.0}).compiled() == plain.compiled()
