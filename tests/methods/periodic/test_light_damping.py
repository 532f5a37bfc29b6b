"""Slow sweeps with light damping, whose transients take hundreds of periods and are no motions of
their own: against harmonic balance, the linear motion and a long integration."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest
from scipy.optimize import fsolve

from stochvi import Elastic, ImpactPair, Isolator, Oscillator, Restitution, Scene, harmonic_response
from stochvi.methods.periodic.contact_branches import ContactFinder
from stochvi.methods.periodic.family import Family
from stochvi.model.model import model_of
from stochvi.scenes import Duffing
from stochvi.scenes.excitations import Sine

Vector = np.ndarray
ORDERS = np.arange(1, 14, 2)
ANGLES = 2.0 * math.pi * np.arange(64) / 64
WAVES = np.concatenate([np.cos(np.outer(ORDERS, ANGLES)), np.sin(np.outer(ORDERS, ANGLES))])
TURNED = np.concatenate([-np.sin(np.outer(ORDERS, ANGLES)), np.cos(np.outer(ORDERS, ANGLES))])


LITTLE = 1.0002
"""The motion after a jump is taken a little beyond it: up to this ratio of frequencies."""


class Balance:
    """Odd harmonics of x'' + c x' + x + cubic x^3 = amplitude cos(w t), each in balance."""

    def __init__(self, damping: float, cubic: float, amplitude: float) -> None:
        self.damping, self.cubic, self.amplitude = damping, cubic, amplitude

    def residual(self, u: Vector, w: float) -> Vector:
        x, order = u @ WAVES, np.tile(ORDERS, 2)
        rate = w * (order * u) @ TURNED
        forces = 2.0 / len(ANGLES) * WAVES @ (x + self.cubic * x**3 + self.damping * rate)
        forces[0] -= self.amplitude
        return np.asarray(forces - (w * order) ** 2 * u)

    def slopes(self, u: Vector, w: float) -> Vector:
        x, order = u @ WAVES, np.tile(ORDERS, 2)
        rates = (1.0 + 3.0 * self.cubic * x**2) * WAVES + self.damping * w * order[:, None] * TURNED
        return np.asarray(2.0 / len(ANGLES) * WAVES @ rates.T - np.diag((w * order) ** 2))

    def largest(self, u: Vector) -> float:
        fine = np.linspace(0.0, 2.0 * math.pi, 4001)
        waves = np.concatenate([np.cos(np.outer(ORDERS, fine)), np.sin(np.outer(ORDERS, fine))])
        return float(np.abs(u @ waves).max())

    def regime(self, start: Vector, w: float) -> Vector:
        found = np.asarray(fsolve(self.residual, start, (w,), self.slopes, xtol=1e-13))
        assert np.abs(self.residual(found, w)).max() < 1e-10
        return found

    def jump(self) -> tuple[float, float, float, float]:
        """Frequency (Hz) at which the resonance folds, and displacements before, after, and a
        little beyond."""
        n, w = len(ORDERS), 1.0
        for _ in range(50):  # the force balances the damper where it resonates
            size = self.amplitude / (self.damping * w)
            w = math.sqrt(1.0 + 0.75 * self.cubic * size**2)
        start = np.zeros(2 * n + 1)
        start[n], start[-1] = size, w

        def resonant(z: Vector) -> Vector:
            return np.append(self.residual(z[:-1], float(z[-1])), z[0])

        peak = np.asarray(fsolve(resonant, start, xtol=1e-13))
        u, w = peak[:-1], float(peak[-1])
        assert np.abs(resonant(peak)).max() < 1e-9
        below = np.zeros(2 * n)
        below[0] = self.amplitude / (1.0 - w**2)
        after, beyond = (self.largest(self.regime(below, w * far)) for far in (1.0, LITTLE))
        return w / (2.0 * math.pi), self.largest(u), after, beyond


def hardening(damping: float, amplitude: float, cubic: float, hertz: float) -> Scene:
    return Scene(
        structure=Oscillator(
            mass=1.0, damping=damping, stiffness=1.0, spring=Duffing(cubic_stiffness=cubic)
        ),
        excitations=[Sine(amplitude=amplitude, frequency_hz=hertz)],
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("damping", "amplitude", "cubic", "high"),
    [
        (0.01, 0.05, 1.0, 0.40),
        pytest.param(2e-3, 5e-3, 0.3, 0.25, marks=pytest.mark.verify),
        pytest.param(2e-4, 1e-4, 0.3, 0.18, marks=pytest.mark.verify),
    ],
)
def test_a_hardening_spring_jumps_once_up_and_once_down(
    damping: float, amplitude: float, cubic: float, high: float
) -> None:
    found = harmonic_response(
        hardening(damping, amplitude, cubic, 0.2),
        np.linspace(0.12, high, 15),
        budget=None,
    )
    place, before, after, beyond = Balance(damping, cubic, amplitude).jump()
    up = [each for each in found.jumps if each.upwards]
    assert len(up) == 1 and len(found.jumps) == 2
    assert up[0].value == pytest.approx(place, rel=1e-5)
    assert up[0].displacement_max[0] == pytest.approx(before, rel=1e-3)
    assert beyond < up[0].displacement_max[1] < after
    # a multiplier is 1 at a fold, which breaks no symmetry; nothing else stands than the branch
    assert [each.name for each in found.special_points] == ["fold", "fold"]
    assert found.starts is not None and found.starts.all_listed and not found.starts.warning


def test_newton_finds_a_motion_a_thousand_times_as_large_as_under_a_force_at_rest() -> None:
    """It was given up there, and the motion on which a slow sweep had settled called chaotic."""
    damping, amplitude, cubic, hertz = 2e-4, 1e-4, 0.3, 0.159335
    w = 2.0 * math.pi * hertz
    model = model_of(hardening(damping, amplitude, cubic, hertz))
    family = Family.of(lambda _: model, w / 1.1, w * 1.1, None)
    found = ContactFinder(family, np.array([0.5]), 1).orbit(np.array([1139.4, 275.6]), 1, 0.5)
    start = np.zeros(2 * len(ORDERS))
    start[0], start[len(ORDERS)] = 0.114, 0.028
    known = Balance(damping, cubic, amplitude).regime(start, w)
    assert found is not None and known[: len(ORDERS)].sum() > 1000.0 * amplitude
    reached = amplitude / w**2 * found.state[0]  # kernels count in what the force alone moves
    assert reached == pytest.approx(known[: len(ORDERS)].sum(), rel=1e-6)


OMEGA, GAP, AMPLITUDE = 2.0 * math.pi * 12.0, 2e-3, 0.5


def mount(zeta: float, law: Restitution | Elastic) -> Scene:
    return Scene(
        structure=Isolator(frequency_hz=12.0, zeta=zeta, mass=1.0),
        impact_pairs=[ImpactPair(lower=-GAP, upper=GAP, law=law)],
        excitations=[Sine(amplitude=AMPLITUDE, frequency_hz=12.0, on="base")],
    )


def unstruck(zeta: float, frequency_hz: float) -> float:
    """Amplitude of the linear motion, m."""
    w = 2.0 * math.pi * frequency_hz
    return AMPLITUDE / math.hypot(OMEGA**2 - w**2, 2.0 * zeta * OMEGA * w)


@pytest.mark.slow
def test_a_light_mount_falls_off_its_rigid_stops_to_its_linear_motion() -> None:
    zeta = 0.001
    found = harmonic_response(mount(zeta, Restitution(coefficient=0.6)), np.linspace(8, 20, 13))
    last = found.jumps[[each.upwards for each in found.jumps].count(True) - 1]
    assert last.upwards and last.displacement_max[0] == pytest.approx(GAP, rel=1e-9)
    after = last.displacement_max[1]
    assert unstruck(zeta, last.value * LITTLE) < after < unstruck(zeta, last.value)
    # other sweeps jump where the linear motion meets the stops, from that motion
    for each in found.jumps[:-2] + found.jumps[-1:]:
        assert unstruck(zeta, each.value) == pytest.approx(GAP, rel=1e-6)
        assert each.displacement_max[0] == pytest.approx(GAP, rel=1e-6)
    # chaos is near resonance only: elsewhere the linear motion still decays, and is known
    assert found.starts is not None and found.starts.elsewhere is not None
    low, high = found.starts.elsewhere
    assert unstruck(zeta, low) > 0.99 * GAP and unstruck(zeta, high) > 0.99 * GAP


@numba.njit
def settled(zeta: float, stiffness: float, frequency_hz: float, periods: int) -> float:
    """Largest displacement of a mount with elastic stops, by Runge and Kutta's method from the
    linear motion at its phase 0."""
    w = 2.0 * math.pi * frequency_hz
    h, largest = 2.0 * math.pi / w / 256.0, 0.0
    real, imag = OMEGA**2 - w**2, 2.0 * zeta * OMEGA * w
    size = AMPLITUDE / (real**2 + imag**2)
    x, v = size * real, size * imag * w
    for step in range(periods * 256):
        kx, kv, sx, sv = 0.0, 0.0, 0.0, 0.0
        for part in range(4):
            share = 0.0 if part == 0 else (1.0 if part == 3 else 0.5)
            px, pv = x + share * h * kx, v + share * h * kv
            push = stiffness * (max(px - GAP, 0.0) - max(-GAP - px, 0.0))
            force = AMPLITUDE * math.cos(w * h * (step + share))
            kx, kv = pv, force - OMEGA**2 * px - 2.0 * zeta * OMEGA * pv - push
            weight = 1.0 if part in (0, 3) else 2.0
            sx, sv = sx + weight * kx, sv + weight * kv
        x, v = x + h * sx / 6.0, v + h * sv / 6.0
        if step >= (periods - 2) * 256:
            largest = max(largest, abs(x))
    return largest


@pytest.mark.slow
def test_a_light_mount_jumps_onto_its_elastic_stops_and_off_them() -> None:
    """Transients were three jumps upwards, 4.78 to 2.73 to 0.054 to 0.035 mm, and chaos."""
    zeta, stiffness = 0.005, 3e4
    found = harmonic_response(mount(zeta, Elastic(stiffness=stiffness)), np.linspace(8, 40, 15))
    (up,) = [each for each in found.jumps if each.upwards]
    assert unstruck(zeta, up.value * LITTLE) < up.displacement_max[1] < unstruck(zeta, up.value)
    assert up.displacement_max[0] > 2.0 * GAP
    (down,) = [each for each in found.jumps if not each.upwards]
    assert unstruck(zeta, down.value) == pytest.approx(GAP, rel=1e-5)
    after = settled(zeta, stiffness, down.value * (1.0 - 1e-4), 1500)
    assert down.displacement_max == pytest.approx((GAP, after), rel=1e-4)
    assert found.starts is not None and found.starts.all_listed
