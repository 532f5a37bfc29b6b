"""Many scenes in SI units on meshes of growing fineness, and the error from two of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Array, Booleans
from stochvi.methods.fokker_planck.basis import Mesh
from stochvi.methods.fokker_planck.box_solver import BoxMoments, box_moments
from stochvi.methods.fokker_planck.error_margins import ErrorMargins
from stochvi.methods.fokker_planck.linear_boxes import FARTHEST_STOP, Boxes, boxes_of
from stochvi.model.oscillator_arrays import OscillatorArrays

CHUNK = 64
"""Number of boxes that are solved together: so many that the cost of a call does not matter, so few
that they fit into memory."""


class MeshLevel(NamedTuple):
    """Two meshes of one fineness: for boxes with a stop on the right only, and on both sides.

    Elements narrow towards a stop, where slow impacts pile up.
    """

    one_stop: Mesh
    two_stops: Mesh


def make_level(
    right: tuple[float, ...], both: tuple[float, ...], x_degree: int,
    u_breaks: tuple[float, ...], u_degree: int,
) -> MeshLevel:  # fmt: skip
    """Breaks inside the box of one stop, and those of two stops between centre and stop."""
    mirrored = tuple(-x for x in reversed(both))
    return MeshLevel(
        *(
            Mesh(x_breaks=x_breaks, x_degree=x_degree, u_breaks=u_breaks, u_degree=u_degree)
            for x_breaks in ((-1.0, *right, 1.0), (-1.0, *mirrored, *both, 1.0))
        )
    )


LEVELS = (
    make_level((0.3, 0.85, 0.97, 0.995), (0.7, 0.95, 0.995), 2, (0.0, 5.0), 7),
    make_level((0.3, 0.85, 0.97, 0.995), (0.7, 0.95, 0.995), 3, (0.0, 6.0), 11),
    make_level(
        (-0.3, 0.2, 0.55, 0.8, 0.92, 0.975, 0.995), (0.35, 0.7, 0.9, 0.975, 0.995), 3,
        (0.0, 1.0, 6.3), 8,
    ),
    make_level(
        (0.0, 0.4, 0.7, 0.88, 0.96, 0.99, 0.998), (0.3, 0.7, 0.9, 0.97, 0.995), 3,
        (0.0, 0.4, 1.5, 3.0, 6.5), 5,
    ),
)  # fmt: skip
"""Meshes that take from a fifth of a millisecond to some ten milliseconds a scene; scenes that need
finer ones are solved on strips. The third has other elements than the first two, in displacement
and in velocity: what those have in common shows in its difference to them."""

LEAST_FALL = 0.5
"""Share of the difference of the two levels before that counts where the last two agree, which may
happen by chance."""


class MeshMoments(NamedTuple):
    """Stationary averages of many scenes, SI units: one array each, or errors of them.

    Rates, F1 (`speed_rate`) and F2 (`speed_square_rate`) are 0 where there is no stop.
    """

    mean: Array
    variance: Array
    velocity_mean_square: Array
    upcrossing_rate: Array
    rate_lower: Array
    rate_upper: Array
    speed_rate_lower: Array
    speed_rate_upper: Array
    speed_square_rate_lower: Array
    speed_square_rate_upper: Array


FASTEST = 4.0
"""Fastest impacts whose rate these meshes find, in units of the speed of the box: all of them reach
farther, and rates of so rare impacts still differ from mesh to mesh."""


class Solution(NamedTuple):
    """The averages on one level, and the parts of its rates that are too slow for its meshes.

    `fall` bounds the rate of impacts faster than the threshold, over that of those faster than
    `FASTEST`, which the rates count where the threshold lies beyond; else it is 1.
    """

    moments: MeshMoments
    unresolved_lower: Array
    unresolved_upper: Array
    fall: Array


def solve(scenes: OscillatorArrays, speed: Array, level: MeshLevel, threshold: Array) -> Solution:
    """Averages on the meshes of a level; `speed` is the scale s, `threshold` in m/s."""
    scaled = boxes_of(scenes, speed, level.one_stop.reach)
    slowest = np.minimum(threshold / scaled.speed, FASTEST)
    # the density falls at least as fast as it would with the damper alone
    beyond = threshold**2 - (slowest * scaled.speed) ** 2
    beyond = np.where(threshold > FASTEST * scaled.speed, beyond, 0.0)
    fall = np.exp(-beyond / 2.0 / damper_alone(scenes))
    found = np.empty((len(BoxMoments._fields), len(speed)))
    both = scaled.stop_left & scaled.stop_right
    for mesh, places in zip(level, (np.flatnonzero(~both), np.flatnonzero(both)), strict=True):
        for start in range(0, len(places), CHUNK):
            some = places[start : start + CHUNK]
            found[:, some] = box_moments(scaled.take(some), mesh, slowest[some])
    return _in_si(scaled, BoxMoments(*found), fall)


def _in_si(scaled: Boxes, found: BoxMoments, fall: Array) -> Solution:
    """Averages in SI units from those of the dimensionless box; those of a halved box are extended
    to both halves."""
    length, speed, halved = scaled.half_length, scaled.speed, scaled.halved
    sign = np.where(scaled.mirrored, -1.0, 1.0)
    frequency = speed / length
    sides = []
    powers = {"rate": 0, "speed_rate": 1, "speed_square_rate": 2, "unresolved": 0}
    for name, power in powers.items():
        left, right = getattr(found, f"{name}_left"), getattr(found, f"{name}_right")
        left, right = left * scaled.stop_left, right * scaled.stop_right
        lower = np.where(halved, right / 2.0, np.where(scaled.mirrored, right, left))
        upper = np.where(halved, right / 2.0, np.where(scaled.mirrored, left, right))
        sides += [lower * frequency * speed**power, upper * frequency * speed**power]
    half_square = found.mean_square + 2.0 * found.mean + 1.0
    variance = np.where(halved, half_square, found.mean_square - found.mean**2)
    averages = MeshMoments(
        scaled.centre + np.where(halved, -length, sign * length * found.mean),
        variance * length**2,
        found.velocity_mean_square * speed**2,
        found.crossing_rate * frequency * np.where(halved, 0.5, 1.0),
        *sides[:-2],
    )
    return Solution(averages, sides[-2], sides[-1], fall)


def unreached(scenes: OscillatorArrays, speed: Array, upcrossing_rate: Array) -> MeshMoments:
    """Bounds on the impacts on stops that no box reaches: exp(-energy / t) times the rate of
    crossing.

    That is Rice's rate with Rayleigh's distribution of speeds; 0 for the other quantities, and for
    the stops that a box reaches. t is s^2. For a mass that is pressed onto an inelastic stop it is
    S0 / (2 b), the mean square velocity with the damper alone: fast flights last longer and lose
    less in the same time.
    """
    lowest = scenes.lowest()
    far = scenes.climb(speed**2 * FARTHEST_STOP**2 / 2.0)
    press = np.abs(scenes.force(lowest))
    hottest = np.where(_leans(scenes), damper_alone(scenes), speed**2)
    sides, factors = [], []
    for distance in (lowest - scenes.lower, scenes.upper - lowest):
        away = np.where(np.isfinite(distance), distance, 0.0)
        energy = away * (press + scenes.omega**2 * away / 2.0)
        rate = upcrossing_rate * np.exp(-energy / hottest)
        sides.append(np.where(np.isfinite(distance) & (distance > far), rate, 0.0))
        # without damper no hotter than the energy that it takes to come there
        square = np.minimum(hottest, speed**2 + energy)
        factors.append((np.ones_like(square), np.sqrt(np.pi / 2.0 * square), 2.0 * square))
    zero = np.zeros_like(speed)
    lower, upper = factors
    hits = [hit for pair in zip(lower, upper, strict=True) for hit in pair]
    return MeshMoments(
        zero, zero, zero, zero, *(sides[k % 2] * factor for k, factor in enumerate(hits))
    )


def _leans(scenes: OscillatorArrays) -> Booleans:
    """Whether spring and load press the mass on a stop that loses energy."""
    lossy = (scenes.lowest() == scenes.positions) & (scenes.restitutions < 1.0)
    return np.asarray(lossy.any(axis=0), dtype=np.bool_)


def damper_alone(scenes: OscillatorArrays) -> Array:
    """Mean square velocity without stops, S0 / (2 b), m^2/s^2; infinite without damping."""
    with np.errstate(divide="ignore"):
        return np.asarray(scenes.intensity / (2.0 * scenes.damping_rate), dtype=np.float64)


MARGINS = ErrorMargins(safety=2.5, shared=0.3, floor=1e-06)
"""Safety factors of the error bounds, chosen on random scenes against much finer meshes. All of
1500 bounds hold there; with half of `LEAST_FALL` 8 of them fail."""


def errors(
    scenes: OscillatorArrays, before: Sequence[MeshMoments], fine: Solution, far: MeshMoments
) -> MeshMoments:
    """Bounds on the errors of `fine`, from the two levels before, coarsest first, and from stops
    out of reach.

    A part (1 - R)^2 of the impacts too slow for the mesh counts as wrong; this was found against
    much finer meshes.
    """
    sizes = fine.moments._replace(mean=np.sqrt(fine.moments.variance))
    coarser, coarse = before
    found = {
        name: np.abs(getattr(fine.moments, name) - getattr(coarse, name))
        for name in MeshMoments._fields
    }
    for name in found:
        # each level sees slow impacts that the one before did not see at all, which changes rates
        if not name.startswith("rate_"):
            last = np.abs(getattr(coarse, name) - getattr(coarser, name))
            found[name] = np.maximum(found[name], LEAST_FALL * last)
    motion = ["mean", "variance", "velocity_mean_square"]
    bounds = {}
    for side, restitution in zip(("lower", "upper"), scenes.restitutions, strict=True):
        impacts = [f"speed_rate_{side}", f"speed_square_rate_{side}"]
        moving, hitting = (*motion, "upcrossing_rate"), (*impacts, f"rate_{side}")
        for members, group in ((moving, motion), (hitting, motion + impacts)):
            largest = np.max([_ratio(found[name], getattr(sizes, name)) for name in group], axis=0)
            for name in members:
                shared = MARGINS.shared * largest * getattr(sizes, name)
                bounds[name] = MARGINS.safety * np.maximum(found[name], shared)
        bounds[f"rate_{side}"] += (1.0 - restitution) ** 2 * getattr(fine, f"unresolved_{side}")
    return MeshMoments(
        *(
            bounds[name]
            + MARGINS.floor * getattr(sizes, name)
            + MARGINS.safety * getattr(far, name)
            for name in MeshMoments._fields
        )
    )


def with_lost_rates(fine: Solution, bounds: MeshMoments) -> tuple[MeshMoments, MeshMoments]:
    """Averages and bounds, where impacts faster than a threshold are lost on the mesh: their rate
    is 0, within what the damper alone leaves of the fastest that are found."""
    lost = fine.fall < 1.0
    rates, errors = {}, {}
    for name in ("rate_lower", "rate_upper"):
        rate, error = getattr(fine.moments, name), getattr(bounds, name)
        rates[name] = np.where(lost, 0.0, rate)
        errors[name] = np.where(lost, (np.abs(rate) + error) * fine.fall, error)
    return fine.moments._replace(**rates), bounds._replace(**errors)


def _ratio(difference: Array, size: Array) -> Array:
    return np.divide(difference, size, out=np.zeros_like(size), where=size > 0.0)
