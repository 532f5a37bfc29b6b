"""The integral of a function of one's own, such as the energy of a force."""

from __future__ import annotations

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.quadrature import gauss_legendre
from stochvi.scenes.validation import Function, evaluated

NODES, WEIGHTS = gauss_legendre(16)
"""Nodes and weights of the Gauss-Legendre rule on each interval of an integral of a force."""

MOST_HALVINGS = 60
"""Largest number of times that an interval about a kink or a jump is halved."""

QUADRATURE_ERROR = 1e-14
"""Relative change of an integral, when an interval is halved, below which it counts as rounding."""


def integral_of(function: Function, ends: Vector) -> Vector:
    """Integral from 0 to each end: from one end to the next, halved where that changes anything."""
    places = np.unique(np.append(ends.ravel(), 0.0))
    starts, stops = places[:-1], places[1:]
    owner = np.arange(len(starts))
    parts = np.zeros(len(starts))
    for _ in range(MOST_HALVINGS):
        middle = (starts + stops) / 2.0
        whole, size = _panel(function, starts, stops)
        halves = _panel(function, starts, middle)[0] + _panel(function, middle, stops)[0]
        scale = np.maximum(np.abs(starts), np.abs(stops)) * size
        with np.errstate(invalid="ignore"):  # forces that are infinite are integrated as such
            open_ = np.abs(halves - whole) > QUADRATURE_ERROR * scale
        np.add.at(parts, owner[~open_], halves[~open_])
        if not np.any(open_):
            break
        starts, middle, stops, owner = starts[open_], middle[open_], stops[open_], owner[open_]
        last = halves[open_]
        starts, stops = np.concatenate([starts, middle]), np.concatenate([middle, stops])
        owner = np.concatenate([owner, owner])
    else:
        np.add.at(parts, owner[: len(last)], last)
    # added up outwards from 0: large energies far out take no digits from small ones
    zero = int(np.searchsorted(places, 0.0))
    left, right = -np.cumsum(parts[:zero][::-1])[::-1], np.cumsum(parts[zero:])
    energy = np.concatenate([left, [0.0], right])
    return np.asarray(energy[np.searchsorted(places, ends)])


def _panel(function: Function, starts: Vector, stops: Vector) -> tuple[Vector, Vector]:
    """Integral over each interval, and the largest value in it."""
    half = (stops - starts) / 2.0
    nodes = ((starts + stops) / 2.0)[:, None] + half[:, None] * NODES
    values = evaluated(function, nodes)
    return np.asarray(half * (values @ WEIGHTS)), np.abs(values).max(axis=1)
