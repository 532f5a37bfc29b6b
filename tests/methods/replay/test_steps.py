"""Records through springs that are functions and stops that rub, in steps: power series, and
integrators that end at every event, judge the motion and what the step is said to leave."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stochvi import (
    ConstantLoad,
    Elastic,
    ImpactPair,
    Matrices,
    NotApplicable,
    Oscillator,
    RecordedNoise,
    Restitution,
    Scene,
    TabulatedNoise,
    Viscoelastic,
    replay,
    simulate,
)
from stochvi.methods.replay.march import Motion, integrate, rest_of
from stochvi.methods.replay.recorded_motion import records_of, shaking_of
from stochvi.methods.replay.steps import SteppedReplay
from stochvi.model.model import model_of
from stochvi.scenes import BoucWen, Coulomb, Duffing, Hertz
from stochvi.scenes.impact_laws import Law
from support.commands import Run, one_document
from support.known import to_toml
from support.rubbing import ContactByEvents, ImpactsByEvents

FS = 400.0
TIMES = np.arange(int(12.0 * FS)) / FS
"""12 s, whole periods of the forces below."""


def push(t: Any) -> Any:
    """Force into the stops, N."""
    return 4.0 * np.sin(2.0 * np.pi * t / 3.0) + 4.0 * np.sin(2.0 * np.pi * t / 1.2)


def drag(t: Any) -> Any:
    """Force along the stops, N."""
    return np.sin(2.0 * np.pi * t / 6.0)


def record(folder: Path, force: Callable[[Any], Any], on: str | None, **keys: Any) -> RecordedNoise:
    file = folder / f"{on}.txt"
    np.savetxt(file, force(TIMES), fmt="%.17g")
    return RecordedNoise(**{"file": str(file), "unit": "N", "fs": FS, "on": on} | keys)


def matrices(coordinates: int, coupled: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, damping and stiffness of a body that moves into stops and along them, with a chain of
    other masses on it."""
    n = coordinates
    mass = np.diag([1.0, 1.5] + [0.4] * (n - 2))
    mass[0, 1] = mass[1, 0] = coupled
    damping, stiffness = (
        np.diag([0.3, 0.1] + [0.05] * (n - 2)),
        np.diag([4.0, 1.0] + [0.2] * (n - 2)),
    )
    for k in range(2, n):
        row = np.eye(n)[k] - np.eye(n)[k - 1]
        stiffness += 30.0 * np.outer(row, row)
        damping += 0.2 * np.outer(row, row)
    return mass, damping, stiffness


def rubbing(
    folder: Path, law: Law, coordinates: int = 2, coupled: float = 0.0, friction: bool = True
) -> Scene:
    names = ["x", "y", *(f"z{k}" for k in range(coordinates - 2))]
    mass, damping, stiffness = (each.tolist() for each in matrices(coordinates, coupled))
    tangent = {"tangent": "y"} if friction else {}
    return Scene(
        structure=Matrices(
            coordinates=names, mass=mass, damping=damping, stiffness=stiffness
        ),
        impact_pairs=[ImpactPair(on="x", lower=-0.4, upper=0.5, law=law, **tangent)],
        excitations=[record(folder, push, "x"), record(folder, drag, "y")],
    )  # fmt: skip


def both(t: float, coordinates: int) -> np.ndarray:
    found = np.zeros(coordinates)
    found[:2] = push(t), drag(t)
    return found


@pytest.mark.parametrize(
    ("law", "coordinates", "coupled", "kinds"),
    [
        (Elastic(stiffness=400.0, friction=0.7), 2, 0.7, {"sticks", "slides back"}),
        pytest.param(
            Viscoelastic(stiffness=400.0, damping_ratio=0.2, friction=0.7), 6, -0.6,
            {"sticks", "slides back"}, marks=pytest.mark.slow,
        ),
    ],
)  # fmt: skip
def test_compliant_stops_rub_as_an_integrator_by_events_has_it(
    tmp_path: Path, law: Any, coordinates: int, coupled: float, kinds: set[str]
) -> None:
    judge = ContactByEvents(
        law, *matrices(coordinates, coupled), (-0.4, 0.5), lambda t: both(t, coordinates)
    )
    known = judge.path(np.zeros(2 * coordinates), TIMES[1:])[:, :2]
    assert judge.kinds >= kinds
    found = replay(rubbing(tmp_path, law, coordinates, coupled))
    assert found.histories is not None
    for k, name in enumerate("xy"):
        own, size = found.histories.displacement[name][1:], np.abs(known[:, k]).max()
        assert np.abs(own - known[:, k]).max() < 4e-3 * size
        most = found.coordinates[name].displacement_max
        assert abs(most.value - known[:, k].max()) < 1e-3 * size
        assert most.bias is not None and most.bias < 5e-3 * size
    smooth = replay(rubbing(tmp_path, law.replace(friction=None), coordinates, coupled, False))
    assert smooth.histories is not None
    assert np.abs(smooth.histories.displacement["y"][1:] - known[:, 1]).max() > 0.05


@pytest.mark.parametrize(
    ("coordinates", "coupled"), [(2, 0.7), pytest.param(6, -0.6, marks=pytest.mark.slow)]
)
def test_rigid_stops_rub_as_an_integrator_by_events_has_it(
    tmp_path: Path, coordinates: int, coupled: float
) -> None:
    law = Restitution(coefficient=0.85, friction=0.8)
    judge = ImpactsByEvents(
        law, *matrices(coordinates, coupled), (-0.4, 0.5), lambda t: both(t, coordinates)
    )
    known, kinds = judge.path(np.zeros(2 * coordinates), TIMES), judge.kinds
    assert len(kinds) > 10 and set(kinds) == {"stuck", "slid"}
    found = replay(rubbing(tmp_path, law, coordinates, coupled))
    assert found.histories is not None
    assert float(found.impact_pairs["stops"].hits) == len(kinds)
    for k, name in enumerate("xy"):
        error = np.abs(found.histories.displacement[name] - known[:, k])
        assert error.max() < 2e-3 * np.abs(known[:, k]).max()
    smooth = replay(rubbing(tmp_path, law.replace(friction=None), coordinates, coupled, False))
    assert smooth.histories is not None
    assert np.abs(smooth.histories.displacement["y"] - known[:, 1]).max() > 0.05


def moved(model: Any, shaking: Any, parts: int) -> Motion:
    return SteppedReplay(model, shaking).move(shaking, 0, parts)


@pytest.mark.parametrize("coordinates", [1, pytest.param(6, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "law",
    [
        Restitution(coefficient=0.6),
        Viscoelastic(stiffness=400.0, damping_ratio=0.2),
        Hertz(coefficient=2000.0),
    ],
)
def test_steps_agree_with_power_series_where_both_apply(
    tmp_path: Path, law: Law, coordinates: int
) -> None:
    """All numbers of a motion: within what twice the step shows, which is not nothing."""
    if coordinates == 1:
        scene = Scene(
            structure=Oscillator(frequency_hz=0.3, zeta=0.08, mass=1.0),
            impact_pairs=[ImpactPair(lower=-0.4, upper=0.5, law=law)],
            excitations=[record(tmp_path, push, None), ConstantLoad(force=0.3)],
        )
    else:
        scene = rubbing(tmp_path, law, coordinates, 0.7, friction=False)
    model = model_of(scene)
    (shaking,) = shaking_of(records_of(scene, model), model)
    exact = integrate(model, shaking, rest_of(model))
    stepped = SteppedReplay(model, shaking)
    fine, coarse = (
        stepped.move(shaking, 0, parts) for parts in (stepped.runs[0], stepped.runs[0] // 4)
    )
    assert len(exact.impacts) > 8
    # chatter is listed until the mass rests, the last impacts at 1e-7 of the speeds of others
    fast = [each.impacts[each.impacts[:, 2] > 1e-5] for each in (fine, exact)]
    assert len(fast[0]) == len(fast[1])
    assert fine.samples == exact.samples and fine.duration == exact.duration
    for name in (
        "displacement", "velocity", "powers", "highest", "lowest", "largest_acceleration",
        "contact_time", "acceleration",
    ):  # fmt: skip
        one, other, known = (np.atleast_1d(getattr(m, name)) for m in (fine, coarse, exact))
        size = np.abs(known).max(axis=0) + 1e-12
        told = np.abs(one - other).max(axis=0)
        # samples beside a jump lie on either side of it
        jumps = name == "acceleration" or law.rigid
        apart = np.quantile(np.abs(one - known), 0.99 if jumps else 1.0, axis=0)
        rounded = fine.rests / FS / stepped.runs[0] if name == "contact_time" else 0.0
        assert np.all(apart <= 2.0 * told + 1e-6 * size + rounded), name
        assert np.all(apart <= 5e-3 * size), name
    assert fine.rests.tolist() == exact.rests.tolist()
    error = np.abs(fast[0] - fast[1])
    assert error[:, 0].max() < 1e-4 and not error[:, 1].any()
    assert error[:, 2].max() < 1e-4 * exact.impacts[:, 2].max()
    assert np.all(error[:, 3] <= 2e-3 * exact.impacts[:, 3].max())
    assert np.abs(coarse.displacement - exact.displacement).max() > 0.0


@pytest.mark.parametrize(
    ("cubic", "dry"), [(8.0, 0.0), pytest.param(0.0, 0.2, marks=pytest.mark.slow)]
)
def test_functions_between_stops_move_as_an_integrator_of_the_equation_has_it(
    tmp_path: Path, cubic: float, dry: float
) -> None:
    """Its dry friction is smoothed over small speeds. A load moves the position of rest."""
    load = 0.5
    parts: dict[str, Any] = {"damper": Coulomb(force=dry)} if dry else {
        "spring": Duffing(cubic_stiffness=cubic)
    }  # fmt: skip
    mount: dict[str, Any] = {"frequency_hz": 0.2, "zeta": 0.02, "mass": 2.0}
    scene = Scene(
        structure=Oscillator(**mount, **parts),
        impact_pairs=[ImpactPair(lower=-0.25, upper=0.3, law=Restitution(coefficient=0.6))],
        excitations=[record(tmp_path, push, None), ConstantLoad(force=load)],
    )
    model = model_of(scene)
    stiffness, damping = float(model.stiffness[0, 0]), float(model.damping[0, 0])

    def rates(t: float, s: np.ndarray) -> list[float]:
        rubs = dry * math.tanh(s[1] / 1e-5)
        pull = stiffness * s[0] + cubic * s[0] ** 3 + damping * s[1] + rubs
        return [s[1], (push(t) + load - pull) / 2.0]

    stops: list[Any] = [lambda t, s: s[0] - 0.3, lambda t, s: s[0] + 0.25]
    for stop, way in zip(stops, (1.0, -1.0), strict=True):
        stop.terminal, stop.direction = True, way
    found = replay(scene)
    assert found.histories is not None
    begin = found.histories.displacement["x"][0]
    # dry friction holds the mass at any place near that of a spring alone
    assert abs(stiffness * begin + cubic * begin**3 - load) <= dry + 1e-4
    t, s, known, hits = 0.0, np.array([begin, 0.0]), np.full(len(TIMES), begin), 0
    while t < TIMES[-1]:
        solved = solve_ivp(
            rates, (t, TIMES[-1] + 1e-9), s, "LSODA", events=stops, rtol=1e-9, atol=1e-11,
            dense_output=True,
        )  # fmt: skip
        inside = np.flatnonzero((t < TIMES) & (solved.t[-1] >= TIMES))
        if len(inside):
            known[inside] = solved.sol(TIMES[inside])[0]
        t, s = float(solved.t[-1]), solved.y[:, -1].copy()
        if solved.status:
            hits, s[1] = hits + 1, -0.6 * s[1]
            s[0] -= math.copysign(1e-13, s[0])
    apart = np.abs(found.histories.displacement["x"] - known).max()
    assert hits > 10 and float(found.impact_pairs["stops"].hits) == hits
    assert apart < 2e-3 * np.abs(known).max()
    linear = replay(scene.replace(structure=Oscillator(**mount))).histories
    assert linear is not None
    assert np.abs(linear.displacement["x"] - known).max() > 0.04


@pytest.mark.parametrize(
    "kind",
    [
        "duffing", pytest.param("coulomb", marks=pytest.mark.slow),
        pytest.param("bouc-wen", marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_functions_without_stops_move_as_an_integrator_of_the_equation_has_it(
    tmp_path: Path, kind: str
) -> None:
    """Friction is smoothed over small speeds; the memory of hysteresis is a state of its own."""
    parts: dict[str, Any] = {
        "duffing": {"spring": Duffing(cubic_stiffness=8.0)},
        "coulomb": {"damper": Coulomb(force=0.2)},
        "bouc-wen": {"spring": BoucWen(stiffness=6.0, yield_displacement=0.3)},
    }[kind]
    mass, stiffness, damping = 2.0, 3.2, 0.1
    scene = Scene(
        structure=Oscillator(mass=mass, stiffness=stiffness, damping=damping, **parts),
        excitations=[record(tmp_path, push, None)],
    )

    def rates(t: float, s: np.ndarray) -> list[float]:
        x, v, z = s
        adds = {
            "duffing": 8.0 * x**3, "coulomb": 0.2 * math.tanh(v / 1e-4), "bouc-wen": 6.0 * 0.3 * z
        }[kind]  # fmt: skip
        turns = (1.0 - (0.5 + 0.5 * math.copysign(1.0, z * v)) * abs(z)) * v / 0.3
        return [v, (push(t) - stiffness * x - damping * v - adds) / mass, turns]

    span = (0.0, float(TIMES[-1]))
    known = solve_ivp(rates, span, [0.0, 0.0, 0.0], "LSODA", t_eval=TIMES, rtol=1e-9, atol=1e-11).y[
        0
    ]
    found = replay(scene)
    assert found.histories is not None and not found.impact_pairs
    apart = np.abs(found.histories.displacement["x"] - known).max()
    assert apart < 2e-3 * np.abs(known).max()
    most = found.coordinates["x"].displacement_max
    assert float(most) == pytest.approx(known.max(), rel=2e-3)
    assert most.bias is not None and most.bias < 1e-3 * float(most)


def test_answers_in_steps_say_so(tmp_path: Path, stochvi: Run) -> None:
    scene = rubbing(tmp_path, Elastic(stiffness=400.0, friction=0.7))
    found = replay(scene)
    most = found.coordinates["y"].displacement_max
    assert most.how.startswith("the record itself, steps of")
    assert most.bias is not None and 0.0 < most.bias < 0.01 * most.value


def test_the_command_follows_a_mount_of_rubber_in_steps(tmp_path: Path, stochvi: Run) -> None:
    np.savetxt(tmp_path / "road.txt", push(TIMES))
    scene = tmp_path / "mount.toml"
    spring = {"kind": "duffing", "cubic_stiffness": 3.0}
    mount = {"kind": "isolator", "frequency_hz": 0.3, "zeta": 0.05, "mass": 2.0, "spring": spring}
    stops = {"lower": -0.4, "upper": 0.4, "law": {"kind": "restitution", "coefficient": 0.7}}
    road = {"kind": "record", "file": "road.txt", "unit": "m/s2", "fs": 400}
    document = {"structure": mount, "impact_pair": [stops], "excitation": [road]}
    scene.write_text(to_toml(document))
    found = stochvi("replay", str(scene), "--json", "-", "--out", str(tmp_path / "out"))
    assert found.code == 0
    document = one_document(found.out)
    most = document["coordinates"]["x"]["displacement_max"]
    assert most["value"] == pytest.approx(0.4, abs=1e-3) and most["bias"] < 1e-3
    assert "steps of" in most["how"]
    columns = np.genfromtxt(tmp_path / "out" / "histories.csv", delimiter=",", names=True)
    assert np.abs(columns["displacement"]).max() < 0.4 + 1e-9
    assert np.all(np.isfinite(columns["acceleration"]))


def test_units_with_functions_move_their_stops_from_the_equilibrium(tmp_path: Path) -> None:
    structure = Oscillator(
        frequency_hz=0.2, zeta=0.02, mass=2.0, spring=Duffing(cubic_stiffness=8.0)
    )
    scene = Scene(
        structure=structure, excitations=[record(tmp_path, push, None)],
        impact_pairs=[ImpactPair(lower=-0.25, upper=0.3, law=Restitution(coefficient=0.6))],
    )  # fmt: skip
    found = replay(scene, [0.2, 5.0])
    hits = [float(each.impact_pairs["stops"].hits) for each in found.clearances]
    assert hits[0] > 10 and hits[1] == 0.0
    loaded = scene.replace(excitations=[*scene.excitations, ConstantLoad(force=0.5)])
    with pytest.raises(NotApplicable, match="give the stops in the scene"):
        replay(loaded, [0.2])


@pytest.mark.parametrize("load", [0.0, pytest.param(8.0, marks=pytest.mark.slow)])
def test_dry_friction_beside_a_load_that_presses_on_a_stop_has_a_motion(
    tmp_path: Path, load: float
) -> None:
    """What has no stationary motion under noise of its density has one under the record, and that
    of masses and forces twenty times as large is the same."""

    def found(scale: float) -> Any:
        force = record(tmp_path, lambda t: 2.0 * scale * push(t), None)
        scene = Scene(
            structure=Oscillator(
                frequency_hz=0.5, zeta=0.05, mass=2.0 * scale, damper=Coulomb(force=scale)
            ),
            impact_pairs=[ImpactPair(lower=-0.25, upper=0.3, law=Restitution(coefficient=0.6))],
            excitations=[force, ConstantLoad(force=load * scale)],
        )
        return replay(scene)

    one, twenty = found(1.0), found(20.0)
    for name, own in one.coordinates["x"].items():
        assert float(own) == pytest.approx(float(twenty.coordinates["x"][name]), rel=1e-6)
    assert float(one.impact_pairs["stops"].hits) > 10


@pytest.mark.slow
@pytest.mark.parametrize("load", [0.0, 8.0])
def test_a_long_record_has_the_moments_of_a_simulation(tmp_path: Path, load: float) -> None:
    """Of a mass with dry friction, also where a load presses it onto its stop."""
    samples, rate, band, size = 160_000, 80.0, 8.0, 12.0
    noise = np.fft.rfft(np.random.default_rng(5).normal(size=samples))
    noise[np.fft.rfftfreq(samples, 1.0 / rate) > band] = 0.0
    values = np.fft.irfft(noise, samples)
    values *= size / values.std()
    file = tmp_path / "long.txt"
    np.savetxt(file, values, fmt="%.17g")
    loads = [ConstantLoad(force=load)] if load else []
    scene = Scene(
        structure=Oscillator(frequency_hz=0.5, zeta=0.05, mass=2.0, damper=Coulomb(force=4.0)),
        impact_pairs=[ImpactPair(lower=-0.25, upper=0.3, law=Restitution(coefficient=0.6))],
        excitations=[RecordedNoise(file=str(file), unit="N", fs=rate), *loads],
    )
    flat = TabulatedNoise(
        frequency_hz=[1e-3, band], density=[size**2 / band] * 2, unit="N2/Hz"
    )  # fmt: skip
    noisy = scene.replace(excitations=[flat, *loads])
    known = simulate(noisy, paths=128, duration=300.0, seed=1)
    replayed = replay(scene).histories
    assert replayed is not None
    parts = replayed.displacement["x"][800:].reshape(-1, 3184)
    for name, power in (("displacement_mean", 1), ("displacement_mean_square", 2)):
        own, other = np.mean(parts**power, axis=1), known.coordinates["x"][name]
        error = math.hypot(own.std(ddof=1) / math.sqrt(len(own)), other.standard_error)
        assert abs(own.mean() - other.value) < 4.5 * error + other.bias, name
    free = noisy.replace(structure=Oscillator(frequency_hz=0.5, zeta=0.05, mass=2.0))
    without = simulate(free, paths=128, duration=300.0, seed=1).coordinates["x"]
    assert abs(own.mean() - without["displacement_mean_square"].value) > 10.0 * error


@pytest.mark.parametrize("friction", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_mass_that_a_load_holds_on_its_stop_rests_all_the_time(
    tmp_path: Path, friction: bool
) -> None:
    """Beside dry friction in the mount, or on a stop that rubs."""
    if friction:
        scene = rubbing(tmp_path, Restitution(coefficient=0.6, friction=0.3), 2, 0.0)
    else:
        mount = Oscillator(frequency_hz=0.5, zeta=0.05, mass=2.0, damper=Coulomb(force=1.0))
        stops = ImpactPair(lower=-0.25, upper=0.3, law=Restitution(coefficient=0.6))
        scene = Scene(
            structure=mount, impact_pairs=[stops], excitations=[record(tmp_path, push, None)]
        )
    load = ConstantLoad(force=200.0, **({"on": "x"} if friction else {}))
    found = replay(scene.replace(excitations=[*scene.excitations, load])).impact_pairs["stops"]
    assert float(found.hits) == 0.0 and float(found.rests) == 1.0
    assert float(found.contact_time) == pytest.approx(12.0, rel=2e-3)
