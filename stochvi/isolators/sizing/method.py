"""`size`: the clearance that an isolator needs, with a stated risk and within its tolerances."""

from __future__ import annotations

import math
from dataclasses import replace

from stochvi.isolators.sizing.answer import Sizing
from stochvi.isolators.sizing.changes import Tolerances
from stochvi.isolators.sizing.nominal import ACCEPTED, SEARCH, nominal_sizing
from stochvi.isolators.sizing.pairs_answer import PairsSizing
from stochvi.isolators.sizing.question import Question, silent
from stochvi.isolators.sizing.targets import target_of
from stochvi.isolators.sizing.worst_case import worst_case
from stochvi.model.calculations import calculation
from stochvi.model.model import model_of
from stochvi.results.deadline import graceful_interrupt
from stochvi.results.progress import Progress
from stochvi.scenes.scene import Scene


@calculation
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
    tolerances: Tolerances | None = None,
    mission: float = 3600.0,
    rel_error: float = 0.05,
    seed: int = 0,
    threads: int | None = None,
    budget: float = 60.0,
    progress: Progress | None = None,
) -> Sizing | PairsSizing:
    """The clearance per side that an isolator, or each of several pairs, needs for one target.

    Parameters
    ----------
    scene
        One oscillator under stationary Gaussian noise, or a linear structure with any number of
        pairs. The laws of the stops are kept, their places are not: they go to equal distances from
        the static equilibrium, where the mass hangs.
    probability
        Chance of any hit in the mission. Needs no stops.
    rate
        Hits per second on both stops.
    impact_speed, peak_acceleration
        The largest of all hits of the mission (m/s; m/s^2, of the mass, absolute), which is to be
        exceeded with the chance `exceedance` alone. An acceleration needs stops with a stiffness.
    exceedance
        Accepted chance that the hardest hit of a mission exceeds the limit.
    at
        Of several coordinates, the one, or the named point, whose acceleration is limited; by
        default any of them that is a length.
    pair
        Of several pairs, the one whose clearance is searched for while the stops of the others stay
        where they are; by default all pairs share the risk equally: each alone would be hit with
        the same chance.
    tolerances
        Tolerances within all of which the clearance to make keeps the target; by default those
        that the scene states (`Tolerances.of`), which may be none.
    mission
        Seconds of exposure, from a stationary start.
    rel_error
        Relative standard error of the risk (chance, rate) at the clearance.
    seed
        Seed of the random numbers: the same seed gives the same digits.
    threads
        Number of threads; by default all cores.
    budget
        Seconds of wall time; where it ends first, the interval of a probability or of a rate is
        wider, and a warning says so.
    progress
        Called now and then with what is done and what was reached.

    Returns
    -------
    Sizing | PairsSizing
        The clearance, its interval and its evidence; of several pairs that of each.

    Raises
    ------
    NotApplicable
        If the scene is not covered, or no clearance keeps the target.
    NotConverged
        If the rate at which a speed or an acceleration is exceeded was not known to `rel_error` in
        the budget, or bursts of hits do not end, or `Interrupted` after Ctrl-C; `partial` holds
        the `Sizing` with the clearance that it got to.

    See Also
    --------
    stochvi.screen : The linear answer.
    stochvi.reliability : The chance that a mission goes wrong.

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
    for name, seconds in (("mission", mission), ("budget", budget)):
        if not 0.0 < seconds < math.inf:
            raise ValueError(f"{name} must be a positive number of seconds, got {seconds}")
    if not 1e-4 <= rel_error < 1.0:
        raise ValueError(f"rel_error must be in [1e-4, 1), got {rel_error}")
    model = model_of(scene)
    if pair is not None and (model.single or pair not in [each.name for each in model.pairs]):
        names = ", ".join(each.name for each in model.pairs) or "none"
        raise ValueError(f"pair must be the name of one of several pairs ({names}), got {pair!r}")
    allowed = tolerances or Tolerances.of(scene)
    by_hits = target.name != "probability"
    worst = model.single and allowed.felt(scene, by_hits=by_hits) != Tolerances()
    asked = Question(
        target=target, mission=mission, at=at, pair=pair, tolerances=allowed, rel_error=rel_error,
        seed=seed, threads=threads, report=progress or silent,
        budget=(1.0 - SEARCH.share_of_tolerances if worst else 1.0) * budget,
    )  # fmt: skip
    with graceful_interrupt():
        found = nominal_sizing(scene, asked)
        if not worst or isinstance(found, PairsSizing):
            return found
        return _within_tolerances(found, threads, budget)


def _within_tolerances(found: Sizing, threads: int | None, budget: float) -> Sizing:
    """A sizing with the worst case within its tolerances."""
    rest = max(budget - found.cost.wall_time, SEARCH.share_of_tolerances * budget)
    table = worst_case(found, found.allowed, threads=threads, budget=rest)
    worst = table.iloc[-1]
    short = []
    if worst["note"]:
        lack = "was not found" if math.isnan(worst["clearance"]) else "is rough"
        short = [f"the largest clearance within the tolerances {lack}: {worst['note']}"]
    return replace(
        found, worst_case=table, fell_short=(*found.fell_short, *short),
        warnings=(*found.warnings, *short),
    )  # fmt: skip
