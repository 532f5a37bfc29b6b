"""Strips in displacement with velocities of their own. Chapters: the stationary equation on strips;
the choice of strips and velocity cells."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
import scipy

from stochvi.mathematics.numerics import Array, gauss_legendre, gauss_panels
from stochvi.methods.fokker_planck.basis import (
    EXTRA_NODES,
    VelocityCells,
    legendre,
    returned_flux,
    transmitted_flux,
)
from stochvi.methods.fokker_planck.motion import ScaledMotion, StopSingularity
from stochvi.model.model import LOWER, UPPER
from stochvi.results.errors import NotConverged

# ------------------------------------------------------------------------------
# The stationary Fokker-Planck equation on strips in displacement, each with its own velocities.
#
# Symbols and equation are those of `ScaledMotion`. In every strip q is a Legendre polynomial in xi
# times the functions of `VelocityCells`; it may jump from strip to strip, where the flux is taken
# from the side that it comes from, exactly also between different cells. Each strip is reduced to
# the matrix from the flux that enters it to the flux that leaves it. To its neighbours a strip is
# then a boundary condition.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Strip:
    """A strip from anchor + near to anchor + far; offsets keep their digits close to the anchor."""

    anchor: float
    near: float
    far: float
    degree: int
    cells: VelocityCells

    @property
    def left(self) -> float:
        """Left end of the strip, xi."""
        return self.anchor + self.near

    @property
    def right(self) -> float:
        """Right end of the strip, xi."""
        return self.anchor + self.far

    @property
    def length(self) -> float:
        """Length of the strip, in xi."""
        return self.far - self.near

    @property
    def unknowns(self) -> int:
        """Number of coefficients of q in the strip."""
        return (self.degree + 1) * self.cells.size

    @cached_property
    def nodes(self) -> tuple[Array, Array, Array, Array]:
        """xi, weights, Legendre polynomials and their slopes at the Gauss nodes."""
        offset, weights = gauss_panels([self.near, self.far], self.degree + EXTRA_NODES)
        local = gauss_legendre(self.degree + EXTRA_NODES)[0]
        values, slopes = legendre(self.degree, local)
        return self.anchor + offset, weights, values, slopes * (2.0 / self.length)


class Solved(NamedTuple):
    """Coefficients of q in every strip, (Legendre, function), for a total probability of 1."""

    strips: tuple[Strip, ...]
    q: tuple[Array, ...]
    top: float


def solve_strips(motion: ScaledMotion, strips: tuple[Strip, ...]) -> Solved:
    """The density, its energies counted from the lowest of all nodes, `top` = exp(-that)."""
    lowest = min(float(motion.energy(strip.nodes[0]).min()) for strip in strips)
    pieces = [_Piece(motion, strip, lowest) for strip in strips]
    middle = int(np.argmin([float(motion.energy(np.array([s.left])).min()) for s in strips]))
    # from both ends to the middle, and back
    before, after = pieces[middle::-1], pieces[middle:]
    left = _returned(strips[0].cells, motion, LOWER) * pieces[0].weight_left
    right = _returned(strips[-1].cells, motion, UPPER) * pieces[-1].weight_right
    left, kept_left = _gathered(before[::-1], left, 1)
    right, kept_right = _gathered(after[::-1], right, -1)
    q = pieces[middle].inside(*_closed(pieces[middle], left, right))
    found = _followed(before, kept_left[::-1], q, -1)[:0:-1] + _followed(
        after, kept_right[::-1], q, 1
    )
    mass = sum(piece.mass(part) for piece, part in zip(pieces, found, strict=True))
    return Solved(strips, tuple(part / mass for part in found), float(np.exp(lowest)))


def _returned(cells: VelocityCells, motion: ScaledMotion, side: int) -> Array:
    """What an end gives back, in the mean over its restitutions."""
    parts = [share * returned_flux(cells, law, side) for share, law in motion.leaving(side)]
    return np.asarray(np.sum(parts, axis=0))


def _gathered(pieces: list[_Piece], wall: Array, side: int) -> tuple[Array, list[Array]]:
    """The boundary condition that all but the last of some strips form, in their order towards
    `side`.

    With it, for each strip, the flux that its own closed end returns for what comes in through its
    open end.
    """
    kept = []
    for piece, following in itertools.pairwise(pieces):
        inward, back = _reduced(piece, wall, side)
        kept.append(inward)
        wall = _handed(piece, following, side) @ back @ _handed(following, piece, -side)
    return wall, kept


def _followed(pieces: list[_Piece], kept: list[Array], q: Array, side: int) -> list[Array]:
    """Coefficients in strips, one after another towards `side`, from those in the first."""
    found = [q]
    for (piece, following), inward in zip(itertools.pairwise(pieces), kept, strict=True):
        entering = _handed(piece, following, side) @ piece.trace(found[-1], side)
        both = (entering, inward @ entering)
        found.append(following.inside(*(both if side > 0 else both[::-1])))
    return found


def _handed(source: _Piece, target: _Piece, side: int) -> Array:
    """Matrix from what leaves one strip to what enters its neighbour, towards `side`."""
    weight = source.weight_right if side > 0 else source.weight_left
    one, other = source.strip.cells, target.strip.cells
    matrix = source.flux_matrix(side) if one is other else transmitted_flux(other, one, side)
    return np.asarray(weight * matrix, dtype=np.float64)


def _reduced(piece: _Piece, wall: Array, side: int) -> tuple[Array, Array]:
    """A strip with a boundary condition behind it, open towards `side`.

    Returns two matrices that act on the flux that comes in through the open end. One gives the flux
    that comes in through the closed end, the other the flux that leaves through the open end.
    """
    out, through, back, into = piece.through(side)
    inward = np.linalg.solve(np.eye(len(wall)) - wall @ out, wall @ through)
    return np.asarray(inward, dtype=np.float64), into @ inward + back


def _closed(piece: _Piece, left_wall: Array, right_wall: Array) -> tuple[Array, Array]:
    """Coefficients of what enters the last strip from both sides, up to a factor."""
    out_left, cross_left, back_right, cross_right = piece.through(1)
    cells = piece.strip.cells
    first = len(cells.plus)
    returned = np.block(
        [
            [left_wall @ out_left, left_wall @ cross_left],
            [right_wall @ cross_right, right_wall @ back_right],
        ]
    )
    # what enters leaves: the functions of the breaks are 1 together, and the equations dependent
    total = np.concatenate([cells.plus < cells.vertices, cells.minus < cells.vertices]) * 1.0
    matrix = np.eye(len(total)) - returned
    matrix += np.outer(total, total) / total.sum()
    entering = np.linalg.solve(matrix, total)
    return entering[:first], entering[first:]


class _Piece:
    """The equations of a strip, its inner functions eliminated cell by cell."""

    def __init__(self, motion: ScaledMotion, strip: Strip, lowest: float) -> None:
        self.strip, cells = strip, strip.cells
        self.size = strip.degree + 1
        self.at_right = np.ones(self.size)
        self.at_left = np.where(np.arange(self.size) % 2 == 0, 1.0, -1.0)
        ends = np.array([strip.left, strip.right])
        self.weight_left, self.weight_right = np.exp(lowest - motion.energy(ends))
        self._eliminate(self._equations(motion, lowest))
        self.incoming = len(cells.plus), len(cells.minus)

    def _equations(self, motion: ScaledMotion, lowest: float) -> Array:
        """Equations as (cell, test Legendre, test function, trial Legendre, trial function)."""
        cells, strip = self.strip.cells, self.strip
        xi, weights, values, slopes = strip.nodes
        weights = weights * np.exp(lowest - motion.energy(xi))
        self.profile = weights @ values
        products = values.T @ (weights[:, None] * values)
        pushed = values.T @ ((weights * motion.force(xi))[:, None] * values)
        carried = -slopes.T @ (weights[:, None] * values)
        right = self.weight_right * np.outer(self.at_right, self.at_right)
        left = self.weight_left * np.outer(self.at_left, self.at_left)
        spreading = cells.spreading(motion.diffusion, motion.damping)
        parts = []
        for some, out in ((slice(cells.zero), -left), (slice(cells.zero, None), right)):
            terms = np.stack([carried + out, -pushed, products])
            matrices = np.stack([cells.flux[some], cells.drift[some], spreading[some]])
            parts.append(np.einsum("tji,tcab->cjaib", terms, matrices, optimize=True))
        whole = np.concatenate(parts)
        for grip in motion.grips:
            if grip.left <= (strip.left + strip.right) / 2.0 <= grip.right:
                u, inner, functions, rises = cells.split(grip.kink(xi))
                inner = inner * grip.force(xi[:, None, None], u)
                push = np.swapaxes(rises * inner[..., None], 2, 3) @ functions
                products = (weights[:, None] * values)[:, :, None] * values[:, None, :]
                whole -= np.einsum("nji,ncab->cjaib", products, push, optimize=True)
        return whole

    def _eliminate(self, whole: Array) -> None:
        """Inner functions as combinations of those of the breaks and of what enters."""
        cells, n = self.strip.cells, self.size
        inner = cells.inner
        count = cells.cells
        # the functions of one break side by side: (cell, break, Legendre)
        whole = whole.transpose(0, 2, 1, 4, 3)
        ends, inside = slice(0, 2), slice(2, None)
        inner_block = whole[:, inside, :, inside].reshape(count, inner * n, inner * n)
        inner_ends = whole[:, inside, :, ends].reshape(count, inner * n, 2 * n)
        ends_inner = whole[:, ends, :, inside].reshape(count, 2 * n, inner * n)
        block = whole[:, ends, :, ends].reshape(count, 2 * n, 2 * n)
        enters = np.where(np.arange(count)[:, None] < cells.zero, self.at_right, self.at_left)
        entrance = np.einsum("ab,cj->cajb", np.eye(inner), enters).reshape(count, -1, inner)
        solved = np.linalg.solve(inner_block, np.concatenate([inner_ends, entrance], axis=2))
        self.by_ends, self.by_entering = -solved[:, :, : 2 * n], solved[:, :, 2 * n :]
        self.pushed = -ends_inner @ self.by_entering
        self._factorise(block + ends_inner @ self.by_ends)

    def _factorise(self, blocks: Array) -> None:
        """The equations of the functions of the breaks, which couple neighbours only."""
        n, count = self.size, len(blocks)
        self.band = 2 * n - 1
        height = 3 * self.band + 1
        rows = np.arange(count)[:, None] * n + np.arange(2 * n)
        row, column = np.broadcast_arrays(rows[:, :, None], rows[:, None, :])
        banded = np.zeros((height, (count + 1) * n), order="F")
        np.add.at(banded, (2 * self.band + row - column, column), blocks)
        self.factors, self.pivots, status = scipy.linalg.lapack.dgbtrf(banded, self.band, self.band)
        if status != 0:
            raise np.linalg.LinAlgError(f"strip of {count} cells: singular equations ({status})")

    def _solve(self, right: Array) -> Array:
        found, _ = scipy.linalg.lapack.dgbtrs(
            self.factors, self.band, self.band, right, self.pivots
        )
        return np.asarray(found, dtype=np.float64)

    def flux_matrix(self, side: int) -> Array:
        """Integrals of g |u| N_k N_l over one side, between strips of the same cells."""
        cells = self.strip.cells
        rows = cells.plus if side > 0 else cells.minus
        return side * cells.assembled(cells.flux, side)[np.ix_(rows, rows)]

    def _entering(self, from_left: Array, from_right: Array) -> tuple[Array, Array]:
        """Right sides of the equations of the breaks (break, Legendre, case), and what enters
        each cell at its inner functions (cell, function, case)."""
        cells = self.strip.cells
        first, second = cells.vertices - cells.zero, cells.zero + 1
        cases = from_left.shape[1]
        right = np.zeros((cells.vertices, self.size, cases))
        right[cells.zero :] += self.at_left[None, :, None] * from_left[:first, None, :]
        right[: cells.zero + 1] += self.at_right[None, :, None] * from_right[:second, None, :]
        inner = np.concatenate([from_right[second:], from_left[first:]])
        inner = inner.reshape(cells.cells, cells.inner, cases)
        pushed = (self.pushed @ inner).reshape(cells.cells, 2, self.size, cases)
        right[:-1] += pushed[:, 0]
        right[1:] += pushed[:, 1]
        return right.reshape(-1, cases), inner

    def inside(self, from_left: Array, from_right: Array) -> Array:
        """Coefficients of q, (Legendre, function), for what enters from both sides."""
        cells, n = self.strip.cells, self.size
        right, inner = self._entering(from_left[:, None], from_right[:, None])
        ends = self._solve(right).reshape(cells.vertices, n)
        pairs = np.concatenate([ends[:-1], ends[1:]], axis=1)[:, :, None]
        bubbles = (self.by_ends @ pairs + self.by_entering @ inner)[:, :, 0]
        q = np.empty((n, cells.size))
        q[:, : cells.vertices] = ends.T
        bubbles = bubbles.reshape(cells.cells * cells.inner, n)
        q[:, cells.vertices :] = bubbles.T
        return q

    def through(self, side: int) -> tuple[Array, Array, Array, Array]:
        """Matrices from the entering to the leaving flux, with the closed end opposite to `side`.
        In order: closed end to itself, open end to closed end, open end to itself, closed end to
        open end."""
        cells, n = self.strip.cells, self.size
        plus, minus = self.incoming
        unit = np.eye(plus + minus)
        right, inner = self._entering(unit[:plus], unit[plus:])
        ends = self._solve(right).reshape(cells.vertices, n, -1)
        pairs = np.concatenate([ends[:-1], ends[1:]], axis=1)
        leaving = []
        for some, at, kept in (
            (slice(cells.zero), self.at_left, slice(cells.zero + 1)),
            (slice(cells.zero, None), self.at_right, slice(cells.zero, None)),
        ):
            traced = (
                np.einsum("j,cajb->cab", at, x[some].reshape(len(x[some]), cells.inner, n, -1))
                for x in (self.by_ends, self.by_entering)
            )
            by_ends, by_entering = traced
            bubbles = by_ends @ pairs[some] + by_entering @ inner[some]
            corners = np.einsum("j,vjc->vc", at, ends[kept])
            leaving.append(np.concatenate([corners, bubbles.reshape(-1, plus + minus)]))
        left_out, right_out = leaving
        if side > 0:
            return left_out[:, :plus], left_out[:, plus:], right_out[:, plus:], right_out[:, :plus]
        return right_out[:, plus:], right_out[:, :plus], left_out[:, :plus], left_out[:, plus:]

    def trace(self, q: Array, side: int) -> Array:
        """Coefficients of what leaves towards `side`."""
        cells = self.strip.cells
        at, places = (self.at_right, cells.plus) if side > 0 else (self.at_left, cells.minus)
        found: Array = (at @ q)[places]
        return found

    def mass(self, q: Array) -> float:
        """Integral of the density over the strip."""
        cells = self.strip.cells
        return float(self.profile @ q @ cells.functional(np.ones_like(cells.u)))


# ------------------------------------------------------------------------------
# Strips and velocity cells of a box: first from its scales, then refined where needed.
#
# At an inelastic stop and near zero velocity the density goes as |v|^-beta, on the scale v^3 ~ S0
# times the distance from the stop. Strips narrow geometrically towards the stop, and the cells of
# each towards 0 down to that scale. They do so as well where a viscoelastic stop is first touched,
# down to the speed below which noise hides its damper. Everything else is found by refinement: a
# strip or cell is split where its highest polynomials still contribute much.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class StripSettings:
    """How a box is cut into strips of displacement, and each strip into cells of velocity.

    Velocities are in units of the speed of the weight, lengths in units of half the box.

    Parameters
    ----------
    first_breaks
        Breaks of abs(u) between the cells of the first mesh.
    largest_cell
        Largest cell of velocity beyond the last of these breaks.
    largest_reach
        Largest velocity of a box for which a mesh is made.
    energy_per_strip
        Largest change of the potential energy over a strip of the first mesh, in units of the
        energy of the weight.
    fewest
        Smallest number of strips between two kinks of the force.
    shortest
        Length of a strip below which rounding errors dominate the energy.
    narrowing, slowing
        Ratio of the distances of neighbouring strips from a corner, and of neighbouring breaks of
        velocity from 0.
    corner_cell
        Smallest cell of velocity of a strip, in units of (diffusion distance)^(1/3), the distance
        taken from the corner.
    root_ratio, root_strips
        Ratio of the distances of neighbouring strips from a root of the force, and their number.
        The narrowest strip, on which the integral of y^(5/2) is not exact, then holds 1e-11 of
        that integral.
    kept
        Share of the content of the highest polynomials that may be left in strips and cells which
        are not split.
    """

    first_breaks: tuple[float, ...] = (0.45, 1.0, 1.6, 2.3, 3.2)
    largest_cell: float = 1.7
    largest_reach: float = 1e3
    energy_per_strip: float = 1.5
    fewest: int = 4
    shortest: float = 1e-9
    narrowing: float = 0.2
    slowing: float = 0.3
    corner_cell: float = 0.3
    root_ratio: float = 0.15
    root_strips: int = 4
    kept: float = 0.1


STRIPS = StripSettings()
"""Settings of all meshes of strips."""

UNSOLVED = (
    "fokker-planck found no density on its first meshes: the scales of spring, load, noise and "
    "stops are too far apart; simulate this scene"
)


class Patch(NamedTuple):
    """A strip without its degrees: offsets from an anchor at -1 or 1, and breaks of velocity."""

    anchor: float
    near: float
    far: float
    breaks: tuple[float, ...]


class Degrees(NamedTuple):
    """Degrees of the polynomials in xi and in u."""

    place: int
    velocity: int


def first_patches(scaled: ScaledMotion) -> tuple[Patch, ...]:
    """Strips from energies and knots, not yet graded towards the corners."""
    edges = [-1.0, *(knot for knot in scaled.knots), 1.0]
    inner = []
    for left, right in itertools.pairwise(edges):
        inner += _cut(scaled, left, right, STRIPS.fewest)
    ends = _towards_roots(scaled, [*inner, 1.0])
    breaks = _first_breaks(scaled.reach)
    return tuple(_anchored(left, right, breaks) for left, right in itertools.pairwise(ends))


def _towards_roots(scaled: ScaledMotion, ends: list[float]) -> list[float]:
    """Strips that narrow towards the first touch of a Hertzian stop, where y^(5/2) is no
    polynomial and would cost digits of every integral."""
    added = []
    for root, side in scaled.roots:
        size = min((abs(end - root) for end in ends if side * (end - root) > 0.0), default=0.0)
        added += [
            root + side * size * STRIPS.root_ratio**k for k in range(1, STRIPS.root_strips + 1)
        ]
    return sorted({*ends, *added})


def _anchored(left: float, right: float, breaks: tuple[float, ...]) -> Patch:
    anchor = -1.0 if left + right < 0.0 else 1.0
    return Patch(anchor, left - anchor, right - anchor, breaks)


def _first_breaks(reach: float) -> tuple[float, ...]:
    if not reach <= STRIPS.largest_reach:
        raise NotConverged(UNSOLVED)
    last = STRIPS.first_breaks[-1]
    count = math.ceil((reach - last) / STRIPS.largest_cell)
    half = [*STRIPS.first_breaks, *np.linspace(last, reach, count + 1)[1:]]
    return (*(-u for u in reversed(half)), 0.0, *half)


def _cut(scaled: ScaledMotion, left: float, right: float, pieces: int) -> list[float]:
    """Left ends of strips in which the energy varies little, where there is any probability."""
    if pieces > 1:
        edges = np.linspace(left, right, pieces + 1)
        return [
            end
            for one, two in itertools.pairwise(edges)
            for end in _cut(scaled, float(one), float(two), 1)
        ]
    if not right - left > STRIPS.shortest:
        raise NotConverged(UNSOLVED)
    energy = scaled.energy(np.linspace(left, right, 9))
    wide = energy.max() - energy.min() > STRIPS.energy_per_strip
    if wide and energy.min() < scaled.reach**2 / 2.0:
        return _cut(scaled, left, right, 2)
    return [left]


def graded(scaled: ScaledMotion, patches: Iterable[Patch], slowest: float) -> tuple[Patch, ...]:
    """The strips, cut towards corners until impacts of the speed `slowest` are resolved."""
    found = list(patches)
    for corner in scaled.corners:
        depth = max(slowest, corner.slowest) ** 3 / scaled.diffusion
        found = [part for patch in found for part in _narrowed(patch, corner, depth)]
    return tuple(patch._replace(breaks=_slowed(scaled, patch, slowest)) for patch in found)


def _narrowed(patch: Patch, corner: StopSingularity, depth: float) -> list[Patch]:
    """A patch, cut geometrically if it ends at the corner; offsets keep their digits there."""
    place, size = corner.place - patch.anchor, patch.far - patch.near
    if size <= depth or place not in (patch.near, patch.far):
        return [patch]
    if patch.far == place:
        cut = place - STRIPS.narrowing * size
        return [patch._replace(far=cut), *_narrowed(patch._replace(near=cut), corner, depth)]
    cut = place + STRIPS.narrowing * size
    return [*_narrowed(patch._replace(far=cut), corner, depth), patch._replace(near=cut)]


def _slowed(scaled: ScaledMotion, patch: Patch, slowest: float) -> tuple[float, ...]:
    """Breaks that narrow towards 0, as finely as the distance from the corners requires."""
    scales = []
    for corner in scaled.corners:
        place = corner.place - patch.anchor
        distance = max(abs(patch.near - place), abs(patch.far - place))
        scales.append(max((scaled.diffusion * distance) ** (1.0 / 3.0), slowest, corner.slowest))
    if not scales:
        return patch.breaks
    least = STRIPS.corner_cell * min(scales)
    breaks = set(patch.breaks)
    for side in (-1.0, 1.0):
        u = min(side * u for u in patch.breaks if side * u > 0.0)
        while STRIPS.slowing * u > least:
            u *= STRIPS.slowing
            breaks.add(side * u)
    return tuple(sorted(breaks))


def make_strips(patches: Iterable[Patch], degrees: Degrees) -> tuple[Strip, ...]:
    """Make the strips of all patches; those with equal breaks share their cells."""
    shared = cache(VelocityCells)
    return tuple(
        Strip(anchor=anchor, near=near, far=far, degree=degrees.place,
              cells=shared(breaks, degrees.velocity))
        for anchor, near, far, breaks in patches
    )  # fmt: skip


def refined(scaled: ScaledMotion, solved: Solved, patches: tuple[Patch, ...]) -> tuple[Patch, ...]:
    """Strips and cells, split where the highest polynomials hold the most: those that are not split
    hold the share `STRIPS.kept` of the whole."""
    both = [_unresolved(scaled, strip, q) for strip, q in zip(solved.strips, solved.q, strict=True)]
    across = np.array([row for row, _ in both])
    within = [row for _, row in both]
    everything = np.sort(np.concatenate([across, *within]))
    total = np.cumsum(everything)
    limit = everything[int(np.searchsorted(total, STRIPS.kept * total[-1]))]
    found: list[Patch] = []
    for patch, wide, cells in zip(patches, across, within, strict=True):
        breaks = list(patch.breaks)
        for cell in np.flatnonzero(cells >= limit):
            breaks.append((patch.breaks[cell] + patch.breaks[cell + 1]) / 2.0)
        patch = patch._replace(breaks=tuple(sorted(breaks)))
        middle = (patch.near + patch.far) / 2.0
        found += (
            [patch._replace(far=middle), patch._replace(near=middle)] if wide >= limit else [patch]
        )
    return tuple(found)


def _unresolved(scaled: ScaledMotion, strip: Strip, q: Array) -> tuple[float, Array]:
    """Probability in the highest polynomials of a strip, and in those of each of its cells.

    In units of exp(-energy), from the lowest stop on (or a barrier between wells) of
    exp(-energy of that): impacts are asked for with a relative error, however rare they are, and
    rare crossings tell how often each well is visited.
    """
    cells = strip.cells
    energy = scaled.energy(strip.nodes[0])
    size = np.diff(cells.breaks)
    middle = (cells.breaks[1:] + cells.breaks[:-1]) / 2.0
    height = float(energy.min()) + middle**2 / 2.0
    share = np.exp(-np.maximum(height - scaled.rare_energy, 0.0)) * size * strip.length
    local = q[:, cells.places]
    top = np.sqrt(np.mean((local[-1] @ cells.local_values.T) ** 2, axis=1))
    k = cells.degree
    bubble = math.sqrt((1.0 / (2 * k + 1) + 1.0 / (2 * k - 3)) / (4.0 * k - 2.0))
    norms = 1.0 / (2.0 * np.arange(len(q)) + 1.0)
    inner = bubble * np.sqrt(norms @ local[:, :, -1] ** 2)
    return float(np.sum(share * top) / math.sqrt(2.0 * strip.degree + 1.0)), share * inner
