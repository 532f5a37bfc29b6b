"""`judge`: whether an integrator finds the known answers, and where it does not."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from stochvi.methods.closed_form import exact
from stochvi.methods.fokker_planck import fokker_planck
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.simulate import check_arguments
from stochvi.model.model import model_of
from stochvi.results.base import COMMON, Result
from stochvi.results.errors import NoExactSolution
from stochvi.results.estimates import Cost, Estimate, format_with_error
from stochvi.results.intervals import normal_score, student_quantile
from stochvi.results.response import QUANTITY_UNITS, CoordinateResponse, PairResponse, Response
from stochvi.scenes.scene import Scene
from stochvi.verification.check import (
    AGREES,
    DISAGREES,
    FAMILY_ALARM_RATE,
    RARE,
    TOO_RARE,
    single_alarm_rate,
)
from stochvi.verification.checks import seeds_of, zoo
from stochvi.verification.testing.answers import known_answers
from stochvi.verification.testing.hints import Measured, hints_of
from stochvi.verification.testing.problems import Problem, problem_of
from stochvi.verification.testing.samples import QUANTITIES, Sample, sample_of

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
"""Number of expected impacts from which it is a disagreement, and not chance, that none is seen."""

NOT_FINITE = "not finite"
"""Verdict on a quantity that is NaN or infinite."""

TOO_UNCERTAIN = "too uncertain to judge"
"""Verdict on a quantity that agrees, but whose relative standard error is `RARE` or more."""

IMPACTS = ("collision_rate", "impact_speed_rate", "impact_speed_square_rate")
"""Quantities of impacts: sums of w^0, w^1 and w^2 per second, w the impact speed."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One quantity of one scene, compared with the known answer.

    `bias_percent` is the difference in per cent of the truth (for a mean, of the standard
    deviation), `bias_error_percent` its standard error, and `visible_percent` the smallest
    difference that counts as a disagreement. They are None where the integrator's number is not
    finite.
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


@dataclass(frozen=True, kw_only=True, repr=False)
class Judgement(Result):
    """The verdict on an integrator.

    `findings` are all comparisons, `hints` the likely causes of disagreements, and `left_out` the
    quantities that were not returned. `allowed_percent` is the bias that the user finds harmless.
    """

    not_in_document = COMMON

    hints: Sequence[str]
    left_out: Sequence[str]
    z: float
    allowed_percent: float
    findings: Sequence[Finding]

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
        scenes = len({row.scene for row in compared})
        if not self.failures:
            seen = sorted(row.visible_percent or 0.0 for row in compared)
            return (
                f"{len(compared)} quantities of {scenes} scenes agree; a bias of "
                f"{seen[len(seen) // 2]:.2g} % would have been seen in half of them, of "
                f"{seen[-1]:.2g} % in all"
            )
        worst = max(self.failures, key=lambda row: abs(row.bias_percent or math.inf))
        bias = "not finite" if worst.bias_percent is None else f"{worst.bias_percent:+.2g} %"
        return (
            f"{len(self.failures)} of {len(compared)} quantities DISAGREE in "
            f"{len({row.scene for row in self.failures})} of {scenes} scenes; worst: "
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


def judge(
    integrator: Integrator,
    scenes: Mapping[str, Scene] | Iterable[str] = SCENES,
    *,
    paths: int = 1024,
    relaxations: float = 20.0,
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
        and w^2 over all impacts). What is not there is not judged.

        Statistics: the quantities with a finished `(value, standard error)`.
    scenes
        Names of the zoo, or scenes of your own by name: single oscillators under white noise with
        rigid stops or none.
    paths, relaxations
        How many paths, and of how many relaxation times of the oscillator.
    allowed_percent
        A bias that you find harmless, in per cent of each quantity.

    Returns
    -------
    Judgement
        All comparisons share one alarm rate, `FAMILY_ALARM_RATE` (Sidak, Student's law by the
        number of paths). In a test: `assert judge(mine).passed`, or `judge(mine).assert_passed()`.
        A quantity with an error of 20 % or more is no pass, whatever it agrees with.

    Raises
    ------
    ValueError
        If an argument is out of range, or what was returned is none of the three forms.
    NotApplicable
        If a scene is no single oscillator under white noise with rigid stops or none.

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
    if not 0.0 <= allowed_percent < 100.0:
        raise ValueError(f"allowed_percent must be in [0, 100), got {allowed_percent}")
    check_arguments(None, None, None, seed, None, None, None)
    known = _known(scenes, paths, relaxations)
    seeds = seeds_of(seed, len(known))
    measured: list[tuple[Measured, Response]] = []
    left_out: list[str] = []
    for (problem, truth), own_seed in zip(known, seeds, strict=True):
        sample = sample_of(problem, integrator(problem, own_seed))
        measured.append((Measured(problem, sample), truth))
    pairs = [
        (each, quantity, truth)
        for each, response in measured
        for quantity, truth in _truths(response).items()
        if quantity in each.sample.names()
    ]
    for each, response in measured:
        missing = [name for name in _truths(response) if name not in each.sample.names()]
        if missing:
            left_out.append(f"{each.problem.name}: {', '.join(missing)} not returned")
    rate = single_alarm_rate(max(len(pairs), 1))
    findings = [
        _finding(each.problem, each.sample, quantity, truth, rate, allowed_percent / 100.0)
        for each, quantity, truth in pairs
    ]
    failed = any(row.verdict in (DISAGREES, NOT_FINITE) for row in findings)
    return Judgement(
        findings=tuple(findings),
        hints=tuple(hints_of([each for each, _ in measured])) if failed else (),
        left_out=tuple(left_out),
        z=student_quantile(rate, math.inf),
        allowed_percent=allowed_percent,
    )


def _known(
    scenes: Mapping[str, Scene] | Iterable[str], paths: int, relaxations: float
) -> list[tuple[Problem, Response]]:
    """The problem of each scene with the most certain answer to it.

    All problems are made before any is solved, so that a scene that is not allowed fails at once.
    """
    if isinstance(scenes, str):
        raise ValueError(f"scenes must be a list of names, got the one name {scenes!r}")
    named = dict(scenes) if isinstance(scenes, Mapping) else _of_the_zoo(tuple(scenes))
    problems = [
        problem_of(scene, name=name, paths=paths, relaxations=relaxations)
        for name, scene in named.items()
    ]
    if isinstance(scenes, Mapping):
        answers = {name: _solved(scene) for name, scene in scenes.items()}
    else:
        answers = known_answers(*named) if named else {}
    return [
        (replace(each, speed_threshold=_threshold(answers[name])), answers[name])
        for name, each in zip(named, problems, strict=True)
    ]


def _of_the_zoo(names: tuple[str, ...]) -> dict[str, Scene]:
    """Scenes of the zoo by name; an empty dictionary where no name is given."""
    return zoo(*names) if names else {}


def _solved(scene: Scene) -> Response:
    try:
        return exact(scene)
    except NoExactSolution:
        thresholds = make_plan(model_of(scene)).layout.thresholds
        return fokker_planck(scene, speed_threshold=next(iter(thresholds.values()), None))


def _threshold(truth: Response) -> float:
    for pair in truth.impact_pairs.values():
        if isinstance(threshold := pair["speed_threshold"], float):
            return threshold
    return 0.0


def _truths(response: Response) -> dict[str, Estimate]:
    """The known quantities of the oscillator and its stops whose error is stated."""
    known = {quantity: truth for (_, quantity), truth in response.estimates().items()}
    return {
        name: known[name] for name in QUANTITIES if name in known and known[name].bias is not None
    }


def _finding(
    problem: Problem,
    sample: Sample,
    quantity: str,
    truth: Estimate,
    alarm_rate: float,
    allowed: float,
) -> Finding:
    value, error = sample.evaluate(lambda quantities: quantities[quantity])
    row: dict[str, Any] = {
        "scene": problem.name,
        "quantity": quantity,
        "unit": QUANTITY_UNITS[quantity],
        "truth": truth.value,
        "truth_error": truth.bias or 0.0,
        "known_by": truth.how.split(",")[0],
    }
    if not (math.isfinite(value) and math.isfinite(error)):
        return Finding(
            **row, value=None, standard_error=None, bias_percent=None, bias_error_percent=None,
            visible_percent=None, score=None, verdict=NOT_FINITE,
        )  # fmt: skip
    size = abs(truth.value)
    if quantity == "displacement_mean":
        size = sample.evaluate(lambda quantities: quantities["displacement_std"])[0] or 1.0
    difference = value - truth.value
    granted = (truth.bias or 0.0) + allowed * size
    tolerance = student_quantile(alarm_rate, sample.degrees) * error + granted
    beyond = math.copysign(max(abs(difference) - granted, 0.0), difference)
    verdict = AGREES if abs(difference) <= tolerance else DISAGREES
    if _too_rare(problem, quantity, value, error, truth.value):
        verdict = TOO_RARE
    elif verdict == AGREES and error >= RARE * size:
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
        # a sum of w^k over n impacts is about n times the k-th power of a typical speed
        speed = problem.speed_scale
        expected = truth / speed ** IMPACTS.index(quantity) * problem.duration * problem.paths
        return expected < SURELY_SEEN
    return error >= RARE * abs(value)


def as_response(problem: Problem, returned: Mapping[str, Any], method: str = "") -> Response:
    """The numbers that an integrator returned, as a `Response` for comparisons and tables.

    Examples
    --------
    >>> problem = problem_of(zoo("linear")["linear"], name="linear")
    >>> as_response(problem, {"velocity_std": (1.02, 0.01)}, "mine")
    <mine
      x.velocity_std = 1.020(10) m/s>
    """
    sample = sample_of(problem, returned)
    found: dict[str, Estimate] = {}
    for name in sample.names():
        value, error = sample.evaluate(lambda values, name=name: values[name])  # type: ignore[misc]
        found[name] = Estimate(value=value, standard_error=error, how="returned by an integrator")
    count = 0 if math.isinf(sample.degrees) else round(sample.degrees) + 1
    impacts = {name: found.pop(name) for name in IMPACTS if name in found}
    pair = PairResponse(**impacts, speed_threshold=problem.speed_threshold)
    return Response(
        method=method or "integrator",
        coordinates={"x": CoordinateResponse(**found)},
        impact_pairs={each.name: pair for each in problem.scene.impact_pairs},
        effects=problem.scene.effects(),
        cost=Cost(paths=count),
    )
