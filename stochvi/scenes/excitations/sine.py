"""A sine."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Literal, Self

from stochvi.mathematics.units import power_ratio
from stochvi.scenes.excitations.base import BASE, Disturbance
from stochvi.scenes.validation import Positive


class Sine(Disturbance):
    """A sine, amplitude * cos(2 pi frequency_hz t + phase), the phase of each path random.

    Parameters
    ----------
    amplitude
        Peak of the force on a mass, N, or of the acceleration of the base, m/s^2.
    frequency_hz
        Frequency, Hz.

    Examples
    --------
    >>> Sine(on="base", amplitude=9.80665, frequency_hz=50.0).amplitude
    9.80665
    """

    effect_word: ClassVar[str] = "sine"
    family: ClassVar[str] = "sine"

    kind: Literal["sine"] = "sine"
    on: str | None = None
    amplitude: Positive
    frequency_hz: Positive

    def louder(self, level_db: float) -> Self:
        return self.model_copy(
            update={"amplitude": math.sqrt(power_ratio(level_db)) * self.amplitude}
        )

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        unit = "m/s² peak" if where == BASE else "N peak"
        strength = f"{self.amplitude:.4g} {unit}"
        return [(f"Sine on {where}", strength, f"at {self.frequency_hz:g} Hz")]
