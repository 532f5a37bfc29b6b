"""The beta distribution by mean and standard deviation, beside scipy's."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from stochvi.mathematics.beta_distribution import BetaDistribution

LAWS = [
    BetaDistribution(0.7, 0.1),
    BetaDistribution(0.5, 0.28),
    BetaDistribution(0.9, 0.2),
    BetaDistribution(0.1, 0.05),
    BetaDistribution(0.5, 0.45),
    BetaDistribution(0.99, 0.005),
]


def scipys(law: BetaDistribution) -> stats.rv_continuous:
    return stats.beta(law.alpha, law.beta)


@pytest.mark.parametrize("law", LAWS)
def test_its_moments_are_those_of_scipy(law: BetaDistribution) -> None:
    other = scipys(law)
    assert other.mean() == pytest.approx(law.mean, rel=1e-12)
    assert other.std() == pytest.approx(law.std, rel=1e-12)
    a, b = law.alpha, law.beta
    assert law.moment(1.0) == pytest.approx(a / (a + b), rel=1e-10)
    assert law.moment(2.0) == pytest.approx(law.mean**2 + law.std**2, rel=1e-10)
    if a > 1.0:
        assert law.moment(-1.0) == pytest.approx((a + b - 1.0) / (a - 1.0), rel=1e-10)
    if 1.0 < a < 20.0 and b > 1.0:
        root, _ = quad(lambda r: math.sqrt(r) * other.pdf(r), 0.0, 1.0, epsrel=1e-9)
        assert law.moment(0.5) == pytest.approx(root, rel=1e-7)
        logarithm, _ = quad(lambda r: math.log(r) * other.pdf(r), 0.0, 1.0, epsrel=1e-9)
        assert law.mean_logarithm == pytest.approx(logarithm, rel=1e-7)
    assert law.moment(-law.alpha) == math.inf


@pytest.mark.parametrize("law", LAWS)
def test_gauss_rules_are_exact_for_their_degree(law: BetaDistribution) -> None:
    nodes, weights = law.rule(6)
    assert np.all((nodes >= 0.0) & (nodes <= 1.0)) and np.all(weights > 0.0)
    for power in range(12):
        assert weights @ nodes**power == pytest.approx(law.moment(float(power)), rel=1e-10)
    beyond = float(weights @ nodes**12.0)
    assert beyond < law.moment(12.0) and beyond == pytest.approx(law.moment(12.0), rel=0.1)


@pytest.mark.parametrize("law", LAWS)
def test_cells_have_its_mean_and_variance_and_nearly_its_distribution(
    law: BetaDistribution,
) -> None:
    middles, widths = law.cells(512)
    low, high = middles - widths / 2.0, middles + widths / 2.0
    assert low.min() > -1e-12 and high.max() < 1.0 + 1e-9
    mean = float(middles.mean())
    variance = float(np.mean((middles - mean) ** 2 + widths**2 / 12.0))
    assert mean == pytest.approx(law.mean, rel=1e-9)
    assert math.sqrt(variance) == pytest.approx(law.std, rel=1e-8)
    # each is drawn within its own cell or the next, up to what moves no rebound
    edges = scipys(law).ppf(np.clip(np.arange(-1, 514) / 512.0, 0.0, 1.0))
    assert np.all(low > edges[:-3] - 1e-9) and np.all(high < edges[3:] + 1e-9)


def test_a_narrow_distribution_keeps_its_digits() -> None:
    """The branch for concentrated distributions, beside the other one just before it."""
    wide, narrow = BetaDistribution(0.7, 4.6e-5), BetaDistribution(0.7, 4.5e-5)
    assert wide.concentration < 1e8 < narrow.concentration
    for law in (wide, narrow, BetaDistribution(0.7, 1e-9)):
        middles, widths = law.cells(64)
        variance = float(np.mean((middles - 0.7) ** 2 + widths**2 / 12.0))
        assert math.sqrt(variance) == pytest.approx(law.std, rel=1e-6)
        assert law.moment(-1.5) == pytest.approx(0.7**-1.5, rel=1e-6)
        assert law.mean_logarithm == pytest.approx(math.log(0.7), abs=1e-8)
        nodes, weights = law.rule(4)
        assert weights @ nodes == pytest.approx(0.7, rel=1e-14)
        spread = math.sqrt(float(weights @ (nodes - 0.7) ** 2))
        assert spread == pytest.approx(law.std, rel=1e-6)
