"""White noise."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from stochvi.scenes.excitations.base import Density, StrengthNoise


class WhiteNoise(StrengthNoise):
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

    def density_for(self, omega: float, damping_rate: float) -> Density:
        return lambda frequency_hz: np.full(np.shape(frequency_hz), 2.0 * self.si_intensity)
