"""Roads by the classes of ISO 8608, driven at a constant speed."""

from __future__ import annotations

import math

import numpy as np

from stochvi.mathematics.spectra import Table

REFERENCE_WAVENUMBER = 0.1
"""Reference wavenumber n0 of ISO 8608, cycles/m."""

ROUGHNESS = {
    "A": 16e-6,
    "B": 64e-6,
    "C": 256e-6,
    "D": 1024e-6,
    "E": 4096e-6,
    "F": 16384e-6,
    "G": 65536e-6,
    "H": 262144e-6,
}
"""Geometric mean of Gd(n0) in each class, m^3: each is four times that of the class before. A class
reaches from half to twice its mean (A has no lower limit, H no upper one). The numbers come from
secondary sources that quote ISO 8608:1995; they were not compared with the standard itself."""

WAVENUMBERS = (0.01, 10.0)
"""Range of wavenumbers, cycles/m, in which a road is taken to be rough. By ISO 8608:2016,
wavenumbers below the first need not be measured on roads; the tyre filters out those above the
second. (Quoted from public previews of the standard.)"""


def velocity_density(roughness: float, speed: float) -> float:
    """One-sided density per hertz, (m/s)^2/Hz, of the vertical velocity of a point that follows
    the road: (2 pi)^2 Gd(n0) n0^2 v at every frequency.

    It follows from Gd(n) = Gd(n0) (n / n0)^-2 (ISO 8608, fitted) with f = n v: the displacement
    has the density Gd(f / v) / v = Gd(n0) n0^2 v / f^2.

    Parameters
    ----------
    roughness
        Gd(n0), m^3.
    speed
        v, m/s.

    Examples
    --------
    >>> round(velocity_density(ROUGHNESS["C"], 20.0), 8)
    0.00202129
    """
    return (2.0 * math.pi * REFERENCE_WAVENUMBER) ** 2 * roughness * speed


def road_table(roughness: float, speed: float, band_hz: tuple[float, float]) -> Table:
    """Density of the vertical acceleration, (m/s^2)^2/Hz: (2 pi f)^2 times that of the velocity."""
    f = np.array(band_hz)
    return Table(
        frequency_hz=f, density=(2.0 * math.pi * f) ** 2 * velocity_density(roughness, speed)
    )
