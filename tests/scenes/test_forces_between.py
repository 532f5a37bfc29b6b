"""Forces between two coordinates, and motions of the whole that no stop feels."""

from __future__ import annotations

import numpy as np
import pytest

from stochvi import ImpactPair, Matrices, Oscillator, Restitution, Scene, SceneError, WhiteNoise
from stochvi.model.model import model_of
from stochvi.scenes.drift import drifts, without_drift
from stochvi.scenes.excitations import ConstantLoad, Excitation, Sine

CHAIN = Matrices(
    coordinates=("a", "b", "c"),
    mass=np.diag([1.0, 2.0, 3.0]),
    damping=np.zeros((3, 3)),
    stiffness=[[5.0, -5.0, 0.0], [-5.0, 5.0, 0.0], [0.0, 0.0, 7.0]],
)


def scene(excitation: Excitation, structure: Matrices = CHAIN) -> Scene:
    return Scene(structure=structure, excitations=[excitation])


def test_a_force_between_two_acts_on_both_in_opposite_directions() -> None:
    model = model_of(scene(WhiteNoise(between=("a", "c"), intensity=2.0)))
    assert model.white.tolist() == [[2.0, 0.0, -2.0], [0.0, 0.0, 0.0], [-2.0, 0.0, 2.0]]
    model = model_of(scene(ConstantLoad(between=("b", "a"), force=3.0)))
    assert model.constant_force.tolist() == [-3.0, 3.0, 0.0]
    noise = WhiteNoise(between=("a", "c"), intensity=2.0)
    assert scene(noise).effects() == ("white noise on a against c",)


@pytest.mark.parametrize(
    ("excitation", "sentence"),
    [
        (WhiteNoise(between=("a", "a"), intensity=1.0), "two different names"),
        (WhiteNoise(between=("a", "d"), intensity=1.0), "must act on .a. or .b. or .c., got .d."),
        (
            WhiteNoise(between=("a", "b"), on="a", intensity=1.0),
            "takes one of on, between and weights, got between, on",
        ),
        (WhiteNoise(between=("a", "b"), density=1.0, unit="g2/Hz"), "N2/Hz"),
        (ConstantLoad(between=("a", "b"), acceleration=1.0), "takes force"),
        (Sine(between=("a", "b"), velocity=1.0, frequency_hz=1.0), "velocity"),
        (Sine(between=("a", "c"), displacement=1.0, frequency_hz=1.0), "spring or damper"),
    ],
)
def test_what_cannot_act_between_two_is_refused(excitation: Excitation, sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence):
        scene(excitation)


def test_a_force_between_two_needs_coordinates_with_names() -> None:
    with pytest.raises(SceneError, match="names of several places"):
        Scene(
            structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
            excitations=[WhiteNoise(between=("x", "base"), intensity=1.0)],
        )


def test_motion_seen_from_a_free_mass_is_that_of_all() -> None:
    """Accelerations of the differences, by all coordinates and by the reduced matrices."""
    random = np.random.default_rng(0)
    mass = random.normal(size=(4, 4))
    mass = mass @ mass.T + 4.0 * np.eye(4)
    springs = np.zeros((4, 4))
    springs[:2, :2] = springs[2:, 2:] = [[1.0, -1.0], [-1.0, 1.0]]
    references, motions = drifts(np.vstack([springs, 0.0 * springs]), np.array([[0, 1, -1.0, 0]]))
    assert references == [2] and motions[:, 0] == pytest.approx(np.ones(4))
    force = random.normal(size=4)
    accelerations = np.linalg.solve(mass, force)
    kept = [0, 1, 3]
    forces = without_drift(mass, references, motions)
    relative = np.linalg.solve((forces @ mass)[:, kept], forces @ force)
    assert relative == pytest.approx(accelerations[kept] - accelerations[2])


def test_two_bodies_that_drift_apart_are_each_seen_from_one_of_theirs() -> None:
    references, motions = drifts(np.zeros((8, 4)), np.array([[1.0, -1.0, 0, 0], [0, 0, 1.0, -1.0]]))
    assert sorted(references) == [1, 3]
    assert motions[references] == pytest.approx(np.eye(2))


@pytest.mark.parametrize("held", [0.0, 1e-3])
def test_a_structure_that_a_spring_or_a_stop_holds_keeps_its_coordinates(held: float) -> None:
    law = Restitution(coefficient=0.5)
    pairs = [ImpactPair(between=("a", "b"), upper=1.0, law=law)]
    if not held:
        pairs.append(ImpactPair(name="wall", on="b", lower=-1.0, law=law))
    found = Scene(
        structure=Matrices(
            coordinates=("a", "b"), mass=np.eye(2), damping=np.zeros((2, 2)),
            stiffness=np.diag([0.0, held]),
        ),
        impact_pairs=pairs,
        excitations=[WhiteNoise(on="a", intensity=1.0)],
    )  # fmt: skip
    assert found.moving == ("a", "b")
    assert model_of(found).coordinates == ("a", "b")


def test_two_free_masses_are_one_oscillator_of_their_reduced_mass() -> None:
    pressed = Scene(
        structure=Matrices(
            coordinates=("a", "b"), mass=np.diag([1.0, 3.0]), damping=np.zeros((2, 2)),
            stiffness=np.zeros((2, 2)),
        ),
        impact_pairs=[ImpactPair(between=("a", "b"), upper=0.0, law=Restitution(coefficient=0.5))],
        excitations=[
            ConstantLoad(on="b", force=-2.0), WhiteNoise(on="b", intensity=9.0),
        ],
    )  # fmt: skip
    model = model_of(pressed)
    assert model.coordinates == ("a",) and model.unit_mass == pytest.approx(0.75)
    # the acceleration of a less that of b
    assert model.load == pytest.approx(2.0 / 3.0)
    assert model.intensity == pytest.approx(1.0)
