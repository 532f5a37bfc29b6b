"""One contact of an isolated mass with a stop, mount and stop together."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from stochvi.model.model import Model
from stochvi.scenes.impact_laws import CompliantLaw

CONTACT_STEPS = 200.0
"""Number of time steps in a contact; its peak is then read off with a relative error of 1e-4."""


class Contact(NamedTuple):
    """Peak absolute acceleration (m/s^2), deflection of the stop (m) and duration (s)."""

    peak_acceleration: float
    deflection: float
    contact_time: float


def contact_on_mount(model: Model, law: CompliantLaw, distance: float, speed: float) -> Contact:
    """A mass that meets a stop `distance` from its mean position at `speed`, the base at rest.

    y'' = -(b y' + omega^2 (distance + y)) - F(y, y') from y = 0, y' = speed until the mass is
    back at y = 0; `law` gives F per unit mass. The peak is that of |y''|, mount and stop together.
    """
    b, stiff = model.damping_rate, model.omega**2

    def motion(_: float, state: np.ndarray) -> list[float]:
        y, v = state
        return [v, -(b * v + stiff * (distance + y)) - float(law.force_at(y, v))]

    def back(_: float, state: np.ndarray) -> float:
        return float(state[0])

    back.terminal, back.direction = True, -1.0  # type: ignore[attr-defined]
    # a mount can only shorten a contact, so that none lasts longer than this
    longest = 1.1 * law.impact(speed, 1.0).contact_time + math.pi / model.omega
    shortest = min(law.impact(speed, 1.0).contact_time, 1.0 / model.omega)
    found = solve_ivp(
        motion, (0.0, longest), [0.0, speed], events=back, max_step=shortest / CONTACT_STEPS,
        rtol=1e-7, atol=1e-9 * speed * shortest,
    )  # fmt: skip
    y, v = found.y
    force = np.array([float(law.force_at(*state)) for state in found.y.T])
    touching = found.t[force > 0.0]
    return Contact(
        peak_acceleration=float(np.abs(b * v + stiff * (distance + y) + force).max()),
        deflection=float(y.max()),
        contact_time=float(touching[-1]) if len(touching) else 0.0,
    )
