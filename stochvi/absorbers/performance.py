"""Performance of impact absorbers. Chapters: the tuned spring and dashpot that an absorber competes
with; the motion of a structure with and without loose masses."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, replace
from typing import Any, ClassVar, NamedTuple, Unpack

import numpy as np
import scipy

from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.units import shown
from stochvi.methods.monte_carlo import compile_kernels, record_paths, simulate
from stochvi.model.modal import linear_law
from stochvi.model.model import Model, Pair, Stop, model_of
from stochvi.results.base import (
    DataFrame,
    PairResponse,
    Response,
    Result,
    frame_of,
    stated,
    total_cost,
)
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import (
    Estimate,
    combined,
    correlated_total,
    mean_and_error,
    provenance,
    student_factor,
)
from stochvi.sampling.calculations import AccuracyOptions, ListSampler, calculation
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.excitations import BASE, Excitation, Sine
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Matrices

# ------------------------------------------------------------------------------
# The damper that an absorber competes with: the same mass on a tuned spring and dashpot.
# ------------------------------------------------------------------------------


NO_STOPS = (
    "the structure must have no stops of its own beside an absorber, got impact_pair; leave it out"
)
"""Condition of every calculation of an absorber."""

UNSTEADY = (
    "the structure must have a stationary state without the absorber; give each coordinate "
    "stiffness and damping"
)
"""Condition of every comparison with the structure alone."""

NAME = "tuned damper"
"""Name of the coordinate of the damper's mass."""

TOLERANCE = 1e-4
"""Relative accuracy of the frequency and the damping ratio of the best damper, and of the rms
displacement that it leaves."""

OTHER_FREQUENCY = 0.2
"""Logarithm of the frequency of the motion over that of Warburton's tuning from which the search
for the best damper begins at both."""


@dataclass(frozen=True, kw_only=True)
class TunedDamper:
    """A mass on a linear spring and dashpot, tuned to calm what carries it (SI units).

    Parameters
    ----------
    mass, stiffness, damping
        kg, N/m and N s/m.
    frequency_hz, zeta
        Natural frequency and damping ratio of the damper on a carrier at rest.
    ratio
        rms displacement of the carrier with the damper over that without, exactly; the same at
        every level of the excitation.
    displacement_std
        rms displacement of the carrier, m.
    stroke_std
        rms displacement of the damper's mass relative to the carrier, m: the room it needs.
    tuning
        What it is tuned for: "least rms displacement" or "Den Hartog". It names the number of
        trials where the search did not end.

    See Also
    --------
    stochvi.absorber : The answer that holds it.
    """

    mass: float
    stiffness: float
    damping: float
    frequency_hz: float
    zeta: float
    ratio: float
    displacement_std: float
    stroke_std: float
    tuning: str


def white_noise_tuning(mass_ratio: float, moving_base: bool) -> tuple[float, float]:
    """Frequency ratio and damping ratio of least rms displacement under white noise.

    For a carrier without damping (Warburton 1982): under a force f^2 = (1 + m / 2) / (1 + m)^2 and
    zeta^2 = m (1 + 3 m / 4) / (4 (1 + m) (1 + m / 2)); on a moving base f^2 = (1 - m / 2) /
    (1 + m)^2 and zeta^2 = m (1 - m / 4) / (4 (1 + m) (1 - m / 2)).

    Parameters
    ----------
    mass_ratio
        m, mass of the damper over that of the carrier; on a moving base below 2.
    moving_base
        Whether the base is shaken, and not the carrier.

    Returns
    -------
    tuple of float
        Natural frequency of the damper over that of the carrier, and its damping ratio.

    Examples
    --------
    >>> f, zeta = white_noise_tuning(0.05, moving_base=False)
    >>> round(f, 4), round(zeta, 4)
    (0.9642, 0.1098)
    """
    sign = -1.0 if moving_base else 1.0
    half = 1.0 + sign * mass_ratio / 2.0
    quarter = 1.0 + (-0.25 if moving_base else 0.75) * mass_ratio
    frequency = math.sqrt(half) / (1.0 + mass_ratio)
    return frequency, math.sqrt(mass_ratio * quarter / (4.0 * (1.0 + mass_ratio) * half))


def den_hartog_tuning(mass_ratio: float) -> tuple[float, float]:
    """Frequency ratio and damping ratio with the lowest resonance peaks under a sine.

    f = 1 / (1 + m), zeta^2 = 3 m / (8 (1 + m)^3) for a carrier without damping (Den Hartog,
    Mechanical Vibrations, chapter 3).

    Examples
    --------
    >>> f, zeta = den_hartog_tuning(0.05)
    >>> round(f, 4), round(zeta, 4)
    (0.9524, 0.1273)
    """
    whole = 1.0 + mass_ratio
    return 1.0 / whole, math.sqrt(3.0 * mass_ratio / (8.0 * whole**3))


@calculation
def tuned_damper(structure: Scene, carrier: str, mass: float) -> TunedDamper | None:
    """The tuned damper of a mass on a structure without stops, under what shakes it.

    Under noise a search finds the damper with the least rms displacement of the carrier. It begins
    at Warburton's tuning for white noise and, where the motion has another frequency (as under a
    narrow band), also there. The rms values are exact. A sine alone would be cancelled by a damper
    without losses, which would fit no other frequency: under a sine the damper is therefore that of
    Den Hartog, for a structure of one coordinate.

    Parameters
    ----------
    structure
        A linear structure without an absorber and without stops.
    carrier
        The coordinate that carries the damper.
    mass
        Mass of the damper, kg.

    Returns
    -------
    TunedDamper or None
        None for several coordinates under a sine.

    Raises
    ------
    ValueError
        If the structure has no such coordinate, or the mass is not positive.
    NotApplicable
        If the structure has no stationary motion.

    See Also
    --------
    stochvi.absorber : The same mass in a box with play, beside this damper.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> tower = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.04)],
    ... )
    >>> round(tuned_damper(tower, "x", 0.05).ratio, 2)
    0.4
    """
    coordinates = structure.structure.coordinates
    if carrier not in coordinates:
        raise ValueError(
            f"carrier must be a coordinate of the structure ({', '.join(coordinates)}), got "
            f"{shown(carrier)}"
        )
    if not mass > 0.0:
        raise ValueError(f"mass must be positive, got {mass}")
    row = coordinates.index(carrier)
    carried, _, held = (float(matrix[row, row]) for matrix in structure.structure.matrices)
    rms, speed, _ = _motion(structure, row)
    mass_ratio = mass / carried
    # for several modes, the frequency of the one that moves the carrier most
    omega = math.sqrt(held / carried) if len(coordinates) == 1 else speed / rms

    def damped(frequency: float, zeta: float) -> Scene:
        stiffness = mass * (frequency * omega) ** 2
        return _with_damper(
            structure, row, mass, stiffness, 2.0 * zeta * math.sqrt(mass * stiffness)
        )

    if any(isinstance(each, Sine) for each in structure.excitations):
        if len(coordinates) > 1:
            return None
        tuning, (frequency, zeta) = "Den Hartog", den_hartog_tuning(mass_ratio)
    else:
        tuning = "least rms displacement"
        moving_base = all(structure.place(each) == BASE for each in structure.excitations)
        start = white_noise_tuning(min(mass_ratio, 1.0), moving_base)

        def left_over(logs: Vector) -> float:
            frequency, zeta = np.exp(logs).tolist()
            try:
                return math.log(_motion(damped(frequency, zeta), row)[0] / rms)
            except NotApplicable:  # a damper that loses next to nothing has no stationary motion
                return math.inf

        starts = [start]
        shaken = speed / rms / omega  # under a narrow band, its frequency over that of the carrier
        if abs(math.log(shaken / start[0])) > OTHER_FREQUENCY:
            starts.append((shaken, start[1]))
        searches = [
            scipy.optimize.minimize(
                left_over, np.log(np.array(each)), method="Nelder-Mead",
                options={"xatol": TOLERANCE, "fatol": TOLERANCE},
            )
            for each in starts
        ]  # fmt: skip
        found = min(searches, key=lambda search: float(search.fun))
        if not found.success:
            tuning = f"least rms displacement of {found.nfev} trials"
        frequency, zeta = np.exp(found.x).tolist()
    left, _, stroke = _motion(damped(frequency, zeta), row)
    stiffness = mass * (frequency * omega) ** 2
    return TunedDamper(
        mass=mass,
        stiffness=stiffness,
        damping=2.0 * zeta * math.sqrt(mass * stiffness),
        frequency_hz=frequency * omega / (2.0 * math.pi),
        zeta=zeta,
        ratio=left / rms,
        displacement_std=left,
        stroke_std=stroke,
        tuning=tuning,
    )


def _with_damper(
    structure: Scene, row: int, mass: float, stiffness: float, damping: float
) -> Scene:
    """The structure with a mass on a spring and a dashpot on the coordinate of this row."""
    names = structure.structure.coordinates
    matrices = structure.structure.matrices
    link = np.zeros(len(names) + 1)
    link[row], link[-1] = -1.0, 1.0
    whole = [np.pad(matrix, (0, 1)) for matrix in matrices]
    whole[0][-1, -1] = mass
    return Scene(
        structure=Matrices(
            coordinates=(*names, NAME),
            mass=whole[0],
            damping=whole[1] + damping * np.outer(link, link),
            stiffness=whole[2] + stiffness * np.outer(link, link),
        ),
        excitations=[
            each.model_copy(update={"on": structure.place(each)}) for each in structure.excitations
        ],
    )


def _motion(scene: Scene, row: int) -> tuple[float, float, float]:
    """rms displacement and velocity of a coordinate, and the rms displacement of the last
    coordinate relative to it; m, m/s, m."""
    modes = model_of(scene).modal
    law = linear_law(modes)
    if law is None:
        raise NotApplicable("absorber", UNSTEADY)
    shape, relative = modes.shapes[row], modes.shapes[-1] - modes.shapes[row]
    return (
        math.sqrt(law.variances(shape, 0)),
        math.sqrt(law.variances(shape, modes.size)),
        math.sqrt(law.variances(relative, 0)),
    )


# ------------------------------------------------------------------------------
# Performance of impact absorbers: the motion of a structure with and without loose masses.
# ------------------------------------------------------------------------------


PEAK_PERIODS = 100
"""Length of a window whose largest displacement is a peak, periods of the structure."""

PEAK_WINDOWS = 96
"""Number of windows whose peaks are averaged: the standard error of their mean is about 2 %."""

WINDOWS_OF_PATH = 8
"""Number of windows that are taken from one path after it has settled."""

RECORDED_TOGETHER = 2
"""Number of paths that are recorded between two looks at the deadline; it divides the number of all
paths."""

LEVELS_DB = (-6.0, -3.0, 0.0, 3.0, 6.0)
"""Levels of the excitation, dB relative to that of the scene, at which an absorber is judged."""


@dataclass(frozen=True, kw_only=True)
class Performance:
    """The effect of an absorber at one level of the excitation (SI units).

    Parameters
    ----------
    level_db
        Level of everything that shakes, relative to the scene.
    ratio
        rms displacement of the carrier with the absorber over that without.
    displacement_std, displacement_std_without, velocity_std
        rms values of the carrier, m and m/s; without the absorber from the linear response,
        exactly.
    peak_factor, peak_factor_without
        Mean over windows of `PEAK_PERIODS` periods of the largest abs(x - mean) / rms.
    acceleration_std, acceleration_std_without
        Absolute acceleration of the carrier between impacts, where its base alone shakes it.
    impacts_per_period
        Impacts of all units together that are faster than the threshold, per period of the motion
        of the carrier.
    wall_force
        Mean over time of the magnitude of the forces on all stops, N.
    impulse
        Mean impulse of an impact faster than the threshold, N s.
    wall_force_peak
        Mean over all contacts of the largest force in each, N; None where a stop is rigid, as a
        restitution does not know the force of an impact.
    wall_force_largest, wall_acceleration_largest
        Largest force on a stop, N, and largest acceleration that such a force gives the carrier,
        m/s^2: means over windows of `PEAK_PERIODS` periods. None where a stop is rigid. Each
        contact is taken for that of a free mass of the same impact speed.
    absorbed_share
        Share of the supplied power that impacts take; of compliant stops, the work of their
        contacts.
    response
        The simulation that these numbers come from.
    """

    level_db: float = stated("level", "dB", MISSING)
    ratio: Estimate = stated("ratio", "1", MISSING)
    displacement_std: Estimate = stated("rms with", "m", MISSING)
    displacement_std_without: float = stated("rms without", "m", MISSING)
    velocity_std: Estimate
    peak_factor: Estimate = stated("peak factor", "1", MISSING)
    peak_factor_without: Estimate = stated("peak factor without", "1", MISSING)
    acceleration_std: Estimate | None = stated("abs. acc. rms", "m/s^2", MISSING)
    acceleration_std_without: float | None = stated("abs. acc. rms without", "m/s^2", MISSING)
    impacts_per_period: Estimate = stated("impacts per period", "1", MISSING)
    wall_force: Estimate = stated("stop force", "N", MISSING)
    impulse: Estimate | None = stated("impulse", "N s", MISSING)
    wall_force_peak: Estimate | None = stated("peak force", "N", MISSING)
    wall_force_largest: Estimate | None = stated("largest", "N", MISSING)
    wall_acceleration_largest: Estimate | None = stated("largest", "m/s^2", MISSING)
    absorbed_share: Estimate | None = stated("absorbed", "1", MISSING)
    response: Response

    def interval(self) -> tuple[float, float]:
        """95 % interval of the ratio, its bias included."""
        half = self.ratio.half_width_95()
        return self.ratio.value - half, self.ratio.value + half


@dataclass(frozen=True, kw_only=True)
class PlayRatio:
    """The rms ratio that a box of another play would have under the excitation of the scene.

    `play_factor` is its play over that of the scene; `play` its play, m, None where the boxes of
    the scene differ or have one stop; `low` and `high` bound `ratio` with 95 % confidence.
    """

    play_factor: float
    play: float | None
    ratio: Estimate
    low: float
    high: float


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AbsorberReport(Result):
    """An absorber over levels of the excitation: one `Performance` each, and what it cost.

    `warnings` are those of the level nearest to the scene's own. `play_curve` holds the rms ratio
    against the play of the boxes, by rising play. It needs no simulation of its own. Where the play
    of the boxes is the only length, the motion scales with it: a level raised by 20 lg r decibels
    acts like a play r times smaller. It is empty where a load, or a stop whose stiffness depends on
    its deflection, brings another length. `tuned_damper` is the same mass on a tuned spring and
    dashpot, None where none is known (several coordinates under a sine).

    See Also
    --------
    stochvi.absorber : The calculation.
    """

    kind = "absorber"
    in_document: ClassVar = {"levels": "performances"}

    not_in_document = ("scene", "provenance")  # each response holds them

    scene: Scene
    carrier: str
    masses: Sequence[str]
    mass_ratio: float
    performances: Sequence[Performance]
    play_curve: Sequence[PlayRatio]
    tuned_damper: TunedDamper | None

    @property
    def central(self) -> Performance:
        """The performance at the level nearest to that of the scene."""
        return min(self.performances, key=lambda each: abs(each.level_db))

    def to_frame(self) -> DataFrame:
        """One row per level, SI units."""
        rows = []
        for each in self.performances:
            row: dict[str, Any] = {"level_db": each.level_db, "rms_ratio": each.ratio.value}
            row["rms_ratio_low"], row["rms_ratio_high"] = each.interval()
            for name, value in vars(each).items():
                if isinstance(value, Estimate) and name != "ratio":
                    row |= {name: value.value, f"{name}_error": value.standard_error}
                elif name not in (*row, "ratio", "response"):
                    row[name] = value
            rows.append(row)
        return frame_of(rows)

    def summary(self) -> str:
        """The effect of the absorber at the level of the scene, in a sentence."""
        central = self.central
        low, high = central.interval()
        surely_worse = central.ratio.value - (central.ratio.bias or 0.0) > (
            1.0 + SURE * central.ratio.standard_error
        )
        units, between = len(self.masses), f"{low:.3f} to {high:.3f} of that without"
        masses = "a mass" if units == 1 else f"{units} masses"
        mass = f"{masses} of {100.0 * self.mass_ratio:.3g} % of the structure"
        if surely_worse:
            makes = "makes" if units == 1 else "make"
            return f"{mass} {makes} it worse: rms displacement {between}"
        if high >= 1.0:
            return f"{mass} has no clear effect: rms displacement {between}"
        return (
            f"{mass}: rms displacement {central.ratio.value:.3f} of that without "
            f"(95 % interval {low:.3f} to {high:.3f})"
        )


SURE = 4.0
"""Number of standard errors by which a ratio must exceed 1 for the verdict that an absorber does
harm."""


@calculation
@sampled(rel_error=0.01)
def absorber(
    scene: Scene,
    *,
    levels_db: Sequence[float] = LEVELS_DB,
    **options: Unpack[AccuracyOptions],
) -> AbsorberReport:
    """Effect of an impact absorber on the structure that carries it, over levels of excitation.

    Motion with the absorber is simulated, with the same random numbers at every level. Motion
    without it is exact, from the linear response. Under white noise on the structure and R = 1
    nothing changes: theta = S0 / (2 c) is shared, E x^2 = theta / k (B section 17).

    Parameters
    ----------
    scene
        With an `absorber`: its masses, and at least one impact pair that they take part in. The
        carrier is the first coordinate that is not one of them.
    levels_db
        Levels of all that shakes, dB about the scene's own; constant loads stay.
    **options
        `AccuracyOptions`: `rel_error` is that of the simulated mean squares and rates, by default
        0.01, as for `simulate`; the levels still to come share the time that is left evenly.

    Returns
    -------
    AbsorberReport
        With and without the absorber, at each level.

    Raises
    ------
    NotApplicable
        If the scene names no absorber, or `simulate` does not cover it.
    NotConverged
        If the budget ends first, or `Interrupted` after Ctrl-C: it carries the levels that were
        simulated, with the errors they got to, and names those that were not.

    See Also
    --------
    stochvi.absorbers.design_absorber : The best box for a mass.

    Examples
    --------
    >>> from stochvi.scenes.absorbers import Absorber
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
    ...     absorber=Absorber(mass=0.1, play=3.0, law=Restitution(coefficient=0.5)),
    ...     excitations=[WhiteNoise(intensity=0.04)],
    ... )
    >>> helped = absorber(scene, levels_db=[0.0], rel_error=0.1).performances[0]
    >>> 0.35 < helped.ratio.value < 0.55
    True
    """
    if scene.absorber is None:
        raise NotApplicable(
            "absorber",
            "the scene must have an [absorber] with mass (kg), play (m, stop to stop) and law, "
            "or mass_on; a mass budget (--mass-budget) finds the best one",
        )
    if len(levels_db) == 0 or not all(math.isfinite(level) for level in levels_db):
        raise ValueError(f"levels_db must be at least one finite number, got {list(levels_db)}")
    if without_absorber(scene).impact_pairs:
        raise NotApplicable("absorber", NO_STOPS)
    full = scene.expanded
    masses = scene.absorber_coordinates
    carrier = next(name for name in full.structure.coordinates if name not in masses)
    found: list[Performance] = []
    short: list[float] = []
    recording = 0.0  # seconds that the peaks of a level take
    compile_kernels(full)
    run = Run.of(options)
    deadline = run.deadline
    for number, level in enumerate(levels_db):
        if deadline.passed():
            break
        shaken = scene.at_level(level)
        to_come = len(levels_db) - number
        end = (number + 1) / len(levels_db)
        until = deadline.sooner_by(to_come * recording).share(1.0 / to_come)
        part = run.part(number / len(levels_db), end, deadline=until)
        try:
            response = simulate(shaken.expanded, **part.options(rel_error=run.rel_error))
        except (NotConverged, Interrupted) as reason:
            if reason.partial is None:
                break
            response = reason.partial
            short.append(level)
        run.tell(end, "peaks of recorded paths")
        began = time.perf_counter()
        found.append(_performance(shaken, carrier, level, response, run))
        recording = time.perf_counter() - began
    missing = [level for level in levels_db if level not in {each.level_db for each in found}]
    unreached = _in_decibels(short), _in_decibels(missing)
    if not found:
        raise deadline.fell_short("before any level was simulated", "raise budget")
    mass = np.diag(full.structure.matrices[0])
    light = np.array([name in masses for name in full.structure.coordinates])
    alone = without_absorber(scene)
    answer = AbsorberReport(
        scene=scene,
        carrier=carrier,
        masses=masses,
        mass_ratio=float(mass[light].sum() / mass[~light].sum()),
        performances=found,
        play_curve=_play_curve(model_of(scene), found),
        tuned_damper=tuned_damper(alone, own_name(alone, carrier), float(mass[light].sum())),
        warnings=[
            *([f"levels that were not simulated: {unreached[1]}"] if missing else []),
            *(
                [f"levels with a relative error above {run.rel_error:g}: {unreached[0]}"]
                if short
                else []
            ),
            *min(found, key=lambda each: abs(each.level_db)).response.warnings,
            *scene.at_means(),
        ],
        cost=total_cost(each.response.cost for each in found),
        provenance=provenance(scene.document(), run.seed),
    )
    if missing or short:
        where = (
            f"before the relative error at {_in_decibels([*short, *missing])} was {run.rel_error:g}"
        )
        raise deadline.fell_short(where, "raise budget or rel_error", answer)
    return answer


def _in_decibels(levels: Sequence[float]) -> str:
    return ", ".join(f"{level:+g} dB" for level in levels)


def without_absorber(scene: Scene) -> Scene:
    """The structure alone: without the absorber's masses, springs, dampers and impact pairs.

    Raises
    ------
    NotApplicable
        If nothing shakes what is left.
    """
    if not isinstance(scene.structure, Matrices):
        _require_shaking(scene.excitations)
        return scene.model_copy(update={"absorber": None})
    gone = set(scene.absorber_coordinates)
    kept = [n for n, name in enumerate(scene.structure.coordinates) if name not in gone]
    lost = [n for n, name in enumerate(scene.structure.coordinates) if name in gone]

    def alone(matrix: np.ndarray) -> np.ndarray:
        # a spring to a lost mass stands on the diagonal too
        return matrix[np.ix_(kept, kept)] + np.diag(matrix[np.ix_(kept, lost)].sum(axis=1))

    mass, damping, stiffness = scene.structure.matrices
    structure = Matrices(
        coordinates=tuple(scene.structure.coordinates[n] for n in kept),
        mass=mass[np.ix_(kept, kept)],
        damping=alone(damping),
        stiffness=alone(stiffness),
    )
    excitations = [
        each for each in scene.excitations
        if gone.isdisjoint(each.between or (scene.place(each),))
    ]  # fmt: skip
    _require_shaking(excitations)
    pairs = [pair for pair in scene.impact_pairs if not gone & {pair.on, *(pair.between or ())}]
    return Scene(
        title=scene.title, structure=structure, excitations=excitations, impact_pairs=pairs
    )


def _require_shaking(excitations: Sequence[Excitation]) -> None:
    if not any(each.shakes for each in excitations):
        raise NotApplicable(
            "absorber",
            "excitation must shake the structure that carries the absorber, got constant loads "
            "alone; add noise",
        )


def linear_rms(scene: Scene) -> tuple[dict[str, float], dict[str, float]]:
    """rms displacement (about the mean) and velocity of every coordinate without stops, exactly.

    From the Lyapunov equation for white and filtered noise, frequency integrals of tables, and
    the amplitudes of sines.
    """
    model = model_of(scene)
    modes = model.modal
    law = linear_law(modes)
    if law is None:
        raise NotApplicable("absorber", UNSTEADY)
    displacement, velocity = (
        {
            name: math.sqrt(law.variances(modes.shapes[row], first))
            for row, name in enumerate(model.coordinates)
        }
        for first in (0, modes.size)
    )
    return displacement, velocity


def _performance(
    scene: Scene, carrier: str, level: float, response: Response, run: Run
) -> Performance:
    alone = without_absorber(scene)
    name = own_name(alone, carrier)
    rms, speed = (group[name] for group in linear_rms(alone))
    moving = response.coordinates[carrier]
    deviation, velocity = moving.displacement_std, moving.velocity_std
    assert deviation is not None and velocity is not None
    period = 2.0 * math.pi * rms / speed
    with_it = _windows(scene.expanded, carrier, period, run)
    without = _windows(alone, name, period, run)
    model = model_of(scene)
    pairs = [response.impact_pairs[pair.name] for pair in model.pairs]
    rate = correlated_total([_known(pair.collision_rate) for pair in pairs])
    own_period = 2.0 * math.pi * deviation.value / velocity.value
    pushes = correlated_total(
        [
            push
            for pair, found in zip(model.pairs, pairs, strict=True)
            for push in _pushes(pair, found)
        ]
    )
    return Performance(
        level_db=level,
        ratio=deviation * (1.0 / rms),
        displacement_std=deviation,
        displacement_std_without=rms,
        velocity_std=velocity,
        peak_factor=with_it.peak * (1.0 / deviation.value),
        peak_factor_without=without.peak * (1.0 / rms),
        acceleration_std=with_it.acceleration,
        acceleration_std_without=None
        if without.acceleration is None
        else without.acceleration.value,
        impacts_per_period=rate * own_period,
        wall_force=pushes,
        impulse=pushes * (1.0 / rate.value) if rate.value > 0.0 else None,
        wall_force_peak=_mean_peak(pairs),
        wall_force_largest=with_it.wall_force,
        wall_acceleration_largest=with_it.wall_acceleration,
        absorbed_share=_absorbed(model, response),
        response=response,
    )


def own_name(alone: Scene, carrier: str) -> str:
    """The name that the carrier has in the structure alone: an absorber of mass, play and law gives
    the coordinate of its oscillator another one."""
    names = alone.structure.coordinates
    return carrier if carrier in names else names[0]


def _play_curve(model: Model, found: Sequence[Performance]) -> list[PlayRatio]:
    """The rms ratio against play, from the levels; empty where the motion does not scale."""
    stops = [stop for pair in model.pairs for stop in pair.stops]
    if np.any(model.constant_force) or not all(map(_scales, stops)):
        return []
    plays = {pair.play for pair in model.pairs}
    play = plays.pop() if len(plays) == 1 else None
    curve = []
    for each in sorted(found, key=lambda each: -each.level_db):
        factor = 10.0 ** (-each.level_db / 20.0)
        low, high = each.interval()
        curve.append(
            PlayRatio(
                play_factor=factor, play=None if play is None else factor * play,
                ratio=each.ratio, low=low, high=high,
            )
        )  # fmt: skip
    return curve


def _scales(stop: Stop) -> bool:
    """Whether the law of a stop is the same for a motion of any size."""
    if isinstance(stop.law, CompliantLaw):
        return stop.law.scaled(2.0, 1.0) == stop.law
    return stop.coefficient is not None


@dataclass(frozen=True)
class _Windows:
    """Peaks from recorded paths: the carrier's displacement, its absolute acceleration, and the
    largest forces of compliant stops with the accelerations that these give the carrier."""

    peak: Estimate
    acceleration: Estimate | None
    wall_force: Estimate | None
    wall_acceleration: Estimate | None


class Peaks(NamedTuple):
    """Numbers from one recorded path: means over its windows of the largest displacement, mean
    square of the absolute acceleration, and forces and accelerations of `_wall_peaks`."""

    displacement: float
    square: float
    walls: Vector | None


@dataclass(frozen=True, eq=False)
class PeakSampler(ListSampler):
    """Peaks of a carrier on recorded paths of `duration` seconds."""

    scene: Scene
    carrier: str
    duration: float
    seed: int

    @property
    def block(self) -> int:
        """Number of paths that are recorded together."""
        return RECORDED_TOGETHER

    @property
    def soft(self) -> bool:
        """Whether there are stops, and all are compliant."""
        pairs = model_of(self.scene).pairs
        return bool(pairs) and all(not stop.rigid for pair in pairs for stop in pair.stops)

    def simulate(self, first_path: int, paths: int) -> list[Peaks]:
        """The peaks of some paths."""
        settling, records = record_paths(
            self.scene, duration=self.duration, paths=paths, seed=self.seed, first_path=first_path
        )
        return [self._of(record[record["time"] > settling]) for record in records]

    def _of(self, settled: DataFrame) -> Peaks:
        model = model_of(self.scene)
        x = settled[f"displacement of {self.carrier}"].to_numpy()
        parts = np.array_split(np.abs(x - x.mean()), WINDOWS_OF_PATH)
        return Peaks(
            displacement=float(np.mean([part.max() for part in parts])),
            square=float(np.mean(_absolute_acceleration(self.scene, self.carrier, settled) ** 2)),
            walls=_wall_peaks(model, model.coordinates.index(self.carrier), settled)
            if self.soft
            else None,
        )

    def add_up(self, pieces: list[list[Peaks]]) -> list[Peaks]:
        """The peaks of a block."""
        return [each for piece in pieces for each in piece]

    def paths(self, sample: list[Peaks]) -> int:
        """Number of paths."""
        return len(sample)


def _windows(scene: Scene, carrier: str, period: float, run: Run) -> _Windows:
    """Record paths until `PEAK_WINDOWS` windows have been seen, or the deadline has passed; errors
    from the paths, of which there are two at least."""
    sampler = PeakSampler(scene, carrier, WINDOWS_OF_PATH * PEAK_PERIODS * period, run.seed)
    silent = replace(run, progress=None)
    peaks: list[Peaks] = silent.until(sampler, PEAK_WINDOWS // WINDOWS_OF_PATH).sample
    how = f"{WINDOWS_OF_PATH * len(peaks)} windows of {PEAK_PERIODS} periods on {len(peaks)} paths"
    walls = [each.walls for each in peaks if each.walls is not None]

    def estimate(values: list[float], power: float = 1.0) -> Estimate:
        mean, error = mean_and_error(np.array(values))
        relative = student_factor(len(values)) * abs(power) * error / mean if mean else 0.0
        value = mean**power
        return Estimate(value=value, standard_error=value * relative, how=how)

    return _Windows(
        peak=estimate([each.displacement for each in peaks]),
        acceleration=estimate([each.square for each in peaks], 0.5)
        if _shaken_by_base(scene)
        else None,
        wall_force=estimate([force for force, _ in walls]) if walls else None,
        wall_acceleration=estimate([pushed for _, pushed in walls]) if walls else None,
    )


def _wall_peaks(model: Model, row: int, record: DataFrame) -> Vector:
    """Largest force on a stop (N), and largest acceleration (m/s^2) that such a force gives a
    coordinate: means over the windows of a path (2,)."""
    largest = np.zeros((2, WINDOWS_OF_PATH))
    for pair in model.pairs:
        moved = abs(float(np.linalg.solve(model.mass, pair.direction)[row]))
        speeds = record[f"impact_speed of {pair.name}"].to_numpy()
        for stop in pair.stops:
            assert isinstance(stop.law, CompliantLaw)
            for number, window in enumerate(np.array_split(stop.side * speeds, WINDOWS_OF_PATH)):
                speed = float(window.max())
                # the force of a contact grows with its impact speed
                force = stop.law.impact(speed, pair.mass).peak_force if speed > 0.0 else 0.0
                largest[:, number] = np.maximum(largest[:, number], (force, moved * force))
    return np.asarray(largest.mean(axis=1))


def _shaken_by_base(scene: Scene) -> bool:
    shaking = [each for each in scene.excitations if each.shakes]
    return all(scene.place(each) == BASE for each in shaking)


def _absolute_acceleration(scene: Scene, carrier: str, record: DataFrame) -> np.ndarray:
    """-(K x + C v) / m of the carrier, m/s^2: what springs and dampers do to it."""
    mass, damping, stiffness = scene.structure.matrices
    row = scene.structure.coordinates.index(carrier)
    x, v = (
        record[[f"{what} of {name}" for name in scene.structure.coordinates]].to_numpy()
        for what in ("displacement", "velocity")
    )
    # a single row, or the rows of a mass matrix that is not diagonal
    pushed = -np.linalg.solve(mass, stiffness @ x.T + damping @ v.T)
    return np.asarray(pushed[row])


def _absorbed(model: Model, response: Response) -> Estimate | None:
    """Share of the supplied power that impacts take: loss / (loss + dissipation by dampers).

    The dampers between coordinates i and j take -C_ij E (v_i - v_j)^2; None where that is not
    known.
    """
    loss = correlated_total([*response.stop_powers.values()])
    damping = model.damping
    dissipation = [
        _square(_known(response.coordinates[name].velocity_std)) * float(own)
        for name, own in zip(model.coordinates, damping.sum(axis=1), strict=True)
    ]
    for i, j in zip(*np.triu_indices(len(damping), 1), strict=True):
        if damping[i, j]:
            between = [
                pair.name
                for pair in model.pairs
                if abs(pair.direction[i] * pair.direction[j]) == 1.0
            ]
            if not between:
                return None
            speed = response.impact_pairs[between[0]].relative_velocity_std
            dissipation.append(_square(_known(speed)) * -float(damping[i, j]))
    damped = correlated_total(dissipation)
    supplied = loss.value + damped.value
    share = loss.value / supplied
    slopes = [(1.0 - share) / supplied, share / supplied]
    return combined(share, slopes, [loss, damped], how=loss.how)


def _mean_peak(found: Sequence[PairResponse]) -> Estimate | None:
    """Mean over the contacts of all pairs of the largest force in each, N; None for rigid stops."""
    peaks = [each.peak_force for each in found]
    rates = [_known(each.collision_rate).value for each in found]
    if any(peak is None for peak in peaks) or not sum(rates):
        return None
    shares = (rate / sum(rates) for rate in rates)
    return correlated_total(
        [_known(peak) * share for peak, share in zip(peaks, shares, strict=True)]
    )


def _pushes(pair: Pair, found: PairResponse) -> list[Estimate]:
    """Mean forces on the stops of a box, N: those of contacts, or by impulses on rigid stops."""
    if pair.rigid:
        return [_known(found.impact_speed_rate) * (pair.mass * (1.0 + _restitution(pair)))]
    forces = {"lower": found.contact_force_lower, "upper": found.contact_force_upper}
    return [_known(forces[stop.name]) for stop in pair.stops]


def _restitution(pair: Pair) -> float:
    """Restitution of the stops of a box, which have one law."""
    (coefficient,) = {stop.law.restitution for stop in pair.stops}
    return coefficient


def _known(estimate: Estimate | None) -> Estimate:
    """A quantity that the simulation of a scene with an absorber always has."""
    assert estimate is not None
    return estimate


def _square(estimate: Estimate) -> Estimate:
    return replace(estimate * (2.0 * estimate.value), value=estimate.value**2)
