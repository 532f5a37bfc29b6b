"""Bars, beams, plates and modes as given: their numbers, their places, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg

from stochvi.model.model import model_of
from stochvi.results.errors import SceneError
from stochvi.scenes import (
    Bar,
    Beam,
    Elastic,
    GivenModes,
    ImpactPair,
    Matrices,
    Plate,
    Restitution,
    Scene,
    WhiteNoise,
)
from stochvi.scenes.excitations import ConstantLoad, Sine, TabulatedNoise

STRIP: dict[str, Any] = {
    "length": 0.5, "width": 0.02, "height": 0.003, "young": 2.1e11, "density": 7850.0,
    "support": "cantilever", "zeta": 0.01, "modes": 4, "points": {"tip": 1.0, "middle": 0.5},
}  # fmt: skip
ROD: dict[str, Any] = {
    "length": 2.0, "area": 1e-4, "young": 2e11, "density": 8000.0, "support": "fixed-free",
    "zeta": 0.01, "modes": 3, "points": {"tip": 1.0},
}  # fmt: skip
SHEET: dict[str, Any] = {
    "length": 0.4, "width": 0.3, "thickness": 0.002, "young": 7e10, "density": 2700.0,
    "poisson": 0.33, "zeta": 0.01, "modes": 6, "points": {"middle": [0.5, 0.5]},
}  # fmt: skip


def strip(**keys: Any) -> Beam:
    return Beam(**{k: v for k, v in (STRIP | keys).items() if v is not None})


def scene(structure: Any, *, noise_on: str = "base", **keys: Any) -> Scene:
    excitation = keys.pop("excitation", WhiteNoise(on=noise_on, intensity=0.2))
    pair = {"on": "tip", "upper": 0.002, "law": Elastic(stiffness=2e4)} | keys
    pair = {k: v for k, v in pair.items() if v is not None}
    return Scene(structure=structure, impact_pairs=[ImpactPair(**pair)], excitations=[excitation])


def test_a_cantilever_has_its_numbers_in_si_units() -> None:
    found = strip()
    mass = 7850.0 * 0.5 * 0.02 * 0.003
    bending = 2.1e11 * 0.02 * 0.003**3 / 12.0
    omega = 1.8751040687119611**2 * math.sqrt(bending / (mass * 0.5**3))
    assert found.natural_frequency_hz[0] == pytest.approx(omega / (2.0 * math.pi), rel=1e-12)
    modal_mass, damping, stiffness = (matrix[0, 0] for matrix in found.matrices)
    assert modal_mass == pytest.approx(mass / 4.0, rel=1e-12)
    assert stiffness == pytest.approx(omega**2 * mass / 4.0, rel=1e-12)
    assert damping == pytest.approx(0.02 * omega * mass / 4.0, rel=1e-12)
    assert found.moving_mass < mass
    assert strip(modes=60).moving_mass == pytest.approx(mass, rel=0.01)


def test_keys_of_a_section_are_two_ways_to_one_beam() -> None:
    by_moment = strip(width=None, height=None, area=6e-5, second_moment=0.02 * 0.003**3 / 12.0)
    assert by_moment.natural_frequency_hz == pytest.approx(strip().natural_frequency_hz, rel=1e-13)
    by_frequency = strip(modes=None, max_frequency_hz=400.0)
    assert by_frequency.natural_frequency_hz == pytest.approx(strip().natural_frequency_hz)


def test_a_slender_beam_of_timoshenko_is_one_of_euler_and_bernoulli() -> None:
    plain = strip().natural_frequency_hz
    thick = strip(theory="timoshenko", poisson=0.3).natural_frequency_hz
    assert np.all(thick < plain) and thick == pytest.approx(plain, rel=1e-3)


def test_the_receptance_of_a_bar_is_the_sum_over_its_modes() -> None:
    """B 6.63 against 15.11: tan(k) / (E A k / length), with the modes that are left out at rest."""
    rod = Bar(**ROD | {"modes": 40})
    stiffness = 2e11 * 1e-4 / 2.0
    wave = 0.9
    omega = wave * math.sqrt(2e11 / 8000.0) / 2.0
    modes = rod.modes
    summed = float(np.sum(modes.shapes["tip"] ** 2 / (modes.mass * (modes.omega**2 - omega**2))))
    exact = math.tan(wave) / (stiffness * wave)
    # without correction the left-out modes are missing, 2 / (40 pi^2) of E A / length
    assert abs(summed / exact - 1.0) > 1e-3
    assert summed + rod.compliance_left_out({"tip": 1.0}) == pytest.approx(exact, rel=1e-6)


def test_a_tip_spring_of_a_bar_is_a_stop_that_is_touched() -> None:
    """B 15.22 has the frequencies of a bar in contact."""
    rod = Bar(**ROD | {"tip_stiffness": 2.0 * 2e11 * 1e-4 / 2.0})
    waves = rod.modes.omega * 2.0 / math.sqrt(2e11 / 8000.0)
    assert waves[:2] == pytest.approx([2.28893, 5.08699], abs=5e-6)


def laplacian(nodes: int, length: float) -> Any:
    h = length / (nodes + 1)
    return scipy.sparse.diags([1.0, -2.0, 1.0], [-1, 0, 1], shape=(nodes, nodes)) / h**2


def test_the_frequencies_of_a_plate_are_those_of_finite_differences() -> None:
    sheet = Plate(**SHEET)
    found = []
    for nodes in (15, 31):
        along, across = laplacian(nodes, 0.4), laplacian(nodes, 0.3)
        one = scipy.sparse.identity(nodes)
        both = scipy.sparse.kron(along, one) + scipy.sparse.kron(one, across)
        # simply supported: the deflection and its Laplacian vanish at the edges
        values = np.sort(scipy.sparse.linalg.eigsh(-both, k=6, sigma=0.0)[0])
        found.append(values)
    bending = 7e10 * 0.002**3 / (12.0 * (1.0 - 0.33**2))
    extrapolated = found[1] + (found[1] - found[0]) / 3.0
    omega = extrapolated * math.sqrt(bending / (2700.0 * 0.002))
    assert sheet.modes.omega == pytest.approx(omega, rel=2e-3)
    assert sheet.modes.omega[0] == pytest.approx(omega[0], rel=1e-5)


def test_a_plate_takes_all_modes_up_to_a_frequency() -> None:
    keys = {k: v for k, v in SHEET.items() if k != "modes"}
    many = Plate(**SHEET | {"modes": 40}).natural_frequency_hz
    top = (many[20] + many[21]) / 2.0
    assert Plate(**keys, max_frequency_hz=top).natural_frequency_hz == pytest.approx(many[:21])


def test_the_middle_of_a_plate_has_the_compliance_of_timoshenkos_table() -> None:
    """w = 0.01160 F a^2 / D in the middle of a square plate (Timoshenko, table 23)."""
    square = Plate(**SHEET | {"length": 0.3})
    modes = square.modes
    whole = float(np.sum(modes.shapes["middle"] ** 2 / (modes.mass * modes.omega**2)))
    whole += square.compliance_left_out({"middle": 1.0})
    bending = 7e10 * 0.002**3 / (12.0 * (1.0 - 0.33**2))
    assert whole == pytest.approx(0.01160 * 0.3**2 / bending, rel=5e-4)


def test_noise_everywhere_is_the_sum_of_noises_on_many_points() -> None:
    shares = (np.arange(400) + 0.5) / 400
    points = {f"p{k}": share for k, share in enumerate(shares)} | {"tip": 1.0}
    fine = strip(points=points, tip_mass=0.02)
    spread = model_of(scene(strip(tip_mass=0.02), noise_on="everywhere")).white
    rows = np.array([fine.places[f"p{k}"] for k in range(400)])
    assert spread == pytest.approx(0.2 * 0.5 / 400 * rows.T @ rows, abs=1e-4 * spread.max())


def test_modes_of_matrices_are_the_matrices() -> None:
    """A model of two masses by its matrices and by its modes: the same gaps, the same noise."""
    mass, stiffness = np.diag([2.0, 1.0]), np.array([[300.0, -100.0], [-100.0, 100.0]])
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    damping = mass @ shapes @ np.diag(0.04 * np.sqrt(squares)) @ shapes.T @ mass
    plain = Matrices(
        coordinates=["a", "b"], mass=mass, damping=(damping + damping.T) / 2.0, stiffness=stiffness
    )
    modal = GivenModes(
        frequency_hz=np.sqrt(squares) / (2.0 * math.pi), zeta=0.02,
        shapes={"a": shapes[0], "b": shapes[1]}, participation=shapes.T @ mass @ np.ones(2),
    )  # fmt: skip
    for place in ({"on": "a"}, {"between": ("b", "a")}, {"weights": {"a": 0.5, "b": -2.0}}):
        one, other = (model_of(scene(each, **{"on": None} | place)) for each in (plain, modal))
        assert other.pairs[0].mass == pytest.approx(one.pairs[0].mass, rel=1e-12)
        signs = np.sign(np.sum(one.modal.shapes * (shapes @ other.modal.shapes), axis=0))
        assert other.modal.gaps == pytest.approx(one.modal.gaps * signs, rel=1e-12)
        assert other.modal.white == pytest.approx(one.modal.white * np.outer(signs, signs))
    assert modal.moving_mass == pytest.approx(3.0)


def test_a_force_on_a_sum_of_places_is_the_sum_of_forces() -> None:
    beam = strip()
    weights = {"tip": 1.0, "middle": -0.5}
    found = scene(beam, excitation=WhiteNoise(weights=weights, intensity=0.2))
    row = beam.places["tip"] - 0.5 * beam.places["middle"]
    assert model_of(found).white == pytest.approx(0.2 * np.outer(row, row))
    assert found.effects()[0] == "white noise on tip - 0.5 middle"
    steady = scene(beam, excitation=ConstantLoad(weights=weights, force=3.0))
    assert model_of(steady).constant_force == pytest.approx(3.0 * row)


def test_one_mode_is_an_oscillator_at_its_gap() -> None:
    one = strip(modes=1)
    model = model_of(scene(one, noise_on="middle"))
    shape = one.places["tip"][0], one.places["middle"][0]
    mass = one.matrices[0][0, 0] / shape[0] ** 2
    assert model.single and model.pairs[0].direction == pytest.approx([1.0])
    assert model.unit_mass == pytest.approx(mass) and not model.pairs[0].relative
    assert model.intensity == pytest.approx(0.2 * (shape[1] / shape[0]) ** 2 / mass**2)
    shaken = model_of(scene(one))
    participation = float(one.influence[""][0]) * shape[0]
    assert shaken.intensity == pytest.approx(0.2 * participation**2)


def test_modes_that_are_left_out_soften_an_elastic_stop() -> None:
    few, many = (model_of(scene(strip(modes=count))) for count in (2, 40))
    softer, stiffer = (model.pairs[0].stops[0].law.stiffness for model in (few, many))
    assert softer < stiffer < 2e4
    left = strip(modes=2).compliance_left_out({"tip": 1.0})
    assert 1.0 / softer == pytest.approx(1.0 / 2e4 + left, rel=1e-12)
    given = GivenModes(frequency_hz=[10.0], zeta=0.1, shapes={"tip": [1.0]}, left_out={"tip": 1e-5})
    stop = model_of(scene(given, noise_on="tip")).pairs[0].stops[0]
    assert stop.law.stiffness == pytest.approx(1.0 / (1.0 / 2e4 + 1e-5))


def test_a_rigid_stop_on_a_structure_is_warned_of() -> None:
    rigid = Restitution(coefficient=0.5)
    (sentence,) = model_of(scene(strip(), law=rigid)).structure_cautions
    assert "depend on the number of modes" in sentence and "'elastic' or 'hertz'" in sentence
    assert model_of(scene(strip(modes=1), law=rigid)).structure_cautions == ()
    assert model_of(scene(strip())).structure_cautions == ()


GIVEN: dict[str, Any] = {"frequency_hz": [10.0, 20.0], "zeta": 0.01, "shapes": {"tip": [1.0, -1.0]}}


@pytest.mark.parametrize(
    ("kind", "keys", "sentence"),
    [
        (Beam, {"modes": None}, "exactly one of modes and max_frequency_hz, got none"),
        (Beam, {"max_frequency_hz": 1e3}, "got modes, max_frequency_hz"),
        (Beam, {"modes": None, "max_frequency_hz": 3.0}, "that of the first mode, 10.03 Hz, got 3"),
        (Beam, {"modes": 201}, "modes must be at most 200, got 201"),
        (Beam, {"modes": None, "max_frequency_hz": 1e8}, "expected at most 200"),
        (Beam, {"zeta": [0.1, 0.2]}, "zeta needs one number, or one for each of 4 modes, got 2"),
        (Beam, {"Q": 10.0}, "exactly one of zeta, Q and loss_factor, got zeta, Q"),
        (Beam, {"area": 1e-4}, "needs width and height, or area"),
        (Beam, {"width": None, "height": None, "area": 1e-4}, "area and second_moment, got area"),
        (Beam, {"theory": "timoshenko"}, "needs poisson"),
        (Beam, {"poisson": 0.3}, "takes poisson with theory = 'timoshenko'"),
        (Beam, {"tip_mass": 1.0, "support": "pinned"}, "tip_mass must be 0 where the support"),
        (
            Beam,
            {"tip_inertia": 1.0, "support": "clamped"},
            "tip_inertia must be 0 where the",
        ),
        (Beam, {"points": {"tip": 1.2}}, "points.tip must be at most 1, got 1.2"),
        (Beam, {"points": {"base": 1.0}}, "got 'base'"),
        (Beam, {"points": {"a.b": 1.0}}, "got 'a.b'"),
        (Plate, {"modes": None}, "exactly one of modes and max_frequency_hz, got none"),
        (Plate, {"modes": None, "max_frequency_hz": 9.0}, "the first mode, 84.93 Hz, got 9"),
        (Plate, {"modes": 300}, "modes takes 300 modes, expected at most 200"),
        (GivenModes, {"frequency_hz": [20.0, 10.0]}, "frequency_hz must not fall"),
        (GivenModes, {"shapes": {"tip": [1.0]}}, "shapes.tip must have a number for each of 2"),
        (GivenModes, {"participation": [1.0]}, "participation must have a number for each of 2"),
        (GivenModes, {"modal_mass": [1.0] * 3}, "modal_mass must have a number for each of 2"),
        (GivenModes, {"left_out": {"top": 1.0}}, "left_out.top must be at a point of shapes"),
    ],
)
def test_keys_that_contradict_each_other_are_refused(
    kind: type, keys: dict[str, Any], sentence: str
) -> None:
    usual = {Beam: STRIP, Plate: SHEET, GivenModes: GIVEN}[kind]
    with pytest.raises(SceneError) as refused:
        kind(**{key: value for key, value in (usual | keys).items() if value is not None})
    assert sentence in str(refused.value)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"on": "middl"}, "must be on 'tip' or 'middle', got 'middl'"),
        ({"on": None}, "needs on, between or weights, with names of 'tip' or 'middle', got none"),
        ({"between": ("tip", "middle")}, "takes one of on, between and weights"),
        ({"on": None, "weights": {"tip": 1.0, "top": 1.0}}, "must be on 'tip' or 'middle', got"),
        ({"on": None, "weights": {"tip": 0.0}}, "does not move in any mode"),
    ],
)
def test_a_pair_on_no_place_is_refused(keys: dict[str, Any], sentence: str) -> None:
    with pytest.raises(SceneError) as refused:
        scene(strip(), **keys)
    assert sentence in str(refused.value)


@pytest.mark.parametrize(
    ("structure", "excitation", "sentence"),
    [
        (strip(), WhiteNoise(intensity=1.0), "needs on = 'tip' or 'middle' or 'base'"),
        (strip(), WhiteNoise(on="x", intensity=1.0), "must act on 'tip' or 'middle' or 'base'"),
        (strip(), Sine(on="everywhere", amplitude=1.0, frequency_hz=1.0), "independent from place"),
        (strip(support="free"), WhiteNoise(on="base", intensity=1.0), "does not stand"),
        (
            GivenModes(**GIVEN),
            WhiteNoise(on="base", intensity=1.0),
            "structure.participation",
        ),
        (GivenModes(**GIVEN), WhiteNoise(on="everywhere", intensity=1.0), "with a length"),
        (
            strip(),
            TabulatedNoise(on="tip", frequency_hz=[1.0, 9.0], density=[1.0, 1.0], unit="g2/Hz"),
            "takes a density in N2/Hz",
        ),
    ],
)
def test_an_excitation_of_no_place_is_refused(
    structure: Any, excitation: Any, sentence: str
) -> None:
    with pytest.raises(SceneError) as refused:
        scene(structure, excitation=excitation)
    assert sentence in str(refused.value)
