"""The numbers that an integrator returns, with their standard errors."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.results.estimates import Estimate
from stochvi.results.intervals import jackknife_error
from stochvi.verification.testing.problems import Problem

Values = Mapping[str, Any]
Function = Callable[[Values], Any]
"""A function of the quantities, which may be numbers or arrays."""

QUANTITIES = (
    "displacement_mean",
    "displacement_std",
    "velocity_std",
    "collision_rate",
    "impact_speed_rate",
    "impact_speed_square_rate",
)
"""The quantities that are judged: moments, impacts per second, F1 and F2 (`QUANTITY_UNITS`). The
standard deviation of the velocity and the rates show mistakes that displacements hide."""

AVERAGES = (
    "displacement_mean",
    "displacement_mean_square",
    "velocity_mean_square",
    "collision_rate",
    "impact_speed_rate",
    "impact_speed_square_rate",
)
"""Time averages of one path, from which the quantities follow."""

RECORDS = ("displacement", "velocity", "impact_speed", "impact_time")

FEWEST_PATHS = 16
"""Smallest number of independent paths from which a standard error is taken."""

BATCHES = 32
"""Number of batches into which a single long record is cut for a standard error."""

SHORTEST_BATCH = 3.0
"""Smallest length of a batch in relaxation times, so that batches are nearly independent."""


class Sample(Protocol):
    """Quantities of one scene, and functions of them, with standard errors."""

    @property
    def degrees(self) -> float:
        """Degrees of freedom of the standard errors; infinite where they are not known."""

    def names(self) -> Sequence[str]:
        """The quantities that the sample has; `split` takes such a name apart."""

    def parts(self) -> Sequence[str]:
        """The returned names from which quantities can be made."""

    def bias(self, name: str) -> float:
        """Bound on the bias that was stated with a quantity; 0 where none was stated."""

    def evaluate(self, function: Function) -> tuple[float, float]:
        """A function of the quantities with its standard error; NaN where it is not finite."""


@dataclass(frozen=True)
class PathAverages:
    """Time averages of independent paths, (paths,) each; errors by the jackknife."""

    averages: Mapping[str, Vector]

    @property
    def degrees(self) -> float:
        return len(next(iter(self.averages.values()))) - 1.0

    def names(self) -> Sequence[str]:
        owners = dict.fromkeys(split(name)[0] for name in self.averages)
        names = [owner + quantity for owner in owners for quantity in QUANTITIES]
        return [name for name in names if set(needs(name)) <= set(self.averages)]

    def parts(self) -> Sequence[str]:
        return list(self.averages)

    def bias(self, name: str) -> float:
        return 0.0

    def evaluate(self, function: Function) -> tuple[float, float]:
        columns = self.averages
        if not all(np.all(np.isfinite(column)) for column in columns.values()):
            return math.nan, math.nan
        count = self.degrees + 1.0
        means = {name: column.mean() for name, column in columns.items()}
        others = {name: (count * means[name] - columns[name]) / self.degrees for name in columns}
        without = np.asarray(function(_quantities(others)), dtype=float)
        return float(function(_quantities(means))), jackknife_error(without)


@dataclass(frozen=True)
class Statistics:
    """Quantities with standard errors, which are taken for independent of each other."""

    estimates: Mapping[str, Estimate]
    degrees: float = math.inf

    def names(self) -> Sequence[str]:
        return [name for name in self.estimates if split(name)[1] in QUANTITIES]

    def parts(self) -> Sequence[str]:
        return self.names()

    def bias(self, name: str) -> float:
        return self.estimates[name].bias or 0.0

    def evaluate(self, function: Function) -> tuple[float, float]:
        """The standard error comes from central differences over one standard error each way."""
        values = {name: each.value for name, each in self.estimates.items()}
        variance = 0.0
        for name, each in self.estimates.items():
            ends = [
                function({**values, name: each.value + sign * each.standard_error})
                for sign in (1.0, -1.0)
            ]
            variance += (0.5 * float(ends[0] - ends[1])) ** 2
        return float(function(values)), math.sqrt(variance)


def split(name: str) -> tuple[str, str]:
    """The owner of a quantity, with the point that follows it, and the quantity without it.

    >>> split("front.left.velocity_std"), split("velocity_std")
    (('front.left.', 'velocity_std'), ('', 'velocity_std'))
    """
    owner, point, quantity = name.rpartition(".")
    return owner + point, quantity


def needs(name: str) -> Sequence[str]:
    """The averages of each path from which a quantity follows."""
    owner, quantity = split(name)
    if quantity == "displacement_std":
        return (f"{owner}displacement_mean", f"{owner}displacement_mean_square")
    return (f"{owner}velocity_mean_square",) if quantity == "velocity_std" else (name,)


def _quantities(means: Values) -> dict[str, Any]:
    found = dict(means)
    for name in means:
        owner, average = split(name)
        if average == "displacement_mean_square" and f"{owner}displacement_mean" in means:
            variance = means[name] - means[f"{owner}displacement_mean"] ** 2
            found[f"{owner}displacement_std"] = np.sqrt(np.maximum(variance, 0.0))
        if average == "velocity_mean_square":
            found[f"{owner}velocity_std"] = np.sqrt(np.maximum(means[name], 0.0))
    return found


IMPACTS = ("collision_rate", "impact_speed_rate", "impact_speed_square_rate")
"""Quantities of impacts: sums of w^0, w^1 and w^2 per second, w the impact speed."""


def returnable(problem: Problem, quantities: Sequence[str]) -> list[str]:
    """Names under which quantities of a problem may be returned: the bare ones for one oscillator,
    otherwise with the coordinate or the impact pair before a point."""
    if problem.unowned:
        return list(quantities)
    model = problem.model
    moments = [name for name in quantities if name not in (*IMPACTS, "impact_speed", "impact_time")]
    impacts = [name for name in quantities if name not in moments]
    return [f"{owner}.{name}" for owner in model.coordinates for name in moments] + [
        f"{pair.name}.{name}" for pair in model.pairs for name in impacts
    ]


def plain_name(problem: Problem, name: str) -> str:
    """The name of a quantity as `returnable` has it: one oscillator may have its owner named."""
    owner, quantity = split(name)
    owners = (*problem.model.coordinates, *(pair.name for pair in problem.model.pairs))
    return quantity if problem.unowned and owner.removesuffix(".") in owners else name


def sample_of(problem: Problem, returned: Mapping[str, Any]) -> Sample:
    """The sample that an integrator returned, in one of the three forms that `judge` accepts."""
    if not isinstance(returned, Mapping) or not returned:
        got = "an empty dict" if returned == {} else type(returned).__name__
        raise ValueError(
            "integrator must return a dict of records, of averages of each path or of "
            f"(value, standard error), got {got}"
        )
    records = returnable(problem, RECORDS)
    averages = returnable(problem, AVERAGES)
    quantities = list(dict.fromkeys((*averages, *returnable(problem, QUANTITIES))))
    for name in returned:
        if name not in {*records, *quantities}:
            raise ValueError(
                f"integrator returned {name!r}, expected records ({', '.join(records)}) or "
                f"quantities ({', '.join(quantities)})"
            )
    if set(returned) & set(records):
        return _from_records(problem, returned)
    statistics = [_is_statistic(entry) for entry in returned.values()]
    if all(statistics):
        return Statistics({name: _estimate(name, entry) for name, entry in returned.items()})
    if any(statistics):
        raise ValueError("integrator returned a mixture of averages of paths and of statistics")
    for name in returned:
        if name not in averages:
            square = name.replace("_std", "_mean_square")
            raise ValueError(
                f"integrator returned {name} of type {type(returned[name]).__name__}, expected a "
                f"tuple (value, standard error); per path give {square}"
            )
    return _path_averages({name: _numbers(name, entry) for name, entry in returned.items()})


def _numbers(name: str, entry: Any) -> NDArray[np.float64]:
    """An array of real numbers."""
    wanted = "an array of real numbers"
    try:
        array = np.asarray(entry)
        if np.iscomplexobj(array):
            wanted += ", not of complex ones"
            raise TypeError
        return np.asarray(array, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(
            f"integrator returned {name} of type {type(entry).__name__}, expected {wanted}, each "
            "row of the same length"
        ) from None


def _is_statistic(entry: Any) -> bool:
    return isinstance(entry, Estimate) or (isinstance(entry, tuple) and len(entry) == 2)


def _estimate(name: str, entry: Any) -> Estimate:
    try:
        if isinstance(entry, Estimate):
            found = entry
        else:
            value, error = (float(number) for number in entry)
            found = Estimate(value=value, standard_error=error)
    except (TypeError, ValueError) as reason:
        raise ValueError(
            f"integrator returned {name} = {entry!r}, expected (value, standard error): {reason}"
        ) from None
    # zero without an error says that nothing was seen; another number needs an error
    if found.standard_error == 0.0 and found.value != 0.0:
        raise ValueError(
            f"integrator returned {name} = {found.value:g} without a standard error, by which it "
            "is judged; give (value, standard error) with an error above 0"
        )
    return found


def _path_averages(columns: Mapping[str, Vector]) -> PathAverages:
    shapes = {name: column.shape for name, column in columns.items()}
    for name, shape in shapes.items():
        if len(shape) != 1 or shape[0] < FEWEST_PATHS or shape != next(iter(shapes.values())):
            raise ValueError(
                f"integrator returned {name} of shape {shape}, expected one average for each of "
                f"the same {FEWEST_PATHS} or more paths, or (value, standard error)"
            )
    return PathAverages(columns)


def _from_records(problem: Problem, returned: Mapping[str, Any]) -> PathAverages:
    """Averages of each path, or of each batch of a single path."""
    columns: dict[str, Vector] = {}
    for name in returned:
        if split(name)[1] not in RECORDS:
            raise ValueError(
                f"integrator returned {name} together with records; give only records, or only "
                "averages"
            )
    records = {
        name: _record(problem, name, entry)
        for name, entry in returned.items()
        if split(name)[1] in ("displacement", "velocity")
    }
    single = any(record.ndim == 1 for record in records.values())
    if len({record.ndim for record in records.values()}) > 1:
        raise ValueError(
            "integrator returned displacement and velocity of a single path and of several; give "
            "both of the same paths"
        )
    for name, record in records.items():
        parts = _parts(problem, record) if single else list(record)
        if split(name)[1] == "displacement":
            columns[f"{name}_mean"] = np.array([part.mean() for part in parts])
        columns[f"{name}_mean_square"] = np.array([(part**2).mean() for part in parts])
    for name in returned:
        owner, record_name = split(name)
        if record_name == "impact_time" and f"{owner}impact_speed" not in returned:
            raise ValueError(f"integrator returned {name} without {owner}impact_speed; give both")
        if record_name == "impact_speed":
            columns |= _impact_rates(problem, returned, owner, records)
    return _path_averages(columns)


def _impact_rates(
    problem: Problem, returned: Mapping[str, Any], owner: str, records: Mapping[str, Vector]
) -> dict[str, Vector]:
    """Rates of one impact pair in each path, or in each batch of a single path."""
    single = any(record.ndim == 1 for record in records.values())
    aligned = _aligned(_speeds(returned[f"{owner}impact_speed"]), records)
    if aligned is not None:
        parts = _parts(problem, aligned) if single else list(aligned)
        seconds = problem.duration / (len(parts) if single else 1)
    else:
        parts = _events(problem, returned, owner, records if single else {})
        seconds = problem.duration / (BATCHES if single else 1)
    speeds = [np.abs(part[part != 0.0]) for part in parts]
    rates = (
        [np.sum(w > problem.speed_threshold) for w in speeds],
        [w.sum() for w in speeds],
        [(w**2).sum() for w in speeds],
    )
    return {
        f"{owner}{name}": np.array(rate) / seconds
        for name, rate in zip(IMPACTS, rates, strict=True)
    }


def _record(problem: Problem, name: str, entry: Any) -> NDArray[np.float64]:
    """A record as an array (paths, samples); that of a single path may be (samples,)."""
    record = _numbers(name, entry)
    shape = record.shape
    if record.ndim == 1 and record.size >= BATCHES:
        return record
    if record.ndim == 2 and shape[0] == problem.paths and shape[1] > 0:
        return record
    wanted = (
        f"({problem.paths}, samples) of the paths asked for, or (samples,) of a single path, at "
        f"least {BATCHES} of them"
    )
    hint = ""
    if record.ndim == 2 and shape[1] == problem.paths:
        hint = "; it seems to be transposed, paths come first"
    elif record.ndim == 2 and shape[0] == 1:
        hint = "; leave out the axis of length 1"
    raise ValueError(f"integrator returned {name} of shape {shape}, expected {wanted}{hint}")


def _speeds(entry: Any) -> Vector | list[Vector]:
    """Impact speeds as one array, or as one array per path where their numbers differ."""
    ragged = isinstance(entry, np.ndarray) and entry.dtype == object
    if (isinstance(entry, Sequence) or ragged) and any(hasattr(each, "__len__") for each in entry):
        return [_numbers("impact_speed", path) for path in entry]
    return _numbers("impact_speed", entry)


def _aligned(speeds: Vector | list[Vector], records: Mapping[str, Vector]) -> Vector | None:
    """Impact speeds at each sample, 0 where there is none; None if they are a list of events."""
    shape = np.shape(speeds) if isinstance(speeds, np.ndarray) else _common_shape(speeds)
    alike = any(shape == record.shape for record in records.values())
    return np.asarray(speeds) if alike else None


def _common_shape(rows: list[Vector]) -> tuple[int, ...]:
    shapes = {row.shape for row in rows}
    return (len(rows), *shapes.pop()) if len(shapes) == 1 else ()


def _parts(problem: Problem, record: Vector) -> list[Vector]:
    """A long record, cut into batches."""
    if problem.duration / BATCHES < SHORTEST_BATCH * problem.relaxation_time:
        raise ValueError(
            f"integrator returned a single path of {problem.duration:.3g} s, too short for "
            f"{BATCHES} batches of {SHORTEST_BATCH:g} relaxation times; raise relaxations to "
            f"{BATCHES * SHORTEST_BATCH:g} or more"
        )
    return list(np.array_split(record, BATCHES))


def _events(
    problem: Problem, returned: Mapping[str, Any], owner: str, single: Mapping[str, Vector]
) -> list[Vector]:
    """Impact speeds of each path, or of each batch of a single path."""
    speeds = _speeds(returned[f"{owner}impact_speed"])
    if not single:
        if len(speeds) != problem.paths or any(np.ndim(path) != 1 for path in speeds):
            raise ValueError(
                f"integrator returned impact_speed of shape {_shape_in_words(speeds)}, expected "
                f"one list of speeds for each of the {problem.paths} paths asked for, or the shape "
                "of the records"
            )
        return list(speeds)
    if f"{owner}impact_time" not in returned:
        raise ValueError(
            "integrator returned impact_speed as a list of events of a single path, which needs "
            "impact_time (s, from the end of the burn-in), got none"
        )
    times = _numbers("impact_time", returned[f"{owner}impact_time"])
    if np.ndim(times) != 1 or np.shape(speeds) != times.shape:
        raise ValueError(
            f"integrator returned impact_time of shape {times.shape} for impact_speed of shape "
            f"{_shape_in_words(speeds)}, expected one time for each impact of the single path"
        )
    # the last sample may lie beyond the duration by less than one step
    samples = min(len(record) for record in single.values())
    latest = problem.duration * (1.0 + 1.0 / samples)
    if not np.all((times >= 0.0) & (times <= latest)):
        raise ValueError(
            f"integrator returned impact_time from {times.min():g} to {times.max():g} s, expected "
            f"0 to {problem.duration:g} s; times count from the end of the burn-in of "
            f"{problem.burn_in:g} s, earlier impacts are left out"
        )
    batch = np.minimum((times / problem.duration * BATCHES).astype(int), BATCHES - 1)
    return [np.asarray(speeds)[batch == number] for number in range(BATCHES)]


def _shape_in_words(speeds: Vector | list[Vector]) -> str:
    if isinstance(speeds, np.ndarray):
        return str(speeds.shape)
    return str(_common_shape(speeds) or f"({len(speeds)}, different numbers)")
