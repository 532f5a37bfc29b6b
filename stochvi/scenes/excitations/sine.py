"""A sine."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from stochvi.mathematics.units import listed_units, power_ratio, unit
from stochvi.results.errors import SceneError
from stochvi.scenes.excitations.base import BASE, BaseExcitation
from stochvi.scenes.validation import Number, Positive, given

STRENGTHS = ("amplitude", "displacement", "velocity", "unbalance")
"""Keys for the strength of a sine; a sine takes one of them."""


class Sine(BaseExcitation):
    """A sine, a cos(2 pi frequency_hz t + phase), with a random phase in each path.

    Parameters
    ----------
    amplitude
        Peak (not rms) of the force on a mass, N, or of the acceleration of the base, m/s^2 or in
        `unit`.
    unit
        Unit of the amplitude of a base, as "g"; by default SI units.
    displacement, velocity
        Instead: peak displacement (m) or velocity (m/s) of the base, so that the acceleration grows
        with the frequency. A displacement `between` two coordinates is that of a crank on one of
        them. It moves the end of the spring and damper that lead to the other.
    unbalance
        Instead: the unbalance of a rotor on the mass, kg m, whose force is unbalance * omega^2.
    frequency_hz
        Frequency, Hz.
    phase_deg
        Phase of the sine, degrees, where several sines make one periodic force. Periodic regimes
        use it; every other method draws phases at random.

    See Also
    --------
    stochvi.harmonic_response : All regimes under a sine.

    Examples
    --------
    >>> Sine(on="base", amplitude=9.80665, frequency_hz=50.0).peak
    9.80665
    >>> Sine(on="base", amplitude=0.5, unit="g", frequency_hz=17.0).peak
    4.903325
    >>> round(Sine(on="base", displacement=1e-4, frequency_hz=50.0).peak, 3)
    9.87
    """

    effect_word: ClassVar[str] = "sine"
    family: ClassVar[str] = "sine"

    kind: Literal["sine"] = "sine"
    on: str | None = None
    amplitude: Positive | None = None
    unit: str | None = None
    displacement: Positive | None = None
    velocity: Positive | None = None
    unbalance: Positive | None = None
    frequency_hz: Positive
    phase_deg: Number = 0.0

    @model_validator(mode="after")
    def _one_strength(self) -> Self:
        if len(self._strengths()) != 1:
            raise ValueError(
                "needs exactly one of amplitude (N; m/s^2 of a base), displacement (m of the "
                "base), velocity (m/s of the base) and unbalance (kg m), got "
                f"{given(self, *STRENGTHS)}"
            )
        if self.unit is not None and self.amplitude is None:
            raise SceneError([("unit", "is that of amplitude, got none; leave unit out")])
        self._factor  # noqa: B018  a unit that is none is refused here
        return self

    @property
    def _factor(self) -> float:
        """The amplitude in SI units over the number that is given."""
        if self.unit is None:
            return 1.0
        found = unit(self.unit)
        if found.quantity not in ("acceleration", "force"):
            raise SceneError(
                [("unit", f"must be one of {listed_units('acceleration', 'force')}, got "
                  f"{self.unit!r}")]
            )  # fmt: skip
        return found.factor

    def _strengths(self) -> dict[str, float]:
        values = {name: getattr(self, name) for name in STRENGTHS}
        return {name: value for name, value in values.items() if value is not None}

    @property
    def strength(self) -> tuple[str, float]:
        """The key that gives the strength, and its number."""
        ((name, value),) = self._strengths().items()
        return name, value

    @property
    def crank(self) -> float | None:
        """Radius (m) of a crank between two coordinates; None for a force, or on a base."""
        return None if self.between is None else self.displacement

    @property
    def peak(self) -> float:
        """Peak force on a mass, N, or peak acceleration of the base or of a crank, m/s^2."""
        name, value = self.strength
        power = {"amplitude": 0, "velocity": 1}.get(name, 2)
        factor = self._factor * (2.0 * math.pi * self.frequency_hz) ** power
        return float(value * factor)

    def misplaced(self, where: str) -> str:
        """Fault of the key of the strength for a sine that acts on `where`; empty if nothing is."""
        name, _ = self.strength
        if name in ("displacement", "velocity") and where != BASE and not self.crank:
            return f"has {name}, which is that of the base, got on = {where!r}; give amplitude (N)"
        quantity = "acceleration" if where == BASE or self.crank else "force"
        if self.unit is not None and unit(self.unit).quantity != quantity:
            fitting = listed_units(quantity)
            return f"has unit = {self.unit!r} on {where!r}; expected one of {fitting}"
        if name == "unbalance" and where == BASE:
            return "has unbalance, which acts on a mass, got on = 'base'; give amplitude (m/s^2)"
        return ""

    def louder(self, level_db: float) -> Self:
        name, value = self.strength
        return self.model_copy(update={name: math.sqrt(power_ratio(level_db)) * value})

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        unit = "m/s² peak" if where == BASE else "N peak"
        strength = f"{self.crank:.4g} m crank" if self.crank else f"{self.peak:.4g} {unit}"
        return [(f"Sine on {where}", strength, f"at {self.frequency_hz:g} Hz")]
