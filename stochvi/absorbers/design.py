"""Design of impact absorbers. Chapters: the best box for a mass budget, by simulation; a loose mass
under a sine, with its exact regimes; residual vibration under a sine over frequency, play and mass.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Unpack

import numpy as np
import scipy
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import ArrayLike, NDArray

from stochvi.absorbers.performance import (
    NO_STOPS,
    TunedDamper,
    linear_rms,
    own_name,
    tuned_damper,
    without_absorber,
)
from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.units import LENGTH, ShownQuantity, readable
from stochvi.methods.monte_carlo import compile_kernels, simulate
from stochvi.methods.periodic import HarmonicResponse, harmonic_response
from stochvi.methods.periodic.continuation import even_regimes
from stochvi.methods.periodic.family import Family, Numbers, forced, parts_of
from stochvi.model.coverage import functions
from stochvi.model.model import Model, model_of
from stochvi.results.base import DataFrame, Result, frame_of, stacked, total_cost
from stochvi.results.deadline import Deadline, partial_result
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import GAUSSIAN_95, Cost, Estimate, provenance
from stochvi.sampling.calculations import AccuracyOptions, calculation
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.absorbers import Absorber
from stochvi.scenes.excitations import BASE, ConstantLoad, Sine
from stochvi.scenes.impact_laws import Restitution
from stochvi.scenes.keys import KEY_UNITS, changed_scene
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Isolator, Matrices, Oscillator

PLAYS = tuple(float(play) for play in np.geomspace(0.75, 14.0, 10))
"""Total plays of the first search, in rms displacements of the structure alone."""

CLOSER = (0.7, 0.82, 0.93, 1.07, 1.22, 1.43)
"""Plays of the second search, relative to the best of the first."""

COARSE = 2.0
"""Relative error of the first search, as a multiple of that of the second."""

DRAWS = 400
"""Number of curves sampled within the errors of the points to find the error of the best play."""

GRID = 801
"""Number of plays at which a curve is searched for its lowest point."""

FEWEST_POINTS = 4
"""Number of simulated plays below which a candidate has no curve."""

DECIBELS = 20.0 / math.log(10.0)
"""Decibels of a unit of the logarithm of a play."""

DEGREE = 6
"""Largest degree of the polynomial in log play that a curve is smoothed by."""


@dataclass(frozen=True, kw_only=True)
class BestBox:
    """The lowest point of a curve of rms ratio against play.

    `play` (m), its 95 % interval, and the ratio there; `low` and `high` bound the plays whose
    ratio lies within two standard errors of the lowest: the box need not be built more
    exactly.
    """

    play: float
    play_low: float
    play_high: float
    ratio: Estimate
    low: float
    high: float


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Design(Result):
    """The best box for a mass budget (SI units).

    Parameters
    ----------
    restitution, units
        Restitution of the stops and number of units of the best candidate.
    best
        Best box of that candidate at the level of the scene.
    robust
        Box of that candidate with the lowest worst ratio over `level_range_db` about that level.
    curve
        Every simulated point: restitution, units, play, play_in_sigma, rms_ratio, its error.
    candidates
        The best play and ratio of each restitution and number of units: first the best one, after
        the second search, then the others after the first one, whose errors are larger.
    tuned_damper
        The same mass on a tuned spring and dashpot, to compare with.

    See Also
    --------
    stochvi.absorbers.design_absorber : The calculation.
    """

    kind = "absorber design"

    not_in_document = ("provenance",)

    scene: Scene
    mass: float
    sigma: float
    restitution: float
    units: int
    best: BestBox
    robust: BestBox
    level_range_db: float
    curve: DataFrame
    candidates: DataFrame
    tuned_damper: TunedDamper | None

    def to_frame(self) -> DataFrame:
        """One row per candidate, the best one first."""
        return self.candidates

    def summary(self) -> str:
        """The best candidate, in a sentence."""
        units = "one unit" if self.units == 1 else f"{self.units} units"
        return (
            f"{units}, restitution {self.restitution:g}, total play {LENGTH.text(self.best.play)}: "
            f"rms displacement {100.0 * self.best.ratio.value:.1f} % of that without absorber"
        )


@calculation
@sampled(rel_error=0.01)
def design_absorber(
    structure: Scene,
    *,
    mass_budget: float,
    restitutions: Sequence[float] = (0.3, 0.5, 0.7),
    units: Sequence[int] = (1,),
    plays: Sequence[float] = PLAYS,
    level_range_db: float = 6.0,
    **options: Unpack[AccuracyOptions],
) -> Design:
    """Find the box, restitution and number of units that calm a structure most, for one mass.

    The rms ratio of each candidate is simulated at plays from 0.75 to 14 rms displacements with the
    same random numbers. A second, closer search is made for the best candidate. A polynomial in log
    play through the points gives the best play; its interval comes from curves drawn within their
    errors. The system is homogeneous: a level raised by 20 log10 r acts like a play that is r times
    smaller, so that one curve holds all levels.

    Parameters
    ----------
    structure
        An oscillator or isolator of known mass without stops or loads, and what shakes it; an
        absorber that it has already is taken off.
    mass_budget
        Mass of all units together, kg.
    restitutions, units
        Restitutions of the stops and numbers of units from which the best are chosen.
    plays
        Total plays of the first look, in rms displacements of the structure alone; at least 4.
    level_range_db
        Range of levels for the robust box, dB below and above that of the scene: over this range
        its worst ratio is the lowest.
    **options
        `AccuracyOptions`: `rel_error` is that of the points close to the best one, by default 0.01;
        all points share the `budget` in proportion to the accuracy that is asked for there.

    Returns
    -------
    Design
        The best box, and all boxes that were tried.

    Raises
    ------
    NotApplicable
        If the structure is not of that kind.
    NotConverged
        If the budget ends first, or `Interrupted` after Ctrl-C: it carries the best box of the
        points with the errors that they got to.

    See Also
    --------
    stochvi.absorber : What given boxes do.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> shaken = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.04)],
    ... )
    >>> found = design_absorber(
    ...     shaken, mass_budget=0.1, restitutions=[0.5], plays=[1, 2, 4, 8], rel_error=0.3
    ... )
    >>> 1.5 < found.best.play < 5.0 and found.best.ratio.value < 0.55
    True
    """
    structure = alone(structure)
    sigma = _check(structure, mass_budget, restitutions, units, plays, level_range_db)
    pairs = [(r, n) for r in restitutions for n in units]
    compile_kernels(with_absorber(structure, mass_budget, sigma, restitutions[0], units[0]))
    run = Run.of(options)
    search = _Search(structure, mass_budget, sigma, run)
    search.left = len(pairs) * len(plays) * COARSE**-2 + len(CLOSER)
    search.all = search.left
    for restitution, count in pairs:
        for play in _spread(sorted(plays)):
            search.look(restitution, count, play, COARSE)
    known = [pair for pair in pairs if len(_points(search.rows, *pair).T) >= FEWEST_POINTS]
    if not known:
        raise run.deadline.fell_short(
            f"after {len(search.rows)} of {len(pairs) * len(plays)} plays, too few for a curve",
            "raise budget",
        )
    firsts = [_best_box(_points(search.rows, *pair), sigma, 0.0, run.seed) for pair in known]
    winner = min(range(len(known)), key=lambda k: firsts[k].ratio.value)
    for factor in CLOSER:
        search.look(*known[winner], factor * firsts[winner].play / sigma, 1.0)
    points_of_winner = _points(search.rows, *known[winner])
    best = _best_box(points_of_winner, sigma, 0.0, run.seed)
    # points that are missing may leave no room for the whole range of levels
    reach = min(level_range_db, 0.49 * DECIBELS * float(np.ptp(points_of_winner[0])))
    robust = _best_box(points_of_winner, sigma, reach, run.seed)
    candidates = frame_of(
            {
                "restitution": restitution,
                "units": count,
                "play": box.play,
                "play_in_sigma": box.play / sigma,
                "rms_ratio": box.ratio.value,
                "rms_ratio_error": box.ratio.standard_error,
            }
            for (restitution, count), box in zip(
                known, [best if k == winner else first for k, first in enumerate(firsts)],
                strict=True,
            )
    )  # fmt: skip
    others = candidates.drop(index=winner).sort_values("rms_ratio")
    candidates = stacked([candidates.iloc[[winner]], others])
    restitution, count = known[winner]
    answer = Design(
        scene=with_absorber(structure, mass_budget, best.play, restitution, count),
        mass=mass_budget,
        sigma=sigma,
        restitution=restitution,
        units=count,
        best=best,
        robust=robust,
        level_range_db=reach,
        curve=frame_of(search.rows),
        candidates=candidates,
        tuned_damper=tuned_damper(structure, "x", mass_budget),
        cost=total_cost(search.costs),
        provenance=provenance(structure.document(), run.seed),
        warnings=[f"plays that were not simulated as accurately as asked for: {search.short}"]
        if search.short
        else [],
    )
    if search.short:
        where = f"before {search.short} plays reached the accuracy that is asked for there"
        raise run.deadline.fell_short(where, "raise budget or rel_error", answer)
    return answer


def _spread(plays: Sequence[float]) -> list[float]:
    """Every second play, then those between, so that the whole range has been looked at when time
    ends early."""
    return [*plays[::2], *plays[1::2]]


@dataclass
class _Search:
    """Points of the curves of all candidates, simulated within a deadline.

    `left` is the work still to be done and `all` the whole work, in points of full accuracy;
    `short` counts the points that are missing, or not as accurate as they should be.
    """

    structure: Scene
    mass: float
    sigma: float
    run: Run
    left: float = 0.0
    all: float = 0.0
    short: int = 0
    rows: list[dict[str, float]] = field(default_factory=list)
    costs: list[Cost] = field(default_factory=list)

    def look(self, restitution: float, count: int, play: float, coarse: float) -> None:
        """Simulate a play (in sigma) to `coarse` times the error, in its share of the time."""
        work = coarse**-2
        share, self.left = work / self.left, self.left - work
        if self.run.deadline.passed():
            self.short += 1
            return
        scene = with_absorber(self.structure, self.mass, play * self.sigma, restitution, count)
        try:
            response = simulate(
                scene,
                **self.run.options(
                    self.run.deadline.share(share), rel_error=coarse * self.run.accuracy,
                    progress=None,
                ),
            )  # fmt: skip
        except (NotConverged, Interrupted) as reason:
            self.short += 1
            if reason.partial is None:
                return
            response = reason.partial
        deviation = response.coordinates["structure"]["displacement_std"]
        assert deviation is not None
        error = math.hypot(deviation.standard_error, deviation.bias or 0.0)
        if not 0.0 < error < math.inf:
            return
        self.rows.append(
            {
                "restitution": restitution,
                "units": count,
                "play": play * self.sigma,
                "play_in_sigma": play,
                "rms_ratio": deviation.value / self.sigma,
                "rms_ratio_error": error / self.sigma,
            }
        )
        self.costs.append(response.cost)
        done = 1.0 - self.left / self.all
        self.run.tell(done, f"play {play:.2f} sigma, R = {restitution:g}")


def with_absorber(
    structure: Scene, mass: float, play: float, restitution: float, units: int = 1
) -> Scene:
    """The scene with loose masses (kg, all together) in boxes of a total play, m."""
    loose = Absorber(mass=mass, play=play, units=units, law=Restitution(coefficient=restitution))
    return Scene(
        title=structure.title,
        structure=structure.structure,
        excitations=structure.excitations,
        absorber=loose,
    )


def alone(scene: Scene) -> Scene:
    """The oscillator or isolator that carries an absorber, without it; other scenes as they are."""
    if scene.absorber is None:
        return scene
    bare = without_absorber(scene)
    if not isinstance(bare.structure, Matrices) or len(bare.structure.coordinates) > 1:
        return bare
    mass, damping, stiffness = (float(matrix[0, 0]) for matrix in bare.structure.matrices)
    moving = any(bare.place(each) == BASE for each in bare.excitations)
    kind = Isolator if moving else Oscillator
    (carrier,) = bare.structure.coordinates
    return Scene(
        title=scene.title,
        structure=kind(mass=mass, damping=damping, stiffness=stiffness),
        impact_pairs=bare.impact_pairs,
        excitations=[
            each.model_copy(update={"on": "x"}) if bare.place(each) == carrier else each
            for each in bare.excitations
        ],
    )


def _check(
    structure: Scene,
    mass_budget: float,
    restitutions: Sequence[float],
    units: Sequence[int],
    plays: Sequence[float],
    level_range_db: float,
) -> float:
    """rms displacement of the structure alone, m."""
    if not 0.0 < mass_budget < math.inf:
        raise ValueError(f"mass_budget must be a positive mass in kg, got {mass_budget:g}")
    unmet = []
    if not isinstance(structure.structure, Oscillator | Isolator):
        unmet.append(
            "the structure that carries the box must be one oscillator or isolator, got "
            f"{structure.structure.kind!r} with {', '.join(structure.structure.coordinates)}"
        )
    elif structure.structure.mass is None:
        unmet.append("structure.mass must be given, to compare with, got none")
    if structure.impact_pairs:
        unmet.append(NO_STOPS)
    if any(isinstance(each, ConstantLoad) for each in structure.excitations):
        unmet.append("a constant load would press the mass onto its stop")
    if unmet:
        raise NotApplicable("absorber design", unmet)
    if not restitutions or not units:
        raise ValueError("restitutions and units must name at least one value each")
    if len(set(plays)) < 4 or not all(0.0 < play < math.inf for play in plays):
        raise ValueError(f"plays must be at least 4 different positive numbers, got {list(plays)}")
    span = 20.0 * math.log10(max(plays) / min(plays))
    if not 0.0 <= 2.0 * level_range_db < span:
        raise ValueError(
            f"level_range_db must be at least 0 and below {span / 2.0:.3g}, half the range of the "
            f"plays in dB, got {level_range_db:g}"
        )
    rms, _ = linear_rms(structure)
    return rms["x"]


def _points(rows: Sequence[dict[str, float]], restitution: float, units: int) -> Vector:
    """(log play in sigma, ratio, error) of a candidate, by play."""
    own = [
        (math.log(row["play_in_sigma"]), row["rms_ratio"], row["rms_ratio_error"])
        for row in rows
        if row["restitution"] == restitution and row["units"] == units
    ]
    return np.array(sorted(own)).T


def _best_box(points: Vector, sigma: float, range_db: float, seed: int) -> BestBox:
    """Lowest point of the smoothed curve, or of its largest value within a range of levels."""
    at, ratios, errors = points
    reach = range_db / 20.0 * math.log(10.0)
    grid = np.linspace(at[0], at[-1], GRID)
    inner = grid[(grid >= at[0] + reach) & (grid <= at[-1] - reach)]
    curves = _smoothed(at, ratios, errors, grid, np.random.default_rng(seed))
    # the range of levels, as a number of neighbours on the grid
    width = round(reach / (grid[1] - grid[0]))
    curves = scipy.ndimage.maximum_filter1d(curves, 2 * width + 1, axis=1)[
        :, np.searchsorted(grid, inner)
    ]
    found, drawn = curves[0], curves[1:]
    lowest = int(np.argmin(found))
    places = inner[np.argmin(drawn, axis=1)]
    error = float(drawn[:, lowest].std(ddof=1))
    half = GAUSSIAN_95 * float(np.std(places, ddof=1))
    flat = inner[found <= found[lowest] + 2.0 * error]
    return BestBox(
        play=sigma * math.exp(inner[lowest]),
        play_low=sigma * math.exp(inner[lowest] - half),
        play_high=sigma * math.exp(inner[lowest] + half),
        ratio=Estimate(
            value=float(found[lowest]), standard_error=error, how=f"curve through {len(at)} points"
        ),
        low=sigma * math.exp(flat[0]),
        high=sigma * math.exp(flat[-1]),
    )


def _smoothed(
    at: Vector, values: Vector, errors: Vector, grid: Vector, random: np.random.Generator
) -> Vector:
    """A polynomial through values, by weighted least squares, on a grid. The rows below it are
    polynomials whose coefficients are drawn with their errors, which follow from those of the
    values.

    The degree is the lowest whose residuals are as small as the errors make them (chi^2 below its
    expectation plus two deviations), at most `DEGREE`.
    """
    # half a second to import, which only a design costs
    from statsmodels.regression.linear_model import WLS

    centre, half = (at[0] + at[-1]) / 2.0, (at[-1] - at[0]) / 2.0
    for degree in range(2, min(DEGREE, len(at) - 2) + 1):
        fit = WLS(values, chebvander((at - centre) / half, degree), errors**-2.0).fit()
        if fit.ssr <= fit.df_resid + 2.0 * math.sqrt(2.0 * fit.df_resid):
            break
    # errors are known, so that residuals do not scale the covariance
    drawn = random.multivariate_normal(fit.params, fit.normalized_cov_params, DRAWS)
    return np.asarray(np.vstack([fit.params, drawn]) @ chebvander((grid - centre) / half, degree).T)


# ------------------------------------------------------------------------------
# A loose mass under a sine: the force that it cancels, the residual vibration, exact regimes.
# ------------------------------------------------------------------------------


UPPER_LOWER = (0, 1)
"""Numbers of the stops that are hit in a period, in their order: the upper one, then the lower
one."""

LAWS = {"book": 4.0 / math.pi, "flight": 8.0 / math.pi**2}
"""First harmonic of the relative motion over half the play: of a square wave, as the harmonic
linearisation by force has it (B 7.85, 17.17), and of straight flights from stop to stop."""


@dataclass(frozen=True, kw_only=True)
class SymmetricRegime:
    """One impact on each stop per period, half a period apart (SI units).

    Parameters
    ----------
    absorber_speed
        Speed of the loose mass between impacts, m/s.
    impact_speed
        Relative speed before an impact, m/s.
    amplitude
        Amplitude of the first harmonic of the structure's displacement, m.
    amplitude_without
        The same without the absorber, m.
    phase
        Phase of the force at the impact on the upper stop, where it is a cos(phase), rad.
    stable
        Whether small perturbations die out.

    See Also
    --------
    stochvi.absorbers.symmetric_regimes : What finds it.
    """

    absorber_speed: float
    impact_speed: float
    amplitude: float
    amplitude_without: float
    phase: float
    stable: bool


@calculation
def tuned_force(mass: float, play: float, omega: float, law: str = "flight") -> float:
    """Amplitude of the sine force (N) whose first harmonic an elastic loose mass cancels.

    The absorber is tuned where its partial frequency is that of the excitation, k(a_F) = M2 w^2
    (B 17.11); with k = a_F / a_x and the structure at rest a_F = a_p, so that a_p = M2 w^2 a_x.

    Parameters
    ----------
    mass, play, omega
        M2 in kg; 2 Delta, stop to stop, in m; w in rad/s.
    law
        "flight": a_x = 8 Delta / pi^2, of straight flights. "book": a_x = 4 Delta / pi (B 17.17).

    Returns
    -------
    float
        Amplitude of the force, N.

    Raises
    ------
    ValueError
        If a number is not positive, or there is no such law.

    See Also
    --------
    stochvi.absorbers.residual_vibration : The residual vibration.
    stochvi.absorbers.symmetric_regimes : The exact regimes.

    Examples
    --------
    >>> round(tuned_force(0.1, 2.0, 1.0), 5), round(tuned_force(0.1, 2.0, 1.0, "book"), 5)
    (0.08106, 0.12732)
    """
    _check_positive(mass=mass, omega=omega)
    return mass * omega**2 * _relative_amplitude(play, law)


@calculation
def residual_vibration(play: float, restitution: float, law: str = "flight") -> float:
    """Amplitude (m) of a structure in resonance under `tuned_force`, with a light loose mass.

    As printed, a_x1 = beta a_x / (M2 w) (B 17.12), with beta = p M2 w and p = (1 - R^2) / pi for
    two stops (B 7.62): a_x1 = p a_x (B 17.13). In straight flights of speed u = 2 w Delta / pi the
    stop must return the lost speed. It moves at u (1 - R) / (1 + R) against the mass: a_x1 = (2
    Delta / pi) (1 - R) / (1 + R).

    Parameters
    ----------
    play
        2 Delta, stop to stop, m.
    restitution
        R of both stops; at 1 nothing is left.
    law
        "flight" or "book", as for `tuned_force`.

    Returns
    -------
    float
        Amplitude of the displacement, m.

    Raises
    ------
    ValueError
        If play is not positive, restitution not in [0, 1], or there is no such law.

    See Also
    --------
    stochvi.absorbers.tuned_force : The force that is cancelled.
    stochvi.absorbers.symmetric_regimes : The exact regimes.

    Examples
    --------
    >>> round(residual_vibration(2.0, 0.8), 5), round(residual_vibration(2.0, 0.8, "book"), 5)
    (0.07074, 0.1459)
    """
    _check_restitution(restitution)
    amplitude = _relative_amplitude(play, law)
    if law == "book":
        return (1.0 - restitution**2) / math.pi * amplitude
    return play / math.pi * (1.0 - restitution) / (1.0 + restitution)


@calculation
def symmetric_regimes(
    *,
    mass: float,
    damping: float,
    stiffness: float,
    absorber_mass: float,
    play: float,
    restitution: float,
    force: float,
    omega: float,
) -> list[SymmetricRegime]:
    """The exact regimes with one impact on each stop per period of a sine force on the structure.

    They are the regimes of `harmonic_response` that have these impacts. None is missed, since the
    distance at an impact is a sine of the phase. Where none is stable, the absorber works in
    clusters, or idles.

    Parameters
    ----------
    mass, damping, stiffness
        Mass, damping and stiffness of the structure, kg, N s/m and N/m.
    absorber_mass, play, restitution
        Loose mass, kg; play of its box, m from stop to stop; restitution of both stops.
    force, omega
        Amplitude a (N) and w (rad/s) of the sine.

    Returns
    -------
    list of SymmetricRegime
        None, one, or two, the fastest first.

    Raises
    ------
    ValueError
        If a number is not positive, or restitution not in [0, 1].

    See Also
    --------
    stochvi.harmonic_response : All regimes, of any structure.
    stochvi.absorbers.tuned_force : The force that is cancelled.

    Examples
    --------
    Resonance of a structure of Q = 50, with 5 % of its mass loose:

    >>> (found, *_) = symmetric_regimes(
    ...     mass=1.0, damping=0.02, stiffness=1.0, absorber_mass=0.05, play=2.0, restitution=0.8,
    ...     force=0.04, omega=1.0,
    ... )
    >>> found.amplitude < 0.1 * found.amplitude_without
    True
    """
    _check_positive(
        mass=mass, damping=damping, stiffness=stiffness, absorber_mass=absorber_mass, play=play,
        force=force, omega=omega,
    )  # fmt: skip
    _check_restitution(restitution)
    roots = np.sqrt([mass, absorber_mass])
    numbers = Numbers(
        stiffness=np.diag([stiffness / mass, 0.0]),
        damping=np.diag([damping / mass, 0.0]),
        forces=np.array([[force / roots[0], 0.0, 0.0], [0.0, 0.0, 0.0]]),
        rows=np.outer([1.0, -1.0], np.array([-1.0, 1.0]) / roots),
        distances=np.full(2, play / 2.0),
        restitutions=np.full(2, restitution),
        omega=omega,
        output=np.array([1.0 / roots[0], 0.0]),
        base=np.zeros(3),
        shapes=np.diag(1.0 / roots),
    )
    without = force / abs(complex(stiffness - mass * omega**2, damping * omega))
    return [
        SymmetricRegime(
            absorber_speed=float(each.velocity[1]),
            impact_speed=float(each.impact_speed[0]),
            amplitude=each.amplitude,
            amplitude_without=without,
            phase=math.remainder(float(each.phase[0]), 2.0 * math.pi),
            stable=each.multiplier < 1.0,
        )
        for each in even_regimes(numbers, UPPER_LOWER)
        if each.admissible
    ]


def _relative_amplitude(play: float, law: str) -> float:
    _check_positive(play=play)
    if law not in LAWS:
        raise ValueError(f"law must be one of {', '.join(LAWS)}, got {law!r}")
    return LAWS[law] * play / 2.0


def _check_positive(**numbers: float) -> None:
    for name, number in numbers.items():
        if not 0.0 < number < math.inf:
            raise ValueError(f"{name} must be a positive number, got {number}")


def _check_restitution(restitution: float) -> None:
    if not 0.0 <= restitution <= 1.0:
        raise ValueError(f"restitution must be in [0, 1], got {restitution}")


# ------------------------------------------------------------------------------
# An impact absorber under a sine: residual vibration over frequency, play and mass.
# ------------------------------------------------------------------------------


Flags = NDArray[np.bool_]

FREQUENCY = "frequency_hz"
"""Name of the varied number where that is the frequency of the sine."""

PLAYS_OF_SINE = np.geomspace(0.02, 3.0, 61)
"""Plays of a tuning curve, over the travel of the structure without the absorber, peak to peak."""

GAPS = np.linspace(-1.0, 2.0, 61)
"""Gaps of a tuning curve of one stop, over the largest displacement of the structure without the
absorber."""

MASSES = np.geomspace(0.25, 4.0, 41)
"""Masses of a tuning curve, over that of the scene."""

SAMPLES = 360
"""Number of phases of a period at which the travel of an idle mass in its box is looked at."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualCurve:
    """Residual vibration with an absorber, over a number that is varied (SI units).

    The ratios are those of the largest displacements of the carrier from its unloaded position.

    Parameters
    ----------
    key
        What is varied: "frequency_hz", or a key of the scene.
    value
        Values of the varied number.
    without
        Largest displacement of the carrier without the absorber, m.
    best, worst
        Smallest and largest ratio of what may last: stable regimes, idling, and the motions to
        which slow sweeps up and down settle, periodic or not.
    first_harmonic
        Ratio of the first harmonics, of the stable regime with impacts that displaces least; NaN
        where there is none.
    stable
        Whether a regime with impacts is stable.
    idle
        Whether loose masses may rest in their boxes, out of reach of the stops.
    periodic
        Whether both sweeps end in motions that repeat themselves; if not, the absorber works in
        clusters there.

    See Also
    --------
    absorber_sine : Makes these curves.
    """

    key: str
    value: Vector
    without: Vector
    best: Vector
    worst: Vector
    first_harmonic: Vector
    stable: Flags
    idle: Flags
    periodic: Flags

    @property
    def tuned(self) -> int:
        """Index of the value at which the worst motion that may last is smallest."""
        return int(np.nanargmin(self.worst))

    def to_frame(self) -> DataFrame:
        """One row for each value."""
        return frame_of(vars(self))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AbsorberSine(Result):
    """An impact absorber under a sine (B 17.9-17.37, by exact regimes).

    Parameters
    ----------
    scene
        The structure with its absorber.
    carrier
        The coordinate that the absorber is to calm.
    mass_ratio
        Mass of the absorber over that of the structure.
    frequency
        Residual vibration over the frequency of the sine.
    tuning
        Residual vibration over play, gap and mass, at the frequency of the scene.
    regimes
        All regimes with the absorber over frequency.

    See Also
    --------
    absorber_sine : Makes it from a scene.
    """

    kind = "absorber sine"

    not_in_document = ("scene",)  # the provenance holds it

    scene: Scene
    carrier: str
    mass_ratio: float
    frequency: ResidualCurve
    tuning: Sequence[ResidualCurve]
    regimes: HarmonicResponse

    def to_frame(self) -> DataFrame:
        """One row for each value of each curve, SI units."""
        return stacked(each.to_frame() for each in (self.frequency, *self.tuning))

    def summary(self) -> str:
        """The residual vibration at the resonance and over all frequencies, and the best tuning, in
        words. Where several motions may last, ratios are those of the largest."""
        curve, left = self.frequency, self.frequency.worst * self.frequency.without
        if np.all(np.isnan(left)):
            return "no motion was found that lasts"
        peak = int(np.argmax(np.where(np.isnan(left), -math.inf, curve.without)))
        where = "where it moves most without the absorber, " if len(curve.value) > 1 else ""
        least, largest = curve.best[peak] * curve.without[peak], left[peak]
        moved = LENGTH.text(largest)
        if least < ALIKE * largest:
            moved = f"{LENGTH.text(least)} to {moved} (by the motion that lasts)"
        parts = [
            f"at {curve.value[peak]:.4g} Hz, {where}{self.carrier} moves {moved} with the "
            f"absorber and {LENGTH.text(curve.without[peak])} without it"
        ]
        most = int(np.nanargmax(left))
        if most != peak:
            ends = f"{curve.value[0]:.4g} to {curve.value[-1]:.4g} Hz"
            parts.append(
                f"over {ends} it moves at most {LENGTH.text(left[most])} with the absorber, at "
                f"{curve.value[most]:.4g} Hz"
            )
        return "; ".join([*parts, *filter(None, map(self._tuned, self.tuning))])

    def _tuned(self, curve: ResidualCurve) -> str:
        """The best value of a tuning curve, in words; empty where no motion lasts."""
        if np.all(np.isnan(curve.worst)):
            return ""
        name, quantity = tuned_key(curve.key)
        sines = [each.frequency_hz for each in self.scene.excitations if isinstance(each, Sine)]
        share, hertz = curve.worst[curve.tuned], f"{min(sines):.4g} Hz"
        if not share < 1.0:
            return f"no {name} is sure to help at {hertz}"
        best = quantity.text(curve.value[curve.tuned]).rstrip()
        return f"the best {name}, {best}, leaves {share:.3g} of the displacement at {hertz}"


def tuned_key(key: str) -> tuple[str, ShownQuantity]:
    """A tuned key in words, and its quantity.

    Examples
    --------
    >>> name, quantity = tuned_key("absorber.play")
    >>> quantity.heading(name), quantity(0.004)
    ('total play (mm)', 4.0)
    """
    unit = KEY_UNITS.get(key.rpartition(".")[2], "")
    return TUNED.get(key, key), readable(unit)


TUNED = {
    "absorber.mass": "mass of the absorber",
    "absorber.play": "total play",
    "absorber.lower": "place of the lower stop",
    "absorber.upper": "place of the upper stop",
}
"""Keys of an absorber in words."""


ALIKE = 0.995
"""Two displacements count as one in words from this ratio of the smaller to the larger on."""


@calculation
def absorber_sine(
    scene: Scene,
    frequency_hz: ArrayLike | None = None,
    *,
    tune: Mapping[str, Sequence[float]] | None = None,
    most_impacts: int = 3,
    budget: float | None = None,
) -> AbsorberSine:
    """Residual vibration with an impact absorber under a sine, over frequency, play and mass.

    The regimes are the exact ones of the structure with its absorber, loose or sprung, with one
    stop or two. Slow sweeps by simulation show what lasts where no regime is stable: there the
    absorber works in clusters.

    Parameters
    ----------
    scene
        A linear structure without stops of its own, an absorber with stops of any law, and a sine.
    frequency_hz
        Frequencies of the sine; by default that of the scene.
    tune
        Keys of the absorber or of its impact pairs with their values, at the frequency of the
        scene; by default play (or the gap of one stop) and mass, where `absorber` has them.
    most_impacts
        As for `harmonic_response`.
    budget
        Seconds of wall time, compilation apart.

    Returns
    -------
    AbsorberSine
        Curves of the residual vibration, and all regimes over frequency.

    Raises
    ------
    NotApplicable
        If the scene has no absorber, stops of its own, or is no case of `harmonic_response`.
    NotConverged
        If the budget ends first; the error holds the curves so far.

    See Also
    --------
    stochvi.absorber : The same under random excitation.
    symmetric_regimes : The regimes of one impact on each stop, from numbers.

    Examples
    --------
    A loose mass of 5 % on a structure of Q = 50, in resonance:

    >>> from stochvi import Absorber, Oscillator, Restitution, Sine
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
    ...     absorber=Absorber(mass=0.05, play=2.0, law=Restitution(coefficient=0.8)),
    ...     excitations=[Sine(amplitude=0.05, frequency_hz=1.0 / 6.283185307)],
    ... )
    >>> found = absorber_sine(scene, tune={"absorber.play": [1.0, 2.0, 3.0]})
    >>> (curve,) = found.tuning
    >>> round(float(found.frequency.best[0]), 3), float(curve.value[curve.tuned])
    (0.087, 2.0)
    """
    began = time.perf_counter()
    if scene.absorber is None:
        raise NotApplicable(
            "absorber:sine",
            "the scene must have an [absorber] with mass (kg), play (m, stop to stop) and law, or "
            "mass_on",
        )
    alone = without_absorber(scene)
    if alone.impact_pairs:
        raise NotApplicable("absorber:sine", NO_STOPS)
    full, masses = scene.expanded, scene.absorber_coordinates
    carrier = next(name for name in full.structure.coordinates if name not in masses)
    deadline = Deadline.after(budget)
    solver = _Solver(scene, alone, carrier, masses, most_impacts, deadline)
    tune = solver.usual_tuning() if tune is None else tune
    if wrong := [key for key in tune if not key.startswith(("absorber.", "impact_pair."))]:
        raise ValueError(f"tune must name keys of absorber or impact_pair, got {', '.join(wrong)}")
    frequency, regimes = solver.over_frequency(frequency_hz, 1.0 / (1 + len(tune)))
    curves = []
    for number, (key, values) in enumerate(tune.items()):
        if not deadline.passed():
            curves.append(solver.over_key(key, values, 1.0 / (len(tune) - number)))
    mass = np.diag(full.structure.matrices[0])
    light = np.array([name in masses for name in full.structure.coordinates])
    answer = AbsorberSine(
        scene=scene,
        carrier=carrier,
        mass_ratio=float(mass[light].sum() / mass[~light].sum()),
        frequency=frequency,
        tuning=curves,
        regimes=regimes,
        warnings=regimes.warnings,
        cost=Cost(wall_time=time.perf_counter() - began),
        provenance=provenance(scene.document()),
    )
    if deadline.passed():
        raise deadline.fell_short("before all regimes were looked for", "ask for fewer", answer)
    return answer


@dataclass(frozen=True)
class _Solver:
    """The structure with and without its absorber, and the time that is left."""

    scene: Scene
    alone: Scene
    carrier: str
    masses: Sequence[str]
    most_impacts: int
    deadline: Deadline

    def over_frequency(
        self, frequency_hz: ArrayLike | None, share: float
    ) -> tuple[ResidualCurve, HarmonicResponse]:
        """The curve over frequency, and all regimes."""
        found = self._regimes(share, frequency_hz=frequency_hz)
        free = partial_result(
            harmonic_response, self.alone, frequency_hz, most_impacts=1,
            coordinate=own_name(self.alone, self.carrier), budget=self.deadline.rest,
        )  # fmt: skip
        values = self._values(found)
        return self._curve(found, values, *_largest(free, values), self._idle(found, values)), found

    def over_key(self, key: str, values: Sequence[float], share: float) -> ResidualCurve:
        """A tuning curve at the frequency of the scene."""
        found = self._regimes(share, vary={key: values})
        seen = self._values(found)
        largest, first = (np.full(len(seen), float(part[0])) for part in self._without())
        return self._curve(found, seen, largest, first, self._idle(found, seen))

    def usual_tuning(self) -> dict[str, Sequence[float]]:
        """Play or gap, and mass, of an absorber that gives them."""
        own = self.scene.absorber
        if not isinstance(own, Absorber) or own.mass is None:
            return {}
        moved = float(self._without()[0][0])
        found: dict[str, Sequence[float]] = {"absorber.mass": list(MASSES * own.mass)}
        if not math.isfinite(moved):
            return found
        if own.play is not None:
            found["absorber.play"] = list(2.0 * moved * PLAYS_OF_SINE)
        elif own.lower is None or own.upper is None:
            side = "upper" if own.lower is None else "lower"
            found[f"absorber.{side}"] = list((1.0 if side == "upper" else -1.0) * moved * GAPS)
        return found

    def _regimes(self, share: float, **varied: Any) -> HarmonicResponse:
        return partial_result(
            harmonic_response, self.scene, **varied, coordinate=self.carrier, sweep="both",
            most_impacts=self.most_impacts, budget=self.deadline.part(share),
        )  # fmt: skip

    def _without(self) -> tuple[Vector, Vector]:
        """Largest displacement and amplitude without the absorber at the frequency of the scene."""
        name = own_name(self.alone, self.carrier)
        found = harmonic_response(self.alone, coordinate=name, most_impacts=1)
        return _largest(found, np.array([found.branches[0].value[0]] if found.branches else [0.0]))

    @staticmethod
    def _values(found: HarmonicResponse) -> Vector:
        """The values of the varied number that were reached in time."""
        swept = [each.value for each in found.simulated]
        followed = [each.value[[not name for name in each.names]] for each in found.branches]
        return np.unique(np.concatenate([np.empty(0), *swept, *followed]))

    def _idle(self, found: HarmonicResponse, values: Vector) -> Flags:
        """Whether loose masses may rest out of reach of the stops, at each value."""
        model = model_of(self.scene)
        own = [model.coordinates.index(name) for name in self.masses]
        held = np.abs(model.stiffness[own]).sum() + np.abs(model.damping[own]).sum()
        if held + np.abs(model.constant_force[own]).sum() > 0.0 or not len(values):
            return np.zeros(len(values), bool)
        low, high = float(values[0]), float(values[-1])
        if low == high:
            low, high = low - 1e-3 * abs(low), high + 1e-3 * abs(high)
        if conditions := functions(model):
            raise NotApplicable("sine", conditions)
        family = Family.of(self._model_at(found.key), low, high, self.carrier)
        return _within(family, family.sigma(values))

    def _model_at(self, key: str) -> Callable[[float], Model]:
        document = self.scene.document(as_written=True)
        if key != FREQUENCY:
            return lambda value: model_of(changed_scene(document, ((key, value),)))
        sines = [n for n, each in enumerate(document["excitation"]) if each["kind"] == "sine"]
        hertz = [document["excitation"][n]["frequency_hz"] for n in sines]
        keys = [f"excitation.{n}.frequency_hz" for n in sines]

        def at(value: float) -> Model:
            changes = [(key, value / min(hertz) * f) for key, f in zip(keys, hertz, strict=True)]
            return model_of(changed_scene(document, tuple(changes)))

        return at

    @staticmethod
    def _curve(
        found: HarmonicResponse, values: Vector, without: Vector, amplitude: Vector, idle: Flags
    ) -> ResidualCurve:
        swept = [
            {
                float(at): (float(moved), int(periods))
                for at, moved, periods in zip(
                    each.value, each.displacement_max, each.periods, strict=True
                )
            }
            for each in found.simulated
        ]
        best, worst, first = np.empty((3, len(values)))
        stable, periodic = np.empty((2, len(values)), bool)
        for number, value in enumerate(values.tolist()):
            regimes = list(_stable(found, value))
            hitting = [(moved, harmonic) for moved, harmonic, impacts in regimes if impacts]
            seen = [known[value] for known in swept if value in known]
            lasting = [moved for moved, _, _ in regimes] + [moved for moved, _ in seen]
            lasting += [float(without[number])] if idle[number] else []
            best[number] = min(lasting, default=math.nan)
            worst[number] = max(lasting, default=math.nan)
            first[number] = min(hitting)[1] if hitting else math.nan
            stable[number] = bool(hitting)
            periodic[number] = all(periods > 0 for _, periods in seen)
        return ResidualCurve(
            key=found.key,
            value=values,
            without=without,
            best=best / without,
            worst=worst / without,
            first_harmonic=first / amplitude,
            stable=stable,
            idle=idle,
            periodic=periodic,
        )


def _largest(found: HarmonicResponse, values: Vector) -> tuple[Vector, Vector]:
    """Largest displacement and amplitude of motion without impacts at values; NaN without one."""
    largest, first = np.full(len(values), np.nan), np.full(len(values), np.nan)
    for branch in found.branches:
        for number, value in enumerate(values):
            for place in branch.at(float(value)):
                largest[number] = branch.displacement_max[place]
                first[number] = branch.amplitude[place]
    return largest, first


def _stable(found: HarmonicResponse, value: float) -> Iterator[tuple[float, float, int]]:
    """Largest displacement, amplitude and number of impacts of the stable regimes at a value."""
    for branch in found.branches:
        for place in branch.at(value):
            if branch.stable[place]:
                moved, first = branch.displacement_max[place], branch.amplitude[place]
                yield float(moved), float(first), len(branch.stops)


def _within(family: Family, sigma: Vector) -> Flags:
    """Whether the travel of every pair without impacts fits between its stops."""
    parts = parts_of(family.flat(sigma), family.sizes)
    phases = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES
    m, harmonics = family.sizes[1:]
    moved = np.zeros((len(sigma), m, SAMPLES))
    for k in range(harmonics):
        force = parts["forces"][:, :, 2 * k] - 1j * parts["forces"][:, :, 2 * k + 1]
        waves = forced(parts, (k + 1) * parts["omega"], force)
        across = np.einsum("psi,pi->ps", parts["rows"], waves)
        moved += (across[:, :, None] * np.exp(1j * (k + 1) * phases)).real
    # the two stops of a pair are neighbouring rows, with opposite signs
    travel = np.ptp(moved[:, ::2], axis=2)
    room = parts["distances"][:, ::2] + parts["distances"][:, 1::2]
    return np.asarray(np.all(travel <= room, axis=1))
