"""Simulation of springs that relax: against a plain integrator with the inner state, the exact
answers without stops, and boxes on such mounts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stochvi import (
    ImpactPair,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    exact,
    simulate,
)
from stochvi.model.model import model_of, with_dampers
from stochvi.results.estimates import Estimate
from stochvi.scenes import Modulation
from stochvi.scenes.structures.rigid_body import Mount, RigidBody
from stochvi.testing import assert_agrees
from support.accuracies import assert_differs
from support.rubber import Rubber, random_rubber


def between_stops(branches: Any, damping: float = 0.1) -> Scene:
    spring = {"kind": "relaxation", "stiffness": 0.0, "branches": branches}
    return Scene(
        structure=Oscillator(mass=1.0, damping=damping, stiffness=1.0, spring=spring),
        impact_pairs=[ImpactPair(lower=-0.6, upper=0.6, law=Restitution(coefficient=0.8))],
        excitations=[WhiteNoise(intensity=0.2)],
    )


def by_small_steps(
    k: float, tau: float, *, paths: int, time: float, step: float
) -> dict[str, tuple[float, float]]:
    """Mean squares, impacts per second and F1 with standard errors, by Euler's method with the
    overshoot mirrored, whose bias is about a share of step^2."""
    draw = np.random.default_rng(5)
    x, v, r = np.zeros((3, paths))
    sums = np.zeros((4, paths))
    kept, brought = np.exp(-step / tau), k * tau * -np.expm1(-step / tau)
    counted = 0
    for number in range(int((40.0 + time) / step)):
        v = v + step * (-x - 0.1 * v - r) + np.sqrt(0.2 * step) * draw.standard_normal(paths)
        r = kept * r + brought * v
        x = x + step * v
        beyond = np.abs(x) > 0.6
        speed = np.abs(v[beyond])
        x[beyond] = np.sign(x[beyond]) * (0.6 - 0.8 * (np.abs(x[beyond]) - 0.6))
        v[beyond] *= -0.8
        if number * step >= 40.0:
            counted += 1
            sums[0] += x**2
            sums[1] += v**2
            sums[2, beyond] += 1.0 / step
            sums[3, beyond] += speed / step
    means = sums / counted
    names = ("xx", "vv", "rate", "f1")
    errors = means.std(axis=1, ddof=1) / np.sqrt(paths)
    return dict(zip(names, zip(means.mean(axis=1), errors, strict=True), strict=True))


@pytest.mark.slow
def test_a_plain_integrator_with_the_inner_state_agrees() -> None:
    known = by_small_steps(1.5, 0.8, paths=2048, time=60.0, step=0.01)
    relaxing, plain = (
        simulate(between_stops(branches), rel_error=0.005, seed=2, budget=60.0)
        for branches in ([[1.5, 0.8]], [])
    )

    def numbers(answer: Any) -> dict[str, Estimate]:
        x, stops = answer.coordinates["x"], answer.impact_pairs["stops"]
        return {
            "xx": x.displacement_mean_square, "vv": x.velocity_mean_square,
            "f1": stops.impact_speed_rate,
        }  # fmt: skip

    for name, found in numbers(relaxing).items():
        value, error = known[name]
        # the plain integrator is off by a share of about step^2, and counts by steps
        both = Estimate(
            value=found.value, standard_error=float(np.hypot(found.standard_error, error)),
            bias=(found.bias or 0.0) + 0.01 * abs(value) * (name == "f1") + 1e-3 * abs(value),
            how=found.how,
        )  # fmt: skip
        assert_agrees(both, value)
        if name != "f1":
            # a spring that does not relax is noticed
            assert_differs(both, numbers(plain)[name].value)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "table"), [(3, False), (5, False), (5, True)])
def test_without_stops_it_is_the_exact_answer(seed: int, table: bool) -> None:
    _, keys = random_rubber(seed, most=2)
    on = keys["coordinates"][0]
    noise: Any = WhiteNoise(intensity=0.7, on=on)
    if table:
        noise = TabulatedNoise(
            frequency_hz=[0.02, 1.0, 4.0], density=[0.5, 2.0, 0.1], unit="N2/Hz", on=on
        )
    scene = Scene(structure=Matrices(**keys), excitations=[noise])
    wanted, found = exact(scene), simulate(scene, paths=512, seed=1)
    without = Scene(
        structure=Matrices(**{k: v for k, v in keys.items() if k != "spring"}), excitations=[noise]
    )
    other, seen = exact(without), 0
    for name in keys["coordinates"]:
        for what in ("displacement_mean_square", "velocity_mean_square"):
            own = getattr(found.coordinates[name], what)
            assert_agrees(own, getattr(wanted.coordinates[name], what).value)
            try:
                assert_agrees(own, getattr(other.coordinates[name], what).value)
            except AssertionError:
                seen += 1
    assert seen > 0  # a structure without its rubber would be noticed


def test_a_box_on_rubber_is_the_structure_of_its_places() -> None:
    places = [(0.2, 0.1, -0.1), (-0.2, 0.15, 0.0), (0.05, -0.1, 0.0)]
    spring = {"kind": "relaxation", "stiffness": 300.0, "branches": [[500.0, 0.05]], "axis": "z"}
    mounts = [
        Mount(at=p, stiffness=[900.0, 900.0, 600.0], damping=[3.0, 3.0, 2.0], spring=spring)
        for p in places
    ]
    box = RigidBody(mass=1.0, inertia=[0.01, 0.012, 0.02], mounts=mounts)
    scene = Scene(structure=box, excitations=[WhiteNoise(intensity=0.1, on="base", axis="z")])
    mass, damping, stiffness = np.diag([1.0, 1.0, 1.0, 0.01, 0.012, 0.02]), 0.0, 0.0
    rows = []
    for x, y, z in places:
        along = np.array([[1.0, 0, 0, 0, z, -y], [0, 1.0, 0, -z, 0, x], [0, 0, 1.0, y, -x, 0]])
        stiffness = stiffness + (along.T * [900.0, 900.0, 900.0]) @ along
        damping = damping + (along.T * [3.0, 3.0, 2.0]) @ along
        rows.append(along[2])
    own = Rubber(
        mass, np.asarray(damping), np.asarray(stiffness), np.array(rows), np.full(3, 500.0),
        np.full(3, 0.05), 0.1 * np.outer(mass[2], mass[2]),
    )  # fmt: skip
    wanted, found = own.covariance(), exact(scene)
    for k, name in enumerate(found.coordinates):
        if k < 6:
            value = found.coordinates[name].velocity_mean_square.value
            assert value == pytest.approx(wanted[6 + k, 6 + k], rel=1e-7)


@pytest.mark.parametrize(("k", "tau", "taken"), [(200.0, 5e-4, True), (20.0, 0.02, False)])
def test_the_fastest_branches_are_dampers_within_the_stated_bias(
    k: float, tau: float, taken: bool
) -> None:
    spring = {"kind": "relaxation", "stiffness": 0.0, "branches": [[k, tau], [1.0, 0.7]]}
    free = Scene(
        structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0, spring=spring),
        excitations=[WhiteNoise(intensity=0.2)],
    )
    plain = spring | {"branches": [[1.0, 0.7]]}
    damped = Scene(
        structure=Oscillator(mass=1.0, damping=0.02 + k * tau, stiffness=1.0, spring=plain),
        excitations=[WhiteNoise(intensity=0.2)],
    )
    model = with_dampers(model_of(free))
    assert (len(model.branches) == 1) == taken
    assert (model.rms_bias > 0.0) == taken
    one, other = (exact(each).coordinates["x"] for each in (free, damped))
    for what in ("displacement_std", "velocity_std"):
        ratio = getattr(one, what).value / getattr(other, what).value
        assert not taken or abs(ratio - 1.0) <= model.rms_bias
    if taken:
        found = simulate(free, paths=64, duration=20.0).coordinates["x"].displacement_std
        assert found.bias is not None and found.bias >= 2.0 * model.rms_bias * found.value


def test_a_modulation_beside_rubber_is_refused() -> None:
    spring = {"kind": "relaxation", "stiffness": 1.0, "branches": [[1.0, 1.0]]}
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0, spring=spring),
        excitations=[
            WhiteNoise(intensity=0.2),
            Modulation(of="stiffness", amplitude=0.1, frequency_hz=0.3),
        ],
    )
    assert model_of(scene).branches
    with pytest.raises(NotApplicable, match="does not depend on frequency"):
        simulate(scene, paths=2, duration=1.0)
