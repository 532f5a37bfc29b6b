"""Several modes, pairs and signals: exact laws, balances, other engines, and the kernel's roots."""

from __future__ import annotations

import gc
import importlib.util
import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest

from stochvi import (
    Elastic,
    Estimate,
    ImpactPair,
    Isolator,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    TabulatedNoise,
    Viscoelastic,
    WhiteNoise,
    exact,
    fokker_planck,
    linearise,
    simulate,
)
from stochvi.engine.arithmetic import COLUMNS, Log, bracketed_root, first_root
from stochvi.engine.compiling import kernel
from stochvi.engine.compliant_contacts import put_on_stop
from stochvi.engine.sub_steps import V1, Y1, Responses
from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.spectra import (
    beyond,
    covariance,
)
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.methods import monte_carlo
from stochvi.methods.monte_carlo import BETWEEN_IMPACTS, record_path
from stochvi.model.build_response import residuals
from stochvi.model.gap import Gap, GibbsLaw
from stochvi.model.modal import linear_law
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan, with_tables
from stochvi.motion.kernels.modes import matrix_passes
from stochvi.motion.kernels.random_numbers import LANES, ROW, aligned_rows, words_of
from stochvi.motion.modal import _table, plan_modal
from stochvi.motion.plan import PathStatistics, of_coordinate, of_pair
from stochvi.motion.synthesis import LARGEST_LOSS
from stochvi.scenes import Beam, Modes
from stochvi.scenes.absorbers import Absorber
from stochvi.scenes.excitations import ConstantLoad, FilteredNoise, Sine
from stochvi.scenes.impact_laws import Law
from stochvi.scenes.structures import Matrices, RigidBody
from stochvi.testing import assert_agrees
from support import CHECKOUT
from support.accuracies import apart, assert_balanced, assert_differs, assert_same, quick_cases
from support.boxes import box, scene_with
from support.known import RIGID_STOPS, oscillator, values
from support.mounts import two_stages
from support.naive import kick_flow_kick, normals

QUANTITIES = ("displacement_std", "velocity_std", "impact_speed_rate", "impact_speed_square_rate")


def absorber(
    restitution: float = 1.0,
    *,
    play: float = 2.0,
    mass: float = 0.1,
    stiffness: float = 0.0,
    damping: float = 0.0,
    **noise: object,
) -> Scene:
    """A mass in a box on an oscillator with omega = 1, b = 0.1, S0 = 0.2."""
    shaken = [WhiteNoise(on="structure", intensity=0.2)] if not noise else [noise["excitation"]]
    return Scene(
        structure=Matrices(
            coordinates=["structure", "absorber"],
            mass=[[1.0, 0.0], [0.0, mass]],
            damping=[[0.1 + damping, -damping], [-damping, damping]],
            stiffness=[[1.0 + stiffness, -stiffness], [-stiffness, stiffness]],
        ),
        impact_pairs=[
            ImpactPair(
                name="box", between=["absorber", "structure"], lower=-play / 2.0, upper=play / 2.0,
                law=Restitution(coefficient=restitution),
            )
        ],
        excitations=shaken,
    )  # fmt: skip


def by_modes(scene: Scene, paths: int, seed: int = 1, **changes: float) -> dict[str, Estimate]:
    """A scene of one oscillator by the engine for any structure."""
    plan = replace(plan_modal(model_of(scene), None, None), **changes)
    found = PathStatistics.of(plan.averages(seed, 0, paths), plan.layout)
    pair = plan.model.pairs[0].name
    estimates = {}
    for name, quantity in (of_coordinate("x") | of_pair(pair)).items():
        value, error = found.evaluate(quantity)
        estimates[name] = Estimate(value=value, standard_error=error)
    return estimates


# ---- one oscillator, known by other means ----------------------------------------------------

ELASTIC = {
    "unequal gaps": {"lower": -0.5, "upper": 1.0},
    "one stop": {"lower": None, "upper": 1.0},
    "preload": {"lower": None, "upper": -1.0},
    "narrow": {"lower": -0.02, "upper": 0.03},
    "load on a stop": {"lower": -1.0, "upper": 1.0, "load": 2.0},
    "overdamped": {"lower": -1.0, "upper": 1.0, "damping": 10.0, "intensity": 20.0},
    "no spring, a load": {"lower": -1.0, "upper": 1.0, "omega": 0.0, "load": 0.7},
}


@pytest.mark.slow
@pytest.mark.parametrize("case", ELASTIC.values(), ids=ELASTIC.keys())
def test_one_mode_agrees_with_the_exact_law(case: dict) -> None:
    scene = oscillator(**case, restitution=1.0)
    truth, found = values(exact(scene)), by_modes(scene, 1024)
    for name in (*QUANTITIES, "displacement_mean", "collision_rate"):
        assert_agrees(found[name], truth[name])
        assert found[name].standard_error < 0.02 * max(abs(truth[name]), 0.5)


@pytest.mark.parametrize("row", RIGID_STOPS, ids=lambda row: f"R={row.restitution:g}")
def test_one_mode_agrees_with_near_exact_numbers(row) -> None:
    """At half the usual step, where the bias is well below the standard error."""
    scene = oscillator(-1.0, 1.0, row.restitution)
    found = by_modes(scene, 2048, step=0.1)
    for name in QUANTITIES:
        assert_agrees(found[name], row.values[name])


def test_a_path_equals_that_of_the_engine_for_one_oscillator() -> None:
    """Two kernels that share the random numbers and nothing else: modes find impacts as roots of
    quintics, the other in closed form."""
    scene = oscillator(-0.6, 0.8, 0.8)
    plan = replace(plan_modal(model_of(scene), 0.0, 30.0), step=0.1)
    record = np.zeros((plan.steps, 1, plan.record_width))
    one_by_one, by_lanes = (
        Log(np.empty((1000, COLUMNS)), np.zeros(1, np.int64), 0.0) for _ in range(2)
    )
    plan.averages(3, 5, 1, record, one_by_one)
    replace(plan, burn_in=plan.step).averages(3, 5, 1, log=by_lanes)
    ours = plan.columns(record)
    # the start of the other is another: from the first state of this one, by its plain twin
    start = -(-len(plan.law.covariance) // 2) * 2
    x, v, hits = kick_flow_kick(
        ours["displacement of x"][0], ours["velocity of x"][0],
        normals(3, 5, start + plan.steps)[start + 1 :], 0.1, 1.0, 0.1, 0.2,
        [(-0.6, 0.8, -1.0), (0.8, 0.8, 1.0)],
    )  # fmt: skip
    assert len(hits) > 3
    np.testing.assert_allclose(ours["displacement of x"][1:], x, rtol=0, atol=1e-6)
    np.testing.assert_allclose(ours["velocity of x"][1:], v, rtol=0, atol=1e-5)
    # the twin, and the paths that move together, begin a step later
    timed = np.array([(when, side * w) for side, w, when in hits])
    events = one_by_one.events[: one_by_one.count[0]]
    events = events[events[:, 2] > plan.step]
    np.testing.assert_allclose(events[:, 2:] - [plan.step, 0.0], timed, rtol=0, atol=1e-5)
    lanes = by_lanes.events[: len(timed)]
    np.testing.assert_allclose(lanes[:, 2:], timed, rtol=0, atol=1e-5)


# ---- absorbers -------------------------------------------------------------------------------


@pytest.mark.slow
def test_an_elastic_absorber_in_a_box_obeys_the_exact_law() -> None:
    """E x1^2 = theta / k1, m2 E v2^2 = theta, uniform play, rate sigma_rel sqrt(2 / pi) / d."""
    response = simulate(absorber(), rel_error=0.02, seed=3)
    structure, loose = (response.coordinates[name] for name in ("structure", "absorber"))
    assert_agrees(structure["displacement_mean_square"], 1.0)
    assert_agrees(structure["velocity_mean_square"], 1.0)
    assert_agrees(loose["velocity_mean_square"], 10.0)
    # x2 = x1 + y, y uniform in the box and independent of x1
    assert_agrees(loose["displacement_mean_square"], 1.0 + 1.0 / 3.0)
    assert_agrees(response.impact_pairs["box"]["collision_rate"], 1.32314185710031)
    assert structure["displacement_std"].bias == 0.0
    assert_balanced(response)


LOSSY = {
    "free": {"restitution": 0.8},
    "plastic": {"restitution": 0.0},
    "wide": {"restitution": 0.5, "play": 8.0},
    "sprung": {"restitution": 0.6, "stiffness": 0.1, "damping": 0.01},
    "heavy": {"restitution": 0.3, "mass": 2.0, "play": 0.5},
}


@pytest.mark.parametrize(
    ("paths", "largest_error"), [(64, 0.06), pytest.param(256, 0.03, marks=pytest.mark.verify)]
)
@quick_cases("case", LOSSY.values(), ids=LOSSY.keys(), keep=(0, 1, 2, 3))
def test_balances_hold_for_absorbers(case: dict, paths: int, largest_error: float) -> None:
    response = simulate(absorber(**case), paths=paths, seed=4)
    assert set(response.identities) == {
        "energy", "virial", "force on structure", "force on absorber",
    }  # fmt: skip
    for residual in response.identities.values():
        assert_agrees(residual, 0.0)
        assert residual.standard_error < largest_error


def test_a_wrong_mass_breaks_the_balances() -> None:
    """Simulated with 0.1 kg, judged as 0.11 kg."""
    scene = absorber(0.8)
    plan = plan_modal(model_of(scene), None, None)
    found = PathStatistics.of(plan.averages(4, 0, 2048), plan.layout)
    wrong = model_of(absorber(0.8, mass=0.11))
    origin = [plan.layout.origins[name] for name in ("structure", "absorber")]
    value, error = found.evaluate(lambda means: residuals(wrong, means, origin)["virial"])
    assert abs(value) > 4.5 * error


# ---- several modes and pairs -----------------------------------------------------------------


def chain(count: int, restitution: float) -> Scene:
    """Equal masses between springs and dampers, stops on the first, a pair between the last two."""
    tri = 2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    names = [f"m{k}" for k in range(count)]
    law = Restitution(coefficient=restitution)
    return Scene(
        structure=Matrices(
            coordinates=names, mass=np.eye(count), damping=0.05 * tri, stiffness=tri
        ),
        impact_pairs=[
            ImpactPair(name="stops", on="m0", lower=-1.0, upper=0.5, law=law),
            ImpactPair(name="gap", between=names[-2:], lower=-0.8, upper=0.6, law=law),
        ],
        excitations=[WhiteNoise(on=name, intensity=0.1) for name in names]
        + [ConstantLoad(on="m1", force=0.3)],
    )


@pytest.mark.parametrize("paths", [16, pytest.param(96, marks=pytest.mark.verify)])
@pytest.mark.parametrize("count", [3, pytest.param(8, marks=pytest.mark.verify)])
def test_a_chain_keeps_its_balances(count: int, paths: int) -> None:
    response = simulate(chain(count, 0.7), paths=paths, seed=5)
    assert len(response.identities) == 2 + count
    assert_balanced(response)


def test_two_modes_far_apart_stay_exact() -> None:
    """Frequencies 1 and 100 in one gap: y = a - b between elastic stops, Gibbs."""
    law = Restitution(coefficient=1.0)
    scene = Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=np.eye(2), damping=np.diag([1.0, 1.0]),
            stiffness=np.diag([1.0, 1e4]),
        ),
        impact_pairs=[ImpactPair(between=["a", "b"], lower=-0.5, upper=0.5, law=law)],
        excitations=[WhiteNoise(on=name, intensity=2.0) for name in ("a", "b")],
    )  # fmt: skip
    response = simulate(scene, paths=256, duration=40.0, seed=7)
    assert_agrees(response.coordinates["a"]["velocity_mean_square"], 1.0)
    assert_agrees(response.coordinates["b"]["velocity_mean_square"], 1.0)
    assert_balanced(response)


# ---- signals ---------------------------------------------------------------------------------


def loaded(excitations: list, gap: float | None) -> Scene:
    law = Restitution(coefficient=0.8)
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[] if gap is None else [ImpactPair(lower=-gap, upper=gap, law=law)],
        excitations=excitations,
    )


@pytest.mark.parametrize("hertz", [0.02, 1.0 / (2.0 * math.pi), 0.5])
def test_filtered_noise_has_the_variance_of_the_frequency_integral(hertz: float) -> None:
    """Also where filter and structure resonate together, which has no modes of its own."""
    noise = FilteredNoise(intensity=0.2, frequency_hz=hertz, zeta=0.05)
    f = np.linspace(0.0, 3.0, 600_001)[1:]
    w, wf = 2.0 * np.pi * f, noise.omega
    filtered = wf**4 / ((wf**2 - w**2) ** 2 + (0.1 * wf * w) ** 2)
    density = 0.4 * filtered / ((1.0 - w**2) ** 2 + (0.1 * w) ** 2)
    response = simulate(loaded([noise], None), rel_error=0.01, seed=10)
    assert_agrees(response.coordinates["x"]["displacement_mean_square"], np.trapezoid(density, f))
    assert_agrees(
        response.coordinates["x"]["velocity_mean_square"], np.trapezoid(w**2 * density, f)
    )


def test_a_sine_alone_moves_every_path_alike() -> None:
    response = simulate(loaded([Sine(amplitude=0.5, frequency_hz=0.3)], None), paths=64, seed=1)
    w = 2.0 * math.pi * 0.3
    square = 0.5 * 0.25 / ((1.0 - w * w) ** 2 + (0.1 * w) ** 2)
    found = response.coordinates["x"]["displacement_mean_square"]
    assert found is not None
    assert found.value == pytest.approx(square, rel=1e-3)


SUMS = {
    "white and sine": [WhiteNoise(intensity=0.1), Sine(amplitude=0.3, frequency_hz=0.14)],
    "filtered": [FilteredNoise(intensity=0.2, frequency_hz=0.2, zeta=0.05)],
    "filtered and sine, loaded": [
        FilteredNoise(intensity=0.2, frequency_hz=0.2, zeta=0.05),
        Sine(amplitude=0.3, frequency_hz=0.14),
        ConstantLoad(force=0.2),
    ],
}
FAINT = TabulatedNoise(frequency_hz=[0.1, 0.2], density=[1e-12, 1e-12], unit="N2/Hz")


@pytest.mark.slow
@pytest.mark.parametrize("case", SUMS.values(), ids=SUMS.keys())
def test_states_and_synthesis_agree(case: list) -> None:
    """A table too faint to matter sends the same scene to the response-domain engine."""
    ours = simulate(loaded(case, 1.0), rel_error=0.01, seed=11)
    other = simulate(loaded([*case, FAINT], 1.0), rel_error=0.01, seed=12)
    assert "modal" in ours.assumptions[-2] and "response" in other.assumptions[-2]
    for key, estimate in ours.estimates().items():
        assert_same(estimate, other.estimates()[key])
    assert_balanced(ours)
    assert_balanced(other)


# ---- the parts -------------------------------------------------------------------------------


def test_first_roots_are_those_of_the_polynomial() -> None:
    rng = np.random.default_rng(1)
    stack = np.zeros((64, 8))
    grid = np.linspace(0.0, 1.0, 20_001)
    found = 0
    for _ in range(400):
        c = rng.standard_normal(6)
        c[0] = -abs(c[0])
        t, slope = first_root(*c, stack)
        value = quintic(c, grid)
        above = np.flatnonzero(value > 0.0)
        if len(above) == 0:
            assert t == 2.0 or value.max() > -1e-6
            continue
        found += 1
        assert grid[above[0] - 1] - 1e-9 <= t <= grid[above[0]] + 1e-9
        assert slope == pytest.approx(np.gradient(value, grid)[above[0]], abs=1e-2)
    assert found > 200


def test_a_root_is_found_to_rounding() -> None:
    """Also where Newton's step ends on an end of the bracket."""
    rising = np.sort(np.random.default_rng(0).standard_normal((20_000, 6)))
    rising = rising[(rising[:, 0] < 0.0) & (rising[:, 1] > 0.0)]
    assert len(rising) > 1000
    for c in rising:
        t, slope = bracketed_root(*c)
        assert abs(quintic(c, t)) <= 1e-13 * slope


def quintic(c: np.ndarray, t: float | np.ndarray) -> np.ndarray:
    """A polynomial with the Bernstein coefficients c."""
    return c @ np.array([math.comb(5, k) * t**k * (1.0 - t) ** (5 - k) for k in range(6)])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_gap_put_on_its_stop_lies_there_at_rest(side: float) -> None:
    """In gaps and modes alike, also where damping acts in the flow: what is taken away, and what
    damping took from the motion beyond the stop, leave no speed."""
    random = np.random.default_rng(3)
    rows, root = random.normal(size=(2, 3)), random.normal(size=(3, 3))
    jumps = rows / np.sum(rows**2, axis=1, keepdims=True)  # of modal velocities, by a unit speed
    series = np.zeros((2, 6, 2))
    series[:, 3:, 0], series[:, 3:, 1] = jumps, -jumps @ (root @ root.T)
    speeds = np.einsum("on,pnk->pok", rows, series[:, 3:])
    of_gaps = np.zeros((2, 2, 3, 2))
    of_gaps[:, :, 1], of_gaps[:, :, 2, 0] = speeds, speeds[:, :, 1]
    responses = Responses(series, 3, of_gaps, *np.zeros((3, 2, 0, 2)))
    state, gaps = random.normal(size=(6, 1)), np.zeros((6, 2))
    gaps[Y1], gaps[V1] = rows @ state[:3, 0], rows @ state[3:, 0]
    for pair in range(2):
        state[3:, 0] += jumps[pair] * (2.0 * side - gaps[V1, pair])  # outwards, at 2 m/s
        gaps[V1] = rows @ state[3:, 0]
        stop = gaps[Y1, pair] - 0.3 * side
        put_on_stop.py_func(pair, stop, side, gaps, state[:, 0], responses)
        assert gaps[Y1, pair] == pytest.approx(stop, abs=1e-12)
        assert gaps[V1, pair] == pytest.approx(0.0, abs=1e-12)
        assert rows @ state[:3, 0] == pytest.approx(gaps[Y1], abs=1e-12)
        assert rows @ state[3:, 0] == pytest.approx(gaps[V1], abs=1e-12)


def test_one_pair_and_several_share_the_compiled_code() -> None:
    """It depends on the types of what it gets, and an order of an array is part of its type."""
    one, several = (
        numba.typeof(plan_modal(model_of(scene), None, 50.0)._kernel_constants)
        for scene in (absorber(0.8), chain(3, 0.8))
    )
    assert one == several


def test_a_record_names_its_columns() -> None:
    record = record_path(absorber(0.8), duration=20.0, seed=2)
    assert "displacement of absorber" in record and "impact_speed of box" in record
    gap = record["displacement of absorber"] - record["displacement of structure"]
    assert gap.abs().max() <= 1.0 + 1e-9


def test_structures_without_a_stationary_state_say_so() -> None:
    loose = absorber().model_copy(update={"impact_pairs": ()})
    with pytest.raises(NotApplicable, match="no stationary state"):
        simulate(loose)
    table = absorber(excitation=TabulatedNoise(on="base", profile="navmat-p-9492"))
    with pytest.raises(NotApplicable, match="too far apart"):
        simulate(table)


def row_of_masses(modes: int, *excitations: object) -> Scene:
    """Masses in a row, each on a spring and a damper of its own."""
    stiffness = 3.0 * np.eye(modes) - np.eye(modes, k=1) - np.eye(modes, k=-1)
    return Scene(
        structure=Matrices(
            coordinates=[f"m{k}" for k in range(modes)], mass=np.eye(modes).tolist(),
            damping=(0.1 * np.eye(modes)).tolist(), stiffness=stiffness.tolist(),
        ),
        excitations=[WhiteNoise(on="m0", intensity=0.2), *excitations],
    )  # fmt: skip


@pytest.mark.parametrize("modes", [2, 5, 10, 30])
def test_moments_of_many_modes_are_sampled_less_often(modes: int) -> None:
    plan = plan_modal(model_of(row_of_masses(modes)), None, None)
    moments = modes + modes * (modes + 1)
    assert moments / plan._stride <= 4.5 * modes
    # with few modes samples are 0.8 rad apart, as of one oscillator
    angle = plan.fastest * plan.step * (plan._stride - 1)
    assert (angle < 0.8) is (modes <= 10)


def test_a_sine_is_not_sampled_at_one_phase_beside_many_modes() -> None:
    sine = Sine(on="m0", amplitude=1.0, frequency_hz=2.0)
    quiet = plan_modal(model_of(row_of_masses(30)), None, None)
    with_sine = plan_modal(model_of(row_of_masses(30, sine)), None, None)
    turn = 2.0 * math.pi * 2.0 * with_sine.step * with_sine._stride
    assert turn < 2.0 < quiet.fastest * quiet.step * quiet._stride


def test_matrix_passes_are_products_of_any_rows() -> None:
    rng = np.random.default_rng(1)
    states, normals = rng.normal(size=(5, 16)), rng.normal(size=(3, 16))
    own, other = np.zeros((5, 5)), np.zeros((5, 3))
    # rows of 2 and 2, of 1 and 2, of 2 and 1, of 5 and 3, and of zeros
    for row, (first, second) in enumerate([(2, 2), (1, 2), (2, 1), (5, 3), (0, 0)]):
        own[row, rng.permutation(5)[:first]] = rng.normal(size=first)
        other[row, rng.permutation(3)[:second]] = rng.normal(size=second)
    found = rng.normal(size=(5, 16))
    matrix_passes(found, states, _table(own), normals, _table(other), 16)
    np.testing.assert_allclose(found, own @ states + other @ normals, rtol=0.0, atol=1e-14)


def with_an_idle_mass(restitution: float) -> Scene:
    """A mass between stops, and another one that has nothing to do with it."""
    return Scene(
        structure=Matrices(
            coordinates=["x", "idle"], mass=np.eye(2).tolist(), damping=(0.1 * np.eye(2)).tolist(),
            stiffness=np.eye(2).tolist(),
        ),
        impact_pairs=[
            ImpactPair(on="x", lower=-1.0, upper=1.0, law=Restitution(coefficient=restitution))
        ],
        excitations=[WhiteNoise(on="x", intensity=0.2), WhiteNoise(on="idle", intensity=0.2)],
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [0.1, 0.3])
def test_slow_impacts_of_any_structure_are_resolved(restitution: float) -> None:
    scene = with_an_idle_mass(restitution)
    found, usual = (
        simulate(scene, paths=1024, seed=1, slow_impacts=slow).impact_pairs["stops"]
        for slow in (True, False)
    )
    alone = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=restitution))],
        excitations=[WhiteNoise(intensity=0.2)],
    )  # fmt: skip
    truth = fokker_planck(alone).impact_pairs["stops"]
    assert found.speed_threshold == pytest.approx(truth.speed_threshold, rel=1e-6)
    for name in ("collision_rate", "impact_speed_rate", "impact_speed_square_rate"):
        one, other = getattr(found, name), getattr(truth, name)
        # below R = 0.163 all impacts are infinitely many, and no bias of a rate is stated
        assert (one.bias is None) is (restitution < 0.2 and name == "collision_rate")
        reach = 4.5 * one.standard_error + (one.bias or 0.0) + other.bias
        assert abs(one.value - other.value) < reach
    # negative control: the usual step misses slow impacts, and does not state how many
    assert usual.collision_rate.bias is None
    error = math.hypot(found.collision_rate.standard_error, usual.collision_rate.standard_error)
    missed = found.collision_rate.value - usual.collision_rate.value
    assert restitution > 0.2 or missed > 4.5 * error


def test_what_refines_no_steps_refuses_slow_impacts() -> None:
    rigid = with_an_idle_mass(0.3)
    noise = TabulatedNoise(on="x", frequency_hz=[0.1, 0.3], density=[1.0, 1.0], unit="N2/Hz")
    soft = ImpactPair(name="soft", on="idle", upper=1.0, law=Elastic(stiffness=100.0))
    for scene, match in (
        (rigid.replace(excitations=[*rigid.excitations, noise]), "left out with tabulated noise"),
        (rigid.replace(impact_pairs=[*rigid.impact_pairs, soft]), "left out with compliant stops"),
    ):
        with pytest.raises(NotApplicable, match=match):
            simulate(scene, paths=8, duration=10.0, slow_impacts=True)


# ------------------------------------------------------------------------------
# Absolute accelerations of several coordinates on a moving base: exact laws, with stops too.
# ------------------------------------------------------------------------------


THETA = 0.8
"""S0 / (2 b) of the first coordinate, m^2/s^2, where its damping rate is B."""

B, OMEGA = 0.3, 1.4


def two(**pair: object) -> Scene:
    """Two masses that share the base alone: the first has an oscillator's law of its own."""
    masses, damping, springs = np.array([[2.0, 0.5], [B, 0.2], [OMEGA**2, 4.0]])
    return Scene(
        structure=Matrices(
            coordinates=["a", "b"],
            mass=np.diag(masses),
            damping=np.diag(masses * damping), stiffness=np.diag(masses * springs),
        ),
        impact_pairs=[ImpactPair(on="a", **pair)] if pair else [],
        excitations=[WhiteNoise(on="base", intensity=2.0 * B * THETA)],
    )  # fmt: skip


def acceleration(scene: Scene) -> Estimate:
    found = simulate(scene, paths=256, seed=4, threads=1).coordinates["a"].acceleration_std
    assert found is not None
    return found


def law_of_a(scene: Scene) -> GibbsLaw:
    (pair,) = model_of(scene).pairs
    gap = Gap.of_pair(pair, omega=OMEGA, damping_rate=0.0, load=0.0)
    return GibbsLaw.of(gap, theta=THETA)


def test_between_elastic_rigid_stops_springs_and_dampers_pull() -> None:
    scene = two(lower=-0.5, upper=0.9, law=Restitution(coefficient=1.0))
    law = law_of_a(scene)
    square = B**2 * THETA + OMEGA**4 * law.variance
    assert_agrees(acceleration(scene), math.sqrt(square))


def test_one_oscillator_between_rigid_stops_has_the_acceleration_between_impacts() -> None:
    law = Restitution(coefficient=1.0)
    scene = Scene(
        structure=Isolator(mass=2.0, damping=2.0 * B, stiffness=2.0 * OMEGA**2),
        impact_pairs=[ImpactPair(lower=-0.5, upper=0.9, law=law)],
        excitations=[WhiteNoise(intensity=2.0 * B * THETA)],
    )
    found = simulate(scene, rel_error=0.02, seed=4, threads=1)
    square = B**2 * THETA + OMEGA**4 * law_of_a(scene).variance
    assert_agrees(found.coordinates["x"].acceleration_std, math.sqrt(square))
    assert BETWEEN_IMPACTS in found.assumptions


def test_stops_that_give_way_pull_as_well() -> None:
    stiffness = 30.0
    scene = two(lower=-0.5, upper=0.9, law=Elastic(stiffness=stiffness))
    law = law_of_a(scene)
    touching = [law.contact(side) for side in ("lower", "upper")]
    share = sum(each.probability for each in touching if each is not None)
    # of the Gibbs law exp(-U / theta), E U'^2 = theta E U''
    square = THETA * (B**2 + OMEGA**2 + stiffness / 2.0 * share)
    without = THETA * (B**2 + OMEGA**2)
    found = acceleration(scene)
    assert_agrees(found, math.sqrt(square))
    assert_differs(found, math.sqrt(without))


def test_linear_accelerations_are_those_of_closed_form_and_simulation() -> None:
    table = TabulatedNoise(
        on="base", frequency_hz=[0.05, 2.0], density=[0.3, 0.1], unit="(m/s2)2/Hz"
    )
    coupled = two().structure.model_dump() | {"stiffness": [[6.0, -1.5], [-1.5, 2.0]]}
    scene = Scene(structure=Matrices(**coupled), excitations=[table, *two().excitations])
    closed, closure = exact(scene), linearise(scene)
    found = simulate(scene, rel_error=0.03, seed=2, threads=1)
    for name in ("a", "b"):
        truth = float(closed.coordinates[name].acceleration_std)
        assert float(closure.coordinates[name].acceleration_std) == pytest.approx(truth, rel=1e-12)
        assert_agrees(found.coordinates[name].acceleration_std, truth)


def test_a_point_of_a_rigid_body_moves_as_its_coordinates_say() -> None:
    """Its acceleration follows from that of a box whose centre of mass is described from there."""
    place = np.array([0.1, -0.2, 0.05])
    scene = scene_with(box(points={"display": place}))
    found, model = exact(scene).coordinates, model_of(scene)
    rows = dict(zip(model.outputs, model.output_rows, strict=True))
    q = np.array([0.1, -0.3, 0.2, 0.02, -0.01, 0.03])
    for axis, moved in zip("xyz", q[:3] + np.cross(q[3:], place), strict=True):
        assert rows[f"display.{axis}"] @ q == pytest.approx(moved, rel=1e-13)
        assert float(found[f"display.{axis}"].acceleration_std) > 0.0


def test_a_force_on_a_mass_leaves_accelerations_out() -> None:
    scene = two()
    pushed = Scene(
        structure=scene.structure,
        excitations=[*scene.excitations, WhiteNoise(on="b", intensity=1.0)],
    )
    assert exact(pushed).coordinates["a"].acceleration_std is None
    assert exact(scene).coordinates["a"].acceleration_std is not None


# ------------------------------------------------------------------------------
# Tabulated noise on several coordinates: frequency integrals, other engines, the parts.
# ------------------------------------------------------------------------------


OMEGA_ONE = 24.0 * math.pi
TRUCK = TabulatedNoise(on="base", profile="mil-std-810h-truck-vertical-5hz")
SOFT = Viscoelastic(stiffness=4e5, damping_ratio=0.3)


def without_pairs(scene: Scene) -> Scene:
    return scene.model_copy(update={"impact_pairs": ()})


def mount(law: Law | None, matrices: bool, more: tuple = ()) -> Scene:
    """12 Hz, zeta 0.1, 1 kg, stops at 2 sigma and 1 sigma."""
    structure = Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    if matrices:
        structure = Matrices(
            coordinates=["x"], mass=[[1.0]], damping=[[0.2 * OMEGA_ONE]], stiffness=[[OMEGA_ONE**2]]
        )
    pair = ImpactPair(name="stops", on="x", lower=-4e-3, upper=2e-3, law=law) if law else None
    return Scene(
        structure=structure, impact_pairs=[pair] if pair else [], excitations=[TRUCK, *more]
    )


# ---- frequency integrals ---------------------------------------------------------------------


def test_a_rough_law_knows_of_tables() -> None:
    modes = model_of(without_pairs(two_stages(SOFT, SOFT))).modal
    law = linear_law(modes)
    assert law is not None
    whole = covariance(modes.tables, np.diag(modes.squares), modes.damping)
    np.testing.assert_allclose(law.covariance, whole, rtol=1e-12)


# ---- without stops ---------------------------------------------------------------------------


@pytest.mark.parametrize("white", [False, True], ids=["table", "table and white"])
def test_without_stops_the_variances_are_exact(white: bool) -> None:
    scene = without_pairs(two_stages(SOFT, SOFT))
    if white:
        noise = WhiteNoise(on="box", intensity=4e3)
        scene = scene.model_copy(update={"excitations": (TRUCK, noise)})
    modes = model_of(scene).modal
    law = linear_law(modes)
    assert law is not None
    shapes = np.kron(np.eye(2), modes.shapes)
    truth = np.diag(shapes @ law.covariance @ shapes.T)
    response = simulate(scene, paths=64, seed=2)
    for row, name in enumerate(("frame", "box")):
        found = response.coordinates[name]
        for quantity, known in (
            ("displacement_mean_square", truth[row]),
            ("velocity_mean_square", truth[2 + row]),
        ):
            estimate = found[quantity]
            assert_agrees(estimate, known)
            assert estimate.standard_error < 0.03 * known
    assert_balanced(response)


# ---- what comes with a table ------------------------------------------------------------------


COMPANY = {
    "white": WhiteNoise(on="base", intensity=0.05),
    "filtered": FilteredNoise(on="base", intensity=0.3, frequency_hz=14.0, zeta=0.1),
    "sine": Sine(on="base", amplitude=8.0, frequency_hz=10.0),
}


@pytest.mark.parametrize("more", COMPANY.values(), ids=COMPANY.keys())
def test_what_comes_with_a_table_is_a_state(more: object, monkeypatch) -> None:
    """It is kicked, or a state; beside it, it is synthesised as a table of its own."""
    scene = mount(Restitution(coefficient=0.7), False, (more,))
    ours = simulate(scene, paths=96, duration=20.0, seed=6)
    monkeypatch.setattr(monte_carlo, "model_of", lambda each: with_tables(model_of(each)))
    twin = simulate(scene, paths=96, duration=20.0, seed=5).estimates()
    for key, estimate in ours.estimates().items():
        if key in twin and estimate.bias is not None and twin[key].bias is not None:
            assert_same(estimate, twin[key])
    assert_balanced(ours)


def test_half_the_company_is_told_from_it() -> None:
    """The negative control of the comparisons above."""
    law = Restitution(coefficient=0.7)
    faint = FilteredNoise(on="base", intensity=0.15, frequency_hz=14.0, zeta=0.1)
    one, two = (
        simulate(mount(law, True, (more,)), paths=96, duration=20.0)
        for more in (COMPANY["filtered"], faint)
    )
    key = ("stops", "impact_speed_rate")
    assert_differs(apart(one.estimates()[key], two.estimates()[key]), 0.0)


# ---- several coordinates ---------------------------------------------------------------------


@pytest.mark.parametrize("law", [Restitution(coefficient=0.6), SOFT], ids=["rigid", "soft"])
def test_two_stages_balance_their_forces(law: Law) -> None:
    response = simulate(two_stages(law, Restitution(coefficient=0.5)), paths=32, seed=4)
    assert set(response.identities) == {"force on frame", "force on box"}
    for residual in response.identities.values():
        assert_agrees(residual, 0.0)
        assert residual.standard_error < 1e-3


def loose(**noise: object) -> Scene:
    """A mass in a box on a mount of 12 Hz."""
    return Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0),
        absorber=Absorber(mass=0.1, play=8e-3, law=Viscoelastic(stiffness=2e4, damping_ratio=0.4)),
        excitations=[TabulatedNoise(on="base", **noise)],
    )


def test_a_loose_mass_on_a_shaken_base() -> None:
    """It has no stiffness: what the table brings it alone is 1 / w^2 of it."""
    response = simulate(
        loose(frequency_hz=[5.0, 40.0], density=[1.0, 1.0], unit="(m/s2)2/Hz"), paths=32, seed=6
    )
    assert_balanced(response)
    box = response.impact_pairs["box"]
    assert abs(box["relative_displacement_mean"].value) < 4.5 * (
        box["relative_displacement_mean"].standard_error + box["relative_displacement_mean"].bias
    )
    assert box["peak_force"].value > 0.0
    assert "tabulated noise on base" in response.effects


# ---- the parts -------------------------------------------------------------------------------


def test_nothing_much_lies_beyond_the_cut() -> None:
    scene = without_pairs(two_stages(SOFT, SOFT))
    plan = make_plan(model_of(scene), None, None)
    modes = plan.modes
    f, left = beyond(modes.tables, np.diag(modes.squares), modes.damping, modes.shapes)
    assert np.all(left[f > 0.5 / plan.step][0] <= LARGEST_LOSS * left[0])
    # what is, is folded back: the velocities of a block have their variances
    omega = 2.0 * np.pi / plan.block_length * np.arange(1, plan.samples // 2)
    squares = np.sum(omega[:, None, None] ** 2 * np.abs(plan.amplitudes) ** 2, axis=(0, 2))
    truth = covariance(modes.tables, np.diag(modes.squares), modes.damping)
    np.testing.assert_allclose(squares, np.diag(truth)[2:], rtol=1e-3)


def test_a_record_is_continuous_within_its_block() -> None:
    scene = two_stages(SOFT, Restitution(coefficient=0.6))
    record = record_path(scene, duration=5.0, seed=2)
    gap = record["displacement of box"] - record["displacement of frame"]
    assert gap.max() <= 3e-3 + 1e-12 and gap.min() >= -2e-3 - 1e-12
    steps = record["displacement of frame"].diff().abs().max()
    assert steps < 2.0 * record["velocity of frame"].abs().max() * record["time"].iloc[0]


def test_what_never_settles_is_refused() -> None:
    undamped = Scene(
        structure=Matrices(
            coordinates=["a", "b"],
            mass=np.eye(2),
            damping=np.diag([1.0, 0.0]),
            stiffness=np.diag([1e4, 4e4]),
        ),
        excitations=[TRUCK],
    )
    with pytest.raises(NotApplicable, match="no stationary state"):
        simulate(undamped)
    kept = undamped.model_copy(
        update={
            "impact_pairs": (
                ImpactPair(on="b", lower=-1e-3, upper=1e-3, law=Restitution(coefficient=0.5)),
            )
        }
    )
    with pytest.raises(NotApplicable, match="damping > 0 in every mode"):
        simulate(kept)


@pytest.mark.parametrize("law", [Restitution(coefficient=0.5), SOFT], ids=["rigid", "compliant"])
def test_a_mass_that_is_pressed_onto_its_stop_moves_as_it_does_alone(law: Law) -> None:
    """Beside a second mass that nothing couples to it, a mass has the samples and the rates that it
    has alone, where another kernel simulates it."""
    pressing = -STANDARD_GRAVITY / OMEGA_ONE**2
    pair = ImpactPair(name="stops", on="x", upper=pressing, law=law)
    plans = []
    for count in (1, 2):
        structure = Matrices(
            coordinates=["x", "y"][:count], mass=np.eye(count),
            damping=0.2 * OMEGA_ONE * np.eye(count), stiffness=OMEGA_ONE**2 * np.eye(count),
        )  # fmt: skip
        scene = Scene(structure=structure, impact_pairs=[pair], excitations=[TRUCK])
        plans.append(make_plan(model_of(scene), 0.01, 10.0))
    alone, beside = plans
    assert beside.step == pytest.approx(alone.step, rel=0.02)
    assert beside.step < 0.5 * make_plan(model_of(without_pairs(scene)), None, 10.0).step
    found = []
    for plan in plans:
        rows = [plan.layout.rows.index(("stops", name)) for name in ("n_upper", "f1_upper")]
        fine, coarse = (each.averages(5, 0, 24)[rows] for each in (plan, plan.coarser()))
        biases = [plan.step_bias("", change) for change in np.mean(fine - coarse, axis=1)]
        found.append((fine.mean(axis=1), np.var(fine, axis=1, ddof=1) / 24, np.abs(biases)))
    (one, scatter, bias), (other, more, too) = found
    error = np.sqrt(scatter + more)
    print(one, other, error, bias, too)
    assert np.all(np.abs(one - other) < bias + too + 4.5 * error)
    assert np.all(error < 0.02 * one)


# A mass that a load presses onto its stop ---------------------------------------------------------


def pressed_pair(load: float) -> Scene:
    """Two masses; the first is shaken and pressed onto a stop where its spring is slack."""
    return Scene(
        structure=Matrices(
            coordinates=["a", "b"],
            mass=[[10.0, 0.0], [0.0, 2.0]],
            damping=[[80.0, -20.0], [-20.0, 20.0]],
            stiffness=[[6e4, -2e4], [-2e4, 2e4]],
        ),
        impact_pairs=[ImpactPair(on="a", lower=0.0, law=Restitution(coefficient=0.4))],
        excitations=[
            TabulatedNoise(on="a", frequency_hz=[5.0, 100.0], density=[4.0, 4.0], unit="N2/Hz"),
            ConstantLoad(on="a", force=-load),
        ],
    )


@numba.njit
def pressed_sums(force, dt, load):  # type: ignore[no-untyped-def]
    """F1, F2, the mean place of a and the mean square velocity of b, in short steps."""
    x, y, v, w = 0.0, 0.0, 0.0, 0.0
    sums = np.zeros(4)
    first = len(force) // 8
    for n in range(len(force)):
        one = (force[n] - load - 6e4 * x + 2e4 * y - 80.0 * v + 20.0 * w) / 10.0
        two = (2e4 * (x - y) + 20.0 * (v - w)) / 2.0
        v, w = v + one * dt, w + two * dt
        x, y = x + v * dt, y + w * dt
        hit = -v if x < 0.0 and v < 0.0 else 0.0
        x, v = max(x, 0.0), v if hit == 0.0 else 0.4 * hit
        if n >= first:
            sums += np.array([hit / dt, hit * hit / dt, x, w * w])
    return sums / (len(force) - first)


def pressed_by_steps(load: float, seed: int) -> tuple[Vector, Vector]:
    """The same averages of 12 records of 18 s, and their standard errors."""
    dt, count, records = 2e-5, 2**20, 12
    random = np.random.default_rng(seed)
    frequency = np.fft.rfftfreq(count, dt)
    band = (frequency >= 5.0) & (frequency <= 100.0)
    found = []
    for _ in range(records):
        lines = np.zeros(len(frequency), complex)
        parts = random.standard_normal((2, int(band.sum())))
        lines[band] = (parts[0] + 1j * parts[1]) * math.sqrt(4.0 * count / dt / 4.0)
        found.append(pressed_sums(np.fft.irfft(lines, count), dt, load))
    return np.mean(found, axis=0), np.std(found, axis=0, ddof=1) / math.sqrt(records)


@pytest.mark.slow
@pytest.mark.parametrize("load", [8.0, 18.0, 60.0])
def test_a_mass_that_is_pressed_onto_its_stop(load: float) -> None:
    """The spring in place of the stop must not make the mass seem at rest, and the step vanish."""
    found = simulate(pressed_pair(load), paths=32, duration=20.0, seed=2)
    known, errors = pressed_by_steps(load, 1)
    pair = next(iter(found.impact_pairs.values()))
    judged = {
        "F1": (pair.impact_speed_rate, known[0], errors[0]),
        "F2": (pair.impact_speed_square_rate, known[1], errors[1]),
        "place": (found.coordinates["a"].displacement_mean, known[2], errors[2]),
        "other mass": (found.coordinates["b"].velocity_mean_square, known[3], errors[3]),
    }
    for name, (estimate, truth, error) in judged.items():
        assert estimate is not None and estimate.bias is not None
        # a mass that lies still is, for the plain steps, one that hits in each of them
        if load < 60.0 or name != "F2":
            both = replace(estimate, standard_error=math.hypot(estimate.standard_error, error))
            assert_agrees(both, truth)
            if load < 60.0:
                assert_differs(both, 1.3 * truth)
    # the impulses (1 + R) m F1 hold the load and the spring, in both
    assert known[0] * 14.0 == pytest.approx(load + 4e4 * known[2], rel=0.01)


def test_steps_of_a_pressed_box_are_those_of_one_mass() -> None:
    """Cargo on a floor: the time between samples follows from what shakes it, whatever the load."""
    steps = [make_plan(model_of(pressed_pair(load))).step for load in (3.0, 18.0, 60.0, 300.0)]
    assert max(steps) == pytest.approx(min(steps), rel=0.1) and min(steps) > 1e-3


def box_on_its_stop(sideways: float) -> Scene:
    """A box that is shaken along z, and along x by so many times less."""
    mounts = [
        {"at": [x, y, -0.06], "stiffness": [2.2e4, 2.2e4, 3.4e4], "loss_factor": 0.3}
        for x in (-0.2, 0.2)
        for y in (-0.15, 0.15)
    ]
    pair = {"name": "stop", "at": [0.0, 0.0, -0.08], "direction": [0, 0, 1], "lower": -8e-4,
            "law": Restitution(coefficient=0.4)}  # fmt: skip
    return Scene(
        structure=RigidBody(mass=12.0, inertia=[0.2, 0.25, 0.15], mount=mounts, gravity="-z"),  # type: ignore[arg-type]
        impact_pair=[pair],  # type: ignore[call-arg]
        excitations=[
            TabulatedNoise(
                axis=axis, frequency_hz=[5.0, 200.0], density=[density] * 2, unit="(m/s2)2/Hz"
            )
            for axis, density in (("z", 0.2), ("x", 0.2 * sideways**2))
            if density
        ],
    )


@pytest.mark.parametrize("sideways", [0.0, 1e-6])
def test_no_accuracy_waits_for_a_coordinate_at_rest(sideways: float) -> None:
    """Motion that is small is waited for, but not that of rounding, which took more paths."""
    plan = make_plan(model_of(box_on_its_stop(sideways)), 0.01, 2.0)
    found = PathStatistics.of(plan.averages(3, 0, 8), plan.layout)
    run: Any = SimpleNamespace(fine=found, model=plan.model)
    waited = {owner for owner, _ in monte_carlo.relative_standard_errors(run)}
    assert waited == {"z", "stop"} | ({"x", "ry"} if sideways else set())
    assert found.means()["y", "vv"] > 0.0  # by rounding


# ------------------------------------------------------------------------------
# Rows of numbers of many paths: where they lie, what they share, and that they are kept.
# ------------------------------------------------------------------------------


@kernel
def filled(rows):  # type: ignore[no-untyped-def]
    memory = aligned_rows(rows)
    words = words_of(memory)
    for row in range(rows):
        for lane in range(LANES):
            memory[row, lane] += row + 0.5 * lane
    return memory, words


@pytest.mark.parametrize("rows_of", [filled, filled.py_func])
def test_rows_begin_at_lines_of_the_cache_and_words_are_their_bits(rows_of) -> None:  # type: ignore[no-untyped-def]
    wanted = np.arange(3)[:, None] + 0.5 * np.arange(LANES)
    kept = []
    for _ in range(20):  # places of memory differ
        memory, words = rows_of(3)
        assert memory.ctypes.data % 64 == 0 and memory.strides == (8 * ROW, 8)
        kept.append((memory, words))
    del memory, words
    gc.collect()
    for memory, words in kept:
        assert memory.shape == words.shape == (3, ROW)
        np.testing.assert_array_equal(memory[:, :LANES], wanted)
        assert not memory[:, LANES:].any()
        np.testing.assert_array_equal(words, memory.view(np.uint64))


def test_words_keep_their_memory() -> None:
    words = filled(2)[1]
    before = words.copy()
    gc.collect()
    rest = [np.ones((2, ROW)) for _ in range(50)]  # would take the place, were it free
    np.testing.assert_array_equal(words, before)
    assert len(rest) == 50


# ------------------------------------------------------------------------------
# A reed that slaps against a stop on a base that moves at random: modes against 200 elements.
# ------------------------------------------------------------------------------


LENGTH, WIDTH, HEIGHT, YOUNG, DENSITY = 0.2, 0.02, 0.002, 2e11, 7850.0
CLEARANCE, STIFFNESS, LEVEL, ZETA = 5e-4, 2e4, 0.01, 0.02


def by_elements(duration: float, step: float) -> dict[str, Estimate]:
    """Impact rate, F1, mean peak force and rms of 64 paths of 200 elements, by Newmark's rule."""
    place = CHECKOUT / "studies" / "24_slapping_beam" / "elements.py"
    spec = importlib.util.spec_from_file_location("elements", place)
    assert spec is not None and spec.loader is not None
    elements: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(elements)
    beam = (LENGTH, YOUNG * WIDTH * HEIGHT**3 / 12.0, DENSITY * WIDTH * HEIGHT)
    decay = 2.0 * ZETA * reed(1).table.omega[0]
    stop = (CLEARANCE, STIFFNESS, LEVEL * 9.80665**2 / 2.0)
    found = elements.slapping(beam, decay, stop, duration, step, count=200)
    return {
        name: Estimate(value=float(value), standard_error=float(error))
        for name, (value, error) in found.items()
    }


def reed(modes: int) -> Beam:
    return Beam(
        length=LENGTH, width=WIDTH, height=HEIGHT, young=YOUNG, density=DENSITY, zeta=ZETA,
        modes=modes,
    )  # fmt: skip


def by_modes_of_reed(modes: int, rel_error: float) -> dict[str, Estimate]:
    """The same by modes that all decay at one rate, as elements with C proportional to M do."""
    beam, table = reed(modes), reed(modes).table
    structure = Modes(
        frequency_hz=table.omega / math.tau, zeta=ZETA * table.omega[0] / table.omega,
        modal_mass=table.mass, shapes=table.shapes, participation=table.participation,
        residual_compliance={"tip": beam.compliance({"tip": 1.0})},
    )  # fmt: skip
    scene = Scene(
        structure=structure, excitations=[WhiteNoise(on="base", density=LEVEL, unit="g2/Hz")],
        impact_pairs=[ImpactPair(on="tip", upper=CLEARANCE, law=Elastic(stiffness=STIFFNESS))],
    )  # fmt: skip
    found = simulate(scene, rel_error=rel_error, seed=1)
    pair, square = found.impact_pairs["stops"], found.coordinates["tip"].displacement_mean_square
    rms = math.sqrt(square.value)
    return {
        "rate": pair.collision_rate, "F1": pair.impact_speed_rate, "peak force": pair.peak_force,
        "rms of the tip": square * (0.5 / rms) + 0.5 * rms,
    }  # fmt: skip


@pytest.mark.verify
def test_modes_of_a_slapping_reed_converge_to_200_elements() -> None:
    truth = by_elements(duration=1.0, step=2e-5)
    found = {modes: by_modes_of_reed(modes, 0.02) for modes in (1, 3, 6)}

    def difference(modes: int, name: str) -> Estimate:
        one, other = found[modes][name], truth[name]
        error = math.hypot(one.standard_error, other.standard_error)
        return Estimate(value=one.value - other.value, standard_error=error, bias=one.bias)

    for name in truth:
        assert_agrees(difference(6, name), 0.0)
    for name in ("rate", "F1", "rms of the tip"):  # one mode is not enough
        assert_differs(difference(1, name), 0.0)
    errors = {n: abs(difference(n, "F1").value) for n in found}
    assert errors[1] > errors[3] > errors[6]
