"""The answer of `spectrum`: curves with their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.results.base import Result
from stochvi.results.column_units import in_chosen_units
from stochvi.results.quantity_units import in_angles

if TYPE_CHECKING:
    import pandas as pd


UNITS = {
    "displacement": "m^2/Hz",
    "velocity": "(m/s)^2/Hz",
    "acceleration": "(m/s^2)^2/Hz",
    "excitation": "(m/s^2)^2/Hz",
    "transmissibility_h1": "1",
    "transmissibility_ratio": "1",
    "coherence": "1",
}
"""Units of the quantities of a spectrum."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A quantity at every frequency: value, standard error, bias, and its 95 % band.

    The band is that of Student's t for the logarithm, widened by the bias. Quantities that refer to
    the excitation are given at the frequencies of its density.
    """

    frequency_hz: Vector
    value: Vector
    standard_error: Vector
    bias: Vector
    lower: Vector
    upper: Vector

    def holds(self, truth: Vector) -> NDArray[np.bool_]:
        """Whether each value of `truth` lies within the band."""
        return np.asarray((self.lower <= truth) & (truth <= self.upper))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ResponseSpectrum(Result):
    """Spectra of a scene with their errors.

    Parameters
    ----------
    frequency_hz
        (F,) bins, from the lowest that is resolved; a curve may have fewer.
    curves
        By owner (a coordinate, the gap of a pair of two coordinates) and quantity (`UNITS`).
    method, segment, step
        "welch" or "multitaper"; seconds of a segment and of a sampling interval.
    bandwidth
        Narrowest half-power bandwidth expected, Hz, by which the segment was chosen.
    degrees_of_freedom
        Degrees of freedom of a chi-square distribution with the scatter of the paths; median over
        the bins of the first displacement.
    meanings
        The meaning of each quantity in this scene, in words, or why it is left out.

    See Also
    --------
    stochvi.spectrum : The calculation.
    """

    not_in_document = ("frequency_hz",)  # it is in every curve

    frequency_hz: Vector
    curves: Mapping[str, Mapping[str, Curve]]
    method: str
    segment: float
    step: float
    bandwidth: float
    degrees_of_freedom: float
    meanings: Mapping[str, str]
    assumptions: Sequence[str] = ()

    @property
    def relative_error(self) -> float:
        """Median relative standard error of the displacement spectra."""
        return max(
            float(np.median(curves["displacement"].standard_error / curves["displacement"].value))
            for curves in self.curves.values()
        )

    def to_frame(self) -> pd.DataFrame:
        """A tidy table: one row per owner, quantity and frequency."""
        import pandas as pd

        return pd.concat(
            [
                pd.DataFrame(
                    {
                        "of": owner,
                        "quantity": name,
                        "frequency_hz": curve.frequency_hz,
                        "value": curve.value,
                        "standard_error": curve.standard_error,
                        "bias": curve.bias,
                        "lower": curve.lower,
                        "upper": curve.upper,
                        "unit": in_angles(owner, UNITS[name]),
                    }
                )
                for owner, curves in self.curves.items()
                for name, curve in curves.items()
            ],
            ignore_index=True,
        )

    def peaks(self) -> pd.DataFrame:
        """A short table for reading: the largest value of each density, with its frequency and
        band, in the units that are shown."""
        import pandas as pd

        rows = []
        for owner, curves in self.curves.items():
            for name, curve in curves.items():
                k = int(np.argmax(curve.value))
                rows.append(
                    {
                        "of": owner,
                        "quantity": name.replace("_", " "),
                        "frequency (Hz)": curve.frequency_hz[k],
                        "value": curve.value[k],
                        "95 % from": curve.lower[k],
                        "to": curve.upper[k],
                        "unit": in_angles(owner, UNITS[name]),
                    }
                )
        return in_chosen_units(pd.DataFrame(rows))

    def _shown(self) -> pd.DataFrame:
        return self.peaks()

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        spectra = {
            owner: {
                name: {"unit": in_angles(owner, UNITS[name]), **vars(curve)}
                for name, curve in curves.items()
            }
            for owner, curves in found.pop("curves").items()
        }
        return found | {"method": f"spectrum:{self.method}", "spectra": spectra}

    def summary(self) -> str:
        """How the spectra were estimated, in a sentence."""
        shown = next(iter(self.curves.values()))["displacement"]
        peak, last = (float((shown.bias / shown.value)[k]) for k in (np.argmax(shown.value), -1))
        return (
            f"{self.method}, segments of {self.segment:.4g} s ({self.segment * self.bandwidth:.3g} "
            f"half-power bandwidths of {self.bandwidth:.3g} Hz), {self.cost.paths} paths: standard "
            f"error {100.0 * self.relative_error:.2g} %, bias {100.0 * peak:.2g} % at the "
            f"peak, {100.0 * last:.2g} % at the highest frequency"
        )
