"""Structures that are known by their natural modes: the base of all of them, and modes as given.

With the modal coordinates q_r, the displacement of a place is u = sum phi_r q_r, and

    m_r (q_r'' + 2 zeta_r omega_r q_r' + omega_r^2 q_r) = sum phi_r F - m_r Gamma_r a_base

(Babitsky 1998, section 6; Gamma_r are the participation factors).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, model_validator

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.results.errors import SceneError
from stochvi.scenes.impact_laws import Law
from stochvi.scenes.modal_files import read_modes
from stochvi.scenes.structure_base import EVERYWHERE, BaseStructure
from stochvi.scenes.validation import NonNegative, Number, Numbers, Positive, given


def _one_or_several(value: Any) -> Any:
    value = value.tolist() if hasattr(value, "tolist") else value
    return tuple(value) if isinstance(value, list | tuple) else (value,)


def _place_names(values: dict[str, Any]) -> dict[str, Any]:
    for name in values:
        if name in RESERVED or not all(part.isalnum() or part in " -_" for part in name):
            raise ValueError(
                f"needs names of letters, digits, blanks, - and _, none of them "
                f"{' or '.join(map(repr, RESERVED))}, got {name!r}"
            )
    return values


RESERVED = ("", "base", EVERYWHERE)
"""Names that no place of a structure can have."""

_SCHEMA = {"anyOf": [{"type": "number"}, {"type": "array", "items": {"type": "number"}}]}

PerMode = Annotated[
    tuple[NonNegative, ...], BeforeValidator(_one_or_several), WithJsonSchema(_SCHEMA)
]
"""One number from 0 on for all modes, or one for each."""

PositivePerMode = Annotated[
    tuple[Positive, ...], BeforeValidator(_one_or_several), WithJsonSchema(_SCHEMA)
]
"""One number above 0 for all modes, or one for each."""

Points = Annotated[
    dict[str, Annotated[Number, Field(ge=0, le=1)]],
    Field(min_length=1),
    AfterValidator(_place_names),
]
"""Named points of a member, by their share of its length."""

_PLACES = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "number"}}]}

Shapes = Annotated[
    dict[str, Numbers],
    Field(min_length=1),
    AfterValidator(_place_names),
    WithJsonSchema({"type": "object", "additionalProperties": _PLACES}),
]
"""Displacements in the modes at named points."""

Compliances = Annotated[dict[str, NonNegative], AfterValidator(_place_names)]
"""Static compliances at named points."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Modes:
    """Natural modes as numbers.

    Parameters
    ----------
    omega, mass
        Natural frequencies (n,), rad/s, and modal masses (n,), kg.
    shapes
        Displacements (n,) of each named point per unit of the modal coordinates.
    participation
        Participation factors (n,), the accelerations of the modal coordinates that follow a base;
        None where there is no base.
    spread
        See `BaseStructure.spread`.
    left_out
        Static compliances, m/N, between the points in their order, of the modes that are left out;
        None where they are not known.
    """

    omega: Vector
    mass: Vector
    shapes: Mapping[str, Vector]
    participation: Vector | None
    spread: Matrix | None = None
    left_out: Matrix | None = None


class ModalStructure(BaseStructure):
    """Base of structures whose coordinates are the amplitudes of their natural modes.

    Parameters
    ----------
    zeta, Q, loss_factor
        Exactly one, as a number for all modes or a list with one for each: the damping ratio, the
        quality factor 1 / (2 zeta), or the loss factor 2 zeta.
    """

    stands_on_base: ClassVar[bool] = False

    zeta: PerMode | None = None
    Q: PositivePerMode | None = None
    loss_factor: PerMode | None = None

    @cached_property
    @abstractmethod
    def modes(self) -> Modes:
        """The natural modes."""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        named = given(self, "zeta", "Q", "loss_factor")
        if named == "none" or "," in named:
            raise ValueError(f"needs exactly one of zeta, Q and loss_factor, got {named}")
        self.check_keys()
        ratios, count = len(self._ratios), len(self.modes.omega)
        if ratios not in (1, count):
            raise SceneError(
                [(named, f"needs one number, or one for each of {count} modes, got {ratios}")]
            )
        return self

    def check_keys(self) -> None:
        """Raise a ValueError or SceneError where keys contradict each other."""

    @property
    def _ratios(self) -> Vector:
        if self.zeta is not None:
            return np.array(self.zeta)
        if self.loss_factor is not None:
            return 0.5 * np.array(self.loss_factor)
        assert self.Q is not None
        return 0.5 / np.array(self.Q)

    @property
    def damping_ratio(self) -> Vector:
        """Damping ratios (n,) of the modes."""
        return np.broadcast_to(self._ratios, self.modes.omega.shape)

    @property
    def natural_frequency_hz(self) -> Vector:
        """Natural frequencies (n,), Hz, rising."""
        return self.modes.omega / (2.0 * math.pi)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The amplitudes of the modes, m."""
        return tuple(f"mode {number}" for number in range(1, len(self.modes.omega) + 1))

    @property
    def matrices(self) -> tuple[Matrix, ...]:
        """Modal mass, damping and stiffness, which are diagonal (n, n)."""
        omega, mass = self.modes.omega, self.modes.mass
        damping = 2.0 * self.damping_ratio * omega * mass
        return np.diag(mass), np.diag(damping), np.diag(mass * omega**2)

    @property
    def rates(self) -> tuple[float, float] | None:
        if len(self.modes.omega) > 1:
            return None
        omega = float(self.modes.omega[0])
        return omega, 2.0 * float(self.damping_ratio[0]) * omega

    @property
    def places(self) -> Mapping[str, Vector]:
        """Rows (n,) of the displacements of the named points."""
        return self.modes.shapes

    @property
    def reported(self) -> Mapping[str, Vector]:
        return self.modes.shapes

    @property
    def influence(self) -> Mapping[str, Vector]:
        found = self.modes.participation
        return {} if found is None else {"": found}

    @property
    def moving_mass(self) -> float | None:
        found = self.modes.participation
        return None if found is None else float(found**2 @ self.modes.mass)

    @property
    def spread(self) -> Matrix | None:
        return self.modes.spread

    def compliance_left_out(self, row: Mapping[str, float]) -> float:
        if self.modes.left_out is None:
            return 0.0
        weights = np.array([row.get(name, 0.0) for name in self.modes.shapes])
        return max(float(weights @ self.modes.left_out @ weights), 0.0)

    def assumptions(self) -> list[str]:
        count = len(self.modes.omega)
        top = self.natural_frequency_hz[-1]
        which = "one mode" if count == 1 else f"{count} modes"
        found = [f"the structure moves in {which}, up to {top:.4g} Hz; damping is modal"]
        if self.modes.left_out is not None:
            found.append(
                "the static compliance of the modes that are left out lies in series with elastic "
                "stops and force tables"
            )
        return found

    def cautions(self, laws: Collection[Law]) -> list[str]:
        if len(self.modes.omega) == 1 or not any(law.rigid for law in laws):
            return []
        return [
            "a stop is rigid, but the structure is not: rates and speeds of impacts depend on the "
            "number of modes, and need not converge with it; give the stop a stiffness (law.kind = "
            "'elastic' or 'hertz')"
        ]


class GivenModes(ModalStructure):
    """A structure by its natural modes, from a test, a handbook or a finite-element model.

    Parameters
    ----------
    frequency_hz
        Natural frequencies in rising order, Hz; 0 of a mode that no spring holds.
    modal_mass
        Modal masses, kg, one for each mode or one for all.
    shapes
        Displacements of named points in each mode, per unit of the modal coordinate:
        `shapes = { tip = [2.0, -2.0], seat = [0.7, 1.1] }`.
    participation
        Participation factors of a base that moves, phi'M iota / modal_mass, where iota are the
        displacements of the structure when it follows the base. Displacements are then relative to
        the base.
    left_out
        Static compliance of the modes that are left out, m/N, by point: a spring in series with
        each stop there that gives way.
    file
        Instead of the frequencies: a text file with a row for each mode and the columns
        `frequency_hz`, `zeta`, `modal_mass`, `participation` (all but the first may be left out)
        and one for each point; or a universal file with normal modes (dataset 55). `shapes` then
        says what of the file is at a point, `{ tip = "column" }` or, by node and direction,
        `{ tip = "12 z" }`. Keys of the scene go before those of the file.

    Raises
    ------
    SceneError
        If the numbers of modes differ, or frequencies do not rise.

    See Also
    --------
    stochvi.scenes.Beam : Modes of a beam from its measures.
    stochvi.Matrices : A structure by its matrices.

    Examples
    --------
    >>> panel = GivenModes(
    ...     frequency_hz=[31.0, 87.0], zeta=0.02, participation=[0.8, 0.4],
    ...     shapes={"tip": [2.0, -2.0]},
    ... )
    >>> panel.coordinates, panel.places["tip"].tolist()
    (('mode 1', 'mode 2'), [2.0, -2.0])
    """

    kind: Literal["modes"] = "modes"
    file: str | None = None
    frequency_hz: PerMode
    modal_mass: PositivePerMode = (1.0,)
    shapes: Shapes
    participation: Numbers | None = None
    left_out: Compliances | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, keys: Any) -> Any:
        """The keys with the numbers of the file instead of its name, if a file is given."""
        if not isinstance(keys, dict) or not isinstance(keys.get("file"), str):
            return keys
        if keys.get("frequency_hz") is not None:
            raise ValueError("takes file or frequency_hz, got both")
        points = keys.get("shapes")
        if points is not None and not (
            isinstance(points, dict) and all(isinstance(each, str) for each in points.values())
        ):
            raise SceneError(
                [("shapes", "must say by texts what of the file is at each point, as { tip = "
                  f"'12 z' }}, got {points!r}")]
            )  # fmt: skip
        try:
            found = read_modes(Path(keys["file"]), points)
        except SceneError as error:
            keyed = any(key for key, _ in error.problems)
            raise (error if keyed else SceneError([("file", str(error))])) from None
        kept = {key: value for key, value in keys.items() if key not in ("file", "shapes")}
        if given_ := {"zeta", "Q", "loss_factor"} & kept.keys():
            found = {key: value for key, value in found.items() if key != "zeta" or not given_}
        return found | kept

    def check_keys(self) -> None:
        frequencies, count = np.array(self.frequency_hz), len(self.frequency_hz)
        problems = []
        if np.any(np.diff(frequencies) < 0.0):
            problems.append(
                ("frequency_hz", "must not fall; write the modes in the order of their "
                 f"frequencies, got {self.frequency_hz}")
            )  # fmt: skip
        columns = {f"shapes.{name}": shape for name, shape in self.shapes.items()}
        if self.participation is not None:
            columns["participation"] = self.participation
        if len(self.modal_mass) > 1:
            columns["modal_mass"] = self.modal_mass
        problems += [
            (key, f"must have a number for each of {count} modes, got {len(values)}")
            for key, values in columns.items()
            if len(values) != count
        ]
        problems += [
            (f"left_out.{name}", f"must be at a point of shapes, which are {list(self.shapes)}")
            for name in self.left_out or {}
            if name not in self.shapes
        ]
        if problems:
            raise SceneError(problems)

    @cached_property
    def modes(self) -> Modes:
        count = len(self.frequency_hz)
        left_out = None
        if self.left_out is not None:
            left_out = np.diag([self.left_out.get(name, 0.0) for name in self.shapes])
        participation = None if self.participation is None else np.array(self.participation)
        return Modes(
            omega=2.0 * math.pi * np.array(self.frequency_hz),
            mass=np.broadcast_to(np.array(self.modal_mass), (count,)).copy(),
            shapes={name: np.array(shape) for name, shape in self.shapes.items()},
            participation=participation,
            left_out=left_out,
        )

    @property
    def without_base(self) -> str:
        if self.participation is not None:
            return ""
        return "acts on the base, which needs structure.participation"
