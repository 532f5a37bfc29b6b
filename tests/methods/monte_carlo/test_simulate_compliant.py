"""Stops that give way through `simulate` and `check`: every quantity, in the units of the scene."""

from __future__ import annotations

import pytest
from test_compliant import EXACT, RUBBER, scene

from stochvi import Estimate, check, simulate


@pytest.mark.parametrize("name", ["linear", "Hertz", "unequal, with a wall"])
def test_simulate_and_the_exact_law_agree_in_every_quantity(name: str) -> None:
    found = check(EXACT[name], rel_error=0.01)
    assert found.passed, found
    quantities = {row.quantity for row in found.comparisons}
    assert {"contact_probability", "contact_force_lower", "energy", "force"} <= quantities
    # a rigid stop has no peak force, and so has no pair of which it is one
    assert ("peak_force" in quantities) == (name != "unequal, with a wall")


def test_forces_are_those_on_the_mass_of_the_scene() -> None:
    light, heavy = (
        simulate(scene(-1.0, 1.0, RUBBER, mass=mass), paths=64, seed=3).impact_pairs["stops"]
        for mass in (1.0, 2.5)
    )
    for quantity in ("peak_force", "contact_force_upper"):
        one, other = light[quantity], heavy[quantity]
        assert isinstance(one, Estimate) and isinstance(other, Estimate)
        assert other.value == pytest.approx(2.5 * one.value, rel=1e-6)
