"""Scenes of one oscillator between rigid stops to linearise, and how to read the answers."""

from __future__ import annotations

import numpy as np

from stochvi.results.base import Response
from stochvi.results.estimates import Estimate
from stochvi.scenes.excitations import ConstantLoad, Excitation, WhiteNoise
from stochvi.scenes.impact_laws import Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Oscillator

WAYS = [
    ("closure", "consistent"),
    ("motion", "consistent"),
    ("motion", "book"),
    ("force", "consistent"),
    ("force", "book"),
]


def make_scene(
    lower: float | None = -1.0,
    upper: float | None = 1.0,
    *,
    restitution: float = 0.8,
    restitution_lower: float | None = None,
    intensity: float | None = 0.2,
    damping: float = 0.1,
    stiffness: float = 1.0,
    mass: float = 1.0,
    load: float = 0.0,
    extra: tuple[Excitation, ...] = (),
) -> Scene:
    """An oscillator; what is None is not there."""
    excitations = list(extra)
    if intensity is not None:
        excitations.append(WhiteNoise(intensity=intensity))
    if load:
        excitations.append(ConstantLoad(force=load))
    pairs = []
    if lower is not None or upper is not None:
        own = restitution_lower is not None and lower is not None
        pairs.append(
            ImpactPair(
                lower=lower,
                upper=upper,
                law=Restitution(coefficient=restitution),
                lower_law=Restitution(coefficient=restitution_lower) if own else None,
            )
        )
    return Scene(
        structure=Oscillator(mass=mass, damping=damping, stiffness=stiffness),
        impact_pairs=pairs,
        excitations=excitations,
    )


def random_scene(rng: np.random.Generator, *, elastic: bool = False) -> tuple[Scene, float]:
    """Any rigid stops in white noise; and the deviation that x would have without them."""
    omega = 10.0 ** rng.uniform(-2.0, 3.0)
    deviation = 10.0 ** rng.uniform(-6.0, 2.0)
    damping = 2.0 * 10.0 ** rng.uniform(-3.0, 0.0) * omega
    intensity = 2.0 * damping * (deviation * omega) ** 2
    restitution = 1.0 if elastic else float(rng.choice([0.0, rng.uniform(), rng.uniform(0.8, 1.0)]))
    other = 1.0 if elastic else float(rng.choice([restitution, rng.uniform()]))
    near, far = deviation * 10.0 ** rng.uniform(-3.0, 3.0, 2)
    preloaded = -rng.uniform(0.0, 3.0) * deviation
    lower, upper = [
        (-near, near),
        (-near, far),
        (None, near),
        (None, preloaded),
        (-near, None),
        (-preloaded, None),
        (preloaded - near, preloaded),
    ][rng.integers(7)]
    loss_by_impacts_alone = not elastic and restitution < 1.0 and other < 1.0
    scene = make_scene(
        None if lower is None else float(lower),
        None if upper is None else float(upper),
        restitution=restitution,
        restitution_lower=other,
        intensity=intensity,
        damping=0.0 if loss_by_impacts_alone and rng.uniform() < 0.2 else damping,
        stiffness=omega**2,
        load=float(rng.choice([0.0, rng.uniform(-3.0, 3.0)])) * deviation * omega**2,
    )
    return scene, deviation


def value(response: Response, name: str) -> float:
    """A quantity of the only coordinate or impact pair."""
    groups = [*response.coordinates.values(), *response.impact_pairs.values()]
    found = next(group[name] for group in groups if name in group)
    assert isinstance(found, Estimate)
    return found.value


def summary(response: Response) -> tuple[float, float, float]:
    return (
        value(response, "displacement_std"),
        value(response, "velocity_std"),
        value(response, "collision_rate"),
    )
