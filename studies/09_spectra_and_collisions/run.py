"""Spectra between two stops and statistics of their impacts, against what is known of them."""

import argparse
import time
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from cases import linear, linearised, oscillator

import stochvi
from stochvi.views.axes import FREQUENCY, Chart, Scale
from stochvi.views.files import write_picture
from stochvi.views.statistics import plot_curve, plot_histogram

COLOURS = {None: "#009e73", 1.0: "#0072b2", 0.8: "#d55e00"}
parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--quick", action="store_true", help="larger errors")
parser.add_argument("--out", type=Path, default=Path(__file__).parent)
options = parser.parse_args()
QUICK = options.quick
rows = []
figure, (above, left, right) = plt.subplots(3, 1, figsize=(7.2, 10.5), layout="constrained")
spectra = Chart(above, FREQUENCY, Scale("displacement (m²/Hz)", log=True))
speeds = Chart(left, Scale("impact speed (m/s); dashed: Rayleigh", log=True),
               Scale("density (s/m)", log=True))  # fmt: skip
intervals = Chart(right, Scale("time between impacts (s)", log=True),
                  Scale("density (1/s)", log=True))  # fmt: skip
for restitution, colour in COLOURS.items():
    scene = oscillator(restitution, -1.0, 1.0)
    before = time.process_time()
    found = stochvi.spectrum(scene, rel_error=0.05 if QUICK else 0.02, seed=1, threads=1)
    cost = time.process_time() - before
    curve, f = found.curves["x"]["displacement"], found.frequency_hz
    label = "no stops" if restitution is None else f"R = {restitution:g}"
    reference = linearised(scene, f) if restitution else linear(f)
    plot_curve(spectra, curve, label, colour)
    above.plot(f, reference, ":" if restitution else "--", color="#1b1b1b", linewidth=1.0)
    rows.append({"quantity": "share of frequencies with the reference in the band",
                 "restitution": restitution, "value": curve.holds(reference).mean(),
                 "reference": "linearised" if restitution else "exact",
                 "cpu_seconds": cost})  # fmt: skip
for restitution, position in [(r, p) for r in (1.0, 0.8, 0.5) for p in (1.0, 0.0)]:
    lower = -1.0 if position else None
    before = time.process_time()
    found = stochvi.impacts(
        oscillator(restitution, lower, position), paths=1024 if QUICK else 8192,
        speed_threshold=0.02, slow_impacts=restitution < 1.0, seed=1, threads=1, budget=None,
    ).pairs["stops"]  # fmt: skip
    cost, exponent = time.process_time() - before, found.exponents["both"]
    for name, estimate, reference in (
        ("exponent of slow impacts", exponent.fitted, exponent.theory),
        ("rate", found.rates["both"].estimate, found.rice_rates["both"]),
        ("variance / mean of counts", found.dispersion, 1.0),
    ):
        rows.append({"quantity": name, "restitution": restitution, "stop_at": position,
                     "value": estimate.value, "standard_error": estimate.standard_error,
                     "bias": estimate.bias, "reference": reference,
                     "cpu_seconds": cost})  # fmt: skip
    if position and restitution in COLOURS:
        colour, w = COLOURS[restitution], found.speeds.middles
        for chart, each in ((speeds, found.speeds), (intervals, found.intervals)):
            plot_histogram(chart, each, f"R = {restitution:g}", colour)
        left.plot(w, found.rayleigh(w), "--", color=colour, linewidth=1.0)
pd.DataFrame(rows).to_csv(options.out / "result.csv", index=False)
for chart, low in ((spectra, 1e-3), (speeds, 1e-4), (intervals, 1e-6)):
    chart.finish(4)
    chart.ax.set_ylim(bottom=low)
figure.suptitle("spectra with 95 % bands; dashed exact, dotted linearised", fontsize="medium")
write_picture(above, options.out / "figure.png")
