"""White noise, and white noise that passes through a resonance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from stochvi.mathematics.units import intensity_from_density, power_ratio, unit
from stochvi.scenes.excitations.base import BASE, DensityUnit, Disturbance
from stochvi.scenes.validation import Positive, given


class _Strength(Disturbance):
    """White noise of a strength: `intensity` S0, or a one-sided `density` with its `unit`.

    Parameters
    ----------
    intensity
        S0, two-sided, N^2 s on a mass, (m/s^2)^2 s on the base.
    density
        Instead of the intensity: the one-sided density per hertz, 2 S0, in `unit`.
    unit
        Unit of the density: "g2/Hz" or "(m/s2)2/Hz" on the base, "N2/Hz" on a mass, in any
        spelling.
    """

    on: str | None = None
    intensity: Positive | None = None
    density: Positive | None = None
    unit: DensityUnit | None = None

    @property
    def density_unit(self) -> str | None:
        """Unit of the density; None for an intensity, which is in SI units."""
        return self.unit

    @model_validator(mode="after")
    def _one_strength(self) -> Self:
        if (self.intensity is None) == (self.density is None):
            raise ValueError(
                "needs exactly one of intensity and density, "
                f"got {given(self, 'intensity', 'density')}"
            )
        if (self.density is None) != (self.unit is None):
            raise ValueError(
                "needs density and unit together (intensity is in SI units), "
                f"got {given(self, 'intensity', 'density', 'unit')}"
            )
        return self

    @property
    def si_intensity(self) -> float:
        """S0 in N^2 s or (m/s^2)^2 s."""
        if self.intensity is not None:
            return self.intensity
        assert self.density is not None and self.unit is not None
        return intensity_from_density(self.density * unit(self.unit).factor)

    def louder(self, level_db: float) -> Self:
        power = power_ratio(level_db)
        return self.model_copy(
            update={
                name: power * strength
                for name, strength in (("intensity", self.intensity), ("density", self.density))
                if strength is not None
            }
        )

    def numbers(self) -> dict[str, float]:
        return {"density": 2.0 * self.si_intensity}

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        unit = "(m/s²)²/Hz" if where == BASE else "N²/Hz"
        name = f"{self.effect_word.capitalize()} on {where}"
        return [(name, f"{numbers['density']:.4g} {unit}", self._remark())]

    def _remark(self) -> str:
        return "one-sided; intensity S0 is half of it"


class WhiteNoise(_Strength):
    """White noise, E f(t) f(t + tau) = S0 delta(tau), as a force or a base acceleration.

    Give `intensity`, or `density` with its `unit`; S0 = density / 2.

    See Also
    --------
    stochvi.FilteredNoise : White noise through a resonance.
    stochvi.TabulatedNoise : Noise by its density.

    Examples
    --------
    >>> WhiteNoise(intensity=0.2).si_intensity
    0.2
    >>> round(WhiteNoise(on="base", density=0.01, unit="g2/Hz").si_intensity, 6)
    0.480852
    """

    effect_word: ClassVar[str] = "white noise"
    family: ClassVar[str] = "white noise"

    kind: Literal["white"] = "white"


class FilteredNoise(_Strength):
    """White noise that has passed through a resonance.

    It follows from white noise w of intensity S0 by

        f'' + 2 zeta w_f f' + w_f^2 f = w_f^2 w(t),    w_f = 2 pi frequency_hz,

    so that far below the resonance its density is that of w, and E f^2 = w_f S0 / (4 zeta). The
    noise is narrow-band for a small `zeta`. The strength of w is given as for `WhiteNoise`.

    Parameters
    ----------
    frequency_hz
        Frequency of the resonance, Hz.
    zeta
        Damping ratio of the resonance.

    See Also
    --------
    stochvi.WhiteNoise : Noise that no filter has shaped.
    stochvi.TabulatedNoise : Noise by its density.

    Examples
    --------
    >>> sea = FilteredNoise(intensity=2.0, frequency_hz=0.1, zeta=0.05)
    >>> round(sea.variance, 4)
    6.2832
    """

    effect_word: ClassVar[str] = "filtered noise"
    family: ClassVar[str] = "filtered noise"

    kind: Literal["filtered"] = "filtered"
    frequency_hz: Positive
    zeta: Positive

    @property
    def omega(self) -> float:
        """Resonance w_f of the filter, rad/s."""
        return 2.0 * math.pi * self.frequency_hz

    @property
    def variance(self) -> float:
        """E f^2, in N^2 or (m/s^2)^2."""
        return self.omega * self.si_intensity / (4.0 * self.zeta)

    def _remark(self) -> str:
        return (
            f"{super()._remark()}; both are before the filter, a resonance at "
            f"{self.frequency_hz:.4g} Hz with a damping ratio of {self.zeta:.3g}"
        )
