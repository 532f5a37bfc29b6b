"""What tolerances of the mounts and of the level do to a sizing of several pairs, by linear theory.

Nothing is simulated again. A change of the structure changes the rms of each gap, its rate of zero
crossings and its mean. The clearance for the same risk is then the one at which stops are crossed
at the same rate (Rice), and the distance by which the mean has moved is added to it. Hits are taken
to cluster as in the nominal scene.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.isolators.sizing.changes import (
    CENTRE,
    COMBINED,
    Change,
    Tolerances,
    ends_of,
    moved_centre,
)
from stochvi.mathematics.units import power_ratio
from stochvi.model.free_motion import free_motion
from stochvi.model.model import Model, model_of
from stochvi.scenes.rigid_body import AXES
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


class Gaps(NamedTuple):
    """rms (m), crossings of the mean per second and mean (m) of every gap, (pairs,) each."""

    sigma: Vector
    rate: Vector
    mean: Vector

    @classmethod
    def of(cls, model: Model, gain: float = 1.0) -> Gaps:
        """The gaps of a structure whose noise is larger by a factor."""
        directions = np.array([pair.direction for pair in model.pairs])
        sigma, speed = free_motion(model).deviations(directions)
        rate = np.divide(speed, 2.0 * math.pi * sigma, out=np.zeros_like(speed), where=sigma > 0.0)
        return cls(gain * sigma, rate, model.modal.gaps @ model.modal.rest)


def tolerance_table(
    scene: Scene,
    tolerances: Tolerances,
    stops: Matrix,
    sized: Sequence[int],
    probability: float,
) -> pd.DataFrame:
    """The table that `PairsSizing.tolerances` describes.

    Parameters
    ----------
    stops
        (2, pairs): distances of the lower and the upper stops from the mean gaps, m; infinite for
        none.
    sized
        Numbers of the pairs whose clearances were searched for.
    probability
        Chance of any hit there.
    """
    import pandas as pd

    model = model_of(scene)
    models = _Models(scene)
    nominal = Gaps.of(model)
    ends = list(ends_of(tolerances))

    def row(words: str, changes: Sequence[Change]) -> dict[str, str | float]:
        changed = _changed(models, changes)
        places = _same_risk(nominal, changed, stops)
        return {
            "change": words,
            **{model.pairs[k].name: float(places[k]) for k in sized},
            "factor": max(float(places[k] / stops[:, k].min()) for k in sized),
            "probability": _chance(nominal, changed, stops, probability),
        }

    rows = [row("as stated", []), *(row(end.words, [end]) for end in ends)]
    groups = [list(group) for _, group in itertools.groupby(ends, lambda each: each.quantity)]
    corners = [row(_words(corner), corner) for corner in itertools.product(*groups)]
    worst = max(corners, key=lambda each: float(each["factor"])) if ends else None
    return pd.DataFrame([*rows, *([worst] if worst else [])])


def _words(corner: Sequence[Change]) -> str:
    return f"{COMBINED}: {', '.join(change.words for change in corner)}"


class _Models:
    """Models of a scene with its centre of mass elsewhere, each made once."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.known: dict[tuple[float, ...], Model] = {}

    def at(self, shift: tuple[float, ...]) -> Model:
        """The model with the centre of mass moved by `shift`, m along x, y, z."""
        if shift not in self.known:
            scene = moved_centre(self.scene, shift) if any(shift) else self.scene
            self.known[shift] = model_of(scene)
        return self.known[shift]


def _changed(models: _Models, changes: Sequence[Change]) -> Gaps:
    """The gaps with these changes of frequency, damping, level and centre of mass."""
    moved = {each.quantity: each.amount for each in changes}
    model = models.at(tuple(moved.get(f"{CENTRE}{axis}", 0.0) for axis in AXES))
    changes = [each for each in changes if not each.quantity.startswith(CENTRE)]
    factor = {"frequency": 1.0, "damping": 1.0, "level": 1.0}
    for change in changes:
        level = change.quantity == "level"
        amount = math.sqrt(power_ratio(change.amount)) if level else 1.0 + change.amount
        factor[change.quantity] *= amount
    frequency, damping = factor["frequency"], factor["damping"]
    structure = replace(
        model,
        stiffness=model.stiffness * frequency**2,
        damping=model.damping * (frequency * damping),
        rates=None,
    )
    return Gaps.of(structure, factor["level"])


def _sides(nominal: Gaps, changed: Gaps, stops: Matrix) -> Iterator[tuple[Vector, Vector]]:
    """Distances of the stops on each side from the nominal mean gap and from the changed one."""
    shift = changed.mean - nominal.mean
    yield stops[0], stops[0] + shift
    yield stops[1], stops[1] - shift


def _same_risk(nominal: Gaps, changed: Gaps, stops: Matrix) -> Vector:
    """(pairs,): clearances from the nominal mean gap at which the nearer stop of each pair is
    crossed as often as its stop in the nominal scene."""
    distance = stops.min(axis=0)
    moved = np.where(nominal.sigma > 0.0, nominal.sigma, math.inf)
    logs = np.log(np.maximum(changed.rate, 1e-300) / np.maximum(nominal.rate, 1e-300))
    square = np.maximum((distance / moved) ** 2 + 2.0 * logs, 0.0)
    return np.asarray(changed.sigma * np.sqrt(square) + np.abs(changed.mean - nominal.mean))


def _chance(nominal: Gaps, changed: Gaps, stops: Matrix, probability: float) -> float:
    """Chance of any hit with the stops where they are: the hazard changes as Rice's rate of all
    crossings does."""
    before = after = 0.0
    for old, new in _sides(nominal, changed, stops):
        before += _rice(nominal, old)
        after += _rice(changed, new)
    return -math.expm1(math.log1p(-probability) * after / before)


def _rice(gaps: Gaps, distance: Vector) -> float:
    """Crossings per second of stops at these distances, all pairs together."""
    moving = (gaps.sigma > 0.0) & np.isfinite(distance)
    level = distance[moving] / gaps.sigma[moving]
    return float(np.sum(gaps.rate[moving] * np.exp(-0.5 * np.maximum(level, 0.0) ** 2)))
