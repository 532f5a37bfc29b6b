"""A striker whose drive switches by its position and the direction of its motion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from stochvi.mathematics.arrays import Vector


@dataclass(frozen=True, kw_only=True)
class SwitchedDrive:
    """A striker that a force of constant size throws off its stop and back.

    Per unit mass, the force is `force` away from the stop while the striker rises below
    `switching`, and `force` towards the stop otherwise (B 19.11). A `load` acts towards the stop.

    Parameters
    ----------
    restitution
        R of the stop, from 0 to below 1.
    force
        Size U of the force per unit mass, m/s^2.
    switching
        Distance x* from the stop at which the force reverses, m.
    load
        Constant load g per unit mass, m/s^2, below `force`.

    Raises
    ------
    ValueError
        If a number is out of its range.

    See Also
    --------
    stochvi.harmonic_response : Strikers that a sine drives.

    Examples
    --------
    The strongest impact once a second, with R = 0.5 and a force of 10 m/s^2, and the first impacts
    from rest:

    >>> striker = SwitchedDrive.strongest(restitution=0.5, force=10.0, period=1.0)
    >>> round(striker.switching, 4), round(striker.impact_speed, 3)
    (0.4329, 4.805)
    >>> striker.start_up(0.0, 3).round(2).tolist()
    [4.16, 4.65, 4.77]
    """

    restitution: float
    force: float
    switching: float
    load: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.restitution < 1.0:
            raise ValueError(f"restitution must be in [0, 1), got {self.restitution:g}")
        if not self.switching > 0.0:
            raise ValueError(f"switching must be greater than 0 m, got {self.switching:g}")
        if not 0.0 <= self.load < self.force:
            raise ValueError(
                f"load must be in [0, force), got {self.load:g} with force {self.force:g}; a "
                "larger load holds the striker on its stop"
            )

    @classmethod
    def strongest(
        cls, *, restitution: float, force: float, period: float, load: float = 0.0
    ) -> Self:
        """The drive with the fastest impacts of a period among all forces of at most this size.

        The force reverses after the time t of each period T,

            t / T = (2 - sqrt(2 (1 + R^2) - 2 y (1 - R^2))) / (2 (1 + R)),    y = g / U,

        and the impact speed is (1 + y - 2 t / T) U T / (1 + R) (B 18.31, 18.34, 18.35).

        Parameters
        ----------
        restitution, force, load
            As for the class.
        period
            Period T, s.

        Returns
        -------
        SwitchedDrive
            The drive, with its switching distance.
        """
        if not period > 0.0:
            raise ValueError(f"period must be greater than 0 s, got {period:g}")
        r, y = restitution, load / force
        root = math.sqrt(2.0 * (1.0 + r**2) - 2.0 * y * (1.0 - r**2))
        t = period * (2.0 - root) / (2.0 * (1.0 + r))
        speed = (1.0 + y - 2.0 * t / period) * force * period / (1.0 + r)
        switching = r * speed * t + (force - load) * t**2 / 2.0
        return cls(restitution=r, force=force, switching=switching, load=load)

    @property
    def impact_speed(self) -> float:
        """Speed of the impacts in the long run, 2 sqrt(U x* / (1 - R^2)), m/s (B 19.18)."""
        return 2.0 * math.sqrt(self.force * self.switching / (1.0 - self.restitution**2))

    @property
    def highest(self) -> float:
        """Largest distance from the stop in the long run, m, 2 x* / ((1 + g / U) (1 - R^2)); the
        book prints 1 - g / U (B 19.21)."""
        return self.impact_speed**2 / (2.0 * (self.force + self.load))

    @property
    def period(self) -> float:
        """Time between two impacts in the long run, s (B 19.20)."""
        after = self.restitution * self.impact_speed
        up, down = self.force - self.load, self.force + self.load
        fastest = math.sqrt(after**2 + 2.0 * up * self.switching)
        return (fastest - after) / up + (fastest + self.impact_speed) / down

    @property
    def forgotten(self) -> float:
        """Share of a small difference of impact speeds that the next impact keeps: R^2, so that
        the motion is always stable."""
        return self.restitution**2

    def next_speed(self, speed: float) -> float:
        """Speed of the impact after one of a speed w, sqrt(R^2 w^2 + 4 U x*), m/s (B 19.17)."""
        return math.hypot(self.restitution * speed, 2.0 * math.sqrt(self.force * self.switching))

    def start_up(self, speed: float, impacts: int) -> Vector:
        """Speeds of the impacts that follow one of a speed, m/s; 0 for a striker at rest (B 19.23).

        Parameters
        ----------
        speed
            Speed of the impact before, m/s.
        impacts
            Number of impacts.
        """
        found = []
        for _ in range(impacts):
            speed = self.next_speed(speed)
            found.append(speed)
        return np.array(found)
