"""`stochvi.testing`: right integrators pass, wrong ones fail and are told what it looks like."""

import importlib
import json
import math
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import solve_continuous_lyapunov
from scipy.stats import binom

import stochvi
from stochvi import NotApplicable, exact, simulate
from stochvi.results.estimates import Estimate
from stochvi.testing import (
    Judgement,
    Problem,
    as_response,
    judge,
    judge_file,
    known_answers,
    problem_of,
    read_problem,
)
from stochvi.verification import zoo
from stochvi.verification.check import FAMILY_ALARM_RATE, compare
from stochvi.verification.testing import problems
from stochvi.verification.testing.documents import problem_document, problem_named
from stochvi.verification.testing.judging import judge_returned
from stochvi.verification.testing.problems import (
    PathAverages,
    sample_of,
    shipped_problems,
    solved,
    truths_of,
)
from support import CHECKOUT
from support.accuracies import quick_cases
from support.commands import Run, one_document, refused
from support.integrators import (
    MOMENTS,
    Fault,
    Found,
    integrate,
    write_averages,
    write_records,
    write_rows,
    write_statistics,
)
from support.known import ELASTIC_STOPS, RIGID_STOPS
from support.refusals import refusals

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


def drawn(factor: float) -> Callable[[Problem, int], dict[str, np.ndarray]]:
    """Averages of independent paths without stops, whose noise is too strong by a factor."""

    def integrator(problem: Problem, seed: int) -> dict[str, np.ndarray]:
        size = factor * problem.speed_scale**2
        squares = np.random.default_rng(seed).gamma(8.0, size / 8.0, (2, problem.paths))
        return {
            "displacement_mean": np.zeros(problem.paths),
            "displacement_mean_square": squares[0] / problem.omega**2,
            "velocity_mean_square": squares[1],
        }

    return integrator


def test_an_error_that_must_be_found_is_found_or_more_paths_are_asked_for() -> None:
    few = judge(drawn(1.03), ["linear"], paths=300)
    assert few.passed and few.finds_percent is None
    few = judge(drawn(1.03), ["linear"], paths=300, finds_percent=1.5)
    assert not few.passed and not few.failures
    said = re.search(
        r"std of linear would miss an error of 1.5 %; raise paths .* by a factor of (\S+)$",
        few.summary(),
    )
    assert said is not None
    paths = math.ceil(310 * float(said[1]))
    found = [
        [judge(drawn(factor), ["linear"], paths=paths, seed=seed, finds_percent=1.5)
         for seed in range(40)] for factor in (1.0, 1.03)
    ]  # fmt: skip
    assert all(each.passed for each in found[0])
    # the mean square is off by 3 %, the deviation by 1.489 %
    assert binom.cdf(sum(bool(each.failures) for each in found[1]), 40, 0.95) > 1e-3
    few_hits = {"collision_rate": (0.0, 0.0), "velocity_std": (1.0, 1e-3)}
    rare = {"scenes": ["elastic-half-sigma"], "paths": 16, "relaxations": 0.01}
    seen = judge(lambda problem, seed: few_hits, **rare, finds_percent=50.0)
    assert not seen.failures and not seen.passed
    with pytest.raises(ValueError, match="finds_percent must be above allowed_percent"):
        judge(drawn(1.0), ["linear"], allowed_percent=2.0, finds_percent=1.0)


def test_noise_that_is_a_little_too_strong_is_named_beside_explicit_euler() -> None:
    strong, weak = (judge(drawn(factor), ["linear"], paths=20000) for factor in (1.1, 0.9))
    assert any(
        re.search("noise too strong or damping too weak by that factor; or explicit Euler", each)
        for each in strong.hints
    )
    assert any(
        each.endswith("noise too weak or damping too strong by that factor") for each in weak.hints
    )


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


test_what_an_integrator_must_not_return_is_refused_in_a_sentence = refusals(
    lambda returned: judge(lambda problem, seed: returned, ["linear"], paths=64),
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
    error=ValueError,
    pattern=True,
)


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
        ({"integrator": "mine.py"}, "integrator must be a function, got 'mine.py'"),
    ],
)
def test_an_argument_of_judge_out_of_range_is_refused(
    arguments: dict[str, Any], sentence: str
) -> None:
    def untouched(problem: Problem, seed: int) -> dict[str, Any]:
        raise AssertionError("the integrator was asked")

    with pytest.raises(ValueError, match=sentence):
        judge(**{"integrator": untouched, "scenes": ["linear"]} | arguments)


def test_a_scene_that_is_not_judged_is_found_out_before_any_is_solved(monkeypatch) -> None:
    def untouched(*_: Any) -> Any:
        raise AssertionError("a scene was solved, or the integrator asked")

    monkeypatch.setattr(problems, "exact", untouched)
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


# ------------------------------------------------------------------------------
# Problems as plain numbers, and the judge of what other programs write for them.
# ------------------------------------------------------------------------------


SMALL = {"paths": 1024, "relaxations": 5.0}


def document_of(name: str, **run: Any) -> dict[str, Any]:
    return json.loads(json.dumps(problem_document(*problem_named(name, **(SMALL | run)))))


def written(document: dict[str, Any], folder: Path) -> Path:
    path = folder / "problem.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


# Problems -----------------------------------------------------------------------------------------


def test_every_problem_survives_its_file(tmp_path: Path) -> None:
    problems = shipped_problems()
    assert len(problems) > 40
    for problem, answer in problems:
        again = read_problem(written(problem_document(problem, answer), tmp_path))
        for name in ("name", "burn_in", "duration", "paths", "speed_threshold", "start"):
            assert getattr(again, name) == getattr(problem, name)
        own, read = problem.model, again.model
        for name in ("mass", "damping", "stiffness", "white", "constant_force"):
            assert np.allclose(getattr(read, name), getattr(own, name), rtol=1e-14, atol=0.0)
        assert [stop.position for stop in read.stops] == [stop.position for stop in own.stops]
        assert [stop.restitution_at(1.0) for stop in read.stops] == [
            stop.restitution_at(1.0) for stop in own.stops
        ]
        for (one, force), (two, other) in zip(read.tables, own.tables, strict=True):
            assert one == two
            assert np.array_equal(force, other)


def test_the_command_writes_every_problem_with_an_index(stochvi: Run, tmp_path: Path) -> None:
    done = stochvi("problems", "--out", tmp_path, "--paths", "64", "--quiet")
    assert (done.code, done.out) == (0, "")
    index = pd.read_csv(tmp_path / "index.csv")
    for name in index["problem"]:
        document = json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8"))
        assert document["paths"] == 64
        assert set(document["answer"]) == {each["name"] for each in document["quantities"]}
        for quantity in document["quantities"]:
            assert quantity["unit"] and quantity["definition"]
    assert {"linear", "two-storeys-linear", "chain-two-pairs", "psd-truck-linear"} <= set(
        index["problem"]
    )
    told = (tmp_path / "README.txt").read_text(encoding="utf-8")
    assert "one-sided density per Hz" in " ".join(told.split())
    assert "two-storeys-linear" in stochvi("problems").out


def test_the_covariance_of_several_masses_is_that_of_the_lyapunov_equation() -> None:
    document = document_of("two-storeys-linear")
    mass, damping, stiffness = (
        np.array(document[name]) for name in ("mass", "damping", "stiffness")
    )
    (noise,) = document["noises"]
    assert noise["on"] == "base"
    push = np.concatenate([np.zeros(2), -np.ones(2)])  # the base pushes all masses alike
    states = np.block(
        [
            [np.zeros((2, 2)), np.eye(2)],
            [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)],
        ]
    )
    law = solve_continuous_lyapunov(states, -noise["intensity"] * np.outer(push, push))
    for place, name in enumerate(document["coordinates"]):
        for shift, quantity in ((0, "displacement_std"), (2, "velocity_std")):
            known = document["answer"][f"{name}.{quantity}"]["value"]
            assert known == pytest.approx(math.sqrt(law[place + shift, place + shift]), rel=1e-9)


def test_the_mean_square_under_tabulated_noise_is_that_of_a_sum_over_frequencies() -> None:
    document = document_of("psd-truck-linear")
    (noise,) = document["noises"]
    assert (noise["on"], noise["unit"]) == ("base", "(m/s^2)^2/Hz")
    points = np.log(noise["frequency_hz"])
    f = np.exp(np.linspace(points[0], points[-1], 400_001))
    density = np.exp(np.interp(np.log(f), points, np.log(noise["density"])))
    w = 2.0 * math.pi * f
    own = document
    squared = density / ((own["stiffness"] / own["mass"] - w**2) ** 2 + (own["damping"] * w) ** 2)
    for quantity, integrand in (("displacement_std", squared), ("velocity_std", w**2 * squared)):
        known = document["answer"][quantity]["value"]
        # the trapezoidal rule on logarithmic frequencies
        assert known**2 == pytest.approx(np.trapezoid(integrand * f, np.log(f)), rel=1e-6)


def test_a_changed_number_changes_the_answer(tmp_path: Path) -> None:
    document = document_of("linear")
    document["damping"], document["mass"] = 0.4, 2.0
    own, truth = problem_named(written(document, tmp_path))
    assert truths_of(own, truth)["velocity_std"].value == pytest.approx(
        math.sqrt(0.2 / (2.0 * 0.4 * 2.0))
    )


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda own: own.update(format="mine"), "format = 'stochvi problem 1'"),
        (lambda own: own.update(mass="heavy"), "problem.json: mass.*got"),
        (lambda own: own.update(colour=1), "problem.json: colour is not a known key"),
        (lambda own: own.pop("burn_in"), "problem.json: burn_in is missing"),
        (lambda own: own["noises"][0].update(unit="g2 s"), r"noises\.0\.unit must be 'N\^2 s'"),
        (lambda own: own["noises"][0].update(intensity=-1.0), "intensity must be greater than 0"),
        (lambda own: own["stops"][0].update(restitution=1.5), "restitution must be at most 1"),
        (lambda own: own["stops"][1].update(side="lower"), "at most one lower and one upper"),
        (lambda own: own.update(constant_force=[0.0, 1.0]), "each of the 1 coordinates, got 2"),
        (lambda own: own.update(speed_threshold=0.1), "speed_threshold must be 0"),
    ],
)
def test_a_problem_file_that_is_wrong_is_refused_in_a_sentence(
    change: Callable[[dict], Any], sentence: str, tmp_path: Path
) -> None:
    document = document_of("elastic-half-sigma")
    change(document)
    with pytest.raises(ValueError, match=sentence):
        problem_named(written(document, tmp_path))


def test_a_problem_whose_answer_nobody_knows_is_refused(tmp_path: Path) -> None:
    document = document_of("chain-two-pairs")
    document["stops"][0]["restitution"] = 0.5
    with pytest.raises(NotApplicable, match="no exact answer is known"):
        problem_named(written(document, tmp_path))


# Right integrators and wrong ones -----------------------------------------------------------------


@pytest.fixture(scope="module")
def right() -> Found:
    document = document_of("linear", paths=256, relaxations=10.0)
    return integrate(document, 0.1, seed=3, stride=10)


WRITERS = {"statistics": write_statistics, "averages": write_averages, "records": write_records}


@pytest.mark.parametrize("form", WRITERS)
def test_a_right_integrator_passes_in_every_form(
    form: str, right: Found, stochvi: Run, tmp_path: Path
) -> None:
    file = WRITERS[form](tmp_path / "mine.csv", right)
    done = stochvi("judge", file, "--problem", "linear", "--json", tmp_path / "verdict.json")
    assert done.code == 0, done.out
    document = one_document((tmp_path / "verdict.json").read_text(encoding="utf-8"))
    assert document["passed"]
    assert form in document["read_as"]
    assert {row["quantity"] for row in document["findings"]} == {
        "displacement_mean", "displacement_std", "velocity_std",
    }  # fmt: skip


@pytest.mark.parametrize("form", WRITERS)
def test_half_the_noise_fails_in_every_form_and_is_named(
    form: str, stochvi: Run, tmp_path: Path
) -> None:
    document = document_of("linear", paths=256, relaxations=5.0)
    found = integrate(document, 0.1, fault=Fault(noise=0.5), stride=10)
    file = WRITERS[form](tmp_path / "mine.csv", found)
    done = stochvi("judge", file, "--problem", "linear")
    assert done.code == 1
    assert "half the noise" in " ".join(done.out.split())


def judged(name: str, h: float, fault: Fault | None, folder: Path, **run: Any) -> Judgement:
    document = document_of(name, **run)
    found = integrate(document, h, seed=5, fault=fault)
    return judge_file(write_averages(folder / "mine.csv", found), written(document, folder))


@pytest.mark.parametrize(
    ("name", "h"), [("elastic-narrow", 0.02), ("lossy-unequal-restitutions", 0.05)]
)
def test_a_right_integrator_between_stops_passes(name: str, h: float, tmp_path: Path) -> None:
    verdict = judged(name, h, None, tmp_path, paths=128)
    assert verdict.passed, verdict
    assert {"collision_rate", "impact_speed_square_rate"} <= {
        row.quantity for row in verdict.findings
    }


@quick_cases(
    ("name", "h", "fault", "hint"),
    [
        ("lossy-unequal-restitutions", 0.05, Fault(exchanged=True), "restitutions.*exchanged"),
        ("elastic-half-sigma", 0.05, Fault(noise=0.5), "half the noise"),
        ("elastic-half-sigma", 0.05, Fault(damping=0.5), "half the damping"),
        ("elastic-narrow", 0.02, Fault(impact_energy=0.995), "elastic stops take"),
        ("linear", 0.1, Fault(burn_in=0.0), "leave out the burn-in"),
    ],
    keep=(0, 1, 4),
)
def test_a_known_fault_fails_and_is_named(
    name: str, h: float, fault: Fault, hint: str, tmp_path: Path
) -> None:
    paths = 2048 if fault.burn_in == 0.0 else 256
    verdict = judged(name, h, fault, tmp_path, paths=paths)
    assert not verdict.passed
    assert any(pd.Series(verdict.hints).str.contains(hint)), verdict


@pytest.mark.parametrize(
    ("factors", "hint"),
    [
        ((1e3, 1e3), "in mm where m is expected"),
        ((1.0, 100.0), "velocity_std of two-storeys-linear.*in cm"),
        ((1.0 / 9.80665, 1.0 / 9.80665), "9.81.2 times too weak"),
        ((9.80665, 9.80665), "9.81.2 times too strong"),
        ((math.sqrt(2.0), math.sqrt(2.0)), "twice too strong"),
        ((math.sqrt(2.0 * math.pi),) * 2, "2 pi times too strong"),
        ((math.sqrt(0.5 / math.pi),) * 2, "2 pi times too weak"),
    ],
)
def test_units_that_are_mixed_up_are_named(factors: tuple[float, float], hint: str) -> None:
    own, truth = problem_named("two-storeys-linear")
    returned = {
        name: (value.value * factor, 0.005 * value.value * factor)
        for name, value in truths_of(own, truth).items()
        for kind, factor in zip(("displacement_std", "velocity_std"), factors, strict=True)
        if name.endswith(kind)
    }
    verdict = judge_returned(own, truth, returned)
    assert not verdict.passed
    assert any(pd.Series(verdict.hints).str.contains(hint)), verdict


@pytest.mark.parametrize(
    ("name", "quantity", "factor", "hint"),
    [
        ("linear", "velocity_std", 2.0, "velocity_std of linear is 2 times .* factor of 2"),
        ("linear", "displacement_std", 0.5, "displacement_std of linear is 0.5 times"),
        ("two-storeys-linear", "second.velocity_std", 2.0 * math.pi, "second.* factor of 2 pi"),
        ("elastic-half-sigma", "collision_rate", 0.5 / math.pi, "collision_rate.* factor of 2 pi"),
        ("elastic-half-sigma", "collision_rate", 0.5, "only one of two stops is counted"),
        ("elastic-half-sigma", "impact_speed_square_rate", 1e6, "in mm where m is expected"),
        ("lossy-0.5", "displacement_std", 9.80665, "multiplied by g"),
        ("elastic-bench-12-hz", "velocity_std", None, "the square stands there"),
    ],
)
def test_one_quantity_that_is_off_by_a_known_factor_is_named(
    name: str, quantity: str, factor: float | None, hint: str
) -> None:
    own, truth = problem_named(name)
    truths = truths_of(own, truth)
    returned = {
        each: ((factor or right.value) if each == quantity else 1.0) * right.value
        for each, right in truths.items()
        if right.value
    }
    verdict = judge_returned(
        own, truth, {each: (value, 0.003 * abs(value)) for each, value in returned.items()}
    )
    assert {row.quantity for row in verdict.failures} == {quantity}
    assert any(pd.Series(verdict.hints).str.contains(hint)), verdict


@pytest.mark.parametrize("factor", [2.0 * math.pi, 0.5 / math.pi])
def test_hertz_taken_for_radians_per_second_is_named(factor: float) -> None:
    own, truth = problem_named("linear")
    returned = {"displacement_std": (factor, 0.005 * factor), "velocity_std": (1.0, 0.005)}
    (hint,) = judge_returned(own, truth, returned).hints
    assert "Hz" in hint


def test_noise_of_a_table_and_several_masses_are_judged_by_a_function_too() -> None:
    def right(problem: Any, seed: int) -> dict[str, tuple[float, float]]:
        rng = np.random.default_rng(seed)
        truths = truths_of(problem, solved(problem.scene))
        return {
            name: (truth.value * (1.0 + 0.01 * rng.standard_normal()), 0.01 * abs(truth.value))
            for name, truth in truths.items()
            if not name.endswith("mean")
        }

    names = ["two-storeys-linear", "psd-truck-linear", "chain-two-pairs"]
    assert judge(right, names).passed
    wrong = judge(lambda *task: {n: (1.1 * v, e) for n, (v, e) in right(*task).items()}, names)
    assert {row.scene for row in wrong.failures} == set(names)


def two_storeys(problem: Problem, seed: int, burn_in: bool = True) -> dict[str, np.ndarray]:
    """Semi-implicit steps of several masses in white noise, from rest."""
    model, rng, h = problem.model, np.random.default_rng(seed), 0.1
    count, paths = len(model.coordinates), problem.paths
    inverse = np.linalg.inv(model.mass)
    kick = inverse @ np.linalg.cholesky(h * model.white + 1e-15 * np.eye(count))
    x, v = np.zeros((2, count, paths))
    first, steps = round(burn_in * problem.burn_in / h), round(problem.duration / h)
    sums = np.zeros((3, count, paths))
    for step in range(first + steps):
        v = v - 0.5 * h * inverse @ model.stiffness @ x
        x = x + 0.5 * h * v
        v = v - h * inverse @ model.damping @ v + kick @ rng.standard_normal((count, paths))
        x = x + 0.5 * h * v
        v = v - 0.5 * h * inverse @ model.stiffness @ x
        if step >= first:
            sums += x, x**2, v**2
    return {
        f"{owner}.{name}": sums[k, place] / steps
        for place, owner in enumerate(model.coordinates)
        for k, name in enumerate(MOMENTS)
    }


def test_an_integrator_of_several_masses_passes_and_one_without_burn_in_is_named() -> None:
    assert judge(two_storeys, ["two-storeys-linear"], paths=256, relaxations=5.0).passed
    wrong = judge(
        lambda *task: two_storeys(*task, burn_in=False),
        ["two-storeys-linear"], paths=1024, relaxations=5.0,
    )  # fmt: skip
    assert not wrong.passed
    assert "leave out the burn-in" in wrong.hints[0]


def cosines(problem: Problem, seed: int, factor: float = 1.0) -> dict[str, np.ndarray]:
    """Records of an oscillator whose base is moved by a sum of cosines with random phases."""
    ((table, _),) = problem.model.tables
    rng, h = np.random.default_rng(seed), 1.0 / (2.5 * table.frequency_hz[-1])
    samples = 2 * math.ceil(problem.duration / h / 2)
    f = np.fft.rfftfreq(samples, h)
    density = np.zeros_like(f)
    density[1:] = factor * table(f[1:])
    shape = (problem.paths, len(f))
    # each line has the variance density * df: coefficients of irfft are samples / 2 times cosines
    lines = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
    lines *= np.sqrt(density / (samples * h)) * samples / 2.0
    w = 2.0 * math.pi * f
    lines /= problem.omega**2 - w**2 + 1j * problem.damping_rate * w
    return {
        "displacement": np.fft.irfft(-lines, samples),
        "velocity": np.fft.irfft(-1j * w * lines, samples),
    }


def test_an_integrator_under_a_tabulated_density_passes_and_a_two_sided_one_is_named() -> None:
    asked: dict[str, Any] = {"paths": 128, "relaxations": 10.0}
    assert judge(cosines, ["psd-truck-linear"], **asked).passed
    wrong = judge(lambda *task: cosines(*task, 0.5), ["psd-truck-linear"], **asked)
    assert "half the noise" in wrong.hints[0]


@pytest.mark.verify
def test_right_integrators_between_stops_are_refused_as_rarely_as_stated() -> None:
    seeds, paths = 200, 64
    document = document_of("elastic-half-sigma", paths=seeds * paths, relaxations=20.0)
    found = integrate(document, 0.02, seed=4)
    own, truth = problem_named("elastic-half-sigma", paths=paths)
    alarms = sum(
        bool(judge_returned(own, truth, dict(zip(found.averages, each, strict=True))).failures)
        for each in np.array(list(found.averages.values())).reshape(6, seeds, paths).swapaxes(0, 1)
    )
    assert alarms <= binom.isf(1e-4, seeds, FAMILY_ALARM_RATE)


@pytest.mark.parametrize("paths", [64, pytest.param(1024, marks=pytest.mark.verify)])
def test_right_integrators_are_refused_as_rarely_as_stated(paths: int) -> None:
    seeds = 200
    own, truth = problem_named("linear", paths=paths)
    rng = np.random.default_rng(7)
    # exact steps of an oscillator of omega = 1 and b = .1 with the variance 1, from its own law
    h, half = 0.5, 0.05
    turn = math.sqrt(1.0 - half**2)
    sine, cosine = math.sin(turn * h) / turn, math.cos(turn * h)
    step = math.exp(-half * h) * np.array(
        [[cosine + half * sine, sine], [-sine, cosine - half * sine]]
    )
    noise = np.linalg.cholesky(np.eye(2) - step @ step.T)
    state = rng.standard_normal((2, seeds * paths))
    steps = round(own.duration / h)
    sums = np.zeros((3, seeds * paths))
    for _ in range(steps):
        state = step @ state + noise @ rng.standard_normal(state.shape)
        sums += state[0], state[0] ** 2, state[1] ** 2
    averages = (sums / steps).reshape(3, seeds, paths)
    alarms = sum(
        bool(judge_returned(own, truth, dict(zip(MOMENTS, averages[:, k], strict=True))).failures)
        for k in range(seeds)
    )
    # more alarms than this are seen once in ten thousand runs of this test
    assert alarms <= binom.isf(1e-4, seeds, FAMILY_ALARM_RATE)


# What is refused ----------------------------------------------------------------------------------

GOOD = "quantity,value,standard_error\nvelocity_std,1.0,0.01\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (GOOD.replace("0.01", "0"), ("row 2", "standard_error", "above 0")),
        (GOOD.replace("0.01", "-0.01"), ("row 2", "standard_error", "-0.01")),
        (GOOD.replace("0.01", "nan"), ("row 2", "standard_error", "nan")),
        (GOOD.replace("0.01", ""), ("row 2", "standard_error", "expected a number")),
        (GOOD.replace("1.0,", "fast,"), ("row 2", "column value", "'fast'")),
        (GOOD.replace("1.0,", "inf,"), ("row 2", "column value", "finite")),
        (GOOD.replace("velocity_std", "velocity_rms"), ("row 2", "velocity_std", "velocity_rms")),
        (GOOD + "velocity_std,1.0,0.01\n", ("row 3", "twice")),
        (GOOD + "velocity_std,1,0,0,01\n", ("row 3", "3 columns", "got 5", "point")),
        ("quantity,value\nvelocity_std,1.0\n", ("header", "standard_error")),
        ("velocity_mean_square\n" + "1.0\n" * 15, ("16", "got 15")),
        ("velocity_std\n" + "1.0\n" * 20, ("velocity_std", "velocity_mean_square")),
        ("velocity_mean_square\n" + "1.0\n" * 19 + "one\n", ("row 21", "'one'")),
        ("speed\n1.0\n", ("header", "quantity, value, standard_error", "got speed")),
        ("velocity_mean_square\n", ("header", "at least one row")),
        ("", ("header", "at least one row")),
        ("time,x\n0,0\n1,0\n2,0\n4,0\n", ("row 5", "equal steps")),
        ("time,x\n0,0\n1,0\n2,0\n", ("end at 2 s", "burn-in lasts 120 s")),
        ("time,y\n0,0\n1,0\n", ("header", "'y'")),
        ("time,x\n200,0\n201,0\n202,0\n", ("1920 s or more", "got 3 s")),
        ("time,path,x\n200,1,0\n201,1,0\n200,2,0\n", ("same times", "got 1 rows", "and 2")),
        ("time,time\n0,0\n", ("header", "twice")),
        (GOOD.replace("_std", "_mean_square"), ("row 2", "give its root, velocity_std")),
        (GOOD + "# a comment\n\ndisplacement_std,1.0,-1\n", ("row 5", "standard_error")),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_judged_is_refused_by_row_and_column(
    text: str, words: tuple[str, ...], stochvi: Run, tmp_path: Path
) -> None:
    file = tmp_path / "mine.csv"
    file.write_text(text, encoding="utf-8")
    sentence = refused(stochvi("judge", file, "--problem", "linear"))
    for word in ("mine.csv", *words):
        assert word in sentence


def test_a_name_is_the_problem_though_a_program_is_called_the_same(
    stochvi: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "linear").write_bytes(b"\x7fELF\x80")
    (tmp_path / "mine.csv").write_text(GOOD, encoding="utf-8")
    assert stochvi("judge", "mine.csv", "--problem", "linear").code == 0
    assert "linear is not text" in refused(stochvi("judge", "mine.csv", "--problem", "./linear"))


def test_a_problem_that_is_not_there_is_refused(stochvi: Run, tmp_path: Path) -> None:
    file = tmp_path / "mine.csv"
    file.write_text(GOOD, encoding="utf-8")
    assert "did you mean 'linear'" in refused(stochvi("judge", file, "--problem", "liner"))
    assert "rigid" in refused(stochvi("judge", file, "--problem", "spring-stops"))
    refused(stochvi("judge", file, "--problem", tmp_path / "nothing.json"))
    refused(stochvi("judge", tmp_path / "nothing.csv", "--problem", "linear"))
    assert "--allowed" in refused(stochvi("judge", file, "--problem", "linear", "--allowed", "200"))


@pytest.mark.parametrize(
    "text",
    [GOOD, "\ufeff# mine\n\n" + GOOD.replace(",", ";").replace(".", ","), GOOD.replace(",", "\t")],
)
def test_separators_comments_and_byte_order_marks_are_read(text: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.csv"
    file.write_text(text, encoding="utf-8")
    assert judge_file(file, "linear").passed


def test_a_stated_bias_is_granted_and_a_large_one_is_no_pass(tmp_path: Path) -> None:
    def verdict(bias: float) -> Judgement:
        row = ("velocity_std", 1.05, 0.001, bias)
        header = ("quantity", "value", "standard_error", "bias")
        return judge_file(write_rows(tmp_path / "mine.csv", header, [row]), "linear")

    assert verdict(0.0).failures
    assert verdict(0.06).passed
    assert not verdict(0.5).passed
    assert verdict(0.5).uncertain


def test_impacts_in_records_are_rates_over_the_time_that_was_kept(tmp_path: Path) -> None:
    own, _ = problem_named("elastic-half-sigma")
    times = np.arange(0.0, own.burn_in + 50.0, 0.5)
    rows = [(path, time, 0.1, 1.0, 2.0) for path in range(16) for time in times]
    header = ("path", "time", "x", "v", "impact_speed")
    found = judge_file(write_rows(tmp_path / "mine.csv", header, rows), "elastic-half-sigma")
    values = {row.quantity: row.value for row in found.findings}
    assert values["collision_rate"] == pytest.approx(2.0)
    assert values["impact_speed_square_rate"] == pytest.approx(8.0)


# In C and under pytest ----------------------------------------------------------------------------


@pytest.mark.verify
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize(("intensity", "code"), [("0.2", 0), ("0.1", 1)])
def test_a_program_in_c_is_judged(intensity: str, code: int, stochvi: Run, tmp_path: Path) -> None:
    source = CHECKOUT / "studies" / "10_judging_integrators" / "linear.c"
    program, file = tmp_path / "linear", tmp_path / "linear.csv"
    subprocess.run(["cc", "-O2", str(source), "-lm", "-o", str(program)], check=True)
    with file.open("w") as out:
        subprocess.run([str(program), intensity], stdout=out, check=True)
    assert stochvi("judge", file, "--problem", "linear").code == code


SUITE = """
import pandas as pd

RIGHT = pd.DataFrame({"quantity": ["velocity_std"], "value": [1.0], "standard_error": [0.01]})

def test_frame(stochvi_judge):
    assert stochvi_judge("linear", RIGHT).passed

def test_function(stochvi_judge):
    stochvi_judge("linear", lambda problem, seed: {"velocity_std": (problem.speed_scale, 0.01)})

def test_file(stochvi_judge, tmp_path):
    RIGHT.to_csv(tmp_path / "mine.csv", index=False)
    stochvi_judge("linear", tmp_path / "mine.csv")

def test_blunt(stochvi_judge):
    stochvi_judge("linear", RIGHT, finds_percent=1.0)

def test_wrong(stochvi_judge):
    stochvi_judge("linear", RIGHT.assign(value=2.0 ** -0.5))

def test_unknown(stochvi_judge):
    stochvi_judge("linear", 3.0)
"""


def test_the_fixture_judges_a_suite_of_ones_own(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    pytester.makepyfile(SUITE)
    found = pytester.runpytest_inprocess("-p", "stochvi.verification.testing.plugin")
    found.assert_outcomes(passed=3, failed=3)
    found.stdout.fnmatch_lines(
        ["*would miss an error of 1 %*", "*looks like: *half the noise*", "*got float*"]
    )


def test_pytest_finds_the_plugin_and_loads_nothing_heavy_for_it() -> None:
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))
    place = project["project"]["entry-points"]["pytest11"]["stochvi"]
    assert hasattr(importlib.import_module(place), "stochvi_judge")
    program = f"import sys, pytest, {place}\nprint(*sys.modules)"
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout.split()
    assert not {"numpy", "scipy", "pandas", "numba", "pydantic"} & set(found)
