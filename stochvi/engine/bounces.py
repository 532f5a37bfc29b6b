"""When a path rests on a stop, in all kernels: after how many bounces, and after how slow ones."""

MOST_BOUNCES = 1000
"""Largest number of impacts of a path in one step. A mass with more of them is pressed against the
stop: its speed is at most 1/2000 of the speed that the pressing acceleration brings in the step,
and it is put to rest on the stop."""

MOST_EVENTS = 10_000
"""Largest number of events of one mass in a step: touches, ends of pieces of a force, ends of
contacts. It is ten times MOST_BOUNCES because a mass that is pressed onto a stiff stop swings on it
many times in a step. After so many events the motion of the step ends where it is."""

RESTING = 1e-8
"""A rebound whose speed is at most this share of the speed that the pressing acceleration brings in
one step rests on the stop. In the response domain, where the pressing acceleration changes within
an interval, it is a share of the rms speed. At speeds of order 1, 1e-8 is the root of the rounding
error of double precision: below it, the energy of a rebound is lost in the rounding of the energy.
"""
