"""The conditions of a method that a model does not meet, in sentences.

They are used in the refusals of methods, in `explain` and in the table of methods.
"""

from __future__ import annotations

from stochvi.mathematics.fast_peaks import FastPeaks
from stochvi.model.model import Model
from stochvi.scenes.excitations import DENSITY_KINDS
from stochvi.scenes.impact_laws import CompliantLaw, Restitution, SpeedRestitution, Viscoelastic
from stochvi.scenes.modulated_force import ForceOfExcitation


def functions(model: Model) -> list[str]:
    """A sentence for each function in a model, for methods that take numbers only."""
    return nonlinear(model) + speed_restitutions(model) + rubbing(model)


def compliant(model: Model) -> list[str]:
    """A sentence for each compliant stop, for methods whose stops are rigid."""
    return [
        f"stops must be rigid (law.kind = 'restitution'), got {stop.law.kind!r} at the {stop.name} "
        "stop"
        for stop in model.stops
        if not stop.rigid
    ]


def rubbing(model: Model) -> list[str]:
    """A sentence for each stop that rubs, for methods without motion along stops."""
    return [
        f"law.friction must be 0, got {stop.law.friction_coefficient:g} at the {stop.name} stop of "
        f"{pair.name}; simulate follows it"
        for pair in model.pairs
        for stop in pair.stops
        if stop.law.friction_coefficient
    ]


def speed_restitutions(model: Model) -> list[str]:
    """A sentence for each restitution that depends on the speed, for methods that take a number."""
    return [
        "law.coefficient must be a number, got a function of speed "
        f"at the {stop.name} stop of {pair.name}"
        for pair in model.pairs
        for stop in pair.stops
        if isinstance(stop.law, SpeedRestitution)
    ]


def scattered(model: Model) -> list[str]:
    """A sentence for each restitution that scatters, for methods that draw nothing."""
    return [
        f"law.coefficient must be a number, got {stop.law.coefficient} at the {stop.name} stop of "
        f"{pair.name}, which scatters; give its mean alone"
        for pair in model.pairs
        for stop in pair.stops
        if isinstance(stop.law, Restitution) and stop.scattered
    ]


def nonlinear(model: Model) -> list[str]:
    """The sentences that a model must be linear between its stops, if it is not."""
    if model.functions:
        return [part.law.refusal(part.name) for part in model.functions] + moving_stops(model)
    return functions_of_arrays(model) + moving_stops(model)


def functions_of_arrays(model: Model) -> list[str]:
    """The sentence that spring and damper must not be those of a nonlinear oscillator, for methods
    that compile functions: these are functions of arrays."""
    if model.functions or (model.restoring is None and model.drag is None):
        return []
    return ["structure.kind must not be 'nonlinear' (a restoring force that is a function)"]


def not_apart(model: Model) -> list[str]:
    """A sentence for each spring or damper whose force depends on more than the displacement or
    the velocity alone."""
    return modulated(model) + [
        f"structure.{'damper' if part.law.is_damper else 'spring'} must be a function of "
        "displacement alone or velocity alone, got "
        f"{'hysteresis' if part.law.remembers else 'both'} of kind {part.law.kind!r} ({part.name})"
        for part in model.functions
        if part.law.needs == "both" and not isinstance(part.law, ForceOfExcitation)
    ]


def modulated(model: Model) -> list[str]:
    """A sentence for each modulation and each excitation that is drawn, for methods whose structure
    does not change in time, under Gaussian noise."""
    forces = [part for part in model.functions if isinstance(part.law, ForceOfExcitation)]
    return [part.law.refusal(part.name) for part in forces] + moving_stops(model)


def not_gaussian(model: Model) -> list[str]:
    """The sentences that noise must be Gaussian, if its level varies at random, or it has fast
    peaks, or shocks come."""
    found = []
    if model.level is not None:
        found.append(
            f"excitation must be Gaussian noise, got noise of varying level, of kurtosis "
            f"{model.level.kurtosis:g}; simulate, reliability, size and damage follow it"
        )
    for each, _ in model.drawn:
        got, follow = "pulses of a shape", f"{FOLLOWING_SHOCKS} follow them"
        if isinstance(each, FastPeaks):
            got = f"noise with fast peaks, of kurtosis {each.kurtosis:g}"
            follow = f"{FOLLOWING_PEAKS} follow it; without the kurtosis the rms motion is the same"
        found.append(f"excitation must be Gaussian noise, got {got}; {follow}")
    return found


def moving_stops(model: Model) -> list[str]:
    """A sentence for each pair whose stops move."""
    return [
        f"structure must have stops that stand still, got a modulation of clearance at {pair.name}"
        for pair in model.pairs
        if pair.moved
    ]


def not_compiled(model: Model) -> list[str]:
    """A sentence for each impact law of a model that no simulation can follow."""
    return [
        f"law must be one that a simulation follows, got {stop.law.kind!r} at the {stop.name} "
        f"stop of {pair.name}"
        for pair in model.pairs
        for stop in pair.stops
        if stop.law.compiled() is None
    ]


def speed_functions(model: Model) -> list[str]:
    """A sentence for each force that is a function of the speed, for methods whose dampers are
    linear."""
    return [
        f"law.force must depend on the speed by a linear damper alone, got {stop.law.kind!r} at "
        f"the {stop.name} stop of {pair.name}"
        for pair in model.pairs
        for stop in pair.stops
        if isinstance(stop.law, CompliantLaw) and not (stop.law.has_linear_damper)
    ]


def without_energy(model: Model) -> list[str]:
    """A sentence for each force whose energy is not known."""
    return [
        f"law.energy must be known, got none of kind {stop.law.kind!r} at the {stop.name} stop of "
        f"{pair.name}; give the function of the deflection that returns it, J"
        for pair in model.pairs
        for stop in pair.stops
        if isinstance(stop.law, CompliantLaw) and not stop.law.has_energy
    ]


def unknown_dampers(model: Model) -> list[str]:
    """A sentence for each impact law with a damper beside a spring that is not linear. It is for
    methods whose only contacts with dampers are those of viscoelastic stops."""
    return [
        f"law must be 'viscoelastic' where it has a damper, got {stop.law.kind!r} at the "
        f"{stop.name} stop of {pair.name}"
        for pair in model.pairs
        for stop in pair.stops
        if not (stop.rigid or stop.law.conservative or isinstance(stop.law, Viscoelastic))
    ]


def beyond_one_oscillator(
    model: Model,
    *,
    with_functions: bool = False,
    with_filters: bool = False,
    with_sines: bool = False,
    with_speeds: bool = False,
    white_only: bool = False,
) -> list[str]:
    """The conditions of a method for one oscillator that a model does not meet.

    Parameters
    ----------
    with_functions
        Whether the method takes springs, dampers and restitutions that are functions.
    with_filters
        Whether the method takes filtered noise.
    with_sines
        Whether the method takes sines beside noise.
    with_speeds
        Whether the method takes restitutions that depend on the speed.
    white_only
        Whether the method takes no noise but white noise (see `not_white`).
    """
    if with_functions:
        found = not_apart(model)
    else:
        found = nonlinear(model) + rubbing(model)
        found += [] if with_speeds else speed_restitutions(model)
    if len(model.coordinates) > 1:
        found.append(
            "structure.kind must be 'oscillator' or 'isolator', got "
            f"{len(model.coordinates)} coordinates ({', '.join(model.coordinates)}), which "
            "simulate and linearise take"
        )
    if len(model.pairs) > 1:
        found.append(f"the scene must have one impact pair, got {len(model.pairs)}")
    kinds = {"sine" if signal.amplitude else "filtered" for signal in model.signals}
    if white_only:
        words = {"filtered": "filtered noise", "sine": "a sine"}
        return found + [f"{WHITE}, got {words[kind]}" for kind in sorted(kinds)]
    covered = ["white", *["filtered"] * with_filters, *["sine"] * with_sines, *DENSITY_KINDS]
    found += [
        f"excitation must be {', '.join(covered)} or constant, got {kind}"
        for kind in sorted(kinds - set(covered))
    ]
    return found


def without_noise(model: Model, *, with_sines: bool = False) -> list[str]:
    """The sentence that nothing in a model is random, for methods for random motion.

    Parameters
    ----------
    with_sines
        Whether the method takes a sine in place of noise.
    """
    if model.noisy or (with_sines and (model.sines or model.modulations)):
        return []
    wanted = "noise or a sine" if with_sines else "noise"
    got = "a sine" if model.sines else "a constant load"
    remedy = "; the command sine finds the motions under it" if model.sines else ""
    return [f"excitation must contain {wanted}, got {got} alone{remedy}"]


def without_free_response(model: Model) -> list[str]:
    """The sentences that one oscillator has no stationary motion without stops."""
    return [
        f"structure.{key} must be positive, as the motion without stops is to be stationary, got 0"
        for key, rate in (("stiffness", model.omega), ("damping", model.damping_rate))
        if rate == 0.0
    ]


FOLLOWING_PEAKS = "simulate, impacts, damage, reliability and size"
"""Commands that follow noise with fast peaks."""

FOLLOWING_SHOCKS = "simulate, impacts, damage, reliability and size"
"""Commands that follow shocks of a shape."""

WHITE = "excitation must be white noise"
"""The condition of methods for white noise alone."""


def not_white(model: Model) -> list[str]:
    """The conditions of a method for white noise that a model does not meet."""
    if model.tables:
        return [f"{WHITE}, got a tabulated density"]
    return not_gaussian(model) + without_noise(model)


def without_dissipation(model: Model) -> list[str]:
    """The sentence that one oscillator must lose the energy that noise brings, if it loses none."""
    if model.damping_rate == 0.0 and model.drag is None and model.elastic:
        return ["damping must be positive where no stop takes energy, got 0"]
    return []
