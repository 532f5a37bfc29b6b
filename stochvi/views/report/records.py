"""The cards of a page on what measured records need."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from stochvi.isolators.sizing.answer import MOST_NAMED
from stochvi.views.report.pages import Fact

if TYPE_CHECKING:
    from stochvi.isolators.record_verdict import RecordVerdict


def record_cards(
    record: RecordVerdict | None, phases: Mapping[str, RecordVerdict] | None = None
) -> list[Fact]:
    """The clearance that a measured record itself needs, at each gap of a structure and in each of
    the `phases`; where these are many, the largest. Empty without a record."""
    if record is None:
        return []
    named = {f" in phase {name}": each for name, each in (phases or {}).items()} or {"": record}
    every = [
        (f"{f' at {gap.gap}' if gap.gap else ''}{phase}", gap)
        for phase, verdict in named.items()
        for gap in verdict.gaps
    ]
    shown = sorted(every, key=lambda each: -each[1].clearance)
    more = ""
    if len(shown) > MOST_NAMED:
        more = f"; the largest of {len(shown)}"
        shown = shown[:1]
    return [_card(where, verdict, more) for where, verdict in shown]


def _card(where: str, record: RecordVerdict, more: str) -> Fact:
    judged = (
        "contradicts"
        if record.contradicts
        else "agrees with"
        if record.agrees
        else "is too short to be judged against"
    )
    sides = record.needed_on_each_side or "per side"
    return Fact(
        f"The record itself needs{where}",
        record.needed,
        f"{sides}, from the static equilibrium; it moves {record.peak_in_sigma:.3g} sigma and "
        f"{judged} Gaussian noise, which would "
        f"move {record.expected_peak_in_sigma:.3g} in its time; response kurtosis "
        f"{record.kurtosis:.3g}, 3 ± {record.kurtosis_error:.2g} for Gaussian noise{more}",
    )
