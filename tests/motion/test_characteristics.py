"""Springs and dampers that are functions, in simulations: densities and plain twins judge them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stochvi import (
    Elastic,
    Estimate,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    SceneError,
    TabulatedNoise,
    WhiteNoise,
    average,
    exact,
    explain,
    first_passage,
    fokker_planck,
    history,
    impacts,
    simulate,
    spectrum,
    transient,
)
from stochvi.methods.periodic import StructureResonance
from stochvi.model.model import model_of
from stochvi.model.scales import Motion, form_of, with_forms, with_linear_part
from stochvi.motion.choose_plan import make_plan, plan_several
from stochvi.motion.modal import plan_modal
from stochvi.motion.white import longest_at_stops
from stochvi.scenes import Coulomb, Duffing, FilteredNoise, Sine
from stochvi.scenes.excitations import ConstantLoad, Excitation
from stochvi.scenes.structures.rigid_body import Mount, RigidBody
from stochvi.testing import assert_agrees
from support.accuracies import assert_balanced, assert_differs, assert_same, quick_cases

DUFFING = {"kind": "duffing", "cubic_stiffness": 2.0}
ROPE = {"kind": "bouc-wen", "stiffness": 2.0, "yield_displacement": 0.3}
RIGID = [ImpactPair(lower=-0.8, upper=1.0, law=Restitution(coefficient=0.8))]
ELASTIC = [ImpactPair(lower=-0.8, upper=1.0, law=Restitution(coefficient=1.0))]
SOFT = [ImpactPair(upper=0.5, law=Elastic(stiffness=50.0))]
QUANTITIES = ("displacement_mean", "displacement_std", "velocity_std")
RATES = ("collision_rate", "impact_speed_rate", "impact_speed_square_rate")


def scene_of(pairs: Any = (), excitation: Any = None, **keys: Any) -> Scene:
    """A mass of 2 kg with a spring of 1 N/m and a damper of 0.2 N s/m in noise of 0.4 N^2 s."""
    return Scene(
        structure=Oscillator(**{"mass": 2.0, "damping": 0.2, "stiffness": 1.0} | keys),
        impact_pairs=list(pairs),
        excitations=excitation or [WhiteNoise(intensity=0.4)],
    )


def measured(value: float, error: float, bias: float = 0.0) -> Estimate:
    """A number of a calculation of the test's own."""
    return Estimate(value=value, standard_error=error, bias=bias, how="test")


CASES = {
    "duffing": scene_of(spring=DUFFING),
    "elastic stops": scene_of(ELASTIC, spring=DUFFING),
    "lossy stops": scene_of(RIGID, spring=DUFFING),
    "compliant stop": scene_of(SOFT, spring=DUFFING),
    "two wells": scene_of(
        stiffness=0.0, spring=DUFFING | {"linear_stiffness": -1.0}
    ),
    "polynomial": scene_of(
        stiffness=0.0, spring={"kind": "polynomial", "coefficients": [1.0, -0.4, 0.5]}
    ),
    "table": scene_of(
        stiffness=0.0,
        spring={"kind": "table", "deflection": [0.0, 0.5, 1.0], "force": [0.0, 0.2, 1.5]},
    ),
    "function": scene_of(stiffness=0.0, spring=lambda x, v: math.sinh(x)),
    "drag": scene_of(damping=0.0, damper={"kind": "polynomial", "coefficients": [0.05, 0.3]}),
    "rayleigh": scene_of(
        RIGID, damping=0.0,
        damper={"kind": "rayleigh", "linear_damping": -0.1, "cubic_damping": 0.4},
    ),
    "coulomb": scene_of(damping=0.0, damper={"kind": "coulomb", "force": 0.2}),
    "coulomb between stops": scene_of(
        RIGID, damping=0.05, damper={"kind": "coulomb", "force": 0.2}
    ),
}  # fmt: skip
"""Scenes whose density is known: of Gibbs, or by the Fokker-Planck equation."""


@pytest.mark.slow
@quick_cases("name", list(CASES), keep={2, 6, 11})
def test_densities_are_those_of_other_methods(name: str) -> None:
    scene = CASES[name]
    known = fokker_planck(scene)
    found = simulate(scene, paths=512, duration=300.0, seed=5)
    for quantity in QUANTITIES:
        assert_agrees(found.coordinates["x"][quantity], known.coordinates["x"][quantity].value)
    for pair in found.impact_pairs:
        for quantity in RATES:
            value = known.impact_pairs[pair][quantity].value
            assert_agrees(found.impact_pairs[pair][quantity], value)
    assert_balanced(found)


def test_without_the_kicks_the_density_is_wrong() -> None:
    """The negative control: the linear part alone is not the spring."""
    scene = CASES["two wells"]
    linear = with_linear_part(model_of(scene))
    plan = plan_several(replace(linear, functions=()), None, 300.0)
    averages = plan.averages(5, 0, 256)[1]
    wrong = measured(float(averages.mean()), float(averages.std() / 16.0))
    assert_differs(wrong, exact(scene).coordinates["x"]["displacement_mean_square"].value)


def paths_of(scene: Scene, step: float, steps: int = 100) -> np.ndarray:
    """Displacement and velocity of one path, by the plan in modal coordinates."""
    plan = plan_several(model_of(scene), None, steps * step).with_step(step)
    record = np.zeros((steps, 1, plan.record_width))
    replace(plan, duration=steps * step).averages(3, 0, 1, record)
    columns = plan.columns(record)
    return np.array([columns["displacement of x"], columns["velocity of x"]])


@pytest.mark.slow
@pytest.mark.parametrize("excitation", ["white", "filtered"])
def test_a_linear_function_moves_as_the_linear_structure(excitation: str) -> None:
    noise = {
        "white": [WhiteNoise(intensity=0.4)],
        "filtered": [FilteredNoise(intensity=0.4, frequency_hz=0.15, zeta=0.3)],
    }[excitation]
    line = {"kind": "table", "deflection": [-1.0, 1.0], "force": [-0.6, 0.6]}
    linear = paths_of(scene_of(RIGID, noise), 0.1)
    for keys in (
        {"stiffness": 0.4, "spring": line},
        {"stiffness": 0.4, "spring": lambda x, v: 0.6 * x},
        {"spring": lambda x, v: 0.0},
    ):
        found = paths_of(scene_of(RIGID, noise, **keys), 0.1)
        assert found == pytest.approx(linear, abs=1e-12)


def test_a_spring_of_matrices_acts_between_its_coordinates() -> None:
    """Two coordinates that are one oscillator and a frame that hardly moves."""
    spring = DUFFING | {"between": ["x", "frame"]}
    heavy = Scene(
        structure=Matrices(
            coordinates=["x", "frame"],
            mass=[[2.0, 0.0], [0.0, 1e7]],
            damping=[[0.2, -0.2], [-0.2, 1e6]],
            stiffness=[[1.0, -1.0], [-1.0, 1e6]],
            spring=spring,
        ),
        excitations=[WhiteNoise(intensity=0.4, on="x")],
    )
    found = simulate(heavy, paths=256, duration=200.0, seed=2)
    known = exact(CASES["duffing"]).coordinates["x"]
    for quantity in ("displacement_std", "velocity_std"):
        assert_agrees(found.coordinates["x"][quantity], known[quantity].value)


def test_springs_of_the_mounts_of_a_box_are_one_spring_along_its_axis() -> None:
    spring = {"kind": "duffing", "cubic_stiffness": 0.5, "axis": "z"}
    places = [(0.3, 0.3, 0.0), (-0.3, 0.3, 0.0), (0.3, -0.3, 0.0), (-0.3, -0.3, 0.0)]
    mounts = [
        Mount(at=at, stiffness=[9.0, 9.0, 0.25], damping=[1.0, 1.0, 0.05], spring=spring)
        for at in places
    ]
    box = Scene(
        structure=RigidBody(mass=2.0, inertia=[0.2, 0.2, 0.2], mounts=mounts),
        excitations=[WhiteNoise(intensity=0.4, on="z")],
    )
    found = simulate(box, paths=256, duration=200.0, seed=2)
    known = exact(CASES["duffing"]).coordinates["x"]
    for quantity in ("displacement_std", "velocity_std"):
        assert_agrees(found.coordinates["z"][quantity], known[quantity].value)


def test_wire_rope_loses_what_noise_brings() -> None:
    """The work of the loop and of the damper is the power of the noise, with stops as well."""
    for pairs in ((), RIGID):
        scene = scene_of(pairs, spring=ROPE)
        found = simulate(scene, paths=256, duration=200.0, seed=4)
        assert_balanced(found)
        plan = make_plan(model_of(scene))
        assert plan.states == 3 and plan.layout.rows.count(("spring", "work")) == 1


def plain_rope(paths: int, duration: float, h: float, restitution: float | None) -> np.ndarray:
    """Mean squares of displacement and velocity of each path of wire rope, by Euler and Maruyama
    with the memory as a third equation: an integrator that shares nothing with the engine."""
    generator = np.random.default_rng(8)
    x, v, z = np.zeros((3, paths))
    sums, counted = np.zeros((2, paths)), 0
    for k in range(round(duration / h)):
        x1 = x + h * v
        dz = (v - 0.5 * np.abs(v) * np.abs(z) * np.sign(z) - 0.5 * v * np.abs(z)) / 0.3
        pull = (0.2 * v + x + 0.6 * z) / 2.0
        v = v - h * pull + math.sqrt(0.1 * h) * generator.standard_normal(paths)
        x, z = x1, z + h * dz
        if restitution is not None:
            for side, place in ((1.0, 1.0), (-1.0, 0.8)):
                hit = (side * x > place) & (side * v > 0.0)
                x = np.where(hit, side * (place - restitution * (side * x - place)), x)
                v = np.where(hit, -restitution * v, v)
        if k * h > 30.0:
            sums += x**2, v**2
            counted += 1
    return sums / counted


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [None, 0.8])
def test_wire_rope_moves_as_in_a_plain_integration(restitution: float | None) -> None:
    scene = scene_of([] if restitution is None else RIGID, spring=ROPE)
    found = simulate(scene, paths=512, duration=100.0, seed=4).coordinates["x"]
    h = 0.004
    fine, coarse = (plain_rope(256, 130.0, step, restitution) for step in (h, 2.0 * h))
    for quantity, row, double in zip(
        ("displacement_mean_square", "velocity_mean_square"), fine, coarse, strict=True
    ):
        error = row.std() / 16.0
        # Euler's method is of order 1; both runs have errors of their own
        bias = abs(double.mean() - row.mean()) + error
        assert_same(found[quantity], measured(float(row.mean()), error, bias))


def test_the_order_of_the_step_is_two() -> None:
    """The bias of a Duffing spring falls by four where the step is halved."""
    scene = CASES["two wells"]
    plan = make_plan(model_of(scene), None, 600.0)
    known = exact(scene).coordinates["x"]["displacement_mean_square"].value
    errors = []
    for factor in (2.0, 4.0):
        rows = plan.with_step(factor * plan.step).averages(1, 0, 4096)[1]
        errors.append((rows.mean() - known, rows.std() / 64.0))
    (fine, fine_error), (coarse, coarse_error) = errors
    assert abs(fine - coarse / 4.0) <= 4.5 * math.hypot(fine_error, coarse_error / 4.0) + abs(
        coarse / 16.0
    )
    assert abs(coarse) > 4.5 * coarse_error  # the bias is seen at all


@pytest.mark.slow
@pytest.mark.parametrize(
    "noise",
    [
        [TabulatedNoise(frequency_hz=[0.05, 0.4], density=[0.8, 0.8], unit="N2/Hz", on="x")],
        [FilteredNoise(intensity=0.4, frequency_hz=0.15, zeta=0.3)],
        [Sine(amplitude=0.5, frequency_hz=0.2), WhiteNoise(intensity=0.05)],
    ],
    ids=["table", "filtered", "sine"],
)
def test_other_excitations_shake_functions_as_well(noise: list[Any]) -> None:
    """The mean forces balance, and half the step gives the same answer."""
    scene = scene_of(RIGID, noise, spring=DUFFING)
    found = simulate(scene, paths=128, duration=200.0, seed=1)
    assert_agrees(found.identities["force"], 0.0)
    plan = make_plan(model_of(scene), None, 200.0)
    rows = plan.finer().averages(2, 0, 128)[1]
    origin = plan.layout.origins["x"]
    mean = found.coordinates["x"]["displacement_mean"].value
    square = found.coordinates["x"]["displacement_std"]
    finer = math.sqrt(rows.mean() - (mean - origin) ** 2)
    error = rows.std() / math.sqrt(128.0) / (2.0 * finer)
    assert_same(square, measured(finer, error))


def test_a_mount_that_is_a_function_has_its_force_in_the_acceleration() -> None:
    """a = -(c v + k x + F) / m; of an isolator without stops, from the Gibbs density."""
    mount = Isolator(mass=2.0, damping=0.2, stiffness=1.0, spring=DUFFING)
    scene = Scene(structure=mount, excitations=[WhiteNoise(intensity=0.1)])
    found = simulate(scene, paths=256, duration=200.0, seed=7).coordinates["x"]
    theta = 0.1 / (2.0 * 0.1)
    x = np.linspace(-4.0, 4.0, 4001)
    density = np.exp(-(x**2 / 4.0 + x**4 / 4.0) / theta)
    pull = (x + 2.0 * x**3) / 2.0
    square = float((density * pull**2).sum() / density.sum()) + 0.01 * theta
    assert_agrees(found["acceleration_std"], math.sqrt(square))


def test_the_linear_part_is_its_own_linearisation() -> None:
    model = with_linear_part(model_of(CASES["duffing"]))
    (part,) = model.functions
    variance = model.intensity / (2.0 * model.damping_rate * model.omega**2)
    assert part.affine[0] * 2.0 == pytest.approx(3.0 * 2.0 * variance, rel=1e-3)
    form = form_of(part, (0.0, math.sqrt(variance), 0.7))
    assert form.force == pytest.approx(0.0, abs=1e-12)


def test_a_motion_that_excites_itself_settles_with_the_slope_of_its_damping() -> None:
    """Beside its limit cycle the energy decays at the rate |c| / m, and not at that of its mean
    damping, which is nearly 0; its density is that of the Fokker-Planck equation."""
    scene = scene_of(
        damping=0.0, excitation=[WhiteNoise(intensity=0.002)],
        damper={"kind": "rayleigh", "linear_damping": -0.2, "cubic_damping": 0.8},
    )  # fmt: skip
    assert make_plan(model_of(scene)).relaxation == pytest.approx(2.0 / 0.2, rel=0.2)
    known = fokker_planck(scene).coordinates["x"]
    found = simulate(scene, paths=64, seed=2).coordinates["x"]
    for quantity in ("displacement_std", "velocity_std"):
        assert_agrees(found[quantity], known[quantity].value)


def test_a_motion_that_nothing_holds_or_brakes_is_refused() -> None:
    with pytest.raises(NotApplicable, match="must hold and brake the structure"):
        simulate(scene_of(damping=0.0, spring=DUFFING), paths=2, duration=1.0)


def test_a_function_that_numba_does_not_know_is_named() -> None:
    scene = scene_of(spring=lambda x, v: float(Fraction(x)))
    with pytest.raises(SceneError, match="must be a function that numba compiles"):
        simulate(scene, paths=2, duration=1.0)


def test_explain_says_what_is_simulated() -> None:
    found = explain(
        scene_of(RIGID, spring=[DUFFING, ROPE], damper={"kind": "coulomb", "force": 1.0})
    )
    assert found.effects[1:4] == ("Duffing spring (spring 1)", "Bouc-Wen spring (spring 2)",
                                  "Coulomb damper")  # fmt: skip
    assert found.methods["simulate"] == "applies"
    assert "impact_pair must be left out" in found.methods["linearise"]
    for method in ("exact", "average"):
        assert (
            "structure.spring must be linear, got kind 'duffing' (spring 1)"
            in (found.methods[method])
        )
    assert "hysteresis of kind 'bouc-wen'" in found.methods["fokker-planck"]


@pytest.mark.slow
def test_statistics_follow_functions() -> None:
    """Records, spectra and counts of impacts fly the plan of `simulate`."""
    mount = Isolator(mass=2.0, damping=0.2, stiffness=1.0, spring=DUFFING)
    scene = Scene(structure=mount, impact_pairs=RIGID, excitations=[WhiteNoise(intensity=0.1)])
    known = simulate(scene, paths=256, duration=200.0, seed=7)
    record = history(scene, duration=20.0, seed=1).to_frame()
    pull = record["displacement_m"] + 2.0 * record["displacement_m"] ** 3
    wanted = -(pull + 0.2 * record["velocity_m_s"]) / 2.0
    assert record["acceleration_m_s2"].to_numpy() == pytest.approx(wanted.to_numpy(), abs=1e-9)
    curve = spectrum(scene, rel_error=0.1, seed=1).curves["x"]["acceleration"]
    width = np.gradient(curve.frequency_hz)
    whole = math.sqrt(float(np.sum(curve.value * width)))
    assert whole == pytest.approx(known.coordinates["x"]["acceleration_std"].value, rel=0.05)
    counted = impacts(scene, paths=256, duration=200.0, seed=3)
    assert_same(
        counted.pairs["stops"].rates["both"].estimate, known.impact_pairs["stops"]["collision_rate"]
    )


def test_hysteresis_leaves_out_what_follows_from_the_past() -> None:
    mount = Isolator(mass=2.0, damping=0.2, stiffness=1.0, spring=ROPE)
    scene = Scene(structure=mount, excitations=[WhiteNoise(intensity=0.1)])
    record = history(scene, duration=5.0, seed=1).to_frame()
    assert "acceleration_m_s2" not in record
    assert simulate(scene, paths=8, duration=5.0).coordinates["x"]["acceleration_std"].value > 0.0


@pytest.mark.parametrize(
    "calculation",
    [
        exact, average,
        lambda scene: transient(scene, [1.0, 2.0]),
        lambda scene: first_passage(scene, 10.0),
        lambda scene: StructureResonance.of(scene, frequency_hz=1.0),
    ],
)  # fmt: skip
@pytest.mark.parametrize("several", [False, True])
def test_methods_for_linear_structures_refuse_functions(calculation: Any, several: bool) -> None:
    unit, zero = [[1.0, 0.0], [0.0, 1.0]], [[0.1, 0.0], [0.0, 0.1]]
    two = Matrices(
        coordinates=["a", "b"], mass=unit, damping=zero, stiffness=unit,
        spring=ROPE | {"between": ["a", "b"]},
    )  # fmt: skip
    one = Isolator(mass=1.0, damping=0.1, stiffness=1.0, spring=ROPE)
    scene = Scene(
        structure=two if several else one,
        impact_pairs=[ImpactPair(on="a" if several else "x", upper=1.0, law=ELASTIC[0].law)],
        excitations=[WhiteNoise(intensity=0.1, on="a" if several else "base")],
    )
    with pytest.raises(NotApplicable, match=r"structure\.spring must be"):
        calculation(scene)


def test_the_bias_of_what_sticks_holds() -> None:
    """Dry friction under a sine, which holds the mass for a part of each period: an integration of
    the equation with a steep line in place of the jump judges the stated bias."""
    friction = {"kind": "coulomb", "force": 0.5}
    structure = Oscillator(mass=1.0, damping=0.1, stiffness=1.0, damper=friction)
    sine = Sine(amplitude=0.7, frequency_hz=0.08)
    scene = Scene(structure=structure, excitations=[sine])
    omega = 2.0 * math.pi * 0.08

    def rates(t: float, y: np.ndarray) -> list[float]:
        force = 0.7 * math.sin(omega * t) - 0.1 * y[1] - y[0] - 0.5 * math.tanh(y[1] / 1e-4)
        return [y[1], force]

    times = np.linspace(200.0, 300.0, 10_001)  # eight periods
    solved = solve_ivp(
        rates, (0.0, 300.0), [0.0, 0.0], method="LSODA", rtol=1e-8, atol=1e-9, t_eval=times
    )
    plan = make_plan(model_of(scene), None, 400.0)
    for step in (plan.step, plan.step / 4.0):
        fine, coarse = (plan.with_step(h).averages(1, 0, 16)[1].mean() for h in (step, 2.0 * step))
        bias = plan.step_bias("displacement_mean_square", abs(fine - coarse))
        error = abs(fine - (solved.y[0] ** 2).mean())
        assert 0.25 * bias < error < bias


def between_wells(intensity: float = 0.01, linear: float = -1.0, **keys: Any) -> Scene:
    """The mass of 1 kg with wells at -1 and 1 m, a barrier of 1/4 J between them, and stops."""
    spring = {"kind": "duffing", "linear_stiffness": linear, "cubic_stiffness": 1.0}
    stops = {"lower": -1.5, "upper": 1.2, "law": Restitution(coefficient=0.8)} | keys
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=0.0, spring=spring),
        impact_pairs=[ImpactPair(**stops)],
        excitations=[WhiteNoise(intensity=intensity)],
    )


@pytest.mark.parametrize(
    ("scene", "told"),
    [
        (between_wells(), True),
        (between_wells(linear=1.0), False),
        (between_wells(upper=-0.2), False),  # one well is left
        (between_wells(0.05), False),  # over a barrier of 1.4 m E v^2 the mass comes often
    ],
)
def test_wells_of_a_spring_are_told(scene: Scene, told: bool) -> None:
    found = simulate(scene, paths=16, duration=100.0, seed=1)
    assert any("more than one well" in each for each in found.warnings) == told


WELLS = {
    "two stops": between_wells(),
    "elastic": between_wells(law=Restitution(coefficient=1.0)),
    "one stop": between_wells(lower=None),
    "a stop on the barrier": between_wells(lower=0.0),
    "a compliant stop": between_wells(lower=None, law=Elastic(stiffness=100.0)),
}


def measured_in(scene: Scene, plan: Any) -> tuple[Estimate, float]:
    """E v^2 of paths of a plan, with its stated bias, and what Fokker and Planck know."""
    settled = replace(plan, burn_in=1500.0)
    rows = [each.averages(5, 0, 256)[2] for each in (settled, settled.coarser())]
    fine, coarse = (float(each.mean()) for each in rows)
    bias = plan.step_bias("velocity_mean_square", abs(fine - coarse))
    known = fokker_planck(scene).coordinates["x"]["velocity_mean_square"].value
    return measured(fine, float(rows[0].std()) / 16.0, bias), known


@pytest.mark.slow
@quick_cases("name", list(WELLS), keep={0})
def test_a_spring_that_pulls_at_its_stops_is_followed(name: str) -> None:
    """Kicks at the ends of a step must not heat the impacts in it."""
    scene = WELLS[name]
    plan = make_plan(model_of(scene), None, 1000.0)
    assert_agrees(*measured_in(scene, plan))
    assert plan.step > 0.09  # that of a spring with one well is 0.28 s


def test_friction_on_a_stiffening_spring_has_a_linear_part() -> None:
    """Of the widest motion nothing is left beside rounding. The judge is the equivalent linear
    oscillator under filtered noise, by a fixed point over an integral of its density."""
    mass, omega, cubic, force, level = 2.0, 24.0 * math.pi, 1e9, 2.0, 3.0
    own = 30.0 * math.pi
    scene = Scene(
        structure=Isolator(
            mass=mass, frequency_hz=12.0, zeta=0.1, spring=Duffing(cubic_stiffness=cubic),
            damper=Coulomb(force=force),
        ),
        excitations=[FilteredNoise(intensity=level, frequency_hz=15.0, zeta=0.2, on="base")],
    )  # fmt: skip
    linear = with_linear_part(model_of(scene), settled=1e-6)
    w = np.linspace(0.0, 4000.0, 400_001)
    base = level / math.pi * own**4 / ((own**2 - w**2) ** 2 + (0.4 * own * w) ** 2)
    k, c = omega**2, 0.2 * omega
    for _ in range(200):
        moved = base / ((k - w**2) ** 2 + (c * w) ** 2)
        square, speed = np.trapezoid(moved, w), np.trapezoid(w**2 * moved, w)
        k += 0.5 * (omega**2 + 3.0 * cubic * square / mass - k)
        c += 0.5 * (0.2 * omega + force / mass * math.sqrt(2.0 / math.pi / speed) - c)
    # settled to 1e-6
    assert linear.stiffness[0, 0] == pytest.approx(mass * k, rel=1e-6)
    assert linear.damping[0, 0] == pytest.approx(mass * c, rel=1e-6)


def test_a_linear_part_far_from_the_force_at_a_stop_heats_the_impacts() -> None:
    """The negative control: the linear part that such a spring once had, and the step with it."""
    scene = WELLS["two stops"]
    narrow = Motion(0.0, 1.0, 0.2)
    model = with_forms(model_of(scene), [narrow])
    assert model.functions[0].affine[0] == pytest.approx(2.0)
    plan = plan_modal(model, None, 1000.0)
    law, pairs = plan.law, plan.pairs
    assert plan.step == pytest.approx(longest_at_stops(model, law, pairs))
    assert_differs(*measured_in(scene, plan.with_step(0.2)))


def test_a_spring_across_a_gap_shortens_the_step() -> None:
    """A spring of a mass whose stops are on another mass: no linear part meets its force there."""
    scene = Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=np.eye(2).tolist(), damping=(0.1 * np.eye(2)).tolist(),
            stiffness=[[0.2, -0.2], [-0.2, 1.2]],
            spring={"kind": "duffing", "linear_stiffness": -1.0, "cubic_stiffness": 1.0, "on": "a"},
        ),
        impact_pairs=[
            ImpactPair(between=["a", "b"], lower=-0.6, upper=0.5, law=Restitution(coefficient=0.8))
        ],
        excitations=[WhiteNoise(intensity=0.02, on=each) for each in ("a", "b")],
    )  # fmt: skip
    plan = make_plan(model_of(scene), None, 300.0)
    assert plan.step == pytest.approx(longest_at_stops(plan.model, plan.law, plan.pairs))
    row = plan.layout.rows.index(("a", "vv"))
    found, twice, finer = (
        each.averages(2, 0, 512)[row] for each in (plan, plan.coarser(), plan.with_step(0.02))
    )
    bias = plan.step_bias("velocity_mean_square", abs(found.mean() - twice.mean()))
    errors = [float(each.std()) / math.sqrt(512.0) for each in (found, finer)]
    assert_same(
        measured(float(found.mean()), errors[0], bias), measured(float(finer.mean()), errors[1])
    )


# ------------------------------------------------------------------------------
# Tools pressed by a feed, without springs to hold them: what impacts with loss make stationary.
# ------------------------------------------------------------------------------


STRIKER, BODY, ANVIL = 1.0, 4.0, 10.0
"""Masses, kg."""

NOISE = WhiteNoise(between=("striker", "body"), intensity=0.1)


def hammer(
    excitations: Sequence[Excitation], feed: float = 0.5, restitution: float = 0.5, *,
    anvil: bool = False,
) -> Scene:  # fmt: skip
    """A striker on a spring to its body, which a feed presses onto the ground, or onto an anvil
    that is free to move."""
    names = ("striker", "body", "anvil") if anvil else ("striker", "body")
    stiffness = np.zeros((len(names), len(names)))
    stiffness[:2, :2] = [[1.0, -1.0], [-1.0, 1.0]]
    where = {"between": ("striker", "anvil")} if anvil else {"on": "striker"}
    return Scene(
        structure=Matrices(
            coordinates=names, mass=np.diag([STRIKER, BODY, ANVIL][: len(names)]),
            damping=np.zeros_like(stiffness), stiffness=stiffness,
        ),
        impact_pairs=[ImpactPair(**where, upper=0.0, law=Restitution(coefficient=restitution))],
        excitations=[ConstantLoad(on="body", force=feed), *excitations],
    )  # fmt: skip


def test_momentum_and_energy_of_a_hammer_balance() -> None:
    """Feed = (1 + R) m F1; the noise brings S (1 / m1 + 1 / m2) / 2, impacts take (1 - R^2) m F2 /
    2."""
    found = simulate(hammer([NOISE]), paths=128, duration=800.0).impact_pairs["stops"]
    assert_agrees(found["impact_speed_rate"], 0.5 / (1.5 * STRIKER))
    power = 0.1 * (1.0 / STRIKER + 1.0 / BODY) / 2.0
    blows = power / ((1.0 - 0.5**2) * STRIKER / 2.0)
    assert_agrees(found["impact_speed_square_rate"], blows)
    with pytest.raises(AssertionError):
        # as if the whole body struck
        assert_agrees(found["impact_speed_square_rate"], blows * STRIKER / (STRIKER + BODY))


def test_a_hammer_on_a_free_anvil_is_seen_from_the_anvil() -> None:
    scene = hammer([NOISE], anvil=True)
    found = simulate(scene, paths=128, duration=800.0)
    assert list(found.coordinates) == ["striker", "body"]
    # the anvil runs away with the share of the feed that its mass takes
    pressed = 0.5 * ANVIL / (STRIKER + BODY + ANVIL)
    mass = STRIKER * ANVIL / (STRIKER + ANVIL)
    pair = found.impact_pairs["stops"]
    assert_agrees(pair["impact_speed_rate"], pressed / (1.5 * mass))
    power = 0.1 * (1.0 / STRIKER + 1.0 / BODY) / 2.0
    assert_agrees(pair["impact_speed_square_rate"], power / (0.75 * mass / 2.0))
    assert any("relative to 'anvil'" in each for each in found.assumptions)


def test_a_little_noise_leaves_the_blows_of_the_sine() -> None:
    sine = Sine(between=("striker", "body"), amplitude=1.0, frequency_hz=0.25)
    quiet = WhiteNoise(between=("striker", "body"), intensity=1e-7)
    damped = hammer([sine, quiet], feed=0.3, restitution=0.1)
    scene = damped.model_copy(
        update={
            "structure": Matrices(
                coordinates=("striker", "body"), mass=np.diag([1.0, 10.0]),
                damping=[[0.2, -0.2], [-0.2, 0.2]], stiffness=[[1.0, -1.0], [-1.0, 1.0]],
            ),
            "excitations": (damped.excitations[0], sine.model_copy(
                update={"frequency_hz": math.sqrt(1.1) / (2.0 * math.pi)}
            ), quiet),
        }
    )  # fmt: skip
    frequency = math.sqrt(1.1) / (2.0 * math.pi)
    found = simulate(scene, paths=32, duration=300.0).impact_pairs["stops"]
    assert found["collision_rate"].value == pytest.approx(frequency, rel=2e-3)
    assert_agrees(found["impact_speed_rate"], 0.3 / 1.1)


def loose(excitation: Excitation) -> Scene:
    """A mass that a load presses onto a stop, held by nothing else."""
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.0, stiffness=0.0),
        impact_pairs=[ImpactPair(upper=0.0, law=Restitution(coefficient=0.5))],
        excitations=[ConstantLoad(force=0.5), excitation],
    )


def test_a_loose_mass_under_a_table_is_hit_as_under_the_filtered_noise_of_that_density() -> None:
    """Synthesised paths against paths of states: two schemes, and different random numbers."""
    zeta, intensity = 0.1, 0.03
    filtered = FilteredNoise(intensity=intensity, frequency_hz=1.0, zeta=zeta)
    # below the table lies less than a hundredth of the variance, omega S0 / (4 zeta)
    frequency = np.geomspace(0.05, 10.0, 200)
    gain = 1.0 / ((1.0 - frequency**2) ** 2 + (2.0 * zeta * frequency) ** 2)
    table = TabulatedNoise(
        frequency_hz=frequency.tolist(), density=(2.0 * intensity * gain).tolist(), unit="N2/Hz"
    )
    one, other = (
        simulate(loose(noise), paths=64, duration=60.0, seed=seed).impact_pairs["stops"]
        for seed, noise in enumerate((filtered, table))
    )
    for name in ("impact_speed_rate", "impact_speed_square_rate", "collision_rate"):
        assert_same(one[name], other[name])
    assert_agrees(other["impact_speed_rate"], 0.5 / 1.5)


@pytest.mark.parametrize(("feed", "limit"), [(0.5, 3e4), (5.0, 5e6)])
def test_a_hard_feed_does_not_ask_for_paths_without_end(feed: float, limit: float) -> None:
    """The body swings behind a striker that lies on the tool, until it lifts it: with an energy of
    feed^2 / k at most, which the noise brings in a time known beforehand."""
    plan = make_plan(model_of(hammer([NOISE], feed=feed)))
    assert plan.steps_per_path < limit
    power = 0.1 * (1.0 / STRIKER + 1.0 / BODY) / 2.0
    assert plan.relaxation < 10.0 * max(1.0, feed**2) / power


@pytest.mark.parametrize(
    ("scene", "remedy"),
    [
        (hammer([NOISE], restitution=1.0), "restitution below 1"),
        (hammer([NOISE], feed=-0.5), "kind = 'constant'"),
        (hammer([NOISE], feed=0.0), "kind = 'constant'"),
    ],
)
def test_what_has_no_stationary_state_is_refused_with_a_remedy(scene: Scene, remedy: str) -> None:
    with pytest.raises(NotApplicable, match="no stationary state was found") as caught:
        simulate(scene)
    assert remedy in str(caught.value)
