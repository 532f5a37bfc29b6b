"""One gap on its own: a unit mass between at most two stops, in SI units or in scaled ones."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self

from stochvi.mathematics.spectra import Filter, Table
from stochvi.model.model import LOWER, UPPER, Model, Pair, Stop


@dataclass(frozen=True, kw_only=True)
class Gap:
    """x'' + damping_rate x' + omega^2 x = noise + load between the stops, per unit mass.

    Methods for a single gap compute with it. `Gap.of` makes it from the model of one oscillator.
    `Gap.of_pair` makes it from one impact pair of a structure, with a spring that stands for the
    rest of the structure.

    Parameters
    ----------
    omega, damping_rate
        Natural frequency, rad/s, and b, 1/s.
    load
        Constant load, m/s^2.
    lower, upper
        The stops, with laws for forces per unit mass; None for none.
    intensity
        Intensity S0 of the white noise, m^2/s^3.
    tables, filters
        The coloured noise: one-sided densities, (m/s^2)^2/Hz, and filtered noise.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> gap = Gap(
    ...     omega=2.0, damping_rate=0.1, load=1.0,
    ...     upper=Stop(UPPER, 3.0, Restitution(coefficient=0.8)),
    ... )
    >>> gap.mirrored().lower.position, gap.scaled(origin=1.0, length=2.0, speed=4.0).upper.position
    (-3.0, 1.0)
    """

    omega: float
    damping_rate: float
    load: float
    lower: Stop | None = None
    upper: Stop | None = None
    intensity: float = 0.0
    tables: tuple[Table, ...] = ()
    filters: tuple[Filter, ...] = ()

    @classmethod
    def of(cls, model: Model) -> Self:
        """The gap of a model of one oscillator."""
        return cls(
            omega=model.omega,
            damping_rate=model.damping_rate,
            load=model.load,
            lower=model.lower,
            upper=model.upper,
            intensity=model.intensity,
            tables=model.acceleration_tables,
            filters=model.filters,
        )

    @classmethod
    def of_pair(cls, pair: Pair, *, omega: float, damping_rate: float, load: float) -> Self:
        """The gap of an impact pair, held as by one spring of the natural frequency `omega`."""
        stops = {stop.side: stop.per_unit_mass(pair.mass) for stop in pair.stops}
        return cls(
            omega=omega,
            damping_rate=damping_rate,
            load=load,
            lower=stops.get(LOWER),
            upper=stops.get(UPPER),
        )

    @property
    def stops(self) -> tuple[Stop, ...]:
        """The stops that there are, the lower one first."""
        return tuple(stop for stop in (self.lower, self.upper) if stop is not None)

    @property
    def soft(self) -> bool:
        """Whether any stop is compliant."""
        return not all(stop.rigid for stop in self.stops)

    @property
    def elastic(self) -> bool:
        """Whether no stop loses energy."""
        return all(stop.law.conservative for stop in self.stops)

    @property
    def coloured(self) -> bool:
        """Whether any noise is not white."""
        return bool(self.tables or self.filters)

    @property
    def ends(self) -> tuple[float | None, float | None]:
        """Positions of the two stops, m; None where there is no stop."""
        return (
            None if self.lower is None else self.lower.position,
            None if self.upper is None else self.upper.position,
        )

    @property
    def walls(self) -> tuple[float | None, float | None]:
        """Positions of the rigid stops, m; None on a side whose stop is compliant or missing."""
        lower, upper = self.lower, self.upper
        return (
            lower.position if lower is not None and lower.rigid else None,
            upper.position if upper is not None and upper.rigid else None,
        )

    @property
    def width(self) -> float:
        """Distance between the stops, m; infinite unless there are two."""
        if self.lower is None or self.upper is None:
            return math.inf
        return self.upper.position - self.lower.position

    def mirrored(self) -> Self:
        """The same gap with x pointing the other way."""
        return replace(
            self,
            load=-self.load,
            lower=None if self.upper is None else _mirrored(self.upper),
            upper=None if self.lower is None else _mirrored(self.lower),
        )

    def from_rest(self, rest: float) -> Self:
        """The same gap with x measured from the rest position, m, which takes the load."""
        return replace(
            self,
            load=0.0,
            lower=self.lower and _moved(self.lower, rest),
            upper=self.upper and _moved(self.upper, rest),
        )

    def scaled(self, *, origin: float, length: float, speed: float) -> Self:
        """The same gap with x measured from `origin`, in units of length (m) and speed (m/s)."""
        time = length / speed
        return replace(
            self,
            omega=self.omega * time,
            damping_rate=self.damping_rate * time,
            intensity=self.intensity * time / speed**2,
            tables=tuple(
                Table(
                    frequency_hz=table.frequency_hz * time, density=table.density * time / speed**2
                )
                for table in self.tables
            ),
            filters=tuple(
                Filter(
                    noise.omega * time, noise.damping_rate * time, noise.intensity * time / speed**2
                )
                for noise in self.filters
            ),
            load=(self.load - self.omega**2 * origin) * time / speed,
            lower=self.lower and _scaled(self.lower, origin, length, time),
            upper=self.upper and _scaled(self.upper, origin, length, time),
        )


def _mirrored(stop: Stop) -> Stop:
    return Stop(-stop.side, -stop.position, stop.law)


def _moved(stop: Stop, origin: float) -> Stop:
    return replace(stop, position=stop.position - origin)


def _scaled(stop: Stop, origin: float, length: float, time: float) -> Stop:
    return Stop(stop.side, (stop.position - origin) / length, stop.law.scaled(length, time))
