"""The bound on early first passages: Rice's integral, answers, what it does not know."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm

from stochvi import first_passage
from stochvi.mathematics.quadrature import gauss_panels
from stochvi.mathematics.state_space import step_covariance, transition
from stochvi.methods.fokker_planck import Gaussian
from stochvi.methods.fokker_planck.crossing_bound import passages_at_most
from stochvi.methods.fokker_planck.initial_states import InitialState
from stochvi.model.model import Model, model_of
from support.known import oscillator


def linear(omega: float, damping: float, intensity: float, load: float) -> Model:
    """The model of an oscillator of unit mass without stops."""
    return model_of(oscillator(omega=omega, damping=damping, intensity=intensity, load=load))


def mean_crossings(model: Model, start: InitialState, barrier: float, duration: float) -> float:
    """Of an upper barrier from below before `duration`, by Rice's integral and Gauss's rule."""
    generator = np.array([[0.0, 1.0], [-(model.omega**2), -model.damping_rate]])
    places, weights = gauss_panels(np.linspace(0.0, duration, 41), 6)
    rest = np.array([model.rest, 0.0])
    total = 0.0
    for place, weight in zip(places, weights, strict=True):
        mean = rest + transition(generator, place) @ (np.array(start) - rest)
        spread = step_covariance(generator, np.diag([0.0, model.intensity]), place)
        slope = spread[0, 1] / spread[0, 0]
        speed = mean[1] + slope * (barrier - mean[0])
        noise = math.sqrt(spread[1, 1] - slope * spread[0, 1])
        upwards = speed * norm.cdf(speed / noise) + noise * norm.pdf(speed / noise)
        total += weight * norm.pdf(barrier, mean[0], math.sqrt(spread[0, 0])) * upwards
    return float(total)


BOUNDED = [
    # model, start, barrier, time
    (linear(1.0, 0.0218, 0.0436, 0.0), InitialState(-0.87, 0.21), 4.9, 20.0),
    (linear(1.0, 0.1, 0.2, 0.0), InitialState(0.5, -0.5), 2.5, 2.0),
    (linear(2.0, 0.4, 1.6, 2.0), InitialState(0.5, 0.0), 3.5, 3.0),
    (linear(1.0, 3.0, 2.0, -0.5), InitialState(-0.5, 0.0), 1.5, 3.0),
]


@pytest.mark.parametrize(("model", "start", "barrier", "duration"), BOUNDED)
def test_the_bound_is_above_rices_mean_crossings(model, start, barrier, duration) -> None:
    (bound,) = passages_at_most(model, start, -math.inf, barrier, np.array([duration]))
    crossings = mean_crossings(model, start, barrier, duration)
    assert 0.0 < crossings <= bound < 1.0
    # it knows that the noise has not had the time to spread to the stationary distribution
    rest = model.rest
    z = (barrier - rest) * model.omega / math.sqrt(model.intensity / 2.0 / model.damping_rate)
    assert bound < duration * model.omega / (2.0 * math.pi) * math.exp(-(z**2) / 2.0)
    # that of a barrier twice as far is no bound for this one
    (farther,) = passages_at_most(model, start, -math.inf, 2.0 * barrier, np.array([duration]))
    assert farther < crossings


def test_two_barriers_are_bounded_by_the_sum_and_what_is_unknown_by_one() -> None:
    model, start, times = linear(1.0, 0.1, 0.2, 0.2), InitialState(0.1, 0.2), np.array([0.0, 3.0])
    both, low, high = (
        passages_at_most(model, start, *ends, times)
        for ends in ((-2.5, 3.0), (-2.5, math.inf), (-math.inf, 3.0))
    )
    assert both[0] == 0.0
    assert both[1] == pytest.approx(low[1] + high[1], rel=1e-12)
    law = Gaussian(mean=(0.0, 0.0), covariance=((1.0, 0.0), (0.0, 1.0)))
    adrift = linear(0.0, 0.1, 0.2, 0.2)
    for case in ((model, law, -9.0, 9.0), (adrift, start, -9.0, 9.0), (model, start, -9.0, 0.1)):
        assert passages_at_most(*case, times[1:]).tolist() == [1.0]


def test_no_answer_crosses_the_bound() -> None:
    """Where both are known: early, and still with the digits that rtol asks for."""
    scene = oscillator(damping=0.4, intensity=0.8)
    times = [1.5, 2.0, 3.0]
    found = first_passage(scene, -2.2, 2.2, times=times, rtol=1e-3)
    bounds = passages_at_most(model_of(scene), InitialState(0.0, 0.0), -2.2, 2.2, np.array(times))
    for estimate, bound in zip(found.probability, bounds, strict=True):
        assert estimate.bias is not None
        assert estimate.bias < 0.5 * estimate.value < 0.5 * bound < 0.5
