"""Damage of a mission of several phases, from the damage of each phase.

Miner's sum adds up over the phases, and mean squares are weighted with their durations. The largest
response of the mission is the largest one of its phases, which are independent:

    P(largest < a) = product of exp(-exp(-(a - m_k) / s_k)),

each phase with Gumbel's distribution of its own mean and of the width of its 95 % range (E. J.
Gumbel, Statistics of Extremes, 1958). A cycle that one phase begins and another ends is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.results.estimates import Estimate, provenance
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.damage.answer import (
    Damage,
    EquipmentSpectra,
    Shocks,
    SpectrumValues,
    ratio_of,
)
from stochvi.statistics.damage.equipment import Equipment
from stochvi.statistics.damage.equivalent import equivalent_values
from stochvi.statistics.mission_parts import INDEPENDENT, asked_in_parts, complete

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
    equipment = Equipment(
        tuple(first.equipment_frequency_hz.tolist()), first.quality, first.exponent
    )
    spectra = joint_spectra([each.with_stops for each in phases], times)
    free = [each.without_stops for each in phases if each.without_stops is not None]
    without = joint_spectra(free, times) if len(free) == len(phases) else None
    return Damage(
        equipment_frequency_hz=first.equipment_frequency_hz, quality=first.quality,
        exponent=first.exponent, mission=float(times.sum()), at=first.at, with_stops=spectra,
        without_stops=without,
        damage_ratio=(
            None if without is None else ratio_of(spectra.fatigue_damage, without.fatigue_damage)
        ),
        equivalent_density=equivalent_values(
            equipment, spectra.fatigue_damage, float(times.sum())
        ),
        shocks=_largest_shocks([each.shocks for each in phases if each.shocks is not None]),
        impacts_per_hour=_averaged([each.impacts_per_hour for each in phases], times),
        contacts_above={
            level: average
            for level in first.contacts_above
            if (average := _averaged([each.contacts_above.get(level) for each in phases], times))
        },
        impact_work_per_hour=_averaged([each.impact_work_per_hour for each in phases], times),
        impact_loss_per_hour=_averaged([each.impact_loss_per_hour for each in phases], times),
        way=", ".join(dict.fromkeys(each.way for each in phases)),
        way_without=(
            None if without is None
            else ", ".join(dict.fromkeys(str(each.way_without) for each in phases))
        ),
        scene_without_mass=first.scene_without_mass,
        assumptions=[
            INDEPENDENT, *dict.fromkeys(one for each in phases for one in each.assumptions)
        ],
        warnings=[
            f"in phase {name}: {one}" for name, each in found.items() for one in each.warnings
        ],
        cost=run.cost(
            steps=sum(each.cost.steps for each in phases),
            paths=sum(each.cost.paths for each in phases),
            impacts=sum(each.cost.impacts for each in phases),
        ),
        provenance=provenance(scene.document(), run.seed),
    )  # fmt: skip


def joint_spectra(phases: Sequence[EquipmentSpectra], times: Vector) -> EquipmentSpectra:
    """The spectra of a mission, from those of phases that take so many seconds each."""
    largest = _largest(phases)
    return EquipmentSpectra(
        response_rms=_root_mean_square([each.response_rms for each in phases], times),
        extreme_response=largest.value, extreme_lower=largest.lower, extreme_upper=largest.upper,
        fatigue_damage=_sum([each.fatigue_damage for each in phases]),
        cumulative_rms=_root_mean_square([each.cumulative_rms for each in phases], times),
    )  # fmt: skip


def _sum(values: Sequence[SpectrumValues]) -> SpectrumValues:
    return SpectrumValues(
        value=np.sum([each.value for each in values], axis=0),
        standard_error=np.linalg.norm([each.standard_error for each in values], axis=0),
        bias=np.sum([each.bias for each in values], axis=0),
    )


def _root_mean_square(values: Sequence[SpectrumValues], times: Vector) -> SpectrumValues:
    """The root of the mean square of independent values, over the time."""
    squares = np.array([each.value for each in values]) ** 2
    root = np.sqrt(np.average(squares, axis=0, weights=times))
    share = (times / times.sum())[:, None] * np.sqrt(squares) / np.maximum(root, 1e-300)
    return SpectrumValues(
        value=root,
        standard_error=np.linalg.norm(share * [each.standard_error for each in values], axis=0),
        bias=np.sum(share * [each.bias for each in values], axis=0),
    )


class LargestOfPhases(NamedTuple):
    """Expected largest response, and the ends of its range."""

    value: SpectrumValues
    lower: Vector
    upper: Vector


def _largest(phases: Sequence[EquipmentSpectra]) -> LargestOfPhases:
    """The largest response of independent phases, at each frequency."""
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
    errors = np.array([each.extreme_response.standard_error for each in phases])
    biases = np.array([each.extreme_response.bias for each in phases])
    return LargestOfPhases(
        SpectrumValues(
            value=value,
            standard_error=np.linalg.norm(weight * errors, axis=0),
            bias=np.sum(weight * biases, axis=0),
        ),
        lower,
        upper,
    )


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
    share = times / times.sum()
    limits = [0.0 if each.upper_95 is None else each.upper_95 for each in known]
    value = float(share @ [each.value for each in known])
    if value == 0.0:
        return Estimate(
            value=0.0, bias=None, how="none in any phase", upper_95=float(share @ limits)
        )
    # what a phase without an impact may hide
    biases = np.array([each.bias or 0.0 for each in known]) + limits
    return Estimate(
        value=value,
        standard_error=float(
            np.linalg.norm(share * [each.standard_error or 0.0 for each in known])
        ),
        bias=float(share @ biases),
        how=", ".join(dict.fromkeys(each.how for each in known if each.value)),
    )
