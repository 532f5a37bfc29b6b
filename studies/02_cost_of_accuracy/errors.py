"""Error against CPU time of the quantities that are asked for most, for one oscillator and more.

The error is the root of bias^2 + standard error^2, relative to a reference: the exact answer, or a
long run of this engine, which `checks` compares with the others at two steps. The others are one
scheme, so that their bias at a step is taken from all of them together.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from cases import CASES, scene
from controls import ASKED
from systems import System, system_of

import stochvi as sv
from stochvi.scenes.datasets import shipped_scene
from stochvi.views.files import write_picture

TARGET = 0.01
"""Relative error to which the CPU times of the page refer."""

ENGINE = "stochvi"
"""Name of this engine among the methods."""

BURN_IN, COUNTED = 6.0, 60.0
"""Lengths of what is left out and of what counts of a path of the others, in relaxation times."""

FEWEST, RUNG, LONGEST = 64, 4, 1.5
"""Paths of the shortest run of every method, how many times more the next one of this engine has,
and its CPU seconds from which no longer one follows."""

LONGER = 8
"""How many times more paths the reference has than the longest of those runs."""

NAMES = {
    "displacement_std": "std of y", "velocity_std": "std of y'", "collision_rate": "rate",
    "impact_speed_rate": "F1", "impact_speed_square_rate": "F2",
}  # fmt: skip
"""Names on the page: of the gap y of a pair, its rate of impacts and, per second, their speeds and
the squares of these."""

COLOURS = ("#000000", "#0072B2", "#E69F00", "#009E73", "#CC79A7")
"""Colours of the methods (Okabe and Ito), this engine first."""

PLACE = "<!-- errors.csv -->"
"""What stands before and after each of the tables on the page of the study."""

Answer = dict[str, tuple[float, float]]
"""Values and standard errors by quantity."""


@dataclass(frozen=True)
class Question:
    """A scene, the pair that is looked at, the steps that the others take (s) and their paths."""

    name: str
    scene: sv.Scene
    pair: str
    steps: tuple[float, ...]
    paths: int


def questions() -> Iterator[Question]:
    """One oscillator under white noise, a truck isolator and a box of six modes under tables."""
    for restitution in ("1", "0.8"):
        case = scene(*CASES[f"1 sigma, R = {restitution}"])
        yield Question(f"oscillator, R = {restitution}", case, "stops", (0.1, 0.05, 0.032), 4096)
    truck = sv.load_scene(shipped_scene("isolator-truck"))
    yield Question("truck isolator", truck, "stops", (2e-3, 1e-3, 5e-4), 8192)
    yield Question("box of six modes", box(), "corner 2", (1e-3, 5e-4, 2.5e-4), 4096)


def box() -> sv.Scene:
    """The box that ships, at rest in the middle of stops at two standard deviations of each gap."""
    shipped = sv.load_scene(shipped_scene("rigid-box"))
    gaps = {"corner 1": 1.6e-3, "corner 2": 2.4e-3, "side": 0.43e-3}
    pairs = [
        pair.model_copy(update={"lower": -gaps[pair.name], "upper": gaps[pair.name]})
        for pair in shipped.impact_pairs
    ]
    body = shipped.structure.model_copy(update={"gravity": None})
    return shipped.replace(structure=body, impact_pairs=pairs)


def answer_of(response: sv.Response, pair: str) -> Answer:
    """The quantities of a response."""
    known = response.estimates()
    found = {}
    for name in ASKED:
        keys = (pair, name), (pair, f"relative_{name}"), ("x", name)
        estimate = known[next(key for key in keys if key in known)]
        found[name] = estimate.value, estimate.standard_error
    return found


def answer_of_averages(averages: np.ndarray) -> Answer:
    """The quantities from the averages of paths, the rows `ROWS` of `systems`."""
    y, yy, ww, n, f1, f2 = averages
    spread, speed = math.sqrt(yy.mean() - y.mean() ** 2), math.sqrt(ww.mean())
    linear = (yy - 2.0 * y.mean() * y) / (2.0 * spread), ww / (2.0 * speed), n, f1, f2
    values = spread, speed, n.mean(), f1.mean(), f2.mean()
    errors = [part.std(ddof=1) / math.sqrt(len(part)) for part in linear]
    return dict(zip(ASKED, zip(values, errors, strict=True), strict=True))


def of_engine(question: Question, paths: int, seed: int = 1) -> tuple[Answer, float, int]:
    """Answer, CPU seconds and paths, with the paths that measure the bias, and the statistics."""
    began = time.process_time()
    response = sv.simulate(question.scene, paths=paths, seed=seed, threads=1, budget=None)
    return answer_of(response, question.pair), time.process_time() - began, paths


def rungs(question: Question, longest: float) -> list[tuple[Answer, float, int]]:
    """Runs of this engine of growing length."""
    for _ in range(2):
        of_engine(question, FEWEST)  # compiles, or loads what is compiled
    found = [of_engine(question, FEWEST)]
    while len(found) < 2 or found[-1][1] < longest:
        found.append(of_engine(question, RUNG * found[-1][2], seed=len(found) + 1))
    return found


def rows_of(
    question: Question, loops: dict[str, Callable], libraries: dict[str, Callable], size: float
) -> pd.DataFrame:
    """A row for each method, step, length of run and quantity of a scene; the slow libraries are
    spared the shortest step."""
    rows = []

    def add(method: str, step: float | None, paths: int, cpu: float, answer: Answer) -> None:
        for name, (value, error) in answer.items():
            rows.append((question.name, method, step, paths, cpu, name, value, error))

    runs = rungs(question, LONGEST * size)
    for answer, cpu, paths in runs:
        add(ENGINE, None, paths, cpu, answer)
    try:
        reference = answer_of(sv.exact(question.scene), question.pair)
    except sv.NoExactSolution:
        reference = of_engine(question, LONGER * runs[-1][2], seed=len(runs) + 1)[0]
    system = system_of(question.scene, question.pair)
    for method, function in (loops | libraries).items():
        for step in question.steps[:-1] if method in libraries else question.steps:
            for number in (FEWEST, max(2 * FEWEST, math.ceil(question.paths * size))):
                answer, cpu, paths = of_peer(function, system, number, step)
                add(method, step, paths, cpu, answer)
    columns = ["scene", "method", "step", "paths", "cpu", "quantity", "value", "standard_error"]
    table = pd.DataFrame(rows, columns=columns)
    table["reference"] = [reference[name][0] for name in table["quantity"]]
    table["reference_error"] = [reference[name][1] for name in table["quantity"]]
    return table


def of_peer(
    function: Callable, system: System, paths: int, step: float
) -> tuple[Answer, float, int]:
    """Answer, CPU seconds and paths of another method at a step."""
    burn_in, steps = (math.ceil(times * system.relaxation / step) for times in (BURN_IN, COUNTED))
    averages, cpu = function(system, paths, burn_in, steps, step)
    return answer_of_averages(averages), cpu, averages.shape[1]


def with_errors(table: pd.DataFrame) -> pd.DataFrame:
    """The rows with relative differences to the reference, standard errors, biases and errors."""
    table = table.copy()
    for name in ("standard_error", "reference_error"):
        table[name] /= table["reference"]
    table["difference"] = table["value"] / table["reference"] - 1.0
    biases = {key: size_of_bias(rows) for key, rows in table.groupby(["scene", "step", "quantity"])}
    for (name, quantity), rows in table[table["method"] == ENGINE].groupby(["scene", "quantity"]):
        biases[name, None, quantity] = size_of_bias(rows)
    steps = table["step"].astype(object).where(table["step"].notna(), None)
    keys = zip(table["scene"], steps, table["quantity"], strict=True)
    table["bias"] = [biases[key] for key in keys]
    table["error"] = np.hypot(table["bias"], table["standard_error"])
    return table


def pooled(rows: pd.DataFrame) -> tuple[float, float]:
    """Mean difference of independent runs to the reference, and its standard error."""
    weights = rows["standard_error"] ** -2.0
    return float(np.average(rows["difference"], weights=weights)), float(weights.sum() ** -0.5)


def size_of_bias(rows: pd.DataFrame) -> float:
    """Root of the square of the difference less the variances of both, or 0: the bias of runs."""
    difference, error = pooled(rows)
    noise = error**2 + rows["reference_error"].iloc[0] ** 2
    return math.sqrt(max(difference**2 - noise, 0.0))


def checks(table: pd.DataFrame) -> pd.DataFrame:
    """What the others say of the reference: relative difference and standard error of their value
    at the two shortest steps, extrapolated to none as of second order."""
    rows = []
    others = table[table["method"] != ENGINE]
    for (name, quantity), part in others.groupby(["scene", "quantity"], sort=False):
        short, long = sorted(set(part["step"]))[:2]
        weight = 1.0 / ((long / short) ** 2 - 1.0)
        (fine, error), (coarse, other) = (pooled(part[part["step"] == h]) for h in (short, long))
        spread = math.hypot((1.0 + weight) * error, weight * other)
        spread = math.hypot(spread, part["reference_error"].iloc[0])
        rows.append((name, quantity, fine + weight * (fine - coarse), spread))
    return pd.DataFrame(rows, columns=["scene", "quantity", "difference", "standard_error"])


def seconds(rows: pd.DataFrame, target: float) -> tuple[float, str]:
    """CPU seconds until a method has a relative error in a quantity, at its best step, and how they
    are known: between two runs ("between"), by the law 1 / sqrt(time) from the longest run ("law"),
    or no more than that the shortest run is enough ("at most")."""
    return min(seconds_at_step(part, target) for _, part in rows.groupby("step", dropna=False))


def seconds_at_step(rows: pd.DataFrame, target: float) -> tuple[float, str]:
    """The same at one step: between runs of different length CPU time is linear in the paths."""
    paths, cpu, error = rows.sort_values("paths")[["paths", "cpu", "standard_error"]].to_numpy().T
    room = target**2 - rows["bias"].iloc[0] ** 2
    if room <= 0.0:
        return math.inf, "bias"
    enough = np.flatnonzero(error <= math.sqrt(room))
    if len(enough) and enough[0] == 0:
        return float(cpu[0]), "at most"
    if len(enough):
        ends, known = [enough[0], enough[0] - 1], "between"
        needed = np.exp(np.interp(0.5 * math.log(room), np.log(error[ends]), np.log(paths[ends])))
    else:
        ends, known = [-1, 0], "law"
        needed = paths[-1] * error[-1] ** 2 / room
    slope = max(float(np.diff(cpu[ends])[0] / np.diff(paths[ends])[0]), 0.0)
    return float(cpu[ends[0]] + slope * (needed - paths[ends[0]])), known


def times_of(table: pd.DataFrame) -> pd.DataFrame:
    """CPU seconds to the target, and how they are known, at each method's best step."""
    keys = ["scene", "method", "quantity"]
    found = [(*key, *seconds(rows, TARGET)) for key, rows in table.groupby(keys, sort=False)]
    return pd.DataFrame(found, columns=[*keys, "cpu", "known"]).set_index(keys)


def as_page(table: pd.DataFrame) -> str:
    """CPU seconds of this engine to the target, and ratios of the others, as a table of a page."""
    found = times_of(table)
    lines = [f"| {100 * TARGET:g} % in | method | " + " | ".join(NAMES.values()) + " |"]
    lines += ["|---" * (2 + len(NAMES)) + "|"]
    for name, method in dict.fromkeys(zip(table["scene"], table["method"], strict=True)):
        cells = []
        for quantity in NAMES:
            cpu, known = found.loc[(name, method, quantity)]
            sign = {"at most": "< ", "law": "~ "}.get(known, "")
            ratio = cpu / found.loc[(name, ENGINE, quantity), "cpu"]
            if method == ENGINE:
                cells.append(f"{sign}{cpu:.2g} s")
            elif math.isfinite(cpu):
                cells.append(f"{sign}{ratio:.2g}" if ratio < 99.5 else f"{sign}{ratio:.0f}")
            else:
                cells.append("no")
        lines.append(f"| {name} | {method} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def as_checks(table: pd.DataFrame) -> str:
    """The checks of the references, per cent, as a table of a page."""
    lines = ["| scene | " + " | ".join(NAMES.values()) + " |", "|---" * (1 + len(NAMES)) + "|"]
    for name, rows in checks(table).groupby("scene", sort=False):
        found = 100.0 * rows[["difference", "standard_error"]].to_numpy()
        cells = [f"{difference:+.2f}({error:.2f}) %" for difference, error in found]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def write_into(page: Path, table: pd.DataFrame) -> None:
    """Put both tables in their places on the page of the study."""
    before, _, between, _, after = page.read_text("utf-8").split(PLACE)
    found = before, f"\n{as_page(table)}\n", between, f"\n{as_checks(table)}\n", after
    page.write_text(PLACE.join(found), "utf-8")


def draw(table: pd.DataFrame, path: Path) -> None:
    """Error against CPU time: a column of panels for each scene, a row for each quantity."""
    scenes = list(dict.fromkeys(table["scene"]))
    figure, axes = plt.subplots(
        len(ASKED), len(scenes), figsize=(2.7 * len(scenes), 2.1 * len(ASKED)),
        sharex=True, sharey=True, layout="constrained", squeeze=False,
    )  # fmt: skip
    methods = dict(zip(dict.fromkeys(table["method"]), COLOURS, strict=False))
    for (name, quantity), part in table.groupby(["scene", "quantity"], sort=False):
        ax = axes[ASKED.index(quantity), scenes.index(name)]
        for (method, _), rows in part.groupby(["method", "step"], sort=False, dropna=False):
            style = {"color": methods[method], "lw": 1.0, "ms": 4 if method == ENGINE else 3}
            ax.loglog(rows["cpu"], rows["error"], "o-", **style)
        ax.axhline(TARGET, color="#999999", lw=0.7, ls="--")
        ax.grid(which="major", color="#e5e5e5", lw=0.6)
    for number, name in enumerate(scenes):
        axes[0, number].set_title(name, fontsize=10)
    for number, quantity in enumerate(ASKED):
        axes[number, 0].set_ylabel(f"error of the {NAMES[quantity]}")
    axes[0, 0].set(xlim=(1e-3, 60.0), ylim=(3e-4, 0.3))
    handles = [plt.Line2D([], [], color=colour, label=name) for name, colour in methods.items()]
    figure.supxlabel("CPU time (s)", fontsize=10)
    figure.legend(handles=handles, loc="outside upper center", ncol=len(handles), frameon=False)
    write_picture(axes[0, 0], path)


def measure(
    loops: dict[str, Callable], libraries: dict[str, Callable], size: float
) -> pd.DataFrame:
    """The rows of every scene; `size` scales the lengths of all runs."""
    return with_errors(
        pd.concat(
            [rows_of(each, loops, libraries, size) for each in questions()], ignore_index=True
        )
    )
