"""The Fokker-Planck equation of one box as sparse matrices: in time, with ends that may absorb.

Symbols: xi in [-1, 1] displacement and u velocity in the units of the box (`LinearBox`), as in
`box_solver`: the density is p = M q with M = exp(-u^2 / 2 - energy(xi)), N_i are the functions that
both q and the tests are made of. Then

    mass dq/dt = -matrix q,    mass_ij = int M N_i N_j,

and the transpose is Kolmogorov's backward equation, mass dy/dt = -matrix' y. y(xi, u, t) is the
mean of any function of the state at t of a path that is at (xi, u) now. An end with a restitution
gives back what it takes; one without absorbs it. Unknowns are scaled by the size of their functions
under M, which may be 1e-30 of others. The smallest are then solved for with as many digits as the
largest.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from stochvi.mathematics.arrays import Array
from stochvi.mathematics.beta_distribution import BetaDistribution
from stochvi.mathematics.quadrature import gauss_panels
from stochvi.methods.fokker_planck.basis import Mesh, legendre
from stochvi.methods.fokker_planck.linear_boxes import LinearBox
from stochvi.methods.fokker_planck.restitution_rule import restitution_rule

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
        linear = np.arange(velocity.elements + 1)
        constant[:, 0, velocity.plus[linear]] = constant[:, 0, velocity.minus[linear]] = 1.0
        self.unity: Array = constant.ravel() / self.scale
        self.outflow: Array = np.zeros(len(self.scale))
        for side, wall in ((-1, walls.left), (1, walls.right)):
            if wall is None:
                self.outflow += box.time * self.arrivals(side, velocity.half_moments[1])

    def factorised(self, shift: float) -> Factors:
        """LU factors of matrix + shift mass; `shift` per unit time of the box."""
        return Factors(sparse.csc_array(self.matrix + shift * self.mass))

    def _weight(self, xi: float) -> float:
        return float(np.exp(self.box.log_weight(np.array([xi])))[0])

    def _assemble(self) -> tuple[sparse.csc_array, sparse.csc_array]:
        """Sums of products of matrices in displacement and in velocity."""
        box, velocity = self.box, self.mesh.velocity
        products, pushed, up, down = self._displacement_matrices()
        spread = box.diffusion * velocity.diffusion
        spread += (box.damping - box.diffusion) * velocity.damping
        matrix = _kron(products, spread) - _kron(pushed, velocity.drift)
        matrix = matrix + _kron(up, velocity.flux_plus) + _kron(down, velocity.flux_minus)
        for side, restitution in ((-1, self.walls.left), (1, self.walls.right)):
            if restitution is not None:
                end = self._end(side)
                given = self._given_back(restitution, side)
                matrix = matrix - _kron(self._weight(side) * np.outer(end, end), given)
        mass = _kron(products, self._velocity_mass())
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

    def _velocity_mass(self) -> Array:
        velocity = self.mesh.velocity
        u, weights = gauss_panels(velocity.breaks, velocity.nodes)
        values, _ = velocity.values(u)
        half = values.T @ ((weights * np.exp(-(u**2) / 2.0))[:, None] * values)
        return velocity.both(half, half)

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
        _, given = velocity.wall(np.array([restitution]))
        whole[np.ix_(inward, outward)] = given[0]
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
        velocity = self.mesh.velocity
        found = np.zeros((len(u), velocity.size))
        half, _ = velocity.values(np.minimum(np.abs(u), velocity.breaks[-1]))
        up = u >= 0.0
        found[np.ix_(up, velocity.plus)] = half[up]
        found[np.ix_(~up, velocity.minus)] = half[~up]
        return found

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
        reach = np.union1d(-velocity.breaks, velocity.breaks)
        slow = v_grid / box.speed
        u, u_weights = gauss_panels(
            np.union1d(reach, slow[np.abs(slow) < velocity.breaks[-1]]), GRID_NODES
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
        speeds = np.zeros(velocity.size)
        speeds[velocity.plus] += velocity.half_moments[v_power]
        speeds[velocity.minus] += (-1.0) ** v_power * velocity.half_moments[v_power]
        unit = box.half_length**x_power * box.speed**v_power
        whole: Array = unit * (profile[..., None] * speeds).ravel() * self.scale
        return whole

    def arrivals(self, side: int, half: Array) -> Array:
        """A functional of the density of speeds that arrive at an end, (n,).

        `half` holds int over u > 0 of u M N_k w for the functions of u >= 0, with w what is
        counted; the result is per second.
        """
        velocity = self.mesh.velocity
        speeds = np.zeros(velocity.size)
        speeds[velocity.plus if side > 0 else velocity.minus] = half
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
        found = np.zeros(len(xi))
        values = profiles @ (q @ self.mesh.velocity.mass)
        found[inside] = np.exp(box.log_weight(xi[inside])) * values / box.half_length
        return found


GRID_NODES = 10
"""Number of Gauss-Legendre nodes between neighbours of the grids that resolve a density."""
