"""Error of an approximation, read from an atlas of its errors over all oscillators with stops.

Up to units, one oscillator in white noise has these numbers: zeta, the R of its stops, and their
places about the rest position, in standard deviations without stops. The atlas
(`data/linearisation_atlas`) holds ln(answer / truth) of every form on a grid of gap, R and zeta,
for symmetric stops and for a single one. The span of the corners of a scene's cell, times a safety,
bounds its error. Two unlike stops have no grid: they are given the largest error of their relatives
in it, times a larger safety.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION
from stochvi.model.coverage import speed_restitutions
from stochvi.model.model import Model
from stochvi.results.estimates import Estimate
from stochvi.results.response import Response
from stochvi.scenes.datasets import data_folder

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
