"""The report of a sizing: a page for a design review, with its tables and numbers beside it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from stochvi.contacts import Restitution
from stochvi.errors import NotApplicable
from stochvi.estimates import Estimate, Response
from stochvi.files import to_json, write_table, write_text
from stochvi.isolators import predicted_rates, with_clearance
from stochvi.monte_carlo import record_path
from stochvi.pages import Fact, Grid, Page, Section, shown
from stochvi.report_inputs import environment, gap, mount
from stochvi.report_plots import (
    plot_cumulative,
    plot_histogram,
    plot_hit_rate,
    plot_impact_speeds,
    plot_risk,
    plot_sensitivity,
    plot_transmissibility,
)
from stochvi.sensitivity import sensitivity
from stochvi.words import MM, UNKNOWN, G, count_of, duration_of, millimetres, percent, with_interval

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

CLOSURE_POINTS = 41

NAMES = {"three_sigma": "3 sigma", "recommended": "recommended"}
"""The clearances that are looked at more closely, in words."""


def write_report(sizing: Sizing, folder: str | Path) -> Path:
    """Write `report.html` with its tables (CSV) and `size.json`; returns the path of the page.

    The page needs nothing beside it: pictures and style are embedded, and nothing is fetched.

    Parameters
    ----------
    sizing
        From `size`.
    folder
        Made if it is missing. `curve.csv`, `required.csv`, `simulated.csv`, `sensitivity.csv` and
        `evidence.csv` hold what the page draws, in SI units.
    """
    folder = Path(folder)
    tables = {"curve": sizing.curve, "required": sizing.required, "simulated": sizing.simulated}
    sensitive = _sensitivity(sizing)
    if sensitive is not None:
        tables["sensitivity"] = sensitive
    for name, table in tables.items():
        if len(table):
            write_table(table, folder / f"{name}.csv")
    if sizing.evidence:
        import pandas as pd

        frames = [answer.to_frame().assign(at=name) for name, answer in sizing.evidence.items()]
        write_table(pd.concat(frames), folder / "evidence.csv")
    write_text(to_json(sizing.to_dict()) + "\n", folder / "size.json")
    path = folder / "report.html"
    write_text(clearance_page(sizing, sensitive).html(), path)
    return path


def clearance_page(sizing: Sizing, sensitive: pd.DataFrame | None = None) -> Page:
    """The page of a sizing; `sensitive` from `sensitivity`, where the scene has one."""
    path = _path(sizing)
    return Page(
        title=sizing.scene.title or "Clearance of an isolator",
        subtitle=f"Clearance of an isolated mass between its stops, for a mission of "
        f"{duration_of(sizing.mission)}",
        verdict=f"Clearance: {sizing.verdict()}.",
        cards=_cards(sizing),
        warnings=tuple(dict.fromkeys([*sizing.warnings, *_screening_notes(sizing)])),
        sections=[
            environment(sizing.scene),
            mount(sizing.scene),
            gap(sizing),
            _screening(sizing),
            _risk(sizing),
            _with_stops(sizing, path),
            _sensitivity_section(sensitive),
            _verification(sizing),
            _limits(sizing),
        ],
        footer=_footer(sizing),
    )


# Verdict ----------------------------------------------------------------------------------


def _cards(sizing: Sizing) -> list[Fact]:
    three, c = sizing.three_sigma, sizing.clearance
    hits = "as if hits changed nothing" if three.hits is None else "with these stops"
    count = three.rice_hits if three.hits is None else three.hits.value
    return [
        Fact(
            "Clearance per side",
            millimetres(c.value),
            f"{millimetres(c.lower)} to {millimetres(c.upper)} (95 % of the calculation), "
            f"{c.value / sizing.sigma:.2f} sigma, from the mean position",
        ),
        Fact(
            f"Chance of any hit in {duration_of(sizing.mission)}",
            percent(_probability_at(sizing, c.value)),
            "at that clearance",
        ),
        Fact(
            "3 sigma would be",
            millimetres(three.clearance),
            "three times the linear rms, per side",
        ),
        Fact(
            "and would risk",
            f"{percent(three.probability.value)} of any hit",
            f"{count_of(count)} hits expected in {duration_of(sizing.mission)}, {hits}",
        ),
    ]


def _screening_notes(sizing: Sizing) -> tuple[str, ...]:
    return () if sizing.screening is None else tuple(sizing.screening.notes)


def _probability_at(sizing: Sizing, clearance: float) -> float | None:
    """Chance of any hit in the mission, read off the curve; None beyond its ends."""
    if sizing.target.name == "probability" and clearance == sizing.clearance.value:
        return sizing.target.value
    curve = sizing.curve
    x, p = curve["clearance"].to_numpy(), curve["probability"].to_numpy()
    if not (x.min() <= clearance <= x.max()) or not np.all(p > 0.0):
        return None
    # the number of bursts -log(1 - p) falls nearly as a Gaussian, straight in its logarithm
    bursts = -np.log1p(-np.minimum(p, 1.0 - 1e-12))
    return float(-np.expm1(-np.exp(np.interp(clearance, x, np.log(bursts)))))


# Linear screening and risk ----------------------------------------------------------------


def _screening(sizing: Sizing) -> Section:
    linear = sizing.screening
    if linear is None:
        return Section(title="Linear screening")
    three = sizing.three_sigma.clearance
    natural = sizing.scene.system().omega / (2.0 * math.pi)
    crossings = 2.0 * linear.zero_crossing_rate * sizing.mission
    facts = [
        Fact(
            "Relative displacement, s_x",
            f"{millimetres(linear.displacement_std)} rms",
            "without stops",
        ),
        Fact("Relative velocity, s_v", f"{linear.velocity_std:.4g} m/s rms"),
        Fact("Absolute acceleration", f"{G * linear.acceleration_std:.4g} g rms"),
        Fact(
            "Zero up-crossings",
            f"{linear.zero_crossing_rate:.4g} Hz",
            f"natural frequency {natural:.4g} Hz; far above it one hit starts a burst",
        ),
        _miles(sizing),
        Fact("3 sigma", millimetres(three), "per side, three times s_x"),
        Fact(
            "Hits at 3 sigma by Rice",
            f"{count_of(sizing.three_sigma.rice_hits)}",
            f"in {duration_of(sizing.mission)}, both sides, as if hits changed nothing; "
            f"{linear.rice_rate(three):.4g} per second",
        ),
        Fact(
            "Expected largest displacement",
            millimetres(_largest(crossings) * sizing.sigma),
            f"of {duration_of(sizing.mission)}, either side, {_largest(crossings):.3g} sigma "
            "(Davenport)",
        ),
    ]
    pictures = []
    if sizing.scene.system().moving_base:
        pictures = [
            shown(
                plot_cumulative(sizing.scene),
                "Where the response comes from: share of its mean "
                "square below each frequency, without stops.",
            ),
        ]
    return Section(
        title="Linear screening",
        lead="What the rule of three sigma rests on: the mount without stops, a Gaussian response.",
        facts=facts,
        pictures=pictures,
    )


def _miles(sizing: Sizing) -> Fact:
    linear = sizing.screening
    assert linear is not None
    name = "Miles' equation for it"
    if linear.miles is None:
        return Fact(
            name, "not valid", "the input is 0 at the natural frequency; the response is not"
        )
    off = linear.miles / linear.acceleration_std - 1.0
    return Fact(
        name,
        f"{G * linear.miles:.4g} g rms",
        f"{100.0 * off:+.2g} % off the integral: the input is not flat"
        if abs(off) > 0.01
        else "agrees with the integral",
    )


def _largest(count: float) -> float:
    """Mean of the largest of `count` peaks in standard deviations (Davenport 1964).

    >>> round(_largest(600.0), 6)
    3.738226
    """
    root = math.sqrt(2.0 * math.log(max(count, math.e)))
    return root + float(np.euler_gamma) / root


def _risk(sizing: Sizing) -> Section:
    rows = [
        [
            percent(row["probability"]),
            f"{MM * row['clearance']:.4g}",
            f"{MM * row['clearance_low']:.4g} to {MM * row['clearance_high']:.4g}",
            f"{row['clearance_in_sigma']:.3f}",
        ]
        for row in sizing.required.to_dict("records")
    ]
    grid = Grid(
        caption=f"Clearance per side by the chance of any hit in {duration_of(sizing.mission)}",
        headings=["chance of any hit", "clearance (mm)", "95 % interval (mm)", "sigma"],
        rows=rows,
    )
    pictures = [
        shown(
            plot_risk(sizing),
            "Chance of any hit in the mission against clearance, with the "
            "95 % band of the calculation; grey lines are the chances of the table.",
        ),
        shown(
            plot_hit_rate(sizing, _closure(sizing)),
            "Hits per second, both sides, against "
            "clearance: by Rice, the rate of first hits, and simulated with the stops.",
        ),
    ]
    return Section(
        title="Required clearance",
        lead="The chance of any hit depends on the motion without stops alone: nothing has been "
        "hit before the first hit. Intervals are those of the calculation; they do not hold what "
        "is unknown of the mount and the environment (see sensitivity).",
        grids=[grid],
        pictures=pictures,
    )


def _closure(sizing: Sizing) -> pd.DataFrame | None:
    """Hit rate by the moment closure, where the stops are rigid and no sine shakes."""
    scene, x = sizing.scene, sizing.curve["clearance"]
    pairs = scene.impact_pairs
    if sizing.screening is None or not pairs or not all(law.rigid for _, law in pairs[0].stops()):
        return None
    try:
        return predicted_rates(scene, list(np.linspace(x.min(), x.max(), CLOSURE_POINTS)))
    except NotApplicable:
        return None


# With stops -------------------------------------------------------------------------------


def _path(sizing: Sizing) -> pd.DataFrame | None:
    """One long path with stops at 3 sigma; None where the scene has no law for them."""
    scene = sizing.scene
    if not scene.impact_pairs or scene.beyond_one_oscillator():
        return None
    stopped = with_clearance(scene, sizing.three_sigma.clearance)
    period = 2.0 * math.pi / scene.system().omega
    path = record_path(stopped, duration=PATH_PERIODS * period, seed=_seed(sizing))
    return path.iloc[round(BURN_IN_SHARE * len(path)) :]


def _seed(sizing: Sizing) -> int:
    seed = sizing.provenance.get("seed")
    return seed if isinstance(seed, int) else 0


def _with_stops(sizing: Sizing, path: pd.DataFrame | None) -> Section:
    title = "With stops"
    if not sizing.evidence and path is None:
        return Section(title=title)
    grids = [_evidence_grid(sizing)] if sizing.evidence else []
    pictures, notes = [], []
    if path is not None:
        scene = with_clearance(sizing.scene, sizing.three_sigma.clearance)
        speeds = path["impact_speed"].abs().to_numpy()
        speeds = speeds[speeds > 0.0]
        duration = float(path["time"].iloc[-1] - path["time"].iloc[0])
        if len(speeds) >= FEWEST_HITS:
            grids.append(_speed_grid(scene, speeds))
        pictures.append(
            shown(
                plot_histogram(scene, path, sizing.sigma),
                "Relative displacement with stops at "
                "3 sigma (grey), over the normal law without stops; logarithmic.",
            )
        )
        if len(speeds) >= FEWEST_HITS and sizing.screening is not None:
            linear = sizing.screening
            pictures.append(
                shown(
                    plot_impact_speeds(
                        speeds,
                        duration,
                        linear.rice_rate(sizing.three_sigma.clearance),
                        linear.velocity_std,
                    ),
                    "Impacts faster than a speed, per second, with stops at 3 sigma.",
                )
            )
        if scene.system().moving_base:
            pictures.append(
                shown(
                    plot_transmissibility(scene, path),
                    "What the mount passes on, without stops "
                    "and apparently with stops at 3 sigma; forces of the stops left out.",
                )
            )
        notes.append(
            f"Pictures and percentiles: a path of {duration:.4g} s, {len(speeds)} hits; "
            f"kurtosis of its displacement {_kurtosis(path):.2f} (3 without stops)."
        )
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
        pictures=pictures,
        notes=notes,
    )


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

    @property
    def of_hits(self) -> bool:
        """Whether it means nothing where no hit was seen."""
        return not self.linear and self.quantity != "collision_rate"


NO_HIT = "no hit seen"


def _unhit(answer: Response) -> bool:
    rate = _found(answer, "collision_rate")
    return rate is not None and rate.upper_95 is not None


def _evidence_rows(sizing: Sizing) -> list[_Row]:
    scene = sizing.scene
    rows = [
        _Row("relative displacement (mm rms)", "displacement_std", MM, "displacement_std"),
        _Row("relative velocity (m/s rms)", "velocity_std", 1.0, "velocity_std"),
        _Row("absolute acceleration (g rms)", "acceleration_std", G, "acceleration_std"),
        _Row("hits per second, both sides", "collision_rate", 1.0),
        _Row("hits in the mission, both sides", "collision_rate", sizing.mission),
        _Row("mean impact speed (m/s)", "impact_speed_mean", 1.0),
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


def _evidence_grid(sizing: Sizing) -> Grid:
    kept = [name for name in NAMES if name in sizing.evidence]
    places = {"three_sigma": sizing.three_sigma.clearance, "recommended": sizing.clearance.value}
    rows = [
        ["clearance per side (mm)", "none", *(f"{MM * places[name]:.4g}" for name in kept)],
        ["no hit in the mission", "", *(_no_hit(sizing, name, places[name]) for name in kept)],
    ]
    for row in _evidence_rows(sizing):
        found = [_found(sizing.evidence[name], row.quantity) for name in kept]
        linear = getattr(sizing.screening, row.linear, None) if row.linear else None
        if any(estimate is not None for estimate in found):
            first = "" if linear is None else f"{row.factor * linear:.4g}"
            cells = (
                NO_HIT
                if row.of_hits and _unhit(sizing.evidence[name])
                else with_interval(estimate, row.factor)
                for name, estimate in zip(kept, found, strict=True)
            )
            rows.append([row.words, first, *cells])
    return Grid(
        caption="Response without and with stops, one column for each clearance",
        headings=["", "no stops (linear)", *(NAMES[name] for name in kept)],
        rows=rows,
    )


def _found(answer: Response, quantity: str) -> Estimate | None:
    """An estimate of the mass, or of its one impact pair."""
    for (_, name), estimate in answer.estimates().items():
        if name == quantity:
            return estimate
    return None


def _no_hit(sizing: Sizing, name: str, clearance: float) -> str:
    chance = _probability_at(sizing, clearance)
    if name == "three_sigma":
        chance = sizing.three_sigma.probability.value
    return UNKNOWN if chance is None else percent(1.0 - chance)


def _speed_grid(scene: Scene, speeds: np.ndarray) -> Grid:
    """Percentiles of impact speed and, of stops that give way, what a free mass then feels."""
    system = scene.system()
    laws = [law for law in (system.law_lower, system.law_upper) if law is not None]
    soft = [law for law in laws if not isinstance(law, Restitution)]
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
    caption = f"Impacts with stops at 3 sigma, {len(speeds)} of them"
    if soft:
        caption += "; peaks are those of a free mass that arrives at that speed, the harder stop"
    return Grid(caption=caption, headings=headings, rows=rows)


# Sensitivity, verification, limits --------------------------------------------------------


def _sensitivity(sizing: Sizing) -> pd.DataFrame | None:
    if sizing.screening is None:
        return None
    return sensitivity(sizing.scene, sizing.clearance.value)


def _sensitivity_section(table: pd.DataFrame | None) -> Section:
    title = "Sensitivity"
    if table is None:
        return Section(title=title)
    rows = [
        [
            str(row["changed"]),
            f"{MM * row['displacement_std']:.4g}",
            f"{MM * row['clearance']:.4g}",
            f"{100.0 * row['clearance_change']:+.3g}",
        ]
        for row in table.to_dict("records")
    ]
    grid = Grid(
        caption="One thing changed at a time, the rest as stated",
        headings=["changed", "linear rms (mm)", "clearance of equal Rice rate (mm)", "change (%)"],
        rows=rows,
    )
    return Section(
        title=title,
        lead="How the clearance moves if mount and environment are not as stated: by linear "
        "theory, at the Rice rate that the recommended clearance has now.",
        grids=[grid],
        pictures=[
            shown(plot_sensitivity(table), "Change of the clearance of equal Rice rate, per cent.")
        ],
    )


def _verification(sizing: Sizing) -> Section:
    facts = [Fact("Method", sizing.method)]
    for name, answer in sizing.evidence.items():
        cost = answer.cost
        facts.append(
            Fact(
                f"Simulation at {NAMES.get(name, name)}",
                f"{cost.paths} paths",
                f"{count_of(float(cost.impacts))} impacts in {count_of(float(cost.steps))} steps, "
                f"{cost.wall_time:.3g} s; {_how(answer)}",
            )
        )
        for identity, residual in answer.identities.items():
            facts.append(
                Fact(
                    f"Balance of {identity}, {NAMES.get(name, name)}",
                    with_interval(residual, 1.0),
                    f"0 for a right answer, SI units; bias of the step {residual.bias:.1g}"
                    if residual.bias is not None
                    else "0 for a right answer, SI units",
                )
            )
    facts.append(
        Fact(
            "Calculation",
            f"{sizing.cost.wall_time:.3g} s",
            f"{sizing.cost.paths} paths in all, threads: {sizing.cost.threads}; the same seed "
            "gives the same digits",
        )
    )
    return Section(title="Verification", facts=facts)


def _how(answer: Response) -> str:
    return "; ".join(text for text in answer.assumptions if "step" in text)


def _limits(sizing: Sizing) -> Section:
    own = list(sizing.scene.assumptions())
    for answer in sizing.evidence.values():
        own += [text for text in [*answer.assumptions, *answer.warnings] if text not in own]
    return Section(
        title="Limits",
        lead="What this report takes for granted, and does not say.",
        notes=[
            *(text[0].upper() + text[1:] for text in own),
            "One direction of motion; no rocking, and no coupling of directions.",
            "A linear spring and a viscous damper: an elastomer is stiffer at small amplitudes, "
            "and softer when warm.",
            "Stationary Gaussian shaking for the whole mission; single shocks, and resonances of "
            "what carries the mount, are not in it.",
            "The base does not feel the mass.",
        ],
    )


def _footer(sizing: Sizing) -> list[str]:
    made = sizing.provenance
    libraries = made.get("libraries") or {}
    versions = ", ".join(f"{name} {version}" for name, version in libraries.items())
    lines = [
        f"stochvi {made.get('version', '')}, seed {_seed(sizing)}{', ' * bool(versions)}{versions}"
    ]
    lines.append(
        "Tables in SI units lie beside this page as CSV; size.json holds all numbers and the scene."
    )
    return lines
