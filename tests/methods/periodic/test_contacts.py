"""Regimes between compliant stops, against integration of the equations of motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stochvi import (
    ImpactPair,
    Isolator,
    Matrices,
    Oscillator,
    Restitution,
    Scene,
    harmonic_response,
)
from stochvi.methods.periodic import bifurcation, lyapunov_exponent
from stochvi.methods.periodic.answer import Branch, HarmonicResponse
from stochvi.methods.periodic.contact_branches import ContactFinder
from stochvi.methods.periodic.family import Family
from stochvi.methods.periodic.states import States
from stochvi.model.model import Pair, Stop, model_of
from stochvi.scenes.excitations import ConstantLoad, Sine
from stochvi.scenes.impact_laws import Elastic, ForceTable, Hertz, Law, Viscoelastic
from support.accuracies import quick_cases

TABLE = ForceTable(deflection=[0.02, 0.05, 0.1, 0.2], force=[0.5, 4.0, 4.0, 40.0])
"""A stop that hardens, with a plateau."""


def mount(law: Law, frequency: float = 0.25, lower: float | None = -1.0, **changes) -> Scene:
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=lower, upper=1.0, law=law)],
        excitations=[Sine(**{"amplitude": 0.6, "frequency_hz": frequency, **changes})],
    )


def two_masses(upper: Law, lower: Law, wall: Law) -> Scene:
    """A preloaded buffer between two masses, and a wall, under a load."""
    return Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=[[2.0, 0.1], [0.1, 1.0]],
            damping=[[0.3, -0.1], [-0.1, 0.2]], stiffness=[[5.0, -2.0], [-2.0, 3.0]],
        ),
        impact_pairs=[
            ImpactPair(
                name="buffer", between=["b", "a"], upper=-0.02, lower=-0.6,
                upper_law=upper, lower_law=lower,
            ),
            ImpactPair(name="wall", on="b", upper=0.5, law=wall),
        ],
        excitations=[
            Sine(on="a", amplitude=2.0, frequency_hz=0.21), ConstantLoad(on="b", force=-0.3),
            Sine(on="b", amplitude=0.7, frequency_hz=0.42, phase_deg=40.0),
        ],
    )  # fmt: skip


def integrated(scene: Scene, state: np.ndarray, phase: float, periods: float) -> np.ndarray:
    """The state after some periods, by a Runge-Kutta method of order 8 and the force law itself.

    It ends at each kink of a force and begins anew behind it: the error of a step across a kink is
    not seen by its control, and hangs on the rounding of the processor.
    """
    model, n = model_of(scene), len(model_of(scene).mass)
    lowest = min(sine.omega for sine in model.sines)

    def rate(time: float, y: np.ndarray) -> np.ndarray:
        x, v = y[:n], y[n:]
        force = model.constant_force - model.stiffness @ x - model.damping @ v
        for sine in model.sines:
            angle = sine.omega * (time + phase / lowest) + sine.phase
            force = force + sine.amplitude * math.cos(angle) * sine.direction
        for pair in model.pairs:
            force = force - pair.direction * pair.force(pair.direction @ x, pair.direction @ v)
        return np.concatenate([v, np.linalg.solve(model.mass, force)])

    kinks = [kink for pair in model.pairs for kink in kinks_of(pair, n)]
    end, time = 2.0 * math.pi * periods / lowest, 0.0
    precise = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    while True:
        part = solve_ivp(
            rate, (time, end), state, events=kinks, max_step=0.0125 * end / periods, **precise
        )
        time, state = part.t[-1], part.y[:, -1]
        if part.status == 0:
            return state
        # a little further on, where the kink that was just met is behind
        behind = min(time + 1e-7 * end / periods, end)
        state = solve_ivp(rate, (time, behind), state, **precise).y[:, -1]
        time = behind


def kinks_of(pair: Pair, n: int) -> Iterator[Callable[[float, np.ndarray], float]]:
    """Functions of time and state that change their sign where the force of a pair has a kink."""

    def kink(stop: Stop, depth: float, damping: float = 0.0) -> Callable[..., float]:
        def away(_: float, y: np.ndarray) -> float:
            deflection = stop.side * (pair.direction @ y[:n] - stop.position)
            return float(deflection - depth + damping * stop.side * (pair.direction @ y[n:]))

        away.terminal = True  # type: ignore[attr-defined]
        return away

    for stop in pair.stops:
        yield kink(stop, 0.0)
        if isinstance(stop.law, ForceTable):
            yield from (kink(stop, depth) for depth in stop.law.deflection)
        if isinstance(stop.law, Viscoelastic):
            yield kink(stop, 0.0, stop.law.damping(pair.mass) / stop.law.stiffness)


def states(found: HarmonicResponse, value: float) -> list[tuple[Branch, int, np.ndarray, float]]:
    """Every regime at a value: its branch and place, its state, and the phase of that state."""
    return [
        (
            branch, place, np.concatenate([branch.displacement[place], branch.velocity[place]]),
            float(branch.phase[place, 0]) if branch.stops else 0.0,
        )
        for branch in found.branches
        for place in branch.at(value)
    ]  # fmt: skip


@pytest.mark.slow
@quick_cases(
    ("scene", "frequency"),
    [
        (mount(Viscoelastic(stiffness=100.0, damping_ratio=0.2)), 0.25),
        (mount(Elastic(stiffness=30.0), 0.2, lower=None), 0.2),
        (mount(TABLE), 0.25),
        (mount(Hertz(coefficient=1e4), 0.2, lower=None), 0.2),
        (
            two_masses(
                Viscoelastic(stiffness=40.0, damping_ratio=0.3),
                Elastic(stiffness=90.0),
                Elastic(stiffness=70.0),
            ),
            0.21,
        ),
    ],
    ids=["two viscoelastic", "one elastic", "two tables", "one Hertz", "two masses"],
    keep=(0, 1, 2, 3),
)
def test_a_regime_repeats_itself_under_the_force_law(scene: Scene, frequency: float) -> None:
    found = states(harmonic_response(scene, most_impacts=1), frequency)
    assert any(branch.stops and branch.stable[place] for branch, place, _, _ in found)
    for branch, place, start, phase in found:
        # errors of the integration grow with what is unstable
        end = integrated(scene, start, phase, branch.periods)
        assert end == pytest.approx(start, abs=3e-10 * max(1.0, branch.multiplier[place]))


@quick_cases(
    "law",
    [Viscoelastic(stiffness=100.0, damping_ratio=0.2), TABLE, Hertz(coefficient=100.0)],
    keep={0},
    ids=lambda law: law.kind,
)
def test_disturbances_grow_by_the_multiplier(law: Law) -> None:
    scene = mount(law, 0.26)
    found = states(harmonic_response(scene, most_impacts=1), 0.26)
    unstable = [each for each in found if not each[0].stable[each[1]]]
    assert unstable
    for branch, place, start, phase in unstable:
        # not where a contact begins: a perturbation of that state is in contact, or is not; a step
        # of 1e-5 keeps the error of the integration over kinks of a force below 1e-4
        start, phase = integrated(scene, start, phase, 0.2), phase + 0.4 * math.pi
        change = 1e-5 * np.eye(2)
        factors = np.column_stack(
            [
                (integrated(scene, start + step, phase, branch.periods)
                 - integrated(scene, start - step, phase, branch.periods)) / 2e-5
                for step in change
            ]
        )  # fmt: skip
        largest = np.abs(np.linalg.eigvals(factors)).max()
        assert branch.multiplier[place] == pytest.approx(largest, rel=1e-4)


def test_two_stops_of_hertz_press_at_once() -> None:
    """With a table on the third side; the preloaded buffer presses from the start."""
    scene = two_masses(Hertz(coefficient=30.0), TABLE, Hertz(coefficient=300.0))
    start = np.array([-0.1, 0.6, 0.3, 0.5])
    model = model_of(scene)
    family = Family.of(lambda _: model, 1.0, 2.0, None)
    states = States(model, family, 0.5)
    motion = ContactFinder(family, np.array([0.5]), 1).flown(
        0.5, states.scaled(start[None])[0], periods=2
    )
    assert motion is not None
    assert set(motion.log[:, 1].astype(int)) == {0, 1, 2}
    end = states.physical(motion.ends[-1][None])[0]
    assert end == pytest.approx(integrated(scene, start, 0.0, 2.0), abs=2e-9)


@pytest.mark.slow
def test_stiff_stops_lead_to_rigid_ones() -> None:
    """The difference shrinks as the time of a contact, that is with the root of the stiffness."""
    law = Viscoelastic(stiffness=1.0, damping_ratio=0.2)
    rigid = harmonic_response(mount(Restitution(coefficient=law.restitution))).at(0.25)
    speed = rigid[rigid["stable"] & (rigid["periods"] == 1)]["impact_speed_max"].max()
    away = []
    for stiffness in (1e3, 1e5):
        soft = mount(Viscoelastic(stiffness=stiffness, damping_ratio=0.2))
        known = harmonic_response(soft, most_impacts=1).at(0.25)
        found = known[known["stable"] & (known["impacts_per_period"] == 2)]["impact_speed_max"]
        away.append(abs(float(found.max()) / speed - 1.0))
    assert away[1] < 0.02
    assert away[0] / away[1] == pytest.approx(10.0, rel=0.2)


def test_rigid_stops_beside_one_that_is_out_of_reach_have_their_own_regimes() -> None:
    rigid = mount(Restitution(coefficient=0.6))
    far = ImpactPair(name="far", upper=9.0, law=Elastic(stiffness=10.0))
    both = rigid.model_copy(update={"impact_pairs": (*rigid.impact_pairs, far)})
    one, other = (harmonic_response(each).at(0.25) for each in (rigid, both))
    # largest values are those of cubics over steps of either solver
    columns = {"impact_speed_max": 1e-8, "multiplier": 1e-8, "displacement_max": 1e-4,
               "acceleration_max": 1e-4}  # fmt: skip
    for count in (0, 2):
        a, b = (each[each["impacts_per_period"] == count] for each in (one, other))
        assert len(a) and len(a) == len(b)
        for column, tolerance in columns.items():
            np.testing.assert_allclose(a[column], b[column], rtol=tolerance)


@pytest.mark.slow
def test_a_contact_begins_where_the_motion_fills_the_gap() -> None:
    law = Elastic(stiffness=5.0)
    found = harmonic_response(mount(law, lower=None), np.linspace(0.18, 0.24, 7), most_impacts=1)
    free = next(branch for branch in found.branches if not branch.stops)
    grazing = free.frequency_hz[free.names.index("grazing")]
    omega = 2.0 * math.pi * grazing
    assert 0.6 / math.hypot(1.0 - omega**2, 0.1 * omega) == pytest.approx(1.0, rel=1e-6)
    # the first harmonic of motion without contacts is all of it
    assert free.amplitude == pytest.approx(free.displacement_max, rel=1e-5)


def test_the_largest_acceleration_is_that_in_the_stop() -> None:
    scene = mount(Elastic(stiffness=100.0))
    found = states(harmonic_response(scene, most_impacts=1), 0.25)
    for branch, place, start, phase in found:
        largest, step, model = 0.0, start, model_of(scene)
        pair, (sine,) = model.pairs[0], model.sines
        period = 1.0 / 0.25
        for number in range(4000 * branch.periods):
            time = phase / sine.omega + number * period / 4000
            x, v = step
            push = 0.6 * math.cos(sine.omega * time) - x - 0.1 * v - float(pair.force(x, v))
            largest = max(largest, abs(push))
            # Heun's method
            h = period / 4000
            guess = step + h * np.array([v, push])
            later = 0.6 * math.cos(sine.omega * (time + h)) - guess[0] - 0.1 * guess[1]
            later -= float(pair.force(*guess))
            step = step + h / 2.0 * np.array([v + guess[1], push + later])
        assert branch.acceleration_max[place] == pytest.approx(largest, rel=1e-2)
        break


@pytest.mark.slow
def test_a_knot_on_a_straight_line_changes_nothing() -> None:
    spring = Elastic(stiffness=30.0)
    table = ForceTable(deflection=[0.01, 0.05, 0.3], force=[0.3, 1.5, 9.0])
    one, other = (harmonic_response(mount(law), most_impacts=1).at(0.25) for law in (spring, table))
    assert one["impacts_per_period"].tolist() == other["impacts_per_period"].tolist()
    for column in ("impact_speed_max", "multiplier"):
        np.testing.assert_allclose(one[column], other[column], rtol=1e-9)


@pytest.mark.slow
def test_a_key_of_a_tabulated_stop_can_be_varied() -> None:
    scene = mount(TABLE, lower=None)
    found = harmonic_response(scene, vary={"impact_pair.0.upper": [0.95, 1.0]}, most_impacts=1)
    one, other = (
        each.at(value) for each, value in ((found, 1.0), (harmonic_response(scene), 0.25))
    )
    columns = ["impact_speed_max", "multiplier"]
    np.testing.assert_allclose(one[columns], other[columns], rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("law", [Elastic(stiffness=100.0), TABLE], ids=lambda law: law.kind)
def test_slow_sweeps_and_exponents_are_those_of_the_exact_regime(law: Law) -> None:
    scene, start = mount(law), {"velocity.x": 2.0}
    exact = harmonic_response(scene, most_impacts=1).at(0.25)
    regime = exact[exact["stable"] & (exact["impacts_per_period"] == 2)].iloc[0]
    expected = 0.25 * math.log(regime["multiplier"])
    (sweep,) = bifurcation(scene, [0.24, 0.25], start=start, watched=64).sweeps
    assert sweep.impact_speed[1] == pytest.approx(np.full(128, regime["impact_speed_max"]), 1e-6)
    assert abs(sweep.lyapunov[1] - expected) < 4.0 * sweep.lyapunov_error[1]
    # from rest the motion stays clear of both stops, and has the exponent of its damping alone
    for given in (start, None):
        rate = lyapunov_exponent(scene, given, settling=300, periods=320)
        assert abs(rate.value - expected) < 4.0 * rate.standard_error
        assert rate.standard_error < 0.1 * abs(expected)


@pytest.mark.slow
def test_a_jump_is_where_a_simulated_sweep_has_it_and_a_first_touch_is_none() -> None:
    """Downwards the motion touches the stops near 13.17 Hz and jumps at 13.15 Hz; upwards it
    touches them at 11.2 Hz and goes on, whatever the values that are asked for."""
    scene = Scene(
        structure=Isolator(mass=50.0, frequency_hz=12.0, zeta=0.06),
        impact_pairs=[
            ImpactPair(clearance=0.004, law=Viscoelastic(stiffness=2e6, damping_ratio=0.15))
        ],
        excitations=[Sine(on="x", unbalance=0.04, frequency_hz=15.0)],
    )
    found = harmonic_response(scene, np.linspace(10.5, 16.5, 31), sweep="both")
    assert [jump.upwards for jump in found.jumps] == [True, False]
    for jump, swept in zip(found.jumps, found.simulated, strict=True):
        leaps = np.flatnonzero(np.abs(np.diff(swept.impact_speed_max)) > 0.1)
        (leap,) = leaps  # the speed of first touches grows by less from value to value
        low, high = np.sort(swept.value[leap : leap + 2])
        assert low <= jump.value <= high


@pytest.mark.slow
def test_a_resonance_between_the_values_that_are_drawn_is_found() -> None:
    """Its branch begins and ends at grazings, with a fold between them, on any grid."""
    scene = Scene(
        structure=Isolator(mass=1.0, frequency_hz=14.0, zeta=0.12),
        impact_pairs=[
            ImpactPair(clearance=0.004, law=Viscoelastic(stiffness=3e5, damping_ratio=0.1))
        ],
        excitations=[Sine(on="base", amplitude=9.81, frequency_hz=14.0)],
    )
    for values in ([5.0, 60.0, 200.0], [10.0, 35.0]):
        found = harmonic_response(scene, values)
        (number,) = (k for k, each in enumerate(found.branches) if len(each.stops) == 2)
        points = [each for each in found.special_points if each.branch == number]
        assert [each.name for each in points] == ["grazing", "grazing", "fold"]
        assert [each.value for each in points] == pytest.approx(
            [12.222437, 15.209287, 16.661027], 1e-6
        )
        assert [jump.value for jump in found.jumps] == pytest.approx(
            [points[2].value, points[1].value], rel=1e-6
        )


def test_a_branch_that_is_being_followed_ends_with_the_budget(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """After the deadline a step of the branch may go on, and nothing is begun."""
    family = Family.of(
        lambda value: model_of(mount(Elastic(stiffness=20.0), value)), 0.15, 0.4, None
    )
    flown, motions = ContactFinder.flown, [0, 0]

    class Ending:
        """A deadline that passes after so many motions."""

        def __init__(self, last: float) -> None:
            self.last = last

        def passed(self) -> bool:
            return motions[0] >= self.last

    def counted(self: ContactFinder, *arguments: object, **named: object) -> object:
        motions[0] += 1
        motions[1] += self.deadline.passed()
        return flown(self, *arguments, **named)

    finder = ContactFinder(family, np.linspace(0.0, 1.0, 5), 1)
    settled = finder.simulate(0.5, np.array([0.1, 0.0]), periods=200)
    orbit = finder._settled_orbit(settled, 0.5)
    monkeypatch.setattr(ContactFinder, "flown", counted)
    (*_, last) = finder._traced(orbit)
    whole = motions[0]
    assert whole > 500 and len(last.points) > 5
    for share in (0.1, 0.5, 0.9):
        motions[:] = 0, 0
        finder.deadline = Ending(share * whole)
        parts = finder._traced(orbit)
        assert all(len(part.points) == len(part.names) for part in parts)
        assert 0 < motions[1] < 60, share
