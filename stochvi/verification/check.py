"""`check`: whether all methods that cover a scene agree within the errors that they state."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stochvi.methods.averaging import average
from stochvi.methods.closed_form import exact
from stochvi.methods.fokker_planck import fokker_planck
from stochvi.methods.fokker_planck import unmet as unmet_by_fokker_planck
from stochvi.methods.linearisation import linearise
from stochvi.methods.monte_carlo import simulate
from stochvi.model.calculations import calculation
from stochvi.model.model import model_of
from stochvi.results.base import COMMON, Result, total_cost
from stochvi.results.deadline import Deadline, graceful_interrupt
from stochvi.results.errors import Interrupted, NoExactSolution, NotApplicable, NotConverged
from stochvi.results.estimates import Estimate
from stochvi.results.intervals import (
    normal_quantile,
    normal_score,
    reach,
    satterthwaite_degrees,
    student_quantile,
)
from stochvi.results.progress import Progress
from stochvi.results.quantity_units import unit_of
from stochvi.results.response import Response
from stochvi.sampling.options import check_options
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

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

    def __repr__(self) -> str:
        return f"<check: {self.summary()}>"

    def to_frame(self) -> pd.DataFrame:
        """One row per comparison."""
        import pandas as pd

        return pd.DataFrame([vars(row) for row in self.comparisons])

    def _document(self) -> dict[str, Any]:
        return {
            "method": "check",
            "passed": self.passed,
            "family_alarm_rate": FAMILY_ALARM_RATE,
            **super()._document(),
        }


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
    seed
        Seed of the random numbers: the same seed gives the same digits.
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
            left_out.append(f"linearise:{form}: {reason}")
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
