"""Units and spectral conventions, against their definitions."""

from __future__ import annotations

import math

import pytest
from scipy.integrate import quad

from stochvi.mathematics.units import (
    DENSITY_UNITS,
    STANDARD_GRAVITY,
    density_from_intensity,
    intensity_from_density,
    power_ratio,
)
from stochvi.model.model import model_of
from stochvi.scenes.excitations import ConstantLoad, WhiteNoise
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Isolator


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
