"""Percussion machines under a sine: section 4 of the book, and an event-driven simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stochvi import ImpactPair, Matrices, Restitution, Scene, harmonic_response
from stochvi.methods.periodic.answer import COLUMNS, Branch, HarmonicResponse
from stochvi.model.model import model_of
from stochvi.scenes.excitations import ConstantLoad, Sine
from stochvi.scenes.keys import changed_scene
from support.accuracies import quick_cases
from support.bounces import Bounces

PAIR = ("striker", "body")


def hammer(feed: float, restitution: float, body: float, damping: float = 0.0) -> Scene:
    """A striker of 1 kg on a spring of 1 N/m to its body, under a force of 1 N between the two."""
    couple = np.array([[1.0, -1.0], [-1.0, 1.0]])
    return Scene(
        structure=Matrices(
            coordinates=PAIR, mass=np.diag([1.0, body]), damping=damping * couple, stiffness=couple
        ),
        impact_pairs=[
            ImpactPair(on="striker", upper=0.0, law=Restitution(coefficient=restitution))
        ],
        excitations=[
            ConstantLoad(on="body", force=feed),
            Sine(between=PAIR, amplitude=1.0, frequency_hz=0.2),
        ],
    )


def hertz(ratio: float, body: float) -> float:
    """A frequency over that of the two masses on their spring, in Hz."""
    return ratio * math.sqrt(1.0 + 1.0 / body) / (2.0 * math.pi)


def single(found: HarmonicResponse) -> list[Branch]:
    """Branches of one impact in each period."""
    return [each for each in found.branches if len(each.stops) == each.periods == 1]


def end_of_range(feed: float, restitution: float, *, above: bool) -> float:
    """Where (4.21) ends, G / P = (1 / pi) (1 + R) / (1 - R) zeta^2 / |1 - zeta^2|."""
    lossy = (1.0 + restitution) / (1.0 - restitution) / math.pi
    sign = 1.0 if above else -1.0
    return math.sqrt(feed / (feed - sign * lossy))


@pytest.mark.slow
@quick_cases(
    ("feed", "restitution", "body", "above"),
    [(0.4, 0.5, 3.0, False), (0.8, 0.7, 0.7, False), (0.9, 0.3, 5.0, True), (1.2, 0.3, 5.0, True)],
    keep=(1, 3),
)
def test_regimes_end_in_a_fold_at_the_limit_of_the_book(
    feed: float, restitution: float, body: float, above: bool
) -> None:
    end = end_of_range(feed, restitution, above=above)
    around = [hertz(end * (1.0 + part), body) for part in np.linspace(-0.02, 0.02, 5)]
    found = harmonic_response(hammer(feed, restitution, body), around, most_impacts=1)
    branch = next(each for each in single(found) if "fold" in each.names)
    place = branch.names.index("fold")
    assert branch.frequency_hz[place] == pytest.approx(hertz(end, body), rel=1e-6)
    # (4.20): momentum gives the speed of an impact, on either branch
    speed = 2.0 * math.pi * feed / (1.0 + restitution) / (2.0 * math.pi * branch.frequency_hz)
    assert branch.impact_speed[:, 0] == pytest.approx(speed, rel=1e-9)


@pytest.mark.parametrize("body", [2.0, 50.0])
@pytest.mark.parametrize(("share", "branches"), [(0.97, 1), (1.03, 2)])
def test_both_branches_exist_from_the_feed_of_the_book(
    body: float, share: float, branches: int
) -> None:
    """(4.28), G / P > (M1 + M2) / (2 M2), which is 1 / 2 of a heavy body (4.12)."""
    feed = share * (1.0 + body) / (2.0 * body)
    found = harmonic_response(hammer(feed, 1.0, body), hertz(1.001, body), most_impacts=1)
    assert len(single(found)) == branches


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_hammers_strike_as_an_event_driven_simulation(seed: int) -> None:
    random = np.random.default_rng(seed)
    scene = hammer(
        random.uniform(0.1, 0.6), random.uniform(0.1, 0.8), random.uniform(0.5, 20.0),
        random.uniform(0.05, 0.3),
    )  # fmt: skip
    where = hertz(random.uniform(0.6, 1.6), scene.structure.mass[1][1])
    found = harmonic_response(scene, where)
    moving = changed_scene(scene.document(), (("excitation.1.frequency_hz", where),))
    compared = 0
    for branch in found.branches:
        for place in [] if branch.sticking else branch.at(where):
            flight = Bounces(moving)
            before = flight.start(
                branch.displacement[place], branch.velocity[place], float(branch.phase[place, 0])
            )
            stop = [f"{pair.name} {each.name}" for pair, each in flight.stops].index(
                branch.stops[0]
            )
            count = len(branch.stops)
            hits = flight.impacts(flight.struck(before, stop), count, 9.0 / where)
            speeds = [flight.speed(state, number) for _, number, state in hits]
            expected = [*branch.impact_speed[place, 1:], branch.impact_speed[place, 0]]
            assert speeds == pytest.approx(expected, abs=1e-9 * max(1.0, branch.multiplier[place]))
            assert hits[-1][0] == pytest.approx(branch.periods / where, rel=1e-9)
            compared += 1
    assert compared


def test_a_free_body_under_a_feed_has_no_motion_without_impacts() -> None:
    found = harmonic_response(hammer(0.4, 0.5, 3.0), hertz(0.9, 3.0))
    assert found.branches
    assert all(each.stops for each in found.branches)


def test_a_crank_is_a_force_that_grows_with_the_spring_and_the_damper() -> None:
    turned = hammer(0.3, 0.2, 10.0, damping=0.2)
    crank = Sine(between=PAIR, displacement=0.7, frequency_hz=0.2)
    scene = turned.model_copy(update={"excitations": (turned.excitations[0], crank)})
    omega = 2.0 * math.pi * 0.2
    force = Sine(between=PAIR, amplitude=0.7 * math.hypot(1.0, 0.2 * omega), frequency_hz=0.2)
    same = turned.model_copy(update={"excitations": (turned.excitations[0], force)})
    one, other = (harmonic_response(each, 0.2).at(0.2) for each in (scene, same))
    columns = ["displacement_max", "impact_speed_max", "multiplier"]
    np.testing.assert_allclose(one[columns], other[columns], rtol=1e-9)
    # the phase, by which the damper leads, is that of the force: seen beside a second crank
    assert model_of(scene).sines[0].phase == pytest.approx(math.atan(0.2 * omega))


@pytest.mark.slow
def test_where_no_regime_is_found_the_table_is_empty_and_has_its_columns() -> None:
    found = harmonic_response(hammer(5.0, 0.5, 3.0), hertz(0.9, 3.0), most_impacts=1)
    assert not found.branches
    assert found.at(hertz(0.9, 3.0)).columns.tolist() == list(COLUMNS)
