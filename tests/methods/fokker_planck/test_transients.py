"""Transients: exact laws, the stationary answer in the end, the balance of energy at any time."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from stochvi import Estimate, NotApplicable, NotConverged, Scene, fokker_planck, transient
from stochvi.mathematics.quadrature import gauss_panels
from stochvi.mathematics.state_space import step_covariance, transition
from stochvi.methods.fokker_planck import Gaussian, Transient, meshes_in_time, transients
from stochvi.methods.fokker_planck.basis import VelocityBasis
from stochvi.methods.fokker_planck.transients import Moments
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases
from support.known import BENCH, RIGID_STOPS, oscillator

FLYING = Gaussian(mean=(0.8, -0.7), covariance=((0.09, 0.05), (0.05, 0.2)))


def told(found: Transient, name: str, index: int) -> Estimate:
    value, bound = (float(getattr(group, name)[index]) for group in (found.values, found.errors))
    return Estimate(value=value, bias=bound)


# Exact laws ---------------------------------------------------------------------------------


def law_after(start: Gaussian, seconds: float, load: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of omega = 1, b = 0.1, S0 = 0.2 without stops."""
    generator = np.array([[0.0, 1.0], [-1.0, -0.1]])
    step = transition(generator, seconds)
    rest = np.array([load, 0.0])
    mean = rest + step @ (np.array(start.mean) - rest)
    spread = step_covariance(generator, np.diag([0.0, 0.2]), seconds)
    return mean, spread + step @ np.array(start.covariance) @ step.T


def test_without_stops_a_gaussian_stays_gaussian() -> None:
    times = [0.5, 2.0, 9.0]
    found = transient(oscillator(load=0.4), times, FLYING, rtol=2e-3)
    for index, seconds in enumerate(times):
        mean, spread = law_after(FLYING, seconds, 0.4)
        assert_agrees(told(found, "mean", index), mean[0])
        assert_agrees(told(found, "variance", index), spread[0, 0])
        assert_agrees(told(found, "velocity_mean", index), mean[1])
        assert_agrees(told(found, "velocity_mean_square", index), spread[1, 1] + mean[1] ** 2)
        law = Gaussian(mean=tuple(mean), covariance=tuple(map(tuple, spread)))
        x, v = (mean[k] + math.sqrt(spread[k, k]) * np.linspace(-2.0, 2.0, 9) for k in (0, 1))
        exact = law.density(x[:, None], v)
        largest = np.abs(found.density(x[:, None], v, index) - exact).max()
        assert largest < 0.01 * exact.max()


def test_a_wrong_damping_is_caught() -> None:
    found = transient(oscillator(damping=0.11, load=0.4), [2.0], FLYING, rtol=2e-3)
    _, spread = law_after(FLYING, 2.0, 0.4)
    with pytest.raises(AssertionError, match="differs from"):
        assert_agrees(told(found, "variance", 0), spread[0, 0])


def test_a_free_mass_between_elastic_stops_is_a_sum_of_mirror_images() -> None:
    """Unfolded, the mass is free: x = +-(y - 4 k) or its reflection about a stop."""
    damping, intensity, start = 0.5, 1.0, (0.3, 0.5)
    scene = oscillator(-1.0, 1.0, omega=0.0, damping=damping, intensity=intensity)
    times = [0.7, 2.0]
    found = transient(scene, times, start, rtol=3e-3)
    generator = np.array([[0.0, 1.0], [0.0, -damping]])
    x = np.linspace(-1.0, 1.0, 21)
    for index, seconds in enumerate(times):
        mean = transition(generator, seconds) @ np.array(start)
        spread = step_covariance(generator, np.diag([0.0, intensity]), seconds)
        law = Gaussian(mean=tuple(mean), covariance=tuple(map(tuple, spread)))
        for v in (-0.6, 0.0, 0.9):
            exact = sum(
                law.density(x + 4.0 * k, np.array(v)) + law.density(2.0 - x + 4.0 * k, np.array(-v))
                for k in range(-4, 5)
            )
            assert np.abs(found.density(x, v, index) - exact).max() < 2e-3 * exact.max()


# The stationary answer in the end -----------------------------------------------------------

SHARED = ("variance", "velocity_mean_square")


def assert_stationary(scene: Scene, found: Transient, index: int) -> None:
    truth = fokker_planck(scene, rtol=2e-3).estimates()
    pairs = {
        "mean": ("x", "displacement_mean"),
        "velocity_mean_square": ("x", "velocity_mean_square"),
    }
    for name, key in pairs.items():
        known, mine = truth[key], told(found, name, index)
        assert known.bias is not None and mine.bias is not None
        assert_agrees(replace(mine, bias=mine.bias + known.bias), known.value)
    for name in ("speed_rate", "speed_square_rate"):
        known = truth["stops", f"impact_{name}"]
        sides = [told(found, f"{name}_{side}", index) for side in ("lower", "upper")]
        total = sum(side.value for side in sides)
        bound = sum(side.bias or 0.0 for side in sides) + (known.bias or 0.0)
        assert_agrees(Estimate(value=total, bias=bound), known.value)


ENDED = [
    (oscillator(-0.6, 1.1, 0.7, load=-0.2), "rest", 5e-3),
    (oscillator(None, -0.3, 0.6), (-1.0, 0.0), 2e-2),
    (oscillator(-1.0, 1.0, 0.1), "rest", 5e-3),
]


@quick_cases(("scene", "start", "rtol"), ENDED, ids=range(len(ENDED)), keep=(0,))
def test_in_the_end_the_answer_is_stationary(scene: Scene, start, rtol: float) -> None:
    found = transient(scene, [1.0, 300.0], start, rtol=rtol)
    assert_stationary(scene, found, 1)
    with pytest.raises(AssertionError, match="differs from"):
        assert_stationary(scene, found, 0)


@quick_cases("row", RIGID_STOPS, ids=lambda row: f"R={row.restitution}", keep=(0, 3))
def test_the_near_exact_table_is_met_in_the_end(row) -> None:
    found = transient(oscillator(-1.0, 1.0, row.restitution), [400.0], rtol=3e-3)
    names = {
        "displacement_std": ("variance", 0.5),
        "velocity_std": ("velocity_mean_square", 0.5),
        "impact_speed_rate": ("speed_rate_upper", 1.0),
        "impact_speed_square_rate": ("speed_square_rate_upper", 1.0),
    }
    for known, (name, power) in names.items():
        mine = told(found, name, 0)
        both = 1.0 if power == 0.5 else 2.0
        value = (both * mine.value) ** power
        assert mine.bias is not None
        bound = power * value * mine.bias / mine.value + row.errors[known]
        assert_agrees(Estimate(value=value, bias=bound), row.values[known])


# At any time --------------------------------------------------------------------------------


def energy_gained(found: Transient, weights: np.ndarray, restitution: float) -> tuple[float, float]:
    """Over the inner times, by noise less damping and impacts, per unit mass; its error."""
    inner = slice(1, -1)
    rates, bounds = (
        group.velocity_mean_square[inner] * 0.1
        + sign * (1.0 - restitution**2) / 2.0 * sum(
            getattr(group, f"speed_square_rate_{side}")[inner] for side in ("lower", "upper")
        )
        for group, sign in ((found.values, 1.0), (found.errors, 1.0))
    )  # fmt: skip
    return float(weights @ (0.1 - rates)), float(weights @ bounds)


def energy(group: Moments, index: int) -> float:
    return (
        float(group.variance[index] + group.mean[index] ** 2 + group.velocity_mean_square[index])
        / 2.0
    )


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [0.3, pytest.param(0.8, marks=pytest.mark.verify)])
def test_energy_is_gained_and_lost_as_noise_damping_and_impacts_say(restitution: float) -> None:
    """The balance of energy: d/dt E (v^2 + x^2) / 2 = S0 / 2 - b E v^2 - (1 - R^2) F2 / 2."""
    inner, weights = gauss_panels([1.0, 2.0, 4.0], 6)
    scene = oscillator(-0.8, 1.2, restitution)
    found = transient(scene, [1.0, *inner, 4.0], (0.0, 0.5), rtol=1e-2)
    gained, bound = energy_gained(found, weights, restitution)
    change = energy(found.values, -1) - energy(found.values, 0)
    sizes = [
        found.errors.variance[k] / 2.0
        + found.errors.velocity_mean_square[k] / 2.0
        + abs(found.values.mean[k]) * found.errors.mean[k]
        for k in (0, -1)
    ]
    estimate = Estimate(value=change, bias=bound + float(sum(sizes)))
    assert estimate.bias is not None
    assert estimate.bias < 0.05 * gained
    assert_agrees(estimate, gained)
    wrong, _ = energy_gained(found, weights, restitution - 0.1)
    with pytest.raises(AssertionError, match="differs from"):
        assert_agrees(estimate, wrong)


def test_the_density_holds_what_the_averages_say() -> None:
    found = transient(oscillator(-1.0, 1.0, 0.5), [2.0], (0.2, 0.6), rtol=2e-3)
    # elements meet with small jumps
    operator = found._states[0].operator
    x, weights = gauss_panels(operator.mesh.x_breaks, 12)
    profile = found.displacement_density(x, 0)
    mean = float(weights @ (x * profile))
    assert float(weights @ profile) == pytest.approx(1.0, rel=1e-9)
    assert mean == pytest.approx(found.values.mean[0], rel=1e-9)
    assert float(weights @ (x**2 * profile)) - mean**2 == pytest.approx(
        found.values.variance[0], rel=1e-9
    )
    half = operator.box.speed * np.array(operator.mesh.u_breaks)
    v, v_weights = gauss_panels(np.union1d(-half, half), 12)
    again = found.density(x[5::12, None], v, 0) @ v_weights
    assert again == pytest.approx(profile[5::12], rel=1e-9)


def test_before_the_stops_are_felt_the_law_is_that_without_them() -> None:
    found = transient(oscillator(-1.0, 1.0, 0.5), [0.1], rtol=1e-2)
    spread = step_covariance(np.array([[0.0, 1.0], [-1.0, -0.1]]), np.diag([0.0, 0.2]), 0.1)
    assert found.values.variance[0] == pytest.approx(spread[0, 0], rel=1e-12)
    assert found.values.speed_rate_upper[0] == 0.0
    peak = 1.0 / math.sqrt(2.0 * math.pi * spread[0, 0])
    assert found.displacement_density(0.0, 0) == pytest.approx(peak, rel=1e-12)


def test_a_mirrored_start_is_a_mirrored_answer() -> None:
    one, other = (
        transient(oscillator(-0.9, 0.9, 0.6), [1.5], (side * 0.3, side * 0.8), rtol=5e-2)
        for side in (1.0, -1.0)
    )
    assert one.values.mean[0] == pytest.approx(-other.values.mean[0], rel=1e-6)
    assert one.values.speed_rate_upper == pytest.approx(other.values.speed_rate_lower, rel=1e-6)


def test_units_are_only_units() -> None:
    natural = transient(oscillator(-1.0, 1.0, 0.8), [3.0], rtol=2e-2)
    bench = transient(oscillator(-1.0, 1.0, 0.8, units=BENCH), [3.0 / BENCH.omega], rtol=2e-2)
    scale = BENCH.length**2
    assert bench.values.variance[0] == pytest.approx(scale * natural.values.variance[0], rel=1e-8)
    scale = BENCH.length * BENCH.omega**2
    assert bench.values.speed_rate_upper[0] == pytest.approx(
        scale * natural.values.speed_rate_upper[0], rel=1e-8
    )


def test_a_wrong_restitution_at_the_wall_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    right = VelocityBasis.wall
    monkeypatch.setattr(VelocityBasis, "wall", lambda self, r: right(self, r - 0.02))
    scene = oscillator(-0.6, 1.1, 0.7, load=-0.2)
    found = transient(scene, [300.0], rtol=2e-3)
    monkeypatch.undo()
    with pytest.raises(AssertionError, match="differs from"):
        assert_stationary(scene, found, 0)


# What is refused, and what is told ----------------------------------------------------------


def test_the_document_is_plain_and_complete() -> None:
    found = transient(oscillator(-1.0, 1.0, 0.8), [0.1, 5.0], rtol=0.02)
    document = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert document["method"] == "transient"
    assert set(document["values"]) == set(document["errors"]) == set(Moments._fields)
    assert len(found.to_frame()) == len(document["times"]) == 2
    assert repr(found) == "<transient at 0.1, 5 s>"


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"times": []}, "times must be one or more finite numbers above 0"),
        ({"times": [0.0]}, "times must be one or more finite numbers above 0"),
        ({"rtol": -1.0}, "rtol must be at least 1e-12, got -1"),
        ({"start": "stationary"}, "start must be 'rest', a point or a Gaussian"),
        ({"start": (1.0, 0.0)}, "start must lie between the stops"),
        ({"start": FLYING}, "got a distribution with 25 % beyond"),
    ],
    ids=lambda value: str(value)[:30],
)
def test_an_argument_out_of_range_is_named(options, sentence) -> None:
    with pytest.raises(ValueError, match=sentence):
        transient(oscillator(-1.0, 1.0, 0.8), **{"times": [1.0], **options})


def test_a_scene_without_a_stationary_state_is_refused() -> None:
    with pytest.raises(NotApplicable, match="stiffness must be positive"):
        transient(oscillator(omega=0.0), [1.0])


def test_an_accuracy_out_of_reach_is_not_claimed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transients, "LEVELS", meshes_in_time.LEVELS[:2])
    with pytest.raises(NotConverged, match="reached a relative error of") as reason:
        transient(oscillator(-1.0, 1.0, 0.8), [2.0], rtol=1e-9)
    assert isinstance(reason.value.partial, Transient)
