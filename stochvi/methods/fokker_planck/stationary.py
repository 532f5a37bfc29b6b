"""Stationary solutions of the Fokker-Planck equation. Chapters: half-range Galerkin for many boxes;
many scenes on finer and finer meshes; `fokker_planck` and its relatives."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION, ContactStatistics, StopStatistics
from stochvi.mathematics.numerics import Array, Booleans
from stochvi.methods.fokker_planck.basis import (
    FARTHEST_STOP,
    Boxes,
    DisplacementElement,
    ErrorMargins,
    Mesh,
    VelocityCells,
    boxes_of,
    legendre,
)
from stochvi.methods.fokker_planck.density import (
    Averages,
    Refinement,
    StationaryDensity,
    accurate,
    rates_not_resolved,
    refine,
    worst_relative_error,
)
from stochvi.methods.fokker_planck.motion import Motion, check_rtol, unmet
from stochvi.model.build_response import StationaryMoments
from stochvi.model.coverage import functions, functions_of_arrays
from stochvi.model.gap import OscillatorArrays
from stochvi.model.model import Model, Stop, model_of
from stochvi.model.scales import SLOW_IMPACTS, default_thresholds
from stochvi.results.base import Response
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate
from stochvi.sampling.calculations import calculation
from stochvi.scenes.scene import Scene

# ------------------------------------------------------------------------------
# Half-range Galerkin: the stationary Fokker-Planck equation of many boxes at once.
#
# Symbols (`Boxes`): the density is p(xi, u) = M q with M = exp(-u^2 / 2 - energy(xi)), and
#
#     0 = -u dp/dxi - d/du [(force + stiffness xi - damping u) p] + diffusion d2p/du2,
#
# a particle that arrives at an end with speed w leaves it with R w. Multiplied by any function phi
# and integrated over the box (n: outwards) this is
#
#     - int p (u phi_xi + (force + stiffness xi) phi_u)
#     + int M (diffusion q_u + (damping - diffusion) u q) phi_u
#     + sum over ends of int over w > 0 of w p(end, n w) [phi(end, n w) - phi(end, -n R w)] dw = 0.
#
# On every element q is a polynomial in xi times piecewise polynomials in u, which are continuous
# but may have a kink at u = 0. phi runs through the same functions. Between elements the flux is
# taken from the side that it comes from.
# ------------------------------------------------------------------------------


class BoxMoments(NamedTuple):
    """Stationary averages in the units of the box; at either end per unit time.

    `rate` counts arrivals faster than the threshold; `speed_rate`, `speed_square_rate` are F1
    and F2; `unresolved` is the part of `rate` of impacts that would turn round within the last
    element: of speeds below (diffusion length)^(1/3). `crossing_rate` is that of the mean, upwards.
    """

    mean: Array
    mean_square: Array
    velocity_mean_square: Array
    crossing_rate: Array
    rate_left: Array
    rate_right: Array
    speed_rate_left: Array
    speed_rate_right: Array
    speed_square_rate_left: Array
    speed_square_rate_right: Array
    unresolved_left: Array
    unresolved_right: Array


def box_moments(boxes: Boxes, mesh: Mesh, threshold: Array) -> BoxMoments:
    """Solve every box on one mesh; `threshold` is the slowest arrival to count, per box."""
    return _averages(boxes, mesh, _density(boxes, mesh), threshold)


def _density(boxes: Boxes, mesh: Mesh) -> list[Array]:
    """Coefficients of q, (box, Legendre, velocity) for each element, not yet normalised.

    All that lies to the left of an element acts on it as a boundary condition: a matrix of the
    returned flux. The stop is the first of them. Each element is eliminated into the next.
    """
    *before, last = mesh.displacement
    left, passed = _stop(boxes, mesh, -1), []
    for element in before:
        left, response = _pass(boxes, element, mesh.velocity, left)
        passed.append(response)
    right = _stop(boxes, mesh, 1)
    found = [_pinned(_with_walls(boxes, last, mesh.velocity, left, right), last)]
    for response in reversed(passed):
        trace = np.einsum("bjk,j->bk", found[0], last.at_left)
        found.insert(0, np.einsum("bjkl,bl->bjk", response, trace[:, mesh.velocity.minus]))
    return found


def _block(boxes: Boxes, element: DisplacementElement, velocity: VelocityCells) -> Array:
    """The equations inside an element, (box, test j, test k, trial j, trial k)."""
    weights = element.weights * np.exp(boxes.log_weight(element.xi))
    push = boxes.force[:, None] + boxes.stiffness[:, None] * element.xi
    size = (len(weights), element.size, element.size)
    products = (weights @ element.products).reshape(size)
    slopes = (weights @ element.slope_products).reshape(size)
    pushed = ((weights * push) @ element.products).reshape(size)
    terms = np.stack(
        [
            -slopes,
            -pushed,
            boxes.diffusion[:, None, None] * products,
            (boxes.damping - boxes.diffusion)[:, None, None] * products,
        ],
        axis=-1,
    )
    known = velocity.matrices
    matrices = np.stack(
        [known["plus"] + known["minus"], known["drift"], known["diffusion"], known["damping"]]
    )
    block = terms @ matrices.reshape(4, -1)
    shape = (*size, velocity.size, velocity.size)
    return np.ascontiguousarray(block.reshape(shape).transpose(0, 1, 3, 2, 4))


def _weight_at(boxes: Boxes, xi: float) -> Array:
    return np.exp(boxes.log_weight(np.full((1, 1), xi)))[:, :, None]


def _stop(boxes: Boxes, mesh: Mesh, side: int) -> Array:
    """Matrices of the densities that arrive at a stop and that leave it, (box, test, trial)."""
    velocity = mesh.velocity
    restitution = boxes.restitution_left if side < 0 else boxes.restitution_right
    inward, outward = velocity.minus, velocity.plus
    if side < 0:
        inward, outward = outward, inward
    wall = np.zeros((len(restitution), velocity.size, velocity.size))
    wall += side * velocity.assembled(velocity.flux, side)
    wall[:, inward[:, None], outward] -= velocity.returned(restitution, side)
    return wall * _weight_at(boxes, float(side))


def _with_walls(
    boxes: Boxes, element: DisplacementElement, velocity: VelocityCells, left: Array, right: Array
) -> Array:
    """The equations of an element with the conditions at both ends, as square matrices."""
    signs = np.outer(element.at_left, element.at_left)[None, :, None, :, None]
    block = _block(boxes, element, velocity)
    block += signs * left[:, None, :, None, :]
    block += right[:, None, :, None, :]
    size = block.shape[1] * block.shape[2]
    return block.reshape(len(block), size, size)


def _pass(
    boxes: Boxes, element: DisplacementElement, velocity: VelocityCells, behind: Array
) -> tuple[Array, Array]:
    """Eliminate an element: the boundary condition of it and all to its left, and its response.

    The response maps the trace of q that comes in through its right end to the coefficients of q.
    """
    weight, incoming = _weight_at(boxes, element.right), velocity.minus
    whole = _with_walls(boxes, element, velocity, behind, weight * velocity.matrices["plus"])
    # what comes in through the open end, in each of the functions that reach it
    entrance = element.at_right[:, None, None] * velocity.matrices["minus"][:, incoming]
    entrance = entrance.reshape(-1, len(incoming))
    shape = (len(whole), element.size, velocity.size, len(incoming))
    solution = np.asarray(np.linalg.solve(whole, -weight * entrance), dtype=np.float64)
    response = solution.reshape(shape)
    wall = np.zeros_like(behind)
    wall -= weight * velocity.matrices["minus"]
    back = np.einsum("j,bjkl->bkl", element.at_right, response)
    wall[:, :, incoming] -= weight * (velocity.matrices["plus"] @ back)
    return wall, response


def _pinned(whole: Array, element: DisplacementElement) -> Array:
    """The null vector: one equation, which the others imply, is given up to set its size."""
    whole[:, 0, :] = 0.0
    whole[:, 0, 0] = 1.0
    one = np.zeros((1, whole.shape[1], 1))
    one[0, 0] = 1.0
    solution = np.asarray(np.linalg.solve(whole, one), dtype=np.float64)
    return solution.reshape(len(whole), element.size, -1)


def _averages(boxes: Boxes, mesh: Mesh, density: list[Array], threshold: Array) -> BoxMoments:
    velocity = mesh.velocity
    mass_of, square_of = velocity.moments[1][[0, 2]] + velocity.moments[-1][[0, 2]]
    mass, first, second, square = np.zeros((4, len(threshold)))
    for element, q in zip(mesh.displacement, density, strict=True):
        weights = element.weights * np.exp(boxes.log_weight(element.xi))
        for power, total in enumerate((mass, first, second)):
            profile = (weights * element.xi**power) @ element.values
            total += np.sum(profile * (q @ mass_of), axis=1)
        square += np.sum((weights @ element.values) * (q @ square_of), axis=1)
    mean = first / mass
    arrivals = []
    for side, end in ((-1, 0), (1, -1)):
        q, element = density[end], mesh.displacement[end]
        at = element.at_right if side > 0 else element.at_left
        trace = np.einsum("bjk,j->bk", q, at) * (_weight_at(boxes, side)[:, 0] / mass[:, None])
        turning = np.cbrt(boxes.diffusion * (element.right - element.left))
        above, faster = (
            np.sum(velocity.above(slowest, 1, side) * trace, axis=1)
            for slowest in (threshold, np.maximum(threshold, turning))
        )
        f1, f2 = velocity.moments[side][2:] @ trace.T
        arrivals.append((above, f1, f2, np.abs(above - faster)))
    return BoxMoments(
        mean=mean,
        mean_square=second / mass,
        velocity_mean_square=square / mass,
        crossing_rate=_crossing_rate(boxes, mesh, density, np.where(boxes.halved, -1.0, mean))
        / mass,
        **{
            f"{name}_{side}": column
            for side, columns in zip(("left", "right"), arrivals, strict=True)
            for name, column in zip(ARRIVALS, columns, strict=True)
        },
    )


ARRIVALS = "rate", "speed_rate", "speed_square_rate", "unresolved"


def _crossing_rate(boxes: Boxes, mesh: Mesh, density: list[Array], level: Array) -> Array:
    """Mean of the fluxes up and down through a level in each box, before normalisation."""
    found, speeds = np.zeros(len(level)), mesh.velocity.moments
    for element, q in zip(mesh.displacement, density, strict=True):
        here = (level >= element.left) & (level < element.right)
        profile, _ = legendre(element.degree, element.local(level))
        trace = np.einsum("bj,bjk->bk", profile, q)
        found += np.where(here, trace @ (speeds[1][1] + speeds[-1][1]) / 2.0, 0.0)
    return found * np.exp(boxes.log_weight(level[:, None]))[:, 0]


# ------------------------------------------------------------------------------
# Many scenes in SI units on meshes of growing fineness, and the error from two of them.
# ------------------------------------------------------------------------------


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


# ------------------------------------------------------------------------------
# `fokker_planck` and its relatives: conditions, accuracy, warnings and the response.
# ------------------------------------------------------------------------------


COLLAPSES = (
    "{restitution} at the {side} stop is not above exp(-pi / sqrt 3) = 0.163: "
    "infinitely many impacts bring the mass to rest on the stop in finite time. The answer is the "
    "limit as ever slower impacts are resolved: the noise lifts the mass off at once. Rates have a "
    "meaning only above a speed"
)
"""Warning where impacts without end bring the mass to rest on a stop."""


@calculation
def fokker_planck(
    scene: Scene, *, rtol: float = 0.01, speed_threshold: float | None = None,
    budget: float | None = None,
) -> Response:  # fmt: skip
    """Stationary response of one oscillator with stops under white noise, by Galerkin's method.

    Solves -v p_x + [(b(v) + g(x) - load) p]_v + S0 / 2 p_vv = 0 (B 13.34).
    At a rigid upper stop c, p(c, -R w) = p(c, w) / R^2, w > 0: a mass that arrives at w leaves at R
    w. Other stops are part of g. Meshes of the whole range come first; where they do not reach
    rtol, strips of velocity cells.

    Parameters
    ----------
    scene
        White noise, any constant load, no stop or one or two, also different ones. A force of a
        stop depends on the speed by a linear damper at most. Springs, dampers and restitution may
        be functions.
    rtol
        Relative error to reach in the deviations of displacement and velocity, F1 and F2, down
        to some 1e-8; rates are brought to 10 %.
    speed_threshold
        Slowest impact that a rate counts, m/s. Default: 0 between elastic stops, else
        5 % of the rms velocity by the rule of all methods (*Conventions* in the manual). The
        meshes are made to reach it; a rate too small for them, below 1e-12 of the crossings of
        the mean, is 0 with an upper bound as its bias.
    budget
        Seconds after which no finer mesh is begun; None for no limit.

    Returns
    -------
    Response
        SI units; `bias` bounds the error of each quantity by the difference of the two finest
        meshes. A rate known to no better than 10 %, or of all impacts of a rigid stop that loses
        energy, is None: for R <= exp(-pi / sqrt 3) their rate is infinite. The other quantities are
        then those of a mass that leaves the stop again as soon as noise lifts it.

    Raises
    ------
    NotApplicable, NotConverged
        With every unmet condition; if the finest mesh, or the last one within the budget, does not
        reach rtol, with its `partial`.

    See Also
    --------
    stochvi.exact : The same in closed form, where there is one.
    stochvi.simulate : The same by Monte Carlo.

    Examples
    --------
    >>> from stochvi import ImpactPair, Oscillator, Restitution, Scene, WhiteNoise
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=0.8))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> print(f"{fokker_planck(scene, rtol=1e-6).coordinates['x']['displacement_std'].value:.7f} m")
    0.5320907 m
    """
    started, deadline = time.perf_counter(), Deadline.after(budget)
    motion, speed_threshold, rates = _asked(scene, rtol, speed_threshold)
    model, balances = motion.model, None
    found, how = None, "half-range Galerkin"
    if _all_numbers(model) and not model.scattered:
        found = _on_fixed_meshes(model, rtol, speed_threshold)
    if found is None or not _resolved(found, rtol, rates):
        answered = refine(motion, rtol, speed_threshold, rates, deadline)
        refined = answered.averages, answered.errors
        # where time or meshes end first, the better of both ways is the answer
        if found is None or _worst(refined) <= max(rtol, _worst(found)):
            found, how = refined, "refined Galerkin"
        if functions(model):
            balances = _balances(answered)
    return _response(scene, found, rtol, speed_threshold, how, started, balances, deadline)


def _worst(found: tuple[Averages, Averages]) -> float:
    """The largest relative error of averages with their bounds."""
    return float(worst_relative_error(*found))


def _resolved(found: tuple[Averages, Averages], rtol: float, rates: Collection[str]) -> bool:
    """Whether all errors are within rtol, and the rates of these sides are known."""
    return _worst(found) <= rtol and rates_not_resolved(*found).isdisjoint(rates)


@calculation
def fokker_planck_density(
    scene: Scene,
    *,
    rtol: float = 1e-4,
    speed_threshold: float | None = None,
    budget: float | None = None,
) -> StationaryDensity:
    """The stationary density itself, with its response; arguments and errors of `fokker_planck`.

    Parameters
    ----------
    scene
        The scene.
    rtol
        Relative error of deviations, F1 and F2.
    speed_threshold
        Slowest impact that a rate counts, m/s.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    StationaryDensity
        The joint density, its tails and that of impact speeds.

    See Also
    --------
    stochvi.fokker_planck : The averages alone.
    stochvi.methods.closed_form.exact_density : Where stops take no energy.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=0.8))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> found = fokker_planck_density(scene)
    >>> print(f"{found.density(0.0, 0.5):.4f} {found.tail(0.9):.4f}")
    0.2382 0.0353
    >>> print(f"{found.limit_rate('upper').value:.4f} impacts per second")
    0.0966 impacts per second
    """
    started, deadline = time.perf_counter(), Deadline.after(budget)
    motion, speed_threshold, rates = _asked(scene, rtol, speed_threshold)
    answered = refine(motion, rtol, speed_threshold, rates, deadline)
    found = answered.averages, answered.errors
    balances = _balances(answered) if functions(motion.model) else None
    response = _response(
        scene, found, rtol, speed_threshold, "refined Galerkin", started, balances, deadline
    )
    return StationaryDensity(response=response, fine=answered.field, coarse=answered.coarser)


def _asked(scene: Scene, rtol: float, given: float | None) -> tuple[Motion, float, set[str]]:
    """What is to be solved, the threshold of its rates (m/s), and the sides that have a rate."""
    check_rtol(rtol)
    if given is not None and not 0.0 <= given < math.inf:
        raise ValueError(f"speed_threshold must be finite and at least 0, got {given:g}")
    model = model_of(scene)
    if conditions := unmet(model):
        raise NotApplicable("fokker-planck", conditions)
    motion = Motion(model=model)
    threshold = _slow(motion) if given is None else given
    return motion, threshold, _finite_rates(model, threshold)


def _slow(motion: Motion) -> float:
    """The threshold of rates where none is given, m/s."""
    model = motion.model
    if model.elastic:
        return 0.0
    known = None if functions_of_arrays(model) else default_thresholds(model)
    if known is None:  # a force that is no function of the library: nothing else is compared
        return SLOW_IMPACTS * math.sqrt(motion.squares[0])
    return max(known.values(), default=0.0)


def _all_numbers(model: Model) -> bool:
    """Whether the meshes of the whole range cover a model: rigid stops, no functions."""
    return model.rigid and not functions(model)


@np.errstate(all="ignore")  # a result of NaN is not within rtol; the scene is then solved on strips
def _on_fixed_meshes(
    model: Model, rtol: float, speed_threshold: float
) -> tuple[Averages, Averages] | None:
    """Averages and bounds on their errors by meshes of the whole range: the first that reach rtol,
    else the best ones; None where there are none."""
    scenes = OscillatorArrays.of(model)
    speed, threshold = scenes.speed_scale(), np.array([speed_threshold])
    if speed_threshold > FASTEST * speed[0]:
        return None
    before = _first_levels(scenes, speed, threshold)
    rates, best = _finite_rates(model, speed_threshold), None
    for level in LEVELS[len(before) :]:
        fine, bounds = _refine(scenes, speed, level, threshold, before)
        found = _averages_for(_physical(fine)), _averages_for(bounds)
        if _resolved((_averages_for(fine), found[1]), rtol, rates):
            return found
        if _worst(found) < (math.inf if best is None else _worst(best)):
            best = found
        before = [*before[1:], fine]
    return best


def _averages_for(found: MeshMoments) -> Averages:
    """Averages of one scene with rigid stops."""
    numbers = {name: float(column[0]) for name, column in found._asdict().items()}
    rest = dict.fromkeys(set(Averages._fields) - numbers.keys(), 0.0)
    return Averages(**numbers, **rest)


def _response(
    scene: Scene,
    found: tuple[Averages, Averages],
    rtol: float,
    speed_threshold: float,
    how: str,
    started: float,
    balances: Mapping[str, Estimate] | None = None,
    deadline: Deadline = NEVER,
) -> Response:
    """The response; where its errors are larger than `rtol`, `NotConverged` carries it."""
    model = model_of(scene)
    answer = _answer(model, *found, speed_threshold)
    response = answer.response(
        "fokker-planck", scene, how=how, started=started, speed_threshold=speed_threshold
    )
    response = replace(response, warnings=[*response.warnings, *_collapses(model)])
    if balances is not None:
        response = replace(response, identities=balances)
    reached = worst_relative_error(*found)
    remedy = (
        "raise rtol, or simulate. Rare impacts of a lightly damped mass, and stiff dampers in "
        "stops, are the hardest cases."
    )
    return accurate(response, reached, rtol, deadline, started, "fokker-planck", remedy)


def _balances(answered: Refinement) -> dict[str, Estimate]:
    """Residuals of the balances, with a bound from the errors of their terms."""
    bias = 2.0 * worst_relative_error(answered.averages, answered.errors)
    residuals = answered.field.balances()
    return {
        name: Estimate(value=value, bias=bias, how="refined Galerkin")
        for name, value in residuals.items()
    }


def _collapses(model: Model) -> list[str]:
    return [
        COLLAPSES.format(restitution=stop.slow_impacts_see, side=stop.name)
        for stop in model.stops
        if stop.rigid and stop.law.slow_restitution <= COLLAPSE_RESTITUTION
    ]


def _first_levels(scenes: OscillatorArrays, speed: Array, threshold: Array) -> list[MeshMoments]:
    """Averages on the two coarsest levels, to which a finer one is compared."""
    return [solve(scenes, speed, level, threshold).moments for level in LEVELS[:2]]


def _refine(
    scenes: OscillatorArrays,
    speed: Array,
    level: MeshLevel,
    threshold: Array,
    before: list[MeshMoments],
) -> tuple[MeshMoments, MeshMoments]:
    """Averages on a level of meshes, with bounds on their errors from the two levels before."""
    fine = solve(scenes, speed, level, threshold)
    far = unreached(scenes, speed, fine.moments.upcrossing_rate)
    return with_lost_rates(fine, errors(scenes, before, fine, far))


class Batch(NamedTuple):
    """Averages of many scenes, bounds on their errors, and the slowest impact that rates count.

    See Also
    --------
    stochvi.methods.fokker_planck.fokker_planck_many : The calculation.
    """

    values: MeshMoments
    errors: MeshMoments
    speed_threshold: Array


@calculation
def fokker_planck_many(
    *,
    omega: ArrayLike,
    damping_rate: ArrayLike,
    intensity: ArrayLike,
    load: ArrayLike = 0.0,
    lower: ArrayLike = -math.inf,
    upper: ArrayLike = math.inf,
    restitution_lower: ArrayLike = 1.0,
    restitution_upper: ArrayLike = 1.0,
    speed_threshold: ArrayLike | None = None,
    budget: float | None = None,
) -> Batch:
    """The averages of `fokker_planck` for arrays of scenes, some hundred per second.

    Parameters
    ----------
    omega, damping_rate, intensity, load
        x'' + damping_rate x' + omega^2 x = white noise of intensity S0 + load, per unit mass:
        1/s, 1/s, m^2/s^3, m/s^2. Everything is broadcast to one shape.
    lower, upper, restitution_lower, restitution_upper
        Stops in metres from the position of the unloaded spring, infinite for none; their R.
    speed_threshold
        Speed threshold of rates, m/s, as for `fokker_planck`.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    Batch
        `values` and `errors` hold arrays of the common shape. The three coarsest meshes are used
        whatever error they leave: look at `errors`. A rate of impacts faster than these meshes
        find is 0, and its error an upper bound.

    Raises
    ------
    NotApplicable, ValueError
        If any scene has no stationary state; if a number is out of range.

    See Also
    --------
    stochvi.fokker_planck : One scene, with bounds on the error.

    Examples
    --------
    >>> found = fokker_planck_many(
    ...     omega=1.0, damping_rate=0.1, intensity=0.2, lower=-1.0, upper=1.0,
    ...     restitution_lower=[1.0, 0.8], restitution_upper=[1.0, 0.8],
    ... )
    >>> [f"{variance:.3f}" for variance in found.values.variance]
    ['0.291', '0.283']
    """
    whole = OscillatorArrays.broadcast(
        omega=omega,
        damping_rate=damping_rate,
        intensity=intensity,
        load=load,
        lower=lower,
        upper=upper,
        restitution_lower=restitution_lower,
        restitution_upper=restitution_upper,
    )
    shape, scenes = whole.omega.shape, whole.flat()
    scenes.check()
    conditions = scenes.unmet()
    if conditions:
        raise NotApplicable("fokker-planck", conditions)
    speed = scenes.speed_scale()
    if speed_threshold is None:
        threshold = np.where(scenes.elastic, 0.0, SLOW_IMPACTS * speed)
    else:
        threshold = np.broadcast_to(np.asarray(speed_threshold, dtype=float), shape).reshape(-1)
    before = _first_levels(scenes, speed, threshold)
    fine, bounds = _refine(scenes, speed, LEVELS[len(before)], threshold, before)
    return Batch(_shaped(_physical(fine), shape), _shaped(bounds, shape), threshold.reshape(shape))


def _physical(found: MeshMoments) -> MeshMoments:
    """Rates of stops that are hardly ever hit may come out below 0, within their errors."""
    sides = {
        name: np.maximum(column, 0.0)
        for name, column in found._asdict().items()
        if name.endswith(("_lower", "_upper"))
    }
    return found._replace(**sides)


def _shaped(found: MeshMoments, shape: tuple[int, ...]) -> MeshMoments:
    return MeshMoments(*(column.reshape(shape) for column in found))


def _finite_rates(model: Model, threshold: float) -> set[str]:
    """The sides whose rate of impacts above the threshold (m/s) is finite.

    Without a threshold a rigid stop that loses energy has no such rate.
    """
    endless = {
        stop.name
        for stop in model.stops
        if threshold == 0.0 and stop.rigid and not stop.law.conservative
    }
    return {"lower", "upper"} - endless


def _answer(model: Model, found: Averages, bounds: Averages, threshold: float) -> StationaryMoments:
    without_rate = ({"lower", "upper"} - _finite_rates(model, threshold)) | rates_not_resolved(
        found, bounds
    )
    answer, limits = (
        StationaryMoments(
            mean=group.mean,
            variance=group.variance,
            velocity_mean_square=group.velocity_mean_square,
            upcrossing_rate=group.upcrossing_rate,
            lower=_stop_for(group, "lower", without_rate),
            upper=_stop_for(group, "upper", without_rate),
            contact_lower=_contact(model.lower, group, "lower"),
            contact_upper=_contact(model.upper, group, "upper"),
        )
        for group in (found, bounds)
    )
    return replace(answer, errors=limits)


def _stop_for(group: Averages, side: str, without_rate: set[str]) -> StopStatistics:
    rate = None if side in without_rate else getattr(group, f"rate_{side}")
    return StopStatistics(
        rate,  # type: ignore[arg-type]
        getattr(group, f"speed_rate_{side}"),
        getattr(group, f"speed_square_rate_{side}"),
    )


def _contact(stop: Stop | None, group: Averages, side: str) -> ContactStatistics | None:
    if stop is None or stop.rigid:
        return None
    return ContactStatistics(
        probability=getattr(group, f"contact_{side}"),
        force=getattr(group, f"force_{side}"),
        peak_force=None,
        power=getattr(group, f"power_{side}"),
    )
