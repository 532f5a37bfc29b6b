"""The density of a Gaussian acceleration that does a damage to equipment without stops."""

from __future__ import annotations

import math

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.spectra import Table
from stochvi.statistics.damage.answer import SpectrumValues
from stochvi.statistics.damage.equipment import Equipment
from stochvi.statistics.damage.gaussian import GaussianEquipment

ROUNDS, SAME = 60, 1e-3
"""Largest number of corrections of the equivalent density, and the relative difference of its
damage at which they end."""

MARGIN, LEAST_DENSITY = math.sqrt(2.0), 1e-12
"""The equivalent density is constant to this factor beyond its ends; it is no smaller than this
share of its largest value."""


def equivalent_density(equipment: Equipment, rate: Vector) -> tuple[Vector, Vector, Vector]:
    """One-sided density that does a damage per second without stops, at the frequencies of the
    equipment; the relative difference of its damage that is left; and the bound of the relative
    error of the formula for that damage.

    It begins with that of white noise with this damage, and is corrected by (D / D_now)^(2 / b).
    """
    f, b = np.array(equipment.frequency_hz), equipment.exponent
    narrow = f * 2.0 ** (0.5 * b) * math.gamma(1.0 + 0.5 * b)
    density = (rate / narrow) ** (2.0 / b) * 8.0 * math.pi * f / equipment.quality
    left = error = np.full(len(f), np.inf)
    for _ in range(ROUNDS):
        ends = np.concatenate([f[:1] / MARGIN, f, f[-1:] * MARGIN])
        table = Table(frequency_hz=ends, density=np.pad(density, 1, mode="edge"))
        now, error = GaussianEquipment(table, ends, equipment).damage_rates()
        left, error = np.abs(now / rate - 1.0), error / now
        if np.all(left < SAME):
            break
        density = np.maximum(density * (rate / now) ** (2.0 / b), LEAST_DENSITY * density.max())
    return density, left, error


def equivalent_values(
    equipment: Equipment, damage: SpectrumValues, duration: float
) -> SpectrumValues:
    """The density that does a damage in a duration (s) without stops, with its errors."""
    density, left, formula = equivalent_density(equipment, damage.value / duration)
    share = 2.0 / equipment.exponent
    relative = share * damage.standard_error / damage.value
    bias = share * (damage.bias / damage.value + left + formula)
    return SpectrumValues(value=density, standard_error=density * relative, bias=density * bias)
