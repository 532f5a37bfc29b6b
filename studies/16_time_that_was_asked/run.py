"""Every command with a budget on seven scenes: when it ends, and what it leaves behind."""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from cases import Case, cases, last_compiled, scenes, vary

from stochvi.cli import main
from stochvi.views.files import write_picture

SHARE, SECONDS = 1.2, 2.0
"""A command ends within SHARE budgets and SECONDS."""

CTRL_C = 4.0
"""Seconds after which Ctrl-C comes."""

LONG, LONG_SCENE = 5.0, "truck, rubber stops"
"""Budgets above LONG seconds are tried on one scene alone."""

TABLE = "<!-- result.csv by command -->"
"""What stands before and after the table in the README."""

LONGEST = 400.0
"""Seconds after which a command is ended by force."""


def limit_of(case: Case, budget: float) -> float | None:
    """Seconds in which a command should end; None where it has no limit."""
    return SHARE * budget + SECONDS if case.budgeted else None


def command_of(case: Case, scene: Path, budget: float, out: Path, ctrl_c: bool) -> list[str]:
    """The words of the command line."""
    clock = [str(Path(__file__).with_name("on_cpu_clock.py")), str(CTRL_C if ctrl_c else 0.0)]
    words = [sys.executable, *(clock if options.cpu_clock else ["-m", "stochvi"])]
    words += [case.command, str(scene), *case.arguments]
    threaded = any(option.name == "threads" for option in main.commands[case.command].params)
    words += ["--threads", "1"] if options.cpu_clock and threaded else []
    words += ["--vary", vary(scene)] if case.command == "sweep" else []
    # the budget of a sweep is that of each row
    share = budget / 2.0 if case.command == "sweep" else budget
    words += ["--budget", str(share)] if case.budgeted else []
    return words + (["--json", "-"] if case.command == "explain" else ["--out", str(out)])


def measured(case: Case, name: str, scene: Path, budget: float, ctrl_c: bool) -> dict[str, object]:
    """One command with compiled kernels: it is run again where it had to compile some."""
    before, first = last_compiled(), run_once(case, name, scene, budget, ctrl_c)
    if last_compiled() == before:
        return first
    return run_once(case, name, scene, budget, ctrl_c) | {"wall_with_compiling": first["wall"]}


def run_once(case: Case, name: str, scene: Path, budget: float, ctrl_c: bool) -> dict[str, object]:
    """One command, its wall and CPU time, its exit code and its files."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        asked = LONGEST if ctrl_c else budget
        began = time.perf_counter()
        process = subprocess.Popen(
            command_of(case, scene, asked, out, ctrl_c),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        timers = [threading.Timer(LONGEST, process.kill)]
        if ctrl_c and not options.cpu_clock:
            timers.append(threading.Timer(CTRL_C, process.send_signal, [signal.SIGINT]))
        for timer in timers:
            timer.start()
        assert process.stderr is not None
        told = process.stderr.read().decode().splitlines()
        _, status, used = os.wait4(process.pid, 0)
        for timer in timers:
            timer.cancel()
        wall = time.perf_counter() - began
        files = sorted(file.name for file in out.rglob("*") if file.is_file())
    cpu = used.ru_utime + used.ru_stime
    wall = cpu if options.cpu_clock else wall
    limit = CTRL_C + SECONDS if ctrl_c else limit_of(case, budget)
    due = CTRL_C if ctrl_c else budget if case.budgeted else limit or 0.0
    code = os.waitstatus_to_exitcode(status)
    return {
        "command": case.command, "question": case.question, "scene": name,
        "ended_by": "Ctrl-C" if ctrl_c else "budget", "budget": budget if case.budgeted else None,
        "wall": round(wall, 2), "cpu": round(cpu, 2), "limit": limit,
        "overrun": None if limit is None else round(wall - due, 2),
        "in_time": None if limit is None else wall <= limit,
        "wall_with_compiling": None, "exit_code": code, "files": " ".join(files),
        "says": told[-1] if told else "",
    }  # fmt: skip


def by_command(judged: pd.DataFrame) -> str:
    """Runs, late ones and the largest time beyond the budget by command, as a table of a page."""
    lines = ["| command | runs | late | longest after the budget (s) | after Ctrl-C (s) |"]
    lines.append("|---|---|---|---|---|")
    for command, group in judged.groupby("command", sort=False):
        longest = group.groupby("ended_by")["overrun"].max()
        late = int((~group["in_time"].astype(bool)).sum())
        after = " | ".join(f"{longest.get(how, float('nan')):.1f}" for how in ("budget", "Ctrl-C"))
        lines.append(f"| `{command}` | {len(group)} | {late} | {after} |".replace("nan", "-"))
    return "\n".join(lines)


def write_into(page: Path, table: str) -> None:
    """Put the table in its place on a page that has one."""
    before, _, after = page.read_text("utf-8").split(TABLE)
    page.write_text(f"{before}{TABLE}\n{table}\n{TABLE}{after}", "utf-8")


SHOWN = (
    "command", "question", "scene", "ended_by", "budget", "wall", "cpu", "in_time", "exit_code",
    "says",
)  # fmt: skip
"""Columns that are printed."""

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--quick", action="store_true", help="two scenes, a budget of 2 s")
parser.add_argument("--cpu-clock", action="store_true", help="where others use the machine")
parser.add_argument("--only", default="", help="commands, with commas")
parser.add_argument("--scenes", default="", help="scenes, with semicolons")
parser.add_argument("--budgets", default="2" if "--quick" in sys.argv else "2,5,20")
parser.add_argument("--ended-by", default="budget,Ctrl-C", help="budget, Ctrl-C or both")
parser.add_argument("--out", type=Path, default=Path(__file__).parent)
options = parser.parse_args()
budgets = [float(each) for each in options.budgets.split(",")]
wanted = {name: file for name, file in scenes().items() if name in (options.scenes or name)}
if options.quick:
    wanted = dict(list(wanted.items())[:2])
# a shell that starts this in the background lets Ctrl-C be ignored, by its children too
signal.signal(signal.SIGINT, signal.default_int_handler)
rows = []
for case in cases():
    if case.command not in (options.only or case.command).split(","):
        continue
    for name, scene in wanted.items():
        refused = False
        runs = [(False, each) for each in budgets if "budget" in options.ended_by]
        for ctrl_c, budget in runs + [(True, budgets[0])] * ("Ctrl-C" in options.ended_by):
            if refused or (not case.budgeted and (ctrl_c or budget > budgets[0])):
                continue
            if budget > LONG and name != LONG_SCENE:
                continue
            rows.append(measured(case, name, scene, budget, ctrl_c))
            refused = rows[-1]["exit_code"] == 2
            print(*(rows[-1][key] for key in SHOWN), sep=" | ", flush=True)
            pd.DataFrame(rows).to_csv(options.out / "result.csv", index=False)
table = pd.DataFrame(rows)
judged = table[(table["exit_code"] != 2) & table["limit"].notna()]
late = judged[~judged["in_time"].astype(bool)]
print(f"{len(judged)} runs with a limit, {len(late)} of them late")
if options.out == Path(__file__).parent:
    write_into(options.out / "README.md", by_command(judged))
commands = list(dict.fromkeys(judged["command"]))[::-1]
figure, ax = plt.subplots(figsize=(7.2, 0.3 * len(commands) + 1.4), layout="constrained")
for how, (marker, colour, up) in {
    "budget": ("o", "#2a6f97", 0.12), "Ctrl-C": ("x", "#c1440e", -0.12),
}.items():  # fmt: skip
    shown = judged[judged["ended_by"] == how]
    places = [commands.index(command) + up for command in shown["command"]]
    ax.plot(shown["wall"] - shown["limit"], places, marker, color=colour, markersize=4, label=how)
ax.axvline(0.0, color="#1b1b1b", linewidth=1.0)
clock = "CPU" if options.cpu_clock else "wall"
ax.set_xlabel(f"{clock} time beyond the limit (s); left of the line a run ended in time")
ax.set_yticks(range(len(commands)), commands)
figure.legend(title="ended by", frameon=False, fontsize="small", ncols=2, loc="outside upper right")
write_picture(ax, options.out / "figure.png")
