"""The clearance that the same target needs at the ends of tolerances, and in their worst
combination."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

from stochvi.isolators.screening import Screening, screen_isolator
from stochvi.isolators.sizing.chance_at_stops import probability_at
from stochvi.isolators.sizing.changes import COMBINED, Change, Tolerances, ends_of, ends_of_stops
from stochvi.isolators.sizing.sensitivity import Resizing, row_of
from stochvi.results.deadline import Deadline, heeding_ctrl_c
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.isolators.sizing.answer import Sizing

REL_ERROR = 0.2
"""Relative error of the risk of a changed scene: that of its clearance c is 0.2 sigma^2 / c^2, some
1 %, because the risk falls nearly as exp(-c^2 / (2 sigma^2))."""

FIRST_SHARE = 0.3
"""Share of the time for the worst combination; the single changes share the rest evenly."""


def worst_case(
    sizing: Sizing,
    tolerances: Tolerances | None = None,
    *,
    threads: int | None = None,
    budget: float | None = None,
) -> pd.DataFrame:
    """Clearances for the target of a sizing with mount, level and stops at the ends of their
    tolerances.

    Every row is a scene of its own that is sized for the target. The worst combination is that of
    the ends of natural frequency, damping and level that needs the largest clearance of an equal
    rate of crossings (Rice), with the stiffness of the stops that asks for more clearance.

    Parameters
    ----------
    tolerances
        By default `Tolerances.of` the scene.
    budget
        Seconds for all rows together; None for no limit.

    Returns
    -------
    pandas.DataFrame
        The columns of `sensitivity`. The first row is the sizing itself, the last one the worst
        combination.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Isolator
    >>> scene = Scene(
    ...     structure=Isolator(frequency_hz=10.0, zeta=0.05),
    ...     excitations=[WhiteNoise(density=0.01, unit="g2/Hz")],
    ... )
    >>> from stochvi.isolators import size
    >>> table = worst_case(size(scene, probability=0.01, rel_error=0.2))
    >>> table["change"].iloc[-1]
    'worst combination: natural frequency -10 %, damping ratio -30 %, level +3 dB'
    """
    import pandas as pd

    scene = sizing.scene
    again = Resizing(
        sizing=sizing, seed=sizing.seed, threads=threads, deadline=Deadline.after(budget),
        rel_error=REL_ERROR,
    )  # fmt: skip
    tolerances = tolerances or Tolerances.of(scene)
    changes = list(ends_of(tolerances))
    if sizing.target.name != "probability":
        changes += ends_of_stops(scene, tolerances)
    combination = _combination(sizing, changes)
    nominal = sizing.clearance.value
    chance = probability_at(sizing, nominal)
    rows = [
        row_of("as stated", sizing, sizing.sigma, nominal, math.nan if chance is None else chance)
    ]
    if not combination:
        return pd.DataFrame(rows)

    with heeding_ctrl_c():
        words = f"{COMBINED}: {', '.join(change.words for change in combination)}"
        worst = again.row(words, _all(combination, scene), FIRST_SHARE)  # the others share the rest
        for number, change in enumerate(changes):
            share = 1.0 / (len(changes) - number)
            rows.append(again.row(change.words, change.applied(scene), share))
    return pd.DataFrame([*rows, worst])


def _all(changes: list[Change], scene: Scene) -> Scene:
    for change in changes:
        scene = change.applied(scene)
    return scene


def _combination(sizing: Sizing, changes: list[Change]) -> list[Change]:
    """The ends of the tolerances that together ask for the largest clearance."""
    linear = [change for change in changes if change.quantity != "stiffness"]
    stiff = [change for change in changes if change.quantity == "stiffness" and change.sign > 0.0]
    if sizing.screening is None:
        soft = {"frequency": -1.0, "damping": -1.0, "level": 1.0}
        return [change for change in linear if change.sign == soft[change.quantity]] + stiff
    nominal, clearance = sizing.screening, sizing.clearance.value
    groups = [list(group) for _, group in itertools.groupby(linear, lambda each: each.quantity)]
    free = sizing.scene.model_copy(update={"impact_pairs": ()})
    worst = max(
        (list(corner) for corner in itertools.product(*groups)),
        key=lambda corner: equal_clearance(screen_isolator(_all(corner, free)), nominal, clearance),
    )
    return worst + stiff


def equal_clearance(linear: Screening, nominal: Screening, clearance: float) -> float:
    """Clearance (m) at which stops are hit as often by Rice as those of `nominal` at `clearance`;
    0 where even stops at the mean are hit less often.

    Rice's rate is s_v / s_x exp(-c^2 / (2 s_x^2)) / pi. The logarithms of the two rates are
    compared, because the rates themselves vanish in floating point from some 38 s_x on.

    >>> nominal = Screening(
    ...     displacement_std=2.0, velocity_std=3.0, acceleration_std=1.0, zero_crossing_rate=1.0,
    ...     miles=None, input_acceleration_std=None,
    ... )
    >>> equal_clearance(nominal, nominal, 200.0)
    200.0
    """
    faster = linear.velocity_std / linear.displacement_std
    faster *= nominal.displacement_std / nominal.velocity_std
    square = (clearance / nominal.displacement_std) ** 2 + 2.0 * math.log(faster)
    return linear.displacement_std * math.sqrt(max(square, 0.0))
