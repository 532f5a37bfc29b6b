"""Conditions that a model must meet for the Fokker-Planck equation to be solved."""

from __future__ import annotations

import math

from stochvi.methods.fokker_planck.motion import Motion
from stochvi.model.coverage import (
    beyond_one_oscillator,
    compliant,
    nonlinear,
    not_white,
    speed_functions,
    without_dissipation,
    without_energy,
)
from stochvi.model.model import Model, Stop
from stochvi.results.errors import NotApplicable
from stochvi.scenes.impact_laws import Restitution


def unmet(model: Model) -> list[str]:
    """The conditions of `fokker_planck` that a model does not meet; empty where it meets all.

    Parameters
    ----------
    model
        The model of a scene.

    Returns
    -------
    list[str]
        Sentences, empty where everything is met.

    See Also
    --------
    stochvi.fokker_planck : The method.
    stochvi.explain : What all methods say of a scene.

    Examples
    --------
    >>> from stochvi.model.model import model_of
    >>> from stochvi.scenes import shipped_scene
    >>> from stochvi.scenes.scene import load_scene
    >>> model = model_of(load_scene(shipped_scene("isolator-truck")))
    >>> unmet(model)
    ['excitation must be white noise, got a tabulated density']
    """
    found = beyond_one_oscillator(model, with_functions=True, white_only=True)
    if found:
        return found
    found = [*not_white(model), *without_dissipation(model)]
    found += speed_functions(model) or without_energy(model)
    if not _held(model):
        found.append(
            "stiffness must be positive where stops do not hold the mass, got 0"
            if model.restoring is None
            else "restoring_force must hold the mass where stops do not"
        )
    return found


def unmet_by_transient(model: Model) -> list[str]:
    """The conditions of `transient` that a model does not meet; empty where it meets all.

    Parameters
    ----------
    model
        The model of a scene.

    Returns
    -------
    list[str]
        Sentences, empty where everything is met.

    See Also
    --------
    stochvi.transient : The method.

    Examples
    --------
    >>> from stochvi.model.model import model_of
    >>> from stochvi.scenes import shipped_scene
    >>> from stochvi.scenes.scene import load_scene
    >>> model = model_of(load_scene(shipped_scene("oscillator-lossy")))
    >>> unmet_by_transient(model)
    []
    """
    return beyond_one_oscillator(model, white_only=True) or [*unmet(model), *compliant(model)]


def unmet_by_first_passage(model: Model, lower: float | None, upper: float | None) -> list[str]:
    """The conditions of `first_passage` that a model and two barriers (m) do not meet.

    A barrier that is None is left out, and a stop there turns paths back; where both are, the stops
    of the model are the barriers.

    Parameters
    ----------
    model
        The model of a scene.
    lower
        Lower barrier, m; None for none.
    upper
        Upper barrier, m; None for none.

    Returns
    -------
    list[str]
        Sentences, empty where everything is met.

    See Also
    --------
    stochvi.first_passage : The method.

    Examples
    --------
    >>> from stochvi.model.model import model_of
    >>> from stochvi.scenes import shipped_scene
    >>> from stochvi.scenes.scene import load_scene
    >>> model = model_of(load_scene(shipped_scene("oscillator-lossy")))
    >>> unmet_by_first_passage(model, None, None)
    []
    """
    # a stop that is a barrier ends the path: its law, also a function, does not matter
    found = nonlinear(model) or beyond_one_oscillator(model, with_functions=True, white_only=True)
    if found:
        return found
    found = not_white(model)
    low, high = barriers(model, lower, upper)
    if math.isinf(low) and math.isinf(high):
        found.append("there must be a lower or an upper barrier, or a stop, got none")
    elif not low < high:
        found.append(f"barriers must have lower < upper, got {low:g} and {high:g}")
    if model.omega == 0.0 and any(math.isinf(end) for end in box_ends(model, low, high)):
        found.append("stiffness must be positive where only one barrier is, got 0")
    found += [
        f"law of the {stop.name} stop must be a restitution, as no barrier is before it, got "
        f"{stop.law.kind!r}"
        for stop in turning_stops(model, low, high)
        if not isinstance(stop.law, Restitution)
    ]
    for stop in model.stops:
        barrier = high if stop.side > 0 else low
        if math.isfinite(barrier) and stop.deflection(barrier) > 0.0:
            found.append(
                f"barriers must not lie beyond a stop, got {stop.name} at {barrier:g} m and a stop "
                f"at {stop.position:g} m"
            )
    return found


def box_ends(model: Model, lower: float, upper: float) -> tuple[float, float]:
    """The barriers, m, or the stops on sides without a barrier; infinite without either."""
    return (
        model.lower_position if math.isinf(lower) else lower,
        model.upper_position if math.isinf(upper) else upper,
    )


def barriers(
    model: Model, lower: float | None = None, upper: float | None = None
) -> tuple[float, float]:
    """The barriers that are given, or the stops of a model where none is; infinite for none, m."""
    if lower is None and upper is None:
        return model.lower_position, model.upper_position
    return -math.inf if lower is None else lower, math.inf if upper is None else upper


def turning_stops(model: Model, lower: float, upper: float) -> list[Stop]:
    """The stops on sides without a barrier, m, which turn paths back."""
    return [stop for stop in model.stops if math.isinf(upper if stop.side > 0 else lower)]


def _held(model: Model) -> bool:
    """Whether spring, load and stops keep the mass from leaving on either side."""
    if model.omega > 0.0:
        return True
    try:
        Motion(model=model).span(model.intensity or 1.0)
    except NotApplicable:
        return False
    return True


LEAST_RTOL = 1e-12
"""Smallest relative error that may be asked for: rounding leaves no smaller one."""


def check_rtol(rtol: float) -> None:
    """Raise ValueError if a relative error is out of range."""
    if not LEAST_RTOL <= rtol < math.inf:
        raise ValueError(f"rtol must be at least {LEAST_RTOL:g}, got {rtol:g}")
