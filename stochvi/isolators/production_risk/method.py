"""The risk of any impact over a production, and the clearance that keeps it.

Each unit has its probability of an impact by linear theory (`units.py`), and Sobol' points give the
mean over all units. Where few of them carry that mean, as many more are drawn where the risk is
(`draws.py`). The theory leaves out that impacts of another mount cluster otherwise. Units that need
little, a usual and much clearance are simulated, and what they are off by is interpolated over that
need. Then a few units are drawn in proportion to their risk, and simulated. The mean of their true
probability over the one so far is the factor by which the whole mean is off (importance sampling).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.stats import qmc, sobol_indices
from scipy.stats import t as student

from stochvi.isolators.production_risk.answer import Production
from stochvi.isolators.production_risk.draws import (
    Gaussian,
    drawn_from,
    effective_number,
    fitted,
    power_of,
    weights_of,
)
from stochvi.isolators.production_risk.spreads import (
    Spread,
    bands_beside,
    check_spreads,
    quantity_of,
    spreads_of,
)
from stochvi.isolators.production_risk.start import Start
from stochvi.isolators.production_risk.units import MOVING, RARE, UnitGaps, Units
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

CARRIED = 0.1
"""Share of the units of even probability that must count, as (sum p)^2 / sum p^2, so that none are
drawn where the risk is."""

ROUNDS = 12
"""Largest number of rounds in which the distributions of such units are fitted."""

SETTLED = 0.05
"""Largest change of the logarithm of the risk in the last round."""

LEAST_EFFECTIVE = 100.0
"""Effective number of units below which the error of their mean is at least its inverse root."""

PROBES = (0.02, 0.5, 0.98)
"""Shares of the units that need less than those by which the theory is corrected unit by unit. In
the middle of the risk there is one more."""

SURE_HITS = 1e3
"""Impacts by linear theory beyond which a unit is not simulated: even those of a mount that rings
for hundreds of periods make several clusters."""

QUADRATURE_SHARE = 0.5
"""Error of the quadrature over that asked for, above which the sequences are doubled."""

SIMULATED, FEWEST_SIMULATED = 12, 4
"""Units that are simulated, and the smallest number from which a standard error can be found."""

UNIT_ERROR = 2.0
"""Relative error of the probability of a simulated unit, over that asked for: the mean of all has
less."""

SHARE_OF_NOMINAL, SHARE_OF_QUADRATURE = 0.4, 0.3
"""Share of the budget for the scene as stated, and share of the rest for the quadrature."""

RINGING = 1e3
"""The shift from which units with a risk are first drawn where no shift keeps the target yet: only
those of a mount with ten times the rms have any."""

FARTHEST = 1e5
"""Largest shift of the logarithm of a risk in the search for a clearance."""

HALVINGS = 60
"""Halvings of that interval in the search for the clearance of each unit."""

QUANTILES = (0.01, 0.05, *np.linspace(0.1, 0.9, 9).tolist(), 0.95, 0.99, 0.999)
"""Shares of the units whose risk is listed."""

MISSED = 1.3
"""Error of the answer over that asked for, above which a warning states it."""

METHOD = (
    "mean over units by Sobol' points, where few carry it of units that are drawn where the risk "
    "is; each unit by Rice's rate of its linear motion, corrected by first crossings of some units "
    "and of those that were drawn in proportion to their risk; no impact law enters"
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
        aim = self.start.chance if self.start.target is None else self.start.target
        self.units = Units(
            scene=base, spreads=self.spreads, mean=self.nominal.nominal.mean,
            stops=self.start.stops, rare=min(RARE, 1e-3 * aim),
        )  # fmt: skip
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

    def chances(self, gaps: UnitGaps, shift: ArrayLike, lift: ArrayLike = 0.0) -> Vector:
        """(units,): probability of any impact of each unit, with the stops moved by one shift, or
        by one for each unit; `lift` is the logarithm of what the theory leaves out."""
        hits = self.clusters * np.exp(lift) * gaps.rice(self.stops(shift))
        return np.asarray(-np.expm1(-hits))

    # --- the quadrature ---------------------------------------------------------------------

    def quadrature(self) -> None:
        """Draw the units: sequences of Sobol' points, until the error is small enough."""
        deadline = self.run.deadline.share(SHARE_OF_QUADRATURE)
        self.units.solve(self.run.deadline)
        self.sequences: list[_Sequence] = []
        self.parts: list[Gaussian] = []
        self.knots: tuple[Vector, Vector] | None = None
        self._draw(SEQUENCES)
        self._fit()
        while True:
            error = self._relative(self.placed(1.0))
            fine = error <= QUADRATURE_SHARE * self.run.accuracy
            if fine or deadline.passed() or len(self.sequences) >= MOST_SEQUENCES:
                return
            self._draw(2 * len(self.sequences))

    def _draw(self, number: int) -> None:
        """Have so many sequences, with units of the parts."""
        columns = len(self.units.columns)
        for each in range(number):
            random = np.random.default_rng([self.run.seed, each])
            even = qmc.Sobol(2 * columns, seed=random).random(POINTS)
            pair = even[:, :columns], even[:, columns:]
            points = np.concatenate(pair)
            if self.parts:
                more = qmc.Sobol(columns + 1, seed=random).random(2 * POINTS)
                points = np.concatenate([points, drawn_from(self.parts, more)])
            weight = weights_of(self.parts, points, 2 * POINTS, len(points) - 2 * POINTS)
            amounts = self.units.drawn(points)
            drawn = _Sequence(points, amounts, self._gaps(amounts), weight)
            self.sequences[each : each + 1] = [drawn]
        self._join()

    def _join(self) -> None:
        """All units that were drawn, in one."""
        each = self.sequences
        self.pool = UnitGaps(*map(np.concatenate, zip(*(s.gaps for s in each), strict=True)))
        self.amounts = np.concatenate([s.amounts for s in each])
        self.weight = np.concatenate([s.weight for s in each]) / len(each)
        self.lifts = self.lifted(self.pool)

    def _fit(self) -> None:
        """Fit the distributions from which units are drawn where the risk is, in rounds."""
        before = math.nan
        for _ in range(ROUNDS):
            shift = self._first_place()
            risk = self.chances(self.pool, shift)
            if not self.parts and effective_number(risk) > CARRIED * len(risk):
                return
            power = power_of(self.weight, risk)
            now = math.log(float(self.weight @ risk)) if self.start.target is None else shift
            if self.parts and power == 1.0 and abs(now - before) < SETTLED:
                return
            before = now
            points = np.concatenate([each.points for each in self.sequences])
            label = self.pool.nearest(self.stops(shift))
            self.parts = fitted(points, self.weight, risk**power, label)
            self._draw(len(self.sequences))

    def _first_place(self) -> float:
        """The shift so far. Until units are drawn where the risk is, one unit may weigh more than
        the target. The stops are then as far as they may be."""
        try:
            return self.placed(1.0)
        except NotApplicable:
            return RINGING

    def _means(self, shift: float) -> list[float]:
        """Mean probability of each sequence."""
        parts = self.weight * self.chances(self.pool, shift, self.lifts)
        return [
            float(each.sum()) for each in np.split(parts * len(self.sequences), len(self.sequences))
        ]

    def _relative(self, shift: float) -> float:
        """Relative error of the mean: by the scatter of the sequences, and by the number of units
        that carry it where that is small."""
        number = effective_number(self.weight * self.chances(self.pool, shift, self.lifts))
        few = 1.0 / math.sqrt(max(number, 1.0)) if number < LEAST_EFFECTIVE else 0.0
        return math.hypot(_relative(self._means(shift)), few)

    def lifted(self, pool: UnitGaps) -> Vector:
        """(units,): logarithm of the factor on the theory of each unit, by the clearance that it
        needs."""
        if self.knots is None:
            return np.zeros(len(pool.sigma))
        return np.asarray(np.interp(self.needed(pool, self.aim), *self.knots))

    def placed(self, correction: float) -> float:
        """The shift of the stops of the answer; 0 without a target."""
        if self.start.target is None:
            return 0.0
        return self.solved(correction, self.pool, self.lifts, self.start.target)

    def solved(self, correction: float, pool: UnitGaps, lifts: Vector, chance: float) -> float:
        """The shift at which the mean probability of units, times a correction, has a value."""
        wanted = min(chance / correction, KNOWN)

        def excess(shift: float) -> float:
            mean = float(self.weight @ self.chances(pool, shift, lifts))
            return math.log(max(mean, 1e-300) / wanted)

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
        if self.start.target is not None:
            return self.start.target
        return self.mean

    def needed(self, pool: UnitGaps, chance: float, lift: ArrayLike = 0.0) -> Vector:
        """(units,): the shift at which each unit alone has a probability; what its theory is off
        by is `lift`."""
        rate = -math.log1p(-min(chance, KNOWN)) / self.clusters / np.exp(lift)
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

    @property
    def _probed(self) -> int:
        """Number of units by which the theory is corrected unit by unit: none where only levels and
        clearances differ, for a unit that needs more is then the same as one that needs less."""
        moving = any(name in MOVING for _, name in self.units.columns)
        return len(PROBES) + 1 if moving else 0

    def probe(self, shift: float) -> None:
        """Correct the theory unit by unit: simulate some, each at the clearance that it needs."""
        self.aim = self.start.target or float(np.mean(self._means(0.0)))
        if not self._probed:
            return
        needs = self.needed(self.pool, self.aim)
        order = np.argsort(needs)
        risk = self.weight * self.chances(self.pool, shift)
        chosen = [
            order[np.searchsorted(np.cumsum(weight[order]) / weight.sum(), place)]
            for weight, place in [*((self.weight, each) for each in PROBES), (risk, 0.5)]
        ]
        knots = []
        for number, k in enumerate(chosen):
            if abs(needs[k]) >= FARTHEST:
                continue
            chance = self._simulated(k, float(needs[k]), number)
            hits, theory = (-math.log1p(-min(each, KNOWN)) for each in (chance.value, self.aim))
            knots.append((float(needs[k]), math.log(hits / theory) if hits else 0.0))
        if knots:
            needed, lift = np.array(sorted(knots)).T
            self.knots = needed, lift
        self._join()

    def _simulated(self, k: int, shift: float, number: int) -> Estimate:
        """Probability of any impact of a unit with the stops moved by a shift, by first crossings;
        the `number` counts the simulations."""
        place = self.stops(shift) + self.pool.farther[k]
        hits = self.clusters * float(self.pool.rice(self.stops(shift))[k])
        if hits > SURE_HITS or place.min() <= 0.0:
            return Estimate(value=1.0, how="hit surely")
        whole = self._probed + SIMULATED
        part = self.run.part(
            0.3 + 0.7 * number / whole, 0.3 + 0.7 * (number + 1) / whole,
            f"unit {number + 1} of {whole}",
            self.run.deadline.share(1.0 / (whole - number)).in_no_less_than(LEAST_SECONDS),
            seed=self.run.seed + 1 + number, rel_error=min(UNIT_ERROR * self.run.accuracy, 0.5),
        )  # fmt: skip
        return chance_of_stops(self.units.unit(self.amounts[k]), place, self.start.mission, part)

    def simulate(self, shift: float) -> None:
        """Find the correction, by first crossings of units that are drawn in proportion to their
        risk."""
        theory = self.chances(self.pool, shift, self.lifts)
        risk = self.weight * theory
        random = np.random.default_rng([self.run.seed, MOST_SEQUENCES])
        places = (np.arange(SIMULATED) + random.random()) / SIMULATED
        # in random order, so that the first few are a sample as well
        chosen = random.permutation(np.searchsorted(np.cumsum(risk) / risk.sum(), places))
        rows, found = [], []
        for done, k in enumerate(chosen):
            late = self.run.deadline.passed()
            if late and done >= FEWEST_SIMULATED:
                break
            chance = self._simulated(k, shift, self._probed + done)
            found.append(chance.value / theory[k])
            names = [name for _, name in self.units.columns]
            rows.append(
                dict(zip(names, self.amounts[k].tolist(), strict=True))
                | {"linear": float(theory[k]), "probability": chance.value,
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
        self.probe(self.placed(1.0))
        self.simulate(self.placed(1.0))
        factor, start = self.correction.value, self.start
        shift = self.placed(factor)
        self.mean = factor * float(np.mean(self._means(shift)))
        quadrature = self._relative(shift)
        relative = math.hypot(quadrature, self.correction.standard_error / factor)
        bias = (self.correction.bias or 0.0) / factor
        half = float(student.ppf(0.975, len(self.rows) - 1)) * relative + bias
        slope = (
            -math.log(
                float(np.mean(self._means(shift + 0.05)))
                / float(np.mean(self._means(shift - 0.05)))
            )
            / 0.1
        )
        low, high = shift - half / slope, shift + half / slope
        needed = self.needed(self.pool, self.kept / factor, self.lifts)
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
        above = (self.weight * (needed > shift)).reshape(len(self.sequences), -1).sum(axis=1)
        shares = above * len(self.sequences)
        return Estimate(
            value=float(shares.mean()), standard_error=_deviation(shares.tolist()),
            how="by linear theory, with its corrections",
        )  # fmt: skip

    def _quantiles(self, needed: Vector, shift: float) -> pd.DataFrame:
        import pandas as pd

        lift = self.lifts + math.log(self.correction.value)
        chances = self.chances(self.pool, shift, lift)
        return pd.DataFrame(
            {
                "share_of_units": QUANTILES,
                "probability": _quantiles(chances, self.weight),
                "clearance": _quantiles(self.largest(needed), self.weight),
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
            kept = self.solved(self.correction.value, pool, self.lifted(pool), self.kept)
            without.append(float(self.largest(kept)))
            mixed.append([self._needs(np.where(own, b, a)) for a, b in map(_pair, self.sequences)])
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
        plain = [self._needs(each)[None] for each in _pair(self.sequences[number])]
        outputs: Any = {"f_A": plain[0], "f_B": plain[1], "f_AB": np.array(mixed)[:, None]}
        found = sobol_indices(func=outputs, n=POINTS)
        return np.ravel(found.first_order), np.ravel(found.total_order)

    def _gaps(self, amounts: Matrix) -> UnitGaps:
        return self.units.gaps(amounts)

    def _needs(self, amounts: Matrix) -> Vector:
        """(units,): the clearance that each unit needs for itself, m."""
        gaps = self._gaps(amounts)
        kept = self.kept / self.correction.value
        return self.largest(self.needed(gaps, kept, self.lifted(gaps)))

    def _warnings(self, relative: float) -> tuple[str, ...]:
        if relative <= MISSED * self.run.accuracy:
            return ()
        return (
            f"the mean probability is known to a relative error of {relative:.3g} only; raise "
            "budget, or give smaller spreads",
        )


class _Sequence(NamedTuple):
    """Units of one sequence: points of the unit cube, first 2 POINTS of even probability, then
    those drawn where the risk is; amounts, gaps, and weights that sum to about 1."""

    points: Matrix
    amounts: Matrix
    gaps: UnitGaps
    weight: Vector


def _pair(drawn: _Sequence) -> tuple[Matrix, Matrix]:
    """The two halves of the units of even probability."""
    return drawn.amounts[:POINTS], drawn.amounts[POINTS : 2 * POINTS]


def _quantiles(values: Vector, weight: Vector) -> Vector:
    """Quantiles of weighted values at the shares QUANTILES."""
    order = np.argsort(values)
    below = np.cumsum(weight[order]) - 0.5 * weight[order]
    return np.asarray(np.interp(QUANTILES, below / weight.sum(), values[order]))


def _deviation(values: Sequence[float]) -> float:
    """Standard error of the mean of independent values."""
    return float(np.std(values, ddof=1) / math.sqrt(len(values)))


def _relative(values: Sequence[float]) -> float:
    """Relative standard error of the mean of independent values."""
    return _deviation(values) / float(np.mean(values))
