"""Contacts as the engine integrates them: the formulas of free contacts, and lanes side by side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stochvi import Elastic, ForceFunction, ForceTable, PowerLaw, Restitution, Viscoelastic
from stochvi.engine.alone import finish_alone, make_workspace
from stochvi.engine.compiled_laws import functions_of, stops_of
from stochvi.engine.contacts import Tally
from stochvi.engine.impact_log import COLUMNS, Log
from stochvi.engine.pushes import V1, responses_of
from stochvi.engine.sums import (
    ENDED,
    IMPULSE,
    LOSS,
    PEAK,
    ROWS_OF_CONTACT_PAIR,
    ROWS_OF_PAIR,
    ROWS_OF_STOP,
    TIME,
)
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.model.model import model_of
from stochvi.scenes import Hertz
from stochvi.scenes.impact_laws import Law
from support.mounts import two_stages

LAWS = {
    "viscoelastic": (Viscoelastic(stiffness=1.0, damping_ratio=0.2), 4e-5),
    "overdamped nearly": (Viscoelastic(stiffness=1.0, damping_ratio=0.8), 4e-5),
    "elastic": (Elastic(stiffness=1.0), 4e-5),
    "Hertz": (Hertz(coefficient=1.0), 4e-5),
    # the parabola through the forces of a sub-step is of third order where the force depends on v
    "function": (ForceFunction(force=lambda y, v: y**1.4 * (1.0 + 0.3 * v)), 4e-4),
    "Hunt and Crossley": (PowerLaw(coefficient=1.0, exponent=1.4, loss=0.3), 4e-4),
    # the loss starts as the root of the deflection
    "Kuwabara and Kono": (PowerLaw(coefficient=1.0, loss=0.1, loss_exponent=0.5), 4e-4),
    # a sub-step that holds a knot is of third order
    "table": (ForceTable(deflection=[0.5, 1.0], force=[0.2, 3.0]), 2e-3),
}
"""A law with the largest relative error of a free contact in sub-steps of CONTACT_ANGLE."""


def free_contact(law: Law, speed: float, distance: float) -> dict[str, float]:
    """What a free mass of 1 kg does that starts before an upper stop at 0 and hits it."""
    step = 30.0
    stops, laws = stops_of(np.array([[-np.inf, 0.0]]), np.zeros(1), {(0, 1): law.compiled()})
    functions = functions_of(laws, lanes=True)
    states, series = np.zeros((1, 2, 6)), np.zeros((1, 1, 3, 6))
    states[0, 0, 1] = states[0, 1, 0] = series[0, 0, 0, 1] = series[0, 0, 1, 0] = 1.0
    responses, work = responses_of(states, series, np.zeros((1, 0, 6))), make_workspace(1, 2, 6)
    work.gaps[:, 0] = [-distance, speed, 0.0, speed * step - distance, speed, 0.0]
    peaks, sums = np.zeros((1, 1, 2)), np.zeros((1, ROWS_OF_CONTACT_PAIR, 1))
    finish_alone(
        step, step, False, 0, 0.0, stops, functions, responses, None, work,
        Tally(peaks, sums, 0, np.uint64(1)), None,
    )  # fmt: skip
    rows, change = sums[0, ROWS_OF_PAIR + ROWS_OF_STOP :, 0], work.change
    assert rows[ENDED] == 1.0
    assert work.gaps[V1, 0] == pytest.approx(speed + change[1])
    return {
        "restitution": -(speed + change[1]) / speed,
        "contact_time": rows[TIME],
        "peak_force": rows[PEAK],
        "impulse": rows[IMPULSE],
        "loss": rows[LOSS],
    }


@pytest.mark.parametrize(("law", "near"), LAWS.values(), ids=LAWS.keys())
def test_a_free_contact_is_that_of_the_contact_formulas(law: Law, near: float) -> None:
    random = np.random.default_rng(1)
    for speed in random.uniform(0.2, 3.0, 20):
        found = free_contact(law, speed, speed * random.uniform(0.5, 2.0))
        truth = law.impact(speed, 1.0)
        for name in ("restitution", "contact_time", "peak_force"):
            assert found[name] == pytest.approx(getattr(truth, name), rel=near), name
        assert found["impulse"] == pytest.approx(speed * (1.0 + truth.restitution), rel=near)
        lost = 0.5 * speed**2 * (1.0 - truth.restitution**2)
        assert found["loss"] == pytest.approx(lost, rel=5.0 * near, abs=1e-12)


def test_a_law_a_thousandth_stiffer_is_told_from_it() -> None:
    """The negative control of the comparison above."""
    found = free_contact(Elastic(stiffness=1.001), 1.0, 1.0)
    assert found["peak_force"] != pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize(
    "second", [Viscoelastic(stiffness=3e5, damping_ratio=0.1), Restitution(coefficient=0.6)]
)
def test_lanes_side_by_side_go_as_lanes_alone(second: Law) -> None:
    """A log is written lane by lane: with one, every path finishes its steps alone."""
    scene = two_stages(Viscoelastic(stiffness=4e5, damping_ratio=0.3), second)
    plan = make_plan(model_of(scene), None, 1.0)
    plan = replace(plan, burn_in=2.0 * plan.step, duration=60.0 * plan.step, blocks=1)
    log = Log(np.empty((10_000, COLUMNS)), np.zeros(1, np.int64), 0.0)
    together, alone = plan.averages(3, 0, 16), plan.averages(3, 0, 16, log=log)
    assert log.count[0] > 50
    # alone, two more terms of the response to a push are taken: (omega t)^4 / 24 of it, and less
    size = np.maximum(np.abs(alone).max(axis=1, keepdims=True), 1e-12)
    np.testing.assert_allclose(together / size, alone / size, rtol=0.0, atol=1e-4)


def two_free_masses(laws: dict[tuple[int, int], Law], gaps: np.ndarray) -> tuple[np.ndarray, ...]:
    """Speeds of two free masses of 1 kg after 40 s, and the rows of sums of both pairs.

    The first mass may touch an upper stop at 0, and the second one the first, at a relative
    displacement of 0. `gaps` are values and rates of both relative displacements.
    """
    step = 40.0
    places = np.array([[-np.inf, 0.0], [-np.inf, 0.0]])
    unit = {at: law.per_unit_mass(1.0 - 0.5 * at[0]).compiled() for at, law in laws.items()}
    stops, chain = stops_of(places, np.zeros(2), unit)
    # a unit change of the speed of either pair changes the speeds of the masses by these
    directions = np.array([[1.0, 0.0], [-0.5, 0.5]])
    relative = directions @ np.array([[1.0, -1.0], [0.0, 1.0]])
    states, series = np.zeros((2, 4, 6)), np.zeros((2, 2, 3, 6))
    states[:, :2, 1] = states[:, 2:, 0] = directions
    series[:, :, 0, 1] = series[:, :, 1, 0] = relative
    responses, work = responses_of(states, series, np.zeros((2, 0, 6))), make_workspace(2, 4, 6)
    (y, v), still = gaps, np.zeros(2)
    work.gaps[:] = [y, v, still, y + step * v, v, still]
    sums = np.zeros((2, ROWS_OF_CONTACT_PAIR, 1))
    finish_alone(
        step, step, False, 0, 0.0, stops, functions_of(chain, lanes=True), responses, None, work,
        Tally(np.zeros((1, 2, 2)), sums, 0, np.uint64(1)), None,
    )  # fmt: skip
    return np.array([v[0], v[0] + v[1]]) + work.change[2:], sums[:, :, 0]


def test_contacts_that_overlap_keep_the_energy() -> None:
    """A contact that ends while another one lasts must push no further."""
    laws = {(0, 1): Elastic(stiffness=1.0), (1, 1): Elastic(stiffness=7.0)}
    random, crowded = np.random.default_rng(2), 0
    for _ in range(30):
        y, v = -random.uniform(0.1, 1.0, 2), random.uniform(0.2, 2.0, 2)
        after, sums = two_free_masses(laws, np.array([y, v]))
        before = np.array([v[0], v[0] + v[1]])
        assert np.sum(after**2) == pytest.approx(np.sum(before**2), rel=2e-4)
        crowded += int(sums[1, ROWS_OF_PAIR + ROWS_OF_STOP + ENDED] > 1.0)
    assert crowded > 5
