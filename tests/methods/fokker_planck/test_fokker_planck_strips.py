"""Strips of velocity cells: six digits, any force and stop, the density, and what it must obey."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import quad

from stochvi import (
    Elastic,
    Estimate,
    ForceTable,
    ImpactPair,
    NotApplicable,
    NotConverged,
    Response,
    Restitution,
    Scene,
    SpeedRestitution,
    Viscoelastic,
    WhiteNoise,
    exact,
    fokker_planck,
    simulate,
)
from stochvi.cli import main
from stochvi.mathematics.impact_rates import corner_exponent
from stochvi.methods.closed_form import exact_density
from stochvi.methods.fokker_planck import StationaryDensity, density, fokker_planck_density, strips
from stochvi.methods.fokker_planck.basis import VelocityCells, returned_flux, transmitted_flux
from stochvi.methods.fokker_planck.density import _field
from stochvi.methods.fokker_planck.motion import Motion, ScaledMotion, scaled_motion
from stochvi.methods.fokker_planck.strips import STRIPS, Strip, first_patches, graded
from stochvi.model.model import model_of
from stochvi.scenes import Hertz, NonlinearOscillator
from stochvi.scenes.impact_laws import Law
from stochvi.testing import assert_agrees
from support.accuracies import assert_differs, quick_cases
from support.known import (
    BENCH,
    NATURAL,
    RIGID_STOPS,
    RigidStops,
    changed,
    oscillator,
    to_toml,
    values,
)
from support.refusals import refusals

LOSSY_ROWS = [row for row in RIGID_STOPS if row.restitution < 1.0]


def stopped(
    lower: float | None, upper: float | None, law: Law, *, load: float = 0.0, damping: float = 0.1
) -> Scene:
    """omega = 1, theta = 1, the same law on both sides."""
    plain = oscillator(None, None, load=load, damping=damping, intensity=2.0 * damping)
    return Scene(
        structure=plain.structure,
        impact_pairs=[ImpactPair(lower=lower, upper=upper, law=law)],
        excitations=plain.excitations,
    )


def nonlinear(restoring_force: Callable[..., Any], law: Law | None = None, **damper: Any) -> Scene:
    stops = [] if law is None else [ImpactPair(lower=-1.0, upper=1.0, law=law)]
    return Scene(
        structure=NonlinearOscillator(mass=2.0, restoring_force=restoring_force, **damper),
        impact_pairs=stops,
        excitations=[WhiteNoise(intensity=0.8)],
    )


def agrees(found: Estimate, known: Estimate) -> None:
    """Both within their biases."""
    assert found.bias is not None and known.bias is not None
    assert_agrees(replace(found, bias=found.bias + known.bias), known.value)


# Known answers ------------------------------------------------------------------------------


def assert_six_digits(row: RigidStops) -> None:
    response = fokker_planck(oscillator(-1.0, 1.0, row.restitution), rtol=1e-6)
    for (_, name), estimate in response.estimates().items():
        if name in row.values and name != "collision_rate":
            assert estimate.bias is not None and estimate.bias < 1e-6 * estimate.value
            allowed = replace(estimate, bias=estimate.bias + row.errors[name])
            assert_agrees(allowed, row.values[name])


@pytest.mark.parametrize("row", LOSSY_ROWS, ids=lambda row: f"R={row.restitution}")
def test_six_digits_of_the_near_exact_table(row: RigidStops) -> None:
    assert_six_digits(row)


def test_a_restitution_off_by_a_millionth_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(cells: VelocityCells, leaving: Callable[..., Any], side: int) -> Any:
        return returned_flux(cells, lambda w: leaving(w) * (1.0 - 1e-6 * (side > 0)), side)

    monkeypatch.setattr(strips, "returned_flux", wrong)
    with pytest.raises(AssertionError, match="differs from"):
        assert_six_digits(LOSSY_ROWS[-1])


def random_elastic(count: int, seed: int) -> list[Scene]:
    """Damping ratios .005 to .6, gaps and preloads, loads, every law that loses nothing."""
    rng = np.random.default_rng(seed)
    found = []
    for kind in range(count):
        damping = 2.0 * math.exp(rng.uniform(math.log(0.005), math.log(0.6)))
        lower, upper = np.exp(rng.uniform(math.log(0.2), math.log(3.5), 2)) * [-1.0, 1.0]
        preload = float(rng.uniform(-1.8, 1.8))
        ends = [
            (float(lower), float(upper)), (-float(upper), float(upper)), (None, float(upper)),
            (None, preload), (preload, None), (preload, preload + float(upper)),
        ][kind % 6]  # fmt: skip
        laws: list[Law] = [
            Restitution(coefficient=1.0),
            Elastic(stiffness=10.0 ** rng.uniform(1.0, 4.0)),
            Hertz(coefficient=10.0 ** rng.uniform(1.0, 5.0)),
            ForceTable(deflection=[0.05, 0.2], force=[1.0, 30.0]),
        ]
        load = float(rng.normal()) if kind % 2 else 0.0
        found.append(stopped(*ends, laws[kind % 4], load=load, damping=damping))
    return found


def assert_as_the_closed_form(scene: Scene, rtol: float) -> None:
    known = exact(scene).estimates()
    found = fokker_planck(scene, rtol=rtol).estimates()
    missing = {("x", "acceleration_std"), ("stops", "peak_force")}
    assert found.keys() >= known.keys() - missing
    for key, estimate in found.items():
        assert_agrees(estimate, known[key].value)


@quick_cases("scene", random_elastic(6, seed=3), ids=range(6), keep=(0, 3, 4))
def test_the_true_error_is_within_the_bound(scene: Scene) -> None:
    assert_as_the_closed_form(scene, rtol=1e-4)


@pytest.mark.verify
@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
def test_the_true_error_of_fifty_scenes_is_within_the_bound(rtol: float) -> None:
    for scene in random_elastic(50, seed=4):
        assert_as_the_closed_form(scene, rtol)


def duffing(x: Any) -> Any:
    return 2.0 * x + 4.0 * x**3


def two_wells(x: Any) -> Any:
    return 6.0 * (x**3 - x)


@pytest.mark.parametrize("force", [duffing, two_wells])
@pytest.mark.parametrize("law", [None, Restitution(coefficient=1.0)], ids=["free", "stops"])
def test_a_nonlinear_spring_leaves_the_gibbs_law(
    force: Callable[..., Any], law: Law | None
) -> None:
    """p(x) ~ exp(-U / theta) by adaptive quadrature; mass 2, theta = S0 m^-2 / (2 b) = 1."""
    scene = nonlinear(force, law, damping=0.2)
    found = fokker_planck(scene, rtol=1e-6)
    ends = (-6.0, 6.0) if law is None else (-1.0, 1.0)

    def weight(x: float) -> float:
        return math.exp(-quad(force, 0.0, x)[0] / 2.0)

    mass = quad(weight, *ends, epsrel=1e-10)[0]
    square = quad(lambda x: x * x * weight(x), *ends, epsrel=1e-10)[0] / mass
    coordinate = found.coordinates["x"]
    assert isinstance(coordinate["displacement_std"], Estimate)
    assert isinstance(coordinate["velocity_std"], Estimate)
    assert_agrees(coordinate["displacement_std"], math.sqrt(square))
    assert_agrees(coordinate["velocity_std"], 1.0)


def test_a_nonlinear_damper_in_a_box_without_spring() -> None:
    """Between elastic walls x is uniform and p(v) ~ exp(-int damping dv / (S0 / 2)), exactly."""
    scene = nonlinear(
        lambda x: 0.0 * x,
        Restitution(coefficient=1.0),
        damping_force=lambda v: 0.1 * v + 0.3 * v * np.abs(v),
    )
    found = fokker_planck_density(scene, rtol=1e-6)
    v = np.linspace(-4.0, 4.0, 17)

    def law(v: float) -> float:
        # per unit mass, S0 = 0.8 / 2^2
        return math.exp(-(0.05 * v * v / 2.0 + 0.15 * abs(v) ** 3 / 3.0) / 0.1)

    mass = quad(law, -12.0, 12.0, epsrel=1e-12, points=[0.0])[0]
    expected = [law(float(each)) / mass for each in v]
    # errors of the density are relative to where it is large
    assert found.velocity_density(v) == pytest.approx(expected, rel=1e-6, abs=1e-6 * max(expected))
    assert found.displacement_density([-0.9, 0.0, 0.7]) == pytest.approx([0.5] * 3, rel=1e-6)


# Stops that no closed form covers ---------------------------------------------------------------


def steel(w: Any) -> Any:
    return 1.0 / (1.0 + 0.4 * np.sqrt(w))


def test_a_restitution_that_is_a_constant_function_is_that_number() -> None:
    function = SpeedRestitution(coefficient=lambda w: 0.6 + 0.0 * w)
    one, two = (
        fokker_planck(stopped(-0.7, 1.2, law), rtol=1e-5, speed_threshold=0.05).estimates()
        for law in (Restitution(coefficient=0.6), function)
    )
    assert one.keys() == two.keys()
    for key, estimate in two.items():
        agrees(estimate, one[key])


def test_a_restitution_by_speed_keeps_energy_and_momentum() -> None:
    """S0 / 2 = b E v^2 + sum over impacts of (1 - R(w)^2) w^2 / 2, and the virial with 1 + R(w):
    R is taken from its definition here, not from the matrices of the walls."""
    found = fokker_planck_density(
        stopped(-1.0, 1.0, SpeedRestitution(coefficient=steel)), rtol=1e-7
    )
    edges = np.concatenate([np.geomspace(1e-9, 0.1, 30), np.linspace(0.2, 6.5, 40)])
    nodes, weights = np.polynomial.legendre.leggauss(12)
    half = np.diff(edges)[:, None] / 2.0
    w = (half * nodes + (edges[1:] + edges[:-1])[:, None] / 2.0).ravel()
    flux = 2.0 * found.impact_flux("upper", w) * (half * weights).ravel()
    moments = values(found.response)
    energy = 0.1 * moments["velocity_mean_square"] + flux @ ((1.0 - steel(w) ** 2) * w**2) / 2.0
    assert energy == pytest.approx(0.1, rel=1e-7)
    virial = moments["displacement_mean_square"] + flux @ ((1.0 + steel(w)) * w)
    assert virial == pytest.approx(moments["velocity_mean_square"], rel=1e-6)


def uneven() -> Scene:
    """A stiffening spring, a damper of the second power, and restitution by speed; no symmetry."""
    scene = nonlinear(
        duffing,
        SpeedRestitution(coefficient=steel),
        damping_force=lambda v: 0.1 * v + 0.2 * v * np.abs(v),
    )
    pair = scene.impact_pairs[0].model_copy(update={"lower": -0.6})
    return scene.model_copy(update={"impact_pairs": (pair,)})


def test_scenes_of_functions_tell_their_balances(monkeypatch: pytest.MonkeyPatch) -> None:
    found = fokker_planck(uneven(), rtol=1e-4).identities
    assert found.keys() == {"energy", "virial", "force"}
    for residual in found.values():
        assert_agrees(residual, 0.0)
    monkeypatch.setattr(
        strips,
        "returned_flux",
        lambda cells, leaving, side: returned_flux(cells, lambda w: 0.9 * w, side),
    )
    wrong = fokker_planck(uneven(), rtol=1e-4).identities["energy"]
    assert_differs(wrong, 0.0)


@pytest.mark.parametrize("leaving", [lambda w: 0.0 * w, lambda w: 0.35 * w, lambda w: steel(w) * w])
def test_what_a_stop_gives_back_against_adaptive_quadrature(leaving: Callable[..., Any]) -> None:
    cells = VelocityCells((-5.0, -1.0, -0.2, 0.0, 0.3, 1.4, 5.0), 3)
    found = returned_flux(cells, leaving, 1)

    def integrand(w: float, row: int, column: int) -> float:
        out = float(leaving(np.array([w]))[0])
        came = cells.values([w])[0, cells.plus[column]]
        return float(w * math.exp(-w * w / 2.0) * came * cells.values([-out])[0, cells.minus[row]])

    # leaving(w) passes 0.2 and 1: 0.2 / 0.35, 1 / 0.35; steel by its own equation
    kinks = [0.3, 1.4, 0.2 / 0.35, 1.0 / 0.35, 0.2716087, 2.0480213]
    for row, column in ((0, 0), (1, 1), (2, 2), (5, 4), (4, 7)):
        expected = quad(integrand, 0.0, 5.0, args=(row, column), points=kinks, limit=200)[0]
        assert found[row, column] == pytest.approx(expected, abs=2e-8)


def test_flux_between_different_cells_against_adaptive_quadrature() -> None:
    coarse, fine = VelocityCells((-4.0, 0.0, 1.5, 4.0), 3), VelocityCells((-4.0, 0.0, 0.4, 4.0), 4)
    found = transmitted_flux(coarse, fine, 1)

    def integrand(u: float, row: int, column: int) -> float:
        weight = u * math.exp(-u * u / 2.0)
        test = coarse.values([u])[0, coarse.plus[row]]
        return float(weight * test * fine.values([u])[0, fine.plus[column]])

    for row, column in ((0, 0), (1, 1), (2, 4), (4, 7)):
        expected = quad(integrand, 0.0, 4.0, args=(row, column), points=[0.4, 1.5])[0]
        assert found[row, column] == pytest.approx(expected, abs=1e-9)


SOFT = stopped(-1.0, 1.0, Viscoelastic(stiffness=100.0, damping_ratio=0.2))
THRESHOLD = 0.04


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.1, 0.02, 0.006])
@pytest.mark.parametrize(
    ("law", "load"),
    [
        (Viscoelastic(stiffness=100.0, damping_ratio=0.2), 0.5),
        (Viscoelastic(stiffness=20.0, damping_ratio=0.1), 2.0),
        (Restitution(coefficient=0.5), 0.0),
    ],
    ids=lambda each: getattr(each, "kind", each),
)
def test_loads_on_compliant_stops_and_light_damping_take_seconds(
    law: Law, load: float, damping: float
) -> None:
    """They took 79 s, and 12 to 23 s."""
    scene = stopped(-1.0, 1.0, law, load=load, damping=damping)
    began = time.process_time()
    found = fokker_planck(scene, rtol=1e-4)
    assert time.process_time() - began < 6.0
    for name in ("displacement_std", "velocity_std"):
        estimate = found.coordinates["x"][name]
        assert 0.0 < estimate.bias <= 1e-4 * estimate.value


@pytest.fixture(scope="module")
def soft() -> Response:
    return fokker_planck(SOFT, rtol=1e-4, speed_threshold=THRESHOLD)


def test_simulation_agrees_on_viscoelastic_stops(soft: Response) -> None:
    simulated = simulate(SOFT, rel_error=0.01, seed=4, threads=1, speed_threshold=THRESHOLD)
    solved = soft.estimates()
    shared = simulated.estimates().keys() & solved.keys()
    assert ("stops", "contact_probability") in shared and ("stops", "contact_force_upper") in shared
    for key in shared:
        if simulated.estimates()[key].bias is not None:
            agrees(simulated.estimates()[key], solved[key])


def test_a_damper_left_out_of_the_contact_is_caught(
    soft: Response, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = soft.coordinates["x"]["velocity_std"]
    monkeypatch.setattr(ScaledMotion, "grips", ())
    wrong = fokker_planck(SOFT, rtol=1e-2).coordinates["x"]["velocity_std"]
    assert isinstance(right, Estimate) and isinstance(wrong, Estimate)
    with pytest.raises(AssertionError, match="differs from"):
        agrees(wrong, right)


def test_energy_goes_where_it_should_in_a_viscoelastic_stop(soft: Response) -> None:
    assert soft.identities.keys() == {"energy", "force"}
    for residual in soft.identities.values():
        assert_agrees(replace(residual, bias=(residual.bias or 0.0) + 1e-9), 0.0)


def test_a_stiff_viscoelastic_stop_nears_its_restitution() -> None:
    """The stiffer, the nearer: the time in contact goes as K^(-1/2), and so does the difference."""
    law = Viscoelastic(stiffness=1.0, damping_ratio=0.2)
    rigid = values(fokker_planck(oscillator(-1.0, 1.0, law.restitution), rtol=1e-5))
    apart = []
    for stiffness in (1e3, 4e3):
        stiff = stopped(-1.0, 1.0, law.model_copy(update={"stiffness": stiffness}))
        found = values(fokker_planck(stiff, rtol=1e-3))
        apart.append(found["velocity_mean_square"] - rigid["velocity_mean_square"])
    assert apart[0] / apart[1] == pytest.approx(2.0, rel=0.2)


# Symmetries and units -------------------------------------------------------------------------


def test_a_halved_scene_is_the_whole_one() -> None:
    half, whole = (
        fokker_planck(oscillator(-1.0, upper, 0.7), rtol=1e-6) for upper in (1.0, 1.0 + 1e-9)
    )
    for key, estimate in half.estimates().items():
        agrees(replace(estimate, bias=(estimate.bias or 0.0) + 1e-8), whole.estimates()[key])


def test_a_mirrored_scene_has_the_mirrored_density() -> None:
    one = fokker_planck_density(oscillator(-0.6, 1.1, 0.4, load=0.2))
    two = fokker_planck_density(oscillator(-1.1, 0.6, 0.4, load=-0.2))
    x, v = np.linspace(-0.6, 1.1, 7)[:, None], np.linspace(-2.0, 2.0, 6)
    assert one.density(x, v) == pytest.approx(two.density(-x, -v), rel=1e-8)
    assert one.rate_above("upper", 0.3) == pytest.approx(float(two.rate_above("lower", 0.3)))


def test_units_change_no_digit() -> None:
    answers = []
    for units in (NATURAL, BENCH):
        scene = oscillator(-0.7, 1.2, 0.6, load=0.2, units=units)
        response = fokker_planck(scene, rtol=1e-6)
        answers.append({name: x / units.factor(name) for name, x in values(response).items()})
    assert answers[0] == pytest.approx(answers[1], rel=1e-8)


# Hard scenes ----------------------------------------------------------------------------------


@quick_cases(
    "scene",
    [
        oscillator(-3.0, 3.0, 0.5, damping=0.01, intensity=0.02),
        oscillator(None, -0.8, 0.05),
        oscillator(-1.0, 1.0, 0.0),
    ],
    ids=["rare", "leaning", "plastic"],
    keep=(2,),
)
def test_hard_scenes_converge_to_what_finer_meshes_say(scene: Scene) -> None:
    rough, fine = (fokker_planck(scene, rtol=rtol) for rtol in (1e-2, 1e-4))
    for key, estimate in rough.estimates().items():
        agrees(estimate, fine.estimates()[key])


def test_below_the_critical_restitution_the_limit_is_told() -> None:
    response = fokker_planck(oscillator(-1.0, 1.0, 0.1))
    assert sum("not above exp(-pi / sqrt 3)" in warning for warning in response.warnings) == 2
    assert not fokker_planck(oscillator(-1.0, 1.0, 0.2)).warnings


def test_what_cannot_be_reached_is_refused_with_what_was(
    soft: Response, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(density, "MOST_UNKNOWNS", 5_000)
    with pytest.raises(NotConverged) as refused:
        fokker_planck(SOFT, rtol=1e-7, speed_threshold=THRESHOLD)
    assert refused.value.partial is not None
    for key, estimate in refused.value.partial.estimates().items():
        agrees(estimate, soft.estimates()[key])


def test_equations_without_a_finite_solution_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(*arguments: Any) -> Any:
        found = strips.solve_strips(*arguments)
        return found._replace(q=(found.q[0] * math.nan, *found.q[1:]))

    monkeypatch.setattr(density, "solve_strips", lost)
    with pytest.raises(NotConverged, match="too far apart"):
        fokker_planck(SOFT)


def test_the_command_line_takes_what_gives_way_and_six_digits(tmp_path: Path) -> None:
    scene = tmp_path / "soft.toml"
    pair = {"upper": 1.0, "law": {"kind": "elastic", "stiffness": 100.0}}
    scene.write_text(to_toml(changed(["impact_pair"], [pair])))
    arguments = ["fokker-planck", str(scene), "--rtol", "1e-6", "--json", "-", "--quiet"]
    document = json.loads(CliRunner().invoke(main, arguments).stdout)
    share = document["impact_pairs"]["stops"]["contact_probability"]
    assert share["value"] == pytest.approx(0.032121450803, rel=1e-6)
    assert 0.0 < share["bias"] < 1e-6


test_a_nonlinear_scene_without_a_state_is_refused = refusals(
    fokker_planck,
    (nonlinear(lambda x: 0.0 * x, damping=0.1), "must hold the mass"),
    (nonlinear(duffing, damping_force=lambda v: 0.0 * v), "take up the power"),
    (nonlinear(duffing, damping=0.0), "damping must be positive"),
    error=NotApplicable,
)


# The density ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def lossy() -> StationaryDensity:
    return fokker_planck_density(oscillator(-0.6, 1.1, 0.5, load=-0.2), rtol=1e-7)


def test_the_density_between_elastic_stops_is_that_of_the_closed_form() -> None:
    scene = oscillator(-0.5, 1.0)
    found, known = fokker_planck_density(scene, rtol=1e-6), exact_density(scene)
    x, v = np.linspace(-0.7, 1.2, 11), np.linspace(-4.0, 4.0, 9)
    for name in ("displacement_density", "tail"):
        assert getattr(found, name)(x) == pytest.approx(getattr(known, name)(x), rel=1e-7)
    assert found.density(x[:, None], v) == pytest.approx(known.density(x[:, None], v), rel=1e-6)
    assert found.velocity_density(v) == pytest.approx(known.velocity_density(v), rel=1e-6)
    w = np.array([0.1, 1.0, 3.0])
    for side in ("lower", "upper"):
        for name in ("impact_speed_density", "rate_above"):
            expected = getattr(known, name)(side, w)
            assert getattr(found, name)(side, w) == pytest.approx(expected, rel=1e-6)


def test_marginals_tails_and_rates_are_integrals_of_the_density(lossy: StationaryDensity) -> None:
    def over(function: Callable[[Any], Any], *ends: float) -> float:
        """By Gauss's rule on pieces that narrow towards both ends and 0, where it is not smooth."""
        near = np.geomspace(1e-7, 1.0, 40)
        low, high = ends
        edges = np.concatenate([[*ends, 0.0], near, -near, low + near, high - near])
        edges = np.unique(np.clip(np.append(edges, np.linspace(low, high, 30)), low, high))
        nodes, weights = np.polynomial.legendre.leggauss(12)
        half = np.diff(edges)[:, None] / 2.0
        places = half * nodes + (edges[1:] + edges[:-1])[:, None] / 2.0
        return float(np.sum(function(places.ravel()) * (half * weights).ravel()))

    x, v = 0.3, 0.4
    speeds = over(lambda u: lossy.density(x, u), -6.0, 6.0)
    assert speeds == pytest.approx(float(lossy.displacement_density(x)), rel=1e-7)
    places = over(lambda y: lossy.density(y, v), -0.6, 1.1)
    assert places == pytest.approx(float(lossy.velocity_density(v)), rel=1e-6)
    beyond = over(lossy.displacement_density, x, 1.1)
    assert beyond == pytest.approx(float(lossy.tail(x)), rel=1e-5)
    faster = over(lossy.velocity_density, v, 6.0)
    assert faster == pytest.approx(float(lossy.velocity_tail(v)), rel=1e-6)
    slower = over(lossy.velocity_density, -6.0, -v)
    assert slower == pytest.approx(1.0 - float(lossy.velocity_tail(-v)), rel=1e-6)
    hits = over(lambda w: lossy.impact_flux("lower", w), 0.2, 6.0)
    assert hits == pytest.approx(float(lossy.rate_above("lower", 0.2)), rel=1e-6)
    threshold = lossy.response.impact_pairs["stops"]["speed_threshold"]
    assert isinstance(threshold, float)
    whole = over(lambda w: lossy.impact_speed_density("lower", w), threshold, 6.0)
    assert whole == pytest.approx(1.0, rel=1e-6)


def test_what_leaves_a_stop_has_the_density_of_what_came(lossy: StationaryDensity) -> None:
    """v p(c, v) dv = R v p(c, -R v) d(R v)."""
    w = np.array([0.1, 0.5, 1.5])
    came, left = lossy.density(1.1, w), lossy.density(1.1, -0.5 * w)
    error = lossy.density_error(1.1, w) + 0.25 * lossy.density_error(1.1, -0.5 * w)
    assert (np.abs(came - 0.25 * left) <= 4.0 * error + 1e-6 * came).all()


BEYOND_THE_MIDDLE = {
    "two stops": stopped(-1.0, 1.0, Viscoelastic(stiffness=50.0, damping_ratio=0.3)),
    "one stop": stopped(None, 1.0, Viscoelastic(stiffness=50.0, damping_ratio=0.3)),
    "a lower stop": stopped(-1.0, None, Viscoelastic(stiffness=50.0, damping_ratio=0.1)),
}


@pytest.mark.parametrize("name", BEYOND_THE_MIDDLE)
def test_the_density_has_no_jump_where_strips_reach_beyond_the_middle(name: str) -> None:
    """Strips before a compliant stop are counted from the other end of a box whose middle they
    pass; beyond it the density was read from the strip at the stop, and jumped by a fifth."""
    found = fokker_planck_density(BEYOND_THE_MIDDLE[name], rtol=1e-5)
    box = found.fine.scaled
    x = np.linspace(-0.999, 0.999, 3997)  # in contact it is steep where a damper ceases to push
    for v in (-0.3, 0.3):
        p = found.density(x, v)
        steps = np.abs(np.diff(p))  # the step of places is 0.0005
        assert steps.max() < 5e-3 * p.max(), (name, v, x[steps.argmax()])
    middle = box.left + 0.5 * (box.right - box.left)
    sides = found.density(np.array([middle - 1e-9, middle + 1e-9]), -0.3)
    assert sides[0] == pytest.approx(sides[1], rel=1e-4)
    whole = np.linspace(box.left if not box.halved else -box.right, box.right, 20001)
    assert np.trapezoid(found.displacement_density(whole), whole) == pytest.approx(1.0, abs=1e-5)


def test_the_density_is_positive_within_its_error(lossy: StationaryDensity) -> None:
    x = np.concatenate([np.linspace(-0.6, 1.1, 200), 1.1 - np.geomspace(1e-8, 0.1, 50)])[:, None]
    v = np.concatenate([np.linspace(-5.0, 5.0, 101), np.geomspace(1e-3, 0.1, 20)])
    assert lossy.density(x, v).min() >= -lossy.density_error(x, v).max()
    assert lossy.density(x, v).min() > -1e-6 * lossy.density(0.0, 0.0)
    assert not lossy.density([-0.61, 1.11], 0.0).any()


@quick_cases("restitution", [0.1, 0.3, 0.8], keep=(2,))
def test_the_exponent_of_the_corner(restitution: float) -> None:
    found = fokker_planck_density(oscillator(-1.0, 1.0, restitution), rtol=1e-8)
    exponent = found.slow_impact_exponent("upper")
    assert exponent.bias is not None and exponent.bias < 0.1
    assert_agrees(exponent, corner_exponent(restitution))
    assert_differs(exponent, corner_exponent(restitution + 0.1))


@pytest.mark.parametrize("row", LOSSY_ROWS, ids=lambda row: f"R={row.restitution}")
def test_the_limit_of_the_rate_is_that_of_the_table(row: RigidStops) -> None:
    limit = fokker_planck_density(oscillator(-1.0, 1.0, row.restitution), rtol=1e-7).limit_rate(
        "upper"
    )
    assert limit is not None and limit.bias is not None
    allowed = replace(limit, bias=limit.bias + row.errors["collision_rate"] / 2.0)
    assert_agrees(allowed, row.values["collision_rate"] / 2.0)


def test_a_rate_without_a_limit_has_none() -> None:
    found = fokker_planck_density(oscillator(-1.0, 1.0, 0.1))
    assert found.limit_rate("upper") is None
    with pytest.raises(ValueError, match="side must be"):
        found.limit_rate("above")


# Against Monte Carlo ------------------------------------------------------------------------------


def random_lossy(count: int, seed: int) -> list[Scene]:
    rng = np.random.default_rng(seed)
    found = []
    for kind in range(count):
        damping = 2.0 * math.exp(rng.uniform(math.log(0.02), math.log(0.5)))
        upper = math.exp(rng.uniform(math.log(0.4), math.log(2.0)))
        lower = [-upper, -1.5 * upper, None][kind % 3]
        law: Law = Restitution(coefficient=float(rng.uniform(0.5, 1.0)))
        if kind % 5 == 4:
            law = Viscoelastic(stiffness=300.0, damping_ratio=float(rng.uniform(0.05, 0.3)))
        found.append(stopped(lower, upper, law, load=0.2 * (kind % 2), damping=damping))
    return found


@pytest.mark.verify
@pytest.mark.parametrize("scene", random_lossy(30, seed=9), ids=range(30))
def test_simulation_agrees_on_random_scenes(scene: Scene) -> None:
    """To 0.05 %; rates of impacts faster than 0.3: of slower ones the steps of a path miss some.

    The mean impact speed is F1 over that rate, which are judged by themselves: its own bias, from
    twice the step, may vanish where that of the rate does not.
    """
    try:
        simulated = simulate(
            scene, rel_error=0.0005, seed=2, budget=20.0, threads=1, speed_threshold=0.3
        )
    except NotConverged as reason:
        if reason.partial is None:
            raise
        simulated = reason.partial
    solved = fokker_planck(scene, rtol=1e-5, speed_threshold=0.3).estimates()
    for key, estimate in simulated.estimates().items():
        if key in solved and estimate.bias is not None and key[1] != "impact_speed_mean":
            agrees(estimate, solved[key])


def test_a_mass_is_in_contact_where_a_table_does_not_push_yet() -> None:
    """A table that begins with zero force: contact is deflection, in every method."""
    slack = ForceTable(deflection=[0.0, 0.2, 0.6, 1.0], force=[0.0, 0.0, 5.0, 20.0])
    scene = stopped(-0.5, 0.5, slack)
    found = fokker_planck(scene, rtol=1e-4).impact_pairs["stops"]["contact_probability"]
    truth = exact(scene).impact_pairs["stops"]["contact_probability"]
    assert isinstance(found, Estimate) and isinstance(truth, Estimate)
    agrees(found, truth)


def test_a_strip_that_rounding_leaves_no_length_is_no_mesh() -> None:
    """As beside a stop whose damper is so stiff that the mass hardly enters it."""
    strip = Strip(anchor=1.0, near=0.0, far=0.0, degree=2, cells=VelocityCells((-1.0, 0.0, 1.0), 3))
    with pytest.raises(np.linalg.LinAlgError, match="scales"):
        _field(None, (strip,), 1.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("slowest", [0.3, 0.03])
def test_strips_narrow_towards_a_lossy_stop_as_far_as_noise_turns_a_slow_mass(
    slowest: float,
) -> None:
    """Noise alone changes a speed w over the distance w^3 / diffusion."""
    scaled = scaled_motion(Motion(model=model_of(oscillator(-1.0, 0.7, 0.5))))
    depth = slowest**3 / scaled.diffusion
    patches = graded(scaled, first_patches(scaled), slowest)
    assert len(scaled.corners) == 2
    for corner in scaled.corners:
        lengths = [
            patch.far - patch.near
            for patch in patches
            if corner.place - patch.anchor in (patch.near, patch.far)
        ]
        assert len(lengths) == 1
        assert STRIPS.narrowing * depth < lengths[0] <= depth
