"""Linear screening of a structure of several coordinates or pairs: every coordinate, every gap."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from stochvi.mathematics.impact_rates import rice_rate
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.model.free_motion import FreeMotion, free_motion
from stochvi.model.modal import absolute_accelerations
from stochvi.model.model import Model, model_of
from stochvi.results.base import COMMON, Result
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import provenance
from stochvi.scenes.rigid_body import AXES, RigidBody
from stochvi.scenes.scene import Scene


@dataclass(frozen=True, kw_only=True)
class CoordinateScreening:
    """The stationary motion of a coordinate or of a named point, without stops (SI units).

    Parameters
    ----------
    displacement_std, velocity_std
        Standard deviations, m and m/s (rad and rad/s of a rotation), relative to the base where it
        moves.
    acceleration_std
        Standard deviation of the absolute acceleration, m/s^2 (rad/s^2); None where noise acts on
        the masses themselves.
    zero_crossing_rate
        Up-crossings of the mean per second; None where nothing moves.
    """

    displacement_std: float
    velocity_std: float
    acceleration_std: float | None
    zero_crossing_rate: float | None


@dataclass(frozen=True, kw_only=True)
class GapScreening:
    """The stationary motion of the gap of an impact pair, without stops (SI units).

    Parameters
    ----------
    displacement_std, velocity_std
        Standard deviations of the gap and of its rate, m and m/s.
    mean
        Mean gap under constant loads, m.
    three_sigma
        Three times the rms, m: the clearance that the rule of thumb gives.
    three_sigma_rate
        Hits per second on both stops there, as if hits changed nothing (Rice).
    stops
        Distance of each stop of the scene from the mean gap, m, by "lower" and "upper".
    rice_rate
        Hits per second on these stops, as if hits changed nothing.
    """

    displacement_std: float
    velocity_std: float
    mean: float
    three_sigma: float
    three_sigma_rate: float
    stops: Mapping[str, float]
    rice_rate: float

    def rate_at(self, clearance: float) -> float:
        """Hits per second on the stops of the pair, each at this distance from the mean gap, m, as
        if hits changed nothing (Rice)."""
        place, speed = self.displacement_std, self.velocity_std
        return len(self.stops) * rice_rate(clearance, place, speed) if place else 0.0


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StructureScreening(Result):
    """Response of a structure without stops by linear theory: each coordinate and point, each gap.

    See Also
    --------
    stochvi.screen : What makes it.
    """

    not_in_document = COMMON

    coordinates: Mapping[str, CoordinateScreening]
    impact_pairs: Mapping[str, GapScreening]
    rotations: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def to_frame(self) -> pd.DataFrame:
        """A row per coordinate and point: millimetres and g; thousandths of a radian, and rad/s^2,
        of a rotation."""
        return pd.DataFrame([self._row(name, each) for name, each in self.coordinates.items()])

    def _row(self, name: str, each: CoordinateScreening) -> dict[str, str | float | None]:
        turns = name in self.rotations
        acceleration = each.acceleration_std
        if acceleration is not None and not turns:
            acceleration /= STANDARD_GRAVITY
        return {
            "coordinate": name,
            "displacement": 1e3 * each.displacement_std,
            "unit": "mrad rms" if turns else "mm rms",
            "velocity": each.velocity_std,
            "unit of velocity": "rad/s rms" if turns else "m/s rms",
            "absolute acceleration": acceleration,
            "unit of acceleration": "rad/s^2 rms" if turns else "g rms",
            "zero up-crossings (Hz)": each.zero_crossing_rate,
        }

    def gaps_to_frame(self) -> pd.DataFrame:
        """A row per pair: millimetres, and hits per hour by Rice."""
        return pd.DataFrame(
            [
                {
                    "pair": name,
                    "gap (mm rms)": 1e3 * gap.displacement_std,
                    "3 sigma (mm)": 1e3 * gap.three_sigma,
                    "hits on it per hour": 3600.0 * gap.three_sigma_rate,
                    "its stops (mm)": " and ".join(
                        f"{1e3 * distance:.4g}" for distance in gap.stops.values()
                    ),
                    "hits on them per hour": 3600.0 * gap.rice_rate,
                }
                for name, gap in self.impact_pairs.items()
            ]
        )

    def summary(self) -> str:
        """What the two tables hold, in words."""
        return "linear screening, stops left out"

    def _remarks(self) -> Sequence[str]:
        return (*self.notes, *self.warnings)


def screen_structure(scene: Scene) -> StructureScreening:
    """Linear screening of a structure of any number of coordinates and pairs.

    The covariance of all coordinates is that of a Lyapunov equation for white and filtered noise,
    and an integral over frequency for tables.

    Raises
    ------
    NotApplicable
        If the motion without stops is not a stationary Gaussian process.
    """
    model = model_of(scene)
    try:
        motion = free_motion(model)
    except NotApplicable as reason:
        raise NotApplicable("screening", reason.conditions) from reason
    places, speeds = motion.deviations(model.output_rows)
    accelerations = _accelerations(model, motion)
    gaps = np.array([pair.direction for pair in model.pairs]).reshape(-1, len(model.coordinates))
    own_places, own_speeds = motion.deviations(gaps)
    means = motion.modes.gaps @ motion.modes.rest
    turning = isinstance(scene.structure, RigidBody)
    return StructureScreening(
        coordinates={
            name: CoordinateScreening(
                displacement_std=float(place),
                velocity_std=float(speed),
                acceleration_std=acceleration,
                zero_crossing_rate=float(speed / place / (2.0 * math.pi)) if place else None,
            )
            for name, place, speed, acceleration in zip(
                model.outputs, places, speeds, accelerations, strict=True
            )
        },
        impact_pairs={
            pair.name: _gap(
                float(place),
                float(speed),
                float(mean),
                {stop.name: stop.side * (stop.position - float(mean)) for stop in pair.stops},
            )
            for pair, place, speed, mean in zip(
                model.pairs, own_places, own_speeds, means, strict=True
            )
        },
        rotations=tuple(f"r{axis}" for axis in AXES) if turning else (),
        notes=tuple(model.cautions),
        provenance=provenance(scene.document()),
    )


def _gap(place: float, speed: float, mean: float, stops: dict[str, float]) -> GapScreening:
    def rate(distance: float) -> float:
        return rice_rate(distance, place, speed) if place else 0.0

    return GapScreening(
        displacement_std=place,
        velocity_std=speed,
        mean=mean,
        three_sigma=3.0 * place,
        three_sigma_rate=2.0 * rate(3.0 * place),
        stops=stops,
        rice_rate=sum(rate(distance) for distance in stops.values()),
    )


def _accelerations(model: Model, motion: FreeMotion) -> list[float | None]:
    """Standard deviations of the absolute accelerations of all outputs; None where noise acts on
    the masses themselves."""
    if not model.base_alone_moves:
        return [None] * len(model.outputs)
    squares = absolute_accelerations(motion.modes, motion.law, model.output_rows)
    return [math.sqrt(max(float(square), 0.0)) for square in squares]
