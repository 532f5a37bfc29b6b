"""Conversion factors of units, and the conventions of spectral densities.

Inside the package white noise is described by its intensity S0,

    E f(t) f(t + tau) = S0 delta(tau),

a two-sided density over angular frequency whose integral over omega / (2 pi) is the mean
square. Engineers' tables, and everything that enters or leaves through a scene file, are
one-sided densities per hertz, G(f) = 2 S(2 pi f).

Displacements are relative displacements in the impact pair, in metres from the position of
the unloaded spring; a clearance is per side. A base acceleration a acts on the relative
motion as the acceleration -a.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity, m/s^2: exact by definition (CGPM 1901)."""

ACCELERATION_DENSITY_UNITS = {"g2/Hz": STANDARD_GRAVITY**2, "(m/s2)2/Hz": 1.0}
"""One-sided acceleration densities: unit -> factor to (m/s^2)^2/Hz."""

FORCE_DENSITY_UNITS = {"N2/Hz": 1.0}
"""One-sided force densities: unit -> factor to N^2/Hz."""

DENSITY_UNITS = ACCELERATION_DENSITY_UNITS | FORCE_DENSITY_UNITS


def intensity_from_density(density: float) -> float:
    """Intensity S0 of white noise whose one-sided density per hertz is `density`.

    S0 = G / 2, because G(f) = 2 S(2 pi f).

    >>> intensity_from_density(0.4)
    0.2
    """
    return density / 2.0


def density_from_intensity(intensity: float) -> float:
    """One-sided density per hertz of white noise of intensity S0: G = 2 S0.

    >>> density_from_intensity(0.2)
    0.4
    """
    return 2.0 * intensity


def power_ratio(level_db: float) -> float:
    """Factor on a density for a level change in decibels, 10^(dB/10).

    >>> round(power_ratio(3.0), 4)
    1.9953
    """
    return math.pow(10.0, level_db / 10.0)


def plain_number(value: Any) -> Any:
    """A number of NumPy as one of Python, which JSON knows; all else as it is.

    Examples
    --------
    >>> import numpy as np
    >>> plain_number(np.int64(64)), plain_number("a")
    (64, 'a')
    """
    return value.item() if isinstance(value, np.generic) else value
