"""Stops that give way, under white noise: exact law, one contact, plain twin, balances, limits."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stochvi import ForceTable, Matrices, Oscillator, Response, check, simulate
from stochvi.engine.arithmetic import ENDED, IMPULSE, LOSS, PEAK, TIME
from stochvi.engine.sub_steps import CONTACT_ERROR
from stochvi.methods.closed_form import displacement_density, exact
from stochvi.methods.linearisation import linearise
from stochvi.model.build_response import residuals
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan, plan_several
from stochvi.motion.kernels.random_numbers import seed_streams
from stochvi.motion.modal import (
    ANGLE_OF_ONE_MODE,
    CONTACT_ENERGY,
    CURVE_ENERGY,
    plan_modal,
)
from stochvi.motion.modal_tables import ModalTablesPlan
from stochvi.motion.plan import RELAXATIONS, PathStatistics, Plan
from stochvi.motion.white import GAP_PER_STEP, plan_white
from stochvi.results.errors import NoExactSolution, NotApplicable, SceneError
from stochvi.results.estimates import Estimate
from stochvi.scenes import Hertz
from stochvi.scenes.absorbers import Absorber
from stochvi.scenes.excitations import ConstantLoad, FilteredNoise, Sine, WhiteNoise
from stochvi.scenes.impact_laws import (
    CompliantLaw,
    Elastic,
    ForceFunction,
    Law,
    Restitution,
    Viscoelastic,
)
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Isolator
from stochvi.testing import assert_agrees
from support.accuracies import apart, assert_balanced, assert_differs, estimate, quick_cases
from support.known import values
from support.mounts import truck, two_stages
from support.naive import kick_flow_kick_with_forces, normals, penalty_euler
from support.one_mass import Flown, fly, still
from support.refusals import refusals
from support.soft_stops import (
    BALL,
    BUMPER,
    CONTACTS,
    EXACT,
    RUBBER,
    STEEL,
    WALL,
    random_stop,
    scene,
    stops_of,
)

# ---- the exact law ---------------------------------------------------------------------------


@pytest.mark.parametrize("mass", [1.0, 2.5])
@pytest.mark.parametrize(
    ("law", "square", "onsets"),
    [(STEEL, 0.3568968915371, 0.2614162369422), (BALL, 0.39824546295263, 0.25098353817789)],
    ids=["linear", "Hertz"],
)
def test_stops_give_the_printed_moments_and_onset_rates(law, square, onsets, mass):
    found = values(exact(scene(-1.0, 1.0, law, mass=mass)))
    # 13 and 14 printed digits
    assert found["displacement_mean_square"] == pytest.approx(square, rel=3e-13)
    assert found["collision_rate"] == pytest.approx(onsets, rel=3e-13)
    if law is STEEL:
        assert found["contact_probability"] == pytest.approx(0.075614997603931, rel=3e-13)


def gibbs(case: Scene, spread: float, mean: float, count: int) -> dict[str, float]:
    """Integrals of exp(-U / theta), theta = 1, by Gauss-Legendre panels between all kinks."""
    model = model_of(case)
    places = [mean + part * spread for part in (-50, -9, -3, 3, 9, 50)]
    low, high = places[0], places[-1]
    for side, stop, law in stops_of(model):
        if law.rigid:
            low, high = (low, min(high, stop)) if side > 0.0 else (max(low, stop), high)
            continue
        deepest = 9.0 * law.impact(1.0, 1.0).peak_deflection
        places += [stop, *(stop + side * deepest * part for part in (0.01, 0.1, 0.3, 1.0))]
        places += [stop + side * knot for knot in getattr(law, "deflection", ())]
    edges = np.array(sorted({low, high, *(place for place in places if low < place < high)}))
    nodes, weights = np.polynomial.legendre.leggauss(count)
    half = np.diff(edges)[:, None] / 2.0
    x = ((edges[:-1, None] + edges[1:, None]) / 2.0 + half * nodes).ravel()

    def potential(x: np.ndarray) -> np.ndarray:
        energy = model.omega**2 * x * x / 2.0 - model.load * x
        for side, stop, law in stops_of(model):
            if not law.rigid:
                energy = energy + law.potential_at(side * (x - stop))
        return energy

    bottom = potential(x).min()
    p = (half * weights).ravel() * np.exp(bottom - potential(x))
    found = {
        "displacement_mean": float(p @ x / p.sum()),
        "displacement_mean_square": float(p @ x**2 / p.sum()),
    }
    for side, stop, law in stops_of(model):
        name = "upper" if side > 0.0 else "lower"
        height = math.exp(bottom - float(potential(np.array(stop)))) / p.sum()
        found[f"collision_rate_{name}"] = height / math.sqrt(2.0 * math.pi)
        if not law.rigid:
            force = law.force_at(side * (x - stop))
            found[f"contact_force_{name}"] = float(p @ force / p.sum())
    return found


@pytest.mark.parametrize("case", EXACT.values(), ids=EXACT.keys())
def test_the_exact_law_is_the_integral_of_the_gibbs_density(case: Scene) -> None:
    response = exact(case)
    found = values(response)
    spread, mean = found["displacement_std"], found["displacement_mean"]
    coarse, fine = (gibbs(case, spread, mean, count) for count in (150, 200))
    for name, value in fine.items():
        # rounding of the potential, relative to theta, counts everywhere
        error = abs(value - coarse[name]) + 1e-11 * abs(value)
        if name == "displacement_mean":
            error += 1e-11 * spread
        assert found[name] == pytest.approx(value, rel=0.0, abs=error), name
    for name, residual in response.identities.items():
        assert residual.value == pytest.approx(0.0, abs=1e-10), name


@pytest.mark.parametrize("name", ["linear", "Hertz", "table", "preload", "preload, Hertz"])
def test_the_mean_peak_force_is_that_of_rayleigh_impacts(name: str) -> None:
    """The contact without noise, integrated for each impact speed, averaged over their law."""
    model = model_of(EXACT[name])
    side, stop, law = stops_of(model)[-1]
    plan = still({side: (stop, law)}, model.omega**2, 0.1, known=False, finer=1000.0)

    def peak_force(speed: float) -> float:
        """Of the contacts within some seconds, which are all alike."""
        flown = Flown.before()
        fly(stop, side * speed, 40, plan, flown)
        sums = flown.contacts(side)
        assert sums[ENDED] == flown.impacts(side)[0] - (flown.peaks.max() > 0.0)
        return float(sums[PEAK] / sums[ENDED])

    def mean(count: int) -> float:
        speeds = 9.0 * (np.arange(count) + 0.5) / count
        weights = 9.0 / count * speeds * np.exp(-0.5 * speeds**2)
        return float(weights @ [peak_force(speed) for speed in speeds])

    fine, coarse = mean(1200), mean(600)
    found = values(exact(EXACT[name]))["peak_force"]
    # a kink in the force leaves an error of second order; e^(-81/2) is cut off
    assert found == pytest.approx(fine, rel=0.0, abs=abs(fine - coarse) + 1e-5 * fine)


def test_a_stiff_stop_becomes_a_rigid_one() -> None:
    """The density reaches theta^(1/2) K^(-1/2) further: errors fall with the root of K."""
    rigid = values(exact(scene(-1.0, 1.0, WALL)))
    off = []
    for stiffness in (1e6, 1e8, 1e10):
        stiff = values(exact(scene(-1.0, 1.0, Elastic(stiffness=stiffness))))
        rate = stiff["collision_rate_upper"] / rigid["collision_rate_upper"] - 1.0
        # twice F1 is the mean force between rigid stops
        force = stiff["contact_force_upper"] / rigid["impact_speed_rate"] - 1.0
        off.append(np.array([rate, force]))
    assert off[1] / off[0] == pytest.approx(0.1, rel=0.02)
    assert off[2] / off[1] == pytest.approx(0.1, rel=0.02)


def test_the_density_goes_on_within_the_stop_and_ends_at_a_wall() -> None:
    density = displacement_density(EXACT["unequal, with a wall"], [-0.6, 0.999, 1.001])
    assert density[0] > 0.0 and density[1] > 0.0 and density[2] == 0.0


def test_rigid_stops_have_no_contact_time_and_no_peak_force() -> None:
    pair = exact(scene(-1.0, 1.0, WALL)).impact_pairs["stops"]
    for name in ("peak_force", "contact_probability", "contact_force_upper"):
        assert pair[name] is None


# ---- one contact in the kernel ---------------------------------------------------------------

SPEED = 1.3


@pytest.mark.parametrize("parts", [1, 37])
@pytest.mark.parametrize("law", CONTACTS.values(), ids=CONTACTS.keys())
def test_a_free_contact_is_that_of_the_contact_formulas(law: Law, parts: int) -> None:
    """Without a spring, in a single flow or cut into many."""
    expected = law.impact(SPEED, 1.0)
    flown = Flown.before()
    x, v = 0.0, SPEED
    # a damped stop is left only after the way that the limiter withdraws
    length = 1.5 * expected.contact_time
    if isinstance(law, Viscoelastic):
        length += 3.0 * law.damping_ratio / math.sqrt(law.stiffness)
    plan = still({1.0: (0.0, law)}, 0.0, length / parts, SPEED)
    x, v = fly(x, v, parts, plan, flown)
    near = CONTACT_ERROR
    found = flown.contacts(1.0)
    assert flown.impacts(1.0)[:2].tolist() == [1.0, SPEED]
    assert x < 0.0 and flown.peaks[1] == 0.0
    assert -v == pytest.approx(expected.restitution * SPEED, rel=near)
    rough = (200.0 if isinstance(law, ForceTable) else 20.0) * near
    assert found[TIME] == pytest.approx(expected.contact_time, rel=rough)
    assert found[PEAK] == pytest.approx(expected.peak_force, rel=rough)
    assert found[IMPULSE] == pytest.approx((1.0 + expected.restitution) * SPEED, rel=near)
    lost = 0.5 * (1.0 - expected.restitution**2) * SPEED**2
    assert found[LOSS] == pytest.approx(lost, abs=near * SPEED**2)


def test_sub_steps_are_of_fourth_order() -> None:
    def end(fastest: float) -> np.ndarray:
        plan = still({1.0: (0.0, Hertz(coefficient=100.0))}, 1.0, 0.2, known=False, finer=fastest)
        return np.array(fly(0.01, 1.0, 1, plan, Flown.before()))

    truth = end(3200.0)
    errors = [float(np.abs(end(fastest) - truth).max()) for fastest in (25.0, 50.0, 100.0)]
    for coarse, fine in pairwise(errors):
        assert math.log2(coarse / fine) == pytest.approx(4.0, abs=0.3)


# ---- the scheme, path by path ----------------------------------------------------------------

TWINS = {
    "linear": scene(-0.6, 0.5, STEEL),
    "Hertz": scene(-0.6, 0.5, BALL),
    "table, load": EXACT["load on a stop"],
    "preload": EXACT["preload"],
    "viscoelastic": scene(-0.6, 0.5, RUBBER, load=0.2),
    "strongly damped": scene(-0.3, 0.5, Viscoelastic(stiffness=30.0, damping_ratio=2.0)),
    "pressed onto a damper": scene(None, -0.8, Viscoelastic(stiffness=3.0, damping_ratio=1.2)),
    "stiff": scene(-0.6, 0.5, Viscoelastic(stiffness=1e5, damping_ratio=0.3)),
}


NEAR = 2e-5
"""Error of a displacement after 40 steps of 0.4 rad, whose curves have an error of 1e-7."""


@pytest.mark.parametrize("name", TWINS)
def test_a_path_equals_its_plain_twin(name: str) -> None:
    case, step, steps, path = TWINS[name], 0.4, 40, 5
    model = model_of(case)
    plan: Any = make_plan(model_of(case), None, steps * step).with_step(step)
    plan.__dict__["_fastest_of_contacts"] = 2000.0  # short sub-steps
    record = np.zeros((plan.steps, 1, 3))
    averages = dict(zip(plan.layout.rows, plan.averages(9, path, 1, record)[:, 0], strict=True))
    streams = np.empty((2, 1), np.uint64)
    seed_streams(np.uint64(9), path, streams)
    (start,), (speed,) = plan.start(streams)
    stops = [(stop - plan.model.rest, side, law) for side, stop, law in stops_of(model)]
    noise = normals(9, path, plan.steps + 2)[2:]
    x, v, sums, touches = kick_flow_kick_with_forces(
        start, speed, noise, step, model.omega, 0.1, 0.2, stops
    )
    # the error of the curves in steps grows with every contact
    near = 20.0 * CONTACT_ERROR if "table" in name else NEAR
    np.testing.assert_allclose(record[:, 0, 0], x, rtol=0, atol=near)
    np.testing.assert_allclose(record[:, 0, 1], v, rtol=0, atol=50.0 * near)
    assert record[:, 0, 2].sum() == pytest.approx(sum(s * w for s, w in touches), abs=50.0 * near)
    assert len(touches) > 3 or sums[:, 2].min() > 0.5 * steps * step
    for (_, side, law), row in zip(stops, sums, strict=True):
        end = "upper" if side > 0.0 else "lower"
        names = ("force", "loss", "contact")
        found = np.array([averages["stops", f"{name}_{end}"] for name in names])
        # what an elastic stop holds at the end is no loss
        kept = [0, 1, 2] if law.kind == "viscoelastic" else [0, 2]
        length = plan.steps * step
        np.testing.assert_allclose(found[kept], row[kept] / length, rtol=0, atol=50.0 * near)


# ---- many paths ------------------------------------------------------------------------------


def moments(plan: Plan, seed: int, paths: int) -> dict[str, np.ndarray]:
    """Time averages by name, one value per path; x and its square from the unloaded spring."""
    averages, origin = plan.averages(seed, 0, paths), plan.layout.origins["x"]
    rows = zip(plan.layout.rows, averages, strict=True)
    found = {name: row for (owner, name), row in rows if owner in ("x", "stops")}
    found["xx"] = found["xx"] + origin * (2.0 * found["x"] + origin)
    found["x"] = found["x"] + origin
    return found | {"variance": found["xx"] - found["x"].mean() ** 2}


def balances_of(case: Scene, found: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Residuals of the balances, one value per path."""
    owners = {"x": "x", "xx": "x", "vv": "x", "variance": "x"}
    keyed = {(owners.get(name, "stops"), name): sample for name, sample in found.items()}
    return residuals(model_of(case), keyed, (0.0,))


PATHS = 512


@quick_cases("case", EXACT.values(), ids=EXACT.keys(), keep=(0, 1, 2, 6, 8, 10, 12, 14))
def test_conservative_stops_agree_with_the_exact_law(case: Scene) -> None:
    model = model_of(case)
    plan = make_plan(model_of(case), None, None)
    assert plan.elastic
    found = moments(plan, 21, PATHS)
    truth = values(exact(case))
    pairs = {
        "displacement_mean": found["x"],
        "displacement_mean_square": found["xx"],
        "velocity_mean_square": found["vv"],
        "collision_rate": found["n_lower"] + found["n_upper"],
        "impact_speed_rate": found["f1_lower"] + found["f1_upper"],
        "impact_speed_square_rate": found["f2_lower"] + found["f2_upper"],
        "contact_probability": found["contact_lower"] + found["contact_upper"],
    }
    for name, sample in pairs.items():
        assert_agrees(estimate(sample), truth[name])
    for side, _, law in stops_of(model):
        end = "upper" if side > 0.0 else "lower"
        if not law.rigid:
            assert_agrees(estimate(found[f"force_{end}"]), truth[f"contact_force_{end}"])
    if "peak_force" in truth:
        onsets = found["ended_lower"] + found["ended_upper"]
        peaks = found["peak_lower"] + found["peak_upper"]
        mean = float(peaks.mean() / onsets.mean())
        error = estimate((peaks - mean * onsets) / onsets.mean()).standard_error
        stated = exact(case).impact_pairs["stops"]["peak_force"]
        assert isinstance(stated, Estimate) and stated.bias is not None
        assert_agrees(Estimate(value=mean, standard_error=error, bias=stated.bias), stated.value)


@pytest.mark.parametrize("play", [1e-9, 1e-5])
def test_a_step_follows_the_contact_where_the_gap_is_narrow(play: float) -> None:
    """A mass that sinks deep into its stops hardly flies, and the gap told the step and the speed:
    1e12 steps for elastic stops, a third of the motion for viscoelastic ones, which are like a
    spring and a damper where their gap is closed."""
    stiff = make_plan(model_of(scene(-play, play, Elastic(stiffness=1e4))), None, None)
    assert stiff.step == pytest.approx(GAP_PER_STEP * math.sqrt(12.0) / 100.0, rel=0.01)
    rubber = make_plan(model_of(scene(-play, play, RUBBER)), None, None)
    damping, stiffness = 0.1 + 2.0 * 0.2 * 10.0, 1.0 + 100.0
    assert rubber.speeds[0] == pytest.approx(math.sqrt(0.2 / 2.0 / damping), rel=1e-3)
    assert rubber.burn_in > RELAXATIONS / damping
    assert rubber.step > 0.1 / math.sqrt(stiffness)


def test_a_force_taken_at_the_ends_of_steps_fails() -> None:
    """Negative control: the scheme that people write first, at a tenth of the step used above."""
    onsets = penalty_euler(np.random.default_rng(1), 512, 4000, 0.05, 1000.0)
    truth = values(exact(scene(-1.0, 1.0, Elastic(stiffness=1000.0))))["collision_rate"]
    assert_differs(estimate(onsets), truth)


LOSSY = {
    "viscoelastic": scene(-1.0, 1.0, RUBBER),
    "soft": scene(-1.0, 1.0, Viscoelastic(stiffness=1.0, damping_ratio=0.2)),
    "stiff": scene(-1.0, 1.0, Viscoelastic(stiffness=1e8, damping_ratio=0.2)),
    "overdamped": scene(-1.0, 1.0, Viscoelastic(stiffness=100.0, damping_ratio=3.0)),
    "preload": scene(None, -1.0, RUBBER),
    "with a wall, load": scene(
        -0.3, 0.5, lower_law=Restitution(coefficient=0.7), upper_law=RUBBER, load=0.3
    ),
    "leaning on a lossy wall": scene(
        -0.3, 0.5, lower_law=Restitution(coefficient=0.5), upper_law=BALL, load=-1.0
    ),
    "neither spring nor damper": scene(-0.3, 0.5, RUBBER, damping=0.0, omega=0.0),
}


@pytest.mark.parametrize("case", LOSSY.values(), ids=LOSSY.keys())
def test_balances_hold_where_stops_lose_energy(case: Scene) -> None:
    plan = make_plan(model_of(case), None, None)
    found = moments(plan, 22, 256)
    coarse = balances_of(case, moments(plan.coarser(), 22, 256))
    balances = balances_of(case, found)
    assert set(balances) == {"energy", "force"}
    for name, sample in balances.items():
        # the same noise at twice the step: what differs is four parts of bias
        bias = abs(float((coarse[name] - sample).mean())) / 3.0
        assert_agrees(estimate(sample, bias), 0.0)


def test_the_energy_balance_notices_a_loss_that_is_left_out() -> None:
    case = LOSSY["viscoelastic"]
    found = moments(make_plan(model_of(case), None, None), 22, 256)
    found["loss_upper"] = 0.0 * found["loss_upper"]
    assert_differs(estimate(balances_of(case, found)["energy"]), 0.0)


def peak_of_small_steps(paths: int, step: float, length: float) -> tuple[float, float]:
    """Mean peak force of contacts with lossy stops at -0.3 and 0.8 m, by kicks and midpoints in
    small steps, and its standard error."""
    random, (x, v, peak) = np.random.default_rng(1), np.zeros((3, paths))
    inside, total, count = np.zeros(paths, bool), np.zeros(paths), np.zeros(paths)
    mass, stiffness, damper = 2.0, 3.0, 2.0 * 0.3 * math.sqrt(3.0 * 2.0)

    def force(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        side = np.where(x > 0.8, 1.0, -1.0)
        y = np.where(side > 0.0, x - 0.8, -0.3 - x)
        return np.where(y > 0.0, side * np.maximum(stiffness * y + damper * side * v, 0.0), 0.0)

    for number in range(int(length / step)):
        v = v + math.sqrt(0.2 * step) / mass * random.standard_normal(paths)
        x = x + 0.5 * step * v
        middle = v - 0.5 * step * (force(x, v) + 2.0 * x + 0.1 * v) / mass
        v = v - step * (force(x, middle) + 2.0 * x + 0.1 * middle) / mass
        x = x + 0.5 * step * v
        now, pushed = (x > 0.8) | (x < -0.3), np.abs(force(x, v))
        peak = np.where(now & ~inside, pushed, np.maximum(peak, pushed))
        ended = inside & ~now & (number > 0.25 * length / step)
        total, count, inside = total + ended * peak, count + ended, now
    mean = total.sum() / count.sum()
    return mean, float(np.std(total - mean * count) * math.sqrt(paths) / count.sum())


@pytest.mark.slow
def test_the_bias_of_peak_forces_holds_what_noise_makes_of_the_force_of_a_damper() -> None:
    """Peaks converge as the root of the step."""
    law = Viscoelastic(stiffness=3.0, damping_ratio=0.3)
    case = Scene(
        structure=Oscillator(mass=2.0, damping=0.1, stiffness=2.0),
        impact_pairs=[ImpactPair(name="stops", lower=-0.3, upper=0.8, law=law)],
        excitations=[WhiteNoise(intensity=0.2)],
    )
    found = simulate(case, rel_error=0.005, seed=1).impact_pairs["stops"]["peak_force"]
    assert isinstance(found, Estimate) and found.bias is not None
    # steps of a quarter of the length leave half of the error
    (coarse, _), (fine, error) = (peak_of_small_steps(3000, h, 120.0) for h in (8e-3, 2e-3))
    truth = fine + (fine - coarse)
    doubt = 4.5 * math.hypot(found.standard_error, 2.0 * error)
    assert abs(found.value - truth) < found.bias + doubt
    # of the order 1, by which it was told before, the bias is 0.4 times as large
    assert found.value + 0.4 * found.bias + doubt < truth


def test_stiff_viscoelastic_stops_become_rigid_ones_of_their_restitution() -> None:
    """On the same noise, path by path: differences shrink as the stiffness grows."""
    rigid_scene = scene(-1.0, 1.0, Restitution(coefficient=RUBBER.restitution))
    rigid_plan = plan_several(model_of(rigid_scene), None, None)
    rigid = moments(rigid_plan, 23, PATHS)
    off = []
    for stiffness in (1e3, 1e5, 1e8):
        law = Viscoelastic(stiffness=stiffness, damping_ratio=RUBBER.damping_ratio)
        plan = make_plan(model_of(scene(-1.0, 1.0, law)), None, rigid_plan.duration)
        plan = plan.with_step(rigid_plan.step)
        found = moments(plan, 23, PATHS)
        off.append(
            [
                estimate(found[name] - rigid[name])
                for name in ("xx", "vv", "f1_upper", "f2_upper", "n_upper", "force_upper")
                if name in rigid
            ]
        )
    for soft, stiff in zip(off[0], off[2], strict=True):
        assert_agrees(stiff, 0.0)
        assert abs(stiff.value) <= abs(soft.value) + stiff.standard_error
    # negative control: a soft stop lets the mass further
    assert_differs(off[0][0], 0.0)


# ---- scenes ----------------------------------------------------------------------------------


def test_a_scene_names_its_stops_and_their_law_per_unit_mass() -> None:
    case = scene(-1.0, 1.0, lower_law=BALL, upper_law=RUBBER, mass=2.5)
    model = model_of(case)
    assert case.effects()[1:] == ("Hertz stop lower", "viscoelastic stop upper")
    assert model.lower.coefficient is None and model.upper.coefficient is None
    assert model.lower.law == BALL and isinstance(model.upper.law, Viscoelastic)
    assert model.upper.law.stiffness == pytest.approx(100.0)
    assert any("recovers at once" in sentence for sentence in case.assumptions())
    assert not any("rigid" in sentence for sentence in case.assumptions())
    assert not model.elastic and model_of(scene(None, 1.0, BUMPER)).elastic


def test_a_stop_with_a_force_needs_a_mass() -> None:
    with pytest.raises(SceneError, match=r"needs structure\.mass"):
        Scene(
            structure=Isolator(frequency_hz=12.0, zeta=0.1),
            impact_pairs=[ImpactPair(upper=1.0, law=STEEL)],
            excitations=[WhiteNoise(intensity=1.0)],
        )


def test_methods_for_rigid_stops_refuse_the_others() -> None:
    case = scene(-1.0, 1.0, lower_law=STEEL, upper_law=RUBBER)
    for refuse in (
        lambda case: linearise(case, variant="box"),
        lambda case: plan_white(model_of(case), None, None),
    ):
        with pytest.raises(NotApplicable) as failure:
            refuse(case)
        found = [c for c in failure.value.conditions if c.startswith("stops must be rigid")]
        assert ["elastic' at the lower" in found[0], "upper" in found[1]] == [True, True]
    with pytest.raises(NoExactSolution, match="lose no energy, got 'viscoelastic' at the upper"):
        exact(case)


test_what_has_no_stationary_state_here_is_refused = refusals(
    lambda case, slow_impacts: make_plan(model_of(case), slow_impacts=slow_impacts),
    (scene(None, 1.0, STEEL, omega=0.0), False, "nothing brings x back"),
    (scene(-1.0, 1.0, STEEL, damping=0.0), False, "nothing takes the energy"),
    (scene(-1.0, 1.0, STEEL), True, "it must be left out with compliant stops"),
    (scene(None, 1.0, STEEL, load=-1e19), False, "standard deviations away"),
    error=NotApplicable,
)


@pytest.mark.slow
def test_any_flow_ends_and_keeps_its_energy_or_loses_some() -> None:
    """Gaps from a micrometre on, preloads, no spring: nothing hangs, overflows or gains energy."""
    rng, refused = np.random.default_rng(5), 0
    for _ in range(1000):
        centre = rng.choice([0.0, 1.0, -1.0, 30.0, -30.0])
        half = 10.0 ** rng.uniform(-6.0, 1.0)
        stiff = float(rng.choice([0.0, 1.0, 10.0 ** rng.uniform(-3.0, 3.0)]))
        stops = [(-1.0, centre - half, random_stop(rng)), (1.0, centre + half, random_stop(rng))]
        keep = rng.integers(0, 3)
        held = [stop for k, stop in enumerate(stops) if keep != k]
        x, v = centre + rng.uniform(-1.0, 1.0) * half, 10.0 ** rng.uniform(-3.0, 1.0)
        # steps as plans choose them, and some hundred touches in each
        h = 0.25 / math.sqrt(stiff) if stiff else 10.0 ** rng.uniform(-2.0, 0.0)
        h = min(h, 200.0 * half / abs(v))
        try:
            plan = still({side: (place, law) for side, place, law in held}, stiff, h, abs(v))
        except NotApplicable:  # times lie too far apart: too many steps, or parts of one
            refused += 1
            continue
        flown = Flown.before()

        def energy(x: float, v: float, held=held, stiff=stiff) -> float:
            stored = (float(law.potential_at(s * (x - c))) for s, c, law in held if not law.rigid)
            return v * v / 2.0 + stiff * x * x / 2.0 + sum(stored)

        before = energy(x, v)
        x, v = fly(x, v, 3, plan, flown)
        assert math.isfinite(x) and math.isfinite(v) and np.isfinite(flown.sums).all()
        # energy is twice as wrong as speed; a kink makes a contact two hundred times worse
        contact = 0.0 if all(law.rigid for _, _, law in held) else 3.0 * CONTACT_ERROR
        contact *= 200.0 if any(law.kind == "table" for _, _, law in held) else 1.0
        error = 1e-6 + contact * max(1.0, flown.sums[0] + flown.sums[3])
        after = energy(x, v)
        kinds = {law.kind for _, _, law in held}
        if "viscoelastic" not in kinds:  # whose spring, once left, takes up its energy again
            assert after <= before * (1.0 + error)
        if all(law.conservative for _, _, law in held):
            assert after >= before * (1.0 - error)
    assert refused < 100


# ---- simulate and check --------------------------------------------------------------------


@quick_cases("name", ["linear", "Hertz", "unequal, with a wall"], keep=(0,))
def test_simulate_and_the_exact_law_agree_in_every_quantity(name: str) -> None:
    found = check(EXACT[name], rel_error=0.01)
    assert found.passed, found
    quantities = {row.quantity for row in found.comparisons}
    assert {"contact_probability", "contact_force_lower", "energy", "force"} <= quantities
    # a rigid stop has no peak force, and so has no pair of which it is one
    assert ("peak_force" in quantities) == (name != "unequal, with a wall")


def test_forces_are_those_on_the_mass_of_the_scene() -> None:
    light, heavy = (
        simulate(scene(-1.0, 1.0, RUBBER, mass=mass), paths=64, seed=3).impact_pairs["stops"]
        for mass in (1.0, 2.5)
    )
    for quantity, factor in (
        ("peak_force", 2.5),
        ("contact_force_upper", 2.5),
        ("collision_rate", 1.0),
    ):
        assert heavy[quantity].value == pytest.approx(factor * light[quantity].value, rel=1e-6)


# ------------------------------------------------------------------------------
# Masses whose soft stops push at the same time, against the law of Gibbs.
#
# Where the noise on each mass matches its damper, and no stop loses energy, the stationary density
# is
# exp(-energy / theta) whatever the stops are (B 13.38).
# ------------------------------------------------------------------------------


MASS = np.diag([1.0, 1.5, 0.8])
STIFFNESS = np.array([[3.0, -1.0, 0.0], [-1.0, 2.5, -1.0], [0.0, -1.0, 2.0]])
DAMPING = 0.15 * MASS
NAMES = ["a", "b", "c"]
FARTHEST = 4.5
"""Standard errors by which one of some 34 numbers of a scene may be off: one scene in 4000."""

TABLE = ForceTable(deflection=[0.0, 0.1, 0.5], force=[0.0, 5.0, 60.0])
LAWS = {
    "stiff springs": (Elastic(stiffness=500.0), Elastic(stiffness=300.0)),
    "soft springs": (Elastic(stiffness=10.0), Elastic(stiffness=5.0)),
    "Hertz": (Hertz(coefficient=200.0), Hertz(coefficient=100.0)),
    "a table and a spring": (TABLE, Elastic(stiffness=20.0)),
}


def chain(first: CompliantLaw, second: CompliantLaw) -> Scene:
    """Three masses, one between two stops, the two others with a stop between them; theta = 1."""
    return Scene(
        structure=Matrices(
            coordinates=NAMES, mass=MASS.tolist(), damping=DAMPING.tolist(),
            stiffness=STIFFNESS.tolist(),
        ),
        impact_pairs=[
            ImpactPair(name="one", on="a", lower=-0.8, upper=0.9, law=first),
            ImpactPair(name="two", between=["b", "c"], upper=0.7, law=second),
        ],
        excitations=[
            WhiteNoise(on=name, intensity=2.0 * DAMPING[k, k]) for k, name in enumerate(NAMES)
        ],
    )  # fmt: skip


def farthest(known: Response, found: Response) -> float:
    """The largest difference, in standard errors, of what is beyond the stated bias."""
    largest = 0.0
    for key, truth in known.estimates().items():
        now = found.estimates().get(key)
        if now is not None and now.standard_error > 0.0:
            beyond = abs(now.value - truth.value) - (now.bias or 0.0)
            largest = max(largest, beyond / now.standard_error)
    return largest


@pytest.mark.verify
@pytest.mark.parametrize("name", LAWS)
def test_soft_stops_of_several_masses_keep_the_law_of_gibbs(name: str) -> None:
    scene = chain(*LAWS[name])
    found = simulate(scene, rel_error=0.004, seed=3, budget=240.0)
    assert farthest(exact(scene), found) < FARTHEST
    # negative control: stops that are a twentieth stiffer
    first, second = LAWS[name]
    if isinstance(first, Elastic) and isinstance(second, Elastic):
        stiffer = (law.replace(stiffness=1.05 * law.stiffness) for law in (first, second))
        assert farthest(exact(chain(*stiffer)), found) > FARTHEST


# ------------------------------------------------------------------------------
# Stops that give way on several coordinates: exact laws, balances, other engines, brute force.
# ------------------------------------------------------------------------------


def absorber(law: Law, **more: object) -> Scene:
    """A loose mass in a box on an oscillator with omega = 1, b = 0.1, S0 = 0.2."""
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        absorber=Absorber(mass=0.1, play=2.0, law=law, **more),
        excitations=[WhiteNoise(intensity=0.2)],
    )


ELASTIC = {
    "elastic": Elastic(stiffness=5.0),
    "Hertz": Hertz(coefficient=20.0),
    "tabulated": ForceTable(deflection=[0.1, 0.3], force=[0.2, 3.0]),
}


def matched(law: Law) -> Scene:
    """Two masses, one between stops and a gap between both; noise that matches the damping."""
    return Scene(
        structure=Matrices(
            coordinates=["a", "b"],
            mass=np.diag([1.0, 0.4]),
            damping=np.diag([0.3, 0.5]),
            stiffness=[[2.0, -1.0], [-1.0, 2.0]],
        ),
        impact_pairs=[
            ImpactPair(name="stops", on="a", lower=-0.7, upper=0.9, law=law),
            ImpactPair(name="gap", between=["a", "b"], lower=-0.5, upper=1.0, law=law),
        ],
        excitations=[WhiteNoise(on="a", intensity=0.6), WhiteNoise(on="b", intensity=1.0)],
    )


@quick_cases("law", ELASTIC.values(), ids=ELASTIC.keys(), keep=(1,))
def test_stops_that_lose_nothing_leave_the_gibbs_law(law: Law) -> None:
    scene = matched(law)
    truth, found = exact(scene).estimates(), simulate(scene, paths=96, duration=100.0, seed=3)
    stated = make_plan(model_of(scene)).relative_bias
    names = {name for _, name in truth}
    assert {"contact_probability", "contact_force_lower", "collision_rate_upper"} <= names
    for key, each in found.estimates().items():
        if key in truth:
            assert_agrees(each, truth[key].value)
            # of sums and ratios, the biases are added
            assert 0.0 < each.bias <= 2.1 * stated * abs(each.value) and stated < 1e-5
    assert_balanced(found)


def undamped(law: Law, damping: float) -> Scene:
    """Two masses between stops, with noise that matches a damping."""
    stops = [
        ImpactPair(name="one", on="x", lower=-0.8, upper=0.8, law=law),
        ImpactPair(name="other", on="z", upper=0.9, law=law),
    ]
    return Scene(
        structure=Matrices(
            coordinates=("x", "z"), mass=np.eye(2).tolist(), damping=(damping * np.eye(2)).tolist(),
            stiffness=[[2.0, -1.0], [-1.0, 1.5]],
        ),
        impact_pairs=stops,
        excitations=[WhiteNoise(on=each, intensity=2.0 * damping) for each in ("x", "z")],
    )  # fmt: skip


@pytest.mark.parametrize(
    "law", [*ELASTIC.values(), Elastic(stiffness=20.0), Elastic(stiffness=1e3)], ids=repr
)
def test_contacts_without_losses_keep_the_energy_to_what_is_stated(law: Law) -> None:
    """Hundreds of contacts of paths that nothing damps and nothing drives."""
    plan = plan_modal(model_of(undamped(law, 0.1)), None, 10.0)
    quiet = replace(plan, model=model_of(undamped(law, 1e-16)))
    streams = np.empty((2, 512), np.uint64)
    seed_streams(np.uint64(3), 0, streams)
    state = plan.start(streams)

    def energy() -> np.ndarray:
        modes = quiet.modes
        found = 0.5 * np.sum(state[2:4] ** 2 + modes.squares[:, None] * state[:2] ** 2, axis=0)
        for pair, y in zip(quiet.model.pairs, modes.gaps @ state[:2], strict=True):
            for stop in pair.stops:
                found += stop.law.potential_at(stop.side * (y - stop.position))
        return found

    before = energy()
    hits = quiet.counts(state, streams, 1000).sum(axis=(0, 1))
    often = hits > 10  # others have too little energy to reach a stop
    lost = (energy() / before - 1.0)[often] / hits[often]
    assert np.sum(often) > 320
    assert abs(lost.mean()) < CONTACT_ENERGY
    # a friction as small as that would be seen
    assert lost.std() / np.sqrt(len(lost)) < 0.25 * CONTACT_ENERGY
    slow = replace(plan, law=plan.law._replace(slowest=1e4))
    of_a_contact = CONTACT_ENERGY + CURVE_ENERGY * (slow.fastest * slow.step) ** 6
    assert slow.relative_bias == pytest.approx(of_a_contact * slow.hits_in_a_cluster)


@pytest.mark.parametrize("law", [*ELASTIC.values(), Elastic(stiffness=1e5)], ids=repr)
def test_long_steps_of_one_mass_keep_the_energy_to_what_is_stated(law: Law) -> None:
    plan = still({-1.0: (-0.8, law), 1.0: (0.6, law)}, 1.0, ANGLE_OF_ONE_MODE)
    stated = CONTACT_ENERGY + CURVE_ENERGY * ANGLE_OF_ONE_MODE**6
    lost = []
    for speed in np.linspace(1.0, 3.0, 60):
        flown = Flown.before()
        x, v = fly(0.0, speed, 400, plan, flown)
        stored = sum(
            float(law.potential_at(max(side * x - place, 0.0)))
            for side, place in ((-1.0, 0.8), (1.0, 0.6))
        )
        energy = 0.5 * (v * v + x * x) + stored
        hits = flown.impacts(-1.0)[0] + flown.impacts(1.0)[0]
        lost.append((energy / (0.5 * speed**2) - 1.0) / hits)
    assert abs(np.mean(lost)) < stated
    assert np.std(lost) / math.sqrt(len(lost)) < 0.5 * stated


def test_another_law_is_told_from_it() -> None:
    """The negative control of the comparison above: stops softer by a fifth."""
    truth = exact(matched(Elastic(stiffness=4.0))).impact_pairs["gap"]["contact_probability"]
    found = simulate(matched(Elastic(stiffness=5.0)), paths=96, duration=100.0, seed=3)
    assert_differs(found.impact_pairs["gap"]["contact_probability"], truth.value)


def one_mass(law: Law, upper: float = 0.5, lower: float = -1.0) -> Scene:
    return Scene(
        structure=Oscillator(mass=2.0, damping=0.2, stiffness=2.0),
        impact_pairs=[ImpactPair(name="stops", on="x", lower=lower, upper=upper, law=law)],
        excitations=[WhiteNoise(on="x", intensity=0.4)],
    )


def by_modes(scene: Scene, far: float) -> Scene:
    """The same scene with a second pair beyond reach, which the modal engine simulates."""
    out_of_reach = ImpactPair(name="far", on="x", upper=far, law=Restitution(coefficient=1.0))
    return scene.model_copy(update={"impact_pairs": (*scene.impact_pairs, out_of_reach)})


@pytest.mark.parametrize("upper", [0.5, -0.4], ids=["gap", "pressed"])
def test_one_coordinate_is_as_by_the_engine_for_one_oscillator(upper: float) -> None:
    """There the contact with a viscoelastic stop is flown exactly."""
    law = Viscoelastic(stiffness=100.0, damping_ratio=0.2)
    scene = one_mass(law, upper)
    ours, other = (
        simulate(each, paths=128, duration=60.0, seed=seed)
        for seed, each in ((6, by_modes(scene, 20.0)), (5, scene))
    )
    assert "modal" in " ".join(ours.assumptions)
    twin = other.estimates()
    for key, estimate_here in ours.estimates().items():
        if estimate_here.bias is not None and key in twin:
            assert_agrees(apart(estimate_here, twin[key]), 0.0)
    assert ("stops", "peak_force") in twin
    assert_balanced(ours)


def test_stiff_walls_throw_back_as_restitution_says() -> None:
    """R = exp(-2 z arccos z / sqrt(1 - z^2)); the soft ones do not (negative control)."""
    law = Viscoelastic(stiffness=1e4, damping_ratio=0.2)
    rigid = simulate(absorber(Restitution(coefficient=law.restitution)), paths=64, duration=60.0)
    stiff = simulate(absorber(law), paths=64, duration=60.0, seed=7)
    soft = simulate(
        absorber(Viscoelastic(stiffness=1.0, damping_ratio=0.2)), paths=64, duration=60.0, seed=8
    )
    for name in ("impact_speed_rate", "impact_speed_square_rate", "relative_displacement_std"):
        ours, truth = stiff.impact_pairs["box"][name], rigid.impact_pairs["box"][name]
        assert_agrees(apart(ours, truth), 0.0)
    name = "relative_displacement_std"
    assert_differs(apart(soft.impact_pairs["box"][name], rigid.impact_pairs["box"][name]), 0.0)


def random_scene(seed: int) -> Scene:
    """Two or three coordinates, two pairs of any laws, white or filtered noise, a load, a sine."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 4))
    names = [f"m{k}" for k in range(count)]
    tri = 2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)

    def law() -> Law:
        stiffness = float(10.0 ** rng.uniform(0.5, 3.0))
        return [
            Viscoelastic(stiffness=stiffness, damping_ratio=float(rng.uniform(0.05, 1.2))),
            Elastic(stiffness=stiffness),
            Hertz(coefficient=stiffness),
            ForceTable(deflection=[0.1, 0.3], force=[0.05 * stiffness, 0.4 * stiffness]),
            Restitution(coefficient=float(rng.uniform(0.4, 1.0))),
        ][int(rng.integers(5))]

    shaken = [
        WhiteNoise(on="m0", intensity=0.2),
        FilteredNoise(on="m0", intensity=0.2, frequency_hz=0.2, zeta=0.3),
    ]
    return Scene(
        structure=Matrices(
            coordinates=names,
            mass=np.diag(rng.uniform(0.3, 2.0, count)),
            damping=0.1 * tri,
            stiffness=tri,
        ),
        impact_pairs=[
            ImpactPair(
                name="stops", on="m0", lower=-0.6, upper=0.8, lower_law=law(),
                upper_law=Viscoelastic(stiffness=50.0, damping_ratio=0.3),
            ),
            ImpactPair(name="gap", between=names[-2:], lower=-0.5, upper=0.4, law=law()),
        ],
        excitations=[
            shaken[seed % 2],
            ConstantLoad(on="m1", force=0.2),
            *([Sine(on="m1", amplitude=0.3, frequency_hz=0.17)] if seed % 3 == 0 else []),
        ],
    )  # fmt: skip


@pytest.mark.parametrize(
    "seed", [*range(3), *(pytest.param(seed, marks=pytest.mark.verify) for seed in range(3, 10))]
)
def test_balances_hold_for_random_scenes(seed: int) -> None:
    response = simulate(random_scene(seed), paths=32, duration=60.0, seed=seed)
    white = seed % 2 == 0 and seed % 3
    assert ("energy" in response.identities) == bool(white)
    assert any(name.startswith("force on") for name in response.identities)
    assert_balanced(response)


def test_a_wrong_damper_breaks_the_energy_balance() -> None:
    """What the stops take, judged as 1.2 times as much."""
    scene = matched(Viscoelastic(stiffness=20.0, damping_ratio=0.3))
    plan = make_plan(model_of(scene), None, 100.0)
    found = PathStatistics.of(plan.averages(4, 0, 192), plan.layout)
    model = model_of(scene)
    origin = [plan.layout.origins[name] for name in model.coordinates]

    def energy(means: dict) -> float:
        wrong = {
            key: 1.2 * value if key[1].startswith("loss") else value for key, value in means.items()
        }
        return residuals(model, wrong, origin)["energy"]

    value, error = found.evaluate(energy)
    assert abs(value) > 4.5 * error
    value, error = found.evaluate(lambda means: residuals(model, means, origin)["energy"])
    assert abs(value) < 4.5 * error


# ---- brute force -----------------------------------------------------------------------------

ROUND = ForceFunction(force=lambda y, v: 1.2e7 * y**1.5 * (1.0 + 0.5 * v))
"""A force of one's own, that of round bodies with a loss."""

SCENES = {
    "viscoelastic and Hertz": two_stages(
        Viscoelastic(stiffness=4e5, damping_ratio=0.3), Hertz(coefficient=4e6)
    ),
    "tabulated and elastic": two_stages(
        ForceTable(deflection=[1e-3, 2e-3], force=[100.0, 900.0]), Elastic(stiffness=3e5)
    ),
    "a function and viscoelastic": two_stages(
        ROUND, Viscoelastic(stiffness=3e5, damping_ratio=0.1)
    ),
    "one mass, a function": truck(ForceFunction(force=lambda y, v: 1e6 * y**1.5 * (1.0 + v))),
}


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())
def test_a_path_is_that_of_brute_force(scene: Scene) -> None:
    """Masses on a truck, all gaps narrow: the same smooth input, integrated naively."""
    plan = make_plan(model_of(scene), None, 1.0)
    assert isinstance(plan, ModalTablesPlan)
    plan = replace(plan, burn_in=0.05)
    record = np.zeros((plan.steps, 1, plan.record_width))
    plan.averages(1, 0, 1, record)
    free = plan.free_response(1, 0, 1, 0)
    n, h, count = plan.modes.size, plan.step, 100
    value, slope = free[:, :, 0], plan.scale * free[:, :, 1]

    def smooth(t: float) -> np.ndarray:
        """Modal displacements and velocities by the cubic through two samples."""
        k = min(int(t / h), count - 1)
        s = t / h - k
        y0, y1, v0, v1 = value[k], value[k + 1], h * slope[k], h * slope[k + 1]
        c2, c3 = 3.0 * (y1 - y0) - 2.0 * v0 - v1, v0 + v1 - 2.0 * (y1 - y0)
        return np.concatenate(
            [y0 + s * (v0 + s * (c2 + s * c3)), (v0 + s * (2.0 * c2 + 3.0 * s * c3)) / h]
        )

    pairs = model_of(scene).pairs
    touched = [0] * len(pairs)

    def rate(t: float, e: np.ndarray) -> np.ndarray:
        total = smooth(t) + e
        pull = -plan.modes.squares * e[:n] - plan.modes.damping @ e[n:]
        for j, pair in enumerate(pairs):
            y, v = plan.modes.gaps[j] @ total[:n], plan.modes.gaps[j] @ total[n:]
            for stop in pair.stops:
                more = {"mass": pair.mass} if isinstance(stop.law, Viscoelastic) else {}
                force = float(stop.law.force_at(stop.deflection(y), stop.side * v, **more))
                touched[j] += force > 0.0
                pull -= stop.side * force * plan.modes.gaps[j]
        return np.concatenate([e[n:], pull])

    # from the end of the first counted step, at sample 0
    start = record[0, 0, : 2 * n] - np.concatenate([value[0], slope[0]])
    times = h * np.arange(count)
    solved = solve_ivp(
        rate, (0.0, times[-1]), start, t_eval=times, rtol=1e-8, atol=1e-12, max_step=h / 8.0
    )
    brute = solved.y.T + np.hstack([value[:count], slope[:count]])
    assert min(touched) > 100
    size = np.abs(brute).max(axis=0)
    # what a sub-step leaves of a contact whose force has kinks, over several of them
    tolerance = 3.0 * 6e-4
    np.testing.assert_allclose(
        record[:count, 0, : 2 * n] / size, brute / size, rtol=0, atol=tolerance
    )


# ---- the contract ----------------------------------------------------------------------------


def test_rigid_and_soft_pairs_answer_for_themselves() -> None:
    scene = two_stages(Viscoelastic(stiffness=4e5, damping_ratio=0.3), Restitution(coefficient=0.6))
    response = simulate(scene, paths=16, duration=10.0)
    soft, rigid = response.impact_pairs["bumpers"], response.impact_pairs["box stops"]
    assert soft["peak_force"].value > 0.0 and soft["contact_probability"].value > 0.0
    assert rigid["peak_force"] is None and rigid["contact_probability"] is None
    assert {"viscoelastic stop lower of bumpers", "rigid stop upper of box stops"} <= set(
        response.effects
    )


def test_a_mass_that_lies_on_a_stop_too_stiff_is_refused() -> None:
    scene = by_modes(one_mass(Elastic(stiffness=1e12), upper=-3.0, lower=-9.0), 20.0)
    with pytest.raises(NotApplicable, match="upper stop of stops"):
        simulate(scene)
