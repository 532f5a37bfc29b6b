"""Gauss-Legendre quadrature on one panel and on many."""

from __future__ import annotations

import numpy as np
import pytest

from stochvi.mathematics.quadrature import gauss_legendre, gauss_panels


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
