"""An absorber under a sine against motion from impact to impact, formulas, and its command."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

from stochvi import (
    Absorber,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    WhiteNoise,
)
from stochvi.absorbers import absorber_sine, residual_vibration, tuned_force
from stochvi.cli import main
from stochvi.model.model import model_of
from stochvi.scenes.impact_laws import Viscoelastic
from support.accuracies import quick_cases
from support.bounces import Bounces

WALLS = Restitution(coefficient=0.8)
MASS, DAMPING = 1.0, 0.02


def scene(box: Absorber, ratio: float = 1.0, force: float = 0.05) -> Scene:
    """A structure of Q = 50 and natural frequency 1 rad/s, with a box."""
    return Scene(
        structure=Oscillator(mass=MASS, damping=DAMPING, stiffness=1.0),
        absorber=box,
        excitations=[Sine(amplitude=force, frequency_hz=ratio / (2.0 * math.pi))],
    )


def loose(play: float = 2.0, mass: float = 0.05) -> Absorber:
    return Absorber(mass=mass, play=play, law=WALLS)


def alone(ratio: float, force: float = 0.05) -> float:
    """Amplitude of the structure without an absorber."""
    return force / math.hypot(1.0 - ratio**2, DAMPING * ratio)


SAMPLES = 600
"""Displacements that are looked at in a flight, of which none is longer than a period."""


def settled(given: Scene, impacts: int, periods: int) -> tuple[np.ndarray, ...]:
    """Displacements of the structure over some last periods of so many impacts, and of half as
    many."""
    flight = Bounces(given, steps=60)
    state, time = flight.start(np.zeros(2), np.array([0.0, 0.3]), 0.0), 0.0
    flights = []
    for _ in range(impacts):
        hit = flight.next_impact(state, 1e3)
        assert hit is not None
        flights.append((time, state, hit[0]))
        time, state = time + hit[0], flight.struck(hit[2], hit[1])
    lasting = 2.0 * math.pi * periods / flight.omega
    return tuple(
        np.array(
            [
                flight.flown(start, share * length)[0]
                for began, start, length in part
                if began > sum(part[-1][::2]) - lasting
                for share in np.linspace(0.0, 1.0, SAMPLES)
            ]
        )
        for part in (flights[: impacts // 2], flights)
    )


BOXES = {
    "loose": (loose(), 1.0),
    "one wall": (Absorber(mass=0.05, upper=0.0, stiffness=0.012, law=WALLS), 1.0),
    "sprung": (
        Absorber(mass=0.05, lower=-0.6, upper=0.6, stiffness=0.02, damping=1e-3, law=WALLS), 1.02,
    ),
}  # fmt: skip


@quick_cases("name", BOXES, keep=(1,))
def test_what_is_left_is_what_the_structure_does_from_impact_to_impact(name: str) -> None:
    """Loose and sprung, one wall and two. What is left of the start is less after twice as many
    impacts than between the two, and of the largest displacement samples miss (w dt)^2 / 8."""
    box, ratio = BOXES[name]
    given = scene(box, ratio)
    curve = absorber_sine(given, tune={}).frequency
    assert curve.stable[0] and curve.periodic[0]
    early, share = (np.abs(each).max() / alone(ratio) for each in settled(given, 320, 3))
    missed = (2.0 * math.pi * ratio / (SAMPLES - 1)) ** 2 / 8.0
    allowed = abs(share - early) + missed * share
    assert allowed < 5e-3 * share
    assert curve.without[0] == pytest.approx(alone(ratio), rel=1e-9)
    ratios = [curve.best[0], curve.worst[0]]
    assert any(abs(share - each) <= allowed for each in ratios)
    # negative control: the bound of the linear motion
    assert curve.worst[0] < 0.9


@pytest.mark.slow
def test_a_light_mass_at_its_tuned_play_leaves_the_residual_vibration() -> None:
    """First harmonic (2 Delta / pi) (1 - R) / (1 + R) at a_p = M2 w^2 8 Delta / pi^2, but for a
    share of the mass; the test of `symmetric_regimes` follows it to lighter masses."""
    mass, play = 0.05, 2.0
    force = tuned_force(mass, play, 1.0)
    structure = Oscillator(mass=MASS, damping=0.1 * DAMPING, stiffness=1.0)
    given = scene(loose(play, mass), force=force).model_copy(update={"structure": structure})
    found = absorber_sine(given, tune={"absorber.play": [0.7 * play, play, 1.4 * play]})
    (curve,) = found.tuning
    first = curve.first_harmonic[1] * force / (0.1 * DAMPING)
    assert abs(first / residual_vibration(play, 0.8) - 1.0) < 2.0 * mass
    assert np.nanargmin(curve.first_harmonic) == 1
    best = f"the best total play, {1e3 * curve.value[curve.tuned]:.4g} mm, leaves "
    assert best in found.summary() and " Hz, structure moves " in found.summary()
    assert found.frequency.first_harmonic[0] == pytest.approx(curve.first_harmonic[1], rel=1e-9)
    # negative control: the ratio of the book's linearisation
    assert first < 0.6 * residual_vibration(play, 0.8, "book")


@pytest.mark.parametrize(("share", "idle"), [(0.99, False), (1.01, True)])
def test_a_mass_lies_idle_where_its_box_is_wider_than_the_motion(share: float, idle: bool) -> None:
    """On a moving base that is the absolute motion: the mass stays where it is in space."""
    ratio, zeta = 1.3, 0.05
    base = 2e-3
    transmitted = math.hypot(1.0, 2.0 * zeta * ratio) / math.hypot(
        1.0 - ratio**2, 2.0 * zeta * ratio
    )
    given = Scene(
        structure=Isolator(frequency_hz=5.0, zeta=zeta, mass=2.0),
        absorber=loose(2.0 * share * base * transmitted, 0.1),
        excitations=[Sine(displacement=base, frequency_hz=5.0 * ratio)],
    )
    curve = absorber_sine(given, tune={}).frequency
    assert curve.idle[0] == idle
    if idle:
        assert curve.worst[0] >= 1.0


@pytest.mark.slow
def test_a_structure_of_several_coordinates_carries_a_mass_by_name() -> None:
    given = Scene(
        structure=Matrices(
            coordinates=["top", "bottom", "ball"],
            mass=np.diag([1.0, 1.0, 0.1]).tolist(),
            damping=[[0.02, -0.01, 0.0], [-0.01, 0.03, 0.0], [0.0, 0.0, 0.0]],
            stiffness=[[1.0, -1.0, 0.0], [-1.0, 2.0, 0.0], [0.0, 0.0, 0.0]],
        ),
        absorber=Absorber(mass_on="ball"),
        impact_pairs=[ImpactPair(between=("ball", "top"), clearance=1.0, law=WALLS)],
        excitations=[Sine(amplitude=0.06, frequency_hz=0.62 / (2.0 * math.pi), on="top")],
    )
    found = absorber_sine(given, tune={"impact_pair.0.clearance": [0.6, 1.0, 1.4]})
    assert found.carrier == "top" and found.mass_ratio == pytest.approx(0.05)
    assert found.tuning[0].worst.min() < 0.5
    with pytest.raises(ValueError, match="tune must name keys of absorber"):
        absorber_sine(given, tune={"structure.mass": [1.0]})


@pytest.mark.slow
def test_walls_that_give_way_leave_what_their_force_law_does() -> None:
    law = Viscoelastic(stiffness=500.0, damping_ratio=0.3)
    given = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        absorber=Absorber(mass=0.1, play=1.0, law=law),
        excitations=[Sine(amplitude=0.2, frequency_hz=0.159)],
    )
    found, model = absorber_sine(given, tune={}), model_of(given)
    (branch,) = [each for each in found.regimes.branches if each.stable.all() and each.stops]
    (place,) = branch.at(0.159)
    (pair,) = model.pairs

    def rate(time: float, y: np.ndarray) -> np.ndarray:
        x, v = y[:2], y[2:]
        push = 0.2 * math.cos(2.0 * math.pi * 0.159 * time + branch.phase[place, 0])
        force = np.array([push - x[0] - 0.1 * v[0], 0.0])
        force = force - pair.direction * pair.force(pair.direction @ x, pair.direction @ v)
        return np.concatenate([v, np.linalg.solve(model.mass, force)])

    start = np.concatenate([branch.displacement[place], branch.velocity[place]])
    times = np.linspace(0.0, 1.0 / 0.159, 2000)
    path = solve_ivp(
        rate, (0.0, times[-1]), start, t_eval=times, method="DOP853", rtol=1e-10, atol=1e-12,
        max_step=0.01,
    ).y  # fmt: skip
    assert path[:, -1] == pytest.approx(start, abs=1e-8)
    left = found.frequency.best[0] * found.frequency.without[0]
    assert left == pytest.approx(np.abs(path[0]).max(), rel=1e-4)
    assert left < 0.6 * found.frequency.without[0]


def test_what_is_no_absorber_under_a_sine_is_refused() -> None:
    bare = scene(loose()).model_copy(update={"absorber": None})
    with pytest.raises(NotApplicable, match=r"must have an \[absorber\]"):
        absorber_sine(bare)
    noisy = scene(loose()).model_copy(update={"excitations": (WhiteNoise(intensity=1.0),)})
    with pytest.raises(NotApplicable, match="needs an excitation of kind = 'sine'"):
        absorber_sine(noisy)


@pytest.mark.slow
def test_the_command_writes_curves_a_picture_and_a_page(tmp_path: Path) -> None:
    file = tmp_path / "tower.toml"
    file.write_text(
        """
        [structure]
        kind = "oscillator"
        mass = 1.0
        damping = 0.02
        stiffness = 1.0
        [absorber]
        mass = 0.05
        play = 2.0
        law = { kind = "restitution", coefficient = 0.8 }
        [[excitation]]
        kind = "sine"
        amplitude = 0.05
        frequency_hz = 0.159155
        """
    )
    arguments = [
        "absorber", str(file), "--sine", "--from", "0.157", "--to", "0.161", "--points", "3",
        "--vary", "absorber.play=1:3:3", "--budget", "600",
    ]  # fmt: skip
    result = CliRunner().invoke(main, [*arguments, "--out", str(tmp_path), "--json", "-"])
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["method"] == "absorber sine"
    assert document["frequency"]["value"] == pytest.approx([0.157, 0.159, 0.161])
    assert document["tuning"][0]["worst"][1] < 0.1
    for name in ("absorber-sine.csv", "absorber-sine.png", "report.html"):
        assert (tmp_path / name).is_file()
    refused = CliRunner().invoke(main, ["absorber", str(file), "--from", "1"])
    assert refused.exit_code == 2 and "need --sine" in refused.output
