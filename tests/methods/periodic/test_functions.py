"""Regimes of springs and dampers that are functions, against integration of their equations."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numba
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from stochvi import (
    ImpactPair,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    WhiteNoise,
    harmonic_response,
)
from stochvi.methods.periodic import Bifurcation, basins, bifurcation, lyapunov_exponent
from stochvi.methods.periodic.contact_branches import ContactFinder
from stochvi.methods.periodic.family import Family
from stochvi.methods.periodic.sine_response import Branch, HarmonicResponse
from stochvi.model.model import model_of
from stochvi.scenes import (
    BoucWen,
    Coulomb,
    Duffing,
    PolynomialDamper,
    PolynomialSpring,
    Rayleigh,
    Relay,
    SpringFunction,
    SpringTable,
    VanDerPol,
)
from stochvi.scenes.excitations import Modulation, Sine
from stochvi.scenes.impact_laws import Elastic, Hertz, Viscoelastic
from stochvi.statistics import lifetimes
from support.accuracies import quick_cases

C, K, AMPLITUDE = 0.1, 1.0, 0.5
"""Damping, N s/m, and stiffness, N/m, of the linear part of the oscillators, whose mass is 1 kg;
amplitude of the sine, N."""

LOWER, UPPER, DAMPER = -0.5, 0.45, 0.2 * math.sqrt(30.0)
"""Stops, m, and the damper of a viscoelastic one, N s/m."""


class Case(NamedTuple):
    """Keys of an oscillator, its force against displacement, rate and memory in another program,
    the rate of the memory, and displacements at which the force has a kink."""

    keys: dict[str, object]
    force: Callable[[float, float, float], float]
    memory: Callable[[float, float], float] = lambda v, z: 0.0
    kinks: tuple[float, ...] = ()


def table_force(x: float) -> float:
    """Force of a spring that is soft up to 0.3 m and stiff from there on."""
    return math.copysign(0.4 * min(abs(x), 0.3) + 3.0 * max(abs(x) - 0.3, 0.0), x)


def wen(v: float, z: float) -> float:
    return (v - (0.7 * z * abs(v) * abs(z) ** 0.5 + 0.3 * v * abs(z) ** 1.5)) / 0.2


CASES = {
    "duffing": Case({"spring": Duffing(cubic_stiffness=1.5)}, lambda x, v, z: 1.5 * x**3),
    "polynomials": Case(
        {
            "spring": PolynomialSpring(coefficients=[0.2, 0.3, 0.8]),
            "damper": PolynomialDamper(coefficients=[0.05, 0.4]),
        },
        lambda x, v, z: 0.2 * x + 0.3 * x**2 + 0.8 * x**3 + (0.05 + 0.4 * abs(v)) * v,
    ),
    "table": Case(
        {"spring": SpringTable(deflection=[0.0, 0.3, 0.6], force=[0.0, 0.12, 1.02])},
        lambda x, v, z: table_force(x), kinks=(-0.3, 0.3),
    ),
    "rayleigh": Case(
        {"damper": Rayleigh(linear_damping=0.02, cubic_damping=0.3)},
        lambda x, v, z: (0.02 + 0.3 * v**2) * v,
    ),
    "van der pol": Case(
        {"damper": VanDerPol(damping=0.15, amplitude=0.5)},
        lambda x, v, z: 0.15 * ((x / 0.5) ** 2 - 1.0) * v,
    ),
    "bouc-wen": Case(
        {"spring": BoucWen(stiffness=1.0, yield_displacement=0.2, exponent=1.5, beta=0.7)},
        lambda x, v, z: 0.2 * z, wen,
    ),
    "function": Case(
        {"spring": SpringFunction(force=lambda x, v: math.sinh(x) + 0.1 * v * x * x)},
        lambda x, v, z: math.sinh(x) + 0.1 * v * x * x,
    ),
}  # fmt: skip

STOPS: dict[str, object] = {
    "no stops": None,
    "rigid": Restitution(coefficient=0.6),
    "viscoelastic": Viscoelastic(stiffness=30.0, damping_ratio=0.1),
    "hertz": Hertz(coefficient=40.0),
}
"""Laws of the stops."""


def oscillator(case: Case, law: object, frequency: float) -> Scene:
    pairs = [] if law is None else [ImpactPair(lower=LOWER, upper=UPPER, law=law)]
    return Scene(
        structure=Oscillator(mass=1.0, damping=C, stiffness=K, **case.keys),
        impact_pairs=pairs,
        excitations=[Sine(amplitude=AMPLITUDE, frequency_hz=frequency)],
    )


def push(law: object, depth: float, speed: float) -> float:
    """Force of a compliant stop at a depth."""
    if isinstance(law, Viscoelastic):
        return max(30.0 * depth + DAMPER * speed, 0.0) if depth > 0.0 else 0.0
    return 40.0 * max(depth, 0.0) ** 1.5


def marched(
    case: Case,
    law: object,
    omega: float,
    state: list[float],
    phase: float,
    periods: int,
    factor: float = 1.0,
) -> tuple[np.ndarray, float, list[float]]:
    """State (x, v, z) some periods after a phase, largest displacement and speeds of impacts.

    An integration of order 8 that ends at every kink and at every impact. The function counts by a
    factor.
    """
    rigid = isinstance(law, Restitution)

    def rate(t: float, y: np.ndarray) -> list[float]:
        x, v, z = y
        a = AMPLITUDE * math.cos(omega * t) - K * x - C * v - factor * case.force(x, v, z)
        if law is not None and not rigid:
            a -= push(law, x - UPPER, v) - push(law, LOWER - x, -v)
        return [v, a, case.memory(v, z)]

    walls = [] if law is None else [LOWER, UPPER]
    places = [*walls, *case.kinks]
    tests = [lambda t, y, p=place: y[0] - p for place in places]
    tests += [lambda t, y: y[1], lambda t, y: y[2] if case.memory(1.0, 0.0) else 1.0]
    if isinstance(law, Viscoelastic):
        for side, place in ((1.0, UPPER), (-1.0, LOWER)):
            tests.append(lambda t, y, s=side, p=place: 30.0 * s * (y[0] - p) + DAMPER * s * y[1])
    for test in tests:
        test.terminal = True
    t, y = phase / omega, np.array(state, float)
    end, largest, speeds = t + 2.0 * math.pi * periods / omega, abs(state[0]), list[float]()
    met = [place for place in walls if abs(y[0] - place) < 1e-9 and y[1] * place > 0.0]
    while True:
        if met and len(speeds) < 100:
            speeds.append(abs(float(y[1])))
            y = y * [1.0, -0.6 if rigid else 1.0, 1.0]
        # a little further on, where what was just met is behind
        behind = min(t + 1e-8, end)
        y = solve_ivp(rate, (t, behind), y, rtol=1e-12, atol=1e-14).y[:, -1]
        part = solve_ivp(
            rate, (behind, end), y, method="DOP853", rtol=1e-11, atol=1e-12, events=tests,
            max_step=0.2,
        )  # fmt: skip
        t, y = float(part.t[-1]), part.y[:, -1]
        largest = max(largest, float(np.abs(part.y[0]).max()))
        if part.status == 0 or end - t < 1e-7:
            return y, largest, speeds
        found = [place for place, times in zip(places, part.t_events, strict=False) if len(times)]
        met = [place for place in found if place in walls and y[1] * place > 0.0]


def regimes(found: HarmonicResponse, value: float) -> list[tuple[Branch, int]]:
    """Stable regimes at a value."""
    return [
        (branch, place)
        for branch in found.branches
        for place in branch.at(value)
        if branch.stable[place]
    ]


def compared(name: str, stops: str, frequency: float, factor: float = 1.0) -> list[float]:
    """Largest difference of each stable regime from the motion of another integrator that starts
    there: of displacements, and of impact speeds."""
    case, law = CASES[name], STOPS[stops]
    found = harmonic_response(oscillator(case, law, frequency), budget=300.0)
    differences = []
    for branch, place in regimes(found, frequency):
        state = [branch.displacement[place, 0], branch.velocity[place, 0], 0.0]
        phase = branch.phase[place, 0] if branch.stops else 0.0
        omega, periods = 2.0 * math.pi * frequency, branch.periods
        forgets = case.memory(1.0, 0.0) == 0.0
        if not forgets:  # the memory settles with the motion
            end, _, _ = marched(case, law, omega, state, phase, 40 * periods, factor)
            state, phase = end.tolist(), phase + 2.0 * math.pi * 40 * periods
        _, largest, speeds = marched(case, law, omega, state, phase, periods, factor)
        own = sorted(branch.impact_speed[place])
        if len(own) != len(speeds):
            return [math.inf]
        apart = [abs(one - other) for one, other in zip(own, sorted(speeds), strict=True)]
        differences.append(max(abs(largest - branch.displacement_max[place]), *apart, 0.0))
    return differences


FREQUENCIES = np.random.default_rng(5).uniform(0.1, 0.35, (len(CASES), len(STOPS))).round(4)

GRID = [(name, stops) for name in CASES for stops in STOPS]


@pytest.mark.slow
@quick_cases(
    ("name", "stops"), GRID,
    keep=[GRID.index(each) for each in (("duffing", "rigid"), ("table", "viscoelastic"))],
)  # fmt: skip
def test_every_stable_regime_is_a_motion_of_another_integrator(name: str, stops: str) -> None:
    frequency = float(FREQUENCIES[list(CASES).index(name), list(STOPS).index(stops)])
    differences = compared(name, stops, frequency)
    assert differences
    assert max(differences) < 2e-6


@pytest.mark.slow
def test_a_force_that_is_one_per_cent_off_is_noticed() -> None:
    assert min(compared("duffing", "no stops", 0.2, factor=1.01)) > 1e-4


# Dry friction


def rubbed(ratio: float, share: float) -> Scene:
    """A mass of 1 kg on a spring of 1 N/m under 1 N, with friction of a share of it."""
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.0, stiffness=1.0, damper=Coulomb(force=share)),
        excitations=[Sine(amplitude=1.0, frequency_hz=ratio / (2.0 * math.pi))],
    )


@pytest.mark.slow
@pytest.mark.parametrize(("ratio", "share"), [(0.75, 0.3), (1.4, 0.4)])
def test_friction_has_the_amplitude_of_den_hartog(ratio: float, share: float) -> None:
    """Sliding without a halt, x = sqrt(V^2 - (f / F)^2 U^2) F / k with V = 1 / (1 - r^2) and
    U = sin(pi / r) / (r (1 + cos(pi / r))) (Den Hartog 1931)."""
    found = harmonic_response(rubbed(ratio, share), budget=300.0)
    ((branch, place),) = regimes(found, ratio / (2.0 * math.pi))
    v = 1.0 / (1.0 - ratio**2)
    u = math.sin(math.pi / ratio) / (ratio * (1.0 + math.cos(math.pi / ratio)))
    expected = math.sqrt(v**2 - (share * u) ** 2)
    assert branch.displacement_max[place] == pytest.approx(expected, abs=1e-6)
    assert abs(v) - branch.displacement_max[place] > 0.05


def stuck_and_slipped(ratio: float, share: float, periods: int) -> tuple[float, float]:
    """Largest displacement, and share of the time at rest, in the last period, from rest on."""
    t, x, largest, rested = 0.0, 0.0, 0.0, 0.0
    period = 2.0 * math.pi / ratio

    def free(time: float) -> float:
        return math.cos(ratio * time) - x

    end = periods * period
    while t < end:
        begin, step = t, 1e-3
        while abs(free(t)) <= share and t < end:
            t += step
        if t > begin:  # back to where the friction is just overcome
            t = brentq(lambda s: abs(free(s)) - share, t - step, t) if t < end else end
        rested += max(t - max(begin, end - period), 0.0)
        side = math.copysign(1.0, free(t + 1e-9))

        def rate(s: float, y: np.ndarray, side: float = side) -> list[float]:
            return [y[1], math.cos(ratio * s) - y[0] - side * share]

        def turns(s: float, y: np.ndarray, side: float = side, begin: float = t) -> float:
            return y[1] * side if s > begin + 1e-3 else 1.0

        turns.terminal = True  # type: ignore[attr-defined]
        part = solve_ivp(
            rate, (t, t + 2.0 * period), [x, 0.0], method="DOP853", rtol=1e-11, atol=1e-13,
            events=turns, max_step=0.05,
        )  # fmt: skip
        if part.t[-1] > end - period:
            largest = max(largest, float(np.abs(part.y[0][part.t > end - period]).max()))
        t, x = float(part.t[-1]), float(part.y[0, -1])
    return largest, rested / period


@pytest.mark.slow
def test_a_mass_that_halts_twice_in_a_period_slips_as_another_integrator_says() -> None:
    largest, rested = stuck_and_slipped(0.3, 0.6, 6)
    assert rested > 0.2
    found = harmonic_response(rubbed(0.3, 0.6), budget=300.0)
    ((branch, place),) = regimes(found, 0.3 / (2.0 * math.pi))
    assert branch.displacement_max[place] == pytest.approx(largest, abs=1e-6)
    # what is at rest forgets its speed, and nearly its place
    assert branch.multiplier[place] < 0.1


# Branches


def duffing(cubic: float, damping: float = C, amplitude: float = 0.3) -> Scene:
    return Scene(
        structure=Oscillator(
            mass=1.0, damping=damping, stiffness=K, spring=Duffing(cubic_stiffness=cubic)
        ),
        excitations=[Sine(amplitude=amplitude, frequency_hz=0.2)],
    )


@numba.njit
def swept(cubic: float, amplitude: float, start: float, end: float, ratio: float) -> np.ndarray:
    """Frequencies (Hz) and largest displacements of a slow sweep, by the classical method of Runge
    and Kutta with 128 steps in a period, 300 periods at each frequency."""
    count = round(math.log(end / start) / math.log(ratio)) + 1
    found = np.empty((count, 2))
    x, v = 0.0, 0.0
    for number in range(count):
        frequency = start * ratio**number
        omega = 2.0 * math.pi * frequency
        h, largest = 2.0 * math.pi / omega / 128.0, 0.0
        for step in range(300 * 128):
            kx, kv, sx, sv = 0.0, 0.0, 0.0, 0.0
            for part in range(4):
                share = 0.0 if part == 0 else (1.0 if part == 3 else 0.5)
                px, pv = x + share * h * kx, v + share * h * kv
                push = amplitude * math.cos(omega * h * (step + share))
                kx, kv = pv, push - px - 0.1 * pv - cubic * px**3
                weight = 1.0 if part in (0, 3) else 2.0
                sx, sv = sx + weight * kx, sv + weight * kv
            x, v = x + h * sx / 6.0, v + h * sv / 6.0
            if step >= 295 * 128:
                largest = max(largest, abs(x))
        found[number] = frequency, largest
    return found


@pytest.mark.verify
def test_jumps_of_a_duffing_oscillator_are_those_of_slow_sweeps() -> None:
    found = harmonic_response(duffing(1.0), np.linspace(0.1, 0.4, 31), budget=600.0)
    assert len(found.jumps) == 2
    for jump in found.jumps:
        way = 1.0 if jump.upwards else -1.0
        rows = swept(1.0, 0.3, *((0.15, 0.3) if jump.upwards else (0.35, 0.19)), 1.0 + way * 5e-4)
        leap = int(np.argmax(np.abs(np.diff(rows[:, 1])) / rows[1:, 1]))
        assert rows[leap, 0] == pytest.approx(jump.value, rel=1e-3)
        before, after = jump.displacement_max
        # at a fold a displacement moves by the root of the distance, sqrt(5e-4) = 0.02
        assert rows[leap, 1] == pytest.approx(before, rel=0.05)
        assert rows[leap + 1, 1] == pytest.approx(after, rel=0.01)


@pytest.mark.verify
def test_a_weak_cubic_follows_harmonic_balance() -> None:
    """((1 + 3/4 c A^2 - w^2)^2 + (b w)^2) A^2 = F^2; the next order is 3/128 (c A^2)^2."""
    cubic, amplitude = 0.02, 0.1
    found = harmonic_response(duffing(cubic, 0.1, amplitude), np.linspace(0.12, 0.2, 9))
    (branch,) = found.branches
    drawn = np.array([not name for name in branch.names])
    a, w = branch.amplitude[drawn], 2.0 * math.pi * branch.value[drawn]
    force = a * np.hypot(K + 0.75 * cubic * a**2 - w**2, C * w)
    order = 3.0 / 128.0 * (cubic * a.max() ** 2) ** 2 / C
    assert np.abs(force / amplitude - 1.0).max() < 2.0 * order
    # and the term itself is seen
    linear = a * np.hypot(K - w**2, C * w)
    assert np.abs(linear / amplitude - 1.0).max() > 100.0 * order


@pytest.mark.slow
def test_a_straight_table_is_a_linear_spring() -> None:
    frequency, stop = 0.19, [ImpactPair(upper=0.3, law=Restitution(coefficient=0.6))]
    table = SpringTable(deflection=[-1.0, 0.1, 1.0], force=[-0.6, 0.06, 0.6])
    sine = [Sine(amplitude=0.2, frequency_hz=frequency)]
    scenes = [
        Scene(structure=structure, impact_pairs=stop, excitations=sine)
        for structure in (
            Oscillator(mass=1.0, damping=C, stiffness=0.4, spring=table),
            Oscillator(mass=1.0, damping=C, stiffness=1.0),
        )
    ]
    found = [harmonic_response(each, budget=300.0) for each in scenes]
    own, linear = ([(b, k) for b, k in regimes(each, frequency) if b.stops] for each in found)
    assert len(own) == len(linear) == 1
    for name in ("displacement_max", "acceleration_max", "amplitude", "multiplier"):
        one, other = (getattr(branch, name)[place] for ((branch, place),) in (own, linear))
        assert one == pytest.approx(other, rel=2e-5), name
    one, other = (branch.impact_speed[place] for ((branch, place),) in (own, linear))
    assert one == pytest.approx(other, rel=1e-8)


@pytest.mark.slow
def test_functions_of_two_masses_pass_another_integrator() -> None:
    """A cubic spring between two masses, hysteresis under one, and a stop for the other."""
    rope = BoucWen(stiffness=2.0, yield_displacement=0.2, exponent=1.5, beta=0.7, on="a")
    scene = Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=[[2.0, 0.0], [0.0, 1.0]],
            damping=[[0.3, -0.1], [-0.1, 0.2]], stiffness=[[3.0, -1.0], [-1.0, 2.0]],
            spring=[Duffing(cubic_stiffness=0.8, between=("a", "b")), rope],
        ),
        impact_pairs=[ImpactPair(on="b", upper=0.4, law=Elastic(stiffness=25.0))],
        excitations=[Sine(on="a", amplitude=1.2, frequency_hz=0.16)],
    )  # fmt: skip
    found = harmonic_response(scene, coordinate="b", budget=300.0)
    known = regimes(found, 0.16)
    assert known
    omega = 2.0 * math.pi * 0.16

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        a, b, va, vb, z = y
        between, stop = 0.8 * (a - b) ** 3, 25.0 * max(b - 0.4, 0.0)
        fa = 1.2 * math.cos(omega * t) - 3.0 * a + b - 0.3 * va + 0.1 * vb - between - 0.4 * z
        fb = a - 2.0 * b + 0.1 * va - 0.2 * vb + between - stop
        return np.array([va, vb, fa / 2.0, fb, wen(va, z)])

    ends = []
    for branch, place in known:
        y = np.array([*branch.displacement[place], *branch.velocity[place], 0.0])
        t = branch.phase[place, 0] / omega if branch.stops else 0.0
        many = 60 * branch.periods * 2.0 * math.pi / omega
        part = solve_ivp(rate, (t, t + many), y, rtol=1e-9, atol=1e-10, max_step=0.05)
        late = part.t > t + many - branch.periods * 2.0 * math.pi / omega
        ends.append(abs(float(np.abs(part.y[1][late]).max()) - branch.displacement_max[place]))
    assert max(ends) < 1e-4


# What is refused


@pytest.mark.verify
def test_a_box_that_moves_along_one_axis_is_an_oscillator() -> None:
    """Four equal mounts that stiffen are one mount of four times the force."""
    corners = [(x, y, 0.0) for x in (-0.2, 0.2) for y in (-0.15, 0.15)]
    law = {"kind": "duffing", "axis": "z", "cubic_stiffness": 4e9}
    mounts = [
        {"at": at, "stiffness": (2.2e4, 2.2e4, 3.4e4), "damping": (50.0, 50.0, 80.0), "spring": law}
        for at in corners
    ]
    box = Scene.model_validate({
        "structure": {"kind": "rigid-body", "mass": 12.0, "inertia": (0.2, 0.25, 0.15),
                      "mount": mounts},
        "excitation": [{"kind": "sine", "on": "base", "axis": "z", "amplitude": 20.0,
                        "frequency_hz": 15.0}],
    })  # fmt: skip
    one = Scene.model_validate({
        "structure": {"kind": "oscillator", "mass": 12.0, "damping": 320.0, "stiffness": 1.36e5,
                      "spring": {"kind": "duffing", "cubic_stiffness": 16e9}},
        "excitation": [{"kind": "sine", "amplitude": 240.0, "frequency_hz": 15.0}],
    })  # fmt: skip
    own, wanted = (
        harmonic_response(each, [16.0, 18.0], coordinate=name).to_frame()["displacement_max"]
        for each, name in ((box, "z"), (one, "x"))
    )
    assert own.to_numpy() == pytest.approx(wanted.to_numpy(), rel=1e-5)
    softer = one.structure.replace(stiffness=1.30e5)
    other = harmonic_response(one.replace(structure=softer), [16.0, 18.0]).to_frame()
    assert abs(other["displacement_max"][0] / wanted[0] - 1.0) > 1e-3


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"damper": Relay(force=0.3)}, "must not drive the structure"),
        ({"damper": [Coulomb(force=0.1), Coulomb(force=0.2)]}, "which of several slip together"),
    ],
)
def test_what_has_no_answer_is_refused_in_a_sentence(
    keys: dict[str, object], sentence: str
) -> None:
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=C, stiffness=K, **keys),
        excitations=[Sine(amplitude=0.5, frequency_hz=0.2)],
    )
    with pytest.raises(NotApplicable, match=sentence):
        harmonic_response(scene)


def test_a_modulation_is_refused() -> None:
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=C, stiffness=K),
        excitations=[
            Sine(amplitude=0.5, frequency_hz=0.2),
            Modulation(of="stiffness", amplitude=0.1, frequency_hz=0.4),
        ],
    )
    with pytest.raises(NotApplicable):
        harmonic_response(scene)


FOLLOWED = [
    *((name, stops) for name in ("duffing", "polynomials", "table", "rayleigh", "bouc-wen")
      for stops in ("no stops", "rigid")),
    ("duffing", "viscoelastic"), ("duffing", "hertz"), ("friction", "no stops"),
]  # fmt: skip
"""Functions and laws of stops; dry friction slips at first, and then sticks."""


@pytest.mark.parametrize(("name", "stops"), FOLLOWED)
def test_perturbations_of_a_motion_grow_as_its_neighbours_do(name: str, stops: str) -> None:
    """Over kinks, impacts, contacts and halts; neighbours start on either side."""
    scene = rubbed(0.3, 0.6) if name == "friction" else oscillator(CASES[name], STOPS[stops], 0.2)
    model = model_of(scene)
    family = Family.of(lambda _: model, 1.0, 2.0, None)
    finder = ContactFinder(family, np.array([0.5]), 1)
    start = np.append([0.1, 0.4], [0.05] * family.functions.remembering)
    motion = finder.flown(0.5, start, 1)
    assert motion is not None
    if stops != "no stops":
        assert len(motion.log)
    sides = [
        [finder.flown(0.5, start + side * way, 1, factors=False) for way in np.eye(len(start))]
        for side in (-1e-5, 1e-5)
    ]
    low, high = ([each.ends[-1] for each in side if each is not None] for side in sides)
    expected = (np.array(high) - np.array(low)).T / 2e-5
    assert motion.factors == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())


# ------------------------------------------------------------------------------
# Slow sweeps and exponents where springs and dampers are functions.
# ------------------------------------------------------------------------------


C_OF_SWEEPS, CUBIC, AMPLITUDE_OF_SWEEPS = 0.05, 1.0, 7.5
"""Damping, N s/m, cubic stiffness, N/m^3, and force, N, of Ueda's oscillator of 1 kg, whose motion
under cos t is chaotic (Y. Ueda, J. Stat. Phys. 20 (1979) 181)."""


def ueda(damping: float = C_OF_SWEEPS) -> Scene:
    return Scene(
        structure=Oscillator(
            mass=1.0, damping=damping, stiffness=1e-9, spring=Duffing(cubic_stiffness=CUBIC)
        ),
        excitations=[Sine(amplitude=AMPLITUDE_OF_SWEEPS, frequency_hz=0.5 / math.pi)],
    )


def grown(damping: float, periods: int) -> tuple[float, float]:
    """Growth of a solution of the variational equation, 1/s, and its standard error."""

    def rate(t: float, y: np.ndarray) -> list[float]:
        x, v, a, b = y
        push = AMPLITUDE_OF_SWEEPS * math.cos(t) - damping * v - CUBIC * x**3
        return [v, push, b, -damping * b - 3.0 * CUBIC * x**2 * a]

    y, turn, logs = np.array([1.0, 3.0, 1.0, 0.0]), 2.0 * math.pi, list[float]()
    for _ in range(periods):
        y = solve_ivp(rate, (0.0, turn), y, method="DOP853", rtol=1e-8, atol=1e-10).y[:, -1]
        logs.append(math.log(math.hypot(y[2], y[3])))
        y[2:] /= math.hypot(y[2], y[3])
    means = np.array([part.mean() for part in np.array_split(logs[periods // 10 :], 30)]) / turn
    return float(means.mean()), float(means.std(ddof=1) / math.sqrt(len(means)))


@pytest.mark.slow
def test_the_exponent_of_a_chaotic_motion_is_that_of_its_variational_equation() -> None:
    found = lyapunov_exponent(ueda(), {"displacement.x": 1.0, "velocity.x": 3.0})
    wanted, error = grown(C_OF_SWEEPS, 1500)
    limit = 4.0 * math.hypot(error, found.standard_error)
    assert abs(found.value - wanted) < limit
    # a motion that loses more is less chaotic
    calmer, _ = grown(6.0 * C_OF_SWEEPS, 400)
    assert found.value - calmer > limit


def oscillator_of_sweeps(
    restitution: float | None = None, damping: float = 0.1, **keys: object
) -> Scene:
    law = None if restitution is None else Restitution(coefficient=restitution)
    return Scene(
        structure=Oscillator(**{"mass": 1.0, "damping": damping, "stiffness": 1.0} | keys),
        impact_pairs=[] if law is None else [ImpactPair(lower=-0.8, upper=1.0, law=law)],
        excitations=[Sine(amplitude=0.5, frequency_hz=0.2)],
    )


def swept_of_sweeps(scene: Scene, frequencies: list[float]) -> Bifurcation:
    return bifurcation(scene, frequencies, settling=400, watched=256)


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [None, 0.95])
def test_areas_of_states_shrink_by_damping_and_impacts(restitution: float | None) -> None:
    """Where both multipliers have one size, a motion of n impacts per period T has the exponent
    -c / 2 m + n ln R / T: areas shrink by exp(-c T / m) and by R^2 at each impact."""
    scene = oscillator_of_sweeps(restitution, spring=Duffing(cubic_stiffness=0.5))
    (sweep,) = swept_of_sweeps(scene, [0.15, 0.2, 0.3]).sweeps
    impacts = np.array([len(speeds) for speeds in sweep.impact_speed]) / 256
    log = 0.0 if restitution is None else math.log(restitution)
    wanted = -0.05 + impacts * log * sweep.frequency_hz
    complex_pair = np.abs(sweep.lyapunov - wanted) < 4.0 * sweep.lyapunov_error
    assert np.all(sweep.periods > 0)
    assert np.any(impacts > 0.0) == (restitution is not None)
    assert np.all(complex_pair)
    other = swept_of_sweeps(
        scene.replace(structure=scene.structure.replace(damping=0.13)), [0.15, 0.2]
    )
    apart = np.abs(other.sweeps[0].lyapunov - wanted[:2])
    assert np.all(apart > 4.0 * other.sweeps[0].lyapunov_error)


@pytest.mark.slow
@pytest.mark.parametrize("law", [Restitution(coefficient=0.7),
                                 Viscoelastic(stiffness=30.0, damping_ratio=0.1)])  # fmt: skip
def test_a_straight_table_sweeps_as_a_linear_spring(law: object) -> None:
    table = SpringTable(deflection=[1.0, 2.0], force=[0.5, 1.0])
    pairs = [ImpactPair(lower=-0.8, upper=1.0, law=law)]
    scenes = [oscillator_of_sweeps(stiffness=0.5, spring=table), oscillator_of_sweeps()]
    own, linear = (
        swept_of_sweeps(each.replace(impact_pairs=pairs), [0.18, 0.2, 0.25]).sweeps[0]
        for each in scenes
    )
    assert own.periods.tolist() == linear.periods.tolist()
    assert any(len(speeds) for speeds in linear.impact_speed)
    for one, other in zip(own.impact_speed, linear.impact_speed, strict=True):
        assert one == pytest.approx(other, rel=1e-6)
    assert own.lyapunov == pytest.approx(linear.lyapunov, abs=1e-6)


def test_hysteresis_starts_without_a_memory() -> None:
    scene = oscillator_of_sweeps(0.7, spring=BoucWen(stiffness=1.0, yield_displacement=0.3))
    found = bifurcation(scene, [0.18, 0.2], start={"velocity.x": 0.2}, settling=64, watched=64)
    assert np.all(np.isfinite(found.sweeps[0].lyapunov))


def test_a_map_of_basins_names_what_follows_functions() -> None:
    with pytest.raises(NotApplicable, match="sine finds its regimes, and bifurcation follows"):
        basins(oscillator_of_sweeps(spring=Duffing(cubic_stiffness=1.0)))
    noisy = oscillator_of_sweeps(spring=Duffing(cubic_stiffness=1.0))
    noisy = noisy.replace(excitations=(*noisy.excitations, WhiteNoise(intensity=0.01)))
    with pytest.raises(NotApplicable, match="sine finds its regimes, and bifurcation follows"):
        lifetimes(noisy)
