"""Rows of the block of memory of lanes that finish a step together."""

from __future__ import annotations

from stochvi.engine.law import MOST_NUMBERS
from stochvi.engine.pushes import MOMENTS, MOST_TERMS

SHORTEST_SPAN = 1e-50
"""Smallest divisor in the place of what is left of a step, s, so that nothing is divided by 0."""

RUNNING, OVER, LASTING = 0.0, 1.0, 2.0
"""States of the contact of a lane."""

(
    LEFT, BACK, TOP, Y, V, T, H, LONGEST, WHOLE, TRIES, PUSHING, STATE, PEAKS, LOST, LASTED, ALONE,
    Q0, Q1, Q2, Q3, OWN, C0, C1, C2, C3, PUSH,
) = range(26)  # fmt: skip
NUMBERS = 26
NOW = NUMBERS + MOST_NUMBERS + 1
LATER = NOW + MOMENTS
OUT = LATER + MOST_TERMS
SCRATCH = OUT + 1
"""Rows of numbers that are used within a round: what is left of the step, speed after an impact,
largest distance beyond a stop; state of a contact; curvature of the gap without forces by powers of
time; immediate response of its speed to a push, and that of its curvature by moments; acceleration
onto the stop; numbers of the law; moments of a push now and at the end of the step; a sum."""

LANE, SPAN, EVENT, WHEN, FAST, GAPS = range(6)
"""Rows of a batch: the lane, what is left of its step (s), the stop that it touches first, after
which share of that, at which speed; six rows of ends for each gap."""
