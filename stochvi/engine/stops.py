"""The stops of a structure and the classes of their laws, for a kernel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.law import Laws, Stops


def row_of_numbers(law: Any) -> NDArray[np.float64]:
    """The numbers of a law, as `read` finds them in a table."""
    return np.concatenate([np.ravel(np.asarray(each, float)) for each in law])


def stops_of(
    places: NDArray[np.float64], thresholds: NDArray[np.float64], laws: dict[tuple[int, int], Any]
) -> tuple[Stops, Laws | None]:
    """The stops of all pairs, and the classes of their laws.

    `laws` holds the law of each stop by its pair and 0 for the lower, 1 for the upper stop.
    """
    example = {type(law): law for law in laws.values()}
    classes = sorted(example, key=lambda kind: kind.__qualname__)
    chain = None
    for kind in reversed(classes):
        chain = Laws(example[kind], chain)
    rows = {2 * pair + upper: row_of_numbers(law) for (pair, upper), law in laws.items()}
    width = max((len(row) for row in rows.values()), default=1)
    numbers = np.zeros((2 * len(places), width))
    kinds = np.zeros(places.shape, np.int64)
    for (pair, upper), law in laws.items():
        row = rows[2 * pair + upper]
        numbers[2 * pair + upper, : len(row)] = row
        kinds[pair, upper] = classes.index(type(law))
    return Stops(places, kinds, numbers, thresholds), chain
