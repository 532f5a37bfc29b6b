"""Damage of missions. Chapters: the density of equal damage without stops; missions of several
phases; a random test that does the damage in a duration of its own."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.spectra import Table
from stochvi.mathematics.units import shown
from stochvi.results.estimates import Estimate, combined, total
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.damage.equipment import (
    Damage,
    Equipment,
    EquipmentSpectra,
    GaussianEquipment,
    Shocks,
    SpectrumValues,
    TailoredTest,
    ratio_of,
)
from stochvi.statistics.mission_parts import asked_in_parts, complete, said_of_phases

# ------------------------------------------------------------------------------
# The density of a Gaussian acceleration that does a damage to equipment without stops.
# ------------------------------------------------------------------------------


ROUNDS, SAME = 60, 1e-3
"""Largest number of corrections of the equivalent density, and the relative difference of its
damage at which they end."""

MARGIN, LEAST_DENSITY = math.sqrt(2.0), 1e-12
"""The equivalent density is constant to this factor beyond its ends; it is no smaller than this
share of its largest value."""


def equivalent_density(equipment: Equipment, rate: Vector) -> tuple[Vector, Vector, Vector]:
    """One-sided density that does a damage per second without stops, at the frequencies of the
    equipment; the relative difference of its damage that is left; and the bound of the relative
    error of the formula for that damage.

    It begins with that of white noise with this damage, and is corrected by (D / D_now)^(2 / b).
    """
    f, b = np.array(equipment.frequency_hz), equipment.exponent
    narrow = f * 2.0 ** (0.5 * b) * math.gamma(1.0 + 0.5 * b)
    density = (rate / narrow) ** (2.0 / b) * 8.0 * math.pi * f / equipment.quality
    left = error = np.full(len(f), np.inf)
    for _ in range(ROUNDS):
        ends = np.concatenate([f[:1] / MARGIN, f, f[-1:] * MARGIN])
        table = Table(frequency_hz=ends, density=np.pad(density, 1, mode="edge"))
        now, error = GaussianEquipment(table, ends, equipment).damage_rates()
        left, error = np.abs(now / rate - 1.0), error / now
        if np.all(left < SAME):
            break
        density = np.maximum(density * (rate / now) ** (2.0 / b), LEAST_DENSITY * density.max())
    return density, left, error


def equivalent_values(
    equipment: Equipment, damage: SpectrumValues, duration: float
) -> SpectrumValues:
    """The density that does a damage in a duration (s) without stops, with its errors."""
    density, left, formula = equivalent_density(equipment, damage.value / duration)
    share = 2.0 / equipment.exponent
    relative = share * damage.standard_error / damage.value
    bias = share * (damage.bias / damage.value + left + formula)
    return SpectrumValues.of(density, density * relative, density * bias)


# ------------------------------------------------------------------------------
# Damage of a mission of several phases, from the damage of each phase.
#
# Miner's sum adds up over the phases, and mean squares are weighted with their durations. The
# largest response of the mission is the largest one of its phases, which are independent:
#
#     P(largest < a) = product of exp(-exp(-(a - m_k) / s_k)),
#
# each phase with Gumbel's distribution of its own mean and of the width of its 95 % range (E. J.
# Gumbel, Statistics of Extremes, 1958). A cycle that one phase begins and another ends is left out.
# ------------------------------------------------------------------------------


ENDS = (0.025, 0.975)
"""Probabilities that a largest response stays below the ends of its range."""

LEVELS, BEYOND = 2000, 12.0
"""Number of levels at which the largest response is looked at, and how far they reach beyond all
means, in widths of the distributions."""


def of_phases(scene: Scene, ask: Callable[[Scene, float, Run], Damage], run: Run) -> Damage:
    """The damage of all phases of a scene.

    Parameters
    ----------
    ask
        Finds the damage of the scene of a phase, in its duration, by a part of the run.

    Raises
    ------
    NotConverged, Interrupted
        If a phase was not found as accurately as asked for; with the answer of all phases.
    """
    scenes = {phase.name: phase.of(scene) for phase in scene.phases}
    durations = {phase.name: phase.duration for phase in scene.phases}
    found, missing = asked_in_parts(
        run, durations, lambda name, part: ask(scenes[name], durations[name], part)
    )
    answer = together(scene, found, run)
    return complete(answer, missing, run, of="damage of every phase", where="in phase")


def together(scene: Scene, found: Mapping[str, Damage], run: Run) -> Damage:
    """The damage of a mission, from that of its phases."""
    phases = list(found.values())
    first, times = phases[0], np.array([each.mission for each in phases])
    mission = float(times.sum())
    equipment = Equipment(
        tuple(first.equipment_frequency_hz.tolist()), first.quality, first.exponent
    )
    spectra = joint_spectra([each.with_stops for each in phases], times)
    free = [each.without_stops for each in phases if each.without_stops is not None]
    without = joint_spectra(free, times) if len(free) == len(phases) else None
    ways = [", ".join(dict.fromkeys(str(getattr(p, way)) for p in phases)) for way in WAYS]
    rates: dict[str, Any] = {
        name: _averaged([getattr(each, name) for each in phases], times) for name in RATES
    }
    if (hits := rates["impacts_per_hour"]) and hits.upper_95 is not None:
        # nor is their energy known, whatever other phases have
        rates |= dict.fromkeys(RATES[1:])
    above = {
        level: _averaged([each.contacts_above.get(level) for each in phases], times)
        for level in first.contacts_above
    }
    return replace(
        first, mission=mission, with_stops=spectra, without_stops=without,
        damage_ratio=None
        if without is None
        else ratio_of(spectra.fatigue_damage, without.fatigue_damage),
        equivalent_density=equivalent_values(equipment, spectra.fatigue_damage, mission),
        shocks=_largest_shocks([each.shocks for each in phases if each.shocks is not None]),
        contacts_above={level: each for level, each in above.items() if each},
        way=ways[0], way_without=None if without is None else ways[1], test=None,
        **rates, **said_of_phases(scene, found, run, "steps", "paths", "impacts"),
    )  # fmt: skip


WAYS, RATES = (
    ("way", "way_without"), ("impacts_per_hour", "impact_work_per_hour", "impact_loss_per_hour"),
)  # fmt: skip
"""Fields of the answer of a phase that are told together, and those that are averaged."""


def joint_spectra(phases: Sequence[EquipmentSpectra], times: Vector) -> EquipmentSpectra:
    """The spectra of a mission, from those of phases that take so many seconds each."""
    largest, lower, upper = _largest(phases)
    damages = [each.fatigue_damage for each in phases]
    return EquipmentSpectra(
        response_rms=_root_mean_square([each.response_rms for each in phases], times),
        extreme_response=largest, extreme_lower=lower, extreme_upper=upper,
        fatigue_damage=combined(np.sum([each.value for each in damages], axis=0), 1.0, damages),
        cumulative_rms=_root_mean_square([each.cumulative_rms for each in phases], times),
    )  # fmt: skip


def _root_mean_square(values: Sequence[SpectrumValues], times: Vector) -> SpectrumValues:
    """The root of the mean square of independent values, over the time."""
    squares = np.array([each.value for each in values]) ** 2
    root = np.sqrt(np.average(squares, axis=0, weights=times))
    share = (times / times.sum())[:, None] * np.sqrt(squares) / np.maximum(root, 1e-300)
    return combined(root, share, values)


def _largest(phases: Sequence[EquipmentSpectra]) -> tuple[SpectrumValues, Vector, Vector]:
    """The largest response of independent phases at each frequency, and the ends of its range."""
    means = np.array([each.extreme_response.value for each in phases])
    ends = np.array([(each.extreme_lower, each.extreme_upper) for each in phases])
    low, high = (-math.log(-math.log(end)) for end in ENDS)
    width = np.maximum((ends[:, 1] - ends[:, 0]) / (high - low), 1e-9 * means)
    modes = means - np.euler_gamma * width
    first = (modes - 4.0 * width).min(axis=0)
    last = (modes + BEYOND * width).max(axis=0)
    levels = np.linspace(first, last, LEVELS)  # (levels, equipment)
    each = np.exp(-(levels[:, None] - modes) / width)
    below = np.exp(-each.sum(axis=1))
    step = (last - first) / (LEVELS - 1)
    # the share of missions whose largest response comes in each phase: its weight in the mean
    weight = np.sum(each / width * below[:, None], axis=0) * step
    value = first + step * (np.sum(1.0 - below, axis=0) - 0.5 * (1.0 - below[0]))
    lower, upper = (
        np.array([np.interp(end, *pair) for pair in zip(below.T, levels.T, strict=True)])
        for end in ENDS
    )
    return combined(value, weight, [each.extreme_response for each in phases]), lower, upper


def _largest_shocks(shocks: Sequence[Shocks]) -> Shocks | None:
    """At each frequency the shocks of the phase in which they are largest."""
    if not shocks:
        return None
    return Shocks(
        typical=np.max([each.typical for each in shocks], axis=0),
        worst=np.max([each.worst for each in shocks], axis=0),
        window=max(each.window for each in shocks),
        windows=sum(each.windows for each in shocks),
    )


def _averaged(rates: Sequence[Estimate | None], times: Vector) -> Estimate | None:
    """The mean of a rate over the time; None where a phase does not know it."""
    known = [each for each in rates if each is not None]
    if len(known) < len(rates):
        return None
    # energy that was not seen in a phase has no limit
    parts = [each if each.value or each.upper_95 else replace(each, bias=0.0) for each in known]
    how = ", ".join(dict.fromkeys(each.how for each in known if each.value))
    return total(parts, times / times.sum(), how or "none in any phase")


# ------------------------------------------------------------------------------
# A random test that does the fatigue damage of a mission in a duration of its own.
#
# A density whose rms is larger by the factor g does g^b times the damage per second, with the
# exponent b of fatigue. A test that takes T in place of the mission M thus has
#
#     g = (M / T)^(1 / b)
#
# times the rms (the relation of MIL-STD-810H, method 514.8, annex A). Its profile is an envelope
# with few breakpoints: straight in logarithms, and nowhere below the density of equal damage.
# ------------------------------------------------------------------------------


FEWEST_POINTS, MOST_POINTS = 2, 100
"""Smallest and largest number of breakpoints of a profile."""

PENALTIES, PRECISE = (1e-6, 1e3), 1.05
"""Range of the penalty of kinks, per unit of logarithms, and the precision to which it is found."""

STRAIGHT = 1e-6
"""Change of slope, relative to the largest one, up to which there is no kink."""


def check_test(duration: float | None, breakpoints: int) -> None:
    """Raise `ValueError` where no such test can be made."""
    if duration is not None and not 0.0 < duration < math.inf:
        raise ValueError(f"test_duration must be a positive number of seconds, got {duration}")
    if not FEWEST_POINTS <= breakpoints <= MOST_POINTS:
        raise ValueError(
            f"breakpoints must be in [{FEWEST_POINTS}, {MOST_POINTS}], got {shown(breakpoints)}"
        )


def tailored_test(found: Damage, duration: float, breakpoints: int) -> TailoredTest:
    """The test of a duration, s, that does the damage of a mission to its equipment."""
    f = found.equipment_frequency_hz
    equipment = Equipment(tuple(f.tolist()), found.quality, found.exponent)
    equal = equivalent_values(equipment, found.with_stops.fatigue_damage, duration)
    # as wide as the density whose damage is equal
    wide = np.concatenate([f[:1] / MARGIN, f, f[-1:] * MARGIN])
    table = envelope(wide, np.pad(equal.value, 1, mode="edge"), breakpoints)
    steady = GaussianEquipment(table, table.frequency_hz, equipment)
    wear, wear_error = steady.damage_rates()
    largest, _, _ = steady.extremes(duration, (0.5,))
    extremes = found.with_stops.extreme_response
    return TailoredTest(
        duration=duration,
        frequency_hz=table.frequency_hz,
        density=table.density,
        rms=math.sqrt(table.moment(0.0)),
        exaggeration=(found.mission / duration) ** (1.0 / found.exponent),
        equal_density=equal,
        damage_ratio=wear * duration / found.with_stops.fatigue_damage.value,
        damage_ratio_error=wear_error / wear,
        extreme_ratio=largest / extremes.value,
        extreme_ratio_error=extremes.standard_error / extremes.value,
    )


def envelope(frequency_hz: Vector, density: Vector, breakpoints: int) -> Table:
    """A table with at most so many breakpoints that is nowhere below a density at its frequencies.

    In logarithms x and y of frequency and density, z is at least y and minimises

        sum of w (z - y) + penalty * sum of |change of slope of z|

    with the share w of each value in the mean square. Such a z is straight but for few kinks (l1
    trend filtering: S.-J. Kim et al., SIAM Review 51, 2009, 339). The penalty is the smallest that
    leaves no more kinks than asked for; then the levels at the kinks are the lowest, without it.
    """
    if len(density) <= breakpoints:
        return Table(frequency_hz=frequency_hz, density=density)
    x, y = np.log(frequency_hz), np.log(density)
    square = np.exp(y + x - np.max(y + x)) * np.gradient(x)
    share = square / square.sum()
    kept = np.array([0, len(x) - 1])
    low, high = PENALTIES
    while high / low > PRECISE:
        penalty = math.sqrt(low * high)
        kinks = _kinks(x, y, share, penalty)
        if len(kinks) > breakpoints:
            low = penalty
        else:
            kept, high = kinks, penalty
    # each value of the lines as a mean of the levels of the breakpoints around it
    mean = np.array([np.interp(x, x[kept], row) for row in np.eye(len(kept))]).T
    level = _least(share @ mean, -mean, -y)
    return Table(frequency_hz=frequency_hz[kept], density=np.exp(level))


def _kinks(x: Vector, y: Vector, share: Vector, penalty: float) -> NDArray[np.int_]:
    """Numbers of the ends of z, and of the places where its slope changes."""
    count, width = len(x), np.diff(x)
    slopes: Any = scipy.sparse.diags_array(
        [-1.0 / width, 1.0 / width], offsets=[0, 1], shape=(count - 1, count)
    )
    bend: Any = (
        scipy.sparse.diags_array([-1.0, 1.0], offsets=[0, 1], shape=(count - 2, count - 1)) @ slopes
    )
    ones = scipy.sparse.eye_array(count - 2)
    blocks: Any = [[-scipy.sparse.eye_array(count), None], [bend, -ones], [-bend, -ones]]
    rows: Any = scipy.sparse.block_array(blocks)
    limits = np.concatenate([-y, np.zeros(2 * (count - 2))])
    cost = np.concatenate([share, np.full(count - 2, penalty)])
    z = _least(cost, rows, limits)[:count]
    kinked = np.abs(bend @ z) > STRAIGHT * max(float(np.max(np.abs(bend @ z))), STRAIGHT)
    return np.array([0, *(1 + np.flatnonzero(kinked)), count - 1])


def _least(cost: Vector, rows: Any, limits: Vector) -> Vector:
    """The variables of least cost with rows @ variables <= limits."""
    found: Any = scipy.optimize.linprog(cost, A_ub=rows, b_ub=limits, bounds=(None, None))
    return np.asarray(found.x)
