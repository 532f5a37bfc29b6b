"""How a sampled number is compared with the truth: by its own errors, never by a chosen margin."""

from __future__ import annotations

from stochvi.estimates import Estimate

Z = 4.5
"""Standard errors that a right answer exceeds once in 150 000 comparisons."""


def assert_agrees(estimate: Estimate, truth: float, z: float = Z) -> None:
    """Fail unless `truth` lies within z standard errors and the stated bias of the estimate."""
    if estimate.bias is None:
        raise ValueError(f"{estimate} states no bias, so no truth can confirm or refute it")
    difference = estimate.value - truth
    tolerance = z * estimate.standard_error + estimate.bias
    away = f"{abs(difference) / estimate.standard_error:.1f}" if estimate.standard_error else "inf"
    assert abs(difference) <= tolerance, (
        f"{estimate} differs from {truth:.9g} by {difference:.3g}: {away} standard errors of "
        f"{estimate.standard_error:.3g}, allowed {z:g} and a bias of {estimate.bias:.3g}"
    )
