"""Types of arrays, which name what an array holds, not how many axes it has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
"""Real numbers, one for each of the things that a name or a docstring states."""

Matrix = NDArray[np.float64]
"""Real numbers with two axes or more, of which the last two are rows and columns."""

Array = NDArray[np.float64]
"""Real numbers of any shape."""

Whole = NDArray[np.int64]
"""Whole numbers."""

Waves = NDArray[np.complex128]
"""Complex amplitudes."""

Booleans = NDArray[np.bool_]
"""Truth values."""
