"""A budget ends a simulation within a block, and every answer so far is kept."""

from __future__ import annotations

import signal

import numpy as np
import pytest

from stochvi import (
    ImpactPair,
    NotConverged,
    Oscillator,
    Restitution,
    Scene,
    WhiteNoise,
    exact,
    simulate,
)
from stochvi.methods.monte_carlo import blocks, rounds
from stochvi.methods.monte_carlo.blocks import FEWEST_AT_ONCE, averages_in_time, check_price
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.plan import Plan
from stochvi.methods.monte_carlo.rigid_white import COLLAPSE_RESTITUTION
from stochvi.model.model import model_of
from stochvi.results import Interrupted
from stochvi.results.deadline import NEVER, Deadline, heeding_ctrl_c
from stochvi.scenes.excitations import ConstantLoad
from stochvi.testing import assert_agrees
from support.known import oscillator


def plan_of(duration: float) -> Plan:
    return make_plan(model_of(oscillator(-1.0, 1.0, 0.5)), None, duration)


def test_a_block_that_is_late_ends_with_its_first_paths() -> None:
    plan = plan_of(20.0)
    whole = plan.averages(3, 64, 64)
    late, _ = averages_in_time(plan, 3, 64, 64, deadline=Deadline(0.0))
    assert late.shape[1] == FEWEST_AT_ONCE
    np.testing.assert_array_equal(late, whole[:, :FEWEST_AT_ONCE])


def test_paths_do_not_depend_on_the_pieces_of_their_block() -> None:
    plan = plan_of(20.0)
    group = plan.block // 4
    paths = 6 * group
    pieces, pairs = averages_in_time(plan, 3, 0, paths, deadline=Deadline.after(1000.0))
    whole = plan.averages(3, 0, paths)
    np.testing.assert_array_equal(pieces, whole)
    # the first of four groups, wherever a piece or a block begins
    some = np.r_[:group, 4 * group : 5 * group]
    coarse = plan.coarser().averages(3, 0, paths)
    np.testing.assert_array_equal(pairs, np.concatenate([whole, coarse])[:, some])
    blocks = [averages_in_time(plan, 3, 3 * n * group, 3 * group, NEVER)[1] for n in range(2)]
    np.testing.assert_array_equal(pairs, np.concatenate(blocks, axis=1))


def test_paths_that_take_longer_than_the_budget_are_refused_before_they_are_begun() -> None:
    deadline = Deadline.after(2.0)
    with pytest.raises(NotConverged, match="too short for 2 paths"):
        check_price([plan_of(2e7)], 3, deadline)
    assert not deadline.passed()
    check_price([plan_of(2e3)], 3, deadline)  # negative control: these are short


@pytest.mark.parametrize("asked", [{"paths": 4096}, {"rel_error": 1e-4}], ids=str)
def test_a_budget_shorter_than_a_block_leaves_an_answer(asked: dict) -> None:
    """It used to end after the first whole block, however long that took."""
    scene = oscillator(-1.0, 1.0, 0.5)
    with pytest.raises(NotConverged) as found:
        simulate(scene, budget=1e-6, **asked)
    response = found.value.response
    assert response is not None
    assert FEWEST_AT_ONCE <= response.cost.paths < make_plan(model_of(scene)).block


def between_stops(r: float, load: float, stiffness: float) -> Scene:
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.2, stiffness=stiffness),
        impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=r))],
        excitations=[WhiteNoise(intensity=0.2), ConstantLoad(force=load)],
    )


def test_a_mass_without_a_spring_falls_between_its_stops() -> None:
    scene = between_stops(1.0, 0.3, 0.0)
    known = exact(scene).estimates()
    found = simulate(scene, rel_error=0.03, seed=4).estimates()
    for key in [("x", "displacement_mean"), ("x", "velocity_std"), ("stops", "collision_rate")]:
        assert_agrees(found[key], known[key].value)


def test_f2_of_a_mass_that_a_load_holds_at_a_dead_stop_states_no_bias() -> None:
    scene = between_stops(0.0, 0.3, 1.0)
    plan = make_plan(model_of(scene))
    assert plan.step_bias("impact_speed_square_rate", 0.01) is None
    free = make_plan(model_of(between_stops(2.0 * COLLAPSE_RESTITUTION, 0.3, 1.0)))
    assert free.step_bias("impact_speed_square_rate", 0.01) is not None


class SlowPlan:
    """A plan of so many steps, each of which takes a millisecond of a clock that nothing else
    moves."""

    def __init__(self, steps: int, clock: list[float]) -> None:
        self.steps_per_path, self.clock = steps, clock

    def shortest(self, steps: int = 2) -> SlowPlan:
        return SlowPlan(steps, self.clock)

    def averages(self, seed: int, first_path: int, paths: int) -> None:
        self.clock[0] += 1e-3 * self.steps_per_path


def test_a_price_is_found_in_a_moment_also_where_there_is_much_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The trials of a path of 3 s used to take as long again where the budget was 400 s."""
    clock = [0.0]
    monkeypatch.setattr(blocks, "thread_seconds", lambda: clock[0])
    price = blocks.seconds_of_first_paths(SlowPlan(100_000, clock), 0, Deadline.after(400.0))
    assert price == pytest.approx(100.0) and clock[0] < 4.0 * blocks.MOST_PRICE


def test_paths_are_not_begun_after_ctrl_c() -> None:
    deadline = Deadline.after(60.0)
    with heeding_ctrl_c():
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(Interrupted, match="before any path"):
            check_price([plan_of(2e3)], 3, deadline)


def test_progress_foresees_that_the_step_has_to_be_halved(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that refines its step takes as many paths again; it used to be at 100 % by then."""

    def biased(run: rounds.Run) -> float:
        return 0.0 if run.state.refinements else 1.0

    fractions: list[float] = []
    refine, at = rounds.Run.refine, list[float]()
    monkeypatch.setattr(rounds, "largest_bias", biased)
    monkeypatch.setattr(rounds, "REPORT_SECONDS", 0.0)
    monkeypatch.setattr(rounds.Run, "refine", lambda run: (at.append(fractions[-1]), refine(run)))
    simulate(
        oscillator(-1.0, 1.0, 0.5), rel_error=0.002, threads=1,
        progress=lambda done, _: fractions.append(done),
    )  # fmt: skip
    assert len(at) == 1 and 0.4 < at[0] < 0.6
    assert fractions[-1] > 0.9 and fractions == sorted(fractions)
