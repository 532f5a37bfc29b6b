"""Restitution of a free mass that arrives at a speed, by laws that have one number."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.scenes.impact_laws.power import PowerLaw

MOST_LOSS, POINTS = 40.0, 41
"""Largest loss X of a viscoelastic body in the table, at which 0.3 % of the speed are left, and
number of its points."""

SERIES = 1e-4
"""Loss a w below which the series of Hunt and Crossley's law is used."""


def viscoelastic_restitution(loss: ArrayLike) -> Vector:
    """Restitution of a round viscoelastic body, 1 - 1.15345 X + 0.79827 X^2 + ... (Kuwabara and
    Kono 1987; Schwager and Poeschel 2008).

    Parameters
    ----------
    loss
        X = (c / k) (k / M)^(2/5) w^(1/5) of the force k y^(3/2) + c y^(1/2) y' and the mass M.

    Examples
    --------
    >>> viscoelastic_restitution([0.0, 0.1]).round(4).tolist()
    [1.0, 0.8929]
    """
    x = np.asarray(loss, dtype=float)
    return np.asarray(_curve()(np.sqrt(np.clip(x, 0.0, MOST_LOSS))))


@cache
def _curve() -> Any:
    """The restitution over the root of the loss, from contacts of a unit mass at unit speed."""
    from scipy.interpolate import CubicSpline

    roots = np.linspace(0.0, MOST_LOSS**0.5, POINTS)
    found = [
        PowerLaw(coefficient=1.0, loss=root**2, loss_exponent=0.5).impact(1.0, 1.0).restitution
        for root in roots[1:]
    ]
    return CubicSpline(roots, [1.0, *found])


def hunt_crossley_restitution(loss: ArrayLike) -> Vector:
    """Restitution R by the force k y^n (1 + a y'), whatever n, of the loss a w (Hunt and Crossley
    1975).

        a w - ln(1 + a w) = -a R w - ln(1 - a R w)

    Examples
    --------
    >>> hunt_crossley_restitution([0.0, 0.1]).round(4).tolist()
    [1.0, 0.9375]
    """
    from scipy.special import lambertw

    x = np.asarray(loss, dtype=float)
    safe = np.maximum(x, SERIES)
    found = 1.0 + lambertw(-(1.0 + safe) * np.exp(-1.0 - safe), 0).real
    return np.where(x < SERIES, 1.0 - 2.0 / 3.0 * x, found / safe)


def yielding_restitution(ratio: ArrayLike) -> Vector:
    """Restitution of a body that yields, (w_y / w)^(1/4) above the speed w_y (Johnson 1985, section
    11.5), of the ratio w / w_y.

    Examples
    --------
    >>> yielding_restitution([0.5, 16.0]).tolist()
    [1.0, 0.5]
    """
    return np.asarray(np.maximum(np.asarray(ratio, dtype=float), 1.0) ** -0.25)
