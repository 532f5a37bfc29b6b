"""The response domain made again from the random numbers themselves."""

from __future__ import annotations

import numpy as np

from stochvi.methods.monte_carlo.tabulated import MOST_BLOCKS, TabulatedPlan
from support.naive import normals

SEED = 41


def coefficients(plan: TabulatedPlan, path: int, deviations: np.ndarray) -> np.ndarray:
    """a - i b of the bins of the first block of a path, from the random numbers themselves."""
    z = normals(SEED, path * MOST_BLOCKS, 2 * len(deviations))
    coefficient: np.ndarray = deviations * (z[::2] - 1j * z[1::2])
    return coefficient


AIM = 0.002
"""Relative error that the sampling is chosen for."""
