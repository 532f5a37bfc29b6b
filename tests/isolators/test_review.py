"""What the review of a sizing calculates, against other ways to the same numbers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from stochvi import Isolator, RoadNoise, WhiteNoise, screen
from stochvi.isolators.contact import contact_on_mount
from stochvi.isolators.environment import frequencies, input_density, transmissibility
from stochvi.isolators.sizing.answer import Sizing
from stochvi.isolators.sizing.chance_at_stops import probability_at, probability_of_stops
from stochvi.isolators.sizing.sensitivity import variations
from stochvi.model.model import Model, model_of
from stochvi.scenes.impact_laws import ForceTable, Law, Viscoelastic
from support.sized import MOUNT, TRUCK, scene_between_stops, sizing_of


@pytest.fixture(scope="module")
def sizing() -> Sizing:
    return sizing_of(scene_between_stops())


# Sensitivity ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "noise", [TRUCK, RoadNoise(road="C", speed=20.0), WhiteNoise(intensity=1.0)]
)
def test_a_changed_level_and_the_tolerances_reach_every_variation(noise) -> None:
    sizing = sizing_of(scene_between_stops(law=None, noise=noise))
    tried = dict(variations(sizing))
    louder = screen(tried["level +3 dB"]).displacement_std
    assert louder == pytest.approx(10.0**0.15 * sizing.sigma, rel=1e-12)
    strict = replace(sizing, scene=scene_between_stops(structure=MOUNT.model_copy(
        update={"frequency_tolerance": 0.05, "damping_tolerance": 0.2}
    )))  # fmt: skip
    assert {"natural frequency -5 %", "damping ratio +20 %"} <= set(dict(variations(strict)))


# Spectra ----------------------------------------------------------------------------------


def test_the_transmissibility_gives_the_rms_of_the_screening() -> None:
    """The area under its square times the input, on the grid of the pictures."""
    scene = scene_between_stops(law=None)
    model = model_of(scene)
    f = frequencies(model)
    density = transmissibility(model, f) ** 2 * input_density(model, f)
    rms = math.sqrt(np.trapezoid(density, f))
    assert rms == pytest.approx(screen(scene).acceleration_std, rel=1e-3)
    assert transmissibility(model, np.array([12.0]))[0] == pytest.approx(
        math.sqrt(1.0 + 1.0 / 25.0) * 5.0
    )


# One contact ------------------------------------------------------------------------------


def without_damping(law: Law) -> Model:
    mount = Isolator(mass=2.0, frequency_hz=12.0, zeta=0.0)
    return model_of(scene_between_stops(law, structure=mount))


def test_a_contact_on_the_mount_conserves_energy() -> None:
    """v^2 / 2 = U(y) + omega^2 (d y + y^2 / 2) at the deepest point, per unit mass."""
    law = ForceTable(deflection=[1e-3, 3e-3], force=[50.0, 600.0])
    model = without_damping(law)
    assert model.upper is not None
    for speed, distance in ((0.05, 4e-3), (0.4, 1e-3)):
        hit = contact_on_mount(model, model.upper.law, distance, speed)
        y = hit.deflection
        stored = float(model.upper.law.potential_at(y)) + model.omega**2 * (distance + y / 2) * y
        assert stored == pytest.approx(0.5 * speed**2, rel=1e-3)
        force = float(model.upper.law.force_at(y)) + model.omega**2 * (distance + y)
        assert hit.peak_acceleration == pytest.approx(force, rel=1e-3)


def test_a_stiff_stop_does_not_feel_the_mount() -> None:
    """Then the contact is that of a free mass, whose closed form is known (B App. I)."""
    law = Viscoelastic(stiffness=2e8, damping_ratio=0.2)
    model = without_damping(law)
    free = law.impact(0.3, 2.0)
    assert model.upper is not None
    hit = contact_on_mount(model, model.upper.law, 1e-6, 0.3)
    assert hit.peak_acceleration == pytest.approx(free.peak_force / 2.0, rel=2e-3)
    assert hit.deflection == pytest.approx(free.peak_deflection, rel=2e-3)
    assert hit.contact_time == pytest.approx(free.contact_time, rel=1e-2)


# Risk of the stops that the scene has -----------------------------------------------------


def bursts(sizing: Sizing, clearance: float) -> float:
    """Of the sizing made by hand: 0.55 of Rice's crossings of the mission."""
    return 0.55 * screen(sizing.scene).rice_rate(clearance) * sizing.mission


def test_the_chance_at_a_clearance_is_read_off_the_curve(sizing: Sizing) -> None:
    for multiple in (4.03, 5.11, 6.37, 12.0):
        wanted = -math.expm1(-bursts(sizing, multiple * sizing.sigma))
        assert probability_at(sizing, multiple * sizing.sigma) == pytest.approx(wanted, rel=1e-9)
    assert probability_at(sizing, sizing.clearance.value) == sizing.target.value
    assert probability_at(sizing, 0.1 * sizing.sigma) is None
    assert 0.0 < (probability_at(sizing, 1e3 * sizing.sigma) or 0.0) < 1e-200


def test_each_side_of_the_scene_brings_half_the_bursts_of_its_distance(sizing: Sizing) -> None:
    sag = sizing.scene.structure.sag
    for lower, sides in ((-11e-3, 2), (-1.0, 1)):
        pair = sizing.scene.impact_pairs[0].model_copy(update={"lower": lower, "upper": 8e-3})
        scene = sizing.scene.model_copy(update={"impact_pairs": (pair,)})
        expected = [bursts(sizing, 8e-3 + sag), bursts(sizing, 11e-3 - sag)][:sides]
        assert probability_of_stops(replace(sizing, scene=scene)) == pytest.approx(
            -math.expm1(-0.5 * sum(expected)), rel=1e-9
        )


def test_the_only_stop_of_a_scene_brings_all_the_bursts_of_its_distance(sizing: Sizing) -> None:
    """The curve of a sizing with one stop counts the hits on it alone."""
    pair = sizing.scene.impact_pairs[0].model_copy(update={"lower": None, "upper": 8e-3})
    scene = sizing.scene.model_copy(update={"impact_pairs": (pair,)})
    expected = bursts(sizing, 8e-3 + sizing.scene.structure.sag)
    assert probability_of_stops(replace(sizing, scene=scene)) == pytest.approx(
        -math.expm1(-expected), rel=1e-9
    )
