"""The roots of `brentq`, to the last digit."""

import math
import platform

import numpy as np
import pytest
from scipy.optimize import brentq

from stochvi.mathematics.brent import root_between

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
