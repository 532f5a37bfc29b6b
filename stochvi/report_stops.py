"""What a clearance report says of the motion with stops: hits, speeds, peaks."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stochvi.contacts import CompliantLaw
from stochvi.estimates import Estimate, Response
from stochvi.hits import at_clearance
from stochvi.monte_carlo import record_path
from stochvi.pages import Grid, Picture, Section, shown
from stochvi.report_plots import plot_histogram, plot_impact_speeds, plot_transmissibility
from stochvi.sizings import spoken_percent
from stochvi.words import MM, UNKNOWN, G, count_of, with_interval

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.scenes import Scene
    from stochvi.sizings import Sizing

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
        f"kurtosis of its displacement {_kurtosis(path):.2f} (3 without stops)."
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
    if scene.system().moving_base:
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
        ["hits for each first hit", "", *cells("hits_per_first_hit")],
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


def two_sided(scene: Scene) -> bool:
    """Whether both sides are sized: two stops, or none yet."""
    return not scene.impact_pairs or len(scene.impact_pairs[0].stops()) == 2


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
    """Percentiles of impact speed and, of stops that give way, what a free mass then feels."""
    system = scene.system()
    laws = [law for law in (system.law_lower, system.law_upper) if law is not None]
    soft = [law for law in laws if isinstance(law, CompliantLaw)]
    headings = ["share of impacts slower than it", "impact speed (m/s)"]
    if soft:
        headings += ["peak acceleration (g)", "deflection (mm)", "contact (ms)"]
    rows = []
    for percentile in SPEED_PERCENTILES:
        speed = float(np.percentile(speeds, percentile))
        row = [f"{percentile:g} %", f"{speed:.3g}"]
        if soft:
            impacts = [law.impact(speed, 1.0) for law in soft]  # laws per unit mass
            row += [
                f"{G * max(impact.peak_force for impact in impacts):.3g}",
                f"{MM * max(impact.peak_deflection for impact in impacts):.3g}",
                f"{1e3 * max(impact.contact_time for impact in impacts):.3g}",
            ]
        rows.append(row)
    caption = f"Impacts with stops at 3 sigma, {count_of(len(speeds))} of them"
    if soft:
        caption += "; peaks are those of a free mass that arrives at that speed, the harder stop"
    return Grid(caption=caption, headings=headings, rows=rows)


def probability_at(sizing: Sizing, clearance: float) -> float | None:
    """Chance of any hit in the mission at a clearance of the curve; None before its start."""
    if sizing.target.name == "probability" and clearance == sizing.clearance.value:
        return sizing.target.value
    found = _bursts_at(sizing, clearance)
    return None if found is None else -math.expm1(-found)


def probability_of_stops(sizing: Sizing) -> float | None:
    """Chance of any hit in the mission with the stops where the scene has them.

    A response as often above its mean as below brings half the bursts of equal distances to each
    side; bursts on the two sides are taken for independent.
    """
    scene = sizing.scene
    system = scene.system()
    rest = system.load / system.omega**2
    places = [place for place in (system.lower, system.upper) if place is not None]
    beyond = [place < rest for place in places] == [True, False]
    if not places or (len(places) == 2 and not beyond):
        return None
    found = [_bursts_at(sizing, abs(place - rest)) for place in places]
    if any(bursts is None for bursts in found):
        return None
    return -math.expm1(-sum(bursts for bursts in found if bursts) / len(places))


def _bursts_at(sizing: Sizing, clearance: float) -> float | None:
    """-log(1 - P) at a clearance; 0 beyond the curve, None before it."""
    curve = sizing.curve
    x, p = curve["clearance"].to_numpy(), curve["probability"].to_numpy()
    if clearance < x.min():
        return None
    if clearance > x.max():
        return 0.0
    # it falls nearly as a Gaussian: straight in its logarithm over the square of the clearance
    bursts = -np.log1p(-np.clip(p, LEAST, CERTAIN))
    return math.exp(float(np.interp(clearance**2, x**2, np.log(bursts))))


LEAST, CERTAIN = 1e-300, 1.0 - 1e-15
"""Of a chance whose logarithm is taken."""


def seed_of(sizing: Sizing) -> int:
    """The seed of the sizing."""
    seed = sizing.provenance.get("seed")
    return seed if isinstance(seed, int) else 0
