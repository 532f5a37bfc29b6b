"""Change of the clearance of an isolator within its tolerances, by linear theory."""

from __future__ import annotations

import math

import pandas as pd

from stochvi.isolators.screening import Screening, screen
from stochvi.mathematics.units import power_ratio
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Isolator

FREQUENCY_TOLERANCE = 0.1
DAMPING_TOLERANCE = 0.3
"""Relative tolerance of the damping ratio where the isolator states none: usual for elastomers."""

LEVEL_DB = 3.0
"""Tolerance of the level, dB up and down: twice and half the density, usual for vibration tests."""


def within_tolerances(scene: Scene, clearance: float) -> pd.DataFrame:
    """Linear rms, and the clearance of an equal Rice rate, as frequency, damping and level move.

    With nu(c) = (s_v / (pi s_x)) exp(-c^2 / (2 s_x^2)) the hits per second on two stops at +-c
    (Rice), the row of a changed isolator holds the c at which nu is that of the isolator as it
    stands at `clearance`. The effect of impacts on the
    motion is left out on both sides.

    Parameters
    ----------
    scene
        An isolator on a noisy base; its tolerances, or `FREQUENCY_TOLERANCE` and
        `DAMPING_TOLERANCE`, say how far frequency and damping move (the other is kept).
    clearance
        Clearance per side from the mean position, m.

    Returns
    -------
    pandas.DataFrame
        `change` (in words), `sigma` (m), `clearance` (m, of equal Rice rate), `clearance_change`
        (relative) and `rice_rate` (1/s, both sides, at `clearance`).

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> mount = Scene(
    ...     structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[WhiteNoise(intensity=1.0)]
    ... )
    >>> within_tolerances(mount, 6e-3)["change"].tolist()[:3]
    ['none', 'natural frequency -10 %', 'natural frequency +10 %']
    """
    stated = screen(scene)
    level = math.sqrt(power_ratio(LEVEL_DB))
    rate = stated.rice_rate(clearance)
    rows = [("none", stated, 1.0)]
    rows += [(name, screen(changed), 1.0) for name, changed in _variants(scene)]
    rows += [(f"level {sign * LEVEL_DB:+g} dB", stated, level**sign) for sign in (-1, 1)]
    return pd.DataFrame(
        [
            {
                "change": name,
                "sigma": ratio * linear.displacement_std,
                "rice_rate": linear.rice_rate(clearance / ratio),
                "clearance": ratio * _clearance_of_rate(linear, rate),
                "clearance_change": ratio * _clearance_of_rate(linear, rate) / clearance - 1.0,
            }
            for name, linear, ratio in rows
        ]
    )


def _variants(scene: Scene) -> list[tuple[str, Scene]]:
    """The scenes with the isolator at the ends of its tolerances, and their names in words."""
    structure = scene.structure
    assert isinstance(structure, Isolator)
    frequency = structure.omega / (2.0 * math.pi)
    zeta = structure.damping_rate / (2.0 * structure.omega)
    tolerance = {
        "natural frequency": structure.frequency_tolerance or FREQUENCY_TOLERANCE,
        "damping ratio": structure.damping_tolerance or DAMPING_TOLERANCE,
    }
    found = []
    for name, part in tolerance.items():
        for sign in (-1.0, 1.0):
            factor = 1.0 + sign * part
            changed = Isolator(
                mass=structure.mass,
                frequency_hz=frequency * (factor if name == "natural frequency" else 1.0),
                zeta=zeta * (factor if name == "damping ratio" else 1.0),
            )
            words = f"{name} {100.0 * sign * part:+.3g} %"
            found.append((words, scene.model_copy(update={"structure": changed})))
    return found


def _clearance_of_rate(linear: Screening, rate: float) -> float:
    """Clearance at which two stops are hit at this rate by Rice; 0 where they never are so often.

    >>> linear = Screening(
    ...     displacement_std=2.0, velocity_std=3.0, acceleration_std=1.0, zero_crossing_rate=1.0,
    ...     miles=None, input_acceleration_std=None,
    ... )
    >>> round(_clearance_of_rate(linear, linear.rice_rate(5.0)), 12)
    5.0
    """
    most = linear.rice_rate(0.0)
    if rate <= 0.0 or rate >= most:
        return 0.0
    return linear.displacement_std * math.sqrt(2.0 * math.log(most / rate))
