"""The least that a program with a compiled kernel takes to start: load it, and call it once."""

import numba
import numpy as np
import scipy.special  # noqa: F401 - every answer needs a special function


@numba.njit(cache=True)
def total(values):
    """Sum of an array."""
    found = 0.0
    for value in values:
        found += value
    return found


total(np.ones(8))
