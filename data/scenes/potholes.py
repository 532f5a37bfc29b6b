"""Make `truck-potholes.csv`: 30 s on a truck bed with three potholes, `python
data/scenes/potholes.py`.

Nothing in it is measured. The noise is Gaussian, with the density of
mil-std-810h-truck-vertical-5hz up to 100 Hz. A pothole is one period of a sine of 60 ms, as a wheel
first drops and then strikes the edge.
"""

from pathlib import Path

import numpy as np

import stochvi
from stochvi.mathematics.units import STANDARD_GRAVITY

RATE, SECONDS, HIGHEST = 256.0, 30.0, 100.0
POTHOLES = ((6.3, 4.0), (14.8, 6.5), (23.1, 5.0))
"""Start (s) and size (g) of each pothole."""
LENGTH = 0.06
"""Time that a pothole takes, s."""

rng = np.random.default_rng(8608)
time = np.arange(int(RATE * SECONDS)) / RATE
frequency = np.fft.rfftfreq(time.size, 1.0 / RATE)
table = stochvi.TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz").table
inside = (frequency >= 5.0) & (frequency <= HIGHEST)
density = np.zeros_like(frequency)
lines = np.interp(
    np.log(frequency[inside]), np.log(table.frequency_hz), np.log(table.density)
)  # straight in log-log, as the table is meant
density[inside] = np.exp(lines) / STANDARD_GRAVITY**2
normal = rng.normal(size=(2, frequency.size))
size = np.sqrt(density * RATE * time.size) / 2.0
values = np.fft.irfft(size * (normal[0] + 1j * normal[1]), time.size)
for start, height in POTHOLES:
    during = (time >= start) & (time < start + LENGTH)
    values[during] -= height * np.sin(2.0 * np.pi * (time[during] - start) / LENGTH)
rows = np.column_stack([time, values])
np.savetxt(
    Path(__file__).with_name("truck-potholes.csv"), rows, fmt=["%.6f", "%.4f"], delimiter=",",
    header="time_s,acceleration_g", comments="",
)  # fmt: skip
