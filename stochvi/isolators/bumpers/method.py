"""What impacts do to a mass over the clearance and the stiffness of its stops.

At each clearance, impacts on the stops of all stiffnesses follow from the same motions
(`trials.py`). Mount, base and stops move the mass in a contact, and the largest acceleration, force
and deflection are those of that motion.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Unpack

import numpy as np

from stochvi.engine.sub_steps import CONTACT_ANGLE
from stochvi.isolators.bumpers.answer import BumperMap
from stochvi.isolators.bumpers.trials import (
    ClearanceTrials,
    Curve,
    TrialPart,
    Trials,
    trials_of,
)
from stochvi.isolators.contact import hardest_contact
from stochvi.isolators.moved_stops import at_clearances
from stochvi.isolators.sizing.answer import Target
from stochvi.isolators.sizing.changes import changed_stops
from stochvi.isolators.sizing.job import ACCEPTED
from stochvi.isolators.sizing.targets import check_laws
from stochvi.mathematics.arguments import shown
from stochvi.mathematics.arrays import Vector
from stochvi.model.calculations import calculation
from stochvi.model.coverage import beyond_one_oscillator
from stochvi.model.free_motion import free_motion
from stochvi.model.model import Model, model_of
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import provenance
from stochvi.results.sizes import check_size
from stochvi.sampling.options import AccuracyOptions
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.scenes.impact_laws.viscoelastic import LinearLaw
from stochvi.scenes.scene import Scene
from stochvi.statistics.bursts import UNFINISHED
from stochvi.statistics.cluster_paths import ClusterPaths
from stochvi.statistics.damage import SpectrumValues
from stochvi.statistics.damage.clusters import PAST_LARGEST

POINTS, MOST_POINTS = 20, 100
"""Number of clearances, and of stiffnesses, by default; and the largest number."""

NEAREST_SIGMA, SPREAD = 1.5, 10.0
"""By default the smallest clearance, in rms displacements, and the factor of the stiffness either
way."""

SPEEDS = np.concatenate([[1e-6], np.linspace(0.0, 2.0 * PAST_LARGEST, 65)[1:]])
"""Speeds at which the contacts of a law are known, over the fastest impact that was seen."""

HOUR = 3600.0

BETWEEN_SUB_STEPS = CONTACT_ANGLE**2 / 24.0
"""Mean share of a peak acceleration that is lost between two sub-steps of a contact. A cosine that
is read every a rad lies by a^2 / 24 of its amplitude below its peak on average."""

FIRST_PATHS, MOST_UNSEEN = 64, 1024
"""Number of paths of the first look; and that after which a clearance is given up at which hardly
an impact was seen."""


@calculation
@sampled(rel_error=0.1)
def bumper_map(
    scene: Scene,
    *,
    mission: float = 3600.0,
    exceedance: float = ACCEPTED,
    clearances: Sequence[float] | None = None,
    stiffness_factors: Sequence[float] | None = None,
    limits: Mapping[str, float] | None = None,
    **options: Unpack[AccuracyOptions],
) -> BumperMap:
    """What impacts do to a mass over the clearance and the stiffness of its stops.

    Parameters
    ----------
    scene
        One oscillator under stationary Gaussian noise with compliant stops, whose laws are kept;
        their places are not.
    mission
        Duration, s.
    exceedance
        Probability with which peak acceleration, force, rattle space and speed are exceeded in the
        mission.
    clearances
        Metres per side from the static equilibrium; by default 20, from 1.5 rms displacements to
        where stops are touched no more.
    stiffness_factors
        Stiffness of the stops over that of the scene; by default 20, from 0.1 to 10.
    limits
        Largest accepted values by quantity: "peak_acceleration" (m/s^2), "pad_force" (N),
        "rattle_space" (m), "energy_per_hit" (J), "impacts_per_hour".
    **options
        `AccuracyOptions`: `rel_error` is the median relative standard error of the impact speed at
        each clearance, by default 0.1.

    Returns
    -------
    BumperMap
        The quantities at all points, and which of them keep the limits.

    Raises
    ------
    NotApplicable
        If the scene is not covered, or a stop has no stiffness.
    NotConverged
        If time ends first; it carries the map so far.

    See Also
    --------
    stochvi.size : The clearance for one limit.
    stochvi.damage : What equipment on the mass goes through.

    Examples
    --------
    >>> from stochvi import Elastic, ImpactPair, Isolator, TabulatedNoise
    >>> stops = ImpactPair(lower=-4e-3, upper=4e-3, law=Elastic(stiffness=2e5))
    >>> truck = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    >>> mount = Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    >>> scene = Scene(structure=mount, impact_pairs=[stops], excitations=[truck])
    >>> found = bumper_map(scene, clearances=[7e-3], stiffness_factors=[0.1, 1.0], rel_error=0.2)
    >>> soft, hard = found.peak_acceleration.value[0] / 9.81
    >>> bool(2.0 < hard / soft < 4.0)
    True
    """
    _check(scene, mission, exceedance)
    limits = _limits(limits or {})
    usual = np.geomspace(1.0 / SPREAD, SPREAD, POINTS)
    factors = _rising("stiffness_factors", stiffness_factors, usual)
    motion = free_motion(model_of(scene))
    (sigma,), (speed,) = motion.deviations(np.eye(1))
    calm = _calm(float(sigma), float(speed), mission, exceedance, len(model_of(scene).stops))
    nearest = min(NEAREST_SIGMA * sigma, 0.5 * calm)
    places = _rising("clearances", clearances, np.linspace(nearest, 1.02 * calm, POINTS))
    run = Run.of(options)
    scenes = [changed_stops(scene, stiffness=float(factor)) for factor in factors]
    wanted = -math.log1p(-exceedance) / mission
    rows: list[list[Trials]] = []
    short: list[str] = []
    paths = 0
    for number, place in enumerate(places):
        models = tuple(model_of(at_clearances(each, float(place))) for each in scenes)
        sampler = ClearanceTrials(ClusterPaths(models[0], run.seed), models)
        part = run.part(
            number / len(places), (number + 1) / len(places), f"{1e3 * place:.3g} mm",
            run.deadline.share(1.0 / (len(places) - number)),
        )  # fmt: skip

        def error_of(parts: list[TrialPart], sampler: ClearanceTrials = sampler) -> float:
            return _median_error(trials_of(sampler, parts), wanted)

        taken = part.to_accuracy(
            sampler, FIRST_PATHS, error_of, run.accuracy, MOST_UNSEEN, needed=sampler.block
        )
        paths += taken.paths
        rows.append(trials_of(sampler, taken.sample))
        if not taken.enough:
            short.append(f"{1e3 * place:.3g} mm")
    peak, force, rattle, fastest, energy, hourly = _map(
        model_of(scene), places, rows, wanted, calm, float(speed / sigma)
    )
    own = stiffness_of(scene)
    answer = BumperMap(
        clearance=places, stiffness_factor=factors,
        stiffness=None if own is None else own * factors, mission=mission, exceedance=exceedance,
        sigma=float(sigma), limits=limits,
        peak_acceleration=peak, pad_force=force, rattle_space=rattle, impact_speed=fastest,
        energy_per_hit=energy, impacts_per_hour=hourly,
        ways=["clusters" if row[0].sampler.apart else "records" for row in rows],
        scene_without_mass=not scene.expanded.structure.knows_mass,
        assumptions=scene.assumptions(),
        warnings=_warnings(rows, short), cost=run.cost(paths=paths),
        provenance=provenance(scene.document(), run.seed),
    )  # fmt: skip
    if short:
        raise run.deadline.fell_short(
            f"at a relative error of {run.accuracy:g} of the impact speed at all clearances",
            "raise budget or rel_error", answer,
        )  # fmt: skip
    return answer


def _map(
    model: Model, places: Vector, rows: Sequence[Sequence[Trials]], wanted: float, calm: float,
    speed_ratio: float,
) -> list[SpectrumValues]:  # fmt: skip
    """The quantities of a map, in the order of its fields.

    Where no stop is reached, the largest displacement is `calm`, or the clearance where that is
    less. The mount then gives omega^2 x + b v, where v has `speed_ratio` times the rms of x.
    """
    mass = float(model.mass[0, 0])
    levels = np.array([_levels(places, column, wanted) for column in zip(*rows, strict=True)])
    speed, peak, force, depth = levels.transpose(2, 3, 1, 0)
    reached = (speed[0] > 0.0) | np.isnan(speed[0])
    calm_places = np.minimum(calm, places)[:, None]
    pull = math.hypot(model.omega**2, model.damping_rate * speed_ratio)
    peak = np.where(reached, peak, [pull * calm_places, 0.0 * calm_places, 0.0 * calm_places])
    peak[2] += np.where(reached, BETWEEN_SUB_STEPS * peak[0], 0.0)
    rattle = depth + np.array([1.0, 0.0, 0.0])[:, None, None] * np.where(
        reached, places[:, None], calm_places
    )
    energy = 0.5 * mass * np.array([[each.mean_square_speed() for each in row] for row in rows])
    hourly = HOUR * np.array([[each.per_second() for each in row] for row in rows])
    overlap = np.array([[each.overlap for each in row] for row in rows])
    meeting = np.stack([energy[..., 0] * overlap, hourly[..., 0] * overlap])
    return [
        _values(*each)
        for each in (
            peak, force, rattle, speed, [energy[..., 0], energy[..., 1], meeting[0]],
            [hourly[..., 0], hourly[..., 1], meeting[1]],
        )
    ]  # fmt: skip


def _levels(
    places: Vector, column: Sequence[Trials], wanted: float
) -> list[list[tuple[float, float, float]]]:
    """Speed, acceleration, force and deflection that are exceeded `wanted` times a second, at all
    clearances (clearances, quantities) with stops of one stiffness.

    The square of a speed is exponential beyond what was seen. For the others the law of the stop
    says what that means: they are taken as speeds of contacts on a base at rest.
    """
    model = column[0].sampler.models[column[0].row]
    fastest = np.array([each.part.fastest[each.row].max() for each in column])
    speed = SPEEDS[:, None] * np.where(fastest > 0.0, fastest, 1.0)
    laws = [stop.law for stop in model.stops_per_unit_mass if isinstance(stop.law, CompliantLaw)]
    contact = hardest_contact(model, [(law, places) for law in laws], speed)
    values = (
        contact.peak_acceleration,
        float(model.mass[0, 0]) * contact.peak_force,
        contact.deflection,
    )
    found = []
    for k, trials in enumerate(column):
        part = trials.part
        largest = (part.sharpest, part.hardest, part.deepest)
        curves = [Curve(speed[:, k], np.maximum.accumulate(each[:, k])) for each in values]
        found.append(
            [trials.level(part.fastest, wanted)]
            + [trials.level(*each) for each in zip(largest, 3 * [wanted], curves, strict=True)]
        )
    return found


def _values(value: Vector, error: Vector, bias: Vector) -> SpectrumValues:
    return SpectrumValues(value=value, standard_error=error, bias=np.abs(bias))


def _median_error(trials: Sequence[Trials], wanted: float) -> float:
    """Median relative standard error of the impact speed; 0 where impacts are rarer than wanted."""
    found = [each.level(each.part.fastest, wanted) for each in trials]
    errors = [
        math.inf if math.isnan(value) else error / value
        for value, error, _ in found
        if value > 0.0 or math.isnan(value)
    ]
    return float(np.median(errors)) if errors else 0.0


def _calm(sigma: float, speed: float, mission: float, exceedance: float, sides: int) -> float:
    """Displacement that is exceeded in the mission with a probability, by Rice's crossings of one
    side or both, m."""
    crossings = sides * speed / sigma / (2.0 * math.pi) * mission / -math.log1p(-exceedance)
    return sigma * math.sqrt(2.0 * math.log(max(crossings, math.e)))


def stiffness_of(scene: Scene) -> float | None:
    """The stiffness of the stops, N/m, where they are linear springs that are alike."""
    laws = [law for pair in scene.impact_pairs for _, law in pair.stops()]
    known = {law.stiffness if isinstance(law, LinearLaw) else None for law in laws}
    return known.pop() if len(known) == 1 else None


def _warnings(rows: Sequence[Sequence[Trials]], short: Sequence[str]) -> list[str]:
    found = []
    if short:
        found.append(f"not as accurate as asked for at clearances of {', '.join(short)}")
    if any(each.unfinished > UNFINISHED for row in rows for each in row):
        found.append(
            "clusters of impacts do not end at some points: stops pump the mount, and harder "
            "impacts than these may follow; ask simulate or reliability there"
        )
    return found


LIMITED = ("peak_acceleration", "pad_force", "rattle_space", "energy_per_hit", "impacts_per_hour")


def _limits(limits: Mapping[str, float]) -> dict[str, float]:
    for name, most in limits.items():
        if name not in LIMITED:
            raise ValueError(f"limits must be of {', '.join(LIMITED)}, got {name!r}")
        if not 0.0 < most < math.inf:
            raise ValueError(f"the limit of {name} must be positive, got {most}")
    return dict(limits)


def _rising(name: str, given: Sequence[float] | None, usual: Vector) -> Vector:
    """Values of an axis."""
    found = usual if given is None else np.asarray(given, dtype=float).ravel()
    if not len(found) or not found[0] > 0.0 or not np.all(np.diff(found) > 0.0):
        raise ValueError(f"{name} must be positive rising numbers, got {shown(given)}")
    check_size(f"the number of {name}", len(found), MOST_POINTS, "ask for fewer")
    return found


def _check(scene: Scene, mission: float, exceedance: float) -> None:
    if not 0.0 < mission < math.inf:
        raise ValueError(f"mission must be a positive number of seconds, got {mission}")
    if not 0.0 < exceedance < 1.0:
        raise ValueError(f"exceedance must be in (0, 1), got {exceedance:g}")
    if conditions := beyond_one_oscillator(model_of(scene)):
        why = (
            "a map is of one linear mass; sweep by size or reliability over "
            "impact_pair.0.law.stiffness instead"
        )
        raise NotApplicable("bumper map", [*conditions[:-1], f"{conditions[-1]}; {why}"])
    hardest = Target(name="peak_acceleration", value=1.0, unit="m/s^2", exceedance=exceedance)
    check_laws(scene, hardest)
