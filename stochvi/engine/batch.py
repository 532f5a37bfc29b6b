"""Rows of the block of memory of contacts that are integrated side by side."""

from __future__ import annotations

from stochvi.engine.law import MOST_NUMBERS
from stochvi.engine.pushes import MOMENTS

RUNNING, OVER, LASTING = 0.0, 1.0, 2.0
"""States of the contact of a lane."""

(
    LEFT, Y, V, T, H, LONGEST, WHOLE, TRIES, PUSHING, STATE, PEAKS, LOST, LASTED,
    Q0, Q1, Q2, Q3, OWN, C0, C1, C2, C3, PUSH,
) = range(23)  # fmt: skip
NUMBERS = 23
NOW = NUMBERS + MOST_NUMBERS + 1
ROWS = NOW + MOMENTS
"""What is left of the step; state of a contact; curvature of the gap without forces by powers of
time; immediate response of its speed to a push, and that of its curvature by moments; acceleration
onto the stop; numbers of the law; moments of the push."""
