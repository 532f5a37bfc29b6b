"""Exact natural modes of a uniform straight member, a bar or a beam.

Lengths are in units of the length of the member, stiffnesses in units of its own, so that a member
is told apart by few numbers. With lambda = omega^2 (mass) (length)^(2h) / (stiffness of the
section), h = 1 for a bar and 2 for a beam, the state along the member obeys y' = A(lambda) y:

    bar         u' = N,             N' = -lambda u
    beam        w' = psi + s V,     psi' = M,     V' = -lambda w,     M' = -V - lambda r psi

(Timoshenko 1921; s = r = 0 is the beam of Euler and Bernoulli). Eigenvalues are counted before they
are computed, so that none is missed: Wittrick & Williams, Q. J. Mech. Appl. Math. 24 (1971) 263.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from stochvi.mathematics.arrays import Matrix, Vector, Whole
from stochvi.mathematics.quadrature import gauss_panels

HALVINGS = 60
"""Number of halvings of an interval that holds one eigenvalue: its ends then differ by rounding."""

POLISHED = 1e-5
"""Relative half width of the interval in which a counted eigenvalue is found again as the root of a
determinant. The count loses half of the digits where an eigenvalue of the member is one of the
member with both ends clamped too."""

RIGID = 1e-11
"""Stiffness against a motion of the ends, relative to the largest, that is a rounding error."""

NODES = 16
"""Number of Gauss-Legendre nodes for each half wave of the highest mode."""

LONGEST_ELEMENT = 0.5
"""Largest phase of a wave along an element, rad: with both ends clamped it has no eigenvalue
below."""


STILL = 1e-9
"""Largest displacement of a mode, relative to its slope, that is a rounding error."""

SHARP = 1e-5
"""Accuracy of the place of a largest displacement, relative to the distance of nodes: the
displacement itself is then accurate to about its square."""

TERMS = 24
"""Number of terms of the series of an exponential: the next one is below 1e-23 of the first."""


class Member(NamedTuple):
    """A uniform member in its own units, and its ends.

    Parameters
    ----------
    held
        Whether displacements are held at the first end and then at the tip: of a bar (u, u), of a
        beam (w, psi, w, psi).
    masses, springs
        Mass and spring at the tip against each displacement that an end has: of a bar (u,), of a
        beam (w, psi), where they are an inertia and a rotational spring.
    shear, rotary
        Of a beam s = (bending stiffness) / (shear stiffness length^2), and
        r = (radius of gyration / length)^2; 0 of a bar.
    """

    held: tuple[bool, ...]
    masses: tuple[float, ...]
    springs: tuple[float, ...]
    shear: float = 0.0
    rotary: float = 0.0

    @property
    def half(self) -> int:
        """Number of displacements at an end: 1 of a bar, 2 of a beam."""
        return len(self.masses)

    def system(self, squares: Vector) -> Matrix:
        """Matrices A (k, 2h, 2h) at the values `squares` (k,) of lambda."""
        h = self.half
        a = np.zeros((len(squares), 2 * h, 2 * h))
        a[:, 0, 1] = 1.0
        if h == 1:
            a[:, 1, 0] = -squares
        else:
            a[:, 0, 2], a[:, 1, 3], a[:, 3, 2] = self.shear, 1.0, -1.0
            a[:, 2, 0], a[:, 3, 1] = -squares, -squares * self.rotary
        return a

    def phase(self, square: float) -> float:
        """An upper bound of the wave number at lambda."""
        if self.half == 1:
            return math.sqrt(square)
        own = square * (self.shear + self.rotary) / 2.0
        return math.sqrt(own + math.sqrt(own**2 + square))

    def tip(self, squares: Vector) -> Matrix:
        """Dynamic stiffness (k, h) of what the tip carries."""
        return np.asarray(np.array(self.springs) - squares[:, None] * np.array(self.masses))

    def fields(self, square: float, places: Vector) -> Matrix:
        """The states (2h, solutions, places) of 2h independent solutions at lambda, in the order of
        `system`. They are even and odd about the middle, and their displacements about 1."""
        if self.half == 1:
            even, odd = _even_and_odd(-square, places)
            size = max(math.sqrt(square), 1.0)
            return np.array([[even, size * odd], [-square * odd, size * even]])
        own = square * (self.shear + self.rotary) / 2.0
        root = math.sqrt((square * (self.shear - self.rotary) / 2.0) ** 2 + square)
        found = []
        for p in (-own - root, (square * (1.0 - square * self.shear * self.rotary)) / (own + root)):
            even, odd = _even_and_odd(p, places)
            q, size = p + self.shear * square, max(math.sqrt(abs(p)), 1.0)
            found.append([even, q * odd, -square * odd, q * even])
            found.append([p * odd, q * even, -square * even, q * p * odd])
            found[-1] = [each / size for each in found[-1]]
        return np.array(found).transpose(1, 0, 2)

    def conditions(self, square: float) -> Matrix:
        """Rows (2h, 2h) of what must vanish at the ends, for the solutions of `fields`, each row
        divided by its natural size."""
        h, states = self.half, self.fields(square, np.array([0.0, 1.0]))
        wave = max(self.phase(square), 1.0)
        moved = wave ** np.arange(h)
        pulled = wave ** (np.array([1.0]) if h == 1 else np.array([3.0, 2.0]))
        carried = self.tip(np.array([square]))[0]
        rows = []
        for k in range(h):
            held, pull = states[k, :, 0] / moved[k], states[h + k, :, 0] / pulled[k]
            rows.append(held if self.held[k] else pull)
        for k in range(h):
            held, pull = states[k, :, 1], states[h + k, :, 1] + carried[k] * states[k, :, 1]
            size = pulled[k] + abs(carried[k]) * moved[k]
            rows.append(held / moved[k] if self.held[h + k] else pull / size)
        return np.array(rows)


class MemberModes(NamedTuple):
    """Modes of a member in its own units, the largest displacement of each being 1.

    Parameters
    ----------
    member
        The member.
    squares
        Eigenvalues lambda (n,), rising; 0 of a rigid motion.
    weights
        Coefficients (n, 2h) of the solutions of `Member.fields`; of a rigid motion the displacement
        and the slope at the first end, then zeros.
    mass
        Modal masses (n,), with those of the tip.
    participation
        Participation factors (n,) of a unit motion of the base.
    overlap
        Integrals (n, n) of the products of two displacements along the member.
    """

    member: Member
    squares: Vector
    weights: Matrix
    mass: Vector
    participation: Vector
    overlap: Matrix

    def shapes(self, places: Vector) -> Matrix:
        """Displacements (places, n) at `places`, in units of the length."""
        return np.asarray(_states(self.member, self.squares, self.weights, places)[0].T)


@lru_cache(maxsize=64)
def member_modes(
    member: Member, count: int | None = None, highest: float | None = None
) -> MemberModes:
    """The lowest `count` modes of a member, or those up to the eigenvalue `highest`.

    Examples
    --------
    >>> cantilever = Member((True, True, False, False), (0.0, 0.0), (0.0, 0.0))
    >>> found = member_modes(cantilever, count=2)
    >>> (found.squares**0.25).round(9).tolist(), found.mass.round(12).tolist()
    ([1.875104069, 4.694091133], [0.25, 0.25])
    """
    free = np.flatnonzero(~np.array(member.held))
    rigid = _rigid_motions(member, free)
    if count is None:
        assert highest is not None
        count = max(int(_counted(member, free, np.array([highest]))[0]), len(rigid))
    squares = np.concatenate(
        [np.zeros(min(count, len(rigid))), _eigenvalues(member, free, len(rigid), count)]
    )
    weights = [*rigid[:count]]
    weights += [_null_vector(member.conditions(square)) for square in squares[len(weights) :]]
    return _normalised(member, squares, np.array(weights).reshape(count, 2 * member.half))


def static_compliance(member: Member, places: Vector) -> Matrix | None:
    """Displacement (places, places) at each place per unit force at each other one, at rest; None
    if the member is free to move."""
    free = np.flatnonzero(~np.array(member.held))
    if len(_rigid_motions(member, free)):
        return None
    h = member.half
    rest = member.system(np.zeros(1))[0]

    def along(length: float) -> Matrix:
        return np.asarray(scipy.linalg.expm(rest * max(length, 0.0)))

    start = np.zeros((2 * h, h))
    end = np.zeros((h, 2 * h))
    for k in range(h):
        start[h + k if member.held[k] else k, k] = 1.0
        if member.held[h + k]:
            end[k, k] = 1.0
        else:
            end[k, h + k], end[k, k] = 1.0, member.springs[k]
    push = np.zeros(2 * h)
    push[h] = -1.0  # a force lowers the force of the section behind it
    found = np.zeros((len(places), len(places)))
    for j, at in enumerate(places):
        known = np.linalg.solve(end @ along(1.0) @ start, -end @ along(1.0 - at) @ push)
        for i, seen in enumerate(places):
            state = along(seen) @ start @ known
            if seen > at:
                state = state + along(seen - at) @ push
            found[i, j] = state[0]
    return found


def _even_and_odd(p: float, places: Vector) -> tuple[Vector, Vector]:
    """Solutions C and S of f'' = p f about the middle, C even and S odd, S' = C, both of them
    divided by their size at the ends where they grow."""
    x = places - 0.5
    if p <= 0.0:
        a = math.sqrt(-p)
        return np.cos(a * x), x * np.sinc(a * x / math.pi)
    b = math.sqrt(p)
    rising, falling = np.exp(b * (x - 0.5)), np.exp(-b * (x + 0.5))
    odd = (rising - falling) / (2.0 * b) if b > 1e-3 else x * math.exp(-b / 2.0)
    return (rising + falling) / 2.0, odd


def _rigid_motions(member: Member, free: Whole) -> Matrix:
    """Motions without strain (k, 2h): displacement and slope at the first end, then zeros."""
    h = member.half
    stiffness = _stiffness(member, np.zeros(1), 1)[0][0]
    stiffness[range(h, 2 * h), range(h, 2 * h)] += np.array(member.springs)
    if not len(free):
        return np.zeros((0, 2 * h))
    values, vectors = np.linalg.eigh(stiffness[np.ix_(free, free)])
    soft = np.abs(values) <= RIGID * np.abs(values).max()
    found = np.zeros((int(soft.sum()), 2 * h))
    for row, vector in zip(found, vectors[:, soft].T, strict=True):
        ends = np.zeros(2 * h)
        ends[free] = vector
        row[:h] = ends[:h]
    return found


def _stiffness(member: Member, squares: Vector, elements: int) -> tuple[Matrix, Whole]:
    """Dynamic stiffness (k, 2h, 2h) between the ends, and the number of eigenvalues below each
    lambda with both ends clamped; `elements` is a power of 2."""
    h = member.half
    passed = _exponential(member.system(squares) / elements)
    t11, t12 = passed[:, :h, :h], passed[:, :h, h:]
    t22 = passed[:, h:, h:]
    inverse = np.linalg.inv(t12)
    first, link, second = inverse @ t11, -inverse, t22 @ inverse
    count = np.zeros(len(squares), np.int64)
    for _ in range(elements.bit_length() - 1):
        middle = first + second
        middle = (middle + middle.transpose(0, 2, 1)) / 2.0
        count = 2 * count + (np.linalg.eigvalsh(middle) < 0.0).sum(axis=1)
        inner = np.linalg.inv(middle)
        back = link.transpose(0, 2, 1)
        first, link, second = (
            first - link @ inner @ back,
            -link @ inner @ link,
            second - back @ inner @ link,
        )
    whole = np.concatenate(
        [
            np.concatenate([first, link], axis=2),
            np.concatenate([link.transpose(0, 2, 1), second], axis=2),
        ],
        axis=1,
    )
    return whole, count


def _exponential(matrices: Matrix) -> Matrix:
    """Exponentials of matrices (k, n, n) whose eigenvalues are below 1, by their series."""
    term = np.broadcast_to(np.eye(matrices.shape[1]), matrices.shape)
    total = term.copy()
    for order in range(1, TERMS):
        term = term @ matrices / order
        total += term
    return total


def _counted(member: Member, free: Whole, squares: Vector) -> Whole:
    """Number of eigenvalues below each lambda (Wittrick & Williams).

    Each lambda has as many elements as it needs: more of them would cost digits.
    """
    h = member.half
    longest = [max(member.phase(float(square)) / LONGEST_ELEMENT, 1.0) for square in squares]
    halvings = np.ceil(np.log2(longest)).astype(int)
    found = np.zeros(len(squares), np.int64)
    for each in np.unique(halvings):
        these = np.flatnonzero(halvings == each)
        whole, count = _stiffness(member, squares[these], 1 << int(each))
        whole[:, range(h, 2 * h), range(h, 2 * h)] += member.tip(squares[these])
        inner = whole[:, free[:, None], free]
        if len(free):
            inner = (inner + inner.transpose(0, 2, 1)) / 2.0
            count = count + (np.linalg.eigvalsh(inner) < 0.0).sum(axis=1)
        found[these] = count
    return found


def _eigenvalues(member: Member, free: Whole, rigid: int, count: int) -> Vector:
    """The eigenvalues number rigid + 1 to `count`."""
    wanted = np.arange(rigid + 1, count + 1)
    if not len(wanted):
        return np.zeros(0)
    top = 1.0
    while _counted(member, free, np.array([top]))[0] < count:
        top *= 4.0
    # in units of the wave number, so that the halvings suit all modes
    power = 1.0 / (2.0 * member.half)
    low, high = np.zeros(len(wanted)), np.full(len(wanted), top**power)
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        above = _counted(member, free, middle ** (2 * member.half)) >= wanted
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.array([_polished(member, float(each)) for each in high]) ** (2 * member.half)


def _polished(member: Member, number: float) -> float:
    """A root of the determinant of the conditions at the ends by its wave number, next to the
    counted one; the counted one where there is no change of sign."""

    def determinant(trial: float) -> float:
        return float(np.linalg.det(member.conditions(trial ** (2 * member.half))))

    low, high = number * (1.0 - POLISHED), number * (1.0 + POLISHED)
    if determinant(low) * determinant(high) > 0.0:
        return number
    return float(scipy.optimize.brentq(determinant, low, high, xtol=1e-15 * number, rtol=1e-15))


def _null_vector(matrix: Matrix) -> Vector:
    """The vector that a matrix takes closest to 0."""
    return np.asarray(np.linalg.svd(matrix)[2][-1])


def _states(member: Member, squares: Vector, weights: Matrix, places: Vector) -> Matrix:
    """Displacement and, of a beam, slope (h, n, places) of the modes."""
    h = member.half
    found = np.zeros((h, len(squares), len(places)))
    for mode, (square, own) in enumerate(zip(squares, weights, strict=True)):
        if square == 0.0:
            slope = own[1] if h == 2 else 0.0
            found[0, mode] = own[0] + slope * places
            found[1:, mode] = slope
        else:
            found[:, mode] = np.einsum("s,hsx->hx", own, member.fields(square, places)[:h])
    return found


def _normalised(member: Member, squares: Vector, weights: Matrix) -> MemberModes:
    """The modes, orthogonal and with a largest displacement of 1."""
    panels = max(2, math.ceil(member.phase(float(squares.max(initial=0.0))) / math.pi))
    places, steps = gauss_panels(np.linspace(0.0, 1.0, panels + 1), NODES)
    places, steps = np.append(places, [0.0, 1.0]), np.append(steps, [0.0, 0.0])
    states = _states(member, squares, weights, places)
    still = squares == 0.0
    if still.sum() > 1:  # two rigid motions are mixed until they are orthogonal
        _, mixed = scipy.linalg.eigh(_masses(member, states[:, still], steps))
        weights[still] = mixed.T @ weights[still]
    size = np.array(
        [_largest(member, *mode, places) for mode in zip(squares, weights, strict=True)]
    )
    weights = weights / size[:, None]
    states = _states(member, squares, weights, places)
    mass = np.diag(_masses(member, states, steps)).copy()
    along = states[0] @ steps + member.masses[0] * states[0][:, -1]
    return MemberModes(
        member, squares, weights, mass, along / mass, (states[0] * steps) @ states[0].T
    )


def _masses(member: Member, states: Matrix, steps: Vector) -> Matrix:
    """Mass matrix (n, n) of modes from their states (h, n, places), the last place the tip."""
    inertia, tip = (1.0, member.rotary), states[:, :, -1]
    found = np.zeros((states.shape[1],) * 2)
    for k, each in enumerate(states):
        found += inertia[k] * (each * steps) @ each.T
        found += member.masses[k] * np.outer(tip[k], tip[k])
    return found


def _largest(member: Member, square: float, weights: Vector, places: Vector) -> float:
    """The largest displacement of a mode, with its sign; of a mode without displacement, which a
    beam that gives way to shear has, the largest slope."""
    states = _states(member, np.array([square]), weights[None], places)[:, 0]
    if np.abs(states[0]).max() <= STILL * np.abs(states).max():
        return float(states[-1][np.argmax(np.abs(states[-1]))])
    order = np.argsort(places)
    rank = int(np.argmax(np.abs(states[0][order])))
    place, size = places[order][rank], float(states[0][order][rank])
    if place in (0.0, 1.0):
        return size
    ends = places[order][rank - 1], places[order][rank + 1]

    def displacement(at: float) -> float:
        found = _states(member, np.array([square]), weights[None], np.array([at]))
        return float(found[0, 0, 0])

    top = scipy.optimize.minimize_scalar(
        lambda at: -abs(displacement(at)), bounds=ends, method="bounded",
        options={"xatol": SHARP * (ends[1] - ends[0])},
    )  # fmt: skip
    return math.copysign(max(abs(size), -float(top.fun)), size)
