"""Choice of the form that linearises a gap, by its name, its variant and the stops."""

from __future__ import annotations

from stochvi.methods.linearisation.candidate import Form
from stochvi.methods.linearisation.force_form import force_form
from stochvi.methods.linearisation.motion_form import motion_form
from stochvi.methods.linearisation.rigid_closure import rigid_closure
from stochvi.methods.linearisation.soft_closure import soft_closure
from stochvi.model.gap import Gap


def form_of(name: str, variant: str, gap: Gap) -> Form:
    """The form for a gap; a single stop must be the upper one."""
    if name == "motion":
        return motion_form(book=variant == "book")
    if name == "force":
        return force_form(book=variant == "book")
    return soft_closure(gap) if gap.soft else rigid_closure(gap, variant == "box")
