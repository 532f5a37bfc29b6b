"""From the few numbers that a deterministic method computes to the `Response` it returns."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

from stochvi.assemblies import assemble
from stochvi.collisions import StopStatistics
from stochvi.estimates import Cost, Estimate, Response, provenance
from stochvi.identities import residuals
from stochvi.notes import scene_notes
from stochvi.scenes import Scene, System
from stochvi.spectra import response_moments


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Stationary moments, in SI units per unit mass, as a deterministic method finds them.

    The three rates that a method has no law for are None in the `StopStatistics`.
    """

    mean: float
    variance: float
    velocity_mean_square: float
    upcrossing_rate: float
    lower: StopStatistics
    upper: StopStatistics
    acceleration_mean_square: float | None = None

    def response(
        self,
        method: str,
        scene: Scene,
        *,
        how: str,
        started: float,
        bias: float | None = 0.0,
        assumptions: Sequence[str] = (),
    ) -> Response:
        """The answer in the form that every method returns."""

        system = scene.system()

        def estimate(value: float | None) -> Estimate | None:
            return None if value is None else Estimate(value=value, bias=bias, how=how)

        acceleration = self.acceleration_mean_square
        coordinate = {
            "displacement_mean": estimate(self.mean),
            "displacement_std": estimate(math.sqrt(self.variance)),
            "displacement_mean_square": estimate(self.mean**2 + self.variance),
            "velocity_std": estimate(math.sqrt(self.velocity_mean_square)),
            "velocity_mean_square": estimate(self.velocity_mean_square),
            "acceleration_std": estimate(None if acceleration is None else math.sqrt(acceleration)),
            "upcrossing_rate": estimate(self.upcrossing_rate),
        }
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
        pair = {name: estimate(value) for name, value in values.items()}
        return Response(
            method=method,
            coordinates={"x": coordinate},
            impact_pairs={
                entry.name: {**pair, "speed_threshold": 0.0} for entry in scene.impact_pairs
            },
            effects=scene.effects(),
            assumptions=[*scene.assumptions(), *assumptions],
            cost=Cost(wall_time=time.perf_counter() - started),
            warnings=scene_notes(system),
            provenance=provenance(scene.document()),
            identities=self._identities(scene, how),
        )

    def _speed_mean(self) -> float | None:
        speed_rate = _total(self.lower.speed_rate, self.upper.speed_rate)
        rate = _total(self.lower.rate, self.upper.rate)
        return speed_rate / rate if speed_rate is not None and rate else None

    def _identities(self, scene: Scene, how: str) -> dict[str, Estimate]:
        sums = (self.lower.speed_rate, self.upper.speed_rate)
        squares = (self.lower.speed_square_rate, self.upper.speed_square_rate)
        if None in sums or None in squares:
            return {}
        moments: dict[tuple[str, str], float] = {
            ("x", "x"): self.mean,
            ("x", "variance"): self.variance,
            ("x", "vv"): self.velocity_mean_square,
        }
        for pair in scene.impact_pairs:
            moments |= {
                (pair.name, "f1_lower"): sums[0],
                (pair.name, "f1_upper"): sums[1],
                (pair.name, "f2_lower"): squares[0],
                (pair.name, "f2_upper"): squares[1],
            }
        found = residuals(assemble(scene), moments, (self.mean,))
        return {name: Estimate(value=value, how=how) for name, value in found.items()}


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
