"""Compliant stops under white noise: the plan of kick-flow-kick (step, start, lengths)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from stochvi.engine.sums import ENDED, IMPULSE, LOSS, PEAK, TIME
from stochvi.methods.monte_carlo.kernels.compliant import run_contacts
from stochvi.methods.monte_carlo.kernels.rows import CONTACT_LOWER, CONTACT_SUMS, CONTACT_UPPER
from stochvi.methods.monte_carlo.mass_stops import StopsOfMass, stops_of_mass
from stochvi.methods.monte_carlo.rigid_white import (
    BOUNCE_PER_STEP,
    GAP_PER_STEP,
    LOSSY_ANGLE,
    LOSSY_DECAY,
    WhitePlan,
    _flow,
    default_threshold,
    expected_speed,
    lengths,
    pressing,
)
from stochvi.model.gibbs_law import GibbsLaw
from stochvi.model.model import Model, Stop
from stochvi.results.errors import NotApplicable

SUMS_OF_A_STOP = (
    ("force", IMPULSE),
    ("loss", LOSS),
    ("peak", PEAK),
    ("contact", TIME),
    ("ended", ENDED),
)
"""Names of the sums over the contacts with one stop, and their rows in the table of `rows`."""

CONTACT_ROWS = {
    f"{name}_{side}": first + row
    for side, first in (("lower", CONTACT_LOWER), ("upper", CONTACT_UPPER))
    for name, row in SUMS_OF_A_STOP
}
"""Rows of the time averages over contacts, by name and stop: the mean force (m/s^2) and the mean
dissipated power (m^2/s^3) per unit mass; the sum of the peak forces of ended contacts per second
and unit mass (m/s^3); the share of time in contact; and the ended contacts per second (1/s), slow
ones included."""

LARGEST_ANGLE = 0.8
"""Largest omega h of a step (rad) between elastic stops, where any step is free of bias."""

SPREAD_PER_STEP = GAP_PER_STEP * math.sqrt(12.0)
"""Largest distance that the mass crosses in a step at its rms speed, in standard deviations of x.
It equals GAP_PER_STEP for a uniform law, whose width is sqrt(12) standard deviations."""


@dataclass(frozen=True, kw_only=True)
class CompliantPlan(WhitePlan):
    """Steps, start and lengths with a compliant stop; `averages` begin with CONTACT_SUMS rows."""

    rows = CONTACT_SUMS
    sums_of_contacts = tuple(CONTACT_ROWS)
    _kernel = staticmethod(run_contacts)
    _no_log = None

    _kept_at_start = 0.0, 0.0
    """No contact lasts before the first step."""

    def _kernel_constants(self) -> tuple[Any, ...]:
        return self._kick, _flow(self.model, self.step), self._stops.for_kernel

    @cached_property
    def _stops(self) -> StopsOfMass:
        return stops_of_mass(self.model, self.speed, self.step)

    @cached_property
    def _law(self) -> GibbsLaw:  # type: ignore[override]
        """The Gibbs distribution at the expected speed, from the static equilibrium."""
        return _gibbs_law(self.model, self.speed, self.model.rest)

    @property
    def _walls(self) -> tuple[float, float]:
        return self._law.walls


def _gibbs_law(model: Model, speed: float, rest: float = 0.0) -> GibbsLaw:
    """Gibbs distribution at E v^2 = speed^2, positions from `rest`, m, where the load is reduced
    accordingly."""
    return GibbsLaw(
        theta=speed**2,
        omega=model.omega,
        load=model.load - model.omega**2 * rest,
        lower=_from_rest(model.lower, rest),
        upper=_from_rest(model.upper, rest),
    )


def _from_rest(stop: Stop | None, rest: float) -> Stop | None:
    """A stop with its position taken from the rest position; None for none."""
    return None if stop is None else replace(stop, position=stop.position - rest)


def plan_compliant(
    model: Model, threshold: float | None, duration: float | None, slow_impacts: bool = False
) -> CompliantPlan:
    """Choose step, burn-in and length for white noise and stops of which one is compliant.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Elastic
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair, Scene
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(upper=1.0, law=Elastic(stiffness=100.0))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> from stochvi.model.model import model_of
    >>> plan = plan_compliant(model_of(scene), None, None)
    >>> plan.step, plan.averages(seed=1, first_path=0, paths=3).shape
    (0.8, (21, 3))
    """
    unmet = []
    if slow_impacts:
        unmet.append("slow_impacts must be left out with compliant stops, which it does not refine")
    if model.omega == 0.0 and model.load != 0.0:
        unmet.append("a constant load needs stiffness > 0, got 0")
    try:
        _gibbs_law(model, 1.0)
    except ValueError:
        unmet.append("without stiffness the mass needs a lower and an upper stop that hold it")
    if model.damping_rate == 0.0 and model.elastic:
        unmet.append("damping must be positive or a stop must lose energy (no stationary state)")
    if unmet:
        raise NotApplicable("simulate", unmet)
    # the speed between rigid stops of the same restitution is accurate enough
    speed = expected_speed(model)
    law = _gibbs_law(model, speed)
    spread = math.sqrt(law.variance)
    rate = model.intensity / (2.0 * speed**2)
    slowest = max(1.0 / rate, spread / speed, spread**2 * rate / speed**2)
    step = _step(model, speed, spread)
    burn_in, length = lengths(model, step, slowest, duration)
    return CompliantPlan(
        model=model,
        speed=speed,
        step=step,
        burn_in=burn_in,
        duration=length,
        threshold=default_threshold(model.elastic, speed) if threshold is None else threshold,
    )


def _step(model: Model, speed: float, spread: float) -> float:
    """Return the step, s: a part of the shortest of the times that it must resolve.

    They are a radian of the motion, the loss of energy, the way across the spread, and a contact.
    """
    limits = [SPREAD_PER_STEP * spread / speed]
    if model.omega > 0.0:
        limits.append((LARGEST_ANGLE if model.elastic else LOSSY_ANGLE) / model.omega)
    if not model.elastic:
        limits.append(LOSSY_DECAY * 2.0 * speed**2 / model.intensity)
    if pressing(model) > 0.0:
        limits.append(BOUNCE_PER_STEP * speed / pressing(model))
    return min(limits)
