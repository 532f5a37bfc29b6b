"""Stationary motion of a linear structure where nothing is hit: exact standard deviations."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Matrix, Vector, Waves
from stochvi.mathematics.moving_means import MovingMean, Sines
from stochvi.model.coverage import nonlinear, not_gaussian, without_noise
from stochvi.model.modal import LinearLaw, ModalForm, linear_law
from stochvi.model.model import Model
from stochvi.results.errors import NotApplicable

AT_REST = 1e-20
"""The velocity variance of a gap is a rounding error below this share of the largest that it could
have. That is the square of its row of modal shapes times the largest variance of a modal
velocity."""


class FreeMotion(NamedTuple):
    """Modes of a structure and the stationary distribution of its motion without stops."""

    modes: ModalForm
    law: LinearLaw

    def sines(self, directions: Matrix) -> Sines:
        """The sines that move displacements along `directions` (rows, n)."""
        n = self.modes.size
        omega = np.array([omega for _, omega, _ in self.modes.sines])
        modal: Waves = np.array([wave[:n] for wave in self.law.waves], complex).reshape(-1, n)
        return Sines(omega, (directions @ self.modes.shapes) @ modal.T)

    def moving_means(self, directions: Matrix) -> list[MovingMean]:
        """Displacements along `directions` (rows, n): noise beside sines."""
        sines = self.sines(directions)
        return [
            MovingMean(float(place), float(speed), Sines(sines.omega, sines.waves[row : row + 1]))
            for row, (place, speed) in enumerate(zip(*self.deviations(directions), strict=True))
        ]

    def deviations(self, directions: Matrix) -> tuple[Vector, Vector]:
        """Standard deviations of displacements (m) and velocities (m/s) along `directions`
        (rows, n) under noise alone; 0 where the motion is a rounding error only."""
        n, rows = self.modes.size, directions @ self.modes.shapes
        places, speeds = (
            np.einsum("gm,mk,gk->g", rows, self.law.covariance[part, part], rows)
            for part in (slice(0, n), slice(n, 2 * n))
        )
        most = np.sum(rows**2, axis=1) * np.max(np.diag(self.law.covariance)[n : 2 * n])
        moves = speeds > AT_REST * most
        return np.sqrt(np.where(moves, places, 0.0)), np.sqrt(np.where(moves, speeds, 0.0))


def free_motion(model: Model, *, with_sines: bool = False) -> FreeMotion:
    """The stationary motion of a structure under Gaussian noise, its stops left out.

    Parameters
    ----------
    with_sines
        Whether sines may be there beside the noise.

    Raises
    ------
    NotApplicable
        If there is no such motion, or it is not Gaussian: the scene has a sine that is not asked
        for, no noise, a spring that is a function, or a coordinate that no spring holds or no
        damper damps.
    """
    unmet = nonlinear(model)
    if model.sines and not with_sines:
        unmet.append("excitation must be noise or constant, got sine")
    unmet += without_noise(model) + not_gaussian(model)
    law = None if unmet else linear_law(model.modal)
    if law is None:
        raise NotApplicable(
            "linear motion",
            unmet or [_unheld(model)],
        )
    return FreeMotion(model.modal, law)


def _unheld(model: Model) -> str:
    """A sentence on the modes that have no stationary motion, and on what they lack."""
    modes = model.modal
    words = "stiffness and damping must hold every coordinate without its stops"
    held = modes.squares > 0.0
    if not np.all(held):
        return (
            f"{words}: {np.sum(~held)} of {modes.size} modes have no stiffness; give springs that "
            "hold them, or, for a mass that stops alone hold, let simulate or linearise follow it"
        )
    shares = np.diag(modes.damping) / np.sqrt(modes.squares)
    named = ", ".join(f"{math.sqrt(w) / (2.0 * math.pi):.3g}" for w in modes.squares[shares <= 0.0])
    where = f" at {named} Hz" if named else ""
    return f"{words}: there is no damping{where}; give damping, zeta or loss_factor"
