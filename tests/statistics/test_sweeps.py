"""Sines that move through a resonance beside noise: an integrator with a true sweep judges."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from stochvi import ImpactPair, Oscillator, Restitution, Scene, TabulatedNoise, reliability, size
from stochvi.model.model import model_of
from stochvi.scenes.moving_bands import MovingBand
from stochvi.scenes.phases import Phase
from stochvi.statistics.reliability.phases import lag_of
from support.accuracies import quick_cases

F, ZETA, MASS = 10.0, 0.05, 1.0
W, RATE = 2.0 * math.pi * F, 2.0 * math.pi * F * ZETA
DENSITY, FS = 20.0, 400.0
SIGMA = math.sqrt(DENSITY * math.pi * F / (4.0 * ZETA)) / W**2
PEAK, LEVEL = 3.0 * SIGMA, 5.0 * SIGMA
FROM, TO = 6.5, 14.5

Array = NDArray[np.float64]


@pytest.mark.parametrize("zeta", [0.02, 0.05, 0.1])
@pytest.mark.parametrize("ratio", [0.05, 0.2, 0.5, 1.0])
def test_a_moving_sine_moves_a_mass_less_by_no_more_than_stated(zeta: float, ratio: float) -> None:
    rate, change = zeta * W, ratio * (zeta * W) ** 2
    ends = np.array([-1.0, 1.0]) * (12.0 * rate + 4.0 * math.sqrt(change)) / change

    def turn(t: float) -> complex:
        return complex(np.exp(1j * (W * t + 0.5 * change * t * t)))

    def motion(t: float, y: NDArray[np.complex128]) -> list[complex]:
        return [y[1], turn(t) - 2.0 * rate * y[1] - W**2 * y[0]]

    w = W + change * ends[0]
    start = turn(ends[0]) / (W**2 - w**2 + 2j * rate * w)
    found = solve_ivp(motion, ends, np.array([start, 1j * w * start]), rtol=1e-8, atol=1e-12)
    steady = 1.0 / (2.0 * rate * math.sqrt(W**2 - rate**2))
    less = 1.0 - float(np.abs(found.y[0]).max()) / steady
    mass = Oscillator(mass=1.0, frequency_hz=F, zeta=zeta)
    noise = TabulatedNoise(frequency_hz=[5.0, 20.0], density=[1.0, 1.0], unit="N2/Hz", on="x")
    stated = lag_of(model_of(Scene(structure=mass, excitations=[noise])), change / 2.0 / math.pi)
    assert 0.0 < less < stated < max(2.5 * less, 0.02)


def extremes(duration: float, missions: int) -> Array:
    """Largest distance in missions whose sine moves by equal differences, by a recursion of the
    exact motion between samples."""
    random, step = np.random.default_rng(5), 1.0 / FS
    before = 3.0
    count = round((before + duration) / step)
    length = 2 * count
    bins = np.arange(length // 2 + 1) * FS / length
    w = 2.0 * math.pi * bins
    gain = 1.0 / (W**2 - w**2 + 2j * RATE * w)
    gain[(bins < 4.0) | (bins > 60.0)] = 0.0
    time = step * np.arange(count) - before
    slope = 2.0 * math.pi * (TO - FROM) / duration
    turned = 2.0 * math.pi * FROM * time + 0.5 * slope * np.maximum(time, 0.0) ** 2
    # the complex motion under exp(i turned), from its steady state, at a tenth of the step
    fine = 10
    dense = np.interp(np.arange(count * fine) / fine, np.arange(count), time)
    phase = 2.0 * math.pi * FROM * dense + 0.5 * slope * np.maximum(dense, 0.0) ** 2
    force = np.exp(1j * phase)
    size_ = 2 * len(force)
    wave = math.sqrt(W**2 - RATE**2)
    ages = step / fine * np.arange(len(force))
    kick = np.exp(-RATE * ages) * np.sin(wave * ages) / wave
    moved = np.fft.ifft(np.fft.fft(force, size_) * np.fft.fft(kick, size_))[: len(force) : fine]
    moved *= step / fine * PEAK * 2.0 * RATE * wave
    assert len(turned) == len(moved)
    found = np.empty(missions)
    kept = round(before / step)
    for mission in range(missions):
        normal = random.standard_normal((2, len(bins)))
        spectrum = gain * (normal[0] + 1j * normal[1]) * math.sqrt(DENSITY * FS * length) / 2.0
        x = np.fft.irfft(spectrum, length)[:count]
        x = x + (moved * np.exp(1j * random.uniform(0.0, 2.0 * math.pi))).real
        found[mission] = np.abs(x[kept:]).max()
    return found


@quick_cases("ratio", [0.5, 0.05], keep=(1,))
def test_the_bias_holds_what_steps_that_stand_still_change(ratio: float) -> None:
    change = ratio * RATE**2 / (2.0 * math.pi)
    duration, missions = (TO - FROM) / change, 3000
    steady = 2.0 * RATE * math.sqrt(W**2 - RATE**2)
    band = MovingBand(from_hz=FROM, to_hz=TO, amplitude=PEAK * steady * MASS, on="x")
    noise = TabulatedNoise(frequency_hz=[4.0, 60.0], density=[DENSITY] * 2, unit="N2/Hz", on="x")
    level = LEVEL if ratio > 0.1 else LEVEL + 0.5 * SIGMA
    scene = Scene(
        structure=Oscillator(mass=MASS, frequency_hz=F, zeta=ZETA),
        impact_pairs=[ImpactPair(clearance=level, law=Restitution(coefficient=0.6))],
        excitations=[noise],
        phases=[Phase(name="sweep", duration=duration, moving=[band], sweep="linear", steps=24)],
    )
    found = reliability(scene, seed=1, rel_error=0.15, budget=300.0)
    own = found.chances["hit"].estimate
    counted = float(np.mean(extremes(duration, missions) > level))
    error = math.sqrt(counted * (1.0 - counted) / missions)
    assert own.bias is not None and 0.02 < counted < 0.9
    apart = own.value - counted
    assert abs(apart) < 4.0 * math.hypot(error, own.standard_error) + own.bias
    if ratio > 0.1:  # the control: steps that stand still alone are too careful, visibly
        assert apart > 4.0 * math.hypot(error, own.standard_error)
        sized = size(scene, probability=0.1, seed=1, rel_error=0.15, budget=300.0)
        wide = sized.clearance.upper - sized.clearance.lower
        assert wide > 0.02 * sized.clearance.value
    assert any("what moves through phase sweep" in each for each in found.assumptions)
