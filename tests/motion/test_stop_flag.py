"""Paths that take long are given up once their answer is due, whatever kernel simulates them."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from threading import Timer
from typing import Any

import numpy as np
import pytest

from stochvi import NotConverged, impacts, load_scene, simulate
from stochvi.model.model import model_of
from stochvi.motion import choose_plan
from stochvi.motion.choose_plan import averages_in_time, make_plan
from stochvi.motion.missions import (
    MissionPlan,
    crude,
    passage_plan,
    pilot_levels,
    repetition,
)
from stochvi.results import Interrupted
from stochvi.results.deadline import Deadline
from stochvi.sampling import calculations
from stochvi.sampling import calculations as room
from stochvi.sampling.calculations import (
    GivenUp,
    ListSampler,
    check_flag,
    given_up_after,
    in_pieces,
    stop_flag,
)
from stochvi.sampling.run import Run
from stochvi.sampling.workers import pool_of
from stochvi.scenes.datasets import shipped_scene, zoo_files
from support.known import oscillator

WAIT = 0.05
"""Seconds for which these tests wait for paths."""

LONG = {simulate: 3e7, impacts: 3e6}
"""Lengths of paths that take some seconds of CPU, s."""


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "WAIT_SECONDS", WAIT)
    monkeypatch.setattr(room, "LOOK_SECONDS", 0.2 * WAIT)


KINDS: dict[str, Callable[[], Path]] = {
    "white noise": lambda: zoo_files()["lossy-0.5"],
    "stops that give way": lambda: zoo_files()["spring-stops"],
    "two masses": lambda: shipped_scene("absorber-in-a-box"),
    "tables": lambda: shipped_scene("isolator-bumper"),
}
"""Scenes by what is special in their kernels."""


@pytest.mark.parametrize("kind", KINDS)
def test_a_path_that_is_late_is_given_up(kind: str) -> None:
    plan: Any = make_plan(model_of(load_scene(KINDS[kind]())))
    averages_in_time(plan.shortest(), 0, 0, 2, Deadline.after(9.0))  # loads the kernels
    if kind == "tables":  # whose burn-in cannot be longer than a block
        stop_flag()[0] = 1
        with pytest.raises(GivenUp):
            plan.averages(0, 0, 2)
        stop_flag()[0] = 0
        return
    endless = replace(plan, burn_in=10**6 * plan.burn_in)
    began = time.process_time()
    with pytest.raises(GivenUp):
        averages_in_time(endless, 0, 0, 2, Deadline.after(WAIT))
    assert time.process_time() - began < 1.0
    check_flag()  # the next block starts afresh


@pytest.mark.parametrize("kind", KINDS)
def test_paths_that_take_long_end_where_the_deadline_finds_them(
    monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    # they end by themselves, also on a machine that is busy when the deadline passes
    monkeypatch.setattr(room, "WAIT_SECONDS", 9.0)
    plan: Any = make_plan(model_of(load_scene(KINDS[kind]())))
    averages_in_time(plan.shortest(), 0, 0, 2, Deadline.after(9.0))  # loads the kernels
    longer = {"duration": 10**6 * plan.duration}
    if kind == "tables":
        longer["blocks"] = 10**6 * plan.blocks
    endless = replace(plan, **longer)
    began = time.process_time()
    found, _, steps = averages_in_time(endless, 0, 0, 2, Deadline.after(WAIT))
    assert time.process_time() - began < 1.0
    assert 0 < steps < endless.steps and np.all(np.isfinite(found))
    check_flag()


MISSIONS: dict[str, Callable[[MissionPlan, Deadline], Any]] = {
    "crude": lambda plan, late: crude(plan, 0, False, 0, 64, late),
    "repetition": lambda plan, late: repetition(plan, (), 0, False, 0, 64, late),
    "levels": lambda plan, late: pilot_levels(plan, 0, 0, 64, late),
}
"""Work on missions, by its part in `reliability`."""


@pytest.mark.parametrize("part", MISSIONS)
def test_missions_that_are_late_are_given_up(part: str) -> None:
    plan = passage_plan(model_of(oscillator()), -9.0, 9.0, 1e7, "rest")  # 2.5e7 steps a path
    plan.advance(plan.fleet(0, 0, 2), 0.0)  # loads the kernel
    began = time.process_time()
    with pytest.raises(GivenUp):
        MISSIONS[part](plan, Deadline.after(WAIT))
    assert time.process_time() - began < 1.0
    check_flag()


def test_pieces_that_were_done_are_kept() -> None:
    def make(first: int, paths: int) -> int:
        while first >= 2:
            check_flag()
        return paths

    assert in_pieces(make, 0, 64, Deadline.after(WAIT)) == [2]


def test_pieces_grow_where_a_few_paths_take_as_long_as_many(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They stayed at two paths, at ten times the price, where two paths take long."""
    clock, sizes = [0.0], list[int]()

    def make(first: int, paths: int) -> int:
        clock[0] += 0.3 * max(1.0, paths / 64.0)
        sizes.append(paths)
        return paths

    monkeypatch.setattr(calculations.time, "perf_counter", lambda: clock[0])
    in_pieces(make, 0, 300, Deadline.after(1000.0))
    assert sizes[:4] == [2, 8, 32, 64] and sum(sizes) == 300 and len(sizes) < 9


def test_a_path_in_time_is_not_given_up() -> None:
    plan = make_plan(model_of(oscillator(-1.0, 1.0, 0.5)), None, 20.0)
    with given_up_after(Deadline.after(60.0)):
        time.sleep(2.0 * WAIT)
        assert not stop_flag()[0]
        found = plan.averages(3, 0, 4)
    np.testing.assert_array_equal(found, plan.averages(3, 0, 4))


@pytest.mark.parametrize("solve", [simulate, impacts])
def test_ctrl_c_does_not_wait_for_a_path_that_takes_long(
    monkeypatch: pytest.MonkeyPatch, solve: Callable[..., Any]
) -> None:
    @contextmanager
    def pressed(deadline: Deadline) -> Iterator[None]:
        press = Timer(WAIT, os.kill, [os.getpid(), signal.SIGINT])
        press.start()
        with given_up_after(deadline):
            yield

    monkeypatch.setattr(calculations, "given_up_after", pressed)
    monkeypatch.setattr(choose_plan, "given_up_after", pressed)
    # the guard of budgets, which would end it on a busy machine, goes by the clock
    monkeypatch.setattr("stochvi.sampling.calculations.ended_by", lambda _: nullcontext())
    with pytest.raises(Interrupted, match=r"before two paths|after 4 of 4 paths, cut after"):
        solve(oscillator(-1.0, 1.0, 0.5), paths=4, duration=LONG[solve], budget=3600.0, threads=1)


@pytest.mark.parametrize("solve", [simulate, impacts])
def test_ctrl_c_in_the_burn_in_says_that_there_is_no_path(
    monkeypatch: pytest.MonkeyPatch, solve: Callable[..., Any]
) -> None:
    """One that counted whole paths said "after 0 of 4 paths" there."""

    @contextmanager
    def pressed(_: Deadline) -> Iterator[None]:
        signal.raise_signal(signal.SIGINT)
        stop_flag()[0] = 1
        yield
        stop_flag()[0] = 0

    monkeypatch.setattr(calculations, "given_up_after", pressed)
    monkeypatch.setattr(choose_plan, "given_up_after", pressed)
    with pytest.raises(Interrupted, match="by Ctrl-C before two paths were simulated"):
        solve(oscillator(-1.0, 1.0, 0.5), paths=4, budget=3600.0, threads=1)
    check_flag()


class GivesUp(ListSampler):
    """A sampler whose blocks are all given up."""

    block = 2

    def simulate(self, first_path: int, paths: int) -> Any:
        raise GivenUp

    def add_up(self, pieces: list[Any]) -> list[Any]:
        return pieces

    def paths(self, sample: list[Any]) -> int:
        return len(sample)


def test_a_run_without_any_paths_says_that_there_was_no_time_for_them() -> None:
    with pool_of(None, 1) as pool:
        assert not [*pool.do(GivesUp(), iter([(0, 2)]), 1, Deadline.after(9.0))]
        with pytest.raises(NotConverged, match="the budget of 9 s ended before two paths"):
            Run(pool, Deadline.after(9.0)).until(GivesUp(), 2)
