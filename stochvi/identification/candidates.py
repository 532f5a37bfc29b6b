"""Laws that a stop may follow, as functions of numbers that are of the order of 1 in a test."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from stochvi.identification.measurements import (
    DropRecord,
    ForceCurve,
    Measurement,
    Rebounds,
    Scale,
)
from stochvi.mathematics.arrays import Vector
from stochvi.scenes.impact_laws import (
    Elastic,
    Hertz,
    ImpactLaw,
    PowerLaw,
    Restitution,
    RigidLaw,
    SpeedRestitution,
    Viscoelastic,
)
from stochvi.scenes.impact_laws.bodies import (
    hunt_crossley_restitution,
    viscoelastic_restitution,
    yielding_restitution,
)
from stochvi.scenes.impact_laws.speed_restitution import LEAST, Body

MOST_LOSS = 10.0
"""Largest force of a loss that is fitted, at the usual deflection and speed, over the usual force;
with it the mass hardly comes back."""

STEEPEST = 12.0
"""Largest exponent of a force that is fitted."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A law with free numbers.

    Parameters
    ----------
    name
        Name of the law.
    words
        Its formula.
    start, low, high
        First guess and limits of its numbers, in units of the test.
    numbers
        The numbers in SI units, by their names with units, from those in units of the test.
    law
        The law of those numbers in SI units.
    body
        The `body` of a restitution that depends on the speed, in a scene file.
    """

    name: str
    words: str
    start: Sequence[float]
    low: Sequence[float]
    high: Sequence[float]
    numbers: Callable[[Vector, Scale], dict[tuple[str, str], float]]
    law: Callable[[Vector, Scale], ImpactLaw]
    body: Body | None = None


def candidates_of(test: Measurement) -> list[Candidate]:
    """The laws that a test may tell apart, those of the fewest numbers first."""
    if isinstance(test, Rebounds):
        return RIGID
    dynamic = isinstance(test, DropRecord) or (
        isinstance(test, ForceCurve) and test.speed is not None
    )
    found = [*SPRINGS, *DAMPED] if dynamic else SPRINGS
    return sorted(found, key=lambda each: len(each.start))


# ---- rigid stops ----------------------------------------------------------------------------


def _by_speed(
    name: str, words: str, body: Body, key: tuple[str, str], start: float,
    number: Callable[[float, Scale], float], at: Callable[[float, Vector], Vector],
) -> Candidate:  # fmt: skip
    """A restitution that depends on the speed over that of the test, by one number."""
    return Candidate(
        name=name, words=words, start=(start,), low=(0.0,), high=(np.inf,),
        numbers=lambda p, scale: {key: number(float(p[0]), scale)},
        law=lambda p, scale: SpeedRestitution(
            coefficient=lambda w, p=float(p[0]), w0=scale.speed: at(p, w / w0)
        ),
        body=body,
    )  # fmt: skip


RIGID = [
    Candidate(
        name="constant", words="R",
        start=(0.5,), low=(0.0,), high=(1.0,),
        numbers=lambda p, scale: {("R", ""): float(p[0])},
        law=lambda p, scale: Restitution(coefficient=float(p[0])),
    ),
    _by_speed(
        "viscoelastic body", "1 - 1.15 b w^(1/5) + ..., Kuwabara and Kono", "viscoelastic",
        ("b", "(s/m)^(1/5)"), 0.3, lambda p, scale: p * scale.speed**-0.2,
        lambda p, ratio: viscoelastic_restitution(p * ratio**0.2),
    ),
    _by_speed(
        "Hunt and Crossley", "1 - (2/3) a w + ...", "hunt-crossley",
        ("a", "s/m"), 0.3, lambda p, scale: p / scale.speed,
        lambda p, ratio: hunt_crossley_restitution(p * ratio),
    ),
    _by_speed(
        "yielding body", "(w_y / w)^(1/4) above w_y", "yielding",
        ("w_y", "m/s"), 0.1, lambda p, scale: p * scale.speed,
        lambda p, ratio: yielding_restitution(ratio / max(p, 1e-12)),
    ),
    Candidate(
        name="power of the speed", words="R_0 (w / w_0)^q, w_0 the mean speed of the test",
        start=(0.5, 0.0), low=(0.0, -2.0), high=(1.0, 2.0),
        numbers=lambda p, scale: {
            ("R_0", ""): float(p[0]), ("q", ""): float(p[1])
        },
        law=lambda p, scale: SpeedRestitution(
            coefficient=lambda w, r=float(p[0]), q=float(p[1]), w0=scale.speed: np.clip(
                r * (w / w0) ** q, 0.0, 1.0
            )
        ),
        body="power",
    ),
]  # fmt: skip
"""Laws of the restitution over the speed w."""


# ---- compliant stops ------------------------------------------------------------------------


def _force(
    name: str, words: str, exponent: float | None, loss: float | str | None = None
) -> Candidate:
    """The force k y^n + c y^m y', with n free if it is None; `loss` is m, or "n" for m = n."""
    free, lossy = exponent is None, loss is not None

    def parts(p: Vector, scale: Scale) -> tuple[float, float, float, float]:
        n = float(p[1]) if exponent is None else exponent
        m = n if loss == "n" else float(loss or 0.0)
        deep, force, speed, _ = scale
        c = float(p[-1]) * force / (deep**m * speed) if lossy else 0.0
        return float(p[0]) * force / deep**n, n, c, m

    def numbers(p: Vector, scale: Scale) -> dict[tuple[str, str], float]:
        k, n, c, m = parts(p, scale)
        found = {("k", "N/m" if n == 1.0 else f"N/m^{n:.3g}"): k}
        if free:
            found = {("k", "N/m^n"): k, ("n", ""): n}
        if lossy:
            power = "n + 1" if free else f"{m + 1.0:g}"
            found["c", "N s/m" if power == "1" else f"N s/m^({power})"] = c
        return found

    def law(p: Vector, scale: Scale) -> PowerLaw:
        k, n, c, m = parts(p, scale)
        return PowerLaw(
            coefficient=max(k, 1e-300), exponent=n, loss=c, loss_exponent=m if lossy else n
        )

    return Candidate(
        name=name, words=words,
        start=(1.0, *((1.5,) if free else ()), *((0.2,) if lossy else ())),
        low=(1e-6, *((1.0,) if free else ()), *((0.0,) if lossy else ())),
        high=(np.inf, *((STEEPEST,) if free else ()), *((MOST_LOSS,) if lossy else ())),
        numbers=numbers, law=law,
    )  # fmt: skip


SPRINGS = [
    _force("elastic", "k y", 1.0),
    _force("Hertz", "k y^(3/2)", 1.5),
    _force("power", "k y^n", None),
]
"""Forces without a loss."""

DAMPED = [
    _force("Kelvin-Voigt", "k y + c y'", 1.0, 0.0),
    _force("Hunt and Crossley", "k y^(3/2) + c y^(3/2) y'", 1.5, 1.5),
    _force("viscoelastic body", "k y^(3/2) + c y^(1/2) y', Kuwabara and Kono", 1.5, 0.5),
    _force("power with a loss", "k y^n + c y^n y'", None, "n"),
]
"""Forces with a loss."""


def by_speed(law: RigidLaw, body: Body, exponent: float, speed: float) -> ImpactLaw:
    """The law of the same restitutions as scene files have it, by that at a speed, m/s."""
    value = float(law.restitution_at([speed])[0])
    if value < LEAST:
        return Restitution(coefficient=value)
    power = exponent if body == "power" else None
    return SpeedRestitution(coefficient=value, at_speed=speed, body=body, exponent=power)


def as_written(law: ImpactLaw, mass: float | None) -> ImpactLaw:
    """The law of the same force that scene files have a kind for; a damping ratio needs a mass."""
    if not isinstance(law, PowerLaw):
        return law
    if law.exponent == 1.0 and law.conservative:
        return Elastic(stiffness=law.coefficient)
    if law.exponent == 1.5 and law.conservative:
        return Hertz(coefficient=law.coefficient)
    if (law.exponent, law.loss_exponent) == (1.0, 0.0) and mass is not None:
        ratio = law.loss / (2.0 * (law.coefficient * mass) ** 0.5)
        return Viscoelastic(stiffness=law.coefficient, damping_ratio=ratio, mass=mass)
    return law
