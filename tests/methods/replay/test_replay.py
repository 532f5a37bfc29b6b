"""Measured records through a structure and its stops, against other ways to the same motion."""

from __future__ import annotations

import importlib
import json
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from stochvi import (
    ConstantLoad,
    Elastic,
    ForceTable,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    NotConverged,
    PowerLaw,
    RecordedNoise,
    Restitution,
    Scene,
    Viscoelastic,
    WhiteNoise,
    damage,
    replay,
)
from stochvi.methods.replay import Replay
from stochvi.methods.replay.march import SampledExcitation, integrate
from stochvi.model.model import model_of
from stochvi.results.deadline import Deadline
from stochvi.scenes import Hertz
from stochvi.scenes.impact_laws import CompliantLaw, Law
from stochvi.views.replay import draw_replay, plot_clearances, plot_waterfall
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

    events = [event(1.0), *([event(-1.0)] if lower else [])]
    state, hits, found = np.zeros(2), 0, [0.0]
    for begin, end in pairwise(times):
        now = begin
        while now < end:
            part = solve_ivp(rate, (now, end), state, "DOP853", events=events, rtol=1e-11,
                             atol=1e-14)  # fmt: skip
            now, state = part.t[-1], part.y[:, -1]
            if part.status == 1:
                hits += 1
                assert hits < 200
                if isinstance(law, Restitution):
                    state = np.array([np.sign(state[0]) * gap * (1.0 - 1e-15), -state[1]])
                    state[1] *= law.coefficient
                else:  # past the touch, or the same event ends the next part
                    now, state = now + 1e-12, state + 1e-12 * np.array(rate(now, state))
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
    state, truth, hits = np.zeros(4), [0.0], 0
    for begin, end in pairwise(times):
        now = begin
        while now < end:
            part = solve_ivp(rate, (now, end), state, "DOP853", events=wall, rtol=1e-10,
                             atol=1e-13)  # fmt: skip
            now, state = part.t[-1], part.y[:, -1]
            if part.status == 1:
                hits += 1
                assert hits < 200
                state[0], state[2] = np.sign(state[0]) * gap * (1 - 1e-15), -state[2]
        truth.append(state[0])
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
    method = importlib.import_module("stochvi.methods.replay.method")
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
