"""Why a structure under noise or sines has no stationary state, in sentences with a remedy."""

from __future__ import annotations

import numpy as np
import scipy

from stochvi.model.model import Model

RESTRAINT_TOLERANCE = 1e-9
"""Largest size of a free motion, dimensionless and at most 1, at which stops and loads are taken to
hold it; what remains is the tolerance of the linear programme that searches for the motion."""


def not_stationary(model: Model) -> list[str]:
    """Sentences on what keeps a model from a stationary state; empty if nothing does.

    Examples
    --------
    >>> from stochvi import Matrices, Scene, WhiteNoise
    >>> from stochvi.model.model import model_of
    >>> free = Matrices(coordinates=["a"], mass=[[1.0]], damping=[[1.0]], stiffness=[[0.0]])
    >>> scene = Scene(structure=free, excitations=[WhiteNoise(intensity=1.0, on="a")])
    >>> not_stationary(model_of(scene))[0].split(":")[0]
    'nothing brings a back'
    """
    found = []
    lossless = not np.any(model.damping) and model.drag is None and not model.functions
    if lossless and model.elastic:
        found.append(
            "nothing takes the energy that the excitation brings: give a spring its damper, or a "
            "stop a restitution below 1"
        )
    lost = _lost(model)
    if np.any(lost):
        name = model.coordinates[int(np.argmax(np.abs(lost)))]
        found.append(
            f"nothing brings {name} back: press it towards a stop by a constant load "
            "(kind = 'constant'), or hold it by a spring or a second stop"
        )
    return found


def _lost(model: Model) -> np.ndarray:
    """A motion (n,) that no spring, stop or constant load opposes; zeros if there is none."""
    modes = model.modal
    free = np.flatnonzero(modes.squares == 0.0)
    if not len(free) or model.restoring is not None or model.functions:
        return np.zeros(len(model.coordinates))
    sides = np.array([stop.side for pair in model.pairs for stop in pair.stops])
    rows = np.repeat(modes.gaps, [len(pair.stops) for pair in model.pairs], axis=0)[:, free]
    limits = np.vstack([sides[:, None] * rows, -modes.falling[free][None]])
    size = np.linalg.norm(limits, axis=1, keepdims=True)
    limits = np.divide(limits, size, out=np.zeros_like(limits), where=size > 0.0)
    for cost in (*np.eye(len(free)), *-np.eye(len(free))):
        way = scipy.optimize.linprog(
            -cost, A_ub=limits, b_ub=np.zeros(len(limits)), bounds=(-1.0, 1.0)
        )
        if way.x is not None and float(cost @ way.x) > RESTRAINT_TOLERANCE:
            return np.asarray(modes.shapes[:, free] @ way.x)
    return np.zeros(len(model.coordinates))
