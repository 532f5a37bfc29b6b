"""The moment closure of several coordinates: exact where it should be, its balances, its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stochvi import (
    Absorber,
    ImpactPair,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    WhiteNoise,
    linearise,
)
from stochvi.absorbers.performance import linear_rms
from stochvi.scenes.excitations import ConstantLoad, FilteredNoise, Sine
from stochvi.scenes.structures import Matrices

NOISE = WhiteNoise(on="structure", intensity=0.2)


def absorber_in_a_box(restitution: float, **attached: float) -> Scene:
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        absorber=Absorber(
            mass=0.1, play=2.0, law=Restitution(coefficient=restitution), **attached
        ),
        excitations=[WhiteNoise(intensity=0.2)],
    )  # fmt: skip


def value(response, owner: str, name: str) -> float:
    return response.estimates()[owner, name].value


def test_a_box_that_loses_nothing_is_answered_exactly() -> None:
    response = linearise(absorber_in_a_box(1.0))
    assert value(response, "box", "collision_rate") == pytest.approx(1.32314185710031, rel=1e-12)
    assert value(response, "structure", "displacement_std") == pytest.approx(1.0, rel=1e-12)
    assert value(response, "absorber", "velocity_mean_square") == pytest.approx(10.0, rel=1e-12)
    relative = value(response, "box", "relative_displacement_std")
    assert relative == pytest.approx(2.0 / math.sqrt(12.0), rel=1e-12)
    assert response.estimates()["box", "collision_rate"].bias == 0.0
    # with a loss its error is that of an atlas
    lossy = linearise(absorber_in_a_box(0.8)).estimates()
    assert lossy["structure", "displacement_std"].bias > 0.0


@pytest.mark.parametrize(
    "stops",
    [
        {"lower": -1.0, "upper": 1.0},
        {"lower": -0.5, "upper": 1.0},
        {"upper": 0.6},
        {"lower": -0.6},
        {"upper": -0.2},
    ],
    ids=str,
)
@pytest.mark.parametrize("load", [0.0, 0.3])
def test_one_mass_is_answered_as_an_oscillator(stops: dict[str, float], load: float) -> None:
    law = Restitution(coefficient=0.7)
    pushed = [ConstantLoad(force=load)] if load else []
    alone = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(law=law, **stops)],
        excitations=[WhiteNoise(intensity=0.2), *pushed],
    )
    matrix = Scene(
        structure=Matrices(coordinates=["x"], mass=[[1.0]], damping=[[0.1]], stiffness=[[1.0]]),
        impact_pairs=[ImpactPair(law=law, **stops)],
        excitations=[WhiteNoise(intensity=0.2), *pushed],
    )
    expected, found = linearise(alone).estimates(), linearise(matrix).estimates()
    for key, estimate in found.items():
        scale = abs(expected[key].value) + 1e-6
        assert abs(estimate.value - expected[key].value) < 1e-8 * scale, key


def random_scene(number: int) -> Scene:
    random = np.random.default_rng(number)
    count = int(random.integers(2, 5))
    spring = np.diag(random.uniform(0.5, 2.0, count))
    for i in range(count - 1):
        link = random.uniform(0.2, 1.0)
        spring[i, i] += link
        spring[i + 1, i + 1] += link
        spring[i, i + 1] -= link
        spring[i + 1, i] -= link
    names = [f"x{i}" for i in range(count)]
    pairs = [
        ImpactPair(
            name="first", on="x0", lower=-random.uniform(0.3, 2.0), upper=random.uniform(0.3, 2.0),
            law=Restitution(coefficient=random.uniform(0.5, 1.0)),
        ),
        ImpactPair(
            name="second", between=("x0", "x1"), upper=random.uniform(0.3, 2.0),
            law=Restitution(coefficient=random.uniform(0.5, 1.0)),
        ),
    ]  # fmt: skip
    return Scene(
        structure=Matrices(
            coordinates=names, mass=np.diag(random.uniform(0.5, 2.0, count)),
            damping=0.1 * spring, stiffness=spring,
        ),
        impact_pairs=pairs,
        excitations=[
            WhiteNoise(on=name, intensity=random.uniform(0.1, 0.4)) for name in names
        ],
    )  # fmt: skip


@pytest.mark.parametrize("number", range(8))
def test_the_balances_of_the_whole_hold(number: int) -> None:
    response = linearise(random_scene(number))
    assert {"energy", "virial", "force on x0"} <= set(response.identities)
    for name, residual in response.identities.items():
        assert abs(residual.value) < 1e-9, name
    rates = [value(response, pair, "collision_rate") for pair in ("first", "second")]
    assert min(rates) > 0.0


def test_without_stops_it_is_the_exact_linear_response() -> None:
    scene = Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=np.diag([1.0, 0.5]),
            damping=[[0.2, -0.1], [-0.1, 0.1]], stiffness=[[2.0, -1.0], [-1.0, 1.0]],
        ),
        excitations=[
            FilteredNoise(on="a", intensity=0.1, frequency_hz=0.3, zeta=0.2),
            Sine(on="b", amplitude=0.3, frequency_hz=0.1),
        ],
    )  # fmt: skip
    response = linearise(scene)
    displacement, velocity = linear_rms(scene)
    for name in ("a", "b"):
        assert value(response, name, "displacement_std") == pytest.approx(displacement[name])
        assert value(response, name, "velocity_std") == pytest.approx(velocity[name])
        assert response.estimates()[name, "displacement_std"].bias == 0.0


def test_what_it_does_not_cover_is_said() -> None:
    loaded = absorber_in_a_box(0.5).model_copy(
        update={"excitations": (ConstantLoad(on="structure", force=1.0),)}
    )
    with pytest.raises(NotApplicable, match="noise or a sine, got a constant load alone"):
        linearise(loaded)
    with pytest.raises(NotApplicable, match=r"structure\.kind must be"):
        linearise(absorber_in_a_box(0.5), form="motion")
