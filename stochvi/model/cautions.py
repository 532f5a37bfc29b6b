"""What a user should know of a scene before believing any number: printed as notes."""

from __future__ import annotations

import math

from stochvi.mathematics.spectra import response_moments
from stochvi.scenes.scene import System

FAR_STOPS = 20.0
"""Clearance in standard deviations from which a slip of units is likelier than intent."""

BROAD_VELOCITY = 1.5
"""Zero-crossing frequency over natural frequency from which single hits start bursts."""


def scene_notes(system: System) -> list[str]:
    """Warnings that concern every method: resonance off the table, stops out of reach."""
    if system.omega == 0.0 or system.damping_rate == 0.0:
        return []
    found = []
    theta = system.intensity / (2.0 * system.damping_rate)
    linear = response_moments(system.tables, system.omega, system.damping_rate)
    displacement = linear.displacement + theta / system.omega**2
    velocity = linear.velocity + theta
    for filtered in system.filters:
        moments = filtered.response_moments(system.omega, system.damping_rate)
        displacement, velocity = displacement + moments[0], velocity + moments[1]
    natural = system.omega / (2.0 * math.pi)
    ratio = system.damping_rate / (2.0 * system.omega)
    if ratio > 1.0:
        found.append(
            f"the damping ratio zeta is {ratio:.3g}, above critical: 10 % of critical is zeta = 0.1"
        )
    if system.tables and not theta and not system.filters:
        low = min(float(table.frequency_hz[0]) for table in system.tables)
        high = max(float(table.frequency_hz[-1]) for table in system.tables)
        if not low <= natural <= high:
            found.append(
                f"the natural frequency {natural:.4g} Hz lies outside the table ({low:g} to "
                f"{high:g} Hz): the response depends on what the table leaves out"
            )
    stops = [stop for stop in (system.lower, system.upper) if stop is not None]
    crossing = math.sqrt(velocity / displacement) / (2.0 * math.pi) if displacement else 0.0
    if stops and crossing > BROAD_VELOCITY * natural:
        found.append(
            f"the response without stops crosses zero at {crossing:.3g} Hz, well above the natural "
            f"frequency {natural:.3g} Hz: one hit can start a burst of hits, so Rice's rate and "
            "linearisation may be wrong by large factors; simulate"
        )
    rest = system.load / system.omega**2
    deviation = math.sqrt(displacement)
    nearest = min((abs(stop - rest) for stop in stops), default=0.0)
    if nearest > FAR_STOPS * deviation:
        found.append(
            f"the nearest stop lies {nearest / deviation:.3g} standard deviations away "
            f"({deviation:.3g} m without stops); positions are in metres"
        )
    return found
