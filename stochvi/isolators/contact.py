"""Contacts of an isolated mass with a stop, mount and stop together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.model.model import Model
from stochvi.scenes.impact_laws import CompliantLaw

CONTACT_STEPS = 200.0
"""Number of time steps in a contact; its peak is then read off with a relative error of 1e-4."""

TOUCHED = 1e-9
"""Deflection at which a contact begins, in ways of one step: the force of a damper begins with the
contact, and not before it."""


class Contact(NamedTuple):
    """Peak absolute acceleration (m/s^2), deflection of the stop (m), duration (s) and peak force
    per unit mass (N/kg)."""

    peak_acceleration: Vector
    deflection: Vector
    contact_time: Vector
    peak_force: Vector


def contact_on_mount(
    model: Model, law: CompliantLaw, distance: ArrayLike, speed: ArrayLike
) -> Contact:
    """Masses that meet stops `distance` from their mean position at `speed`, the base at rest.

    y'' = -(b y' + omega^2 (distance + y)) - F(y, y') from y = 0, y' = speed until the mass is
    back at y = 0; `law` gives F per unit mass. The peak is that of |y''|, mount and stop together.
    """
    b, stiff = model.damping_rate, model.omega**2
    distance, speed = np.broadcast_arrays(
        np.asarray(distance, dtype=float), np.asarray(speed, dtype=float)
    )
    alone = [law.impact(float(w), 1.0).contact_time for w in (speed.min(), speed.max())]
    # a mount can only shorten a contact, so that none lasts longer than this
    longest = 1.1 * max(alone) + math.pi / model.omega
    step = min(*alone, 1.0 / model.omega) / CONTACT_STEPS

    def total(y: Vector, v: Vector) -> tuple[Vector, Vector]:
        force = law.force_at(y, v)
        return b * v + stiff * (distance + y) + force, force

    y, v = TOUCHED * step * speed, speed.copy()
    inside = np.ones(speed.shape, bool)
    peak, force = total(y, v)
    found = [np.abs(peak), y, np.zeros(speed.shape), force]
    for number in range(math.ceil(longest / step)):
        k1 = -total(y, v)[0]
        k2 = -total(y + 0.5 * step * v, v + 0.5 * step * k1)[0]
        k3 = -total(y + 0.5 * step * v + 0.25 * step**2 * k1, v + 0.5 * step * k2)[0]
        k4 = -total(y + step * v + 0.5 * step**2 * k2, v + step * k3)[0]
        y = y + step * v + step**2 / 6.0 * (k1 + k2 + k3)
        v = v + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        inside &= y > 0.0
        if not inside.any():
            break
        y, v = np.where(inside, y, 0.0), np.where(inside, v, 0.0)  # what is back stays back
        all_forces, force = total(y, v)
        # the force ends within the next step
        pushed = np.where(inside & (force > 0.0), (number + 1.5) * step, 0.0)
        new = (np.abs(all_forces), y, pushed, force)
        found = [
            np.maximum(old, np.where(inside, each, 0.0))
            for old, each in zip(found, new, strict=True)
        ]
    return Contact(*found)


def hardest_contact(
    model: Model, stops: Sequence[tuple[CompliantLaw, ArrayLike]], speed: ArrayLike
) -> Contact:
    """The contact with the largest acceleration among those with several stops, each with its law
    and distance, as `contact_on_mount`."""
    first = stops[0]
    alike = all(law == first[0] and np.array_equal(place, first[1]) for law, place in stops)
    several = [first] if alike else stops
    contacts = [contact_on_mount(model, law, distance, speed) for law, distance in several]
    order = np.argmax([each.peak_acceleration for each in contacts], axis=0)
    return Contact(*(np.choose(order, each) for each in zip(*contacts, strict=True)))
