"""The response domain: its spectrum against integrals, its paths against twins."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from stochvi import ImpactPair, Isolator, Restitution, Scene, TabulatedNoise, screen, simulate
from stochvi.engine.impact_log import COLUMNS, Log
from stochvi.engine.roots import first_upward_root
from stochvi.mathematics.spectra import response_moments, squared_gain
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.methods.monte_carlo import simulation
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.kernels.rows import (
    F1_LOWER,
    F1_UPPER,
    F2_UPPER,
    N_LOWER,
    N_UPPER,
    VV,
    XX,
    X,
)
from stochvi.methods.monte_carlo.step_bias import bias_of_lasting_contact
from stochvi.methods.monte_carlo.tabulated import (
    BIN_ERROR,
    FOLD_FROM,
    LARGEST_LOSS,
    TabulatedPlan,
)
from stochvi.model.model import model_of
from stochvi.scenes.datasets import profiles
from support.accuracies import quick_cases
from support.mounts import TRUCK, isolator
from support.naive import held_force, response_domain
from support.synthesis import AIM, SEED, coefficients


def mount(frequency_hz: float, profile: str, sigmas: float | None, restitution: float) -> Scene:
    """An isolator with its stops at so many standard deviations of the linear response."""
    scene = Scene(
        structure=Isolator(frequency_hz=frequency_hz, zeta=0.1),
        excitations=[TabulatedNoise(profile=profile)],
    )
    if sigmas is None:
        return scene
    gap = sigmas * screen(scene).displacement_std
    pair = ImpactPair(lower=-gap, upper=gap, law=Restitution(coefficient=restitution))
    return scene.model_copy(update={"impact_pairs": (pair,)})


def plan_of(scene: Scene, duration: float | None = None) -> TabulatedPlan:
    plan = make_plan(model_of(scene), 0.0, duration)
    assert isinstance(plan, TabulatedPlan)
    return plan


# ---- the spectrum of what is synthesised -----------------------------------------------------

SHIPPED = pytest.mark.parametrize(
    ("profile", "frequency_hz"), [(name, f) for name in profiles() for f in (8.0, 12.0, 50.0)]
)


def true_moments(plan: TabulatedPlan) -> tuple[float, float]:
    """E x^2, E v^2 by frequency integrals."""
    model = plan.model
    moments = response_moments(plan.tables, model.omega, model.damping_rate)
    return moments.displacement, moments.velocity


def frequencies(plan: TabulatedPlan) -> np.ndarray:
    """Of the bins that are synthesised, rad/s."""
    return 2.0 * np.pi / plan.block_length * np.arange(1, len(plan.amplitudes) + 1)


def crossing_rate(xx: float, xv: float, vv: float, level: float) -> float:
    """Upcrossings per second of a Gaussian x of mean 0 whose slope is correlated with it."""
    mean, spread = xv / xx * level, math.sqrt(vv - xv**2 / xx)
    slope = mean * norm.cdf(mean / spread) + spread * norm.pdf(mean / spread)
    return float(slope * norm.pdf(level / math.sqrt(xx)) / math.sqrt(xx))


def interpolated_crossing_rate(plan: TabulatedPlan, level: float) -> float:
    """Of the cubics through the samples and their slopes: a mean over the place in the interval,
    where x and x' are sums over bins of what the cubic makes of each e^(i w t)."""
    variances, turn = plan.amplitudes**2, 1j * frequencies(plan) * plan.step
    end = np.exp(turn)
    places, weights = np.polynomial.legendre.leggauss(12)
    rate = 0.0
    for s, weight in zip((places + 1.0) / 2.0, weights / 2.0, strict=True):
        x = (1 + 2 * s) * (1 - s) ** 2 + s**2 * (3 - 2 * s) * end
        x += turn * (s * (1 - s) ** 2 + s**2 * (s - 1) * end)
        v = 6 * s * (s - 1) * (1 - end) + turn * ((1 - s) * (1 - 3 * s) + s * (3 * s - 2) * end)
        v /= plan.step
        xx, vv = (float(np.sum(variances * np.abs(part) ** 2)) for part in (x, v))
        rate += weight * crossing_rate(
            xx, float(np.sum(variances * (x * v.conj()).real)), vv, level
        )
    return rate


@SHIPPED
def test_synthesised_variances_are_those_of_the_table(profile: str, frequency_hz: float) -> None:
    plan = plan_of(mount(frequency_hz, profile, 3.0, 0.5))
    xx, vv = true_moments(plan)
    variances, omega = plan.amplitudes**2, frequencies(plan)
    assert abs(np.sum(omega**2 * variances) / vv - 1.0) <= BIN_ERROR
    # what lies beyond the cut, and what takes its place, moves at least this fast
    slowest = FOLD_FROM * omega[-1]
    assert abs(np.sum(variances) - xx) <= (LARGEST_LOSS + BIN_ERROR) * vv / slowest**2
    # and in itself, the rate of crossings of 3 sigma is that of the table (Rice)
    level = 3.0 * math.sqrt(xx)
    synthesised = crossing_rate(float(np.sum(variances)), 0.0, np.sum(omega**2 * variances), level)
    assert abs(synthesised / crossing_rate(xx, 0.0, vv, level) - 1.0) <= 1.6e-4
    assert abs(math.sqrt(np.sum(variances) / xx) - 1.0) <= 2e-5
    assert abs(math.sqrt(np.sum(omega**2 * variances) / vv) - 1.0) <= 2e-5


@SHIPPED
def test_cubics_between_samples_cross_a_level_as_often(profile: str, frequency_hz: float) -> None:
    """What the head of the module says of 3 sigma, and that twice the interval is too long."""
    plan = plan_of(mount(frequency_hz, profile, 3.0, 0.5))
    xx, vv = true_moments(plan)
    level = 3.0 * math.sqrt(xx)
    truth = crossing_rate(xx, 0.0, vv, level)
    usual, coarse = (
        interpolated_crossing_rate(which, level) / truth - 1.0 for which in (plan, plan.coarser())
    )
    most = 0.0004 if (profile, frequency_hz) == (TRUCK, 12.0) else 0.0015
    assert -most <= usual <= 0.0
    assert coarse < -0.0015


def test_without_the_fold_velocity_is_missing() -> None:
    plan = plan_of(mount(8.0, "navmat-p-9492", 3.0, 0.5))
    omega = frequencies(plan)
    cut = np.sum(omega**2 * plan.bins[: len(omega)])
    assert cut / true_moments(plan)[1] < 1.0 - BIN_ERROR


def test_common_bins_of_two_sampling_rates_have_common_amplitudes() -> None:
    plan = plan_of(isolator(0.004))
    for which in (plan, plan.coarser(), plan.finer()):
        free = which.free_response(SEED, 7, 2, 0)
        spectrum = np.fft.rfft(free[:, 2], axis=0)[1:] / (which.samples / 2.0)  # y of path 8
        unfolded = int(FOLD_FROM * (plan.coarser().samples // 2 - 1))
        expected = coefficients(plan, 8, np.sqrt(plan.bins[:unfolded]))
        size = np.abs(expected).max()
        np.testing.assert_allclose(spectrum[:unfolded], expected, rtol=0, atol=1e-13 * size)


# ---- paths -----------------------------------------------------------------------------------

STOPS = {
    "both, lossy": (-2e-3, 2e-3, 0.5),
    "both, elastic": (-2e-3, 2e-3, 1.0),
    "narrow": (-2e-4, 3e-4, 0.8),
    "upper": (None, 1e-3, 0.7),
    "lower, preload": (5e-4, None, 0.7),
}


@pytest.mark.parametrize("duration", [0.15, pytest.param(0.5, marks=pytest.mark.verify)])
@quick_cases("case", STOPS.values(), ids=STOPS.keys(), keep=(0, 1, 3, 4))
def test_a_path_equals_its_plain_twin(
    case: tuple[float | None, float | None, float], duration: float
) -> None:
    lower, upper, restitution = case
    pair = ImpactPair(lower=lower, upper=upper, law=Restitution(coefficient=restitution))
    plan = plan_of(isolator(None).model_copy(update={"impact_pairs": (pair,)}), duration=duration)
    plan = replace(plan, warm_up=0.0)
    stops = [(u, restitution, side) for u, side in ((lower, -1.0), (upper, 1.0)) if u is not None]
    paths = 12 if upper is None else 3
    record = np.zeros((plan.steps, paths, 3))
    log = Log(np.empty((4000, COLUMNS)), np.zeros(1, np.int64), 0.0)
    averages = plan.averages(SEED, 0, paths, record, log=log)
    events = log.events[: log.count[0]]
    compared = 0
    for path in range(paths):
        # y and y' as sums of cosines, from one sample before the first
        when = plan.step * np.arange(-1, plan.steps)
        omega = frequencies(plan)
        wave = coefficients(plan, path, plan.amplitudes) * np.exp(1j * when[:, None] * omega)
        free = np.stack([wave.real.sum(axis=1), (1j * omega * wave).real.sum(axis=1)], axis=1)
        if any(side * free[0, 0] > side * u for u, _, side in stops):
            continue  # the twin begins inside
        if (record[:, path, 1] == 0.0).any():
            continue  # the twin knows no rest
        x, v, hits = response_domain(
            free, plan.step, plan.model.omega, plan.model.damping_rate, stops
        )
        compared += len(hits)
        np.testing.assert_allclose(record[:, path, 0], x, rtol=0, atol=1e-10)
        np.testing.assert_allclose(record[:, path, 1], v, rtol=0, atol=1e-8)
        speeds = np.zeros(len(x))
        for sample, side, w, _ in hits:
            speeds[sample] += side * w
        timed = np.array([(when, side * w) for _, side, w, when in hits if w >= plan.threshold])
        own = events[events[:, 0] == path]
        np.testing.assert_allclose(own[:, 2:], timed.reshape(-1, 2), rtol=0, atol=1e-8)
        np.testing.assert_allclose(record[:, path, 2], speeds, rtol=0, atol=1e-8)
        up = np.array([w for _, side, w, _ in hits if side > 0.0])
        down = [w for _, side, w, _ in hits if side < 0.0]
        duration = plan.duration
        assert averages[N_LOWER, path] == pytest.approx(len(down) / duration, rel=1e-12)
        assert averages[F2_UPPER, path] == pytest.approx(np.sum(up**2) / duration, abs=1e-8)
    assert compared > 3


def test_a_record_holds_what_the_averages_count_and_nothing_of_the_warm_up() -> None:
    plan = plan_of(isolator(0.003), duration=20.0)
    record = np.zeros((plan.steps, 3, 3))
    averages = plan.averages(SEED, 4, 3, record)
    x, v, speed = (record[:, :, part] for part in range(3))
    np.testing.assert_allclose(averages[X], x.mean(axis=0), rtol=1e-10)
    np.testing.assert_allclose(averages[XX], (x**2).mean(axis=0), rtol=1e-10)
    np.testing.assert_allclose(averages[VV], (v**2).mean(axis=0), rtol=1e-10)
    signed = averages[F1_UPPER] - averages[F1_LOWER]
    np.testing.assert_allclose(signed, speed.sum(axis=0) / plan.duration, rtol=1e-10)
    assert np.all(averages[F1_UPPER] > 0.0)


def test_the_first_upward_root_is_that_of_a_general_solver() -> None:
    rng = np.random.default_rng(3)
    found = 0
    for _ in range(2000):
        c = rng.standard_normal(4) * 10.0 ** rng.uniform(-2.0, 1.0, 4)
        c[0] = -abs(c[0])
        roots = np.roots(c[::-1])
        real = np.sort(roots.real[np.abs(roots.imag) < 1e-12])
        slopes = c[1] + real * (2.0 * c[2] + 3.0 * c[3] * real)
        inside = real[(real > 0.0) & (real <= 1.0) & (slopes > 0.0)]
        root = first_upward_root(*c)
        if len(inside) == 0:
            assert root == 2.0
            continue
        found += 1
        assert root == pytest.approx(inside[0], abs=1e-8)
    assert found > 500


# ---- against a brute force on the same noise -------------------------------------------------


def paired_differences(
    plan: TabulatedPlan, paths: int, rate: float, group: int
) -> tuple[np.ndarray, np.ndarray]:
    """(x^2, v^2, hits, F1, F2) of the engine and of a held force with the same coefficients."""
    model = plan.model
    top = max(float(table.frequency_hz[-1]) for table in plan.tables)
    # all of the table, and no fold
    full = plan.with_step(0.5 / (1.01 * top))
    omega = 2.0 * np.pi / plan.block_length * np.arange(1, full.samples // 2)
    response = np.sqrt(full.bins[: len(omega)])
    gain = 1.0 / (model.omega**2 - omega**2 + 1j * model.damping_rate * omega)
    np.testing.assert_allclose(
        np.abs(gain) ** 2,
        squared_gain(omega / (2.0 * np.pi), model.omega, model.damping_rate),
        rtol=1e-9,
    )
    samples = round(rate * plan.block_length / 4.0) * 4
    assert samples > 2 * len(omega)
    engine, brute = np.zeros((2, 5, paths))
    for first in range(0, paths, group):
        here = slice(first, first + group)
        spectrum = np.zeros((group, samples // 2 + 1), complex)
        for index in range(group):
            spectrum[index, 1 : len(omega) + 1] = coefficients(full, first + index, response) / gain
        force = np.fft.irfft(spectrum * samples / 2.0, samples, axis=1)
        brute[0, here], brute[1, here], brute[2:, here] = held_force(
            np.ascontiguousarray(force.T).T, samples / plan.block_length, model.omega,
            model.damping_rate, model.upper.position, model.upper.coefficient, plan.threshold,
            model.lower is None,
        )  # fmt: skip
        sums = plan.averages(SEED, first, group)
        engine[:, here] = [
            sums[XX],
            sums[VV],
            *(sums[N_LOWER : N_LOWER + 3] + sums[N_UPPER : N_UPPER + 3]),
        ]
    return engine, brute


@pytest.mark.verify
@pytest.mark.parametrize(
    ("profile", "frequency_hz", "sigmas", "rate", "paths", "resolution"),
    [
        (TRUCK, 12.0, 2.0, 4096.0, 1024, 0.001),
        (TRUCK, 12.0, 3.0, 4096.0, 2048, 0.0015),
        # impacts amplify rounding errors here, so that paths soon have nothing in common
        ("navmat-p-9492", 8.0, 3.0, 16384.0, 512, 0.02),
    ],
)
def test_hits_agree_with_a_brute_force_on_the_same_noise(
    profile: str, frequency_hz: float, sigmas: float, rate: float, paths: int, resolution: float
) -> None:
    scene = mount(frequency_hz, profile, sigmas, 0.5)
    plan = make_plan(model_of(scene), None, None)
    assert isinstance(plan, TabulatedPlan)
    engine, brute = paired_differences(plan, paths, rate, 64)
    for name, mine, other in zip(("x^2", "v^2", "hits", "F1", "F2"), engine, brute, strict=True):
        relative = (mine - other) / other.mean()
        difference, error = relative.mean(), relative.std(ddof=1) / math.sqrt(paths)
        print(f"{profile} {sigmas:g} sigma {name} {difference:+.5f} +- {error:.5f}")
        assert abs(difference) < AIM + 4.5 * error
        assert error < resolution


def pressed(restitution: float, frequency_hz: float = 10.0) -> TabulatedPlan:
    """A mass that a load of 1 g presses onto its stop, on a truck."""
    pressing = -STANDARD_GRAVITY / (2.0 * math.pi * frequency_hz) ** 2
    pair = ImpactPair(upper=pressing, law=Restitution(coefficient=restitution))
    scene = mount(frequency_hz, TRUCK, None, 1.0).model_copy(update={"impact_pairs": (pair,)})
    plan = make_plan(model_of(scene), None, None)
    assert isinstance(plan, TabulatedPlan)
    return plan


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [0.3, 0.5])
def test_a_mass_that_is_pressed_onto_its_stop_is_shaken_by_the_whole_table(
    restitution: float,
) -> None:
    """The rate of sampling that the free response needs leaves out what throws it off its stop."""
    plan = pressed(restitution)
    free = plan.with_step(plan_of(mount(10.0, TRUCK, None, 1.0)).step)
    rows = [XX, VV, N_UPPER, F1_UPPER, F2_UPPER]
    engine, brute = paired_differences(plan, 8, 16384.0, 8)
    _, rough = paired_differences(plan, 8, 8192.0, 8)
    change = (engine - plan.coarser().averages(SEED, 0, 8)[rows]).mean(axis=1)
    error = (engine - brute).std(axis=1, ddof=1) / math.sqrt(8)
    for name, off, bias, own, e in zip(
        ("x^2", "v^2", "hits", "F1", "F2"),
        (engine - brute).mean(axis=1) / brute.mean(axis=1),
        [abs(bias_of_lasting_contact(each)) for each in change] / brute.mean(axis=1),
        abs((brute - rough).mean(axis=1)) / brute.mean(axis=1),
        error / brute.mean(axis=1),
        strict=True,
    ):
        print(f"R = {restitution} {name} {off:+.4f} +- {e:.4f}, bias {bias:.4f}, brute {own:.4f}")
        assert abs(off) < bias + own + 4.5 * e
        assert bias < 0.06
    hits = free.averages(SEED, 0, 8)[N_UPPER].mean()
    assert hits < 0.8 * brute[2].mean()


def test_a_balance_that_is_missed_is_told(monkeypatch) -> None:
    """A mass under gravity rests on its stop, whose force at rest counts."""
    resting = Scene(
        structure=Isolator(mass=1.0, frequency_hz=2.0, zeta=0.1, gravity=True),
        impact_pairs=[ImpactPair(lower=0.0, law=Restitution(coefficient=0.5))],
        excitations=[TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")],
    )
    found = simulate(resting, paths=8, duration=4.0, seed=1)
    assert not any("the balance of" in each for each in found.warnings)
    assert abs(found.identities["force"].value) < 0.01
    assert found.impact_pairs["stops"].impact_speed_mean is None
    assert any("no mean impact speed" in each for each in found.warnings)
    monkeypatch.setattr(simulation, "residuals", lambda *_: {"force": 0.5})
    found = simulate(resting, paths=8, duration=4.0, seed=1)
    assert any("the balance of force is missed by 0.5" in each for each in found.warnings)


@pytest.mark.parametrize(("threshold", "known"), [(0.0, True), (0.3, False)])
def test_a_mean_speed_is_that_of_counted_impacts(threshold: float, known: bool) -> None:
    """With a high threshold F1 would be divided by the few impacts that it counts."""
    scene = mount(12.0, TRUCK, 2.0, 0.8)
    found = simulate(scene, paths=16, duration=20.0, seed=1, speed_threshold=threshold)
    assert found.impact_pairs["stops"].collision_rate.value > 0.0
    assert (found.impact_pairs["stops"].impact_speed_mean is not None) == known
    assert any("no mean impact speed" in each for each in found.warnings) != known
