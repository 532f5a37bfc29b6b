"""The search for a place that keeps a target, where rates are known at some places alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from stochvi.isolators.sizing.job import SEARCH, Reached, SizingJob, rate_of
from stochvi.results.errors import NotConverged
from stochvi.results.estimates import Estimate
from stochvi.sampling.run import Run
from stochvi.statistics.bursts import chance_of

WANTED = 1.0


class Places:
    """Places for which nothing is calculated."""

    ends, searched, outputs = (0.1, 10.0), (0.0, 1.0), None
    steep = -1.0
    steepness = staticmethod(lambda place: 1.0)
    coordinate = place_at = length = staticmethod(lambda place: place)
    first_guess = staticmethod(lambda wanted: 3.0)
    words = staticmethod(lambda place: f"{place:g}")
    exceedance_rate: Callable[[float, Run], Estimate]

    def slope(self, place: float) -> float:
        return self.steep

    def already_kept(self, place: float, rate: Estimate) -> Reached:
        raise AssertionError("the nearest place is far away")


class Job(SizingJob):
    """A search over a rate that is 20 at places up to `seen`, unknown up to 2 and small beyond."""

    def __init__(self, unknown: float, seen: float = 1.0) -> None:
        self.unknown, self.seen = unknown, seen
        self.method = self.places = Places()  # type: ignore[assignment]
        self.target = SimpleNamespace(exceedance=0.01, name="peak_acceleration", value=WANTED)
        self.exceeded, self.unfinished, self.warnings = {}, {}, []  # type: ignore[assignment]
        self.rel_error, self.tried = 0.1, list[float]()
        self.late = self.deadline = SimpleNamespace(passed=lambda: False)

    def stage(self, low: float, high: float, words: str) -> None:
        pass

    def rate(self, place: float, rel_error: float, unseen: bool = False) -> Estimate:
        self.tried.append(place)
        if place > 2.0:
            return Estimate(value=0.0, upper_95=0.01, how="none seen")
        if place > self.seen:
            return Estimate(value=0.0, upper_95=self.unknown, how="none seen")
        return Estimate(value=20.0, standard_error=1.0, bias=0.0, how="seen")


def test_a_place_where_nothing_could_be_seen_is_not_one_that_keeps_the_target() -> None:
    job = Job(unknown=30.0)
    found = job.search(WANTED)
    # the nearest place whose upper limit keeps the target, and the last one that misses it
    assert found.place == found.upper == min(place for place in job.tried if place > 2.0)
    assert found.place < 2.0 / SEARCH.near_enough
    assert found.lower == max(place for place in job.tried if place <= 1.0)
    assert "may do as well" in job.warnings[0]
    # the control: where the limit between keeps the target, the answer is as near as any was tried
    job = Job(unknown=0.5)
    with pytest.raises(NotConverged, match="was not found in 24 places") as caught:
        job.search(WANTED)
    assert caught.value.partial.place == min(place for place in job.tried if place > 1.0) < 2.0


def test_where_the_nearest_place_is_unknown_a_farther_one_that_keeps_the_target_is_found() -> None:
    job = Job(unknown=30.0, seen=0.0)
    found = job.search(WANTED)
    assert min(job.tried) == job.method.ends[0]
    assert 2.0 < found.place == min(place for place in job.tried if place > 2.0)
    assert found.place < 2.0 / SEARCH.near_enough
    assert found.lower == -math.inf


class ByBoth(Job):
    """A search whose rate is 20 exp(-4 (place - 1)), where counting sees nothing beyond 1."""

    rate = SizingJob.rate
    splits = True
    mission = 0.01

    def __init__(self) -> None:
        super().__init__(unknown=30.0)
        self.target.exceedance = -math.expm1(-WANTED * self.mission)
        self.places.steep = -4.0
        self.places.exceedance_rate = lambda place, run: Job.rate(self, place, run.accuracy)

    def part(self, share: float = 1.0, rel_error: float | None = None) -> Run:
        never = SimpleNamespace(passed=lambda: False, share=lambda share: None)
        run = SimpleNamespace(accuracy=rel_error or self.rel_error, deadline=never)
        run.part = lambda deadline: run
        return run  # type: ignore[return-value]

    def by_splitting(self, place: float, run: Run | None = None) -> Estimate | None:
        rate = 20.0 * math.exp(-4.0 * (place - 1.0))
        known = Estimate(value=rate, standard_error=0.05 * rate, bias=0.0)
        return chance_of(known, self.mission) if self.splits else None


def test_splitting_shows_what_counted_clusters_do_not() -> None:
    job = ByBoth()
    found = job.search(WANTED)
    assert found.place == pytest.approx(1.0 + math.log(20.0) / 4.0, rel=0.02)
    assert found.lower < found.place < found.upper
    # the control: without it the nearest place that is shown is farther away
    job = ByBoth()
    job.splits = False
    assert job.search(WANTED).place > 2.0 > found.upper


def test_the_rate_of_a_chance() -> None:
    chance = chance_of(Estimate(value=0.3, standard_error=0.1, bias=0.0), 2.0)
    again = rate_of(chance, 2.0)
    assert (again.value, again.standard_error) == pytest.approx((0.3, 0.1))
    most = rate_of(Estimate(value=0.0, upper_95=0.5, how="none"), 2.0).upper_95
    assert most == pytest.approx(math.log(2.0) / 2.0)
