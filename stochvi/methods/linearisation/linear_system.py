"""The linear system in place of one oscillator with stops. Chapters: the candidate; the system and
its units; the search for the response that is its own linearisation; the numbers of the answer."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.mathematics.impact_rates import (
    NO_STOP,
    ContactStatistics,
    StopStatistics,
    TruncatedNormal,
)
from stochvi.mathematics.numerics import newton
from stochvi.mathematics.spectra import response_moments
from stochvi.model.build_response import StationaryMoments
from stochvi.model.gap import Gap, GibbsLaw, OscillatorArrays
from stochvi.model.model import LOWER, UPPER, Stop
from stochvi.results.errors import NotConverged
from stochvi.scenes.impact_laws import CompliantLaw, Elastic, Law, Viscoelastic

# ------------------------------------------------------------------------------
# A candidate: a response, and the linearised stops that a form derives from it.
# ------------------------------------------------------------------------------


ROOT_TWO_PI = math.sqrt(2.0 * math.pi)

Unknowns = NDArray[np.float64]


class Candidate(NamedTuple):
    """A response, and the linearised stops that it calls for, per unit mass; numbers, or arrays of
    many.

    `stop_force`, `stiffness` and `damping` are m_F, k and beta; `density_at_mean` is the density of
    x at its mean.
    `hits` holds the impacts by the side of the stop, `contacts` those with compliant stops,
    with forces and powers per unit mass. `rise` is the factor by which the density right at a stop
    exceeds the density there in the family of laws.
    """

    mean: float
    variance: float
    velocity_mean_square: float
    density_at_mean: float
    stop_force: float
    stiffness: float
    damping: float
    hits: dict[int, StopStatistics]
    contacts: dict[int, ContactStatistics]
    rise: float = 1.0

    @property
    def lower(self) -> StopStatistics:
        """Impacts on the lower stop; zeros where there is none."""
        return self.hits.get(LOWER, NO_STOP)

    @property
    def upper(self) -> StopStatistics:
        """Impacts on the upper stop; zeros where there is none."""
        return self.hits.get(UPPER, NO_STOP)


class Form(NamedTuple):
    """One way to linearise: where to start, and the candidate that a set of unknowns stands for.

    `others` are tried in turn where this form has no solution.
    """

    start: Callable[[Gap], Unknowns]
    candidate: Callable[[Gap, Unknowns], Candidate]
    others: tuple[Form, ...] = ()


# ------------------------------------------------------------------------------
# The linear system with added stiffness and damping, and the units in which it is solved.
# ------------------------------------------------------------------------------


SCAN = (-6.9, 4.6)
"""Logarithms of the least and the largest speed among which further solutions are looked for,
relative to a speed that balances."""

SCANNED_SPEEDS = 75
"""Number of speeds within SCAN at which the balance is evaluated: about fifteen per decade."""


def linear_moments(gap: Gap, stiffness: float, damping: float) -> tuple[float, float]:
    """Variances of x and v with stiffness and damping added (B 13.8-13.11)."""
    total_stiffness = gap.omega**2 + stiffness
    total_damping = gap.damping_rate + damping
    displacement = velocity = 0.0
    if gap.intensity > 0.0:
        velocity = gap.intensity / (2.0 * total_damping) if total_damping > 0.0 else math.inf
        displacement = velocity / total_stiffness if total_stiffness > 0.0 else math.inf
    if gap.tables:
        coloured = response_moments(gap.tables, math.sqrt(total_stiffness), total_damping)
        displacement += coloured.displacement
        velocity += coloured.velocity
    for filtered in gap.filters:
        moments = filtered.response_moments(math.sqrt(total_stiffness), total_damping)
        displacement += moments[0]
        velocity += moments[1]
    return displacement, velocity


class Frame(NamedTuple):
    """Origin and units in which the elastic law at speed s has mean 0 and deviation 1, s = 1."""

    origin: float
    length: float
    speed: float

    @classmethod
    def of(cls, gap: Gap, speed: float) -> Self:
        """The frame of a gap at a speed, m/s."""
        law = gibbs_law(gap, speed)
        return cls(law.mean, math.sqrt(law.variance), speed)

    def shrink(self, gap: Gap) -> Gap:
        """The same gap in the units of the frame."""
        return gap.scaled(origin=self.origin, length=self.length, speed=self.speed)

    def grow(self, candidate: Candidate) -> Candidate:
        """A candidate back in SI units; numbers, or arrays with an entry for each frame of many."""
        frequency = self.speed / self.length
        return candidate._replace(
            mean=self.origin + self.length * candidate.mean,
            variance=candidate.variance * self.length**2,
            velocity_mean_square=candidate.velocity_mean_square * self.speed**2,
            density_at_mean=candidate.density_at_mean / self.length,
            stop_force=candidate.stop_force * self.speed * frequency,
            stiffness=candidate.stiffness * frequency**2,
            damping=candidate.damping * frequency,
            hits={
                side: StopStatistics(
                    hits.rate * frequency,
                    # the book's form "force" has None here
                    None if hits.speed_rate is None else hits.speed_rate * frequency * self.speed,
                    hits.speed_square_rate * frequency * self.speed**2,
                )
                for side, hits in candidate.hits.items()
            },
            contacts={
                side: ContactStatistics(
                    probability=contact.probability,
                    force=contact.force * self.speed * frequency,
                    peak_force=None,
                    power=contact.power * self.speed**2 * frequency,
                )
                for side, contact in candidate.contacts.items()
            },
        )


def gibbs_law(gap: Gap, speed: float) -> TruncatedNormal | GibbsLaw:
    """exp(-U / speed^2), the exact law for elastic stops (B 13.38)."""
    if gap.soft:
        return GibbsLaw.of(gap, theta=speed**2)
    lower, upper = gap.ends
    return TruncatedNormal(
        slope=gap.load / speed**2, curvature=(gap.omega / speed) ** 2, lower=lower, upper=upper
    )


def _gibbs_stops(gap: Gap, speed: float) -> tuple[float, float]:
    """Stiffness and damping of stops under the elastic law at a speed s.

    The stiffness follows from s^2 = (omega^2 + k) Var x. The loss of a rigid stop is (1 - R^2) p_c
    s^3 / sqrt(2 pi), that of a viscoelastic one c s^2 P(contact). p_c = 2 p / (1 + R) is the
    density at the stop that the balance of forces then calls for.
    """
    law = gibbs_law(gap, speed)
    if not law.variance > 0.0:
        raise NotConverged(
            "linearise did not converge: the response is so small beside its distance from the "
            "stops that its variance is lost in rounding; check the units of damping and excitation"
        )
    stiffness = max(speed**2 / law.variance - gap.omega**2, 0.0)
    rigid = [stop for stop in gap.stops if stop.rigid]
    loss = sum(_loss(stop.law) * law.density_at(stop.position) for stop in rigid)
    damping = 2.0 * loss * speed / ROOT_TWO_PI
    for stop in gap.stops:
        if isinstance(stop.law, CompliantLaw) and isinstance(law, GibbsLaw):
            touching = law.contact(stop.name)
            assert touching is not None
            damping += stop.law.damping(1.0) * touching.probability
    return stiffness, damping


def _loss(law: Law) -> float:
    """(1 - E R^2) / (1 + E R) of a rigid stop, 1 - R where R does not scatter."""
    return (1.0 - law.restitution_mean_square) / (1.0 + law.restitution)


def speed_scale(gap: Gap) -> float:
    """The speed s at which the elastic law takes up the power that the noise supplies, m/s.

    Exact for elastic stops and white noise, where s^2 = S0 / (2 b); else near the answer. Of
    several such speeds the one that is found from above.
    """

    def surplus(log_speed: float) -> float:
        return _surplus(gap, log_speed)

    # half a step above, so that no end of the bracket is a root
    high = math.log(_rough_speed(gap)) + 0.5
    ceiling, floor = high + 100.0, high - 25.0
    while surplus(high) > 0.0 and high < ceiling:
        high += 1.0
    low = best = high - 1.0
    while surplus(low) <= 0.0 and low > floor:
        high, low = low, low - 1.0
        best = max(low, best, key=surplus)
    if low <= floor:
        # no balance: a preload holds the mass on a stop. A form may still find one of its own
        return math.exp(best)
    log_speed: float = scipy.optimize.brentq(surplus, low, high, xtol=1e-14, rtol=1e-14)
    return math.exp(log_speed)


def balanced_speeds(gap: Gap, near: float) -> list[float]:
    """All speeds within three decades below and two above `near` at which the elastic law takes
    up the power supplied, m/s; in coloured noise there may be several, where the linearised
    resonance passes through a peak or an edge of the density."""
    logs = math.log(near) + np.linspace(*SCAN, SCANNED_SPEEDS)
    values = [_surplus(gap, log_speed) for log_speed in logs.tolist()]
    return [
        math.exp(
            scipy.optimize.brentq(lambda log_speed: _surplus(gap, log_speed), low, high, xtol=1e-9)
        )
        for (low, one), (high, two) in pairwise(zip(logs.tolist(), values, strict=True))
        if one * two < 0.0
    ]


def _surplus(gap: Gap, log_speed: float) -> float:
    """log of the mean square speed that the noise supplies to the elastic law of a speed, over
    that of the law."""
    speed = math.exp(log_speed)
    try:
        supplied = linear_moments(gap, *_gibbs_stops(gap, speed))[1]
    except ValueError:
        # so slow that the mass lies on a stop within rounding
        return -1e3
    if not 0.0 < supplied < math.inf:
        # no loss at all, as far below the first impact; or no noise left to follow
        return 1e3 if supplied > 0.0 else -1e3
    return math.log(supplied) - 2.0 * log_speed


def _rough_speed(gap: Gap) -> float:
    """A speed, m/s, that scales with units and strengths of the scene as the answer does."""
    rate = gap.damping_rate or gap.omega
    if rate > 0.0:
        return math.sqrt(linear_moments(replace(gap, damping_rate=rate), 0.0, 0.0)[1])
    squares = [table.mean_square() for table in gap.tables]
    squares += [each.omega**2 * each.intensity / (2.0 * each.damping_rate) for each in gap.filters]
    rms = math.sqrt(sum(squares))
    if math.isinf(gap.width):
        # a load presses the mass on its only stop, where it turns over load * speed per second
        return gap.intensity / abs(gap.load) + rms / _slowest_noise(gap)
    return max(math.sqrt(gap.width * rms), math.cbrt(gap.width * gap.intensity))


def _slowest_noise(gap: Gap) -> float:
    """Lowest frequency of the coloured noise, rad/s; 1 where there is none."""
    slowest = [2.0 * math.pi * float(table.frequency_hz[0]) for table in gap.tables]
    return min([*slowest, *(each.omega for each in gap.filters)], default=1.0)


# ------------------------------------------------------------------------------
# Search for the response that is its own linearisation.
# ------------------------------------------------------------------------------


ACCEPTED = 1e-10
"""Largest relative imbalance of a solution. The imbalance of a root is reduced to rounding errors;
this bound only shows whether there is a root at all."""

POLISHED = 1e-13
"""Imbalance at which the search for a root ends."""

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
        if candidate is not None and not any(same(candidate, one) for one in found):
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


def same(one: Candidate, two: Candidate) -> bool:
    """Whether two solutions count as one."""
    squares = ((one.variance, two.variance), (one.velocity_mean_square, two.velocity_mean_square))
    return all(abs(math.log(a / b)) < SAME for a, b in squares)


def _problem(form: Form, gap: Gap) -> Problem:
    """The imbalances to be made zero: of the mean forces, and of the variances of x and v."""

    def imbalance(unknowns: Unknowns) -> Unknowns:
        try:
            with np.errstate(all="ignore"):
                candidate = form.candidate(gap, unknowns)
                moments = linear_moments(gap, candidate.stiffness, candidate.damping)
                found = imbalances(gap, candidate, moments)[3 - len(unknowns) :]
        except (ValueError, ZeroDivisionError, OverflowError):
            return np.full(len(unknowns), INFEASIBLE)
        return np.where(np.isfinite(found), found, INFEASIBLE)

    return imbalance


def imbalances(
    gap: Gap | OscillatorArrays, candidate: Candidate, moments: tuple[float, float]
) -> Unknowns:
    """Imbalances of the mean force and of the variances of x and v, which the linear system gives;
    with an entry for each of many."""
    total_stiffness = gap.omega**2 + candidate.stiffness
    force = gap.omega**2 * candidate.mean + candidate.stop_force - gap.load
    return np.array(
        [
            force / (total_stiffness * np.sqrt(candidate.variance)),
            np.log(candidate.variance / moments[0]) / 2.0,
            np.log(candidate.velocity_mean_square / moments[1]) / 2.0,
        ]
    )


def root(problem: Problem, start: Unknowns) -> Unknowns | None:
    """The root near `start`, whose entries are of order 1; None where none is found."""

    def columns(unknowns: Unknowns, _: object) -> Unknowns:
        return np.array([problem(each) for each in unknowns.T]).T

    unknowns, left = newton(columns, start[:, None], POLISHED)
    return unknowns[:, 0] if left[0] < ACCEPTED else None


# ------------------------------------------------------------------------------
# The numbers of an answer from a candidate: rates, contacts, peak forces.
# ------------------------------------------------------------------------------


def answer_of(
    gap: Gap, candidate: Candidate, acceleration: float | None = None
) -> StationaryMoments:
    """A candidate, SI units per unit mass, as the numbers of an answer.

    `acceleration` is the mean square absolute acceleration where it is finite, m^2/s^4.
    """
    velocity = math.sqrt(candidate.velocity_mean_square)
    return StationaryMoments(
        mean=candidate.mean,
        variance=candidate.variance,
        velocity_mean_square=candidate.velocity_mean_square,
        upcrossing_rate=candidate.density_at_mean * velocity / ROOT_TWO_PI,
        lower=candidate.lower,
        upper=candidate.upper,
        contact_lower=_contact(gap, candidate, gap.lower),
        contact_upper=_contact(gap, candidate, gap.upper),
        acceleration_mean_square=acceleration,
    )


def _contact(gap: Gap, candidate: Candidate, stop: Stop | None) -> ContactStatistics | None:
    """A contact with its mean peak force: that of the elastic law at this speed, times what a
    damper changes in it when a free mass hits the stop."""
    if stop is None or stop.side not in candidate.contacts:
        return None
    contact = candidate.contacts[stop.side]
    speed = math.sqrt(candidate.velocity_mean_square)
    elastic = gibbs_law(gap, speed)
    known = elastic.contact(stop.name) if isinstance(elastic, GibbsLaw) else None
    if known is None or known.peak_force is None:
        return contact
    factor = 1.0
    if isinstance(stop.law, Viscoelastic):
        without = Elastic(stiffness=stop.law.stiffness).impact(speed, 1.0)
        factor = stop.law.impact(speed, 1.0).peak_force / without.peak_force
    return contact._replace(peak_force=factor * known.peak_force)
