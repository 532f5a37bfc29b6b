"""The closure corrected for impacts that come in clusters.

A lightly damped mass keeps its energy for some 1 / zeta cycles: once it reaches stops that are far
away it hits them again and again, at speeds that no Gaussian velocity has. The closure does not
describe such clusters; the distribution of the slowly varying energy (`energy_law`, with finite
jumps) describes nothing but them. This form takes the weighted mean of both,

    E = (1 - w) E_closure + w E_energy,      w = gap / (gap + CLUMPING zeta),

for mean forces, losses and moments alike. gap is the distance of the nearest stop from the position
of rest, in standard deviations of the motion without stops. Between two stops the closure is that
of the variant "box". The balance of energy is linear in these numbers and holds for both laws, so
that it holds for their mean; the linear model with the m_F, k and beta that follow from the mean
obeys it, too.
"""

from __future__ import annotations

import math

from stochvi.mathematics.impact_rates import StopStatistics
from stochvi.methods.linearisation.candidate import ROOT_TWO_PI, Candidate
from stochvi.model.energy_law import energy_law
from stochvi.model.gap import Gap
from stochvi.model.model import Model

CLUMPING = 50.0
"""A gap of one deviation is described half by the closure and half by the energy at zeta = 1 /
CLUMPING. Chosen on the grid of the atlas. There it lowers the mean error of F1 between two stops
from 11 to 3 %; at zeta up to 0.05 with gaps from 2 deviations, from 36 to 3 %. With 25 or 100 the
error of sigma_v or of F1 grows by half (studies/13_linearisation_atlas)."""

UNSEEN = 1e-6
"""Weight of the distribution of the energy below which it is not computed."""


def energy_weight(model: Model) -> float:
    """Weight of the distribution of the energy: 0 for the closure alone, as for a preload, up to 1.

    A mass without a spring or a damper has no deviation to measure by: its w is 0.
    """
    if model.omega == 0.0 or model.damping_rate == 0.0:
        return 0.0
    deviation = math.sqrt(model.intensity / (2.0 * model.damping_rate)) / model.omega
    distances = [stop.side * (stop.position - model.rest) for stop in model.stops]
    gap = max(min(distances), 0.0) / deviation
    zeta = model.damping_rate / (2.0 * model.omega)
    return gap / (gap + CLUMPING * zeta)


def clumped(model: Model, closure: Candidate) -> Candidate:
    """The answer of the closure corrected by the distribution of the energy, in SI units."""
    weight = energy_weight(model)
    if weight < UNSEEN:
        return closure
    # measured from the rest position, so that a large load causes no loss of digits
    rest = model.rest
    law = energy_law(Gap.of(model).from_rest(rest))
    first, second = law.moment(lambda o: o.first), law.moment(lambda o: o.second)

    def mixed(closed: float, energetic: float) -> float:
        return (1.0 - weight) * closed + weight * energetic

    away = mixed(closure.mean - rest, first)
    variance = mixed(closure.variance + (closure.mean - rest) ** 2, second) - away**2
    velocity = mixed(closure.velocity_mean_square, law.velocity_mean_square)
    crossings = mixed(
        closure.density_at_mean * math.sqrt(closure.velocity_mean_square) / ROOT_TWO_PI,
        law.rate_of_cycles_above(float(law.well.energy(first))),
    )
    return closure._replace(
        mean=rest + away,
        variance=variance,
        velocity_mean_square=velocity,
        density_at_mean=crossings * ROOT_TWO_PI / math.sqrt(velocity),
        stop_force=-(model.omega**2) * away,
        stiffness=velocity / variance - model.omega**2,
        damping=model.intensity / (2.0 * velocity) - model.damping_rate,
        hits={
            stop.side: _mixed_stop(closure.hits[stop.side], law.stop(stop.name), weight)
            for stop in model.stops
        },
    )


def _mixed_stop(closed: StopStatistics, energetic: StopStatistics, weight: float) -> StopStatistics:
    return StopStatistics(
        *((1.0 - weight) * a + weight * b for a, b in zip(closed, energetic, strict=True))
    )
