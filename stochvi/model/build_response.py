"""How a response is made. Chapters: balances of energy and forces; error of an approximation, from
the atlas of linearisation; the common form of a response."""

from __future__ import annotations

import csv
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.impact_rates import (
    COLLAPSE_RESTITUTION,
    ContactStatistics,
    StopStatistics,
    more_than_counted,
)
from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.spectra import response_moments
from stochvi.model.coverage import functions, scene_notes, speed_restitutions
from stochvi.model.model import Model, Pair, Stop, model_of
from stochvi.results.base import CoordinateResponse, PairResponse, Response
from stochvi.results.estimates import Cost, Estimate, provenance
from stochvi.scenes.datasets import data_folder
from stochvi.scenes.scene import Scene

# ------------------------------------------------------------------------------
# Balances that hold for every restitution and any stops; responses state their residuals.
#
# They are stated for M q'' + C q' + K q = g + white forces of intensity S. On a stop, w is the
# incident speed, F1 = rate E w and F2 = rate E w^2. y = d . q is the gap of an impact pair, mu its
# reduced mass, R the restitution. Sums run over all stops; the impulse pushes y away from the stop:
#
#     energy   tr(M^-1 S) / 2 = E v'C v + sum mu (1 - R^2) F2 / 2
#     virial   E v'M v = E (q - o)'K q - (m - o)'g + sum mu (1 + R) |d . o - stop| F1
#     force    K m = g +- sum d mu (1 + R) F1,            m = E q
#
# with any fixed o, from the stationarity of E v'M v, E (q - o)'M v and E M v. For one oscillator
# they read S0 / 2 = b E v^2 + ..., E v^2 = omega^2 Var x + ... At a compliant stop the mean force
# replaces mu (1 + R) F1, and the mean power that the stop takes replaces mu (1 - R^2) F2 / 2; the
# virial balance would also need E y F, y the deflection, and is left out. A spring or damper that
# is a function of y = d . q has the mean force, E y F and the mean power of what K and C leave out.
# Where stops rub, the energy balance has the power of friction, and the others are left out. Under
# coloured noise only the force balance holds as it stands; the energy balance gains E f v and the
# virial balance E f x.
# ------------------------------------------------------------------------------


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
        or model.branches
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
    return [-power_of_stop(pair, stop, moments) for pair in model.pairs for stop in pair.stops]


def power_of_stop(pair: Pair, stop: Stop, moments: Mapping[tuple[str, str], Any]) -> Any:
    """Mean power that a stop takes, W, from the `moments` of `residuals`: the work of its contacts,
    or what a rigid one of one restitution takes of F2."""
    if stop.summed:
        return pair.mass * moments[pair.name, f"loss_{stop.name}"]
    loss = (1.0 - stop.law.restitution_mean_square) / 2.0
    return pair.mass * loss * moments[pair.name, f"f2_{stop.name}"]


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


# ------------------------------------------------------------------------------
# Error of an approximation, read from an atlas of its errors over all oscillators with stops.
#
# Up to units, one oscillator in white noise has these numbers: zeta, the R of its stops, and their
# places about the rest position, in standard deviations without stops. The atlas
# (`data/linearisation_atlas`) holds ln(answer / truth) of every form on a grid of gap, R and zeta,
# for symmetric stops and for a single one. The span of the corners of a scene's cell, times a
# safety, bounds its error. Two unlike stops have no grid: they are given the largest error of their
# relatives in it, times a larger safety.
# ------------------------------------------------------------------------------


QUANTITIES = ("mean", "sigma_x", "sigma_v", "upcrossing", "rate", "f1", "f2")
"""Columns of the atlas: the error of the mean in deviations, (answer - truth) / sigma_x, and
ln(answer / truth) of the other quantities."""

TWO, ONE = "two", "one"
"""The kinds of stops of the atlas: two at -gap and gap, or one at `gap` outwards from rest (below
0: a preload)."""

SAFETY = 1.25
"""Factor on the largest error at the corners of a cell, for what errors do between the corners."""

UNLIKE_SAFETY = 2.0
"""Factor on the largest error of the relatives of two unlike stops. With it and `SAFETY` more than
99 % of the bounds hold in scenes that were not used to choose them
(studies/13_linearisation_atlas)."""

ONE_SIDED_SAFETY = 2.0
"""Extra factor on the bound of F2 of two unlike stops. Where one stop keeps energy and the other
takes it no relative has the error: at zeta 0.006, R = 1 and 0.5, the closure was off by 1.95 times
the bound without this factor."""

CLUMPS_SAFETY = 3.0
"""Extra factor on `UNLIKE_SAFETY` for the form "clumps", whose distribution of the energy knows
less of two stops that differ. In 250 scenes of zeta 0.005 to 0.03, one stop nearly elastic and the
other lossy, errors came to 2.7 times the bounds without it."""

REFERENCE_ERROR = 1e-3
"""Error in the logarithm that every bound includes: the truth of the atlas is no better."""

LARGEST = 3.0
"""Largest logarithm of an error, a factor of 20, for which a bound is given: a larger bound would
be useless."""


FILES = {"average:finite jumps": "average"}
"""Files of the methods that are no form of a linearisation."""


DENSITY_LEVELS = (
    0.005, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.995,
)  # fmt: skip
"""Probabilities of a smaller displacement, counted towards a single stop, at which the atlas has
the errors of averaged densities."""


class LogErrorInterval(NamedTuple):
    """The interval in which ln(answer / truth) lies."""

    low: float
    high: float

    def bound(self, power: float = 1.0) -> float:
        """Largest |answer - truth| / answer of the power of a quantity."""
        return max(1.0 - math.exp(-power * self.high), math.exp(-power * self.low) - 1.0)

    def over(self, other: LogErrorInterval) -> LogErrorInterval:
        """The interval of the ratio of two quantities."""
        return LogErrorInterval(self.low - other.high, self.high - other.low)

    @property
    def largest(self) -> float:
        """The largest error of either sign."""
        return max(-self.low, self.high)


class Grid(NamedTuple):
    """Errors of one form for one kind of stops: axes, and an array (gap, R, zeta, quantity)."""

    gaps: NDArray[np.float64]
    restitutions: NDArray[np.float64]
    zetas: NDArray[np.float64]
    errors: NDArray[np.float64]

    def corners(self, gap: float, restitution: float, zeta: float) -> NDArray[np.float64]:
        """Errors at the corners of a cell, (corner, quantity); rows may hold nan (no rate)."""
        places = []
        for axis, value in (
            (self.gaps, gap),
            (self.restitutions, restitution),
            (self.zetas, zeta),
        ):
            k = int(np.clip(np.searchsorted(axis, value) - 1, 0, len(axis) - 2))
            # on a node the cell is the node itself
            places.append([j for j in (k, k + 1) if value not in axis or axis[j] == value])
        found = self.errors[np.ix_(*places)]
        return found.reshape(-1, self.errors.shape[-1])

    def holds(self, gap: float, zeta: float) -> bool:
        """Whether a place lies within the grid."""
        inside = self.gaps[0] <= gap <= self.gaps[-1]
        return bool(inside and self.zetas[0] <= zeta <= self.zetas[-1])


@cache
def atlas(method: str) -> Mapping[str, Grid] | None:
    """The grids of a method ("linearise:closure", ...), by kind of stops; None if it has none."""
    family, _, form = method.partition(":")
    name = form.replace(":", "-") if family == "linearise" else FILES.get(method, "")
    return _grids(name, QUANTITIES)


@cache
def _grids(file_name: str, quantities: Sequence[str]) -> Mapping[str, Grid] | None:
    """The grids of a file, by kind of stops; None where there is none."""
    path = data_folder() / "linearisation_atlas" / f"{file_name}.csv"
    if not path.is_file():
        return None
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {
        kind: _grid([row for row in rows if row["stops"] == kind], quantities)
        for kind in (TWO, ONE)
    }


def _grid(rows: Sequence[Mapping[str, str]], quantities: Sequence[str]) -> Grid:
    def column(name: str) -> NDArray[np.float64]:
        return np.array([row[name] or "nan" for row in rows], dtype=float)

    axes, places = zip(
        *(np.unique(column(name), return_inverse=True) for name in ("gap", "restitution", "zeta")),
        strict=True,
    )
    errors = np.full((*map(len, axes), len(quantities)), np.nan)
    errors[places] = np.column_stack([column(name) for name in quantities])
    gaps, restitutions, zetas = axes
    return Grid(gaps, restitutions, zetas, errors)


class Place(NamedTuple):
    """A scene in the atlas: of each stop its distance outwards from rest, in deviations, and its
    R; and zeta."""

    stops: tuple[tuple[float, float], ...]
    zeta: float

    @property
    def unlike(self) -> bool:
        """Whether there are two stops, and they differ."""
        if len(self.stops) < 2:
            return False
        (lower, r_lower), (upper, r_upper) = self.stops
        return not math.isclose(lower, upper, rel_tol=1e-9) or r_lower != r_upper


def place_of(model: Model) -> Place | str:
    """Where a scene lies, or the reason why it has no place."""
    if model.tables or model.filters:
        return "the atlas knows white noise alone"
    if not model.rigid:
        return "the atlas knows rigid stops"
    if model.scattered:
        return "the atlas knows restitutions that do not scatter"
    if speed_restitutions(model):
        return "the atlas knows restitutions that do not depend on the speed"
    if model.omega == 0.0 or model.damping_rate == 0.0:
        return "the atlas knows no mass without a spring or a damper"
    deviation = math.sqrt(model.intensity / (2.0 * model.damping_rate)) / model.omega
    stops = tuple(
        (stop.side * (stop.position - model.rest) / deviation, stop.law.restitution)
        for stop in model.stops_per_unit_mass
    )
    return Place(stops, model.damping_rate / (2.0 * model.omega))


def spans(method: str, model: Model) -> Mapping[str, LogErrorInterval] | str:
    """Where the errors of a method lie in a scene, by quantity; or the reason why they are unknown.

    A quantity is left out where its error is unknown: the rate at R <= exp(-pi / sqrt 3), where the
    true one is infinite, and in the cell above it; what a form does not give; anything that may
    be wrong by more than a factor of exp(LARGEST).

    Examples
    --------
    >>> from stochvi.model.model import model_of
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair, Scene
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=0.8))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> span = spans("linearise:closure", model_of(scene))["sigma_v"]
    >>> span.low < -0.012 < span.high
    True
    """
    grids, place = atlas(method), place_of(model)
    if grids is None:
        return "this form has no atlas"
    if isinstance(place, str):
        return place
    found = _corners(grids, place)
    if isinstance(found, str):
        return found
    least = min(restitution for _, restitution in place.stops)
    known = {}
    for k, name in enumerate(QUANTITIES):
        column = found[:, k]
        if np.isfinite(column).all() and not (name == "rate" and least <= COLLAPSE_RESTITUTION):
            span = _widened(column, _unlike_safety(method, name) if place.unlike else SAFETY)
            if span.largest < LARGEST:
                known[name] = span
    return known


def density_spans(model: Model, levels: Vector) -> tuple[Vector, Vector] | str:
    """Where ln(answer / truth) of the averaged density of the displacement lies.

    Parameters
    ----------
    model
        The model of a scene.
    levels
        Probabilities of a smaller displacement, by the averaged density.

    Returns
    -------
    tuple of arrays, or str
        The ends of the interval at each level; NaN beyond the first and the last of
        `DENSITY_LEVELS`. Else the reason why they are unknown.
    """
    grids, place = _grids("average-density", tuple(map(str, DENSITY_LEVELS))), place_of(model)
    assert grids is not None
    if isinstance(place, str):
        return place
    if place.unlike:
        return "the atlas knows densities between two like stops, or beside one"
    found = _corners(grids, place)
    if isinstance(found, str):
        return found
    (first, *_), known = model.stops, np.asarray(DENSITY_LEVELS)
    towards = 1.0 - levels if len(model.stops) == 1 and first.side < 0 else levels
    after = np.clip(np.searchsorted(known, towards), 1, len(known) - 1)
    inside = (known[0] <= towards) & (towards <= known[-1])
    ends = []
    for sign, extreme in ((-1.0, found.min(axis=0)), (1.0, found.max(axis=0))):
        most = np.maximum(sign * extreme, 0.0)
        reach = SAFETY * np.maximum(most[after - 1], most[after]) + REFERENCE_ERROR
        ends.append(np.where(inside, sign * reach, np.nan))
    return ends[0], ends[1]


def _unlike_safety(method: str, quantity: str) -> float:
    """The factor on the bound of a quantity between two stops that differ."""
    if method.endswith(":clumps"):
        return UNLIKE_SAFETY * CLUMPS_SAFETY
    return UNLIKE_SAFETY * (ONE_SIDED_SAFETY if quantity == "f2" else 1.0)


def _widened(errors: NDArray[np.float64], safety: float) -> LogErrorInterval:
    """Range of errors, extended to include zero and multiplied by a safety factor."""
    low, high = min(float(errors.min()), 0.0), max(float(errors.max()), 0.0)
    return LogErrorInterval(safety * low - REFERENCE_ERROR, safety * high + REFERENCE_ERROR)


def _corners(grids: Mapping[str, Grid], place: Place) -> NDArray[np.float64] | str:
    """The errors that bear on a place, (corner, quantity); or why it is outside of the atlas."""
    two, one = grids[TWO], grids[ONE]
    if not two.zetas[0] <= place.zeta <= two.zetas[-1]:
        return f"zeta = {place.zeta:.3g} is outside of the atlas, {two.zetas[0]} to {two.zetas[-1]}"
    if not place.unlike:
        grid, (gap, restitution) = (one if len(place.stops) == 1 else two), place.stops[0]
        if not grid.holds(gap, place.zeta):
            return _outside(gap, grid)
        return grid.corners(gap, restitution, place.zeta)
    return _relatives(two, one, place.stops, place.zeta)


def _outside(gap: float, grid: Grid) -> str:
    return (
        f"a stop at {gap:.3g} deviations is outside of the atlas, "
        f"{grid.gaps[0]:g} to {grid.gaps[-1]:g}"
    )


def _relatives(
    two: Grid, one: Grid, stops: Sequence[tuple[float, float]], zeta: float
) -> NDArray[np.float64] | str:
    """The errors of the relatives of two unlike stops: of each alone, and of symmetric stops of
    either kind at its own gap and at the mean gap.

    A difference of two stops may turn the sign of an error, so that both signs count.
    """
    narrow = sum(gap for gap, _ in stops) / 2.0
    if narrow < two.gaps[0]:
        return f"stops {2.0 * narrow:.3g} deviations apart are outside of the atlas"
    found = []
    for gap, restitution in stops:
        if not one.holds(gap, zeta):
            return _outside(gap, one)
        found.append(one.corners(gap, restitution, zeta))
        for half in (narrow, gap):
            inside = min(max(half, float(two.gaps[0])), float(two.gaps[-1]))
            found.append(two.corners(inside, restitution, zeta))
    corners = np.concatenate(found)
    # symmetric relatives have no error of the mean; an error of their deviation stands for it here
    corners[:, 0] = np.abs(corners[:, :2]).max(axis=1)
    return np.concatenate([corners, -corners])


def with_bounds(response: Response, model: Model) -> Response:
    """The response with the bounds of the atlas as `bias`, or the reason for none in `how`."""
    known = spans(response.method, model)
    if isinstance(known, str):
        return _explained(response, {}, f"no error bound: {known}")
    relative = _relative_bounds(known, one_rate=_one_rate(model))
    bounds = {}
    for (_, name), estimate in response.estimates().items():
        if name in relative:
            bounds[name] = relative[name] * abs(estimate.value)
    found = {name: estimate for (_, name), estimate in response.estimates().items()}
    if {"mean", "sigma_x"} <= known.keys():
        deviation = found["displacement_std"].value * math.exp(known["sigma_x"].largest)
        mean = known["mean"].largest * deviation
        bounds["displacement_mean"] = mean
        bounds["displacement_mean_square"] = (
            2.0 * abs(found["displacement_mean"].value) * mean
            + mean**2
            + known["sigma_x"].bound(2.0) * found["displacement_std"].value ** 2
        )
    return _explained(response, bounds, "error bound from the atlas")


def _one_rate(model: Model) -> bool:
    """Whether the rate of a stop errs as that of both: for a single one, and for symmetric ones."""
    place = place_of(model)
    return isinstance(place, Place) and not place.unlike


def _relative_bounds(known: Mapping[str, LogErrorInterval], *, one_rate: bool) -> dict[str, float]:
    """Bounds of the quantities of a response, over their values."""
    names = {
        "displacement_std": ("sigma_x", 1.0),
        "velocity_std": ("sigma_v", 1.0),
        "velocity_mean_square": ("sigma_v", 2.0),
        "upcrossing_rate": ("upcrossing", 1.0),
        "collision_rate": ("rate", 1.0),
        "impact_speed_rate": ("f1", 1.0),
        "impact_speed_square_rate": ("f2", 1.0),
    }
    if one_rate:
        names |= dict.fromkeys(("collision_rate_lower", "collision_rate_upper"), ("rate", 1.0))
    bounds = {
        name: known[quantity].bound(power)
        for name, (quantity, power) in names.items()
        if quantity in known
    }
    if {"rate", "f1"} <= known.keys():
        bounds["impact_speed_mean"] = known["f1"].over(known["rate"]).bound()
    return bounds


def _explained(response: Response, bounds: Mapping[str, float], words: str) -> Response:
    """Every estimate with its bound where there is one, and the words after its `how`."""

    def explained(name: str, entry: Estimate) -> Estimate:
        says = words if name in bounds or not bounds else "no error bound: not in the atlas"
        return replace(entry, bias=bounds.get(name), how=f"{entry.how}; {says}")

    return response.changed(explained)


# ------------------------------------------------------------------------------
# Responses in the common form; those of deterministic methods from their stationary moments.
# ------------------------------------------------------------------------------


NO_MEAN_SPEED = (
    "no mean impact speed is given: F1 is more than the counted impacts have, "
    "as a mass rests on its stop or many impacts are slower than the threshold"
)
"""Warning where F1 over the rate is no mean speed."""

MOST_ENERGY_CHANGE = 0.1
"""Largest share of the energy that noise and damping may change during a contact, if its peak force
is to follow from the energy alone. Other modes may change as large a share of its way."""


def alone(duration: float) -> float:
    """No share of the way of a contact comes from other modes, as there are none."""
    return 0.0


def build_response(
    scene: Scene,
    method: str,
    *,
    coordinates: Mapping[str, CoordinateResponse],
    impact_pairs: Mapping[str, PairResponse],
    identities: Mapping[str, Estimate],
    cost: Cost,
    assumptions: Sequence[str] = (),
    warnings: Sequence[str] = (),
) -> Response:
    """The response of a scene by a method, with what the scene contributes to every response.

    Effects, assumptions of the scene, notes on one oscillator (`scene_notes`) and the provenance
    come from the scene, so that no method can leave them out.

    Parameters
    ----------
    assumptions, warnings
        Assumptions and warnings of the method, which follow those of the scene.
    """
    model = model_of(scene)
    # those on the motion hold for the response to noise alone, not for a scene with sines
    notes = [*model.cautions] if model.sines else scene_notes(model)
    return Response(
        method=method,
        coordinates={**coordinates, **_of_followers(model, coordinates)},
        impact_pairs=impact_pairs,
        identities=identities,
        effects=scene.effects(),
        assumptions=[*scene.assumptions(), *assumptions],
        warnings=[*notes, *scene.cautions(), *warnings],
        cost=cost,
        provenance=provenance(scene.document()),
    )


def _of_followers(
    model: Model, coordinates: Mapping[str, CoordinateResponse]
) -> dict[str, CoordinateResponse]:
    """Motions of points that move in proportion to the only coordinate."""
    found = {}
    for point, ratio in model.followers.items():
        factors = {"displacement_mean": ratio, "displacement_mean_square": ratio**2,
                   "velocity_mean_square": ratio**2, "upcrossing_rate": 1.0}  # fmt: skip
        known = vars(coordinates[model.coordinates[0]])
        found[point] = CoordinateResponse(
            **{
                name: None if each is None else each * factors.get(name, abs(ratio))
                for name, each in known.items()
            }
        )
    return found


def coordinate_of(
    estimate: Callable[[str, float], Estimate], mean: float, variance: float, square: float,
    acceleration: float | None = None, upcrossing_rate: float | None = None,
) -> CoordinateResponse:  # fmt: skip
    """The quantities of a coordinate from its mean (m), its variance, and the mean squares of its
    velocity and acceleration; `estimate` makes each of its name and value."""
    values = {
        "displacement_mean": mean,
        "displacement_std": math.sqrt(variance),
        "displacement_mean_square": mean**2 + variance,
        "velocity_std": math.sqrt(square),
        "velocity_mean_square": square,
        "acceleration_std": None if acceleration is None else math.sqrt(acceleration),
        "upcrossing_rate": upcrossing_rate,
    }
    return CoordinateResponse(
        **{name: estimate(name, each) for name, each in values.items() if each is not None}
    )


@dataclass(frozen=True, kw_only=True)
class StationaryMoments:
    """Stationary moments, in SI units per unit mass, as a deterministic method finds them.

    Where a method has no law for the rates at a stop, they are None in its `StopStatistics`. The
    contact statistics of a rigid stop are None. `errors`, if a method knows them, has the same
    fields with a bound on the error of each number.
    """

    mean: float
    variance: float
    velocity_mean_square: float
    upcrossing_rate: float
    lower: StopStatistics
    upper: StopStatistics
    acceleration_mean_square: float | None = None
    contact_lower: ContactStatistics | None = None
    contact_upper: ContactStatistics | None = None
    errors: StationaryMoments | None = None

    def response(
        self,
        method: str,
        scene: Scene,
        *,
        how: str,
        started: float,
        bias: float | None = 0.0,
        assumptions: Sequence[str] = (),
        speed_threshold: float = 0.0,
    ) -> Response:
        """The answer in the form that every method returns; `bias` is used where there are no
        `errors`."""
        model = model_of(scene)
        biases = self._biases(model.unit_mass)
        if self.errors is not None and accelerates_between_impacts(model):
            square = self._between_impacts(model, self.variance, self.velocity_mean_square)
            error = self._between_impacts(
                model, self.errors.variance, self.errors.velocity_mean_square
            )
            biases["acceleration_std"] = error / (2.0 * math.sqrt(square))

        def estimate(name: str, value: float) -> Estimate:
            return Estimate(value=value, bias=biases.get(name, bias), how=how)

        acceleration = self.acceleration_mean_square
        if acceleration is None and accelerates_between_impacts(model):
            acceleration = self._between_impacts(model, self.variance, self.velocity_mean_square)
            assumptions = [*assumptions, BETWEEN_IMPACTS]
        if not model.elastic:
            counted = (
                f"faster than {speed_threshold:.3g} m/s" if speed_threshold else "of all speeds"
            )
            assumptions = [*assumptions, f"rates count impacts {counted}"]
        coordinate = coordinate_of(
            estimate, self.mean, self.variance, self.velocity_mean_square, acceleration,
            self.upcrossing_rate,
        )  # fmt: skip
        return build_response(
            scene,
            method,
            coordinates={model.coordinates[0]: coordinate},
            impact_pairs={
                pair.name: self.pair(pair, model.damping_rate, how, bias, speed_threshold)
                for pair in model.pairs
            },
            assumptions=assumptions,
            warnings=[NO_MEAN_SPEED] if self._impacts[0] and self._speed_mean() is None else [],
            cost=Cost(wall_time=time.perf_counter() - started),
            identities=self._identities(model, how),
        )

    @staticmethod
    def _between_impacts(model: Model, variance: float, square: float) -> float:
        """Mean square of omega^2 x + b x' about its mean, (m/s^2)^2.

        It follows from the mean squares of x and x' alone: they are not correlated, because E x^2
        is stationary and impacts do not change x.
        """
        return model.omega**4 * variance + model.damping_rate**2 * square

    def pair(
        self,
        pair: Pair,
        damping_rate: float,
        how: str,
        bias: float | None = 0.0,
        speed_threshold: float = 0.0,
        others: Callable[[float], float] = alone,
    ) -> PairResponse:
        """The quantities of an impact pair.

        `damping_rate` (1/s) acts during contacts; `others` gives the share of the way in a contact
        of some duration, s, that other modes change.
        """
        biases = self._biases(pair.mass)
        values = self._of_pair(pair.mass) | {"impact_speed_mean": self._speed_mean()}
        for side in ("lower", "upper"):
            if getattr(pair, side) is None:
                del values[f"collision_rate_{side}"]
        found = {
            name: Estimate(value=value, bias=biases.get(name, bias), how=how)
            for name, value in values.items()
            if value is not None
        }
        return PairResponse(
            **found,
            peak_force=self._peak_force(pair, damping_rate, how, bias, others),
            speed_threshold=speed_threshold,
        )

    def at(self, stop: Stop) -> tuple[StopStatistics, ContactStatistics | None]:
        """Statistics of a stop: its impacts, and its contacts if it is compliant."""
        if stop.side > 0:
            return self.upper, self.contact_upper
        return self.lower, self.contact_lower

    def _of_pair(self, mass: float) -> dict[str, float | None]:
        """Rates of impacts, share of time in contact with either stop, and mean forces on them,
        N."""
        contacts = (self.contact_lower, self.contact_upper)
        forces = [None if contact is None else mass * contact.force for contact in contacts]
        shares = [contact.probability for contact in contacts if contact is not None]
        rate, speed_rate, square_rate = self._impacts
        return {
            "collision_rate": rate,
            "collision_rate_lower": self.lower.rate,
            "collision_rate_upper": self.upper.rate,
            "impact_speed_rate": speed_rate,
            "impact_speed_square_rate": square_rate,
            "contact_probability": sum(shares) if shares else None,
            "contact_force_lower": forces[0],
            "contact_force_upper": forces[1],
        }

    def _peak_force(
        self, pair: Pair, damping_rate: float, how: str, bias: float | None,
        others: Callable[[float], float],
    ) -> Estimate | None:  # fmt: skip
        """Mean over all contacts of their largest force, N, neglecting noise, damping and other
        modes in them.

        In a contact of the duration t, noise and damping change the energy by the share b t. Where
        that, or what other modes change, is more than `MOST_ENERGY_CHANGE`, no number is given.
        Its bias is known only where that of the other numbers of the stop is.
        """
        found = []
        for stop in pair.stops:
            hits, contact = self.at(stop)
            if hits.rate is None or contact is None or contact.peak_force is None:
                return None
            found.append((hits.rate, contact.peak_force, contact.probability))
        rate = sum(each for each, _, _ in found)
        if not rate:
            return None
        peak = sum(each * force for each, force, _ in found) / rate
        duration = sum(share for _, _, share in found) / rate
        damped, moved = damping_rate * duration, others(duration)
        if max(damped, moved) > MOST_ENERGY_CHANGE:
            return None
        change = damped + moved
        left = None if bias is None else pair.mass * peak * change
        return Estimate(value=pair.mass * peak, bias=left, how=f"{how}, brief contacts")

    def _speed_mean(self) -> float | None:
        rate, first, second = self._impacts
        if not rate or first is None or second is None or more_than_counted(rate, first, second):
            return None
        return first / rate

    @property
    def _impacts(self) -> tuple[float | None, float | None, float | None]:
        """Rate of the counted impacts on both stops, F1 and F2."""
        rate, first, second = (
            _total(lower, upper) for lower, upper in zip(self.lower, self.upper, strict=True)
        )
        return rate, first, second

    def _biases(self, mass: float) -> dict[str, float]:
        """Bounds on the errors of the quantities of a response, from `errors`."""
        errors = self.errors
        if errors is None:
            return {}
        found = {
            "displacement_mean": errors.mean,
            "displacement_std": errors.variance / (2.0 * math.sqrt(self.variance)),
            "displacement_mean_square": 2.0 * abs(self.mean) * errors.mean + errors.variance,
            "velocity_std": errors.velocity_mean_square
            / (2.0 * math.sqrt(self.velocity_mean_square)),
            "velocity_mean_square": errors.velocity_mean_square,
            "upcrossing_rate": errors.upcrossing_rate,
            **errors._of_pair(mass),
        }
        speed, hits = self._speed_mean(), self._impacts[0]
        rate, speed_rate = found["collision_rate"], found["impact_speed_rate"]
        if speed is not None and hits and rate is not None and speed_rate is not None:
            found["impact_speed_mean"] = (speed_rate + speed * rate) / hits
        return {name: error for name, error in found.items() if error is not None}

    def _identities(self, model: Model, how: str) -> dict[str, Estimate]:
        moments = self._moments(model)
        if moments is None or functions(model):
            return {}
        found = residuals(model, moments, (self.mean,))
        bounds = dict.fromkeys(found, 0.0)
        errors = self.errors._moments(model) if self.errors is not None else None
        for name, error in (errors or {}).items():
            moved = residuals(model, {**moments, name: moments[name] + error}, (self.mean,))
            for balance, value in moved.items():
                bounds[balance] += abs(value - found[balance])
        return {
            name: Estimate(value=value, bias=bounds[name], how=how) for name, value in found.items()
        }

    def _moments(self, model: Model) -> dict[tuple[str, str], float] | None:
        """Moments from which the balances are calculated; None if a rate is missing."""
        (name,) = model.coordinates
        moments: dict[tuple[str, str], float] = {
            (name, "x"): self.mean,
            (name, "variance"): self.variance,
            (name, "vv"): self.velocity_mean_square,
        }
        for pair in model.pairs:
            moments |= self.of_stops(pair)
        # the book's form "force" has no F1
        return None if None in moments.values() else moments

    def of_stops(self, pair: Pair) -> dict[tuple[str, str], float]:
        """The moments of a pair of which `residuals` makes the balances."""
        found = {}
        for stop in pair.stops:
            hits, contact = self.at(stop)
            found[pair.name, f"f1_{stop.name}"] = hits.speed_rate
            found[pair.name, f"f2_{stop.name}"] = hits.speed_square_rate
            if contact is not None:
                found[pair.name, f"force_{stop.name}"] = contact.force
                found[pair.name, f"loss_{stop.name}"] = contact.power
        return found


def _total(lower: float | None, upper: float | None) -> float | None:
    return None if lower is None or upper is None else lower + upper


BETWEEN_IMPACTS = (
    "acceleration_std is that of the motion between impacts; at an impact on a rigid stop the "
    "acceleration is infinite"
)
"""Assumption that is stated with an absolute acceleration in a scene with rigid stops."""


def accelerates_between_impacts(model: Model) -> bool:
    """Whether springs and dampers alone give the absolute acceleration of one oscillator between
    impacts on rigid stops: if only the base is shaken, and no spring or damper is a function."""
    smooth = model.restoring is None and model.drag is None and not model.functions
    shaken = model.moving_base and not model.noise_on_mass
    return bool(model.stops) and all(stop.rigid for stop in model.stops) and smooth and shaken


def linear_acceleration(model: Model) -> float | None:
    """Mean square absolute acceleration of the mass without stops, m^2/s^4."""
    if model.stops or not model.moving_base or model.noise_on_mass or model.functions:
        return None
    omega, b = model.omega, model.damping_rate
    theta = model.intensity / (2.0 * b)
    white = theta * (b**2 + omega**2)
    for filtered in model.filters:
        moments = filtered.response_moments(omega, b)
        white += omega**4 * moments[0] + b**2 * moments[1]
    tables = response_moments(model.acceleration_tables, omega, b)
    return white + tables.absolute_acceleration
