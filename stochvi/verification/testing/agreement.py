"""Comparison of a sampled number with the truth, by the errors that it states."""

from __future__ import annotations

from stochvi.results.estimates import Estimate

Z = 4.5
"""Largest difference that passes, in standard errors: a right answer exceeds it once in 150 000
cases."""


def assert_agrees(estimate: Estimate, truth: float, z: float = Z) -> None:
    """Fail unless `truth` lies within z standard errors and the stated bias of the estimate.

    Errors are put together by the one rule of `Estimate`.

    Parameters
    ----------
    estimate
        The sampled number.
    truth
        The true value.
    z
        Number of standard errors by which the estimate may be off.

    Raises
    ------
    AssertionError
        With the value, the truth and the standard errors between them.
    ValueError
        If it is no estimate, or states no bias, because then no truth can refute it.

    See Also
    --------
    stochvi.testing.judge : Compares with several known answers, and says what is wrong.

    Examples
    --------
    >>> assert_agrees(Estimate(value=1.02, standard_error=0.01), 1.0)
    >>> assert_agrees(
    ...     Estimate(value=1.08, standard_error=0.01), 1.0
    ... )  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    AssertionError: 1.080(10) [] differs from 1 by 0.08: 8.0 standard errors ...
    """
    if not isinstance(estimate, Estimate):
        raise ValueError(f"estimate must be an Estimate, got {estimate!r}; give its errors as well")
    if estimate.bias is None:
        raise ValueError(f"{estimate} states no bias, so no truth can confirm or refute it")
    difference = estimate.value - truth
    tolerance = estimate.reach(z)
    away = f"{abs(difference) / estimate.standard_error:.1f}" if estimate.standard_error else "inf"
    if not abs(difference) <= tolerance:
        raise AssertionError(
            f"{estimate} differs from {truth:.9g} by {difference:.3g}: {away} standard errors of "
            f"{estimate.standard_error:.3g}, allowed {z:g} and a bias of {estimate.bias:.3g}"
        )
