"""`size`: the clearance that an isolator needs, with a stated risk and within its tolerances."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Unpack

from stochvi.isolators.sizing.answer import Sizing, Target
from stochvi.isolators.sizing.changes import Tolerances
from stochvi.isolators.sizing.job import ACCEPTED, SEARCH
from stochvi.isolators.sizing.missions import size_mission
from stochvi.isolators.sizing.missions_answer import MissionSizing
from stochvi.isolators.sizing.nominal import has_one_gap, nominal_sizing
from stochvi.isolators.sizing.question import Question
from stochvi.isolators.sizing.sensitivity import LEAST_SECONDS
from stochvi.isolators.sizing.targets import target_of
from stochvi.isolators.sizing.worst_case import worst_case
from stochvi.model.calculations import calculation
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable
from stochvi.sampling.options import AccuracyOptions
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.between_units import varied
from stochvi.scenes.phases import Phase
from stochvi.scenes.scene import Scene
from stochvi.statistics.free_windows import has_fast_peaks

if TYPE_CHECKING:
    from stochvi.isolators.production_risk.spreads import Spread

HOUR = 3600.0
"""The mission where none is given, s."""

MISSION = "mission"
"""Name of the only phase of a mission whose noise is not Gaussian, or beside shocks."""


@calculation
@sampled(rel_error=0.05)
def size(
    scene: Scene,
    *,
    probability: float | None = None,
    rate: float | None = None,
    impact_speed: float | None = None,
    peak_acceleration: float | None = None,
    exceedance: float = ACCEPTED,
    at: str | None = None,
    pair: str | None = None,
    common: Sequence[str] = (),
    tolerances: Tolerances | None = None,
    spreads: Mapping[str, Spread] | None = None,
    mission: float | None = None,
    **options: Unpack[AccuracyOptions],
) -> Sizing | MissionSizing:
    """The clearance per side that an isolator, or each of several pairs, needs for one target.

    Parameters
    ----------
    scene
        One oscillator under stationary Gaussian noise, or a linear structure with any number of
        pairs. For a probability the noise on one oscillator may vary in level, and noise may have
        fast peaks. Shocks of a shape may come at random times beside noise. The laws of the stops
        are kept, their places are not: they go to equal distances from the static equilibrium,
        where the mass hangs.
    probability
        Probability of any impact in the mission. Needs no stops.
    rate
        Impacts per second on both stops.
    impact_speed, peak_acceleration
        The largest of all impacts of the mission (m/s; m/s^2, of the mass, absolute), which is to
        be exceeded with the probability `exceedance` alone. An acceleration needs stops with a
        stiffness.
    exceedance
        Accepted probability that the hardest impact of a mission exceeds the limit.
    at
        The coordinate, or the named point, whose acceleration is limited; by default every
        coordinate that is a length.
    pair
        The one of several pairs whose clearance is searched for; the stops of the others stay where
        they are. By default all pairs share the risk equally: each alone would be hit with the same
        probability.
    common
        Names of pairs that are made with one clearance in common, which is found for all of them.
    tolerances
        Tolerances within all of which the clearance to make keeps the target; by default those
        that the scene states (`Tolerances.of`), which may be none.
    spreads
        Distributions of tolerances between the units of a production, as `production` takes them:
        the clearance to make then keeps the probability for the mean over the units. By default
        what the scene states (`stochvi.BetweenUnits`).
    mission
        Seconds of exposure, from a stationary start, by default an hour; left out where the scene
        has phases, which are sized for a probability.
    **options
        `AccuracyOptions`: `rel_error` is that of the risk (probability, rate) at the clearance, by
        default 0.05. Where the `budget` ends first, the interval of a probability or of a rate is
        wider, and a warning says so.

    Returns
    -------
    Sizing | MissionSizing
        The clearance, its interval and its evidence; with several pairs, for each of them; with
        phases, for all of them together.

    Raises
    ------
    NotApplicable
        If the scene is not covered, or no clearance keeps the target.
    NotConverged
        If the rate of exceedances of a speed or an acceleration does not reach `rel_error` in the
        budget, or if impact clusters do not end. After Ctrl-C it is `Interrupted`. `partial` holds
        the `Sizing` with the clearance reached by then.

    See Also
    --------
    stochvi.screen : The linear answer.
    stochvi.reliability : The probability that a mission goes wrong.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Isolator
    >>> scene = Scene(
    ...     structure=Isolator(frequency_hz=10.0, zeta=0.05),
    ...     excitations=[WhiteNoise(density=0.01, unit="g2/Hz")],
    ... )
    >>> sizing = size(scene, probability=0.01)
    >>> round(sizing.clearance.value / sizing.sigma, 1)
    5.6
    """
    target = target_of(probability, rate, impact_speed, peak_acceleration, exceedance)
    run = Run.of(options)
    if not scene.phases and is_not_gaussian(scene):
        whole = Phase(name=MISSION, duration=HOUR if mission is None else mission)
        scene, mission = scene.replace(phases=[whole]), None
    if scene.phases:
        return _of_phases(
            scene, target, mission, run, at=at, pair=pair, tolerances=tolerances,
            spreads=spreads or None, common=common,
        )  # fmt: skip
    if spreads is None and any(varied(scene)):
        from stochvi.isolators.production_risk.spreads import spreads_of

        spreads = spreads_of(scene)
    mission = HOUR if mission is None else mission
    if not 0.0 < mission < math.inf:
        raise ValueError(f"mission must be a positive number of seconds, got {mission}")
    model = model_of(scene)
    _check_names(scene, "pair", [pair] if pair is not None else [])
    _check_names(scene, "common", common)
    if common and pair is not None:
        raise ValueError(f"common must be left out where one pair is sized, got pair = {pair!r}")
    if spreads:
        shape = Question(target=target, mission=mission, pair=pair, common=common, run=run)
        return _of_production(scene, shape, spreads, tolerances)
    allowed = tolerances or Tolerances.of(scene)
    by_hits = target.name != "probability"
    worst = has_one_gap(model) and allowed.felt(scene, by_hits=by_hits) != Tolerances()
    nominal = run
    if worst:
        share = 1.0 - SEARCH.share_of_tolerances
        nominal = run.part(0.0, share, deadline=run.deadline.share(share))
    asked = Question(
        target=target, mission=mission, run=nominal, at=at, pair=pair, common=common,
        tolerances=allowed,
    )  # fmt: skip
    found = nominal_sizing(scene, asked)
    return _within_tolerances(found, run) if worst else found


def is_not_gaussian(scene: Scene) -> bool:
    """Whether a scene without phases is sized as a mission of one phase: its noise varies in level
    or has fast peaks, or shocks come beside it."""
    level, shocks = scene.random_level, scene.has_shocks
    return level is not None or shocks or has_fast_peaks(model_of(scene))


def _check_names(scene: Scene, name: str, given: Sequence[str]) -> None:
    """Raise `ValueError` where an argument names what is no impact pair of a scene."""
    names = [each.name for each in scene.expanded.impact_pairs]
    if not {*given} <= {*names}:
        known = ", ".join(names) or "none"
        raise ValueError(f"{name} must name impact pairs ({known}), got {', '.join(given)}")


def _of_production(
    scene: Scene, asked: Question, spreads: Mapping[str, Spread], tolerances: Tolerances | None
) -> Sizing:
    """A sizing of the scene as stated, with the clearance that its production needs."""
    from stochvi.isolators.production_risk.method import SHARE_OF_NOMINAL, about
    from stochvi.isolators.production_risk.spreads import bands_beside, check_spreads
    from stochvi.isolators.production_risk.start import Start

    check_spreads(scene, spreads)
    run, name = asked.run, asked.target.name
    if name != "probability":
        raise NotApplicable(
            "size",
            [f"the target must be a probability of any impact where tolerances have a "
             f"distribution, got {name}; give them as limits, as frequency=5%, or leave out what "
             "differs between units in the scene"],
        )  # fmt: skip
    share = SHARE_OF_NOMINAL
    first = run.part(0.0, share, deadline=run.deadline.share(share))
    found = nominal_sizing(scene, replace(asked, run=first, tolerances=Tolerances()))
    allowed = tolerances or bands_beside(scene, spreads)
    production = about(Start.of_sizing(found), spreads, allowed, run.part(share, 1.0))
    return replace(
        found,
        production=production,
        fell_short=(*found.fell_short, *production.warnings),
        warnings=(*found.warnings, *production.warnings),
        cost=replace(found.cost, wall_time=run.cost().wall_time),
    )


def _of_phases(
    scene: Scene, target: Target, mission: float | None, run: Run, common: Sequence[str],
    **others: object,
) -> MissionSizing:  # fmt: skip
    """The sizing of a scene with phases; refuses arguments that are not for phases."""
    for name, value in {"mission": mission, **others}.items():
        if value is not None:
            raise ValueError(
                f"{name} must be left out where the scene has phases, shocks or noise of varying "
                f"level, got {value}"
            )
    _check_names(scene, "common", common)
    try:
        found = size_mission(scene, target, run, common)
    except NotApplicable as reason:
        # the user called `size`, whatever function it came from
        raise NotApplicable("size", reason.conditions) from reason
    if found.warnings:
        raise run.deadline.fell_short(found.warnings[0], "raise budget or rel_error", found)
    return found


def _within_tolerances(found: Sizing, run: Run) -> Sizing:
    """A sizing with the worst case within its tolerances."""
    late = run.part(
        1.0 - SEARCH.share_of_tolerances, deadline=run.deadline.in_no_less_than(LEAST_SECONDS)
    )
    table = worst_case(found, found.allowed, **late.work())
    worst = table.iloc[-1]
    short = []
    if worst["note"]:
        lack = "was not found" if math.isnan(worst["clearance"]) else "is rough"
        short = [f"the largest clearance within the tolerances {lack}: {worst['note']}"]
    return replace(
        found,
        worst_case=table,
        fell_short=(*found.fell_short, *short),
        warnings=(*found.warnings, *short),
        cost=replace(found.cost, wall_time=run.cost().wall_time),
    )
