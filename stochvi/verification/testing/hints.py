"""Likely causes of a pattern of disagreements, from the balances that any right answer obeys.

Symbols: S0 the intensity, b the damping rate, F1 and F2 the sums of impact speeds and of their
squares per second. One oscillator between stops at -D and D of the restitution R obeys

    energy   S0 = 2 b E v^2 + (1 - R^2) F2,
    virial   E v^2 = omega^2 E x^2 + (1 + R) D F1.

Solved for a parameter they give the restitution, clearance, damping or intensity that an integrator
in fact simulated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.results.estimates import Estimate, format_with_error
from stochvi.verification.testing.fault_models import suspects_of
from stochvi.verification.testing.problems import Problem
from stochvi.verification.testing.samples import IMPACTS, Function, Sample, Values, split

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
    stationary = solve_continuous_lyapunov(states, -noise)
    lacking = solve_continuous_lyapunov(states, -stationary) / problem.duration
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
        if ratio > 1.0 and own.omega > 0.0:
            step = own.damping_rate / own.omega**2 * (1.0 - 1.0 / ratio)
            hint += (
                f"; explicit Euler, which takes omega^2 h from the damping rate, does this at "
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
