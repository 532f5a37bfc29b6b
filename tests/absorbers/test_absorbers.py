"""Impact absorbers: the exact law at R = 1, balances, what is known of the best box."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numba import njit
from scipy.integrate import solve_ivp

from stochvi import (
    Absorber,
    Estimate,
    ImpactPair,
    Isolator,
    NotApplicable,
    NotConverged,
    Oscillator,
    Restitution,
    Scene,
    SceneError,
    Sine,
    TabulatedNoise,
    Viscoelastic,
    WhiteNoise,
    absorber,
    load_scene,
    simulate,
)
from stochvi.absorbers import (
    absorber_sine,
    design,
    design_absorber,
    performance,
    residual_vibration,
    tuned_force,
)
from stochvi.absorbers.design import GRID, _best_box
from stochvi.absorbers.design import alone as alone_of_design
from stochvi.absorbers.performance import (
    PEAK_PERIODS,
    _absorbed,
    _mean_peak,
    _play_curve,
    _windows,
    linear_rms,
    without_absorber,
)
from stochvi.cli import main
from stochvi.methods.monte_carlo import record_paths
from stochvi.model.model import model_of
from stochvi.results.base import Response
from stochvi.results.deadline import Deadline
from stochvi.results.estimates import Cost
from stochvi.results.files import origin_of
from stochvi.sampling.run import Run
from stochvi.sampling.workers import pool_of
from stochvi.scenes.excitations import ConstantLoad, FilteredNoise
from stochvi.scenes.impact_laws import Hertz
from stochvi.scenes.structures import Matrices
from stochvi.testing import assert_agrees
from stochvi.verification.testing.judging import Z
from stochvi.views.absorbers import design_page
from support import judges
from support.accuracies import assert_differs, quick_cases, rel_errors
from support.bounces import Bounces
from support.known import to_toml
from support.refusals import refusals

LIGHTLY_DAMPED = Oscillator(mass=1.0, damping=0.02, stiffness=1.0)
UNIT_RMS = WhiteNoise(intensity=0.04)
"""Of which the oscillator above has an rms displacement of 1 m."""


def boxed(
    play: float, restitution: float, mass: float = 0.1, units: int = 1, **attached: float
) -> Scene:
    return Scene(
        structure=LIGHTLY_DAMPED,
        absorber=Absorber(
            mass=mass, play=play, units=units, law=Restitution(coefficient=restitution), **attached
        ),
        excitations=[UNIT_RMS],
    )


def test_the_short_form_is_the_matrices_written_out() -> None:
    law = Restitution(coefficient=0.5)
    short = boxed(2.0, 0.5, units=2, stiffness=0.4, damping=0.02)
    assert short.structure is LIGHTLY_DAMPED and not short.impact_pairs
    assert Scene(**short.document()) == short
    scene = short.expanded
    assert scene.structure == Matrices(
        coordinates=("structure", "absorber 1", "absorber 2"),
        mass=[[1.0, 0, 0], [0, 0.05, 0], [0, 0, 0.05]],
        damping=[[0.04, -0.01, -0.01], [-0.01, 0.01, 0], [-0.01, 0, 0.01]],
        stiffness=[[1.4, -0.2, -0.2], [-0.2, 0.2, 0], [-0.2, 0, 0.2]],
    )
    assert [pair.name for pair in scene.impact_pairs] == ["box 1", "box 2"]
    assert scene.impact_pairs[1].between == ("absorber 2", "structure")
    assert (scene.impact_pairs[0].lower, scene.impact_pairs[0].upper) == (-1.0, 1.0)
    assert scene.impact_pairs[0].law == law
    assert scene.excitations[0].on == "structure"
    assert Scene(**scene.document()) == scene


def two_different(restitution: float, units: int) -> Scene:
    """A free unit and some sprung ones in boxes of another size, on a structure with theta = 1."""
    law = Restitution(coefficient=restitution)
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        absorber=[
            Absorber(mass=0.06, play=2.0, law=law),
            Absorber(mass=0.08, lower=-0.4, upper=0.6, units=units, stiffness=0.2, law=law),
        ],
        excitations=[WhiteNoise(intensity=0.2)],
    )


def test_units_that_differ_are_a_list_of_absorbers() -> None:
    short = two_different(0.5, 2)
    assert Scene(**json.loads(json.dumps(short.document()))) == short
    scene = short.expanded
    assert scene.structure == Matrices(
        coordinates=("structure", "absorber 1", "absorber 2", "absorber 3"),
        mass=np.diag([1.0, 0.06, 0.04, 0.04]),
        damping=np.diag([0.1, 0.0, 0.0, 0.0]),
        stiffness=[[1.2, 0, -0.1, -0.1], [0, 0, 0, 0], [-0.1, 0, 0.1, 0], [-0.1, 0, 0, 0.1]],
    )
    assert [(pair.lower, pair.upper) for pair in scene.impact_pairs] == [
        (-1.0, 1.0), (-0.4, 0.6), (-0.4, 0.6),
    ]  # fmt: skip
    assert scene.absorber.mass_on == ("absorber 1", "absorber 2", "absorber 3")
    assert Scene(**json.loads(json.dumps(scene.document()))) == scene


@pytest.mark.verify
def test_different_units_that_lose_nothing_share_energy() -> None:
    """Every unit has m E v^2 = theta, and free ones hit at sigma_rel sqrt(2 / pi) / d."""
    response = simulate(two_different(1.0, 1), rel_error=0.03)
    assert_agrees(response.coordinates["structure"]["displacement_mean_square"], 1.0)
    for name, mass in (("absorber 1", 0.06), ("absorber 2", 0.08)):
        assert_agrees(response.coordinates[name]["velocity_mean_square"], 1.0 / mass)
    rate = math.sqrt((1.0 + 1.0 / 0.06) * 2.0 / math.pi) / 2.0
    assert_agrees(response.impact_pairs["box 1"]["collision_rate"], rate)
    # negative control: the rate of the box of the other unit
    assert_differs(response.impact_pairs["box 2"]["collision_rate"], rate)


@pytest.mark.parametrize(
    "how", [{"paths": 32}, pytest.param({"rel_error": 0.03}, marks=pytest.mark.verify)]
)
def test_different_units_that_lose_energy_keep_their_balances(how: dict[str, float]) -> None:
    response = simulate(two_different(0.5, 1), **how)  # type: ignore[arg-type]
    assert response.identities
    for residual in response.identities.values():
        assert abs(residual.value) <= Z * residual.standard_error + (residual.bias or 0.0)


def tower(absorber: Any, drive: dict[str, Any] | None = None) -> str:
    """The file of a light structure with an absorber."""
    structure = {"kind": "oscillator", "mass": 1.0, "damping": 0.02, "stiffness": 1.0}
    drives = [drive or {"kind": "white", "intensity": 0.04}]
    return to_toml({"structure": structure, "absorber": absorber, "excitation": drives})


def test_a_list_of_absorbers_in_a_file(tmp_path) -> None:
    file = tmp_path / "tower.toml"
    unit = 'law = { kind = "restitution", coefficient = 0.5 }\n'
    file.write_text(
        '[structure]\nkind = "oscillator"\nmass = 1.0\ndamping = 0.02\nstiffness = 1.0\n'
        f"[[absorber]]\nmass = 0.05\nplay = 2.0\n{unit}"
        f"[[absorber]]\nmass = 0.02\nplay = 3.0\n{unit}"
        '[[excitation]]\nkind = "white"\nintensity = 0.04\n'
    )
    assert [pair.upper for pair in load_scene(file).expanded.impact_pairs] == [1.0, 1.5]
    file.write_text(file.read_text().replace("mass = 0.02", "mass = -0.02"))
    with pytest.raises(SceneError, match=r"absorber\.1\.mass must be greater than 0"):
        load_scene(file)


test_bad_lists_of_absorbers_are_refused = refusals(
    lambda absorbers: Scene(structure=LIGHTLY_DAMPED, absorber=absorbers, excitations=[UNIT_RMS]),
    ([], "absorber needs at least one entry"),
    ([{"mass_on": "x"}], "absorber.0 in a list needs mass, play and law"),
    ([3.0], "absorber.0 must be a table of keys"),
    (
        [{"mass": 0.1, "play": 1.0, "units": 40, "law": Restitution(coefficient=0.5)}] * 2,
        "absorber takes at most 64 units, got 80",
    ),
)


def test_a_scene_file_may_use_either_form(tmp_path) -> None:
    file = tmp_path / "tower.toml"
    white, sine = {"kind": "white", "density": 0.001, "unit": "g2/Hz"}, {"kind": "sine", "on": "x"}
    document = {
        "structure": {"kind": "isolator", "mass": 2.0, "frequency_hz": 10.0, "zeta": 0.01},
        "absorber": {"mass": 0.1, "play": 0.004, "law": {"coefficient": 0.5}},
        "excitation": [white, sine | {"amplitude": 1.0, "frequency_hz": 5.0}],
    }
    file.write_text(to_toml(document))
    scene = load_scene(file)
    assert [each.on for each in scene.expanded.excitations] == ["base", "structure"]
    assert scene.absorber_coordinates == ("absorber",)
    document = scene.document()
    assert document["absorber"]["play"] == 0.004
    assert Scene(**json.loads(json.dumps(document))) == scene


@pytest.mark.parametrize(
    ("attached", "sentence"),
    [
        ({"mass": -0.1, "play": 1.0}, "absorber.mass must be greater than 0"),
        ({"mass": 0.1}, "absorber needs play, or lower and upper"),
        ({"mass": 0.1, "play": 1.0, "units": 0}, "absorber.units must be at least 1"),
        ({"mass": 0.1, "upper": 1.0}, "needs both stops where no spring holds the mass"),
        ({"mass": 0.1, "play": 1.0, "mass_on": "x"}, "takes either mass_on, or mass, play and law"),
        ({"mass": 0.1, "plya": 1.0}, "did you mean 'play'"),
    ],
)
def test_bad_absorbers_are_refused_in_a_sentence(attached, sentence: str) -> None:
    document = {
        "structure": {"kind": "oscillator", "mass": 1.0, "damping": 0.02, "stiffness": 1.0},
        "absorber": {"law": {"kind": "restitution", "coefficient": 0.5}, **attached},
        "excitation": [{"kind": "white", "intensity": 0.04}],
    }
    with pytest.raises(SceneError, match=sentence):
        Scene(**document)


def test_a_coordinate_is_named_once_in_mass_on() -> None:
    assert Absorber(mass_on=["b", "c"]).names == ("b", "c")
    with pytest.raises(SceneError, match=r"different coordinates in mass_on, got \['b', 'b'\]"):
        Absorber(mass_on=["b", "b"])


def test_an_absorber_needs_the_mass_that_it_is_compared_with() -> None:
    law = Restitution(coefficient=0.5)
    with pytest.raises(
        SceneError, match=r"structure\.mass is needed where the scene has an absorber"
    ):
        Scene(
            structure=Isolator(frequency_hz=10.0, zeta=0.01),
            absorber=Absorber(mass=0.1, play=1.0, law=law),
            excitations=[WhiteNoise(intensity=1.0)],
        )
    with pytest.raises(SceneError, match=r"absorber\.mass_on must name 'x', got 'y'"):
        Scene(structure=LIGHTLY_DAMPED, absorber=Absorber(mass_on="y"), excitations=[UNIT_RMS])


def test_without_its_absorber_the_structure_is_itself() -> None:
    alone = without_absorber(boxed(2.0, 0.5, units=3, stiffness=0.4, damping=0.02))
    assert alone.structure is LIGHTLY_DAMPED and alone.absorber is None
    displacement, velocity = linear_rms(alone)
    assert displacement["x"] == pytest.approx(1.0, rel=1e-12)
    assert velocity["x"] == pytest.approx(1.0, rel=1e-12)


def test_without_its_masses_a_matrix_loses_their_springs_and_dampers() -> None:
    alone = without_absorber(boxed(2.0, 0.5, units=3, stiffness=0.4, damping=0.02).expanded)
    assert alone.structure.coordinates == ("structure",)
    found = [float(matrix[0, 0]) for matrix in alone.structure.matrices]
    assert found == pytest.approx([1.0, 0.02, 1.0])


def test_linear_rms_of_filtered_noise_and_a_sine_by_quadrature() -> None:
    noise = FilteredNoise(intensity=0.04, frequency_hz=0.2, zeta=0.1)
    sine = Sine(amplitude=0.5, frequency_hz=0.1)
    scene = Scene(structure=LIGHTLY_DAMPED, excitations=[noise, sine])
    w = np.linspace(-60.0, 60.0, 2_000_001)
    response = 1.0 / (1.0 - w**2 + 0.02j * w)
    shape = noise.omega**2 / (noise.omega**2 - w**2 + 2j * noise.zeta * noise.omega * w)
    density = 0.04 * np.abs(response * shape) ** 2
    turn = 2.0 * math.pi * 0.1
    wave = 0.5 / abs(1.0 - turn**2 + 0.02j * turn)
    expected = np.trapezoid(density, w) / (2.0 * math.pi) + wave**2 / 2.0
    displacement, velocity = linear_rms(scene)
    assert displacement["x"] ** 2 == pytest.approx(expected, rel=1e-6)
    speed = np.trapezoid(w**2 * density, w) / (2.0 * math.pi) + (wave * turn) ** 2 / 2.0
    assert velocity["x"] ** 2 == pytest.approx(speed, rel=1e-6)


def test_levels_raise_what_shakes_and_leave_loads() -> None:
    scene = Scene(
        structure=LIGHTLY_DAMPED,
        excitations=[UNIT_RMS, Sine(amplitude=2.0, frequency_hz=1.0), ConstantLoad(force=1.0)],
    )
    noise, sine, load = scene.at_level(20.0).excitations
    assert noise.intensity == pytest.approx(4.0)
    assert sine.amplitude == pytest.approx(20.0)
    assert load.force == 1.0


@pytest.mark.slow
@rel_errors(0.15, 0.01)
def test_an_absorber_that_loses_nothing_shares_energy_and_does_not_help(rel_error: float) -> None:
    """E v1^2 = theta / m1, m2 E v2^2 = theta; the relative position is uniform in the box."""
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.2, stiffness=1.0),
        absorber=Absorber(mass=0.1, play=2.0, law=Restitution(coefficient=1.0)),
        excitations=[WhiteNoise(intensity=0.4)],
    )
    (found,) = absorber(scene, levels_db=[0.0], rel_error=rel_error).performances
    assert_agrees(found.ratio, 1.0)
    box = found.response.impact_pairs["box"]
    assert_agrees(box["collision_rate"], 1.32314185710031)
    assert_agrees(box["relative_displacement_std"], 2.0 / math.sqrt(12.0))
    assert_agrees(box["relative_velocity_std"], math.sqrt(1.0 / 1.0 + 1.0 / 0.1))
    assert_agrees(found.response.coordinates["absorber"]["velocity_mean_square"], 10.0)
    assert found.absorbed_share is not None and found.absorbed_share.value == 0.0
    # negative control: the same claim of a box that loses energy
    losing = scene.absorber.model_copy(update={"law": Restitution(coefficient=0.5)})
    scene = scene.model_copy(update={"absorber": losing})
    (lossy,) = absorber(scene, levels_db=[0.0], rel_error=rel_error).performances
    assert_differs(lossy.ratio, 1.0)


@pytest.mark.verify
def test_the_exact_row_to_two_parts_in_a_thousand() -> None:
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        absorber=Absorber(mass=0.1, play=2.0, law=Restitution(coefficient=1.0)),
        excitations=[WhiteNoise(intensity=0.2)],
    )
    response = simulate(scene, rel_error=0.002, budget=None)
    assert_agrees(response.impact_pairs["box"]["collision_rate"], 1.32314185710031)
    assert_agrees(response.coordinates["structure"]["displacement_mean_square"], 1.0)
    assert_agrees(response.coordinates["absorber"]["velocity_mean_square"], 10.0)


@rel_errors(0.06, 0.01)
def test_what_impacts_absorb_is_what_dampers_do_not(rel_error: float) -> None:
    """S / (2 m) = c E v^2 + loss, the supply of white noise being known."""
    scene = boxed(3.0, 0.5, stiffness=0.02, damping=0.004)
    (found,) = absorber(scene, levels_db=[0.0], rel_error=rel_error).performances
    share = found.absorbed_share
    assert share is not None
    loss = found.response.impact_pairs["box"]["impact_speed_square_rate"]
    reduced = 0.1 / 1.1
    supplied = 0.04 / 2.0
    scale = reduced * (1.0 - 0.5**2) / 2.0 / supplied
    expected = Estimate(
        value=scale * loss.value,
        standard_error=math.hypot(scale * loss.standard_error, share.standard_error),
        bias=scale * loss.bias + share.bias,
    )
    assert_agrees(expected, share.value)
    # a velocity that may be off moves the share by what its damper would take more
    response, off = found.response, 1e-3
    speed = response.coordinates["structure"]["velocity_std"]
    coordinates = dict(response.coordinates)
    coordinates["structure"] = {
        **coordinates["structure"], "velocity_std": replace(speed, bias=speed.bias + off),
    }  # fmt: skip
    doubtful = _absorbed(model_of(scene), replace(response, coordinates=coordinates))
    assert doubtful is not None
    taken = reduced * (1.0 - 0.5**2) / 2.0 * loss.value
    whole = taken / share.value
    moved = share.value - taken / (whole + 0.02 * ((speed.value + off) ** 2 - speed.value**2))
    assert moved > 1e-4
    # the bound is of first order in what is off
    assert doubtful.bias - share.bias == pytest.approx(moved, rel=off / speed.value)


def test_rubber_walls_take_what_white_noise_supplies() -> None:
    """S / (2 m) = c E v^2 + loss; a contact that is left free takes 1 - R^2 of its energy."""
    rubber = Viscoelastic(stiffness=1e2, damping_ratio=0.2)
    scene = Scene(
        structure=LIGHTLY_DAMPED,
        absorber=Absorber(mass=0.1, play=3.0, law=rubber),
        excitations=[UNIT_RMS],
    )
    found = simulate(scene, paths=32, seed=1)
    speeds = found.coordinates["structure"]["velocity_mean_square"]
    losses = found.impact_pairs["box"]["impact_speed_square_rate"]
    taken = (0.1 / 1.1) * (1.0 - rubber.restitution**2) / 2.0
    power = Estimate(
        value=0.02 * speeds.value + taken * losses.value,
        standard_error=math.hypot(0.02 * speeds.standard_error, taken * losses.standard_error),
        bias=0.02 * speeds.bias + taken * losses.bias,
    )
    assert_agrees(power, 0.02)
    twice = replace(power, value=power.value + 0.02 * speeds.value)
    assert_differs(twice, 0.02)


def test_what_soft_walls_absorb_is_what_dampers_do_not() -> None:
    """S / (2 m) = c E v^2 + loss: the share is that which the damper leaves. A wall with a
    twentieth of the stiffness takes much less of it than 1 - R^2 of a free mass."""
    rubber = Viscoelastic(stiffness=0.05, damping_ratio=0.3)
    scene = Scene(
        structure=LIGHTLY_DAMPED,
        absorber=Absorber(mass=0.1, play=3.0, law=rubber),
        excitations=[UNIT_RMS],
    )
    response = simulate(scene.expanded, paths=64, seed=1)
    share = _absorbed(model_of(scene), response)
    speeds = response.coordinates["structure"]["velocity_mean_square"]
    assert share is not None
    left = Estimate(
        value=share.value + 0.02 * speeds.value / 0.02, bias=share.bias + speeds.bias,
        standard_error=math.hypot(share.standard_error, speeds.standard_error),
    )  # fmt: skip
    assert_agrees(left, 1.0)
    # the negative control: a free mass with the same speeds
    losses = response.impact_pairs["box"]["impact_speed_square_rate"]
    free = (0.1 / 1.1) * (1.0 - rubber.restitution**2) / 2.0 * losses.value / 0.02
    assert_differs(replace(left, value=free + speeds.value), 1.0)


def test_peaks_of_walls_that_give_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """Contacts that are integrated agree with the formula of a free mass; the largest of a long
    time exceed the mean, and the structure gets force over mass."""
    rubber = Viscoelastic(stiffness=1e2, damping_ratio=2.0)
    scene = Scene(
        structure=LIGHTLY_DAMPED,
        absorber=Absorber(mass=0.1, play=3.0, law=rubber),
        excitations=[UNIT_RMS],
    )
    settling, records = record_paths(scene.expanded, duration=500.0, paths=4, seed=7)
    means = []
    for record in records:
        speeds = np.abs(record["impact_speed of box"][record["time"] > settling])
        met = speeds[speeds > 0.0]
        means.append(np.mean([rubber.impact(speed, 0.1 / 1.1).peak_force for speed in met]))
    free = Estimate(value=float(np.mean(means)), standard_error=float(np.std(means, ddof=1)) / 2.0)
    response = simulate(scene.expanded, paths=16, duration=200.0)
    peak = _mean_peak([response.impact_pairs["box"]])
    error = math.hypot(free.standard_error, peak.standard_error)
    sampled = Estimate(value=peak.value, standard_error=error)  # its step hardly matters here
    assert_agrees(sampled, free.value)
    elastic = math.sqrt(1e2 * 0.1 / 1.1) * float(met.mean())
    # without the damper of the wall
    assert_differs(sampled, elastic)
    # a deadline that has passed, and passes no further while the fewest paths are simulated
    monkeypatch.setattr("stochvi.results.deadline.time", SimpleNamespace(time=lambda: 0.0))
    with pool_of(None, 1) as pool:
        run = Run(pool, Deadline.after(0.0))
        largest = _windows(scene.expanded, "structure", 2.0 * math.pi, run)
    assert largest.wall_force.value > 2.0 * peak.value
    assert largest.wall_acceleration.value == pytest.approx(largest.wall_force.value / 1.0)


def test_play_follows_from_the_levels_only_where_the_motion_scales() -> None:
    def curve(law: Any, **more: Any) -> list[float]:
        box = Absorber(mass=0.1, play=3.0, law=law)
        model = model_of(Scene(structure=LIGHTLY_DAMPED, absorber=box, **more))
        level = SimpleNamespace(level_db=6.0, ratio=None, interval=lambda: (0.0, 1.0))
        return [each.play for each in _play_curve(model, [level])]

    noise = {"excitations": [UNIT_RMS]}
    half = [pytest.approx(3.0 * 10.0**-0.3)]
    assert curve(Restitution(coefficient=0.5), **noise) == half
    assert curve(Viscoelastic(stiffness=1e2, damping_ratio=0.2), **noise) == half
    assert curve(Hertz(coefficient=1e2), **noise) == []
    loaded = {"excitations": [UNIT_RMS, ConstantLoad(force=0.1)]}
    assert curve(Restitution(coefficient=0.5), **loaded) == []


def random_absorber(number: int) -> Scene:
    random = np.random.default_rng(number)
    units = int(random.integers(1, 4))
    sprung = {"stiffness": 0.1 * random.random(), "damping": 0.02 * random.random()}
    noise = (
        UNIT_RMS
        if number % 2
        else FilteredNoise(intensity=0.04, frequency_hz=0.16, zeta=float(random.uniform(0.05, 0.5)))
    )
    return Scene(
        structure=LIGHTLY_DAMPED,
        absorber=Absorber(
            mass=float(random.uniform(0.01, 0.2)), play=float(random.uniform(0.5, 6.0)),
            units=units, law=Restitution(coefficient=float(random.uniform(0.2, 1.0))),
            **(sprung if number % 3 == 0 else {}),
        ),
        excitations=[noise],
    )  # fmt: skip


def assert_balanced(number: int, **work: float) -> None:
    response = simulate(random_absorber(number), seed=number, budget=None, **work)
    assert response.identities
    for name, residual in response.identities.items():
        tolerance = Z * residual.standard_error + (residual.bias or 0.0)
        assert abs(residual.value) <= tolerance, (number, name, residual)


@quick_cases("number", range(4), keep=(0, 1))
def test_random_absorbers_keep_their_balances(number: int) -> None:
    assert_balanced(number, paths=32)


@pytest.mark.verify
@pytest.mark.parametrize("number", range(50))
def test_more_random_absorbers_keep_their_balances(number: int) -> None:
    assert_balanced(number, rel_error=0.03)


@pytest.mark.slow
@rel_errors(0.2, 0.02)
def test_a_level_acts_like_the_size_of_the_box(rel_error: float) -> None:
    """Without a length of its own the system scales: +6.02 dB is half the play."""
    twice = 20.0 * math.log10(2.0)
    (louder,) = absorber(boxed(3.0, 0.5), levels_db=[twice], rel_error=rel_error).performances
    (halved,) = absorber(boxed(1.5, 0.5), levels_db=[0.0], rel_error=rel_error, seed=1).performances
    both = Estimate(
        value=louder.ratio.value,
        standard_error=math.hypot(louder.ratio.standard_error, halved.ratio.standard_error),
        bias=louder.ratio.bias + halved.ratio.bias,
    )
    assert_agrees(both, halved.ratio.value)


def test_the_best_box_of_a_known_curve_lies_in_its_interval() -> None:
    """A parabola in log play with noise: 95 % intervals hold the truth in most of 60 cases."""
    random = np.random.default_rng(1)
    at = np.log(np.geomspace(0.75, 14.0, 16))
    inside = 0
    for seed in range(60):
        truth = random.uniform(math.log(1.7), math.log(6.0))
        errors = np.full(16, 0.004)
        ratios = 0.4 + 0.15 * (at - truth) ** 2 + errors * random.standard_normal(16)
        box = _best_box(np.array([at, ratios, errors]), 1.0, 0.0, seed)
        inside += box.play_low <= math.exp(truth) <= box.play_high
        assert box.low <= box.play <= box.high
    # of 60 at 95 % fewer than 50 happen once in some 10 000 times
    assert inside >= 50


def test_the_robust_box_is_best_in_the_worst_case_of_a_known_curve() -> None:
    at = np.log(np.geomspace(0.75, 14.0, 16))
    ratios = 0.4 + 0.2 * (at - 1.0) ** 2 - 0.05 * (at - 1.0) ** 3
    points = np.array([at, ratios, np.full(16, 1e-4)])
    box = _best_box(points, 1.0, 6.0, 0)
    shift = 6.0 / 20.0 * math.log(10.0)
    # equal on both sides: f(y + s) = f(y - s) for f = .2 y^2 - .05 y^3
    away = (0.4 - math.sqrt(0.16 - 0.3 * 0.1 * shift**2)) / 0.3
    # the optimum lies between two places of the grid
    spacing = (at[-1] - at[0]) / (GRID - 1)
    assert abs(math.log(box.play) - (1.0 + away)) < 2.0 * spacing
    assert box.play > _best_box(points, 1.0, 0.0, 0).play


@pytest.mark.verify
def test_a_design_finds_the_broad_optimum() -> None:
    rel_error = 0.04
    structure = Scene(structure=LIGHTLY_DAMPED, excitations=[UNIT_RMS])
    found = design_absorber(
        structure, mass_budget=0.1, restitutions=[0.5, 0.9], plays=[1, 1.7, 3, 5, 9],
        level_range_db=3.0, rel_error=rel_error, budget=None,
    )  # fmt: skip
    assert found.restitution == 0.5
    # the scene that it proposes, simulated with other random numbers
    (again,) = absorber(
        found.scene, levels_db=[0.0], rel_error=rel_error / 2.0, seed=7, budget=None
    ).performances
    error = math.hypot(found.best.ratio.standard_error, again.ratio.standard_error)
    both = replace(again.ratio, standard_error=error)
    assert_agrees(both, found.best.ratio.value)
    assert found.best.low < 3.3 and found.best.high > 2.5
    assert found.robust.ratio.value > found.best.ratio.value
    assert found.scene.absorber is not None
    assert list(found.to_frame()["restitution"]) == [0.5, 0.9]
    json.dumps(found.to_dict(), allow_nan=False)
    assert judges.columns_without_judge(found) == []
    page = design_page(found, origin_of(found.provenance)).html()
    assert "restitution 0.5, total play" in page
    assert page.count("data:image/svg+xml") == 1


def test_an_absorber_on_a_structure_beyond_computing_is_refused() -> None:
    fast = Oscillator(mass=1.0, frequency_hz=1e200, zeta=0.02)
    box = Absorber(mass=0.05, play=0.2, law=Restitution(coefficient=0.7))
    with pytest.raises(SceneError, match="natural frequency"):
        Scene(structure=fast, absorber=box, excitations=[UNIT_RMS])


def test_a_design_takes_off_the_absorber_that_is_there() -> None:
    scene = boxed(1.0, 0.5, stiffness=0.1, damping=0.01)
    assert alone_of_design(scene) == Scene(structure=LIGHTLY_DAMPED, excitations=[UNIT_RMS])
    bare = alone_of_design(scene.expanded)
    assert bare.structure.kind == "oscillator"
    for found, matrix in zip(bare.structure.matrices, LIGHTLY_DAMPED.matrices, strict=True):
        assert found == pytest.approx(matrix, rel=1e-14)
    assert bare.excitations == (UNIT_RMS.model_copy(update={"on": "x"}),)
    assert not bare.impact_pairs


def test_noise_does_not_make_an_absorber_harmful() -> None:
    """A box that does nothing is said to be worse in one run of some 30 000."""
    found = absorber(boxed(3.0, 0.5), levels_db=[0.0], rel_error=0.3)
    for seed in range(200):
        random = np.random.default_rng(seed)
        central = found.performances[0]
        ratio = replace(
            central.ratio, value=1.0 + central.ratio.standard_error * random.standard_normal()
        )
        drawn = replace(found, performances=[replace(central, ratio=ratio)])
        assert "worse" not in drawn.summary()
    known_to = 10.0 * central.ratio.standard_error + (central.ratio.bias or 0.0)
    ratio = replace(central.ratio, value=1.0 + known_to)
    assert (
        "makes it worse" in replace(found, performances=[replace(central, ratio=ratio)]).summary()
    )


@pytest.mark.verify
def test_soft_walls_on_an_environment_end_within_the_budget() -> None:
    """Forces on the walls are those of contacts, and the same on either side."""
    scene = Scene(
        structure=Oscillator(mass=10.0, frequency_hz=12.0, zeta=0.05),
        absorber=Absorber(mass=0.5, play=4e-3, law=Viscoelastic(stiffness=2e5, damping_ratio=0.3)),
        excitations=[TabulatedNoise(on="base", profile="mil-std-810h-truck-vertical-5hz")],
    )
    budget = 30.0
    found = absorber(scene, levels_db=[0.0], rel_error=0.2, threads=1, budget=budget).central
    assert found.response.cost.wall_time < budget
    assert found.acceleration_std is not None and found.acceleration_std_without is not None
    lower, upper = (
        found.response.impact_pairs["box"][f"contact_force_{side}"] for side in ("lower", "upper")
    )
    assert found.wall_force.value == pytest.approx(lower.value + upper.value)
    error = math.hypot(lower.standard_error, upper.standard_error)
    bias = lower.bias + upper.bias
    apart = Estimate(value=lower.value - upper.value, standard_error=error, bias=bias)
    assert_agrees(apart, 0.0)
    assert 0.1 * found.wall_force.value > Z * error + bias


@pytest.mark.parametrize("overrun", [1.0, 2.5])
def test_a_design_shares_its_budget_and_begins_nothing_after_it(
    monkeypatch: pytest.MonkeyPatch, overrun: float
) -> None:
    now, given = [0.0], []
    monkeypatch.setattr("stochvi.results.deadline.time", SimpleNamespace(time=lambda: now[0]))

    def simulated(scene: Scene, *, budget: float, **_: Any) -> Response:
        given.append((now[0], budget))
        now[0] += overrun * budget
        assert isinstance(scene.absorber, Absorber)
        play = math.log((scene.absorber.play or 3.0) / 3.0)
        deviation = Estimate(value=0.5 + 0.05 * play**2, standard_error=0.01)
        so_far = SimpleNamespace(
            coordinates={"structure": {"displacement_std": deviation}}, cost=Cost()
        )
        raise NotConverged("late", so_far)

    monkeypatch.setattr(design, "simulate", simulated)
    with pytest.raises(NotConverged, match=r"the budget of 30 s ended before .* plays") as late:
        design_absorber(
            Scene(structure=LIGHTLY_DAMPED, excitations=[UNIT_RMS]),
            mass_budget=0.1,
            restitutions=[0.5],
            budget=30.0,
        )
    assert late.value.partial.best.play > 0.0
    assert late.value.partial.warnings
    assert all(began < 30.0 for began, _ in given)
    assert all(began + budget <= 30.0 + 1e-9 for began, budget in given)
    whole = len(design.PLAYS) + len(design.CLOSER)
    assert len(given) == whole if overrun == 1.0 else len(given) < whole


def test_levels_share_a_budget_and_what_is_missing_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now, given = [0.0], []
    monkeypatch.setattr("stochvi.results.deadline.time", SimpleNamespace(time=lambda: now[0]))
    real = performance.simulate

    def simulated(scene: Scene, *, budget: float, **_: Any) -> Response:
        given.append((now[0], budget))
        now[0] += 3.0 * budget
        raise NotConverged("late", real(scene, paths=64, duration=20.0))

    monkeypatch.setattr(performance, "simulate", simulated)
    with pytest.raises(NotConverged, match=r"error at -3 dB, \+0 dB, \+3 dB was 0.05") as late:
        absorber(boxed(3.0, 0.5), levels_db=[-3.0, 0.0, 3.0], rel_error=0.05, budget=12.0)
    answer = late.value.partial
    assert given[0] == (0.0, pytest.approx(4.0))
    assert [each.level_db for each in answer.performances] == [-3.0]
    assert answer.warnings[0] == "levels that were not simulated: +0 dB, +3 dB"


def test_what_absorbers_cannot_be_asked() -> None:
    free = Scene(structure=LIGHTLY_DAMPED, excitations=[UNIT_RMS])
    with pytest.raises(NotApplicable, match=r"the scene must have an \[absorber\]"):
        absorber(free)
    chain = Matrices(
        coordinates=["a", "b"], mass=np.eye(2), damping=0.1 * np.eye(2), stiffness=np.eye(2)
    )
    two = Scene(structure=chain, excitations=[WhiteNoise(on="a", intensity=1.0)])
    with pytest.raises(NotApplicable, match="must be one oscillator or isolator"):
        design_absorber(two, mass_budget=0.1)
    with pytest.raises(ValueError, match="level_range_db must be at least 0 and below"):
        design_absorber(free, mass_budget=0.1, plays=[1, 2, 3, 4], level_range_db=10.0)
    with pytest.raises(ValueError, match="plays must be at least 4 different"):
        design_absorber(free, mass_budget=0.1, plays=[2, 2, 2, 2])
    with pytest.raises(ValueError, match="levels_db must be at least one finite number"):
        absorber(boxed(1.0, 0.5), levels_db=[math.nan])
    with pytest.raises(ValueError, match="mass_budget must be a positive mass"):
        design_absorber(free, mass_budget=-1.0)


@pytest.mark.slow
def test_the_command_tells_the_verdict_first(tmp_path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(tower({"mass": 0.1, "play": 3.0, "law": {"coefficient": 0.5}}))
    runner = CliRunner()
    common = ["--rel-error", "0.1", "--levels", "0,3"]
    asked = ["absorber", str(file), *common, "--json", "-", "--out", str(tmp_path)]
    result = runner.invoke(main, asked)
    assert result.exit_code == 0, result.output
    assert "a mass of 10 % of the structure: rms displacement 0.4" in result.output
    assert (tmp_path / "absorber.png").stat().st_size > 0
    page = (tmp_path / "report.html").read_text("utf-8")
    plain = page.replace("\u00a0", " ")
    assert plain.index("A mass of 10 % of the structure") < plain.index("Motion of the structure")
    assert "Balance of energy" in page and "http" not in page.replace("http://www.w3.org", "")
    document = json.loads(result.stdout)
    assert document["method"] == "absorber" and len(document["levels"]) == 2
    half, own = document["play_curve"]
    assert own["play"] == 3.0 and own["ratio"] == document["levels"][0]["ratio"]
    assert half["play_factor"] == pytest.approx(10.0 ** (-3.0 / 20.0))
    assert half["play"] == pytest.approx(3.0 * half["play_factor"])
    assert half["low"] < half["ratio"]["value"] < half["high"]
    assert document["tuned_damper"]["mass"] == 0.1
    assert 0.0 < document["tuned_damper"]["ratio"] < own["ratio"]["value"]
    assert document["levels"][0]["wall_force_peak"] is None
    assert "Tuned damper of the same mass" in page
    result = runner.invoke(main, ["absorber", str(file), "--levels", "a"])
    assert result.exit_code == 2 and "--levels must be numbers" in result.output


@pytest.mark.slow
def test_what_a_box_does_is_what_a_plain_integration_does() -> None:
    """A rubber box, by small steps of the equations of motion of both masses in white noise."""
    stiffness, ratio, mass, play = 20.0, 0.3, 0.1, 3.0
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        absorber=Absorber(
            mass=mass, play=play, law=Viscoelastic(stiffness=stiffness, damping_ratio=ratio)
        ),
        excitations=[WhiteNoise(intensity=0.2)],
    )
    asked = {"levels_db": [0.0], "rel_error": 0.02, "seed": 1, "budget": 600.0}
    found = absorber(scene, **asked).performances[0]
    reduced = mass / (1.0 + mass)
    damper = 2.0 * ratio * math.sqrt(stiffness * reduced)
    own_period = 2.0 * math.pi * found.displacement_std.value / found.velocity_std.value
    threshold = found.response.impact_pairs["box"].speed_threshold
    # windows are as long as PEAK_PERIODS periods of the structure without its box
    steps, windows, h = int(PEAK_PERIODS * 2.0 * math.pi / 2e-3), 96, 2e-3
    box = _plain_box(
        np.random.default_rng(3), windows, steps, h, mass, 0.5 * play, stiffness, damper, threshold
    )
    free = _plain_box(
        np.random.default_rng(4), windows, steps, h, mass, 1e9, stiffness, damper, threshold
    )

    def agrees(estimate: Estimate, samples: np.ndarray, wrong: float) -> None:
        mean, own = float(samples.mean()), float(samples.std(ddof=1)) / math.sqrt(len(samples))
        # the step leaves either side some per mille, the windows of a path hang together
        whole = replace(
            estimate, standard_error=math.hypot(estimate.standard_error, 1.5 * own),
            bias=(estimate.bias or 0.0) + 0.01 * mean,
        )  # fmt: skip
        assert_agrees(whole, mean)
        assert_differs(whole, wrong * mean)

    time = steps * h
    peak, square, speeds, counts, impulse, pushed, highest, contacts, fast = box.T
    agrees(found.displacement_std, np.sqrt(square), 1.5)
    agrees(found.velocity_std, np.sqrt(speeds), 1.5)
    agrees(found.peak_factor, peak / np.sqrt(square.mean()), 1.3)
    agrees(found.impacts_per_period, counts / time * own_period, 1.5)
    agrees(found.wall_force, pushed / time, 1.5)
    assert found.impulse is not None and found.wall_force_largest is not None
    assert found.wall_force_peak is not None and found.wall_acceleration_largest is not None
    agrees(found.peak_factor_without, free[:, 0], 1.3)
    assert found.displacement_std_without == pytest.approx(1.0, rel=1e-9)
    agrees(found.wall_force_largest, highest, 1.3)
    agrees(found.wall_acceleration_largest, highest, 1.3)
    agrees(found.wall_force_peak, contacts, 1.3)
    each = impulse.sum() / fast.sum()
    agrees(found.impulse, each + (impulse - each * fast) / fast.mean(), 1.3)


@njit
def _plain_box(random, windows, steps, h, mass, half, k, c, threshold):  # type: ignore[no-untyped-def]
    """Of each window: largest |x|, mean squares of x and v, fast impacts, the impulse of their
    contacts, integral of |force|, largest force, mean of the peaks of contacts, fast contacts."""
    x = v = y = u = 0.0
    kick = np.sqrt(0.2 * h)
    rows = np.zeros((windows, 9))
    peak = began = 0.0
    total = 0.0
    for n in range(-10, windows):
        heights, held = 0.0, 0
        for _ in range(steps if n >= 0 else 5000):
            gap, rate = y - x, u - v
            side = 1.0 if gap > 0.0 else -1.0
            depth = abs(gap) - half
            force = side * max(k * depth + c * side * rate, 0.0) if depth > 0.0 else 0.0
            v += h * (-x - 0.1 * v + force) + kick * random.standard_normal()
            u -= h * force / mass
            x += h * v
            y += h * u
            after = abs(y - x) - half
            row = rows[max(n, 0)]
            if depth <= 0.0 < after:
                began, peak, total = abs(u - v), 0.0, 0.0
            peak, total = max(peak, abs(force)), total + h * abs(force)
            if n < 0:
                continue
            if after <= 0.0 < depth:
                heights += peak
                held += 1
                if began > threshold:
                    row[3] += 1.0
                    row[4] += total
                    row[8] += 1.0
            row[0] = max(row[0], abs(x))
            row[1] += x * x / steps
            row[2] += v * v / steps
            row[5] += h * abs(force)
            row[6] = max(row[6], abs(force))
        if n >= 0:
            rows[n, 7] = heights / max(held, 1)
    return rows


# ------------------------------------------------------------------------------
# An absorber under a sine against motion from impact to impact, formulas, and its command.
# ------------------------------------------------------------------------------


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
    sine = {"kind": "sine", "amplitude": 0.05, "frequency_hz": 0.159155}
    file.write_text(tower({"mass": 0.05, "play": 2.0, "law": {"coefficient": 0.8}}, sine))
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
