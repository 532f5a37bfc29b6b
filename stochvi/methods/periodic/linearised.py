"""Harmonic linearisation of rigid stops under a sine, by motion and by force."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import brentq

from stochvi.mathematics.arrays import Vector
from stochvi.methods.periodic.answer import Branch
from stochvi.methods.periodic.family import unmet
from stochvi.model.model import Model

SMALLEST, LARGEST = 1e-9, 1e4
"""With one stop, smallest and largest excess of the amplitude of a harmonic regime over the gap.
Its unit is the larger of the gap and the amplitude that the sine would give a mass without a
spring. With two stops, smallest and largest stiffness of the impacts in units of the squared
frequency."""

SAMPLES = 400
"""Number of amplitudes at which the balance of a regime is looked at for a change of its sign."""

EVEN = 1e-9
"""Largest difference of two gaps, relative to their sum, that counts as none."""

FORMS = ("exact", "motion", "force")
"""How periodic regimes are found: exactly, or by harmonic linearisation."""


@dataclass(frozen=True)
class Harmonic:
    """One oscillator between rigid stops under one sine, per unit mass.

    Parameters
    ----------
    omega, damping_rate
        Natural frequency (rad/s) and b (1/s).
    peak, frequency
        a_p, m/s^2, and w, rad/s.
    gap
        Distance of the stops from the position of rest under the load, m; below 0 for a preload.
    restitution
        R of the stops.
    both_sides
        Whether there are two stops, evenly about the position of rest.
    """

    omega: float
    damping_rate: float
    peak: float
    frequency: float
    gap: float
    restitution: float
    both_sides: bool

    @property
    def impact_damping(self) -> float:
        """beta, 1/s, of the loss at speeds w a_x: (1 - R^2) w / 2 pi of one stop (B 7.61), twice
        that of two (B 7.62)."""
        share = 1.0 if self.both_sides else 0.5
        return share * (1.0 - self.restitution**2) * self.frequency / math.pi

    def balance(self, amplitude: float, stiffness: float) -> float:
        """Force that an amplitude needs, less the force that acts (B 9.13)."""
        w = self.frequency
        loss = (self.damping_rate + self.impact_damping) * w
        return amplitude * math.hypot(stiffness - w**2, loss) - self.peak

    @property
    def boundary(self) -> float:
        """Amplitude a_p / ((b + beta) w) that no regime exceeds (B 9.15), m.

        Stops only add stiffness, so that below resonance it does not vanish, and the amplitude is
        a_p / |omega^2 - w^2 + i (b + beta) w|.
        """
        loss = (self.damping_rate + self.impact_damping) * self.frequency
        stiffness = max(self.omega**2 - self.frequency**2, 0.0)
        return self.peak / math.hypot(stiffness, loss) if stiffness or loss else math.inf


class Law(Protocol):
    """Amplitude (m) and total stiffness (1/s^2) of a regime, by a number that grows from 0."""

    def __call__(self, case: Harmonic, s: float) -> tuple[float, float]: ...


def by_motion(case: Harmonic, s: float) -> tuple[float, float]:
    """Linearisation by motion: the largest displacement of x = m_x + a_x cos reaches the stop.

    One stop: omega_0^2 = omega^2 (3 - 2 gap / a_x) (B 9.19), so that it is sqrt(3) omega without a
    gap (B 9.21). Two stops: a_x is the gap, whatever the stiffness.

    >>> flush = Harmonic(1.0, 0.0, 1.0, 1.5, 0.0, 1.0, False)
    >>> round(math.sqrt(by_motion(flush, 1.0)[1]), 3)
    1.732
    """
    if case.both_sides:
        return case.gap, case.omega**2 + s * case.frequency**2
    amplitude = max(case.gap, 0.0) + s * _unit(case)
    return amplitude, case.omega**2 * (3.0 - 2.0 * case.gap / amplitude)


def by_force(case: Harmonic, s: float) -> tuple[float, float]:
    """Linearisation by force: x of the spring and the stops as a function of F = m_F + a_F cos.

    One stop: q = (1/2 + (asin u + u sqrt(1 - u^2)) / pi) / omega^2, u = omega^2 gap / a_F
    (B 7.87), so that omega_0 is sqrt(2) omega without a gap (B 9.36). Two stops: a_x / gap =
    4 / pi - (omega / omega_0)^2 (4 / pi - 1) (B 9.39).

    >>> flush = Harmonic(1.0, 0.0, 1.0, 1.5, 0.0, 1.0, False)
    >>> round(math.sqrt(by_force(flush, 1.0)[1]), 3)
    1.414
    """
    c = case.omega**2
    if case.both_sides:
        stiffness = c + s * case.frequency**2
        return case.gap * (4.0 / math.pi - c / stiffness * (4.0 / math.pi - 1.0)), stiffness
    force = c * (abs(case.gap) + s * _unit(case))
    u = c * case.gap / force
    compliance = (0.5 + (math.asin(u) + u * math.sqrt(1.0 - u * u)) / math.pi) / c
    return compliance * force, 1.0 / compliance


LAWS: dict[str, Law] = {"motion": by_motion, "force": by_force}


def _unit(case: Harmonic) -> float:
    return max(case.peak / case.frequency**2, abs(case.gap))


def regimes(case: Harmonic, form: str) -> Iterator[tuple[float, bool]]:
    """Amplitude (m) of each regime with impacts, and whether it is stable.

    A regime is stable where a larger amplitude needs a larger force than the one that acts; between
    two stops, where a larger stiffness does (B 10.8).
    """
    law = LAWS[form]

    def balance(s: float) -> float:
        return case.balance(*law(case, s))

    places = np.geomspace(SMALLEST, LARGEST, SAMPLES)
    values = [balance(float(s)) for s in places]
    for low, high, before, after in zip(places, places[1:], values, values[1:], strict=False):
        if before * after < 0.0:
            s = float(brentq(balance, low, high, xtol=1e-15, rtol=1e-13))
            yield law(case, s)[0], after > 0.0


def not_covered(model: Model) -> list[str]:
    """The conditions of harmonic linearisation that a model does not meet, in sentences."""
    found = unmet(model)
    if not model.single or not model.pairs:
        found.append(
            "structure.kind must be 'oscillator' or 'isolator' with one impact pair, got "
            f"{len(model.coordinates)} coordinates and {len(model.pairs)} impact pairs"
        )
    if len(model.sines) > 1:
        found.append(f"the scene must have one sine, got {len(model.sines)}")
    if found:
        return found
    if not model.omega:
        found.append("structure.stiffness must be above 0, got 0")
    elif model.lower is not None and model.upper is not None:
        gaps = [_gap(model, side) for side in (-1, 1)]
        if gaps[0] + gaps[1] <= 0.0 or abs(gaps[1] - gaps[0]) > EVEN * (gaps[0] + gaps[1]):
            found.append(
                "two stops must lie evenly about the position of rest, got gaps of "
                f"{gaps[0]:g} and {gaps[1]:g} m"
            )
        if model.lower.coefficient != model.upper.coefficient:
            found.append(
                f"law.coefficient must be the same at both stops, got {model.lower.coefficient:g} "
                f"and {model.upper.coefficient:g}"
            )
    return found


def _gap(model: Model, side: int) -> float:
    stop = model.upper if side > 0 else model.lower
    assert stop is not None
    return stop.distance - side * model.rest


def case_of(model: Model) -> Harmonic:
    """The oscillator of a model that is covered."""
    (sine,) = model.sines
    stops = model.stops_per_unit_mass
    coefficient = stops[0].coefficient
    assert coefficient is not None
    return Harmonic(
        omega=model.omega,
        damping_rate=model.damping_rate,
        peak=sine.amplitude * abs(float(sine.direction[0])) / model.unit_mass,
        frequency=sine.omega,
        gap=_gap(model, stops[-1].side),
        restitution=coefficient,
        both_sides=len(stops) == 2,
    )


def linearised(model_at: Callable[[float], Model], values: Vector, form: str) -> tuple[Branch, ...]:
    """The branches of harmonic regimes: one of the stable ones, and one of the unstable ones."""
    found: dict[tuple[bool, int], list[tuple[float, Harmonic, float, Model]]] = {}
    for value in values:
        model = model_at(float(value))
        case = case_of(model)
        counts = {True: 0, False: 0}
        for amplitude, stable in regimes(case, form):
            found.setdefault((stable, counts[stable]), []).append(
                (float(value), case, amplitude, model)
            )
            counts[stable] += 1
    return tuple(
        _branch(rows, form, stable) for (stable, _), rows in sorted(found.items(), reverse=True)
    )


def _branch(
    rows: Sequence[tuple[float, Harmonic, float, Model]], form: str, stable: bool
) -> Branch:
    cases = [case for _, case, _, _ in rows]
    amplitude = np.array([each for _, _, each, _ in rows])
    frequency = np.array([case.frequency for case in cases])
    (pair,) = rows[0][3].pairs
    stops = tuple(f"{pair.name} {stop.name}" for stop in pair.stops)
    unknown = np.full((len(rows), len(stops)), np.nan)
    springs = np.array([math.hypot(c.omega**2, c.damping_rate * c.frequency) for c in cases])
    based = rows[0][3].sines[0].on_base
    return Branch(
        form=form,
        stops=stops,
        sticking=(),
        periods=1,
        value=np.array([value for value, _, _, _ in rows]),
        frequency_hz=frequency / (2.0 * math.pi),
        displacement_max=np.array([_largest(*row[1:], form) for row in rows]),
        amplitude=amplitude,
        acceleration_max=amplitude * (springs if based else frequency**2),
        phase=unknown,
        displacement=unknown[:, :1],
        velocity=unknown[:, :1],
        impact_speed=np.repeat((frequency * amplitude)[:, None], len(stops), axis=1),
        multiplier=unknown[:, 0],
        stable=np.full(len(rows), stable),
        admissible=np.ones(len(rows), bool),
        names=("",) * len(rows),
    )


def _largest(case: Harmonic, amplitude: float, model: Model, form: str) -> float:
    """Largest displacement from the unloaded position, by the middle of the harmonic motion."""
    if case.both_sides:
        return amplitude + abs(model.rest)
    # the motion turns at the stop; its other end lies two amplitudes away
    (stop,) = model.stops_per_unit_mass
    return max(abs(stop.distance), abs(2.0 * amplitude - stop.distance))
