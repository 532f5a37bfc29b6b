"""Basins, bifurcations and exponents against a simulation that shares no code with them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stochvi import (
    ImpactPair,
    Matrices,
    NotApplicable,
    NotConverged,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    WhiteNoise,
    harmonic_response,
)
from stochvi.methods.periodic import Basins, basins, bifurcation, lyapunov_exponent
from stochvi.methods.periodic.attracted import BLOCK, FIRST, block_of
from support.bounces import Bounces
from support.refusals import refusals

GAP, DRIVE = 4e-4, 200.0 * math.pi
"""Clearance (m) and frequency (rad/s) of a mount that may clatter or stay clear of its stops."""


def mount() -> Scene:
    """An oscillator between two stops, driven at ten times its natural frequency."""
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.02 * DRIVE, stiffness=(0.1 * DRIVE) ** 2),
        impact_pairs=[ImpactPair(clearance=GAP, law=Restitution(coefficient=0.6))],
        excitations=[Sine(amplitude=1e-4 * DRIVE**2, frequency_hz=DRIVE / (2.0 * math.pi))],
    )


def hammer(ratio: float, restitution: float = 0.8, damping: float = 0.05) -> Scene:
    """An oscillator of frequency 1 rad/s that rests against one stop."""
    return Scene(
        structure=Oscillator(mass=1.0, damping=damping, stiffness=1.0),
        impact_pairs=[ImpactPair(upper=0.0, law=Restitution(coefficient=restitution))],
        excitations=[Sine(amplitude=1.0, frequency_hz=ratio / (2.0 * math.pi))],
    )


def two_masses() -> Scene:
    """Two masses on springs; the first lies between stops."""
    return Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=[[1.0, 0.0], [0.0, 0.5]],
            damping=[[0.3, -0.1], [-0.1, 0.2]], stiffness=[[3.0, -1.0], [-1.0, 1.5]],
        ),
        impact_pairs=[ImpactPair(on="a", clearance=0.6, law=Restitution(coefficient=0.7))],
        excitations=[Sine(amplitude=1.0, frequency_hz=3.5 / (2.0 * math.pi), on="a")],
    )  # fmt: skip


def plane(scale: float, number: int) -> dict[str, list[float]]:
    """Starts of the mount between its stops."""
    return {
        "displacement.x": np.linspace(-0.99 * GAP, 0.99 * GAP, number).tolist(),
        "velocity.x": np.linspace(-scale, scale, number).tolist(),
    }


def last_speeds(
    scene: Scene, displacement: np.ndarray, velocity: np.ndarray, periods: int
) -> list[float]:
    """Impact speeds of the last two of some periods, by the other simulation."""
    flight = Bounces(scene, steps=60)
    z, time, found = flight.start(displacement, velocity, 0.0), 0.0, []
    period = 2.0 * math.pi / flight.omega
    end = periods * period
    while (hit := flight.next_impact(z, end - time)) is not None:
        time += hit[0]
        if time > end - 2.0 * period:
            found.append(flight.speed(hit[2], hit[1]))
        z = flight.struck(hit[2], hit[1])
    return found


def check_starts(scene: Scene, found: Basins, starts: list[tuple[int, int]], periods: int) -> None:
    """Each start ends in impacts of the speeds of its regime."""
    names = [f"{what}.{name}" for what in ("displacement", "velocity")
             for name in scene.structure.coordinates]  # fmt: skip
    for row, column in starts:
        state = np.zeros(len(names))
        state[names.index(found.plane[0])] = found.across[column]
        state[names.index(found.plane[1])] = found.up[row]
        n = len(names) // 2
        speeds = last_speeds(scene, state[:n], state[n:], periods)
        regime = found.regimes[found.ends[row, column]]
        assert max(speeds, default=0.0) == pytest.approx(regime.impact_speed_max, rel=1e-3)
        if regime.periods == 1:
            assert len(speeds) in (2 * regime.impacts - 1, 2 * regime.impacts)


@pytest.fixture(scope="module")
def mapped() -> Basins:
    return basins(mount(), plane(0.25, 24), threads=1)


@pytest.mark.slow
def test_starts_end_where_another_simulation_ends(mapped: Basins) -> None:
    assert mapped.undecided == 0.0
    assert {regime.impacts for regime in mapped.regimes} == {0, 2}
    random = np.random.default_rng(3)
    starts = [
        (int(row), int(column))
        for number in (0, 1)
        for row, column in random.permutation(np.argwhere(mapped.ends == number))[:2]
    ]
    check_starts(mount(), mapped, starts, 25)


def test_a_regime_is_stated_where_another_simulation_comes_back_to_it(mapped: Basins) -> None:
    for regime in mapped.regimes:
        place, rate = float(regime.displacement[0]), float(regime.velocity[0])
        flight = Bounces(mount(), steps=60)
        state = flight.start(np.array([place]), np.array([rate]), math.radians(mapped.phase_deg))
        time, end, speeds = 0.0, regime.periods * 2.0 * math.pi / flight.omega, []
        while (hit := flight.next_impact(state, end - time)) is not None:
            time += hit[0]
            speeds.append(flight.speed(hit[2], hit[1]))
            state = flight.struck(hit[2], hit[1])
        state = flight.flown(state, end - time)
        assert state[:2] == pytest.approx([place, rate], rel=1e-3, abs=1e-4 * GAP)
        assert len(speeds) == regime.impacts
        assert max(speeds, default=0.0) == pytest.approx(regime.impact_speed_max, rel=1e-3)


def test_the_plane_of_a_structure_of_two_coordinates() -> None:
    sides = {"velocity.a": [-1.5, 0.0, 1.5], "velocity.b": [-2.0, 2.0]}
    found = basins(two_masses(), sides, threads=1)
    assert found.ends.shape == (2, 3) and found.undecided == 0.0
    check_starts(two_masses(), found, [(0, 0), (1, 2)], 40)


def test_regimes_are_named_by_their_impacts_and_periods() -> None:
    """A hammer that is struck every second period, and one whose stop is struck twice in a row."""
    sides = {"displacement.x": [-0.3], "velocity.x": [0.1]}
    names = [basins(hammer(ratio), sides, threads=1).regimes[0].name for ratio in (2.5, 4.0)]
    assert names == ["stops upper", "stops upper in 2 periods"]


def test_disturbances_of_a_regime_of_several_periods_shrink_as_a_flight_shows() -> None:
    (regime,) = basins(
        hammer(4.0), {"displacement.x": [-0.3], "velocity.x": [0.1]}, threads=1
    ).regimes
    flown = lyapunov_exponent(
        hammer(4.0), {"displacement.x": -0.3, "velocity.x": 0.1}, settling=200, periods=2000
    )
    assert regime.periods == 2 and regime.lyapunov.value < 0.0
    assert abs(flown.value - regime.lyapunov.value) < 4.0 * flown.standard_error + 1e-3 * abs(
        regime.lyapunov.value
    )


def test_shares_and_the_regime_at_a_point(mapped: Basins) -> None:
    for number, regime in enumerate(mapped.regimes):
        assert regime.share == pytest.approx(np.mean(mapped.ends == number))
    clatter = next(each for each in mapped.regimes if each.impacts)
    # a regime lies in its own basin
    assert mapped.at(clatter.displacement[0], clatter.velocity[0]) is clatter
    assert len(mapped.to_frame()) == 24 * 24


def test_half_a_period_later_the_even_mount_is_turned_over(mapped: Basins) -> None:
    later = basins(mount(), plane(0.25, 24), phase_deg=180.0, threads=1)
    names = [[regime.name for regime in found.regimes] for found in (mapped, later)]
    assert names[0] == names[1]
    assert np.mean(later.ends[::-1, ::-1] == mapped.ends) > 0.99
    assert np.mean(later.ends == mapped.ends) < 0.9


def test_starts_beyond_a_stop_belong_to_nothing() -> None:
    sides = {"displacement.x": [-2.0 * GAP, 0.0, 2.0 * GAP], "velocity.x": [0.0]}
    found = basins(mount(), sides, threads=1)
    assert found.ends.tolist() == [[-2, 0, -2]]
    assert found.regimes[0].share == 1.0
    with pytest.raises(ValueError, match="all its points lie beyond a stop"):
        basins(mount(), {"displacement.x": [1.0], "velocity.x": [0.0]})


def test_chaos_coexists_with_a_regime_and_is_recognised_as_one_motion() -> None:
    sides = {"displacement.x": np.linspace(-0.7, 0.0, 12), "velocity.x": np.linspace(-0.8, 0.8, 12)}
    found = basins(hammer(2.65), sides, threads=1)
    kinds = {regime.kind: regime for regime in found.regimes}
    assert set(kinds) == {"periodic", "chaotic"} and len(found.regimes) == 2
    assert found.undecided < 0.02
    chaos = kinds["chaotic"].lyapunov
    assert chaos is not None and chaos.value > 5.0 * chaos.standard_error
    assert kinds["chaotic"].share == pytest.approx(0.41, abs=4.0 * math.sqrt(0.24 / 144))


def test_a_motion_that_rests_on_a_stop_is_regular_where_it_attracts() -> None:
    """In 0.52 mm it repeats itself in three periods; in 0.47 mm rounding decides what follows."""
    kinds = []
    for clearance, speeds in ((5.2e-4, [-0.5, -0.2, 0.0, 0.2, 0.5]), (4.7e-4, [-0.5, 0.0])):
        law = Restitution(coefficient=0.5)
        pair = ImpactPair(clearance=clearance, law=law)
        scene = mount().model_copy(update={"impact_pairs": (pair,)})
        sides = {"displacement.x": [-4e-4, 0.0], "velocity.x": speeds}
        found = basins(scene, sides, threads=1, periods=50)
        kinds.append({(each.kind, each.periods) for each in found.regimes})
        resting = [each.lyapunov for each in found.regimes if each.kind == "other regular"]
        assert resting == [None] * len(resting)
    assert kinds == [{("periodic", 1), ("other regular", 3)}, {("periodic", 1)}]
    assert found.undecided > 0.0


def test_a_motion_of_two_frequencies_is_regular() -> None:
    """Elastic stops and no damping: nothing attracts, and no perturbation grows."""
    sides = {"displacement.x": [0.0], "velocity.x": [-1.5, 1.7]}
    law = Restitution(coefficient=1.0)
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.0, stiffness=1.0),
        impact_pairs=[ImpactPair(clearance=1.0, law=law)],
        excitations=[Sine(amplitude=0.01, frequency_hz=0.1)],
    )
    done: list[float] = []
    found = basins(
        scene, sides, periods=20, threads=2, progress=lambda share, _: done.append(share)
    )
    assert done == sorted(done) and (done[0], done[-1]) == (0.0, 1.0 - found.undecided)
    assert found.cost.threads == 2
    assert {regime.kind for regime in found.regimes} == {"other regular"}
    start = {"velocity.x": 1.7}
    # a perturbation grows as the number of periods, not as its exponential
    for periods in (300, 2000):
        rate = lyapunov_exponent(scene, start, periods=periods)
        assert abs(rate.value) < 4.0 * rate.standard_error
    chaotic = lyapunov_exponent(hammer(2.8), periods=300)
    assert chaotic.value > max(0.03, 4.0 * chaotic.standard_error)


@pytest.mark.parametrize(("start", "impacts"), [(0.0, 0), (-0.3, 2)])
def test_the_exponent_of_a_stable_regime_is_that_of_its_multiplier(
    start: float, impacts: int
) -> None:
    known = harmonic_response(mount()).at(DRIVE / (2.0 * math.pi))
    row = known[known["stable"] & (known["impacts_per_period"] == impacts)].iloc[0]
    rate = lyapunov_exponent(mount(), {"velocity.x": start}, settling=200, periods=2000)
    expected = math.log(row["multiplier"]) * DRIVE / (2.0 * math.pi)
    assert abs(rate.value - expected) < 4.0 * rate.standard_error + 1e-3 * abs(expected)


def growth(scene: Scene, velocity: float, settling: int, periods: int) -> np.ndarray:
    """Logarithm by which the distance of two neighbours grows in each period, 1e-7 apart."""
    flight = Bounces(scene, steps=40)
    period = 2.0 * math.pi / flight.omega

    def after(z: np.ndarray) -> np.ndarray:
        time = 0.0
        while (hit := flight.next_impact(z, period - time)) is not None and time + hit[0] < period:
            time += hit[0]
            z = flight.struck(hit[2], hit[1])
        return flight.flown(z, period - time)

    z = flight.start(np.zeros(1), np.array([velocity]), 0.0)
    for _ in range(settling):
        z = after(z)
    away, found = np.array([1.0, 0.0]), []
    for _ in range(periods):
        other = z.copy()
        other[:2] += 1e-7 * away
        z, other = after(z), after(other)
        away = (other - z)[:2] / 1e-7
        found.append(math.log(float(np.linalg.norm(away))))
        away /= np.linalg.norm(away)
    return np.array(found)


def test_the_exponent_of_chaos_is_the_growth_between_two_neighbours() -> None:
    ratio, periods = 2.8, 160
    parts = np.array(
        [part.mean() for part in np.array_split(growth(hammer(ratio), 0.3, 20, periods), 16)]
    )
    per_second = ratio / (2.0 * math.pi)
    rate, error = per_second * parts.mean(), per_second * parts.std(ddof=1) / 4.0
    found = lyapunov_exponent(hammer(ratio))
    assert found.value > 5.0 * found.standard_error
    assert abs(found.value - rate) < 4.0 * math.hypot(error, found.standard_error)
    # the perturbation of a lossier stop grows at another rate
    assert abs(lyapunov_exponent(hammer(ratio, restitution=0.6)).value - found.value) > 0.02


def test_a_motion_that_rests_on_a_stop_has_no_exponent() -> None:
    with pytest.raises(NotApplicable, match="without rests on a stop"):
        lyapunov_exponent(hammer(0.3, restitution=0.3))


@pytest.mark.slow
def test_a_sweep_doubles_its_period_where_the_exact_regime_does() -> None:
    values = np.linspace(2.6, 2.75, 16) / (2.0 * math.pi)
    exact = harmonic_response(hammer(2.6), values)
    (doubling,) = (
        point.value
        for point in exact.special_points
        if point.name == "period doubling" and len(exact.branches[point.branch].stops) == 1
    )
    (sweep,) = bifurcation(hammer(2.6), values).sweeps
    before, after = sweep.value < doubling - 1e-3, sweep.value > doubling + 1e-3
    assert np.any(before) and np.all(sweep.periods[before] == 1)
    assert np.all(sweep.periods[after] != 1)


def test_sweeps_up_and_down_keep_their_motion_until_it_ends() -> None:
    values = [90.0, 100.0, 110.0, 120.0]
    found = bifurcation(
        mount(), values, sweep="both", start={"velocity.x": -0.2}, watched=64, settling=200
    )
    up, down = found.sweeps
    assert up.value.tolist() == pytest.approx(values)
    assert down.value.tolist() == pytest.approx(values[::-1])
    known = harmonic_response(mount(), values)
    clatter = next(
        branch for branch in known.branches
        if branch.periods == 1 and len(branch.stops) == 2 and branch.stable.any()
    )  # fmt: skip
    for number, value in enumerate(up.value):
        speeds = [clatter.impact_speed[i].max() for i in clatter.at(value) if clatter.stable[i]]
        if speeds:
            assert up.impact_speed[number].max() == pytest.approx(speeds[0], rel=1e-6)
            assert len(up.impact_speed[number]) == 2 * 64
            assert set(up.stop[number]) == {"stops lower", "stops upper"}
    # beyond the fold the motion has no impacts, and a sweep down from there finds none again
    assert all(len(each) == 0 for each in down.impact_speed)
    assert len(found.to_frame()) == sum(max(len(each), 1) for sweep in found.sweeps
                                        for each in sweep.impact_speed)  # fmt: skip


test_a_plane_that_is_none_is_refused = refusals(
    lambda sides: basins(mount(), sides),
    ({"displacement.x": [0.0]}, "plane must be two of displacement.x, velocity.x"),
    ({"displacement.y": [0.0], "velocity.x": [0.0]}, "plane must be two of"),
    ({"displacement.x": [math.nan], "velocity.x": [0.0]}, "must have finite values"),
    ({"displacement.x": [0.0], "velocity.x": []}, "must have finite values"),
    error=ValueError,
)


def test_what_does_not_apply_is_refused_in_a_sentence() -> None:
    silent = mount().model_copy(update={"excitations": (WhiteNoise(intensity=1e-9),)})
    for ask in (basins, lyapunov_exponent):
        with pytest.raises(NotApplicable, match="needs an excitation of kind = 'sine'"):
            ask(silent)
    with pytest.raises(ValueError, match="start must name some of"):
        lyapunov_exponent(mount(), {"speed": 1.0})
    with pytest.raises(ValueError, match="sweep must be"):
        bifurcation(mount(), [90.0, 100.0], sweep="sideways")
    with pytest.raises(ValueError, match="at least two values"):
        bifurcation(mount(), [90.0])
    with pytest.raises(NotConverged, match="ask for fewer") as ended:
        basins(mount(), plane(0.6, 30), budget=1e-6)
    assert ended.value.partial.undecided == 1.0


def test_starts_that_fly_long_are_flown_in_smallerblock_of() -> None:
    """The clock was looked at after 256 starts however many periods each was flown for."""
    for periods in (1, FIRST, 10 * FIRST, 10_000):
        most = block_of(periods)
        assert most == 1 or most * max(periods, FIRST) <= BLOCK * FIRST
