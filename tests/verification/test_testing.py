"""`stochvi.testing`: right integrators pass, wrong ones fail and are told what it looks like."""

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import stochvi
from stochvi import NotApplicable, exact, simulate
from stochvi.results.estimates import Estimate
from stochvi.testing import (
    Problem,
    as_response,
    judge,
    known_answers,
    problem_of,
)
from stochvi.verification import zoo
from stochvi.verification.check import compare
from stochvi.verification.testing import reference_values
from stochvi.verification.testing.samples import PathAverages, sample_of
from support.known import ELASTIC_STOPS, RIGID_STOPS

FEW = ("linear", "elastic-half-sigma", "lossy-half-sigma")


# Known answers ------------------------------------------------------------------------------


def test_known_answers_are_those_of_the_closed_form() -> None:
    for name in ("elastic-load", "hertz-stops", "psd-truck-linear", "chain-two-pairs"):
        known, fresh = known_answers(name)[name], exact(zoo(name)[name])
        assert known.method == "exact"
        for key, estimate in known.estimates().items():
            assert estimate.value == pytest.approx(
                fresh.estimates()[key].value, rel=1e-9, abs=1e-12
            )


def test_known_answers_are_those_of_quadrature() -> None:
    names = ("elastic-unequal-gaps", "elastic-upper-stop", "elastic-preload")
    for name, row in zip(names, ELASTIC_STOPS[1:], strict=True):
        known = known_answers(name)[name].estimates()
        assert known["x", "displacement_mean"].value == pytest.approx(row.mean, rel=1e-12)
        assert known["stops", "collision_rate_upper"].value == pytest.approx(row.rate_upper)


@pytest.mark.parametrize("restitution", [0.95, 0.5])
def test_known_answers_are_those_of_an_independent_solver(restitution: float) -> None:
    known = known_answers(f"lossy-{restitution:g}")[f"lossy-{restitution:g}"].estimates()
    row = next(each for each in RIGID_STOPS if each.restitution == restitution)
    for key in (("x", "velocity_std"), ("stops", "impact_speed_square_rate")):
        error = row.errors[key[1]] + (known[key].bias or 0.0)
        assert abs(known[key].value - row.values[key[1]]) <= error


def test_a_scene_without_a_known_answer_is_refused_with_those_that_have_one() -> None:
    with pytest.raises(ValueError, match=r"'filtered-lossy'.*known: .*lossy-0\.5"):
        known_answers("filtered-lossy")


# Integrators --------------------------------------------------------------------------------


def engine(change: Callable[[dict], None] = lambda document: None) -> Callable[..., Any]:
    """Monte Carlo of the scene, or of one that was converted wrongly, as finished statistics."""

    def integrator(problem: Problem, seed: int) -> dict[str, tuple[float, float]]:
        document = problem.scene.document()
        change(document)
        found = simulate(
            stochvi.Scene(**document), paths=problem.paths, duration=problem.duration, seed=seed,
            threads=1, speed_threshold=problem.speed_threshold,
        )  # fmt: skip
        names = {"displacement_mean", "displacement_std", "velocity_std", "collision_rate"}
        names |= {"impact_speed_rate", "impact_speed_square_rate"}
        return {
            name: (estimate.value, estimate.standard_error + (estimate.bias or 0.0))
            for (_, name), estimate in found.estimates().items()
            if name in names
        }

    return integrator


def linear_records(problem: Problem, seed: int, paths: int) -> dict[str, np.ndarray]:
    """Exact samples of the oscillator without stops, far enough apart to be nearly independent."""
    rng = np.random.default_rng(seed)
    h = 0.25 / problem.omega
    half, size = 0.5 * problem.damping_rate, problem.speed_scale
    turn = math.sqrt(problem.omega**2 - half**2)
    sine = math.sin(turn * h) / turn
    cosine = math.cos(turn * h)
    step = math.exp(-half * h) * np.array(
        [
            [cosine + half * sine, sine],
            [-(problem.omega**2) * sine, cosine - half * sine],
        ]
    )
    law = np.diag([size**2 / problem.omega**2, size**2])
    noise = np.linalg.cholesky(law - step @ law @ step.T)
    state = np.linalg.cholesky(law) @ rng.standard_normal((2, paths))
    record = np.empty((math.ceil(problem.duration / h), 2, paths))
    for sample in record:
        state = step @ state + noise @ rng.standard_normal((2, paths))
        sample[:] = state
    x, v = record.transpose(1, 2, 0)
    return {"displacement": x, "velocity": v}


def put_back(problem: Problem, seed: int) -> dict[str, np.ndarray]:
    """Semi-implicit Euler that puts the mass back onto the stop at the end of a step."""
    rng, h = np.random.default_rng(seed), 0.1 / problem.omega
    first, steps = math.ceil(problem.burn_in / h), math.ceil(problem.duration / h)
    x, v, sums = *np.zeros((2, problem.paths)), np.zeros((5, problem.paths))
    for step in range(first + steps):
        v = v - h * (problem.damping_rate * v + problem.omega**2 * x)
        v += math.sqrt(problem.intensity * h) * rng.standard_normal(problem.paths)
        x = x + h * v
        hit = (x < problem.lower) | (x > problem.upper)
        x, w = np.clip(x, problem.lower, problem.upper), np.where(hit, np.abs(v), 0.0)
        v = np.where(hit, -(problem.restitution or 0.0) * v, v)
        if step >= first:
            sums += x, x**2, v**2, w, w**2
    names = ("displacement_mean", "displacement_mean_square", "velocity_mean_square")
    rates = ("impact_speed_rate", "impact_speed_square_rate")
    return dict(zip(names, sums[:3] / steps, strict=True)) | dict(
        zip(rates, sums[3:] / (steps * h), strict=True)
    )


def test_a_right_integrator_passes() -> None:
    verdict = judge(engine(), FEW, seed=2)
    verdict.assert_passed()
    assert not verdict.hints
    assert {row.scene for row in verdict.findings} == set(FEW)
    assert "would have been seen" in verdict.summary()


def noise_doubled(document: dict) -> None:
    document["excitation"][0]["intensity"] *= 2.0


def damping_halved(document: dict) -> None:
    document["structure"]["damping"] *= 0.5


def restitution_squared(document: dict) -> None:
    for pair in document["impact_pair"]:
        pair["law"]["coefficient"] **= 2


def play(document: dict) -> None:
    for pair in document["impact_pair"]:
        pair["lower"], pair["upper"] = 2.0 * pair["lower"], 2.0 * pair["upper"]


def lossy(document: dict) -> None:
    for pair in document["impact_pair"]:
        pair["law"]["coefficient"] *= math.sqrt(0.98)


@pytest.mark.parametrize(
    ("change", "hint"),
    [
        (noise_doubled, "noise twice too strong"),
        (damping_halved, "half the damping"),
        (restitution_squared, "R^2 stands for R"),
        (play, "twice: the total play"),
        (lossy, "elastic stops take"),
    ],
)
def test_a_wrong_integrator_is_told_what_it_looks_like(change: Any, hint: str) -> None:
    verdict = judge(engine(change), FEW, seed=3)
    assert not verdict.passed
    assert any(hint in each for each in verdict.hints), verdict


def test_a_mass_put_back_at_the_end_of_the_step_fails_and_is_named() -> None:
    verdict = judge(put_back, ["elastic-half-sigma"], paths=256, relaxations=5.0)
    assert {"displacement_std", "velocity_std"} <= {row.quantity for row in verdict.failures}
    assert any("end of the step" in hint for hint in verdict.hints)
    with pytest.raises(AssertionError, match="looks like"):
        verdict.assert_passed()
    assert "should be 0.283882 (closed form)" in repr(verdict)


def test_a_bias_that_is_allowed_is_no_failure() -> None:
    assert judge(put_back, ["linear"], paths=128, relaxations=5.0, allowed_percent=5.0).passed


# The three forms of an answer -----------------------------------------------------------------


@pytest.mark.parametrize("paths", [64, 1])
def test_records_of_many_paths_and_of_one_pass_and_scaled_ones_fail(paths: int) -> None:
    def integrator(problem: Problem, seed: int, factor: float = 1.0) -> dict[str, np.ndarray]:
        found = linear_records(problem, seed, paths)
        return {name: factor * (each if paths > 1 else each[0]) for name, each in found.items()}

    asked: dict[str, Any] = {"paths": paths, "relaxations": 8.0 if paths > 1 else 400.0}
    assert judge(integrator, ["linear"], **asked).passed
    wrong = judge(lambda *task: integrator(*task, 1.3), ["linear"], **asked)
    assert {row.quantity for row in wrong.failures} == {"displacement_std", "velocity_std"}


def test_impacts_may_be_aligned_with_records_or_listed() -> None:
    problem = problem_of(zoo("lossy-0.5")["lossy-0.5"], paths=20, speed_threshold=0.05)
    rng = np.random.default_rng(0)
    speeds = np.where(rng.uniform(size=(20, 50)) < 0.2, rng.rayleigh(size=(20, 50)), 0.0)
    aligned = sample_of(problem, {"displacement": speeds, "impact_speed": -speeds})
    listed = sample_of(problem, {"impact_speed": [path[path > 0.0] for path in speeds]})
    for name in ("collision_rate", "impact_speed_rate", "impact_speed_square_rate"):
        one, two = (each.evaluate(lambda q, name=name: q[name]) for each in (aligned, listed))
        assert one == pytest.approx(two)
    expected = np.sum(speeds > 0.05) / 20 / problem.duration
    assert listed.evaluate(lambda q: q["collision_rate"])[0] == pytest.approx(expected)


def test_impacts_of_one_long_path_go_to_the_batch_of_their_time() -> None:
    problem = problem_of(zoo("linear")["linear"], relaxations=100.0)
    record = np.zeros(3200)
    times = problem.duration * (np.arange(64) + 0.5) / 64
    sample = sample_of(
        problem, {"displacement": record, "impact_speed": np.ones(64), "impact_time": times}
    )
    rate, error = sample.evaluate(lambda q: q["collision_rate"])
    assert (rate, error) == (pytest.approx(64 / problem.duration), pytest.approx(0.0, abs=1e-12))


def test_the_jackknife_gives_the_error_that_repetition_shows() -> None:
    rng = np.random.default_rng(1)
    found = []
    for _ in range(400):
        x = rng.standard_normal((2, 32))
        averages = {"displacement_mean": x[0], "displacement_mean_square": x[0] ** 2 + x[1] ** 2}
        found.append(PathAverages(averages).evaluate(lambda q: q["displacement_std"]))
    values, errors = np.array(found).T
    spread = values.std(ddof=1)
    # the error of a standard deviation of n values is 1 / sqrt(2 n) of it
    assert abs(errors.mean() - spread) < 4.5 * spread / math.sqrt(800.0)


def test_a_response_of_an_integrator_goes_into_a_comparison() -> None:
    scene = zoo("linear")["linear"]
    problem = problem_of(scene, name="linear", paths=64, relaxations=8.0)
    good = as_response(problem, linear_records(problem, 1, 64), "mine")
    assert good.cost.paths == 64
    assert compare([exact(scene), good]).passed
    bad = linear_records(problem, 1, 64) | {"velocity": np.ones((64, 10))}
    bad["velocity"][:, 0] = 2.0
    assert not compare([exact(scene), as_response(problem, bad)]).passed


# What is refused ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("returned", "sentence"),
    [
        ([1.0], "must return a dict"),
        ({}, "must return a dict"),
        ({"velocity_rms": (1.0, 0.1)}, "'velocity_rms', expected"),
        ({"velocity_std": (1.0, -0.1)}, "standard_error must be at least 0"),
        ({"velocity_mean_square": np.ones(3)}, "16 or more paths"),
        ({"velocity_std": 1.0}, r"a tuple \(value, standard error\)"),
        ({}, "got an empty dict"),
        ({"velocity_mean_square": np.ones(99), "velocity_std": (1.0, 0.1)}, "a mixture"),
        ({"displacement": np.ones(99)}, "raise relaxations to 96"),
        ({"displacement": np.ones((500, 64))}, r"\(64, samples\).*transposed, paths come first"),
        ({"velocity": np.ones((1, 500))}, "leave out the axis of length 1"),
        ({"velocity": np.ones((63, 500))}, r"velocity of shape \(63, 500\)"),
        ({"velocity": np.ones((64, 0))}, r"velocity of shape \(64, 0\)"),
        ({"velocity": np.ones((64, 5, 2))}, r"velocity of shape \(64, 5, 2\)"),
        ({"velocity": np.ones(10)}, "at least 32"),
        ({"velocity": np.zeros(0)}, r"velocity of shape \(0,\)"),
        ({"velocity": 1.0}, r"velocity of shape \(\)"),
        ({"velocity": np.ones((64, 5)) + 1j}, "velocity .* not of complex"),
        ({"velocity": [[1, 2], [3]] * 32}, "velocity .* row of the same length"),
        ({"velocity": "fast"}, "velocity of type str"),
        ({"velocity": np.ones((64, 5)), "collision_rate": np.ones(64)}, "together with records"),
        ({"velocity": np.ones((64, 9)), "displacement": np.ones(999)}, "of the same paths"),
        ({"impact_speed": [[1.0]] * 63}, "each of the 64 paths"),
        ({"impact_speed": [[1.0], ["fast"]] * 32}, "impact_speed of type list"),
        ({"impact_time": [1.0]}, "impact_time without impact_speed"),
        ({"velocity_std": np.ones(64)}, "per path give velocity_mean_square"),
        ({"displacement_std": np.ones(64)}, "per path give displacement_mean_square"),
        ({"velocity_std": (1.0, None)}, r"velocity_std = \(1.0, None\), expected"),
        ({"velocity_std": ("a", "b")}, "velocity_std = .* expected"),
        ({"velocity_std": (1.0, 0.0)}, "without a standard error"),
        ({"velocity_std": Estimate(value=1.0)}, "without a standard error"),
        ({"velocity_mean_square": (np.ones(64), np.ones(64))}, "velocity_mean_square = "),
    ],
)
def test_what_an_integrator_must_not_return_is_refused_in_a_sentence(
    returned: Any, sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        judge(lambda problem, seed: returned, ["linear"], paths=64)


@pytest.mark.parametrize(
    ("times", "sentence"),
    [
        ([-1.0, 2.0], "times count from the end of the burn-in of 120 s"),
        ([1.0, 4120.0], "expected 0 to 4000 s"),
        ([1.0, math.nan], "expected 0 to 4000 s"),
        ([1.0], "one time for each impact"),
        (["early", "late"], "impact_time of type list"),
    ],
)
def test_times_of_impacts_are_those_of_the_counted_path(times: list, sentence: str) -> None:
    problem = problem_of(zoo("linear")["linear"], paths=1, relaxations=200.0)
    returned = {"velocity": np.ones(9999), "impact_speed": [1.0, 2.0], "impact_time": times}
    with pytest.raises(ValueError, match=sentence):
        sample_of(problem, returned)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"paths": 0}, "paths must be a whole number of at least 1, got 0"),
        ({"paths": 1.5}, "paths must be a whole number"),
        ({"relaxations": 0.0}, "relaxations must be a positive number"),
        ({"relaxations": math.inf}, "relaxations must be a positive number"),
        ({"seed": -1}, "seed must be in"),
        ({"seed": 1.5}, "seed must be a whole number"),
    ],
)
def test_an_argument_of_judge_out_of_range_is_refused(
    arguments: dict[str, Any], sentence: str
) -> None:
    def untouched(problem: Problem, seed: int) -> dict[str, Any]:
        raise AssertionError("the integrator was asked")

    with pytest.raises(ValueError, match=sentence):
        judge(untouched, ["linear"], **arguments)


def test_a_scene_that_is_not_judged_is_found_out_before_any_is_solved(monkeypatch) -> None:
    def untouched(*_: Any) -> Any:
        raise AssertionError("a scene was solved, or the integrator asked")

    monkeypatch.setattr(reference_values, "exact", untouched)
    own = zoo("linear", "spring-stops")
    for scenes in (own, ["linear", "spring-stops"]):
        with pytest.raises(NotApplicable, match="stops must be rigid"):
            judge(untouched, scenes)


@pytest.mark.parametrize(
    ("value", "share", "verdict"),
    [
        (1.0, 0.01, "agrees"),
        (1.5, 0.3, "too uncertain to judge"),
        (1.0, 1e6, "too uncertain to judge"),
        (9.0, 0.3, "DISAGREES"),
    ],
)
def test_a_number_that_agrees_with_anything_is_no_pass(
    value: float, share: float, verdict: str
) -> None:
    def integrator(problem: Problem, seed: int) -> dict[str, tuple[float, float]]:
        size = problem.speed_scale
        return {
            "velocity_std": (value * size, share * size),
            "displacement_std": (size / problem.omega, 0.01 * size / problem.omega),
        }

    found = judge(integrator, ["linear"])
    (row,) = (each for each in found.findings if each.quantity == "velocity_std")
    assert row.verdict == verdict
    assert found.passed == (verdict == "agrees")
    if verdict == "too uncertain to judge":
        assert "raise paths or relaxations" in found.summary()
        assert verdict in repr(found)


def test_a_scene_without_rigid_stops_or_with_other_noise_is_refused() -> None:
    for name in ("filtered-linear", "spring-stops", "absorber-elastic", "sine-and-load"):
        with pytest.raises(NotApplicable):
            problem_of(zoo(name)[name])
    with pytest.raises(ValueError, match="one name 'linear'"):
        judge(engine(), "linear")


def test_what_a_quantity_needs_is_named_where_a_part_of_it_was_returned() -> None:
    squares = {"displacement_mean_square": np.full(64, 1.0)}
    (reason,) = judge(lambda problem, seed: squares, ["linear"]).left_out
    assert "displacement_std (which needs displacement_mean too)" in reason
    assert "velocity_std (" not in reason


def test_numbers_that_are_not_finite_are_a_failure_and_leave_a_valid_document() -> None:
    wild = {"velocity_mean_square": np.full(64, math.nan)}
    verdict = judge(lambda problem, seed: wild, ["linear"])
    assert not verdict.passed
    assert "beyond all bounds" in verdict.hints[0]
    document = json.loads(json.dumps(verdict.to_dict(), allow_nan=False))
    assert document["findings"][0]["value"] is None
    assert "displacement_std" in verdict.left_out[0]
    assert len(verdict.to_frame()) == 1
    assert "<table" in verdict._repr_html_()


def test_stops_that_were_forgotten_are_a_failure_though_nothing_was_seen() -> None:
    forgotten = engine(lambda document: document.pop("impact_pair"))

    def integrator(problem: Problem, seed: int) -> dict[str, tuple[float, float]]:
        return forgotten(problem, seed) | {"collision_rate": (0.0, 0.0)}

    verdict = judge(integrator, ["elastic-half-sigma"])
    assert "collision_rate" in {row.quantity for row in verdict.failures}


def test_scenes_of_ones_own_are_judged_by_the_methods_that_know_them() -> None:
    own = {"mine": zoo("lossy-unequal-gaps")["lossy-unequal-gaps"]}
    assert judge(engine(), own, seed=5).passed
