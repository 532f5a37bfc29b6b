"""Correlated noises on a box: closed covariances, and one noise where all is shared."""

import cmath
import math

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from stochvi import (
    FilteredNoise,
    ImpactPair,
    Restitution,
    Scene,
    TabulatedNoise,
    Viscoelastic,
    WhiteNoise,
    exact,
    simulate,
)
from stochvi.results.estimates import Estimate
from stochvi.scenes.cross_densities import CrossDensity
from stochvi.scenes.excitations import Excitation
from stochvi.testing import assert_agrees
from support.boxes import box, direct_matrices

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


def scene(kind: str, coherence: float, phase: float = 0.0, law: object = None) -> Scene:
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
    found = told(scene(kind, coherence, phase))
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
    keys = {"paths": 64, "duration": 20.0}
    joined = simulate(scene(kind, 1.0, 0.0, LAWS[law]), **keys, seed=1)
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
    with pytest.raises(AssertionError):
        assert_agrees(differences(other)[0], 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("law", list(LAWS))
def test_between_stops_noises_without_coherence_are_independent(law: str) -> None:
    keys = {"paths": 64, "duration": 20.0}
    apart, joined = (
        simulate(scene("table", coherence, 0.0, LAWS[law]), **keys, seed=1).impact_pairs["corner"]
        for coherence in (0.0, 0.9)
    )
    free = scene("table", 0.0, 0.0, LAWS[law]).replace(cross_densities=())
    known = simulate(free, **keys, seed=2).impact_pairs["corner"]

    def difference(one: Estimate, two: Estimate) -> float:
        return abs(one.value - two.value) / math.hypot(one.standard_error, two.standard_error)

    rates = [each["impact_speed_square_rate"] for each in (apart, joined, known)]
    assert difference(rates[0], rates[2]) < 4.5
    assert difference(rates[1], rates[2]) > 4.5
