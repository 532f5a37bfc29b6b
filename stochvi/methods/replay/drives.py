"""Excitations whose values are drawn, beside a record: one realisation of them.

A drive changes the momentum of what it acts on by p within a sampling interval h of the record.
The force p / h at the sample, linear to 0 at both neighbours, has the same momentum. So an impulse
lasts two intervals, and a force of one's own is linear between samples, as the record is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stochvi.engine.drive import FIRST_DRAW, MOST_DRAWS, changes_of
from stochvi.methods.replay.march import SampledExcitation
from stochvi.model.model import FunctionOfMotion, Model
from stochvi.scenes.excitations import BASE
from stochvi.scenes.scene import Scene


def with_drives(
    scene: Scene, model: Model, segments: Sequence[SampledExcitation], seed: int
) -> list[SampledExcitation]:
    """The segments of a record with the forces of all drives; each segment has its own seed."""
    return [
        _with_forces(scene, model, each, np.uint64(seed + number))
        for number, each in enumerate(segments)
    ]


def _with_forces(
    scene: Scene, model: Model, segment: SampledExcitation, word: np.uint64
) -> SampledExcitation:
    forces, base = segment.forces.copy(), segment.base.copy()
    for number, part in enumerate(model.drives):
        assert part.drawn is not None
        values = _values(part, word, FIRST_DRAW + MOST_DRAWS * number, segment)
        forces += np.outer(values, part.direction)
        if scene.place(part.drawn) == BASE:  # type: ignore[arg-type]
            base[:, list(model.base).index(part.drawn.axis or "")] += values
    return SampledExcitation(step=segment.step, forces=forces, base=base)


def _values(
    part: FunctionOfMotion, word: np.uint64, event: int, segment: SampledExcitation
) -> np.ndarray:
    """Values of a drive at the samples, N, or m/s^2 of the base."""
    changes = np.empty(len(segment.forces))
    changes_of(part.law.compiled(part.mass), word, event, segment.step, changes)
    return part.mass / segment.step * changes
