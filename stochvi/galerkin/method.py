"""The method: what it covers, which accuracy it reaches, what it says about its answer."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stochvi.answers import Answer
from stochvi.collisions import StopStatistics
from stochvi.errors import NotApplicable, NotConverged
from stochvi.estimates import Response
from stochvi.galerkin.boxes import Scenes, speed_scale
from stochvi.galerkin.levels import LEVELS, Level, Moments, errors, solve, unreached
from stochvi.galerkin.mesh import Array
from stochvi.scenes import Scene, System

SLOW_IMPACTS = 0.05
"""Impacts slower than this, in units of the speed scale, are left out of rates where a stop loses
energy (never out of F1 and F2)."""

WORST_RATE = 0.1
"""A rate whose relative error may be larger is not given."""


def fokker_planck(
    scene: Scene, *, rtol: float = 0.01, speed_threshold: float | None = None
) -> Response:
    """Stationary response between rigid stops of any restitution, by half-range Galerkin.

    Solves -v p_x + [(b v + omega^2 x - load) p]_v + S0 / 2 p_vv = 0 (B 13.34) with
    v p(c, v) dv = -R v p(c, -R v) d(R v) at a stop c, on meshes of growing fineness until two of
    them agree.

    Parameters
    ----------
    scene
        White noise, any constant load, no stop or one or two rigid ones, also different ones.
    rtol
        Relative error to reach in the deviations of displacement and velocity, F1 and F2. Rates
        are brought to 10 % where a finer mesh can do that.
    speed_threshold
        Slowest impact that a rate counts, m/s. Default: 0 between elastic stops, else 5 % of
        the rms velocity that a law exp(-energy / s^2) would have, as in `simulate`.

    Returns
    -------
    Response
        SI units; `bias` bounds the error of each quantity by the difference of the two finest
        meshes. A rate that is known to no better than 10 %, or that counts all impacts of a stop
        that loses energy (for R <= exp(-pi / sqrt 3) there is no end to them), is None.

    Raises
    ------
    NotApplicable, NotConverged
        With every condition that the scene does not meet; if the finest mesh does not reach
        rtol (`response` holds what it reached).

    Examples
    --------
    >>> from stochvi.contacts import Restitution
    >>> from stochvi.excitations import WhiteNoise
    >>> from stochvi.scenes import ImpactPair
    >>> from stochvi.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=0.8))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> print(f"{fokker_planck(scene).coordinates['x']['displacement_std'].value:.3f} m")
    0.532 m
    """
    started = time.perf_counter()
    _check_arguments(rtol, speed_threshold)
    unmet = unmet_conditions(scene)
    if unmet:
        raise NotApplicable("fokker-planck", unmet)
    system = scene.system()
    scenes = _as_scenes(system)
    speed = speed_scale(scenes)
    if speed_threshold is None:
        speed_threshold = 0.0 if system.elastic else SLOW_IMPACTS * float(speed[0])
    threshold = np.array([speed_threshold])
    coarse, worst = solve(scenes, speed, LEVELS[0], threshold).moments, math.inf
    for level in LEVELS[1:]:
        fine, bounds = _refine(scenes, speed, level, threshold, coarse)
        worst = _worst(fine, bounds)
        if worst <= rtol and not any(_vague(system, fine, bounds, speed_threshold).values()):
            break
        coarse = fine
    answer = _answer(system, _physical(fine), bounds, speed_threshold)
    response = answer.response(
        "fokker-planck",
        scene,
        how="half-range Galerkin",
        started=started,
        speed_threshold=speed_threshold,
    )
    if worst > rtol:
        raise NotConverged(
            f"fokker-planck reached a relative error of {worst:.2g} on its finest mesh, not "
            f"{rtol:g}; simulate, or allow more. Rare hits of a lightly damped mass are its worst.",
            response,
        )
    return response


def _refine(
    scenes: Scenes, speed: Array, level: Level, threshold: Array, coarse: Moments
) -> tuple[Moments, Moments]:
    """The averages on a level, and bounds on their errors."""
    fine = solve(scenes, speed, level, threshold)
    far = unreached(scenes, speed, fine.moments.upcrossing_rate)
    return fine.moments, errors(scenes, coarse, fine, far)


class Batch(NamedTuple):
    """Averages of many scenes, bounds on their errors, and the slowest impact that rates count."""

    values: Moments
    errors: Moments
    speed_threshold: Array


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
) -> Batch:
    """The averages of `fokker_planck` for arrays of scenes, some thousand per second.

    Parameters
    ----------
    omega, damping_rate, intensity, load
        x'' + damping_rate x' + omega^2 x = white noise of intensity S0 + load, per unit mass:
        1/s, 1/s, m^2/s^3, m/s^2. Everything is broadcast to one shape.
    lower, upper, restitution_lower, restitution_upper
        Stops in metres from the position of the unloaded spring, infinite for none; their R.
    speed_threshold
        As for `fokker_planck`, m/s.

    Returns
    -------
    Batch
        `values` and `errors` hold arrays of the common shape. The two coarsest meshes are used
        whatever error they leave: look at `errors`.

    Raises
    ------
    NotApplicable, ValueError
        If any scene has no stationary state; if a number is out of range.

    Examples
    --------
    >>> found = fokker_planck_many(
    ...     omega=1.0, damping_rate=0.1, intensity=0.2, lower=-1.0, upper=1.0,
    ...     restitution_lower=[1.0, 0.8], restitution_upper=[1.0, 0.8],
    ... )
    >>> [f"{variance:.3f}" for variance in found.values.variance]
    ['0.291', '0.283']
    """
    stops = (lower, upper, restitution_lower, restitution_upper)
    columns = (omega, damping_rate, intensity, load, *stops)
    whole = np.broadcast_arrays(*(np.asarray(column, dtype=float) for column in columns))
    shape = whole[0].shape
    scenes = Scenes(*(column.reshape(-1) for column in whole))
    _check_arrays(scenes)
    speed = speed_scale(scenes)
    if speed_threshold is None:
        threshold = np.where(scenes.elastic(), 0.0, SLOW_IMPACTS * speed)
    else:
        threshold = np.broadcast_to(np.asarray(speed_threshold, dtype=float), shape).reshape(-1)
    coarse = solve(scenes, speed, LEVELS[0], threshold).moments
    fine, bounds = _refine(scenes, speed, LEVELS[1], threshold, coarse)
    return Batch(_shaped(_physical(fine), shape), _shaped(bounds, shape), threshold.reshape(shape))


def _physical(found: Moments) -> Moments:
    """Rates of stops that are hardly ever hit may come out below 0, within their errors."""
    sides = {
        name: np.maximum(column, 0.0)
        for name, column in found._asdict().items()
        if name.endswith(("_lower", "_upper"))
    }
    return found._replace(**sides)


def _shaped(found: Moments, shape: tuple[int, ...]) -> Moments:
    return Moments(*(column.reshape(shape) for column in found))


def _check_arguments(rtol: float, speed_threshold: float | None) -> None:
    if not rtol > 0.0:
        raise ValueError(f"rtol must be greater than 0, got {rtol:g}")
    if speed_threshold is not None and not 0.0 <= speed_threshold < math.inf:
        raise ValueError(f"speed_threshold must be finite and at least 0, got {speed_threshold:g}")


def _check_arrays(scenes: Scenes) -> None:
    for name, column in scenes._asdict().items():
        if np.isnan(column).any():
            raise ValueError(f"{name} must be numbers, got nan")
        if name in ("omega", "damping_rate", "intensity") and (column < 0.0).any():
            raise ValueError(f"{name} must be at least 0, got {column.min():g}")
        outside = (column < 0.0) | (column > 1.0)
        if name.startswith("restitution") and outside.any():
            raise ValueError(f"{name} must be in [0, 1], got {column[outside][0]:g}")
    if not (scenes.lower < scenes.upper).all():
        raise ValueError("needs lower < upper in every scene")
    unmet = []
    if (scenes.intensity == 0.0).any():
        unmet.append("intensity must be positive in every scene, got 0")
    if (scenes.elastic() & (scenes.damping_rate == 0.0)).any():
        unmet.append("damping_rate must be positive where no stop takes energy, got 0")
    held_left = np.isfinite(scenes.lower) | (scenes.load > 0.0)
    held_right = np.isfinite(scenes.upper) | (scenes.load < 0.0)
    if ((scenes.omega == 0.0) & ~(held_left & held_right)).any():
        unmet.append("omega must be positive where stops do not hold the mass, got 0")
    if unmet:
        raise NotApplicable("fokker-planck", unmet)


def unmet_conditions(scene: Scene) -> list[str]:
    """What keeps a scene from being solved; empty where nothing does."""
    unmet = scene.beyond_one_oscillator()
    if unmet:
        return unmet
    system = scene.system()
    unmet = system.not_rigid()
    if system.tables:
        unmet.append("excitation must be white noise, got a tabulated density")
    elif system.intensity == 0.0:
        unmet.append("excitation must contain noise, got a constant load alone")
    if system.damping_rate == 0.0 and system.elastic:
        unmet.append("damping must be positive where no stop takes energy, got 0")
    held_left = system.lower is not None or system.load > 0.0
    held_right = system.upper is not None or system.load < 0.0
    if system.omega == 0.0 and not (held_left and held_right):
        unmet.append("stiffness must be positive where stops do not hold the mass, got 0")
    return unmet


def _as_scenes(system: System) -> Scenes:
    numbers = (
        system.omega,
        system.damping_rate,
        system.intensity,
        system.load,
        -math.inf if system.lower is None else system.lower,
        math.inf if system.upper is None else system.upper,
        1.0 if system.restitution_lower is None else system.restitution_lower,
        1.0 if system.restitution_upper is None else system.restitution_upper,
    )
    return Scenes(*(np.array([number]) for number in numbers))


def _worst(found: Moments, bounds: Moments) -> float:
    """Largest relative error of what `rtol` governs."""
    ratios = [
        bounds.variance[0] / found.variance[0] / 2.0,
        bounds.velocity_mean_square[0] / found.velocity_mean_square[0] / 2.0,
    ]
    for name in ("speed_rate", "speed_square_rate"):
        total = sum(getattr(found, f"{name}_{side}")[0] for side in ("lower", "upper"))
        bound = sum(getattr(bounds, f"{name}_{side}")[0] for side in ("lower", "upper"))
        if total > 0.0:
            ratios.append(bound / total)
    return float(max(ratios))


def _endless(system: System, side: str, threshold: float) -> bool:
    """Whether a rate would count the slowest impacts of a stop that loses energy."""
    return getattr(system, f"restitution_{side}") not in (None, 1.0) and threshold == 0.0


def _vague(system: System, found: Moments, bounds: Moments, threshold: float) -> dict[str, bool]:
    """For each stop, whether its rate is not known well enough yet to be given."""
    return {
        side: not _endless(system, side, threshold)
        and bool(getattr(bounds, f"rate_{side}")[0] > WORST_RATE * value > 0.0)
        for side in ("lower", "upper")
        for value in getattr(found, f"rate_{side}")
    }


def _answer(system: System, found: Moments, bounds: Moments, threshold: float) -> Answer:
    value, bound = (
        {name: float(column[0]) for name, column in group._asdict().items()}
        for group in (found, bounds)
    )
    sides: dict[str, tuple[StopStatistics, StopStatistics]] = {}
    vague = _vague(system, found, bounds, threshold)
    for side in ("lower", "upper"):
        told = not (vague[side] or _endless(system, side, threshold))
        sides[side] = (
            _stop(value, side, value[f"rate_{side}"] if told else None),
            _stop(bound, side, bound[f"rate_{side}"] if told else None),
        )
    answer, limits = (
        Answer(
            mean=group["mean"],
            variance=group["variance"],
            velocity_mean_square=group["velocity_mean_square"],
            upcrossing_rate=group["upcrossing_rate"],
            lower=sides["lower"][place],
            upper=sides["upper"][place],
        )
        for place, group in enumerate((value, bound))
    )
    return replace(answer, errors=limits)


def _stop(group: dict[str, float], side: str, rate: float | None) -> StopStatistics:
    return StopStatistics(
        rate,  # type: ignore[arg-type]
        group[f"speed_rate_{side}"],
        group[f"speed_square_rate_{side}"],
    )
