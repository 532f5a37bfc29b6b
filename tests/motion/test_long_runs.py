"""Long runs: nothing lost in a crash, on any executor, and the same digits as one never stopped."""

import importlib
import json
import math
import os
import random
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
)
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st
from threadpoolctl import threadpool_info, threadpool_limits

from stochvi.cli import main, program
from stochvi.methods.monte_carlo import simulate
from stochvi.motion import white
from stochvi.results.base import Response
from stochvi.results.errors import CheckpointError, Interrupted, NotConverged
from stochvi.sampling import run as sampling_run
from stochvi.sampling import workers
from stochvi.sampling.calculations import blocks_of
from stochvi.sampling.checkpoints import Checkpoint
from stochvi.sampling.workers import SENDING_SECONDS, TASK_SECONDS, WINDOW, WorkerPool, one_thread
from stochvi.scenes.excitations import TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Restitution
from stochvi.scenes.scene import ImpactPair, Scene, load_scene
from stochvi.scenes.structures import Isolator
from support.commands import killed_at_its_first_sample
from support.known import oscillator as between_stops
from support.known import to_toml
from support.refusals import refusals


def oscillator(restitution: float = 0.8) -> Scene:
    return between_stops(-1.0, 1.0, restitution)


SCENE = to_toml(oscillator().document())


def digits(response: Response) -> dict[str, object]:
    """All that must not depend on how the run was made."""
    document = response.to_dict()
    document["provenance"].pop("call")
    return document | {
        "cost": {key: document["cost"][key] for key in ("steps", "impacts", "paths")}
    }


class Stops:
    """Progress that presses Ctrl-C at the n-th block."""

    def __init__(self, number: int) -> None:
        self.left = number

    def __call__(self, done: float, text: str) -> None:
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt


# ---- a run that goes on is the run that never stopped ------------------------------------------


def stopped(reason: Interrupted) -> None:
    """It is a valid response, and says that it was stopped."""
    assert reason.response.interrupted
    assert any("interrupted" in warning for warning in reason.response.warnings)
    assert json.dumps(reason.response.to_dict(), allow_nan=False)


@pytest.mark.verify
def test_stopped_again_and_again_it_ends_with_the_same_digits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over rounds that grow, and a step that is so long that it is refined on the way."""
    monkeypatch.setattr(white, "LOSSY_ANGLE", 0.9)
    monkeypatch.setattr(white, "LOSSY_DECAY", 0.2)
    monkeypatch.setattr(sampling_run, "REPORT_SECONDS", 0.0)  # progress is told of each block
    scene, kept = oscillator(), tmp_path / "run"
    asked = {"rel_error": 0.0007, "seed": 5}
    whole = simulate(scene, **asked)
    stops, samplers, resume, response = 0, set(), None, None
    while response is None:
        try:
            response = simulate(scene, **asked, checkpoint=kept, resume=resume, progress=Stops(3))
        except Interrupted as reason:
            stopped(reason)
            stops, resume = stops + 1, kept
            samplers.add(len(Checkpoint.read(kept).samples))
    assert stops > 8
    assert max(samplers) >= 3  # two pilots, before and after the step was halved, and the answer
    assert digits(response) == digits(whole)
    assert not response.interrupted


def test_a_number_of_paths_and_a_table(tmp_path: Path) -> None:
    pair = ImpactPair(lower=-0.004, upper=0.004, law=Restitution(coefficient=0.5))
    table = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    mount = Isolator(frequency_hz=12.0, zeta=0.1)
    scene = Scene(structure=mount, impact_pairs=[pair], excitations=[table])
    whole = simulate(scene, paths=100, duration=20.0, seed=2)
    with pytest.raises(Interrupted):
        simulate(
            scene, paths=100, duration=20.0, seed=2, checkpoint=tmp_path / "a", progress=Stops(1)
        )
    response = simulate(scene, resume=tmp_path / "a", checkpoint=tmp_path / "b")
    assert digits(response) == digits(whole)
    assert paths_in(tmp_path / "a") < 100
    again = simulate(scene, resume=tmp_path / "b")  # that of a run that ended
    assert digits(again) == digits(whole)


def test_a_budget_that_ran_out_is_no_end(tmp_path: Path) -> None:
    scene, kept = oscillator(), tmp_path / "run"
    with pytest.raises(NotConverged):
        simulate(scene, rel_error=0.002, seed=5, budget=1e-3, checkpoint=kept)
    whole = simulate(scene, rel_error=0.002, seed=5)
    assert digits(simulate(scene, resume=kept)) == digits(whole)


def test_a_checkpoint_is_there_before_the_first_block(tmp_path: Path) -> None:
    kept, seen = tmp_path / "run", []

    class Looks(ThreadPoolExecutor):
        def submit(self, *arguments, **named):
            seen.append(paths_in(kept))
            return super().submit(*arguments, **named)

    with Looks(1) as executor:
        simulate(oscillator(), paths=64, executor=executor, checkpoint=kept)
    assert seen == [0]
    assert paths_in(kept) == 64


# ---- what is refused ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("kept") / "run"
    simulate(oscillator(), paths=100, duration=10.0, seed=7, checkpoint=path)
    return path


@given(place=st.floats(0.0, 1.0, exclude_max=True), flip=st.integers(1, 255))
def test_any_byte_that_changed_is_noticed(kept: Path, place: float, flip: int) -> None:
    text = bytearray(kept.read_bytes())
    text[int(place * len(text))] ^= flip
    damaged = kept.with_name("damaged")
    damaged.write_bytes(text)
    with pytest.raises(CheckpointError) as refusal:
        Checkpoint.read(damaged)
    assert "\n" not in str(refusal.value)


@given(share=st.floats(0.0, 1.0, exclude_max=True))
def test_any_end_that_is_missing_is_noticed(kept: Path, share: float) -> None:
    text = kept.read_bytes()
    damaged = kept.with_name("short")
    damaged.write_bytes(text[: int(share * len(text))])
    with pytest.raises(CheckpointError):
        Checkpoint.read(damaged)


def test_the_checkpoint_itself_is_taken(kept: Path) -> None:
    """The control of the two above."""
    assert paths_in(kept) == 100
    for given_again in ({}, {"seed": 7}, {"paths": 100}, {"duration": 10.0, "seed": 7}):
        assert simulate(oscillator(), resume=kept, **given_again).cost.paths == 100


test_another_question_is_refused = refusals(
    lambda kept, given_now: simulate(oscillator(), resume=kept, **given_now),
    ({"seed": 8}, "seed 7, not 8"),
    ({"paths": 200}, "paths 100, not 200"),
    ({"duration": 20.0}, "duration 10.0, not 20.0"),
    ({"rel_error": 0.1}, "of a run with 100 paths, not with rel_error 0.1; leave rel_error out"),
    error=CheckpointError,
)


def test_another_scene_is_refused_by_the_key_that_differs(kept: Path) -> None:
    with pytest.raises(CheckpointError, match=r"impact_pair.0.law.coefficient is 0.8 in it, 0.7 h"):
        simulate(oscillator(0.7), resume=kept)
    scene = Scene(structure=oscillator().structure, excitations=[WhiteNoise(intensity=0.2)])
    with pytest.raises(CheckpointError, match="another scene"):
        simulate(scene, resume=kept)


def test_another_version_or_processor_is_refused(kept: Path, tmp_path: Path) -> None:
    found = Checkpoint.read(kept)
    other = found.machine.replace("numpy ", "numpy 0.")
    found.model_copy(update={"path": tmp_path / "other", "machine": other}).write()
    with pytest.raises(CheckpointError, match="another version or processor"):
        simulate(oscillator(), resume=tmp_path / "other")


def test_a_table_that_changed_is_another_scene(tmp_path: Path) -> None:
    def scene(density: float) -> Scene:
        (tmp_path / "table.csv").write_text(f"5, {density}\n500, 0.01\n")
        noise = TabulatedNoise(file=str(tmp_path / "table.csv"), unit="g2/Hz")
        return Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[noise])

    simulate(scene(0.01), paths=8, duration=5.0, checkpoint=tmp_path / "run")
    simulate(scene(0.01), resume=tmp_path / "run")
    for _ in range(2):  # to be refused changes nothing
        with pytest.raises(CheckpointError, match="a file that the scene names has changed"):
            simulate(scene(0.02), resume=tmp_path / "run")
    simulate(scene(0.01), resume=tmp_path / "run")


# ---- executors ---------------------------------------------------------------------------------


class Flaky(Executor):
    """Loses one task in three, or is told that it was cancelled; remembers what it did."""

    def __init__(self, seed: int, broken_after: int | None = None) -> None:
        self.random, self.broken_after = random.Random(seed), broken_after
        self.open = self.most_open = self.lost = self.done = 0

    def submit(self, function, *arguments):
        if self.broken_after is not None and self.done >= self.broken_after:
            raise BrokenExecutor("all workers died")
        self.open += 1
        self.most_open = max(self.most_open, self.open)
        return Later(self, function, arguments)


class Later(Future):
    """Done, or lost, when it is asked for."""

    def __init__(self, executor: Flaky, function, arguments) -> None:
        super().__init__()
        self.executor, self.call = executor, (function, arguments)

    def cancel(self) -> bool:
        self.executor.open -= 1
        return True

    def result(self, timeout=None):
        self.executor.open -= 1
        if self.executor.random.random() < 1 / 3:
            self.executor.lost += 1
            raise self.executor.random.choice([ConnectionError("lost"), CancelledError()])
        self.executor.done += 1
        function, arguments = self.call
        return function(*arguments)


def test_blocks_that_are_lost_are_done_again_and_counted_once() -> None:
    scene = oscillator()
    here = simulate(scene, paths=20_000, duration=20.0, seed=4)
    executor = Flaky(seed=1)
    there = simulate(scene, paths=20_000, duration=20.0, seed=4, executor=executor, threads=3)
    assert executor.lost > 3
    assert digits(there) == digits(here)
    assert executor.most_open <= WINDOW * 3 + 1


def test_an_executor_that_dies_says_so_and_the_run_goes_on_elsewhere(tmp_path: Path) -> None:
    scene, kept = oscillator(), tmp_path / "run"
    with pytest.raises(NotConverged, match="takes no more work") as reason:
        simulate(
            scene, paths=20_000, duration=20.0, seed=4, executor=Flaky(2, broken_after=1),
            threads=1, checkpoint=kept,
        )  # fmt: skip
    assert 0 < reason.value.partial.cost.paths < 20_000
    whole = simulate(scene, paths=20_000, duration=20.0, seed=4)
    assert digits(simulate(scene, resume=kept)) == digits(whole)


def test_an_error_of_its_own_threads_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*arguments):
        raise AssertionError("a mistake")

    monkeypatch.setattr(workers, "do_task", fails)
    with pytest.raises(AssertionError):
        simulate(oscillator(), paths=64)
    with ThreadPoolExecutor(1) as executor, pytest.raises(NotConverged, match="failed 4 times"):
        simulate(oscillator(), paths=64, executor=executor)


def test_a_task_that_is_late_is_begun_again_and_counted_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A worker that hangs: somebody else does its task, and the run does not wait for it."""
    monkeypatch.setattr(workers, "LOOK_SECONDS", 0.02)
    hangs, begun = threading.Event(), []

    class Hangs(ThreadPoolExecutor):
        def submit(self, function, *arguments):
            first, _ = arguments[1][0]
            begun.append(arguments[4])
            if first == 5 * 1024 and arguments[4] == 1:
                return super().submit(hangs.wait, 60.0)
            return super().submit(function, *arguments)

    monkeypatch.setattr(workers, "SENDING_SECONDS", 0.0)
    monkeypatch.setattr(workers, "TASK_SECONDS", 1e-9)  # a block to a task
    with Hangs(4) as executor:
        there = simulate(oscillator(), paths=8 * 1024, duration=20.0, seed=4, executor=executor)
        hangs.set()
    assert 2 in begun  # the second attempt
    assert digits(there) == digits(simulate(oscillator(), paths=8 * 1024, duration=20.0, seed=4))


def test_a_mixed_cluster_is_said() -> None:
    class Mixed(ThreadPoolExecutor):
        def submit(self, function, *arguments):
            first, _ = arguments[1][0]

            def elsewhere():
                done = function(*arguments)
                return done._replace(machine="an older one") if first else done

            return super().submit(elsewhere)

    with Mixed(1) as executor:
        response = simulate(oscillator(), paths=4096, duration=10.0, executor=executor)
    (warning,) = (warning for warning in response.warnings if "machines" in warning)
    assert "2 kinds" in warning and "an older one" in warning


def test_blocks_to_a_task_never_show() -> None:
    """Tasks for other machines hold several blocks once it is known how long one takes."""
    with ThreadPoolExecutor(1) as executor:
        pool = WorkerPool(executor, 1, external=True)
        assert pool.per_task(1000) == pool.window == 1  # to know how long a block takes
        pool.block_seconds = TASK_SECONDS / 10.0
        assert (pool.per_task(1000), pool.window) == (10, WINDOW)
        pool.workers = 200
        assert pool.per_task(1000) == math.ceil(math.sqrt(1000 * SENDING_SECONDS / 0.05))
        assert pool.per_task(4000) == 20  # some for everybody
        assert WorkerPool(executor, 1, external=False, block_seconds=1e-3).per_task(1000) == 1
        far = simulate(oscillator(), paths=30_000, duration=1.0, seed=3, executor=executor)
    assert digits(far) == digits(simulate(oscillator(), paths=30_000, duration=1.0, seed=3))


@pytest.mark.parametrize("real", [True, False])
def test_the_cluster_of_the_study_does_what_an_executor_does(real: bool) -> None:
    study = importlib.import_module("studies.15_plan_past_this_machine.cluster")
    cluster = study.Cluster(7, block_seconds=0.1, sending=0.0, late=0.1, lost=0.5, real=real)
    asked = {"paths": 40 * 1024, "duration": 2.0, "seed": 1}
    there = simulate(oscillator(), executor=cluster, threads=7, **asked)
    assert cluster.again > 0
    assert (digits(there) == digits(simulate(oscillator(), **asked))) == real


def test_blocks_start_at_multiples_of_their_size() -> None:
    assert list(blocks_of(5, 25, 8)) == [(5, 3), (8, 8), (16, 8), (24, 1)]


def test_dask_with_a_worker_killed_in_mid_run() -> None:
    """Two worker processes, one killed: same digits, nothing counted twice."""
    distributed = pytest.importorskip("distributed")
    scene = oscillator()
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        workers = [nanny["pid"] for nanny in client.run(_process).values()]
        killed = []

        def kill(done: float, text: str) -> None:
            if done > 0.3 and not killed:
                killed.append(subprocess.run(["kill", "-9", str(workers[0])], check=True))

        there = simulate(
            scene, paths=100_000, duration=100.0, seed=4, executor=client.get_executor(),
            progress=kill,
        )  # fmt: skip
        assert killed
        assert sorted(process["pid"] for process in client.run(_process).values()) != sorted(
            workers
        )
    assert digits(there) == digits(simulate(scene, paths=100_000, duration=100.0, seed=4))


def _process() -> dict[str, int]:
    return {"pid": os.getpid()}


# ---- the command line, and real kills ----------------------------------------------------------


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "stochvi", *map(str, arguments)]


def invoked(folder: Path, *arguments: object) -> Result:
    """`stochvi simulate` of the scene, in this process."""
    scene = folder / "scene.toml"
    scene.write_text(SCENE)
    return CliRunner().invoke(main, ["simulate", str(scene), *map(str, arguments)])


def answer(path: Path) -> dict[str, object]:
    """The JSON document without what the clock says."""
    document = json.loads(path.read_text(encoding="utf-8"))
    assert not document.pop("interrupted")
    document["provenance"].pop("call")
    return document | {
        "cost": {key: document["cost"][key] for key in ("steps", "impacts", "paths")}
    }


def killed_at_random(
    folder: Path, paths: int, kills: int, progress: float, interval: float
) -> None:
    """A job killed -9 so often, after some seconds of progress, ends as one never killed.

    The moments are random from the start of the process on: some come before it has done anything.
    They are moments of its CPU time, so that other work on the machine changes none.
    """
    scene, kept = folder / "scene.toml", folder / "run.checkpoint"
    scene.write_text(SCENE)
    alone = ["--threads", 1, "--quiet"]
    job = ["--paths", paths, "--duration", 2000, "--seed", 11]
    whole = ["--json", folder / "whole.json", "--checkpoint", folder / "other"]
    spent = cpu_of_children()
    with subprocess.Popen(command("simulate", scene, *job, *alone, *whole)) as process:
        while not (folder / "other").exists():
            time.sleep(0.02)
        starting = cpu_of(process)
        assert process.wait() == 0
    print(f"never killed: {cpu_of_children() - spent:.1f} s of CPU, {starting:.1f} s to the start")
    spent, reached = cpu_of_children(), [0]
    latest = progress + 2.0 * starting
    for moment in np.random.default_rng(6).uniform(0.0, latest, kills):
        ask = ["--resume", kept] if kept.exists() else [*job, "--checkpoint", kept]
        ask += ["--checkpoint-interval", interval, *alone]
        with subprocess.Popen(command("simulate", scene, *ask)) as process:
            while cpu_of(process) < moment:
                assert process.poll() is None  # it is still at work
                time.sleep(0.01)
            process.kill()
        reached.append(paths_in(kept))
    assert reached == sorted(reached)
    assert reached[-1] < paths
    last = ["--resume", kept] if kept.exists() else job
    last += [*alone, "--json", folder / "killed.json"]
    subprocess.run(command("simulate", scene, *last), check=True)
    print(f"killed {kills} times: {cpu_of_children() - spent:.1f} s of CPU; paths kept: {reached}")
    assert answer(folder / "killed.json") == answer(folder / "whole.json")


def paths_in(kept: Path) -> int:
    return (
        sum(each.paths for each in Checkpoint.read(kept).samples.values()) if kept.exists() else 0
    )


def cpu_of(process: subprocess.Popen[bytes]) -> float:
    """CPU seconds of a process that runs, as Linux tells them."""
    fields = Path(f"/proc/{process.pid}/stat").read_text("utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def cpu_of_children() -> float:
    used = os.times()
    return used.children_user + used.children_system


@pytest.mark.slow
def test_a_killed_run_goes_on(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    kept, asked = tmp_path / "run", {"paths": 40_000, "duration": 100.0, "seed": 11}
    ask = ["--paths", 40_000, "--duration", 100, "--seed", 11, "--threads", 1, "--quiet"]
    ask += ["--checkpoint", kept, "--checkpoint-interval", 0.02]
    killed_at_its_first_sample("simulate", tmp_path / "scene.toml", *ask)
    assert 0 < paths_in(kept) < 40_000
    scene = load_scene(tmp_path / "scene.toml")
    assert digits(simulate(scene, resume=kept)) == digits(simulate(scene, **asked))


@pytest.mark.verify
@pytest.mark.skipif(not Path("/proc").exists(), reason="the CPU time of a process is not told")
def test_fifty_kills_of_two_minutes(tmp_path: Path) -> None:
    killed_at_random(tmp_path, paths=2_500_000, kills=50, progress=2.4, interval=1.0)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no process can send Ctrl-C to another there")
def test_control_c_ends_with_what_there_is(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE)
    job = command("simulate", scene, "--paths", 10**8, "--checkpoint", tmp_path / "run")
    job += ["--threads", "1", "--checkpoint-interval", "0.05"]
    with subprocess.Popen(
        [*job, "--json", "-"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=hears_control_c,
    ) as process:  # fmt: skip
        while paths_in(tmp_path / "run") < 2:
            time.sleep(0.02)
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        output, told = process.communicate()
        assert process.returncode == 1
    document = json.loads(output)
    assert document["interrupted"] and document["cost"]["paths"] > 2
    assert document["coordinates"]["x"]["displacement_std"]["standard_error"] > 0.0
    assert f"--resume {tmp_path / 'run'}" in told.splitlines()[-1]


def hears_control_c() -> None:
    """Also where the tests run in the background, which makes a shell ignore it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_progress_is_told_in_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where there is no terminal."""
    monkeypatch.setattr(program, "LINE_SECONDS", 0.0)
    monkeypatch.setattr(sampling_run, "REPORT_SECONDS", 0.0)
    told = invoked(tmp_path, "--paths", 4096, "--duration", 20).stderr
    assert any(
        "steps/s" in line and "error" in line and "impacts" in line and "s left" in line
        for line in told.splitlines()
    )


def test_no_line_of_progress_is_told_twice_in_a_row(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(program, "LINE_SECONDS", 0.0)
    with program.progress_bar(False, "simulating") as report:
        for text in ("compiling", "compiling", "row 1", "compiling"):
            report(0.0, text)
    told = [line.partition("%")[2].strip(", ") for line in capsys.readouterr().err.splitlines()]
    assert told == ["compiling", "row 1", "compiling"]


def test_a_refused_checkpoint_ends_with_code_2_and_one_sentence(tmp_path: Path, kept: Path) -> None:
    done = invoked(tmp_path, "--resume", kept, "--seed", 8)
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1 and "seed 7, not 8" in done.stderr


def test_linear_algebra_takes_no_core_from_the_paths() -> None:
    def threads() -> set[int]:
        return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}

    with threadpool_limits(2, user_api="blas"):
        assert threads() == {2}
        with one_thread():
            assert threads() == {1}
        assert threads() == {2}
