"""The root of a function in a bracket, by the method of Brent, without loading scipy.optimize.

That module takes a quarter of a second to load, a tenth of a first answer. The steps are those of
its `brentq`, with the same digits: R. P. Brent, Algorithms for Minimization Without Derivatives,
1973, chapter 4.
"""

import math
from collections.abc import Callable

ROUNDING = 2.0**-50
"""Relative error of a root, four roundings: the least that `brentq` takes, and its default."""

MOST_STEPS = 100


def root_between(
    function: Callable[[float], float], low: float, high: float, error: float = 2e-12
) -> float:
    """Return a root between two places at which the signs of a function differ.

    Parameters
    ----------
    error : largest absolute error of the root, besides ROUNDING.

    Raises
    ------
    ValueError
        If the signs at both ends are the same.
    RuntimeError
        If MOST_STEPS do not suffice, as near a root of high order.
    """
    before, here = low, high
    f_before, f_here = function(before), function(here)
    if f_before == 0.0:
        return before
    if f_here == 0.0:
        return here
    if (f_before > 0.0) == (f_here > 0.0):
        raise ValueError(f"the function must change its sign in [{low:g}, {high:g}]")
    other = f_other = earlier = last = 0.0  # the other end of the bracket, and two last steps
    for _ in range(MOST_STEPS):
        if f_before != 0.0 and f_here != 0.0 and (f_before > 0.0) != (f_here > 0.0):
            other, f_other = before, f_before
            earlier = last = here - before
        if abs(f_other) < abs(f_here):
            before, here, other = here, other, here
            f_before, f_here, f_other = f_here, f_other, f_here
        least = (error + ROUNDING * abs(here)) / 2.0
        half = (other - here) / 2.0
        if f_here == 0.0 or abs(half) < least:
            return here
        step = half
        if abs(earlier) > least and abs(f_here) < abs(f_before):
            if before == other:
                step = -f_here * (here - before) / (f_here - f_before)
            else:
                slope = (f_before - f_here) / (before - here)
                slope_other = (f_other - f_here) / (other - here)
                step = -f_here * (f_other * slope_other - f_before * slope)
                step /= slope_other * slope * (f_other - f_before)
        short = 2.0 * abs(step) < min(abs(earlier), 3.0 * abs(half) - least)
        earlier, last = (last, step) if step is not half and short else (half, half)
        before, f_before = here, f_here
        here += last if abs(last) > least else math.copysign(least, half)
        f_here = function(here)
    raise RuntimeError(f"no root in [{low:g}, {high:g}] after {MOST_STEPS} steps")
