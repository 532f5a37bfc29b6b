"""Resonance of a structure that noise would have to maintain: its regimes, power and durations."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from stochvi import (
    ImpactPair,
    Matrices,
    NotApplicable,
    Restitution,
    Scene,
    Sine,
    TabulatedNoise,
    WhiteNoise,
    harmonic_response,
)
from stochvi.methods.monte_carlo.kernels.random_numbers import seed_streams
from stochvi.methods.monte_carlo.modal import plan_modal
from stochvi.methods.periodic import RandomResonance, StructureResonance
from stochvi.model.model import model_of
from stochvi.results.estimates import Estimate
from stochvi.scenes import Beam, Modes

MASS = np.diag([2.0, 1.0, 1.5])
STIFFNESS = np.array([[5.0, -2.0, 0.0], [-2.0, 4.0, -1.0], [0.0, -1.0, 3.0]])
DAMPING = 0.01 * STIFFNESS


def chain(*pairs: ImpactPair, noise: Any = None, damping: float = 1.0) -> Scene:
    """Three masses on springs."""
    return Scene(
        structure=Matrices(
            coordinates=["a", "b", "c"], mass=MASS, damping=damping * DAMPING, stiffness=STIFFNESS
        ),
        impact_pairs=list(pairs),
        excitations=[noise or WhiteNoise(on="b", intensity=0.02)],
    )


def stop(name: str = "stop", on: Any = "c", restitution: float = 0.8, **at: float) -> ImpactPair:
    place = {"between": on} if isinstance(on, list) else {"on": on}
    return ImpactPair(name=name, **place, **at, law=Restitution(coefficient=restitution))


SCENES: dict[str, tuple[Scene, float, dict[str, Any]]] = {
    "one stop": (chain(stop(upper=1.0)), 1.17, {}),
    "lower stop": (chain(stop(lower=-1.0)), 1.17, {}),
    "two stops": (chain(stop(clearance=1.0)), 1.6, {}),
    "between two masses": (chain(stop(on=["a", "c"], clearance=1.0)), 2.6, {}),
    "two pairs": (chain(stop("one", "a", clearance=0.8), stop("two", clearance=1.0)), 1.6, {}),
    "opposed pairs": (
        chain(stop("one", "a", clearance=0.5), stop("two", clearance=1.0)), 2.2,
        {"opposed": ["one"]},
    ),
}  # fmt: skip
"""A scene, the frequency of a regime in rad/s, and what else says which one."""


def found(name: str) -> tuple[Scene, StructureResonance]:
    scene, frequency, how = SCENES[name]
    return scene, StructureResonance.of(scene, frequency / math.tau, **how)


def from_impact_to_impact(
    scene: Scene, case: StructureResonance, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """States (2 n, steps + 1) of the masses in one period without loss, by the flow of the
    undamped structure, from just after an impact; impacts on their pairs by the impulses given."""
    model = model_of(scene)
    n, h = 3, case.period / steps
    generator = np.block(
        [[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(MASS, STIFFNESS), np.zeros((n, n))]]
    )
    flow = scipy.linalg.expm(generator * h)
    shapes = model.modal.shapes
    q, v = case.response(np.zeros(1))
    force = -np.asarray(case.gaps).T @ case.impulse
    state = np.concatenate([shapes @ (q[:, 0] * force), shapes @ (v[:, 0] * force)])
    states = [state]
    for step in range(1, steps + 1):
        state = flow @ state
        states.append(state)
        if case.both_sides and step == steps // 2:
            state = state.copy()
            state[n:] -= shapes @ force  # the impulse on the other stops
    return np.array(states).T, shapes @ force


@pytest.mark.parametrize("name", SCENES)
def test_a_regime_is_a_free_motion_from_impact_to_impact(name: str) -> None:
    scene, case = found(name)
    states, kick = from_impact_to_impact(scene, case, 2000)
    start, end = states[:, 0], states[:, -1]
    rows = np.asarray(case.gaps) @ np.linalg.inv(model_of(scene).modal.shapes)
    # the impulse at the end of the period makes the motion start again
    assert end[:3] == pytest.approx(start[:3], abs=1e-9)
    assert end[3:] + kick == pytest.approx(start[3:], abs=1e-9)
    assert rows @ start[:3] == pytest.approx(case.clearance, rel=1e-12)
    assert rows @ end[3:] == pytest.approx(case.impact_speed, rel=1e-9)
    assert rows @ start[3:] == pytest.approx(-case.impact_speed, rel=1e-9)
    assert case.admissible
    strain = start[:3] @ STIFFNESS @ start[:3] + start[3:] @ MASS @ start[3:]
    assert case.energy == pytest.approx(0.5 * strain, rel=1e-12)
    # what noise on b supplies, and what dampers take
    speeds = states[3:, :-1]
    if not case.both_sides:
        speeds = 0.5 * (states[3:, :-1] + states[3:, 1:])
    damped = np.mean(np.einsum("it,ij,jt->t", speeds, DAMPING, speeds))
    impacts = (2.0 if case.both_sides else 1.0) / case.period
    lost = impacts * (0.2 / 1.8) * float(case.impulse @ case.impact_speed)
    assert case.power_loss == pytest.approx(damped + lost, rel=5e-3)
    square = np.mean(speeds[1] ** 2)
    assert case.random_power(7.0) == pytest.approx(math.sqrt(0.02 * square / 7.0), rel=5e-3)


def test_one_mass_is_the_case_of_one_mode() -> None:
    scene = Scene(
        structure={"kind": "oscillator", "mass": 2.0, "damping": 0.04, "stiffness": 2.0},
        impact_pairs=[ImpactPair(clearance=1.0, law=Restitution(coefficient=0.8))],
        excitations=[WhiteNoise(intensity=0.04)],
    )
    one = RandomResonance(
        omega=1.0, damping_rate=0.02, clearance=1.0, restitution=0.8, frequency=1.7
    )
    case = StructureResonance.of(scene, 1.7 / math.tau)
    assert case.impact_speed[0] == pytest.approx(one.impact_speed, rel=1e-12)
    assert case.power_loss == pytest.approx(2.0 * one.power_loss, rel=1e-12)
    assert case.longest() == pytest.approx(one.longest(0.01), rel=1e-12)


def test_noise_of_a_table_supplies_by_its_harmonics() -> None:
    flat = TabulatedNoise(on="b", frequency_hz=[1e-3, 100.0], density=[0.04, 0.04], unit="N2/Hz")
    _, white = found("two stops")
    table = StructureResonance.of(chain(stop(clearance=1.0), noise=flat), 1.6 / math.tau)
    assert table.longest() == pytest.approx(white.longest(), rel=5e-3)
    shapes = model_of(chain(stop(clearance=1.0))).modal.shapes
    first = white.harmonics(shapes[1])[0]
    rms = white.smallest_narrow_band(shapes[1])
    assert 2.0537489106318225 * rms * first / 2.0 == pytest.approx(white.power_loss)


def share_maintained(scene: Scene, case: StructureResonance, seconds: float) -> Estimate:
    """Share of paths that start in the regime and have its number of impacts in this time."""
    plan = plan_modal(model_of(scene), 0.0, None)
    steps = math.ceil(seconds / plan.step)
    plan, paths = plan.with_step(seconds / steps), 2000
    streams = np.empty((2, paths), np.uint64)
    seed_streams(np.uint64(5), 0, streams)
    q, v = case.response(np.zeros(1))
    force = (-np.asarray(case.gaps).T @ case.impulse)[:, None]
    state = np.ascontiguousarray(np.tile(np.concatenate([q * force, v * force]), paths))
    hits = plan.counts(state, streams, steps)[0].sum(axis=0)
    wanted = seconds / case.period * (2.0 if case.both_sides else 1.0)
    share = float(np.mean(hits >= math.floor(wanted)))
    return Estimate(value=share, standard_error=math.sqrt(max(share, 1e-3) / paths))


@pytest.mark.parametrize(("restitution", "frequency"), [(0.99, 1.9), (0.8, 1.6)])
def test_paths_have_left_the_regime_by_its_end(restitution: float, frequency: float) -> None:
    """In 98 % of paths at least; two periods after its start more than these keep it up."""
    pair = stop(clearance=1.0, restitution=restitution)
    scene = chain(pair, noise=WhiteNoise(on="b", intensity=0.02), damping=0.05)
    case = StructureResonance.of(scene, frequency / math.tau)
    late = share_maintained(scene, case, case.ended_by())
    assert late.value - 4.5 * late.standard_error < 0.02
    early = share_maintained(scene, case, 2.0 * case.period)
    assert early.value - 4.5 * early.standard_error > 0.02
    assert case.ended_by() > max(case.longest(), case.energy / case.power_loss)


def test_a_faster_regime_of_a_beam_is_harder_to_maintain() -> None:
    """Above its first natural frequency a cantilever slaps faster, and noise loses hold of it."""
    reed = Beam(
        length=0.2, width=0.02, height=0.002, young=2e11, density=7850.0, zeta=0.01, modes=4
    )
    scene = Scene(
        structure=reed, impact_pairs=[stop(on="tip", upper=1e-3)],
        excitations=[WhiteNoise(on="base", density=0.01, unit="g2/Hz")],
    )  # fmt: skip
    first = reed.natural_frequency_hz[0]
    speeds = [StructureResonance.of(scene, f * first).impact_speed[0] for f in (1.02, 1.05, 1.2)]
    assert speeds[0] < speeds[1] < speeds[2]
    lasting = [StructureResonance.of(scene, f * first).longest() for f in (1.02, 1.05, 1.2)]
    assert lasting[0] > lasting[1] > lasting[2]


@pytest.mark.parametrize(
    ("scene", "how", "sentence"),
    [
        (chain(), {}, "the scene needs an impact_pair"),
        (chain(stop(upper=1.0)), {"pairs": ["no"]}, "pairs must be among stop, got 'no'"),
        (chain(stop(upper=1.0)), {"opposed": ["stop"]}, "opposed must name pairs with two stops"),
        (chain(stop(lower=-1.0, upper=2.0)), {}, "must lie evenly about its mean position"),
        (
            chain(stop(upper=1.0), noise=Sine(on="b", amplitude=1.0, frequency_hz=1.0)), {},
            "excitation must be white or tabulated noise",
        ),
        (
            chain(stop("one", upper=1.0), stop("two", "a", clearance=1.0)), {},
            "pairs must all have one stop or all have two",
        ),
    ],
)  # fmt: skip
def test_what_has_no_such_regime_is_refused(
    scene: Scene, how: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(NotApplicable) as refused:
        StructureResonance.of(scene, 0.2, **how)
    assert sentence in str(refused.value)


def test_a_frequency_without_a_regime_is_refused() -> None:
    with pytest.raises(ValueError, match="no free motion meets the stops at"):
        StructureResonance.of(chain(stop(upper=1.0)), 1.02 / math.tau)


# Under a sine ------------------------------------------------------------------------------


def test_the_first_point_of_a_structure_is_shown_under_a_sine() -> None:
    """Its motion without impacts is a sum over modes, and so is its absolute acceleration."""
    blade = Modes(
        frequency_hz=[20.0, 125.0], zeta=0.02, shapes={"tip": [1.0, -0.8], "seat": [0.3, 0.5]},
        participation=[1.5, -0.8],
    )  # fmt: skip
    sine = Sine(on="base", amplitude=3.0, frequency_hz=23.0)
    scene = Scene(structure=blade, impact_pairs=[stop(on="tip", upper=1.0)], excitations=[sine])
    w, table = math.tau * 23.0, blade.table
    rate = 2.0 * table.zeta * table.omega
    motion = -3.0 * np.array([1.5, -0.8]) / (table.omega**2 - w**2 + 1j * rate * w)
    carried = motion * -(table.omega**2 + 1j * rate * w)  # q'' + G a
    for place in (None, "seat"):
        found = harmonic_response(scene, coordinate=place)
        shape = table.shapes[place or "tip"]
        assert found.coordinate == (place or "tip")
        (branch,) = found.branches
        assert branch.displacement_max[0] == pytest.approx(abs(shape @ motion), rel=1e-6)
        assert branch.amplitude[0] == pytest.approx(abs(shape @ motion), rel=1e-9)
        assert branch.acceleration_max[0] == pytest.approx(abs(shape @ carried), rel=1e-5)
    with pytest.raises(ValueError, match="must be one of mode 1, mode 2, tip, seat, got"):
        harmonic_response(scene, coordinate="base")


def test_one_mode_under_a_sine_is_shown_at_its_gap() -> None:
    reed = Modes(frequency_hz=[20.0], zeta=0.02, shapes={"tip": [1.0], "seat": [0.5]})
    sine = Sine(on="tip", amplitude=3.0, frequency_hz=23.0)
    scene = Scene(structure=reed, impact_pairs=[stop(on="seat", upper=1.0)], excitations=[sine])
    assert harmonic_response(scene).coordinate == "seat"
