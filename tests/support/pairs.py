"""Structures of several coordinates and pairs that tests have in common."""

from __future__ import annotations

import numpy as np

from stochvi import ImpactPair, Matrices, Restitution, Scene, WhiteNoise

LAW = Restitution(coefficient=0.5)


def diagonal(*entries: float) -> list[list[float]]:
    """A diagonal matrix, row by row."""
    rows: list[list[float]] = np.diag(entries).tolist()
    return rows


def pair(
    name: str, on: str | None, reach: float, between: tuple[str, str] | None = None
) -> ImpactPair:
    """Rigid stops at equal distances from the unloaded springs."""
    return ImpactPair(name=name, on=on, between=between, lower=-reach, upper=reach, law=LAW)


def uncoupled(*pairs: ImpactPair) -> Scene:
    """Two oscillators that know nothing of each other: omega 1 and 2, zeta 0.05, sigma 1."""
    return Scene(
        structure=Matrices(
            coordinates=("x", "z"),
            mass=diagonal(1, 1),
            damping=diagonal(0.1, 0.2),
            stiffness=diagonal(1, 4),
        ),
        impact_pairs=pairs,
        excitations=[WhiteNoise(intensity=0.2, on="x"), WhiteNoise(intensity=1.6, on="z")],
    )
