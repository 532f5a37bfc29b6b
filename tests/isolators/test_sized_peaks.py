"""Clearances under noise with fast peaks, against records that are made and filtered here, against
`reliability`, and against Gaussian noise."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy import signal

from stochvi import (
    ImpactPair,
    Isolator,
    NotApplicable,
    Restitution,
    Scene,
    Sine,
    TabulatedNoise,
    reliability,
    screen,
    size,
)
from stochvi.isolators import MissionSizing
from stochvi.mathematics.fast_peaks import FastPeaks
from stochvi.results.estimates import Estimate
from stochvi.scenes.phases import Phase
from stochvi.testing import assert_agrees

BAND = TabulatedNoise(frequency_hz=[5.0, 100.0], density=[0.01, 0.01], unit="g2/Hz")
PEAKED, NEARLY_GAUSSIAN = BAND.replace(kurtosis=8.0), BAND.replace(kurtosis=3.001)
STIFF = Isolator(frequency_hz=60.0, zeta=0.4)
LAW = Restitution(coefficient=0.7)


def mount(noise: TabulatedNoise = PEAKED, **keys: Any) -> Scene:
    pairs = [ImpactPair(clearance=1e-3, law=LAW)]
    return Scene(**{"structure": STIFF, "impact_pairs": pairs, "excitations": [noise]} | keys)


def sized(scene: Scene, probability: float = 0.2, **keys: Any) -> MissionSizing:
    found = size(scene, probability=probability, **{"seed": 1, "budget": None} | keys)
    assert isinstance(found, MissionSizing)
    return found


def error_of_risk(found: MissionSizing) -> float:
    """The standard error of the risk at the clearance of a sizing."""
    at = found.curve.iloc[len(found.curve) // 2]
    assert at["clearance"] == pytest.approx(found.clearance.value)
    return float(at["probability_high"] - at["probability"]) / 1.96


def chance_at(scene: Scene, mission: float | None, rel_error: float = 0.05) -> Estimate:
    keys: dict[str, Any] = {"rel_error": rel_error, "seed": 7, "budget": None}
    return reliability(scene, mission=mission, **keys).chances["hit"].estimate


def counted(kurtosis: float, clearance: float, mission: float, missions: int) -> Estimate:
    """Share of the missions in which records of the noise, through the equation of motion in steps,
    go beyond a stop."""
    burn_in, length = 0.1, mission + 1.0
    records = FastPeaks(BAND.table, kurtosis).over(length)
    samples = 16 * records.samples
    step = length / samples
    omega = 2.0 * math.pi * STIFF.frequency_hz
    # q'' + 2 zeta omega q' + omega^2 q = -a, with a straight between samples
    system = ([-1.0], [1.0, 2.0 * STIFF.zeta * omega, omega**2])
    top, bottom, _ = signal.cont2discrete(system, step, method="foh")
    hits, random = 0, np.random.default_rng(3)
    for _ in range(missions // 50):
        drive = 16 * np.fft.irfft(records.bins(random, 50), samples, axis=0)
        motion = signal.lfilter(np.ravel(top), bottom, drive, axis=0)
        first = round(burn_in / step)
        kept = motion[first : first + round(mission / step)]
        hits += int(np.sum(np.abs(kept).max(axis=0) > clearance))
    share = hits / missions
    return Estimate(value=share, standard_error=math.sqrt(share * (1.0 - share) / missions))


@pytest.mark.slow
def test_records_that_are_simulated_reach_the_stops_as_often_as_was_asked_for() -> None:
    found = sized(mount(), mission=10.0)
    judge = counted(8.0, found.clearance.value, 10.0, 2000)
    spread = math.hypot(judge.standard_error or 0.0, error_of_risk(found))
    assert spread < 0.02
    assert_agrees(Estimate(value=judge.value, standard_error=spread, bias=0.0), 0.2)
    again = chance_at(found.sized().replace(phases=()), 10.0)
    spread = math.hypot(again.standard_error or 0.0, error_of_risk(found))
    assert_agrees(Estimate(value=again.value, standard_error=spread, bias=again.bias), 0.2)
    # the control: a tenth less clearance is told apart, and Gaussian noise needs far less
    nearer = counted(8.0, 0.9 * found.clearance.value, 10.0, 2000)
    assert nearer.value > 0.2 + 4.5 * math.hypot(nearer.standard_error or 0.0, spread)
    gaussian = size(mount(BAND), probability=0.2, mission=10.0, seed=1)
    assert gaussian.clearance.value < 0.7 * found.clearance.value


@pytest.mark.slow
def test_a_kurtosis_of_three_is_sized_as_gaussian_noise() -> None:
    found = sized(mount(NEARLY_GAUSSIAN), 0.05, mission=600.0, rel_error=0.1)
    gaussian = size(mount(BAND), probability=0.05, mission=600.0, rel_error=0.02, seed=1)
    reach = math.hypot(*(each.clearance.upper - each.clearance.value for each in (found, gaussian)))
    assert abs(found.clearance.value - gaussian.clearance.value) < 4.5 / 1.96 * reach
    assert reach < 0.02 * gaussian.clearance.value
    # the whole curve, where both know it
    assert gaussian.curve is not None
    curve = found.curve[(found.curve["probability"] > 2e-3) & (found.curve["probability"] < 0.9)]
    judge = np.interp(
        curve["clearance"], gaussian.curve["clearance"], gaussian.curve["probability"]
    )
    left = np.abs(np.log(np.log1p(-curve["probability"]) / np.log1p(-judge)))
    wide = np.log(np.log1p(-curve["probability_high"]) / np.log1p(-curve["probability"]))
    assert len(curve) > 5 and np.all(left < 4.5 / 1.96 * wide + 0.05)


@pytest.mark.slow
def test_phases_and_several_pairs_keep_the_probability() -> None:
    """A peaked phase beside a Gaussian one that hangs lower; one stop alone beside two."""
    soft = STIFF.replace(gravity=True)
    pairs = [
        ImpactPair(name="both", clearance=1e-3, law=LAW),
        ImpactPair(name="above", upper=1e-3, law=LAW),
    ]
    phases = [
        Phase(name="peaked", duration=10.0, stiffness_factor=0.95),
        Phase(name="calm", duration=300.0, excitations=[BAND.replace(level_db=6.0)]),
    ]
    for chosen in (pairs[:1], pairs):
        scene = mount(structure=soft, impact_pairs=chosen, phases=phases)
        found = sized(scene, rel_error=0.1)
        again = chance_at(found.sized(), None, 0.1)
        spread = math.hypot(again.standard_error or 0.0, error_of_risk(found))
        assert spread < 0.03
        assert_agrees(Estimate(value=again.value, standard_error=spread, bias=again.bias), 0.2)
        assert found.phases["probability"].min() > 0.01


def test_the_rms_motion_is_that_of_gaussian_noise() -> None:
    peaked, gaussian = screen(mount()), screen(mount(BAND))
    assert peaked.displacement_std == gaussian.displacement_std
    assert any("fast peaks" in note for note in peaked.notes)
    assert not any("fast peaks" in note for note in gaussian.notes)


def test_what_is_not_followed_beside_fast_peaks_is_refused() -> None:
    sine = Sine(amplitude=1.0, frequency_hz=20.0)
    with pytest.raises(NotApplicable, match="sines must be left out beside noise with fast peaks"):
        sized(mount(excitations=[PEAKED, sine]), mission=10.0)
    with pytest.raises(NotApplicable, match="the target must be a probability"):
        size(mount(), rate=1e-3)
    with pytest.raises(ValueError, match="pair must be left out"):
        sized(mount(), mission=10.0, pair="upper")
