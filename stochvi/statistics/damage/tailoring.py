"""A random test that does the fatigue damage of a mission in a duration of its own.

A density whose rms is larger by the factor g does g^b times the damage per second, with the
exponent b of fatigue. A test that takes T in place of the mission M thus has

    g = (M / T)^(1 / b)

times the rms (the relation of MIL-STD-810H, method 514.8, annex A). Its profile is an envelope
with few breakpoints: straight in logarithms, and nowhere below the density of equal damage.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arguments import shown
from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.spectra import Table
from stochvi.statistics.damage.answer import Damage, TailoredTest
from stochvi.statistics.damage.equipment import Equipment
from stochvi.statistics.damage.equivalent import MARGIN, equivalent_values
from stochvi.statistics.damage.gaussian import GaussianEquipment

FEWEST_POINTS, MOST_POINTS = 2, 100
"""Smallest and largest number of breakpoints of a profile."""

PENALTIES, PRECISE = (1e-6, 1e3), 1.05
"""Range of the penalty of kinks, per unit of logarithms, and the precision to which it is found."""

STRAIGHT = 1e-6
"""Change of slope, relative to the largest one, up to which there is no kink."""


def check_test(duration: float | None, breakpoints: int) -> None:
    """Raise `ValueError` where no such test can be made."""
    if duration is not None and not 0.0 < duration < math.inf:
        raise ValueError(f"test_duration must be a positive number of seconds, got {duration}")
    if not FEWEST_POINTS <= breakpoints <= MOST_POINTS:
        raise ValueError(
            f"breakpoints must be in [{FEWEST_POINTS}, {MOST_POINTS}], got {shown(breakpoints)}"
        )


def tailored_test(found: Damage, duration: float, breakpoints: int) -> TailoredTest:
    """The test of a duration, s, that does the damage of a mission to its equipment."""
    f = found.equipment_frequency_hz
    equipment = Equipment(tuple(f.tolist()), found.quality, found.exponent)
    equal = equivalent_values(equipment, found.with_stops.fatigue_damage, duration)
    # as wide as the density whose damage is equal
    wide = np.concatenate([f[:1] / MARGIN, f, f[-1:] * MARGIN])
    table = envelope(wide, np.pad(equal.value, 1, mode="edge"), breakpoints)
    steady = GaussianEquipment(table, table.frequency_hz, equipment)
    wear, wear_error = steady.damage_rates()
    largest, _, _ = steady.extremes(duration, (0.5,))
    extremes = found.with_stops.extreme_response
    return TailoredTest(
        duration=duration,
        frequency_hz=table.frequency_hz,
        density=table.density,
        rms=math.sqrt(table.moment(0.0)),
        exaggeration=(found.mission / duration) ** (1.0 / found.exponent),
        equal_density=equal,
        damage_ratio=wear * duration / found.with_stops.fatigue_damage.value,
        damage_ratio_error=wear_error / wear,
        extreme_ratio=largest / extremes.value,
        extreme_ratio_error=extremes.standard_error / extremes.value,
    )


def envelope(frequency_hz: Vector, density: Vector, breakpoints: int) -> Table:
    """A table with at most so many breakpoints that is nowhere below a density at its frequencies.

    In logarithms x and y of frequency and density, z is at least y and minimises

        sum of w (z - y) + penalty * sum of |change of slope of z|

    with the share w of each value in the mean square. Such a z is straight but for few kinks (l1
    trend filtering: S.-J. Kim et al., SIAM Review 51, 2009, 339). The penalty is the smallest that
    leaves no more kinks than asked for; then the levels at the kinks are the lowest, without it.
    """
    if len(density) <= breakpoints:
        return Table(frequency_hz=frequency_hz, density=density)
    x, y = np.log(frequency_hz), np.log(density)
    square = np.exp(y + x - np.max(y + x)) * np.gradient(x)
    share = square / square.sum()
    kept = np.array([0, len(x) - 1])
    low, high = PENALTIES
    while high / low > PRECISE:
        penalty = math.sqrt(low * high)
        kinks = _kinks(x, y, share, penalty)
        if len(kinks) > breakpoints:
            low = penalty
        else:
            kept, high = kinks, penalty
    # each value of the lines as a mean of the levels of the breakpoints around it
    mean = np.array([np.interp(x, x[kept], row) for row in np.eye(len(kept))]).T
    level = _least(share @ mean, -mean, -y)
    return Table(frequency_hz=frequency_hz[kept], density=np.exp(level))


def _kinks(x: Vector, y: Vector, share: Vector, penalty: float) -> NDArray[np.int_]:
    """Numbers of the ends of z, and of the places where its slope changes."""
    from scipy.sparse import block_array, diags_array, eye_array

    count, width = len(x), np.diff(x)
    slopes: Any = diags_array([-1.0 / width, 1.0 / width], offsets=[0, 1], shape=(count - 1, count))
    bend: Any = diags_array([-1.0, 1.0], offsets=[0, 1], shape=(count - 2, count - 1)) @ slopes
    ones = eye_array(count - 2)
    blocks: Any = [[-eye_array(count), None], [bend, -ones], [-bend, -ones]]
    rows: Any = block_array(blocks)
    limits = np.concatenate([-y, np.zeros(2 * (count - 2))])
    cost = np.concatenate([share, np.full(count - 2, penalty)])
    z = _least(cost, rows, limits)[:count]
    kinked = np.abs(bend @ z) > STRAIGHT * max(float(np.max(np.abs(bend @ z))), STRAIGHT)
    return np.array([0, *(1 + np.flatnonzero(kinked)), count - 1])


def _least(cost: Vector, rows: Any, limits: Vector) -> Vector:
    """The variables of least cost with rows @ variables <= limits."""
    from scipy.optimize import linprog

    found: Any = linprog(cost, A_ub=rows, b_ub=limits, bounds=(None, None))
    return np.asarray(found.x)
