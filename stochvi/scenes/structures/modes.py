"""Structures by their natural modes. Chapters: modes from files; the structure of given modes; what
bars, beams and plates share; bar; beam; plate."""

from __future__ import annotations

import itertools
import math
import re
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.rods import Shape, bar_compliance, bar_modes, beam_compliance, beam_modes
from stochvi.results.errors import SceneError
from stochvi.scenes.frames import Frame, Values, source_of
from stochvi.scenes.readers import UFF_SUFFIXES, Foreign, read_foreign, table_of
from stochvi.scenes.structures.oscillators import AnyStructure
from stochvi.scenes.validation import (
    Column,
    Count,
    NonNegative,
    NonNegatives,
    Numbers,
    Positive,
    given,
    sentences_of,
)

# ------------------------------------------------------------------------------
# Natural modes from files: tables of text, mode shapes of measurements and of finite elements.
#
# Reading gives the keys of a structure of kind "modes".
# ------------------------------------------------------------------------------


OWN_COLUMNS = ("frequency_hz", "zeta", "Q", "modal_mass", "participation")
"""Columns of a table of modes that are no points."""

SHAPES = {
    **dict.fromkeys(UFF_SUFFIXES, ("UFF modes", "datasets 55 of normal modes")),
    ".op2": ("Nastran modes", "mode shapes (DISPLACEMENT(PLOT) = ALL, PARAM,POST,-1)"),
    **dict.fromkeys(
        (".exo", ".e", ".ex2", ".g"), ("Exodus modes", "nodal variables disp*x, *y, *z")
    ),
}
"""Ending of a file of mode shapes -> its kind, and what it must hold."""

DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
"""Directions of the motion of a node in a file of mode shapes, in their order."""

RIGID_MOTION = 1e-6
"""Frequency of a mode, by that of the highest mode of its file, below which it is rounding for 0:
no spring holds this motion. Finite elements leave 1e-7 or so."""

UNEVEN_TURN = 0.1
"""Share of the largest angle by which the nodes of a rigid body may differ, by rounding."""

NODE = re.compile(r"(\d+)\.(-?)(r?[xyz])")
"""How a node and a direction are written."""

NAMES_LISTED = 8
"""Number of nodes or columns that a sentence lists."""


def read_modes(path: Path | Frame, points: Mapping[str, str] | None) -> dict[str, Any]:
    """Keys of a structure of kind "modes" from a frame, or a file, which its ending tells apart.

    Parameters
    ----------
    path
        The frame, or the file: mode shapes of UFF (.uff, .unv, .ufb, .uf), Nastran (.op2) or Exodus
        (.exo, .e), or a table of text.
    points
        Column of each point, by its name, or node and direction of mode shapes. Without points,
        every further column of a table is one.

    Raises
    ------
    SceneError
        If the file does not hold what is needed.
    """
    kind, content = SHAPES.get(path.suffix.lower(), ("", ""))
    if kind and isinstance(path, Path):
        found = _from_shapes(path, points, kind, content)
    else:
        found = _from_text(path, points)
    return {"source": path.name} | found


def _from_text(path: Path | Frame, points: Mapping[str, str] | None) -> dict[str, Any]:
    table = table_of(path, ("frequency_hz", "zeta"))
    names = [heading.name for heading in table.headings]
    columns = dict(zip(names, table.columns(*range(len(names))), strict=True))
    if "frequency_hz" not in columns:
        raise SceneError(
            f"{path} needs a heading with the columns frequency_hz, zeta and the points, got "
            f"{', '.join(names[:NAMES_LISTED]) or 'none'}"
        )
    for name, values in columns.items():
        if np.isnan(values).any():
            line = table.lines[int(np.argmax(np.isnan(values)))][0]
            raise SceneError(f"{path}, line {line}: has no number in the column {name}")
    wanted = points or {name: name for name in names if name not in OWN_COLUMNS}
    for name, column in wanted.items():
        if column not in columns:
            raise SceneError(
                f"{path} has no column {column!r} for the point {name!r}: it has "
                f"{', '.join(names[:NAMES_LISTED])}"
            )
    own = {name: columns[name].tolist() for name in OWN_COLUMNS if name in columns}
    return own | {"shapes": {name: columns[column].tolist() for name, column in wanted.items()}}


def _from_shapes(
    path: Path, points: Mapping[str, str] | None, kind: str, content: str
) -> dict[str, Any]:
    modes = read_foreign(path, kind)
    if not modes:
        raise SceneError(f"{path} needs {content}, got none; export the mode shapes")
    turned = [each.name for each in modes if each.facts["complex"]]
    if turned:
        raise SceneError(
            f"{path} must hold real normal modes, got complex ones, the modes "
            f"{', '.join(turned[:NAMES_LISTED])}; export normal modes"
        )
    cases = len({each.facts.get("case") for each in modes})
    if cases > 1:
        raise SceneError(f"{path} must hold the modes of one subcase, got {cases}; export one")
    nodes = [] if modes[0].x is None else modes[0].x.astype(int).tolist()
    if not points:
        raise SceneError(
            'needs points beside file, as points = { tip = "12.z" } with node and direction; '
            f"{path} has the nodes {', '.join(map(str, nodes[:NAMES_LISTED]))}"
            f"{' and more' if len(nodes) > NAMES_LISTED else ''}"
        )
    frequency = np.array([each.facts["frequency_hz"] for each in modes])
    frequency = np.where(frequency < RIGID_MOTION * frequency.max(), 0.0, frequency)
    free = [each for each, hz in zip(modes, frequency, strict=True) if hz == 0.0]
    bent = sum(_bends(each.y) for each in free)
    if bent or len(free) > len(DIRECTIONS):
        can = (
            f"{bent} of which {'bends' if bent == 1 else 'bend'} the structure, which is no free "
            "motion: they" if bent else
            f"of which at most {len(DIRECTIONS)} can be free motions: the others"
        )  # fmt: skip
        raise SceneError(
            f"{path} must hold natural modes, got {len(free)} shapes of 0 Hz, {can} are static "
            "ones, as of a Craig-Bampton reduction; export the natural modes alone, or the "
            'matrices (kind = "matrices")'
        )
    found: dict[str, Any] = {
        "frequency_hz": frequency.tolist(),
        "shapes": {
            name: [_motion(path, each, place) for each in modes] for name, place in points.items()
        },
    }
    masses = [each.facts["modal_mass"] for each in modes]
    if all(masses):
        found["modal_mass"] = masses
    ratios = [each.facts["zeta"] for each in modes]
    if any(ratios):
        found["zeta"] = ratios
    return found


def _bends(shape: Matrix) -> bool:
    """Whether nodes of a shape turn by different angles, as those of a rigid body do not. Nodes
    that do not turn may be of elements without rotations."""
    turns = shape[np.any(shape[:, 3:], axis=1), 3:]
    largest = np.abs(turns).max(initial=0.0)
    if len(turns) < 2 or largest < RIGID_MOTION * np.abs(shape).max():
        return False
    return bool(np.ptp(turns, axis=0).max() > UNEVEN_TURN * largest)


def _motion(path: Path, mode: Foreign, place: str) -> float:
    """Motion of a node along a direction in a mode."""
    read = NODE.fullmatch(place.replace(" ", ""))
    if read is None:
        raise SceneError(
            f"points must be nodes with a direction, as '12.z' or '12.-z', got {place!r}"
        )
    node, sign, direction = int(read[1]), -1.0 if read[2] else 1.0, DIRECTIONS.index(read[3])
    nodes = np.empty(0) if mode.x is None else mode.x
    (row,) = np.nonzero(nodes == node)
    if len(row) != 1 or direction >= mode.y.shape[1]:
        listed = ", ".join(f"{each:.0f}" for each in nodes[:NAMES_LISTED])
        raise SceneError(
            f"{path} has no motion {place!r} in mode {mode.name}: it has the nodes {listed}"
            f"{' and more' if len(nodes) > NAMES_LISTED else ''}, along "
            f"{', '.join(DIRECTIONS[: mode.y.shape[1]])}"
        )
    return sign * float(mode.y[row[0], direction])


# ------------------------------------------------------------------------------
# Structures by their natural modes: displacement at a point = sum of shape_k q_k, with
#
#     m_k (q_k'' + 2 zeta_k omega_k q_k' + omega_k^2 q_k) = sum of shape_k force - m_k G_k a_base
#
# for each mode k of modal mass m_k and participation factor G_k.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ModalTable:
    """The modes of a structure, n of them, and what of it they leave out.

    Parameters
    ----------
    omega, zeta, mass
        Natural frequencies (rad/s), damping ratios and modal masses (kg), (n,) each.
    shapes
        Displacements of named points in each mode, (n,).
    participation
        Participation factors (n,) of a base that moves; None where none is known.
    """

    omega: Vector
    zeta: Vector
    mass: Vector
    shapes: Mapping[str, Vector]
    participation: Vector | None

    def part(self, kept: slice) -> ModalTable:
        """Some of the modes."""
        return ModalTable(
            omega=self.omega[kept],
            zeta=self.zeta[kept],
            mass=self.mass[kept],
            shapes={name: shape[kept] for name, shape in self.shapes.items()},
            participation=None if self.participation is None else self.participation[kept],
        )


class ModalStructure(AnyStructure):
    """Base class of the structures that are made of natural modes."""

    needed_to_move: ClassVar[str] = (
        "structure.participation, a number for each mode: (shape' M 1) / modal_mass, got none"
    )

    @property
    @abstractmethod
    def table(self) -> ModalTable:
        """The modes."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the modal coordinates."""
        return tuple(f"mode {k + 1}" for k in range(len(self.table.omega)))

    @property
    def matrices(self) -> tuple[Matrix, ...]:
        """Modal mass, damping and stiffness, which are diagonal."""
        omega, mass = self.table.omega, self.table.mass
        return tuple(
            np.diag(mass * each) for each in (1.0, 2.0 * self.table.zeta * omega, omega**2)
        )

    @property
    def natural_frequency_hz(self) -> Vector:
        """Undamped natural frequencies in rising order (n,), Hz."""
        return self.table.omega / (2.0 * math.pi)

    @property
    def places(self) -> Mapping[str, Vector]:
        """Rows (n,) of the points, then of the modal coordinates."""
        return {**self.table.shapes, **super().places}

    def cautions(self, rigid: Sequence[str]) -> list[str]:
        if not rigid or len(self.table.omega) == 1:
            return []
        return [
            f"rigid stops of {', '.join(rigid)}: the mass that rebounds falls with every mode, and "
            "with it the rate and the force of impacts change; compare with other numbers of "
            "modes, or give the stop its stiffness (law.kind = 'elastic' or 'hertz')"
        ]

    @property
    def reported(self) -> Mapping[str, Vector]:
        return self.table.shapes

    @property
    def shown(self) -> tuple[str, ...]:
        return tuple(self.table.shapes)

    @property
    def movable(self) -> bool:
        return self.table.participation is not None

    @property
    def carried(self) -> Mapping[str, Vector]:
        found = self.table.participation
        return {"": np.zeros(len(self.table.omega)) if found is None else found}


def _several(value: object) -> object:
    """A list as it is, one number as a list of one."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (value,)
    return value


def _or_one(**limit: float) -> WithJsonSchema:
    """Schema of a list of numbers within a limit, or one such number."""
    number = {"type": "number", **limit}
    return WithJsonSchema({"anyOf": [number, {"type": "array", "items": number}]})


OneOrMore = Annotated[NonNegatives, BeforeValidator(_several), _or_one(minimum=0.0)]
"""A number for all modes, or one for each."""

Positives = Annotated[Column, BeforeValidator(_several), _or_one(exclusiveMinimum=0.0)]
"""A positive number for all modes, or one for each."""


class Modes(ModalStructure):
    """A linear structure by its natural modes, measured or from finite elements.

    Parameters
    ----------
    frequency_hz
        Natural frequency of each mode, Hz; 0 for a motion that no spring holds.
    zeta, Q
        Damping ratio or quality factor, one for all modes or one for each; exactly one of the two.
    modal_mass
        Modal mass, kg, one for all modes or one for each; 1 where the shapes are normalised to the
        mass.
    shapes
        Displacement of each named point in each mode, in the direction that counts there.
    participation
        Participation factor of each mode for a base that moves, (shape' M 1) / modal_mass; left
        out where the base stands still.
    residual_compliance
        Static compliance (m/N) at points by all modes that are not given; it lies in series with
        a compliant stop there.
    modes, max_frequency_hz
        Number of modes that move, from the lowest; or all up to a frequency, Hz. The others yield
        by their static compliance, which adds to `residual_compliance`.
    file
        Instead of these: a table (.csv) with a row for each mode and columns called frequency_hz,
        zeta or Q, modal_mass, participation and after the points; or mode shapes of a UFF file
        (datasets 55), of Nastran (.op2) or of Exodus (.exo, .e), with the extra `fem`.
    values
        In Python instead of a file: a frame of these columns, a row for each mode.
    points
        With a file or a frame: a name for each point, and its column. Files of mode shapes take
        node and direction, as { tip = "12.z" } or "12.-z".
    source
        Where the numbers come from; by default the name of the file.

    Raises
    ------
    SceneError
        If lists differ in length, or a file does not hold what is needed.

    See Also
    --------
    stochvi.scenes.Beam : A beam, whose modes are computed.
    stochvi.Matrices : A structure by its matrices.

    Examples
    --------
    >>> blade = Modes(frequency_hz=[20.0, 125.0], zeta=0.01, shapes={"tip": [1.0, -1.0]})
    >>> blade.coordinates, blade.places["tip"].tolist()
    (('mode 1', 'mode 2'), [1.0, -1.0])
    """

    kind: Literal["modes"] = "modes"
    frequency_hz: NonNegatives = Field(min_length=1)
    zeta: OneOrMore | None = None
    Q: Positives | None = None
    modal_mass: Positives = (1.0,)
    shapes: dict[str, Numbers]
    participation: Numbers | None = None
    residual_compliance: dict[str, NonNegative] | None = None
    modes: Count | None = None
    max_frequency_hz: Positive | None = None
    file: str | None = None
    values: Values | None = None
    points: dict[str, str] | None = None
    source: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, keys: Any) -> Any:
        """The keys with the numbers of the file or the values in their place, if given."""
        origin = source_of(keys)
        if origin is None:
            return keys
        key, source = origin
        points = keys.get("points")
        if points is not None and not (
            isinstance(points, dict) and all(isinstance(each, str) for each in points.values())
        ):
            raise SceneError(
                "points", f'must name columns or nodes, as {{ tip = "12.z" }}, got {points!r}'
            )
        with sentences_of(key):
            found = read_modes(source, points)
        kept = {name: value for name, value in keys.items() if name not in (key, "points")}
        twice = sorted(found.keys() & kept.keys() - {"source"})
        if {"zeta", "Q"} & kept.keys():
            found = {name: value for name, value in found.items() if name not in ("zeta", "Q")}
        twice = [name for name in twice if name not in ("zeta", "Q", "modal_mass")]
        if twice:
            raise ValueError(f"takes {twice[0]} from the file or from the scene, got both")
        return found | kept

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        count = len(self.frequency_hz)
        problems = []
        if self.points is not None:
            problems.append(("points", "is for a file; give shapes"))
        if (self.zeta is None) == (self.Q is None):
            raise ValueError(f"needs exactly one of zeta and Q, got {given(self, 'zeta', 'Q')}")
        for name in ("zeta", "Q", "modal_mass", "participation"):
            values = getattr(self, name)
            if values is not None and len(values) != count and (
                len(values) != 1 or name == "participation"
            ):  # fmt: skip
                problems.append(
                    (name, f"must hold {count} numbers, one for each mode, got {len(values)}")
                )
        if self.modes is not None and self.max_frequency_hz is not None:
            raise ValueError("needs at most one of modes and max_frequency_hz, got both")
        if self.modes is not None and self.modes > count:
            problems.append(
                ("modes", f"must be at most the {count} that are given, got {self.modes}")
            )
        elif not self._moving:
            problems.append(
                ("max_frequency_hz", "must be above the lowest natural frequency, got "
                 f"{self.max_frequency_hz:g}; raise it, or give modes = 1")
            )  # fmt: skip
        if not self.shapes:
            problems.append(("shapes", "must name one point at least, got none"))
        for name, shape in self.shapes.items():
            if not name or name in ("base", *self.coordinates_of(count)):
                problems.append(
                    ("shapes", "must have names other than 'base' and those of modes, got "
                     f"{name!r}; choose another name")
                )  # fmt: skip
            elif len(shape) != count:
                problems.append(
                    (
                        f"shapes.{name}",
                        f"must hold {count} numbers, one for each mode, got {len(shape)}",
                    )
                )
        for name in self.residual_compliance or {}:
            if name not in self.shapes:
                problems.append(
                    ("residual_compliance", f"must name points of shapes, got {name!r}; known are "
                     f"{', '.join(self.shapes)}")
                )  # fmt: skip
        if problems:
            raise SceneError(problems)
        return self

    @staticmethod
    def coordinates_of(count: int) -> tuple[str, ...]:
        """Names of the modal coordinates of so many modes."""
        return tuple(f"mode {k + 1}" for k in range(count))

    @property
    def _moving(self) -> int:
        """Number of the modes that move."""
        if self.max_frequency_hz is not None:
            return sum(each <= self.max_frequency_hz for each in self.frequency_hz)
        return len(self.frequency_hz) if self.modes is None else self.modes

    @cached_property
    def given_modes(self) -> ModalTable:
        """All modes that are given, in rising order of their frequencies."""
        frequency = np.array(self.frequency_hz)
        order = np.argsort(frequency, kind="stable")
        zeta = np.array(self.zeta) if self.Q is None else 0.5 / np.array(self.Q)

        def each(values: Any) -> Vector:
            return np.broadcast_to(np.array(values, dtype=float), frequency.shape)[order]

        return ModalTable(
            omega=2.0 * math.pi * frequency[order],
            zeta=each(zeta),
            mass=each(self.modal_mass),
            shapes={name: each(shape) for name, shape in self.shapes.items()},
            participation=None if self.participation is None else each(self.participation),
        )

    @cached_property
    def table(self) -> ModalTable:
        """The modes that move, in rising order of their frequencies."""
        return self.given_modes.part(slice(self._moving))

    def compliance(self, weights: Mapping[str, float]) -> float:
        stated = self.residual_compliance or {}
        found = sum(weight**2 * stated.get(name, 0.0) for name, weight in weights.items())
        others = self.given_modes.part(slice(self._moving, None))
        if not set(weights) <= set(others.shapes):  # a modal coordinate has no point
            return found
        row = np.sum([weight * others.shapes[name] for name, weight in weights.items()], axis=0)
        return found + float(np.sum(row**2 / (others.mass * others.omega**2)))

    def cautions(self, rigid: Sequence[str]) -> list[str]:
        free = int(np.sum(self.table.omega == 0.0))
        if not free or self.source is None:
            return super().cautions(rigid)
        return [
            f"{free} of the shapes in {self.source} {'is' if free == 1 else 'are'} of 0 Hz and "
            "taken for free motions that no spring holds; static shapes, as of a Craig-Bampton "
            "reduction, are no modes: export the natural modes alone",
            *super().cautions(rigid),
        ]

    def assumptions(self) -> list[str]:
        found = [] if self.source is None else [f"modes: {self.source}"]
        moving, every = self._moving, len(self.frequency_hz)
        if moving == every:
            return [*found, f"the structure moves by {moving} modes"]
        return [
            *found,
            f"the structure moves by {moving} of {every} modes; the static compliance of the "
            "others lies in series with elastic, viscoelastic and tabulated stops",
        ]


# ------------------------------------------------------------------------------
# What bars, beams and plates have in common: modes from exact solutions, as many as are asked for,
# and the static compliance of those left out.
# ------------------------------------------------------------------------------


MOST_MODES = 200
"""Largest number of modes of a structure: the cost of a simulation grows with its square."""

Share = Annotated[NonNegative, Field(le=1)]
"""A place by its share of a length, 0 to 1."""


class Mode(NamedTuple):
    """A mode of a bar, beam or plate: frequency (rad/s), modal mass (kg), participation factor, and
    its displacement at each point."""

    omega: float
    mass: float
    participation: float
    at_points: Mapping[str, float]


class Span(ModalStructure):
    """Base class of bars, beams and plates.

    Parameters
    ----------
    young, density
        Modulus of elasticity, Pa, and density, kg/m^3.
    zeta, loss_factor
        Damping ratio of every mode; or the loss factor of the material, which is twice that.
        Exactly one of the two. A motion that no spring holds is not damped.
    modes, max_frequency_hz
        Number of modes; or all modes up to a frequency, Hz. Exactly one of the two.
    """

    young: Positive
    density: Positive
    zeta: NonNegative | None = None
    loss_factor: NonNegative | None = None
    modes: Count | None = None
    max_frequency_hz: Positive | None = None

    moves: ClassVar[str] = "deflection"
    """Its displacement in words."""

    if TYPE_CHECKING:  # keys of each, at their places among its keys

        @property
        def length(self) -> float:
            """Length, m."""

        @property
        def support(self) -> str:
            """How its ends are held."""

    @model_validator(mode="after")
    def _has_modes(self) -> Self:
        for one, other in (("zeta", "loss_factor"), ("modes", "max_frequency_hz")):
            if (getattr(self, one) is None) == (getattr(self, other) is None):
                raise ValueError(
                    f"needs exactly one of {one} and {other}, got {given(self, one, other)}"
                )
        problems = self.own_problems()
        if self.modes is not None and self.modes > MOST_MODES:
            problems.append(("modes", f"must be at most {MOST_MODES}, got {self.modes}"))
        for name in self.places_of_points:
            if not name or name == "base" or name.startswith("mode "):
                problems.append(
                    ("points", f"must have names other than 'base' and 'mode 1', got {name!r}; "
                     "choose another name")
                )  # fmt: skip
        if not problems and not self.found:
            problems.append(
                ("max_frequency_hz", f"must be above the lowest natural frequency, got "
                 f"{self.max_frequency_hz:g}; raise it, or give modes = 1")
            )  # fmt: skip
        if not problems and self.modes is not None and len(self.found) < self.modes:
            problems.append(("modes", self.why_no_more))
        if not problems and len(self.found) > MOST_MODES:
            problems.append(
                ("max_frequency_hz", f"must leave at most {MOST_MODES} modes below it, got "
                 f"{self.max_frequency_hz:g}; lower it")
            )  # fmt: skip
        if problems:
            raise SceneError(problems)
        return self

    def own_problems(self) -> list[tuple[str, str]]:
        """Fault of the keys of this structure: the key and a sentence each."""
        return []

    @property
    def why_no_more(self) -> str:
        """Why there are fewer modes than were asked for."""
        return f"must be at most {len(self.found)}, got {self.modes}"

    @property
    @abstractmethod
    def places_of_points(self) -> Mapping[str, Any]:
        """Where each named point lies, as shares of the lengths."""

    @property
    def sides(self) -> tuple[float, ...]:
        """Its length, m; of what has an area its width, too."""
        return (self.length,)

    def with_places(self, count: int) -> Self:
        """The same with "place 0", "place 1" and so on as its first points, `count` of them over
        each side, row after row."""
        share = np.linspace(0.0, 1.0, count).tolist()
        grid = list(itertools.product(share, repeat=len(self.sides)))
        places = {f"place {k}": at if len(at) > 1 else at[0] for k, at in enumerate(grid)}
        return self.replace(points={**places, **self.places_of_points})

    @property
    @abstractmethod
    def found(self) -> list[Mode]:
        """The modes that were asked for, in rising order of their frequencies."""

    @abstractmethod
    def flexibility(self, one: Any, two: Any) -> float:
        """Static deflection (m/N) at a place per unit force at another; 0 where nothing holds the
        structure."""

    def enough(self, frequency_hz: float, count: int) -> bool:
        """Whether modes may end, with so many found of which the last has this frequency."""
        if self.modes is not None:
            return count >= self.modes
        assert self.max_frequency_hz is not None
        return frequency_hz > self.max_frequency_hz or count > MOST_MODES

    @cached_property
    def table(self) -> ModalTable:
        """The modes."""
        ratio = self.zeta if self.zeta is not None else 0.5 * (self.loss_factor or 0.0)
        omega = np.array([mode.omega for mode in self.found])
        return ModalTable(
            omega=omega,
            zeta=np.where(omega > 0.0, ratio, 0.0),
            mass=np.array([mode.mass for mode in self.found]),
            shapes={
                name: np.array([mode.at_points[name] for mode in self.found])
                for name in self.places_of_points
            },
            participation=np.array([mode.participation for mode in self.found]),
        )

    def compliance(self, weights: Mapping[str, float]) -> float:
        places, table = self.places_of_points, self.table
        if not set(weights) <= set(places):  # a modal coordinate has no point
            return 0.0
        whole = sum(
            one * two * self.flexibility(places[a], places[b])
            for a, one in weights.items()
            for b, two in weights.items()
        )
        if not whole:
            return 0.0
        row = np.sum([weight * table.shapes[name] for name, weight in weights.items()], axis=0)
        return max(float(whole - np.sum(row**2 / (table.mass * table.omega**2))), 0.0)

    def assumptions(self) -> list[str]:
        highest = self.table.omega[-1] / (2.0 * np.pi)
        return [
            f"the structure moves by {len(self.found)} modes up to {highest:.4g} Hz; the static "
            "compliance of higher ones lies in series with elastic, viscoelastic and tabulated "
            "stops",
            "the damping ratio is that of each mode",
        ]


# ------------------------------------------------------------------------------
# A uniform bar that moves along itself, EA u'' = density area u_tt.
# ------------------------------------------------------------------------------


class Bar(Span):
    """A uniform bar whose points move along it: a rod that strikes a stop with its end.

    The wave speed is c = sqrt(young / density); a bar that is fixed at one end has the natural
    frequencies (k - 1/2) c / (2 length).

    Parameters
    ----------
    length, area
        Length, m, and area of the cross-section, m^2.
    young, density
        Modulus of elasticity, Pa, and density, kg/m^3.
    support
        "cantilever", fixed at 0 and free at 1; "clamped", fixed at both ends; or "free".
    tip_mass, tip_spring
        Mass (kg) at the free end of a cantilever, and spring (N/m) from it to the base.
    zeta, loss_factor
        Damping ratio of every mode, or loss factor, twice that.
    modes, max_frequency_hz
        Number of modes; or all modes up to a frequency, Hz.
    points
        Places that may meet stops, be forced and reported, by name: their shares of the length.

    See Also
    --------
    stochvi.scenes.Beam : A beam that bends.

    Examples
    --------
    >>> rod = Bar(length=1.0, area=1e-4, young=2e11, density=8000.0, zeta=0.01, modes=2)
    >>> rod.natural_frequency_hz.round(3).tolist(), rod.places["tip"].round(12).tolist()
    ([1250.0, 3750.0], [1.0, 1.0])
    """

    moves: ClassVar[str] = "displacement along the bar"

    kind: Literal["bar"] = "bar"
    length: Positive
    area: Positive
    support: Literal["cantilever", "clamped", "free"] = "cantilever"
    tip_mass: NonNegative = 0.0
    tip_spring: NonNegative = 0.0
    points: dict[str, Share] | None = None

    def own_problems(self) -> list[tuple[str, str]]:
        return tip_without_free_end(self.support, self.tip_mass, self.tip_spring)

    @property
    def places_of_points(self) -> Mapping[str, float]:
        return self.points or usual_points(self.support)

    @property
    def movable(self) -> bool:
        return self.support != "free"

    @property
    def carried_mass(self) -> float:
        return self.density * self.area * self.length + self.tip_mass

    @cached_property
    def found(self) -> list[Mode]:
        mass = self.density * self.area * self.length
        rate = math.sqrt(self.young / self.density) / self.length
        shapes = bar_modes(
            self.support,
            enough=lambda found: self.enough(
                found[-1].parameter * rate / (2.0 * math.pi) if found else 0.0, len(found)
            ),
            tip_mass=self.tip_mass / mass,
            tip_spring=self.tip_spring * self.length / (self.young * self.area),
        )
        return along(shapes, lambda z: rate * z, mass, self)

    def flexibility(self, one: float, two: float) -> float:
        soft = self.length / (self.young * self.area)
        return soft * bar_compliance(self.support, one, two, tip_spring=self.tip_spring * soft)


def along(shapes: list[Shape], omega_of, mass: float, span: Span) -> list[Mode]:  # type: ignore[no-untyped-def]
    """Modes of a bar or beam of this mass from their shapes; those above the frequency that was
    asked for are left out."""
    found = []
    for shape in shapes:
        omega = float(omega_of(shape.parameter))
        if span.max_frequency_hz is not None and omega > 2.0 * math.pi * span.max_frequency_hz:
            continue
        found.append(
            Mode(
                omega=omega,
                mass=mass * shape.square,
                participation=shape.mean / shape.square,
                at_points={
                    name: _no_rounding(float(shape.at(np.array(place))))
                    for name, place in span.places_of_points.items()
                },
            )
        )
    return found


NODE_ROUNDING = 1e-12
"""Displacement, relative to the largest of a mode, that counts as a rounding error at a node."""


def _no_rounding(value: float) -> float:
    return value if abs(value) > NODE_ROUNDING else 0.0


def usual_points(support: str) -> dict[str, float]:
    """The point that a structure has if none is named: the free end, or the middle."""
    return {"tip": 1.0} if support in ("cantilever", "free") else {"middle": 0.5}


def tip_without_free_end(support: str, mass: float, spring: float) -> list[tuple[str, str]]:
    """Fault of the mass and the spring at the tip: the key and a sentence each."""
    return [
        (key, f"is at the free end of support = 'cantilever' only, got support = {support!r}")
        for key, value in (("tip_mass", mass), ("tip_spring", spring))
        if value and support != "cantilever"
    ]


# ------------------------------------------------------------------------------
# A uniform beam that bends, of Euler and Bernoulli or of Timoshenko.
# ------------------------------------------------------------------------------


class Beam(Span):
    """A uniform beam whose points move across it.

    By Euler and Bernoulli EI w'''' + density area w_tt = 0, and the natural frequencies are
    beta^2 sqrt(EI / (density area)); Timoshenko adds shear and the inertia of rotation.

    Parameters
    ----------
    length
        Length, m.
    width, height
        Sides of a rectangular cross-section, m; the beam bends along the height.
    area, second_moment
        Instead: area, m^2, and second moment of area, m^4, of any cross-section.
    young, density
        Modulus of elasticity, Pa, and density, kg/m^3.
    theory
        "euler-bernoulli" or "timoshenko".
    poisson, shear_coefficient
        Poisson's ratio and shear coefficient of Timoshenko's theory.
    support
        "cantilever", clamped at 0 and free at 1; "pinned", "clamped" or "free" at both ends;
        "clamped-pinned", clamped at 0 and pinned at 1.
    tip_mass, tip_spring
        Mass (kg) at the free end of a cantilever, and spring (N/m) from it to the base.
    zeta, loss_factor
        Damping ratio of every mode, or loss factor, twice that.
    modes, max_frequency_hz
        Number of modes; or all modes up to a frequency, Hz.
    points
        Places that may meet stops, be forced and reported, by name: their shares of the length.

    See Also
    --------
    stochvi.scenes.Modes : A structure by its modes.
    stochvi.scenes.Plate : A rectangular plate.

    Examples
    --------
    >>> reed = Beam(
    ...     length=0.2, width=0.02, height=0.002, young=2e11, density=7850.0, zeta=0.01, modes=3
    ... )
    >>> reed.natural_frequency_hz.round(2).tolist(), reed.places["tip"].round(9).tolist()
    ([40.77, 255.5, 715.39], [1.0, 1.0, 1.0])
    """

    kind: Literal["beam"] = "beam"
    length: Positive
    width: Positive | None = None
    height: Positive | None = None
    area: Positive | None = None
    second_moment: Positive | None = None
    theory: Literal["euler-bernoulli", "timoshenko"] = "euler-bernoulli"
    poisson: NonNegative = 0.3
    shear_coefficient: Positive = 5.0 / 6.0
    support: Literal["cantilever", "pinned", "clamped", "clamped-pinned", "free"] = "cantilever"
    tip_mass: NonNegative = 0.0
    tip_spring: NonNegative = 0.0
    points: dict[str, Share] | None = None

    def own_problems(self) -> list[tuple[str, str]]:
        names = given(self, "width", "height", "area", "second_moment")
        if names not in ("width, height", "area, second_moment"):
            raise ValueError(f"needs width and height, or area and second_moment, got {names}")
        problems = tip_without_free_end(self.support, self.tip_mass, self.tip_spring)
        if self.poisson > 0.5:
            problems.append(("poisson", f"must be at most 0.5, got {self.poisson:g}"))
        return problems

    @property
    def why_no_more(self) -> str:
        return (
            f"must be at most {len(self.found)}, got {self.modes}: higher modes lie above the "
            f"frequency of shear, {self._shear_frequency_hz:.4g} Hz, up to which Timoshenko's "
            "theory holds"
        )

    @property
    def places_of_points(self) -> Mapping[str, float]:
        return self.points or usual_points(self.support)

    @property
    def movable(self) -> bool:
        return self.support != "free"

    @property
    def carried_mass(self) -> float:
        return self._mass + self.tip_mass

    @property
    def _section(self) -> tuple[float, float]:
        """Area, m^2, and second moment of area, m^4."""
        if self.width is not None and self.height is not None:
            return self.width * self.height, self.width * self.height**3 / 12.0
        assert self.area is not None and self.second_moment is not None
        return self.area, self.second_moment

    @property
    def _mass(self) -> float:
        return self.density * self._section[0] * self.length

    @property
    def _bending(self) -> float:
        """EI / L^3, N/m."""
        return self.young * self._section[1] / self.length**3

    @property
    def _thickness(self) -> tuple[float, float]:
        """r^2 = I / (A L^2) and s^2 = EI / (k G A L^2); zeros for a beam of Euler and Bernoulli."""
        if self.theory == "euler-bernoulli":
            return 0.0, 0.0
        area, second = self._section
        rotary = second / (area * self.length**2)
        return rotary, rotary * 2.0 * (1.0 + self.poisson) / self.shear_coefficient

    @property
    def _shear_frequency_hz(self) -> float:
        """Frequency at which a section turns without the beam bending, sqrt(kGA / (density I))."""
        rotary, shear = self._thickness
        return math.sqrt(self._bending / (self._mass * rotary * shear)) / (2.0 * math.pi)

    @cached_property
    def found(self) -> list[Mode]:
        rate = math.sqrt(self._bending / self._mass)
        rotary, shear = self._thickness
        shapes = beam_modes(
            self.support,
            enough=lambda found: self.enough(
                found[-1].parameter ** 2 * rate / (2.0 * math.pi) if found else 0.0, len(found)
            ),
            rotary=rotary,
            shear=shear,
            tip_mass=self.tip_mass / self._mass,
            tip_spring=self.tip_spring / self._bending,
        )
        return along(shapes, lambda beta: rate * beta**2, self._mass, self)

    def flexibility(self, one: float, two: float) -> float:
        spring = self.tip_spring / self._bending
        _, shear = self._thickness
        soft = beam_compliance(self.support, one, two, shear=shear, tip_spring=spring)
        return soft / self._bending


# ------------------------------------------------------------------------------
# A thin rectangular plate that is simply supported along its four edges.
# ------------------------------------------------------------------------------


WAVES = 400
"""Number of half waves along each side in the sum of a static deflection; it leaves out about
1 / WAVES^2 of the deflection."""


def _plain(values: object) -> object:
    return tuple(values) if isinstance(values, list) else values


Place = Annotated[tuple[Share, Share], BeforeValidator(_plain)]
"""A place on a plate by its shares of length and width."""


class Plate(Span):
    """A thin rectangular plate on simple supports, whose points move across it.

    Its rigidity is D = young height^3 / (12 (1 - poisson^2)).

    With m and n half waves along the sides
    omega = pi^2 (m^2 / length^2 + n^2 / width^2) sqrt(D / (density height)).

    Parameters
    ----------
    length, width, height
        Sides and thickness, m.
    young, density, poisson
        Modulus of elasticity, Pa, density, kg/m^3, and Poisson's ratio.
    support
        "pinned": simply supported along all edges, the one that is known.
    zeta, loss_factor
        Damping ratio of every mode, or loss factor, twice that.
    modes, max_frequency_hz
        Number of modes; or all modes up to a frequency, Hz.
    points
        Places that may meet stops, be forced and reported, by name: shares of length and width.

    See Also
    --------
    stochvi.scenes.Beam : A beam.

    Examples
    --------
    >>> panel = Plate(
    ...     length=0.4, width=0.3, height=0.002, young=7e10, density=2700.0, zeta=0.01, modes=3
    ... )
    >>> panel.natural_frequency_hz.round(2).tolist()
    [84.04, 174.8, 245.4]
    """

    kind: Literal["plate"] = "plate"
    length: Positive
    width: Positive
    height: Positive
    poisson: NonNegative = 0.3
    support: Literal["pinned"] = "pinned"
    points: dict[str, Place] | None = None

    def own_problems(self) -> list[tuple[str, str]]:
        if self.poisson > 0.5:
            return [("poisson", f"must be at most 0.5, got {self.poisson:g}")]
        return []

    @property
    def places_of_points(self) -> Mapping[str, tuple[float, float]]:
        return self.points or {"centre": (0.5, 0.5)}

    @property
    def sides(self) -> tuple[float, ...]:
        return (self.length, self.width)

    @property
    def carried_mass(self) -> float:
        return self.density * self.length * self.width * self.height

    @property
    def _rate(self) -> float:
        """pi^2 sqrt(D / (density height)), m^2/s."""
        stiffness = self.young * self.height**2 / (12.0 * (1.0 - self.poisson**2))
        return math.pi**2 * math.sqrt(stiffness / self.density)

    @cached_property
    def found(self) -> list[Mode]:
        if self.modes is not None:
            along, across = _waves(min(self.modes, MOST_MODES))
        else:
            assert self.max_frequency_hz is not None
            reach = math.sqrt(2.0 * math.pi * self.max_frequency_hz / self._rate)
            along, across = (
                np.arange(1, 1 + min(int(reach * side), 2 * MOST_MODES))
                for side in (self.length, self.width)
            )
        m, n = (each.ravel() for each in np.meshgrid(along, across, indexing="ij"))
        omega = self._rate * ((m / self.length) ** 2 + (n / self.width) ** 2)
        order = np.argsort(omega, kind="stable")
        if self.modes is not None:
            order = order[: self.modes]
        else:
            order = order[omega[order] <= 2.0 * math.pi * (self.max_frequency_hz or 0.0)]
        found = []
        for k in order[: MOST_MODES + 1]:
            odd = m[k] % 2 and n[k] % 2
            found.append(
                Mode(
                    omega=float(omega[k]),
                    mass=0.25 * self.carried_mass,
                    participation=16.0 / (math.pi**2 * m[k] * n[k]) if odd else 0.0,
                    at_points={
                        name: _no_rounding(
                            math.sin(m[k] * math.pi * x) * math.sin(n[k] * math.pi * y)
                        )
                        for name, (x, y) in self.places_of_points.items()
                    },
                )
            )
        return found

    def flexibility(self, one: tuple[float, float], two: tuple[float, float]) -> float:
        waves = np.arange(1, WAVES + 1)
        m, n = waves[:, None], waves[None, :]
        omega = self._rate * ((m / self.length) ** 2 + (n / self.width) ** 2)
        shapes = [np.sin(m * math.pi * x) * np.sin(n * math.pi * y) for x, y in (one, two)]
        return float(np.sum(shapes[0] * shapes[1] / omega**2) / (0.25 * self.carried_mass))


def _waves(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of half waves along each side, among which are the lowest `count` modes."""
    return np.arange(1, count + 1), np.arange(1, count + 1)
