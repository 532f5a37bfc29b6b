"""From the few numbers that a deterministic method computes to the `Response` it returns."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

from stochvi.collisions import StopStatistics
from stochvi.estimates import Cost, Estimate, Response, provenance
from stochvi.identities import residuals
from stochvi.notes import scene_notes
from stochvi.scenes import Scene, System
from stochvi.spectra import response_moments


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Stationary moments, in SI units per unit mass, as a deterministic method finds them.

    The three rates that a method has no law for are None in the `StopStatistics`. `errors`, where
    a method can tell them, holds a bound on the error of each number in the place of the number.
    """

    mean: float
    variance: float
    velocity_mean_square: float
    upcrossing_rate: float
    lower: StopStatistics
    upper: StopStatistics
    acceleration_mean_square: float | None = None
    errors: Answer | None = None

    def response(
        self,
        method: str,
        scene: Scene,
        *,
        how: str,
        started: float,
        bias: float | None = 0.0,
        assumptions: Sequence[str] = (),
        speed_threshold: float = 0.0,
    ) -> Response:
        """The answer in the form that every method returns; `bias` holds where `errors` do not."""

        system = scene.system()
        biases = self._biases()

        def estimate(name: str, value: float | None) -> Estimate | None:
            if value is None:
                return None
            return Estimate(value=value, bias=biases.get(name, bias), how=how)

        acceleration = self.acceleration_mean_square
        values = {
            "displacement_mean": self.mean,
            "displacement_std": math.sqrt(self.variance),
            "displacement_mean_square": self.mean**2 + self.variance,
            "velocity_std": math.sqrt(self.velocity_mean_square),
            "velocity_mean_square": self.velocity_mean_square,
            "acceleration_std": None if acceleration is None else math.sqrt(acceleration),
            "upcrossing_rate": self.upcrossing_rate,
        }
        coordinate = {name: estimate(name, value) for name, value in values.items()}
        values = {
            "collision_rate": _total(self.lower.rate, self.upper.rate),
            "collision_rate_lower": None if system.lower is None else self.lower.rate,
            "collision_rate_upper": None if system.upper is None else self.upper.rate,
            "impact_speed_mean": self._speed_mean(),
            "impact_speed_rate": _total(self.lower.speed_rate, self.upper.speed_rate),
            "impact_speed_square_rate": _total(
                self.lower.speed_square_rate, self.upper.speed_square_rate
            ),
            "peak_force": None,
        }
        pair = {name: estimate(name, value) for name, value in values.items()}
        return Response(
            method=method,
            coordinates={"x": coordinate},
            impact_pairs={
                entry.name: {**pair, "speed_threshold": speed_threshold}
                for entry in scene.impact_pairs
            },
            effects=scene.effects(),
            assumptions=[*scene.assumptions(), *assumptions],
            cost=Cost(wall_time=time.perf_counter() - started),
            warnings=scene_notes(system),
            provenance=provenance(scene.document()),
            identities=self._identities(system, how),
        )

    def _speed_mean(self) -> float | None:
        speed_rate = _total(self.lower.speed_rate, self.upper.speed_rate)
        rate = _total(self.lower.rate, self.upper.rate)
        return speed_rate / rate if speed_rate is not None and rate else None

    def _biases(self) -> dict[str, float]:
        """Bounds on the errors of the quantities of a response, from those of this answer."""
        errors = self.errors
        if errors is None:
            return {}
        found = {
            "displacement_mean": errors.mean,
            "displacement_std": errors.variance / (2.0 * math.sqrt(self.variance)),
            "displacement_mean_square": 2.0 * abs(self.mean) * errors.mean + errors.variance,
            "velocity_std": errors.velocity_mean_square
            / (2.0 * math.sqrt(self.velocity_mean_square)),
            "velocity_mean_square": errors.velocity_mean_square,
            "upcrossing_rate": errors.upcrossing_rate,
            "collision_rate": _total(errors.lower.rate, errors.upper.rate),
            "collision_rate_lower": errors.lower.rate,
            "collision_rate_upper": errors.upper.rate,
            "impact_speed_rate": _total(errors.lower.speed_rate, errors.upper.speed_rate),
            "impact_speed_square_rate": _total(
                errors.lower.speed_square_rate, errors.upper.speed_square_rate
            ),
        }
        speed = self._speed_mean()
        rate, speed_rate = found["collision_rate"], found["impact_speed_rate"]
        hits = _total(self.lower.rate, self.upper.rate)
        if speed is not None and hits and rate is not None and speed_rate is not None:
            found["impact_speed_mean"] = (speed_rate + speed * rate) / hits
        return {name: error for name, error in found.items() if error is not None}

    def _identities(self, system: System, how: str) -> dict[str, Estimate]:
        moments = self._moments()
        if moments is None:
            return {}
        found = residuals(system, moments)
        bounds = dict.fromkeys(found, 0.0)
        errors = self.errors._moments() if self.errors is not None else None
        for name, error in (errors or {}).items():
            moved = residuals(system, {**moments, name: moments[name] + error})
            for balance, value in moved.items():
                bounds[balance] += abs(value - found[balance])
        return {
            name: Estimate(value=value, bias=bounds[name], how=how) for name, value in found.items()
        }

    def _moments(self) -> dict[str, float] | None:
        """What the balances are about; None if a rate is missing."""
        sums = (self.lower.speed_rate, self.upper.speed_rate)
        squares = (self.lower.speed_square_rate, self.upper.speed_square_rate)
        if None in sums or None in squares:
            return None
        return {
            "x": self.mean,
            "variance": self.variance,
            "vv": self.velocity_mean_square,
            "f1_lower": sums[0],
            "f1_upper": sums[1],
            "f2_lower": squares[0],
            "f2_upper": squares[1],
        }


def _total(lower: float | None, upper: float | None) -> float | None:
    return None if lower is None or upper is None else lower + upper


def linear_acceleration(system: System) -> float | None:
    """Mean square absolute acceleration of the mass where it is finite: no rigid stops, no
    white noise on the mass itself (m^2/s^4)."""
    if system.lower is not None or system.upper is not None:
        return None
    if system.moving_base and not system.noise_on_mass:
        theta = system.intensity / (2.0 * system.damping_rate)
        white = theta * (system.damping_rate**2 + system.omega**2)
        return (
            white
            + response_moments(
                system.tables, system.omega, system.damping_rate
            ).absolute_acceleration
        )
    return None
