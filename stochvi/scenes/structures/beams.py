"""A uniform beam that bends, of Euler and Bernoulli or of Timoshenko."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Literal

from stochvi.mathematics.slender import beam_compliance, beam_modes
from stochvi.scenes.structures.bars import along, tip_without_free_end, usual_points
from stochvi.scenes.structures.spans import Mode, Share, Span
from stochvi.scenes.validation import NonNegative, Positive, given


class Beam(Span):
    """A uniform beam whose points move across it.

    By Euler and Bernoulli EI w'''' + density area w_tt = 0, and the natural frequencies are
    beta^2 sqrt(EI / (density area)); Timoshenko adds shear and the inertia of rotation.

    Parameters
    ----------
    length
        Length, m.
    width, height
        Sides of a rectangular cross-section, m; the beam bends along the height.
    area, second_moment
        Instead: area, m^2, and second moment of area, m^4, of any cross-section.
    young, density
        Modulus of elasticity, Pa, and density, kg/m^3.
    theory
        "euler-bernoulli" or "timoshenko".
    poisson, shear_coefficient
        Poisson's ratio and shear coefficient of Timoshenko's theory.
    support
        "cantilever", clamped at 0 and free at 1; "pinned", "clamped" or "free" at both ends;
        "clamped-pinned", clamped at 0 and pinned at 1.
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
    stochvi.scenes.Modes : A structure by its modes.
    stochvi.scenes.Plate : A rectangular plate.

    Examples
    --------
    >>> reed = Beam(
    ...     length=0.2, width=0.02, height=0.002, young=2e11, density=7850.0, zeta=0.01, modes=3
    ... )
    >>> reed.natural_frequency_hz.round(2).tolist(), reed.places["tip"].round(9).tolist()
    ([40.77, 255.5, 715.39], [1.0, 1.0, 1.0])
    """

    kind: Literal["beam"] = "beam"
    length: Positive
    width: Positive | None = None
    height: Positive | None = None
    area: Positive | None = None
    second_moment: Positive | None = None
    theory: Literal["euler-bernoulli", "timoshenko"] = "euler-bernoulli"
    poisson: NonNegative = 0.3
    shear_coefficient: Positive = 5.0 / 6.0
    support: Literal["cantilever", "pinned", "clamped", "clamped-pinned", "free"] = "cantilever"
    tip_mass: NonNegative = 0.0
    tip_spring: NonNegative = 0.0
    points: dict[str, Share] | None = None

    def own_problems(self) -> list[tuple[str, str]]:
        names = given(self, "width", "height", "area", "second_moment")
        if names not in ("width, height", "area, second_moment"):
            raise ValueError(f"needs width and height, or area and second_moment, got {names}")
        problems = tip_without_free_end(self.support, self.tip_mass, self.tip_spring)
        if self.poisson > 0.5:
            problems.append(("poisson", f"must be at most 0.5, got {self.poisson:g}"))
        return problems

    @property
    def why_no_more(self) -> str:
        return (
            f"must be at most {len(self.found)}, got {self.modes}: higher modes lie above the "
            f"frequency of shear, {self._shear_frequency_hz:.4g} Hz, up to which Timoshenko's "
            "theory holds"
        )

    @property
    def places_of_points(self) -> Mapping[str, float]:
        return self.points or usual_points(self.support)

    @property
    def movable(self) -> bool:
        return self.support != "free"

    @property
    def carried_mass(self) -> float:
        return self._mass + self.tip_mass

    @property
    def _section(self) -> tuple[float, float]:
        """Area, m^2, and second moment of area, m^4."""
        if self.width is not None and self.height is not None:
            return self.width * self.height, self.width * self.height**3 / 12.0
        assert self.area is not None and self.second_moment is not None
        return self.area, self.second_moment

    @property
    def _mass(self) -> float:
        return self.density * self._section[0] * self.length

    @property
    def _bending(self) -> float:
        """EI / L^3, N/m."""
        return self.young * self._section[1] / self.length**3

    @property
    def _thickness(self) -> tuple[float, float]:
        """r^2 = I / (A L^2) and s^2 = EI / (k G A L^2); zeros for a beam of Euler and Bernoulli."""
        if self.theory == "euler-bernoulli":
            return 0.0, 0.0
        area, second = self._section
        rotary = second / (area * self.length**2)
        return rotary, rotary * 2.0 * (1.0 + self.poisson) / self.shear_coefficient

    @property
    def _shear_frequency_hz(self) -> float:
        """Frequency at which a section turns without the beam bending, sqrt(kGA / (density I))."""
        rotary, shear = self._thickness
        return math.sqrt(self._bending / (self._mass * rotary * shear)) / (2.0 * math.pi)

    @cached_property
    def found(self) -> list[Mode]:
        rate = math.sqrt(self._bending / self._mass)
        rotary, shear = self._thickness
        shapes = beam_modes(
            self.support,
            enough=lambda found: self.enough(
                found[-1].parameter ** 2 * rate / (2.0 * math.pi) if found else 0.0, len(found)
            ),
            rotary=rotary,
            shear=shear,
            tip_mass=self.tip_mass / self._mass,
            tip_spring=self.tip_spring / self._bending,
        )
        return along(shapes, lambda beta: rate * beta**2, self._mass, self)

    def flexibility(self, one: float, two: float) -> float:
        spring = self.tip_spring / self._bending
        _, shear = self._thickness
        soft = beam_compliance(self.support, one, two, shear=shear, tip_spring=spring)
        return soft / self._bending
