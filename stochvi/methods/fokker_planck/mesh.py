"""Polynomials on the unit box: Legendre in the displacement, Lobatto on half ranges of velocity.

Symbols: xi in [-1, 1] displacement, u in [-U, U] velocity, g(u) = exp(-u^2 / 2) its weight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.quadrature import gauss_panels

Array = NDArray[np.float64]

EXTRA_NODES = 12
"""Gauss nodes of an element beyond its degree: for the weight, which is no polynomial."""


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """Elements and polynomial degrees of a discretisation.

    Parameters
    ----------
    x_breaks, x_degree
        Ends of the elements in xi, from -1 to 1, and the degree of the Legendre polynomials in
        each; the trial functions may jump from element to element.
    u_breaks, u_degree
        Ends of the elements in abs(u), from 0 to the largest velocity U in units of the speed
        scale, and the degree in each; the same for u < 0. Continuous, also at 0.
    """

    x_breaks: tuple[float, ...]
    x_degree: int
    u_breaks: tuple[float, ...]
    u_degree: int

    @property
    def reach(self) -> float:
        """The largest velocity U; also where a box ends that has no stop."""
        return self.u_breaks[-1]

    @property
    def unknowns(self) -> int:
        """How many coefficients the density has."""
        return (len(self.x_breaks) - 1) * (self.x_degree + 1) * self.velocity.size

    @cached_property
    def velocity(self) -> VelocityBasis:
        """The functions of velocity and the integrals that no scene changes."""
        return VelocityBasis(self.u_breaks, self.u_degree)

    @cached_property
    def displacement(self) -> tuple[DisplacementElement, ...]:
        """The elements in xi."""
        ends = zip(self.x_breaks[:-1], self.x_breaks[1:], strict=True)
        return tuple(DisplacementElement(left, right, self.x_degree) for left, right in ends)


def legendre(degree: int, x: Array) -> tuple[Array, Array]:
    """P_0 .. P_degree and their derivatives at x, on a new last axis."""
    values = np.zeros((*x.shape, degree + 1))
    slopes = np.zeros_like(values)
    values[..., 0] = 1.0
    if degree > 0:
        values[..., 1], slopes[..., 1] = x, 1.0
    for k in range(1, degree):
        values[..., k + 1] = ((2 * k + 1) * x * values[..., k] - k * values[..., k - 1]) / (k + 1)
        slopes[..., k + 1] = slopes[..., k - 1] + (2 * k + 1) * values[..., k]
    return values, slopes


def lobatto(degree: int, x: Array) -> tuple[Array, Array]:
    """Two linear functions, then integrals of P_1 .. P_(degree - 1), which vanish at both ends."""
    values, slopes = legendre(degree, x)
    for k in range(degree, 1, -1):
        scale = 1.0 / math.sqrt(4.0 * k - 2.0)
        values[..., k] = scale * (values[..., k] - values[..., k - 2])
        slopes[..., k] = scale * (slopes[..., k] - slopes[..., k - 2])
    values[..., 0], slopes[..., 0] = (1.0 - x) / 2.0, -0.5
    values[..., 1], slopes[..., 1] = (1.0 + x) / 2.0, 0.5
    return values, slopes


class VelocityBasis:
    """Continuous functions N_k(u) on [-U, U], a kink allowed at 0.

    `half` functions live on u >= 0, the first is 1 at u = 0; those of u < 0 are their mirror
    images and share the first. `plus` and `minus` are the places of both among all functions.
    """

    def __init__(self, breaks: Sequence[float], degree: int) -> None:
        self.breaks = np.asarray(breaks, dtype=float)
        self.degree = degree
        self.elements = len(breaks) - 1
        self.half = self.elements * degree + 1
        self.size = 2 * self.half - 1
        self.plus = np.arange(self.half)
        self.minus = np.concatenate([[0], np.arange(self.half, self.size)])
        self.nodes = degree + EXTRA_NODES
        self._tabulate()

    def values(self, u: Array) -> tuple[Array, Array]:
        """The functions of u >= 0 and their derivatives, on a new last axis."""
        element = np.clip(np.searchsorted(self.breaks, u, side="right") - 1, 0, self.elements - 1)
        length = np.diff(self.breaks)[element]
        local = 2.0 * (u - self.breaks[element]) / length - 1.0
        values, slopes = lobatto(self.degree, local)
        slopes *= 2.0 / length[..., None]
        found = np.zeros((2, *u.shape, self.half))
        for e in range(self.elements):
            here = (element == e)[..., None]
            places = self._places(e)
            found[0][..., places] += np.where(here, values, 0.0)
            found[1][..., places] += np.where(here, slopes, 0.0)
        return found[0], found[1]

    def _places(self, element: int) -> NDArray[np.intp]:
        """Of an element's functions among the half: both ends, then those inside."""
        inner = self.elements + 1 + element * (self.degree - 1)
        return np.array([element, element + 1, *range(inner, inner + self.degree - 1)])

    def _tabulate(self) -> None:
        """Integrals of g N_l against N_k: u, N_k' N_l, N_k' N_l', u N_k' N_l over each half."""
        u, weights = gauss_panels(self.breaks, self.nodes)
        weights = weights * np.exp(-(u**2) / 2.0)
        values, slopes = self.values(u)

        def pair(test: Array, factor: Array | float, trial: Array) -> Array:
            return test.T @ ((weights * factor)[:, None] * trial)

        flux = pair(values, u, values)
        drift = pair(slopes, 1.0, values)
        zero = np.zeros_like(flux)
        self.flux_plus = self.both(flux, zero)
        self.flux_minus = self.both(zero, -flux)
        self.drift = self.both(drift, -drift)
        diffusion = pair(slopes, 1.0, slopes)
        damping = pair(slopes, u, values)
        self.diffusion = self.both(diffusion, diffusion)
        self.damping = self.both(damping, damping)
        self.half_moments = np.stack([(weights * u**power) @ values for power in range(4)])
        self.mass = self.spread(self.half_moments[0])
        self.square = self.spread(self.half_moments[2])

    def both(self, plus: Array, minus: Array) -> Array:
        """A matrix over all functions from those over each half."""
        whole = np.zeros((self.size, self.size))
        whole[np.ix_(self.plus, self.plus)] += plus
        whole[np.ix_(self.minus, self.minus)] += minus
        return whole

    def spread(self, half: Array) -> Array:
        """An even functional over all functions from that over one half."""
        whole = np.zeros(self.size)
        whole[self.plus] += half
        whole[self.minus] += half
        return whole

    def flux_above(self, threshold: Array) -> Array:
        """Integrals of g u N_k over u > threshold, one row per threshold."""
        edges = np.maximum(self.breaks, threshold[:, None])
        u, weights = gauss_panels(edges, self.nodes)
        values, _ = self.values(u)
        flux: Array = np.einsum("bq,bqk->bk", weights * u * np.exp(-(u**2) / 2.0), values)
        return flux

    def wall(self, restitution: Array) -> tuple[Array, Array]:
        """What a stop takes and gives back, one pair of matrices per restitution R.

        integral over u > 0 of g u N_l(u) N_k(u), and of g u N_l(u) N_k(R u), the second by Gauss
        between mesh points and mesh points / R, where its integrand is smooth.
        """
        with np.errstate(divide="ignore"):
            images = np.minimum(self.breaks[1:] / restitution[:, None], self.breaks[-1])
        mesh = np.broadcast_to(self.breaks, (len(restitution), len(self.breaks)))
        edges = np.sort(np.concatenate([mesh, images], axis=1), axis=1)
        u, weights = gauss_panels(edges, self.nodes)
        weights = weights * u * np.exp(-(u**2) / 2.0)
        arriving = weights[..., None] * self.values(u)[0]
        leaving, _ = self.values(restitution[:, None] * u)
        taken = self.flux_plus[np.ix_(self.plus, self.plus)]
        return taken, np.swapaxes(leaving, 1, 2) @ arriving


class DisplacementElement:
    """Legendre polynomials on one interval of xi, with tables at its Gauss nodes."""

    def __init__(self, left: float, right: float, degree: int) -> None:
        self.left, self.right, self.degree = left, right, degree
        self.size = degree + 1
        self.xi, self.weights = gauss_panels([left, right], degree + EXTRA_NODES)
        values, slopes = legendre(degree, self.local(self.xi))
        slopes *= 2.0 / (right - left)
        self.values: Array = values
        self.products = (values[:, :, None] * values[:, None, :]).reshape(len(self.xi), -1)
        self.slope_products = (slopes[:, :, None] * values[:, None, :]).reshape(len(self.xi), -1)
        self.at_right: Array = np.ones(self.size)
        self.at_left: Array = np.where(np.arange(self.size) % 2 == 0, 1.0, -1.0)

    def local(self, xi: Array) -> Array:
        """xi on the scale of the element, from -1 to 1."""
        return (2.0 * xi - self.left - self.right) / (self.right - self.left)
