"""Twelve kinds of records: Gaussian sizing, replay, and what further records of the kind need."""

import argparse
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.io import savemat

import stochvi
from stochvi.isolators.record_verdict import record_verdict
from stochvi.views.files import write_picture

FS, SECONDS, MISSES = 400.0, 20.0, 0.05
parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--quick", action="store_true", help="fewer further records")
parser.add_argument("--out", type=Path, default=Path(__file__).parent)
options = parser.parse_args()
further = 6 if options.quick else 200
random = np.random.default_rng(17)
t = np.arange(int(FS * SECONDS)) / FS
folder = Path(tempfile.mkdtemp())


def gaussian(low=4.0, high=80.0):
    """Stationary Gaussian noise in a band, 1 g rms."""
    f = np.fft.rfftfreq(2 * len(t), 1.0 / FS)
    parts = np.where((f >= low) & (f <= high), random.normal(size=(2, len(f))), 0.0)
    a = np.fft.irfft(parts[0] + 1j * parts[1], 2 * len(t))[: len(t)]
    return a / a.std()


def potholes(size, number):
    a = gaussian()
    for start in random.uniform(1.0, SECONDS - 1.0, number):
        inside = (t >= start) & (t < start + 0.04)
        a[inside] += size * np.sin(np.pi * (t[inside] - start) / 0.04)
    return a


KINDS = {
    "Gaussian, 4 to 80 Hz": gaussian,
    "Gaussian, 8 to 16 Hz": lambda: gaussian(8.0, 16.0),
    "two potholes, 3 g": lambda: potholes(3.0, 2),
    "two potholes, 6 g": lambda: potholes(6.0, 2),
    "two potholes, 9 g": lambda: potholes(9.0, 2),
    "twenty potholes, 6 g": lambda: potholes(6.0, 20),
    "with a sine, 0.5 g": lambda: gaussian() + 0.5 * np.sin(2.0 * np.pi * 12.0 * t),
    "with a sine, 1.5 g": lambda: gaussian() + 1.5 * np.sin(2.0 * np.pi * 12.0 * t),
    "level +3 dB half way": lambda: gaussian() * np.where(t < SECONDS / 2.0, 1.0, 2.0**0.5),
    "level +9 dB half way": lambda: gaussian() * np.where(t < SECONDS / 2.0, 1.0, 8.0**0.5),
    "cut off at 3 sigma": lambda: np.clip(gaussian(), -3.0, 3.0),
    "cut off at 1.5 sigma": lambda: np.clip(gaussian(), -1.5, 1.5),
}


def scene_of(values):
    file = folder / "record.mat"
    savemat(file, {"a": values})
    noise = stochvi.RecordedNoise(file=str(file), variables=("a",), unit="g", fs=FS)
    mount = stochvi.Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    return stochvi.Scene(structure=mount, excitations=[noise])


rows = []
for kind, make in KINDS.items():
    scene = scene_of(make())
    sized = stochvi.size(scene, probability=MISSES, mission=SECONDS, rel_error=0.1, budget=10)
    others = [record_verdict(scene_of(make())) for _ in range(further)]
    largest = np.array([each.displacement_max for each in others])
    rows.append({
        "kind": kind, "gaussian_mm": 1e3 * sized.clearance.value,
        "replay_mm": 1e3 * sized.record.clearance, "red": sized.record.contradicts,
        "needed_mm": 1e3 * np.quantile(largest, 1.0 - MISSES),
        "hit_at_gaussian": np.mean(largest > sized.clearance.value),
        "alarms": np.mean([each.contradicts for each in others]), "further": further,
    })  # fmt: skip
table = pd.DataFrame(rows)
print(table.to_string())
table.to_csv(options.out / "result.csv", index=False)

figure, (left, right) = plt.subplots(
    1, 2, figsize=(10.5, 4.6), layout="constrained", sharey=True, width_ratios=(3, 2)
)
places = np.arange(len(table))
left.plot(table["needed_mm"], places, "ks", label="needed by 19 of 20 further records")
left.plot(table["gaussian_mm"], places, "o", color="#0072b2", label="Gaussian sizing, 5 %")
left.plot(table["replay_mm"], places, "D", color="#d55e00", label="replay of the one record")
left.set_yticks(places, table["kind"])
left.set(xlabel="clearance (mm)", xlim=(0.0, None))
left.invert_yaxis()
left.legend(frameon=False, fontsize="small")
right.barh(places, 100.0 * table["alarms"], color="#d55e00")
right.set(xlabel=f"red verdicts among {further} further records (%)", xlim=(0, 100))
write_picture(left, options.out / "figure.png")
