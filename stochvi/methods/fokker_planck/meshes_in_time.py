"""The box and the meshes on which a motion is followed in time."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.beta_distribution import BetaDistribution
from stochvi.methods.fokker_planck.basis import Mesh
from stochvi.methods.fokker_planck.conditions import box_ends, turning_stops
from stochvi.methods.fokker_planck.initial_states import Gaussian, Start
from stochvi.methods.fokker_planck.linear_boxes import LinearBox
from stochvi.methods.fokker_planck.operators import EndConditions
from stochvi.model.model import UPPER, Model, Stop
from stochvi.results.errors import NotConverged
from stochvi.scenes.impact_laws import Restitution


@dataclass(frozen=True, kw_only=True)
class ExtentSettings:
    """How far a box reaches in velocity and displacement, and the scale of its velocities.

    The density is solved for relative to the weight exp(-u^2 / 2), u the velocity in units of the
    scale of speed.

    Parameters
    ----------
    reach
        Largest speed beyond the one needed to reach a barrier, in scales, added as squares; or
        number of standard deviations that noise may add. Faster states are left out: exp(-reach^2 /
        2) = 2e-8 of the density.
    widest
        Largest velocity in units of the scale. Further out the weight is too small to be a good
        scale of the density.
    flattest
        Largest velocity in units of the scale, wherever the damping allows so large a scale. A
        weight that falls faster than the stationary distribution lets modes of the mesh grow
        without bound.
    start_margin
        Speed that a path may gain beyond its initial speed, in units of the scale.
    tail_kept
        Number of standard deviations of an initial Gaussian distribution that the box must hold.
    """

    reach: float = 6.0
    widest: float = 12.0
    flattest: float = 2.0
    start_margin: float = 2.0
    tail_kept: float = 6.0


EXTENT = ExtentSettings()
"""Settings of the extent of all boxes."""


@dataclass(frozen=True, kw_only=True)
class ElementSettings:
    """How a box is cut into elements of displacement and of velocity.

    Parameters
    ----------
    x_ratio, u_ratio
        Length of each thin element towards an absorbing end, and towards zero velocity, relative to
        the one before it.
    growth
        Ratio of the lengths of neighbouring elements of velocity outside the core, where the
        density falls.
    fewest
        Smallest number of elements along a box, times the element size of the level.
    layer_share
        Largest element of velocity at a level of the size 1, in units of the speed that noise gives
        to a path behind an absorbing end.
    steepest
        Largest fall of the potential energy per unit mass along one unit of length, in squares of
        the scale of speed.
    coarsest
        Largest element of velocity, in units of the scale of speed.
    """

    x_ratio: float = 0.15
    u_ratio: float = 0.3
    growth: float = 1.5
    fewest: float = 3.2
    layer_share: float = 2.0
    steepest: float = 8.0
    coarsest: float = 2.0


ELEMENTS = ElementSettings()
"""Settings of the elements of all boxes."""


class Layout(NamedTuple):
    """A box with the conditions at its ends, and the scales that its mesh has to resolve, in units
    of its speed.

    `reach` is the largest velocity, `core` the velocity up to which the mesh stays fine; `length`
    is the number of scales to be resolved along the box; `finest` is the smallest scale of
    velocity. `halved` boxes hold the right half of a symmetric one, whose paths come back from the
    centre as their mirror images.
    """

    box: LinearBox[float]
    walls: EndConditions
    reach: float
    core: float
    length: float
    finest: float
    halved: bool

    @property
    def natural(self) -> float:
        """The rate of the inner dynamics: of oscillation or of crossing the box."""
        return max(math.sqrt(-self.box.stiffness), 1.0)


class Level(NamedTuple):
    """Element size in units of the scales to be resolved, polynomial degrees, and number of layers
    towards an end."""

    size: float
    x_degree: int
    u_degree: int
    x_layers: int
    u_layers: int


LEVELS = (
    Level(0.8, 3, 4, 3, 3),
    Level(0.6, 4, 5, 4, 3),
    Level(0.42, 4, 5, 5, 4),
    Level(0.32, 5, 6, 6, 4),
    Level(0.24, 5, 6, 7, 5),
    Level(0.18, 5, 6, 8, 5),
)
"""Meshes of growing fineness, from some hundredths of a second to some ten seconds each."""

MOST_UNKNOWNS = 120_000
"""Largest number of unknowns of a mesh: it takes some 10 seconds, and 0.5 GB for the
projections."""


def lowest(model: Model, lower: float, upper: float) -> float:
    """Where the potential energy of spring and load is lowest between two displacements."""
    return min(max(model.rest, lower), upper)


def rise(model: Model, x: float, base: float) -> float:
    """Potential energy per unit mass at x over that at `base`."""
    return (x - base) * (model.omega**2 * (x + base) / 2.0 - model.load)


def restitutions(stops: Iterable[Stop]) -> EndConditions:
    """What stops give back at either end of a box; all where there is no stop."""
    found: list[float | BetaDistribution] = [1.0, 1.0]
    for stop in stops:
        law = stop.law
        assert isinstance(law, Restitution)
        found[int(stop.side == UPPER)] = law.restitution if law.scatter is None else law.scatter
    return EndConditions(*found)


def passage_layout(model: Model, lower: float, upper: float, start: Start) -> Layout:
    """Layout between absorbing barriers; for an infinite one the box ends at the stop of that side,
    or far from the other.

    The scale of speed is the largest of three: that of the stationary distribution, the speed that
    takes a path to a barrier, and the speed that noise adds on the way there.
    """
    turning = turning_stops(model, lower, upper)
    base = lowest(model, *box_ends(model, lower, upper))
    low, high = lower, upper = _relevant_barriers(model, lower, upper, base)
    for stop in turning:  # it ends the box, which a barrier out of reach does not
        low, high = (low, stop.position) if stop.side == UPPER else (stop.position, high)
    barriers = [x for x in (lower, upper) if math.isfinite(x)]
    climb = math.sqrt(max(2.0 * max(rise(model, x, base) for x in barriers), 0.0))
    length = high - low
    if not math.isfinite(length):
        length = max(abs(barriers[0] - base), abs(_place(start) - barriers[0]))
    native = max(climb, math.cbrt(model.intensity / 2.0 * length))
    law = _rms_speed(model)
    energy = _start_energy(model, start, low, high, base)
    slow = min(law, native)
    # the energy that noise may add before the path reaches a barrier that it has the energy for
    gained = climb + EXTENT.reach * _layer(model, length)
    fastest = max(
        min(math.hypot(climb, EXTENT.reach * slow), gained),
        math.sqrt(2.0 * max(energy, 0.0)) + EXTENT.start_margin * slow,
    )
    speed = max(min(law, max(slow, fastest / EXTENT.flattest)), fastest / EXTENT.widest)
    left = lower if math.isfinite(lower) else max(low, _end(model, base, fastest, -1.0))
    right = upper if math.isfinite(upper) else min(high, _end(model, base, fastest, 1.0))
    middle = (left + right) / 2.0
    off_centre = abs(model.load - model.omega**2 * middle) * (right - left)
    halved = len(barriers) == 2 and off_centre <= SYMMETRIC * speed**2
    back = restitutions(turning)
    walls = EndConditions(
        1.0 if halved else back.left if math.isinf(lower) else None,
        back.right if math.isinf(upper) else None,
    )
    return _layout(
        model, (middle if halved else left, right), speed, walls, halved,
        reach=fastest, core=climb + slow, native=native,
    )  # fmt: skip


def _rms_speed(model: Model) -> float:
    """Rms velocity of the stationary distribution without barriers, m/s; infinite without
    damping."""
    if model.damping_rate == 0.0:
        return math.inf
    return math.sqrt(model.intensity / 2.0 / model.damping_rate)


def _climbs(model: Model, lower: float, upper: float, base: float) -> tuple[float, float]:
    """Speeds at the lowest place that just reach the lower and the upper barrier, m/s."""
    first, second = (
        math.sqrt(max(2.0 * rise(model, x, base), 0.0)) if math.isfinite(x) else math.inf
        for x in (lower, upper)
    )
    return first, second


def barrier_height(model: Model, lower: float, upper: float) -> float:
    """Speed that just reaches the lower of two barriers, in rms velocities; 0 without damping."""
    climbs = _climbs(model, lower, upper, lowest(model, *box_ends(model, lower, upper)))
    return min(climbs) / _rms_speed(model)


def _relevant_barriers(
    model: Model, lower: float, upper: float, base: float
) -> tuple[float, float]:
    """The barriers, infinite for one that is reached less than exp(-reach^2 / 2) times as often as
    the other."""
    first, second = _climbs(model, lower, upper, base)
    most = math.hypot(min(first, second), EXTENT.reach * _rms_speed(model))
    return (lower if first <= most else -math.inf), (upper if second <= most else math.inf)


SYMMETRIC = 1e-12
"""Largest difference of the potential energies per unit mass at two barriers, in squares of the
scale of speed, with which they count as symmetric: rounding leaves less."""


def stops_layout(
    model: Model, left: float, right: float, walls: EndConditions, speed: float, start: Start
) -> Layout:
    """Layout between stops; for an infinite one the box ends far out; `speed` is its scale, m/s."""
    base = lowest(model, left, right)
    energy = _start_energy(model, start, left, right, base)
    fastest = max(
        EXTENT.reach * speed, math.sqrt(2.0 * max(energy, 0.0)) + EXTENT.start_margin * speed
    )
    speed = max(speed, fastest / EXTENT.widest)
    left = left if math.isfinite(left) else _end(model, base, fastest, -1.0)
    right = right if math.isfinite(right) else _end(model, base, fastest, 1.0)
    native = math.cbrt(model.intensity / 2.0 * (right - left))
    return _layout(
        model, (left, right), speed, walls, False,
        reach=fastest, core=3.0 * speed, native=max(native, speed),
    )  # fmt: skip


def _layout(
    model: Model, ends: tuple[float, float], speed: float, walls: EndConditions, halved: bool,
    *, reach: float, core: float, native: float,
) -> Layout:  # fmt: skip
    length = ends[1] - ends[0]
    steepest = max(abs(model.load - model.omega**2 * x) for x in ends)
    layer = _layer(model, length)
    return Layout(
        box=LinearBox.between(model, *ends, speed),
        walls=walls,
        reach=reach / speed,
        core=core / speed,
        length=max(length * model.omega / speed, length * steepest / speed**2 / ELEMENTS.steepest),
        finest=min(1.0, native / speed, ELEMENTS.layer_share * layer / speed),
        halved=halved,
    )


def _layer(model: Model, length: float) -> float:
    """The speed that noise gives in a natural period or on the way through the box."""
    layer = math.cbrt(model.intensity / 2.0 * length)
    if model.omega > 0.0:
        layer = min(layer, math.sqrt(math.pi * model.intensity / model.omega))
    return layer


def _place(start: Start) -> float:
    return start.mean[0] if isinstance(start, Gaussian) else start.x


def _start_energy(model: Model, start: Start, lower: float, upper: float, base: float) -> float:
    """Highest energy of a start that matters, per unit mass, m^2/s^2."""
    if not isinstance(start, Gaussian):
        return start.v**2 / 2.0 + rise(model, start.x, base)
    dx, dv = start.deviations
    ends = (
        max(start.mean[0] - EXTENT.tail_kept * dx, lower),
        min(start.mean[0] + EXTENT.tail_kept * dx, upper),
    )
    fastest = abs(start.mean[1]) + EXTENT.tail_kept * dv
    highest = max(rise(model, x, base) for x in ends)
    # the extremes of both at once are rarer still
    return max(fastest**2 / 2.0, highest)


def _end(model: Model, base: float, speed: float, side: float) -> float:
    """Farthest place that a path reaches with this speed at the lowest place, m."""
    slope = abs(model.load - model.omega**2 * base)
    energy = speed**2 / 2.0
    if model.omega > 0.0 and model.load == model.omega**2 * base:
        slope = 0.0
    pull = slope + math.sqrt(slope**2 + 2.0 * model.omega**2 * energy)
    return base + side * (2.0 * energy / pull if pull > 0.0 else math.inf)


def mesh(layout: Layout, level: Level) -> Mesh:
    """Mesh of a level, with narrow elements where slow paths meet an absorbing end."""
    size = level.size * layout.finest
    count = max(_whole(ELEMENTS.fewest / level.size), _whole(layout.length / size))
    if count > MOST_UNKNOWNS:
        raise NotConverged(
            f"the density cannot be followed in time: its mesh would need {count:.2g} elements, as "
            "the scales of spring, load, noise and stops are too far apart; simulate this scene"
        )
    ends = np.linspace(-1.0, 1.0, count + 1)
    inner = ends[1:-1].tolist()
    layers = (ends[1] - ends[0]) * ELEMENTS.x_ratio ** np.arange(1, level.x_layers + 1)
    if layout.walls.right != 1.0:
        inner += (1.0 - layers).tolist()
    if layout.walls.left != 1.0:
        inner += (layers - 1.0).tolist()
    return Mesh(
        x_breaks=(-1.0, *sorted(inner), 1.0),
        x_degree=level.x_degree,
        u_breaks=_velocities(layout, level, size),
        u_degree=level.u_degree,
    )


def _whole(number: float) -> int:
    """Next whole number from a ratio, which rounding must not change with the units."""
    return math.ceil(number - 1e-9)


def _velocities(layout: Layout, level: Level, size: float) -> tuple[float, ...]:
    count = max(1, _whole(min(layout.core, layout.reach) / size))
    step = min(layout.core, layout.reach) / count
    breaks = [0.0, *(step * ELEMENTS.u_ratio**k for k in range(level.u_layers, 0, -1))]
    breaks += [step * k for k in range(1, count + 1)]
    while breaks[-1] < layout.reach - step / 2.0:
        breaks.append(
            breaks[-1] + min(ELEMENTS.growth * (breaks[-1] - breaks[-2]), ELEMENTS.coarsest)
        )
    if len(breaks) > 2 and layout.core < layout.reach:
        breaks[-1] = layout.reach
    return tuple(breaks)
