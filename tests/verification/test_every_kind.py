"""Every impact law and every excitation is known wherever kinds are told apart."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import numpy as np
import pytest

from stochvi.cli.scenes import TEMPLATE
from stochvi.mathematics.quadrature import gauss_panels
from stochvi.mathematics.units import power_ratio
from stochvi.methods.fokker_planck.motion import Motion
from stochvi.methods.fokker_planck.scaled_motion import scaled_motion
from stochvi.methods.linearisation.method import unmet as unmet_by_linearisation
from stochvi.methods.monte_carlo.choose_plan import unmet as unmet_by_simulation
from stochvi.model.model import Model, model_of
from stochvi.results.errors import SceneError
from stochvi.scenes import shipped_scene
from stochvi.scenes.absorbers import Absorber
from stochvi.scenes.cross_densities import CrossDensity
from stochvi.scenes.excitations import (
    EXCITATIONS,
    DensityNoise,
    Excitation,
    RecordedNoise,
    RoadNoise,
    TabulatedNoise,
    WhiteNoise,
)
from stochvi.scenes.impact_laws import CompliantLaw, Hertz, Law, Restitution
from stochvi.scenes.impact_laws.base import Form
from stochvi.scenes.key_units import key_unit
from stochvi.scenes.scene import ImpactPair, Scene, load_scene
from stochvi.scenes.structures import (
    Bar,
    Beam,
    Isolator,
    Matrices,
    Modes,
    NonlinearOscillator,
    Oscillator,
    Plate,
    Structure,
)
from stochvi.scenes.structures.rigid_body import Mount, RigidBody
from stochvi.scenes.validation import PYTHON_ONLY, Checked
from stochvi.scenes.vehicles import QuarterCar
from stochvi.verification.explain import explain

KEYS_OF_LAWS: dict[str, dict[str, Any]] = {
    "restitution": {"coefficient": 0.8},
    "speed-restitution": {"speed": [0.1, 2.0], "coefficient": [0.9, 0.6]},
    "elastic": {"stiffness": 50.0},
    "viscoelastic": {"stiffness": 50.0, "damping_ratio": 0.1},
    "hertz": {"coefficient": 80.0},
    "power": {"coefficient": 80.0, "exponent": 1.7},
    "function": {
        "force": lambda y, v: 80.0 * y**1.5,
        "energy": lambda y: 32.0 * y**2.5,
    },
    "table": {"deflection": [0.1, 0.3], "force": [3.0, 20.0]},
}
KEYS_OF_EXCITATIONS: dict[str, dict[str, Any]] = {
    "white": {"intensity": 0.2},
    "filtered": {"intensity": 0.2, "frequency_hz": 10.0, "zeta": 0.2},
    "transfer-function": {"intensity": 0.2, "numerator": [60.0], "denominator": [1.0, 60.0]},
    "state-space": {"intensity": 0.2, "A": [[-60.0]], "B": [60.0], "C": [1.0]},
    "psd": {"frequency_hz": [1.0, 100.0], "density": [0.3, 0.2], "unit": "(m/s2)2/Hz"},
    "road": {"road": "A", "speed": 10.0},
    "record": {"unit": "m/s2", "fs": 100.0},
    "sine": {"amplitude": 0.3, "frequency_hz": 10.0},
    "constant": {"acceleration": 0.3},
    "modulation": {"of": "stiffness", "amplitude": 0.3, "frequency_hz": 10.0},
    "pulses": {"rate": 5.0, "impulse": 0.2},
    "function": {
        "function": lambda z, time, uniform: 0.9 * z + uniform - 0.5,
        "rate": 20.0,
        "amplitude": 0.3,
    },
}
"""Keys of one member of each kind; a new kind needs an entry, or its tests fail."""

KEYS_WITHOUT_UNIT = {
    "restitution.coefficient", "speed-restitution.coefficient", "modulation.amplitude",
    "damping_ratio", "zeta", "phase_deg", "intensity", "numerator", "denominator", "C", "friction",
    "exponent", "loss_exponent",
}  # fmt: skip
"""Keys of numbers without a unit, of an angle, which has one unit only, and of the strength of
white noise, whose unit depends on what is shaken."""


def kind_of(cls: type) -> str:
    return cls.model_fields["kind"].default


def members(union: Any) -> list[type]:
    """The classes of a union whose members may be annotated."""
    if get_origin(union) is Annotated:
        return members(get_args(union)[0])
    return [part for each in get_args(union) for part in members(each)] or [union]


@pytest.fixture(params=members(Law), ids=kind_of)
def law(request: pytest.FixtureRequest) -> Law:
    return request.param(**KEYS_OF_LAWS[kind_of(request.param)])


@pytest.fixture(
    params=[each for each in members(Law) if issubclass(each, CompliantLaw)], ids=kind_of
)
def compliant(request: pytest.FixtureRequest) -> CompliantLaw:
    return request.param(**KEYS_OF_LAWS[kind_of(request.param)])


@pytest.fixture(params=EXCITATIONS, ids=kind_of)
def excitation(request: pytest.FixtureRequest, tmp_path: Path) -> Excitation:
    keys = dict(KEYS_OF_EXCITATIONS[kind_of(request.param)])
    if "fs" in keys:
        file = tmp_path / "record.txt"
        np.savetxt(file, np.random.default_rng(1).normal(size=4000))
        keys["file"] = str(file)
    return request.param(**keys)


def scene_of(excitation: Excitation, law: Law) -> Scene:
    return Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0),
        impact_pairs=[ImpactPair(upper=0.004, law=law)],
        excitations=[excitation],
    )


UNIT = {"mass": 1.0, "damping": 0.1, "stiffness": 1.0}
RIGID: dict[str, Any] = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}
MOUNTS: list[dict[str, Any]] = [
    {"at": [x, y, 0.0], "stiffness": [1.0] * 3, "damping": [0.1] * 3}
    for x, y in ((0.1, 0.1), (0.1, -0.1), (-0.1, 0.0))
]
BAND: dict[str, Any] = {"frequency_hz": [1.0, 9.0], "unit": "(m/s2)2/Hz"}
ROD: dict[str, Any] = {
    "length": 1.0, "young": 2e11, "density": 7850.0, "zeta": 0.01, "modes": 2
}  # fmt: skip
FORCE_AT_TIP = WhiteNoise(intensity=1.0, on="tip")
ROAD = RoadNoise(road="A", speed=10.0)


def of_unit_mass(**keys: Any) -> Scene:
    return Scene(
        **{"structure": Oscillator(**UNIT), "excitation": [WhiteNoise(intensity=1.0)]} | keys
    )


def on_axis(body: Any) -> Scene:
    return of_unit_mass(structure=body, excitation=[WhiteNoise(intensity=1.0, axis="x")])


OTHER_PARTS: dict[type[Checked], tuple[dict[str, Any], Callable[[Any], Any]]] = {
    Oscillator: (UNIT, lambda part: of_unit_mass(structure=part)),
    Isolator: (UNIT, lambda part: of_unit_mass(structure=part)),
    NonlinearOscillator: (
        {"mass": 1.0, "damping": 0.1, "restoring_force": lambda x: x},
        lambda part: of_unit_mass(structure=part),
    ),
    Matrices: (
        {"coordinates": ["x"], "mass": [[1.0]], "damping": [[0.1]], "stiffness": [[1.0]]},
        lambda part: of_unit_mass(structure=part),
    ),
    Modes: (
        {"frequency_hz": [1.0, 3.0], "zeta": [0.1], "shapes": {"tip": [1.0, -1.0]}},
        lambda part: of_unit_mass(structure=part, excitation=[FORCE_AT_TIP]),
    ),
    Bar: (
        ROD | {"area": 1e-4},
        lambda part: of_unit_mass(structure=part, excitation=[FORCE_AT_TIP]),
    ),
    Beam: (
        ROD | {"area": 1e-4, "second_moment": 1e-9},
        lambda part: of_unit_mass(structure=part, excitation=[FORCE_AT_TIP]),
    ),
    Plate: (
        ROD | {"width": 0.5, "height": 1e-3, "points": {"tip": [0.5, 0.5]}},
        lambda part: of_unit_mass(structure=part, excitation=[FORCE_AT_TIP]),
    ),
    RigidBody: (RIGID | {"mounts": MOUNTS}, on_axis),
    Mount: (MOUNTS[0], lambda part: RigidBody(**RIGID, mounts=[part, *MOUNTS[1:]])),
    ImpactPair: (
        {"upper": 1.0, "law": Restitution(coefficient=0.8)},
        lambda part: of_unit_mass(impact_pair=[part]),
    ),
    Absorber: (
        {"mass": 0.1, "play": 1.0, "law": Restitution(coefficient=0.8)},
        lambda part: of_unit_mass(absorber=part),
    ),
    QuarterCar: (
        {"preset": "golden-car"},
        lambda part: of_unit_mass(structure=Isolator(**UNIT), excitation=[ROAD], vehicle=part),
    ),
    CrossDensity: (
        {"between": ["x", "z"], "real": [0.1, 0.1], "imaginary": [0.0, 0.0]} | BAND,
        lambda part: of_unit_mass(
            structure=RigidBody(**RIGID, mounts=MOUNTS),
            excitation=[TabulatedNoise(**BAND, density=[0.3, 0.2], axis=axis) for axis in "xz"],
            cross_density=[part],
        ),
    ),
}
"""Parts of a scene but laws and excitations: keys of an example, and what takes one."""


def test_every_structure_is_among_the_parts() -> None:
    assert set(members(Structure)) <= OTHER_PARTS.keys()


def refused_subclass(part: type[Checked], keys: dict[str, Any], take: Callable[[Any], Any]) -> None:
    """Methods read numbers of a part or its functions: an overridden one would count in some."""
    take(part(**keys))
    mine = type("Mine", (part,), {"__module__": __name__})
    with pytest.raises(SceneError) as refused:
        take(mine(**keys))
    ((_, sentence),) = refused.value.problems
    assert sentence.startswith(f"must be of the class {part.__name__} itself"), sentence
    assert "got Mine; " in sentence


def test_a_subclass_of_a_law_is_refused(law: Law) -> None:
    keys = KEYS_OF_LAWS[law.kind]
    refused_subclass(type(law), keys, lambda part: ImpactPair(upper=1.0, law=part))


def test_a_subclass_of_an_excitation_is_refused(excitation: Excitation) -> None:
    keys = {name: getattr(excitation, name) for name in KEYS_OF_EXCITATIONS[excitation.kind]}
    if isinstance(excitation, RecordedNoise):
        keys["file"] = excitation.file
    mount = Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    refused_subclass(
        type(excitation), keys, lambda part: Scene(structure=mount, excitations=[part])
    )


@pytest.mark.parametrize("part", OTHER_PARTS, ids=lambda part: part.__name__)
def test_a_subclass_of_another_part_is_refused(part: type[Checked]) -> None:
    refused_subclass(part, *OTHER_PARTS[part])


def test_a_scene_has_no_subclasses() -> None:
    with pytest.raises(TypeError, match="write a function that returns a Scene"):
        type("Mine", (Scene,), {})


def test_a_law_in_other_units_is_the_same_law(law: Law) -> None:
    length, time, deflection, speed = 0.3, 1.7, 0.23, 0.9
    other = law.per_unit_mass(1.0).scaled(length, time)
    assert other.rigid == law.rigid
    if law.rigid:
        assert other.restitution_at(speed) == law.restitution_at(speed)
        return
    force = other.force_at(deflection / length, speed * time / length) * length / time**2
    assert force == pytest.approx(law.force_at(deflection, speed), rel=1e-12)
    energy = other.potential_at(deflection / length) * (length / time) ** 2
    assert energy == pytest.approx(law.potential_at(deflection), rel=1e-12)


def test_the_parts_of_a_law_belong_to_one_force(compliant: CompliantLaw) -> None:
    """Slope, potential and deflection of a force are stated one by one, and must fit together."""
    law, mass, rate = compliant, 2.0, 0.3
    y = np.array([0.04, 0.17, 0.37])
    force = law.force_at(y)
    assert law.force_at([-0.1, 0.0]).tolist() == [0.0, 0.0]
    assert law.deflection_at(force) == pytest.approx(y, rel=1e-9)
    step = 1e-6
    slope = (law.force_at(y + step) - law.force_at(y - step)) / (2.0 * step)
    assert law.slope_at(y) == pytest.approx(slope, rel=1e-6)
    edges = np.unique(np.concatenate([y, law.knots(), np.geomspace(1e-8, 0.01)]))
    for deflection, energy in zip(y, law.potential_at(y), strict=True):
        nodes, weights = gauss_panels(edges[edges <= deflection], 16)
        assert weights @ law.force_at(nodes) == pytest.approx(float(energy), rel=1e-9)
    damping = law.damping(mass)
    assert law.force_at(y, rate, mass) - force == pytest.approx(damping * rate, abs=1e-12)
    assert law.conservative == np.array_equal(law.force_at(y, rate), force)


def test_a_law_says_what_its_force_never_exceeds(compliant: CompliantLaw) -> None:
    """The default is a force without a bound: a law whose force has one must say so."""
    most = compliant.largest_force
    if math.isinf(most):
        assert np.isfinite(compliant.deflection_at(1e9 * compliant.force_at(1.0)))
    else:
        assert compliant.force_at(1e9) == pytest.approx(most, rel=1e-6)
        assert np.isfinite(compliant.deflection_at(0.9 * most))
        assert np.isinf(compliant.deflection_at(1.1 * most))


def force_of(form: Form, y: np.ndarray, rate: float) -> np.ndarray:
    """The force that a simulation takes from a form, at deflections above 0."""
    if form.name == "damped":
        ((stiffness, damping),) = form.numbers
        return np.maximum(stiffness * y + damping * rate, 0.0)
    if form.name == "hertz":
        return form.numbers[0, 0] * y**1.5
    assert form.name == "pieces"
    start, force, slope = form.numbers[np.searchsorted(form.numbers[:, 0], y, side="right") - 1].T
    return force + slope * (y - start)


def test_a_simulation_takes_the_force_of_the_law(compliant: CompliantLaw) -> None:
    y = np.array([0.04, 0.17, 0.37])
    if (form := compliant.form()) is not None:
        for rate in (-0.5, 0.0, 0.3):
            assert force_of(form, y, rate) == pytest.approx(compliant.force_at(y, rate), rel=1e-9)


def test_a_law_is_named_wherever_it_is_spoken_of(law: Law) -> None:
    scene = scene_of(EXCITATIONS[0](**KEYS_OF_EXCITATIONS["white"]), law)
    found = explain(scene)
    assert f"{law.word} stop upper{law.remark}" in found.effects
    assert "stop upper" not in found.absent and "stop lower" in found.absent
    rubbing = law.replace(friction=0.2)
    assert rubbing.phrase() == law.in_words() + ", friction 0.2" + law.unknown != law.phrase()
    written = law.kind not in PYTHON_ONLY  # a function cannot be written in a scene file
    assert (f'kind = "{law.kind}"' in TEMPLATE) == written


def test_a_simulation_follows_a_law_or_says_that_it_does_not(law: Law) -> None:
    scene = scene_of(EXCITATIONS[0](**KEYS_OF_EXCITATIONS["white"]), law)
    applies = explain(scene).methods["simulate"] == "applies"
    assert applies == (law.compiled() is not None)


class Sticky(Hertz):
    """Round bodies with a damper between them, which no simulation follows."""

    def damping(self, mass: float) -> float:
        return 0.3

    def force_at(self, deflection: Any, rate: Any = 0.0, mass: float = 1.0) -> np.ndarray:
        pushed = super().force_at(deflection) + 0.3 * np.asarray(rate)
        return np.where(np.asarray(deflection) > 0.0, np.maximum(pushed, 0.0), 0.0)

    def compiled(self) -> None:
        return None


def with_law(model: Model, law: Law) -> Model:
    """The model with the law at all of its stops."""
    pairs = [
        replace(pair, stops=tuple(replace(stop, law=law) for stop in pair.stops))
        for pair in model.pairs
    ]
    return replace(model, pairs=tuple(pairs))


def test_a_damper_that_a_method_does_not_know_is_refused_or_followed() -> None:
    scene = load_scene(shipped_scene("oscillator-lossy"))
    plain, damped = Hertz(coefficient=80.0), Sticky(coefficient=80.0)
    for law, refused in ((plain, False), (damped, True)):
        model = with_law(model_of(scene), law)
        assert bool(unmet_by_linearisation(model)) == refused
        assert bool(unmet_by_simulation(model)) == refused


def test_the_fokker_planck_equation_follows_any_damper_beside_any_spring() -> None:
    law = Sticky(coefficient=80.0)
    model = with_law(model_of(load_scene(shipped_scene("oscillator-lossy"))), law)
    box = scaled_motion(Motion(model=model))
    stop, grip = box.stops[-1], box.grips[-1]
    xi = box.place(stop) + np.array([0.01, 0.05])[:, None] * stop.side
    u = np.array([-3.0, -0.3, 0.4])
    depth, rate = stop.side * box.length * (xi - box.place(stop)), stop.side * box.speed * u
    pushed = law.force_at(depth, rate) - law.force_at(depth)
    ratio = grip.force(xi, u) / pushed
    assert ratio == pytest.approx(ratio[0, 0], rel=1e-12)
    assert np.unique(pushed / rate).size > 1  # in some of them the stop has ceased to push


def test_an_excitation_is_named_wherever_it_is_spoken_of(excitation: Excitation) -> None:
    scene = scene_of(excitation, members(Law)[0](**KEYS_OF_LAWS["restitution"]))
    found = explain(scene)
    where = "base" if excitation.shakes or excitation.kind == "constant" else "x"
    assert f"{excitation.effect_word} on {where}" in found.effects
    assert excitation.family not in found.absent
    assert excitation.facts("base", excitation.numbers())
    assert (excitation.kind in TEMPLATE) or excitation.kind in PYTHON_ONLY


def test_an_excitation_is_raised_by_a_level_unless_it_shakes_nothing(
    excitation: Excitation,
) -> None:
    raised = excitation.louder(6.0)
    assert (raised == excitation) == (not excitation.shakes)
    back = raised.louder(-6.0).model_dump()
    kept = {name: value for name, value in back.items() if isinstance(value, float)}
    assert kept == pytest.approx({name: getattr(excitation, name) for name in kept}, rel=1e-12)


@pytest.mark.parametrize(
    "excitation", [each for each in EXCITATIONS if issubclass(each, DensityNoise)],
    indirect=True, ids=kind_of,
)  # fmt: skip
def test_a_level_raises_the_density_itself(excitation: DensityNoise) -> None:
    ratio = excitation.louder(6.0).table.density / excitation.table.density
    assert ratio == pytest.approx(power_ratio(6.0), rel=1e-12)


def without_unit(part: Excitation | Law) -> list[str]:
    """The keys of numbers for which no unit is known, though they are not known to have none."""
    document = part.model_dump(exclude_none=True)
    numbers = [
        name
        for name, value in document.items()
        if isinstance(value, float) or (isinstance(value, tuple) and isinstance(value[0], float))
    ]
    return [
        name
        for name in numbers
        if not key_unit({"structure": {"kind": "isolator"}}, document, name)
        and not {name, f"{part.kind}.{name}"} & KEYS_WITHOUT_UNIT
    ]


def test_the_units_of_the_keys_of_a_law_are_known(law: Law) -> None:
    assert without_unit(law) == []


def test_the_units_of_the_keys_of_an_excitation_are_known(excitation: Excitation) -> None:
    assert without_unit(excitation) == []
