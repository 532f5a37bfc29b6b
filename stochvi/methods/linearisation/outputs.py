"""The numbers of an answer from a candidate: rates, contacts, peak forces."""

from __future__ import annotations

import math

from stochvi.mathematics.impact_rates import ContactStatistics
from stochvi.methods.linearisation.candidate import ROOT_TWO_PI, Candidate
from stochvi.methods.linearisation.scales import gibbs_law
from stochvi.model.build_response import StationaryMoments
from stochvi.model.gap import Gap
from stochvi.model.gibbs_law import GibbsLaw
from stochvi.model.model import Stop
from stochvi.scenes.impact_laws import Elastic, Viscoelastic


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
