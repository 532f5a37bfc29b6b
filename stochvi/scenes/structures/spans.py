"""What bars, beams and plates have in common: modes from exact solutions, as many as are asked for,
and the static compliance of those left out."""

from __future__ import annotations

import itertools
from abc import abstractmethod
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from stochvi.results.errors import SceneError
from stochvi.scenes.structures.modes import ModalStructure, ModalTable
from stochvi.scenes.validation import Count, NonNegative, Positive, given

MOST_MODES = 200
"""Largest number of modes of a structure: the cost of a simulation grows with its square."""

Share = Annotated[NonNegative, Field(le=1)]
"""A place by its share of a length, 0 to 1."""


class Mode(NamedTuple):
    """A mode of a bar, beam or plate: frequency (rad/s), modal mass (kg), participation factor, and
    its displacement at each point."""

    omega: float
    mass: float
    participation: float
    at_points: Mapping[str, float]


class Span(ModalStructure):
    """Base class of bars, beams and plates.

    Parameters
    ----------
    young, density
        Modulus of elasticity, Pa, and density, kg/m^3.
    zeta, loss_factor
        Damping ratio of every mode; or the loss factor of the material, which is twice that.
        Exactly one of the two. A motion that no spring holds is not damped.
    modes, max_frequency_hz
        Number of modes; or all modes up to a frequency, Hz. Exactly one of the two.
    """

    young: Positive
    density: Positive
    zeta: NonNegative | None = None
    loss_factor: NonNegative | None = None
    modes: Count | None = None
    max_frequency_hz: Positive | None = None

    moves: ClassVar[str] = "deflection"
    """Its displacement in words."""

    if TYPE_CHECKING:  # keys of each, at their places among its keys

        @property
        def length(self) -> float:
            """Length, m."""

        @property
        def support(self) -> str:
            """How its ends are held."""

    @model_validator(mode="after")
    def _has_modes(self) -> Self:
        for one, other in (("zeta", "loss_factor"), ("modes", "max_frequency_hz")):
            if (getattr(self, one) is None) == (getattr(self, other) is None):
                raise ValueError(
                    f"needs exactly one of {one} and {other}, got {given(self, one, other)}"
                )
        problems = self.own_problems()
        if self.modes is not None and self.modes > MOST_MODES:
            problems.append(("modes", f"must be at most {MOST_MODES}, got {self.modes}"))
        for name in self.places_of_points:
            if not name or name == "base" or name.startswith("mode "):
                problems.append(
                    ("points", f"must have names other than 'base' and 'mode 1', got {name!r}; "
                     "choose another name")
                )  # fmt: skip
        if not problems and not self.found:
            problems.append(
                ("max_frequency_hz", f"must be above the lowest natural frequency, got "
                 f"{self.max_frequency_hz:g}; raise it, or give modes = 1")
            )  # fmt: skip
        if not problems and self.modes is not None and len(self.found) < self.modes:
            problems.append(("modes", self.why_no_more))
        if not problems and len(self.found) > MOST_MODES:
            problems.append(
                ("max_frequency_hz", f"must leave at most {MOST_MODES} modes below it, got "
                 f"{self.max_frequency_hz:g}; lower it")
            )  # fmt: skip
        if problems:
            raise SceneError(problems)
        return self

    def own_problems(self) -> list[tuple[str, str]]:
        """Fault of the keys of this structure: the key and a sentence each."""
        return []

    @property
    def why_no_more(self) -> str:
        """Why there are fewer modes than were asked for."""
        return f"must be at most {len(self.found)}, got {self.modes}"

    @property
    @abstractmethod
    def places_of_points(self) -> Mapping[str, Any]:
        """Where each named point lies, as shares of the lengths."""

    @property
    def sides(self) -> tuple[float, ...]:
        """Its length, m; of what has an area its width, too."""
        return (self.length,)

    def with_places(self, count: int) -> Self:
        """The same with "place 0", "place 1" and so on as its first points, `count` of them over
        each side, row after row."""
        share = np.linspace(0.0, 1.0, count).tolist()
        grid = list(itertools.product(share, repeat=len(self.sides)))
        places = {f"place {k}": at if len(at) > 1 else at[0] for k, at in enumerate(grid)}
        return self.replace(points={**places, **self.places_of_points})

    @property
    @abstractmethod
    def found(self) -> list[Mode]:
        """The modes that were asked for, in rising order of their frequencies."""

    @abstractmethod
    def flexibility(self, one: Any, two: Any) -> float:
        """Static deflection (m/N) at a place per unit force at another; 0 where nothing holds the
        structure."""

    def enough(self, frequency_hz: float, count: int) -> bool:
        """Whether modes may end, with so many found of which the last has this frequency."""
        if self.modes is not None:
            return count >= self.modes
        assert self.max_frequency_hz is not None
        return frequency_hz > self.max_frequency_hz or count > MOST_MODES

    @cached_property
    def table(self) -> ModalTable:
        """The modes."""
        ratio = self.zeta if self.zeta is not None else 0.5 * (self.loss_factor or 0.0)
        omega = np.array([mode.omega for mode in self.found])
        return ModalTable(
            omega=omega,
            zeta=np.where(omega > 0.0, ratio, 0.0),
            mass=np.array([mode.mass for mode in self.found]),
            shapes={
                name: np.array([mode.at_points[name] for mode in self.found])
                for name in self.places_of_points
            },
            participation=np.array([mode.participation for mode in self.found]),
        )

    def compliance(self, weights: Mapping[str, float]) -> float:
        places, table = self.places_of_points, self.table
        if not set(weights) <= set(places):  # a modal coordinate has no point
            return 0.0
        whole = sum(
            one * two * self.flexibility(places[a], places[b])
            for a, one in weights.items()
            for b, two in weights.items()
        )
        if not whole:
            return 0.0
        row = np.sum([weight * table.shapes[name] for name, weight in weights.items()], axis=0)
        return max(float(whole - np.sum(row**2 / (table.mass * table.omega**2))), 0.0)

    def assumptions(self) -> list[str]:
        highest = self.table.omega[-1] / (2.0 * np.pi)
        return [
            f"the structure moves by {len(self.found)} modes up to {highest:.4g} Hz; the static "
            "compliance of higher ones lies in series with elastic, viscoelastic and tabulated "
            "stops",
            "the damping ratio is that of each mode",
        ]
