"""The bias that a finite step leaves in a quantity, from the quantity's change with the step.

Every plan simulates some of its paths at its step h and at 2 h. If a scheme is of order p, the bias
at h is the difference of the two results over 2^p - 1. This module knows the order of each
quantity, and the cases in which slow impacts on inelastic stops make the bias unknown.
"""

from __future__ import annotations

import math

from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION, corner_exponent
from stochvi.methods.monte_carlo.quantities import RATES
from stochvi.model.model import Model

WELL_RESOLVED_RESTITUTION = 0.5
"""Smallest coefficient of restitution (dimensionless) at which a plain step resolves the impacts
that are faster than the default speed threshold. Below it bounces are so slow that steps near a
stop must be refined before the bias of a rate is known."""

RESOLVED = 4.0
"""Speed over sqrt(S0 h), S0 the intensity of the noise on a gap, from which a plain step resolves
impacts on any inelastic stop. At R = 0 to 0.4 rates of faster impacts were 3 % off at most, at the
largest steps; those from 1 on were up to 22 % off."""

FEW_SLOW = 0.02
"""Largest share of impacts that may be slower, so that the bias of a rate is stated."""

SPEED_POWER = {
    "collision_rate": 0, "collision_rate_lower": 0, "collision_rate_upper": 0,
    "impact_speed_mean": 0, "impact_speed_square_rate": 2,
}  # fmt: skip
"""Power m of the impact speed w in a quantity that sums w^m over the impacts. Quantities that are
not named here depend on the impulses, and so have the power 1."""


def lossiest(model: Model) -> float:
    """The smallest coefficient of restitution among the stops, as slow impacts see it; 1 without
    stops."""
    return min((stop.law.slow_restitution for stop in model.stops), default=1.0)


def refines_near_stops(model: Model) -> bool:
    """Whether steps can be refined for slow impacts: on rigid stops, without tables and pulses of a
    shape."""
    return model.rigid and not (model.tables or model.drawn or model.sampled_modulations)


def bias_of_smooth_motion(difference: float) -> float:
    """Bias of a scheme of order 2, where no white noise acts or there are no stops."""
    return difference / 3.0


def bias_of_lasting_contact(difference: float) -> float:
    """Bias where a load presses a mass onto a stop, as no white noise acts.

    A mass at rest stays there to the next sample. Each halving of the step changed the rates of a
    mass on a truck by 1/2 to 1/3 of the change before; order 1 is on the safe side.
    """
    return difference


def bias_of_sticking(difference: float) -> float:
    """Bias where dry friction may hold a mass, as no white noise acts.

    What sticks creeps between kicks. The order is 1 at short steps, and lower at long ones; 1/2 is
    on the safe side: at steps of 0.02 to 0.2 of a radian the bias was 0.3 to 0.7 of this bound.
    """
    return difference / (math.sqrt(2.0) - 1.0)


def bias_of_plain_step(
    name: str, difference: float, restitution: float, rates_resolved: bool = True
) -> float | None:
    """Bias under white noise where the step is not refined near the stops.

    It is None for a rate if the step does not resolve the slow impacts that the rate counts: below
    WELL_RESOLVED_RESTITUTION, or where `rates_resolved` is False.
    """
    resolved = rates_resolved and restitution >= WELL_RESOLVED_RESTITUTION
    return extrapolated(name, difference, restitution) if resolved or name not in RATES else None


def bias_of_refined_step(name: str, difference: float, restitution: float) -> float | None:
    """Bias under white noise where the step is refined near the stops.

    A refined step resolves slow impacts with the velocity that noise brings in it, which grows with
    the square root of the step: the rates are of order 1/2. The bias of a rate is None where the
    rate of all impacts is infinite.
    """
    finite = restitution > COLLAPSE_RESTITUTION
    if name not in RATES and finite:  # where stops lose much, the order is about 1
        return difference if restitution < WELL_RESOLVED_RESTITUTION else difference / 3.0
    return difference / (math.sqrt(2.0) - 1.0) if finite or name not in RATES else None


def bias_of_fast_impacts(difference: float, slow: float) -> float:
    """Bias of a rate under white noise, of which no more than a part `slow` is unresolved.

    That part may be missed. The others have the order of slow ones that are resolved, 1/2, on the
    safe side.
    """
    return difference / (math.sqrt(2.0) - 1.0) + slow


def share_below(speed: float, mean: float, mean_square: float) -> float:
    """Largest share of speeds below one, by their mean and mean square (Cantelli's inequality).

    >>> round(share_below(1.0, 4.0, 16.25), 4)
    0.027
    """
    if speed >= mean:
        return 1.0
    variance = max(mean_square - mean**2, 0.0)
    return variance / (variance + (mean - speed) ** 2)


def extrapolated(name: str, difference: float, restitution: float) -> float:
    """Bias at a step from the difference to twice the step, difference / (2^order - 1).

    A step resolves impact speeds above about sqrt(S0 h). Their density is w^(1 - beta) near 0, so
    those below hold a share h^((2 + m - beta) / 2) of the sum of w^m over impacts; the scheme
    itself is of order 2.

    >>> [round(extrapolated("impact_speed_rate", 0.3, r), 3) for r in (0.8, 0.5, 0.2)]
    [0.192, 0.3, 0.643]
    """
    power = SPEED_POWER.get(name, 1)
    order = min(2.0, (2.0 + power - corner_exponent(restitution)) / 2.0)
    # at R <= exp(-pi / sqrt 3) the rate has no limit at all
    return difference / (2.0**order - 1.0) if order > 0.0 else math.inf
