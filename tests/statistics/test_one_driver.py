"""Everything that samples runs on any executor, to the same digits, and leaves no task running."""

import os
import pickle
import signal
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from typing import Any

import pytest

from stochvi.isolators.sizing.clatter import clatter
from stochvi.results.deadline import Deadline, graceful_interrupt
from stochvi.results.errors import Interrupted
from stochvi.scenes.excitations import TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Elastic, Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Isolator, Oscillator
from stochvi.statistics.bursts import bursts
from stochvi.statistics.first_crossings import first_crossings
from stochvi.statistics.impacts import impacts
from stochvi.statistics.reliability import reliability
from stochvi.statistics.spectra import spectrum
from stochvi.verification.cost import cost

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
STOPPED = FREE.model_copy(update={"impact_pairs": (STOPS,)})


def _cost(**how: Any) -> object:
    found = cost(STOPPED, paths=1024, seed=3, **how)
    return [(row.step, row.value, row.standard_error, row.step_bias) for row in found.errors]


def _bursts(**how: Any) -> object:
    found = bursts(FAR, rel_error=0.5, seed=3, **how)
    return found.hit_rate(), found.path.tolist(), found.fastest.tolist()


def _clatter(**how: Any) -> object:
    return clatter(TRUCK, [6e-3], rel_error=0.1, seed=3, **how).to_numpy().tobytes()


def _first_crossings(**how: Any) -> object:
    found = first_crossings(FREE, [2.5], rel_error=0.2, seed=3, **how)
    return found.first_rate(), found.ages.tolist()


def _spectrum(**how: Any) -> object:
    found = spectrum(FREE, paths=96, seed=3, **how)
    return [curve.value.tolist() for curve in found.curves["x"].values()]


def _impacts(**how: Any) -> object:
    found = impacts(STOPPED, paths=4096, duration=50.0, seed=3, **how).pairs["stops"]
    return found.rates, found.energy, found.speed_rms


def _reliability(**how: Any) -> object:
    found = reliability(
        STOPPED.model_copy(update={"impact_pairs": (ImpactPair(upper=2.0, law=STOPS.law),)}),
        mission=30.0, impact_speed=3.0, start="rest", rel_error=0.3, seed=3, **how,
    )  # fmt: skip
    chances = {name: chance.estimate for name, chance in found.chances.items()}
    assert {chance.way for chance in found.chances.values()} == {"crude", "splitting"}
    return chances, found.hits


SAMPLERS = {
    "cost": _cost,
    "bursts": _bursts,
    "clatter": _clatter,
    "first_crossings": _first_crossings,
    "spectrum": _spectrum,
    "impacts": _impacts,
    "reliability": _reliability,
}
samplers = pytest.mark.parametrize("sampler", SAMPLERS.values(), ids=SAMPLERS)


class Remembers(ThreadPoolExecutor):
    """Keeps the futures of its tasks, each pickled on its way as to another process."""

    def __init__(self) -> None:
        super().__init__(2)
        self.futures: list[Future[Any]] = []

    def submit(self, function: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        function, arguments, named = pickle.loads(pickle.dumps((function, arguments, named)))
        self.futures.append(super().submit(function, *arguments, **named))
        return self.futures[-1]


@samplers
def test_the_executor_never_shows_in_a_digit(sampler: Any) -> None:
    alone = sampler(threads=1)
    assert sampler(threads=2) == alone
    with Remembers() as executor:
        assert sampler(executor=executor) == alone
    assert executor.futures


def test_processes_give_the_same_digits() -> None:
    with ProcessPoolExecutor(1) as executor:
        assert _cost(executor=executor) == _cost(threads=1)


@samplers
def test_ctrl_c_leaves_no_task_that_may_begin(sampler: Any) -> None:
    def interrupts(share: float, sentence: str) -> None:
        if "compiling" not in sentence:
            raise KeyboardInterrupt

    with Remembers() as executor:
        with pytest.raises(KeyboardInterrupt):
            sampler(executor=executor, progress=interrupts)
        assert executor.futures
        assert all(future.running() or future.done() for future in executor.futures)


def ctrl_c() -> None:
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("name", [name for name in SAMPLERS if name != "clatter"])
def test_ctrl_c_answers_with_what_there_is(name: str) -> None:
    told: list[str] = []

    def once(_share: float, sentence: str) -> None:
        if "compiling" not in sentence and not told:
            told.append(sentence)
            ctrl_c()

    usual = signal.getsignal(signal.SIGINT)
    with pytest.raises(Interrupted, match="interrupted by Ctrl-C") as stopped:
        SAMPLERS[name](threads=1, progress=once)
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
