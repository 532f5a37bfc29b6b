"""The linear part of springs and dampers that are functions: what a simulation moves exactly.

A step of a simulation kicks the velocities by functions, and moves the rest exactly. The smaller
the force of the kicks, the smaller is the error of the step. Each function is therefore taken apart
into f + k y + c y', by statistical linearisation, and the difference from it, which kicks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.model.modal import LinearLaw
from stochvi.model.model import FunctionOfMotion, Model
from stochvi.model.scales import scales_of
from stochvi.results.errors import NotApplicable
from stochvi.scenes.characteristics.base import LinearForm

ITERATIONS = 200
"""Largest number of linearisations; they end when nothing changes by more than SETTLED."""

SETTLED = 1e-4
"""Relative change of deviations at which the linear part is settled; it needs few digits, as the
kicks make up for the difference."""

LEAST_WEIGHT = 1e-3
"""Smallest share of the way to the motion of a linear part that an iteration goes."""

WIDTHS = np.geomspace(1e-9, 1e3, 25)
"""Deviations, m and m/s, among which the iteration finds its start."""


class Motion(NamedTuple):
    """Mean and standard deviation of the displacement of a function, and that of its rate, SI."""

    mean: float
    deviation: float
    speed: float


def with_linear_part(
    model: Model,
    method: str = "simulate",
    law_of: Callable[[Model], LinearLaw | None] | None = None,
    settled: float = SETTLED,
) -> Model:
    """The model whose matrices and constant forces hold the linear parts of all functions.

    Parameters
    ----------
    model
        A model with functions.
    method
        Name of the method in error messages.
    law_of
        The law of the linear part, None where it has none; by default a rough one.
    settled
        Relative change of deviations at which the iteration ends.

    Raises
    ------
    NotApplicable
        Where no linear part has a stationary state.
    """
    law_of = law_of or _rough_law
    # a mass that friction holds has a linear part of its own: that of a motion is met from above
    held = any(part.law.sticks and not part.law.drives for part in model.functions)
    for width in WIDTHS[::-1] if held else WIDTHS:
        # wide motions are held by what grows, and narrow ones damped by friction
        motions = [Motion(0.0, float(width), float(width))] * len(model.functions)
        linear = with_forms(model, motions)
        found = _motions(linear, law_of)
        if found is not None:
            break
    else:
        raise NotApplicable(
            method,
            ["structure.spring and structure.damper must hold and brake the structure, got none "
             "that do in motions of any size; add stiffness or damping"],
        )  # fmt: skip
    weight = 0.5
    for _ in range(ITERATIONS):
        following = [between(*each, weight) for each in zip(motions, found, strict=True)]
        trial = with_forms(model, following)
        reached = _motions(trial, law_of)
        if reached is None or _distance(following, reached) > _distance(motions, found):
            weight /= 2.0  # between wells a small change of a motion may be a large one of its law
            if weight < LEAST_WEIGHT:  # beyond the widest motion that is held
                break
            continue
        moved = _distance(motions, following)
        linear, motions, found = trial, following, reached
        if moved <= 2.0 * weight * settled:
            break
    return linear


def with_forms(model: Model, motions: Sequence[Motion]) -> Model:
    """The model with the linear parts at these motions."""
    forms = []
    for part, motion in zip(model.functions, motions, strict=True):
        form = form_of(part, motion)
        forms.append(form._replace(force=form.force - form.stiffness * motion.mean))
    return with_affine(model, forms)


def with_affine(model: Model, forms: Sequence[LinearForm]) -> Model:
    """The model with linear parts f + k x + c v, N."""
    stiffness, damping = model.stiffness.copy(), model.damping.copy()
    constants, functions = list(model.constants), []
    for part, form in zip(model.functions, forms, strict=True):
        row = part.direction
        stiffness += form.stiffness * np.outer(row, row)
        damping += form.damping * np.outer(row, row)
        if form.force:
            constants.append((-form.force, row))
        affine = (form.stiffness / part.mass, form.damping / part.mass, form.force / part.mass)
        functions.append(replace(part, affine=affine))
    rates = None
    if len(stiffness) == 1:
        mass = float(model.mass[0, 0])
        rates = math.sqrt(max(stiffness[0, 0], 0.0) / mass), float(damping[0, 0]) / mass
    return replace(
        model, stiffness=stiffness, damping=damping, constants=tuple(constants),
        functions=tuple(functions), rates=rates, restoring=None, potential=None, drag=None,
    )  # fmt: skip


def form_of(part: FunctionOfMotion, motion: Motion) -> LinearForm:
    """The linear form of a function, of all that are side by side, N."""
    form = part.law.moved_exactly(*motion)
    return LinearForm(*(part.count * each for each in form))


def _rough_law(model: Model) -> LinearLaw | None:
    planned = model.with_noise_of_drives
    known = scales_of(planned, planned.modal)
    return None if known is None else known[0]


def _motions(model: Model, law_of: Callable[[Model], LinearLaw | None]) -> list[Motion] | None:
    """The motion of each function in a model with linear parts; None without a stationary state."""
    law = law_of(model) if is_positive(model.stiffness) else None
    return None if law is None else motions_of(model, law)


def motions_of(model: Model, law: LinearLaw) -> list[Motion]:
    """The motion of each function under a law of the linear part."""
    modes, found = model.modal, []
    for part in model.functions:
        row: Vector = part.direction @ modes.shapes
        found.append(
            Motion(
                float(row @ (modes.rest + law.mean)),
                math.sqrt(law.variances(row, 0)),
                math.sqrt(law.variances(row, modes.size)),
            )
        )
    return found


def is_positive(stiffness: np.ndarray) -> bool:
    """Whether no motion lowers the energy of a stiffness matrix."""
    values = np.linalg.eigvalsh(stiffness)
    return bool(values[0] >= -1e-9 * max(values[-1], 0.0))


def between(one: Motion, other: Motion, weight: float = 0.5) -> Motion:
    """A motion on the way from one to another, by default half way."""
    return Motion(
        one.mean + weight * (other.mean - one.mean),
        one.deviation ** (1.0 - weight) * other.deviation**weight,
        one.speed ** (1.0 - weight) * other.speed**weight,
    )


def _distance(ones: Sequence[Motion], others: Sequence[Motion]) -> float:
    """Largest relative difference of two motions of all functions."""
    return max(
        max(
            abs(one.mean - other.mean) / other.deviation,
            abs(math.log(one.deviation / other.deviation)),
            abs(math.log(one.speed / other.speed)),
        )
        for one, other in zip(ones, others, strict=True)
    )


def fastest_rate(part: FunctionOfMotion, motion: Motion) -> float:
    """Largest rate, 1/s, at which a function alone moves its reduced mass: the frequency of its
    spring, the decay of its damper, or what it resolves in time."""
    mass, law = part.mass / part.count, part.law
    return max(
        math.sqrt(law.stiffest(motion.mean, motion.deviation) / mass),
        law.most_damping(motion.mean, motion.speed) / mass,
        law.fastest,
    )
