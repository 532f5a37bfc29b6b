"""Laws of stops from synthetic tests: numbers come back within their errors, or are not told."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom, t

import stochvi
from stochvi import PowerLaw, identify
from stochvi.identification import DropRecord, ForceCurve, Identification, Rebounds, read_test
from stochvi.identification.fitting import DAMPED, RIGID, Errors, fit
from stochvi.results.errors import SceneError
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.scenes.impact_laws.rigid import (
    hunt_crossley_restitution,
    viscoelastic_restitution,
    yielding_restitution,
)
from stochvi.scenes.scene import scene_from
from support.drops import G, contact, force, record, restitution
from support.refusals import refusals

SPEEDS = np.geomspace(0.1, 4.0, 24)
CASES = pytest.mark.parametrize("cases", [30, pytest.param(400, marks=pytest.mark.verify)])
"""Number of repetitions of a test of errors, in `make test` and in `make verify`."""


def within(found: Identification, name: str, truth: float, *, law: str | None = None) -> bool:
    """Whether the 95 % interval of a number of a law holds the truth."""
    each = found.fits[law or found.chosen].numbers[name]
    low, high = each.interval()
    return low <= truth <= high


def coverage(held: list[bool], least: float = 0.95) -> None:
    """Intervals of 95 % hold the truth in 95 % of the cases, or in `least` to 95 % of them."""
    low = binom.ppf(0.5e-4, len(held), least)
    assert low <= sum(held) <= binom.ppf(1.0 - 0.5e-4, len(held), 0.95)


def covered(cases: int, one: Callable[[np.random.Generator], bool]) -> list[bool]:
    return [one(np.random.default_rng(seed)) for seed in range(cases)]


# ---- rebounds -------------------------------------------------------------------------------


def rebounds(random: np.random.Generator, R: np.ndarray, scatter: float = 0.01) -> Rebounds:
    return Rebounds(approach=SPEEDS, rebound=SPEEDS * (R + scatter * random.normal(size=len(R))))


@pytest.mark.slow
@CASES
def test_a_constant_restitution_comes_back_within_its_error(cases: int) -> None:
    truth = np.full(len(SPEEDS), 0.7)
    held = covered(cases, lambda r: within(identify(rebounds(r, truth)), "R", 0.7, law="constant"))
    coverage(held)
    wrong = covered(
        cases, lambda r: within(identify(rebounds(r, truth)), "R", 0.71, law="constant")
    )
    with pytest.raises(AssertionError):  # the negative control: off by five standard errors
        coverage(wrong)


@CASES
def test_a_law_that_is_true_is_rejected_as_often_as_stated(cases: int) -> None:
    truth = np.full(len(SPEEDS), 0.7)
    rejected = covered(cases, lambda r: identify(rebounds(r, truth)).chosen != "constant")
    assert sum(rejected) <= binom.ppf(0.9999, cases, 0.05)


@pytest.mark.slow
@CASES
def test_a_viscoelastic_body_is_told_from_a_constant_restitution(cases: int) -> None:
    k, mass, c = 1e8, 0.05, 6e3
    true = np.array([restitution(k, 1.5, c, 0.5, mass=mass, speed=w) for w in SPEEDS])
    b = c / k * (k / mass) ** 0.4

    def one(random: np.random.Generator) -> bool:
        found = identify(rebounds(random, true, 0.002))
        assert found.chosen == "viscoelastic body"
        assert found.fits["constant"].rejected < 1e-6
        return within(found, "b", b)

    coverage(covered(cases, one))
    assert np.abs(true - viscoelastic_restitution(b * SPEEDS**0.2)).max() < 2e-4


def test_the_restitution_of_hunt_and_crossley_is_that_of_a_contact() -> None:
    for speed in (0.1, 0.7, 3.0):
        R = restitution(1e6, 1.3, 4e5, 1.3, mass=0.4, speed=speed)
        assert float(hunt_crossley_restitution(0.4 * speed)) == pytest.approx(R, abs=1e-4)
    near = hunt_crossley_restitution([0.99e-4, 1.01e-4])
    assert near[0] - near[1] == pytest.approx(2.0 / 3.0 * 0.02e-4, rel=1e-2)


def test_bodies_that_yield_or_lose_with_the_speed_are_told() -> None:
    random = np.random.default_rng(2)
    found = identify(rebounds(random, 0.9 * (SPEEDS / 0.1) ** -0.25, 0.003))
    assert found.chosen == "yielding body"
    assert within(found, "w_y", 0.1 * 0.9**4)
    found = identify(rebounds(random, hunt_crossley_restitution(0.2 * SPEEDS), 0.003))
    assert found.chosen == "Hunt and Crossley" and within(found, "a", 0.2)
    assert 'body = "hunt-crossley"' in found.line
    assert "methods for a constant restitution take" in found.warnings[-1]


# ---- times ---------------------------------------------------------------------------------


def impacts_of(random: np.random.Generator, scatter: float, timing: float) -> Rebounds:
    height = 0.2
    speed, times = np.sqrt(2.0 * G * height), [0.0]
    for _ in range(8):
        speed *= 0.8 + scatter * random.normal()
        times.append(times[-1] + 2.0 * speed / G)
    seen = np.array(times) + timing * random.normal(size=len(times))
    return Rebounds.of_times(seen, height=height, timing_error=timing)


@pytest.mark.slow
@CASES
@pytest.mark.parametrize(("scatter", "timing"), [(0.02, 0.0), (0.001, 2e-3), (0.02, 2e-3)])
def test_the_times_of_times_give_the_restitution_within_its_error(
    scatter: float, timing: float, cases: int
) -> None:
    def one(random: np.random.Generator) -> bool:
        return within(identify(impacts_of(random, scatter, timing)), "R", 0.8, law="constant")

    coverage(covered(cases, one), 0.9)  # the weights of eight ratios are themselves estimated


def test_the_errors_of_neighbouring_ratios_are_those_of_their_times() -> None:
    """The covariance that of_times states, against that of many repetitions."""
    seen = np.array([impacts_of(np.random.default_rng(n), 0.0, 1e-3).observed for n in range(4000)])
    stated = impacts_of(np.random.default_rng(0), 0.0, 1e-3).known_errors
    assert stated is not None
    found = np.cov(seen.T)
    size = np.sqrt(np.outer(np.diag(found), np.diag(found)))
    assert np.abs(stated - found).max() < 0.08 * size.max()
    assert stated[0, 1] < 0.0


# ---- forces over deflections ----------------------------------------------------------------


def pressed(random: np.random.Generator, exponent: float = 1.5, correlated: float = 0.0):
    y = np.linspace(1e-4, 4e-3, 60)
    noise = random.normal(size=60)
    for n in range(1, 60):
        noise[n] = correlated * noise[n - 1] + np.sqrt(1.0 - correlated**2) * noise[n]
    return ForceCurve(deflection=y, force=2e6 * y**exponent + 6.0 * noise)


@CASES
@pytest.mark.parametrize("correlated", [0.0, 0.5])
def test_a_slow_press_gives_the_stiffness_within_its_error(correlated: float, cases: int) -> None:
    held = covered(
        cases, lambda r: within(identify(pressed(r, correlated=correlated)), "k", 2e6, law="Hertz")
    )
    # the correlation of 60 residuals is estimated a little too low
    coverage(held, 0.95 if correlated == 0.0 else 0.88)


def test_the_exponent_of_a_press_is_told() -> None:
    found = identify(pressed(np.random.default_rng(1), 1.8))
    assert found.chosen == "power" and within(found, "n", 1.8)
    assert found.fits["Hertz"].rejected < 1e-4
    assert "shows no loss" in " ".join(found.warnings)
    hertz = identify(pressed(np.random.default_rng(1)))
    assert hertz.chosen == "Hertz" and "does not carry a further number" in hertz.warnings[0]
    assert hertz.line.startswith('law = { kind = "hertz", coefficient = ')


def test_a_fast_press_gives_the_damping() -> None:
    t, y, v = contact(5e5, 1.0, 400.0, 0.0, mass=3.0, speed=1.1)
    keep = slice(len(t) // 80, len(t) - 1, len(t) // 80)
    y, v = y[keep], v[keep]
    clean = np.array([force(a, b, 5e5, 1.0, 400.0, 0.0) for a, b in zip(y, v, strict=True)])
    random = np.random.default_rng(3)
    test = ForceCurve(
        deflection=y, force=clean + 10.0 * random.normal(size=len(y)), speed=v, mass=3.0
    )
    found = identify(test)
    assert found.chosen == "Kelvin-Voigt"
    assert within(found, "k", 5e5) and within(found, "c", 400.0)
    assert isinstance(found.law, stochvi.Viscoelastic)
    assert found.law.damping_ratio == pytest.approx(400.0 / 2.0 / np.sqrt(5e5 * 3.0), rel=0.05)
    without = identify(ForceCurve(deflection=y, force=test.force, speed=v))
    assert isinstance(without.law, PowerLaw) and "damping ratio" in without.warnings[-1]


# ---- drops ----------------------------------------------------------------------------------

DROPS = {
    "Kelvin-Voigt": (1.2e6, 1.0, 300.0, 0.0),
    "Hunt and Crossley": (3e7, 1.5, 1e7, 1.5),
    "viscoelastic body": (3e7, 1.5, 3e4, 0.5),
}


@pytest.mark.slow
@pytest.mark.parametrize("law", DROPS)
def test_the_record_of_a_drop_tells_the_law_and_its_numbers(law: str) -> None:
    k, n, c, m = DROPS[law]
    clean = record(k, n, c, m, mass=2.3, speed=1.4, fs=10e3)
    random = np.random.default_rng(1)
    test = DropRecord(
        acceleration=2.0 - clean - 4.0 * random.normal(size=len(clean)), fs=10e3, mass=2.3
    )
    found = identify(test)
    assert found.chosen == law
    for name, truth in (("k", k), ("c", c)):
        each = found.best.numbers[name]
        assert abs(each.value - truth) < 4.0 * each.standard_error
        assert each.standard_error < 0.2 * truth
    speed = found.of_test["speed"]
    assert abs(speed.value - 1.4) < 4.0 * speed.standard_error
    assert found.loop is not None
    _, deep, _ = contact(k, n, c, m, mass=2.3, speed=1.4, gravity=G)
    assert found.loop["deflection"].max() == pytest.approx(deep.max(), rel=0.02)


def kelvin_voigt(**keys: Any) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and damping (and the speed) of the record of a drop, with their errors."""
    (candidate,) = (each for each in DAMPED if each.name == "Kelvin-Voigt")
    found = fit(candidate, DropRecord(mass=2.3, **keys), Errors(None, ordered=True))
    numbers = candidate.numbers(found.numbers[:2], found.test.scale)
    return np.array([*numbers.values()]), found.standard_errors()[:2]


def test_gravity_counts_in_a_drop() -> None:
    """A soft stop: without the weight the stiffness is off by many errors."""
    clean = record(4e4, 1.0, 60.0, 0.0, mass=2.3, speed=0.5, fs=5e3)
    seen = clean + 0.02 * np.random.default_rng(5).normal(size=len(clean))
    found, errors = kelvin_voigt(acceleration=seen, fs=5e3)
    assert np.all(np.abs(found - [4e4, 60.0]) < 4.0 * errors)
    wrong, _ = kelvin_voigt(acceleration=seen, fs=5e3, gravity=0.0)
    assert abs(wrong[0] - 4e4) > 8.0 * errors[0]


@pytest.mark.slow
def test_a_known_height_leaves_a_number_less() -> None:
    clean = record(1.2e6, 1.0, 300.0, 0.0, mass=2.3, speed=np.sqrt(2.0 * G * 0.1), fs=10e3)
    seen = clean + 4.0 * np.random.default_rng(5).normal(size=len(clean))
    (_, free), (found, held) = (
        kelvin_voigt(acceleration=seen, fs=10e3, height=height) for height in (None, 0.1)
    )
    assert np.all(np.abs(found - [1.2e6, 300.0]) < 4.0 * held)
    assert np.all(held < free)
    wrong, _ = kelvin_voigt(acceleration=seen, fs=10e3, height=0.12)
    assert np.any(np.abs(wrong - [1.2e6, 300.0]) > 8.0 * held)


# ---- what is told, and refused ----------------------------------------------------------------


@pytest.mark.slow
def test_the_line_is_one_of_a_scene_file() -> None:
    random = np.random.default_rng(5)
    clean = record(3e7, 1.5, 1e7, 1.5, mass=2.3, speed=1.4, fs=10e3)
    tests = [
        rebounds(random, np.full(len(SPEEDS), 0.7)),
        pressed(random, 1.8),
        DropRecord(acceleration=clean + 4.0 * random.normal(size=len(clean)), fs=10e3, mass=2.3),
    ]
    for test in tests:
        found = identify(test)
        scene = scene_from({
            "structure": {"kind": "isolator", "mass": 2.3, "frequency_hz": 10.0, "zeta": 0.1},
            "impact_pair": [{"clearance": 0.01, **tomllib.loads(found.line)}],
            "excitation": [{"kind": "white", "density": 0.01, "unit": "g2/Hz"}],
        })  # fmt: skip
        law = scene.impact_pairs[0].law
        assert type(law) is type(found.law)
        if isinstance(found.law, CompliantLaw):
            assert law.force_at(2e-3, 0.5) == pytest.approx(found.law.force_at(2e-3, 0.5), rel=2e-3)


def test_few_observations_carry_few_numbers() -> None:
    found = identify(Rebounds(approach=[1.0, 2.0, 3.0], rebound=[0.7, 1.41, 2.08]))
    assert "power of the speed" not in found.fits
    assert "do not carry the numbers of power of the speed" in " ".join(found.warnings)
    one_speed = identify(Rebounds(approach=np.ones(9), rebound=0.7 + 0.01 * np.arange(9)))
    assert "power of the speed" not in one_speed.fits and one_speed.chosen == "constant"
    assert "does not tell constant from" in one_speed.warnings[0]
    two = identify(Rebounds(approach=[1.0, 2.0], rebound=[0.7, 1.41]))
    assert list(two.fits) == ["constant"] and "which was not fitted" in two.warnings[0]
    with pytest.raises(ValueError, match="test must have at least 2 observations, got 1"):
        identify(Rebounds(approach=[1.0], rebound=[0.7]))


@pytest.mark.parametrize("rows", [2, 3, 4, 6])
def test_the_interval_of_few_rebounds_is_that_of_student(rows: int) -> None:
    """A constant restitution is the mean of the ratios."""
    random = np.random.default_rng(rows)
    R = 0.7 + 0.02 * random.normal(size=rows)
    speeds = np.geomspace(0.5, 2.0, rows)
    found = identify(Rebounds(approach=speeds, rebound=R * speeds)).fits["constant"].numbers["R"]
    error = R.std(ddof=1) / np.sqrt(rows)
    low, high = t.interval(0.95, rows - 1, loc=R.mean(), scale=error)
    assert found.interval() == pytest.approx((low, high), rel=1e-4)
    # the control: a normal interval is narrower
    assert high - low > 1.2 * 2.0 * 1.96 * error


FEW = {
    "constant": (lambda w: 0.7 + 0.0 * w, [0.7]),
    "viscoelastic body": (lambda w: viscoelastic_restitution(0.25 * w**0.2), [0.25]),
    "Hunt and Crossley": (lambda w: hunt_crossley_restitution(0.3 * w), [0.3]),
    "yielding body": (lambda w: yielding_restitution(w / 0.1), [0.1]),
    "power of the speed": (lambda w: 0.7 * (w / np.exp(np.log(w).mean())) ** -0.1, [0.7, -0.1]),
}
"""Restitutions over the speed, and the numbers of their laws."""


@pytest.mark.slow
@pytest.mark.parametrize("law", FEW)
@pytest.mark.parametrize(
    ("rows", "cases"),
    [(3, 60), *(pytest.param(n, 200, marks=pytest.mark.verify) for n in (3, 4, 5, 8))],
)
def test_intervals_of_few_rows_hold_as_often_as_they_say(law: str, rows: int, cases: int) -> None:
    candidate = next(each for each in RIGID if each.name == law)
    curve, truth = FEW[law]
    speeds = np.geomspace(0.3, 3.0, rows)

    def one(random: np.random.Generator) -> np.ndarray:
        R = np.clip(curve(speeds) + 0.01 * random.normal(size=rows), 0.01, 1.0)
        found = fit(candidate, Rebounds(approach=speeds, rebound=R * speeds), Errors(None, False))
        values = list(candidate.numbers(found.numbers[: found.own], found.test.scale).values())
        return np.abs(np.array(values) - truth) <= 1.96 * found.standard_errors()

    # speeds in the exponent, and R up to its fourth power: not quite linear
    held = np.array(covered(cases, one))
    for each in held.T:
        coverage(list(each), 0.93)


test_what_is_no_test_is_refused = refusals(
    lambda make: make(),
    (lambda: Rebounds(approach=[1.0], rebound=[3.0]), "exchange the columns"),
    (lambda: Rebounds(approach=[1.0, -1.0], rebound=[0.5, 0.5]), "speeds above 0, got -1"),
    (lambda: Rebounds(approach=[1.0, 2.0], rebound=[0.5]), "as many speeds as approach"),
    (lambda: Rebounds(approach=[np.nan], rebound=[0.5]), "must be a list of finite numbers"),
    (lambda: Rebounds.of_times([0.0, 0.2, 0.1]), "at least 3 rising numbers"),
    (lambda: Rebounds.of_times([0.0, 0.2, 0.3], height=-1.0), "height must be a positive"),
    (lambda: ForceCurve(deflection=[-1.0, 0.0], force=[1.0, 1.0]), "force must be positive"),
    (lambda: DropRecord(acceleration=np.eye(200)[90], fs=1e4, mass=1.0), "at a higher rate"),
    (lambda: DropRecord(acceleration=np.ones(9), fs=1e4, mass=0.0), "mass must be a positive"),
    (lambda: identify([0.7]), "test must be Rebounds, a ForceCurve or a DropRecord, got list"),
    error=ValueError,
)


# ------------------------------------------------------------------------------
# Tests of stops from files: columns, units, and what is refused.
# ------------------------------------------------------------------------------


def written(folder: Path, text: str) -> Path:
    file = folder / "test.csv"
    file.write_text(text)
    return file


def test_speeds_come_with_their_units(tmp_path: Path) -> None:
    file = written(tmp_path, "approach (mm/s),rebound (m/s)\n500,0.3\n1000,0.6\n")
    test = read_test(file, "speeds")
    assert isinstance(test, Rebounds)
    assert test.approach.tolist() == [0.5, 1.0] and test.observed.tolist() == [0.6, 0.6]
    plain = written(tmp_path, "500,300\n1000,600\n")
    assert read_test(plain, "speeds", unit="mm/s,mm/s").place.tolist() == [0.5, 1.0]


def test_times_of_times_are_a_column(tmp_path: Path) -> None:
    file = written(tmp_path, "time (ms)\n0\n400\n600\n700\n")
    test = read_test(file, "times", height=0.3)
    assert test.observed[1:] == pytest.approx([0.5, 0.5]) and len(test.observed) == 3


def test_a_force_curve_has_a_speed_where_it_has_times(tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.0, 11)
    rows = "\n".join(f"{a},{1.0 + 2.0 * a},{5.0 * a}" for a in t)
    file = written(tmp_path, "time (s),deflection (mm),force (N)\n" + rows)
    test = read_test(file, "force", mass=2.0)
    assert isinstance(test, ForceCurve)
    assert test.speed == pytest.approx(np.full(11, 2e-3)) and test.mass == 2.0
    still = written(tmp_path, "1,10\n2,20\n")
    assert read_test(still, "force", unit="mm,N").speed is None


def test_a_drop_is_a_record(tmp_path: Path) -> None:
    clean = record(1.2e6, 1.0, 300.0, 0.0, mass=2.3, speed=1.4, fs=20e3, before=0.01, after=0.01)
    rows = "\n".join(f"{n / 20e3:.6f},{a / 9.80665:.5f}" for n, a in enumerate(clean))
    file = written(tmp_path, "time (s),a (g)\n" + rows)
    test = read_test(file, "drop", mass=2.3)
    assert isinstance(test, DropRecord)
    # reading takes the mean off, and the test the offset before the impact
    assert test.observed.max() == pytest.approx(clean.max(), abs=1e-4 * clean.max())
    assert test.observed[0] == pytest.approx(0.0, abs=1e-3)
    assert read_test(file, "drop", mass=2.3, pendulum=True).gravity == 0.0


@pytest.mark.parametrize(
    "heading", ["deflection (mm),force (kN),remark", "Units: mm, kN", "# deflection; force in kN"]
)
def test_a_curve_is_not_read_in_other_units_than_its_heading_states(
    tmp_path: Path, heading: str
) -> None:
    file = tmp_path / "pad.csv"
    file.write_text(f"{heading}\n1,0.1\n2,0.21\n3,0.3\n")
    with pytest.raises(SceneError, match=r"unit is 'mm,N', but above column 2 of .* stands 'kN'"):
        read_test(file, "force", unit="mm,N")
    assert read_test(file, "force", unit="mm,kN").observed.tolist() == [100.0, 210.0, 300.0]


test_what_is_no_file_of_a_test_is_refused = refusals(
    lambda tmp_path, text, keys: read_test(written(tmp_path, text), **keys),
    ("1,2\n3,4\n", {"kind": "speeds"}, "must be 'm/s,m/s', got none"),
    ("a (g),b (m/s)\n1,2\n3,4\n", {"kind": "speeds"}, "states the unit 'g' above column 1"),
    ("1,2\n3,4\n", {"kind": "speeds", "unit": "m/s"}, "must name 2 units, as 'm/s,m/s'"),
    ("1,2,3,4\n3,4,5,6\n", {"kind": "force"}, "expected two numbers"),
    ("0,1,2\n0,2,3\n1,2,3\n", {"kind": "force", "unit": "s,mm,N"}, "rising times"),
    ("approach (m/s),rebound (m/s)\n1,2\n", {"kind": "drop"}, "mass must be given for a drop"),
    ("1\n2\n", {"kind": "rebound"}, "kind must be"),
    ("1\n2\n", {"kind": [1.0]}, "kind must be a text"),
    error=(SceneError, ValueError),
)
