"""Impacts of rods by their waves (St Venant; Timoshenko and Goodier, Theory of Elasticity, sections
168 and 169; B 1.1 to 1.27).

A rod of cross-section A, Young's modulus E and density rho has the wave speed c = sqrt(E / rho) and
the impedance Z = A sqrt(E rho): a wave that moves its particles at the speed v carries the force
Z v. What arrives at the face of a rod is F = Z v there, and what leaves it follows from the contact
force P and the speed of the face.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from stochvi.mathematics.arguments import checked

__all__ = ["Rod", "RodImpact", "mass_on_rod", "rod_on_rod", "rod_on_stop"]

MOST_WAVES = 10_000
"""Largest number of waves between the ends of a rod that are followed in one contact."""

PUSHES = 1e-12
"""Contact force over that at the first touch, below which the faces part."""


@dataclass(frozen=True, kw_only=True)
class Rod:
    """A uniform elastic rod with waves along it.

    Parameters
    ----------
    length
        Length, m; infinite for a rod from whose far end nothing returns.
    area
        Cross-section, m^2.
    young
        Young's modulus, Pa.
    density
        Density, kg/m^3.
    far_end
        "free", or "fixed" to a rigid stop.

    Examples
    --------
    >>> steel = Rod(length=0.5, area=1e-4, young=2.1e11, density=7850.0)
    >>> round(steel.wave_speed), round(steel.impedance, 1)
    (5172, 4060.2)
    """

    length: float
    area: float
    young: float
    density: float
    far_end: Literal["free", "fixed"] = "free"

    def __post_init__(self) -> None:
        for name in ("length", "area", "young", "density"):
            value = getattr(self, name)
            if not value > 0.0:
                raise ValueError(f"{name} must be positive, got {value:g}")
        if self.far_end not in ("free", "fixed"):
            raise ValueError(f"far_end must be 'free' or 'fixed', got {self.far_end!r}")

    @property
    def wave_speed(self) -> float:
        """c = sqrt(E / rho), m/s."""
        return math.sqrt(self.young / self.density)

    @property
    def impedance(self) -> float:
        """Z = A sqrt(E rho), N s/m."""
        return self.area * math.sqrt(self.young * self.density)

    @property
    def mass(self) -> float:
        """Mass, kg."""
        return self.area * self.length * self.density

    @property
    def return_time(self) -> float:
        """Time in which a wave runs to the far end and back, s."""
        return 2.0 * self.length / self.wave_speed


class RodImpact(NamedTuple):
    """An impact by waves: the restitution of the centres of mass, the duration of the contact (s),
    and the largest contact force for an approach at 1 m/s (N)."""

    restitution: float
    contact_time: float
    peak_force: float


def rod_on_stop(rod: Rod) -> RodImpact:
    """Compute the impact of a free rod on a rigid stop: it leaves with R = 1 after 2 l / c.

    Examples
    --------
    >>> steel = Rod(length=0.5, area=1e-4, young=2.1e11, density=7850.0)
    >>> found = rod_on_stop(steel)
    >>> found.restitution, round(1e3 * found.contact_time, 4)
    (1.0, 0.1933)
    """
    return RodImpact(1.0, rod.return_time, rod.impedance)


@checked
def rod_on_rod(striker: Rod, target: Rod) -> RodImpact:
    """Compute the impact of a free rod on another rod at rest.

    Waves are steps, and the contact force is constant between their arrivals (d'Alembert): with
    what arrives in the striker, F1 = P + Z1 v, and in the target, F2 = P - Z2 v,

        P = (Z2 F1 + Z1 F2) / (Z1 + Z2),    v = (F1 - F2) / (Z1 + Z2).

    A free end returns a wave as -(P - Z1 v) or -(P + Z2 v), a fixed one as P + Z2 v. The contact
    ends when P would be a pull. Of two rods of one cross-section and material the shorter one, of
    length l, is then at rest on the target of length L: R = l / L, with all of the lost energy in
    the waves of the target.

    Parameters
    ----------
    striker
        The rod that arrives, free at its far end.
    target
        The rod at rest.

    Returns
    -------
    RodImpact
        The restitution: the relative speed of the mean velocities after the contact, over that
        before it. With a target that is fixed or infinite it is the speed of the striker alone.

    Raises
    ------
    ValueError
        If the striker is fixed or infinite.

    See Also
    --------
    mass_on_rod : A rigid body on a rod.

    Examples
    --------
    >>> rods = [Rod(length=l, area=1e-4, young=2.1e11, density=7850.0) for l in (0.2, 0.5)]
    >>> round(rod_on_rod(*rods).restitution, 12)
    0.4
    """
    if striker.far_end == "fixed" or math.isinf(striker.length):
        raise ValueError("striker must be a free rod of finite length, got one that cannot move")
    z1, z2 = striker.impedance, target.impedance
    sign = -1.0 if target.far_end == "free" else 1.0
    # (time, force) of the steps that arrive at the contact, by rod
    first, second = [(0.0, z1)], [(0.0, 0.0)]
    now, impulse, peak = 0.0, 0.0, 0.0
    places = [0, 0]
    for _ in range(MOST_WAVES):
        f1, f2 = first[places[0]][1], second[places[1]][1]
        push, speed = (z2 * f1 + z1 * f2) / (z1 + z2), (f1 - f2) / (z1 + z2)
        if push <= PUSHES * z1:
            break
        first.append((now + striker.return_time, -(push - z1 * speed)))
        second.append((now + target.return_time, sign * (push + z2 * speed)))
        peak = max(peak, push)
        coming = [waves[place + 1][0] for waves, place in zip((first, second), places, strict=True)]
        following = min(coming)
        impulse += push * (following - now)
        now = following
        # waves that arrive together, but for rounding, count as one
        places = [
            place + (time <= following * (1.0 + 1e-12))
            for place, time in zip(places, coming, strict=True)
        ]
    moves = target.far_end == "free" and not math.isinf(target.length)
    away = impulse / striker.mass - 1.0 + (impulse / target.mass if moves else 0.0)
    return RodImpact(away, now, peak)


@checked
def mass_on_rod(mass: float, target: Rod) -> RodImpact:
    """Compute the impact of a rigid body on a rod at rest (Boussinesq; B 1.20 to 1.27).

    The face of the rod moves with the body: M v' = -P, P - Z v = F with the wave F that arrives
    from the far end. So v' = -(Z v + F) / M, and between arrivals v is a polynomial of the time
    times exp(-Z t / M), which is followed exactly. The contact ends where P = F + Z v is 0.

    Parameters
    ----------
    mass
        Mass of the body, kg.
    target
        The rod.

    Returns
    -------
    RodImpact
        The restitution is the speed at which the body leaves, over that of its approach. A free rod
        moves away by then, and the speed is relative to its mean velocity.

    Raises
    ------
    ValueError
        If the mass is not positive.

    See Also
    --------
    rod_on_rod : Two rods.

    Examples
    --------
    >>> rod = Rod(length=0.5, area=1e-4, young=2.1e11, density=7850.0, far_end="fixed")
    >>> found = mass_on_rod(rod.mass, rod)
    >>> round(found.contact_time / (rod.return_time / 2.0), 3)  # 3.068 by St Venant
    3.068
    """
    if not 0.0 < mass < math.inf:
        raise ValueError(f"mass must be positive (kg), got {mass:g}")
    z, sign = target.impedance, -1.0 if target.far_end == "free" else 1.0
    if math.isinf(target.length):  # P falls as exp(-Z t / M) and never ends
        return RodImpact(0.0, math.inf, z)
    rate, period = z / mass, target.return_time * z / mass
    # times in M / Z, forces in Z: arriving wave and speed over exp(-t), from the last arrival on
    wave, speed = Polynomial([0.0]), Polynomial([1.0])
    now, peak = 0.0, 0.0
    for _ in range(MOST_WAVES):
        push = wave + speed
        peak = max([peak, float(push(0.0)), *_maxima(push, period)])
        if (end := _first_root(push, period)) is not None:
            now += end
            leaving = float(speed(end)) * math.exp(-end)
            break
        start = float(speed(period)) * math.exp(-period)
        wave = sign * (wave + 2.0 * speed)
        speed = start - wave.integ()
        now += period
    else:
        raise ValueError(f"mass must be at most {MOST_WAVES} times that of the rod, got {mass:g}")
    rebound = -leaving
    if target.far_end == "free":
        rebound += mass * (1.0 - leaving) / target.mass
    return RodImpact(rebound, now / rate, peak * z)


def _first_root(polynomial: Polynomial, end: float) -> float | None:
    """First time in (0, end] at which a polynomial is no longer positive."""
    found = np.asarray(polynomial.roots(), dtype=complex)
    real = found.real[np.abs(found.imag) < 1e-9 * (1.0 + np.abs(found))].tolist()
    inside = [each for each in real if 1e-12 * end < each <= end]
    if float(polynomial(0.0)) <= 0.0:
        return 0.0
    return min(inside, default=None)


def _maxima(polynomial: Polynomial, end: float) -> list[float]:
    """Local maxima of a polynomial times exp(-t) in (0, end)."""
    slope = polynomial.deriv() - polynomial
    places = [float(each.real) for each in slope.roots() if abs(each.imag) < 1e-9]
    return [float(polynomial(t)) * math.exp(-t) for t in places if 0.0 < t < end]
