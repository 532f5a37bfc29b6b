"""Numbers in words, in the units of engineers, with intervals; none is rounded to 0."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from stochvi.isolators.sizing.answer import spoken_mission, spoken_percent
from stochvi.mathematics.shown_units import LENGTH, NUMBER, ShownQuantity
from stochvi.results.estimates import Estimate
from stochvi.views.tables import Heading, value_with_error

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.isolators.sizing.answer import Sizing

UNKNOWN = "not known"

NO_TOLERANCES = (
    "mount, level and stops are exactly as the scene states them: no tolerances were asked for "
    "(--tolerances)"
)
"""Sentence of a page whose clearance holds no tolerances."""

WITHOUT_TOLERANCES = "no tolerances: mount, level and stops are exactly as the scene states them"
"""The same on a terminal."""

OF_ONE_MOUNT = (
    "One direction of motion; no rocking, and no coupling of directions.",
    "A linear spring and a viscous damper: filled rubber is stiffer at small amplitudes, and "
    "softer when warm; take its stiffness at the amplitude of the mission.",
    "The base does not feel the mass.",
)
"""Limits of every page on one mass on its mount."""

MOST_PLACES = 5
"""Largest number of digits after the point; a number that needs more is written with a power of
ten."""


def spoken_length(metres: float) -> str:
    """A length with four significant digits; zeros at the end are kept.

    >>> spoken_length(0.0059712), spoken_length(0.012), spoken_length(1.2345)
    ('5.971 mm', '12.00 mm', '1234 mm')
    """
    return f"{four_digits(LENGTH(metres))} {LENGTH}"


def with_article(words: str) -> str:
    """Words with the indefinite article.

    >>> with_article("impact speed"), with_article("peak acceleration")
    ('an impact speed', 'a peak acceleration')
    """
    return f"{'an' if words[0] in 'aeiou' else 'a'} {words}"


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


def with_error(estimate: Estimate | None) -> str:
    """A value with its standard error in brackets, as on a terminal.

    >>> with_error(Estimate(value=0.43774, standard_error=0.00094)), with_error(None)
    ('0.43774(94)', '-')
    """
    return "-" if estimate is None else value_with_error(estimate)


def count_of(number: float) -> str:
    """A number of things, to three digits.

    >>> count_of(0.25), count_of(12.34), count_of(976.4), count_of(88623.0), count_of(2.5e7)
    ('0.25', '12.3', '976', '88 600', '2.5e+07')
    """
    if not 100.0 <= number < 1e6:
        return f"{number:.3g}"
    return f"{float(f'{number:.3g}'):,.0f}".replace(",", " ")


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


def chance_of_stops(sizing: Sizing) -> str:
    """Probability of any impact with the stops of the scene, in words."""
    chance = sizing.gap.probability
    return UNKNOWN if chance is None else chance_in_words(chance)


def chance_in_words(probability: float) -> str:
    """A probability in per cent; a limit of a tiny one.

    >>> chance_in_words(0.01), chance_in_words(1e-30)
    ('1 %', 'under 1.0e-10 %')
    """
    return spoken_percent(probability) if probability > TINY else f"under {spoken_percent(TINY)}"


TINY = 1e-12
"""Probability below which its value means nothing: no noise is Gaussian as far as that."""


def clearances_of_changes(table: pd.DataFrame) -> dict[str, Heading]:
    """Columns with the clearances of a table of changed scenes, and their headings: one column of
    one mass, one for each sized pair of several."""
    fixed = {"change", "sigma", "clearance_change", "probability", "note"}
    names = [str(name) for name in table if name not in fixed]
    one = names == ["clearance"]
    return {name: ("clearance ()" if one else f"{name} ()", LENGTH) for name in names}


def line_to_copy(stops: str) -> str:
    """The keys of stops, with where they belong and from where they are measured."""
    return f"copy into the scene file (m from the unloaded spring): {stops}"


def places_of_stops(sizing: Sizing) -> str:
    """The line to copy into a scene file, and the probability of an impact on the stops of the
    scene at their places."""
    texts = []
    if copied := sizing.stops_to_copy():
        hangs = f"; {equilibrium_in_words(sizing)}" if sizing.gap.mean_position else ""
        texts.append(line_to_copy(copied) + hangs)
    if stops := sizing.gap.distances:
        distances = " and ".join(f"{LENGTH(distance):.4g}" for distance in stops.values())
        noise = ", for Gaussian noise" if sizing.doubtful else ""
        texts.append(
            f"stops of the scene, {distances} {LENGTH} from the static equilibrium: "
            f"{chance_of_stops(sizing)} in {spoken_mission(sizing.mission)} (any impact{noise})"
        )
    return "\n".join(texts)


def equilibrium_in_words(sizing: Sizing) -> str:
    """The static equilibrium, in words."""
    return (
        f"the static equilibrium is at {LENGTH.text(sizing.gap.mean_position, '+.4g')} from there"
    )
