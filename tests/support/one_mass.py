"""One mass between its stops, without noise, as the engine flies it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.arithmetic import (
    FOUND,
    ROWS_OF_CONTACT_PAIR,
    ROWS_OF_PAIR,
    ROWS_OF_STOP,
)
from stochvi.engine.one_mass import MassStops, finish_step
from stochvi.methods.monte_carlo.white import StopsOfMass
from stochvi.scenes.impact_laws import Law


class Flown(NamedTuple):
    """What a mass has done: impacts (N, F1, F2) of the lower and of the upper stop; sums over the
    contacts with each; and the largest forces so far of contacts that last."""

    sums: NDArray[np.float64]
    peaks: NDArray[np.float64]

    @classmethod
    def before(cls) -> Flown:
        """Nothing."""
        return cls(np.zeros((1, ROWS_OF_CONTACT_PAIR)), np.zeros((1, 2)))

    def impacts(self, side: float) -> NDArray[np.float64]:
        """N, F1 and F2 of a stop."""
        return self.sums[0, :ROWS_OF_PAIR].reshape(2, 3)[int(side > 0.0)]

    def contacts(self, side: float) -> NDArray[np.float64]:
        """Sums over the contacts with a stop."""
        return self.sums[0, ROWS_OF_PAIR:].reshape(2, ROWS_OF_STOP)[int(side > 0.0)]


def stops_at(
    stops: dict[float, tuple[float, Law]], stiffness: float, speed: float = 1.0,
    step: float = 1.0,
) -> MassStops:  # fmt: skip
    """Stops by side, each with its position from the rest position and its law per unit mass."""
    laws = {int(side > 0.0): (place, law.compiled()) for side, (place, law) in stops.items()}
    return StopsOfMass(laws=laws, stiffness=stiffness, speed=speed, longest=step).for_kernel


def fly(
    x: float, v: float, span: float, stiffness: float, at: MassStops, flown: Flown
) -> tuple[float, float]:
    """Displacement and velocity after `span` s, without noise."""
    found: tuple[float, float] = finish_step(
        stiffness, math.sqrt(stiffness), x, v, span, at, 0.0, flown.peaks, flown.sums, 0,
        np.uint64(1), np.zeros(FOUND), None,
    )  # fmt: skip
    return found
