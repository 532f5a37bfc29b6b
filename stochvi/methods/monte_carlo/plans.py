"""Which plan a scene calls for, and what its averages are."""

from __future__ import annotations

import numpy as np

from stochvi.methods.monte_carlo.compliant import CONTACT_ROWS, plan_compliant
from stochvi.methods.monte_carlo.modal import ModalPlan, plan_modal
from stochvi.methods.monte_carlo.modal_contacts import plan_modal_contacts
from stochvi.methods.monte_carlo.modal_tables import plan_modal_tables
from stochvi.methods.monte_carlo.statistics import Layout
from stochvi.methods.monte_carlo.tabulated import TabulatedPlan, plan_tabulated
from stochvi.methods.monte_carlo.white import WhitePlan, plan_white
from stochvi.model.assembly import Assembly, assemble
from stochvi.results.errors import NotApplicable
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Matrices

Plan = WhitePlan | TabulatedPlan | ModalPlan


def make_plan(
    scene: Scene,
    speed_threshold: float | None,
    duration: float | None,
    slow_impacts: bool = False,
) -> Plan:
    """Choose the method that the scene's excitation calls for, its step and its lengths."""
    if unmet := scene.beyond_numbers():
        raise NotApplicable("simulate", unmet)
    assembly = assemble(scene)
    single = not isinstance(scene.expanded.structure, Matrices) and len(assembly.contacts) <= 1
    coloured = any(signal.intensity > 0.0 for signal in assembly.signals)
    noisy = coloured or bool(np.any(assembly.white))
    # where a stop gives way, signals are tables and sines beside them
    giving_way = bool(assembly.signals) and noisy and bool(assembly.not_rigid())
    if single and (assembly.tables or giving_way):
        return plan_tabulated(scene, speed_threshold, duration)
    if scene.beyond_one_oscillator():
        if slow_impacts:
            raise NotApplicable(
                "slow_impacts", ["steps near stops are refined for one oscillator only"]
            )
        return plan_several(assembly, speed_threshold, duration)
    system = scene.system()
    if system.intensity == 0.0:
        raise NotApplicable(
            "simulate", ["excitation must contain noise, got a constant load alone"]
        )
    if system.not_rigid():
        return plan_compliant(system, speed_threshold, duration, slow_impacts)
    return plan_white(system, speed_threshold, duration, slow_impacts)


def plan_several(
    assembly: Assembly, speed_threshold: float | None, duration: float | None
) -> ModalPlan:
    """The plan in modal coordinates, with no more in it than the scene calls for."""
    if assembly.tables:
        return plan_modal_tables(assembly, speed_threshold, duration)
    if assembly.not_rigid():
        return plan_modal_contacts(assembly, speed_threshold, duration)
    return plan_modal(assembly, speed_threshold, duration)


def layout_of(scene: Scene, plan: Plan) -> Layout:
    """What the averages of a plan are."""
    if isinstance(plan, ModalPlan):
        return plan.layout
    pair = scene.impact_pairs[0].name if scene.impact_pairs else ""
    rows = [("x", "x"), ("x", "xx"), ("x", "vv")]
    rows += [(pair, f"{sum_}_{side}") for side in ("lower", "upper") for sum_ in ("n", "f1", "f2")]
    if plan.contacts:
        rows += [(pair, name) for name in CONTACT_ROWS]
    return Layout(rows=tuple(rows), origins={"x": plan.origin}, thresholds={pair: plan.threshold})
