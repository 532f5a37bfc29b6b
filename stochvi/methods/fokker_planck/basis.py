"""What the solvers on meshes are made of. Chapters: the error from two meshes; oscillators as boxes
in dimensionless units; polynomials of displacement and velocity."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Generic, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.numerics import Array, Booleans, gauss_legendre, gauss_panels
from stochvi.model.gap import OscillatorArrays
from stochvi.model.model import Model

# ------------------------------------------------------------------------------
# How the difference of two meshes becomes a bound on the error of the finer one.
# ------------------------------------------------------------------------------


class ErrorMargins(NamedTuple):
    """The numbers that turn differences of two meshes into bounds.

    Parameters
    ----------
    safety
        Factor on the difference of the two meshes.
    shared
        Share of the largest relative difference in a group of quantities. Every member gets at
        least this error, because two meshes may agree on one of them by chance.
    floor
        Relative error that every number is granted, for the ends of the box and for rounding.
    """

    safety: float
    shared: float
    floor: float


# ------------------------------------------------------------------------------
# Oscillators between rigid stops as boxes with a linear force, in dimensionless units.
# ------------------------------------------------------------------------------


Number = TypeVar("Number", float, Array)


@dataclass(frozen=True, kw_only=True)
class LinearBox(Generic[Number]):
    """An oscillator between two places, in the units of its box.

    x = centre + half_length xi, v = speed u, time in units of half_length / speed, and

        du/dt = force + stiffness xi - damping u + white noise of intensity 2 diffusion.

    Every number is a float for one box, or an array with an entry for each of many boxes.
    """

    centre: Number
    half_length: Number
    speed: Number
    force: Number
    stiffness: Number
    damping: Number
    diffusion: Number

    @staticmethod
    def between(
        oscillator: Model | OscillatorArrays, left: Any, right: Any, speed: Any
    ) -> LinearBox[Any]:
        """The box of an oscillator, or of each of many, between two places (m).

        Parameters
        ----------
        oscillator
            An oscillator of which omega, damping_rate, intensity and load are read.
        speed
            The unit of velocity, m/s.
        """
        centre, half_length = (left + right) / 2.0, (right - left) / 2.0
        time = half_length / speed
        return LinearBox(
            centre=centre,
            half_length=half_length,
            speed=speed,
            force=(oscillator.load - oscillator.omega**2 * centre) * time / speed,
            stiffness=-((oscillator.omega * time) ** 2),
            damping=oscillator.damping_rate * time,
            diffusion=oscillator.intensity / 2.0 * time / speed**2,
        )

    @property
    def time(self) -> Number:
        """Unit of time of the box, s."""
        return self.half_length / self.speed

    def xi(self, x: Array) -> Array:
        """Displacements in the units of the box."""
        return np.asarray((np.asarray(x, dtype=float) - self.centre) / self.half_length)

    def log_weight(self, xi: Array) -> Array:
        """-energy(xi) in units of the squared speed, 0 at its largest value in the box.

        The last axis holds the places; with many boxes the first axis of the result is that of the
        boxes.
        """
        force, stiffness = np.asarray(self.force)[..., None], np.asarray(self.stiffness)[..., None]
        curved = stiffness < 0.0
        top = np.where(
            curved,
            np.clip(-force / np.where(curved, stiffness, -1.0), -1.0, 1.0),
            np.sign(force),
        )
        highest = top * (force + stiffness * top / 2.0)
        return np.asarray(xi * (force + stiffness * xi / 2.0) - highest)


@dataclass(frozen=True, kw_only=True)
class Boxes(LinearBox[Array]):
    """Many boxes, each with a stop or an elastic boundary at either end.

    `mirrored` boxes run towards -x. Those that are `halved` hold one half of a symmetric scene: a
    path that leaves the half at the centre comes back as its mirror image, that is, reflected.
    """

    restitution_left: Array
    restitution_right: Array
    stop_left: Booleans
    stop_right: Booleans
    mirrored: Booleans
    halved: Booleans

    def take(self, places: NDArray[np.intp]) -> Self:
        """The boxes at these places."""
        columns = {field.name: getattr(self, field.name)[places] for field in fields(self)}
        return type(self)(**columns)


FARTHEST_STOP = 7.0
"""A stop at a higher energy than FARTHEST_STOP^2 / 2, in units of s^2, counts as out of reach."""


def boxes_of(scenes: OscillatorArrays, speed: Array, reach: float) -> Boxes:
    """The boxes that scenes are solved in: mirrored so that a single stop is on the right.

    `speed` is the scale s, in what follows widened where the law has a heavier tail. Where no
    stop is, a box ends at the energy s^2 reach^2 / 2 above the lowest.
    """
    speed = speed * _widening(scenes, speed)
    lowest = scenes.lowest()
    far = scenes.climb(speed**2 * FARTHEST_STOP**2 / 2.0)
    end = scenes.climb(speed**2 * reach**2 / 2.0)
    stops = np.stack([lowest - scenes.lower <= far, scenes.upper - lowest <= far])
    stop_left, stop_right = stops
    left = np.where(stop_left, scenes.lower, lowest - end)
    right = np.where(stop_right, scenes.upper, lowest + end)
    r_left, r_right = np.where(stops, scenes.restitutions, 1.0)
    middle, length = (left + right) / 2.0, right - left
    halved = stop_left & stop_right & (r_left == r_right)
    halved &= np.abs(scenes.force(middle)) * length <= SYMMETRIC * speed**2
    left = np.where(halved, middle, left)
    box = LinearBox.between(scenes, left, right, speed)
    r_left = np.where(halved, 1.0, r_left)
    stop_left = stop_left & ~halved
    mirrored = stop_left & ~stop_right
    return Boxes(
        centre=box.centre,
        half_length=box.half_length,
        speed=box.speed,
        force=np.where(mirrored, -1.0, 1.0) * box.force,
        stiffness=box.stiffness,
        damping=box.damping,
        diffusion=box.diffusion,
        restitution_left=np.where(mirrored, r_right, r_left),
        restitution_right=np.where(mirrored, r_left, r_right),
        stop_left=np.where(mirrored, stop_right, stop_left),
        stop_right=np.where(mirrored, stop_left, stop_right),
        mirrored=mirrored,
        halved=halved,
    )


def _widening(scenes: OscillatorArrays, speed: Array) -> Array:
    """Factor on the width of the weight of a mass that presses on an inelastic stop, 1 or more.

    Such a mass lies near the stop most of the time, at a lower speed than s. Its rare excursions
    reach much farther than exp(-energy / s^2) allows.
    """
    lowest = scenes.lowest()
    restitution: Array = np.where(lowest == scenes.positions, scenes.restitutions, 1.0).min(axis=0)
    press = np.abs(scenes.force(lowest))
    leaning = press / (press + scenes.omega * speed + 1e-300)
    return 1.0 + PRESSING_THRESHOLD * (1.0 - restitution**2) * leaning


PRESSING_THRESHOLD = 0.5
"""Largest widening of the weight of a mass that leans on a stop, as a part of the speed scale.
Found on preloads up to 2 standard deviations, where it lowers the error of the deviation to a
quarter."""

SYMMETRIC = 1e-12
"""Stops count as symmetric up to this force of spring and load midway between them, times their
distance, in units of s^2. Rounding may leave so much."""


# ------------------------------------------------------------------------------
# Polynomials on the unit box: Legendre in the displacement, Lobatto in the velocity.
#
# Symbols: xi in [-1, 1] displacement, u in [-U, U] velocity, g(u) = exp(-u^2 / 2) its weight,
# N_k(u) the functions of velocity. They live on `VelocityCells` of any size, which differ from
# strip to strip; a `Mesh` has one set of cells for the whole box, the same for u > 0 and u < 0.
# ------------------------------------------------------------------------------


Indices = NDArray[np.intp]
Law = Callable[[Array], Array]

EXTRA_NODES = 12
"""Number of Gauss-Legendre nodes that an element has beyond its degree, because the weight is no
polynomial."""


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
        scale, and the degree in each; the same for u < 0. The trial functions are continuous, also
        at 0.
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
        """Number of coefficients of the density."""
        return (len(self.x_breaks) - 1) * (self.x_degree + 1) * self.velocity.size

    @cached_property
    def velocity(self) -> VelocityCells:
        """Functions of velocity, with the integrals that do not depend on a scene."""
        return VelocityCells((*(-u for u in self.u_breaks[:0:-1]), *self.u_breaks), self.u_degree)

    @cached_property
    def displacement(self) -> tuple[DisplacementElement, ...]:
        """Elements of displacement, in xi."""
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
        """Place xi on the scale of the element, from -1 to 1."""
        return (2.0 * xi - self.left - self.right) / (self.right - self.left)


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

    def assembled(self, local: Array, side: int = 0) -> Array:
        """Matrix over all functions of integrals over each cell, (cell, test, trial): those of one
        side of u = 0, or of both."""
        whole = np.zeros((self.size, self.size))
        some = (slice(None), slice(self.zero, None), slice(self.zero))[side]
        places = self.places[some]
        np.add.at(whole, (places[:, :, None], places[:, None, :]), local[some])
        return whole

    @cached_property
    def matrices(self) -> dict[str, Array]:
        """Integrals of g N_l against N_k over all cells: of u over u > 0 and u < 0 ("plus",
        "minus"), 1 ("mass"); and of N_k' N_l ("drift"), N_k' N_l' ("diffusion"), u N_k' N_l
        ("damping")."""
        one, values, slopes = np.ones_like(self.u), self.local_values, self.local_slopes
        local = {
            "mass": self._pair(one, values, values),
            "drift": self.drift,
            "diffusion": self._pair(one, slopes, slopes),
            "damping": self._pair(self.u, slopes, values),
        }
        found = {name: self.assembled(each) for name, each in local.items()}
        return found | {s: self.assembled(self.flux, k) for s, k in (("plus", 1), ("minus", -1))}

    @cached_property
    def moments(self) -> dict[int, Array]:
        """Integrals of g |u|^power N_k over u > 0 (key 1) and u < 0 (key -1), rows of the powers 0
        to 3."""
        powers = range(4)
        return {side: np.array([self.above(0.0, k, side) for k in powers]) for side in (-1, 1)}

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
        """Cell of each velocity u, with the values and slopes of its functions there."""
        cell = np.clip(np.searchsorted(self.breaks, u, side="right") - 1, 0, self.cells - 1)
        length = np.diff(self.breaks)[cell]
        values, slopes = lobatto(self.degree, 2.0 * (u - self.breaks[cell]) / length - 1.0)
        return cell, values, slopes * (2.0 / length)[..., None]

    def _places(self) -> Indices:
        """Indices of the functions of each cell among all: both ends first, then those inside."""
        cell = np.arange(self.cells)[:, None]
        inside = self.vertices + cell * self.inner + np.arange(self.inner)
        return np.concatenate([cell, cell + 1, inside], axis=1)

    def values(self, u: ArrayLike) -> Array:
        """All functions at places u, on a new last axis; 0 beyond the cells."""
        u = np.asarray(u, dtype=float)
        cell, values, _ = self._local(u)
        inside = (u >= self.breaks[0]) & (u <= self.breaks[-1])
        found = np.zeros((*u.shape, self.size))
        np.put_along_axis(found, self.places[cell], values * inside[..., None], axis=-1)
        return found

    def functional(self, factor: Array) -> Array:
        """Integral of g factor N_k for each function; `factor` at the nodes, (cell, node)."""
        found = np.zeros(self.size)
        np.add.at(found, self.places, (self.weights * factor) @ self.local_values)
        return found

    def _half(self, side: int) -> Array:
        """Sizes of the breaks of one side, from 0 on."""
        return np.sort(side * self.breaks)[-np.count_nonzero(side * self.breaks >= 0.0) :]

    def above(self, slowest: ArrayLike, power: int, side: int) -> Array:
        """Integrals of g |u|^power N_k over side * u > slowest; of many speeds as rows."""
        edges = np.maximum(self._half(side), np.asarray(slowest, dtype=float)[..., None])
        u, weights = gauss_panels(edges, self.degree + EXTRA_NODES)
        weights = weights * u**power * np.exp(-(u**2) / 2.0)
        found: Array = (weights[..., None, :] @ self.values(side * u))[..., 0, :]
        return found

    def returned(self, restitution: Array, side: int) -> Array:
        """Integrals over w > 0 of g w N_l(side w) N_k(-side R w): what a stop gives back, for each
        R; columns are the functions that arrive, rows those that leave.

        By Gauss between the breaks, the same on both sides, and the breaks / R, where the integrand
        is smooth.
        """
        breaks, r = self._half(side), restitution[:, None]
        with np.errstate(divide="ignore"):
            images = np.minimum(breaks[1:] / r, breaks[-1])
        mesh = np.broadcast_to(breaks, (len(r), len(breaks)))
        w, weights = gauss_panels(
            np.sort(np.concatenate([mesh, images], axis=1), axis=1), self.degree + EXTRA_NODES
        )
        arriving, inward = (self.plus, self.minus) if side > 0 else (self.minus, self.plus)
        came = (weights * w * np.exp(-(w**2) / 2.0))[..., None] * self.values(side * w)[
            ..., arriving
        ]
        left = self.values(-side * r * w)[..., inward]
        found: Array = np.swapaxes(left, 1, 2) @ came
        return found


def transmitted_flux(test: VelocityCells, trial: VelocityCells, side: int) -> Array:
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


def returned_flux(cells: VelocityCells, leaving: Law, side: int) -> Array:
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
"""Number of speeds in each cell at which a law of restitution is computed to find where its
rebounds pass a break."""

HALVINGS = 50
"""Number of halvings of the bracket around a speed whose rebound is one of the breaks."""


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
