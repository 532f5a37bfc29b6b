"""CPU time of every job that users wait for, what its imports cost alone, and an older revision."""

import argparse
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from datetime import date
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from jobs import QUICK, Engine, Job, engines, jobs

from stochvi.views.files import write_picture

FOLDER = Path(__file__).parent

HOUSE = FOLDER.parents[1]
"""The checkout that this study belongs to."""

HISTORY = HOUSE / "data" / "bench" / "history.csv"
"""A row for each job and run, so that a release can be compared with those before it."""

PLACE = "<!-- result.csv -->"
"""What stands before and after the table on the page of the study."""

ANSWERED = (0, 1)
"""Exit codes of a program that has given an answer, 1 for one that is not as accurate as asked."""

PATHS = 1024
"""Number of paths of the runs that time a step."""

FLOORS = {
    "python alone": "pass",
    "import numpy": "import numpy",
    "import numpy, scipy.special, numba": "import numpy, scipy.special, numba",
    "... and call one compiled kernel": "import one_kernel",
}
"""What a first answer cannot do without, as programs of their own."""


def run(words: list[str], house: Path, cache: Path | None = None) -> tuple[float, float, str]:
    """CPU and wall time in s of a process that uses the checkout `house`, and what it printed."""
    environment = os.environ | {"PYTHONPATH": str(house)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    with tempfile.TemporaryFile("w+") as printed:
        began = os.times()
        process = subprocess.Popen(
            [sys.executable, *words], cwd=house, env=environment, stdout=printed,
            stderr=subprocess.DEVNULL,
        )  # fmt: skip
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in ANSWERED:
            raise SystemExit(f"{' '.join(words)} ended with {process.returncode}")
        wall = os.times().elapsed - began.elapsed
        printed.seek(0)
        return used.ru_utime + used.ru_stime, wall, printed.read()


def time_of_job(job: Job, house: Path) -> tuple[float, float]:
    """CPU and wall time of a command, s."""
    fresh = nullcontext() if job.compiled else tempfile.TemporaryDirectory()
    with fresh as cache:
        cpu, wall, _ = run(["-m", "stochvi", *job.words], house, Path(cache) if cache else None)
    return cpu, wall


def time_of_step(engine: Engine, house: Path) -> tuple[float, float]:
    """CPU ns per second of scene time and per step: what a run thrice as long takes more."""
    words = [str(FOLDER / "step_time.py"), str(engine.scene), str(PATHS), str(engine.duration)]
    of_scene, of_step = run(words, house)[2].split()
    return float(of_scene), float(of_step)


@contextmanager
def checkout_of(revision: str) -> Iterator[Path]:
    """A checkout of an older revision beside this one, removed afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "before"
        git = ["git", "-C", str(HOUSE), "worktree"]
        subprocess.run([*git, "add", "--detach", str(place), revision], check=True)
        try:
            found = run(["-c", "import stochvi; print(stochvi.__file__)"], place)[2]
            if not Path(found).is_relative_to(place):
                raise SystemExit(f"the code in {found} would be timed, not that of {revision}")
            yield place
        finally:
            subprocess.run([*git, "remove", "--force", str(place)], check=True)


def best(function, case, houses: dict[str, Path], repeats: int) -> dict[str, tuple[float, float]]:
    """The least times of a case in every checkout, taken in turns after one that compiles."""
    for house in houses.values():
        function(case, house)
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in houses}
    for _ in range(repeats):
        for name, house in houses.items():
            times[name].append(function(case, house))
    return {
        name: (min(a for a, _ in each), min(b for _, b in each)) for name, each in times.items()
    }


def measure(houses: dict[str, Path], repeats: int, quick: bool) -> pd.DataFrame:
    """A row for each job and checkout."""
    rows = []

    def add(group: str, name: str, unit: str, found: dict[str, tuple[float, float]]) -> None:
        for house, (value, second) in found.items():
            rows.append((group, name, house, value, second, unit))
            print(*rows[-1], sep=" | ", flush=True)

    def program(code: str, house: Path) -> tuple[float, float]:
        return run(["-c", f"import sys; sys.path.insert(0, {str(FOLDER)!r}); {code}"], house)[:2]

    for name, code in FLOORS.items():
        add("floor", name, "s of CPU; s", best(program, code, {"now": houses["now"]}, repeats))
    for job in jobs():
        if not quick or job.name in QUICK:
            add("job", job.name, "s of CPU; s", best(time_of_job, job, houses, repeats))
    for engine in engines():
        if not quick or engine.name in QUICK:
            found = best(time_of_step, engine, houses, repeats)
            add("engine", engine.name, "ns per second of scene; ns per step", found)
    columns = ["group", "name", "revision", "cpu", "second", "unit"]
    return pd.DataFrame(rows, columns=columns)


def as_page(table: pd.DataFrame) -> str:
    """The rows as a table of a page, with a ratio where an older revision was timed."""
    before = table[table["revision"] == "before"].set_index("name")["cpu"]
    lines = ["| job | CPU | older revision, ratio |", "|---|---|---|"]
    for row in table[table["revision"] == "now"].itertuples():
        ratio = f"{before[row.name] / row.cpu:.2f}" if row.name in before else ""
        unit = row.unit.split(";")[0].removesuffix(" of CPU")
        lines.append(f"| {row.name} | {row.cpu:.3g} {unit} | {ratio} |")
    return "\n".join(lines)


def write_into(page: Path, table: str) -> None:
    """Put the table in its place on a page that has one."""
    before, _, after = page.read_text("utf-8").split(PLACE)
    page.write_text(f"{before}{PLACE}\n{table}\n{PLACE}{after}", "utf-8")


def processor() -> str:
    """Name of the processor, as the system states it."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def draw(table: pd.DataFrame, path: Path) -> None:
    """Bars of the CPU time of every job, on a logarithmic axis."""
    shown = table[(table["group"] != "engine") & (table["revision"] == "now")][::-1]
    _, ax = plt.subplots(figsize=(7.2, 0.27 * len(shown) + 1.0), layout="constrained")
    colours = shown["group"].map({"floor": "#9a9a9a", "job": "#2a6f97"})
    bars = ax.barh(shown["name"], shown["cpu"], color=colours)
    ax.bar_label(bars, labels=[f"{value:.2g}" for value in shown["cpu"]], padding=3, fontsize=8)
    ax.set(xscale="log", xlabel="CPU time of the whole process (s)")
    ax.margins(y=0.01)
    write_picture(ax, path)


def keep(rows: pd.DataFrame, revision: str) -> None:
    """Add rows to the history, with the day and the commit of their revision."""
    git = ["git", "-C", str(HOUSE), "show", "--no-patch", "--format=%h %cI", revision]
    commit, committed = subprocess.run(
        git, check=True, capture_output=True, text=True
    ).stdout.split()
    rows = rows.assign(revision=commit, committed=committed, processor=processor())
    rows.insert(0, "date", date.today().isoformat())
    known = pd.read_csv(HISTORY)
    pd.concat([known, rows[[*known]]]).to_csv(HISTORY, index=False, float_format="%.6g")


def draw_history(history: pd.DataFrame, path: Path) -> None:
    """The CPU time of the quick jobs over the commits of the history; those that were timed on
    another day than the last are open circles, as absolute times move with the machine."""
    order = history.sort_values("committed")["revision"].unique().tolist()
    _, axes = plt.subplots(
        len(QUICK), sharex=True, figsize=(7.2, 1.7 * len(QUICK) + 0.6), layout="constrained"
    )
    for ax, name in zip(axes, QUICK, strict=True):
        rows = history[history["name"] == name]
        for day, of_day in rows.groupby("date"):
            of_day = of_day.sort_values("committed")
            last = day == history["date"].max()
            ax.plot(
                [order.index(each) for each in of_day["revision"]], of_day["cpu"],
                "o-" if last else "o", color="#2a6f97", fillstyle="full" if last else "none",
            )  # fmt: skip
        ax.set_title(name, loc="left", fontsize=9)
        ax.set_ylabel(rows["unit"].iloc[0].split(";")[0].replace("per second", "per s"))
        ax.set_ylim(0.0, 1.15 * rows["cpu"].max())
    days = history.drop_duplicates("revision").set_index("revision")["committed"].str[:10]
    axes[-1].set_xticks(
        range(len(order)), [f"{each}\n{days[each]}" for each in order], rotation=90, fontsize=7
    )
    write_picture(axes[-1], path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="four jobs, once each")
    parser.add_argument("--against", help="an older revision, timed in turns with this one")
    parser.add_argument("--at", help="a revision in the place of this checkout, for the history")
    parser.add_argument("--repeats", type=int, default=1 if "--quick" in sys.argv else 3)
    parser.add_argument("--history", action="store_true", help="add the rows to data/bench")
    parser.add_argument("--out", type=Path, default=FOLDER)
    options = parser.parse_args()
    with (
        checkout_of(options.at) if options.at else nullcontext(HOUSE) as now,
        checkout_of(options.against) if options.against else nullcontext() as older,
    ):
        houses = {"now": now} | ({"before": older} if older else {})
        result = measure(houses, options.repeats, options.quick)
    result.to_csv(options.out / "result.csv", index=False, float_format="%.6g")
    draw(result, options.out / "figure.png")
    if options.out == FOLDER:
        write_into(FOLDER / "README.md", as_page(result))
    if options.history:
        keep(result[result["revision"] == "now"], options.at or "HEAD")
        draw_history(pd.read_csv(HISTORY), options.out / "history.png")
