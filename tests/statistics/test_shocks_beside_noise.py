"""The probability of any impact with shocks beside noise: missions of an integrator of its own
judge."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stochvi import (
    Estimate,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    TabulatedNoise,
    reliability,
    size,
)
from stochvi.mathematics.random_shocks import Shocks
from stochvi.model.model import model_of
from stochvi.scenes import Pulses
from stochvi.scenes.phases import Phase
from stochvi.statistics.pair_crossings import PairMotion
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases

Array = NDArray[np.float64]

M, F, ZETA, MISSION = 2.0, 10.0, 0.06, 40.0
W = 2.0 * math.pi * F
DENSITY, BAND = 40.0, (4.0, 60.0)
FS = 40.0 * F
SIGMA = math.sqrt(DENSITY * math.pi * F / (4.0 * ZETA)) / (M * W**2)

NOISE = TabulatedNoise(frequency_hz=list(BAND), density=[DENSITY] * 2, unit="N2/Hz", on="x")


def formula(shape: str, time: Array) -> Array:
    inside = (time >= 0.0) & (time <= 1.0)
    return {
        "half-sine": np.where(inside, np.sin(math.pi * time), 0.0),
        "saw-tooth": np.where(inside, time, 0.0),
        "trapezoid": np.where(inside, np.clip(np.minimum(time, 1.0 - time) / 0.1, 0.0, 1.0), 0.0),
    }[shape]


def responded(shape: str, duration: float, length: float, step: float) -> Array:
    """Displacement of the mass after a shock of 1 N, by Duhamel's integral at a fine step."""
    fine = step / 50.0
    time = fine * np.arange(round(length / fine))
    wave = W * math.sqrt(1.0 - ZETA**2)
    kick = np.exp(-ZETA * W * time) * np.sin(wave * time) / (M * wave)
    size_ = 2 * len(time)
    force = formula(shape, time / duration)
    moved = np.fft.irfft(np.fft.rfft(force, size_) * np.fft.rfft(kick, size_))[: len(time)]
    return np.asarray(fine * moved[::50])


def extremes(pulses: Pulses, missions: int, seed: int, *, shaken: bool = True) -> Array:
    """(missions, 2): smallest and largest displacement of missions from the stationary motion."""
    random, step, before = np.random.default_rng(seed), 1.0 / FS, 3.0
    samples = round((MISSION + before) / step)
    length = 2 * samples
    bins = np.arange(length // 2 + 1) * FS / length
    w = 2.0 * math.pi * bins
    gain = 1.0 / (M * (W**2 - w**2 + 2j * ZETA * W * w))
    gain[(bins < BAND[0]) | (bins > BAND[1])] = 0.0
    grid = step / 4.0
    moved = responded(str(pulses.shape), float(pulses.duration or 0.0), 3.0, grid)
    found = np.empty((missions, 2))
    for mission in range(missions):
        normal = random.standard_normal((2, len(bins)))
        spectrum = gain * (normal[0] + 1j * normal[1]) * math.sqrt(DENSITY * FS * length) / 2.0
        x = np.fft.irfft(spectrum, length)[:samples] if shaken else np.zeros(samples)
        for _ in range(random.poisson(pulses.rate * (MISSION + before))):
            at = random.uniform(0.0, MISSION + before)
            size_ = {"equal": 1.0, "normal": abs(random.standard_normal()),
                     "exponential": random.exponential()}[pulses.sizes]  # fmt: skip
            if pulses.two_sided and random.random() < 0.5:
                size_ = -size_
            first = math.ceil(at / step)
            ages = step * np.arange(first, samples) - at
            near = ages < 2.9
            x[first:][near] += (
                (pulses.amplitude or 0.0)
                * size_
                * np.interp(ages[near], grid * np.arange(len(moved)), moved)
            )
        kept = x[round(before / step) :]
        # the peak between two samples, by a parabola
        found[mission] = -peak(-kept), peak(kept)
    return found


def peak(x: Array) -> float:
    k = int(np.clip(np.argmax(x), 1, len(x) - 2))
    bend, slope = x[k - 1] - 2.0 * x[k] + x[k + 1], 0.5 * (x[k + 1] - x[k - 1])
    return float(x[k] - 0.5 * slope**2 / bend) if bend < 0.0 else float(x[k])


def scene(lower: float, upper: float, *shocks: Any) -> Scene:
    """Stops at these distances, in standard deviations of the noise."""
    mass = Oscillator(mass=M, frequency_hz=F, zeta=ZETA)
    stops = ImpactPair(lower=-lower * SIGMA, upper=upper * SIGMA, law=Restitution(coefficient=0.6))
    return Scene(structure=mass, impact_pairs=[stops], excitations=[NOISE, *shocks])


def shock(share: float, **keys: Any) -> Pulses:
    """A shock that moves the mass by about so many standard deviations."""
    shape, duration = keys.get("shape", "half-sine"), keys.get("duration", 0.03)
    moved = float(np.abs(responded(shape, duration, 1.0, 0.25 / FS)).max())
    given = {"shape": "half-sine", "duration": 0.03, "rate": 0.05} | keys
    return Pulses(amplitude=share * SIGMA / moved, on="x", **given)


CASES = [
    # lower and upper stop, size of the shocks, all in sigma; keys of the shocks
    (4.5, 4.5, 3.0, {}),
    (4.5, 4.5, 6.0, {}),
    (5.5, 5.5, 3.0, {"rate": 0.3}),
    (4.5, 5.5, 3.0, {"two_sided": False}),
    (5.5, 4.2, 4.0, {"two_sided": False}),
    (5.0, 5.0, 2.0, {"sizes": "exponential"}),
    (5.0, 6.5, 2.5, {"sizes": "exponential", "two_sided": False}),
    (5.0, 5.0, 3.0, {"sizes": "normal"}),
    (6.0, 6.0, 3.5, {"sizes": "normal", "rate": 0.1}),
    (4.5, 4.5, 3.0, {"shape": "saw-tooth", "duration": 0.05}),
    (5.0, 5.0, 4.0, {"shape": "saw-tooth", "duration": 0.01}),
    (5.0, 5.0, 3.0, {"shape": "trapezoid", "duration": 0.04}),
    (5.0, 4.4, 3.0, {"shape": "trapezoid", "duration": 0.2, "two_sided": False}),
    (4.5, 4.5, 2.5, {"duration": 0.004}),
    (4.5, 4.5, 2.5, {"duration": 0.12}),
    (5.5, 5.5, 3.0, {"rate": 0.4}),
    (6.5, 6.5, 4.0, {"rate": 0.35, "two_sided": False}),
    (4.0, 4.0, 1.0, {}),
    (7.0, 7.0, 6.0, {"rate": 0.02}),
    (5.2, 5.2, 3.0, {"sizes": "exponential", "shape": "saw-tooth", "rate": 0.2}),
]
KEPT = (1, 4, 8, 15)


@quick_cases(("lower", "upper", "share", "keys"), CASES, keep=KEPT)
def test_any_impact_is_as_probable_as_in_counted_missions(
    lower: float, upper: float, share: float, keys: dict[str, Any]
) -> None:
    """Left out, or taken for noise of the same density, shocks give another answer."""
    pulses, missions = shock(share, **keys), 800
    found = reliability(scene(lower, upper, pulses), mission=MISSION, seed=1, rel_error=0.05)
    own = found.chances["hit"].estimate
    ends = extremes(pulses, missions, seed=4)
    counted = float(np.mean((ends[:, 0] < -lower * SIGMA) | (ends[:, 1] > upper * SIGMA)))
    error = math.sqrt(max(counted * (1.0 - counted), 1.0 / missions) / missions)
    assert own.bias is not None and own.bias < 0.05 * own.value + 1e-3
    assert abs(own.value - counted) < 4.0 * math.hypot(error, own.standard_error) + own.bias
    if own.value > 0.05 and share > 1.0:  # the control
        alone = reliability(scene(lower, upper), mission=MISSION, seed=1, rel_error=0.1)
        assert abs(alone.chances["hit"].estimate.value - counted) > 4.0 * error


def test_without_shocks_the_probability_is_that_of_noise() -> None:
    rare = reliability(scene(4.0, 4.0, shock(3.0, rate=1e-7)), mission=60.0, seed=1)
    alone = reliability(scene(4.0, 4.0), mission=60.0, seed=2)
    (value, known) = (each.chances["hit"].estimate for each in (rare, alone))
    error = math.hypot(value.standard_error, known.standard_error)
    assert abs(value.value - known.value) < 4.5 * error + 0.01 * known.value


def test_shocks_without_chance_are_a_poisson_process() -> None:
    """Where every shock brings an impact and noise none, P = 1 - exp(-rate T)."""
    sure = scene(9.0, 9.0, shock(30.0, rate=2e-3))
    found = reliability(sure, mission=300.0, seed=1, rel_error=0.02).chances["hit"].estimate
    margin = 4.5 * found.standard_error + (found.bias or 0.0)
    assert margin < 0.1
    assert abs(found.value + math.expm1(-2e-3 * 300.0)) < margin
    seldom = scene(9.0, 9.0, shock(12.0, rate="1e-4/h"))
    found = reliability(seldom, mission=3600.0, seed=1).chances["hit"].estimate
    assert abs(found.value - 1e-4) < 4.5 * found.standard_error + (found.bias or 0.0) < 2e-5


def test_the_motion_after_a_shock_is_duhamels_integral() -> None:
    pulses = shock(3.0, shape="saw-tooth", duration=0.05, two_sided=False)
    shocks = PairMotion.under_shocks(model_of(scene(5.0, 5.0, pulses))).shocks
    assert isinstance(shocks, Shocks)
    grid = 0.25 / FS
    exact = (pulses.amplitude or 0.0) * responded("saw-tooth", 0.05, 1.0, grid)
    ages = grid * np.arange(len(exact))
    found = shocks.response_at(ages)[0, 0]
    # the tooth falls within a 400th of its length
    assert np.abs(found - exact).max() < 5e-3 * np.abs(exact).max()
    states, weights = shocks.net
    assert weights.sum() == pytest.approx(1.0, abs=1e-3)
    spread = float(weights @ shocks.at(states)[0][0] ** 2)
    mean = float(weights @ shocks.at(states)[0][0])
    (square,), _ = shocks.mean_squares
    assert spread - mean**2 == pytest.approx(float(square), rel=0.02)


def test_a_size_keeps_its_probability() -> None:
    """At the clearance that `size` finds, `reliability` and counted missions agree with it."""
    pulses = shock(3.0, rate=0.05)
    free = scene(4.5, 4.5, pulses)
    found = size(free, probability=0.2, mission=MISSION, seed=1, rel_error=0.05)
    c = found.clearance.value / SIGMA
    back = reliability(scene(c, c, pulses), mission=MISSION, seed=3, rel_error=0.05)
    own = back.chances["hit"].estimate
    assert abs(own.value - 0.2) < 4.5 * own.standard_error + (own.bias or 0.0) + 0.02
    ends = extremes(pulses, 800, seed=6)
    counted = float(np.mean(np.abs(ends).max(axis=1) > c * SIGMA))
    assert abs(counted - 0.2) < 4.0 * math.sqrt(0.16 / 800) + 0.01
    # the control: the clearance of noise alone is hit far more often
    alone = size(scene(4.5, 4.5), probability=0.2, mission=MISSION, seed=1, rel_error=0.05)
    less = float(np.mean(np.abs(ends).max(axis=1) > alone.clearance.value))
    assert less - 0.2 > 4.0 * math.sqrt(0.16 / 800)


def test_shocks_in_a_phase_of_a_mission() -> None:
    pulses = shock(4.0, rate=0.05)
    phases = [
        Phase(name="road", duration=100.0, excitation=[NOISE]),
        Phase(name="handling", duration=MISSION, excitation=[NOISE, pulses]),
    ]
    whole = scene(5.0, 5.0).replace(excitations=(), phases=phases)
    found = reliability(whole, seed=1)
    parts = [each.chances["hit"].estimate.value for each in found.phases.values()]
    joint = found.chances["hit"].estimate.value
    assert joint == pytest.approx(1.0 - (1.0 - parts[0]) * (1.0 - parts[1]), rel=1e-9)
    assert parts[1] > 5.0 * parts[0]
    sized = size(whole, probability=0.01, seed=1, rel_error=0.1)
    assert sized.clearance.value > 5.0 * SIGMA


def test_two_masses_whose_gaps_shocks_close() -> None:
    """The pair between two masses, of which a shock strikes one: against histories."""
    from stochvi.methods.monte_carlo.history_plans import plan_histories

    structure = Matrices(
        coordinates=["a", "b"], mass=[[2.0, 0.0], [0.0, 1.0]],
        damping=[[16.0, -4.0], [-4.0, 6.0]], stiffness=[[9000.0, -1500.0], [-1500.0, 4000.0]],
    )  # fmt: skip
    noises = [
        TabulatedNoise(frequency_hz=[2.0, 50.0], density=[d, d], unit="N2/Hz", on=on)
        for on, d in (("a", 20.0), ("b", 6.0))
    ]
    pulses = Pulses(rate=0.08, shape="half-sine", duration=0.04, amplitude=150.0, on="a")
    pair = ImpactPair(between=("b", "a"), lower=-0.033, upper=0.03,
                      law=Restitution(coefficient=0.5))  # fmt: skip
    wall = ImpactPair(name="wall", on="b", upper=0.045, law=Restitution(coefficient=0.5))
    struck = Scene(structure=structure, impact_pairs=[pair, wall], excitations=[*noises, pulses])
    found = reliability(struck, mission=20.0, seed=1, rel_error=0.05)
    own = found.chances["hit"].estimate
    plan = plan_histories(struck.replace(impact_pairs=())).plan.sampled(2e-3, 20.0)
    samples = plan.history_samples(20.0)
    hits = []
    for first in range(0, 1024, 32):
        a, b = plan.histories(9, first, 32, samples).displacement
        gap = b - a
        hits += list(
            (gap.max(axis=1) > 0.03) | (gap.min(axis=1) < -0.033) | (b.max(axis=1) > 0.045)
        )
    counted = float(np.mean(hits))
    error = math.sqrt(counted * (1.0 - counted) / len(hits))
    assert 0.05 < counted < 0.95
    assert abs(own.value - counted) < 4.5 * math.hypot(error, own.standard_error) + (own.bias or 0)


@pytest.mark.slow
def test_shocks_that_meet_are_counted_in_missions() -> None:
    """Three shocks a second on a mount of 15 Hz: each comes while the last one still moves it.
    Against missions of this test: noise and half-sines in time, and the mount by its transform."""
    rate, size_, width, mission, level = 3.0, 60.0, 0.011, 10.0, 0.5
    struck = Scene(
        structure=Isolator(frequency_hz=15.0, zeta=0.3),
        impact_pairs=[ImpactPair(lower=-0.006, upper=0.007, law=Restitution(coefficient=0.6))],
        excitations=[
            TabulatedNoise(
                frequency_hz=[5.0, 60.0], density=[level, level], unit="(m/s2)2/Hz", on="base"
            ),
            Pulses(
                rate=rate, shape="half-sine", duration=width, amplitude=size_, sizes="normal",
                on="base",
            ),
        ],
    )  # fmt: skip
    found = reliability(struck, mission=mission, seed=1, rel_error=0.05, budget=None).chances["hit"]
    assert found.way == "missions" and found.lower < found.estimate.value < found.upper

    random, step, before = np.random.default_rng(4), 1e-3, 2.0
    count = int((mission + before) / step)
    f, t = np.fft.rfftfreq(count, step), np.arange(count) * step
    omega, natural = 2.0 * np.pi * f, 30.0 * np.pi
    moved = -1.0 / (natural**2 - omega**2 + 0.6j * natural * omega)
    hits = []
    for _ in range(400):
        waves = random.standard_normal(len(f)) + 1j * random.standard_normal(len(f))
        force = waves * np.sqrt(0.25 * level * count / step) * ((f >= 5.0) & (f <= 60.0))
        shocks = np.zeros(count)
        for begun in random.uniform(0.0, count * step, random.poisson(rate * count * step)):
            here = (t >= begun) & (t <= begun + width)
            shocks[here] += (
                size_ * random.standard_normal() * np.sin(np.pi * (t[here] - begun) / width)
            )
        z = np.fft.irfft(moved * (force + np.fft.rfft(shocks)), count)[int(before / step) :]
        hits.append(z.max() > 0.007 or z.min() < -0.006)
    share = float(np.mean(hits))
    error = math.sqrt(share * (1.0 - share) / len(hits))
    assert 0.1 < share < 0.9
    own = found.estimate
    both = Estimate(
        value=own.value, standard_error=math.hypot(own.standard_error, error), bias=own.bias
    )
    assert_agrees(both, share)
    with pytest.raises(AssertionError):  # the control: half of it
        assert_agrees(both, 0.5 * share)


def test_what_is_refused() -> None:
    with pytest.raises(NotApplicable, match=r"shocks must be apart.*reliability counts missions"):
        size(scene(5.0, 5.0, shock(1.0, rate=20.0)), probability=0.1, mission=10.0)
    with pytest.raises(NotApplicable, match="shocks must be of one kind"):
        reliability(scene(5.0, 5.0, shock(1.0), shock(2.0)), mission=10.0)
    wave = Sine(amplitude=1.0, frequency_hz=7.0, on="x")
    with pytest.raises(NotApplicable, match="sines must be left out beside shocks"):
        reliability(scene(5.0, 5.0, shock(1.0), wave), mission=10.0)
    with pytest.raises(NotApplicable, match="impact_speed must be left out under shocks"):
        reliability(scene(5.0, 5.0, shock(1.0)), mission=10.0, impact_speed=1.0)
    peaked = scene(5.0, 5.0).replace(excitations=[NOISE.replace(kurtosis=5.0), shock(1.0)])
    beside = "pulses must be left out beside noise with fast peaks"
    with pytest.raises(NotApplicable, match=beside):
        reliability(peaked, mission=10.0)
    with pytest.raises(NotApplicable, match=beside) as refused:
        size(peaked, probability=0.01, mission=10.0)
    assert "of one kind" not in str(refused.value)  # there is one kind of shocks
