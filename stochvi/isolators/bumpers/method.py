"""What impacts do to a mass over the clearance and the stiffness of its stops.

At each clearance, impacts on the stops of all stiffnesses follow from the same motions
(`trials.py`). The hardest contact of the mission is that of its fastest impact. During a contact
the base is taken to be at rest, so that a contact is a function of its speed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Unpack

import numpy as np

from stochvi.isolators.bumpers.answer import BumperMap
from stochvi.isolators.bumpers.trials import ClearanceTrials, TrialPart, Trials, trials_of
from stochvi.isolators.contact import Contact, hardest_contact
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

POINTS, MOST_POINTS = 20, 100
"""Number of clearances, and of stiffnesses, by default; and the largest number."""

NEAREST_SIGMA, SPREAD = 1.5, 10.0
"""By default the smallest clearance, in rms displacements, and the factor of the stiffness either
way."""

HOUR = 3600.0

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
        scene, scenes, places, factors, rows, wanted, calm
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
        assumptions=[
            *scene.assumptions(),
            "the base is at rest during a contact, so that a contact follows from its speed",
        ],
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
    scene: Scene, scenes: Sequence[Scene], places: Vector, factors: Vector,
    rows: Sequence[Sequence[Trials]], wanted: float, calm: float,
) -> list[SpectrumValues]:  # fmt: skip
    """The quantities of a map, in the order of its fields."""
    mass = float(model_of(scene).mass[0, 0])
    # (value, error, bias), each (clearances, stiffnesses)
    speed = np.array([[each.level(wanted) for each in row] for row in rows]).transpose(2, 0, 1)
    peak, force, rattle = np.zeros((3, 3, len(places), len(factors)))
    for column, each in enumerate(scenes):
        model = model_of(at_clearances(each, float(places[0])))
        value, error, bias = (part[:, column] for part in speed)
        met = np.array([value, value + error, value + bias])
        hit = _contacts(model, places, met)
        alone = np.tile(np.minimum(calm, places), (3, 1))
        for into, found, otherwise in (
            (peak, hit.peak_acceleration, model.omega**2 * alone),
            (force, mass * hit.peak_force, 0.0 * alone),
            (rattle, places + hit.deflection, alone),
        ):
            found = np.where((met > 0.0) | np.isnan(met), found, otherwise)
            into[:, :, column] = found[0], found[1] - found[0], found[2] - found[0]
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


def _values(value: Vector, error: Vector, bias: Vector) -> SpectrumValues:
    return SpectrumValues(value=value, standard_error=error, bias=np.abs(bias))


def _contacts(model: Model, places: Vector, speeds: Vector) -> Contact:
    """The hardest contacts at clearances (clearances,), of speeds (..., clearances); NaN for speeds
    that are not known."""
    laws = [stop.law for stop in model.stops_per_unit_mass if isinstance(stop.law, CompliantLaw)]
    slowest = 1e-6 * float(np.nanmax(speeds, initial=1.0))
    met = np.where(speeds > slowest, speeds, slowest)
    found = hardest_contact(model, [(law, places) for law in laws], met)
    return Contact(*(np.where(np.isnan(speeds), np.nan, each) for each in found))


def _median_error(trials: Sequence[Trials], wanted: float) -> float:
    """Median relative standard error of the impact speed; 0 where impacts are rarer than wanted."""
    found = [each.level(wanted) for each in trials]
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
            "a map takes every contact from its impact speed alone, as on one linear mass; sweep "
            "by size or reliability over impact_pair.0.law.stiffness instead"
        )
        raise NotApplicable("bumper map", [*conditions[:-1], f"{conditions[-1]}; {why}"])
    check_laws(scene, Target(name="peak_acceleration", value=1.0, unit="m/s^2"))
