"""Strips and velocity cells of a box: first from its scales, then refined where needed.

At an inelastic stop and near zero velocity the density goes as |v|^-beta, on the scale v^3 ~ S0
times the distance from the stop. Strips narrow geometrically towards the stop, and the cells of
each towards 0 down to that scale. They do so as well where a viscoelastic stop is first touched,
down to the speed below which noise hides its damper. Everything else is found by refinement: a
strip or cell is split where its highest polynomials still contribute much.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Array
from stochvi.methods.fokker_planck.basis import VelocityCells
from stochvi.methods.fokker_planck.scaled_motion import ScaledMotion, StopSingularity
from stochvi.methods.fokker_planck.strip_solver import Solved, Strip
from stochvi.results.errors import NotConverged


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


class Strips:
    """Makes strips, and shares the cells of those with equal breaks."""

    def __init__(self) -> None:
        self._cells: dict[tuple[tuple[float, ...], int], VelocityCells] = {}

    def make(self, patches: Iterable[Patch], degrees: Degrees) -> tuple[Strip, ...]:
        """Make the strips of all patches."""
        return tuple(
            Strip(
                anchor=patch.anchor,
                near=patch.near,
                far=patch.far,
                degree=degrees.place,
                cells=self._shared(patch.breaks, degrees.velocity),
            )
            for patch in patches
        )

    def _shared(self, breaks: tuple[float, ...], degree: int) -> VelocityCells:
        key = breaks, degree
        if key not in self._cells:
            self._cells[key] = VelocityCells(breaks, degree)
        return self._cells[key]


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
