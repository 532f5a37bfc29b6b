"""The risk of a mission under noise of varying level, from the risks at steady levels.

Conditioned on its level the noise is Gaussian. At some levels the risk is that of Gaussian noise,
in the correlation time of the level, or in the mission where that is shorter. Its hazard
-ln(1 - P) over that of Rice's crossings changes slowly with the level: its logarithm is
interpolated. `RandomLevel.probability` follows the hazard along the level as it varies.

The motion is taken to follow the level at once. What it feels is less, as it averages the level
over its memory (`RandomLevel.felt`): what this changes is stated as a bias.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.random_level import RandomLevel
from stochvi.model.model import Model, model_of
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate, provenance
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.mission_parts import asked_in_parts, complete
from stochvi.statistics.reliability.answer import Chance, Reliability
from stochvi.statistics.reliability.phases import crossings_of

TRIED = 7
"""Number of levels at which the risk is simulated."""

LEFT_OUT = 1e-3
"""Share of Rice's crossings below the lowest of these levels, and above the highest one."""

LEAST_FELT = 0.8
"""Least share of the excess kurtosis of the noise that the motion must feel."""

FOLLOWED = (
    "at each level the motion is that of Gaussian noise, and follows the level at once; what it "
    "feels less is the bias"
)


@dataclass(frozen=True)
class LevelHazard:
    """The hazard of an event at any level, between levels at which it is known.

    Parameters
    ----------
    level
        How the level varies.
    expected
        (NODES,): rates of Rice's crossings at its `gains`, 1/s.
    tried
        Values of its normal process at which the event is known, increasing.
    logarithms
        Logarithms of the ratio of the hazard to `expected` there.
    """

    level: RandomLevel
    expected: Callable[[Vector], Vector]
    tried: Vector
    logarithms: Vector

    def rates(self, level: RandomLevel) -> Vector:
        """Rates at the `gains` of a level, 1/s."""
        normal = np.log(level.gains) / self.level.spread + self.level.spread
        inside = np.clip(normal, self.tried[0], self.tried[-1])
        ratio = PchipInterpolator(self.tried, self.logarithms)(inside)
        return np.asarray(self.expected(level.gains) * np.exp(ratio))

    def probability(self, mission: float, level: RandomLevel | None = None) -> float:
        """The probability of the event in a mission, at a level that varies otherwise if given."""
        level = level or self.level
        return level.probability(self.rates(level), mission)

    def number(self, mission: float, level: RandomLevel | None = None) -> float:
        """Expected number of events in a mission."""
        level = level or self.level
        return mission * level.mean(self.rates(level))

    def moved(self, place: int, logarithm: float) -> LevelHazard:
        """The same with another logarithm at one of the levels."""
        changed = self.logarithms.copy()
        changed[place] = logarithm
        return replace(self, logarithms=changed)


def felt_by(model: Model) -> RandomLevel:
    """The level that the slowest mode of a model feels.

    Raises `NotApplicable` where it feels hardly anything of it.
    """
    level = model.level
    assert level is not None
    slowest = float(np.min(np.diag(model.modal.damping)))
    if slowest > 0.0:
        felt = level.felt(slowest)
        if felt.kurtosis - 3.0 >= LEAST_FELT * (level.kurtosis - 3.0):
            return felt
    memory = 1.0 / slowest if slowest > 0.0 else math.inf
    raise NotApplicable(
        "Gaussian motion at each level",
        [f"level_time must be long beside the memory of the motion, {memory:.3g} s, got "
         f"{level.time:g} s; simulate follows it"],
    )  # fmt: skip


def of_random_level(
    scene: Scene, mission: float, ask: Callable[[Scene, float, Run], Reliability], run: Run
) -> Reliability:
    """The probability of any impact, and expected impacts, under noise of varying level.

    Parameters
    ----------
    ask
        Finds the risk of a scene of steady level in a duration, by a part of the run.

    Raises
    ------
    NotApplicable
        If the level varies too fast for the motion to follow, or nothing can be hit.
    NotConverged, Interrupted
        If the risk at a level was not found as accurately as asked for.
    """
    model, level = model_of(scene), scene.random_level
    assert level is not None
    felt = felt_by(model)
    expected = _rice(scene)
    duration = min(mission, level.time)
    tried, names = _levels_to_try(level, expected, mission)
    found, missing = asked_in_parts(
        run, dict.fromkeys(names, duration),
        lambda name, part: ask(scene.at_steady_level(names[name]), duration, part),
    )  # fmt: skip
    rates = expected(level.gain(tried))
    asked = _Asked(level, felt, mission, duration, expected, tried, rates)
    answer = _together(scene, asked, found, missing, run)
    return complete(answer, missing, run, of="risk of every level", where="at a level of")


def _rice(scene: Scene) -> Callable[[Vector], Vector]:
    """Rice's rates of crossings of all stops, 1/s, at gains of the noise."""
    steady = model_of(scene.at_steady_level(0.0))
    crossings = crossings_of(steady)
    return lambda gains: np.array([crossings(float(gain))[0] for gain in gains])


def _levels_to_try(
    level: RandomLevel, expected: Callable[[Vector], Vector], mission: float
) -> tuple[Vector, dict[str, float]]:
    """Values of the normal process between which nearly all first crossings come, and their levels
    in dB, by the words that name them."""
    hazard = np.minimum(expected(level.gains), 1.0 / min(level.time, mission))
    shares = np.cumsum(level.weights * hazard)
    if not shares[-1] > 0.0:
        raise NotApplicable("reliability", ["stops must be near enough to be crossed at any level"])
    low, high = np.interp([LEFT_OUT, 1.0 - LEFT_OUT], shares / shares[-1], level.normals)
    tried = np.linspace(low, high, TRIED)
    decibels = 20.0 * np.log10(level.gain(tried))
    return tried, {f"{each:+.1f} dB": float(each) for each in decibels}


@dataclass(frozen=True)
class _Asked:
    """The question, and the levels at which it was asked."""

    level: RandomLevel
    felt: RandomLevel
    mission: float
    duration: float
    expected: Callable[[Vector], Vector]
    tried: Vector
    rates: Vector

    def hazard(self, rates: Vector) -> LevelHazard:
        """The hazard with these rates at the levels that were tried."""
        logarithms = np.log(np.maximum(rates, np.finfo(float).tiny) / self.rates)
        return LevelHazard(self.level, self.expected, self.tried, logarithms)

    def chance(self, chances: Sequence[Chance]) -> Chance:
        """The probability of an event from those at the levels that were tried."""
        ends = {
            end: -np.log1p(-np.clip(values, 0.0, CERTAIN)) / self.duration
            for end, values in {
                "value": [each.estimate.value for each in chances],
                "lower": [each.lower for each in chances],
                "upper": [each.upper for each in chances],
                # to the side on which the hazard stays finite
                "error": [each.estimate.value - each.estimate.standard_error for each in chances],
                "bias": [each.estimate.value + (each.estimate.bias or 0.0) for each in chances],
            }.items()
        }
        # where hardly a motion survives, its hazard is as uncertain upwards as downwards
        downwards = ends["value"] / np.maximum(ends["lower"], np.finfo(float).tiny)
        ends["upper"] = np.minimum(ends["upper"], ends["value"] * downwards)
        hazard = self.hazard(ends["value"])
        value = hazard.probability(self.mission)

        def changes(end: str) -> Vector:
            logs = self.hazard(ends[end]).logarithms
            return np.array(
                [
                    hazard.moved(place, logs[place]).probability(self.mission) - value
                    for place in range(len(chances))
                ]
            )

        known = all(each.estimate.bias is not None for each in chances)
        at_once = abs(hazard.probability(self.mission, self.felt) - value)
        low, high = (float(np.linalg.norm(changes(end))) for end in ("lower", "upper"))
        return replace(
            chances[0],
            estimate=Estimate(
                value=value,
                standard_error=float(np.linalg.norm(changes("error"))),
                bias=float(np.abs(changes("bias")).sum()) + at_once if known else None,
                how="from the risks at steady levels",
            ),
            lower=max(value - low, 0.0), upper=min(value + high, 1.0), wilson=None,
            rule="square root of the sum of squares of what the intervals at the levels change",
            way="levels", why=self._where(hazard),
            trials=sum(each.trials for each in chances), levels=0,
            steps=sum(each.steps for each in chances),
            seconds=sum(each.seconds for each in chances), seconds_per_mission=None,
        )  # fmt: skip

    def _where(self, hazard: LevelHazard) -> str:
        """A sentence on the levels at which the event comes."""
        level = self.level
        held = np.minimum(hazard.rates(level), 1.0 / self.duration)
        shares = np.cumsum(level.weights * held)
        ends = np.interp([0.25, 0.75], shares / shares[-1], level.normals)
        low, high = 20.0 * np.log10(level.gain(ends))
        return f"half of the risk comes at levels from {low:+.1f} to {high:+.1f} dB"

    def number(self, hits: Sequence[Estimate]) -> Estimate:
        """The expected number of events from those at the levels that were tried."""
        values = np.array([each.value for each in hits])
        hazard = self.hazard(values / self.duration)
        value = hazard.number(self.mission)

        def changes(errors: Sequence[float]) -> Vector:
            logs = self.hazard((values + errors) / self.duration).logarithms
            return np.array(
                [
                    hazard.moved(place, logs[place]).number(self.mission) - value
                    for place in range(len(hits))
                ]
            )

        known = all(each.bias is not None for each in hits)
        at_once = abs(hazard.number(self.mission, self.felt) - value)
        bias = float(np.abs(changes([each.bias or 0.0 for each in hits])).sum()) + at_once
        return Estimate(
            value=value,
            standard_error=float(np.linalg.norm(changes([each.standard_error for each in hits]))),
            bias=bias if known else None,
            how="from the expected impacts at steady levels",
        )


CERTAIN = 1.0 - 1e-15
"""A larger probability counts as this one, so that its hazard is finite."""


def _together(
    scene: Scene, asked: _Asked, found: Mapping[str, Reliability], missing: dict[str, str], run: Run
) -> Reliability:
    levels = list(found.values())
    hits = [each.hits for each in levels if each.hits is not None]
    number = asked.number(hits) if len(hits) == len(levels) else None
    return replace(
        levels[0],
        mission=asked.mission,
        chances={
            event: asked.chance([each.chances[event] for each in levels])
            for event in levels[0].chances
            if all(event in each.chances for each in levels)
        },
        hits=number,
        hits_interval=None if number is None else number.interval(levels[0].confidence),
        assumptions=[
            *scene.assumptions(),
            FOLLOWED,
            *(each for each in levels[0].assumptions if each not in scene.assumptions()),
        ],
        warnings=[
            warning
            for warning in levels[0].warnings
            if all(warning in each.warnings for each in levels)
        ],
        missing=missing,
        pairs={},
        cost=run.cost(
            steps=sum(each.cost.steps for each in levels),
            paths=sum(each.cost.paths for each in levels),
        ),
        provenance=provenance(scene.document(), run.seed),
    )
