"""The density between two stops and its moments, against quadrature and closed forms."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import dawsn, erf, erfcx

from stochvi.mathematics.truncated_normal import TruncatedNormal

ROUNDING = 1e-13
"""Some hundred operations in double precision, each good to 1e-16 of its result."""


def moments_by_quad(law: TruncatedNormal) -> tuple[float, float, float, float]:
    """Mean above the lower stop, variance, and their errors, by adaptive quadrature."""
    gap = law.upper - law.lower
    slope = law.slope - law.curvature * law.lower

    def log_density(y):
        return slope * y - law.curvature * y * y / 2.0

    places = {0.0, gap}
    if law.curvature != 0.0:
        places.add(min(max(slope / law.curvature, 0.0), gap))
    top = max(map(log_density, places))
    # quad needs to be told where the density lives: cut the gap geometrically towards its ends
    cuts = sorted(
        {place + sign * gap * 0.5**k for place in places for sign in (-1, 1) for k in range(40)}
        | places
    )
    cuts = [cut for cut in cuts if 0.0 <= cut <= gap]

    def integral(power):
        parts = [
            quad(
                lambda y: y**power * math.exp(log_density(y) - top),
                *pair,
                epsabs=1e-20 * gap ** (power + 1),
                epsrel=1e-12,
            )
            for pair in pairwise(cuts)
        ]
        return sum(part[0] for part in parts), sum(part[1] for part in parts)

    (mass, off0), (first, off1), (second, off2) = (integral(power) for power in range(3))
    mean, square = first / mass, second / mass
    relative = off0 / mass + off1 / first + off2 / second
    return mean, square - mean**2, relative * mean, relative * square


@pytest.mark.parametrize("curvature", [4.0, 1.0, 1e-3, 0.0, -1e-3, -1.47, -24.6, -1e4])
@pytest.mark.parametrize("slope", [0.0, 0.7, -30.0, 800.0])
@pytest.mark.parametrize(("lower", "upper"), [(-1.0, 1.0), (-0.5, 1.0), (2.0, 2.001)])
def test_moments_are_integrals_of_the_density_for_curvature_of_either_sign(
    curvature, slope, lower, upper
):
    law = TruncatedNormal(slope=slope, curvature=curvature, lower=lower, upper=upper)
    mean, variance, mean_error, square_error = moments_by_quad(law)
    gap = upper - lower
    # rounding: of the stops, and of the slope at them
    slack = ROUNDING * (gap + max(abs(lower), abs(upper)))
    assert law.mean - lower == pytest.approx(mean, rel=0.0, abs=mean_error + slack)
    assert law.variance == pytest.approx(
        variance, rel=0.0, abs=2.0 * square_error + 2.0 * gap * slack
    )


@pytest.mark.parametrize("cut", [-8.0, -1.0, 0.0, 1.0, 6.0, 40.0, 1e4])
@pytest.mark.parametrize(("centre", "deviation"), [(0.0, 1.0), (3.0, 1e-3)])
@pytest.mark.parametrize("side", ["lower", "upper"])
def test_one_stop_in_the_tail_gives_the_inverse_mills_ratio(cut, centre, deviation, side):
    """Mean m + s h and variance s^2 (1 + c h - h^2), h = phi(c) / Q(c), c the cut in deviations."""
    sign = 1.0 if side == "lower" else -1.0
    stop = centre + sign * cut * deviation
    law = TruncatedNormal(slope=centre / deviation**2, curvature=1.0 / deviation**2, **{side: stop})
    # the cut that the law sees: the stop and the slope are rounded numbers
    c = sign * (stop - centre) / deviation
    h = math.sqrt(2.0 / math.pi) / erfcx(c / math.sqrt(2.0))
    beyond = sign * (law.mean - stop)
    lost = 8.0 * 2.0**-52 * max(abs(stop), abs(centre)) / deviation * (1.0 + abs(c))
    assert beyond == pytest.approx(
        deviation * (h - c), rel=0.0, abs=deviation * (lost + ROUNDING * h)
    )
    assert law.variance == pytest.approx(
        deviation**2 * (1.0 + c * h - h * h),
        rel=0.0,
        abs=deviation**2 * (lost + 8.0 * 2.0**-52 * (1.0 + h * h)),
    )
    assert law.density_at(stop) == pytest.approx(h / deviation, rel=lost + ROUNDING)


@pytest.mark.parametrize("sharpness", [1e-2, 1.0, 25.0, 1e4, 1e8])
def test_a_density_that_leans_on_both_stops_gives_the_dawson_integral(sharpness):
    """With curvature -a, D = 1: p(D) = sqrt(a / 8) / F(sqrt(a / 2)), E x^2 = (2 p(D) - 1) / a."""
    law = TruncatedNormal(slope=0.0, curvature=-sharpness, lower=-1.0, upper=1.0)
    at_stop = math.sqrt(sharpness / 8.0) / dawsn(math.sqrt(sharpness / 2.0))
    # the exponent, of size a / 2, is rounded
    slack = ROUNDING + 2.0**-53 * sharpness
    assert law.density_at(1.0) == pytest.approx(at_stop, rel=slack)
    assert law.mean_square == pytest.approx(
        (2.0 * at_stop - 1.0) / sharpness, rel=0.0, abs=slack * (1.0 + 2.0 * at_stop / sharpness)
    )


@pytest.mark.parametrize("steepness", [0.5, -3.0, 30.0, -700.0])
@pytest.mark.parametrize("gap", [1e-6, 1.0, 1e4])
def test_without_curvature_the_law_is_a_cut_exponential(steepness, gap):
    """Slope t / gap: mean gap / 2 (coth(t / 2) - 2 / t) from the middle, and its derivative."""
    law = TruncatedNormal(slope=steepness / gap, curvature=0.0, lower=0.0, upper=gap)
    half = steepness / 2.0
    mean = gap / 2.0 * (1.0 + 1.0 / math.tanh(half) - 1.0 / half)
    variance = gap**2 * (1.0 / steepness**2 - 0.25 / math.sinh(half) ** 2)
    assert law.mean == pytest.approx(mean, rel=0.0, abs=ROUNDING * gap)
    assert law.variance == pytest.approx(variance, rel=0.0, abs=ROUNDING * gap**2)


@pytest.mark.parametrize("curvature", [1.0, 0.0, -1.0])
@pytest.mark.parametrize("middle", [0.0, 0.3])
def test_a_tiny_gap_makes_the_law_uniform(curvature, middle):
    """Deviations from it are of order (slope x gap)^2, 1e-12 here."""
    gap = 1e-6
    law = TruncatedNormal(
        slope=0.5, curvature=curvature, lower=middle - gap / 2.0, upper=middle + gap / 2.0
    )
    width = law.upper - law.lower
    assert law.variance == pytest.approx(width**2 / 12.0, rel=1e-11)
    assert law.density_at(law.lower) == pytest.approx(1.0 / width, rel=1e-6)


def test_a_gap_far_out_in_the_tail_is_an_exponential_layer():
    """40 deviations out the law decays over 1 / 40 of one; what the far stop cuts is e^-100."""
    law = TruncatedNormal(slope=0.0, curvature=1.0, lower=40.0, upper=42.5)
    h = math.sqrt(2.0 / math.pi) / erfcx(40.0 / math.sqrt(2.0))
    assert law.mean == pytest.approx(h, rel=ROUNDING)
    assert law.density_at(40.0) == pytest.approx(h, rel=ROUNDING)
    assert law.density_at(42.5) == pytest.approx(
        h * math.exp(-(42.5**2 - 40.0**2) / 2.0), rel=1e-11
    )


def test_a_stop_far_from_a_sharp_layer_keeps_the_layer():
    """A decay length of 1e-20 at a place of 0.01 is below the rounding of the place."""
    law = TruncatedNormal(slope=0.0, curvature=1e22, lower=0.01)
    assert law.mean == 0.01
    assert law.density_at(0.01) == pytest.approx(1e20, rel=ROUNDING)
    assert law.variance == pytest.approx(1e-40, rel=1e-11)


def test_the_density_is_the_textbook_one_and_zero_beyond_the_stops():
    law = TruncatedNormal(slope=0.5, curvature=4.0, lower=-1.0, upper=0.5)
    x = np.array([-1.001, -1.0, 0.0, 0.5, 0.501])
    normal = np.exp(-0.5 * (2.0 * (x - 0.125)) ** 2) * 2.0 / math.sqrt(2.0 * math.pi)
    inside = (erf(0.75 / math.sqrt(2.0)) + erf(2.25 / math.sqrt(2.0))) / 2.0
    expected = np.where([False, True, True, True, False], normal / inside, 0.0)
    assert law.density(x) == pytest.approx(expected, rel=ROUNDING, abs=0.0)
    assert law.density_at(None) == 0.0


@given(
    slope=st.floats(-1e6, 1e6),
    curvature=st.floats(-1e6, 1e6),
    lower=st.floats(-1e3, 1e3),
    gap=st.floats(1e-6, 1e3),
)
def test_any_law_between_stops_has_a_mean_between_them_and_obeys_its_balances(
    slope, curvature, lower, gap
):
    """p(u) - p(l) = slope - curvature E x follows from integrating the derivative of p."""
    law = TruncatedNormal(slope=slope, curvature=curvature, lower=lower, upper=lower + gap)
    width = law.upper - law.lower
    assert law.lower <= law.mean <= law.upper
    assert 0.0 < law.variance <= (width / 2.0) ** 2 * (1.0 + ROUNDING)
    ends = law.density_at(law.upper), law.density_at(law.lower)
    steepest = abs(slope) + abs(curvature) * max(abs(law.lower), abs(law.upper))
    # what rounding the slope, at its largest, does to the density over the gap
    slack = ROUNDING + 4.0 * 2.0**-52 * steepest * width
    assert ends[0] - ends[1] == pytest.approx(
        slope - curvature * law.mean, rel=0.0, abs=slack * (max(ends) + steepest)
    )


@pytest.mark.parametrize(
    "keys",
    [
        {"slope": 0.0, "curvature": 0.0},
        {"slope": 1.0, "curvature": 0.0, "lower": 0.0},
        {"slope": -1.0, "curvature": 0.0, "upper": 0.0},
        {"slope": -1.0, "curvature": -1.0, "lower": 0.0},
        {"slope": math.nan, "curvature": 1.0},
        {"slope": 0.0, "curvature": math.inf, "lower": 0.0, "upper": 1.0},
    ],
)
def test_a_density_that_cannot_be_normalised_is_refused(keys):
    with pytest.raises(ValueError, match="must fall towards a side without a stop"):
        TruncatedNormal(**keys)
