"""Averages of the motion without stops, whose expected values are known, as control variates."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from stochvi import (
    Elastic,
    ImpactPair,
    Isolator,
    Matrices,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    load_scene,
    simulate,
)
from stochvi.methods.monte_carlo import relative_standard_errors
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.motion.plan import (
    Layout,
    Means,
    PathStatistics,
    Plan,
    StepPairs,
    of_coordinate,
    of_pair,
)
from stochvi.results.estimates import Estimate
from stochvi.sampling.checkpoints import Checkpoint
from stochvi.scenes.datasets import shipped_scene, zoo_files
from stochvi.testing import assert_agrees
from support.accuracies import assert_differs, quick_cases
from support.known import oscillator

SIGMA = 0.0019879
"""Standard deviation of the mount without stops, m."""

RUN, RUNS = 64, 48
"""Paths of a run, and number of runs."""


def scene(lower: float | None, upper: float, *more: WhiteNoise) -> Scene:
    """A 12 Hz mount on a truck with stops in units of SIGMA."""
    table = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    pair = ImpactPair(
        name="stops",
        lower=None if lower is None else lower * SIGMA,
        upper=upper * SIGMA,
        law=Restitution(coefficient=0.5),
    )
    structure = Isolator(frequency_hz=12.0, zeta=0.1)
    return Scene(structure=structure, impact_pairs=[pair], excitations=[table, *more])


@cache
def paths_of(lower: float | None, upper: float, white: bool = False) -> tuple[Plan, np.ndarray]:
    noise = [WhiteNoise(intensity=1.0)] if white else []
    plan = make_plan(model_of(scene(lower, upper, *noise)), None, None)
    size = plan.block
    parts = [plan.averages(6, first, size) for first in range(0, RUN * RUNS, size)]
    return plan, np.concatenate(parts, axis=1)


def quantities(plan: Plan):
    known = of_coordinate(plan.model.coordinates[0]), of_pair("stops")
    wanted = [known[0]["displacement_std"], known[0]["velocity_std"]]
    wanted += [known[1][name] for name in ("collision_rate", "impact_speed_square_rate")]

    def found(means: Means) -> list[float]:
        return [each(means) for each in wanted]

    return found


@quick_cases(
    "case",
    [(-2.0, 1.5), (None, 1.0), (-2.0, -0.5), (-2.0, 2.0, True)],
    keep={0, 1, 2, 3},
    ids=str,
)
def test_controls_have_the_values_that_are_expected_of_them(case: tuple) -> None:
    plan, averages = paths_of(*case)
    assert len(plan.layout.controls) == 2 + 3 * len(plan.model.stops) + 2 * plan.kicked
    for key, expected in plan.layout.controls.items():
        sample = averages[plan.layout.rows.index(key)]
        error = sample.std(ddof=1) / np.sqrt(len(sample))
        assert_agrees(Estimate(value=sample.mean(), standard_error=error), expected)


def runs(controls: dict | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values and errors (runs, quantities) of short runs, and values of all runs as one without
    controls."""
    plan, averages = paths_of(-2.0, 2.0)
    layout = plan.layout if controls is None else replace(plan.layout, controls=controls)
    each = averages.reshape(len(averages), RUNS, RUN).swapaxes(0, 1)
    found = [PathStatistics.of(one, layout).evaluate_all(quantities(plan)) for one in each]
    whole = PathStatistics.of(averages, layout).uncontrolled.evaluate_all(quantities(plan))
    values, errors = np.array(found).transpose(2, 0, 1)
    return values, errors, np.array(whole)[:, 0]


def test_they_bring_no_bias_and_errors_that_are_smaller_and_true() -> None:
    values, errors, truth = runs()
    plain, plain_errors, _ = runs({})
    off = values - plain  # of the same paths: what the controls change has no mean
    for number, wide in enumerate(truth):
        mean = Estimate(
            value=wide + off[:, number].mean(),
            standard_error=off[:, number].std(ddof=1) / np.sqrt(RUNS),
        )
        assert_agrees(mean, wide)
        stated = np.sqrt(np.mean(errors[:, number] ** 2))
        # the truth is known to one run in RUNS
        spread = Estimate(
            value=values[:, number].std(ddof=1) / stated,
            standard_error=1.0 / np.sqrt(2.0 * RUNS),
        )
        assert_agrees(spread, 1.0)
    gains = np.mean(plain_errors**2, axis=0) / np.mean(errors**2, axis=0)
    assert (gains[:2] > 2.5).all()
    assert (gains[2:] > 1.5).all()


def test_the_error_is_that_of_a_regression_where_the_controls_are_as_expected() -> None:
    """The intercept of ordinary least squares on c - mu, and its standard error, which holds how
    far the mean of the controls is from mu."""
    random, paths = np.random.default_rng(8), 100
    control = random.normal(5.0, 0.5, (2, paths))
    mean = 1.5 * control[0] - control[1] + random.normal(0.0, 0.5, paths)
    rows = (("a", "x"), ("a", "c"), ("a", "d"))
    layout = Layout(rows=rows, origins={}, thresholds={}, controls={rows[1]: 4.6, rows[2]: 4.6})
    found = PathStatistics.of(np.vstack([mean, control]), layout)
    design = np.vstack([np.ones(paths), control - 4.6]).T
    inverse = np.linalg.inv(design.T @ design)
    fitted = inverse @ design.T @ mean
    left = np.sum((mean - design @ fitted) ** 2) / (paths - 3)
    value, error = found.evaluate(lambda means: means["a", "x"])
    assert value == pytest.approx(fitted[0], rel=1e-12)
    assert error == pytest.approx(np.sqrt(left * inverse[0, 0]), rel=1e-6)


def test_a_wrong_expected_value_is_noticed() -> None:
    plan, _ = paths_of(-2.0, 2.0)
    wrong = {key: 1.05 * value for key, value in plan.layout.controls.items()}
    values, _, truth = runs(wrong)
    error = values[:, 0].std(ddof=1) / np.sqrt(RUNS)
    assert_differs(Estimate(value=values[:, 0].mean(), standard_error=error), truth[0])


def test_passages_that_few_paths_have_are_left_alone() -> None:
    """A regression on one passage would make the error of the rate zero."""
    plan, averages = paths_of(-4.0, 4.0)
    row = plan.layout.rows.index(("stops", "n_upper"))
    some = averages[:, np.argsort(-averages[row])[[0, *range(200, 263)]]]
    found = PathStatistics.of(some, plan.layout)
    rate = of_pair("stops")["collision_rate_upper"]
    assert found.evaluate(rate)[0] > 0.0
    assert found.evaluate(rate)[1] == pytest.approx(found.uncontrolled.evaluate(rate)[1], rel=0.1)


def test_there_are_none_without_stops() -> None:
    free = scene(None, 1.0).replace(impact_pairs=[])
    assert not make_plan(model_of(free), None, None).layout.controls


# ---- noise against the state before it ---------------------------------------------------------

WHITE = {
    "rigid": oscillator(-1.0, 1.0, 0.5),
    "one gives way": load_scene(zoo_files()["spring-and-rigid"]),
    "slow impacts": oscillator(-1.0, 1.0, 0.2),
}


@cache
def white_paths(name: str) -> tuple[Plan, np.ndarray, np.ndarray]:
    """Averages of paths at the step and at twice the step."""
    plan = make_plan(model_of(WHITE[name]), None, None, slow_impacts=name == "slow impacts")
    paths = RUN * (8 if name == "slow impacts" else RUNS)
    return plan, plan.averages(7, 0, paths), plan.coarser().averages(7, 0, paths)


@pytest.mark.parametrize("name", WHITE)
def test_noise_is_independent_of_the_state_before_it(name: str) -> None:
    plan, fine, coarse = white_paths(name)
    assert set(plan.layout.controls.values()) == {0.0}
    for averages in (fine, coarse):
        for key in plan.layout.controls:
            sample = averages[plan.layout.rows.index(key)]
            error = sample.std(ddof=1) / np.sqrt(len(sample))
            assert_agrees(Estimate(value=sample.mean(), standard_error=error), 0.0)


@pytest.mark.parametrize(
    ("name", "gain", "left"), [("rigid", 6.0, 0.7), ("one gives way", 2.0, 0.95)]
)
def test_noise_makes_errors_smaller_and_true(name: str, gain: float, left: float) -> None:
    plan, averages, coarse = white_paths(name)
    known = of_pair(plan.model.pairs[0].name)["impact_speed_rate"]
    each = averages.reshape(len(averages), RUNS, RUN).swapaxes(0, 1)
    found = [PathStatistics.of(one, plan.layout) for one in each]
    values, errors = np.array([one.evaluate(known) for one in found]).T
    plain = np.array([one.uncontrolled.evaluate(known) for one in found])
    stated = np.sqrt(np.mean(errors**2))
    relative = 1.0 / np.sqrt(2.0 * RUNS)
    assert_agrees(Estimate(value=values.std(ddof=1) / stated, standard_error=relative), 1.0)
    changed = values - plain[:, 0]
    error = changed.std(ddof=1) / np.sqrt(RUNS)
    assert_agrees(Estimate(value=changed.mean(), standard_error=error), 0.0)
    assert np.mean(plain[:, 1] ** 2) > gain * stated**2
    # so does the difference to twice the step, from which the bias is known
    whole = PathStatistics.of(averages, plan.layout)
    pairs = StepPairs.of(np.concatenate([averages, coarse])[:, :1024], plan.layout)
    one = pairs.differences(lambda means: (known(means),), whole)[0]
    two = pairs.differences(lambda means: (known(means),), whole.uncontrolled)[0]
    assert one[1] < left * two[1]
    between = Estimate(value=one[0], standard_error=np.hypot(one[1], two[1]))
    assert_agrees(between, two[0])


def test_a_run_that_is_refined_expects_what_its_sampling_gives(tmp_path: Path) -> None:
    """A table up to high frequencies: its passages between samples depend on the sampling."""
    flat = TabulatedNoise(frequency_hz=[1e-3, 60.0], density=[0.4, 0.4], unit="N2/Hz")
    coloured = oscillator(-1.0, 1.0, 0.8).replace(excitations=[flat])
    kept = tmp_path / "run"
    refined = simulate(coloured, rel_error=0.005, seed=16, checkpoint=kept)
    assert len(Checkpoint.read(kept).samples) > 2  # pilots at two steps, and the answer
    whole = simulate(oscillator(-1.0, 1.0, 0.8), rel_error=0.005, seed=16)
    for name in ("collision_rate", "impact_speed_square_rate"):
        one, two = (each.impact_pairs["stops"][name] for each in (refined, whole))
        assert one.standard_error <= 0.0055 * one.value
        error = np.hypot(one.standard_error, two.standard_error)
        bias = one.bias + two.bias + 2.0 * (one.bias_error + two.bias_error)
        assert_agrees(Estimate(value=one.value, standard_error=error, bias=bias), two.value)
    again = simulate(coloured, resume=kept)
    assert again.to_dict()["impact_pairs"] == refined.to_dict()["impact_pairs"]


# ---- several masses ------------------------------------------------------------------------------

TABLE = TabulatedNoise(
    frequency_hz=[0.02, 0.1, 0.4, 1.0],
    density=[0.1, 1.0, 1.0, 0.1],
    unit="(m/s2)2/Hz",
    on="base",
)
WHITE_BASE = WhiteNoise(on="base", intensity=0.5)
SHAKEN = {
    "white noise": [WHITE_BASE],
    "a table": [TABLE],
    "a table and white noise": [TABLE, WHITE_BASE],
}

WIDE = 1.6
"""Distance of the stops, m."""

GROUP = 160
"""Paths of a run: 8 for each of the controls, of which there are 7 to 19."""

STUDENT = 1.976
"""Student's quantile for 95 % and some 150 degrees of freedom."""


def masses(shaken: str, *, soft: bool = False) -> Scene:
    """A small mass between stops some 2 standard deviations away on a large one."""
    law = Elastic(stiffness=20.0) if soft else Restitution(coefficient=0.5)
    return Scene(
        structure=Matrices(
            coordinates=["large", "small"],
            mass=[[1.0, 0.0], [0.0, 0.2]],
            damping=[[0.5, -0.1], [-0.1, 0.1]],
            stiffness=[[1.3, -0.3], [-0.3, 0.3]],
        ),
        impact_pairs=[
            ImpactPair(name="stops", between=["small", "large"], clearance=WIDE, law=law)
        ],
        excitations=SHAKEN[shaken],
    )


@cache
def paths_of_masses(shaken: str, groups: int, soft: bool = False) -> tuple[Plan, np.ndarray]:
    plan = make_plan(model_of(masses(shaken, soft=soft)))
    parts = [plan.averages(8, GROUP * group, GROUP) for group in range(groups)]
    return plan, np.concatenate(parts, axis=1)


def known_of_masses(means: Means) -> list[float]:
    """Deviations of both masses, then the rate, F1 and F2 of the pair."""
    known = [
        of_coordinate(name)[what](means)
        for name in ("large", "small")
        for what in ("displacement_std", "velocity_std")
    ]
    names = "collision_rate", "impact_speed_rate", "impact_speed_square_rate"
    return [*known, *(of_pair("stops")[what](means) for what in names)]


@pytest.mark.parametrize(
    ("shaken", "soft", "controls"),
    [("white noise", False, 7), ("a table", False, 12), ("a table and white noise", True, 19)],
)
def test_controls_of_masses_have_the_values_that_are_expected_of_them(
    shaken: str, soft: bool, controls: int
) -> None:
    plan, averages = paths_of_masses(shaken, 2, soft)
    assert len(plan.layout.controls) == controls
    for one, found in ((plan, averages), (plan.coarser(), plan.coarser().averages(9, 0, GROUP))):
        for key, expected in one.layout.controls.items():
            sample = found[one.layout.rows.index(key)]
            error = sample.std(ddof=1) / np.sqrt(len(sample))
            assert_agrees(Estimate(value=sample.mean(), standard_error=error), expected)


@pytest.mark.parametrize("groups", [24, pytest.param(240, marks=pytest.mark.verify)])
@pytest.mark.parametrize("shaken", ["white noise", "a table"])
def test_intervals_of_masses_hold_the_truth_as_often_as_they_state(
    shaken: str, groups: int
) -> None:
    plan, averages = paths_of_masses(shaken, groups)
    each = [PathStatistics.of(part, plan.layout) for part in np.split(averages, groups, axis=1)]
    answers = np.array([one.evaluate_all(known_of_masses) for one in each])
    plain_answers = np.array([one.uncontrolled.evaluate_all(known_of_masses) for one in each])
    (values, errors), (plain, plain_errors) = answers.T, plain_answers.T
    truth = known_of_masses(PathStatistics.of(averages, plan.layout).means())
    changed = values - plain
    for number, value in enumerate(truth):
        bias = changed[number].mean()
        error = changed[number].std(ddof=1) / np.sqrt(groups)
        assert_agrees(Estimate(value=bias, standard_error=error), 0.0)
        held = np.abs(values[number] - value) < STUDENT * errors[number]
        share = Estimate(value=held.mean(), standard_error=np.sqrt(0.05 * 0.95 / groups))
        assert_agrees(share, 0.95)
    assert (np.mean(plain_errors**2, axis=1) > 3.0 * np.mean(errors**2, axis=1)).all()


@pytest.mark.parametrize("shaken", ["white noise", "a table"])
def test_controls_of_masses_about_a_wrong_centre_are_noticed(shaken: str) -> None:
    plan, averages = paths_of_masses(shaken, 24)
    rows = [plan.layout.rows.index(key) for key in plan.layout.controls]
    moved = averages.copy()
    moved[rows] += 0.2 * averages[rows].std(axis=1, keepdims=True)
    for sample, noticed in ((averages, False), (moved, True)):
        found = PathStatistics.of(sample, plan.layout)
        known = of_coordinate("small")["velocity_std"]
        (value, error), (plain, wider) = found.evaluate(known), found.uncontrolled.evaluate(known)
        assert (abs(value - plain) > 4.0 * np.hypot(error, wider)) == noticed


def test_few_paths_use_few_controls() -> None:
    plan, averages = paths_of_masses("a table", 24)
    for paths, used in ((48, 0), (64, 8), (640, 12)):
        found = PathStatistics.of(averages[:, :paths], plan.layout)
        assert len(found.regression[0]) == used


# ---- what they cost ------------------------------------------------------------------------------

ZOO = zoo_files()
CONTROLLED = [
    *(
        name
        for name in ZOO
        if not name.startswith(("filtered", "road", "record", "psd-truck-linear"))
    ),
    "rigid-box",
]
"""Scenes of every kind that have controls."""

OFTEN = ("lossy-0.5", "elastic-overdamped", "elastic-three-sigma", "psd-own-table")
"""Scenes that are quick, those that gain least among them."""


def price_of_controls(plan: Plan) -> float:
    """CPU time of a path with controls over that without them, as study 02 measures it: 0.3 ns of a
    step of 5 ns; a tenth of a path under a table; a fifth of one of several masses."""
    if len(plan.model.coordinates) > 1:
        return 1.2
    return 1.1 if plan.model.tables else 1.06


@quick_cases(
    "name", CONTROLLED, keep=[number for number, each in enumerate(CONTROLLED) if each in OFTEN]
)
def test_controls_pay_for_the_quantity_that_an_accuracy_waits_for(name: str) -> None:
    """They doubled the price of a step for mean squares that they made 1.0 to 1.6 times cheaper."""
    file = shipped_scene(name) if name == "rigid-box" else ZOO[name]
    plan = make_plan(model_of(load_scene(file)))
    parts = [plan.averages(3, first, plan.block) for first in range(0, 3000, plan.block)]
    assert plan.layout.controls
    found = PathStatistics.of(np.concatenate(parts, axis=1), plan.layout)
    # the accuracy waits for the largest error of all quantities, with controls or without
    plain, controlled = (
        max(relative_standard_errors(SimpleNamespace(fine=each, model=plan.model)).values())  # type: ignore[arg-type]
        for each in (found.uncontrolled, found)
    )
    gain = (plain / controlled) ** 2
    # an overdamped mass takes 4 % longer with them
    assert gain > 0.95 * price_of_controls(plan)
    # the negative control: at twice the price, as it was, some scenes would lose
    if name in ("elastic-overdamped", "elastic-three-sigma", "psd-below-table"):
        assert gain < 2.0
