"""Stops that give way under tabulated noise: one contact, one interval, other engines, limits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stochvi import Estimate, NotApplicable, Restitution, Scene, TabulatedNoise, exact, simulate
from stochvi.engine.mass_contacts import CONTACT_ERROR, KINK_ERROR
from stochvi.engine.roots import cubic_between
from stochvi.engine.sums import ENDED, IMPULSE, PEAK, TIME
from stochvi.methods.monte_carlo import record_path
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.compliant_white import CONTACT_ROWS
from stochvi.methods.monte_carlo.kernels.rows import (
    F1_LOWER,
    F1_UPPER,
    N_LOWER,
    N_UPPER,
    VV,
    XX,
    X,
)
from stochvi.methods.monte_carlo.path_statistics import PathStatistics
from stochvi.methods.monte_carlo.tabulated import TabulatedPlan
from stochvi.model.model import model_of
from stochvi.results.quantity_units import QUANTITY_UNITS
from stochvi.scenes.excitations import FilteredNoise, Sine
from stochvi.scenes.impact_laws import Elastic, Law, Viscoelastic
from stochvi.testing import assert_agrees
from stochvi.views.tables import QUANTITY_NAMES
from support.accuracies import quick_cases
from support.known import values
from support.mounts import COMPANY, MOUNT, bumpered_mount
from support.naive import held_force_with_contacts
from support.one_mass import Flown, fly_along, stops_at
from support.soft_stops import BALL, BUMPER, CONTACTS, RUBBER, STEEL, WALL, random_stop
from support.soft_stops import scene as white_scene
from support.synthesis import AIM, SEED, coefficients

FAINT = TabulatedNoise(frequency_hz=[0.1, 0.2], density=[1e-12, 1e-12], unit="N2/Hz")
"""Sends a scene to the engine for tables, and shakes nothing."""


def plan_of(scene: Scene, duration: float | None = None) -> TabulatedPlan:
    plan = make_plan(model_of(scene), 0.0, duration)
    assert isinstance(plan, TabulatedPlan) and plan.contacts
    return plan


def with_faint_table(scene: Scene) -> Scene:
    return scene.model_copy(update={"excitations": (*scene.excitations, FAINT)})


# ---- one contact -----------------------------------------------------------------------------

NEAR = {"elastic": CONTACT_ERROR, "hertz": CONTACT_ERROR, "viscoelastic": CONTACT_ERROR}
SPEED = 1.3


@pytest.mark.parametrize("parts", [1, 7])
@pytest.mark.parametrize("law", CONTACTS.values(), ids=CONTACTS.keys())
def test_a_free_contact_is_that_of_the_contact_formulas(law: Law, parts: int) -> None:
    """Without a spring, in a single interval or cut into many; on either side."""
    expected = law.impact(SPEED, 1.0)
    length = 1.5 * expected.contact_time
    if isinstance(law, Viscoelastic):
        length += 3.0 * law.damping_ratio / math.sqrt(law.stiffness)
    near, h = NEAR.get(law.kind, KINK_ERROR), length / parts
    for side in (1.0, -1.0):
        flown, at = Flown.before(), stops_at({side: (0.0, law)}, 0.0, shaken=True)
        x, v = 0.0, side * SPEED
        for _ in range(parts):
            x, v = fly_along((x, v, x + h * v, v), h, (0.0, 0.0), at, flown)
        impacts, found = flown.impacts(side), flown.contacts(side)
        assert (impacts[0], found[ENDED]) == (1.0, 1.0)
        assert impacts[1] == pytest.approx(SPEED, rel=1e-12)
        assert side * x < 0.0 and not flown.peaks.any()
        assert -side * v == pytest.approx(expected.restitution * SPEED, abs=near * SPEED)
        assert found[TIME] == pytest.approx(expected.contact_time, rel=near)
        assert found[PEAK] == pytest.approx(expected.peak_force, rel=near)
        assert found[IMPULSE] == pytest.approx((1.0 + expected.restitution) * SPEED, rel=near)


def interval_by_a_general_solver(
    start: tuple[float, float], q: tuple[float, ...], span: float, law: Law, stop: float
) -> np.ndarray:
    """x, v and the impulse of an upper stop at the end, structure omega = 1, b = 0.1."""

    def force(x: float, v: float) -> float:
        return float(law.force_at(x - stop, v)) if x > stop else 0.0

    def derivative(t: float, state: np.ndarray) -> list[float]:
        x, v = np.polyval(q[::-1], t), np.polyval(np.polyder(q[::-1]), t)
        rate = 2.0 * q[2] + 6.0 * q[3] * t
        a = rate + 0.1 * v + x  # what shakes the structure
        push = force(state[0], state[1])
        return [state[1], a - 0.1 * state[1] - state[0] - push, push]

    solved = solve_ivp(
        derivative, (0.0, span), [*start, 0.0], rtol=1e-9, atol=1e-12, max_step=span / 400
    )
    end: np.ndarray = solved.y[:, -1]
    return end


@quick_cases("law", [STEEL, RUBBER, BALL, BUMPER], ids=lambda law: law.kind, keep=(1, 3))
def test_an_interval_equals_that_of_a_general_solver(law: Law) -> None:
    """Several contacts, contacts that go on, forces of the structure and of the noise.

    The solver sees the noise of the one cubic also after a contact, where the engine draws a new
    one through the end that it expects: of fourth order in the interval, like all cubics here.
    """
    rng = np.random.default_rng(2)
    met = 0
    for _ in range(12):
        x0, v0, v1 = rng.uniform(0.2, 0.6), rng.uniform(0.5, 2.0), rng.uniform(-2.0, 2.0)
        span, stop = 0.25, 0.5
        x1 = x0 + 0.5 * span * (v0 + v1)
        flown, at = Flown.before(), stops_at({1.0: (stop, law)}, 1.0, shaken=True)
        x, v = fly_along((x0, v0, x1, v1), span, (0.1, 1.0), at, flown)
        q = cubic_between(x0, v0, x1, v1, span)
        expected = interval_by_a_general_solver((x0, v0), q, span, law, stop)
        # KINK_ERROR of the speed; what a jump of the velocity changes within the later cubic
        later = (1.0 * span) ** 4 / 24.0
        near = (KINK_ERROR + later) * 2.0
        impulse = flown.contacts(1.0)[IMPULSE]
        assert (x, v, impulse) == pytest.approx(expected, rel=0.0, abs=near)
        met += impulse > 0.0
    assert met > 6


# ---- the exact law under white noise ---------------------------------------------------------


def estimates(scene: Scene, paths: int, seed: int) -> dict[str, Estimate]:
    """Quantities with the bias from twice the interval."""
    plan = plan_of(scene)
    layout = plan.layout
    averages = plan.averages(seed, 0, paths)
    fine = PathStatistics.of(averages, layout)
    coarser = plan.coarser()
    # the expected values of its controls are its own
    coarse = PathStatistics.of(coarser.averages(seed, 0, paths), coarser.layout)
    pair = scene.impact_pairs[0].name

    def of(name: str, quantity) -> Estimate:
        value, error = fine.evaluate(quantity)
        bias = plan.step_bias(name, abs(coarse.evaluate(quantity)[0] - value))
        return Estimate(value=value, standard_error=error, bias=bias)

    return {
        "displacement_mean_square": of("", lambda m: m["x", "xx"]),
        "velocity_mean_square": of("", lambda m: m["x", "vv"]),
        "impact_speed_rate": of(
            "impact_speed_rate", lambda m: m[pair, "f1_lower"] + m[pair, "f1_upper"]
        ),
        "collision_rate": of("collision_rate", lambda m: m[pair, "n_lower"] + m[pair, "n_upper"]),
        "contact_probability": of(
            "", lambda m: m[pair, "contact_lower"] + m[pair, "contact_upper"]
        ),
        "peak_force": of(
            "",
            lambda m: (
                (m[pair, "peak_lower"] + m[pair, "peak_upper"])
                / (m[pair, "ended_lower"] + m[pair, "ended_upper"])
            ),
        ),
    }


WHITE = {
    "linear": white_scene(-1.0, 1.0, STEEL),
    "Hertz and table": white_scene(-0.5, 1.0, lower_law=BALL, upper_law=BUMPER),
    "preload": white_scene(None, -1.0, STEEL),
}


@pytest.mark.parametrize(
    "name",
    [
        "linear",
        *(pytest.param(name, marks=pytest.mark.verify) for name in ("Hertz and table", "preload")),
    ],
)
def test_white_noise_agrees_with_the_exact_law(name: str) -> None:
    truth = values(exact(WHITE[name]))
    for quantity, estimate in estimates(with_faint_table(WHITE[name]), 192, 3).items():
        assert_agrees(estimate, truth[quantity])
        assert estimate.standard_error < 0.02 * truth[quantity]


def test_a_stop_a_quarter_softer_is_noticed() -> None:
    """Negative control."""
    truth = values(exact(WHITE["linear"]))
    softer = with_faint_table(white_scene(-1.0, 1.0, Elastic(stiffness=75.0)))
    with pytest.raises(AssertionError, match="standard errors"):
        assert_agrees(estimates(softer, 192, 3)["peak_force"], truth["peak_force"])


# ---- against a brute force on the same noise -------------------------------------------------

NAMES = ("x^2", "v^2", "onsets", "peaks", "ended", "force")


def paired(scene: Scene, paths: int, rate: float, parts: int, law: Law, group: int) -> np.ndarray:
    """(2, NAMES, paths) of the engine and of a held force with the same coefficients."""
    plan = plan_of(scene)
    top = max(float(table.frequency_hz[-1]) for table in plan.tables)
    full = plan.with_step(0.5 / (1.01 * top))
    omega = 2.0 * np.pi / plan.block_length * np.arange(1, full.samples // 2)
    response, b = np.sqrt(full.bins[: len(omega)]), plan.model.damping_rate
    gain = 1.0 / (plan.model.omega**2 - omega**2 + 1j * b * omega)
    samples = round(rate * plan.block_length / 4.0) * 4
    assert samples > 2 * len(omega)
    found = np.zeros((2, len(NAMES), paths))
    both = [
        (CONTACT_ROWS[f"{name}_lower"], CONTACT_ROWS[f"{name}_upper"])
        for name in ("peak", "ended", "force")
    ]
    for first in range(0, paths, group):
        here = slice(first, first + group)
        spectrum = np.zeros((group, samples // 2 + 1), complex)
        for index in range(group):
            spectrum[index, 1 : len(omega) + 1] = coefficients(full, first + index, response) / gain
        force = np.fft.irfft(spectrum * samples / 2.0, samples, axis=1)
        found[1, :, here] = held_force_with_contacts(
            np.ascontiguousarray(force.T).T, samples / plan.block_length, plan.model.omega, b,
            scene.impact_pairs[0].upper, law, parts,
        )  # fmt: skip
        sums = plan.averages(SEED, first, group)
        rows = [sums[XX], sums[VV], sums[N_LOWER] + sums[N_UPPER]]
        found[0, :, here] = [*rows, *(sums[one] + sums[two] for one, two in both)]
    return found


def differences(found: np.ndarray) -> dict[str, Estimate]:
    """Of the engine from the brute force, relative; also of the mean peak force."""
    mine, other = found
    relative = {name: (a - b) / b.mean() for name, a, b in zip(NAMES, mine, other, strict=True)}
    peaks, ended = NAMES.index("peaks"), NAMES.index("ended")
    relative["peak force"] = sum(
        sign * (part[peaks] / part[peaks].mean() - part[ended] / part[ended].mean())
        for sign, part in ((1.0, mine), (-1.0, other))
    )
    ratio = (mine[peaks].sum() / mine[ended].sum()) / (other[peaks].sum() / other[ended].sum())
    relative["peak force"] = relative["peak force"] + (ratio - 1.0)
    return {
        name: Estimate(
            value=float(part.mean()),
            standard_error=float(part.std(ddof=1)) / math.sqrt(len(part)),
            bias=AIM,
        )
        for name, part in relative.items()
    }


def test_hits_and_forces_agree_with_a_brute_force_on_the_same_noise() -> None:
    law = Elastic(stiffness=10.0 * MOUNT**2)
    found = differences(paired(bumpered_mount(law), 16, 2048.0, 1, law, 16))
    for estimate in found.values():
        # the brute force itself: a frequency in contact off by (W h)^2 / 24
        error = 11.0 * (MOUNT / 2048.0) ** 2 / 24.0
        assert_agrees(replace(estimate, bias=AIM + error), 0.0)
        assert estimate.standard_error < 0.01


@pytest.mark.verify
@pytest.mark.parametrize(
    ("ratio", "rate", "parts", "paths", "resolution"),
    [
        (10.0, 8192.0, 1, 384, 0.001),
        (100.0, 16384.0, 1, 512, 0.002),
        (1000.0, 16384.0, 2, 512, 0.003),
    ],
)
def test_hits_and_forces_agree_whatever_the_stiffness(
    ratio: float, rate: float, parts: int, paths: int, resolution: float
) -> None:
    law = Elastic(stiffness=ratio * MOUNT**2)
    for name, estimate in differences(
        paired(bumpered_mount(law), paths, rate, parts, law, 128)
    ).items():
        print(f"{ratio:g} {name} {estimate.value:+.5f} +- {estimate.standard_error:.5f}")
        assert_agrees(estimate, 0.0)
        assert estimate.standard_error < resolution


# ---- limits and balances ---------------------------------------------------------------------


@pytest.mark.parametrize("z", [0.0, 0.2])
def test_stiff_stops_become_rigid_ones_of_their_restitution(z: float) -> None:
    """On the same noise, path by path: differences shrink as the stiffness grows."""
    rigid_law = Restitution(coefficient=Viscoelastic(stiffness=1.0, damping_ratio=z).restitution)
    rigid_plan = make_plan(model_of(bumpered_mount(rigid_law)), 0.0, None)
    rigid = rigid_plan.averages(SEED, 0, 64)
    rows, off = [XX, VV, N_UPPER, F1_UPPER], []
    for ratio in (1e2, 1e8):
        law: Law = Elastic(stiffness=ratio * MOUNT**2)
        if z > 0.0:
            law = Viscoelastic(stiffness=ratio * MOUNT**2, damping_ratio=z)
        found = plan_of(bumpered_mount(law)).averages(SEED, 0, 64)
        off.append((found[rows] - rigid[rows]) / rigid[rows].mean(axis=1, keepdims=True))
        impulse = found[CONTACT_ROWS["force_upper"]] / found[F1_UPPER]
    assert impulse.mean() == pytest.approx(1.0 + rigid_law.coefficient, rel=1e-3)
    for soft, stiff in zip(*off, strict=True):
        error = float(stiff.std(ddof=1)) / 8.0
        assert_agrees(Estimate(value=float(stiff.mean()), standard_error=error, bias=AIM), 0.0)
        assert np.abs(stiff).mean() < np.abs(soft).mean()
    # negative control: a soft stop lets the mass further
    error = float(off[0][0].std(ddof=1)) / 8.0
    with pytest.raises(AssertionError, match="standard errors"):
        assert_agrees(Estimate(value=float(off[0][0].mean()), standard_error=error, bias=0.0), 0.0)


@pytest.mark.parametrize("name", COMPANY)
def test_forces_balance_whatever_shakes_the_mass(name: str) -> None:
    law, beside = COMPANY[name]
    response = simulate(bumpered_mount(law, beside=beside), paths=64, seed=4)
    assert set(response.identities) == {"force"}
    assert_agrees(response.identities["force"], 0.0)
    pair = response.impact_pairs["stops"]
    for quantity in ("peak_force", "contact_probability", "contact_force_upper"):
        assert isinstance(pair[quantity], Estimate) and pair[quantity].value > 0.0


def test_filtered_noise_and_sines_need_no_table_beside_them() -> None:
    """Noise filtered far above the resonance is white to the mass: the exact law holds."""
    case = WHITE["linear"]
    middle = 20.0 / (2.0 * math.pi)
    coloured = FilteredNoise(intensity=0.2, frequency_hz=middle, zeta=0.7)
    shaken = case.model_copy(update={"excitations": (coloured,)})
    found, truth = estimates(shaken, 192, 5), values(exact(case))
    for name in ("displacement_mean_square", "collision_rate", "peak_force"):
        # what lies above the filter, b / (pi^2 f) of E v^2 as of white noise, is missing
        missing = 2.0 * 0.1 / (math.pi**2 * middle) * truth[name]
        estimate = found[name]
        assert estimate.bias is not None
        assert_agrees(replace(estimate, bias=estimate.bias + missing), truth[name])


def test_a_sine_alone_may_keep_several_regimes_and_that_is_said() -> None:
    tone = Sine(amplitude=1.0, frequency_hz=0.3)
    alone = WHITE["linear"].model_copy(update={"excitations": (tone,)})
    (said,) = (
        each
        for each in simulate(alone, paths=2, duration=10.0).warnings
        if "several regimes" in each
    )
    assert "compare with a longer duration" in said


def test_a_wall_and_a_stop_that_gives_way_balance_too() -> None:
    plan = plan_of(with_faint_table(white_scene(-0.5, 1.0, lower_law=WALL, upper_law=RUBBER)))
    sums = plan.averages(6, 0, 64)
    # rest position 0: omega^2 E x = 2 F1 - force
    push = 2.0 * sums[F1_LOWER] - sums[CONTACT_ROWS["force_upper"]]
    residual = sums[X] - push
    error = float(residual.std(ddof=1)) / 8.0
    assert_agrees(Estimate(value=float(residual.mean()), standard_error=error, bias=0.0), 0.0)
    # negative control: a force left out
    left_out = float((sums[X] - 2.0 * sums[F1_LOWER]).mean())
    with pytest.raises(AssertionError, match="standard errors"):
        assert_agrees(Estimate(value=left_out, standard_error=error, bias=0.0), 0.0)


# ---- scenes, digits ----------------------------------------------------------------------------


def test_forces_are_those_on_the_mass_of_the_scene() -> None:
    law = Elastic(stiffness=30.0 * MOUNT**2)
    light, heavy = (
        simulate(bumpered_mount(law.per_unit_mass(1.0 / mass), mass=mass), paths=64, seed=3)
        for mass in (1.0, 2.5)
    )
    for quantity, factor in (
        ("peak_force", 2.5),
        ("contact_force_upper", 2.5),
        ("collision_rate", 1),
    ):
        one, other = (r.impact_pairs["stops"][quantity] for r in (light, heavy))
        assert other.value == pytest.approx(factor * one.value, rel=1e-6)


def test_digits_depend_neither_on_blocks_nor_on_threads() -> None:
    scene = bumpered_mount(COMPANY["viscoelastic"][0])
    plan = plan_of(scene, 20.0)
    whole = plan.averages(4, 0, 40)
    parts = [plan.averages(4, first, count) for first, count in ((0, 1), (1, 32), (33, 7))]
    assert np.array_equal(whole, np.concatenate(parts, axis=1))
    one, two = (simulate(scene, paths=96, duration=5.0, seed=2, threads=n) for n in (1, 2))
    assert one.estimates() == two.estimates()


def test_every_quantity_has_a_name_to_be_printed_by() -> None:
    assert set(QUANTITY_NAMES) == set(QUANTITY_UNITS)


def test_a_path_may_be_recorded() -> None:
    law = Elastic(stiffness=30.0 * MOUNT**2)
    record = record_path(bumpered_mount(law), duration=20.0, seed=1)
    gap = bumpered_mount(law).impact_pairs[0].upper
    assert (record["displacement"].abs() > gap).any() and (record["impact_speed"] != 0.0).any()


@pytest.mark.parametrize(
    ("lower", "upper", "law"),
    [
        (None, -1.0, Elastic(stiffness=1e9)),
        (-1.0, 1.0, Viscoelastic(stiffness=1e9, damping_ratio=3.0)),
    ],
    ids=["preload", "comes to rest"],
)
def test_a_mass_that_stays_on_a_very_stiff_stop_is_refused(lower, upper, law) -> None:
    with pytest.raises(NotApplicable, match="take a rigid stop"):
        simulate(with_faint_table(white_scene(lower, upper, law)))


def test_any_interval_ends_and_gains_no_energy_from_a_stop() -> None:
    """Free flight onto stops of any law, gaps from a micrometre on: nothing hangs or overflows."""
    rng = np.random.default_rng(5)
    for _ in range(400):
        half, v = 10.0 ** rng.uniform(-6.0, 0.0), 10.0 ** rng.uniform(-3.0, 1.0)
        laws = [random_stop(rng), random_stop(rng)]
        at = stops_at({s: (s * half, law) for s, law in zip((-1.0, 1.0), laws, strict=True)}, 0.0,
                      shaken=True)  # fmt: skip
        # some crossings of the gap, or an interval as long as a contact
        times = [law.impact(v, 1.0).contact_time for law in laws if not law.rigid]
        h = float(rng.choice([*times, 10.0 * half / v]))
        x, u = rng.uniform(-1.0, 1.0) * half, v
        flown = Flown.before()
        for _ in range(3):
            x, u = fly_along((x, u, x + h * u, u), h, (0.0, 0.0), at, flown)
            assert math.isfinite(x) and np.isfinite(flown.sums).all()
            assert np.isfinite(flown.peaks).all()
            # every contact may add the error of tables of any slopes
            contacts = 1.0 + flown.impacts(-1.0)[0] + flown.impacts(1.0)[0]
            assert abs(u) <= v * (1.0 + 4.0 * KINK_ERROR * contacts)
