"""Structures of several modes with compliant stops: the plan."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stochvi.engine.law import rate
from stochvi.engine.sub_steps import CONTACT_ANGLE
from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION
from stochvi.methods.monte_carlo.compliant_white import SUMS_OF_A_STOP
from stochvi.methods.monte_carlo.modal import SUMS_OF_PAIR, ModalPlan, basis
from stochvi.methods.monte_carlo.tabulated import MOST_SUB_STEPS
from stochvi.model.model import Model, Pair, Stop
from stochvi.model.scales import PairScale
from stochvi.results.errors import NotApplicable
from stochvi.scenes.impact_laws import CompliantLaw

SUMS_OF_CONTACT_PAIR = (
    *SUMS_OF_PAIR,
    *(f"{name}_{side}" for side in ("lower", "upper") for name, _ in SUMS_OF_A_STOP),
)
"""Names of the sums over the impacts and the contacts of a pair; forces and powers are per unit of
the reduced mass. There are ROWS_OF_CONTACT_PAIR of them."""

CONTACT_ENERGY = 2e-6
"""Relative error of the energy of a structure by a contact with a stop that loses nothing: the mean
over contacts with linear, Hertzian and tabulated stops of all stiffnesses was 1.2e-6 at most."""

CONTACT_FRICTION = 4e-3
"""Relative bias of a motion with friction at compliant stops: paths of 12 s with 20 to 30 contacts
were off by at most 3.4e-3 of their largest displacement, against an integrator by events."""


@dataclass(frozen=True, kw_only=True)
class ModalContactsPlan(ModalPlan):
    """Steps, start and lengths where a stop of some pair is compliant (SI units)."""

    @property
    def method(self) -> str:  # type: ignore[override]
        """Name of the scheme, for the assumptions of a response."""
        way = "kick-flow-kick" if self.modes.kicked else "exact steps"
        return f"{way} in modal coordinates, contacts integrated in sub-steps"

    @property
    def contacts(self) -> bool:  # type: ignore[override]
        """Whether impacts on a stop are summed one by one; pairs then have SUMS_OF_CONTACT_PAIR."""
        return self.model.summed

    @property
    def sums_of_pair(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the sums over impacts and contacts of a pair."""
        return SUMS_OF_CONTACT_PAIR if self.contacts else SUMS_OF_PAIR

    @property
    def relative_bias(self) -> float:
        """Relative bias from contacts in sub-steps, whose errors of the energy add up for as long
        as it is remembered, and of friction in them."""
        if not self.contacts:
            return 0.0
        soft = any(
            stop.law.friction_coefficient and not stop.rigid
            for pair in self.model.pairs
            for stop in pair.stops
        )
        return CONTACT_ENERGY * self.hits_in_a_cluster + (CONTACT_FRICTION if soft else 0.0)

    @cached_property
    def _fastest_of_contacts(self) -> float | None:
        """Fastest rate of the structure in contacts, rad/s; None where all stops are rigid."""
        if not self.contacts:
            return None
        if self.modes.kicked:
            return self.modes.fastest
        return max(self.modes.fastest, float(np.linalg.eigvalsh(self.modes.damping)[-1]))


def plan_modal_contacts(
    model: Model, threshold: float | None, duration: float | None
) -> ModalContactsPlan:
    """Choose step, burn-in and length where a stop of some pair is compliant.

    Raises
    ------
    NotApplicable
        Where there is no stationary state, or a mass stays on a stop that is too stiff.
    """
    plan = ModalContactsPlan(**basis(model, threshold, duration))
    check_stiffness(plan)
    return plan


def rate_of_contact(pair: Pair, stop: Stop, scale: PairScale) -> float:
    """Fastest rate (rad/s) of a contact with a stop at the scale of its pair; infinite on a rigid
    one."""
    if not isinstance(stop.law, CompliantLaw):
        return math.inf
    law = stop.law.per_unit_mass(pair.mass).compiled()
    return float(rate(law, 0.0, scale.speed, scale.pressing))


def check_stiffness(plan: ModalContactsPlan) -> None:
    """Raise NotApplicable for a stop that is too stiff to be followed while a mass stays on it.

    A mass stays where it is pressed onto the stop, or comes to rest there.
    """
    unmet = []
    for pair, scale in zip(plan.model.pairs, plan.pairs, strict=True):
        for stop in pair.stops:
            stays = scale.pressing > 0.0 or stop.law.restitution <= COLLAPSE_RESTITUTION
            if not (isinstance(stop.law, CompliantLaw) and stays):
                continue
            fastest = rate_of_contact(pair, stop, scale)
            needed = plan.step * math.hypot(fastest, plan.modes.fastest) / CONTACT_ANGLE
            if needed > MOST_SUB_STEPS:
                unmet.append(
                    f"a mass that stays on the {stop.name} stop of {pair.name}, which is this "
                    f"stiff, needs {needed:.2g} sub-steps in each step, at most {MOST_SUB_STEPS} "
                    "are made; take a rigid stop (law.kind = 'restitution')"
                )
    if unmet:
        raise NotApplicable("simulate", unmet)
