"""The stops of one oscillator, as the engine knows them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from stochvi.engine.compiled_laws import Stops, functions_of, stops_of
from stochvi.engine.complete_contacts import NOTHING_KNOWN, Complete, complete_contacts
from stochvi.engine.one_mass import MassStops
from stochvi.model.model import UPPER, Model


@dataclass(frozen=True, kw_only=True, eq=False)
class StopsOfMass:
    """The stops of one mass, per unit mass.

    Parameters
    ----------
    laws
        Position from the rest position, m, and law of the lower stop (0) and of the upper one (1).
    stiffness
        w0^2, 1/s^2.
    speed
        Rms speed of the mass, m/s.
    longest
        Longest step, s, within which contacts are read from tables.
    shaken
        Whether noise acts in a step: contacts are then followed, none is read.
    """

    laws: Mapping[int, tuple[float, Any]]
    stiffness: float
    speed: float
    longest: float
    shaken: bool = False

    @property
    def for_kernel(self) -> MassStops:
        """The argument of kernels. It holds for this process only, as it has addresses."""
        stops, classes = self._stops
        return MassStops(
            places=stops.places[0], kinds=stops.kinds[0], rigid=stops.rigid[0],
            lossy=stops.lossy[0], numbers=stops.numbers,
            laws=functions_of(classes, mass=not self.shaken, shaken=self.shaken),
            complete=self._complete,
        )  # fmt: skip

    @cached_property
    def _stops(self) -> tuple[Stops, list[Any]]:
        places = np.array([[-math.inf, math.inf]])
        for which, (position, _) in self.laws.items():
            places[0, which] = position
        laws = {(0, which): law for which, (_, law) in self.laws.items()}
        return stops_of(places, np.zeros(1), laws)

    @cached_property
    def _complete(self) -> Complete:
        if self.shaken:
            return NOTHING_KNOWN
        stops, classes = self._stops
        functions = functions_of(classes, mass=True)
        return complete_contacts(stops, functions, self.stiffness, self.speed, self.longest)


def stops_of_mass(model: Model, speed: float, longest: float, shaken: bool = False) -> StopsOfMass:
    """The stops of a model of one oscillator, for the rms speed, m/s, and steps of at most
    `longest` s; see `StopsOfMass`."""
    laws = {
        int(stop.side == UPPER): (stop.position - model.rest, stop.law.compiled())
        for stop in model.stops_per_unit_mass
    }
    return StopsOfMass(
        laws=laws, stiffness=model.omega**2, speed=speed, longest=longest, shaken=shaken
    )
