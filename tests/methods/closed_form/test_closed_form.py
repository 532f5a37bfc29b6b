"""The closed form, against printed values, quadrature of the Gibbs density, and its balances."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from stochvi.methods.closed_form import displacement_density, exact
from stochvi.model.balances import residuals
from stochvi.model.model import model_of
from stochvi.results.errors import NoExactSolution
from stochvi.scenes.excitations import ConstantLoad, TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Isolator, Oscillator
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
