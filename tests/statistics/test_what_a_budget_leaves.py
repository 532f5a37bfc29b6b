"""Whatever ends a calculation early: what it states holds as often as it says, or is an upper
limit."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from stochvi import absorber, impacts, lifetimes, reliability, size, spectrum
from stochvi.isolators import clatter, clearance_curve
from stochvi.methods.closed_form import exact
from stochvi.methods.fokker_planck import first_passage
from stochvi.methods.monte_carlo import simulate
from stochvi.methods.monte_carlo.impact_logs import plan_impacts
from stochvi.results.errors import NotConverged
from stochvi.results.estimates import Estimate
from stochvi.results.intervals import GAUSSIAN_95, mean_and_error
from stochvi.scenes.absorbers import Absorber
from stochvi.scenes.excitations import Sine, TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Elastic, Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Isolator, Oscillator
from support.clocks import tick

Ends = tuple[float, float]

ALL = (0.0, math.inf)
"""Where a budget was too short for an answer."""

MISSION = 20.0 * math.pi
"""Mission of the splitting, s."""


def scene(stop: float | None, *, damping: float = 0.1) -> Scene:
    law = Restitution(coefficient=1.0)
    pairs = [] if stop is None else [ImpactPair(clearance=stop, law=law)]
    return Scene(
        structure=Oscillator(mass=1.0, damping=damping, stiffness=1.0),
        impact_pairs=pairs,
        excitations=[WhiteNoise(intensity=2.0 * damping)],
    )


FAR = scene(2.5, damping=0.05)
"""Elastic stops at 2.5 deviations: impacts come in clusters of some ten periods."""


def partial_answer(calculate: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    try:
        return calculate(*arguments, **named)
    except NotConverged as reason:
        return reason.partial


def ends_of(found: Estimate) -> Ends:
    """The 95 % interval of an estimate of a positive number."""
    if found.upper_95 is not None:
        return 0.0, found.upper_95
    reach = math.exp(found.half_width_95() / found.value)
    bias = found.bias or 0.0
    return found.value / reach - bias, found.value * reach + bias


def simulated_rate(seed: int) -> Ends:
    found = simulate(FAR, paths=12, duration=300.0, seed=seed, threads=1)
    return ends_of(found.impact_pairs["stops"]["collision_rate"])


def simulated_deviation(seed: int) -> Ends:
    found = simulate(FAR, paths=3, duration=300.0, seed=seed, threads=1)
    return ends_of(found.coordinates["x"]["velocity_std"])


def counted_impacts(seed: int) -> Ends:
    found = impacts(FAR, paths=12, duration=300.0, seed=seed, threads=1)
    rate = found.pairs["stops"].rates["both"]
    return rate.lower, rate.upper


def sampled_spectrum(seed: int) -> Ends:
    found = spectrum(scene(None), paths=6, seed=seed, threads=1)
    curve = found.curves["x"]["velocity"]
    place = int(np.argmin(np.abs(found.frequency_hz - 1.0 / (2.0 * math.pi))))
    return float(curve.lower[place]), float(curve.upper[place])


OFTEN = scene(2.5, damping=0.2)
"""The same stops, of which a short mission meets some."""


def hits_of_missions(seed: int) -> Ends:
    found = partial_answer(
        reliability, OFTEN, mission=20.0, rel_error=0.002, budget=0.2, seed=seed, threads=1
    )
    return ALL if found is None or found.hits is None else found.hits_interval


def split_chance(seed: int) -> Ends:
    found = partial_answer(
        reliability, scene(None), mission=MISSION, barrier=4.0, start="rest", way="splitting",
        rel_error=0.01, budget=0.15, seed=seed, threads=1,
    )  # fmt: skip
    chance = found and found.chances.get("passage")
    return (chance.lower, chance.upper) if chance else ALL


SOFT = Scene(
    structure=Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0),
    impact_pairs=[ImpactPair(clearance=8e-3, law=Elastic(stiffness=1e5))],
    excitations=[TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")],
)
"""Soft stops of a mount under a table."""


def hits_of_bursts(seed: int) -> Ends:
    found = partial_answer(
        reliability, SOFT, mission=10.0, rel_error=0.01, budget=0.05, seed=seed, threads=1
    )
    return ALL if found is None or found.hits is None else found.hits_interval


def clatter_of_windows(seed: int) -> Ends:
    row = clatter(SOFT, [6e-3], rel_error=0.001, budget=0.02, seed=seed, threads=1).iloc[0]
    reach = GAUSSIAN_95 * row["acceleration_rms_error"]
    return row["acceleration_rms"] - reach, row["acceleration_rms"] + reach


def rate_at_a_clearance(seed: int) -> Ends:
    found = partial_answer(
        clearance_curve, FAR, [2.5], rel_error=0.01, budget=0.02, seed=seed, threads=1
    )
    row = found.iloc[0]
    return row["simulated_low"], row["simulated_high"]


ACCEPTED = 0.01
"""Impacts per second for which a clearance is sized."""


def required_clearance(seed: int) -> Ends:
    found = partial_answer(
        size, FAR, rate=ACCEPTED, rel_error=0.05, budget=0.01, seed=seed, threads=1
    )
    return (found.clearance.lower, found.clearance.upper) if found else ALL


BOXED = Scene(
    structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    absorber=Absorber(mass=0.1, play=3.0, law=Restitution(coefficient=0.5)),
    excitations=[WhiteNoise(intensity=0.2)],
)
"""A loose mass in a box on a mass."""


def vibration_with_an_absorber(seed: int) -> Ends:
    found = partial_answer(
        absorber, BOXED, levels_db=[0.0], rel_error=0.002, budget=0.01, seed=seed, threads=1
    )
    return ends_of(found.central.displacement_std) if found else ALL


TWO_MOTIONS = Scene(
    structure=Oscillator(mass=1.0, damping=0.02, stiffness=0.01),
    impact_pairs=[ImpactPair(clearance=4.0, law=Restitution(coefficient=0.6))],
    excitations=[
        Sine(amplitude=1.0, frequency_hz=1.0 / (2.0 * math.pi)), WhiteNoise(intensity=8e-4)
    ],
)  # fmt: skip
"""A mass that may hit its stops under a sine or not, in noise that ends its rest."""


def life_without_impacts(seed: int) -> Ends:
    found = partial_answer(
        lifetimes, TWO_MOTIONS, ["no impacts"], rel_error=0.01, budget=1.3, seed=seed, threads=1
    ).regimes[0]
    return found.life_time_low, found.life_time_high or math.inf


def exact_rate() -> float:
    return exact(FAR).impact_pairs["stops"]["collision_rate"].value


def exact_hits() -> float:
    return 20.0 * exact(OFTEN).impact_pairs["stops"]["collision_rate"].value


def exact_chance() -> float:
    """The probability of a passage from rest, by the Fokker-Planck equation."""
    passed = first_passage(scene(None), -4.0, 4.0, times=[MISSION])
    return float(passed.probability[-1].value)


def exact_clearance() -> float:
    def beyond(clearance: float) -> float:
        known = exact(scene(clearance, damping=0.05)).impact_pairs["stops"]["collision_rate"]
        return float(known.value) - ACCEPTED

    return float(brentq(beyond, 2.4, 2.9, xtol=1e-6))


def long_vibration() -> float:
    found = absorber(BOXED, levels_db=[0.0], rel_error=0.002, seed=10**6, budget=None)
    return found.central.displacement_std.value


def long_life() -> float:
    found = lifetimes(TWO_MOTIONS, ["no impacts"], rel_error=0.007, seed=10**6, budget=None)
    assert found.regimes[0].life_time is not None
    return found.regimes[0].life_time


def long_bursts() -> float:
    found = reliability(SOFT, mission=10.0, rel_error=0.008, budget=None, seed=10**6, threads=1)
    return found.hits.value


def long_clatter() -> float:
    found = clatter(SOFT, [6e-3], rel_error=0.008, budget=None, seed=10**6, threads=1)
    return float(found["acceleration_rms"].iloc[0])


QUESTIONS: dict[str, tuple[Callable[[int], Ends], Callable[[], float]]] = {
    "rate, simulate": (simulated_rate, exact_rate),
    "deviation, simulate": (simulated_deviation, lambda: 1.0),
    "rate, impacts": (counted_impacts, exact_rate),
    # two-sided S0 / (2 pi b^2) per rad/s at resonance; one-sided per hertz
    "density, spectrum": (sampled_spectrum, lambda: 2.0 * 0.2 / 0.1**2),
    "impacts of missions, reliability": (hits_of_missions, exact_hits),
    "probability by splitting, reliability": (split_chance, exact_chance),
    "impacts of clusters, reliability": (hits_of_bursts, long_bursts),
    "acceleration, clatter": (clatter_of_windows, long_clatter),
    "rate, clearance": (rate_at_a_clearance, exact_rate),
    "clearance, size": (required_clearance, exact_clearance),
    "deviation, absorber": (vibration_with_an_absorber, long_vibration),
    "life, lifetimes": (life_without_impacts, long_life),
}
"""An interval from little work, by seed, and the truth."""

DEAR = (
    "impacts of missions, reliability", "clearance, size", "deviation, absorber", "life, lifetimes"
)  # fmt: skip
"""Questions of which an answer takes a second."""


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [5, pytest.param(200, marks=pytest.mark.verify)])
def test_what_is_left_of_a_budget_holds_as_often_as_it_says(
    seeds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = {name: each for name, each in QUESTIONS.items() if seeds > 5 or name not in DEAR}
    truths = {name: truth() for name, (_, truth) in asked.items()}
    tick(monkeypatch, 1e-3)
    held: dict[str, float] = {}
    intervals: list[bool] = []
    for name, (ask, _) in asked.items():
        ends = [ask(seed) for seed in range(seeds)]
        stated = np.mean([low > 0.0 or high < math.inf for low, high in ends])
        assert stated > 0.5, f"{name}: nothing is stated"
        inside = [low <= truths[name] <= high for low, high in ends]
        held[name] = float(np.mean(inside))
        intervals += [hit for hit, (low, _) in zip(inside, ends, strict=True) if low > 0.0]
        assert held[name] > 0.9 - 3.0 * math.sqrt(0.9 * 0.1 / seeds), name
    # upper limits hold more often than they say, intervals as often
    assert len(intervals) > seeds
    assert abs(np.mean(intervals) - 0.95) < 0.02 + 3.0 * math.sqrt(0.05 * 0.95 / len(intervals))


def test_twice_the_error_of_two_paths_does_not_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was stated before: the negative control, from the same paths as the upper limits."""
    truth, plain, stated = exact_rate(), 0, 0
    for seed in range(40):
        found = impacts(FAR, paths=2, duration=300.0, seed=seed, threads=1).pairs["stops"]
        rate = found.rates["both"]
        assert rate.estimate.value == 0.0 and rate.estimate.upper_95 == rate.upper
        stated += rate.upper >= truth
        counts = _counts(seed)
        mean, error = mean_and_error(counts / 300.0)
        plain += abs(mean - truth) <= GAUSSIAN_95 * error
    assert stated > 36 > 30 > plain


def _counts(seed: int) -> np.ndarray:
    """Impacts of the same two paths."""
    log = plan_impacts(FAR, duration=300.0).impacts(seed, 0, 2)["stops"]
    return np.bincount(log.path, minlength=2).astype(float)
