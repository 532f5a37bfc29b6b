"""The scene about which the units of a production vary, its stops and its risk."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stochvi.isolators.sizing.answer import Sizing, Target
from stochvi.isolators.sizing.changes import Tolerances
from stochvi.isolators.sizing.nominal import nominal_sizing
from stochvi.isolators.sizing.question import Question
from stochvi.isolators.sizing.risk_curve import chance_of_stops
from stochvi.mathematics.arrays import Matrix
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.pair_crossings import own_distances


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
        chance = chance_of_stops(scene, stops, mission, run).value
        return cls(scene=scene, mission=mission, stops=stops, chance=chance)

    @classmethod
    def of_target(
        cls, scene: Scene, target: Target, mission: float, pair: str | None, run: Run
    ) -> Start:
        """The stops that keep a probability of any impact; no impact is simulated."""
        asked = Question(
            target=target, mission=mission, run=run, pair=pair, tolerances=Tolerances(),
            impacts=False,
        )  # fmt: skip
        return cls.of_sizing(nominal_sizing(scene, asked))

    @classmethod
    def of_sizing(cls, found: Sizing) -> Start:
        """The clearances of a sizing for a probability of any impact."""
        if found.target.name != "probability":
            raise NotApplicable(
                "production",
                [f"the target must be a probability of any impact, got {found.target.name}; give "
                 "tolerances without a distribution for it"],
            )  # fmt: skip
        names = [each.name for each in model_of(found.scene).pairs]
        return cls(
            scene=found.scene, mission=found.mission, stops=found.stops,
            chance=found.any_hit or found.target.value, target=found.target.value,
            sized=found.sized_pairs, common=[names.index(each) for each in found.common],
        )  # fmt: skip

    @property
    def names(self) -> list[str]:
        """Names of the pairs; that of its coordinate for a mass without one."""
        model = model_of(self.scene)
        return [each.name for each in model.pairs] or list(model.coordinates)
