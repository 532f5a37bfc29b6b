"""An impact absorber under a sine: residual vibration over frequency, play and mass."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from stochvi.absorbers.performance import own_name, without_absorber
from stochvi.absorbers.tuned_damper import NO_STOPS
from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.shown_units import LENGTH, ShownQuantity, readable
from stochvi.methods.periodic import HarmonicResponse, harmonic_response
from stochvi.methods.periodic.family import Family, forced, parts_of
from stochvi.model.calculations import calculation
from stochvi.model.model import Model, model_of
from stochvi.results.base import Result
from stochvi.results.deadline import Deadline, partial_result
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Cost, provenance
from stochvi.scenes.absorbers import Absorber
from stochvi.scenes.excitations import Sine
from stochvi.scenes.key_units import KEY_UNITS
from stochvi.scenes.keys import changed_scene
from stochvi.scenes.scene import Scene

Flags = NDArray[np.bool_]

FREQUENCY = "frequency_hz"
"""Name of the varied number where that is the frequency of the sine."""

PLAYS = np.geomspace(0.02, 3.0, 61)
"""Plays of a tuning curve, over the travel of the structure without the absorber, peak to peak."""

GAPS = np.linspace(-1.0, 2.0, 61)
"""Gaps of a tuning curve of one stop, over the largest displacement of the structure without the
absorber."""

MASSES = np.geomspace(0.25, 4.0, 41)
"""Masses of a tuning curve, over that of the scene."""

SAMPLES = 360
"""Number of phases of a period at which the travel of an idle mass in its box is looked at."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualCurve:
    """Residual vibration with an absorber, over a number that is varied (SI units).

    The ratios are those of the largest displacements of the carrier from its unloaded position.

    Parameters
    ----------
    key
        What is varied: "frequency_hz", or a key of the scene.
    value
        Values of the varied number.
    without
        Largest displacement of the carrier without the absorber, m.
    best, worst
        Smallest and largest ratio of what may last: stable regimes, idling, and the motions to
        which slow sweeps up and down settle, periodic or not.
    first_harmonic
        Ratio of the first harmonics, of the stable regime with impacts that displaces least; NaN
        where there is none.
    stable
        Whether a regime with impacts is stable.
    idle
        Whether loose masses may rest in their boxes, out of reach of the stops.
    periodic
        Whether both sweeps end in motions that repeat themselves; if not, the absorber works in
        clusters there.

    See Also
    --------
    absorber_sine : Makes these curves.
    """

    key: str
    value: Vector
    without: Vector
    best: Vector
    worst: Vector
    first_harmonic: Vector
    stable: Flags
    idle: Flags
    periodic: Flags

    @property
    def tuned(self) -> int:
        """Index of the value at which the worst motion that may last is smallest."""
        return int(np.nanargmin(self.worst))

    def to_frame(self) -> pd.DataFrame:
        """One row for each value."""
        return pd.DataFrame(vars(self))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AbsorberSine(Result):
    """An impact absorber under a sine (B 17.9-17.37, by exact regimes).

    Parameters
    ----------
    scene
        The structure with its absorber.
    carrier
        The coordinate that the absorber is to calm.
    mass_ratio
        Mass of the absorber over that of the structure.
    frequency
        Residual vibration over the frequency of the sine.
    tuning
        Residual vibration over play, gap and mass, at the frequency of the scene.
    regimes
        All regimes with the absorber over frequency.

    See Also
    --------
    absorber_sine : Makes it from a scene.
    """

    not_in_document = ("scene",)  # the provenance holds it

    scene: Scene
    carrier: str
    mass_ratio: float
    frequency: ResidualCurve
    tuning: Sequence[ResidualCurve]
    regimes: HarmonicResponse

    def to_frame(self) -> pd.DataFrame:
        """One row for each value of each curve, SI units."""
        return pd.concat(
            [each.to_frame() for each in (self.frequency, *self.tuning)], ignore_index=True
        )

    def summary(self) -> str:
        """The residual vibration at the resonance and over all frequencies, and the best tuning, in
        words. Where several motions may last, ratios are those of the largest."""
        curve, left = self.frequency, self.frequency.worst * self.frequency.without
        if np.all(np.isnan(left)):
            return "no motion was found that lasts"
        peak = int(np.argmax(np.where(np.isnan(left), -math.inf, curve.without)))
        where = "where it moves most without the absorber, " if len(curve.value) > 1 else ""
        least, largest = curve.best[peak] * curve.without[peak], left[peak]
        moved = LENGTH.text(largest)
        if least < ALIKE * largest:
            moved = f"{LENGTH.text(least)} to {moved} (by the motion that lasts)"
        parts = [
            f"at {curve.value[peak]:.4g} Hz, {where}{self.carrier} moves {moved} with the "
            f"absorber and {LENGTH.text(curve.without[peak])} without it"
        ]
        most = int(np.nanargmax(left))
        if most != peak:
            ends = f"{curve.value[0]:.4g} to {curve.value[-1]:.4g} Hz"
            parts.append(
                f"over {ends} it moves at most {LENGTH.text(left[most])} with the absorber, at "
                f"{curve.value[most]:.4g} Hz"
            )
        return "; ".join([*parts, *filter(None, map(self._tuned, self.tuning))])

    def _tuned(self, curve: ResidualCurve) -> str:
        """The best value of a tuning curve, in words; empty where no motion lasts."""
        if np.all(np.isnan(curve.worst)):
            return ""
        name, quantity = tuned_key(curve.key)
        sines = [each.frequency_hz for each in self.scene.excitations if isinstance(each, Sine)]
        share, hertz = curve.worst[curve.tuned], f"{min(sines):.4g} Hz"
        if not share < 1.0:
            return f"no {name} is sure to help at {hertz}"
        best = quantity.text(curve.value[curve.tuned]).rstrip()
        return f"the best {name}, {best}, leaves {share:.3g} of the displacement at {hertz}"

    def _document(self) -> dict[str, Any]:
        return {"method": "absorber sine", **super()._document()}


def tuned_key(key: str) -> tuple[str, ShownQuantity]:
    """A tuned key in words, and its quantity.

    Examples
    --------
    >>> name, quantity = tuned_key("absorber.play")
    >>> quantity.heading(name), quantity(0.004)
    ('total play (mm)', 4.0)
    """
    unit = KEY_UNITS.get(key.rpartition(".")[2], "")
    return TUNED.get(key, key), readable(unit)


TUNED = {
    "absorber.mass": "mass of the absorber",
    "absorber.play": "total play",
    "absorber.lower": "place of the lower stop",
    "absorber.upper": "place of the upper stop",
}
"""Keys of an absorber in words."""


ALIKE = 0.995
"""Two displacements count as one in words from this ratio of the smaller to the larger on."""


@calculation
def absorber_sine(
    scene: Scene,
    frequency_hz: ArrayLike | None = None,
    *,
    tune: Mapping[str, Sequence[float]] | None = None,
    most_impacts: int = 3,
    budget: float | None = None,
) -> AbsorberSine:
    """Residual vibration with an impact absorber under a sine, over frequency, play and mass.

    The regimes are the exact ones of the structure with its absorber, loose or sprung, with one
    stop or two. Slow sweeps by simulation show what lasts where no regime is stable: there the
    absorber works in clusters.

    Parameters
    ----------
    scene
        A linear structure without stops of its own, an absorber with stops of any law, and a sine.
    frequency_hz
        Frequencies of the sine; by default that of the scene.
    tune
        Keys of the absorber or of its impact pairs with their values, at the frequency of the
        scene; by default play (or the gap of one stop) and mass, where `absorber` has them.
    most_impacts
        As for `harmonic_response`.
    budget
        Seconds of wall time, compilation apart.

    Returns
    -------
    AbsorberSine
        Curves of the residual vibration, and all regimes over frequency.

    Raises
    ------
    NotApplicable
        If the scene has no absorber, stops of its own, or is no case of `harmonic_response`.
    NotConverged
        If the budget ends first; the error holds the curves so far.

    See Also
    --------
    stochvi.absorber : The same under random excitation.
    symmetric_regimes : The regimes of one impact on each stop, from numbers.

    Examples
    --------
    A loose mass of 5 % on a structure of Q = 50, in resonance:

    >>> from stochvi import Absorber, Oscillator, Restitution, Sine
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
    ...     absorber=Absorber(mass=0.05, play=2.0, law=Restitution(coefficient=0.8)),
    ...     excitations=[Sine(amplitude=0.05, frequency_hz=1.0 / 6.283185307)],
    ... )
    >>> found = absorber_sine(scene, tune={"absorber.play": [1.0, 2.0, 3.0]})
    >>> (curve,) = found.tuning
    >>> round(float(found.frequency.best[0]), 3), float(curve.value[curve.tuned])
    (0.087, 2.0)
    """
    began = time.perf_counter()
    if scene.absorber is None:
        raise NotApplicable(
            "absorber:sine",
            ["the scene must have an [absorber] with mass (kg), play (m, stop to stop) and law, or "
             "mass_on"],
        )  # fmt: skip
    alone = without_absorber(scene)
    if alone.impact_pairs:
        raise NotApplicable("absorber:sine", [NO_STOPS])
    full, masses = scene.expanded, scene.absorber_coordinates
    carrier = next(name for name in full.structure.coordinates if name not in masses)
    deadline = Deadline.after(budget)
    solver = _Solver(scene, alone, carrier, masses, most_impacts, deadline)
    tune = solver.usual_tuning() if tune is None else tune
    if wrong := [key for key in tune if not key.startswith(("absorber.", "impact_pair."))]:
        raise ValueError(f"tune must name keys of absorber or impact_pair, got {', '.join(wrong)}")
    frequency, regimes = solver.over_frequency(frequency_hz, 1.0 / (1 + len(tune)))
    curves = []
    for number, (key, values) in enumerate(tune.items()):
        if not deadline.passed():
            curves.append(solver.over_key(key, values, 1.0 / (len(tune) - number)))
    mass = np.diag(full.structure.matrices[0])
    light = np.array([name in masses for name in full.structure.coordinates])
    answer = AbsorberSine(
        scene=scene,
        carrier=carrier,
        mass_ratio=float(mass[light].sum() / mass[~light].sum()),
        frequency=frequency,
        tuning=curves,
        regimes=regimes,
        warnings=regimes.warnings,
        cost=Cost(wall_time=time.perf_counter() - began),
        provenance=provenance(scene.document()),
    )
    if deadline.passed():
        raise deadline.fell_short("before all regimes were looked for", "ask for fewer", answer)
    return answer


@dataclass(frozen=True)
class _Solver:
    """The structure with and without its absorber, and the time that is left."""

    scene: Scene
    alone: Scene
    carrier: str
    masses: Sequence[str]
    most_impacts: int
    deadline: Deadline

    def over_frequency(
        self, frequency_hz: ArrayLike | None, share: float
    ) -> tuple[ResidualCurve, HarmonicResponse]:
        """The curve over frequency, and all regimes."""
        found = self._regimes(share, frequency_hz=frequency_hz)
        free = partial_result(
            harmonic_response, self.alone, frequency_hz, most_impacts=1,
            coordinate=own_name(self.alone, self.carrier), budget=self.deadline.rest,
        )  # fmt: skip
        values = self._values(found)
        return self._curve(found, values, *_largest(free, values), self._idle(found, values)), found

    def over_key(self, key: str, values: Sequence[float], share: float) -> ResidualCurve:
        """A tuning curve at the frequency of the scene."""
        found = self._regimes(share, vary={key: values})
        seen = self._values(found)
        largest, first = (np.full(len(seen), float(part[0])) for part in self._without())
        return self._curve(found, seen, largest, first, self._idle(found, seen))

    def usual_tuning(self) -> dict[str, Sequence[float]]:
        """Play or gap, and mass, of an absorber that gives them."""
        own = self.scene.absorber
        if not isinstance(own, Absorber) or own.mass is None:
            return {}
        moved = float(self._without()[0][0])
        found: dict[str, Sequence[float]] = {"absorber.mass": list(MASSES * own.mass)}
        if not math.isfinite(moved):
            return found
        if own.play is not None:
            found["absorber.play"] = list(2.0 * moved * PLAYS)
        elif own.lower is None or own.upper is None:
            side = "upper" if own.lower is None else "lower"
            found[f"absorber.{side}"] = list((1.0 if side == "upper" else -1.0) * moved * GAPS)
        return found

    def _regimes(self, share: float, **varied: Any) -> HarmonicResponse:
        return partial_result(
            harmonic_response, self.scene, **varied, coordinate=self.carrier, sweep="both",
            most_impacts=self.most_impacts, budget=self.deadline.part(share),
        )  # fmt: skip

    def _without(self) -> tuple[Vector, Vector]:
        """Largest displacement and amplitude without the absorber at the frequency of the scene."""
        name = own_name(self.alone, self.carrier)
        found = harmonic_response(self.alone, coordinate=name, most_impacts=1)
        return _largest(found, np.array([found.branches[0].value[0]] if found.branches else [0.0]))

    @staticmethod
    def _values(found: HarmonicResponse) -> Vector:
        """The values of the varied number that were reached in time."""
        swept = [each.value for each in found.simulated]
        followed = [each.value[[not name for name in each.names]] for each in found.branches]
        return np.unique(np.concatenate([np.empty(0), *swept, *followed]))

    def _idle(self, found: HarmonicResponse, values: Vector) -> Flags:
        """Whether loose masses may rest out of reach of the stops, at each value."""
        model = model_of(self.scene)
        own = [model.coordinates.index(name) for name in self.masses]
        held = np.abs(model.stiffness[own]).sum() + np.abs(model.damping[own]).sum()
        if held + np.abs(model.constant_force[own]).sum() > 0.0 or not len(values):
            return np.zeros(len(values), bool)
        low, high = float(values[0]), float(values[-1])
        if low == high:
            low, high = low - 1e-3 * abs(low), high + 1e-3 * abs(high)
        family = Family.of(self._model_at(found.key), low, high, self.carrier)
        return _within(family, family.sigma(values))

    def _model_at(self, key: str) -> Callable[[float], Model]:
        document = self.scene.document(as_written=True)
        if key != FREQUENCY:
            return lambda value: model_of(changed_scene(document, ((key, value),)))
        sines = [n for n, each in enumerate(document["excitation"]) if each["kind"] == "sine"]
        hertz = [document["excitation"][n]["frequency_hz"] for n in sines]
        keys = [f"excitation.{n}.frequency_hz" for n in sines]

        def at(value: float) -> Model:
            changes = [(key, value / min(hertz) * f) for key, f in zip(keys, hertz, strict=True)]
            return model_of(changed_scene(document, tuple(changes)))

        return at

    @staticmethod
    def _curve(
        found: HarmonicResponse, values: Vector, without: Vector, amplitude: Vector, idle: Flags
    ) -> ResidualCurve:
        swept = [
            {
                float(at): (float(moved), int(periods))
                for at, moved, periods in zip(
                    each.value, each.displacement_max, each.periods, strict=True
                )
            }
            for each in found.simulated
        ]
        best, worst, first = np.empty((3, len(values)))
        stable, periodic = np.empty((2, len(values)), bool)
        for number, value in enumerate(values.tolist()):
            regimes = list(_stable(found, value))
            hitting = [(moved, harmonic) for moved, harmonic, impacts in regimes if impacts]
            seen = [known[value] for known in swept if value in known]
            lasting = [moved for moved, _, _ in regimes] + [moved for moved, _ in seen]
            lasting += [float(without[number])] if idle[number] else []
            best[number] = min(lasting, default=math.nan)
            worst[number] = max(lasting, default=math.nan)
            first[number] = min(hitting)[1] if hitting else math.nan
            stable[number] = bool(hitting)
            periodic[number] = all(periods > 0 for _, periods in seen)
        return ResidualCurve(
            key=found.key,
            value=values,
            without=without,
            best=best / without,
            worst=worst / without,
            first_harmonic=first / amplitude,
            stable=stable,
            idle=idle,
            periodic=periodic,
        )


def _largest(found: HarmonicResponse, values: Vector) -> tuple[Vector, Vector]:
    """Largest displacement and amplitude of motion without impacts at values; NaN without one."""
    largest, first = np.full(len(values), np.nan), np.full(len(values), np.nan)
    for branch in found.branches:
        for number, value in enumerate(values):
            for place in branch.at(float(value)):
                largest[number] = branch.displacement_max[place]
                first[number] = branch.amplitude[place]
    return largest, first


def _stable(found: HarmonicResponse, value: float) -> Iterator[tuple[float, float, int]]:
    """Largest displacement, amplitude and number of impacts of the stable regimes at a value."""
    for branch in found.branches:
        for place in branch.at(value):
            if branch.stable[place]:
                moved, first = branch.displacement_max[place], branch.amplitude[place]
                yield float(moved), float(first), len(branch.stops)


def _within(family: Family, sigma: Vector) -> Flags:
    """Whether the travel of every pair without impacts fits between its stops."""
    parts = parts_of(family.flat(sigma), family.sizes)
    phases = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES
    m, harmonics = family.sizes[1:]
    moved = np.zeros((len(sigma), m, SAMPLES))
    for k in range(harmonics):
        force = parts["forces"][:, :, 2 * k] - 1j * parts["forces"][:, :, 2 * k + 1]
        waves = forced(parts, (k + 1) * parts["omega"], force)
        across = np.einsum("psi,pi->ps", parts["rows"], waves)
        moved += (across[:, :, None] * np.exp(1j * (k + 1) * phases)).real
    # the two stops of a pair are neighbouring rows, with opposite signs
    travel = np.ptp(moved[:, ::2], axis=2)
    room = parts["distances"][:, ::2] + parts["distances"][:, 1::2]
    return np.asarray(np.all(travel <= room, axis=1))
