"""Stops as an energy that varies slowly sees them: what an impact leaves of it.

Per unit mass, an orbit of the energy E meets a stop with the potential energy E_i at the speed w =
sqrt(2 (E - E_i)); the impact leaves E_i + R^2 (E - E_i).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.scenes.impact_laws import Restitution, SpeedRestitution

LEAST_RESTITUTION = 1e-4
"""Smallest restitution of a stop on which the mass rests. The law converges as R falls to 0, but at
0 itself the density has no integral over small energies. From 1e-3 to this number the standard
deviations change by a relative 1e-6, the rates by 1e-3 (measured); below it the quadrature loses
digits."""

RULE = 12
"""Number of restitutions that stand for one that scatters: Gauss's rule of its distribution."""

DECADES, SPEEDS = 6.0, 1200
"""Speeds at which a restitution by speed is read: their number, and decades below the largest."""


class Returns(NamedTuple):
    """Energies beyond E_i from which impacts come to given energies.

    With each comes the change there of the probability that an impact from a higher energy ends
    below. It is minus one where, from there up, none does any more.
    """

    starts: Vector
    weights: Vector


@dataclass(frozen=True, kw_only=True)
class Barrier:
    """A stop that orbits of a higher energy than `energy` reach.

    `rebounds` are the values of R^2, each with its probability: one, or a rule for a restitution
    that scatters. `restitution` and `mean_square` are E R and E R^2.
    """

    energy: float
    restitution: float
    mean_square: float
    rebounds: tuple[tuple[float, float], ...]

    @property
    def lossless(self) -> bool:
        """Whether impacts take no energy."""
        return self.restitution == 1.0

    def kept(self, above: Vector) -> Vector:
        """E R^2 of impacts from energies beyond E_i."""
        return np.full_like(above, self.mean_square)

    def returned(self, above: Vector) -> Vector:
        """E R of impacts from energies beyond E_i."""
        return np.full_like(above, self.restitution)

    def returns(self, above: Vector) -> Iterator[Returns]:
        """Whence impacts come to energies beyond E_i."""
        for kept, probability in self.rebounds:
            if kept > 0.0:
                yield Returns(above / kept, np.full_like(above, -probability))


@dataclass(frozen=True, kw_only=True)
class SpeedBarrier:
    """A stop whose restitution depends on the speed."""

    energy: float
    law: SpeedRestitution

    @property
    def lossless(self) -> bool:
        """Whether impacts take no energy."""
        return self.law.conservative

    @property
    def mean_square(self) -> float:
        """R^2 at the speed that stands for all."""
        return max(self.law.restitution, self._least) ** 2

    @cached_property
    def _least(self) -> float:
        return 0.0 if self.energy else LEAST_RESTITUTION

    def kept(self, above: Vector) -> Vector:
        """R^2 of impacts from energies beyond E_i."""
        return np.asarray(self.returned(above) ** 2)

    def returned(self, above: Vector) -> Vector:
        """R of impacts from energies beyond E_i."""
        return np.maximum(self.law.restitution_at(np.sqrt(2.0 * above)), self._least)

    def returns(self, above: Vector) -> Iterator[Returns]:
        """Whence impacts come to energies beyond E_i.

        The speed R(w) w of a rebound need not rise with w. Where it falls, fast impacts come to
        rest below an energy that slower ones left above it: the speeds whose rebounds pass the one
        of that energy, upwards and downwards in turn.
        """
        own = np.sqrt(2.0 * above)
        grid = own.max(initial=0.0) * np.geomspace(10.0**-DECADES, 10.0**DECADES, 2 * SPEEDS)
        if self.law.speed is not None:
            grid = np.union1d(grid, self.law.speed)
        back = grid * self.returned(0.5 * grid**2)
        slow = own * self.returned(above)
        faster, number = back > own[:, None], np.arange(len(grid))
        first = place = np.searchsorted(grid, own, side="right")
        for turn in itertools.count():
            # after an even number of passages rebounds are slower than the speed itself
            ahead = (number >= place[:, None]) & (faster if turn % 2 == 0 else ~faster)
            passed = ahead.any(axis=1)
            if not passed.any():
                return
            place = np.where(passed, ahead.argmax(axis=1), len(grid))
            at, speed = place[passed], own[passed]
            from_own = (at == first[passed]) & (turn == 0)
            low = np.where(from_own, speed, grid[at - 1])
            below = np.where(from_own, slow[passed], back[at - 1])
            rise = back[at] - below
            share = np.divide(speed - below, rise, out=np.ones_like(rise), where=rise != 0.0)
            starts = np.full_like(own, np.inf)
            starts[passed] = (low + share * (grid[at] - low)) ** 2 / 2.0
            yield Returns(starts, np.full_like(own, -1.0 if turn % 2 == 0 else 1.0))


AnyBarrier = Barrier | SpeedBarrier


def barrier_of(law: Restitution | SpeedRestitution, energy: float) -> AnyBarrier:
    """The stop of a law at a potential energy."""
    if isinstance(law, SpeedRestitution):
        return SpeedBarrier(energy=energy, law=law)
    least = 0.0 if energy else LEAST_RESTITUTION
    if law.scatter is None:
        r = max(law.restitution, least)
        return Barrier(energy=energy, restitution=r, mean_square=r**2, rebounds=((r**2, 1.0),))
    nodes, weights = law.scatter.rule(RULE)
    kept = np.maximum(nodes, least) ** 2
    return Barrier(
        energy=energy,
        restitution=law.restitution,
        mean_square=float(weights @ kept),
        rebounds=tuple(zip(kept.tolist(), weights.tolist(), strict=True)),
    )
