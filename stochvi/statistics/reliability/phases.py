"""The risk of a mission of several phases, from the risks of its phases.

Each phase starts in its own stationary motion, and the phases are independent, so that

    P = 1 - (1 - P_1) (1 - P_2) ...

The interval is made of the hazards -ln(1 - P_k), whose sum it is: their half widths are added as
roots of sums of squares, each side for itself (G. Y. Zou and A. Donner, Construction of confidence
limits about effect measures: a general approach, Statistics in Medicine 27, 2008, 1693).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.model.free_motion import free_motion
from stochvi.model.model import Model, model_of
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Cost, Estimate, provenance
from stochvi.sampling.run import Run
from stochvi.scenes.phases import Phase, bias_of_steps, steps_of_bands
from stochvi.scenes.scene import Scene
from stochvi.statistics.mission_parts import INDEPENDENT, asked_in_parts, complete
from stochvi.statistics.reliability.answer import Chance, Reliability

CERTAIN = 1.0 - 1e-15
"""A larger probability counts as this one, so that its hazard is finite."""

NEGLIGIBLE = 1e-8
"""Share of the expected crossings of the busiest phase below which a phase is not simulated."""

LEAST = 1e-15
"""Smallest bound of a probability that is stated: smaller ones tell nobody more."""

LAG = 0.125
"""Largest share by which a sine that moves through a resonance moves a mass less than one that
stands still. It is that over w' / (zeta w)^2, with the change of its frequency w'. It was measured
up to a ratio of 1, at damping ratios of 0.02 to 0.1."""


def of_phases(
    scene: Scene, ask: Callable[[Scene, float, Run], Reliability], run: Run
) -> Reliability:
    """The risk of all phases of a scene.

    A phase in which an impact is far less probable than in another one, by Rice's formula, is not
    simulated.

    Parameters
    ----------
    ask
        Finds the risk of the scene of a phase, in its duration, by a part of the run.

    Raises
    ------
    NotConverged, Interrupted
        If a phase was not found as accurately as asked for; with the answer so far, where every
        phase that matters has one.
    """
    scenes = {phase.name: phase.of(scene) for phase in scene.phases}
    durations = {phase.name: phase.duration for phase in scene.phases}
    idle = _idle(scenes, durations)
    busy = {name: duration for name, duration in durations.items() if name not in idle}
    found, missing = asked_in_parts(
        run, busy, lambda name, part: ask(scenes[name], durations[name], part)
    )
    like = next(iter(found.values()))
    found |= {name: _never_hit(like, durations[name], most) for name, most in idle.items()}
    answer = _together(scene, {name: found[name] for name in scenes}, missing, idle, run)
    return complete(answer, missing, run, of="risk of every phase", where="in phase")


def _idle(scenes: Mapping[str, Scene], durations: Mapping[str, float]) -> dict[str, float]:
    """The phases whose impacts do not matter, each with the largest probability of an impact."""
    most = {name: _most_hits(scenes[name], durations[name]) for name in scenes}
    known = {name: bound for name, bound in most.items() if bound is not None}
    largest = min(max(known.values(), default=0.0), 1.0)
    return {name: bound for name, bound in known.items() if bound < NEGLIGIBLE * largest}


def _most_hits(scene: Scene, duration: float) -> float | None:
    """A bound of the probability of a first impact of linear motion; None where it is unknown.

    It is Rice's number of crossings of all stops in the duration, and the probability to start
    beyond one."""
    model = model_of(scene)
    try:
        crossings, outside = crossings_of(model)(1.0)
    except NotApplicable:
        return None
    return max(crossings * duration + outside, LEAST) if model.pairs else None


def lag_of(model: Model, sweep_rate: float) -> float:
    """How much less a frequency that moves by so many Hz/s moves a structure than one that stands
    still, at most, as a share (`LAG`)."""
    slowest = 0.5 * float(np.min(np.diag(model.modal.damping)))
    return LAG * 2.0 * math.pi * sweep_rate / slowest**2 if slowest > 0.0 else math.inf


def lags_of_hazards(scenes: Mapping[str, Scene], rates: Mapping[str, float]) -> dict[str, float]:
    """By how much, as a share, the hazard of each phase through which something moves may be too
    large: Rice's crossings of motion that is larger by `lag_of`."""
    found = {}
    for name, rate in rates.items():
        model = model_of(scenes[name])
        louder = scenes[name].at_level(20.0 * math.log10(1.0 + lag_of(model, rate)))
        try:
            known, more = (crossings_of(each)(1.0)[0] for each in (model, model_of(louder)))
        except NotApplicable:
            continue
        found[name] = more / known - 1.0 if known > 0.0 else 0.0
    return found


def spoken_lags(scenes: Mapping[str, Scene], phases: Sequence[Phase]) -> list[str]:
    """A sentence on each phase through which something moves."""
    most: dict[str, float] = {}
    for phase in phases:
        if phase.step_of is not None and phase.sweep_rate:
            lag = lag_of(model_of(scenes[phase.name]), phase.sweep_rate)
            most[phase.step_of] = max(most.get(phase.step_of, 0.0), lag)
    return [
        f"what moves through phase {name} stands still in each step; in truth it moves the mass by "
        f"at most {100.0 * lag:.2g} % less, which the bias states"
        for name, lag in most.items()
    ]


def crossings_of(model: Model) -> Callable[[float], tuple[float, float]]:
    """Rice's rate of crossings of all stops, 1/s, and the probability to be beyond one, as a
    function of a gain of the noise; sines stay.

    Raises `NotApplicable` where the motion without stops is not stationary and Gaussian.
    """
    motion = free_motion(model, with_sines=True)
    rows = np.array([pair.direction for pair in model.pairs]).reshape(len(model.pairs), -1)
    means = rows @ motion.modes.shapes @ (motion.modes.rest + motion.law.mean)
    gaps = motion.moving_means(rows)

    def of_gain(gain: float) -> tuple[float, float]:
        rate = outside = 0.0
        for pair, mean, gap in zip(model.pairs, means, gaps, strict=True):
            louder = replace(gap, place=gain * gap.place, speed=gain * gap.speed)
            for stop, side in ((pair.lower, -1.0), (pair.upper, 1.0)):
                if stop is None or not gap.place > 0.0:
                    continue
                away = side * (stop.position - mean)
                rate += louder.rate(max(away, 0.0))
                outside += louder.beyond(away)
        return rate, outside

    return of_gain


def _never_hit(like: Reliability, duration: float, most: float) -> Reliability:
    """The answer for a phase whose impacts do not matter, with the events of another phase: none of
    them is more probable than an impact."""
    limit = Estimate(value=0.0, upper_95=most, how="at most Rice's number of crossings")
    chances = {
        event: replace(
            chance, estimate=limit, lower=0.0, upper=most, rule=limit.how, way="Rice", wilson=None,
            why="crossings are too rare", trials=0, levels=0, steps=0, seconds=0.0,
            seconds_per_mission=None,
        )
        for event, chance in like.chances.items()
    }  # fmt: skip
    return replace(
        like, mission=duration, chances=chances, hits=None, hits_interval=None, missing={},
        warnings=(), pairs={}, outputs={}, cost=Cost(wall_time=0.0),
    )  # fmt: skip


def _together(
    scene: Scene, found: Mapping[str, Reliability], missing: dict[str, str],
    idle: Mapping[str, float], run: Run,
) -> Reliability:  # fmt: skip
    phases = list(found.values())
    busy = [each for name, each in found.items() if name not in idle]
    events = [event for event in busy[0].chances if all(event in each.chances for each in phases)]
    hits = [each.hits for each in busy if each.hits is not None]
    steps = steps_of_bands(scene.phases)
    total = _sum(hits) if len(hits) == len(busy) else None
    scenes = {phase.name: phase.of(scene) for phase in scene.phases}
    moving = {each.name: each.sweep_rate for each in scene.phases if each.sweep_rate}
    lags = lags_of_hazards(scenes, {name: moving[name] for name in moving if name not in idle})
    stepped = bias_of_steps(
        steps, {name: float(each.hits or 0.0) for name, each in found.items()}, lags
    )
    # impacts of phases in which none was seen, of which a limit alone is known
    unseen = {
        name: each.hits.upper_95
        for name, each in found.items()
        if name not in idle and each.hits is not None and each.hits.upper_95 is not None
    }
    if total is not None and total.value > 0.0 and sum(unseen.values()) > total.value:
        missing |= (
            dict.fromkeys(
                (f"{name}, expected_hits" for name in unseen), "no impact was seen; raise budget"
            )
            | missing
        )
        total = None
    if total is not None and total.bias is not None:
        total = replace(total, bias=total.bias + stepped)
    intervals = [each.hits_interval for each in busy if each.hits_interval is not None]
    return Reliability(
        mission=sum(each.mission for each in phases),
        start=busy[0].start,
        chances={
            event: joint_chance(
                {name: each.chances[event] for name, each in found.items()}, steps, lags
            )
            for event in events
        },
        hits=total,
        hits_interval=_ends_of_sum(hits, intervals, stepped) if total is not None else None,
        confidence=busy[0].confidence,
        assumptions=[
            INDEPENDENT,
            *spoken_lags(scenes, scene.phases),
            *(
                f"impacts of phase {name} are not counted: Rice's number of them is at most "
                f"{most:.1g}"
                for name, most in idle.items()
            ),
            *dict.fromkeys(sentence for each in phases for sentence in each.assumptions),
        ],
        warnings=[
            f"in phase {name}: {warning}"
            for name, each in found.items()
            for warning in each.warnings
        ],
        missing=missing,
        phases=found,
        cost=run.cost(
            steps=sum(each.cost.steps for each in phases),
            paths=sum(each.cost.paths for each in phases),
        ),
        provenance=provenance(scene.document(), run.seed),
    )


def joint_chance(
    chances: Mapping[str, Chance], steps: Sequence[Sequence[str]] = (),
    lags: Mapping[str, float] | None = None,
) -> Chance:  # fmt: skip
    """The probability that an event comes in any of several independent phases. Some of them are
    the `steps` of a moving band, with the `lags` of their hazards."""
    each = list(chances.values())
    hazards = _hazards([one.estimate.value for one in each])
    lower, upper = (_hazards([getattr(one, end) for one in each]) for end in ("lower", "upper"))
    hazard = float(hazards.sum())
    low, high = np.linalg.norm(hazards - lower), np.linalg.norm(upper - hazards)
    kept = np.exp(hazards - hazard)  # the probability that no other phase brings the event
    value = -math.expm1(-hazard)
    above = -math.expm1(-(hazard + float(high)))
    biases = [one.estimate.bias for one in each]
    known = [bias for bias in biases if bias is not None]
    stepped = bias_of_steps(steps, dict(zip(chances, hazards.tolist(), strict=True)), lags)
    stepped *= math.exp(-hazard)
    worst, share = max(zip(chances, hazards, strict=True), key=lambda one: one[1])
    return Chance(
        event=each[0].event,
        limit=each[0].limit,
        estimate=Estimate(
            value=value,
            standard_error=float(
                np.linalg.norm(kept * [one.estimate.standard_error or 0.0 for one in each])
            ),
            bias=float(kept @ np.abs(known)) + stepped if len(known) == len(biases) else None,
            upper_95=above if value == 0.0 else None,
            how="of independent phases",
        ),
        lower=-math.expm1(-max(hazard - float(low), 0.0)),
        upper=above,
        confidence=each[0].confidence,
        rule="square roots of sums of squares of the half widths of the hazards of the phases",
        way="phases",
        why=f"phase {worst} has {100.0 * share / hazard:.3g} % of the risk"
        if hazard > 0.0
        else "the event was seen in no phase",
        trials=sum(one.trials for one in each),
        steps=sum(one.steps for one in each),
        seconds=sum(one.seconds for one in each),
    )


def _hazards(probabilities: Sequence[float]) -> Vector:
    return np.asarray(-np.log1p(-np.minimum(probabilities, CERTAIN)))


def _sum(estimates: Sequence[Estimate]) -> Estimate:
    """The sum of independent estimates."""
    value = sum(each.value for each in estimates)
    limits = [each.upper_95 for each in estimates if each.upper_95 is not None]
    # what was not seen is at most its limit
    bounds = [each.bias if each.upper_95 is None else each.upper_95 for each in estimates]
    biases = [bias for bias in bounds if bias is not None]
    return Estimate(
        value=value,
        standard_error=math.hypot(*(each.standard_error or 0.0 for each in estimates)),
        bias=sum(map(abs, biases)) if value > 0.0 and len(biases) == len(estimates) else None,
        upper_95=math.hypot(*limits) if value == 0.0 and limits else None,
        how="of independent phases",
    )


def _ends_of_sum(
    estimates: Sequence[Estimate], intervals: Sequence[tuple[float, float]], bias: float
) -> tuple[float, float]:
    """The interval of a sum: half widths added as roots of sums of squares, each side for itself,
    with a bias of the sum."""
    values = np.array([each.value for each in estimates])
    low, high = np.array(intervals).T
    total = float(values.sum())
    return (
        max(total - float(np.linalg.norm(values - low)) - bias, 0.0),
        total + float(np.linalg.norm(high - values)) + bias,
    )
