"""Some paths are simulated at twice the step with the same noise: what that says of the bias."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from stochvi import Scene, load_scene
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.path_statistics import Layout, PathStatistics, StepPairs
from stochvi.methods.monte_carlo.step_bias import (
    bias_of_refined_step,
    bias_of_smooth_motion,
    extrapolated,
)
from stochvi.model.model import model_of
from stochvi.results.estimates import Estimate
from stochvi.scenes.datasets import zoo_files
from stochvi.testing import assert_agrees
from support.known import oscillator

LAYOUT = Layout(rows=(("a", "x"), ("a", "xx")), origins={}, thresholds={})
TRIALS, PATHS, PAIRED = 400, 256, 64


def trials(correlation: float, bias: float) -> tuple[np.ndarray, np.ndarray]:
    """Differences and their stated errors of a quantity of many independent runs."""
    random = np.random.default_rng(4)
    found = []
    for _ in range(TRIALS):
        fine = random.normal(2.0, 1.0, (2, PATHS))
        own = random.normal(0.0, 1.0, (2, PAIRED))
        same = fine[:, :PAIRED] - 2.0
        coarse = 2.0 + bias + correlation * same + np.sqrt(1.0 - correlation**2) * own
        pairs = StepPairs.of(np.concatenate([fine[:, :PAIRED], coarse]), LAYOUT)
        whole = PathStatistics.of(fine, LAYOUT)
        found += pairs.differences(lambda means: (means["a", "x"] * means["a", "xx"],), whole)
    values, errors = np.array(found).T
    return values, errors


@pytest.mark.parametrize("correlation", [0.0, 0.6, 0.99])
def test_the_difference_has_no_bias_and_the_error_that_is_stated(correlation: float) -> None:
    values, errors = trials(correlation, 0.1)
    # the product of the means is (2.1)^2 at twice the step, 2^2 at the step
    spread = values.std(ddof=1)
    assert_agrees(Estimate(value=values.mean(), standard_error=spread / TRIALS**0.5), 2.1**2 - 4.0)
    relative = 1.0 / np.sqrt(2.0 * TRIALS)  # standard error of a standard deviation
    mean_error = np.sqrt(np.mean(errors**2))
    assert_agrees(Estimate(value=spread / mean_error, standard_error=relative), 1.0)


@pytest.mark.parametrize("correlation", [-0.5, 0.6, 0.99])
def test_the_error_of_a_difference_is_that_of_a_sum_over_all_paths(correlation: float) -> None:
    """c - beta f over n paths less (1 - beta) f over N: those n paths are in both means."""
    random = np.random.default_rng(6)
    fine = random.normal(2.0, 1.0, PATHS)
    same, own = fine[:PAIRED] - 2.0, random.normal(0.0, 1.0, PAIRED)
    coarse = 2.1 + correlation * same + np.sqrt(1.0 - correlation**2) * own
    layout = Layout(rows=(("a", "x"),), origins={}, thresholds={})
    pairs = StepPairs.of(np.vstack([fine[:PAIRED], coarse]), layout)
    whole = PathStatistics.of(fine[None], layout)
    ((value, error),) = pairs.differences(lambda means: (means["a", "x"],), whole)
    covariance = np.cov(fine[:PAIRED], coarse)
    beta = min(max(covariance[0, 1] / covariance[0, 0], 0.0), 1.0)
    paired = np.array([-beta / PAIRED - (1.0 - beta) / PATHS, 1.0 / PAIRED])
    alone = (1.0 - beta) / PATHS
    variance = PAIRED * paired @ covariance @ paired
    variance += (PATHS - PAIRED) * alone**2 * covariance[0, 0]
    assert error == pytest.approx(np.sqrt(variance), rel=1e-6)
    ahead = coarse.mean() - beta * fine[:PAIRED].mean() - (1.0 - beta) * fine.mean()
    assert value == pytest.approx(ahead, abs=1e-9)


def test_shared_noise_and_the_other_paths_make_the_error_smaller() -> None:
    """Less than that of the pairs alone, and than that of independent runs."""
    errors = {rho: np.sqrt(np.mean(trials(rho, 0.0)[1] ** 2)) for rho in (0.0, 0.6, 0.99)}
    one = 4.0 / np.sqrt(2.0)  # of the product over one path, from either factor

    def independent(rho: float) -> float:
        return 2.0 * one * np.sqrt(1.0 / PAIRED + 1.0 / PATHS)

    def pairs_alone(rho: float) -> float:
        return 2.0 * one * np.sqrt((2.0 - 2.0 * rho) / PAIRED)

    assert errors[0.0] < 0.85 * pairs_alone(0.0)
    assert errors[0.6] < 0.9 * min(independent(0.6), pairs_alone(0.6))
    assert errors[0.99] < 0.3 * independent(0.99)


@pytest.mark.parametrize(
    ("bias", "order"),
    [
        (bias_of_smooth_motion, 2.0),
        (partial(bias_of_refined_step, "collision_rate", restitution=0.8), 0.5),
        (partial(bias_of_refined_step, "impact_speed_rate", restitution=0.8), 2.0),
        (partial(bias_of_refined_step, "impact_speed_rate", restitution=0.3), 1.0),
        (partial(bias_of_refined_step, "impact_speed_rate", restitution=0.1), 0.5),
        # at R = 1/2 the exponent beta of slow impacts is 1: order (2 + m - beta) / 2
        (partial(extrapolated, "collision_rate", restitution=0.5), 0.5),
        (partial(extrapolated, "impact_speed_rate", restitution=0.5), 1.0),
        (partial(extrapolated, "impact_speed_square_rate", restitution=0.5), 1.5),
    ],
)  # fmt: skip
def test_the_bias_extrapolates_an_error_of_the_order_of_the_scheme(
    bias: Callable[..., float], order: float
) -> None:
    step, size = 0.01, 0.3
    at_the_step, at_twice = size * step**order, size * (2.0 * step) ** order
    assert bias(difference=at_twice - at_the_step) == pytest.approx(at_the_step, rel=1e-9)


SCENES = {
    "one oscillator": oscillator(-1.0, 1.0, 0.5),
    "three masses": load_scene(zoo_files()["chain-lossy-pairs"]),
    "filtered noise": load_scene(zoo_files()["filtered-lossy"]),
}


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())
def test_a_step_of_twice_the_length_has_the_noise_of_both(scene: Scene) -> None:
    """Without stops the paths then differ by what the step does alone, which shrinks with it."""
    free = scene.replace(impact_pairs=[])
    plan = make_plan(model_of(free), None, None)

    def off(merged: bool, step: float) -> float:
        fine = plan.with_step(step)
        coarse = replace(fine.coarser(), merged=merged)
        row = next(row for row, key in enumerate(plan.layout.rows) if key[1] == "xx")
        square = fine.averages(5, 0, 64)[row]
        return float(np.std(coarse.averages(5, 0, 64)[row] - square) / square.std())

    ratio = off(True, 0.125 * plan.step) / off(True, 0.25 * plan.step)
    assert ratio < 0.75
    # negative control: the noise of each step for itself
    assert off(False, 0.125 * plan.step) > 0.5
