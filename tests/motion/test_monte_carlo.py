"""Monte Carlo against its plain twin, exact laws, near-exact numbers, balances; same digits."""

import dataclasses
import importlib
import math
import pkgutil
from pathlib import Path

import numpy as np
import pytest
from numba.core.registry import CPUDispatcher
from scipy.stats import norm

import stochvi
from stochvi import (
    ConstantLoad,
    Estimate,
    ImpactPair,
    Isolator,
    NotApplicable,
    NotConverged,
    Oscillator,
    Restitution,
    Scene,
    SceneError,
    Statistic,
    TabulatedNoise,
    exact,
    simulate,
)
from stochvi.engine.arithmetic import COLUMNS, Log
from stochvi.methods import monte_carlo
from stochvi.methods.monte_carlo import record_path
from stochvi.model.build_response import residuals
from stochvi.model.model import model_of
from stochvi.motion import kernels, modal
from stochvi.motion.choose_plan import make_plan
from stochvi.motion.kernels.random_numbers import seed_streams
from stochvi.motion.plan import PathStatistics, of_pair, speed_mean
from stochvi.results.errors import CheckpointError
from stochvi.results.estimates import FEWEST_CLUSTERS
from stochvi.scenes.excitations import WhiteNoise
from stochvi.scenes.impact_laws import Elastic
from stochvi.scenes.structures import Matrices
from stochvi.testing import assert_agrees
from support.accuracies import assert_balanced, assert_differs, assert_same, quick_cases, rel_errors
from support.digits import IMPACTS, STAGES, digits_of_a_process
from support.known import BENCH, NATURAL, RIGID_STOPS, RigidStops, Units, values
from support.known import oscillator as oscillator_of_known
from support.mounts import TRUCK, isolator
from support.naive import full_band_isolator, kick_flow_kick, mirrored_euler, normals
from support.uncompiled import averages, averages_without_the_compiler

QUANTITIES = ("displacement_std", "velocity_std", "impact_speed_rate", "impact_speed_square_rate")


def run(scene: Scene, plan, seed: int, paths: int) -> PathStatistics:
    """Statistics of the first paths of a plan."""
    return PathStatistics.of(plan.averages(seed, 0, paths), plan.layout)


def rate(means: dict) -> float:
    return means["stops", "n_lower"] + means["stops", "n_upper"]


def quantities(scene: Scene, **arguments: object) -> dict[str, Estimate]:
    response = simulate(scene, **arguments)  # type: ignore[arg-type]
    return {name: estimate for (_, name), estimate in response.estimates().items()}


# ---- the scheme, path by path ----------------------------------------------------------------


TWINS = {
    "elastic": {"lower": -1.0, "upper": 1.0, "restitution": 1.0},
    "lossy": {"lower": -1.0, "upper": 1.0, "restitution": 0.5},
    "perfectly plastic": {"lower": -1.0, "upper": 1.0, "restitution": 0.0},
    "unequal gaps": {"lower": -0.3, "upper": 1.2, "restitution": 0.8},
    "one stop": {"lower": None, "upper": 0.7, "restitution": 0.8},
    "preload": {"lower": None, "upper": -0.8, "restitution": 0.9},
    "preload, lossy": {"lower": 0.5, "upper": 1.5, "restitution": 0.5},
    "several impacts a step": {"lower": -0.04, "upper": 0.05, "restitution": 0.9},
    "both stops passed before turning back": {"lower": 3.0, "upper": 3.02, "restitution": 0.6},
}


@pytest.mark.parametrize("case", TWINS.values(), ids=TWINS.keys())
@pytest.mark.parametrize("load", [0.0, 0.4])
def test_a_path_equals_its_plain_twin(case: dict, load: float) -> None:
    compare_with_twin(case, load, omega=1.0)


@pytest.mark.parametrize("restitution", [1.0, 0.5])
def test_a_path_without_a_spring_equals_its_plain_twin(restitution: float) -> None:
    compare_with_twin({"lower": -0.3, "upper": 1.2, "restitution": restitution}, 0.0, omega=0.0)


@pytest.mark.parametrize("restitution", [1.0, 0.9])
@pytest.mark.parametrize("omega", [0.0, 1.0])
def test_several_impacts_in_a_step(restitution: float, omega: float) -> None:
    """Steps so long that most masses hit both stops in one."""
    compare_with_twin({"lower": -0.4, "upper": 0.3, "restitution": restitution}, 0.0, omega, 1.2)


def compare_with_twin(case: dict, load: float, omega: float, step: float = 0.25) -> None:
    scene = oscillator_of_known(**case, load=load, omega=omega)
    path = 5
    # not longer: bounces in quick succession double the rounding errors again and again
    record = record_path(scene, duration=30.0, seed=9, path=path, step=step)
    plan = make_plan(model_of(scene), 0.0, 30.0)
    log = Log(np.empty((10**5, COLUMNS)), np.zeros(1, np.int64), 0.0)
    whole = np.zeros((len(record), 1, 3))
    plan.with_step(step).averages(9, path, 1, whole, log=log)
    streams = np.empty((2, 1), np.uint64)
    seed_streams(np.uint64(9), path, streams)
    (start,), (speed,) = plan._start(streams)
    steps = len(record)
    stops = [
        (position - plan.model.rest, case["restitution"], side)
        for position, side in ((case["lower"], -1.0), (case["upper"], 1.0))
        if position is not None
    ]
    x, v, hits = kick_flow_kick(
        start, speed, normals(9, path, steps + 2)[2:], step, omega, 0.1, 0.2, stops
    )
    np.testing.assert_allclose(record["displacement"], x + plan.model.rest, rtol=0, atol=1e-9)
    np.testing.assert_allclose(record["velocity"], v, rtol=0, atol=1e-8)
    signed = sum(side * w for side, w, _ in hits)
    assert record["impact_speed"].sum() == pytest.approx(signed, rel=0, abs=1e-7)
    assert len(hits) > 3
    timed = np.array([(when, side * w) for side, w, when in hits if math.isfinite(when)])
    np.testing.assert_allclose(log.events[: log.count[0], 2:], timed, rtol=0, atol=1e-7)


# ---- exact and near-exact numbers ------------------------------------------------------------


@pytest.mark.parametrize("units", [NATURAL, BENCH], ids=["natural", "SI"])
@pytest.mark.parametrize("row", RIGID_STOPS, ids=lambda row: f"R={row.restitution:g}")
def test_near_exact_numbers_of_rigid_stops(row: RigidStops, units: Units) -> None:
    scene = oscillator_of_known(-1.0, 1.0, row.restitution, units=units)
    found = quantities(scene, rel_error=0.003, seed=11)
    for name in QUANTITIES:
        assert found[name].standard_error <= 0.003 * found[name].value
        assert_agrees(found[name], row.values[name] * units.factor(name))


def near_exact(restitution: float) -> dict[str, float]:
    return next(row.values for row in RIGID_STOPS if row.restitution == restitution)


ELASTIC = {
    "unequal gaps": {"lower": -0.5, "upper": 1.0},
    "one stop": {"lower": None, "upper": 1.0},
    "preload": {"lower": None, "upper": -1.0},
    "narrow": {"lower": -0.02, "upper": 0.03},
    "load on a stop": {"lower": -1.0, "upper": 1.0, "load": 2.0},
    "light damping": {"lower": -1.0, "upper": 1.0, "damping": 0.01, "intensity": 0.02},
    "overdamped": {"lower": -1.0, "upper": 1.0, "damping": 10.0, "intensity": 20.0},
    "no spring": {"lower": -1.0, "upper": 1.0, "omega": 0.0},
}


@rel_errors(0.01, 0.003)
@pytest.mark.parametrize("case", ELASTIC.values(), ids=ELASTIC.keys())
def test_elastic_stops_agree_with_the_exact_law(case: dict, rel_error: float) -> None:
    scene = oscillator_of_known(**case, restitution=1.0)
    truth = values(exact(scene))
    found = quantities(scene, rel_error=rel_error, seed=13)
    sides = [f"collision_rate_{side}" for side in ("lower", "upper") if case[side] is not None]
    for name in (*QUANTITIES, "displacement_mean", *sides):
        assert_agrees(found[name], truth[name])
        assert found[name].bias == 0.0


def test_half_the_step_is_free_of_bias_too() -> None:
    scene = oscillator_of_known(-1.0, 1.0, 1.0)
    truth = values(exact(scene))
    plan = make_plan(model_of(scene), None, None)
    for factor in (0.5, 2.0):
        changed = plan.with_step(factor * plan.step)
        value, error = run(scene, changed, 5, 4096).evaluate(rate)
        assert abs(value - truth["collision_rate"]) < 4.5 * error


LOSSY = {
    "unequal gaps": {"lower": -0.5, "upper": 1.0, "restitution": 0.8},
    "one stop": {"lower": None, "upper": 0.5, "restitution": 0.5},
    "preload": {"lower": None, "upper": -1.0, "restitution": 0.5},
    "load on a stop": {"lower": -1.0, "upper": 1.0, "restitution": 0.5, "load": 3.0},
    "undamped": {"lower": -1.0, "upper": 1.0, "restitution": 0.7, "damping": 0.0},
    "plastic": {"lower": -1.0, "upper": 1.0, "restitution": 0.0},
    "no spring, no damper": {
        "lower": -1.0, "upper": 1.0, "restitution": 0.7, "damping": 0.0, "omega": 0.0,
    },
}  # fmt: skip


@pytest.mark.slow
@rel_errors(0.01, 0.003)
@pytest.mark.parametrize("case", LOSSY.values(), ids=LOSSY.keys())
def test_balances_hold_where_stops_lose_energy(case: dict, rel_error: float) -> None:
    if case["restitution"] == 0.0:
        # steps as they are leave a bias of 0.4 %, which more paths would not mend
        rel_error = max(rel_error, 0.006)
    response = simulate(oscillator_of_known(**case), rel_error=rel_error, seed=14, budget=None)
    assert set(response.identities) == {"energy", "virial", "force"}
    for residual in response.identities.values():
        assert_agrees(residual, 0.0)
        assert residual.standard_error < 0.01


def test_stops_of_different_restitution_keep_the_balances() -> None:
    scene = oscillator_of_known(-1.0, 1.0, 0.9)
    pair = ImpactPair(
        lower=-1.0,
        upper=1.0,
        lower_law=Restitution(coefficient=0.9),
        upper_law=Restitution(coefficient=0.3),
    )
    response = simulate(
        scene.model_copy(update={"impact_pairs": (pair,)}), rel_error=0.003, seed=14
    )
    assert_balanced(response)
    mean = response.coordinates["x"]["displacement_mean"]
    assert isinstance(mean, Estimate)
    assert mean.value > 4.5 * mean.standard_error  # the mass lingers where it is caught


def test_the_stated_bias_covers_that_of_a_coarse_step() -> None:
    """At four times the default step F2 is off beyond its noise; the stated bias knows."""
    truth = near_exact(0.5)["velocity_std"]
    scene = oscillator_of_known(-1.0, 1.0, 0.5)
    coarse = make_plan(model_of(scene), None, None).with_step(0.6)
    half = run(scene, coarse.with_step(0.3), 6, 32768)
    full = run(scene, coarse, 6, 32768)

    def velocity(means: dict) -> float:
        return math.sqrt(means["x", "vv"])

    (fine_value, fine_error), (value, error) = half.evaluate(velocity), full.evaluate(velocity)
    assert abs(value - truth) > 4.5 * error
    stated = abs(value - fine_value) / 3.0
    # the stated bias has a third of the standard error of what it is taken from
    assert abs(fine_value - truth) < stated + 4.5 * math.hypot(fine_error, error / 3.0)


def test_rates_of_slow_impacts_do_not_depend_on_a_refined_step() -> None:
    """At R = 0.2 the plain step misses slow impacts; refined steps of any length agree."""

    scene = oscillator_of_known(-1.0, 1.0, 0.2)

    def rate_at(step: float, slow_impacts: bool, paths: int) -> tuple[float, float]:
        plan = make_plan(model_of(scene), None, 400.0, slow_impacts).with_step(step)
        return run(scene, plan, 31, paths).evaluate(rate)

    (coarse, coarse_error), (fine, fine_error) = rate_at(0.2, True, 6144), rate_at(0.05, True, 1024)
    assert abs(coarse - fine) < 4.5 * math.hypot(coarse_error, fine_error)
    plain, plain_error = rate_at(0.2, False, 6144)
    assert abs(plain - coarse) > 4.5 * math.hypot(plain_error, coarse_error)


def test_refined_steps_keep_the_balances() -> None:
    response = simulate(
        oscillator_of_known(-1.0, 1.0, 0.3),
        rel_error=0.005,
        seed=15,
        slow_impacts=True,
        budget=None,
    )
    assert_balanced(response)
    rate = response.impact_pairs["stops"]["collision_rate"]
    assert isinstance(rate, Estimate)
    assert rate.bias is not None
    assert (
        simulate(oscillator_of_known(-1.0, 1.0, 0.3), paths=512)
        .estimates()["stops", "collision_rate"]
        .bias
        is None
    )


# ---- negative controls -----------------------------------------------------------------------


def euler_estimates(overshoot: bool, h: float) -> dict[str, Estimate]:
    xx, vv, rate = mirrored_euler(
        np.random.default_rng(21), 4000, int(150.0 / h), h, overshoot=overshoot
    )
    values = {"displacement_std": xx, "velocity_std": vv, "collision_rate": rate}
    estimates = {}
    for name, samples in values.items():
        mean, error = samples.mean(), samples.std(ddof=1) / math.sqrt(len(samples))
        if name != "collision_rate":
            mean, error = math.sqrt(mean), error / (2.0 * math.sqrt(mean))
        estimates[name] = Estimate(value=mean, standard_error=error)
    return estimates


def test_the_end_of_step_mirror_is_caught() -> None:
    truth = values(exact(oscillator_of_known(-1.0, 1.0, 1.0)))
    wrong = euler_estimates(overshoot=False, h=2.0 * math.pi / 50.0)
    for name in ("velocity_std", "collision_rate"):
        assert_differs(wrong[name], truth[name])
    right = euler_estimates(overshoot=True, h=0.02)
    for name, estimate in right.items():
        assert_agrees(estimate, truth[name])


def test_a_wrong_restitution_breaks_the_energy_balance() -> None:
    """Simulated with R = 0.8, judged as R = 0.81."""
    scene = oscillator_of_known(-1.0, 1.0, 0.8)
    statistics = run(scene, make_plan(model_of(scene), None, None), 8, 8192)
    claimed = model_of(oscillator_of_known(-1.0, 1.0, 0.81))
    value, error = statistics.evaluate(lambda means: residuals(claimed, means, (0.0,))["energy"])
    assert abs(value) > 4.5 * error


# ---- tabulated noise -------------------------------------------------------------------------


@pytest.mark.parametrize("profile", [TRUCK, "navmat-p-9492", "gevs-qualification"])
def test_tabulated_noise_without_stops_agrees_with_the_frequency_integral(profile: str) -> None:
    scene = isolator(None, profile=profile)
    truth = values(exact(scene))
    found = quantities(scene, rel_error=0.005, seed=15)
    for name in ("displacement_std", "velocity_std", "acceleration_std"):
        assert_agrees(found[name], truth[name])


def test_a_wide_flat_table_is_white_noise() -> None:
    """Two engines that share no code but the random numbers, on the same physics."""
    pair = [ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=0.8))]
    structure = Oscillator(mass=1.0, damping=0.1, stiffness=1.0)
    flat = TabulatedNoise(frequency_hz=[1e-3, 60.0], density=[0.4, 0.4], unit="N2/Hz")
    coloured = Scene(structure=structure, impact_pairs=pair, excitations=[flat])
    found = quantities(coloured, rel_error=0.01, seed=16)
    for name in QUANTITIES:
        assert_agrees(found[name], near_exact(0.8)[name])


def test_truck_isolator_agrees_with_a_full_band_record() -> None:
    gap, scene = 0.004, isolator(0.004)
    xx, vv, rate = full_band_isolator(
        np.random.default_rng(22), model_of(scene).acceleration_tables[0], scene.structure.omega,
        scene.structure.damping_rate, gap, 0.5, paths=96, rate=2048.0, length=16.0,
    )  # fmt: skip
    found = quantities(scene, rel_error=0.02, seed=17, speed_threshold=0.0)
    for name, samples in (
        ("displacement_mean_square", xx),
        ("velocity_mean_square", vv),
        ("collision_rate", rate),
    ):
        error = samples.std(ddof=1) / math.sqrt(len(samples))
        assert_same(found[name], Estimate(value=samples.mean(), standard_error=error))


# ---- digits, arguments, limits ---------------------------------------------------------------


def test_a_rate_never_seen_has_an_upper_limit_only() -> None:
    response = simulate(oscillator_of_known(-9.0, 9.0, 1.0), rel_error=0.02, seed=1)
    rate = response.impact_pairs["stops"]["collision_rate"]
    assert isinstance(rate, Estimate)
    assert rate.value == 0.0
    exposure = response.cost.paths * float(rate.how.split("of ")[1].split()[0])
    # 3 clusters at most, on either stop, of a hit a period while the energy is remembered
    clusters = -math.log(0.05) / exposure
    assert rate.upper_95 == pytest.approx(2.0 * clusters / (2.0 * math.pi * 0.1), rel=1e-3)
    assert response.impact_pairs["stops"]["impact_speed_mean"] is None
    assert any("upper limit" in warning for warning in response.warnings)


def test_collapse_is_announced() -> None:
    response = simulate(oscillator_of_known(-1.0, 1.0, 0.1), rel_error=0.02)
    assert any("infinite" in warning for warning in response.warnings)
    assert not any(
        "infinite" in w for w in simulate(oscillator_of_known(-1.0, 1.0, 0.2), paths=300).warnings
    )


def test_a_budget_too_small_is_refused_with_what_was_reached() -> None:
    with pytest.raises(NotConverged, match="takes about") as refusal:
        simulate(oscillator_of_known(-1.0, 1.0, 0.8), rel_error=1e-5, budget=0.5)
    assert refusal.value.partial is not None
    assert refusal.value.partial.cost.paths > 2


def test_errors_that_are_small_by_chance_are_not_believed_of_two_paths(monkeypatch) -> None:
    """Two paths that happen to agree have no error, and any accuracy would count as reached."""
    monkeypatch.setattr(monte_carlo, "relative_standard_errors", lambda run: {("x", "std"): 0.0})
    monkeypatch.setattr(monte_carlo, "largest_bias", lambda run, errors: 0.0)
    scene = oscillator_of_known(-1.0, 1.0, 0.8)
    assert simulate(scene, rel_error=0.01, budget=None).cost.paths >= 64
    add_paths = monte_carlo.Simulation.add_paths

    def two_paths(run: monte_carlo.Simulation, *_: object) -> bool:
        add_paths(run, 2)
        return False

    monkeypatch.setattr(monte_carlo.Simulation, "add_paths", two_paths)
    with pytest.raises(NotConverged, match="after 2 paths, too few"):
        simulate(scene, rel_error=0.01, budget=0.5)


UNCOVERED = {
    "without stiffness": oscillator_of_known(None, 1.0, 1.0, omega=0.0),
    "restitution below 1": oscillator_of_known(-1.0, 1.0, 1.0, damping=0.0),
    "constant load alone": Scene(
        structure=Oscillator(mass=1.0, damping=1.0, stiffness=1.0),
        excitations=[ConstantLoad(force=1.0)],
    ),
}


@pytest.mark.parametrize("reason", UNCOVERED)
def test_scenes_that_are_not_covered_say_why(reason: str) -> None:
    with pytest.raises(NotApplicable, match=reason):
        simulate(UNCOVERED[reason])


BAD_ARGUMENTS = [
    ({"rel_error": 0.01, "paths": 10}, "not both"),
    ({"rel_error": 0.0}, "rel_error must be in"),
    ({"rel_error": float("nan")}, "rel_error must be in"),
    ({"paths": 1}, "paths must be at least 2"),
    ({"threads": 0}, "threads must be at least 1"),
    ({"seed": -1}, "seed must be in"),
    ({"duration": 0.0}, "duration must be a positive"),
    ({"budget": float("inf")}, "budget must be a positive"),
    ({"speed_threshold": -1.0}, "speed_threshold must be at least 0"),
]


@pytest.mark.parametrize(("arguments", "sentence"), BAD_ARGUMENTS)
def test_bad_arguments_are_named(arguments: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        simulate(oscillator_of_known(-1.0, 1.0, 1.0), **arguments)


# ---- corners where earlier versions went wrong -----------------------------------------------


def test_a_short_record_of_a_table_is_a_part_of_a_long_block() -> None:
    """A path of a fifth of a period still has the spectrum of the whole table."""
    found = quantities(isolator(0.004), paths=4000, duration=0.02, seed=2)
    long = quantities(isolator(0.004), paths=200, duration=30.0, seed=3)
    for name in ("velocity_std", "collision_rate"):
        difference = found[name].value - long[name].value
        error = math.hypot(found[name].standard_error, long[name].standard_error)
        assert abs(difference) < 4.5 * error + (found[name].bias or 0.0)


@rel_errors(0.06, 0.02)
@pytest.mark.parametrize(("band", "zeta"), [([1.0, 2.0], 0.5), ([0.1, 0.2], 0.1)])
def test_a_table_far_below_the_resonance_keeps_its_velocity(
    band: list, zeta: float, rel_error: float
) -> None:
    noise = TabulatedNoise(frequency_hz=band, density=[1.0, 1.0], unit="(m/s2)2/Hz")
    scene = Scene(structure=Isolator(frequency_hz=100.0, zeta=zeta), excitations=[noise])
    truth, found = values(exact(scene)), quantities(scene, rel_error=rel_error, seed=4)
    for name in ("displacement_std", "velocity_std"):
        assert_agrees(found[name], truth[name])


def test_a_narrow_gap_under_a_table_is_sampled_finely_enough() -> None:
    """Elastic stops at 0.05 sigma: halving the samples' distance changes nothing of substance."""
    scene = isolator(1e-4, 1.0)
    plan = make_plan(model_of(scene), None, 2.0)
    usual, finer = (run(scene, p, 5, 32) for p in (plan, plan.finer()))
    for quantity in (lambda m: m["x", "vv"], of_pair("stops")["impact_speed_rate"]):
        (value, error), (other, other_error) = usual.evaluate(quantity), finer.evaluate(quantity)
        assert abs(value - other) < 4.5 * math.hypot(error, other_error)


@rel_errors(0.03, 0.01)
@quick_cases("stop", [-100.0, -1000.0], keep=(1,))
def test_a_strong_preload_keeps_its_digits(stop: float, rel_error: float) -> None:
    scene = oscillator_of_known(None, stop, 1.0)
    truth, found = values(exact(scene)), quantities(scene, rel_error=rel_error, seed=6)
    for name in ("displacement_std", "velocity_std", "collision_rate", "impact_speed_rate"):
        assert_agrees(found[name], truth[name])


@pytest.mark.parametrize("restitution", [0.0, 0.1, 0.5])
def test_a_mass_at_rest_on_a_stop_still_presses_on_it(restitution: float) -> None:
    response = simulate(oscillator_of_known(None, -4.0, restitution), paths=2048, seed=7)
    assert_agrees(response.identities["force"], 0.0)
    assert response.identities["force"].standard_error < 2e-3


def test_one_path_with_all_the_hits_is_an_answer_too() -> None:
    scene = oscillator_of_known(-4.0, 4.0, 1.0)
    plan = make_plan(model_of(scene), None, 100.0)
    averages = plan.averages(1, 0, 64)
    averages[3:] = 0.0
    averages[3:6, 17] = 0.01
    statistics = PathStatistics.of(averages, plan.layout)
    value, error = statistics.evaluate(speed_mean("stops"))
    assert value == pytest.approx(1.0)
    assert math.isfinite(error)


def test_a_mean_over_the_hits_of_one_path_is_hardly_known() -> None:
    """Its spread between paths cannot be seen: to first order it would have no error at all."""
    seen = []
    for seed in range(24):
        found = simulate(oscillator_of_known(-2.2, 2.2, 0.8), paths=48, duration=3.0, seed=seed)
        rate, mean = (
            found.impact_pairs["stops"][name] for name in ("collision_rate", "impact_speed_mean")
        )
        if mean is not None:
            seen.append((rate.upper_95, mean.standard_error / mean.value))
    # fewer than five clusters give no rate, and an error of a fifth at least
    few = [error for of_rate, error in seen if of_rate is not None]
    assert max(few) > 0.8, "in none of the runs a single path had all the impacts"
    assert min(few) > 1.0 / FEWEST_CLUSTERS
    assert min(error for _, error in seen) < 0.4  # more paths that hit know it better


def test_times_too_far_apart_are_refused_in_a_sentence() -> None:
    with pytest.raises(NotApplicable, match="too far apart"):
        simulate(oscillator_of_known(-1e-8, 1e-8, 1.0 - 1e-12))
    with pytest.raises(NotApplicable, match="shorter duration and more paths"):
        simulate(isolator(0.004), paths=2, duration=1e9)


# ------------------------------------------------------------------------------
# One seed gives one set of digits: in the process that compiles, and in those that load.
# ------------------------------------------------------------------------------


CASES = [
    IMPACTS,
    "oscillator-elastic",
    "oscillator-lossy",
    "zoo/lossy-upper-stop",
    "zoo/linear",
    "zoo/spring-stops",
    "zoo/psd-truck-elastic",
    "zoo/psd-spring-stops",
    "absorber-on-a-tower",
    "zoo/chain-two-pairs",
    *STAGES,
]
"""A small kernel, and scenes that between them call for every plan of `make_plan`."""


@pytest.mark.verify
def test_processes_that_load_all_kernels_find_the_digits_of_the_one_that_compiled_them(
    tmp_path: Path,
) -> None:
    compiled = digits_of_a_process(CASES, tmp_path)
    assert digits_of_a_process(CASES, tmp_path) == compiled
    # which kernel is loaded first must not matter either
    assert digits_of_a_process(CASES[::-1], tmp_path) == compiled


def test_no_kernel_leaves_the_rounding_to_the_compiler() -> None:
    """Of a function that may be rounded in several ways, several copies with other digits exist."""
    found = []
    for module in pkgutil.iter_modules(kernels.__path__, f"{kernels.__name__}."):
        content = vars(importlib.import_module(module.name)).values()
        found += [each for each in content if isinstance(each, CPUDispatcher)]
    assert found
    assert [each.__name__ for each in found if each.targetoptions.get("fastmath")] == []


# ------------------------------------------------------------------------------
# Statistics of one's own: their values, where velocities are taken, and what is refused.
# ------------------------------------------------------------------------------


GAP = 0.8
"""Distance of the stops, m: k = 1, b = .1, S0 = .2, so that x and v have the deviation 1."""


def oscillator(law: object, damping: float = 0.1, **pair: float) -> Scene:
    return Scene(
        structure=Oscillator(mass=1.0, damping=damping, stiffness=1.0),
        impact_pairs=[ImpactPair(law=law, **(pair or {"lower": -GAP, "upper": GAP}))],
        excitations=[WhiteNoise(intensity=2.0 * damping)],
    )


def half_way(x: float, v: float) -> float:
    return 1.0 if x > 0.4 else 0.0


def fast(x: float, v: float) -> float:
    return 1.0 if v > 1.0 else 0.0


def product(x: float, v: float) -> float:
    return x**2 * v**4


def square(x: float, v: float) -> float:
    return v * v


def beyond(x: float, v: float) -> float:
    return 1.0 if x > GAP else 0.0


def away(found: Estimate, truth: float) -> float:
    """Distance from the truth in standard errors, beyond the bias."""
    return max(abs(found.value - truth) - found.bias, 0.0) / found.standard_error


# ---- values -----------------------------------------------------------------------------------


def test_means_are_those_of_the_exact_density() -> None:
    asked = {each.__name__: Statistic(function=each) for each in (half_way, fast, product)}
    scene = oscillator(Restitution(coefficient=1.0))
    found = simulate(scene, statistics=asked, paths=1024, seed=3).statistics
    inside = norm.cdf(GAP) - norm.cdf(-GAP)
    variance = 1.0 - 2.0 * GAP * norm.pdf(GAP) / inside
    known = {
        "half_way": (norm.cdf(GAP) - norm.cdf(0.4)) / inside,
        "fast": norm.sf(1.0),
        "product": 3.0 * variance,
    }
    assert all(away(found[name], truth) < 4.5 for name, truth in known.items())
    assert all(away(found[name], 1.05 * truth) > 4.5 for name, truth in known.items())


def test_velocities_are_taken_in_the_middle_of_a_kick(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = oscillator(Restitution(coefficient=0.5), damping=1.0)
    asked = {"square": Statistic(function=square)}

    def apart() -> float:
        found = simulate(scene, statistics=asked, paths=1024, seed=5)
        own, known = found.statistics["square"], found.coordinates["x"].velocity_mean_square
        return abs(own.value - known.value) / math.hypot(own.standard_error, known.standard_error)

    assert apart() < 4.5
    whole = modal.statistics_of
    monkeypatch.setattr(
        modal, "statistics_of", lambda *of: whole(*of)._replace(spreads=0.0 * whole(*of).spreads)
    )
    assert apart() > 4.5


TABLE = TabulatedNoise(frequency_hz=[0.05, 0.3], density=[0.4, 0.4], unit="N2/Hz")


@pytest.mark.slow
@pytest.mark.parametrize("noise", [WhiteNoise(intensity=0.2), TABLE], ids=["white", "table"])
def test_time_in_contact_is_that_of_the_contacts(noise: object) -> None:
    several = Matrices(
        mass=[[1.0, 0.0], [0.0, 0.5]], damping=[[0.2, -0.1], [-0.1, 0.1]],
        stiffness=[[2.0, -1.0], [-1.0, 1.0]], coordinates=["a", "b"],
    )  # fmt: skip
    scene = Scene(
        structure=several,
        impact_pairs=[
            ImpactPair(name="gap", between=["a", "b"], upper=GAP, law=Elastic(stiffness=30.0))
        ],
        excitations=[noise.replace(on="a")],
    )
    asked = {"time": Statistic(function=beyond, of="gap")}
    found = simulate(scene, statistics=asked, rel_error=0.03, seed=2)
    contact = found.impact_pairs["gap"].contact_probability
    own = found.statistics["time"]
    error = 4.5 * math.hypot(own.standard_error, contact.standard_error)
    assert abs(own.value - contact.value) < error + own.bias + contact.bias
    assert error < 0.2 * own.value
    of_a = simulate(scene, statistics={"a": Statistic(function=beyond, of="a")}, paths=256, seed=2)
    assert abs(of_a.statistics["a"].value - contact.value) > error


@pytest.mark.verify
def test_time_in_contact_of_six_modes() -> None:
    scene = stochvi.load_scene(stochvi.scenes.shipped_scene("rigid-box"))
    lower, upper = -0.002, 0.0005
    soft = Elastic(stiffness=5e5)
    pair = scene.impact_pairs[0].replace(law=soft, lower=lower, upper=upper)
    scene = scene.replace(impact_pairs=[pair, *scene.impact_pairs[1:]])

    def outside(y: float, v: float) -> float:
        return 1.0 if y > upper or y < lower else 0.0

    def above(y: float, v: float) -> float:
        return 1.0 if y > upper else 0.0

    asked = {
        "time": Statistic(function=outside, of=pair.name),
        "half": Statistic(function=above, of=pair.name),
    }
    found = simulate(scene, statistics=asked, paths=512, seed=2)
    contact = found.impact_pairs[pair.name].contact_probability

    def apart(name: str) -> float:
        own = found.statistics[name]
        error = math.hypot(own.standard_error, contact.standard_error)
        return (abs(own.value - contact.value) - own.bias - contact.bias) / error

    assert apart("time") < 4.5
    assert apart("half") > 4.5


# ---- answers ----------------------------------------------------------------------------------


def test_an_answer_with_statistics_is_written_and_read(tmp_path: Path) -> None:
    scene = oscillator(Restitution(coefficient=1.0))
    found = simulate(scene, statistics={"fast": Statistic(function=fast)}, paths=64, duration=50.0)
    row = found.to_frame().iloc[-1]
    assert (row["of"], row["quantity"], row["unit"]) == ("statistics", "fast", "")
    assert "statistics.fast = " in repr(found)
    stochvi.save_answer(found, tmp_path / "answer.json")
    assert stochvi.load_answer(tmp_path / "answer.json").statistics == found.statistics
    recorded = found.provenance["call"]["arguments"]["statistics"]["fast"]
    assert recorded["function"].startswith(f"{__name__}.fast (")
    assert "statistics" not in simulate(scene, paths=64, duration=50.0).to_dict()


def test_a_run_goes_on_with_the_same_functions_only(tmp_path: Path) -> None:
    scene, kept = oscillator(Restitution(coefficient=1.0)), tmp_path / "kept"
    asked = {"fast": Statistic(function=fast)}
    run = {"paths": 64, "duration": 50.0, "seed": 1}
    first = simulate(scene, statistics=asked, checkpoint=kept, **run)
    assert simulate(scene, statistics=asked, resume=kept, **run) == first
    with pytest.raises(CheckpointError, match="is of a run with statistics"):
        simulate(scene, statistics={"fast": Statistic(function=half_way)}, resume=kept, **run)
    with pytest.raises(ValueError, match="give each function anew"):
        simulate(scene, resume=kept, **run)


# ---- what is refused --------------------------------------------------------------------------


def test_a_function_that_cannot_be_averaged_is_refused_in_a_sentence() -> None:
    with pytest.raises(SceneError, match=r"takes a displacement .* got missing a"):
        Statistic(function=lambda x, v, a: x)
    with pytest.raises(SceneError, match="needs function that numba compiles"):
        Statistic(function=lambda x, v: dataclasses.asdict(x))


def test_a_statistic_of_nothing_in_the_scene_is_refused() -> None:
    scene = oscillator(Restitution(coefficient=1.0))
    with pytest.raises(ValueError, match=r"pair of the scene \(stops, x\), got 'y'"):
        simulate(scene, statistics={"fast": Statistic(function=fast, of="y")})
    with pytest.raises(ValueError, match="must be a table of names and `Statistic`"):
        simulate(scene, statistics={"fast": fast})


# ------------------------------------------------------------------------------
# Kernels with the compiler off: the same numbers, so that a debugger sees what runs.
# ------------------------------------------------------------------------------


@pytest.mark.slow
def test_kernels_give_the_same_numbers_without_the_compiler() -> None:
    compiled, plain = averages(), averages_without_the_compiler()
    assert compiled.keys() == plain.keys()
    for name, expected in compiled.items():
        assert np.isfinite(expected).all()
        # rounding differs, and grows with each impact
        assert plain[name] == pytest.approx(expected, rel=1e-8, abs=1e-12), name
