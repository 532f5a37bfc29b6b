"""Quarter cars: their gain, the table that they make of a road, and the mount that they carry."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import StateSpace, lsim

from stochvi.mathematics.frequency_response import covariance
from stochvi.mathematics.spectra import Table, response_moments
from stochvi.methods.closed_form import exact
from stochvi.model.model import model_of
from stochvi.results.errors import SceneError
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.excitations import ConstantLoad, RoadNoise, Sine
from stochvi.scenes.scene import Scene, load_scene
from stochvi.scenes.structures import Isolator, Matrices
from stochvi.scenes.vehicles import QuarterCar

ROAD = RoadNoise(road="C", speed_kmh=80.0)
OWN: dict[str, Any] = {
    "body_mass": 320.0, "wheel_mass": 45.0, "suspension_stiffness": 2e4,
    "suspension_damping": 1100.0, "tyre_stiffness": 1.8e5, "tyre_damping": 60.0,
}  # fmt: skip
GOLDEN = QuarterCar(preset="golden-car", body_mass=400.0)
CARS = {
    "golden, body": GOLDEN,
    "golden, wheel": QuarterCar(preset="golden-car", mounted_on="wheel"),
    "own, body": QuarterCar(**OWN),
    "hardly damped": QuarterCar(**(OWN | {"suspension_damping": 10.0, "tyre_damping": 0.0})),
}
MOUNT = Isolator(mass=10.0, frequency_hz=12.0, zeta=0.1)


def state_space(car: QuarterCar) -> StateSpace:
    """Body or wheel displacement from the displacement of the road, in states x and v + what the
    damping of the tyre puts into them at once."""
    golden = (1.0, 0.15, 63.3, 6.0, 653.0, 0.0)
    own = (getattr(car, key) for key in OWN)
    ms, mu, ks, cs, kt, ct = golden if car.preset else own
    a = np.array(
        [
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [-ks / ms, ks / ms, -cs / ms, cs / ms],
            [ks / mu, -(ks + kt) / mu, cs / mu, -(cs + ct) / mu],
        ]
    )
    # with p = x_u' - (c_t / m_u) z in place of the velocity of the wheel no z' is needed
    jump = np.array([[0.0], [0.0], [0.0], [ct / mu]])
    b = np.array([[0.0], [0.0], [0.0], [kt / mu]]) + a @ jump
    c = np.array([[1.0, 0.0, 0.0, 0.0] if car.mounted_on == "body" else [0.0, 1.0, 0.0, 0.0]])
    return StateSpace(a, b, c, np.zeros((1, 1)))


def response(space: StateSpace, f: np.ndarray) -> np.ndarray:
    """C (s - A)^-1 B at frequencies in Hz."""
    s = 2j * np.pi * np.atleast_1d(f)[:, None, None] * np.eye(4)
    return (space.C @ np.linalg.solve(s - space.A, space.B[None].repeat(len(s), 0)))[:, 0, 0]


@pytest.mark.parametrize("name", list(CARS))
def test_the_gain_is_that_of_the_state_space(name: str) -> None:
    car = CARS[name]
    f = np.geomspace(0.05, 200.0, 300)
    known = response(state_space(car), f)
    np.testing.assert_allclose(car.gain(f), known, rtol=1e-9)
    other = car.model_copy(update={"mounted_on": "wheel" if car.mounted_on == "body" else "body"})
    assert np.abs(other.gain(f) / known - 1.0).max() > 0.1


def test_a_road_that_is_a_sine_moves_the_body_by_the_gain() -> None:
    car, f = CARS["own, body"], 3.0
    time = np.linspace(0.0, 20.0, 40_001)
    _, moved, _ = lsim(state_space(car), np.sin(2.0 * np.pi * f * time), time)
    gain = complex(car.gain(f))
    settled = time > 15.0
    expected = np.abs(gain) * np.sin(2.0 * np.pi * f * time + np.angle(gain))
    assert np.abs(moved - expected)[settled].max() < 1e-5


@pytest.mark.parametrize("name", list(CARS))
def test_the_table_is_as_close_to_the_density_as_it_says(name: str) -> None:
    car = CARS[name]
    table = ROAD.behind(car).table
    f = np.exp(np.random.default_rng(1).uniform(*np.log(table.frequency_hz[[0, -1]]), 20_000))
    exact_density = ROAD.table(f) * np.abs(car.gain(f)) ** 2
    # between the middle, where the error is held to 1e-6, and the ends of an interval
    assert np.abs(table(f) / exact_density - 1.0).max() < 1.5e-6
    assert len(table.frequency_hz) < 30_000


def test_class_c_at_80_kmh_shakes_the_golden_car_as_the_integral_says() -> None:
    space = state_space(GOLDEN)

    def density(f: float) -> float:  # road acceleration times the gain, in (m/s^2)^2/Hz
        velocity = (2.0 * math.pi * 0.1) ** 2 * 256e-6 * (80.0 / 3.6)
        gain = response(space, np.array(f))[0]
        return (2.0 * math.pi * f) ** 2 * velocity * abs(gain) ** 2

    speed = 80.0 / 3.6
    cuts = [0.01 * speed, 0.8, 1.2, 2.0, 6.0, 10.0, 14.0, 30.0, 10.0 * speed]
    parts = [quad(density, a, b, epsrel=1e-10)[0] for a, b in itertools.pairwise(cuts)]
    found = ROAD.behind(GOLDEN).table
    assert found.mean_square() == pytest.approx(sum(parts), rel=1e-6)
    assert math.sqrt(found.mean_square()) == pytest.approx(1.622, abs=0.001)
    coarse = found.frequency_hz[::400]
    rough = Table(frequency_hz=coarse, density=found(coarse))
    assert abs(rough.mean_square() / sum(parts) - 1.0) > 1e-4


def with_reaction(car: QuarterCar, mount: Isolator, mass: float) -> float:
    """Rms stroke of the mount where it acts back on the vehicle, m: body, wheel and box on the
    road by matrices."""
    m, c, k = (np.pad(each, (0, 1)) for each in car.matrices)
    m[2, 2] = mass
    stroke = np.array([-1.0, 0.0, 1.0])
    c += mass * mount.damping_rate * np.outer(stroke, stroke)
    k += mass * mount.omega**2 * np.outer(stroke, stroke)
    whole = Scene(
        structure=Matrices(coordinates=["body", "wheel", "box"], mass=m, damping=c, stiffness=k),
        excitations=[ROAD],
    )
    modes = model_of(whole).modal
    law = covariance(modes.tables, np.diag(modes.squares), modes.damping)
    row = stroke @ modes.shapes
    return math.sqrt(row @ law[:3, :3] @ row)


def test_the_reaction_of_the_mount_vanishes_with_its_mass() -> None:
    scene = Scene(structure=MOUNT, vehicle=GOLDEN, excitations=[ROAD])
    alone = exact(scene).coordinates["x"]["displacement_std"].value
    off = {mass: with_reaction(GOLDEN, MOUNT, mass) / alone - 1.0 for mass in (4.0, 0.4, 0.04)}
    assert 1e-3 < abs(off[4.0]) < 0.05
    assert off[0.4] == pytest.approx(off[4.0] / 10.0, rel=0.1)
    assert off[0.04] == pytest.approx(off[0.4] / 10.0, rel=0.02)
    assert abs(with_reaction(CARS["own, body"], MOUNT, 0.04) / alone - 1.0) > 0.05


def test_a_scene_says_its_vehicle_and_passes_levels_through_it() -> None:
    scene = load_scene(shipped_scene("isolator-vehicle"))
    assert scene.vehicle is not None
    words = " ".join(scene.assumptions())
    body, wheel = scene.vehicle.modes
    for part in (f"{body.frequency_hz:.3g} Hz", f"{wheel.frequency_hz:.3g} Hz", "2.5 % of that of"):
        assert part in words
    assert not model_of(scene).cautions
    bare = Scene(structure=scene.structure, excitations=[ROAD])
    assert any("[vehicle]" in caution for caution in model_of(bare).cautions)
    (road,) = scene.at_level(20.0).excitations
    np.testing.assert_allclose(road.table.density, 100.0 * scene.excitations[0].table.density)
    again = Scene(**scene.document())
    np.testing.assert_array_equal(again.excitations[0].table.density,
                                  scene.excitations[0].table.density)  # fmt: skip
    rows = scene.excitations[0].facts("base", scene.excitations[0].numbers())
    assert any("quarter car" in " ".join(row) for row in rows)


def test_a_scene_that_takes_the_road_of_another_leaves_that_as_it_is() -> None:
    first = load_scene(shipped_scene("isolator-vehicle"))
    table = first.excitations[0].table
    again = first.replace(title="again")
    bare = first.replace(vehicle=None)
    assert first.excitations[0].table == table
    assert again.excitations[0].table == table
    assert bare.excitations[0].table != table
    assert bare.replace(vehicle=first.vehicle).excitations[0].table == table


def test_a_load_of_the_base_may_stand_beside_the_road() -> None:
    pressed = ConstantLoad(acceleration=9.80665)
    scene = Scene(structure=MOUNT, vehicle=GOLDEN, excitations=[ROAD, pressed])
    mean = exact(scene).coordinates["x"]["displacement_mean"].value
    assert mean == pytest.approx(-9.80665 / MOUNT.omega**2)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({}, "needs body_mass, wheel_mass"),
        ({"preset": "golden-car", "wheel_mass": 3.0}, "takes a preset, or parameters of its own"),
        ({"preset": "van"}, "golden-car"),
        (OWN | {"body_mass": -1.0}, "body_mass"),
        ({key: OWN[key] for key in list(OWN)[:4]}, "needs tyre_stiffness"),
    ],
)
def test_a_vehicle_that_is_not_whole_is_refused(keys: dict[str, Any], sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence):
        QuarterCar(**keys)


def test_what_does_not_go_through_a_vehicle_is_refused() -> None:
    tone = Sine(on="base", amplitude=1.0, frequency_hz=5.0)
    with pytest.raises(SceneError, match=r"excitation\.1 of kind 'sine' acts on the base"):
        Scene(structure=MOUNT, vehicle=GOLDEN, excitations=[ROAD, tone])
    push = Sine(on="x", amplitude=1.0, frequency_hz=5.0)
    assert Scene(structure=MOUNT, vehicle=GOLDEN, excitations=[ROAD, push]).vehicle == GOLDEN
    with pytest.raises(SceneError, match="needs an excitation of kind 'road'"):
        Scene(structure=MOUNT, vehicle=GOLDEN, excitations=[push])


def test_moments_of_a_table_without_wide_panels_are_those_of_its_density() -> None:
    # a flat density by its ends or by as many breakpoints as a filtered one has is the same
    f = np.geomspace(1.0, 100.0, 5000)
    ends, dense = (Table(frequency_hz=each, density=np.ones(len(each))) for each in (f[[0, -1]], f))
    few, many = (response_moments([table], 75.0, 15.0) for table in (ends, dense))
    assert many.displacement == pytest.approx(few.displacement, rel=1e-9)
    assert many.absolute_acceleration == pytest.approx(few.absolute_acceleration, rel=1e-9)
