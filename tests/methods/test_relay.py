"""Drives that switch by the motion, with noise: a density, a twin of small steps, and formulas."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stochvi import (
    Elastic,
    Estimate,
    ImpactPair,
    NotApplicable,
    Oscillator,
    Response,
    Restitution,
    Scene,
    SceneError,
    WhiteNoise,
    fokker_planck,
    linearise,
    simulate,
)
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.periodic import RelayBetweenStops, SwitchedDrive
from stochvi.model.model import model_of
from stochvi.scenes import Relay
from stochvi.testing import assert_agrees
from stochvi.verification.explain import explain
from support.accuracies import quick_cases
from support.relays import RelayTwin

QUANTITIES = {"xx": "displacement_mean_square", "vv": "velocity_mean_square"}
SUMS = {"f1": "impact_speed_rate", "f2": "impact_speed_square_rate"}


def scene_of(twin: RelayTwin, intensity: float | None = None) -> Scene:
    """The scene of a twin."""
    law: Any = (
        Restitution(coefficient=twin.restitution)
        if twin.stop_stiffness is None
        else Elastic(stiffness=twin.stop_stiffness)
    )
    stops = {
        name: place
        for name, place in (("lower", twin.lower), ("upper", twin.upper))
        if math.isfinite(place)
    }
    places = {
        name: place
        for name, place in (("reverses_above", twin.above), ("reverses_below", twin.below))
        if math.isfinite(place)
    }
    return Scene(
        structure=Oscillator(
            mass=1.0, damping=twin.damping, stiffness=twin.frequency**2,
            damper=Relay(force=twin.force, delay=twin.delay, **places),
        ),
        impact_pairs=[ImpactPair(**stops, law=law)],
        excitations=[WhiteNoise(intensity=twin.intensity if intensity is None else intensity)],
    )  # fmt: skip


def told(found: Response) -> dict[str, Estimate]:
    x, pair = found.coordinates["x"], found.impact_pairs["stops"]
    known = {name: x[each] for name, each in QUANTITIES.items()}
    return known | {name: pair[each] for name, each in SUMS.items()}


def agree(found: Response, known: dict[str, tuple[float, float]]) -> list[bool]:
    """Whether each quantity agrees with that of the twin within both errors."""
    agreed = []
    for name, estimate in told(found).items():
        value, error = known[name]
        both = Estimate(
            value=estimate.value, standard_error=math.hypot(estimate.standard_error, error),
            # the twin has steps of 4e-4 s, over flights of a second
            bias=(estimate.bias or 0.0) + 2e-3 * value, bias_error=estimate.bias_error,
        )  # fmt: skip
        agreed.append(abs(both.value - value) <= both.reach(4.5))
    return agreed


BETWEEN = RelayTwin(
    force=1.0, damping=0.2, frequency=1.0, intensity=0.05, lower=-1.0, upper=1.0, restitution=0.6
)
STRIKER = RelayTwin(
    force=10.0, damping=1.0, frequency=0.03, intensity=0.5, lower=0.0, restitution=0.5, above=0.43
)
TWINS = {
    "striker": STRIKER,
    "late striker": RelayTwin(**{**vars(STRIKER), "delay": 0.03}),
    "late between stops": RelayTwin(**{**vars(BETWEEN), "delay": 0.05}),
    "late on a compliant stop": RelayTwin(
        **{**vars(STRIKER), "delay": 0.03, "damping": 1.5, "stop_stiffness": 2e4}
    ),
    "reversed on both sides": RelayTwin(
        **{**vars(BETWEEN), "above": 0.4, "below": -0.5, "force": 3.0}
    ),
}


@pytest.mark.slow
@quick_cases("name", list(TWINS), keep=(1, 3))
def test_simulation_has_the_motion_of_a_relay_that_sees_the_past(name: str) -> None:
    twin = TWINS[name]
    found = simulate(scene_of(twin), paths=64, duration=60.0, seed=3)
    assert all(agree(found, twin.averages(64, 10.0, 60.0, 4e-4)))
    # the control: a relay of no delay, or a force that is larger by a twentieth
    changed = {"delay": 0.0} if twin.delay else {"force": 1.05 * twin.force}
    other = RelayTwin(**{**vars(twin), **changed})
    assert not all(agree(found, other.averages(64, 10.0, 60.0, 4e-4)))


def test_a_relay_between_stops_has_the_density_of_fokker_and_planck() -> None:
    scene = scene_of(BETWEEN)
    known = told(fokker_planck(scene))
    found = simulate(scene, paths=128, duration=100.0, seed=1)
    for name, estimate in told(found).items():
        assert_agrees(estimate, known[name].value)
    assert_agrees(found.identities["energy"], 0.0)


@pytest.mark.parametrize("restitution", [0.1, 0.3])
def test_rates_have_a_bias_where_no_impact_can_be_slow(restitution: float) -> None:
    twin = RelayTwin(**{**vars(BETWEEN), "restitution": restitution})
    keys = {"speed_threshold": 0.02}
    known = fokker_planck(scene_of(twin), **keys).impact_pairs["stops"]
    weaker = RelayTwin(**{**vars(twin), "force": 0.85 * twin.force})
    wrong = fokker_planck(scene_of(weaker), **keys).impact_pairs["stops"]
    found = simulate(scene_of(twin), paths=128, duration=100.0, seed=1, **keys)
    for name in ("collision_rate", "impact_speed_mean"):
        estimate = found.impact_pairs["stops"][name]
        assert estimate.bias is not None
        assert_agrees(estimate, known[name].value)
        with pytest.raises(AssertionError):
            assert_agrees(estimate, wrong[name].value)
    assert not any("not resolved" in each for each in found.warnings)


@pytest.mark.parametrize(("intensity", "restitution"), [(20.0, 0.4), (0.5, 0.0)])
def test_rates_have_no_bias_where_impacts_may_be_slow(intensity: float, restitution: float) -> None:
    """Strong noise throws a striker back to its stop; without rebound it stays there."""
    twin = RelayTwin(**{**vars(STRIKER), "intensity": intensity, "restitution": restitution})
    found = simulate(scene_of(twin), paths=64, duration=20.0, seed=3)
    assert found.impact_pairs["stops"]["collision_rate"].bias is None


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [0.3, 0.4])
def test_the_stated_bias_holds_that_of_the_step(restitution: float) -> None:
    twin = RelayTwin(**{**vars(STRIKER), "restitution": restitution})
    found = simulate(scene_of(twin), paths=128, duration=60.0, seed=3)
    rate = found.impact_pairs["stops"]["collision_rate"]
    plan = make_plan(model_of(scene_of(twin)), duration=60.0)
    finer = plan.with_step(plan.step / 8.0)
    rows = dict(zip(finer.layout.rows, finer.averages(4, 0, 128), strict=True))
    counted = rows["stops", "n_lower"]
    error = math.hypot(rate.standard_error, float(counted.std()) / math.sqrt(128))
    assert rate.bias is not None
    assert abs(rate.value - float(counted.mean())) < rate.bias + 4.5 * error


def test_in_weak_noise_it_is_the_motion_without_noise() -> None:
    drive = RelayBetweenStops(
        force=1.0, clearance=1.0, restitution=0.6, damping_rate=0.2, frequency=1.0
    )
    found = told(simulate(scene_of(BETWEEN, 1e-4), paths=32, duration=100.0, seed=2))
    for name, power in (("f1", 1), ("f2", 2)):
        wanted = 2.0 * drive.impact_speed**power / drive.period
        # an impact more or less in 100 s, as all paths move alike
        assert found[name].value == pytest.approx(
            wanted, abs=found[name].reach(4.5) + 0.006 * wanted
        )
    plain = 2.0 * math.sqrt(1.0 / (1.0 - 0.6**2))  # the control: without the damper
    assert abs(plain / drive.impact_speed - 1.0) > 0.05


def thrown(damping: float) -> float:
    """Speed of the impacts in the long run of a striker with a damper, by an integrator with
    events."""
    speed = 4.0
    for _ in range(25):
        state = [0.0, 0.5 * speed]
        for side, reaches in ((1.0, 0.43), (-1.0, 0.0)):

            def there(t: float, y: np.ndarray, reaches: float = reaches) -> float:
                return y[0] - reaches

            there.terminal, there.direction = True, side
            solved = solve_ivp(
                lambda t, y, side=side: [y[1], 10.0 * side - damping * y[1]], (0.0, 10.0), state,
                events=there, rtol=1e-9, atol=1e-11,
            )  # fmt: skip
            state = solved.y[:, -1].tolist()
        speed = -state[1]
    return speed


@pytest.mark.slow
def test_in_weak_noise_a_striker_is_that_of_the_formula() -> None:
    """By an integrator, which has the speed of the formula without a damper."""
    drive = SwitchedDrive(restitution=0.5, force=10.0, switching=0.43)
    assert thrown(0.0) == pytest.approx(drive.impact_speed, rel=1e-6)
    found = told(simulate(scene_of(STRIKER, 1e-3), paths=16, duration=60.0, seed=2))
    assert found["f2"].value / found["f1"].value == pytest.approx(thrown(1.0), rel=3e-3)
    assert abs(thrown(1.0) / drive.impact_speed - 1.0) > 0.1  # the control: the damper matters


@pytest.mark.slow
def test_what_a_relay_is_and_who_refuses_it() -> None:
    late = scene_of(TWINS["late striker"])
    found = explain(late)
    assert "drive by a relay with a delay" in found.effects
    assert found.methods["simulate"] == "applies"
    with pytest.raises(NotApplicable, match="got hysteresis of kind 'relay'"):
        fokker_planck(late)
    with pytest.raises(
        NotApplicable, match="must switch by the velocity, got a relay that is late"
    ):
        linearise(late)
    with pytest.raises(SceneError, match="needs reverses_below under reverses_above"):
        Relay(force=1.0, reverses_above=0.1, reverses_below=0.2)
