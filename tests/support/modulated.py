"""A mass of 2 kg at 2 rad/s whose spring or damper changes in time."""

from __future__ import annotations

from typing import Any

from stochvi import Oscillator, Scene, WhiteNoise
from stochvi.scenes import Modulation

M, B, W, S0 = 2.0, 0.3, 2.0, 0.4
"""Mass, kg, damping over it, 1/s, frequency, rad/s, and intensity of the white noise, N^2 s."""


def scene_of(*modulations: Modulation, pairs: Any = (), noise: float = S0, **keys: Any) -> Scene:
    """The mass in white noise."""
    white = [WhiteNoise(intensity=noise)] if noise else []
    return Scene(
        structure=Oscillator(**{"mass": M, "damping": M * B, "stiffness": M * W**2} | keys),
        impact_pairs=list(pairs),
        excitations=[*white, *modulations],
    )
