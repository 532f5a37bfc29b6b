"""Passages of a level by a stationary normal process that is known at equal steps."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr

from stochvi.mathematics.quadrature import gauss_legendre

WIDEST = 9.0
"""Largest rise between two samples that is integrated over, in standard deviations of the rise."""

NODES = 128
"""Number of nodes of that integral: half of them give the same 12 digits up to 8 sigma."""


def moments_of_rises(level: float, variance: float, change: float) -> tuple[float, float, float]:
    """Mean of 1, d and d^2 at a sample over the passages of a level between it and the one before.

    The rise d = y1 - y0 and the middle m = (y0 + y1) / 2 of two samples are independent normal
    variables, and the level u lies between the samples, y0 < u <= y1, where |m - u| <= d / 2:

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
    Of E d there is a closed form, sigma phi(u / sigma) (1 - rho):

    >>> _, rise, _ = moments_of_rises(2.0, 1.0, 0.1)
    >>> round(rise / (0.1 * math.exp(-2.0) / math.sqrt(2.0 * math.pi)), 12)
    1.0
    """
    spread = math.sqrt(2.0 * change * variance)
    middle = math.sqrt(0.5 * (2.0 - change) * variance)
    nodes, weights = gauss_legendre(NODES)
    rise = 0.5 * WIDEST * spread * (nodes + 1.0)
    density = np.exp(-0.5 * (rise / spread) ** 2) / (math.sqrt(2.0 * math.pi) * spread)
    # by the upper tails, which keep their digits at high levels
    between = ndtr(-(level - 0.5 * rise) / middle) - ndtr(-(level + 0.5 * rise) / middle)
    share = 0.5 * WIDEST * spread * weights * density * between
    found = [float(share @ rise**power) for power in range(3)]
    return found[0], found[1], found[2]
