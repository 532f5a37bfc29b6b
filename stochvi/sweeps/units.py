"""The mean of any method's answer over the units of a production, by Gauss quadrature.

Each node is a unit with a scene of its own, for which the method answers as in a sweep. So whatever
a method covers, it covers for units that differ.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.isolators.production_risk.spreads import Spread, check_spreads, spreads_of
from stochvi.isolators.production_risk.units import Units
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.model.calculations import calculation
from stochvi.model.model import model_of
from stochvi.results.estimates import BIAS, ERROR, LIMIT
from stochvi.results.progress import Progress
from stochvi.scenes.keys import Change
from stochvi.scenes.scene import Scene
from stochvi.statistics.pair_crossings import own_distances
from stochvi.sweeps.ranges import MOST_ROWS, check_method, rows_of

if TYPE_CHECKING:
    import pandas as pd


@calculation
def mean_over_units(
    scene: Scene,
    spreads: Mapping[str, Spread] | None = None,
    *,
    method: str = "simulate",
    nodes: int = 5,
    out: str | Path | None = None,
    progress: Progress | None = None,
    **arguments: Any,
) -> pd.DataFrame:
    """Mean over units, and spread between them, of every quantity of a method's answer.

        E q = sum_i w_i q(unit_i)

    The nodes are those of Gauss and Hermite for a normal distribution, and of Gauss and Legendre
    for a uniform one, in all combinations. A mean is exact for answers that are polynomials of a
    degree below 2 `nodes` in each amount. What higher degrees add is estimated from how fast the
    coefficients fall with the degree, and is a part of the bias: of rare events it may be all.

    Parameters
    ----------
    scene
        The scene about which the units vary.
    spreads
        Distribution of each quantity, as for `stochvi.isolators.production`. The clearance of each
        stop varies for itself. By default what the scene states (`stochvi.BetweenUnits`).
    method, out, progress
        As for `sweep`.
    nodes
        Number of nodes of each amount.
    **arguments
        Those of the method, as for `sweep`. Each unit has random numbers of its own.

    Returns
    -------
    DataFrame
        A row per quantity: `quantity`, its `mean` over the units with its statistical
        `standard_error` and its `bias`, and `std_between_units`, from which the statistical error
        of the units is taken off. `attrs["units"]` is the table of the units, a row each, with
        their `weight`.

    Raises
    ------
    ValueError
        If the spreads have more combinations than a sweep may have rows.

    See Also
    --------
    stochvi.sweep : The answers over ranges of keys.
    stochvi.isolators.production : The probability of any impact of a production.

    Examples
    --------
    >>> import stochvi
    >>> from stochvi.isolators import Spread
    >>> scene = stochvi.load_scene(stochvi.scenes.shipped_scene("oscillator-elastic"))
    >>> table = stochvi.mean_over_units(scene, {"clearance": Spread(std=0.05)}, method="exact")
    >>> rate = table.set_index("quantity").loc["stops.collision_rate"]
    >>> round(float(rate["mean"]), 4), round(float(rate["std_between_units"]), 4)
    (0.2835, 0.0172)
    """
    import pandas as pd

    check_method(method, arguments)
    spreads = spreads_of(scene) if spreads is None else spreads
    check_spreads(scene, spreads)
    if nodes < 1:
        raise ValueError(f"nodes must be at least 1, got {nodes}")
    stops = np.array(own_distances(model_of(scene)))
    units = Units(scene=scene, spreads=spreads, mean=model_of(scene).mean_gaps, stops=stops)
    columns = units.columns
    if nodes ** len(columns) > MOST_ROWS:
        raise ValueError(
            f"spreads must have at most {MOST_ROWS} combinations of nodes, got {nodes} of each of "
            f"{len(columns)} amounts; give fewer spreads or nodes"
        )
    rules = [spreads[tolerance].nodes(tolerance, nodes) for tolerance, _ in columns]
    names = [name for _, name in columns]
    grid: list[Change] = [
        tuple(zip(names, place, strict=True))
        for place in itertools.product(*[rule[0].tolist() for rule in rules])
    ]
    weights = [math.prod(each) for each in itertools.product(*[rule[1] for rule in rules])]

    def made(change: Change) -> Scene:
        return units.built(np.array([amount for _, amount in change]))

    rows = rows_of(
        scene, grid, made, method=method, common=False, arguments=arguments, out=out,
        progress=progress,
    )  # fmt: skip
    rows.insert(0, "weight", weights)
    known = [str(name) for name in rows]
    quantities = [each.removesuffix(f".{ERROR}") for each in known if each.endswith(f".{ERROR}")]
    bases = [spreads[tolerance].polynomials(nodes) for tolerance, _ in columns]
    found = pd.DataFrame([_mean(rows, quantity, bases) for quantity in quantities])
    found.attrs["units"] = rows
    return found


def _left_out(value: Vector, weight: Vector, bases: Sequence[Matrix]) -> float:
    """Estimate of what the degrees beyond those of the quadrature add to a mean.

    A coefficient of the degree k is taken to be c_0 rho^k, rho as the largest of the last two.
    """
    if not bases or len(bases[0]) == 1 or not np.isfinite(value).all():
        return 0.0
    nodes, found = len(bases[0]), 0.0
    parts = np.reshape(weight * value, (nodes,) * len(bases))
    mean = abs(float(parts.sum()))
    for axis, basis in enumerate(bases):
        others = tuple(k for k in range(len(bases)) if k != axis)
        terms = np.abs(basis @ parts.sum(axis=others))
        degrees = range(max(1, nodes - 2), nodes)
        ratio = max((terms[k] / mean) ** (1.0 / k) for k in degrees) if mean else 0.0
        found += mean * min(ratio, 1.0) ** (2 * nodes)
    return found


def _mean(rows: pd.DataFrame, quantity: str, bases: Sequence[Matrix]) -> dict[str, Any]:
    """The row of a quantity; NaN where the answer of any unit lacks it."""
    weight, value, error = (
        rows[name].to_numpy(dtype=float) for name in ("weight", quantity, f"{quantity}.{ERROR}")
    )
    bias = rows[f"{quantity}.{BIAS}"].to_numpy(dtype=float)
    if f"{quantity}.{LIMIT}" in rows:  # what was not seen in a unit may be as large as its limit
        bias = bias + rows[f"{quantity}.{LIMIT}"].fillna(0.0).to_numpy(dtype=float)
    mean = float(weight @ value)
    between = float(weight @ (value - mean) ** 2 - weight @ error**2)
    return {
        "quantity": quantity,
        "mean": mean,
        "standard_error": math.sqrt(float(weight**2 @ error**2)),
        "bias": float(weight @ np.abs(bias)) + _left_out(value, weight, bases),
        "std_between_units": math.sqrt(max(between, 0.0)) if between == between else math.nan,
    }
