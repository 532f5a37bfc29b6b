"""Boxes of displacement and velocity with a linear force, in units of a length and a speed."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from stochvi.methods.fokker_planck.mesh import Array
from stochvi.model.model import Model
from stochvi.model.oscillator_arrays import Booleans, OscillatorArrays

Number = TypeVar("Number", float, Array)


@dataclass(frozen=True, kw_only=True)
class LinearBox(Generic[Number]):
    """An oscillator between two places, in the units of its box.

    x = centre + half_length xi, v = speed u, time in units of half_length / speed, and

        du/dt = force + stiffness xi - damping u + white noise of intensity 2 diffusion.

    Every number is a float for one box, or an array with an entry for each of many boxes.
    """

    centre: Number
    half_length: Number
    speed: Number
    force: Number
    stiffness: Number
    damping: Number
    diffusion: Number

    @staticmethod
    def between(
        oscillator: Model | OscillatorArrays, left: Any, right: Any, speed: Any
    ) -> LinearBox[Any]:
        """The box of an oscillator, or of each of many, between two places (m).

        Parameters
        ----------
        oscillator
            Its properties omega, damping_rate, intensity and load are read.
        speed
            The unit of velocity, m/s.
        """
        centre, half_length = (left + right) / 2.0, (right - left) / 2.0
        time = half_length / speed
        return LinearBox(
            centre=centre,
            half_length=half_length,
            speed=speed,
            force=(oscillator.load - oscillator.omega**2 * centre) * time / speed,
            stiffness=-((oscillator.omega * time) ** 2),
            damping=oscillator.damping_rate * time,
            diffusion=oscillator.intensity / 2.0 * time / speed**2,
        )

    @property
    def time(self) -> Number:
        """The unit of time, s."""
        return self.half_length / self.speed

    def xi(self, x: Array) -> Array:
        """Displacements in the units of the box."""
        return np.asarray((np.asarray(x, dtype=float) - self.centre) / self.half_length)

    def log_weight(self, xi: Array) -> Array:
        """-energy(xi) in units of the squared speed, 0 at its largest value in the box.

        The last axis holds the places; of many boxes the first axis of the result is that of the
        boxes.
        """
        force, stiffness = np.asarray(self.force)[..., None], np.asarray(self.stiffness)[..., None]
        curved = stiffness < 0.0
        top = np.where(
            curved,
            np.clip(-force / np.where(curved, stiffness, -1.0), -1.0, 1.0),
            np.sign(force),
        )
        highest = top * (force + stiffness * top / 2.0)
        return np.asarray(xi * (force + stiffness * xi / 2.0) - highest)


@dataclass(frozen=True, kw_only=True)
class Boxes(LinearBox[Array]):
    """Many boxes, each with a stop or an elastic wall at either end.

    `mirrored` boxes run towards -x. Those that are `halved` hold one half of a symmetric scene: a
    path that leaves the half at the centre comes back as its mirror image, that is, reflected.
    """

    restitution_left: Array
    restitution_right: Array
    stop_left: Booleans
    stop_right: Booleans
    mirrored: Booleans
    halved: Booleans

    def take(self, places: NDArray[np.intp]) -> Self:
        """Some of the boxes."""
        columns = {field.name: getattr(self, field.name)[places] for field in fields(self)}
        return type(self)(**columns)
