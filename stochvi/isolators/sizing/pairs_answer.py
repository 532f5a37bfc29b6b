"""The clearances that several pairs need, with a stated risk that any of them is hit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.isolators.sizing.answer import (
    SIDES,
    Clearance,
    GaussianSizing,
    RoundedClearance,
    places_in_words,
    spoken_mission,
    spoken_percent,
)
from stochvi.isolators.sizing.box_overview import BoxOverview
from stochvi.mathematics.arrays import Matrix
from stochvi.mathematics.shown_units import LENGTH
from stochvi.model.model import model_of
from stochvi.results.estimates import Estimate

if TYPE_CHECKING:
    import pandas as pd


NEARLY_CERTAIN = 0.999
"""Largest probability of any impact from which the number of first impacts is read."""


@dataclass(frozen=True, kw_only=True)
class Probability:
    """A probability and the 95 % interval of its calculation."""

    value: float
    lower: float
    upper: float

    @classmethod
    def of(cls, estimate: Estimate) -> Probability:
        """A probability with its statistical error and its stated bias."""
        half = estimate.half_width_95()
        value = estimate.value
        return cls(value=value, lower=max(value - half, 0.0), upper=min(value + half, 1.0))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PairsSizing(GaussianSizing):
    """Clearances that keep the probability of an impact of any pair, and the evidence for them.

    Parameters
    ----------
    scene
        The scene that was sized, as it was given.
    target, mission
        The target of the sizing, and seconds of exposure.
    pair
        The one pair that was sized, the stops of the others fixed as in the scene; None where all
        pairs share the risk equally.
    common
        Pairs that were given one clearance in common: the largest that any of them needs.
    clearances
        By pair, m per side from the mean gap, each with the 95 % interval of the calculation; of
        the sized pair alone where there is one.
    probability
        Probability that any pair is hit in the mission at these clearances.
    expected_hits
        Impacts on all pairs in the mission there, simulated with all stops; None where unknown.
    pairs
        One row per pair: `pair`; `sigma` (rms of the gap without stops, m); `lower` and `upper`
        (distances of its stops from the mean gap in the answer, m); `clearance_in_sigma` (of the
        nearer one); `probability_alone` (of an impact if this pair alone had stops);
        `share_of_first_hits`; and the `expected_hits` on it in the mission with their
        `impact_speed_mean` (m/s; NaN where unknown).
    curve
        One row per risk: `probability_alone` of each sized pair; the clearance of each sized pair
        under its name (m); `probability` with `probability_low` and `probability_high` of an impact
        of any pair; and `independent`, the same if impacts of the pairs were independent.
    three_sigma
        Probability of any impact where every stop is at three times the rms of its gap.
    as_given
        Probability of any impact between the stops of the scene; None where a mean gap lies beyond
        a stop.
    required
        One row per accepted probability of any impact (10, 1, 0.1 %): `probability`, and the
        clearance of each sized pair under its name, m (NaN where none keeps it).
    tolerances
        One row per end of the tolerances and, last, the largest of each column over their whole
        region, each for itself, by linear theory. Columns: `change`; under its name the clearance
        of each sized pair for the same risk (m, from the nominal mean gap); `factor`, the largest
        of them over the nominal one; and `probability` of any impact at the nominal clearances.
        Without tolerances the first row, "as stated", is the only one.
    screening
        Linear screening.
    method
        How the clearances were found, in words.
    record
        Whether measured records move the gaps as Gaussian noise would, and the clearances that they
        need; None without a record.
    box
        Modes of a rigid body, and the clearances of one oscillator along each axis; None for any
        other structure.
    allowed
        The tolerances that were asked for, within all of which the clearances of `made` keep the
        risk.
    production
        The risk of the production whose units differ, and the clearances that it needs, which
        `made` then has; None without distributions of tolerances.
    worst_at
        By sized pair, where within the tolerances its clearance is largest, in words.
    fell_short
        Those of the warnings that name an accuracy for which the budget did not suffice.

    See Also
    --------
    stochvi.size : The calculation.
    """

    pair: str | None
    clearances: Mapping[str, Clearance]
    probability: Probability
    expected_hits: Estimate | None
    pairs: pd.DataFrame
    three_sigma: Probability
    as_given: Probability | None
    tolerances: pd.DataFrame
    box: BoxOverview | None = None
    common: tuple[str, ...] = ()
    worst_at: Mapping[str, str] = field(default_factory=dict)

    @property
    def named(self) -> Mapping[str, Clearance]:
        """The calculated clearances by the names of their pairs."""
        return self.clearances

    @property
    def sized_pairs(self) -> list[int]:
        """Numbers of the sized pairs."""
        names = self.pairs["pair"].tolist()
        return [names.index(name) for name in self.clearances]

    @property
    def stops(self) -> Matrix:
        """(2, pairs): distances of the stops from the mean gaps, m."""
        return np.asarray(self.pairs[[*SIDES]].fillna(math.inf).to_numpy().T)

    @property
    def any_hit(self) -> float:
        """Probability that any pair is hit in the mission at the calculated clearances."""
        return self.probability.value

    def extremes(self) -> tuple[str, str]:
        """Names of the pairs with the smallest and with the largest clearance."""
        values = {name: each.value for name, each in self.clearances.items()}
        return min(values, key=lambda name: values[name]), max(values, key=lambda n: values[n])

    def worst(self) -> tuple[str, float, float] | None:
        """The pair whose clearance the tolerances raise most, what it then needs (m), and the
        factor; None without tolerances."""
        if len(self.tolerances) < 2:
            return None
        row = self.tolerances.iloc[-1]
        factors = {name: float(row[name]) / c.value for name, c in self.clearances.items()}
        name = max(factors, key=lambda each: factors[each])
        return name, float(row[name]), factors[name]

    def made(self) -> dict[str, RoundedClearance]:
        """The clearance to make of each sized pair: the calculated one or, where tolerances were
        asked for, the largest within them, rounded up; for a production the one that its mean risk
        needs."""
        if self.production is not None:
            return self.production.made
        needed = {name: each.value for name, each in self.clearances.items()}
        if len(self.tolerances) > 1:
            needed = {name: float(self.tolerances[name].iloc[-1]) for name in needed}
        return {name: RoundedClearance.of(value) for name, value in needed.items()}

    def placed(self) -> pd.DataFrame:
        """Where the stops of the sized pairs go: one row per pair.

        `pair`, its `mean_gap` in the static equilibrium, the `clearance` to make from there, and
        `lower` and `upper` as a scene file has them, from the unloaded mounts; all in m, NaN where
        the scene has no stop.
        """
        import pandas as pd

        model = model_of(self.scene)
        means = model.mean_gaps
        rows, known = [], self.made()
        for pair, mean in zip(self.scene.impact_pairs, means.tolist(), strict=True):
            if pair.name in known:
                made = known[pair.name]
                lower = math.nan if pair.lower is None else made.position(mean, "lower")
                upper = math.nan if pair.upper is None else made.position(mean, "upper")
                rows.append([pair.name, mean, made.value, lower, upper])
        return pd.DataFrame(rows, columns=["pair", "mean_gap", "clearance", "lower", "upper"])

    def _to_make(self) -> str:
        """The clearances to make and the risk that they keep, in words; for many pairs the smallest
        and the largest clearance."""
        if self.production is not None:
            return self.production.summary()
        mm = self._places()
        fixed = "" if self.pair is None else ", with the other stops as they are,"
        return (
            f"clearances: {mm} per side from the static equilibrium{fixed} keep "
            f"{self.target.kept(self.mission)}{self.within}"
        )

    def _places(self) -> str:
        """The clearances to make; one number where all sized pairs have it in common."""
        made = self.made()
        in_common = (
            set(made) == set(self.common) and len({str(each) for each in made.values()}) == 1
        )
        if in_common and len(made) > 1:
            return f"{next(iter(made.values()))} for all {len(made)} pairs in common,"
        return places_in_words(made)

    def calculated(self) -> str:
        """Evidence for the clearances to make: those calculated for the scene as stated, the
        impacts to expect there, and what three sigma would do."""
        mission = spoken_mission(self.mission)
        low, high = (self.clearances[name] for name in self.extremes())
        stated = " as stated" if self.varies else ""
        text = f"calculated{stated}: {LENGTH.text(low.value)}"
        text += f" to {LENGTH.text(high.value)}" if high.value > low.value else ""
        if self.expected_hits is not None and self.target.name != "rate":
            text += f", where {self.expected_in_words()} impacts are expected in {mission}"
        return (
            f"{text}; at 3 sigma of every gap any is hit in {mission} with a probability of "
            f"{spoken_percent(self.three_sigma.value)}"
        )

    def expected_in_words(self) -> str:
        """The number of expected impacts; where too few were seen, the limits that are known: each
        first impact is one."""
        found = self.expected_hits
        if found is None:
            return "an unknown number of"
        if found.upper_95 is None:
            return f"{found.value:.3g}"
        # the number of first impacts, which those that follow add to
        first = -math.log1p(-min(self.probability.value, NEARLY_CERTAIN))
        return f"{first:.2g} to {found.upper_95:.2g}"

    def _shown(self) -> pd.DataFrame:
        return self.pairs

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        by = found.pop("method")
        first = {"method": "size", "verdict": self.verdict(), "made": self.made(), "by": by}
        return {**first, **found}
