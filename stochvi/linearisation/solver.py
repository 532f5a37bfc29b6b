"""Finds the response that is its own linearisation."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import root

from stochvi.errors import NotConverged
from stochvi.linearisation.forms import Form, Trial, Unknowns, restitutions
from stochvi.linearisation.scales import Frame, gibbs_stops, linear_moments
from stochvi.scenes import System

ACCEPTED = 1e-10
"""Largest relative imbalance of a solution. Roots are polished to rounding; this bound only
tells a root from the lack of one."""

NOWHERE = 1e3
"""Imbalance of unknowns that stand for no response, to turn the solver back."""


Moments = Callable[[System, float, float], tuple[float, float]]
Problem = Callable[[Unknowns], Unknowns]


def solve(system: System, form: Form, method: str) -> Trial:
    """The response that is its own linearisation.

    Newton's method from the elastic law. Where it fails restitution is lowered step by step
    from 1, and tabulated noise is approached step by step from white noise of the same power.
    """
    frame = Frame.of(system)
    target = frame.shrink(system)
    problem = _problem(form, target, linear_moments)
    start = form.start(target)
    unknowns = _root(problem, start)
    if unknowns is None:
        white = _equivalent_white(target)
        unknowns = _follow(lambda s: _problem(form, _softened(white, s), linear_moments), start)
        if unknowns is not None and target.tables:
            unknowns = _follow(lambda s: _problem(form, target, _blend(white, s)), unknowns)
    if unknowns is None:
        raise NotConverged(
            f"{method} found no response that is its own linearisation; "
            "try another form, or simulate this scene."
        )
    return frame.grow(form.trial(target, unknowns))


def _problem(form: Form, system: System, moments: Moments) -> Problem:
    """The imbalances to be made zero: of the mean forces, and of the variances of x and v."""

    def imbalance(unknowns: Unknowns) -> Unknowns:
        try:
            trial = form.trial(system, unknowns)
            displacement, velocity = moments(system, trial.stiffness, trial.damping)
            total_stiffness = system.omega**2 + trial.stiffness
            force = system.omega**2 * trial.mean + trial.stop_force - system.load
            found = np.array(
                [
                    force / (total_stiffness * math.sqrt(trial.variance)),
                    math.log(trial.variance / displacement) / 2.0,
                    math.log(trial.velocity_mean_square / velocity) / 2.0,
                ]
            )[3 - len(unknowns) :]
        except (ValueError, ZeroDivisionError, OverflowError):
            return np.full(len(unknowns), NOWHERE)
        return np.where(np.isfinite(found), found, NOWHERE)

    return imbalance


def _root(problem: Problem, start: Unknowns) -> Unknowns | None:
    """The root near `start`, or None."""
    if np.abs(problem(start)).max() < 1e-14:
        return start
    with np.errstate(all="ignore"):
        found = root(problem, start, method="hybr", options={"factor": 1.0, "xtol": 1e-13})
    return found.x if np.abs(problem(found.x)).max() < ACCEPTED else None


def _follow(family: Callable[[float], Problem], start: Unknowns) -> Unknowns | None:
    """The root of family(1), followed from the largest share at which `start` leads to one."""
    for share in (1.0, 0.5, 0.25, 0.1, 0.03, 0.01, 0.0):
        unknowns = _root(family(share), start)
        if unknowns is not None:
            break
    step = 1.0 - share
    while unknowns is not None and share < 1.0:
        step = min(step, 1.0 - share)
        closer = _root(family(share + step), unknowns)
        if closer is None:
            step /= 2.0
            if step < 1e-3:
                return None
        else:
            unknowns, share, step = closer, share + step, 2.0 * step
    return unknowns


def _softened(system: System, share: float) -> System:
    """Restitution brought from 1 towards its own value."""
    lower, upper = restitutions(system)
    return system._replace(
        restitution_lower=1.0 - share * (1.0 - lower),
        restitution_upper=1.0 - share * (1.0 - upper),
    )


def _equivalent_white(system: System) -> System:
    """The scene, in its frame, with white noise that supplies the power of the tables."""
    if not system.tables:
        return system
    damping = system.damping_rate + gibbs_stops(system, 1.0)[1]
    return system._replace(intensity=2.0 * damping, tables=())


def _blend(white: System, share: float) -> Moments:
    """Moments between those of white noise (share 0) and those of the scene (1)."""

    def moments(system: System, stiffness: float, damping: float) -> tuple[float, float]:
        pairs = zip(
            linear_moments(white, stiffness, damping),
            linear_moments(system, stiffness, damping),
            strict=True,
        )
        displacement, velocity = (near ** (1.0 - share) * far**share for near, far in pairs)
        return displacement, velocity

    return moments
