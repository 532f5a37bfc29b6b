"""Price of a step, however a total of motion is split into paths and durations.

`python split.py` prints CPU ns per step, the ratio to the cheapest split, and writes `split.csv`;
`--against REVISION ...` times older revisions in turns with this checkout. Called with a list of
numbers it measures one scene in the process that it is.
"""

import argparse
import json
import re
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import stochvi

STEPS = 4.2e7
"""Number of steps of all paths together, burn-in apart."""

PATHS = (64, 256, 1024, 4096)
CASES = [(r, gap) for r in (1.0, 0.5, 0.0) for gap in (1.0, 0.01, 1e-6)]
"""Restitution, and distance of either stop in m: m = k = 1, b = .1, S0 = .2."""

SCENE = """
structure = {{kind = "oscillator", mass = 1.0, damping = 0.1, stiffness = 1.0}}
excitation = [{{kind = "white", intensity = 0.2}}]
[[impact_pair]]
lower = -{gap}
upper = {gap}
law = {{kind = "restitution", coefficient = {r}}}
"""


def price(scene: stochvi.Scene, paths: int, steps: float, repeats: int) -> tuple[float, float]:
    """CPU ns per step, and CPU s of the whole answer: the least of the repeats."""
    (head,) = re.findall(
        r"step ([\d.e-]+) s", " ".join(stochvi.simulate(scene, paths=2, duration=1e-3).assumptions)
    )
    duration, times, made = steps / paths * float(head), [], 0
    for _ in range(repeats):
        began = time.process_time()
        answer = stochvi.simulate(scene, paths=paths, duration=duration, threads=1, budget=3600.0)
        times.append(time.process_time() - began)
        made = answer.cost.steps
    return 1e9 * min(times) / made, min(times)


def measure(r: float, gap: float, paths: int, steps: float, repeats: int) -> tuple[float, float]:
    """The price in this process."""
    place = Path(sys.argv[0]).with_name(f"split_{time.time_ns()}.toml")
    place.write_text(SCENE.format(r=r, gap=gap))
    try:
        return price(stochvi.load_scene(place), paths, steps, repeats)
    finally:
        place.unlink()


def table(against: list[str], quick: bool, out: Path) -> None:
    """Every case in every checkout, one after the other, in processes of their own."""
    import pandas as pd
    from run import HOUSE, checkout_of, run

    steps, repeats = (STEPS / 100.0, 1) if quick else (STEPS, 2)
    rows = []
    with ExitStack() as stack:
        houses = {"": HOUSE} | {one: stack.enter_context(checkout_of(one)) for one in against}
        for r, gap in CASES[:: 4 if quick else 1]:
            for name, house in houses.items():
                found = [
                    json.loads(run([__file__, json.dumps([r, gap, n, steps, repeats])], house)[2])
                    for n in PATHS
                ]
                each = [of_step for of_step, _ in found]
                rows.append((r, gap, name, *each, max(each) / min(each)))
                print(*rows[-1], flush=True)
    names = ["R", "gap, m", "revision", *(f"{n} paths, ns" for n in PATHS), "dearest / cheapest"]
    pd.DataFrame(rows, columns=names).to_csv(out / "split.csv", index=False, float_format="%.3g")


if __name__ == "__main__":
    if len(sys.argv) > 1 and sys.argv[1].startswith("["):
        print(json.dumps(measure(*json.loads(sys.argv[1]))))
    else:
        options = argparse.ArgumentParser(description=__doc__)
        options.add_argument("--against", nargs="*", default=[])
        options.add_argument("--quick", action="store_true")
        options.add_argument("--out", type=Path, default=Path(__file__).parent)
        asked = options.parse_args()
        table(asked.against, asked.quick, asked.out)
