"""Sensitivity of a sizing. Chapters: mount, level, stop law, and an input that is not Gaussian; the
ends of tolerances, and the worst within."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import Any, NamedTuple, Unpack

import numpy as np
import scipy
from scipy.special import gammaln, roots_genlaguerre

from stochvi.isolators.sizing.answer import Question, Sizing, are_uneven, mean_gaps
from stochvi.isolators.sizing.pairs import curve_of_gap, nominal_sizing
from stochvi.isolators.sizing.risk_curve import RiskCurve, chance_of_stops
from stochvi.isolators.tolerances import (
    WORST,
    Change,
    Region,
    SameRisk,
    Tolerances,
    all_applied,
    changed_stops,
    ends_of,
    ends_of_stops,
    worded,
)
from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.spectra import Table
from stochvi.mathematics.unsteady_noise import Hermite
from stochvi.model.model import model_of
from stochvi.results.base import DataFrame, frame_of
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged, StochviError
from stochvi.sampling.calculations import AccuracyOptions, WorkOptions, calculation
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.impact_laws import Restitution
from stochvi.scenes.scene import Scene

RESTITUTION_STEP, STIFFNESS_FACTOR = 0.1, 2.0
"""Change of the restitution, and factor on the stiffness, by which the stops of a scene are
varied."""

UNCHANGED = "none"
"""Name of the case in which nothing is changed."""

LEAST_SECONDS = 0.2
"""Seconds that a row takes at least: what is found in less rests on a handful of paths, and takes
as long all the same (measured)."""

CURVE_SHARE = 0.3
"""Share of the time of a row for the probabilities of an impact."""

KURTOSIS = 5.0
"""Kurtosis of an input that is not Gaussian; Gaussian noise has 3."""

RECORD_BITS = 16
"""Binary logarithm of the number of samples in a record that is not Gaussian."""

RECORDS = 32
"""Number of records that are not Gaussian: the standard error of the kurtosis is about 0.02."""

SAMPLES_PER_PERIOD = 2.5
"""Number of samples in a period of the highest frequency of the tables."""

ROUNDS = 10
"""Number of rounds in which first the law and then the density of a record is set."""

MODULATION_NODES = 200
"""Nodes of the Gauss-Laguerre rule over the variance of slow changes of the level."""


@calculation
@sampled(rel_error=0.1)
def sensitivity(sizing: Sizing, **options: Unpack[AccuracyOptions]) -> DataFrame:
    """Clearance for the same target, and risk at the old clearance, for changed scenes.

    Rows: natural frequency +-10 %, damping ratio +-30 % (or the tolerances of the isolator), level
    +-3 dB. Where the target depends on impacts, there is also the restitution +-0.1, or the
    stiffness of the stops times 2 and 1/2. All rows use the same random numbers. Where the target
    is the probability of any impact of one mass, two more rows take the input as not Gaussian: a
    kurtosis of 5 at the same density. It comes from fast peaks, by a monotone transform of the
    input; the mount averages many of them. Or the level itself changes, slowly against the memory
    of the response: see `slow_bursts`.

    Parameters
    ----------
    sizing
        The answer of `size` that is varied.
    **options
        `AccuracyOptions`: `rel_error` is that of the risk of each row, by default 0.1. The rows
        share the `budget` evenly.

    Returns
    -------
    pandas.DataFrame
        `change`; `sigma` (m); `clearance` (m, from the mean position of the sizing, so that the
        stops reach a mean position that has moved); `clearance_change` (relative to that of the
        sizing); `probability` (of any impact in the mission at the clearance of the sizing); `note`
        (why a row has no numbers, or not the accuracy wanted; else empty). With several pairs the
        clearance of each sized one stands under its name, in place of `sigma` and `clearance`, and
        `clearance_change` is the largest.

    See Also
    --------
    stochvi.size : The clearance itself.

    Examples
    --------
    >>> from stochvi.isolators.sizing.size import size
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Isolator
    >>> scene = Scene(
    ...     structure=Isolator(frequency_hz=10.0, zeta=0.05),
    ...     excitations=[WhiteNoise(density=0.01, unit="g2/Hz")],
    ... )
    >>> table = sensitivity(size(scene, probability=0.01, rel_error=0.2))
    >>> louder = table.set_index("change").loc["level +3 dB"]
    >>> round(float(1.0 + louder["clearance_change"]), 3)
    1.413
    """
    run = Run.of(options)
    again = Resizing(sizing=sizing, run=run)
    rows = again.rows(list(variations(sizing)))
    curve = again.curves.get(UNCHANGED)
    by_curve = sizing.target.name == "probability" and not run.deadline.passed()
    # beside sines an input that is not Gaussian has no curve of its own
    if curve and by_curve and not model_of(sizing.scene).sines:
        rows += _not_gaussian(sizing, curve, run.seed, run.deadline)
    if run.deadline.interrupted:
        raise run.deadline.fell_short("before all rows were known", "", frame_of(rows))
    return frame_of(rows)


def variations(sizing: Sizing) -> Iterator[tuple[str, Scene]]:
    """The changed scenes, each with its change in words."""
    scene = sizing.scene
    yield UNCHANGED, scene
    for change in ends_of(Tolerances.of(scene, usual=True)):
        yield change.words, change.applied(scene)
    if sizing.target.name != "probability":
        yield from _other_laws(scene)


@dataclass(frozen=True, kw_only=True)
class Resizing:
    """Sizes changed scenes for the target of a sizing, all within one run, which has the relative
    error of the risk of each.

    `curves` takes their risk curves by the name of the change, of one mass.
    """

    sizing: Sizing
    run: Run
    curves: dict[str, RiskCurve] = field(default_factory=dict)

    def rows(self, cases: Sequence[tuple[str, Scene]]) -> list[dict[str, Any]]:
        """The rows of changed scenes, each with its change in words; they share the time evenly."""
        rows, number = [], len(cases)
        for done, (change, scene) in enumerate(cases):
            self.run.tell(done / number, change)
            part = self.run.part(
                done / number,
                (done + 1) / number,
                change,
                self.run.deadline.share(1 / (number - done)),
            )
            rows.append(self.row(change, scene, part))
        return rows

    def row(self, change: str, scene: Scene, part: Run) -> dict[str, Any]:
        """The row of a changed scene, in a part of the run that gets no less than LEAST_SECONDS;
        where the scene cannot be sized, or no time is left, a row whose note says why."""
        try:
            if self.run.deadline.left < LEAST_SECONDS:
                raise self.run.deadline.fell_short("before this case", "raise budget")
            part = replace(part, deadline=part.deadline.in_no_less_than(LEAST_SECONDS))
            return self._row(change, scene, part)
        except (StochviError, Interrupted, ValueError) as reason:
            return row_of(change, self.sizing, {}, math.nan, note=str(reason))

    def _row(self, change: str, scene: Scene, run: Run) -> dict[str, Any]:
        """The row of a changed scene."""
        sizing, mission = self.sizing, self.sizing.mission
        curve, sigma = None, math.nan
        if not sizing.several:
            part = run.part(deadline=run.deadline.share(CURVE_SHARE), rel_error=0.5 * run.accuracy)
            curve = self.curves[change] = curve_of_gap(scene, sizing.target, mission, part)
            sigma = curve.sigma
        if curve is not None and sizing.target.name == "probability":
            found, note = {"clearance": curve.clearance(sizing.target.value)}, ""
        else:
            answer, note = self._sized(scene, run)
            found = dict(answer.named)
        # stops stay where they are, while a changed mount hangs elsewhere
        shift = mean_gaps(model_of(scene)) - mean_gaps(model_of(sizing.scene))
        towards = np.array([[-1.0], [1.0]]) * shift
        moved = np.where(np.isfinite(sizing.stops), towards, -math.inf).max(axis=0)
        clearances = {
            name: max(found[name].value + float(moved[k]), 0.0)
            for name, k in zip(sizing.named, sizing.sized_pairs, strict=True)
        }
        stops = sizing.stops - towards
        if curve is not None and not are_uneven(stops[np.isfinite(stops)]):
            chance = curve.probability(float(stops.min()))
        else:
            part = run.part(deadline=run.deadline.share(CURVE_SHARE))
            chance = chance_of_stops(scene, stops, mission, part).value
        return row_of(change, sizing, clearances, chance, sigma=sigma, note=note)

    def _sized(self, scene: Scene, run: Run) -> tuple[Sizing, str]:
        """The sizing of a changed scene for the same target, and a note where it is not as accurate
        as asked for."""
        sizing = self.sizing
        called = sizing.provenance.get("call", {}).get("arguments", {})
        # the change is the tolerance: those that the scene states are not added to it
        asked = Question(
            target=sizing.target, mission=sizing.mission, run=run, tolerances=Tolerances(),
            impacts=False, at=called.get("at"), pair=sizing.pair, common=sizing.common,
        )  # fmt: skip
        try:
            return nominal_sizing(scene, asked), ""
        except (NotConverged, Interrupted) as reason:
            if reason.partial is None:
                raise
            return reason.partial, str(reason)


def row_of(
    change: str, sizing: Sizing, clearances: Mapping[str, float],
    probability: float, *, sigma: float = math.nan, note: str = "",
) -> dict[str, Any]:  # fmt: skip
    """A row of changed scenes, with the clearance of one mass or that of each sized pair under its
    name; NaN for what is not known."""
    old = {name: each.value for name, each in sizing.named.items()}
    first = {} if sizing.several else {"sigma": sigma}
    new = {name: clearances.get(name, math.nan) for name in old}
    return {
        "change": change,
        **first,
        **new,
        "clearance_change": max(new[name] / old[name] for name in old) - 1.0,
        "probability": probability,
        "note": note,
    }


def _other_laws(scene: Scene) -> Iterator[tuple[str, Scene]]:
    """Scenes whose stops lose less and more energy, or are softer and stiffer."""
    laws = [law for pair in scene.impact_pairs for _, law in pair.stops()]
    if any(isinstance(law, Restitution) for law in laws):
        for amount in (-RESTITUTION_STEP, RESTITUTION_STEP):
            yield f"restitution {amount:+g}", changed_stops(scene, restitution=amount)
    if not all(law.rigid for law in laws):
        for factor in (1.0 / STIFFNESS_FACTOR, STIFFNESS_FACTOR):
            yield f"stiffness of the stops x {factor:g}", changed_stops(scene, stiffness=factor)


def _not_gaussian(
    sizing: Sizing, curve: RiskCurve, seed: int, deadline: Deadline
) -> list[dict[str, Any]]:
    """Rows for the two ways in which an input can exceed the kurtosis of Gaussian noise. They
    follow from the risk curve of the scene under Gaussian noise."""
    sigma, old = curve.sigma, sizing.clearance.value
    rows = []
    try:
        measured = fast_peaks(sizing.scene, KURTOSIS, seed=seed, deadline=deadline)
    except NotApplicable:
        pass
    else:
        hermite = Hermite.of(max(measured.response_kurtosis, 3.0))
        needed = sigma * hermite(curve.clearance(sizing.target.value).value / sigma)
        gaussian = sigma * hermite.inverse(old / sigma)
        change = (
            f"input kurtosis {measured.input_kurtosis:.3g} by fast peaks "
            f"(response {measured.response_kurtosis:.3f})"
        )
        chance = curve.probability(gaussian)
        rows.append(row_of(change, sizing, {"clearance": needed}, chance, sigma=sigma))
    mission = sizing.mission
    wanted = sizing.target.value
    top = old
    while slow_bursts(curve, top, KURTOSIS, mission) > wanted:
        top *= 1.5
    # in sigma: the absolute tolerance of the search has no unit then
    needed = sigma * scipy.optimize.brentq(
        lambda u: slow_bursts(curve, u * sigma, KURTOSIS, mission) - wanted,
        0.5 * old / sigma,
        top / sigma,
        rtol=1e-6,
    )
    change = f"input kurtosis {KURTOSIS:g} by slow changes of level"
    chance = slow_bursts(curve, old, KURTOSIS, mission)
    rows.append(row_of(change, sizing, {"clearance": float(needed)}, chance, sigma=sigma))
    return rows


class PassedKurtosis(NamedTuple):
    """Kurtosis of an input record and of the response to it, with its standard error."""

    input_kurtosis: float
    response_kurtosis: float
    standard_error: float


def fast_peaks(
    scene: Scene, kurtosis: float, *, seed: int = 0, records: int = RECORDS,
    deadline: Deadline = NEVER,
) -> PassedKurtosis:  # fmt: skip
    """How much of the kurtosis of an input with fast peaks a mount lets through.

    Records of the tabulated input are given the law of `Hermite` and their own density in turn,
    until they have both; the density last, so that it is exact. White noise, of which the mount
    averages infinitely many values, has no kurtosis to pass. Once the deadline has passed, no
    record but the first two is begun.

    Raises
    ------
    NotApplicable
        If the scene has no tabulated noise.
    """
    model = model_of(scene)
    tables = model.acceleration_tables
    if not tables:
        raise NotApplicable(
            "fast_peaks",
            "excitation must hold a table (kind = 'psd', 'road' or 'record'), got none; give one",
        )
    length = 2**RECORD_BITS
    highest = max(float(table.frequency_hz[-1]) for table in tables)
    frequency: Vector = np.fft.rfftfreq(length, 1.0 / (SAMPLES_PER_PERIOD * highest)).astype(float)
    amplitude = np.sqrt(_density(tables, frequency))
    gain = np.zeros(len(frequency), complex)
    w = 2.0 * math.pi * frequency[1:]
    gain[1:] = 1.0 / (model.omega**2 - w**2 + 1j * model.damping_rate * w)
    random = np.random.default_rng([seed, length])
    ranks = np.sort(Hermite.of(kurtosis)(np.sort(random.standard_normal(length))))
    found = []
    for _ in range(records):
        spectrum = amplitude * np.exp(2j * math.pi * random.random(len(amplitude)))
        for _ in range(ROUNDS):
            record = np.fft.irfft(spectrum, length)
            shaped = np.empty(length)
            shaped[np.argsort(record)] = ranks
            phase = np.fft.rfft(shaped)
            spectrum = amplitude * np.exp(1j * np.angle(phase))
        response = np.fft.irfft(gain * spectrum, length)
        found.append([_kurtosis(np.fft.irfft(spectrum, length)), _kurtosis(response)])
        if len(found) > 1 and deadline.passed():
            break
    mean = np.mean(found, axis=0)
    error = float(np.std(found, axis=0, ddof=1)[1] / math.sqrt(len(found)))
    return PassedKurtosis(float(mean[0]), float(mean[1]), error)


def _density(tables: tuple[Table, ...], frequency: Vector) -> Vector:
    density = np.zeros_like(frequency)
    for table in tables:
        density[1:] += table(frequency[1:])
    return density


def _kurtosis(record: Vector) -> float:
    return float(np.mean(record**4) / np.mean(record**2) ** 2)


def slow_bursts(curve: RiskCurve, clearance: float, kurtosis: float, mission: float) -> float:
    """Probability of any impact where the variance of the input changes slowly, as in a gamma
    distribution.

    With the variance m of unit mean and shape n, the kurtosis is 3 (1 + 1 / n). Let m change slowly
    against the memory of the response, and often in the mission. The rate of first impacts is then
    the mean of lambda(clearance / sqrt m) over m. This is an upper limit for the effect of a
    kurtosis.

    Examples
    --------
    >>> from stochvi.sampling.calculations import DEFAULTS
    >>> from stochvi.sampling.run import Run
    >>> from stochvi.sampling.workers import pool_of
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Isolator
    >>> scene = Scene(
    ...     structure=Isolator(frequency_hz=10.0, zeta=0.05),
    ...     excitations=[WhiteNoise(density=0.01, unit="g2/Hz")],
    ... )
    >>> from stochvi.isolators.sizing.answer import Target
    >>> target = Target(name="probability", value=0.01, unit="1")
    >>> with pool_of(None, 1) as pool:
    ...     run = Run.of({**DEFAULTS, "executor": pool, "rel_error": 0.1})
    ...     curve = curve_of_gap(scene, target, 3600.0, run)
    >>> level = 5.6 * curve.sigma
    >>> slow_bursts(curve, level, 3.001, 3600.0) / curve.probability(level) < 1.05
    True
    """
    shape = 3.0 / (kurtosis - 3.0)
    if shape > 100.0:
        nodes, weights = _nearly_constant(shape)
    else:
        nodes, weights = roots_genlaguerre(MODULATION_NODES, shape - 1.0)
        nodes = nodes / shape
        weights = weights / math.exp(gammaln(shape))
    rates = [curve.first_rate(clearance / math.sqrt(m)) for m in nodes]
    return -math.expm1(-mission * float(np.dot(weights, rates)))


def _nearly_constant(shape: float) -> tuple[Vector, Vector]:
    """Nodes and weights for a gamma distribution of large shape, which is nearly Gaussian with
    variance 1 / shape."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(9)
    return 1.0 + nodes / math.sqrt(shape), weights / math.sqrt(2.0 * math.pi)


# ------------------------------------------------------------------------------
# The clearance that the same target needs at the ends of tolerances, and at the worst within.
# ------------------------------------------------------------------------------


REL_ERROR = 0.2
"""Relative error of the risk of a changed scene: that of its clearance c is 0.2 sigma^2 / c^2, some
1 %, because the risk falls nearly as exp(-c^2 / (2 sigma^2))."""

FIRST_SHARE = 0.3
"""Share of the time for the worst place; the single changes share the rest evenly."""


@sampled
def worst_case(
    sizing: Sizing, tolerances: Tolerances | None = None,
    **options: Unpack[WorkOptions],
) -> DataFrame:  # fmt: skip
    """Clearances for the target of a sizing with mount, level and stops within their tolerances.

    Every row is a scene of its own that is sized for the target, with the seed of the sizing. The
    last row is the largest requirement of the whole region, of several pairs for each by itself.
    The places where linear theory asks for most (`Region.worst`) are sized like the others, with
    the stiffness of the stops at both ends. No row is larger.

    Parameters
    ----------
    tolerances
        By default those of the sizing.
    **options
        `WorkOptions`: `budget` is that of all rows together.

    Returns
    -------
    pandas.DataFrame
        The columns of `sensitivity`, clearances from the mean position of the sizing. The first row
        is the sizing itself, the last one, where there are tolerances, the worst.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Isolator
    >>> from stochvi.scenes.scene import Scene
    >>> scene = Scene(
    ...     structure=Isolator(frequency_hz=10.0, zeta=0.05),
    ...     excitations=[WhiteNoise(density=0.01, unit="g2/Hz")],
    ... )
    >>> from stochvi.isolators import size
    >>> table = worst_case(size(scene, probability=0.01, rel_error=0.2), Tolerances(level_db=3.0))
    >>> table["change"].iloc[-1]
    'worst within all tolerances: level +3 dB'
    """
    scene = sizing.scene
    run = replace(Run.of(options), seed=sizing.seed, rel_error=REL_ERROR)
    again = Resizing(sizing=sizing, run=run)
    tolerances = tolerances or sizing.allowed
    by_hits = sizing.target.name != "probability"
    stops = ends_of_stops(scene, tolerances.felt(scene, by_hits=by_hits))
    nominal = {name: each.value for name, each in sizing.named.items()}
    chance = math.nan if sizing.any_hit is None else sizing.any_hit
    rows = [row_of("as stated", sizing, nominal, chance, sigma=sizing.sigma)]
    ends = ends_of(tolerances)
    if not ends and not stops:
        return frame_of(rows)

    run.tell(0.0, "the worst place within the tolerances")
    try:
        linear = _linear_worst(sizing, tolerances, run.deadline)
    except (NotConverged, Interrupted) as reason:
        worst = [row_of(WORST, sizing, {}, math.nan, note=str(reason))]
    else:
        places = [(*each, end) for each in linear for end in stops] or linear
        first = run.deadline.share(FIRST_SHARE / len(places))
        worst = [
            again.row(worded(place), all_applied(place, scene), run.part(0.0, 0.0, deadline=first))
            for place in places
        ]
    rows += again.rows([(change.words, change.applied(scene)) for change in (*ends, *stops)])
    return frame_of([*rows, _largest(worst, rows[1:], [*nominal])])


def _largest(
    worst: list[dict[str, Any]], rows: list[dict[str, Any]], names: list[str]
) -> dict[str, Any]:
    """The largest clearance of each name in some rows; a worst place that was not sized leaves it
    unknown."""
    unknown = [row for row in worst if any(math.isnan(row[name]) for name in names)]
    known = [row for row in (*worst, *rows) if not any(math.isnan(row[name]) for name in names)]
    of = {name: unknown[0] if unknown else max(known, key=itemgetter(name)) for name in names}
    places: dict[str, list[str]] = {}
    for name, row in of.items():
        places.setdefault(row["change"], []).append(name)
    words = "; ".join(
        place if len(places) == 1 else f"{place} ({', '.join(at)})" for place, at in places.items()
    )
    return {
        **max(of.values(), key=itemgetter("clearance_change")),
        **{name: row[name] for name, row in of.items()},
        "change": WORST if words == WORST else f"{WORST}: {words}",
        "probability": max(row["probability"] for row in of.values()),
        "note": "; ".join(filter(None, dict.fromkeys(row["note"] for row in of.values()))),
    }


def _linear_worst(
    sizing: Sizing, tolerances: Tolerances, deadline: Deadline
) -> list[tuple[Change, ...]]:
    """Where in the region linear theory asks for the largest clearance of each sized pair."""
    region, harm = Region(sizing.scene, tolerances), 1.0
    if sizing.target.exceedance is not None:
        harm = min(sizing.target.exceedance / (sizing.any_hit or 1.0), 1.0)
    names = sizing.pairs["pair"].tolist()
    common = [names.index(name) for name in sizing.common]
    same = SameRisk(nominal=region.nominal, stops=sizing.stops, harm=harm, common=common)
    found = region.worst(same, deadline)
    return list(dict.fromkeys(found[k][1] for k in sizing.sized_pairs))
