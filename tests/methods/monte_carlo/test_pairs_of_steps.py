"""Some paths are simulated at twice the step with the same noise: what that says of the bias."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stochvi import Scene, load_scene
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.path_statistics import Layout, PathStatistics, StepPairs
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
