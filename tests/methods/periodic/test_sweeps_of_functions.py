"""Slow sweeps and exponents where springs and dampers are functions."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stochvi import (
    ImpactPair,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    Viscoelastic,
    WhiteNoise,
)
from stochvi.methods.periodic import Bifurcation, basins, bifurcation, lyapunov_exponent
from stochvi.scenes import BoucWen, Duffing, SpringTable
from stochvi.statistics import lifetimes

C, CUBIC, AMPLITUDE = 0.05, 1.0, 7.5
"""Damping, N s/m, cubic stiffness, N/m^3, and force, N, of Ueda's oscillator of 1 kg, whose motion
under cos t is chaotic (Y. Ueda, J. Stat. Phys. 20 (1979) 181)."""


def ueda(damping: float = C) -> Scene:
    return Scene(
        structure=Oscillator(
            mass=1.0, damping=damping, stiffness=1e-9, spring=Duffing(cubic_stiffness=CUBIC)
        ),
        excitations=[Sine(amplitude=AMPLITUDE, frequency_hz=0.5 / math.pi)],
    )


def grown(damping: float, periods: int) -> tuple[float, float]:
    """Growth of a solution of the variational equation, 1/s, and its standard error."""

    def rate(t: float, y: np.ndarray) -> list[float]:
        x, v, a, b = y
        push = AMPLITUDE * math.cos(t) - damping * v - CUBIC * x**3
        return [v, push, b, -damping * b - 3.0 * CUBIC * x**2 * a]

    y, turn, logs = np.array([1.0, 3.0, 1.0, 0.0]), 2.0 * math.pi, list[float]()
    for _ in range(periods):
        y = solve_ivp(rate, (0.0, turn), y, method="DOP853", rtol=1e-8, atol=1e-10).y[:, -1]
        logs.append(math.log(math.hypot(y[2], y[3])))
        y[2:] /= math.hypot(y[2], y[3])
    means = np.array([part.mean() for part in np.array_split(logs[periods // 10 :], 30)]) / turn
    return float(means.mean()), float(means.std(ddof=1) / math.sqrt(len(means)))


@pytest.mark.slow
def test_the_exponent_of_a_chaotic_motion_is_that_of_its_variational_equation() -> None:
    found = lyapunov_exponent(ueda(), {"displacement.x": 1.0, "velocity.x": 3.0})
    wanted, error = grown(C, 1500)
    limit = 4.0 * math.hypot(error, found.standard_error)
    assert abs(found.value - wanted) < limit
    # a motion that loses more is less chaotic
    calmer, _ = grown(6.0 * C, 400)
    assert found.value - calmer > limit


def oscillator(restitution: float | None = None, damping: float = 0.1, **keys: object) -> Scene:
    law = None if restitution is None else Restitution(coefficient=restitution)
    return Scene(
        structure=Oscillator(**{"mass": 1.0, "damping": damping, "stiffness": 1.0} | keys),
        impact_pairs=[] if law is None else [ImpactPair(lower=-0.8, upper=1.0, law=law)],
        excitations=[Sine(amplitude=0.5, frequency_hz=0.2)],
    )


def swept(scene: Scene, frequencies: list[float]) -> Bifurcation:
    return bifurcation(scene, frequencies, settling=400, watched=256)


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [None, 0.95])
def test_areas_of_states_shrink_by_damping_and_impacts(restitution: float | None) -> None:
    """Where both multipliers have one size, a motion of n impacts per period T has the exponent
    -c / 2 m + n ln R / T: areas shrink by exp(-c T / m) and by R^2 at each impact."""
    scene = oscillator(restitution, spring=Duffing(cubic_stiffness=0.5))
    (sweep,) = swept(scene, [0.15, 0.2, 0.3]).sweeps
    impacts = np.array([len(speeds) for speeds in sweep.impact_speed]) / 256
    log = 0.0 if restitution is None else math.log(restitution)
    wanted = -0.05 + impacts * log * sweep.frequency_hz
    complex_pair = np.abs(sweep.lyapunov - wanted) < 4.0 * sweep.lyapunov_error
    assert np.all(sweep.periods > 0)
    assert np.any(impacts > 0.0) == (restitution is not None)
    assert np.all(complex_pair)
    other = swept(scene.replace(structure=scene.structure.replace(damping=0.13)), [0.15, 0.2])
    apart = np.abs(other.sweeps[0].lyapunov - wanted[:2])
    assert np.all(apart > 4.0 * other.sweeps[0].lyapunov_error)


@pytest.mark.slow
@pytest.mark.parametrize("law", [Restitution(coefficient=0.7),
                                 Viscoelastic(stiffness=30.0, damping_ratio=0.1)])  # fmt: skip
def test_a_straight_table_sweeps_as_a_linear_spring(law: object) -> None:
    table = SpringTable(deflection=[1.0, 2.0], force=[0.5, 1.0])
    pairs = [ImpactPair(lower=-0.8, upper=1.0, law=law)]
    scenes = [oscillator(stiffness=0.5, spring=table), oscillator()]
    own, linear = (
        swept(each.replace(impact_pairs=pairs), [0.18, 0.2, 0.25]).sweeps[0] for each in scenes
    )
    assert own.periods.tolist() == linear.periods.tolist()
    assert any(len(speeds) for speeds in linear.impact_speed)
    for one, other in zip(own.impact_speed, linear.impact_speed, strict=True):
        assert one == pytest.approx(other, rel=1e-6)
    assert own.lyapunov == pytest.approx(linear.lyapunov, abs=1e-6)


def test_hysteresis_starts_without_a_memory() -> None:
    scene = oscillator(0.7, spring=BoucWen(stiffness=1.0, yield_displacement=0.3))
    found = bifurcation(scene, [0.18, 0.2], start={"velocity.x": 0.2}, settling=64, watched=64)
    assert np.all(np.isfinite(found.sweeps[0].lyapunov))


def test_a_map_of_basins_names_what_follows_functions() -> None:
    with pytest.raises(NotApplicable, match="sine finds its regimes, and bifurcation follows"):
        basins(oscillator(spring=Duffing(cubic_stiffness=1.0)))
    noisy = oscillator(spring=Duffing(cubic_stiffness=1.0))
    noisy = noisy.replace(excitations=(*noisy.excitations, WhiteNoise(intensity=0.01)))
    with pytest.raises(NotApplicable, match="sine finds its regimes, and bifurcation follows"):
        lifetimes(noisy)
