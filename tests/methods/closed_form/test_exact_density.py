"""The exact law as functions: far tails, impact speeds, contact forces, springs of any kind."""

from __future__ import annotations

import math
from itertools import pairwise

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import quad

from stochvi.methods.closed_form import autocorrelation, exact, exact_density, unmet
from stochvi.methods.monte_carlo import record_path
from stochvi.model.model import model_of
from stochvi.results.errors import NoExactSolution, SceneError
from stochvi.results.estimates import Estimate
from stochvi.scenes.excitations import ConstantLoad, FilteredNoise, WhiteNoise
from stochvi.scenes.impact_laws import Elastic, ForceTable, Hertz, Restitution, SpeedRestitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import NonlinearOscillator, Oscillator
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases
from support.known import oscillator

LINEAR = Oscillator(mass=2.0, damping=0.2, stiffness=2.0)
"""With the noise below: omega = theta = 1, b = 0.1."""


def scene(structure=LINEAR, load=0.0, **pair) -> Scene:
    excitations = [WhiteNoise(intensity=0.8), *([ConstantLoad(force=load)] if load else [])]
    pairs = [ImpactPair(**pair)] if pair else []
    return Scene(structure=structure, impact_pairs=pairs, excitations=excitations)


HERTZ = scene(lower=-1.0, upper=1.0, law=Hertz(coefficient=200.0))
PRESSED = scene(load=4.0, upper=0.5, law=Elastic(stiffness=50.0))
TABLE = scene(upper=0.3, law=ForceTable(deflection=[0.1, 0.2, 0.4], force=[2.0, 2.0, 30.0]))
WALL = scene(lower=-1.0, law=Restitution(coefficient=1.0))


# Far out ----------------------------------------------------------------------------------


def test_tails_at_40_deviations_against_forty_digits():
    """mpmath, 40 digits: log of the ratio of integrals of exp(-U), U written out here."""
    with mp.workdps(40):
        # one rigid stop: log(erfc(40 / sqrt 2) / erfc(-1 / sqrt 2))
        wall = mp.log(mp.erfc(40 / mp.sqrt(2)) / mp.erfc(-1 / mp.sqrt(2)))

        # Hertz stops at +-1, U = x^2 / 2 + 40 (|x| - 1)^2.5, at x = 1 + 40 / 20
        def p(x):
            return mp.exp(-(x**2) / 2 - 40 * max(abs(x) - 1, mp.mpf(0)) ** mp.mpf("2.5"))

        # in s = sqrt(|x| - 1) the stop is smooth; mpmath's errors are absolute, hence the scale
        def integral(function, *ends):
            places = mp.linspace(*ends, 21)
            return mp.quad(function, places, method="gauss-legendre")

        within = integral(lambda s: 2 * s * p(1 + s**2), 0, mp.mpf("1.3"))
        inner = 2 * integral(p, 0, 1) + 2 * within
        scale = p(mp.mpf(3))
        outer = integral(lambda x: p(x) / scale, 3, mp.mpf("3.3"))
        hertz = mp.log(outer / inner) + mp.log(scale)
        density = mp.log(p(mp.mpf(3)) / inner)
    assert float(wall) == pytest.approx(-804.4356882347304, rel=1e-15)
    assert exact_density(WALL).log_tail(40.0) == pytest.approx(float(wall), rel=1e-14)
    assert exact_density(HERTZ).log_tail(3.0) == pytest.approx(float(hertz), rel=1e-13)
    joint = float(density) - 800.0 - 0.5 * math.log(2.0 * math.pi)
    assert exact_density(HERTZ).log_density(3.0, -40.0) == pytest.approx(joint, rel=1e-14)


def test_nothing_overflows_where_numbers_end():
    law = exact_density(WALL)
    with np.errstate(all="raise"):
        assert law.tail(40.0) == 0.0 and law.density(40.0, 0.0) == 0.0
        assert law.log_rate_above("lower", 40.0) < -800.0 and law.rate_above("lower", 40.0) == 0.0
        assert law.log_tail([-2.0, -1.0]).tolist() == [0.0, 0.0]
        assert law.log_density(-1.1, 0.0) == -math.inf
        assert exact_density(scene()).log_tail(-40.0) == 0.0
        assert exact_density(scene()).log_tail(40.0) == pytest.approx(-804.608442)


# What follows from the density ------------------------------------------------------------


@pytest.mark.parametrize("case", [HERTZ, PRESSED, TABLE, WALL], ids=["Hertz", "load", "table", "R"])
def test_marginals_tail_and_rates_are_integrals_of_the_joint_density(case):
    law = exact_density(case)
    knots = [-1.0, 0.3, 0.4, 0.5, 0.7, 1.0]
    low, high = (-1.0 if case is WALL else -12.0), 12.0

    def over_x(function, start):
        edges = [start, *(knot for knot in knots if knot > start), high]
        return sum(quad(function, *ends, epsabs=1e-13)[0] for ends in pairwise(edges))

    assert over_x(lambda x: float(law.displacement_density(x)), low) == pytest.approx(1.0)
    tail = over_x(lambda x: float(law.displacement_density(x)), 0.35)
    assert law.tail(0.35) == pytest.approx(tail, rel=1e-9)
    assert law.tail(low) == pytest.approx(1.0, rel=1e-12)
    v = np.linspace(-12.0, 12.0, 2001)
    marginal = np.trapezoid(law.density(0.2, v), v)
    assert marginal == pytest.approx(float(law.displacement_density(0.2)), rel=1e-12)
    assert np.trapezoid(law.velocity_density(v), v) == pytest.approx(1.0, rel=1e-12)
    side = "lower" if case is WALL else "upper"
    stop = getattr(case.impact_pairs[0], side)
    w = np.linspace(0.0, 12.0, 2001)
    flux = np.trapezoid(np.where(w >= 0.5, w * law.density(stop, w), 0.0), w)
    assert law.rate_above(side, 0.5) == pytest.approx(flux, rel=4e-3)
    rate = exact(case).estimates()["stops", f"collision_rate_{side}"].value
    assert law.rate_above(side, 0.0) == pytest.approx(rate, rel=1e-12)
    shape = w * law.density(stop, w) / rate
    assert law.impact_speed_density(side, w) == pytest.approx(shape, rel=1e-10, abs=1e-300)
    share = exact(case).estimates().get(("stops", "contact_probability"))
    assert law.contact_probability == (share.value if share else None)


@pytest.mark.parametrize("case", [HERTZ, PRESSED, TABLE], ids=["Hertz", "load", "table"])
def test_the_law_of_peak_forces_has_the_mean_that_the_response_states(case):
    """Mean = int P(F > f) df; and its density the derivative."""
    law = exact_density(case)
    f = np.linspace(0.0, 200.0, 20_001)
    exceedance = law.peak_force_exceedance("upper", f)
    mean, coarse = np.trapezoid(exceedance, f), np.trapezoid(exceedance[::2], f[::2])
    contact = law.law.contact("upper")
    # a force at which the stop yields is a jump within a cell
    assert mean == pytest.approx(2.0 * contact.peak_force, abs=2.0 * abs(mean - coarse) + 1e-8)
    middle = (f[1:] + f[:-1]) / 2.0
    slope = -np.diff(exceedance) / np.diff(f)
    # a Hertzian stop starts with an infinite second derivative
    smooth = (
        (middle > 0.02)
        & (np.abs(middle - 2.0) > 0.01)
        & (exceedance[:-1] < 1.0)
        & (exceedance[1:] > 1e-12)
    )
    density = law.peak_force_density("upper", middle)[smooth]
    assert density == pytest.approx(slope[smooth], rel=4e-3)
    if case is TABLE:  # it yields at 2 N: that force has a probability of its own
        assert law.peak_force_exceedance("upper", 1.999) > 1.1 * law.peak_force_exceedance(
            "upper", 2.0
        )


def test_a_linear_stop_alone_has_a_rayleigh_law_of_peak_forces():
    """Without spring and load in the contact F = w sqrt(k m): exp(-f^2 / (2 theta k m))."""
    light = Oscillator(mass=2.0, damping=0.2, stiffness=0.0)
    law = exact_density(scene(light, lower=-1.0, upper=1.0, law=Elastic(stiffness=50.0)))
    f = np.array([1.0, 10.0, 40.0])
    expected = np.exp(-(f**2) / (2.0 * 50.0 * 2.0))
    assert law.peak_force_exceedance("upper", f) == pytest.approx(expected, rel=1e-12)


def test_contacts_of_rigid_or_missing_stops_are_refused():
    with pytest.raises(ValueError, match="upper"):
        exact_density(WALL).impact_speed_density("upper", 1.0)
    with pytest.raises(ValueError, match="must be compliant, got a rigid one"):
        exact_density(WALL).peak_force_exceedance("lower", 1.0)


# Springs that are functions ---------------------------------------------------------------


def spring(force, **changes) -> NonlinearOscillator:
    return NonlinearOscillator(mass=2.0, damping=0.2, restoring_force=force, **changes)


def test_a_linear_spring_as_a_function_is_the_linear_spring():
    for pair in (
        {"lower": -0.5, "upper": 1.0, "law": Restitution(coefficient=1.0)},
        {"lower": -0.5, "upper": 1.0, "law": Hertz(coefficient=60.0)},
        {},
    ):
        one = exact(scene(load=0.7, **pair)).estimates()
        two = exact(scene(spring(lambda x: 2.0 * x), load=0.7, **pair)).estimates()
        assert set(one) == set(two)
        for key, estimate in one.items():
            assert two[key].value == pytest.approx(estimate.value, rel=1e-12), key


FORCES = {
    "deep double well": lambda x: 240.0 * (x**3 - x),
    "soft, with a kink": lambda x: np.where(x < 0.3, 2.0 * x, 0.6 + 40.0 * (x - 0.3)),
    "dry": lambda x: 6.0 * np.sign(x),
    "hard": np.sinh,
}


@pytest.mark.parametrize("name", FORCES)
@quick_cases("stops", [{}, {"upper": 1.1, "law": Elastic(stiffness=30.0)}], keep=(1,))
def test_any_potential_gives_the_integrals_of_its_gibbs_density(name, stops):
    structure = spring(FORCES[name])
    values = exact(scene(structure, load=0.05, **stops)).estimates()
    coarse, fine = (by_sums(FORCES[name], bool(stops), count) for count in (100_001, 200_001))
    for key, value in fine.items():
        # halving the cells halves the error of a kink or a jump within one, or better
        allowed = 2.0 * abs(value - coarse[key]) + 1e-8
        assert abs(values[key].value - value) <= allowed, key
        assert allowed < 1e-3
    assert values["x", "velocity_mean_square"].value == pytest.approx(1.0)


def by_sums(force, stop: bool, count: int) -> dict[tuple[str, str], float]:
    """Moments and rate of exp(-U) by trapezoids; the load 0.05, a stop of 30 N/m from 1.1 on."""
    x, dx = np.linspace(-15.0, 12.0, count, retstep=True)
    pull = force(x) - 0.05 + (30.0 * np.maximum(x - 1.1, 0.0) if stop else 0.0)
    energy = np.concatenate([[0.0], np.cumsum((pull[1:] + pull[:-1]) * dx / 2.0)]) / 2.0
    p = np.exp(-(energy - energy.min()))
    mass = p.sum()
    mean = float(p @ x / mass)
    found = {
        ("x", "displacement_mean"): mean,
        ("x", "displacement_std"): math.sqrt(float(p @ (x - mean) ** 2 / mass)),
    }
    if stop:
        rate = np.interp(1.1, x, p) / mass / dx / math.sqrt(2.0 * math.pi)
        found["stops", "collision_rate_upper"] = float(rate)
    return found


def test_what_a_spring_that_is_a_function_lacks_is_said():
    def words(*arguments, **pair):
        return " ".join(unmet(model_of(scene(*arguments, **pair))))

    assert "must hold the mass" in words(spring(lambda x: -x))
    assert "must hold the mass" in words(spring(np.arctan), 4.0)
    assert not words(spring(lambda x: -x), lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))
    quadratic = NonlinearOscillator(
        mass=2.0, restoring_force=np.sinh, damping_force=lambda v: v * np.abs(v)
    )
    assert "linear, got a function of velocity" in words(quadratic)
    law = SpeedRestitution(coefficient=lambda w: 1.0 / (1.0 + w))
    assert "got a function of speed at the upper stop" in words(upper=1.0, law=law)
    with pytest.raises(SceneError, match="potential whose derivative is restoring_force"):
        exact(scene(spring(lambda x: x, potential=lambda x: x**2)))
    assert exact(scene(spring(lambda x: x, potential=lambda x: 5 + x**2 / 2)))


@pytest.mark.slow
@quick_cases(("upper", "told"), [(0.6, True), (-1.3, False), (-0.3, False)], keep=(0, 2))
def test_the_peak_force_is_left_out_where_the_potential_falls_behind_the_stop(upper, told):
    """A stop before, in and behind the left of two wells; the right one is the deeper."""
    wells = spring(lambda x: 8.0 * (x**3 - x))
    case = scene(wells, load=0.05, upper=upper, law=Elastic(stiffness=0.5))
    law = exact_density(case)
    contact = law.law.contact("upper")
    assert (contact.peak_force is not None) == told
    if told:
        f = np.linspace(0.0, 5.0, 1001)
        mean = np.trapezoid(law.peak_force_exceedance("upper", f), f)
        assert 2.0 * contact.peak_force == pytest.approx(mean, abs=f[1])


def test_filtered_noise_without_stops_has_a_gaussian_density():
    noise = FilteredNoise(intensity=0.4, frequency_hz=0.2, zeta=0.3)
    case = Scene(structure=LINEAR, excitations=[noise, ConstantLoad(force=1.0)])
    law, values = exact_density(case), exact(case).coordinates["x"]
    deviation = values["displacement_std"]
    assert isinstance(deviation, Estimate)
    z = (1.0 - 0.5) / deviation.value
    assert law.tail(1.0) == pytest.approx(0.5 * math.erfc(z / math.sqrt(2.0)), rel=1e-12)


# Autocorrelations -------------------------------------------------------------------------

BOX = oscillator(-1.0, 1.0, omega=0.0)


def test_the_printed_autocorrelation_of_a_box():
    assert autocorrelation(BOX, 1.0) == pytest.approx(0.099582600955827, rel=1e-13)
    assert autocorrelation(BOX, 0.0) == pytest.approx(1.0 / 3.0, rel=1e-10)
    shifted = oscillator(0.5, 2.5, omega=0.0)
    lags = np.array([-3.0, -0.01, 0.2])
    assert autocorrelation(shifted, lags) == pytest.approx(autocorrelation(BOX, -lags), rel=1e-12)


@pytest.mark.parametrize("damping", [0.1, 2.0, 5.0], ids=["light", "critical", "heavy"])
def test_the_linear_autocorrelation_solves_the_equation_of_motion(damping):
    """R'' + b R' + R = 0 for lag > 0, R(0) = theta, R'(0) = 0, by finite differences."""
    case = oscillator(damping=damping, intensity=2.0 * damping)
    t, h = np.linspace(0.01, 30.0, 400), 1e-3
    before, here, after = (autocorrelation(case, t + shift) for shift in (-h, 0.0, h))
    residual = (after - 2 * here + before) / h**2 + damping * (after - before) / (2 * h) + here
    assert np.abs(residual).max() < 1e-5  # h^2 / 6 times fourth derivatives of some 10, at most
    assert autocorrelation(case, 0.0) == pytest.approx(1.0, rel=1e-14)
    # a smooth function of time that starts without a slope, which is that of x' against x
    flat = (float(autocorrelation(case, 1e-4)) - 1.0) / 1e-4
    assert abs(flat) < 1e-4
    assert np.all(np.isfinite(autocorrelation(case, [1e-9, 1e4])))


@pytest.mark.parametrize(
    ("case", "lag"), [(BOX, 1.0), (BOX, 3.0), (oscillator(), 2.0)], ids=["box", "later", "linear"]
)
def test_recorded_paths_have_the_autocorrelation(case, lag):
    """Products of one displacement and a later one, averaged over stretches long apart."""
    # a step of kick-flow-kick leaves the law as it is, and the time as far as h^2 goes
    path = record_path(case, duration=8_000.0, seed=5, step=0.05)
    time, x = path["time"].to_numpy(), path["displacement"].to_numpy()
    step = time[1] - time[0]
    shift = round(lag / step)
    products = x[:-shift] * x[shift:]
    stretches = products[: len(products) // 200 * 200].reshape(200, -1).mean(axis=1)
    estimate = Estimate(
        value=float(stretches.mean()),
        standard_error=float(stretches.std(ddof=1) / math.sqrt(200)),
    )
    assert_agrees(estimate, float(autocorrelation(case, shift * step)))
    with pytest.raises(AssertionError):
        assert_agrees(estimate, float(autocorrelation(case, 0.5 * shift * step)))


def test_other_scenes_have_no_known_autocorrelation():
    for case in (oscillator(-1.0, 1.0), oscillator(-1.0, 1.0, 0.8, omega=0.0)):
        with pytest.raises(NoExactSolution):
            autocorrelation(case, 1.0)
