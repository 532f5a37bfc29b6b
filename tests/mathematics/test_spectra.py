"""Spectral tables and linear responses, against quadrature, closed forms and printed values."""

from __future__ import annotations

import cmath
import math
from itertools import pairwise

import numpy as np
import pytest
import scipy.signal
from scipy.integrate import quad

from stochvi.isolators.screening import screen
from stochvi.mathematics.quadrature import gauss_panels
from stochvi.mathematics.spectra import Table, response_moments, squared_gain, welch
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.scenes.datasets import profiles
from stochvi.scenes.excitations import TabulatedNoise, WhiteNoise
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Isolator

ROUNDING = 1e-13
"""Some hundred operations in double precision, each good to 1e-16 of its result."""


def table(*points: tuple[float, float]) -> Table:
    frequency, density = zip(*points, strict=True)
    return Table(frequency_hz=np.array(frequency), density=np.array(density))


RAGGED = table((5.0, 2.0), (10.0, 0.3), (11.0, 40.0), (11.001, 40.0), (60.0, 40.0 * 11.001 / 60.0))
"""Cliffs up and down, a flat sliver, and a slope of -1."""


def segments_by_quad(spectrum: Table, weight) -> tuple[float, float]:
    """Integral of weight(f) G(f) df and its error, segment by segment, in log frequency."""
    total = error = 0.0
    rows = list(zip(spectrum.frequency_hz, spectrum.density, strict=True))
    for (f1, p1), (f2, p2) in pairwise(rows):
        slope = math.log(p2 / p1) / math.log(f2 / f1)

        def integrand(t, f1=f1, p1=p1, slope=slope):
            f = f1 * math.exp(t)
            return weight(f) * p1 * (f / f1) ** slope * f

        part, off = quad(integrand, 0.0, math.log(f2 / f1), epsabs=0.0, epsrel=1e-12, limit=500)
        total, error = total + part, error + off
    return total, error


def flat_response(low: float, high: float, omega: float, b: float) -> tuple[float, float]:
    """E x^2 and E v^2 for a flat density of 1 between two frequencies, by partial fractions.

    With r = sqrt(omega^2 - b^2 / 4) + i b / 2 the squared gain is Im[1 / (w^2 - r^2)] / Im r^2.
    """
    r = cmath.sqrt(omega**2 - b**2 / 4.0) + 0.5j * b

    def primitive(f: float) -> complex:
        w = 2.0 * math.pi * f
        return cmath.log((w - r) / (w + r))

    step = primitive(high) - primitive(low)
    scale = (r * r).imag * 2.0 * math.pi
    return (step / (2.0 * r)).imag / scale, (step * r / 2.0).imag / scale


# Tables ----------------------------------------------------------------------------------


@pytest.mark.parametrize("power", [-2.0, -1.0, 0.0, 0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize(
    "spectrum",
    [
        RAGGED,
        table((20.0, 0.01), (2000.0, 0.01)),
        table((1.0, 1.0), (100.0, 0.01)),
        table((1.0, 1.0), (100.0, 0.01 * (1.0 + 1e-9))),
        table((1e-3, 1e6), (1e3, 1e-6)),
    ],
    ids=["ragged", "flat", "slope -1", "slope nearly -1", "wide and steep"],
)
def test_a_moment_of_a_table_is_the_integral_of_its_segments(spectrum, power):
    expected, error = segments_by_quad(spectrum, lambda f: f**power)
    tolerance = error + ROUNDING * expected
    assert spectrum.moment(power) == pytest.approx(expected, rel=0.0, abs=tolerance)


@pytest.mark.parametrize(
    ("name", "recomputed"),
    [
        ("mil-std-810h-truck-vertical-5hz", 1.0783),
        ("mil-std-810h-truck-transverse-5hz", 0.2051),
        ("mil-std-810h-truck-longitudinal-5hz", 0.7618),
        ("navmat-p-9492", 6.0582),
        ("mil-std-1540b", 6.1435),
        ("smc-s-016", 6.9385),
        ("gevs-qualification", 14.1356),
        ("gevs-acceptance", 9.9954),
    ],
)
def test_the_g_rms_of_a_shipped_profile_recomputes_to_four_decimals(name, recomputed):
    """By the table that the scene gets, and by the textbook area of a log-log segment."""
    shipped = profiles()[name]
    area = 0.0
    rows = list(zip(shipped.frequency_hz, shipped.density, strict=True))
    for (f1, p1), (f2, p2) in pairwise(rows):
        n = math.log(p2 / p1) / math.log(f2 / f1)
        if math.isclose(n, -1.0, rel_tol=ROUNDING):
            area += f1 * p1 * math.log(f2 / f1)
        else:
            area += (f2 * p2 - f1 * p1) / (n + 1.0)
    g_rms = TabulatedNoise(profile=name).table.mean_square() ** 0.5 / STANDARD_GRAVITY
    assert g_rms == pytest.approx(area**0.5, rel=ROUNDING)
    assert g_rms == pytest.approx(recomputed, rel=0.0, abs=0.5e-4)


@pytest.mark.parametrize(
    ("name", "digits"),
    [
        ("mil-std-810h-truck-vertical-5hz", 2),
        ("mil-std-810h-truck-longitudinal-5hz", 2),
        ("mil-std-810h-truck-transverse-5hz", 2),
        ("navmat-p-9492", 2),
        ("mil-std-1540b", 2),
        ("smc-s-016", 1),
        ("gevs-qualification", 1),
        ("gevs-acceptance", 1),
    ],
)
def test_the_stated_g_rms_of_a_shipped_profile_is_right_to_its_printed_digits(name, digits):
    shipped = profiles()[name]
    area = table(*zip(shipped.frequency_hz, shipped.density, strict=True)).mean_square()
    assert round(area**0.5, digits) == shipped.stated_g_rms


@pytest.mark.parametrize(
    ("name", "g_rms"),
    [
        ("mil-std-810h-truck-vertical-5hz", 1.043),
        ("mil-std-810h-truck-transverse-5hz", 0.2035),
        ("mil-std-810h-truck-longitudinal-5hz", 0.7402),
    ],
)
def test_a_truck_curve_started_at_ten_hertz_has_less_power(name, g_rms):
    shipped = profiles()[name]
    whole = table(*zip(shipped.frequency_hz, shipped.density, strict=True))
    kept = [(f, p) for f, p in zip(shipped.frequency_hz, shipped.density, strict=True) if f > 10.0]
    area = table((10.0, float(whole(10.0))), *kept).mean_square()
    printed = len(str(g_rms).partition(".")[2])
    assert round(area**0.5, printed) == g_rms


def test_a_flat_band_crosses_and_peaks_as_often_as_the_textbook_says():
    """Zero up-crossings sqrt(m2 / m0) and peaks sqrt(m4 / m2) of a flat 20-2000 Hz band."""
    band = table((20.0, 1.0), (2000.0, 1.0))
    zero = math.sqrt(band.moment(2.0) / band.moment(0.0))
    peaks = math.sqrt(band.moment(4.0) / band.moment(2.0))
    assert zero == pytest.approx(1160.51712611232, rel=ROUNDING)
    assert peaks == pytest.approx(1549.19411300276, rel=ROUNDING)


def test_a_table_is_straight_in_log_log_and_zero_outside():
    found = RAGGED([4.999, 5.0, math.sqrt(50.0), 60.0, 60.001])
    inside = [2.0, math.sqrt(2.0 * 0.3), 40.0 * 11.001 / 60.0]
    assert found == pytest.approx([0.0, *inside, 0.0], rel=ROUNDING, abs=0.0)


# Linear responses ------------------------------------------------------------------------


@pytest.mark.parametrize("b", [1e-5, 1e-2, 0.1, 1.0, 1.9])
@pytest.mark.parametrize(
    ("low", "high"),
    [(0.01, 1.0), (0.5 / math.pi, 3.0), (0.001, 0.5 / math.pi), (0.15, 0.1592), (0.2, 20.0)],
    ids=["around", "from the resonance", "up to it", "a narrow band", "above it"],
)
def test_a_flat_band_gives_the_closed_form_however_light_the_damping(low, high, b):
    found = response_moments([table((low, 3.0), (high, 3.0))], omega=1.0, damping_rate=b)
    displacement, velocity = flat_response(low, high, 1.0, b)
    # far from the resonance the partial fractions cancel, and all of the white noise is left; near
    # it frequencies are rounded, and with them their distance from it, which is of the size b / 2
    white, near = 3.0 / (4.0 * b), ROUNDING + 2.0**-52 / (b / 2.0)
    assert found.displacement == pytest.approx(3.0 * displacement, rel=near, abs=ROUNDING * white)
    assert found.velocity == pytest.approx(3.0 * velocity, rel=near, abs=ROUNDING * white)


@pytest.mark.parametrize("frequency_hz", [0.3, 4.0, 5.0, 10.5, 11.0, 30.0, 200.0])
def test_a_ragged_table_gives_the_integral_of_its_response(frequency_hz):
    """Resonances outside the table, on a breakpoint, and on a cliff."""
    omega = 2.0 * math.pi * frequency_hz
    b = 0.4 * omega
    found = response_moments([RAGGED], omega, b)
    for moment, weight in [
        (found.displacement, lambda w: 1.0),
        (found.velocity, lambda w: w**2),
        (found.absolute_acceleration, lambda w: omega**4 + (b * w) ** 2),
        (found.relative_acceleration, lambda w: w**4),
    ]:
        expected, error = segments_by_quad(
            RAGGED,
            lambda f, weight=weight: (
                weight(2 * math.pi * f)
                / ((omega**2 - (2 * math.pi * f) ** 2) ** 2 + (b * 2 * math.pi * f) ** 2)
            ),
        )
        assert moment == pytest.approx(expected, rel=0.0, abs=error + 10.0 * ROUNDING * expected)


@pytest.mark.parametrize(("resonance", "b"), [(3.0, 0.5), (50.0, 1e-3), (500.0, 40.0)])
def test_a_measured_table_of_thousands_of_lines_gives_the_integral_of_each(resonance, b):
    """Against 40 nodes on each segment, which is graded towards the resonance by hand."""
    random = np.random.default_rng(3)
    f = np.linspace(1.0, 200.0, 4000)
    table = Table(frequency_hz=f, density=np.exp(random.normal(size=f.size)))
    omega = 2.0 * math.pi * resonance
    distances = np.geomspace(1e-6, 100.0, 400)
    edges = np.concatenate([f, [resonance], resonance - distances, resonance + distances])
    edges = np.unique(edges[(edges >= 1.0) & (edges <= 200.0)])
    x, weights = gauss_panels(edges, 40)
    parts = squared_gain(x, omega, b) * table(x) * weights
    found = response_moments([table], omega, b)
    assert found.displacement == pytest.approx(parts.sum(), rel=1e-10)
    assert found.velocity == pytest.approx(((2.0 * math.pi * x) ** 2 * parts).sum(), rel=1e-10)


def test_a_table_of_more_lines_than_any_analyser_is_refused():
    lines = np.arange(1.0, 100_002.0)
    with pytest.raises(ValueError, match=r"at most 100000 breakpoints, got 100001; average"):
        Table(frequency_hz=lines, density=lines)
    assert Table(frequency_hz=lines[:-1], density=lines[:-1]).moment(-1.0) == pytest.approx(99_999)


def test_a_wide_flat_table_gives_white_noise_but_for_what_lies_outside_it():
    omega, b, low, high = 1.0, 0.1, 1e-6, 1e6
    found = response_moments([table((low, 0.4), (high, 0.4))], omega, b)
    theta = 0.2 / (2.0 * b)
    below = 0.4 * low / omega**4
    above = 0.4 / (2.0 * math.pi) ** 2 / high
    assert found.displacement + below == pytest.approx(theta / omega**2, rel=ROUNDING)
    assert found.velocity + above == pytest.approx(theta, rel=ROUNDING)


def test_the_responses_to_two_tables_add_up():
    tables = [RAGGED, table((20.0, 1.0), (2000.0, 0.1))]
    parts = [response_moments([one], 60.0, 5.0).velocity for one in tables]
    together = response_moments(tables, 60.0, 5.0).velocity
    assert together == pytest.approx(sum(parts), rel=ROUNDING)


def test_the_gain_keeps_its_digits_a_hair_off_the_resonance():
    omega, offset = 100.0, 2.0**-30
    gain = squared_gain((omega + offset) / (2.0 * math.pi), omega, 0.0)
    # the frequency itself is rounded, by a part in 2^53 of it, half that of its distance
    slack = 2.0 * 2.0 * omega * 2.0**-52 / offset
    assert float(gain) == pytest.approx((offset * (2.0 * omega + offset)) ** -2, rel=slack)


@pytest.mark.parametrize(
    ("profile", "frequency_hz", "zeta", "millimetres"),
    [
        ("mil-std-810h-truck-vertical-5hz", 8.0, 0.05, "5.18"),
        ("mil-std-810h-truck-vertical-5hz", 12.0, 0.10, "1.99"),
        ("mil-std-810h-truck-vertical-5hz", 25.0, 0.10, ".671"),
        ("navmat-p-9492", 12.0, 0.10, ".242"),
    ],
)
def test_worked_examples_of_linear_relative_displacement(profile, frequency_hz, zeta, millimetres):
    digits = len(millimetres.partition(".")[2])
    linear = screen(mount(TabulatedNoise(profile=profile), frequency_hz, zeta=zeta))
    assert round(1e3 * linear.displacement_std, digits) == float(millimetres)


# Miles' equation and Rice's formula ------------------------------------------------------


def mount(noise: TabulatedNoise | WhiteNoise, frequency_hz: float, **damping: float) -> Scene:
    return Scene(structure=Isolator(frequency_hz=frequency_hz, **damping), excitations=[noise])


def test_miles_equation_and_the_exact_absolute_acceleration_of_the_textbook():
    linear = screen(mount(WhiteNoise(density=0.1, unit="g2/Hz"), 200.0, Q=20.0))
    assert linear.miles == pytest.approx(25.06628274631 * STANDARD_GRAVITY, rel=1e-12)
    exact = linear.miles * math.sqrt(1.0 + 1.0 / 20.0**2)
    assert linear.acceleration_std == pytest.approx(exact, rel=ROUNDING)


def test_the_relative_displacement_of_the_textbook():
    linear = screen(mount(WhiteNoise(density=0.04, unit="g2/Hz"), 100.0, Q=10.0))
    assert linear.displacement_std == pytest.approx(0.000196902338044968, rel=ROUNDING)


@pytest.mark.parametrize(("frequency_hz", "inside"), [(12.0, False), (20.0, True), (2001.0, False)])
def test_miles_equation_is_left_out_where_the_table_does_not_reach(frequency_hz, inside):
    linear = screen(mount(TabulatedNoise(profile="navmat-p-9492"), frequency_hz, zeta=0.1))
    assert (linear.miles is not None) == inside
    assert linear.displacement_std > 0.0


@pytest.mark.parametrize(("sigmas", "per_hour"), [(3.0, "800"), (4.0, "24"), (5.0, ".27")])
def test_hits_per_hour_of_a_ten_hertz_mount_by_rice(sigmas, per_hour):
    linear = screen(mount(WhiteNoise(density=0.01, unit="g2/Hz"), 10.0, zeta=0.1))
    hits = 3600.0 * linear.rice_rate(sigmas * linear.displacement_std)
    assert round(hits, len(per_hour.partition(".")[2])) == float(per_hour)


@pytest.mark.parametrize("length", [255, 256])
def test_the_density_of_segments_is_that_of_scipy(length: int) -> None:
    samples = np.random.default_rng(1).normal(3.0, size=5000)
    expected = scipy.signal.welch(samples, 100.0, nperseg=length)
    for own, other in zip(welch(samples, 100.0, length), expected, strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-9, atol=1e-12)
