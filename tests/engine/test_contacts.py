"""Contacts as the engine integrates them: the formulas of free contacts, and lanes side by side."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

import stochvi
from stochvi import Elastic, ForceFunction, ForceTable, PowerLaw, Restitution, Viscoelastic
from stochvi.engine.arithmetic import (
    COLUMNS,
    ENDED,
    IMPULSE,
    LOSS,
    PEAK,
    ROWS_OF_CONTACT_PAIR,
    ROWS_OF_PAIR,
    ROWS_OF_STOP,
    TIME,
    Log,
    uniform_of,
)
from stochvi.engine.calls import (
    functions_of,
    mean_rebound_of,
    rebound_of,
    row_of_numbers,
    stops_of,
)
from stochvi.engine.compiling import kernel
from stochvi.engine.compliant_contacts import Tally, finish_alone, make_workspace
from stochvi.engine.impact_laws import CELLS
from stochvi.engine.parts import is_rigid, rebound
from stochvi.engine.sub_steps import CONTACT_ERROR, V1, held_back, loss_of, responses_of, rub
from stochvi.engine.together import DURATION, TABLE_ERROR
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.scenes import Hertz
from stochvi.scenes.impact_laws import Law
from support import naive
from support.mounts import two_stages
from support.one_mass import Flown, fly, still
from support.rubbing import small_steps

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
    responses, work = responses_of(states, 1, series, np.zeros((1, 0, 6))), make_workspace(1, 2, 6)
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
    responses, work = responses_of(states, 2, series, np.zeros((2, 0, 6))), make_workspace(2, 4, 6)
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


# ------------------------------------------------------------------------------
# Impacts on a stop that rubs: losses, energy, and an integration over the impulse.
# ------------------------------------------------------------------------------


def impact(
    inverse: np.ndarray, w: float, u: float, restitution: float, friction: float
) -> tuple[float, float, float]:
    """Speeds after the impact by `rub`, and the energy that it takes, J; w is into the stop."""
    a, b, c = inverse[0, 0], inverse[0, 1], inverse[1, 1]
    rebound, push, rubbed = rub(w, u, restitution, friction, c / a, b / a, b / c)
    after = np.array([w - push + b / c * rubbed, u - b / a * push + rubbed])
    assert after[0] == pytest.approx(-rebound, abs=1e-9 * (w + abs(u)))
    mass = np.linalg.inv(inverse)
    before = np.array([w, u])
    loss = 0.5 * (before @ mass @ before - after @ mass @ after)
    stated = loss_of(w, u, push, rubbed, c / a, b / c) / a
    assert stated == pytest.approx(loss, abs=1e-9 * (before @ mass @ before))
    return -rebound, float(after[1]), float(loss)


def random_impacts(count: int, seed: int):
    """Inverse mass matrices with speeds, restitutions and frictions of all sizes."""
    generator = np.random.default_rng(seed)
    for _ in range(count):
        size, ratio = 10.0 ** generator.uniform(-1.0, 1.0, 2)
        coupled = generator.uniform(-0.98, 0.98) * ratio
        inverse = size * np.array([[1.0, coupled], [coupled, ratio**2]])
        w, u = abs(generator.normal()), generator.normal() * 10.0 ** generator.uniform(-2.0, 1.0)
        friction = 10.0 ** generator.uniform(-2.0, 0.7)
        yield inverse, w, u, float(generator.uniform(0.0, 1.0)), friction


def test_a_point_mass_loses_along_the_stop_what_coulomb_says() -> None:
    """mu (1 + R) w while it slides, at most all of the speed (B 1.62); Newton's rebound."""
    point = np.eye(2) / 0.7
    for u, left in ((3.0, 3.0 - 0.3 * 1.6 * 2.0), (-3.0, -3.0 + 0.3 * 1.6 * 2.0), (0.5, 0.0)):
        after, along, loss = impact(point, 2.0, u, 0.6, 0.3)
        assert after == -0.6 * 2.0
        assert along == pytest.approx(left, abs=1e-15)
        assert loss == pytest.approx(0.35 * (0.64 * 4.0 + u**2 - left**2), rel=1e-12)


def test_no_impact_gains_energy_whatever_the_masses() -> None:
    """10,000 impacts with random masses; a restitution of the speed, as without friction, gains."""
    gains = 0
    for inverse, w, u, restitution, friction in random_impacts(10_000, 1):
        mass = np.linalg.inv(inverse)
        size = float(np.array([w, u]) @ mass @ np.array([w, u]))
        _, _, loss = impact(inverse, w, u, restitution, friction)
        assert loss >= -1e-9 * size
        # Newton's restitution with a sliding or sticking impulse (Kane's paradox)
        a, b, c = inverse[0, 0], inverse[0, 1], inverse[1, 1]
        push = w * (1.0 + restitution) / (a - b * b / c)
        along = (b * push - u) / c
        if abs(along) > friction * push:
            share = -friction * math.copysign(1.0, u)
            push = w * (1.0 + restitution) / (a - b * share)
            along = share * push
        if push > 0.0:
            after = np.array([w - a * push + b * along, u - b * push + c * along])
            gains += 0.5 * float(after @ mass @ after) > 0.5 * size * (1.0 + 1e-9)
    assert gains > 100


@pytest.mark.parametrize("seed", range(60))
def test_an_impact_is_that_of_small_steps_over_its_impulse(seed: int) -> None:
    """Slip, stick and slip back, in compression and after it. The error of small steps is of the
    first order."""
    ((inverse, w, u, restitution, friction),) = random_impacts(1, 100 + seed)
    after, along, _ = impact(inverse, w, u, restitution, friction)
    fine = small_steps(inverse, w, u, restitution, friction, 20_000)
    coarse = small_steps(inverse, w, u, restitution, friction, 10_000)
    scale = w * (1.0 + float(np.abs(inverse).max() / inverse[0, 0])) + abs(u)
    for found, one, other in zip((after, along), fine, coarse, strict=True):
        assert abs(found - one) <= 4.0 * abs(other - one) + 1e-3 * scale


def test_the_kinds_of_impacts_are_all_among_them() -> None:
    """Sliding on, sticking, sliding back, and a normal speed that first grows (jam)."""
    found = set()
    for seed in range(60):
        ((inverse, w, u, restitution, friction),) = random_impacts(1, 100 + seed)
        _, along, _ = impact(inverse, w, u, restitution, friction)
        a, b = inverse[0, 0], inverse[0, 1]
        if a + friction * math.copysign(1.0, u) * b < 0.0:
            found.add("jam")
        small = 1e-9 * (w + abs(u))
        found.add("sticks" if abs(along) < small else "on" if along * u > 0.0 else "back")
    assert found == {"jam", "sticks", "on", "back"}


def test_a_mass_at_rest_on_a_stop_is_held_back_and_not_driven() -> None:
    assert held_back(0.3, 1.0, 0.2) == -0.2
    assert held_back(-0.1, 1.0, 0.2) == 0.1
    assert held_back(0.0, 1.0, 0.2) == 0.0


# ------------------------------------------------------------------------------
# Contacts of one mass: in sub-steps, read from tables, and each beside what it stands for.
# ------------------------------------------------------------------------------


LAWS_OF_ONE_MASS: dict[str, Law] = {
    "elastic": Elastic(stiffness=1e4),
    "viscoelastic": Viscoelastic(stiffness=1e4, damping_ratio=0.2),
    "overdamped": Viscoelastic(stiffness=1e4, damping_ratio=1.5),
    "table": ForceTable(deflection=[0.01, 0.03, 0.05], force=[10.0, 90.0, 100.0]),
    "Hertz": Hertz(coefficient=1e4),
    "function": ForceFunction(force=lambda y, v: 1e4 * y**1.4 * (1.0 + 0.2 * v)),
}


def after(
    plan: Any, stop: float, speed: float, steps: int = 3
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """State some steps after a touch of the upper stop, and the sums over its contact."""
    flown = Flown.before()
    state = fly(stop - 1e-9, speed, steps, plan, flown)
    return np.array(state), flown.contacts(1.0)


def errors_of(one: Any, truth: Any, stop: float, speed: float) -> NDArray[np.float64]:
    """Relative errors of speeds, impulse and loss, and those of peak force and duration."""
    (state, sums), (known, right) = (after(each, stop, speed) for each in (one, truth))
    assert sums[ENDED] == right[ENDED] == 1.0
    exact = [*np.abs(state - known) / speed, abs(sums[IMPULSE] - right[IMPULSE]) / speed]
    exact.append(abs(sums[LOSS] - right[LOSS]) / speed**2)
    rough = [abs(sums[row] / right[row] - 1.0) for row in (PEAK, TIME)]
    return np.array([max(exact), max(rough)])


@pytest.mark.parametrize("name", LAWS_OF_ONE_MASS)
def test_contacts_in_sub_steps_have_the_error_that_is_stated(name: str) -> None:
    """Beside the same contacts in sub-steps of a tenth of their length."""
    random, errors = np.random.default_rng(3), []
    for stop in random.uniform(-0.2, 0.8, 4):
        ends = {1.0: (float(stop), LAWS_OF_ONE_MASS[name])}
        plan, truth = (still(ends, 1.0, 0.4, known=False, finer=finer) for finer in (1.0, 3000.0))
        errors += [
            errors_of(plan, truth, stop, speed) for speed in 10.0 ** random.uniform(-0.5, 1.0, 8)
        ]
    exact, rough = np.max(errors, axis=0)
    assert exact < CONTACT_ERROR
    assert rough < (200.0 if name == "table" else 20.0) * CONTACT_ERROR
    assert exact > 1e-3 * CONTACT_ERROR, "sub-steps of a tenth are others"


@pytest.mark.parametrize("name", LAWS_OF_ONE_MASS)
def test_a_contact_that_is_read_is_the_one_that_is_integrated(name: str) -> None:
    stop, law = 0.4, LAWS_OF_ONE_MASS[name]
    plan = still({1.0: (stop, law)}, 1.0, 0.4)
    truth = still({1.0: (stop, law)}, 1.0, 0.4, known=False, finer=3000.0)
    known = plan._kernel_constants.known
    read, found = np.isfinite(known.terms[1, :, DURATION, 0]), []
    for speed in np.geomspace(0.03, 9.0, 40):
        # the speed of the touch, a nanometre on
        if read[int((math.log(speed) - known.first) * known.per_cell)]:
            found.append(errors_of(plan, truth, stop, speed))
    # a kink lowers the order of sub-steps, those of tables as well
    assert np.max(found) < (CONTACT_ERROR if name == "table" else 2.0 * TABLE_ERROR)
    assert read.mean() > 0.7, "most contacts of a stiff stop are read"


def test_a_table_with_durations_a_little_too_long_is_noticed() -> None:
    """The negative control of the comparison above."""
    law = LAWS_OF_ONE_MASS["elastic"]
    plan, wrong = (still({1.0: (0.4, law)}, 1.0, 0.4) for _ in range(2))
    wrong._kernel_constants.known.terms[:, :, DURATION] *= 1.0 + 1e-3
    states = [after(each, 0.4, 1.0)[0] for each in (plan, wrong)]
    assert abs(states[0][0] - states[1][0]) > 4.0 * TABLE_ERROR


def test_a_cell_with_a_kink_is_not_read() -> None:
    """A contact that just reaches a knot of the table is integrated."""
    law = ForceTable(deflection=[0.01, 0.02], force=[110.0, 1000.0])
    known = still({1.0: (0.0, law)}, 0.0, 1.0)._kernel_constants.known
    knot = math.sqrt(2.0 * float(law.potential_at(0.01)))
    place = (math.log(knot) - known.first) * known.per_cell
    read = np.isfinite(known.terms[1, :, DURATION, 0])
    assert not read[int(place)] and read[int(place) - 3] and read[int(place) + 10]


def test_what_does_not_end_within_a_step_is_not_read() -> None:
    def read(step: float) -> NDArray[np.bool_]:
        known = still({1.0: (0.0, Elastic(stiffness=100.0))}, 0.0, step)._kernel_constants.known
        return np.isfinite(known.terms[1, :, DURATION, 0])

    assert not read(0.3).any() and read(0.32).all()


# ------------------------------------------------------------------------------
# Restitutions that are drawn, and the numbers that they are drawn by.
# ------------------------------------------------------------------------------


@kernel
def chances(words, number, found):
    """The number of one event of many words."""
    for i in range(len(words)):
        found[i] = uniform_of(words[i], number)


def drawn(words: np.ndarray, number: int) -> np.ndarray:
    found = np.empty(len(words))
    chances(words, number, found)
    return found


def test_chances_are_those_of_the_plain_twin() -> None:
    words = np.random.default_rng(1).integers(0, 2**64, 50, dtype=np.uint64)
    for number in (0, 1, 999, 10_000):
        twin = [naive.uniform(int(word), number) for word in words]
        assert drawn(words, number).tolist() == twin


@pytest.mark.parametrize("step", [1, 2**32, 0x9E3779B97F4A7C15])
def test_chances_of_neighbours_are_uniform_and_independent(step: int) -> None:
    """Of words that follow one another, of numbers that do, and of both in pairs."""
    count = 20_000
    words = np.arange(count, dtype=np.uint64) * np.uint64(step)
    first, second = drawn(words, 0), drawn(words, 1)
    for one in (first, second):
        assert stats.kstest(one, "uniform").pvalue > 1e-4
    for one, other in ((first, second), (first[1:], first[:-1]), (first[1:], second[:-1])):
        assert abs(np.corrcoef(one, other)[0, 1]) < 4.5 / np.sqrt(count)
    of_numbers = np.array([drawn(words[:1], number)[0] for number in range(2000)])
    assert stats.kstest(of_numbers, "uniform").pvalue > 1e-4


@pytest.mark.parametrize("mean", [0.3, 0.7])
def test_rebounds_have_the_beta_distribution(mean: float) -> None:
    law = Restitution(coefficient={"mean": mean, "std": 0.2})
    assert law.scatter is not None
    compiled = law.compiled()
    assert is_rigid(compiled)
    # one number in the middle of each of ten parts of every cell
    u = (np.arange(10 * CELLS) + 0.5) / (10 * CELLS)
    r = np.array([rebound(compiled, 2.0, each) for each in u]) / 2.0
    known = stats.beta(law.scatter.alpha, law.scatter.beta)
    assert np.abs(known.cdf(r) - u).max() < 1.0 / CELLS
    # the middles of ten parts miss 1 % of the variance within a cell
    assert r.mean() == pytest.approx(mean, rel=1e-12)
    assert np.mean(r**2) == pytest.approx(law.restitution_mean_square, rel=1e-6)


def test_kernels_read_it_from_a_table_of_numbers() -> None:
    laws = [Restitution(coefficient={"mean": mean, "std": 0.1}).compiled() for mean in (0.4, 0.8)]
    rows = [row_of_numbers(law) for law in laws]
    table, functions = np.stack(rows), functions_of(laws[:1])
    for row, law in enumerate(laws):
        assert mean_rebound_of(functions, 0, table, row, 2.0) == pytest.approx(0.8 * (1 + row))
        for uniform in (1e-16, 0.3, 1.0 - 1e-16):
            found = rebound_of(functions, 0, table, row, 2.0, uniform)
            assert found == rebound(law, 2.0, uniform) and 0.0 <= found <= 2.0


def test_without_scatter_it_is_the_plain_law() -> None:
    plain = Restitution(coefficient=0.7)
    assert Restitution(coefficient={"mean": 0.7, "std": 0.0}).compiled() == plain.compiled()


# ------------------------------------------------------------------------------
# A drive is two files of its own: what a user writes and what kernels call.
# ------------------------------------------------------------------------------


WRITTEN = """
from typing import ClassVar, Literal
from stochvi.scenes.excitations.drawn import DrawnExcitation

class Knocks(DrawnExcitation):
    effect_word: ClassVar[str] = "knocks"
    family: ClassVar[str] = "knocks"
    white: ClassVar[bool] = True
    kind: Literal["knocks"] = "knocks"
    rate: float
    impulse: float

    @property
    def mean(self):
        return 0.0

    @property
    def si_intensity(self):
        return self.rate * self.impulse**2

    @property
    def fastest(self):
        return 10.0 * self.rate

    @property
    def jump(self):
        return self.impulse

    def compiled(self, mass):
        from stochvi.engine.knocks import RandomKnocks

        return RandomKnocks(self.rate, self.impulse / mass)

    def louder(self, level_db):
        return self

    def facts(self, where, numbers):
        return [(f"Knocks on {where}", f"{self.rate:.4g} per second")]
"""

CALLED = """
import math
from typing import NamedTuple
from stochvi.engine.parts import kicked, pull, read_characteristic, remembers
from stochvi.engine.calls import drawn, draws, kept
from stochvi.engine.arithmetic import uniform_of

class RandomKnocks(NamedTuple):
    rate: float
    size: float

@pull.of(RandomKnocks)
def _(part, x, v, z):
    return 0.0

@kicked.of(RandomKnocks)
def _(part, x, v, z, push, damping, h):
    return v + push * h + z

@remembers.of(RandomKnocks)
def _(part):
    return True

@draws.of(RandomKnocks)
def _(part):
    return True

@kept.of(RandomKnocks)
def _(part, z):
    return 0.0

@drawn.of(RandomKnocks)
def _(part, z, word, event, h):
    count, time = 0, -math.log(uniform_of(word, event)) / part.rate
    while time < h and count < 3:
        z += part.size if uniform_of(word, event + 2 * count + 1) < 0.5 else -part.size
        count += 1
        time -= math.log(uniform_of(word, event + 2 * count)) / part.rate
    return z

@read_characteristic.of(RandomKnocks)
def _(part, numbers, row):
    return RandomKnocks(numbers[row, 0], numbers[row, 1])
"""

ASKED = """
import numpy as np
from stochvi.engine.calls import FIRST_DRAW, changes_of
from stochvi.model.model import model_of
from stochvi.scenes.scene import scene_from
scene = scene_from({
    "structure": {"kind": "oscillator", "mass": 2.0, "stiffness": 2.0, "damping": 0.4},
    "excitation": [{"kind": "knocks", "rate": 0.5, "impulse": 0.8}],
})
(part,) = model_of(scene).drives
changes = np.empty(40_000)
changes_of(part.law.compiled(part.mass), np.uint64(3), FIRST_DRAW, 0.1, changes)
print(part.mass**2 * np.mean(changes**2), part.mass**2 * np.std(changes**2) / 200.0)
"""


@pytest.mark.slow
def test_a_drive_of_the_package_is_two_files_of_its_own(tmp_path: Path) -> None:
    """No list has to name it. The mean square of its impulse in a step h is rate h J^2."""
    package = tmp_path / "stochvi"
    shutil.copytree(
        Path(stochvi.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__")
    )
    (package / "scenes/excitations/knocks.py").write_text(WRITTEN)
    (package / "engine/knocks.py").write_text(CALLED)
    place = os.environ | {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    done = subprocess.run(
        [sys.executable, "-c", ASKED], cwd=tmp_path, env=place, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    square, error = map(float, done.stdout.split())
    exact = 0.5 * 0.1 * 0.8**2
    assert abs(square - exact) < 4.5 * error < 0.2 * exact
