"""Oscillators between stops that give way, and the laws of such stops."""

from __future__ import annotations

import numpy as np

from stochvi.model.model import Model
from stochvi.scenes.excitations import ConstantLoad, WhiteNoise
from stochvi.scenes.impact_laws import Elastic, ForceTable, Hertz, Law, Restitution, Viscoelastic
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Oscillator

STEEL, RUBBER = Elastic(stiffness=100.0), Viscoelastic(stiffness=100.0, damping_ratio=0.2)
BALL = Hertz(coefficient=100.0)
BUMPER = ForceTable(deflection=[0.05, 0.2, 0.3], force=[5.0, 5.0, 30.0])
WALL = Restitution(coefficient=1.0)


def scene(
    lower: float | None,
    upper: float | None,
    law: Law | None = None,
    *,
    lower_law: Law | None = None,
    upper_law: Law | None = None,
    load: float = 0.0,
    omega: float = 1.0,
    damping: float = 0.1,
    mass: float = 1.0,
) -> Scene:
    """theta = 1 with b = 0.1; the laws are those of 1 kg."""
    scaled = {
        key: None if value is None else value.per_unit_mass(1.0 / mass)
        for key, value in (("law", law), ("lower_law", lower_law), ("upper_law", upper_law))
    }
    noise = WhiteNoise(intensity=0.2 * mass**2)
    loads = [ConstantLoad(force=load * mass)] if load else []
    return Scene(
        structure=Oscillator(mass=mass, damping=damping * mass, stiffness=omega**2 * mass),
        impact_pairs=[ImpactPair(lower=lower, upper=upper, **scaled)],
        excitations=[noise, *loads],
    )


EXACT = {
    "linear": scene(-1.0, 1.0, STEEL),
    "Hertz": scene(-1.0, 1.0, BALL),
    "table": scene(-1.0, 1.0, BUMPER),
    "soft": scene(-1.0, 1.0, Elastic(stiffness=1e-2)),
    "stiff": scene(-1.0, 1.0, Elastic(stiffness=1e8)),
    "stiff Hertz": scene(-1.0, 1.0, Hertz(coefficient=1e8)),
    "unequal, with a wall": scene(-0.5, 1.0, lower_law=STEEL, upper_law=WALL),
    "wall below, load": scene(-0.5, 0.3, lower_law=WALL, upper_law=BALL, load=0.4),
    "preload": scene(None, -1.0, STEEL),
    "preload, Hertz": scene(None, -1.0, BALL),
    "preload, table": scene(0.5, None, BUMPER),
    "preload, stiff": scene(None, -1.0, Elastic(stiffness=1e8)),
    "load on a stop": scene(-1.0, 1.0, BUMPER, load=3.0),
    "hardly a gap": scene(-1e-9, 1e-9, lower_law=STEEL, upper_law=Elastic(stiffness=3.0)),
    "no spring": scene(-1.0, 1.0, STEEL, omega=0.0),
    "no spring, table": scene(-0.01, 0.01, BUMPER, omega=0.0),
}


def stops_of(model: Model) -> list[tuple[float, float, Law]]:
    """(side, position, law per unit mass) of each stop of one oscillator."""
    return [(stop.side, stop.position, stop.law) for stop in model.stops_per_unit_mass]


CONTACTS = {
    "elastic": STEEL,
    "stiff": Elastic(stiffness=1e8),
    "z = 0.2": RUBBER,
    "z = 0.7": Viscoelastic(stiffness=1e8, damping_ratio=0.7),
    "z = 1": Viscoelastic(stiffness=100.0, damping_ratio=1.0),
    "z = 3": Viscoelastic(stiffness=100.0, damping_ratio=3.0),
    "Hertz": BALL,
    "table": BUMPER,
}


def random_stop(rng: np.random.Generator) -> Law:
    """Stiffnesses over many orders, dampings of all sizes, tables with plateaus."""
    size = 10.0 ** rng.uniform(-4.0, 9.0)
    steps = 10.0 ** rng.uniform(-4.0, 3.0, 4) * rng.integers(0, 2, 4) + 1e-6
    choices: list[Law] = [
        Elastic(stiffness=size),
        Viscoelastic(stiffness=size, damping_ratio=10.0 ** rng.uniform(-3.0, 1.5)),
        Hertz(coefficient=size),
        ForceTable(deflection=np.cumsum(10.0 ** rng.uniform(-4.0, 0.0, 4)), force=np.cumsum(steps)),
        Restitution(coefficient=float(rng.choice([1.0, 0.8, 0.3, 0.0]))),
    ]
    return choices[rng.integers(0, len(choices))]
