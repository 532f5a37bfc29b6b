"""CPU time of a step: what paths that are three times as long take more, in one process.

Called as `python step_time.py SCENE PATHS DURATION`; prints the ns per second of scene time and the
ns per step.
"""

import sys
import time

import stochvi

REPEATS = 3
"""Number of times that either length is simulated; the shortest time counts."""


def cost(scene: stochvi.Scene, paths: int, duration: float) -> tuple[float, int]:
    """CPU s and steps of paths of `duration` seconds on one thread."""
    times, steps = [], 0
    for _ in range(REPEATS):
        began = time.process_time()
        answer = stochvi.simulate(scene, paths=paths, duration=duration, seed=1, threads=1)
        times.append(time.process_time() - began)
        steps = answer.cost.steps
    return min(times), steps


scene = stochvi.load_scene(sys.argv[1])
paths, duration = int(sys.argv[2]), float(sys.argv[3])
short, few = cost(scene, paths, duration)
long, many = cost(scene, paths, 3.0 * duration)
print(1e9 * (long - short) / (2.0 * duration * paths), 1e9 * (long - short) / (many - few))
