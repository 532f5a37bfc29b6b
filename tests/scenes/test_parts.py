"""Springs, dampers and restitution that are functions: what is checked, carried and refused."""

from __future__ import annotations

import copy
import json
import math
import pickle
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.stats import norm

import stochvi.scenes
from stochvi import (
    Absorber,
    BetweenUnits,
    Elastic,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scatter,
    Scene,
    SceneError,
    Sine,
    TabulatedNoise,
    Viscoelastic,
    WhiteNoise,
    absorber,
    damage,
    exact,
    growth,
    load_answer,
    load_scene,
    mean_over_units,
    reliability,
    save_answer,
    screen,
    simulate,
    size,
    sweep,
)
from stochvi.cli.options import tolerances_of
from stochvi.cli.scenes import TEMPLATE
from stochvi.engine.parts import kicked, pull
from stochvi.engine.parts import moved as moved_of_parts
from stochvi.isolators import Spread, production
from stochvi.isolators.jolt_response import perturbations
from stochvi.isolators.production_risk import Units
from stochvi.isolators.screening import at_clearances
from stochvi.isolators.tolerances import Region, Tolerances, spreads_of
from stochvi.methods.averaging import average
from stochvi.methods.linearisation import linearise
from stochvi.methods.monte_carlo import prospect, record_path
from stochvi.model.coverage import functions
from stochvi.model.model import model_of
from stochvi.results.deadline import NEVER
from stochvi.scenes import Modulation, MovingBand, Phase
from stochvi.scenes.characteristics import Characteristic, DamperForce, SpringForce
from stochvi.scenes.impact_laws import SpeedRestitution
from stochvi.scenes.keys import changed_scene, key_unit, scene_schema
from stochvi.scenes.scene import scene_from
from stochvi.scenes.structures import Modes, NonlinearOscillator
from stochvi.scenes.structures.rigid_body import Mount, RigidBody
from stochvi.scenes.validation import PYTHON_ONLY, mean_unit, varied
from stochvi.statistics.crossings import own_distances
from stochvi.testing.samples import assert_mean
from stochvi.verification.check import check, explain
from stochvi.verification.cost import cost
from support.accuracies import assert_balanced
from support.known import DOCUMENT as DOCUMENT_OF_KNOWN
from support.known import changed, to_toml
from support.refusals import refusals

# ------------------------------------------------------------------------------
# Springs and dampers that are functions: forces, energies, linear forms, parts of the engine.
# ------------------------------------------------------------------------------


KEYS: dict[str, dict[str, Any]] = {
    "Duffing": {"linear_stiffness": -0.5, "cubic_stiffness": 2.0},
    "PolynomialSpring": {"coefficients": [1.0, -0.4, 0.3]},
    "SpringTable": {"deflection": [-1.0, 0.2, 0.9], "force": [-3.0, 0.1, 2.0]},
    "SpringFunction": {"force": lambda x, v: math.sinh(x) + 0.2 * v},
    "BoucWen": {"stiffness": 2.0, "yield_displacement": 0.3},
    "RelaxationSpring": {"stiffness": 2.0, "branches": [[0.5, 0.1]]},
    "PolynomialDamper": {"coefficients": [0.1, 0.5]},
    "Coulomb": {"force": 0.3},
    "Rayleigh": {"linear_damping": -0.4, "cubic_damping": 0.7},
    "VanDerPol": {"damping": 0.4, "amplitude": 0.8},
    "Relay": {"force": 0.3, "reverses_above": 0.5, "reverses_below": -0.4},
}
"""Keys of one member of each class; a new class needs an entry, or its tests fail."""

WITHOUT_UNIT = ("exponent", "beta", "coefficients", "branches")


def classes(base: type[Characteristic] = Characteristic) -> list[type[Characteristic]]:
    """Every class that says its kind."""
    found = [part for each in base.__subclasses__() for part in classes(each)]
    own = isinstance(getattr(base.model_fields.get("kind"), "default", None), str)
    return [*found, base] if own else found


@pytest.fixture(params=classes(), ids=lambda each: each.__name__)
def law(request: pytest.FixtureRequest) -> Characteristic:
    return request.param(**KEYS[request.param.__name__])


def scene_with(**structure: Any) -> Scene:
    keys = {"mass": 2.0, "damping": 0.1, "stiffness": 1.0} | structure
    return Scene(structure=Oscillator(**keys), excitations=[WhiteNoise(intensity=0.2)])


def test_every_kind_is_public_and_takes_a_place_in_the_template(law: Characteristic) -> None:
    assert getattr(stochvi.scenes, type(law).__name__) is type(law)
    assert (f'kind = "{law.kind}"' in TEMPLATE) == (law.kind not in PYTHON_ONLY)
    key = "damper" if law.is_damper else "spring"
    assert scene_with(**{key: law}).effects()[-1] == law.effect


def test_every_number_of_a_kind_has_a_unit(law: Characteristic) -> None:
    part = {"kind": law.kind}
    names = KEYS[type(law).__name__].keys() if law.kind not in PYTHON_ONLY else ()
    assert [n for n in names if n not in WITHOUT_UNIT and not key_unit({}, part, n)] == []


def test_the_engine_has_the_force_of_the_law(law: Characteristic) -> None:
    part = law.compiled(2.0)
    if law.remembers:
        assert pull(part, 0.3, 0.1, 0.5) == pytest.approx(0.5 * law.largest_force / 2.0)
        return
    for x in (-1.7, -0.3, 0.0, 0.4, 2.5):
        for v in (-1.2, 0.0, 0.7):
            assert 2.0 * pull(part, x, v, 0.0) == pytest.approx(
                float(law.force_at(x, v)), rel=1e-13
            )


def test_a_kick_solves_its_equation(law: Characteristic) -> None:
    """v' = push + damping v - F, by an integrator of another kind; friction holds what it can."""
    part, h, damping = law.compiled(2.0), 0.05, 0.2
    for x in (-0.6, 0.9):
        for v in (-0.8, -0.003, 0.4):
            for push in (0.0, -0.3):

                def rate(_: float, y: np.ndarray, x: float = x, push: float = push) -> np.ndarray:
                    # a steep line in place of the jump of friction
                    steep = type(law).__name__ == "Coulomb"
                    force = 0.15 * np.tanh(y / 1e-5) if steep else pull(part, x, y[0], 0.1)
                    return push + damping * y - force

                wanted = solve_ivp(rate, (0.0, h), [v], method="LSODA", rtol=1e-9, atol=1e-10)
                found = kicked(part, x, v, 0.1, push, damping, h)
                assert found == pytest.approx(wanted.y[0, -1], abs=2e-5)


def test_energies_belong_to_forces(law: Characteristic) -> None:
    x, step = np.array([-1.3, -0.1, 0.35, 2.0]), 1e-5
    if law.needs != "displacement":
        with pytest.raises(ValueError, match="has no potential energy"):
            law.potential_at(x)
        return
    slope = (law.potential_at(x + step) - law.potential_at(x - step)) / (2.0 * step)
    assert slope == pytest.approx(law.force_at(x), rel=1e-6)
    assert float(law.potential_at(0.0)) == 0.0


def test_linear_forms_are_those_of_many_samples(law: Characteristic) -> None:
    """The definitions E F, E F (x - m) / s^2 and E F v / s_v^2, over normal samples."""
    if law.remembers:
        return
    mean, deviation, speed = 0.2, 0.6, 0.5
    u, w = np.random.default_rng(4).standard_normal((2, 400_000))
    force = law.force_at(mean + deviation * u, speed * w) if law.kind != "function" else None
    if force is None:
        x, v = mean + deviation * u, speed * w
        force = np.sinh(x) + 0.2 * v
    form = law.linear_form(mean, deviation, speed)
    for found, samples in zip(form, (force, force * u / deviation, force * w / speed), strict=True):
        assert_mean(samples, found, bias=1e-9)


def test_the_memory_of_wire_rope_takes_the_energy_of_its_loop() -> None:
    """Against an integration of its equation over time, by an integrator of another kind."""
    rope = stochvi.scenes.BoucWen(stiffness=2.0, yield_displacement=0.3, exponent=1.5, beta=0.7)
    amplitude = 0.5

    def rates(t: float, y: np.ndarray) -> list[float]:
        v, z = amplitude * math.cos(t), y[0]
        share = 0.3 + 0.7 * np.sign(z * v)
        return [v * (1.0 - share * abs(z) ** 1.5) / 0.3, 0.6 * z * v]

    solved = solve_ivp(rates, (0.0, 8.0 * math.pi), [0.0, 0.0], max_step=0.01, rtol=1e-8)
    before = np.interp(6.0 * math.pi, solved.t, solved.y[1])
    assert rope.loop_loss(amplitude) == pytest.approx(solved.y[1, -1] - before, rel=2e-3)
    part, z = rope.compiled(1.0), 0.0
    for t in np.linspace(0.0, 8.0 * math.pi, 4001)[:-1]:
        step = 8.0 * math.pi / 4000
        z = moved_of_parts(part, z, amplitude * (math.sin(t + step) - math.sin(t)))
    assert z == pytest.approx(solved.y[0, -1], abs=2e-4)


def test_a_table_comes_from_a_file_beside_the_scene(tmp_path: Path) -> None:
    (tmp_path / "mount.csv").write_text("deflection [mm],force [N]\n0,0\n1,2\n3,10\n")
    (tmp_path / "a.toml").write_text(
        '[structure]\nkind = "isolator"\nmass = 1.0\ndamping = 1.0\nstiffness = 0.0\nmounts = 2\n'
        'spring = { kind = "table", file = "mount.csv" }\n'
        '[[excitation]]\nkind = "white"\nintensity = 1.0\n'
    )
    scene = load_scene(tmp_path / "a.toml")
    (part,) = scene.structure.functions
    assert part.count == 2 and part.law.source == "mount.csv"
    assert part.law.force_at([-0.002, 0.001]).round(12).tolist() == [-6.0, 2.0]
    assert scene.effects()[-1] == "tabulated spring"
    again = stochvi.scenes.scene.scene_from(scene.document())
    assert again.document() == scene.document()


test_faults_are_named = refusals(
    lambda keys: scene_with(**keys),
    ({"spring": {"kind": "duffing", "cubic": 1.0}}, "spring.cubic_stiffness is missing"),
    ({"spring": {"kind": "duff"}}, "spring has kind 'duff', expected 'bouc-wen', 'duffing'"),
    ({"damper": {"kind": "coulomb", "force": -1.0}}, "damper.force must be greater than 0"),
    (
        {"spring": {"kind": "polynomial", "coefficients": [1.0, 2.0]}},
        "spring needs coefficients that end with an odd power",
    ),
    (
        {"spring": {"kind": "table", "deflection": [0.0, 1.0], "force": [0.0, 0.0]}},
        "spring needs force that rises in the first and the last piece",
    ),
    ({"spring": lambda x: x}, "needs force that takes a displacement"),
    (
        {"spring": {"kind": "relaxation", "stiffness": 1.0, "branches": [[1.0, 1.0], [2.0]]}},
        "spring needs branches of a stiffness of at least 0 (N/m) and a relaxation time above "
        "0 (s), got [2.0] as branch 2",
    ),
    (
        {"spring": {"kind": "relaxation", "stiffness": 1.0, "branches": [[1.0, 0.0]]}},
        "got [1.0, 0.0] as branch 1",
    ),
    (
        {"spring": {"kind": "relaxation", "stiffness": 1.0, "branches": [[-1.0, 1.0]]}},
        "got [-1.0, 1.0] as branch 1",
    ),
    (
        {"spring": {"kind": "relaxation", "stiffness": -1.0, "branches": [[1.0, 1.0]]}},
        "spring.stiffness must be at least 0, got -1",
    ),
    ({"spring": {"kind": "relaxation", "branches": 3.0}}, "spring.stiffness is missing"),
)


@pytest.mark.parametrize(
    ("place", "sentence"),
    [
        ({}, "structure.spring needs on or between, with names of 'a' or 'b', got none"),
        ({"on": "c"}, "structure.spring must be on 'a' or 'b', got 'c'"),
        ({"on": "a", "between": ["a", "b"]}, "structure.spring takes on or between, got both"),
        ({"between": ["a", "a"]}, "structure.spring needs two different places in between"),
        ({"on": "a", "axis": "x"}, "structure.spring takes axis in a [[structure.mount]] only"),
    ],
)  # fmt: skip
def test_a_place_is_needed_where_there_are_several(place: dict[str, Any], sentence: str) -> None:
    unit = [[1.0, 0.0], [0.0, 1.0]]
    spring = {"kind": "duffing", "cubic_stiffness": 1.0} | place
    with pytest.raises(SceneError) as error:
        Scene(
            structure=Matrices(
                coordinates=["a", "b"], mass=unit, damping=unit, stiffness=unit, spring=spring
            ),
            excitations=[WhiteNoise(intensity=1.0, on="a")],
        )
    assert sentence in str(error.value)


def test_a_force_needs_the_mass_and_a_mount_its_axis() -> None:
    spring = {"kind": "duffing", "cubic_stiffness": 1.0}
    with pytest.raises(SceneError, match=r"which needs structure\.mass, got none"):
        Scene(
            structure=Isolator(frequency_hz=1.0, zeta=0.1, spring=spring),
            excitations=[WhiteNoise(intensity=1.0)],
        )
    with pytest.raises(SceneError, match=r"needs axis = 'x', 'y' or 'z' in spring"):
        Mount(at=[0.0, 0.0, 0.0], stiffness=[1.0] * 3, damping=[1.0] * 3, spring=spring)


def test_a_mount_of_a_box_acts_where_it_holds_the_box() -> None:
    places = [(0.2, 0.1, -0.1), (-0.2, 0.1, 0.0), (0.0, -0.1, 0.0)]
    spring = {"kind": "duffing", "cubic_stiffness": 1.0, "axis": "z"}
    mounts = [Mount(at=p, stiffness=[1.0] * 3, damping=[0.1] * 3, spring=spring) for p in places]
    box = RigidBody(mass=1.0, inertia=[0.1, 0.1, 0.1], mounts=mounts)
    assert [part.name for part in box.functions] == [
        f"spring of mount {number} along z" for number in (1, 2, 3)
    ]
    # z + rx y - ry x of the place
    assert box.functions[0].row.tolist() == [0.0, 0.0, 1.0, 0.1, -0.2, 0.0]


def test_a_scene_file_cannot_hold_a_function(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(
        '[structure]\nkind = "oscillator"\nmass = 1.0\ndamping = 1.0\nstiffness = 1.0\n'
        'spring = { kind = "function" }\n[[excitation]]\nkind = "white"\nintensity = 1.0\n'
    )
    with pytest.raises(SceneError, match=r"structure.spring.kind 'function' takes a function"):
        load_scene(tmp_path / "a.toml")
    assert "SpringFunction" not in scene_schema()["$defs"]


def test_the_bases_have_no_kind_of_their_own() -> None:
    assert {each.__name__ for each in classes()} == set(KEYS)
    assert SpringForce not in classes() and DamperForce not in classes()


# ------------------------------------------------------------------------------
# What a user writes for a modulation, and the sentences where it does not fit.
# ------------------------------------------------------------------------------


def scene_of(structure: Any = None, **keys: Any) -> Scene:
    plain = Oscillator(mass=2.0, damping=0.2, stiffness=8.0)
    return Scene(
        structure=structure or plain,
        excitations=[
            WhiteNoise(intensity=0.4, on="a" if structure else None),
            {"kind": "modulation"} | keys,
        ],
    )


def test_a_modulation_is_a_force_and_a_signal_of_the_model() -> None:
    model = model_of(scene_of(of="stiffness", intensity=0.1, frequency_hz=1.0, zeta=0.5))
    (part,), (signal,) = model.functions, model.signals
    assert (part.law.stiffness, part.law.damping, part.signal) == (8.0, 0.0, 0)
    assert signal.direction.tolist() == [0.0] and signal.omega == 2.0 * math.pi
    white = model_of(scene_of(of="damping", intensity=0.1))
    assert white.signals == () and white.functions[0].white_modulation == 0.1
    assert white.shaken and not model_of(scene_of(of="damping", intensity=0.1)).pairs


def test_strengths_between_coordinates_come_from_the_matrices() -> None:
    chain = Matrices(
        coordinates=["a", "b"], mass=[[1.0, 0.0], [0.0, 2.0]],
        damping=[[0.3, -0.1], [-0.1, 0.1]], stiffness=[[5.0, -2.0], [-2.0, 2.0]],
    )  # fmt: skip
    between = model_of(scene_of(chain, of="stiffness", intensity=0.1, between=["a", "b"]))
    assert between.functions[0].law.stiffness == 2.0
    assert between.functions[0].mass == pytest.approx(2.0 / 3.0)
    ground = model_of(scene_of(chain, of="damping", intensity=0.1, on="a"))
    assert ground.functions[0].law.damping == pytest.approx(0.2)
    with pytest.raises(SceneError, match=r"needs a linear spring between b and the ground, got 0"):
        scene_of(chain, of="stiffness", intensity=0.1, on="b")


test_faults_are_named_modulation = refusals(
    lambda keys: scene_of(**keys),
    ({"of": "mass", "intensity": 1.0}, "of must be 'stiffness', 'damping' or 'clearance', got"),
    ({"of": "stiffness"}, "needs amplitude and frequency_hz (a sine), intensity (white noise)"),
    ({"of": "stiffness", "amplitude": 0.1}, "filtered noise), got amplitude"),
    ({"of": "stiffness", "intensity": 0.1, "on": "y"}, "must act on 'x', got 'y'"),
    ({"of": "stiffness", "intensity": 0.1, "axis": "x"}, "takes no axis"),
)


def test_a_place_is_needed_where_there_are_several_modulation() -> None:
    unit = [[1.0, 0.0], [0.0, 1.0]]
    pair = Matrices(coordinates=["a", "b"], mass=unit, damping=unit, stiffness=unit)
    for keys, sentence in (
        ({}, "needs on or between, with names of 'a' or 'b', got none"),
        ({"on": "a", "between": ["a", "b"]}, "takes on or between, got both"),
        ({"between": ["a", "a"]}, "needs two different names in between"),
    ):
        with pytest.raises(SceneError) as error:
            scene_of(pair, of="stiffness", intensity=0.1, **keys)
        assert sentence in str(error.value)


def test_a_structure_of_modes_has_no_spring_to_modulate() -> None:
    modes = Modes(frequency_hz=[1.0], zeta=[0.1], modal_mass=[1.0], shapes={"a": [1.0]})
    with pytest.raises(SceneError, match=r"of stiffness takes structure\.kind = 'oscillator', "):
        scene_of(modes, of="stiffness", intensity=0.1)


def test_a_level_leaves_a_modulation_as_it_is() -> None:
    scene = scene_of(of="stiffness", intensity=0.1)
    louder = scene.at_level(6.0).excitations
    assert louder[1] == scene.excitations[1] and louder[0] != scene.excitations[0]


def test_two_modulations_have_names_of_their_own() -> None:
    keys = {"of": "stiffness", "amplitude": 0.1, "frequency_hz": 1.0}
    scene = scene_of(**keys)
    scene = scene.replace(excitations=[*scene.excitations, Modulation(**keys | {"amplitude": 0.2})])
    names = [part.name for part in model_of(scene).functions]
    assert names == ["modulation of stiffness by a sine 1", "modulation of stiffness by a sine 2"]


PLACES = [(x, y, -0.1) for x in (-0.2, 0.3) for y in (-0.15, 0.15)]


def box_of(*mounts: Mount) -> RigidBody:
    """A box on four mounts at its corners, and on others."""
    corners = [Mount(at=at, stiffness=[2e4, 1e4, 3e4], damping=[20.0, 30.0, 40.0]) for at in PLACES]
    return RigidBody(mass=12.0, inertia=[0.2, 0.25, 0.15], mounts=[*corners, *mounts])


def on_box(box: RigidBody, *modulations: dict[str, Any]) -> Scene:
    noise = {"kind": "white", "on": "z", "intensity": 1.0}
    parts = [{"kind": "modulation", "amplitude": 0.3, "frequency_hz": 5.0} | m for m in modulations]
    return Scene(structure=box, excitations=[noise, *parts])


@pytest.mark.parametrize(("of", "matrix"), [("damping", 1), ("stiffness", 2)])
@pytest.mark.parametrize(("axis", "along"), [("x", 0), ("z", 2)])
def test_a_mount_changes_the_matrices_of_its_box(
    of: str, matrix: int, axis: str, along: int
) -> None:
    """By as much as the same box whose third mount is stiffer, or better damped, along the axis."""
    box = box_of()
    (part,) = model_of(on_box(box, {"of": of, "on": "mount 3", "axis": axis})).functions
    strength = part.law.stiffness + part.law.damping
    third = box.mounts[2]
    rates = list(getattr(third, of))
    rates[along] *= 1.25
    changed = box.replace(
        mounts=[*box.mounts[:2], third.replace(**{of: rates}), box.mounts[3]]
    )  # fmt: skip
    wanted = changed.matrices[matrix] - box.matrices[matrix]
    found = 0.25 * strength * np.outer(part.direction, part.direction)
    assert found == pytest.approx(wanted, abs=1e-12 * strength)


def test_a_mount_under_the_centre_drives_its_box_as_an_oscillator() -> None:
    """The growth by Floquet of a motion along z that no other motion shares."""
    centre = Mount(at=(0.0, 0.0, 0.0), stiffness=[1e3, 1e3, 6e4], damping=[0.0, 0.0, 10.0])
    corners = [(x, y, 0.0) for x in (-0.2, 0.2) for y in (-0.15, 0.15)]
    mounts = [Mount(at=at, stiffness=[2e4] * 3, damping=[30.0] * 3) for at in corners]
    box = RigidBody(mass=12.0, inertia=[0.2, 0.25, 0.15], mounts=[*mounts, centre])
    stiffness, damping = 8e4 + 6e4, 4.0 * 30.0 + 10.0
    twice = 2.0 * math.sqrt(stiffness / 12.0) / (2.0 * math.pi)
    keys = {"of": "stiffness", "amplitude": 0.5, "frequency_hz": twice}
    alone = Scene(
        structure=Oscillator(mass=12.0, damping=damping, stiffness=stiffness),
        excitations=[Modulation(**keys | {"amplitude": 0.5 * 6.0 / 14.0})],
    )
    found = growth(on_box(box, keys | {"on": "mount 5", "axis": "z"})).lyapunov_exponent
    known = growth(alone).lyapunov_exponent
    assert found.value == pytest.approx(known.value, rel=1e-6) and known.value > 0.0
    other = growth(on_box(box, keys | {"on": "mount 5", "axis": "x"})).lyapunov_exponent
    assert other.value < 0.0  # the control: along x it leaves that motion alone


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({}, "needs on = 'mount 1' or 'mount 2' or 'mount 3' or 'mount 4' and axis = 'x', 'y' or "),
        ({"on": "mount 5", "axis": "z"}, "'z', got on = 'mount 5', axis = 'z'"),
        ({"on": "mount 1"}, "got on = 'mount 1', axis = None"),
        ({"on": "mount 5", "axis": "y", "more": {"stiffness": [1.0, 0.0, 1.0], "zeta": 0.1}},
         "needs stiffness of mount 5 along y, got 0"),
        ({"of": "damping", "on": "mount 5", "axis": "z",
          "more": {"stiffness": [1.0, 0.0, 1.0], "zeta": 0.1}},
         "of damping needs damping (N s/m along x, y, z) of mount 5, got none"),
    ],
)  # fmt: skip
def test_a_mount_is_named_by_its_number(keys: dict[str, Any], sentence: str) -> None:
    more = keys.pop("more", None)
    box = box_of(*([Mount(at=(0.0, 0.0, 0.0), **more)] if more else []))
    with pytest.raises(SceneError) as error:
        on_box(box, {"of": "stiffness"} | keys)
    assert sentence in str(error.value)


def test_a_box_whose_mount_is_modulated_is_simulated() -> None:
    scene = on_box(box_of(), {"of": "stiffness", "on": "mount 2", "axis": "z"})
    assert "modulation of stiffness by a sine on mount 2 along z" in scene.effects()
    found = simulate(scene, paths=64, duration=20.0, seed=1)
    assert_balanced(found)


# ------------------------------------------------------------------------------
# Bands and sines that move through a phase: their steps, and their risk against counted missions
# in which they move.
# ------------------------------------------------------------------------------


PROFILE = "mil-std-810h-truck-vertical-5hz"
NATURAL, ZETA, RATE = 12.0, 0.1, 480.0
BAND = {"from_hz": 8.0, "to_hz": 18.0, "width_hz": 3.0, "density": 0.08, "unit": "g2/Hz"}


def swept(clearance: float, **phase: Any) -> Scene:
    pair = ImpactPair(clearance=clearance, law=Restitution(coefficient=0.7))
    return Scene(
        structure=Isolator(frequency_hz=NATURAL, zeta=ZETA), impact_pairs=[pair],
        excitations=[TabulatedNoise(profile=PROFILE)],
        phases=[{"name": "tracks", "duration": "1 min"} | phase],
    )  # fmt: skip


@cache
def lines(samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Of each spectral line the size in the noise of the road, and the gain of the mount from a
    base acceleration to its relative displacement."""
    f = np.fft.rfftfreq(samples, 1.0 / RATE)
    table = TabulatedNoise(profile=PROFILE).table
    low, high = table.frequency_hz[[0, -1]]
    density = np.where((f >= low) & (f <= high), table(np.clip(f, low, high)), 0.0)
    w, own = 2.0 * math.pi * f, 2.0 * math.pi * NATURAL
    gain = -1.0 / (own**2 - w**2 + 2j * ZETA * own * w)
    return 0.5 * np.sqrt(density * samples * RATE), gain


def moved(accelerations: np.ndarray) -> np.ndarray:
    """Relative displacement of the mount on a base with these accelerations."""
    samples = len(accelerations)
    return np.fft.irfft(np.fft.rfft(accelerations) * lines(samples)[1], samples)


def road(random: np.random.Generator, samples: int) -> np.ndarray:
    size = lines(samples)[0]
    parts = random.standard_normal((2, len(size)))
    return np.fft.irfft((parts[0] + 1j * parts[1]) * size, samples)


def moving(random: np.random.Generator, samples: int, band: dict[str, Any]) -> np.ndarray:
    """A band or a sine whose frequency moves evenly in its logarithm."""
    share = np.arange(samples) / samples
    hertz = band["from_hz"] * (band["to_hz"] / band["from_hz"]) ** share
    phase = 2.0 * math.pi * (np.cumsum(hertz) / RATE + random.random())
    if "amplitude" in band:
        return np.asarray(band["amplitude"] * np.cos(phase))
    f = np.fft.fftfreq(samples, 1.0 / RATE)
    inside = np.abs(f) < 0.5 * band["width_hz"]
    parts = random.standard_normal((2, samples)) * inside
    slow = np.fft.ifft(parts[0] + 1j * parts[1]) * samples
    variance = band["density"] * 9.80665**2 * band["width_hz"]
    slow *= math.sqrt(variance / float(inside.sum()))
    return np.asarray((slow * np.exp(1j * phase)).real)


@pytest.mark.parametrize(
    ("clearance", "band", "steps"),
    [(0.0143, BAND, 24), (0.0098, {"from_hz": 9.0, "to_hz": 16.0, "amplitude": 4.0}, 24)],
    ids=["band", "sine"],
)
@pytest.mark.parametrize("number", [300, pytest.param(1200, marks=pytest.mark.verify)])
def test_the_chance_of_any_hit_is_that_of_missions_through_which_it_moves(
    clearance: float, band: dict[str, Any], steps: int, number: int
) -> None:
    scene = swept(clearance, moving=[band], steps=steps)
    found = reliability(scene, seed=1, rel_error=0.1).chances["hit"].estimate
    random = np.random.default_rng(4)
    samples, ends = round(70.0 * RATE), round(5.0 * RATE)
    hit = []
    for _ in range(number):
        base = road(random, samples)
        base[ends:-ends] += moving(random, samples - 2 * ends, band)
        hit.append(np.abs(moved(base)[ends:-ends]).max() > clearance)
    counted = float(np.mean(hit))
    error = math.sqrt(counted * (1.0 - counted) / number)
    assert 0.1 < counted < 0.9
    assert abs(found.value - counted) < 4.5 * math.hypot(error, found.standard_error)
    # a band that stands at the middle is told apart
    middle = band | {"from_hz": 8.0, "to_hz": 8.1}
    still = reliability(swept(clearance, moving=[middle]), seed=1, rel_error=0.2).chances["hit"]
    assert abs(still.estimate.value - counted) > 4.5 * math.hypot(
        error, still.estimate.standard_error
    )


def test_the_bias_covers_what_more_steps_change() -> None:
    few, many = (
        reliability(swept(0.0175, moving=[BAND], steps=steps), seed=1, rel_error=0.05)
        for steps in (6, 36)
    )
    one, other = (each.chances["hit"].estimate for each in (few, many))
    assert one.bias is not None and other.bias is not None
    statistical = math.hypot(one.standard_error, other.standard_error)
    assert abs(one.value - other.value) < 4.5 * statistical + one.bias + other.bias
    assert other.bias < 0.1 * other.value
    # the bias is needed: at this number of steps it is the larger error
    assert one.bias > 2.0 * one.standard_error
    assert few.hits is not None and few.hits.bias is not None
    assert few.hits.bias > 2.0 * few.hits.standard_error


def test_size_and_one_step_follow_without_a_word_of_their_own() -> None:
    scene = swept(0.0155, moving=[BAND], steps=6)
    assert scene.phases[0].name == "tracks, 8.559 Hz"
    assert sum(each.duration for each in scene.phases) == pytest.approx(60.0)
    step = scene.in_phase("tracks, 12.84 Hz")
    assert [each.kind for each in step.excitations] == ["psd", "psd"]
    worn = damage(step, mission=10.0, equipment=[40.0, 41.0, 50.0]).way
    assert worn == "simulation" or worn == "clusters"
    found = size(scene, probability=0.1, rel_error=0.2, seed=1)
    assert found.clearance.value > 0.0155
    assert Scene(**scene.document()) == scene


def test_what_moves_is_written_in_full() -> None:
    band = MovingBand(from_hz=10.0, to_hz=40.0, amplitude=2.0)
    assert band.frequency(0.5, "logarithmic") == pytest.approx(20.0)
    assert band.frequency(0.5, "linear") == pytest.approx(25.0)
    sine = band.at(1.0, "linear")
    assert isinstance(sine, Sine) and sine.frequency_hz == pytest.approx(40.0)
    phase = Phase(name="a", duration=10.0, moving=[MovingBand(**BAND)])
    assert len(phase.standing) == 14  # a quarter of a width of 3 Hz over 10 Hz
    added = Scene(
        structure=Isolator(frequency_hz=NATURAL, zeta=ZETA),
        phases=[{"name": "b", "duration": 1.0, "added_excitation": [{"kind": "sine",
                 "amplitude": 1.0, "frequency_hz": 5.0}]}],
    )  # fmt: skip
    assert added.in_phase("b").excitations[0].kind == "sine"


test_wrong_keys_are_named = refusals(
    lambda keys: swept(0.01, **keys),
    ({"moving": [{"from_hz": 5.0, "to_hz": 9.0}]}, "needs width_hz, density and unit"),
    ({"moving": [BAND | {"width_hz": 20.0}]}, "width_hz below twice its lowest frequency"),
    ({"steps": 4}, "has steps = 4 without a moving_band"),
)


# ------------------------------------------------------------------------------
# Numbers that scatter in a scene: what is accepted, what is refused, and how they are varied.
# ------------------------------------------------------------------------------


LAWS = {
    "law": {"kind": "restitution", "coefficient": 0.5},
    "upper_law": {"kind": "restitution", "coefficient": {"mean": 0.7, "std": 0.1}},
}
SCENE = to_toml(changed(["impact_pair"], [{"lower": -1.0, "upper": 1.0} | LAWS]))


def test_each_stop_may_have_its_own(tmp_path: Any) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    scene = load_scene(path)
    lower, upper = (law for _, law in scene.impact_pairs[0].stops())
    assert lower == Restitution(coefficient=0.5)
    assert upper == Restitution(coefficient=Scatter(mean=0.7, std=0.1))
    assert scene.effects()[1:] == (
        "rigid stop lower", "rigid stop upper, restitution drawn at each impact",
    )  # fmt: skip
    again = scene_from(json.loads(json.dumps(scene.model_dump(mode="json", by_alias=True))))
    assert again == scene


test_what_is_no_restitution_is_refused_in_a_sentence = refusals(
    lambda value: Restitution(coefficient=value),
    ({"mean": 0.7, "std": 0.5}, "must have std below sqrt(mean (1 - mean)) = 0.4583, got 0.5"),
    ({"mean": 1.0, "std": 0.1}, "must have std below sqrt(mean (1 - mean)) = 0, got 0.1"),
    ({"mean": 1.2, "std": 0.1}, "coefficient must be in [0, 1], got 1.2"),
    ({"mean": 0.7}, "coefficient.std is missing"),
    ({"mean": 0.7, "std": -0.1}, "coefficient.std must be at least 0, got -0.1"),
    ({"mean": 0.7, "sd": 0.1}, "coefficient.sd is not a known key; did you mean 'std'?"),
    ({"mean": "x", "std": 0.1}, "coefficient.mean must be a finite number, got 'x'"),
    ([0.7, 0.1], "coefficient must be a finite number, got [0.7, 0.1]"),
    (1.7, "coefficient must be in [0, 1], got 1.7"),
)


@pytest.mark.parametrize("mean", [0.0, 0.3, 1.0])
def test_no_scatter_is_allowed_at_any_mean(mean: float) -> None:
    law = Restitution(coefficient={"mean": mean, "std": 0.0})
    assert law.scatter is None
    assert law.restitution == law.slow_restitution == mean
    assert law.restitution_mean_square == mean**2
    assert law.conservative == (mean == 1.0)


def test_mean_and_std_can_be_varied(tmp_path: Any) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    scene = load_scene(path)
    key = "impact_pair.0.upper_law.coefficient"
    table = sweep(scene, {f"{key}.std": [0.0, 0.2], f"{key}.mean": [0.6]}, method="fokker-planck")
    first, last = table["stops.impact_speed_rate"]
    assert first < last
    with pytest.raises(SceneError, match=r"did you mean 'impact_pair.0.upper_law.coefficient.mean"):
        sweep(scene, {key: [0.5]})
    with pytest.raises(SceneError, match=r"std = 0.6, impact_pair.0.upper_law.coefficient must"):
        sweep(scene, {f"{key}.std": [0.6]})


def test_the_schema_of_scene_files_knows_it() -> None:
    parts = scene_schema()["$defs"]
    choices = parts["Restitution"]["properties"]["coefficient"]["oneOf"]
    assert choices == [{"type": "number"}, {"$ref": "#/$defs/Scatter"}]
    assert parts["Scatter"]["required"] == ["mean", "std"]


@pytest.mark.parametrize("amount", [-2.0, -0.1, 0.1, 2.0])
def test_a_shifted_mean_keeps_a_distribution(amount: float) -> None:
    law = Restitution(coefficient={"mean": 0.7, "std": 0.3}).shifted(amount)
    assert law.scatter is not None and law.scatter.std == 0.3
    assert law.scatter.alpha > 0.0 and law.scatter.beta > 0.0
    if abs(amount) < 1.0:
        assert law.restitution == pytest.approx(0.7 + amount)


def test_a_law_that_was_read_is_the_same_law_and_changes_with_its_coefficient() -> None:
    law, unread = (Restitution(coefficient={"mean": 0.7, "std": 0.1}) for _ in range(2))
    known = law.scatter, law.restitution, law.restitution_mean_square
    assert known[1:] == (0.7, pytest.approx(0.5))
    assert (law, hash(law), repr(law)) == (unread, hash(unread), repr(unread))
    plain = law.replace(coefficient=0.5)
    assert (plain.scatter, plain.restitution, plain.restitution_mean_square) == (None, 0.5, 0.25)


# ------------------------------------------------------------------------------
# Numbers of a scene that differ between units: what is accepted, kept, and taken by whom.
# ------------------------------------------------------------------------------


NOISE = [WhiteNoise(density=0.01, unit="g2/Hz")]
MOUNT = {"kind": "isolator", "mass": 2.0, "zeta": {"mean": 0.05, "half_width": 0.01},
         "frequency_hz": {"mean": 10.0, "std": 0.3}}  # fmt: skip
STOPS = {"lower": {"mean": -0.011, "half_width": 2e-4}, "upper": {"mean": 0.01, "std": 1e-4}}
SOFT = {"kind": "viscoelastic", "stiffness": {"mean": 1e5, "std": 2e4}, "damping_ratio": 0.1}
DOCUMENT: dict[str, Any] = {
    "structure": MOUNT,
    "impact_pair": [STOPS | {"law": SOFT}],
    "excitation": [{"kind": "white", "density": 0.01, "unit": "g2/Hz"}],
}


def pair(**keys: Any) -> ImpactPair:
    return ImpactPair(**({"law": Restitution(coefficient=0.5)} | keys))


def scene_of_of_between_units(*pairs: ImpactPair, **mount: Any) -> Scene:
    structure = Isolator(**({"mass": 2.0, "frequency_hz": 10.0, "zeta": 0.05} | mount))
    return Scene(structure=structure, impact_pairs=pairs, excitations=NOISE)


def test_a_document_a_copy_and_a_saved_answer_keep_what_differs(tmp_path: Any) -> None:
    scene = scene_from(DOCUMENT)
    differing = dict(varied(scene))
    assert list(differing) == [
        "structure.frequency_hz", "structure.zeta", "impact_pair.0.lower", "impact_pair.0.upper",
        "impact_pair.0.law.stiffness",
    ]  # fmt: skip
    written = scene.document()
    assert written["structure"]["zeta"] == {"mean": 0.05, "half_width": 0.01}
    assert scene_from(json.loads(json.dumps(written))).document() == written
    for again in (pickle.loads(pickle.dumps(scene)), copy.deepcopy(scene)):
        assert dict(varied(again)) == differing
    save_answer(screen(scene), tmp_path / "answer.json")
    saved = load_answer(tmp_path / "answer.json").provenance["scene"]
    assert saved["impact_pair"][0]["law"]["stiffness"] == {"mean": 1e5, "std": 2e4}
    # the control: a mean unit differs in nothing else, and in its document
    assert not dict(varied(mean_unit(scene))) and mean_unit(scene).document() != written


test_what_cannot_differ_so_is_refused_in_a_sentence = refusals(
    lambda value: Isolator(frequency_hz=value, zeta=0.1),
    ({"mean": 1.0}, "needs exactly one of std (normal) and half_width (uniform), got none"),
    ({"mean": 1.0, "std": 0.1, "half_width": 0.1}, "got std, half_width"),
    ({"mean": 1.0, "std": 0.0}, "frequency_hz.std must be greater than 0, got 0"),
    ({"mean": 0.1, "half_width": 0.1}, "must be greater than 0 in every unit, got 0"),
    ({"mean": -1.0, "std": 0.1}, "must be greater than 0 in every unit, got -1"),
    ({"mean": 1.0, "sd": 2}, "frequency_hz.sd is not a known key; did you mean 'std'?"),
    ("x", "frequency_hz must be a finite number, got 'x'"),
    (0.0, "frequency_hz must be greater than 0, got 0"),
)


def test_a_limit_beside_a_distribution_of_the_same_quantity_is_refused() -> None:
    with pytest.raises(SceneError, match="takes damping_tolerance, or zeta that differs"):
        Isolator(frequency_hz=10.0, zeta={"mean": 0.1, "std": 0.01}, damping_tolerance=0.1)
    assert Isolator(
        frequency_hz=10.0, zeta={"mean": 0.1, "std": 0.01}, frequency_tolerance=0.1
    ).frequency_tolerance == 0.1  # fmt: skip


def test_one_clearance_stands_for_two_stops_with_errors_of_their_own() -> None:
    both = pair(clearance=BetweenUnits(mean=0.004, std=1e-4))
    assert both.lower == place(-0.004, std=1e-4) and both.symmetric
    spreads = spreads_of(scene_of_of_between_units(both))
    assert spreads == dict.fromkeys(
        ["clearance lower stops", "clearance upper stops"], Spread(std=1e-4)
    )


def place(mean: float, **width: float) -> float:
    found = pair(upper=BetweenUnits(mean=mean, **width)).upper
    assert found is not None
    return found


def test_the_schema_and_the_keys_know_what_differs_by_its_class() -> None:
    parts = scene_schema()["$defs"]
    choices = parts["ImpactPair"]["properties"]["upper"]["oneOf"]
    assert {"$ref": "#/$defs/BetweenUnits"} in choices
    assert parts["BetweenUnits"]["required"] == ["mean"]
    document = scene_from(DOCUMENT).document()
    wider = changed_scene(document, (("impact_pair.0.upper.std", 3e-4),))
    assert dict(varied(wider))["impact_pair.0.upper"].std == 3e-4
    with pytest.raises(SceneError, match=r"did you mean 'impact_pair.0.law.stiffness.mean'\?"):
        changed_scene(document, (("impact_pair.0.law.stiffness", 2e5),))
    even = scene_of_of_between_units(pair(clearance={"mean": 0.01, "std": 1e-4})).document()
    moved = changed_scene(even, (("impact_pair.0.clearance", 0.02),))
    assert moved.impact_pairs[0].upper == place(0.02, std=1e-4)


def test_every_other_method_answers_for_the_mean_unit_and_says_so() -> None:
    scene = scene_from(DOCUMENT)
    plain = mean_unit(scene)
    found, alone = (
        simulate(each, paths=8, duration=2.0, seed=1, threads=1) for each in (scene, plain)
    )
    for name, value in found.coordinates["x"].items():
        assert value == alone.coordinates["x"][name]
    (own,) = set(found.assumptions) - set(alone.assumptions)
    assert own.startswith("numbers that differ between units are at their means")
    assert "structure.zeta (0.05 ± 0.01), impact_pair.0.lower (-0.011 ± 0.0002)" in own
    assert own in screen(scene).notes


def test_what_is_not_told_of_units_is_told_of_their_mean() -> None:
    """Answers without assumptions carry the sentence among their warnings."""
    shaken = [Sine(amplitude=10.0, frequency_hz=40.0)]
    stiff = {"kind": "restitution", "coefficient": 0.5}
    mount = {
        "kind": "isolator",
        "mass": 1.0,
        "zeta": 0.01,
        "frequency_hz": {"mean": 0.16, "std": 0.002},
    }
    loose = Scene(
        structure=mount, excitations=[WhiteNoise(intensity=0.04, on="base")],
        absorber=Absorber(mass=0.1, play=2.0, law=stiff),
    )  # fmt: skip
    jolted = Scene(
        structure=Oscillator(mass=1.0, damping=1.0, stiffness=4e3), excitations=shaken,
        impact_pairs=[ImpactPair(clearance={"mean": 0.01, "std": 1e-4}, law=stiff)],
    )  # fmt: skip
    answers = [
        absorber(loose, levels_db=[0.0], rel_error=0.3),
        perturbations(jolted, [0.3], paths=2, duration=4.0),
    ]  # fmt: skip
    for found in answers:
        (told,) = (each for each in found.warnings if "differ between units" in each)
        assert told.startswith("numbers that differ between units are at their means")
    plain = jolted.replace(impact_pairs=[ImpactPair(clearance=0.01, law=stiff)])
    assert not any(
        "units" in each for each in perturbations(plain, [0.3], paths=2, duration=4.0).warnings
    )


def test_a_warm_mount_and_stops_that_move_differ_as_before() -> None:
    scene = scene_from(DOCUMENT)
    warm = Phase(name="warm", duration=60.0, stiffness_factor=4.0).of(scene)
    differing = dict(varied(warm))
    assert differing["structure.frequency_hz"] == BetweenUnits(mean=20.0, std=0.6)
    moved = at_clearances(scene, [[0.02], [0.03]])
    assert dict(varied(moved))["impact_pair.0.upper"] == BetweenUnits(mean=0.03, std=1e-4)


def test_gaps_over_stops_with_own_distributions_have_the_closed_mean() -> None:
    scene = scene_of_of_between_units(pair(lower=-0.011, upper=0.01))
    sigma = float(Region(scene, Tolerances()).nominal.sigma[0])
    std, half = 0.3 * sigma, 0.5 * sigma
    differing = scene_of_of_between_units(
        pair(lower={"mean": -0.011, "half_width": half}, upper={"mean": 0.01, "std": std})
    )
    stops = np.array(own_distances(model_of(differing)))
    units = Units(scene=differing, spreads=spreads_of(differing), mean=np.zeros(1), stops=stops)
    units.solve(NEVER)
    ticks = (np.arange(4000) + 0.5) / 4000
    points = np.stack([ticks, np.random.default_rng(1).permutation(ticks)], axis=1)
    gaps = units.gaps(units.drawn(points))
    both = sigma**2 + std**2
    upper = sigma / math.sqrt(both) * math.exp(-0.5 * 0.01**2 / both)
    ends = norm.cdf([(0.011 - half) / sigma, (0.011 + half) / sigma])
    lower = math.sqrt(2.0 * math.pi) * sigma * float(np.diff(ends)[0]) / (2.0 * half)
    assert gaps.rice(stops).mean() == pytest.approx(gaps.rate[0, 0] * (upper + lower), rel=1e-3)
    # the control: the two distributions exchanged
    exchanged = gaps.rice(stops[::-1]).mean()
    assert exchanged != pytest.approx(gaps.rate[0, 0] * (upper + lower), rel=1e-2)


@pytest.mark.slow
def test_the_risk_is_that_of_the_same_tolerances_on_the_command_line() -> None:
    scene = scene_from(DOCUMENT | {"impact_pair": [{"clearance": {"mean": 0.0121, "std": 1.5e-4}}
                                                   | {"law": SOFT}]})  # fmt: skip
    asked = {"mission": 60.0, "rel_error": 0.3, "seed": 2, "threads": 1}
    _, stated = tolerances_of(
        mean_unit(scene), "frequency=normal:3%,damping=uniform:20%,clearance=normal:0.15mm"
    )
    own, same = production(scene, **asked), production(mean_unit(scene), stated, **asked)
    assert own.probability.value == pytest.approx(same.probability.value, rel=1e-9)
    sized = size(scene, probability=0.01, **asked)
    assert sized.production is not None
    assert "upper = { mean = " in sized.stops_to_copy() and "std = 0.00015 }" in (
        sized.stops_to_copy()
    )
    # an option takes the place of what the scene states; none of it is left with limits alone
    limits, spreads = tolerances_of(scene, "clearance=uniform:1mm, frequency=5%")
    assert spreads["clearance"] == Spread(half_width=1e-3)
    assert list(spreads) == ["damping", "stiffness stops", "clearance"]
    assert limits == Tolerances(frequency=0.05)
    with pytest.raises(NotApplicable, match="leave out what differs between units in the scene"):
        size(scene, rate=0.1)
    phases = scene.replace(phases=[Phase(name="road", duration=60.0)])
    with pytest.raises(NotApplicable, match="nothing may differ between units where the scene has"):
        size(phases, probability=0.01)


def test_the_mean_over_the_stiffness_of_one_stop_is_an_integral() -> None:
    def stops(stiffness: Any) -> Scene:
        laws = {"lower_law": Elastic(stiffness=20.0), "upper_law": Elastic(stiffness=stiffness)}
        return Scene(
            structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
            impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, **laws)],
            excitations=[WhiteNoise(intensity=0.2)],
        )

    def rate(stiffness: float) -> float:
        answer = exact(stops(stiffness)).impact_pairs["stops"]
        return float(answer.collision_rate.value)  # type: ignore[union-attr]

    scene = stops({"mean": 4.0, "half_width": 3.0})
    assert list(spreads_of(scene)) == ["stiffness upper stops"]
    table = mean_over_units(scene, method="exact", nodes=7).set_index("quantity")
    found = table.loc["stops.collision_rate"]
    integral = quad(rate, 1.0, 7.0)[0] / 6.0
    assert found["mean"] == pytest.approx(integral, rel=1e-6)
    assert abs(rate(4.0) - integral) > 1e-4 * integral  # the control: the mean unit


def test_a_width_can_be_swept_with_its_unit(tmp_path: Any) -> None:
    scene = scene_from(DOCUMENT)
    table = sweep(scene, {"impact_pair.0.upper.std": [1e-4, 2e-4]}, method="linearise")
    assert table["x.displacement_std"].iloc[0] == table["x.displacement_std"].iloc[1]
    assert Viscoelastic(**SOFT).per_unit_mass(2.0).stiffness == 5e4


# ------------------------------------------------------------------------------
# Springs, dampers and restitution that are functions:
# ------------------------------------------------------------------------------


def cubic(x):
    return x + 2.0 * x**3


def steel(speed):
    return 1.0 / (1.0 + 0.1 * speed**0.25)


def scene(structure=None, law=None, **pair) -> Scene:
    pair = {"lower": -1.0, "upper": 1.0, **pair}
    return Scene(
        structure=structure or NonlinearOscillator(mass=2.0, damping=0.1, restoring_force=cubic),
        impact_pairs=[ImpactPair(**pair, law=law or Restitution(coefficient=1.0))],
        excitations=[WhiteNoise(intensity=0.2)],
    )


LINEAR = Oscillator(mass=1.0, damping=0.1, stiffness=1.0)
SCENES = {
    "spring": scene(),
    "restitution": scene(LINEAR, SpeedRestitution(coefficient=steel)),
}

# What is carried --------------------------------------------------------------------------


def test_forces_and_energies_are_carried_per_unit_mass():
    damper = NonlinearOscillator(
        mass=2.0, restoring_force=cubic, damping_force=lambda v: v * np.abs(v)
    )
    x = np.linspace(-2.0, 2.0, 9)
    model = model_of(scene(damper))
    assert (model.omega, model.damping_rate, model.intensity) == (0.0, 0.0, 0.05)
    assert model.restoring(x) == pytest.approx(cubic(x) / 2.0, rel=1e-15)
    assert model.drag(x) == pytest.approx(x * np.abs(x) / 2.0, rel=1e-15)
    assert model.potential(x) == pytest.approx((x**2 + x**4) / 4.0, rel=1e-14)
    linear = model_of(scene())
    assert linear.damping_rate == 0.05 and linear.drag is None


def test_the_potential_by_quadrature_is_the_integral_of_the_force():
    """Smooth, with a kink, and a wall that is steep but finite."""
    cases = [
        (np.sinh, lambda x: np.cosh(x) - 1.0, 1e-13),
        (lambda x: np.where(x > 0.3, 50.0 * (x - 0.3), 0.0), None, 1e-6),
        (lambda x: np.tan(x), lambda x: -np.log(np.cos(x)), 1e-12),
    ]
    x = np.array([-1.5, -0.2, 0.0, 0.4, 1.5])
    for force, energy, near in cases:
        spring = NonlinearOscillator(mass=1.0, damping=0.1, restoring_force=force)
        expected = energy(x) if energy else 25.0 * np.maximum(x - 0.3, 0.0) ** 2
        assert spring.potential_at(x) == pytest.approx(expected, rel=near, abs=1e-6 * near)


def test_a_potential_of_its_own_counts_from_zero_and_is_not_integrated():
    spring = NonlinearOscillator(
        mass=1.0, damping=0.1, restoring_force=cubic, potential=lambda x: 7.0 + x**2 / 2 + x**4 / 2
    )
    assert spring.potential_at([[0.0, 1.0]]).tolist() == [[0.0, 1.0]]


def test_restitution_by_speed_is_asked_where_it_is_needed():
    law = model_of(SCENES["restitution"]).upper.law
    assert law.restitution_at([1.0, 16.0]) == pytest.approx([1 / 1.1, 1 / 1.2])
    assert model_of(SCENES["restitution"]).upper.coefficient is None
    assert not model_of(SCENES["restitution"]).elastic
    constant = SpeedRestitution(coefficient=lambda speed: 1.0)
    assert constant.conservative and constant.restitution_at([1.0, 2.0]).tolist() == [1.0, 1.0]
    assert Restitution(coefficient=0.5).restitution_at([1.0, 2.0]).tolist() == [0.5, 0.5]
    assert law.restitution == pytest.approx(1 / 1.1)


@pytest.mark.parametrize("name", SCENES)
def test_the_document_names_functions_and_is_json(name):
    document = json.loads(json.dumps(SCENES[name].document()))
    part = {
        "spring": document["structure"].get("restoring_force"),
        "restitution": document["impact_pair"][0]["law"].get("coefficient"),
    }[name]
    assert part == {"spring": f"{__name__}.cubic", "restitution": f"{__name__}.steel"}[name]
    again = Scene(**{key: getattr(SCENES[name], key) for key in Scene.model_fields if key})
    assert again == SCENES[name]


# What is refused --------------------------------------------------------------------------


def recorded(case: Scene):
    return record_path(case, duration=1.0)


CASES = [
    *(("spring", each) for each in (average, linearise, simulate, prospect, recorded, cost)),
    ("restitution", linearise),
]


@pytest.mark.parametrize(
    ("name", "method"), CASES, ids=[f"{name}-{each.__name__}" for name, each in CASES]
)
def test_a_method_for_numbers_says_what_it_cannot_take(name, method):
    words = {"spring": "'nonlinear'", "restitution": "a function of speed at the lower stop"}[name]
    with pytest.raises(NotApplicable, match=words):
        method(SCENES[name])


def test_a_linear_screening_takes_any_stop_and_no_nonlinear_spring():
    with pytest.raises(NotApplicable, match="'nonlinear'"):
        screen(SCENES["spring"])
    scene = SCENES["restitution"]
    elastic = ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))
    other_stops = scene.model_copy(update={"impact_pairs": (elastic,)})
    assert screen(scene).displacement_std == screen(other_stops).displacement_std


def test_explain_and_check_answer_for_such_a_scene():
    told = explain(SCENES["spring"])
    assert "function" in told.methods["simulate"] and told.simulation is None
    verdict = check(SCENES["spring"])
    assert any("simulate does not apply" in reason for reason in verdict.left_out)


def nonlinear(**changes) -> NonlinearOscillator:
    return NonlinearOscillator(**{"mass": 1.0, "damping": 0.1, "restoring_force": cubic, **changes})


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: nonlinear(damping=None), "exactly one of damping and damping_force, got none"),
        (lambda: nonlinear(damping_force=cubic), "exactly one .* got damping, damping_force"),
        (lambda: nonlinear(restoring_force=3.0), "restoring_force must be a function, got 3.0"),
        (lambda: nonlinear(restoring_force=np.log), "restoring_force with finite values, got nan"),
        (lambda: nonlinear(potential=lambda x: [1.0, 2.0]), "potential that takes an array"),
        (lambda: nonlinear(damping=None, damping_force=lambda v: v if v else 0), "damping_force"),
        (lambda: nonlinear(mass=0.0), "mass must be greater than 0"),
        (lambda: SpeedRestitution(coefficient=0.5), "needs body where coefficient is one number"),
        (lambda: SpeedRestitution(coefficient=lambda w: 1.0 + w), r"in \[0, 1\], got 1"),
        (lambda: SpeedRestitution(coefficient=lambda w: w * math.nan), "finite values, got nan"),
        (
            lambda: scene(nonlinear(restoring_force=lambda x: 1 / (1 - x)), upper=1.0),
            "impact_pair.0 has a stop at 1, where structure.restoring_force is inf",
        ),
        (
            lambda: scene(nonlinear(), Elastic(stiffness=1.0), on="y"),
            "must be on 'x'",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero|invalid value")
def test_what_is_wrong_with_a_function_is_said_once_and_at_once(make, words):
    with pytest.raises(SceneError, match=words):
        make()


def test_a_scene_file_is_told_that_functions_are_for_python_only():
    structure = {"kind": "nonlinear", "mass": 1.0, "damping": 0.1, "restoring_force": "x**3"}
    with pytest.raises(SceneError, match=r"structure.kind 'nonlinear' takes a function.*Python"):
        scene_from(changed(["structure"], structure))
    law = {"kind": "speed-restitution", "coefficient": "steel"}
    with pytest.raises(SceneError, match=r"impact_pair.0.law.coefficient must be a finite number"):
        scene_from(changed(["impact_pair", 0, "law"], law))
    assert functions(model_of(scene_from(DOCUMENT_OF_KNOWN))) == []
