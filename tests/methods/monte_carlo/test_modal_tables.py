"""Tabulated noise on several coordinates: frequency integrals, other engines, the parts."""

from __future__ import annotations

import math
from dataclasses import replace

import numba
import numpy as np
import pytest

from stochvi import (
    ConstantLoad,
    ImpactPair,
    Isolator,
    NotApplicable,
    Restitution,
    Scene,
    TabulatedNoise,
    Viscoelastic,
    WhiteNoise,
    simulate,
)
from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.frequency_response import beyond, bin_amplitudes, covariance, gains
from stochvi.mathematics.spectra import Table
from stochvi.mathematics.state_space import stationary_covariance
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.methods.monte_carlo import record_path
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.modal_tables import plan_modal_tables
from stochvi.methods.monte_carlo.tabulated import LARGEST_LOSS, TabulatedPlan
from stochvi.model.modal import linear_law
from stochvi.model.model import model_of
from stochvi.scenes import Hertz
from stochvi.scenes.absorbers import Absorber
from stochvi.scenes.excitations import FilteredNoise, Sine
from stochvi.scenes.impact_laws import Law
from stochvi.scenes.structures import Matrices
from stochvi.testing import assert_agrees
from support.mounts import two_stages
from support.samples import apart

OMEGA = 24.0 * math.pi
TRUCK = TabulatedNoise(on="base", profile="mil-std-810h-truck-vertical-5hz")
SOFT = Viscoelastic(stiffness=4e5, damping_ratio=0.3)


def without_pairs(scene: Scene) -> Scene:
    return scene.model_copy(update={"impact_pairs": ()})


def mount(law: Law | None, matrices: bool, more: tuple = ()) -> Scene:
    """12 Hz, zeta 0.1, 1 kg, stops at 2 sigma and 1 sigma."""
    structure = Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    if matrices:
        structure = Matrices(
            coordinates=["x"], mass=[[1.0]], damping=[[0.2 * OMEGA]], stiffness=[[OMEGA**2]]
        )
    pair = ImpactPair(name="stops", on="x", lower=-4e-3, upper=2e-3, law=law) if law else None
    return Scene(
        structure=structure, impact_pairs=[pair] if pair else [], excitations=[TRUCK, *more]
    )


# ---- frequency integrals ---------------------------------------------------------------------


def structure() -> tuple[np.ndarray, np.ndarray, list]:
    """Modal stiffness, damping (which couples the modes), and the truck's forces."""
    modes = model_of(without_pairs(two_stages(SOFT, SOFT))).modal
    assert abs(modes.damping[0, 1]) > 1e-3 * abs(modes.damping[0, 0])
    return np.diag(modes.squares), modes.damping, list(modes.tables)


def test_covariances_are_those_of_a_fine_grid() -> None:
    stiffness, damping, ((table, force),) = structure()
    f = np.linspace(5.0, 500.0, 400_001)[1:]
    h = gains(f, stiffness, damping, force)
    both = np.hstack([h, 2j * np.pi * f[:, None] * h])
    parts = np.einsum("fi,fj->fij", both, both.conj()).real * table(f)[:, None, None]
    brute = np.trapezoid(parts, f, axis=0)
    found = covariance([(table, force)], stiffness, damping)
    size = np.sqrt(np.outer(np.diag(brute), np.diag(brute)))
    np.testing.assert_allclose(found / size, brute / size, rtol=0, atol=1e-4)


def test_a_wide_flat_table_is_white_noise() -> None:
    """Against Lyapunov's equation, up to what lies beyond the table."""
    stiffness, damping, ((_, force),) = structure()
    wide = Table(frequency_hz=np.array([1e-4, 1e6]), density=np.array([2.0, 2.0]))
    n = len(force)
    generator = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness, -damping]])
    noise = np.zeros((2 * n, 2 * n))
    noise[n:, n:] = np.outer(force, force)
    white = stationary_covariance(generator, noise)
    found = covariance([(wide, force)], stiffness, damping)
    size = np.sqrt(np.outer(np.diag(white), np.diag(white)))
    np.testing.assert_allclose(found / size, white / size, rtol=0, atol=1e-4)


def test_bins_hold_all_of_the_response() -> None:
    stiffness, damping, ((table, force),) = structure()
    waves, velocities = bin_amplitudes(table, force, stiffness, damping, 10.0, 5002)
    whole = covariance([(table, force)], stiffness, damping)
    n = len(force)
    np.testing.assert_allclose(np.sum(np.abs(waves) ** 2, axis=0), np.diag(whole)[:n], rtol=1e-6)
    np.testing.assert_allclose(velocities.sum(axis=0), np.diag(whole)[n:], rtol=1e-6)
    # modes together: the phases are those of the middle of a bin
    cross = np.sum((waves[:, 0] * waves[:, 1].conj()).real)
    assert cross == pytest.approx(whole[0, 1], rel=2e-3)
    _, left = beyond([(table, force)], stiffness, damping, np.eye(n))
    np.testing.assert_allclose(left[0], np.diag(whole)[n:], rtol=1e-9)


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
        for quantity, exact in (
            ("displacement_mean_square", truth[row]),
            ("velocity_mean_square", truth[2 + row]),
        ):
            estimate = found[quantity]
            assert_agrees(estimate, exact)
            assert estimate.standard_error < 0.03 * exact
    for residual in response.identities.values():
        assert_agrees(residual, 0.0)


# ---- one oscillator, by the engine of its own -------------------------------------------------


@pytest.mark.parametrize(
    "law",
    [Restitution(coefficient=0.5), SOFT.per_unit_mass(4.0), Hertz(coefficient=1e6)],
    ids=["rigid", "viscoelastic", "Hertz"],
)
def test_paths_are_those_of_the_engine_for_one_oscillator(law: Law) -> None:
    """The same free responses, impacts by other kernels: one takes the whole motion between two
    samples for a cubic, the other the response to the table alone."""
    ours = plan_modal_tables(model_of(mount(law, matrices=True)), 0.0, 10.0)
    other = make_plan(model_of(mount(law, matrices=False)), 0.0, 10.0)
    assert isinstance(other, TabulatedPlan)
    assert (ours.samples, ours.block_length) == (other.samples, pytest.approx(other.block_length))
    ours = replace(ours, burn_in=other.warm_up)
    found = ours.averages(1, 0, 8)
    rows = other.layout.rows
    sums = np.zeros((len(rows), 8))
    free = ours.free_response(1, 0, 8, 0)[:, 0].copy()
    other.add_impacts(free, other.warm_up_samples, other._counted_samples, sums)
    sums /= other.duration
    compared = 0
    for row, key in enumerate(ours.layout.rows):
        if key[0] == "stops":
            twin = sums[rows.index(key)]
            np.testing.assert_allclose(found[row], twin, rtol=0, atol=2e-3 * np.abs(twin).max())
            compared += 1
            assert np.any(twin > 0.0) or "loss" in key[1]
    assert compared == (6 if law.rigid else 16)


COMPANY = {
    "white": WhiteNoise(on="base", intensity=0.05),
    "filtered": FilteredNoise(on="base", intensity=0.3, frequency_hz=14.0, zeta=0.1),
    "sine": Sine(on="base", amplitude=8.0, frequency_hz=10.0),
}


@pytest.mark.parametrize("more", COMPANY.values(), ids=COMPANY.keys())
def test_what_comes_with_a_table_is_a_state(more: object) -> None:
    """There it is synthesised as a table of its own; here it is kicked, or a state."""
    law = Restitution(coefficient=0.7)
    scene = mount(law, False, (more,))
    # a second pair, beyond reach, makes it a scene for the modal engine
    out_of_reach = ImpactPair(name="far", on="x", upper=0.1, law=Restitution(coefficient=1.0))
    by_modes = scene.model_copy(update={"impact_pairs": (*scene.impact_pairs, out_of_reach)})
    ours, other = (
        simulate(each, paths=96, duration=20.0, seed=seed)
        for seed, each in ((6, by_modes), (5, scene))
    )
    twin = other.estimates()
    for key, estimate in ours.estimates().items():
        if key in twin and estimate.bias is not None and twin[key].bias is not None:
            assert_agrees(apart(estimate, twin[key]), 0.0)
    assert any("modal" in each for each in ours.assumptions)
    assert not any("modal" in each for each in other.assumptions)
    for residual in ours.identities.values():
        assert_agrees(residual, 0.0)


def test_half_the_company_is_told_from_it() -> None:
    """The negative control of the comparisons above."""
    law = Restitution(coefficient=0.7)
    faint = FilteredNoise(on="base", intensity=0.15, frequency_hz=14.0, zeta=0.1)
    one, two = (
        simulate(mount(law, True, (more,)), paths=96, duration=20.0)
        for more in (COMPANY["filtered"], faint)
    )
    key = ("stops", "impact_speed_rate")
    with pytest.raises(AssertionError):
        assert_agrees(apart(one.estimates()[key], two.estimates()[key]), 0.0)


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
    for residual in response.identities.values():
        assert_agrees(residual, 0.0)
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


def test_digits_do_not_depend_on_blocks_or_threads() -> None:
    scene = two_stages(SOFT, Restitution(coefficient=0.6))
    plan = make_plan(model_of(scene), None, 3.0)
    whole = plan.averages(1, 0, 6)
    np.testing.assert_array_equal(whole[:, 4:], plan.averages(1, 4, 2))
    np.testing.assert_array_equal(whole[:, :1], plan.averages(1, 0, 1))
    one, two = (simulate(scene, paths=40, duration=2.0, threads=n) for n in (1, 2))
    assert one.to_frame().equals(two.to_frame())


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
    pressing = -STANDARD_GRAVITY / OMEGA**2
    pair = ImpactPair(name="stops", on="x", upper=pressing, law=law)
    plans = []
    for count in (1, 2):
        structure = Matrices(
            coordinates=["x", "y"][:count], mass=np.eye(count),
            damping=0.2 * OMEGA * np.eye(count), stiffness=OMEGA**2 * np.eye(count),
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
                with pytest.raises(AssertionError):
                    assert_agrees(both, 1.3 * truth)
    # the impulses (1 + R) m F1 hold the load and the spring, in both
    assert known[0] * 14.0 == pytest.approx(load + 4e4 * known[2], rel=0.01)


def test_steps_of_a_pressed_box_are_those_of_one_mass() -> None:
    """Cargo on a floor: the time between samples follows from what shakes it, whatever the load."""
    steps = [make_plan(model_of(pressed_pair(load))).step for load in (3.0, 18.0, 60.0, 300.0)]
    assert max(steps) == pytest.approx(min(steps), rel=0.1) and min(steps) > 1e-3
