"""How many modes a reed needs that slaps against a stop: modes against finite elements in time."""

import argparse
import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from elements import slapping

import stochvi as sv
from stochvi.scenes import Beam, Modes

LENGTH, WIDTH, HEIGHT, YOUNG, DENSITY = 0.2, 0.02, 0.002, 2e11, 7850.0
CLEARANCE, STIFFNESS, LEVEL = 5e-4, 2e4, 0.01  # m, N/m, g^2/Hz
PLACES = {f"{place:.2f}": float(place) for place in np.linspace(0.05, 1.0, 20)}
NAMES = {"rate": "impacts (1/s)", "F1": "$F_1$ (m/s²)", "peak force": "mean peak force (N)"}


def scene(modes: int, residual: bool = True, stop: bool = True) -> sv.Scene:
    """A reed whose modes all decay at one rate, as with finite elements of C proportional to M."""
    beam = Beam(length=LENGTH, width=WIDTH, height=HEIGHT, young=YOUNG, density=DENSITY, zeta=0.02,
                modes=modes, points={"tip": 1.0} | PLACES)  # fmt: skip
    table = beam.table
    structure = Modes(
        frequency_hz=table.omega / (2.0 * math.pi), zeta=0.02 * table.omega[0] / table.omega,
        modal_mass=table.mass, shapes=table.shapes, participation=table.participation,
        residual_compliance={"tip": beam.compliance({"tip": 1.0})} if residual else None,
    )  # fmt: skip
    pairs = [sv.ImpactPair(on="tip", upper=CLEARANCE, law=sv.Elastic(stiffness=STIFFNESS))]
    noise = [sv.WhiteNoise(on="base", density=LEVEL, unit="g2/Hz")]
    return sv.Scene(structure=structure, excitations=noise, impact_pairs=pairs if stop else [])


def by_modes(modes: int, rel_error: float, residual: bool) -> dict[str, float]:
    """A row of the table: each number, and its standard error with the bias of the step."""
    found = sv.simulate(scene(modes, residual), rel_error=rel_error, seed=1, budget=300.0)
    pair, tip = found.impact_pairs["stops"], found.coordinates["tip"]
    square, rate, force = tip.displacement_mean_square, pair.collision_rate, pair.peak_force
    half = 0.5 / math.sqrt(square.value)  # of a root, by that of the square
    row = {"by": "modes" if residual else "bare modes", "modes": modes}
    for name, each in zip(NAMES, (rate, pair.impact_speed_rate, force), strict=True):
        row |= {name: each.value, f"{name} error": math.hypot(each.standard_error, each.bias)}
    error = half * math.hypot(square.standard_error, square.bias)
    return row | {"rms of the tip": math.sqrt(square.value), "rms of the tip error": error}


def by_elements(duration: float, step: float) -> dict[str, float]:
    """The same of 200 finite elements, by Newmark's rule."""
    beam = (LENGTH, YOUNG * WIDTH * HEIGHT**3 / 12.0, DENSITY * WIDTH * HEIGHT)
    decay = 0.04 * scene(1).structure.table.omega[0]
    stop = (CLEARANCE, STIFFNESS, LEVEL * 9.80665**2 / 2.0)
    found = slapping(beam, decay, stop, duration, step, count=200)
    row = {"by": f"200 elements, step {step:g} s"}
    return row | {f"{name}{end}": each[k] for name, each in found.items()
                  for k, end in enumerate(("", " error"))}  # fmt: skip


def draw(table: pd.DataFrame, duration: float) -> plt.Figure:
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 8.0), layout="constrained")
    truth = table.iloc[-1]
    for ax, (name, label) in zip(axes.flat[1:], NAMES.items(), strict=True):
        ends = [truth[name] + sign * 1.96 * truth[f"{name} error"] for sign in (-1.0, 1.0)]
        ax.axhspan(*ends, color="#777777", alpha=0.3, label="200 finite elements, 95 %")
        for by, colour in (("modes", "#0072b2"), ("bare modes", "#d55e00")):
            part = table[table["by"] == by]
            words = "modes and the compliance of the others" if by == "modes" else "modes alone"
            ax.errorbar(part["modes"], part[name], 1.96 * part[f"{name} error"], fmt="o-",
                        color=colour, label=words)  # fmt: skip
        ax.set(xlabel="modes", ylabel=label, ylim=(0.0, None))
        ax.legend(fontsize="small", loc="lower right")
    path, ax, x = sv.history(scene(6), duration=duration, rate=2e4, seed=1), axes[0, 0], None
    shapes = 1e3 * path.samples[[f"{name}.displacement_m" for name in PLACES]].to_numpy()
    touch = np.searchsorted(path.samples["time_s"], path.impacts["time_s"])
    x, touching = 1e3 * LENGTH * np.array(list(PLACES.values())), shapes[touch[touch < len(shapes)]]
    ax.plot(x, touching[:60].T, color="#0072b2", alpha=0.15, linewidth=0.8)
    ax.plot(x, touching.mean(axis=0), color="#0072b2", label="at the start of an impact, mean")
    ax.plot(x, np.sqrt(np.mean(shapes**2, axis=0)), "--", color="#777777", label="rms")
    free = sv.linearise(scene(6, stop=False)).coordinates
    ax.plot(x, [1e3 * free[name].displacement_std.value for name in PLACES], ":", color="#d55e00",
            label="rms without the stop")  # fmt: skip
    ax.plot(x[-1:], [1e3 * CLEARANCE], "^", color="k", markersize=9, label="stop")
    ax.set(xlabel="distance from the clamp (mm)", ylabel="deflection (mm)")
    ax.legend(fontsize="small", loc="upper left")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="larger errors, fewer modes")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder of results")
    quick, out = vars(parser.parse_args()).values()
    counts, error = ((1, 2), 0.1) if quick else ((1, 2, 3, 4, 6, 8), 0.015)
    rows = [by_modes(count, error, residual) for residual in (True, False) for count in counts]
    steps = (4e-5,) if quick else (2e-5, 1e-5)
    rows += [by_elements(0.02 if quick else 2.0, step) for step in steps]
    table = pd.DataFrame(rows)
    table.to_csv(out / "result.csv", index=False, float_format="%.5g")
    print(table.to_string())
    draw(table, 1.0 if quick else 4.0).savefig(out / "figure.png", dpi=110)


if __name__ == "__main__":
    main()
