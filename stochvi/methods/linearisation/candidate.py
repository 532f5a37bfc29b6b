"""A candidate: a response, and the linearised stops that a form derives from it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.impact_rates import NO_STOP, ContactStatistics, StopStatistics
from stochvi.model.gap import Gap
from stochvi.model.model import LOWER, UPPER

ROOT_TWO_PI = math.sqrt(2.0 * math.pi)

Unknowns = NDArray[np.float64]


class Candidate(NamedTuple):
    """A response, and the linearised stops that it calls for, per unit mass.

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
