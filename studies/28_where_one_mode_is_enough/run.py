"""Where one mode of a cantilever is enough: impacts of one, two and three modes beside ten."""

import argparse
import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import stochvi as sv
from stochvi.scenes import Beam

LENGTH, WIDTH, HEIGHT, YOUNG, DENSITY = 0.2, 0.02, 0.002, 2e11, 7850.0
LEVEL, WHOLE = 0.01, 10  # g^2/Hz; modes that count as all
COLOURS = {1: "#0072b2", 2: "#d55e00", 3: "#009e73"}
NAMES = {"rate": "impact rate", "F1": "$F_1$", "peak force": "mean peak force"}
MARKERS = {1.0: "o", 2.0: "s", 3.0: "^"}


def scene(modes: int, place: float, sigmas: float, ratio: float) -> sv.Scene:
    """A cantilever on a base that white noise shakes. Its stop has `ratio` times the static
    stiffness of the beam at its place, at `sigmas` rms displacements of the whole beam there."""
    beam = Beam(length=LENGTH, width=WIDTH, height=HEIGHT, young=YOUNG, density=DENSITY, zeta=0.02,
                modes=modes, points={"stop": place})  # fmt: skip
    noise = [sv.WhiteNoise(on="base", density=LEVEL, unit="g2/Hz")]
    whole = sv.Scene(structure=beam.model_copy(update={"modes": WHOLE}), excitations=noise)
    sigma = sv.exact(whole).coordinates["stop"].displacement_std.value
    static = 3.0 * YOUNG * WIDTH * HEIGHT**3 / 12.0 / (place * LENGTH) ** 3
    law = sv.Elastic(stiffness=ratio * static)
    stop = sv.ImpactPair(on="stop", upper=sigmas * sigma, law=law)
    return sv.Scene(structure=beam, excitations=noise, impact_pairs=[stop])


def numbers(case: dict[str, float], modes: int, rel_error: float) -> dict[str, float]:
    """Numbers of the impacts, and the standard error of each with the bias of the step."""
    found = sv.simulate(scene(modes, **case), rel_error=rel_error, seed=1, budget=600.0)
    pair = found.impact_pairs["stops"]
    row = case | {"modes": modes}
    each = pair.collision_rate, pair.impact_speed_rate, pair.peak_force
    for name, value in zip(NAMES, each, strict=True):
        row |= {name: value.value, f"{name} error": math.hypot(value.standard_error, value.bias)}
    return row


def beside(table: pd.DataFrame) -> pd.DataFrame:
    """Numbers of few modes over those of all, with the standard error of the ratio."""
    keys = ["place", "sigmas", "ratio"]
    both = table[table["modes"] < WHOLE].merge(
        table[table["modes"] == WHOLE].drop(columns="modes"), on=keys, suffixes=("", " of all")
    )
    for name in NAMES:
        over = both[name] / both[f"{name} of all"]
        parts = [both[f"{name} error{end}"] / both[f"{name}{end}"] for end in ("", " of all")]
        both[name], both[f"{name} error"] = over, over * np.hypot(*parts)
    return both[[*keys, "modes", *NAMES, *(f"{name} error" for name in NAMES)]]


def draw(found: pd.DataFrame) -> plt.Figure:
    places = sorted(set(found["place"]), reverse=True)
    figure, axes = plt.subplots(
        len(places), 3, figsize=(12.0, 3.7 * len(places)), layout="constrained", sharex=True,
        squeeze=False,
    )  # fmt: skip
    for row, place in zip(axes, places, strict=True):
        for ax, (name, label) in zip(row, NAMES.items(), strict=True):
            ax.axhspan(0.9, 1.1, color="#777777", alpha=0.2)
            for (modes, sigmas), part in found[found["place"] == place].groupby(
                ["modes", "sigmas"]
            ):
                shift = 1.0 + 0.08 * (sigmas - 2.0)  # points of one stiffness side by side
                ax.errorbar(shift * part["ratio"], part[name], 1.96 * part[f"{name} error"],
                            fmt=f"{MARKERS[sigmas]}-", color=COLOURS[modes], markersize=5,
                            label=f"{modes} mode{'s' * (modes > 1)}, {sigmas:g} rms")  # fmt: skip
            ax.set(xscale="log", ylim=(0.0, None), ylabel=f"{label} / that of {WHOLE} modes")
            where = "at the tip" if place == 1.0 else f"at {place:g} of the length"
            ax.set_title(f"stop {where}", fontsize="medium")
    for ax in axes[-1]:
        ax.set_xlabel("stiffness of the stop / that of the beam")
    axes[0, 0].legend(fontsize="x-small", ncols=2)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="larger errors, fewer cases")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder of results")
    quick, out = vars(parser.parse_args()).values()
    counts, error = ((1, WHOLE), 0.2) if quick else ((*COLOURS, WHOLE), 0.03)
    sizes = (1.0,) if quick else tuple(MARKERS)
    ratios = (1.0, 100.0) if quick else (0.1, 1.0, 10.0, 100.0, 1000.0)
    cases = [{"place": 1.0, "sigmas": size, "ratio": each} for size in sizes for each in ratios]
    if not quick:
        cases += [{"place": 0.5, "sigmas": 2.0, "ratio": each} for each in ratios]
    table = pd.DataFrame([numbers(case, count, error) for case in cases for count in counts])
    table.to_csv(out / "result.csv", index=False, float_format="%.5g")
    found = beside(table)
    print(found.round(3).to_string())
    draw(found).savefig(out / "figure.png", dpi=110)


if __name__ == "__main__":
    main()
