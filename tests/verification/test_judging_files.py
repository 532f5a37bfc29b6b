"""Problems as plain numbers, and the judge of what other programs write for them."""

import importlib
import json
import math
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

from stochvi.results.errors import NotApplicable
from stochvi.testing import Judgement, Problem, judge, judge_file, read_problem
from stochvi.verification.check import FAMILY_ALARM_RATE
from stochvi.verification.testing.documents import problem_document
from stochvi.verification.testing.files import problem_named
from stochvi.verification.testing.judging import judge_returned
from stochvi.verification.testing.reference_values import shipped_problems, solved, truths_of
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
    found.assert_outcomes(passed=3, failed=2)
    found.stdout.fnmatch_lines(["*looks like: *half the noise*", "*got float*"])


def test_pytest_finds_the_plugin_and_loads_nothing_heavy_for_it() -> None:
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))
    place = project["project"]["entry-points"]["pytest11"]["stochvi"]
    assert hasattr(importlib.import_module(place), "stochvi_judge")
    program = f"import sys, pytest, {place}\nprint(*sys.modules)"
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout.split()
    assert not {"numpy", "scipy", "pandas", "numba", "pydantic"} & set(found)
