"""Dampers that bring energy to slow motions, between stops: densities judge simulations."""

from __future__ import annotations

import math

import numpy as np

from stochvi import (
    Estimate,
    ImpactPair,
    Oscillator,
    Restitution,
    Scene,
    WhiteNoise,
    fokker_planck,
    simulate,
)
from stochvi.scenes import Rayleigh
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases

QUANTITIES = ("displacement_mean", "displacement_mean_square", "velocity_mean_square")
RATES = ("collision_rate", "impact_speed_rate", "impact_speed_square_rate")


def scene_of(number: int, share: float = 1.0) -> Scene:
    """A random scene of unit mass and frequency; `share` is that of the negative damping."""
    generator = np.random.default_rng(number)
    linear, cubic = generator.uniform(0.05, 0.4), generator.uniform(0.1, 1.0)
    speed = math.sqrt(4.0 * linear / (3.0 * cubic))  # of the motion without stops
    lower, upper = -speed * generator.uniform(0.2, 1.2), speed * generator.uniform(0.2, 1.2)
    return Scene(
        structure=Oscillator(
            mass=1.0, damping=0.0, stiffness=1.0,
            damper=Rayleigh(linear_damping=-share * linear, cubic_damping=cubic),
        ),
        impact_pairs=[
            ImpactPair(
                lower=lower, upper=upper,
                law=Restitution(coefficient=float(generator.uniform(0.5, 0.95))),
            )
        ],
        excitations=[WhiteNoise(intensity=float(speed**2 * generator.uniform(0.02, 0.2)))],
    )  # fmt: skip


def away(scene: Scene, judged: Scene, number: int) -> list[Estimate]:
    """Simulated less calculated quantities, with the errors of both."""
    known = fokker_planck(judged)
    found = simulate(scene, paths=256, duration=150.0, seed=number)
    names = [("coordinates", "x", name) for name in QUANTITIES]
    names += [("impact_pairs", "stops", name) for name in RATES]
    pairs = [
        [getattr(each, kind)[owner][name] for each in (found, known)] for kind, owner, name in names
    ]
    return [
        Estimate(
            value=one.value - other.value, standard_error=one.standard_error,
            bias=(one.bias or 0.0) + (other.bias or 0.0), bias_error=one.bias_error,
        )
        for one, other in pairs
    ]  # fmt: skip


@quick_cases("number", range(50), keep={3, 17})
def test_rayleigh_damping_between_stops_has_the_density_of_fokker_and_planck(number: int) -> None:
    scene = scene_of(number)
    for difference in away(scene, scene, number):
        assert_agrees(difference, 0.0)


def test_less_negative_damping_is_noticed() -> None:
    """The negative control: a tenth less than in the scene that judges."""
    judged = [
        abs(difference.value) <= difference.reach(4.5)
        for difference in away(scene_of(3, 0.9), scene_of(3), 3)
    ]
    assert not all(judged)
