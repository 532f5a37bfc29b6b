"""Scales of a structure with stops, for steps and starts of simulations. Chapters: a rough
stationary distribution; the linear part of springs and dampers that are functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.impact_rates import TruncatedNormal, gaussian_stop
from stochvi.mathematics.numerics import Vector
from stochvi.model.gap import Gap, GibbsLaw
from stochvi.model.modal import EquivalentLinear, LinearLaw, ModalForm, linear_law
from stochvi.model.model import FunctionOfMotion, Model, Pair, rates_of
from stochvi.results.errors import NotApplicable
from stochvi.scenes.characteristics import LinearForm
from stochvi.scenes.impact_laws import CompliantLaw

UNSHAKEN = 1e-24
"""A gap counts as at rest below this variance of its speed, relative to the largest of a modal
velocity: the remainder is rounding error."""

ITERATIONS = 40
"""Number of iterations for the springs and dampers in place of impacts: a few digits then no
longer change, which is enough for time steps and starting values."""


class PairScale(NamedTuple):
    """The scales of an impact pair, in SI units.

    `speed` is the rms speed of its gap, and `pressing` the acceleration that presses the mass onto
    a stop, or 0. The gap has the density exp(slope y - curvature y^2 / 2), up to a factor, and the
    standard deviation `deviation`. With `sinks` it moves more within its compliant stops than
    between them.
    """

    speed: float
    pressing: float
    slope: float
    curvature: float
    deviation: float
    sinks: bool = False

    def way(self, play: float) -> float:
        """How far the gap goes from one turn to the next, m: the play between its stops, or the
        width of the uniform law with its deviation where it goes deeper into them."""
        return math.sqrt(12.0) * self.deviation if self.sinks else play


Scales = Callable[[Model, ModalForm], tuple[LinearLaw, tuple[PairScale, ...]] | None]
"""A way to a linear law and the scales of all pairs: `scales_of` or `scales_of_free_motion`."""


DEEP = 2.0
"""A mass sinks into stops where their springs leave it this many times the play."""


def scales_of(
    model: Model, modes: ModalForm, method: str = "simulate"
) -> tuple[LinearLaw, tuple[PairScale, ...]] | None:
    """A linear law close to the stationary one, and the scales of each pair; None if none is found.

    Compliant stops are treated as rigid ones with their restitution. Where the mass sinks deeper
    into them than their play is wide, no rigid stop is like them. The energy that they store then
    gives the law.
    """
    rigid = scales_by(model, modes, method, compliant=False)
    if rigid is None or not any(map(_sinks, model.pairs, rigid[1])):
        return rigid
    found = scales_by(model, modes, method, compliant=True)
    if found is None:
        return rigid
    law, scales = found
    sinking = map(_sinks, model.pairs, scales)
    return law, tuple(
        scale._replace(sinks=sinks) for scale, sinks in zip(scales, sinking, strict=True)
    )


def _sinks(pair: Pair, scale: PairScale) -> bool:
    """Whether a gap at its rms speed goes deeper into two stops than their play is wide."""
    laws = [stop.law for stop in pair.stops if isinstance(stop.law, CompliantLaw)]
    if pair.play is None or not laws or not all(law.has_energy for law in laws):
        return False
    energy = pair.mass * scale.speed**2
    held = scale.curvature * energy, scale.slope * energy
    law = _law_of_gap(pair, held, energy, compliant=True)
    return math.sqrt(12.0 * law.variance) > DEEP * pair.play


def scales_by(
    model: Model, modes: ModalForm, method: str, *, compliant: bool
) -> tuple[LinearLaw, tuple[PairScale, ...]] | None:
    """`scales_of` with compliant stops as rigid ones or, if `compliant`, by their energy.

    Every pair is replaced by a spring and a damper. The spring gives the gap the mean and the
    variance of a normal distribution truncated at the stops. The damper takes as much power as the
    restitution does at Rayleigh impact speeds. Both are found by iteration. `method` is the name
    of the method in error messages.
    """
    if not model.shaken and model.modulations:
        model = stirred(model)
        modes = model.modal
    substitutes = [_first_guess(modes, pair) for pair in model.pairs]
    scales: tuple[PairScale, ...] = ()
    law = following = linear_law(modes, substitutes)
    free = linear_law(modes) if modes.tables and model.pairs else None
    for _ in range(ITERATIONS if model.pairs else 0):
        if following is None:  # no spring represents so wide a gap: the last law is kept
            break
        law = following
        found = [
            _substitute(
                modes,
                (law, free),
                pair,
                modes.gaps[j],
                old,
                _without_own_spring(modes, substitutes, j),
                method,
                compliant,
            )
            for j, (pair, old) in enumerate(zip(model.pairs, substitutes, strict=True))
        ]
        if None in found:
            return None
        substitutes = [each[0] for each in found if each]
        scales = tuple(each[1] for each in found if each)
        following = linear_law(modes, substitutes)
    return None if law is None else (law, scales)


SLOW_IMPACTS = 0.05
"""Slowest impact that rates count by default where a stop loses energy, over the rms speed of its
gap. At an inelastic stop slow impacts come in clusters without end: their rate converges slowly
with any resolution, and is infinite below R = exp(-pi / sqrt 3)."""


def default_thresholds(model: Model, linear: Model | None = None) -> dict[str, float] | None:
    """Speed of the slowest impacts that rates count by default, m/s, by pair: the one rule of all
    methods. F1 and F2 count all impacts.

    It is 0 where no stop of a pair loses energy, else SLOW_IMPACTS of the rms speed of the gap by
    `scales_of`: with springs and dampers in the place of impacts, of functions, and of what is
    drawn. None where there is no such linear structure. `linear` is the model `with_linear_part`,
    where it is known.
    """
    if all(_is_elastic(pair) for pair in model.pairs):
        return {pair.name: 0.0 for pair in model.pairs}
    try:
        if linear is None:
            linear = with_linear_part(model) if model.functions else model
        linear = linear.with_tables_of_drawn.with_noise_of_drives
        known = scales_of(linear, linear.modal)
    except NotApplicable:
        return None
    if known is None:
        return None
    return {
        pair.name: default_threshold(pair, math.hypot(scale.speed, speed_of_stop(model, pair)))
        for pair, scale in zip(model.pairs, known[1], strict=True)
    }


def default_threshold(pair: Pair, speed: float) -> float:
    """The default threshold of a pair whose gap has this rms speed by `scales_of`, m/s."""
    return 0.0 if _is_elastic(pair) else SLOW_IMPACTS * speed


def _is_elastic(pair: Pair) -> bool:
    return all(stop.law.restitution == 1.0 for stop in pair.stops)


def speed_of_stop(model: Model, pair: Pair) -> float:
    """Rms speed of the stops of a pair, m/s."""
    square = 0.0
    for way, number, sample in pair.moved:
        if number is not None:
            signal = model.signals[number]
            noise = signal.omega**2 * signal.intensity / (2.0 * signal.damping_rate or 1.0)
            square += (way * signal.omega) ** 2 * (signal.amplitude**2 / 2.0 + noise)
        if sample is not None:
            square += (2.0 * math.pi * way) ** 2 * model.sampled_modulations[sample].moment(2.0)
    return math.sqrt(square)


STIRRING = 0.1
"""Damping rate of the noise that stands for a modulation, relative to the frequency of a gap."""


def stirred(model: Model) -> Model:
    """A modulated structure with white noise and a damper in the place of the modulations. Its gaps
    then move as wide as to their stops."""
    frequency = math.sqrt(float(model.modal.squares[-1]))
    widths = [(pair.mass, max(abs(stop.distance) for stop in pair.stops)) for pair in model.pairs]
    energy = max((mass * (frequency * width) ** 2 for mass, width in widths), default=1.0)
    intensity = 2.0 * STIRRING * frequency * energy
    roots = np.linalg.cholesky(model.mass).T
    return replace(
        model, whites=tuple((intensity, root) for root in roots), functions=(),
        damping=model.damping + STIRRING * frequency * model.mass,
    )  # fmt: skip


def scales_of_free_motion(
    model: Model, modes: ModalForm, method: str = "simulate"
) -> tuple[LinearLaw, tuple[PairScale, ...]] | None:
    """`scales_of` for stops that are so far away that they hardly change the stationary motion: the
    law without them, and the scales of its gaps."""
    law = linear_law(modes)
    if law is None:
        return None
    scales = []
    for pair, gap in zip(model.pairs, modes.gaps, strict=True):
        square, spread = _shaken(modes, law, pair, gap, method), law.variances(gap, 0)
        mean = float(gap @ (modes.rest + law.mean))
        scales.append(
            PairScale(
                speed=math.sqrt(square),
                pressing=0.0,
                slope=mean / spread,
                curvature=1.0 / spread,
                deviation=math.sqrt(spread),
            )
        )
    return law, tuple(scales)


def _shaken(modes: ModalForm, law: LinearLaw, pair: Pair, gap: Vector, method: str) -> float:
    """Mean square of the speed of a gap; NotApplicable where that is rounding error only."""
    square = law.variances(gap, modes.size)
    if not square > UNSHAKEN * law.largest_variance(modes.size):
        raise _at_rest(pair, method)
    return square


def _at_rest(pair: Pair, method: str) -> NotApplicable:
    return NotApplicable(
        method,
        f"no excitation reaches the impact pair {pair.name!r}, or it is pressed so hard onto a "
        "stop that it never leaves it: it is at rest; shake it, move that stop, or take the pair "
        "out of the scene",
    )


def _first_guess(modes: ModalForm, pair: Pair) -> EquivalentLinear:
    frequency = modes.frequency
    stops = [stop.position for stop in pair.stops]
    if frequency == 0.0 and modes.tables:
        # the middle of the excited band
        bands = [(table.frequency_hz[0], table.frequency_hz[-1]) for table, _ in modes.tables]
        frequency = 2.0 * math.pi * max(math.sqrt(low * high) for low, high in bands)
    elif frequency == 0.0:
        # the only time scale is that in which noise brings the mass across the gap
        noise = float(np.trace(modes.white)) / pair.mass
        width = max(stops) - min(stops) or abs(stops[0]) or 1.0
        frequency = (noise / width**2) ** (1.0 / 3.0)
    loss = max((1.0 - stop.law.restitution_mean_square for stop in pair.stops), default=0.0)
    return EquivalentLinear(
        spring=pair.mass * frequency**2,
        centre=sum(stops) / len(stops),
        damper=loss * pair.mass * frequency,
    )


def _without_own_spring(
    modes: ModalForm, substitutes: Sequence[EquivalentLinear], j: int
) -> tuple[float, float]:
    """Stiffness k and force f of a gap without the spring of its own stops: k y - f pulls it back.

    Both are static ones, because y has the Gibbs distribution of k and f where noise matches the
    damping.
    """
    # the soft spring holds a gap that no other spring holds
    gap, soft = modes.gaps[j], SOFTEST * substitutes[j].spring
    stiffness = np.diag(modes.squares) + soft * np.outer(gap, gap)
    forces = modes.falling.copy()
    for other, substitute in enumerate(substitutes):
        if other != j:
            row = modes.gaps[other]
            stiffness += substitute.spring * np.outer(row, row)
            forces += substitute.spring * (substitute.centre - row @ modes.rest) * row
    compliance = float(gap @ np.linalg.solve(stiffness, gap))
    mean = float(gap @ (modes.rest + np.linalg.solve(stiffness, forces)))
    return max(1.0 / compliance - soft, 0.0), mean / compliance


def _substitute(
    modes: ModalForm,
    laws: tuple[LinearLaw, LinearLaw | None],
    pair: Pair,
    gap: Vector,
    old: EquivalentLinear,
    held: tuple[float, float],
    method: str,
    compliant: bool,
) -> tuple[EquivalentLinear, PairScale] | None:
    """The next spring and damper, and the scales of the pair.

    They follow from the law that the gap would have without the old spring, cut at the stops. The
    `laws` are that with the old springs and, under tables, that without stops. None where nothing
    holds the gap on a side without a stop.
    """
    law, free = laws
    square = _shaken(modes, law, pair, gap, method)
    moving = square
    own, force = held
    pressing = max(stop.side * (force - own * stop.position) for stop in pair.stops) / pair.mass
    if free is not None and pressing > 0.0:
        # a spring as stiff as a mass on its stop asks for moves the resonance out of a table, and
        # the gap would seem to be at rest: what shakes it throws it off as fast as without the stop
        square = max(square, free.variances(gap, modes.size))
    energy = pair.mass * square
    lifting = _energy_behind(modes, law, pair, gap) if pressing > 0.0 else 0.0
    swinging = max(energy, lifting)
    try:
        cut = _law_of_gap(pair, held, energy, compliant)
        spread = cut if swinging == energy else _law_of_gap(pair, held, swinging, compliant)
    except ValueError:
        return None
    if not spread.variance > 0.0:
        raise _at_rest(pair, method)
    needed = swinging / spread.variance
    spring = max(needed - own, SOFTEST * needed)
    power = _power_of_stops(pair, cut, square)
    mixed = EquivalentLinear(
        spring=math.sqrt(old.spring * spring),
        centre=(needed * spread.mean - force) / spring,
        damper=0.5 * (old.damper + power / square),
    )
    leans = pressing * math.sqrt(cut.variance) > PRESSING_THRESHOLD * moving
    return mixed, PairScale(
        speed=math.sqrt(square),
        pressing=pressing if leans else 0.0,
        slope=force / swinging,
        curvature=own / swinging,
        deviation=math.sqrt(spread.variance),
    )


def _energy_behind(modes: ModalForm, law: LinearLaw, pair: Pair, gap: Vector) -> float:
    """Twice the mean energy, J, of the springs that pull at a gap.

    The structure behind a mass that is pressed onto a stop may lift it by its swinging, even where
    its own motion is too small.
    """
    pull = pair.mass * gap * modes.squares
    stiffness = pair.mass * float(pull @ gap)
    return law.variances(pull, 0) / stiffness if stiffness > 0.0 else 0.0


def _law_of_gap(
    pair: Pair, held: tuple[float, float], energy: float, compliant: bool
) -> TruncatedNormal | GibbsLaw:
    """The law exp(-(k y^2 / 2 - f y) / energy) of a gap that the force k y - f pulls back.

    Rigid stops cut it; within compliant stops it has the factor exp(-V / energy), with V the energy
    that the stop stores.
    """
    own, force = held
    gap = Gap.of_pair(
        pair, omega=math.sqrt(own / pair.mass), damping_rate=0.0, load=force / pair.mass
    )
    if compliant and gap.soft:
        return GibbsLaw.of(gap, theta=energy / pair.mass)
    lower, upper = gap.ends
    return TruncatedNormal(slope=force / energy, curvature=own / energy, lower=lower, upper=upper)


def _power_of_stops(pair: Pair, law: TruncatedNormal | GibbsLaw, square: float) -> float:
    """Power that the stops take, W: mu (1 - R^2) / 2 F2 with Rayleigh impact speeds, and
    c E y'^2 P(contact) at a stop with a linear damper."""
    power = 0.0
    for stop in pair.stops:
        damped = isinstance(stop.law, CompliantLaw) and stop.law.has_linear_damper
        if isinstance(law, TruncatedNormal) or not damped:
            hits = gaussian_stop(law.density_at(stop.position), square)
            loss = (1.0 - stop.law.restitution_mean_square) / 2.0
            power += loss * pair.mass * hits.speed_square_rate
        elif isinstance(stop.law, CompliantLaw) and not stop.law.conservative:
            touching = law.contact(stop.name)
            assert touching is not None
            power += stop.law.damping(pair.mass) * square * touching.probability
    return power


PRESSING_THRESHOLD = 0.5
"""A pair is pressed onto a stop above this share: the pressing acceleration times the standard
deviation of the gap, over E v^2, v the rate of the gap. The share is 1 for a mass that lies on the
stop."""


SOFTEST = 1e-6
"""Smallest spring in place of the stops of a gap, relative to the spring that alone would give
the gap its variance. For a gap that hardly meets its stops the difference could be 0 or less."""


# ------------------------------------------------------------------------------
# The linear part of springs and dampers that are functions: what a simulation moves exactly.
#
# A step of a simulation kicks the velocities by functions, and moves the rest exactly. The smaller
# the force of the kicks, the smaller is the error of the step. Each function is therefore taken
# apart into f + k y + c y', by statistical linearisation, and the difference from it, which kicks.
# ------------------------------------------------------------------------------


LINEAR_ITERATIONS = 200
"""Largest number of linearisations; they end when nothing changes by more than SETTLED."""

SETTLED = 1e-4
"""Relative change of deviations at which the linear part is settled; it needs few digits, as the
kicks make up for the difference."""

LEAST_WEIGHT = 1e-3
"""Smallest share of the way to the motion of a linear part that an iteration goes."""

WIDTHS = np.geomspace(1e-9, 1e3, 25)
"""Deviations, m and m/s, among which the iteration finds its start."""


class Motion(NamedTuple):
    """Mean and standard deviation of the displacement of a function, and that of its rate, SI."""

    mean: float
    deviation: float
    speed: float


def with_linear_part(
    model: Model,
    method: str = "simulate",
    law_of: Callable[[Model], LinearLaw | None] | None = None,
    settled: float = SETTLED,
) -> Model:
    """The model whose matrices and constant forces hold the linear parts of all functions.

    Parameters
    ----------
    model
        A model with functions.
    method
        Name of the method in error messages.
    law_of
        The law of the linear part, None where it has none; by default a rough one.
    settled
        Relative change of deviations at which the iteration ends.

    Raises
    ------
    NotApplicable
        Where no linear part has a stationary state.
    """
    law_of = law_of or _rough_law
    # a mass that friction holds has a linear part of its own: that of a motion is met from above
    held = any(part.law.sticks and not part.law.drives for part in model.functions)
    for width in WIDTHS[::-1] if held else WIDTHS:
        # wide motions are held by what grows, and narrow ones damped by friction
        motions = [Motion(0.0, float(width), float(width))] * len(model.functions)
        linear = with_forms(model, motions)
        found = _motions(linear, law_of)
        if found is not None:
            break
    else:
        raise NotApplicable(
            method,
            "structure.spring and structure.damper must hold and brake the structure, got none "
            "that do in motions of any size; add stiffness or damping",
        )
    weight = 0.5
    for _ in range(LINEAR_ITERATIONS):
        following = [between(*each, weight) for each in zip(motions, found, strict=True)]
        trial = with_forms(model, following)
        reached = _motions(trial, law_of)
        if reached is None or _distance(following, reached) > _distance(motions, found):
            weight /= 2.0  # between wells a small change of a motion may be a large one of its law
            if weight < LEAST_WEIGHT:  # beyond the widest motion that is held
                break
            continue
        moved = _distance(motions, following)
        linear, motions, found = trial, following, reached
        if moved <= 2.0 * weight * settled:
            break
    return linear


def with_forms(model: Model, motions: Sequence[Motion]) -> Model:
    """The model with the linear parts at these motions."""
    forms = []
    for part, motion in zip(model.functions, motions, strict=True):
        form = form_of(part, motion)
        forms.append(form._replace(force=form.force - form.stiffness * motion.mean))
    return with_affine(model, forms)


def with_affine(model: Model, forms: Sequence[LinearForm]) -> Model:
    """The model with linear parts f + k x + c v, N."""
    stiffness, damping = model.stiffness.copy(), model.damping.copy()
    constants, functions = list(model.constants), []
    for part, form in zip(model.functions, forms, strict=True):
        row = part.direction
        stiffness += form.stiffness * np.outer(row, row)
        damping += form.damping * np.outer(row, row)
        if form.force:
            constants.append((-form.force, row))
        affine = (form.stiffness / part.mass, form.damping / part.mass, form.force / part.mass)
        functions.append(replace(part, affine=affine))
    return replace(
        model, stiffness=stiffness, damping=damping, constants=tuple(constants),
        functions=tuple(functions),
        rates=rates_of(model.mass, damping, stiffness, model.branches),
        restoring=None, potential=None, drag=None,
    )  # fmt: skip


def form_of(part: FunctionOfMotion, motion: Motion) -> LinearForm:
    """The linear form of a function, of all that are side by side, N."""
    form = part.law.moved_exactly(*motion)
    return LinearForm(*(part.count * each for each in form))


def _rough_law(model: Model) -> LinearLaw | None:
    planned = model.with_noise_of_drives
    known = scales_of(planned, planned.modal)
    return None if known is None else known[0]


def _motions(model: Model, law_of: Callable[[Model], LinearLaw | None]) -> list[Motion] | None:
    """The motion of each function in a model with linear parts; None without a stationary state, or
    where that is smaller than rounding beside what shakes it."""
    law = law_of(model) if is_positive(model.stiffness) else None
    if law is None or min(_squares(model, law)) < 0.0:
        return None
    return motions_of(model, law)


def _squares(model: Model, law: LinearLaw) -> list[float]:
    """Mean squares of the displacement and of the velocity of each function about their means."""
    modes = model.modal
    rows: list[Vector] = [part.direction @ modes.shapes for part in model.functions]
    return [law.variances(row, start) for start in (0, modes.size) for row in rows]


def motions_of(model: Model, law: LinearLaw) -> list[Motion]:
    """The motion of each function under a law of the linear part."""
    modes = model.modal
    deviations = np.reshape([math.sqrt(each) for each in _squares(model, law)], (2, -1))
    means = [part.direction @ modes.shapes @ (modes.rest + law.mean) for part in model.functions]
    return [Motion(*map(float, each)) for each in zip(means, *deviations, strict=True)]


def is_positive(stiffness: np.ndarray) -> bool:
    """Whether no motion lowers the energy of a stiffness matrix."""
    values = np.linalg.eigvalsh(stiffness)
    return bool(values[0] >= -1e-9 * max(values[-1], 0.0))


def between(one: Motion, other: Motion, weight: float = 0.5) -> Motion:
    """A motion on the way from one to another, by default half way."""
    return Motion(
        one.mean + weight * (other.mean - one.mean),
        one.deviation ** (1.0 - weight) * other.deviation**weight,
        one.speed ** (1.0 - weight) * other.speed**weight,
    )


def _distance(ones: Sequence[Motion], others: Sequence[Motion]) -> float:
    """Largest relative difference of two motions of all functions."""
    return max(
        max(
            abs(one.mean - other.mean) / other.deviation,
            abs(math.log(one.deviation / other.deviation)),
            abs(math.log(one.speed / other.speed)),
        )
        for one, other in zip(ones, others, strict=True)
    )


def fastest_rate(part: FunctionOfMotion, motion: Motion) -> float:
    """Largest rate, 1/s, at which a function alone moves its reduced mass: the frequency of its
    spring, the decay of its damper, or what it resolves in time."""
    mass, law = part.mass / part.count, part.law
    return max(
        math.sqrt(law.stiffest(motion.mean, motion.deviation) / mass),
        law.most_damping(motion.mean, motion.speed) / mass,
        law.fastest,
    )
