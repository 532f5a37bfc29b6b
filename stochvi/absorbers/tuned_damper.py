"""The damper that an absorber competes with: the same mass on a tuned spring and dashpot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from stochvi.mathematics.arguments import shown
from stochvi.mathematics.arrays import Vector
from stochvi.model.calculations import calculation
from stochvi.model.modal import linear_law
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable
from stochvi.scenes.excitations import BASE, Sine
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Matrices

NO_STOPS = (
    "the structure must have no stops of its own beside an absorber, got impact_pair; leave it out"
)
"""Condition of every calculation of an absorber."""

UNSTEADY = (
    "the structure must have a stationary state without the absorber; give each coordinate "
    "stiffness and damping"
)
"""Condition of every comparison with the structure alone."""

NAME = "tuned damper"
"""Name of the coordinate of the damper's mass."""

TOLERANCE = 1e-4
"""Relative accuracy of the frequency and the damping ratio of the best damper, and of the rms
displacement that it leaves."""

OTHER_FREQUENCY = 0.2
"""Logarithm of the frequency of the motion over that of Warburton's tuning from which the search
for the best damper begins at both."""


@dataclass(frozen=True, kw_only=True)
class TunedDamper:
    """A mass on a linear spring and dashpot, tuned to calm what carries it (SI units).

    Parameters
    ----------
    mass, stiffness, damping
        kg, N/m and N s/m.
    frequency_hz, zeta
        Natural frequency and damping ratio of the damper on a carrier at rest.
    ratio
        rms displacement of the carrier with the damper over that without, exactly; the same at
        every level of the excitation.
    displacement_std
        rms displacement of the carrier, m.
    stroke_std
        rms displacement of the damper's mass relative to the carrier, m: the room it needs.
    tuning
        What it is tuned for: "least rms displacement" or "Den Hartog". It names the number of
        trials where the search did not end.

    See Also
    --------
    stochvi.absorber : The answer that holds it.
    """

    mass: float
    stiffness: float
    damping: float
    frequency_hz: float
    zeta: float
    ratio: float
    displacement_std: float
    stroke_std: float
    tuning: str


def white_noise_tuning(mass_ratio: float, moving_base: bool) -> tuple[float, float]:
    """Frequency ratio and damping ratio of least rms displacement under white noise.

    For a carrier without damping (Warburton 1982): under a force f^2 = (1 + m / 2) / (1 + m)^2 and
    zeta^2 = m (1 + 3 m / 4) / (4 (1 + m) (1 + m / 2)); on a moving base f^2 = (1 - m / 2) /
    (1 + m)^2 and zeta^2 = m (1 - m / 4) / (4 (1 + m) (1 - m / 2)).

    Parameters
    ----------
    mass_ratio
        m, mass of the damper over that of the carrier; on a moving base below 2.
    moving_base
        Whether the base is shaken, and not the carrier.

    Returns
    -------
    tuple of float
        Natural frequency of the damper over that of the carrier, and its damping ratio.

    Examples
    --------
    >>> f, zeta = white_noise_tuning(0.05, moving_base=False)
    >>> round(f, 4), round(zeta, 4)
    (0.9642, 0.1098)
    """
    sign = -1.0 if moving_base else 1.0
    half = 1.0 + sign * mass_ratio / 2.0
    quarter = 1.0 + (-0.25 if moving_base else 0.75) * mass_ratio
    frequency = math.sqrt(half) / (1.0 + mass_ratio)
    return frequency, math.sqrt(mass_ratio * quarter / (4.0 * (1.0 + mass_ratio) * half))


def den_hartog_tuning(mass_ratio: float) -> tuple[float, float]:
    """Frequency ratio and damping ratio with the lowest resonance peaks under a sine.

    f = 1 / (1 + m), zeta^2 = 3 m / (8 (1 + m)^3) for a carrier without damping (Den Hartog,
    Mechanical Vibrations, chapter 3).

    Examples
    --------
    >>> f, zeta = den_hartog_tuning(0.05)
    >>> round(f, 4), round(zeta, 4)
    (0.9524, 0.1273)
    """
    whole = 1.0 + mass_ratio
    return 1.0 / whole, math.sqrt(3.0 * mass_ratio / (8.0 * whole**3))


@calculation
def tuned_damper(structure: Scene, carrier: str, mass: float) -> TunedDamper | None:
    """The tuned damper of a mass on a structure without stops, under what shakes it.

    Under noise a search finds the damper with the least rms displacement of the carrier. It begins
    at Warburton's tuning for white noise and, where the motion has another frequency (as under a
    narrow band), also there. The rms values are exact. A sine alone would be cancelled by a damper
    without losses, which would fit no other frequency: under a sine the damper is therefore that of
    Den Hartog, for a structure of one coordinate.

    Parameters
    ----------
    structure
        A linear structure without an absorber and without stops.
    carrier
        The coordinate that carries the damper.
    mass
        Mass of the damper, kg.

    Returns
    -------
    TunedDamper or None
        None for several coordinates under a sine.

    Raises
    ------
    ValueError
        If the structure has no such coordinate, or the mass is not positive.
    NotApplicable
        If the structure has no stationary motion.

    See Also
    --------
    stochvi.absorber : The same mass in a box with play, beside this damper.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> tower = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.04)],
    ... )
    >>> round(tuned_damper(tower, "x", 0.05).ratio, 2)
    0.4
    """
    coordinates = structure.structure.coordinates
    if carrier not in coordinates:
        raise ValueError(
            f"carrier must be a coordinate of the structure ({', '.join(coordinates)}), got "
            f"{shown(carrier)}"
        )
    if not mass > 0.0:
        raise ValueError(f"mass must be positive, got {mass}")
    row = coordinates.index(carrier)
    carried, _, held = (float(matrix[row, row]) for matrix in structure.structure.matrices)
    rms, speed, _ = _motion(structure, row)
    mass_ratio = mass / carried
    # for several modes, the frequency of the one that moves the carrier most
    omega = math.sqrt(held / carried) if len(coordinates) == 1 else speed / rms

    def damped(frequency: float, zeta: float) -> Scene:
        stiffness = mass * (frequency * omega) ** 2
        return _with_damper(
            structure, row, mass, stiffness, 2.0 * zeta * math.sqrt(mass * stiffness)
        )

    if any(isinstance(each, Sine) for each in structure.excitations):
        if len(coordinates) > 1:
            return None
        tuning, (frequency, zeta) = "Den Hartog", den_hartog_tuning(mass_ratio)
    else:
        tuning = "least rms displacement"
        moving_base = all(structure.place(each) == BASE for each in structure.excitations)
        start = white_noise_tuning(min(mass_ratio, 1.0), moving_base)

        def left_over(logs: Vector) -> float:
            frequency, zeta = np.exp(logs).tolist()
            try:
                return math.log(_motion(damped(frequency, zeta), row)[0] / rms)
            except NotApplicable:  # a damper that loses next to nothing has no stationary motion
                return math.inf

        starts = [start]
        shaken = speed / rms / omega  # under a narrow band, its frequency over that of the carrier
        if abs(math.log(shaken / start[0])) > OTHER_FREQUENCY:
            starts.append((shaken, start[1]))
        searches = [
            minimize(
                left_over, np.log(np.array(each)), method="Nelder-Mead",
                options={"xatol": TOLERANCE, "fatol": TOLERANCE},
            )
            for each in starts
        ]  # fmt: skip
        found = min(searches, key=lambda search: float(search.fun))
        if not found.success:
            tuning = f"least rms displacement of {found.nfev} trials"
        frequency, zeta = np.exp(found.x).tolist()
    left, _, stroke = _motion(damped(frequency, zeta), row)
    stiffness = mass * (frequency * omega) ** 2
    return TunedDamper(
        mass=mass,
        stiffness=stiffness,
        damping=2.0 * zeta * math.sqrt(mass * stiffness),
        frequency_hz=frequency * omega / (2.0 * math.pi),
        zeta=zeta,
        ratio=left / rms,
        displacement_std=left,
        stroke_std=stroke,
        tuning=tuning,
    )


def _with_damper(
    structure: Scene, row: int, mass: float, stiffness: float, damping: float
) -> Scene:
    """The structure with a mass on a spring and a dashpot on the coordinate of this row."""
    names = structure.structure.coordinates
    matrices = structure.structure.matrices
    link = np.zeros(len(names) + 1)
    link[row], link[-1] = -1.0, 1.0
    whole = [np.pad(matrix, (0, 1)) for matrix in matrices]
    whole[0][-1, -1] = mass
    return Scene(
        structure=Matrices(
            coordinates=(*names, NAME),
            mass=whole[0],
            damping=whole[1] + damping * np.outer(link, link),
            stiffness=whole[2] + stiffness * np.outer(link, link),
        ),
        excitations=[
            each.model_copy(update={"on": structure.place(each)}) for each in structure.excitations
        ],
    )


def _motion(scene: Scene, row: int) -> tuple[float, float, float]:
    """rms displacement and velocity of a coordinate, and the rms displacement of the last
    coordinate relative to it; m, m/s, m."""
    modes = model_of(scene).modal
    law = linear_law(modes)
    if law is None:
        raise NotApplicable("absorber", [UNSTEADY])
    shape, relative = modes.shapes[row], modes.shapes[-1] - modes.shapes[row]
    return (
        math.sqrt(law.variances(shape, 0)),
        math.sqrt(law.variances(shape, modes.size)),
        math.sqrt(law.variances(relative, 0)),
    )
