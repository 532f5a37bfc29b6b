"""The oscillator of this study, and its spectra without stops and linearised."""

import math

import numpy as np

import stochvi
from stochvi.mathematics.spectra import squared_gain

B, S0 = 0.1, 0.2


def oscillator(
    restitution: float | None, lower: float | None, upper: float | None
) -> stochvi.Scene:
    """sigma_x = 1 without stops; no restitution means no stops."""
    law = stochvi.Restitution(coefficient=restitution or 0.0)
    stops = [stochvi.ImpactPair(lower=lower, upper=upper, law=law)] if restitution else []
    return stochvi.Scene(
        structure=stochvi.Oscillator(mass=1.0, damping=B, stiffness=1.0),
        impact_pairs=stops,
        excitations=[stochvi.WhiteNoise(intensity=S0)],
    )


def linear(f: np.ndarray) -> np.ndarray:
    """Exact displacement density without stops, one-sided per hertz."""
    return 2.0 * S0 * squared_gain(f, 1.0, B)


def linearised(scene: stochvi.Scene, f: np.ndarray) -> np.ndarray:
    """Of the spring and damper that have the rms displacement and velocity of the closure."""
    found = stochvi.linearise(scene).coordinates["x"]
    x2, v2 = (found[f"{name}_mean_square"].value for name in ("displacement", "velocity"))
    return 2.0 * S0 * squared_gain(f, math.sqrt(v2 / x2), S0 / (2.0 * v2))
