"""Springs that relax: matrices, transfer functions, stationary motion, limits and refusals."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stochvi import (
    Estimate,
    FilteredNoise,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    SceneError,
    Sine,
    TabulatedNoise,
    WhiteNoise,
    exact,
    explain,
    fokker_planck,
    screen,
    size,
)
from stochvi.mathematics.spectra import gains
from stochvi.model.modal import linear_law
from stochvi.model.model import model_of
from stochvi.scenes import RelaxationSpring
from stochvi.scenes.scene import scene_from
from stochvi.testing import assert_agrees
from support.accuracies import assert_differs
from support.rubber import random_rubber


def scene_of(keys: dict[str, Any], *more: Any, pairs: Any = ()) -> Scene:
    white = [] if more else [WhiteNoise(intensity=0.7, on=keys["coordinates"][0])]
    return Scene(structure=Matrices(**keys), excitations=[*white, *more], impact_pairs=list(pairs))


def rubber_mount(spring: Any, **keys: Any) -> Isolator:
    return Isolator(**({"mass": 10.0, "stiffness": 4e4, "damping": 20.0} | keys), spring=spring)


TRUCK = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")


@pytest.mark.parametrize("seed", range(20))
def test_transfer_functions_are_those_of_the_formula(seed: int) -> None:
    own, keys = random_rubber(seed)
    model = model_of(scene_of(keys))
    modes = model.modal
    f = np.geomspace(1e-3, 30.0, 41)
    force = modes.shapes.T @ np.eye(modes.size)[0]
    found = gains(f, np.diag(modes.squares), modes.dynamic, force) @ modes.shapes.T
    for frequency, row in zip(f, found, strict=True):
        wanted = np.linalg.solve(
            own.stiffness_at(2.0 * np.pi * frequency), np.eye(len(own.mass))[0]
        )
        assert np.abs(row - wanted).max() <= 1e-10 * np.abs(wanted).max()
        # the generator of the states is of the same structure
        state = np.zeros(modes.moving, complex)
        state[modes.size : 2 * modes.size] = force
        flow = modes.generator(modes.damping, np.diag(modes.squares))
        moved = np.linalg.solve(2j * np.pi * frequency * np.eye(modes.moving) - flow, state)
        moved = modes.shapes @ moved[: modes.size]
        assert np.abs(moved - wanted).max() <= 1e-10 * np.abs(wanted).max()


def test_the_dynamic_stiffness_is_that_of_the_branches() -> None:
    spring = RelaxationSpring(stiffness=2e5, branches=[[5e4, 0.01], [1e5, 1e-3]])
    for f in (0.0, 1.0, 15.0, 1e4):
        turn = 2j * np.pi * f
        wanted = 2e5 + 5e4 * 0.01 * turn / (1 + 0.01 * turn) + 100 * turn / (1 + 1e-3 * turn)
        assert spring.dynamic_stiffness(f) == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize("seed", range(20))
def test_the_stationary_motion_solves_the_equation_of_lyapunov(seed: int) -> None:
    own, keys = random_rubber(seed)
    wanted, n = own.covariance(), len(own.mass)
    answer = exact(scene_of(keys))
    for k, name in enumerate(keys["coordinates"]):
        found = answer.coordinates[name]
        assert found.displacement_mean_square.value == pytest.approx(wanted[k, k], rel=1e-8)
        assert found.velocity_mean_square.value == pytest.approx(wanted[n + k, n + k], rel=1e-8)
    # inner states too, and their correlations
    modes = model_of(scene_of(keys)).modal
    law = linear_law(modes)
    assert law is not None
    to = np.eye(modes.moving)
    to[:n, :n] = to[n : 2 * n, n : 2 * n] = modes.shapes
    error = np.abs(to @ law.covariance @ to.T - wanted)
    assert error.max() <= 1e-8 * np.abs(wanted).max()


@pytest.mark.parametrize("seed", range(0, 20, 4))
def test_tables_and_filters_give_the_integral_over_frequency(seed: int) -> None:
    own, keys = random_rubber(seed)
    f = np.concatenate([np.linspace(0.01, 2.0, 4001), np.linspace(2.0, 20.0, 4001)[1:]])
    table = {"frequency_hz": [0.01, 1.0, 20.0], "density": [0.5, 2.0, 0.1], "unit": "N2/Hz"}
    noise = TabulatedNoise(**table, on=keys["coordinates"][0])
    density = np.exp(np.interp(np.log(f), np.log(table["frequency_hz"]), np.log(table["density"])))
    moved = np.array(
        [np.linalg.solve(own.stiffness_at(2.0 * np.pi * w), np.eye(len(own.mass))[0]) for w in f]
    )
    answer = exact(scene_of(keys, noise))
    for k, name in enumerate(keys["coordinates"]):
        wanted = np.trapezoid(np.abs(moved[:, k]) ** 2 * density, f)
        found = answer.coordinates[name].displacement_mean_square.value
        assert found == pytest.approx(wanted, rel=3e-4)  # the rule of trapezia on this grid
    filtered = FilteredNoise(intensity=0.3, frequency_hz=0.4, zeta=0.2, on=keys["coordinates"][0])
    f = np.linspace(0.0, 20.0, 40001)
    turn = f / 0.4
    density = 2.0 * 0.3 / np.abs(1.0 - turn**2 + 0.4j * turn) ** 2
    moved = np.array(
        [np.linalg.solve(own.stiffness_at(2.0 * np.pi * w), np.eye(len(own.mass))[0]) for w in f]
    )
    answer = exact(scene_of(keys, filtered))
    for k, name in enumerate(keys["coordinates"]):
        wanted = np.trapezoid(np.abs(moved[:, k]) ** 2 * density, f)
        found = answer.coordinates[name].displacement_mean_square.value
        assert found == pytest.approx(wanted, rel=3e-4)


def test_sines_pass_by_the_dynamic_stiffness() -> None:
    spring = {"kind": "relaxation", "stiffness": 1e4, "branches": [[3e4, 0.01], [1e4, 0.3]]}
    scene = Scene(
        structure=rubber_mount(spring),
        excitations=[WhiteNoise(intensity=1.0), Sine(amplitude=2.0, frequency_hz=9.0)],
    )
    turn = 2j * np.pi * 9.0
    complex_stiffness = RelaxationSpring(**spring).dynamic_stiffness(9.0)
    dynamic = 4e4 + complex_stiffness + 20.0 * turn + 10.0 * turn**2
    ((_, amplitude),) = screen(scene).only.sines
    assert amplitude == pytest.approx(abs(10.0 * 2.0 / dynamic), rel=1e-10)


def test_absolute_accelerations_hold_the_forces_of_branches() -> None:
    spring = {"kind": "relaxation", "stiffness": 0.0, "branches": [[3e4, 0.01], [1e4, 0.002]]}
    for noise in (WhiteNoise(density=0.01, unit="g2/Hz"), TRUCK):
        plain = Scene(structure=rubber_mount(spring), excitations=[noise])
        found = exact(plain).coordinates["x"]
        assert found.acceleration_std is not None
        modes = model_of(plain).modal
        law = linear_law(modes)
        assert law is not None
        row = modes.shapes @ np.hstack([np.diag(modes.squares), modes.damping])
        without = np.sqrt((row @ law.covariance[:2, :2] @ row.T)[0, 0])
        assert found.acceleration_std.value > 1.05 * without
        f = np.geomspace(0.05, 4000.0, 400_001)
        if noise is TRUCK:
            f = np.linspace(5.0, 500.0, 400_001)
        turn = 2j * np.pi * f
        pull = 4e4 + 20.0 * turn + RelaxationSpring(**spring).dynamic_stiffness(f)
        table = np.full_like(f, 0.01 * 9.80665**2)
        if noise is TRUCK:
            ((density, _),) = model_of(plain).tables
            table = density(f)
        wanted = np.trapezoid(np.abs(pull / (pull + 10.0 * turn**2)) ** 2 * table, f)
        if noise is not TRUCK:  # above 4 kHz the damper alone pulls, and below .05 Hz all moves
            wanted += table[0] * ((20.0 / (2.0 * np.pi * 10.0)) ** 2 / f[-1] + f[0])
        assert found.acceleration_std.value**2 == pytest.approx(wanted, rel=1e-4)


# Limits ----------------------------------------------------------------------------


@pytest.mark.parametrize("branches", [[], [[0.0, 0.1]]])
def test_a_spring_without_branches_is_the_plain_spring_to_the_last_digit(branches: Any) -> None:
    spring = {"kind": "relaxation", "stiffness": 4e4, "branches": branches}
    stops = [ImpactPair(clearance=0.006, law=Restitution(coefficient=0.5))]
    one, other = (
        Scene(structure=structure, excitations=[WhiteNoise(intensity=1.0)], impact_pairs=stops)
        for structure in (rubber_mount(spring, stiffness=0.0), rubber_mount(None))
    )
    found, wanted = model_of(one), model_of(other)
    assert found.branches == () and found.rates == wanted.rates
    assert np.array_equal(found.stiffness, wanted.stiffness)
    answers = [fokker_planck(scene).to_dict() for scene in (one, other)]
    assert answers[0]["coordinates"] == answers[1]["coordinates"]
    assert answers[0]["impact_pairs"] == answers[1]["impact_pairs"]


@pytest.mark.parametrize(
    ("branch", "plain"),
    [
        ([3e4, 1e-9], {}),
        ([3e4, 1e7], {"stiffness": 7e4}),
        ([2e9, 1e-8], {"damping": 40.0}),
    ],
    ids=["at once relaxed", "never relaxed", "damper"],
)
def test_limits_are_plain_springs_and_dampers(branch: list[float], plain: Any) -> None:
    spring = {"kind": "relaxation", "stiffness": 0.0, "branches": [branch]}
    f = np.geomspace(0.5, 500.0, 31)
    found, wanted = (
        model_of(Scene(structure=structure, excitations=[TRUCK])).modal
        for structure in (rubber_mount(spring), rubber_mount(None, **plain))
    )
    moved = [
        gains(f, np.diag(modes.squares), modes.dynamic, np.ones(1)) for modes in (found, wanted)
    ]
    assert np.abs(moved[0] / moved[1] - 1.0).max() <= 1e-4


def clearance_of(scene: Scene, ask: dict[str, Any]) -> Estimate:
    answer = size(scene, **ask)["stops"].clearance
    assert isinstance(answer, Estimate)
    return answer


def test_sizes_of_the_limit_of_a_damper_agree() -> None:
    spring = {"kind": "relaxation", "stiffness": 0.0, "branches": [[2e8, 1e-7]]}
    stops = [ImpactPair(clearance=0.006, law=Restitution(coefficient=0.5))]
    ask = {"probability": 0.01, "mission": 3600.0, "seed": 1}
    found, wanted, softer = (
        clearance_of(Scene(structure=structure, excitations=[TRUCK], impact_pairs=stops), ask)
        for structure in (
            rubber_mount(spring),
            rubber_mount(None, damping=40.0),
            rubber_mount(None, damping=39.0),
        )
    )
    both = replace(found, standard_error=math.hypot(found.standard_error, wanted.standard_error))
    assert_agrees(both, wanted.value)
    # a fortieth less damping would be seen
    assert_differs(both, softer.value)


# A table ---------------------------------------------------------------------------


def master_curve(folder: Path, heading: str = "frequency_hz,dynamic_stiffness,loss_factor") -> Path:
    """A fractional Zener element over six decades."""
    f = np.geomspace(1e-3, 1e3, 121) / (2.0 * np.pi * 1e-4)
    whole = fractional(f)
    file = folder / "rubber.csv"
    rows = np.column_stack([f, np.abs(whole), whole.imag / whole.real])
    np.savetxt(file, rows, delimiter=",", header=heading, comments="", fmt="%.17g")
    return file


def fractional(frequency_hz: np.ndarray) -> np.ndarray:
    power = (2j * np.pi * frequency_hz * 1e-4) ** 0.5
    return np.asarray((2e5 + 2e6 * power) / (1.0 + power))


@pytest.mark.parametrize("noise", ["white", "table"])
def test_halving_the_error_of_a_fit_changes_answers_within_their_bias(
    tmp_path: Path, noise: str
) -> None:
    file = str(master_curve(tmp_path))
    shaken = TRUCK if noise == "table" else WhiteNoise(density=0.01, unit="g2/Hz")
    answers, errors = [], []
    for error in (0.04, 0.01):
        spring = {"kind": "relaxation", "file": file, "error": error}
        scene = Scene(
            structure=rubber_mount(spring, stiffness=0.0, damping=0.0), excitations=[shaken]
        )
        (law,) = scene.structure.spring or ()
        assert isinstance(law, RelaxationSpring) and law.error <= error
        f = np.geomspace(1e-3, 1e3, 121) / (2.0 * np.pi * 1e-4)
        wrong = np.abs(law.dynamic_stiffness(f) / fractional(f) - 1.0)
        assert wrong.max() == pytest.approx(law.error, rel=1e-6)
        assert all(k >= 0.0 for k, _ in law.branches)
        errors.append(law.error)
        answers.append(exact(scene).coordinates["x"])
        again = scene_from(scene.document())
        assert again.document() == scene.document()
    assert errors[1] <= 0.5 * errors[0]
    f = np.linspace(5.0, 500.0, 200_001) if noise == "table" else np.geomspace(0.01, 3e4, 400_001)
    density = np.full_like(f, 0.01 * 9.80665**2)
    if noise == "table":
        density = model_of(scene).tables[0][0](f)
    moved = 10.0 / (fractional(f) - 10.0 * (2.0 * np.pi * f) ** 2)
    for what, power in (("displacement_std", 0), ("velocity_std", 2)):
        rough, fine = (getattr(each, what) for each in answers)
        assert abs(rough.value - fine.value) <= rough.bias
        assert 0.0 < fine.bias <= 0.5 * rough.bias
        truth = np.trapezoid(np.abs(moved) ** 2 * density * (2.0 * np.pi * f) ** power, f) ** 0.5
        # what the band of the white noise leaves out, and the rule of trapezia, is below 1e-4
        for each in (rough, fine):
            assert abs(each.value - truth) <= each.bias + 1e-4 * truth
    # an error that is not stated would be noticed
    assert abs(answers[0].displacement_std.value - answers[1].displacement_std.value) > 1e-6 * (
        answers[1].displacement_std.value
    )


@pytest.mark.parametrize(
    ("rows", "keys", "sentence"),
    [
        ("1,2e5,0.1\n2,2e5,0.1\n3,2e5,0.1\n", {"stiffness": 1.0}, "takes file, or stiffness and"),
        ("1,2e5\n2,2e5\n3,2e5\n", {}, "expected 3 numbers (frequency_hz"),
        ("1,2e5,0.1\n1,2e5,0.1\n3,2e5,0.1\n", {}, "at least 3 rising frequencies"),
        ("1,-2e5,0.1\n2,2e5,0.1\n3,2e5,0.1\n", {}, "dynamic stiffnesses above 0"),
        ("1,4e5,0.1\n10,2e5,0.1\n100,1e5,0.1\n", {}, "the table of a passive spring"),
        (
            "frequency_hz,dynamic_stiffness [N],loss_factor\n1,2e5,.1\n2,2e5,.1\n3,2e5,.1\n", {},
            "must have dynamic_stiffness in N/m, got 'N'",
        ),
    ],
)  # fmt: skip
def test_tables_that_are_none_are_refused(
    tmp_path: Path, rows: str, keys: dict[str, Any], sentence: str
) -> None:
    (tmp_path / "a.csv").write_text(rows)
    with pytest.raises(SceneError) as error:
        rubber_mount({"kind": "relaxation", "file": str(tmp_path / "a.csv")} | keys)
    assert sentence in str(error.value)


# Refusals --------------------------------------------------------------------------


def test_methods_that_do_not_follow_branches_say_so() -> None:
    spring = {"kind": "relaxation", "stiffness": 1e4, "branches": [[3e4, 0.01], [1e4, 0.3]]}
    scene = Scene(
        structure=rubber_mount(spring),
        impact_pairs=[ImpactPair(clearance=0.006, law=Restitution(coefficient=1.0))],
        excitations=[WhiteNoise(intensity=1.0)],
    )
    said = "structure.spring must have a stiffness that does not depend on frequency"
    for method in (exact, fokker_planck):
        with pytest.raises(NotApplicable, match=said) as error:
            method(scene)
        assert str(error.value).count(said) == 1
    assert "relaxing spring" in scene.effects()
    told = str(explain(scene).to_dict())
    assert said in told


def test_one_mass_of_an_oscillator_takes_them() -> None:
    spring = {"kind": "relaxation", "stiffness": 3.0, "branches": [[2.0, 0.5]]}
    scene = Scene(
        structure=Oscillator(mass=2.0, damping=0.1, stiffness=1.0, spring=spring),
        excitations=[WhiteNoise(intensity=0.2)],
    )
    found = exact(scene).coordinates["x"].displacement_mean_square.value
    a = np.array([[0.0, 1.0, 0.0], [-2.0, -0.05, -0.5], [0.0, 2.0, -2.0]])
    one = np.eye(3)
    p = np.linalg.solve(np.kron(a, one) + np.kron(one, a), -np.diag([0.0, 0.05, 0.0]).ravel())
    assert found == pytest.approx(p[0], rel=1e-10)
