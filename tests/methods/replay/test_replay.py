"""Measured records through a structure and its stops, against other ways to the same motion."""

from __future__ import annotations

import importlib
import itertools
import json
import math
import re
import signal
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import pytest
import scipy
from numba import njit
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.signal import lsim

from stochvi import (
    ConstantLoad,
    Elastic,
    ForceFunction,
    ForceTable,
    ImpactPair,
    Interrupted,
    Isolator,
    Matrices,
    NotApplicable,
    NotConverged,
    Oscillator,
    PowerLaw,
    RecordedNoise,
    Restitution,
    Scene,
    SpeedRestitution,
    Viscoelastic,
    WhiteNoise,
    damage,
    replay,
    simulate,
)
from stochvi.engine.calls import FIRST_DRAW, MOST_DRAWS, changes_of
from stochvi.engine.impact_laws import CELLS
from stochvi.methods.replay import Replay
from stochvi.methods.replay.march import SampledExcitation, integrate
from stochvi.model.model import model_of
from stochvi.results.deadline import Deadline, graceful_interrupt
from stochvi.scenes import DriveFunction, Hertz, Pulses
from stochvi.scenes.excitations import BaseExcitation
from stochvi.scenes.impact_laws import CompliantLaw, Law
from stochvi.views.verification import draw_replay, plot_clearances, plot_waterfall
from support import naive
from support.accuracies import quick_cases
from support.commands import Run, one_document, refused

Vector = NDArray[np.float64]
FS, MASS = 500.0, 2.0
MOUNT = Isolator(frequency_hz=12.0, zeta=0.08, mass=MASS)
OMEGA, B = MOUNT.omega, MOUNT.damping_rate
SAMPLES = 400


def shaken(seed: int = 1, samples: int = SAMPLES, pothole: float = 150.0) -> Vector:
    """Band-limited noise with a pothole, m/s^2, mean taken off."""
    spectrum = np.fft.rfft(np.random.default_rng(seed).normal(size=samples))
    spectrum[np.fft.rfftfreq(samples, 1.0 / FS) > 60.0] = 0.0
    a = 60.0 * np.fft.irfft(spectrum, samples)
    a[samples // 3 : samples // 3 + 15] += pothole
    return np.asarray(a - a.mean())


def scene_of(
    folder: Path, values: Vector, law: Law | None = None, *, fs: float = FS, gap: float = 5e-3,
    lower: bool = True, excitations: tuple = (), **mount: object,
) -> Scene:  # fmt: skip
    file = folder / f"record{len(values)}.txt"
    np.savetxt(file, values, fmt="%.17g")
    stops = ImpactPair(lower=-gap if lower else None, upper=gap, law=law) if law else None
    return Scene(
        structure=MOUNT.model_copy(update=mount),
        impact_pairs=[stops] if stops else [],
        excitations=[RecordedNoise(file=str(file), unit="m/s2", fs=fs), *excitations],
    )


def samples_of(found: Replay, name: str = "x") -> Vector:
    assert found.histories is not None
    return found.histories.displacement[name]


def linear(a: Vector, fs: float = FS) -> Vector:
    """The mount without stops by the matrix exponential of mass and interpolated input."""
    flow = np.zeros((4, 4))
    flow[0, 1] = flow[2, 3] = 1.0
    flow[1] = -(OMEGA**2), -B, -1.0, 0.0
    step = expm(flow / fs)
    state, found = np.zeros(2), [0.0]
    for now, then in pairwise(a):
        state = (step @ [*state, now, (then - now) * fs])[:2]
        found.append(state[0])
    return np.array(found)


def integrated(a: Vector, gap: float, law: Law, lower: bool = True) -> tuple[Vector, int]:
    """x at the samples and the number of impacts, by an integrator for any right-hand side."""
    times = np.arange(len(a)) / FS
    unit = law.per_unit_mass(MASS)

    def force(d: float, rate: float) -> float:
        if not isinstance(unit, CompliantLaw) or d <= 0.0:
            return 0.0
        if isinstance(unit, Viscoelastic):
            return float(unit.force_at(d, rate, 1.0))
        return float(unit.force_at(d))

    def rate(t: float, s: Vector) -> list[float]:
        push = force(s[0] - gap, s[1]) - (force(-gap - s[0], -s[1]) if lower else 0.0)
        return [s[1], -(OMEGA**2) * s[0] - B * s[1] - push - float(np.interp(t, times, a))]

    def event(side: float) -> Callable[[float, Vector], float]:
        def clear(t: float, s: Vector) -> float:
            return side * s[0] - gap

        clear.direction = 1.0  # type: ignore[attr-defined]
        clear.terminal = True  # type: ignore[attr-defined]
        return clear

    def struck(now: float, state: Vector) -> tuple[float, Vector]:
        if isinstance(law, Restitution):
            place = np.sign(state[0]) * gap * (1.0 - 1e-15)
            return now, np.array([place, -law.coefficient * state[1]])
        # past the touch, or the same event ends the next part
        return now + 1e-12, state + 1e-12 * np.array(rate(now, state))

    events = [event(1.0), *([event(-1.0)] if lower else [])]
    return from_touch_to_touch(times, np.zeros(2), rate, events, struck)


def from_touch_to_touch(
    times: Vector, state: Vector, rate: Callable[..., Any], events: Any, struck: Callable[..., Any]
) -> tuple[Vector, int]:
    """x at the times and the number of touches, by an integrator that ends at each."""
    hits, found = 0, [state[0]]
    for begin, end in pairwise(times):
        now = begin
        while now < end:
            part = solve_ivp(
                rate, (now, end), state, "DOP853", events=events, rtol=1e-11, atol=1e-14
            )
            now, state = part.t[-1], part.y[:, -1]
            if part.status == 1:
                hits += 1
                assert hits < 200
                now, state = struck(now, state)
        found.append(state[0])
    return np.array(found), hits


def test_without_stops_it_is_the_exact_linear_response(tmp_path: Path) -> None:
    a = shaken()
    found = replay(scene_of(tmp_path, a))
    truth = linear(a)
    assert np.abs(samples_of(found) - truth).max() < 1e-12 * np.abs(truth).max()
    x = found.coordinates["x"]
    assert truth.max() <= float(x.displacement_max) < 1.02 * truth.max()
    assert x.displacement_kurtosis is not None
    centred = truth - truth.mean()
    kurtosis = np.mean(centred**4) / np.mean(centred**2) ** 2
    assert float(x.displacement_kurtosis) == pytest.approx(kurtosis, rel=1e-9)
    kept = found.histories
    assert kept is not None
    absolute = -(OMEGA**2) * kept.displacement["x"] - B * kept.velocity["x"]
    assert kept.acceleration["x"] == pytest.approx(absolute, abs=1e-9)
    assert float(x.acceleration_max) >= np.abs(absolute).max()


LAWS: list[Law] = [
    Restitution(coefficient=0.6),
    Elastic(stiffness=3e5),
    Viscoelastic(stiffness=2e5, damping_ratio=0.3),
    Hertz(coefficient=4e6),
    ForceTable(deflection=[1e-4, 4e-4], force=[5.0, 120.0]),
]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.kind)
def test_an_integrator_of_any_equation_agrees(tmp_path: Path, law: Law) -> None:
    a = shaken(samples=260)
    found = replay(scene_of(tmp_path, a, law))
    truth, hits = integrated(a, 5e-3, law)
    apart = np.abs(samples_of(found) - truth).max() / np.abs(truth).max()
    assert apart < 1e-7
    assert (float(found.impact_pairs["stops"].hits), len(found.impacts)) == (hits, hits)
    assert hits > 2
    # an impulse has no largest force: an empty cell, not a 0
    forces = found.impacts["peak_force"]
    assert forces.isna().all() if isinstance(law, Restitution) else (forces > 0.0).all()
    # negative control: stops a thousandth further away are another motion
    other = replay(scene_of(tmp_path, a, law, gap=5.005e-3))
    assert np.abs(samples_of(other) - truth).max() > 1e-4 * np.abs(truth).max()


@pytest.mark.parametrize("law", [*LAWS, Restitution(coefficient=0.0)], ids=str)
def test_samples_between_the_samples_change_nothing(tmp_path: Path, law: Law) -> None:
    """The input is linear between samples: more samples on the same lines are the same motion."""
    a = shaken(seed=5, samples=300)
    model = model_of(scene_of(tmp_path, a, law))
    found = []
    for number in (1, 3):
        fine = np.interp(np.arange((len(a) - 1) * number + 1) / number, np.arange(len(a)), a)
        shaking = SampledExcitation(
            step=1.0 / (number * FS), forces=-MASS * fine[:, None], base=fine
        )
        motion = integrate(model, shaking, np.zeros(1))
        assert len(motion.impacts) > 3
        found.append((motion.displacement[::number, 0], motion.highest[0], motion.impacts))
    (coarse, top, hits), (refined, same_top, same_hits) = found
    assert np.abs(refined - coarse).max() < 1e-10 * 5e-3
    assert same_top == pytest.approx(top, rel=1e-12)
    assert same_hits[:, 0] == pytest.approx(hits[:, 0], abs=1e-10)
    assert same_hits[:, 2:] == pytest.approx(hits[:, 2:], rel=1e-6)


@pytest.mark.parametrize("law", [Restitution(coefficient=0.5), Hertz(coefficient=4e6)], ids=str)
def test_a_march_goes_on_from_where_a_call_left_it(
    tmp_path: Path, law: Law, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However few steps a call takes, all digits stay: between calls the clock is looked at."""
    a = shaken(seed=5, samples=300)
    model = model_of(scene_of(tmp_path, a, law))
    shaking = SampledExcitation(step=1.0 / FS, forces=-MASS * a[:, None], base=a)
    whole = integrate(model, shaking, np.zeros(1))
    monkeypatch.setattr("stochvi.methods.replay.march.STEPS_AT_ONCE", 7)
    parts = integrate(model, shaking, np.zeros(1))
    assert len(whole.impacts) > 3
    for name in ("displacement", "acceleration", "force", "impacts", "highest", "contact_time"):
        assert np.array_equal(getattr(parts, name), getattr(whole, name)), name
    with pytest.raises(NotConverged, match=r"budget of 0 s ended at 0\.\d+ s of a record of 0.598"):
        integrate(model, shaking, np.zeros(1), deadline=Deadline.after(0.0))
    with graceful_interrupt():
        pressed = Deadline.after(None)
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(Interrupted, match=r"by Ctrl-C at 0\.\d+ s of a record of 0.598"):
            integrate(model, shaking, np.zeros(1), deadline=pressed)


def test_a_budget_that_ends_while_kernels_are_loaded_names_the_whole_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are loaded by a run of two samples, whose length is no one's question."""
    monkeypatch.setattr("stochvi.methods.replay.march.STEPS_AT_ONCE", 7)
    monkeypatch.setattr("stochvi.results.deadline.Deadline.passed", lambda self: True)
    with pytest.raises(NotConverged, match=r"ended at 0 s of a record of 3 s; raise budget"):
        replay(scene_of(tmp_path, shaken(samples=1500), frequency_hz=1e5))


@pytest.mark.parametrize("mount", [{"frequency_hz": 1e9}, {"zeta": 8e10}])
def test_a_march_that_would_never_end_is_not_begun(tmp_path: Path, mount: dict[str, float]) -> None:
    scene = scene_of(tmp_path, shaken(samples=3000), **mount)
    with pytest.raises(NotConverged, match=r"must move slowly enough .* got [1-9].*e\+1\d steps"):
        replay(scene)


def test_a_mass_that_loses_all_rests_until_it_is_pulled_off(tmp_path: Path) -> None:
    """Pressed by a slow half sine: the time at which the stop lets go follows from the forces."""
    t = np.arange(4000) / FS
    a = -60.0 * np.sin(2.0 * np.pi * 0.25 * t)  # zero mean over two periods
    gap = 2e-3
    for restitution in (0.0, 0.5, 0.9):
        found = replay(scene_of(tmp_path, a, Restitution(coefficient=restitution), gap=gap))
        stops, kept = found.impact_pairs["stops"], found.histories
        assert kept is not None
        assert float(stops.rests) == 4.0  # once a half period
        assert 4.0 <= float(stops.hits) < 2000.0
        # at rest the stop carries the inertia less the spring
        press = MASS * (-kept.base_acceleration - OMEGA**2 * gap)
        resting = kept.force["stops upper"] > 0.0
        assert resting.sum() > 0.6 * len(t) / 2.0
        assert kept.force["stops upper"][resting] == pytest.approx(press[resting], rel=1e-6)
        assert np.all(np.abs(kept.displacement["x"][resting] - gap) < 1e-14)
        assert np.all(kept.displacement["x"] <= gap * (1.0 + 1e-12))
        contact = np.sum(press > 0.0) / FS * 2.0
        assert float(stops.contact_time) == pytest.approx(contact, rel=0.1)


@pytest.mark.parametrize("law", [Restitution(coefficient=0.7), Elastic(stiffness=3e5)])
def test_energy_balances(tmp_path: Path, law: Law) -> None:
    """After a push: what is left, and what damper (by quadrature) and impacts have taken."""
    fs, push = 16.0 * FS, 60
    a = np.where(np.arange(4000) < push, 150.0, 0.0)
    model = model_of(scene_of(tmp_path, shaken(), law))
    motion = integrate(
        model, SampledExcitation(step=1.0 / fs, forces=-MASS * a[:, None], base=a), np.zeros(1)
    )
    x, v = motion.displacement[push:, 0], motion.velocity[push:, 0]
    inside = np.maximum(np.abs(x) - 5e-3, 0.0)
    spring = 0.5 * 3e5 / MASS * inside**2 if isinstance(law, Elastic) else 0.0
    energy = 0.5 * v**2 + 0.5 * OMEGA**2 * x**2 + spring
    taken = np.concatenate([[0.0], np.cumsum(0.5 * B * (v[1:] ** 2 + v[:-1] ** 2) / fs)])
    hits = motion.impacts[motion.impacts[:, 0] > push / fs]
    assert len(hits) > 2
    if isinstance(law, Restitution):
        for time, _, speed, _ in hits:
            taken[np.arange(push, 4000) / fs >= time] += 0.5 * (1.0 - 0.7**2) * speed**2
    # the power of the damper jumps at an impact, somewhere within a cell of the quadrature
    error = 0.5 / fs * B * np.sum(hits[:, 2] ** 2) + 1e-5 * energy[0]
    assert np.abs(energy + taken - energy[0]).max() < error < 0.01 * energy[0]


def test_a_stop_on_one_side_and_a_load(tmp_path: Path) -> None:
    a = shaken(seed=3, samples=260, pothole=0.0)
    law = Restitution(coefficient=0.4)
    found = replay(scene_of(tmp_path, a, law, lower=False))
    truth, hits = integrated(a, 5e-3, law, lower=False)
    assert np.abs(samples_of(found) - truth).max() < 1e-7 * np.abs(truth).max()
    assert float(found.impact_pairs["stops"].hits) == hits > 0
    assert found.impact_pairs["stops"].hits_lower is None
    assert float(found.coordinates["x"].displacement_min) < -5e-3
    # a load moves the position of rest, from which clearances are measured
    pulled = scene_of(tmp_path, a, law, excitations=(ConstantLoad(acceleration=20.0),))
    free = replay(scene_of(tmp_path, a, law), [4e-3])
    loaded = replay(pulled, [4e-3])
    shift = -20.0 / OMEGA**2
    assert samples_of(loaded) == pytest.approx(samples_of(free) + shift, abs=1e-11)


def test_two_masses_between_stops(tmp_path: Path) -> None:
    """A structure with a stop on its first mass, against an integrator."""
    a = 0.6 * shaken(seed=4, samples=260, pothole=0.0)
    file = tmp_path / "two.txt"
    np.savetxt(file, a, fmt="%.17g")
    mass = np.array([[2.0, 0.0], [0.0, 0.5]])
    damping = np.array([[20.0, -8.0], [-8.0, 8.0]])
    stiffness = np.array([[14e3, -4e3], [-4e3, 4e3]])
    gap, coefficient = 8e-3, 1.0
    scene = Scene(
        structure=Matrices(coordinates=["box", "lid"], mass=mass.tolist(),
                           damping=damping.tolist(), stiffness=stiffness.tolist()),
        impact_pairs=[
            ImpactPair(name="walls", on="box", lower=-gap, upper=gap,
                       law=Restitution(coefficient=coefficient)),
            ImpactPair(name="lid", between=["lid", "box"], upper=6e-3,
                       law=Viscoelastic(stiffness=1e5, damping_ratio=0.1)),
        ],
        excitations=[RecordedNoise(file=str(file), unit="m/s2", fs=FS, on="base")],
    )  # fmt: skip
    times, inverse = np.arange(len(a)) / FS, np.linalg.inv(mass)
    reduced = 1.0 / (1.0 / 2.0 + 1.0 / 0.5)
    soft = 2.0 * 0.1 * np.sqrt(1e5 * reduced)

    def rate(t: float, s: Vector) -> Vector:
        y, w = s[1] - s[0] - 6e-3, s[3] - s[2]
        push = max(1e5 * y + soft * w, 0.0) if y > 0.0 else 0.0
        forces = -damping @ s[2:] - stiffness @ s[:2] + push * np.array([1.0, -1.0])
        return np.concatenate([s[2:], inverse @ forces - np.interp(t, times, a)])

    def wall(t: float, s: Vector) -> float:
        return abs(s[0]) - gap

    wall.direction, wall.terminal = 1.0, True  # type: ignore[attr-defined]

    def struck(now: float, s: Vector) -> tuple[float, Vector]:
        return now, np.array([np.sign(s[0]) * gap * (1 - 1e-15), s[1], -s[2], s[3]])

    truth, hits = from_touch_to_touch(times, np.zeros(4), rate, wall, struck)
    found = replay(scene)
    apart = np.abs(samples_of(found, "box") - truth)
    assert apart.max() < 1e-6 * gap
    assert float(found.impact_pairs["walls"].hits) == hits > 1
    assert float(found.impact_pairs["lid"].hits) > 0.0


def test_the_mean_of_a_shock_that_is_taken_off_is_told(tmp_path: Path) -> None:
    """The mean a of the record alone moves the mass by a / omega^2."""
    shock = 300.0 * np.sin(np.linspace(0.0, np.pi, 11))
    told = {}
    for seconds in (0.6, 20.0):
        record = np.concatenate([shock, np.zeros(int(seconds * FS))])
        (tmp_path / "shock.txt").write_text("\n".join(map(str, record.tolist())))
        noise = RecordedNoise(file=str(tmp_path / "shock.txt"), unit="m/s2", fs=FS)
        told[seconds] = replay(Scene(structure=MOUNT, excitations=[noise])).warnings
    moved = 1e3 * shock.sum() / (11 + 0.6 * FS) / OMEGA**2
    assert f"would move x by {moved:.3g} mm" in told[0.6][0] and "append zeros" in told[0.6][0]
    assert told[20.0] == ()


def test_clearances_are_places_of_the_stops(tmp_path: Path) -> None:
    a = shaken(seed=6)
    law = Viscoelastic(stiffness=2e5, damping_ratio=0.2)
    scene = scene_of(tmp_path, a, law)
    free = float(np.abs(linear(a)).max())
    found = replay(scene, [0.5 * free, 0.9 * free, 1.1 * free])
    table = found.to_frame()
    assert table["hits"].tolist()[2] == 0.0 < table["hits"].tolist()[1]
    document = found.to_dict()
    json.dumps(document, allow_nan=False)
    assert [each["clearance"] for each in document["clearances"]] == table["clearance"].tolist()
    one = document["clearances"][0]
    assert one["coordinates"]["x"]["displacement_max"]["value"] == table["displacement_max"][0]
    assert one["impact_pairs"]["stops"]["peak_force"]["value"] > 0.0
    assert document["clearances"][2]["impact_pairs"]["stops"]["impact_speed_max"] is None
    single = replay(scene, [5e-3]).to_dict()
    assert single["coordinates"] == replay(scene).to_dict()["coordinates"]
    assert single["impact_pairs"]["stops"]["hits"]["value"] >= 1.0
    # a contact is sharper than anything that the mount alone passes on
    peak = float(found.clearances[0].coordinates["x"].acceleration_max)
    pushed = one["impact_pairs"]["stops"]["peak_force"]["value"] / MASS
    assert peak == pytest.approx(pushed, rel=0.5)
    assert peak > 2.0 * float(found.clearances[2].coordinates["x"].acceleration_max)


@pytest.mark.parametrize(
    ("narrowest", "scale"), [(1e-5, "symlog"), (3e-3, "linear"), (0.4, "linear")]
)
def test_no_marker_of_the_picture_over_clearances_is_cut(
    tmp_path: Path, narrowest: float, scale: str
) -> None:
    scene = scene_of(tmp_path, shaken(), Restitution(coefficient=0.5))
    hits = plot_clearances(replay(scene, [narrowest, 0.5]))
    assert hits.get_yscale() == scale
    top, values = hits.get_ylim()[1], np.asarray(hits.get_lines()[0].get_ydata(), dtype=float)
    assert hits.get_ylim()[0] == 0.0 and top > 1.05 * values.max()
    speed = replay(scene, [narrowest]).impact_pairs["stops"].impact_speed_max
    told = [] if speed is None else [f"{float(speed):.2g} m/s"]
    assert [text.get_text() for text in hits.texts] == told
    plt.close("all")


@pytest.mark.parametrize("clearances", [[2e-3], [2e-3, 3e-3, 4e-3, 1.0]])
def test_the_picture_of_a_replay_shows_the_motion_around_the_shock(
    tmp_path: Path, clearances: list[float]
) -> None:
    """Whole seconds of record are a comb; two axes at one place cannot be told apart."""
    a = np.concatenate([0.1 * shaken(seed=6)] * 8)
    a[len(a) // 3 : len(a) // 3 + 4] += 50.0 * np.abs(a).max()
    found = replay(scene_of(tmp_path, a, Restitution(coefficient=0.5)), clearances)
    first = draw_replay(found)
    axes = first.figure.axes
    first.figure.canvas.draw()
    assert len({ax.get_position().bounds for ax in axes}) == len(axes), "no twin axes"
    for each, ax in zip(found.clearances, axes[:-1], strict=False):
        low, high = ax.get_xlim()
        shock = each.impacts["time"].iloc[each.impacts["speed"].argmax()]
        assert low < shock < high and high - low < 0.6 * found.duration
        walls = {round(line.get_ydata()[0] * 1e-3, 9) for line in ax.get_lines()[1:]}
        assert {round(place, 9) for place in each.stops.values()} <= walls
    plt.close("all")


def test_compiling_is_no_part_of_the_time_that_a_replay_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[int] = []

    def slow_at_first(*args: Any, **more: Any) -> Any:
        now[0] += 90.0 if not calls else 1.0
        calls.append(1)
        return integrate(*args, **more)

    now = [1000.0]
    method = importlib.import_module("stochvi.methods.replay.recorded_motion")
    march = importlib.import_module("stochvi.methods.replay.march")
    monkeypatch.setattr(march, "integrate", slow_at_first)
    monkeypatch.setattr(method.time, "perf_counter", lambda: now[0])
    scene = scene_of(tmp_path, shaken(), Restitution(coefficient=0.5))
    cost = replay(scene, [0.002, 0.003], threads=1).cost
    assert (cost.compile_time, cost.wall_time) == (90.0, 2.0)


def test_what_cannot_be_replayed_is_refused(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, shaken())
    with pytest.raises(NotApplicable, match="must have one impact pair"):
        replay(scene, [1e-3])
    with pytest.raises(ValueError, match="positive lengths"):
        replay(scene_of(tmp_path, shaken(), Elastic(stiffness=1e5)), [-1e-3])
    noisy = scene.model_copy(
        update={"excitations": (*scene.excitations, WhiteNoise(intensity=1.0, on="base"))}
    )
    with pytest.raises(NotApplicable, match="got white"):
        replay(noisy)
    with pytest.raises(NotApplicable, match="must hold a measured record"):
        replay(noisy.model_copy(update={"excitations": noisy.excitations[1:]}))


def test_the_command(tmp_path: Path, stochvi: Run) -> None:
    np.savetxt(tmp_path / "road.txt", shaken())
    file = tmp_path / "box.toml"
    file.write_text(
        "[structure]\nkind = 'isolator'\nfrequency_hz = 12.0\nzeta = 0.08\n"
        "[[impact_pair]]\nlower = -0.005\nupper = 0.005\nlaw = { coefficient = 0.5 }\n"
        "[[excitation]]\nkind = 'record'\nfile = 'road.txt'\nunit = 'm/s2'\nfs = 500.0\n"
    )
    run = stochvi("replay", str(file), "--json", "-", "--out", str(tmp_path / "out"))
    assert run.code == 0
    document = one_document(run.out)
    assert document["coordinates"]["x"]["displacement_max"]["value"] == pytest.approx(5e-3)
    assert document["impact_pairs"]["stops"]["hits"]["value"] > 0
    written = {each.name for each in (tmp_path / "out").iterdir()}
    assert written == {
        "replay.csv", "impacts.csv", "histories.csv", "replay.png", "replay.json", "report.html",
    }  # fmt: skip
    assert "Waterfall: short-time spectra" in (tmp_path / "out" / "report.html").read_text("utf-8")
    run = stochvi("replay", str(file), "--clearances", "4mm, 0.006", "--json", "-")
    assert [each["clearance"] for each in one_document(run.out)["clearances"]] == [4e-3, 6e-3]
    assert "--clearances must be" in refused(
        stochvi("replay", str(file), "--clearances", "4furlongs")
    )


BOX = """
[structure]
kind = "rigid-body"
mass = 12.0
inertia = [0.2, 0.25, 0.15]
{mounts}
[[impact_pair]]
name = "near"
at = [0.2, 0.2, 0.0]
direction = [0, 0, 1]
clearance = {near}
law = {{ kind = "restitution", coefficient = 0.4 }}
{far}
[[excitation]]
kind = "record"
axis = "z"
file = "record.txt"
unit = "m/s2"
fs = 500.0
"""


@pytest.mark.parametrize("hit", [False, True])
def test_what_rounding_alone_moves_is_said_not_to_move(
    tmp_path: Path, stochvi: Run, hit: bool
) -> None:
    """A symmetric box on a table that shakes it upwards, and pairs that are far away."""
    mount = "[[structure.mount]]\nat = [{}, {}, 0.0]\nstiffness = [2e4, 2e4, 3e4]\nzeta = 0.1\n"
    far = '[[impact_pair]]\nname = "far {}"\nat = [0.2, 0.2, 0.0]\ndirection = [1, 0, 0]\n'
    far += 'clearance = 0.5\nlaw = {{ kind = "restitution", coefficient = 0.4 }}\n'
    mounts = "".join(mount.format(x, y) for x in (-0.2, 0.2) for y in (-0.2, 0.2))
    pairs = "".join(far.format(number) for number in (1, 2))
    scene = tmp_path / "box.toml"
    scene.write_text(BOX.format(mounts=mounts, near=1e-3 if hit else 0.5, far=pairs))
    np.savetxt(tmp_path / "record.txt", shaken(), fmt="%.17g")
    done = stochvi("replay", scene, "--json", "-", "--out", tmp_path / "out")
    found = one_document(done.out)
    said = " ".join(stochvi("replay", scene, "-v").out.split())
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    sizes = {name: each["displacement_max"]["value"] for name, each in found["coordinates"].items()}
    assert sizes["z"] > 1e-4
    if hit:
        assert re.search(r"\d+ impacts on near, .*; no impact on 2 other pairs", said)
        assert "Impacts on near" in page and "Impacts on 2 pairs" in page
        return
    assert "x, y, rx, ry, rz do not move; no impact on 3 pairs" in said
    assert "Impacts on 3 pairs" in page and "Motion of z" in page and "Motion of rx" not in page
    assert "x: largest displacement" not in said and "z: largest displacement" in said
    kurtosis = {name: each["displacement_kurtosis"] for name, each in found["coordinates"].items()}
    assert {name for name, each in kurtosis.items() if each is not None} == {"z"}


def test_a_small_motion_is_no_rounding(tmp_path: Path) -> None:
    """One that is a millionth of the largest is said."""
    found = replay(scene_of(tmp_path, shaken()))
    (each,) = found.clearances
    small = replace(
        each.coordinates["x"],
        **{
            name: each.coordinates["x"][name] * 1e-6
            for name in ("displacement_max", "displacement_min")
        },
    )
    both = replace(each, coordinates={**each.coordinates, "y": small})
    assert "y from" in replace(found, clearances=(both,)).summary()
    noise = replace(small, displacement_max=small.displacement_max * 1e-6)
    noise = replace(noise, displacement_min=small.displacement_min * 1e-6)
    still = replace(each, coordinates={**each.coordinates, "y": noise})
    assert "y does not move" in replace(found, clearances=(still,)).summary()


def test_a_waterfall_tells_impacts_by_their_high_frequencies(tmp_path: Path) -> None:
    law = Viscoelastic(stiffness=2e6, damping_ratio=0.1)
    a = shaken(seed=4, samples=2000, pothole=0.0)
    alone = scene_of(tmp_path, a)
    free = replay(alone).only
    assert free is not None and free.histories is not None
    gap = 0.7 * float(np.abs(free.histories.displacement["x"]).max())
    found = replay(scene_of(tmp_path, a, law, gap=gap)).only
    assert found is not None and found.histories is not None
    kept = found.histories
    spectra = kept.short_time_spectra(segment=64 / FS)
    # one segment by a plain transform
    number, window = 7, np.hanning(65)[:64]
    part = kept.acceleration["x"][32 * number : 32 * number + 64]
    plain = np.abs(np.fft.rfft(window * (part - part.mean()))) ** 2 / (FS * np.sum(window**2))
    assert spectra.density[:-1, number] == pytest.approx(2.0 * plain[1:-1], rel=1e-9)
    assert spectra.time[number] == pytest.approx(kept.time[32 * number + 32])
    high = spectra.density[spectra.frequency_hz > 0.6 * FS / 2.0].sum(axis=0)
    times = found.impacts["time"].to_numpy()
    near = np.abs(spectra.time[:, None] - times).min(axis=1) < 8.0 / FS
    far = np.abs(spectra.time[:, None] - times).min(axis=1) > 64.0 / FS
    assert near.sum() >= 2 and far.sum() >= 10
    # against the motion without stops; the control: between impacts both are alike
    calm = free.histories.short_time_spectra(segment=64 / FS)
    louder = high / calm.density[calm.frequency_hz > 0.6 * FS / 2.0].sum(axis=0)
    assert np.median(louder[near]) > 10.0 > 3.0 > np.median(louder[far])
    axes = plot_waterfall(found)
    assert axes.get_legend_handles_labels()[1] == ["impacts"]
    assert plot_waterfall(free).get_legend_handles_labels()[1] == []


@pytest.mark.parametrize(
    ("law", "numbers"),
    [
        (
            Viscoelastic(stiffness=2e5, damping_ratio=0.3),
            (2e5, 1.0, 2.0 * 0.3 * math.sqrt(2e5 * MASS), 0.0),
        ),
        (PowerLaw(coefficient=2e6, loss=2e5, loss_exponent=1.0), (2e6, 1.5, 2e5, 1.0)),
    ],
    ids=["viscoelastic", "power"],
)
def test_every_number_of_a_replay_is_that_of_a_plain_integration(
    tmp_path: Path, law: Law, numbers: tuple[float, float, float, float]
) -> None:
    """Small steps of the equation of motion, forces interpolated between the samples."""
    a = shaken(seed=4, samples=800)
    scene = scene_of(tmp_path, a, law, gap=2e-3)
    steps = 200
    time = np.arange((len(a) - 1) * steps + 1) / (FS * steps)
    base = np.interp(time, np.arange(len(a)) / FS, a)
    model = model_of(scene)
    motion = _plain_steps(
        base, 1.0 / (FS * steps), model.omega**2, model.damping_rate, 2e-3, numbers[0] / MASS,
        numbers[1], numbers[2] / MASS, numbers[3],
    )  # fmt: skip
    x, felt, beyond, force, began = motion.T
    sampled = slice(None, None, steps)
    found = replay(scene)
    moved, hit = found.coordinates["x"], found.impact_pairs["stops"]
    size = np.abs(x).max()
    for name, truth in {
        "displacement_max": x.max(), "displacement_min": x.min(),
        "displacement_mean": x[sampled].mean(), "displacement_std": x[sampled].std(),
    }.items():  # fmt: skip
        assert float(moved[name]) == pytest.approx(truth, abs=2e-3 * size), name
    y = x[sampled] - x[sampled].mean()
    kurtosis = np.mean(y**4) / np.mean(y**2) ** 2
    assert float(moved.displacement_kurtosis) == pytest.approx(kurtosis, rel=5e-3)
    assert float(moved.acceleration_max) == pytest.approx(np.abs(felt).max(), rel=5e-3)
    speeds = np.abs(began[began != 0.0])
    assert (float(hit.hits_lower), float(hit.hits_upper)) == (
        (began < 0.0).sum(),
        (began > 0.0).sum(),
    )
    assert len(speeds) > 10
    assert float(hit.hits) == len(speeds)
    ten_steps = 10.0 / (FS * steps)
    assert found.impacts["time"].tolist() == pytest.approx(time[began != 0.0], abs=ten_steps)
    assert found.impacts["speed"].abs().tolist() == pytest.approx(speeds, rel=0.02)
    assert float(hit.impact_speed_max) == pytest.approx(speeds.max(), rel=5e-3)
    assert float(hit.impact_speed_mean) == pytest.approx(speeds.mean(), rel=5e-3)
    assert float(hit.peak_force) == pytest.approx(MASS * np.abs(force).max(), rel=5e-3)
    contact = np.sum(force != 0.0) / (FS * steps)
    assert float(hit.contact_time) == pytest.approx(contact, rel=0.01)
    assert np.sum(beyond > 0.0) / (FS * steps) > 1.1 * contact  # the stop recovers without a force
    hourly = damage(scene, equipment=(20.0, 60.0), way="record").impact_loss_per_hour
    assert hourly is not None
    lost = float(hourly) * (len(a) - 1) / FS / 3600.0
    assert lost == pytest.approx(MASS * float(force[1:] @ np.diff(x)), rel=0.01)
    blows = 0.5 * MASS * float(np.sum(speeds**2))
    free = (1.0 - law.impact(float(speeds.mean()), MASS).restitution ** 2) * blows
    assert free != pytest.approx(lost, rel=0.05)  # what a free mass would lose


@njit
def _plain_steps(base, h, k, c, gap, stop, n1, damper, m1):  # type: ignore[no-untyped-def]
    """Semi-implicit Euler steps per unit mass: x, felt acceleration, depth, force, touch speed."""
    x, v, rows = 0.0, 0.0, np.zeros((len(base), 5))
    for n in range(len(base)):
        side = 1.0 if x > 0.0 else -1.0
        depth = max(abs(x) - gap, 0.0)
        push = max(stop * depth**n1 + damper * depth**m1 * side * v, 0.0)
        force = side * push if depth > 0.0 else 0.0
        felt = -k * x - c * v - force
        rows[n, 0], rows[n, 1], rows[n, 2], rows[n, 3] = x, felt, depth, force
        v += h * (felt - base[n])
        x += h * v
        if depth == 0.0 and abs(x) > gap:
            rows[n, 4] = v
    return rows


# ------------------------------------------------------------------------------
# Impulses and random forces beside a record: their momentum, their statistics, their motion.
# ------------------------------------------------------------------------------


FS_OF_DRAWN, MASS_OF_DRAWN, DRAWN_LENGTH = 500.0, 2.0, 4000
MOUNT_OF_DRAWN = {"mass": MASS_OF_DRAWN, "frequency_hz": 10.0, "zeta": 0.05}
KNOCKS = Pulses(on="x", rate=5.0, impulse=0.3, sizes="exponential")
STOPS = ImpactPair(clearance=3e-3, law=Restitution(coefficient=0.6))
CHANGES = 2.0


def switch(value: float, time: float, uniform: float) -> float:
    """On or off, with 2 changes per second."""
    on = value > 0.5
    changes = uniform < 0.5 * (1.0 - math.exp(-2.0 * CHANGES * time))
    return 0.0 if on == changes else 1.0


GUST = DriveFunction(on="x", function=switch, rate=2.0 * CHANGES, amplitude=20.0)


def record(
    folder: Path, samples: int = DRAWN_LENGTH, size: float = 0.5, **where: str
) -> RecordedNoise:
    file = folder / f"{samples}-{size:g}.txt"
    np.savetxt(file, size * np.random.default_rng(3).normal(size=samples), fmt="%.17g")
    return RecordedNoise(file=str(file), unit="m/s2", fs=FS_OF_DRAWN, **where)


def mount_of(folder: Path, *drives: BaseExcitation, pairs: tuple = (), samples: int = DRAWN_LENGTH,
             size: float = 0.5) -> Scene:  # fmt: skip
    return Scene(
        structure=Isolator(**MOUNT_OF_DRAWN), impact_pairs=list(pairs),
        excitations=[record(folder, samples, size), *drives],
    )  # fmt: skip


def momenta(
    scene: Scene, number: int = 0, seed: int = 0, samples: int = DRAWN_LENGTH
) -> np.ndarray:
    """Momentum, N s, or m/s of the base, that a drive brings in each sampling interval."""
    part = model_of(scene).drives[number]
    found = np.empty(samples)
    event = FIRST_DRAW + number * MOST_DRAWS
    changes_of(part.law.compiled(part.mass), np.uint64(seed), event, 1.0 / FS_OF_DRAWN, found)
    return part.mass * found


def linear_of_drawn(
    forces: np.ndarray, mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray
):
    """Displacements under forces that are linear between samples, by scipy."""
    n, inverse = len(mass), np.linalg.inv(mass)
    flow = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damping]])
    into = np.vstack([np.zeros((n, n)), inverse])
    system = (flow, into, np.eye(n, 2 * n), np.zeros((n, n)))
    return lsim(system, forces, np.arange(len(forces)) / FS_OF_DRAWN, interp=True)[1].reshape(-1, n)


@pytest.mark.parametrize("on_base", [False, True])
def test_one_mass_moves_by_the_momenta_as_well(tmp_path: Path, on_base: bool) -> None:
    knocks = Pulses(on="base", rate=5.0, impulse=0.1) if on_base else KNOCKS
    scene = mount_of(tmp_path, knocks, GUST)
    with_them = replay(scene, seed=4).only.histories.displacement["x"]
    without = replay(mount_of(tmp_path)).only.histories.displacement["x"]
    forces = FS_OF_DRAWN * momenta(scene, 0, 4) * (
        -MASS_OF_DRAWN if on_base else 1.0
    ) + FS_OF_DRAWN * momenta(scene, 1, 4)
    omega = 2.0 * math.pi * MOUNT_OF_DRAWN["frequency_hz"]
    numbers = [
        np.array([[MASS_OF_DRAWN * each]])
        for each in (1.0, 2.0 * MOUNT_OF_DRAWN["zeta"] * omega, omega**2)
    ]
    expected = linear_of_drawn(forces[:, None], *numbers)[:, 0]
    assert np.abs(expected).max() > 1e-4
    assert with_them - without == pytest.approx(expected, abs=1e-9 * np.abs(expected).max() + 1e-12)
    # the control: another seed is another realisation
    other = replay(scene, seed=5).only.histories.displacement["x"]
    assert np.abs(other - with_them).max() > 0.1 * np.abs(expected).max()


def test_six_modes_move_by_them_as_well(tmp_path: Path) -> None:
    n = 6
    mass, stiffness = np.eye(n), 4e3 * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    damping, names = 2.0 * np.eye(n) + 1e-3 * stiffness, [f"x{k}" for k in range(n)]
    structure = Matrices(coordinates=names, mass=mass.tolist(), damping=damping.tolist(),
                         stiffness=stiffness.tolist())  # fmt: skip
    file = tmp_path / "force.txt"
    np.savetxt(file, np.random.default_rng(3).normal(size=DRAWN_LENGTH), fmt="%.17g")
    pushed = RecordedNoise(file=str(file), unit="N", fs=FS_OF_DRAWN, on="x0")
    drives = [KNOCKS.replace(on="x2"), GUST.replace(between=("x4", "x1"), on=None)]
    scene = Scene(structure=structure, excitations=[pushed, *drives])
    quiet = scene.replace(excitations=[pushed])
    motions = [replay(each, seed=2).only.histories.displacement for each in (scene, quiet)]
    forces = np.zeros((DRAWN_LENGTH, n))
    forces[:, 2] = FS_OF_DRAWN * momenta(scene, 0, 2)
    gust = FS_OF_DRAWN * momenta(scene, 1, 2)
    forces[:, 4], forces[:, 1] = gust, -gust
    expected = linear_of_drawn(forces, mass, damping, stiffness)
    for k, name in enumerate(names):
        apart = motions[0][name] - motions[1][name]
        assert apart == pytest.approx(expected[:, k], abs=1e-8 * np.abs(expected).max())


def test_impulses_and_switches_have_their_statistics(tmp_path: Path) -> None:
    scene = mount_of(tmp_path, KNOCKS, GUST)
    samples, seeds = 50_000, range(20)
    knocks = np.array([momenta(scene, 0, seed, samples) for seed in seeds])
    time = samples / FS_OF_DRAWN
    for found, expected in (
        ((knocks**2).sum(axis=1) / time, 5.0 * 2.0 * 0.3**2),  # rate * E J^2
        (np.abs(knocks).sum(axis=1) / time, 5.0 * 0.3),
        (knocks.sum(axis=1) / time, 0.0),
    ):
        error = found.std(ddof=1) / math.sqrt(len(found))
        assert abs(found.mean() - expected) < 4.5 * error
        assert abs(found.mean() - 1.2 * expected - 0.3) > 4.5 * error
    force = FS_OF_DRAWN * np.array([momenta(scene, 1, seed, samples) for seed in seeds])
    assert set(np.round(np.unique(force), 9)) == {0.0, 20.0}
    changes = (np.diff(force, axis=1) != 0.0).sum(axis=1) / time
    assert abs(changes.mean() - CHANGES) < 4.5 * changes.std(ddof=1) / math.sqrt(len(changes))


@pytest.mark.slow
def test_impacts_are_as_frequent_as_in_a_simulation(tmp_path: Path) -> None:
    """A record that hardly moves the mass; the same pulses alone are simulated."""
    scene = mount_of(tmp_path, KNOCKS, pairs=(STOPS,), samples=50_000, size=1e-9)
    found = [replay(scene, seed=seed).only for seed in range(12)]
    alone = Scene(
        structure=Oscillator(**MOUNT_OF_DRAWN), impact_pairs=[STOPS], excitations=[KNOCKS]
    )
    answer = simulate(alone, rel_error=0.01, seed=1)
    for values, known in (
        ([float(each.coordinates["x"].displacement_std) for each in found],
         answer.coordinates["x"]["displacement_std"]),
        ([float(each.impacts.query("speed > 0.05").shape[0]) / 100.0 for each in found],
         simulate(alone, rel_error=0.01, seed=1, speed_threshold=0.05)
         .impact_pairs["stops"]["collision_rate"]),
    ):  # fmt: skip
        error = math.hypot(np.std(values, ddof=1) / math.sqrt(len(values)), known.standard_error)
        limit = 4.5 * error + (known.bias or 0.0)
        assert abs(np.mean(values) - known.value) < limit
        assert abs(np.mean(values) - 1.3 * known.value) > limit


def test_shocks_noise_and_damage_are_refused(tmp_path: Path) -> None:
    shock = Pulses(rate=0.1, shape="half-sine", duration=0.02, amplitude=50.0)
    with pytest.raises(NotApplicable, match="a shock belongs in the record"):
        replay(mount_of(tmp_path, shock))
    with pytest.raises(NotApplicable, match="damage does not apply: excitation must be Gaussian"):
        damage(mount_of(tmp_path, KNOCKS), equipment=[50.0], way="record")
    told = replay(mount_of(tmp_path, KNOCKS), seed=7)
    assert any("drawn (seed 7)" in each for each in told.assumptions)
    assert told.provenance["seed"] == 7


# ------------------------------------------------------------------------------
# A restitution that scatters, in a replay: drawn by the seed and the number of the impact.
# ------------------------------------------------------------------------------


WIDE = {"mean": 0.5, "std": 0.25}


@pytest.fixture
def pushed(tmp_path: Path) -> Any:
    """A mount that a push of 20 ms throws onto its stops."""
    file = tmp_path / "push.txt"
    np.savetxt(file, np.where(np.arange(300) < 20, 1.0, 0.0))

    def scene(coefficient: Any) -> Scene:
        return Scene(
            structure=Isolator(frequency_hz=2.0, zeta=0.01),
            impact_pairs=[
                ImpactPair(lower=-0.004, upper=0.004, law=Restitution(coefficient=coefficient))
            ],
            excitations=[RecordedNoise(file=str(file), unit="g", fs=1000.0)],
        )

    return scene


def velocity_after(found: Replay) -> float:
    """Velocity at the sample after the first impact, which is linear in its restitution."""
    table = found.histories.to_frame()
    return float(table["velocity"][table["time"] > found.impacts["time"][0]].iloc[0])


@pytest.mark.parametrize("seed", [0, 1, 2, 77])
def test_the_first_restitution_is_that_of_the_plain_twin(pushed: Any, seed: int) -> None:
    low, high = (velocity_after(replay(pushed(r))) for r in (0.0001, 0.9))
    found = replay(pushed(WIDE), seed=seed)
    share = (velocity_after(found) - low) / (high - low)
    law = Restitution(coefficient=WIDE).scatter
    assert law is not None
    middles, widths = law.cells(CELLS)
    place = naive.uniform(seed, 0) * CELLS
    cell = int(place)
    drawn = float(middles[cell] + widths[cell] * (place - cell - 0.5))
    assert 0.0001 + share * (0.9 - 0.0001) == pytest.approx(drawn, rel=1e-6)


def test_a_seed_is_a_realisation(pushed: Any) -> None:
    one, again, other = (replay(pushed(WIDE), seed=seed) for seed in (3, 3, 4))
    assert one.impacts.equals(again.impacts) and not one.impacts.equals(other.impacts)
    assert one.provenance["seed"] == 3
    assert any("seed 3" in each for each in one.assumptions)
    with pytest.raises(ValueError, match=r"seed must be in \[0, 2\^63\), got -1"):
        replay(pushed(WIDE), seed=-1)


def test_without_scatter_it_is_the_plain_replay(pushed: Any) -> None:
    plain, still = (replay(pushed(r), seed=5) for r in (0.5, {"mean": 0.5, "std": 0.0}))
    assert plain.impacts.equals(still.impacts)
    assert plain.provenance["seed"] is still.provenance["seed"] is None


# ------------------------------------------------------------------------------
# A cantilever that slaps against a spring stop: its modes against finite elements in time.
# ------------------------------------------------------------------------------


LENGTH, WIDTH, HEIGHT, YOUNG, DENSITY, ZETA = 0.25, 0.02, 0.003, 7e10, 2700.0, 0.02
STIFFNESS, CLEARANCE = 2e4, 5e-4
RATE, SAMPLES_OF_ELEMENTS = 8000.0, 2000


def base_acceleration() -> np.ndarray:
    """A quarter of a second of noise below 600 Hz, m/s^2."""
    low_pass = scipy.signal.butter(4, 600.0 / (RATE / 2.0))
    noise = np.random.default_rng(3).normal(size=SAMPLES_OF_ELEMENTS)
    found = 60.0 * scipy.signal.lfilter(*low_pass, noise)
    return found - found.mean()


def elements(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, stiffness and inertia under the base of a cantilever of elements with cubic shapes."""
    h, bending = LENGTH / count, YOUNG * WIDTH * HEIGHT**3 / 12.0
    per_length = DENSITY * WIDTH * HEIGHT
    k = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                  [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]])  # fmt: skip
    m = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
                  [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]])  # fmt: skip
    size = 2 * count + 2
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    for each in range(count):
        part = slice(2 * each, 2 * each + 4)
        mass[part, part] += per_length * h / 420.0 * m
        stiffness[part, part] += bending / h**3 * k
    follow = mass @ np.tile([1.0, 0.0], count + 1)
    return mass[2:, 2:], stiffness[2:, 2:], follow[2:]


def newmark(count: int, parts: int) -> tuple[np.ndarray, int, float]:
    """Displacement of the tip at the samples, contacts, and the largest force on the stop, by the
    rule of Newmark with constant mean acceleration and `parts` steps a sample."""
    mass, stiffness, follow = elements(count)
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    damping = mass @ shapes @ np.diag(2.0 * ZETA * np.sqrt(squares)) @ shapes.T @ mass
    h, tip, base = 1.0 / (RATE * parts), len(mass) - 2, base_acceleration()
    inverse = np.linalg.inv(mass + h / 2.0 * damping + h**2 / 4.0 * stiffness)
    column = inverse[:, tip].copy()
    stop = h**2 / 4.0 * STIFFNESS
    x, v = np.zeros(len(mass)), np.zeros(len(mass))
    a = np.linalg.solve(mass, -follow * base[0])
    tips, peak, contacts, touching = [0.0], 0.0, 0, False
    for first, second in itertools.pairwise(base):
        for part in range(1, parts + 1):
            shaken = first + (second - first) * part / parts
            ahead, faster = x + h * v + h**2 / 4.0 * a, v + h / 2.0 * a
            a = inverse @ (-follow * shaken - stiffness @ ahead - damping @ faster)
            beyond = ahead[tip] + h**2 / 4.0 * a[tip] - CLEARANCE
            if beyond > 0.0:  # the stop adds its stiffness to the matrix of the step
                contacts, touching = contacts + (not touching), True
                a = a - column * STIFFNESS * beyond / (1.0 + stop * column[tip])
            else:
                touching = False
            x, v = ahead + h**2 / 4.0 * a, faster + h / 2.0 * a
            peak = max(peak, STIFFNESS * (x[tip] - CLEARANCE))
        tips.append(x[tip])
    return np.array(tips), contacts, peak


def measures(count: int) -> dict[str, Any]:
    """Keys of the cantilever with `count` modes."""
    return {
        "kind": "beam", "length": LENGTH, "width": WIDTH, "height": HEIGHT, "young": YOUNG,
        "density": DENSITY, "zeta": ZETA, "support": "cantilever", "modes": count,
        "points": {"tip": 1.0},
    }  # fmt: skip


def textbook_modes(count: int) -> dict[str, Any]:
    """Keys of the same modes from a textbook, without the compliance of those left out."""
    guesses = [1.875, 4.694, *(math.pi * (n - 0.5) for n in range(3, count + 1))][:count]
    waves = scipy.optimize.newton(lambda k: np.cos(k) + 1.0 / np.cosh(k), np.array(guesses))
    sigma = (np.sinh(waves) - np.sin(waves)) / (np.cosh(waves) + np.cos(waves))
    mass = DENSITY * WIDTH * HEIGHT * LENGTH
    rate = math.sqrt(YOUNG * WIDTH * HEIGHT**3 / 12.0 / (mass * LENGTH**3))
    return {
        "kind": "modes", "zeta": ZETA, "modal_mass": mass / 4.0,
        "frequency_hz": (waves**2 * rate / (2.0 * math.pi)).tolist(),
        "shapes": {"tip": [1.0] * count},
        "participation": (4.0 * sigma / waves * (-1.0) ** np.arange(count)).tolist(),
    }  # fmt: skip


def replayed(structure: dict[str, Any], folder: Path) -> Replay:
    record = folder / "base.txt"
    np.savetxt(record, base_acceleration())
    scene = Scene(
        structure=structure,
        impact_pairs=[ImpactPair(on="tip", upper=CLEARANCE, law=Elastic(stiffness=STIFFNESS))],
        excitations=[RecordedNoise(file=str(record), unit="m/s2", fs=RATE, on="base")],
    )
    return replay(scene)


def tip_of(found: Replay) -> np.ndarray:
    """Displacement of the tip: shapes are 1 there, so that it is the sum of all modes."""
    modes = [name for name in found.histories.displacement if name.startswith("mode ")]
    return np.sum([found.histories.displacement[name] for name in modes], axis=0)


def peak_force(found: Replay) -> float:
    return found.impact_pairs["stops"].peak_force.value


def test_modes_of_a_beam_at_a_stop_are_finite_elements_in_time(tmp_path: Path) -> None:
    coarse, _, coarse_peak = newmark(24, 6)
    tip, contacts, peak = newmark(48, 12)
    found = replayed(measures(10), tmp_path)
    ours = tip_of(found)
    assert found.impact_pairs["stops"].hits.value == contacts == 8
    # the rule of Newmark is of second order: the finer one is off by a third of the difference
    error = np.abs(tip - coarse).max()
    assert error < 0.02 * np.abs(tip).max()
    assert np.abs(ours - tip).max() < error
    assert peak_force(found) == pytest.approx(peak, abs=abs(peak - coarse_peak) + 1e-3 * peak)
    # one mode alone hits half as often: the comparison would see a wrong structure
    assert replayed(textbook_modes(1), tmp_path).impact_pairs["stops"].hits.value == 4


def test_the_compliance_of_left_out_modes_quickens_convergence(tmp_path: Path) -> None:
    peak = peak_force(replayed(measures(16), tmp_path))
    for count in (2, 3, 4):
        error, plain = (
            abs(peak_force(replayed(structure, tmp_path)) / peak - 1.0)
            for structure in (measures(count), textbook_modes(count))
        )
        assert error < 0.4 * plain


# ------------------------------------------------------------------------------
# Any two laws of stops side by side in a replay, against a plain integration of their formulas.
# ------------------------------------------------------------------------------


FS_OF_LAWS, SAMPLES_OF_LAWS, JUDGED, GAP, SEED = 250.0, 256, 40, 2e-3, 5
"""Sampling rate, samples of the record and those that are judged, clearance, and seed of draws."""

MASSES, DAMPING = np.array([2.0, 0.5]), np.array([[20.0, -4.0], [-4.0, 6.0]])
STIFFNESS_OF_LAWS = np.array([[12e3, -2e3], [-2e3, 4e3]])
WIDE_OF_LAWS = Restitution(coefficient={"mean": 0.6, "std": 0.1})

Force = Callable[[float, float], float]
Rebound = Callable[[float, int], float]


def drawn(w: float, number: int) -> float:
    """Speed after an impact whose restitution is the draw of this number."""
    assert WIDE_OF_LAWS.scatter is not None
    middles, widths = WIDE_OF_LAWS.scatter.cells(CELLS)
    place = naive.uniform(SEED, number) * CELLS
    return float(middles[int(place)] + widths[int(place)] * (place % 1.0 - 0.5)) * w


class Plain(NamedTuple):
    """A law, and what it says: a force (N) of deflection and rate, or the speed after an impact."""

    law: Law
    force: Force | None = None
    rebound: Rebound | None = None


def plain_laws(mass: float) -> list[Plain]:
    """The laws, with the numbers of those that depend on the mass of the pair."""
    damper = 2.0 * 0.3 * math.sqrt(2e5 * mass)
    return [
        Plain(Restitution(coefficient=0.6), rebound=lambda w, _: 0.6 * w),
        Plain(
            SpeedRestitution(speed=[0.1, 1.1], coefficient=[0.7, 0.3]),
            rebound=lambda w, _: (0.7 - 0.4 * min(max(w - 0.1, 0.0), 1.0)) * w,
        ),
        Plain(WIDE_OF_LAWS, rebound=drawn),
        Plain(Elastic(stiffness=3e5), lambda y, v: 3e5 * y),
        Plain(
            ForceTable(deflection=[1e-4, 4e-4], force=[5.0, 120.0]),
            lambda y, v: 5e4 * y if y < 1e-4 else 5.0 + 115.0 * (y - 1e-4) / 3e-4,
        ),
        Plain(
            Viscoelastic(stiffness=2e5, damping_ratio=0.3),
            lambda y, v: max(2e5 * y + damper * v, 0.0),
        ),
        Plain(Hertz(coefficient=4e6), lambda y, v: 4e6 * y**1.5),
        Plain(
            PowerLaw(coefficient=4e7, exponent=1.8, loss=1e7),
            lambda y, v: max((4e7 + 1e7 * v) * y**1.8, 0.0),
        ),
        Plain(
            ForceFunction(force=lambda y, v: 1e5 * y * (1.0 + 0.3 * v)),
            lambda y, v: max(1e5 * y * (1.0 + 0.3 * v), 0.0),
        ),
    ]


class Stop(NamedTuple):
    """A stop of one of the masses."""

    of: int
    side: float
    law: Plain


def accelerations(seed: int) -> np.ndarray:
    """Band-limited noise, m/s^2, mean taken off."""
    spectrum = np.fft.rfft(np.random.default_rng(seed).normal(size=SAMPLES_OF_LAWS))
    spectrum[np.fft.rfftfreq(SAMPLES_OF_LAWS, 1.0 / FS_OF_LAWS) > 40.0] = 0.0
    a = 90.0 * np.fft.irfft(spectrum, SAMPLES_OF_LAWS)
    return np.asarray(a - a.mean())


def integrated_of_laws(
    a: np.ndarray, masses: np.ndarray, stops: list[Stop]
) -> tuple[np.ndarray, list]:
    """Displacements at the samples, and (stop, speed) of the impacts in their order."""
    n, times, draws = len(masses), np.arange(len(a)) / FS_OF_LAWS, 0
    damping, stiffness = DAMPING[:n, :n], STIFFNESS_OF_LAWS[:n, :n]

    def depth(s: np.ndarray, stop: Stop) -> float:
        return stop.side * float(s[stop.of]) - GAP

    def rate(t: float, s: np.ndarray) -> np.ndarray:
        forces = -stiffness @ s[:n] - damping @ s[n:]
        for stop in stops:
            y = depth(s, stop)
            if stop.law.force is not None and y > 0.0:
                forces[stop.of] -= stop.side * stop.law.force(y, stop.side * s[n + stop.of])
        return np.concatenate([s[n:], forces / masses - np.interp(t, times, a)])

    def touch(stop: Stop) -> Callable[[float, np.ndarray], float]:
        def event(t: float, s: np.ndarray) -> float:
            return depth(s, stop)

        event.direction, event.terminal = 1.0, True  # type: ignore[attr-defined]
        return event

    state, hits, found = np.zeros(2 * n), [], [np.zeros(n)]
    for begin, end in pairwise(times):
        now = begin
        while now < end:
            part = solve_ivp(rate, (now, end), state, "DOP853", events=[touch(s) for s in stops],
                             rtol=1e-9, atol=1e-12, max_step=2.5e-4)  # fmt: skip
            now, state = part.t[-1], part.y[:, -1]
            if part.status != 1:
                continue
            which = next(k for k, each in enumerate(part.t_events) if len(each))
            stop = stops[which]
            speed = stop.side * state[n + stop.of]
            hits.append((which, speed))
            assert len(hits) < 200
            if stop.law.rebound is None:  # past the touch, or the same event ends the next part
                now, state = now + 1e-12, state + 1e-12 * rate(now, state)
                continue
            state[stop.of] = stop.side * GAP * (1.0 - 1e-15)
            state[n + stop.of] = -stop.side * stop.law.rebound(speed, draws)
            # each impact on a stop whose restitution varies takes a number
            draws += stop.law.law is WIDE_OF_LAWS or isinstance(stop.law.law, SpeedRestitution)
        found.append(state[:n])
    return np.array(found), hits


def scene_of_of_laws(
    folder: Path, a: np.ndarray, coordinates: int, pairs: list[ImpactPair]
) -> Scene:
    file = folder / "record.txt"
    np.savetxt(file, a, fmt="%.17g")
    return Scene(
        structure=Matrices(
            coordinates=["a", "b"][:coordinates],
            mass=np.diag(MASSES[:coordinates]).tolist(),
            damping=DAMPING[:coordinates, :coordinates].tolist(),
            stiffness=STIFFNESS_OF_LAWS[:coordinates, :coordinates].tolist(),
        ),
        impact_pairs=pairs,
        excitations=[RecordedNoise(file=str(file), unit="m/s2", fs=FS_OF_LAWS, on="base")],
    )


def agree(folder: Path, coordinates: int, stops: list[Stop], pairs: list[ImpactPair]) -> None:
    a = accelerations(seed=3)
    found = replay(scene_of_of_laws(folder, a, coordinates, pairs), seed=SEED)
    truth, hits = integrated_of_laws(a[:JUDGED], MASSES[:coordinates], stops)
    assert {which for which, _ in hits} == set(range(len(stops))) and len(hits) > 5
    assert found.histories is not None
    for number, name in enumerate(found.coordinates):
        apart = np.abs(found.histories.displacement[name][:JUDGED] - truth[:, number]).max()
        assert apart < 1e-5 * np.abs(truth[:, number]).max()
    early = found.impacts[found.impacts["time"] < (JUDGED - 1) / FS_OF_LAWS]
    assert early["speed"].to_numpy() == pytest.approx([w for _, w in hits], rel=1e-3)


NUMBERS = range(len(plain_laws(1.0)))
PAIRS = list(combinations(NUMBERS, 2))


def named(numbers: tuple[int, int]) -> str:
    laws = plain_laws(1.0)
    return " and ".join(f"{laws[k].law.kind}{k}" for k in numbers)


@quick_cases("numbers", PAIRS, keep=range(0, len(PAIRS), 6), ids=named)
def test_a_mass_between_two_laws_moves_as_their_formulas_say(
    tmp_path: Path, numbers: tuple[int, int]
) -> None:
    lower, upper = (plain_laws(MASSES[0])[k] for k in numbers)
    pair = ImpactPair(on="a", lower=-GAP, upper=GAP, lower_law=lower.law, upper_law=upper.law)
    agree(tmp_path, 1, [Stop(0, -1.0, lower), Stop(0, 1.0, upper)], [pair])


@quick_cases("numbers", PAIRS, keep=range(3, len(PAIRS), 12), ids=named)
def test_two_masses_with_a_law_each_move_as_their_formulas_say(
    tmp_path: Path, numbers: tuple[int, int]
) -> None:
    own = [plain_laws(mass)[k] for mass, k in zip(MASSES, numbers, strict=True)]
    pairs = [
        ImpactPair(name=name, on=name, lower=-GAP, upper=GAP, law=each.law)
        for name, each in zip("ab", own, strict=True)
    ]
    stops = [Stop(k, side, own[k]) for k in (0, 1) for side in (-1.0, 1.0)]
    agree(tmp_path, 2, stops, pairs)


def test_two_masses_that_are_pressed_onto_their_stops_rest_there(tmp_path: Path) -> None:
    """The base pulls one way, then the other: each mass chatters on each of its stops, ever slower
    by its restitution, and rests until the base turns. Neither wakes the other."""
    a = np.repeat([-60.0, 60.0], 256)
    laws = {"a": 0.6, "b": 0.7}
    pairs = [
        ImpactPair(name=name, on=name, lower=-GAP, upper=GAP, law=Restitution(coefficient=r))
        for name, r in laws.items()
    ]
    found = replay(scene_of_of_laws(tmp_path, a, 2, pairs))
    assert found.histories is not None
    for name, r in laws.items():
        x = found.histories.displacement[name]
        assert np.abs(x[200:256] - GAP).max() < 1e-12 and np.abs(x[456:] + GAP).max() < 1e-12
        assert float(found.impact_pairs[name].rests) == 2.0
        for _, own in found.impacts[found.impacts["pair"] == name].groupby("side"):
            speeds = own["speed"].to_numpy()
            slow = speeds[speeds < 1e-3]
            assert len(slow) > 10 and slow[-1] > 1e-9
            assert slow[1:] / slow[:-1] == pytest.approx(r, rel=1e-3)
