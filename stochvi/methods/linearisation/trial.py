"""What a form says: a response, and the linearised stops that it calls for."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.impact_rates import ContactStatistics, StopStatistics
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.scenes.scene import System

ROOT_TWO_PI = math.sqrt(2.0 * math.pi)

SIGNS = {"lower": -1.0, "upper": 1.0}
"""The sides of a mass, and which way they lie."""

Unknowns = NDArray[np.float64]


class Trial(NamedTuple):
    """A response, and the linearised stops that it calls for, per unit mass.

    `stop_force`, `stiffness` and `damping` are m_F, k and beta; `density_at_mean` is that of x.
    `rise` is the factor by which the density right at a stop exceeds that of the family of laws.
    The contacts are those with stops that give way, forces and powers per unit mass.
    """

    mean: float
    variance: float
    velocity_mean_square: float
    density_at_mean: float
    stop_force: float
    stiffness: float
    damping: float
    lower: StopStatistics
    upper: StopStatistics
    rise: float = 1.0
    contact_lower: ContactStatistics | None = None
    contact_upper: ContactStatistics | None = None


class Form(NamedTuple):
    """One way to linearise: where to start, and what a set of unknowns stands for.

    `others` are to be tried in turn where this one has no solution.
    """

    start: Callable[[System], Unknowns]
    trial: Callable[[System, Unknowns], Trial]
    others: tuple[Form, ...] = ()


def restitutions(system: System) -> tuple[float, float]:
    """R at the lower and the upper stop; 1 (no loss) where there is none."""
    lower, upper = system.restitution_lower, system.restitution_upper
    return 1.0 if lower is None else lower, 1.0 if upper is None else upper


def soft_stops(system: System) -> dict[str, CompliantLaw]:
    """The laws of the stops that give way, by side."""
    laws = zip(SIGNS, (system.lower, system.upper), system.laws, strict=True)
    return {
        side: law for side, stop, law in laws if stop is not None and isinstance(law, CompliantLaw)
    }
