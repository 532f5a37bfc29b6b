"""Choice of the plan for a model, and the conditions of `simulate`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from stochvi.methods.monte_carlo.compliant_white import plan_compliant
from stochvi.methods.monte_carlo.kernels.flight import CORNER_SHARE
from stochvi.methods.monte_carlo.modal import ModalPlan, plan_modal
from stochvi.methods.monte_carlo.modal_contacts import plan_modal_contacts
from stochvi.methods.monte_carlo.modal_tables import plan_modal_tables, seconds_of_plan
from stochvi.methods.monte_carlo.plan import Plan
from stochvi.methods.monte_carlo.prices import PATIENCE_SECONDS
from stochvi.methods.monte_carlo.rigid_white import plan_white
from stochvi.methods.monte_carlo.statistic import Statistic, check_statistics
from stochvi.methods.monte_carlo.steps_of_functions import with_linear_part_at_stops
from stochvi.methods.monte_carlo.tabulated import plan_tabulated
from stochvi.model.coverage import (
    beyond_one_oscillator,
    functions_of_arrays,
    not_compiled,
    without_energy,
    without_noise,
)
from stochvi.model.model import Model
from stochvi.model.modulation import unstable
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotApplicable, NotConverged


def unmet(model: Model) -> list[str]:
    """The conditions of `simulate` that a model does not meet, as far as the model alone shows."""
    found = [*functions_of_arrays(model), *not_compiled(model)]
    return [*found, *without_noise(model, with_sines=True), *unstable(model)]


def make_plan(
    model: Model,
    speed_threshold: float | None = None,
    duration: float | None = None,
    slow_impacts: bool = False,
    corner_share: float = CORNER_SHARE,
    deadline: Deadline = NEVER,
    statistics: Mapping[str, Statistic] | None = None,
) -> Plan:
    """Choose the scheme that the excitation and the stops call for, its step and its lengths.

    Parameters
    ----------
    speed_threshold
        Speed in m/s of the slowest impact that rates count; None for the default of the plan.
    duration
        Counted seconds of a path; None for the default of the plan.
    slow_impacts, corner_share
        Whether steps near a stop are refined, and to which length (`rigid_white.WhitePlan`).
    deadline
        When the simulation has to end: a plan is not begun that takes longer itself.
    statistics
        Functions of the motion that are averaged, which the kernel of any structure does.

    Raises
    ------
    NotApplicable
        With every condition that the model does not meet.
    NotConverged
        If the plan takes longer than there is.
    """
    if conditions := unmet(model):
        raise NotApplicable("simulate", conditions)
    if model.functions or model.moves_stops or statistics:
        check_statistics(statistics or {}, model)
        plan = plan_several(model, speed_threshold, duration, slow_impacts)
        return replace(plan, statistics=dict(statistics or {}))
    alone = model.single
    seconds = seconds_of_plan(model)
    if seconds > deadline.left + PATIENCE_SECONDS:
        lines = sum(len(table.frequency_hz) for table, _ in model.tables)
        raise NotConverged(
            f"the budget of {deadline.budget:g} s is too short for the plan of "
            f"{len(model.coordinates)} coordinates under {lines} lines of tables, which takes "
            f"about {seconds:.2g} s, of which {deadline.left:.2g} s are left; raise budget, or "
            "give tables of fewer lines"
        )
    # where a stop is compliant, filtered noises are tables, to which sines are added
    giving_way = bool(model.signals) and model.noisy and not model.rigid
    # without a spring a load accelerates the mass, and tables move it freely: modal kernels
    loose = alone and model.restoring is None and model.omega == 0.0
    falling = loose and (model.load != 0.0 or bool(model.tables))
    sampled = bool(model.tables) or giving_way
    # under tables, laws without a form are followed as a structure is, which gives accelerations
    # too; steps under white noise follow from energies
    if sampled:
        several = any(stop.law.form() is None for stop in model.stops)
    else:
        several = bool(without_energy(model))
    if alone and not (falling or several or model.drawn) and sampled:
        return plan_tabulated(model, speed_threshold, duration)
    if falling or several or model.drawn or beyond_one_oscillator(model):
        return plan_several(model, speed_threshold, duration, slow_impacts)
    if not model.rigid:
        return plan_compliant(model, speed_threshold, duration, slow_impacts)
    return plan_white(model, speed_threshold, duration, slow_impacts, corner_share)


def plan_several(
    model: Model, speed_threshold: float | None, duration: float | None, slow_impacts: bool = False
) -> ModalPlan:
    """The plan in modal coordinates, without tables or contacts where the model has none."""
    if model.functions:
        model = with_linear_part_at_stops(model)
    plan: ModalPlan
    if model.tables or model.drawn or model.sampled_modulations:
        plan = plan_modal_tables(model, speed_threshold, duration)
    elif model.summed:
        plan = plan_modal_contacts(model, speed_threshold, duration)
    else:
        plan = plan_modal(model, speed_threshold, duration)
    return plan.resolving_slow_impacts() if slow_impacts else plan
