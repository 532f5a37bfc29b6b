"""The forms: from a trial response to the linearised stops that it calls for."""

from __future__ import annotations

from stochvi.methods.linearisation.closure import rigid_closure
from stochvi.methods.linearisation.force import rigid_force
from stochvi.methods.linearisation.motion import rigid_motion
from stochvi.methods.linearisation.soft_closure import soft_closure
from stochvi.methods.linearisation.soft_force import soft_force
from stochvi.methods.linearisation.soft_motion import soft_motion
from stochvi.methods.linearisation.trial import (
    ROOT_TWO_PI,
    Form,
    Trial,
    Unknowns,
    restitutions,
    soft_stops,
)
from stochvi.scenes.scene import System

__all__ = ["ROOT_TWO_PI", "Form", "Trial", "Unknowns", "choose", "restitutions"]


def choose(form: str, variant: str, system: System) -> Form:
    """The form for a scene whose only stop, where it has one stop, is the upper one."""
    book, soft = variant == "book", bool(soft_stops(system))
    if form == "motion":
        return soft_motion(book) if soft else rigid_motion(book)
    if form == "force":
        return soft_force(book) if soft else rigid_force(book)
    return soft_closure(system) if soft else rigid_closure(system, variant == "box")
