"""The natural modes of a structure, and where it rests under its constant loads."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.rounding import CANCELLATION
from stochvi.model.coverage import functions
from stochvi.model.model import Model
from stochvi.scenes.structures.rigid_body import (
    LEAST_SHARE,
    MOTIONS,
    energy_shares,
    motion_in_words,
)


class NaturalMode(NamedTuple):
    """An undamped natural mode phi of M q'' + K q = 0, phi'M phi = 1.

    Parameters
    ----------
    frequency_hz
        Natural frequency, Hz; 0 for an unrestrained mode.
    damping_ratio
        phi'C phi / (2 omega), dimensionless; None where no spring holds the mode.
    motion
        The coordinates that move, by falling share of the kinetic energy.
    effective_mass
        (phi'M iota)^2, kg, by axis of the base, where iota are the displacements of the coordinates
        when they follow the base along that axis. The effective masses of all modes add up to the
        mass that moves along the axis.
    """

    frequency_hz: float
    damping_ratio: float | None
    motion: str
    effective_mass: Mapping[str, float]


class RestingGap(NamedTuple):
    """Position of a gap at rest under constant loads, and its distances from the stops, m.

    The distance is None where there is no stop, and negative where the mass is pressed onto it.
    """

    position: float
    to_lower: float | None
    to_upper: float | None


def natural_modes(model: Model) -> tuple[NaturalMode, ...]:
    """The modes of a structure in rising order of their frequencies.

    There are none where a spring or damper is a function.

    Examples
    --------
    >>> from stochvi import Matrices, Scene, WhiteNoise
    >>> from stochvi.model.model import model_of
    >>> two = Matrices(
    ...     coordinates=["a", "b"], mass=[[1.0, 0.0], [0.0, 1.0]],
    ...     damping=[[0.1, 0.0], [0.0, 0.1]], stiffness=[[2.0, -1.0], [-1.0, 2.0]],
    ... )
    >>> scene = Scene(structure=two, excitations=[WhiteNoise(intensity=1.0, on="a")])
    >>> [round(mode.effective_mass[""], 9) for mode in natural_modes(model_of(scene))]
    [2.0, 0.0]
    """
    if functions(model):
        return ()
    form, found = model.modal, []
    for square, shape, damping in zip(
        form.squares, form.shapes.T, np.diag(form.damping), strict=True
    ):
        omega = math.sqrt(float(square))
        found.append(
            NaturalMode(
                frequency_hz=omega / (2.0 * math.pi),
                damping_ratio=float(damping) / (2.0 * omega) if omega else None,
                motion=_motion(model, shape),
                effective_mass={
                    axis: float(shape @ model.mass @ influence) ** 2
                    for axis, influence in model.base.items()
                },
            )
        )
    return tuple(found)


def _motion(model: Model, shape: np.ndarray) -> str:
    if model.coordinates == tuple(MOTIONS):
        return motion_in_words(shape, model.mass)
    shares = energy_shares(shape, model.mass)
    least = min(LEAST_SHARE, shares.max())  # of many coordinates none may have a large share
    order = [k for k in np.argsort(-shares, kind="stable") if shares[k] >= least]
    names = [model.coordinates[k] for k in order]
    return f"{names[0]} with {', '.join(names[1:])}" if names[1:] else names[0]


def at_rest(model: Model) -> tuple[dict[str, float], dict[str, RestingGap]]:
    """Displacements of coordinates and points (m, or rad for rotations) under the constant loads if
    no stop is met, and the gaps in that position. Both are empty without a constant load or without
    a position of rest."""
    loaded = bool(np.any(model.constant_force)) and not functions(model)
    if not loaded or np.any(model.modal.falling):
        return {}, {}
    rest = model.modal.shapes @ model.modal.rest
    rest = np.where(np.abs(rest) > CANCELLATION * np.abs(rest).max(), rest, 0.0)
    places = dict(zip(model.outputs, (model.output_rows @ rest).tolist(), strict=True))
    gaps = {}
    for pair in model.pairs:
        y = float(pair.direction @ rest)
        lower, upper = (
            None if stop is None else -float(stop.deflection(y))
            for stop in (pair.lower, pair.upper)
        )
        gaps[pair.name] = RestingGap(y, lower, upper)
    return places, gaps
