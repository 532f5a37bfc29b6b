"""`fokker_planck` and its relatives: conditions, accuracy, warnings and the response."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Array
from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION, ContactStatistics, StopStatistics
from stochvi.methods.fokker_planck.conditions import check_rtol, unmet
from stochvi.methods.fokker_planck.density import Averages, StationaryDensity
from stochvi.methods.fokker_planck.fixed_meshes import (
    FASTEST,
    LEVELS,
    MeshLevel,
    MeshMoments,
    errors,
    solve,
    unreached,
    with_lost_rates,
)
from stochvi.methods.fokker_planck.linear_boxes import speed_scale
from stochvi.methods.fokker_planck.motion import Motion
from stochvi.methods.fokker_planck.refinement import (
    Refinement,
    accurate,
    rates_not_resolved,
    refine,
    worst_relative_error,
)
from stochvi.model.build_response import StationaryMoments
from stochvi.model.calculations import calculation
from stochvi.model.coverage import functions
from stochvi.model.model import Model, Stop, model_of
from stochvi.model.oscillator_arrays import OscillatorArrays
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate
from stochvi.results.response import Response
from stochvi.scenes.scene import Scene

SLOW_IMPACTS = 0.05
"""Default speed threshold of rates where a stop loses energy, in units of the speed scale. Slower
impacts are left out of rates, never out of F1 and F2."""


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
        about 5 % of the rms velocity: 5 % of an estimate by the balance of energy. The meshes are
        made to reach it; a rate too small for them, below 1e-12 of the crossings of the mean, is 0
        with an upper bound as its bias.
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
    motion = _motion(scene, rtol, speed_threshold)
    model = motion.model
    if speed_threshold is None:
        speed_threshold = _slow(motion)
    rates, balances = _finite_rates(model, speed_threshold), None
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
    motion = _motion(scene, rtol, speed_threshold)
    if speed_threshold is None:
        speed_threshold = _slow(motion)
    rates = _finite_rates(motion.model, speed_threshold)
    answered = refine(motion, rtol, speed_threshold, rates, deadline)
    found = answered.averages, answered.errors
    balances = _balances(answered) if functions(motion.model) else None
    response = _response(
        scene, found, rtol, speed_threshold, "refined Galerkin", started, balances, deadline
    )
    return StationaryDensity(response=response, fine=answered.field, coarse=answered.coarser)


def _motion(scene: Scene, rtol: float, speed_threshold: float | None) -> Motion:
    _check_arguments(rtol, speed_threshold)
    model = model_of(scene)
    conditions = unmet(model)
    if conditions:
        raise NotApplicable("fokker-planck", conditions)
    return Motion(model=model)


def _slow(motion: Motion) -> float:
    """The threshold of rates where none is given, m/s."""
    model = motion.model
    if model.elastic:
        return 0.0
    if not _all_numbers(model):
        return SLOW_IMPACTS * math.sqrt(motion.squares[0])
    return SLOW_IMPACTS * float(speed_scale(OscillatorArrays.of(model))[0])


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
    speed, threshold = speed_scale(scenes), np.array([speed_threshold])
    if speed_threshold > FASTEST * speed[0]:
        return None
    before = _first_levels(scenes, speed, threshold)
    rates, best = _finite_rates(model, speed_threshold), None
    for level in LEVELS[len(before) :]:
        fine, bounds = _refine(scenes, speed, level, threshold, before)
        found = _averages(_physical(fine)), _averages(bounds)
        if _resolved((_averages(fine), found[1]), rtol, rates):
            return found
        if _worst(found) < (math.inf if best is None else _worst(best)):
            best = found
        before = [*before[1:], fine]
    return best


def _averages(found: MeshMoments) -> Averages:
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
    speed = speed_scale(scenes)
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


def _check_arguments(rtol: float, speed_threshold: float | None) -> None:
    check_rtol(rtol)
    if speed_threshold is not None and not 0.0 <= speed_threshold < math.inf:
        raise ValueError(f"speed_threshold must be finite and at least 0, got {speed_threshold:g}")


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
            lower=_stop(group, "lower", without_rate),
            upper=_stop(group, "upper", without_rate),
            contact_lower=_contact(model.lower, group, "lower"),
            contact_upper=_contact(model.upper, group, "upper"),
        )
        for group in (found, bounds)
    )
    return replace(answer, errors=limits)


def _stop(group: Averages, side: str, without_rate: set[str]) -> StopStatistics:
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
