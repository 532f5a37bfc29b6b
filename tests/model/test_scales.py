"""Scales of a model: exact where the Gibbs distribution is, and nothing where no law is found."""

import math

import numpy as np
import pytest

from stochvi import ImpactPair, NotApplicable, Restitution, Scene, WhiteNoise, exact
from stochvi.model.model import model_of
from stochvi.model.scales import PairScale, scales_of, scales_of_free_motion
from stochvi.scenes.excitations import ConstantLoad
from stochvi.scenes.structures import Matrices
from support.known import ELASTIC_STOPS, ElasticStops, oscillator, values


def scale(scene: Scene) -> PairScale:
    model = model_of(scene)
    found = scales_of(model, model.modal)
    assert found is not None
    (pair,) = found[1]
    return pair


@pytest.mark.parametrize("row", ELASTIC_STOPS)
def test_between_elastic_stops_the_scales_are_those_of_the_exact_law(row: ElasticStops) -> None:
    """The repetition ends within a few digits: 40 times halves what is left of each step."""
    scene = oscillator(row.lower, row.upper)
    found, truth = scale(scene), values(exact(scene))
    assert found.speed == pytest.approx(truth["velocity_std"], rel=1e-3)
    assert found.deviation == pytest.approx(truth["displacement_std"], rel=1e-3)


def test_far_stops_leave_the_scales_of_the_motion_without_them() -> None:
    """With a load, which moves the mean; nearer stops change the scales."""

    def both(distance: float) -> tuple[PairScale, PairScale]:
        near = oscillator(0.7 - distance, 0.7 + distance)
        load = ConstantLoad(force=0.7)
        model = model_of(near.replace(excitations=(*near.excitations, load)))
        (one, other) = (scales(model, model.modal) for scales in (scales_of, scales_of_free_motion))
        assert one is not None and other is not None
        return one[1][0], other[1][0]

    far, free = both(7.0)
    assert far == pytest.approx(free, rel=1e-6)
    with pytest.raises(AssertionError):
        assert both(2.0)[0] == pytest.approx(free, rel=1e-6)


def test_lossy_stops_slow_the_mass_as_the_energy_balance_says() -> None:
    """S0 / 2 = b E v^2 + (1 - R^2) / 2 F2, with F2 of Rayleigh speeds at either stop."""
    found = scale(oscillator(-1.0, 1.0, 0.6))
    x = np.linspace(-1.0, 1.0, 20_001)
    density = np.exp(found.slope * x - found.curvature * x * x / 2.0)
    at_stops = (density[0] + density[-1]) / np.trapezoid(density, x)
    square_rate = at_stops * 2.0 * found.speed**3 / math.sqrt(2.0 * math.pi)
    power = 0.1 * found.speed**2 + (1.0 - 0.6**2) / 2.0 * square_rate
    assert power == pytest.approx(0.1, rel=1e-3)


def test_only_a_mass_that_lies_on_a_stop_is_pressed() -> None:
    assert scale(oscillator(-1.0, 1.0)).pressing == 0.0
    # far from rest the spring presses with omega^2 times the distance
    assert scale(oscillator(None, -8.0)).pressing == pytest.approx(8.0, rel=1e-6)
    assert scale(oscillator(8.0, None)).pressing == pytest.approx(8.0, rel=1e-6)


def test_a_gap_that_nothing_shakes_is_refused() -> None:
    scene = Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=np.eye(2), damping=0.1 * np.eye(2), stiffness=np.eye(2)
        ),
        impact_pairs=[ImpactPair(on="b", upper=1.0, law=Restitution(coefficient=0.5))],
        excitations=[WhiteNoise(on="a", intensity=0.2)],
    )
    model = model_of(scene)
    for scales in (scales_of, scales_of_free_motion):
        with pytest.raises(NotApplicable, match="at rest"):
            scales(model, model.modal)
