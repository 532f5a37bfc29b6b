"""Likely causes of a pattern of disagreements, from the balances that any right answer obeys.

With intensity S0, b the damping rate and F1, F2 the sums of impact speeds and of their squares per
second, one oscillator between stops at -D and D of the restitution R obeys

    energy   S0 = 2 b E v^2 + (1 - R^2) F2,
    virial   E v^2 = omega^2 E x^2 + (1 + R) D F1.

Solved for a parameter they give the restitution, clearance, damping or intensity that an integrator
in fact simulated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from stochvi.results.estimates import format_with_error
from stochvi.verification.testing.problems import Problem
from stochvi.verification.testing.samples import Function, Sample, Values

SURE = 4.0
"""Standard errors from which a deviation is reported as a hint."""

NEAR = 0.04
"""Relative distance from a number that has a known cause (a half, 2, R^2) to name that cause."""

STOPS = ("velocity_std", "impact_speed_rate", "impact_speed_square_rate")


@dataclass(frozen=True)
class Measured:
    """A problem with the sample that an integrator returned for it."""

    problem: Problem
    sample: Sample

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

    @property
    def free(self) -> bool:
        """Whether the problem has no stops."""
        return math.isinf(self.problem.lower) and math.isinf(self.problem.upper)

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
    flights = list(_flight(sound))
    yield from flights
    if not flights:
        yield from _elastic_stops(sound)
        yield from _lossy_stops(sound)
    yield from _clearance(sound)


def _flight(measured: Sequence[Measured]) -> Iterator[str]:
    """Hints on noise, damping and the scheme, from problems without stops."""
    for each in measured:
        if not each.free or not each.has("velocity_std"):
            continue
        own = each.problem
        ratio, error = each.sample.evaluate(
            lambda values, own=own: (values["velocity_std"] / own.speed_scale) ** 2  # type: ignore[misc]
        )
        if abs(ratio - 1.0) <= SURE * error:
            continue
        hint = f"without stops E v^2 is {format_with_error(ratio, error)} times the truth"
        for telling, noise, damping in (
            (2.0, "noise twice too strong (a one-sided density for S0)", "half the damping"),
            (0.5, "half the noise (S0 taken for a one-sided density)", "twice the damping"),
        ):
            if abs(ratio / telling - 1.0) < NEAR + SURE * error:
                which = _noise_or_damping(measured, telling)
                cause = {"noise": noise, "damping": damping}.get(which, f"{noise}, or {damping}")
                hint += f": {cause}"
        if ratio > 1.0 and own.omega > 0.0:
            step = own.damping_rate / own.omega**2 * (1.0 - 1.0 / ratio)
            hint += (
                f"; explicit Euler, which takes omega^2 h from the damping rate, does this at "
                f"h = {step:.2g} s"
            )
        yield hint
        return


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
    """The share of its energy that an impact loses, (S0 - 2 b E v^2) / F2, as a function."""

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
        "impacts are taken at the end of the step (mirror the overshoot of a semi-implicit step, "
        f"x = c - R (x - c), or end the step at the stop), or the restitution is not 1{also}"
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
