"""The law of a stop, fitted to a test."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from stochvi.identification.answer import Identification, LawFit
from stochvi.identification.candidates import Candidate, as_written, by_speed, candidates_of
from stochvi.identification.fitting import Fit, errors_of, fit
from stochvi.identification.measurements import DropRecord, ForceCurve, Measurement, Rebounds
from stochvi.model.calculations import calculation
from stochvi.results.estimates import Cost, Estimate, provenance
from stochvi.scenes.impact_laws import (
    CompliantLaw,
    ImpactLaw,
    Restitution,
    RigidLaw,
    SpeedRestitution,
)
from stochvi.scenes.scatter import Scatter

LEVEL = 0.05
"""Probability below which a law is rejected."""

SPARE = 2
"""Number of observations that are needed beyond the numbers of a law, so that laws are compared;
the first law alone is fitted with one."""

CORRELATED = 3.0
"""Inflation of variances by correlated residuals from which a note tells of it."""


@calculation
def identify(test: Measurement, *, at_speed: float | None = None) -> Identification:
    """Fit the laws of a stop to a test of it, and tell which one the test supports.

    Each law is fitted by least squares. A law is rejected if the one of the smallest AICc (Hurvich
    and Tsai 1989) explains more of its residuals than scatter would: the P test of Davidson and
    MacKinnon (1981), at 5 %. The law with the fewest numbers is taken from those that are left. A
    law of more numbers than the test carries is not fitted.

    Parameters
    ----------
    test
        `Rebounds`, also those of times of impacts; a `ForceCurve`; or a `DropRecord`.
    at_speed
        Speed, m/s, by whose restitution one that depends on the speed is written into the line for
        a scene file; by default the mean speed of the test.

    Returns
    -------
    Identification
        The laws with their numbers and standard errors, and the line of a scene file.

    Raises
    ------
    ValueError
        If the test has too few rows for any law.

    See Also
    --------
    stochvi.identification.read_test : A test from a file.
    stochvi.Viscoelastic : A stop of rubber.

    Examples
    --------
    >>> from stochvi.identification import Rebounds
    >>> test = Rebounds(approach=[0.5, 1.0, 1.5, 2.0], rebound=[0.36, 0.69, 1.06, 1.39])
    >>> found = identify(test)
    >>> found.chosen, found.line
    ('constant', 'law = { kind = "restitution", coefficient = 0.703 }')
    """
    if not isinstance(test, Measurement):
        raise ValueError(
            f"test must be Rebounds, a ForceCurve or a DropRecord, got {type(test).__name__}"
        )
    if at_speed is not None and not 0.0 < at_speed < math.inf:
        raise ValueError(f"at_speed must be a positive speed (m/s), got {at_speed:g}")
    began = time.perf_counter()
    known, left_out = _carried(test)
    errors = errors_of(known[-1], test)
    fits = [fit(each, test, errors) for each in known]
    closest = min(fits, key=lambda each: float(each.residuals @ each.residuals))
    criteria = [each.aicc(closest.inflation) for each in fits]
    best = fits[int(np.argmin(criteria))]
    rejected = [None if each is best else each.rejected_by(best) for each in fits]
    kept = [
        (len(each.numbers), criterion, number)
        for number, (each, criterion, p) in enumerate(zip(fits, criteria, rejected, strict=True))
        if p is None or p >= LEVEL
    ]
    chosen = fits[min(kept)[-1]]
    mass = getattr(test, "mass", None)
    law, body = chosen.law, chosen.candidate.body
    if body is not None and isinstance(law, RigidLaw):
        exponent = float(chosen.numbers[chosen.own - 1])
        law = by_speed(law, body, exponent, at_speed or test.scale.speed)
    else:
        law = as_written(law, mass)
    least = min(criteria)
    told = {
        each.candidate.name: _told(each, criterion - least if least < math.inf else 0.0, p)
        for each, criterion, p in zip(fits, criteria, rejected, strict=True)
    }
    return Identification(
        test=test, fits=told, chosen=chosen.candidate.name, law=law,
        line=_line(law), of_test=_of_test(chosen), curve=_curve(test, fits),
        loop=_loop(test, chosen), assumptions=test.assumptions,
        warnings=_warnings(chosen, [fits[number] for *_, number in kept], left_out, law, test),
        cost=Cost(wall_time=time.perf_counter() - began), provenance=provenance({}),
    )  # fmt: skip


def _carried(test: Measurement) -> tuple[list[Candidate], list[Candidate]]:
    """The laws whose numbers a test carries, and those with too many numbers."""
    count, own = len(test.observed), len(test.start)
    distinct = len(np.unique(np.round(np.log(np.abs(test.place) + 1e-300), 6)))
    every = candidates_of(test)
    known = [
        each
        for each in every
        if len(each.start) + own + SPARE <= count and len(each.start) <= distinct
    ]
    if not known:
        known = [each for each in every[:1] if len(each.start) + own < count]
    if not known:
        raise ValueError(
            f"test must have at least {2 + own} observations, got {count}; measure more"
        )
    return known, [each for each in every if each not in known]


def _told(found: Fit, criterion: float, rejected: float | None) -> LawFit:
    si = found.candidate.numbers(found.numbers[: found.own], found.test.scale)
    errors = found.standard_errors()
    return LawFit(
        formula=found.candidate.words,
        numbers={
            name: Estimate(value=value, standard_error=float(error), how="fit")
            for ((name, _), value), error in zip(si.items(), errors, strict=False)
        },
        units=dict(list(si)),
        residual=float(np.std(found.test.observed - found.fitted)),
        criterion=criterion, rejected=rejected,
    )  # fmt: skip


def _of_test(found: Fit) -> Mapping[str, Estimate]:
    """Numbers of the test itself."""
    errors = found.standard_errors()[len(found.numbers) - len(found.test.start) :]
    values = found.extra
    return {
        name: Estimate(value=float(value), standard_error=float(error), how="fit")
        for name, value, error in zip(found.test.start, values, errors, strict=True)
    }


def _curve(test: Measurement, fits: list[Fit]) -> Any:
    import pandas as pd

    columns = {"place": test.place, "observed": test.observed}
    columns |= {each.candidate.name: each.fitted for each in fits}
    return pd.DataFrame(columns)


def _loop(test: Measurement, found: Fit) -> Any:
    import pandas as pd

    if not isinstance(test, DropRecord):
        return None
    law = found.law
    assert isinstance(law, CompliantLaw)
    y, v, force = test.motion(law, found.extra)
    return pd.DataFrame(
        {"deflection": y, "speed": v, "force": force, "law": law.force_at(y, v, test.mass)}
    )


def _line(law: ImpactLaw) -> str:
    """The law as a line of a scene file, with the digits that a test carries."""
    if isinstance(law, SpeedRestitution):
        power = "" if law.exponent is None else f", exponent = {law.exponent:.3g}"
        return (
            f'law = {{ kind = "{law.kind}", coefficient = {law.restitution:.3g}, at_speed = '
            f'{law.at_speed:.3g}, body = "{law.body}"{power} }}'
        )
    if isinstance(law, Restitution):
        return f'law = {{ kind = "restitution", coefficient = {law.restitution:.3g} }}'
    given = {
        name: value
        for name, value in law.model_dump(exclude_defaults=True).items()
        if isinstance(value, float)
    }
    if given.get("loss_exponent") == law.model_dump().get("exponent"):
        given.pop("loss_exponent", None)
    keys = "".join(f", {name} = {value:.4g}" for name, value in given.items())
    return f'law = {{ kind = "{law.kind}"{keys} }}'


def _warnings(
    chosen: Fit, kept: list[Fit], left_out: list[Candidate], law: ImpactLaw, test: Measurement
) -> tuple[str, ...]:
    notes = []
    others = [each for each in kept if each is not chosen]
    alike = [each.candidate.name for each in others if each.own <= chosen.own]
    larger = [each.candidate.name for each in others if each.own > chosen.own]
    if alike:
        notes.append(
            f"the test does not tell {chosen.candidate.name} from {', '.join(alike)}; a wider "
            f"range of {'speeds' if isinstance(test, Rebounds) else 'deflections'} would"
        )
    if larger:
        notes.append(
            f"{', '.join(larger)} fits no better: the test does not carry a further number"
        )
    if left_out:
        names = ", ".join(each.name for each in left_out)
        notes.append(
            f"{len(test.observed)} observations do not carry the numbers of {names}, which was "
            "not fitted"
        )
    if isinstance(test, Rebounds):
        notes += _of_rebounds(chosen, law)
    if isinstance(test, ForceCurve) and test.speed is None:
        notes.append("a slow press shows no loss: the line is that of a stop without one")
    if getattr(test, "mass", 1.0) is None and getattr(law, "loss_exponent", None) == 0.0:
        notes.append("with a mass the line is that of a viscoelastic stop and its damping ratio")
    if chosen.inflation > CORRELATED:
        notes.append(
            "neighbouring residuals are alike: the law is wrong in a part of the curve, or the "
            f"sensor is slow; standard errors are widened by {math.sqrt(chosen.inflation):.2g}"
        )
    return tuple(notes)


def _of_rebounds(chosen: Fit, law: ImpactLaw) -> list[str]:
    """Notes to a restitution: its dependence on the speed, and its scatter."""
    if isinstance(law, SpeedRestitution):
        return [
            "methods for a constant restitution take that of the speed in the line: "
            f'{{ kind = "restitution", coefficient = {law.restitution:.3g} }}'
        ]
    assert isinstance(law, Restitution)
    spread = float(np.std(chosen.test.observed - chosen.fitted, ddof=1))
    if chosen.errors.root is not None or not spread > 0.0:
        return []
    try:
        Restitution(coefficient=Scatter(mean=law.restitution, std=spread))
    except ValueError:
        return []
    return [
        f"impacts scatter by {spread:.2g}; if it is the stop that scatters, and not the "
        f"measurement: coefficient = {{ mean = {law.restitution:.3g}, std = {spread:.2g} }}"
    ]
