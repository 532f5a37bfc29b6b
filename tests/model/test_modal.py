"""Modal coordinates and the linear law, against the same structure in its own coordinates."""

import math

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from stochvi import ConstantLoad, FilteredNoise, ImpactPair, Restitution, Scene, Sine, WhiteNoise
from stochvi.model.modal import EquivalentLinear, linear_law
from stochvi.model.model import model_of
from stochvi.scenes.structures import Matrices

MASS = np.array([[2.0, 0.3], [0.3, 0.7]])
DAMPING = np.array([[0.5, -0.2], [-0.2, 0.4]])
STIFFNESS = np.array([[9.0, -3.0], [-3.0, 4.0]])
GAP = np.array([-1.0, 1.0])


def two_masses(*excitations) -> Scene:
    return Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=MASS, damping=DAMPING, stiffness=STIFFNESS
        ),
        impact_pairs=[
            ImpactPair(between=["b", "a"], upper=0.5, law=Restitution(coefficient=0.5))
        ],
        excitations=list(excitations),
    )  # fmt: skip


def gain(omega: float, stiffness=STIFFNESS, damping=DAMPING) -> np.ndarray:
    return np.linalg.inv(stiffness - omega**2 * MASS + 1j * omega * damping)


def test_modes_give_back_the_matrices() -> None:
    modes = model_of(two_masses(WhiteNoise(on="a", intensity=0.3))).modal
    inverse = np.linalg.inv(modes.shapes)
    assert inverse.T @ inverse == pytest.approx(MASS)
    assert inverse.T @ np.diag(modes.squares) @ inverse == pytest.approx(STIFFNESS)
    assert inverse.T @ modes.damping @ inverse == pytest.approx(DAMPING)
    assert inverse.T @ modes.white @ inverse == pytest.approx(np.diag([0.3, 0.0]))
    assert modes.gaps @ inverse == pytest.approx(GAP[None, :])
    assert modes.fastest == pytest.approx(math.sqrt(max(np.linalg.eigvals(
        np.linalg.solve(MASS, STIFFNESS)
    ).real)))  # fmt: skip


@pytest.mark.parametrize("held", [False, True], ids=["free", "spring and damper on the gap"])
def test_white_noise_leaves_the_law_of_lyapunovs_equation(held: bool) -> None:
    substitutes = [EquivalentLinear(spring=2.5, centre=0.4, damper=0.3)] if held else []
    stiffness = STIFFNESS + (2.5 * np.outer(GAP, GAP) if held else 0.0)
    damping = DAMPING + (0.3 * np.outer(GAP, GAP) if held else 0.0)
    scene = two_masses(WhiteNoise(on="a", intensity=0.3), ConstantLoad(on="b", force=0.6))
    modes = model_of(scene).modal
    law = linear_law(modes, substitutes)
    assert law is not None
    inverse = np.linalg.inv(MASS)
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
    noise = np.zeros((4, 4))
    noise[2:, 2:] = inverse @ np.diag([0.3, 0.0]) @ inverse
    expected = solve_continuous_lyapunov(a, -noise)
    for first in (0, 2):
        found = modes.shapes @ law.covariance[first : first + 2, first : first + 2] @ modes.shapes.T
        assert found == pytest.approx(expected[first : first + 2, first : first + 2])
    push = np.array([0.0, 0.6]) + (2.5 * 0.4 * GAP if held else 0.0)
    mean = modes.shapes @ (modes.rest + law.mean)
    assert mean == pytest.approx(np.linalg.solve(stiffness, push))
    rates = np.linalg.eigvals(a).real
    assert law.slowest == pytest.approx(1.0 / (2.0 * np.min(-rates)))


def test_filtered_noise_and_a_sine_are_integrals_of_the_gain() -> None:
    noise = FilteredNoise(on="b", intensity=0.2, frequency_hz=0.3, zeta=0.2)
    sine = Sine(on="a", amplitude=0.7, frequency_hz=0.25)
    modes = model_of(two_masses(noise, sine)).modal
    law = linear_law(modes)
    assert law is not None
    row = GAP @ modes.shapes
    w = np.linspace(-40.0, 40.0, 2001)
    wf = 2.0 * math.pi * 0.3
    shape = wf**2 / (wf**2 - w**2 + 2j * 0.2 * wf * w)
    moved = np.array([gain(one) @ np.array([0.0, 1.0]) @ GAP for one in w])
    density = 0.2 * np.abs(shape * moved) ** 2  # smooth, and falls as w^-8
    expected = np.trapezoid(density, w) / (2.0 * math.pi)
    turn = 2.0 * math.pi * 0.25
    wave = 0.7 * abs(gain(turn) @ np.array([1.0, 0.0]) @ GAP)
    assert law.variances(row, 0) == pytest.approx(expected + wave**2 / 2.0, rel=1e-6)
    assert law.variances(np.zeros(2), 0) == 0.0


def test_what_nothing_damps_has_no_law() -> None:
    scene = two_masses(WhiteNoise(on="a", intensity=0.3))
    loose = scene.model_copy(
        update={"structure": scene.structure.model_copy(update={"damping": ((0, 0), (0, 0))})}
    )
    assert linear_law(model_of(loose).modal) is None
