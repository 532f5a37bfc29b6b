"""The clearances that a scene needs as it is stated, without its tolerances."""

from __future__ import annotations

from stochvi.isolators.sizing.answer import Sizing
from stochvi.isolators.sizing.changes import Tolerances
from stochvi.isolators.sizing.job import SizingJob
from stochvi.isolators.sizing.one_curve import OneCurve
from stochvi.isolators.sizing.question import Question
from stochvi.isolators.sizing.shared_risk import SharedRisk
from stochvi.isolators.sizing.targets import check_at
from stochvi.model.coverage import modulated
from stochvi.model.model import Model, model_of
from stochvi.results.errors import NotApplicable
from stochvi.scenes.scene import Scene


def has_one_gap(model: Model) -> bool:
    """Whether a model is one mass with one gap, whose curve of risk says all."""
    return model.single


def nominal_sizing(scene: Scene, asked: Question) -> Sizing:
    """The sizing of a scene as it is stated, without the worst case within its tolerances."""
    allowed = asked.tolerances or Tolerances.of(scene)
    try:
        model = model_of(scene)
        if conditions := modulated(model):
            raise NotApplicable("size", conditions)
        check_at(scene, asked.target, asked.at)
        alone = has_one_gap(model)
        # linear theory knows no stop
        felt = allowed.felt(scene, by_hits=alone and asked.target.name != "probability")
        by = OneCurve if alone else SharedRisk
        return SizingJob(scene=scene, asked=asked, allowed=felt, by=by).sizing()
    except NotApplicable as reason:
        # the user called `size`, so that the refusal has its name, whatever function it came from
        raise NotApplicable("size", reason.conditions) from reason
