"""Linearised springs and dampers that are functions: closed forms, sampling, other methods."""

from __future__ import annotations

import contextlib
import math
import warnings
from typing import Any

import numpy as np
import pytest

from stochvi import (
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    NotConverged,
    Oscillator,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    exact,
    linearise,
    simulate,
)
from stochvi.scenes import BoucWen, FilteredNoise, VanDerPol

ROPE = {"kind": "bouc-wen", "stiffness": 2.0, "yield_displacement": 0.3}
RIGID = [ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))]


def scene_of(pairs: Any = (), excitation: Any = None, **keys: Any) -> Scene:
    """A mass of 2 kg with a spring of 1 N/m and a damper of 0.2 N s/m in noise of 0.4 N^2 s."""
    return Scene(
        structure=Oscillator(**{"mass": 2.0, "damping": 0.2, "stiffness": 1.0} | keys),
        impact_pairs=list(pairs),
        excitations=excitation or [WhiteNoise(intensity=0.4)],
    )


def values(scene: Scene) -> tuple[float, float]:
    found = linearise(scene).coordinates["x"]
    return found["displacement_std"].value, found["velocity_std"].value


@pytest.mark.parametrize(("linear", "intensity"), [(0.0, 0.4), (-2.0, 0.4), (-2.0, 0.04)])
def test_a_cubic_spring_has_the_known_equation(linear: float, intensity: float) -> None:
    """k s^2 + 3 k3 s^4 = theta, with theta = S / (2 c) (B 8), between two wells as well."""
    theta, k = intensity / 0.4, 1.0 + linear
    wanted = math.sqrt((-k + math.sqrt(k**2 + 12.0 * 2.0 * theta)) / (2.0 * 3.0 * 2.0))
    spring = {"kind": "duffing", "cubic_stiffness": 2.0, "linear_stiffness": linear}
    found, speed = values(scene_of(excitation=[WhiteNoise(intensity=intensity)], spring=spring))
    assert found == pytest.approx(wanted, rel=1e-8)
    assert speed == pytest.approx(math.sqrt(theta / 2.0), rel=1e-12)


def test_dry_friction_has_the_known_equation() -> None:
    """sqrt(2 / pi) F s_v = S / (2 m): the power of friction is that of the noise."""
    _, speed = values(scene_of(damping=0.0, damper={"kind": "coulomb", "force": 0.2}))
    assert speed == pytest.approx(0.1 / (math.sqrt(2.0 / math.pi) * 0.2), rel=1e-8)


def test_a_straight_line_is_linear() -> None:
    line = {"kind": "table", "deflection": [-1.0, 1.0], "force": [-0.6, 0.6]}
    for excitation in (None, [FilteredNoise(intensity=0.4, frequency_hz=0.1, zeta=0.2)]):
        wanted = values(scene_of(excitation=excitation))
        found = values(scene_of(excitation=excitation, stiffness=0.4, spring=line))
        assert found == pytest.approx(wanted, rel=1e-9)


def test_a_table_of_noise_shakes_a_function() -> None:
    """A wide band is white noise of half its one-sided density."""
    band = [TabulatedNoise(frequency_hz=[1e-3, 50.0], density=[0.8, 0.8], unit="N2/Hz", on="x")]
    spring = {"kind": "duffing", "cubic_stiffness": 2.0}
    wanted = values(scene_of(spring=spring))
    assert values(scene_of(excitation=band, spring=spring)) == pytest.approx(wanted, rel=0.01)


def test_a_hardening_spring_between_stops_is_near_the_truth() -> None:
    scene = scene_of(RIGID, spring={"kind": "duffing", "cubic_stiffness": 2.0})
    found, known = linearise(scene), exact(scene)
    for name in ("displacement_std", "velocity_std"):
        wanted = known.coordinates["x"][name].value
        assert found.coordinates["x"][name].value == pytest.approx(wanted, rel=0.06)
        assert found.coordinates["x"][name].bias is None
    # without the spring the closure is exact, and elsewhere
    assert values(scene_of(RIGID))[0] > 1.05 * found.coordinates["x"]["displacement_std"].value


@pytest.mark.parametrize(("exponent", "beta"), [(1.0, 0.5), (2.0, 0.8), (1.7, 1.0)])
def test_the_coefficients_of_wen_are_those_of_a_quadrature(exponent: float, beta: float) -> None:
    """E dh/dv and E dh/dz of h = v - beta abs(v) z abs(z)^(n-1) - gamma v abs(z)^n."""
    rope = BoucWen(stiffness=2.0, yield_displacement=0.3, exponent=exponent, beta=beta)
    speed, deviation, correlation = 0.4, 0.5, 0.6
    u, w = np.random.default_rng(2).standard_normal((2, 1_000_000))
    v = speed / 0.3 * u
    z = deviation * (correlation * u + math.sqrt(1.0 - correlation**2) * w)
    size = np.abs(z)
    with_v = 1.0 - beta * np.sign(v) * np.sign(z) * size**exponent - (1.0 - beta) * size**exponent
    with_z = (
        -exponent * size ** (exponent - 1.0) * (beta * np.abs(v) + (1.0 - beta) * v * np.sign(z))
    )
    found = rope.wen_coefficients(speed, deviation, correlation)
    for one, samples in zip(found, (with_v / 0.3, with_z), strict=True):
        assert abs(one - samples.mean()) <= 4.5 * samples.std() / 1000.0


def test_wire_rope_is_near_the_simulation() -> None:
    mount = Isolator(mass=2.0, damping=0.2, stiffness=1.0, spring=ROPE)
    scene = Scene(structure=mount, excitations=[WhiteNoise(intensity=0.1)])
    found, known = linearise(scene), simulate(scene, paths=256, duration=100.0, seed=1)
    for name in ("displacement_std", "velocity_std", "acceleration_std"):
        wanted = known.coordinates["x"][name].value
        assert found.coordinates["x"][name].value == pytest.approx(wanted, rel=0.08), name


def test_wire_rope_of_several_coordinates_is_that_of_one() -> None:
    """A frame that hardly moves, and a rope that hardly slips, which is a spring."""
    frame = Matrices(
        coordinates=["x", "frame"],
        mass=[[2.0, 0.0], [0.0, 1e7]],
        damping=[[0.2, -0.2], [-0.2, 1e6]],
        stiffness=[[1.0, -1.0], [-1.0, 1e6]],
        spring=ROPE | {"between": ["x", "frame"]},
    )
    scene = Scene(structure=frame, excitations=[WhiteNoise(intensity=0.4, on="x")])
    found = linearise(scene).coordinates["x"]["displacement_std"].value
    assert found == pytest.approx(values(scene_of(spring=ROPE))[0], rel=1e-4)
    stiff = scene_of(stiffness=0.4, spring=ROPE | {"stiffness": 0.6, "yield_displacement": 1e5})
    assert values(stiff)[0] == pytest.approx(values(scene_of())[0], rel=1e-3)


def test_what_hysteresis_does_not_take_is_named() -> None:
    with pytest.raises(NotApplicable, match="impact_pair must be left out where a spring has"):
        linearise(scene_of(RIGID, spring=ROPE))
    band = [TabulatedNoise(frequency_hz=[0.1, 1.0], density=[0.8, 0.8], unit="N2/Hz", on="x")]
    with pytest.raises(NotApplicable, match="excitation must be white, filtered or constant"):
        linearise(scene_of(excitation=band, spring=ROPE))
    with pytest.raises(NotApplicable, match=r"structure\.spring must be linear"):
        linearise(scene_of(spring=ROPE), form="force")


def test_a_search_that_ends_nowhere_gives_no_warnings() -> None:
    """A self-excited mass at a wall, from starts that describe no response."""
    scene = Scene(
        structure=Oscillator(
            mass=1.0, damping=0.0, stiffness=1.0, damper=VanDerPol(damping=0.1, amplitude=0.5)
        ),
        impact_pairs=[ImpactPair(upper=1.0, law=Restitution(coefficient=0.8))],
        excitations=[WhiteNoise(intensity=0.05)],
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with contextlib.suppress(NotConverged, NotApplicable):
            linearise(scene)
