"""A scene: a structure, where it can hit, and what shakes it. Chapters: free drifts that nothing
resists; the class `Scene` and its files."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self, assert_never, get_args

import numpy as np
import scipy
from pydantic import Field, ValidationInfo, field_validator, model_validator
from pydantic.json_schema import SkipJsonSchema

from stochvi.mathematics.numerics import Array, Matrix
from stochvi.mathematics.spectra import Table
from stochvi.mathematics.units import check_methods, checked
from stochvi.mathematics.unsteady_noise import RandomLevel
from stochvi.results.errors import SceneError, toml_remedy
from stochvi.results.files import SceneDocument
from stochvi.scenes.absorbers import Absorber, absorbers_of, on_oscillator
from stochvi.scenes.excitations import (
    BASE,
    EXCITATIONS,
    ConstantLoad,
    DensityNoise,
    DrawnExcitation,
    Excitation,
    Excitations,
    FilteredNoise,
    Modulation,
    RoadNoise,
    Sine,
    WhiteNoise,
    check_unit,
)
from stochvi.scenes.excitations.base import Density, StrengthNoise
from stochvi.scenes.excitations.drawn import Pulses
from stochvi.scenes.excitations.noise import QuarterCar
from stochvi.scenes.forces import CrossDensity, changed_by, impossible, impossible_whites
from stochvi.scenes.impact_laws import (
    Elastic,
    ForceTable,
    Law,
    PowerLaw,
    Restitution,
    SpeedRestitution,
    Viscoelastic,
)
from stochvi.scenes.impact_laws.compliant import AS_WRITTEN
from stochvi.scenes.outside import origin_of
from stochvi.scenes.pair_tables import read_pairs
from stochvi.scenes.phases import Phase
from stochvi.scenes.structures import (
    AnyStructure,
    Matrices,
    NonlinearOscillator,
    Oscillator,
    Structure,
)
from stochvi.scenes.structures.rigid_body import AXES, RigidBody, Triple, rows_at
from stochvi.scenes.text_tables import read_text
from stochvi.scenes.validation import (
    PYTHON_ONLY,
    Checked,
    Mean,
    NonNegative,
    OneOf,
    VariedNumber,
    VariedPositive,
    Weights,
    given,
    mean_unit,
    varied,
)

# ------------------------------------------------------------------------------
# Free drifts: motions of a whole structure that no spring, damper or stop resists.
# ------------------------------------------------------------------------------


FORCE_TOLERANCE = 1e-10
"""Relative size up to which a force of springs, dampers or stops counts as a rounding error."""


def drifts(felt: Matrix, rows: Matrix) -> tuple[list[int], Matrix]:
    """Free drifts, and the reference coordinates relative to which the others do not drift.

    Parameters
    ----------
    felt
        Damping and stiffness matrices, one below the other (2 n, n).
    rows
        Rows (pairs, n) of the gaps.

    Returns
    -------
    references, motions
        Indices of k reference coordinates, and the drifts (n, k). Each drift moves one reference
        by 1 and no other, so that x_i - motions[i] . x[references] does not drift.

    Examples
    --------
    A mass that strikes another one, both of them free:

    >>> references, motions = drifts(np.zeros((4, 2)), np.array([[1.0, -1.0]]))
    >>> references, motions.round(12).tolist()
    ([1], [[1.0], [1.0]])
    """
    size = np.linalg.norm(felt, axis=0).max(initial=0.0) or 1.0
    free = scipy.linalg.null_space(np.vstack([felt / size, rows]), rcond=FORCE_TOLERANCE).T
    # a coordinate that other masses strike is preferred as a reference
    struck = np.sum(rows < 0.0, axis=0)
    references: list[int] = []
    for place in np.argsort(-struck, kind="stable").tolist():
        sizes = np.abs(free[:, place])
        if len(references) == len(free) or sizes[len(references) :].max() <= FORCE_TOLERANCE:
            continue
        chosen = len(references) + int(np.argmax(sizes[len(references) :]))
        free[[len(references), chosen]] = free[[chosen, len(references)]]
        pivot = free[len(references)] / free[len(references), place]
        free = free - np.outer(free[:, place], pivot)
        free[len(references)] = pivot
        references.append(place)
    return references, free.T


def without_drift(mass: Matrix, references: Sequence[int], motions: Matrix) -> Matrix:
    """Matrix (n - k, n) from forces on all coordinates to forces on the relative coordinates.

    The relative coordinates are the others, measured from the references. Their mass matrix is this
    matrix times the mass matrix of all coordinates, without the columns of the references.
    """
    kept = np.delete(np.arange(len(mass)), references)
    carried = mass @ motions
    whole = np.linalg.solve(motions.T @ carried, motions.T)
    return np.asarray((np.eye(len(mass)) - carried @ whole)[kept])


# ------------------------------------------------------------------------------
# A scene: a structure, where it can hit, and what shakes it.
# ------------------------------------------------------------------------------


class ImpactPair(Checked):
    """Where the mass can hit: a lower stop, an upper stop, or both.

    Parameters
    ----------
    name
        Name of the pair in answers; each pair needs one of its own.
    lower, upper
        Position of the stops, m from the unloaded spring; leave out for none. Without gravity or a
        load the mass rests there, so that these are its clearances.
        A stop beyond it (an upper stop below 0) is a preload. A `BetweenUnits` differs between
        units, and so may a clearance.
    clearance
        Instead of the two, one clearance on both sides, m: stops at -clearance and clearance.
    tolerance
        How much nearer than stated each stop may stand, m. Every calculation takes it to stand
        there; `size` and others that move stops ask for a scene without it.
    on, between, weights
        The coordinate or point that hits the stops, which may be left out if there is only one; or
        two of them, of which the difference, first minus second, is the gap; or the weights of
        several, as { tip = 0.5, middle = 0.5 }, whose sum is the gap.
    at, direction
        On a rigid body: the place that hits the stops, m from the centre of mass, and the direction
        in which its displacement counts as positive. The length of the direction does not matter.
    tangent
        Motion along the stops, where a law has `friction`: the name of a coordinate or point, the
        weights of several, or on a rigid body a direction.
    law, lower_law, upper_law
        The impact law of both stops, or of one where they differ.

    See Also
    --------
    stochvi.Restitution : The law of a hard stop.
    stochvi.Viscoelastic : The law of a rubber stop.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> pair = ImpactPair(lower=-1.0, upper=2.0, law=Restitution(coefficient=0.8))
    >>> pair.law_of("upper").coefficient
    0.8
    """

    name: str = "stops"
    on: str | None = None
    between: tuple[str, str] | None = None
    weights: Weights | None = None
    at: Triple | None = None
    direction: Triple | None = None
    tangent: str | Weights | Triple | None = None
    lower: VariedNumber | None = None
    upper: VariedNumber | None = None
    clearance: VariedPositive | None = Field(default=None, exclude=True)
    tolerance: NonNegative | None = None
    law: Law | None = None
    lower_law: Law | None = None
    upper_law: Law | None = None

    @field_validator("between", mode="before")
    @classmethod
    def _two_names(cls, names: Any) -> Any:
        return tuple(names) if isinstance(names, list) else names

    def replace(self, **changes: Any) -> Self:
        """The pair with other values of some keys, checked as a new one is.

        A new `clearance` moves both stops of a pair whose stops are equally far away.

        Parameters
        ----------
        **changes
            Keys and their new values; None takes a key out.

        Returns
        -------
        Self
            The new pair; the old one stays as it is.

        Raises
        ------
        SceneError
            If the new pair is not valid.

        Examples
        --------
        >>> from stochvi.scenes.impact_laws import Restitution
        >>> pair = ImpactPair(clearance=0.005, law=Restitution(coefficient=0.5))
        >>> pair.replace(clearance=0.002).upper, pair.replace(upper=0.007).lower
        (0.002, -0.005)
        """
        if changes.get("clearance") is not None and self.symmetric:
            changes = {"lower": None, "upper": None} | changes
        return super().replace(**changes)

    @property
    def symmetric(self) -> bool:
        """Whether there are two stops, equally far from the position of the unloaded spring."""
        lower, upper = self.lower, self.upper
        return lower is not None and upper is not None and math.isclose(-lower, upper)

    @model_validator(mode="after")
    def _stops(self) -> Self:
        if len(several := given(self, "on", "between", "weights").split(", ")) > 1:
            raise ValueError(f"takes one of on, between and weights, got {' and '.join(several)}")
        if self.direction is not None and not any(self.direction):
            raise SceneError("direction", "must have a length above 0, as [0, 0, 1], got [0, 0, 0]")
        if self.clearance is not None:
            if given(self, "lower", "upper") != "none":
                raise ValueError(
                    "takes clearance, or lower and upper, got clearance with "
                    f"{given(self, 'lower', 'upper')}"
                )
            # from here on the pair is the one that lower and upper describe
            for name, value in (("lower", -self.clearance), ("upper", self.clearance)):
                object.__setattr__(self, name, value)
            object.__setattr__(self, "clearance", None)
        if self.lower is None and self.upper is None:
            raise ValueError(
                "needs at least one of lower and upper (m from rest), or clearance; any number "
                "will do where size is to find it"
            )
        if self.lower is not None and self.upper is not None and self.lower >= self.upper:
            raise ValueError(f"needs lower < upper, got {self.lower:g} and {self.upper:g}")
        self._check_tolerance()
        rubs = any(law is not None and law.friction_coefficient for law in self._laws)
        if rubs != (self.tangent is not None):
            got = "a law with friction" if rubs else "tangent"
            raise ValueError(f"takes tangent and a law with friction together, got {got} alone")
        for side in ("lower", "upper"):
            own = getattr(self, f"{side}_law")
            if getattr(self, side) is None:
                if own is not None:
                    raise ValueError(f"has {side}_law but no {side} stop")
            elif own is None and self.law is None:
                raise ValueError(
                    'needs law, for example law = { kind = "restitution", coefficient = 0.8 }'
                )
        return self

    def _check_tolerance(self) -> None:
        if self.tolerance is None:
            return
        for name in ("lower", "upper"):
            if isinstance(getattr(self, name), Mean):
                raise ValueError(
                    f"takes tolerance, or a {name} stop that differs between units, got both"
                )
        if self.lower is None or self.upper is None:
            return
        if 2.0 * self.tolerance >= self.upper - self.lower:
            raise ValueError(
                f"needs a tolerance below half the distance of its stops, got {self.tolerance:g} "
                f"for stops at {self.lower:g} and {self.upper:g}"
            )

    @property
    def nearest(self) -> ImpactPair:
        """The pair with its stops where its tolerance may have them, without a tolerance."""
        if self.tolerance is None:
            return self
        places = {
            name: place + side * self.tolerance
            for name, side in (("lower", 1.0), ("upper", -1.0))
            if (place := getattr(self, name)) is not None
        }
        return self.model_copy(update={**places, "tolerance": None})

    @property
    def _laws(self) -> tuple[Law | None, ...]:
        return self.law, self.lower_law, self.upper_law

    def law_of(self, side: str) -> Law:
        """The law that holds at the "lower" or "upper" stop."""
        law = getattr(self, f"{side}_law") or self.law
        assert law is not None
        return law

    def stops(self) -> list[tuple[str, Law]]:
        """(side, law) of each stop that there is."""
        sides = ("lower", "upper")
        return [(side, self.law_of(side)) for side in sides if getattr(self, side) is not None]


LAW_OF_TABLE = Restitution(coefficient=0.5)
"""Law of the stops of a table that states none; the probability of a contact depends on no law."""


class Scene(Checked):
    """Everything a method needs to know, checked once.

    Parameters
    ----------
    title
        What the scene is, for headings.
    structure
        What moves.
    impact_pairs
        Where it can hit; none for a structure without stops. `impact_pair` in a file.
    pairs
        A table of further pairs: the name of its file, or that with the keys that all of them
        share, { file = "gaps.csv", law = ... }. In Python a frame, or a dictionary with `values`
        and these keys. Rigid stops of restitution 0.5 by default.
    excitations
        What shakes it; several add up. At least one, unless each phase has its own. `excitation`
        in a file.
    absorber
        Loose masses in boxes that the structure carries: one, or a list.
    vehicle
        The vehicle that stands between a road and the base.
    cross_densities
        How two noises depend on each other. `cross_density` in a file.
    phases
        Phases of a mission. `phase` in a file. `in_phase` gives the scene of one of them.

    Raises
    ------
    SceneError
        In one sentence per problem: the key, what was got, what was expected.

    See Also
    --------
    stochvi.load_scene : A scene from its file.
    stochvi.explain : What of a scene is simulated, and by which methods.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=0.8))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> scene.effects()
    ('white noise on x', 'rigid stop lower', 'rigid stop upper')
    """

    title: str = ""
    structure: Annotated[Structure, OneOf(get_args(Structure), "structures", (AnyStructure,))]
    impact_pairs: tuple[ImpactPair, ...] = Field(default=(), alias="impact_pair")
    pairs: str | dict[str, Any] | SkipJsonSchema[Any] | None = Field(default=None, exclude=True)
    excitations: Excitations = Field(alias="excitation")
    cross_densities: tuple[CrossDensity, ...] = Field(default=(), alias="cross_density")
    absorber: Absorber | tuple[Absorber, ...] | None = None
    vehicle: QuarterCar | None = None
    phases: tuple[Phase, ...] = Field(default=(), alias="phase")

    def __init_subclass__(cls, **_: Any) -> None:
        raise TypeError(
            "Scene cannot have subclasses, as methods make further scenes from its keys, which "
            f"would not be of the class {cls.__name__}; write a function that returns a Scene"
        )

    @model_validator(mode="before")
    @classmethod
    def _one_spelling(cls, keys: Any) -> Any:
        """The key of a file and the argument of Python are one."""
        for name, field in cls.model_fields.items():
            if field.alias and isinstance(keys, dict) and {name, field.alias} <= keys.keys():
                raise SceneError(name, f"must be left out beside {field.alias}, which is the same")
        return keys

    @model_validator(mode="before")
    @classmethod
    def _shaken_in_phases(cls, keys: Any) -> Any:
        """A scene whose phases have excitations of their own needs no others."""
        named = keys if isinstance(keys, dict) else {}
        lacks = not {"excitation", "excitations"} & named.keys()
        return named | {"excitation": []} if lacks and {"phase", "phases"} & named.keys() else keys

    @model_validator(mode="before")
    @classmethod
    def _with_pairs_of_table(cls, keys: Any) -> Any:
        """Pairs of a table stand behind those that are written out."""
        if not isinstance(keys, dict) or keys.get("pairs") is None:
            return keys
        shared = keys["pairs"] if isinstance(keys["pairs"], dict) else {"values": keys["pairs"]}
        source = shared.get("file", shared.get("values"))
        own = keys.get("impact_pair", keys.get("impact_pairs", ()))
        same = {name: each for name, each in shared.items() if name not in ("file", "values")}
        rows = [{"law": LAW_OF_TABLE} | same | row for row in read_pairs(source)]
        others = {
            name: each for name, each in keys.items() if name not in ("pairs", "impact_pairs")
        }
        own = list(own) if isinstance(own, list | tuple) else [own]
        return others | {"impact_pair": own + rows}

    @field_validator("absorber", mode="before")
    @classmethod
    def _absorbers(cls, value: Any) -> Any:
        if value is None:
            return None
        several = isinstance(value, list | tuple)
        found = absorbers_of(value)
        return tuple(found) if several else found[0]

    @field_validator("impact_pairs", "excitations", "cross_densities", "phases", mode="before")
    @classmethod
    def _several(cls, value: Any, info: ValidationInfo) -> Any:
        key = str(cls.model_fields[str(info.field_name)].alias)
        if isinstance(value, Checked):
            raise ValueError(f"must be a list, got one {type(value).__name__}; write [...]")
        if isinstance(value, dict):
            keys = ", ".join(f"{name} = {entry!r}" for name, entry in value.items())
            raise ValueError(f"must be a list, got one table ({keys}); write [[{key}]]")
        return value

    @field_validator("phases")
    @classmethod
    def _standing(cls, phases: tuple[Phase, ...]) -> tuple[Phase, ...]:
        """Phases through which a band moves are a phase for each of its steps."""
        return tuple(step for phase in phases for step in phase.standing)

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        problems: list[tuple[str, str]] = []
        if self.phases:
            self._check_phases()
        if not self.excitations and not self._shaken_by_phases:
            problems.append(("excitation", "needs at least one entry, got none"))
        elif problems := self._beside_the_vehicle():
            raise SceneError(problems)
        self._drive()
        if self.excitations and self._short_absorbers:
            if problems := self._out_of_range():
                raise SceneError(problems)
            _ = self.expanded  # building it checks the rest
            return self
        names = [pair.name for pair in self.impact_pairs]
        for index, pair in enumerate(self.impact_pairs):
            sentence = self._misplaced(pair)
            if names.index(pair.name) < index:
                sentence = f"needs a name of its own (name = ...), got {pair.name!r} again"
            sentence = sentence or self._unheld(pair)
            if sentence:
                problems.append((f"impact_pair.{index}", sentence))
        for index, excitation in enumerate(self.excitations):
            sentence = self._misfit(excitation)
            if sentence:
                problems.append((f"excitation.{index}", sentence))
        if not problems:
            problems += self._uneven_levels() + self._wrong_cross_densities()
        problems += self.structure.misplaced_functions()
        problems += self._unknown_absorbers()
        if problems := problems or self._out_of_range():
            raise SceneError(problems)
        return self

    @property
    def _shaken_by_phases(self) -> bool:
        """Whether each phase of a mission has excitations of its own."""
        shaken = (phase.own_excitations or phase.added for phase in self.phases)
        return bool(self.phases) and all(shaken)

    def _check_phases(self) -> None:
        """Raise the faults of the phases, each by its number."""
        names, problems = [phase.name for phase in self.phases], []
        for index, phase in enumerate(self.phases):
            if names.index(phase.name) < index:
                sentence = f"needs a name of its own, got {phase.name!r} again"
                raise SceneError(f"phase.{index}", sentence)
            try:
                phase.of(self)
            except SceneError as error:
                problems += [(f"phase.{index}.{key}", text) for key, text in error.problems]
        if problems:
            raise SceneError(problems)

    def in_phase(self, name: str) -> Scene:
        """The scene as it is in one phase of its mission.

        Parameters
        ----------
        name
            Name of the phase.

        Returns
        -------
        Scene
            A scene without phases.

        Raises
        ------
        ValueError
            If no phase has this name.
        """
        for phase in self.phases:
            if phase.name == name:
                return phase.of(self)
        known = ", ".join(phase.name for phase in self.phases) or "(none)"
        raise ValueError(f"phase must be one of {known}, got {name!r}")

    def _beside_the_vehicle(self) -> list[tuple[str, str]]:
        """Problems of a scene with a vehicle: other excitations of the base, or no road."""
        if self.vehicle is None:
            return []
        roads = [isinstance(excitation, RoadNoise) for excitation in self.excitations]
        problems = [
            (
                f"excitation.{index}",
                f"of kind {excitation.kind!r} acts on the base, but with [vehicle] the base is the "
                f"{self.vehicle.mounted_on} and follows a road (kind = 'road') alone; take "
                "[vehicle] out for what was measured where the mount stands",
            )
            for index, excitation in enumerate(self.excitations)
            if self.place(excitation) == BASE
            and not isinstance(excitation, RoadNoise | ConstantLoad)
        ]
        if not any(roads):
            problems.append(("vehicle", "needs an excitation of kind 'road' to drive on, got none"))
        return problems

    def _drive(self) -> None:
        """Let the roads reach the base through the vehicle, if there is one."""
        driven = tuple(
            each.behind(self.vehicle) if isinstance(each, RoadNoise) else each
            for each in self.excitations
        )
        object.__setattr__(self, "excitations", driven)

    def _misplaced(self, pair: ImpactPair) -> str:
        """Fault of the coordinates of an impact pair; empty if nothing is."""
        known = self.structure.places
        places = given(pair, "at", "direction")
        if isinstance(self.structure, RigidBody):
            named = given(pair, "on", "between", "weights")
            if named != "none" or None in (pair.at, pair.direction):
                return (
                    "needs at (m from the centre of mass) and direction on a rigid body, got "
                    f"{', '.join(each for each in (places, named) if each != 'none') or 'none'}"
                )
            if pair.tangent is None:
                return ""
            if not isinstance(pair.tangent, tuple) or not any(pair.tangent):
                return f"needs a direction as tangent on a rigid body, got {pair.tangent!r}"
            if np.linalg.matrix_rank(np.array([pair.tangent, pair.direction])) < 2:
                return f"must have a tangent apart from its direction, got {list(pair.tangent)}"
            return ""
        if places != "none":
            return (
                f"takes {places} with structure.kind = 'rigid-body' only, got "
                f"{self.structure.kind!r}"
            )
        names = pair.between or tuple(pair.weights or ()) or (() if pair.on is None else (pair.on,))
        for name in names:
            if name not in known:
                only = ", the only coordinate of this scene" if len(known) == 1 else ""
                return f"must be on {_one_of(known)}{only}, got {name!r}"
        if not names and len(known) > 1:
            return f"needs on or between, with names of {_one_of(known)}, got none"
        if not self.structure.knows_mass and not all(law.rigid for _, law in pair.stops()):
            return "has a stop with a force, which needs structure.mass, got none"
        if pair.between is not None and pair.between[0] == pair.between[1]:
            return f"needs two different coordinates in between, got {pair.between[0]!r} twice"
        if not np.any(self.row_of(pair)):
            return f"is where the structure does not move, got {self.words_of(pair)!r}"
        return self._misplaced_tangent(pair)

    def _misplaced_tangent(self, pair: ImpactPair) -> str:
        """Fault of the motion along the stops of a pair; empty if nothing is."""
        known, tangent = self.structure.places, pair.tangent
        if tangent is None:
            return ""
        if isinstance(tangent, tuple):
            return f"takes a direction as tangent on a rigid body only, got {list(tangent)}"
        names = [tangent] if isinstance(tangent, str) else list(tangent)
        for name in names:
            if name not in known:
                return f"must have its tangent on {_one_of(known)}, got {name!r}"
        both = np.array([self.row_of(pair), self.tangent_of(pair)])
        if np.linalg.matrix_rank(both) < 2:
            return f"must have a tangent that moves apart from the pair, got {tangent!r}"
        return ""

    def tangent_of(self, pair: ImpactPair) -> Array | None:
        """Row (n,) of the motion along the stops of a pair; None where they do not rub."""
        tangent = pair.tangent
        if tangent is None:
            return None
        if isinstance(tangent, tuple):
            assert pair.at is not None
            along = np.array(tangent) / float(np.linalg.norm(tangent))
            return np.asarray(along @ rows_at(pair.at))
        weights = {tangent: 1.0} if isinstance(tangent, str) else tangent
        places = self.structure.places
        return np.asarray(sum(share * places[name] for name, share in weights.items()))

    @property
    def _short_absorbers(self) -> tuple[Absorber, ...]:
        """Absorbers that are given by mass, play and law, not by the names of coordinates."""
        given = self.absorber if isinstance(self.absorber, tuple) else (self.absorber,)
        return tuple(each for each in given if each is not None and not each.mass_on)

    @property
    def expanded(self) -> Scene:
        """The same scene with absorbers of mass, play and law written out as coordinates and impact
        pairs of a structure of kind `matrices`. Stops are where their tolerances may have them. A
        scene with neither is itself."""
        absorbers = self._short_absorbers
        if not absorbers:
            return self._with_nearest_stops()._with_sides_apart()._with_densities()
        mean = mean_unit(self._with_nearest_stops())
        return Scene(
            title=self.title,
            cross_densities=self.cross_densities,
            **on_oscillator(absorbers, mean.structure, mean.impact_pairs, mean.excitations),
        )._with_densities()

    def _with_nearest_stops(self) -> Scene:
        if all(pair.tolerance is None for pair in self.impact_pairs):
            return self
        pairs = tuple(pair.nearest for pair in self.impact_pairs)
        return self.model_copy(update={"impact_pairs": pairs})

    def _with_densities(self) -> Scene:
        """The same scene with filtered noises by their density where a cross density names them."""
        named = {name for cross in self.cross_densities for name in cross.between}
        found = tuple(
            each.with_density
            if isinstance(each, FilteredNoise) and named & {each.name, each.axis}
            else each
            for each in self.excitations
        )
        same = all(one is other for one, other in zip(found, self.excitations, strict=True))
        return self if same else self.model_copy(update={"excitations": found})

    def _with_sides_apart(self) -> Scene:
        """The same scene with the two sides of a pair as pairs of their own where its stops move:
        one goes up while the other goes down. The scene itself where none do."""
        pairs: list[ImpactPair] = []
        for pair in self.impact_pairs:
            if pair.lower is None or pair.upper is None or not self.moved_by(pair):
                pairs.append(pair)
                continue
            for side, other in (("lower", "upper"), ("upper", "lower")):
                keys = {other: None, f"{other}_law": None, "name": f"{pair.name}{SIDED}{side}"}
                pairs.append(pair.replace(**keys))
        if len(pairs) == len(self.impact_pairs):
            return self
        return self.model_copy(update={"impact_pairs": tuple(pairs)})

    @property
    def drifts(self) -> tuple[list[int], Array]:
        """Free drifts of the whole structure and their reference coordinates.

        They are those that `stochvi.scenes.scene.drifts` returns; there are none without stops, or
        on a moving base.
        """
        structure = self.structure
        none = list[int](), np.zeros((len(structure.coordinates), 0))
        if not isinstance(structure, Matrices) or not self.impact_pairs:
            return none
        if any(self.place(excitation) == BASE for excitation in self.excitations):
            return none
        rows = [self.row_of(pair) for pair in self.impact_pairs]
        held = [part.row for part in structure.functions]
        return drifts(np.vstack([*structure.matrices[1:], *held]), np.array(rows))

    @property
    def moving(self) -> tuple[str, ...]:
        """Names of the coordinates in answers: all but the reference coordinates of drifts."""
        references, _ = self.drifts
        names = enumerate(self.structure.coordinates)
        return tuple(name for place, name in names if place not in references)

    def weights_of(self, part: ImpactPair | Excitation) -> Mapping[str, float]:
        """Weights of the places on which a pair or a force acts, by name."""
        if part.weights is not None:
            return part.weights
        if part.between is not None:
            return dict(zip(part.between, (1.0, -1.0), strict=True))
        return {part.on or next(iter(self.structure.places)): 1.0}

    def row_of(self, part: ImpactPair | Excitation) -> Array:
        """Row (n,) of the displacement on which a pair or a force acts, row . q."""
        known = self.structure.places
        rows = [weight * known[name] for name, weight in self.weights_of(part).items()]
        return np.asarray(np.sum(rows, axis=0))

    def words_of(self, part: ImpactPair | Excitation) -> str:
        """The places that a pair or a force acts on, in words; empty if it does not say so."""
        if part.weights is not None:
            return " + ".join(f"{weight:g} {name}" for name, weight in part.weights.items())
        if part.between is not None:
            return " against ".join(part.between)
        return part.on or ""

    @property
    def absorber_coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates that are absorber masses, in the model of the scene."""
        absorber = self.expanded.absorber
        assert not isinstance(absorber, tuple)
        return absorber.mass_on if absorber else ()

    def _unknown_absorbers(self) -> list[tuple[str, str]]:
        known = self.structure.coordinates
        names = self.absorber.mass_on if isinstance(self.absorber, Absorber) else ()
        if names and isinstance(self.structure, RigidBody):
            return [
                ("absorber.mass_on", "names coordinates of a structure of kind 'matrices', got "
                 "structure.kind = 'rigid-body'")
            ]  # fmt: skip
        unknown = [
            ("absorber.mass_on", f"must name {_one_of(known)}, got {name!r}")
            for name in names
            if name not in known
        ]
        if not unknown and names and len(set(names)) >= len(known):
            return [("absorber.mass_on", "leaves no coordinate for the structure that carries it")]
        return unknown

    def _unheld(self, pair: ImpactPair) -> str:
        """Fault of a stop at which the restoring force is not finite; empty if none."""
        if not isinstance(self.structure, NonlinearOscillator):
            return ""
        for stop in (pair.lower, pair.upper):
            force = 0.0 if stop is None else float(self.structure.force_at(stop))
            if not np.isfinite(force):
                return f"has a stop at {stop:g}, where structure.restoring_force is {force:g}"
        return ""

    def _out_of_range(self) -> list[tuple[str, str]]:
        """Problems for numbers whose products and squares would leave the floating-point range."""
        numbers: list[tuple[str, str, float | None]] = []
        mass = 1.0
        if self.structure.linear and not isinstance(self.structure, Oscillator):
            names = ("the mass (kg)", "the damping (N s/m)", "the stiffness (N/m)")
            for name, matrix in zip(names, self.structure.matrices, strict=True):
                numbers += [("structure", name, float(entry)) for entry in matrix.ravel()]
            for excitation in self.excitations:
                for word in ("si_intensity", "peak", "magnitude"):
                    strength = getattr(excitation, word, None)
                    numbers.append(("excitation", "its strength", strength))
        elif not _fits(mass := float(self.structure.matrices[0][0, 0])):
            return [("structure", _range_sentence("the mass (kg)", mass))]
        else:
            numbers += self._numbers_per_unit_mass()
        for part in self.structure.functions:
            named = f"the force of the {part.name}, "
            for strength in part.law.strengths:
                numbers += [("structure", named, strength), ("structure", named, strength / mass)]
        for pair in self.impact_pairs:
            numbers += [
                ("impact_pair", "the lower stop (m)", pair.lower),
                ("impact_pair", "the upper stop (m)", pair.upper),
            ]
            for side, law in pair.stops():
                per_unit_mass = law.per_unit_mass(mass)
                numbers += [
                    ("impact_pair", f"the law of the {side} stop, per unit mass,", strength)
                    for strength in (*law.strengths(), *per_unit_mass.strengths())
                ]
        return [
            (key, _range_sentence(name, value))
            for key, name, value in numbers
            if value is not None and not _fits(value)
        ]

    def _numbers_per_unit_mass(self) -> Iterator[tuple[str, str, float | None]]:
        """The numbers that methods for one oscillator compute with, and their names."""
        structure = self.structure
        if isinstance(structure, Oscillator):
            yield "structure", "the natural frequency (rad/s)", structure.omega
            yield "structure", "the load of gravity per unit mass (m/s^2)", structure.gravity_load
        if isinstance(structure, Oscillator | NonlinearOscillator):
            yield "structure", "the damping per unit mass (1/s)", structure.damping_rate
        for excitation in self.excitations:
            mass = 1.0
            if self.place(excitation) != BASE and isinstance(structure, Oscillator):
                mass = structure.mass or 1.0
            match excitation:
                case StrengthNoise() | DrawnExcitation():
                    intensity = excitation.si_intensity
                    if _fits(intensity):  # otherwise the same problem would be reported twice
                        intensity /= mass**2
                    yield "excitation", "the intensity per unit mass squared", intensity
                case ConstantLoad():
                    load = excitation.magnitude / mass
                    yield "excitation", "the load per unit mass (m/s^2)", load
                case DensityNoise():
                    table = self.table_of(excitation).scaled(mass**-2)
                    for column in (table.frequency_hz, table.density):
                        for size in (float(column.min()), float(column.max())):
                            yield "excitation", "the table per unit mass", size
                case Sine() | Modulation():
                    pass  # they check their own numbers
                case _:
                    assert_never(excitation)

    def _misfit(self, excitation: Excitation) -> str:
        """Fault of the place of an excitation; empty if nothing is."""
        if isinstance(excitation, Modulation):
            return self._misfit_of_modulation(excitation)
        if excitation.between is not None or excitation.weights is not None:
            return self._misfit_of_several(excitation)
        rigid = isinstance(self.structure, RigidBody)
        known = AXES if rigid else tuple(self.structure.places)
        where = self.place(excitation)
        if where == BASE and not self.structure.movable:
            needed = self.structure.needed_to_move.format(kind=self.structure.kind)
            return f"acts on the base, which needs {needed}"
        if excitation.axis is not None and not (rigid and where == BASE):
            got = f"on = {where!r}" if rigid else f"structure.kind = {self.structure.kind!r}"
            return (
                "takes axis for the base of structure.kind = 'rigid-body' only, got axis with "
                f"{got}"
            )
        if rigid and where in ("", BASE) and excitation.axis is None:
            return (
                "needs axis = 'x', 'y' or 'z' to say along which axis it moves the base, or on = "
                f"{_one_of(known)} for a force on the centre of mass, got none"
            )
        if not where:
            return f"needs on = {_one_of((*known, BASE))} to say where it acts, got none"
        if where != BASE and where not in known:
            return f"must act on {_one_of((*known, BASE))}, got on = {where!r}"
        if where != BASE and not self.structure.knows_mass:
            return "is a force, which needs structure.mass, got none"
        if isinstance(excitation, ConstantLoad) and (where == BASE) != (excitation.force is None):
            return "takes force on a coordinate and acceleration on the base"
        if isinstance(excitation, Sine) and (sentence := excitation.misplaced(where)):
            return sentence
        return _misfit_unit(excitation, where)

    def _misfit_of_several(self, excitation: Excitation) -> str:
        """Fault of the place of a force between two places, or on several; empty if nothing is."""
        key = "weights" if excitation.between is None else "between"
        rigid = isinstance(self.structure, RigidBody)
        known = AXES if rigid else tuple(self.structure.places)
        if len(known) < 2 or (rigid and key == "between"):
            return (
                f"takes {key} with a structure of several coordinates or points only, got "
                f"{self.structure.kind!r}"
            )
        if given(excitation, "on", "axis", "between", "weights") != key:
            others = given(excitation, "on", "axis", *({"between", "weights"} - {key}))
            return f"takes on, between or weights, got {key} with {others}"
        names = excitation.between or tuple(excitation.weights or ())
        if not set(names) <= set(known) or len(set(names)) < len(names):
            wanted = "two different names of " if key == "between" else "names of "
            return f"needs {wanted}{_one_of(known)} in {key}, got {list(names)}"
        where = self.place(excitation)
        if isinstance(excitation, ConstantLoad) and excitation.force is None:
            return f"takes force with {key}, got acceleration"
        if isinstance(excitation, Sine):
            if excitation.crank and not self._joined(*names):
                return (
                    f"has displacement of a crank, which needs a spring or damper between "
                    f"{names[0]!r} and {names[1]!r}, got none; give amplitude (N)"
                )
            return excitation.misplaced(where)
        return _misfit_unit(excitation, where)

    def _misfit_of_modulation(self, modulation: Modulation) -> str:
        """Fault of what a modulation changes; empty if nothing is."""
        if modulation.of == "clearance":
            return self._misfit_of_clearance(modulation)
        try:
            changed_by(modulation, self.structure)
        except SceneError as error:
            return error.problems[0][1]
        return ""

    def _misfit_of_clearance(self, modulation: Modulation) -> str:
        """Fault of the pair whose clearance a modulation changes; empty if nothing is."""
        names = [pair.name for pair in self.impact_pairs]
        moved = [pair for pair in self.impact_pairs if self._moves(modulation, pair)]
        if not moved:
            return f"must be on the name of an impact pair, {_one_of(names)}, got {modulation.on!r}"
        if modulation.on is None and len({pair.name.partition(SIDED)[0] for pair in moved}) > 1:
            return f"needs on = {_one_of(names)} to say which clearance changes, got none"
        return ""

    @staticmethod
    def _moves(modulation: Modulation, pair: ImpactPair) -> bool:
        """Whether a modulation moves the stops of a pair, or of one side of it."""
        on = modulation.on
        known = on is None or pair.name in (on, f"{on}{SIDED}lower", f"{on}{SIDED}upper")
        return modulation.of == "clearance" and known

    def moved_by(self, pair: ImpactPair) -> list[Modulation]:
        """The modulations that move the stops of a pair."""
        return [each for each in self.modulations if self._moves(each, pair)]

    def _joined(self, first: str, second: str) -> bool:
        """Whether a spring or damper of matrices joins two coordinates."""
        known = self.structure.coordinates
        if not {first, second} <= set(known):
            return False
        i, j = known.index(first), known.index(second)
        return any(matrix[i, j] for matrix in self.structure.matrices[1:])

    def correlated(self) -> dict[str, DensityNoise]:
        """The noises that cross densities name, by their names or axes.

        Raises
        ------
        SceneError
            Where a name has no noise with a density, or several, which could not be told apart.
        """
        named = dict.fromkeys(name for cross in self.coloured for name in cross.between)
        found: dict[str, DensityNoise] = {}
        for name in sorted(named, key=lambda name: (*AXES, name).index(name)):
            called = [
                each.with_density if isinstance(each, FilteredNoise) else each
                for each in self._called(name)
                if isinstance(each, DensityNoise | FilteredNoise)
            ]
            if len(called) != 1:
                known = [each.name for each in self.excitations if each.name is not None]
                have = f"; names of excitations are {', '.join(known)}" if known else ""
                sentence = (
                    "needs one excitation with a density for each name in between, got "
                    f"{len(called)} with the name or axis {name!r}{have}"
                )
                raise SceneError("cross_density", sentence)
            found[name] = called[0]
        return found

    def _called(self, name: str) -> list[Excitation]:
        """The excitations of a name or along an axis."""
        return [each for each in self.excitations if name in (each.name, each.axis)]

    def _white(self, name: str) -> bool:
        """Whether a name or an axis is that of white noise."""
        return any(isinstance(each, WhiteNoise) for each in self._called(name))

    @property
    def coloured(self) -> tuple[CrossDensity, ...]:
        """The cross densities between noises that are not white."""
        return tuple(
            cross for cross in self.cross_densities if not any(map(self._white, cross.between))
        )

    @property
    def white_crosses(self) -> tuple[CrossDensity, ...]:
        """The cross densities between white noises."""
        return tuple(
            cross for cross in self.cross_densities if all(map(self._white, cross.between))
        )

    def correlated_whites(self) -> dict[str, WhiteNoise]:
        """The white noises that cross densities name, by their names or axes.

        Raises
        ------
        SceneError
            Where a cross density does not leave them white, or several noises have the name.
        """
        found: dict[str, WhiteNoise] = {}
        for cross in self.cross_densities:
            whites = [name for name in cross.between if self._white(name)]
            words = " and ".join(map(repr, cross.between))
            if len(whites) == 1:
                sentence = (
                    f"must join white noise with white noise alone, got {words}; give "
                    f"{whites[0]!r} as kind = 'psd' over the band of the structure"
                )
                raise SceneError("cross_density", sentence)
            if whites and cross.real_correlation is None:
                sentence = (
                    "must have one coherence, and phase_deg of 0 or 180, between white noises, "
                    f"which then stay white, got others between {words}; give both as kind = 'psd'"
                )
                raise SceneError("cross_density", sentence)
            for name in whites:
                called = self._called(name)
                if len(called) != 1:
                    sentence = f"needs one excitation for each name, got {len(called)} of {name!r}"
                    raise SceneError("cross_density", sentence)
                (each,) = called
                assert isinstance(each, WhiteNoise)
                found[name] = each
        return found

    def _uneven_levels(self) -> list[tuple[str, str]]:
        """Fault of noises of which only some vary in level: they must rise and fall together."""
        levels = {
            index: each.random_level if isinstance(each, DensityNoise) else None
            for index, each in enumerate(self.excitations)
            if isinstance(each, DensityNoise | StrengthNoise)
        }
        first = next(iter(levels.values()), None)
        return [
            (
                f"excitation.{index}",
                "must have the kurtosis and level_time of all other noise, with which it rises and "
                f"falls, got {_spoken_level(level)} beside {_spoken_level(first)}",
            )
            for index, level in levels.items()
            if level != first
        ][:1]

    @property
    def random_level(self) -> RandomLevel | None:
        """How the level of all noise varies together; None where it is steady."""
        levels = [each.random_level for each in self.excitations if isinstance(each, DensityNoise)]
        return next((each for each in levels if each is not None), None)

    @property
    def has_records(self) -> bool:
        """Whether a record shakes it, or one of its phases."""
        found = [*self.excitations]
        for phase in self.phases:
            found += [*phase.own_excitations, *phase.added]
        return any(each.kind == "record" for each in found)

    @property
    def has_shocks(self) -> bool:
        """Whether shocks of a shape come at random times."""
        return any(isinstance(each, Pulses) and each.shock for each in self.excitations)

    def at_steady_level(self, level_db: float) -> Self:
        """The scene with Gaussian noise, raised by a level in dB, in place of noise of varying
        level; sines stay."""
        steady = tuple(
            each.replace(kurtosis=None, level_time=None, level_db=each.level_db + level_db)
            if isinstance(each, DensityNoise)
            else each
            for each in self.excitations
        )
        crosses = tuple(each.louder(level_db) for each in self.cross_densities)
        return self.model_copy(update={"excitations": steady, "cross_densities": crosses})

    def _wrong_cross_densities(self) -> list[tuple[str, str]]:
        """Fault of names of excitations, and of cross densities between them."""
        names = [each.name for each in self.excitations if each.name is not None]
        for index, each in enumerate(self.excitations):
            if each.name is not None and (names.count(each.name) > 1 or each.name in AXES):
                sentence = f"needs a name of its own that is no axis, got {each.name!r}"
                return [(f"excitation.{index}", sentence)]
        pairs = [frozenset(cross.between) for cross in self.cross_densities]
        for index, pair in enumerate(pairs):
            if pairs.index(pair) < index:
                words = " and ".join(sorted(pair))
                return [(f"cross_density.{index}", f"is given twice between {words}")]
        if not pairs:
            return []
        try:
            if impossible_whites(self.white_crosses, tuple(self.correlated_whites())):
                sentence = "must be possible: white noises so correlated do not exist"
                return [("cross_density", sentence)]
            noises = self.correlated()
            if not noises:
                return []
            for name, noise in noises.items():
                if noise.has_fast_peaks:
                    sentence = (
                        f"must be left out where {name!r} has a kurtosis without level_time; give "
                        "level_time, or independent noises"
                    )
                    return [("cross_density", sentence)]
            tables = {name: self.table_of(each) for name, each in noises.items()}
            sentence = impossible(self.coloured, tables)
        except SceneError as error:
            return error.problems
        return [("cross_density", sentence)] if sentence else []

    def place(self, excitation: Excitation) -> str:
        """Where an excitation acts: a coordinate, "base" or one coordinate against another.

        It follows from the keys of the excitation, otherwise from its kind and that of the
        structure; it is empty if they do not tell.
        """
        if words := self.words_of(excitation):
            return words
        if isinstance(excitation, Modulation):
            if excitation.of == "clearance":
                return self.impact_pairs[0].name
            return next(iter(self.structure.places))
        if isinstance(self.structure, RigidBody):
            return "" if excitation.axis is None else BASE
        if isinstance(excitation, ConstantLoad) and isinstance(
            self.structure, Oscillator | NonlinearOscillator
        ):
            return BASE if excitation.acceleration is not None else "x"
        if self.structure.on_mount:
            return BASE
        known = tuple(self.structure.places)
        return known[0] if len(known) == 1 else ""

    def place_in_words(self, excitation: Excitation) -> str:
        """Where an excitation acts: a coordinate or "base", with the axis along which it moves."""
        along = f" along {excitation.axis}" if excitation.axis else ""
        return self.place(excitation) + along

    @property
    def modulations(self) -> tuple[Modulation, ...]:
        """What changes the structure in time."""
        return tuple(each for each in self.excitations if isinstance(each, Modulation))

    def effects(self) -> tuple[str, ...]:
        """The effects of this scene; nothing else is simulated."""
        if self._short_absorbers:
            return self.expanded.effects()
        found = [
            f"{excitation.effect_word} on {self.place_in_words(excitation)}"
            for excitation in self.excitations
        ]
        if getattr(self.structure, "gravity", False):
            found.append("constant load of gravity")
        for part in self.structure.functions:
            where = "" if part.name in ("spring", "damper") else f" ({part.name})"
            found.append(f"{part.law.effect}{where}")
        for pair in self.impact_pairs:
            of = f" of {pair.name}" if len(self.impact_pairs) > 1 else ""
            found += [f"{law.word} stop {side}{of}{law.remark}" for side, law in pair.stops()]
        return tuple(found)

    def absent_effects(self) -> tuple[str, ...]:
        """The effects that stochvi knows and this scene does not have."""
        if self._short_absorbers:
            return self.expanded.absent_effects()
        found = {excitation.family for excitation in self.excitations}
        if getattr(self.structure, "gravity", False):
            found.add(ConstantLoad.family)
        found |= {f"stop {side}" for pair in self.impact_pairs for side, _ in pair.stops()}
        written = (
            each for each in EXCITATIONS if each.model_fields["kind"].default not in PYTHON_ONLY
        )
        known = [*(each.family for each in written), "stop lower", "stop upper"]
        return tuple(effect for effect in dict.fromkeys(known) if effect not in found)

    def assumptions(self) -> tuple[str, ...]:
        """The assumptions of the scene, in words."""
        if self._short_absorbers:
            return (*self.expanded.assumptions(), *self._reaction(), *self.at_means())
        found = [UNLOADED]
        if not self.structure.knows_mass:
            found.append("mass is not given: 1 kg, which only forces and energies depend on")
        for place in self.drifts[0]:
            name = self.structure.coordinates[place]
            found.append(
                f"the whole structure drifts freely, which no stop feels: motions are relative to "
                f"{name!r}"
            )
        words = {law.word for pair in self.impact_pairs for _, law in pair.stops()}
        found += self.structure.assumptions()
        if "rigid" in words:
            which = "stops are rigid" if words == {"rigid"} else "some stops are rigid"
            found.append(f"{which}; an impact is instantaneous (Newton's restitution)")
        laws = [law for pair in self.impact_pairs for _, law in pair.stops()]
        ends = {law.word for law in laws if isinstance(law, PowerLaw) and law.loss} | words & {
            "viscoelastic"
        }
        if ends:
            found.append(
                f"contact with a {' or '.join(sorted(ends))} stop ends at zero force; the stop has "
                "no mass and recovers at once"
            )
        if "function" in words:
            found.append("a stop whose force is a function only pushes: negative values count as 0")
        sources = [law.source for law in laws if isinstance(law, Elastic | Viscoelastic)]
        tables = [law.in_words() for law in laws if isinstance(law, ForceTable)]
        sources += [f"{table}; beyond it the last slope goes on" for table in tables]
        found += [f"stops: {source}" for source in dict.fromkeys(filter(None, sources))]
        if any(isinstance(law, Restitution) and law.scatter is not None for law in laws):
            found.append(
                "a restitution that scatters is drawn from a beta distribution at each impact, "
                "whatever its speed and the impacts before"
            )
        rubbing = {law.rigid for law in laws if law.friction_coefficient}
        if False in rubbing:
            found.append(
                "friction in a contact is Coulomb's: it slides, and sticks where friction bears "
                "what drives it"
            )
        if True in rubbing:
            found.append(
                "friction at an impact is Coulomb's, with slip and stick; the restitution is that "
                "of energy (Stronge), and without coupling that of Newton"
            )
        if any(isinstance(law, SpeedRestitution) for law in laws):
            found.append("restitution depends on the speed of the impact alone")
        if any(isinstance(excitation, Sine) for excitation in self.excitations):
            found.append("the phase of a sine is random, uniform, in each path of a simulation")
        for excitation in self.excitations:
            if isinstance(excitation, DensityNoise):
                found += excitation.assumptions(*self._resonance())
        shocks = [each.of_its_rate for each in self.excitations if isinstance(each, Pulses)]
        found += dict.fromkeys(filter(None, shocks))
        noises = [each for each in self.excitations if isinstance(each, DensityNoise)]
        found += dict.fromkeys(sentence for each in noises for sentence in each.of_its_kurtosis)
        functions = [part.law for part in self.structure.functions]
        parts = (self.structure, *self.excitations, *functions, *laws)
        found += dict.fromkeys(
            f"{part.kind!r} is a part of {origin}, which no check of stochvi covers"
            for part in parts
            if (origin := origin_of(part))
        )
        return (*found, *self._reaction(), *self.at_means())

    def at_means(self) -> tuple[str, ...]:
        """The sentence on what differs between units of a production; none where nothing does."""
        differing = [f"{key} ({each})" for key, each in varied(self)]
        if not differing:
            return ()
        return (
            "numbers that differ between units are at their means, except in a mean over units: "
            f"{', '.join(differing)}",
        )

    def cautions(self) -> list[str]:
        """Sentences on what makes answers doubtful, whatever the method."""
        rigid = [p.name for p in self.impact_pairs if any(law.rigid for _, law in p.stops())]
        return self.structure.cautions(rigid)

    def slipped_units(self) -> list[str]:
        """Sentences on units of the structure that seem to be others, where what shakes it has
        units: white noise is also that of scenes without any."""
        phases = (own for phase in self.phases for own in phase.own_excitations)
        shaken = any(
            isinstance(each, DensityNoise) and not isinstance(each, WhiteNoise)
            for each in (*self.excitations, *phases)
        )
        return self.structure.slipped_units() if shaken else []

    def _reaction(self) -> tuple[str, ...]:
        """The assumption that the vehicle does not feel the mount, with their ratio of masses."""
        if self.vehicle is None:
            return ()
        known = self.structure.carried_mass is not None
        mass = self.expanded.structure.carried_mass if known else None
        return (self.vehicle.reaction(mass),)

    def table_of(self, excitation: DensityNoise) -> Table:
        """The density of an excitation as this structure needs it, one-sided, SI units."""
        omega, damping_rate = self._resonance()
        return excitation.table_for(omega, damping_rate)

    def density_of(self, excitation: Excitation) -> Density | None:
        """The density of an excitation as this structure needs it; None for excitations that are no
        noise."""
        return excitation.density_for(*self._resonance())

    def _resonance(self) -> tuple[float, float]:
        """omega (rad/s) and b (1/s) of a single linear oscillator, zeros of anything else."""
        if not isinstance(self.structure, Oscillator):
            return 0.0, 0.0
        return self.structure.omega, self.structure.damping_rate

    def at_level(self, level_db: float) -> Scene:
        """The scene with everything that shakes raised by a level in dB; constant loads stay."""
        raised = tuple(excitation.louder(level_db) for excitation in self.excitations)
        crosses = tuple(each.louder(level_db) for each in self.cross_densities)
        changed = {"excitations": raised, "cross_densities": crosses}
        return self.model_copy(update=changed) if level_db else self

    def document(self, *, as_written: bool = False) -> dict[str, Any]:
        """The scene as plain types, in the keys of a scene file; functions by their names.

        With `as_written`, laws of rubber keep the keys that they were given by, such as a loss
        factor, instead of the numbers that these come to.
        """
        context = AS_WRITTEN if as_written else None
        found = SceneDocument(
            self.model_dump(mode="json", by_alias=True, exclude_none=True, context=context)
        )
        found.made_from = self
        return found


SIDED = " "
"""What stands between the name of a pair and the side of a stop that moves."""

UNLOADED = "displacements are measured from the position of the unloaded spring"
"""Sentence on the origin of all positions in scenes and answers."""

LARGEST_NUMBER = 1e50
"""Largest number in a scene, per unit mass, and inverse of the smallest: squares stay finite."""


check_methods(Scene)


def _spoken_level(level: RandomLevel | None) -> str:
    if level is None:
        return "a steady level"
    return f"a kurtosis of {level.kurtosis:g} with {level.time:g} s"


def _misfit_unit(excitation: Excitation, where: str) -> str:
    """Fault of the unit of a density at a place; empty if nothing is."""
    if excitation.density_unit is None:
        return ""
    try:
        check_unit(excitation.density_unit, where)
    except ValueError as error:
        return str(error)
    return ""


def _one_of(names: Iterable[str]) -> str:
    return " or ".join(repr(name) for name in names)


def _fits(value: float) -> bool:
    return value == 0.0 or 1.0 / LARGEST_NUMBER <= abs(value) <= LARGEST_NUMBER


def _range_sentence(name: str, value: float) -> str:
    return (
        f"gives {name} the value {value:g}, expected 0 or a size from "
        f"{1.0 / LARGEST_NUMBER:g} to {LARGEST_NUMBER:g}"
    )


@checked
def load_scene(path: str | Path) -> Scene:
    """Read a scene file (TOML); the tables that it names are looked for in its folder.

    Parameters
    ----------
    path
        The scene file. After "#" the name of a phase of its mission may follow, as in
        `truck.toml#road`: then it is the scene in that phase.

    Returns
    -------
    Scene
        The scene, checked.

    Raises
    ------
    SceneError
        In one sentence per problem: the key, what was got, what was expected.

    See Also
    --------
    stochvi.explain : What will be simulated, and which methods apply.

    Examples
    --------
    >>> from stochvi.scenes.datasets import shipped_scene
    >>> load_scene(shipped_scene("oscillator-lossy")).effects()
    ('white noise on x', 'rigid stop lower', 'rigid stop upper')
    """
    path = Path(path)
    file, phase = file_and_phase(path)
    if phase is not None:
        return load_scene(file).in_phase(phase)
    text = read_text(path)
    try:
        document = tomllib.loads(text)
    except ValueError as error:  # also an integer of thousands of digits
        raise SceneError(f"{path} is not valid TOML: {error}{toml_remedy(error)}") from None
    except RecursionError:
        raise SceneError(f"{path} is not a scene: its brackets are nested too deeply") from None
    return scene_from(document, folder=path.parent)


def phase_duration(path: str | Path) -> float | None:
    """Duration of the phase in `truck.toml#road`, s; None of a file without the name of one."""
    file, name = file_and_phase(Path(path))
    if name is None:
        return None
    return next(each.duration for each in load_scene(file).phases if each.name == name)


def file_and_phase(path: Path) -> tuple[Path, str | None]:
    """The scene file, and the name of a phase behind its "#", if there is one."""
    file, mark, phase = str(path).rpartition("#")
    return (Path(file), phase) if mark and file and not path.exists() else (path, None)


def scene_from(document: Mapping[str, Any], folder: Path = Path()) -> Scene:
    """A scene from the keys of a scene file; relative file names start at `folder`."""
    for name, field in Scene.model_fields.items():
        if field.alias is not None and name in document:
            raise SceneError(name, f"is not a known key; did you mean {field.alias!r}?")
    try:
        _refuse_functions(document)
        document = dict(document)
        for key in ("excitation", "impact_pair", "phase"):
            if isinstance(entries := document.get(key), list):
                document[key] = [_files_from(folder, entry) for entry in entries]
        if isinstance(table := document.get("pairs"), str):
            document["pairs"] = {"file": table}
        for key in ("structure", "pairs"):
            if key in document:
                document[key] = _files_from(folder, document[key])
        return Scene(**document)
    except RecursionError:
        raise SceneError("the keys of a scene are nested too deeply") from None


HOLD_FILES = ("law", "spring", "damper", "mount")
"""Ends of the keys of parts that may name files."""


def _files_from(folder: Path, entry: Any) -> Any:
    """The same entry with its file names, and those of its laws and springs, relative to
    `folder`."""
    if isinstance(entry, list):
        return [_files_from(folder, each) for each in entry]
    if not isinstance(entry, dict):
        return entry
    found = {
        key: _files_from(folder, value) if key.endswith(HOLD_FILES) else value
        for key, value in entry.items()
    }
    if isinstance(entry.get("file"), str):
        found["file"] = str(folder / entry["file"])
    if isinstance(own := entry.get("excitation"), list):  # of a phase
        found["excitation"] = [_files_from(folder, each) for each in own]
    return found


def _refuse_functions(document: Mapping[str, Any]) -> None:
    """SceneError for every part of a scene file that would need a function."""
    parts = {"structure": document.get("structure")}
    pairs = document.get("impact_pair")
    for index, pair in enumerate(pairs if isinstance(pairs, list) else []):
        if isinstance(pair, dict):
            laws = ("law", "lower_law", "upper_law")
            parts |= {f"impact_pair.{index}.{law}": pair.get(law) for law in laws}
    structure = document.get("structure")
    for key in ("spring", "damper"):
        given_ = structure.get(key) if isinstance(structure, dict) else None
        for index, law in enumerate(given_ if isinstance(given_, list) else [given_]):
            parts[f"structure.{key}" + (f".{index}" if index else "")] = law
    kinds = {key: part.get("kind") for key, part in parts.items() if isinstance(part, dict)}
    if problems := [
        (
            f"{key}.kind",
            f"{kind!r} takes a function, which only Python can give: build the Scene there",
        )
        for key, kind in kinds.items()
        if kind in PYTHON_ONLY
    ]:
        raise SceneError(problems)
