"""Balances that hold for every restitution, any stops: tests of a method, residuals of a report.

With w the incident speed, F1 = rate E w and F2 = rate E w^2 at each stop, b and omega of the
structure, S0 the intensity of white noise, g a constant load per unit mass, R the restitution:

    energy   S0 / 2 = b E v^2 + (1 - R_l^2) F2_l / 2 + (1 - R_u^2) F2_u / 2
    virial   E v^2 = omega^2 Var x + (1 + R_l) (m - lower) F1_l + (1 + R_u) (upper - m) F1_u
    force    omega^2 m = g + (1 + R_l) F1_l - (1 + R_u) F1_u,            m = E x

They follow from the stationarity of E v^2, E (x - m) v and E v. For coloured noise only the last
one holds as it stands; the others gain E f v and E f x.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stochvi.scenes import System


def residuals(system: System, moments: Mapping[str, Any]) -> dict[str, Any]:
    """Left side less right side of each balance that applies, relative to its largest term.

    Parameters
    ----------
    system
        The scene per unit mass.
    moments
        `x`, `variance`, `vv` (E x, Var x, E v^2) and `f1_lower`, `f1_upper`, `f2_lower`,
        `f2_upper`; numbers, or arrays of one value per independent path.
    """
    lower, r_lower = system.lower or 0.0, _or_zero(system.restitution_lower)
    upper, r_upper = system.upper or 0.0, _or_zero(system.restitution_upper)
    push = (1.0 + r_lower) * moments["f1_lower"]
    pull = (1.0 + r_upper) * moments["f1_upper"]
    stiff = system.omega**2
    terms = {"force": [stiff * moments["x"], -push, pull, -system.load + 0.0 * moments["x"]]}
    if not system.tables:
        loss_lower = (1.0 - r_lower**2) / 2.0 * moments["f2_lower"]
        loss_upper = (1.0 - r_upper**2) / 2.0 * moments["f2_upper"]
        supply = system.intensity / 2.0 + 0.0 * moments["x"]
        terms["energy"] = [supply, -system.damping_rate * moments["vv"], -loss_lower, -loss_upper]
        terms["virial"] = [
            moments["vv"],
            -stiff * moments["variance"],
            (lower - moments["x"]) * push,
            (moments["x"] - upper) * pull,
        ]
    # the terms of the force balance may all vanish by symmetry: the spring's rms force does not
    floor = {"force": stiff * float(np.mean(moments["variance"])) ** 0.5}
    return {name: sum(parts) / _scale(parts, floor.get(name, 0.0)) for name, parts in terms.items()}


def _or_zero(restitution: float | None) -> float:
    return 0.0 if restitution is None else restitution


def _scale(parts: list[Any], floor: float) -> float:
    return max(floor, 1e-300, *(abs(float(np.mean(part))) for part in parts))
