"""Correlated noises, of the axes of a base or forces: their sign, their effect, what is refused."""

import cmath
import math
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov
from scipy.signal import csd

from stochvi import (
    FilteredNoise,
    ImpactPair,
    Isolator,
    Matrices,
    Oscillator,
    Restitution,
    Scene,
    SceneError,
    TabulatedNoise,
    TransferFunctionNoise,
    WhiteNoise,
    exact,
    history,
    simulate,
)
from stochvi.mathematics.frequency_response import InputMatrix
from stochvi.model.model import model_of
from stochvi.scenes import Absorber
from stochvi.scenes.cross_densities import CrossDensity
from stochvi.scenes.excitations import Excitation
from stochvi.testing import assert_agrees
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
    with pytest.raises(SceneError, match=r"cross_density needs one excitation .* axis 'z'"):
        Scene(structure=box(), excitations=tables()[:2], cross_density=[cross(0.1, 0.0)])
    with pytest.raises(SceneError, match=r"cross_density needs one excitation .* axis 'x'"):
        Scene(
            structure=Isolator(frequency_hz=9.0, zeta=0.1),
            excitations=[tables()[0].model_copy(update={"axis": None})],
            cross_density=[cross(0.1, 0.0)],
        )
    with pytest.raises(SceneError, match="between needs two different excitations"):
        CrossDensity(**cross(0.1, 0.0).model_dump() | {"between": ["x", "x"]})


def pushed(correlation: list[CrossDensity], **more: Any) -> Scene:
    """Two masses on springs, each under a force of its own."""
    keys = {"frequency_hz": [0.2, 3.0], "density": [0.3, 0.1], "unit": "N2/Hz"}
    return Scene(
        structure=Matrices(
            coordinates=["left", "right"], mass=[[1.0, 0.0], [0.0, 2.0]],
            damping=[[0.3, -0.1], [-0.1, 0.4]], stiffness=[[40.0, -10.0], [-10.0, 60.0]],
        ),
        excitations=[
            TabulatedNoise(on="left", name="first", **keys),
            TabulatedNoise(on="right", name="second", **keys),
        ],
        cross_density=correlation,
        **more,
    )  # fmt: skip


def rms(scene: Scene) -> list[float]:
    return [float(each.displacement_std) for each in exact(scene).coordinates.values()]


def test_forces_of_coherence_one_are_one_force() -> None:
    both = rms(pushed([CrossDensity(between=["first", "second"], coherence=1.0)]))
    against = CrossDensity(between=["first", "second"], coherence=1.0, phase_deg=180.0)
    keys = {"frequency_hz": [0.2, 3.0], "density": [0.3, 0.1], "unit": "N2/Hz"}
    for found, sign in ((both, 1.0), (rms(pushed([against])), -1.0)):
        one = TabulatedNoise(weights={"left": 1.0, "right": sign}, **keys)
        scene = pushed([]).replace(excitations=(one,))
        assert found == pytest.approx(rms(scene), rel=1e-9)
    assert both != pytest.approx(rms(pushed([])), rel=1e-3)


def test_a_coherence_with_a_phase_is_a_cross_density() -> None:
    share, frequencies = cmath.rect(math.sqrt(0.4), math.radians(70.0)), [0.2, 3.0]
    size = np.array([0.3, 0.1])
    said = CrossDensity(
        between=["first", "second"], frequency_hz=frequencies, real=share.real * size,
        imaginary=share.imag * size, unit="N2/Hz",
    )  # fmt: skip
    one = CrossDensity(between=["first", "second"], coherence=0.4, phase_deg=70.0)
    other = CrossDensity(between=["first", "second"], coherence=0.4, phase_deg=-70.0)
    assert rms(pushed([one])) == pytest.approx(rms(pushed([said])), rel=1e-12)
    assert rms(pushed([one])) != pytest.approx(rms(pushed([other])), rel=1e-3)
    loud = pushed([said]).at_level(20.0)
    assert rms(loud) == pytest.approx([10.0 * each for each in rms(pushed([one]))], rel=1e-12)


def test_simulated_masses_have_the_covariance_of_their_forces() -> None:
    """Without stops the covariance is known exactly; -70 degrees in place of 70 is noticed."""
    one, other = (
        pushed([CrossDensity(between=["first", "second"], coherence=0.9, phase_deg=phase)])
        for phase in (70.0, -70.0)
    )
    wall = ImpactPair(on="left", upper=3.0, law=Restitution(coefficient=0.5))
    found = simulate(one.replace(impact_pairs=(wall,)), rel_error=0.005, seed=2).coordinates
    for name, true, wrong in zip(("left", "right"), rms(one), rms(other), strict=True):
        assert_agrees(found[name].displacement_std, true)
        if name == "left":
            with pytest.raises(AssertionError):
                assert_agrees(found[name].displacement_std, wrong)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"coherence": 1.5}, r"must be in \[0, 1\]"),
        ({"coherence": [0.5, 0.6]}, "one number, or one for each of 1 values"),
        ({"coherence": 0.5, "unit": "N2/Hz"}, "needs no unit"),
        ({"phase_deg": 30.0}, "needs coherence"),
        ({"coherence": 0.5, "between": ["first", "third"]}, "names of excitations are first, sec"),
    ],
)
def test_what_is_no_correlation_is_refused(keys: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        pushed([{"between": ["first", "second"]} | keys])


def test_names_of_excitations_are_told_apart() -> None:
    scene = pushed([])
    twice = [each.model_copy(update={"name": "first"}) for each in scene.excitations]
    with pytest.raises(SceneError, match="needs a name of its own"):
        scene.replace(excitations=twice)


# White noise, and noise through a resonance


def shaken(crosses: list[CrossDensity], *noises: Excitation) -> Scene:
    return pushed([]).replace(excitations=noises, cross_densities=tuple(crosses))


def whites(*names: str) -> list[WhiteNoise]:
    return [
        WhiteNoise(on=on, name=name, intensity=size)
        for on, name, size in zip(("left", "right"), names, (0.3, 0.1), strict=True)
    ]


@pytest.mark.parametrize(("coherence", "phase"), [(0.64, 0.0), (0.64, 180.0), (1.0, 0.0)])
def test_white_forces_have_the_covariance_of_their_lyapunov_equation(
    coherence: float, phase: float
) -> None:
    cross = CrossDensity(between=["first", "second"], coherence=coherence, phase_deg=phase)
    scene = shaken([cross], *whites("first", "second"))
    mass, damping, stiffness = (np.array(each) for each in scene.structure.matrices)
    inverse = np.linalg.inv(mass)
    drift = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])

    def expected(sign: float) -> np.ndarray:
        shared = sign * math.sqrt(coherence * 0.3 * 0.1)
        noise = np.zeros((4, 4))
        noise[2:, 2:] = inverse @ np.array([[0.3, shared], [shared, 0.1]]) @ inverse
        return np.sqrt(np.diag(solve_continuous_lyapunov(drift, -noise))[:2])

    sign = 1.0 if phase == 0.0 else -1.0
    assert rms(scene) == pytest.approx(expected(sign), rel=1e-9)
    assert rms(scene) != pytest.approx(expected(-sign), rel=1e-2)


@pytest.mark.slow
def test_white_forces_of_coherence_one_are_simulated_as_one_force() -> None:
    cross = CrossDensity(between=["first", "second"], coherence=1.0)
    wall = (ImpactPair(on="left", upper=0.05, law=Restitution(coefficient=0.5)),)
    scene = shaken([cross], *whites("first", "second")).replace(impact_pairs=wall)
    weights = {"left": 1.0, "right": math.sqrt(1.0 / 3.0)}
    one = shaken([], WhiteNoise(weights=weights, intensity=0.3)).replace(impact_pairs=wall)
    found, single = (simulate(each, rel_error=0.02, seed=3) for each in (scene, one))
    for name, estimate in found.coordinates.items():
        other = single.coordinates[name].displacement_std
        # both have errors, of one size
        assert_agrees(estimate.displacement_std, other.value, z=6.0)


def test_a_resonance_may_be_correlated() -> None:
    keys = {"intensity": 0.2, "frequency_hz": 1.1, "zeta": 0.2}
    table = TabulatedNoise(
        on="right", name="second", frequency_hz=[0.2, 3.0], density=[0.3, 0.1], unit="N2/Hz"
    )
    resonance = FilteredNoise(on="left", name="first", **keys)
    square = (2.0 * math.pi * 1.1) ** 2
    denominator = [1.0, 0.4 * math.sqrt(square), square]
    shaped = TransferFunctionNoise(
        on="left", name="first", numerator=[square], denominator=denominator, intensity=0.2
    )
    cross = CrossDensity(between=["first", "second"], coherence=0.8, phase_deg=40.0)
    assert rms(shaken([cross], resonance, table)) == pytest.approx(
        rms(shaken([cross], shaped, table)), rel=1e-12
    )
    apart = CrossDensity(between=["first", "second"], coherence=0.0)
    free = rms(shaken([], resonance, table))
    assert rms(shaken([apart], resonance, table)) == pytest.approx(free, rel=1e-5)
    assert rms(shaken([cross], resonance, table)) != pytest.approx(free, rel=1e-2)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"coherence": 0.5, "phase_deg": 30.0}, "phase_deg of 0 or 180, between white noises"),
        ({"coherence": [0.5, 0.2], "frequency_hz": [1.0, 2.0]}, "one coherence"),
    ],
)
def test_white_noises_that_would_not_stay_white_are_refused(
    keys: dict[str, Any], words: str
) -> None:
    with pytest.raises(SceneError, match=words):
        shaken([CrossDensity(between=["first", "second"], **keys)], *whites("first", "second"))


def test_white_noise_is_joined_with_white_noise_alone() -> None:
    table = TabulatedNoise(
        on="right", name="second", frequency_hz=[0.2, 3.0], density=[0.3, 0.1], unit="N2/Hz"
    )
    cross = CrossDensity(between=["first", "second"], coherence=0.5)
    with pytest.raises(SceneError, match="white noise with white noise alone"):
        shaken([cross], WhiteNoise(on="left", name="first", intensity=0.2), table)


def test_an_absorber_leaves_forces_correlated() -> None:
    keys = {"frequency_hz": [0.2, 3.0], "density": [0.3, 0.1], "unit": "N2/Hz"}

    def variance(coherence: float) -> float:
        scene = Scene(
            structure=Oscillator(mass=1.0, damping=0.2, stiffness=9.0),
            excitations=[TabulatedNoise(name=name, **keys) for name in ("first", "second")],
            cross_densities=[CrossDensity(between=["first", "second"], coherence=coherence)],
            absorber=Absorber(mass=0.1, play=0.2, law=Restitution(coefficient=0.5)),
        )
        frequencies = np.geomspace(0.2, 3.0, 50)
        total = np.zeros(len(frequencies))
        for table, force in model_of(scene).tables:
            assert isinstance(force, InputMatrix)
            pushes = force(frequencies)[:, 0]
            total += table(frequencies) * np.abs(pushes) ** 2
        return float(np.trapezoid(total, frequencies))

    # two equal forces in phase have twice the density of independent ones
    assert variance(1.0) == pytest.approx(2.0 * variance(0.0), rel=1e-9)
