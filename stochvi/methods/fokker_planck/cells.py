"""Velocity on cells of any size from -U to U: polynomials that are continuous from cell to cell.

Symbols: u velocity, g(u) = exp(-u^2 / 2) the weight, N_k(u) the functions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.quadrature import gauss_legendre, gauss_panels
from stochvi.methods.fokker_planck.mesh import EXTRA_NODES, Array, lobatto

Indices = NDArray[np.intp]
Law = Callable[[Array], Array]


class VelocityCells:
    """Functions N_k(u) on cells between `breaks`, one of which is 0.

    The first functions are 1 at one break and 0 at all others; then come those that live inside
    one cell, cell by cell. `minus` and `plus` are the places of those that reach u < 0 and u > 0:
    the function of the break at 0 belongs to both.
    """

    def __init__(self, breaks: Sequence[float], degree: int) -> None:
        self.breaks = np.asarray(breaks, dtype=float)
        self.degree = degree
        self.cells = len(breaks) - 1
        self.vertices = self.cells + 1
        self.zero = int(np.searchsorted(self.breaks, 0.0))
        self.inner = degree - 1
        self.size = self.vertices + self.cells * self.inner
        turn = self.vertices + self.zero * self.inner
        self.minus: Indices = np.r_[: self.zero + 1, self.vertices : turn]
        self.plus: Indices = np.r_[self.zero : self.vertices, turn : self.size]
        self.places = self._places()
        self._tabulate()

    def _tabulate(self) -> None:
        """g at the Gauss nodes of each cell (cell, node), and the functions there."""
        u, weights = gauss_panels(self.breaks, self.degree + EXTRA_NODES)
        shape = (self.cells, -1)
        self.u = u.reshape(shape)
        self.weights = (weights * np.exp(-(u**2) / 2.0)).reshape(shape)
        points = gauss_legendre(self.degree + EXTRA_NODES)[0]
        values, slopes = lobatto(self.degree, points)
        self.local_values = values
        self.local_slopes = slopes[None] * (2.0 / np.diff(self.breaks))[:, None, None]
        self.flux = self._pair(self.u, values, values)
        self.drift = self._pair(np.ones_like(self.u), self.local_slopes, values)

    def _pair(self, factor: Array, test: Array, trial: Array) -> Array:
        """Integrals of g factor test trial over each cell, (cell, test, trial)."""
        weighted = (self.weights * factor)[:, :, None] * trial
        found: Array = np.swapaxes(np.broadcast_to(test, weighted.shape), 1, 2) @ weighted
        return found

    def spreading(self, diffusion: float, damping: Law) -> Array:
        """Integrals of g [diffusion N_l' + (damping(u) - diffusion u) N_l] N_k' over each cell."""
        slopes = self.local_slopes
        drag = damping(self.u) - diffusion * self.u
        along = self._pair(np.full_like(self.u, diffusion), slopes, slopes)
        return along + self._pair(drag, slopes, self.local_values)

    def split(self, kinks: Array) -> tuple[Array, Array, Array, Array]:
        """Quadrature for functions with a kink each, every cell split where the kink is in it.

        Places u and weights that hold g, (kink, cell, node), values and slopes of the functions of
        the cell there, (kink, cell, node, function).
        """
        left, right = self.breaks[:-1], self.breaks[1:]
        middle = np.clip(kinks[:, None], left, right)
        edges = np.stack(np.broadcast_arrays(left, middle, right), axis=-1)
        u, weights = gauss_panels(edges, self.degree + EXTRA_NODES)
        length = (right - left)[:, None]
        values, slopes = lobatto(self.degree, 2.0 * (u - left[:, None]) / length - 1.0)
        return u, weights * np.exp(-(u**2) / 2.0), values, slopes * (2.0 / length[..., None])

    def at(self, u: Array, coefficients: Array) -> Array:
        """The function with these coefficients at places u within the cells."""
        cell, values, _ = self._local(u)
        found: Array = np.sum(values * coefficients[self.places[cell]], axis=-1)
        return found

    def _local(self, u: Array) -> tuple[Indices, Array, Array]:
        """The cell of each u, and values and slopes of its functions there."""
        cell = np.clip(np.searchsorted(self.breaks, u, side="right") - 1, 0, self.cells - 1)
        length = np.diff(self.breaks)[cell]
        values, slopes = lobatto(self.degree, 2.0 * (u - self.breaks[cell]) / length - 1.0)
        return cell, values, slopes * (2.0 / length)[..., None]

    def _places(self) -> Indices:
        """Of the functions of each cell among all: both ends, then those inside."""
        cell = np.arange(self.cells)[:, None]
        inside = self.vertices + cell * self.inner + np.arange(self.inner)
        return np.concatenate([cell, cell + 1, inside], axis=1)

    def values(self, u: ArrayLike) -> Array:
        """All functions at places u, one row for each; 0 beyond the cells."""
        u = np.asarray(u, dtype=float)
        cell, values, _ = self._local(u)
        inside = (u >= self.breaks[0]) & (u <= self.breaks[-1])
        found = np.zeros((len(u), self.size))
        np.put_along_axis(found, self.places[cell], values * inside[:, None], axis=1)
        return found

    def functional(self, factor: Array) -> Array:
        """Integral of g factor N_k for each function; `factor` at the nodes, (cell, node)."""
        found = np.zeros(self.size)
        np.add.at(found, self.places, (self.weights * factor) @ self.local_values)
        return found

    def above(self, slowest: float, power: int, side: int) -> Array:
        """Integrals of g |u|^power N_k over side * u > slowest."""
        edges = np.unique(np.maximum(side * self.breaks, slowest))
        u, weights = gauss_panels(edges, self.degree + EXTRA_NODES)
        found: Array = (weights * u**power * np.exp(-(u**2) / 2.0)) @ self.values(side * u)
        return found


def passed_on(test: VelocityCells, trial: VelocityCells, side: int) -> Array:
    """Integrals of g |u| N_k N_l over side * u > 0, test and trial functions of different cells.

    Rows and columns are those of `plus` (side 1) or `minus` (side -1).
    """
    edges = np.union1d(test.breaks, trial.breaks)
    edges = edges[side * edges >= 0.0]
    u, weights = gauss_panels(edges, max(test.degree, trial.degree) + EXTRA_NODES)
    weights = weights * np.abs(u) * np.exp(-(u**2) / 2.0)
    rows, columns = (test.plus, trial.plus) if side > 0 else (test.minus, trial.minus)
    found: Array = test.values(u)[:, rows].T @ (weights[:, None] * trial.values(u)[:, columns])
    return found


def given_back(cells: VelocityCells, leaving: Law, side: int) -> Array:
    """Integrals over w > 0 of g w N_l(side w) N_k(-side leaving(w)): what a stop gives back.

    Quadrature between the breaks and where w -> leaving(w) passes one of them. Columns are the
    functions that arrive, rows those that leave.
    """
    edges = _edges(side * cells.breaks, -side * cells.breaks, leaving)
    w, weights = gauss_panels(edges, cells.degree + EXTRA_NODES)
    weights = weights * w * np.exp(-(w**2) / 2.0)
    arriving, inward = (cells.plus, cells.minus) if side > 0 else (cells.minus, cells.plus)
    came = weights[:, None] * cells.values(side * w)[:, arriving]
    found: Array = cells.values(-side * leaving(w))[:, inward].T @ came
    return found


SEARCHED = 24
"""Places in each cell at which a law of restitution is looked at for breaks that it passes."""

HALVINGS = 50
"""Of a bracket around such a place."""


def _edges(arriving: Array, leaving_breaks: Array, leaving: Law) -> Array:
    """Breaks of incident speed, and speeds that leave at a break."""
    breaks = np.sort(arriving[arriving >= 0.0])
    targets = leaving_breaks[leaving_breaks > 0.0]
    steps = np.linspace(0.0, 1.0, SEARCHED, endpoint=False)
    tried = np.append((breaks[:-1, None] + np.diff(breaks)[:, None] * steps).ravel(), breaks[-1])
    above = leaving(tried)[:, None] >= targets
    place, target = np.nonzero(above[1:] != above[:-1])
    low, high, rising = tried[place], tried[place + 1], above[place + 1, target]
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        beyond = (leaving(middle) >= targets[target]) == rising
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    return np.union1d(breaks, high)
