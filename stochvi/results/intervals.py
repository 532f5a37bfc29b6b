"""Confidence intervals, and the quantiles that they are made of."""

from __future__ import annotations

GAUSSIAN_95 = 1.959963984540054
"""Half width of the central 95 % interval of a normal law, in standard deviations."""
