"""Make the pictures of the manual's pages: `python docs/pictures/make.py [NAME...]`.

Numbers come from the tables of the studies, or are calculated here by the public calls.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from scipy.integrate import solve_ivp

import stochvi
from stochvi.scenes import (
    BoucWen,
    Coulomb,
    Duffing,
    Elastic,
    ForceTable,
    Hertz,
    PolynomialDamper,
    Rayleigh,
    Viscoelastic,
)
from stochvi.scenes.datasets import shipped_scene
from stochvi.views.axes import COLOURS, DRAWING, OWNERS, add_grid
from stochvi.views.density import write_animation
from stochvi.views.files import write_picture
from stochvi.views.schematic import draw_gaps, draw_problem
from stochvi.views.tables import count_of

HERE = Path(__file__).parent
STUDIES = HERE.parents[1] / "studies"

STYLES = ("-", "--", ":")
"""Styles of lines of a picture, so that its curves differ in grey as well."""

MOUNTS = {
    ("mil-std-810h-truck-vertical-5hz", 12.0): "12 Hz on a truck",
    ("mil-std-810h-truck-longitudinal-5hz", 8.0): "8 Hz on a truck, longitudinal",
    ("navmat-p-9492", 40.0): "40 Hz on NAVMAT P-9492",
    ("navmat-p-9492", 20.0): "20 Hz on NAVMAT P-9492, at its edge",
    ("navmat-p-9492", 8.0): "8 Hz on NAVMAT P-9492, below its table",
    ("gevs-acceptance", 8.0): "8 Hz on GEVS, below its table",
}
"""Rows of the picture of three sigma: profile and natural frequency (Hz), and their words."""

ACCEPTED = 0.01
"""Expected impacts in an hour that a probability of 1 % of any impact allows."""


def three_sigma() -> Axes:
    """What a stop at three sigma is hit by in an hour, beside Rice and the usual target."""
    table = pd.read_csv(STUDIES / "07_three_sigma_rule" / "result.csv")
    rows = table.set_index(["profile", "frequency_hz"])
    truck = stochvi.size(stochvi.load_scene(shipped_scene("isolator-truck")), probability=0.01)
    counts = ["hits_by_rice_per_hour", "hits_per_hour", "clearance_in_sigma"]
    # the first row is the scene of the README: of the same sample as its sizing there
    rows.loc[next(iter(MOUNTS)), counts] = [
        truck.three_sigma.rice_hits,
        truck.three_sigma.hits.value,
        truck.clearance.value / truck.sigma,
    ]
    _, ax = plt.subplots(figsize=(7.6, 3.5), layout="constrained")
    for row, mount in enumerate(MOUNTS):
        found = rows.loc[mount]
        rice, true = found["hits_by_rice_per_hour"], found["hits_per_hour"]
        ax.plot([ACCEPTED, true], [row, row], color=DRAWING["line"], linewidth=1.0, zorder=0)
        ax.plot(rice, row, "o", mfc="white", mec=COLOURS["exact"], markersize=12)
        ax.plot(true, row, "o", color=COLOURS["linearise:closure"], markersize=8)
        ax.plot(ACCEPTED, row, "s", color=COLOURS["linearise:force"], markersize=7)
        ax.text(max(rice, true) * 1.9, row, count_of(float(f"{true:.2g}")), va="center",
                fontsize="small", color=DRAWING["length"])  # fmt: skip
        words = f"Rice {count_of(float(f'{rice:.2g}'))}"
        ax.text(min(rice, true) / 1.7, row - 0.1, words, ha="right", va="bottom",
                fontsize="small", color=DRAWING["ink"])  # fmt: skip
        ax.text(ACCEPTED * 1.7, row - 0.1, f"at {found['clearance_in_sigma']:.1f} sigma",
                va="bottom", fontsize="small", color=DRAWING["ink"])  # fmt: skip
    ax.set_xscale("log")
    ax.set_xlim(3e-3, 4e6)
    ax.set_xticks([1e-2, 1.0, 1e2, 1e4, 1e6], ["0.01", "1", "100", "10 000", "1 000 000"])
    ax.minorticks_off()
    ax.set_yticks(range(len(MOUNTS)), MOUNTS.values(), fontsize="small")
    ax.set_ylim(len(MOUNTS) - 0.4, -0.8)
    ax.set_xlabel("impacts in one hour")
    for marker, face, words in (
        ("o", COLOURS["linearise:closure"], "stop at 3 sigma: what happens"),
        ("o", "white", "stop at 3 sigma: Rice"),
        ("s", COLOURS["linearise:force"], "stop sized for a probability of 1 %"),
    ):
        ax.plot([], [], marker, color=face, mec=COLOURS["exact"] if face == "white" else face,
                label=words)  # fmt: skip
    ax.figure.legend(loc="outside upper center", ncols=3, frameon=False, fontsize="small")
    add_grid(ax)
    ax.grid(axis="y", visible=False)
    ax.set_axisbelow(True)
    return ax


def problem() -> Axes:
    """The problem with the names of its lengths."""
    scene = stochvi.load_scene(shipped_scene("isolator-truck"))
    scene = scene.replace(structure=scene.structure.replace(gravity=True))
    return draw_problem(scene, _rests(scene), symbols=True)


def problem_in_numbers() -> Axes:
    """The same drawing with the numbers of a scene."""
    scene = stochvi.load_scene(shipped_scene("isolator-bumper"))
    return draw_problem(scene, _rests(scene))


def box() -> Axes:
    """The shipped box with its mounts and snubbers."""
    return draw_problem(stochvi.load_scene(shipped_scene("rigid-box")), {})


def gaps() -> Axes:
    """The gaps of the shipped box."""
    scene = stochvi.load_scene(shipped_scene("rigid-box"))
    return draw_gaps(scene.impact_pairs, _rests(scene))


KINDS = {
    "one mass, white noise, elastic stops": "oscillator-elastic",
    "one mass, white noise, inelastic stops": "oscillator-lossy",
    "one mass, white noise, rubber stops": "zoo/viscoelastic-stops",
    "isolator, own PSD or standard, rigid stops": "isolator-truck",
    "isolator under gravity, bumpers": "isolator-bumper",
    "isolator on a road, in a vehicle": "isolator-vehicle",
    "isolator, measured record": "isolator-record",
    "box with six degrees of freedom": "rigid-box",
    "several masses and pairs": "zoo/chain-two-pairs",
    "absorber in its cavity": "absorber-on-a-tower",
    "sine, rigid stops": "isolator-sine",
}
"""Rows of the chart of methods: a kind of scene, and the shipped scene that stands for it."""


def methods() -> Axes:
    """Which method covers which kind of scene, by what the methods say of themselves."""
    from stochvi.methods import averaging, closed_form, fokker_planck
    from stochvi.model.model import model_of
    from stochvi.motion.choose_plan import unmet

    def linearised(scene: stochvi.Scene) -> bool:
        try:
            stochvi.linearise(scene)
        except stochvi.StochviError:
            return False
        return True

    def sized(scene: stochvi.Scene) -> bool:
        try:
            stochvi.screen(scene)
        except stochvi.StochviError:
            return False
        return True

    asked: dict[str, Callable[[stochvi.Scene], bool]] = {
        "exact\nclosed form": lambda scene: not closed_form.unmet(model_of(scene)),
        "fokker-planck\n0.1 s": lambda scene: not fokker_planck.unmet(model_of(scene)),
        "average\n0.1 s": lambda scene: not averaging.unmet(model_of(scene)),
        "linearise\n1 ms": linearised,
        "simulate\nseconds": lambda scene: not unmet(model_of(scene)),
        "screen, size\nseconds": sized,
    }
    _, ax = plt.subplots(figsize=(7.6, 0.36 * len(KINDS) + 1.0), layout="constrained")
    for row, name in enumerate(KINDS.values()):
        scene = stochvi.load_scene(shipped_scene(name))
        for column, covers in enumerate(asked.values()):
            filled = covers(scene)
            ax.plot(column, row, "o" if filled else "x", markersize=9 if filled else 5,
                    color=COLOURS["simulate"] if filled else COLOURS["stop"])  # fmt: skip
    ax.set_xticks(range(len(asked)), asked, fontsize="small")
    ax.set_yticks(range(len(KINDS)), KINDS, fontsize="small")
    ax.xaxis.tick_top()
    ax.tick_params(length=0)
    ax.set_xlim(-0.6, len(asked) - 0.4)
    ax.set_ylim(len(KINDS) - 0.5, -0.5)
    for row in range(len(KINDS)):
        ax.axhline(row + 0.5, color=DRAWING["line"], linewidth=0.5)
    for spine in ax.spines.values():
        spine.set_visible(False)
    return ax


def mounts() -> Axes:
    """Forces of springs and dampers that are functions."""
    x, v = np.linspace(-3e-3, 3e-3, 241), np.linspace(-0.3, 0.3, 241)
    _, (spring, rope, damper) = plt.subplots(1, 3, figsize=(7.6, 2.7), layout="constrained")
    curves = {
        "linear": 2e4 * x,
        "duffing": Duffing(linear_stiffness=2e4, cubic_stiffness=4e9).force_at(x),
        "duffing, two wells": Duffing(linear_stiffness=-2e4, cubic_stiffness=8e9).force_at(x),
    }
    for (words, force), style, colour in zip(curves.items(), STYLES, OWNERS, strict=False):
        spring.plot(1e3 * x, force, style, color=colour, label=words)
    for amplitude, style, colour in zip((3e-3, 1e-3, 2e-4), STYLES, OWNERS, strict=False):
        rope.plot(*_loop(BoucWen(stiffness=6e4, yield_displacement=5e-4), amplitude), style,
                  color=colour, label=f"± {1e3 * amplitude:g} mm")  # fmt: skip
    for (words, force), style, colour in zip({
        "linear": 100.0 * v,
        "coulomb": Coulomb(force=20.0).force_at(0.0, v),
        "polynomial": PolynomialDamper(coefficients=[20.0, 400.0]).force_at(0.0, v),
        "rayleigh": Rayleigh(linear_damping=-100.0, cubic_damping=2500.0).force_at(0.0, v),
    }.items(), (*STYLES, "-."), OWNERS, strict=False):  # fmt: skip
        damper.plot(v, force, style, color=colour, label=words)
    for ax, title, label in (
        (spring, "springs", "displacement (mm)"), (rope, "bouc-wen", "displacement (mm)"),
        (damper, "dampers", "velocity (m/s)"),
    ):  # fmt: skip
        ax.set_title(title, fontsize="small")
        ax.set_xlabel(label)
        ax.legend(fontsize="x-small", loc="upper left")
        add_grid(ax)
    rope.set_ylim(-34.0, 66.0)
    spring.set_ylabel("force (N)")
    return damper


def laws() -> Axes:
    """Forces of compliant stops over deflection: while a mass of 1 kg arrives and leaves."""
    stops = {
        "elastic": Elastic(stiffness=1e5),
        "viscoelastic": Viscoelastic(stiffness=1e5, damping_ratio=0.3),
        "hertz": Hertz(coefficient=2.5e6),
        "table": ForceTable(deflection=[0.0, 1e-3, 2e-3, 3e-3], force=[0.0, 50.0, 150.0, 400.0]),
    }
    _, axes = plt.subplots(1, 2, figsize=(7.6, 2.9), layout="constrained")
    for (words, law), style, colour in zip(stops.items(), (*STYLES, "-."), OWNERS, strict=False):
        time = np.linspace(0.0, 0.02, 4001)
        found = solve_ivp(
            lambda _, s, law=law: (s[1], -float(law.force_at(max(s[0], 0.0), s[1]))),
            (0.0, 0.02), (0.0, 0.8), t_eval=time, rtol=1e-8, atol=1e-10,
        )  # fmt: skip
        y = found.y[0]
        force = np.array([float(law.force_at(max(a, 0.0), b)) for a, b in found.y.T])
        ends = np.flatnonzero((y <= 0.0) | (force <= 0.0))[1:]
        last = int(ends[0]) if len(ends) else len(time)
        axes[0].plot(1e3 * y[:last], force[:last], style, color=colour, label=words)
        axes[1].plot(1e3 * time[:last], force[:last], style, color=colour)
    axes[0].set(xlabel="deflection (mm)", ylabel="force (N)")
    axes[1].set(xlabel="time since the first touch (ms)")
    axes[0].legend(fontsize="small")
    for ax in axes:
        add_grid(ax)
    return axes[1]


def restitutions() -> Axes:
    """Restitution over the speed of the impact: laws through the curve that was measured of ice."""
    from stochvi.identification import Rebounds

    speed = np.geomspace(1.5e-4, 5.1e-2, 25)
    measured = np.minimum(0.32 * (100.0 * speed) ** -0.234, 1.0)
    found = stochvi.identify(Rebounds(approach=speed, rebound=speed * measured))
    ax: Axes = plt.subplots(figsize=(6.4, 3.4), layout="constrained")[1]
    ax.plot(speed, measured, color=COLOURS["exact"], linewidth=2.5, label="measured (ice, 1984)")
    for name, style, colour in zip(
        ("constant", "viscoelastic body", "Hunt and Crossley", "yielding body"),
        (*STYLES, "-."), OWNERS, strict=False,
    ):  # fmt: skip
        ax.plot(speed, found.curve[name], style, color=colour, label=name)
    ax.set(xscale="log", xlabel="speed of approach (m/s)", ylabel="restitution", ylim=(0.0, 1.05))
    ax.legend(fontsize="small", loc="lower left")
    add_grid(ax)
    return ax


def _loop(rope: BoucWen, amplitude: float) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (mm) and force (N) of cycles of an amplitude (m), from the first loading on."""
    way = np.linspace(0.0, 1.0, 2001)
    x = amplitude * np.concatenate([way, 1.0 - 2.0 * way, 2.0 * way - 1.0])
    z, memory = 0.0, [0.0]
    for step in np.diff(x) / rope.yield_displacement:
        share = 1.0 - rope.beta + rope.beta * np.sign(z * step)
        z += step * (1.0 - share * abs(z) ** rope.exponent)
        memory.append(z)
    return 1e3 * x, rope.largest_force * np.array(memory)


def _rests(scene: stochvi.Scene) -> dict[str, float]:
    return {name: gap.position for name, gap in stochvi.explain(scene).rest_of_gaps.items()}


def box_hits_its_stops(path: Path) -> None:
    """The box of the README while it hits a stop eight times, the seed chosen for that."""
    scene = stochvi.load_scene(shipped_scene("isolator-truck"))
    found = stochvi.history(scene, duration=10.0, rate=1000.0, seed=8)
    write_animation(found, scene, path, "isolated box on a truck, stops at 4 mm")


@contextmanager
def explored(width: int, height: int) -> Iterator[Any]:
    """The page of `stochvi explore` with the answers of its first turn, in Chromium."""
    import re
    import shutil
    import subprocess

    from playwright.sync_api import sync_playwright

    words = [sys.executable, "-m", "stochvi", "explore", "--no-browser"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        (address,) = re.findall(r"http://\S+", server.stdout.readline())
        with sync_playwright() as play:
            browser = play.chromium.launch(
                executable_path=shutil.which("chromium"), args=["--no-sandbox"]
            )
            size: Any = {"width": width, "height": height}
            page = browser.new_page(locale="en-US", viewport=size)
            page.goto(address)
            page.wait_for_selector("header .state:text-matches('all known')", timeout=300_000)
            yield page
        server.terminate()


def explorer(path: Path) -> None:
    """The page as it begins."""
    with explored(1300, 900) as page:
        page.screenshot(path=path, full_page=True)


def turned_knobs(path: Path) -> None:
    """The page while its natural frequency is turned, beside the design that was pinned first."""
    import io

    from PIL import Image

    steps = [0, 0, *[25] * 8, 0, 0, *[-25] * 8]
    frames = []
    with explored(1100, 640) as page:
        page.click("text=Pin this design")
        page.evaluate("scrollTo(0, 0)")
        for step in steps:
            if step:
                page.evaluate(TURN, step)
                page.wait_for_selector(".stochvi-explore.stale")
            page.wait_for_selector(".stochvi-explore:not(.stale)", timeout=60_000)
            page.wait_for_timeout(200)
            frames.append(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))
    first, *others = [frame.resize((825, 480), Image.Resampling.LANCZOS) for frame in frames]
    first.save(path, save_all=True, append_images=others, duration=400, loop=0, quality=60)


TURN = """step => {
  const knob = document.getElementById("structure.frequency_hz");
  knob.value = Number(knob.value) + step;
  knob.dispatchEvent(new Event("input"));
}"""
"""Turns the natural frequency by thousandths of its range."""


PICTURES: dict[str, Callable[[], Axes]] = {
    "three_sigma": three_sigma,
    "problem": problem,
    "problem_in_numbers": problem_in_numbers,
    "box": box,
    "gaps": gaps,
    "methods": methods,
    "mounts": mounts,
    "laws": laws,
    "restitutions": restitutions,
}
"""The pictures by the name of their file."""

WRITTEN: dict[str, Callable[[Path], None]] = {
    "box_hits_its_stops.gif": box_hits_its_stops,
    "explore.png": explorer,
    "explore.webp": turned_knobs,
}
"""Those that no figure holds, by their whole names."""


if __name__ == "__main__":
    mpl.use("agg")
    for name in sys.argv[1:] or [*PICTURES, *WRITTEN]:
        if name in WRITTEN:
            WRITTEN[name](HERE / name)
        else:
            write_picture(PICTURES[name](), HERE / f"{name}.svg")
