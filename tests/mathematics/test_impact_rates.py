"""Rates and speeds of impacts, against integrals over the law of the speed."""

import math

import pytest
from scipy.integrate import quad

from stochvi.mathematics.impact_rates import corner_exponent, gaussian_stop, rice_rate
from stochvi.mathematics.kelvin_voigt import kelvin_voigt


@pytest.mark.parametrize("square", [1.0, 0.3])
def test_statistics_of_a_stop_are_moments_of_the_speeds_that_pass_it(square: float) -> None:
    """p int v^(1 + k) N(v; 0, s^2) dv over v > 0."""
    found = gaussian_stop(0.7, square)

    def passing(power: int) -> float:
        density = lambda v: math.exp(-v * v / (2.0 * square)) / math.sqrt(2.0 * math.pi * square)  # noqa: E731
        return 0.7 * quad(lambda v: v ** (1 + power) * density(v), 0.0, 12.0, epsabs=1e-13)[0]

    expected = [passing(power) for power in range(3)]
    assert [found.rate, found.speed_rate, found.speed_square_rate] == pytest.approx(expected)


def test_rices_rate_is_that_of_a_stop_that_is_not_there() -> None:
    density = math.exp(-2.0) / math.sqrt(2.0 * math.pi) / 0.5
    assert rice_rate(1.0, 0.5, 3.0) == pytest.approx(gaussian_stop(density, 9.0).rate)


@pytest.mark.parametrize("restitution", [0.2, 0.5, 0.9])
def test_the_exponent_of_a_corner_balances_what_arrives_and_leaves(restitution: float) -> None:
    """R^(beta - 2) = 2 sin((1 + 2 beta) pi / 6), of which R = 1/2 has the root 1."""
    beta = corner_exponent(restitution)
    left = restitution ** (beta - 2.0)
    assert left == pytest.approx(2.0 * math.sin((1.0 + 2.0 * beta) * math.pi / 6.0), rel=1e-9)
    assert corner_exponent(0.5) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("z", [0.05, 0.3, 0.7, 1.0, 2.5])
def test_a_contact_with_spring_and_damper_is_that_of_small_steps(z: float) -> None:
    """m y'' = -k y - c y' from y = 0 until the force is zero, by the classical rule of Runge."""
    stiffness, mass, speed = 50.0, 2.0, 0.8
    damping = 2.0 * z * math.sqrt(stiffness * mass)
    found = kelvin_voigt(stiffness, z, speed, mass)

    def pull(y: float, v: float) -> float:
        return -(stiffness * y + damping * v) / mass

    h = found.contact_time / 4000.0
    y, v, time, deepest, largest, at = 0.0, speed, 0.0, 0.0, 0.0, 0.0
    while True:
        force = -mass * pull(y, v)
        if force > largest:
            largest, at = force, time
        deepest = max(deepest, y)
        if time > 0.0 and force <= 0.0:
            break
        k1 = v, pull(y, v)
        k2 = v + h / 2 * k1[1], pull(y + h / 2 * k1[0], v + h / 2 * k1[1])
        k3 = v + h / 2 * k2[1], pull(y + h / 2 * k2[0], v + h / 2 * k2[1])
        k4 = v + h * k3[1], pull(y + h * k3[0], v + h * k3[1])
        y += h / 6 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0])
        v += h / 6 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1])
        time += h
    assert time == pytest.approx(found.contact_time, abs=2.0 * h)
    assert at == pytest.approx(found.time_to_peak, abs=2.0 * h)
    assert deepest == pytest.approx(found.peak_deflection, rel=1e-5)
    assert largest == pytest.approx(found.peak_force, rel=1e-5)
    # within a step of the end the speed changes by that of the decay
    assert -v / speed == pytest.approx(found.restitution, abs=2.0 * h * abs(pull(y, v)) + 1e-3 * h)
