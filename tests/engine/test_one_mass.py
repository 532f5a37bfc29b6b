"""Contacts of one mass: in sub-steps, read from tables, and each beside what it stands for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from stochvi import Elastic, ForceFunction, ForceTable, Hertz, Viscoelastic
from stochvi.engine.complete_contacts import DURATION, TABLE_ERROR
from stochvi.engine.law_calls import follow
from stochvi.engine.mass_contacts import CONTACT_ERROR
from stochvi.engine.one_mass import MassStops
from stochvi.engine.sums import (
    ENDED,
    EXTREME,
    FOUND,
    IMPULSE,
    LEFT,
    LOSS,
    PEAK,
    PLACE,
    SPEED,
    TIME,
)
from stochvi.scenes.impact_laws import Law
from support.one_mass import Flown, fly, stops_at

LAWS: dict[str, Law] = {
    "elastic": Elastic(stiffness=1e4),
    "viscoelastic": Viscoelastic(stiffness=1e4, damping_ratio=0.2),
    "overdamped": Viscoelastic(stiffness=1e4, damping_ratio=1.5),
    "table": ForceTable(deflection=[0.01, 0.03, 0.05], force=[10.0, 90.0, 100.0]),
    "Hertz": Hertz(coefficient=1e4),
    "function": ForceFunction(force=lambda y, v: 1e4 * y**1.4 * (1.0 + 0.2 * v)),
}


def followed(
    at: MassStops, stiffness: float, y: float, v: float, seconds: float, pressing: float,
    parts: int,
) -> NDArray[np.float64]:  # fmt: skip
    """A contact with the upper stop, followed for some time in so many parts; what ends in a part
    has all the others left."""
    total, found = np.zeros(EXTREME), np.zeros(FOUND)
    for part in range(parts):
        left = seconds / parts
        follow(at.laws, at.kinds[1], at.numbers, 1, y, v, left, pressing, stiffness, found)
        for row in (IMPULSE, LOSS, TIME):
            total[row] += found[row]
        y, v = found[PLACE], found[SPEED]
        if found[LEFT] > 0.0:
            total[LEFT] = found[LEFT] + left * (parts - part - 1)
            break
    total[PEAK], total[PLACE], total[SPEED] = found[PEAK], y, v
    return total


@pytest.mark.parametrize("name", ["Hertz", "function"])
def test_contacts_in_sub_steps_have_the_error_that_is_stated(name: str) -> None:
    """Beside the same contacts in a thousand parts, each of which is at least one sub-step."""
    random, errors = np.random.default_rng(3), []
    for _ in range(60):
        stiffness = float(random.choice([0.0, 1.0, 10.0 ** random.uniform(-2.0, 3.0)]))
        at = stops_at({1.0: (0.0, LAWS[name])}, stiffness)
        w, pressing = 10.0 ** random.uniform(-1.0, 1.0), random.uniform(-10.0, 10.0)
        whole = followed(at, stiffness, 0.0, w, 1.0, pressing, 1)
        assert whole[LEFT] > 0.0
        lasted = 1.0 - whole[LEFT]
        one, many = (
            followed(at, stiffness, 0.0, w, 1.2 * lasted, pressing, parts) for parts in (1, 1000)
        )
        scale = np.array([w, w * w, many[PEAK], lasted, 1.0, w, lasted])
        errors.append(np.abs(one - many) / scale)
    worst = np.array(errors).max(axis=0)
    assert worst[[IMPULSE, TIME, LEFT]].max() < CONTACT_ERROR
    assert worst[PEAK] < (CONTACT_ERROR if name == "Hertz" else 2.0 * CONTACT_ERROR)
    if name == "Hertz":
        assert worst[SPEED] < 1e-12  # the energy of a ball is kept
    else:
        assert worst[SPEED] < CONTACT_ERROR


@pytest.mark.parametrize("name", LAWS)
def test_a_contact_that_is_read_is_the_one_that_is_followed(name: str) -> None:
    law, stop = LAWS[name], 0.4
    at = stops_at({1.0: (stop, law)}, 1.0)
    unread = at._replace(complete=at.complete._replace(per_cell=-math.inf))
    found = []
    for speed in np.geomspace(0.03, 9.0, 40):
        both = []
        for each in (at, unread):
            flown = Flown.before()
            # to shortly after the contact, when the mass is free
            state = fly(stop - 1e-9, speed, 0.9, 1.0, each, flown)
            both.append(np.concatenate([state, flown.sums[0], flown.peaks[0]]))
        size = np.maximum(np.abs(both[1]), speed * speed * 1e-3)
        found.append(np.max(np.abs(both[0] - both[1]) / size))
        assert flown.contacts(1.0)[ENDED] == 1.0
    # the state after the contact has the error of its end, magnified by the flight
    assert max(found) < 50.0 * TABLE_ERROR
    read = np.isfinite(at.complete.terms[1, :, DURATION, 0])
    assert read.mean() > 0.3, "most contacts of a stiff stop are read"


def test_a_table_with_durations_a_little_too_long_is_noticed() -> None:
    """The negative control of the comparison above."""
    at = stops_at({1.0: (0.4, LAWS["elastic"])}, 1.0)
    terms = at.complete.terms.copy()
    terms[:, :, DURATION] *= 1.0 + 1e-4
    wrong = at._replace(complete=at.complete._replace(terms=terms))
    states = [fly(0.4 - 1e-9, 1.0, 0.9, 1.0, each, Flown.before()) for each in (at, wrong)]
    assert abs(states[0][0] - states[1][0]) > 50.0 * TABLE_ERROR


def test_a_cell_with_a_kink_is_not_read() -> None:
    """A contact that just reaches a knot of the table is followed."""
    law = ForceTable(deflection=[0.01, 0.02], force=[110.0, 1000.0])
    at = stops_at({1.0: (0.0, law)}, 0.0)
    knot = math.sqrt(2.0 * float(law.potential_at(0.01)))
    place = (math.log(knot) - at.complete.first) * at.complete.per_cell
    read = np.isfinite(at.complete.terms[1, :, DURATION, 0])
    assert not read[int(place)] and read[int(place) - 3] and read[int(place) + 8]


def test_what_does_not_end_within_a_step_is_not_read() -> None:
    at = stops_at({1.0: (0.0, Elastic(stiffness=100.0))}, 0.0, step=0.3)
    assert not np.isfinite(at.complete.terms[1, :, DURATION, 0]).any()
    at = stops_at({1.0: (0.0, Elastic(stiffness=100.0))}, 0.0, step=0.32)
    assert np.isfinite(at.complete.terms[1, :, DURATION, 0]).all()
