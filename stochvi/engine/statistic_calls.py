"""How kernels average functions of the motion over time: by an address, for all lanes at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba.core import config, types
from numpy.typing import NDArray

from stochvi.engine.calls import call_by_address
from stochvi.engine.characteristic_calls import add_rows
from stochvi.engine.compiled_laws import address_of
from stochvi.engine.compiling import kernel
from stochvi.engine.laws.force_function import compiled_of
from stochvi.engine.uniform_numbers import uniform_of, word_of_step

Rows = types.float64[:, ::1]

OF_STATISTIC = types.intp(Rows, Rows, types.intp, types.intp)
"""Signature of the function of a statistic: a row of displacements and one of rates, the sums and
their row, number of lanes."""

call_of_statistic = call_by_address(OF_STATISTIC)

FIRST_DRAW = 1 << 40
"""Number of the first random number of a step that a statistic draws, beyond those of impacts."""


class Statistics(NamedTuple):
    """Functions of the motion that are averaged, for a kernel.

    Parameters
    ----------
    functions : (statistics,), addresses of their functions, for this process only; without
        compilation the functions.
    displacements, rates : (statistics, modes), displacement and rate that a function takes, from
        the displacements and velocities of the modes.
    places : (statistics,), displacement of each at rest, m.
    spreads : (statistics,), standard deviation of what half a kick of noise adds to a rate, m/s.
    """

    functions: NDArray[Any]
    displacements: NDArray[np.float64]
    rates: NDArray[np.float64]
    places: NDArray[np.float64]
    spreads: NDArray[np.float64]


def no_statistics() -> Statistics:
    functions = np.zeros(0, object if config.DISABLE_JIT else np.int64)
    return Statistics(functions, np.zeros((0, 1)), np.zeros((0, 1)), np.zeros(0), np.zeros(0))


NO_STATISTICS = no_statistics()


def addresses_of(functions: list[Callable[..., float]]) -> NDArray[Any]:
    """Addresses of functions of displacement and rate, compiled to add up their values."""
    table = np.zeros(len(functions), object if config.DISABLE_JIT else np.int64)
    for k, function in enumerate(functions):
        added = adding(function)
        table[k] = added if config.DISABLE_JIT else address_of(added, OF_STATISTIC)
    return table


@lru_cache(maxsize=64)
def adding(function: Callable[..., float]) -> Any:
    """The function that adds the values of all lanes to a row of sums. Its machine code must live
    as long as it is called."""
    value = compiled_of(function)

    @kernel
    def add_values(motion, sums, row, lanes):
        for i in range(lanes):
            sums[row, i] += value(motion[0, i], motion[1, i])
        return 0

    return add_values


@kernel
def add_statistics(statistics, states, words, number, motion, sums, first, lanes):
    """Add the values of all functions to the rows of sums from `first` on.

    `motion` (2, lanes) is room for the displacements and the rates of one function. Rates are taken
    in the middle of a kick: half a kick of noise is drawn for each, apart from the noise of the
    path.
    """
    count, modes = statistics.displacements.shape
    for k in range(count):
        for i in range(lanes):
            motion[0, i], motion[1, i] = statistics.places[k], 0.0
        add_rows(motion, 0, statistics.displacements[k], states, 0, lanes)
        add_rows(motion, 1, statistics.rates[k], states, modes, lanes)
        spread = statistics.spreads[k]
        if spread > 0.0:
            for i in range(lanes):
                word = word_of_step(words[i], number)
                size = math.sqrt(-2.0 * math.log(uniform_of(word, FIRST_DRAW + 2 * k)))
                turn = 2.0 * math.pi * uniform_of(word, FIRST_DRAW + 2 * k + 1)
                motion[1, i] += spread * size * math.cos(turn)
        call_of_statistic(statistics.functions[k], (motion, sums, first + k, lanes))
