"""Energy that impacts scatter among modes, in the closure of a structure."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from stochvi import Elastic, ImpactPair, Restitution, Scene, WhiteNoise, exact, linearise, simulate
from stochvi.methods.linearisation import scattering
from stochvi.scenes import Beam
from stochvi.scenes.structures import Modes


@pytest.mark.parametrize("ratio", [0.0, 0.3, 1.0, 1.7, 4.4])
def test_the_spectrum_of_a_half_sine_is_that_of_its_integral(ratio: float) -> None:
    """Of sin t from 0 to pi about its middle, over its area of 2."""
    integral, _ = quad(lambda t: math.sin(t) * math.cos(ratio * (t - math.pi / 2.0)), 0.0, math.pi)
    assert scattering.half_sine(np.array([ratio]))[0] == pytest.approx(integral / 2.0, abs=1e-12)


def three_modes(law: Elastic | Restitution, raised: float = 1.0) -> Scene:
    """Modes in noise that matches their damping; `raised` is the noise of the third over that."""
    omega = np.array([60.0, 150.0, 230.0])
    own = {f"own{k}": row.tolist() for k, row in enumerate(np.diag(np.sqrt(0.1 * omega)))}
    return Scene(
        structure=Modes(
            frequency_hz=(omega / (2.0 * math.pi)).tolist(), zeta=0.05, modal_mass=1.0,
            shapes=own | {"tip": [1.0, -1.0, 1.0], "seat": [0.0, 0.0, 1.0]},
        ),
        impact_pairs=[ImpactPair(on="tip", lower=-0.02, upper=0.01, law=law)],
        excitations=[
            WhiteNoise(on=name, intensity=raised if name == "own2" else 1.0) for name in own
        ],
    )  # fmt: skip


@pytest.mark.parametrize("law", [Elastic(stiffness=4e4), Restitution(coefficient=1.0)])
def test_noise_and_damper_of_impacts_leave_the_gibbs_law(law: Elastic | Restitution) -> None:
    known, found = exact(three_modes(law)), linearise(three_modes(law))
    for name, motion in found.coordinates.items():
        truth = known.coordinates[name].displacement_std.value
        assert motion.displacement_std.value == pytest.approx(truth, rel=1e-8)
    stops = found.impact_pairs["stops"]
    truth = known.impact_pairs["stops"].collision_rate.value
    assert stops.collision_rate.value == pytest.approx(truth, rel=1e-8)
    assert stops.collision_rate.bias == 0.0


@pytest.mark.parametrize("law", [Elastic(stiffness=4e4), Restitution(coefficient=0.6)])
def test_the_noise_of_impacts_brings_no_energy(law: Elastic | Restitution) -> None:
    """The balance of energy holds where modes differ in temperature, too."""
    found = linearise(three_modes(law, raised=30.0))
    assert abs(found.identities["energy"].value) < 1e-8


def slapping_reed() -> Scene:
    """A steel reed on a base that moves at random, whose tip slaps against a stop."""
    return Scene(
        structure=Beam(
            length=0.2, width=0.02, height=0.002, young=2e11, density=7850.0, zeta=0.01, modes=3,
            points={"tip": 1.0},
        ),
        impact_pairs=[ImpactPair(on="tip", upper=0.001, law=Elastic(stiffness=2e4))],
        excitations=[WhiteNoise(on="base", density=0.01, unit="g2/Hz")],
    )  # fmt: skip


def test_a_slapping_reed_is_answered_better(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its impacts feed the higher modes: without that the closure has nearly twice the impacts."""
    truth = simulate(slapping_reed(), paths=16, duration=4.0, seed=7)
    mixed = linearise(slapping_reed())
    monkeypatch.setattr(scattering, "SCATTERED", 1e-12)
    alone = linearise(slapping_reed())
    for owner, quantity in (("tip", "displacement_std"), ("stops", "collision_rate")):
        known = truth.estimates()[owner, quantity]
        off, before = (
            abs(answer.estimates()[owner, quantity].value - known.value)
            for answer in (mixed, alone)
        )
        assert off + 4.5 * known.standard_error + (known.bias or 0.0) < before
