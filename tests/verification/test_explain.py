"""`explain`: effects present and absent, methods, and a price that comes true."""

import importlib
import io
import json
import math
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from scipy.linalg import eigh

from stochvi import (
    ConstantLoad,
    FilteredNoise,
    ImpactPair,
    Isolator,
    Matrices,
    NonlinearOscillator,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    TabulatedNoise,
    WhiteNoise,
    average,
    explain,
    first_passage,
    fokker_planck,
    simulate,
    transient,
)
from stochvi.model.model import model_of
from stochvi.model.natural_modes import natural_modes
from stochvi.results.deadline import asked_for
from stochvi.verification import zoo
from stochvi.views.verification_tables import print_explanation
from support.known import oscillator

simulation = importlib.import_module("stochvi.methods.monte_carlo.simulate")


def test_what_is_absent_is_told() -> None:
    told = explain(oscillator(None, 1.0, 0.8, load=0.5))
    assert told.effects == ("white noise on x", "constant load on x", "rigid stop upper")
    excitations = ("filtered noise", "tabulated noise", "sine", "modulation", "pulses")
    assert told.absent == (*excitations, "stop lower")
    for method in ("average", "fokker-planck", "linearise", "simulate"):
        assert told.methods[method] == "applies"
    assert "restitution must be 1" in told.methods["exact"]


def test_the_predicted_price_is_that_of_the_run() -> None:
    """Times on a shared machine wander: the paths behind them are compared, which do not."""
    scene = oscillator(-1.0, 1.0, 1.0)
    plan = explain(scene, threads=1).simulation
    assert plan is not None
    cost = simulate(scene, rel_error=0.001, seed=1, threads=1).cost
    predicted = plan.seconds[0.001]
    assert predicted is not None
    steps = 1e9 * predicted / plan.nanoseconds_per_step
    # errors of the pilot, of a thousand paths and more, are good to some per cent; a run may
    # overshoot its goal by the last of its rounds
    assert 0.4 * steps < cost.steps < 2.5 * steps


SOME = (
    "linear",
    "lossy-unequal-gaps",
    "elastic-preload",
    "filtered-lossy",
    "psd-own-table",
    "sine-on-random",
    "spring-stops",
    "absorber-lossy",
    "two-storeys-linear",
)
"""Of the zoo, one of each kind; all of them take more than half a minute."""


@pytest.mark.parametrize("name", SOME)
def test_every_kind_of_scene_is_explained(name: str) -> None:
    told = explain(zoo(name)[name], threads=1)
    json.loads(json.dumps(told.to_dict(), allow_nan=False))
    assert told.methods["simulate"] == "applies" and told.simulation is not None
    assert set(told.effects) == set(zoo(name)[name].effects())


def test_a_cost_that_cannot_be_told_is_unknown() -> None:
    plan = explain(oscillator(-9.0, 9.0, 1.0)).simulation
    assert plan is not None
    assert set(plan.seconds.values()) == {None}
    assert plan.governed_by == "no impact was seen"


def test_a_scene_that_is_not_simulated_says_why() -> None:
    undamped = Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.0),
        excitations=[TabulatedNoise(profile="navmat-p-9492")],
    )
    told = explain(undamped)
    assert told.simulation is None
    assert "needs structure.damping" in told.methods["simulate"]
    assert json.loads(json.dumps(told.to_dict(), allow_nan=False))["method"] == "explain"


def test_white_noise_beside_a_table_reaches_the_resonance() -> None:
    mixed = Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        excitations=[TabulatedNoise(profile="navmat-p-9492"), WhiteNoise(intensity=1.0)],
    )
    assert "outside the table" not in " ".join(explain(mixed).notes)


def test_how_much_of_a_table_was_taken_is_said(tmp_path: Path) -> None:
    (tmp_path / "floor.csv").write_text("0 0\n10 0.02\n60 0.02\n")
    table = TabulatedNoise(file=str(tmp_path / "floor.csv"), unit="g2/Hz", level_db=6.0)
    mount = Isolator(frequency_hz=12.0, zeta=0.1)
    # 0.02 g^2/Hz over 50 Hz, raised by 6 dB
    assert explain(Scene(structure=mount, excitations=[table])).assumptions[0] == (
        "tabulated noise on base: floor.csv, at +6 dB, 2 points in g2/Hz, 10 to 60 Hz, 1.995 g rms"
    )
    force = TabulatedNoise(frequency_hz=[1.0, 3.0], density=[8.0, 8.0], unit="N2/Hz", on="x")
    fixed = Oscillator(mass=1.0, damping=0.5, stiffness=99.0)
    assert "4 N rms" in explain(Scene(structure=fixed, excitations=[force])).assumptions[0]


@pytest.mark.parametrize("lower", [-1.0, None])
def test_steps_of_a_path_are_those_of_the_plan(lower: float | None) -> None:
    plan = explain(oscillator(lower, 1.0, 1.0)).simulation
    assert plan is not None
    assert plan.steps_per_path == pytest.approx((plan.burn_in + plan.duration) / plan.step, abs=2)


def test_a_linearisation_that_takes_long_leaves_time_for_the_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of 40 masses, or a table of 20,000 lines, it takes seconds."""
    turns = [0]

    def endless(scene: Scene) -> None:
        for turns[0] in range(10**9):
            pass

    monkeypatch.setattr("stochvi.verification.explain.linearise", endless)
    # what is left of 0.3 s may be nothing on a machine that is busy
    found = explain(oscillator(-1.0, 1.0, 0.8), threads=1, budget=2.0)
    assert 0 < turns[0] < 10**9 - 1 and found.methods["linearise"] == "applies"
    assert found.simulation is not None and found.simulation.nanoseconds_per_step > 0.0


def test_modes_of_many_masses_are_described() -> None:
    """In a mode of 50 masses none has much of the kinetic energy."""
    chain = 2.0 * np.eye(50) - np.eye(50, k=1) - np.eye(50, k=-1)
    structure = Matrices(
        coordinates=[f"m{number}" for number in range(50)],
        mass=np.eye(50).tolist(), damping=chain.tolist(), stiffness=(1e3 * chain).tolist(),
    )  # fmt: skip
    scene = Scene(structure=structure, excitations=[WhiteNoise(intensity=1.0, on="m0")])
    assert all(mode.motion for mode in natural_modes(model_of(scene)))


def test_a_plan_that_takes_minutes_is_not_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """A table of 99,000 lines on 20 masses used to take minutes, and 4 GB, for a limit of 3 s. Here
    it has an eighth of the lines, for a tenth of the time."""
    monkeypatch.setattr(
        "stochvi.verification.explain.prospect", lambda *_, **__: pytest.fail("not in time")
    )
    # the guard of budgets goes by the clock of a machine that may be busy
    monkeypatch.setattr("stochvi.model.calculations.ended_by", lambda _: nullcontext())
    frequency = np.linspace(5.0, 2000.0, 12_000)
    masses = 20
    chain = 2.0 * np.eye(masses) - np.eye(masses, k=1) - np.eye(masses, k=-1)
    scene = Scene(
        structure=Matrices(
            coordinates=[f"m{number}" for number in range(masses)],
            mass=np.eye(masses).tolist(),
            damping=(20.0 * chain).tolist(),
            stiffness=(1e5 * chain).tolist(),
        ),
        excitations=[
            TabulatedNoise(
                on="base",
                frequency_hz=frequency.tolist(),
                density=[0.01] * len(frequency),
                unit="g2/Hz",
            )
        ],
    )
    with asked_for(0.5):  # the start of a command has taken a part of it
        found = explain(scene, budget=0.3)
    assert found.simulation is None and found.methods["simulate"] == "applies"
    (told,) = (note for note in found.notes if "price of a simulation was not measured" in note)
    assert told.endswith("more than is left of the budget of 0.5 s; raise budget")


@pytest.mark.parametrize(("share", "pilot"), [(0.8, False), (0.2, True)])
def test_two_paths_that_take_all_the_time_of_a_pilot_are_not_begun(
    monkeypatch: pytest.MonkeyPatch, share: float, pilot: bool
) -> None:
    """They ended after the limit of 3 s, and said nothing of errors."""
    begun: list[int] = []
    price = share * simulation.LEAST_PILOT_SECONDS
    monkeypatch.setattr(simulation, "seconds_of_first_paths", lambda *_: price)
    monkeypatch.setattr(simulation.Simulation, "add_paths", lambda _, paths: begun.append(paths))
    found = explain(oscillator(-1.0, 1.0, 0.8), threads=1, budget=1e-3).simulation
    assert found is not None and bool(begun) is pilot
    steps = simulation.FEWEST_AT_ONCE * found.steps_per_path
    assert found.nanoseconds_per_step == pytest.approx(1e9 * price / steps)


def test_a_scene_that_simulate_refuses_is_not_called_simulated() -> None:
    """A spring that is a function: the equation covers it, a simulation does not."""
    spring = NonlinearOscillator(mass=1.0, damping=0.1, restoring_force=lambda x: x + x**3)
    told = explain(Scene(structure=spring, excitations=[WhiteNoise(intensity=0.2)]))
    assert told.methods["fokker-planck"] == "applies"
    assert told.summary().startswith("not simulated: structure.kind must not be 'nonlinear'")
    printed = io.StringIO()
    print_explanation(Console(file=printed, width=200), told)
    assert printed.getvalue().startswith("in the scene:     white noise on x\nnot in the scene: ")
    told = explain(oscillator(-1.0, 1.0, 0.8), threads=1)
    assert told.summary().startswith("simulated: white noise on x")


@pytest.mark.parametrize("method", [fokker_planck, average, first_passage, transient])
def test_methods_for_white_noise_say_so_of_every_other_noise(method: Callable[..., Any]) -> None:
    """A sentence that lists a kind as covered must not be followed by one that refuses it."""
    unit = {"structure": Oscillator(mass=1.0, damping=0.1, stiffness=1.0)}
    times = {"times": [1.0]} if method in (first_passage, transient) else {}
    for noise, word in {
        FilteredNoise(intensity=0.2, frequency_hz=1.0, zeta=0.1): "filtered noise",
        TabulatedNoise(frequency_hz=[1.0, 9.0], density=[1.0, 1.0], unit="N2/Hz"): "a tabulated",
        Sine(amplitude=1.0, frequency_hz=1.0): "a sine",
    }.items():
        with pytest.raises(NotApplicable) as refused:
            method(Scene(**unit, excitations=[noise]), **times)
        got = f"excitation must be white noise, got {word}"
        assert any(each.startswith(got) for each in refused.value.conditions), refused.value


def test_modes_and_rest_are_those_of_the_matrices() -> None:
    """Against general solvers of eigenvalues and of equations, on three masses under a load."""
    m = np.diag([1.0, 0.5, 2.0])
    k = np.array([[30.0, -10.0, 0.0], [-10.0, 25.0, -15.0], [0.0, -15.0, 40.0]])
    scene = Scene(
        structure=Matrices(
            coordinates=["a", "b", "c"], mass=m.tolist(), damping=(0.01 * k).tolist(),
            stiffness=k.tolist(),
        ),
        impact_pairs=[
            ImpactPair(between=("a", "b"), lower=-0.3, upper=0.5, law=Restitution(coefficient=0.5))
        ],
        excitations=[WhiteNoise(intensity=0.2, on="b"), ConstantLoad(force=3.0, on="c")],
    )  # fmt: skip
    told = explain(scene, threads=1)
    squares, shapes = eigh(k, m)
    hertz = np.sqrt(squares) / (2.0 * math.pi)
    assert list(told.natural_frequency_hz) == pytest.approx(hertz, rel=1e-9)
    for mode, frequency, square in zip(told.modes, hertz, squares, strict=True):
        assert mode.frequency_hz == pytest.approx(frequency, rel=1e-9)
        assert mode.damping_ratio == pytest.approx(0.005 * math.sqrt(square), rel=1e-9)
    moved = (shapes.T @ m @ np.ones(3)) ** 2  # shapes of unit modal mass
    found = [mode.effective_mass[""] for mode in told.modes]
    assert found == pytest.approx(moved, rel=1e-9) and sum(found) == pytest.approx(3.5)
    rest = np.linalg.solve(k, [0.0, 0.0, 3.0])
    assert list(told.rest.values()) == pytest.approx(rest, rel=1e-9)
    gap = told.rest_of_gaps["stops"]
    place = rest[0] - rest[1]
    assert (gap.position, gap.to_lower, gap.to_upper) == pytest.approx(
        (place, place + 0.3, 0.5 - place), rel=1e-9
    )


def test_states_are_those_of_masses_and_filters() -> None:
    """Two states for each mass, and two for each noise with a memory of its own."""
    noise = FilteredNoise(intensity=0.2, frequency_hz=1.0, zeta=0.1, on="x")
    unit = Oscillator(mass=1.0, damping=0.1, stiffness=1.0)
    two = Matrices(
        coordinates=["x", "y"], mass=[[1.0, 0.0], [0.0, 1.0]], damping=[[0.2, 0.0], [0.0, 0.3]],
        stiffness=[[2.0, -1.0], [-1.0, 2.0]],
    )  # fmt: skip
    for structure, excitation, states in (
        (unit, WhiteNoise(intensity=0.2), 2), (unit, noise, 4), (two, noise, 6)
    ):  # fmt: skip
        found = explain(Scene(structure=structure, excitations=[excitation]), threads=1).simulation
        assert found is not None and found.states == states
