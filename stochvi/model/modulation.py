"""Whether a structure whose springs and dampers are modulated comes to rest without its stops."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from stochvi.mathematics.arrays import Matrix
from stochvi.mathematics.moment_growth import (
    Change,
    FilteredChange,
    SineChange,
    WhiteChange,
    moment_growth,
)
from stochvi.model.model import FunctionOfMotion, Model
from stochvi.scenes.modulated_force import ModulatedForce

STILL = 1e-9
"""Growth, relative to the fastest frequency, up to which it is a rounding error."""


def linear_system(model: Model) -> Matrix:
    """The matrix (2n, 2n) of displacements and velocities of the modes, 1/s, without modulations
    and stops."""
    modes, n = model.modal, model.modal.size
    return np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(modes.squares), -modes.damping]])


def change_of(model: Model, part: FunctionOfMotion) -> Change:
    """How a modulation changes `linear_system`."""
    modes, n, law = model.modal, model.modal.size, part.law
    assert isinstance(law, ModulatedForce)
    row, known = part.direction @ modes.shapes, law.modulation
    matrix = np.zeros((2 * n, 2 * n))
    matrix[n:, :n] = -law.stiffness * np.outer(row, row)
    matrix[n:, n:] = -law.damping * np.outer(row, row)
    if known.amplitude is not None:
        return SineChange(matrix, known.amplitude, known.omega)
    if known.filter is not None:
        return FilteredChange(matrix, *known.filter)
    return WhiteChange(matrix, part.white_modulation)


@lru_cache(maxsize=32)
def growth(model: Model, power: int) -> float | None:
    """Rate, 1/s, at which means (power 1) or mean squares (2) of the motion without stops grow in
    the long run, from the equations of the moments.

    None where they are not known: the structure has functions of the motion, a modulation is
    tabulated noise, or the equations are too many.
    """
    parts = model.modulations
    if len(parts) < len(model.functions) or any(part.sample is not None for part in parts):
        return None
    changes = [change_of(model, part) for part in parts]
    return moment_growth(linear_system(model), changes, power)


def unstable(model: Model) -> list[str]:
    """The sentence that the mean squares of a modulated structure without stops have no end; empty
    where they have."""
    if not model.modulations or model.stops:
        return []
    if not model.shaken:
        return [
            "excitation must contain noise or a sine that shakes where no stop limits the motion, "
            "got a modulation alone; stability says whether it grows"
        ]
    found = growth(model, 2)
    if found is None or found < -STILL * model.modal.fastest:
        return []
    return [
        "mean squares must be finite where no stop limits the motion, got a modulation by which "
        f"they grow at {found:.3g} 1/s; add damping, modulate less or add stops"
    ]


Settling = Callable[[Model, float], float]
"""Longest relaxation time of a variance, s, of a model with its modulations, from that without."""

LONGEST = 20.0
"""Largest factor by which modulations lengthen the relaxation time of a structure with stops."""


def slowest_of(model: Model, slowest: float) -> float:
    """Longest relaxation time of a variance, s, with the modulations of a model.

    Parameters
    ----------
    model
        A model with a stationary state.
    slowest
        That time without modulations, s.
    """
    found = growth(model, 2) if model.modulations else None
    if not found:
        return slowest
    with_modulations = 1.0 / abs(found)
    longest = LONGEST * slowest if model.stops else with_modulations
    return max(slowest, min(with_modulations, longest))


def heavy_tails(model: Model) -> list[str]:
    """A warning where the fourth moments of a modulated structure without stops have no end."""
    if not model.modulations or model.stops or unstable(model):
        return []
    found = growth(model, 4)
    if found is None or found < -STILL * model.modal.fastest:
        return []
    return [
        "the modulation lets fourth moments grow without end: rare large motions make the errors "
        "of mean squares too small; add damping or stops, or trust the means alone"
    ]
