"""A budget ends a simulation within a block, and every answer so far is kept."""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import re
import signal
import sys
import threading
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import stochvi.sampling.checkpoints as checkpoints
from stochvi import (
    ImpactPair,
    Matrices,
    NotConverged,
    Oscillator,
    Restitution,
    Scene,
    WhiteNoise,
    exact,
    load_scene,
    simulate,
)
from stochvi.cli import main
from stochvi.methods import monte_carlo
from stochvi.model.model import model_of
from stochvi.motion import choose_plan
from stochvi.motion.choose_plan import averages_in_time, check_price, make_plan
from stochvi.motion.plan import RELAXATIONS, Plan
from stochvi.motion.white import COLLAPSE_RESTITUTION, WhitePaths, WhitePlan
from stochvi.results import Interrupted
from stochvi.results.base import Response
from stochvi.results.deadline import NEVER, Deadline, graceful_interrupt
from stochvi.results.errors import CheckpointError
from stochvi.results.estimates import Estimate
from stochvi.results.files import write_whole
from stochvi.sampling import run as sampling_run
from stochvi.sampling.calculations import FULL_LANES, GivenUp
from stochvi.sampling.checkpoints import LONG_SECONDS, Checkpoint
from stochvi.sampling.run import Run
from stochvi.sampling.workers import pool_of
from stochvi.scenes import Pulses
from stochvi.scenes.datasets import shipped_scene, zoo_files
from stochvi.scenes.excitations import ConstantLoad
from stochvi.testing import assert_agrees
from support.known import oscillator as oscillator_of_known
from support.known import to_toml


def plan_of(duration: float) -> Plan:
    return make_plan(model_of(oscillator_of_known(-1.0, 1.0, 0.5)), None, duration)


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


SCATTERED = Restitution(coefficient={"mean": 0.5, "std": 0.25})


def drawn(structure: Any, on: str, *excitations: Any) -> Scene:
    pair = ImpactPair(on=on, lower=-1.0, upper=1.0, law=SCATTERED)
    return Scene(structure=structure, impact_pairs=[pair], excitations=excitations)


ONE = Oscillator(mass=1.0, damping=0.1, stiffness=1.0)
TWO = Matrices(
    coordinates=["x", "z"], mass=np.eye(2), damping=0.1 * np.eye(2), stiffness=np.diag([1.0, 2.0])
)
DRAWN = {
    "pulses": drawn(ONE, "x", Pulses(rate=0.7, impulse=0.5), WhiteNoise(intensity=0.1)),
    "scatter": drawn(ONE, "x", WhiteNoise(intensity=0.2)),
    "scatter of two": drawn(TWO, "x", *(WhiteNoise(intensity=0.2, on=name) for name in "xz")),
}
"""Scenes in which numbers of a path are drawn at its impacts or pulses."""

SCENES = {
    "white noise": zoo_files()["lossy-0.5"],
    "stops that give way": zoo_files()["spring-stops"],
    "two masses": shipped_scene("absorber-in-a-box"),
    "tables": shipped_scene("isolator-bumper"),
    "a box": shipped_scene("rigid-box"),
} | DRAWN
"""Scenes by what is special in their kernels."""

MORE_SCENES = {
    name: zoo_files()[name]
    for name in (
        "viscoelastic-stops", "chain-viscoelastic-stops", "psd-truck-elastic", "psd-spring-stops"
    )
}  # fmt: skip


def short_plan(name: str, refined: bool = False) -> Any:
    scene = (SCENES | MORE_SCENES)[name]
    model = model_of(scene if isinstance(scene, Scene) else load_scene(scene))
    plan = make_plan(model, None, None, refined)
    duration = {"tables": 2.5 * plan.duration, "a box": 1.5 * plan.duration}.get(
        name, 30 * plan.step
    )
    return make_plan(model, None, duration, refined)


@pytest.mark.parametrize("name", SCENES | MORE_SCENES)
def test_digits_of_a_path_do_not_depend_on_its_block(name: str) -> None:
    plan = short_plan(name)
    whole = plan.averages(4, 0, 40)
    parts = [plan.averages(4, first, count) for first, count in ((0, 1), (1, 32), (33, 7))]
    np.testing.assert_array_equal(whole, np.concatenate(parts, axis=1))


@pytest.mark.parametrize("refined", [False, True])
@pytest.mark.parametrize("name", SCENES)
def test_digits_do_not_depend_on_where_a_path_is_cut(name: str, refined: bool) -> None:
    if refined and name != "white noise":
        return
    plan = short_plan(name, refined)
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

    def counted(self: WhitePlan, seed: int, first_path: int, paths: int, *rest: Any) -> WhitePaths:
        if not rest:  # trials of the price ask for averages at once
            sizes.append(paths)
        return WhitePaths(self, seed, first_path, paths, *rest[:2])

    monkeypatch.setattr(WhitePlan, "begin", counted)
    simulate(oscillator_of_known(-1.0, 1.0, 0.5), paths=130, duration=2e5, threads=1, budget=1e6)
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
    scene = oscillator_of_known(-1.0, 1.0, 0.5)
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
    monkeypatch.setattr(choose_plan, "thread_seconds", lambda: clock[0])
    price = choose_plan.seconds_of_first_paths(SlowPlan(100_000, clock), 0, Deadline.after(400.0))
    assert price == pytest.approx(100.0) and clock[0] < 4.0 * choose_plan.MOST_PRICE


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
    monkeypatch.setattr(choose_plan, "thread_seconds", lambda: clock[0])
    plan, deadline = SlowStart(10_000, clock), Deadline.after(400.0)
    assert choose_plan.seconds_of_first_paths(plan, 0, deadline) == pytest.approx(11.0)
    assert clock[0] < 10.0
    # no more is tried once the first trial takes longer than there is time
    assert choose_plan.seconds_of_first_paths(plan, 0, Deadline.after(0.5)) > 0.5


@pytest.mark.parametrize("name", ["isolator-bumper", "rigid-box"])
def test_the_price_of_synthesised_paths_is_not_that_of_their_first_samples(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a slow machine a block of three samples seemed to make 7000 as dear as 2000 blocks."""
    dear = choose_plan.MOST_PRICE
    monkeypatch.setattr(choose_plan, "_seconds_of", lambda plan, *_: dear * plan.steps_per_path)
    deadline = Deadline.after(1000.0)
    synthesised = make_plan(model_of(load_scene(shipped_scene(name))))
    assert choose_plan.seconds_of_first_paths(synthesised, 0, deadline) == 0.0
    assert choose_plan.seconds_of_first_paths(plan_of(2e3), 0, deadline) > 1.0  # in steps


def test_paths_are_not_begun_after_ctrl_c() -> None:
    deadline = Deadline.after(60.0)
    with graceful_interrupt():
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(Interrupted, match="before any path"):
            check_price([plan_of(2e3)], 3, deadline)


def test_ctrl_c_in_the_pilot_keeps_its_paths(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are the answer so far, with the seed that was asked for, and agree with a whole run."""
    add_paths = monte_carlo.Simulation.add_paths

    def pressed(self: monte_carlo.Simulation, *asked: Any, **more: Any) -> bool:
        found = add_paths(self, *asked, **more)
        if self.seed == monte_carlo.PILOT_SEED:
            signal.raise_signal(signal.SIGINT)
        return found

    scene = oscillator_of_known(-1.0, 1.0, 0.5)
    with monkeypatch.context() as patched:
        patched.setattr(monte_carlo.Simulation, "add_paths", pressed)
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

    def biased(run: monte_carlo.Simulation, errors: float) -> float:
        return 1.0 if run.plan.step > halved else 0.0

    scene, fractions = oscillator_of_known(-1.0, 1.0, 0.5), list[float]()
    halved = 0.6 * make_plan(model_of(scene)).step
    monkeypatch.setattr(monte_carlo, "largest_bias", biased)
    monkeypatch.setattr(sampling_run, "REPORT_SECONDS", 0.0)
    found = simulate(
        scene, rel_error=0.002, threads=1, progress=lambda done, _: fractions.append(done)
    )
    assert any(f"step {halved / 1.2:.3g} s" in each for each in found.assumptions)
    assert fractions[-1] > 0.9 and fractions == sorted(fractions)


@pytest.mark.slow
def test_the_seed_does_not_decide_the_scheme() -> None:
    """One stop at rest: the plain step leaves 1.6 % in F1, and rates that are 12 % too low."""
    scene, seeds, asked = oscillator_of_known(0.0, None, 0.3), range(6), 0.0125
    plan = make_plan(model_of(scene))
    with pool_of(None, 1) as pool:
        run = Run(pool, NEVER)
        runs = [monte_carlo.Simulation(scene, plan, run, 0.0, seed) for seed in seeds]
        own = set()
        for each in runs:
            monte_carlo.choose_step(each, asked)
            again = monte_carlo.Simulation(scene, plan, run, 0.0, each.seed)
            again.add_paths(1024)
            own.add(monte_carlo.largest_bias(again, 1.0) > asked)
    assert len({each.plan for each in runs}) == 1 and runs[0].plan.slow_impacts
    assert own == {False, True}  # negative control: by its own paths each run was lucky or not


def test_the_choice_of_the_step_has_a_quarter_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """It used to have all of it: the answer then rested on what was under way at its end."""
    ends: dict[bool, float] = {}
    add_paths = monte_carlo.Simulation.add_paths

    def noted(self: monte_carlo.Simulation, *asked: Any, **more: Any) -> bool:
        ends.setdefault(self.seed == monte_carlo.PILOT_SEED, self.run.deadline.due)
        return add_paths(self, *asked, **more)

    monkeypatch.setattr(monte_carlo.Simulation, "add_paths", noted)
    began = Deadline.after(1e5)
    simulate(oscillator_of_known(-1.0, 1.0, 0.5), rel_error=0.2, budget=1e5)
    pilot, run = ends[True], ends[False]
    assert run - pilot == pytest.approx(0.75 * (run - (began.due - 1e5)), rel=0.01)


# ------------------------------------------------------------------------------
# Where a checkpoint may be written, what it may replace, and what is no end of a run.
# ------------------------------------------------------------------------------


ASKED = {"paths": 64, "duration": 10.0, "seed": 4}


def oscillator() -> Scene:
    pair = ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[pair],
        excitations=[WhiteNoise(intensity=0.2)],
    )


def paths_in(kept: Path) -> int:
    return sum(each.paths for each in Checkpoint.read(kept).samples.values())


# ---- what is there ----------------------------------------------------------------------------


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the file system has no named pipes")
def test_nothing_but_a_checkpoint_is_replaced(tmp_path: Path) -> None:
    scene_file, fifo = tmp_path / "scene.toml", tmp_path / "fifo"
    scene_file.write_text("[structure]\n")
    os.mkfifo(fifo)
    (tmp_path / "link").symlink_to(scene_file)
    for there in (scene_file, fifo, tmp_path / "link"):
        with pytest.raises(CheckpointError, match="is no checkpoint of stochvi; name another file"):
            simulate(oscillator(), **ASKED, checkpoint=there)
        if there != fifo:
            assert there.read_text() == "[structure]\n"
    assert fifo.is_fifo() and (tmp_path / "link").is_symlink()
    with pytest.raises(CheckpointError, match="is a folder; name a file in it"):
        simulate(oscillator(), **ASKED, checkpoint=tmp_path)
    for there in (fifo, tmp_path):  # nor is one read
        with pytest.raises(CheckpointError, match="is not a checkpoint of stochvi"):
            simulate(oscillator(), resume=there)
    for name in ("checkpoint", "resume"):
        with pytest.raises(ValueError, match=f"{name} must name a file, got ''"):
            simulate(oscillator(), **ASKED, **{name: ""})


def test_a_link_is_followed_and_an_empty_file_is_filled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # else a busy machine, on which a run takes longer, keeps the checkpoint as `there.earlier`
    monkeypatch.setattr(checkpoints, "LONG_SECONDS", math.inf)
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "there")
    (tmp_path / "empty").touch()
    for kept in (link, link, tmp_path / "empty"):  # the second time there is a checkpoint
        simulate(oscillator(), **ASKED, checkpoint=kept)
        assert paths_in(kept) == 64
    assert link.is_symlink()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "link", "there"]


def test_what_took_long_is_kept_as_earlier(tmp_path: Path) -> None:
    kept, earlier = tmp_path / "run", tmp_path / "run.earlier"

    def rerun(seconds: float) -> None:
        """After a run that took so long."""
        simulate(oscillator(), **ASKED, checkpoint=kept)
        found = Checkpoint.read(kept)
        found.seconds = seconds
        found.write()
        simulate(oscillator(), **ASKED, checkpoint=kept)

    rerun(0.5 * LONG_SECONDS)
    assert not earlier.exists()
    for seconds, longest in ((3.0, 3.0), (2.0, 3.0), (4.0, 4.0)):
        rerun(seconds * LONG_SECONDS)
        assert Checkpoint.read(earlier).seconds == longest * LONG_SECONDS
    assert Checkpoint.read(kept).seconds < LONG_SECONDS
    simulate(oscillator(), resume=earlier)  # that goes on is no new run: it stays where it is
    assert earlier.exists()


def test_two_runs_on_one_checkpoint_do_not_end_each_other(tmp_path: Path) -> None:
    ended = []

    def run() -> None:
        simulate(
            oscillator(), paths=8000, duration=10.0, threads=1, checkpoint=tmp_path / "run",
            checkpoint_interval=1e-4,
        )  # fmt: skip
        ended.append(paths_in(tmp_path / "run"))

    both = [threading.Thread(target=run) for _ in range(2)]
    for each in both:
        each.start()
    for each in both:
        each.join()
    assert len(ended) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


# ---- a disk that fills up ---------------------------------------------------------------------


class FullDisk:
    """Stands for `write_whole`: it works so often, and then there is no room."""

    def __init__(self, writes: int) -> None:
        self.left = writes

    def __call__(self, data: bytes, path: Path, *, durable: bool = False) -> None:
        self.left -= 1
        if self.left < 0:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        write_whole(data, path, durable=durable)


def test_a_disk_that_fills_up_costs_no_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def warned(response) -> bool:
        return any("run could not be written: no space left" in each for each in response.warnings)

    def interrupts(done: float, text: str) -> None:
        raise KeyboardInterrupt

    kept = tmp_path / "run"
    fine = simulate(oscillator(), **ASKED, checkpoint=kept)
    monkeypatch.setattr(checkpoints, "write_whole", FullDisk(writes=1))
    full = simulate(oscillator(), **ASKED, checkpoint=kept)
    assert warned(full) and not warned(fine)
    assert full.coordinates == fine.coordinates
    assert paths_in(kept) == 0  # whole, as it was first written
    monkeypatch.setattr(checkpoints, "write_whole", FullDisk(writes=1))
    with pytest.raises(Interrupted) as stopped:
        simulate(oscillator(), **ASKED, checkpoint=kept, progress=interrupts)
    assert stopped.value.partial.interrupted and warned(stopped.value.response)
    monkeypatch.setattr(checkpoints, "write_whole", FullDisk(writes=1))
    with pytest.raises(NotConverged) as short:
        simulate(oscillator(), rel_error=1e-4, budget=1e-3, checkpoint=kept)
    assert warned(short.value.partial)
    monkeypatch.setattr(checkpoints, "write_whole", FullDisk(writes=0))
    with pytest.raises(CheckpointError, match=r"run cannot be written: no space left"):
        simulate(oscillator(), **ASKED, checkpoint=kept)


def test_a_folder_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"nope/run cannot be written: no such file"):
        simulate(oscillator(), **ASKED, checkpoint=tmp_path / "nope" / "run")


# ---- what is asked, and what was written ------------------------------------------------------


def test_the_price_of_more_accuracy_counts_the_time_before_a_resume(tmp_path: Path) -> None:
    kept = tmp_path / "run"
    simulate(oscillator(), checkpoint=kept, **ASKED)
    cost = simulate(oscillator(), resume=kept, **ASKED).cost
    assert cost.tenfold_wall_time == pytest.approx(100.0 * cost.wall_time)


def test_numbers_of_numpy_are_numbers(tmp_path: Path) -> None:
    asked = {"paths": np.int64(64), "duration": np.float32(10.0), "seed": np.int64(4)}
    numpy = simulate(oscillator(), **asked, checkpoint=tmp_path / "run")
    assert numpy.coordinates == simulate(oscillator(), **ASKED).coordinates
    assert simulate(oscillator(), resume=tmp_path / "run", **asked).cost.paths == 64
    simulate(oscillator(), rel_error=np.float32(0.2), checkpoint=tmp_path / "other")
    for wrong in (64.0, np.float64(64.0)):
        with pytest.raises(ValueError, match="paths must be a whole number"):
            simulate(oscillator(), paths=wrong)


def test_another_format_and_missing_keys_are_said(tmp_path: Path) -> None:
    kept = tmp_path / "run"
    simulate(oscillator(), **ASKED, checkpoint=kept)
    text = kept.read_bytes()
    kept.write_bytes(text.replace(b"checkpoint 11", b"checkpoint 12", 1))
    with pytest.raises(CheckpointError, match=r"another version of stochvi \(format 12, here 11\)"):
        simulate(oscillator(), resume=kept)
    whole = json.loads(text.partition(b"\n")[2])
    ((name, entry),) = whole["samples"].items()
    fields = entry["sample"]["fields"]
    for document in (
        {"scene": {}},
        [],
        whole | {"more": 1},
        whole | {"scene": [1]},
        whole | {"proof": None},
        whole | {"seconds": -1.0},
        {key: whole[key] for key in whole if key != "samples"},
        *(
            whole | {"samples": {name: changed}}
            for changed in (
                {key: entry[key] for key in entry if key != "paths"},
                entry | {"paths": "64"},
                entry | {"paths": True},
                entry | {"paths": -1},
                entry | {"goal": 1e3},
                entry | {"machines": "abc"},
                entry | {"more": 1},
                entry | {"sample": {"record": "os:system", "fields": {}}},
                entry | {"sample": entry["sample"] | {"fields": {"fine": fields["fine"]}}},
            )
        ),
    ):
        body = json.dumps(document).encode()
        header = f"stochvi checkpoint 11 {hashlib.sha256(body).hexdigest()}\n".encode()
        kept.write_bytes(header + body)
        with pytest.raises(CheckpointError, match="does not hold what a checkpoint"):
            simulate(oscillator(), resume=kept)
    nested = b'{"scene": ' + b"[" * 100_000 + b"]" * 100_000 + b"}"
    for body in (nested, b"{", b"\xff", text.partition(b"\n")[2].replace(b"0.", b"NaN, 0.", 1)):
        digest = hashlib.sha256(body).hexdigest()
        kept.write_bytes(f"stochvi checkpoint 11 {digest}\n".encode() + body)
        with pytest.raises(CheckpointError, match="does not hold what a checkpoint"):
            simulate(oscillator(), resume=kept)


def test_a_damaged_checkpoint_is_kept_aside_with_a_word(tmp_path: Path) -> None:
    kept = tmp_path / "run"
    simulate(oscillator(), **ASKED, checkpoint=kept)
    cut = kept.read_bytes()[:-100]
    kept.write_bytes(cut)
    with pytest.warns(UserWarning, match=r"run is damaged.*renamed to run\.damaged"):
        simulate(oscillator(), **ASKED, checkpoint=kept)
    assert (tmp_path / "run.damaged").read_bytes() == cut
    assert paths_in(kept) == 64


# ---- executors that are none, and Ctrl-C ------------------------------------------------------


class Refuses(Executor):
    def __init__(self, error: Exception) -> None:
        self.error = error

    def submit(self, *arguments):
        raise self.error


class Forgets(ThreadPoolExecutor):
    def submit(self, *arguments):
        return super().submit(lambda: None)


@pytest.mark.parametrize("error", [OSError("a"), ConnectionError("b"), ValueError("c")])
def test_an_executor_that_takes_no_work_is_said(error: Exception) -> None:
    with pytest.raises(NotConverged, match=f"takes no more work \\({type(error).__name__}: "):
        simulate(oscillator(), **ASKED, executor=Refuses(error))


def test_what_is_no_executor_or_gives_no_answer_is_said() -> None:
    with pytest.raises(ValueError, match=r"executor must be a concurrent.futures.Executor.* got 4"):
        simulate(oscillator(), **ASKED, executor=4)
    with Forgets(1) as executor, pytest.raises(NotConverged, match="returned NoneType, not"):
        simulate(oscillator(), **ASKED, executor=executor)


SCENE = to_toml(oscillator_of_known(None, 1.0).document())


def interrupts(*arguments: object, **named: object) -> None:
    raise KeyboardInterrupt


def test_control_c_while_the_code_is_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    kept = tmp_path / "run"
    # the package's `simulate` is the function
    monkeypatch.setattr(sys.modules["stochvi.methods.monte_carlo"], "compiled", interrupts)
    with pytest.raises(Interrupted, match="before any path") as stopped:
        simulate(oscillator(), **ASKED)
    assert stopped.value.partial is None
    ask = ["simulate", str(tmp_path / "scene.toml"), "--paths", "64", "--checkpoint", str(kept)]
    done = CliRunner().invoke(main, ask)
    assert done.exit_code == 1 and done.stdout == ""
    said = "stochvi: interrupted by Ctrl-C before any path was simulated"
    assert done.stderr == f"{said}; go on with --resume {kept}\n"
    monkeypatch.undo()
    assert CliRunner().invoke(main, [*ask[:2], "--resume", str(kept)]).exit_code == 0


@pytest.mark.parametrize(
    ("command", "method"),
    [
        ("check", "stochvi.verification.check.check"),
        ("spectrum", "stochvi.statistics.spectra.spectrum"),
        ("impacts", "stochvi.statistics.impacts.impacts"),
        ("damage --mission 10", "stochvi.statistics.damage.damage"),
        ("reliability --mission 10", "stochvi.statistics.reliability.reliability"),
    ],
)
def test_control_c_ends_a_command_with_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, method: str
) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    monkeypatch.setattr(method, interrupts)
    done = CliRunner().invoke(main, [*command.split(), str(tmp_path / "scene.toml")])
    assert (done.exit_code, done.stdout) == (1, "")
    assert done.stderr == "stochvi: interrupted by Ctrl-C; nothing was kept\n"
