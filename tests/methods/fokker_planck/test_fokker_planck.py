"""Half-range Galerkin: known answers, bounds on the error that hold, and wrong equations caught."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from stochvi import (
    ConstantLoad,
    Estimate,
    ImpactPair,
    NotApplicable,
    NotConverged,
    Oscillator,
    Response,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    exact,
    fokker_planck,
    simulate,
    transient,
)
from stochvi.methods.closed_form import exact_density
from stochvi.methods.fokker_planck import (
    density,
    fokker_planck_density,
    fokker_planck_many,
    stationary,
)
from stochvi.methods.fokker_planck.basis import Mesh, VelocityCells, boxes_of
from stochvi.methods.fokker_planck.density import Averages, StripDensity
from stochvi.methods.fokker_planck.motion import Motion, scaled_motion
from stochvi.methods.fokker_planck.stationary import (
    LEVELS,
    MeshMoments,
    Solution,
    errors,
    make_level,
    solve,
    unreached,
)
from stochvi.model.gap import OscillatorArrays
from stochvi.model.model import model_of
from stochvi.results import NoExactSolution
from stochvi.scenes import NonlinearOscillator
from stochvi.testing import assert_agrees
from support.accuracies import assert_differs, quick_cases
from support.known import BENCH, ELASTIC_STOPS, NATURAL, RIGID_STOPS, RigidStops, oscillator, values
from support.weighted_ensemble import rates_above

LOSSY_ROWS = [row for row in RIGID_STOPS if row.restitution < 1.0]
SHARP = ("displacement_std", "velocity_std", "impact_speed_rate", "impact_speed_square_rate")


def governed(response: Response) -> Iterator[tuple[str, Estimate]]:
    for (_, name), estimate in response.estimates().items():
        if name in SHARP:
            yield name, estimate


# Known answers ------------------------------------------------------------------------------


def assert_table_row(row: RigidStops, rtol: float) -> None:
    response = fokker_planck(oscillator(-1.0, 1.0, row.restitution), rtol=rtol)
    for name, estimate in governed(response):
        assert estimate.bias is not None
        assert estimate.bias <= rtol * estimate.value
        allowed = replace(estimate, bias=estimate.bias + row.errors[name])
        assert_agrees(allowed, row.values[name])


@pytest.mark.parametrize("rtol", [0.01, 0.0005])
@pytest.mark.parametrize("row", LOSSY_ROWS, ids=lambda row: f"R={row.restitution}")
def test_the_near_exact_table_is_met_within_the_stated_bias(row: RigidStops, rtol: float) -> None:
    assert_table_row(row, rtol)


@pytest.mark.parametrize("row", LOSSY_ROWS, ids=lambda row: f"R={row.restitution}")
def test_a_wrong_restitution_at_the_wall_is_caught(
    row: RigidStops, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = VelocityCells.returned
    monkeypatch.setattr(
        VelocityCells, "returned", lambda self, r, side: right(self, r - 0.01, side)
    )
    with pytest.raises(AssertionError, match="differs from"):
        assert_table_row(row, 0.01)


ELASTIC = [oscillator(row.lower, row.upper) for row in ELASTIC_STOPS] + [
    oscillator(None, None, load=0.3),
    oscillator(-0.4, 1.3, load=-0.7, damping=0.02, intensity=0.05),
    oscillator(-1.0, 1.0, load=0.5, omega=0.0),
    oscillator(-1.0, 1.0, omega=0.0, damping=5.0, intensity=1.0),
    oscillator(-1.0, None, load=-1.0, omega=0.0),
    oscillator(-0.02, 0.02),
    oscillator(-3.0, 4.5, units=BENCH),
    oscillator(-2.0, None, units=BENCH, load=-2.5),
]


@pytest.mark.parametrize("scene", ELASTIC, ids=range(len(ELASTIC)))
def test_elastic_stops_agree_with_the_closed_form(scene: Scene) -> None:
    known = exact(scene).estimates()
    found = fokker_planck(scene, rtol=0.002).estimates()
    assert found.keys() >= known.keys() - {("x", "acceleration_std")}
    for key, estimate in found.items():
        assert_agrees(estimate, known[key].value)


def general(load: float = -0.2) -> Scene:
    """Different stops, a load, no symmetry."""
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[
            ImpactPair(
                lower=-0.6,
                upper=1.1,
                lower_law=Restitution(coefficient=0.7),
                upper_law=Restitution(coefficient=0.4),
            )
        ],
        excitations=[WhiteNoise(intensity=0.2), ConstantLoad(force=load)],
    )


UNPUBLISHED = {
    "unequal gaps": {"lower": -0.5, "upper": 1.0},
    "one stop": {"lower": None, "upper": 0.5},
    "preload": {"lower": None, "upper": -0.5},
    "preload and load": {"lower": -1.0, "upper": 0.3, "load": 0.8},
    "small gap": {"lower": -0.05, "upper": 0.05},
    "overdamped": {"lower": -0.5, "upper": 0.8, "damping": 10.0, "intensity": 20.0},
    "light damping": {"lower": -1.0, "upper": 1.5, "damping": 0.01, "intensity": 0.02},
}

LAWS = {"lower_law": Restitution(coefficient=0.9), "upper_law": Restitution(coefficient=0.5)}
SIMULATED = {
    "different stops": general(),
    "different stops, 0.9 and 0.5": oscillator().replace(
        impact_pairs=[ImpactPair(lower=-0.5, upper=1.0, **LAWS)]
    ),
    "a stop before rest": oscillator(None, -0.3, 0.6),
} | {
    f"{name}, {restitution}": oscillator(**case, restitution=restitution)
    for name, case in UNPUBLISHED.items()
    for restitution in (0.8, 0.5, 0.2, 0.0)
}


def differences(scene: Scene, **how: Any) -> dict[tuple[str, str], Estimate]:
    """Simulation less solution, of all quantities whose bias the simulation knows."""
    try:
        simulated = simulate(scene, seed=11, budget=None, **how)
    except NotConverged as short:
        # after impacts that take all speed, the bias falls with the root of the step only
        if short.partial is None or scene.impact_pairs[0].law.restitution > 0.0:
            raise
        simulated = short.partial
    threshold = simulated.impact_pairs["stops"]["speed_threshold"]
    solved = fokker_planck(scene, rtol=0.001, speed_threshold=threshold).estimates()
    found = simulated.estimates()
    assert {name for _, name in found.keys() & solved.keys()} >= {*SHARP, "displacement_mean"}
    return {
        key: replace(
            found[key], value=found[key].value - solved[key].value,
            bias=found[key].bias + solved[key].bias,
        )
        for key in found.keys() & solved.keys()
        if found[key].bias is not None and solved[key].bias is not None
    }  # fmt: skip


@pytest.mark.parametrize(
    ("name", "rel_error"),
    [
        pytest.param(name, error, marks=marks)
        for name in SIMULATED
        for error, marks in (
            (0.04 if name.partition(",")[0] in UNPUBLISHED else 0.01,
             [pytest.mark.slow] * name.endswith(".0")),
            (0.003, [pytest.mark.verify]),
        )
    ],
)  # fmt: skip
def test_simulation_agrees(name: str, rel_error: float) -> None:
    found = differences(SIMULATED[name], rel_error=rel_error)
    assert len(found) >= 6
    if name.endswith((".8", ".5")) and "preload" not in name:  # few impacts are slow
        assert {key for _, key in found} >= {*SHARP, "collision_rate"}
    for difference in found.values():
        assert_agrees(difference, 0.0)


@pytest.mark.verify
@pytest.mark.parametrize(
    ("name", "quantity"),
    [("one stop, 0.0", "impact_speed_rate"), ("small gap, 0.5", "collision_rate")],
)
def test_the_stated_bias_of_a_simulation_covers_slow_impacts(name: str, quantity: str) -> None:
    """Where a bias of second order, a third of the difference to twice the step, would not."""
    difference = differences(SIMULATED[name], paths=16384)["stops", quantity]
    assert_agrees(difference, 0.0)
    of_second_order = (math.sqrt(2.0) - 1.0) / 3.0 * difference.bias
    assert_differs(replace(difference, bias=of_second_order), 0.0)


# Symmetries ---------------------------------------------------------------------------------


def test_a_halved_scene_is_the_whole_one() -> None:
    """A stop moved by 1e-9 breaks the symmetry, and the scene is solved whole."""
    half, whole = (
        fokker_planck(oscillator(-1.0, upper, 0.7), rtol=0.001) for upper in (1.0, 1.0 + 1e-9)
    )
    assert half.coordinates["x"]["displacement_mean"] != whole.coordinates["x"]["displacement_mean"]
    for key, estimate in half.estimates().items():
        other = whole.estimates()[key]
        assert estimate.bias is not None and other.bias is not None
        assert_agrees(replace(estimate, bias=estimate.bias + other.bias), other.value)


@pytest.mark.parametrize("upper", [1.1, None])
def test_a_mirrored_scene_has_the_mirrored_answer(upper: float | None) -> None:
    stops = {"lower": -0.6, "upper": upper} if upper else {"lower": -0.6}
    mirrored = {"upper": 0.6, "lower": -upper} if upper else {"upper": 0.6}
    columns = {"omega": 1.0, "damping_rate": 0.1, "intensity": 0.2}
    found = fokker_planck_many(
        **columns, **stops, load=0.1, restitution_lower=0.7, restitution_upper=0.4
    ).values
    other = fokker_planck_many(
        **columns, **mirrored, load=-0.1, restitution_lower=0.4, restitution_upper=0.7
    ).values
    for name, value in found._asdict().items():
        twin = name
        if name.endswith("_lower"):
            twin = name.replace("_lower", "_upper")
        elif name.endswith("_upper"):
            twin = name.replace("_upper", "_lower")
        sign = -1.0 if name == "mean" else 1.0
        assert value == pytest.approx(sign * getattr(other, twin), rel=1e-9, abs=1e-12), name


def test_the_width_of_the_trial_law_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Weight, box and mesh widen with it for a mass that leans on a stop; the answer must not."""
    scene = oscillator(None, -0.5, 0.5)
    wide = fokker_planck(scene, rtol=0.003, speed_threshold=0.2).estimates()
    monkeypatch.setattr("stochvi.methods.fokker_planck.basis.PRESSING_THRESHOLD", 0.0)
    narrow = fokker_planck(scene, rtol=0.003, speed_threshold=0.2).estimates()
    for key, estimate in narrow.items():
        other = wide[key]
        assert estimate.bias is not None and other.bias is not None
        assert_agrees(replace(estimate, bias=estimate.bias + other.bias), other.value)


def test_units_change_no_digit() -> None:
    answers = []
    for units in (NATURAL, BENCH):
        response = fokker_planck(oscillator(-0.7, 1.2, 0.6, load=0.2, units=units), rtol=0.01)
        answers.append({name: x / units.factor(name) for name, x in values(response).items()})
    assert answers[0] == pytest.approx(answers[1], rel=1e-9)


# The equation itself ------------------------------------------------------------------------


@quick_cases("restitution", [0.0, 0.3, 0.85, 1.0], keep=(1, 3))
def test_wall_integrals_against_adaptive_quadrature(restitution: float) -> None:
    cells = VelocityCells((-5.0, -2.0, -0.7, 0.0, 0.7, 2.0, 5.0), 3)
    given = {side: cells.returned(np.array([restitution]), side)[0] for side in (-1, 1)}

    def integral(k: int, trial: int, side: int) -> float:
        def integrand(w: float) -> float:
            left, came = cells.values([-side * restitution * w, side * w])
            return w * math.exp(-w * w / 2.0) * float(left[k] * came[trial])

        kinks = [0.7, 2.0, *(x / restitution for x in (0.7, 2.0) if x < 5.0 * restitution)]
        return quad(integrand, 0.0, 5.0, points=sorted(set(kinks)), epsabs=1e-12)[0]

    for side in (-1, 1):
        arriving, inward = (cells.plus, cells.minus) if side > 0 else (cells.minus, cells.plus)
        for k in (0, 1, 2, 5):
            for trial in (0, 1, 4, 8):
                expected = integral(inward[k], arriving[trial], side)
                assert given[side][k, trial] == pytest.approx(expected, abs=1e-10)


def test_probability_is_conserved_by_the_discrete_equations() -> None:
    """phi = 1 makes every equation's sum vanish, whatever the density: stops only give back."""
    mesh = Mesh(x_breaks=(-1.0, 1.0), x_degree=4, u_breaks=(0.0, 1.0, 5.0), u_degree=4)
    scenes = one_scene(lower=-1.0, upper=0.5, restitution_lower=0.3, restitution_upper=0.8)
    scaled = boxes_of(scenes, scenes.speed_scale(), mesh.reach)
    element = mesh.displacement[0]
    whole = stationary._with_walls(
        scaled,
        element,
        mesh.velocity,
        stationary._stop(scaled, mesh, -1),
        stationary._stop(scaled, mesh, 1),
    )[0]
    velocity = mesh.velocity
    one = np.zeros((element.size, velocity.size))
    one[0, : velocity.vertices] = 1.0
    # the functions at U and beside 0 are 1 together at every u
    assert np.abs(one.ravel() @ whole).max() < 1e-12 * np.abs(whole).max()


def test_impacts_that_noise_turns_within_the_last_element_are_unresolved() -> None:
    """Noise alone changes a speed w over the distance w^3 / diffusion: of arrivals at an end, those
    slower than that of the length of the last element are unresolved."""
    mesh = Mesh(
        x_breaks=(-1.0, 0.2, 0.9, 1.0), x_degree=4, u_breaks=(0.0, 0.4, 1.0, 5.0), u_degree=4
    )
    scenes = one_scene(lower=-1.0, upper=0.5, restitution_lower=0.3, restitution_upper=0.8)
    scaled = boxes_of(scenes, scenes.speed_scale(), mesh.reach)
    threshold = np.array([0.02])
    found = stationary.box_moments(scaled, mesh, threshold)
    for side, length in (("left", 1.2), ("right", 0.1)):
        turned = (scaled.diffusion * length) ** (1.0 / 3.0)
        fast = stationary.box_moments(scaled, mesh, turned)
        slow = getattr(found, f"rate_{side}") - getattr(fast, f"rate_{side}")
        assert slow > 0.0
        assert getattr(found, f"unresolved_{side}") == pytest.approx(slow, rel=1e-9)


@pytest.mark.parametrize("scene", [general(), oscillator(-1.0, 1.0, 0.0), oscillator(None, 0.4)])
def test_balances_hold_within_their_bounds(scene: Scene) -> None:
    response = fokker_planck(scene)
    assert set(response.identities) == {"energy", "virial", "force"}
    for residual in response.identities.values():
        assert residual.bias is not None and residual.bias < 0.05
        assert_agrees(residual, 0.0)


# Bounds on the error ------------------------------------------------------------------------


def one_scene(**changes: float) -> OscillatorArrays:
    plain = {
        "omega": 1.0, "damping_rate": 0.1, "intensity": 0.2, "load": 0.0, "lower": -math.inf,
        "upper": math.inf, "restitution_lower": 1.0, "restitution_upper": 1.0,
    }  # fmt: skip
    return OscillatorArrays.broadcast(**plain | changes).flat()


def random_scenes(count: int, seed: int) -> dict[str, np.ndarray]:
    """Damping ratios .002 to .6, gaps .2 to 5 and preloads to 2 standard deviations, R 0 to 1."""
    rng = np.random.default_rng(seed)
    damping = 2.0 * np.exp(rng.uniform(math.log(0.002), math.log(0.6), count))
    gap, other = np.exp(rng.uniform(math.log(0.2), math.log(5.0), (2, count)))
    kind = np.arange(count) % 5
    upper = np.where(kind < 3, gap, np.where(kind == 3, 7.0 * rng.random(count) - 2.0, -other / 3))
    lower = np.where(kind < 2, -gap, np.where(kind == 2, -other, -math.inf))
    r_lower, r_upper = rng.random((2, count))
    return {
        "omega": np.ones(count), "damping_rate": damping, "intensity": 2.0 * damping,
        "lower": lower, "upper": upper,
        "restitution_lower": np.where(kind < 2, r_upper, np.where(kind == 2, r_lower, 1.0)),
        "restitution_upper": r_upper,
    }  # fmt: skip


RANDOM = OscillatorArrays.broadcast(**random_scenes(30, seed=4))
FINE = make_level(
    (-0.45, 0.0, 0.3, 0.5, 0.7, 0.84, 0.93, 0.975, 0.993, 0.999),
    (0.3, 0.6, 0.82, 0.93, 0.98, 0.996, 0.9993), 4,
    (0.0, 0.1, 0.4, 0.9, 1.5, 2.1, 2.8, 3.8, 7.0), 5,
)  # fmt: skip


@pytest.fixture(scope="module")
def levels_and_fine() -> list[Solution]:
    """The three coarsest levels, and one that is some fifty times finer in cost."""
    speed = RANDOM.speed_scale()
    return [solve(RANDOM, speed, level, 0.05 * speed) for level in (*LEVELS[:3], FINE)]


def bounds_and_errors(solutions: list[Solution]) -> tuple[MeshMoments, MeshMoments]:
    """Bounds on the errors of the third level, and these errors."""
    coarser, coarse, fine, truth = solutions
    speed = RANDOM.speed_scale()
    far = unreached(RANDOM, speed, fine.moments.upcrossing_rate)
    bounds = errors(RANDOM, [coarser.moments, coarse.moments], fine, far)
    pairs = zip(fine.moments, truth.moments, strict=True)
    return bounds, MeshMoments(*(np.abs(found - right) for found, right in pairs))


def broken_bounds(solutions: list[Solution], safety: float = 1.0) -> float:
    """Part of all bounds that do not hold."""
    pairs = zip(*bounds_and_errors(solutions), strict=True)
    return float(np.mean([error > safety * bound + 1e-12 for bound, error in pairs]))


def test_bounds_hold(levels_and_fine: list[Solution]) -> None:
    assert broken_bounds(levels_and_fine) == 0.0


def test_bounds_a_tenth_as_wide_would_not_hold(levels_and_fine: list[Solution]) -> None:
    assert broken_bounds(levels_and_fine, safety=0.1) > 0.02


def test_bounds_of_rates_are_no_wider_than_of_use(levels_and_fine: list[Solution]) -> None:
    """Of stops of R below 0.6 as well, where each finer mesh sees more slow impacts; those hit
    less often than once in a thousand periods are left out."""
    bounds, _ = bounds_and_errors(levels_and_fine)
    rates = levels_and_fine[-1].moments.rate_upper
    often = (rates > 1e-3 / (2.0 * np.pi)) & (RANDOM.restitutions[1] < 0.6)
    assert often.sum() >= 5
    assert np.median((bounds.rate_upper / rates)[often]) < 0.15


def test_no_scene_fails() -> None:
    found = fokker_planck_many(**random_scenes(300, seed=5))
    for name in MeshMoments._fields:
        assert np.isfinite(getattr(found.values, name)).all(), name
        assert (getattr(found.errors, name) >= 0.0).all(), name
    assert (found.values.variance > 0.0).all()
    assert (found.values.velocity_mean_square > 0.0).all()


def test_one_scene_and_many_have_the_same_digits() -> None:
    batch = fokker_planck_many(
        omega=1.0, damping_rate=0.1, intensity=0.2, load=[[-0.2], [0.0]], lower=-0.6, upper=1.1,
        restitution_lower=0.7, restitution_upper=[0.4, 0.4, 0.4],
    )  # fmt: skip
    assert batch.values.mean.shape == batch.errors.mean.shape == (2, 3)
    # counting every impact it gives no rates, for which it would refine its mesh
    whole = fokker_planck(general(-0.2), rtol=0.1, speed_threshold=0.0)
    single = whole.coordinates["x"]["displacement_mean"]
    assert isinstance(single, Estimate)
    assert batch.values.mean[0] == pytest.approx([single.value] * 3, rel=1e-12)
    assert batch.errors.mean[0] == pytest.approx([single.bias] * 3, rel=1e-9)


# What it says of scenes at its borders --------------------------------------------------------


def test_a_stop_out_of_reach_is_not_hit_within_the_bias() -> None:
    known = exact(oscillator(-8.0, 8.0)).estimates()
    found = fokker_planck(oscillator(-8.0, 8.0, 0.5)).estimates()
    for name in ("collision_rate", "impact_speed_rate", "impact_speed_square_rate"):
        estimate = found["stops", name]
        assert estimate.value == 0.0
        assert_agrees(estimate, known["stops", name].value)


@pytest.mark.parametrize("restitution", [0.0, 0.1, 0.5])
def test_a_rate_without_end_is_not_given(restitution: float) -> None:
    scene = oscillator(-1.0, 1.0, restitution)
    every = fokker_planck(scene, speed_threshold=0.0).impact_pairs["stops"]
    assert every["collision_rate"] is every["impact_speed_mean"] is None
    fast = fokker_planck(scene, speed_threshold=0.5).impact_pairs["stops"]
    assert isinstance(fast["collision_rate"], Estimate)
    assert fast["speed_threshold"] == 0.5


def test_stops_alone_take_the_power_without_damping() -> None:
    undamped, damped = (
        fokker_planck(oscillator(-1.0, 1.0, 0.8, damping=damping)) for damping in (0.0, 1e-9)
    )
    for key, estimate in undamped.estimates().items():
        assert estimate.value == pytest.approx(damped.estimates()[key].value, rel=1e-6, abs=1e-12)


def test_every_unmet_condition_is_listed() -> None:
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.0, stiffness=0.0),
        excitations=[TabulatedNoise(frequency_hz=[1.0, 2.0], density=[1.0, 1.0], unit="N2/Hz")],
    )
    with pytest.raises(NotApplicable) as reason:
        fokker_planck(scene)
    assert [sentence.split()[0] for sentence in reason.value.conditions] == [
        "excitation", "damping", "stiffness",
    ]  # fmt: skip
    with pytest.raises(NotApplicable, match="noise"):
        fokker_planck(scene.model_copy(update={"excitations": (ConstantLoad(force=1.0),)}))


def test_what_was_reached_comes_with_the_refusal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stochvi.methods.fokker_planck.density.MOST_UNKNOWNS", 20_000)
    with pytest.raises(NotConverged, match="1e-12") as reason:
        fokker_planck(oscillator(-1.0, 1.0, 0.95), rtol=1e-12)
    assert reason.value.partial is not None
    row = next(row for row in LOSSY_ROWS if row.restitution == 0.95)
    for name, estimate in governed(reason.value.partial):
        assert estimate.bias is not None
        assert_agrees(replace(estimate, bias=estimate.bias + row.errors[name]), row.values[name])


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"restitution_upper": 1.2}, "in \\[0, 1\\]"),
        ({"lower": 1.0, "upper": 1.0}, "lower must be below upper"),
        ({"damping_rate": -0.1}, "at least 0"),
        ({"intensity": math.nan}, "nan"),
        ({"damping_rate": 0.0}, "damping_rate"),
        ({"omega": 0.0}, "omega"),
        ({"intensity": 0.0}, "intensity"),
    ],
)
def test_arrays_out_of_range_are_refused(changes: dict[str, float], sentence: str) -> None:
    plain = {"omega": 1.0, "damping_rate": 0.1, "intensity": [0.2, 0.3], "upper": 1.0}
    with pytest.raises((ValueError, NotApplicable), match=sentence):
        fokker_planck_many(**(plain | changes))


@pytest.mark.parametrize("argument", [{"rtol": 0.0}, {"speed_threshold": -1.0}])
def test_arguments_out_of_range_are_refused(argument: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(argument))):
        fokker_planck(oscillator(-1.0, 1.0), **argument)


def test_time_that_ends_leaves_the_better_of_both_ways() -> None:
    """Two coarse meshes in strips are less accurate than the meshes of the whole range."""
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=0.0, law=Restitution(coefficient=0.9))],
        excitations=[WhiteNoise(intensity=0.04)],
    )
    rough = fokker_planck(scene, rtol=1e-5).coordinates["x"]["velocity_mean_square"]
    with pytest.raises(NotConverged, match=r"budget of 0\.001 s ended at a relative error") as late:
        fokker_planck(scene, rtol=1e-7, budget=1e-3)
    left = late.value.partial.coordinates["x"]["velocity_mean_square"]
    accurate = fokker_planck(scene, rtol=1e-7).coordinates["x"]["velocity_mean_square"]
    assert accurate.bias < 0.1 * left.bias <= 0.1 * rough.bias * (1.0 + 1e-6)
    assert abs(left.value - accurate.value) <= left.bias + accurate.bias


# ------------------------------------------------------------------------------
# Where the stationary solver ends: stops hardly reached, wells apart, kinks, tails too heavy.
# ------------------------------------------------------------------------------


HITS = ("rate_upper", "speed_rate_upper", "speed_square_rate_upper")


# A mass that leans on an inelastic stop ----------------------------------------------------------


def leaning(upper: float, restitution: float = 0.3, zeta: float = 0.1) -> Motion:
    """A preload of 3 deviations on an inelastic stop; an elastic one above."""
    plain = oscillator(None, None, damping=2.0 * zeta, intensity=4.0 * zeta)
    pair = ImpactPair(
        lower=3.0,
        upper=upper,
        lower_law=Restitution(coefficient=restitution),
        upper_law=Restitution(coefficient=1.0),
    )
    scene = Scene(structure=plain.structure, impact_pairs=[pair], excitations=plain.excitations)
    return Motion(model=model_of(scene))


def solved(motion: Motion) -> Averages:
    return density.refine(motion, 1e-2, 0.0, ()).averages


def test_a_far_stop_is_hit_as_it_is_a_little_nearer() -> None:
    """3.25 is out of reach by the law exp(-energy / s^2), 3.24 is not; nothing jumps there."""
    places = [3.23, 3.24, 3.25, 3.26]
    reached = [scaled_motion(leaning(place)).reached for place in places]
    assert [len(stops) for stops in reached] == [2, 2, 1, 1]
    found = [solved(leaning(place)) for place in places]
    for name in HITS:
        slopes = np.diff(np.log([getattr(one, name) for one in found]))
        assert np.ptp(slopes) < 0.1 * abs(slopes[0])


def test_a_stop_that_is_left_out_is_bounded_by_what_is_found_beside_it() -> None:
    motion = leaning(3.25)
    whole = solved(motion)
    frame = scaled_motion(motion)
    patches = density.graded(frame, density.first_patches(frame), density.SLOWEST[0])
    strips = density.make_strips(patches, density.FIRST_DEGREES)
    blind = density._field(frame, strips, density.SLOWEST[0])
    averages = blind.averages(0.0)
    assert averages.rate_upper == 0.0
    bounds = density._unreached(blind, averages.upcrossing_rate)
    square = motion.squares[0]
    rice = averages.upcrossing_rate * np.exp(-(3.25**2 - 9.0) / 2.0 / square)
    assert rice < 1e-3 * whole.rate_upper  # the law alone says too little
    for name in HITS:
        assert getattr(whole, name) < bounds[name] < 10.0 * getattr(whole, name)


def test_so_it_is_in_many_scenes_at_once() -> None:
    places = [3.4, 4.0]
    batch = fokker_planck_many(
        omega=1.0, damping_rate=0.2, intensity=0.4, lower=3.0, upper=places, restitution_lower=0.3
    )
    for k, place in enumerate(places):
        found = solved(leaning(place))
        for name in HITS:
            wrong = abs(getattr(batch.values, name)[k] - getattr(found, name))
            assert wrong < getattr(batch.errors, name)[k]


# Wells apart --------------------------------------------------------------------------------


def wells(theta: float, load: float = 0.0) -> Scene:
    """Two wells at -1 and 1, a barrier of 1/4 between them."""
    return spring(lambda x: x**3 - x, theta, load)


def spring(force: Callable[..., Any], theta: float, load: float = 0.0) -> Scene:
    loads = [ConstantLoad(force=load)] if load else []
    return Scene(
        structure=NonlinearOscillator(mass=1.0, damping=0.1, restoring_force=force),
        excitations=[WhiteNoise(intensity=0.2 * theta), *loads],
    )


def assert_as_exact(scene: Scene, rtol: float) -> None:
    found, known = fokker_planck(scene, rtol=rtol).estimates(), exact(scene).estimates()
    for name in ("displacement_mean", "displacement_std", "velocity_std"):
        assert_agrees(found["x", name], known["x", name].value)


@pytest.mark.parametrize(
    ("theta", "load"),
    [
        (0.02, 0.0012),
        pytest.param(0.005, 0.0, marks=pytest.mark.verify),
        pytest.param(0.012, 0.01, marks=pytest.mark.verify),
    ],
)
def test_both_wells_are_found_behind_a_high_barrier(theta: float, load: float) -> None:
    assert_as_exact(wells(theta, load), 0.01)


def test_wells_of_unequal_depth_behind_a_barrier_out_of_numbers_are_refused() -> None:
    with pytest.raises(NotConverged, match="double precision ends at 30"):
        fokker_planck(wells(0.005, 0.001))


def test_the_barrier_is_counted_from_the_shallower_well() -> None:
    frame = scaled_motion(Motion(model=model_of(wells(0.02, 0.05))))
    roots = np.sort(np.roots([1.0, 0.0, -1.0, -0.05]).real)
    shallow, top, deep = roots**4 / 4.0 - roots**2 / 2.0 - 0.05 * roots
    assert frame.barrier == pytest.approx((top - shallow) / 0.02, rel=1e-4)
    assert frame.rare_energy == pytest.approx((top - deep) / 0.02, rel=1e-4)


# Densities that fall as powers --------------------------------------------------------------


def student(power: float) -> Scene:
    """(1 + x^2)^(-power / 2), whose variance is 1 / (power - 3)."""
    return spring(lambda x: power * x / (1.0 + x**2), 1.0)


@quick_cases("power", [3.5, 4.5, 8.0], keep=(2,))
def test_the_closed_form_holds_all_of_a_heavy_tail(power: float) -> None:
    found = exact(student(power)).estimates()["x", "displacement_std"]
    assert found.value == pytest.approx((power - 3.0) ** -0.5, rel=1e-11)


@pytest.mark.parametrize("power", [4.5, 8.0])
def test_what_a_box_cuts_of_a_heavy_tail_is_in_the_bias(power: float) -> None:
    found = fokker_planck(student(power), rtol=0.01).estimates()["x", "displacement_std"]
    assert_agrees(found, (power - 3.0) ** -0.5)
    assert found.bias is not None
    assert found.bias < 3.0 * max(abs(found.value - (power - 3.0) ** -0.5), 1e-6)


def test_a_tail_that_no_box_holds_is_refused() -> None:
    with pytest.raises(NotConverged) as refusal:
        fokker_planck(student(3.5), rtol=0.01)
    assert_agrees(refusal.value.partial.estimates()["x", "displacement_std"], 2.0**0.5)
    assert fokker_planck(student(3.5), rtol=0.05)


@quick_cases("power", [1.5, 2.9], keep=(1,))
def test_an_infinite_variance_is_refused(power: float) -> None:
    with pytest.raises(NoExactSolution, match="finite variance"):
        exact(student(power))
    with pytest.raises(NotApplicable, match="finite variance"):
        fokker_planck(student(power))


def test_a_mesh_without_a_variance_is_refined(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not taken for an answer, nor for the end."""
    averages, scene = StripDensity.averages, wells(0.1)
    known = exact(scene).estimates()["x", "displacement_std"].value
    calls = []

    def negative(self: StripDensity, slowest: float) -> Averages:
        calls.append(self)
        found = averages(self, slowest)
        return found._replace(variance=-1.0) if len(calls) <= 3 else found

    monkeypatch.setattr(StripDensity, "averages", negative)
    assert_agrees(fokker_planck(scene).estimates()["x", "displacement_std"], known)
    monkeypatch.setattr(density, "MOST_UNKNOWNS", 1)
    monkeypatch.setattr(
        StripDensity, "averages", lambda *all_: averages(*all_)._replace(variance=-1.0)
    )
    with pytest.raises(NotConverged, match="no density"):
        fokker_planck(scene)


# Scales too far apart -----------------------------------------------------------------------


def test_a_motion_below_the_digits_of_its_place_is_refused(recwarn: Any) -> None:
    """1e-17 m on a stop at 1 m."""
    scene = oscillator(None, 1.0, 0.5, load=1e6, intensity=1e-16)
    with pytest.raises(NotConverged, match="lost in rounding"):
        fokker_planck(scene)
    assert not recwarn.list


def test_a_transient_whose_mesh_would_not_fit_is_refused() -> None:
    scene = oscillator(None, -0.02, 0.4, load=-44.0, omega=0.003, damping=0.0, intensity=1e-14)
    with pytest.raises(NotConverged, match="too far apart"):
        transient(scene, [1.0], (-0.03, 0.0))


def test_a_transient_that_begins_below_the_lowest_place_of_the_box_has_a_scale() -> None:
    """Rounding may put the energy of a start at rest below that of the lowest place."""
    scene = Scene(
        structure=Oscillator(mass=0.021953218586657015, damping=0.0, stiffness=33.470982194902206),
        impact_pairs=[
            ImpactPair(
                lower=-0.00012969190525886332,
                upper=8.640386514902214e-05,
                lower_law=Restitution(coefficient=0.0),
                upper_law=Restitution(coefficient=1.0),
            )
        ],
        excitations=[
            WhiteNoise(intensity=6.322694659920297e-13),
            ConstantLoad(force=-0.5054179254609847),
        ],
    )
    with pytest.raises(ValueError, match="start must lie between the stops"):
        transient(scene, [1.0])


# Rates of impacts that are so fast that they are rare ---------------------------------------------


def test_rates_of_fast_impacts_between_elastic_stops() -> None:
    """Rayleigh's distribution of speeds is exact there: a rate is right, or 0 with a bound, however
    fast the impacts."""
    scene = oscillator(-1.0, 1.0)
    law = exact_density(scene)
    for speed, seen in ((2.0, True), (4.0, True), (6.0, True), (9.0, False), (20.0, False)):
        truth = float(law.rate_above("upper", speed))
        rate = (
            fokker_planck(scene, speed_threshold=speed).impact_pairs["stops"].collision_rate_upper
        )
        assert rate is not None and rate.bias is not None
        assert abs(rate.value - truth) <= rate.bias
        assert (rate.value > 0.0) == seen
        assert rate.bias > 0.0 and rate.bias < (0.1 * truth if seen else 1e-12)


def test_every_solution_bounds_the_rates_that_its_mesh_loses() -> None:
    scene = oscillator(-1.0, 1.0)
    law = exact_density(scene)
    speeds = np.array([0.5, 2.0, 5.0, 6.0, 9.0])
    truth = np.asarray(law.rate_above("upper", speeds))
    many = fokker_planck_many(
        omega=np.ones(5),
        damping_rate=0.1,
        intensity=0.2,
        lower=-1.0,
        upper=1.0,
        speed_threshold=speeds,
    )
    assert np.all(np.abs(many.values.rate_upper - truth) <= many.errors.rate_upper)
    assert np.all(many.errors.rate_upper > 0.0)
    for speed in (0.5, 6.0):
        late = transient(scene, [100.0], speed_threshold=speed)
        known = float(law.rate_above("upper", speed))
        assert abs(late.values.rate_upper[0] - known) <= late.errors.rate_upper[0] + 1e-3 * known


def test_a_density_says_how_little_lies_beyond_its_mesh() -> None:
    scene = oscillator(-1.0, 1.0)
    found, law = fokker_planck_density(scene), exact_density(scene)
    assert found.density(0.0, 30.0) == 0.0
    assert 0.0 < float(law.density(0.0, 9.0)) < float(found.density_error(0.0, 9.0)) < 1e-9
    assert math.isnan(float(found.rate_above("upper", 9.0)))
    farther = fokker_planck_density(scene, speed_threshold=6.0)
    assert float(farther.rate_above("upper", 6.0)) == pytest.approx(
        float(law.rate_above("upper", 6.0)), rel=1e-4
    )


RARE = {
    "two stops": ((0.1, 0.2), (-1.0, 1.0), 0.8, (2.0, 3.0, 3.5)),
    "pressed on one": ((0.1, 0.2), (-1e9, -1.0), 0.7, (2.0, 3.0, 3.5)),
    "light damping": ((0.02, 0.04), (-1.0, 1e9), 0.3, (1.0, 2.0, 2.5)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RARE)
def test_rates_of_fast_impacts_on_inelastic_stops(name: str) -> None:
    """Against a weighted ensemble, down to rates of 1e-9 a second; that of impacts that are 10 %
    faster does not pass."""
    (damping, intensity), stops, restitution, speeds = RARE[name]
    sampled, errors = rates_above(damping, intensity, stops, restitution, speeds, 160.0, 5)
    lower, upper = (None if abs(stop) > 1e8 else stop for stop in stops)
    scene = oscillator(lower, upper, restitution, damping=damping, intensity=intensity)
    for speed, value, error in zip(speeds, sampled, errors, strict=True):
        rate = fokker_planck(scene, speed_threshold=speed).impact_pairs["stops"].collision_rate
        assert rate is not None and rate.bias is not None and rate.bias > 0.0
        judge = Estimate(value=value, standard_error=error, bias=0.02 * value + rate.bias)
        assert_agrees(judge, rate.value)
    faster = fokker_planck(scene, speed_threshold=1.1 * speeds[1]).impact_pairs["stops"]
    assert faster.collision_rate is not None
    assert_differs(
        Estimate(value=sampled[1], standard_error=errors[1], bias=0.02 * sampled[1]),
        faster.collision_rate.value,
    )


def test_no_mean_speed_that_the_counted_impacts_cannot_have() -> None:
    """F1 over the rate of the fastest impacts exceeds their rms speed by far."""
    scene = oscillator(-1.0, 1.0, 0.8)
    rare, usual = (fokker_planck(scene, speed_threshold=speed) for speed in (2.0, 0.05))
    assert rare.impact_pairs["stops"].impact_speed_mean is None
    assert [note for note in rare.warnings if note.startswith("no mean impact speed is given")]
    pair = usual.impact_pairs["stops"]
    assert pair.impact_speed_mean is not None and pair.collision_rate is not None
    assert pair.impact_speed_square_rate is not None
    square = pair.impact_speed_square_rate.value / pair.collision_rate.value
    assert pair.impact_speed_mean.value**2 < square
    assert not [note for note in usual.warnings if "no mean impact speed" in note]
