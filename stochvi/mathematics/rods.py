"""Bars, beams and rods from exact solutions. Chapters: natural modes and static compliance; impacts
of rods by their waves."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import scipy
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from stochvi.mathematics.numerics import Matrix, Vector, gauss_panels
from stochvi.mathematics.units import checked

# ------------------------------------------------------------------------------
# Natural modes and static compliance of uniform bars and beams, from their exact solutions.
#
# Lengths are in units of the length L, and x runs from 0 to 1. A beam of Timoshenko has
#
#     (w'' - psi') / s^2 + B w = 0,    psi'' + (w' - psi) / s^2 + r^2 B psi = 0,    B = beta^4
#
# with beta^4 = density area omega^2 L^4 / EI, r^2 = I / (area L^2) and s^2 = EI / (shear stiffness
# L^2); r = s = 0 is a beam of Euler and Bernoulli, w'''' = B w (Timoshenko, Vibration Problems in
# Engineering, chapter 5). Below the frequency at which r^2 s^2 B = 1 its solutions are sines of the
# wave number a and exponentials of the rate b. No large numbers cancel in them.
# ------------------------------------------------------------------------------


FIRST_WAVE_NUMBER = 0.01
"""Smallest wave number a, in units of 1 / L, that is looked at: that of a beam with 3e8 times its
own mass at its tip."""

WAVE_STEP = 0.1
"""Step of the wave number in which roots are bracketed; two of them are about pi apart."""

PANELS_PER_WAVE = 2.0
"""Panels of 16 Gauss points per half wave in integrals of squared shapes."""


class Shape(NamedTuple):
    """A mode: its parameter (`beta`, or the wave number of a bar) and its shape.

    `square` is the integral over x of shape^2 + r^2 psi^2, `mean` that of the shape.
    """

    parameter: float
    at: Callable[[ArrayLike], Vector]
    square: float
    mean: float


class Waves(NamedTuple):
    """The four solutions of a beam at one frequency, and what ends ask of them."""

    wave: float
    rate: float
    beta4: float
    rotary: float
    shear: float

    def rows(self, x: ArrayLike) -> Matrix:
        """Deflection, rotation, moment psi' and shear force of each solution, (4, 4, points)."""
        place = np.asarray(x, dtype=float)
        a, b = self.wave, self.rate
        ga = (a**2 - self.shear * self.beta4) / a
        gb = (b**2 + self.shear * self.beta4) / b
        sine, cosine = np.sin(a * place), np.cos(a * place)
        left, right = np.exp(-b * place), np.exp(-b * (1.0 - place))
        turned = np.array([ga * cosine, -ga * sine, -gb * left, gb * right])
        bent = np.array([-ga * a * sine, -ga * a * cosine, gb * b * left, gb * b * right])
        pull = np.array(
            [a**2 - self.rotary * self.beta4] * 2 + [-(b**2) - self.rotary * self.beta4] * 2
        )
        sheared = pull.reshape(4, *[1] * place.ndim) * turned
        return np.array([[sine, cosine, left, right], turned, bent, sheared])


def waves_at(wave: float, rotary: float, shear: float) -> Waves:
    """The solutions at a wave number a; `rotary` and `shear` are r^2 and s^2."""
    sum_, product = rotary + shear, rotary * shear
    q = 1.0 + sum_ * wave**2
    beta4 = 2.0 * wave**4 / (q + math.sqrt(max(q**2 - 4.0 * product * wave**4, 0.0)))
    half = 0.5 * sum_ * beta4
    kept = beta4 * max(1.0 - product * beta4, 0.0)
    rate = math.sqrt(kept / (half + math.sqrt(half**2 + kept)))
    return Waves(wave, rate, beta4, rotary, shear)


SUPPORTS = {
    "cantilever": ("clamped", "tip"),
    "pinned": ("pinned", "pinned"),
    "clamped": ("clamped", "clamped"),
    "clamped-pinned": ("clamped", "pinned"),
    "free": ("free", "free"),
}
"""Ends of a beam by the name of its support."""

HELD = {"clamped": (0, 1), "pinned": (0, 2), "free": (2, 3), "tip": (2, 3)}
"""Rows of `Waves.rows` that vanish at an end; at a tip its mass and spring balance the shear."""


def beam_modes(
    support: str,
    *,
    enough: Callable[[list[Shape]], bool],
    rotary: float = 0.0,
    shear: float = 0.0,
    tip_mass: float = 0.0,
    tip_spring: float = 0.0,
) -> list[Shape]:
    """Bending modes of a uniform beam in rising order, rigid motions of a free one included.

    Parameters
    ----------
    support
        A key of `SUPPORTS`.
    enough
        Whether the modes so far suffice.
    rotary, shear
        r^2 and s^2; 0 for a beam of Euler and Bernoulli.
    tip_mass, tip_spring
        Mass at the tip of a cantilever in units of that of the beam, and spring in units of
        EI / L^3.

    Returns
    -------
    list of Shape
        The modes; fewer than were wanted where r^2 s^2 beta^4 would exceed 1.

    Examples
    --------
    >>> found = beam_modes("cantilever", enough=lambda modes: len(modes) == 2)
    >>> [round(mode.parameter, 9) for mode in found]
    [1.875104069, 4.694091133]
    """
    first, last = (HELD[end] for end in SUPPORTS[support])
    found = list(_rigid_motions(rotary)) if support == "free" else []

    def conditions(waves: Waves) -> Matrix:
        start, end = waves.rows(0.0), waves.rows(1.0)
        rows = np.array([*start[list(first)], *end[list(last)]])
        if support == "cantilever":
            rows[3] -= (tip_mass * waves.beta4 - tip_spring) * end[0]
        return np.asarray(rows / np.abs(rows).max(axis=1, keepdims=True))

    def determinant(wave: float) -> float:
        return float(np.linalg.det(conditions(waves_at(wave, rotary, shear))))

    most = math.sqrt(1.0 / rotary + 1.0 / shear) if rotary and shear else math.inf
    here, value = FIRST_WAVE_NUMBER, determinant(FIRST_WAVE_NUMBER)
    while not enough(found) and here + WAVE_STEP < most:
        there = here + WAVE_STEP
        new = determinant(there)
        if new * value < 0.0:
            wave = scipy.optimize.brentq(determinant, here, there, xtol=1e-15 * there, rtol=8.9e-16)
            waves = waves_at(float(wave), rotary, shear)
            parts = np.linalg.svd(conditions(waves))[2][-1]
            found.append(_shape(waves, parts, support, tip_mass))
        here, value = there, new
    return found


def _shape(waves: Waves, parts: Vector, support: str, tip_mass: float) -> Shape:
    """A mode as a sum of solutions, largest deflection 1; at the tip of a cantilever 1."""
    parts = parts / _largest(waves, parts, support)
    edges = np.linspace(0.0, 1.0, 2 + int(PANELS_PER_WAVE * (waves.wave + waves.rate) / math.pi))
    nodes, weights = gauss_panels(edges, 16)
    w, psi = parts @ waves.rows(nodes)[0], parts @ waves.rows(nodes)[1]
    tip = float(parts @ waves.rows(1.0)[0])
    return Shape(
        parameter=waves.beta4**0.25,
        at=lambda x: np.asarray(parts @ waves.rows(x)[0].reshape(4, -1)).reshape(np.shape(x)),
        square=float(weights @ (w**2 + waves.rotary * psi**2)) + tip_mass * tip**2,
        mean=float(weights @ w) + tip_mass * tip,
    )


def _largest(waves: Waves, parts: Vector, support: str) -> float:
    """Largest deflection of a mode; that of the tip of a cantilever."""
    if support == "cantilever":
        return float(parts @ waves.rows(1.0)[0])
    grid = np.linspace(0.0, 1.0, 201 + int(40.0 * waves.wave))
    deflection = parts @ waves.rows(grid)[0]
    top = int(np.argmax(np.abs(deflection)))
    if top in (0, len(grid) - 1):
        return float(deflection[top])
    sign = math.copysign(1.0, deflection[top])
    found = scipy.optimize.minimize_scalar(
        lambda x: -sign * float(parts @ waves.rows(x)[0]), method="bounded",
        bounds=(grid[top - 1], grid[top + 1]), options={"xatol": 1e-9},
    )  # fmt: skip
    return -sign * float(found.fun)


def _rigid_motions(rotary: float) -> tuple[Shape, Shape]:
    """Translation and rotation of a free beam."""
    return (
        Shape(0.0, lambda x: np.ones(np.shape(x)), 1.0, 1.0),
        Shape(0.0, lambda x: 2.0 * np.asarray(x, dtype=float) - 1.0, 1.0 / 3.0 + 4.0 * rotary, 0.0),
    )


def beam_compliance(
    support: str, x: float, y: float, *, shear: float = 0.0, tip_spring: float = 0.0
) -> float:
    """Static deflection at x per unit force at y, in units of L^3 / EI; 0 for a free beam.

    A beam that is clamped at 0 is a cantilever. A force holds its other end, and a moment too where
    that end is clamped.

    Examples
    --------
    >>> beam_compliance("cantilever", 1.0, 1.0), round(48 * beam_compliance("pinned", 0.5, 0.5), 12)
    (0.3333333333333333, 1.0)
    """
    x, y = min(x, y), max(x, y)
    if support == "free":
        return 0.0
    if support == "pinned":
        return x * (1.0 - y) * (1.0 - x**2 - (1.0 - y) ** 2) / 6.0 + shear * x * (1.0 - y)

    def clamped(one: float, two: float) -> float:
        return one**2 * (3.0 * two - one) / 6.0 + shear * one

    held = np.array([[clamped(1.0, 1.0), 0.5], [0.5, 1.0]])
    if support == "cantilever":
        held = held[:1, :1] + (1.0 / tip_spring if tip_spring else math.inf)
    if support == "clamped-pinned":
        held = held[:1, :1]
    count = len(held)
    one, two = (np.array([clamped(place, 1.0), 0.5 * place**2])[:count] for place in (x, y))
    back = 0.0 if not np.all(np.isfinite(held)) else float(one @ np.linalg.solve(held, two))
    return clamped(x, y) - back


def bar_modes(
    support: str,
    *,
    enough: Callable[[list[Shape]], bool],
    tip_mass: float = 0.0,
    tip_spring: float = 0.0,
) -> list[Shape]:
    """Longitudinal modes of a uniform bar, whose parameter is z = omega L / c, c the wave speed.

    The unit of the tip mass is the mass of the bar, and that of its spring EA / L.

    A bar that is fixed at 0 has z cos z = (tip_mass z^2 - tip_spring) sin z.

    Parameters
    ----------
    support
        "cantilever", "clamped" or "free".
    enough
        Whether the modes so far suffice.
    tip_mass, tip_spring
        At the tip of a cantilever.

    Examples
    --------
    >>> found = bar_modes("cantilever", enough=lambda modes: len(modes) == 2, tip_spring=2.0)
    >>> [round(mode.parameter, 5) for mode in found]
    [2.28893, 5.08699]
    """
    found: list[Shape] = []
    if support == "free":
        found.append(_rigid_motions(0.0)[0])

    def balance(z: float) -> float:
        return z * math.cos(z) - (tip_mass * z**2 - tip_spring) * math.sin(z)

    number = 0
    while not enough(found):
        number += 1
        if support == "cantilever":
            low, high = (number - 1) * math.pi + 1e-9, number * math.pi
            z = float(scipy.optimize.brentq(balance, low, high, xtol=1e-15, rtol=8.9e-16))
            largest = math.sin(z) if abs(math.sin(z)) > 1e-9 else 1.0
            square = 0.5 - math.sin(2.0 * z) / (4.0 * z) + tip_mass * math.sin(z) ** 2
            mean = (1.0 - math.cos(z)) / z + tip_mass * math.sin(z)
            found.append(Shape(z, _wave(math.sin, z, largest), square / largest**2, mean / largest))
        elif support == "clamped":
            z = number * math.pi
            found.append(Shape(z, _wave(math.sin, z, 1.0), 0.5, (1.0 - math.cos(z)) / z))
        else:
            z = number * math.pi
            found.append(Shape(z, _wave(math.cos, z, 1.0), 0.5, 0.0))
    return found


def _wave(
    form: Callable[[float], float], z: float, largest: float
) -> Callable[[ArrayLike], Vector]:
    wave = np.sin if form is math.sin else np.cos
    return lambda x: np.asarray(wave(z * np.asarray(x, dtype=float)) / largest)


def bar_compliance(support: str, x: float, y: float, *, tip_spring: float = 0.0) -> float:
    """Static displacement at x per unit force at y, in units of L / EA; 0 for a free bar.

    Examples
    --------
    >>> bar_compliance("cantilever", 0.5, 1.0), bar_compliance("clamped", 0.5, 0.5)
    (0.5, 0.25)
    """
    if support == "free":
        return 0.0
    held = 1.0 if support == "clamped" else tip_spring / (1.0 + tip_spring)
    return min(x, y) - held * x * y


# ------------------------------------------------------------------------------
# Impacts of rods by their waves (St Venant; Timoshenko and Goodier, Theory of Elasticity, sections
# 168 and 169; B 1.1 to 1.27).
#
# A rod of cross-section A, Young's modulus E and density rho has the wave speed c = sqrt(E / rho)
# and the impedance Z = A sqrt(E rho): a wave that moves its particles at the speed v carries the
# force Z v. What arrives at the face of a rod is F = Z v there, and what leaves it follows from the
# contact force P and the speed of the face.
# ------------------------------------------------------------------------------


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
