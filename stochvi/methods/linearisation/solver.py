"""Search for the response that is its own linearisation."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import fsolve, least_squares

from stochvi.methods.linearisation.candidate import Candidate, Form, Unknowns
from stochvi.methods.linearisation.scales import (
    Frame,
    balanced_speeds,
    linear_moments,
    speed_scale,
)
from stochvi.model.gap import Gap
from stochvi.results.errors import NotConverged

ACCEPTED = 1e-10
"""Largest relative imbalance of a solution. The imbalance of a root is reduced to rounding errors;
this bound only shows whether there is a root at all."""

START_SPEEDS = (1.0, 0.7, 1.4, 0.5, 2.0, 0.25, 4.0)
"""Speeds to start from, relative to the one that balances the power of the elastic law."""

INFEASIBLE = 1e3
"""Imbalance of unknowns that describe no response: so large that the solver turns back."""


Problem = Callable[[Unknowns], Unknowns]


SAME = 1e-6
"""Relative difference of the mean squares up to which two solutions count as one."""


def solve(gap: Gap, form: Form, method: str) -> list[Candidate]:
    """The responses that are their own linearisation, the most likely one first.

    Newton's method starts from the elastic law, at the speed that balances its power. In coloured
    noise there may be several solutions, or none near that speed: the linearised resonance may pass
    a peak or an edge of the density. The method then starts from every speed at which the power is
    balanced. The solution next to the response without stops comes first, since a motion that
    starts from rest settles there.

    Raises
    ------
    NotConverged
        If there is none.
    """
    speed = speed_scale(gap)
    found: list[Candidate] = []
    for factor in START_SPEEDS:
        candidate = _from(gap, form, factor * speed)
        if candidate is not None:
            found.append(candidate)
            break
    for other in balanced_speeds(gap, speed) if gap.coloured else []:
        candidate = _from(gap, form, other)
        if candidate is not None and not any(_same(candidate, one) for one in found):
            found.append(candidate)
    if not found and form.others:
        return solve(gap, form.others[0]._replace(others=form.others[1:]), method)
    if not found:
        raise NotConverged(
            f"{method} did not converge: from none of its starts did the iteration reach the "
            "response of the linearised oscillator. This happens where a preload holds the mass "
            "on a stop; try another form, or simulate this scene."
        )
    return found


def _from(gap: Gap, form: Form, speed: float) -> Candidate | None:
    """The solution near the elastic law of a speed, or None."""
    frame = Frame.of(gap, speed)
    target = frame.shrink(gap)
    unknowns = root(_problem(form, target), form.start(target))
    return None if unknowns is None else frame.grow(form.candidate(target, unknowns))


def _same(one: Candidate, two: Candidate) -> bool:
    squares = ((one.variance, two.variance), (one.velocity_mean_square, two.velocity_mean_square))
    return all(abs(math.log(a / b)) < SAME for a, b in squares)


def _problem(form: Form, gap: Gap) -> Problem:
    """The imbalances to be made zero: of the mean forces, and of the variances of x and v."""

    def imbalance(unknowns: Unknowns) -> Unknowns:
        try:
            with np.errstate(all="ignore"):
                candidate = form.candidate(gap, unknowns)
                moments = linear_moments(gap, candidate.stiffness, candidate.damping)
            total_stiffness = gap.omega**2 + candidate.stiffness
            force = gap.omega**2 * candidate.mean + candidate.stop_force - gap.load
            found = np.array(
                [
                    force / (total_stiffness * math.sqrt(candidate.variance)),
                    math.log(candidate.variance / moments[0]) / 2.0,
                    math.log(candidate.velocity_mean_square / moments[1]) / 2.0,
                ]
            )[3 - len(unknowns) :]
        except (ValueError, ZeroDivisionError, OverflowError):
            return np.full(len(unknowns), INFEASIBLE)
        return np.where(np.isfinite(found), found, INFEASIBLE)

    return imbalance


def root(problem: Problem, start: Unknowns, *, patient: bool = True) -> Unknowns | None:
    """The root near `start`, whose entries are of order 1; None where none is found.

    If the first method fails, a `patient` search goes on with a second, slower one.
    """
    if np.abs(problem(start)).max() < 1e-14:
        return start

    # MINPACK takes its difference steps relative to each unknown, which would vanish in noise
    # at an unknown near 0; every unknown here is of order 1, so the offset costs no digits
    def shifted(offset: Unknowns) -> Unknowns:
        return problem(start + (offset - 1.0))

    offset, *_ = fsolve(shifted, np.ones(len(start)), xtol=1e-13, maxfev=100, full_output=True)
    unknowns: Unknowns = start + (offset - 1.0)
    if np.abs(problem(unknowns)).max() < ACCEPTED:
        return unknowns
    if not patient:
        return None
    # the hybrid steps of MINPACK stall at a kink and next to an edge of a density
    with np.errstate(all="ignore"):  # nothing changes around a start that describes no response
        slow = least_squares(
            shifted, np.ones(len(start)), xtol=1e-14, ftol=None, gtol=None, max_nfev=60
        )
    unknowns = start + (slow.x - 1.0)
    return unknowns if np.abs(problem(unknowns)).max() < ACCEPTED else None
