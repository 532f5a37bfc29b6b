"""The scene about which the units of a production vary, its stops and its risk."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stochvi.isolators.sizing.answer import Target
from stochvi.isolators.sizing.changes import Tolerances
from stochvi.isolators.sizing.nominal import chance_between, nominal_sizing, risk_curve
from stochvi.isolators.sizing.pairs_answer import PairsSizing
from stochvi.isolators.sizing.question import Question
from stochvi.mathematics.arrays import Matrix
from stochvi.model.model import model_of
from stochvi.results.deadline import partial_result
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.pair_crossings import own_distances, pair_crossings

SIDES = ("lower", "upper")
"""Sides of a stop, in the order of the rows of its distances."""


@dataclass(frozen=True, kw_only=True)
class Start:
    """The scene as stated.

    Its stops are (2, pairs) m from the mean gaps, infinite for none, with the probability of an
    impact there. Pairs are named by their numbers: those whose stops may be moved to keep a target,
    and those with one clearance in common."""

    scene: Scene
    mission: float
    stops: Matrix
    chance: float
    target: float | None = None
    sized: Sequence[int] = ()
    common: Sequence[int] = ()

    @classmethod
    def of_scene(cls, scene: Scene, mission: float, pair: str | None, run: Run) -> Start:
        """The stops of the scene, or those of one of its pairs."""
        model = model_of(scene)
        if not model.pairs:
            raise NotApplicable(
                "production", ["the scene needs an impact_pair, or the question a probability"]
            )
        stops = np.array(own_distances(model))
        if pair is not None:
            stops[:, [each.name != pair for each in model.pairs]] = math.inf
        if stops.min() <= 0.0:
            raise NotApplicable(
                "production", ["mean gaps must lie between the stops; move the stops outwards"]
            )
        chance = chance_of(scene, stops, mission, run).value
        return cls(scene=scene, mission=mission, stops=stops, chance=chance)

    @classmethod
    def of_target(
        cls, scene: Scene, target: Target, mission: float, pair: str | None, run: Run
    ) -> Start:
        """The stops that keep a probability of any impact; no impact of one mass is simulated."""
        if not model_of(scene).single:
            asked = Question(
                target=target, mission=mission, run=run, pair=pair, tolerances=Tolerances()
            )
            return cls.of_sizing(nominal_sizing(scene, asked))
        place = risk_curve(scene, target, mission, run).clearance(target.value).value
        sides = [side for each in scene.impact_pairs[:1] for side, _ in each.stops()] or SIDES
        return cls(
            scene=scene, mission=mission, chance=target.value, target=target.value, sized=[0],
            stops=np.array([[place if side in sides else math.inf] for side in SIDES]),
        )  # fmt: skip

    @classmethod
    def of_sizing(cls, found: Any) -> Start:
        """The clearances of a sizing for a probability of any impact."""
        if found.target.name != "probability":
            raise NotApplicable(
                "production",
                [f"the target must be a probability of any impact, got {found.target.name}; give "
                 "tolerances without a distribution for it"],
            )  # fmt: skip
        if isinstance(found, PairsSizing):
            stops = found.pairs[["lower", "upper"]].fillna(math.inf).to_numpy().T
            names = [each.name for each in model_of(found.scene).pairs]
            sized = [names.index(name) for name in found.clearances]
            common = [names.index(name) for name in found.common]
            chance = found.probability.value
        else:
            place = found.clearance.value
            stops = np.array([[place if side in found.sides else math.inf] for side in SIDES])
            sized, common, chance = [0], list[int](), found.target.value
        return cls(
            scene=found.scene, mission=found.mission, stops=stops, chance=chance,
            target=found.target.value, sized=sized, common=common,
        )  # fmt: skip

    @property
    def names(self) -> list[str]:
        """Names of the pairs; that of its coordinate for a mass without one."""
        model = model_of(self.scene)
        return [each.name for each in model.pairs] or list(model.coordinates)


def chance_of(scene: Scene, stops: Matrix, mission: float, run: Run) -> Estimate:
    """Probability of any impact with stops at these distances (2, pairs) from the mean gaps, m; 1
    where one of them presses."""
    if stops.min() <= 0.0:
        return Estimate(value=1.0, how="a stop presses on the mass")
    if model_of(scene).single:
        sides = zip(SIDES, stops[:, 0].tolist(), strict=True)
        distances = {side: place for side, place in sides if math.isfinite(place)}
        return chance_between(scene, distances, mission, run)
    found = partial_result(
        pair_crossings, scene, lower=stops[0], upper=stops[1], mission=mission,
        **run.options(rel_error=run.rel_error),
    )  # fmt: skip
    chance: Estimate = found.probability(mission)[0]
    return chance
