"""Scenes at the edge: a finite answer that meets the balances, or one sentence; no warning."""

from __future__ import annotations

import importlib
import math
import warnings
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from stochvi import NotApplicable, Response, Scene, SceneError, exact, simulate
from stochvi.engine.arithmetic import NO_LOG, NO_RECORD
from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION, corner_exponent
from stochvi.methods.monte_carlo import record_path
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.motion.kernels.flight import SUMS, Counting, Kick, Paths, run_white
from stochvi.motion.modal import ModalPlan
from stochvi.motion.white import ENOUGH_STEPS, WhitePlan, _flow
from stochvi.results.estimates import upper_limit_unseen
from stochvi.sampling.calculations import stop_flag
from stochvi.testing import assert_agrees
from support.accuracies import assert_balanced, quick_cases, rel_errors
from support.known import oscillator, values

HARD = importlib.import_module("studies.04_hard_cases.cases")
CASES: dict[str, Scene] = HARD.CASES

FEW_PATHS = {
    "overdamped, zeta = 50, R = 0.5": {"paths": 24, "duration": 200.0},
    "two modes, frequencies 1 : 1e4": {"paths": 8, "duration": 0.2},
    "filtered noise at 1000 times the resonance": {"paths": 24, "duration": 50.0},
    "sine alone, overdamped (zeta = 15)": {"paths": 24, "duration": 50.0},
    "static force 100 on a stop, R = 0": {"paths": 512, "duration": 0.002},
    "gap 1e-6, R = 1": {"paths": 512, "duration": 1e-3},
}
"""Where time scales lie far apart, a path is long: as many as balances can be judged by."""

SLOW = {
    "two modes, frequencies 1 : 1e4",
    "filtered noise at 1000 times the resonance",
    "overdamped, zeta = 50, R = 0.5",
    "table far above the resonance",
    "static force 100 on a stop, R = 1",
    "free absorber, R = 0",
    "free absorber, R = 1",
    "stops and a neighbour, R = 0.5",
}
"""Cases in which a few paths take seconds of CPU time, as time scales lie far apart."""


@pytest.fixture(autouse=True)
def no_warning() -> Iterator[None]:
    with warnings.catch_warnings(), np.errstate(all="raise", under="ignore"):
        warnings.simplefilter("error")
        yield


def answer(name: str, rel_error: float = 0.1) -> Response:
    how = FEW_PATHS.get(name, {"rel_error": rel_error})
    return simulate(CASES[name], seed=21, threads=1, **how)  # type: ignore[arg-type]


def case(name: str) -> object:
    """The name of a case, marked where its paths take too long for the default suite."""
    return pytest.param(name, marks=pytest.mark.verify) if name in SLOW else name


@rel_errors(0.2, 0.05)
@pytest.mark.parametrize("name", [case(each) for each in CASES])
def test_the_answer_is_finite_and_meets_the_balances(name: str, rel_error: float) -> None:
    response = answer(name, rel_error)
    # an Estimate refuses NaN and infinity by itself
    assert response.identities
    assert_balanced(response)
    for coordinate in response.coordinates.values():
        spread, speed = coordinate["displacement_std"], coordinate["velocity_std"]
        assert spread is not None and spread.value > 0.0
        assert speed is not None and speed.value > 0.0


@pytest.mark.slow
def test_balances_fail_for_a_law_that_is_not_simulated() -> None:
    response = simulate(CASES["R = 0"], rel_error=0.01, seed=3)
    stops = {name: item.value for (_, name), item in response.estimates().items()}
    error = response.identities["energy"].standard_error
    # with R = 0.5 instead, stops would take a quarter less of the power
    power = 0.1 * stops["velocity_mean_square"] + 0.375 * stops["impact_speed_square_rate"]
    assert abs(0.1 - power) / 0.1 > 4.5 * error + (response.identities["energy"].bias or 0.0)


@pytest.mark.parametrize("name", HARD.NO_STATE)
def test_no_stationary_state_is_said_in_a_sentence(name: str) -> None:
    with pytest.raises(NotApplicable, match=r"^simulate does not apply: [^\n]+\.$"):
        simulate(HARD.NO_STATE[name], rel_error=0.1)


@pytest.mark.parametrize("intensity", [0.0, -1.0, 1e-60, 1e60, math.nan, math.inf])
def test_noise_of_no_intensity_is_refused_by_the_scene(intensity: float) -> None:
    with pytest.raises(SceneError, match="intensity"):
        HARD.oscillator(-1.0, 1.0, 0.5, intensity=intensity)


# ---- answers that are known -------------------------------------------------------------------

ELASTIC = ["R = 1", "static force 100 on a stop, R = 1", "gap 1e-6, R = 1", "preload 5, R = 1",
           "elastic stop, 1e8 times the spring"]  # fmt: skip


@rel_errors(0.1, 0.02)
@quick_cases("name", ELASTIC, keep=(0, 2, 3, 4))
def test_elastic_stops_agree_with_the_exact_law(name: str, rel_error: float) -> None:
    truth = values(exact(CASES[name]))
    found = {key: item for (_, key), item in answer(name, rel_error).estimates().items()}
    for key in ("displacement_mean", "displacement_std", "velocity_std", "collision_rate"):
        assert_agrees(found[key], truth[key])


def test_a_narrow_elastic_gap_starts_in_its_law_and_stays_in_it() -> None:
    plan = make_plan(model_of(CASES["gap 1e-6, R = 1"]), None, None)
    assert plan.steps_per_path == ENOUGH_STEPS + 1
    sums = plan.averages(4, 0, 256)
    width, error = sums[1] * 3e12, 1.0 / math.sqrt(256)
    # x is uniform: 3 x^2 / gap^2 has the mean 1; and v^2 is that of the start, mean 1, variance 2
    assert abs(width.mean() - 1.0) < 4.5 * width.std() / 16.0
    assert abs(sums[2].mean() - 1.0) < 4.5 * math.sqrt(2.0) * error


@rel_errors(0.1, 0.02)
def test_two_pairs_on_one_coordinate_are_one_pair_with_two_stops(rel_error: float) -> None:
    response = answer("two pairs on one coordinate", rel_error)
    truth = values(exact(CASES["R = 1"]))
    assert_agrees(response.coordinates["a"]["displacement_std"], truth["displacement_std"])
    for name in ("floor", "ceiling"):
        rate = response.impact_pairs[name]["collision_rate"]
        assert_agrees(rate, truth["collision_rate"] / 2.0)


def test_a_sine_alone_settles_in_the_regime_of_one_impact_on_each_stop() -> None:
    response = simulate(CASES["sine alone, at resonance"], rel_error=0.02, seed=2)
    b, omega, amplitude, restitution = 0.1, 1.0, 10.0, 0.5
    half = math.pi / omega
    damped = math.sqrt(omega**2 - b**2 / 4.0)
    decay, s, c = math.exp(-b * half / 2.0), math.sin(damped * half), math.cos(damped * half)
    flow = decay * np.array(
        [[c + b * s / (2.0 * damped), s / damped],
         [-omega**2 * s / damped, c - b * s / (2.0 * damped)]]
    )  # fmt: skip
    p, q = np.linalg.solve(
        flow + np.eye(2), [restitution * flow[0, 1], restitution * flow[1, 1] - 1.0]
    )
    # the larger root v of (D - v p)^2 + (v q / omega)^2 = a^2, D = 1
    speed = max(np.roots([p**2 + (q / omega) ** 2, -2.0 * p, 1.0 - amplitude**2]).real)
    stops = response.impact_pairs["stops"]
    assert_agrees(stops["impact_speed_rate"], omega / math.pi * speed)
    assert_agrees(stops["impact_speed_square_rate"], omega / math.pi * speed**2)


def test_a_stop_that_is_never_reached_has_an_upper_limit() -> None:
    response = answer("gap 1e6")
    rate = response.impact_pairs["stops"]["collision_rate"]
    assert rate.value == rate.standard_error == 0.0
    exposure = response.cost.paths * make_plan(model_of(CASES["gap 1e6"]), None, None).duration
    assert rate.upper_95 >= upper_limit_unseen(exposure)
    (told,) = (line for line in response.warnings if "no impact on" in line)
    assert "the lower stop of stops and the upper stop of stops in" in told


def test_a_mean_speed_of_impacts_that_twice_the_step_does_not_see_has_no_known_bias() -> None:
    """Of two short paths one step may see a hit, and twice the step none."""
    loose = oscillator(0.0, 1.0, 0.7)
    found = [simulate(loose, paths=2, duration=2.0, seed=seed, threads=1) for seed in range(24)]
    means = [each.impact_pairs["stops"].impact_speed_mean for each in found]
    assert any(mean is not None and mean.bias is None and mean.value > 0.0 for mean in means)


# ---- collapse ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["R = 0", "R = 0.1, collapse"])
def test_rates_below_the_critical_restitution_are_those_above_a_threshold(name: str) -> None:
    response = answer(name)
    stops = response.impact_pairs["stops"]
    assert stops["speed_threshold"] > 0.0
    assert stops["collision_rate"].bias is None
    assert any("the rate of all impacts is infinite" in line for line in response.warnings)


@pytest.mark.parametrize("restitution", [1e-6, 0.05, 0.1, 0.16])
def test_exponent_of_slow_impacts_below_the_critical_restitution(restitution: float) -> None:
    beta = corner_exponent(restitution)
    assert 2.0 < beta < 2.5
    sine = 2.0 * math.sin((1.0 + 2.0 * beta) * math.pi / 6.0)
    assert (beta - 2.0) * math.log(restitution) == pytest.approx(math.log(sine), abs=1e-8)
    # continuous where it crosses 2
    assert corner_exponent(COLLAPSE_RESTITUTION) == pytest.approx(2.0, abs=1e-8)


def test_rate_at_no_restitution_grows_with_the_root_of_the_threshold() -> None:
    rates = []
    plan = make_plan(model_of(CASES["R = 0"]), None, None, slow_impacts=True)
    for share in (0.05, 0.005):
        # steps as short as those in which noise brings a third of the threshold
        fine = replace(plan, threshold=share * plan.speed, burn_in=10.0, duration=20.0)
        sums = fine.with_step(plan.step / 64.0).averages(5, 0, 128)
        rates.append(sums[3] + sums[6])
    ratio = rates[1].mean() / rates[0].mean()
    error = ratio * math.hypot(*(rate.std() / rate.mean() / math.sqrt(128) for rate in rates))
    # w^(2 - beta), beta = 5/2, from w = 0.05 to 0.005 of the rms speed: a growth by sqrt 10, less
    # what faster impacts add, which do not follow the law of the corner
    assert 2.0 < ratio < math.sqrt(10.0) + 4.5 * error


# ---- starts, steps, length --------------------------------------------------------------------


@pytest.mark.parametrize("name", ["R = 0", "R = 1", "static force 10 on a stop, R = 0.5"])
def test_a_start_beyond_a_stop_comes_back(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    upper = CASES[name].impact_pairs[0].upper
    assert upper is not None

    def beyond(plan: WhitePlan, streams: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        paths = streams.shape[1]
        return np.full(paths, upper - plan.model.rest + 3.0), np.full(paths, 2.0)

    monkeypatch.setattr(WhitePlan, "_start", beyond)
    plan = make_plan(model_of(CASES[name]), None, None)
    path = record_path(CASES[name], duration=400 * plan.step)
    assert np.isfinite(path.to_numpy()).all()
    assert path["displacement"].max() <= upper + 1e-12


def test_a_start_beyond_the_walls_of_two_masses_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    start = ModalPlan.start
    monkeypatch.setattr(ModalPlan, "start", lambda plan, streams: 3.0 + start(plan, streams))
    scene = CASES["stops and a neighbour, R = 0.5"]
    path = record_path(scene, duration=12.0)
    assert np.isfinite(path.to_numpy()).all()
    later = path[path["time"] > 10.0]
    for name in "ab":
        assert later[f"displacement of {name}"].abs().max() < 0.1 * (1.0 + 1e-3)


LARGE = ["R = 1", "R = 0", "no spring, no damper, R = 0.5", "free absorber, R = 0.5",
         "elastic stop, 1e8 times the spring", "stops and a neighbour, R = 0.5",
         "sine alone, at resonance", "table far below the resonance"]  # fmt: skip


@pytest.mark.parametrize("step", [1.0, 1.9, 3.1, 100.0])
@pytest.mark.parametrize("name", LARGE)
def test_steps_far_too_large_stay_between_the_stops_or_are_refused(name: str, step: float) -> None:
    scene = CASES[name]
    try:
        path = record_path(scene, duration=100.0 * step, step=step)
    except (ValueError, NotApplicable) as error:
        sentence = str(error)
    else:
        sentence = ""
    if sentence:
        assert "step" in sentence
        return
    assert np.isfinite(path.to_numpy()).all()
    pair = scene.impact_pairs[0]
    if pair.law is not None and pair.law.rigid and len(scene.structure.coordinates) == 1:
        place = path.filter(like="displacement").to_numpy()
        assert place.max() <= pair.upper * (1.0 + 1e-9)
        assert place.min() >= pair.lower * (1.0 + 1e-9)


def test_two_pairs_are_hit_in_one_step() -> None:
    # at once by symmetry: the same start, the same kicks, stops at the same place
    pairs = [HARD.pair(name, 0.5, -0.3, 0.3, on=name) for name in "ab"]
    scene = HARD.two_masses((1.0, 1.0), (0.1, 0.1), (1.0, 1.0), pairs, noises=(0.2, 0.2))
    path = record_path(scene, duration=2000.0, seed=4)
    hits = path[["impact_speed of a", "impact_speed of b"]].to_numpy() != 0.0
    # hits of both in a step of h are as frequent as independence says
    expected = hits[:, 0].mean() * hits[:, 1].mean() * len(hits)
    both = int((hits[:, 0] & hits[:, 1]).sum())
    assert both > 20
    assert abs(both - expected) < 4.5 * math.sqrt(expected)


@pytest.mark.parametrize(
    "steps", [10**7, pytest.param(10**9, marks=pytest.mark.verify)], ids=["1e7", "1e9"]
)
def test_energy_between_elastic_stops_does_not_drift(steps: int) -> None:
    lanes = 64
    scene = CASES["R = 1"]
    plan = make_plan(model_of(scene), None, None)
    x, v = np.linspace(-0.9, 0.9, lanes), np.linspace(0.3, 2.0, lanes)
    before = v**2 + x**2
    constants = (*plan._kernel_constants()[1:],)
    assert constants[0] == _flow(plan.model, plan.step)
    run_white(
        Paths(
            x, v, np.ones((2, lanes), np.uint64), np.zeros((SUMS, lanes)), np.zeros((2, lanes)),
            np.zeros((lanes, 2)),
        ),
        Kick(1.0, 0.0),
        *constants, Counting(0, steps // lanes, 10**6, 0.0, 0.0), NO_RECORD, NO_LOG, stop_flag(),
    )  # fmt: skip
    drift = (v**2 + x**2) / before - 1.0
    # cosine and sine are rounded once, so that a step changes energy by the same C^2 + S^2 - 1
    _, cosine, sine, _ = (Fraction(number) for number in constants[0])
    a_step = abs(float(cosine**2 + sine**2 - 1))
    assert 0.0 < a_step < 2.0**-53
    # the other roundings of a step partly repeat on an orbit between elastic stops, and add up with
    # a sign that differs from path to path; with them a step changes energy by less than 2^-53
    assert np.max(np.abs(drift)) < steps // lanes * 2.0**-53


@pytest.mark.parametrize(
    ("name", "steps"),
    [
        ("R = 0.1, collapse", 10**7),
        ("1e-9 kg, 1e9 N/m", 10**7),
        pytest.param("R = 0.1, collapse", 10**9, marks=pytest.mark.verify),
        pytest.param("R = 1", 10**9, marks=pytest.mark.verify),
    ],
)
def test_halves_of_a_long_run_agree(name: str, steps: int) -> None:
    paths = 32
    plan = make_plan(model_of(CASES[name]), None, None)
    half = steps / paths / 2.0 * plan.step
    first = replace(plan, burn_in=plan.burn_in, duration=half).averages(6, 0, paths)
    second = replace(plan, burn_in=plan.burn_in + half, duration=half).averages(6, 0, paths)
    for row in (1, 2, 4, 5, 7, 8):
        difference = (second[row] - first[row]) / first[row].mean()
        assert abs(difference.mean()) < 4.5 * difference.std() / math.sqrt(paths - 1)
