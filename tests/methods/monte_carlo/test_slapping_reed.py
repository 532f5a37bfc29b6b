"""A reed that slaps against a stop on a base that moves at random: modes against 200 elements."""

from __future__ import annotations

import importlib.util
import math
from typing import Any

import pytest

from stochvi import (
    Elastic,
    Estimate,
    ImpactPair,
    Scene,
    WhiteNoise,
    simulate,
)
from stochvi.scenes import Beam, Modes
from stochvi.testing import assert_agrees
from support import CHECKOUT

LENGTH, WIDTH, HEIGHT, YOUNG, DENSITY = 0.2, 0.02, 0.002, 2e11, 7850.0
CLEARANCE, STIFFNESS, LEVEL, ZETA = 5e-4, 2e4, 0.01, 0.02


def by_elements(duration: float, step: float) -> dict[str, Estimate]:
    """Impact rate, F1, mean peak force and rms of 64 paths of 200 elements, by Newmark's rule."""
    place = CHECKOUT / "studies" / "24_slapping_beam" / "elements.py"
    spec = importlib.util.spec_from_file_location("elements", place)
    assert spec is not None and spec.loader is not None
    elements: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(elements)
    beam = (LENGTH, YOUNG * WIDTH * HEIGHT**3 / 12.0, DENSITY * WIDTH * HEIGHT)
    decay = 2.0 * ZETA * reed(1).table.omega[0]
    stop = (CLEARANCE, STIFFNESS, LEVEL * 9.80665**2 / 2.0)
    found = elements.slapping(beam, decay, stop, duration, step, count=200)
    return {
        name: Estimate(value=float(value), standard_error=float(error))
        for name, (value, error) in found.items()
    }


def reed(modes: int) -> Beam:
    return Beam(
        length=LENGTH, width=WIDTH, height=HEIGHT, young=YOUNG, density=DENSITY, zeta=ZETA,
        modes=modes,
    )  # fmt: skip


def by_modes(modes: int, rel_error: float) -> dict[str, Estimate]:
    """The same by modes that all decay at one rate, as elements with C proportional to M do."""
    beam, table = reed(modes), reed(modes).table
    structure = Modes(
        frequency_hz=table.omega / math.tau, zeta=ZETA * table.omega[0] / table.omega,
        modal_mass=table.mass, shapes=table.shapes, participation=table.participation,
        residual_compliance={"tip": beam.compliance({"tip": 1.0})},
    )  # fmt: skip
    scene = Scene(
        structure=structure, excitations=[WhiteNoise(on="base", density=LEVEL, unit="g2/Hz")],
        impact_pairs=[ImpactPair(on="tip", upper=CLEARANCE, law=Elastic(stiffness=STIFFNESS))],
    )  # fmt: skip
    found = simulate(scene, rel_error=rel_error, seed=1)
    pair, square = found.impact_pairs["stops"], found.coordinates["tip"].displacement_mean_square
    rms = math.sqrt(square.value)
    return {
        "rate": pair.collision_rate, "F1": pair.impact_speed_rate, "peak force": pair.peak_force,
        "rms of the tip": square * (0.5 / rms) + 0.5 * rms,
    }  # fmt: skip


@pytest.mark.verify
def test_modes_of_a_slapping_reed_converge_to_200_elements() -> None:
    truth = by_elements(duration=1.0, step=2e-5)
    found = {modes: by_modes(modes, 0.02) for modes in (1, 3, 6)}

    def difference(modes: int, name: str) -> Estimate:
        one, other = found[modes][name], truth[name]
        error = math.hypot(one.standard_error, other.standard_error)
        return Estimate(value=one.value - other.value, standard_error=error, bias=one.bias)

    for name in truth:
        assert_agrees(difference(6, name), 0.0)
    for name in ("rate", "F1", "rms of the tip"):  # one mode is not enough
        with pytest.raises(AssertionError):
            assert_agrees(difference(1, name), 0.0)
    errors = {n: abs(difference(n, "F1").value) for n in found}
    assert errors[1] > errors[3] > errors[6]
