"""Scenes at the edge of what a simulation can be asked, by name; theta = omega = 1 unless said."""

from __future__ import annotations

import math
from typing import Any

from stochvi import (
    ConstantLoad,
    Elastic,
    ImpactPair,
    Isolator,
    Oscillator,
    Restitution,
    Scene,
    TabulatedNoise,
    Viscoelastic,
    WhiteNoise,
)
from stochvi.scenes.excitations import FilteredNoise, Sine
from stochvi.scenes.impact_laws import Law
from stochvi.scenes.structures import Matrices

RESONANCE_HZ = 0.5 / math.pi
"""Of an oscillator with omega = 1."""


def oscillator(
    lower: float | None,
    upper: float | None,
    law: float | Law,
    *,
    load: float = 0.0,
    omega: float = 1.0,
    damping: float = 0.1,
    intensity: float = 0.2,
    excitation: Any = None,
) -> Scene:
    """x'' + b x' + omega^2 x = f(t) + load between stops; a number for a law is a restitution."""
    stop = Restitution(coefficient=law) if isinstance(law, (int, float)) else law
    noise = WhiteNoise(intensity=intensity) if excitation is None else excitation
    return Scene(
        structure=Oscillator(mass=1.0, damping=damping, stiffness=omega**2),
        impact_pairs=[ImpactPair(lower=lower, upper=upper, law=stop)],
        excitations=[noise, *([ConstantLoad(force=load)] if load else [])],
    )


def pair(name: str, law: float, lower: float | None, upper: float | None, **where: Any) -> dict:
    """An impact pair by its keys."""
    stops = {"lower": lower, "upper": upper}
    given = {side: stop for side, stop in stops.items() if stop is not None}
    return {"name": name, "law": {"coefficient": law}, **given, **where}


def two_masses(
    masses: tuple[float, float],
    damping: tuple[float, float],
    stiffness: tuple[float, float],
    pairs: list[dict],
    *,
    coupling: float = 0.0,
    noises: tuple[float, float] = (0.2, 0.0),
) -> Scene:
    """Masses a and b on springs of their own, and one between them."""
    k, (k_a, k_b) = coupling, stiffness
    return Scene(
        structure=Matrices(
            coordinates=("a", "b"),
            mass=[[masses[0], 0.0], [0.0, masses[1]]],
            damping=[[damping[0], 0.0], [0.0, damping[1]]],
            stiffness=[[k_a + k, -k], [-k, k_b + k]],
        ),
        impact_pairs=[ImpactPair(**keys) for keys in pairs],
        excitations=[
            WhiteNoise(on=on, intensity=noise)
            for on, noise in zip("ab", noises, strict=True)
            if noise
        ],
    )


def absorber(law: float, box: float = 2.0) -> Scene:
    """A mass of 0.1 kg without a spring in a box (its whole width) on a shaken structure."""
    inside = pair("box", law, -box / 2.0, box / 2.0, between=("b", "a"))
    return two_masses((1.0, 0.1), (0.1, 0.0), (1.0, 0.0), [inside])


def isolator(low_hz: float, high_hz: float, gap: float) -> Scene:
    """12 Hz between stops at +-gap (m), shaken by 1 (m/s^2)^2/Hz between two frequencies."""
    table = TabulatedNoise(frequency_hz=[low_hz, high_hz], density=[1.0, 1.0], unit="(m/s2)2/Hz")
    return Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        impact_pairs=[ImpactPair(lower=-gap, upper=gap, law=Restitution(coefficient=0.5))],
        excitations=[table],
    )


def filtered(times: float) -> Scene:
    """Narrow-band noise (zeta = 0.02) at so many times the resonance, of intensity 0.2."""
    noise = FilteredNoise(intensity=0.2, frequency_hz=times * RESONANCE_HZ, zeta=0.02)
    return oscillator(-1.0, 1.0, 0.5, excitation=noise)


def small_and_stiff() -> Scene:
    """1e-9 kg on 1e9 N/m, zeta = 0.05, stops at one standard deviation, R = 0.5."""
    mass, stiffness = 1e-9, 1e9
    omega = math.sqrt(stiffness / mass)
    damping, deviation = 0.1 * mass * omega, 1e-6
    intensity = 2.0 * damping * stiffness * deviation**2
    return Scene(
        structure=Oscillator(mass=mass, damping=damping, stiffness=stiffness),
        impact_pairs=[
            ImpactPair(lower=-deviation, upper=deviation, law=Restitution(coefficient=0.5))
        ],
        excitations=[WhiteNoise(intensity=intensity)],
    )


CASES: dict[str, Scene] = {
    "R = 0": oscillator(-1.0, 1.0, 0.0),
    "R = 0.1, collapse": oscillator(-1.0, 1.0, 0.1),
    "R = 1": oscillator(-1.0, 1.0, 1.0),
    "static force 1 on a stop, R = 0.5": oscillator(None, 0.0, 0.5, load=1.0),
    "static force 10 on a stop, R = 0.5": oscillator(None, 0.0, 0.5, load=10.0),
    "static force 100 on a stop, R = 0.5": oscillator(None, 0.0, 0.5, load=100.0),
    "static force 100 on a stop, R = 0": oscillator(None, 0.0, 0.0, load=100.0),
    "static force 100 on a stop, R = 1": oscillator(None, 0.0, 1.0, load=100.0),
    "gap 1e-6, R = 1": oscillator(-1e-6, 1e-6, 1.0),
    "gap 1e-6, R = 0.5": oscillator(-1e-6, 1e-6, 0.5),
    "gap 1e6": oscillator(-1e6, 1e6, 0.5),
    "preload 5, R = 0.5": oscillator(None, -5.0, 0.5),
    "preload 5, R = 1": oscillator(None, -5.0, 1.0),
    "undamped, R = 0.7": oscillator(-1.0, 1.0, 0.7, damping=0.0),
    "overdamped, zeta = 50, R = 0.5": oscillator(-1.0, 1.0, 0.5, damping=100.0, intensity=200.0),
    "elastic stop, 1e8 times the spring": oscillator(-1.0, 1.0, Elastic(stiffness=1e8)),
    "viscoelastic stop, 1e8 times the spring": oscillator(
        -1.0, 1.0, Viscoelastic(stiffness=1e8, damping_ratio=0.2)
    ),
    "no spring, no damper, R = 0.5": oscillator(-1.0, 1.0, 0.5, omega=0.0, damping=0.0),
    "1e-9 kg, 1e9 N/m": small_and_stiff(),
    "two modes, frequencies 1 : 1e4": two_masses(
        (1.0, 1.0), (1.0, 1e4), (1.0, 1e8), [pair("stop", 0.5, -1.0, 1.0, on="a")],
        coupling=1.0, noises=(2.0, 2e4),
    ),
    "two pairs on one coordinate": two_masses(
        (1.0, 1.0), (0.1, 0.1), (1.0, 1.0), noises=(0.2, 0.2),
        pairs=[pair("floor", 1.0, -1.0, None, on="a"), pair("ceiling", 1.0, None, 1.0, on="a")],
    ),
    "stops and a neighbour, R = 0.5": two_masses(
        (1.0, 1.0), (0.1, 0.1), (1.0, 1.0), noises=(0.2, 0.2),
        pairs=[
            pair("wall of a", 0.5, -0.1, 0.1, on="a"),
            pair("wall of b", 0.5, -0.1, 0.1, on="b"),
            pair("neighbour", 0.5, -0.05, 0.05, between=("a", "b")),
        ],
    ),
    "free absorber, R = 0": absorber(0.0),
    "free absorber, R = 0.5": absorber(0.5),
    "free absorber, R = 1": absorber(1.0),
    "free absorber, box 12 wide, R = 0.5": absorber(0.5, 12.0),
    "sine alone, at resonance": oscillator(
        -1.0, 1.0, 0.5, excitation=Sine(amplitude=1.0, frequency_hz=RESONANCE_HZ)
    ),
    "sine alone, overdamped (zeta = 15)": oscillator(
        -1.0, 1.0, 0.5, damping=30.0, excitation=Sine(amplitude=90.0, frequency_hz=RESONANCE_HZ)
    ),
    "filtered noise at the resonance": filtered(1.0),
    "filtered noise at 1000 times the resonance": filtered(1000.0),
    "table far below the resonance": isolator(0.05, 0.5, 1e-4),
    "table far above the resonance": isolator(500.0, 2000.0, 2e-6),
}  # fmt: skip
"""Scenes that have a stationary state."""

NO_STATE: dict[str, Scene] = {
    "undamped, R = 1": oscillator(-1.0, 1.0, 1.0, damping=0.0),
    "no spring, one stop": oscillator(None, 1.0, 0.5, omega=0.0),
    "no spring, a static force": oscillator(-1.0, None, 0.5, omega=0.0, load=1.0),
    "free mass behind one stop": two_masses(
        (1.0, 1.0), (0.1, 0.1), (1.0, 0.0), [pair("stop", 0.5, None, 1.0, between=("b", "a"))]
    ),
    "stops that nothing shakes": two_masses(
        (1.0, 1.0), (0.1, 0.1), (1.0, 1.0), [pair("stop", 0.5, -1.0, 1.0, on="b")]
    ),
    "constant load alone": oscillator(-1.0, 1.0, 0.5, excitation=ConstantLoad(force=1.0)),
}
"""Scenes that have none, or nothing but rest: `simulate` says so in a sentence."""
