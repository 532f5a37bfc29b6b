"""What a clearance report says of the motion with stops: hits, speeds, peaks."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stochvi.isolators.sizing.answer import HITS_PER_FIRST_HIT, spoken_percent
from stochvi.isolators.sizing.chances import probability_at, two_sided
from stochvi.isolators.sizing.hits import at_clearance
from stochvi.methods.monte_carlo import record_path
from stochvi.results.estimates import Estimate
from stochvi.results.response import Response
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.views.report.pages import Grid, Picture, Section, shown
from stochvi.views.report.plots import plot_histogram, plot_impact_speeds, plot_transmissibility
from stochvi.views.report.words import MM, UNKNOWN, G, count_of, with_interval

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.scenes.scene import Scene, System

PATH_PERIODS = 20_000.0
"""Natural periods of the path behind histogram and impact speeds: seconds to make, and at 3 sigma
of a light mount some hundred hits."""

BURN_IN_SHARE = 0.02
"""Of that path, left out at its start."""

FEWEST_HITS = 20
"""In the path, for percentiles of their speeds."""

SPEED_PERCENTILES = (50.0, 95.0, 99.0)

SMALLEST_CHANCE = 1e-6
"""Below, a chance of no hit is only said to be so small."""

NO_HIT = "no hit seen"

NAMES = {"three_sigma": "3 sigma", "recommended": "recommended"}
"""The clearances that are looked at more closely, in words."""


def with_stops(sizing: Sizing) -> Section:
    """Hits at 3 sigma and at the recommended clearance; empty where the scene has no stops."""
    title = "With stops"
    if not sizing.scene.impact_pairs:
        return Section(title=title)
    path = _path(sizing)
    scene = at_clearance(sizing.scene, sizing.three_sigma.clearance)
    speeds = path["impact_speed"].abs().to_numpy()
    speeds = speeds[speeds > 0.0]
    duration = float(path["time"].iloc[-1] - path["time"].iloc[0])
    grids = [_evidence_grid(sizing)]
    if len(speeds) >= FEWEST_HITS:
        grids.append(_speed_grid(scene, speeds))
    notes = [
        f"Pictures and percentiles: a path of {duration:.4g} s, {len(speeds)} hits; "
        f"kurtosis of its displacement {_kurtosis(path):.2f} (3 without stops).",
        f"{HITS_PER_FIRST_HIT[0].upper()}{HITS_PER_FIRST_HIT[1:]}.",
    ]
    if any(law.rigid for pair in sizing.scene.impact_pairs for _, law in pair.stops()):
        notes.append(
            "A restitution gives the speeds of impact, not the peak acceleration: for that the "
            "stop needs a stiffness, or a measured force over deflection."
        )
    return Section(
        title=title,
        lead="Simulated with the law of the stops; 95 % intervals below the values. Rms hides "
        "hits, speeds and peaks show them.",
        grids=grids,
        pictures=_pictures(sizing, scene, path, speeds, duration),
        notes=notes,
    )


def _pictures(
    sizing: Sizing, scene: Scene, path: pd.DataFrame, speeds: np.ndarray, duration: float
) -> list[Picture]:
    found = [
        shown(
            plot_histogram(scene, path, sizing.sigma),
            "Relative displacement with stops at 3 sigma (grey), over the normal law without "
            "stops; logarithmic.",
        )
    ]
    if len(speeds) >= FEWEST_HITS and sizing.screening is not None:
        rice = sizing.three_sigma.rice_hits / sizing.mission
        found.append(
            shown(
                plot_impact_speeds(speeds, duration, rice, sizing.screening.velocity_std),
                "Impacts faster than a speed, per second, with stops at 3 sigma.",
            )
        )
    system = scene.system()
    shaken_base = system.moving_base and not system.noise_on_mass
    if shaken_base and (system.tables or system.intensity):
        found.append(
            shown(
                plot_transmissibility(scene, path),
                "What the mount passes on, without stops and apparently with stops at 3 sigma; "
                "forces of the stops left out.",
            )
        )
    return found


def _path(sizing: Sizing) -> pd.DataFrame:
    """One long path with stops at 3 sigma."""
    stopped = at_clearance(sizing.scene, sizing.three_sigma.clearance)
    period = 2.0 * math.pi / sizing.scene.system().omega
    path = record_path(stopped, duration=PATH_PERIODS * period, seed=seed_of(sizing))
    return path.iloc[round(BURN_IN_SHARE * len(path)) :]


def _kurtosis(path: pd.DataFrame) -> float:
    x = path["displacement"] - path["displacement"].mean()
    return float(np.mean(x**4) / np.mean(x**2) ** 2)


class _Row(NamedTuple):
    """A line of the evidence: words, quantity of the mass or of its impact pair, factor to the
    unit in the words, and what `Screening` calls it."""

    words: str
    quantity: str
    factor: float
    linear: str = ""


def _evidence_rows(sizing: Sizing) -> list[_Row]:
    scene = sizing.scene
    rows = [
        _Row("relative displacement (mm rms)", "displacement_std", MM, "displacement_std"),
        _Row("relative velocity (m/s rms)", "velocity_std", 1.0, "velocity_std"),
        _Row("absolute acceleration (g rms)", "acceleration_std", G, "acceleration_std"),
        _Row("mean of the peak forces (N)", "peak_force", 1.0),
        _Row("mean of the peaks by the stop (g)", "peak_force", G / scene.system().mass),
        _Row("share of time in contact (%)", "contact_probability", 100.0),
    ]
    restitution = {law.restitution for pair in scene.impact_pairs for _, law in pair.stops()}
    if len(restitution) == 1:  # F2 is that of both sides together
        lost = (1.0 - restitution.pop() ** 2) / 2.0
        rows.append(
            _Row("energy lost to stops (mW per kg)", "impact_speed_square_rate", 1e3 * lost)
        )
    return rows


def _hit_rows(sizing: Sizing, places: Mapping[str, float]) -> list[list[str]]:
    """What the table of simulated clearances says of hits, at each place."""
    import pandas as pd

    found: list[dict[Hashable, Any]] = []
    for place in places.values():
        table = sizing.simulated
        near = table[np.isclose(table["clearance"], place)] if len(table) else table
        found.append(dict(near.iloc[0]) if len(near) else {})

    def cells(name: str, factor: float = 1.0, limits: bool = False) -> list[str]:
        texts = []
        for row in found:
            value = row.get(name)
            if value is None or isinstance(value, str) or pd.isna(value):
                texts.append(value if isinstance(value, str) else NO_HIT if row else UNKNOWN)
            elif limits:
                low, high = (factor * row[f"{name}_{end}"] for end in ("low", "high"))
                texts.append(f"{count_of(factor * value)}\n{count_of(low)} to {count_of(high)}")
            else:
                texts.append(f"{factor * value:.3g}")
        return texts

    return [
        ["hits per second", "", *cells("hit_rate", limits=True)],
        ["hits in the mission", "", *cells("hit_rate", sizing.mission, limits=True)],
        ["hits per first hit", "", *cells("hits_per_first_hit")],
        ["mean impact speed (m/s)", "", *cells("impact_speed_mean")],
        ["hits found by", "", *cells("by")],
    ]


def _evidence_grid(sizing: Sizing) -> Grid:
    places = {"three_sigma": sizing.three_sigma.clearance, "recommended": sizing.clearance.value}
    rows = [
        ["clearance per side (mm)", "none", *(f"{MM * place:.4g}" for place in places.values())],
        ["no hit in the mission", "", *(_no_hit(sizing, *item) for item in places.items())],
        *_hit_rows(sizing, places),
    ]
    for row in _evidence_rows(sizing):
        found = [
            _found(sizing.evidence[name], row.quantity) if name in sizing.evidence else None
            for name in places
        ]
        if any(estimate is not None for estimate in found):
            linear = getattr(sizing.screening, row.linear, None) if row.linear else None
            first = "" if linear is None else f"{row.factor * linear:.4g}"
            rows.append([row.words, first, *(with_interval(each, row.factor) for each in found)])
    sides = "both sides together" if two_sided(sizing.scene) else "one stop"
    return Grid(
        caption=f"Without and with stops, a column for each clearance; hits on {sides}",
        headings=["", "no stops (linear)", *(NAMES[name] for name in places)],
        rows=rows,
    )


def _found(answer: Response, quantity: str) -> Estimate | None:
    """An estimate of the mass, or of its one impact pair."""
    for (_, name), estimate in answer.estimates().items():
        if name == quantity:
            return estimate
    return None


def _no_hit(sizing: Sizing, name: str, clearance: float) -> str:
    chance = probability_at(sizing, clearance)
    if name == "three_sigma":
        chance = sizing.three_sigma.probability.value
    if chance is None:
        return UNKNOWN
    if 1.0 - chance < SMALLEST_CHANCE:
        return f"under {100.0 * SMALLEST_CHANCE:g} %"
    return spoken_percent(1.0 - chance)


def _speed_grid(scene: Scene, speeds: np.ndarray) -> Grid:
    """Percentiles of impact speed and, of stops that give way, what the mass then feels."""
    system = scene.system()
    rest = system.load / system.omega**2
    stops = [
        (abs(place - rest), law)
        for place, law in ((system.lower, system.law_lower), (system.upper, system.law_upper))
        if place is not None and isinstance(law, CompliantLaw)
    ]
    headings = ["share of impacts slower than it", "impact speed (m/s)"]
    if stops:
        headings += ["peak acceleration (g)", "deflection (mm)", "contact (ms)"]
    rows = []
    for percentile in SPEED_PERCENTILES:
        speed = float(np.percentile(speeds, percentile))
        row = [f"{percentile:g} %", f"{speed:.3g}"]
        if stops:
            hits = [hit_on_mount(system, law, distance, speed) for distance, law in stops]
            hardest = max(hits, key=lambda hit: hit.peak_acceleration)
            row += [
                f"{G * hardest.peak_acceleration:.3g}",
                f"{MM * hardest.deflection:.3g}",
                f"{1e3 * hardest.contact_time:.3g}",
            ]
        rows.append(row)
    caption = f"Impacts with stops at 3 sigma, {count_of(len(speeds))} of them"
    if stops:
        caption += "; peaks by mount and stop together, the base at rest meanwhile, harder side"
    return Grid(caption=caption, headings=headings, rows=rows)


class Hit(NamedTuple):
    """One contact of a mass on its mount with a stop (SI units)."""

    peak_acceleration: float
    deflection: float
    contact_time: float


def hit_on_mount(system: System, law: CompliantLaw, distance: float, speed: float) -> Hit:
    """A mass that meets a stop `distance` from its mean position at `speed`, the base at rest.

    y'' = -(b y' + omega^2 (distance + y)) - F(y, y') from y = 0, y' = speed until the mass is
    back at y = 0; `law` gives F per unit mass. The peak is that of |y''|, mount and stop together.
    """
    from scipy.integrate import solve_ivp

    b, stiff = system.damping_rate, system.omega**2

    def motion(_: float, state: np.ndarray) -> list[float]:
        y, v = state
        return [v, -(b * v + stiff * (distance + y)) - float(law.force_at(y, v))]

    def back(_: float, state: np.ndarray) -> float:
        return float(state[0])

    back.terminal, back.direction = True, -1.0  # type: ignore[attr-defined]
    # the mount only shortens a contact
    longest = 1.1 * law.impact(speed, 1.0).contact_time + math.pi / system.omega
    shortest = min(law.impact(speed, 1.0).contact_time, 1.0 / system.omega)
    found = solve_ivp(
        motion, (0.0, longest), [0.0, speed], events=back, max_step=shortest / CONTACT_STEPS,
        rtol=1e-7, atol=1e-9 * speed * shortest,
    )  # fmt: skip
    y, v = found.y
    force = np.array([float(law.force_at(*state)) for state in found.y.T])
    touching = found.t[force > 0.0]
    return Hit(
        peak_acceleration=float(np.abs(b * v + stiff * (distance + y) + force).max()),
        deflection=float(y.max()),
        contact_time=float(touching[-1]) if len(touching) else 0.0,
    )


CONTACT_STEPS = 200.0
"""In a contact; its peak is then read to 1e-4."""


def seed_of(sizing: Sizing) -> int:
    """The seed of the sizing."""
    seed = sizing.provenance.get("seed")
    return seed if isinstance(seed, int) else 0
