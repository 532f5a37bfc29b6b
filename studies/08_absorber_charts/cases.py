"""The cells of the charts: a structure of 1 kg at 1 rad/s and what is loose in it."""

import math
import time
from collections.abc import Iterator

import pandas as pd
from scipy.optimize import minimize

import stochvi as sv

BASIC = {
    "mass_ratio": 0.05, "play_in_sigma": 3.0, "restitution": 0.5, "zeta": 0.01, "noise": "white",
    "units": 1, "frequency_ratio": 1.0,
}  # fmt: skip
"""The design point; every family varies one of these and the play."""

PLAYS = (0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 9.0, 12.0)
FAMILIES = {
    "mass_ratio": (0.005, 0.01, 0.02, 0.05, 0.1, 0.2),
    "restitution": (0.0, 0.2, 0.5, 0.75, 0.9, 1.0),
    "zeta": (0.005, 0.02, 0.05),
    "noise": ("narrow",),
    "units": (2, 4, 8),
}
TABLE = {
    (0.02, 0.5): (0.92, 0.81, 0.78, 0.70, 0.675, 0.727),
    (0.05, 0.5): (0.75, 0.64, 0.55, 0.54, 0.572, 0.68),
    (0.1, 0.2): (0.52, 0.42, 0.46, 0.52, 0.630, 0.73),
    (0.1, 0.5): (0.61, 0.47, 0.44, 0.45, 0.541, 0.66),
    (0.1, 0.75): (0.81, 0.68, 0.56, 0.51, 0.529, 0.62),
}
"""rms ratios of another program, by mass ratio and restitution, at the plays below."""

TABLE_PLAYS = {1.0: 0.05, 2.0: 0.05, 3.0: 0.05, 4.0: 0.05, 6.0: 0.01, 9.0: 0.01}
"""Plays of that table, and the standard errors that it states."""

TIGHTEST = {8: 2.0}
"""Least play of so many units: in tighter boxes a cell costs minutes."""

DETUNED = (0.9, 0.95, 1.0, 1.05, 1.1)
"""Frequencies of the structure, relative to those that its absorbers were chosen for."""

PATHS = 32
TIME_CONSTANTS = 400.0
"""Length of a path in time constants 1 / (2 zeta omega) of the energy of the structure alone:
the fixed budget of a cell, whatever error it leaves."""

NARROW = 0.05
"""Damping ratio of the resonance through which narrow-band noise comes, at 1 rad/s."""


def grid() -> list[dict]:
    """Every cell once, the design point's neighbours first."""
    cells = [
        BASIC | {"mass_ratio": mass, "restitution": restitution, "play_in_sigma": play}
        for mass, restitution in TABLE for play in PLAYS
    ]  # fmt: skip
    for name, values in FAMILIES.items():
        families = [(value, play) for value in values for play in PLAYS]
        cells += [BASIC | {name: value, "play_in_sigma": play} for value, play in families]
    cells += [
        BASIC | {"mass_ratio": mass, "frequency_ratio": ratio, "play_in_sigma": 3.0}
        for mass in (0.02, 0.05, 0.1) for ratio in DETUNED
    ]  # fmt: skip
    cells = [c for c in cells if c["play_in_sigma"] >= TIGHTEST.get(c["units"], 0.0)]
    return list({tuple(cell.values()): cell for cell in cells}.values())


def structure(zeta: float, noise: str, frequency_ratio: float = 1.0) -> sv.Scene:
    """The structure alone, with the damper of 1 rad/s at any frequency."""
    kind = sv.Isolator if noise == "base" else sv.Oscillator
    oscillator = kind(mass=1.0, damping=2.0 * zeta, stiffness=frequency_ratio**2)
    if noise == "narrow":
        shaking = sv.FilteredNoise(
            on="x", intensity=1.0, frequency_hz=1.0 / (2.0 * math.pi), zeta=NARROW
        )
    else:
        shaking = sv.WhiteNoise(on="base" if noise == "base" else "x", intensity=1.0)
    return sv.Scene(structure=oscillator, excitations=[shaking])


def rms(scene: sv.Scene) -> float:
    """Of the first coordinate, without stops: exact."""
    first = scene.structure.coordinates[0]
    return sv.linearise(scene).coordinates[first]["displacement_std"].value


def boxed(cell: dict) -> sv.Scene:
    """The structure of a cell with its absorber."""
    alone = structure(cell["zeta"], cell["noise"], cell["frequency_ratio"])
    sigma = rms(structure(cell["zeta"], cell["noise"]))
    loose = sv.Absorber(
        mass=cell["mass_ratio"], play=cell["play_in_sigma"] * sigma, units=cell["units"],
        law=sv.Restitution(coefficient=cell["restitution"]),
    )  # fmt: skip
    return sv.Scene(structure=alone.structure, excitations=alone.excitations, absorber=loose)


def simulated(cell: dict, paths: int = PATHS) -> tuple[sv.Response, float]:
    """The response of a cell within its fixed budget, and the CPU time that it took, s."""
    duration = TIME_CONSTANTS / (2.0 * cell["zeta"])
    started = time.process_time()
    found = sv.simulate(boxed(cell), paths=paths, duration=duration, threads=1, budget=None)
    return found, time.process_time() - started


def row(cell: dict, paths: int = PATHS) -> dict:
    """The cell with its rms ratio; at R = 1 under white noise that is 1, exactly."""
    if cell["restitution"] == 1.0 and cell["noise"] == "white":
        return cell | {"rms_ratio": 1.0, "standard_error": 0.0, "bias": 0.0, "cpu_seconds": 0.0}
    response, seconds = simulated(cell, paths)
    deviation = response.coordinates["structure"]["displacement_std"]
    alone = rms(structure(cell["zeta"], cell["noise"], cell["frequency_ratio"]))
    return cell | {
        "rms_ratio": round(deviation.value / alone, 5),
        "standard_error": round(deviation.standard_error / alone, 5),
        "bias": round(deviation.bias / alone, 5),
        "cpu_seconds": round(seconds, 2),
    }


def missing(cells: list[dict], done: list[dict]) -> Iterator[dict]:
    """Cells that are not among the rows that a run left."""
    known = {tuple(str(old[name]) for name in BASIC) for old in done}
    for cell in cells:
        if tuple(str(cell[name]) for name in BASIC) not in known:
            yield cell


def against_table(charts: pd.DataFrame) -> pd.DataFrame:
    """How far each cell of the table lies from ours, in the standard errors of both."""
    rows = []
    for (mass, restitution), ratios in TABLE.items():
        for (play, error), other in zip(TABLE_PLAYS.items(), ratios, strict=True):
            own = select(charts, mass_ratio=mass, restitution=restitution, play_in_sigma=play)
            if len(own):
                both = math.hypot(error, own["standard_error"].iloc[0], own["bias"].iloc[0])
                rows.append(
                    {"mass_ratio": mass, "restitution": restitution, "play_in_sigma": play,
                     "table": other, "ours": own["rms_ratio"].iloc[0],
                     "z": (own["rms_ratio"].iloc[0] - other) / both}
                )  # fmt: skip
    return pd.DataFrame(rows)


def select(charts: pd.DataFrame, **values: object) -> pd.DataFrame:
    """Rows of the design point but for `values`; None leaves a column free."""
    for name, value in (BASIC | {"play_in_sigma": None} | values).items():
        if value is not None:
            charts = charts[charts[name] == value]
    return charts


def no_help(paths: int = PATHS) -> pd.DataFrame:
    """rms ratio of boxes that lose nothing, by every method: exact, linearised, simulated."""
    rows = []
    for mass, play in ((0.02, 1.0), (0.05, 3.0), (0.1, 6.0)):
        cell = BASIC | {"mass_ratio": mass, "play_in_sigma": play, "restitution": 1.0}
        alone = rms(structure(cell["zeta"], "white"))
        answers = {
            "exact": sv.exact(boxed(cell)), "linearise": sv.linearise(boxed(cell)),
            "simulate": simulated(cell, paths)[0],
        }  # fmt: skip
        row = {"mass_ratio": mass, "play_in_sigma": play}
        for name, answer in answers.items():
            found = answer.coordinates["structure"]["displacement_std"]
            row[name] = round(found.value / alone, 5)
        rows.append(row | {"standard_error": round(found.standard_error / alone, 5)})
    return pd.DataFrame(rows)


def damper(mass: float, tuning: tuple[float, float], frequency_ratio: float = 1.0) -> float:
    """rms ratio of a tuned mass damper (frequency, damping ratio) on the structure: exact."""
    alone = structure(BASIC["zeta"], "white", frequency_ratio)
    spring, link = mass * tuning[0] ** 2, 2.0 * tuning[1] * mass * tuning[0]
    (own, held) = (alone.structure.damping, alone.structure.stiffness)
    tuned = sv.Matrices(
        coordinates=["structure", "damper"],
        mass=[[1.0, 0.0], [0.0, mass]],
        damping=[[own + link, -link], [-link, link]],
        stiffness=[[held + spring, -spring], [-spring, spring]],
    )
    noise = sv.WhiteNoise(on="structure", intensity=1.0)
    return rms(sv.Scene(structure=tuned, excitations=[noise])) / rms(alone)


def tunings(mass: float) -> dict[str, tuple[float, float]]:
    """Den Hartog's for a sine, and the one of least rms under white noise, found by search."""
    den_hartog = (1.0 / (1.0 + mass), math.sqrt(3.0 * mass / (8.0 * (1.0 + mass) ** 3)))
    best = minimize(lambda tuning: damper(mass, tuning), den_hartog, method="Nelder-Mead").x
    return {"den_hartog": den_hartog, "white_noise": tuple(best.tolist())}


def dampers() -> pd.DataFrame:
    """Tuned mass dampers of each mass at each frequency of the structure."""
    return pd.DataFrame(
        [
            {"mass_ratio": mass, "tuning": name, "frequency_ratio": ratio,
             "rms_ratio": round(damper(mass, tuning, ratio), 5)}
            for mass in FAMILIES["mass_ratio"] for name, tuning in tunings(mass).items()
            for ratio in (0.9, 0.925, 0.95, 0.975, 1.0, 1.025, 1.05, 1.075, 1.1)
        ]
    )  # fmt: skip
