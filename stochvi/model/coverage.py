"""Which scenes a method covers, for refusals, `explain` and the table of methods. Chapters:
conditions that are not met, in sentences; whether a modulated structure comes to rest; warnings
about a scene; standard deviations of the linear motion without impacts; natural modes and static
equilibrium."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.numerics import CANCELLATION, Matrix, Vector, Waves
from stochvi.mathematics.spectra import (
    Change,
    FilteredChange,
    InputMatrix,
    SineChange,
    WhiteChange,
    moment_growth,
    response_moments,
)
from stochvi.mathematics.units import LENGTH, STANDARD_GRAVITY
from stochvi.mathematics.unsteady_noise import FastPeaks, MovingMean, Sines
from stochvi.model.modal import LinearLaw, ModalForm, linear_law
from stochvi.model.model import FunctionOfMotion, Model
from stochvi.results.errors import NotApplicable
from stochvi.scenes.excitations import DENSITY_KINDS
from stochvi.scenes.forces import ForceOfExcitation, ModulatedForce
from stochvi.scenes.impact_laws import (
    CompliantLaw,
    Law,
    Restitution,
    RigidLaw,
    Viscoelastic,
)
from stochvi.scenes.structures.rigid_body import (
    LEAST_SHARE,
    MOTIONS,
    energy_shares,
    motion_in_words,
)


def functions(model: Model, *, with_branches: bool = False) -> list[str]:
    """A sentence for each function in a model, for methods that take numbers only; see `nonlinear`
    for `with_branches`."""
    return (
        nonlinear(model, with_branches=with_branches) + speed_restitutions(model) + rubbing(model)
    )


def compliant(model: Model) -> list[str]:
    """A sentence for each compliant stop, for methods whose stops are rigid."""
    return [
        f"stops must be rigid (law.kind = 'restitution'), got {stop.law.kind!r} at the {stop.name} "
        "stop"
        for stop in model.stops
        if not stop.rigid
    ]


def _laws(model: Model) -> Iterator[tuple[Law, str]]:
    """The law of each stop, and the place of the stop in words."""
    for pair in model.pairs:
        for stop in pair.stops:
            yield stop.law, f"at the {stop.name} stop of {pair.name}"


def rubbing(model: Model) -> list[str]:
    """A sentence for each stop that rubs, for methods without motion along stops."""
    return [
        f"law.friction must be 0, got {law.friction_coefficient:g} {place}; simulate follows it"
        for law, place in _laws(model)
        if law.friction_coefficient
    ]


def speed_restitutions(model: Model) -> list[str]:
    """A sentence for each restitution that depends on the speed, for methods that take a number."""
    return [
        f"law.coefficient must be a number, got a function of speed {place}"
        for law, place in _laws(model)
        if isinstance(law, RigidLaw) and not isinstance(law, Restitution)
    ]


def scattered(model: Model) -> list[str]:
    """A sentence for each restitution that scatters, for methods that draw nothing."""
    return [
        f"law.coefficient must be a number, got {law.coefficient} {place}, which scatters; give "
        "its mean alone"
        for law, place in _laws(model)
        if isinstance(law, Restitution) and law.scatter is not None
    ]


def nonlinear(model: Model, *, with_branches: bool = False) -> list[str]:
    """The sentences that a model must be linear between its stops, if it is not.

    Parameters
    ----------
    with_branches
        Whether the method takes springs that relax.
    """
    found = [] if with_branches else relaxing(model)
    found += [part.law.refusal(part.name) for part in model.functions]
    return found + functions_of_arrays(model, with_branches=True) + moving_stops(model)


def relaxing(model: Model) -> list[str]:
    """A sentence for each spring that relaxes, for methods whose only states are displacements and
    velocities: all but those that say otherwise."""
    return [
        f"structure.spring must have a stiffness that does not depend on frequency, got kind "
        f"'relaxation' ({name}); {FOLLOWING_RELAXATION} follow it"
        for name in dict.fromkeys(branch.spring for branch in model.branches)
    ]


FOLLOWING_RELAXATION = "simulate, history, spectrum, impacts, replay, screen and size"
"""Commands that follow springs that relax."""


def functions_of_arrays(model: Model, *, with_branches: bool = False) -> list[str]:
    """The sentence that spring and damper must not be those of a nonlinear oscillator, for methods
    that compile functions: these are functions of arrays. Those of springs that relax come first,
    where the method does not take them."""
    found = [] if with_branches else relaxing(model)
    if not (model.functions or (model.restoring is None and model.drag is None)):
        found.append(
            "structure.kind must not be 'nonlinear' (a restoring force that is a function)"
        )
    return found


def not_apart(model: Model) -> list[str]:
    """A sentence for each spring or damper whose force depends on more than the displacement or
    the velocity alone."""
    return modulated(model) + [
        f"structure.{'damper' if part.law.is_damper else 'spring'} must be a function of "
        "displacement alone or velocity alone, got "
        f"{'hysteresis' if part.law.remembers else 'both'} of kind {part.law.kind!r} ({part.name})"
        for part in model.functions
        if part.law.needs == "both" and not isinstance(part.law, ForceOfExcitation)
    ]


def modulated(model: Model, *, with_branches: bool = False) -> list[str]:
    """A sentence for each modulation and each excitation that is drawn, for methods whose structure
    does not change in time, under Gaussian noise; see `nonlinear` for `with_branches`."""
    forces = [part for part in model.functions if isinstance(part.law, ForceOfExcitation)]
    found = [] if with_branches else relaxing(model)
    return found + [part.law.refusal(part.name) for part in forces] + moving_stops(model)


def not_gaussian(model: Model) -> list[str]:
    """The sentences that noise must be Gaussian, if its level varies at random, or it has fast
    peaks, or shocks come."""
    found = []
    if model.level is not None:
        found.append(
            f"excitation must be Gaussian noise, got noise of varying level, of kurtosis "
            f"{model.level.kurtosis:g}; simulate, reliability, size and damage follow it"
        )
    for each, _ in model.drawn:
        got, follow = "pulses of a shape", f"{FOLLOWING_SHOCKS} follow them"
        if isinstance(each, FastPeaks):
            got = f"noise with fast peaks, of kurtosis {each.kurtosis:g}"
            follow = f"{FOLLOWING_PEAKS} follow it; without the kurtosis the rms motion is the same"
        found.append(f"excitation must be Gaussian noise, got {got}; {follow}")
    return found


def moving_stops(model: Model) -> list[str]:
    """A sentence for each pair whose stops move."""
    return [
        f"structure must have stops that stand still, got a modulation of clearance at {pair.name}"
        for pair in model.pairs
        if pair.moved
    ]


def not_compiled(model: Model) -> list[str]:
    """A sentence for each impact law of a model that no simulation can follow."""
    from stochvi.engine.parts import bodies_lacking  # numba, which closed forms do not load

    found = []
    for law, place in _laws(model):
        compiled = law.compiled()
        lacking = [] if compiled is None else bodies_lacking(compiled)
        if lacking:
            own = f"; write @{lacking[0]}.of({type(compiled).__name__}) for its class of kernels"
        if lacking or compiled is None:
            found.append(
                f"law must be one that a simulation follows, got {law.kind!r} {place}"
                f"{own if lacking else ''}"
            )
    return found


def speed_functions(model: Model) -> list[str]:
    """A sentence for each force that is a function of the speed, for methods whose dampers are
    linear."""
    return [
        f"law.force must depend on the speed by a linear damper alone, got {law.kind!r} {place}"
        for law, place in _laws(model)
        if isinstance(law, CompliantLaw) and not law.has_linear_damper
    ]


def without_energy(model: Model) -> list[str]:
    """A sentence for each force whose energy is not known."""
    return [
        f"law.energy must be known, got none of kind {law.kind!r} {place}; give the function of "
        "the deflection that returns it, J"
        for law, place in _laws(model)
        if isinstance(law, CompliantLaw) and not law.has_energy
    ]


def unknown_dampers(model: Model) -> list[str]:
    """A sentence for each impact law with a damper beside a spring that is not linear. It is for
    methods whose only contacts with dampers are those of viscoelastic stops."""
    return [
        f"law must be 'viscoelastic' where it has a damper, got {law.kind!r} {place}"
        for law, place in _laws(model)
        if not (law.rigid or law.conservative or isinstance(law, Viscoelastic))
    ]


def beyond_one_oscillator(
    model: Model,
    *,
    with_functions: bool = False,
    with_filters: bool = False,
    with_sines: bool = False,
    with_speeds: bool = False,
    white_only: bool = False,
) -> list[str]:
    """The conditions of a method for one oscillator that a model does not meet.

    Parameters
    ----------
    with_functions
        Whether the method takes springs, dampers and restitutions that are functions.
    with_filters
        Whether the method takes filtered noise.
    with_sines
        Whether the method takes sines beside noise.
    with_speeds
        Whether the method takes restitutions that depend on the speed.
    white_only
        Whether the method takes no noise but white noise (see `not_white`).
    """
    if with_functions:
        found = not_apart(model)
    else:
        found = nonlinear(model) + rubbing(model)
        found += [] if with_speeds else speed_restitutions(model)
    if len(model.coordinates) > 1:
        found.append(
            "structure.kind must be 'oscillator' or 'isolator', got "
            f"{len(model.coordinates)} coordinates ({', '.join(model.coordinates)}), which "
            "simulate and linearise take"
        )
    if len(model.pairs) > 1:
        found.append(f"the scene must have one impact pair, got {len(model.pairs)}")
    kinds = {"sine" if signal.amplitude else "filtered" for signal in model.signals}
    if white_only:
        words = {"filtered": "filtered noise", "sine": "a sine"}
        return found + [f"{WHITE}, got {words[kind]}" for kind in sorted(kinds)]
    covered = ["white", *["filtered"] * with_filters, *["sine"] * with_sines, *DENSITY_KINDS]
    found += [
        f"excitation must be {', '.join(covered)} or constant, got {kind}"
        for kind in sorted(kinds - set(covered))
    ]
    return found


def without_noise(model: Model, *, with_sines: bool = False) -> list[str]:
    """The sentence that nothing in a model is random, for methods for random motion.

    Parameters
    ----------
    with_sines
        Whether the method takes a sine in place of noise.
    """
    if model.noisy or (with_sines and (model.sines or model.modulations)):
        return []
    wanted = "noise or a sine" if with_sines else "noise"
    got = "a sine" if model.sines else "a constant load"
    remedy = "; the command sine finds the motions under it" if model.sines else ""
    return [f"excitation must contain {wanted}, got {got} alone{remedy}"]


def unshaken(rms: Mapping[str, float]) -> list[str]:
    """The sentence that names pairs that nothing shakes, by the rms motions of all."""
    still = [name for name, each in rms.items() if not each > 0.0]
    pairs, them = ("pair", "it") if len(still) == 1 else ("these pairs:", "them")
    return [
        f"nothing shakes {pairs} {', '.join(still)}; remove {them}, or add an excitation with "
        "another axis"
    ] * bool(still)


def without_free_response(model: Model) -> list[str]:
    """The sentences that one oscillator has no stationary motion without stops."""
    return [
        f"structure.{key} must be positive, as the motion without stops is to be stationary, got 0"
        for key, rate in (("stiffness", model.omega), ("damping", model.damping_rate))
        if rate == 0.0
    ]


FOLLOWING_PEAKS = "simulate, impacts, damage, reliability and size"
"""Commands that follow noise with fast peaks."""

FOLLOWING_SHOCKS = "simulate, impacts, damage, reliability and size"
"""Commands that follow shocks of a shape."""

WHITE = "excitation must be white noise"
"""The condition of methods for white noise alone."""


def not_white(model: Model) -> list[str]:
    """The conditions of a method for white noise that a model does not meet."""
    if model.tables:
        return [f"{WHITE}, got a tabulated density"]
    return not_gaussian(model) + without_noise(model)


def without_dissipation(model: Model) -> list[str]:
    """The sentence that one oscillator must lose the energy that noise brings, if it loses none."""
    if model.damping_rate == 0.0 and model.drag is None and model.elastic:
        return ["damping must be positive where no stop takes energy, got 0"]
    return []


# ------------------------------------------------------------------------------
# Whether a structure whose springs and dampers are modulated comes to rest without its stops.
# ------------------------------------------------------------------------------


STILL = 1e-9
"""Growth, relative to the fastest frequency, up to which it is a rounding error."""


def linear_system(model: Model) -> Matrix:
    """The matrix (2n, 2n) of displacements and velocities of the modes, 1/s, without modulations
    and stops."""
    modes, n = model.modal, model.modal.size
    return np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(modes.squares), -modes.damping]])


def change_of(model: Model, part: FunctionOfMotion) -> Change:
    """How a modulation changes `linear_system`."""
    modes, n, law = model.modal, model.modal.size, part.law
    assert isinstance(law, ModulatedForce)
    row, known = part.direction @ modes.shapes, law.modulation
    matrix = np.zeros((2 * n, 2 * n))
    matrix[n:, :n] = -law.stiffness * np.outer(row, row)
    matrix[n:, n:] = -law.damping * np.outer(row, row)
    if known.amplitude is not None:
        return SineChange(matrix, known.amplitude, known.omega)
    if known.filter is not None:
        return FilteredChange(matrix, *known.filter)
    return WhiteChange(matrix, part.white_modulation)


@lru_cache(maxsize=32)
def growth(model: Model, power: int) -> float | None:
    """Rate, 1/s, at which means (power 1) or mean squares (2) of the motion without stops grow in
    the long run, from the equations of the moments.

    None where they are not known: the structure has functions of the motion, a modulation is
    tabulated noise, or the equations are too many.
    """
    parts = model.modulations
    if len(parts) < len(model.functions) or any(part.sample is not None for part in parts):
        return None
    changes = [change_of(model, part) for part in parts]
    return moment_growth(linear_system(model), changes, power)


def unstable(model: Model) -> list[str]:
    """The sentence that the mean squares of a modulated structure without stops have no end; empty
    where they have."""
    if not model.modulations or model.stops:
        return []
    if not model.shaken:
        return [
            "excitation must contain noise or a sine that shakes where no stop limits the motion, "
            "got a modulation alone; growth says whether it grows"
        ]
    found = growth(model, 2)
    if found is None or found < -STILL * model.modal.fastest:
        return []
    return [
        "mean squares must be finite where no stop limits the motion, got a modulation by which "
        f"they grow at {found:.3g} 1/s; add damping, modulate less or add stops"
    ]


Settling = Callable[[Model, float], float]
"""Longest relaxation time of a variance, s, of a model with its modulations, from that without."""

LONGEST = 20.0
"""Largest factor by which modulations lengthen the relaxation time of a structure with stops."""


def slowest_of(model: Model, slowest: float) -> float:
    """Longest relaxation time of a variance, s, with the modulations of a model.

    Parameters
    ----------
    model
        A model with a stationary state.
    slowest
        That time without modulations, s.
    """
    found = growth(model, 2) if model.modulations else None
    if not found:
        return slowest
    with_modulations = 1.0 / abs(found)
    longest = LONGEST * slowest if model.stops else with_modulations
    return max(slowest, min(with_modulations, longest))


def heavy_tails(model: Model) -> list[str]:
    """A warning where the fourth moments of a modulated structure without stops have no end."""
    if not model.modulations or model.stops or unstable(model):
        return []
    found = growth(model, 4)
    if found is None or found < -STILL * model.modal.fastest:
        return []
    return [
        "the modulation lets fourth moments grow without end: rare large motions make the errors "
        "of mean squares too small; add damping or stops, or trust the means alone"
    ]


# ------------------------------------------------------------------------------
# Warnings that concern a scene itself, whatever the method. Commands print them as notes.
# ------------------------------------------------------------------------------


FAR_STOPS = 20.0
"""Clearance, in standard deviations of the motion without stops, above which a wrong unit is more
likely than intent."""

BROAD_VELOCITY = 1.5
"""Ratio of the zero-crossing frequency to the natural frequency above which a single impact can
start a cluster."""

LARGEST_INPUT = 25.0
"""Acceleration of a base, g rms, above which a wrong unit is more likely than intent. The severest
profile that ships has 14.1 g rms. A density in (m/s2)2/Hz taken for one in g2/Hz makes the rms 9.8
times too large."""


MOVED = 1e-6
"""Share of the largest motion of a gap in any mode below which a mode does not move it."""


def scene_notes(model: Model) -> list[str]:
    """Warnings on a scene that concern every method: those of its excitations; numbers that are
    probably in a wrong unit, damping above critical, resonances outside the tables, stops out of
    reach; for one mass a broad response, for several coordinates modes below the tables."""
    found = [*model.cautions, *heavy_tails(model)]
    one = len(model.coordinates) == 1
    if one and (model.rates is None or model.omega == 0.0 or model.damping_rate == 0.0):
        return found
    if not one and functions(model):
        return found
    motion = _motion_of_one(model) if one else _motion_of_gaps(model)
    return [
        *found, *_loud_input(model), *_overdamped(model), *_outside_tables(model),
        *(_broad(model, motion) if one else _modes_below_tables(model)),
        *_far_stops(model, motion),
    ]  # fmt: skip


class _GapMotion(NamedTuple):
    """The motion of a gap without stops: its name, standard deviations of displacement and
    velocity, and the distances of its stops from the mean."""

    name: str
    displacement: float
    velocity: float
    stops: tuple[float, ...]


def _motion_of_one(model: Model) -> list[_GapMotion]:
    """The motion of one mass."""
    theta = model.intensity / (2.0 * model.damping_rate)
    linear = response_moments(model.acceleration_tables, model.omega, model.damping_rate)
    displacement = linear.displacement + theta / model.omega**2
    velocity = linear.velocity + theta
    for filtered in model.filters:
        moments = filtered.response_moments(model.omega, model.damping_rate)
        displacement, velocity = displacement + moments[0], velocity + moments[1]
    stops = tuple(abs(stop.position - model.rest) for stop in model.stops)
    return [_GapMotion("", math.sqrt(displacement), math.sqrt(velocity), stops)]


def _motion_of_gaps(model: Model) -> list[_GapMotion]:
    """The motion of the gaps of a structure; empty where none is stationary without stops."""
    if not model.pairs:
        return []

    try:
        motion = free_motion(model, with_sines=True)
    except NotApplicable:
        return []
    rows = np.array([pair.direction for pair in model.pairs])
    return [
        _GapMotion(
            pair.name, float(place), float(speed),
            tuple(abs(stop.position - float(mean)) for stop in pair.stops),
        )
        for pair, place, speed, mean in zip(
            model.pairs, *motion.deviations(rows), model.mean_gaps, strict=True
        )
    ]  # fmt: skip


def _loud_input(model: Model) -> list[str]:
    """A warning of an axis of the base whose rms acceleration is beyond every usual test."""
    if not model.base_alone_moves:
        return []
    axes: dict[bytes, float] = {}
    for table, force in model.tables:
        if not isinstance(force, InputMatrix):
            axis = np.asarray(force).tobytes()
            axes[axis] = axes.get(axis, 0.0) + table.mean_square()
    shaken = math.sqrt(max(axes.values(), default=0.0)) / STANDARD_GRAVITY
    if shaken <= LARGEST_INPUT:
        return []
    return [
        f"the base is shaken with {shaken:.3g} g rms, more than any usual test "
        f"({LARGEST_INPUT:g} g rms): check the unit of the density, and its band"
    ]


def _overdamped(model: Model) -> list[str]:
    """A warning of modes with more than critical damping."""
    form = model.modal
    held = form.squares > 0.0
    ratios = np.diag(form.damping)[held] / (2.0 * np.sqrt(form.squares[held]))
    if not np.any(ratios > 1.0):
        return []
    where = " in one mode" if len(model.coordinates) > 1 else ""
    return [
        f"the damping ratio zeta is {ratios.max():.3g}{where}, above critical: 10 % of critical is "
        "zeta = 0.1"
    ]


def _tables_alone(model: Model) -> tuple[float, float] | None:
    """Lowest and highest frequency of the tables that alone shake the structure, Hz; None where
    other noise does, or nothing."""
    form = model.modal
    if not form.tables or form.kicked or np.any(form.signal_noise):
        return None
    ends = np.array([table.frequency_hz[[0, -1]] for table, _ in form.tables])
    return float(ends[:, 0].min()), float(ends[:, 1].max())


def _moving_modes(model: Model) -> Vector:
    """Natural frequencies of the modes that move a gap, or of all without pairs, Hz."""
    form = model.modal
    size = np.abs(form.gaps)
    moves = np.any(size > MOVED * size.max(), axis=0) if size.size else form.squares > 0.0
    return np.asarray(np.sqrt(form.squares[moves & (form.squares > 0.0)]) / (2.0 * math.pi))


def _outside_tables(model: Model) -> list[str]:
    """A warning that the tables hold none of the resonances that move the gaps. The gaps of a
    structure have a warning of their own for resonances below."""
    ends = _tables_alone(model)
    natural = _moving_modes(model)
    if ends is None or not len(natural):
        return []
    low, high = ends
    several, lowest = len(model.coordinates) > 1, float(natural.min())
    if lowest <= high and (several or low <= lowest):
        return []
    which = "lowest natural frequency" if several else "natural frequency"
    return [
        f"the {which} {lowest:.4g} Hz lies outside the table ({low:g} to {high:g} Hz): "
        "the response depends on excitation that the table does not hold"
    ]


def _broad(model: Model, motion: list[_GapMotion]) -> list[str]:
    """A warning of one mass whose response crosses zero far above its natural frequency."""
    ((_, displacement, velocity, stops),) = motion
    natural = model.omega / (2.0 * math.pi)
    crossing = velocity / displacement / (2.0 * math.pi) if displacement else 0.0
    if not stops or crossing <= BROAD_VELOCITY * natural:
        return []
    return [
        f"the response without stops crosses zero at {crossing:.3g} Hz, well above the natural "
        f"frequency {natural:.3g} Hz: one impact can start a cluster, so Rice's rate and "
        "linearisation may be wrong by large factors; simulate it"
    ]


def _far_stops(model: Model, motion: list[_GapMotion]) -> list[str]:
    """A warning of stops that no motion reaches."""
    far = [
        (min(stops) / deviation, name, deviation)
        for name, deviation, _, stops in motion
        if stops and deviation and min(stops) > FAR_STOPS * deviation
    ]
    if not far:
        return []
    multiple, name, deviation = min(far)
    which = f"stop of {name}" if name else "nearest stop"
    others = f", those of {len(far) - 1} others farther" if far[1:] else ""
    return [
        f"the {which} is {multiple:.3g} rms motions ({LENGTH.text(deviation, '.3g')} each) away"
        f"{others}: did you write mm for m?"
    ]


def _modes_below_tables(model: Model) -> list[str]:
    """A warning of modes that move a gap and lie below the first frequency of all tables, where
    tables alone shake the structure.

    The tables hardly excite such a mode, but impacts do: it then swings wider than the gap.
    """
    ends = _tables_alone(model)
    if ends is None or not model.pairs:
        return []
    low, _ = ends
    frequencies = _moving_modes(model)
    found = [f"{f:.3g}" for f in frequencies[frequencies < low]]
    if not found:
        return []
    which = "modes lie" if len(found) > 1 else "mode lies"
    return [
        f"{len(found)} {which} below the tables, which begin at {low:g} Hz: {', '.join(found)} Hz. "
        "Impacts can pump such a mode, so that linear numbers and Rice's rate may be too low by "
        "large factors; simulate it"
    ]


# ------------------------------------------------------------------------------
# Stationary motion of a linear structure where nothing is hit: exact standard deviations.
# ------------------------------------------------------------------------------


AT_REST = 1e-20
"""The velocity variance of a gap is a rounding error below this share of the largest that it could
have. That is the square of its row of modal shapes times the largest variance of a modal
velocity."""


class FreeMotion(NamedTuple):
    """Modes of a structure and the stationary distribution of its motion without stops."""

    modes: ModalForm
    law: LinearLaw

    def sines(self, directions: Matrix) -> Sines:
        """The sines that move displacements along `directions` (rows, n)."""
        n = self.modes.size
        omega = np.array([omega for _, omega, _ in self.modes.sines])
        modal: Waves = np.array([wave[:n] for wave in self.law.waves], complex).reshape(-1, n)
        return Sines(omega, (directions @ self.modes.shapes) @ modal.T)

    def moving_means(self, directions: Matrix) -> list[MovingMean]:
        """Displacements along `directions` (rows, n): noise beside sines."""
        sines = self.sines(directions)
        return [
            MovingMean(float(place), float(speed), Sines(sines.omega, sines.waves[row : row + 1]))
            for row, (place, speed) in enumerate(zip(*self.deviations(directions), strict=True))
        ]

    def deviations(self, directions: Matrix) -> tuple[Vector, Vector]:
        """Standard deviations of displacements (m) and velocities (m/s) along `directions`
        (rows, n) under noise alone; 0 where the motion is a rounding error only."""
        n, rows = self.modes.size, directions @ self.modes.shapes
        places, speeds = (
            np.einsum("gm,mk,gk->g", rows, self.law.covariance[part, part], rows)
            for part in (slice(0, n), slice(n, 2 * n))
        )
        most = np.sum(rows**2, axis=1) * np.max(np.diag(self.law.covariance)[n : 2 * n])
        moves = speeds > AT_REST * most
        return np.sqrt(np.where(moves, places, 0.0)), np.sqrt(np.where(moves, speeds, 0.0))


def free_motion(model: Model, *, with_sines: bool = False) -> FreeMotion:
    """The stationary motion of a structure under Gaussian noise, its stops left out.

    Parameters
    ----------
    with_sines
        Whether sines may be there beside the noise.

    Raises
    ------
    NotApplicable
        If there is no such motion, or it is not Gaussian: the scene has a sine that is not asked
        for, no noise, a spring that is a function, or a coordinate that no spring holds or no
        damper damps.
    """
    unmet = nonlinear(model, with_branches=True)
    if model.sines and not with_sines:
        unmet.append("excitation must be noise or constant, got sine")
    unmet += without_noise(model) + not_gaussian(model)
    law = None if unmet else linear_law(model.modal)
    if law is None:
        raise NotApplicable(
            "linear motion",
            unmet or [_unheld(model)],
        )
    return FreeMotion(model.modal, law)


def _unheld(model: Model) -> str:
    """A sentence on the modes that have no stationary motion, and on what they lack."""
    modes = model.modal
    words = "stiffness and damping must hold every coordinate without its stops"
    held = modes.squares > 0.0
    if not np.all(held):
        return (
            f"{words}: {np.sum(~held)} of {modes.size} modes have no stiffness; give springs that "
            "hold them, or, for a mass that stops alone hold, let simulate or linearise follow it"
        )
    shares = np.diag(modes.damping) / np.sqrt(modes.squares)
    named = ", ".join(f"{math.sqrt(w) / (2.0 * math.pi):.3g}" for w in modes.squares[shares <= 0.0])
    where = f" at {named} Hz" if named else ""
    return f"{words}: there is no damping{where}; give damping, zeta or loss_factor"


# ------------------------------------------------------------------------------
# The natural modes of a structure, and where it rests under its constant loads.
# ------------------------------------------------------------------------------


class NaturalMode(NamedTuple):
    """An undamped natural mode phi of M q'' + K q = 0, phi'M phi = 1.

    Parameters
    ----------
    frequency_hz
        Natural frequency, Hz; 0 for an unrestrained mode.
    damping_ratio
        phi'C phi / (2 omega), dimensionless; None where no spring holds the mode.
    motion
        The coordinates that move, by falling share of the kinetic energy.
    effective_mass
        (phi'M iota)^2, kg, by axis of the base, where iota are the displacements of the coordinates
        when they follow the base along that axis. The effective masses of all modes add up to the
        mass that moves along the axis.
    """

    frequency_hz: float
    damping_ratio: float | None
    motion: str
    effective_mass: Mapping[str, float]


class RestingGap(NamedTuple):
    """Position of a gap at rest under constant loads, and its distances from the stops, m.

    The distance is None where there is no stop, and negative where the mass is pressed onto it.
    """

    position: float
    to_lower: float | None
    to_upper: float | None


def natural_modes(model: Model) -> tuple[NaturalMode, ...]:
    """The modes of a structure in rising order of their frequencies.

    There are none where a spring or damper is a function.

    Examples
    --------
    >>> from stochvi import Matrices, Scene, WhiteNoise
    >>> from stochvi.model.model import model_of
    >>> two = Matrices(
    ...     coordinates=["a", "b"], mass=[[1.0, 0.0], [0.0, 1.0]],
    ...     damping=[[0.1, 0.0], [0.0, 0.1]], stiffness=[[2.0, -1.0], [-1.0, 2.0]],
    ... )
    >>> scene = Scene(structure=two, excitations=[WhiteNoise(intensity=1.0, on="a")])
    >>> [round(mode.effective_mass[""], 9) for mode in natural_modes(model_of(scene))]
    [2.0, 0.0]
    """
    if functions(model):
        return ()
    form, found = model.modal, []
    for square, shape, damping in zip(
        form.squares, form.shapes.T, np.diag(form.damping), strict=True
    ):
        omega = math.sqrt(float(square))
        found.append(
            NaturalMode(
                frequency_hz=omega / (2.0 * math.pi),
                damping_ratio=float(damping) / (2.0 * omega) if omega else None,
                motion=_motion(model, shape),
                effective_mass={
                    axis: float(shape @ model.mass @ influence) ** 2
                    for axis, influence in model.base.items()
                },
            )
        )
    return tuple(found)


def _motion(model: Model, shape: np.ndarray) -> str:
    if model.coordinates == tuple(MOTIONS):
        return motion_in_words(shape, model.mass)
    shares = energy_shares(shape, model.mass)
    least = min(LEAST_SHARE, shares.max())  # of many coordinates none may have a large share
    order = [k for k in np.argsort(-shares, kind="stable") if shares[k] >= least]
    names = [model.coordinates[k] for k in order]
    return f"{names[0]} with {', '.join(names[1:])}" if names[1:] else names[0]


def at_rest(model: Model) -> tuple[dict[str, float], dict[str, RestingGap]]:
    """Displacements of coordinates and points (m, or rad for rotations) under the constant loads if
    no stop is met, and the gaps in that position. Both are empty without a constant load or without
    a position of rest."""
    loaded = bool(np.any(model.constant_force)) and not functions(model)
    if not loaded or np.any(model.modal.falling):
        return {}, {}
    rest = model.modal.shapes @ model.modal.rest
    rest = np.where(np.abs(rest) > CANCELLATION * np.abs(rest).max(), rest, 0.0)
    places = dict(zip(model.outputs, (model.output_rows @ rest).tolist(), strict=True))
    gaps = {}
    for pair in model.pairs:
        y = float(pair.direction @ rest)
        lower, upper = (
            None if stop is None else -float(stop.deflection(y))
            for stop in (pair.lower, pair.upper)
        )
        gaps[pair.name] = RestingGap(y, lower, upper)
    return places, gaps
