"""`judge`: whether an integrator finds the known answers. Chapters: comparison by stated errors;
problems with a common mistake; likely causes from the balances; the verdict."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any, ClassVar, TypedDict, Unpack

import numpy as np
import scipy

from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.results.base import (
    COMMON,
    RESPONSE_QUANTITIES,
    CoordinateResponse,
    DataFrame,
    PairResponse,
    Response,
    Result,
    frame_of,
)
from stochvi.results.errors import StochviError
from stochvi.results.estimates import (
    Cost,
    Estimate,
    format_with_error,
    normal_score,
    student_quantile,
)
from stochvi.sampling.calculations import Random, calculation, check_options
from stochvi.scenes.scene import Scene
from stochvi.verification.check import (
    AGREES,
    DISAGREES,
    FAMILY_ALARM_RATE,
    RARE,
    TOO_RARE,
    seeds_of,
    single_alarm_rate,
)
from stochvi.verification.testing.problems import (
    IMPACTS,
    PATHS,
    RELAXATIONS,
    Function,
    Problem,
    Sample,
    Values,
    known_problems,
    needs,
    plain_name,
    sample_of,
    size_of,
    solved,
    split,
    truths_of,
)

# ------------------------------------------------------------------------------
# Comparison of a sampled number with the truth, by the errors that it states.
# ------------------------------------------------------------------------------


Z = 4.5
"""Largest difference that passes, in standard errors: a right answer exceeds it once in 150 000
cases."""


def assert_agrees(estimate: Estimate, truth: float, z: float = Z) -> None:
    """Fail unless `truth` lies within z standard errors and the stated bias of the estimate.

    Errors are put together by the one rule of `Estimate`.

    Parameters
    ----------
    estimate
        The sampled number.
    truth
        The true value.
    z
        Number of standard errors by which the estimate may be off.

    Raises
    ------
    AssertionError
        With the value, the truth and the standard errors between them.
    ValueError
        If it is no estimate, or states no bias, because then no truth can refute it.

    See Also
    --------
    stochvi.testing.judge : Compares with several known answers, and says what is wrong.

    Examples
    --------
    >>> assert_agrees(Estimate(value=1.02, standard_error=0.01), 1.0)
    >>> assert_agrees(
    ...     Estimate(value=1.08, standard_error=0.01), 1.0
    ... )  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    AssertionError: 1.080(10) [] differs from 1 by 0.08: 8.0 standard errors ...
    """
    if not isinstance(estimate, Estimate):
        raise ValueError(f"estimate must be an Estimate, got {estimate!r}; give its errors as well")
    if estimate.bias is None:
        raise ValueError(f"{estimate} states no bias, so no truth can confirm or refute it")
    difference = estimate.value - truth
    tolerance = estimate.reach(z)
    away = f"{abs(difference) / estimate.standard_error:.1f}" if estimate.standard_error else "inf"
    if not abs(difference) <= tolerance:
        raise AssertionError(
            f"{estimate} differs from {truth:.9g} by {difference:.3g}: {away} standard errors of "
            f"{estimate.standard_error:.3g}, allowed {z:g} and a bias of {estimate.bias:.3g}"
        )


# ------------------------------------------------------------------------------
# Problems that differ from the right one by a common mistake, and whether one of them explains an
# answer.
# ------------------------------------------------------------------------------


AGREED = 4.0
"""Number of standard errors within which every quantity must lie for a suspected problem to explain
the answer."""

RTOL = 1e-2
"""Relative error asked of the answer to a suspected problem; the error that it reaches is allowed
for."""

Document = dict[str, Any]
Change = Callable[[Document], None]
Judged = tuple[Problem, Sample, Mapping[str, Estimate]]


def suspects_of(measured: Sequence[Judged]) -> Iterator[str]:
    """The mistakes that explain every quantity of every problem with stops that is off.

    Parameters
    ----------
    measured
        Problems with the sample that was returned and the true values.
    """
    wrong = [each for each in measured if not each[0].free and not _explained(each[1], each[2])]
    if not wrong:
        return
    for words, change in SUSPECTS.items():
        if all(_fits(problem, sample, change) for problem, sample, _ in wrong):
            names = ", ".join(problem.name for problem, _, _ in wrong)
            yield f"all that was returned of {names} is right for a problem with {words}"


def _fits(problem: Problem, sample: Sample, change: Change) -> bool:
    """Whether a sample is right for the changed problem."""
    document = problem.scene.expanded.document()
    before = deepcopy(document)
    try:
        change(document)
        if document == before:
            return False
        truth = solved(Scene(**document), problem.speed_threshold, rtol=RTOL)
    except (KeyError, ValueError, ArithmeticError, StochviError):
        return False  # the change makes no sense of this problem, or nothing knows its answer
    return _explained(sample, truths_of(problem, truth))


def _explained(sample: Sample, truths: Mapping[str, Estimate]) -> bool:
    """Whether every quantity of a sample agrees with these values."""
    for name in sample.names():
        if name not in truths:
            continue
        value, error = sample.evaluate(lambda values, name=name: values[name])  # type: ignore[misc]
        allowed = AGREED * error + sample.bias(name) + (truths[name].bias or 0.0)
        if not abs(value - truths[name].value) <= allowed:
            return False
    return True


def _laws_exchanged(document: Document) -> None:
    for pair in document["impact_pair"]:
        pair["lower_law"], pair["upper_law"] = pair["upper_law"], pair["lower_law"]


def _stops_mirrored(document: Document) -> None:
    for pair in document["impact_pair"]:
        for one, other in (("lower", "upper"), ("lower_law", "upper_law")):
            ends = {one: pair.pop(other, None), other: pair.pop(one, None)}
            for key, end in ends.items():
                if end is not None:
                    pair[key] = -end if isinstance(end, float) else end


def _noise(factor: float) -> Change:
    def change(document: Document) -> None:
        for excitation in document["excitation"]:
            if excitation["kind"] == "white":
                key = "intensity" if "intensity" in excitation else "density"
                excitation[key] *= factor
            elif "level_db" in excitation:
                excitation["level_db"] += 10.0 * math.log10(factor)

    return change


def _damping(factor: float) -> Change:
    def change(document: Document) -> None:
        structure = document["structure"]
        for key in ("damping", "zeta"):
            if isinstance(structure.get(key), float):
                structure[key] *= factor

    return change


def _elastic(document: Document) -> None:
    for pair in document["impact_pair"]:
        for key in ("law", "lower_law", "upper_law"):
            if key in pair:
                pair[key]["coefficient"] = 1.0


SUSPECTS: dict[str, Change] = {
    "the restitutions of the lower and the upper stop exchanged": _laws_exchanged,
    "lower and upper stop exchanged (the sign of the displacement is wrong)": _stops_mirrored,
    "twice the noise (a one-sided density for S0)": _noise(2.0),
    "half the noise (S0 taken for a one-sided density)": _noise(0.5),
    "2 pi times the noise (S0 taken for a density per rad/s)": _noise(2.0 * math.pi),
    "the noise divided by 2 pi (a density per rad/s for S0)": _noise(0.5 / math.pi),
    "twice the damping": _damping(2.0),
    "half the damping": _damping(0.5),
    "stops that lose no energy (R = 1)": _elastic,
}
"""Changes of the document of a scene, by the words for the problem that each mistake makes of
it."""


# ------------------------------------------------------------------------------
# Likely causes of a pattern of disagreements, from the balances that any right answer obeys.
#
# Symbols: S0 the intensity, b the damping rate, F1 and F2 the sums of impact speeds and of their
# squares per second. One oscillator between stops at -D and D of the restitution R obeys
#
#     energy   S0 = 2 b E v^2 + (1 - R^2) F2,
#     virial   E v^2 = omega^2 E x^2 + (1 + R) D F1.
#
# Solved for a parameter they give the restitution, clearance, damping or intensity that an
# integrator in fact simulated.
# ------------------------------------------------------------------------------


SURE = 4.0
"""Number of standard errors from which a deviation is reported as a hint."""

SHARP = 4.0
"""Ratio of the energy that a start from rest lacks to its standard error, from which on that start
is named as a cause."""

NEAR = 0.04
"""Largest relative distance from a number that has a known cause (a half, 2, R^2) at which that
cause is named."""

NOISE_FACTORS = (
    (2.0, "noise twice too strong (a one-sided density for S0)"),
    (0.5, "half the noise (S0 taken for a one-sided density)"),
    (2.0 * math.pi, "noise 2 pi times too strong (S0 taken for a density per rad/s)"),
    (
        0.5 / math.pi,
        "noise 2 pi times too weak (S0 divided by 2 pi, or a density per rad/s for S0)",
    ),
    (math.pi, "noise pi times too strong (S0 taken for a one-sided density per rad/s)"),
    (1.0 / math.pi, "noise pi times too weak (a one-sided density per rad/s for S0)"),
    (STANDARD_GRAVITY**2, "accelerations in m/s^2 taken for g: noise 9.81^2 times too strong"),
    (STANDARD_GRAVITY**-2, "accelerations in g taken for m/s^2: noise 9.81^2 times too weak"),
)
"""Factors on the strength of the noise that have a known cause."""

LENGTHS = {
    "displacement_mean": 1, "displacement_std": 1, "velocity_std": 1, "impact_speed_rate": 1,
    "impact_speed_square_rate": 2,
}  # fmt: skip
"""Power with which a quantity grows with the unit of length."""

UNITS = (
    (1e3, "in mm where m is expected"),
    (1e2, "in cm where m is expected"),
    (1e-3, "in km where m is expected"),
    (1.0 / STANDARD_GRAVITY, "divided by g"),
    (STANDARD_GRAVITY, "multiplied by g"),
)
"""Factors on the unit of length that have a known cause."""

FACTORS = (
    (2.0 * math.pi, "a factor of 2 pi (a frequency in Hz taken for one in rad/s?)"),
    (0.5 / math.pi, "a factor of 2 pi (a frequency in rad/s taken for one in Hz?)"),
    (2.0, "a factor of 2"),
    (0.5, "a factor of 2"),
)
"""Factors on a single quantity that have a known cause."""

STOPS = ("velocity_std", "impact_speed_rate", "impact_speed_square_rate")


@dataclass(frozen=True)
class Measured:
    """A problem with the sample that an integrator returned for it, and the true values."""

    problem: Problem
    sample: Sample
    truths: Mapping[str, Estimate]

    @property
    def finite(self) -> bool:
        """Whether every quantity is a number."""
        return all(math.isfinite(self._of(name)) for name in self.sample.names())

    def _of(self, name: str) -> float:
        return self.sample.evaluate(lambda values: values[name])[0]

    def has(self, *names: str) -> bool:
        """Whether the sample has all of these quantities."""
        return set(names) <= set(self.sample.names())

    @property
    def hit(self) -> bool:
        """Whether the sample has impacts."""
        return self.has(*STOPS) and self._of("impact_speed_square_rate") > 0.0

    def ratio(self, name: str) -> tuple[float, float]:
        """A quantity over its true value, with the standard error; NaN where the truth is 0."""
        truth = self.truths[name].value
        value, error = self.sample.evaluate(lambda values: values[name])
        return (value / truth, abs(error / truth)) if truth else (math.nan, math.nan)

    @property
    def symmetric(self) -> bool:
        """Whether the stops are at -D and D, of one restitution, and there is no load."""
        own = self.problem
        return own.lower == -own.upper and own.load == 0.0 and own.restitution is not None


def hints_of(measured: Sequence[Measured]) -> Iterator[str]:
    """Sentences that name likely causes; none where no pattern is recognised."""
    if wild := [each.problem.name for each in measured if not each.finite]:
        yield (
            f"numbers grow beyond all bounds ({', '.join(wild)}): the step is too long for the "
            "scheme, or a velocity is not reversed at a stop"
        )
    sound = [each for each in measured if each.finite]
    if units := list(_units(sound)):
        yield from units
        return
    oscillators = [each for each in sound if each.problem.white_oscillator]
    flights = list(_flight(oscillators)) or list(_linear_structures(sound))
    yield from flights
    if flights:
        yield from _start(oscillators)
    else:
        found = list(suspects_of([(each.problem, each.sample, each.truths) for each in sound]))
        found = found or list(_start(oscillators))
        if found:
            yield from found
            return
        yield from _elastic_stops(oscillators)
        yield from _lossy_stops(oscillators)
    yield from _clearance(oscillators)
    yield from _counting(sound)
    yield from _factors(sound)


def _near(value: float, error: float, wanted: float) -> bool:
    """Whether a positive number agrees, within its error, with one that has a known cause."""
    return abs(value / wanted - 1.0) < min(NEAR + SURE * error / wanted, 0.2)


def _units(measured: Sequence[Measured]) -> Iterator[str]:
    """Hints on numbers in another unit, or of another kind, than is expected."""
    found: dict[str, list[str]] = {}
    squares = []
    for each in measured:
        for name in each.truths:
            power = LENGTHS.get(split(name)[1], 0)
            if name not in each.sample.names() or not power:
                continue
            ratio, error = each.ratio(name)
            if not ratio > 0.0:
                continue
            factor = ratio ** (1.0 / power)
            for wanted, words in UNITS:
                if _near(factor, error * factor / (power * ratio), wanted):
                    found.setdefault(words, []).append(f"{name} of {each.problem.name}")
            truth = each.truths[name].value
            apart = abs(math.log(truth)) > 0.5 if truth > 0.0 else False
            if name.endswith("_std") and apart and _near(ratio, error, truth):
                squares.append(f"{name} of {each.problem.name}")
    moments = [(each, name) for each in measured for name in _deviations(each)]
    for words, names in found.items():
        # noise that is off by g^2 moves every deviation by g: that is a hint on the noise
        if words[-1] == "g" and sum(
            name.split(" of ")[0].endswith("_std") for name in names
        ) == len(moments):
            continue
        yield f"{', '.join(names)} {'is' if len(names) == 1 else 'are'} {words}"
    if squares:
        yield f"{', '.join(squares)}: the square stands there (E x^2 and not its root)"


def _deviations(each: Measured) -> list[str]:
    return [name for name in each.sample.names() if name.endswith("_std") and name in each.truths]


def _linear_structures(measured: Sequence[Measured]) -> Iterator[str]:
    """Hints on the noise of structures without stops, whose deviations all grow with it."""
    for each in measured:
        names = _deviations(each)
        if not each.problem.free or not names or each.problem.white_oscillator:
            continue
        ratios = [each.ratio(name) for name in names]
        if all(abs(ratio - 1.0) <= SURE * error for ratio, error in ratios):
            continue
        for factor, cause in NOISE_FACTORS:
            if all(_near(ratio**2, 2.0 * ratio * error, factor) for ratio, error in ratios):
                yield f"all mean squares of {each.problem.name} are off by one factor: {cause}"
                return
        started = _shares_from_rest(each.problem)
        if started and all(
            abs(ratio**2 - started[name]) < SURE * 2.0 * ratio * error
            for name, (ratio, error) in zip(names, ratios, strict=True)
        ):
            lowest = 100.0 * (1.0 - min(started[name] for name in names))
            yield (
                f"the mean squares of {each.problem.name} lack what they would if the start from "
                f"rest were counted, up to {lowest:.2g} %: leave out the burn-in of "
                f"{each.problem.burn_in:.4g} s"
            )
            return


def _shares_from_rest(problem: Problem) -> dict[str, float]:
    """Mean squares over the duration from rest on, as shares of the stationary ones, of several
    coordinates in white noise without stops; empty for another problem.

    From rest the covariance is P - e^(A t) P e^(A' t). Its integral over time is T P - Q with A Q +
    Q A' = -P; A P + P A' is minus the noise.
    """
    model = problem.model
    if model.tables or model.stops or model.constants:
        return {}
    count = len(model.coordinates)
    inverse = np.linalg.inv(model.mass)
    states = np.zeros((2 * count, 2 * count))
    states[:count, count:] = np.eye(count)
    states[count:, :count] = -inverse @ model.stiffness
    states[count:, count:] = -inverse @ model.damping
    noise = np.zeros_like(states)
    noise[count:, count:] = inverse @ model.white @ inverse.T
    stationary = scipy.linalg.solve_continuous_lyapunov(states, -noise)
    lacking = scipy.linalg.solve_continuous_lyapunov(states, -stationary) / problem.duration
    share = 1.0 - np.diag(lacking) / np.diag(stationary)
    return {
        f"{name}.{quantity}": float(share[place + shift])
        for place, name in enumerate(model.coordinates)
        for shift, quantity in ((0, "displacement_std"), (count, "velocity_std"))
    }


def _start(measured: Sequence[Measured]) -> Iterator[str]:
    """A hint where the start from rest was not left out: the balance of power then lacks the energy
    of the stationary motion, divided by the duration."""
    for each in measured:
        own, truths = each.problem, each.truths
        needed = ("displacement_mean", "displacement_std", "velocity_std")
        if not set(needed) <= set(truths) or not each.has("velocity_std"):
            continue
        if not own.free and not (each.hit and own.restitution is not None):
            continue
        loss = 0.0 if own.restitution is None else 1.0 - own.restitution**2

        def missing(values: Values, own: Problem = own, loss: float = loss) -> object:
            lost = loss * values.get("impact_speed_square_rate", 0.0)
            return (
                1.0 - (2.0 * own.damping_rate * values["velocity_std"] ** 2 + lost) / own.intensity
            )

        found, error = each.sample.evaluate(missing)
        mean, deviation, speed = (truths[name].value for name in needed)
        (start,) = own.start
        energy = 0.5 * speed**2 + 0.5 * own.omega**2 * (mean**2 + deviation**2 - start**2)
        energy -= own.load * (mean - start)
        expected = 2.0 * energy / (own.duration * own.intensity)
        if abs(found - expected) > 3.0 * error:
            continue
        if SHARP * error < expected and found > SURE * error:
            words = "would be lacking if the start from rest were counted"
        elif error < expected and _all_low(each, 3.0 * expected):
            words = "would be if the start from rest were counted, which may be all that is wrong"
        else:
            continue
        yield (
            f"{own.name} lacks {format_with_error(100.0 * found, 100.0 * error)} % of its energy, "
            f"and {100.0 * expected:.2g} % {words}: leave out the burn-in of {own.burn_in:.4g} s"
        )
        return


def _all_low(each: Measured, most: float) -> bool:
    """Whether every quantity but a mean lies at most the share `most` below its true value and none
    clearly above, and one clearly below."""
    names = [name for name in each.truths if name in each.sample.names()]
    ratios = [each.ratio(name) for name in names if not name.endswith("_mean")]
    return all(-most < ratio - 1.0 < error for ratio, error in ratios) and any(
        1.0 - ratio > SURE * error for ratio, error in ratios
    )


def _counting(measured: Sequence[Measured]) -> Iterator[str]:
    """A hint where the motion is right, but half or twice as many impacts are counted."""
    for each in measured:
        if any(abs(r - 1.0) > SURE * error for r, error in map(each.ratio, _deviations(each))):
            continue
        rates = [name for name in each.truths if split(name)[1] in IMPACTS]
        for factor, cause in (
            (0.5, "only one of two stops is counted"),
            (2.0, "every impact is counted twice"),
        ):
            names = [
                name
                for name in rates
                if name in each.sample.names() and _near(*each.ratio(name), factor)
            ]
            if names:
                yield f"{', '.join(names)} of {each.problem.name}: {cause}, or a time is wrong"


def _flight(measured: Sequence[Measured]) -> Iterator[str]:
    """Hints on noise, damping and the scheme, from problems without stops."""
    for each in measured:
        if not each.problem.free or not each.has("velocity_std"):
            continue
        own = each.problem
        ratio, error = each.sample.evaluate(
            lambda values, own=own: (values["velocity_std"] / own.speed_scale) ** 2  # type: ignore[misc]
        )
        if abs(ratio - 1.0) <= SURE * error:
            continue
        hint = f"without stops E v^2 is {format_with_error(ratio, error)} times the truth"
        for telling, noise in NOISE_FACTORS:
            if _near(ratio, error, telling):
                damping = {2.0: "half the damping", 0.5: "twice the damping"}.get(telling)
                which = _noise_or_damping(measured, telling) if damping else "noise"
                either = f"{noise}, or {damping}"
                cause = {"noise": noise, "damping": damping}.get(which, either)
                hint += f": {cause}"
                break
        else:
            noise, damping = ("strong", "weak") if ratio > 1.0 else ("weak", "strong")
            hint += f": noise too {noise} or damping too {damping} by that factor"
        if ratio > 1.0 and own.omega > 0.0:
            step = own.damping_rate / own.omega**2 * (1.0 - 1.0 / ratio)
            hint += (
                f"; or explicit Euler, which takes omega^2 h from the damping rate, at "
                f"h = {step:.2g} s"
            )
        yield hint
        return


def _factors(measured: Sequence[Measured]) -> Iterator[str]:
    """Hints on quantities that are off by a factor of 2 or of 2 pi."""
    for factor, cause in FACTORS:
        names = [
            f"{name} of {each.problem.name}"
            for each in measured
            for name in each.truths
            if name in each.sample.names()
            and (split(name)[1] not in IMPACTS or factor not in (2.0, 0.5))
            and _near(*each.ratio(name), factor)
        ]
        if names:
            are = "is" if len(names) == 1 else "are"
            yield f"{', '.join(names)} {are} {factor:.3g} times the truth: {cause}"


def _noise_or_damping(measured: Sequence[Measured], ratio: float) -> str:
    """Whether "noise" or "damping" is wrong; impacts that lose energy tell one from the other.

    With the damping d times the true one and noise to match, d (ratio S0 - 2 b E v^2) =
    (1 - R^2) F2.
    """
    for each in measured:
        restitution = each.problem.restitution
        if not each.hit or restitution in (None, 1.0):
            continue
        assert restitution is not None
        own, loss = each.problem, 1.0 - restitution**2

        def damping(values: Values, own: Problem = own, loss: float = loss) -> object:
            left = ratio * own.intensity - 2.0 * own.damping_rate * values["velocity_std"] ** 2
            return loss * values["impact_speed_square_rate"] / left

        found, error = each.sample.evaluate(damping)
        if abs(found - 1.0) < SURE * error + NEAR:
            return "noise"
        if abs(found * ratio - 1.0) < SURE * error * ratio + NEAR:
            return "damping"
    return ""


def _lost(own: Problem) -> Function:
    """The share of its energy that an impact loses, (S0 - 2 b E v^2) / F2, as a function of the
    quantities."""

    def share(values: Values) -> object:
        left = own.intensity - 2.0 * own.damping_rate * values["velocity_std"] ** 2
        return left / values["impact_speed_square_rate"]

    return share


def _elastic_stops(measured: Sequence[Measured]) -> Iterator[str]:
    """A hint on stops that take energy although their restitution is 1."""
    found = [
        (each.problem.name, *each.sample.evaluate(_lost(each.problem)))
        for each in measured
        if each.hit and each.problem.restitution == 1.0
    ]
    sure = [(name, share, error) for name, share, error in found if abs(share) > SURE * error]
    if not sure:
        return
    name, share, error = max(sure, key=lambda entry: abs(entry[1]))
    does, also = "give", ""
    if share > 0.0:
        does, also = "take", ", or the noise ends below the frequencies of motion between the stops"
    yield (
        f"elastic stops {does} {format_with_error(100.0 * abs(share), 100.0 * error)} % of the "
        f"energy of an impact ({name}), and without stops the motion is right or was not asked: "
        f"the restitution is not 1{also}, or impacts are taken at the end of the step; mirror the "
        "overshoot of a semi-implicit step, x = c - R (x - c), or end the step at the stop"
    )


def _lossy_stops(measured: Sequence[Measured]) -> Iterator[str]:
    """A hint on the restitution that was in fact simulated."""
    for each in measured:
        restitution = each.problem.restitution
        if not each.hit or restitution in (None, 1.0):
            continue
        assert restitution is not None
        share, error = each.sample.evaluate(_lost(each.problem))
        if share >= 1.0 or abs(share - (1.0 - restitution**2)) <= SURE * error:
            continue
        seen = math.sqrt(1.0 - share)
        hint = (
            f"stops with R = {restitution:g} act as with R = "
            f"{format_with_error(seen, error / (2.0 * seen))} ({each.problem.name})"
        )
        for other, name in ((restitution**2, "R^2"), (math.sqrt(restitution), "the root of R")):
            if abs(seen / other - 1.0) < NEAR:
                hint += f": {name} stands for R"
        yield hint
        return


def _clearance(measured: Sequence[Measured]) -> Iterator[str]:
    """A hint on the clearance that was simulated, if that is half or twice the true one."""
    for each in measured:
        own = each.problem
        if not (each.hit and each.symmetric and each.has("displacement_std")):
            continue

        def clearance(values: Values, own: Problem = own) -> object:
            assert own.restitution is not None
            square = values["displacement_std"] ** 2 + values.get("displacement_mean", 0.0) ** 2
            push = values["velocity_std"] ** 2 - own.omega**2 * square
            return push / ((1.0 + own.restitution) * values["impact_speed_rate"])

        found, _ = each.sample.evaluate(clearance)
        for factor, name in (
            (0.5, "half: a clearance is per side, not the total play"),
            (2.0, "twice: the total play was taken for the clearance per side"),
        ):
            if abs(found / own.upper / factor - 1.0) < NEAR:
                yield f"stops at {own.upper:g} m act as at {found:.3g} m, {name}"
                return


# ------------------------------------------------------------------------------
# `judge`: whether an integrator finds the known answers, and where it does not.
# ------------------------------------------------------------------------------


Integrator = Callable[[Problem, int], Mapping[str, Any]]
"""A function of a problem and a seed; it returns records, averages of paths, or statistics."""

SCENES = (
    "linear",
    "elastic-half-sigma",
    "elastic-unequal-gaps",
    "elastic-upper-stop",
    "elastic-load",
    "lossy-0.5",
    "lossy-unequal-gaps",
    "elastic-bench-12-hz",
)
"""Scenes of the zoo that are judged by default: cheap ones, each of which shows some mistake."""

SURELY_SEEN = 100.0
"""Expected number of impacts from which on a sample without any impact disagrees, because scatter
does not explain it."""

NOT_FINITE = "not finite"
"""Verdict on a quantity that is NaN or infinite."""

TOO_UNCERTAIN = "too uncertain to judge"
"""Verdict on a quantity that agrees, but whose relative standard error is `RARE` or more, or which
would miss an error that must be found."""

POWER = 0.95
"""Probability with which an error that must be found is found."""


class Limits(TypedDict, total=False):
    """The errors that are harmless, and those that must be found, in per cent."""

    allowed_percent: float
    finds_percent: float | None


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One quantity of one scene, compared with the known answer.

    `bias_percent` is the difference in per cent of the truth (for a mean, of the standard
    deviation). `bias_error_percent` is its standard error. `visible_percent` is the smallest
    difference that counts as a disagreement. They are None where the integrator's number is not
    finite.

    See Also
    --------
    stochvi.testing.judge : The calculation.
    """

    scene: str
    quantity: str
    unit: str
    truth: float
    truth_error: float
    known_by: str
    value: float | None
    standard_error: float | None
    bias_percent: float | None
    bias_error_percent: float | None
    visible_percent: float | None
    score: float | None
    verdict: str

    @property
    def found_percent(self) -> float:
        """The smallest error that is found with the probability `POWER`, in per cent."""
        if self.visible_percent is None or self.bias_error_percent is None:
            return math.inf
        return self.visible_percent + NormalDist().inv_cdf(POWER) * self.bias_error_percent


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Judgement(Result):
    """The verdict on an integrator.

    `findings` are all comparisons, `hints` the likely causes of disagreements, and `left_out` the
    quantities that were not returned. `allowed_percent` is the bias that the user finds harmless,
    `finds_percent` the error that must be found, and `read_as` says how a file was read.

    See Also
    --------
    stochvi.testing.judge : The calculation.
    """

    kind = "judge"
    in_document: ClassVar = {name: name for name in ("passed", "summary", "family_alarm_rate")}
    family_alarm_rate: ClassVar[float] = FAMILY_ALARM_RATE

    not_in_document = COMMON

    hints: Sequence[str]
    left_out: Sequence[str]
    z: float
    allowed_percent: float
    findings: Sequence[Finding]
    finds_percent: float | None = None
    read_as: str = ""

    @property
    def passed(self) -> bool:
        """Whether something was compared, nothing disagrees, and no error that must be found would
        be missed."""
        verdicts = {row.verdict for row in self.findings}
        return AGREES in verdicts and verdicts <= {AGREES, TOO_RARE}

    @property
    def failures(self) -> list[Finding]:
        """The findings that disagree or are not finite."""
        return [row for row in self.findings if row.verdict in (DISAGREES, NOT_FINITE)]

    @property
    def uncertain(self) -> list[Finding]:
        """The findings with errors so large that they agree with anything, which is no pass."""
        return [row for row in self.findings if row.verdict == TOO_UNCERTAIN]

    def assert_passed(self) -> None:
        """Raise an AssertionError with the whole verdict, unless `passed`."""
        if not self.passed:
            raise AssertionError(str(self))

    def summary(self) -> str:
        """The verdict in a sentence."""
        compared = [row for row in self.findings if row.verdict not in (TOO_RARE, TOO_UNCERTAIN)]
        if not self.failures and (wide := self.uncertain):
            worst = max(wide, key=lambda row: row.bias_error_percent or 0.0)
            known, more = f"is known to {worst.bias_error_percent:.2g} %", ""
            if self.finds_percent is not None:
                known = f"would miss an error of {self.finds_percent:g} %"
                lacks = worst.found_percent - self.allowed_percent
                longer = (lacks / (self.finds_percent - self.allowed_percent)) ** 2
                more = f" by a factor of {longer:.2g}" if longer > 1.0 else ""
            return (
                f"{len(wide)} of {len(self.findings)} quantities are too uncertain to judge: "
                f"{worst.quantity} of {worst.scene} {known}; raise paths or relaxations{more}"
            )
        if not compared:
            return "nothing could be compared"
        count = len({row.scene for row in compared})
        scenes = f"{count} scene{'s' if count > 1 else ''}"
        if not self.failures:
            seen = sorted(row.visible_percent or 0.0 for row in compared)
            return (
                f"{len(compared)} quantities of {scenes} agree; a bias of "
                f"{seen[len(seen) // 2]:.2g} % would have been seen in half of them, of "
                f"{seen[-1]:.2g} % in all"
            )
        worst = max(self.failures, key=lambda row: abs(row.bias_percent or math.inf))
        bias = "not finite" if worst.bias_percent is None else f"{worst.bias_percent:+.2g} %"
        return (
            f"{len(self.failures)} of {len(compared)} quantities DISAGREE in "
            f"{len({row.scene for row in self.failures})} of {scenes}; worst: "
            f"{worst.quantity} of {worst.scene}, {bias}"
        )

    def __repr__(self) -> str:
        lines = [f"<judgement: {self.summary()}"]
        lines += [f"  {_in_words(row)}" for row in self.failures]
        lines += [f"  {_in_words(row)}, {TOO_UNCERTAIN}" for row in self.uncertain]
        lines += [f"  looks like: {hint}" for hint in self.hints]
        lines += [f"  left out: {reason}" for reason in self.left_out]
        return "\n".join(lines) + ">"

    def _remarks(self) -> Sequence[str]:
        return [*(f"looks like: {hint}" for hint in self.hints), *self.warnings]

    def _shown(self) -> DataFrame:
        return self.to_frame()  # a finding has a truth beside its value

    def to_frame(self) -> DataFrame:
        """One row per finding."""
        return frame_of(self.findings)


def _in_words(row: Finding) -> str:
    if row.value is None or row.standard_error is None:
        return f"{row.scene}: {row.quantity} is not finite, should be {row.truth:.6g} {row.unit}"
    assert row.bias_percent is not None and row.bias_error_percent is not None
    bias = format_with_error(row.bias_percent, row.bias_error_percent)
    return (
        f"{row.scene}: {row.quantity} {format_with_error(row.value, row.standard_error)} "
        f"{row.unit}, should be {row.truth:.6g} ({row.known_by}): {bias} % off"
    )


@calculation
def judge(
    integrator: Integrator,
    scenes: Mapping[str, Scene] | Iterable[str] = SCENES,
    *,
    paths: int = PATHS,
    relaxations: float = RELAXATIONS,
    seed: int = 0,
    rng: Random = None,
    allowed_percent: float = 0.0,
    finds_percent: float | None = None,
) -> Judgement:
    """Compare an integrator with the exact answers, quantity by quantity.

    Parameters
    ----------
    integrator
        `integrator(problem, seed)`, where `problem` holds the numbers of one scene (see
        `Problem`); it simulates `problem.paths` paths, leaves out `problem.burn_in` and counts
        `problem.duration` seconds. It returns a dict in one of three forms.

        Records: `displacement` and `velocity`, (paths, samples) at equal times, and
        `impact_speed`, either of the same shape (0 where there was no impact) or one list of
        speeds per path. A single path (samples,) is cut into batches; its impacts are of the same
        shape, or a list together with `impact_time`.

        Averages, an array (paths,) each: `displacement_mean`, `displacement_mean_square`,
        `velocity_mean_square`, and per second `collision_rate` (of impacts faster than
        `problem.speed_threshold`), `impact_speed_rate` and `impact_speed_square_rate` (sums of w
        and w^2 over all impacts). A quantity whose averages are not returned is not judged.

        Statistics: the quantities with a finished `(value, standard error)`, or `Estimate`, whose
        stated bias is granted.

        Where there are several coordinates or impact pairs, each name begins with that of its
        owner and a point: `first.displacement_std`, `wall.collision_rate`.
    scenes
        Names of the zoo, or scenes of your own by name: linear structures with rigid stops or none
        under white noise or noise of a tabulated density, whose answer is known.
    paths, relaxations
        Number of paths, and their length in relaxation times of the oscillator.
    seed, rng
        Seed of the random numbers: the same seed gives the same digits. Or what draws one, a
        Generator of numpy.
    allowed_percent
        A bias that you find harmless, in per cent of each quantity.
    finds_percent
        An error of each quantity, in per cent, that must be found with a probability of 95 %: what
        would miss it does not pass, and the verdict says how many more paths it takes. Noise that
        is 2 % too strong moves a standard deviation by 1 %.

    Returns
    -------
    Judgement
        All comparisons share one alarm rate, `FAMILY_ALARM_RATE` (Sidak, Student's distribution by
        the number of paths). In a test: `assert judge(mine).passed`, or
        `judge(mine).assert_passed()`. A quantity with an error of 20 % or more is no pass, whatever
        it agrees with.

    Raises
    ------
    ValueError
        If an argument is out of range, or what was returned is none of the three forms.
    NotApplicable
        If a scene is no such structure, or no exact answer to it is known.

    See Also
    --------
    stochvi.testing.judge_file : The same of what a program has written.
    stochvi.testing.known_answers : The scenes to judge by.

    Examples
    --------
    >>> import numpy as np
    >>> def mine(problem, seed):  # semi-implicit Euler, overshoot mirrored
    ...     rng, h = np.random.default_rng(seed), 0.01 / problem.omega
    ...     x, v = np.zeros((2, problem.paths))
    ...     sums, begin = np.zeros((3, problem.paths)), int(problem.burn_in / h)
    ...     steps = int(problem.duration / h)
    ...     for step in range(begin + steps):
    ...         force = problem.load - problem.damping_rate * v - problem.omega**2 * x
    ...         v += h * force + np.sqrt(problem.intensity * h) * rng.standard_normal(len(x))
    ...         x += h * v
    ...         hit = (x < problem.lower) | (x > problem.upper)
    ...         stop = np.clip(x[hit], problem.lower, problem.upper)
    ...         x[hit], v[hit] = 2.0 * stop - x[hit], -v[hit]
    ...         if step >= begin:
    ...             sums += x, x**2, v**2
    ...     names = "displacement_mean", "displacement_mean_square", "velocity_mean_square"
    ...     return dict(zip(names, sums / steps))
    >>> judge(mine, ["elastic-half-sigma"], paths=64, relaxations=2.0).passed
    True
    """
    _check_limits(allowed_percent, finds_percent)
    check_options({"seed": seed})
    known = known_problems(scenes, paths=paths, relaxations=relaxations)
    seeds = seeds_of(seed, len(known))
    measured = [
        _measured(problem, truth, integrator(problem, own_seed))
        for (problem, truth), own_seed in zip(known, seeds, strict=True)
    ]
    return _judgement(measured, allowed_percent=allowed_percent, finds_percent=finds_percent)


def judge_returned(
    problem: Problem,
    truth: Response,
    returned: Mapping[str, Any],
    **limits: Unpack[Limits],
) -> Judgement:
    """Judge the answer to one problem, in one of the three forms that `judge` takes.

    Parameters
    ----------
    problem, truth
        The problem, with the paths and the duration that were simulated, and its known answer.
    returned
        Records, averages of each path, or statistics.
    limits
        `allowed_percent` and `finds_percent`, as `judge` takes them.
    """
    _check_limits(**limits)
    return _judgement([_measured(problem, truth, returned)], **limits)


def _check_limits(allowed_percent: float = 0.0, finds_percent: float | None = None) -> None:
    """Raise a ValueError for limits of the judge that make no sense."""
    if not 0.0 <= allowed_percent < 100.0:
        raise ValueError(f"allowed_percent must be in [0, 100), got {allowed_percent}")
    if finds_percent is not None and not allowed_percent < finds_percent < math.inf:
        raise ValueError(
            f"finds_percent must be above allowed_percent ({allowed_percent:g}), "
            f"got {finds_percent:g}"
        )


def _measured(problem: Problem, truth: Response, returned: Mapping[str, Any]) -> Measured:
    if isinstance(returned, Mapping):
        returned = {plain_name(problem, str(name)): each for name, each in returned.items()}
    return Measured(problem, sample_of(problem, returned), truths_of(problem, truth))


def _judgement(
    measured: Sequence[Measured], allowed_percent: float = 0.0, finds_percent: float | None = None
) -> Judgement:
    """The verdict on all samples together, under one alarm rate."""
    pairs = [
        (each, name) for each in measured for name in each.truths if name in each.sample.names()
    ]
    left_out: list[str] = []
    for each in measured:
        missing = [name for name in each.truths if name not in each.sample.names()]
        if missing:
            words = ", ".join(_missing(name, each.sample) for name in missing)
            left_out.append(f"{each.problem.name}: {words} not returned")
        # without stops an integrator may still return its numbers of impacts, which are zero
        unknown = [
            name
            for name in each.sample.names()
            if name not in each.truths and not (each.problem.free and split(name)[1] in IMPACTS)
        ]
        if unknown:
            left_out.append(f"{each.problem.name}: no answer is known for {', '.join(unknown)}")
    rate = single_alarm_rate(max(len(pairs), 1))
    findings = [_finding(each, name, rate, allowed_percent / 100.0) for each, name in pairs]
    if finds_percent is not None:
        findings = [_required(row, finds_percent) for row in findings]
    failed = any(row.verdict in (DISAGREES, NOT_FINITE) for row in findings)
    return Judgement(
        findings=tuple(findings),
        hints=tuple(hints_of(measured)) if failed else (),
        left_out=tuple(left_out),
        z=student_quantile(rate, math.inf),
        allowed_percent=allowed_percent,
        finds_percent=finds_percent,
    )


def _required(row: Finding, finds_percent: float) -> Finding:
    """A finding that passes only where an error of that size would be found."""
    if row.verdict in (DISAGREES, NOT_FINITE):
        return row
    sharp = row.verdict == AGREES and row.found_percent <= finds_percent
    return replace(row, verdict=AGREES if sharp else TOO_UNCERTAIN)


def _missing(name: str, sample: Sample) -> str:
    """The name of a quantity that was not returned, with the averages that it still needs if some
    were returned."""
    lacking = [each for each in needs(name) if each not in sample.parts()]
    if 0 < len(lacking) < len(needs(name)):
        return f"{name} (which needs {', '.join(lacking)} too)"
    return name


def _finding(judged: Measured, name: str, alarm_rate: float, allowed: float) -> Finding:
    problem, sample, truth = judged.problem, judged.sample, judged.truths[name]
    value, error = sample.evaluate(lambda quantities: quantities[name])
    row: dict[str, Any] = {
        "scene": problem.name,
        "quantity": name,
        "unit": RESPONSE_QUANTITIES[split(name)[1]].unit,
        "truth": truth.value,
        "truth_error": truth.bias or 0.0,
        "known_by": truth.how.split(",")[0],
    }
    if not (math.isfinite(value) and math.isfinite(error)):
        return Finding(
            **row, value=None, standard_error=None, bias_percent=None, bias_error_percent=None,
            visible_percent=None, score=None, verdict=NOT_FINITE,
        )  # fmt: skip
    size = size_of(judged.truths, name)
    difference = value - truth.value
    stated = sample.bias(name)
    granted = (truth.bias or 0.0) + stated + allowed * size
    tolerance = student_quantile(alarm_rate, sample.degrees) * error + granted
    beyond = math.copysign(max(abs(difference) - granted, 0.0), difference)
    verdict = AGREES if abs(difference) <= tolerance else DISAGREES
    if _too_rare(problem, split(name)[1], value, error, truth.value):
        verdict = TOO_RARE
    elif verdict == AGREES and error + stated >= RARE * size:
        verdict = TOO_UNCERTAIN
    return Finding(
        **row,
        value=value,
        standard_error=error,
        bias_percent=100.0 * difference / size,
        bias_error_percent=100.0 * error / size,
        visible_percent=100.0 * tolerance / size,
        score=normal_score(beyond, error, sample.degrees),
        verdict=verdict,
    )


def _too_rare(problem: Problem, quantity: str, value: float, error: float, truth: float) -> bool:
    """Whether so few impacts were seen that the standard error cannot be trusted."""
    if quantity not in IMPACTS:
        return False
    if value == 0.0:
        if not problem.white_oscillator:
            return False
        # a sum of w^k over n impacts is about n times the k-th power of a typical speed
        speed = problem.speed_scale
        expected = truth / speed ** IMPACTS.index(quantity) * problem.duration * problem.paths
        return expected < SURELY_SEEN
    return error >= RARE * abs(value)


def as_response(problem: Problem, returned: Mapping[str, Any], method: str = "") -> Response:
    """The numbers that an integrator returned, as a `Response` for comparisons and tables.

    Parameters
    ----------
    problem
        The problem that was integrated.
    returned
        What the integrator returned.
    method
        Name of the integrator.

    Returns
    -------
    Response
        Moments, rates and their errors, SI units.

    See Also
    --------
    stochvi.testing.assert_agrees : Compares it with a known answer.

    Examples
    --------
    >>> from stochvi.verification.check import zoo
    >>> from stochvi.verification.testing.problems import problem_of
    >>> problem = problem_of(zoo("linear")["linear"], name="linear")
    >>> as_response(problem, {"velocity_std": (1.02, 0.01)}, "mine")
    <mine
      x.velocity_std = 1.020(10) m/s>
    """
    sample = sample_of(problem, returned)
    coordinates: dict[str, dict[str, Estimate]] = {each: {} for each in problem.model.coordinates}
    impacts: dict[str, dict[str, Estimate]] = {each.name: {} for each in problem.model.pairs}
    for full in sample.names():
        owner, name = split(full)
        owners: Mapping[str, dict[str, Estimate]] = impacts if name in IMPACTS else coordinates
        value, error = sample.evaluate(lambda values, full=full: values[full])  # type: ignore[misc]
        for place in [owner.removesuffix(".")] if owner else list(owners):
            owners[place][name] = Estimate(
                value=value, standard_error=error, how="returned by an integrator"
            )
    count = 0 if math.isinf(sample.degrees) else round(sample.degrees) + 1
    return Response(
        method=method or "integrator",
        coordinates={name: CoordinateResponse(**each) for name, each in coordinates.items()},
        impact_pairs={
            name: PairResponse(**each, speed_threshold=problem.speed_threshold)
            for name, each in impacts.items()
        },
        effects=problem.scene.effects(),
        cost=Cost(paths=count),
    )
