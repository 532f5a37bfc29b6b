"""Cross densities between the axes of a base: their sign, their effect, and what is refused."""

import math

import numpy as np
import pytest
from scipy.signal import csd

from stochvi import Isolator, Scene, SceneError, exact, history
from stochvi.scenes.cross_densities import CrossDensity
from support.boxes import box, direct_matrices, tables

AXES = (0, 2)
"""Columns of x and z, between which the cross density stands."""

FREQUENCIES = np.geomspace(5.0, 400.0, 9)


def cross(real: float, imaginary: float) -> CrossDensity:
    """A cross density of x and z whose coherence is the same at all frequencies."""
    first, second = (tables()[axis].table for axis in AXES)
    size = np.sqrt(first(FREQUENCIES) * second(FREQUENCIES))
    return CrossDensity(
        between=["x", "z"], frequency_hz=FREQUENCIES, real=real * size,
        imaginary=imaginary * size, unit="(m/s2)2/Hz",
    )  # fmt: skip


def scene(real: float, imaginary: float) -> Scene:
    return Scene(structure=box(), excitations=tables(), cross_density=[cross(real, imaginary)])


def test_rms_values_are_those_of_a_direct_integration_over_the_matrix_of_densities() -> None:
    structure, share = box(), 0.5 + 0.6j
    mass, damping, stiffness = direct_matrices(structure)
    nodes, weights = np.polynomial.legendre.leggauss(30)
    breaks = np.concatenate([[5.0, 4.0, 500.0, 300.0, 400.0, 60.0, 40.0, 20.0], FREQUENCIES])
    edges = np.unique(np.concatenate([np.geomspace(4.0, 500.0, 60), breaks]))
    half, middle = np.diff(np.log(edges)) / 2.0, np.log(edges[1:] * edges[:-1]) / 2.0
    f = np.exp(middle[:, None] + half[:, None] * nodes).ravel()
    weight = (half[:, None] * weights).ravel() * f
    matrix = np.zeros((len(f), 3, 3), complex)
    for column, each in enumerate(tables()):
        matrix[:, column, column] = each.table(f)
    inside = (f >= FREQUENCIES[0]) & (f <= FREQUENCIES[-1])
    size = np.where(inside, np.sqrt(matrix[:, 0, 0].real * matrix[:, 2, 2].real), 0.0)
    # E A_z conj(A_x) is what scipy calls the cross density of x and z
    matrix[:, 2, 0], matrix[:, 0, 2] = share * size, share.conjugate() * size
    w = 2.0 * math.pi * f[:, None, None]
    pushes = np.broadcast_to(-mass[:, :3], (len(f), 6, 3))
    moved = np.linalg.solve(stiffness - w**2 * mass + 1j * w * damping, pushes)
    squares = np.einsum("f,fia,fab,fib->i", weight, moved, matrix, moved.conj()).real
    found = exact(scene(share.real, share.imag)).coordinates
    alone = exact(scene(0.0, 0.0)).coordinates
    for square, name in zip(squares, ("x", "y", "z", "rx", "ry", "rz"), strict=True):
        rms = float(found[name].displacement_std)
        assert rms == pytest.approx(math.sqrt(square), rel=1e-7)
        assert rms != pytest.approx(float(alone[name].displacement_std), rel=1e-3)


def test_a_simulated_base_has_the_cross_density_that_scipy_estimates() -> None:
    share = 0.3 + 0.8j
    found = history(scene(share.real, share.imag), duration=20.0, seed=1).samples
    x, z = (found[f"{axis}.base_acceleration_m_s2"] for axis in "xz")
    length = 512
    f, estimated = csd(x, z, fs=1.0 / (found["time_s"][1] - found["time_s"][0]), nperseg=length)
    first, second = (tables()[axis].table for axis in AXES)
    band = (f > 10.0) & (f < 100.0)
    relative = estimated[band] / np.sqrt(first(f[band]) * second(f[band]))
    # the segments overlap by half: their number is a lower limit of what the mean is worth
    error = 1.0 / math.sqrt(band.sum() * len(x) / length)
    assert abs(relative.mean() - share) < 4.5 * error
    assert abs(relative.mean() - share.conjugate()) > 4.5 * error


def test_a_louder_scene_keeps_its_coherence() -> None:
    quiet, loud = scene(0.5, -0.6), scene(0.5, -0.6).at_level(20.0)
    for name, each in exact(quiet).coordinates.items():
        found = float(exact(loud).coordinates[name].velocity_std)
        assert found == pytest.approx(10.0 * float(each.velocity_std), rel=1e-12)


def test_what_no_motion_has_is_refused() -> None:
    with pytest.raises(SceneError, match=r"cross_density .* eigenvalue"):
        scene(0.8, 0.7)
    keys = {"structure": box(), "excitations": tables()}
    with pytest.raises(SceneError, match="given twice"):
        Scene(**keys, cross_density=[cross(0.1, 0.0), cross(0.2, 0.0)])
    with pytest.raises(SceneError, match=r"cross_density needs one excitation .* 0 along z"):
        Scene(structure=box(), excitations=tables()[:2], cross_density=[cross(0.1, 0.0)])
    with pytest.raises(SceneError, match=r"cross_density .*rigid-body"):
        Scene(
            structure=Isolator(frequency_hz=9.0, zeta=0.1),
            excitations=[tables()[0].model_copy(update={"axis": None})],
            cross_density=[cross(0.1, 0.0)],
        )
    with pytest.raises(SceneError, match="between needs two different axes"):
        CrossDensity(**cross(0.1, 0.0).model_dump() | {"between": ["x", "x"]})
