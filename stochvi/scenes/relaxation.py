"""Branches that follow a table of dynamic stiffness and loss factor over frequency: a master curve
of rubber."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import scipy

from stochvi.mathematics.numerics import Vector, Waves
from stochvi.mathematics.units import unit
from stochvi.results.errors import SceneError
from stochvi.scenes.frames import source_of
from stochvi.scenes.readers import table_of
from stochvi.scenes.text_tables import all_columns
from stochvi.scenes.validation import sentences_of

COLUMNS = {"frequency_hz": "Hz", "dynamic_stiffness": "N/m", "loss_factor": ""}
"""Columns of the file, with their units."""

FIT_ERROR, LARGEST_FIT_ERROR = 0.01, 0.1
"""Relative error of the dynamic stiffness at which a fit is good enough unless another is asked
for, and that from which on there is none."""

DENSITIES = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
"""Numbers of relaxation times per decade that are tried in turn."""

BEYOND = 30.0
"""How far the relaxation times of a fit reach beyond those of the table, as a factor."""


class Chain(NamedTuple):
    """A static stiffness, N/m, branches (stiffness, N/m, and time, s), and the largest relative
    error of their dynamic stiffness in the table."""

    stiffness: float
    branches: tuple[tuple[float, float], ...]
    error: float


def fitted(frequency_hz: Vector, stiffness: Waves, error: float) -> Chain:
    """The fewest relaxation times whose chain follows complex stiffnesses, N/m, within a relative
    error; with more of them than are useful, the best chain.

    At log-spaced times the stiffnesses of branches are those of non-negative least squares, each
    row relative to the size of its stiffness.

    Examples
    --------
    >>> f = np.geomspace(0.1, 100.0, 31)
    >>> turns = 2j * np.pi * f * 0.01
    >>> chain = fitted(f, 1e5 + 2e4 * turns / (1.0 + turns), 0.005)
    >>> chain.error < 0.005
    True
    """
    turns, size = 2j * math.pi * frequency_hz, np.abs(stiffness)
    first = 1.0 / (BEYOND * float(np.abs(turns).max()))
    decades = math.log10(BEYOND / float(np.abs(turns).min()) / first)
    best = Chain(0.0, (), math.inf)
    for density in DENSITIES:
        times = first * 10.0 ** np.linspace(0.0, decades, 2 + round(density * decades))
        ways = np.multiply.outer(turns, times)
        columns = np.column_stack([np.ones_like(turns), ways / (1.0 + ways)]) / size[:, None]
        both = np.vstack([columns.real, columns.imag])
        wanted = np.concatenate([(stiffness / size).real, (stiffness / size).imag])
        found, _ = scipy.optimize.nnls(both, wanted)
        worst = float(np.abs(columns @ found - stiffness / size).max())
        if worst < best.error:
            kept = [(float(k), float(t)) for k, t in zip(found[1:], times, strict=True) if k > 0.0]
            best = Chain(float(found[0]), tuple(kept), worst)
        if best.error <= error:
            break
    return best


def with_branches_of_file(keys: Any) -> Any:
    """The keys with the chain of the file instead of its name, if a file is given."""
    origin = source_of(keys)
    if origin is None:
        return keys
    key, source = origin
    if given := [name for name in ("stiffness", "branches") if keys.get(name) is not None]:
        raise ValueError(f"takes {key}, or stiffness and branches, got {key} and {given[0]}")
    with sentences_of(key):
        table = table_of(source, tuple(COLUMNS))
        columns = all_columns(table, tuple(COLUMNS))
        for heading, (name, wanted) in zip(table.headings, COLUMNS.items(), strict=True):
            stated = heading.unit
            if stated is not None and not (wanted and stated.same(unit(wanted))):
                raise SceneError(
                    f"{table.path} must have {name} in {wanted or 'no unit'}, got {stated.name!r}"
                )
        frequency, stiffness, loss = columns
        if len(frequency) < 3 or np.any(np.diff(frequency) <= 0.0) or frequency[0] <= 0.0:
            raise SceneError(
                f"{table.path} must hold at least 3 rising frequencies above 0, got "
                f"{len(frequency)} rows"
            )
        if np.any(stiffness <= 0.0) or np.any(loss < 0.0):
            raise SceneError(
                f"{table.path} must hold dynamic stiffnesses above 0 and loss factors of at least 0"
            )
        wanted_error = keys.get("error", FIT_ERROR)
        # the dynamic stiffness of a test is the size of the complex one
        whole = np.asarray(stiffness * (1.0 + 1j * loss) / np.sqrt(1.0 + loss**2), complex)
        chain = fitted(frequency, whole, float(wanted_error))
        if chain.error > LARGEST_FIT_ERROR:
            raise SceneError(
                f"{table.path} must be the table of a passive spring, got one that no branches "
                f"follow to {100.0 * LARGEST_FIT_ERROR:g} %: stiffness must rise with frequency as "
                "the loss factor asks for"
            )
    kept = {name: value for name, value in keys.items() if name not in (key, "error")}
    return (
        {"source": source.name}
        | kept
        | {
            "stiffness": chain.stiffness,
            "branches": [list(branch) for branch in chain.branches],
            "error": chain.error,
        }
    )
