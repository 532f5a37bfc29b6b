"""A few restitutions with probabilities, which stand for one that scatters."""

from __future__ import annotations

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.beta_distribution import BetaDistribution
from stochvi.mathematics.impact_rates import corner_exponent, equivalent_restitution

COUNTS = (6, 12, 24, 48)
"""Numbers of restitutions that are tried; each takes the time of one matrix."""

CORNER_ERROR = 1e-7
"""Relative error of E R^(beta - 2) from which a rule is fine enough: beta is the exponent of the
density at the stop, to which slow impacts are most sensitive."""


def restitution_rule(law: BetaDistribution) -> tuple[Vector, Vector]:
    """Restitutions and their probabilities: the first of Gauss's rules that is fine enough, or the
    finest one. E R and E R^2 are exact in all."""
    power = corner_exponent(equivalent_restitution(law)) - 2.0
    wanted = law.moment(power)
    for count in COUNTS:
        nodes, weights = law.rule(count)
        if abs(weights @ nodes**power - wanted) <= CORNER_ERROR * wanted:
            break
    return nodes, weights
