"""A rough stationary law of a structure with stops, for steps and starts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.cut_normal import CutNormal
from stochvi.mathematics.impact_rates import gaussian_stop
from stochvi.model.gap import Gap
from stochvi.model.gibbs_law import GibbsLaw
from stochvi.model.modal import LinearLaw, ModalForm, Substitute, Vector, linear_law
from stochvi.model.model import Model, Pair
from stochvi.results.errors import NotApplicable
from stochvi.scenes.impact_laws import CompliantLaw

UNSHAKEN = 1e-24
"""A gap counts as at rest if the variance of its speed is below this share of the largest modal
one: what is left there is rounding."""

ITERATIONS = 40
"""Number of times that the springs and dampers in the place of impacts are renewed: they then keep
a few digits, which is enough for steps and starts."""


class PairScale(NamedTuple):
    """The scales of an impact pair, in SI units.

    `speed` is the rms speed of its gap, and `pressing` the acceleration that presses it onto a
    stop, or 0. `slope` and `curvature` are those of the law exp(slope y - curvature y^2 / 2) of
    the gap, and `deviation` is its standard deviation.
    """

    speed: float
    pressing: float
    slope: float
    curvature: float
    deviation: float


def scales_of(
    model: Model, modes: ModalForm, method: str = "simulate", *, giving_way: bool = False
) -> tuple[LinearLaw, tuple[PairScale, ...]] | None:
    """A linear law close to the stationary one, for a method; None where it finds none.

    Every pair is replaced by a spring, which brings mean and variance of the gap to those of a
    normal law cut at the stops, and a damper, which takes the power that restitution takes at
    Rayleigh impact speeds; found by repetition. Stops that give way count as rigid ones of their
    restitution, or, `giving_way`, by the energy that they store.
    """
    substitutes = [_first_guess(modes, pair) for pair in model.pairs]
    scales: tuple[PairScale, ...] = ()
    law = following = linear_law(modes, substitutes)
    for _ in range(ITERATIONS if model.pairs else 0):
        if following is None:  # no spring represents so wide a gap: the last one is kept
            break
        law = following
        found = [
            _substitute(
                modes,
                law,
                pair,
                modes.gaps[j],
                old,
                _without_own_spring(modes, substitutes, j),
                method,
                giving_way,
            )
            for j, (pair, old) in enumerate(zip(model.pairs, substitutes, strict=True))
        ]
        if None in found:
            return None
        substitutes = [each[0] for each in found if each]
        scales = tuple(each[1] for each in found if each)
        following = linear_law(modes, substitutes)
    return None if law is None else (law, scales)


def _first_guess(modes: ModalForm, pair: Pair) -> Substitute:
    frequency = modes.fastest
    stops = [stop.position for stop in pair.stops]
    if frequency == 0.0 and modes.tables:
        # the middle of the band that shakes
        bands = [(table.frequency_hz[0], table.frequency_hz[-1]) for table, _ in modes.tables]
        frequency = 2.0 * math.pi * max(math.sqrt(low * high) for low, high in bands)
    elif frequency == 0.0:
        # no time but that in which noise brings the mass across the gap
        noise = float(np.trace(modes.white)) / pair.mass
        width = max(stops) - min(stops) or abs(stops[0]) or 1.0
        frequency = (noise / width**2) ** (1.0 / 3.0)
    loss = max((1.0 - stop.law.restitution**2 for stop in pair.stops), default=0.0)
    return Substitute(
        spring=pair.mass * frequency**2,
        centre=sum(stops) / len(stops),
        damper=loss * pair.mass * frequency,
    )


def _without_own_spring(
    modes: ModalForm, substitutes: Sequence[Substitute], j: int
) -> tuple[float, float]:
    """Stiffness k and force f of a gap without the spring of its own stops: k y - f pulls it back.

    The static ones: with noise that matches the damping, the law of y is the Gibbs law of them.
    """
    # the soft spring holds a gap that no other spring holds
    gap, soft = modes.gaps[j], SOFTEST * substitutes[j].spring
    stiffness = np.diag(modes.squares) + soft * np.outer(gap, gap)
    forces = modes.falling.copy()
    for other, substitute in enumerate(substitutes):
        if other != j:
            row = modes.gaps[other]
            stiffness += substitute.spring * np.outer(row, row)
            forces += substitute.spring * (substitute.centre - row @ modes.rest) * row
    compliance = float(gap @ np.linalg.solve(stiffness, gap))
    mean = float(gap @ (modes.rest + np.linalg.solve(stiffness, forces)))
    return max(1.0 / compliance - soft, 0.0), mean / compliance


def _substitute(
    modes: ModalForm,
    law: LinearLaw,
    pair: Pair,
    gap: Vector,
    old: Substitute,
    held: tuple[float, float],
    method: str,
    giving_way: bool,
) -> tuple[Substitute, PairScale] | None:
    """The next spring and damper: what the gap's law would be without the old spring, cut; None
    where nothing holds the gap on a side without a stop."""
    square = law.variances(gap, modes.size)
    if not square > UNSHAKEN * law.largest_variance(modes.size):
        raise NotApplicable(
            method,
            [f"no excitation reaches the impact pair {pair.name!r}, or it is pressed so hard onto "
             "a stop that it never leaves it: it is at rest; shake it, move that stop, or take the "
             "pair out of the scene"],
        )  # fmt: skip
    own, force = held
    energy = pair.mass * square
    pressing = max(stop.side * (force - own * stop.position) for stop in pair.stops) / pair.mass
    lifting = _energy_behind(modes, law, pair, gap) if pressing > 0.0 else 0.0
    swinging = max(energy, lifting)
    try:
        cut = _law_of_gap(pair, held, energy, giving_way)
        spread = cut if swinging == energy else _law_of_gap(pair, held, swinging, giving_way)
    except ValueError:
        return None
    needed = swinging / spread.variance
    spring = max(needed - own, SOFTEST * needed)
    power = _power_of_stops(pair, cut, square)
    mixed = Substitute(
        spring=math.sqrt(old.spring * spring),
        centre=(needed * spread.mean - force) / spring,
        damper=0.5 * (old.damper + power / square),
    )
    leans = pressing * math.sqrt(cut.variance) > LEANING * square
    return mixed, PairScale(
        speed=math.sqrt(square),
        pressing=pressing if leans else 0.0,
        slope=force / swinging,
        curvature=own / swinging,
        deviation=math.sqrt(spread.variance),
    )


def _energy_behind(modes: ModalForm, law: LinearLaw, pair: Pair, gap: Vector) -> float:
    """Twice the mean energy, J, of the springs that pull at a gap: a swing behind a mass that is
    pressed onto a stop lifts it where the motion of the mass itself does not."""
    pull = pair.mass * gap * modes.squares
    stiffness = pair.mass * float(pull @ gap)
    return law.variances(pull, 0) / stiffness if stiffness > 0.0 else 0.0


def _law_of_gap(
    pair: Pair, held: tuple[float, float], energy: float, giving_way: bool
) -> CutNormal | GibbsLaw:
    """The law exp(-(k y^2 / 2 - f y) / energy) of a gap that k y - f pulls back, between the stops,
    and within those that give way times exp(-V / energy), V the energy stored there."""
    own, force = held
    gap = Gap.of_pair(
        pair, omega=math.sqrt(own / pair.mass), damping_rate=0.0, load=force / pair.mass
    )
    if giving_way and gap.soft:
        return GibbsLaw.of(gap, theta=energy / pair.mass)
    lower, upper = gap.ends
    return CutNormal(slope=force / energy, curvature=own / energy, lower=lower, upper=upper)


def _power_of_stops(pair: Pair, law: CutNormal | GibbsLaw, square: float) -> float:
    """Power that the stops take, W: (1 - R^2) / 2 F2 of Rayleigh speeds, and c E y'^2 P(contact) of
    a damper."""
    power = 0.0
    for stop in pair.stops:
        if isinstance(law, CutNormal) or stop.rigid:
            hits = gaussian_stop(law.density_at(stop.position), square)
            loss = (1.0 - stop.law.restitution**2) / 2.0
            power += loss * pair.mass * hits.speed_square_rate
        elif isinstance(stop.law, CompliantLaw) and not stop.law.conservative:
            touching = law.contact(stop.name)
            assert touching is not None
            power += stop.law.damping(pair.mass) * square * touching.probability
    return power


LEANING = 0.5
"""A pair leans on a stop if pressing turns over more than this share of its energy within the
spread of its gap. The share is 1 for a mass that lies on the stop."""


SOFTEST = 1e-6
"""Least spring that stands for the stops of a gap, relative to the spring that alone would give the
gap its variance: a gap that hardly meets its stops needs none."""
