"""Accelerations with stops: published numbers, and a second way to the mean square."""

import math

import numpy as np
import pytest

from stochvi import ConstantLoad, Elastic, Isolator, NotApplicable, Restitution, Viscoelastic
from stochvi.isolators.moved_stops import at_clearances
from stochvi.isolators.screening import screen
from stochvi.isolators.sizing.clatter import clatter
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.methods.monte_carlo.tabulated import plan_tabulated
from stochvi.model.model import model_of
from stochvi.results.estimates import Estimate
from stochvi.scenes.impact_laws import CompliantLaw, Hertz
from stochvi.testing import assert_agrees
from support.mounts import truck

SPRING = (24.0 * math.pi) ** 2
"""N/m, of 1 kg at 12 Hz."""

REFERENCE = {
    "hit_rate": (0.246, 0.004, 1.0),
    "acceleration_rms": (1.201, 0.002, STANDARD_GRAVITY),
    "largest_acceleration": (17.9, 0.2, STANDARD_GRAVITY),
}
"""By an independent program (value, standard error, SI unit): MIL-STD-810H truck vertical, 12 Hz,
zeta 0.1, stops at 3 sigma with 100 times the stiffness of the mount and a damping ratio of 0.2;
largest in 18 s."""


def test_a_truck_mount_against_another_program() -> None:
    scene = truck(Viscoelastic(stiffness=100.0 * SPRING, damping_ratio=0.2))
    three_sigma = 3.0 * screen(scene).displacement_std
    row = clatter(scene, [three_sigma], rel_error=0.01, seed=1).iloc[0]
    assert row["clearance_in_sigma"] == pytest.approx(3.0, rel=1e-4)
    for name, (value, error, unit) in REFERENCE.items():
        found = Estimate(
            value=row[name] / unit,
            standard_error=math.hypot(row[f"{name}_error"] / unit, error),
            bias=row.get(f"{name}_bias", 0.0) / unit,
        )
        assert_agrees(found, value)
    # without stops: 1.176 g, and 4.16(1) g at most in 18 s
    free = row["acceleration_rms"] / row["rms_amplification"] / STANDARD_GRAVITY
    error = row["rms_amplification_error"] + row["acceleration_rms_error"] / STANDARD_GRAVITY
    assert_agrees(Estimate(value=free, standard_error=error), 1.176)
    free = row["largest_acceleration"] / row["peak_amplification"] / STANDARD_GRAVITY
    error = free * row["peak_amplification_error"] / row["peak_amplification"]
    assert_agrees(Estimate(value=free, standard_error=math.hypot(error, 0.01), bias=0.01), 4.16)


@pytest.mark.parametrize(
    "law", [Elastic(stiffness=30.0 * SPRING), Hertz(coefficient=500.0 * SPRING)]
)
def test_the_mean_square_is_that_of_samples(law: CompliantLaw) -> None:
    """Samples of a stationary motion, however few in a contact, have its mean square."""
    scene = truck(law)
    clearance = 1.5 * screen(scene).displacement_std
    row = clatter(scene, [clearance], rel_error=0.02, window=8.0, seed=2).iloc[0]
    stopped = at_clearances(scene, clearance)
    plan = plan_tabulated(model_of(stopped), 0.0, 8.0)
    paths, model = 256, model_of(stopped)
    blocks = []
    for first in range(0, paths, plan.block):
        blocks.append(np.zeros((plan.steps, plan.block, 3)))
        plan.averages(7, first, plan.block, blocks[-1])
    x, v, _ = np.concatenate(blocks, axis=1).transpose(2, 0, 1)
    push = law.force_at(x - clearance) - law.force_at(-x - clearance)
    square = ((model.damping_rate * v + model.omega**2 * x + push) ** 2).mean(axis=0)
    found = Estimate(
        value=row["acceleration_rms"] ** 2,
        standard_error=math.hypot(
            2.0 * row["acceleration_rms"] * row["acceleration_rms_error"],
            float(square.std()) / math.sqrt(paths),
        ),
    )
    assert_agrees(found, float(square.mean()))
    without = ((model.damping_rate * v + model.omega**2 * x) ** 2).mean()
    with pytest.raises(AssertionError):
        assert_agrees(found, float(without))


def test_stiffer_stops_are_sharper_and_hardly_show_in_the_rms() -> None:
    scene = truck(Elastic(stiffness=SPRING))
    clearance = 3.0 * screen(scene).displacement_std
    table = clatter(scene, [clearance], stiffness_ratios=[10.0, 1000.0], rel_error=0.04, seed=3)
    peaks, rms = table["peak_amplification"], table["rms_amplification"]
    assert (rms > 1.0).all() and (rms < 1.3).all()
    assert peaks[1] > 4.0 * peaks[0] > 4.0
    assert list(table["stiffness_ratio"]) == [10.0, 1000.0]


def test_what_has_no_acceleration_says_why() -> None:
    with pytest.raises(NotApplicable, match="restitution alone has no stiffness"):
        clatter(truck(Restitution(coefficient=0.5)), [1e-3])
    with pytest.raises(NotApplicable, match="law must be elastic or viscoelastic"):
        clatter(truck(Hertz(coefficient=1e6)), [1e-3], stiffness_ratios=[10.0])
    with pytest.raises(ValueError, match="clearances must be positive"):
        clatter(truck(Elastic(stiffness=1e5)), [0.0])
    with pytest.raises(NotApplicable, match="needs an impact_pair"):
        clatter(truck(Elastic(stiffness=1e5)).model_copy(update={"impact_pairs": ()}), [1e-3])


def test_static_sag_is_no_acceleration() -> None:
    scene = truck(Elastic(stiffness=30.0 * SPRING))
    assert isinstance(scene.structure, Isolator)
    hanging = scene.model_copy(
        update={"excitations": (*scene.excitations, ConstantLoad(acceleration=9.80665))}
    )
    one, two = (
        clatter(some, [4e-3], rel_error=0.1, window=4.0, seed=5).iloc[0]
        for some in (scene, hanging)
    )
    assert two["acceleration_rms"] == pytest.approx(one["acceleration_rms"], rel=1e-9)
