"""Base classes of springs and dampers that are functions."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.scenes.validation import Checked

NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(64)
"""Nodes and weights of the rule of Gauss for a normal distribution of unit width."""

WEIGHTS = WEIGHTS / WEIGHTS.sum()

SLOPE_STEP = 1e-6
"""Step of the differences that give a slope, relative to the width over which it is sought."""

WIDEST = 4.0
"""Largest displacement, in standard deviations from the mean, whose stiffness limits the step."""


class LinearForm(NamedTuple):
    """The affine force f + k (x - mean) + c v in the place of a function.

    Parameters
    ----------
    force, stiffness, damping : f, N, k, N/m, and c, N s/m.
    """

    force: float
    stiffness: float
    damping: float


class Characteristic(Checked):
    """A spring or damper of a structure that is a function of its displacement and velocity.

    Its force adds to those of the linear stiffness and damping of the structure.

    Parameters
    ----------
    on
        Coordinate on which it acts, from the ground or the base; needed where there are several.
    between
        Two coordinates, instead: the displacement is that of the first less that of the second.
    axis
        Axis along which a mount of a box acts: "x", "y" or "z".
    """

    own: ClassVar[str] = "a force of your own is a SpringFunction"
    word: ClassVar[str] = "nonlinear"
    """Adjective of the kind in the effects of a scene."""
    is_damper: ClassVar[bool] = False
    sticks: ClassVar[bool] = False
    """Whether the force holds what is at rest, so that it jumps with the velocity."""
    remembers: ClassVar[bool] = False
    """Whether the force depends on the past."""
    drives: ClassVar[bool] = False
    """Whether the force keeps the structure in motion, which then settles by its own damping."""

    kind: Any
    on: str | None = None
    between: tuple[str, str] | None = None
    axis: Literal["x", "y", "z"] | None = None

    @abstractmethod
    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        """Force against displacements (m) and velocities (m/s), N."""

    @abstractmethod
    def compiled(self, mass: float) -> Any:
        """The part of kernels, a class of `engine.characteristics`, for forces per unit of a mass,
        kg."""

    @property
    @abstractmethod
    def strengths(self) -> Sequence[float]:
        """The numbers of the force, whose size is checked."""

    @property
    def needs(self) -> str:
        """What the force depends on: "displacement", "velocity" or "both"."""
        return "velocity" if self.is_damper else "displacement"

    @property
    def fastest(self) -> float:
        """Largest rate, 1/s, that the steps of a simulation must resolve whatever the motion."""
        return 0.0

    @property
    def effect(self) -> str:
        """What `explain` says of it."""
        return f"{self.word} {'damper' if self.is_damper else 'spring'}"

    def refusal(self, name: str) -> str:
        """What a method for linear structures says of it, of the name that it has there."""
        part = "damper" if self.is_damper else "spring"
        return (
            f"structure.{part} must be linear, got kind {self.kind!r} ({name}); simulate follows "
            "it, and sweep counts its impacts over clearances"
        )

    def potential_at(self, displacement: ArrayLike) -> Vector:
        """Energy at displacements, less that at 0, J; ValueError where there is none."""
        raise ValueError(f"a {self.effect} has no potential energy")

    def knots(self) -> Vector:
        """Displacements, m, between which the force is smooth; a spring with kinks must override
        this."""
        return np.zeros(0)

    def linear_form(self, mean: float, deviation: float, speed: float) -> LinearForm:
        """Statistical linearisation for independent normal displacement and velocity.

        f = E F, k = E F (x - mean) / deviation^2 and c = E F v / speed^2, by quadrature.

        Parameters
        ----------
        mean, deviation
            Of the displacement, m.
        speed
            Standard deviation of the velocity, m/s.
        """
        u, w = NODES, WEIGHTS
        x, v = mean + deviation * u, speed * u
        if self.needs == "displacement":
            force = self.force_at(x)
            return LinearForm(float(w @ force), float(w @ (force * u)) / deviation, 0.0)
        if self.needs == "velocity":
            force = self.force_at(np.full_like(v, mean), v)
            return LinearForm(float(w @ force), 0.0, float(w @ (force * u)) / speed)
        force = self.force_at(x[:, None], v[None, :])
        return LinearForm(
            float(w @ force @ w), float((w * u) @ force @ w) / deviation,
            float(w @ force @ (w * u)) / speed,
        )  # fmt: skip

    def time_of_throw(self, mass: float, distance: float) -> float:
        """Time, s, in which a force that drives moves a mass, kg, over a distance, m, or to where
        it reverses; infinite for all others."""
        return math.inf

    def moved_exactly(self, mean: float, deviation: float, speed: float) -> LinearForm:
        """The part of the force that a simulation moves exactly, as in `linear_form`; kicks do the
        rest."""
        return self.linear_form(mean, deviation, speed)

    def stiffest(self, mean: float, deviation: float) -> float:
        """Largest slope of the force over the displacement, N/m, within `WIDEST` deviations."""
        x = mean + WIDEST * deviation * np.linspace(-1.0, 1.0, 81)
        step = SLOPE_STEP * deviation
        slopes = (self.force_at(x + step) - self.force_at(x - step)) / (2.0 * step)
        return float(max(np.max(slopes), 0.0))

    def most_damping(self, mean: float, speed: float) -> float:
        """Largest slope of the force over the velocity, N s/m, within `WIDEST` deviations, where
        kicks of a simulation must resolve it; 0 where they are exact."""
        if self.needs == "displacement":
            return 0.0
        v, step = WIDEST * speed * np.linspace(-1.0, 1.0, 81), SLOPE_STEP * speed
        slopes = (self.force_at(mean, v + step) - self.force_at(mean, v - step)) / (2.0 * step)
        return float(np.max(np.abs(slopes)))


class SpringForce(Characteristic):
    """A spring whose force is a function of the displacement."""


class DamperForce(Characteristic):
    """A damper whose force is a function of the velocity."""

    is_damper: ClassVar[bool] = True

    def stiffest(self, mean: float, deviation: float) -> float:
        return 0.0
