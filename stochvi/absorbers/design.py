"""The best box for a mass budget: play, restitution and number of units, by simulation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Unpack

import numpy as np
import pandas as pd
from numpy.polynomial.chebyshev import chebvander
from scipy.ndimage import maximum_filter1d

from stochvi.absorbers.performance import linear_rms, without_absorber
from stochvi.absorbers.tuned_damper import NO_STOPS, TunedDamper, tuned_damper
from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.shown_units import METRES
from stochvi.methods.monte_carlo import simulate
from stochvi.methods.monte_carlo.simulate import compile_kernels
from stochvi.model.calculations import calculation
from stochvi.results.base import Result, total_cost
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import Cost, Estimate, provenance
from stochvi.results.intervals import GAUSSIAN_95
from stochvi.sampling.options import AccuracyOptions
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.absorbers import Absorber
from stochvi.scenes.excitations import BASE, ConstantLoad
from stochvi.scenes.impact_laws import Restitution
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

    not_in_document = ("provenance",)

    scene: Scene
    mass: float
    sigma: float
    restitution: float
    units: int
    best: BestBox
    robust: BestBox
    level_range_db: float
    curve: pd.DataFrame
    candidates: pd.DataFrame
    tuned_damper: TunedDamper | None

    def to_frame(self) -> pd.DataFrame:
        """One row per candidate, the best one first."""
        return self.candidates

    def summary(self) -> str:
        """The best candidate, in a sentence."""
        return (
            f"{self.units} box(es) with a play of {METRES.text(self.best.play)} and restitution "
            f"{self.restitution:g}: {self.best.ratio.value:.3g} of the rms displacement without"
        )

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        return {"method": "absorber design", **found, "scene": self.scene.document()}


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
    candidates = pd.DataFrame(
        [
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
        ]
    )  # fmt: skip
    others = candidates.drop(index=winner).sort_values("rms_ratio")
    candidates = pd.concat([candidates.iloc[[winner]], others], ignore_index=True)
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
        curve=pd.DataFrame(search.rows),
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
    curves = maximum_filter1d(curves, 2 * width + 1, axis=1)[:, np.searchsorted(grid, inner)]
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
