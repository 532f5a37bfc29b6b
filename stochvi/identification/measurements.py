"""What a user measures of a stop. Chapters: rebounds, times of impacts, a force over deflection, a
drop; a test from a file."""

from __future__ import annotations

import math
import warnings
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple, Self, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.units import CHECKS, STANDARD_GRAVITY, checked, listed_units, with_checks
from stochvi.mathematics.units import unit as unit_called
from stochvi.notices import InputWarning
from stochvi.results.errors import SceneError
from stochvi.scenes.excitations.base import unread_unit
from stochvi.scenes.impact_laws import CompliantLaw, ImpactLaw, RigidLaw
from stochvi.scenes.readers import si_columns, table_of
from stochvi.scenes.records import CUT_OFF, cut_off, read_record
from stochvi.scenes.text_tables import all_columns

LEAST_RISE = 0.05
"""Acceleration over its largest at which the pulse of a contact is taken to begin and to end."""

AROUND = 0.3
"""Time before and after a pulse that is compared as well, in lengths of the pulse."""

LEAST_SPEED = 0.1
"""Smallest speed of approach that is tried in a fit, over the first guess."""

JUMP = 2
"""Number of samples before the pulse, besides its first one, that are not compared."""

FEWEST_IN_PULSE = 8
"""Smallest number of samples in the pulse of a contact."""


class Scale(NamedTuple):
    """Deflection (m), force (N), speed (m/s) and mass (kg) that are usual in a test."""

    deflection: float
    force: float
    speed: float
    mass: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurement:
    """Base class of every test: numbers that were observed, and what a law predicts for them."""

    word: ClassVar[str]
    """Name of what is observed."""

    unit: ClassVar[str]
    """Unit of what is observed."""

    assumptions: ClassVar[tuple[str, ...]] = ()
    """What the test is taken to be, a sentence each."""

    ordered: ClassVar[bool] = False
    """Whether observations follow each other in time, so that their errors may be correlated."""

    @property
    @abstractmethod
    def observed(self) -> Vector:
        """The numbers that were observed."""

    @property
    @abstractmethod
    def place(self) -> Vector:
        """Where each number was observed, for a picture: speeds, deflections or times."""

    @abstractmethod
    def predicted(self, law: ImpactLaw, extra: Vector) -> Vector:
        """What a law predicts; `extra` are the numbers of the test itself, as in `start`."""

    @property
    def start(self) -> Mapping[str, tuple[float, str]]:
        """Numbers of the test itself that are fitted beside the law: first guess and unit."""
        return {}

    @property
    def known_errors(self) -> Matrix | None:
        """Covariance of errors whose size is known; None where there is none."""
        return None

    @property
    @abstractmethod
    def scale(self) -> Scale:
        """Sizes of the test, in which the numbers of a law are of the order of 1."""


@with_checks
@dataclass(frozen=True, kw_only=True, eq=False)
class Rebounds(Measurement):
    """Speeds of approach and of rebound of single impacts.

    Parameters
    ----------
    approach, rebound
        Speeds before and after each impact, m/s.
    errors
        Covariance of errors of the ratio rebound / approach that is known; None where it is not.

    See Also
    --------
    stochvi.identify : The law of the stop.

    Examples
    --------
    >>> test = Rebounds(approach=[1.0, 2.0], rebound=[0.5, 0.9])
    >>> test.observed.tolist()
    [0.5, 0.45]
    """

    approach: Any
    rebound: Any
    errors: Matrix | None = None

    word: ClassVar[str] = "restitution"
    unit: ClassVar[str] = ""
    assumptions: ClassVar[tuple[str, ...]] = (
        "the restitution scatters by the same amount at all speeds, independently",
    )

    def __post_init__(self) -> None:
        for name in ("approach", "rebound"):
            values = _finite(name, getattr(self, name))
            if np.any(values <= 0.0):
                raise ValueError(f"{name} must hold speeds above 0, got {values.min():g}")
            object.__setattr__(self, name, values)
        if len(self.approach) != len(self.rebound):
            raise ValueError(
                f"rebound must have as many speeds as approach, got {len(self.rebound)} and "
                f"{len(self.approach)}"
            )
        if np.any(self.observed > 2.0):
            raise ValueError(
                f"rebound must be a speed after the impact in approach, got {self.observed.max():g}"
                " times that before it; exchange the columns"
            )

    @classmethod
    def of_times(
        cls, times: Any, *, height: float | None = None, timing_error: float = 0.0
    ) -> Self:
        """Make rebounds of the times at which a dropped body rebounds on one spot.

        Between two impacts the body is free for tau = 2 w / g. So the restitution of an impact is
        the ratio of the flight after it to that before it, and the speed of approach g tau / 2.

        Parameters
        ----------
        times
            Times of successive impacts, s.
        height
            Height of the drop, m, which gives the speed of the first impact; None if unknown.
        timing_error
            Standard deviation of a time, s: about 0.3 of the interval of pictures of a video.
            Neighbouring ratios share two times, so that their errors are correlated.

        Returns
        -------
        Rebounds
            An impact for each pair of flights, and one for the drop.

        Raises
        ------
        ValueError
            If there are fewer than three times (two with a height), or they do not rise.

        See Also
        --------
        stochvi.identify : The law of the stop.

        Examples
        --------
        >>> test = Rebounds.of_times([0.0, 0.4, 0.6, 0.7])
        >>> test.observed.round(6).tolist(), test.approach.round(3).tolist()
        ([0.5, 0.5], [1.961, 0.981])
        """
        when = _finite("times", times)
        fewest = 3 if height is None else 2
        if len(when) < fewest or np.any(np.diff(when) <= 0.0):
            raise ValueError(
                f"times must be at least {fewest} rising numbers, got {when[:9].tolist()}; give "
                "the times of successive impacts"
            )
        if height is not None and not 0.0 < height < math.inf:
            raise ValueError(f"height must be a positive length (m), got {height:g}")
        if not 0.0 <= timing_error < math.inf:
            raise ValueError(f"timing_error must be at least 0 (s), got {timing_error:g}")
        # each flight is a combination of times; that of the drop has no error
        flights = np.diff(when)
        shares = np.diff(np.eye(len(when)), axis=0)
        if height is not None:
            flights = np.insert(flights, 0, 2.0 * math.sqrt(2.0 * height / STANDARD_GRAVITY))
            shares = np.insert(shares, 0, 0.0, axis=0)
        ratio = flights[1:] / flights[:-1]
        change = (shares[1:] - ratio[:, None] * shares[:-1]) / flights[:-1, None]
        speeds = 0.5 * STANDARD_GRAVITY * flights
        return cls(
            approach=speeds[:-1],
            rebound=speeds[1:],
            errors=timing_error**2 * change @ change.T if timing_error else None,
        )

    @property
    def observed(self) -> Vector:
        return np.asarray(self.rebound / self.approach)

    @property
    def place(self) -> Vector:
        return np.asarray(self.approach)

    @property
    def known_errors(self) -> Matrix | None:
        return self.errors

    def predicted(self, law: ImpactLaw, extra: Vector) -> Vector:
        assert isinstance(law, RigidLaw)
        return law.restitution_at(self.approach)

    @property
    def scale(self) -> Scale:
        return Scale(1.0, 1.0, float(np.exp(np.mean(np.log(self.approach)))), 1.0)


@with_checks
@dataclass(frozen=True, kw_only=True, eq=False)
class ForceCurve(Measurement):
    """Force of a stop over its deflection, pressed slowly, or with the speed of each row.

    Parameters
    ----------
    deflection, force
        Deflection, m, and force, N, both positive into the stop; rows in the order of time. Rows
        without contact, up to the deflection 0, are left out.
    speed
        Speed into the stop of each row, m/s; None for a slow press, which shows no loss.
    mass
        Mass that will meet the stop, kg, to which a damping ratio refers; None if it is not known.

    See Also
    --------
    stochvi.identify : The law of the stop.

    Examples
    --------
    >>> test = ForceCurve(deflection=[0.0, 1e-3, 2e-3], force=[0.0, 10.0, 20.0])
    >>> test.observed.tolist()
    [10.0, 20.0]
    """

    deflection: Any
    force: Any
    speed: Any = None
    mass: float | None = None

    word: ClassVar[str] = "force"
    unit: ClassVar[str] = "N"
    ordered: ClassVar[bool] = True
    assumptions: ClassVar[tuple[str, ...]] = (
        "errors of the force have the same size in all rows",
        "the deflection counts from the first touch",
    )

    def __post_init__(self) -> None:
        names = ("deflection", "force") + (() if self.speed is None else ("speed",))
        found = {name: _finite(name, getattr(self, name)) for name in names}
        sizes = {name: len(each) for name, each in found.items()}
        if len(set(sizes.values())) > 1:
            raise ValueError(f"{', '.join(names)} must have the same length, got {sizes}")
        touching = found["deflection"] > 0.0
        for name, values in found.items():
            object.__setattr__(self, name, values[touching])
        if not np.any(touching) or self.force.max() <= 0.0:
            raise ValueError(
                "force must be positive somewhere at a positive deflection; give both as positive "
                "into the stop"
            )
        check_mass(self.mass)

    @property
    def observed(self) -> Vector:
        return np.asarray(self.force)

    @property
    def place(self) -> Vector:
        return np.asarray(self.deflection)

    def predicted(self, law: ImpactLaw, extra: Vector) -> Vector:
        assert isinstance(law, CompliantLaw)
        speed = 0.0 if self.speed is None else self.speed
        return law.force_at(self.deflection, speed, self.scale.mass)

    @property
    def scale(self) -> Scale:
        fast = 1.0 if self.speed is None else float(np.abs(self.speed).max())
        return Scale(
            float(self.deflection.max()), float(self.force.max()), fast or 1.0, self.mass or 1.0
        )


@with_checks
@dataclass(frozen=True, kw_only=True, eq=False)
class DropRecord(Measurement):
    """Acceleration of a mass during one impact on the stop.

    The accelerometer is on the mass and shows 0 in free fall, or an offset that the samples before
    the impact reveal. The deflection follows from the law by y'' = g - F(y, y') / M.

    Parameters
    ----------
    acceleration
        Samples, m/s^2, of either sign.
    fs
        Sampling rate, 1/s.
    mass
        Mass, kg.
    height
        Height of the drop, m; None if the speed of the impact is to be found from the record.
    gravity
        Acceleration towards the stop besides its force, m/s^2; 0 for a pendulum.

    See Also
    --------
    stochvi.identify : The law of the stop.

    Examples
    --------
    >>> import numpy as np
    >>> pulse = 300.0 * np.sin(np.pi * np.arange(41) / 40.0)
    >>> test = DropRecord(acceleration=np.pad(pulse, 60), fs=10e3, mass=2.0)
    >>> round(test.duration, 4), len(test.observed)
    (0.0039, 60)
    """

    acceleration: Any
    fs: float
    mass: float
    height: float | None = None
    gravity: float = STANDARD_GRAVITY

    word: ClassVar[str] = "acceleration"
    unit: ClassVar[str] = "m/s^2"
    ordered: ClassVar[bool] = True
    assumptions: ClassVar[tuple[str, ...]] = (
        "the accelerometer shows 0 in free fall, and its band is wide enough for the pulse",
        "the mass moves as a rigid body along one axis",
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "acceleration", _finite("acceleration", self.acceleration))
        check_mass(self.mass)
        for name in ("fs", "height"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise ValueError(f"{name} must be a positive number, got {value:g}")
        begin, end = self._ends
        if end - begin < FEWEST_IN_PULSE:
            raise ValueError(
                f"acceleration must hold an impact of at least {FEWEST_IN_PULSE} samples, got "
                f"{end - begin} at {self.fs:g} Hz; record at a higher rate"
            )

    @cached_property
    def _pulse(self) -> Vector:
        """The record with the pulse upwards, and without the offset before it."""
        values = np.asarray(self.acceleration)
        peak = int(np.argmax(np.abs(values - np.median(values))))
        upwards = values * math.copysign(1.0, values[peak] - float(np.median(values)))
        before = upwards[: max(peak // 2, 1)]
        return np.asarray(upwards - np.median(before))

    @cached_property
    def _ends(self) -> tuple[int, int]:
        """First sample of the pulse, and the one behind it."""
        values, peak = self._pulse, int(np.argmax(self._pulse))
        low = values < LEAST_RISE * values[peak]
        before, after = np.flatnonzero(low[:peak]), np.flatnonzero(low[peak:])
        begin = int(before[-1]) + 1 if len(before) else 0
        return begin, peak + int(after[0]) if len(after) else len(values)

    @property
    def duration(self) -> float:
        """Length of the pulse, s."""
        begin, end = self._ends
        return (end - begin) / self.fs

    @cached_property
    def _compared(self) -> NDArray[np.int_]:
        """Samples that are compared: the pulse and a margin, but for those of the first touch,
        where the force of a damper jumps, and no sensor does."""
        begin, end = self._ends
        margin = math.ceil(AROUND * (end - begin))
        every = np.arange(max(begin - margin, 0), min(end + margin, len(self._pulse)))
        return every[(every < begin - JUMP) | (every > begin)]

    @property
    def observed(self) -> Vector:
        return self._pulse[self._compared]

    @property
    def place(self) -> Vector:
        return np.asarray((self._compared - self._compared[0]) / self.fs)

    @property
    def start(self) -> Mapping[str, tuple[float, str]]:
        touch = (self._ends[0] - 0.5 - self._compared[0]) / self.fs
        found = {"first touch": (touch, "s")}
        if self.height is None:
            found["speed"] = (self.scale.speed, "m/s")
        return found

    def speed(self, extra: Vector) -> float:
        """Speed of approach, m/s, from the height of the drop or as it was fitted."""
        if self.height is None:
            return float(extra[1])
        return math.sqrt(2.0 * STANDARD_GRAVITY * self.height)

    def predicted(self, law: ImpactLaw, extra: Vector) -> Vector:
        assert isinstance(law, CompliantLaw)
        found = np.zeros(len(self.observed))
        since = self.place - extra[0]
        contact = law.contact(
            max(self.speed(extra), LEAST_SPEED * self.scale.speed), self.mass, self.gravity,
            longest=max(float(since[-1]), 1.0 / self.fs),
        )  # fmt: skip
        touching = (since > 0.0) & (since < contact.duration)
        if np.any(touching):
            y, v = contact.states(since[touching])
            found[touching] = law.force_at(y, v, self.mass) / self.mass
        return found

    def motion(self, law: CompliantLaw, extra: Vector) -> tuple[Vector, Vector, Vector]:
        """Deflection (m), speed (m/s) and force (N) in the contact by integrating the record, from
        where the law is at its first sample."""
        begin, end = self._ends
        step, before = 1.0 / self.fs, (begin - self._compared[0]) / self.fs - extra[0]
        contact = law.contact(self.speed(extra), self.mass, self.gravity, self.duration)
        (deep,), (fast,) = contact.states(np.array([max(before, 0.0)]))
        values = self._pulse[begin:end]
        v = fast + step * _summed(self.gravity - values)
        return deep + step * _summed(v), v, self.mass * values

    @property
    def scale(self) -> Scale:
        peak = float(self._pulse.max())
        begin, end = self._ends
        speed = float(np.sum(self._pulse[begin:end])) / self.fs / 1.7
        if self.height is not None:
            speed = math.sqrt(2.0 * STANDARD_GRAVITY * self.height)
        return Scale(speed * self.duration / math.pi, peak * self.mass, speed, self.mass)


def check_mass(mass: float | None) -> None:
    """Raise ValueError for a mass that is not positive."""
    if mass is not None and not 0.0 < mass < math.inf:
        raise ValueError(f"mass must be a positive number (kg), got {mass:g}")


def _summed(values: Vector) -> Vector:
    """Integral from the first of evenly spaced values on, by trapezia of unit width."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))])


def _finite(name: str, values: Any) -> Vector:
    CHECKS["Sequence[float]"](name, values)
    found = np.asarray(values, dtype=float)
    if not len(found) or not np.all(np.isfinite(found)):
        raise ValueError(f"{name} must be a list of finite numbers, got {values!r}"[:300])
    return found


# ------------------------------------------------------------------------------
# A test of a stop from the file that a user has of it.
# ------------------------------------------------------------------------------


Kind = Literal["speeds", "times", "force", "drop"]

LAYOUTS: Mapping[str, tuple[Mapping[str, str], ...]] = {
    "speeds": ({"approach": "speed", "rebound": "speed"},),
    "times": ({"time": "time"},),
    "force": (
        {"deflection": "length", "force": "force"},
        {"time": "time", "deflection": "length", "force": "force"},
    ),
}
"""Quantities of the columns of each kind of file, by the names of the columns."""

EXAMPLES = {"speeds": "'m/s,m/s'", "times": "'s'", "force": "'mm,N', or 's,mm,N' with times"}
"""Examples of units, for messages."""


class RecordKeys(TypedDict, total=False):
    """Arguments of `stochvi.scenes.read_record` for a file."""

    fs: float | None
    column: int | str | None


@checked
def read_test(
    path: str | Path,
    kind: Kind,
    *,
    unit: str | None = None,
    mass: float | None = None,
    height: float | None = None,
    timing_error: float = 0.0,
    pendulum: bool = False,
    **record: Unpack[RecordKeys],
) -> Measurement:
    """A test of a stop from its file.

    Parameters
    ----------
    path
        A table of text or a spreadsheet; for a drop any file that records are read from.
    kind
        "speeds": columns of the speeds of approach and rebound. "times": times of successive
        impacts. "force": deflection and force, with the times in front where the speed matters.
        "drop": times and accelerations of one impact.
    unit
        Units of the columns, as "mm,N", where no headings state them.
    mass
        Mass that met the stop, kg; needed for a drop.
    height
        Height of the drop, m, for "times" and "drop".
    timing_error
        Standard deviation of a time of an impact, s.
    pendulum
        Whether gravity does not press the mass onto the stop.
    **record
        Sampling rate `fs` (1/s) and `column` of a record, as for `stochvi.scenes.read_record`.

    Returns
    -------
    Measurement
        `Rebounds`, a `ForceCurve` or a `DropRecord`.

    Raises
    ------
    SceneError
        If the file does not hold such a test.

    See Also
    --------
    stochvi.identify : The law of the stop.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "pad.csv"
    >>> _ = file.write_text("deflection (mm),force (N)\\n1,100\\n2,210\\n3,300\\n")
    >>> read_test(file, "force").observed.tolist()
    [100.0, 210.0, 300.0]
    """
    path = Path(path)
    check_mass(mass)
    if kind == "drop":
        return _drop(path, unit, mass, height, pendulum, record)
    if kind not in LAYOUTS:
        raise ValueError(f"kind must be 'speeds', 'times', 'force' or 'drop', got {kind!r}")
    found = _columns(path, kind, unit)
    match kind:
        case "speeds":
            return Rebounds(**found)
        case "times":
            return Rebounds.of_times(found["time"], height=height, timing_error=timing_error)
    times = found.pop("time", None)
    speed = None if times is None else _speed(path, times, found["deflection"])
    return ForceCurve(**found, speed=speed, mass=mass)


def _columns(path: Path, kind: str, given: str | None) -> dict[str, Vector]:
    """The columns of a table by their names, SI units."""
    layouts = LAYOUTS[kind]
    table = table_of(path, tuple(layouts[0]))
    layout = next((each for each in layouts if len(each) == len(table.headings)), layouts[0])
    columns = all_columns(table, tuple(layout))
    units = None if given is None else [each.strip() for each in given.split(",")]
    if units is not None and len(units) != len(layout):
        raise SceneError(
            "unit", f"must name {len(layout)} units, as {EXAMPLES[kind]}, got {given!r}"
        )
    converted = si_columns(table, columns, tuple(layout.values()), units, EXAMPLES[kind])
    return dict(zip(layout, converted, strict=True))


def _speed(path: Path, times: Vector, deflection: Vector) -> Vector:
    """The rate of the deflection, by differences of neighbours."""
    if len(times) < 3 or np.any(np.diff(times) <= 0.0):
        raise SceneError(f"{path} must have at least three rising times in its first column")
    return np.gradient(deflection, times)


def _drop(
    path: Path, given: str | None, mass: float | None, height: float | None, pendulum: bool,
    keys: RecordKeys,
) -> DropRecord:  # fmt: skip
    if mass is None:
        raise ValueError("mass must be given for a drop (kg), got none")
    record, columns = read_record(path, **keys)
    if cut_off(record.values):
        warnings.warn(f"record {path.name}: {CUT_OFF}", InputWarning, stacklevel=4)
    known = columns.unit
    if given is not None:
        named = unit_called(given)
        for doubt in unread_unit(columns, named):
            warnings.warn(f"record {path.name}: {doubt}", InputWarning, stacklevel=4)
        if known is not None and not known.same(named):
            raise SceneError(
                "unit",
                f"is {given!r}, but {columns.stated_in} states {known.name!r}; take out "
                "the one that is wrong",
            )
        known = named
    if known is None or known.quantity != "acceleration":
        got = "none" if known is None else repr(known.name)
        raise SceneError(
            "unit", f"must be one of acceleration ({listed_units('acceleration')}), got {got}"
        )
    return DropRecord(
        acceleration=known.to_si(record.values), fs=record.fs, mass=mass, height=height,
        gravity=0.0 if pendulum else STANDARD_GRAVITY,
    )  # fmt: skip
