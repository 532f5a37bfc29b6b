"""The Fokker-Planck equation in time. Chapters: sparse matrices of a box whose ends may absorb;
states at any time from one factorisation; initial states; the box and the meshes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu
from scipy.special import ndtr

from stochvi.mathematics.impact_rates import BetaDistribution, normal_density
from stochvi.mathematics.numerics import Array, gauss_panels
from stochvi.mathematics.units import CHECKS, shown, with_checks
from stochvi.methods.fokker_planck.basis import LinearBox, Mesh, legendre
from stochvi.methods.fokker_planck.motion import box_ends, restitution_rule, turning_stops
from stochvi.model.model import UPPER, Model, Stop
from stochvi.results.errors import NotConverged
from stochvi.scenes.impact_laws import Restitution

# ------------------------------------------------------------------------------
# The Fokker-Planck equation of one box as sparse matrices: in time, with ends that may absorb.
#
# Symbols: xi in [-1, 1] displacement and u velocity in the units of the box (`LinearBox`), as in
# `stationary`: the density is p = M q with M = exp(-u^2 / 2 - energy(xi)), N_i are the functions
# that both q and the tests are made of. Then
#
#     mass dq/dt = -matrix q,    mass_ij = int M N_i N_j,
#
# and the transpose is Kolmogorov's backward equation, mass dy/dt = -matrix' y. y(xi, u, t) is the
# mean of any function of the state at t of a path that is at (xi, u) now. An end with a restitution
# gives back what it takes; one without absorbs it. Unknowns are scaled by the size of their
# functions under M, which may be 1e-30 of others. The smallest are then solved for with as many
# digits as the largest.
# ------------------------------------------------------------------------------


Density = Callable[[Array, Array], Array]
"""A probability density of (displacement, velocity), broadcasting, SI units."""


class EndConditions(NamedTuple):
    """The restitution at either end of a box, or its distribution where it scatters; None where the
    end absorbs."""

    left: float | BetaDistribution | None
    right: float | BetaDistribution | None


class Factors:
    """LU factors of a sparse matrix whose pattern is symmetric."""

    def __init__(self, matrix: sparse.csc_array) -> None:
        self._factors = splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=PIVOT_THRESHOLD,
            options={"SymmetricMode": True},
        )

    def solve(self, right: Array) -> Array:
        """Solution of matrix x = right, (n,)."""
        return np.asarray(self._factors.solve(right), dtype=np.float64)

    def solve_transposed(self, right: Array) -> Array:
        """Solution of matrix' x = right with the transpose, (n,)."""
        solution = self._factors.solve(right, "T")  # type: ignore[call-overload]  # not in the stubs
        return np.asarray(solution, dtype=np.float64)


PIVOT_THRESHOLD = 0.1
"""Smallest diagonal pivot relative to the largest entry of its column. Pivots that respect the
symmetry of the pattern need a sixth of the fill and a tenth of the time of free ones. The residuals
are the same."""


def _kron(of_displacement: Array, of_velocity: Array) -> sparse.csr_array:
    sides = sparse.csr_array(of_displacement), sparse.csr_array(of_velocity)
    return sparse.csr_array(sparse.kron(*sides, format="csr"))


class Operator:
    """The matrices of one box on one mesh, and functionals of its functions.

    Attributes
    ----------
    matrix, mass
        The matrices of the equations above, scaled, (n, n), per unit time of the box.
    unity
        Scaled coefficients of the function 1, (n,).
    outflow
        Probability that absorbing ends take per unit time of the box, as a functional of the
        coefficients, (n,): matrix' unity, but without the rounding that would let some flow out
        everywhere.
    """

    def __init__(self, box: LinearBox[float], mesh: Mesh, walls: EndConditions) -> None:
        self.box, self.mesh, self.walls = box, mesh, walls
        velocity = mesh.velocity
        self._shape = (len(mesh.displacement), mesh.x_degree + 1, velocity.size)
        matrix, mass = self._assemble()
        self.scale: Array = 1.0 / np.sqrt(mass.diagonal())
        scale = sparse.diags_array(self.scale)
        self.matrix = sparse.csc_array(scale @ matrix @ scale)
        self.mass = sparse.csc_array(scale @ mass @ scale)
        constant = np.zeros(self._shape)
        # P_0, and the linear functions of velocity, which add up to 1
        constant[:, 0, : velocity.vertices] = 1.0
        self.unity: Array = constant.ravel() / self.scale
        self.outflow: Array = np.zeros(len(self.scale))
        for side, wall in ((-1, walls.left), (1, walls.right)):
            if wall is None:
                self.outflow += box.time * self.arrivals(side, velocity.moments[side][1])

    def factorised(self, shift: float) -> Factors:
        """LU factors of matrix + shift mass; `shift` per unit time of the box."""
        return Factors(sparse.csc_array(self.matrix + shift * self.mass))

    def _weight(self, xi: float) -> float:
        return float(np.exp(self.box.log_weight(np.array([xi])))[0])

    def _assemble(self) -> tuple[sparse.csc_array, sparse.csc_array]:
        """Sums of products of matrices in displacement and in velocity."""
        box, known = self.box, self.mesh.velocity.matrices
        products, pushed, up, down = self._displacement_matrices()
        spread = box.diffusion * known["diffusion"]
        spread = spread + (box.damping - box.diffusion) * known["damping"]
        matrix = _kron(products, spread) - _kron(pushed, known["drift"])
        matrix = matrix + _kron(up, known["plus"]) + _kron(down, known["minus"])
        for side, restitution in ((-1, self.walls.left), (1, self.walls.right)):
            if restitution is not None:
                end = self._end(side)
                given = self._given_back(restitution, side)
                matrix = matrix - _kron(self._weight(side) * np.outer(end, end), given)
        mass = _kron(products, known["mass"])
        return sparse.csc_array(matrix), sparse.csc_array(mass)

    def _displacement_matrices(self) -> tuple[Array, Array, Array, Array]:
        """Integrals of M N_i N_j, of M N_i N_j force, and of the transport for u > 0 and for u < 0.

        Between elements the flux is taken from the side that it comes from.
        """
        elements, size = self.mesh.displacement, self._shape[1]
        products, pushed, up, down = np.zeros((4, len(elements) * size, len(elements) * size))
        for e, element in enumerate(elements):
            here = slice(e * size, (e + 1) * size)
            after, before = (slice((e + k) * size, (e + k + 1) * size) for k in (1, -1))
            weights = element.weights * np.exp(self.box.log_weight(element.xi))
            push = self.box.force + self.box.stiffness * element.xi
            products[here, here] = (weights @ element.products).reshape(size, size)
            pushed[here, here] = ((weights * push) @ element.products).reshape(size, size)
            slopes = (weights @ element.slope_products).reshape(size, size)
            right, left = self._weight(element.right), self._weight(element.left)
            up[here, here] = right * np.outer(element.at_right, element.at_right) - slopes
            down[here, here] = -left * np.outer(element.at_left, element.at_left) - slopes
            if e + 1 < len(elements):
                down[here, after] = right * np.outer(element.at_right, elements[e + 1].at_left)
            if e > 0:
                up[here, before] = -left * np.outer(element.at_left, elements[e - 1].at_right)
        return products, pushed, up, down

    def _end(self, side: int) -> Array:
        """Values of the functions of displacement at the left (-1) or right (1) end."""
        values = np.zeros(self._shape[:2])
        place = -1 if side > 0 else 0
        element = self.mesh.displacement[place]
        values[place] = element.at_right if side > 0 else element.at_left
        return values.ravel()

    def _given_back(self, restitution: float | BetaDistribution, side: int) -> Array:
        """Matrix of the flux that an end gives back, (test, trial) in velocity; its mean where the
        restitution scatters."""
        if isinstance(restitution, BetaDistribution):
            nodes, weights = restitution_rule(restitution)
            parts = [p * self._given_back(r, side) for r, p in zip(nodes, weights, strict=True)]
            return np.asarray(np.sum(parts, axis=0))
        velocity = self.mesh.velocity
        outward, inward = velocity.plus, velocity.minus
        if side < 0:
            outward, inward = inward, outward
        whole = np.zeros((velocity.size, velocity.size))
        whole[np.ix_(inward, outward)] = velocity.returned(np.array([restitution]), side)[0]
        return whole

    def _profiles(self, xi: Array) -> Array:
        """Values of all functions of displacement, (place, element, polynomial)."""
        elements = self.mesh.displacement
        found = np.zeros((len(xi), len(elements), elements[0].size))
        inner = np.array([element.right for element in elements[:-1]])
        here = np.searchsorted(inner, xi, side="right")
        for e in np.unique(here):
            at = here == e
            found[at, e], _ = legendre(elements[e].degree, elements[e].local(xi[at]))
        return found

    def _speeds(self, u: Array) -> Array:
        """Values of all functions of velocity, (velocity, function)."""
        return self.mesh.velocity.values(np.clip(u, -self.mesh.reach, self.mesh.reach))

    def at(self, x: float, v: float) -> Array:
        """The functions at a point, (n,): times coefficients, the value of a function there."""
        profile = self._profiles(self.box.xi(np.array([x])))[0]
        speeds = self._speeds(np.array([v / self.box.speed]))[0]
        values: Array = (profile[..., None] * speeds).ravel() * self.scale
        return values

    def integrals(self, density: Density, x_grid: Array, v_grid: Array) -> Array:
        """Integrals of density N_i over the box, (n,).

        Gauss's rule between the mesh points and those of two grids that resolve the density.
        """
        box, velocity = self.box, self.mesh.velocity
        ends = np.asarray(self.mesh.x_breaks)
        inside = box.xi(x_grid)
        xi, x_weights = gauss_panels(np.union1d(ends, inside[np.abs(inside) < 1.0]), GRID_NODES)
        slow = v_grid / box.speed
        u, u_weights = gauss_panels(
            np.union1d(velocity.breaks, slow[np.abs(slow) < self.mesh.reach]), GRID_NODES
        )
        values = density(box.centre + box.half_length * xi[:, None], box.speed * u)
        # the unit of the density is 1 / (m m/s)
        values = values * (box.half_length * box.speed * x_weights[:, None] * u_weights)
        profiles = self._profiles(xi).reshape(len(xi), -1)
        whole = profiles.T @ values @ self._speeds(u)
        return np.asarray(whole.ravel() * self.scale, dtype=np.float64)

    def moment(self, x_power: int, v_power: int) -> Array:
        """Mean of (x - centre)^i v^j, SI, of p = M q, as a functional of coefficients, (n,)."""
        box, velocity = self.box, self.mesh.velocity
        profile = np.stack(
            [
                (element.weights * np.exp(box.log_weight(element.xi)) * element.xi**x_power)
                @ element.values
                for element in self.mesh.displacement
            ]
        )
        speeds = velocity.functional(velocity.u**v_power)
        unit = box.half_length**x_power * box.speed**v_power
        whole: Array = unit * (profile[..., None] * speeds).ravel() * self.scale
        return whole

    def arrivals(self, side: int, speeds: Array) -> Array:
        """A functional of the density of speeds that arrive at an end, (n,).

        `speeds` holds int over side * u > 0 of abs(u) M N_k w, with w what is counted; the result
        is per second.
        """
        weight = self._weight(float(side)) / self.box.time
        found: Array = weight * np.outer(self._end(side), speeds).ravel() * self.scale
        return found

    def density(self, coefficients: Array, x: Array, v: Array) -> Array:
        """p = M q at the points of two equally long arrays, per metre and metre a second."""
        box = self.box
        xi, u = box.xi(x), v / box.speed
        inside = (np.abs(xi) <= 1.0) & (np.abs(u) <= self.mesh.reach)
        found = np.zeros(len(xi))
        q = (coefficients * self.scale).reshape(-1, self.mesh.velocity.size)
        profiles = self._profiles(xi[inside]).reshape(int(inside.sum()), -1)
        values = np.einsum("pi,pi->p", profiles @ q, self._speeds(u[inside]))
        weight = np.exp(box.log_weight(xi[inside]) - u[inside] ** 2 / 2.0)
        # coefficients make p a density in the units of the box
        found[inside] = weight * values / (box.half_length * box.speed)
        return found

    def displacement_density(self, coefficients: Array, x: Array) -> Array:
        """Density at displacements, the integral of p over v, per metre."""
        box = self.box
        xi = box.xi(x)
        inside = np.abs(xi) <= 1.0
        q = (coefficients * self.scale).reshape(-1, self.mesh.velocity.size)
        profiles = self._profiles(xi[inside]).reshape(int(inside.sum()), -1)
        found, speeds = np.zeros(len(xi)), self.mesh.velocity.moments
        values = profiles @ (q @ (speeds[1][0] + speeds[-1][0]))
        found[inside] = np.exp(box.log_weight(xi[inside])) * values / box.half_length
        return found


GRID_NODES = 10
"""Number of Gauss-Legendre nodes between neighbours of the grids that resolve a density."""


# ------------------------------------------------------------------------------
# Functions of the Fokker-Planck operator: states at any time from one factorisation.
#
# mass dy/dt = -matrix y + source is projected on the Krylov space of (matrix + shift mass)^-1 (I.
# Moret and P. Novati, BIT 44 (2004) 595; V. Druskin, L. Knizhnerman, SIAM J. Matrix Anal. Appl. 19
# (1998) 755). The slow modes are found first; they alone are left at long times. The fastest hardly
# enter, which a stiff solver in time would have to damp. Some dozens of solutions with one
# factorisation give all times at once. The change from one size of the space to a larger one
# measures the error of the projection.
# ------------------------------------------------------------------------------


SIZES = (16, 24, 34, 46, 62, 84, 112, 150, 200, 260)
"""Dimensions of the Krylov space at which its answer is compared with the one before."""

Solve = Callable[[Array], Array]


class Projection(NamedTuple):
    """The operator and a source on a Krylov space.

    `basis` (n, k) is orthonormal under the mass matrix, `operator` (k, k) and `source` (k,) are
    those of dy/dt = -operator y + source in its coordinates.
    """

    basis: Array
    operator: Array
    source: Array

    def accumulated(self, times: Array) -> Array:
        """y(t) from y(0) = 0, that is int_0^t exp(-operator s) source ds, (times, k).

        NaN where modes that grow have grown beyond `GROWN`.
        """
        size = len(self.source)
        whole = np.zeros((size + 1, size + 1))
        whole[:size, :size], whole[:size, size] = -self.operator, self.source
        with np.errstate(over="ignore", invalid="ignore"):
            found = np.array([expm(whole * time)[:size, size] for time in times]).reshape(-1, size)
        # sums of NaN raise no warning, unlike sums of infinite or very large numbers
        found[~(np.abs(found) < GROWN).all(axis=1)] = np.nan
        return found


GROWN = 1e100
"""Size of a state above which it must be a mode of the mesh that grows without bound."""


def projections(mass: csc_array, solve: Solve, source: Array, shift: float) -> Iterator[Projection]:
    """Projections of growing size, by Arnoldi's iteration.

    Parameters
    ----------
    solve
        b -> (matrix + shift mass)^-1 b, or of the transpose.
    source
        The right side of mass dy/dt = -matrix y + source, (n,).
    """
    first = solve(source)
    size = float(np.sqrt(first @ (mass @ first)))
    most = SIZES[-1]
    basis = np.empty((len(first), most + 1), order="F")
    hessenberg = np.zeros((most + 1, most))
    basis[:, 0] = first / size
    for k in range(most):
        new = solve(mass @ basis[:, k])
        for _ in range(2):  # twice is enough for orthogonality to rounding
            overlap = basis[:, : k + 1].T @ (mass @ new)
            new -= basis[:, : k + 1] @ overlap
            hessenberg[: k + 1, k] += overlap
        length = float(np.sqrt(max(new @ (mass @ new), 0.0)))
        hessenberg[k + 1, k] = length
        done = length <= KRYLOV_END * abs(hessenberg[: k + 1, k]).max()
        if k + 1 in SIZES or done:
            yield _projection(basis[:, : k + 1], hessenberg[: k + 1, : k + 1], size, shift)
        if done:
            return
        basis[:, k + 1] = new / length


KRYLOV_END = 1e-14
"""Relative size below which the part of a vector outside the Krylov space is a rounding error."""


def _projection(basis: Array, hessenberg: Array, size: float, shift: float) -> Projection:
    inverse = np.asarray(np.linalg.inv(hessenberg), dtype=np.float64)
    # the first vector is (operator + shift)^-1 source
    return Projection(basis, inverse - shift * np.eye(len(inverse)), size * inverse[:, 0])


@dataclass(frozen=True, kw_only=True)
class TimeGroups:
    """Which times share a Krylov space, and the poles of the spaces.

    The phase of a time is the time multiplied by the rate of the inner dynamics. The numbers were
    found best by trial at damping ratios from 0.005 to 0.5.

    Parameters
    ----------
    late
        Phase from which on only the slowest modes matter: all later times are one group.
    ratio
        Ratio of the latest to the earliest time of any group before that.
    faster
        Ratio of the poles of the spaces of neighbouring groups: short times call for faster modes.
    most
        Largest number of groups. Phases shorter than late / ratio^most share the fastest pole.
    """

    late: float = 25.0
    ratio: float = 8.0
    faster: float = 5.0
    most: int = 6


GROUPS = TimeGroups()
"""Settings of the groups of times of all transients."""


def time_groups(times: Array, natural: float) -> Iterator[tuple[NDArray[np.intp], float]]:
    """Groups of times that share a Krylov space, as indices, each with the pole of its space.

    `natural` is the rate of the inner dynamics, and `GROUPS` holds the settings.
    """
    phase = np.maximum(times * natural, GROUPS.late / GROUPS.ratio**GROUPS.most)
    number = np.ceil(np.maximum(np.log(GROUPS.late / phase) / np.log(GROUPS.ratio), 0.0)).astype(
        int
    )
    for group in np.unique(number):
        yield np.flatnonzero(number == group), natural * GROUPS.faster**group


class SlowestMode(NamedTuple):
    """The mode that decays last where paths are absorbed: `forward` is it as a density, `backward`
    as a function of the start.

    matrix forward = rate mass forward, and the transpose for `backward`; `forward` holds the mass
    1, and `backward` is scaled so that a path that starts at z survives with probability
    backward(z) exp(-rate t) in the end. Times are those of the box.
    """

    rate: float
    forward: Array
    backward: Array


MOST_ITERATIONS = 200
"""Largest number of inverse iterations."""

SETTLED = 1e-12
"""Relative change of the rate in one inverse iteration at which the iteration ends."""


def slowest_mode(operator: Operator, factors: Factors) -> SlowestMode:
    """Slowest mode by inverse iteration, with the factors of the matrix itself.

    The rate is the outflow of the mode over its mass. Unlike a Rayleigh quotient, which is the
    difference of numbers of the size of the inner dynamics, this keeps its digits however small
    the rate.
    """
    mass, outflow = operator.mass, operator.outflow
    held = mass @ operator.unity
    ahead, back = operator.unity, operator.unity
    rate = 0.0
    for _ in range(MOST_ITERATIONS):
        ahead, back = factors.solve(mass @ ahead), factors.solve_transposed(mass @ back)
        ahead, back = ahead / (held @ ahead), back / np.sqrt(back @ (mass @ back))
        before, rate = rate, float(outflow @ ahead)
        if abs(rate - before) <= SETTLED * rate:
            break
    # the part of the function 1 along the mode: (ahead, 1) = 1 = (ahead, mass back) scale
    return SlowestMode(rate, ahead, back / (ahead @ (mass @ back)))


# ------------------------------------------------------------------------------
# Initial states of an oscillator: a point, or a Gaussian distribution of displacement and velocity.
# ------------------------------------------------------------------------------


TAIL = 8.5
"""Number of standard deviations beyond which a Gaussian distribution has less than 2e-17 of its
probability."""

GRID = np.linspace(-TAIL, TAIL, 18)
"""Ends, in standard deviations, of Gauss-Legendre panels that resolve a Gaussian distribution."""


class InitialState(NamedTuple):
    """A displacement (m) and a velocity (m/s)."""

    x: float
    v: float


@with_checks
@dataclass(frozen=True, kw_only=True)
class Gaussian:
    """A Gaussian distribution of displacement (m) and velocity (m/s).

    Parameters
    ----------
    mean
        Means of displacement (m) and velocity (m/s).
    covariance
        Symmetric and positive definite, ((m^2, m^2/s), (m^2/s, m^2/s^2)).

    See Also
    --------
    stochvi.transient : Transients, which may start from it.

    Examples
    --------
    >>> Gaussian(mean=(0.0, 0.0), covariance=((1.0, 0.0), (0.0, 4.0))).deviations
    (1.0, 2.0)
    """

    mean: tuple[float, float]
    covariance: tuple[tuple[float, float], tuple[float, float]]

    def __post_init__(self) -> None:
        mean, matrix = np.asarray(self.mean, dtype=float), np.asarray(self.covariance, dtype=float)
        if mean.shape != (2,) or matrix.shape != (2, 2):
            raise ValueError(
                "mean must be (m, m/s) and covariance 2 by 2, got shapes "
                f"{mean.shape} and {matrix.shape}"
            )
        determinant = matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]
        good = np.isfinite(mean).all() and np.isfinite(matrix).all()
        good = good and math.isclose(matrix[0, 1], matrix[1, 0], rel_tol=ALIKE)
        if not (good and matrix[0, 0] > 0.0 and matrix[1, 1] > 0.0 and determinant > 0.0):
            raise ValueError(
                f"covariance must be finite, symmetric and positive definite, got {self.covariance}"
            )

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard deviations of displacement and velocity."""
        return math.sqrt(self.covariance[0][0]), math.sqrt(self.covariance[1][1])

    def density(self, x: Array, v: Array) -> Array:
        """Joint density per metre and per metre a second; the arguments are broadcast."""
        (xx, xv), (_, vv) = self.covariance
        determinant = xx * vv - xv * xv
        a, b = x - self.mean[0], v - self.mean[1]
        exponent = (vv * a**2 - 2.0 * xv * a * b + xx * b**2) / determinant
        density: Array = np.exp(-exponent / 2.0) / (2.0 * math.pi * math.sqrt(determinant))
        return density

    def displacement_density(self, x: Array) -> Array:
        """Density of the displacement, 1/m."""
        return normal_density(x, self.mean[0], self.deviations[0])

    def grids(self) -> tuple[Array, Array]:
        """Displacements and velocities between which the density is smooth.

        The grids are as fine as the law of either given the other.
        """
        (xx, xv), (_, vv) = self.covariance
        narrow = math.sqrt(1.0 - xv**2 / (xx * vv))
        steps = min(math.ceil((len(GRID) - 1) / narrow), MOST_STEPS)
        scaled = np.linspace(-TAIL, TAIL, steps + 1)
        return tuple(  # type: ignore[return-value]
            centre + deviation * scaled
            for centre, deviation in zip(self.mean, self.deviations, strict=True)
        )

    def beyond(self, lower: float, upper: float) -> float:
        """Probability of displacements outside the barriers."""
        deviation = self.deviations[0]
        below = ndtr((lower - self.mean[0]) / deviation)
        above = ndtr((self.mean[0] - upper) / deviation)
        return float(below + above)


MOST_STEPS = 200
"""Largest number of panels for a Gaussian distribution whose displacement and velocity are nearly
dependent."""

ALIKE = 1e-9
"""Largest relative difference of the two covariances of a matrix that counts as symmetric, because
rounding may leave so much."""

Start = InitialState | Gaussian
StartChoice = Literal["rest", "stationary"] | tuple[float, float] | Gaussian
"""The forms in which a user may give a start: at rest where spring and load balance, the stationary
law without barriers and stops, a point (m, m/s), a law."""


def _check_start(name: str, value: object) -> None:
    if isinstance(value, str | Gaussian):
        return
    try:
        CHECKS["ArrayLike"](name, value)
    except ValueError:
        raise ValueError(
            f"{name} must be 'rest', 'stationary', a point (m, m/s) or a Gaussian, got "
            f"{shown(value)}"
        ) from None


CHECKS["StartChoice"] = _check_start


def start_of(given: StartChoice, model: Model) -> Start:
    """The initial state from any of the forms in which a user may give it.

    Raises
    ------
    ValueError
        If it is not one of the words, or the motion has no place of rest or no stationary
        distribution.
    """
    if isinstance(given, Gaussian):
        return given
    if not isinstance(given, str):
        point = np.asarray(given, dtype=float)
        if point.shape != (2,) or not np.isfinite(point).all():
            raise ValueError(f"start must be a finite (displacement, velocity), got {shown(given)}")
        return InitialState(float(point[0]), float(point[1]))
    if given not in ("rest", "stationary"):
        raise ValueError(
            f"start must be 'rest', 'stationary', a point or a Gaussian, got {given!r}"
        )
    if model.omega == 0.0 and model.load != 0.0:
        raise ValueError(
            f"start must be a point or a Gaussian where no spring balances the load, got {given!r}"
        )
    if given == "rest":
        return InitialState(model.rest, 0.0)
    if model.omega == 0.0 or model.damping_rate == 0.0:
        raise ValueError(
            "start = 'stationary' needs a stiffness and a damping above 0, got 0 for one of them; "
            "start from a point or a Gaussian"
        )
    square = model.intensity / 2.0 / model.damping_rate
    return Gaussian(
        mean=(model.rest, 0.0), covariance=((square / model.omega**2, 0.0), (0.0, square))
    )


# ------------------------------------------------------------------------------
# The box and the meshes on which a motion is followed in time.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ExtentSettings:
    """How far a box reaches in velocity and displacement, and the scale of its velocities.

    The density is solved for relative to the weight exp(-u^2 / 2), u the velocity in units of the
    scale of speed.

    Parameters
    ----------
    reach
        Largest speed beyond the one needed to reach a barrier, in scales, added as squares; or
        number of standard deviations that noise may add. Faster states are left out: exp(-reach^2 /
        2) = 2e-8 of the density.
    widest
        Largest velocity in units of the scale. Further out the weight is too small to be a good
        scale of the density.
    flattest
        Largest velocity in units of the scale, wherever the damping allows so large a scale. A
        weight that falls faster than the stationary distribution lets modes of the mesh grow
        without bound.
    start_margin
        Speed that a path may gain beyond its initial speed, in units of the scale.
    tail_kept
        Number of standard deviations of an initial Gaussian distribution that the box must hold.
    """

    reach: float = 6.0
    widest: float = 12.0
    flattest: float = 2.0
    start_margin: float = 2.0
    tail_kept: float = 6.0


EXTENT = ExtentSettings()
"""Settings of the extent of all boxes."""


@dataclass(frozen=True, kw_only=True)
class ElementSettings:
    """How a box is cut into elements of displacement and of velocity.

    Parameters
    ----------
    x_ratio, u_ratio
        Length of each thin element towards an absorbing end, and towards zero velocity, relative to
        the one before it.
    growth
        Ratio of the lengths of neighbouring elements of velocity outside the core, where the
        density falls.
    fewest
        Smallest number of elements along a box, times the element size of the level.
    layer_share
        Largest element of velocity at a level of the size 1, in units of the speed that noise gives
        to a path behind an absorbing end.
    steepest
        Largest fall of the potential energy per unit mass along one unit of length, in squares of
        the scale of speed.
    coarsest
        Largest element of velocity, in units of the scale of speed.
    """

    x_ratio: float = 0.15
    u_ratio: float = 0.3
    growth: float = 1.5
    fewest: float = 3.2
    layer_share: float = 2.0
    steepest: float = 8.0
    coarsest: float = 2.0


ELEMENTS = ElementSettings()
"""Settings of the elements of all boxes."""


class Layout(NamedTuple):
    """A box with the conditions at its ends, and the scales that its mesh has to resolve, in units
    of its speed.

    `reach` is the largest velocity, `core` the velocity up to which the mesh stays fine; `length`
    is the number of scales to be resolved along the box; `finest` is the smallest scale of
    velocity. `halved` boxes hold the right half of a symmetric one, whose paths come back from the
    centre as their mirror images.
    """

    box: LinearBox[float]
    walls: EndConditions
    reach: float
    core: float
    length: float
    finest: float
    halved: bool

    @property
    def natural(self) -> float:
        """The rate of the inner dynamics: of oscillation or of crossing the box."""
        return max(math.sqrt(-self.box.stiffness), 1.0)


class Level(NamedTuple):
    """Element size in units of the scales to be resolved, polynomial degrees, and number of layers
    towards an end."""

    size: float
    x_degree: int
    u_degree: int
    x_layers: int
    u_layers: int


LEVELS = (
    Level(0.8, 3, 4, 3, 3),
    Level(0.6, 4, 5, 4, 3),
    Level(0.42, 4, 5, 5, 4),
    Level(0.32, 5, 6, 6, 4),
    Level(0.24, 5, 6, 7, 5),
    Level(0.18, 5, 6, 8, 5),
)
"""Meshes of growing fineness, from some hundredths of a second to some ten seconds each."""

MOST_UNKNOWNS = 120_000
"""Largest number of unknowns of a mesh: it takes some 10 seconds, and 0.5 GB for the
projections."""


def lowest(model: Model, lower: float, upper: float) -> float:
    """Where the potential energy of spring and load is lowest between two displacements."""
    return min(max(model.rest, lower), upper)


def rise(model: Model, x: float, base: float) -> float:
    """Potential energy per unit mass at x over that at `base`."""
    return (x - base) * (model.omega**2 * (x + base) / 2.0 - model.load)


def restitutions(stops: Iterable[Stop]) -> EndConditions:
    """What stops give back at either end of a box; all where there is no stop."""
    found: list[float | BetaDistribution] = [1.0, 1.0]
    for stop in stops:
        law = stop.law
        assert isinstance(law, Restitution)
        found[int(stop.side == UPPER)] = law.restitution if law.scatter is None else law.scatter
    return EndConditions(*found)


def passage_layout(model: Model, lower: float, upper: float, start: Start) -> Layout:
    """Layout between absorbing barriers; for an infinite one the box ends at the stop of that side,
    or far from the other.

    The scale of speed is the largest of three: that of the stationary distribution, the speed that
    takes a path to a barrier, and the speed that noise adds on the way there.
    """
    turning = turning_stops(model, lower, upper)
    base = lowest(model, *box_ends(model, lower, upper))
    low, high = lower, upper = _relevant_barriers(model, lower, upper, base)
    for stop in turning:  # it ends the box, which a barrier out of reach does not
        low, high = (low, stop.position) if stop.side == UPPER else (stop.position, high)
    barriers = [x for x in (lower, upper) if math.isfinite(x)]
    climb = math.sqrt(max(2.0 * max(rise(model, x, base) for x in barriers), 0.0))
    length = high - low
    if not math.isfinite(length):
        length = max(abs(barriers[0] - base), abs(_place(start) - barriers[0]))
    native = max(climb, math.cbrt(model.intensity / 2.0 * length))
    law = _rms_speed(model)
    energy = _start_energy(model, start, low, high, base)
    slow = min(law, native)
    # the energy that noise may add before the path reaches a barrier that it has the energy for
    gained = climb + EXTENT.reach * _layer(model, length)
    fastest = max(
        min(math.hypot(climb, EXTENT.reach * slow), gained),
        math.sqrt(2.0 * max(energy, 0.0)) + EXTENT.start_margin * slow,
    )
    speed = max(min(law, max(slow, fastest / EXTENT.flattest)), fastest / EXTENT.widest)
    left = lower if math.isfinite(lower) else max(low, _end(model, base, fastest, -1.0))
    right = upper if math.isfinite(upper) else min(high, _end(model, base, fastest, 1.0))
    middle = (left + right) / 2.0
    off_centre = abs(model.load - model.omega**2 * middle) * (right - left)
    halved = len(barriers) == 2 and off_centre <= SYMMETRIC * speed**2
    back = restitutions(turning)
    walls = EndConditions(
        1.0 if halved else back.left if math.isinf(lower) else None,
        back.right if math.isinf(upper) else None,
    )
    return _layout(
        model, (middle if halved else left, right), speed, walls, halved,
        reach=fastest, core=climb + slow, native=native,
    )  # fmt: skip


def _rms_speed(model: Model) -> float:
    """Rms velocity of the stationary distribution without barriers, m/s; infinite without
    damping."""
    if model.damping_rate == 0.0:
        return math.inf
    return math.sqrt(model.intensity / 2.0 / model.damping_rate)


def _climbs(model: Model, lower: float, upper: float, base: float) -> tuple[float, float]:
    """Speeds at the lowest place that just reach the lower and the upper barrier, m/s."""
    first, second = (
        math.sqrt(max(2.0 * rise(model, x, base), 0.0)) if math.isfinite(x) else math.inf
        for x in (lower, upper)
    )
    return first, second


def barrier_height(model: Model, lower: float, upper: float) -> float:
    """Speed that just reaches the lower of two barriers, in rms velocities; 0 without damping."""
    climbs = _climbs(model, lower, upper, lowest(model, *box_ends(model, lower, upper)))
    return min(climbs) / _rms_speed(model)


def _relevant_barriers(
    model: Model, lower: float, upper: float, base: float
) -> tuple[float, float]:
    """The barriers, infinite for one that is reached less than exp(-reach^2 / 2) times as often as
    the other."""
    first, second = _climbs(model, lower, upper, base)
    most = math.hypot(min(first, second), EXTENT.reach * _rms_speed(model))
    return (lower if first <= most else -math.inf), (upper if second <= most else math.inf)


SYMMETRIC = 1e-12
"""Largest difference of the potential energies per unit mass at two barriers, in squares of the
scale of speed, with which they count as symmetric: rounding leaves less."""


def stops_layout(
    model: Model, left: float, right: float, walls: EndConditions, speed: float, start: Start
) -> Layout:
    """Layout between stops; for an infinite one the box ends far out; `speed` is its scale, m/s."""
    base = lowest(model, left, right)
    energy = _start_energy(model, start, left, right, base)
    fastest = max(
        EXTENT.reach * speed, math.sqrt(2.0 * max(energy, 0.0)) + EXTENT.start_margin * speed
    )
    speed = max(speed, fastest / EXTENT.widest)
    left = left if math.isfinite(left) else _end(model, base, fastest, -1.0)
    right = right if math.isfinite(right) else _end(model, base, fastest, 1.0)
    native = math.cbrt(model.intensity / 2.0 * (right - left))
    return _layout(
        model, (left, right), speed, walls, False,
        reach=fastest, core=3.0 * speed, native=max(native, speed),
    )  # fmt: skip


def _layout(
    model: Model, ends: tuple[float, float], speed: float, walls: EndConditions, halved: bool,
    *, reach: float, core: float, native: float,
) -> Layout:  # fmt: skip
    length = ends[1] - ends[0]
    steepest = max(abs(model.load - model.omega**2 * x) for x in ends)
    layer = _layer(model, length)
    return Layout(
        box=LinearBox.between(model, *ends, speed),
        walls=walls,
        reach=reach / speed,
        core=core / speed,
        length=max(length * model.omega / speed, length * steepest / speed**2 / ELEMENTS.steepest),
        finest=min(1.0, native / speed, ELEMENTS.layer_share * layer / speed),
        halved=halved,
    )


def _layer(model: Model, length: float) -> float:
    """The speed that noise gives in a natural period or on the way through the box."""
    layer = math.cbrt(model.intensity / 2.0 * length)
    if model.omega > 0.0:
        layer = min(layer, math.sqrt(math.pi * model.intensity / model.omega))
    return layer


def _place(start: Start) -> float:
    return start.mean[0] if isinstance(start, Gaussian) else start.x


def _start_energy(model: Model, start: Start, lower: float, upper: float, base: float) -> float:
    """Highest energy of a start that matters, per unit mass, m^2/s^2."""
    if not isinstance(start, Gaussian):
        return start.v**2 / 2.0 + rise(model, start.x, base)
    dx, dv = start.deviations
    ends = (
        max(start.mean[0] - EXTENT.tail_kept * dx, lower),
        min(start.mean[0] + EXTENT.tail_kept * dx, upper),
    )
    fastest = abs(start.mean[1]) + EXTENT.tail_kept * dv
    highest = max(rise(model, x, base) for x in ends)
    # the extremes of both at once are rarer still
    return max(fastest**2 / 2.0, highest)


def _end(model: Model, base: float, speed: float, side: float) -> float:
    """Farthest place that a path reaches with this speed at the lowest place, m."""
    slope = abs(model.load - model.omega**2 * base)
    energy = speed**2 / 2.0
    if model.omega > 0.0 and model.load == model.omega**2 * base:
        slope = 0.0
    pull = slope + math.sqrt(slope**2 + 2.0 * model.omega**2 * energy)
    return base + side * (2.0 * energy / pull if pull > 0.0 else math.inf)


def meshes(layout: Layout) -> Iterator[Mesh]:
    """The meshes of all levels that have not too many unknowns, two at least."""
    for number, level in enumerate(LEVELS):
        found = mesh(layout, level)
        if number > 1 and found.unknowns > MOST_UNKNOWNS:
            return
        yield found


def mesh(layout: Layout, level: Level) -> Mesh:
    """Mesh of a level, with narrow elements where slow paths meet an absorbing end."""
    size = level.size * layout.finest
    count = max(_whole(ELEMENTS.fewest / level.size), _whole(layout.length / size))
    if count > MOST_UNKNOWNS:
        raise NotConverged(
            f"the density cannot be followed in time: its mesh would need {count:.2g} elements, as "
            "the scales of spring, load, noise and stops are too far apart; simulate this scene"
        )
    ends = np.linspace(-1.0, 1.0, count + 1)
    inner = ends[1:-1].tolist()
    layers = (ends[1] - ends[0]) * ELEMENTS.x_ratio ** np.arange(1, level.x_layers + 1)
    if layout.walls.right != 1.0:
        inner += (1.0 - layers).tolist()
    if layout.walls.left != 1.0:
        inner += (layers - 1.0).tolist()
    return Mesh(
        x_breaks=(-1.0, *sorted(inner), 1.0),
        x_degree=level.x_degree,
        u_breaks=_velocities(layout, level, size),
        u_degree=level.u_degree,
    )


def _whole(number: float) -> int:
    """Next whole number from a ratio, which rounding must not change with the units."""
    return math.ceil(number - 1e-9)


def _velocities(layout: Layout, level: Level, size: float) -> tuple[float, ...]:
    count = max(1, _whole(min(layout.core, layout.reach) / size))
    step = min(layout.core, layout.reach) / count
    breaks = [0.0, *(step * ELEMENTS.u_ratio**k for k in range(level.u_layers, 0, -1))]
    breaks += [step * k for k in range(1, count + 1)]
    while breaks[-1] < layout.reach - step / 2.0:
        breaks.append(
            breaks[-1] + min(ELEMENTS.growth * (breaks[-1] - breaks[-2]), ELEMENTS.coarsest)
        )
    if len(breaks) > 2 and layout.core < layout.reach:
        breaks[-1] = layout.reach
    return tuple(breaks)
