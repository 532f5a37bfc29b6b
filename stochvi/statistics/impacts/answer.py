"""The answer of the statistics of impacts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.results.base import Result
from stochvi.results.column_units import in_chosen_units
from stochvi.results.estimates import Estimate, format_with_error
from stochvi.statistics.impacts.tallies import Histogram, Rate

if TYPE_CHECKING:
    import pandas as pd


NOTABLE = 0.05
"""Difference of a variance over mean of counts from 1, that of Poisson's process, from which words
name it: rare impacts have one just below 1 in any windows."""


@dataclass(frozen=True, kw_only=True)
class Exponent:
    """Exponent 1 - beta of the density of impact speeds near 0, w^(1 - beta).

    Parameters
    ----------
    fitted
        From the slow impacts that were counted.
    theory
        beta solves R^(beta - 2) = 2 sin((1 + 2 beta) pi / 6), R the restitution; None where that
        does not hold: compliant stops, noise that is not white, several coordinates.

    See Also
    --------
    stochvi.statistics.PairStatistics : The statistics that hold it.
    """

    fitted: Estimate
    theory: float | None


@dataclass(frozen=True, kw_only=True, eq=False)
class PairStatistics:
    """Impacts of one pair; numbers are None where nothing was hit.

    Parameters
    ----------
    speed_threshold
        The slowest impact that is counted, m/s.
    rates
        Rates of impacts on the "lower" and the "upper" stop, as far as the pair has them, and on
        "both".
    dispersion
        Variance over mean of counts in windows: 1 for Poisson's process, more for clusters.
    speeds, intervals
        Densities of impact speeds (s/m) and of times between impacts on either stop (1/s).
    speed_rms
        Root mean square impact speed, m/s. Its bias, and that of energies and rates, is that of the
        step, from some paths at twice the step; None where that does not tell it.
    exponents
        Exponents by side, or under "both" where both stops have the same restitution.
    energy, striking_energy
        Mean loss per impact, and mean m w^2 / 2 with which the reduced mass m arrives, in
        `energy_unit`: J, or J/kg where the scene gives no mass. A hammer strikes blows of it.
    rice_rates, clump_rate, first_hit_rate
        Rates without stops, 1/s: Rice's of crossings of each stop and of both; that of clumps of
        crossings (Vanmarcke); that of first impacts, from simulated first crossings, if they were
        asked for.

    See Also
    --------
    stochvi.impacts : The calculation.
    """

    speed_threshold: float
    rates: Mapping[str, Rate]
    dispersion: Estimate | None
    speeds: Histogram | None
    intervals: Histogram | None
    speed_rms: Estimate | None
    exponents: Mapping[str, Exponent]
    energy: Estimate | None
    striking_energy: Estimate | None
    rice_rates: Mapping[str, float] | None
    clump_rate: float | None
    first_hit_rate: Estimate | None
    energy_unit: str = "J"

    def rayleigh(self, speed: ArrayLike) -> Vector:
        """Rayleigh's density with the mean square seen, s/m: that of elastic stops."""
        if self.speed_rms is None:
            raise ValueError("no impact was seen: no distribution of speeds can be fitted")
        square = self.speed_rms.value**2 / 2.0
        w = np.asarray(speed, dtype=float)
        return np.asarray(w / square * np.exp(-(w**2) / (2.0 * square)))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ImpactStatistics(Result):
    """Statistics of the impacts of every impact pair of a scene.

    `step` (s) is that of the motion, within which impacts are found. `duration` (s) is that of a
    path. `window` (s) is the time in which impacts are counted for the dispersion. `each` is always
    True: impacts are seen one by one, however close they are.

    See Also
    --------
    stochvi.impacts : The calculation.
    """

    pairs: Mapping[str, PairStatistics]
    duration: float
    window: float
    step: float
    each: bool = True
    assumptions: Sequence[str] = ()

    def to_frame(self) -> pd.DataFrame:
        """A tidy table of all numbers: one row per pair and quantity."""
        import pandas as pd

        columns = [
            "of",
            "quantity",
            "value",
            "standard_error",
            "bias",
            "lower",
            "upper",
            "by",
            "unit",
        ]
        rows = [row for name, pair in self.pairs.items() for row in _rows(name, pair)]
        return pd.DataFrame(rows).reindex(columns=columns)

    def to_table(self) -> pd.DataFrame:
        """The same table for reading, in the units that are shown: numbers with their errors in
        words."""
        import pandas as pd

        table = in_chosen_units(self.to_frame())

        def spoken(row: Any) -> dict[str, str]:
            given = not math.isnan(row["lower"])
            return {
                "of": row["of"],
                "quantity": row["quantity"],
                "value": format_with_error(row["value"], row["standard_error"])
                if row["standard_error"]
                else f"{row['value']:.4g}",
                "95 % interval": f"{row['lower']:.4g} to {row['upper']:.4g}" if given else "",
                "by": row["by"] if given else "",
                "unit": row["unit"],
            }

        return pd.DataFrame([spoken(row) for _, row in table.iterrows()])

    def histograms(self) -> pd.DataFrame:
        """One row per pair, histogram ("speed" in m/s, "interval" in s) and bin."""
        import pandas as pd

        parts = [
            pd.DataFrame(
                {
                    "of": name,
                    "histogram": kind,
                    "low": found.edges[:-1],
                    "high": found.edges[1:],
                    "density": found.density,
                    "standard_error": found.standard_error,
                }
            )
            for name, pair in self.pairs.items()
            for kind, found in (("speed", pair.speeds), ("interval", pair.intervals))
            if found is not None
        ]
        return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()

    def _shown(self) -> pd.DataFrame:
        return self.to_table()

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        return {"method": "impacts", "impact_pairs": found.pop("pairs"), **found}

    def summary(self) -> str:
        """How clustered the impacts are, in a sentence for each pair."""
        found = []
        for name, pair in self.pairs.items():
            spread = pair.dispersion
            if spread is None:
                seen = pair.speeds is not None
                few = "too few impacts were seen to judge whether they cluster"
                found.append(f"{name}: {few if seen else 'no impact was seen'}")
                continue
            low, high = (spread.value + side * 2.0 * spread.standard_error for side in (-1, 1))
            kind = "as scattered as Poisson's process"
            if low > 1.0 and spread.value > 1.0 + NOTABLE:
                kind = "in clusters: Poisson intervals would be too narrow by a factor of "
                kind += f"{math.sqrt(spread.value):.2g}"
            elif high < 1.0 and spread.value < 1.0 - NOTABLE:
                kind = "more regular than Poisson's process"
            found.append(
                f"{name}: impacts come {kind} (variance / mean of counts {spread.value:.3g} in "
                f"windows of {self.window:.3g} s)"
            )
        return "; ".join(found)


def _rows(name: str, pair: PairStatistics) -> list[dict[str, Any]]:
    """Rows of `to_frame` for one pair."""
    rows: list[dict[str, Any]] = []

    def add(quantity: str, unit: str, estimate: Estimate | None, **more: Any) -> None:
        if estimate is not None:
            found: dict[str, Any] = {
                name: getattr(estimate, name) for name in ("value", "standard_error", "bias")
            }
            rows.append({"of": name, "quantity": quantity, "unit": unit, **found, **more})

    for side, each in pair.rates.items():
        bounds = {"lower": each.lower, "upper": each.upper}
        add(f"rate, {side}", "1/s", each.estimate, by=each.interval, **bounds)
        if pair.rice_rates is not None:
            add(f"Rice without stops, {side}", "1/s", Estimate(value=pair.rice_rates[side]))
    if pair.clump_rate is not None:
        add("clumps without stops (Vanmarcke)", "1/s", Estimate(value=pair.clump_rate))
    add("first impacts without stops", "1/s", pair.first_hit_rate)
    add("variance / mean of counts", "1", pair.dispersion)
    add("rms impact speed", "m/s", pair.speed_rms)
    add("energy lost per impact", pair.energy_unit, pair.energy)
    add("striking energy, m w^2 / 2", pair.energy_unit, pair.striking_energy)
    for side, exponent in pair.exponents.items():
        add(f"exponent of slow impacts, {side}", "1", exponent.fitted)
        if exponent.theory is not None:
            add(f"1 - beta by theory, {side}", "1", Estimate(value=exponent.theory))
    return rows
