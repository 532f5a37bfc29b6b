"""Mistakes that users make, as a scene converted wrongly or an integrator that mirrors too late.

Each change takes the name of a scene of the zoo and returns the scene that is simulated in its
place; the truth stays that of the right one.
"""

import math
from collections import Counter
from collections.abc import Callable
from functools import cache
from importlib import import_module

import pandas as pd

import stochvi
from stochvi.testing import as_response, problem_of
from stochvi.verification.check import MethodResponses, compare_many, seeds_of

integrators = import_module("studies.10_judging_integrators.integrators")

Document = dict
Change = Callable[[Document], None]


def law_changed(factor: Callable[[float], float]) -> Change:
    def change(document: Document) -> None:
        for pair in document["impact_pair"]:
            pair["law"]["coefficient"] = factor(pair["law"]["coefficient"])

    return change


def noise_doubled(document: Document) -> None:
    for excitation in document["excitation"]:
        for key in ("intensity", "density"):
            if key in excitation and excitation["kind"] == "white":
                excitation[key] *= 2.0
        if excitation["kind"] == "psd":
            excitation["level_db"] = 10.0 * math.log10(2.0)


def damping_halved(document: Document) -> None:
    structure = document["structure"]
    structure["damping" if "damping" in structure else "zeta"] *= 0.5


def play_for_clearance(document: Document) -> None:
    for pair in document["impact_pair"]:
        pair["lower"], pair["upper"] = 2.0 * pair["lower"], 2.0 * pair["upper"]


def laws_swapped(document: Document) -> None:
    for pair in document["impact_pair"]:
        pair["lower_law"], pair["upper_law"] = pair["upper_law"], pair["lower_law"]


FAULTS: dict[str, tuple[Change | None, tuple[str, ...]]] = {
    "mirror at the end of the step": (None, ("elastic-half-sigma", "lossy-0.5")),
    "0.5 % of the energy lost per impact": (
        law_changed(lambda r: r * math.sqrt(0.995)), ("elastic-half-sigma", "lossy-0.95")),
    "density twice too large": (
        noise_doubled, ("linear", "elastic-half-sigma", "psd-truck-linear")),
    "R^2 for R": (law_changed(lambda r: r**2), ("lossy-0.95", "lossy-0.5")),
    "half the damping": (damping_halved, ("linear", "elastic-isolator")),
    "total play for clearance": (play_for_clearance, ("elastic-half-sigma", "lossy-half-sigma")),
    "laws of two stops swapped": (laws_swapped, ("lossy-unequal-restitutions",)),
}  # fmt: skip


def answer(change: Change | None, name: str, rel_error: float, seed: int) -> stochvi.Response:
    """What somebody with this mistake finds for a scene."""
    scene = stochvi.verification.zoo(name)[name]
    pairs = truth(name).impact_pairs.values()
    threshold = next((pair["speed_threshold"] for pair in pairs), 0.0)
    if change is None:
        problem = problem_of(scene, name=name, paths=512, speed_threshold=threshold)
        return as_response(
            problem, integrators.end_of_step_mirror(problem, seed), "end-of-step mirror"
        )
    document = scene.document()
    change(document)
    wrong = stochvi.Scene(**document)
    return stochvi.simulate(
        wrong, rel_error=rel_error, seed=seed, threads=1, speed_threshold=threshold
    )


@cache
def truth(name: str) -> stochvi.Response:
    """The certain answer, its rates counted above what `simulate` counts them."""
    scene = stochvi.verification.zoo(name)[name]
    try:
        return stochvi.exact(scene)
    except stochvi.results.NoExactSolution:
        pairs = stochvi.simulate(scene, paths=2, threads=1).impact_pairs.values()
        threshold = next(iter(pairs))["speed_threshold"]
        return stochvi.fokker_planck(scene, rtol=1e-4, speed_threshold=threshold)


def injected(seeds: int, rel_error: float) -> pd.DataFrame:
    """Each fault in its scenes, for several seeds: how often caught, and by what."""
    rows = []
    for name, (change, scenes) in FAULTS.items():
        found = []
        for seed in seeds_of(1, seeds):
            wrong = {
                each: MethodResponses(
                    responses=[truth(each), answer(change, each, rel_error, seed)]
                )
                for each in scenes
            }
            found.append(compare_many(wrong).alarms)
        scores = [
            (row.score or 0.0, row.quantity, each) for alarms in found for each, row in alarms
        ]
        clearest = max(scores, key=lambda entry: abs(entry[0]), default=(0.0, "nothing", ""))
        told = Counter(quantity for _, quantity, _ in scores).most_common(4)
        rows.append(
            {
                "fault": name,
                "scenes": " ".join(FAULTS[name][1]),
                "seeds": seeds,
                "caught": sum(bool(alarms) for alarms in found),
                "alarms_per_seed": len(scores) / seeds,
                "alarmed": " ".join(quantity for quantity, _ in told),
                "clearest": f"{clearest[1]} of {clearest[2]}",
                "clearest_z": clearest[0],
            }
        )
    return pd.DataFrame(rows)
