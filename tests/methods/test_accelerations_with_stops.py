"""Absolute acceleration of what hits stops, by the methods that simulate nothing."""

import math

import numpy as np
import pytest

from stochvi import (
    Elastic,
    ImpactPair,
    Isolator,
    Matrices,
    Oscillator,
    Restitution,
    Scene,
    WhiteNoise,
    average,
    exact,
    fokker_planck,
    linearise,
)
from stochvi.methods.monte_carlo.modal import plan_modal
from stochvi.model.model import model_of
from stochvi.results.estimates import Estimate
from stochvi.results.response import Response
from stochvi.testing import assert_agrees
from support.pairs import diagonal


def mount(restitution: float, zeta: float = 0.1, reach: float = 1.0) -> Scene:
    """An isolator on white noise between rigid stops at so many standard deviations."""
    free = Scene(
        structure=Isolator(frequency_hz=1.0, zeta=zeta),
        excitations=[WhiteNoise(density=0.1, unit="g2/Hz")],
    )
    place = reach * exact(free).coordinates["x"]["displacement_std"].value
    law = Restitution(coefficient=restitution)
    pair = ImpactPair(lower=-place, upper=1.3 * place, law=law)
    return free.model_copy(update={"impact_pairs": (pair,)})


def simulated(scene: Scene, paths: int = 64) -> Estimate:
    """The rms of the absolute acceleration about its mean, of springs and dampers along paths."""
    plan = plan_modal(model_of(scene), None, None)
    rows = plan.layout.rows
    mean, square = (plan.averages(3, 0, paths)[rows.index(("x", name))] for name in ("a", "aa"))
    variance = square - mean.mean() ** 2
    value = math.sqrt(variance.mean())
    error = float(variance.std(ddof=1)) / math.sqrt(paths) / (2.0 * value)
    return Estimate(value=value, standard_error=error, bias=0.0)


def acceleration(found: Response) -> Estimate:
    known = found.coordinates["x"]["acceleration_std"]
    assert isinstance(known, Estimate)
    return known


def test_between_impacts_it_is_that_of_springs_and_dampers_along_paths() -> None:
    for restitution, method in ((1.0, exact), (0.7, fokker_planck)):
        scene = mount(restitution)
        found = method(scene)
        known = simulated(scene)
        assert_agrees(known, acceleration(found).value)
        with pytest.raises(AssertionError):
            assert_agrees(simulated(mount(restitution, reach=2.0)), acceleration(found).value)
        assert any("between impacts" in text for text in found.assumptions)


def test_far_stops_leave_it_as_it_is() -> None:
    scene = mount(0.9, zeta=0.02, reach=9.0)
    free = acceleration(exact(scene.model_copy(update={"impact_pairs": ()})))
    for found in (average(scene), linearise(scene), linearise(scene, form="motion")):
        assert acceleration(found).value == pytest.approx(free.value, rel=1e-3)


def test_soft_stops_without_room_are_springs_of_a_linear_structure() -> None:
    stiffness = np.array([[3.0, -1.0], [-1.0, 2.0]])

    def structure(added: float) -> Matrices:
        rows = (stiffness + np.diag([added, 0.0])).tolist()
        return Matrices(
            coordinates=("x", "z"), mass=diagonal(1, 1), damping=diagonal(0.1, 0.2), stiffness=rows
        )

    excitations = [WhiteNoise(intensity=0.2, on="base")]
    pair = ImpactPair(name="x", on="x", clearance=1e-7, law=Elastic(stiffness=4.0))
    soft = linearise(Scene(structure=structure(0.0), impact_pairs=[pair], excitations=excitations))
    linear = exact(Scene(structure=structure(4.0), excitations=excitations))
    without = exact(Scene(structure=structure(0.0), excitations=excitations))
    known = acceleration(linear).value
    assert acceleration(soft).value == pytest.approx(known, rel=1e-3)
    assert acceleration(without).value != pytest.approx(known, rel=0.05)


def test_it_is_absent_where_noise_shakes_the_mass_itself() -> None:
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(clearance=1.0, law=Restitution(coefficient=1.0))],
        excitations=[WhiteNoise(intensity=0.2)],
    )
    assert exact(scene).coordinates["x"].acceleration_std is None
