"""The kernels with and without the compiler; `python -m support.uncompiled` prints numbers."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np

from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from support import CHECKOUT
from support.known import oscillator
from support.mounts import COMPANY, bumpered_mount, isolator
from support.soft_stops import EXACT, RUBBER, scene

RIGID = {
    "lossy": oscillator(-1.0, 1.0, 0.5),
    "several impacts a step": oscillator(-0.04, 0.05, 0.9),
}
SOFT = {
    "wall below, load": EXACT["wall below, load"],
    "viscoelastic": scene(-0.6, 0.5, RUBBER, load=0.2),
    "table, load": EXACT["load on a stop"],
}


def averages() -> dict[str, list[float]]:
    """Averages of a few short paths of each kernel, by the name of the case."""
    found = {}
    for name, case in RIGID.items():
        plan = make_plan(model_of(case), None, 2.0).with_step(0.1)
        found[f"rigid: {name}"] = replace(plan, burn_in=0.1, duration=4.0).averages(3, 0, 3)
    # short, as impacts amplify what the compiler rounds otherwise
    short = replace(make_plan(model_of(isolator(0.002)), None, 0.5), burn_in=0.1)
    found["rigid: response domain"] = short.averages(3, 0, 3)
    for name, case in SOFT.items():
        plan = make_plan(model_of(case), None, 4.0).with_step(0.25)
        found[f"soft: {name}"] = replace(plan, burn_in=0.5).averages(3, 0, 3)
    for name, (law, beside) in COMPANY.items():
        plan = make_plan(model_of(bumpered_mount(law, sigmas=0.5, beside=beside)), 0.0, 0.3)
        plan = replace(plan, burn_in=0.05, block_length=2.0, samples=360, step=2.0 / 360)
        found[f"soft, tabulated: {name}"] = plan.averages(3, 0, 1)
    return {name: np.asarray(sums).ravel().tolist() for name, sums in found.items()}


def averages_without_the_compiler() -> dict[str, list[float]]:
    """The same from a process of its own, of this checkout and not of an installed package."""
    paths = os.pathsep.join(str(folder) for folder in (CHECKOUT, CHECKOUT / "tests"))
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-m", "support.uncompiled"],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONPATH": paths, "NUMBA_DISABLE_JIT": "1"},
    )
    found: dict[str, list[float]] = json.loads(done.stdout)
    return found


if __name__ == "__main__":
    np.seterr(over="ignore")  # the random numbers are integers that wrap
    print(json.dumps(averages()))
