"""Warnings that concern a scene itself, whatever the method. Commands print them as notes."""

from __future__ import annotations

import math

import numpy as np

from stochvi.mathematics.spectra import response_moments
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.model.coverage import functions
from stochvi.model.model import Model
from stochvi.model.modulation import heavy_tails

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
    """Warnings on a scene that concern every method: those of its excitations; for one mass numbers
    that are probably in a wrong unit, a resonance outside the table, stops out of reach; for
    several coordinates modes below the tables."""
    known = [*model.cautions, *heavy_tails(model)]
    if len(model.coordinates) > 1:
        return [*known, *_modes_below_tables(model)]
    if model.rates is None or model.omega == 0.0 or model.damping_rate == 0.0:
        return known
    found = known
    tables = model.acceleration_tables
    shaken = math.sqrt(sum(table.mean_square() for table in tables)) / STANDARD_GRAVITY
    if shaken > LARGEST_INPUT and model.moving_base and not model.noise_on_mass:
        found.append(
            f"the base is shaken with {shaken:.3g} g rms, more than any usual test "
            f"({LARGEST_INPUT:g} g rms): check the unit of the density, and its band"
        )
    theta = model.intensity / (2.0 * model.damping_rate)
    linear = response_moments(tables, model.omega, model.damping_rate)
    displacement = linear.displacement + theta / model.omega**2
    velocity = linear.velocity + theta
    for filtered in model.filters:
        moments = filtered.response_moments(model.omega, model.damping_rate)
        displacement, velocity = displacement + moments[0], velocity + moments[1]
    natural = model.omega / (2.0 * math.pi)
    ratio = model.damping_rate / (2.0 * model.omega)
    if ratio > 1.0:
        found.append(
            f"the damping ratio zeta is {ratio:.3g}, above critical: 10 % of critical is zeta = 0.1"
        )
    if tables and not theta and not model.filters:
        low = min(float(table.frequency_hz[0]) for table in tables)
        high = max(float(table.frequency_hz[-1]) for table in tables)
        if not low <= natural <= high:
            found.append(
                f"the natural frequency {natural:.4g} Hz lies outside the table ({low:g} to "
                f"{high:g} Hz): the response depends on excitation that the table does not hold"
            )
    stops = [stop.position for stop in model.stops]
    crossing = math.sqrt(velocity / displacement) / (2.0 * math.pi) if displacement else 0.0
    if stops and crossing > BROAD_VELOCITY * natural:
        found.append(
            f"the response without stops crosses zero at {crossing:.3g} Hz, well above the natural "
            f"frequency {natural:.3g} Hz: one impact can start a cluster, so Rice's rate and "
            "linearisation may be wrong by large factors; simulate it"
        )
    deviation = math.sqrt(displacement)
    nearest = min((abs(stop - model.rest) for stop in stops), default=0.0)
    if deviation and nearest > FAR_STOPS * deviation:
        found.append(
            f"the nearest stop lies {nearest / deviation:.3g} standard deviations away "
            f"({deviation:.3g} m without stops); positions are in metres"
        )
    return found


def _modes_below_tables(model: Model) -> list[str]:
    """A warning of modes that move a gap and lie below the first frequency of all tables, where
    tables alone shake the structure.

    The tables hardly excite such a mode, but impacts do: it then swings wider than the gap.
    """
    if functions(model) or not model.pairs or not model.modal.tables:
        return []
    form = model.modal
    if form.kicked or np.any(form.signal_noise):
        return []
    low = min(float(table.frequency_hz[0]) for table, _ in form.tables)
    moves = np.any(np.abs(form.gaps) > MOVED * np.abs(form.gaps).max(), axis=0)
    frequencies = np.sqrt(np.maximum(form.squares, 0.0)) / (2.0 * math.pi)
    found = [f"{f:.3g}" for f in frequencies[moves & (frequencies > 0.0) & (frequencies < low)]]
    if not found:
        return []
    which = "modes lie" if len(found) > 1 else "mode lies"
    return [
        f"{len(found)} {which} below the tables, which begin at {low:g} Hz: {', '.join(found)} Hz. "
        "Impacts can pump such a mode, so that linear numbers and Rice's rate may be too low by "
        "large factors; simulate it"
    ]
