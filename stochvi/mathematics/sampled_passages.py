"""Passages of a level by a stationary normal process that is sampled at equal steps."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr

from stochvi.mathematics.quadrature import gauss_legendre

WIDEST = 9.0
"""Upper limit of the integral over the rise between two samples, in its standard deviations."""

NODES = 128
"""Number of nodes of the integral over the rise: half as many give the same 12 digits for levels up
to 8 sigma."""


def moments_of_rises(level: float, variance: float, change: float) -> tuple[float, float, float]:
    """Moments of order 0, 1 and 2 of the rise between two samples, over upward passages of a level.

    A sample y1 and the one before it, y0, contribute where y0 < u <= y1, u the level; otherwise 0.
    The rise d = y1 - y0 and the middle m = (y0 + y1) / 2 of two successive samples are independent
    normal variables. The level u lies between the samples if |m - u| <= d / 2:

        E d^k = int_0^inf d^k p(d) [Phi((u + d / 2) / s_m) - Phi((u - d / 2) / s_m)] dd.

    Parameters
    ----------
    level
        u, from the mean of the process, m.
    variance
        Variance of the process, m^2.
    change
        1 less the correlation of two successive samples, dimensionless, in (0, 2).

    Examples
    --------
    E d has the closed form sigma phi(u / sigma) (1 - rho):

    >>> _, rise, _ = moments_of_rises(2.0, 1.0, 0.1)
    >>> round(rise / (0.1 * math.exp(-2.0) / math.sqrt(2.0 * math.pi)), 12)
    1.0
    """
    spread = math.sqrt(2.0 * change * variance)
    middle = math.sqrt(0.5 * (2.0 - change) * variance)
    nodes, weights = gauss_legendre(NODES)
    rise = 0.5 * WIDEST * spread * (nodes + 1.0)
    density = np.exp(-0.5 * (rise / spread) ** 2) / (math.sqrt(2.0 * math.pi) * spread)
    # computed from upper tails, which keep their digits at high levels
    between = ndtr(-(level - 0.5 * rise) / middle) - ndtr(-(level + 0.5 * rise) / middle)
    share = 0.5 * WIDEST * spread * weights * density * between
    found = [float(share @ rise**power) for power in range(3)]
    return found[0], found[1], found[2]
