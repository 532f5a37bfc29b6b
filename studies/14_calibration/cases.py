"""Ten thousand small answers of each kind: did the interval hold the known truth?

The answers are groups of the paths, missions or repetitions of one large run, which are
independent, so that no group is simulated apart.
"""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t
from statsmodels.stats.proportion import proportion_confint
from statsmodels.stats.rates import confint_poisson

import stochvi
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.motion.missions import passage_plan, pilot_levels, repetition

Vector = NDArray[np.float64]
MISSION = 20.0 * math.pi
OSCILLATOR = stochvi.Oscillator(mass=1.0, damping=0.1, stiffness=1.0)
NOISE = stochvi.WhiteNoise(intensity=0.2)
FREE = stochvi.Scene(structure=OSCILLATOR, excitations=[NOISE])
BOX = FREE.model_copy(
    update={
        "impact_pairs": (
            stochvi.ImpactPair(lower=-1.0, upper=1.0, law=stochvi.Restitution(coefficient=1.0)),
        )
    }
)
P_AT_3, P_AT_4 = 0.0784609, 0.00274504  # first passage from rest in ten periods
CONFIDENCE = 0.95
QUANTITIES = (
    "displacement_mean_square",
    "velocity_mean_square",
    "collision_rate",
    "impact_speed_rate",
    "impact_speed_square_rate",
)
MANY = 8192  # paths at a time
Row = tuple[str, str, int, int, int]  # kind, of what, size of an answer, answers, covered


def simulated(answers: int, paths: int) -> Iterator[Row]:
    """Mean squares, rate, F1, F2 of paths of `simulate`: normal and Student's quantiles."""
    plan = make_plan(model_of(BOX), None, None)
    truth = stochvi.exact(BOX).estimates()
    rows = [key[1] for key in plan.layout.rows]
    pair = ("n_lower", "n_upper"), ("f1_lower", "f1_upper"), ("f2_lower", "f2_upper")
    for name, parts in zip(QUANTITIES, (("xx",), ("vv",), *pair), strict=True):
        known = truth["x" if "mean_square" in name else "stops", name].value
        chosen = [rows.index(part) for part in parts]
        table = np.concatenate(
            [
                plan.averages(14, first, MANY)[chosen].sum(axis=0)
                for first in range(0, answers * paths, MANY)
            ]
        )[: answers * paths].reshape(answers, paths)
        miss = np.abs(table.mean(axis=1) - known)
        error = table.std(axis=1, ddof=1) / math.sqrt(paths)
        for kind, quantile in (("normal", norm.ppf(0.975)), ("Student", t.ppf(0.975, paths - 1))):
            covered = int(np.sum(miss <= quantile * error))
            yield f"simulate, {kind}", name, paths, answers, covered


def counted(answers: int, barrier: float, truth: float, missions: int) -> Iterator[Row]:
    """Clopper and Pearson, Wilson, and exact Poisson intervals of failed missions."""
    plan = passage_plan(model_of(FREE), -barrier, barrier, MISSION, "rest")
    failed = np.empty(answers, int)
    for answer in range(answers):
        fleet = plan.fleet(14, answer * missions, missions)
        plan.advance(fleet, math.inf)
        failed[answer] = fleet.happened.sum()
    ends = {
        "Clopper-Pearson": proportion_confint(failed, missions, 1.0 - CONFIDENCE, "beta"),
        "Wilson": proportion_confint(failed, missions, 1.0 - CONFIDENCE, "wilson"),
        "Poisson, exact": confint_poisson(failed, missions, "exact-c", 1.0 - CONFIDENCE),
    }
    for kind, (lower, upper) in ends.items():
        covered = int(np.sum((lower <= truth) & (truth <= upper)))
        yield kind, f"P = {truth:.3g}", missions, answers, covered


def split(answers: int, repetitions: int, particles: int) -> Iterator[Row]:
    """Intervals of splitting: Student's, of the mean and of its logarithm."""
    plan = passage_plan(model_of(FREE), -4.0, 4.0, MISSION, "rest")
    levels = pilot_levels(plan, 5).levels
    chances = np.array(
        [
            repetition(plan, levels, 14, False, index * particles, particles).chance
            for index in range(answers * repetitions)
        ]
    ).reshape(answers, repetitions)
    mean, error = chances.mean(axis=1), chances.std(axis=1, ddof=1) / math.sqrt(repetitions)
    reach = t.ppf(0.975, repetitions - 1) * error
    ratio = np.log(np.maximum(mean, 1e-300) / P_AT_4)
    for kind, inside in (
        ("splitting, mean", np.abs(mean - P_AT_4) <= reach),
        ("splitting, log", np.abs(ratio) <= reach / np.maximum(mean, 1e-300)),
    ):
        yield kind, f"P = {P_AT_4:.3g}", repetitions, answers, int(inside.sum())
