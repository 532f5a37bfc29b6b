"""Balances that hold for every restitution and any stops; responses state their residuals.

They are stated for M q'' + C q' + K q = g + white forces of intensity S. On a stop, w is the
incident speed, F1 = rate E w and F2 = rate E w^2. y = d . q is the gap of an impact pair, mu its
reduced mass, R the restitution. Sums run over all stops; the impulse pushes y away from the stop:

    energy   tr(M^-1 S) / 2 = E v'C v + sum mu (1 - R^2) F2 / 2
    virial   E v'M v = E (q - o)'K q - (m - o)'g + sum mu (1 + R) |d . o - stop| F1
    force    K m = g +- sum d mu (1 + R) F1,            m = E q

with any fixed o, from the stationarity of E v'M v, E (q - o)'M v and E M v. For one oscillator
they read S0 / 2 = b E v^2 + ..., E v^2 = omega^2 Var x + ... At a compliant stop the mean force
replaces mu (1 + R) F1, and the mean power that the stop takes replaces mu (1 - R^2) F2 / 2; the
virial balance would also need E y F, y the deflection, and is left out. A spring or damper that is
a function of y = d . q has the mean force, E y F and the mean power of what K and C leave out.
Where stops rub, the energy balance has the power of friction, and the others are left out.
Under coloured noise only the force balance holds as it stands; the energy balance gains E f v and
the virial balance E f x.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stochvi.model.model import Model

ENERGIES = ("kinetic", "potential", "dissipation")
"""Names of E v'M v, E (q - o)'K (q - o) and E v'C v (not halved) among the moments of `residuals`.
There each has the key ("", name)."""


AT_REST = 1e-9
"""Terms of the balance of force of a coordinate, relative to the largest of all coordinates, below
which they are the rounding error of those."""


def residuals(
    model: Model, moments: Mapping[tuple[str, str], Any], origin: Sequence[float]
) -> dict[str, Any]:
    """Left side less right side of each balance that applies, relative to its largest term; that
    of a coordinate at rest is relative to the largest of all coordinates.

    Parameters
    ----------
    model
        The model of the scene.
    moments
        By (coordinate, name): `x`, `variance`, `vv`. By (impact pair, name): `f1_lower`,
        `f1_upper`, `f2_lower`, `f2_upper` for rigid stops, or `force_lower`, `force_upper`,
        `loss_lower`, `loss_upper` for compliant ones and for those whose restitution depends on the
        speed, per unit of the reduced mass. By (spring or
        damper that is a function, name): `impulse`, `virial`, `work`, in the same unit. By
        ("", name): `ENERGIES`, which may be left out for a single coordinate. Values are numbers,
        or arrays of one value per independent path.
    origin
        o, about which the potential energy was taken (any position for a single coordinate), m.
    """
    o = np.asarray(origin, float)
    mean = [moments[name, "x"] for name in model.coordinates]
    pushes = _pushes(model, moments)
    sums, scales = {}, {}
    for row, coordinate in enumerate(model.coordinates):
        terms = [model.stiffness[row, k] * mean[k] for k in range(len(mean))]
        terms += [-direction[row] * push for direction, _, push in pushes]
        terms += [
            part.direction[row] * part.mass * moments[part.name, "impulse"]
            for part in model.functions
        ]
        terms += [-direction[row] * each.mean for each, direction in model.drawn]
        terms.append(-model.constant_force[row] + 0.0 * mean[row])
        # all terms may vanish by symmetry, but not the rms force of the coordinate's own spring
        deviation = _mean(moments[coordinate, "variance"]) ** 0.5
        name = "force" if len(mean) == 1 else f"force on {coordinate}"
        sums[name] = sum(terms)
        scales[name] = _scale(terms, model.stiffness[row, row] * deviation)
    # a coordinate that is at rest but for rounding is missed by nothing beside the others
    largest = max(scales.values())
    found = {
        name: each / (scales[name] if scales[name] > AT_REST * largest else largest)
        for name, each in sums.items()
    }
    rubs = any(pair.tangent is not None for pair in model.pairs)
    if rubs:  # mean impulses along stops, and of coupled impacts, are not added up
        found.clear()
    if (
        model.tables
        or model.drawn
        or model.moves_stops
        or any(np.any(signal.direction) for signal in model.signals)
    ):
        return found
    energies = _energies(model, moments, o)
    supply = float(np.trace(np.linalg.solve(model.mass, model.white))) / 2.0
    balances = {
        "energy": [
            supply, -energies["dissipation"], *_losses(model, moments),
            *(-part.mass * moments[part.name, "work"] for part in model.functions),
            *(
                -pair.mass * moments[pair.name, "rubbing"]
                for pair in model.pairs
                if pair.tangent is not None
            ),
        ],
        "virial": [
            energies["kinetic"],
            -energies["potential"],
            *((o[k] - mean[k]) * force for k, force in enumerate(model.stiffness @ o)),
            *((mean[k] - o[k]) * load for k, load in enumerate(model.constant_force)),
            *((stop - direction @ o) * push for direction, stop, push in pushes),
            *(
                part.mass * (part.direction @ o * moments[part.name, "impulse"]
                             - moments[part.name, "virial"])
                for part in model.functions
            ),
        ],
    }  # fmt: skip
    if rubs or not model.rigid:
        del balances["virial"]
    return {name: sum(terms) / _scale(terms) for name, terms in balances.items()} | found


def _pushes(model: Model, moments: Mapping[tuple[str, str], Any]) -> list[tuple[Any, float, Any]]:
    """(direction, position, mean force on y) of every stop, the force positive towards larger y."""
    found = []
    for pair in model.pairs:
        for stop in pair.stops:
            if not stop.summed:
                force = (1.0 + stop.law.restitution) * moments[pair.name, f"f1_{stop.name}"]
            else:
                force = moments[pair.name, f"force_{stop.name}"]
            force = pair.mass * force
            found.append((pair.direction, stop.position, -stop.side * force))
    return found


def _losses(model: Model, moments: Mapping[tuple[str, str], Any]) -> list[Any]:
    """Mean power lost at every stop, W, with a negative sign."""
    found = []
    for pair in model.pairs:
        for stop in pair.stops:
            if not stop.summed:
                square = moments[pair.name, f"f2_{stop.name}"]
                loss = (1.0 - stop.law.restitution_mean_square) / 2.0 * square
            else:
                loss = moments[pair.name, f"loss_{stop.name}"]
            found.append(-pair.mass * loss)
    return found


def _energies(model: Model, moments: Mapping[tuple[str, str], Any], origin: Any) -> dict[str, Any]:
    if ("", "kinetic") in moments:
        return {name: moments["", name] for name in ENERGIES}
    (coordinate,) = model.coordinates
    square = moments[coordinate, "variance"] + (moments[coordinate, "x"] - origin[0]) ** 2
    return {
        "kinetic": model.mass[0, 0] * moments[coordinate, "vv"],
        "potential": model.stiffness[0, 0] * square,
        "dissipation": model.damping[0, 0] * moments[coordinate, "vv"],
    }


def _scale(terms: list[Any], floor: float = 0.0) -> float:
    return max(floor, 1e-300, *(abs(_mean(term)) for term in terms))


def _mean(term: Any) -> float:
    """Mean over all paths. A plain number is returned at once, because the propagation of errors
    asks for thousands of them."""
    return float(term) if isinstance(term, float) else float(np.mean(term))
