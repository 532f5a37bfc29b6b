"""Balances that hold for every restitution, any stops: tests of a method, residuals of a report.

For M q'' + C q' + K q = g + white forces of intensity S, with w the incident speed on a stop,
F1 = rate E w and F2 = rate E w^2 there, y = d . q of an impact pair, mu its reduced mass and R the
restitution; sums over all stops, the impulse pushing y away from the stop:

    energy   tr(M^-1 S) / 2 = E v'C v + sum mu (1 - R^2) F2 / 2
    virial   E v'M v = E (q - o)'K q - (m - o)'g + sum mu (1 + R) |d . o - stop| F1
    force    K m = g +- sum d mu (1 + R) F1,            m = E q

with any fixed o, from the stationarity of E v'M v, E (q - o)'M v and E M v. For one oscillator
they read S0 / 2 = b E v^2 + ..., E v^2 = omega^2 Var x + ... At a stop that gives way the mean
force stands for mu (1 + R) F1 and the mean power that it takes for mu (1 - R^2) F2 / 2; the virial
then also holds E y F, y the deflection, and is left out. For coloured noise only the last one
holds as it stands; the others gain E f v and E f x.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stochvi.model.assembly import Assembly
from stochvi.scenes.impact_laws import Restitution

ENERGIES = ("kinetic", "potential", "dissipation")
"""E v'M v, E (q - o)'K (q - o) and E v'C v (not halved), with the key ("", name)."""


def residuals(
    assembly: Assembly, moments: Mapping[tuple[str, str], Any], origin: Sequence[float]
) -> dict[str, Any]:
    """Left side less right side of each balance that applies, relative to its largest term.

    Parameters
    ----------
    assembly
        The scene as matrices.
    moments
        By (coordinate, name): `x`, `variance`, `vv`; by (impact pair, name): `f1_lower`,
        `f1_upper`, `f2_lower`, `f2_upper`, of stops that give way instead `force_lower`,
        `force_upper`, `loss_lower`, `loss_upper`, per unit of the reduced mass; by ("", name):
        `ENERGIES`, which may be left out for a single coordinate. Numbers, or arrays of one
        value per independent path.
    origin
        o, about which the potential energy was taken (of a single coordinate: any position).
    """
    o = np.asarray(origin, float)
    mean = [moments[name, "x"] for name in assembly.coordinates]
    found = {}
    pushes = _pushes(assembly, moments)
    for row, coordinate in enumerate(assembly.coordinates):
        terms = [assembly.stiffness[row, k] * mean[k] for k in range(len(mean))]
        terms += [-direction[row] * push for direction, _, push in pushes]
        terms.append(-assembly.load[row] + 0.0 * mean[row])
        # all may vanish by symmetry: the rms force of the coordinate's own spring does not
        deviation = float(np.mean(moments[coordinate, "variance"])) ** 0.5
        name = "force" if len(mean) == 1 else f"force on {coordinate}"
        found[name] = sum(terms) / _scale(terms, assembly.stiffness[row, row] * deviation)
    if assembly.signals or assembly.tables:
        return found
    energies = _energies(assembly, moments, o)
    supply = float(np.trace(np.linalg.solve(assembly.mass, assembly.white))) / 2.0
    balances = {
        "energy": [supply, -energies["dissipation"], *_losses(assembly, moments)],
        "virial": [
            energies["kinetic"],
            -energies["potential"],
            *((o[k] - mean[k]) * force for k, force in enumerate(assembly.stiffness @ o)),
            *((mean[k] - o[k]) * load for k, load in enumerate(assembly.load)),
            *((stop - direction @ o) * push for direction, stop, push in pushes),
        ],
    }
    if assembly.not_rigid():
        del balances["virial"]
    return {name: sum(terms) / _scale(terms) for name, terms in balances.items()} | found


def _pushes(
    assembly: Assembly, moments: Mapping[tuple[str, str], Any]
) -> list[tuple[Any, float, Any]]:
    """(direction, stop, mean force on y) of every stop, the force positive upwards."""
    found = []
    for contact in assembly.contacts:
        for side, stop, law in contact.stops:
            if isinstance(law, Restitution):
                force = (1.0 + law.coefficient) * moments[contact.name, f"f1_{side}"]
            else:
                force = moments[contact.name, f"force_{side}"]
            force = contact.mass * force
            found.append((contact.direction, stop, force if side == "lower" else -force))
    return found


def _losses(assembly: Assembly, moments: Mapping[tuple[str, str], Any]) -> list[Any]:
    """Power lost at every stop, negative."""
    found = []
    for contact in assembly.contacts:
        for side, _, law in contact.stops:
            if isinstance(law, Restitution):
                square = moments[contact.name, f"f2_{side}"]
                loss = (1.0 - law.coefficient**2) / 2.0 * square
            else:
                loss = moments[contact.name, f"loss_{side}"]
            found.append(-contact.mass * loss)
    return found


def _energies(
    assembly: Assembly, moments: Mapping[tuple[str, str], Any], origin: Any
) -> dict[str, Any]:
    if ("", "kinetic") in moments:
        return {name: moments["", name] for name in ENERGIES}
    (coordinate,) = assembly.coordinates
    square = moments[coordinate, "variance"] + (moments[coordinate, "x"] - origin[0]) ** 2
    return {
        "kinetic": assembly.mass[0, 0] * moments[coordinate, "vv"],
        "potential": assembly.stiffness[0, 0] * square,
        "dissipation": assembly.damping[0, 0] * moments[coordinate, "vv"],
    }


def _scale(terms: list[Any], floor: float = 0.0) -> float:
    return max(floor, 1e-300, *(abs(float(np.mean(term))) for term in terms))
