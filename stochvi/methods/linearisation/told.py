"""From a trial to what a response tells of it: rates, contacts, peak forces."""

from __future__ import annotations

import math

from stochvi.mathematics.impact_rates import ContactStatistics
from stochvi.methods.linearisation.scales import gibbs_law
from stochvi.methods.linearisation.trial import ROOT_TWO_PI, Trial, soft_stops
from stochvi.model.gibbs_law import GibbsLaw
from stochvi.model.responses import Answer, linear_acceleration
from stochvi.scenes.impact_laws import Elastic, Viscoelastic
from stochvi.scenes.scene import System


def answer_of(system: System, trial: Trial) -> Answer:
    """A trial, SI units per unit mass, as the numbers of an answer."""
    return Answer(
        mean=trial.mean,
        variance=trial.variance,
        velocity_mean_square=trial.velocity_mean_square,
        upcrossing_rate=trial.density_at_mean * math.sqrt(trial.velocity_mean_square) / ROOT_TWO_PI,
        lower=trial.lower,
        upper=trial.upper,
        contact_lower=_contact(system, trial, "lower"),
        contact_upper=_contact(system, trial, "upper"),
        acceleration_mean_square=linear_acceleration(system),
    )


def _contact(system: System, trial: Trial, side: str) -> ContactStatistics | None:
    """A contact with its mean peak force: that of the elastic law at this speed, times what a
    damper changes in it when a free mass hits the stop."""
    contact: ContactStatistics | None = getattr(trial, f"contact_{side}")
    law = soft_stops(system).get(side)
    if contact is None or law is None:
        return None
    speed = math.sqrt(trial.velocity_mean_square)
    elastic = gibbs_law(system, speed)
    known = elastic.contact(side) if isinstance(elastic, GibbsLaw) else None
    if known is None or known.peak_force is None:
        return contact
    factor = 1.0
    if isinstance(law, Viscoelastic):
        without = Elastic(stiffness=law.stiffness).impact(speed, 1.0)
        factor = law.impact(speed, 1.0).peak_force / without.peak_force
    return contact._replace(peak_force=factor * known.peak_force)
