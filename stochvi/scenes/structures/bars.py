"""A uniform bar that moves along itself, EA u'' = density area u_tt."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np

from stochvi.mathematics.slender import Shape, bar_compliance, bar_modes
from stochvi.scenes.structures.spans import Mode, Share, Span
from stochvi.scenes.validation import NonNegative, Positive


class Bar(Span):
    """A uniform bar whose points move along it: a rod that strikes a stop with its end.

    The wave speed is c = sqrt(young / density); a bar that is fixed at one end has the natural
    frequencies (k - 1/2) c / (2 length).

    Parameters
    ----------
    length, area
        Length, m, and area of the cross-section, m^2.
    young, density
        Modulus of elasticity, Pa, and density, kg/m^3.
    support
        "cantilever", fixed at 0 and free at 1; "clamped", fixed at both ends; or "free".
    tip_mass, tip_spring
        Mass (kg) at the free end of a cantilever, and spring (N/m) from it to the base.
    zeta, loss_factor
        Damping ratio of every mode, or loss factor, twice that.
    modes, max_frequency_hz
        Number of modes; or all modes up to a frequency, Hz.
    points
        Places that may meet stops, be forced and reported, by name: their shares of the length.

    See Also
    --------
    stochvi.scenes.Beam : A beam that bends.

    Examples
    --------
    >>> rod = Bar(length=1.0, area=1e-4, young=2e11, density=8000.0, zeta=0.01, modes=2)
    >>> rod.natural_frequency_hz.round(3).tolist(), rod.places["tip"].round(12).tolist()
    ([1250.0, 3750.0], [1.0, 1.0])
    """

    moves: ClassVar[str] = "displacement along the bar"

    kind: Literal["bar"] = "bar"
    length: Positive
    area: Positive
    support: Literal["cantilever", "clamped", "free"] = "cantilever"
    tip_mass: NonNegative = 0.0
    tip_spring: NonNegative = 0.0
    points: dict[str, Share] | None = None

    def own_problems(self) -> list[tuple[str, str]]:
        return tip_without_free_end(self.support, self.tip_mass, self.tip_spring)

    @property
    def places_of_points(self) -> Mapping[str, float]:
        return self.points or usual_points(self.support)

    @property
    def movable(self) -> bool:
        return self.support != "free"

    @property
    def carried_mass(self) -> float:
        return self.density * self.area * self.length + self.tip_mass

    @cached_property
    def found(self) -> list[Mode]:
        mass = self.density * self.area * self.length
        rate = math.sqrt(self.young / self.density) / self.length
        shapes = bar_modes(
            self.support,
            enough=lambda found: self.enough(
                found[-1].parameter * rate / (2.0 * math.pi) if found else 0.0, len(found)
            ),
            tip_mass=self.tip_mass / mass,
            tip_spring=self.tip_spring * self.length / (self.young * self.area),
        )
        return along(shapes, lambda z: rate * z, mass, self)

    def flexibility(self, one: float, two: float) -> float:
        soft = self.length / (self.young * self.area)
        return soft * bar_compliance(self.support, one, two, tip_spring=self.tip_spring * soft)


def along(shapes: list[Shape], omega_of, mass: float, span: Span) -> list[Mode]:  # type: ignore[no-untyped-def]
    """Modes of a bar or beam of this mass from their shapes; those above the frequency that was
    asked for are left out."""
    found = []
    for shape in shapes:
        omega = float(omega_of(shape.parameter))
        if span.max_frequency_hz is not None and omega > 2.0 * math.pi * span.max_frequency_hz:
            continue
        found.append(
            Mode(
                omega=omega,
                mass=mass * shape.square,
                participation=shape.mean / shape.square,
                at_points={
                    name: _no_rounding(float(shape.at(np.array(place))))
                    for name, place in span.places_of_points.items()
                },
            )
        )
    return found


NODE_ROUNDING = 1e-12
"""Displacement, relative to the largest of a mode, that counts as a rounding error at a node."""


def _no_rounding(value: float) -> float:
    return value if abs(value) > NODE_ROUNDING else 0.0


def usual_points(support: str) -> dict[str, float]:
    """The point that a structure has if none is named: the free end, or the middle."""
    return {"tip": 1.0} if support in ("cantilever", "free") else {"middle": 0.5}


def tip_without_free_end(support: str, mass: float, spring: float) -> list[tuple[str, str]]:
    """Fault of the mass and the spring at the tip: the key and a sentence each."""
    return [
        (key, f"is at the free end of support = 'cantilever' only, got support = {support!r}")
        for key, value in (("tip_mass", mass), ("tip_spring", spring))
        if value and support != "cantilever"
    ]
