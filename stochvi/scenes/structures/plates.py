"""A thin rectangular plate that is simply supported along its four edges."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator

from stochvi.scenes.structures.bars import _no_rounding
from stochvi.scenes.structures.spans import MOST_MODES, Mode, Share, Span
from stochvi.scenes.validation import NonNegative, Positive

WAVES = 400
"""Number of half waves along each side in the sum of a static deflection; it leaves out about
1 / WAVES^2 of the deflection."""


def _plain(values: object) -> object:
    return tuple(values) if isinstance(values, list) else values


Place = Annotated[tuple[Share, Share], BeforeValidator(_plain)]
"""A place on a plate by its shares of length and width."""


class Plate(Span):
    """A thin rectangular plate on simple supports, whose points move across it.

    Its rigidity is D = young height^3 / (12 (1 - poisson^2)).

    With m and n half waves along the sides
    omega = pi^2 (m^2 / length^2 + n^2 / width^2) sqrt(D / (density height)).

    Parameters
    ----------
    length, width, height
        Sides and thickness, m.
    young, density, poisson
        Modulus of elasticity, Pa, density, kg/m^3, and Poisson's ratio.
    support
        "pinned": simply supported along all edges, the one that is known.
    zeta, loss_factor
        Damping ratio of every mode, or loss factor, twice that.
    modes, max_frequency_hz
        Number of modes; or all modes up to a frequency, Hz.
    points
        Places that may meet stops, be forced and reported, by name: shares of length and width.

    See Also
    --------
    stochvi.scenes.Beam : A beam.

    Examples
    --------
    >>> panel = Plate(
    ...     length=0.4, width=0.3, height=0.002, young=7e10, density=2700.0, zeta=0.01, modes=3
    ... )
    >>> panel.natural_frequency_hz.round(2).tolist()
    [84.04, 174.8, 245.4]
    """

    kind: Literal["plate"] = "plate"
    length: Positive
    width: Positive
    height: Positive
    poisson: NonNegative = 0.3
    support: Literal["pinned"] = "pinned"
    points: dict[str, Place] | None = None

    def own_problems(self) -> list[tuple[str, str]]:
        if self.poisson > 0.5:
            return [("poisson", f"must be at most 0.5, got {self.poisson:g}")]
        return []

    @property
    def places_of_points(self) -> Mapping[str, tuple[float, float]]:
        return self.points or {"centre": (0.5, 0.5)}

    @property
    def sides(self) -> tuple[float, ...]:
        return (self.length, self.width)

    @property
    def carried_mass(self) -> float:
        return self.density * self.length * self.width * self.height

    @property
    def _rate(self) -> float:
        """pi^2 sqrt(D / (density height)), m^2/s."""
        stiffness = self.young * self.height**2 / (12.0 * (1.0 - self.poisson**2))
        return math.pi**2 * math.sqrt(stiffness / self.density)

    @cached_property
    def found(self) -> list[Mode]:
        if self.modes is not None:
            along, across = _waves(min(self.modes, MOST_MODES))
        else:
            assert self.max_frequency_hz is not None
            reach = math.sqrt(2.0 * math.pi * self.max_frequency_hz / self._rate)
            along, across = (
                np.arange(1, 1 + min(int(reach * side), 2 * MOST_MODES))
                for side in (self.length, self.width)
            )
        m, n = (each.ravel() for each in np.meshgrid(along, across, indexing="ij"))
        omega = self._rate * ((m / self.length) ** 2 + (n / self.width) ** 2)
        order = np.argsort(omega, kind="stable")
        if self.modes is not None:
            order = order[: self.modes]
        else:
            order = order[omega[order] <= 2.0 * math.pi * (self.max_frequency_hz or 0.0)]
        found = []
        for k in order[: MOST_MODES + 1]:
            odd = m[k] % 2 and n[k] % 2
            found.append(
                Mode(
                    omega=float(omega[k]),
                    mass=0.25 * self.carried_mass,
                    participation=16.0 / (math.pi**2 * m[k] * n[k]) if odd else 0.0,
                    at_points={
                        name: _no_rounding(
                            math.sin(m[k] * math.pi * x) * math.sin(n[k] * math.pi * y)
                        )
                        for name, (x, y) in self.places_of_points.items()
                    },
                )
            )
        return found

    def flexibility(self, one: tuple[float, float], two: tuple[float, float]) -> float:
        waves = np.arange(1, WAVES + 1)
        m, n = waves[:, None], waves[None, :]
        omega = self._rate * ((m / self.length) ** 2 + (n / self.width) ** 2)
        shapes = [np.sin(m * math.pi * x) * np.sin(n * math.pi * y) for x, y in (one, two)]
        return float(np.sum(shapes[0] * shapes[1] / omega**2) / (0.25 * self.carried_mass))


def _waves(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of half waves along each side, among which are the lowest `count` modes."""
    return np.arange(1, count + 1), np.arange(1, count + 1)
