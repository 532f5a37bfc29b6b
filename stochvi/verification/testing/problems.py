"""Problems for other integrators. Chapters: known answers of the zoo; a scene as plain numbers;
numbers that an integrator returns; the true values."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.numerics import CANCELLATION, Vector
from stochvi.mathematics.units import checked, with_checks
from stochvi.methods.closed_form import exact
from stochvi.methods.fokker_planck import fokker_planck
from stochvi.model.coverage import compliant, functions, scattered, without_noise
from stochvi.model.model import Model, Stop, model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.results.base import CoordinateResponse, PairResponse, Response
from stochvi.results.errors import NoExactSolution, NotApplicable, NotConverged
from stochvi.results.estimates import Estimate, jackknife_error
from stochvi.sampling.calculations import calculation
from stochvi.scenes.datasets import data_folder
from stochvi.scenes.scene import Scene
from stochvi.verification.check import zoo

# ------------------------------------------------------------------------------
# Known answers to scenes of the zoo; they ship in `data/known_answers`.
# ------------------------------------------------------------------------------


@checked
def known_answers(*names: str) -> dict[str, Response]:
    """Known responses to scenes of the zoo, by closed form or by the Fokker-Planck equation.

    `method` of a response says by which of them. `bias` of each estimate is a bound on its error,
    0 for a closed form. Scenes that only simulation answers are left out.

    Parameters
    ----------
    *names
        Scenes of the zoo; without names, all scenes that have a known response.

    Returns
    -------
    dict[str, Response]
        Answers by the names of their scenes.

    Raises
    ------
    ValueError
        If no answer to a scene of this name ships.

    See Also
    --------
    stochvi.testing.judge : Judges an integrator by them.

    Examples
    --------
    >>> known = known_answers("elastic-half-sigma", "lossy-0.5")
    >>> known["elastic-half-sigma"].coordinates["x"]["velocity_std"]
    1 [closed form]
    >>> known["lossy-0.5"].method
    'fokker-planck'
    """
    found = _shipped()
    unknown = [name for name in names if name not in found]
    if unknown:
        raise ValueError(
            f"names must be scenes with a known answer, got {unknown[0]!r}; "
            f"known: {', '.join(found)}"
        )
    return {name: found[name] for name in names or found}


@cache
def _shipped() -> Mapping[str, Response]:
    path = data_folder() / "known_answers" / "answers.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    rows: dict[str, list[dict[str, str]]] = {}
    for row in csv.DictReader(line for line in lines if not line.startswith("#")):
        rows.setdefault(row["scene"], []).append(row)
    scenes = zoo(*rows)
    return {name: _response(scenes[name], entries) for name, entries in rows.items()}


def _response(scene: Scene, rows: list[dict[str, str]]) -> Response:
    method = rows[0]["method"]
    how = "closed form" if method == "exact" else "Fokker-Planck equation, error from two meshes"
    coordinates: dict[str, dict[str, Estimate]] = {
        name: {} for name in scene.expanded.structure.coordinates
    }
    pairs: dict[str, dict[str, Any]] = {}
    for row in rows:
        estimate = Estimate(value=float(row["value"]), bias=float(row["bias"]), how=how)
        if row["of"] in coordinates:
            coordinates[row["of"]][row["quantity"]] = estimate
        else:
            pair = pairs.setdefault(row["of"], {"speed_threshold": float(row["speed_threshold"])})
            pair[row["quantity"]] = estimate
    return Response(
        method=method,
        coordinates={name: CoordinateResponse(**each) for name, each in coordinates.items()},
        impact_pairs={name: PairResponse(**each) for name, each in pairs.items()},
        effects=scene.effects(),
        assumptions=scene.assumptions(),
        provenance={"source": "data/known_answers/answers.csv", "scene": scene.document()},
    )


# ------------------------------------------------------------------------------
# A scene as plain numbers, for integrators that know nothing of this package.
# ------------------------------------------------------------------------------


SETTLED = 6.0
"""Relaxation times of burn-in: e^-6 of the start is left after them, and e^-12 of its energy."""


@with_checks
@dataclass(frozen=True, kw_only=True)
class Problem:
    """A linear structure under noise, with rigid stops or none, and the run that is asked for.

    One oscillator in white noise has numbers per unit mass:

        x'' + damping_rate x' + omega^2 x = load + w(t),   E w(t) w(t + tau) = intensity delta(tau),

    where a velocity v at a stop becomes -R v. In a time step h the noise adds a normal number of
    variance `intensity * h` to the velocity. Several coordinates, and noise of a tabulated density,
    are numbers of `model`: `mass`, `damping` and `stiffness` (n, n); `white`, the intensity matrix
    of the white forces (N^2 s); `constant_force` (n,); `tables`, one-sided densities with the
    forces (n,) per unit of each noise; and `pairs` with their stops.

    Parameters
    ----------
    name
        Name of the problem in a verdict.
    scene
        The whole scene, for integrators that read scenes.
    speed_threshold
        `collision_rate` counts impacts faster than this, m/s.
    burn_in, duration
        Seconds to leave out at the start of a path, and to count after that.
    paths
        How many independent paths are asked for.

    See Also
    --------
    stochvi.testing.problem_of : A problem of a scene.
    stochvi.testing.judge : What hands it to an integrator.
    """

    name: str
    scene: Scene
    speed_threshold: float
    burn_in: float
    duration: float
    paths: int

    @property
    def model(self) -> Model:
        """The numbers of the structure, its stops and its noise, in SI units."""
        return model_of(self.scene)

    @property
    def unowned(self) -> bool:
        """Whether quantities need no name of what they belong to: this is one oscillator."""
        return self.model.single

    @property
    def white_oscillator(self) -> bool:
        """Whether this is one oscillator under white noise alone."""
        return self.unowned and not self.model.tables

    @property
    def free(self) -> bool:
        """Whether there are no stops."""
        return not self.model.stops

    @property
    def omega(self) -> float:
        """Natural frequency of one oscillator, rad/s."""
        return self.model.omega

    @property
    def damping_rate(self) -> float:
        """Damping rate c / m of one oscillator, 1/s."""
        return self.model.damping_rate

    @property
    def intensity(self) -> float:
        """Intensity of the white noise on one oscillator, (m/s^2)^2 s."""
        return self.model.intensity

    @property
    def load(self) -> float:
        """Constant load on one oscillator per unit mass, m/s^2."""
        return self.model.load

    @property
    def lower(self) -> float:
        """Lower stop of one oscillator, m; minus infinity where there is none."""
        return self.model.lower_position

    @property
    def upper(self) -> float:
        """Upper stop of one oscillator, m; infinity where there is none."""
        return self.model.upper_position

    @property
    def restitution_lower(self) -> float:
        """R of the lower stop; 1 where there is none."""
        return _restitution(self.model.lower)

    @property
    def restitution_upper(self) -> float:
        """R of the upper stop; 1 where there is none."""
        return _restitution(self.model.upper)

    @property
    def relaxation_time(self) -> float:
        """Time in which the memory of a start falls to 1/e, without stops, s."""
        return _relaxation_time(self.model)

    @property
    def speed_scale(self) -> float:
        """Standard deviation of the velocity of one oscillator in white noise without stops,
        sqrt(intensity / (2 b)), m/s."""
        return math.sqrt(self.intensity / (2.0 * self.damping_rate))

    @property
    def restitution(self) -> float | None:
        """R of the stops; None without stops, or where two stops have different R."""
        found = {stop.law.restitution for stop in self.model.stops}
        return found.pop() if len(found) == 1 else None

    @property
    def start(self) -> tuple[float, ...]:
        """Displacements at which a path starts at rest, m: 0, or the stop beyond which 0 lies."""
        if self.model.single:
            return (min(max(0.0, self.lower), self.upper),)
        return (0.0,) * len(self.model.coordinates)


@calculation
def problem_of(
    scene: Scene,
    *,
    name: str = "",
    paths: int = 1024,
    relaxations: float = 20.0,
    speed_threshold: float = 0.0,
) -> Problem:
    """The numbers of a scene, for `paths` paths that last `relaxations` relaxation times each.

    Parameters
    ----------
    scene
        The scene.
    name
        Name of the scene.
    paths
        Number of paths.
    relaxations
        Length of a path in relaxation times of the oscillator.
    speed_threshold
        Slowest impact that a rate counts, m/s.

    Returns
    -------
    Problem
        The numbers of the problem.

    Raises
    ------
    NotApplicable
        Unless the structure is linear and damped, its stops are rigid with a number as restitution,
        and its noise is white or has a density.
    ValueError
        If `paths` or `relaxations` is not positive.

    See Also
    --------
    stochvi.testing.read_problem : A problem from its file.

    Examples
    --------
    >>> from stochvi.verification.check import zoo
    >>> problem = problem_of(zoo("elastic-upper-stop")["elastic-upper-stop"])
    >>> problem.lower, problem.upper, problem.intensity, problem.duration
    (-inf, 1.0, 0.2, 400.0)
    """
    if isinstance(paths, bool) or not isinstance(paths, (int, np.integer)) or paths < 1:
        raise ValueError(f"paths must be a whole number of at least 1, got {paths!r}")
    if not 0.0 < relaxations < math.inf:
        raise ValueError(f"relaxations must be a positive number, got {relaxations}")
    model = model_of(scene)
    unmet = _unmet(model)
    if unmet:
        raise NotApplicable("judge", unmet)
    relaxation = _relaxation_time(model)
    return Problem(
        name=name or scene.title,
        scene=scene,
        speed_threshold=speed_threshold,
        burn_in=SETTLED * relaxation,
        duration=relaxations * relaxation,
        paths=paths,
    )


def _unmet(model: Model) -> list[str]:
    """The conditions of a problem that a model does not meet."""
    unmet = [*functions(model), *scattered(model)]
    kinds = {"a sine" if signal.amplitude else "filtered noise" for signal in model.signals}
    unmet += [
        f"excitation must be white noise, a density or constant, got {kind}"
        for kind in sorted(kinds)
    ]
    unmet += compliant(model)
    named = [sorted(pair.direction[pair.direction != 0.0]) for pair in model.pairs]
    if len(model.base) > 1 or model.points or any(row not in NAMED for row in named):
        unmet.append(
            "structure.kind must be 'oscillator', 'isolator' or 'matrices', with pairs on a "
            "coordinate or between two: problems name pairs and noises by coordinates"
        )
    unmet += without_noise(model)
    if not unmet and not math.isfinite(_relaxation_time(model)):
        unmet.append(
            "structure.damping must be above 0, and damp every motion of the structure without "
            "its stops"
        )
    if not model.single:
        unmet += [
            f"impact_pair {pair.name} must be open where all displacements are 0, got a preload of "
            f"its {stop.name} stop; move that stop"
            for pair in model.pairs
            for stop in pair.stops
            if stop.deflection(0.0) > 0.0
        ]
    return unmet


NAMED = ([1.0], [-1.0, 1.0])
"""Entries of the gap of a pair on a coordinate, or between two."""


def _restitution(stop: Stop | None) -> float:
    """R of a rigid stop; 1 where there is none."""
    return 1.0 if stop is None else stop.law.restitution


def _relaxation_time(model: Model) -> float:
    """One over the real part of the slowest eigenvalue, s; without a spring, of the velocity.

    Infinite where a motion is not damped.
    """
    if len(model.coordinates) > 1:
        count = len(model.coordinates)
        inverse = np.linalg.inv(model.mass)
        states = np.block(
            [
                [np.zeros((count, count)), np.eye(count)],
                [-inverse @ model.stiffness, -inverse @ model.damping],
            ]
        )
        rates = np.linalg.eigvals(states)
        slowest = -float(rates.real.max())
        return 1.0 / slowest if slowest > UNDAMPED * float(np.abs(rates).max()) else math.inf
    half = 0.5 * model.damping_rate
    if half == 0.0:
        return math.inf
    if model.omega == 0.0:
        return 1.0 / model.damping_rate
    return 1.0 / (half - math.sqrt(max(half**2 - model.omega**2, 0.0)))


UNDAMPED = 1e-9
"""Decay rate, as a share of the fastest rate of a structure, below which it is rounding error."""


# ------------------------------------------------------------------------------
# The numbers that an integrator returns, with their standard errors.
# ------------------------------------------------------------------------------


Values = Mapping[str, Any]
Function = Callable[[Values], Any]
"""A function of the quantities, which may be numbers or arrays."""

IMPACTS = ("collision_rate", "impact_speed_rate", "impact_speed_square_rate")
"""Quantities of impacts: sums of w^0, w^1 and w^2 per second, w the impact speed."""

QUANTITIES = ("displacement_mean", "displacement_std", "velocity_std", *IMPACTS)
"""The quantities that are judged: moments, impacts per second, F1 and F2. The
standard deviation of the velocity and the rates show mistakes that displacements hide."""

AVERAGES = (
    "displacement_mean", "displacement_mean_square", "velocity_mean_square", *IMPACTS
)  # fmt: skip
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


# ------------------------------------------------------------------------------
# The true values by which a problem is judged, from the methods that know them.
# ------------------------------------------------------------------------------


PATHS = 1024
"""Number of paths that a problem asks of an integrator by default."""

RELAXATIONS = 20.0
"""Length of a path in relaxation times by default."""

RTOL = 1e-4
"""Relative error asked of the Fokker-Planck equation; the error that it reaches is the bias of a
true value."""


def known_problems(
    scenes: Mapping[str, Scene] | Iterable[str],
    *,
    paths: int = PATHS,
    relaxations: float = RELAXATIONS,
) -> list[tuple[Problem, Response]]:
    """The problem of each scene with the most certain answer to it.

    All problems are made before any is solved, so that a scene that is not allowed fails at once.
    """
    if isinstance(scenes, str):
        raise ValueError(f"scenes must be a list of names, got the one name {scenes!r}")
    given = scenes if isinstance(scenes, Mapping) else (*scenes,)
    named = dict(given) if isinstance(given, Mapping) else zoo(*given) if given else {}
    problems = [
        problem_of(scene, name=name, paths=paths, relaxations=relaxations)
        for name, scene in named.items()
    ]
    if isinstance(scenes, Mapping):
        answers = {name: solved(scene) for name, scene in scenes.items()}
    else:
        answers = known_answers(*named) if named else {}
    return [
        (replace(each, speed_threshold=_threshold(answers[name])), answers[name])
        for name, each in zip(named, problems, strict=True)
    ]


def shipped_problems(
    *, paths: int = PATHS, relaxations: float = RELAXATIONS
) -> list[tuple[Problem, Response]]:
    """Every problem that ships with its answer: all scenes of the zoo whose answer is known and
    that are linear structures with rigid stops or none."""
    found = []
    for name in known_answers():
        try:
            found += known_problems([name], paths=paths, relaxations=relaxations)
        except NotApplicable:
            continue
    return found


def solved(scene: Scene, speed_threshold: float | None = None, *, rtol: float = RTOL) -> Response:
    """The exact answer to a scene, or else that of the Fokker-Planck equation.

    Parameters
    ----------
    speed_threshold
        `collision_rate` counts impacts faster than this, m/s; None for that of `simulate`. A closed
        form counts all impacts.
    rtol
        Relative error asked of the Fokker-Planck equation.

    Raises
    ------
    NotApplicable
        If neither knows the answer.
    """
    try:
        return exact(scene)
    except NoExactSolution as reason:
        unknown = reason
    if speed_threshold is None:
        thresholds = make_plan(model_of(scene)).layout.thresholds
        speed_threshold = next(iter(thresholds.values()), None)
    try:
        return fokker_planck(scene, rtol=rtol, speed_threshold=speed_threshold)
    except NotConverged as reason:
        if not isinstance(reason.partial, Response):
            raise
        return reason.partial
    except NotApplicable as reason:
        raise NotApplicable(
            "judge", f"no exact answer is known ({unknown} {str(reason).rstrip('.')})"
        ) from None


def truths_of(problem: Problem, response: Response) -> dict[str, Estimate]:
    """The known quantities of a problem whose error is stated, by the names under which integrators
    return them.

    A mean that is rounding error is 0.
    """
    found: dict[str, Estimate] = {}
    known = response.estimates()
    for quantity in QUANTITIES:
        for (owner, name), truth in known.items():
            if name != quantity or truth.bias is None:
                continue
            full = name if problem.unowned else f"{owner}.{name}"
            size = known.get((owner, "displacement_std"))
            if name == "displacement_mean" and size is not None:
                rounding = abs(truth.value) <= CANCELLATION * size.value
                found[full] = replace(truth, value=0.0) if rounding else truth
            else:
                found[full] = truth
    return found


def _threshold(truth: Response) -> float:
    for pair in truth.impact_pairs.values():
        if isinstance(threshold := pair["speed_threshold"], float):
            return threshold
    return 0.0


def size_of(truths: Mapping[str, Estimate], name: str) -> float:
    """The size relative to which a difference of a quantity is stated: its true value, or of a mean
    displacement the standard deviation; 1 where that is 0."""
    deviation = truths.get(name.removesuffix("mean") + "std")
    if name.endswith("displacement_mean") and deviation is not None:
        return abs(deviation.value) or 1.0
    size = abs(truths[name].value)
    return size if size > 0.0 and math.isfinite(size) else 1.0
