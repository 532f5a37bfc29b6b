"""Excitation of an isolator and its motion without stops, as numbers for a report."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.spectra import Table, squared_gain
from stochvi.mathematics.units import density_from_intensity
from stochvi.model.model import Model, model_of
from stochvi.scenes.scene import Scene

POINTS = 801
"""Number of frequencies of a curve over the whole input; those around the resonance are extra."""

RESONANCE_POINTS, RESONANCE_WIDTHS = 121, 3.0
"""Number of extra frequencies around the resonance, and how many half-power bandwidths they reach
to each side of it."""

WHITE_BAND = (0.05, 20.0)
"""Lowest and highest frequency, over the natural frequency, at which the response to white noise is
evaluated: outside of them lies less than 1 % of the mean square of a usual mount."""


@dataclass(frozen=True, kw_only=True)
class BaseMotion:
    """Motion of a base with a tabulated density: m/s^2, m/s and m rms.

    Velocity and displacement are those of the table alone, so the displacement depends on the
    lowest frequencies of the table.
    """

    acceleration_std: float
    velocity_std: float
    displacement_std: float


@dataclass(frozen=True, kw_only=True)
class Environment:
    """The excitation of an isolator and its transmission without stops, as numbers.

    Parameters
    ----------
    excitations
        Numbers of each excitation of the scene, in its order: what the scene file states in other
        units, or leaves to a profile or a file (SI units).
    base
        Motion of the base; None unless its acceleration is tabulated.
    spectra
        One row per frequency: `frequency_hz`, `base_density` ((m/s^2)^2/Hz, one-sided),
        `transmissibility` (absolute acceleration over that of the base, no stops) and the shares of
        the mean squares below the frequency, `displacement_share`, `velocity_share` and
        `acceleration_share`. None unless noise moves the base and nothing else shakes the mass.
    breakpoints
        `frequency_hz` and `base_density` of the table where the base has exactly one; else None.
    """

    excitations: tuple[Mapping[str, float], ...]
    base: BaseMotion | None
    spectra: pd.DataFrame | None
    breakpoints: pd.DataFrame | None

    def to_dict(self) -> dict[str, Any]:
        """The JSON document; the spectra are columns."""
        return {
            "excitations": [dict(numbers) for numbers in self.excitations],
            "base": None if self.base is None else asdict(self.base),
            "spectra": columns_of(self.spectra),
            "breakpoints": columns_of(self.breakpoints),
        }


def columns_of(frame: pd.DataFrame | None) -> dict[str, list[Any]] | None:
    """The columns of a table as plain lists, for JSON."""
    return None if frame is None else {str(name): frame[name].tolist() for name in frame}


def environment(scene: Scene) -> Environment:
    """Describe what shakes an isolator and what its mount passes on without stops.

    Examples
    --------
    >>> from stochvi.scenes.excitations import TabulatedNoise
    >>> from stochvi.scenes.structures import Isolator
    >>> truck = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    >>> mount = Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[truck])
    >>> round(1e3 * environment(mount).base.displacement_std, 2)
    1.57
    """
    model = model_of(scene)
    tables, noisy = model.acceleration_tables, noise_on_base_alone(model)
    breakpoints = None
    if noisy and len(tables) == 1:
        breakpoints = pd.DataFrame(
            {"frequency_hz": tables[0].frequency_hz, "base_density": tables[0].density}
        )
    return Environment(
        excitations=tuple(excitation.numbers() for excitation in scene.excitations),
        base=_base_motion(tables) if noisy and tables and not model.intensity else None,
        spectra=_spectra(model) if noisy else None,
        breakpoints=breakpoints,
    )


def noise_on_base_alone(model: Model) -> bool:
    """Whether white or tabulated noise moves the base, and no noise or sine acts on the mass."""
    noisy = bool(model.acceleration_tables or model.intensity)
    return noisy and model.moving_base and not model.noise_on_mass


def _base_motion(tables: Sequence[Table]) -> BaseMotion:
    area = sum(table.mean_square() for table in tables)
    per = (2.0 * math.pi) ** 2
    velocity = sum(table.moment(-2.0) for table in tables) / per
    shift = sum(table.moment(-4.0) for table in tables) / per**2
    return BaseMotion(
        acceleration_std=math.sqrt(area),
        velocity_std=math.sqrt(velocity),
        displacement_std=math.sqrt(shift),
    )


def _spectra(model: Model) -> pd.DataFrame:
    f = frequencies(model)
    base = input_density(model, f)
    passed = transmissibility(model, f)
    displacement = squared_gain(f, model.omega, model.damping_rate) * base
    return pd.DataFrame(
        {
            "frequency_hz": f,
            "base_density": base,
            "transmissibility": passed,
            "displacement_share": _share_below(f, displacement),
            "velocity_share": _share_below(f, (2.0 * np.pi * f) ** 2 * displacement),
            "acceleration_share": _share_below(f, passed**2 * base),
        }
    )


def _share_below(f: Vector, density: Vector) -> Vector:
    """Share of the area of a density below each frequency, by the trapezoidal rule."""
    areas = np.concatenate([[0.0], np.cumsum(np.diff(f) * (density[1:] + density[:-1]) / 2.0)])
    return np.asarray(areas / areas[-1])


def frequencies(model: Model) -> Vector:
    """A grid over the input and the resonance, Hz."""
    natural = model.omega / (2.0 * math.pi)
    low = min([float(table.frequency_hz[0]) for table in model.acceleration_tables], default=0.0)
    high = max([float(table.frequency_hz[-1]) for table in model.acceleration_tables], default=0.0)
    if model.intensity or not model.acceleration_tables:
        low, high = WHITE_BAND[0] * natural, max(high, WHITE_BAND[1] * natural)
    widths = np.linspace(-RESONANCE_WIDTHS, RESONANCE_WIDTHS, RESONANCE_POINTS)
    near = natural + model.damping_rate / math.pi * widths
    edges = [table.frequency_hz for table in model.acceleration_tables]
    grid = np.concatenate([np.geomspace(low, high, POINTS), near, *edges])
    return np.unique(grid[(grid >= low) & (grid <= high)])


def input_density(model: Model, frequency_hz: Vector) -> Vector:
    """One-sided density of the base acceleration, (m/s^2)^2/Hz."""
    total = np.full_like(frequency_hz, density_from_intensity(model.intensity))
    for table in model.acceleration_tables:
        total = total + table(frequency_hz)
    return total


def transmissibility(model: Model, frequency_hz: Vector) -> Vector:
    """Absolute acceleration over base acceleration, sqrt(omega^4 + b^2 w^2) |H|."""
    w2 = (2.0 * np.pi * frequency_hz) ** 2
    gain = squared_gain(frequency_hz, model.omega, model.damping_rate)
    return np.asarray(np.sqrt((model.omega**4 + model.damping_rate**2 * w2) * gain))
