"""One contact with a spring and a parallel damper, which can only push (B App. I)."""

from __future__ import annotations

import math
from typing import NamedTuple

import scipy

from stochvi.mathematics.units import checked

__all__ = ["identify_viscoelastic"]


class ContactSolution(NamedTuple):
    """One contact of a free mass with a stop, from its first touch on (SI units).

    The mass leaves with `restitution` times the speed with which it arrived; `time_to_peak` is the
    time from the first touch to the peak force.
    """

    contact_time: float
    time_to_peak: float
    restitution: float
    peak_deflection: float
    peak_force: float


def half_contact(z: float) -> float:
    """arccos z / sqrt(1 - z^2), and its continuation arcosh z / sqrt(z^2 - 1) for z >= 1."""
    if z == 1.0:
        return 1.0
    if z < 1.0:
        return math.acos(z) / math.sqrt((1.0 - z) * (1.0 + z))
    return math.acosh(z) / math.sqrt((z - 1.0) * (z + 1.0))


def kelvin_voigt(stiffness: float, z: float, speed: float, mass: float) -> ContactSolution:
    """Contact with a spring and damper until the force is zero (B App. I).

    With W = sqrt(K / M) and a = arccos z / sqrt(1 - z^2): contact time 2 a / W, restitution
    exp(-2 z a), deflection (w / W) exp(-z a). The force is largest at the time t W =
    3 a - pi / sqrt(1 - z^2), w W M exp(-z t W), or for z >= 1/2 at the first touch, 2 z w W M.
    """
    frequency = math.sqrt(stiffness / mass)
    half = half_contact(z)
    time, peak = 0.0, 2.0 * z
    if z < 0.5:
        time = 3.0 * half - math.pi / math.sqrt(1.0 - z * z)
        peak = math.exp(-z * time)
    return ContactSolution(
        contact_time=2.0 * half / frequency,
        time_to_peak=time / frequency,
        restitution=math.exp(-2.0 * z * half),
        peak_deflection=speed / frequency * math.exp(-z * half),
        peak_force=mass * speed * frequency * peak,
    )


def damping_ratio_of(restitution: float) -> float:
    """The damping ratio z of a stop from which a free mass rebounds with a restitution (B App. I).

    It is the root of exp(-2 z arccos z / sqrt(1 - z^2)) = R. The left side falls from 1 at z = 0
    to 0 as z grows, and does not depend on the speed.

    Parameters
    ----------
    restitution
        R, in (0, 1].

    Examples
    --------
    >>> round(damping_ratio_of(0.571740027585), 9), damping_ratio_of(1.0)
    (0.2, 0.0)
    """
    if not 0.0 < restitution <= 1.0:
        raise ValueError(f"must be in (0, 1], got {restitution:g}")
    if restitution == 1.0:
        return 0.0
    loss = -math.log(restitution)
    highest = 1.0 + math.exp(loss / 2.0)  # 2 z arccos z / sqrt(1 - z^2) > 2 ln z for z > 1
    return float(
        scipy.optimize.brentq(lambda z: 2.0 * z * half_contact(z) - loss, 0.0, highest, xtol=1e-14)
    )


@checked
def identify_viscoelastic(contact_time: float, time_to_peak: float) -> tuple[float, float]:
    """Damping ratio and contact frequency (rad/s) of a stop from the record of one impact.

    By the two times of B App. I, contact_time / time_to_peak = 2 a / (3 a - pi), a = arccos z;
    the frequency is sqrt(stiffness / mass).

    Parameters
    ----------
    contact_time, time_to_peak
        Times from the first touch until the force is back at zero, and until it is largest, s.

    Raises
    ------
    ValueError
        Unless 0 < 2 time_to_peak <= contact_time: damping makes the peak come earlier, and for
        z >= 1/2 the force is largest at the first touch, so that z cannot be found.

    Examples
    --------
    >>> z, omega = identify_viscoelastic(contact_time=3.83e-3, time_to_peak=1.54e-3)
    >>> round(z, 11), round(omega, 6)
    (0.13962520968, 754.499594)
    """
    if not 0.0 < 2.0 * time_to_peak <= contact_time < math.inf:
        raise ValueError(
            "needs 0 < 2 time_to_peak <= contact_time, got "
            f"time_to_peak = {time_to_peak:g} and contact_time = {contact_time:g}"
        )
    ratio = contact_time / time_to_peak
    angle = math.pi * ratio / (3.0 * ratio - 2.0)
    z = math.cos(angle) if ratio > 2.0 else 0.0
    return z, 2.0 * half_contact(z) / contact_time
