"""The clearance that the same target needs at the ends of tolerances, and at the worst within."""

from __future__ import annotations

import math
from dataclasses import replace
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Unpack

from stochvi.isolators.sizing.changes import (
    WORST,
    Change,
    Tolerances,
    all_applied,
    ends_of,
    ends_of_stops,
    worded,
)
from stochvi.isolators.sizing.sensitivity import Resizing, row_of
from stochvi.isolators.sizing.tolerance_region import Region, SameRisk
from stochvi.results.errors import Interrupted, NotConverged
from stochvi.sampling.options import WorkOptions
from stochvi.sampling.run import Run, sampled

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.results.deadline import Deadline

REL_ERROR = 0.2
"""Relative error of the risk of a changed scene: that of its clearance c is 0.2 sigma^2 / c^2, some
1 %, because the risk falls nearly as exp(-c^2 / (2 sigma^2))."""

FIRST_SHARE = 0.3
"""Share of the time for the worst place; the single changes share the rest evenly."""


@sampled
def worst_case(
    sizing: Sizing, tolerances: Tolerances | None = None,
    **options: Unpack[WorkOptions],
) -> pd.DataFrame:  # fmt: skip
    """Clearances for the target of a sizing with mount, level and stops within their tolerances.

    Every row is a scene of its own that is sized for the target, with the seed of the sizing. The
    last row is the largest requirement of the whole region, of several pairs for each by itself.
    The places where linear theory asks for most (`Region.worst`) are sized like the others, with
    the stiffness of the stops at both ends. No row is larger.

    Parameters
    ----------
    tolerances
        By default those of the sizing.
    **options
        `WorkOptions`: `budget` is that of all rows together.

    Returns
    -------
    pandas.DataFrame
        The columns of `sensitivity`, clearances from the mean position of the sizing. The first row
        is the sizing itself, the last one, where there are tolerances, the worst.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Isolator
    >>> from stochvi.scenes.scene import Scene
    >>> scene = Scene(
    ...     structure=Isolator(frequency_hz=10.0, zeta=0.05),
    ...     excitations=[WhiteNoise(density=0.01, unit="g2/Hz")],
    ... )
    >>> from stochvi.isolators import size
    >>> table = worst_case(size(scene, probability=0.01, rel_error=0.2), Tolerances(level_db=3.0))
    >>> table["change"].iloc[-1]
    'worst within all tolerances: level +3 dB'
    """
    import pandas as pd

    scene = sizing.scene
    run = replace(Run.of(options), seed=sizing.seed, rel_error=REL_ERROR)
    again = Resizing(sizing=sizing, run=run)
    tolerances = tolerances or sizing.allowed
    by_hits = sizing.target.name != "probability"
    stops = ends_of_stops(scene, tolerances.felt(scene, by_hits=by_hits))
    nominal = {name: each.value for name, each in sizing.named.items()}
    chance = math.nan if sizing.any_hit is None else sizing.any_hit
    rows = [row_of("as stated", sizing, nominal, chance, sigma=sizing.sigma)]
    ends = ends_of(tolerances)
    if not ends and not stops:
        return pd.DataFrame(rows)

    run.tell(0.0, "the worst place within the tolerances")
    try:
        linear = _linear_worst(sizing, tolerances, run.deadline)
    except (NotConverged, Interrupted) as reason:
        worst = [row_of(WORST, sizing, {}, math.nan, note=str(reason))]
    else:
        places = [(*each, end) for each in linear for end in stops] or linear
        first = run.deadline.share(FIRST_SHARE / len(places))
        worst = [
            again.row(worded(place), all_applied(place, scene), run.part(0.0, 0.0, deadline=first))
            for place in places
        ]
    rows += again.rows([(change.words, change.applied(scene)) for change in (*ends, *stops)])
    return pd.DataFrame([*rows, _largest(worst, rows[1:], [*nominal])])


def _largest(
    worst: list[dict[str, Any]], rows: list[dict[str, Any]], names: list[str]
) -> dict[str, Any]:
    """The largest clearance of each name in some rows; a worst place that was not sized leaves it
    unknown."""
    unknown = [row for row in worst if any(math.isnan(row[name]) for name in names)]
    known = [row for row in (*worst, *rows) if not any(math.isnan(row[name]) for name in names)]
    of = {name: unknown[0] if unknown else max(known, key=itemgetter(name)) for name in names}
    places: dict[str, list[str]] = {}
    for name, row in of.items():
        places.setdefault(row["change"], []).append(name)
    words = "; ".join(
        place if len(places) == 1 else f"{place} ({', '.join(at)})" for place, at in places.items()
    )
    return {
        **max(of.values(), key=itemgetter("clearance_change")),
        **{name: row[name] for name, row in of.items()},
        "change": WORST if words == WORST else f"{WORST}: {words}",
        "probability": max(row["probability"] for row in of.values()),
        "note": "; ".join(filter(None, dict.fromkeys(row["note"] for row in of.values()))),
    }


def _linear_worst(
    sizing: Sizing, tolerances: Tolerances, deadline: Deadline
) -> list[tuple[Change, ...]]:
    """Where in the region linear theory asks for the largest clearance of each sized pair."""
    region, harm = Region(sizing.scene, tolerances), 1.0
    if sizing.target.exceedance is not None:
        harm = min(sizing.target.exceedance / (sizing.any_hit or 1.0), 1.0)
    names = sizing.pairs["pair"].tolist()
    common = [names.index(name) for name in sizing.common]
    same = SameRisk(nominal=region.nominal, stops=sizing.stops, harm=harm, common=common)
    found = region.worst(same, deadline)
    return list(dict.fromkeys(found[k][1] for k in sizing.sized_pairs))
