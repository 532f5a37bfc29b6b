"""The closed form, against printed values, quadrature of the Gibbs density, and its balances."""

from __future__ import annotations

import math
from itertools import pairwise

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import quad

from stochvi.methods.closed_form import (
    autocorrelation,
    displacement_density,
    exact,
    exact_density,
    unmet,
)
from stochvi.methods.monte_carlo import record_path, simulate
from stochvi.model.build_response import residuals
from stochvi.model.model import model_of
from stochvi.results.errors import NoExactSolution, SceneError
from stochvi.results.estimates import Estimate
from stochvi.scenes.excitations import ConstantLoad, FilteredNoise, TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Elastic, ForceTable, Hertz, Restitution, SpeedRestitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Isolator, NonlinearOscillator, Oscillator
from stochvi.testing import assert_agrees
from support.accuracies import assert_differs, quick_cases
from support.known import BENCH, ELASTIC_STOPS, NATURAL, RIGID_STOPS, Units, oscillator, values

PRINTED = 1e-13
"""The printed values have 15 digits; both sides round some hundred times."""

TRUCK = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")


@pytest.mark.parametrize("units", [NATURAL, BENCH], ids=["theta = 1", "12 Hz, 2.5 kg, mm"])
@pytest.mark.parametrize("row", ELASTIC_STOPS, ids=lambda row: f"{row.lower} to {row.upper}")
def test_elastic_stops_give_the_printed_moments_and_rates_in_any_units(row, units):
    found = values(exact(oscillator(row.lower, row.upper, units=units)))
    expected = {
        "displacement_mean": row.mean,
        "displacement_mean_square": row.mean_square,
        "displacement_std": math.sqrt(row.mean_square - row.mean**2),
        "velocity_mean_square": 1.0,
        "velocity_std": 1.0,
        "collision_rate_lower": row.rate_lower,
        "collision_rate_upper": row.rate_upper,
        "collision_rate": row.rate_lower + row.rate_upper,
        "impact_speed_mean": math.sqrt(math.pi / 2.0),
        "impact_speed_rate": (row.rate_lower + row.rate_upper) * math.sqrt(math.pi / 2.0),
        "impact_speed_square_rate": 2.0 * (row.rate_lower + row.rate_upper),
    }
    for quantity, value in expected.items():
        assert found[quantity] / units.factor(quantity) == pytest.approx(
            value, rel=10.0 * PRINTED, abs=PRINTED
        ), quantity


def test_the_reference_table_at_restitution_one_is_the_closed_form():
    table = next(row for row in RIGID_STOPS if row.restitution == 1.0)
    found = values(exact(oscillator(-1.0, 1.0)))
    expected = {name: value for name, value in table.values.items() if name != "v4"}
    assert {name: found[name] for name in expected} == pytest.approx(expected, rel=PRINTED)
    assert table.values["v4"] == 3.0 * found["velocity_mean_square"] ** 2


def symmetric_moments(x: float, v: float, f1: float, f2: float) -> dict:
    """What balances need, from the deviations and both stops' sums."""
    moments = {("x", "x"): 0.0, ("x", "variance"): x * x, ("x", "vv"): v * v}
    for side in ("lower", "upper"):
        moments |= {("stops", f"f1_{side}"): f1 / 2, ("stops", f"f2_{side}"): f2 / 2}
    return moments


@pytest.mark.parametrize("row", RIGID_STOPS, ids=lambda row: f"R = {row.restitution}")
def test_the_reference_table_obeys_the_balances_to_its_printed_digits(row):
    """Energy b E v^2 + (1 - R^2) F2 / 2 = S0 / 2 and virial E v^2 = E x^2 + (1 + R) F1."""
    r, (x, v, f1, f2) = row.restitution, [row.values[name] for name in ROW]
    off = [row.errors[name] for name in ROW]
    moments = symmetric_moments(x, v, f1, f2)
    left = residuals(model_of(oscillator(-1.0, 1.0, r)), moments, (0.0,))
    # a residual is relative to its largest term, S0 / 2 = 0.1 and E v^2
    energy = (0.1 * 2.0 * v * off[1] + (1.0 - r * r) / 2.0 * off[3]) / 0.1
    virial = (2.0 * v * off[1] + 2.0 * x * off[0] + (1.0 + r) * off[2]) / (v * v)
    assert left["force"] == 0.0
    assert abs(left["energy"]) <= energy + PRINTED
    assert abs(left["virial"]) <= virial + PRINTED


ROW = ("displacement_std", "velocity_std", "impact_speed_rate", "impact_speed_square_rate")


def test_balances_do_not_vanish_for_the_wrong_restitution():
    """The rows of the table are not interchangeable."""
    row = next(row for row in RIGID_STOPS if row.restitution == 0.8)
    x, v, f1, f2 = (row.values[name] for name in ROW)
    moments = symmetric_moments(x, v, f1, f2)
    wrong = residuals(model_of(oscillator(-1.0, 1.0, 0.9)), moments, (0.0,))
    # (1 - R^2) F2 / 2 is too small by (.36 - .19) F2 / 2, in units of S0 / 2
    assert wrong["energy"] == pytest.approx(0.17 * f2 / 2.0 / 0.1, rel=1e-6)
    assert wrong["virial"] == pytest.approx(-0.1 * f1 / (v * v), rel=1e-5)


# Against the density itself ---------------------------------------------------------------


MOMENTS = ("displacement_mean", "displacement_mean_square", "velocity_mean_square")


def gibbs(scene: Scene, count: int) -> dict[str, float]:
    """Moments and rates of exp(-(v^2 / 2 + U(x)) / theta) on a grid of x and v."""
    model = model_of(scene)
    theta = model.intensity / (2.0 * model.damping_rate)
    nodes, weights = np.polynomial.legendre.leggauss(count)
    if model.omega > 0.0:
        rest = model.rest
        spread = 12.0 * math.sqrt(theta) / model.omega
    else:
        rest, spread = 0.0, math.inf
    low = max(model.lower_position, rest - spread)
    high = min(model.upper_position, rest + spread)
    x, dx = (low + high) / 2.0 + (high - low) / 2.0 * nodes, (high - low) / 2.0 * weights
    speed = 12.0 * math.sqrt(theta)
    v, dv = speed / 2.0 * (1.0 + nodes), speed / 2.0 * weights

    def energy(place, velocity):
        return velocity**2 / 2.0 + model.omega**2 * place**2 / 2.0 - model.load * place

    bottom = energy(x, 0.0).min()
    p = np.exp(-(energy(x[:, None], v[None, :]) - bottom) / theta) * dx[:, None] * dv
    mass = 2.0 * p.sum()
    found = {
        "displacement_mean": 2.0 * (p.sum(axis=1) @ x) / mass,
        "displacement_mean_square": 2.0 * (p.sum(axis=1) @ x**2) / mass,
        "velocity_mean_square": 2.0 * (p.sum(axis=0) @ v**2) / mass,
    }
    places = {
        "lower": model.lower_position,
        "upper": model.upper_position,
        "mean": found["displacement_mean"],
    }
    for side, place in places.items():
        flux = 0.0
        if math.isfinite(place):
            flux = np.exp(-(energy(place, v) - bottom) / theta) * dv / mass
        for power, name in enumerate(("rate", "speed", "square"), start=1):
            found[f"{name}_{side}"] = float(np.sum(flux * v**power))
    return {
        **{name: found[name] for name in MOMENTS},
        "upcrossing_rate": found["rate_mean"],
        "collision_rate_lower": found["rate_lower"],
        "collision_rate_upper": found["rate_upper"],
        "impact_speed_rate": found["speed_lower"] + found["speed_upper"],
        "impact_speed_square_rate": found["square_lower"] + found["square_upper"],
    }


def random_scene(number: int) -> Scene:
    rng = np.random.default_rng(number)
    gap, preload = rng.uniform(0.2, 2.0, 2), rng.uniform(-0.3, 1.5)
    lower, upper = [(-gap[0], gap[1]), (None, preload), (-preload, None), (0.3, 0.3 + gap[0])][
        number % 4
    ]
    box = number % 4 in (0, 3) and number % 3 == 0
    return oscillator(
        lower,
        upper,
        load=float(rng.choice([0.0, rng.uniform(-1.0, 1.0)])),
        omega=0.0 if box else rng.uniform(0.3, 2.0),
        damping=rng.uniform(0.02, 1.0),
        intensity=rng.uniform(0.05, 0.5),
        units=Units(mass=rng.uniform(0.1, 10.0), omega=10.0 ** rng.uniform(0, 3), length=1e-3),
    )


@pytest.mark.parametrize("number", range(24))
def test_any_stops_and_load_give_the_integrals_of_the_gibbs_density(number):
    scene = random_scene(number)
    found = values(exact(scene))
    coarse, fine = gibbs(scene, 200), gibbs(scene, 300)
    for quantity, value in fine.items():
        # the speeds end at 12 deviations, beyond which e^-72 is left
        error = abs(value - coarse[quantity]) + 1e-12 * abs(value)
        if quantity == "displacement_mean":
            error += 1e-12 * found["displacement_std"]
        assert found[quantity] == pytest.approx(value, rel=0.0, abs=error), quantity


@pytest.mark.parametrize("number", range(24))
def test_the_balances_of_energy_virial_and_force_vanish(number):
    balances = exact(random_scene(number)).identities
    assert set(balances) == {"energy", "virial", "force"}
    for name, residual in balances.items():
        assert residual.value == pytest.approx(0.0, abs=1e-12), name


def test_a_box_without_a_spring_is_uniform():
    found = values(exact(oscillator(-2.0, 1.0, omega=0.0)))
    assert found["displacement_mean"] == pytest.approx(-0.5, rel=PRINTED)
    assert found["displacement_std"] == pytest.approx(3.0 / math.sqrt(12.0), rel=PRINTED)
    assert found["collision_rate"] == pytest.approx(
        2.0 / 3.0 / math.sqrt(2.0 * math.pi), rel=PRINTED
    )


def test_a_mass_that_a_load_presses_against_one_stop_has_an_exponential_law():
    """Without a spring: theta / g from the stop on average, hit g / sqrt(2 pi theta) a second."""
    found = values(exact(oscillator(None, 0.5, omega=0.0, load=4.0)))
    assert found["displacement_mean"] == pytest.approx(0.25, rel=PRINTED)
    assert found["displacement_std"] == pytest.approx(0.25, rel=PRINTED)
    assert found["collision_rate"] == pytest.approx(4.0 / math.sqrt(2.0 * math.pi), rel=PRINTED)


def test_the_density_integrates_to_one_and_vanishes_beyond_the_stops():
    scene = oscillator(-0.5, 1.0, load=0.3)
    mass, error = quad(lambda x: float(displacement_density(scene, x)), -0.5, 1.0)
    mean, off = quad(lambda x: x * float(displacement_density(scene, x)), -0.5, 1.0)
    assert mass == pytest.approx(1.0, rel=0.0, abs=error + PRINTED)
    expected = values(exact(scene))["displacement_mean"]
    assert mean == pytest.approx(expected, rel=0.0, abs=off + PRINTED)
    assert list(displacement_density(scene, [-0.501, 1.001])) == [0.0, 0.0]


# Without stops ----------------------------------------------------------------------------


def test_white_noise_without_stops_gives_the_textbook_gaussian():
    """theta = 2: E x^2 = theta / omega^2, mean = load / omega^2, up-crossings omega / 2 pi."""
    found = values(exact(oscillator(omega=2.0, intensity=0.4, load=3.0)))
    assert found == pytest.approx(
        {
            "displacement_mean": 0.75,
            "displacement_std": math.sqrt(0.5),
            "displacement_mean_square": 0.5 + 0.75**2,
            "velocity_std": math.sqrt(2.0),
            "velocity_mean_square": 2.0,
            "upcrossing_rate": 1.0 / math.pi,
        },
        rel=PRINTED,
    )


def test_an_isolator_in_white_noise_has_the_exact_absolute_acceleration():
    """E a^2 = theta (b^2 + omega^2): base noise only, since white noise on the mass has none."""
    noise = WhiteNoise(intensity=0.2)
    mount = Isolator(mass=2.0, damping=0.2, stiffness=8.0)
    found = values(exact(Scene(structure=mount, excitations=[noise])))
    assert found["acceleration_std"] == pytest.approx(math.sqrt(1.0 * (0.01 + 4.0)), rel=PRINTED)
    pushed = Scene(structure=mount, excitations=[noise, WhiteNoise(on="x", intensity=0.1)])
    assert "acceleration_std" not in values(exact(pushed))


def test_a_table_without_stops_gives_a_gaussian_with_the_moments_of_its_response():
    omega, b = 2.0 * math.pi * 12.0, 0.2 * 2.0 * math.pi * 12.0
    load = ConstantLoad(acceleration=9.80665)
    scene = Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[TRUCK, load])
    found = values(exact(scene))

    def moment(power):
        def integrand(t):
            f = math.exp(t)
            w = 2.0 * math.pi * f
            gain = 1.0 / ((omega**2 - w**2) ** 2 + (b * w) ** 2)
            return w**power * gain * float(TRUCK.table(f)) * f

        places = np.log([5.0, 12.0, 40.0, 500.0])
        parts = [quad(integrand, *pair, epsabs=0.0, epsrel=1e-11) for pair in pairwise(places)]
        return sum(part[0] for part in parts)

    deviation, velocity = math.sqrt(moment(0)), math.sqrt(moment(2))
    rest = -9.80665 / omega**2
    assert found["displacement_std"] == pytest.approx(deviation, rel=1e-11)
    assert found["velocity_std"] == pytest.approx(velocity, rel=1e-11)
    assert found["displacement_mean"] == pytest.approx(rest, rel=PRINTED)
    assert found["upcrossing_rate"] == pytest.approx(
        velocity / deviation / (2.0 * math.pi), rel=1e-11
    )
    x = rest + deviation * np.array([-3.0, 0.0, 1.0])
    normal = np.exp(-0.5 * ((x - rest) / deviation) ** 2) / deviation / math.sqrt(2.0 * math.pi)
    assert displacement_density(scene, x) == pytest.approx(normal, rel=1e-10)


def test_white_noise_and_a_table_add_up():
    mount = Isolator(frequency_hz=12.0, zeta=0.1)
    white = WhiteNoise(density=0.01, unit="g2/Hz")
    squares = [
        values(exact(Scene(structure=mount, excitations=noise)))["displacement_mean_square"]
        for noise in ([TRUCK], [white], [TRUCK, white])
    ]
    assert squares[0] + squares[1] == pytest.approx(squares[2], rel=PRINTED)


# What is not covered ----------------------------------------------------------------------


def lossy(lower: float, upper: float) -> ImpactPair:
    return ImpactPair(
        lower=-1.0,
        upper=1.0,
        lower_law=Restitution(coefficient=lower),
        upper_law=Restitution(coefficient=upper),
    )


STILL = Oscillator(mass=1.0, damping=0.0, stiffness=0.0)
FORCE_TABLE = TabulatedNoise(frequency_hz=[1.0, 2.0], density=[1.0, 1.0], unit="N2/Hz")


@pytest.mark.parametrize(
    ("scene", "conditions"),
    [
        (oscillator(-1.0, 1.0, 0.8), ["restitution * 0.8 at the lower", "restitution * upper"]),
        (oscillator(None, 1.0, 0.0), ["restitution must be 1 * got 0 at the upper"]),
        (
            Scene(structure=STILL, impact_pairs=[lossy(1.0, 0.8)], excitations=[FORCE_TABLE]),
            ["restitution * got 0.8 at the upper", "tabulated density", "damping * got 0"],
        ),
        (
            Scene(structure=STILL, excitations=[ConstantLoad(force=1.0)]),
            ["damping * got 0", "noise * constant load alone", "stiffness * got 0"],
        ),
        (oscillator(None, 1.0, omega=0.0, load=-1.0), ["stiffness * got 0"]),
        (oscillator(omega=0.0), ["stiffness * got 0"]),
    ],
    ids=["two losses", "one stop", "loss, table, undamped", "all of a load", "blown away", "free"],
)
def test_every_unmet_condition_is_listed(scene, conditions):
    with pytest.raises(NoExactSolution) as failure:
        exact(scene)
    found = failure.value.conditions
    assert len(found) == len(conditions)
    for sentence, words in zip(found, conditions, strict=True):
        for word in words.split(" * "):
            assert word in sentence
        assert sentence in str(failure.value)
    with pytest.raises(NoExactSolution):
        displacement_density(scene, 0.0)


# ------------------------------------------------------------------------------
# The exact law as functions: far tails, impact speeds, contact forces, springs of any kind.
# ------------------------------------------------------------------------------


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
    assert_differs(estimate, float(autocorrelation(case, 0.5 * shift * step)))


def test_other_scenes_have_no_known_autocorrelation():
    for case in (oscillator(-1.0, 1.0), oscillator(-1.0, 1.0, 0.8, omega=0.0)):
        with pytest.raises(NoExactSolution):
            autocorrelation(case, 1.0)


# ------------------------------------------------------------------------------
# With matched noise and elastic stops the Gibbs distribution holds at every number of modes.
# ------------------------------------------------------------------------------


THETA, ZETA = 0.5, 0.05


def matched(count: int, *, raised: float = 1.0) -> Scene:
    """Modes whose white noise is 2 theta times their damping: it acts on as many points as there
    are modes, of which each moves with an orthogonal mixture of them. `raised` raises that on the
    first point."""
    omega = 2.0 * math.pi * np.array([10.0, 24.0, 37.0, 55.0, 71.0])[:count]
    number = np.arange(1, count + 1)
    mixed = math.sqrt(2.0 / (count + 1)) * np.sin(np.outer(number, number) * math.pi / (count + 1))
    points = {f"p{k}": (np.sqrt(2.0 * ZETA * omega) * mixed[k]).tolist() for k in range(count)}
    tip = (-1.0) ** np.arange(count)
    structure = {
        "kind": "modes", "frequency_hz": (omega / (2.0 * math.pi)).tolist(), "zeta": ZETA,
        "modal_mass": 1.0, "shapes": points | {"tip": tip.tolist()},
    }  # fmt: skip
    intensities = [2.0 * THETA * (raised if k == 0 else 1.0) for k in range(count)]
    return Scene(
        structure=structure,
        impact_pairs=[ImpactPair(on="tip", lower=-0.02, upper=0.01, law=Elastic(stiffness=4e4))],
        excitations=[WhiteNoise(on=f"p{k}", intensity=s) for k, s in enumerate(intensities)],
    )


@quick_cases("count", [1, 2, 3, 5], keep={1, 2})
def test_the_gibbs_law_holds_at_every_number_of_modes(count: int) -> None:
    known = exact(matched(count))
    found = simulate(matched(count), paths=16, duration=20.0, seed=7)
    for quantity in ("collision_rate", "impact_speed_rate", "impact_speed_square_rate"):
        truth = getattr(known.impact_pairs["stops"], quantity).value
        assert_agrees(getattr(found.impact_pairs["stops"], quantity), truth)
    for name, motion in found.coordinates.items():
        assert_agrees(motion.displacement_std, known.coordinates[name].displacement_std.value)


def test_noise_that_is_not_matched_is_noticed() -> None:
    known = exact(matched(3)).impact_pairs["stops"].collision_rate
    found = simulate(matched(3, raised=2.0), paths=16, duration=20.0, seed=7)
    assert_differs(found.impact_pairs["stops"].collision_rate, known.value)
