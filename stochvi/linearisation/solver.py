"""Finds the response that is its own linearisation."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import fsolve

from stochvi.errors import NotConverged
from stochvi.linearisation.forms import Form, Trial, Unknowns
from stochvi.linearisation.scales import Frame, linear_moments, speed_scale
from stochvi.scenes import System

ACCEPTED = 1e-10
"""Largest relative imbalance of a solution. Roots are polished to rounding; this bound only
tells a root from the lack of one."""

START_SPEEDS = (1.0, 0.7, 1.4, 0.5, 2.0, 0.25, 4.0)
"""Speeds to start from, relative to the one that balances the power of the elastic law."""

NOWHERE = 1e3
"""Imbalance of unknowns that stand for no response, to turn the solver back."""


Problem = Callable[[Unknowns], Unknowns]


def solve(system: System, form: Form, method: str) -> Trial:
    """The response that is its own linearisation.

    Newton's method from the elastic law, at the speed that balances its power. In tabulated
    noise there may be several solutions, or none near that speed, where the linearised resonance
    passes an edge of the table: then it starts from other speeds.
    """
    speed = speed_scale(system)
    for factor in START_SPEEDS:
        frame = Frame.of(system, factor * speed)
        target = frame.shrink(system)
        unknowns = root(_problem(form, target), form.start(target))
        if unknowns is not None:
            return frame.grow(form.trial(target, unknowns))
    raise NotConverged(
        f"{method} found no response that is its own linearisation, as where a preload "
        "holds the mass on a stop; try another form, or simulate this scene."
    )


def _problem(form: Form, system: System) -> Problem:
    """The imbalances to be made zero: of the mean forces, and of the variances of x and v."""

    def imbalance(unknowns: Unknowns) -> Unknowns:
        try:
            with np.errstate(all="ignore"):
                trial = form.trial(system, unknowns)
                moments = linear_moments(system, trial.stiffness, trial.damping)
            total_stiffness = system.omega**2 + trial.stiffness
            force = system.omega**2 * trial.mean + trial.stop_force - system.load
            found = np.array(
                [
                    force / (total_stiffness * math.sqrt(trial.variance)),
                    math.log(trial.variance / moments[0]) / 2.0,
                    math.log(trial.velocity_mean_square / moments[1]) / 2.0,
                ]
            )[3 - len(unknowns) :]
        except (ValueError, ZeroDivisionError, OverflowError):
            return np.full(len(unknowns), NOWHERE)
        return np.where(np.isfinite(found), found, NOWHERE)

    return imbalance


def root(problem: Problem, start: Unknowns) -> Unknowns | None:
    """The root near `start`, whose entries are of order 1, or None."""
    if np.abs(problem(start)).max() < 1e-14:
        return start

    # MINPACK takes its difference steps relative to each unknown, which would vanish in noise
    # at an unknown near 0; every unknown here is of order 1, so the offset costs no digits
    def shifted(offset: Unknowns) -> Unknowns:
        return problem(start + (offset - 1.0))

    offset, *_ = fsolve(shifted, np.ones(len(start)), xtol=1e-13, maxfev=100, full_output=True)
    unknowns: Unknowns = start + (offset - 1.0)
    return unknowns if np.abs(problem(unknowns)).max() < ACCEPTED else None
