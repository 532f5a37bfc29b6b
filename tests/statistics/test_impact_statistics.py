"""Impacts one by one: against exact laws, made-up processes, and the sums of the kernels."""

from __future__ import annotations

import json
import math
import pickle
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2, kstest, norm

import stochvi
from stochvi import ForceFunction
from stochvi.engine.arithmetic import COLUMNS, Log
from stochvi.mathematics.impact_rates import corner_exponent
from stochvi.mathematics.numerics import Vector as VectorOfNumerics
from stochvi.mathematics.spectra import Table
from stochvi.methods.closed_form import exact
from stochvi.methods.fokker_planck import first_passage, fokker_planck
from stochvi.methods.monte_carlo import simulate
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import ImpactLog, make_plan, plan_impacts
from stochvi.motion.kernels import flight
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.results.estimates import Estimate, mean_and_error, ratio_and_error
from stochvi.scenes.excitations import ConstantLoad, FilteredNoise, Sine, TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import (
    Elastic,
    Hertz,
    PowerLaw,
    Restitution,
    SpeedRestitution,
    Viscoelastic,
)
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Isolator, Matrices, Oscillator
from stochvi.statistics import densities as module
from stochvi.statistics import impacts as impacts_module
from stochvi.statistics.densities import BandedDensity, densities, motions_of
from stochvi.statistics.histories import History, history
from stochvi.statistics.impacts import (
    BINS,
    CORNER_SHARE,
    SHIFT_PER_SHARE,
    WINDOWS,
    Grid,
    Tally,
    dispersion,
    fitted_exponent,
    histogram,
    impacts,
    linear_gap,
    passes_for_poisson,
    rate,
    rice_rates,
    vanmarcke_rate,
)
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases
from support.known import oscillator
from support.pairs import pair, uncoupled
from support.plain_contacts import PlainPair, plain_sums
from support.refusals import refusals

Vector = NDArray[np.float64]


def scene(restitution: float, lower: float | None = -1.0, upper: float | None = 1.0) -> Scene:
    law = Restitution(coefficient=restitution)
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=lower, upper=upper, law=law)],
        excitations=[WhiteNoise(intensity=0.2)],
    )


ELASTIC = scene(1.0)


@pytest.fixture(scope="module")
def elastic():
    return impacts(ELASTIC, rel_error=0.004, seed=1, threads=1, first_hits=True)


@pytest.mark.parametrize(("restitution", "slow"), [(1.0, False), (0.8, False), (0.5, True)])
def test_log_holds_what_the_kernel_adds_up(restitution: float, slow: bool) -> None:
    plan = plan_impacts(scene(restitution), slow_impacts=slow)
    log = plan.impacts(3, 5, 40)["stops"]
    sums = plan.source.averages(3, 5, 40) * plan.duration
    for side, first in ((-1.0, 3), (1.0, 6)):
        own = np.bincount(log.path[side * log.speed > 0.0], minlength=40)
        np.testing.assert_allclose(own, sums[first], rtol=1e-9)
    assert np.all(np.abs(log.speed) >= plan.thresholds["stops"])
    assert np.all(np.diff(log.path) >= 0)
    assert np.all((np.diff(log.time) >= 0.0) | (np.diff(log.path) > 0))
    assert log.time.min() > 0.0 and log.time.max() <= plan.duration * (1.0 + 1e-12)


def test_elastic_rates_speeds_and_theory(elastic) -> None:
    pair, known = elastic.pairs["stops"], exact(ELASTIC).impact_pairs["stops"]
    for side, name in (("both", ""), ("lower", "_lower"), ("upper", "_upper")):
        estimate = pair.rates[side].estimate
        truth = known[f"collision_rate{name}"].value
        assert_agrees(Estimate(value=estimate.value, standard_error=estimate.standard_error), truth)
    rms = pair.speed_rms
    assert_agrees(Estimate(value=rms.value, standard_error=rms.standard_error), math.sqrt(2.0))
    # Rayleigh's shares of bins, and as a control those of another rms speed
    edges = pair.speeds.edges
    share = -np.diff(np.exp(-(edges**2) / 2.0))
    often, width = share > 1e-3, np.diff(edges)

    def distance(expected: np.ndarray) -> float:
        away = (pair.speeds.density * width - expected)[often]
        return float(np.sum((away / (pair.speeds.standard_error * width)[often]) ** 2))

    assert distance(share) < chi2.isf(1e-5, often.sum())
    assert distance(-np.diff(np.exp(-(edges**2) / 2.1))) > chi2.isf(1e-5, often.sum())
    assert_agrees(pair.exponents["both"].fitted, 1.0)
    assert pair.energy.value == 0.0


def test_predictions_beside_them(elastic) -> None:
    pair = elastic.pairs["stops"]
    assert math.isclose(pair.rice_rates["both"], math.exp(-0.5) / math.pi)
    assert pair.clump_rate < pair.rice_rates["both"]
    assert pair.first_hit_rate is None  # all is lost before the memory ends


def test_vanmarcke_and_first_hits_at_two_deviations() -> None:
    far = impacts(scene(1.0, -2.0, 2.0), paths=64, threads=1, first_hits=True).pairs["stops"]
    assert math.isclose(far.clump_rate / far.rice_rates["both"], 0.43, abs_tol=5e-5)
    # the decay rate of the first passage, by the Fokker-Planck equation
    assert_agrees(far.first_hit_rate, 0.017595300)


def test_vanmarcke_at_one_stop_is_far_closer_than_rice() -> None:
    """To the decay rate of the first passage, by the Fokker-Planck equation."""
    upper = scene(1.0, None, 3.0)
    truth = first_passage(upper).decay_rate.value
    model = model_of(upper)
    (pair,) = model.pairs
    gap = linear_gap(model, pair)
    off = [abs(math.log(rate / truth)) for rate in (
        vanmarcke_rate(gap, pair), rice_rates(gap, pair)["both"]
    )]  # fmt: skip
    assert off[0] < 0.25 * off[1]


def test_overdispersion_and_what_the_interval_rests_on(elastic) -> None:
    pair = elastic.pairs["stops"]
    assert pair.dispersion.value > 1.0 + 10.0 * pair.dispersion.standard_error
    assert pair.dispersion.bias == 0.0  # any step samples elastic stops exactly
    lossy = impacts(scene(0.5, -1.0, 1.0), paths=64, duration=200.0, threads=1).pairs["stops"]
    assert lossy.dispersion.bias is None
    assert {each.interval for each in pair.rates.values()} == {"paths"}
    assert "clusters" in elastic.summary()


def made_up(rate_of: float, clump: int, paths: int, seed: int) -> tuple[ImpactLog, Grid]:
    """Poisson's process of clumps of so many impacts at once, speeds from w^0.3 on (0.01, 1)."""
    random = np.random.default_rng(seed)
    duration = 200.0
    counts = random.poisson(rate_of * duration, paths)
    path = np.repeat(np.arange(paths), counts * clump)
    time = np.concatenate(
        [np.repeat(np.sort(random.uniform(0.0, duration, n)), clump) for n in counts]
    )
    low, high, power = 0.01, 1.0, 1.3
    u = random.uniform(size=len(path))
    speed = (low**power + u * (high**power - low**power)) ** (1.0 / power)
    grid = Grid(
        speeds=np.geomspace(0.01, 10.0, BINS + 1),
        intervals=np.geomspace(1e-3, 200.0, BINS + 1),
        fits=((0.01, 0.5), (0.01, 0.25)),
        window=duration / WINDOWS,
    )
    return ImpactLog(path=path, time=time, speed=speed, lost=speed**2), grid


@pytest.mark.parametrize("clump", [1, 3])
def test_dispersion_of_known_processes(clump: int) -> None:
    log, grid = made_up(0.5, clump, 300, seed=clump)
    tally = Tally.of(log, 300, grid)
    found = dispersion(tally.windows, grid.window)
    assert_agrees(found, float(clump))
    assert passes_for_poisson(found) is (clump == 1)
    assert tally.numbers[:, 0].sum() == 0.0
    assert tally.numbers.sum() == len(log.speed)
    value, error = ratio_and_error(tally.energies.sum(axis=1), tally.numbers.sum(axis=1))
    mean_square = 1.3 / 3.3 * (1.0 - 0.01**3.3) / (1.0 - 0.01**1.3)
    assert_agrees(Estimate(value=value, standard_error=error), mean_square)


def test_fitted_exponent_of_a_pure_power() -> None:
    log, grid = made_up(1.0, 1, 200, seed=7)
    found = fitted_exponent(Tally.of(log, 200, grid).fits.sum(axis=1), grid.fits)
    plain = Estimate(value=found.value, standard_error=found.standard_error)
    assert_agrees(plain, 0.3)
    with pytest.raises(AssertionError):
        assert_agrees(plain, 0.5)


def test_intervals_cover_as_often_as_they_say() -> None:
    """Poisson's exact ones at least 95 %, those over paths about 95 %, and Poisson's ones far less
    where impacts come in clumps."""
    random = np.random.default_rng(11)
    runs, paths = 1000, 40

    def covered(clump: int, poisson: bool) -> float:
        hits = 0
        for counts in clump * random.poisson(4.0, (runs, paths)):
            found = rate(counts.astype(float), 1.0, poisson, "")
            hits += found.lower <= 4.0 * clump <= found.upper
        return hits / runs

    deviation = math.sqrt(0.95 * 0.05 / runs)
    assert covered(1, True) > 0.95 - 3.0 * deviation
    assert abs(covered(1, False) - 0.95) < 4.5 * deviation
    assert abs(covered(4, False) - 0.95) < 4.5 * deviation
    assert covered(4, True) < 0.8


def test_exponent_and_energy_of_a_lossy_stop() -> None:
    """At the rest position nothing but noise moves a slow mass: the power law of the corner."""
    found = impacts(
        scene(0.8, None, 0.0), paths=2048, speed_threshold=0.02, slow_impacts=True, seed=1,
        threads=1,
    ).pairs["stops"]  # fmt: skip
    exponent = found.exponents["both"]
    plain = Estimate(value=exponent.fitted.value, standard_error=exponent.fitted.standard_error)
    assert exponent.theory == 1.0 - corner_exponent(0.8)
    assert_agrees(plain, exponent.theory)
    with pytest.raises(AssertionError):
        assert_agrees(plain, 1.0)
    square, energy = found.speed_rms.value**2, found.energy
    assert math.isclose(energy.value, 0.5 * (1.0 - 0.8**2) * square, rel_tol=1e-9)
    # each exponent has its side where restitutions differ
    both = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[
            ImpactPair(
                lower=-0.5, upper=0.5,
                lower_law=Restitution(coefficient=0.7), upper_law=Restitution(coefficient=1.0),
            )
        ],
        excitations=[WhiteNoise(intensity=0.2)],
    )  # fmt: skip
    assert set(impacts(both, paths=512, threads=1).pairs["stops"].exponents) == {"lower", "upper"}


@pytest.mark.parametrize(("mass", "unit"), [(None, "J/kg"), (2.0, "J")])
def test_energy_per_impact_is_that_of_a_kilogram_where_no_mass_is_given(mass, unit) -> None:
    isolator = Scene(
        structure=Isolator(mass=mass, frequency_hz=12.0, zeta=0.1),
        impact_pairs=[ImpactPair(lower=-1e-3, upper=1e-3, law=Restitution(coefficient=0.5))],
        excitations=[WhiteNoise(intensity=0.2, on="base")],
    )
    found = impacts(isolator, paths=64, threads=1)
    table = found.to_frame().set_index("quantity")
    assert table.loc["energy lost per impact", "unit"] == unit
    assert found.to_dict()["impact_pairs"]["stops"]["energy_unit"] == unit
    pair = found.pairs["stops"]
    square = pair.speed_rms.value**2
    assert math.isclose(pair.energy.value, 0.5 * (mass or 1.0) * 0.75 * square, rel_tol=1e-9)


def oscillator_between(law, load: float = 0.0, clearance: float = 1.0) -> Scene:
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-clearance, upper=clearance, law=law)],
        excitations=[WhiteNoise(intensity=0.2)] + [ConstantLoad(force=load)] * (load != 0.0),
    )


@pytest.mark.parametrize("load", [0.0, 0.4])
@pytest.mark.parametrize("stiffness", [2.0, 50.0])
def test_energy_lost_on_a_compliant_stop_is_what_the_noise_brings(stiffness, load) -> None:
    """S0 / 2 = b E v^2 + rate times loss, by the Fokker-Planck equation; a free mass would lose up
    to twice as much, since spring and load act in the contact as well."""
    law = Viscoelastic(stiffness=stiffness, damping_ratio=0.2)
    pressed = oscillator_between(law, load)
    known = fokker_planck(pressed)
    speed = known.coordinates["x"].velocity_std.value
    truth = 0.1 * (1.0 - speed**2) / known.impact_pairs["stops"].collision_rate.value
    found = impacts(pressed, paths=1024, seed=4, threads=1).pairs["stops"]
    assert_agrees(found.energy, truth)
    with pytest.raises(AssertionError):
        assert_agrees(found.energy, (1.0 - law.restitution**2) * found.striking_energy.value)


def test_energy_lost_by_other_laws() -> None:
    """Nothing on round bodies without losses; on bodies whose restitution depends on the speed that
    of each impact."""
    assert (
        impacts(oscillator_between(Hertz(coefficient=20.0)), paths=64, threads=1)
        .pairs["stops"]
        .energy.value
        == 0.0
    )
    steel = SpeedRestitution(speed=[0.05, 0.5, 2.0], coefficient=[0.95, 0.7, 0.5])
    plan = plan_impacts(oscillator_between(steel), duration=50.0)
    log = plan.impacts(1, 0, 8)["stops"]
    kept = np.interp(np.abs(log.speed), [0.05, 0.5, 2.0], [0.95, 0.7, 0.5])
    np.testing.assert_allclose(log.lost, 0.5 * (1.0 - kept**2) * log.speed**2, atol=1e-12)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_energy_of_stops_that_rub_is_left_out(friction: float) -> None:
    """Friction took a third of the energy beside that: a balance of powers has .75 W for .48 W."""
    rubs = {"tangent": "b"} if friction else {}
    law = Restitution(coefficient=0.6, **({"friction": friction} if friction else {}))
    structure = Matrices(
        coordinates=["a", "b"], mass=[[2.0, 0.2], [0.2, 1.0]], damping=[[2.0, -0.6], [-0.6, 0.8]],
        stiffness=[[900.0, -300.0], [-300.0, 500.0]],
    )  # fmt: skip
    scene = Scene(
        structure=structure,
        impact_pairs=[ImpactPair(name="p", on="a", lower=-0.03, upper=0.03, law=law, **rubs)],
        excitations=[WhiteNoise(intensity=3.0, on="a")],
    )
    found = impacts(scene, paths=64, duration=5.0, threads=1)
    assert (found.pairs["p"].energy is None) == bool(friction)
    assert found.pairs["p"].striking_energy is not None
    assert any("friction takes a part" in each for each in found.warnings) == bool(friction)


BOTH = PowerLaw(coefficient=5.0, exponent=1.5, loss=3.0, loss_exponent=1.0)


@pytest.mark.slow
@pytest.mark.parametrize(("load", "threshold"), [(0.0, 0.1), (1.5, 0.1), (0.0, 0.8)])
def test_what_fast_impacts_lose_is_the_work_of_plain_contacts(load, threshold) -> None:
    """Of a stop whose spring and loss both stiffen, by plain steps; also of a mass that a load
    presses on it. Impacts that do not count have no share in it."""

    def sums(step: float):
        one = np.eye(1)
        pair = PlainPair(np.ones(1), -1.0, 1.0, lambda y, v: 5.0 * y**1.5 + 3.0 * y * v)
        return plain_sums(
            one, 0.1 * one, one, [0.2], [load], [pair], step=step, burn_in=30.0, seconds=150.0,
            paths=512, seed=5, threshold=threshold,
        )[0]  # fmt: skip

    own, coarse = sums(0.02), sums(0.04)
    value, error = ratio_and_error(own.work, own.touches)
    at_twice = ratio_and_error(coarse.work, coarse.touches)
    found = (
        impacts(
            oscillator_between(BOTH, load), paths=512, seed=6, threads=1, speed_threshold=threshold
        )
        .pairs["stops"]
        .energy
    )
    both = math.hypot(found.standard_error, error, at_twice[1])
    bias = abs(at_twice[0] - value) + (found.bias or 0.0)
    assert_agrees(Estimate(value=found.value, standard_error=both, bias=bias), value)
    if load == 0.0:  # while it pushes, which ends before the mass is back
        answer = simulate(oscillator_between(BOTH), rel_error=0.01, seed=7, threads=1)
        share = answer.impact_pairs["stops"].contact_probability
        plain, error = mean_and_error(own.pushed / 150.0)
        at_twice = mean_and_error(coarse.pushed / 150.0)
        both = math.hypot(share.standard_error, error, at_twice[1])
        bias = abs(at_twice[0] - plain) + share.bias
        assert_agrees(Estimate(value=share.value, standard_error=both, bias=bias), plain)


@pytest.mark.slow
def test_what_two_masses_lose_is_the_work_of_plain_contacts() -> None:
    mass, damping = [[2.0, 0.2], [0.2, 1.0]], [[2.0, -0.6], [-0.6, 0.8]]
    stiffness = [[900.0, -300.0], [-300.0, 500.0]]
    first = PowerLaw(coefficient=2e4, exponent=1.5, loss=8e3, loss_exponent=1.0)
    second = Viscoelastic(stiffness=5e3, damping_ratio=0.2)
    two = Scene(
        structure=Matrices(coordinates=["a", "b"], mass=mass, damping=damping, stiffness=stiffness),
        impact_pairs=[
            ImpactPair(name="p", on="a", lower=-0.03, upper=0.03, law=first),
            ImpactPair(name="q", between=("a", "b"), lower=-0.05, upper=0.05, law=second),
        ],
        excitations=[WhiteNoise(intensity=3.0, on="a"), WhiteNoise(intensity=1.0, on="b")],
    )
    found = impacts(two, paths=128, duration=20.0, seed=2, threads=1, speed_threshold=0.05).pairs
    rows = np.array([1.0, 0.0]), np.array([-1.0, 1.0])
    reduced = 1.0 / (rows[1] @ np.linalg.inv(np.array(mass)) @ rows[1])
    damper = 2.0 * 0.2 * math.sqrt(5e3 * reduced)
    pairs = [
        PlainPair(rows[0], -0.03, 0.03, lambda y, v: 2e4 * y**1.5 + 8e3 * y * v),
        PlainPair(rows[1], -0.05, 0.05, lambda y, v: 5e3 * y + damper * v),
    ]
    own = plain_sums(
        np.array(mass), np.array(damping), np.array(stiffness), [3.0, 1.0], [0.0, 0.0], pairs,
        step=4e-4, burn_in=5.0, seconds=5.0, paths=384, seed=3, threshold=0.05,
    )  # fmt: skip
    for each, sums in zip((found["p"], found["q"]), own, strict=True):
        value, error = ratio_and_error(sums.work, sums.touches)
        both = math.hypot(each.energy.standard_error, error)
        bias = each.energy.bias or 0.0
        assert_agrees(Estimate(value=each.energy.value, standard_error=both, bias=bias), value)


@pytest.mark.slow
def test_exponents_of_very_lossy_stops_take_shorter_steps_near_them(monkeypatch) -> None:
    """Steps that are the usual share of what noise takes shift the power itself."""

    def fitted() -> Estimate:
        found = impacts(
            scene(0.3, None, 0.0), paths=1024, speed_threshold=0.02, slow_impacts=True, seed=2,
            threads=1,
        )  # fmt: skip
        return found.pairs["stops"].exponents["both"].fitted

    theory = 1.0 - corner_exponent(0.3)
    resolved = fitted()
    # the bias of the range of speeds is left out: by the steps alone it is 0.57 of their share
    steps = SHIFT_PER_SHARE * CORNER_SHARE
    assert resolved.bias is not None and resolved.bias >= steps
    assert_agrees(replace(resolved, bias=steps), theory)
    monkeypatch.setattr("stochvi.statistics.impacts.CORNER_SHARE", flight.CORNER_SHARE)
    with pytest.raises(AssertionError):
        assert_agrees(replace(fitted(), bias=steps), theory)
    # without refined steps nothing is known of what they leave
    plain = impacts(scene(0.3, None, 0.0), paths=64, seed=2, threads=1).pairs["stops"]
    assert all(each.fitted.bias is None for each in plain.exponents.values())


def test_a_mass_that_a_load_alone_presses_on_a_stop() -> None:
    pressed = Scene(
        structure=Oscillator(mass=1.0, damping=0.4, stiffness=0.0),
        impact_pairs=[ImpactPair(upper=1.0, law=Restitution(coefficient=1.0))],
        excitations=[WhiteNoise(intensity=0.2), ConstantLoad(force=0.5)],
    )
    found = impacts(pressed, paths=256, seed=2, threads=1).pairs["stops"].rates["both"].estimate
    rate = replace(found, bias=0.0)  # steps leave the law of elastic stops as it is
    # the displacement has the law (g / s^2) exp(-g (1 - x) / s^2), where impacts are s / sqrt(2 pi)
    truth = 0.5 / 0.5 / math.sqrt(2.0 * math.pi)
    assert_agrees(rate, truth)
    with pytest.raises(AssertionError):
        assert_agrees(rate, 1.1 * truth)


def process_in_windows(waits: Vector, paths: int, duration: float) -> ImpactLog:
    """Impacts of one long process with these waiting times, cut into paths that begin apart."""
    times = np.cumsum(waits)
    starts = times[-1] * np.arange(1, paths + 1) / (paths + 2)
    first, last = (np.searchsorted(times, starts + end) for end in (0.0, duration))
    path = np.repeat(np.arange(paths), last - first)
    time = np.concatenate([times[a:b] for a, b in zip(first, last, strict=True)]) - starts[path]
    speed = np.full(len(time), 0.1)
    return ImpactLog(path=path, time=time, speed=speed, lost=speed**2)


@pytest.mark.parametrize(("duration", "paths"), [(12.0, 20000), (400.0, 2000)])
@pytest.mark.parametrize("dependent", [False, True])
def test_densities_of_intervals_hold_at_any_length_of_paths(duration, paths, dependent) -> None:
    """A third of the waiting times are 0.1 s on average, the others 20 s; or each kind comes in
    rows of eight. Counts of the intervals that end within a path are no density."""
    random, number = np.random.default_rng(3), 2**21
    quick = random.uniform(size=number // 8 if dependent else number) < 1.0 / 3.0
    quick = np.repeat(quick, 8) if dependent else quick
    waits = np.where(quick, 0.1, 20.0) * random.exponential(size=number)
    edges = np.geomspace(1e-3, 0.8 * duration, BINS + 1)
    grid = replace(made_up(0.5, 1, 2, 0)[1], intervals=edges, window=duration / WINDOWS)
    log = process_in_windows(waits, paths, duration)
    tally = Tally.of(log, paths, grid)
    numbers = tally.numbers.sum(axis=1)
    found = histogram(tally.intervals, edges, numbers)

    def beyond(t: Vector) -> Vector:
        return np.asarray(np.exp(-t / 0.1) / 3.0 + 2.0 / 3.0 * np.exp(-t / 20.0))

    # five bins together, and all: what is left is outside
    groups = [slice(first, first + 5) for first in range(0, BINS, 5)] + [slice(0, BINS)]
    truths = [beyond(edges[each.start]) - beyond(edges[each.stop]) for each in groups]
    waited = np.diff(log.time)[np.diff(log.path) == 0]
    seen = np.histogram(waited, edges)[0] / len(waited)
    scores, plain = [], []
    for each, truth in zip(groups, truths, strict=True):
        value, error = ratio_and_error(tally.intervals[:, 1:-1][:, each].sum(axis=1), numbers)
        assert math.isclose(value, (found.density * np.diff(edges))[each].sum())
        scores.append((value - truth) / error)
        plain.append((seen[each].sum() - truth) / error)
    assert max(np.abs(scores)) < 4.5
    assert math.isclose(found.outside, 1.0 - (found.density * np.diff(edges)).sum())
    assert (max(np.abs(plain)) > 20.0) == (duration < 20.0)


def test_times_between_impacts_agree_with_the_rate() -> None:
    """Where paths hold few impacts: the probability that an impact follows a moment within a time
    is the rate times the mean of the times between impacts, longer ones counted as that time."""
    lossy, paths, duration = scene(0.5, -2.0, 2.0), 2048, 60.0
    answer = impacts(lossy, paths=paths, duration=duration, seed=4, threads=1)
    pair = answer.pairs["stops"]
    found, rate = pair.intervals, pair.rates["both"].estimate
    assert found.outside > 0.05 and any("outside the bins" in each for each in answer.warnings)
    width, longest = np.diff(found.edges), found.edges[-1]
    middles = 0.5 * (found.edges[1:] + found.edges[:-1])
    mean = longest - float(np.sum(found.density * width * (longest - middles)))
    log = plan_impacts(lossy, duration=duration).impacts(5, 0, paths)["stops"]
    soon = np.zeros(paths)
    soon[log.path[log.time < longest]] = 1.0
    chance, error = mean_and_error(soon)
    scatter = math.hypot(error, mean * rate.standard_error)
    assert abs(chance - mean * rate.value) < 4.5 * scatter
    # as if all intervals had ended in a path
    inside = float(np.sum(found.density * width))
    short = mean - found.outside * longest
    assert abs(chance - short / inside * rate.value) > 10.0 * scatter


def interval_shares(times: np.ndarray, path: np.ndarray, edges: np.ndarray, paths: int):
    """Share of the times between impacts in each bin, with its standard error."""
    waited, same = np.diff(times), np.diff(path) == 0
    place = np.searchsorted(edges, waited[same]) - 1
    inside = (place >= 0) & (place < len(edges) - 1)
    counts = np.zeros((paths, len(edges) - 1))
    np.add.at(counts, (path[1:][same][inside], place[inside]), 1.0)
    all_of = counts.sum(axis=1)
    return np.array([ratio_and_error(counts[:, k], all_of) for k in range(counts.shape[1])]).T


def test_times_between_impacts_are_those_of_a_fine_step() -> None:
    """A step of 0.7 s holds the usual time between impacts, so that times at its end say nothing
    of the density."""
    paths, edges = 1000, np.arange(0.5, 8.01, 0.25)
    plan = plan_impacts(ELASTIC, duration=100.0)
    fine = replace(plan, source=replace(plan.source.with_step(0.025), duration=100.0))
    assert plan.step > 0.5
    ours, reference = (each.impacts(0, 0, paths)["stops"] for each in (plan, fine))

    def distance(times: np.ndarray) -> float:
        found, error = interval_shares(times, ours.path, edges, paths)
        # the reference knows times to a twenty-eighth of the step only, as the control does
        known = fine.step * np.ceil(reference.time / fine.step)
        expected, other = interval_shares(known, reference.path, edges, paths)
        return float(np.sum((found - expected) ** 2 / (error**2 + other**2)))

    # shares add up to 1, so that one of them follows from the others
    assert distance(ours.time) < chi2.isf(1e-5, len(edges) - 2)
    ends = plan.step * np.ceil(ours.time / plan.step)
    assert distance(ends) > 100.0 * chi2.isf(1e-5, len(edges) - 2)


def check_log_against_record(scene: Scene) -> None:
    """Impacts add up, step by step, to the speeds that a record holds, and fall within steps."""
    source = plan_impacts(scene, speed_threshold=0.0).source
    width = getattr(source, "record_width", 3)
    record = np.zeros((source.steps, 3, width))
    log = Log(np.empty((10**6, COLUMNS)), np.zeros(1, np.int64), 0.0)
    source.averages(3, 5, 3, record, log=log)
    path, pair, time, speed = log.events[: log.count[0]].T
    summed = np.zeros(record.shape[:2])
    # a time at the end of a step is that of its last moment
    step = np.minimum(np.floor(time / source.step * (1.0 - 1e-12)), len(record) - 1).astype(int)
    np.add.at(summed, (step, path.astype(int)), speed)
    assert len(speed) > 10 and not pair.any()
    np.testing.assert_allclose(summed, record[:, :, -1], rtol=0, atol=1e-9 * np.abs(speed).max())
    within = np.mod(time / source.step, 1.0)
    assert kstest(within, "uniform").pvalue > 1e-4


TRUCK = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")


def two_storeys(law: Restitution | Viscoelastic, *more: Sine) -> Scene:
    """A board in a box on a truck, and what it hits there."""
    return Scene(
        structure=Matrices(
            coordinates=["box", "board"], mass=[[2.0, 0.0], [0.0, 0.5]],
            damping=[[30.0, -5.0], [-5.0, 5.0]], stiffness=[[14000.0, -4000.0], [-4000.0, 4000.0]],
        ),
        impact_pairs=[ImpactPair(between=("board", "box"), lower=-3e-3, upper=3e-3, law=law)],
        excitations=[TRUCK.model_copy(update={"on": "base"}), *more],
    )  # fmt: skip


RUBBER = Viscoelastic(stiffness=1e5, damping_ratio=0.2)


@quick_cases(
    "kind",
    ["table", "matrices", "elastic", "matrices elastic", "matrices table", "table rubber",
     "matrices table rubber", "matrices table sine"], keep=(0, 1, 2, 4, 5))  # fmt: skip
def test_rates_from_single_impacts_are_those_of_the_sums(kind: str) -> None:
    stops = ImpactPair(lower=-2e-3, upper=2e-3, law=Restitution(coefficient=0.8))
    given = {
        "table": Scene(
            structure=Isolator(frequency_hz=12.0, zeta=0.1),
            impact_pairs=[stops],
            excitations=[TRUCK],
        ),
        "table rubber": Scene(
            structure=Isolator(mass=1.0, frequency_hz=12.0, zeta=0.1),
            impact_pairs=[ImpactPair(lower=-2e-3, upper=2e-3, law=RUBBER)],
            excitations=[TRUCK],
        ),
        "matrices elastic": Scene(
            structure=Matrices(
                coordinates=["x", "y"], mass=[[1.0, 0.0], [0.0, 0.3]],
                damping=[[0.2, 0.0], [0.0, 0.1]], stiffness=[[1.5, -0.5], [-0.5, 0.5]],
            ),
            impact_pairs=[ImpactPair(on="y", upper=1.0, law=Elastic(stiffness=30.0))],
            excitations=[WhiteNoise(intensity=0.2, on="x")],
        ),
        "matrices table": two_storeys(Restitution(coefficient=0.8)),
        "matrices table rubber": two_storeys(RUBBER),
        "matrices table sine": two_storeys(
            RUBBER, Sine(on="base", amplitude=5.0, frequency_hz=15.0)
        ),
        "matrices": Scene(
            structure=Matrices(
                coordinates=["x", "y"], mass=[[1.0, 0.0], [0.0, 0.3]],
                damping=[[0.2, 0.0], [0.0, 0.1]], stiffness=[[1.5, -0.5], [-0.5, 0.5]],
            ),
            impact_pairs=[
                ImpactPair(between=("y", "x"), lower=-1.0, upper=1.0,
                           law=Restitution(coefficient=0.8))
            ],
            excitations=[WhiteNoise(intensity=0.2, on="x")],
        ),
        "elastic": Scene(
            structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
            impact_pairs=[ImpactPair(upper=1.0, law=Elastic(stiffness=100.0))],
            excitations=[WhiteNoise(intensity=0.2)],
        ),
    }[kind]  # fmt: skip
    check_log_against_record(given)
    found = impacts(given, paths=16, threads=1)
    (pair,) = found.pairs.values()
    (other,) = simulate(given, paths=16, seed=77, threads=1).impact_pairs.values()
    one, two = pair.rates["both"].estimate, other["collision_rate"]
    error = math.hypot(one.standard_error, two.standard_error)
    assert_agrees(Estimate(value=one.value, standard_error=error), two.value)


def test_never_hit() -> None:
    found = impacts(scene(1.0, None, 9.0), paths=16, threads=1)
    pair = found.pairs["stops"]
    both = pair.rates["both"]
    assert both.estimate.value == 0.0 and both.interval == "Poisson"
    # the exact upper limit at no cluster, of as many impacts as a relaxation time has periods
    cluster = max(1.0, 1.0 / (2.0 * math.pi) / 0.1)
    assert math.isclose(both.upper, -math.log(0.05) * cluster / (16 * found.duration), rel_tol=1e-6)
    assert pair.speeds is None and pair.dispersion is None
    assert "no impact" in found.summary()
    (warning,) = (each for each in found.warnings if "upper limit only" in each)
    assert "no impact on the upper stop of stops" in warning
    found.to_dict()


def test_what_is_never_hit_is_looked_for_until_paths_or_time_run_out(monkeypatch) -> None:
    told: list[float] = []
    monkeypatch.setattr(impacts_module, "MOST_UNSEEN", 3000)
    far = scene(1.0, -9.0, 9.0)
    for budget, fewest in ((None, 3000), (1e-3, 2)):
        with pytest.raises(NotConverged, match=r"no impact was seen in \d+ paths") as stopped:
            impacts(far, budget=budget, threads=1, progress=lambda done, text: told.append(done))
        answer = stopped.value.partial
        assert answer.cost.paths >= fewest
        assert answer.warnings[0] == "the accuracy asked for was not reached"
        assert answer.pairs["stops"].rates["both"].estimate.upper_95 > 0.0
    assert set(told) == {0.0}


def test_a_pair_that_is_never_hit_does_not_govern_another() -> None:
    law = Restitution(coefficient=0.8)
    chain = Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=np.eye(2).tolist(), damping=(0.2 * np.eye(2)).tolist(),
            stiffness=np.eye(2).tolist(),
        ),
        impact_pairs=[
            ImpactPair(name="near", on="a", upper=0.5, law=law),
            ImpactPair(name="far", on="b", upper=50.0, law=law),
        ],
        excitations=[WhiteNoise(intensity=0.2, on=each) for each in "ab"],
    )  # fmt: skip
    found = impacts(chain, rel_error=0.2, duration=50.0, threads=1)
    assert found.pairs["near"].rates["both"].estimate.value > 0.0
    assert any("upper stop of far" in each for each in found.warnings)


def test_an_answer_that_falls_short_is_carried_by_an_error() -> None:
    with pytest.raises(NotConverged, match=r"relative standard error .* asked for 1e-05") as short:
        impacts(ELASTIC, rel_error=1e-5, budget=1e-3, threads=1)
    # two paths may have the same number of impacts by chance
    assert short.value.partial.cost.paths < impacts_module.FEWEST_PATHS
    with pytest.raises(NotConverged, match=r"0.001 s ended after \d+ of 1000000 paths") as short:
        impacts(ELASTIC, paths=10**6, budget=1e-3, threads=1)
    assert 2 <= short.value.partial.cost.paths < 10**6
    few = impacts(ELASTIC, paths=2, duration=1.0, seed=1, threads=1)
    assert "too few impacts" in few.summary()


def test_views_and_errors(elastic) -> None:
    frame = elastic.to_frame()
    assert {"rate, both", "Rice without stops, both"} <= set(frame["quantity"])
    assert set(elastic.histograms()["histogram"]) == {"speed", "interval"}
    assert elastic.to_dict()["impact_pairs"]["stops"]["rates"]["both"]["interval"] == "paths"
    free = Scene(structure=ELASTIC.structure, excitations=ELASTIC.excitations)
    with pytest.raises(NotApplicable, match="impact pair"):
        impacts(free)


test_an_argument_out_of_range_is_refused = refusals(
    lambda arguments: impacts(ELASTIC, **arguments),
    ({"rel_error": 2.0}, "rel_error must be in"),
    ({"paths": 64, "rel_error": 0.1}, "give rel_error or paths, not both"),
    ({"paths": 64.5}, "paths must be a whole number"),
    ({"duration": 0.0}, "duration must be a positive number of seconds"),
    ({"duration": math.nan}, "duration must be a positive number of seconds"),
    ({"speed_threshold": -1.0}, "speed_threshold must be at least 0"),
    ({"seed": 1.5}, "seed must be a whole number"),
    ({"threads": 0}, "threads must be at least 1"),
    error=ValueError,
)


def test_the_energy_is_per_kilogram_where_no_mass_is_given(elastic) -> None:
    mount = Scene(
        structure=Isolator(frequency_hz=1.0, zeta=0.1),
        impact_pairs=[ImpactPair(upper=0.1, law=Restitution(coefficient=0.5))],
        excitations=[WhiteNoise(intensity=0.2)],
    )
    found = impacts(mount, paths=64, threads=1)
    units = found.to_frame().set_index("quantity")["unit"]
    assert units["energy lost per impact"] == "J/kg"
    assert any("energies depend on" in each for each in found.assumptions)
    assert elastic.pairs["stops"].energy_unit == "J"


def test_a_blow_has_the_energy_of_the_equation() -> None:
    """Energies per impact from F2 over the rate of the Fokker-Planck equation, for 2 kg."""
    pair = ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=0.6))
    shaken = Scene(
        structure=Oscillator(mass=2.0, damping=0.2, stiffness=2.0),
        impact_pairs=[pair],
        excitations=[WhiteNoise(intensity=0.8)],
    )
    found = impacts(shaken, paths=512, speed_threshold=0.05, seed=1, threads=1).pairs["stops"]
    known = fokker_planck(shaken, speed_threshold=0.05).impact_pairs["stops"]
    blow = 0.5 * 2.0 * known["impact_speed_square_rate"].value / known["collision_rate"].value
    assert found.striking_energy is not None and found.energy is not None
    assert found.energy_unit == "J"
    for energy, truth in ((found.striking_energy, blow), (found.energy, (1.0 - 0.6**2) * blow)):
        plain = Estimate(value=energy.value, standard_error=energy.standard_error)
        assert_agrees(plain, truth)
        with pytest.raises(AssertionError):  # that of a kilogram
            assert_agrees(plain, 0.5 * truth)


def test_words_need_a_difference_that_matters(elastic) -> None:
    """Rare impacts have a variance over mean just below 1 in any windows."""
    pair = elastic.pairs["stops"]

    def words(value: float) -> str:
        spread = Estimate(value=value, standard_error=3e-5)
        return replace(elastic, pairs={"stops": replace(pair, dispersion=spread)}).summary()

    assert "as scattered as Poisson" in words(0.9998) and "as scattered as Poisson" in words(1.0002)
    assert "more regular" in words(0.9) and "in clusters" in words(1.1)


@pytest.mark.parametrize("restitution", [0.7, 0.5])
def test_intervals_include_the_bias_of_the_step(restitution: float) -> None:
    """Against the Fokker-Planck equation, where the mass rests at a stop."""
    resting = scene(restitution, lower=0.0, upper=None)
    found = impacts(resting, rel_error=0.004, seed=1).pairs["stops"]
    known = fokker_planck(resting, speed_threshold=found.speed_threshold).impact_pairs["stops"]
    true = known["collision_rate"].value
    square = known["impact_speed_square_rate"].value / true
    usual = found.rates["both"]
    assert usual.lower < true < usual.upper
    assert found.rates["lower"].estimate == usual.estimate
    assert_agrees(found.speed_rms, math.sqrt(square))
    assert_agrees(found.energy, 0.5 * (1.0 - restitution**2) * square)
    # the control: the statistical error alone is too small
    assert usual.estimate.value + 1.96 * usual.estimate.standard_error < true
    assert usual.estimate.bias is not None and usual.estimate.bias < 0.1 * true
    elastic = impacts(scene(1.0, lower=0.0, upper=None), paths=64, duration=20.0)
    assert elastic.pairs["stops"].rates["both"].estimate.bias == 0.0


def test_an_answer_says_where_its_step_misses_slow_impacts() -> None:
    """Where the mass rests at a stop of R = 0.3 the interval does not hold the rate of the
    Fokker-Planck equation; the note says so. With resolved impacts, and at R = 0.9, none is made,
    and the rate is within the interval and the bias of the finest step."""
    resting = scene(0.3, lower=0.0, upper=None)
    plain = impacts(resting, rel_error=0.01, seed=1)
    known = fokker_planck(resting, speed_threshold=plain.pairs["stops"].speed_threshold)
    true = known.impact_pairs["stops"]["collision_rate"]
    usual = plain.pairs["stops"].rates["both"]
    assert true.value - (true.bias or 0.0) > usual.upper
    assert any("--slow-impacts" in each and "0.3" in each for each in plain.warnings)
    resolved = impacts(resting, rel_error=0.01, seed=1, slow_impacts=True)
    found = resolved.pairs["stops"].rates["both"].estimate
    assert abs(found.value / true.value - 1.0) < 0.02 + 4.5 * found.standard_error / found.value
    assert not any("misses slow impacts" in each for each in resolved.warnings)
    both = impacts(scene(0.1), rel_error=0.01, seed=1, slow_impacts=True)
    assert any("bias of the step, which is not known" in each for each in both.warnings)
    light = impacts(scene(0.9, lower=0.0, upper=None), paths=64, duration=10.0)
    assert not any("misses slow impacts" in each for each in light.warnings)


# ------------------------------------------------------------------------------
# Densities by Monte Carlo, and the picture of a simulation that shows them.
# ------------------------------------------------------------------------------


ELASTIC_OF_DENSITIES = Scene(
    structure=Oscillator(mass=1.0, damping=0.2, stiffness=1.0),
    impact_pairs=[ImpactPair(lower=-1.0, upper=0.6, law=Restitution(coefficient=1.0))],
    excitations=[WhiteNoise(intensity=0.4)],
)
"""Of sigma 1 between elastic stops: the normal distribution, cut off at them, is exact."""


def exact_means(edges: VectorOfNumerics, sigma: float) -> VectorOfNumerics:
    """Means of the exact density over bins."""
    probability = np.diff(norm.cdf(edges, scale=sigma))
    total = norm.cdf(0.6, scale=sigma) - norm.cdf(-1.0, scale=sigma)
    return np.asarray(probability / total / np.diff(edges))


@pytest.mark.slow
@quick_cases("first", [0, 100, 200, 300, 400], keep=(0,))
def test_the_bands_hold_the_exact_density_as_often_as_they_promise(first: int) -> None:
    shares, control = [], []
    for seed in range(first, first + 24):
        found = densities(
            ELASTIC_OF_DENSITIES, {"x": (np.ones(1), -1.0, 0.6)}, seed=seed, threads=1
        )["x"]
        low, high = found.bands()
        assert len(found.density) == module.BINS
        assert float(found.density @ np.diff(found.edges)) == pytest.approx(1.0)
        for sigma, told in ((1.0, shares), (0.9, control)):
            exact = exact_means(found.edges, sigma)
            told.append(float(np.mean((low <= exact) & (exact <= high))))
    error = float(np.std(shares, ddof=1)) / math.sqrt(len(shares))
    assert abs(float(np.mean(shares)) - 0.95) < 4.5 * error
    assert abs(float(np.mean(control)) - 0.95) > 4.5 * error


def test_bins_that_hardly_any_path_was_in_are_left_out() -> None:
    shares = np.zeros((40, 5))
    shares[:, 1:3] = 0.45
    shares[:10, 3] = 0.1
    shares[0, 4] = 0.1
    found = BandedDensity.of(shares, 0.0, 5.0)
    assert found.edges.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert found.density == pytest.approx([0.45, 0.45, 0.025])
    # ten visits of forty: a binomial error at least
    assert found.standard_error[-1] >= 0.025 * math.sqrt(0.75 / 10.0)
    assert not len(BandedDensity.of(np.zeros((40, 5)), 0.0, 5.0).density)


def test_the_picture_of_a_simulation_shows_its_density_between_the_stops(tmp_path: Path) -> None:
    answer = stochvi.simulate(ELASTIC_OF_DENSITIES, paths=256, seed=1, threads=1)
    known = answer.densities()["x"]
    assert known.edges[[0, -1]].tolist() == [-1.0, 0.6]
    ax = answer.plot()
    walls = sorted(line.get_xdata()[0] for line in ax.get_lines() if line.get_linestyle() == "--")
    assert walls == [-1.0, 0.6]
    assert "95 % bands" in ax.get_ylabel() and len(ax.patches) == 2
    again = stochvi.load_answer(stochvi.save_answer(answer, tmp_path / "answer.json"))
    assert again.densities()["x"].density.tolist() == known.density.tolist()
    plt.close("all")


def test_every_gap_of_several_has_its_density_and_other_methods_have_none() -> None:
    scene = uncoupled(pair("left", "x", 1.0), pair("right", "z", 30.0))
    found = stochvi.simulate(scene, paths=64, seed=1, threads=1)
    motions = motions_of(found, stochvi.model.model.model_of(scene))
    assert list(motions) == ["left", "right"]
    assert motions["left"][1:] == (-1.0, 1.0)
    row, low, high = motions["right"]
    assert row.tolist() == [0.0, 1.0] and -30.0 < low < -4.0 < 4.0 < high < 30.0
    assert found.plot().get_legend() is not None
    soft = ELASTIC_OF_DENSITIES.replace(
        impact_pairs=[ImpactPair(upper=0.6, law=Elastic(stiffness=1e3))]
    )
    beyond = motions_of(found := stochvi.exact(soft), stochvi.model.model.model_of(soft))
    assert beyond["x"][2] > 0.6  # a compliant stop lets the mass pass
    assert found.densities() == {}
    plt.close("all")


def test_a_stop_that_is_a_function_has_its_density(tmp_path: Path) -> None:
    """That of the spring which the function is; from a file nobody knows the function."""
    answers = []
    for law in (ForceFunction(force=lambda y, v: 20.0 * y), Elastic(stiffness=20.0)):
        soft = ELASTIC_OF_DENSITIES.replace(
            impact_pairs=[ImpactPair(lower=-1.0, upper=0.6, law=law)]
        )
        answers.append(stochvi.simulate(soft, paths=64, seed=1, threads=1))
    by_function, by_law = (each.densities()["x"] for each in answers)
    error = np.hypot(
        np.interp(by_law.edges[:-1], by_function.edges[:-1], by_function.standard_error),
        by_law.standard_error,
    )
    there = np.interp(by_law.edges[:-1], by_function.edges[:-1], by_function.density)
    assert np.mean(np.abs(by_law.density - there) < 4.0 * error + 1e-6) > 0.95
    assert "made_from" not in json.dumps(answers[0].to_dict())
    read = stochvi.load_answer(stochvi.save_answer(answers[0], tmp_path / "answer.json"))
    with pytest.raises(NotApplicable, match="ask for it again"):
        read.densities()
    assert read.plot() is not None
    assert pickle.loads(pickle.dumps(answers[1])).provenance == answers[1].provenance
    plt.close("all")


def test_nothing_is_simulated_where_nobody_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise AssertionError("a density was simulated")

    monkeypatch.setattr(module, "densities", refused)
    answer = stochvi.simulate(ELASTIC_OF_DENSITIES, paths=64, seed=1, threads=1)
    assert "densities" not in answer.to_dict()
    with pytest.raises(AssertionError, match="was simulated"):
        answer.densities()


# ------------------------------------------------------------------------------
# One realisation: the path of `simulate`, consistent with its base and its impacts.
# ------------------------------------------------------------------------------


LOSSY, SOFT = Restitution(coefficient=0.8), Viscoelastic(stiffness=2e6, damping_ratio=0.2)
BOX = Isolator(mass=2.3, frequency_hz=18.0, Q=5.0)
SWING = Oscillator(mass=2.0, damping=0.2, stiffness=2.0)
TWO = Matrices(
    coordinates=["a", "b"],
    mass=[[2.0, 0.0], [0.0, 1.0]],
    damping=[[30.0, -10.0], [-10.0, 10.0]],
    stiffness=[[5e4, -2e4], [-2e4, 2e4]],
)
SHAKEN = TabulatedNoise(
    on="base", frequency_hz=[10.0, 40.0, 80.0, 200.0], density=[0.002, 0.04, 0.04, 0.004],
    unit="g2/Hz",
)  # fmt: skip
TONE = Sine(on="base", amplitude=5.0, frequency_hz=30.0)
WHITE = WhiteNoise(intensity=0.4)


def between(half: float, law: object = LOSSY, **places: object) -> ImpactPair:
    return ImpactPair(lower=-half, upper=half, law=law, **places)


def boxed(*excitations: object, half: float = 0.002, law: object = LOSSY) -> Scene:
    return Scene(structure=BOX, impact_pairs=[between(half, law)], excitations=excitations)


SCENES = {
    "white": Scene(structure=SWING, impact_pairs=[between(1.0)], excitations=[WHITE]),
    "white, soft": Scene(
        structure=SWING, impact_pairs=[between(1.0, Elastic(stiffness=200.0))], excitations=[WHITE]
    ),
    "table": boxed(SHAKEN),
    "table and sine": boxed(SHAKEN, TONE),
    "sine": boxed(Sine(on="base", amplitude=50.0, frequency_hz=18.0)),
    "filtered": boxed(FilteredNoise(on="base", intensity=2.0, frequency_hz=20.0, zeta=0.3)),
    "two masses": Scene(
        structure=TWO,
        impact_pairs=[between(0.002, between=("b", "a"))],
        excitations=[SHAKEN],
    ),
}


def slope(values: np.ndarray, step: float) -> np.ndarray:
    """The derivative of samples by central differences of the eighth order; the ends are left out
    as not a number."""
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
    found = np.full(len(values), np.nan)
    found[4:-4] = np.convolve(values, weights[::-1], "valid") / step
    return found


def departure(found: History, of: str = "") -> float:
    """How far rate of the velocity and acceleration of the base are from the absolute acceleration,
    relative to its rms, clear of impacts."""
    table = found.samples
    rate = slope(table[f"{of}velocity_m_s"].to_numpy(), found.step)
    clear = np.isfinite(rate)
    for time in found.impacts["time_s"]:
        clear &= np.abs(table["time_s"].to_numpy() - time) > 6.0 * found.step
    base = table.get("base_acceleration_m_s2", 0.0)
    acceleration = table[f"{of}acceleration_m_s2"].to_numpy()
    error = (rate + base - acceleration)[clear]
    assert len(error) > 100
    return float(np.sqrt(np.mean(error**2)) / acceleration.std())


@quick_cases("name", list(SCENES), keep=(0, 1, 2, 3, 5))
def test_its_impacts_are_those_of_the_same_path_of_a_simulation(name: str) -> None:
    scene = SCENES[name]
    duration = 0.4 * make_plan(model_of(scene)).duration
    logs = plan_impacts(scene, duration=duration).impacts(seed=3, first_path=7, paths=1)
    found = history(scene, duration=duration, seed=3, path=7)
    for each, log in logs.items():
        mine = found.impacts[found.impacts["pair"] == each]
        # the first sample of a history is the end of the first counted step
        later = log.time >= found.step
        count = min(len(mine), int(later.sum()))
        assert count > 0
        np.testing.assert_allclose(mine["time_s"][:count], log.time[later][:count] - found.step)
        np.testing.assert_allclose(mine["speed_m_s"][:count], np.abs(log.speed[later][:count]))
    assert found.samples.equals(history(scene, duration=duration, seed=3, path=7).samples)
    assert not found.samples.equals(history(scene, duration=duration, seed=3, path=8).samples)


def test_mean_squares_are_those_of_the_stationary_law() -> None:
    scene = SCENES["white"].model_copy(
        update={"impact_pairs": (between(1.0, Restitution(coefficient=1.0)),)}
    )
    paths = [history(scene, duration=400.0, seed=2, path=path).samples for path in range(16)]
    x = np.array([np.mean(path["displacement_m"] ** 2) for path in paths])
    found = Estimate(value=x.mean(), standard_error=x.std(ddof=1) / 4.0, bias=0.0)
    truth = exact(scene).coordinates["x"]["displacement_mean_square"].value
    assert_agrees(found, truth)
    free = exact(scene.model_copy(update={"impact_pairs": ()}))
    with pytest.raises(AssertionError, match="standard errors"):
        assert_agrees(found, free.coordinates["x"]["displacement_mean_square"].value)


@pytest.mark.parametrize("name", ["table", "table and sine", "sine"])
def test_velocity_base_and_absolute_acceleration_belong_together(name: str) -> None:
    found = history(SCENES[name], duration=1.0, seed=4, rate=2e4)
    assert departure(found) < 1e-6
    table = found.samples
    for lower, upper in (("velocity", "acceleration"), ("displacement", "velocity")):
        unit = {"displacement": "m", "velocity": "m_s", "acceleration": "m_s2"}
        rate = slope(table[f"base_{lower}_{unit[lower]}"].to_numpy(), found.step)[4:-4]
        base = table[f"base_{upper}_{unit[upper]}"].to_numpy()[4:-4]
        assert np.abs(rate - base).max() < 1e-6 * base.std()
    turned = table.assign(base_acceleration_m_s2=-table["base_acceleration_m_s2"])
    table["base_acceleration_m_s2"] = turned["base_acceleration_m_s2"]
    assert departure(found) > 1.0  # a base that moves the other way is noticed


def test_a_force_on_the_mass_is_in_its_acceleration() -> None:
    force = TabulatedNoise(on="x", frequency_hz=[0.01, 0.5], density=[3.0, 1.0], unit="N2/Hz")
    scene = Scene(structure=SWING, impact_pairs=[between(1.0)], excitations=[force])
    found = history(scene, duration=60.0, rate=100.0)
    assert departure(found) < 1e-6
    assert not [name for name in found.samples if name.startswith("base")]


@pytest.mark.slow
def test_two_masses_follow_their_springs_and_the_base() -> None:
    scene = Scene(structure=TWO, excitations=[SHAKEN, TONE])
    found = history(scene, duration=0.2, rate=2e4)
    # modes take the mean gain of each bin of frequencies, which the base is found from
    assert departure(found, "a.") < 1e-3 and departure(found, "b.") < 1e-3
    base = found.samples["base_acceleration_m_s2"]
    assert departure(history(scene, duration=0.2, rate=2e4, path=1), "a.") < 1e-3
    found.samples["base_acceleration_m_s2"] = 0.9 * base
    assert departure(found, "a.") > 1e-2


def test_a_rigid_stop_is_not_passed_and_turns_the_mass_by_its_impulse() -> None:
    found = history(boxed(SHAKEN, half=0.001), duration=1.5, seed=1, rate=2e4)
    assert found.samples["displacement_m"].abs().max() <= 0.001 * (1.0 + 1e-9)
    time, v = found.samples["time_s"].to_numpy(), found.samples["velocity_m_s"].to_numpy()
    x = found.samples["displacement_m"].to_numpy()
    assert len(found.impacts) > 3
    for hit in found.impacts.itertuples():
        side = 1.0 if hit.side == "upper" else -1.0
        assert hit.impulse_N_s == pytest.approx(2.3 * 1.8 * hit.speed_m_s)
        before = int(np.searchsorted(time, hit.time_s)) - 1
        if v[before] * v[before + 1] < 0.0:  # one impact in this step
            reached = x[before] + v[before] * (hit.time_s - time[before])
            assert reached == pytest.approx(side * 0.001, rel=1e-3)
            # what spring and base change within two steps is of the size of the acceleration
            assert side * (v[before] - v[before + 1]) == pytest.approx(
                1.8 * hit.speed_m_s, abs=300.0 * found.step
            )


def test_contact_forces_push_where_the_stop_is_deflected() -> None:
    found = history(boxed(SHAKEN, half=0.001, law=SOFT), duration=1.5, seed=1, rate=2e4)
    force = found.samples["contact_force_N"].to_numpy()
    x = found.samples["displacement_m"].to_numpy()
    beyond = np.abs(x) > 0.001
    assert beyond.sum() > 50 and not force[~beyond].any()
    assert (force * np.sign(x) >= 0.0).all()
    hits = found.impacts
    assert np.abs(force).sum() * found.step == pytest.approx(hits["impulse_N_s"].sum())
    assert np.abs(force).max() == hits["peak_force_N"].max()
    coarse = history(boxed(SHAKEN, half=0.001, law=SOFT), duration=1.5, seed=1)
    assert any("contact_force_N" in warning for warning in coarse.warnings)
    assert coarse.impacts["impulse_N_s"].isna().all()
    assert not any("contact_force_N" in warning for warning in found.warnings)


def test_contact_forces_bring_the_change_of_momentum() -> None:
    stiffness = 2e6
    scene = boxed(SHAKEN, half=0.001, law=Elastic(stiffness=stiffness))
    found = history(scene, duration=1.5, seed=1, rate=2e4)
    table, hits = found.samples, found.impacts
    rate = (table["acceleration_m_s2"] - table["base_acceleration_m_s2"]).to_numpy()
    brought = np.concatenate([[0.0], np.cumsum(0.5 * found.step * (rate[1:] + rate[:-1]))])
    v = table["velocity_m_s"].to_numpy()
    # the force has a kink at each end of a contact, where trapezia are off by h^2 / 8 of its slope
    off = 2.0 * found.step**2 / 8.0 * stiffness / 2.3 * hits["speed_m_s"].sum()
    assert np.abs(v - v[0] - brought).max() < off < 0.05 * hits["impulse_N_s"].max() / 2.3


def test_a_lower_rate_keeps_every_kth_sample() -> None:
    whole = history(SCENES["white"], duration=50.0)
    third = history(SCENES["white"], duration=50.0, rate=1.0 / (3.5 * whole.step))
    assert third.step == 3.0 * whole.step
    assert whole.samples[::3].reset_index(drop=True).equals(third.samples)
    assert third.impacts.equals(whole.impacts)


def test_what_of_the_base_is_not_followed_is_stated() -> None:
    wide = TabulatedNoise(
        on="base", frequency_hz=[10.0, 2000.0], density=[0.01, 0.01], unit="g2/Hz"
    )
    scene = Scene(structure=BOX, excitations=[wide])
    found = history(scene, duration=1.0)
    (note,) = [each for each in found.warnings if "lie above" in each]
    above = Table(frequency_hz=np.array([0.5 / found.step, 2000.0]), density=np.array([0.01, 0.01]))
    share = 100.0 * above.mean_square() / (0.01 * 1990.0)
    assert f"{share:.2g} %" in note
    assert not any("lie above" in each for each in history(scene, duration=0.2, rate=4400).warnings)


@pytest.mark.parametrize(
    ("name", "column"),
    [("white", "acceleration_m_s2"), ("filtered", "base_acceleration_m_s2")],
)
def test_what_is_left_out_has_a_reason(name: str, column: str) -> None:
    found = history(SCENES[name], duration=1.0)
    assert column not in found.samples
    assert found.meanings[column].startswith("left out: ")
    assert set(found.samples) - {"time_s"} <= set(found.meanings)


test_arguments_out_of_range_are_refused = refusals(
    lambda asked: history(SCENES["white"], **asked),
    ({"duration": 0.0}, "duration"),
    ({"duration": 1.0, "path": -1}, "path"),
    ({"duration": 1.0, "path": 0.5}, "path"),
    ({"duration": 1.0, "rate": 0.0}, "rate"),
    error=ValueError,
)


def test_a_path_that_fits_no_memory_is_refused_with_the_length_that_does() -> None:
    with pytest.raises(NotApplicable, match="ask for about"):
        history(SCENES["white"], duration=1e8)


def test_each_coordinate_and_pair_has_the_numbers_of_the_tables() -> None:
    one_sided = SCENES["white"].model_copy(
        update={"impact_pairs": (ImpactPair(upper=0.5, law=LOSSY),)}
    )
    found = history(one_sided, duration=200.0, seed=5)
    moved, hit = found.coordinates["x"], found.impact_pairs["stops"]
    x, speeds = found.samples["displacement_m"], found.impacts["speed_m_s"]
    assert (moved.displacement_min, moved.displacement_max) == (x.min(), x.max())
    assert moved.displacement_mean == pytest.approx(float(np.mean(x)), rel=1e-12)
    assert moved.displacement_std == pytest.approx(float(np.std(x)), rel=1e-9)
    assert moved.velocity_std == pytest.approx(
        float(np.std(found.samples["velocity_m_s"])), rel=1e-9
    )
    assert (hit.hits, hit.hits_upper, hit.hits_lower) == (len(speeds), len(speeds), None)
    assert hit.impact_speed_max == speeds.max() > 0.0
    # white noise on a mass leaves no acceleration, and the pair has no lower stop
    assert list(moved) == [name for name in vars(moved) if not name.startswith("acceleration")]
    assert list(hit) == ["hits", "hits_upper", "impact_speed_max"]
    shaken = history(boxed(SHAKEN), duration=0.5).coordinates["x"]
    assert shaken["acceleration_max"] == shaken.acceleration_max > 0.0
    felt = history(boxed(SHAKEN), duration=0.5).samples["acceleration_m_s2"]
    assert shaken.acceleration_max == np.abs(felt).max()
    assert shaken.acceleration_std == pytest.approx(float(np.std(felt)), rel=1e-9)


def test_slow_impacts_are_found_at_the_default_rate() -> None:
    """One stop at rest, R = .3: the plain step finds a tenth too few. Held against Fokker-Planck
    and the refined steps of `simulate`."""
    scene, length = oscillator(0.0, None, 0.3), 4000.0
    known = fokker_planck(scene).impact_pairs["stops"]
    refined, plain = (
        simulate(scene, paths=400, seed=2, speed_threshold=known.speed_threshold, slow_impacts=how)
        .impact_pairs["stops"]
        .collision_rate
        for how in (True, False)
    )
    rates = []
    for path in range(8):
        found = history(scene, duration=length, seed=1, path=path)
        rates.append(float((found.impacts["speed_m_s"] >= known.speed_threshold).sum()) / length)
        assert any("slow impacts are resolved" in each for each in found.warnings)
    mean, error = float(np.mean(rates)), float(np.std(rates, ddof=1)) / len(rates) ** 0.5
    assert abs(mean - refined.value) < 4.0 * np.hypot(error, refined.standard_error)
    truth = known.collision_rate
    assert abs(mean - truth.value) < 4.0 * error + (truth.bias or 0.0) + (refined.bias or 0.0)
    assert mean - plain.value > 4.0 * error  # negative control


def test_slow_impacts_that_are_not_resolved_are_announced() -> None:
    scene = oscillator(0.0, None, 0.1)
    (said,) = history(scene, duration=20.0).warnings
    assert "slow impacts" in said
    quiet = history(oscillator(0.0, None, 0.6), duration=20.0)
    assert not any("slow impacts" in each for each in quiet.warnings)  # negative control
