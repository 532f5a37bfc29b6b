"""All samplers have all of it: executors, checkpoints, budgets and Ctrl-C, with the same digits."""

from __future__ import annotations

import ast
import inspect
import json
import math
import os
import pickle
import re
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stochvi
from stochvi import load_scene, simulate
from stochvi.absorbers.design import design_absorber
from stochvi.absorbers.performance import absorber
from stochvi.cli import options as command_line
from stochvi.isolators import clearance_curve, sensitivity, size
from stochvi.isolators.sizing.review import clatter
from stochvi.isolators.sizing.risk_curve import chance_in_windows
from stochvi.isolators.tolerances import Tolerances
from stochvi.methods.periodic.attracted import basins
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import ResponseSampler, make_plan
from stochvi.results.deadline import Deadline, graceful_interrupt
from stochvi.results.errors import Interrupted, NotConverged
from stochvi.sampling.calculations import BUDGET, DEFAULTS, SamplingOptions, signature_of
from stochvi.sampling.run import Run
from stochvi.sampling.workers import WorkerPool, packed, unpacked
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.excitations import Modulation, TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Elastic, Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Isolator, Oscillator
from stochvi.statistics.clusters import BurstSampler, ClusterPaths, bursts
from stochvi.statistics.crossings import first_crossings
from stochvi.statistics.damage import damage
from stochvi.statistics.densities import densities
from stochvi.statistics.impacts import impacts
from stochvi.statistics.lifetimes import lifetimes
from stochvi.statistics.rare_hits import rare_hits
from stochvi.statistics.reliability import reliability
from stochvi.statistics.spectra import spectrum
from stochvi.statistics.stability import growth
from stochvi.sweeps import sweep
from stochvi.verification.cost import cost
from support import CHECKOUT
from support.pairs import pair, uncoupled

FREE = Scene(
    structure=Oscillator(mass=1.0, damping=0.2, stiffness=1.0),
    excitations=[WhiteNoise(intensity=0.2)],
)
STOPS = ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=0.8))
FAR = FREE.model_copy(
    update={"impact_pairs": (ImpactPair(lower=-2.5, upper=2.5, law=Elastic(stiffness=20.0)),)}
)
TRUCK = Scene(
    structure=Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0),
    impact_pairs=[ImpactPair(lower=-6e-3, upper=6e-3, law=Elastic(stiffness=5.7e5))],
    excitations=[TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")],
)
TWO = uncoupled(pair("x", "x", 1.0), pair("z", "z", 1.0))
STOPPED = FREE.model_copy(update={"impact_pairs": (STOPS,)})


BETWEEN = FREE.model_copy(
    update={"impact_pairs": (ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0)),)}
)


MOUNT = load_scene(shipped_scene("isolator-sine"))
NOISY_MOUNT = MOUNT.replace(excitations=(*MOUNT.excitations, WhiteNoise(intensity=0.1)))


def _simulate(**how: Any) -> object:
    return simulate(BETWEEN, **{"rel_error": 0.05, "seed": 3, "budget": None} | how).estimates()


def _rare_hits(**how: Any) -> object:
    asked = {"rel_error": 0.9, "seed": 3} | how
    found = rare_hits(FAR, "impact_speed", 1.5, mission=100.0, **asked)
    return found.chance, found.repetitions


def _windows(**how: Any) -> object:
    more = {} if how.pop("rel_error", None) is None else {"accepted": 0.4475}
    asked = {"accepted": 0.2, "seed": 3} | how | more
    return chance_in_windows(TRUCK, "impact_speed", 0.5, 60.0, **asked)


CARRIER = FREE.model_copy(update={"structure": Oscillator(mass=1.0, damping=0.02, stiffness=1.0)})


def _absorber(**how: Any) -> object:
    scene = load_scene(shipped_scene("absorber-on-a-tower"))
    found = absorber(
        scene, levels_db=[0.0], **{"rel_error": 0.2, "seed": 3, "budget": None} | how
    ).performances[0]
    return found.ratio, found.peak_factor


def _design(**how: Any) -> object:
    found = design_absorber(
        CARRIER, mass_budget=0.1, restitutions=[0.5], plays=[1, 2, 4, 8],
        **{"rel_error": 0.3, "seed": 3, "budget": None} | how,
    )  # fmt: skip
    return found.best.play, found.best.ratio


def _cost(**how: Any) -> object:
    paths = 1024 if how.pop("rel_error", None) is None else None
    found = cost(STOPPED, paths=paths, **{"seed": 3} | how)
    return [(row.step, row.value, row.standard_error, row.step_bias) for row in found.errors]


def _bursts(**how: Any) -> object:
    found = bursts(FAR, **{"rel_error": 0.5, "seed": 3, "budget": None} | how)
    return found.hit_rate(), found.path.tolist(), found.fastest.tolist()


def _clatter(**how: Any) -> object:
    return (
        clatter(TRUCK, [6e-3], **{"rel_error": 0.1, "seed": 3, "budget": None} | how)
        .to_numpy()
        .tobytes()
    )


def _first_crossings(**how: Any) -> object:
    found = first_crossings(FREE, [2.5], **{"rel_error": 0.2, "seed": 3, "budget": None} | how)
    return found.first_rate(), found.ages.tolist()


def _spectrum(**how: Any) -> object:
    paths = None if "rel_error" in how else 96
    found = spectrum(FREE, paths=paths, **{"seed": 3} | how)
    return [curve.value.tolist() for curve in found.curves["x"].values()]


def _densities(**how: Any) -> object:
    how.pop("rel_error", None)
    found = densities(FREE, {"x": (np.ones(1), -4.0, 4.0)}, **{"seed": 3, "budget": None} | how)
    return found["x"].density.tolist(), found["x"].standard_error.tolist()


def _impacts(**how: Any) -> object:
    paths = None if "rel_error" in how else 4096
    asked = {"paths": paths, "duration": 50.0, "seed": 3} | how
    found = impacts(STOPPED, **asked).pairs["stops"]
    return found.rates, found.energy, found.speed_rms


def _reliability(**how: Any) -> object:
    found = reliability(
        STOPPED.model_copy(update={"impact_pairs": (ImpactPair(upper=2.0, law=STOPS.law),)}),
        mission=30.0, impact_speed=3.0, start="rest",
        **{"rel_error": 0.3, "seed": 3, "budget": None} | how,
    )  # fmt: skip
    chances = {name: chance.estimate for name, chance in found.chances.items()}
    assert {chance.way for chance in found.chances.values()} == {"crude", "splitting"}
    return chances, found.hits


def _lifetimes(**how: Any) -> object:
    asked = {"rel_error": 0.3, "seed": 3, "budget": None} | how
    found = lifetimes(NOISY_MOUNT, ["no impacts"], **asked)
    return found.regimes


MODULATED = FREE.model_copy(update={"excitations": (Modulation(of="stiffness", intensity=0.2),)})


def _stability(**how: Any) -> object:
    return growth(MODULATED, **{"rel_error": 0.05, "seed": 3, "budget": None} | how).rates


def _basins(**how: Any) -> object:
    number = 20 if how.pop("rel_error", None) is None else 200
    found = basins(
        MOUNT,
        {
            "displacement.x": np.linspace(-4e-4, 4e-4, number),
            "velocity.x": np.linspace(-0.3, 0.3, number),
        },
        **how,
    )
    return found.ends.tolist(), [regime.name for regime in found.regimes]


def _sweep(**how: Any) -> object:
    asked = {"paths": 512} if how.get("rel_error") is None else {}
    damped = {"structure.damping": [0.1, 0.2]}
    table = sweep(STOPPED, damped, **{"seed": 3, "duration": 10.0} | asked | how)
    return table.drop(columns="seconds").to_numpy().tolist()


def _size(**how: Any) -> object:
    asked = {"probability": 0.1} | {"rel_error": 0.3, "seed": 3, "budget": None} | how
    return _numbers(size(FAR, mission=200.0, **asked))


def _size_by_rate(**how: Any) -> object:
    return _size(probability=None, rate=1e-3, **how)


def _size_pairs(**how: Any) -> object:
    asked = {"rel_error": 0.5, "seed": 3, "budget": None} | how
    return _numbers(size(TWO, probability=0.2, mission=200.0, tolerances=Tolerances(), **asked))


def _numbers(found: Any) -> str:
    def told(part: Any) -> Any:
        if not isinstance(part, dict):
            return part
        return {name: told(part[name]) for name in part if name not in ("cost", "provenance")}

    return json.dumps(told(found.to_dict()))


@cache
def _answer() -> Any:
    return size(FREE, probability=0.1, mission=200.0, rel_error=0.5, seed=3, budget=None)


def _sensitivity(**how: Any) -> object:
    return sensitivity(
        _answer(), **{"rel_error": 0.5, "seed": 3, "budget": None} | how
    ).to_csv()  # fmt: skip


def _clearance(**how: Any) -> object:
    asked = {"rel_error": 0.1, "seed": 3, "budget": None} | how
    return clearance_curve(BETWEEN, [1.0, 1.5], **asked).to_csv()


def _damage(**how: Any) -> object:
    asked = {"mission": 60.0, "equipment": [30.0, 60.0], "levels": [10.0]}
    return _numbers(damage(TRUCK, **asked, **{"rel_error": 0.2, "seed": 3, "budget": None} | how))


SAMPLERS = {
    "simulate": _simulate,
    "rare hits": _rare_hits,
    "windows": _windows,
    "absorber": _absorber,
    "absorber design": _design,
    "cost": _cost,
    "bursts": _bursts,
    "clatter": _clatter,
    "first_crossings": _first_crossings,
    "spectrum": _spectrum,
    "damage": _damage,
    "impacts": _impacts,
    "densities": _densities,
    "reliability": _reliability,
    "lifetimes": _lifetimes,
    "growth": _stability,
    "basins": _basins,
    "sweep": _sweep,
    "size": _size,
    "size by rate": _size_by_rate,
    "size of pairs": _size_pairs,
    "sensitivity": _sensitivity,
    "clearance": _clearance,
}
SLOW = ("rare hits", "absorber design", "size by rate", "size of pairs", "sensitivity")
"""Samplers that take seconds: `make verify` tests them."""

samplers = pytest.mark.parametrize(
    "sampler",
    [
        pytest.param(sampler, id=name, marks=[pytest.mark.verify] * (name in SLOW))
        for name, sampler in SAMPLERS.items()
    ],
)


LARGEST_TASK = 20_000
"""Largest number of bytes of a task: a description of its paths, and no tables."""


class Remembers(ThreadPoolExecutor):
    """Keeps the futures of its tasks, each pickled on its way as to another process, and the size
    of the largest."""

    def __init__(self) -> None:
        super().__init__(2)
        self.futures: list[Future[Any]] = []
        self.largest = 0

    def submit(self, function: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        task = pickle.dumps((function, arguments, named))
        self.largest = max(self.largest, len(task))
        function, arguments, named = pickle.loads(task)
        self.futures.append(super().submit(function, *arguments, **named))
        return self.futures[-1]


@pytest.mark.slow
@samplers
def test_the_seed_shows_in_digits_but_neither_executor_nor_progress(sampler: Any) -> None:
    alone, told = sampler(threads=1), []
    if sampler is not _basins:  # which draws no random numbers
        assert sampler(threads=1, seed=4) != alone
    assert sampler(threads=2, progress=lambda *said: told.append(said)) == alone
    assert told
    with Remembers() as executor:
        assert sampler(executor=executor) == alone
    assert executor.futures and executor.largest < LARGEST_TASK


@pytest.fixture(scope="module")
def processes() -> Iterator[Executor]:
    with ProcessPoolExecutor(2) as executor:
        yield executor


@samplers
def test_processes_give_the_same_digits(sampler: Any, processes: Executor) -> None:
    assert sampler(executor=processes) == sampler(threads=1)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Executor]:
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as local,
        distributed.Client(local) as client,
    ):
        yield client.get_executor(pure=False)


@samplers
def test_a_cluster_of_two_workers_gives_the_same_digits(sampler: Any, cluster: Executor) -> None:
    assert sampler(executor=cluster) == sampler(threads=1)


class Blocks:
    """Counts the blocks that are done, and presses Ctrl-C twice after the n-th.

    `late` are those that were begun after the deadline though none needed them: what was handed on
    after it had passed, but for the tasks under way then.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.done, self.late, self.stops_at = 0, 0, math.inf
        do = WorkerPool.do

        def counted(
            pool: WorkerPool,
            sampler: Any,
            blocks: Any,
            total: float,
            deadline: Deadline,
            needed: int,
        ) -> Any:
            under_way = pool.window
            for each in do(pool, sampler, blocks, total, deadline, needed):
                passed = deadline.passed() and each.block[0] >= needed
                yield each
                self.done += 1
                under_way -= passed
                self.late += under_way < 0
                if self.done >= self.stops_at:
                    raise KeyboardInterrupt

        monkeypatch.setattr(WorkerPool, "do", counted)

    def of(self, sampler: Any, **how: Any) -> tuple[int, object]:
        """Number of blocks of a calculation, and its answer."""
        self.done = 0
        found = sampler(threads=1, **how)
        return self.done, found


@pytest.mark.slow
@samplers
def test_killed_and_resumed_it_has_the_digits_of_a_run_that_never_stopped(
    sampler: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocks, kept = Blocks(monkeypatch), tmp_path / "run"
    number, whole = blocks.of(sampler)
    blocks.stops_at = max(1, number // 2)
    with pytest.raises(KeyboardInterrupt):
        blocks.of(sampler, checkpoint=kept, checkpoint_interval=1e-9)
    blocks.stops_at = math.inf
    left, found = blocks.of(sampler, resume=kept)
    assert found == whole
    assert left <= number - number // 2 + 1  # the block before Ctrl-C may not be kept yet
    assert blocks.of(sampler, resume=kept) == (0, whole)


@samplers
def test_no_block_begins_after_the_deadline_but_those_that_are_needed(
    sampler: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The accuracy that is asked for takes minutes to hours."""
    blocks = Blocks(monkeypatch)
    with suppress(NotConverged):  # some have an answer with larger errors all the same
        sampler(threads=1, budget=1e-3, rel_error=1e-3)
    assert blocks.late == 0


def test_what_is_sent_is_small_and_kept() -> None:
    """A box on three tables: its tables and modes are made anew by a worker, once."""
    box = model_of(load_scene(shipped_scene("rigid-box")))
    plan, clusters = make_plan(box), ClusterPaths(box, 3)
    before = plan.averages(3, 0, 2)
    part = clusters.part(1.0, 0)
    packet = packed(ResponseSampler(plan, 3))
    assert len(packet) < LARGEST_TASK < len(pickle.dumps(plan))
    bursts_packet = packed(BurstSampler(clusters, 1.0))
    assert len(bursts_packet) < LARGEST_TASK < len(pickle.dumps(clusters))
    there = unpacked(bursts_packet).simulate(0, clusters.together)
    assert there.ages.tobytes() == part.ages.tobytes()
    sampler = unpacked(packet)
    assert unpacked(bytes(packet)) is sampler
    assert sampler.plan.averages(3, 0, 2).tobytes() == before.tobytes()


@samplers
def test_ctrl_c_leaves_no_task_that_may_begin(sampler: Any) -> None:
    def interrupts(share: float, sentence: str) -> None:
        if executor.futures and "compiling" not in sentence:
            raise KeyboardInterrupt

    with Remembers() as executor:
        with pytest.raises(KeyboardInterrupt):
            sampler(executor=executor, progress=interrupts)
        assert executor.futures
        assert all(future.running() or future.done() for future in executor.futures)


WITHOUT_PARTS = (*SLOW, "windows", "densities")
"""Samplers whose answer after Ctrl-C is that of another test, or of the calculation that asks."""


def ctrl_c() -> None:
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("name", [name for name in SAMPLERS if name not in WITHOUT_PARTS])
def test_ctrl_c_answers_with_what_there_is(name: str) -> None:
    told: list[str] = []

    def once(share: float, sentence: str) -> None:
        if share > 0.0 and not told:
            told.append(sentence)
            ctrl_c()

    usual = signal.getsignal(signal.SIGINT)
    with pytest.raises(Interrupted, match="interrupted by Ctrl-C") as stopped:
        SAMPLERS[name](threads=1, progress=once, rel_error=1e-3)
    answer = stopped.value.partial
    assert answer is not None
    assert getattr(answer, "interrupted", True)
    assert signal.getsignal(signal.SIGINT) is usual
    assert not Deadline.after(None).passed()  # of what begins after it


def test_a_second_ctrl_c_ends_at_once() -> None:
    with graceful_interrupt():
        ctrl_c()
        with pytest.raises(KeyboardInterrupt):
            ctrl_c()


@samplers
def test_what_takes_no_tasks_is_refused(sampler: Any) -> None:
    with pytest.raises(ValueError, match=r"executor must be a concurrent.futures.Executor"):
        sampler(executor=4)


# ------------------------------------------------------------------------------
# One set of options for everything that samples: in Python, on the command line, on the page.
# ------------------------------------------------------------------------------


class AskedWith(Exception):
    """The seed with which a sampler begins."""


@pytest.mark.parametrize("name", [name for name in SAMPLERS if name != "basins"])
def test_a_generator_draws_the_seed(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def begins(options: Any) -> Any:
        raise AskedWith(options["seed"])

    if name == "sensitivity":
        _answer()  # of which it is asked
    monkeypatch.setattr(Run, "of", begins)
    known = np.random.default_rng(5)
    for rng in [np.random.default_rng(5)] * 2:  # it moves on
        with pytest.raises(AskedWith, match=f"^{known.integers(2**53)}$"):
            SAMPLERS[name](rng=rng, seed=None)
    with pytest.raises(ValueError, match="give seed or rng, not both"):
        SAMPLERS[name](rng=5, seed=0)


def test_its_answer_is_that_of_the_seed_drawn() -> None:
    asked = {"paths": 64, "duration": 5.0}
    found = [simulate(BETWEEN, rng=np.random.SeedSequence(5), **asked) for _ in range(2)]
    seed = found[0].provenance["seed"]
    assert found[0] == found[1] == simulate(BETWEEN, seed=seed, **asked)
    assert seed == np.random.default_rng(np.random.SeedSequence(5)).integers(2**53)
    call = found[0].provenance["call"]["arguments"]
    assert call["seed"] == seed and "rng" not in call
    with pytest.raises(ValueError, match="rng must be a Generator"):
        simulate(BETWEEN, rng="a", **asked)


def test_every_public_calculation_with_a_seed_has_it() -> None:
    """But for those that pass all that they are given on to a method, and for the page whose curves
    stay where they are while knobs are turned."""
    found = {
        name: signature_of(each).parameters
        for name in stochvi.__all__
        if inspect.isfunction(each := getattr(stochvi, name))
    }
    seeded = {name for name, parameters in found.items() if "seed" in parameters}
    assert seeded - {"explore"} == {
        name for name, parameters in found.items() if "rng" in parameters
    }
    assert {"simulate", "history", "replay", "check", "size", "damage"} <= seeded


MOST_PARAMETERS = 8
"""Largest number of parameters of a function that users do not call."""

PUBLIC = {
    "size", "fokker_planck_many", "linearise_many", "reliability", "damage",
    "absorber",  # the command
}  # fmt: skip
"""Public calls, whose options users name."""


def test_the_page_has_the_names_and_defaults() -> None:
    page = (CHECKOUT / "docs/howto/long-runs.md").read_text(encoding="utf-8")
    table = re.findall(r"^\| `(\w+)` \| .* \| ([^|]*) \|$", page, re.MULTILINE)
    assert {name for name, _ in table} == set(DEFAULTS) == set(SamplingOptions.__annotations__)
    for name, default in table:
        known = DEFAULTS[name]
        said = "None" if known is None else f"{known:g}"
        assert default.partition(":")[0] == said or name == "rel_error", name


def test_the_command_line_has_the_same_default_budget() -> None:
    assert command_line.BUDGET == BUDGET


def long_signatures(file: Path) -> list[str]:
    """Functions with more parameters than MOST_PARAMETERS, `self` apart; those that are compiled
    into kernels are left out."""
    found = []
    for each in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if not isinstance(each, ast.FunctionDef):
            continue
        if any(ast.unparse(mark).startswith("kernel") for mark in each.decorator_list):
            continue
        asked = each.args
        named = [*asked.posonlyargs, *asked.args, *asked.kwonlyargs]
        number = len(named) + bool(asked.vararg) + bool(asked.kwarg)
        number -= bool(named) and named[0].arg in ("self", "cls")
        if number > MOST_PARAMETERS and each.name not in PUBLIC:
            found.append(f"{file.name}: {each.name} ({number})")
    return found


def test_functions_have_few_parameters() -> None:
    compiled = ("kernels", "kernel.py")
    files = CHECKOUT.glob("stochvi/**/*.py")
    assert [
        sentence
        for file in files
        if not set(compiled) & set(file.parts)
        for sentence in long_signatures(file)
    ] == []


def test_a_long_signature_is_found(tmp_path: Path) -> None:
    """Negative control."""
    file = tmp_path / "one.py"
    file.write_text("def f(a, b, c, d, e, f, g, h, i): ...\n")
    assert long_signatures(file) == ["one.py: f (9)"]
    file.write_text("@kernel\ndef f(a, b, c, d, e, f, g, h, i): ...\n")
    assert long_signatures(file) == []
