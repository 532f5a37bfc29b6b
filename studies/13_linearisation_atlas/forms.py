"""Every form of linearisation on the rows of a table of truths, and whether its bounds hold."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
from truth import PLACE, scene_of

import stochvi as sv

FAR = -10.0
"""Deviations from rest to a stop that nothing reaches, for a form that needs two."""


def boxed(scene: sv.Scene) -> sv.Response:
    """The variant "box"; a single stop is seen as two, of which one is never reached."""
    (pair,) = scene.impact_pairs
    if pair.lower is None:
        elastic = sv.Restitution(coefficient=1.0)
        pair = sv.ImpactPair(lower=FAR, upper=pair.upper, law=pair.law, lower_law=elastic)
    return sv.linearise(scene.model_copy(update={"impact_pairs": (pair,)}), variant="box")


FORMS = {
    "closure": lambda scene: sv.linearise(scene),
    "closure-box": boxed,
    "motion": lambda scene: sv.linearise(scene, "motion"),
    "motion-book": lambda scene: sv.linearise(scene, "motion", "book"),
    "force": lambda scene: sv.linearise(scene, "force"),
    "force-book": lambda scene: sv.linearise(scene, "force", "book"),
}
ENERGY = {
    "clumps": lambda scene: sv.linearise(scene, "clumps"),
    "average": lambda scene: sv.average(scene),
}
QUANTITIES = ("mean", "sigma_x", "sigma_v", "upcrossing", "rate", "f1", "f2")
NAMES = ("displacement_mean", "displacement_std", "velocity_std", "upcrossing_rate",
         "collision_rate", "impact_speed_rate", "impact_speed_square_rate")  # fmt: skip


def truths(row: pd.Series) -> dict[str, float]:
    """A row of truths, both stops together; a rate without a limit is nan."""
    both = {name: row[f"{name}_lower"] + row[f"{name}_upper"] for name in ("rate", "f1", "f2")}
    return {name: row[name] for name in QUANTITIES[:4]} | both


def answers(response: sv.Response) -> dict[str, sv.Estimate | None]:
    """The same quantities of a response."""
    found = {name: estimate for (_, name), estimate in response.estimates().items()}
    return {short: found.get(name) for short, name in zip(QUANTITIES, NAMES, strict=True)}


def error(name: str, value: float, true: dict[str, float]) -> float:
    """ln(answer / truth); of the mean the difference in deviations. nan where there is none."""
    if name == "mean":
        return (value - true["mean"]) / true["sigma_x"]
    if not (value > 0.0 and true[name] > 0.0):
        return math.nan
    return math.log(value / true[name])


def write_atlas(truth: Path, folder: Path, forms: dict) -> None:
    """One file of errors for each form."""
    table = pd.read_csv(truth)
    places = [tuple(row) for row in table[list(PLACE)].to_numpy().tolist()]
    for form, solve in forms.items():
        rows = []
        for place, (_, row) in zip(places, table.iterrows(), strict=True):
            true, two = truths(row), math.isfinite(place[0])
            try:
                found = answers(solve(scene_of(place)))
            except (sv.StochviError, ArithmeticError, ValueError) as reason:
                print(f"{form} has no answer at {place}: {reason}", flush=True)
                found = dict.fromkeys(QUANTITIES)
            errors = {n: error(n, e.value, true) if e else math.nan for n, e in found.items()}
            if two:
                errors["mean"] = 0.0
            cells = [_cell(errors[name]) for name in QUANTITIES]
            rows.append(["two" if two else "one", place[1], place[3], place[4], *cells])
        columns = ["stops", "gap", "restitution", "zeta", *QUANTITIES]
        pd.DataFrame(rows, columns=columns).to_csv(folder / f"{form}.csv", index=False)


def _cell(number: float) -> str:
    if math.isnan(number):
        return ""
    return "0" if abs(number) < 1e-9 else f"{number:.4g}"


def coverage(truth: Path, forms: dict, every: int = 1) -> pd.DataFrame:
    """By form and quantity: bounds given, how many hold, and how much wider than the error."""
    table = pd.read_csv(truth).iloc[::every]
    rows = []
    for _, row in table.iterrows():
        true, scene = truths(row), scene_of(tuple(row[list(PLACE)].tolist()))
        for form, solve in forms.items():
            for name, found in answers(solve(scene)).items():
                if found is None or found.bias is None or math.isnan(true[name]):
                    continue
                off = abs(found.value - true[name])
                rows.append([form, name, off <= found.bias, found.bias / max(off, 1e-9)])
    found = pd.DataFrame(rows, columns=["form", "quantity", "holds", "wider"])
    found = found.groupby(["form", "quantity"], sort=False)
    counted = found.agg(bounds=("holds", "size"), hold=("holds", "mean"), wider=("wider", "median"))
    counted["scenes"] = len(table)
    return counted.reset_index()


def summary(folder: Path, names: list[str]) -> pd.DataFrame:
    """Median and largest relative error of each form in the range that is asked for."""
    rows = []
    for form in names:
        d = pd.read_csv(folder / f"{form}.csv")
        d = d[(d.stops == "two") & (d.zeta >= 0.05) & d.gap.between(0.45, 1.0)]
        d = d[d.restitution >= 0.2]
        for name in ("sigma_x", "sigma_v", "rate", "f1", "f2"):
            off = np.abs(np.expm1(d[name].dropna()))
            if len(off):
                rows.append([form, name, off.median(), off.max()])
    return pd.DataFrame(rows, columns=["form", "quantity", "median", "largest"])
