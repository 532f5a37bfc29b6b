"""Periodic regimes of a scene under its sines: over frequency, or over any key of the scene."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.methods.periodic.answer import (
    Branch,
    HarmonicResponse,
    Jump,
    RandomStarts,
    SimulatedSweep,
    SpecialPoint,
)
from stochvi.methods.periodic.branches import DEFAULT_IMPACTS, Finder, Scattered
from stochvi.methods.periodic.continuation import NODE, POINT
from stochvi.methods.periodic.even import MOST_STEPS
from stochvi.methods.periodic.family import Family, unmet
from stochvi.methods.periodic.function_branches import finder_of
from stochvi.methods.periodic.jumps import Step, Sweep
from stochvi.methods.periodic.kernels import solver
from stochvi.methods.periodic.linearised import FORMS, linearised, not_covered
from stochvi.methods.periodic.tracks import Track
from stochvi.model.calculations import calculation
from stochvi.model.model import Model, model_of
from stochvi.results.deadline import Deadline, graceful_interrupt
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Cost, provenance
from stochvi.scenes.excitations import Sine
from stochvi.scenes.keys import changed_scene
from stochvi.scenes.scene import Scene

FREQUENCY = "frequency_hz"
"""Name of the varied number where it is the frequency of the sine itself."""

MARGIN = 1e-3
"""Share of its value by which a single value is widened to a range."""

WIDEST = 1e5
"""Largest ratio of the frequencies of one range: up to it, the series of the numbers of a scene
give the lowest ones to 1e-8."""

MOST_VALUES = 100_000
"""Largest number of values of the varied number."""


@calculation
def harmonic_response(
    scene: Scene,
    frequency_hz: ArrayLike | None = None,
    *,
    form: str = "exact",
    vary: Mapping[str, Sequence[float]] | None = None,
    coordinate: str | None = None,
    most_impacts: int = DEFAULT_IMPACTS,
    sweep: str | None = None,
    budget: float | None = None,
) -> HarmonicResponse:
    """The periodic regimes of a structure with stops under a sine or a sum of sines.

    Between impacts the motion is linear and exact. Newton's iteration finds regimes with a given
    order of impacts in a number of periods from the phases of the impacts. Branches are followed by
    length of arc, through folds. The multipliers are those of the map over a period, in which an
    impact turns a perturbation by its saltation matrix.

    In contact with a compliant stop the motion is linear, too, or linear piece by piece; Hertz's
    law is integrated to rounding. Regimes are then states at the phase 0 that the flow takes back
    to themselves. Flights from several states and from random ones look for them, slow sweeps up
    and down, and Newton's iteration. All search over the range of the values; the values say only
    where branches are drawn. Chatter that ends at rest on a rigid stop is followed by flights.
    Where springs or dampers are functions, all motion is integrated by extrapolation of order 8,
    which ends at each kink; friction holds a mass at rest, and hysteresis keeps its memory.

    Percussion machines, free bodies under a feed, are among the structures: their impact speed (B
    4.20), the range of their regimes (B 4.21) and of both branches (B 4.12, 4.28).

    Parameters
    ----------
    scene
        A structure under constant loads and sines whose frequencies are multiples of one; its
        springs and dampers may be functions of the motion.
        Its stops may have any law whose numbers are given, and any gap or preload. Noise is left
        out, with a warning.
    frequency_hz
        Frequencies of the lowest common multiple of the sines, at which regimes are wanted; by
        default that of the scene.
    form
        "exact"; or harmonic linearisation of one oscillator by "motion" or by "force" (B 9.13),
        beside the exact motion without impacts and with its error against the exact regimes.
    vary
        Instead: one key of the scene with its values.
    coordinate
        The coordinate or point whose displacement and acceleration are given. By default that is
        the first point of a structure that is made of modes, else the first coordinate.
    most_impacts
        Largest number of impacts per period of the regimes that Newton's iteration looks for;
        regimes of more impacts are found only where simulations settle to them, and a warning says
        so where there are more stops than that.
    sweep
        "up", "down" or "both": simulate such a slow sweep as well, 300 periods at each value.
    budget
        Seconds of wall time, without the minute or so in which kernels are compiled, once on each
        machine.

    Returns
    -------
    HarmonicResponse
        Every regime that was found, its stability, and what was simulated.

    Raises
    ------
    NotApplicable
        If the scene is not of that kind.
    NotConverged
        If the budget ends first; the error holds the branches so far.

    See Also
    --------
    stochvi.simulate : The motion under noise, with or without a sine.

    Examples
    --------
    An isolator that may clatter between its stops where its motion without impacts fits:

    >>> from stochvi import ImpactPair, Oscillator, Restitution, Sine
    >>> mount = Scene(
    ...     structure=Oscillator(mass=1.0, damping=12.5, stiffness=62.8**2),
    ...     impact_pairs=[
    ...         ImpactPair(lower=-4e-4, upper=4e-4, law=Restitution(coefficient=0.5))
    ...     ],
    ...     excitations=[Sine(amplitude=1e-4 * 628.0**2, frequency_hz=628.0 / 6.283185307179586)],
    ... )
    >>> found = harmonic_response(mount).at(628.0 / 6.283185307179586)
    >>> found[found["periods"] == 1][["impact_speed_max", "stable"]].round(4).values.tolist()
    [[0.2246, True], [0.0, True], [0.1771, False]]
    """
    began = time.perf_counter()
    if form not in FORMS:
        raise ValueError(f"form must be one of {', '.join(FORMS)}, got {form!r}")
    if sweep not in SWEEPS:
        raise ValueError(f"sweep must be 'up', 'down' or 'both', got {sweep!r}")
    if most_impacts < 1:
        raise ValueError(f"most_impacts must be at least 1, got {most_impacts}")
    deadline = Deadline.after(budget)
    key, values, scene_at = varied(scene, frequency_hz, vary)
    model = model_of(scene_at(float(values[0])))
    if (
        conditions := unmet(model, compliant=True, with_functions=True)
        if form == "exact"
        else not_covered(model)
    ):
        raise NotApplicable("sine" if form == "exact" else f"sine:{form}", conditions)
    low, high = float(values[0]), float(values[-1])
    if key == FREQUENCY and high > WIDEST * low:
        raise ValueError(
            f"frequency_hz must span at most a factor of {WIDEST:g}, got {low:g} to {high:g} Hz; "
            "ask for narrower ranges one by one"
        )
    if low == high:
        wide = MARGIN * (abs(low) or 1.0)
        low, high = low - wide, high + wide
    shown = (each for each in scene.expanded.structure.shown if each in model.outputs)
    coordinate = coordinate or next(shown, model.outputs[0])
    family = Family.of(
        lambda value: model_of(scene_at(value)), low, high, coordinate, with_functions=True
    )
    finder = finder_of(family, family.sigma(values), most_impacts, deadline)
    if slow := too_slow(finder):
        raise NotApplicable("sine", [slow])
    jumps, starts = list[Jump](), None
    with graceful_interrupt():
        finder.find()
        sweeps = [Sweep(finder, upwards=upwards) for upwards in (True, False) if len(values) > 1]
        for each in sweeps:
            jumps += [_jump(finder, each.upwards, step) for step in each.steps()]
        if form == "exact":
            starts = _starts(
                finder, finder.scattered(), [s for each in sweeps for s in each.elsewhere]
            )
        simulated = tuple(_simulated(finder, values, upwards) for upwards in SWEEPS[sweep])
    tracks = [*finder.tracks, *finder.rests.tracks]
    branches = tuple(_branch(finder, values, track) for track in tracks)
    error = None
    if form != "exact":
        found = linearised(lambda value: model_of(scene_at(value)), values, form)
        error = _error(found, branches)
        branches = (*(each for each in branches if not each.stops), *found)
    how, few = finder.looked_for
    answer = HarmonicResponse(
        key=key,
        coordinate=coordinate,
        branches=branches,
        special_points=_special_points(branches) if form == "exact" else (),
        jumps=tuple(jumps),
        starts=starts,
        simulated=simulated,
        model_error=error,
        assumptions=(*scene.assumptions(), how if form == "exact" else HARMONIC),
        warnings=(
            *noise_left_out(model),
            *([few] if few and form == "exact" else []),
            *([starts.warning] if starts and starts.warning else []),
        ),
        cost=Cost(wall_time=time.perf_counter() - began),
        provenance=provenance(scene.document()),
    )
    if deadline.passed():
        raise deadline.fell_short("before all regimes were looked for", "ask for fewer", answer)
    return answer


HARMONIC = (
    "the motion is taken for a mean and one harmonic, and impacts for a spring and a damper; the "
    "speed of impacts is that of the harmonic, frequency times amplitude"
)
"""Assumption of harmonic linearisation."""

SWEEPS: dict[str | None, tuple[bool, ...]] = {
    None: (), "up": (True,), "down": (False,), "both": (True, False)
}  # fmt: skip
"""Whether each sweep by simulation goes upwards, by the value of `sweep`."""


def varied(
    scene: Scene, frequency_hz: ArrayLike | None, vary: Mapping[str, Sequence[float]] | None
) -> tuple[str, Vector, Callable[[float], Scene]]:
    """Name and rising values of the varied number, and a function that gives the scene at a
    value."""
    if vary is not None:
        if frequency_hz is not None or len(vary) != 1:
            raise ValueError(
                "vary must be one key of the scene with its values, without frequency_hz, got "
                f"{', '.join(vary) or 'none'}"
            )
        ((key, given),) = vary.items()
        document = scene.document(as_written=True)
        return key, _checked(key, given), lambda value: changed_scene(document, ((key, value),))
    sines = [each.frequency_hz for each in scene.excitations if isinstance(each, Sine)]
    if not sines:
        raise NotApplicable("sine", unmet(model_of(scene), compliant=True, with_functions=True))
    lowest = min(sines)
    values = _checked(FREQUENCY, [lowest] if frequency_hz is None else frequency_hz)
    if not values[0] > 0.0:
        raise ValueError(f"frequency_hz must be greater than 0, got {values[0]:g}")
    return FREQUENCY, values, lambda value: _at_frequency(scene, value / lowest)


def _checked(key: str, given: ArrayLike) -> Vector:
    values = np.unique(np.atleast_1d(np.asarray(given, dtype=float)))
    if not 0 < len(values) <= MOST_VALUES or not np.all(np.isfinite(values)):
        raise ValueError(
            f"{key} must have from 1 to {MOST_VALUES} finite values, got {len(values)}"
        )
    return values


def too_slow(finder: Finder) -> str:
    """Why periods of the force hold too many steps at an end of the range; empty if they do not."""
    for sigma in (0.0, 1.0):
        motion = finder.motion(sigma)
        steps = 2.0 * np.pi / motion.omega / solver.step_of(motion)
        if not 0.0 < steps <= MOST_STEPS:
            return (
                f"a period of the force must take at most {MOST_STEPS} steps, got {steps:.3g} at "
                f"{float(finder.family.frequency_hz(sigma)):.3g} Hz; ask for higher frequencies"
            )
    return ""


def _at_frequency(scene: Scene, factor: float) -> Scene:
    """The scene with the frequencies of its sines multiplied."""
    changed = tuple(
        each.model_copy(update={"frequency_hz": factor * each.frequency_hz})
        if isinstance(each, Sine)
        else each
        for each in scene.excitations
    )
    return scene.model_copy(update={"excitations": changed})


def _branch(finder: Finder, values: Vector, track: Track) -> Branch:
    # points between the values that were asked for show where there is no other
    named = np.array([name != NODE for name in track.names])
    shown = named if np.any(named & track.admissible) else np.ones(len(named), bool)
    track = track.part(shown)
    family, sigma, multiplier = finder.family, track.sigma, track.multiplier
    drawn = np.array([name == POINT for name in track.names])
    value = np.where(drawn, _asked(finder, values, sigma), family.value(sigma))
    frequency = family.frequency_hz(sigma)
    return Branch(
        form="exact",
        stops=tuple(family.stops[stop] for stop in track.stops),
        sticking=tuple(family.stops[stop] for stop in track.rests),
        periods=track.periods,
        value=value,
        frequency_hz=np.where(np.isclose(value, frequency, rtol=1e-9, atol=0.0), value, frequency),
        displacement_max=track.displacement * family.length,
        amplitude=family.length * finder.amplitude(track),
        acceleration_max=track.acceleration * family.length / family.time**2,
        phase=track.phases,
        **family.states(track.starts, sigma),
        impact_speed=track.speeds * family.speed,
        multiplier=multiplier,
        stable=multiplier < finder.stable,
        admissible=track.admissible,
        names=tuple(POINT if name == NODE else name for name in track.names),
    )


def _asked(finder: Finder, values: Vector, sigma: Vector) -> Vector:
    """The nearest values that were asked for, to the last digit."""
    return np.asarray(values[np.argmin(np.abs(finder.grid - sigma[:, None]), axis=1)])


def _starts(finder: Finder, scattered: Scattered, swept: Sequence[float]) -> RandomStarts:
    """Ends of random starts, and where they or slow sweeps ended on no branch."""
    places = np.concatenate([scattered.sigma[~scattered.listed], swept])
    values = finder.family.value(places)
    return RandomStarts(
        number=len(scattered.listed),
        listed=int(scattered.listed.sum()),
        elsewhere=(float(values.min()), float(values.max())) if len(values) else None,
    )


def _special_points(branches: Sequence[Branch]) -> tuple[SpecialPoint, ...]:
    found = [
        SpecialPoint(
            name=name,
            branch=number,
            value=float(branch.value[place]),
            frequency_hz=float(branch.frequency_hz[place]),
        )
        for number, branch in enumerate(branches)
        for place, name in enumerate(branch.names)
        if name and branch.admissible[place]
    ]
    return tuple(sorted(found, key=lambda point: (point.value, point.branch)))


def _jump(finder: Finder, upwards: bool, step: Step) -> Jump:
    family = finder.family
    before, after = step.displacements
    speeds = step.speeds
    return Jump(
        upwards=upwards,
        value=float(family.value(step.sigma)),
        frequency_hz=float(family.frequency_hz(step.sigma)),
        displacement_max=(before * family.length, after * family.length),
        impact_speed=(speeds[0] * family.speed, speeds[1] * family.speed),
    )


def _error(found: Sequence[Branch], exact: Sequence[Branch]) -> dict[str, float | None]:
    """Distance of stable harmonic regimes from the fastest exact stable ones at the same values."""
    differences, missing = list[float](), 0
    for branch in found:
        if not branch.stable.any():
            continue
        for value, speed in zip(branch.value, branch.impact_speed[:, 0], strict=True):
            known = [
                float(each.impact_speed[place].mean())
                for each in exact
                for place in each.at(float(value))
                if each.stable[place] and each.periods == 1 and each.impacts_per_period
                and len(each.stops) == len(branch.stops)
            ]  # fmt: skip
            missing += not known
            differences += [abs(float(speed) / max(known) - 1.0)] if known else []
    total = len(differences) + missing
    return {
        "median": float(np.median(differences)) if differences else None,
        "largest": max(differences, default=None),
        "without_exact": missing / total if total else None,
    }


def _simulated(finder: Finder, values: Vector, upwards: bool) -> SimulatedSweep:
    rows = np.array(list(Sweep(finder, upwards=upwards).simulated())).reshape(-1, 4)
    return SimulatedSweep(
        upwards=upwards,
        value=_asked(finder, values, rows[:, 0]),
        displacement_max=finder.family.length * rows[:, 1],
        impact_speed_max=finder.family.speed * rows[:, 2],
        periods=rows[:, 3].astype(np.int64),
    )


def noise_left_out(model: Model) -> tuple[str, ...]:
    if not model.noisy:
        return ()
    return ("the noise of the scene is left out: these are regimes of its sines alone",)
