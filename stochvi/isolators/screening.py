"""Linear screening: every coordinate, point and gap of a scene, stops left out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from stochvi.isolators.record_verdict import RecordVerdict, record_verdict
from stochvi.mathematics.moving_means import MovingMean, Sines
from stochvi.mathematics.shown_units import (
    ACCELERATION,
    HOURLY,
    LENGTH,
    MILLIRADIANS,
    SPEED,
    shown_as,
)
from stochvi.mathematics.units import density_from_intensity
from stochvi.model.calculations import calculation
from stochvi.model.cautions import scene_notes
from stochvi.model.free_motion import FreeMotion, free_motion
from stochvi.model.modal import absolute_accelerations
from stochvi.model.model import Model, model_of
from stochvi.results.base import COMMON, Result
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import provenance
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.rigid_body import AXES, RigidBody
from stochvi.statistics.free_windows import has_fast_peaks, without_peaks

OF_PEAKS = (
    "noise with fast peaks has the rms motion of Gaussian noise, for which impacts are counted "
    "here; size and reliability count its own"
)
"""What a screening says beside a kurtosis."""


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
    sines
        Frequency (Hz) and amplitude (m; rad) of each sine, whose mean square is a part of the
        others.
    """

    displacement_std: float
    velocity_std: float
    acceleration_std: float | None
    zero_crossing_rate: float | None
    sines: tuple[tuple[float, float], ...] = ()


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
        Impacts per second on both stops there, as if impacts changed nothing (Rice).
    stops
        Distance of each stop of the scene from the mean gap, m, by "lower" and "upper".
    rice_rate
        Impacts per second on these stops, as if impacts changed nothing.
    sines
        Frequency (Hz) and amplitude (m) of each sine, whose mean square is a part of those above.
    """

    displacement_std: float
    velocity_std: float
    mean: float
    three_sigma: float
    three_sigma_rate: float
    stops: Mapping[str, float]
    rice_rate: float
    sines: tuple[tuple[float, float], ...] = ()

    def rate_at(self, clearance: float) -> float:
        """Impacts per second on the stops of the pair, each at this distance from the mean gap, m,
        as if impacts changed nothing (Rice)."""
        place, speed = self.displacement_std, self.velocity_std
        return len(self.stops) * _rate(clearance, place, speed, self.sines)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Screening(Result):
    """Response without stops by linear theory: each coordinate and point, each gap.

    One mass is the case of one coordinate; its numbers are properties of the screening, too.

    Parameters
    ----------
    coordinates
        The motion of each coordinate and named point.
    impact_pairs
        The gap of each impact pair.
    rotations
        Names of the coordinates that are rotations, in rad.
    input_acceleration_std
        rms of the acceleration of the base of one mass, m/s^2; None where it is infinite (white
        noise), where the mass itself is shaken, and for several coordinates.
    miles
        Miles' equation for the absolute acceleration of one mass, m/s^2; None where it does not
        apply: the density at the natural frequency is 0, although the response is not, or the
        noise is filtered.
    notes
        Warnings in words.
    record
        The verdict on a measured record that shakes one mass; None without one.

    See Also
    --------
    stochvi.screen : The calculation.
    """

    not_in_document = COMMON

    coordinates: Mapping[str, CoordinateScreening]
    impact_pairs: Mapping[str, GapScreening]
    rotations: tuple[str, ...] = ()
    input_acceleration_std: float | None = None
    miles: float | None = None
    notes: tuple[str, ...] = ()
    record: RecordVerdict | None = None

    @property
    def only(self) -> CoordinateScreening:
        """The motion of the only coordinate; `NotApplicable` where there are several."""
        if len(self.coordinates) > 1:
            named = ", ".join(self.coordinates)
            raise NotApplicable("screening", [f"coordinates must be named, got several: {named}"])
        (found,) = self.coordinates.values()
        return found

    @property
    def displacement_std(self) -> float:
        """rms displacement of the only coordinate, m."""
        return self.only.displacement_std

    @property
    def velocity_std(self) -> float:
        """rms velocity of the only coordinate, m/s."""
        return self.only.velocity_std

    @property
    def acceleration_std(self) -> float | None:
        """rms absolute acceleration of the only coordinate, m/s^2."""
        return self.only.acceleration_std

    @property
    def zero_crossing_rate(self) -> float | None:
        """Up-crossings of the mean by the only coordinate, 1/s."""
        return self.only.zero_crossing_rate

    def rice_rate(self, clearance: float) -> float:
        """Impacts per second on two stops at +-clearance from the mean of the only coordinate, as
        if impacts changed nothing (Rice)."""
        sines = self.only.sines
        return 2.0 * _rate(clearance, self.displacement_std, self.velocity_std, sines)

    def to_frame(self) -> pd.DataFrame:
        """A table for people: a row per coordinate and point (millimetres and g unless other units
        are shown; thousandths of a radian, and rad/s^2, of a rotation), or the numbers of the only
        one in rows."""
        if len(self.coordinates) == 1:
            return self._only_in_rows()
        return pd.DataFrame([self._row(name, each) for name, each in self.coordinates.items()])

    def _only_in_rows(self) -> pd.DataFrame:
        sigma = self.displacement_std
        rate = HOURLY(self.rice_rate(3.0 * sigma))
        rows = [
            (
                "input acceleration",
                ACCELERATION(self.input_acceleration_std),
                f"{ACCELERATION} rms",
            ),
            ("relative displacement", LENGTH(sigma), f"{LENGTH} rms"),
            *(
                (f"of it the sine of {hertz:.4g} Hz", LENGTH(amplitude), f"{LENGTH} peak")
                for hertz, amplitude in self.only.sines
            ),
            ("relative velocity", SPEED(self.velocity_std), f"{SPEED} rms"),
            ("absolute acceleration", ACCELERATION(self.acceleration_std), f"{ACCELERATION} rms"),
            ("Miles' equation for it", ACCELERATION(self.miles), f"{ACCELERATION} rms"),
            ("zero up-crossings", self.zero_crossing_rate, "Hz"),
            ("3 sigma clearance, per side", LENGTH(3.0 * sigma), str(LENGTH)),
            ("impacts on it by Rice, both sides", rate, f"per {HOURLY.time}"),
        ]
        known = [row for row in rows if row[1] is not None]
        return pd.DataFrame(known, columns=["quantity", "value", "unit"])

    def _row(self, name: str, each: CoordinateScreening) -> dict[str, str | float | None]:
        shown = MILLIRADIANS, shown_as("rad/s"), shown_as("rad/s^2")
        length, speed, acceleration = (
            shown if name in self.rotations else (LENGTH, SPEED, ACCELERATION)
        )
        return {
            "coordinate": name,
            "displacement": length(each.displacement_std),
            "unit": f"{length} rms",
            "velocity": speed(each.velocity_std),
            "unit of velocity": f"{speed} rms",
            "absolute acceleration": acceleration(each.acceleration_std),
            "unit of acceleration": f"{acceleration} rms",
            "zero up-crossings (Hz)": each.zero_crossing_rate,
        }

    def gaps_to_frame(self) -> pd.DataFrame:
        """A row per pair: millimetres, and impacts per hour by Rice, unless other units are
        shown."""
        return pd.DataFrame(
            [
                {
                    "pair": name,
                    f"gap rms ({LENGTH})": LENGTH(gap.displacement_std),
                    f"3 sigma ({LENGTH})": LENGTH(gap.three_sigma),
                    f"impacts on it per {HOURLY.time}": HOURLY(gap.three_sigma_rate),
                    f"its stops ({LENGTH})": " and ".join(
                        f"{LENGTH(distance):.4g}" for distance in gap.stops.values()
                    ),
                    f"impacts on them per {HOURLY.time}": HOURLY(gap.rice_rate),
                }
                for name, gap in self.impact_pairs.items()
            ]
        )

    def summary(self) -> str:
        """The numbers of the tables in words; a record that does not agree with them is named
        first."""
        text = "linear screening, stops left out"
        if self.record is not None and not self.record.agrees:
            return f"{self.record.sentence()}; {text}"
        return text

    def _remarks(self) -> Sequence[str]:
        return (*self.notes, *self.warnings)

    def _document(self) -> dict[str, Any]:
        """The document, in which the numbers of an only coordinate stand at the top, too."""
        only = vars(self.only) if len(self.coordinates) == 1 else {}
        return {**super()._document(), **only}


@calculation
def screen(
    scene: Scene,
    *,
    budget: float | None = None,
) -> Screening:
    """Linear screening of a scene, stops left out.

    The covariance of all coordinates is that of a Lyapunov equation for white and filtered noise,
    and an integral over frequency for tables. Sines of random phases add to it, and Rice's rates
    are averages over their phases. For an isolator on its moving base Miles' equation,
    G_rms = sqrt(pi / 2 f_n Q W(f_n)), is listed with the absolute acceleration.

    Parameters
    ----------
    scene
        One mass or a structure, with any number of impact pairs.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    Screening
        The motion of each coordinate, named point and gap.

    Raises
    ------
    NotApplicable
        If the motion without stops is not a stationary Gaussian process beside sines.

    See Also
    --------
    stochvi.size : The clearance that is needed.
    stochvi.isolators.clearance_curve : Impact rates over clearances.

    Examples
    --------
    >>> from stochvi.scenes.excitations import TabulatedNoise
    >>> from stochvi.scenes.structures import Isolator
    >>> truck = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    >>> mount = Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[truck])
    >>> round(1e3 * screen(mount).displacement_std, 2)
    1.99
    """
    return screened(scene)


def screened(scene: Scene) -> Screening:
    """The answer of `screen`, for calculations that need it on their way."""
    stated = model_of(scene)
    model = without_peaks(stated)
    try:
        motion = free_motion(model, with_sines=True)
    except NotApplicable as reason:
        raise NotApplicable("screening", reason.conditions) from reason
    moved = motion.moving_means(model.output_rows)
    accelerations = _accelerations(model, motion)
    gaps = np.array([pair.direction for pair in model.pairs]).reshape(-1, len(model.coordinates))
    shaken, miles = _one_axis(model)
    return Screening(
        coordinates={
            name: CoordinateScreening(
                displacement_std=each.deviations[0],
                velocity_std=each.deviations[1],
                acceleration_std=acceleration,
                zero_crossing_rate=each.rate(0.0) if each.place else None,
                sines=_sines(each),
            )
            for name, each, acceleration in zip(model.outputs, moved, accelerations, strict=True)
        },
        impact_pairs={
            pair.name: _gap(
                each,
                float(mean),
                {stop.name: stop.side * (stop.position - float(mean)) for stop in pair.stops},
            )
            for pair, each, mean in zip(
                model.pairs, motion.moving_means(gaps), model.mean_gaps, strict=True
            )
        },
        rotations=tuple(f"r{axis}" for axis in AXES)
        if isinstance(scene.structure, RigidBody)
        else (),
        input_acceleration_std=shaken,
        miles=miles,
        notes=(
            *scene_notes(model),
            *scene.at_means(),
            *([OF_PEAKS] if has_fast_peaks(stated) else []),
        ),
        record=record_verdict(scene),
        provenance=provenance(scene.document()),
    )


def _one_axis(model: Model) -> tuple[float | None, float | None]:
    """The rms acceleration of the base of one mass, and Miles' equation for that of the mass; None
    where they do not apply."""
    if model.rates is None or not model.moving_base or model.noise_on_mass or model.filters:
        return None, None
    omega, b, tables = model.omega, model.damping_rate, model.acceleration_tables
    density = density_from_intensity(model.intensity)
    density += sum(float(table(omega / (2.0 * math.pi))) for table in tables)
    # pi / 2 f_n Q W(f_n) with f_n = omega / (2 pi) and Q = omega / b
    miles = math.sqrt(math.pi / 2.0 * omega / (2.0 * math.pi) * omega / b * density)
    area = sum(table.mean_square() for table in tables)
    area += sum(0.5 * signal.amplitude**2 for signal in model.sines if signal.on_base)
    return None if model.intensity else math.sqrt(area), miles if density > 0.0 else None


def _sines(motion: MovingMean) -> tuple[tuple[float, float], ...]:
    """Frequency (Hz) and amplitude of each sine."""
    amplitudes = np.abs(motion.sines.waves[0])
    frequencies = motion.sines.omega / (2.0 * math.pi)
    return tuple(zip(frequencies.tolist(), amplitudes.tolist(), strict=True))


def _rate(
    distance: float, place: float, speed: float, sines: Sequence[tuple[float, float]]
) -> float:
    """Up-crossings per second of a level (Rice), from deviations in which the sines are; 0 where
    noise moves nothing."""
    omega = 2.0 * math.pi * np.array([hertz for hertz, _ in sines])
    moved = Sines(omega, np.array([[amplitude for _, amplitude in sines]], complex))
    squares = [float(each[0]) for each in moved.mean_squares]
    noise = [
        math.sqrt(max(std**2 - own, 0.0)) for std, own in zip((place, speed), squares, strict=True)
    ]
    return MovingMean(noise[0], noise[1], moved).rate(distance) if noise[0] else 0.0


def _gap(motion: MovingMean, mean: float, stops: dict[str, float]) -> GapScreening:
    place, speed = motion.deviations

    def rate(distance: float) -> float:
        return motion.rate(distance) if motion.place else 0.0

    return GapScreening(
        sines=_sines(motion),
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
