"""Problems that differ from the right one by a common mistake, and whether one of them explains an
answer."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from typing import Any

from stochvi.results.errors import StochviError
from stochvi.results.estimates import Estimate
from stochvi.scenes.scene import Scene
from stochvi.verification.testing.problems import Problem
from stochvi.verification.testing.reference_values import solved, truths_of
from stochvi.verification.testing.samples import Sample

AGREED = 4.0
"""Number of standard errors within which every quantity must lie for a suspected problem to explain
the answer."""

RTOL = 1e-2
"""Relative error asked of the answer to a suspected problem; the error that it reaches is allowed
for."""

Document = dict[str, Any]
Change = Callable[[Document], None]
Judged = tuple[Problem, Sample, Mapping[str, Estimate]]


def suspects_of(measured: Sequence[Judged]) -> Iterator[str]:
    """The mistakes that explain every quantity of every problem with stops that is off.

    Parameters
    ----------
    measured
        Problems with the sample that was returned and the true values.
    """
    wrong = [each for each in measured if not each[0].free and not _explained(each[1], each[2])]
    if not wrong:
        return
    for words, change in SUSPECTS.items():
        if all(_fits(problem, sample, change) for problem, sample, _ in wrong):
            names = ", ".join(problem.name for problem, _, _ in wrong)
            yield f"all that was returned of {names} is right for a problem with {words}"


def _fits(problem: Problem, sample: Sample, change: Change) -> bool:
    """Whether a sample is right for the changed problem."""
    document = problem.scene.expanded.document()
    before = deepcopy(document)
    try:
        change(document)
        if document == before:
            return False
        truth = solved(Scene(**document), problem.speed_threshold, rtol=RTOL)
    except (KeyError, ValueError, ArithmeticError, StochviError):
        return False  # the change makes no sense of this problem, or nothing knows its answer
    return _explained(sample, truths_of(problem, truth))


def _explained(sample: Sample, truths: Mapping[str, Estimate]) -> bool:
    """Whether every quantity of a sample agrees with these values."""
    for name in sample.names():
        if name not in truths:
            continue
        value, error = sample.evaluate(lambda values, name=name: values[name])  # type: ignore[misc]
        allowed = AGREED * error + sample.bias(name) + (truths[name].bias or 0.0)
        if not abs(value - truths[name].value) <= allowed:
            return False
    return True


def _laws_exchanged(document: Document) -> None:
    for pair in document["impact_pair"]:
        pair["lower_law"], pair["upper_law"] = pair["upper_law"], pair["lower_law"]


def _stops_mirrored(document: Document) -> None:
    for pair in document["impact_pair"]:
        for one, other in (("lower", "upper"), ("lower_law", "upper_law")):
            ends = {one: pair.pop(other, None), other: pair.pop(one, None)}
            for key, end in ends.items():
                if end is not None:
                    pair[key] = -end if isinstance(end, float) else end


def _noise(factor: float) -> Change:
    def change(document: Document) -> None:
        for excitation in document["excitation"]:
            if excitation["kind"] == "white":
                key = "intensity" if "intensity" in excitation else "density"
                excitation[key] *= factor
            elif "level_db" in excitation:
                excitation["level_db"] += 10.0 * math.log10(factor)

    return change


def _damping(factor: float) -> Change:
    def change(document: Document) -> None:
        structure = document["structure"]
        for key in ("damping", "zeta"):
            if isinstance(structure.get(key), float):
                structure[key] *= factor

    return change


def _elastic(document: Document) -> None:
    for pair in document["impact_pair"]:
        for key in ("law", "lower_law", "upper_law"):
            if key in pair:
                pair[key]["coefficient"] = 1.0


SUSPECTS: dict[str, Change] = {
    "the restitutions of the lower and the upper stop exchanged": _laws_exchanged,
    "lower and upper stop exchanged (the sign of the displacement is wrong)": _stops_mirrored,
    "twice the noise (a one-sided density for S0)": _noise(2.0),
    "half the noise (S0 taken for a one-sided density)": _noise(0.5),
    "2 pi times the noise (S0 taken for a density per rad/s)": _noise(2.0 * math.pi),
    "the noise divided by 2 pi (a density per rad/s for S0)": _noise(0.5 / math.pi),
    "twice the damping": _damping(2.0),
    "half the damping": _damping(0.5),
    "stops that lose no energy (R = 1)": _elastic,
}
"""Changes of the document of a scene, by the words for the problem that each mistake makes of
it."""
