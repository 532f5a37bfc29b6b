"""Vibration isolators between stops, on trucks and on shakers."""

from __future__ import annotations

import math

import numpy as np

from stochvi.isolators.screening import screen
from stochvi.scenes.excitations import ConstantLoad, FilteredNoise, Sine, TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Elastic, Hertz, Law, Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Isolator, Matrices
from support.soft_stops import RUBBER

TRUCK = "mil-std-810h-truck-vertical-5hz"


def isolator(gap: float | None, restitution: float = 0.5, **noise: object) -> Scene:
    law = Restitution(coefficient=restitution)
    pairs = [] if gap is None else [ImpactPair(lower=-gap, upper=gap, law=law)]
    excitation = TabulatedNoise(**(noise or {"profile": TRUCK}))
    return Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        impact_pairs=pairs,
        excitations=[excitation],
    )


HOUR = 3600.0


def ten_hertz(zeta: float, law: Law | None = None) -> Scene:
    pairs = [] if law is None else [ImpactPair(lower=-1e-3, upper=1e-3, law=law)]
    return Scene(
        structure=Isolator(frequency_hz=10.0, zeta=zeta),
        impact_pairs=pairs,
        excitations=[WhiteNoise(density=0.01, unit="g2/Hz")],
    )


def truck(law: Law) -> Scene:
    mount = Isolator(mass=1.0, damping=2.4 * math.pi * 2.0, stiffness=(24.0 * math.pi) ** 2)
    return Scene(
        structure=mount,
        impact_pairs=[ImpactPair(lower=-1e-3, upper=1e-3, law=law)],
        excitations=[TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")],
    )


def two_stages(first: Law, second: Law) -> Scene:
    """A box of 20 kg at 12 Hz on a frame of 100 kg at 15 Hz, on a truck."""
    k1, k2 = 100.0 * (30.0 * math.pi) ** 2, 20.0 * (24.0 * math.pi) ** 2
    c1, c2 = 2.0 * 0.08 * math.sqrt(k1 * 120.0), 2.0 * 0.1 * math.sqrt(k2 * 20.0)
    return Scene(
        structure=Matrices(
            coordinates=["frame", "box"],
            mass=np.diag([100.0, 20.0]),
            stiffness=[[k1 + k2, -k2], [-k2, k2]],
            damping=[[c1 + c2, -c2], [-c2, c2]],
        ),
        impact_pairs=[
            ImpactPair(name="bumpers", on="frame", lower=-2e-3, upper=1.5e-3, law=first),
            ImpactPair(
                name="box stops", between=["box", "frame"], lower=-2e-3, upper=3e-3, law=second
            ),
        ],
        excitations=[TabulatedNoise(on="base", profile="mil-std-810h-truck-vertical-5hz")],
    )


MOUNT = 2.0 * math.pi * 12.0
"""Of the mount on a truck, rad/s."""


def bumpered_mount(law: Law, *, sigmas: float = 2.0, mass: float = 1.0, **parts: object) -> Scene:
    """A 12 Hz mount on a truck with stops at so many standard deviations without stops."""
    noise = TabulatedNoise(profile=TRUCK)
    structure = Isolator(frequency_hz=12.0, zeta=0.1, mass=mass)
    gap = sigmas * screen(Scene(structure=structure, excitations=[noise])).displacement_std
    return Scene(
        structure=structure,
        impact_pairs=[ImpactPair(lower=-gap, upper=gap, law=law)],
        excitations=[noise, *parts.get("beside", [])],
    )


COMPANY = {
    "viscoelastic": (RUBBER.per_unit_mass(1.0 / MOUNT**2), []),
    "Hertz, load": (Hertz(coefficient=1e6), [ConstantLoad(acceleration=5.0)]),
    "sine, filtered noise": (
        Elastic(stiffness=30.0 * MOUNT**2),
        [
            Sine(amplitude=3.0, frequency_hz=17.0),
            FilteredNoise(density=0.3, unit="(m/s2)2/Hz", frequency_hz=9.0, zeta=0.2),
        ],
    ),
}
