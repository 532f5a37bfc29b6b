"""When a path is held to rest on a stop, the same for all kernels."""

MOST_BOUNCES = 1000
"""Largest number of impacts of a path in one step. Only a mass that bounces lower than the
acceleration that presses it would make up in a thousandth of the step has more: its speed is at
most 1/2000 of what the pressing brings in the step, and it is then held at the stop."""

RESTING = 1e-8
"""A rebound whose speed is at most this share of the speed that the pressing acceleration brings in
one step rests on the stop. (In the response domain, where what presses changes within an interval:
this share of the rms speed.) At speeds of order 1, 1e-8 is the root of the rounding error of
double precision: below it, the energy of a rebound is lost in the rounding of the energy."""
