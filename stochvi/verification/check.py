"""Agreement of the methods. Chapters: `check`, whether methods agree within the errors that they
state; `check_many` and `zoo`; `explain`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.methods.averaging import average
from stochvi.methods.averaging import unmet as unmet_by_averaging
from stochvi.methods.closed_form import exact
from stochvi.methods.closed_form import unmet as unmet_by_closed_form
from stochvi.methods.fokker_planck import fokker_planck
from stochvi.methods.fokker_planck import unmet as unmet_by_fokker_planck
from stochvi.methods.linearisation import linearise
from stochvi.methods.monte_carlo import LEAST_PILOT_SECONDS, Prospect, prospect, simulate
from stochvi.model.coverage import NaturalMode, RestingGap, at_rest, natural_modes, scene_notes
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import unmet as unmet_by_simulation
from stochvi.motion.modal_tables import seconds_of_plan
from stochvi.results.base import COMMON, DataFrame, Response, Result, frame_of, total_cost, unit_of
from stochvi.results.deadline import Deadline, Progress, ended_by, graceful_interrupt
from stochvi.results.errors import Interrupted, NoExactSolution, NotApplicable, NotConverged
from stochvi.results.estimates import (
    Estimate,
    normal_quantile,
    normal_score,
    provenance,
    reach,
    satterthwaite_degrees,
    student_quantile,
)
from stochvi.sampling.calculations import Random, calculation, check_options
from stochvi.scenes.datasets import zoo_files
from stochvi.scenes.excitations import BASE, RecordedNoise, TabulatedNoise
from stochvi.scenes.scene import Scene, load_scene

FAMILY_ALARM_RATE = 0.003
"""Probability that a check raises any alarm although all methods are right."""

BALANCE = "balance"
"""Quantity of a comparison in which the residual of a balance is compared with zero."""

STOPPED_EARLY = "simulate stopped early"
"""First words of the reason why a simulation fell short of the accuracy asked for."""

AGREES, DISAGREES, APPROXIMATE, TOO_RARE = "agrees", "DISAGREES", "approximate", "too rare"
BIAS_UNKNOWN = "bias unknown"
ZERO = "zero by construction"
"""Verdict on a sampled number that is zero on every path, so that nothing was compared: the mean
displacement where tables are synthesised, say, and the balance of force where nothing is hit."""

OTHER_THRESHOLD = "other threshold"
"""Verdict on a rate or mean speed by an approximation that counts impacts above another speed than
the reference."""

COUNTED = ("collision_rate", "impact_speed_mean")
"""First words of the quantities that depend on the slowest impact that is counted."""

SAME_THRESHOLD = 1e-3
"""Relative difference of two speed thresholds up to which they count as one."""

RARE = 0.2
"""Relative standard error of a quantity of impacts from which impacts are too few to judge it."""

SHARPER = 0.1
"""Relative error asked of the Fokker-Planck equation, as a multiple of the one asked of Monte
Carlo. On finer meshes the bounds on its error are safer, and it costs less than the simulation
anyway."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One quantity by two methods; `relative` is the difference in units of the reference.

    `score` is the part of the difference that the stated biases do not cover, in standard errors.
    It is on the scale of a normal variable, by Student's distribution where paths are few; None
    where nothing was sampled.

    See Also
    --------
    stochvi.check : The answer that holds it.
    """

    of: str
    quantity: str
    reference: str
    method: str
    reference_value: float
    value: float
    difference: float
    relative: float
    tolerance: float | None
    verdict: str
    score: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Check(Result):
    """The verdict on a scene, with every comparison and every response behind it.

    Its warnings are those of all responses, each once; the JSON document holds them with each
    response.

    See Also
    --------
    stochvi.check : The calculation.
    """

    kind = "check"
    in_document: ClassVar = {name: name for name in ("passed", "family_alarm_rate")}
    family_alarm_rate: ClassVar[float] = FAMILY_ALARM_RATE

    not_in_document = COMMON

    z: float
    comparisons: Sequence[Comparison]
    left_out: Sequence[str]
    responses: Sequence[Response]

    @property
    def passed(self) -> bool:
        """Whether something was judged as sharply as asked for, and nothing disagrees."""
        verdicts = {row.verdict for row in self.comparisons}
        return AGREES in verdicts and DISAGREES not in verdicts and not self.stopped_early

    @property
    def stopped_early(self) -> bool:
        """Whether the simulation fell short of the accuracy asked for."""
        return any(reason.startswith(STOPPED_EARLY) for reason in self.left_out)

    def _without_hits(self) -> bool:
        """Whether the scene has stops, and the simulation saw no impact on them."""
        rates = [
            estimate
            for response in self.responses
            for (_, name), estimate in response.estimates().items()
            if name == "collision_rate" and response.cost.paths
        ]
        return bool(rates) and all(rate.upper_95 is not None for rate in rates)

    def summary(self) -> str:
        """The verdict in a sentence."""
        judged = [row for row in self.comparisons if row.verdict in (AGREES, DISAGREES)]
        wrong = sum(row.verdict == DISAGREES for row in judged)
        if wrong:
            return f"{wrong} of {len(judged)} comparisons DISAGREE"
        if self.stopped_early:
            return next(reason for reason in self.left_out if reason.startswith(STOPPED_EARLY))
        if not judged and self._without_hits():
            return (
                "nothing could be judged: no impact was seen in the simulated time, and no second "
                "method that claims to be right covers this scene; raise budget, or ask "
                "reliability or size, which find rare impacts"
            )
        if not judged:
            return "nothing could be judged: no method that claims to be right covers this scene"
        balances = sum(row.of == BALANCE for row in judged)
        within = f"within {self.z:.2f} standard errors and the stated bias"
        if balances == len(judged):
            names = ", ".join(row.quantity for row in judged)
            return (
                f"only one method that can be judged covers this scene; its balances ({names}) "
                f"hold {within}, no second method confirms it"
            )
        return f"{len(judged)} comparisons ({balances} of them balances) agree {within}"

    def to_frame(self) -> DataFrame:
        """One row per comparison."""
        return frame_of(self.comparisons)


@dataclass(frozen=True, kw_only=True)
class MethodResponses:
    """The responses of all methods to one scene.

    `responses` come from methods that state their errors, the reference first. `approximations` are
    shown and not judged. `left_out` says why other methods did not answer.
    """

    responses: Sequence[Response]
    approximations: Sequence[Response] = ()
    left_out: Sequence[str] = ()

    @property
    def judged(self) -> int:
        """Number of comparisons and balances that can be judged."""
        if not self.responses:
            return 0
        known = self.responses[0].estimates()
        rivals = _shared(self.responses[1:], known)
        compared = sum(not _bias_unknown(rival[-1], known[rival[1], rival[2]]) for rival in rivals)
        return compared + sum(len(response.identities) for response in self.responses)


@calculation
def check(
    scene: Scene,
    *,
    rel_error: float = 0.003,
    seed: int = 0,
    rng: Random = None,
    threads: int | None = None,
    budget: float | None = 60.0,
    progress: Progress | None = None,
) -> Check:
    """Compare all methods that cover a scene, and the balances that a right answer obeys.

    Closed form, Fokker-Planck equation and Monte Carlo must agree within z standard errors plus the
    stated bias of mesh and step. The residuals of energy, virial and force must vanish within
    theirs. The standard error of a bias that was itself sampled counts like that of the value. z is
    set so that all comparisons together raise a false alarm with probability `FAMILY_ALARM_RATE`
    (Sidak). Where a standard error comes from few paths, Student's distribution widens it.
    `check_many` does this for several scenes. A quantity whose bias a method cannot state is not
    judged, nor is one that is zero on every path. Averaging and linearisation are approximations:
    their errors are shown, not judged, but for rates of impacts above another speed than that of
    the reference. Where the budget ends first, what was simulated by then is judged; after Ctrl-C
    `Interrupted` carries the verdict on that.

    Parameters
    ----------
    scene
        The scene.
    rel_error
        Relative standard error to reach.
    seed, rng
        Seed of the random numbers: the same seed gives the same digits. Or what draws one, a
        Generator of numpy.
    threads
        Number of threads; by default all cores.
    budget
        Seconds of wall time after which an answer is given with what was reached.
    progress
        Called now and then with the fraction done and a sentence on the accuracy reached.

    Returns
    -------
    Check
        The verdict, every comparison and every response.

    See Also
    --------
    stochvi.simulate : The same by Monte Carlo.
    stochvi.explain : What will be simulated, and which methods apply.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> check(scene, rel_error=0.01).passed
    True
    """
    check_options({"rel_error": rel_error, "seed": seed, "budget": budget, "threads": threads})
    deadline = Deadline.after(budget)
    with graceful_interrupt():
        found = answers(
            scene, rel_error=rel_error, seed=seed, threads=threads, deadline=deadline,
            progress=progress,
        )  # fmt: skip
    verdict = compare(found.responses, found.approximations, found.left_out)
    if deadline.interrupted:
        raise deadline.fell_short("before all methods had answered", "", verdict)
    return verdict


def answers(
    scene: Scene,
    *,
    rel_error: float,
    seed: int = 0,
    threads: int | None = None,
    deadline: Deadline,
    progress: Progress | None = None,
) -> MethodResponses:
    """The responses of every method that covers a scene; the arguments are those of `check`, and
    the deadline that ends the simulation."""
    left_out: list[str] = []
    responses: list[Response] = []
    simulated: list[Response] = []
    solvable = not unmet_by_fokker_planck(model_of(scene))
    try:
        responses.append(exact(scene))
    except NoExactSolution as reason:
        left_out.append(str(reason))
    # the approximations have no budget of their own; the simulation gets the time that they leave
    not_approximated: list[str] = []
    approximate = approximations(scene, not_approximated)
    sampling = deadline.sooner(FOR_SOLVER) if solvable else deadline
    try:
        simulated.append(
            simulate(
                scene,
                rel_error=rel_error,
                seed=seed,
                threads=threads,
                budget=sampling.rest,
                progress=progress,
                speed_threshold=0.0 if responses else None,  # the closed form counts all impacts
            )
        )
    except NotApplicable as reason:
        left_out.append(str(reason))
    except (NotConverged, Interrupted) as reason:
        left_out.append(f"{STOPPED_EARLY}, judged by what it reached: {reason}")
        if reason.partial is not None:
            simulated.append(reason.partial)
    if deadline.interrupted:
        left_out.append("fokker_planck: interrupted by Ctrl-C")
    else:
        responses += _solved(scene, SHARPER * rel_error, simulated, left_out, deadline)
    return MethodResponses(
        responses=[*responses, *simulated],
        approximations=approximate,
        left_out=[*left_out, *not_approximated],
    )


FOR_SOLVER = 0.1
"""Share of the time that a simulation leaves to the Fokker-Planck solver, where that applies."""


def _solved(
    scene: Scene, rtol: float, simulated: Sequence[Response], left_out: list[str],
    deadline: Deadline,
) -> list[Response]:  # fmt: skip
    """The Fokker-Planck response; its rates count impacts above the speed that simulation uses."""
    thresholds = [
        threshold
        for found in simulated
        for pair in found.impact_pairs.values()
        if isinstance(threshold := pair["speed_threshold"], float)
    ]
    threshold = next(iter(thresholds), None)
    try:
        return [fokker_planck(scene, rtol=rtol, speed_threshold=threshold, budget=deadline.rest)]
    except NotApplicable as reason:
        left_out.append(str(reason))
    except (NotConverged, Interrupted) as reason:
        # its bias states the accuracy that it has reached
        return [] if reason.partial is None else [reason.partial]
    return []


def approximations(scene: Scene, left_out: list[str]) -> list[Response]:
    """Responses by averaging and by every form of linearisation that covers the scene.

    The reasons why others do not are appended to `left_out`.
    """
    found = []
    try:
        found.append(average(scene))
    except NotApplicable as reason:
        left_out.append(str(reason))
    for form in ("closure", "motion", "force") if scene.expanded.impact_pairs else ("closure",):
        try:
            found.append(linearise(scene, form=form))
        except (NotApplicable, NotConverged) as reason:
            left_out.append(f"linearise:{form}: {_conditions(reason)}")
    return found


def compare(
    responses: Sequence[Response],
    approximations: Sequence[Response] = (),
    left_out: Sequence[str] = (),
    family: int | None = None,
) -> Check:
    """Judge `responses` against the first of them, and show the error of `approximations`.

    The first response is the reference. The others are judged against it, and the residuals of the
    balances of all responses against zero. `family` is the number of comparisons that share one
    alarm rate; by default all that are judged here.
    """
    everything = (*responses, *approximations)
    rows, z = _judged(responses, approximations, family) if responses else ([], 0.0)
    return Check(
        comparisons=tuple(rows),
        responses=everything,
        left_out=tuple(left_out),
        z=z,
        warnings=tuple(dict.fromkeys(each for found in everything for each in found.warnings)),
        cost=total_cost(found.cost for found in everything),
        provenance=responses[-1].provenance if responses else {},
    )


def _judged(
    responses: Sequence[Response], approximations: Sequence[Response], family: int | None
) -> tuple[list[Comparison], float]:
    """All comparisons, and the number of standard errors by which each may differ."""
    reference = responses[0]
    known = reference.estimates()
    judged = MethodResponses(responses=responses).judged
    alarm_rate = single_alarm_rate(max(judged if family is None else family, 1))
    rows = [_row(*rival, known, reference, alarm_rate) for rival in _shared(responses[1:], known)]
    rows += [
        _row(response, BALANCE, name, residual, {}, None, alarm_rate)
        for response in responses
        for name, residual in response.identities.items()
    ]
    rows += [_row(*shown, known, reference, None) for shown in _shared(approximations, known)]
    return rows, normal_quantile(alarm_rate)


def single_alarm_rate(family: int) -> float:
    """Probability of a false alarm of one comparison such that `family` independent comparisons
    together raise one with the probability `FAMILY_ALARM_RATE` (Z. Sidak 1967).

    >>> round(single_alarm_rate(20), 8)
    0.00015021
    """
    # log1p and expm1 keep the digits where the family is large
    return -math.expm1(math.log1p(-FAMILY_ALARM_RATE) / family)


def degrees_of_freedom(first: Response, second: Response | None, errors: Sequence[float]) -> float:
    """Degrees of freedom of the standard error of a difference, from the numbers of paths."""
    paths = [0 if response is None else response.cost.paths for response in (first, second)]
    return satterthwaite_degrees(errors, paths)


def _rare(estimate: Estimate) -> bool:
    """Whether so few impacts were seen that their standard error cannot be trusted."""
    simulated = estimate.standard_error > 0.0 or estimate.upper_95 is not None
    few = estimate.standard_error >= RARE * abs(estimate.value)
    return few and (simulated or estimate.how.startswith("no impact"))


def _bias_unknown(estimate: Estimate, known: Estimate) -> bool:
    """Whether one of two sampled estimates states no bias, so that the comparison cannot be
    judged."""
    return estimate.bias is None or known.bias is None


def _shared(
    responses: Sequence[Response], known: Mapping[tuple[str, str], Estimate]
) -> Iterator[tuple[Response, str, str, Estimate]]:
    """The estimates of each response that the reference has as well."""
    for response in responses:
        for (of, quantity), estimate in response.estimates().items():
            if (of, quantity) in known:
                yield response, of, quantity, estimate


def _vanish(size: float, *estimates: Estimate) -> bool:
    """Whether estimates and their standard errors are zero but for rounding."""
    return all(
        max(abs(each.value), each.standard_error) <= DETERMINISTIC_ERROR * size
        for each in estimates
    )


def counts_others(quantity: str, one: float, other: float) -> bool:
    """Whether a quantity depends on the slowest impacts that count, and two speed thresholds, m/s,
    differ."""
    return quantity.startswith(COUNTED) and abs(one - other) > SAME_THRESHOLD * max(one, other)


def threshold_of(response: Response, of: str) -> float:
    """Speed above which a response counts impacts of a pair, m/s; 0 where it counts all."""
    pair = response.impact_pairs.get(of)
    return 0.0 if pair is None else float(pair.get("speed_threshold") or 0.0)


DETERMINISTIC_ERROR = 1e-9
"""Relative error allowed to any deterministic number, for its quadrature and root finding."""


AT_REST = 1e-12
"""A quantity of a coordinate is rounding error below this part of the largest of all coordinates in
the same unit: the coordinate is at rest."""


def _largest(of: str, quantity: str, known: Mapping[tuple[str, str], Estimate]) -> float:
    """Largest value of a quantity among everything that has it in the same unit."""
    same = {other: each for (other, name), each in known.items() if name == quantity}
    return max(
        (
            abs(each.value)
            for other, each in same.items()
            if unit_of(other, quantity) == unit_of(of, quantity)
        ),
        default=0.0,
    )


def _row(
    response: Response,
    of: str,
    quantity: str,
    estimate: Estimate,
    known: Mapping[tuple[str, str], Estimate],
    reference: Response | None,
    alarm_rate: float | None,
) -> Comparison:
    """Compare an estimate with the reference, or the residual of a balance with 0.

    It is judged at an alarm rate, or only shown where that is None. Residuals are relative already;
    the difference of a mean, which may be zero, is relative to the standard deviation.
    """
    truth = known.get((of, quantity), Estimate(value=0.0))
    size = 1.0 if of == BALANCE else abs(truth.value)
    if quantity == "displacement_mean":
        size = known[of, "displacement_std"].value
    difference = estimate.value - truth.value
    tolerance, score, verdict = None, None, APPROXIMATE
    if alarm_rate is not None:
        errors: tuple[float, ...] = (estimate.standard_error, truth.standard_error)
        degrees = degrees_of_freedom(response, reference, errors)
        errors += (estimate.bias_error, truth.bias_error)
        rounding = AT_REST * _largest(of, quantity, known)
        biases = (estimate.bias or 0.0, truth.bias or 0.0, DETERMINISTIC_ERROR * size + rounding)
        tolerance = reach(student_quantile(alarm_rate, degrees), errors, biases)
        beyond = math.copysign(max(abs(difference) - sum(biases), 0.0), difference)
        score = normal_score(beyond, math.hypot(*errors), degrees)
        verdict = AGREES if abs(difference) <= tolerance else DISAGREES
        if (of, quantity) in known and of in response.impact_pairs and _rare(estimate):
            verdict = TOO_RARE
        elif of != BALANCE and _bias_unknown(estimate, truth):
            tolerance, verdict = None, BIAS_UNKNOWN
        elif response.cost.paths and _vanish(
            max(size, rounding / DETERMINISTIC_ERROR), estimate, truth
        ):
            tolerance, score, verdict = None, None, ZERO
    elif reference is not None and counts_others(
        quantity, threshold_of(response, of), threshold_of(reference, of)
    ):
        verdict = OTHER_THRESHOLD
    return Comparison(
        of=of,
        quantity=quantity,
        reference="identity" if reference is None else reference.method,
        method=response.method,
        reference_value=truth.value,
        value=estimate.value,
        difference=difference,
        relative=difference / size if size else 0.0,
        tolerance=tolerance,
        verdict=verdict,
        score=score,
    )


# ------------------------------------------------------------------------------
# `check_many`: one verdict over many scenes; and `zoo`, the scenes that ship for it.
# ------------------------------------------------------------------------------


WORST_SHOWN = 3
"""Number of comparisons that the summary of a failed check names."""


def zoo(*names: str) -> dict[str, Scene]:
    """The scenes of `data/scenes/zoo` by name: all of them, or those of the names given.

    Parameters
    ----------
    *names
        Names of scenes of the zoo; none for all.

    Returns
    -------
    dict[str, Scene]
        Scenes by name.

    See Also
    --------
    stochvi.verification.check_many : Checks them all.
    stochvi.scenes.shipped_scene : The file of one scene.

    Examples
    --------
    >>> scenes = zoo("linear", "lossy-0.5")
    >>> scenes["lossy-0.5"].effects()
    ('white noise on x', 'rigid stop lower', 'rigid stop upper')
    >>> len(zoo()) >= 60
    True
    """
    files = zoo_files()
    unknown = [name for name in names if name not in files]
    if unknown:
        raise ValueError(
            f"names must be those of scenes of the zoo, got {unknown[0]!r}; known: "
            f"{', '.join(files)}"
        )
    return {name: load_scene(files[name]) for name in names or files}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Checks(Result):
    """The verdict on many scenes, whose comparisons share one alarm rate.

    `judged` is the number of comparisons, and `z` the number of standard errors by which each of
    them may differ.

    See Also
    --------
    stochvi.verification.check_many : The calculation.
    """

    kind = "check"
    in_document: ClassVar = {
        "passed": "passed", "summary": "summary", "family_alarm_rate": "family_alarm_rate",
        "alarms": "alarms_in_rows", "scenes": "scenes",
    }  # fmt: skip
    not_in_document = ("checks", "seeds", *(name for name in COMMON if name != "warnings"))
    family_alarm_rate: ClassVar[float] = FAMILY_ALARM_RATE

    checks: Mapping[str, Check]
    seeds: Mapping[str, int]
    judged: int
    z: float
    rel_error: float | None = None

    @property
    def passed(self) -> bool:
        """Whether every scene was judged as sharply as asked for, and nothing disagrees."""
        return bool(self.checks) and all(verdict.passed for verdict in self.checks.values())

    @property
    def alarms(self) -> list[tuple[str, Comparison]]:
        """Every comparison that disagrees, with the name of its scene before it."""
        return [
            (name, row)
            for name, verdict in self.checks.items()
            for row in verdict.comparisons
            if row.verdict == DISAGREES
        ]

    def summary(self) -> str:
        """The verdict in a sentence."""
        alarms = self.alarms
        failed = [name for name, verdict in self.checks.items() if not verdict.passed]
        if alarms:
            worst = "; ".join(
                f"{row.quantity}{' balance' if row.of == BALANCE else ''} of {name}"
                for name, row in alarms[:WORST_SHOWN]
            )
            return f"{len(alarms)} of {self.judged} comparisons DISAGREE: {worst}"
        if failed:
            first = failed[0]
            return f"{len(failed)} scenes were not judged: {first}: {self.checks[first].summary()}"
        return (
            f"{len(self.checks)} scenes, {self.judged} comparisons agree within {self.z:.2f} "
            f"standard errors and the stated bias (alarm rate of all together "
            f"{100.0 * FAMILY_ALARM_RATE:g} %)"
        )

    def to_frame(self) -> DataFrame:
        """One row per comparison of every scene."""
        return frame_of(
            {"scene": name, **vars(row)}
            for name, verdict in self.checks.items()
            for row in verdict.comparisons
        )

    def overview(self) -> DataFrame:
        """One row per scene: the methods, the numbers of comparisons, the largest score."""
        return frame_of(_line(name, verdict) for name, verdict in self.checks.items())

    def _shown(self) -> DataFrame:
        return self.overview()

    @property
    def alarms_in_rows(self) -> Sequence[Mapping[str, str | float | None]]:
        """The alarms, each a row."""
        return [{"scene": name, **vars(row)} for name, row in self.alarms]

    @property
    def scenes(self) -> Mapping[str, Mapping[str, Any]]:
        """The verdict on each scene in short."""
        return {
            name: {
                "passed": verdict.passed,
                "summary": verdict.summary(),
                "seed": self.seeds.get(name),
                "methods": _methods(verdict),
                "comparisons": verdict.comparisons,
                "left_out": verdict.left_out,
            }
            for name, verdict in self.checks.items()
        }


def _methods(verdict: Check) -> list[str]:
    """The methods that were judged, the reference first."""
    rows = [row for row in verdict.comparisons if row.verdict in (AGREES, DISAGREES)]
    names = [row.reference for row in rows if row.of != BALANCE] + [row.method for row in rows]
    return list(dict.fromkeys(names))


BALANCES_ONLY = "balances hold"
"""Verdict where only one method covers the scene: its balances hold, and nothing was compared."""


def _line(name: str, verdict: Check) -> dict[str, Any]:
    rows = [row for row in verdict.comparisons if row.verdict in (AGREES, DISAGREES)]
    scores = [abs(row.score) for row in rows if row.score is not None]
    return {
        "scene": name,
        "methods": ", ".join(_methods(verdict)),
        "comparisons": sum(row.of != BALANCE for row in rows),
        "balances": sum(row.of == BALANCE for row in rows),
        "largest score": max(scores, default=None),
        "verdict": _word(verdict),
    }


def _word(verdict: Check) -> str:
    judged = [row.of for row in verdict.comparisons if row.verdict in (AGREES, DISAGREES)]
    if verdict.passed:
        return "passed" if set(judged) != {BALANCE} else BALANCES_ONLY
    if any(row.verdict == DISAGREES for row in verdict.comparisons):
        return DISAGREES
    return "stopped early" if verdict.stopped_early else "not judged"


@calculation
def check_many(
    scenes: Mapping[str, Scene],
    *,
    rel_error: float = 0.01,
    seed: int = 0,
    rng: Random = None,
    threads: int | None = None,
    budget: float | None = None,
    progress: Progress | None = None,
) -> Checks:
    """`check` of many scenes, under one alarm rate for all their comparisons together.

    The probability that any comparison of any scene raises an alarm although all methods are right
    is `FAMILY_ALARM_RATE` (Sidak over all comparisons; this is safe where they depend on each
    other). Each scene gets random numbers of its own, from the seed and its place in `scenes`.

    Parameters
    ----------
    scenes
        The scenes by name; `zoo()` gives those that ship.
    rel_error, seed, rng, threads
        The same arguments as those of `check`.
    budget
        Seconds for the simulations of all scenes together, None for no limit; each may take its
        share of what is left. A scene that is not begun in time is not judged.
    progress
        Called with the fraction done and the name of a scene.

    Returns
    -------
    Checks
        The verdict on all scenes.

    Raises
    ------
    Interrupted
        After Ctrl-C; it carries the verdict on the scenes so far.

    See Also
    --------
    stochvi.check : One scene.
    stochvi.verification.zoo : The scenes that ship.

    Examples
    --------
    >>> found = check_many(zoo("linear", "elastic-half-sigma"), rel_error=0.05)
    >>> found.passed, len(found.checks)
    (True, 2)
    """
    check_options({"rel_error": rel_error, "seed": seed, "budget": budget, "threads": threads})
    seeds = dict(zip(scenes, seeds_of(seed, len(scenes)), strict=True))
    found: dict[str, MethodResponses] = {}
    deadline = Deadline.after(budget)
    with graceful_interrupt():
        for done, (name, scene) in enumerate(scenes.items()):
            if progress:
                progress(done / len(scenes), name)
            if deadline.passed():
                late = f"{STOPPED_EARLY}: no time was left for this scene; raise budget"
                found[name] = MethodResponses(responses=[], approximations=[], left_out=[late])
                continue
            found[name] = answers(
                scene, rel_error=rel_error, seed=seeds[name], threads=threads,
                deadline=deadline.sooner(1.0 - 1.0 / (len(scenes) - done)),
            )  # fmt: skip
    verdict = compare_many(found, seeds, rel_error)
    if deadline.interrupted:
        raise deadline.fell_short("before all scenes were checked", "", verdict)
    return verdict


def compare_many(
    found: Mapping[str, MethodResponses],
    seeds: Mapping[str, int] | None = None,
    rel_error: float | None = None,
) -> Checks:
    """Judge responses to many scenes under one alarm rate, as `check_many` does with its own."""
    judged = sum(each.judged for each in found.values())
    checks = {
        name: compare(each.responses, each.approximations, each.left_out, family=judged)
        for name, each in found.items()
    }
    return Checks(
        checks=checks,
        seeds=seeds or {},
        judged=judged,
        z=normal_quantile(single_alarm_rate(max(judged, 1))),
        rel_error=rel_error,
        warnings=tuple(f"{name}: {each}" for name in checks for each in checks[name].warnings),
        cost=total_cost(verdict.cost for verdict in checks.values()),
    )


def seeds_of(seed: int, count: int) -> Sequence[int]:
    """Seeds of `count` independent simulations, made of one seed.

    >>> seeds_of(0, 2) == seeds_of(0, 3)[:2], len(set(seeds_of(0, 100)))
    (True, 100)
    """
    words = np.random.SeedSequence(seed).generate_state(count, np.uint64)
    return [int(word >> np.uint64(1)) for word in words]


# ------------------------------------------------------------------------------
# `explain`: the effects in a scene, the methods that apply, and the price of a simulation.
# ------------------------------------------------------------------------------


APPLIES = "applies"

SECONDS = 10.0
"""Largest number of seconds that an explanation takes, if no kernel must be compiled."""

FOR_LINEARISATION = 0.3
"""Largest share of the budget in which a linearisation is tried; a method that is not through by
then applies all the same."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Explanation(Result):
    """The effects in a scene, and the methods that cover it.

    `methods` maps each method to "applies", or to the conditions that the scene does not meet.
    `natural_frequency_hz` and `modes` are those of the structure without stops. Under constant
    loads `rest` holds the displacements of rest (m; rotations in rad). `rest_of_gaps` holds where
    each gap rests and how far that is from its stops, m.

    See Also
    --------
    stochvi.explain : The calculation.
    """

    kind = "explain"

    not_in_document = COMMON

    effects: Sequence[str]
    absent: Sequence[str]
    methods: Mapping[str, str]
    assumptions: Sequence[str]
    notes: Sequence[str]
    natural_frequency_hz: Sequence[float]
    modes: Sequence[NaturalMode]
    rest: Mapping[str, float]
    rest_of_gaps: Mapping[str, RestingGap]
    simulation: Prospect | None

    def summary(self) -> str:
        """The effects that a simulation of the scene contains, or why there is none."""
        if not self.simulated:
            return f"not simulated: {self.methods['simulate']}"
        covered = sum(each == APPLIES for each in self.methods.values())
        return (
            f"simulated: {', '.join(self.effects)}; {covered} of {len(self.methods)} methods apply"
        )

    def with_start(self, seconds: float) -> Explanation:
        """The explanation whose price has some seconds more before the first path: of a command,
        those in which its process started and read the scene."""
        if self.simulation is None:
            return self
        start = self.simulation.start_seconds + seconds
        return replace(self, simulation=replace(self.simulation, start_seconds=start))

    @property
    def simulated(self) -> bool:
        """Whether `simulate` covers the scene."""
        return self.methods["simulate"] == APPLIES

    def to_frame(self) -> DataFrame:
        """One row per method: whether it applies, or the conditions that the scene does not
        meet."""
        return frame_of(
            {
                "method": list(self.methods),
                "applies": [found == APPLIES for found in self.methods.values()],
                "lacks": ["" if found == APPLIES else found for found in self.methods.values()],
            }
        )

    def _remarks(self) -> Sequence[str]:
        return (*self.notes, *self.warnings)


@calculation
def explain(scene: Scene, *, threads: int | None = None, budget: float = SECONDS) -> Explanation:
    """List the effects, the methods that apply, and the expected price of a simulation.

    An effect that is absent from the scene is absent from the compiled code. The price comes
    from a short pilot run on this machine.

    Parameters
    ----------
    scene
        The scene.
    threads
        Number of threads; by default all cores.
    budget
        Seconds for the whole explanation; the pilot run gets what is left, `PILOT_SECONDS` at most.

    Returns
    -------
    Explanation
        Effects, methods and the expected price.

    See Also
    --------
    stochvi.check : Whether all methods agree.
    stochvi.cost : Error against time.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> free = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> explain(free).absent[:5]
    ('filtered noise', 'tabulated noise', 'sine', 'constant load', 'modulation')
    """
    deadline = Deadline.after(budget)
    model, effects = model_of(scene), scene.effects()
    methods = {
        "exact": "; ".join(unmet_by_closed_form(model)) or APPLIES,
        "fokker-planck": "; ".join(unmet_by_fokker_planck(model)) or APPLIES,
        "average": "; ".join(unmet_by_averaging(model)) or APPLIES,
        "linearise": APPLIES,
    }
    trial = Deadline.after(deadline.part(FOR_LINEARISATION))
    try:
        with ended_by(trial.rest, patience=0.0):
            linearise(scene)
    except (NotApplicable, NotConverged) as reason:
        if isinstance(reason, NotApplicable) or not trial.passed():
            methods["linearise"] = _conditions(reason)
    simulation, notes = None, list(scene_notes(model))
    planning = seconds_of_plan(model)
    if planning > MOST_OF_THE_REST * deadline.left:
        methods["simulate"] = "; ".join(unmet_by_simulation(model)) or APPLIES
        notes.append(
            "the price of a simulation was not measured: its plan alone, for these coordinates "
            f"and lines of tables, takes about {planning:.2g} s, more than is left of the budget "
            f"of {deadline.budget:.2g} s; raise budget"
        )
    else:
        try:
            with ended_by(deadline.rest, patience=LEAST_PILOT_SECONDS):
                simulation = prospect(scene, threads=threads, budget=deadline.rest)
            methods["simulate"] = APPLIES
        except NotApplicable as reason:
            methods["simulate"] = _conditions(reason)
        except NotConverged as reason:
            methods["simulate"] = APPLIES
            notes.append(f"the price of a simulation was not measured: {reason}")
    modes = natural_modes(model)
    rest, rest_of_gaps = at_rest(model)
    return Explanation(
        effects=effects,
        absent=scene.absent_effects(),
        methods=methods,
        assumptions=(*_environments(scene), *scene.assumptions()),
        notes=(*notes, *scene.cautions()),
        natural_frequency_hz=[mode.frequency_hz for mode in modes],
        modes=modes,
        rest=rest,
        rest_of_gaps=rest_of_gaps,
        simulation=simulation,
        provenance=provenance(scene.document()),
    )


def explain_phases(
    scene: Scene, *, threads: int | None = None, budget: float = SECONDS
) -> dict[str, Explanation]:
    """The explanation of each phase of a mission, by its name; the steps of a phase that moves are
    explained by their first."""
    deadline = Deadline.after(budget)
    first = {phase.step_of or phase.name: phase for phase in reversed(scene.phases)}
    phases = list(reversed(first.items()))
    return {
        name: explain(
            phase.of(scene), threads=threads,
            budget=deadline.part(1.0 / (len(phases) - done)) or LEAST_PILOT_SECONDS,
        )
        for done, (name, phase) in enumerate(phases)
    }  # fmt: skip


MOST_OF_THE_REST = 0.5
"""Largest share of the time that is left which the plan of a simulation may take."""


def _environments(scene: Scene) -> list[str]:
    """A sentence on what was read of each table and record, with its rms value, to compare with its
    source."""
    found = []
    for each in scene.excitations:
        if isinstance(each, TabulatedNoise | RecordedNoise):
            where = scene.place(each)
            words, numbers = scene.place_in_words(each), each.numbers()
            name, source, extent = each.facts(words, numbers)[0]
            rms = numbers.get("rms", math.sqrt(each.table.mean_square()))
            size = f"{rms / STANDARD_GRAVITY:.4g} g" if where == BASE else f"{rms:.4g} N"
            found.append(f"{name[0].lower()}{name[1:]}: {source}, {extent}, {size} rms")
    return found


def _conditions(reason: NotApplicable | NotConverged) -> str:
    """Why a method does not answer, without the name of the method."""
    return str(reason).split(" does not apply: ", 1)[-1].rstrip(".")
