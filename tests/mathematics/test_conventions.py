"""Units and spectral conventions, against their definitions."""

from __future__ import annotations

import math

import pytest
from scipy.integrate import quad

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
