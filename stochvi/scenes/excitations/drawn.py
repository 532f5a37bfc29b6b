"""The base class of excitations whose values a simulation draws in the course of a path."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from stochvi.scenes.excitations.base import BaseExcitation, Density


class DrawnExcitation(BaseExcitation):
    """Base of random excitations that are not Gaussian. A simulation draws their values.

    Step, burn-in and start of a simulation are those of white noise of the same mean and of the
    intensity `si_intensity`.
    """

    white: ClassVar[bool] = False
    """Whether values at different times are independent of each other."""

    kind: Any
    on: str | None = None

    @property
    @abstractmethod
    def mean(self) -> float:
        """Mean force, N, or mean acceleration of the base, m/s^2."""

    @property
    @abstractmethod
    def si_intensity(self) -> float:
        """Intensity S0 of white noise that shakes as much, N^2 s or (m/s^2)^2 s."""

    @property
    @abstractmethod
    def fastest(self) -> float:
        """Fastest rate that steps must resolve, 1/s; 0 for none."""

    @property
    def jump(self) -> float:
        """Rms size of sudden changes of momentum, N s, or of the speed of the base, m/s; 0 for a
        force that is finite."""
        return 0.0

    @abstractmethod
    def compiled(self, mass: float) -> Any:
        """The drive of kernels, a class of `engine.characteristics`, per unit of a mass, kg."""

    def density_for(self, omega: float, damping_rate: float) -> Density:
        return lambda frequency_hz: np.full(np.shape(frequency_hz), 2.0 * self.si_intensity)
