"""Densities by Monte Carlo, and the picture of a simulation that shows them."""

from __future__ import annotations

import json
import math
import pickle
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.stats import norm

import stochvi
from stochvi import (
    Elastic,
    ForceFunction,
    ImpactPair,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    WhiteNoise,
)
from stochvi.mathematics.arrays import Vector
from stochvi.statistics import densities as module
from stochvi.statistics.densities import BandedDensity, densities, motions_of
from support.accuracies import quick_cases
from support.pairs import pair, uncoupled

ELASTIC = Scene(
    structure=Oscillator(mass=1.0, damping=0.2, stiffness=1.0),
    impact_pairs=[ImpactPair(lower=-1.0, upper=0.6, law=Restitution(coefficient=1.0))],
    excitations=[WhiteNoise(intensity=0.4)],
)
"""Of sigma 1 between elastic stops: the normal distribution, cut off at them, is exact."""


def exact_means(edges: Vector, sigma: float) -> Vector:
    """Means of the exact density over bins."""
    probability = np.diff(norm.cdf(edges, scale=sigma))
    total = norm.cdf(0.6, scale=sigma) - norm.cdf(-1.0, scale=sigma)
    return np.asarray(probability / total / np.diff(edges))


@pytest.mark.slow
@quick_cases("first", [0, 100, 200, 300, 400], keep=(0,))
def test_the_bands_hold_the_exact_density_as_often_as_they_promise(first: int) -> None:
    shares, control = [], []
    for seed in range(first, first + 24):
        found = densities(ELASTIC, {"x": (np.ones(1), -1.0, 0.6)}, seed=seed, threads=1)["x"]
        low, high = found.bands()
        assert len(found.density) == module.BINS
        assert float(found.density @ np.diff(found.edges)) == pytest.approx(1.0)
        for sigma, told in ((1.0, shares), (0.9, control)):
            exact = exact_means(found.edges, sigma)
            told.append(float(np.mean((low <= exact) & (exact <= high))))
    error = float(np.std(shares, ddof=1)) / math.sqrt(len(shares))
    assert abs(float(np.mean(shares)) - 0.95) < 4.5 * error
    assert abs(float(np.mean(control)) - 0.95) > 4.5 * error


def test_bins_that_hardly_any_path_was_in_are_left_out() -> None:
    shares = np.zeros((40, 5))
    shares[:, 1:3] = 0.45
    shares[:10, 3] = 0.1
    shares[0, 4] = 0.1
    found = BandedDensity.of(shares, 0.0, 5.0)
    assert found.edges.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert found.density == pytest.approx([0.45, 0.45, 0.025])
    # ten visits of forty: a binomial error at least
    assert found.standard_error[-1] >= 0.025 * math.sqrt(0.75 / 10.0)
    assert not len(BandedDensity.of(np.zeros((40, 5)), 0.0, 5.0).density)


def test_the_picture_of_a_simulation_shows_its_density_between_the_stops(tmp_path: Path) -> None:
    answer = stochvi.simulate(ELASTIC, paths=256, seed=1, threads=1)
    known = answer.densities()["x"]
    assert known.edges[[0, -1]].tolist() == [-1.0, 0.6]
    ax = answer.plot()
    walls = sorted(line.get_xdata()[0] for line in ax.get_lines() if line.get_linestyle() == "--")
    assert walls == [-1.0, 0.6]
    assert "95 % bands" in ax.get_ylabel() and len(ax.patches) == 2
    again = stochvi.load_answer(stochvi.save_answer(answer, tmp_path / "answer.json"))
    assert again.densities()["x"].density.tolist() == known.density.tolist()
    plt.close("all")


def test_every_gap_of_several_has_its_density_and_other_methods_have_none() -> None:
    scene = uncoupled(pair("left", "x", 1.0), pair("right", "z", 30.0))
    found = stochvi.simulate(scene, paths=64, seed=1, threads=1)
    motions = motions_of(found, stochvi.model.model.model_of(scene))
    assert list(motions) == ["left", "right"]
    assert motions["left"][1:] == (-1.0, 1.0)
    row, low, high = motions["right"]
    assert row.tolist() == [0.0, 1.0] and -30.0 < low < -4.0 < 4.0 < high < 30.0
    assert found.plot().get_legend() is not None
    soft = ELASTIC.replace(impact_pairs=[ImpactPair(upper=0.6, law=Elastic(stiffness=1e3))])
    beyond = motions_of(found := stochvi.exact(soft), stochvi.model.model.model_of(soft))
    assert beyond["x"][2] > 0.6  # a compliant stop lets the mass pass
    assert found.densities() == {}
    plt.close("all")


def test_a_stop_that_is_a_function_has_its_density(tmp_path: Path) -> None:
    """That of the spring which the function is; from a file nobody knows the function."""
    answers = []
    for law in (ForceFunction(force=lambda y, v: 20.0 * y), Elastic(stiffness=20.0)):
        soft = ELASTIC.replace(impact_pairs=[ImpactPair(lower=-1.0, upper=0.6, law=law)])
        answers.append(stochvi.simulate(soft, paths=64, seed=1, threads=1))
    by_function, by_law = (each.densities()["x"] for each in answers)
    error = np.hypot(
        np.interp(by_law.edges[:-1], by_function.edges[:-1], by_function.standard_error),
        by_law.standard_error,
    )
    there = np.interp(by_law.edges[:-1], by_function.edges[:-1], by_function.density)
    assert np.mean(np.abs(by_law.density - there) < 4.0 * error + 1e-6) > 0.95
    assert "made_from" not in json.dumps(answers[0].to_dict())
    read = stochvi.load_answer(stochvi.save_answer(answers[0], tmp_path / "answer.json"))
    with pytest.raises(NotApplicable, match="ask for it again"):
        read.densities()
    assert read.plot() is not None
    assert pickle.loads(pickle.dumps(answers[1])).provenance == answers[1].provenance
    plt.close("all")


def test_nothing_is_simulated_where_nobody_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise AssertionError("a density was simulated")

    monkeypatch.setattr(module, "densities", refused)
    answer = stochvi.simulate(ELASTIC, paths=64, seed=1, threads=1)
    assert "densities" not in answer.to_dict()
    with pytest.raises(AssertionError, match="was simulated"):
        answer.densities()
