"""`explain`: the effects in a scene, the methods that apply, and the price of a simulation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.methods.averaging import unmet as unmet_by_averaging
from stochvi.methods.closed_form import unmet as unmet_by_closed_form
from stochvi.methods.fokker_planck import unmet as unmet_by_fokker_planck
from stochvi.methods.linearisation import linearise
from stochvi.methods.monte_carlo import Prospect, prospect
from stochvi.methods.monte_carlo.choose_plan import unmet as unmet_by_simulation
from stochvi.methods.monte_carlo.modal_tables import seconds_of_plan
from stochvi.methods.monte_carlo.simulate import LEAST_PILOT_SECONDS
from stochvi.model.calculations import calculation
from stochvi.model.cautions import scene_notes
from stochvi.model.model import model_of
from stochvi.model.natural_modes import NaturalMode, RestingGap, at_rest, natural_modes
from stochvi.results.base import COMMON, Result
from stochvi.results.deadline import Deadline, ended_by
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.results.estimates import provenance
from stochvi.scenes.excitations import BASE, RecordedNoise, TabulatedNoise
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

APPLIES = "applies"

SECONDS = 10.0
"""Largest number of seconds that an explanation takes, if no kernel must be compiled."""

FOR_LINEARISATION = 0.3
"""Largest share of the budget in which a linearisation is tried; a method that is not through by
then applies all the same."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Explanation(Result):
    """The effects in a scene, and the methods that cover it.

    `methods` maps each method to "applies", or to the conditions that the scene does not meet.
    `natural_frequency_hz` and `modes` are those of the structure without stops. Under constant
    loads `rest` holds the displacements of rest (m; rotations in rad). `rest_of_gaps` holds where
    each gap rests and how far that is from its stops, m.

    See Also
    --------
    stochvi.explain : The calculation.
    """

    not_in_document = COMMON

    effects: Sequence[str]
    absent: Sequence[str]
    methods: Mapping[str, str]
    assumptions: Sequence[str]
    notes: Sequence[str]
    natural_frequency_hz: Sequence[float]
    modes: Sequence[NaturalMode]
    rest: Mapping[str, float]
    rest_of_gaps: Mapping[str, RestingGap]
    simulation: Prospect | None

    def summary(self) -> str:
        """The effects that a simulation of the scene contains, or why there is none."""
        if not self.simulated:
            return f"not simulated: {self.methods['simulate']}"
        return f"simulated: {', '.join(self.effects)}"

    @property
    def simulated(self) -> bool:
        """Whether `simulate` covers the scene."""
        return self.methods["simulate"] == APPLIES

    def to_frame(self) -> pd.DataFrame:
        """One row per method: whether it applies, or the conditions that the scene does not
        meet."""
        import pandas as pd

        return pd.DataFrame(
            {
                "method": list(self.methods),
                "applies": [found == APPLIES for found in self.methods.values()],
                "lacks": ["" if found == APPLIES else found for found in self.methods.values()],
            }
        )

    def _remarks(self) -> Sequence[str]:
        return (*self.notes, *self.warnings)

    def _document(self) -> dict[str, Any]:
        return {"method": "explain", **super()._document()}


@calculation
def explain(scene: Scene, *, threads: int | None = None, budget: float = SECONDS) -> Explanation:
    """List the effects, the methods that apply, and the expected price of a simulation.

    An effect that is absent from the scene is absent from the compiled code. The price comes
    from a short pilot run on this machine.

    Parameters
    ----------
    scene
        The scene.
    threads
        Number of threads; by default all cores.
    budget
        Seconds for the whole explanation; the pilot run gets what is left, `PILOT_SECONDS` at most.

    Returns
    -------
    Explanation
        Effects, methods and the expected price.

    See Also
    --------
    stochvi.check : Whether all methods agree.
    stochvi.cost : Error against time.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> free = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> explain(free).absent[:5]
    ('filtered noise', 'tabulated noise', 'sine', 'constant load', 'modulation')
    """
    deadline = Deadline.after(budget)
    model, effects = model_of(scene), scene.effects()
    methods = {
        "exact": "; ".join(unmet_by_closed_form(model)) or APPLIES,
        "fokker-planck": "; ".join(unmet_by_fokker_planck(model)) or APPLIES,
        "average": "; ".join(unmet_by_averaging(model)) or APPLIES,
        "linearise": APPLIES,
    }
    trial = Deadline.after(deadline.part(FOR_LINEARISATION))
    try:
        with ended_by(trial.rest, patience=0.0):
            linearise(scene)
    except (NotApplicable, NotConverged) as reason:
        if isinstance(reason, NotApplicable) or not trial.passed():
            methods["linearise"] = _conditions(reason)
    simulation, notes = None, list(scene_notes(model))
    planning = seconds_of_plan(model)
    if planning > MOST_OF_THE_REST * deadline.left:
        methods["simulate"] = "; ".join(unmet_by_simulation(model)) or APPLIES
        notes.append(
            "the price of a simulation was not measured: its plan alone, for these coordinates "
            f"and lines of tables, takes about {planning:.2g} s, more than is left of the budget "
            f"of {deadline.budget:.2g} s; raise budget"
        )
    else:
        try:
            with ended_by(deadline.rest, patience=LEAST_PILOT_SECONDS):
                simulation = prospect(scene, threads=threads, budget=deadline.rest)
            methods["simulate"] = APPLIES
        except NotApplicable as reason:
            methods["simulate"] = _conditions(reason)
        except NotConverged as reason:
            methods["simulate"] = APPLIES
            notes.append(f"the price of a simulation was not measured: {reason}")
    modes = natural_modes(model)
    rest, rest_of_gaps = at_rest(model)
    return Explanation(
        effects=effects,
        absent=scene.absent_effects(),
        methods=methods,
        assumptions=(*_environments(scene), *scene.assumptions()),
        notes=(*notes, *scene.cautions()),
        natural_frequency_hz=[mode.frequency_hz for mode in modes],
        modes=modes,
        rest=rest,
        rest_of_gaps=rest_of_gaps,
        simulation=simulation,
        provenance=provenance(scene.document()),
    )


def explain_phases(
    scene: Scene, *, threads: int | None = None, budget: float = SECONDS
) -> dict[str, Explanation]:
    """The explanation of each phase of a mission, by its name; the steps of a phase that moves are
    explained by their first."""
    deadline = Deadline.after(budget)
    first = {phase.step_of or phase.name: phase for phase in reversed(scene.phases)}
    phases = list(reversed(first.items()))
    return {
        name: explain(
            phase.of(scene), threads=threads,
            budget=deadline.part(1.0 / (len(phases) - done)) or LEAST_PILOT_SECONDS,
        )
        for done, (name, phase) in enumerate(phases)
    }  # fmt: skip


MOST_OF_THE_REST = 0.5
"""Largest share of the time that is left which the plan of a simulation may take."""


def _environments(scene: Scene) -> list[str]:
    """A sentence on what was read of each table and record, with its rms value, to compare with its
    source."""
    found = []
    for each in scene.excitations:
        if isinstance(each, TabulatedNoise | RecordedNoise):
            where = scene.place(each)
            words, numbers = scene.place_in_words(each), each.numbers()
            name, source, extent = each.facts(words, numbers)[0]
            rms = numbers.get("rms", math.sqrt(each.table.mean_square()))
            size = f"{rms / STANDARD_GRAVITY:.4g} g" if where == BASE else f"{rms:.4g} N"
            found.append(f"{name[0].lower()}{name[1:]}: {source}, {extent}, {size} rms")
    return found


def _conditions(reason: NotApplicable | NotConverged) -> str:
    """Why a method does not answer, without the name of the method."""
    return str(reason).split(" does not apply: ", 1)[-1].rstrip(".")
