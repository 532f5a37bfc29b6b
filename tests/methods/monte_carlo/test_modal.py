"""Several modes, pairs and signals: exact laws, balances, other engines, and the kernel's roots."""

from __future__ import annotations

import math
from dataclasses import replace

import numba
import numpy as np
import pytest
from scipy.linalg import expm

from stochvi import (
    Elastic,
    Estimate,
    ImpactPair,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    exact,
    fokker_planck,
    simulate,
)
from stochvi.engine.alone import put_on_stop
from stochvi.engine.impact_log import COLUMNS, Log
from stochvi.engine.pushes import V1, Y1, Responses
from stochvi.engine.roots import first_root
from stochvi.mathematics.state_space import stationary_covariance, step_covariance
from stochvi.methods.monte_carlo import record_path
from stochvi.methods.monte_carlo.kernels.matrix_passes import matrix_passes
from stochvi.methods.monte_carlo.modal import _table, plan_modal
from stochvi.methods.monte_carlo.path_statistics import PathStatistics
from stochvi.methods.monte_carlo.quantities import of_coordinate, of_pair
from stochvi.model.balances import residuals
from stochvi.model.model import model_of
from stochvi.scenes.excitations import ConstantLoad, FilteredNoise, Sine
from stochvi.scenes.structures import Matrices
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases
from support.known import RIGID_STOPS, oscillator, values
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
    for residual in response.identities.values():
        assert_agrees(residual, 0.0)


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
    for residual in response.identities.values():
        assert_agrees(residual, 0.0)


def test_a_chain_between_elastic_stops_obeys_the_gibbs_law() -> None:
    """Noise matched to the damping, two pairs: against the density integrated on a grid."""
    names = ["a", "b"]
    tri = np.array([[2.0, -1.0], [-1.0, 2.0]])
    law = Restitution(coefficient=1.0)
    scene = Scene(
        structure=Matrices(
            coordinates=names, mass=np.diag([1.0, 0.4]), damping=np.diag([0.1, 0.3]), stiffness=tri
        ),
        impact_pairs=[
            ImpactPair(name="stops", on="a", lower=-0.7, upper=0.9, law=law),
            ImpactPair(name="gap", between=names, lower=-0.5, upper=1.0, law=law),
        ],
        excitations=[
            WhiteNoise(on="a", intensity=0.2),
            WhiteNoise(on="b", intensity=0.6),
        ],
    )
    assert model_of(scene).temperature == pytest.approx(1.0)
    nodes, weights = np.polynomial.legendre.leggauss(80)
    a, wa = 0.1 + 0.8 * nodes, weights
    y, wy = 0.25 + 0.75 * nodes, weights
    grid_a, grid_y = np.meshgrid(a, y, indexing="ij")
    grid_b = grid_a - grid_y
    density = np.exp(-(grid_a**2 + grid_b**2 - grid_a * grid_b)) * np.outer(wa, wy)
    density /= density.sum()
    response = simulate(scene, rel_error=0.02, seed=6)
    for name, grid in (("a", grid_a), ("b", grid_b)):
        found = response.coordinates[name]
        assert_agrees(found["displacement_mean"], float((grid * density).sum()))
        assert_agrees(found["displacement_mean_square"], float((grid**2 * density).sum()))
    assert_agrees(response.coordinates["b"]["velocity_mean_square"], 1.0 / 0.4)


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
    for residual in response.identities.values():
        assert_agrees(residual, 0.0)


def test_two_pairs_on_one_coordinate_are_the_tighter_of_their_stops() -> None:
    inner = ImpactPair(name="upper", on="x", upper=0.6, law=Restitution(coefficient=0.8))
    outer = ImpactPair(
        name="lower", on="x", lower=-1.0, upper=5.0, law=Restitution(coefficient=0.8)
    )
    scene = oscillator(-1.0, 0.6, 0.8).model_copy(update={"impact_pairs": (inner, outer)})
    both, one = (
        simulate(scene, rel_error=0.01, seed=8),
        simulate(oscillator(-1.0, 0.6, 0.8), rel_error=0.01, seed=9),
    )
    for name in ("displacement_std", "velocity_std", "displacement_mean"):
        ours, other = both.coordinates["x"][name], one.coordinates["x"][name]
        assert ours is not None and other is not None
        apart = Estimate(
            value=ours.value - other.value,
            standard_error=math.hypot(ours.standard_error, other.standard_error),
            bias=(ours.bias or 0.0) + (other.bias or 0.0),
        )
        assert_agrees(apart, 0.0)


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
        twin = other.estimates()[key]
        apart = Estimate(
            value=estimate.value - twin.value,
            standard_error=math.hypot(estimate.standard_error, twin.standard_error),
            bias=(estimate.bias or 0.0) + (twin.bias or 0.0),
        )
        assert_agrees(apart, 0.0)
    for residual in (*ours.identities.values(), *other.identities.values()):
        assert_agrees(residual, 0.0)


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
        basis = [math.comb(5, k) * grid**k * (1.0 - grid) ** (5 - k) for k in range(6)]
        value = c @ np.array(basis)
        above = np.flatnonzero(value > 0.0)
        if len(above) == 0:
            assert t == 2.0 or value.max() > -1e-6
            continue
        found += 1
        assert grid[above[0] - 1] - 1e-9 <= t <= grid[above[0]] + 1e-9
        assert slope == pytest.approx(np.gradient(value, grid)[above[0]], abs=1e-2)
    assert found > 200


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
    responses = Responses(series, of_gaps, *np.zeros((3, 2, 0, 2)))
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


def test_step_covariances_add_up_to_the_stationary_one() -> None:
    generator = np.array([[0.0, 1.0], [-4.0, -0.3]])
    noise = np.diag([0.0, 0.7])
    stationary = stationary_covariance(generator, noise)
    assert step_covariance(generator, noise, 400.0) == pytest.approx(
        stationary, rel=1e-9, abs=1e-12
    )
    steps = np.linspace(0.0, 0.5, 4001)
    grown = [expm(generator * s) @ noise @ expm(generator * s).T for s in steps[::40]]
    brute = np.trapezoid(grown, steps[::40], axis=0)
    assert step_covariance(generator, noise, 0.5) == pytest.approx(brute, rel=1e-4, abs=1e-6)


def test_digits_of_a_path_do_not_depend_on_its_block_or_the_threads() -> None:
    plan = plan_modal(model_of(absorber(0.8)), None, 50.0)
    whole = plan.averages(1, 0, 40)
    np.testing.assert_array_equal(whole[:, 30:], plan.averages(1, 30, 10))
    np.testing.assert_array_equal(whole[:, :1], plan.averages(1, 0, 1))
    one, two = (simulate(absorber(0.8), paths=300, duration=40.0, threads=n) for n in (1, 2))
    assert one.to_frame().equals(two.to_frame())


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
