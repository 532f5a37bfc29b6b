"""The package runs on systems that do not know to which cores a process is bound."""

import os

import pytest

from stochvi.methods.monte_carlo import simulate
from stochvi.results.machine import usable_cores
from stochvi.scenes.excitations import WhiteNoise
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Oscillator


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
