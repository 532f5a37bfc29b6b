"""By how much control variates reduce the number of paths, quantity by quantity."""

import math
from collections.abc import Iterator

import numpy as np
import pandas as pd
from cases import CASES, scene

import stochvi as sv
from stochvi.model.modal import linear_law
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.motion.plan import Means, PathStatistics, of_coordinate, of_pair
from stochvi.scenes.datasets import shipped_scene, zoo_files

ASKED = (
    "displacement_std", "velocity_std", "collision_rate", "impact_speed_rate",
    "impact_speed_square_rate",
)  # fmt: skip
"""The quantities that are asked for most, of the first coordinate and the first pair."""

SHAKING = sv.TabulatedNoise(
    frequency_hz=[0.01, 0.08, 0.3, 1.0], density=[0.05, 1.0, 1.0, 0.1], unit="(m/s2)2/Hz", on="base"
)
"""A table around the natural frequencies of the masses."""


def scenes() -> Iterator[tuple[str, sv.Scene, int]]:
    """Names, scenes and numbers of paths."""
    for name in ("1 sigma, R = 1", "1 sigma, R = 0.5", "2 sigma, R = 1", "2 sigma, R = 0.8"):
        yield f"white noise, {name}", scene(*CASES[name]), 4096
    mount = sv.load_scene(shipped_scene("isolator-truck"))
    free = mount.replace(impact_pairs=[])
    response = sv.exact(free).coordinates["x"]
    sigma = response.displacement_std.value
    for times, restitution in ((1, 0.5), (2, 1.0), (2, 0.5), (3, 1.0), (3, 0.5), (4, 0.5)):
        law = sv.Restitution(coefficient=restitution)
        pair = sv.ImpactPair(lower=-times * sigma, upper=times * sigma, law=law)
        paths = 4096 if times == 4 else 1024
        yield (
            f"a table, {times} sigma, R = {restitution:g}",
            mount.replace(impact_pairs=[pair]),
            paths,
        )


def structures() -> Iterator[tuple[str, sv.Scene, int]]:
    """Scenes of several masses: a light mass in a box on another, a chain of three with two pairs,
    and six modes with three pairs."""
    zoo = zoo_files()
    absorber, chain = (
        sv.load_scene(zoo[name]) for name in ("absorber-lossy-sprung", "chain-two-pairs")
    )
    box = sv.load_scene(shipped_scene("rigid-box"))
    for times in (1, 2, 3):
        for name, case in (("a light mass in a box", absorber), ("three masses", chain)):
            yield f"white noise, {name}, {times} sigma", at(times, case), 1024
            table = case.replace(excitations=[SHAKING])
            yield f"a table, {name}, {times} sigma", at(times, table), 512
        yield f"a table, six modes, {times} sigma", at(times, box), 512


def at(times: float, case: sv.Scene) -> sv.Scene:
    """The scene with stops of R = 0.5 at multiples of the standard deviation that each gap has
    without stops, about its mean."""
    modes = model_of(case).modal
    law = linear_law(model_of(case.replace(impact_pairs=[])).modal)
    assert law is not None
    pairs = []
    for pair, row in zip(case.impact_pairs, modes.gaps, strict=True):
        deviation = math.sqrt(law.variances(row, 0))
        middle = float(row @ modes.rest)
        keys = pair.model_dump(exclude={"lower", "upper", "clearance", "law"}, exclude_unset=True)
        stops = {"lower": middle - times * deviation, "upper": middle + times * deviation}
        pairs.append(sv.ImpactPair(**keys, **stops, law=sv.Restitution(coefficient=0.5)))
    return case.replace(impact_pairs=pairs)


def gains(case: sv.Scene, paths: int) -> list[float]:
    """Squares of the standard errors without controls over those with them."""
    plan = make_plan(model_of(case))
    parts = [plan.averages(3, first, plan.block) for first in range(0, paths, plan.block)]
    statistics = PathStatistics.of(np.concatenate(parts, axis=1), plan.layout)
    known = of_coordinate(plan.model.coordinates[0]) | of_pair(plan.model.pairs[0].name)

    def asked(means: Means) -> list[float]:
        return [known[name](means) for name in ASKED]

    with_them = statistics.evaluate_all(asked)
    without = statistics.uncontrolled.evaluate_all(asked)
    return [(a / b) ** 2 for (_, a), (_, b) in zip(without, with_them, strict=True)]


def table(size: float) -> pd.DataFrame:
    """Gains of every scene; `size` scales the numbers of paths."""
    rows = [
        (name, *gains(case, max(256, math.ceil(paths * size))))
        for name, case, paths in (*scenes(), *structures())
    ]
    return pd.DataFrame(rows, columns=["case", *ASKED])


if __name__ == "__main__":
    print(table(1.0).to_string(index=False, float_format="%.1f"))
