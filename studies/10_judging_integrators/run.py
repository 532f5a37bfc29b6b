"""Judges integrators that people write first; what each gets wrong, by how much."""

import argparse
import time
from pathlib import Path

import integrators
import matplotlib.pyplot as plt
import pandas as pd

from stochvi.testing import judge

SCENES = ("linear", "elastic-half-sigma", "lossy-0.5", "elastic-bench-12-hz")
QUANTITIES = {
    "displacement_std": "rms displacement", "velocity_std": "rms velocity",
    "collision_rate": "impact rate", "impact_speed_rate": "F1",
}  # fmt: skip


def rows(name: str, verdict, seconds: float) -> list[dict[str, object]]:
    kept = ("scene", "quantity", "truth", "value", "bias_percent", "bias_error_percent", "score")
    return [
        {"integrator": name, **{key: getattr(row, key) for key in kept},
         "verdict": row.verdict, "looks_like": "; ".join(verdict.hints), "cpu_seconds": seconds}
        for row in verdict.findings
    ]  # fmt: skip


def draw(table: pd.DataFrame, path: Path) -> None:
    """The bias of each quantity between elastic stops at half a sigma."""
    shown = table[table["scene"] == "elastic-half-sigma"]
    names = list(dict.fromkeys(shown["integrator"]))
    figure, ax = plt.subplots(figsize=(8.4, 4.4), layout="constrained")
    for k, (quantity, label) in enumerate(QUANTITIES.items()):
        part = shown[shown["quantity"] == quantity].set_index("integrator").reindex(names)
        at = [index + 0.16 * (1.5 - k) for index in range(len(names))]
        ax.errorbar(part["bias_percent"], at, xerr=2.0 * part["bias_error_percent"], fmt="o",
                    markersize=5, label=label)  # fmt: skip
    ax.axvline(0.0, color="#8a8f98", linewidth=1.0)
    ax.set_yticks(range(len(names)), [name.replace(", ", ",\n") for name in names])
    ax.invert_yaxis()
    ax.set_xlabel("difference from the exact answer (%), bars of two standard errors")
    ax.set_title("elastic stops at half a sigma, step 0.05 / omega")
    ax.legend(frameon=False, ncols=2)
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer paths, larger errors")
    parser.add_argument("--libraries", action="store_true", help="diffrax as well")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    size = {"paths": 64, "relaxations": 5.0} if options.quick else {"paths": 1024}
    chosen = integrators.FIRST | (integrators.LIBRARIES if options.libraries else {})
    tasks = [(name, integrator, SCENES, size) for name, integrator in chosen.items()]
    if not options.quick:  # one long path; bounces at R = 0.5 would take minutes
        task = (integrators.solve_ivp_events, SCENES[:2], {"relaxations": 150.0})
        tasks.append(("solve_ivp with events", *task))
    found: list[dict[str, object]] = []
    for name, integrator, scenes, keys in tasks:
        start = time.process_time()
        verdict = judge(integrator, scenes, **keys)
        found += rows(name, verdict, time.process_time() - start)
        print(f"{name}:\n{verdict}\n", flush=True)
        result = pd.DataFrame(found)
        result.to_csv(options.out / "result.csv", index=False, float_format="%.5g")
    draw(result, options.out / "figure.png")
