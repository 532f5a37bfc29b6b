"""Linear screening of a scene, stops left out. Chapters: stops at given clearances; excitation and
motion in numbers; a scene at rest; coordinates, points and gaps; impact rates against clearance by
Rice, moment closure and Monte Carlo."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Unpack

import numpy as np
import scipy
from numpy.typing import ArrayLike

from stochvi.isolators.record_verdict import RecordVerdict, record_verdict
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.spectra import Table, squared_gain
from stochvi.mathematics.units import (
    ACCELERATION,
    HOURLY,
    LENGTH,
    MILLIRADIANS,
    SPEED,
    density_from_intensity,
    shown_as,
)
from stochvi.mathematics.unsteady_noise import MovingMean, Sines
from stochvi.methods import linearisation
from stochvi.methods.monte_carlo import simulate
from stochvi.model.coverage import FreeMotion, at_rest, free_motion, natural_modes, scene_notes
from stochvi.model.modal import absolute_accelerations
from stochvi.model.model import Model, model_of
from stochvi.results.base import COMMON, DataFrame, Response, Result, frame_of
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import Estimate, count_of, provenance
from stochvi.sampling.calculations import AccuracyOptions, calculation
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.rigid_body import AXES, RigidBody
from stochvi.scenes.validation import moved
from stochvi.statistics.free_flights import linearised
from stochvi.statistics.trial_splitting import has_fast_peaks

# ------------------------------------------------------------------------------
# The stops of a scene, moved to given clearances.
# ------------------------------------------------------------------------------


def check_movable(scene: Scene) -> None:
    """`ValueError` for stops with a tolerance where a clearance is to be found: which of the two
    places it would be could not be told."""
    for pair in scene.impact_pairs:
        if pair.tolerance:
            raise ValueError(
                f"tolerance of the pair {pair.name} must be left out where a clearance is found, "
                f"got {pair.tolerance:g} m; add it to the clearance, or give it as "
                f"--tolerances clearance=uniform:{1e3 * pair.tolerance:g}mm"
            )


def at_clearances(scene: Scene, clearances: ArrayLike) -> Scene:
    """The scene with its stops moved to distances from the mean gaps, the laws of the stops kept.

    Parameters
    ----------
    clearances
        Metres: one number for all stops, one for each pair (pairs,), or those of the lower and of
        the upper stops (2, pairs). Infinite ones belong to stops that the
        scene does not have.
    """
    model, whole = model_of(scene), scene.expanded
    means = model.mean_gaps
    lower, upper = np.broadcast_to(np.asarray(clearances, dtype=float), (2, len(means))).tolist()
    pairs = [
        pair.model_copy(
            update={
                "lower": None if pair.lower is None else moved(pair.lower, mean - below),
                "upper": None if pair.upper is None else moved(pair.upper, mean + above),
            }
        )
        for pair, mean, below, above in zip(
            whole.impact_pairs, means.tolist(), lower, upper, strict=True
        )
    ]
    return whole.model_copy(update={"impact_pairs": tuple(pairs)})


# ------------------------------------------------------------------------------
# Excitation of an isolator and its motion without stops, as numbers for a report.
# ------------------------------------------------------------------------------


POINTS = 801
"""Number of frequencies of a curve over the whole input; those around the resonance are extra."""

RESONANCE_POINTS, RESONANCE_WIDTHS = 121, 3.0
"""Number of extra frequencies around the resonance, and how many half-power bandwidths they reach
to each side of it."""

WHITE_BAND = (0.05, 20.0)
"""Lowest and highest frequency, over the natural frequency, at which the response to white noise is
evaluated: outside of them lies less than 1 % of the mean square of a usual mount."""


@dataclass(frozen=True, kw_only=True)
class BaseMotion:
    """Motion of a base with a tabulated density: m/s^2, m/s and m rms.

    Velocity and displacement are those of the table alone, so the displacement depends on the
    lowest frequencies of the table.
    """

    acceleration_std: float
    velocity_std: float
    displacement_std: float


@dataclass(frozen=True, kw_only=True)
class Environment:
    """The excitation of an isolator and its transmission without stops, as numbers.

    Parameters
    ----------
    excitations
        Numbers of each excitation of the scene, in its order: what the scene file states in other
        units, or leaves to a profile or a file (SI units).
    base
        Motion of the base; None unless its acceleration is tabulated.
    spectra
        One row per frequency: `frequency_hz`, `base_density` ((m/s^2)^2/Hz, one-sided),
        `transmissibility` (absolute acceleration over that of the base, no stops) and the shares of
        the mean squares below the frequency, `displacement_share`, `velocity_share` and
        `acceleration_share`. None unless noise moves the base and nothing else shakes the mass.
    breakpoints
        `frequency_hz` and `base_density` of the table where the base has exactly one; else None.
    """

    as_columns = ("spectra", "breakpoints")

    excitations: tuple[Mapping[str, float], ...]
    base: BaseMotion | None
    spectra: DataFrame | None
    breakpoints: DataFrame | None


def environment(scene: Scene) -> Environment:
    """Describe what shakes an isolator and what its mount passes on without stops.

    Examples
    --------
    >>> from stochvi.scenes.excitations import TabulatedNoise
    >>> from stochvi.scenes.structures import Isolator
    >>> truck = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    >>> mount = Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[truck])
    >>> round(1e3 * environment(mount).base.displacement_std, 2)
    1.57
    """
    model = model_of(scene)
    tables, noisy = model.acceleration_tables, noise_on_base_alone(model)
    breakpoints = None
    if noisy and len(tables) == 1:
        breakpoints = frame_of(
            {"frequency_hz": tables[0].frequency_hz, "base_density": tables[0].density}
        )
    return Environment(
        excitations=tuple(excitation.numbers() for excitation in scene.excitations),
        base=_base_motion(tables) if noisy and tables and not model.intensity else None,
        spectra=_spectra(model) if noisy else None,
        breakpoints=breakpoints,
    )


def noise_on_base_alone(model: Model) -> bool:
    """Whether white or tabulated noise moves the base, and no noise or sine acts on the mass."""
    noisy = bool(model.acceleration_tables or model.intensity)
    return noisy and model.moving_base and not model.noise_on_mass


def _base_motion(tables: Sequence[Table]) -> BaseMotion:
    area = sum(table.mean_square() for table in tables)
    per = (2.0 * math.pi) ** 2
    velocity = sum(table.moment(-2.0) for table in tables) / per
    shift = sum(table.moment(-4.0) for table in tables) / per**2
    return BaseMotion(
        acceleration_std=math.sqrt(area),
        velocity_std=math.sqrt(velocity),
        displacement_std=math.sqrt(shift),
    )


def _spectra(model: Model) -> DataFrame:
    f = frequencies(model)
    base = input_density(model, f)
    passed = transmissibility(model, f)
    displacement = squared_gain(f, model.omega, model.damping_rate) * base
    return frame_of(
        {
            "frequency_hz": f,
            "base_density": base,
            "transmissibility": passed,
            "displacement_share": _share_below(f, displacement),
            "velocity_share": _share_below(f, (2.0 * np.pi * f) ** 2 * displacement),
            "acceleration_share": _share_below(f, passed**2 * base),
        }
    )


def _share_below(f: Vector, density: Vector) -> Vector:
    """Share of the area of a density below each frequency, by the trapezoidal rule."""
    areas = np.concatenate([[0.0], np.cumsum(np.diff(f) * (density[1:] + density[:-1]) / 2.0)])
    return np.asarray(areas / areas[-1])


def frequencies(model: Model) -> Vector:
    """A grid over the input and the resonance, Hz."""
    natural = model.omega / (2.0 * math.pi)
    low = min([float(table.frequency_hz[0]) for table in model.acceleration_tables], default=0.0)
    high = max([float(table.frequency_hz[-1]) for table in model.acceleration_tables], default=0.0)
    if model.intensity or not model.acceleration_tables:
        low, high = WHITE_BAND[0] * natural, max(high, WHITE_BAND[1] * natural)
    widths = np.linspace(-RESONANCE_WIDTHS, RESONANCE_WIDTHS, RESONANCE_POINTS)
    near = natural + model.damping_rate / math.pi * widths
    edges = [table.frequency_hz for table in model.acceleration_tables]
    grid = np.concatenate([np.geomspace(low, high, POINTS), near, *edges])
    return np.unique(grid[(grid >= low) & (grid <= high)])


def input_density(model: Model, frequency_hz: Vector) -> Vector:
    """One-sided density of the base acceleration, (m/s^2)^2/Hz."""
    total = np.full_like(frequency_hz, density_from_intensity(model.intensity))
    for table in model.acceleration_tables:
        total = total + table(frequency_hz)
    return total


def transmissibility(model: Model, frequency_hz: Vector) -> Vector:
    """Absolute acceleration over base acceleration, sqrt(omega^4 + b^2 w^2) |H|."""
    w2 = (2.0 * np.pi * frequency_hz) ** 2
    gain = squared_gain(frequency_hz, model.omega, model.damping_rate)
    return np.asarray(np.sqrt((model.omega**4 + model.damping_rate**2 * w2) * gain))


# ------------------------------------------------------------------------------
# What a page says of a scene at rest: natural frequencies, damping, and where its gaps hang.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class SceneAtRest:
    """Numbers of a scene without noise.

    Parameters
    ----------
    natural_frequency_hz
        The frequency of each mode without stops, Hz.
    damping_ratio
        That of one mass on its spring; None for several coordinates, or without a spring.
    gaps
        Where each gap rests under gravity and constant loads, by the name of its pair, m from the
        unloaded spring; empty without a load.
    """

    natural_frequency_hz: tuple[float, ...]
    damping_ratio: float | None
    gaps: Mapping[str, float]


def scene_at_rest(scene: Scene) -> SceneAtRest:
    """Return the numbers of a scene without noise.

    Examples
    --------
    >>> import stochvi
    >>> mount = stochvi.Isolator(mass=1.0, frequency_hz=12.0, zeta=0.1, gravity=True)
    >>> stops = stochvi.ImpactPair(clearance=0.01, law=stochvi.Restitution(coefficient=0.5))
    >>> noise = stochvi.WhiteNoise(density=0.01, unit="g2/Hz")
    >>> scene = stochvi.Scene(structure=mount, impact_pairs=[stops], excitations=[noise])
    >>> found = scene_at_rest(scene)
    >>> round(found.damping_ratio, 9), round(1e3 * found.gaps["stops"], 3)
    (0.1, -1.725)
    """
    model = model_of(scene)
    modes = natural_modes(model)
    one_mass = model.rates is not None and model.omega > 0.0
    return SceneAtRest(
        natural_frequency_hz=tuple(mode.frequency_hz for mode in modes),
        damping_ratio=0.5 * model.damping_rate / model.omega if one_mass else None,
        gaps={name: gap.position for name, gap in at_rest(model)[1].items()},
    )


# ------------------------------------------------------------------------------
# Linear screening: every coordinate, point and gap of a scene, stops left out.
# ------------------------------------------------------------------------------


OF_PEAKS = (
    "noise with fast peaks has the rms motion of Gaussian noise, for which impacts are counted "
    "here; size and reliability count its own"
)
"""What a screening says beside a kurtosis."""

LINEARISED = (
    "the mount is linearised at its own rms motion, which tells little of rare impacts; clearance "
    "counts impacts on the mount itself, and size and reliability find rare ones"
)
"""What a screening says of a spring or damper that is a function."""


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

    kind = "screen"

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
            raise NotApplicable("screening", f"coordinates must be named, got several: {named}")
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

    def to_frame(self) -> DataFrame:
        """A table for people: a row per coordinate and point (millimetres and g unless other units
        are shown; thousandths of a radian, and rad/s^2, of a rotation), or the numbers of the only
        one in rows."""
        return frame_of(self.rows())

    def rows(self) -> list[dict[str, str | float | None]]:
        """The rows of that table."""
        if len(self.coordinates) > 1:
            return [self._row(name, each) for name, each in self.coordinates.items()]
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
        names = ("quantity", "value", "unit")
        return [dict(zip(names, row, strict=True)) for row in rows if row[1] is not None]

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

    def rows_of_gaps(self) -> list[dict[str, str | float]]:
        """The rows of that table."""
        return [
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

    def summary(self) -> str:
        """The numbers of the tables in words; a record that does not agree with them is named
        first."""
        if self.record is not None and not self.record.agrees:
            return f"{self.record.headline()}; {self.motion_in_words()}"
        return self.motion_in_words()

    def motion_in_words(self) -> str:
        """The motion without stops."""
        if len(self.coordinates) > 1:
            return self._of_several()
        rms, often = self.displacement_std, self.zero_crossing_rate
        hertz = "" if often is None else f", {often:.3g} Hz"
        return (
            f"{LENGTH.text(rms, '.3g')} rms{hertz}; three sigma {LENGTH.text(3.0 * rms, '.3g')}, "
            f"{_passed(self.rice_rate(3.0 * rms))}"
        )

    def _of_several(self) -> str:
        shifts = {n: c.displacement_std for n, c in self.coordinates.items()}
        gaps = {name: gap.three_sigma for name, gap in self.impact_pairs.items()}
        most = [
            f"{words}{LENGTH.text(found[name], '.3g')} ({name})"
            for words, found in (("rms up to ", shifts), ("three sigma of gaps up to ", gaps))
            if (name := max(set(found) - set(self.rotations), key=found.__getitem__, default=None))
        ]
        return f"{len(self.coordinates)} coordinates and points, {'; '.join(most)}"

    def stops_in_words(self) -> list[str]:
        """How often the stops that are passed most are passed; empty without stops."""
        if not self.impact_pairs:
            return []
        name, gap = max(self.impact_pairs.items(), key=lambda each: each[1].rice_rate)
        where = f" at {name}" if len(self.impact_pairs) > 1 else ""
        return [f"Your stops{where}: {_passed(gap.rice_rate)}"]

    def _remarks(self) -> Sequence[str]:
        return (*self.notes, *self.warnings)

    def _document(self) -> dict[str, Any]:
        """The document, in which the numbers of an only coordinate stand at the top, too."""
        only = vars(self.only) if len(self.coordinates) == 1 else {}
        return {**super()._document(), **only}


HARDLY_EVER = 1e-9
"""Crossings an hour, one in 100,000 years, below which none is spoken of: no noise is Gaussian as
far as that."""


def _passed(rate: float) -> str:
    """How often a level is passed, 1/s, by Rice, in words."""
    if 3600.0 * rate < HARDLY_EVER:
        return "practically never passed (Rice)"
    each = "an" if HOURLY.time == "hour" else "a"
    return f"passed {count_of(HOURLY(rate))} times {each} {HOURLY.time} (Rice)"


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
    try:
        model = linearised(stated)
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
            *([LINEARISED] if stated.functions else []),
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


# ------------------------------------------------------------------------------
# Impact rates against clearance: by Rice, by the moment closure, and by Monte Carlo.
# ------------------------------------------------------------------------------


SMOOTH_POINTS = 31
"""Number of clearances of a smooth curve of impact rates."""

CLOSURE_SHARE = 0.5
"""Largest share of the time of a clearance of a curve that the moment closure may take. With many
pairs it takes seconds, and the simulated rates matter more."""


def clearance_notes(linear: Screening, clearances: ArrayLike) -> tuple[str, ...]:
    """Warnings to a curve of impact rates: those of the screening, and one for each gap that a load
    moves by more than the smallest clearance.

    Parameters
    ----------
    linear
        The screening of the scene.
    clearances
        Metres per side from the static equilibrium, as in `clearance_curve`.
    """
    gaps = linear.impact_pairs
    nearest = _rows(linear, clearances).min(axis=0, initial=np.inf)
    several = len(linear.coordinates) > 1 or len(gaps) > 1
    sags = [
        f"the load moves {f'the gap of {name}' if several else 'the mass'} by "
        f"{1e3 * gap.mean:+.4g} mm, more than the clearance of {1e3 * place:.4g} mm: clearances "
        "count from the static equilibrium, and stops placed about the unloaded spring would hold "
        "the mass"
        for (name, gap), place in zip(gaps.items(), nearest, strict=True)
        if abs(gap.mean) > place
    ]
    return (*linear.notes, *sags)


def unseen_notes(curve: DataFrame) -> tuple[str, ...]:
    """A sentence for each row of a `clearance_curve` whose impacts were too rare to be counted.

    Examples
    --------
    >>> import pandas as pd
    >>> row = {"clearance": 5e-3, "simulated": 0.0, "simulated_high": 0.0123}
    >>> unseen_notes(pd.DataFrame([row]))[0][:62]
    'at 5 mm hardly any impact was seen: the rate is at most 0.0123'
    """
    rare = curve[(curve["simulated"] == 0.0) & (curve["simulated_high"] > 0.0)]
    pairs = rare["pair"] if "pair" in rare else [""] * len(rare)
    return tuple(
        f"at {1e3 * clearance:.4g} mm hardly any impact{f' on {pair}' if pair else ''} was seen: "
        f"the rate is at most {most:.3g} per second; raise budget, or let reliability count what "
        "is rare"
        for pair, clearance, most in zip(
            pairs, rare["clearance"], rare["simulated_high"], strict=True
        )
    )


def _rows(linear: Screening, clearances: ArrayLike) -> Matrix:
    """Clearances as rows (places, pairs)."""
    places = np.asarray(clearances, dtype=float)
    places = places[:, None] if places.ndim == 1 else places
    return np.broadcast_to(places, (len(places), len(linear.impact_pairs)))


@calculation
@sampled(rel_error=0.02)
def clearance_curve(
    scene: Scene, clearances: Sequence[float] | Matrix, **options: Unpack[AccuracyOptions]
) -> DataFrame:
    """Impact rate against clearance: by Rice, by the moment closure, and by Monte Carlo.

    Parameters
    ----------
    scene
        One mass or a structure, with impact pairs. The laws of the stops are kept, and all stops
        move together.
    clearances
        Metres per side from the static equilibrium. With several pairs one number is for all of
        them; a row (pairs,) gives one for each.
    **options
        `AccuracyOptions`: `rel_error` is that of the simulated rates, by default 0.02; the
        clearances share the `budget` evenly.

    Returns
    -------
    pandas.DataFrame
        One row per clearance, and per pair where there are several (m, and in sigma of the linear
        response): impacts per second on its stops by `rice`, `closure` and `simulated`, the last
        with its 95 % interval (`simulated_low`, `simulated_high`), and the mean impact speed. One
        mass also has the rms displacement, several pairs the name of the `pair`.

    Raises
    ------
    NotConverged
        If the budget, which is that of all clearances together, ends before each has reached
        `rel_error`, or `Interrupted` after Ctrl-C: it carries the rows with what they reached.

    See Also
    --------
    stochvi.size : The clearance for a target.
    stochvi.screen : The linear answer.

    Examples
    --------
    >>> import stochvi
    >>> scene = stochvi.load_scene(stochvi.scenes.shipped_scene("isolator-truck"))
    >>> table = clearance_curve(scene, [0.002, 0.003], rel_error=0.2)
    >>> table["clearance"].tolist()
    [0.002, 0.003]
    """
    check_movable(scene)
    if not scene.impact_pairs:
        raise NotApplicable("clearance_curve", "the scene needs an impact_pair, for its law")
    places = np.asarray(clearances, dtype=float)
    if not places.size or not np.all((places > 0.0) & np.isfinite(places)):
        raise ValueError(f"clearances must be positive, got {places.tolist()} m")
    linear, run = screened(scene), Run.of(options)
    cases = [_case(scene, linear, place) for place in _rows(linear, places)]
    rows: list[dict[str, float | str]] = []
    short: list[str] = []
    for number, case in enumerate(cases):
        if number and run.deadline.passed():
            short.append(case.words)
            continue
        left = len(cases) - number
        closure = _closure_rates(case.scene, run.deadline, CLOSURE_SHARE / left)
        part = run.part(
            number / len(cases), (number + 1) / len(cases), case.words, run.deadline.share(1 / left)
        )
        try:
            simulated = simulate(case.scene, **part.options(rel_error=run.rel_error))
        except (NotConverged, Interrupted) as reason:
            simulated = reason.partial
            short.append(case.words)
        if simulated is not None:
            rows += case.rows(simulated, closure)
    curve = frame_of(rows)
    if short:
        raise run.deadline.fell_short(
            f"before the impacts at {', '.join(short)} were known to a relative error of "
            f"{run.rel_error:g}",
            "raise budget or rel_error",
            curve if rows else None,
        )
    return curve


class _Case(NamedTuple):
    """One clearance of a curve: how messages call it, its scene, and what makes its rows from a
    response and the rates of the closure."""

    words: str
    scene: Scene
    rows: Callable[[Response, dict[str, float]], list[dict[str, float | str]]]


def _case(scene: Scene, linear: Screening, place: Vector) -> _Case:
    """The stops of all pairs, each at its clearance (pairs,)."""
    stopped = at_clearances(scene, place)
    words = ", ".join(dict.fromkeys(f"{1e3 * each:.4g}" for each in place))

    def rows(found: Response, closure: dict[str, float]) -> list[dict[str, float | str]]:
        predicted = _predicted(linear, place, closure)
        return [
            {**one, **_simulated(found, name)}
            for one, name in zip(predicted, linear.impact_pairs, strict=True)
        ]

    return _Case(f"{words} mm", stopped, rows)


def _predicted(
    linear: Screening, place: Vector, closure: dict[str, float]
) -> list[dict[str, float | str]]:
    """A row per pair with its clearance, and its rates of impacts by Rice and by the closure."""
    gaps = linear.impact_pairs
    return [
        {
            **({"pair": name} if len(gaps) > 1 else {}),
            "clearance": float(each),
            "clearance_in_sigma": float(each) / (gap.displacement_std or np.nan),
            "rice": gap.rate_at(float(each)),
            "closure": closure.get(name, np.nan),
        }
        for (name, gap), each in zip(gaps.items(), place, strict=True)
    ]


def _simulated(found: Response, pair: str) -> dict[str, float | str]:
    """The simulated rate of impacts of a pair with its interval, and the mean impact speed; the rms
    displacement of an only coordinate between them."""
    hits = found.impact_pairs[pair]
    low, high = _interval(hits.collision_rate)
    moved = [_value(each.displacement_std) for each in found.coordinates.values()]
    return {
        "simulated": _value(hits.collision_rate),
        "simulated_low": low,
        "simulated_high": high,
        **({"displacement_std": moved[0]} if len(moved) == 1 else {}),
        "impact_speed_mean": _value(hits.impact_speed_mean),
    }


def predicted_rates(scene: Scene, clearances: ArrayLike, deadline: Deadline = NEVER) -> DataFrame:
    """The columns of `clearance_curve` that need no simulation.

    Where the closure finds no solution, or is not begun by the deadline, its rate is left out
    (NaN).
    """
    linear = screened(scene)
    return frame_of(
        row
        for place in _rows(linear, clearances)
        for row in _predicted(
            linear,
            place,
            {} if deadline.passed() else _closure_rates(at_clearances(scene, place), deadline),
        )
    )


def predicted_curve(scene: Scene, curve: DataFrame) -> DataFrame:
    """The columns of `predicted_rates` at many clearances in the range of a `clearance_curve`.

    The closure is interpolated between the rates of the curve: the logarithm of the rate over the
    square of the clearance, a straight line for a Gaussian motion. Solving it anew at each place
    would take seconds after the budget of the curve is spent.
    """
    linear, pairs = screened(scene), curve.get("pair")
    parts = {name: curve if pairs is None else curve[pairs == name] for name in linear.impact_pairs}
    places = {
        name: np.linspace(part["clearance"].min(), part["clearance"].max(), SMOOTH_POINTS)
        for name, part in parts.items()
    }
    closures = {name: _between(part, places[name]) for name, part in parts.items()}
    return frame_of(
        row
        for number, place in enumerate(np.transpose([*places.values()]))
        for row in _predicted(
            linear, place, {name: float(rates[number]) for name, rates in closures.items()}
        )
    )


def _between(curve: DataFrame, places: Vector) -> Vector:
    """Rates of the closure of one pair between the clearances of a curve; NaN beyond them."""
    known = curve[curve["closure"] > 0.0].sort_values("clearance")
    if len(known) < 2:
        return np.full(len(places), np.nan)
    rates = scipy.interpolate.PchipInterpolator(
        known["clearance"] ** 2, np.log(known["closure"]), extrapolate=False
    )
    return np.asarray(np.exp(rates(places**2)))


def _closure_rates(
    scene: Scene, deadline: Deadline = NEVER, share: float = 1.0
) -> dict[str, float]:
    """Impacts per second on each pair by the moment closure; none where it finds no solution in a
    share of the time that is left."""
    try:
        found = linearisation.linearise(scene, budget=deadline.part(share)).impact_pairs
    except (NotConverged, Interrupted, NotApplicable):  # hysteresis between stops has no closure
        return {}
    return {name: _value(hits.collision_rate) for name, hits in found.items()}


def _value(estimate: Estimate | None) -> float:
    return np.nan if estimate is None else estimate.value


def _interval(estimate: Estimate | None) -> tuple[float, float]:
    assert estimate is not None
    if estimate.upper_95 is not None:
        return 0.0, estimate.upper_95
    half = estimate.half_width_95()
    return max(estimate.value - half, 0.0), estimate.value + half
