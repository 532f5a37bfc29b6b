"""Springs and dampers that are functions: forces, energies, linear forms, parts of the engine."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import stochvi.scenes
from stochvi import Isolator, Matrices, Oscillator, Scene, SceneError, WhiteNoise, load_scene
from stochvi.cli.scenes import TEMPLATE
from stochvi.engine.characteristic import kicked, moved, pull
from stochvi.scenes.characteristics import Characteristic
from stochvi.scenes.characteristics.base import DamperForce, SpringForce
from stochvi.scenes.key_units import key_unit
from stochvi.scenes.schema import scene_schema
from stochvi.scenes.structures.rigid_body import Mount, RigidBody
from stochvi.scenes.validation import PYTHON_ONLY

KEYS: dict[str, dict[str, Any]] = {
    "Duffing": {"linear_stiffness": -0.5, "cubic_stiffness": 2.0},
    "PolynomialSpring": {"coefficients": [1.0, -0.4, 0.3]},
    "SpringTable": {"deflection": [-1.0, 0.2, 0.9], "force": [-3.0, 0.1, 2.0]},
    "SpringFunction": {"force": lambda x, v: math.sinh(x) + 0.2 * v},
    "BoucWen": {"stiffness": 2.0, "yield_displacement": 0.3},
    "PolynomialDamper": {"coefficients": [0.1, 0.5]},
    "Coulomb": {"force": 0.3},
    "Rayleigh": {"linear_damping": -0.4, "cubic_damping": 0.7},
    "VanDerPol": {"damping": 0.4, "amplitude": 0.8},
    "Relay": {"force": 0.3, "reverses_above": 0.5, "reverses_below": -0.4},
}
"""Keys of one member of each class; a new class needs an entry, or its tests fail."""

WITHOUT_UNIT = ("exponent", "beta", "coefficients")


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
        error = samples.std() / math.sqrt(len(samples))
        assert abs(found - samples.mean()) <= 4.5 * error + 1e-9


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
        z = moved(part, z, amplitude * (math.sin(t + step) - math.sin(t)))
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


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
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
    ],
)  # fmt: skip
def test_faults_are_named(keys: dict[str, Any], sentence: str) -> None:
    with pytest.raises(SceneError) as error:
        scene_with(**keys)
    assert sentence in str(error.value)


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
