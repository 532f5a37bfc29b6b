"""A drive that switches by the motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from stochvi.mathematics.arrays import Vector
from stochvi.scenes.characteristics.base import DamperForce, LinearForm
from stochvi.scenes.validation import NonNegative, Number, Positive


class Relay(DamperForce):
    """A drive of constant size that pushes along the motion, F = -force sign(v) (B 12.3).

    It takes a mass from stop to stop. With `reverses_above` it pushes back where the mass has
    passed that displacement on its way up, and until it turns: a striker is then thrown off a stop
    below and back onto it (B 19.11). `reverses_below` is the same on the way down.

    Parameters
    ----------
    force
        Size of the force, N.
    reverses_above, reverses_below
        Displacements, m, beyond which the force is against the motion that goes on.
    delay
        Time, s, for which another direction has to be wanted until the relay switches (B 20.3).
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.methods.periodic.RelayBetweenStops : Its motion between two stops.
    stochvi.methods.periodic.SwitchedDrive : The striker that reverses.

    Examples
    --------
    >>> Relay(force=0.3, reverses_above=0.5).force_at([0.0, 1.0], 0.2).tolist()
    [-0.3, 0.3]
    """

    word: ClassVar[str] = "relay"
    sticks: ClassVar[bool] = True
    drives: ClassVar[bool] = True

    kind: Literal["relay"] = "relay"
    force: Positive
    reverses_above: Number | None = None
    reverses_below: Number | None = None
    delay: NonNegative = 0.0

    @model_validator(mode="after")
    def _apart(self) -> Self:
        below, above = self._places
        if not below < above:
            raise ValueError(
                f"needs reverses_below under reverses_above, got {below:g} and {above:g}"
            )
        return self

    @property
    def _places(self) -> tuple[float, float]:
        """Displacements below and above which the force is against the motion, m."""
        low, high = self.reverses_below, self.reverses_above
        return -math.inf if low is None else low, math.inf if high is None else high

    @property
    def remembers(self) -> bool:  # type: ignore[override]
        """Whether it switches with a delay."""
        return self.delay > 0.0

    @property
    def needs(self) -> str:
        reverses = self.reverses_above is not None or self.reverses_below is not None
        return "both" if reverses or self.remembers else "velocity"

    @property
    def effect(self) -> str:
        return f"drive by a relay{' with a delay' if self.remembers else ''}"

    @property
    def fastest(self) -> float:
        return 1.0 / self.delay if self.delay else 0.0

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        """Force against displacements (m) and velocities (m/s), N, without the delay."""
        x, v = np.broadcast_arrays(np.asarray(displacement, float), np.asarray(velocity, float))
        low, high = self._places
        up = np.where(x < high, -self.force, self.force)
        return np.asarray(np.where(v >= 0.0, up, np.where(x > low, self.force, -self.force)))

    def linear_form(self, mean: float, deviation: float, speed: float) -> LinearForm:
        from scipy.special import ndtr

        low, high = ((place - mean) / deviation for place in self._places)
        beyond = float(ndtr(-high)), float(ndtr(low))
        densities = sum(math.exp(-(u**2) / 2.0) for u in (low, high)) / math.sqrt(2.0 * math.pi)
        return LinearForm(
            self.force * (beyond[0] - beyond[1]), self.force * densities / deviation,
            -math.sqrt(2.0 / math.pi) * self.force * (1.0 - sum(beyond)) / speed,
        )  # fmt: skip

    def moved_exactly(self, mean: float, deviation: float, speed: float) -> LinearForm:
        # where it reverses, the motion is as wide as the drive makes it, whatever the noise
        if reach := self._reach(mean):
            wide = self.linear_form(mean, max(deviation, reach), speed)
            return LinearForm(0.0, wide.stiffness, 0.0)
        return self.linear_form(mean, deviation, speed)

    def _reach(self, mean: float) -> float:
        """Distance from a displacement to the nearest place where it reverses, m; 0 for none."""
        distances = [abs(place - mean) for place in self._places if math.isfinite(place)]
        return min(distances, default=0.0)

    def stiffest(self, mean: float, deviation: float) -> float:
        return 0.0

    def most_damping(self, mean: float, speed: float) -> float:
        return 0.0

    def time_of_throw(self, mass: float, distance: float) -> float:
        places = [abs(place) for place in self._places if math.isfinite(place) and place]
        return math.sqrt(2.0 * mass * min([distance, *places]) / self.force)

    @property
    def strengths(self) -> Sequence[float]:
        return (self.force,)

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics.relay import LateRelay
        from stochvi.engine.characteristics.relay import Relay as Compiled

        low, high = self._places
        if self.remembers:
            return LateRelay(self.force / mass, high, low, self.delay)
        return Compiled(self.force / mass, high, low)
