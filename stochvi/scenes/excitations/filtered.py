"""White noise that has passed through a resonance."""

from __future__ import annotations

import math
from functools import cached_property
from typing import ClassVar, Literal

from stochvi.mathematics.spectra import Filter
from stochvi.scenes.excitations.base import Density, StrengthNoise
from stochvi.scenes.excitations.shaped import TransferFunctionNoise
from stochvi.scenes.validation import Positive


class FilteredNoise(StrengthNoise):
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

    @cached_property
    def with_density(self) -> TransferFunctionNoise:
        """The same noise by its density, as a cross density needs it."""
        square = self.omega**2
        keys = self.model_dump(exclude={"kind", "frequency_hz", "zeta"}, exclude_none=True)
        denominator = [1.0, 2.0 * self.zeta * self.omega, square]
        return TransferFunctionNoise(**keys, numerator=[square], denominator=denominator)

    def density_for(self, omega: float, damping_rate: float) -> Density:
        return Filter(self.omega, 2.0 * self.zeta * self.omega, self.si_intensity).__call__

    def _remark(self) -> str:
        return (
            f"{super()._remark()}; both are before the filter, a resonance at "
            f"{self.frequency_hz:.4g} Hz with a damping ratio of {self.zeta:.3g}"
        )
