"""Impacts of rods by their waves, against chains of masses and springs, and printed numbers."""

from __future__ import annotations

import math
import platform

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from stochvi.mathematics.numerics import gauss_legendre, gauss_panels, newton, root_between
from stochvi.mathematics.rods import Rod, mass_on_rod, rod_on_rod, rod_on_stop
from stochvi.mathematics.units import (
    DENSITIES,
    DENSITY_UNITS,
    STANDARD_GRAVITY,
    density_from_intensity,
    intensity_from_density,
    power_ratio,
    unit,
)
from stochvi.model.model import model_of
from stochvi.scenes.excitations import ConstantLoad, WhiteNoise
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Isolator

# ------------------------------------------------------------------------------
# The roots of `brentq`, to the last digit.
# ------------------------------------------------------------------------------


FUNCTIONS = (
    lambda x, a: math.exp(x) - a,
    lambda x, a: x**3 - 2.0 * x + 1.0 - a,
    lambda x, a: math.tanh(20.0 * (x - 0.1 * a)),
    lambda x, a: math.copysign(abs(x - a / 3.0) ** 0.2, x - a / 3.0),
    lambda x, a: (x - a) ** 3 + 1e-3 * (x - a),
    lambda x, a: -1.0 if x < a else 1.0,
    lambda x, a: a - x,
)


@pytest.mark.parametrize("number", range(len(FUNCTIONS)))
def test_roots_have_the_digits_of_scipy(number: int) -> None:
    random, found = np.random.default_rng(number), 0
    for _ in range(300):
        a, low, width = random.uniform(0.1, 3.0), random.uniform(-4.0, 1.0), random.uniform(0.1, 9)
        error = 10.0 ** random.uniform(-14.0, -3.0)

        def function(x: float, a: float = a) -> float:
            return FUNCTIONS[number](x, a)

        if (function(low) > 0.0) == (function(low + width) > 0.0):
            with pytest.raises(ValueError, match="must change its sign"):
                root_between(function, low, low + width, error)
            continue
        root = root_between(function, low, low + width, error)
        wanted = brentq(function, low, low + width, xtol=error)
        if platform.machine() in ("x86_64", "AMD64"):  # others may fuse products and sums of scipy
            assert root == wanted
        assert abs(root - wanted) <= 2.0 * error + 1e-15 * abs(wanted)
        found += 1
    assert found > 50


def test_a_root_at_an_end_is_that_end() -> None:
    assert root_between(lambda x: x, 0.0, 1.0) == 0.0
    assert root_between(lambda x: x, -1.0, 0.0) == 0.0


# ------------------------------------------------------------------------------
# Newton's method for many problems at once.
# ------------------------------------------------------------------------------


def test_newton_finds_many_roots_and_says_which_it_did_not() -> None:
    """Unlike problems of two unknowns; tanh leads astray without halved steps, and x^2 + 1 has no
    root."""
    wanted = np.array([0.3, -1.5, 2.0, 0.0])

    def problem(x: np.ndarray, some: np.ndarray) -> np.ndarray:
        first = np.where(some == 3, x[0] ** 2 + 1.0, np.tanh(3.0 * (x[0] - wanted[some])))
        return np.array([first, x[1] - x[0] ** 2])

    found, left = newton(problem, np.array([[1.5, 0.0, 1.0, 1.0], [0.0, 0.0, 9.0, 1.0]]))
    assert found[0, :3] == pytest.approx(wanted[:3], abs=1e-12)
    assert found[1, :3] == pytest.approx(wanted[:3] ** 2, abs=1e-12)
    assert left[:3].max() < 1e-11
    assert left[3] >= 1.0


def test_newton_ends_where_the_problem_is_not_a_number() -> None:
    def problem(x: np.ndarray, some: np.ndarray) -> np.ndarray:
        return np.where(x > 0.0, x - 1.0, np.nan)

    found, left = newton(problem, np.array([[-1.0, 3.0]]))
    assert math.isinf(left[0])
    assert found[0, 1] == pytest.approx(1.0, abs=1e-12)


# ------------------------------------------------------------------------------
# Gauss-Legendre quadrature on one panel and on many.
# ------------------------------------------------------------------------------


@pytest.mark.parametrize("nodes", [1, 2, 5, 12])
def test_a_rule_is_exact_up_to_its_degree_and_no_further(nodes: int) -> None:
    points, weights = gauss_legendre(nodes)

    def off(power: int) -> float:
        return abs(float(weights @ points**power) - (1 + (-1) ** power) / (power + 1.0))

    assert max(off(power) for power in range(2 * nodes)) < 1e-14
    # the error of the first power beyond is 2^(2n+1) n!^4 / ((2n+1) (2n)!^2)
    factorial = [float(np.prod(np.arange(1.0, k + 1.0))) for k in (nodes, 2 * nodes)]
    wanted = 2.0 ** (2 * nodes + 1) * factorial[0] ** 4 / (2 * nodes + 1) / factorial[1] ** 2
    assert off(2 * nodes) == pytest.approx(wanted, rel=1e-6, abs=1e-15)


def test_panels_join_rules_along_the_last_axis() -> None:
    edges = np.array([[0.0, 1.0, 1.0, 4.0], [-2.0, -1.0, 0.5, 1.0]])
    x, weights = gauss_panels(edges, 3)
    assert x.shape == weights.shape == (2, 9)
    exact = (edges[:, -1] ** 6 - edges[:, 0] ** 6) / 6.0
    np.testing.assert_allclose(np.sum(weights * x**5, axis=1), exact, rtol=1e-14)
    assert np.all(weights[0, 3:6] == 0.0)


def test_a_shared_rule_cannot_be_changed() -> None:
    points, _ = gauss_legendre(4)
    with pytest.raises(ValueError, match="read-only"):
        points[0] = 0.0


# ------------------------------------------------------------------------------
# Units and spectral conventions, against their definitions.
# ------------------------------------------------------------------------------


def test_the_one_sided_density_holds_the_power_that_theta_says():
    """E v^2 = S0 / (2 b) is the integral over positive frequencies of (2 pi f)^2 |H|^2 G."""
    omega, b, s0 = 1.0, 0.1, 0.2
    density = density_from_intensity(s0)

    def response(f):
        w = 2.0 * math.pi * f
        return w**2 * density / ((omega**2 - w**2) ** 2 + (b * w) ** 2)

    resonance = omega / (2.0 * math.pi)
    low, low_error = quad(response, 0.0, resonance, epsabs=0.0)
    high, high_error = quad(response, resonance, math.inf, epsabs=0.0)
    assert low + high == pytest.approx(s0 / (2.0 * b), rel=0.0, abs=low_error + high_error)


def test_a_one_sided_density_per_hertz_is_twice_the_two_sided_intensity():
    assert density_from_intensity(0.2) == 0.4
    assert intensity_from_density(density_from_intensity(0.3)) == 0.3


def test_one_g_squared_per_hertz_in_si_units_to_its_printed_digits():
    assert DENSITY_UNITS["g2/Hz"] == pytest.approx(96.1704, rel=0.0, abs=0.5e-4)
    assert DENSITY_UNITS["g2/Hz"] == STANDARD_GRAVITY**2
    assert DENSITY_UNITS["(m/s2)2/Hz"] == DENSITY_UNITS["N2/Hz"] == 1.0


@pytest.mark.parametrize(("unit", "factor"), DENSITY_UNITS.items())
def test_white_noise_of_a_given_density_has_half_of_it_as_intensity(unit, factor):
    assert WhiteNoise(density=0.01, unit=unit).si_intensity == pytest.approx(
        0.005 * factor, rel=1e-15
    )


@pytest.mark.parametrize(
    ("level_db", "ratio"), [(0.0, 1.0), (10.0, 10.0), (-20.0, 0.01), (3.0, 1.9953), (6.0, 3.9811)]
)
def test_decibels_are_of_power(level_db, ratio):
    assert power_ratio(level_db) == pytest.approx(ratio, rel=0.0, abs=0.5e-4)


def test_an_acceleration_of_the_base_pushes_the_relative_motion_the_other_way():
    load = ConstantLoad(acceleration=9.80665)
    scene = Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[load])
    assert model_of(scene).load == -9.80665


@pytest.mark.parametrize(
    ("spelling", "name", "factor"),
    [
        ("g^2/Hz", "g2/Hz", STANDARD_GRAVITY**2),
        ("(m/s**2)**2 / hz", "(m/s2)2/Hz", 1.0),
        ("G²/Hz", "g2/Hz", STANDARD_GRAVITY**2),
        ("m2/s4/Hz", "(m/s2)2/Hz", 1.0),
        ("m^2/s^3", "(m/s2)2/Hz", 1.0),
        ("m² s^-4 / Hz", "(m/s2)2/Hz", 1.0),
        ("g_0 ** 2 / hertz", "g2/Hz", STANDARD_GRAVITY**2),
        ("meter ** 2 / second ** 3", "(m/s2)2/Hz", 1.0),
        ("kN^2/Hz", "kN^2/Hz", 1e6),
        ("mg^2/Hz", "mg^2/Hz", 1e-6 * STANDARD_GRAVITY**2),
        ("(in/s^2)^2/Hz", "(in/s^2)^2/Hz", 0.0254**2),
        ("g2/(rad/s)", "g2/(rad/s)", 2.0 * math.pi * STANDARD_GRAVITY**2),
    ],
)
def test_a_spelling_of_a_unit(spelling: str, name: str, factor: float) -> None:
    found = unit(spelling)
    assert found.name == name and found.factor == pytest.approx(factor, rel=1e-12)
    assert found.quantity in DENSITIES


@pytest.mark.parametrize(
    "spelling",
    ["V^2/Hz", "EU", "", "10", "g**999", "kg2/Hz/", "dB", "dB re 1 m", "Gg^2/Hz", "x" * 99],
)
def test_what_is_no_unit_is_answered_with_those_that_are(spelling: str) -> None:
    with pytest.raises(ValueError, match=r"g2/Hz"):
        unit(spelling)


def test_usual_spellings_need_no_parser(monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[str] = []
    monkeypatch.setattr("stochvi.mathematics.units._registry", lambda: loaded.append("pint"))
    unit.cache_clear()
    for spelling in ("g^2/Hz", "(m/s**2)^2 / Hz", "g2/hz", "dB re 1 g²/Hz", "N2/Hz", "ms", "h"):
        assert unit(spelling).factor > 0.0
    for spelling in ("ASD run 1", "frequency", "run (third)", "Channel 4"):
        with pytest.raises(ValueError, match="not a known unit"):
            unit(spelling)
    assert not loaded
    with pytest.raises(ValueError, match="not a known unit"):
        unit("g2/kHz")
    assert loaded
    unit.cache_clear()


# ------------------------------------------------------------------------------
# Impacts of rods by their waves, against chains of masses and springs, and printed numbers.
# ------------------------------------------------------------------------------


STEEL = {"area": 1e-4, "young": 2.1e11, "density": 7850.0}


def rod(length: float, **keys: object) -> Rod:
    return Rod(**{"length": length, **STEEL, **keys})


def chain(body: float | Rod, target: Rod, cells: int) -> tuple[float, float]:
    """Restitution and contact time by finite differences: a chain of masses and springs, at the
    step in which a wave runs through one cell; a body is the first mass, a rod a chain of its own
    behind a contact that only pushes."""
    dx = target.length / cells
    striker = body if isinstance(body, Rod) else None
    ahead = 0 if striker is None else round(striker.length / dx)
    masses = np.concatenate([
        np.full(ahead, 0.0 if striker is None else striker.area * striker.density * dx),
        np.full(cells, target.area * target.density * dx),
    ])  # fmt: skip
    springs = np.concatenate([
        np.full(max(ahead - 1, 0), 0.0 if striker is None else striker.area * striker.young / dx),
        [target.area * target.young / dx] * (ahead > 0),  # the contact
        np.full(cells - 1, target.area * target.young / dx),
    ])  # fmt: skip
    if striker is None:
        masses[0] = body + masses[0] / 2.0
    step = 0.5 * dx / target.wave_speed
    u, v = np.zeros(len(masses)), np.zeros(len(masses))
    v[: max(ahead, 1)] = 1.0
    time = touched = 0.0
    while time < 100.0 * target.return_time:
        pull = springs * np.diff(u)
        if ahead:
            pull[ahead - 1] = min(pull[ahead - 1], 0.0)
        force = np.diff(pull, prepend=0.0, append=0.0)
        if target.far_end == "fixed":
            force[-1] -= 2.0 * target.area * target.young / dx * u[-1]
        gain = force / masses
        push = -pull[ahead - 1] if ahead else -body * gain[0]
        touched = time if push > 0.0 else touched
        # chains ring, so that rods count as parted after a while
        if time - touched > (0.1 if ahead else 0.0) * target.length / target.wave_speed:
            break
        v += step * gain
        u += step * v
        time += step
    behind = masses[max(ahead, 1) :] @ v[max(ahead, 1) :] / target.mass
    front = v[:ahead].mean() if ahead else v[0]
    return (behind if target.far_end == "free" else 0.0) - front, time


@pytest.mark.parametrize("far_end", ["fixed", "free"])
@pytest.mark.parametrize("ratio", [0.7, 2.0, 6.0])
def test_a_body_on_a_rod_is_that_of_a_chain(far_end: str, ratio: float) -> None:
    target = rod(0.5, far_end=far_end)
    found = mass_on_rod(ratio * target.mass, target)
    coarse, fine = (chain(ratio * target.mass, target, cells) for cells in (200, 400))
    for place, value in enumerate((found.restitution, found.contact_time)):
        error = abs(fine[place] - coarse[place]) + 0.01 * value
        assert value == pytest.approx(fine[place], abs=error)
    other = mass_on_rod(1.3 * ratio * target.mass, target)
    moved = (other.restitution, other.contact_time)
    assert not np.allclose(moved, fine, rtol=0.015)


@pytest.mark.parametrize(
    ("length", "keys"), [(0.2, {}), (0.35, {"area": 3e-4}), (0.2, {"area": 0.4e-4})]
)
def test_a_rod_on_a_rod_is_that_of_two_chains(length: float, keys: dict[str, float]) -> None:
    striker, target = rod(length, **keys), rod(0.5)
    found = rod_on_rod(striker, target)
    coarse, fine = (chain(striker, target, cells)[0] for cells in (300, 600))
    assert found.restitution == pytest.approx(fine, abs=abs(fine - coarse) + 0.01)
    assert found.restitution != pytest.approx(rod_on_rod(rod(1.2 * length, **keys), target)[0])


@pytest.mark.parametrize(("ratio", "lengths"), [(1.0, 3.068), (2.0, 4.708), (4.0, 5.900)])
def test_contact_times_of_a_body_on_a_fixed_rod_are_those_printed(
    ratio: float, lengths: float
) -> None:
    """Timoshenko and Goodier, section 169, in times that a wave takes along the rod."""
    target = rod(0.5, far_end="fixed")
    found = mass_on_rod(ratio * target.mass, target)
    assert found.contact_time * target.wave_speed / target.length == pytest.approx(
        lengths, abs=6e-4
    )


def test_equal_cross_sections_give_the_ratio_of_lengths() -> None:
    for length in (0.1, 0.3, 0.5):
        assert rod_on_rod(rod(length), rod(0.5)).restitution == pytest.approx(length / 0.5)
        assert rod_on_rod(rod(0.5), rod(length)).restitution == pytest.approx(length / 0.5)
    # a rod in front of a stop is a longer rod on a stop
    found = rod_on_rod(rod(0.5), rod(0.2, far_end="fixed"))
    assert found.restitution == pytest.approx(1.0)
    assert found.contact_time == pytest.approx(rod_on_stop(rod(0.7)).contact_time)


def test_momentum_and_energy_leave_no_more_than_came() -> None:
    random = np.random.default_rng(1)
    for _ in range(50):
        one, two = (
            rod(random.uniform(0.1, 1.0), area=random.uniform(0.2, 5.0) * 1e-4) for _ in range(2)
        )
        assert -1e-9 <= rod_on_rod(one, two).restitution <= 1.0 + 1e-9
    heavy = mass_on_rod(1e3 * rod(0.5).mass, rod(0.5, far_end="fixed"))
    assert heavy.restitution == pytest.approx(1.0, abs=2e-3)  # the rod is a spring


def test_what_is_no_rod_is_refused() -> None:
    with pytest.raises(ValueError, match="length must be positive"):
        rod(-1.0)
    with pytest.raises(ValueError, match="far_end must be"):
        rod(1.0, far_end="loose")
    with pytest.raises(ValueError, match="striker must be a free rod"):
        rod_on_rod(rod(1.0, far_end="fixed"), rod(1.0))
    with pytest.raises(ValueError, match="mass must be positive"):
        mass_on_rod(0.0, rod(1.0))
