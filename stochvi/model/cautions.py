"""Warnings that concern a scene itself, whatever the method. Commands print them as notes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.frequency_response import InputMatrix
from stochvi.mathematics.spectra import response_moments
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.model.coverage import functions
from stochvi.model.model import Model
from stochvi.model.modulation import heavy_tails
from stochvi.results.errors import NotApplicable

FAR_STOPS = 20.0
"""Clearance, in standard deviations of the motion without stops, above which a wrong unit is more
likely than intent."""

BROAD_VELOCITY = 1.5
"""Ratio of the zero-crossing frequency to the natural frequency above which a single impact can
start a cluster."""

LARGEST_INPUT = 25.0
"""Acceleration of a base, g rms, above which a wrong unit is more likely than intent. The severest
profile that ships has 14.1 g rms. A density in (m/s2)2/Hz taken for one in g2/Hz makes the rms 9.8
times too large."""


MOVED = 1e-6
"""Share of the largest motion of a gap in any mode below which a mode does not move it."""


def scene_notes(model: Model) -> list[str]:
    """Warnings on a scene that concern every method: those of its excitations; numbers that are
    probably in a wrong unit, damping above critical, resonances outside the tables, stops out of
    reach; for one mass a broad response, for several coordinates modes below the tables."""
    found = [*model.cautions, *heavy_tails(model)]
    one = len(model.coordinates) == 1
    if one and (model.rates is None or model.omega == 0.0 or model.damping_rate == 0.0):
        return found
    if not one and functions(model):
        return found
    motion = _motion_of_one(model) if one else _motion_of_gaps(model)
    return [
        *found, *_loud_input(model), *_overdamped(model), *_outside_tables(model),
        *(_broad(model, motion) if one else _modes_below_tables(model)),
        *_far_stops(model, motion),
    ]  # fmt: skip


class _GapMotion(NamedTuple):
    """The motion of a gap without stops: its name, standard deviations of displacement and
    velocity, and the distances of its stops from the mean."""

    name: str
    displacement: float
    velocity: float
    stops: tuple[float, ...]


def _motion_of_one(model: Model) -> list[_GapMotion]:
    """The motion of one mass."""
    theta = model.intensity / (2.0 * model.damping_rate)
    linear = response_moments(model.acceleration_tables, model.omega, model.damping_rate)
    displacement = linear.displacement + theta / model.omega**2
    velocity = linear.velocity + theta
    for filtered in model.filters:
        moments = filtered.response_moments(model.omega, model.damping_rate)
        displacement, velocity = displacement + moments[0], velocity + moments[1]
    stops = tuple(abs(stop.position - model.rest) for stop in model.stops)
    return [_GapMotion("", math.sqrt(displacement), math.sqrt(velocity), stops)]


def _motion_of_gaps(model: Model) -> list[_GapMotion]:
    """The motion of the gaps of a structure; empty where none is stationary without stops."""
    if not model.pairs:
        return []
    from stochvi.model.free_motion import free_motion  # loads scipy.optimize, which takes a while

    try:
        motion = free_motion(model, with_sines=True)
    except NotApplicable:
        return []
    rows = np.array([pair.direction for pair in model.pairs])
    return [
        _GapMotion(
            pair.name, float(place), float(speed),
            tuple(abs(stop.position - float(mean)) for stop in pair.stops),
        )
        for pair, place, speed, mean in zip(
            model.pairs, *motion.deviations(rows), model.mean_gaps, strict=True
        )
    ]  # fmt: skip


def _loud_input(model: Model) -> list[str]:
    """A warning of an axis of the base whose rms acceleration is beyond every usual test."""
    if not model.base_alone_moves:
        return []
    axes: dict[bytes, float] = {}
    for table, force in model.tables:
        if not isinstance(force, InputMatrix):
            axis = np.asarray(force).tobytes()
            axes[axis] = axes.get(axis, 0.0) + table.mean_square()
    shaken = math.sqrt(max(axes.values(), default=0.0)) / STANDARD_GRAVITY
    if shaken <= LARGEST_INPUT:
        return []
    return [
        f"the base is shaken with {shaken:.3g} g rms, more than any usual test "
        f"({LARGEST_INPUT:g} g rms): check the unit of the density, and its band"
    ]


def _overdamped(model: Model) -> list[str]:
    """A warning of modes with more than critical damping."""
    form = model.modal
    held = form.squares > 0.0
    ratios = np.diag(form.damping)[held] / (2.0 * np.sqrt(form.squares[held]))
    if not np.any(ratios > 1.0):
        return []
    where = " in one mode" if len(model.coordinates) > 1 else ""
    return [
        f"the damping ratio zeta is {ratios.max():.3g}{where}, above critical: 10 % of critical is "
        "zeta = 0.1"
    ]


def _tables_alone(model: Model) -> tuple[float, float] | None:
    """Lowest and highest frequency of the tables that alone shake the structure, Hz; None where
    other noise does, or nothing."""
    form = model.modal
    if not form.tables or form.kicked or np.any(form.signal_noise):
        return None
    ends = np.array([table.frequency_hz[[0, -1]] for table, _ in form.tables])
    return float(ends[:, 0].min()), float(ends[:, 1].max())


def _moving_modes(model: Model) -> Vector:
    """Natural frequencies of the modes that move a gap, or of all without pairs, Hz."""
    form = model.modal
    size = np.abs(form.gaps)
    moves = np.any(size > MOVED * size.max(), axis=0) if size.size else form.squares > 0.0
    return np.asarray(np.sqrt(form.squares[moves & (form.squares > 0.0)]) / (2.0 * math.pi))


def _outside_tables(model: Model) -> list[str]:
    """A warning that the tables hold none of the resonances that move the gaps. The gaps of a
    structure have a warning of their own for resonances below."""
    ends = _tables_alone(model)
    natural = _moving_modes(model)
    if ends is None or not len(natural):
        return []
    low, high = ends
    several, lowest = len(model.coordinates) > 1, float(natural.min())
    if lowest <= high and (several or low <= lowest):
        return []
    which = "lowest natural frequency" if several else "natural frequency"
    return [
        f"the {which} {lowest:.4g} Hz lies outside the table ({low:g} to {high:g} Hz): "
        "the response depends on excitation that the table does not hold"
    ]


def _broad(model: Model, motion: list[_GapMotion]) -> list[str]:
    """A warning of one mass whose response crosses zero far above its natural frequency."""
    ((_, displacement, velocity, stops),) = motion
    natural = model.omega / (2.0 * math.pi)
    crossing = velocity / displacement / (2.0 * math.pi) if displacement else 0.0
    if not stops or crossing <= BROAD_VELOCITY * natural:
        return []
    return [
        f"the response without stops crosses zero at {crossing:.3g} Hz, well above the natural "
        f"frequency {natural:.3g} Hz: one impact can start a cluster, so Rice's rate and "
        "linearisation may be wrong by large factors; simulate it"
    ]


def _far_stops(model: Model, motion: list[_GapMotion]) -> list[str]:
    """A warning of stops that no motion reaches."""
    found = []
    for name, deviation, _, stops in motion:
        nearest = min(stops, default=0.0)
        if deviation and nearest > FAR_STOPS * deviation:
            of = f", {name}" if name else ""
            found.append(
                f"the nearest stop lies {nearest / deviation:.3g} standard deviations away "
                f"({deviation:.3g} m without stops{of}); positions are in metres"
            )
    return found


def _modes_below_tables(model: Model) -> list[str]:
    """A warning of modes that move a gap and lie below the first frequency of all tables, where
    tables alone shake the structure.

    The tables hardly excite such a mode, but impacts do: it then swings wider than the gap.
    """
    ends = _tables_alone(model)
    if ends is None or not model.pairs:
        return []
    low, _ = ends
    frequencies = _moving_modes(model)
    found = [f"{f:.3g}" for f in frequencies[frequencies < low]]
    if not found:
        return []
    which = "modes lie" if len(found) > 1 else "mode lies"
    return [
        f"{len(found)} {which} below the tables, which begin at {low:g} Hz: {', '.join(found)} Hz. "
        "Impacts can pump such a mode, so that linear numbers and Rice's rate may be too low by "
        "large factors; simulate it"
    ]
