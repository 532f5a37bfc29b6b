"""Whatever takes long in a calculation takes it from its budget."""

from __future__ import annotations

import functools
import importlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import stochvi
from stochvi import (
    ImpactPair,
    NotConverged,
    Restitution,
    Scene,
    TabulatedNoise,
    impacts,
    simulate,
    spectrum,
)
from stochvi.methods.periodic import harmonic_response
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.results.deadline import Deadline, ended_by
from stochvi.sampling.calculations import FEWEST_AT_ONCE, FULL_LANES
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.structures import Matrices
from support.known import oscillator

SLOW = 10.0
"""Seconds for which something takes longer than it does."""

check, cost, method_of_impacts = (
    importlib.import_module(f"stochvi.{name}")
    for name in ("verification.check", "verification.cost", "statistics.impacts")
)


@pytest.fixture
def slowed(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Make a function, named by its module and name, seem to take SLOW seconds longer.

    On a busy machine the first paths after it may take longer than calculations are waited for,
    which is not what is tested here.
    """
    clock, late = time.time, [0.0]
    monkeypatch.setattr(time, "time", lambda: clock() + late[0])
    patient = functools.partial(ended_by, patience=600.0)
    monkeypatch.setattr("stochvi.sampling.calculations.ended_by", patient)

    def slow(module: str, name: str) -> None:
        owner = importlib.import_module(module)
        function = getattr(owner, name)

        def slower(*args: Any, **named: Any) -> Any:
            found = function(*args, **named)
            late[0] += SLOW
            return found

        monkeypatch.setattr(owner, name, slower)

    return slow


@pytest.mark.parametrize(
    ("solve", "module", "planning", "fewest"),
    [
        (simulate, "stochvi.methods.monte_carlo", "make_plan", FULL_LANES),
        (spectrum, "stochvi.statistics.spectra", "plan_histories", FEWEST_AT_ONCE),
        (impacts, "stochvi.statistics.impacts", "plan_impacts", FEWEST_AT_ONCE),
    ],
    ids=["simulate", "spectrum", "impacts"],
)
def test_a_plan_that_takes_long_is_a_part_of_the_budget(
    slowed: Callable[..., None],
    solve: Callable[..., Any],
    module: str,
    planning: str,
    fewest: int,
) -> None:
    """Plans of many coordinates and long tables, and kernels that are loaded, used to come on
    top."""
    slowed(module, planning)
    with pytest.raises(NotConverged, match="the budget of 9 s ended") as short:
        solve(oscillator(-1.0, 1.0, 0.8), rel_error=1e-5, budget=0.9 * SLOW, threads=1)
    assert short.value.partial.cost.paths == fewest


def test_methods_without_a_budget_leave_less_to_the_simulation_of_a_check(
    slowed: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[float] = []

    def simulated(*_: Any, budget: float, **__: Any) -> None:
        given.append(budget)
        raise NotConverged("late")

    slowed("stochvi.verification.check", "approximations")
    monkeypatch.setattr(check, "simulate", simulated)
    check.answers(oscillator(-1.0, 1.0, 0.8), rel_error=0.1, deadline=Deadline.after(2.0 * SLOW))
    assert given[0] < SLOW


def test_methods_without_a_budget_leave_less_to_the_simulation_of_a_cost(
    slowed: Callable[..., None],
) -> None:
    slowed("stochvi.verification.cost", "approximations")
    began = time.process_time()
    found = cost.cost(oscillator(-1.0, 1.0, 0.8), budget=0.9 * SLOW, threads=1)
    assert found.cost.paths >= cost.FEWEST_PATHS  # it gets a little all the same
    assert time.process_time() - began < 0.5 * SLOW


def test_first_hits_get_the_share_of_the_budget_that_the_impacts_left_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They used to get a budget of their own, of 60 s."""
    given: list[float] = []

    def crossings(*_: Any, budget: float, **__: Any) -> None:
        given.append(budget)
        raise ValueError("a stub")

    monkeypatch.setattr(method_of_impacts, "first_crossings", crossings)
    impacts(oscillator(-1.0, 1.0, 0.8), paths=16, first_hits=True, budget=5.0, threads=1)
    (share,) = given
    assert 0.0 < share <= 5.0


def test_first_hits_that_no_time_is_left_for_are_named(slowed: Callable[..., None]) -> None:
    slowed("stochvi.statistics.impacts", "plan_impacts")
    with pytest.raises(NotConverged) as short:
        impacts(oscillator(-1.0, 1.0, 0.8), first_hits=True, budget=0.9 * SLOW, threads=1)
    answer = short.value.partial
    assert method_of_impacts.NO_FIRST_HITS in answer.warnings
    assert answer.pairs["stops"].first_hit_rate is None


def test_kernels_of_regimes_are_loaded_within_the_budget(slowed: Callable[..., None]) -> None:
    slowed("stochvi.methods.periodic.sine_response", "too_slow")
    scene = stochvi.load_scene(shipped_scene("isolator-sine"))
    with pytest.raises(NotConverged, match="the budget of 9 s ended") as short:
        harmonic_response(scene, [90.0, 100.0], budget=0.9 * SLOW)
    assert all(not branch.stops for branch in short.value.partial.branches)


def chain(lines: int, *, stops: bool) -> Scene:
    """Eight masses in a row on a base that shakes by a table."""
    n = 8
    springs = 1e4 * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    return Scene(
        structure=Matrices(
            coordinates=[f"m{k}" for k in range(n)], mass=np.eye(n).tolist(),
            damping=(1e-3 * springs).tolist(), stiffness=springs.tolist(),
        ),
        impact_pairs=[ImpactPair(on="m0", upper=1e-3, law=Restitution(coefficient=0.7))] * stops,
        excitations=[
            TabulatedNoise(
                frequency_hz=np.linspace(5.0, 2000.0, lines).tolist(), density=[0.01] * lines,
                unit="(m/s2)2/Hz", on="base",
            )
        ],
    )  # fmt: skip


@pytest.mark.parametrize("solve", [simulate, spectrum, impacts, cost.cost])
def test_a_plan_that_takes_longer_than_the_budget_is_not_begun(solve: Callable[..., Any]) -> None:
    scene = chain(4000, stops=True)
    began = time.process_time()
    with pytest.raises(NotConverged, match=r"8 coordinates under 4000 lines .* raise budget"):
        solve(scene, budget=1.0)
    assert time.process_time() - began < 1.0


def test_a_plan_without_stops_is_quick() -> None:
    model = model_of(chain(1000, stops=False))
    assert make_plan(model, deadline=Deadline.after(1.0)).steps > 0
    with pytest.raises(NotConverged, match="too short for the plan"):
        make_plan(model_of(chain(4000, stops=True)), deadline=Deadline.after(1.0))
