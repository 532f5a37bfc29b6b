"""The shipped box on a truck, its stops closer, to 1 %, beside a plain loop: CPU time of both.

`python box_beside_loop.py` prints and writes `box_beside_loop.csv`. The loop is what one writes at
first: records of the base by the inverse Fourier transform, semi-implicit Euler steps of six
coordinates, overshoot mirrored, one path after the other on one thread. Both end when mean squares
of displacement and velocity of all coordinates, and the rates, F1 and F2 of all snubbers, have a
standard error of 1 %. Its bias is its distance from the simulation, where that is significant.
"""

import argparse
import math
import time
from pathlib import Path

import numba
import numpy as np
import pandas as pd

import stochvi as sv
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.scenes import shipped_scene

RATE, DURATION, BURN_IN = 2000.0, 16.0, 2.0
"""Samples per second of the plain loop, and seconds of a path, the first of which do not count."""


@numba.njit(error_model="numpy")
def euler(base, inertia, inverse, damping, stiffness, load, ways, masses, stops, restitution, slow,
          h, skipped, sums):  # fmt: skip
    """One path of a box: sums of squares of x and v, then impacts, F1 and F2 of each pair."""
    n, pairs = len(load), len(ways)
    x, v = np.linalg.solve(stiffness, load), np.zeros(n)
    for k in range(len(base)):
        counted = k >= skipped
        v += h * (inverse @ (load - stiffness @ x - damping @ v - inertia @ base[k]))
        x += h * v
        for j in range(pairs):
            gap, rate = ways[j] @ x, ways[j] @ v
            for side in (0, 1):
                sign = 2.0 * side - 1.0
                beyond = sign * (gap - stops[j, side])
                if beyond > 0.0 and sign * rate > 0.0:
                    w = sign * rate
                    push = masses[j] * (inverse @ ways[j])
                    v -= sign * (1.0 + restitution) * w * push
                    x -= sign * 2.0 * beyond * push
                    if counted:
                        sums[2 * n + 3 * j] += w > slow[j]
                        sums[2 * n + 3 * j + 1] += w
                        sums[2 * n + 3 * j + 2] += w * w
        if counted:
            sums[:n] += x * x
            sums[n : 2 * n] += v * v


class Loop:
    """The plain loop of a scene of a rigid body."""

    def __init__(self, scene: sv.Scene) -> None:
        model = model_of(scene)
        stops = [[stop.position for stop in pair.stops] for pair in model.pairs]
        self.names = [f"{name}.{what}" for what in ("displacement", "velocity")
                      for name in model.coordinates]  # fmt: skip
        self.names += [f"{pair.name}.{what}" for pair in model.pairs
                       for what in ("rate", "F1", "F2")]  # fmt: skip
        inertia = model.mass @ model.base_rows
        self.numbers = (
            np.ascontiguousarray(inertia), np.linalg.inv(model.mass), model.damping,
            model.stiffness, model.constant_force, np.array([p.direction for p in model.pairs]),
            np.array([pair.mass for pair in model.pairs]), np.array(stops), 0.4,
        )  # fmt: skip
        self.random = np.random.default_rng(1)
        self.tables = {
            scene.excitations[k].axis: table for k, (table, _) in enumerate(model.tables)
        }
        self.axes = list(model.base)
        self.samples = int(RATE * DURATION)

    def record(self) -> np.ndarray:
        """Accelerations of the base (samples, axes)."""
        f = np.fft.rfftfreq(self.samples, 1.0 / RATE)
        found = np.empty((self.samples, len(self.axes)))
        for k, axis in enumerate(self.axes):
            table = self.tables[axis]
            inside = (f >= table.frequency_hz[0]) & (f <= table.frequency_hz[-1])
            density = np.zeros(len(f))
            density[inside] = np.exp(
                np.interp(np.log(f[inside]), np.log(table.frequency_hz), np.log(table.density))
            )
            size = np.sqrt(0.25 * density * RATE * self.samples)
            normals = self.random.normal(size=(2, len(f)))
            found[:, k] = np.fft.irfft(size * (normals[0] + 1j * normals[1]), self.samples)
        return found

    def path(self, slow: np.ndarray) -> np.ndarray:
        """Averages of one path."""
        sums = np.zeros(len(self.names))
        skipped = int(RATE * BURN_IN)
        euler(self.record(), *self.numbers, slow, 1.0 / RATE, skipped, sums)
        counted = self.samples - skipped
        n = len(self.numbers[4])
        sums[: 2 * n] /= counted
        sums[2 * n :] /= counted / RATE
        return sums


def closer(scene: sv.Scene) -> sv.Scene:
    """The box with stops some two deviations from where it hangs, so that all are hit."""
    places = {"corner 1": (-0.0035, 0.0016), "corner 2": (-0.0035, 0.0016), "side": (-5e-4, 5e-4)}
    pairs = [
        pair.replace(lower=places[pair.name][0], upper=places[pair.name][1])
        for pair in scene.impact_pairs
    ]
    return scene.replace(impact_pairs=pairs)


def to_accuracy(loop: Loop, slow: np.ndarray, rel_error: float) -> tuple[float, pd.DataFrame]:
    """CPU seconds until all have the relative error, by the paths simulated; and the averages."""
    began, paths = time.process_time(), [loop.path(slow) for _ in range(16)]
    while True:
        table = np.array(paths)
        mean = table.mean(axis=0)
        error = table.std(axis=0, ddof=1) / math.sqrt(len(table))
        if np.all(error <= rel_error * mean):
            found = pd.DataFrame({"loop": mean, "loop_error": error}, index=loop.names)
            return time.process_time() - began, found
        paths += [loop.path(slow) for _ in range(len(paths) // 4)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    rel_error = 0.1 if options.quick else 0.01
    scene = closer(sv.load_scene(shipped_scene("rigid-box")))
    sv.simulate(scene, paths=2, duration=1.0)
    began = time.process_time()
    make_plan(model_of(scene.replace(title="planned alone")))
    plan = time.process_time() - began
    began = time.process_time()
    answer = sv.simulate(scene, rel_error=rel_error, seed=1, threads=1, budget=None)
    own = time.process_time() - began
    pairs = list(answer.impact_pairs.values())
    slow = np.array([pair.speed_threshold for pair in pairs])
    loop = Loop(scene)
    loop.path(slow)
    taken, found = to_accuracy(loop, slow, rel_error)
    known = [
        answer.coordinates[name][f"{what}_mean_square"]
        for what in ("displacement", "velocity")
        for name in model_of(scene).coordinates
    ]
    of_pairs = ("collision_rate", "impact_speed_rate", "impact_speed_square_rate")
    known += [pair[what] for pair in pairs for what in of_pairs]
    found["simulate"] = [each.value for each in known]
    found["simulate_error"] = [each.standard_error for each in known]
    found["loop is off by"] = found["loop"] / found["simulate"] - 1.0
    found.to_csv(options.out / "box_beside_loop.csv", float_format="%.4g")
    print(found.to_string())
    print(f"plan {plan:.2f} s, simulate {own:.2f} s, loop {taken:.2f} s of CPU to {rel_error:g}")


if __name__ == "__main__":
    main()
