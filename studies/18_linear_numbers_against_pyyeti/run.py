"""Compares the linear numbers of stochvi with pyYeti's, or scipy's where it is not installed."""

import argparse
import tempfile
import time
from pathlib import Path

import judges
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from stochvi import Isolator, RecordedNoise, Scene, TabulatedNoise, exact, replay, screen
from stochvi.scenes import profiles

G = 9.80665
Q = 10.0
ALLOWED = 1e-3
FADE = 0.2
"""Seconds in which a record reaches its full level."""

OWN = {
    "own table with a step": ([8, 20, 20.0001, 45, 300, 600], [2e-3, 2e-3, 2e-2, 4e-2, 6e-3, 1e-3]),
    "own table with a notch": ([5, 30, 34, 36, 40, 200], [1e-2, 2e-2, 1e-4, 1e-4, 2e-2, 5e-3]),
}
NATURAL = {"table": np.geomspace(4.0, 400.0, 25), "record": np.array([5.0, 8, 12, 18, 25, 40, 60])}


PEAKS = {
    "highest": "largest relative displacement (mm)",
    "lowest": "smallest relative displacement (mm)",
    "acceleration": "absolute acceleration, SRS (g)",
}
SHOWN = (
    ("navmat-p-9492", "rms absolute acceleration, VRS (g)"),
    ("own table with a notch", "rms absolute acceleration, VRS (g)"),
    ("record with potholes and an offset", "absolute acceleration, SRS (g)"),
)
"""Cases and quantities of the right picture."""


def mount(frequency: float, noise, q: float = Q) -> Scene:
    structure = Isolator(frequency_hz=float(frequency), zeta=0.5 / q)
    return Scene(structure=structure, excitations=[noise])


def row(case: str, quantity: str, frequency, ours: float, theirs: float) -> dict[str, object]:
    return {"case": case, "quantity": quantity, "frequency_hz": frequency, "stochvi": ours,
            "judge": theirs, "deviation": ours / theirs - 1.0}  # fmt: skip


def of_tables(judge, step: int, folder: Path):
    """Every shipped profile, and tables that are read from a file of a spreadsheet."""
    natural = NATURAL["table"][::step]
    tables = {
        name: (TabulatedNoise(profile=name), (found.frequency_hz, found.density))
        for name, found in profiles().items()
    }
    for name, table in OWN.items():
        file = folder / f"{name}.csv"
        lines = [f"{f};{d}".replace(".", ",") for f, d in zip(*table, strict=True)]
        file.write_text("\n".join(["Frequenz (Hz);ASD (g^2/Hz)", *lines[::-1]]), "utf-16")
        tables[name] = (TabulatedNoise(file=str(file)), table)
    for name, (noise, table) in tables.items():
        table = tuple(np.array(column, dtype=float) for column in table)
        theirs = judge.responses(table, natural, Q)
        yield row(name, "input acceleration (g)", None,
                  screen(mount(20.0, noise)).input_acceleration_std / G,
                  judge.input_rms(table))  # fmt: skip
        for k, frequency in enumerate(natural):
            moved = exact(mount(frequency, noise)).coordinates["x"]
            yield row(name, "rms absolute acceleration, by exact (g)", frequency,
                      float(moved.acceleration_std) / G, theirs["acceleration"][k])  # fmt: skip
            ours = screen(mount(frequency, noise))
            yield row(name, "rms absolute acceleration, VRS (g)", frequency,
                      ours.acceleration_std / G, theirs["acceleration"][k])  # fmt: skip
            yield row(name, "rms relative displacement (mm)", frequency,
                      1e3 * ours.displacement_std, 1e3 * G * theirs["displacement"][k])  # fmt: skip
            if ours.miles is not None:
                yield row(name, "Miles' equation (g)", frequency, ours.miles / G,
                          theirs["miles"][k])  # fmt: skip


def records() -> dict[str, tuple[np.ndarray, float]]:
    """A minute each, in g: band-limited noise, with an offset and potholes, with a sine.

    They fade in, because the judges take the sample before the first for zero, while a replay
    starts from rest at the first sample.
    """
    draw = np.random.default_rng(18)

    def noise(fs: float) -> np.ndarray:
        spectrum = np.fft.rfft(draw.normal(size=int(60 * fs)))
        f = np.fft.rfftfreq(int(60 * fs), 1.0 / fs)
        spectrum[(f < 4.0) | (f > 200.0)] = 0.0
        found = np.fft.irfft(spectrum)
        return 0.5 * found / found.std() * np.minimum(np.arange(len(found)) / (FADE * fs), 1.0)

    shaken, driven = noise(2000.0), noise(1000.0)
    time = np.arange(len(shaken)) / 2000.0
    for start in (17.0, 41.5):
        inside = (time >= start) & (time < start + 0.022)
        shaken[inside] += 9.0 * np.sin(np.pi * (time[inside] - start) / 0.022)
    clock = np.arange(len(driven)) / 1000.0
    sine = 0.8 * np.sin(2.0 * np.pi * 17.3 * clock) * np.minimum(clock / FADE, 1.0)
    return {
        "Gaussian record": (noise(2000.0), 2000.0),
        "record with potholes and an offset": (shaken + 0.3, 2000.0),
        "record with a sine": (driven + sine, 1000.0),
    }


def of_records(judge, step: int, folder: Path):
    """Replays without stops, and densities, against spectra of the same samples."""
    natural = NATURAL["record"][::step]
    kinds = PEAKS | {"rms": "rms relative displacement (mm)"}
    for name, (values, fs) in records().items():
        file = folder / f"{name}.txt"
        np.savetxt(file, values, fmt="%.9g")
        centred = np.loadtxt(file)
        centred -= centred.mean()
        noise = RecordedNoise(file=str(file), unit="g", fs=fs, resolution_hz=0.5)
        theirs = {
            "peaks between samples": judge.record(G * centred, fs, natural, Q),
            "peaks at samples": judge.record(G * centred, fs, natural, Q, finely=False),
        }
        for k, frequency in enumerate(natural):
            moved = replay(mount(frequency, noise)).coordinates["x"]
            ours = {
                "highest": moved.displacement_max, "lowest": moved.displacement_min,
                "rms": moved.displacement_std, "acceleration": moved.acceleration_max,
            }  # fmt: skip
            for how, found in theirs.items():
                for key, quantity in kinds.items():
                    if key == "rms" and how == "peaks at samples":
                        continue
                    unit = 1.0 / G if key == "acceleration" else 1e3
                    label = (
                        quantity if how == "peaks between samples" else f"{quantity}, at samples"
                    )
                    yield row(name, label, frequency, unit * abs(float(ours[key])),
                              unit * found[key][k])  # fmt: skip
        table = noise.table
        f, density = judge.density(G * centred, fs, round(fs / 0.5))
        at = np.searchsorted(f, table.frequency_hz)
        strong = density[at] > 1e-6 * density.max()
        worst = np.argmax(np.abs(table.density / density[at] - 1.0) * strong)
        yield row(name, "density (g^2/Hz), worst bin", table.frequency_hz[worst],
                  table.density[worst] / G**2, density[at][worst] / G**2)  # fmt: skip
        yield row(name, "rms of the record (g)", None, noise.record.rms / G, centred.std())


def draw(found: pd.DataFrame, judge: str, path: Path) -> None:
    """Left: deviations over the natural frequency. Right: a VRS and an SRS from both."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11.5, 4.4), layout="constrained")
    for label, words, marker, colour in (
        ("peaks of a record, read at samples alone", "at samples", "x", "#b0b4bb"),
        ("rms absolute acceleration (VRS)", "VRS", "s", "#2f6db3"),
        ("rms relative displacement", "rms relative", "o", "#d9822b"),
        ("peaks of a record, displacement and acceleration (SRS)", "", "^", "#3b8c4f"),
    ):
        if words:
            own = found["quantity"].str.contains(words)
        else:
            own = found["quantity"].isin(list(PEAKS.values()))
        part = found[own]
        left.plot(part["frequency_hz"], part["deviation"].abs().clip(lower=1e-9), marker,
                  markersize=4, color=colour, label=label)  # fmt: skip
    left.axhline(ALLOWED, color="#8a8f98", linewidth=1.0)
    left.text(left.get_xlim()[0] * 1.1, 1.2 * ALLOWED, "1e-3", color="#5a5f68")
    left.set(xscale="log", yscale="log", xlabel="natural frequency (Hz)",
             ylabel=f"|stochvi / {judge} - 1|")  # fmt: skip
    left.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.14))
    for case, quantity in SHOWN:
        part = found[(found["case"] == case) & (found["quantity"] == quantity)]
        (line,) = right.plot(part["frequency_hz"], part["judge"], linewidth=1.2,
                             label=f"{case}: {quantity}")  # fmt: skip
        right.plot(part["frequency_hz"], part["stochvi"], "o", markersize=4, color=line.get_color())
    right.set(
        xscale="log", yscale="log", xlabel="natural frequency (Hz)", ylabel="acceleration (g)"
    )
    right.set_title(f"lines: {judge}, dots: stochvi; Q = {Q:g}")
    right.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="every sixth natural frequency")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    judge, step = judges.judge(), 6 if options.quick else 1
    start = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        rows = [*of_tables(judge, step, Path(folder)), *of_records(judge, step, Path(folder))]
    found = pd.DataFrame(rows)
    found.to_csv(options.out / "result.csv", index=False, float_format="%.8g")
    draw(found, judge.name, options.out / "figure.png")
    largest = found.assign(deviation=found["deviation"].abs()).groupby("quantity", sort=False)
    print(largest["deviation"].agg(["max", "count"]).to_string(float_format="%.2g"))
    counted = found[~found["quantity"].str.contains("at samples")]
    beyond = counted[~(counted["deviation"].abs() <= ALLOWED)]
    print(f"{len(counted) - len(beyond)} of {len(counted)} numbers agree with {judge.name} to "
          f"{ALLOWED:g}; {time.process_time() - start:.0f} s of CPU.")  # fmt: skip
    if judge.name != "pyYeti":
        print("pyYeti is not installed (pip install stochvi[bench]); scipy was the judge.")
    if len(beyond):
        raise SystemExit(beyond.to_string())
