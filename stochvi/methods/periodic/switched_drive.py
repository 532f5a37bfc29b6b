"""A striker whose drive switches by its position and the direction of its motion.

A drive with a delay switches later: its force is that of the motion a time t0 ago (B 20.3). After
an impact it then still acts towards the stop for t0, and away from it for t0 beyond x*.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.methods.periodic.speed_scatter import speed_scatter


class Throw(NamedTuple):
    """A throw of the striker, from one impact to the next.

    Parameters
    ----------
    thrown
        Distance from the stop at which the force away from it begins, m.
    rising
        Speed there, m/s.
    passing
        Speed at the switching distance, m/s.
    reversed_at, fastest
        Distance from the stop, m, and speed, m/s, where the force reverses.
    speed
        Speed of the next impact, m/s.
    """

    thrown: float
    rising: float
    passing: float
    reversed_at: float
    fastest: float
    speed: float


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
    delay
        Time t0 by which the drive switches late, s.

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

    A delay of 20 ms, and a restitution that scatters by 0.1 from impact to impact:

    >>> late = SwitchedDrive(restitution=0.5, force=10.0, switching=0.4329, delay=0.02)
    >>> round(late.impact_speed, 3), round(late.speed_std(0.1), 3)
    (4.949, 0.24)
    """

    restitution: float
    force: float
    switching: float
    load: float = 0.0
    delay: float = 0.0

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
        if not 0.0 <= self.delay < math.inf:
            raise ValueError(f"delay must be 0 s or more, got {self.delay:g}")

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

    def throw(self, speed: float) -> Throw:
        """The throw after an impact of a speed w, m/s.

        With u = R w the striker rises by x1 = u t0 - (U + g) t0^2 / 2 against the force. That then
        takes it to x*, where it has the speed v, v^2 = (u - (U + g) t0)^2 + 2 (U - g) (x* - x1),
        and to x2 = x* + v t0 + (U - g) t0^2 / 2. The work of the force gives the next speed,

            w'^2 = R^2 w^2 + 4 U (x2 - x1),

        which without a delay is R^2 w^2 + 4 U x* (B 19.17). From rest, w = 0, nothing is late but
        the reversal.

        Parameters
        ----------
        speed
            Speed of the impact, m/s.

        Returns
        -------
        Throw
            The throw to the next impact.

        Raises
        ------
        ValueError
            If the force comes so late that the striker falls back onto its stop, or passes x*.
        """
        up, down, late = self.force - self.load, self.force + self.load, self.delay
        after = self.restitution * speed
        wait = late if speed else 0.0
        thrown, rising = after * wait - down * wait**2 / 2.0, after - down * wait
        lowest = thrown - min(rising, 0.0) ** 2 / (2.0 * up)
        if lowest < 0.0 or thrown > self.switching:
            raise ValueError(
                f"delay must be so short that the striker neither falls back onto its stop nor "
                f"passes switching before it is thrown, got {late:g} s after an impact at "
                f"{speed:.4g} m/s"
            )
        passing = math.sqrt(rising**2 + 2.0 * up * (self.switching - thrown))
        reversed_at = self.switching + passing * late + up * late**2 / 2.0
        work = 4.0 * self.force * (reversed_at - thrown)
        return Throw(
            thrown, rising, passing, reversed_at, passing + up * late,
            math.sqrt(after**2 + work),
        )  # fmt: skip

    @cached_property
    def impact_speed(self) -> float:
        """Speed of the impacts in the long run, m/s: the speed that its own `throw` leads back to.
        Without a delay it is 2 sqrt(U x* / (1 - R^2)) (B 19.18)."""
        speed = 2.0 * math.sqrt(self.force * self.switching / (1.0 - self.restitution**2))
        for _ in range(MOST_THROWS if self.delay else 0):
            following = self.next_speed(speed)
            if abs(following - speed) <= SETTLED * speed:
                return following
            speed = following
        return speed

    @property
    def highest(self) -> float:
        """Largest distance from the stop in the long run, m: from there the striker falls to its
        speed, w^2 / (2 (U + g)). Without a delay it is 2 x* / ((1 + g / U) (1 - R^2)); the book
        prints 1 - g / U (B 19.21)."""
        return self.impact_speed**2 / (2.0 * (self.force + self.load))

    @property
    def period(self) -> float:
        """Time between two impacts in the long run, s (B 19.20)."""
        up, down = self.force - self.load, self.force + self.load
        found = self.throw(self.impact_speed)
        rise = (found.passing - found.rising) / up
        return 2.0 * self.delay + rise + (found.fastest + found.speed) / down

    @property
    def forgotten(self) -> float:
        """Share of a small difference of impact speeds that the next impact keeps, dw' / dw.

        It is (R^2 w + 2 U R t0 ((R w - 2 U t0) / v - 1)) / w', with v the speed at x*: without a
        delay R^2, so that the motion is always stable.
        """
        r, late = self.restitution, self.delay
        speed = self.impact_speed
        passing = self.throw(speed).passing
        turned = (r * speed - 2.0 * self.force * late) / passing - 1.0
        return (r**2 * speed + 2.0 * self.force * r * late * turned) / speed

    def speed_std(self, restitution_std: float) -> float:
        """Standard deviation of the impact speeds in the long run, m/s, where the restitution
        scatters a little from impact to impact.

        See `speed_scatter`: to second order in the scatter of the rebounds. The first order is
        abs(q) w std / (R sqrt(1 - q^2)) with q = `forgotten`; it is up to two times
        too small where a delay makes q small.

        Parameters
        ----------
        restitution_std
            Standard deviation of the restitution, much smaller than R.
        """
        return speed_scatter(
            self.next_speed, self.forgotten, self.impact_speed, self.restitution, restitution_std
        )

    def next_speed(self, speed: float) -> float:
        """Speed of the impact after one of a speed, m/s; see `throw`."""
        return self.throw(speed).speed

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


SETTLED, MOST_THROWS = 1e-15, 10_000
"""Relative change of the speed at which throws have settled, and most throws until then."""
