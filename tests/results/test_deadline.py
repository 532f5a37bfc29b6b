"""The clock of everything with a budget, and what Ctrl-C does to it."""

from __future__ import annotations

import math
import os
import pickle
import signal
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from threading import get_ident
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stochvi.engine.compiling import kernel
from stochvi.engine.late_exceptions import disturbed, raise_late, undisturbed
from stochvi.methods.monte_carlo import simulate
from stochvi.results import deadline as module
from stochvi.results.deadline import (
    NEVER,
    Deadline,
    Overdue,
    Pace,
    Progress,
    ended_by,
    graceful_interrupt,
    start_clock,
    stop_clock,
)
from stochvi.results.errors import Interrupted, NotConverged
from stochvi.results.files import usable_cores
from stochvi.sampling.calculations import calculation
from stochvi.scenes.excitations import WhiteNoise
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Oscillator


def test_ctrl_c_ends_also_what_begins_after_it_within_the_same_command() -> None:
    """A deadline that a later part of the work made for itself used to know nothing of it."""
    with graceful_interrupt():
        assert not Deadline.after(60.0).passed()
        signal.raise_signal(signal.SIGINT)
        with graceful_interrupt():
            later = Deadline.after(60.0)
        assert later.interrupted and Deadline.after(None).passed()
    assert not Deadline.after(60.0).passed()  # another command


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time, which passes only where a test says so."""
    moment = [1000.0]
    monkeypatch.setattr("stochvi.results.deadline.time", SimpleNamespace(time=lambda: moment[0]))
    return moment


def test_a_deadline_waits_while_the_clock_stands_still(now: list[float]) -> None:
    deadline = Deadline.after(10.0)
    now[0] += 4.0
    stop_clock()
    now[0] += 50.0
    assert deadline.left == 6.0  # also meanwhile
    stop_clock()  # a kernel that the first one calls
    now[0] += 50.0
    start_clock()
    start_clock()
    assert deadline.left == 6.0 and Deadline.after(10.0).left == 10.0
    now[0] += 6.0
    assert deadline.passed()


def test_a_deadline_that_another_process_gets_is_due_at_the_same_moment(now: list[float]) -> None:
    deadline = Deadline.after(10.0)
    stop_clock()
    now[0] += 3.0
    start_clock()
    sent = pickle.dumps(deadline)
    assert pickle.loads(sent).due == deadline.due == 1013.0
    assert pickle.loads(pickle.dumps(NEVER)) == NEVER


def test_a_deadline_may_be_put_off_but_never_brought_forward_so(now: list[float]) -> None:
    deadline = Deadline.after(10.0)
    assert deadline.in_no_less_than(3.0).left == 10.0
    now[0] += 9.0
    assert deadline.in_no_less_than(3.0).left == 3.0 and deadline.left == 1.0
    assert deadline.in_no_less_than(3.0).budget == 10.0


def test_messages_name_the_budget_that_was_asked_for_and_no_part_of_it() -> None:
    """A part of 3.67 s was named to a user who had asked for 10 s."""

    @calculation
    def part(budget: float | None = None) -> None:
        raise Deadline.after(budget).fell_short("on the way", "raise budget")

    @calculation
    def whole(budget: float | None = None) -> None:
        part(budget=Deadline.after(budget).part(0.3))

    with pytest.raises(NotConverged, match="the budget of 10 s ended on the way"):
        whole(budget=10.0)
    with pytest.raises(NotConverged, match="the budget of 3 s ended on the way"):
        part(budget=3.0)


def spin() -> None:
    """A calculation that never looks at a deadline."""
    for _ in range(10**9):
        pass


def ended(work: Callable[[], None], budget: float | None = 0.01) -> None:
    """A calculation with a budget, after which it may not go on."""
    with ended_by(budget, patience=0.0):
        work()


def test_what_does_not_look_at_its_deadline_is_ended() -> None:
    with pytest.raises(NotConverged, match=r"budget of 0.01 s ended before there was an answer"):
        ended(spin)
    ended(lambda: None)  # what ends by itself is not


def test_a_thread_that_is_not_the_main_one_is_ended_too() -> None:
    with ThreadPoolExecutor(1) as pool, pytest.raises(NotConverged):
        pool.submit(ended, spin).result()


def test_what_waits_for_others_is_ended() -> None:
    with pytest.raises(NotConverged):
        ended(Future[None]().result)  # of work that nobody does


def test_what_is_ended_leaves_its_answer_so_far() -> None:
    def work() -> None:
        try:
            spin()
        except KeyboardInterrupt:
            raise Interrupted("interrupted by Ctrl-C", 41.0) from None

    with pytest.raises(NotConverged, match="on the way") as reached:
        ended(work)
    assert reached.value.partial == 41.0


def test_what_goes_on_all_the_same_is_ended_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stochvi.results.deadline.OVERDUE_SECONDS", 0.1)
    heard = []

    def work() -> None:
        for _ in range(3):
            try:
                spin()
            except Overdue as reason:
                heard.append(reason)
        spin()

    with pytest.raises(NotConverged):
        ended(work)
    assert len(heard) == 3


def test_a_part_is_ended_without_the_whole() -> None:
    with ended_by(60.0), pytest.raises(NotConverged):
        ended(spin)
    with pytest.raises(KeyboardInterrupt):  # Ctrl-C is what it was
        signal.raise_signal(signal.SIGINT)


def test_ctrl_c_ends_what_does_not_look_at_its_deadline() -> None:
    def work() -> None:
        signal.raise_signal(signal.SIGINT)
        spin()

    with pytest.raises(Interrupted, match="interrupted by Ctrl-C before there was an answer"):
        ended(work, None)


def test_an_end_that_meets_the_return_of_compiled_code_is_an_end() -> None:
    """Python raises SystemError then, from what was raised; any other one stays what it is."""

    def returned() -> None:
        try:
            spin()
        except KeyboardInterrupt as reason:
            raise SystemError("a kernel returned a result with an exception set") from reason

    with pytest.raises(NotConverged, match="before there was an answer"):
        ended(returned)

    def broken() -> None:
        raise SystemError("a kernel is broken")

    with pytest.raises(SystemError, match="is broken"):
        ended(broken)


@kernel
def add_up(count: int, numbers: np.ndarray) -> tuple[int, np.ndarray]:
    total = np.zeros(4)
    for number in range(count):
        total[number & 3] += numbers[number & 1]
    return count, total


@pytest.mark.parametrize("threads", [0, 2])
def test_an_end_within_compiled_code_waits_for_its_return(threads: int) -> None:
    """numba makes arrays of the results, and did not look for an exception: a crash, or a
    SystemError without a cause."""
    add_up(1, np.ones(2))
    count = 10_000_000
    while (began := time.perf_counter()) and add_up(count, np.ones(2)):
        if time.perf_counter() - began > 0.5:
            break
        count *= 2

    def once(*_: object) -> None:
        with pytest.raises(NotConverged, match="before there was an answer"):
            ended(lambda: add_up(count, np.ones(2)))

    if threads:
        with ThreadPoolExecutor(threads) as pool:
            assert list(pool.map(once, range(4))) == [None] * 4
    else:
        for _ in range(3):
            once()


def test_compiling_within_a_call_is_ended_at_once() -> None:
    """It takes many seconds, and runs in Python, where exceptions do no harm."""

    def call() -> None:
        with disturbed():
            assert not raise_late(get_ident(), Overdue)
        assert raise_late(get_ident(), Overdue)

    with pytest.raises(Overdue):
        undisturbed(call, (), {})
    assert not raise_late(get_ident(), Overdue)


def test_nothing_is_told_of_a_destructor_that_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python cannot raise an exception there, and prints a traceback of it."""
    told: list[object] = []
    monkeypatch.setattr("sys.unraisablehook", told.append)
    monkeypatch.setattr("stochvi.results.deadline.OVERDUE_SECONDS", 0.1)

    class Slow:
        def __del__(self) -> None:
            spin()

    def work() -> None:
        Slow()
        spin()

    with pytest.raises(NotConverged):
        ended(work)
    assert not told


# ------------------------------------------------------------------------------
# Progress predicts the time left; notebooks show that of the calculation that was asked for.
# ------------------------------------------------------------------------------


def test_the_time_left_is_that_at_the_pace_since_the_first_report(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The time before the first report used to count, in which the fraction did not grow."""
    now = [1000.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    pace = Pace("size")
    now[0] += 30.0
    assert math.isinf(pace.left(0.5))
    now[0] += 2.0
    assert pace.left(0.6) == pytest.approx(8.0)
    assert pace(0.6, "first crossings") == "size: 60 %, first crossings, 8 s left"


@calculation
def inner(*, progress: Progress | None = None) -> bool:
    if progress:
        progress(0.5, "inside")
    return progress is not None


@calculation
def outer(*, progress: Progress | None = None) -> tuple[bool, bool]:
    if progress:
        progress(0.25, "100 paths < 200")
    return progress is not None, inner()


class Notebook:
    """What a kernel has of IPython, which keeps what is displayed."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, kernel: object) -> None:
        self.shown: list[str] = []
        self.places = 0
        shell = SimpleNamespace(kernel=kernel)
        fake = SimpleNamespace(get_ipython=lambda: shell)
        monkeypatch.setitem(sys.modules, "IPython", fake)
        monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(display=self.display))
        monkeypatch.setattr(module, "FIRST_SECONDS", 0.0)

    def display(self, forms: dict[str, str], **more: Any) -> Notebook:
        self.places += 1
        self.update(forms)
        return self

    def update(self, forms: dict[str, str], **more: Any) -> None:
        self.shown.append(forms["text/html"])


def test_a_notebook_shows_one_bar_for_a_calculation_and_what_it_calls(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    notebook = Notebook(monkeypatch, kernel=object())
    assert outer() == (True, False)
    assert notebook.places == 1
    first, last = notebook.shown
    assert "outer: 25 %, 100 paths &lt; 200" in first
    assert last == ""
    assert inner(), "the next calculation has the cell to itself"


def test_a_calculation_that_fails_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = Notebook(monkeypatch, kernel=object())

    @calculation
    def failing(*, progress: Progress | None = None) -> None:
        assert progress
        progress(0.1, "begun")
        raise ValueError("no more")

    with pytest.raises(ValueError, match="no more"):
        failing()
    assert notebook.shown[-1] == ""
    assert inner()


def test_who_gives_a_progress_gets_it_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = Notebook(monkeypatch, kernel=object())
    heard: list[str] = []
    inner(progress=lambda done, text: heard.append(text))
    assert heard == ["inside"]
    assert notebook.shown == []


@pytest.mark.parametrize("where", ["script", "terminal of IPython"])
def test_programs_stay_silent(monkeypatch: pytest.MonkeyPatch, where: str) -> None:
    notebook = Notebook(monkeypatch, kernel=None)
    if where == "script":
        monkeypatch.delitem(sys.modules, "IPython")
    assert outer() == (False, False)
    assert notebook.shown == []


# ------------------------------------------------------------------------------
# The package runs on systems that do not know to which cores a process is bound.
# ------------------------------------------------------------------------------


def without(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    for name in names:
        monkeypatch.delattr(os, name, raising=False)


def test_the_number_of_usable_cores_is_found_on_every_system(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    without(monkeypatch, "process_cpu_count")
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 3, 5}, raising=False)
    assert usable_cores() == 3  # Linux
    without(monkeypatch, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 7)
    assert usable_cores() == 7  # macOS and Windows
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert usable_cores() == 1
    monkeypatch.setattr(os, "process_cpu_count", lambda: 5, raising=False)
    assert usable_cores() == 5  # Python 3.13 and newer


@pytest.mark.parametrize(
    ("asked", "cores"), [("2", 2), ("64", 5), ("", 5), ("0", 5), ("-1", 5), ("all", 5)]
)
def test_the_threads_of_numba_limit_those_of_a_simulation(
    monkeypatch: pytest.MonkeyPatch, asked: str, cores: int
):
    monkeypatch.setattr(os, "process_cpu_count", lambda: 5, raising=False)
    monkeypatch.setenv("NUMBA_NUM_THREADS", asked)
    assert usable_cores() == cores


def test_simulation_runs_where_affinity_is_unknown(monkeypatch: pytest.MonkeyPatch):
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        excitations=[WhiteNoise(intensity=0.2)],
    )
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    without(monkeypatch, "sched_getaffinity", "process_cpu_count")
    found = simulate(scene, paths=32, duration=10.0, seed=1)
    assert found.cost.paths == 32 and found.cost.threads == os.cpu_count()
