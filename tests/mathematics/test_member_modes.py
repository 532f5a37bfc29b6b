"""Modes of bars and beams against characteristic equations of textbooks, and against elements."""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
import pytest
import scipy

from stochvi.mathematics.member_modes import Member, member_modes, static_compliance

CANTILEVER = (True, True, False, False)
PINNED = (True, False, True, False)
CLAMPED = (True, True, True, True)
CLAMPED_PINNED = (True, True, True, False)
FREE = (False, False, False, False)

cos, cosh, sin, sinh = mpmath.cos, mpmath.cosh, mpmath.sin, mpmath.sinh


def beam(held: tuple[bool, ...], *, mass: float = 0.0, spring: float = 0.0) -> Member:
    return Member(held, (mass, 0.0), (spring, 0.0))


def bar(held: tuple[bool, bool], *, mass: float = 0.0, spring: float = 0.0) -> Member:
    return Member(held, (mass,), (spring,))


TEXTBOOK: dict[str, tuple[Member, Callable[..., object], tuple[float, float, float]]] = {
    "cantilever": (
        beam(CANTILEVER), lambda k: cos(k) + 1 / cosh(k), (1.875, 4.694, 7.855)
    ),
    "pinned": (beam(PINNED), sin, (3.14, 6.28, 9.42)),
    "clamped": (beam(CLAMPED), lambda k: cos(k) - 1 / cosh(k), (4.730, 7.853, 10.996)),
    "clamped-pinned": (
        beam(CLAMPED_PINNED), lambda k: sin(k) - cos(k) * mpmath.tanh(k), (3.927, 7.069, 10.21)
    ),
    "tip mass": (
        beam(CANTILEVER, mass=0.5),
        lambda k: 1 + cos(k) * cosh(k) + 0.5 * k * (cos(k) * sinh(k) - sin(k) * cosh(k)),
        (1.42, 4.11, 7.19),
    ),
    "tip spring": (
        beam(CANTILEVER, spring=20.0),
        lambda k: (1 + cos(k) * cosh(k)) * k**3
        - 20.0 * (cos(k) * sinh(k) - sin(k) * cosh(k)),
        (2.6, 4.8, 7.9),
    ),
    "bar fixed-free": (bar((True, False)), cos, (1.57, 4.71, 7.85)),
    "bar fixed": (bar((True, True)), sin, (3.14, 6.28, 9.42)),
    "bar tip mass": (
        bar((True, False), mass=0.8), lambda k: cos(k) - 0.8 * k * sin(k), (0.94, 3.5, 6.5)
    ),
    "bar tip spring": (
        bar((True, False), spring=2.0), lambda k: k * cos(k) + 2.0 * sin(k), (2.289, 5.087, 8.1)
    ),
}  # fmt: skip
"""Members, their characteristic functions of the wave number, and guesses of three roots."""


@pytest.mark.parametrize("name", TEXTBOOK)
def test_frequencies_are_the_roots_of_textbooks(name: str) -> None:
    member, characteristic, guesses = TEXTBOOK[name]
    roots = [float(mpmath.findroot(characteristic, guess)) for guess in guesses]
    found = member_modes(member, count=3).squares ** (0.5 / member.half)
    assert found == pytest.approx(roots, rel=1e-12)


@pytest.mark.parametrize(("held", "rigid"), [(FREE, 2), ((False, False), 1)])
def test_a_free_member_has_rigid_motions_and_the_frequencies_of_a_held_one(
    held: tuple[bool, ...], rigid: int
) -> None:
    nothing = (0.0,) * (len(held) // 2)
    found = member_modes(Member(held, nothing, nothing), count=rigid + 2)
    both_held = member_modes(Member((True,) * len(held), nothing, nothing), count=2)
    assert found.squares[:rigid].tolist() == [0.0] * rigid
    assert found.squares[rigid:] == pytest.approx(both_held.squares, rel=1e-12)


def test_a_bar_on_a_rigid_stop_has_the_roots_of_the_book() -> None:
    """B 15.22: zeta cot zeta = -2."""
    found = member_modes(bar((True, False), spring=2.0), count=2).squares ** 0.5
    assert found == pytest.approx([2.28893, 5.08699], abs=5e-6)


def test_no_mode_is_missed_among_two_hundred() -> None:
    found = member_modes(beam(CANTILEVER), count=200).squares ** 0.25
    assert found[10:] == pytest.approx((np.arange(11, 201) - 0.5) * np.pi, rel=1e-12)


def test_modes_up_to_a_frequency_are_all_modes_below_it() -> None:
    squares = member_modes(beam(CLAMPED), count=8).squares
    between = (squares[4] + squares[5]) / 2.0
    assert member_modes(beam(CLAMPED), highest=between).squares == pytest.approx(squares[:5])


def test_a_pinned_beam_of_timoshenko_has_two_families_and_one_of_shear() -> None:
    shear, rotary = 0.3, 0.1
    waves = np.pi * np.arange(1, 30)
    half = (1.0 + waves**2 * (shear + rotary)) / (2.0 * shear * rotary)
    root = np.sqrt(half**2 - waves**4 / (shear * rotary))
    exact = np.sort([*(half - root), *(half + root), 1.0 / (shear * rotary)])
    found = member_modes(Member(PINNED, (0.0, 0.0), (0.0, 0.0), shear, rotary), count=12)
    assert found.squares == pytest.approx(exact[:12], rel=1e-12)


def elements(member: Member, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness of a member of Timoshenko in `count` elements with the exact statics of
    each (Przemieniecki), without the held displacements."""
    h = 1.0 / count
    phi = 12.0 * member.shear / h**2
    k = np.array([[12, 6 * h, -12, 6 * h], [0, (4 + phi) * h**2, -6 * h, (2 - phi) * h**2],
                  [0, 0, 12, -6 * h], [0, 0, 0, (4 + phi) * h**2]])  # fmt: skip
    k = k / (h**3 * (1 + phi))
    k = np.triu(k) + np.triu(k, 1).T
    # displacement and rotation of an element from its ends, integrated by quadrature
    nodes, weights = np.polynomial.legendre.leggauss(6)
    x = (nodes + 1.0) / 2.0
    w = np.array([1 - 3 * x**2 + 2 * x**3 + (1 - x) * phi,
                  h * (x - 2 * x**2 + x**3 + (x - x**2) * phi / 2),
                  3 * x**2 - 2 * x**3 + x * phi,
                  h * (-(x**2) + x**3 - (x - x**2) * phi / 2)]) / (1 + phi)  # fmt: skip
    turn = np.array([6 * (x**2 - x) / h, 1 - 4 * x + 3 * x**2 + (1 - x) * phi,
                     6 * (x - x**2) / h, 3 * x**2 - 2 * x + x * phi]) / (1 + phi)  # fmt: skip
    m = h / 2.0 * ((w * weights) @ w.T + member.rotary * (turn * weights) @ turn.T)
    size = 2 * count + 2
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    for each in range(count):
        part = slice(2 * each, 2 * each + 4)
        mass[part, part] += m
        stiffness[part, part] += k
    tip = np.arange(size - 2, size)
    mass[tip, tip] += member.masses
    stiffness[tip, tip] += member.springs
    ends = [0, 1, size - 2, size - 1]
    gone = [place for place, held in zip(ends, member.held, strict=True) if held]
    kept = np.setdiff1d(np.arange(size), gone)
    return mass[np.ix_(kept, kept)], stiffness[np.ix_(kept, kept)]


@pytest.mark.parametrize("held", [CANTILEVER, PINNED, CLAMPED_PINNED, FREE])
def test_a_beam_with_all_there_is_at_its_tip_agrees_with_finite_elements(
    held: tuple[bool, ...],
) -> None:
    loose = not held[2]
    member = Member(
        held, (0.4 if loose else 0.0, 0.03), (5.0 if loose else 0.0, 2.0), shear=0.02, rotary=0.006
    )
    found = member_modes(member, count=4)
    coarse, middle, fine = (
        scipy.linalg.eigh(*elements(member, count)[::-1], eigvals_only=True)[:4]
        for count in (40, 80, 160)
    )
    # the error of these elements falls with the square of their length
    first, second = middle + (middle - coarse) / 3.0, fine + (fine - middle) / 3.0
    error = np.abs(second - first)
    assert np.all(error[2:] < 1e-5 * second[2:])
    assert np.all(np.abs(found.squares - second) <= error + 1e-8 * second)


def test_modal_masses_and_participation_are_those_of_finite_elements() -> None:
    member = Member(CANTILEVER, (0.3, 0.01), (0.0, 0.0), shear=0.01, rotary=0.004)
    found = member_modes(member, count=3)
    tips = found.shapes(np.array([1.0]))[0]
    mass, stiffness = elements(member, 160)
    _, vectors = scipy.linalg.eigh(stiffness, mass)
    shapes = vectors[:, :3] / vectors[-2, :3]  # 1 at the tip
    whole, _ = elements(Member(FREE, member.masses, member.springs, 0.01, 0.004), 160)
    moved = (whole @ np.tile([1.0, 0.0], 161))[2:]
    own = np.diag(shapes.T @ mass @ shapes)
    assert found.mass / tips**2 == pytest.approx(own, rel=1e-4)
    assert found.participation * tips == pytest.approx(shapes.T @ moved / own, rel=1e-4)
    middle = found.shapes(np.array([0.5]))[0] / tips
    assert middle == pytest.approx(shapes[158], rel=1e-4)


@pytest.mark.parametrize(
    "member",
    [
        beam(CANTILEVER, mass=0.5),
        beam(PINNED),
        beam(
            CLAMPED,
        ),
    ],
)
def test_modes_are_orthogonal(member: Member) -> None:
    found = member_modes(member, count=20)
    tips = found.shapes(np.array([1.0]))[0]
    mass = found.overlap + member.masses[0] * np.outer(tips, tips)
    size = np.sqrt(np.outer(found.mass, found.mass))
    assert mass / size == pytest.approx(np.eye(20), abs=1e-11)


@pytest.mark.parametrize(
    "member",
    [beam(CANTILEVER, spring=3.0), beam(PINNED), beam(CLAMPED_PINNED), bar((True, False))],
)
def test_static_compliance_is_the_sum_over_all_modes(member: Member) -> None:
    places = np.array([0.25, 0.6, 1.0])
    found = member_modes(member, count=200)
    shapes = found.shapes(places)
    summed = (shapes / (found.mass * found.squares)) @ shapes.T
    whole = static_compliance(member, places)
    assert whole == pytest.approx(whole.T, abs=1e-14)
    # what 200 modes leave out is of the order 1 / 200 of a bar, and 1 / 200^3 of a beam
    assert summed == pytest.approx(whole, abs=3e-3 if member.half == 1 else 1e-8)


def test_static_compliance_of_a_cantilever_is_that_of_a_table() -> None:
    places = np.array([0.4, 1.0])
    exact = [[0.4**3 / 3.0, 0.4**2 * (3.0 - 0.4) / 6.0], [0.4**2 * (3.0 - 0.4) / 6.0, 1.0 / 3.0]]
    assert static_compliance(beam(CANTILEVER), places) == pytest.approx(np.array(exact), rel=1e-12)
    assert static_compliance(beam(FREE), places) is None
