"""The card of a page on what measured records need."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stochvi.views.report.pages import Fact

if TYPE_CHECKING:
    from stochvi.isolators.record_verdict import RecordVerdict


def record_cards(record: RecordVerdict | None) -> list[Fact]:
    """The clearance that a measured record itself needs, at each gap of a structure; empty without
    a record."""
    if record is None:
        return []
    gaps = {record.gap or "": record, **record.others}
    return [_card(name, each) for name, each in gaps.items()]


def _card(gap: str, record: RecordVerdict) -> Fact:
    judged = (
        "contradicts"
        if record.contradicts
        else "agrees with"
        if record.agrees
        else "is too short to be judged against"
    )
    return Fact(
        f"The record itself needs{gap and f' at {gap}'}",
        record.needed,
        f"it moves {record.peak_in_sigma:.3g} sigma and {judged} Gaussian noise, which would "
        f"move {record.expected_peak_in_sigma:.3g} in its time; response kurtosis "
        f"{record.kurtosis:.3g}, 3 ± {record.kurtosis_error:.2g} for Gaussian noise",
    )
