"""The linearised oscillator: its spectra, its frequencies, and scenes with several solutions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from stochvi.mathematics.spectra import response_moments
from stochvi.methods.linearisation import (
    LinearisedOscillator,
    linearise,
    linearise_all,
    linearised_oscillators,
)
from stochvi.model.model import model_of
from stochvi.results.estimates import Estimate
from stochvi.scenes.excitations import Excitation, FilteredNoise, TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Elastic, Law, Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Isolator, Oscillator


def area(found: LinearisedOscillator, name: str, edges: list[float]) -> float:
    """Integral of a density over all frequencies, by adaptive quadrature."""
    density = getattr(found, name)
    resonance = found.resonance_hz
    points = sorted({0.0, resonance, 0.5 * resonance, 2.0 * resonance, *edges})
    pieces = [
        quad(lambda f: float(density(f)), low, high, epsabs=0.0, epsrel=1e-10, limit=200)[0]
        for low, high in zip(points, [*points[1:], math.inf], strict=True)
    ]
    return float(sum(pieces))


def boxed(noise: tuple[Excitation, ...], law: Law, gap: float = 1.0) -> Scene:
    return Scene(
        structure=Oscillator(mass=2.0, damping=0.2, stiffness=2.0),
        impact_pairs=[ImpactPair(lower=-gap, upper=gap, law=law)],
        excitations=noise,
    )


@pytest.mark.parametrize("form", ["closure", "motion", "force"])
def test_areas_under_the_densities_are_the_mean_squares(form: str) -> None:
    noise = (
        WhiteNoise(intensity=0.3),
        TabulatedNoise(on="x", frequency_hz=[0.1, 0.3, 2.0], density=[0.2, 0.9, 0.1], unit="N2/Hz"),
        FilteredNoise(intensity=0.4, frequency_hz=0.2, zeta=0.3),
    )
    (found,) = linearised_oscillators(boxed(noise, Elastic(stiffness=30.0)), form)
    displacement = area(found, "displacement_density", [0.1, 0.3, 2.0])
    velocity = area(found, "velocity_density", [0.1, 0.3, 2.0])
    assert displacement == pytest.approx(found.displacement_std**2, rel=1e-8)
    assert velocity == pytest.approx(found.velocity_std**2, rel=1e-8)


def test_absolute_acceleration_of_an_isolator() -> None:
    """Base noise: a = -(omega^2 + k) x - (b + beta) x', and x and x' are uncorrelated."""
    noise = TabulatedNoise(on="base", profile="mil-std-810h-truck-vertical-5hz")
    scene = Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        impact_pairs=[ImpactPair(lower=-3e-3, upper=3e-3, law=Restitution(coefficient=0.7))],
        excitations=[noise],
    )
    (found,) = linearised_oscillators(scene)
    edges = noise.table.frequency_hz.tolist()
    expected = (found.total_stiffness * found.displacement_std) ** 2
    expected += (found.total_damping * found.velocity_std) ** 2
    assert area(found, "acceleration_density", edges) == pytest.approx(expected, rel=1e-8)
    # a force on the mass moves it absolutely as much as relatively
    (pushed,) = linearised_oscillators(
        boxed((WhiteNoise(intensity=0.3),), Restitution(coefficient=0.7))
    )
    f = np.array([0.05, 0.2, 3.0])
    ratio = pushed.acceleration_density(f) / pushed.velocity_density(f)
    assert ratio == pytest.approx((2.0 * np.pi * f) ** 2, rel=1e-12)


@pytest.mark.parametrize("form", ["closure", "motion", "force"])
def test_dominant_frequency_is_the_rate_of_upcrossings(form: str) -> None:
    scene = boxed((WhiteNoise(intensity=0.8),), Restitution(coefficient=0.7))
    (found,) = linearised_oscillators(scene, form)
    rate = linearise(scene, form).coordinates["x"]["upcrossing_rate"]
    assert isinstance(rate, Estimate)
    assert found.dominant_frequency_hz == pytest.approx(rate.value, rel=1e-12)
    # white noise: the density of x is largest where that of a light oscillator has its peak
    peak = found.resonance_hz * math.sqrt(1.0 - 2.0 * found.damping_ratio**2)
    assert found.spectral_peak_hz() == pytest.approx(peak, rel=1e-6)


def test_every_solution_is_its_own_linearisation() -> None:
    """A resonance below the band: at rest there, or held within it by the stops."""
    band = TabulatedNoise(on="x", frequency_hz=[0.5, 5.0], density=[0.4, 0.4], unit="N2/Hz")
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-0.2, upper=0.2, law=Restitution(coefficient=0.9))],
        excitations=[band],
    )
    responses, found = linearise_all(scene), linearised_oscillators(scene)
    assert len(responses) == len(found) == 3
    for one in found:
        moments = response_moments(
            model_of(scene).acceleration_tables, math.sqrt(one.total_stiffness), one.total_damping
        )
        assert moments.displacement == pytest.approx(one.displacement_std**2, rel=1e-8)
        assert moments.velocity == pytest.approx(one.velocity_std**2, rel=1e-8)
    for response in responses:
        assert any("this form has 3 solutions" in warning for warning in response.warnings)
    free = response_moments(model_of(scene).acceleration_tables, 1.0, 0.02)
    assert found[0].displacement_std == pytest.approx(math.sqrt(free.displacement), rel=1e-2)
    assert linearise(scene).to_dict()["coordinates"] == responses[0].to_dict()["coordinates"]


def test_white_noise_has_one_solution() -> None:
    for restitution in (0.0, 0.5, 1.0):
        scene = boxed((WhiteNoise(intensity=0.3),), Restitution(coefficient=restitution), 0.3)
        (response,) = linearise_all(scene)
        assert not any("solutions" in warning for warning in response.warnings)
