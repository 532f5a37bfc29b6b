"""`judge`: whether an integrator finds the known answers, and where it does not."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stochvi.model.calculations import calculation
from stochvi.results.base import COMMON, Result
from stochvi.results.estimates import Cost, Estimate, format_with_error
from stochvi.results.intervals import normal_score, student_quantile
from stochvi.results.quantity_units import QUANTITY_UNITS
from stochvi.results.response import CoordinateResponse, PairResponse, Response
from stochvi.sampling.options import check_options
from stochvi.scenes.scene import Scene
from stochvi.verification.check import (
    AGREES,
    DISAGREES,
    FAMILY_ALARM_RATE,
    RARE,
    TOO_RARE,
    single_alarm_rate,
)
from stochvi.verification.check_of_many import seeds_of
from stochvi.verification.testing.hints import Measured, hints_of
from stochvi.verification.testing.problems import Problem
from stochvi.verification.testing.reference_values import (
    PATHS,
    RELAXATIONS,
    known_problems,
    size_of,
    truths_of,
)
from stochvi.verification.testing.samples import (
    IMPACTS,
    Sample,
    needs,
    plain_name,
    sample_of,
    split,
)

if TYPE_CHECKING:
    import pandas as pd

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
"""Verdict on a quantity that agrees, but whose relative standard error is `RARE` or more."""


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


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Judgement(Result):
    """The verdict on an integrator.

    `findings` are all comparisons, `hints` the likely causes of disagreements, and `left_out` the
    quantities that were not returned. `allowed_percent` is the bias that the user finds harmless,
    and `read_as` says how a file was read.

    See Also
    --------
    stochvi.testing.judge : The calculation.
    """

    not_in_document = COMMON

    hints: Sequence[str]
    left_out: Sequence[str]
    z: float
    allowed_percent: float
    findings: Sequence[Finding]
    read_as: str = ""

    @property
    def passed(self) -> bool:
        """Whether something was compared, and nothing disagrees."""
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
            return (
                f"{len(wide)} of {len(self.findings)} quantities are too uncertain to judge: "
                f"{worst.quantity} of {worst.scene} is known to {worst.bias_error_percent:.2g} %; "
                "raise paths or relaxations"
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

    def to_frame(self) -> pd.DataFrame:
        """One row per finding."""
        import pandas as pd

        return pd.DataFrame([vars(row) for row in self.findings])

    def _document(self) -> dict[str, Any]:
        return {
            "method": "judge",
            "passed": self.passed,
            "summary": self.summary(),
            "family_alarm_rate": FAMILY_ALARM_RATE,
            **super()._document(),
        }


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
    allowed_percent: float = 0.0,
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
    seed
        Seed of the random numbers: the same seed gives the same digits.
    allowed_percent
        A bias that you find harmless, in per cent of each quantity.

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
    _check_allowed(allowed_percent)
    check_options({"seed": seed})
    known = known_problems(scenes, paths=paths, relaxations=relaxations)
    seeds = seeds_of(seed, len(known))
    measured = [
        _measured(problem, truth, integrator(problem, own_seed))
        for (problem, truth), own_seed in zip(known, seeds, strict=True)
    ]
    return _judgement(measured, allowed_percent)


def judge_returned(
    problem: Problem,
    truth: Response,
    returned: Mapping[str, Any],
    *,
    allowed_percent: float = 0.0,
) -> Judgement:
    """Judge the answer to one problem, in one of the three forms that `judge` takes.

    Parameters
    ----------
    problem, truth
        The problem, with the paths and the duration that were simulated, and its known answer.
    returned
        Records, averages of each path, or statistics.
    allowed_percent
        A bias that is harmless, in per cent of each quantity.
    """
    _check_allowed(allowed_percent)
    return _judgement([_measured(problem, truth, returned)], allowed_percent)


def _check_allowed(allowed_percent: float) -> None:
    if not 0.0 <= allowed_percent < 100.0:
        raise ValueError(f"allowed_percent must be in [0, 100), got {allowed_percent}")


def _measured(problem: Problem, truth: Response, returned: Mapping[str, Any]) -> Measured:
    if isinstance(returned, Mapping):
        returned = {plain_name(problem, str(name)): each for name, each in returned.items()}
    return Measured(problem, sample_of(problem, returned), truths_of(problem, truth))


def _judgement(measured: Sequence[Measured], allowed_percent: float) -> Judgement:
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
    failed = any(row.verdict in (DISAGREES, NOT_FINITE) for row in findings)
    return Judgement(
        findings=tuple(findings),
        hints=tuple(hints_of(measured)) if failed else (),
        left_out=tuple(left_out),
        z=student_quantile(rate, math.inf),
        allowed_percent=allowed_percent,
    )


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
        "unit": QUANTITY_UNITS[split(name)[1]],
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
    >>> from stochvi.verification.check_of_many import zoo
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
