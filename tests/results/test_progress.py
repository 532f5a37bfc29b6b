"""The time left that progress shows."""

from __future__ import annotations

import math

import pytest

from stochvi.results import progress
from stochvi.results.progress import Pace


def test_the_time_left_is_that_at_the_pace_since_the_first_report(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The time before the first report used to count, in which the fraction did not grow."""
    now = [1000.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    pace = Pace("size")
    now[0] += 30.0
    assert math.isinf(pace.left(0.5))
    now[0] += 2.0
    assert pace.left(0.6) == pytest.approx(8.0)
    assert pace(0.6, "first crossings") == "size: 60 %, first crossings, 8 s left"
