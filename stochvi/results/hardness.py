"""The quantities by which the hardest impact of a mission is judged: the one list of them."""

from __future__ import annotations

IMPACT_SPEED, PEAK_ACCELERATION = "impact_speed", "peak_acceleration"

UNIT_OF_LIMIT = {IMPACT_SPEED: "m/s", PEAK_ACCELERATION: "m/s^2"}
"""SI unit of a limit by the event that an impact exceeds it."""


def is_speed(event: str) -> bool:
    """Whether the hardness of an impact is its speed, for an event with a limit; else it is a peak
    acceleration.

    >>> is_speed("impact_speed"), is_speed("peak_acceleration")
    (True, False)
    """
    return unit_of_limit(event) == UNIT_OF_LIMIT[IMPACT_SPEED]


def unit_of_limit(event: str) -> str:
    """The SI unit of the limit of an event; `ValueError` for one that has no limit."""
    if event not in UNIT_OF_LIMIT:
        raise ValueError(
            f"event must be {' or '.join(map(repr, UNIT_OF_LIMIT))}, got {event!r}; how hard an "
            "impact is by others is not known"
        )
    return UNIT_OF_LIMIT[event]
