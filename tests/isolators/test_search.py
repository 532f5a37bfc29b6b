"""The search for a place that keeps a target, where rates are known at some places alone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from stochvi.isolators.sizing.job import Reached, SizingJob
from stochvi.results.errors import NotConverged
from stochvi.results.estimates import Estimate

WANTED = 1.0


class Job(SizingJob):
    """A search over a rate that is 20 at places up to 1, unknown up to 2 and small beyond."""

    ends = (0.1, 10.0)
    exceedance_rate = keeping = check_free_motion = answer = scene_at = first_rate = None  # type: ignore[assignment]

    def __init__(self, unknown: float) -> None:
        self.unknown = unknown
        self.target = SimpleNamespace(exceedance=0.01, name="peak_acceleration", value=WANTED)
        self.rel_error, self.tried = 0.1, list[float]()
        self.late = self.deadline = SimpleNamespace(passed=lambda: False)

    def stage(self, low: float, high: float, words: str) -> None:
        pass

    def words(self, place: float) -> str:
        return f"{place:g}"

    def first_guess(self, wanted: float) -> float:
        return 3.0

    def already_kept(self, place: float, rate: Estimate) -> Reached:
        raise AssertionError("the nearest place is far away")

    def rate(self, place: float, rel_error: float) -> Estimate:
        self.tried.append(place)
        if place > 2.0:
            return Estimate(value=0.0, upper_95=0.01, how="none seen")
        if place > 1.0:
            return Estimate(value=0.0, upper_95=self.unknown, how="none seen")
        return Estimate(value=20.0, standard_error=1.0, bias=0.0, how="seen")


def search(unknown: float) -> tuple[Any, Job]:
    job = Job(unknown)
    with pytest.raises(NotConverged, match="was not found in 24 places") as caught:
        job.search(WANTED)
    return caught.value.partial, job


def test_a_place_where_nothing_could_be_seen_is_not_one_that_keeps_the_target() -> None:
    found, job = search(unknown=30.0)
    # the nearest place whose upper limit keeps the target, and the last one that misses it
    assert found.place == found.upper == min(place for place in job.tried if place > 2.0)
    assert found.lower == max(place for place in job.tried if place <= 1.0)
    # the control: where the limit between keeps the target, it is the answer
    found, job = search(unknown=0.5)
    assert found.place == min(place for place in job.tried if place > 1.0) < 2.0
