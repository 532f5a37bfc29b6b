"""From a few moments to a response: its quantities, and the bounds on their errors."""

import math
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from stochvi import Absorber, Oscillator, Scene, WhiteNoise, exact
from stochvi.mathematics.impact_rates import StopStatistics
from stochvi.model.build_response import StationaryMoments, residuals
from stochvi.model.energy_law import Well
from stochvi.model.gap import GibbsLaw, Spring
from stochvi.model.model import LOWER, UPPER, Stop, model_of
from stochvi.scenes.impact_laws import Elastic, ForceTable, Hertz, Restitution
from support.known import RIGID_STOPS, RigidStops, oscillator, values

# ------------------------------------------------------------------------------
# Orbits of a given energy against plain integrals over the way, and their law without losses.
# ------------------------------------------------------------------------------


WELLS = {
    "spring": Well(omega=1.3, load=0.0, lower=-math.inf, upper=math.inf),
    "spring between stops": Well(omega=1.3, load=0.4, lower=-0.8, upper=1.1),
    "spring pressed onto a stop": Well(omega=2.0, load=0.0, lower=0.5, upper=math.inf),
    "free between stops": Well(omega=0.0, load=0.0, lower=-0.5, upper=1.0),
    "thrown onto a stop": Well(omega=0.0, load=-2.0, lower=-1.0, upper=math.inf),
    "thrown between stops": Well(omega=0.0, load=3.0, lower=-1.0, upper=0.4),
}
ENERGIES = np.array([0.01, 0.3, 2.0, 15.0])


def potential(well: Well, x: float) -> float:
    return 0.5 * well.omega**2 * x * x - well.load * x


def turning_points(well: Well, total: float) -> tuple[float, float]:
    """Ends of the orbit with this value of v^2 / 2 + omega^2 x^2 / 2 - load x."""
    if well.omega:
        rest = well.load / well.omega**2
        swing = math.sqrt(2.0 * (total - potential(well, rest))) / well.omega
        ends = rest - swing, rest + swing
    elif well.load:
        turn = -total / well.load
        ends = (turn, math.inf) if well.load > 0.0 else (-math.inf, turn)
    else:
        ends = -math.inf, math.inf
    return max(ends[0], well.lower), min(ends[1], well.upper)


def over_a_cycle(well: Well, energy: float, power: int, of_speed: bool = False) -> float:
    """Integral of (x - place)^power dt, or of v^2 dt: twice the way between the ends."""
    total = potential(well, well.place) + energy
    low, high = turning_points(well, total)
    middle, half = (low + high) / 2.0, (high - low) / 2.0

    def rate(angle: float) -> float:
        """x = middle + half sin(angle) takes the root out of 1 / v at the ends."""
        x = middle + half * math.sin(angle)
        v = math.sqrt(max(2.0 * (total - potential(well, x)), 0.0))
        if v == 0.0:
            return 0.0
        return 2.0 * half * math.cos(angle) * (v if of_speed else (x - well.place) ** power / v)

    edge = 0.5 * math.pi
    return float(quad(rate, -edge, edge, epsabs=1e-11, epsrel=1e-10, limit=400)[0])


@pytest.mark.parametrize("name", WELLS)
def test_what_a_cycle_holds_is_an_integral_over_its_way(name: str) -> None:
    well = WELLS[name]
    orbits = well.orbits(ENERGIES)
    for row, energy in enumerate(ENERGIES):
        scale = over_a_cycle(well, energy, 0) * math.sqrt(over_a_cycle(well, energy, 2))
        for power, found in enumerate((orbits.period, orbits.first, orbits.second)):
            expected = over_a_cycle(well, energy, power)
            assert found[row] == pytest.approx(expected, rel=1e-7, abs=1e-9 * scale), power
        action = over_a_cycle(well, energy, 0, of_speed=True)
        assert orbits.action[row] == pytest.approx(action, rel=1e-7)


@pytest.mark.parametrize("name", WELLS)
def test_the_period_is_the_slope_of_the_action(name: str) -> None:
    well, change = WELLS[name], 1e-5
    below, at, above = (
        well.orbits(ENERGIES * factor) for factor in (1.0 - change, 1.0, 1.0 + change)
    )
    slope = (above.action - below.action) / (2.0 * change * ENERGIES)
    assert slope == pytest.approx(at.period, rel=1e-4)


def test_a_spring_alone_has_one_period() -> None:
    well = WELLS["spring"]
    assert well.orbits(ENERGIES).period == pytest.approx(2.0 * math.pi / well.omega, rel=1e-12)


# ------------------------------------------------------------------------------
# The density of a mass between compliant stops, against adaptive integrals of exp(-U).
# ------------------------------------------------------------------------------


STEEL, BALL, WALL = Elastic(stiffness=40.0), Hertz(coefficient=30.0), Restitution(coefficient=1.0)
BUMPER = ForceTable(deflection=[0.1, 0.4], force=[0.5, 6.0])

LAWS = {
    "two springs": GibbsLaw(
        theta=0.7, omega=1.2, lower=Stop(LOWER, -0.6, STEEL), upper=Stop(UPPER, 0.9, BALL)
    ),
    "spring and wall, loaded": GibbsLaw(
        theta=1.5, omega=0.8, load=0.5,
        lower=Stop(LOWER, -0.4, WALL), upper=Stop(UPPER, 0.7, BUMPER),
    ),
    "pressed": GibbsLaw(theta=0.3, omega=1.0, upper=Stop(UPPER, -0.8, STEEL)),
    "no spring": GibbsLaw(
        theta=1.0, omega=0.0, load=-0.3,
        lower=Stop(LOWER, -0.5, BALL), upper=Stop(UPPER, 0.5, STEEL),
    ),
}  # fmt: skip


def stops_of(law: GibbsLaw) -> list[Stop]:
    return [stop for stop in (law.lower, law.upper) if stop is not None]


def potential_of_gibbs_law(law: GibbsLaw, x: float) -> float:
    found = 0.5 * law.omega**2 * x * x - law.load * x
    for stop in stops_of(law):
        depth = stop.side * (x - stop.position)
        if depth > 0.0:
            found += math.inf if stop.rigid else float(stop.law.potential_at(depth))
    return found


def integral(law: GibbsLaw, weight, low: float = -8.0, high: float = 8.0) -> float:
    """Between kinks, where quad sees a smooth function."""
    kinks = [stop.position for stop in stops_of(law)]
    kinks += [stop + knot for stop in kinks for knot in (-0.4, -0.1, 0.1, 0.4)]
    edges = sorted({low, high, *(kink for kink in kinks if low < kink < high)})
    return sum(
        quad(
            lambda x: weight(x) * math.exp(-potential_of_gibbs_law(law, x) / law.theta),
            one, two, epsabs=1e-13, epsrel=1e-11, limit=200,
        )[0]
        for one, two in pairwise(edges)
    )  # fmt: skip


@pytest.mark.parametrize("name", LAWS)
def test_moments_and_contacts_are_integrals(name: str) -> None:
    law = LAWS[name]
    whole = integral(law, lambda x: 1.0)
    mean = integral(law, lambda x: x) / whole
    assert law.mean == pytest.approx(mean, abs=1e-9)
    assert law.variance == pytest.approx(integral(law, lambda x: (x - mean) ** 2) / whole, rel=1e-8)
    for stop in stops_of(law):
        if stop.rigid:
            continue
        side, place, own = stop.side, stop.position, stop.law
        ends = (place, 8.0) if side > 0 else (-8.0, place)
        contact = law.contact(stop.name)
        share = integral(law, lambda x: 1.0, *ends) / whole
        force = integral(law, lambda x: float(own.force_at(side * (x - place))), *ends) / whole  # noqa: B023
        assert contact.probability == pytest.approx(share, rel=1e-8)
        assert contact.force == pytest.approx(force, rel=1e-8)


@pytest.mark.parametrize("name", LAWS)
def test_peak_forces_follow_the_potential_within_either_stop(name: str) -> None:
    law = LAWS[name]
    for stop in stops_of(law):
        if stop.rigid:
            continue
        depths = np.array([0.05, 0.3, 0.8])
        forces = stop.law.force_at(depths)
        at = potential_of_gibbs_law(law, stop.position)
        rises = [potential_of_gibbs_law(law, stop.position + stop.side * y) - at for y in depths]
        exceeded = law.peak_force_exceedance(stop.name, forces)
        assert exceeded == pytest.approx(np.exp(-np.maximum(rises, 0.0) / law.theta), rel=1e-10)
        if not np.all(exceeded < 1.0):
            continue
        # the density between two forces adds up to the difference of their exceedances
        kinks = [float(force) for force in (0.5, 6.0) if forces[0] < force < forces[2]]
        whole, _ = quad(
            lambda force: float(law.peak_force_density(stop.name, force)),  # noqa: B023
            forces[0], forces[2], points=kinks or None, epsrel=1e-11,
        )  # fmt: skip
        assert whole == pytest.approx(exceeded[0] - exceeded[2], rel=1e-9)


@pytest.mark.parametrize("one_sided", [False, True])
@pytest.mark.parametrize("power", [3.5, 5.0])
def test_moments_of_a_density_that_falls_as_a_power_hold_all_of_its_tail(
    power: float, one_sided: bool
) -> None:
    """Of p ~ (1 + x^2)^(-n / 2), E x^2 = 1 / (n - 3); on x > 0, E x = 2 Gamma(n / 2) / ((n - 2)
    sqrt(pi) Gamma((n - 1) / 2)). For n = 3.5 the tail beyond the quadrature holds 4e-4 of E x^2."""
    theta = 0.7
    law = GibbsLaw(
        theta=theta, omega=0.0, lower=Stop(LOWER, 0.0, WALL) if one_sided else None,
        spring=Spring(
            force=lambda x: theta * power * np.asarray(x) / (1.0 + np.asarray(x) ** 2),
            energy=lambda x: theta * power / 2.0 * np.log1p(np.asarray(x) ** 2),
        ),
    )  # fmt: skip
    gammas = math.exp(math.lgamma(power / 2.0) - math.lgamma((power - 1.0) / 2.0))
    mean = 2.0 * gammas / ((power - 2.0) * math.sqrt(math.pi)) if one_sided else 0.0
    assert law.mean == pytest.approx(mean, abs=1e-7)
    assert law.variance == pytest.approx(1.0 / (power - 3.0) - mean**2, rel=1e-6)


@pytest.mark.parametrize("name", LAWS)
def test_the_peak_is_where_the_potential_is_least(name: str) -> None:
    law = LAWS[name]
    least = potential_of_gibbs_law(law, law.peak)
    for away in (-1e-3, 1e-3, -0.3, 0.3):
        assert potential_of_gibbs_law(law, law.peak + away) >= least


def test_what_nothing_holds_is_refused() -> None:
    with pytest.raises(ValueError, match="hold"):
        GibbsLaw(theta=1.0, omega=0.0, load=0.1, lower=Stop(LOWER, -1.0, STEEL))


# ------------------------------------------------------------------------------
# Balances of energy, virial and force, with moments that are known from elsewhere.
# ------------------------------------------------------------------------------


def moments_of(found: dict[str, float]) -> dict[tuple[str, str], float]:
    """Of an oscillator between two stops at equal distances."""
    sides = {
        ("stops", f"{short}_{side}"): found[name] / 2.0
        for side in ("lower", "upper")
        for short, name in (("f1", "impact_speed_rate"), ("f2", "impact_speed_square_rate"))
    }
    return sides | {
        ("x", "x"): 0.0,
        ("x", "variance"): found["displacement_std"] ** 2,
        ("x", "vv"): found["velocity_std"] ** 2,
    }


@pytest.mark.parametrize("row", RIGID_STOPS, ids=lambda row: f"R={row.restitution:g}")
def test_near_exact_moments_balance_to_their_last_digits(row: RigidStops) -> None:
    model = model_of(oscillator(-1.0, 1.0, row.restitution))
    found = residuals(model, moments_of(row.values), (0.0,))
    assert set(found) == {"energy", "virial", "force"}
    # no term is larger than the one that a residual is relative to
    allowed = sum(2.0 * row.errors[name] / abs(row.values[name]) for name in row.errors)
    for name, value in found.items():
        assert abs(value) <= allowed + 1e-14, name


def test_another_restitution_does_not_balance() -> None:
    row = next(row for row in RIGID_STOPS if 0.0 < row.restitution < 1.0)
    model = model_of(oscillator(-1.0, 1.0, row.restitution - 0.01))
    found = residuals(model, moments_of(row.values), (0.0,))
    assert abs(found["energy"]) > 1e-3 and abs(found["virial"]) > 1e-3


@pytest.mark.parametrize("load", [0.0, 1.5])
def test_a_load_and_any_origin_balance(load: float) -> None:
    scene = oscillator(-0.7, 0.4, load=load)
    model, known = model_of(scene), values(exact(scene))
    square = known["velocity_mean_square"]
    moments = {
        ("x", "x"): known["displacement_mean"],
        ("x", "variance"): known["displacement_std"] ** 2,
        ("x", "vv"): square,
    }
    for side in ("lower", "upper"):
        # Rayleigh speeds: F1 = rate s sqrt(pi / 2), F2 = 2 rate s^2
        rate = known[f"collision_rate_{side}"]
        moments["stops", f"f1_{side}"] = rate * math.sqrt(math.pi * square / 2.0)
        moments["stops", f"f2_{side}"] = 2.0 * rate * square
    for origin in (0.0, 3.0, -0.2):
        for name, value in residuals(model, moments, (origin,)).items():
            assert value == pytest.approx(0.0, abs=1e-12), (name, origin)


def test_two_masses_and_a_box_that_loses_nothing_balance() -> None:
    """m E v^2 = theta = 1 of both masses, the relative position uniform and independent."""
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        absorber=Absorber(mass=0.1, play=2.0, law=Restitution(coefficient=1.0)),
        excitations=[WhiteNoise(intensity=0.2)],
    )
    model = model_of(scene)
    relative = math.sqrt(1.0 + 10.0)
    first, second = model.coordinates
    moments = {
        (first, "x"): 0.0, (first, "variance"): 1.0,
        (second, "x"): 0.0, (second, "variance"): 1.0 + 1.0 / 3.0,
        ("", "kinetic"): 2.0, ("", "potential"): 1.0, ("", "dissipation"): 0.1,
    }  # fmt: skip
    for side in ("lower", "upper"):
        moments["box", f"f1_{side}"] = 0.5 * relative**2 / 2.0
        moments["box", f"f2_{side}"] = 0.5 * relative**3 * math.sqrt(2.0 / math.pi)
    for name, value in residuals(model, moments, (0.0, 0.0)).items():
        assert value == pytest.approx(0.0, abs=1e-12), name
    # the reduced mass counts: a pair of another mass balances no virial
    (pair,) = model.pairs
    wrong = replace(model, pairs=(replace(pair, mass=1.1 * pair.mass),))
    assert abs(residuals(wrong, moments, (0.0, 0.0))["virial"]) > 0.01


def test_a_coordinate_at_rest_is_missed_by_nothing() -> None:
    """A box on its mounts over a stop below its centre, shaken along z: what rounding moves along y
    is no fault, but a force along y that is missing is one, however small beside those along z."""
    mounts = [
        {"at": [x, y, -0.06], "stiffness": [2.2e4, 2.2e4, 3.4e4], "damping": [9.0, 9.0, 14.0]}
        for x in (-0.2, 0.2)
        for y in (-0.15, 0.15)
    ]
    box = {"kind": "rigid-body", "mass": 12.0, "inertia": [0.2, 0.25, 0.15], "mount": mounts}
    stop = {
        "name": "s", "at": [0.0, 0.0, -0.08], "direction": [0, 0, 1], "lower": -8e-4,
        "law": {"kind": "restitution", "coefficient": 0.4},
    }  # fmt: skip
    shaken = {
        "kind": "psd",
        "axis": "z",
        "frequency_hz": [5.0, 500.0],
        "density": [0.1, 0.1],
        "unit": "(m/s2)2/Hz",
    }
    model = model_of(Scene(structure=box, impact_pair=[stop], excitation=[shaken]))  # type: ignore[call-arg]
    rate = 20.0

    def missed(**means: float) -> dict[str, float]:
        moments = {
            (name, moment): value
            for name in model.coordinates
            for moment, value in (("x", means.get(name, 3e-20)), ("variance", 1e-38))
        }
        moments |= {("z", "variance"): 1e-6, ("s", "f1_lower"): rate, ("s", "f2_lower"): 2.0}
        return residuals(model, moments, [0.0] * len(model.coordinates))

    lifted = 12.0 * 1.4 * rate / (4.0 * 3.4e4)
    found = missed(z=lifted)
    assert {name.removeprefix("force on ") for name in found} == set(model.coordinates)
    for name, value in found.items():
        assert abs(value) < 1e-12, name
    assert abs(missed(z=0.9 * lifted)["force on z"]) > 0.05
    assert abs(missed(z=lifted, y=1e-6 * lifted)["force on y"]) > 0.5


# ------------------------------------------------------------------------------
# From a few moments to a response:
# ------------------------------------------------------------------------------


SCENE = oscillator(-1.0, 0.5, 0.7)
MOMENTS = StationaryMoments(
    mean=-0.2,
    variance=0.3,
    velocity_mean_square=0.6,
    upcrossing_rate=0.2,
    lower=StopStatistics(0.1, 0.07, 0.06),
    upper=StopStatistics(0.25, 0.16, 0.15),
)
ERRORS = StationaryMoments(
    mean=2e-5,
    variance=4e-5,
    velocity_mean_square=3e-5,
    upcrossing_rate=1e-5,
    lower=StopStatistics(1e-5, 2e-5, 3e-5),
    upper=StopStatistics(2e-5, 1e-5, 1e-5),
)


def moved(signs: tuple[int, ...]) -> StationaryMoments:
    """Each number off by its error, up or down."""
    sign = iter(signs)

    def stop(one: StopStatistics, error: StopStatistics) -> StopStatistics:
        return StopStatistics(
            *(a + next(sign) * b for a, b in zip(one[:3], error[:3], strict=True))
        )

    names = ("mean", "variance", "velocity_mean_square", "upcrossing_rate")
    return replace(
        MOMENTS,
        **{name: getattr(MOMENTS, name) + next(sign) * getattr(ERRORS, name) for name in names},
        lower=stop(MOMENTS.lower, ERRORS.lower),
        upper=stop(MOMENTS.upper, ERRORS.upper),
    )


def response(answer: StationaryMoments):
    return answer.response("by hand", SCENE, how="by hand", started=time.perf_counter())


def test_quantities_are_those_of_the_moments() -> None:
    found = values(response(MOMENTS))
    assert found["displacement_std"] == math.sqrt(0.3)
    assert found["displacement_mean_square"] == pytest.approx(0.3 + 0.04)
    assert found["collision_rate"] == pytest.approx(0.35)
    assert found["impact_speed_mean"] == pytest.approx(0.23 / 0.35)


def test_bounds_are_what_each_moment_moves_added_up() -> None:
    whole = response(replace(MOMENTS, errors=ERRORS))
    given = whole.estimates() | whole.identities
    moves = dict.fromkeys(given, 0.0)
    for number in range(10):
        other = response(moved(tuple(int(place == number) for place in range(10))))
        for key, estimate in (other.estimates() | other.identities).items():
            moves[key] += abs(estimate.value - given[key].value)
    for key, total in moves.items():
        bias = given[key].bias
        assert bias is not None
        # to first order in errors of some 1e-4; the bound on a balance may be wider, because its
        # terms move one another
        assert bias > (1.0 - 2e-3) * total, key
        if key not in whole.identities:
            assert bias < (1.0 + 2e-3) * total + 1e-15, key
