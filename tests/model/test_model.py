"""The numbers that a scene is lowered to, against the physics that they stand for."""

import math

import numpy as np
import pytest

from stochvi import (
    ConstantLoad,
    Elastic,
    FilteredNoise,
    ImpactPair,
    Isolator,
    Oscillator,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
)
from stochvi.model.model import Model, model_of
from stochvi.scenes.structures import Matrices

G = 9.80665
WALL = Restitution(coefficient=0.8)


def isolator(mass: float, *excitations) -> Model:
    structure = Isolator(mass=mass, frequency_hz=5.0, zeta=0.1)
    pair = ImpactPair(lower=-2e-3, upper=3e-3, law=Elastic(stiffness=1e4))
    return model_of(Scene(structure=structure, impact_pairs=[pair], excitations=list(excitations)))


def test_an_oscillator_is_described_per_unit_mass() -> None:
    scene = Scene(
        structure=Oscillator(mass=2.0, damping=0.6, stiffness=18.0),
        impact_pairs=[ImpactPair(lower=-1.0, upper=0.5, law=WALL)],
        excitations=[WhiteNoise(intensity=0.4), ConstantLoad(force=-3.0)],
    )
    model = model_of(scene)
    assert (model.omega, model.damping_rate) == pytest.approx((3.0, 0.3))
    assert (model.intensity, model.load) == pytest.approx((0.4 / 4.0, -1.5))
    assert model.temperature == pytest.approx(0.4 / (2.0 * 0.6))
    assert [(stop.side, stop.position) for stop in model.stops] == [(-1, -1.0), (1, 0.5)]
    one_sided = scene.model_copy(update={"impact_pairs": (ImpactPair(upper=0.5, law=WALL),)})
    assert [model_of(each).pairs[0].play for each in (scene, one_sided)] == [1.5, None]


@pytest.mark.parametrize("mass", [1.0, 2.5])
def test_a_base_shakes_every_mass_alike_and_a_force_does_not(mass: float) -> None:
    table = TabulatedNoise(frequency_hz=[1.0, 10.0], density=[0.02, 0.02], unit="g2/Hz", on="base")
    noise = FilteredNoise(
        density=2.0, unit="(m/s2)2/Hz", frequency_hz=8.0, zeta=0.2, on="base"
    )  # fmt: skip
    white = WhiteNoise(density=0.4, unit="(m/s2)2/Hz", on="base")
    on_base = isolator(mass, table, noise, white, ConstantLoad(acceleration=2.0))
    assert on_base.acceleration_tables[0].density == pytest.approx(0.02 * G**2)
    assert on_base.filters[0].intensity == pytest.approx(1.0)
    assert on_base.intensity == pytest.approx(0.2)
    # what is left behind when the base accelerates upwards moves down
    assert on_base.load == pytest.approx(-2.0)
    forced = isolator(mass, WhiteNoise(intensity=0.4, on="x"), ConstantLoad(force=2.0, on="x"))
    assert forced.intensity == pytest.approx(0.4 / mass**2)
    assert forced.load == pytest.approx(2.0 / mass)
    assert forced.noise_on_mass and not on_base.noise_on_mass
    stop = forced.upper
    assert stop is not None
    assert float(stop.law.force_at(1e-4)) == pytest.approx(1.0 / mass)


def test_a_lower_stop_is_an_upper_one_seen_from_the_other_side() -> None:
    model = isolator(1.0, WhiteNoise(intensity=1.0, on="base"))
    lower, upper = model.lower, model.upper
    assert lower is not None and upper is not None
    depth = np.array([-1e-4, 0.0, 2e-4])
    assert lower.deflection(-2e-3 - depth) == pytest.approx(depth)
    assert upper.deflection(3e-3 + depth) == pytest.approx(depth)
    assert (lower.distance, upper.distance) == (2e-3, 3e-3)


def test_a_pair_between_two_masses_has_their_reduced_mass() -> None:
    scene = Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=np.diag([2.0, 0.5]), damping=np.diag([0.4, 0.1]),
            stiffness=np.diag([3.0, 1.0]),
        ),
        impact_pairs=[
            ImpactPair(name="gap", between=["b", "a"], upper=1.0, law=WALL),
            ImpactPair(name="stop", on="a", lower=-1.0, law=WALL),
        ],
        excitations=[WhiteNoise(on="a", intensity=0.8), WhiteNoise(on="b", intensity=0.2)],
    )  # fmt: skip
    model = model_of(scene)
    gap, stop = model.pairs
    assert gap.mass == pytest.approx(1.0 / (1.0 / 2.0 + 1.0 / 0.5)) and stop.mass == 2.0
    assert gap.direction.tolist() == [-1.0, 1.0] and gap.relative and not stop.relative
    # an impulse P along the gap changes its speed by P / mass
    change = np.linalg.solve(model.mass, gap.direction)
    assert gap.direction @ change == pytest.approx(1.0 / gap.mass)
    assert model.temperature == pytest.approx(1.0)
    assert not model.elastic


def test_noise_that_does_not_match_the_damping_has_no_temperature() -> None:
    structure = Matrices(
        coordinates=["a", "b"], mass=np.eye(2), damping=np.diag([0.4, 0.1]), stiffness=np.eye(2)
    )
    alike = [WhiteNoise(on=name, intensity=0.4) for name in "ab"]
    assert model_of(Scene(structure=structure, excitations=alike)).temperature is None


def test_gravity_is_an_acceleration_of_the_base() -> None:
    mount = Isolator(frequency_hz=5.0, zeta=0.1, gravity=True)
    model = model_of(Scene(structure=mount, excitations=[WhiteNoise(intensity=1.0, on="base")]))
    assert model.load == pytest.approx(-G)
    assert model.rest == pytest.approx(-G / (10.0 * math.pi) ** 2)
