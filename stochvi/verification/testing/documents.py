"""Problems for programs in any language. Chapters: files of plain numbers, and back; files that
other programs wrote."""

from __future__ import annotations

import csv
import difflib
import json
import math
import textwrap
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Unpack

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field

from stochvi.mathematics.units import checked
from stochvi.model.model import UPPER, Model, Pair, inertia_of
from stochvi.results.base import RESPONSE_QUANTITIES, DataFrame, Response
from stochvi.results.errors import SceneError, not_json
from stochvi.results.estimates import Estimate
from stochvi.scenes.excitations import (
    BASE,
    ConstantLoad,
    Excitation,
    TabulatedNoise,
    WhiteNoise,
)
from stochvi.scenes.impact_laws import Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Isolator, Matrices, Oscillator
from stochvi.scenes.text_tables import check_file, read_text
from stochvi.scenes.validation import Checked, Column, Count, Matrix, NonNegative, Number, Positive
from stochvi.verification.testing.judging import Judgement, Limits, judge_returned
from stochvi.verification.testing.problems import (
    AVERAGES,
    BATCHES,
    FEWEST_PATHS,
    PATHS,
    QUANTITIES,
    RELAXATIONS,
    SHORTEST_BATCH,
    Problem,
    known_answers,
    known_problems,
    plain_name,
    returnable,
    solved,
    split,
    truths_of,
)

FORMAT = "stochvi problem 1"
"""Name and version of the form of a problem file."""

EQUATION = (
    "mass x'' + damping x' + stiffness x = constant_force + noise(t) between the stops. For one "
    "coordinate these are numbers, for several matrices and columns of these names. A noise on a "
    "coordinate is a force (N) on it alone. A noise on the base is an acceleration a(t) of the "
    "base (m/s^2); x is measured from the base and feels the force -mass a(t), for several "
    "coordinates -(mass times a column of ones) a(t)."
)

IMPACTS = (
    "The gap of a stop is y = x of the coordinate `on`; or it is x of the first minus x of the "
    "second of the two coordinates `between`. An upper stop is hit where y rises to its position, "
    "a lower one where y falls to it. At that moment the relative velocity y' becomes -restitution "
    "times what it was, and masses share momentum; an impact takes no time: all stops are rigid."
)

WHITE = (
    "E w(t) w(t + tau) = intensity * delta(tau). The two-sided density per rad/s is "
    "intensity / (2 pi), the two-sided density per Hz is intensity, and the one-sided density per "
    "Hz is 2 * intensity. In a time step h the integral of w is a normal number of the variance "
    "intensity * h; divided by the mass it is added to the velocity: m dv = ... dt + "
    "sqrt(intensity) dW, W a standard Wiener process (noise is additive, so that Ito and "
    "Stratonovich are the same)."
)

TABULATED = (
    "Stationary Gaussian noise of zero mean. `density` is one-sided per Hz; log density is "
    "linear in log frequency between the points, and 0 below the first and above the last. The "
    "mean square is the integral of density over frequency in Hz."
)

RUN = (
    "Each path starts at rest at `start`, at the time 0. Leave out the first `burn_in` seconds "
    "and average over the `duration` seconds that follow. Paths are independent of each other."
)

DEFINITIONS = {
    "displacement_mean": "Average over time and paths of x.",
    "displacement_mean_square": "Average over time of x^2, in each path.",
    "displacement_std": "Standard deviation of x about its mean: sqrt(<x^2> - <x>^2).",
    "velocity_mean_square": "Average over time of v^2, in each path.",
    "velocity_std": "Root of the average over time and paths of v^2.",
    "collision_rate": "Impacts faster than speed_threshold per second, at all stops of the pair.",
    "impact_speed_rate": "Sum of the speeds just before impact, of all impacts, per second.",
    "impact_speed_square_rate": "Sum of their squares, of all impacts, per second.",
}
"""Meanings of the quantities that are judged, and of the averages of a path from which they
follow."""


def _square(value: Any) -> Any:
    """A number as the matrix of one coordinate."""
    return [[value]] if isinstance(value, float | int) and not isinstance(value, bool) else value


def _listed(value: Any) -> Any:
    """A JSON list as a tuple; other values as they are."""
    return tuple(value) if isinstance(value, list) else value


def _column(value: Any) -> Any:
    return (value,) if isinstance(value, float | int) and not isinstance(value, bool) else value


Square = Annotated[Matrix, BeforeValidator(_square)]
Names = Annotated[tuple[str, ...], BeforeValidator(_listed), Field(min_length=1)]
Numbers = Annotated[
    tuple[Number, ...], BeforeValidator(_column), BeforeValidator(_listed), Field(min_length=1)
]


UNITS = {
    ("white", True): "(m/s^2)^2 s", ("white", False): "N^2 s",
    ("tabulated", True): "(m/s^2)^2/Hz", ("tabulated", False): "N^2/Hz",
}  # fmt: skip
"""Unit of a noise by its kind, and whether it moves the base."""


class NoiseEntry(Checked):
    """A noise of a problem file: white with an intensity, or tabulated with a density."""

    kind: Literal["white", "tabulated"]
    on: str
    unit: str
    intensity: Positive | None = None
    frequency_hz: Annotated[Column, BeforeValidator(_listed)] | None = None
    density: Annotated[Column, BeforeValidator(_listed)] | None = None
    convention: str = ""

    def excitation(self) -> WhiteNoise | TabulatedNoise:
        """The excitation that this entry stands for."""
        base = self.on == BASE
        if self.unit != (wanted := UNITS[self.kind, base]):
            where = "the base" if base else "a coordinate"
            sentence = f"must be {wanted!r} for {self.kind} noise on {where}, got {self.unit!r}"
            raise SceneError("unit", sentence)
        if self.kind == "tabulated":
            return TabulatedNoise(
                on=self.on, frequency_hz=self.frequency_hz, density=self.density,
                unit="(m/s2)2/Hz" if base else "N2/Hz",
            )  # fmt: skip
        if self.intensity is None:
            raise SceneError("intensity", "is missing, expected the intensity of the white noise")
        return WhiteNoise(on=self.on, intensity=self.intensity)


class StopEntry(Checked):
    """A stop of a problem file."""

    pair: str
    on: str | None = None
    between: Annotated[tuple[str, str], BeforeValidator(_listed)] | None = None
    side: Literal["lower", "upper"]
    position: Number
    restitution: Annotated[Number, Field(ge=0, le=1)]


class StartEntry(Checked):
    """The state at which paths start."""

    displacement: Numbers
    velocity: Numbers


class ProblemFile(Checked):
    """A problem file; `conventions`, `quantities` and `answer` are for readers, and not read."""

    format: Literal["stochvi problem 1"]
    name: str
    title: str = ""
    coordinates: Names
    mass: Square
    damping: Square
    stiffness: Square
    constant_force: Numbers
    noises: Annotated[tuple[NoiseEntry, ...], BeforeValidator(_listed), Field(min_length=1)]
    stops: Annotated[tuple[StopEntry, ...], BeforeValidator(_listed)] = ()
    start: StartEntry | None = None
    burn_in: Positive
    duration: Positive
    paths: Count
    speed_threshold: NonNegative = 0.0
    units: Any = None
    conventions: Any = None
    quantities: Any = None
    averages_per_path: Any = None
    answer: Any = None

    def problem(self) -> Problem:
        """The problem that the file describes."""
        if len(self.constant_force) != len(self.coordinates):
            raise SceneError(
                "constant_force",
                f"needs a number for each of the {len(self.coordinates)} coordinates, got "
                f"{len(self.constant_force)}",
            )
        return Problem(
            name=self.name,
            scene=Scene(
                title=self.title or self.name,
                structure=self._structure(),
                impact_pairs=list(self._pairs()),
                excitations=list(self._excitations()),
            ),
            speed_threshold=self.speed_threshold,
            burn_in=self.burn_in,
            duration=self.duration,
            paths=self.paths,
        )

    def _structure(self) -> Oscillator | Matrices:
        if self.coordinates == ("x",) and all(
            len(each) == len(each[0]) == 1 for each in (self.mass, self.damping, self.stiffness)
        ):
            numbers = (self.mass[0][0], self.damping[0][0], self.stiffness[0][0])
            mass, damping, stiffness = numbers
            moving = any(noise.on == BASE for noise in self.noises)
            kind = Isolator if moving else Oscillator
            return kind(mass=mass, damping=damping, stiffness=stiffness)
        return Matrices(
            coordinates=self.coordinates,
            mass=self.mass,
            damping=self.damping,
            stiffness=self.stiffness,
        )

    def _excitations(self) -> Iterator[Excitation]:
        for place, noise in enumerate(self.noises):
            try:
                yield noise.excitation()
            except SceneError as error:
                problems = [(f"noises.{place}.{key}", text) for key, text in error.problems]
                raise SceneError(problems) from None
        for name, force in zip(self.coordinates, self.constant_force, strict=True):
            if force:
                yield ConstantLoad(on=name, force=force)

    def _pairs(self) -> Iterator[ImpactPair]:
        for name in dict.fromkeys(stop.pair for stop in self.stops):
            stops = [stop for stop in self.stops if stop.pair == name]
            sides = [stop.side for stop in stops]
            places = {(stop.on, stop.between) for stop in stops}
            if len(set(sides)) < len(sides) or len(places) > 1:
                raise SceneError(
                    "stops",
                    f"must be at most one lower and one upper stop of the pair {name!r}, "
                    f"with the same on or between, got {', '.join(sides)}",
                )
            keys: dict[str, Any] = {stop.side: stop.position for stop in stops}
            keys |= {
                f"{stop.side}_law": Restitution(coefficient=stop.restitution) for stop in stops
            }
            yield ImpactPair(name=name, on=stops[0].on, between=stops[0].between, **keys)


@checked
def read_problem(path: str | Path) -> Problem:
    """The problem of a file that `stochvi problems --out` wrote; its numbers may have been changed.

    Parameters
    ----------
    path
        File of the problem.

    Returns
    -------
    Problem
        The numbers of the problem.

    Raises
    ------
    SceneError
        If the file is no such document; the message names the file, the key and what is expected.

    See Also
    --------
    stochvi.testing.problem_of : A problem of a scene.

    Examples
    --------
    >>> import tempfile
    >>> from stochvi.verification.testing.documents import problem_document
    >>> from stochvi.verification.testing.documents import problem_named
    >>> file = Path(tempfile.mkdtemp()) / "linear.json"
    >>> _ = file.write_text(json.dumps(problem_document(*problem_named("linear"))))
    >>> read_problem(file).intensity
    0.2
    """
    text = read_text(Path(path))
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise SceneError(
            f"{path} {not_json(error)}; a problem file is what `stochvi problems --out` writes"
        ) from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise SceneError(
            f"{path} must be a problem file with the key format = {FORMAT!r}, as "
            "`stochvi problems --out` writes it"
        )
    try:
        return ProblemFile(**document).problem()
    except SceneError as error:
        problems = [(f"{path}:", f"{key} {text}".strip()) for key, text in error.problems]
        raise SceneError(problems) from None


def problem_document(problem: Problem, answer: Response) -> dict[str, Any]:
    """A problem and its answer as plain types for JSON."""
    model = problem.model
    one = len(model.coordinates) == 1
    conventions = {"motion": EQUATION, "run": RUN}
    conventions |= {"impacts": IMPACTS} if model.stops else {}
    truths = truths_of(problem, answer)
    averages = [
        name
        for name in returnable(problem, AVERAGES)
        if name in truths or name.replace("_mean_square", "_std") in truths
    ]
    return {
        "format": FORMAT,
        "name": problem.name,
        "title": problem.scene.title,
        "coordinates": list(model.coordinates),
        **{
            name: matrix[0, 0].item() if one else matrix.tolist()
            for name, matrix in (
                ("mass", model.mass),
                ("damping", model.damping),
                ("stiffness", model.stiffness),
            )
        },
        "constant_force": (model.constant_force + 0.0).tolist(),
        "noises": list(_noises(model)),
        "stops": [entry for pair in model.pairs for entry in _stops(model, pair)],
        "start": {
            "displacement": list(problem.start),
            "velocity": [0.0] * len(model.coordinates),
        },
        "burn_in": problem.burn_in,
        "duration": problem.duration,
        "paths": problem.paths,
        "speed_threshold": problem.speed_threshold,
        "units": {
            "mass": "kg", "damping": "N s/m", "stiffness": "N/m", "constant_force": "N",
            "position": "m", "displacement": "m", "velocity": "m/s", "burn_in": "s",
            "duration": "s", "speed_threshold": "m/s",
        },
        "conventions": conventions,
        "quantities": [_quantity(name) for name in truths],
        "averages_per_path": [_quantity(name) for name in averages],
        "answer": {
            name: {
                "value": truth.value,
                "largest_error": truth.bias,
                "known_by": truth.how.split(",")[0],
            }
            for name, truth in truths.items()
        },
    }  # fmt: skip


def index_row(problem: Problem, answer: Response) -> dict[str, Any]:
    """The row of a problem in the index of all problems."""
    model = problem.model
    stops = [
        f"{pair.name} {stop.name} {stop.position:g} m R {stop.law.restitution:g}"
        for pair in model.pairs
        for stop in pair.stops
    ]
    kinds = [*(["white"] if model.whites else []), *(["tabulated"] if model.tables else [])]
    return {
        "problem": problem.name,
        "title": problem.scene.title,
        "coordinates": len(model.coordinates),
        "noise": " and ".join(kinds),
        "stops": "; ".join(stops) or "none",
        "burn_in_s": problem.burn_in,
        "duration_s": problem.duration,
        "paths": problem.paths,
        "known_by": "closed form" if answer.method == "exact" else "Fokker-Planck equation",
    }


def in_a_sentence(problem: Problem, answer: Response) -> str:
    """The structure, stops and noise of a problem, in a sentence."""
    row = index_row(problem, answer)
    masses = "one coordinate" if row["coordinates"] == 1 else f"{row['coordinates']} coordinates"
    count = len(problem.model.stops)
    stops = {0: "no stops", 1: "one rigid stop"}.get(count, f"{count} rigid stops")
    return (
        f"{problem.scene.title}: {masses} under {row['noise']} noise with {stops}, known by "
        f"{'a' if answer.method == 'exact' else 'the'} {row['known_by']}."
    )


README_WIDTH = 96
"""Largest number of characters in a line of the README of the problems."""


def readme() -> str:
    """The README of the problems: the conventions, and the files that are judged."""
    paragraphs = (
        EQUATION,
        RUN,
        f'Noise of kind "white": {WHITE}',
        f'Noise of kind "tabulated": {TABULATED}',
        f"Stops: {IMPACTS}",
    )
    conventions = "\n\n".join(textwrap.fill(paragraph, README_WIDTH) for paragraph in paragraphs)
    return README.format(conventions=conventions, paths=FEWEST_PATHS)


README = """Known-answer problems for integrators of stochastic vibration with impacts
===========================================================================

Each JSON file is one problem as plain numbers in SI units. index.csv lists them.

{conventions}

"quantities" are what is judged, "averages_per_path" the averages over time of each path that
they are made of. "answer" holds the true values with the largest error of each. Look there only to
learn; the command below compares for you.

Write one of three CSV files with a header line:

  statistics   quantity,value,standard_error          a row for each quantity; a column bias may
               velocity_std,1.002,0.003               state how far a step may bias the value
  averages     displacement_mean_square,...           a row for each path ({paths} or more)
               1.04,...
  records      path,time,x,v                          a row for each time of each path, the time
               0,120.0,0.31,-0.8                      from the start of the path, equal steps; a
                                                      column impact_speed may hold the speed of an
                                                      impact since the row before, 0 for none

With several coordinates or impact pairs a quantity has the name of its owner first, as in
first.displacement_std or wall.collision_rate. Then

  stochvi judge FILE.csv --problem NAME               or --problem FILE.json

ends with exit code 0 (it agrees), 1 (it disagrees, with what that looks like) or 2 (the file cannot
be read). Numbers in a JSON file may be changed: the answer is then calculated anew, where a closed
form or the Fokker-Planck equation knows it.
"""


def _quantity(name: str) -> dict[str, str]:
    kind = split(name)[1]
    return {"name": name, "unit": RESPONSE_QUANTITIES[kind].unit, "definition": DEFINITIONS[kind]}


def _noises(model: Model) -> Iterator[dict[str, Any]]:
    """The noises of a model; a force is scaled to the coordinate that it acts on."""
    base = inertia_of(model.mass, model.base_rows[:, 0])
    for strength, direction in model.whites:
        on = _place(model, direction, base)
        unit = UNITS["white", on == BASE]
        yield {
            "kind": "white", "on": on, "intensity": strength, "unit": unit, "convention": WHITE
        }  # fmt: skip
    for table, force in model.tables:
        on = _place(model, force, base)
        yield {
            "kind": "tabulated", "on": on, "frequency_hz": table.frequency_hz.tolist(),
            "density": table.density.tolist(), "unit": UNITS["tabulated", on == BASE],
            "convention": TABULATED,
        }  # fmt: skip


def _place(model: Model, direction: Any, base: Any) -> str:
    """The coordinate that a unit force acts on, or the base."""
    if math.isclose(float(abs(direction - base).max()), 0.0):
        return BASE
    return model.coordinates[int(abs(direction).argmax())]


def _stops(model: Model, pair: Pair) -> Iterator[dict[str, Any]]:
    names = model.coordinates
    if pair.relative:
        ends = [names[int(pair.direction.argmax())], names[int(pair.direction.argmin())]]
        place: dict[str, Any] = {"between": ends}
    else:
        place = {"on": names[int(pair.direction.argmax())]}
    for stop in pair.stops:
        yield {
            "pair": pair.name,
            **place,
            "side": "upper" if stop.side == UPPER else "lower",
            "position": stop.position,
            "restitution": stop.law.restitution,
        }


# ------------------------------------------------------------------------------
# Files that other programs wrote are read and judged: statistics, averages of each path, or
# records.
# ------------------------------------------------------------------------------


STATISTICS, PER_PATH, RECORDS = "statistics", "averages", "records"
FORMATS = (STATISTICS, PER_PATH, RECORDS)
"""The forms of a file: a row for each quantity, for each path, or for each time of each path."""

LARGEST_SHEET = 2_000_000_000
"""Largest size of a file of records, bytes: 10,000 paths of 1,000 samples take 500 million."""

SHORT_NAMES = {"x": "displacement", "v": "velocity"}
"""Short names that columns of records may have, with the names for which they stand."""

STEP_ERROR = 1e-3
"""Largest difference between one time step of a record and the mean step that passes for rounding
of the times; relative to the mean step."""

MOST_BAD_WORDS = 40
"""Number of characters of a wrong entry that a message shows."""


@dataclass(frozen=True)
class Sheet:
    """A table with a header: its cells, which are texts or numbers, and the number of each row in
    its source."""

    source: str
    header: tuple[str, ...]
    cells: Sequence[Sequence[Any]] | NDArray[np.float64]
    rows: Sequence[int]

    def numbers(self) -> NDArray[np.float64]:
        """All cells as numbers, (rows, columns)."""
        try:
            return np.array(self.cells, dtype=float)
        except (TypeError, ValueError):
            for row, cells in enumerate(self.cells):
                for name, cell in zip(self.header, cells, strict=True):
                    self.number(cell, row, name)
            raise

    def number(self, cell: Any, row: int, name: str) -> float:
        """A cell as a number."""
        try:
            return float(cell)
        except (TypeError, ValueError):
            got = repr(cell)[:MOST_BAD_WORDS]
            raise self.wrong(row, f"column {name}: expected a number, got {got}") from None

    def wrong(self, row: int, sentence: str) -> ValueError:
        """An error that names the source and the row."""
        return ValueError(f"{self.source}, row {self.rows[row]}, {sentence}")


@checked
def judge_file(
    path: str | Path,
    problem: str | Path,
    *,
    format: str | None = None,
    paths: int = PATHS,
    relaxations: float = RELAXATIONS,
    allowed_percent: float = 0.0,
    finds_percent: float | None = None,
) -> Judgement:
    """Judge the file that another program wrote for a problem.

    Parameters
    ----------
    path
        A text file with a header, its columns separated by commas, semicolons or tabs. Statistics
        have the columns quantity, value, standard_error and, if wanted, bias. Averages have a row
        for each path and a column for each average. Records have the columns time, displacement
        and velocity (or x and v), path where there are several, and impact_speed if wanted; rows
        before the burn-in is over are left out.
    problem
        Name of a problem that ships, or the file of one that `stochvi problems` wrote.
    format
        One of `FORMATS`; None to recognise it by the header.
    paths, relaxations
        Number of paths, and their length in relaxation times, that a problem that ships asks for; a
        file of a problem states its own.
    allowed_percent
        A bias that is harmless, in per cent of each quantity.
    finds_percent
        An error of each quantity, in per cent, that must be found; what would miss it does not
        pass.

    Returns
    -------
    Judgement
        The verdict; `read_as` says how the file was read.

    Raises
    ------
    ValueError
        If the file cannot be read in this form; the message names the file, the row and the column.

    See Also
    --------
    stochvi.testing.judge : The same of a function.
    stochvi.testing.read_problem : A problem from its file.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "mine.csv"
    >>> _ = file.write_text("quantity,value,standard_error\\nvelocity_std,1.001,0.004\\n")
    >>> judge_file(file, "linear").passed
    True
    """
    known = problem_named(problem, paths=paths, relaxations=relaxations)
    return judge_sheet(
        read_sheet(path), *known, format=format, allowed_percent=allowed_percent,
        finds_percent=finds_percent,
    )  # fmt: skip


def problem_named(
    problem: str | Path, *, paths: int = PATHS, relaxations: float = RELAXATIONS
) -> tuple[Problem, Response]:
    """A problem by its name or from its file, with its answer."""
    # a name comes before a file of that name, which may be the program that is judged
    if str(problem) not in known_answers() and (
        Path(problem).suffix.lower() == ".json" or Path(problem).is_file()
    ):
        own = read_problem(problem)
        truth = solved(own.scene, own.speed_threshold)
        thresholds = {pair["speed_threshold"] for pair in truth.impact_pairs.values()}
        if thresholds and thresholds != {own.speed_threshold}:
            raise ValueError(
                f"{problem}: speed_threshold must be 0 where the answer is a closed form, which "
                f"counts all impacts, got {own.speed_threshold:g}"
            )
        return own, truth
    if str(problem) not in known_answers():
        near = difflib.get_close_matches(str(problem), known_answers(), n=1)
        raise ValueError(
            "problem must be a name that `stochvi problems` lists, or a .json file that it wrote, "
            f"got {str(problem)!r}" + (f"; did you mean {near[0]!r}?" if near else "")
        )
    (known,) = known_problems([str(problem)], paths=paths, relaxations=relaxations)
    return known


def judge_sheet(
    sheet: Sheet,
    problem: Problem,
    truth: Response,
    *,
    format: str | None = None,
    **limits: Unpack[Limits],
) -> Judgement:
    """Judge a table by the known answer of a problem."""
    form = _recognised(sheet, problem) if format is None else format
    if form == STATISTICS:
        returned: dict[str, Any] = _statistics(sheet, problem)
        content = f"statistics of {len(returned)} quantities"
    elif form == PER_PATH:
        returned = _averages(sheet, problem)
        content = f"averages of {len(sheet.cells)} paths"
    elif form == RECORDS:
        returned, problem, content = _records(sheet, problem)
    else:
        raise ValueError(f"format must be one of {', '.join(FORMATS)}, got {form!r}")
    try:
        verdict = judge_returned(problem, truth, returned, **limits)
    except ValueError as error:
        text = str(error).replace("integrator returned", "holds")
        raise ValueError(f"{sheet.source}: {text}") from None
    return replace(verdict, read_as=f"{sheet.source} was read as {content}")


# Reading ----------------------------------------------------------------------------------------


def read_sheet(path: str | Path) -> Sheet:
    """The table of a text file; empty lines and lines that begin with # are left out."""
    check_file(Path(path), LARGEST_SHEET)
    try:
        with Path(path).open(encoding="utf-8-sig") as file:
            place, first = next(
                ((number, line) for number, line in enumerate(file, start=1) if _holds(line)),
                (0, ""),
            )
    except UnicodeDecodeError:
        raise ValueError(f"{path} is not text in UTF-8; write it as a CSV file") from None
    separator = max(";\t,", key=first.count)
    header = tuple(name.strip() for name in next(_rows(path, [first], separator), []))
    twice = [name for number, name in enumerate(header) if name in header[:number]]
    if twice:
        raise ValueError(f"{path}, header: the column {twice[0]!r} stands there twice")
    cells = None if "quantity" in header else _all_numbers(path, separator, place)
    if cells is not None and len(cells) and cells.shape[1] == len(header):
        return Sheet(str(path), header, cells, range(place + 1, place + 1 + len(cells)))
    return _texts(path, separator, header)


def _rows(path: str | Path, lines: Sequence[str], separator: str) -> Iterator[list[str]]:
    """The cells of each line."""
    try:
        yield from csv.reader(lines, delimiter=separator)
    except csv.Error as error:
        raise ValueError(f"{path} is not a table of numbers: {error}; write it again") from None


def _holds(line: str) -> bool:
    """Whether a line holds anything but a comment."""
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _all_numbers(path: str | Path, separator: str, header: int) -> NDArray[np.float64] | None:
    """The rows below the header if all cells are numbers, else None; this is quick for long
    files."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # on a file without rows
            return np.loadtxt(
                path, delimiter=separator, skiprows=header, ndmin=2, encoding="utf-8-sig",
                quotechar='"',
            )  # fmt: skip
    except ValueError:
        return None


def _texts(path: str | Path, separator: str, header: tuple[str, ...]) -> Sheet:
    """The table as texts, so that a cell that is wrong can be named."""
    lines = read_text(Path(path), LARGEST_SHEET).splitlines()
    kept = [(number, line) for number, line in enumerate(lines, start=1) if _holds(line)][1:]
    if not kept:
        raise ValueError(f"{path} must hold a header and at least one row below it, got none")
    cells = list(_rows(path, [line for _, line in kept], separator))
    if separator != ",":
        cells = [[cell.replace(",", ".") for cell in row] for row in cells]  # decimal commas
    for (number, _), row in zip(kept, cells, strict=True):
        if len(row) != len(header):
            comma = "; write decimals with a point" if separator == "," else ""
            raise ValueError(
                f"{path}, row {number}: expected {len(header)} columns as in the header "
                f"({', '.join(header)}), got {len(row)}{comma}"
            )
    return Sheet(str(path), header, cells, [number for number, _ in kept])


def sheet_of(frame: DataFrame) -> Sheet:
    """The table of a DataFrame; rows are counted from 0."""
    return Sheet(
        "the frame", tuple(map(str, frame.columns)), frame.to_numpy().tolist(), range(len(frame))
    )


def _recognised(sheet: Sheet, problem: Problem) -> str:
    """The form of a table by its header."""
    names = set(sheet.header)
    if "quantity" in names:
        return STATISTICS
    if "time" in names:
        return RECORDS
    averages = returnable(problem, AVERAGES)
    if names & {*averages, *returnable(problem, QUANTITIES)} or any(
        plain_name(problem, name) in averages for name in names
    ):
        return PER_PATH
    raise ValueError(
        f"{sheet.source}, header: expected the columns quantity, value, standard_error "
        "(statistics), time, x, v (records), or averages of each path "
        f"({', '.join(averages)}), got {', '.join(sheet.header)}"
    )


def _needed(sheet: Sheet, *names: str, form: str) -> None:
    missing = [name for name in names if name not in sheet.header]
    if missing:
        raise ValueError(
            f"{sheet.source}, header: {form} need the column {missing[0]}, got "
            f"{', '.join(sheet.header)}"
        )


def _statistics(sheet: Sheet, problem: Problem) -> dict[str, Estimate]:
    _needed(sheet, "quantity", "value", "standard_error", form="statistics")
    unknown = set(sheet.header) - {"quantity", "value", "standard_error", "bias", "unit"}
    if unknown:
        raise ValueError(
            f"{sheet.source}, header: expected quantity, value, standard_error and bias, got "
            f"{sorted(unknown)[0]!r}"
        )
    known = returnable(problem, QUANTITIES)
    found: dict[str, Estimate] = {}
    for row, cells in enumerate(sheet.cells):
        entry = dict(zip(sheet.header, cells, strict=True))
        stated = str(entry["quantity"]).strip()
        name = plain_name(problem, stated)
        if name not in known:
            root = name.replace("_mean_square", "_std")
            remedy = f"; give its root, {root}" if root in known else ""
            raise sheet.wrong(
                row,
                f"column quantity: expected one of {', '.join(known)}, got {stated!r}{remedy}",
            )
        if name in found:
            raise sheet.wrong(row, f"column quantity: {stated} stands there twice")
        value = sheet.number(entry["value"], row, "value")
        error = sheet.number(entry["standard_error"], row, "standard_error")
        bias = sheet.number(entry.get("bias", 0.0) or 0.0, row, "bias")
        if not math.isfinite(value):
            raise sheet.wrong(
                row,
                f"column value: expected a finite number, got {value}; the integration may have "
                "grown beyond all bounds",
            )
        # a count of 0 has no error of its own; every other number needs one
        if not (0.0 < error < math.inf or (error == 0.0 and value == 0.0)):
            raise sheet.wrong(
                row,
                f"column standard_error: expected a number above 0, got {error:g}; it is the "
                "standard deviation of the averages of the paths over the root of their number",
            )
        if not 0.0 <= bias < math.inf:
            raise sheet.wrong(row, f"column bias: expected a number of at least 0, got {bias:g}")
        found[name] = Estimate(value=value, standard_error=error, bias=bias)
    return found


def _averages(sheet: Sheet, problem: Problem) -> dict[str, NDArray[np.float64]]:
    known = returnable(problem, AVERAGES)
    for name in sheet.header:
        if name != "path" and plain_name(problem, name) not in known:
            square = name.replace("_std", "_mean_square")
            remedy = f"; write {square}" if plain_name(problem, square) in known else ""
            raise ValueError(
                f"{sheet.source}, header: expected the averages {', '.join(known)}, and path if "
                f"wanted, got {name!r}{remedy}"
            )
    if len(sheet.cells) < FEWEST_PATHS:
        raise ValueError(
            f"{sheet.source}: expected averages of at least {FEWEST_PATHS} independent paths, a "
            f"row each, got {len(sheet.cells)}"
        )
    columns = sheet.numbers().T
    return {
        name: column for name, column in zip(sheet.header, columns, strict=True) if name != "path"
    }


def _records(sheet: Sheet, problem: Problem) -> tuple[dict[str, Any], Problem, str]:
    """The records of all paths after the burn-in, the problem with the paths and the duration that
    were found, and how the file was read."""
    _needed(sheet, "time", form="records")
    names = {name: _record_name(sheet, problem, name) for name in sheet.header}
    values = sheet.numbers()
    columns = {names[name]: column for name, column in zip(sheet.header, values.T, strict=True)}
    time, path = columns.pop("time"), columns.pop("path", np.zeros(len(values)))
    finite = np.isfinite(time)
    if not finite.all():
        row = int(np.argmin(finite))
        raise sheet.wrong(row, f"column time: expected a finite number, got {time[row]:g}")
    order = np.lexsort((time, path))
    counts = np.unique(path, return_counts=True)[1]
    if len(set(counts.tolist())) > 1:
        raise ValueError(
            f"{sheet.source}: expected the same times for all paths, got {counts.min()} rows of "
            f"one path and {counts.max()} of another"
        )
    shape = (len(counts), int(counts[0]))
    times = time[order].reshape(shape)
    step = _step(sheet, times, order.reshape(shape))
    kept = times[0] > problem.burn_in - 0.5 * step
    if kept.sum() < 2:
        raise ValueError(
            f"{sheet.source}: records end at {times.max():.6g} s, but the burn-in lasts "
            f"{problem.burn_in:.6g} s from the start of a path; times count from that start"
        )
    found = {name: column[order].reshape(shape)[:, kept] for name, column in columns.items()}
    duration = float(kept.sum() * step)
    if shape[0] == 1:
        needed = BATCHES * SHORTEST_BATCH * problem.relaxation_time
        if duration < needed:
            raise ValueError(
                f"{sheet.source}: expected {needed:.4g} s or more of a single path after the "
                f"burn-in of {problem.burn_in:.4g} s, or {FEWEST_PATHS} or more paths, got "
                f"{duration:.4g} s"
            )
        found = {name: column[0] for name, column in found.items()}
    elif shape[0] < FEWEST_PATHS:
        raise ValueError(
            f"{sheet.source}: expected records of one long path, or of at least {FEWEST_PATHS} "
            f"independent paths, got {shape[0]}"
        )
    content = (
        f"records of {shape[0]} {'path' if shape[0] == 1 else 'paths'}, {duration:.6g} s in steps "
        f"of {step:.4g} s after the burn-in of {problem.burn_in:.6g} s"
    )
    return found, replace(problem, paths=shape[0], duration=duration), content


def _record_name(sheet: Sheet, problem: Problem, name: str) -> str:
    """The name of a record that a column stands for: x and v may be short, and one oscillator
    may have its owner named."""
    owner, short = split(name)
    full = plain_name(problem, owner + SHORT_NAMES.get(short, short))
    known = returnable(problem, ("displacement", "velocity", "impact_speed"))
    if full not in known and name not in ("time", "path"):
        raise ValueError(
            f"{sheet.source}, header: expected the records time, path, {', '.join(known)} (or x "
            f"and v for displacement and velocity), got {name!r}"
        )
    return full


def _step(sheet: Sheet, times: NDArray[np.float64], rows: NDArray[np.intp]) -> float:
    """The time step of records, which must be the same throughout."""
    if times.shape[1] < 2:
        raise ValueError(f"{sheet.source}: expected two or more times of each path, got 1")
    steps = np.diff(times, axis=1)
    step = float(np.median(steps))
    wrong = np.abs(steps - step) > STEP_ERROR * step + 1e-9 * np.abs(times).max()
    apart = np.abs(times[:, 0] - times[0, 0]) > 0.5 * step
    if wrong.any():
        path, place = divmod(int(wrong.argmax()), wrong.shape[1])
        raise sheet.wrong(
            int(rows[path, place + 1]),
            f"column time: expected equal steps of {step:.6g} s, got "
            f"{times[path, place + 1]:.9g} s after {times[path, place]:.9g} s",
        )
    if apart.any():
        late = int(apart.argmax())
        raise sheet.wrong(
            int(rows[late, 0]),
            f"column time: expected every path to begin at {times[0, 0]:.6g} s, got "
            f"{times[late, 0]:.6g} s",
        )
    return step


def judge_anything(
    problem: str | Path,
    found: Any,
    *,
    paths: int = PATHS,
    relaxations: float = RELAXATIONS,
    seed: int = 0,
    **limits: Unpack[Limits],
) -> Judgement:
    """Judge a function, a DataFrame, a mapping or a file by the answer of one problem.

    Parameters
    ----------
    found
        A function of (problem, seed) as `judge` takes it; a DataFrame of statistics, averages or
        records, as a file has them; a mapping as such a function returns it; or the name of a file.
    """
    known, truth = problem_named(problem, paths=paths, relaxations=relaxations)
    if callable(found):
        found = found(known, seed)
    if isinstance(found, str | Path):
        return judge_sheet(read_sheet(found), known, truth, **limits)
    if hasattr(found, "columns") and hasattr(found, "to_numpy"):
        return judge_sheet(sheet_of(found), known, truth, **limits)
    if not isinstance(found, Mapping):
        raise ValueError(
            "expected a function of (problem, seed), a DataFrame, a mapping or the name of a file, "
            f"got {type(found).__name__}"
        )
    return judge_returned(known, truth, found, **limits)
