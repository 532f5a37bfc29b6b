"""The risk of a production, and the clearance that keeps it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from stochvi.isolators.production_risk.spreads import Spread, in_words
from stochvi.isolators.sizing.answer import (
    Clearance,
    RoundedClearance,
    places_in_words,
    spoken_mission,
    spoken_percent,
)
from stochvi.isolators.sizing.changes import Tolerances
from stochvi.mathematics.shown_units import LENGTH
from stochvi.results.base import Result
from stochvi.results.estimates import Estimate
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Production(Result):
    """The probability of any impact over a production, and what its tolerances cost.

    Parameters
    ----------
    scene
        The scene about which the units vary, as it was given.
    spreads
        The distribution of each quantity over the units.
    mission
        Seconds of exposure of each unit.
    target
        Probability of any impact in the mission that the production must keep; None for a question
        about the stops of the scene.
    clearances
        By pair, the clearance that keeps the target, m per side from the mean gap as stated, with
        its 95 % interval. The stops of the scene where there is no target.
    stated
        By pair, the clearance that keeps the target for every unit exactly as stated, m.
    probability
        Mean over the units of the probability of any impact in a mission, at these clearances.
    interval
        Its 95 % interval.
    probability_as_stated
        The same for a unit exactly as stated, at the same clearances.
    share_above
        Share of the units whose own probability is above the target; None without a target.
    correction
        Mean probability by simulated first crossings over that by linear theory, by which the
        latter was multiplied.
    units
        Quantiles over the units: `share_of_units`, and the `probability` of an impact that this
        share does not exceed. `clearance` is where such units would have the target themselves (m,
        the largest of the sized pairs).
    tolerances
        One row per spread quantity, `tolerance` in words. Where it is as its mean, the production
        needs less by `clearance_cost` for the same mean risk (m, the largest of the sized pairs).
        `first_order` and `total` are its shares of the variance of the clearance that a unit needs,
        with their standard errors `first_order_error` and `total_error`.
    simulated
        One row per unit that was simulated: its amounts, its probability by linear theory
        (`linear`), and by first crossings (`probability`, `standard_error`).
    allowed
        Tolerances that are no distribution; the units vary about the worst place within them.
    method
        How the numbers were found, in words.

    See Also
    --------
    stochvi.isolators.production : The calculation.
    """

    not_in_document = ("scene",)  # it is in the provenance

    scene: Scene
    spreads: Mapping[str, Spread]
    mission: float
    target: float | None
    clearances: Mapping[str, Clearance]
    stated: Mapping[str, float]
    probability: Estimate
    interval: tuple[float, float]
    probability_as_stated: float
    share_above: Estimate | None
    correction: Estimate
    units: pd.DataFrame
    tolerances: pd.DataFrame
    simulated: pd.DataFrame
    method: str
    allowed: Tolerances = field(default_factory=Tolerances)

    @property
    def made(self) -> dict[str, RoundedClearance]:
        """The clearance to make of each pair: the calculated one, rounded up."""
        return {name: RoundedClearance.of(each.value) for name, each in self.clearances.items()}

    def summary(self) -> str:
        """The clearance to make, or the risk of the production, in one sentence."""
        mission = spoken_mission(self.mission)
        over = f"over the production ({in_words(self.spreads)}"
        over += f"; {self.allowed.in_words()})" if self.allowed != Tolerances() else ")"
        if self.target is None:
            low, high = map(spoken_percent, self.interval)
            return (
                f"probability of any impact in {mission} {over}: "
                f"{spoken_percent(self.probability.value)} ({low} to {high}, 95 %)"
            )
        if len(self.made) == 1:
            shown, keep = f"clearance: {next(iter(self.made.values()))}", "keeps"
        else:
            shown, keep = f"clearances: {places_in_words(self.made)}", "keep"
        return (
            f"{shown} per side from the static equilibrium {keep} the probability of any impact in "
            f"{mission} at or below {spoken_percent(self.target)} {over}"
        )

    def dearest(self) -> str:
        """The tolerance that costs the most clearance, in a sentence; empty where none costs any:
        there are none, or nearly every unit is hit."""
        if not len(self.tolerances) or not self.tolerances["clearance_cost"].max() > 0.0:
            return ""
        row = self.tolerances.iloc[int(self.tolerances["clearance_cost"].argmax())]
        return (
            f"{row['tolerance']} costs the most clearance: "
            f"{LENGTH.text(row['clearance_cost'], '.3g')}, and {100.0 * row['total']:.3g} % of the "
            "variance between units"
        )

    def to_frame(self) -> pd.DataFrame:
        """The tolerances, and the clearance that each costs."""
        return self.tolerances

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        return {"method": "production", "summary": self.summary(), "made": self.made,
                "by": found.pop("method"), **found}  # fmt: skip
