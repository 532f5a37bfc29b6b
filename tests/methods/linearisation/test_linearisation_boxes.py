"""A loose mass in a box, linearised at every amplitude: its table, its balances, its bounds."""

from __future__ import annotations

import csv
import math
from dataclasses import replace

import numpy as np
import pytest

from stochvi import (
    Absorber,
    Estimate,
    Oscillator,
    Restitution,
    Scene,
    WhiteNoise,
    linearise,
    simulate,
)
from stochvi.methods.linearisation import loose_mass
from stochvi.model.model import model_of
from stochvi.scenes.datasets import data_folder
from stochvi.verification.testing.agreement import Z

CELL = {"mass": 0.03, "play": 2.5, "restitution": 0.45, "zeta": 0.015}


def scene(mass: float, play: float, restitution: float, zeta: float, size: float = 1.0) -> Scene:
    """A structure of unit rms; `size` makes it so many times heavier and slower."""
    return Scene(
        structure=Oscillator(mass=size, damping=2.0 * zeta, stiffness=1.0 / size),
        absorber=Absorber(mass=mass * size, play=play, law=Restitution(coefficient=restitution)),
        excitations=[WhiteNoise(intensity=4.0 * zeta / size)],
    )


def agree(simulated: Estimate, linear: Estimate) -> bool:
    assert simulated.bias is not None and linear.bias is not None
    allowed = Z * simulated.standard_error + simulated.bias + linear.bias
    return abs(simulated.value - linear.value) <= allowed


@pytest.mark.parametrize(("restitution", "play"), [(0.8, 5.0), (0.8, 8.0), (0.6, 6.0)])
def test_the_table_holds_the_exact_regime_of_two_impacts_a_period(
    restitution: float, play: float
) -> None:
    """Flights of speed u meet walls of speed -u (1 - R) / (1 + R), pi u / 2 apart from the middle:
    (pi u / 2 - play / 2)^2 + (u (1 - R) / (1 + R))^2 = 1, the larger root."""
    slow = (1.0 - restitution) / (1.0 + restitution)
    roots = np.roots([math.pi**2 / 4.0 + slow**2, -math.pi * play / 2.0, play**2 / 4.0 - 1.0])
    speed = float(np.max(roots.real))
    impact = 2.0 * speed / (1.0 + restitution)
    found = loose_mass.shaken_box(restitution, np.array([play]))
    exact = {
        "speed_rate": impact / math.pi,
        "speed_square_rate": impact**2 / math.pi,
        "velocity_square": speed**2,
        "displacement_square": (math.pi * speed / 2.0) ** 2 / 3.0,
    }
    # straight lines between logarithms at neighbouring plays, of a curve: their own spacing squared
    spacing = math.log(60.0 / 0.08) / 35.0
    for name, value in exact.items():
        assert found[name][0] == pytest.approx(value, rel=spacing**2), name


def test_a_mass_in_a_tight_box_that_takes_all_is_carried() -> None:
    """Its walls give it the momentum of cos t twice a period: (1 + R) F1 = 4 / (2 pi)."""
    rate = loose_mass.shaken_box(0.0, np.array([0.08]))["speed_rate"][0]
    # the table has five digits
    assert rate == pytest.approx(2.0 / math.pi, rel=1e-4)


def test_energy_balances_and_the_answer_has_no_unit() -> None:
    small, large = (linearise(scene(**CELL, size=size)) for size in (1.0, 1000.0))
    # the integral over amplitudes: trapezia of a fixed number
    spacing = math.log(loose_mass.LARGEST / loose_mass.SMALLEST) / loose_mass.AMPLITUDES
    assert abs(small.identities["energy"].value) < spacing**2
    for owner in ("structure", "absorber"):
        a, b = (each.coordinates[owner]["displacement_std"] for each in (small, large))
        assert b.value == pytest.approx(a.value, rel=1e-9)


def test_a_simulation_lies_within_the_stated_bounds() -> None:
    """Of a scene that is not in the atlas; not so within a tenth of them."""
    linear, simulated = linearise(scene(**CELL)), simulate(scene(**CELL), paths=64, duration=8e3)
    assert loose_mass.NOT_IN_ATLAS not in linear.warnings
    tight = 0
    for owner, name in (
        ("structure", "displacement_std"), ("structure", "velocity_mean_square"),
        ("absorber", "velocity_std"), ("box", "relative_velocity_std"),
        ("box", "impact_speed_rate"), ("box", "impact_speed_square_rate"),
    ):  # fmt: skip
        one, other = (
            (each.coordinates | each.impact_pairs)[owner][name] for each in (simulated, linear)
        )
        assert agree(one, other), (owner, name)
        exact = replace(one, standard_error=0.0, bias=0.0)
        tight += not agree(exact, replace(other, bias=0.1 * other.bias))
    assert tight > 0


def test_most_scenes_held_out_lie_within_the_bounds_of_their_neighbours() -> None:
    with (data_folder() / "absorber_box" / loose_mass.ATLAS).open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["part"] == "held out"]
    assert len(rows) > 20
    inside = 0
    for row in rows:
        place = {name: float(row[name]) for name in ("restitution", "zeta")}
        cell = scene(float(row["mass_ratio"]), float(row["play_in_sigma"]), **place)
        box = loose_mass.box_of(model_of(cell))
        bounds = loose_mass.errors(box, loose_mass.moments(box)["velocity"])
        inside += float(row["displacement_off"]) <= bounds["displacement"]
    # the largest of n draws covers the next one with probability n / (n + 1)
    expected = loose_mass.NEIGHBOURS / (loose_mass.NEIGHBOURS + 1.0)
    spread = math.sqrt(expected * (1.0 - expected) / len(rows))
    assert inside / len(rows) >= expected - 2.0 * spread


@pytest.mark.parametrize(
    "changed", [{"mass": 0.3}, {"play": 0.4}, {"restitution": 0.99}, {"zeta": 0.1}]
)
def test_outside_the_atlas_the_error_is_not_known(changed: dict[str, float]) -> None:
    found = linearise(scene(**CELL | changed))
    assert found.coordinates["structure"]["displacement_std"].bias is None
    assert any("its atlas holds one mode" in warning for warning in found.warnings)


def test_a_box_that_loses_nothing_is_still_exact() -> None:
    found = linearise(scene(**CELL | {"restitution": 1.0}))
    deviation = found.coordinates["structure"]["displacement_std"]
    assert deviation.bias == 0.0 and deviation.value == pytest.approx(1.0, rel=1e-9)
    assert not any("atlas" in warning for warning in found.warnings)
