"""Half-range Galerkin: the stationary Fokker-Planck equation of many boxes at once.

Symbols (`Boxes`): the density is p(xi, u) = M q with M = exp(-u^2 / 2 - energy(xi)), and

    0 = -u dp/dxi - d/du [(force + stiffness xi - damping u) p] + diffusion d2p/du2,

a particle that arrives at an end with speed w leaves it with R w. Multiplied by any function phi
and integrated over the box (n: outwards) this is

    - int p (u phi_xi + (force + stiffness xi) phi_u)
    + int M (diffusion q_u + (damping - diffusion) u q) phi_u
    + sum over ends of int over w > 0 of w p(end, n w) [phi(end, n w) - phi(end, -n R w)] dw = 0.

On every element q is a polynomial in xi times piecewise polynomials in u, which are continuous but
may have a kink at u = 0. phi runs through the same functions. Between elements the flux is taken
from the side that it comes from.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Array
from stochvi.methods.fokker_planck.basis import DisplacementElement, Mesh, VelocityBasis, legendre
from stochvi.methods.fokker_planck.linear_boxes import Boxes


class BoxMoments(NamedTuple):
    """Stationary averages in the units of the box; at either end per unit time.

    `rate` counts arrivals faster than the threshold; `speed_rate`, `speed_square_rate` are F1
    and F2; `unresolved` is the part of `rate` of impacts that would turn round within the last
    element: of speeds below (diffusion length)^(1/3). `crossing_rate` is that of the mean, upwards.
    """

    mean: Array
    mean_square: Array
    velocity_mean_square: Array
    crossing_rate: Array
    rate_left: Array
    rate_right: Array
    speed_rate_left: Array
    speed_rate_right: Array
    speed_square_rate_left: Array
    speed_square_rate_right: Array
    unresolved_left: Array
    unresolved_right: Array


def box_moments(boxes: Boxes, mesh: Mesh, threshold: Array) -> BoxMoments:
    """Solve every box on one mesh; `threshold` is the slowest arrival to count, per box."""
    return _averages(boxes, mesh, _density(boxes, mesh), threshold)


def _density(boxes: Boxes, mesh: Mesh) -> list[Array]:
    """Coefficients of q, (box, Legendre, velocity) for each element, not yet normalised.

    All that lies beyond one end of an element acts on it as a boundary condition: a matrix of the
    returned flux. The stops are the first of them. Each element on the way to the middle one is
    eliminated into the next.
    """
    elements = mesh.displacement
    last = len(elements) // 2
    left = _stop(boxes, mesh, -1)
    right = _stop(boxes, mesh, 1)
    passed: dict[int, Array] = {}
    for e in range(last):
        left, passed[e] = _pass(boxes, mesh, e, 1, left)
    for e in range(len(elements) - 1, last, -1):
        right, passed[e] = _pass(boxes, mesh, e, -1, right)
    found = {
        last: _pinned(
            _with_walls(boxes, elements[last], mesh.velocity, left, right), elements[last]
        )
    }
    for e in range(last + 1, len(elements)):
        trace = np.einsum("bjk,j->bk", found[e - 1], elements[e - 1].at_right)
        found[e] = np.einsum("bjkl,bl->bjk", passed[e], trace[:, mesh.velocity.plus])
    for e in range(last - 1, -1, -1):
        trace = np.einsum("bjk,j->bk", found[e + 1], elements[e + 1].at_left)
        found[e] = np.einsum("bjkl,bl->bjk", passed[e], trace[:, mesh.velocity.minus])
    return [found[e] for e in range(len(elements))]


def _block(boxes: Boxes, element: DisplacementElement, velocity: VelocityBasis) -> Array:
    """The equations inside an element, (box, test j, test k, trial j, trial k)."""
    weights = element.weights * np.exp(boxes.log_weight(element.xi))
    push = boxes.force[:, None] + boxes.stiffness[:, None] * element.xi
    size = (len(weights), element.size, element.size)
    products = (weights @ element.products).reshape(size)
    slopes = (weights @ element.slope_products).reshape(size)
    pushed = ((weights * push) @ element.products).reshape(size)
    terms = np.stack(
        [
            -slopes,
            -pushed,
            boxes.diffusion[:, None, None] * products,
            (boxes.damping - boxes.diffusion)[:, None, None] * products,
        ],
        axis=-1,
    )
    matrices = np.stack(
        [velocity.flux_plus + velocity.flux_minus, velocity.drift, velocity.diffusion,
         velocity.damping]
    )  # fmt: skip
    block = terms @ matrices.reshape(4, -1)
    shape = (*size, velocity.size, velocity.size)
    return np.ascontiguousarray(block.reshape(shape).transpose(0, 1, 3, 2, 4))


def _weight_at(boxes: Boxes, xi: float) -> Array:
    return np.exp(boxes.log_weight(np.full((1, 1), xi)))[:, :, None]


def _stop(boxes: Boxes, mesh: Mesh, side: int) -> Array:
    """Matrices of the densities that arrive at a stop and that leave it, (box, test, trial)."""
    velocity = mesh.velocity
    restitution = boxes.restitution_left if side < 0 else boxes.restitution_right
    inward, outward = velocity.minus, velocity.plus
    if side < 0:
        inward, outward = outward, inward
    taken, given = velocity.wall(restitution)
    wall = np.zeros((len(restitution), velocity.size, velocity.size))
    wall[:, outward[:, None], outward] += taken
    wall[:, inward[:, None], outward] -= given
    return wall * _weight_at(boxes, float(side))


def _with_walls(
    boxes: Boxes, element: DisplacementElement, velocity: VelocityBasis, left: Array, right: Array
) -> Array:
    """The equations of an element with the conditions at both ends, as square matrices."""
    signs = np.outer(element.at_left, element.at_left)[None, :, None, :, None]
    block = _block(boxes, element, velocity)
    block += signs * left[:, None, :, None, :]
    block += right[:, None, :, None, :]
    size = block.shape[1] * block.shape[2]
    return block.reshape(len(block), size, size)


def _pass(boxes: Boxes, mesh: Mesh, e: int, step: int, behind: Array) -> tuple[Array, Array]:
    """Eliminate an element: the boundary condition of it and all behind it, and its response.

    `step` is 1 if the elimination runs to the right. The response maps the trace of q that comes
    in through the open end to the coefficients of q.
    """
    element, velocity = mesh.displacement[e], mesh.velocity
    weight = _weight_at(boxes, element.right if step > 0 else element.left)
    if step > 0:
        out, into, incoming = velocity.flux_plus, velocity.flux_minus, velocity.minus
        end = element.at_right
        whole = _with_walls(boxes, element, velocity, behind, weight * out)
    else:
        out, into, incoming = -velocity.flux_minus, -velocity.flux_plus, velocity.plus
        end = element.at_left
        whole = _with_walls(boxes, element, velocity, weight * out, behind)
    # what comes in through the open end, in each of the functions that reach it
    entrance = (end[:, None, None] * into[:, incoming]).reshape(-1, len(incoming))
    shape = (len(whole), element.size, velocity.size, len(incoming))
    solution = np.asarray(np.linalg.solve(whole, -weight * entrance), dtype=np.float64)
    response = solution.reshape(shape)
    back = np.einsum("j,bjkl->bkl", end, response)
    wall = np.zeros_like(behind)
    wall -= weight * into
    wall[:, :, incoming] -= weight * (out @ back)
    return wall, response


def _pinned(whole: Array, element: DisplacementElement) -> Array:
    """The null vector: one equation, which the others imply, is given up to set its size."""
    whole[:, 0, :] = 0.0
    whole[:, 0, 0] = 1.0
    one = np.zeros((1, whole.shape[1], 1))
    one[0, 0] = 1.0
    solution = np.asarray(np.linalg.solve(whole, one), dtype=np.float64)
    return solution.reshape(len(whole), element.size, -1)


def _averages(boxes: Boxes, mesh: Mesh, density: list[Array], threshold: Array) -> BoxMoments:
    velocity = mesh.velocity
    mass, first, second, square = np.zeros((4, len(threshold)))
    for element, q in zip(mesh.displacement, density, strict=True):
        weights = element.weights * np.exp(boxes.log_weight(element.xi))
        for power, total in enumerate((mass, first, second)):
            profile = (weights * element.xi**power) @ element.values
            total += np.sum(profile * (q @ velocity.mass), axis=1)
        square += np.sum((weights @ element.values) * (q @ velocity.square), axis=1)
    mean = first / mass
    right = np.einsum("bjk,j->bk", density[-1], mesh.displacement[-1].at_right)
    left = np.einsum("bjk,j->bk", density[0], mesh.displacement[0].at_left)
    right = right[:, velocity.plus] * (_weight_at(boxes, 1.0)[:, 0] / mass[:, None])
    left = left[:, velocity.minus] * (_weight_at(boxes, -1.0)[:, 0] / mass[:, None])
    above = velocity.flux_above(threshold)
    lengths = [element.right - element.left for element in mesh.displacement]
    slow_left, slow_right = (
        above - velocity.flux_above(np.maximum(threshold, np.cbrt(boxes.diffusion * length)))
        for length in (lengths[0], lengths[-1])
    )
    return BoxMoments(
        mean=mean,
        mean_square=second / mass,
        velocity_mean_square=square / mass,
        crossing_rate=_crossing_rate(boxes, mesh, density, np.where(boxes.halved, -1.0, mean))
        / mass,
        rate_left=np.sum(above * left, axis=1),
        rate_right=np.sum(above * right, axis=1),
        speed_rate_left=left @ velocity.half_moments[2],
        speed_rate_right=right @ velocity.half_moments[2],
        speed_square_rate_left=left @ velocity.half_moments[3],
        speed_square_rate_right=right @ velocity.half_moments[3],
        unresolved_left=np.abs(np.sum(slow_left * left, axis=1)),
        unresolved_right=np.abs(np.sum(slow_right * right, axis=1)),
    )


def _crossing_rate(boxes: Boxes, mesh: Mesh, density: list[Array], level: Array) -> Array:
    """Mean of the fluxes up and down through a level in each box, before normalisation."""
    found = np.zeros(len(level))
    for element, q in zip(mesh.displacement, density, strict=True):
        here = (level >= element.left) & (level < element.right)
        profile, _ = legendre(element.degree, element.local(level))
        trace = np.einsum("bj,bjk->bk", profile, q)
        both_ways = (trace[:, mesh.velocity.plus] + trace[:, mesh.velocity.minus]) / 2.0
        found += np.where(here, both_ways @ mesh.velocity.half_moments[1], 0.0)
    return found * np.exp(boxes.log_weight(level[:, None]))[:, 0]
