"""How many modes a reed needs that slaps against a stop: modes against finite elements in time."""

import argparse
import math
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from elements import slapping

import stochvi as sv
from stochvi.scenes import Beam, Modes

HERE = Path(__file__).parent
LENGTH, WIDTH, HEIGHT, YOUNG, DENSITY = 0.2, 0.02, 0.002, 2e11, 7850.0
CLEARANCE, STIFFNESS, LEVEL = 5e-4, 2e4, 0.01  # m, N/m, g^2/Hz
PLACES = np.linspace(0.05, 1.0, 20)
COLOURS = ("#0072b2", "#d55e00", "#777777")


def reed(modes: int) -> Beam:
    points = {"tip": 1.0} | {f"{place:.2f}": float(place) for place in PLACES}
    return Beam(length=LENGTH, width=WIDTH, height=HEIGHT, young=YOUNG, density=DENSITY, zeta=0.02,
                modes=modes, points=points)  # fmt: skip


def scene(modes: int, *, residual: bool = True, stop: bool = True) -> sv.Scene:
    """A reed whose modes all decay at one rate, as with finite elements of C proportional to M."""
    beam = reed(modes)
    table = beam.table
    structure = Modes(
        frequency_hz=table.omega / (2.0 * math.pi), zeta=0.02 * table.omega[0] / table.omega,
        modal_mass=table.mass, shapes=table.shapes, participation=table.participation,
        residual_compliance={"tip": beam.compliance({"tip": 1.0})} if residual else None,
    )  # fmt: skip
    law = sv.Elastic(stiffness=STIFFNESS)
    return sv.Scene(
        structure=structure,
        excitations=[sv.WhiteNoise(on="base", density=LEVEL, unit="g2/Hz")],
        impact_pairs=[sv.ImpactPair(on="tip", upper=CLEARANCE, law=law)] if stop else [],
    )


def simulated(modes: int, rel_error: float, **how: bool) -> dict[str, float]:
    """A row of the table: each number with its standard error and its bias."""
    found = sv.simulate(scene(modes, **how), rel_error=rel_error, seed=1, budget=600.0)
    pair, tip = found.impact_pairs["stops"], found.coordinates["tip"]
    named = {"rate": pair.collision_rate, "F1": pair.impact_speed_rate,
             "peak force": pair.peak_force, "rms of the tip": tip.displacement_std}  # fmt: skip
    row = {"modes": modes, "steps": found.cost.steps}
    for name, each in named.items():
        row |= {name: each.value, f"{name} error": each.standard_error, f"{name} bias": each.bias}
    return row


def shapes_at_touch(duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Deflections along the reed at the first sample of each impact, and at all samples, m."""
    path = sv.history(scene(6), duration=duration, rate=2e4, seed=1)
    rows = path.samples[[f"{place:.2f}.displacement_m" for place in PLACES]].to_numpy()
    first = np.searchsorted(path.samples["time_s"], path.impacts["time_s"])
    return rows[first[first < len(rows)]], rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="larger errors, fewer modes")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the figure and the table")
    options = parser.parse_args()
    began, rel_error = time.process_time(), 0.05 if options.quick else 0.01
    counts = (1, 2, 3) if options.quick else (1, 2, 3, 4, 6)
    rows = [{"by": "modes"} | simulated(n, rel_error) for n in counts]
    rows += [{"by": "bare modes"} | simulated(n, rel_error, residual=False) for n in counts]
    table = pd.DataFrame(rows)
    print(table.to_string(), f"{time.process_time() - began:.0f} s of CPU", flush=True)

    bending, line = YOUNG * WIDTH * HEIGHT**3 / 12.0, DENSITY * WIDTH * HEIGHT
    decay = 0.04 * reed(1).table.omega[0]
    intensity = LEVEL * 9.80665**2 / 2.0
    for step in (4e-5,) if options.quick else (2e-5, 1e-5):
        found = slapping((LENGTH, bending, line), decay, (CLEARANCE, STIFFNESS, intensity),
                         duration=0.2 if options.quick else 2.0, step=step)  # fmt: skip
        row = {"by": f"100 elements, step {step:g} s"}
        for name, (value, error) in found.items():
            row |= {name: value, f"{name} error": error}
        table = pd.concat([table, pd.DataFrame([row])], ignore_index=True)
    table.to_csv(options.out / "result.csv", index=False, float_format="%.5g")
    print(table.iloc[2 * len(counts) :].to_string(), f"{time.process_time() - began:.0f} s of CPU")
    draw(table, options.out / "figure.png", 1.0 if options.quick else 10.0)


def draw(table: pd.DataFrame, file: Path, duration: float) -> None:
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 8.0), layout="constrained")
    truth = table.iloc[-1]
    named = (("rate", "impacts (1/s)"), ("F1", "$F_1$ (m/s²)"), ("peak force", "peak force (N)"))
    for ax, (name, label) in zip(axes.flat[1:], named, strict=True):
        ax.axhspan(*(truth[name] + sign * 1.96 * truth[f"{name} error"] for sign in (-1.0, 1.0)),
                   color=COLOURS[2], alpha=0.3, label="100 finite elements, 95 %")  # fmt: skip
        for (by, part), colour in zip(table.groupby("by", sort=False), COLOURS[:2], strict=False):
            error = 1.96 * part[f"{name} error"] + part[f"{name} bias"].fillna(0.0)
            words = "with the compliance of modes left out" if by == "modes" else "without it"
            ax.errorbar(part["modes"], part[name], error, fmt="o-", color=colour, label=words)
        ax.set_xlabel("modes")
        ax.set_ylabel(label)
        ax.set_ylim(bottom=0.0)
        ax.legend(fontsize="small")
    touching, all_samples = shapes_at_touch(duration)
    ax, x = axes[0, 0], 1e3 * LENGTH * PLACES
    for shape in touching[:60]:
        ax.plot(x, 1e3 * shape, color=COLOURS[0], alpha=0.15, linewidth=0.8)
    ax.plot(x, 1e3 * touching.mean(axis=0), color=COLOURS[0], label="at the start of an impact")
    ax.plot(x, 1e3 * all_samples.std(axis=0), "--", color=COLOURS[2], label="rms")
    free = sv.linearise(scene(6, stop=False))
    rms = [1e3 * free.coordinates[f"{place:.2f}"].displacement_std.value for place in PLACES]
    ax.plot(x, rms, ":", color=COLOURS[1], label="rms without the stop")
    ax.plot([x[-1]], [1e3 * CLEARANCE], "^", color="k", markersize=9, label="stop")
    ax.set_xlabel("distance from the clamp (mm)")
    ax.set_ylabel("deflection (mm)")
    ax.legend(fontsize="small")
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    main()
