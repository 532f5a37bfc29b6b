"""Targets of a sizing, and the impact laws that they need."""

from __future__ import annotations

from scipy.optimize import brentq

from stochvi.isolators.sizing.answer import Target
from stochvi.isolators.sizing.risk_curve import CERTAIN
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable
from stochvi.results.hardness import (
    IMPACT_SPEED,
    PEAK_ACCELERATION,
    UNIT_OF_LIMIT,
    is_speed,
    unit_of_limit,
)
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.scenes.scene import LARGEST_NUMBER, Scene
from stochvi.statistics.structure_hits import (
    TYPICAL_SPEED,
    WIDEST,
    Limit,
    check_forces,
    outputs_of,
)


def target_of(
    probability: float | None,
    rate: float | None,
    impact_speed: float | None,
    peak_acceleration: float | None,
    exceedance: float,
) -> Target:
    """The target of a sizing; `ValueError` unless exactly one is given, in its range."""
    known = {
        "probability": (probability, "1"),
        "rate": (rate, "1/s"),
        IMPACT_SPEED: (impact_speed, unit_of_limit(IMPACT_SPEED)),
        PEAK_ACCELERATION: (peak_acceleration, unit_of_limit(PEAK_ACCELERATION)),
    }
    given = [name for name, (value, _) in known.items() if value is not None]
    if len(given) != 1:
        raise ValueError(
            f"give exactly one of {', '.join(known)}, got {' and '.join(given) or 'none'}"
        )
    name = given[0]
    value, unit = known[name]
    assert value is not None
    if not 0.0 < value <= (CERTAIN if name == "probability" else LARGEST_NUMBER):
        span = f"in (0, {CERTAIN:g}]" if name == "probability" else "positive"
        percent = "; 1 % is 0.01" if name == "probability" and value >= 1.0 else ""
        raise ValueError(f"{name} must be {span}, got {value:g}{percent}")
    if not 0.0 < exceedance < 1.0:
        raise ValueError(f"exceedance must be in (0, 1), got {exceedance:g}")
    limited = name in UNIT_OF_LIMIT
    return Target(name=name, value=value, unit=unit, exceedance=exceedance if limited else None)


def widening(scene: Scene, target: Target, velocity_std: float, clearance: float) -> float:
    """Factor by which first impacts are drawn faster than usual, so that some exceed the limit."""
    model = model_of(scene)
    speed = target.value
    if not is_speed(target.name):
        left = max(target.value - model.omega**2 * clearance, 0.1 * target.value)
        softest = next(
            stop.law for stop in model.stops_per_unit_mass if isinstance(stop.law, CompliantLaw)
        )
        # forces are per unit mass here
        low = 1e-9 * velocity_std
        speed = float(
            brentq(lambda w: softest.impact(w, 1.0).peak_force - left, low, 1e6, xtol=low)
        )
    return min(max(speed / (TYPICAL_SPEED * velocity_std), 1.0), WIDEST)


def check_at(scene: Scene, target: Target, at: str | None) -> None:
    """Raise `ValueError` where `at` belongs to another target, or names nothing of the scene."""
    if at is None:
        return
    if target.name != PEAK_ACCELERATION:
        raise ValueError(f"at = {at!r} belongs to peak_acceleration, which is not given")
    names = model_of(scene).outputs
    if not any(at in (name, name.rpartition(".")[0]) for name in names):
        raise ValueError(f"at must be one of {', '.join(names)}, got {at!r}")


def limit_of_pairs(scene: Scene, target: Target, at: str | None) -> Limit | None:
    """The limit that impacts of several pairs must not exceed; None for a target that has none.

    Raises `NotApplicable` for targets that cannot be sized where there are several coordinates or
    pairs.
    """
    model = model_of(scene)
    if not model.pairs:
        raise NotApplicable(
            "size", ["the scene needs an impact_pair for every gap that is to be sized"]
        )
    if target.exceedance is None:
        return None
    if is_speed(target.name):
        return Limit(target.name, target.value)
    check_forces(model)
    return Limit(target.name, target.value, outputs_of(scene, at))


def check_laws(scene: Scene, target: Target) -> None:
    """Raise `NotApplicable` where the laws of the stops do not determine the target."""
    if not scene.impact_pairs:
        raise NotApplicable("size", [f"{target.name} needs an impact_pair, for its law"])
    rigid = [side for side, law in scene.impact_pairs[0].stops() if law.rigid]
    if target.exceedance is not None and not is_speed(target.name) and rigid:
        raise NotApplicable(
            "size",
            [
                f"peak_acceleration needs the stiffness of the stops, and the {rigid[0]} stop has "
                "only a restitution (law.kind = 'restitution'); give an elastic, viscoelastic, "
                "hertz or table law"
            ],
        )
