"""Forces of several excitations. Chapters: correlation of two noises; the force of a modulation;
the force of an excitation whose values are drawn."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, Field, SkipValidation, model_validator

from stochvi.mathematics.numerics import Matrix, Vector, Waves
from stochvi.mathematics.spectra import Table
from stochvi.mathematics.units import DENSITIES, power_ratio, unit
from stochvi.results.errors import SceneError
from stochvi.scenes.characteristics import Characteristic, LinearForm
from stochvi.scenes.excitations.base import DensityUnit, unit_name
from stochvi.scenes.excitations.drawn import DrawnExcitation
from stochvi.scenes.excitations.noise import Modulation
from stochvi.scenes.structures import Isolator, Matrices, Oscillator, RigidBody
from stochvi.scenes.structures.oscillators import AnyStructure
from stochvi.scenes.structures.rigid_body import AXES
from stochvi.scenes.validation import Checked, Column, NonNegatives, Numbers, given

# ------------------------------------------------------------------------------
# Correlation of two noises: by their cross density, or by coherence and phase.
# ------------------------------------------------------------------------------


COHERENT = 1e-9
"""Size up to which a negative eigenvalue of the matrix of coherences counts as a rounding error."""


def _listed(value: Any) -> Any:
    """One number as a list of one."""
    return [value] if isinstance(value, int | float) and not isinstance(value, bool) else value


class CrossDensity(Checked):
    """How two noises depend on each other.

    They are excitations of the scene by their `name`, or the axes of the base of a rigid body. The
    correlation is given by the complex cross density, or by coherence and phase. Two white noises
    take one coherence and a phase of 0 or 180 degrees, with which they stay white.

    The cross density is one-sided per hertz, G_ab = 2 E conj(A) B / T for a, b = `between`, as
    scipy.signal.csd(a, b) estimates it. The ordinary coherence is |G_ab|^2 / (G_aa G_bb), and the
    phase that of G_ab, by which b leads a. Real and imaginary part of G_ab / sqrt(G_aa G_bb) are
    linear in the logarithm of the frequency between breakpoints. They are 0 outside them, and where
    one of the densities is 0.

    Parameters
    ----------
    between
        The two excitations by their names, or two axes, "x", "y" or "z".
    frequency_hz
        Breakpoints, Hz.
    real, imaginary
        Real and imaginary part of the cross density at each breakpoint.
    unit
        Unit of the cross density, the same as of the densities.
    coherence
        Instead of these three: ordinary coherence, 0 to 1, at each breakpoint, or one number for
        all frequencies.
    phase_deg
        Phase beside the coherence, degrees, at each breakpoint or one number; by default 0.

    See Also
    --------
    stochvi.TabulatedNoise : A noise with a density, which may have a name.

    Examples
    --------
    >>> cross = CrossDensity(
    ...     between=["x", "z"], frequency_hz=[5.0, 500.0], real=[2e-3, 1e-4],
    ...     imaginary=[1e-3, 0.0], unit="g2/Hz",
    ... )
    >>> cross.between
    ('x', 'z')
    >>> CrossDensity(between=["left wheel", "right wheel"], coherence=0.5).coherence
    (0.5,)
    """

    between: tuple[str, str]
    frequency_hz: Column | None = None
    real: Numbers | None = None
    imaginary: Numbers | None = None
    unit: DensityUnit | None = None
    coherence: Annotated[NonNegatives | None, BeforeValidator(_listed)] = Field(default=None)
    phase_deg: Annotated[Numbers | None, BeforeValidator(_listed)] = Field(default=None)

    @model_validator(mode="before")
    @classmethod
    def _as_tuple(cls, keys: object) -> object:
        if isinstance(keys, dict) and isinstance(keys.get("between"), list):
            return keys | {"between": tuple(keys["between"])}
        return keys

    @model_validator(mode="after")
    def _columns_fit(self) -> Self:
        if self.between[0] == self.between[1]:
            raise SceneError(
                "between", f"needs two different excitations or axes, got {self.between[0]!r} twice"
            )
        if self.frequency_hz is not None and np.any(np.diff(self.frequency_hz) <= 0.0):
            raise SceneError("frequency_hz", "must rise from each value to the next")
        if self.coherence is not None:
            self._check_coherence(self.coherence)
            return self
        parts = (self.frequency_hz, self.real, self.imaginary)
        if None in parts or self.unit is None or self.phase_deg is not None:
            names = ("frequency_hz", "real", "imaginary", "unit", "phase_deg")
            raise ValueError(
                "needs coherence, with phase_deg where it is not 0, or frequency_hz with real, "
                f"imaginary and unit, got {given(self, *names)}"
            )
        unit_name(self.unit, *DENSITIES)
        counts = [len(part) for part in parts if part is not None]
        if counts[0] < 2 or len(set(counts)) > 1:
            raise ValueError(
                "needs at least 2 values of frequency_hz and as many of real and imaginary, got "
                f"{counts[0]}, {counts[1]} and {counts[2]}"
            )
        return self

    def _check_coherence(self, coherence: tuple[float, ...]) -> None:
        if extra := [name for name in ("real", "imaginary", "unit") if getattr(self, name)]:
            raise ValueError(f"has coherence, which needs no {' and no '.join(extra)}")
        if max(coherence, default=0.0) > 1.0:
            raise SceneError("coherence", f"must be in [0, 1], got {max(coherence):g}")
        count = 1 if self.frequency_hz is None else len(self.frequency_hz)
        for name, values in (("coherence", coherence), ("phase_deg", self.phase_deg or (0.0,))):
            if len(values) not in (1, count):
                raise SceneError(
                    name,
                    f"needs one number, or one for each of {count} values of "
                    f"frequency_hz, got {len(values)}",
                )

    @property
    def places(self) -> Vector:
        """Frequencies at which the coherence is not smooth, Hz; none for one number."""
        return np.array(self.frequency_hz or ())

    def complex_coherence(self, tables: dict[str, Table], frequency_hz: ArrayLike) -> Waves:
        """E conj(A) B over the root of the product of the densities."""
        first, second = (tables[name] for name in self.between)
        f = np.asarray(frequency_hz, dtype=float)
        moved = (first(f) > 0.0) & (second(f) > 0.0)
        if self.coherence is not None:
            relative = np.sqrt(self.coherence) * np.exp(1j * np.radians(self.phase_deg or (0.0,)))
        else:
            size = np.sqrt(first(self.places) * second(self.places))
            parts = np.array(self.real) + 1j * np.array(self.imaginary)
            parts = parts * unit(self.unit or "").factor
            relative = np.divide(parts, size, out=np.zeros_like(parts), where=size > 0.0)
        if self.frequency_hz is None:
            return np.asarray(np.where(moved, relative, 0.0))
        relative = np.broadcast_to(relative, self.places.shape)
        with np.errstate(divide="ignore"):
            log, where = np.log(f), np.log(self.places)
        real, imaginary = (
            np.interp(log, where, part, left=0.0, right=0.0)
            for part in (relative.real, relative.imag)
        )
        return np.asarray(np.where(moved, real + 1j * imaginary, 0.0))

    @property
    def real_correlation(self) -> float | None:
        """Correlation of two white noises, from -1 to 1; None where they would not stay white."""
        if self.coherence is None or len(self.coherence) > 1 or self.frequency_hz is not None:
            return None
        (phase,) = self.phase_deg or (0.0,)
        sign = {0.0: 1.0, 180.0: -1.0}.get(phase % 360.0)
        return None if sign is None else sign * math.sqrt(self.coherence[0])

    def louder(self, level_db: float) -> CrossDensity:
        """The correlation of both noises when they are raised by a level in dB."""
        if self.real is None or self.imaginary is None:
            return self
        factor = power_ratio(level_db)
        parts = {
            name: [factor * each for each in getattr(self, name)] for name in ("real", "imaginary")
        }
        return type(self)(**(self.model_dump(exclude_none=True) | parts))


def white_correlations(crosses: tuple[CrossDensity, ...], names: tuple[str, ...]) -> Matrix:
    """Correlations of white noises, in the order of their names."""
    found = np.eye(len(names))
    for cross in crosses:
        a, b = (names.index(name) for name in cross.between)
        found[a, b] = found[b, a] = cross.real_correlation or 0.0
    return found


def impossible_whites(crosses: tuple[CrossDensity, ...], names: tuple[str, ...]) -> bool:
    """Whether no white noises have these correlations."""
    return bool(len(names)) and bool(
        np.linalg.eigvalsh(white_correlations(crosses, names))[0] < -COHERENT
    )


def coherences(
    crosses: tuple[CrossDensity, ...], tables: dict[str, Table], frequency_hz: ArrayLike
) -> Waves:
    """Matrices (frequencies, k, k) of E A_a conj(A_b), divided by the roots of the two densities,
    for the sources in the order of `tables`."""
    names = list(tables)
    f = np.asarray(frequency_hz, dtype=float)
    found = np.broadcast_to(
        np.eye(len(names), dtype=complex), (len(f), len(names), len(names))
    ).copy()
    for cross in crosses:
        a, b = (names.index(name) for name in cross.between)
        share = cross.complex_coherence(tables, f)
        found[:, b, a], found[:, a, b] = share, share.conj()
    return found


def independent_sources(
    crosses: tuple[CrossDensity, ...], tables: dict[str, Table]
) -> dict[str, Callable[[Vector], Waves]]:
    """All correlated noises per unit of independent sources, one for each of them.

    The source of a noise has the density of that noise.

    Source j drives noise a by sqrt(G_aa / G_jj) L_aj, L the Cholesky factor of the coherences. The
    sources together then have the densities and cross densities of the scene.

    Returns
    -------
    dict
        Name -> function of the frequencies (Hz) to complex (frequencies, noises).
    """

    def shares(column: int, frequency_hz: Vector) -> Waves:
        root = cholesky(coherences(crosses, tables, frequency_hz))[:, :, column]
        densities = np.array([table(frequency_hz) for table in tables.values()]).T
        own = densities[:, [column]]
        ratio = np.divide(densities, own, out=np.zeros_like(densities), where=own > 0.0)
        return np.asarray(root * np.sqrt(ratio))

    return {name: partial(shares, column) for column, name in enumerate(tables)}


def cholesky(matrices: Waves) -> Waves:
    """Lower triangular L (frequencies, k, k) with L L^H = matrices, which may be singular.

    >>> cholesky(np.array([[[1.0, -1.0j], [1.0j, 1.0]]])).round(6).tolist()
    [[[(1+0j), 0j], [1j, 0j]]]
    """
    found = np.zeros_like(matrices)
    size = matrices.shape[1]
    for j in range(size):
        left = matrices[:, :, j] - np.einsum("fik,fk->fi", found[:, :, :j], found[:, j, :j].conj())
        pivot = np.sqrt(np.maximum(left[:, j].real, 0.0))
        own = np.where(pivot > math.sqrt(COHERENT), pivot, 0.0)[:, None]
        found[:, j:, j] = np.divide(
            left[:, j:], own, out=np.zeros_like(left[:, j:]), where=own > 0.0
        )
    return found


def impossible(crosses: tuple[CrossDensity, ...], tables: dict[str, Table]) -> str:
    """Sentence on why no motion can have these densities and cross densities; empty if one can.

    The coherences are linear between breakpoints, so that it is enough to check the breakpoints.
    """
    places = np.concatenate(
        [*(each.places for each in crosses), *(table.frequency_hz for table in tables.values())]
    )
    places = np.unique(places)
    smallest = np.linalg.eigvalsh(coherences(crosses, tables, places))[:, 0]
    row = int(np.argmin(smallest))
    if smallest[row] >= -COHERENT:
        return ""
    return (
        f"is more than the densities allow at {places[row]:g} Hz: the matrix of densities must "
        "have no negative eigenvalue (for two noises |G_ab|^2 <= G_aa G_bb)"
    )


# ------------------------------------------------------------------------------
# The force by which a modulation changes a spring or a damper of a linear structure.
# ------------------------------------------------------------------------------


WHITE_STEP = 2.0
"""Rate of the steps that resolve white noise of intensity S on a spring of the frequency omega, in
units of omega^2 S: the noise of a step is then small against a radian."""

ROUNDING = 1e-12
"""Size of a spring or damper, relative to all on its coordinate, up to which it is a rounding
error of their sum."""


class ForceOfExcitation(Characteristic):
    """A force that an excitation makes, in the place of a spring or damper of the structure."""

    @property
    def remembers(self) -> bool:  # type: ignore[override]
        """True, as the force does not follow from the motion."""
        return True

    @property
    def needs(self) -> str:
        return "both"


class ModulatedForce(ForceOfExcitation):
    """The force xi(t) (stiffness x + damping v), whose mean is in the linear structure.

    Parameters
    ----------
    stiffness, damping
        What is modulated, N/m and N s/m; one of them is 0.
    mass
        Reduced mass of the displacement, kg.
    modulation
        The relative change xi.
    """

    stiffness: float
    damping: float
    mass: float
    modulation: Modulation

    @property
    def effect(self) -> str:
        return self.modulation.effect_word

    def refusal(self, name: str) -> str:
        return f"structure.{self.modulation.of} must be constant, got a {self.effect}"

    @property
    def strengths(self) -> Sequence[float]:
        return [each for each in (self.stiffness, self.damping) if each]

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        """The mean force, 0."""
        return np.zeros(np.broadcast(displacement, velocity).shape)

    def linear_form(self, mean: float, deviation: float, speed: float) -> LinearForm:
        """Nothing: the modulation is no part of the linear structure."""
        return LinearForm(0.0, 0.0, 0.0)

    def stiffest(self, mean: float, deviation: float) -> float:
        if self.modulation.source == "white noise":
            rate = WHITE_STEP * self.stiffness / self.mass * (self.modulation.intensity or 0.0)
            return self.mass * rate**2
        return self.stiffness * self._largest

    def most_damping(self, mean: float, speed: float) -> float:
        return 0.0 if self.modulation.source == "white noise" else self.damping * self._largest

    @property
    def _largest(self) -> float:
        return 3.0 * self.modulation.size

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics import Modulated

        return Modulated(self.stiffness / mass, self.damping / mass)


class Changed(NamedTuple):
    """What a modulation changes: the displacement row . q, and its spring (N/m) or damper
    (N s/m)."""

    row: Vector
    strength: float


def changed_by(modulation: Modulation, structure: AnyStructure) -> Changed:
    """What a modulation of stiffness or damping changes in a structure.

    Raises
    ------
    SceneError
        If the structure has no such spring or damper.
    """
    of = modulation.of
    if isinstance(structure, RigidBody):
        return _of_mount(modulation, structure)
    if not isinstance(structure, Oscillator | Isolator | Matrices):
        raise SceneError(
            f"of {of} takes structure.kind = 'oscillator', 'isolator', 'matrices' or "
            f"'rigid-body', got {getattr(structure, 'kind', '')!r}"
        )
    if modulation.axis is not None:
        raise SceneError("takes no axis, which is that of a mount of a box")
    if not structure.knows_mass:
        raise SceneError("changes a force, which needs structure.mass, got none")
    matrix = structure.matrices[1 if of == "damping" else 2]
    known = structure.coordinates
    names = modulation.between or ((modulation.on,) if modulation.on else known[:1])
    listed = " or ".join(repr(name) for name in known)
    if modulation.on and modulation.between:
        raise SceneError("takes on or between, got both")
    if len(known) > 1 and not (modulation.on or modulation.between):
        raise SceneError(f"needs on or between, with names of {listed}, got none")
    if unknown := [name for name in names if name not in known]:
        raise SceneError(f"must act on {listed}, got {unknown[0]!r}")
    if len(set(names)) < len(names):
        raise SceneError(f"needs two different names in between, got {names[0]!r} twice")
    places = [known.index(name) for name in names]
    row = np.zeros(len(known))
    row[places[0]] = 1.0
    strength = float(matrix[places[0]].sum())
    if len(places) > 1:
        row[places[1]] = -1.0
        strength = float(-matrix[places[0], places[1]])
    if not strength > ROUNDING * abs(float(matrix[places[0], places[0]])):
        part = "spring" if of == "stiffness" else "damper"
        where = " and ".join(names) if len(names) > 1 else f"{names[0]} and the ground"
        raise SceneError(f"needs a linear {part} between {where}, got {strength:g}")
    return Changed(row, strength)


def _of_mount(modulation: Modulation, box: RigidBody) -> Changed:
    """What a modulation changes in a mount of a box, which it names by its number."""
    names = [f"mount {number}" for number, _ in enumerate(box.mounts, 1)]
    on, axis = modulation.on or "none", modulation.axis
    if on not in names or axis is None or modulation.between:
        listed = " or ".join(repr(name) for name in names)
        got = f"on = {on!r}, axis = {axis!r}"
        raise SceneError(f"needs on = {listed} and axis = 'x', 'y' or 'z', got {got}")
    mount, along = box.mounts[names.index(on)], AXES.index(axis)
    if modulation.of == "stiffness":
        rates = box.mount_stiffness(mount)
    elif mount.damping is not None:
        rates = np.array(mount.damping)
    else:
        raise SceneError(f"of damping needs damping (N s/m along x, y, z) of {on}, got none")
    if not rates[along] > 0.0:
        raise SceneError(f"needs {modulation.of} of {on} along {axis}, got 0")
    return Changed(mount.rows[along], float(rates[along]))


# ------------------------------------------------------------------------------
# The force of an excitation whose values a simulation draws.
# ------------------------------------------------------------------------------


class DrawnForce(ForceOfExcitation):
    """The force of a drawn excitation against a displacement; only its mean is known beforehand.

    Parameters
    ----------
    mass
        Reduced mass of the displacement, kg.
    drawn
        The excitation.
    """

    mass: float
    drawn: SkipValidation[DrawnExcitation]

    @property
    def effect(self) -> str:
        return self.drawn.effect_word

    def refusal(self, name: str) -> str:
        return f"excitation must be Gaussian noise, a sine or constant, got {self.effect}"

    @property
    def strengths(self) -> Sequence[float]:
        return [each for each in (self.drawn.mean, self.drawn.si_intensity) if each]

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        """Nothing, as the structure does not carry this force."""
        return np.zeros(np.broadcast(displacement, velocity).shape)

    def linear_form(self, mean: float, deviation: float, speed: float) -> LinearForm:
        """The mean force."""
        return LinearForm(-self.drawn.mean, 0.0, 0.0)

    def stiffest(self, mean: float, deviation: float) -> float:
        return 0.0

    def most_damping(self, mean: float, speed: float) -> float:
        return 0.0

    @property
    def fastest(self) -> float:
        return self.drawn.fastest

    def compiled(self, mass: float) -> Any:
        return self.drawn.compiled(mass)
