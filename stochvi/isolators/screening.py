"""Isolators between stops: linear screening, and hit rates against clearance."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
from numpy.typing import ArrayLike, NDArray

from stochvi.isolators.record_verdict import RecordVerdict, record_verdict
from stochvi.isolators.structure_screening import StructureScreening, screen_structure
from stochvi.mathematics.impact_rates import rice_rate
from stochvi.mathematics.spectra import LinearMoments, Table, response_moments
from stochvi.mathematics.units import STANDARD_GRAVITY, density_from_intensity
from stochvi.methods.linearisation import linearise
from stochvi.methods.monte_carlo import simulate
from stochvi.methods.monte_carlo.simulate import check_arguments
from stochvi.model.calculations import calculation
from stochvi.model.cautions import scene_notes
from stochvi.model.coverage import beyond_one_oscillator, without_noise
from stochvi.model.model import model_of
from stochvi.results.base import COMMON, Result
from stochvi.results.deadline import NEVER, Deadline, heeding_ctrl_c
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import Estimate, provenance
from stochvi.results.progress import Progress
from stochvi.results.response import Response
from stochvi.scenes.impact_laws import Law
from stochvi.scenes.scene import ImpactPair, Scene

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

SMOOTH_POINTS = 31
"""Number of clearances of a smooth curve of hit rates."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Screening(Result):
    """Response of an isolator without stops by linear theory (SI units; rates in 1/s).

    `miles` is None where Miles' equation does not apply: where the natural frequency lies outside
    the table, the density at it is 0, although the response is not. `notes` are warnings in words.
    `record` judges a measured record that shakes the isolator; None without one.

    See Also
    --------
    stochvi.screen : What makes it.
    """

    not_in_document = COMMON

    displacement_std: float
    velocity_std: float
    acceleration_std: float
    zero_crossing_rate: float
    miles: float | None
    input_acceleration_std: float | None
    notes: tuple[str, ...] = ()
    record: RecordVerdict | None = None

    def rice_rate(self, clearance: float) -> float:
        """Hits per second on two stops at +-clearance, as if hits changed nothing (Rice)."""
        return 2.0 * rice_rate(clearance, self.displacement_std, self.velocity_std)

    def to_frame(self) -> pd.DataFrame:
        """A table for people: millimetres, g and hertz."""
        mm, g = 1e3, 1.0 / STANDARD_GRAVITY
        hits = self.rice_rate(3.0 * self.displacement_std)
        rows = [
            ("input acceleration", self.input_acceleration_std, g, "g rms"),
            ("relative displacement", self.displacement_std, mm, "mm rms"),
            ("relative velocity", self.velocity_std, 1.0, "m/s rms"),
            ("absolute acceleration", self.acceleration_std, g, "g rms"),
            ("Miles' equation for it", self.miles, g, "g rms"),
            ("zero up-crossings", self.zero_crossing_rate, 1.0, "Hz"),
            ("3 sigma clearance, per side", 3.0 * self.displacement_std, mm, "mm"),
            ("hits on it by Rice, both sides", hits * 3600.0, 1.0, "per hour"),
        ]
        return pd.DataFrame(
            [
                {"quantity": name, "value": value * factor, "unit": unit}
                for name, value, factor, unit in rows
                if value is not None
            ]
        )

    def summary(self) -> str:
        """The numbers of the table in words; a record that does not agree with them is named
        first."""
        text = "linear screening, stops left out"
        if self.record is not None and not self.record.agrees:
            return f"{self.record.sentence()}; {text}"
        return text

    def _remarks(self) -> Sequence[str]:
        return (*self.notes, *self.warnings)


@calculation
def screen(
    scene: Scene,
    *,
    budget: float | None = None,
) -> Screening | StructureScreening:
    """Linear screening of a scene, stops left out.

    An isolator on its moving base is screened as `screen_isolator` says, a structure of several
    coordinates or pairs as `screen_structure` says.

    Parameters
    ----------
    scene
        The scene.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    Screening | StructureScreening
        The linear answer; of several coordinates that of each.

    See Also
    --------
    stochvi.size : The clearance that is needed.
    stochvi.isolators.clearance_curve : Hit rates over clearances.

    Examples
    --------
    >>> from stochvi.scenes.excitations import TabulatedNoise
    >>> from stochvi.scenes.structures import Isolator
    >>> truck = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    >>> mount = Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[truck])
    >>> round(1e3 * screen(mount).displacement_std, 2)
    1.99
    """
    return screen_isolator(scene) if model_of(scene).single else screen_structure(scene)


def screen_isolator(scene: Scene) -> Screening:
    """Linear screening of an isolator on its moving base, stops left out.

    sigma_x, sigma_v and the absolute acceleration are integrals of the response density;
    Miles' equation, G_rms = sqrt(pi / 2 f_n Q W(f_n)), is listed with them.
    """
    model = model_of(scene)
    unmet = beyond_one_oscillator(model)
    if unmet:
        raise NotApplicable("screening", unmet)
    tables = model.acceleration_tables
    if not model.moving_base or model.noise_on_mass:
        unmet.append("structure.kind must be 'isolator' with noise on its base only")
    if model.damping_rate == 0.0 or model.omega == 0.0:
        unmet.append("damping and stiffness must be positive")
    unmet += without_noise(model)
    if unmet:
        raise NotApplicable("screening", unmet)
    omega, b = model.omega, model.damping_rate
    shaken = response_moments(tables, omega, b)
    theta = model.intensity / (2.0 * b)
    moments = LinearMoments(
        displacement=shaken.displacement + theta / omega**2,
        velocity=shaken.velocity + theta,
        absolute_acceleration=shaken.absolute_acceleration + theta * (b**2 + omega**2),
        relative_acceleration=math.inf if theta else shaken.relative_acceleration,
    )
    density = _density_at(tables, omega) + density_from_intensity(model.intensity)
    deviation, velocity = math.sqrt(moments.displacement), math.sqrt(moments.velocity)
    area = sum(table.mean_square() for table in tables)
    return Screening(
        displacement_std=deviation,
        velocity_std=velocity,
        acceleration_std=math.sqrt(moments.absolute_acceleration),
        zero_crossing_rate=velocity / deviation / (2.0 * math.pi),
        miles=math.sqrt(math.pi / 2.0 * omega / (2.0 * math.pi) * omega / b * density)
        if density > 0.0
        else None,
        input_acceleration_std=None if theta else math.sqrt(area),
        notes=tuple(scene_notes(model)),
        record=record_verdict(scene),
        provenance=provenance(scene.document()),
    )


def _density_at(tables: Sequence[Table], omega: float) -> float:
    return sum(float(table(omega / (2.0 * math.pi))) for table in tables)


def with_clearance(scene: Scene, clearance: float, law: Law | None = None) -> Scene:
    """The same scene between stops at +-clearance from where its static equilibrium would be."""
    rest = model_of(scene).rest
    kept = (
        scene.impact_pairs[0].model_dump(include={"name", "law", "lower_law", "upper_law"})
        if (scene.impact_pairs)
        else {}
    )
    if law is not None:
        kept = {"law": law}
    pair = ImpactPair(**kept, lower=rest - clearance, upper=rest + clearance)
    return scene.model_copy(update={"impact_pairs": (pair,)})


def clearance_notes(
    scene: Scene, linear: Screening, clearances: Sequence[float]
) -> tuple[str, ...]:
    """Warnings to a curve of hit rates: those of the screening, and one where a load moves the mass
    by more than its gap.

    Parameters
    ----------
    linear
        The screening of the scene.
    clearances
        Metres per side from the static equilibrium.
    """
    rest, nearest = model_of(scene).rest, min(clearances, default=math.inf)
    if abs(rest) <= nearest:
        return linear.notes
    sag = (
        f"the load moves the mass by {1e3 * rest:+.4g} mm, more than the gap of "
        f"{1e3 * nearest:.4g} mm: gaps are counted from where the mass hangs, and stops that stand "
        "about the position of the unloaded spring would hold it"
    )
    return (*linear.notes, sag)


def with_clearances(scene: Scene, clearances: Vector) -> Scene:
    """The same scene with the stops of each pair at a distance (pairs,) from its mean gap, m."""
    model, whole = model_of(scene), scene.expanded
    means = model.modal.gaps @ model.modal.rest
    pairs = [
        pair.model_copy(
            update={
                "lower": None if pair.lower is None else float(mean - clearance),
                "upper": None if pair.upper is None else float(mean + clearance),
            }
        )
        for pair, mean, clearance in zip(whole.impact_pairs, means, clearances, strict=True)
    ]
    return whole.model_copy(update={"impact_pairs": tuple(pairs)})


@calculation
def clearance_curve(
    scene: Scene,
    clearances: Sequence[float] | Matrix,
    *,
    rel_error: float = 0.02,
    seed: int = 0,
    threads: int | None = None,
    budget: float | None = 60.0,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Hit rate against clearance: by Rice, by the moment closure, and by Monte Carlo.

    Parameters
    ----------
    scene
        An isolator with one impact pair, or a structure of several coordinates or pairs. The laws
        of the stops are kept, and all stops move together.
    clearances
        Metres per side from the static equilibrium; of several pairs, of all of them, or a row
        (pairs,) each.
    rel_error
        Relative standard error to reach.
    seed
        Seed of the random numbers: the same seed gives the same digits.
    threads
        Number of threads; by default all cores.
    budget
        Seconds of wall time after which an answer is given with what was reached.
    progress
        Called now and then with what is done and what was reached.

    Returns
    -------
    pandas.DataFrame
        One row per clearance, and per pair where there are several (m, and in sigma of the linear
        response): hits per second on both sides by `rice`, `closure` and `simulated`, the last with
        its 95 % interval (`simulated_low`, `simulated_high`), and the mean impact speed; of one
        oscillator the rms displacement, too, of several pairs the name of the `pair`.

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
    check_arguments(rel_error, None, None, seed, None, budget, threads)
    places = np.asarray(clearances, dtype=float)
    if not np.all((places > 0.0) & np.isfinite(places)):
        raise ValueError(f"clearances must be positive, got {places.tolist()} m")
    cases = _cases(scene, places) if model_of(scene).single else _cases_of_pairs(scene, places)
    rows: list[dict[str, float | str]] = []
    short: list[str] = []
    deadline = Deadline.after(budget)
    with heeding_ctrl_c():
        for number, case in enumerate(cases):
            simulated = None

            def report(done: float, text: str, number: int = number) -> None:
                if progress:
                    progress((number + done) / len(cases), text)

            try:
                if not deadline.passed():
                    simulated = simulate(
                        case.scene, rel_error=rel_error, seed=seed, threads=threads,
                        progress=report, budget=deadline.part(1.0 / (len(cases) - number)),
                    )  # fmt: skip
                else:
                    short.append(case.words)
            except (NotConverged, Interrupted) as reason:
                simulated = reason.response
                short.append(case.words)
            if simulated is not None:
                rows += case.rows(simulated)
    curve = pd.DataFrame(rows)
    if short:
        raise deadline.fell_short(
            f"before the hits at {', '.join(short)} were known to a relative error of "
            f"{rel_error:g}",
            "raise budget or rel_error",
            curve if rows else None,
        )
    return curve


class _Case(NamedTuple):
    """One clearance of a curve: how messages call it, its scene, and what makes its rows from a
    response."""

    words: str
    scene: Scene
    rows: Callable[[Response], list[dict[str, float | str]]]


def _cases(scene: Scene, clearances: Vector) -> list[_Case]:
    """The stops of one oscillator, at one clearance after the other."""
    linear = screen_isolator(scene)

    def case(clearance: float) -> _Case:
        stopped = with_clearance(scene, clearance)
        words = f"{1e3 * clearance:.4g} mm"
        return _Case(words, stopped, lambda found: [_row(linear, stopped, clearance, found)])

    return [case(float(clearance)) for clearance in clearances]


def _cases_of_pairs(scene: Scene, clearances: Matrix) -> list[_Case]:
    """The stops of all pairs, moved together."""
    linear = screen_structure(scene)
    gaps = linear.impact_pairs
    rows = clearances[:, None] if clearances.ndim == 1 else clearances
    places = np.broadcast_to(rows, (len(rows), len(gaps)))

    def case(place: Vector) -> _Case:
        stopped = with_clearances(scene, place)
        sizes = dict.fromkeys(f"{1e3 * each:.4g}" for each in place)

        def rows(found: Response) -> list[dict[str, float | str]]:
            closure = _closure_rates(stopped)
            return [
                {
                    "pair": name,
                    "clearance": float(each),
                    "clearance_in_sigma": float(each) / gap.displacement_std
                    if gap.displacement_std
                    else np.nan,
                    "rice": gap.rate_at(float(each)),
                    "closure": closure.get(name, np.nan),
                    **_simulated(found, name),
                }
                for (name, gap), each in zip(gaps.items(), place, strict=True)
            ]

        return _Case(f"{', '.join(sizes)} mm", stopped, rows)

    return [case(place) for place in places]


def _simulated(found: Response, pair: str) -> dict[str, float | str]:
    """The simulated rate of hits of a pair with its interval, and the mean impact speed."""
    hits = found.impact_pairs[pair]
    low, high = _interval(hits.collision_rate)
    return {
        "simulated": _value(hits.collision_rate),
        "simulated_low": low,
        "simulated_high": high,
        "impact_speed_mean": _value(hits.impact_speed_mean),
    }


def _row(
    linear: Screening, stopped: Scene, clearance: float, simulated: Response
) -> dict[str, float | str]:
    """A row of `clearance_curve`."""
    found = _simulated(simulated, stopped.impact_pairs[0].name)
    speed = found.pop("impact_speed_mean")
    return {
        "clearance": clearance,
        "clearance_in_sigma": clearance / linear.displacement_std,
        "rice": linear.rice_rate(clearance),
        "closure": _closure_rate(stopped),
        **found,
        "displacement_std": _value(simulated.coordinates["x"].displacement_std),
        "impact_speed_mean": speed,
    }


def predicted_rates(
    scene: Scene, clearances: Sequence[float], deadline: Deadline = NEVER
) -> pd.DataFrame:
    """`clearance`, `clearance_in_sigma`, `rice` and `closure` alone: nothing is simulated.

    Where the closure finds no solution, or is not begun by the deadline, its rate is left out
    (NaN).
    """
    closure = [
        np.nan if deadline.passed() else _closure_rate(with_clearance(scene, each))
        for each in clearances
    ]
    return _rates(scene, np.asarray(clearances), closure)


def predicted_curve(scene: Scene, curve: pd.DataFrame) -> pd.DataFrame:
    """The columns of `predicted_rates` at many clearances in the range of a `clearance_curve`.

    The closure is interpolated between the rates that the curve holds, as the logarithm of the rate
    over the square of the clearance, which is a straight line for a Gaussian motion: solving it
    anew at each place would take seconds after the budget of the curve is spent.
    """
    lowest, highest = curve["clearance"].min(), curve["clearance"].max()
    places = np.linspace(lowest, highest, SMOOTH_POINTS)
    known = curve[curve["closure"] > 0.0].sort_values("clearance")
    closure = np.full(len(places), np.nan)
    if len(known) > 1:
        rates = scipy.interpolate.PchipInterpolator(
            known["clearance"] ** 2, np.log(known["closure"]), extrapolate=False
        )
        closure = np.exp(rates(places**2))
    return _rates(scene, places, closure)


def _rates(scene: Scene, clearances: np.ndarray, closure: ArrayLike) -> pd.DataFrame:
    """The table of Rice's rates and of the given rates `closure` at clearances (m)."""
    linear = screen_isolator(scene)
    return pd.DataFrame(
        {
            "clearance": clearances,
            "clearance_in_sigma": clearances / linear.displacement_std,
            "rice": [linear.rice_rate(each) for each in clearances],
            "closure": closure,
        }
    )


def _closure_rate(scene: Scene) -> float:
    return _closure_rates(scene).get(scene.impact_pairs[0].name, np.nan)


def _closure_rates(scene: Scene) -> dict[str, float]:
    """Hits per second on each pair by the moment closure; none where it finds no solution."""
    try:
        found = linearise(scene).impact_pairs
    except NotConverged:
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
