"""The density of one scene on strips, refined until two successive answers agree."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Mapping
from typing import NamedTuple, TypeVar

import numpy as np

from stochvi.methods.fokker_planck.density import MARGINS, Averages, StripDensity
from stochvi.methods.fokker_planck.motion import Motion
from stochvi.methods.fokker_planck.scaled_motion import ScaledMotion, scaled_motion
from stochvi.methods.fokker_planck.strip_mesh import (
    UNSOLVED,
    Degrees,
    Patch,
    Strips,
    first_patches,
    graded,
    refined,
)
from stochvi.methods.fokker_planck.strip_solver import Strip, solve_strips
from stochvi.model.model import Stop
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotConverged

FIRST_DEGREES, LAST_DEGREES = Degrees(2, 4), Degrees(7, 9)
"""Degrees of the polynomials on the first mesh, and the highest degrees; both rise by one from mesh
to mesh."""

SLOWEST = (1e-2, 2e-3, 3e-4, 3e-5, 3e-6, 1e-6)
"""Speeds of the slowest impacts that the meshes resolve one after another, in units of the speed of
the weight."""

MOST_MESHES = 10
"""Largest number of successive meshes; `MOST_UNKNOWNS` usually ends the refinement before."""

MOST_UNKNOWNS = 800_000
"""Largest number of unknowns of a mesh: it takes some ten seconds and half a gigabyte."""

MIN_IMPACT_RATIO = 1e-12
"""Impacts on a stop per crossing of the mean from which on the stop counts as within reach:
less than the law exp(-energy / s^2) leaves there, which is right where the mass leans on no
stop."""

EDGE = 1e-8
"""Probability next to the ends of the box above which the box is made larger."""

STRETCH = 1.25
"""Factor on the largest velocity of a box that is too small."""

MOST_STRETCHES = 8
"""Largest number of times that the box is stretched."""

TIME_RATIO = 2.0
"""Ratio of the CPU time of a mesh to that of the one before (measured: 1.3 to 2)."""


T = TypeVar("T")


def accurate(
    found: T, reached: float, rtol: float, deadline: Deadline, started: float, method: str,
    remedy: str,
) -> T:  # fmt: skip
    """An answer; where its relative error is larger than `rtol`, `NotConverged` carries it."""
    if reached <= rtol:
        return found
    if deadline.left <= TIME_RATIO * (time.perf_counter() - started):
        raise deadline.fell_short(
            f"at a relative error of {reached:.2g} by {method}, asked for {rtol:g}",
            "raise budget or rtol",
            found,
        )
    raise NotConverged(
        f"{method} reached a relative error of {reached:.2g} on its finest mesh, not {rtol:g}; "
        f"{remedy}",
        found,
    )


class Refinement(NamedTuple):
    """The density and averages on the last mesh, bounds on their errors, and the density before."""

    field: StripDensity
    averages: Averages
    errors: Averages
    coarser: StripDensity


def refine(
    motion: Motion, rtol: float, threshold: float, rates: Collection[str] = ("lower", "upper"),
    deadline: Deadline = NEVER,
) -> Refinement:  # fmt: skip
    """Refine until the relative errors that `rtol` governs are small enough, or until no finer mesh
    improves the answer.

    `rates` are the sides whose rate of impacts faster than `threshold` is wanted, too. After the
    first two meshes, a further one is begun only if it can be expected to end before the deadline.
    """
    scaled, patches, field = _first(motion, threshold)
    makers = Strips()
    refinement: Refinement | None = None
    found = field.averages(threshold)
    took = 0.0
    for stage in range(1, MOST_MESHES):
        if refinement is not None and deadline.left <= TIME_RATIO * took:
            break
        began = time.perf_counter()
        before, coarser = found, field
        slowest = SLOWEST[min(stage, len(SLOWEST) - 1)]
        patches = graded(scaled, refined(scaled, coarser.solved, patches), slowest)
        strips = makers.make(patches, _degrees(stage))
        if stage > 1 and sum(strip.unknowns for strip in strips) > MOST_UNKNOWNS:
            break
        try:
            field = _field(scaled, strips, slowest)
        except np.linalg.LinAlgError:
            break
        found, took = field.averages(threshold), time.perf_counter() - began
        if min(found.variance, found.velocity_mean_square) <= 0.0:
            refinement = None  # this mesh is too coarse for a density; a finer one may give one
            continue
        errors = _errors(field, before, found)
        least = MIN_IMPACT_RATIO * found.upcrossing_rate
        if threshold > scaled.speed:
            # what rounding leaves of the digits of rare impacts
            names = [f"rate_{stop.name}" for stop in scaled.reached]
            rounded = {name: getattr(errors, name) + WORST_RATE * least for name in names}
            errors = errors._replace(**rounded)
        lost = _fast_impacts(field, coarser, found, threshold)
        refinement = _with_bounds(Refinement(field, found, errors, coarser), lost)
        if _cut(field)["variance"] > 2.0 * rtol * found.variance:
            break  # what lies beyond the ends of the box does not shrink with the mesh
        vague = rates_not_resolved(found, errors) | {s for s, most in lost.items() if most > least}
        if worst_relative_error(found, errors) <= rtol and vague.isdisjoint(rates):
            break
    if refinement is None:
        raise NotConverged(UNSOLVED)
    return refinement


def _field(scaled: ScaledMotion, strips: tuple[Strip, ...], slowest: float) -> StripDensity:
    """The density on some strips; LinAlgError if there is none of finite numbers, or if a strip is
    so narrow that rounding leaves it no length."""
    if not all(strip.length > 0.0 for strip in strips):
        raise np.linalg.LinAlgError(UNSOLVED)
    solved = solve_strips(scaled, strips)
    if not all(np.isfinite(q).all() for q in solved.q):
        raise np.linalg.LinAlgError(UNSOLVED)
    return StripDensity(scaled, solved, scaled.speed * slowest)


def _degrees(stage: int) -> Degrees:
    place, velocity = (
        min(first + stage, last) for first, last in zip(FIRST_DEGREES, LAST_DEGREES, strict=True)
    )
    return Degrees(place, velocity)


def _first(
    motion: Motion, threshold: float
) -> tuple[ScaledMotion, tuple[Patch, ...], StripDensity]:
    """The coarsest mesh, of a box beyond which there is hardly any probability.

    A mass that is pressed onto an inelastic stop reaches farther than exp(-energy / s^2) says. A
    fast flight lasts longer than a slow one, so it loses less energy per unit of time.
    """
    stretch, hit = 1.0, set[Stop]()
    for _ in range(MOST_STRETCHES + len(motion.stops)):
        scaled = scaled_motion(motion, stretch, hit, threshold)
        patches = graded(scaled, first_patches(scaled), SLOWEST[0])
        try:
            field = _field(scaled, Strips().make(patches, FIRST_DEGREES), SLOWEST[0])
        except np.linalg.LinAlgError:
            raise NotConverged(UNSOLVED) from None
        new = _hit(field)
        if not new and field.edge() <= EDGE * _rarity(scaled):
            break
        hit |= new
        stretch *= 1.0 if new else STRETCH
    return scaled, patches, field


def _hit(field: StripDensity) -> set[Stop]:
    """Stops that count as out of reach, but lie in the box and are hit."""
    crossings = field.averages(0.0).upcrossing_rate
    return {
        stop
        for stop in _beyond(field.scaled)
        if _nearest(field.scaled, stop) == stop.position
        and float(field.flux(stop.position, stop.side, 1)) > MIN_IMPACT_RATIO * crossings
    }


def _beyond(scaled: ScaledMotion) -> list[Stop]:
    return [stop for stop in scaled.motion.stops if stop not in scaled.reached]


def _nearest(scaled: ScaledMotion, stop: Stop) -> float:
    """The place in the box, and its mirror image if that was left out, next to a stop."""
    left = 2.0 * scaled.left - scaled.right if scaled.halved else scaled.left
    return min(max(stop.position, left), scaled.right)


def _rarity(scaled: ScaledMotion) -> float:
    """Probability of energies that must be resolved however rare they are, by the weight."""
    return math.exp(-scaled.rare_energy)


MOTION = ("mean", "variance", "velocity_mean_square")


def _errors(field: StripDensity, coarse: Averages, fine: Averages) -> Averages:
    """Bounds on the errors of `fine`, the averages of `field`."""
    sizes = fine._replace(mean=math.sqrt(fine.variance))
    change = Averages(*(abs(a - b) for a, b in zip(fine, coarse, strict=True)))
    shared = max(getattr(change, name) / getattr(sizes, name) for name in MOTION)
    bounds: dict[str, float] = {}
    for side in ("lower", "upper"):
        impacts = [f"{name}_{side}" for name in ("speed_rate", "speed_square_rate")]
        hits = max([shared, *(_ratio(change, sizes, name) for name in impacts)])
        for name in (name for name in Averages._fields if name.endswith(side)):
            bounds[name] = MARGINS.safety * max(
                getattr(change, name), MARGINS.shared * hits * getattr(sizes, name)
            )
        # the share of time in contact depends on slow contacts, as the rate of impacts does
        contact = f"contact_{side}"
        slow = max(hits, _ratio(change, sizes, f"rate_{side}"))
        bounds[contact] = max(
            bounds[contact], 2.0 * MARGINS.safety * slow * getattr(sizes, contact)
        )
    for name in (*MOTION, "upcrossing_rate"):
        bounds[name] = MARGINS.safety * max(
            getattr(change, name), MARGINS.shared * shared * getattr(sizes, name)
        )
    far = _unreached(field, fine.upcrossing_rate) | _rounding_between_wells(field.scaled)
    for name, cut in _cut(field).items():
        far[name] = far.get(name, 0.0) + cut
    return Averages(
        *(
            bounds[name] + MARGINS.floor * abs(getattr(sizes, name)) + far.get(name, 0.0)
            for name in Averages._fields
        )
    )


SPEEDS_TRIED = 32
"""Number of speeds up to the threshold at which the rate of faster impacts is compared between two
meshes."""

RARE = 1e-6
"""Impacts on a stop per crossing of the mean below which a rate that no mesh resolves is 0, with a
bound as its bias."""


def _fast_impacts(
    field: StripDensity, coarser: StripDensity, found: Averages, threshold: float
) -> dict[str, float]:
    """Bounds on the rates of impacts faster than a threshold, by side, where both meshes may have
    lost them: their difference then says nothing.

    The density falls at least as fast as it would with the damper alone. The rates of ever faster
    impacts are followed up to where both meshes no longer agree on them, or fall less than that.
    Where they agree nowhere, at most F2 / threshold^2 impacts are faster.
    """
    bounds = {}
    motion = field.scaled.motion
    hottest = motion.squares[1] if motion.model.drag is None else math.inf
    speeds = threshold * np.arange(1, SPEEDS_TRIED + 1) / SPEEDS_TRIED
    slower = (threshold**2 - speeds**2) / 2.0 / hottest
    for stop in field.scaled.reached if threshold > 0.0 else ():
        fine, coarse = (each.flux(stop.position, stop.side, 1, speeds) for each in (field, coarser))
        known = MARGINS.safety * np.abs(fine - coarse) <= WORST_RATE * fine
        known &= fine > MIN_IMPACT_RATIO * found.upcrossing_rate
        most = np.maximum(fine, 0.0) * np.exp(-slower)
        known[1:] &= ~known[:-1] | (most[1:] <= (1.0 + WORST_RATE) * most[:-1])
        ends = np.flatnonzero(known & ~np.append(known[1:], False))
        if len(ends) and ends[0] == SPEEDS_TRIED - 1:
            continue
        bound = getattr(found, f"speed_square_rate_{stop.name}") / threshold**2
        if len(ends):
            bound = min(bound, float(most[ends[0]]))
        bounds[stop.name] = MARGINS.safety * bound
    return bounds


def _with_bounds(refinement: Refinement, lost: Mapping[str, float]) -> Refinement:
    """A rate that the meshes have lost is 0 within its bound where that says that it is rare; else
    its error grows to the bound."""
    found, errors = refinement.averages, refinement.errors
    for side, bound in lost.items():
        name = f"rate_{side}"
        if bound <= RARE * found.upcrossing_rate:
            found, errors = found._replace(**{name: 0.0}), errors._replace(**{name: bound})
        else:
            errors = errors._replace(**{name: max(bound, getattr(errors, name))})
    return refinement._replace(averages=found, errors=errors)


def _ratio(change: Averages, sizes: Averages, name: str) -> float:
    size = getattr(sizes, name)
    return getattr(change, name) / size if size > 0.0 else 0.0


def _unreached(field: StripDensity, crossing_rate: float) -> dict[str, float]:
    """Bounds on the quantities of stops that count as out of reach.

    The bound is the larger of two. One is Rice's rate at the temperature of the distribution, with
    Rayleigh's speeds. The other is the flux of the solution at the place of the box next to the
    stop. Between that place and the stop the flux falls at least as fast as it would with the
    damper alone.
    """
    motion = field.scaled.motion
    square, hottest = motion.squares
    speed = math.sqrt(square)
    lowest = motion.lowest(square)
    rayleigh = (1.0, speed * math.sqrt(math.pi / 2.0), 2.0 * square)
    found = {}
    for stop in _beyond(field.scaled):
        nearest = _nearest(field.scaled, stop)
        height, seen = motion.energy(np.array([stop.position, nearest]))
        rice = crossing_rate * math.exp(-(height - lowest) / square)
        falls = math.exp(-max(height - seen, 0.0) / hottest)
        for power, (name, factor) in enumerate(zip(HITS, rayleigh, strict=True), start=1):
            flux = abs(float(field.flux(nearest, stop.side, power)))
            found[f"{name}_{stop.name}"] = MARGINS.safety * max(rice * factor, flux * falls)
        if not stop.rigid:
            # p s^2 / force beyond a place of the density p, and a force that turns the mass round
            pull = abs(float(motion.force(np.array(stop.position))))
            rate = found[f"rate_{stop.name}"]
            found[f"contact_{stop.name}"] = math.sqrt(2.0 * math.pi) * speed * rate / pull
            found[f"force_{stop.name}"] = 2.0 * found[f"speed_rate_{stop.name}"]
            found[f"power_{stop.name}"] = found[f"speed_square_rate_{stop.name}"] / 2.0
    return found


FALSE_CROSSING = 1e-15
"""Probability that rounding makes or takes each time that the mass would cross from well to well:
some five times the relative rounding error of a number."""


def _rounding_between_wells(scaled: ScaledMotion) -> dict[str, float]:
    """Errors of the averages that come from the probabilities of the wells.

    Where crossings of a high barrier are as rare as rounding errors are large, rounding moves
    probability from one well to another.
    """
    if scaled.barrier == 0.0:
        return {}
    share = min(FALSE_CROSSING * math.exp(scaled.barrier), 1.0)
    width = scaled.right - scaled.left
    return {"mean": share * width, "variance": share * width**2}


def _cut(field: StripDensity) -> dict[str, float]:
    """The parts of the first two moments beyond the ends of the box. They are x^2 p / (n - 2) and
    x^3 p / (n - 3), where the density p falls as x^-n."""
    scaled = field.scaled
    found = {"mean": 0.0, "variance": 0.0}
    if scaled.motion.model.restoring is None:
        return found
    for side, end, falls in scaled.motion.open_ends(scaled.left, scaled.right, scaled.speed**2):
        if scaled.halved and side < 0:
            continue
        x = abs(end - scaled.motion.start)
        density = MARGINS.safety * abs(float(field.displacement_density(end)))
        found["mean"] += 0.0 if scaled.halved else x**2 * density / (falls - 2.0)
        found["variance"] += (2.0 if scaled.halved else 1.0) * x**3 * density / (falls - 3.0)
    return found


HITS = ("rate", "speed_rate", "speed_square_rate")
"""Names of the averages over impacts of the powers 0, 1 and 2 of their speed, in this order."""


def worst_relative_error(found: Averages, bounds: Averages) -> float:
    """Largest relative error of what `rtol` governs: deviations, F1 and F2 of all stops.

    It is infinite where a mesh has found no density of finite and positive variances.
    """
    if not (found.variance > 0.0 and found.velocity_mean_square > 0.0):
        return math.inf
    ratios = [
        bounds.variance / found.variance / 2.0,
        bounds.velocity_mean_square / found.velocity_mean_square / 2.0,
    ]
    for name in ("speed_rate", "speed_square_rate"):
        total, bound = (
            getattr(group, f"{name}_lower") + getattr(group, f"{name}_upper")
            for group in (found, bounds)
        )
        if total > 0.0:
            ratios.append(bound / total)
    return max(ratios)


WORST_RATE = 0.1
"""Largest relative error of a rate that is given."""


def rates_not_resolved(found: Averages, bounds: Averages) -> set[str]:
    """Sides whose rate is not known well enough yet."""
    return {
        side
        for side in ("lower", "upper")
        if getattr(bounds, f"rate_{side}") > WORST_RATE * getattr(found, f"rate_{side}") > 0.0
    }
