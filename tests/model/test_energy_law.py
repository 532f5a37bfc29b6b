"""Orbits of a given energy against plain integrals over the way, and their law without losses."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from stochvi.model.energy_law import Well

WELLS = {
    "spring": Well(omega=1.3, load=0.0, lower=-math.inf, upper=math.inf),
    "spring between stops": Well(omega=1.3, load=0.4, lower=-0.8, upper=1.1),
    "spring pressed onto a stop": Well(omega=2.0, load=0.0, lower=0.5, upper=math.inf),
    "free between stops": Well(omega=0.0, load=0.0, lower=-0.5, upper=1.0),
    "thrown onto a stop": Well(omega=0.0, load=-2.0, lower=-1.0, upper=math.inf),
    "thrown between stops": Well(omega=0.0, load=3.0, lower=-1.0, upper=0.4),
}
ENERGIES = np.array([0.01, 0.3, 2.0, 15.0])


def potential(well: Well, x: float) -> float:
    return 0.5 * well.omega**2 * x * x - well.load * x


def turning_points(well: Well, total: float) -> tuple[float, float]:
    """Ends of the orbit with this value of v^2 / 2 + omega^2 x^2 / 2 - load x."""
    if well.omega:
        rest = well.load / well.omega**2
        swing = math.sqrt(2.0 * (total - potential(well, rest))) / well.omega
        ends = rest - swing, rest + swing
    elif well.load:
        turn = -total / well.load
        ends = (turn, math.inf) if well.load > 0.0 else (-math.inf, turn)
    else:
        ends = -math.inf, math.inf
    return max(ends[0], well.lower), min(ends[1], well.upper)


def over_a_cycle(well: Well, energy: float, power: int, of_speed: bool = False) -> float:
    """Integral of (x - place)^power dt, or of v^2 dt: twice the way between the ends."""
    total = potential(well, well.place) + energy
    low, high = turning_points(well, total)
    middle, half = (low + high) / 2.0, (high - low) / 2.0

    def rate(angle: float) -> float:
        """x = middle + half sin(angle) takes the root out of 1 / v at the ends."""
        x = middle + half * math.sin(angle)
        v = math.sqrt(max(2.0 * (total - potential(well, x)), 0.0))
        if v == 0.0:
            return 0.0
        return 2.0 * half * math.cos(angle) * (v if of_speed else (x - well.place) ** power / v)

    edge = 0.5 * math.pi
    return float(quad(rate, -edge, edge, epsabs=1e-11, epsrel=1e-10, limit=400)[0])


@pytest.mark.parametrize("name", WELLS)
def test_what_a_cycle_holds_is_an_integral_over_its_way(name: str) -> None:
    well = WELLS[name]
    orbits = well.orbits(ENERGIES)
    for row, energy in enumerate(ENERGIES):
        scale = over_a_cycle(well, energy, 0) * math.sqrt(over_a_cycle(well, energy, 2))
        for power, found in enumerate((orbits.period, orbits.first, orbits.second)):
            expected = over_a_cycle(well, energy, power)
            assert found[row] == pytest.approx(expected, rel=1e-7, abs=1e-9 * scale), power
        action = over_a_cycle(well, energy, 0, of_speed=True)
        assert orbits.action[row] == pytest.approx(action, rel=1e-7)


@pytest.mark.parametrize("name", WELLS)
def test_the_period_is_the_slope_of_the_action(name: str) -> None:
    well, change = WELLS[name], 1e-5
    below, at, above = (
        well.orbits(ENERGIES * factor) for factor in (1.0 - change, 1.0, 1.0 + change)
    )
    slope = (above.action - below.action) / (2.0 * change * ENERGIES)
    assert slope == pytest.approx(at.period, rel=1e-4)


def test_a_spring_alone_has_one_period() -> None:
    well = WELLS["spring"]
    assert well.orbits(ENERGIES).period == pytest.approx(2.0 * math.pi / well.omega, rel=1e-12)
