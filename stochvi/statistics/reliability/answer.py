"""The answer on a mission: probabilities with their intervals, how they were found, and the CPU
time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from stochvi.results.base import Result, plain
from stochvi.results.estimates import Estimate

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True)
class Chance:
    """The probability of one event in a mission.

    Parameters
    ----------
    event
        "hit", "passage", "impact_speed" or "peak_acceleration".
    limit
        Value above which an impact speed (m/s) or an acceleration (m/s^2) is the event; None for
        the other events.
    estimate
        P of the event in one mission.
    lower, upper, rule
        Confidence interval at `confidence`, statistical errors alone, and how it was made.
    wilson
        Wilson's interval, where missions were counted; else None.
    way, why
        The way in which it was found, and the reason for that way.
    trials
        Number of missions, or of repetitions of a splitting in `levels` levels.
    seconds
        CPU seconds of the answer, its pilot and its coarser steps included.
    seconds_per_mission
        CPU seconds of one crude mission, measured; None where none was simulated.
    crude_seconds
        CPU seconds that crude simulation would take for the same standard error.

    See Also
    --------
    stochvi.reliability : The answer that holds it.
    """

    event: str
    limit: float | None
    estimate: Estimate
    lower: float
    upper: float
    confidence: float
    rule: str
    way: str
    why: str
    wilson: tuple[float, float] | None = None
    trials: int = 0
    levels: int = 0
    steps: int = 0
    seconds: float = 0.0
    seconds_per_mission: float | None = None

    @property
    def crude_seconds(self) -> float | None:
        """CPU seconds per mission times (1 - P) / (P e^2), e the relative standard error."""
        p, error = self.estimate.value, self.estimate.standard_error
        if self.seconds_per_mission is None or not (p > 0.0 and error > 0.0):
            return None
        return self.seconds_per_mission * p * (1.0 - p) / error**2

    def to_dict(self) -> dict[str, Any]:
        """The JSON document: only plain types."""
        known = {each.name: plain(getattr(self, each.name)) for each in fields(self)}
        return known | {"crude_seconds": self.crude_seconds}


@dataclass(frozen=True, kw_only=True)
class PairRisk:
    """The risk of one of several pairs in a mission.

    Parameters
    ----------
    probability
        Probability that the pair is hit, as if it alone had stops.
    share_of_first_hits
        Share of the first impacts of a mission that falls to the pair. Where two pairs reach their
        stops at the same time, the hit counts for the earlier one in the scene.
    expected_hits, impact_speed_mean
        Impacts on the pair in a mission, with all stops at their places, and their mean speed, m/s;
        None where they are not known.
    """

    probability: Estimate
    share_of_first_hits: float
    expected_hits: Estimate | None = None
    impact_speed_mean: Estimate | None = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Reliability(Result):
    """The risk of a mission: `chances` by event, and `hits`, the expected number of impacts.

    `hits` is None without stops; `hits_interval` is its confidence interval. `missing` says why
    something was not found, or not as accurately as asked for: then the answer comes with a
    `NotConverged`. `pairs` holds, by name, what each of several pairs risks, and `outputs` the
    probability that each coordinate or point alone exceeds the limit of the acceleration. `phases`
    holds, by name, the answer for each phase of the mission, where the scene has phases.

    See Also
    --------
    stochvi.reliability : The calculation.
    """

    mission: float
    start: str
    chances: Mapping[str, Chance]
    hits: Estimate | None
    hits_interval: tuple[float, float] | None
    confidence: float
    assumptions: Sequence[str]
    missing: Mapping[str, str] = field(default_factory=dict)
    pairs: Mapping[str, PairRisk] = field(default_factory=dict)
    outputs: Mapping[str, Estimate] = field(default_factory=dict)
    phases: Mapping[str, Reliability] = field(default_factory=dict)
    method: str = "reliability"

    @property
    def no_hit(self) -> Estimate | None:
        """P(no impact in a mission); None where no impact was asked after."""
        chance = self.chances.get("hit") or self.chances.get("passage")
        if chance is None:
            return None
        found = chance.estimate
        return Estimate(
            value=1.0 - found.value,
            standard_error=found.standard_error,
            bias=found.bias,
            how=found.how,
        )

    def to_frame(self) -> pd.DataFrame:
        """A row per probability."""
        import pandas as pd

        return pd.DataFrame(
            [
                {
                    "event": chance.event,
                    "limit": chance.limit,
                    "probability": chance.estimate.value,
                    "standard_error": chance.estimate.standard_error,
                    "bias": chance.estimate.bias,
                    "lower": chance.lower,
                    "upper": chance.upper,
                    "way": chance.way,
                    "trials": chance.trials,
                    "seconds": chance.seconds,
                    "crude_seconds": chance.crude_seconds,
                }
                for chance in self.chances.values()
            ]
        )

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        for name in ("pairs", "outputs", "phases"):
            if not found[name]:
                del found[name]
        expected = {
            "expected_hits": found.pop("hits"),
            "expected_hits_interval": found.pop("hits_interval"),
        }
        return {"no_hit": self.no_hit, **expected, **found}

    def __repr__(self) -> str:
        percent = f"{100.0 * self.confidence:g} %"
        found = {*self.chances} | (set() if self.hits is None else {"expected_hits"})
        lines = [
            f"  P({name}) at most {chance.upper:.4g} in {self.mission:g} s ({percent}) "
            f"[{chance.way}]"
            if chance.estimate.value == 0.0
            else f"  P({name}) = {chance.estimate.value:.4g} in {self.mission:g} s, "
            f"{percent}: {chance.lower:.4g} to {chance.upper:.4g} [{chance.way}]"
            for name, chance in self.chances.items()
        ]
        if self.hits is not None:
            lines.append(f"  expected impacts = {self.hits!r}")
        lines += [
            f"  {name} alone: {risk.probability.value:.4g}, "
            f"{100.0 * risk.share_of_first_hits:.3g} % of first impacts"
            for name, risk in self.pairs.items()
        ]
        lines += [
            f"  {name}: {'not accurate' if name in found else 'not found'}: {why}"
            for name, why in self.missing.items()
        ]
        return "\n".join([f"<{self.method}", *lines]) + ">"
