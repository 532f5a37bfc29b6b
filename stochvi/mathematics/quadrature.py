"""Gauss-Legendre quadrature: one rule, and the same rule on each panel of a range."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector


@cache
def gauss_legendre(nodes: int) -> tuple[Vector, Vector]:
    """Nodes and weights of the Gauss-Legendre rule on [-1, 1].

    The rule with n nodes is exact for polynomials up to the degree 2 n - 1. The arrays are shared
    by all callers and cannot be written to.

    Examples
    --------
    >>> nodes, weights = gauss_legendre(2)
    >>> round(float(weights @ nodes**2), 12)
    0.666666666667
    """
    points, weights = np.polynomial.legendre.leggauss(nodes)
    points.setflags(write=False)
    weights.setflags(write=False)
    return points, weights


def gauss_panels(edges: ArrayLike, nodes: int) -> tuple[Vector, Vector]:
    """Nodes and weights of the Gauss-Legendre rule on every panel between neighbouring edges.

    Parameters
    ----------
    edges
        Ends of the panels along the last axis, (..., panels + 1), in any unit; a panel may be
        empty.
    nodes
        Number of nodes in each panel.

    Returns
    -------
    tuple of ndarray
        Nodes and weights in the unit of the edges, both (..., panels * nodes).

    Examples
    --------
    >>> x, weights = gauss_panels([0.0, 1.0, 3.0], 2)
    >>> round(float(weights @ x**3), 12)
    20.25
    """
    points, weights = gauss_legendre(nodes)
    ends = np.asarray(edges, dtype=float)
    half = np.diff(ends)[..., None] / 2.0
    centre = (ends[..., 1:] + ends[..., :-1])[..., None] / 2.0
    shape = (*ends.shape[:-1], (ends.shape[-1] - 1) * nodes)  # also for no rows at all
    return (centre + half * points).reshape(shape), (half * weights).reshape(shape)
