"""Probabilities that a mission goes wrong: any impact, too fast an impact, too high an
acceleration, a passage.

Three ways lead to a probability, and a pilot chooses between them. Crude simulation counts failed
missions. Splitting (`motion.missions`) copies the paths that come close, for probabilities
too small to count. First crossings (`first_crossings`) need no mission at all where the motion
before the first impact is stationary and Gaussian; `clusters` do the same for what follows a first
impact, and `rare_hits` splits records of any Gaussian noise for fast and sharp impacts, however
rare. What is chosen depends on the counts of the pilot alone, never on the clock nor on the seed of
the answer. The answer is a second stage that shares no random number with the pilot; it is enlarged
only where its error is clearly larger than the pilot let expect.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Unpack

import numpy as np

from stochvi.mathematics.units import outside_of_share
from stochvi.mathematics.unsteady_noise import MovingMean
from stochvi.model.coverage import beyond_one_oscillator, free_motion, not_gaussian, without_noise
from stochvi.model.model import Model, model_of
from stochvi.motion.missions import (
    MissionPlan,
    Start,
    impact_plan,
    passage_plan,
    settling_time,
)
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import TOO_FEW, provenance
from stochvi.sampling.calculations import calculation
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene
from stochvi.statistics.crossings import ShocksMeet, same_gaps
from stochvi.statistics.free_flights import is_followed
from stochvi.statistics.hardness import (
    Limit,
    hardness_of,
    limits_in,
    limits_of,
)
from stochvi.statistics.reliability.choice import (
    FIRST_CROSSINGS,
    MISSED,
    SMALL,
    Ends,
    Findings,
    Jobs,
    Way,
    by_conditioning,
    counted_hits,
    exceedance,
    first_hit,
    first_hit_in_pieces,
    first_hits_of_pairs,
    harder_hits_of_pairs,
    hits_of_pairs,
)
from stochvi.statistics.reliability.gaps import FIRST, MANY, among, at_once
from stochvi.statistics.reliability.missions import (
    Chance,
    Reliability,
    RiskOptions,
    of_phases,
    of_random_level,
)
from stochvi.statistics.trial_splitting import has_fast_peaks

FIRST_HITS = 0.4
"""Share of the budget that the probability of any impact may take where more is asked for."""

AS_MUCH = 1e-3
"""Probability that springs and dampers alone exceed an acceleration, from which on a warning states
it."""

MOUNTS = "springs or dampers that are functions"
"""Mounts on which the probability of any impact alone is known."""

AT_ONCE = 0.05
"""Share of P(hit) that falls to the start itself, from which on a warning states it."""


@calculation
@sampled(rel_error=0.05)
def reliability(
    scene: Scene,
    *,
    mission: float | None = None,
    barrier: float | Ends | None = None,
    at: str | None = None,
    pair: str | None = None,
    start: Start = "stationary",
    way: Way | None = None,
    confidence: float = 0.95,
    **options: Unpack[RiskOptions],
) -> Reliability:
    """Probability of any impact, of one too fast or too sharp, and expected impacts, in a mission.

    Parameters
    ----------
    scene
        One oscillator: under white noise with any rigid stops, or compliant stops; under any
        Gaussian noise and sines beside it, with stops, from a stationary start. Or a linear
        structure of several coordinates or pairs under the same, from that start. Shocks of one
        shape at random times may come beside the noise, for the probability of any impact, and
        the noise may have a kurtosis. It may have phases, which are then those of the mission.
    mission
        Duration, s; left out where the scene has phases.
    barrier
        For scenes without stops: B of abs(x) < B, or (lower, upper), one of which may be None, m
        from the position of the unloaded spring.
    at
        The coordinate, or the named point, whose acceleration is limited; by default every
        coordinate that is a length, not an angle. It counts while any stop is touched.
    pair
        Name of one of several pairs: the probability is then that of an impact on it, as if it
        alone had stops. By default it is that of an impact on any pair.
    start
        "rest", where spring and load balance; or "stationary". For an impact or a passage the
        stationary start is that without stops and barriers, and a start beyond one counts at once.
        For all else it is that with the stops.
    way
        "crude", "splitting" or "first crossings" instead of what the pilot would choose.
    confidence
        Confidence level of intervals.
    **options
        `RiskOptions`: limits of the hardest impact; `rel_error` is that of each probability and of
        the expected impacts, by default 0.05; `budget` is for all of them together, and the answer
        that an error carries names what is missing.

    Returns
    -------
    Reliability
        Intervals cover statistical errors; the bias of the step, |difference to twice the step| /
        (2^order - 1), is stated apart and holds that difference's own noise.

    Raises
    ------
    NotApplicable, NotConverged, ValueError
        With every condition that is not met; if the accuracy is not reached, or an event was never
        seen (its probability is then 0 with an upper limit) or is out of reach; if an argument is
        out of range.

    See Also
    --------
    stochvi.first_passage : The probability of a first passage.
    stochvi.size : The clearance that is needed.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> found = reliability(scene, mission=62.831853, barrier=5.7, start="rest", seed=1)
    >>> chance = found.chances["passage"]
    >>> chance.way, abs(chance.estimate.value - 7.29e-7) < 4.5 * chance.estimate.standard_error
    ('splitting', True)
    """
    run, hardest = Run.of(options), limits_in(options)
    if scene.phases:
        if mission is not None:
            whole = sum(phase.duration for phase in scene.phases)
            raise ValueError(
                f"mission must be left out where the scene has phases, of {whole:g} s together, "
                f"got {mission:g}"
            )

        def of_phase(phase: Scene, duration: float, part: Run) -> Reliability:
            return reliability(
                phase, mission=duration, barrier=barrier, at=at, pair=pair, start=start, way=way,
                confidence=confidence, **hardest, **part.options(rel_error=run.rel_error),
            )  # fmt: skip

        return of_phases(scene, of_phase, run)
    if mission is None:
        raise ValueError(
            "mission must be given where the scene has no phases, got none; an hour is 3600 in "
            "Python, --mission 1h on the command line"
        )
    _check(mission, hardest, start, way, run.accuracy, confidence)
    jobs = Jobs(run=run, confidence=confidence, deadline=run.deadline)
    model = model_of(scene)
    check_pair(model, pair)
    others = {"barrier": barrier, **hardest}
    if model.level is not None:
        return _at_varying_level(
            scene, mission, others, pair, run, confidence=confidence, start=start
        )
    in_pieces = is_followed(model)
    if in_pieces or model.drawn:
        drive = "noise with fast peaks" if has_fast_peaks(model) else "shocks"
        _check_any_impact(MOUNTS if model.functions else drive, scene, others, start)
    if in_pieces or model.drawn or not model.single:
        _check_several(model, barrier, start, way)
        limits = limits_of(scene, hardest, at)
        found = (
            _in_pieces(scene, pair, mission, jobs)
            if in_pieces
            else _of_pairs(scene, pair, limits, mission, way, jobs)
        )
        return _answered(scene, mission, start, found, jobs)
    if at is not None:
        raise ValueError(f"at is for several coordinates or pairs, got {at!r} for one oscillator")
    ends = _barriers(model, barrier)
    coloured = _is_coloured(scene, model, start, way)
    outside = _outside(model, ends)
    if outside and start == "rest":
        raise ValueError(
            f"start = 'rest' is out of reach: {outside}; move them, or take start = 'stationary'"
        )
    limits = limits_of(scene, hardest, at)
    if coloured:
        found = by_conditioning(scene, ends, limits, mission, jobs)
    else:
        found = _sampled(model, scene, ends, limits, mission, start, way, jobs)
    found.warnings += [
        *([f"{outside}: nearly every mission ends as it starts"] if outside else []),
        *_beyond_at_the_start(scene, model, ends, start, coloured, found.chances),
        *_by_the_spring(model, ends, limits),
    ]
    return _answered(scene, mission, start, found, jobs)


def _answered(
    scene: Scene, mission: float, start: Start, known: Findings, jobs: Jobs
) -> Reliability:
    """The answer with what was found; carried by an error where something was not, or not as
    accurately as asked for."""
    hits, missing = known.hits, known.missing | _inaccurate(known, jobs)
    found = Reliability(
        mission=mission, start=start, chances=known.chances,
        hits=None if hits is None else hits.estimate,
        hits_interval=None if hits is None else hits.interval, confidence=jobs.confidence,
        assumptions=[*_assumptions(scene, start), *known.notes], warnings=known.warnings,
        missing=missing, pairs=known.pairs, outputs=known.outputs, gaps=known.gaps,
        cost=jobs.run.cost(
            steps=sum(each.steps for each in known.chances.values()) + (hits.steps if hits else 0),
            paths=sum(each.trials for each in known.chances.values()),
        ),
        provenance=provenance(scene.document(), jobs.run.seed),
    )  # fmt: skip
    unfound = [name.replace("_", " ") for name in missing]
    if jobs.deadline.interrupted:
        verb = "was" if len(unfound) == 1 else "were"
        where = f"before {', '.join(unfound)} {verb} found"
        where = where if unfound else "before its errors were small enough"
        raise jobs.deadline.fell_short(where, "", found)
    if missing:
        reasons = zip(unfound, missing.values(), strict=True)
        raise NotConverged("; ".join(f"{name}: {why}" for name, why in reasons), found)
    if jobs.cut_short:
        where = f"before {' and '.join(jobs.cut_short)}"
        raise jobs.deadline.fell_short(where, "raise budget or rel_error", found)
    return found


def _at_varying_level(
    scene: Scene, mission: float, others: Mapping[str, object], pair: str | None, run: Run,
    *, confidence: float, start: Start,
) -> Reliability:  # fmt: skip
    """The risk of any impact under noise whose level varies."""
    _check_any_impact("noise of varying level", scene, others, start)

    def at_level(steady: Scene, duration: float, part: Run) -> Reliability:
        return reliability(
            steady, mission=duration, pair=pair, confidence=confidence,
            **part.options(rel_error=run.rel_error),
        )  # fmt: skip

    return of_random_level(scene, mission, at_level, run)


def _check_any_impact(drive: str, scene: Scene, others: Mapping[str, object], start: Start) -> None:
    """Raise an error for what is not known under a drive that is not Gaussian."""
    if unmet := [
        f"{name} must be left out with {drive}, where any impact alone is known, got {value}; "
        "simulate follows the motion"
        for name, value in others.items()
        if value is not None
    ]:
        raise NotApplicable("reliability", unmet)
    if start == "rest" or not scene.impact_pairs:
        got = "start = 'rest'" if start == "rest" else "a scene without impact_pair"
        raise NotApplicable(
            "reliability", f"stops and a stationary start are needed with {drive}, got {got}"
        )


def check_pair(model: Model, pair: str | None) -> None:
    """Raise ValueError if `pair` is given and is no pair of the scene."""
    names = [each.name for each in model.pairs]
    if pair is not None and pair not in names:
        raise ValueError(f"pair must be one of {', '.join(names) or '(none)'}, got {pair!r}")


def _check_several(model: Model, barrier: float | Ends | None, start: str, way: str | None) -> None:
    """Raise an error for arguments that several coordinates or pairs do not allow."""
    several = "where there are several coordinates or pairs"
    unmet = []
    if barrier is not None or not model.pairs:
        unmet.append(f"the scene needs an impact_pair for every gap, instead of barrier, {several}")
    if start == "rest":
        unmet.append(f"start must be 'stationary' {several}, got 'rest'")
    if way not in (None, "first crossings"):
        unmet.append(f"way must be 'first crossings' or left out {several}, got {way!r}")
    if unmet:
        raise NotApplicable("reliability", unmet)


def _alone(pair: str | None) -> list[str]:
    """A sentence on the one pair that was asked after."""
    return [] if pair is None else [f"every number is that of {pair}, as if it alone had stops"]


def _of_pairs(
    scene: Scene, pair: str | None, limits: list[Limit], mission: float, way: Way | None,
    jobs: Jobs,
) -> Findings:  # fmt: skip
    """What several pairs risk: of many, or where a contact is certain, what is known at once; where
    more is asked of many, the first of them are simulated."""
    model, known = model_of(scene), None
    if len(model.pairs) > MANY and pair is not None:
        return _simulated(_with_pairs(scene, [pair]), pair, limits, mission, jobs)
    if len(model.pairs) > 1 and pair is None and not model.drawn:
        try:
            known = at_once(model, mission)
        except NotApplicable as reason:
            raise NotApplicable("reliability", reason.conditions) from reason
    if known is not None and not limits and way is None:
        return known
    if known is None or len(model.pairs) <= MANY:
        return _simulated(scene, pair, limits, mission, jobs)
    first = [*known.gaps][:FIRST]
    try:
        found = _simulated(_with_pairs(scene, first), None, limits, mission, jobs)
    except NotApplicable as reason:
        if limits:
            raise
        known.warnings.append(f"the first gaps are not simulated: {'; '.join(reason.conditions)}")
        return known
    except (NotConverged, Interrupted) as error:
        known.missing["the first gaps together"] = str(error)
        return known
    found.chances = {event: among(each, known.gaps, first) for event, each in found.chances.items()}
    found.gaps = known.gaps
    return found


def _with_pairs(scene: Scene, names: Sequence[str]) -> Scene:
    """The scene with some of its pairs alone."""
    kept = tuple(each for each in scene.impact_pairs if each.name in names)
    return scene.model_copy(update={"impact_pairs": kept})


def _simulated(
    scene: Scene, pair: str | None, limits: list[Limit], mission: float, jobs: Jobs
) -> Findings:
    """The probability that any pair is hit, or any limit exceeded, expected impacts, and the risk
    of each pair."""
    model, some = model_of(scene), replace(jobs, deadline=jobs.deadline.sooner(1.0 - FIRST_HITS))
    found, overlap = Findings(notes=same_gaps(model)), 0.0
    try:
        found.chances["hit"], found.pairs, overlap = first_hits_of_pairs(scene, pair, mission, some)
    except ShocksMeet:
        hit = [pair] if pair else [each.name for each in model.pairs]
        found.chances["hit"] = counted_hits(scene, model, hit, mission, some)
    except NotApplicable as reason:
        raise NotApplicable("reliability", reason.conditions) from reason
    stopped = scene if pair is None else _with_pairs(scene, [pair])
    try:
        if model.drawn:
            sentence = (
                "impacts after the first one are not followed beside shocks; impacts counts all"
            )
            raise NotApplicable("expected impacts", sentence)
        if found.chances["hit"].estimate.value > 0.0:
            found.hits, found.pairs = hits_of_pairs(
                stopped, mission, overlap, found.pairs, jobs.sharing(len(limits))
            )
    except NotApplicable as reason:
        found.notes.append(f"expected impacts are not calculated: {'; '.join(reason.conditions)}")
    except (NotConverged, Interrupted) as error:
        found.missing["expected_hits"] = str(error)
    found.notes += _alone(pair)
    for number, limit in enumerate(limits):
        some = jobs.sharing(len(limits) - number - 1)
        try:
            harder, by_output = harder_hits_of_pairs(stopped, limit, mission, overlap, some)
        except (NotConverged, Interrupted) as error:
            found.missing[limit.event] = str(error)
            continue
        found.chances[limit.event] = harder
        found.outputs |= by_output
    found.warnings += [
        f"{limit.event} of {limit.value:.4g} {limit.kind.unit} is exceeded without any stop, with "
        f"a probability of {alone:.3g} at least; only contacts are counted here"
        for limit in limits
        if (alone := limit.kind.without_stops(model, limit, mission)) >= AS_MUCH
    ]
    return found


def _in_pieces(scene: Scene, pair: str | None, mission: float, jobs: Jobs) -> Findings:
    """The probability of any impact, by pieces of the motion without stops."""
    try:
        chance = first_hit_in_pieces(scene, pair, mission, jobs)
    except NotApplicable as reason:
        raise NotApplicable("reliability", reason.conditions) from reason
    where = MOUNTS if model_of(scene).functions else "noise with fast peaks"
    followed = f"impacts after the first one are not followed with {where}; impacts counts all"
    return Findings(chances={"hit": chance}, notes=[followed, *_alone(pair)])


def _sampled(
    model: Model, scene: Scene, ends: Ends, limits: list[Limit], mission: float,
    start: Start, way: Way | None, jobs: Jobs,
) -> Findings:  # fmt: skip
    """Answers under white noise, by missions, and by first crossings where the start allows it."""
    name, found, first = "hit" if model.stops else "passage", Findings(), None
    if way == "first crossings" or (way is None and start == "stationary"):
        more = bool(model.stops or limits)
        some = replace(jobs, deadline=jobs.deadline.sooner(1.0 - FIRST_HITS)) if more else jobs
        first = first_hit(scene, ends, mission, some, surely=way is not None)
    missions = None if way == "first crossings" else way
    plans: dict[str, MissionPlan] = {}
    if first is None:
        plans[name] = passage_plan(model, *ends, mission, start)
    else:
        found.chances[name] = first
    asked = {limit.event: limit for limit in limits}
    for each in limits:
        plans[each.event] = each.kind.missions(model, mission, start, each)
    if model.stops:
        # impacts of a stationary motion are proportional to its duration: a duration in which it
        # forgets its start suffices; it costs less than a long mission and shows more impacts than
        # a short one
        part = settling_time(model) if start == "stationary" else mission
        counted = impact_plan(model, part, start)
        try:
            found.hits = jobs.sharing(len(plans)).hits(counted, missions, mission / part)
        except (NotConverged, Interrupted) as error:
            found.missing["expected_hits"] = str(error)
    for done, (event, plan) in enumerate(plans.items()):
        some = jobs.sharing(len(plans) - done - 1)
        limit = asked.get(event)
        try:
            most = None if limit is None else limit.value
            found.chances[event] = some.chance(plan, event, most, missions)
        except (NotConverged, Interrupted) as error:
            guided = None
            if limit is not None and start == "stationary" and missions is None:
                guided = _without_energy(scene, limit, mission, some)
            if guided is None:
                found.missing[event] = str(error)
            else:
                found.chances[event] = guided
    return found


def _without_energy(scene: Scene, limit: Limit, mission: float, jobs: Jobs) -> Chance | None:
    """The probability where the energy did not guide a splitting to the event; None without time
    left, or where the stops leave out the mean position."""
    if jobs.deadline.passed():
        return None
    try:
        found = exceedance(scene, limit, mission, jobs)
    except NotApplicable:
        return None
    late = "a splitting by energy did not end in its share of the budget"
    return replace(found, why=f"{found.why}; {late}")


def _check(
    mission: float, limits: Mapping[str, float], start: str, way: str | None, rel_error: float,
    confidence: float,
) -> None:  # fmt: skip
    """Raise ValueError where an argument is out of range or contradicts another one."""
    asked = {"mission": (mission, "seconds")}
    asked |= {name: (limit, hardness_of(name).unit) for name, limit in limits.items()}
    for name, (value, unit) in asked.items():
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name} must be a positive number of {unit}, got {value}")
    if start not in ("rest", "stationary"):
        raise ValueError(f"start must be 'rest' or 'stationary', got {start!r}")
    if way not in (None, "crude", "splitting", "first crossings"):
        raise ValueError(
            f"way must be 'crude', 'splitting', 'first crossings' or None, got {way!r}"
        )
    if way == "first crossings" and start == "rest":
        raise ValueError("way = 'first crossings' needs start = 'stationary', got 'rest'")
    if not 1e-3 <= rel_error < 1.0:
        raise outside_of_share("rel_error", "in [1e-3, 1)", rel_error)
    if not 0.0 < confidence < 1.0:
        raise outside_of_share("confidence", "between 0 and 1", confidence)


def _barriers(model: Model, barrier: float | Ends | None) -> Ends:
    """Lower and upper stop, or barrier, m; checked."""
    if model.pairs:
        if barrier is not None:
            raise ValueError(
                "barrier must be left out where the scene has stops: the event is then an impact "
                "on them; leave barrier out, or take impact_pair out of the scene"
            )
        pair = model.pairs[0]
        lower, upper = (
            None if stop is None else stop.position for stop in (pair.lower, pair.upper)
        )
        return lower, upper
    if barrier is None:
        raise ValueError("barrier must be given where the scene has no impact_pair, got none")
    if isinstance(barrier, tuple):
        lower, upper = barrier
    else:
        lower, upper = -barrier, barrier
    known = [end for end in (lower, upper) if end is not None]
    crossed = lower is not None and upper is not None and lower >= upper
    if not known or not all(math.isfinite(end) for end in known) or crossed:
        raise ValueError(
            "barrier must be a positive number, or (lower, upper) with lower < upper, got "
            f"{barrier}"
        )
    return lower, upper


def _outside(model: Model, ends: Ends) -> str:
    """A sentence, if the position where spring and load balance does not lie between the stops or
    barriers; else an empty one. A mass may rest on a stop, but a barrier at its place is passed
    before the start."""
    rest = model.rest
    lower, upper = ends
    below = -math.inf if lower is None else lower
    above = math.inf if upper is None else upper
    if below < rest < above or (model.stops and rest in (below, above)):
        return ""
    what = "stops" if model.stops else "barriers"
    words = ("none" if end is None else f"{end:g} m" for end in ends)
    return f"spring and load balance at {rest:g} m, not between the {what} ({', '.join(words)})"


def _is_coloured(scene: Scene, model: Model, start: str, way: str | None) -> bool:
    """Whether the noise has a memory of its own; raises for what no way covers."""
    unmet = beyond_one_oscillator(model, with_filters=True, with_sines=True, with_speeds=True)
    unmet += not_gaussian(model)
    if unmet:
        raise NotApplicable("reliability", unmet)
    if unmet := without_noise(model):
        raise NotApplicable("reliability", unmet)
    if model.omega == 0.0:
        raise NotApplicable(
            "reliability",
            "structure.stiffness must be positive, since missions start at rest on the spring "
            "or in the motion without stops, got 0",
        )
    kinds = {excitation.kind for excitation in scene.excitations}
    coloured = not kinds <= {"white", "constant"}
    if coloured and start == "rest":
        raise NotApplicable(
            "reliability",
            "start = 'rest' needs white noise, got " + ", ".join(sorted(kinds - {"constant"})),
        )
    if coloured and way in ("crude", "splitting"):
        raise NotApplicable(
            "reliability", f"way = {way!r} needs white noise; leave way out under other noise"
        )
    return coloured


def _assumptions(scene: Scene, start: str) -> list[str]:
    found = list(scene.assumptions())
    if start == "rest":
        found.append("missions start at rest, where spring and load balance")
    else:
        found.append(
            "missions start in the stationary motion: without stops and barriers for an impact or "
            "a passage (a start beyond one counts at once), with stops for all else"
        )
    found.append("intervals cover statistical errors; the bias of the step is stated apart")
    return found


def _beyond_at_the_start(
    scene: Scene, model: Model, ends: Ends, start: str, coloured: bool, chances: dict[str, Chance]
) -> list[str]:
    """Warnings where much of P(hit) is the probability to start beyond the stops, where no impact
    happens."""
    chance = chances.get("hit") or chances.get("passage")
    if start == "rest" or chance is None:
        return []
    if coloured:
        (motion,) = free_motion(model, with_sines=True).moving_means(np.eye(1))
    else:
        std = math.sqrt(model.intensity / (2.0 * model.damping_rate)) / model.omega
        motion = MovingMean.still(std, model.omega * std)
    outside = sum(
        motion.beyond(side * (end - model.rest))
        for side, end in zip((-1.0, 1.0), ends, strict=True)
        if end is not None
    )
    if outside <= AT_ONCE * chance.estimate.value:
        return []
    hit = {"hit": True, "passage": False}[chance.event]
    beyond = "the stops" if hit else "the barriers"
    apart = (
        "; expected impacts, and all else, belong to the motion with the stops, and may be fewer"
        if hit
        else ""
    )
    return [
        f"{chance.event}: {outside:.3g} of it is the probability that the motion without {beyond} "
        f"is beyond them at the start already{apart}; start at rest to leave that out"
    ]


def _by_the_spring(model: Model, ends: Ends, limits: list[Limit]) -> list[str]:
    """Warnings where the spring alone exceeds a limit, since only contacts count."""
    farthest = max(abs(end - model.rest) for end in ends if end is not None)
    return [
        f"{limit.event} of {limit.value:.4g} {limit.kind.unit} is exceeded without any stop: the "
        f"spring alone brings {most:.4g} {limit.kind.unit} at a stop; only contacts are counted "
        "here"
        for limit in limits
        if (most := limit.kind.by_spring(model, farthest)) >= limit.value
    ]


def _inaccurate(known: Findings, jobs: Jobs) -> dict[str, str]:
    """Why what was found is not as accurate as asked for, by name."""
    # first crossings end once the probabilities below SMALL are known
    found = {
        name: each.estimate
        for name, each in known.chances.items()
        if each.way != FIRST_CROSSINGS or each.estimate.value < SMALL
    }
    if known.hits is not None:
        found["expected_hits"] = known.hits.estimate
    reasons = {}
    budget = jobs.deadline.budget
    if budget is None:
        ended = ""
    elif jobs.deadline.passed():
        ended = f" when the budget of {budget:g} s ended"
    else:
        ended = f" when its share of the budget of {budget:g} s ended"
    for name, estimate in found.items():
        if estimate.upper_95 is not None:
            seen = TOO_FEW if TOO_FEW in estimate.how else "not once"
            reasons[name] = (
                f"it was seen {seen}{ended}: it is at most {estimate.upper_95:.3g} "
                f"({100.0 * jobs.confidence:g} %); raise budget, or ask for a lower limit"
            )
        elif estimate.standard_error > MISSED * jobs.rel_error * estimate.value:
            error = estimate.standard_error / estimate.value
            remedies = [f"rel_error to {MISSED * error:.2g}"] if MISSED * error < 1.0 else []
            if budget is not None:
                remedies.append(f"budget to about {budget * (error / jobs.rel_error) ** 2:.0f} s")
            reasons[name] = (
                f"its relative error was {error:.2g}{ended}, asked for {jobs.rel_error:g}; raise "
                f"{' or '.join(remedies)}"
            )
    return reasons
