"""Bars, beams and plates: frequencies, shapes, masses and compliances, each found a second way."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest
import scipy.linalg

from stochvi.results.errors import SceneError
from stochvi.scenes.structures import Bar, Beam, Plate

STEEL: dict[str, Any] = {"young": 2.0e11, "density": 7850.0, "zeta": 0.01}
REED: dict[str, Any] = STEEL | {"length": 0.2, "width": 0.02, "height": 0.002}
ROD: dict[str, Any] = STEEL | {"length": 0.5, "area": 1e-4}
TIP = 0.7
"""Tip mass in units of that of the structure."""
SPRING = 2.0
"""Tip spring, in units of EI / L^3 or EA / L."""

Equation = Callable[[Any], Any]

BEAMS: dict[str, tuple[dict[str, Any], Equation, list[float]]] = {
    "cantilever": (
        {"support": "cantilever"}, lambda b: mpmath.cos(b) * mpmath.cosh(b) + 1, [1.8751, 4.6941],
    ),
    "pinned": ({"support": "pinned"}, mpmath.sin, [3.1416, 6.2832]),
    "clamped": (
        {"support": "clamped"}, lambda b: mpmath.cos(b) * mpmath.cosh(b) - 1, [4.73, 7.8532],
    ),
    "clamped-pinned": (
        {"support": "clamped-pinned"}, lambda b: mpmath.tan(b) - mpmath.tanh(b), [3.9266, 7.0686],
    ),
    "free": (
        {"support": "free"}, lambda b: mpmath.cos(b) * mpmath.cosh(b) - 1, [0.0, 0.0, 4.73, 7.8532],
    ),
    "tip mass": (
        {"support": "cantilever", "tip_mass": TIP},
        lambda b: 1 + mpmath.cos(b) * mpmath.cosh(b)
        + TIP * b * (mpmath.cos(b) * mpmath.sinh(b) - mpmath.sin(b) * mpmath.cosh(b)),
        [1.33, 4.07],
    ),
    "tip spring": (
        {"support": "cantilever", "tip_spring": SPRING},
        lambda b: b**3 * (1 + mpmath.cos(b) * mpmath.cosh(b))
        + SPRING * (mpmath.sin(b) * mpmath.cosh(b) - mpmath.cos(b) * mpmath.sinh(b)),
        [2.15, 4.72],
    ),
}  # fmt: skip
"""Keys of a beam, its textbook frequency equation in beta L, and where its first roots are
(Blevins, Formulas for Natural Frequency and Mode Shape, tables 8-1 to 8-8)."""

BARS: dict[str, tuple[dict[str, Any], Equation, list[float]]] = {
    "fixed-free": ({"support": "cantilever"}, mpmath.cos, [1.5708, 4.7124]),
    "fixed-fixed": ({"support": "clamped"}, mpmath.sin, [3.1416, 6.2832]),
    "free-free": ({"support": "free"}, mpmath.sin, [0.0, 3.1416]),
    "tip mass": (
        {"support": "cantilever", "tip_mass": TIP},
        lambda z: z * mpmath.tan(z) - 1 / mpmath.mpf(TIP), [0.95, 3.5],
    ),
    "tip spring": (
        {"support": "cantilever", "tip_spring": SPRING},
        lambda z: z * mpmath.cot(z) + SPRING, [2.28893, 5.08699],
    ),
}  # fmt: skip
"""The same of a bar in omega L / c; the roots with a tip spring of 2 EA / L are those of
zeta cot zeta = -2 (B 15.22)."""


def roots(equation: Equation, starts: list[float]) -> list[float]:
    return [float(mpmath.findroot(equation, start)) if start else 0.0 for start in starts]


def in_si(keys: dict[str, Any], mass: float, stiffness: float) -> dict[str, Any]:
    """Tip mass and spring in kg and N/m."""
    units = {"tip_mass": mass, "tip_spring": stiffness}
    return {name: value * units[name] if name in units else value for name, value in keys.items()}


@pytest.mark.parametrize("case", BEAMS)
def test_a_beam_has_the_frequencies_of_the_textbook(case: str) -> None:
    keys, equation, starts = BEAMS[case]
    mass, bending = 7850.0 * 0.2 * 4e-5, 2.0e11 * 0.02 * 0.002**3 / 12.0
    beam = Beam(**REED, **in_si(keys, mass, bending / 0.2**3), modes=len(starts))
    wanted = [
        b**2 * math.sqrt(bending / (mass * 0.2**3)) / math.tau for b in roots(equation, starts)
    ]
    assert beam.natural_frequency_hz == pytest.approx(wanted, rel=1e-10)


@pytest.mark.parametrize("case", BARS)
def test_a_bar_has_the_frequencies_of_the_textbook(case: str) -> None:
    keys, equation, starts = BARS[case]
    mass, stiffness = 7850.0 * 0.5 * 1e-4, 2.0e11 * 1e-4 / 0.5
    bar = Bar(**ROD, **in_si(keys, mass, stiffness), modes=len(starts))
    wanted = [z * math.sqrt(stiffness / mass) / math.tau for z in roots(equation, starts)]
    assert bar.natural_frequency_hz == pytest.approx(wanted, rel=1e-10)


# Finite elements --------------------------------------------------------------------------


def assembled(element: np.ndarray, count: int, shared: int) -> np.ndarray:
    """A matrix of `count` equal elements, each of two nodes with `shared` coordinates."""
    whole = np.zeros((shared * (count + 1),) * 2)
    for k in range(count):
        part = slice(shared * k, shared * (k + 2))
        whole[part, part] += element
    return whole


def hermite(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness of a beam of length, mass and EI of 1, in cubic elements."""
    h = 1.0 / count
    stiffness = np.array(
        [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
         [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]
    ) / h**3  # fmt: skip
    mass = np.array(
        [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
         [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]]
    ) * h / 420.0  # fmt: skip
    return assembled(mass, count, 2), assembled(stiffness, count, 2)


def thick(count: int, rotary: float, shear: float) -> tuple[np.ndarray, np.ndarray]:
    """The same of a beam of Timoshenko: linear elements, shear taken at their middles."""
    h = 1.0 / count
    bend = np.array([[0, 0, 0, 0], [0, 1, 0, -1], [0, 0, 0, 0], [0, -1, 0, 1]]) / h
    row = np.array([-1.0 / h, -0.5, 1.0 / h, -0.5])
    inertia = np.array([[2.0, 1.0], [1.0, 2.0]]) * h / 6.0
    mass = np.zeros((4, 4))
    mass[0::2, 0::2], mass[1::2, 1::2] = inertia, rotary * inertia
    return assembled(mass, count, 2), assembled(bend + h * np.outer(row, row) / shear, count, 2)


HELD = {
    "cantilever": [0, 1], "pinned": [0, -2], "clamped": [0, 1, -2, -1],
    "clamped-pinned": [0, 1, -2], "free": [],
}  # fmt: skip
"""Coordinates that a support holds."""


def free_of(support: str, size: int) -> np.ndarray:
    return np.delete(np.arange(size), HELD[support])


@pytest.mark.parametrize("support", HELD)
def test_modes_of_a_beam_are_those_of_finite_elements(support: str) -> None:
    """Frequency, effective mass, and shape^2 / modal mass at a point, which no scale changes."""
    count = 60
    tip = {"tip_mass": 0.3, "tip_spring": 5.0} if support == "cantilever" else {}
    mass, stiffness = hermite(count)
    if tip:
        mass[-2, -2] += tip["tip_mass"]
        stiffness[-2, -2] += tip["tip_spring"]
    kept = free_of(support, len(mass))
    squares, shapes = scipy.linalg.eigh(stiffness[np.ix_(kept, kept)], mass[np.ix_(kept, kept)])
    whole = np.zeros((len(mass), len(kept)))
    whole[kept] = shapes
    beam = Beam(
        length=1.0, area=1.0, second_moment=1.0, young=1.0, density=1.0, support=support, modes=4,
        zeta=0.0, points={"near": 0.2, "end": 1.0}, **tip,
    )  # fmt: skip
    found = beam.table
    first = 2 if support == "free" else 0
    omega = np.sqrt(squares[first:4])
    assert found.omega[first:] == pytest.approx(omega, rel=3e-6)
    carried = mass @ np.tile([1.0, 0.0], count + 1)
    if support != "free":
        effective = (whole[:, :4].T @ carried) ** 2
        assert found.mass * found.participation**2 == pytest.approx(effective, rel=1e-5, abs=1e-9)
    for name, row in (("near", 2 * count // 5), ("end", -2)):
        own = found.shapes[name] ** 2 / found.mass
        wanted = whole[row, first:4] ** 2
        assert own[first:] == pytest.approx(wanted, rel=2e-5, abs=1e-9)
        if support == "free":  # the two rigid motions share one frequency
            assert own[:2].sum() == pytest.approx((whole[row, :2] ** 2).sum(), rel=1e-6)


@pytest.mark.parametrize("support", HELD)
def test_modes_of_a_thick_beam_are_those_of_finite_elements(support: str) -> None:
    ratio = 0.15  # height / length
    beam = Beam(
        length=1.0, width=1.0, height=ratio, young=1.0, density=1.0, support=support, modes=4,
        zeta=0.0, theory="timoshenko", points={"near": 0.25},
    )  # fmt: skip
    area, bending = ratio, ratio**3 / 12.0
    rotary = ratio**2 / 12.0
    shear = rotary * 2.0 * 1.3 / (5.0 / 6.0)
    errors = []
    for count in (80, 160):  # the error falls with the square of the length of an element
        mass, stiffness = thick(count, rotary, shear)
        kept = free_of(support, len(mass))
        squares = scipy.linalg.eigvalsh(
            stiffness[np.ix_(kept, kept)], mass[np.ix_(kept, kept)], subset_by_index=(0, 3)
        )
        errors.append(np.sqrt(np.maximum(squares, 0.0) * bending / area))
    first = 2 if support == "free" else 0
    omega = (4.0 * errors[1] - errors[0])[first:] / 3.0
    assert beam.table.omega[first:] == pytest.approx(omega, rel=3e-5)
    thin = beam.replace(theory="euler-bernoulli").table.omega[first:]
    assert np.all(np.abs(thin / omega - 1.0) > 0.01)  # the test would notice another theory


@pytest.mark.parametrize("theory", ["euler-bernoulli", "timoshenko"])
@pytest.mark.parametrize("support", ["cantilever", "pinned", "clamped", "clamped-pinned"])
def test_the_compliance_of_a_beam_is_that_of_finite_elements(support: str, theory: str) -> None:
    """Cubic elements are exact at their nodes; the error of linear ones falls with the square of
    their length, and is extrapolated."""
    thickness = 0.2 if theory == "timoshenko" else 0.01
    bending, rotary = thickness**3 / 12.0, thickness**2 / 12.0
    shear = rotary * 2.0 * 1.3 / (5.0 / 6.0)
    spring = {"tip_spring": 3.0 * bending} if support == "cantilever" else {}
    beam = Beam(
        length=1.0, width=1.0, height=thickness, young=1.0, density=1.0, support=support, modes=1,
        zeta=0.0, theory=theory, points={"a": 0.3, "b": 0.8}, **spring,
    )  # fmt: skip

    def by_elements(count: int) -> np.ndarray:
        thin = theory == "euler-bernoulli"
        _, stiffness = hermite(count) if thin else thick(count, rotary, shear)
        if spring:
            stiffness[-2, -2] += 3.0
        kept = free_of(support, len(stiffness))
        whole = np.zeros_like(stiffness)
        whole[np.ix_(kept, kept)] = np.linalg.inv(stiffness[np.ix_(kept, kept)])
        rows = [2 * (3 * count // 10), 2 * (8 * count // 10)]
        return whole[np.ix_(rows, rows)] / bending

    wanted = by_elements(10)
    if theory == "timoshenko":
        wanted = (4.0 * by_elements(160) - by_elements(80)) / 3.0
    found = [[beam.flexibility(one, two) for two in (0.3, 0.8)] for one in (0.3, 0.8)]
    assert np.array(found) == pytest.approx(wanted, rel=1e-7)


@pytest.mark.parametrize("kind", ["bar", "beam", "thick beam", "plate"])
def test_modes_and_the_compliance_they_leave_out_make_up_the_whole(kind: str) -> None:
    """The residual compliance falls with the number of modes, and the sum stays."""
    made: dict[str, Callable[[int], Bar | Beam | Plate]] = {
        "bar": lambda n: Bar(**ROD, tip_spring=4e7, modes=n, points={"a": 0.9}),
        "beam": lambda n: Beam(**REED, support="clamped", modes=n, points={"a": 0.4}),
        "thick beam": lambda n: Beam(
            **REED | {"height": 0.04}, theory="timoshenko", modes=n, points={"a": 1.0}
        ),
        "plate": lambda n: Plate(
            **STEEL, length=0.4, width=0.3, height=0.002, modes=n, points={"a": [0.3, 0.4]}
        ),
    }
    left = [made[kind](n).compliance({"a": 1.0}) for n in (1, 3, 6)]
    assert left[0] > left[1] > left[2] > 0.0
    whole = []
    for n, rest in zip((1, 3, 6), left, strict=True):
        table = made[kind](n).table
        whole.append(rest + np.sum(table.shapes["a"] ** 2 / (table.mass * table.omega**2)))
    assert whole == pytest.approx(
        [made[kind](1).flexibility(*[made[kind](1).places_of_points["a"]] * 2)] * 3
    )


def test_the_receptance_of_a_rod_is_that_of_its_closed_form() -> None:
    """Displacement of the free end per unit force there, L tan z / (EA z), z = omega L / c."""
    bar = Bar(**ROD, modes=40)
    table, z = bar.table, 0.9
    omega = z * math.sqrt(2.0e11 / 7850.0) / 0.5
    resonant = np.sum(1.0 / (table.mass * (table.omega**2 - omega**2)))
    closed = 0.5 / (2.0e11 * 1e-4) * math.tan(z) / z
    assert resonant + bar.compliance({"tip": 1.0}) == pytest.approx(closed, rel=1e-5)
    assert abs(resonant / closed - 1.0) > 1e-3  # the modes left out are seen


def by_wave(z: float, chi: float) -> complex:
    """Displacement of the free end of a bar per unit force there, in units of L / EA, where the
    absorption coefficient chi of the material makes its modulus young (1 + j chi / 2 pi)."""
    lossy = 1.0 + 1j * chi / math.tau
    wave = z / np.sqrt(lossy)
    return complex(np.tan(wave) / (lossy * wave))


def to_first_order(z: float, chi: float) -> complex:
    """The same to first order in chi (B 15.11)."""
    damped = chi / (4.0 * math.pi) * (z + 0.5 * math.sin(2.0 * z)) / math.cos(z) ** 2
    return (math.tan(z) - 1j * damped) / z


@pytest.mark.parametrize("z", [0.9, 2.0, 4.0])
def test_the_compliance_of_a_bar_summed_over_modes_is_that_of_its_wave(z: float) -> None:
    """B 6.63 at the free end is B 15.11, up to the square of the loss, and its own wave."""
    chi = 0.015
    bar = Bar(**ROD, modes=60)
    table, stiffness = bar.table, 2.0e11 * 1e-4 / 0.5
    lossy, omega = 1.0 + 1j * chi / math.tau, z * math.sqrt(2.0e11 / 7850.0) / 0.5
    shape = table.shapes["tip"] ** 2 / table.mass
    summed = np.sum(shape / (table.omega**2 * lossy - omega**2))
    summed += bar.compliance({"tip": 1.0}) / lossy
    rest = 2.0 * z**2 / (3.0 * math.pi**4 * (60.0 - 1.0) ** 3)  # of the modes beyond
    assert stiffness * summed == pytest.approx(by_wave(z, chi), abs=rest)
    errors = [abs(to_first_order(z, each) - by_wave(z, each)) for each in (chi, chi / 2.0)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.01)
    assert errors[0] < 0.02 * abs(by_wave(z, chi).imag)


def test_a_plate_has_the_modes_of_two_beams() -> None:
    """Galerkin with sines of its energy, integrated numerically, for one mode and a point."""
    plate = Plate(**STEEL, length=0.4, width=0.3, height=0.002, modes=6, points={"a": [0.25, 0.5]})
    rigidity = 2.0e11 * 0.002**3 / (12.0 * (1.0 - 0.3**2))
    x, y = ((np.arange(400) + 0.5) / 400 for _ in range(2))
    for k, (m, n) in enumerate([(1, 1), (2, 1), (1, 2)]):
        shape = np.outer(np.sin(m * np.pi * x), np.sin(n * np.pi * y))
        curvature = (m * np.pi / 0.4) ** 2 + (n * np.pi / 0.3) ** 2
        cell = 0.4 * 0.3 / 400**2
        kinetic = 7850.0 * 0.002 * np.sum(shape**2) * cell
        elastic = rigidity * np.sum((curvature * shape) ** 2) * cell
        assert plate.table.omega[k] == pytest.approx(math.sqrt(elastic / kinetic), rel=1e-9)
        assert plate.table.mass[k] == pytest.approx(kinetic, rel=1e-9)
        moved = 7850.0 * 0.002 * np.sum(shape) * cell / kinetic
        assert plate.table.participation[k] == pytest.approx(moved, rel=1e-4, abs=1e-9)
        at_a = math.sin(m * math.pi * 0.25) * math.sin(n * math.pi * 0.5)
        assert plate.table.shapes["a"][k] == pytest.approx(at_a, abs=1e-12)


def test_as_many_modes_as_a_frequency_needs() -> None:
    for structure in (
        Beam(**REED, max_frequency_hz=3000.0), Bar(**ROD, max_frequency_hz=3e4),
        Plate(**STEEL, length=0.4, width=0.3, height=0.002, max_frequency_hz=1000.0),
    ):  # fmt: skip
        assert structure.max_frequency_hz is not None
        more = structure.replace(max_frequency_hz=None, modes=len(structure.found) + 1)
        assert structure.natural_frequency_hz[-1] <= structure.max_frequency_hz
        assert more.natural_frequency_hz[-1] > structure.max_frequency_hz
        assert more.natural_frequency_hz[:-1] == pytest.approx(structure.natural_frequency_hz)


def test_many_modes_keep_their_digits() -> None:
    """A beam with sixty modes, whose hyperbolic functions would overflow 60 digits."""
    found = Beam(**REED, modes=60).table
    beta = (np.arange(1, 61) - 0.5) * np.pi
    scale = math.sqrt(2.0e11 * 0.002**2 / 12.0 / 7850.0) / 0.2**2
    assert found.omega[10:] == pytest.approx((beta**2 * scale)[10:], rel=1e-10)
    assert found.mass == pytest.approx(7850.0 * 0.2 * 4e-5 / 4.0, rel=1e-9)


@pytest.mark.parametrize(
    ("made", "sentence"),
    [
        (lambda: Beam(**STEEL, length=1.0, width=0.1, modes=2), "needs width and height, or area"),
        (lambda: Beam(**REED), "needs exactly one of modes and max_frequency_hz, got none"),
        (lambda: Beam(**REED | {"zeta": None}, modes=2), "exactly one of zeta and loss_factor"),
        (lambda: Beam(**REED, modes=2, support="pinned", tip_mass=1.0), "is at the free end"),
        (lambda: Beam(**REED, modes=2, points={"far": 1.2}), "points.far must be at most 1"),
        (lambda: Beam(**REED, max_frequency_hz=1.0), "must be above the lowest natural frequency"),
        (lambda: Bar(**ROD, modes=999), "modes must be at most 200, got 999"),
        (
            lambda: Beam(**REED | {"height": 0.1}, theory="timoshenko", modes=50),
            "higher modes lie above the frequency of shear",
        ),
        (lambda: Beam(**REED, modes=2, points={"base": 1.0}), "names other than 'base'"),
    ],
)  # fmt: skip
def test_what_is_no_structure_is_refused(made: Callable[[], Any], sentence: str) -> None:
    with pytest.raises(SceneError) as refused:
        made()
    assert sentence in str(refused.value)
