"""A rigid box without stops: linear numbers against oscillators and a direct integration."""

import math

import numpy as np
import pytest

from stochvi import Isolator, Scene, linearise, simulate
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.model.modal import linear_law
from stochvi.model.model import model_of
from stochvi.results.response import Response
from stochvi.scenes import RigidBody
from stochvi.testing import assert_agrees
from support.accuracies import rel_errors
from support.boxes import TABLES, box, direct_matrices, scene_with, tables

FAR = 3.0
"""Distance of a snubber, in standard deviations of its gap."""

QUANTITIES = ("displacement_std", "velocity_std", "acceleration_std")


def moments(response: Response, name: str) -> list[float]:
    return [float(response.coordinates[name][what]) for what in QUANTITIES]


def test_a_box_with_its_centre_amid_equal_mounts_is_an_oscillator_along_every_axis() -> None:
    places = [(x, y, z) for x in (-0.2, 0.2) for y in (-0.1, 0.1) for z in (-0.1, 0.1)]
    stiffness, damping = np.array([2e3, 3e3, 5e3]), np.array([5.0, 7.0, 9.0])
    mounts = [{"at": at, "stiffness": stiffness, "damping": damping} for at in places]
    symmetric = RigidBody(mass=9.0, inertia=[0.2, 0.25, 0.15], mount=mounts)
    found = linearise(scene_with(symmetric))
    for noise, axis, k, c in zip(tables(), "xyz", stiffness, damping, strict=True):
        alone = Isolator(mass=9.0, stiffness=8.0 * k, damping=8.0 * c)
        bare = noise.model_copy(update={"axis": None})
        expected = linearise(Scene(structure=alone, excitations=[bare]))
        assert moments(found, axis) == pytest.approx(moments(expected, "x"), rel=1e-10)
    for angle in ("rx", "ry", "rz"):
        assert moments(found, angle) == pytest.approx([0.0, 0.0, 0.0], abs=1e-11)


def direct(structure: RigidBody) -> dict[str, list[float]]:
    """Rms displacements, velocities and absolute accelerations, by a rule of many points over log
    frequency."""
    mass, damping, stiffness = direct_matrices(structure)
    total = np.zeros((3, 6))
    nodes, weights = np.polynomial.legendre.leggauss(40)
    for column, (frequency, density) in enumerate(TABLES.values()):
        # panels of equal ratio between breakpoints; the response is smooth on each
        edges = np.unique(
            np.concatenate([np.geomspace(frequency[0], frequency[-1], 60), frequency])
        )
        half, middle = np.diff(np.log(edges)) / 2.0, np.log(edges[1:] * edges[:-1]) / 2.0
        f = np.exp(middle[:, None] + half[:, None] * nodes).ravel()
        weight = (half[:, None] * weights).ravel() * f
        power = np.exp(np.interp(np.log(f), np.log(frequency), np.log(density)))
        w = 2.0 * math.pi * f[:, None, None]
        dynamic = stiffness - w**2 * mass + 1j * w * damping
        moved = np.linalg.solve(dynamic, np.broadcast_to(-mass[:, column, None], (len(f), 6, 1)))
        moved, w = moved[:, :, 0], w[:, :, 0]
        absolute = np.eye(6)[column] - w**2 * moved
        share = (power * weight * STANDARD_GRAVITY**2)[:, None]
        for row, motion in enumerate((moved, w * moved, absolute)):
            total[row] += (share * np.abs(motion) ** 2).sum(axis=0)
    names = ("x", "y", "z", "rx", "ry", "rz")
    return dict(zip(names, np.sqrt(total).T.tolist(), strict=True))


def test_a_box_without_symmetry_moves_as_a_direct_integration_over_frequency_says() -> None:
    found, expected = linearise(scene_with(box())), direct(box())
    for name in expected:
        assert moments(found, name) == pytest.approx(expected[name], rel=1e-8)


@rel_errors(0.1, 0.02)
def test_a_corner_hits_a_far_snubber_at_the_rate_of_rice(rel_error: float) -> None:
    pair = {"name": "corner", "at": [0.3, 0.2, -0.15], "direction": [1.0, 0.5, 2.0]}
    law = {"kind": "restitution", "coefficient": 0.5}

    def hanging(level: float) -> Scene:
        return scene_with(box(zeta=0.4), pairs=[pair | {"upper": level, "law": law}])

    model = model_of(hanging(1.0))
    free, gap = linear_law(model.modal), model.modal.gaps[0]
    assert free is not None
    sigma, speed = (math.sqrt(free.variances(gap, first)) for first in (0, model.modal.size))
    rate = speed / sigma / (2.0 * math.pi) * math.exp(-(FAR**2) / 2.0)
    found = simulate(hanging(FAR * sigma), rel_error=rel_error, seed=3, threads=1)
    hits = found.impact_pairs["corner"].collision_rate
    assert hits is not None
    # an excursion is hardly ever followed by another one within the memory of the motion
    assert_agrees(hits, rate)


def test_a_snubber_that_impacts_alone_would_move_is_no_obstacle() -> None:
    """A symmetric box shaken along z does not move sideways until its corner hits a stop."""
    corners = [(x, y, 0.0) for x in (-0.2, 0.2) for y in (-0.1, 0.1)]
    mounts = [{"at": at, "stiffness": [2e4, 2e4, 3e4], "zeta": 0.1} for at in corners]
    body = RigidBody(mass=10.0, inertia=[0.2, 0.2, 0.2], mount=mounts)
    law = {"kind": "restitution", "coefficient": 0.5}
    pairs = [
        {"name": name, "at": [0.2, 0.1, 0.1], "direction": to, "clearance": 0.003, "law": law}
        for name, to in (("up", [0, 0, 1]), ("side", [1, 0, 0]))
    ]
    scene = Scene(structure=body, impact_pair=pairs, excitations=[tables()[2]])
    found = linearise(scene)
    rates = {name: float(found.impact_pairs[name].collision_rate) for name in ("up", "side")}
    assert rates["up"] > 0.0 and 0.0 <= rates["side"] < rates["up"]


def test_rms_values_are_those_of_the_frequency_solver_of_pyyeti() -> None:
    with np.printoptions():  # pyYeti changes how numpy prints arrays
        solvers = pytest.importorskip("pyyeti.ode", reason="pyYeti is in the extra `fem`")
    structure = box()
    mass, damping, stiffness = structure.matrices
    solver = solvers.SolveUnc(mass, damping, stiffness)
    squares = np.zeros((3, 6))
    for column, (frequency, density) in enumerate(TABLES.values()):
        f = np.geomspace(frequency[0], frequency[-1], 4000)
        found = solver.fsolve(-np.outer(mass[:, column], np.ones(len(f))), f)
        power = np.exp(np.interp(np.log(f), np.log(frequency), np.log(density)))
        absolute = found.a + np.eye(6)[column][:, None]
        for row, motion in enumerate((found.d, found.v, absolute)):
            squares[row] += np.trapezoid(power * STANDARD_GRAVITY**2 * np.abs(motion) ** 2, f)
    expected = np.sqrt(squares)
    mine = linearise(scene_with(structure))
    for column, name in enumerate(structure.coordinates):
        assert moments(mine, name) == pytest.approx(expected[:, column].tolist(), rel=1e-3)
