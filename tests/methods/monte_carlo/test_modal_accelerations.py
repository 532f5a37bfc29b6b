"""Absolute accelerations of several coordinates on a moving base: exact laws, with stops too."""

import math

import numpy as np
import pytest

from stochvi import (
    Elastic,
    ImpactPair,
    Isolator,
    Matrices,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    exact,
    linearise,
    simulate,
)
from stochvi.methods.monte_carlo.simulation import BETWEEN_IMPACTS
from stochvi.model.gap import Gap
from stochvi.model.gibbs_law import GibbsLaw
from stochvi.model.model import model_of
from stochvi.results.estimates import Estimate
from stochvi.testing import assert_agrees
from support.boxes import box, scene_with

THETA = 0.8
"""S0 / (2 b) of the first coordinate, m^2/s^2, where its damping rate is B."""

B, OMEGA = 0.3, 1.4


def two(**pair: object) -> Scene:
    """Two masses that share the base alone: the first has an oscillator's law of its own."""
    masses, damping, springs = np.array([[2.0, 0.5], [B, 0.2], [OMEGA**2, 4.0]])
    return Scene(
        structure=Matrices(
            coordinates=["a", "b"],
            mass=np.diag(masses),
            damping=np.diag(masses * damping), stiffness=np.diag(masses * springs),
        ),
        impact_pairs=[ImpactPair(on="a", **pair)] if pair else [],
        excitations=[WhiteNoise(on="base", intensity=2.0 * B * THETA)],
    )  # fmt: skip


def acceleration(scene: Scene) -> Estimate:
    found = simulate(scene, paths=256, seed=4, threads=1).coordinates["a"].acceleration_std
    assert found is not None
    return found


def law_of_a(scene: Scene) -> GibbsLaw:
    (pair,) = model_of(scene).pairs
    gap = Gap.of_pair(pair, omega=OMEGA, damping_rate=0.0, load=0.0)
    return GibbsLaw.of(gap, theta=THETA)


def test_between_elastic_rigid_stops_springs_and_dampers_pull() -> None:
    scene = two(lower=-0.5, upper=0.9, law=Restitution(coefficient=1.0))
    law = law_of_a(scene)
    square = B**2 * THETA + OMEGA**4 * law.variance
    assert_agrees(acceleration(scene), math.sqrt(square))


def test_one_oscillator_between_rigid_stops_has_the_acceleration_between_impacts() -> None:
    law = Restitution(coefficient=1.0)
    scene = Scene(
        structure=Isolator(mass=2.0, damping=2.0 * B, stiffness=2.0 * OMEGA**2),
        impact_pairs=[ImpactPair(lower=-0.5, upper=0.9, law=law)],
        excitations=[WhiteNoise(intensity=2.0 * B * THETA)],
    )
    found = simulate(scene, rel_error=0.02, seed=4, threads=1)
    square = B**2 * THETA + OMEGA**4 * law_of_a(scene).variance
    assert_agrees(found.coordinates["x"].acceleration_std, math.sqrt(square))
    assert BETWEEN_IMPACTS in found.assumptions


def test_stops_that_give_way_pull_as_well() -> None:
    stiffness = 30.0
    scene = two(lower=-0.5, upper=0.9, law=Elastic(stiffness=stiffness))
    law = law_of_a(scene)
    touching = [law.contact(side) for side in ("lower", "upper")]
    share = sum(each.probability for each in touching if each is not None)
    # of the Gibbs law exp(-U / theta), E U'^2 = theta E U''
    square = THETA * (B**2 + OMEGA**2 + stiffness / 2.0 * share)
    without = THETA * (B**2 + OMEGA**2)
    found = acceleration(scene)
    assert_agrees(found, math.sqrt(square))
    with pytest.raises(AssertionError):
        assert_agrees(found, math.sqrt(without))


def test_linear_accelerations_are_those_of_closed_form_and_simulation() -> None:
    table = TabulatedNoise(
        on="base", frequency_hz=[0.05, 2.0], density=[0.3, 0.1], unit="(m/s2)2/Hz"
    )
    coupled = two().structure.model_dump() | {"stiffness": [[6.0, -1.5], [-1.5, 2.0]]}
    scene = Scene(structure=Matrices(**coupled), excitations=[table, *two().excitations])
    closed, closure = exact(scene), linearise(scene)
    found = simulate(scene, rel_error=0.03, seed=2, threads=1)
    for name in ("a", "b"):
        truth = float(closed.coordinates[name].acceleration_std)
        assert float(closure.coordinates[name].acceleration_std) == pytest.approx(truth, rel=1e-12)
        assert_agrees(found.coordinates[name].acceleration_std, truth)


def test_a_point_of_a_rigid_body_moves_as_its_coordinates_say() -> None:
    """Its acceleration follows from that of a box whose centre of mass is described from there."""
    place = np.array([0.1, -0.2, 0.05])
    scene = scene_with(box(points={"display": place}))
    found, model = exact(scene).coordinates, model_of(scene)
    rows = dict(zip(model.outputs, model.output_rows, strict=True))
    q = np.array([0.1, -0.3, 0.2, 0.02, -0.01, 0.03])
    for axis, moved in zip("xyz", q[:3] + np.cross(q[3:], place), strict=True):
        assert rows[f"display.{axis}"] @ q == pytest.approx(moved, rel=1e-13)
        assert float(found[f"display.{axis}"].acceleration_std) > 0.0


def test_a_force_on_a_mass_leaves_accelerations_out() -> None:
    scene = two()
    pushed = Scene(
        structure=scene.structure,
        excitations=[*scene.excitations, WhiteNoise(on="b", intensity=1.0)],
    )
    assert exact(pushed).coordinates["a"].acceleration_std is None
    assert exact(scene).coordinates["a"].acceleration_std is not None
