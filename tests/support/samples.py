"""Estimates from samples."""

from __future__ import annotations

import math

import numpy as np

from stochvi.results.estimates import Estimate


def estimate(sample: np.ndarray, bias: float = 0.0) -> Estimate:
    error = float(sample.std(ddof=1)) / math.sqrt(len(sample))
    return Estimate(value=float(sample.mean()), standard_error=error, bias=bias)


def apart(one: Estimate, two: Estimate) -> Estimate:
    """The difference of two independent estimates."""
    return Estimate(
        value=one.value - two.value,
        standard_error=math.hypot(one.standard_error or 0.0, two.standard_error or 0.0),
        bias=(one.bias or 0.0) + (two.bias or 0.0),
    )
