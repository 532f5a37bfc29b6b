"""Noise of a steady kurtosis in scenes: what simulations make of it, and who refuses it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stochvi import (
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Restitution,
    Scene,
    SceneError,
    TabulatedNoise,
    damage,
    impacts,
    linearise,
    simulate,
    spectrum,
)
from stochvi.methods.monte_carlo.history_plans import plan_histories
from stochvi.scenes import CrossDensity

Array = NDArray[np.float64]

TRUCK = "mil-std-810h-truck-vertical-5hz"
STIFF, SOFT = Isolator(frequency_hz=400.0, zeta=0.7), Isolator(frequency_hz=8.0, zeta=0.05)
STOPS = ImpactPair(clearance=5e-3, law=Restitution(coefficient=0.7))
BAND = {"frequency_hz": [5.0, 100.0], "density": [0.01, 0.01], "unit": "g2/Hz"}


def shaken(structure: Any = STIFF, pairs: Any = (), **keys: Any) -> Scene:
    noise = TabulatedNoise(**BAND, **keys)
    return Scene(structure=structure, impact_pairs=list(pairs), excitations=[noise])


def flown(scene: Scene, paths: int, seconds: float) -> Array:
    """Displacements (paths, samples)."""
    plan = plan_histories(scene).plan.sampled(1e9, seconds)
    samples = plan.history_samples(seconds)
    parts = [plan.histories(3, first, 16, samples) for first in range(0, paths, 16)]
    return np.concatenate([part.displacement[0] for part in parts])


def shaking_of(scene: Scene, paths: int, seconds: float) -> Array:
    """Forces on the mass (paths, samples)."""
    plan = plan_histories(scene).plan.sampled(1e9, seconds)
    samples = plan.history_samples(seconds)
    return np.concatenate([plan.drive(3, path, samples, 0) for path in range(paths)])


def kurtosis_of(records: Array) -> tuple[float, float]:
    each = np.mean(records**4, axis=1) / np.mean(records**2) ** 2
    return float(each.mean()), float(each.std(ddof=1) / math.sqrt(len(each)))


@pytest.mark.slow
def test_a_stiff_mount_follows_the_noise_kurtosis_and_all() -> None:
    scene = shaken(kurtosis=5.0)
    (input_, error), (output, its_error) = (
        kurtosis_of(each(scene, 128, 10.0)) for each in (shaking_of, flown)
    )
    assert error < 0.12
    assert abs(input_ - 5.0) < 4.5 * error + 0.05
    assert abs(output - 5.0) < 4.5 * its_error + 0.25
    # the control: Gaussian noise of the same density
    plain, error = kurtosis_of(shaking_of(shaken(), 128, 10.0))
    assert abs(plain - 3.0) < 4.5 * error < abs(plain - 5.0) / 2.0


@pytest.mark.slow
def test_a_narrow_mount_averages_the_peaks_out() -> None:
    """To 3: a Gaussian answer is then right, whatever the kurtosis of the input."""
    narrow, error = kurtosis_of(flown(shaken(SOFT, kurtosis=5.0), 128, 60.0))
    assert error < 0.06
    assert abs(narrow - 3.0) < 4.5 * error
    wide, error = kurtosis_of(flown(shaken(STIFF, kurtosis=5.0), 64, 10.0))
    assert wide - 3.0 > 9.0 * error


def test_the_response_has_the_variance_of_the_density() -> None:
    scene = shaken(Isolator(frequency_hz=30.0, zeta=0.2, mass=2.0), kurtosis=6.0)
    exact = linearise(shaken(Isolator(frequency_hz=30.0, zeta=0.2, mass=2.0)))
    found = simulate(scene, seed=2, rel_error=0.01)
    for name in ("displacement_mean_square", "velocity_mean_square"):
        own, known = (each.coordinates["x"][name] for each in (found, exact))
        margin = 4.5 * own.standard_error + (own.bias or 0.0) + 0.003 * known.value
        assert abs(own.value - known.value) < margin


def test_a_path_at_half_the_sampling_rate_meets_the_same_peaks() -> None:
    plan = plan_histories(shaken(kurtosis=5.0)).plan
    fine, coarse = (
        np.fft.rfft(each.free_response(1, 0, 2, 0)[:, 0, 0]) / each.samples
        for each in (plan, plan.coarser())
    )
    assert len(fine) > 1.9 * len(coarse)
    kept = len(coarse) - 1
    assert np.allclose(fine[:kept], coarse[:kept], rtol=1e-9, atol=1e-12 * np.abs(fine).max())


def test_simulations_follow_the_peaks() -> None:
    """More impacts and a larger extreme than under Gaussian noise, by each command."""
    mount = Isolator(frequency_hz=60.0, zeta=0.4, mass=1.0)
    wide = ImpactPair(clearance=2.6e-4, law=Restitution(coefficient=0.7))
    rates, largest = [], []
    for keys in ({"kurtosis": 6.0}, {}):
        scene = shaken(mount, [wide], **keys)
        found = impacts(scene, seed=1, rel_error=0.1)
        rates.append(found.pairs["stops"].rates["both"].estimate)
        free = shaken(mount, **keys)
        of = damage(free, mission=600.0, equipment=[20.0, 60.0, 200.0], exponent=6.0, seed=1,
                    rel_error=0.2)  # fmt: skip
        largest.append(of.with_stops.extreme_response.value)
    assert rates[0].value - rates[1].value > 4.5 * math.hypot(
        rates[0].standard_error, rates[1].standard_error
    )
    assert np.all(largest[0] > 1.05 * largest[1])
    assert spectrum(shaken(mount, kurtosis=6.0), seed=1) is not None


def test_methods_for_gaussian_motion_refuse_it_in_a_sentence() -> None:
    with pytest.raises(NotApplicable, match="noise with fast peaks, of kurtosis 5; "):
        linearise(shaken(SOFT, [STOPS], kurtosis=5.0))


def test_what_a_scene_may_not_say() -> None:
    with pytest.raises(SceneError, match="above 3 and at most 20, got 25"):
        TabulatedNoise(profile=TRUCK, kurtosis=25.0)
    with pytest.raises(SceneError, match="needs kurtosis with level_time"):
        TabulatedNoise(profile=TRUCK, level_time=2.0)
    box = Matrices(
        coordinates=["a", "b"], mass=np.eye(2).tolist(), damping=np.eye(2).tolist(),
        stiffness=[[50.0, -20.0], [-20.0, 50.0]],
    )  # fmt: skip
    noises = [
        TabulatedNoise(name=f"n{on}", on=on, frequency_hz=[0.2, 5.0], density=[0.3, 0.1],
                       unit="N2/Hz", kurtosis=4.0)
        for on in "ab"
    ]  # fmt: skip
    with pytest.raises(SceneError, match="has a kurtosis without level_time"):
        Scene(structure=box, excitations=noises,
              cross_densities=[CrossDensity(between=("na", "nb"), coherence=0.5)])  # fmt: skip
    narrow = TabulatedNoise(frequency_hz=[50.0, 52.0], density=[1.0, 1.0], unit="(m/s2)2/Hz",
                            kurtosis=20.0)  # fmt: skip
    with pytest.raises(NotApplicable, match="kurtosis must be at most"):
        simulate(Scene(structure=STIFF, excitations=[narrow]), seed=1)
