"""Strips and velocity cells of a box: first from its scales, then refined where needed.

Near the corner of a lossy stop and zero velocity the density goes as |v|^-beta on the scale
v^3 ~ S0 times the distance from the stop: strips narrow geometrically towards the stop, and the
cells of each towards 0 down to that scale; so they do where a viscoelastic stop is first touched,
down to the speed below which noise hides its damper. Everything else is left to refinement: what
the highest polynomials of a strip or cell still hold tells where it is split.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from stochvi.methods.fokker_planck.basis import Array, VelocityCells
from stochvi.methods.fokker_planck.scaled_motion import Corner, ScaledMotion
from stochvi.methods.fokker_planck.strips import Solved, Strip
from stochvi.results.errors import NotConverged

FIRST_BREAKS = (0.45, 1.0, 1.6, 2.3, 3.2)
"""Breaks of abs(u) of the first mesh; beyond the last one cells have the length LARGEST_CELL at
most."""

LARGEST_CELL = 1.7
"""Largest cell of velocity, in units of the speed of the weight."""

ENERGY_PER_STRIP = 1.5
"""Largest change of the potential energy over a strip, in units of the energy of the weight."""

FEWEST_STRIPS = 4
"""Smallest number of strips between two kinks of the force."""

NARROWING = 0.2
"""Ratio of the distances from a corner of neighbouring strips."""

SLOWING = 0.3
"""Ratio of neighbouring breaks of velocity towards u = 0."""

CORNER_CELL = 0.3
"""Smallest cell of velocity of a strip, in units of (diffusion distance)^(1/3)."""

ROOTED, ROOTED_STRIPS = 0.15, 4
"""Ratio and number of strips that narrow towards a root of the force: what the smallest leaves of
an integral of y^(5/2) is 1e-11 of the strip it began with."""

SHORTEST_STRIP = 1e-9
"""Length of a strip, in units of half the box, below which the energy is dominated by rounding."""

LARGEST_REACH = 1e3
"""Largest velocity of a box, in units of the speed of the weight, for which a mesh is made."""

UNSOLVED = (
    "fokker-planck found no density on its first meshes: the scales of spring, load, noise and "
    "stops are too far apart; simulate this scene"
)

KEPT = 0.1
"""Share of the content of the highest polynomials that strips and cells may hold without being
split."""


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
        inner += _cut(scaled, left, right, FEWEST_STRIPS)
    ends = _towards_roots(scaled, [*inner, 1.0])
    breaks = _first_breaks(scaled.reach)
    return tuple(_anchored(left, right, breaks) for left, right in itertools.pairwise(ends))


def _towards_roots(scaled: ScaledMotion, ends: list[float]) -> list[float]:
    """Strips that narrow towards the first touch of a Hertzian stop, where y^(5/2) is no
    polynomial and would cost digits of every integral."""
    added = []
    for root, side in scaled.roots:
        size = min((abs(end - root) for end in ends if side * (end - root) > 0.0), default=0.0)
        added += [root + side * size * ROOTED**k for k in range(1, ROOTED_STRIPS + 1)]
    return sorted({*ends, *added})


def _anchored(left: float, right: float, breaks: tuple[float, ...]) -> Patch:
    anchor = -1.0 if left + right < 0.0 else 1.0
    return Patch(anchor, left - anchor, right - anchor, breaks)


def _first_breaks(reach: float) -> tuple[float, ...]:
    if not reach <= LARGEST_REACH:
        raise NotConverged(UNSOLVED)
    last = FIRST_BREAKS[-1]
    count = math.ceil((reach - last) / LARGEST_CELL)
    half = [*FIRST_BREAKS, *np.linspace(last, reach, count + 1)[1:]]
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
    if not right - left > SHORTEST_STRIP:
        raise NotConverged(UNSOLVED)
    energy = scaled.energy(np.linspace(left, right, 9))
    wide = energy.max() - energy.min() > ENERGY_PER_STRIP
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


def _narrowed(patch: Patch, corner: Corner, depth: float) -> list[Patch]:
    """A patch, cut geometrically if it ends at the corner; offsets keep their digits there."""
    place, size = corner.place - patch.anchor, patch.far - patch.near
    if size <= depth or place not in (patch.near, patch.far):
        return [patch]
    if patch.far == place:
        cut = place - NARROWING * size
        return [patch._replace(far=cut), *_narrowed(patch._replace(near=cut), corner, depth)]
    cut = place + NARROWING * size
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
    least = CORNER_CELL * min(scales)
    breaks = set(patch.breaks)
    for side in (-1.0, 1.0):
        u = min(side * u for u in patch.breaks if side * u > 0.0)
        while SLOWING * u > least:
            u *= SLOWING
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


def refined(
    scaled: ScaledMotion, solved: Solved, patches: tuple[Patch, ...], kept: float = KEPT
) -> tuple[Patch, ...]:
    """Strips and cells split where the highest polynomials hold the most, until the others hold
    `kept` of the whole."""
    both = [_unresolved(scaled, strip, q) for strip, q in zip(solved.strips, solved.q, strict=True)]
    across = np.array([row for row, _ in both])
    within = [row for _, row in both]
    everything = np.sort(np.concatenate([across, *within]))
    total = np.cumsum(everything)
    limit = everything[int(np.searchsorted(total, kept * total[-1]))]
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
