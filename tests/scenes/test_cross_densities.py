"""Correlated noises, of the axes of a base or forces: their sign, their effect, what is refused."""

from __future__ import annotations

import cmath
import itertools
import json
import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import solve_continuous_lyapunov
from scipy.signal import StateSpace, butter, csd, lsim, tf2ss

from stochvi import (
    FilteredNoise,
    ImpactPair,
    Isolator,
    Matrices,
    Oscillator,
    Restitution,
    RoadNoise,
    Scene,
    SceneError,
    StateSpaceNoise,
    TabulatedNoise,
    TransferFunctionNoise,
    Viscoelastic,
    WhiteNoise,
    exact,
    history,
    load_scene,
    screen,
    simulate,
)
from stochvi.mathematics.spectra import InputMatrix, Table, covariance, response_moments
from stochvi.model.model import model_of
from stochvi.results.estimates import Estimate
from stochvi.scenes import Absorber
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.excitations import ConstantLoad, Excitation, Sine
from stochvi.scenes.excitations.noise import ROUGHNESS, QuarterCar, velocity_density
from stochvi.scenes.forces import CrossDensity
from stochvi.testing import assert_agrees
from support.accuracies import assert_differs
from support.boxes import box, direct_matrices, tables
from support.refusals import refusals

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
            assert_differs(found[name].displacement_std, wrong)


test_what_is_no_correlation_is_refused = refusals(
    lambda keys: pushed([{"between": ["first", "second"]} | keys]),
    ({"coherence": 1.5}, "must be in [0, 1]"),
    ({"coherence": [0.5, 0.6]}, "one number, or one for each of 1 values"),
    ({"coherence": 0.5, "unit": "N2/Hz"}, "needs no unit"),
    ({"phase_deg": 30.0}, "needs coherence"),
    ({"coherence": 0.5, "between": ["first", "third"]}, "names of excitations are first, sec"),
)


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


test_white_noises_that_would_not_stay_white_are_refused = refusals(
    lambda keys: shaken(
        [CrossDensity(between=["first", "second"], **keys)], *whites("first", "second")
    ),
    ({"coherence": 0.5, "phase_deg": 30.0}, "phase_deg of 0 or 180, between white noises"),
    ({"coherence": [0.5, 0.2], "frequency_hz": [1.0, 2.0]}, "one coherence"),
)


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


# ------------------------------------------------------------------------------
# Correlated noises on a box: closed covariances, and one noise where all is shared.
# ------------------------------------------------------------------------------


COORDINATES = ("x", "y", "z", "rx", "ry", "rz")

TABLE = {"frequency_hz": [4.0, 40.0, 90.0], "density": [200.0, 300.0, 50.0], "unit": "N2/Hz"}

RESONANCE = {"intensity": 150.0, "frequency_hz": 12.0, "zeta": 0.2}

SHARE = 0.5
"""Second noise over the first where both are forces, as amplitudes."""

LAWS = {
    "rigid": Restitution(coefficient=0.6),
    "compliant": Viscoelastic(stiffness=3e5, damping_ratio=0.1),
}


def force(kind: str, factor: float, **place: object) -> Excitation:
    """Noise of a kind, times a factor."""
    square = factor**2
    if kind == "white":
        return WhiteNoise(intensity=150.0 * square, **place)
    if kind == "filtered":
        return FilteredNoise(**RESONANCE | {"intensity": 150.0 * square} | place)
    density = [square * each for each in TABLE["density"]]
    return TabulatedNoise(**TABLE | {"density": density} | place)


def forces(kind: str) -> list[Excitation]:
    return [force(kind, 1.0, on="z", name="up"), force(kind, SHARE, on="x", name="along")]


def scene_of_boxes(kind: str, coherence: float, phase: float = 0.0, law: object = None) -> Scene:
    cross = CrossDensity(between=["up", "along"], coherence=coherence, phase_deg=phase)
    return Scene(
        structure=box(), impact_pair=pairs(law), excitations=forces(kind), cross_density=[cross]
    )


def pairs(law: object) -> list[ImpactPair]:
    """A snubber that both forces press."""
    if law is None:
        return []
    keys = {"at": [0.2, 0.1, -0.1], "direction": [1.0, 0.0, 2.0], "name": "corner"}
    return [ImpactPair(**keys, upper=0.002, law=law)]


def one_force(kind: str, sign: float, law: object) -> Scene:
    whole = force(kind, 1.0, weights={"z": 1.0, "x": sign * SHARE})
    return Scene(structure=box(), impact_pair=pairs(law), excitations=[whole])


def density(kind: str, f: np.ndarray) -> np.ndarray:
    """One-sided density of the first force, N^2/Hz."""
    if kind == "filtered":
        r = f / RESONANCE["frequency_hz"]
        return 300.0 / ((1.0 - r**2) ** 2 + (2.0 * RESONANCE["zeta"] * r) ** 2)
    inside = (f >= 4.0) & (f <= 90.0)
    logs = np.interp(np.log(f), np.log(TABLE["frequency_hz"]), np.log(TABLE["density"]))
    return np.where(inside, np.exp(logs), 0.0)


def expected(kind: str, coherence: float, phase: float) -> np.ndarray:
    """Standard deviations of the coordinates without stops."""
    mass, damping, stiffness = direct_matrices(box())
    share = cmath.rect(math.sqrt(coherence), math.radians(phase))
    pushes = np.eye(6)[:, [2, 0]]
    if kind == "white":
        inverse, zero = np.linalg.inv(mass), np.zeros((6, 6))
        drift = np.block([[zero, np.eye(6)], [-inverse @ stiffness, -inverse @ damping]])
        both = 150.0 * np.array([[1.0, SHARE * share.real], [SHARE * share.real, SHARE**2]])
        noise = np.zeros((12, 12))
        noise[6:, 6:] = inverse @ pushes @ both @ pushes.T @ inverse.T
        return np.sqrt(np.diag(solve_continuous_lyapunov(drift, -noise))[:6])
    nodes, weights = np.polynomial.legendre.leggauss(40)
    edges = np.unique([*np.geomspace(1e-6, 3000.0, 300), *TABLE["frequency_hz"]])
    half, middle = np.diff(np.log(edges)) / 2.0, np.log(edges[1:] * edges[:-1]) / 2.0
    f = np.exp(middle[:, None] + half[:, None] * nodes).ravel()
    weight = (half[:, None] * weights).ravel() * f
    # E A_a conj(A_b) of the two forces, where the second leads by the phase
    both = np.array([[1.0, SHARE * share.conjugate()], [SHARE * share, SHARE**2]])
    w = 2.0 * math.pi * f[:, None, None]
    moved = np.linalg.solve(
        stiffness - w**2 * mass + 1j * w * damping, np.broadcast_to(pushes, (len(f), 6, 2))
    )
    squares = np.einsum("fia,ab,fib->fi", moved, both, moved.conj()).real
    return np.sqrt((weight * density(kind, f)) @ squares)


def told(one: Scene) -> np.ndarray:
    found = exact(one).coordinates
    return np.array([float(found[name].displacement_std) for name in COORDINATES])


@pytest.mark.parametrize(
    ("kind", "coherence", "phase"),
    [("white", 0.7, 0.0), ("white", 0.7, 180.0), ("table", 0.7, 60.0), ("filtered", 0.7, 60.0),
     ("table", 1.0, 0.0), ("filtered", 1.0, 180.0)],
)  # fmt: skip
def test_without_stops_the_covariance_is_that_of_the_matrices(
    kind: str, coherence: float, phase: float
) -> None:
    found = told(scene_of_boxes(kind, coherence, phase))
    assert found == pytest.approx(expected(kind, coherence, phase), rel=2e-6)
    other = expected(kind, coherence, phase + 180.0)
    assert np.abs(found / other - 1.0).max() > 0.05


def test_noise_of_the_base_and_a_force_are_joined_too() -> None:
    axis = TabulatedNoise(
        axis="z", name="base", frequency_hz=[4.0, 90.0], density=[1.0, 1.0], unit="(m/s2)2/Hz"
    )
    keys = {"frequency_hz": [4.0, 90.0], "density": [144.0, 144.0], "unit": "N2/Hz"}
    against, along = (
        Scene(
            structure=box(),
            excitations=[axis, TabulatedNoise(on="z", name="push", **keys)],
            cross_density=[CrossDensity(between=["base", "push"], coherence=1.0, phase_deg=phase)],
        )
        for phase in (0.0, 180.0)
    )
    # the base drives the box by -m a: a force m a in phase with it leaves nothing
    alone = told(Scene(structure=box(), excitations=[axis]))
    assert told(along) == pytest.approx(2.0 * alone, rel=1e-6)
    assert np.all(told(against) < 1e-4 * alone)


@pytest.mark.slow
@pytest.mark.parametrize("law", list(LAWS))
@pytest.mark.parametrize("kind", ["white", "table", "filtered"])
def test_between_stops_shared_noise_is_one_noise(kind: str, law: str) -> None:
    """Against an impact of the snubber, too; the control is the force of the other sign."""
    keys = {"paths": 64, "duration": 20.0, "budget": None}
    joined = simulate(scene_of_boxes(kind, 1.0, 0.0, LAWS[law]), **keys, seed=1)
    single, other = (
        simulate(one_force(kind, sign, LAWS[law]), **keys, seed=2) for sign in (1.0, -1.0)
    )

    def differences(reference: object) -> list[Estimate]:
        found = []
        for where, key, name in (
            ("coordinates", "z", "displacement_mean_square"),
            ("coordinates", "x", "displacement_mean_square"),
            ("impact_pairs", "corner", "impact_speed_rate"),
            ("impact_pairs", "corner", "impact_speed_square_rate"),
        ):
            one, two = (getattr(each, where)[key][name] for each in (joined, reference))
            found.append(
                Estimate(
                    value=one.value - two.value,
                    standard_error=math.hypot(one.standard_error, two.standard_error),
                    bias=0.0,
                    bias_error=abs(one.bias or 0.0) + abs(two.bias or 0.0),
                )
            )
        return found

    for each in differences(single):
        assert_agrees(each, 0.0)
    # the control: the sign of the force along x changes how far the box moves
    assert_differs(differences(other)[0], 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("law", list(LAWS))
def test_between_stops_noises_without_coherence_are_independent(law: str) -> None:
    keys = {"paths": 64, "duration": 20.0}
    apart, joined = (
        simulate(scene_of_boxes("table", coherence, 0.0, LAWS[law]), **keys, seed=1).impact_pairs[
            "corner"
        ]
        for coherence in (0.0, 0.9)
    )
    free = scene_of_boxes("table", 0.0, 0.0, LAWS[law]).replace(cross_densities=())
    known = simulate(free, **keys, seed=2).impact_pairs["corner"]

    def difference(one: Estimate, two: Estimate) -> float:
        return abs(one.value - two.value) / math.hypot(one.standard_error, two.standard_error)

    rates = [each["impact_speed_square_rate"] for each in (apart, joined, known)]
    assert difference(rates[0], rates[2]) < 4.5
    assert difference(rates[1], rates[2]) > 4.5


# ------------------------------------------------------------------------------
# White noise through filters of any order, against resonances and Lyapunov's equation.
# ------------------------------------------------------------------------------


Z = 4.5
"""Standard errors by which two simulations may differ."""

OMEGA, ZETA = 60.0, 0.2
RESONANCE_OF_SHAPED = {"numerator": [OMEGA**2], "denominator": [1.0, 2.0 * ZETA * OMEGA, OMEGA**2]}


def resonance(zeta: float = ZETA) -> FilteredNoise:
    return FilteredNoise(on="base", intensity=2.0, frequency_hz=OMEGA / (2.0 * math.pi), zeta=zeta)


def isolator(noise: Any, **more: Any) -> Scene:
    return Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[noise], **more)


def test_a_resonance_is_that_of_filtered_noise() -> None:
    """Of every mean square the table leaves out less than 1e-6, and interpolates to 1e-6."""
    shaped = TransferFunctionNoise(on="base", intensity=2.0, **RESONANCE_OF_SHAPED)
    table, closed = (exact(isolator(each)).coordinates["x"] for each in (shaped, resonance()))
    for name in ("displacement_mean_square", "velocity_mean_square"):
        assert getattr(table, name).value == pytest.approx(getattr(closed, name).value, rel=3e-6)


def test_between_stops_simulations_of_both_agree() -> None:
    pair = ImpactPair(lower=-3e-3, upper=3e-3, law=Restitution(coefficient=0.7))
    shaped = TransferFunctionNoise(on="base", intensity=2.0, **RESONANCE_OF_SHAPED)

    def rate(noise: Any) -> Any:
        scene = isolator(noise, impact_pairs=[pair])
        found = simulate(scene, rel_error=0.01, seed=3).impact_pairs["stops"].collision_rate
        assert found is not None
        return found

    one, other, wrong = rate(shaped), rate(resonance()), rate(resonance(0.15))
    assert abs(one.value - other.value) < math.hypot(one.reach(Z), other.reach(Z))
    assert abs(one.value - wrong.value) > math.hypot(one.reach(Z), wrong.reach(Z))


@pytest.mark.parametrize("order", [1, 3, 6])
def test_state_space_and_transfer_function_have_one_density(order: int) -> None:
    numerator, denominator = butter(order, 2.0 * math.pi * 30.0, analog=True)
    a, b, c, _ = tf2ss(numerator, denominator)
    shaped = TransferFunctionNoise(
        on="base", intensity=2.0, numerator=numerator, denominator=denominator
    )
    states = StateSpaceNoise(on="base", intensity=2.0, A=a, B=b, C=c)
    f = np.geomspace(0.1, 100.0, 50)
    assert states.table(f) == pytest.approx(shaped.table(f), rel=3e-6)
    # E f f' = C P C' with A P + P A' + S0 B B' = 0; the table ends where its tail is faint
    covariance = solve_continuous_lyapunov(a, -2.0 * b @ b.T)
    square = (c @ covariance @ c.T).item()
    assert shaped.table.mean_square() == pytest.approx(square, rel=1e-3 if order == 1 else 3e-6)


def test_independent_noises_add_their_densities() -> None:
    a, c = [[-3.0, 1.0], [0.0, -7.0]], [1.0, 2.0]
    both = StateSpaceNoise(on="base", intensity=2.0, A=a, B=[[1.0, 0.5], [0.0, 2.0]], C=c)
    each = [
        StateSpaceNoise(on="base", intensity=2.0, A=a, B=b, C=c) for b in ([1.0, 0.0], [0.5, 2.0])
    ]
    f = np.geomspace(0.01, 10.0, 20)
    assert both.table(f) == pytest.approx(sum(one.table(f) for one in each), rel=3e-6)


def test_a_level_raises_the_density() -> None:
    noise = TransferFunctionNoise(on="base", intensity=2.0, **RESONANCE_OF_SHAPED)
    louder = noise.louder(10.0)
    assert louder.table(5.0) == pytest.approx(10.0 * noise.table(5.0), rel=1e-9)


def test_a_notch_is_followed_down_to_what_cannot_be_heard() -> None:
    notch = TransferFunctionNoise(
        on="base", intensity=2.0, numerator=[1.0, 0.0, 900.0], denominator=[1.0, 90.0, 2700.0, 27e3]
    )
    at = 30.0 / (2.0 * math.pi)
    assert notch.table(at) < 1e-6 * notch.table(0.5 * at)


def test_a_scene_file_may_call_it_filtered(tmp_path: Any) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(
        '[structure]\nkind = "oscillator"\nmass = 1.0\ndamping = 0.1\nstiffness = 1.0\n'
        '[[excitation]]\nkind = "filtered"\nintensity = 0.2\nnumerator = [2.0]\n'
        "denominator = [1.0, 2.0]\n"
        '[[excitation]]\nkind = "filtered"\nintensity = 0.2\nA = [[-2.0]]\nB = [2.0]\nC = [1.0]\n',
        encoding="utf-8",
    )
    scene = load_scene(file)
    one, other = scene.excitations
    assert isinstance(one, TransferFunctionNoise) and isinstance(other, StateSpaceNoise)
    document = json.loads(json.dumps(scene.document()))
    assert Scene.model_validate(document).excitations == scene.excitations


def through_filter(keys: dict[str, Any]) -> Scene:
    filtered = {"kind": "filtered", "intensity": 0.2} | keys
    return Scene(structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0), excitations=[filtered])


test_what_is_no_filter_is_refused = refusals(
    through_filter,
    ({"numerator": [1.0], "denominator": [1.0, -2.0]}, "every pole with a negative real part"),
    ({"numerator": [1.0], "denominator": [1.0, 0.0]}, "every pole with a negative real part"),
    ({"numerator": [1.0, 1.0], "denominator": [1.0, 2.0]}, "of a lower degree"),
    ({"numerator": [1.0], "denominator": [2.0]}, "of degree 1 at least"),
    ({"numerator": [0.0], "denominator": [1.0, 2.0]}, "lets noise pass"),
    ({"A": [[-1.0, 2.0]], "B": [1.0], "C": [1.0]}, "square matrix A"),
    ({"A": [[-1.0]], "B": [1.0, 2.0], "C": [1.0]}, "B with 1 rows"),
    ({"A": [[-1.0]], "B": [1.0], "C": [1.0, 2.0]}, "C with 1 numbers"),
    ({"A": [[1.0]], "B": [1.0], "C": [1.0]}, "every pole with a negative real part"),
)


test_what_is_no_matrix_is_refused = refusals(
    lambda wrong: StateSpaceNoise(
        **{"intensity": 1.0, "A": [[-1.0]], "B": [1.0], "C": [1.0]} | wrong
    ),
    ({"C": Scene}, "C must be a list, got <class"),
    ({"C": "x"}, "C must be a list, got 'x'"),
    ({"B": 3.0}, "B must be a list, got 3.0"),
    ({"B": [[1.0], [2.0, 3.0]]}, "needs B with 1 rows of equal length"),
)


# ------------------------------------------------------------------------------
# Roads of ISO 8608: class table, units, and the response to a road checked in time.
# ------------------------------------------------------------------------------


def test_each_class_is_four_times_the_one_before_from_16_cubic_millimetres_times_1000() -> None:
    assert list(ROUGHNESS) == list("ABCDEFGH")
    for power, roughness in enumerate(ROUGHNESS.values()):
        assert roughness == pytest.approx(16e-6 * 4.0**power, rel=1e-12)
    # neighbours share a limit: twice one geometric mean is half the next
    means = list(ROUGHNESS.values())
    assert [2.0 * one for one in means[:-1]] == pytest.approx([0.5 * two for two in means[1:]])


def test_the_acceleration_density_is_that_of_the_displacement_of_the_profile() -> None:
    road, speed = RoadNoise(road="D", speed_kmh=54.0, band_hz=[0.5, 30.0]), 15.0
    f = np.array([0.5, 1.0, 7.3, 30.0])
    n = f / speed
    displacement = 1024e-6 * (n / 0.1) ** -2 / speed
    np.testing.assert_allclose(road.table(f), (2.0 * np.pi * f) ** 4 * displacement, rtol=1e-12)
    assert road.table(40.0) == 0.0


def test_a_mount_that_follows_a_white_velocity_has_the_closed_form() -> None:
    """x'' + b x' + w^2 x = -d(velocity)/dt, velocity white of S0: E x^2 = S0 / (2 b)."""
    mount = Isolator(frequency_hz=5.0, zeta=0.2)
    noise = RoadNoise(roughness=3e-5, speed=20.0, band_hz=[1e-4, 1e5])
    found = screen(Scene(structure=mount, excitations=[noise])).displacement_std
    intensity = velocity_density(3e-5, 20.0) / 2.0
    # above the band lies int 1 / f^2 of the response, about 4 zeta f_n / (pi f_high)
    assert found == pytest.approx(math.sqrt(intensity / (2.0 * mount.damping_rate)), rel=1e-4)


def test_driving_over_a_profile_drawn_in_space_shakes_as_the_table_says() -> None:
    """Wavelengths of an even grid with random phases; the mean square over one period is exact."""
    speed, low, high = 10.0, 0.02, 2.0
    n = np.arange(low, high, low / 10.0)
    f = n * speed
    road = RoadNoise(road="C", speed=speed, band_hz=[low * speed, high * speed])
    amplitude = np.sqrt(2.0 * 256e-6 * (n / 0.1) ** -2 * (low / 10.0))
    phase = np.random.default_rng(3).uniform(0.0, 2.0 * np.pi, len(n))
    time = np.linspace(0.0, 10.0 / (low * speed), 40_000, endpoint=False)
    shape = np.zeros_like(time)
    for a, w, p in zip(amplitude, 2.0 * np.pi * f, phase, strict=True):
        shape += a * np.cos(w * time + p)
    step = time[1] - time[0]
    acceleration = np.gradient(np.gradient(shape, step), step)
    within = slice(5, -5)
    found = Estimate(
        value=float(np.mean(acceleration[within] ** 2)),
        # the sum of a grid against the integral, and (sin wh / wh)^4 of the two differences
        bias=road.table.mean_square()
        * (2.0 * (low / 10.0) / high + 2.0 / 3.0 * (2.0 * math.pi * high * speed * step) ** 2),
    )
    assert_agrees(found, road.table.mean_square())


def test_a_level_and_a_default_band() -> None:
    plain = RoadNoise(road="A", speed=20.0)
    assert plain.table.frequency_hz.tolist() == pytest.approx([0.2, 200.0])
    raised = RoadNoise(road="A", speed=20.0, level_db=20.0 * math.log10(2.0))
    assert raised.table.density == pytest.approx(RoadNoise(road="B", speed=20.0).table.density)
    assert "secondary sources" in plain.assumptions()[0]


test_a_mistake_gives_a_sentence = refusals(
    RoadNoise,
    ({"road": "C"}, "needs exactly one of speed and speed_kmh, got none"),
    ({"speed": 10.0}, "needs exactly one of road and roughness, got none"),
    (
        {"road": "C", "roughness": 1e-5, "speed": 10.0},
        "needs exactly one of road and roughness, got road, roughness",
    ),
    ({"road": "J", "speed": 10.0}, "road must be 'A', 'B', 'C', 'D', 'E', 'F', 'G' or 'H'"),
    ({"road": "C", "speed": -10.0}, "speed must be greater than 0, got -10.0"),
    ({"road": "C", "speed": 10.0, "on": "x"}, "moves the base, on = 'base', got on = 'x'"),
    ({"road": "C", "speed": 10.0, "level_db": 300.0}, "level_db outside -200..200, got 300"),
)


# ------------------------------------------------------------------------------
# Quarter cars: their gain, the table that they make of a road, and the mount that they carry.
# ------------------------------------------------------------------------------


ROAD = RoadNoise(road="C", speed_kmh=80.0)
OWN: dict[str, Any] = {
    "body_mass": 320.0, "wheel_mass": 45.0, "suspension_stiffness": 2e4,
    "suspension_damping": 1100.0, "tyre_stiffness": 1.8e5, "tyre_damping": 60.0,
}  # fmt: skip
GOLDEN = QuarterCar(preset="golden-car", body_mass=400.0)
CARS = {
    "golden, body": GOLDEN,
    "golden, wheel": QuarterCar(preset="golden-car", mounted_on="wheel"),
    "own, body": QuarterCar(**OWN),
    "hardly damped": QuarterCar(**(OWN | {"suspension_damping": 10.0, "tyre_damping": 0.0})),
}
MOUNT = Isolator(mass=10.0, frequency_hz=12.0, zeta=0.1)


def state_space(car: QuarterCar) -> StateSpace:
    """Body or wheel displacement from the displacement of the road, in states x and v + what the
    damping of the tyre puts into them at once."""
    golden = (1.0, 0.15, 63.3, 6.0, 653.0, 0.0)
    own = (getattr(car, key) for key in OWN)
    ms, mu, ks, cs, kt, ct = golden if car.preset else own
    a = np.array(
        [
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [-ks / ms, ks / ms, -cs / ms, cs / ms],
            [ks / mu, -(ks + kt) / mu, cs / mu, -(cs + ct) / mu],
        ]
    )
    # with p = x_u' - (c_t / m_u) z in place of the velocity of the wheel no z' is needed
    jump = np.array([[0.0], [0.0], [0.0], [ct / mu]])
    b = np.array([[0.0], [0.0], [0.0], [kt / mu]]) + a @ jump
    c = np.array([[1.0, 0.0, 0.0, 0.0] if car.mounted_on == "body" else [0.0, 1.0, 0.0, 0.0]])
    return StateSpace(a, b, c, np.zeros((1, 1)))


def response(space: StateSpace, f: np.ndarray) -> np.ndarray:
    """C (s - A)^-1 B at frequencies in Hz."""
    s = 2j * np.pi * np.atleast_1d(f)[:, None, None] * np.eye(4)
    return (space.C @ np.linalg.solve(s - space.A, space.B[None].repeat(len(s), 0)))[:, 0, 0]


@pytest.mark.parametrize("name", list(CARS))
def test_the_gain_is_that_of_the_state_space(name: str) -> None:
    car = CARS[name]
    f = np.geomspace(0.05, 200.0, 300)
    known = response(state_space(car), f)
    np.testing.assert_allclose(car.gain(f), known, rtol=1e-9)
    other = car.model_copy(update={"mounted_on": "wheel" if car.mounted_on == "body" else "body"})
    assert np.abs(other.gain(f) / known - 1.0).max() > 0.1


def test_a_road_that_is_a_sine_moves_the_body_by_the_gain() -> None:
    car, f = CARS["own, body"], 3.0
    time = np.linspace(0.0, 20.0, 40_001)
    _, moved, _ = lsim(state_space(car), np.sin(2.0 * np.pi * f * time), time)
    gain = complex(car.gain(f))
    settled = time > 15.0
    expected = np.abs(gain) * np.sin(2.0 * np.pi * f * time + np.angle(gain))
    assert np.abs(moved - expected)[settled].max() < 1e-5


@pytest.mark.parametrize("name", list(CARS))
def test_the_table_is_as_close_to_the_density_as_it_says(name: str) -> None:
    car = CARS[name]
    table = ROAD.behind(car).table
    f = np.exp(np.random.default_rng(1).uniform(*np.log(table.frequency_hz[[0, -1]]), 20_000))
    exact_density = ROAD.table(f) * np.abs(car.gain(f)) ** 2
    # between the middle, where the error is held to 1e-6, and the ends of an interval
    assert np.abs(table(f) / exact_density - 1.0).max() < 1.5e-6
    assert len(table.frequency_hz) < 30_000


def test_class_c_at_80_kmh_shakes_the_golden_car_as_the_integral_says() -> None:
    space = state_space(GOLDEN)

    def density(f: float) -> float:  # road acceleration times the gain, in (m/s^2)^2/Hz
        velocity = (2.0 * math.pi * 0.1) ** 2 * 256e-6 * (80.0 / 3.6)
        gain = response(space, np.array(f))[0]
        return (2.0 * math.pi * f) ** 2 * velocity * abs(gain) ** 2

    speed = 80.0 / 3.6
    cuts = [0.01 * speed, 0.8, 1.2, 2.0, 6.0, 10.0, 14.0, 30.0, 10.0 * speed]
    parts = [quad(density, a, b, epsrel=1e-10)[0] for a, b in itertools.pairwise(cuts)]
    found = ROAD.behind(GOLDEN).table
    assert found.mean_square() == pytest.approx(sum(parts), rel=1e-6)
    assert math.sqrt(found.mean_square()) == pytest.approx(1.622, abs=0.001)
    coarse = found.frequency_hz[::400]
    rough = Table(frequency_hz=coarse, density=found(coarse))
    assert abs(rough.mean_square() / sum(parts) - 1.0) > 1e-4


def with_reaction(car: QuarterCar, mount: Isolator, mass: float) -> float:
    """Rms stroke of the mount where it acts back on the vehicle, m: body, wheel and box on the
    road by matrices."""
    m, c, k = (np.pad(each, (0, 1)) for each in car.matrices)
    m[2, 2] = mass
    stroke = np.array([-1.0, 0.0, 1.0])
    c += mass * mount.damping_rate * np.outer(stroke, stroke)
    k += mass * mount.omega**2 * np.outer(stroke, stroke)
    whole = Scene(
        structure=Matrices(coordinates=["body", "wheel", "box"], mass=m, damping=c, stiffness=k),
        excitations=[ROAD],
    )
    modes = model_of(whole).modal
    law = covariance(modes.tables, np.diag(modes.squares), modes.damping)
    row = stroke @ modes.shapes
    return math.sqrt(row @ law[:3, :3] @ row)


def test_the_reaction_of_the_mount_vanishes_with_its_mass() -> None:
    scene = Scene(structure=MOUNT, vehicle=GOLDEN, excitations=[ROAD])
    alone = exact(scene).coordinates["x"]["displacement_std"].value
    off = {mass: with_reaction(GOLDEN, MOUNT, mass) / alone - 1.0 for mass in (4.0, 0.4, 0.04)}
    assert 1e-3 < abs(off[4.0]) < 0.05
    assert off[0.4] == pytest.approx(off[4.0] / 10.0, rel=0.1)
    assert off[0.04] == pytest.approx(off[0.4] / 10.0, rel=0.02)
    assert abs(with_reaction(CARS["own, body"], MOUNT, 0.04) / alone - 1.0) > 0.05


def test_a_scene_says_its_vehicle_and_passes_levels_through_it() -> None:
    scene = load_scene(shipped_scene("isolator-vehicle"))
    assert scene.vehicle is not None
    words = " ".join(scene.assumptions())
    body, wheel = scene.vehicle.modes
    for part in (f"{body.frequency_hz:.3g} Hz", f"{wheel.frequency_hz:.3g} Hz", "2.5 % of that of"):
        assert part in words
    assert not model_of(scene).cautions
    bare = Scene(structure=scene.structure, excitations=[ROAD])
    assert any("[vehicle]" in caution for caution in model_of(bare).cautions)
    (road,) = scene.at_level(20.0).excitations
    np.testing.assert_allclose(road.table.density, 100.0 * scene.excitations[0].table.density)
    again = Scene(**scene.document())
    np.testing.assert_array_equal(again.excitations[0].table.density,
                                  scene.excitations[0].table.density)  # fmt: skip
    rows = scene.excitations[0].facts("base", scene.excitations[0].numbers())
    assert any("quarter car" in " ".join(row) for row in rows)


def test_a_scene_that_takes_the_road_of_another_leaves_that_as_it_is() -> None:
    first = load_scene(shipped_scene("isolator-vehicle"))
    table = first.excitations[0].table
    again = first.replace(title="again")
    bare = first.replace(vehicle=None)
    assert first.excitations[0].table == table
    assert again.excitations[0].table == table
    assert bare.excitations[0].table != table
    assert bare.replace(vehicle=first.vehicle).excitations[0].table == table


def test_a_load_of_the_base_may_stand_beside_the_road() -> None:
    pressed = ConstantLoad(acceleration=9.80665)
    scene = Scene(structure=MOUNT, vehicle=GOLDEN, excitations=[ROAD, pressed])
    mean = exact(scene).coordinates["x"]["displacement_mean"].value
    assert mean == pytest.approx(-9.80665 / MOUNT.omega**2)


test_a_vehicle_that_is_not_whole_is_refused = refusals(
    QuarterCar,
    ({}, "needs body_mass, wheel_mass"),
    ({"preset": "golden-car", "wheel_mass": 3.0}, "takes a preset, or parameters of its own"),
    ({"preset": "van"}, "golden-car"),
    (OWN | {"body_mass": -1.0}, "body_mass"),
    ({key: OWN[key] for key in list(OWN)[:4]}, "needs tyre_stiffness"),
)


def test_what_does_not_go_through_a_vehicle_is_refused() -> None:
    tone = Sine(on="base", amplitude=1.0, frequency_hz=5.0)
    with pytest.raises(SceneError, match=r"excitation\.1 of kind 'sine' acts on the base"):
        Scene(structure=MOUNT, vehicle=GOLDEN, excitations=[ROAD, tone])
    push = Sine(on="x", amplitude=1.0, frequency_hz=5.0)
    assert Scene(structure=MOUNT, vehicle=GOLDEN, excitations=[ROAD, push]).vehicle == GOLDEN
    with pytest.raises(SceneError, match="needs an excitation of kind 'road'"):
        Scene(structure=MOUNT, vehicle=GOLDEN, excitations=[push])


def test_moments_of_a_table_without_wide_panels_are_those_of_its_density() -> None:
    # a flat density by its ends or by as many breakpoints as a filtered one has is the same
    f = np.geomspace(1.0, 100.0, 5000)
    ends, dense = (Table(frequency_hz=each, density=np.ones(len(each))) for each in (f[[0, -1]], f))
    few, many = (response_moments([table], 75.0, 15.0) for table in (ends, dense))
    assert many.displacement == pytest.approx(few.displacement, rel=1e-9)
    assert many.absolute_acceleration == pytest.approx(few.absolute_acceleration, rel=1e-9)
