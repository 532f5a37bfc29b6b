"""Periodic regimes against a simulation from impact to impact that shares no code with them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.linalg import expm

from stochvi import (
    Absorber,
    ConstantLoad,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    WhiteNoise,
    harmonic_response,
)
from stochvi.methods.periodic import Branch, HarmonicResonance, HarmonicResponse, Jump
from support.accuracies import quick_cases
from support.bounces import Bounces
from support.sine_flights import Mass, settled

ROUNDING = 1e-9
"""Relative difference of impact speeds that is asked for."""


def random_scene(seed: int) -> Scene:
    """One to four coordinates; one or two stops, or a loose mass in a box; gaps and preloads."""
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 5))
    law = Restitution(coefficient=float(random.uniform(0.2, 1.0)))
    loose = seed % 5 == 4
    gap = float(random.uniform(0.3, 1.5))
    drive = Sine(amplitude=float(random.uniform(0.5, 2.0)), frequency_hz=1.0, on="c0")
    load = ConstantLoad(force=float(random.normal(0.0, 0.2)), on="c0")
    if loose:
        carrier = Oscillator(mass=1.0, damping=float(random.uniform(0.05, 0.3)), stiffness=1.0)
        sine = drive.model_copy(
            update={"on": "x", "frequency_hz": float(random.uniform(0.8, 1.3)) / (2.0 * math.pi)}
        )
        box = Absorber(mass=float(random.uniform(0.05, 0.3)), play=2.0 * gap, law=law)
        return Scene(structure=carrier, absorber=box, excitations=[sine])
    root = random.normal(size=(n, n))
    mass = np.eye(n) + 0.2 * root @ root.T
    other = random.normal(size=(n, n))
    stiffness = np.diag(random.uniform(0.5, 4.0, n)) + 0.3 * other @ other.T
    damping = 0.05 * stiffness + 0.05 * np.diag(random.uniform(0.0, 1.0, n))
    omega = math.sqrt(stiffness[0, 0] / mass[0, 0]) * float(random.uniform(0.6, 2.5))
    stops = {"upper": gap if seed % 3 else -0.2 * gap}
    if seed % 2 and seed % 3:
        stops["lower"] = -float(random.uniform(0.3, 1.5))
    return Scene(
        structure=Matrices(
            coordinates=[f"c{i}" for i in range(n)],
            mass=mass.tolist(), damping=damping.tolist(), stiffness=stiffness.tolist(),
        ),
        impact_pairs=[ImpactPair(on="c0", law=law, **stops)],
        excitations=[drive.model_copy(update={"frequency_hz": omega / (2.0 * math.pi)}), load],
    )  # fmt: skip


def regimes(found: HarmonicResponse) -> list[tuple[Branch, int]]:
    """The admissible regimes with impacts of an answer at one frequency."""
    return [
        (branch, int(i))
        for branch in found.branches
        for i in np.flatnonzero(branch.admissible)
        if branch.stops and not branch.sticking and not branch.names[i]
    ]


def after(flight: Bounces, branch: Branch, i: int, change: float = 0.0) -> np.ndarray:
    """The state after the first impact, its velocities changed by a share."""
    start = flight.start(branch.displacement[i], branch.velocity[i], branch.phase[i, 0])
    start[flight.n : 2 * flight.n] *= 1.0 + change
    names = [f"{pair.name} {stop.name}" for pair, stop in flight.stops]
    return flight.struck(start, names.index(branch.stops[0]))


def check_regimes(scene: Scene) -> int:
    """Every regime repeats itself, impact by impact; returns how many there are."""
    found = harmonic_response(scene)
    flight = Bounces(scene)
    names = [f"{pair.name} {stop.name}" for pair, stop in flight.stops]
    chosen = regimes(found)
    for branch, i in chosen:
        period = 2.0 * math.pi * branch.periods / flight.omega
        hits = flight.impacts(after(flight, branch, i), len(branch.stops), 1.5 * period)
        order = [*branch.stops[1:], branch.stops[0]]
        assert [names[hit[1]] for hit in hits] == order
        speeds = [flight.speed(state, s) for _, s, state in hits]
        expected = np.roll(branch.impact_speed[i], -1)
        size = expected.max() * max(1.0, branch.multiplier[i])
        assert speeds == pytest.approx(expected, abs=ROUNDING * size)
        assert hits[-1][0] == pytest.approx(period, rel=1e-9)
    return len(chosen)


@pytest.mark.parametrize(
    "seeds", [range(3), pytest.param(range(3, 200), marks=pytest.mark.verify)]
)  # fmt: skip
def test_a_regime_repeats_itself_impact_by_impact(seeds: range) -> None:
    assert sum(check_regimes(random_scene(seed)) for seed in seeds) > len(seeds) // 2


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.8])
def test_sizes_of_a_regime_are_those_of_its_sampled_motion(restitution: float) -> None:
    """Largest displacement and acceleration between impacts, and the first harmonic by Fourier's
    integral over the periods."""
    scene = mount(restitution=restitution)
    flight, chosen = Bounces(scene), regimes(harmonic_response(scene))
    assert chosen
    for branch, i in chosen:
        period = 2.0 * math.pi * branch.periods / flight.omega
        z, begun, moments, places, pulls = after(flight, branch, i), 0.0, [], [], []
        for time, stop, before in flight.impacts(z, len(branch.stops), 1.5 * period):
            part = np.linspace(0.0, time - begun, 2000)
            states = [z]
            step = expm(part[1] * flight.a)
            for _ in part[1:]:
                states.append(step @ states[-1])
            moments.append(begun + part)
            places.append([each[0] for each in states])
            pulls.append([(flight.a @ each)[1] for each in states])
            z, begun = flight.struck(before, stop), time
        found = {
            "displacement_max": np.abs(places).max(),
            "acceleration_max": np.abs(pulls).max(),
            "amplitude": 2.0 / period * abs(
                sum(
                    np.trapezoid(np.array(x) * np.exp(-1j * flight.omega * t), t)
                    for t, x in zip(moments, places, strict=True)
                )
            ),
        }  # fmt: skip
        for name, truth in found.items():
            assert getattr(branch, name)[i] == pytest.approx(truth, rel=1e-4), name
        # the negative control: none of the three is another of them
        assert found["amplitude"] < 0.99 * found["displacement_max"]


@pytest.mark.slow
def test_a_branch_that_ends_in_a_grazing_rest_has_no_multiplier_there() -> None:
    """A mass rests on its stop, and the branch ends where an impact of speed 0 joins."""
    (branch,) = harmonic_response(random_scene(33)).branches
    ends = np.array([name == "grazing" for name in branch.names])
    assert ends.any() and np.isinf(branch.multiplier[ends]).all()
    assert np.all(branch.multiplier[~ends] < 1.0) and not branch.stable[ends].any()


OMEGA, DAMPING, DRIVE = 62.8, 12.5, 628.0
"""The isolator of the book's section 9, rad/s, 1/s and rad/s."""


def mount(clearance: float = 4e-4, restitution: float = 0.5, **changes) -> Scene:
    """An oscillator between two stops, driven at ten times its natural frequency."""
    drive = {"amplitude": 1e-4 * DRIVE**2, "frequency_hz": DRIVE / (2.0 * math.pi)}
    return Scene(
        structure=Oscillator(mass=1.0, damping=DAMPING, stiffness=OMEGA**2),
        impact_pairs=[
            ImpactPair(clearance=clearance, law=Restitution(coefficient=restitution))
        ],
        excitations=[Sine(**drive)],
        **changes,
    )  # fmt: skip


@quick_cases("seed", [1, 7, 4], keep=(1,))
def test_a_simulated_motion_that_settles_is_among_the_regimes(seed: int) -> None:
    scene = random_scene(seed)
    found = harmonic_response(scene)
    flight = Bounces(scene, steps=100)
    random = np.random.default_rng(seed)
    state = flight.start(np.zeros(flight.n), random.normal(size=flight.n), 0.0)
    hits = flight.impacts(state, 150, 40.0 * math.pi / flight.omega)
    speeds = [flight.speed(before, stop) for _, stop, before in hits]
    if len(hits) < 150:
        assert any(not branch.stops and branch.stable.any() for branch in found.branches)
        return
    known = [
        branch for branch, i in regimes(found)
        if branch.stable[i] and _repeats(speeds, branch.impact_speed[i])
    ]  # fmt: skip
    assert known


def _repeats(speeds: list[float], regime: np.ndarray) -> bool:
    """Whether the last impacts are those of a regime, from any of them on."""
    last = np.array(speeds[-len(regime) :])
    return any(np.allclose(np.roll(regime, k), last, rtol=1e-5) for k in range(len(regime)))


def test_disturbances_grow_by_the_multiplier_or_die_away() -> None:
    """From a regime that is perturbed by 1e-7, over the periods that keep it small."""
    scene = mount()
    found, flight = harmonic_response(scene), Bounces(scene)
    seen = set()
    for branch, i in regimes(found):
        if branch.periods != 1:
            continue
        stable, factor = bool(branch.stable[i]), branch.multiplier[i]
        hits = flight.impacts(after(flight, branch, i, 1e-7), 24, 1.0)
        speeds = np.array([flight.speed(before, stop) for _, stop, before in hits])
        away = np.abs(speeds / np.tile(np.roll(branch.impact_speed[i], -1), 12) - 1.0)
        seen.add(stable)
        if stable:
            # the first impacts may be further away than the perturbation was
            assert away[-4:].max() < away[:4].max() * max(factor, 0.5) ** 4
        else:
            assert away[8:10].max() / away[4:6].max() == pytest.approx(factor**2, rel=0.1)
    assert seen == {True, False}


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [0.5, 0.9])
def test_every_symmetric_regime_between_two_stops_is_found(restitution: float) -> None:
    """Those of the closed form (B 3.17), in one and in three periods, fast and slow."""
    for periods, gap in ((1, 1.5e-4), (1, 3.5e-4), (3, 2e-4)):
        case = HarmonicResonance(
            omega=OMEGA, damping_rate=DAMPING, amplitude=1e-4 * DRIVE**2, frequency=DRIVE,
            restitution=restitution, periods=periods,
        )  # fmt: skip
        known = [each for each in case.regimes(gap) if each.admissible]
        speeds = [
            branch.impact_speed[i].max()
            for branch, i in regimes(harmonic_response(mount(gap, restitution)))
            if branch.periods == periods and len(branch.stops) == 2
        ]
        for each in known:
            assert any(speed == pytest.approx(each.impact_speed, rel=1e-9) for speed in speeds)


def special(found: HarmonicResponse, name: str, stops: int, periods: int = 1) -> list[float]:
    """Values of the special points of a name, of branches with so many impacts."""
    return [
        point.value
        for point in found.special_points
        for branch in [found.branches[point.branch]]
        if point.name == name and len(branch.stops) == stops and branch.periods == periods
    ]


@pytest.mark.slow
def test_grazings_and_folds_over_frequency_are_where_theory_has_them() -> None:
    """The amplitude without stops is the gap; the energy boundary (B 3.17) is the gap."""
    found = harmonic_response(mount(), [60.0, 90.0, 120.0])
    (fold,) = special(found, "fold", 2)
    case = HarmonicResonance(
        omega=OMEGA, damping_rate=DAMPING, amplitude=1e-4 * DRIVE**2,
        frequency=2.0 * math.pi * fold, restitution=0.5,
    )  # fmt: skip
    assert case.energy_boundary == pytest.approx(4e-4, rel=1e-9)
    grazing = harmonic_response(mount(), [45.0, 60.0])
    (free,) = special(grazing, "grazing", 0)
    w = 2.0 * math.pi * free
    amplitude = 1e-4 * DRIVE**2 / math.hypot(OMEGA**2 - w**2, DAMPING * w)
    assert amplitude == pytest.approx(4e-4, rel=1e-9)
    # the impacts of the slow branch vanish there as well
    assert any(value == pytest.approx(free, rel=1e-6) for value in special(grazing, "grazing", 2))


@pytest.mark.slow
@pytest.mark.parametrize(("ratio", "printed"), [(1.2, 18.733), (1.6, 6.0479), (1.9, 1.7343)])
def test_one_stop_exists_up_to_the_gap_of_the_book(ratio: float, printed: float) -> None:
    """Delta / a = sqrt(1 + 1 / B^2), B = (1 - R) tan(pi / ratio) / ((1 + R) ratio) (B 2.22)."""
    restitution = 0.8
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.0, stiffness=1.0),
        impact_pairs=[ImpactPair(upper=1.0, law=Restitution(coefficient=restitution))],
        excitations=[Sine(amplitude=abs(1.0 - ratio**2), frequency_hz=ratio / (2.0 * math.pi))],
    )
    found = harmonic_response(scene, vary={"impact_pair.0.upper": [1.1, 1.5, 20.0]})
    share = (1.0 - restitution) * math.tan(math.pi / ratio) / ((1.0 + restitution) * ratio)
    boundary = math.sqrt(1.0 + 1.0 / share**2)
    assert boundary == pytest.approx(printed, rel=5e-5)
    assert max(special(found, "fold", 1)) == pytest.approx(boundary, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("impact_pair.0.clearance", [3e-4, 5e-4]),
        ("excitation.0.amplitude", [34.0, 50.0]),
        ("impact_pair.0.law.coefficient", [0.3, 0.6]),
    ],
)
def test_any_key_of_the_scene_can_be_varied(key: str, values: list[float]) -> None:
    """The fold of the resonant branch lies where the energy boundary is the gap."""
    found = harmonic_response(mount(), vary={key: values})
    (fold,) = special(found, "fold", 2)
    given = {"impact_pair.0.clearance": 4e-4, "excitation.0.amplitude": 1e-4 * DRIVE**2}
    given = {**given, "impact_pair.0.law.coefficient": 0.5, key: fold}
    case = HarmonicResonance(
        omega=OMEGA, damping_rate=DAMPING, amplitude=given["excitation.0.amplitude"],
        frequency=DRIVE, restitution=given["impact_pair.0.law.coefficient"],
    )  # fmt: skip
    assert case.energy_boundary == pytest.approx(given["impact_pair.0.clearance"], rel=1e-8)


def test_a_period_doubling_has_a_multiplier_of_minus_one() -> None:
    """Of the map from one period to the next, by differences of the simulated motion."""
    found = harmonic_response(mount(), vary={"impact_pair.0.clearance": [3e-4, 4.5e-4, 6e-4]})
    points = [point for point in found.special_points if point.name == "period doubling"]
    assert points
    point = points[0]
    branch = found.branches[point.branch]
    i = branch.names.index("period doubling")
    flight = Bounces(mount(float(branch.value[i])))
    start = flight.start(branch.displacement[i], branch.velocity[i], branch.phase[i, 0])
    period = 2.0 * math.pi * branch.periods / flight.omega
    waiting = 0.4 * (branch.phase[i, 0] + 2.0 * math.pi * branch.periods - branch.phase[i, -1])
    # a place between two impacts, at which a small perturbation changes no time
    before = flight.flown(start, -waiting / flight.omega)
    columns = []
    for k in range(2):
        moved = []
        for sign in (1.0, -1.0):
            z, time = before.copy(), 0.0
            z[k] += sign * 1e-6 * abs(start[k])
            for _ in branch.stops:
                hit = flight.next_impact(z, period)
                assert hit is not None
                z, time = flight.struck(hit[2], hit[1]), time + hit[0]
            moved.append(flight.flown(z, period - time)[:2])
        columns.append((moved[0] - moved[1]) / (2e-6 * abs(start[k])))
    values = np.linalg.eigvals(np.array(columns).T)
    assert np.min(np.abs(values + 1.0)) < 1e-3


@pytest.mark.slow
def test_a_slow_sweep_jumps_where_its_regime_ends() -> None:
    """Up to the fold with impacts, down to where the motion without them meets the stops."""
    found = harmonic_response(mount(), [30.0, 45.0, 60.0, 120.0])
    down = found.jump_at(upwards=False)
    assert down == pytest.approx(special(found, "grazing", 0)[0], rel=1e-9)
    assert found.to_dict()["jumps"]["down_hz"] == down


def test_the_largest_jump_is_not_the_one_where_slow_impacts_set_in() -> None:
    """There the impact speed grows from zero, by any ratio, and yet by little."""
    found = harmonic_response(mount().model_copy(update={"impact_pairs": ()}), [40.0])
    start = Jump(
        upwards=True, value=8.0, frequency_hz=8.0, displacement_max=(1e-2, 1e-2),
        impact_speed=(0.0, 0.05),
    )  # fmt: skip
    drop = Jump(
        upwards=True, value=11.0, frequency_hz=11.0, displacement_max=(1e-2, 4e-3),
        impact_speed=(0.6, 0.0),
    )  # fmt: skip
    found = dataclasses.replace(found, jumps=(start, drop))
    assert found.jump_at(upwards=True) == 11.0 and found.jump_at(upwards=False) is None
    assert "a slow sweep up jumps at 2 places, most at 11 Hz" in found.summary()


def test_noise_is_left_out_with_a_warning_and_the_rest_is_refused_in_a_sentence() -> None:
    scene = mount()
    noisy = scene.model_copy(
        update={"excitations": (*scene.excitations, WhiteNoise(intensity=1e-9))}
    )
    assert "noise of the scene is left out" in harmonic_response(noisy).warnings[0]
    silent = scene.model_copy(update={"excitations": (WhiteNoise(intensity=1e-9),)})
    with pytest.raises(NotApplicable, match="needs an excitation of kind = 'sine'"):
        harmonic_response(silent)
    with pytest.raises(ValueError, match="frequency_hz must be greater than 0"):
        harmonic_response(scene, [-1.0, 2.0])
    with pytest.raises(ValueError, match="vary must be one key"):
        harmonic_response(scene, [1.0], vary={"structure.damping": [1.0]})


def test_strengths_of_a_sine_grow_with_the_frequency_as_they_should() -> None:
    """Displacement and unbalance as omega^2, velocity as omega, by the motion without impacts."""
    for strength, power in (("displacement", 2), ("velocity", 1), ("amplitude", 0)):
        sine = Sine(frequency_hz=1.0, on="base", **{strength: 0.1})
        scene = Scene(structure=Isolator(frequency_hz=3.0, zeta=0.1), excitations=[sine])
        free = harmonic_response(scene, [1.0, 2.0]).branches[0]
        for f, size in zip(free.frequency_hz, free.displacement_max, strict=True):
            w, own = 2.0 * math.pi * f, 6.0 * math.pi
            peak = 0.1 * w**power
            assert size == pytest.approx(peak / math.hypot(own**2 - w**2, 0.2 * own * w), rel=1e-9)
            transmitted = math.hypot(own**2, 0.2 * own * w) / math.hypot(
                own**2 - w**2, 0.2 * own * w
            )
            i = list(free.frequency_hz).index(f)
            assert free.acceleration_max[i] == pytest.approx(peak * transmitted, rel=1e-5)
    rotor = Sine(frequency_hz=2.0, unbalance=0.3)
    assert rotor.peak == pytest.approx(0.3 * (4.0 * math.pi) ** 2)


@pytest.mark.slow
def test_a_sum_of_sines_is_one_periodic_force() -> None:
    """Its regimes repeat themselves; another phase of a harmonic is another force."""
    scene = mount()
    (sine,) = scene.excitations
    speeds = []
    for phase in (0.0, 90.0):
        second = Sine(amplitude=20.0, frequency_hz=2.0 * sine.frequency_hz, phase_deg=phase)
        both = scene.model_copy(update={"excitations": (sine, second)})
        assert check_regimes(both) > 1
        found = regimes(harmonic_response(both))
        speeds.append(max(branch.impact_speed[i].max() for branch, i in found))
    assert abs(speeds[1] / speeds[0] - 1.0) > 1e-3


def undamped(restitution: float | None, turns: float = 1.0) -> Scene:
    """A unit mass on a unit spring under 0.3 cos(turns t), with or without stops at -1 and 1."""
    law = None if restitution is None else Restitution(coefficient=restitution)
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.0, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=law)] if law else [],
        excitations=[Sine(amplitude=0.3, frequency_hz=turns / (2.0 * math.pi))],
    )


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.5])
def test_resonance_without_damping_is_held_by_its_stops(restitution: float) -> None:
    # over half a period at resonance the force gives the momentum 0.3 pi / 2, which two opposite
    # impacts lose
    found = harmonic_response(undamped(restitution))
    branch = found.branches[0]
    assert len(found.branches) == 1
    assert branch.impact_speed == pytest.approx(0.15 * math.pi / (1.0 + restitution))
    assert branch.displacement_max == pytest.approx(1.0)


def test_resonance_without_damping_and_stops_has_no_regime() -> None:
    assert not harmonic_response(undamped(None)).branches
    beside = harmonic_response(undamped(None, turns=1.01))
    assert beside.branches[0].displacement_max == pytest.approx(0.3 / (1.01**2 - 1.0))


@pytest.mark.slow
def test_rounding_of_motion_without_damping_is_no_change_of_stability() -> None:
    found = harmonic_response(undamped(None), np.linspace(0.05, 0.5, 12))
    assert len(found.branches) == 1
    assert not found.special_points


def test_forces_too_slow_and_ranges_too_wide_are_refused() -> None:
    with pytest.raises(NotApplicable, match="must take at most 20000 steps"):
        harmonic_response(undamped(0.5), [1e-9, 1e-8])
    with pytest.raises(ValueError, match="factor"):
        harmonic_response(undamped(0.5), [1e-9, 1e9])


@pytest.mark.slow
def test_a_loose_mass_is_at_a_wall_at_every_impact_of_every_branch() -> None:
    """Also where the phases of impacts leave its place in the box all but undetermined."""
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
        absorber=Absorber(mass=0.05, play=2.0, law=Restitution(coefficient=0.8)),
        excitations=[Sine(amplitude=0.05, frequency_hz=0.5 / math.pi)],
    )
    found = harmonic_response(scene, np.linspace(0.8, 1.2, 9) / (2.0 * math.pi), most_impacts=2)
    assert len(found.branches) > 5
    for branch in found.branches:
        place = branch.displacement[:, 1] - branch.displacement[:, 0]
        side = 1.0 if branch.stops[0].endswith("upper") else -1.0
        assert place[branch.admissible] == pytest.approx(side, abs=1e-9)


def test_orders_of_impacts_that_are_not_tried_are_named() -> None:
    """With one impact a period the unstable clatter on both stops is missed; with two it is not."""
    one, two = (harmonic_response(mount(), most_impacts=most) for most in (1, 2))
    clatter = [
        [each for each in found.branches if len(each.stops) == 2 and each.periods == 1]
        for found in (one, two)
    ]
    assert len(clatter[0]) < len(clatter[1])
    few = [[each for each in found.warnings if "few orders" in each] for found in (one, two)]
    assert [len(each) for each in few] == [1, 0]
    assert one.assumptions != two.assumptions


def test_no_more_orders_of_impacts_are_listed_than_are_tried() -> None:
    few, many = (harmonic_response(undamped(0.5), most_impacts=most) for most in (6, 40))
    assert [each.stops for each in few.branches] == [each.stops for each in many.branches]


def clatter(points: int) -> HarmonicResponse:
    """A mass that hits both stops, loses its symmetry, and bounces without end, over frequency."""
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(clearance=0.5, law=Restitution(coefficient=0.6))],
        excitations=[Sine(amplitude=0.25, frequency_hz=0.2)],
    )
    return harmonic_response(scene, np.geomspace(0.1, 0.45, points), most_impacts=2)


@pytest.mark.slow
def test_special_points_and_jumps_do_not_depend_on_the_values_that_are_drawn() -> None:
    """Down: the symmetric regime loses its symmetry, and then jumps to one stop."""
    few, many = clatter(3), clatter(8)
    for found in (few, many):
        breaking = special(found, "symmetry breaking", 2)
        assert any(value == pytest.approx(0.151556, rel=1e-5) for value in breaking)
        down = [jump.value for jump in found.jumps if not jump.upwards]
        assert down[1] == pytest.approx(0.1514, rel=1e-3)
        # it rests from the stops just below the grazing, as long as chaos lasts
        assert 0.112 < down[-1] < 0.11311
        (told,) = found.warnings
        assert told == found.starts.warning and told.startswith("possibly chaotic motion from ")
        assert found.starts.sentence in found.summary() and told not in found.summary()
        low, high = found.starts.elsewhere
        assert 0.11 < low < 0.115 and 0.13 < high < 0.152
    named = [[(each.name, each.value) for each in found.special_points] for found in (few, many)]
    for name, value in named[0]:
        assert any(name == other and value == pytest.approx(at, rel=1e-7) for other, at in named[1])


def test_a_mass_that_rests_on_a_stop_for_a_part_of_the_period_is_listed() -> None:
    """Against flights from event to event, with bounces before the rest and without."""
    for restitution in (0.1, 0.0):
        scene = Scene(
            structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
            impact_pairs=[ImpactPair(upper=0.0, law=Restitution(coefficient=restitution))],
            excitations=[Sine(amplitude=1.0, frequency_hz=0.12)],
        )
        found = harmonic_response(scene)
        (branch,) = [each for each in found.branches if each.sticking]
        (place,) = branch.at(0.12)
        mass = Mass(1.0, 0.1, 1.0, 0.0, -math.inf, 0.0, restitution, 0.0, 0.0)
        known = settled(mass, 2.0 * math.pi * 0.12, np.array([-1.0, 0.0]))
        assert known.rest > 0.0 and known.periods == branch.periods
        assert branch.displacement_max[place] == pytest.approx(known.size, rel=1e-6)
        assert branch.impact_speed[place].max() == pytest.approx(known.speed, rel=1e-7)
        assert branch.stable[place] and found.starts.all_listed and not found.warnings


def test_a_mass_that_is_pressed_on_its_stop_all_the_time_is_listed() -> None:
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(upper=0.2, law=Restitution(coefficient=0.5))],
        excitations=[Sine(amplitude=0.1, frequency_hz=0.12), ConstantLoad(force=0.5)],
    )
    found = harmonic_response(scene)
    (branch,) = [each for each in found.branches if each.stable.any()]
    assert branch.sticking and not branch.stops
    assert branch.displacement_max == pytest.approx([0.2]) and found.starts.all_listed
