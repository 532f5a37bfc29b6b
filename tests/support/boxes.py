"""A box that has no symmetry, and its matrices without the formulas of the package."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from stochvi.scenes.excitations import TabulatedNoise
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.rigid_body import RigidBody

PLACES = [
    (x + 0.03, y - 0.02, z + 0.01)
    for x in (-0.2, 0.25) for y in (-0.15, 0.12) for z in (-0.1, 0.11)
]  # fmt: skip
"""Eight corners about a centre of mass that is off their middle, m."""

INERTIA = [[0.22, 0.02, -0.015], [0.02, 0.27, 0.01], [-0.015, 0.01, 0.18]]

TABLES = {
    "x": ([5.0, 20.0, 400.0], [0.002, 0.01, 0.001]),
    "y": ([4.0, 60.0, 300.0], [0.004, 0.003, 0.0005]),
    "z": ([5.0, 40.0, 500.0], [0.015, 0.01, 0.0002]),
}
"""One-sided densities by axis: Hz, and g^2/Hz."""


def box(**keys: Any) -> RigidBody:
    """A box on eight mounts that all differ; `keys` of damping are for all of them."""
    mounts = []
    for number, place in enumerate(PLACES, start=1):
        stiffness = [1e4 + 900.0 * number, 1.3e4 - 400.0 * number, 1.8e4 + 300.0 * number]
        mount = {"at": place, "stiffness": stiffness}
        damped = {name: keys[name] for name in ("zeta", "loss_factor") if name in keys}
        mounts.append(mount | (damped or {"damping": [10.0 + number, 14.0, 22.0 - number]}))
    rest = {name: value for name, value in keys.items() if name not in ("zeta", "loss_factor")}
    return RigidBody(**{"mass": 12.0, "inertia": INERTIA, "mount": mounts} | rest)


def tables(level_db: float = 0.0) -> list[TabulatedNoise]:
    """Independent noise of the base along all three axes."""
    return [
        TabulatedNoise(
            axis=axis, frequency_hz=frequency, density=density, unit="g2/Hz", level_db=level_db
        )
        for axis, (frequency, density) in TABLES.items()
    ]


def scene_with(structure: RigidBody, pairs: Sequence[Any] = (), level_db: float = 0.0) -> Scene:
    """The box on the tables of this module."""
    return Scene(structure=structure, impact_pair=list(pairs), excitations=tables(level_db))


def direct_matrices(structure: RigidBody) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, damping and stiffness as second derivatives of kinetic energy, Rayleigh's function and
    the energy of springs between points that really turn."""

    def turned(q: np.ndarray) -> np.ndarray:
        angle = float(np.linalg.norm(q[3:]))
        axis = q[3:] / angle if angle else np.zeros(3)
        cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross

    def moved(q: np.ndarray, place: Sequence[float]) -> np.ndarray:
        return np.asarray(q[:3] + turned(q) @ np.array(place) - np.array(place))

    def kinetic(v: np.ndarray) -> float:
        spin = np.array(structure.inertia)
        return 0.5 * structure.mass * float(v[:3] @ v[:3]) + 0.5 * float(v[3:] @ spin @ v[3:])

    def springs(q: np.ndarray) -> float:
        return sum(
            0.5 * float(np.array(m.stiffness) @ moved(q, m.at) ** 2) for m in structure.mounts
        )

    def dampers(v: np.ndarray) -> float:
        return sum(
            0.5 * float(np.array(m.damping) @ (v[:3] + np.cross(v[3:], m.at)) ** 2)
            for m in structure.mounts
        )

    return hessian(kinetic), hessian(dampers), hessian(springs)


def hessian(energy: Any, step: float = 1e-3) -> np.ndarray:
    """Second derivatives at 0 by central differences of steps h and h / 2, extrapolated."""

    def at(h: float) -> np.ndarray:
        units = h * np.eye(6)
        found = [
            [energy(a + b) - energy(a - b) - energy(b - a) + energy(-a - b) for b in units]
            for a in units
        ]
        return np.array(found) / (4.0 * h**2)

    rough, fine, finest = at(2.0 * step), at(step), at(step / 2.0)
    once, twice = (4.0 * fine - rough) / 3.0, (4.0 * finest - fine) / 3.0
    return (16.0 * twice - once) / 15.0
