"""Problems as files of plain numbers, for programs in any language, and back."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from stochvi.mathematics.arguments import checked
from stochvi.mathematics.spectra import Table
from stochvi.model.model import UPPER, Model, Pair, inertia_of
from stochvi.results.errors import SceneError
from stochvi.results.quantity_units import QUANTITY_UNITS
from stochvi.results.response import Response
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
from stochvi.scenes.text_tables import read_text
from stochvi.scenes.validation import Checked, Column, Count, Matrix, NonNegative, Number, Positive
from stochvi.verification.testing.problems import Problem
from stochvi.verification.testing.reference_values import truths_of
from stochvi.verification.testing.samples import AVERAGES, FEWEST_PATHS, returnable, split

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
        if self.kind == "white":
            self._check_unit("(m/s^2)^2 s" if base else "N^2 s")
            if self.intensity is None:
                raise SceneError(
                    [("intensity", "is missing, expected the intensity of the white noise")]
                )
            return WhiteNoise(on=self.on, intensity=self.intensity)
        self._check_unit("(m/s^2)^2/Hz" if base else "N^2/Hz")
        return TabulatedNoise(
            on=self.on, frequency_hz=self.frequency_hz, density=self.density,
            unit="(m/s2)2/Hz" if base else "N2/Hz",
        )  # fmt: skip

    def _check_unit(self, wanted: str) -> None:
        if self.unit != wanted:
            where = "the base" if self.on == BASE else "a coordinate"
            raise SceneError(
                [
                    (
                        "unit",
                        f"must be {wanted!r} for {self.kind} noise on {where}, got {self.unit!r}",
                    )
                ]
            )


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
                [
                    (
                        "constant_force",
                        f"needs a number for each of the {len(self.coordinates)} coordinates, got "
                        f"{len(self.constant_force)}",
                    )
                ]
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
                    [
                        (
                            "stops",
                            f"must be at most one lower and one upper stop of the pair {name!r}, "
                            f"with the same on or between, got {', '.join(sides)}",
                        )
                    ]
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
    >>> from stochvi.verification.testing.files import problem_named
    >>> file = Path(tempfile.mkdtemp()) / "linear.json"
    >>> _ = file.write_text(json.dumps(problem_document(*problem_named("linear"))))
    >>> read_problem(file).intensity
    0.2
    """
    try:
        document = json.loads(read_text(Path(path)))
    except (json.JSONDecodeError, RecursionError) as error:
        raise SceneError(
            f"{path} is not JSON ({error}); a problem file is what `stochvi problems --out` writes"
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
    return {"name": name, "unit": QUANTITY_UNITS[kind], "definition": DEFINITIONS[kind]}


def _noises(model: Model) -> Iterator[dict[str, Any]]:
    """The noises of a model; a force is scaled to the coordinate that it acts on."""
    base = inertia_of(model.mass, model.base_rows[:, 0])
    for strength, direction in model.whites:
        on = _place(model, direction, base)
        unit = "(m/s^2)^2 s" if on == BASE else "N^2 s"
        yield {
            "kind": "white", "on": on, "intensity": strength, "unit": unit,
            "convention": WHITE,
        }  # fmt: skip
    for table, force in model.tables:
        on = _place(model, force, base)
        yield {"kind": "tabulated", "on": on, **_points(table), "unit": _density_unit(on),
               "convention": TABULATED}  # fmt: skip


def _points(table: Table) -> dict[str, list[float]]:
    return {"frequency_hz": table.frequency_hz.tolist(), "density": table.density.tolist()}


def _density_unit(on: str) -> str:
    return "(m/s^2)^2/Hz" if on == BASE else "N^2/Hz"


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
