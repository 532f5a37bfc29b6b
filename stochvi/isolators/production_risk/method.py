"""The risk of any impact over a production, and the clearance that keeps it.

Each unit has its probability of an impact by linear theory (`units.py`), and Sobol' points give the
mean over all units. That theory leaves out that impacts of another mount cluster otherwise. So a
few units are drawn in proportion to their risk, and simulated. The mean of their true probability
over that of the theory is the factor by which the whole mean is off (importance sampling).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.stats import qmc, sobol_indices
from scipy.stats import t as student

from stochvi.isolators.production_risk.answer import Production
from stochvi.isolators.production_risk.spreads import (
    Spread,
    bands_beside,
    check_spreads,
    quantity_of,
    spreads_of,
)
from stochvi.isolators.production_risk.start import Start
from stochvi.isolators.production_risk.units import UnitGaps, Units
from stochvi.isolators.sizing.answer import Clearance, Target
from stochvi.isolators.sizing.changes import Tolerances, all_applied
from stochvi.isolators.sizing.risk_curve import CERTAIN, KNOWN, chance_of_stops
from stochvi.isolators.sizing.sensitivity import LEAST_SECONDS
from stochvi.isolators.sizing.tolerance_region import Region
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.model.calculations import calculation
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate, provenance
from stochvi.sampling.options import AccuracyOptions
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

POINTS = 256
"""Points of a Sobol' sequence; each gives the amounts of two units."""

SEQUENCES, MOST_SEQUENCES = 8, 32
"""Sequences, each scrambled for itself, from whose scatter the error of the quadrature follows:
their number at first, and at most."""

QUADRATURE_SHARE = 0.5
"""Error of the quadrature over that asked for, above which the sequences are doubled."""

SIMULATED, FEWEST_SIMULATED = 12, 4
"""Units that are simulated, and the smallest number from which a standard error can be found."""

UNIT_ERROR = 2.0
"""Relative error of the probability of a simulated unit, over that asked for: the mean of all has
less."""

SHARE_OF_NOMINAL, SHARE_OF_QUADRATURE = 0.4, 0.3
"""Share of the budget for the scene as stated, and share of the rest for the quadrature."""

FARTHEST = 400.0
"""Largest shift of the logarithm of a risk in the search for a clearance."""

HALVINGS = 60
"""Halvings of that interval in the search for the clearance of each unit."""

QUANTILES = (0.01, 0.05, *np.linspace(0.1, 0.9, 9).tolist(), 0.95, 0.99, 0.999)
"""Shares of the units whose risk is listed."""

MISSED = 1.3
"""Error of the answer over that asked for, above which a warning states it."""

METHOD = (
    "mean over units by Sobol' points; each unit by Rice's rate of its linear motion, corrected by "
    "first crossings of units that were drawn in proportion to their risk; no impact law enters"
)

UNFELT = ("stiffness", "restitution")
"""Quantities of stops on which the probability of any impact does not depend."""


@calculation
@sampled(rel_error=0.05)
def production(
    scene: Scene,
    spreads: Mapping[str, Spread] | None = None,
    *,
    mission: float = 3600.0,
    probability: float | None = None,
    pair: str | None = None,
    tolerances: Tolerances | None = None,
    **options: Unpack[AccuracyOptions],
) -> Production:
    """Probability of any impact over a production, and the clearance that keeps a target.

    Mount, level and stops of each unit are drawn once, by

        P = E[P_unit],    P_unit = 1 - exp(-H nu_unit / nu)

    nu is Rice's rate of crossings of all stops, and H = -ln(1 - P) of the scene as stated. First
    crossings of units in proportion to their risk correct the mean, see `Production.correction`.

    Parameters
    ----------
    scene
        A linear scene under stationary Gaussian noise, as for `size`.
    spreads
        Distribution of each quantity that varies between units: "frequency", "damping", "level",
        "centre", and "clearance" of each stop. The probability of any impact does not depend on
        "stiffness" and "restitution" of the stops, which are left out. By default what the scene
        states (`stochvi.BetweenUnits`).
    mission
        Seconds of exposure of each unit, from a stationary start.
    probability
        The target of the mean over the units. Without it, the stops stay where the scene has them.
    pair
        The one of several pairs whose clearance is searched for, as for `size`; without a target
        the pair whose impacts count.
    tolerances
        Tolerances that are no distribution; the units vary about the place within them where the
        risk is largest by linear theory. By default those that the scene states.
    **options
        `AccuracyOptions`: `rel_error` is that of the mean probability, by default 0.05.

    Returns
    -------
    Production
        The clearances with their intervals, the mean and the spread of the risk, and the clearance
        that each tolerance costs.

    Raises
    ------
    NotApplicable
        If the scene is not covered, or the scene as stated is hit at once.
    NotConverged
        If the budget ends before the units are known.

    See Also
    --------
    stochvi.size : The clearance of a unit as stated, or the worst within tolerances.

    Examples
    --------
    >>> from stochvi.isolators import Spread
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Isolator
    >>> scene = Scene(
    ...     structure=Isolator(frequency_hz=10.0, zeta=0.05),
    ...     excitations=[WhiteNoise(density=0.01, unit="g2/Hz")],
    ... )
    >>> found = production(scene, {"frequency": Spread(std=0.03)}, probability=0.01)
    >>> found.clearances["x"].value > found.stated["x"]
    True
    """
    if not 0.0 < mission < math.inf:
        raise ValueError(f"mission must be a positive number of seconds, got {mission}")
    if probability is not None and not 0.0 < probability <= CERTAIN:
        raise ValueError(f"probability must be in (0, {CERTAIN:g}], got {probability:g}")
    if conditions := unmet(scene):
        raise NotApplicable("production", conditions)
    spreads = spreads_of(scene) if spreads is None else spreads
    check_spreads(scene, spreads)
    run = Run.of(options)
    first = run.part(0.0, 0.4, "as stated", run.deadline.share(SHARE_OF_NOMINAL))
    if probability is None:
        start = Start.of_scene(scene, mission, pair, first)
    else:
        target = Target(name="probability", value=probability, unit="1")
        start = Start.of_target(scene, target, mission, pair, first)
    return about(start, spreads, tolerances or bands_beside(scene, spreads), run.part(0.4, 1.0))


def unmet(scene: Scene) -> list[str]:
    """The conditions of the mean over units that a scene does not meet, in sentences."""
    if scene.phases:
        return ["the scene must have no phases; ask for each, as FILE.toml#PHASE"]
    if model_of(scene).sines:
        return [
            "excitation must be noise or constant, got a sine: the gaps of units are compared as "
            "Gaussian ones; give tolerances without a distribution, or take mean_over_units"
        ]
    return []


def about(
    start: Start, spreads: Mapping[str, Spread], tolerances: Tolerances, run: Run
) -> Production:
    """The production about a scene as stated."""
    if conditions := unmet(start.scene):
        raise NotApplicable("production", conditions)
    felt = {name: each for name, each in spreads.items() if quantity_of(name) not in UNFELT}
    return _Job(
        start=start, spreads=felt, tolerances=tolerances.felt(start.scene, by_hits=False), run=run
    ).answer()


@dataclass(kw_only=True)
class _Job:
    """The calculation of one production."""

    start: Start
    spreads: Mapping[str, Spread]
    tolerances: Tolerances
    run: Run

    def __post_init__(self) -> None:
        scene = self.start.scene
        self.nominal = Region(scene, self.tolerances)
        self.stated = self._one(self.nominal.nominal)
        base = scene
        if self.tolerances != Tolerances():
            ((_, changes),) = self.nominal.worst(
                lambda gaps: self._one(gaps).rice(self.start.stops), self.run.deadline
            )
            base = all_applied(changes, scene)
        self.units = Units(
            scene=base, spreads=self.spreads, mean=self.nominal.nominal.mean, stops=self.start.stops
        )
        hazard = -math.log1p(-min(self.start.chance, KNOWN))
        self.clusters = hazard / float(self.stated.rice(self.start.stops)[0])

    def _one(self, gaps: Any) -> UnitGaps:
        """The gaps of one unit."""
        shift = gaps.mean - self.nominal.nominal.mean
        return UnitGaps(gaps.sigma[None], gaps.rate[None], np.array([[shift, -shift]]))

    @property
    def moved(self) -> list[int]:
        """Numbers of the pairs whose stops may be moved: all of them without a target."""
        sized = self.start.target is not None
        return list(self.start.sized if sized else range(len(self.start.names)))

    def stops(self, shift: ArrayLike) -> Vector:
        """(..., 2, pairs): the stops at which the logarithm of the risk of each movable one is
        smaller by `shift` (...), by Rice's rate of the scene as stated."""
        sigma, found = self.stated.sigma[0], np.array(self.start.stops)
        found = np.broadcast_to(found, (*np.shape(shift), *found.shape)).copy()
        for k in self.moved:
            if sigma[k] > 0.0:
                square = found[..., k] ** 2 + 2.0 * sigma[k] ** 2 * np.asarray(shift)[..., None]
                found[..., k] = np.sqrt(np.maximum(square, 0.0))
        if self.start.common:
            shared = found[..., list(self.start.common)]
            most = np.where(np.isfinite(shared), shared, 0.0).max(axis=(-2, -1), keepdims=True)
            found[..., list(self.start.common)] = np.where(np.isfinite(shared), most, math.inf)
        return found

    def chances(self, gaps: UnitGaps, shift: ArrayLike) -> Vector:
        """(units,): probability of any impact of each unit, with the stops moved by one shift, or
        by one for each unit."""
        return np.asarray(-np.expm1(-self.clusters * gaps.rice(self.stops(shift))))

    # --- the quadrature ---------------------------------------------------------------------

    def quadrature(self) -> None:
        """Draw the units: sequences of Sobol' points, until the error is small enough."""
        deadline = self.run.deadline.share(SHARE_OF_QUADRATURE)
        self.units.solve(self.run.deadline)
        self.drawn: list[tuple[Matrix, Matrix]] = []
        self.pools: list[UnitGaps] = []
        while True:
            for number in range(len(self.drawn), max(2 * len(self.drawn), SEQUENCES)):
                self._draw(number)
            shift = self.placed(1.0)
            error = _relative([float(self.chances(pool, shift).mean()) for pool in self.pools])
            fine = error <= QUADRATURE_SHARE * self.run.accuracy
            if fine or deadline.passed() or len(self.drawn) >= MOST_SEQUENCES:
                return

    def _draw(self, number: int) -> None:
        columns = len(self.units.columns)
        random = np.random.default_rng([self.run.seed, number])
        points = qmc.Sobol(2 * columns, seed=random).random(POINTS)
        pair = self.units.drawn(points[:, :columns]), self.units.drawn(points[:, columns:])
        self.drawn.append(pair)
        self.pools.append(self._gaps(np.concatenate(pair)))

    @cached_property
    def pool(self) -> UnitGaps:
        """All units that were drawn."""
        return _joined(self.pools)

    @cached_property
    def amounts(self) -> Matrix:
        """The amounts of all units that were drawn."""
        return np.concatenate([np.concatenate(pair) for pair in self.drawn])

    def placed(self, correction: float) -> float:
        """The shift of the stops of the answer; 0 without a target."""
        if self.start.target is None:
            return 0.0
        return self.solved(correction, _joined(self.pools), self.start.target)

    def solved(self, correction: float, pool: UnitGaps, chance: float) -> float:
        """The shift at which the mean probability of units, times a correction, has a value."""
        wanted = min(chance / correction, KNOWN)

        def excess(shift: float) -> float:
            return math.log(max(float(self.chances(pool, shift).mean()), 1e-300) / wanted)

        if excess(FARTHEST) > 0.0:
            raise NotApplicable(
                "production",
                [f"no clearance keeps the probability of any impact at {chance:g}: "
                 "units have stops that press, or the other stops are hit more often; give smaller "
                 "spreads"],
            )  # fmt: skip
        if excess(-FARTHEST) < 0.0:
            return -FARTHEST
        return float(brentq(excess, -FARTHEST, FARTHEST, xtol=1e-9))

    @property
    def kept(self) -> float:
        """The target, or the mean probability of the production without one."""
        return self.mean if self.start.target is None else self.start.target

    def needed(self, pool: UnitGaps) -> Vector:
        """(units,): the shift at which each unit alone has the target, or without one the mean
        probability of the production."""
        rate = -math.log1p(-min(self.kept / self.correction.value, KNOWN)) / self.clusters
        low, high = np.full(len(pool.sigma), -FARTHEST), np.full(len(pool.sigma), FARTHEST)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            above = pool.rice(self.stops(middle)) > rate
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        return np.asarray(0.5 * (low + high))

    def largest(self, shift: ArrayLike) -> Vector:
        """The largest clearance of the movable pairs at a shift, m."""
        places = self.stops(shift)[..., self.moved]
        return np.asarray(np.where(np.isfinite(places), places, -math.inf).max(axis=(-2, -1)))

    # --- units that are simulated -----------------------------------------------------------

    def simulate(self, shift: float) -> None:
        """Find the correction, by first crossings of units that are drawn in proportion to their
        risk."""
        linear = self.chances(self.pool, shift)
        random = np.random.default_rng([self.run.seed, MOST_SEQUENCES])
        places = (np.arange(SIMULATED) + random.random()) / SIMULATED
        # in random order, so that the first few are a sample as well
        chosen = random.permutation(np.searchsorted(np.cumsum(linear) / linear.sum(), places))
        stops, rows, found = self.stops(shift), [], []
        for done, k in enumerate(chosen):
            late = self.run.deadline.passed()
            if late and done >= FEWEST_SIMULATED:
                break
            part = self.run.part(
                0.3 + 0.7 * done / SIMULATED, 0.3 + 0.7 * (done + 1) / SIMULATED,
                f"unit {done + 1} of {SIMULATED}",
                self.run.deadline.share(1.0 / (SIMULATED - done)).in_no_less_than(LEAST_SECONDS),
                seed=self.run.seed + 1 + done, rel_error=min(UNIT_ERROR * self.run.accuracy, 0.5),
            )  # fmt: skip
            chance = chance_of_stops(
                self.units.unit(self.amounts[k]), stops + self.pool.farther[k],
                self.start.mission, part,
            )  # fmt: skip
            found.append(chance.value / linear[k])
            names = [name for _, name in self.units.columns]
            rows.append(
                dict(zip(names, self.amounts[k].tolist(), strict=True))
                | {"linear": float(linear[k]), "probability": chance.value,
                   "standard_error": chance.standard_error, "bias": chance.bias or 0.0}
            )  # fmt: skip
        self.rows = rows
        self.correction = Estimate(
            value=float(np.mean(found)), standard_error=_deviation(found),
            bias=float(np.mean([row["bias"] / row["linear"] for row in rows])),
            how=f"{len(found)} units, drawn in proportion to their risk",
        )  # fmt: skip

    # --- the answer -------------------------------------------------------------------------

    def answer(self) -> Production:
        """Find the shift of the stops, the correction and what each tolerance costs."""
        import pandas as pd

        self.run.tell(0.0, "units by linear theory")
        self.quadrature()
        self.simulate(self.placed(1.0))
        factor, start = self.correction.value, self.start
        shift = self.placed(factor)
        means = [float(self.chances(pool, shift).mean()) for pool in self.pools]
        self.mean = factor * float(np.mean(means))
        relative = math.hypot(_relative(means), self.correction.standard_error / factor)
        bias = (self.correction.bias or 0.0) / factor
        half = float(student.ppf(0.975, len(self.rows) - 1)) * relative + bias
        slope = (
            -math.log(
                float(self.chances(self.pool, shift + 0.05).mean())
                / float(self.chances(self.pool, shift - 0.05).mean())
            )
            / 0.1
        )
        low, high = shift - half / slope, shift + half / slope
        needed = self.needed(self.pool)
        return Production(
            scene=start.scene,
            spreads=self.spreads,
            mission=start.mission,
            target=start.target,
            clearances=self._clearances(low, shift, high),
            stated={name: each.value for name, each in self._clearances(0.0, 0.0, 0.0).items()},
            probability=Estimate(
                value=self.mean, standard_error=self.mean * relative, bias=self.mean * bias,
                how=f"{len(self.amounts)} units by linear theory, {self.correction.how} simulated",
            ),
            interval=(self.mean * max(1.0 - half, 0.0), min(self.mean * (1.0 + half), 1.0)),
            probability_as_stated=float(self.chances(self.stated, shift)[0]),
            share_above=self._share_above(needed, shift),
            correction=self.correction,
            units=self._quantiles(needed, shift),
            tolerances=self._costs(shift),
            simulated=pd.DataFrame(self.rows),
            method=METHOD,
            allowed=self.tolerances,
            warnings=self._warnings(relative),
            cost=self.run.cost(),
            provenance=provenance(start.scene.document(), self.run.seed),
        )  # fmt: skip

    def _clearances(self, low: float, shift: float, high: float) -> dict[str, Clearance]:
        """The nearer stop of each pair that may be moved, or of each pair."""
        places = [self.stops(np.asarray(each)).min(axis=0) for each in (low, shift, high)]
        return {
            self.start.names[k]: Clearance(
                value=float(places[1][k]), lower=float(places[0][k]), upper=float(places[2][k])
            )
            for k in self.moved
        }

    def _share_above(self, needed: Vector, shift: float) -> Estimate | None:
        """The share of the units that need more than the production gets."""
        if self.start.target is None:
            return None
        shares = np.mean((needed > shift).reshape(len(self.pools), -1), axis=1)
        return Estimate(
            value=float(shares.mean()), standard_error=_deviation(shares.tolist()),
            how="by linear theory, with the mean correction",
        )  # fmt: skip

    def _quantiles(self, needed: Vector, shift: float) -> pd.DataFrame:
        import pandas as pd

        chances = np.minimum(self.correction.value * self.chances(self.pool, shift), 1.0)
        return pd.DataFrame(
            {
                "share_of_units": QUANTILES,
                "probability": np.quantile(chances, QUANTILES),
                "clearance": np.quantile(self.largest(needed), QUANTILES),
            }
        )

    def _costs(self, shift: float) -> pd.DataFrame:
        """The table that `Production.tolerances` describes."""
        import pandas as pd

        if not self.spreads:
            return pd.DataFrame()
        columns = [tolerance for tolerance, _ in self.units.columns]
        most, without, mixed = float(self.largest(shift)), [], []
        for name, spread in self.spreads.items():
            own = np.array([each == name for each in columns])
            mean = float(spread.distribution(name).mean())
            pool = self._gaps(np.where(own, mean, self.amounts))
            without.append(float(self.largest(self.solved(self.correction.value, pool, self.kept))))
            mixed.append([self._needs(np.where(own, b, a)) for a, b in self.drawn])
        table = {
            "tolerance": [each.in_words(name) for name, each in self.spreads.items()],
            "clearance_cost": [most - each for each in without],
        }
        # (sequences, spreads) of either kind of share
        found = [self._shares(number, each) for number, each in enumerate(zip(*mixed, strict=True))]
        for name, shares in zip(("first_order", "total"), np.swapaxes(found, 0, 1), strict=True):
            table |= {
                name: shares.mean(axis=0).tolist(),
                f"{name}_error": [_deviation(each) for each in shares.T],
            }
        return pd.DataFrame(table)

    def _shares(self, number: int, mixed: Sequence[Vector]) -> tuple[Vector, Vector]:
        """Shares of each spread quantity in the variance of the clearance that a unit needs, alone
        and with the others, by one sequence (Sobol' indices)."""
        if len(self.spreads) == 1:
            return np.ones(1), np.ones(1)
        plain = [self._needs(each)[None] for each in self.drawn[number]]
        outputs: Any = {"f_A": plain[0], "f_B": plain[1], "f_AB": np.array(mixed)[:, None]}
        found = sobol_indices(func=outputs, n=POINTS)
        return np.ravel(found.first_order), np.ravel(found.total_order)

    def _gaps(self, amounts: Matrix) -> UnitGaps:
        return self.units.gaps(amounts)

    def _needs(self, amounts: Matrix) -> Vector:
        """(units,): the clearance that each unit needs for itself, m."""
        return self.largest(self.needed(self._gaps(amounts)))

    def _warnings(self, relative: float) -> tuple[str, ...]:
        if relative <= MISSED * self.run.accuracy:
            return ()
        return (
            f"the mean probability is known to a relative error of {relative:.3g} only; raise "
            "budget, or give smaller spreads",
        )


def _joined(pools: Sequence[UnitGaps]) -> UnitGaps:
    """The units of several sequences."""
    return UnitGaps(*map(np.concatenate, zip(*pools, strict=True)))


def _deviation(values: Sequence[float]) -> float:
    """Standard error of the mean of independent values."""
    return float(np.std(values, ddof=1) / math.sqrt(len(values)))


def _relative(values: Sequence[float]) -> float:
    """Relative standard error of the mean of independent values."""
    return _deviation(values) / float(np.mean(values))
