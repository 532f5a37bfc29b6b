"""Impacts per second by clusters: what a single path says of a pair."""

from __future__ import annotations

import numpy as np
import pytest

from stochvi.results.estimates import Estimate
from stochvi.statistics import impact_counts
from stochvi.statistics.bursts import Bursts
from support.pairs import pair, uncoupled
from support.runs import run_of


@pytest.mark.parametrize(("seen", "known"), [((0,), False), ((0, 3), True)])
def test_a_speed_that_one_path_shows_has_no_error_and_is_not_given(
    monkeypatch: pytest.MonkeyPatch, seen: tuple[int, ...], known: bool
) -> None:
    hits = np.zeros((2, 8))
    hits[0], hits[1, list(seen)] = 1.0, 1.0
    found = Bursts(
        first_rate=Estimate(value=1e-3, standard_error=1e-5), window=1.0, horizon=1.0,
        pairs=("near", "far"), outputs=("x", "z"), path=np.arange(8), weight=np.ones(8),
        early_hits=hits.sum(axis=0), hits=hits, speeds=0.5 * hits, fastest=0.5 * hits,
        sharpest=np.zeros((2, 8)),
    )  # fmt: skip
    monkeypatch.setattr(impact_counts, "clusters_apart", lambda *_: found)
    scene = uncoupled(pair("near", "x", 3.0), pair("far", "z", 5.0))
    with run_of(rel_error=0.1) as run:
        counts = impact_counts.count_impacts(scene, 0.0, run)
    speed = counts.speeds["far"]
    assert (speed is not None) == known
    assert speed is None or speed.value == pytest.approx(0.5)
    assert counts.speeds["near"] is not None
