"""States of a scene by the names of its coordinates, and as the kernels take them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Matrix
from stochvi.methods.periodic.family import Family
from stochvi.model.model import Model


class States:
    """States of a model at one place of its family, in m and m/s and in the units of the kernels.

    A state is a row of 2 n numbers: the displacements of the coordinates and then their velocities.
    """

    def __init__(self, model: Model, family: Family, sigma: float) -> None:
        self.model, self.time = model, family.time
        n = len(model.mass)
        # displacements (m) of the coordinates per unit of those of the kernels
        known = family.states(np.eye(n, 2 * n), np.full(n, sigma))
        self._shapes = known["displacement"].T

    @property
    def names(self) -> list[str]:
        """Names of the numbers of a state, in their order."""
        return [
            f"{what}.{name}"
            for what in ("displacement", "velocity")
            for name in self.model.coordinates
        ]

    def physical(self, states: Matrix) -> Matrix:
        """States (number, 2 n), m and m/s, from those of the kernels."""
        return self._turned(states, self._shapes, 1.0 / self.time)

    def scaled(self, states: Matrix) -> Matrix:
        """States of the kernels from those in m and m/s."""
        return self._turned(states, np.asarray(np.linalg.inv(self._shapes)), self.time)

    @staticmethod
    def _turned(states: Matrix, shapes: Matrix, rate: float) -> Matrix:
        n = len(shapes)
        return np.hstack([states[:, :n] @ shapes.T, rate * states[:, n:] @ shapes.T])

    def starts(self, given: Mapping[str, ArrayLike]) -> Matrix:
        """States of the kernels with some numbers given by name (number,), m or m/s; all others are
        those at rest under the constant loads, where a free mass is at 0.

        Raises
        ------
        ValueError
            If a name is not one of the scene.
        """
        model, n = self.model, len(self.model.mass)
        if unknown := set(given) - set(self.names):
            raise ValueError(
                f"start must name some of {', '.join(self.names)}, got {', '.join(sorted(unknown))}"
            )
        number = max((np.size(values) for values in given.values()), default=1)
        states = np.zeros((number, 2 * n))
        states[:, :n] = np.linalg.pinv(model.stiffness, hermitian=True) @ model.constant_force
        for name, values in given.items():
            states[:, self.names.index(name)] = values
        return self.scaled(states)
