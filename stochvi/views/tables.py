"""Numbers and names of tables. Chapters: those that are never cut short; numbers in words."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.mathematics.units import (
    LENGTH,
    NUMBER,
    ShownQuantity,
    spoken_mission,
)
from stochvi.results.base import RESPONSE_QUANTITIES, rows_of
from stochvi.results.estimates import (
    MOST_PLACES,
    NEAR_ONE,
    Estimate,
    count_of,
    spoken_percent,
)

if TYPE_CHECKING:
    from stochvi.isolators.sizing.answer import ClearanceAnswer, Sizing
    from stochvi.model.coverage import NaturalMode

QUANTITY_NAMES = {name: each.words for name, each in RESPONSE_QUANTITIES.items()}
"""Short names of quantities in tables; w is the speed of an impact. The standard deviation of a
displacement leaves out its mean; velocities and accelerations of a stationary motion have none."""


STOP_OF = re.compile(r"(.+ stop) (?:lower|upper) of .+")
"""Pattern of the effect of a stop in a scene of several pairs."""


MOST_NAMED = 4
"""Largest number of stops of one kind that a line names one by one."""


NEGLIGIBLE = 1e-12
"""Share of the standard deviation below which a mean is rounding error, and shown as 0."""


def effects_in_words(effects: Sequence[str]) -> str:
    """Effects of a scene in one line; stops of one kind are counted where they are many.

    >>> effects_in_words(["sine on a", "rigid stop lower", "rigid stop upper"])
    'sine on a; rigid stop lower; rigid stop upper'
    >>> effects_in_words(["sine on a", *(f"rigid stop upper of {n}" for n in range(6))])
    'sine on a; 6 rigid stops'
    """
    kinds = [found[1] if (found := STOP_OF.match(effect)) else effect for effect in effects]
    count = Counter(kinds)
    named: list[str] = []
    for kind, effect in zip(kinds, effects, strict=True):
        if kind == effect or count[kind] <= MOST_NAMED:
            named.append(effect)
        elif (together := f"{count[kind]} {kind}s") not in named:
            named.append(together)
    return "; ".join(named)


def modes_in_rows(modes: Sequence[NaturalMode]) -> list[dict[str, Any]]:
    """A row per mode: frequency, damping, and the mass that it moves along each axis."""
    return [
        {
            "mode": number,
            "Hz": mode.frequency_hz,
            "zeta": None if mode.damping_ratio is None else f"{mode.damping_ratio:.3g}",
            **{
                f"along {axis} (kg)" if axis else "eff. mass (kg)": f"{mass:.3g}"
                for axis, mass in mode.effective_mass.items()
            },
            "motion": mode.motion,
        }
        for number, mode in enumerate(modes, start=1)
    ]


# ------------------------------------------------------------------------------
# Numbers in words, in the units of engineers, with intervals; none is rounded to 0.
# ------------------------------------------------------------------------------


UNKNOWN = "not known"

WITHOUT_TOLERANCES = "Not included: tolerances (--tolerances usual), usually 1.7 to 2 times as much"
"""Sentence of an answer whose clearance holds no tolerances."""


def never_tolerances(stated: str) -> str:
    """That of one that never does, with those that its scene states.

    >>> never_tolerances("level ± 3 dB")
    'Not included: tolerances (level ± 3 dB in the scene), usually 1.7 to 2 times as much'
    """
    return f"{no_tolerances(stated)}, usually 1.7 to 2 times as much"


def no_tolerances(stated: str) -> str:
    """That of an answer that is no clearance."""
    return f"Not included: tolerances{f' ({stated} in the scene)' if stated else ''}"


OF_ONE_MOUNT = (
    "One direction of motion; no rocking, and no coupling of directions.",
    "A linear spring and a viscous damper: filled rubber is stiffer at small amplitudes, and "
    "softer when warm; take its stiffness at the amplitude of the mission.",
    "The base does not feel the mass.",
)
"""Limits of every page on one mass on its mount."""


def spoken_length(metres: float) -> str:
    """A length with four significant digits; zeros at the end are kept.

    >>> spoken_length(0.0059712), spoken_length(0.012), spoken_length(1.2345)
    ('5.971 mm', '12.00 mm', '1234 mm')
    """
    return f"{four_digits(LENGTH(metres))} {LENGTH}"


def four_digits(number: float) -> str:
    """A number with four digits, trailing zeros included."""
    return f"{number:#.4g}".rstrip(".")


def limits_of(low: float, high: float) -> str:
    """Two limits of a length, m; where four digits do not tell them apart, half their distance.

    >>> limits_of(0.01097, 0.01108), limits_of(0.0012173527, 0.0012173552)
    ('10.97 to 11.08 mm', '± 0.0001 %')
    """
    texts = [four_digits(LENGTH(value)) for value in (low, high)]
    if texts[0] == texts[1]:
        return f"± {100.0 * (high - low) / (high + low):.1g} %"
    return f"{texts[0]} to {texts[1]} {LENGTH}"


def with_interval(estimate: Estimate | None, quantity: ShownQuantity = NUMBER) -> str:
    """A value, with its 95 % interval on a second line; an upper limit where nothing was seen.

    >>> with_interval(Estimate(value=0.2498, standard_error=0.0096))
    '0.250\\n0.231 to 0.269'
    """
    if estimate is None:
        return UNKNOWN
    if estimate.upper_95 is not None:
        return f"at most\n{quantity(estimate.upper_95):.2g}"
    half = quantity(estimate.half_width_95())
    value = quantity(estimate.value)
    if half == 0.0:
        return f"{value:.4g}"
    places = 1 - math.floor(math.log10(half))
    if not 0 <= places <= MOST_PLACES:
        return f"{value:.3g}\n{value - half:.3g} to {value + half:.3g}"
    return f"{value:.{places}f}\n{value - half:.{places}f} to {value + half:.{places}f}"


def way_in_words(way: str) -> str:
    """How impacts were found, in the words of the glossary; JSON keys say `bursts`."""
    return way.replace("bursts", "clusters")


def name_of_answer(sizing: Sizing) -> str:
    """Name of the calculated clearance on a page; where a record contradicts the Gaussian noise for
    which it holds, that is said."""
    return "calculated" if sizing.doubtful is None else "for Gaussian noise"


def names_of_places(sizing: Sizing) -> dict[str, str]:
    """Names of the two clearances that a review compares."""
    return {"three_sigma": "3 sigma", "recommended": name_of_answer(sizing)}


def chance_in_words(probability: float) -> str:
    """A probability in per cent; a limit of a tiny one.

    >>> chance_in_words(0.01), chance_in_words(1e-30)
    ('1 %', 'under 1.0e-10 %')
    """
    return spoken_percent(probability) if probability > TINY else f"under {spoken_percent(TINY)}"


TINY = 1e-12
"""Probability below which its value means nothing: no noise is Gaussian as far as that."""


def hit_in_words(probability: float | None) -> str:
    """How likely stops are hit.

    >>> hit_in_words(0.99999), hit_in_words(0.14), hit_in_words(None)
    ('hit almost surely', '14 % likely to be hit', 'not known how likely they are hit')
    """
    if probability is None:
        return "not known how likely they are hit"
    sure = probability > NEAR_ONE
    return "hit almost surely" if sure else f"{chance_in_words(probability)} likely to be hit"


def of_your_stops(sizing: Sizing) -> list[str]:
    """How likely the stops of the scene are hit where they are; none without them."""
    if sizing.several:
        given = sizing.as_given
        if given is None:
            return []
        if given.upper >= 1.0 and given.value <= NEAR_ONE:  # how near to 1 was not found in time
            return [f"Your stops: over {chance_in_words(given.lower)} likely to be hit"]
        return [f"Your stops: {hit_in_words(given.value)}"]
    found = {side: LENGTH.text(each, ".3g") for side, each in sizing.gap.distances.items()}
    beside = {"lower": "below", "upper": "above"}
    places = " and ".join(f"{each} {beside[side]}" for side, each in found.items())
    places += " the static equilibrium"
    if len({*found.values()}) == 1 < len(found):
        places = found["lower"]
    name = "Your stops" if len(found) > 1 else "Your stop"
    return [f"{name}, {places}: {hit_in_words(sizing.gap.probability)}"] if found else []


def of_three_sigma(sizing: Sizing) -> str:
    """How likely stops at three sigma are hit, and how often where that is known."""
    three = sizing.three_sigma
    place = " of every gap" if sizing.several else f", {LENGTH.text(three.clearance, '.3g')}"
    often = ""
    if three.hits is not None and three.hits.value:
        often = f", about {count_of(three.hits.value)} impacts in {spoken_mission(sizing.mission)}"
    return f"Three sigma{place}: {hit_in_words(three.probability.value)}{often}"


def of_less_risk(sizing: Sizing) -> list[str]:
    """What a tenth of the risk takes; none where that is not known."""
    target = sizing.target
    if target.name != "probability" or sizing.varies:
        return []
    (name, nominal) = max(sizing.named.items(), key=lambda each: each[1].value)
    return [
        f"A tenth of the risk needs {LENGTH.text(row[name] - nominal.value, '.2g')} more"
        f"{sizing.of_widest}"
        for row in rows_of(sizing, "required")
        if np.isclose(row["probability"], 0.1 * target.value) and math.isfinite(row[name])
    ]


def to_copy(found: ClearanceAnswer) -> list[str]:
    """The stops to copy into a scene file, with where they belong and from where they are measured;
    none where there is nothing to make."""
    from stochvi.isolators.sizing.answer import (
        UNFELT,  # with the kernels, which a theory is without
    )

    copied = found.stops_to_copy()
    line = f"Copy into the scene file (m from the unloaded spring): {copied}"
    if not found.several and abs(found.rest) > UNFELT:
        line += f"; {equilibrium_in_words(found)}"
    if len(found.each_made) > MOST_NAMED:
        line = f"Copy into the scene file: the stops of {len(found.each_made)} pairs, "
        line += "as the table of -v and of the page lists them"
    return [line] * bool(copied)


def equilibrium_in_words(found: ClearanceAnswer) -> str:
    """The static equilibrium of one mass, in words."""
    return f"the static equilibrium is at {LENGTH.text(found.rest, '+.4g')} from there"
