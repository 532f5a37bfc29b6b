"""Narrow bands of noise and sines whose frequency moves through a phase of a mission."""

from __future__ import annotations

import math
from typing import Literal, Self

from pydantic import model_validator

from stochvi.scenes.excitations import Sine, TabulatedNoise
from stochvi.scenes.excitations.base import DensityOrLevelUnit
from stochvi.scenes.validation import Checked, Number, Positive, given


class MovingBand(Checked):
    """A narrow band of noise, or a sine, whose frequency moves from one end to the other.

    Parameters
    ----------
    from_hz, to_hz
        Frequency at the start and at the end of the phase, Hz; the middle of a band.
    width_hz, density, unit
        Width of the band, Hz, its one-sided density, and the unit of that.
    amplitude
        Instead: peak of a sine, N on a mass, m/s^2 of the base.
    on, axis
        What it acts on, as for any excitation.

    See Also
    --------
    stochvi.scenes.Phase : The phase that it belongs to.

    Examples
    --------
    >>> band = MovingBand(from_hz=20.0, to_hz=80.0, width_hz=4.0, density=0.1, unit="g2/Hz")
    >>> band.at(0.5, "logarithmic").frequency_hz
    (38.0, 42.0)
    """

    from_hz: Positive
    to_hz: Positive
    width_hz: Positive | None = None
    density: Number | None = None
    unit: DensityOrLevelUnit | None = None
    amplitude: Positive | None = None
    on: str | None = None
    axis: Literal["x", "y", "z"] | None = None

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        band = given(self, "width_hz", "density", "unit")
        if (self.amplitude is None) == (band == "none"):
            raise ValueError(
                "needs width_hz, density and unit of a band, or amplitude of a sine, got "
                f"{given(self, 'width_hz', 'density', 'unit', 'amplitude')}"
            )
        if self.amplitude is None and len(band.split(", ")) < 3:
            raise ValueError(f"needs width_hz, density and unit together, got {band}")
        if self.width_hz is not None and self.width_hz >= 2.0 * min(self.from_hz, self.to_hz):
            raise ValueError(
                f"must have width_hz below twice its lowest frequency, got {self.width_hz:g}"
            )
        return self

    def frequency(self, share: float, spacing: Literal["logarithmic", "linear"]) -> float:
        """Frequency after a share of the phase, Hz."""
        if spacing == "linear":
            return self.from_hz + share * (self.to_hz - self.from_hz)
        return float(self.from_hz * (self.to_hz / self.from_hz) ** share)

    def hertz_per_second(self, share: float, spacing: Literal["logarithmic", "linear"]) -> float:
        """How fast the frequency moves after a share of a phase of one second, Hz/s."""
        if spacing == "linear":
            return abs(self.to_hz - self.from_hz)
        return self.frequency(share, spacing) * abs(math.log(self.to_hz / self.from_hz))

    def at(self, share: float, spacing: Literal["logarithmic", "linear"]) -> TabulatedNoise | Sine:
        """The band or sine where it stands after a share of the phase."""
        middle = self.frequency(share, spacing)
        if self.amplitude is not None:
            return Sine(amplitude=self.amplitude, frequency_hz=middle, on=self.on, axis=self.axis)
        assert self.width_hz is not None and self.density is not None
        ends = middle - 0.5 * self.width_hz, middle + 0.5 * self.width_hz
        return TabulatedNoise(
            frequency_hz=ends, density=(self.density, self.density), unit=self.unit, on=self.on,
            axis=self.axis,
        )  # fmt: skip

    def steps(self) -> int:
        """Least number of steps at which a band covers its way evenly, each a quarter of a width
        from the next; for a sine steps of a hundredth of its frequency."""
        if self.width_hz is not None:
            return math.ceil(4.0 * abs(self.to_hz - self.from_hz) / self.width_hz)
        return math.ceil(abs(math.log(self.to_hz / self.from_hz)) / SINE_STEP)


SINE_STEP = 0.01
"""Change of the logarithm of the frequency of a sine from step to step: a twentieth of the
half-power bandwidth of a mount with a damping ratio of 0.1."""
