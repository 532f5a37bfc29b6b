"""A restitution that is drawn at each impact: simulation beside a plain twin and Fokker-Planck."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from stochvi import (
    ConstantLoad,
    Elastic,
    ImpactPair,
    Matrices,
    Oscillator,
    Response,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    fokker_planck,
    simulate,
)
from stochvi.engine.impact_log import COLUMNS, Log
from stochvi.engine.laws.scattered_restitution import CELLS, ScatteredRestitution
from stochvi.mathematics.beta_distribution import BetaDistribution
from stochvi.methods.fokker_planck import restitution_rule as rules
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.kernels.random_numbers import seed_streams
from stochvi.model.model import model_of
from stochvi.scenes.impact_laws import Law
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases, rel_errors
from support.known import values
from support.naive import kick_flow_kick, normals, uniform, words_of_pairs

WIDE = {"mean": 0.5, "std": 0.25}
"""A restitution whose E R^2 is 1.25 times (E R)^2."""

JUDGED = ("displacement_std", "velocity_std", "impact_speed_rate", "impact_speed_square_rate")


def scene_of(
    lower: float | None = -1.0,
    upper: float | None = 1.0,
    coefficient: Any = WIDE,
    upper_law: Law | None = None,
    damping: float = 0.1,
    load: float = 0.0,
) -> Scene:
    """x'' + b x' + x = f(t) + load, with E f f = 0.2."""
    excitations: list[Any] = [WhiteNoise(intensity=0.2)]
    if load:
        excitations.append(ConstantLoad(force=load))
    return Scene(
        structure=Oscillator(mass=1.0, damping=damping, stiffness=1.0),
        impact_pairs=[
            ImpactPair(
                lower=lower,
                upper=upper,
                law=Restitution(coefficient=coefficient),
                upper_law=upper_law,
            )
        ],
        excitations=excitations,
    )


def of_two_masses(pair: ImpactPair) -> Scene:
    """The same oscillator beside another one, which it does not know, as a structure."""
    return Scene(
        structure=Matrices(
            coordinates=["x", "z"],
            mass=[[1.0, 0.0], [0.0, 1.0]],
            damping=[[0.1, 0.0], [0.0, 0.1]],
            stiffness=[[1.0, 0.0], [0.0, 2.0]],
        ),
        impact_pairs=[pair.replace(on="x")],
        excitations=[WhiteNoise(intensity=0.2, on=name) for name in ("x", "z")],
    )


def assert_same(simulated: Response, known: Response, z: float = 4.5) -> None:
    (pair,), truth = simulated.impact_pairs.values(), values(known)
    judged = 0
    for name in JUDGED:
        found = getattr(pair if name.startswith("impact") else simulated.coordinates["x"], name)
        if found.bias is not None:  # F2 has none where a load holds the mass on a stop
            assert_agrees(found, truth[name], z=z)
            judged += 1
    assert judged >= 3


# ---- path by path ------------------------------------------------------------------------------


@pytest.mark.parametrize("lower", [-0.3, None])
@pytest.mark.parametrize("step", [0.25, 1.2], ids=["short steps", "several impacts in a step"])
def test_paths_are_those_of_a_plain_twin(lower: float | None, step: float) -> None:
    """The twin draws from the words of its stream, and from the numbers of its impacts."""
    upper, path, steps = 0.4, 5, 200
    scene = scene_of(lower, upper)
    plan = make_plan(model_of(scene), 0.0, step * steps).with_step(step)
    record = np.zeros((steps, 1, 3))
    log = Log(np.empty((10**5, COLUMNS)), np.zeros(1, np.int64), 0.0)
    plan.averages(9, path, 1, record, log=log)
    streams = np.empty((2, 1), np.uint64)
    seed_streams(np.uint64(9), path, streams)
    (x,), (v,) = plan._start(streams)
    law = scene.impact_pairs[0].law
    assert isinstance(law, Restitution) and law.scatter is not None
    middles, widths = law.scatter.cells(CELLS)
    words, z = words_of_pairs(9, path, steps + 2), normals(9, path, steps + 2)[2:]
    hits: list[tuple[float, float, float]] = []
    struck = 0

    def draw() -> float:
        nonlocal struck
        place = uniform(words[1 + number // 2], struck) * CELLS
        struck += 1
        cell = int(place)
        return float(np.clip(middles[cell] + widths[cell] * (place - cell - 0.5), 0.0, 1.0))

    stops = [(at, draw, side) for at, side in ((lower, -1.0), (upper, 1.0)) if at is not None]
    for number in range(steps):
        struck = 0 if number % 2 == 0 else struck
        (x,), (v,), found = kick_flow_kick(x, v, z[[number]], step, 1.0, 0.1, 0.2, stops)
        hits += [(side, w, number * step + when) for side, w, when in found]
        assert record[number, 0, 0] == pytest.approx(x, rel=0, abs=1e-8)
        assert record[number, 0, 1] == pytest.approx(v, rel=0, abs=1e-7)
    assert len(hits) > 10
    timed = np.array([(when, side * w) for side, w, when in hits])
    np.testing.assert_allclose(log.events[: log.count[0], 2:], timed, rtol=0, atol=1e-6)


def test_digits_depend_neither_on_threads_nor_on_blocks() -> None:
    scene = scene_of()
    one, two = (simulate(scene, paths=700, duration=40.0, threads=n, seed=4) for n in (1, 2))
    assert one.to_frame().equals(two.to_frame())
    plan = make_plan(model_of(scene), None, 40.0)
    whole = plan.averages(4, 0, 48)
    parts = [plan.averages(4, first, 16) for first in (0, 16, 32)]
    assert np.array_equal(whole, np.concatenate(parts, axis=1))
    several = make_plan(model_of(of_two_masses(scene.impact_pairs[0])), None, 40.0)
    whole = several.averages(4, 0, 48)
    parts = [several.averages(4, first, 16) for first in (0, 16, 32)]
    assert np.array_equal(whole, np.concatenate(parts, axis=1))


def test_a_block_may_be_cut_in_time() -> None:
    plan = make_plan(model_of(scene_of()), None, 40.0)
    whole, cut = plan.begin(4, 0, 16), plan.begin(4, 0, 16)
    whole.reach(whole.total)
    for share in (0.3, 0.7, 1.0):
        cut.reach(int(share * cut.total / 2) * 2 if share < 1.0 else cut.total)
    assert np.array_equal(whole.averages(), cut.averages())


def test_without_scatter_every_bit_is_that_of_the_plain_law() -> None:
    plain, still = (
        simulate(scene_of(coefficient=each), paths=256, duration=40.0, seed=4).to_frame()
        for each in (0.5, {"mean": 0.5, "std": 0.0})
    )
    assert plain.equals(still)


# ---- beside Fokker-Planck ------------------------------------------------------------------------


def random_scene(number: int) -> Scene:
    """One or two stops, also preloaded, any mean and scatter, gaps, dampings and loads."""
    random = np.random.default_rng(1000 + number)
    gaps = random.uniform(0.3, 2.0, 2)
    both = random.uniform() < 0.6

    def coefficient() -> dict[str, float]:
        mean = float(random.uniform(0.2, 0.95))
        return {"mean": mean, "std": random.uniform(0.05, 0.9) * math.sqrt(mean * (1.0 - mean))}

    lower_law, upper_law = (Restitution(coefficient=coefficient()) for _ in range(2))
    if not both and random.uniform() < 0.3:
        gaps[1] = -random.uniform(0.0, 0.5)
    pair = ImpactPair(
        lower=-gaps[0] if both else None,
        upper=gaps[1],
        lower_law=lower_law if both else None,
        upper_law=upper_law,
    )
    own = scene_of(
        damping=float(10.0 ** random.uniform(-1.5, -0.3)),
        load=float(random.choice([0.0, random.uniform(-0.5, 0.5)])),
    )
    return own.replace(impact_pairs=[pair])


@quick_cases("number", range(50), keep={0, 7})
def test_simulation_agrees_with_fokker_planck(number: int) -> None:
    scene = random_scene(number)
    simulated = simulate(scene, rel_error=4e-3, seed=number)
    assert_same(simulated, fokker_planck(scene, rtol=1e-4))


@rel_errors(4e-3, 2e-3)
def test_the_scatter_counts(rel_error: float) -> None:
    """The same scene without its scatter is another one: both methods see that."""
    scene, constant = scene_of(), scene_of(coefficient=0.5)
    simulated, known = simulate(scene, rel_error=rel_error, seed=2), fokker_planck(scene)
    assert_same(simulated, known)
    with pytest.raises(AssertionError):
        assert_same(simulated, fokker_planck(constant))
    with pytest.raises(AssertionError):
        assert_same(simulate(constant, rel_error=rel_error, seed=2), known)


def mean_alone(law: BetaDistribution, count: int = 1) -> tuple[Any, Any]:
    return np.full(count, law.mean), np.full(count, 1.0 / count)


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["simulate", "fokker-planck", "balance"])
def test_scatter_that_is_left_out_is_noticed(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """E R in the place of R: in the kernel, in the condition at the stop, and in the balance."""
    scene = scene_of(coefficient={"mean": 0.45, "std": 0.26})
    match fault:
        case "simulate":
            monkeypatch.setattr(
                ScatteredRestitution,
                "of",
                classmethod(
                    lambda cls, law: cls(
                        np.array([[law.mean, *np.full(CELLS, law.mean), *np.zeros(CELLS)]])
                    )
                ),
            )
        case "fokker-planck":
            monkeypatch.setattr(
                "stochvi.methods.fokker_planck.scaled_motion.restitution_rule", mean_alone
            )
        case "balance":
            monkeypatch.setattr(
                Restitution, "restitution_mean_square", property(lambda law: law.restitution**2)
            )
    simulated, known = simulate(scene, rel_error=4e-3, seed=2), fokker_planck(scene)
    if fault == "balance":
        assert simulated.identities is not None
        assert_agrees(simulated.identities["virial"], 0.0)
        with pytest.raises(AssertionError):
            assert_agrees(simulated.identities["energy"], 0.0)
    else:
        with pytest.raises(AssertionError):
            assert_same(simulated, known)


@pytest.mark.slow
@pytest.mark.parametrize("law", [WIDE, {"mean": 0.9, "std": 0.25}, {"mean": 0.2, "std": 0.15}])
def test_the_rule_of_fokker_planck_is_fine_enough(
    law: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside one of 96 restitutions; one of two, exact for E R and E R^2, is not enough."""
    scene = scene_of(coefficient=law)
    found = values(fokker_planck(scene, rtol=1e-6))
    place = "stochvi.methods.fokker_planck.scaled_motion.restitution_rule"
    monkeypatch.setattr(place, lambda known: known.rule(96))
    finest = values(fokker_planck(scene, rtol=1e-6))
    monkeypatch.setattr(place, lambda known: known.rule(2))
    rough = values(fokker_planck(scene, rtol=1e-6))
    for name in JUDGED:
        assert found[name] == pytest.approx(finest[name], rel=3e-6)
    worst = max(abs(rough[name] / finest[name] - 1.0) for name in JUDGED)
    assert worst > 1e-4
    assert rules.COUNTS[-1] < 96


# ---- structures, mixed stops, tables -------------------------------------------------------------


@rel_errors(1e-2, 2e-3)
def test_a_structure_draws_the_same_distribution(rel_error: float) -> None:
    scene = scene_of()
    simulated = simulate(of_two_masses(scene.impact_pairs[0]), rel_error=rel_error, seed=2)
    assert_same(simulated, fokker_planck(scene, rtol=1e-4))


@rel_errors(1e-2, 3e-3)
@pytest.mark.parametrize("several", [False, True], ids=["one mass", "structure"])
def test_a_compliant_stop_may_lie_opposite(several: bool, rel_error: float) -> None:
    scene = scene_of(upper_law=Elastic(stiffness=100.0))
    known = fokker_planck(scene, rtol=1e-4)
    simulated = of_two_masses(scene.impact_pairs[0]) if several else scene
    assert_same(simulate(simulated, rel_error=rel_error, seed=2), known)


@pytest.mark.slow
@rel_errors(4e-2, 1e-2)
def test_a_mass_that_is_pressed_on_a_stop_comes_to_rest(rel_error: float) -> None:
    """Chatter ends at rest, however the restitutions fall; E R gives what the rest adds to F1."""
    scene = scene_of(None, -0.5)
    known = fokker_planck(scene, rtol=1e-4)
    assert_same(simulate(scene, rel_error=rel_error, seed=2), known)
    assert_same(simulate(of_two_masses(scene.impact_pairs[0]), rel_error=rel_error, seed=2), known)


@rel_errors(2e-2, 5e-3)
def test_tables_take_it_as_white_noise_does(rel_error: float) -> None:
    """A density that is flat far beyond the resonance."""
    flat = TabulatedNoise(frequency_hz=[1e-3, 8.0], density=[0.4, 0.4], unit="N2/Hz")
    simulated = simulate(scene_of().replace(excitations=[flat]), rel_error=rel_error, seed=2)
    known = values(fokker_planck(scene_of(), rtol=1e-4))
    # the density ends at 8 Hz: a part 2 / (pi 2 pi 8) of E v^2 is missing, also where stops act
    for name in ("displacement_std", "impact_speed_rate"):
        (pair,) = simulated.impact_pairs.values()
        own = pair if name.startswith("impact") else simulated.coordinates["x"]
        found = getattr(own, name)
        assert found.value == pytest.approx(
            known[name], abs=4.5 * found.standard_error + (found.bias or 0.0) + 0.02 * known[name]
        )
