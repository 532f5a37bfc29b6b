"""A mass of 2 kg at 2 rad/s whose spring or damper changes in time."""

from __future__ import annotations

from typing import Any

import numpy as np

from stochvi import Oscillator, Scene, WhiteNoise
from stochvi.mathematics.spectra import FilteredChange
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


def mean_squares(modulation: Modulation) -> tuple[float, float]:
    """E x^2 and E v^2 under filtered noise, by moments times Hermite polynomials of the filter."""
    assert modulation.filter is not None
    system = np.array([[0.0, 2.0, 0.0], [-(W**2), -B, 1.0], [0.0, -2.0 * W**2, -2.0 * B]])
    change = np.zeros((3, 3))
    if modulation.of == "stiffness":
        change[1, 0], change[2, 1] = -(W**2), -2.0 * W**2
    else:
        change[1, 1], change[2, 2] = -B, -2.0 * B
    generator, size = FilteredChange(change, *modulation.filter).operators(24)
    whole = (
        np.kron(np.eye(len(size)), system) + np.kron(size.T, change)
        + np.kron(generator.T, np.eye(3))
    )  # fmt: skip
    source = np.zeros(len(whole))
    source[2] = S0 / M**2
    found = np.linalg.solve(whole, -source)
    return float(found[0]), float(found[2])
