"""The engine against a second Monte Carlo that shares nothing with it (`bridge.py`)."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stochvi import Estimate, ImpactPair, NotConverged, Restitution, exact, simulate
from stochvi.testing import assert_agrees
from support.bridge import (
    F1_LOWER,
    F2_LOWER,
    N_LOWER,
    OUT_OF_REACH,
    SAFE,
    VV,
    XX,
    Bridge,
    X,
    covariance,
    judge,
    transition,
)
from support.known import RIGID_STOPS, RigidStops, oscillator, values

SECOND_STOP = 3
"""Rows from a quantity of the lower stop to that of the upper."""

STEP = 0.2
"""Of the bridge, in the shortest of 1 / omega, 1 / b and the time to cross a gap to and fro."""

BURN_IN = 6.0
"""Times in which the oscillator without stops settles; a path counts at least twice as long."""

PATHS = 64
"""Of the bridge: enough for a standard error that 4.5 of them can be trusted with."""

Means = dict[str, float]
QUANTITIES: dict[str, Callable[[Means], float]] = {
    "displacement_std": lambda m: math.sqrt(m["xx"] - m["x"] ** 2),
    "velocity_std": lambda m: math.sqrt(m["vv"]),
    "collision_rate": lambda m: m["rate"],
    "impact_speed_rate": lambda m: m["f1"],
    "impact_speed_square_rate": lambda m: m["f2"],
}


def estimates(averages: np.ndarray) -> dict[str, Estimate]:
    """Functions of the means of independent paths, with jackknife errors."""
    rows = {"x": averages[X], "xx": averages[XX], "vv": averages[VV]} | {
        name: averages[row] + averages[row + SECOND_STOP]
        for name, row in (("rate", N_LOWER), ("f1", F1_LOWER), ("f2", F2_LOWER))
    }
    paths = averages.shape[1]
    found = {}
    for name, quantity in QUANTITIES.items():
        value = quantity({row: float(samples.mean()) for row, samples in rows.items()})
        left_out = [
            quantity({row: (s.sum() - s[path]) / (paths - 1) for row, s in rows.items()})
            for path in range(paths)
        ]
        error = math.sqrt((paths - 1) * float(np.var(left_out)))
        found[name] = Estimate(value=value, standard_error=error, how=f"{paths} paths")
    return found


def by_bridge(
    case: dict[str, Any],
    restitution: float,
    steps: float,
    seed: int,
    *,
    threshold: float = 0.0,
    step: float = STEP,
    tilt: bool = True,
) -> dict[str, Estimate]:
    """The bridge's answer for a case of `oscillator`, in so many steps of all paths together."""
    omega, b = case.get("omega", 1.0), case.get("damping", 0.1)
    intensity = case.get("intensity", 0.2)
    to_and_fro = 0.0
    if case["lower"] is not None and case["upper"] is not None:
        to_and_fro = math.sqrt(intensity / (2.0 * b)) / (2.0 * (case["upper"] - case["lower"]))
    step /= max(omega, b, to_and_fro)
    bridge = Bridge(
        damping_rate=b,
        stiffness=omega**2,
        intensity=intensity,
        load=case.get("load", 0.0),
        lower=-math.inf if case["lower"] is None else case["lower"],
        upper=math.inf if case["upper"] is None else case["upper"],
        restitution_lower=restitution,
        restitution_upper=restitution,
        threshold=threshold,
        step=step,
        tilt=tilt,
    )
    burn_in = BURN_IN * max(1.0 / b, b / omega**2)
    duration = max(steps * step / PATHS, 2.0 * burn_in)
    return estimates(bridge.averages(seed, PATHS, duration, burn_in))


def apart(one: Estimate, other: Estimate, bias: float) -> Estimate:
    """Difference of independent estimates, which should be 0."""
    return Estimate(
        value=one.value - other.value,
        standard_error=math.hypot(one.standard_error, other.standard_error),
        bias=bias,
    )


# ---- the formulas of the bridge --------------------------------------------------------------


def conditioned(share: float, length: float, b: float, k: float) -> tuple[np.ndarray, np.ndarray]:
    """Exact law of the state at share * length, given both ends: weights of the ends, covariance.

    Linear Gaussian conditioning; x in units of the length, so that matrices are well scaled.
    """
    scale = np.diag([1.0 / length, 1.0])
    unscale = np.diag([length, 1.0])
    (before, root_before), (after, root_after) = (
        transition(b, k, 1.0, part * length) for part in (share, 1.0 - share)
    )
    before, after = scale @ before @ unscale, scale @ after @ unscale
    noise_before, noise_after = (
        scale @ root @ root.T @ scale / length for root in (root_before, root_after)
    )
    gain = noise_before @ after.T @ np.linalg.inv(after @ noise_before @ after.T + noise_after)
    weights = np.hstack([before - gain @ after @ before, gain])
    return weights, noise_before - gain @ after @ noise_before


@pytest.mark.parametrize("share", [0.1, 0.5, 0.7])
@pytest.mark.parametrize(("b", "k"), [(0.1, 1.0), (10.0, 1.0), (0.0, 0.0), (2.0, 1.0)])
def test_bridge_is_the_limit_of_exact_conditioning(share: float, b: float, k: float) -> None:
    """The error falls with the length at first order or better, to rounding for b = k = 0."""

    def errors(length: float) -> tuple[float, float]:
        weights, exactly = conditioned(share, length, b, k)
        xx, xv, vv = covariance(share * length, (1.0 - share) * length, 1.0)
        found = np.array([[xx / length**2, xv / length], [xv / length, vv]]) / length
        s = share
        hermite = np.array(
            [
                [1 - 3 * s**2 + 2 * s**3, s - 2 * s**2 + s**3, 3 * s**2 - 2 * s**3, s**3 - s**2],
                [-6 * s + 6 * s**2, 1 - 4 * s + 3 * s**2, 6 * s - 6 * s**2, 3 * s**2 - 2 * s],
            ]
        )
        return float(np.abs(found - exactly).max()), float(np.abs(hermite - weights).max())

    lengths = [0.08 / max(b, 1.0), 0.04 / max(b, 1.0), 0.02 / max(b, 1.0)]
    first, second, third = (np.array(errors(length)) for length in lengths)
    rounding = 1e-12
    assert np.all((second <= 0.55 * first) | (second < rounding))
    assert np.all((third <= 0.55 * second) | (third < rounding))


def test_an_interval_called_safe_is_out_of_reach() -> None:
    """Least distance over deviation on a grid of times, against what `judge` promises."""
    rng = np.random.default_rng(1)
    length, intensity = 0.3, 0.2
    s = np.linspace(0.0, 1.0, 401)[1:-1]
    deviation = np.sqrt([covariance(t, length - t, intensity)[0] for t in length * s])
    safe = 0
    for gap0, gap1, v0, v1 in rng.uniform(0, 1, (4000, 4)) * [0.4, 0.4, 3.0, 3.0] - [0, 0, 2, 1]:
        if judge(gap0, v0, gap1, v1, length, intensity)[0] != SAFE:
            continue
        safe += 1
        distance = (1 - 3 * s**2 + 2 * s**3) * gap0 + (3 * s**2 - 2 * s**3) * gap1
        distance -= length * ((s - 2 * s**2 + s**3) * v0 + (s**3 - s**2) * v1)
        assert np.all(distance >= OUT_OF_REACH * deviation)
    assert safe > 500


# ---- the bridge against exact and near-exact numbers -----------------------------------------

ELASTIC = {
    "equal gaps": {"lower": -1.0, "upper": 1.0},
    "unequal gaps": {"lower": -0.5, "upper": 1.0},
    "one stop": {"lower": None, "upper": 1.0},
    "preload": {"lower": None, "upper": -1.0},
    "preload and load": {"lower": -1.0, "upper": 0.3, "load": 0.8},
    "load": {"lower": -0.5, "upper": 1.0, "load": 0.4},
    "small gap": {"lower": -0.05, "upper": 0.05},
    "overdamped": {"lower": -0.5, "upper": 0.8, "damping": 10.0, "intensity": 20.0},
}


@pytest.mark.parametrize(
    "steps", [1e5, pytest.param(2e7, marks=pytest.mark.verify)], ids=["short", "long"]
)
@pytest.mark.parametrize("case", ELASTIC.values(), ids=ELASTIC.keys())
def test_bridge_agrees_with_the_exact_law_of_elastic_stops(case: dict, steps: float) -> None:
    truth = values(exact(oscillator(**case, restitution=1.0)))
    for name, found in by_bridge(case, 1.0, steps, seed=1).items():
        assert_agrees(found, truth[name])


@pytest.mark.parametrize(
    "steps", [1e6, pytest.param(2e7, marks=pytest.mark.verify)], ids=["short", "long"]
)
@pytest.mark.parametrize("row", RIGID_STOPS, ids=lambda row: f"R={row.restitution:g}")
def test_bridge_agrees_with_near_exact_numbers(row: RigidStops, steps: float) -> None:
    for name, found in by_bridge({"lower": -1.0, "upper": 1.0}, row.restitution, steps, 2).items():
        assert_agrees(found, row.values[name])


def test_bridge_without_its_tilt_is_caught() -> None:
    case = {"lower": -1.0, "upper": 1.0}
    truth = values(exact(oscillator(**case)))
    right, wrong = (
        by_bridge(case, 1.0, 3e6, seed=3, step=0.4, tilt=tilt) for tilt in (True, False)
    )
    for name in ("velocity_std", "collision_rate", "impact_speed_rate"):
        assert_agrees(right[name], truth[name])
        with pytest.raises(AssertionError, match="standard errors"):
            assert_agrees(wrong[name], truth[name])


# ---- the engine against the bridge -----------------------------------------------------------

UNPUBLISHED = {
    "unequal gaps": {"lower": -0.5, "upper": 1.0},
    "one stop": {"lower": None, "upper": 0.5},
    "preload": {"lower": None, "upper": -0.5},
    "preload and load": {"lower": -1.0, "upper": 0.3, "load": 0.8},
    "small gap": {"lower": -0.05, "upper": 0.05},
    "overdamped": {"lower": -0.5, "upper": 0.8, "damping": 10.0, "intensity": 20.0},
    "light damping": {"lower": -1.0, "upper": 1.5, "damping": 0.01, "intensity": 0.02},
}

LONG = {"preload", "preload and load", "small gap", "overdamped"}
"""Cases whose mass meets its stops all the time at R = 0, for which the bridge takes long."""


def compare(
    case: dict, restitution: float, steps: float, rel_error: float | None, paths: int | None = None
) -> dict[str, Estimate]:
    """Engine less bridge; rates of which the engine states no bias are left out. A number of paths
    is simulated at the step that the engine begins with."""
    scene = oscillator(**case, restitution=restitution)
    try:
        response = simulate(scene, rel_error=rel_error, paths=paths, seed=5, budget=None)
    except NotConverged as refusal:
        # after impacts that take all speed, the bias falls with the root of the step only
        if restitution > 0.0 or refusal.response is None:
            raise
        response = refusal.response
    engine = {name: estimate for (_, name), estimate in response.estimates().items()}
    threshold = response.impact_pairs["stops"]["speed_threshold"]
    assert isinstance(threshold, float)
    bridge = by_bridge(case, restitution, steps, 6, threshold=threshold)
    found = {}
    for name in QUANTITIES:
        bias = engine[name].bias
        if bias is not None:
            found[name] = apart(engine[name], bridge[name], bias)
    return found


@pytest.mark.parametrize(
    ("case", "restitution"),
    [
        pytest.param(
            case, restitution, id=f"{name}-{restitution}",
            marks=[pytest.mark.verify] if restitution == 0.0 and name in LONG else [],
        )
        for name, case in UNPUBLISHED.items()
        for restitution in (0.8, 0.5, 0.2, 0.0)
    ],
)  # fmt: skip
def test_engine_agrees_with_bridge(case: dict, restitution: float) -> None:
    # a mass that sticks to a stop meets it all the time
    steps = 2e5 if restitution >= 0.5 else 2e4
    for difference in compare(case, restitution, steps, 0.04).values():
        assert_agrees(difference, 0.0)


def test_engine_agrees_with_bridge_on_stops_of_different_restitution() -> None:
    laws = {
        "lower_law": Restitution(coefficient=0.9),
        "upper_law": Restitution(coefficient=0.5),
    }
    pair = ImpactPair(lower=-0.5, upper=1.0, **laws)
    scene = oscillator(-0.5, 1.0).model_copy(update={"impact_pairs": (pair,)})
    response = simulate(scene, rel_error=0.01, seed=7)
    engine = {name: estimate for (_, name), estimate in response.estimates().items()}
    threshold = response.impact_pairs["stops"]["speed_threshold"]
    bridge = Bridge(
        lower=-0.5, upper=1.0, restitution_lower=0.9, restitution_upper=0.5, threshold=threshold
    )
    for name, found in estimates(bridge.averages(8, PATHS, 2000.0, 60.0)).items():
        assert_agrees(apart(engine[name], found, engine[name].bias), 0.0)


@pytest.mark.verify
@pytest.mark.parametrize("restitution", [0.8, 0.5, 0.2, 0.0])
@pytest.mark.parametrize("case", UNPUBLISHED.values(), ids=UNPUBLISHED.keys())
def test_engine_agrees_with_bridge_closely(case: dict, restitution: float) -> None:
    steps = 1e7 if restitution >= 0.5 else 2e6
    for difference in compare(case, restitution, steps, 0.003).values():
        assert_agrees(difference, 0.0)


@pytest.mark.verify
@pytest.mark.parametrize(
    ("scene", "restitution", "name"),
    [
        ("one stop", 0.0, "impact_speed_rate"),
        ("small gap", 0.5, "collision_rate"),
    ],
)
def test_stated_bias_of_the_engine_covers_slow_impacts(
    scene: str, restitution: float, name: str
) -> None:
    """Where a bias of second order, a third of the difference to twice the step, would not."""
    difference = compare(UNPUBLISHED[scene], restitution, 2e6, None, paths=16384)[name]
    assert_agrees(difference, 0.0)
    assert difference.bias is not None
    of_second_order = (math.sqrt(2.0) - 1.0) / 3.0 * difference.bias
    with pytest.raises(AssertionError, match="standard errors"):
        assert_agrees(replace(difference, bias=of_second_order), 0.0)
