"""A rigid stop with a constant restitution."""

from __future__ import annotations

from typing import NamedTuple

from stochvi.engine.law import is_rigid, read, rebound


class Restitution(NamedTuple):
    """v+ = -R v-, with the `restitution` R."""

    restitution: float


@rebound.of(Restitution)
def _(law, w, uniform):
    return law.restitution * w


@is_rigid.of(Restitution)
def _(law):
    return True


@read.of(Restitution)
def _(law, numbers, row):
    return Restitution(numbers[row, 0])
