"""A budget ends a simulation within a block, and every answer so far is kept."""

from __future__ import annotations

import math
import re
import signal
from typing import Any

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
    load_scene,
    simulate,
)
from stochvi.methods.monte_carlo import prices, simulation
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.plan import RELAXATIONS, Plan
from stochvi.methods.monte_carlo.prices import check_price
from stochvi.methods.monte_carlo.response_sampler import averages_in_time
from stochvi.methods.monte_carlo.rigid_white import COLLAPSE_RESTITUTION, WhitePaths, WhitePlan
from stochvi.model.model import model_of
from stochvi.results import Interrupted
from stochvi.results.deadline import NEVER, Deadline, graceful_interrupt
from stochvi.results.estimates import Estimate
from stochvi.results.response import Response
from stochvi.sampling import run as sampling_run
from stochvi.sampling.blocks import FULL_LANES
from stochvi.sampling.run import Run
from stochvi.sampling.stop_flag import GivenUp
from stochvi.sampling.workers import pool_of
from stochvi.scenes.datasets import shipped_scene, zoo_files
from stochvi.scenes.excitations import ConstantLoad
from stochvi.testing import assert_agrees
from support.known import oscillator


def plan_of(duration: float) -> Plan:
    return make_plan(model_of(oscillator(-1.0, 1.0, 0.5)), None, duration)


LATE = Deadline(0.0)


def test_a_block_that_is_late_ends_in_time_not_in_paths() -> None:
    """The answer is the one of so many shorter paths: no digit tells that they were cut."""
    plan = plan_of(2000.0)
    late, pairs, steps = averages_in_time(plan, 3, 0, 640, LATE)
    assert late.shape[1] == pairs.shape[1] == FULL_LANES
    assert plan.burn_in / RELAXATIONS <= steps * plan.step < plan.duration
    shorter = plan.cut(steps)
    np.testing.assert_array_equal(late, shorter.averages(3, 0, FULL_LANES))


def test_a_late_block_that_is_not_needed_is_left_out() -> None:
    with pytest.raises(GivenUp):
        averages_in_time(plan_of(20.0), 3, 64, 64, LATE)


SCENES = {
    "white noise": zoo_files()["lossy-0.5"],
    "stops that give way": zoo_files()["spring-stops"],
    "two masses": shipped_scene("absorber-in-a-box"),
    "tables": shipped_scene("isolator-bumper"),
    "a box": shipped_scene("rigid-box"),
}
"""Scenes by what is special in their kernels."""


@pytest.mark.parametrize("refined", [False, True])
@pytest.mark.parametrize("name", SCENES)
def test_digits_do_not_depend_on_where_a_path_is_cut(name: str, refined: bool) -> None:
    if refined and name != "white noise":
        return
    plan = make_plan(model_of(load_scene(SCENES[name])), None, None, refined)
    duration = {"tables": 2.5 * plan.duration, "a box": 1.5 * plan.duration}.get(
        name, 30 * plan.step
    )
    plan = make_plan(model_of(load_scene(SCENES[name])), None, duration, refined)
    for each in (plan, plan.coarser()):
        whole, paths = each.averages(5, 3, 5), each.begin(5, 3, 5)
        share = 0.0
        while paths.made < paths.total:
            share += 0.137
            paths.reach(math.ceil(share * paths.total))
        np.testing.assert_array_equal(paths.averages(), whole)
        # negative control: another path has other digits
        assert not np.any(each.averages(5, 4, 5)[:3] == whole[:3])


def test_a_step_has_its_price_however_the_total_is_split(monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted in calls of the kernel, each of which costs as much for a few paths as for 64."""
    sizes: list[int] = []

    def counted(self: WhitePlan, seed: int, first_path: int, paths: int) -> WhitePaths:
        sizes.append(paths)
        return WhitePaths(self, seed, first_path, paths)

    monkeypatch.setattr(WhitePlan, "begin", counted)
    simulate(oscillator(-1.0, 1.0, 0.5), paths=130, duration=2e5, threads=1, budget=1e6)
    assert sizes == [64, 64, 64, 2]


def test_paths_do_not_depend_on_the_pieces_of_their_block() -> None:
    plan = plan_of(20.0)
    group = plan.block // 4
    paths = 6 * group
    pieces, pairs, _ = averages_in_time(plan, 3, 0, paths, deadline=Deadline.after(1000.0))
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
    response = found.value.partial
    assert response is not None
    assert response.cost.paths == FULL_LANES < make_plan(model_of(scene)).block
    seconds = make_plan(model_of(scene)).duration
    lasted = response.impact_pairs["stops"].collision_rate.how
    assert float(re.search(r"paths of ([\d.]+) s", lasted)[1]) < seconds  # type: ignore[index]


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
    monkeypatch.setattr(prices, "thread_seconds", lambda: clock[0])
    price = prices.seconds_of_first_paths(SlowPlan(100_000, clock), 0, Deadline.after(400.0))
    assert price == pytest.approx(100.0) and clock[0] < 4.0 * prices.MOST_PRICE


class SlowStart(SlowPlan):
    """A plan that takes a second more before its first step."""

    def shortest(self, steps: int = 2) -> SlowStart:
        return SlowStart(steps, self.clock)

    def averages(self, seed: int, first_path: int, paths: int) -> None:
        self.clock[0] += 1.0
        super().averages(seed, first_path, paths)


def test_what_comes_before_the_first_step_is_no_price_of_a_step(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A chain of two masses, whose states are drawn in .1 s, was refused on a slow machine: its
    paths of 5 s seemed to take 250 s."""
    clock = [0.0]
    monkeypatch.setattr(prices, "thread_seconds", lambda: clock[0])
    plan, deadline = SlowStart(10_000, clock), Deadline.after(400.0)
    assert prices.seconds_of_first_paths(plan, 0, deadline) == pytest.approx(11.0)
    assert clock[0] < 10.0
    # no more is tried once the first trial takes longer than there is time
    assert prices.seconds_of_first_paths(plan, 0, Deadline.after(0.5)) > 0.5


@pytest.mark.parametrize("name", ["isolator-bumper", "rigid-box"])
def test_the_price_of_synthesised_paths_is_not_that_of_their_first_samples(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a slow machine a block of three samples seemed to make 7000 as dear as 2000 blocks."""
    dear = prices.MOST_PRICE
    monkeypatch.setattr(prices, "_seconds_of", lambda plan, *_: dear * plan.steps_per_path)
    deadline = Deadline.after(1000.0)
    synthesised = make_plan(model_of(load_scene(shipped_scene(name))))
    assert prices.seconds_of_first_paths(synthesised, 0, deadline) == 0.0
    assert prices.seconds_of_first_paths(plan_of(2e3), 0, deadline) > 1.0  # in steps


def test_paths_are_not_begun_after_ctrl_c() -> None:
    deadline = Deadline.after(60.0)
    with graceful_interrupt():
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(Interrupted, match="before any path"):
            check_price([plan_of(2e3)], 3, deadline)


def test_ctrl_c_in_the_pilot_keeps_its_paths(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are the answer so far, with the seed that was asked for, and agree with a whole run."""
    add_paths = simulation.Simulation.add_paths

    def pressed(self: simulation.Simulation, *asked: Any, **more: Any) -> bool:
        found = add_paths(self, *asked, **more)
        if self.seed == simulation.PILOT_SEED:
            signal.raise_signal(signal.SIGINT)
        return found

    scene = oscillator(-1.0, 1.0, 0.5)
    with monkeypatch.context() as patched:
        patched.setattr(simulation.Simulation, "add_paths", pressed)
        with graceful_interrupt(), pytest.raises(Interrupted, match="paths of the pilot") as stop:
            simulate(scene, rel_error=0.05, seed=5, threads=1, budget=1e5)
    so_far = stop.value.partial
    assert isinstance(so_far, Response) and so_far.interrupted
    assert so_far.provenance["seed"] == 5 and so_far.cost.impacts > 100
    whole = simulate(scene, rel_error=0.05, seed=5, threads=1)
    one, other = (
        each.impact_pairs["stops"]["collision_rate"] for each in (so_far, whole)
    )  # fmt: skip
    assert isinstance(one, Estimate) and isinstance(other, Estimate)
    apart = math.hypot(one.reach(4.5), other.reach(4.5))
    assert abs(one.value - other.value) < apart < 0.5 * other.value


def test_progress_does_not_go_back_where_the_step_is_halved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The step is chosen before the first path of the answer."""

    def biased(run: simulation.Simulation, errors: float) -> float:
        return 1.0 if run.plan.step > halved else 0.0

    scene, fractions = oscillator(-1.0, 1.0, 0.5), list[float]()
    halved = 0.6 * make_plan(model_of(scene)).step
    monkeypatch.setattr(simulation, "largest_bias", biased)
    monkeypatch.setattr(sampling_run, "REPORT_SECONDS", 0.0)
    found = simulate(
        scene, rel_error=0.002, threads=1, progress=lambda done, _: fractions.append(done)
    )
    assert any(f"step {halved / 1.2:.3g} s" in each for each in found.assumptions)
    assert fractions[-1] > 0.9 and fractions == sorted(fractions)


@pytest.mark.slow
def test_the_seed_does_not_decide_the_scheme() -> None:
    """One stop at rest: the plain step leaves 1.6 % in F1, and rates that are 12 % too low."""
    scene, seeds, asked = oscillator(0.0, None, 0.3), range(6), 0.0125
    plan = make_plan(model_of(scene))
    with pool_of(None, 1) as pool:
        run = Run(pool, NEVER)
        runs = [simulation.Simulation(scene, plan, run, 0.0, seed) for seed in seeds]
        own = set()
        for each in runs:
            simulation.choose_step(each, asked)
            again = simulation.Simulation(scene, plan, run, 0.0, each.seed)
            again.add_paths(1024)
            own.add(simulation.largest_bias(again, 1.0) > asked)
    assert len({each.plan for each in runs}) == 1 and runs[0].plan.slow_impacts
    assert own == {False, True}  # negative control: by its own paths each run was lucky or not


def test_the_choice_of_the_step_has_a_quarter_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """It used to have all of it: the answer then rested on what was under way at its end."""
    ends: dict[bool, float] = {}
    add_paths = simulation.Simulation.add_paths

    def noted(self: simulation.Simulation, *asked: Any, **more: Any) -> bool:
        ends.setdefault(self.seed == simulation.PILOT_SEED, self.run.deadline.due)
        return add_paths(self, *asked, **more)

    monkeypatch.setattr(simulation.Simulation, "add_paths", noted)
    began = Deadline.after(1e5)
    simulate(oscillator(-1.0, 1.0, 0.5), rel_error=0.2, budget=1e5)
    pilot, run = ends[True], ends[False]
    assert run - pilot == pytest.approx(0.75 * (run - (began.due - 1e5)), rel=0.01)
