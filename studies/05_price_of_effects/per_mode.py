"""What a step of a structure costs with its number of modes, beside the bare arithmetic by hand."""

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import by_hand
import numpy as np
import pandas as pd
from modes_by_hand import bar_by_hand

import stochvi as sv
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import plan_several
from stochvi.motion.modal import ModalPlan
from stochvi.scenes import Bar

PATHS, STEPS = 256, 16000  # paths of a run; its steps, over the number of modes
LAWS = {"elastic": sv.Elastic(stiffness=2e7), "Hertz": sv.Hertz(coefficient=1e10),
        "viscoelastic": sv.Viscoelastic(stiffness=2e7, damping_ratio=0.1)}  # fmt: skip


def plan_of(modes: int, law: object, sigmas: float) -> ModalPlan:
    """A steel bar of 200 mm on a base that white noise shakes along it, with a stop at its tip."""
    bar = Bar(length=0.2, area=1e-4, young=2e11, density=7850.0, zeta=0.01, modes=modes,
              points={"tip": 1.0})  # fmt: skip
    noise = [sv.WhiteNoise(on="base", density=0.1, unit="g2/Hz")]
    sigma = sv.exact(sv.Scene(structure=bar, excitations=noise)).coordinates["tip"]
    stop = sv.ImpactPair(on="tip", upper=sigmas * sigma.displacement_std.value, law=law)
    return plan_several(
        model_of(sv.Scene(structure=bar, excitations=noise, impact_pairs=[stop])), None, None
    )


class Steps:
    """A plan whose paths go on from the stationary motion without stops; counts their contacts."""

    def __init__(self, plan: ModalPlan) -> None:
        self.plan, self.streams, self.contacts, self.steps = plan, by_hand.streams_of(PATHS), 0.0, 0
        self.state = plan.start(self.streams)

    def __call__(self, steps: int) -> None:
        self.contacts += self.plan.counts(self.state, self.streams, steps).sum()
        self.steps += steps


def least(jobs: dict[str, Callable[[int], object]], steps: int, repeats: int) -> dict[str, float]:
    """ns per step of each job: least CPU times of runs in alternation, three times as long less
    once as long."""
    for job in jobs.values():
        job(2)
    times: dict[tuple[str, int], float] = {}
    for _ in range(repeats):
        for name, job in jobs.items():
            for length in (1, 3):
                began = time.process_time()
                job(length * steps)
                took = time.process_time() - began
                times[name, length] = min(took, times.get((name, length), math.inf))
    return {k: 1e9 * (times[k, 3] - times[k, 1]) / (2 * PATHS * steps) for k in jobs}


def row_of(modes: int, repeats: int) -> dict[str, float]:
    """A row of the table."""
    plan = plan_of(modes, LAWS["elastic"], 1e6)
    h, omega = plan.step, np.sqrt(plan.modes.squares)
    turn, decay, ones = omega * h, np.exp(-0.02 * omega * h), np.ones(modes)
    by = (np.cos(turn), np.sin(turn) / omega, np.sin(turn) * omega, decay, ones, ones)
    table, streams = np.column_stack(by), by_hand.streams_of(PATHS)
    jobs: dict[str, Callable[[int], object]] = {
        "by_hand": lambda n: bar_by_hand(streams, n, h, math.inf, table),
        "motion": Steps(plan),
        "with_sums": lambda n: replace(plan, burn_in=9.0 * h, duration=n * h).averages(1, 0, PATHS),
    }  # fmt: skip
    near = {name: Steps(plan_of(modes, law, 1.0)) for name, law in LAWS.items()}
    found = least(jobs | near, max(STEPS // modes, 64), repeats)
    row = {"modes": modes} | {f"{name}_ns": found[name] for name in jobs}
    for name, each in near.items():
        share = each.contacts / (each.steps * PATHS)
        row[f"{name}_contact_ns"] = (found[name] - found["motion"]) / share
        row[f"{name}_steps_per_contact"] = 1.0 / share
    return row


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="1, 2 and 10 modes, fewer repeats")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    counts, repeats = ((1, 2, 10), 2) if options.quick else ((1, 2, 5, 10, 20, 50), 5)
    result = pd.DataFrame([row_of(modes, repeats) for modes in counts])
    result["motion_over_by_hand"] = result["motion_ns"] / result["by_hand_ns"]
    result.to_csv(options.out / "per_mode.csv", index=False, float_format="%.4g")
    print(result.T.to_string())
