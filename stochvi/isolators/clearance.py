"""Impact rates against clearance: by Rice, by the moment closure, and by Monte Carlo."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Unpack

import numpy as np
import pandas as pd
import scipy
from numpy.typing import ArrayLike

from stochvi.isolators.moved_stops import at_clearances
from stochvi.isolators.screening import Screening, screened
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.linearisation import linearise
from stochvi.methods.monte_carlo import simulate
from stochvi.model.calculations import calculation
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import Estimate
from stochvi.results.response import Response
from stochvi.sampling.options import AccuracyOptions
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene

SMOOTH_POINTS = 31
"""Number of clearances of a smooth curve of impact rates."""

CLOSURE_SHARE = 0.5
"""Largest share of the time of a clearance of a curve that the moment closure may take. With many
pairs it takes seconds, and the simulated rates matter more."""


def clearance_notes(linear: Screening, clearances: ArrayLike) -> tuple[str, ...]:
    """Warnings to a curve of impact rates: those of the screening, and one for each gap that a load
    moves by more than the smallest clearance.

    Parameters
    ----------
    linear
        The screening of the scene.
    clearances
        Metres per side from the static equilibrium, as in `clearance_curve`.
    """
    gaps = linear.impact_pairs
    nearest = _rows(linear, clearances).min(axis=0, initial=np.inf)
    several = len(linear.coordinates) > 1 or len(gaps) > 1
    sags = [
        f"the load moves {f'the gap of {name}' if several else 'the mass'} by "
        f"{1e3 * gap.mean:+.4g} mm, more than the clearance of {1e3 * place:.4g} mm: clearances "
        "count from the static equilibrium, and stops placed about the unloaded spring would hold "
        "the mass"
        for (name, gap), place in zip(gaps.items(), nearest, strict=True)
        if abs(gap.mean) > place
    ]
    return (*linear.notes, *sags)


def unseen_notes(curve: pd.DataFrame) -> tuple[str, ...]:
    """A sentence for each row of a `clearance_curve` whose impacts were too rare to be counted.

    Examples
    --------
    >>> import pandas as pd
    >>> row = {"clearance": 5e-3, "simulated": 0.0, "simulated_high": 0.0123}
    >>> unseen_notes(pd.DataFrame([row]))[0][:62]
    'at 5 mm hardly any impact was seen: the rate is at most 0.0123'
    """
    rare = curve[(curve["simulated"] == 0.0) & (curve["simulated_high"] > 0.0)]
    pairs = rare["pair"] if "pair" in rare else [""] * len(rare)
    return tuple(
        f"at {1e3 * clearance:.4g} mm hardly any impact{f' on {pair}' if pair else ''} was seen: "
        f"the rate is at most {most:.3g} per second; raise budget, or let reliability count what "
        "is rare"
        for pair, clearance, most in zip(
            pairs, rare["clearance"], rare["simulated_high"], strict=True
        )
    )


def _rows(linear: Screening, clearances: ArrayLike) -> Matrix:
    """Clearances as rows (places, pairs)."""
    places = np.asarray(clearances, dtype=float)
    places = places[:, None] if places.ndim == 1 else places
    return np.broadcast_to(places, (len(places), len(linear.impact_pairs)))


@calculation
@sampled(rel_error=0.02)
def clearance_curve(
    scene: Scene, clearances: Sequence[float] | Matrix, **options: Unpack[AccuracyOptions]
) -> pd.DataFrame:
    """Impact rate against clearance: by Rice, by the moment closure, and by Monte Carlo.

    Parameters
    ----------
    scene
        One mass or a structure, with impact pairs. The laws of the stops are kept, and all stops
        move together.
    clearances
        Metres per side from the static equilibrium. With several pairs one number is for all of
        them; a row (pairs,) gives one for each.
    **options
        `AccuracyOptions`: `rel_error` is that of the simulated rates, by default 0.02; the
        clearances share the `budget` evenly.

    Returns
    -------
    pandas.DataFrame
        One row per clearance, and per pair where there are several (m, and in sigma of the linear
        response): impacts per second on its stops by `rice`, `closure` and `simulated`, the last
        with its 95 % interval (`simulated_low`, `simulated_high`), and the mean impact speed. One
        mass also has the rms displacement, several pairs the name of the `pair`.

    Raises
    ------
    NotConverged
        If the budget, which is that of all clearances together, ends before each has reached
        `rel_error`, or `Interrupted` after Ctrl-C: it carries the rows with what they reached.

    See Also
    --------
    stochvi.size : The clearance for a target.
    stochvi.screen : The linear answer.

    Examples
    --------
    >>> import stochvi
    >>> scene = stochvi.load_scene(stochvi.scenes.shipped_scene("isolator-truck"))
    >>> table = clearance_curve(scene, [0.002, 0.003], rel_error=0.2)
    >>> table["clearance"].tolist()
    [0.002, 0.003]
    """
    if not scene.impact_pairs:
        raise NotApplicable("clearance_curve", ["the scene needs an impact_pair, for its law"])
    places = np.asarray(clearances, dtype=float)
    if not np.all((places > 0.0) & np.isfinite(places)):
        raise ValueError(f"clearances must be positive, got {places.tolist()} m")
    linear, run = screened(scene), Run.of(options)
    cases = [_case(scene, linear, place) for place in _rows(linear, places)]
    rows: list[dict[str, float | str]] = []
    short: list[str] = []
    for number, case in enumerate(cases):
        if number and run.deadline.passed():
            short.append(case.words)
            continue
        left = len(cases) - number
        closure = _closure_rates(case.scene, run.deadline, CLOSURE_SHARE / left)
        part = run.part(
            number / len(cases), (number + 1) / len(cases), case.words, run.deadline.share(1 / left)
        )
        try:
            simulated = simulate(case.scene, **part.options(rel_error=run.rel_error))
        except (NotConverged, Interrupted) as reason:
            simulated = reason.partial
            short.append(case.words)
        if simulated is not None:
            rows += case.rows(simulated, closure)
    curve = pd.DataFrame(rows)
    if short:
        raise run.deadline.fell_short(
            f"before the impacts at {', '.join(short)} were known to a relative error of "
            f"{run.rel_error:g}",
            "raise budget or rel_error",
            curve if rows else None,
        )
    return curve


class _Case(NamedTuple):
    """One clearance of a curve: how messages call it, its scene, and what makes its rows from a
    response and the rates of the closure."""

    words: str
    scene: Scene
    rows: Callable[[Response, dict[str, float]], list[dict[str, float | str]]]


def _case(scene: Scene, linear: Screening, place: Vector) -> _Case:
    """The stops of all pairs, each at its clearance (pairs,)."""
    stopped = at_clearances(scene, place)
    words = ", ".join(dict.fromkeys(f"{1e3 * each:.4g}" for each in place))

    def rows(found: Response, closure: dict[str, float]) -> list[dict[str, float | str]]:
        predicted = _predicted(linear, place, closure)
        return [
            {**one, **_simulated(found, name)}
            for one, name in zip(predicted, linear.impact_pairs, strict=True)
        ]

    return _Case(f"{words} mm", stopped, rows)


def _predicted(
    linear: Screening, place: Vector, closure: dict[str, float]
) -> list[dict[str, float | str]]:
    """A row per pair with its clearance, and its rates of impacts by Rice and by the closure."""
    gaps = linear.impact_pairs
    return [
        {
            **({"pair": name} if len(gaps) > 1 else {}),
            "clearance": float(each),
            "clearance_in_sigma": float(each) / (gap.displacement_std or np.nan),
            "rice": gap.rate_at(float(each)),
            "closure": closure.get(name, np.nan),
        }
        for (name, gap), each in zip(gaps.items(), place, strict=True)
    ]


def _simulated(found: Response, pair: str) -> dict[str, float | str]:
    """The simulated rate of impacts of a pair with its interval, and the mean impact speed; the rms
    displacement of an only coordinate between them."""
    hits = found.impact_pairs[pair]
    low, high = _interval(hits.collision_rate)
    moved = [_value(each.displacement_std) for each in found.coordinates.values()]
    return {
        "simulated": _value(hits.collision_rate),
        "simulated_low": low,
        "simulated_high": high,
        **({"displacement_std": moved[0]} if len(moved) == 1 else {}),
        "impact_speed_mean": _value(hits.impact_speed_mean),
    }


def predicted_rates(
    scene: Scene, clearances: ArrayLike, deadline: Deadline = NEVER
) -> pd.DataFrame:
    """The columns of `clearance_curve` that need no simulation.

    Where the closure finds no solution, or is not begun by the deadline, its rate is left out
    (NaN).
    """
    linear = screened(scene)
    return pd.DataFrame(
        [
            row
            for place in _rows(linear, clearances)
            for row in _predicted(
                linear,
                place,
                {} if deadline.passed() else _closure_rates(at_clearances(scene, place), deadline),
            )
        ]
    )


def predicted_curve(scene: Scene, curve: pd.DataFrame) -> pd.DataFrame:
    """The columns of `predicted_rates` at many clearances in the range of a `clearance_curve`.

    The closure is interpolated between the rates of the curve: the logarithm of the rate over the
    square of the clearance, a straight line for a Gaussian motion. Solving it anew at each place
    would take seconds after the budget of the curve is spent.
    """
    linear, pairs = screened(scene), curve.get("pair")
    parts = {name: curve if pairs is None else curve[pairs == name] for name in linear.impact_pairs}
    places = {
        name: np.linspace(part["clearance"].min(), part["clearance"].max(), SMOOTH_POINTS)
        for name, part in parts.items()
    }
    closures = {name: _between(part, places[name]) for name, part in parts.items()}
    return pd.DataFrame(
        [
            row
            for number, place in enumerate(np.transpose([*places.values()]))
            for row in _predicted(
                linear, place, {name: float(rates[number]) for name, rates in closures.items()}
            )
        ]
    )


def _between(curve: pd.DataFrame, places: Vector) -> Vector:
    """Rates of the closure of one pair between the clearances of a curve; NaN beyond them."""
    known = curve[curve["closure"] > 0.0].sort_values("clearance")
    if len(known) < 2:
        return np.full(len(places), np.nan)
    rates = scipy.interpolate.PchipInterpolator(
        known["clearance"] ** 2, np.log(known["closure"]), extrapolate=False
    )
    return np.asarray(np.exp(rates(places**2)))


def _closure_rates(
    scene: Scene, deadline: Deadline = NEVER, share: float = 1.0
) -> dict[str, float]:
    """Impacts per second on each pair by the moment closure; none where it finds no solution in a
    share of the time that is left."""
    try:
        found = linearise(scene, budget=deadline.part(share)).impact_pairs
    except (NotConverged, Interrupted):
        return {}
    return {name: _value(hits.collision_rate) for name, hits in found.items()}


def _value(estimate: Estimate | None) -> float:
    return np.nan if estimate is None else estimate.value


def _interval(estimate: Estimate | None) -> tuple[float, float]:
    assert estimate is not None
    if estimate.upper_95 is not None:
        return 0.0, estimate.upper_95
    half = estimate.half_width_95()
    return max(estimate.value - half, 0.0), estimate.value + half
