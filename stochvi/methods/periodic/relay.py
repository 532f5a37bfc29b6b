"""A mass that a relay drives from stop to stop (B 12.3, 12.20, 12.21, 12.22, 12.23)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stochvi.mathematics.arrays import Matrix
from stochvi.mathematics.state_space import transition
from stochvi.methods.periodic.speed_scatter import speed_scatter

PARTS = 0.05
"""Longest part of a flight in which its end is searched for: as a share of a flight without spring
and damper, and in radians of the free motion."""

MOST_PARTS = 100_000
"""Most parts of a flight."""

FASTEST = 1e12
"""Largest impact speed that is searched for, in units of that of one flight from rest."""


@dataclass(frozen=True, kw_only=True)
class RelayBetweenStops:
    """A force of constant size along the motion of a mass between two rigid stops.

    Per unit mass x'' + b x' + w0^2 x = U sign(x'), with stops of the restitution R at -c and c. The
    motion from one stop to the other is linear, and known in closed form.

    Parameters
    ----------
    force
        U, m/s^2.
    clearance
        c, m.
    restitution
        R of both stops, from 0 to 1.
    damping_rate
        b, 1/s; above 0 if R is 1.
    frequency
        Natural frequency w0, rad/s; 0 without a spring.

    Raises
    ------
    ValueError
        If a number is out of its range, or the force is below `least_force`.

    See Also
    --------
    SwitchedDrive : A striker that is thrown off one stop.
    stochvi.scenes.Relay : The drive in a scene, with noise, delay and compliant stops.

    Examples
    --------
    Without spring and damper the work of the force replaces what impacts take, (1 - R^2) w^2 / 2 =
    2 U c:

    >>> drive = RelayBetweenStops(force=2.0, clearance=0.5, restitution=0.6)
    >>> round(drive.impact_speed, 9), round(2.0 * (2.0 * 0.5 / (1.0 - 0.6**2)) ** 0.5, 9)
    (2.5, 2.5)

    A spring makes the motion faster; the book's frequency is that of the first harmonic:

    >>> drive = RelayBetweenStops(
    ...     force=2.0, clearance=0.5, restitution=0.6, damping_rate=0.1, frequency=2.0
    ... )
    >>> round(2.0 * math.pi / drive.period, 2), round(drive.harmonic_frequency, 2)
    (6.47, 4.76)
    """

    force: float
    clearance: float
    restitution: float
    damping_rate: float = 0.0
    frequency: float = 0.0

    def __post_init__(self) -> None:
        for name in ("force", "clearance"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be greater than 0, got {getattr(self, name):g}")
        for name in ("damping_rate", "frequency"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be 0 or more, got {getattr(self, name):g}")
        if not 0.0 <= self.restitution <= 1.0:
            raise ValueError(f"restitution must be in [0, 1], got {self.restitution:g}")
        if self.restitution == 1.0 and self.damping_rate == 0.0:
            raise ValueError("damping_rate must be greater than 0 with a restitution of 1, got 0")
        if self.force <= self.least_force:
            raise ValueError(
                f"force must be greater than {self.least_force:.4g}, got {self.force:g}: the mass "
                "does not reach its stops"
            )

    @property
    def least_force(self) -> float:
        """Force, m/s^2, above which the mass reaches its stops.

        Without them it swings to U (1 + q) / ((1 - q) w0^2), with q the decay of half a free swing;
        the force is that of the amplitude c, w0^2 c tanh(pi b / (4 wd)), wd^2 = w0^2 - b^2 / 4. It
        is w0^2 c where the motion is overdamped.
        """
        square = self.frequency**2
        rest = square - self.damping_rate**2 / 4.0
        if rest <= 0.0:
            return square * self.clearance
        angle = math.pi * self.damping_rate / (4.0 * math.sqrt(rest))
        return square * self.clearance * math.tanh(angle)

    @property
    def harmonic_least_force(self) -> float:
        """The same by the first harmonic, pi c w0 (b + p w0) / 4 with p = (1 - R^2) / pi
        (B 12.23). It counts impacts that take energy at the boundary, where they are slow: the
        mass reaches its stops by less."""
        loss = self.damping_rate + self._impact_loss * self.frequency
        return math.pi / 4.0 * self.clearance * self.frequency * loss

    @property
    def harmonic_frequency(self) -> float:
        """Frequency by the first harmonic, rad/s, b (sqrt(1 + 16 p U / (pi b^2 c)) - 1) / (2 p)
        (B 12.20, 12.21, 12.22); valid from `harmonic_least_force` on."""
        p, b = self._impact_loss, self.damping_rate
        scaled = 4.0 * self.force / (math.pi * self.clearance)  # = p w^2 + b w
        return 2.0 * scaled / (b + math.sqrt(b**2 + 4.0 * p * scaled))

    @property
    def _impact_loss(self) -> float:
        """p, damping by impacts over the frequency (B 7.62)."""
        return (1.0 - self.restitution**2) / math.pi

    @cached_property
    def _generator(self) -> Matrix:
        """Matrix of (x, x', 1)' on the way up."""
        return np.array(
            [
                [0.0, 1.0, 0.0],
                [-(self.frequency**2), -self.damping_rate, self.force],
                [0.0, 0.0, 0.0],
            ]
        )

    def flight(self, speed: float) -> tuple[float, float]:
        """Duration, s, of the motion from stop to stop after an impact at a speed, m/s, and the
        speed with which it ends.

        Parameters
        ----------
        speed
            Speed of the impact before, m/s.

        Raises
        ------
        ValueError
            If the mass turns before it has reached the other stop.
        """
        from scipy.optimize import brentq

        state = np.array([-self.clearance, self.restitution * speed, 1.0])
        last = math.sqrt(state[1] ** 2 + 4.0 * self.force * self.clearance)
        free = (last - state[1]) / self.force
        part = PARTS * min(free, 1.0 / self.frequency if self.frequency else math.inf)
        step, passed = transition(self._generator, part), 0.0
        for _ in range(MOST_PARTS):
            following = step @ state
            if following[0] >= self.clearance:
                break
            if following[1] <= 0.0:
                raise ValueError(
                    f"speed must let the mass reach the other stop, got {speed:.4g} m/s"
                )
            state, passed = following, passed + part

        def ahead(time: float) -> float:
            return float((transition(self._generator, time) @ state)[0]) - self.clearance

        end = float(brentq(ahead, 0.0, part, xtol=1e-15 * part, rtol=1e-14))
        return passed + end, float((transition(self._generator, end) @ state)[1])

    def next_speed(self, speed: float) -> float:
        """Speed of the impact after one of a speed, m/s.

        Parameters
        ----------
        speed
            Speed of the impact before, m/s.
        """
        return self.flight(speed)[1]

    @cached_property
    def impact_speed(self) -> float:
        """Speed of the impacts in the long run, m/s: the one that leads back to itself. Without a
        damper it is 2 sqrt(U c / (1 - R^2)), whatever the spring."""
        from scipy.optimize import brentq

        high = unit = self.next_speed(0.0)
        while self.next_speed(high) > high and high < FASTEST * unit:
            high *= 2.0
        if high == unit:
            return unit
        return float(brentq(lambda w: self.next_speed(w) - w, unit, high, rtol=1e-13))

    @property
    def period(self) -> float:
        """Time between two impacts on the same stop in the long run, s."""
        return 2.0 * self.flight(self.impact_speed)[0]

    @property
    def forgotten(self) -> float:
        """Share of a small difference of impact speeds that the next impact keeps, dw' / dw.

        With phi(t) the free motion from (0, 1), it is R (phi' - a phi / w), a the acceleration just
        before the impact: R^2 without a damper and a spring.
        """
        duration, speed = self.flight(self.impact_speed)
        moved, changed = transition(self._generator, duration)[:2, 1]
        last = self.force - self.damping_rate * speed - self.frequency**2 * self.clearance
        return float(self.restitution * (changed - last * moved / speed))

    def speed_std(self, restitution_std: float) -> float:
        """Standard deviation of the impact speeds in the long run, m/s, where the restitution
        scatters a little from impact to impact.

        To second order, see `speed_scatter`.

        Parameters
        ----------
        restitution_std
            Standard deviation of the restitution, much smaller than R.
        """
        return speed_scatter(
            self.next_speed, self.forgotten, self.impact_speed, self.restitution, restitution_std
        )
