"""A scene answered again and again. Chapters: ranges of keys; several records of one phase; units
of a production."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import json
import math
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from stochvi.isolators.production_risk import Units
from stochvi.isolators.tolerances import Spread, check_spreads, spreads_of
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.units import MEASURED, measured_in, plain_number
from stochvi.model.model import model_of
from stochvi.notices import InputWarning, OutputWarning
from stochvi.results.base import DataFrame, Response, Result, frame_of, plain
from stochvi.results.deadline import Progress
from stochvi.results.errors import (
    CheckpointError,
    Interrupted,
    NotApplicable,
    NotConverged,
    reason_of,
)
from stochvi.results.estimates import (
    BIAS,
    BIAS_ERROR,
    CONFIDENCE,
    ERROR,
    LIMIT,
    Cost,
    Estimate,
    logarithmic_interval,
    provenance,
    student_quantile,
)
from stochvi.results.files import named_files
from stochvi.sampling.calculations import BUDGET, RunOptions, calculation
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.excitations import RecordedNoise
from stochvi.scenes.keys import (
    Change,
    changed_scene,
    holder_of,
    is_place,
    key_unit,
    unknown_key,
    written_key,
)
from stochvi.scenes.scene import Scene, load_scene
from stochvi.scenes.validation import BetweenUnits
from stochvi.statistics.crossings import own_distances
from stochvi.views.files import folder_in, to_json, write_text

if TYPE_CHECKING:
    pass


# ------------------------------------------------------------------------------
# Sweeps: one method answers for a scene at every combination of values of some of its keys.
#
# Each combination is a row of a table. A row is written to the disk as soon as it is complete, so
# that a sweep that was stopped goes on where it was.
# ------------------------------------------------------------------------------


METHODS = {
    "simulate": "methods.monte_carlo:simulate", "exact": "methods.closed_form:exact",
    "closure": "methods.linearisation:linearise", "linearise": "methods.linearisation:linearise",
    "fokker-planck": "methods.fokker_planck:fokker_planck", "average": "methods.averaging:average",
    "size": "isolators:size", "reliability": "statistics.reliability:reliability",
    "replay": "methods.replay:replay",
}  # fmt: skip
"""Methods that can answer for a row, with the calculation of each, "room:name", which is imported
when it is asked; "closure" is "linearise" with its form "closure"."""

THRESHOLD, WITH_THRESHOLD = "speed_threshold", ("simulate", "fokker-planck")
"""Argument that may be varied as a key is, the slowest impact that rates count (m/s), and the
methods that have it."""

MOST_ROWS = 10_000
"""Largest number of rows of a sweep, whose table takes some 10 kB for each row while it grows."""


@calculation
def sweep(
    scene: Scene | str | Path,
    vary: Mapping[str, Sequence[float]] | DataFrame,
    *,
    method: str = "simulate",
    out: str | Path | None = None,
    common: bool = True,
    progress: Progress | None = None,
    **arguments: Any,
) -> DataFrame:
    """Answer for each combination of values of some keys of a scene: one row for each scene.

    The first columns are the keys. Each quantity has a column with its value in SI units, as
    "stops.collision_rate". Beside it stand ".standard_error", ".bias" and ".bias_error", as an
    `Estimate` has them. ".upper_95" is the upper 95 % limit where a row saw no such event. Each
    impact pair has "stops.speed_threshold", the slowest impact that its rates count, m/s, which may
    differ between rows. The last columns are the method, the seed, the number of paths, and the
    seconds that the row took. "note" says why a row holds no answer, or not the accuracy wanted,
    and where a record is not the noise for which the row holds.

    Parameters
    ----------
    scene
        The scene.
    vary
        The values of each key of the scene file, of which all combinations are taken; or a table of
        samples, a column for each key and a row for each scene. In a key a number counts the
        entries of a list. "speed_threshold" may be among them for "simulate" and "fokker-planck":
        rates of impacts faster than each of its values (m/s) then stand side by side.
    method
        One of `METHODS`. "linearise" takes a `form` and a `variant`; "size" gives the clearance, 3
        sigma and the expected impacts, "reliability" probabilities of events and expected impacts
        of a mission, "replay" what the record itself does.
    out
        Folder in which rows are kept. A row of the same scene, arguments and versions that is kept
        there is not computed again. A row that was being simulated goes on from its checkpoint. A
        damaged file leads to an InputWarning that names it, and its row is computed again.
    common
        Whether all rows use the same seed, so that rows differ by their scenes and not by their
        random numbers. Otherwise each row has a seed of its own, made of `seed` and its scene.
    progress
        Called now and then with the fraction done and a sentence on the accuracy reached.
    **arguments
        `RunOptions`: seed, threads, executor, budget, checkpoint and resume. The budget is that of
        each row, and N rows take up to N times as long; one checkpoint holds the samples of all
        rows, and is for a sweep without `out`. All others are passed to the method: rel_error,
        paths and duration for "simulate"; the target and mission for "size"; mission and limits for
        "reliability"; for "fokker-planck" a `speed_threshold`, which then is that of all rows.

    Returns
    -------
    DataFrame
        A row for each combination, or for each sample.

    Raises
    ------
    SceneError
        If the scene does not have a key. The message names the nearest key that the scene has;
        nothing has been computed then.
    ValueError
        If a value is not a number, a key has no values, a key is named twice, or the values have
        more combinations than `MOST_ROWS`.
    Interrupted
        After Ctrl-C; its `partial` is the table of the rows that are complete, which are kept in
        `out`.

    See Also
    --------
    stochvi.simulate : The same by Monte Carlo.
    stochvi.size : The clearance that is needed.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(upper=1.0, law=Restitution(coefficient=1.0))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> table = sweep(scene, {"impact_pair.0.upper": [0.5, 1.0, 2.0]}, method="exact")
    >>> table["stops.collision_rate"].round(4).tolist()
    [0.2031, 0.1147, 0.022]
    """
    loaded = scene if isinstance(scene, Scene) else load_scene(scene)
    document, grid = loaded.document(as_written=True), _grid(vary)
    check_method(method, arguments)
    _check_threshold([key for key, _ in grid[0]], method, arguments)
    for change in grid:  # a value that the scene refuses ends the sweep before its first row
        _changed(document, change)
    return rows_of(
        loaded, grid, partial(_changed, document), method=method, common=common,
        arguments=arguments, out=out, progress=progress,
    )  # fmt: skip


def _changed(document: Mapping[str, Any], change: Change) -> Scene:
    """The scene of a row; a threshold is no key of it."""
    return changed_scene(document, tuple(each for each in change if each[0] != THRESHOLD))


def _check_threshold(keys: Sequence[str], method: str, arguments: Mapping[str, Any]) -> None:
    """ValueError for a varied threshold of a method without one, or one that is given twice."""
    if THRESHOLD in keys and method not in WITH_THRESHOLD:
        raise ValueError(
            f"vary: {THRESHOLD} is for method {' or '.join(WITH_THRESHOLD)}, got {method!r}; leave "
            "it out"
        )
    if THRESHOLD in keys and THRESHOLD in arguments:
        raise ValueError(
            f"{THRESHOLD} must be varied or given once for all rows, got both; leave out one"
        )


def check_method(method: str, arguments: Mapping[str, Any]) -> None:
    """ValueError for a method that a row cannot have."""
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if method == "closure" and "form" in arguments:
        raise ValueError(
            f"form must be left out of method 'closure', got {arguments['form']!r}; for other "
            "forms take method='linearise'"
        )


def rows_of(
    scene: Scene, grid: Sequence[Change], made: Callable[[Change], Scene], *, method: str,
    common: bool, arguments: dict[str, Any], out: str | Path | None, progress: Progress | None,
) -> DataFrame:  # fmt: skip
    """The table of a sweep: a row for each change, of the scene that is made of it; see `sweep`."""
    known = RunOptions.__annotations__.keys() & arguments.keys()
    options = {name: arguments.pop(name) for name in known}
    if out is not None and str(out) == "":
        raise ValueError("out must name a folder, got ''")
    if out is not None and (own := sorted({"checkpoint", "resume"} & options.keys())):
        raise ValueError(f"give {own[0]} or out, not both: the folder out keeps all rows")
    budget = options.pop("budget", BUDGET if method in SAMPLING else None)
    found: DataFrame = _sweep(
        scene, grid, made, method=method, common=common, arguments=arguments, out=out,
        progress=progress,
        budget=None if budget is None else len(grid) * budget, **options,
    )  # fmt: skip
    found.attrs["keys"] = [key for key, _ in grid[0]] if grid else []
    return found


@sampled
def _sweep(
    scene: Scene, grid: Sequence[Change], made: Callable[[Change], Scene], *, method: str,
    common: bool, arguments: Mapping[str, Any], out: str | Path | None,
    **options: Unpack[RunOptions],
) -> DataFrame:  # fmt: skip
    """The table of a sweep."""
    run, number, rows = Run.of(options), len(grid), list[dict[str, Any]]()
    given = dict(arguments)
    each = None if options["budget"] is None else options["budget"] / number
    run.begin()
    folder = None if out is None else folder_in(Path(out), "rows")
    for done, change in enumerate(grid):
        where = f"after row {done} of {number}"
        if run.deadline.interrupted:
            raise run.deadline.fell_short(where, "", _table(rows))
        if each is not None:  # what a row took too long, the others have less
            given["budget"] = min(each, run.deadline.part(1.0 / (number - done)) or each)
        elif method in SAMPLING:
            given["budget"] = None
        of_row = given | {key: value for key, value in change if key == THRESHOLD}
        job = Job.of(made(change), change, method, common, run.seed, of_row)
        try:
            row = run.part(done / number, (done + 1) / number, f"row {done + 1} of {number}")
            rows.append(job.row(folder, row))
        except KeyboardInterrupt as reason:
            raise Interrupted(f"interrupted by Ctrl-C {where}", _table(rows)) from reason
    return _table(rows)


def _table(rows: Sequence[Mapping[str, Any]]) -> DataFrame:
    """The table of finished rows."""
    if not rows:
        return frame_of()
    return frame_of(rows).astype({"seed": "Int64", "paths": "Int64", "seconds": float})


def _grid(vary: Any) -> list[Change]:
    """The changes of each row: all combinations of the values of a mapping, the rows of a table."""
    together = hasattr(vary, "iloc")
    ranges = _ranges(vary)
    if together:
        _check_size({"samples": len(vary)})
        points: Iterable[tuple[float, ...]] = zip(*ranges.values(), strict=True)
    else:
        _check_size({key: len(values) for key, values in ranges.items()})
        points = itertools.product(*ranges.values())
    return [tuple(zip(ranges, point, strict=True)) for point in points]


def _check_size(numbers: Mapping[str, int]) -> None:
    """ValueError where there are more combinations of values than a sweep may have rows."""
    rows = math.prod(numbers.values())
    if rows > MOST_ROWS:
        of = " times ".join(f"{number} of {key}" for key, number in numbers.items())
        raise ValueError(
            f"vary: {of} are {rows} rows, and a sweep has at most {MOST_ROWS}; give fewer values"
        )


def _ranges(vary: Any) -> dict[str, list[float]]:
    """The keys as they are usually written, each with its values as plain Python numbers."""
    if not (isinstance(vary, Mapping) or hasattr(vary, "iloc")) or not len(vary.keys()):
        raise ValueError(f"vary must map at least one key of the scene to values, got {vary!r}")
    return dict(once([(written_key(key), _values(key, values)) for key, values in vary.items()]))


def once(ranges: Sequence[tuple[str, list[float]]]) -> Sequence[tuple[str, list[float]]]:
    """Return `ranges` unchanged; raise a ValueError if a key is named twice."""
    names = [key for key, _ in ranges]
    if repeated := [key for key in names if names.count(key) > 1]:
        raise ValueError(
            f"vary: {repeated[0]} is given twice; name a key once, with all of its values"
        )
    return ranges


def _values(key: str, values: Any) -> list[float]:
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise ValueError(f"vary: {key} must have a list of numbers, got {values!r}")
    found = [plain_number(value) for value in values]
    for value in found:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"vary: {key} must have a list of numbers, got {value!r} among them")
    if not found:
        raise ValueError(f"vary: {key} has no values; give at least one")
    return found


@dataclass(frozen=True, kw_only=True)
class Job:
    """The work for one row: its scene, the method and its arguments, and the name of its files."""

    scene: Scene
    change: Change
    method: str
    seed: int
    arguments: Mapping[str, Any]
    name: str

    @classmethod
    def of(
        cls, scene: Scene, change: Change, method: str, common: bool, seed: int,
        arguments: Mapping[str, Any],
    ) -> Job:  # fmt: skip
        """Make the job, named by a digest of scene, tables, arguments and versions."""
        document = scene.document()
        words = json.dumps(document, sort_keys=True)
        if not common:
            own = int.from_bytes(hashlib.sha256(words.encode()).digest()[:8], "big")
            seed = int(np.random.SeedSequence([seed, own]).generate_state(1, np.uint64)[0] >> 1)
        # where and how fast a row is computed does not change it
        asked = {key: plain_number(arguments[key]) for key in sorted(arguments) if key not in FREE}
        whole = hashlib.sha256(f"{words} {method} {seed} {asked} {_versions(method)}".encode())
        for file in filter(Path.is_file, map(Path, named_files(document))):
            whole.update(file.read_bytes())
        return cls(
            scene=scene, change=change, method=method, seed=seed, arguments=arguments,
            name=whole.hexdigest()[:16],
        )  # fmt: skip

    def row(self, folder: Path | None, run: Run) -> dict[str, Any]:
        """The row of the table. A complete answer is kept in the folder, and is taken from there
        if it was kept before."""
        kept = None if folder is None else folder / f"{self.name}.json"
        if kept is not None and kept.exists():
            if found := _kept_answer(kept):
                return self._columns(found, self._doubt())
            _again(kept, "holds no answer that can be read")
        response: Response | Summary | None = None
        try:
            response, note = self._answer(folder, run), ""
        except NotApplicable as error:
            note = str(error)
        except NotConverged as error:
            response, note = _summary_of(error.partial), str(error)
        if kept is not None and response is not None and not note:
            try:
                write_text(to_json(response.to_dict()) + "\n", kept)
            except OSError as error:  # the row itself is not lost
                warnings.warn(f"{kept}: {reason_of(error)}: the row was not kept", OutputWarning, 2)
            else:
                kept.with_suffix(".checkpoint").unlink(missing_ok=True)
        return self._columns(response, note or self._doubt())

    def _doubt(self) -> str:
        """That a record of the scene is not the noise for which the row holds."""
        if self.method == "replay" or not self.scene.has_records:
            return ""  # a replay follows the record itself
        from stochvi.isolators.record_verdict import judged_phase

        record, _ = judged_phase(self.scene)
        return "" if record is None or record.agrees else record.headline("the record")

    def _answer(self, folder: Path | None, run: Run) -> Response | Summary:
        from stochvi.statistics.hazards import OutOfReach

        room, _, name = METHODS[self.method].partition(":")
        ask = getattr(import_module(f"stochvi.{room}"), name)
        try:
            if self.method in SAMPLING:
                answer = self._sampled(ask, folder, run)
            else:
                threads = {"threads": run.workers} if self.method == "replay" else {}
                answer = ask(self.scene, **threads, **self.arguments)
        except OutOfReach as error:  # in one scene; the next may meet it
            raise NotApplicable(self.method, str(error)) from error
        return answer if isinstance(answer, Response) else Summary.of(answer)

    def _sampled(self, calculate: Callable[..., Any], folder: Path | None, run: Run) -> Any:
        """The answer of a calculation that may go on from a checkpoint in the folder."""
        asked = run.work() | {"seed": self.seed, **self.arguments}
        if folder is None:
            return calculate(self.scene, **asked)
        folder.mkdir(parents=True, exist_ok=True)
        checkpoint = folder / f"{self.name}.checkpoint"
        if checkpoint.is_symlink():
            checkpoint.unlink()
        if _goes_on(checkpoint):
            # another sweep with this folder ends the row, and takes its checkpoint away
            with contextlib.suppress(FileNotFoundError):
                return calculate(self.scene, checkpoint=checkpoint, resume=checkpoint, **asked)
        return calculate(self.scene, checkpoint=checkpoint, **asked)

    def _columns(self, response: Response | Summary | None, note: str) -> dict[str, Any]:
        found: dict[str, Any] = dict(self.change)
        for (owner, name), estimate in response.estimates().items() if response else ():
            found[f"{owner}.{name}"] = estimate.value
            found[f"{owner}.{name}.{ERROR}"] = estimate.standard_error
            found[f"{owner}.{name}.{BIAS}"] = estimate.bias
            found[f"{owner}.{name}.{BIAS_ERROR}"] = estimate.bias_error
            if estimate.upper_95 is not None:
                found[f"{owner}.{name}.{LIMIT}"] = estimate.upper_95
        for owner, pair in response.impact_pairs.items() if isinstance(response, Response) else ():
            found[f"{owner}.speed_threshold"] = pair.speed_threshold
        return found | {
            "method": self.method,
            "seed": self.seed if self.method in SAMPLING else None,
            "paths": response and response.cost.paths,
            "seconds": response and response.cost.wall_time,
            "note": note,
        }


def _goes_on(checkpoint: Path) -> bool:
    """Whether a checkpoint exists that can be resumed; a damaged one is removed."""
    from stochvi.sampling.checkpoints import Checkpoint

    if not checkpoint.exists():
        return False
    try:
        Checkpoint.read(checkpoint)
    except FileNotFoundError:
        return False
    except CheckpointError as error:
        _again(checkpoint, str(error).removeprefix(f"{checkpoint} "))
        checkpoint.unlink(missing_ok=True)
        return False
    return True


@dataclass(frozen=True, kw_only=True)
class Summary:
    """The quantities of an answer that is no `Response`, by the names of their owners."""

    quantities: Mapping[str, Mapping[str, Estimate | None]]
    cost: Cost

    @classmethod
    def of(cls, answer: Result) -> Summary:
        """The summary of an answer."""
        return cls(quantities=answer.quantities, cost=answer.cost)

    def estimates(self) -> dict[tuple[str, str], Estimate]:
        """The quantities that are known, as those of a `Response`."""
        return {
            (owner, name): estimate
            for owner, part in self.quantities.items()
            for name, estimate in part.items()
            if estimate is not None
        }

    def to_dict(self) -> dict[str, Any]:
        """The document that a row is kept as."""
        return {"quantities": plain(self.quantities), "cost": plain(self.cost)}

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> Summary:
        """The summary whose document this is."""
        quantities = {
            owner: {name: item and Estimate(**item) for name, item in part.items()}
            for owner, part in document["quantities"].items()
        }
        return cls(quantities=quantities, cost=Cost(**document["cost"]))


def _summary_of(answer: Any) -> Response | Summary | None:
    """Contents of an answer that was not finished."""
    from stochvi.isolators.sizing.answer import ClearanceAnswer
    from stochvi.statistics.reliability import Reliability

    if isinstance(answer, ClearanceAnswer | Reliability):
        return Summary.of(answer)
    return answer if isinstance(answer, Response) else None


def _kept_answer(kept: Path) -> Response | Summary | None:
    """The answer that the file of a row holds; None if it cannot be read."""
    try:
        document = json.loads(kept.read_text("utf-8"))
        return (Summary if "quantities" in document else Response).from_dict(document)
    except (OSError, TypeError, ValueError, LookupError, AttributeError, RecursionError):
        return None


def _again(file: Path, reason: str) -> None:
    warnings.warn(f"{file} {reason}: its row is computed again", InputWarning, stacklevel=2)


SAMPLING = ("simulate", "size", "reliability")
"""Methods that draw random numbers: they share the workers of a sweep."""

FREE = ("budget", "checkpoint_interval")
"""Arguments that do not change the numbers of a row, so that they are not part of its name."""


def _versions(method: str) -> str:
    """The versions, and of a row with random numbers the processor, that its digits depend on."""
    if method in SAMPLING:
        from stochvi.sampling.workers import machine

        return machine()
    return str(provenance({}))


def values_of(text: str, document: Mapping[str, Any]) -> tuple[str, list[float]]:
    """A key and its values from "key=0.3:1:8" (eight values from 0.3 to 1), "key=1:100:5:log"
    (five values with equal ratios) or "key=0.3,0.5,1".

    A value may bear a unit: "impact_pair.0.upper=3mm:6mm:4". Those of the keys follow from the
    document of the scene.

    Examples
    --------
    >>> document = {"structure": {"damping": 0.1, "frequency_hz": 1.0}}
    >>> values_of("structure.damping=0.1:0.4:4", document)[1]
    [0.1, 0.2, 0.3, 0.4]
    >>> values_of("structure.damping=1:100:3:log", document)
    ('structure.damping', [1.0, 10.0, 100.0])
    >>> values_of("structure.frequency_hz=10Hz,0.1kHz", document)[1]
    [10.0, 100.0]
    """
    key, equals, listed = text.partition("=")
    key = written_key(key)
    wrong = ValueError(
        "--vary must be KEY=FIRST:LAST:NUMBER, KEY=FIRST:LAST:NUMBER:log or "
        f"KEY=VALUE,VALUE,..., got {text!r}"
    )
    words, spacing = listed.split(","), list[str]()
    if ":" in listed:
        first, last, *spacing = listed.split(":")
        words = [first, last]
    if not key or not equals or not all(map(_is_measured, words)):
        raise wrong
    values = [_value(key, word, document) for word in words]
    if ":" not in listed:
        return key, values
    start, stop = values
    number, *log = spacing or [""]
    try:
        count = int(number)
    except ValueError:
        raise wrong from None
    if log not in ([], ["log"]) or count < 1 or (log and min(values) <= 0.0):
        raise wrong
    if not math.isfinite(stop - start):
        raise wrong
    _check_size({key: count})
    spaced = np.geomspace(start, stop, count) if log else np.linspace(start, stop, count)
    # 0.1, 0.2, 0.3: what is written, not what is left of it after a sum
    return key, [float(f"{value:.12g}") for value in spaced]


def _is_measured(word: str) -> bool:
    """Whether a word is a number, alone or with something behind it."""
    try:
        float(word)
    except ValueError:
        return MEASURED.fullmatch(word) is not None
    return True


def _value(key: str, word: str, document: Mapping[str, Any]) -> float:
    """A value of a key, in the unit that the scene has it in."""
    try:
        return float(word)
    except ValueError:
        pass
    words = key.split(".")
    while is_place(words[-1]) or words[-1] in BetweenUnits.model_fields:
        words.pop()
    part, name = holder_of(document, ".".join(words))
    unit = key_unit(document, part, name) if isinstance(part, dict) else ""
    if not unit and (not isinstance(part, dict) or name not in part):
        raise unknown_key(document, key)
    try:
        return measured_in(word, unit)
    except ValueError as error:
        raise ValueError(f"vary: {key} {error}") from None


# ------------------------------------------------------------------------------
# The mean of a method's answer over several records of one phase, and the scatter between them.
#
# Records of one road differ by more than their own statistical errors. Each is taken by itself.
# What is averaged is the answer, not the density: the probability of an impact is far from linear
# in the level, so that the loudest records have most of it.
# ------------------------------------------------------------------------------


@calculation
def mean_over_records(
    scene: Scene,
    files: Sequence[str | Path],
    *,
    method: str = "reliability",
    out: str | Path | None = None,
    progress: Progress | None = None,
    **arguments: Any,
) -> DataFrame:
    """Mean over several measured records, and scatter between them, of a method's answer.

    Each record takes the place of the file of the scene; unit, level and band stay. The mission
    meets one of them, each as probable as the others. So its probability of an impact is the mean
    of theirs. Noise of their mean density has a smaller one where impacts are rare.

    Parameters
    ----------
    scene
        A scene that one record shakes.
    files
        Files of the records, two at least.
    method, out, progress
        As for `stochvi.sweep`.
    **arguments
        Those of the method, such as `mission`.

    Returns
    -------
    DataFrame
        A row per quantity: `quantity`, its `mean` and the ends `low` and `high` of its 95 %
        interval by Student, which holds the scatter between the records. It is that of the
        logarithm where all values are positive; that of a probability ends at 1. Beside them are
        `bias`, `statistical_error` of the mean, and `std_between_records` without statistical
        errors.
        `attrs["records"]` is the table of the records, a row each.

    Raises
    ------
    ValueError
        If the scene has no single record, or there are fewer than two files.

    See Also
    --------
    stochvi.mean_over_units : The mean over units that differ.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from stochvi import ImpactPair, Isolator, Restitution
    >>> files = [Path(tempfile.mkdtemp()) / f"{level}.txt" for level in (9, 10, 12)]
    >>> for number, file in enumerate(files):
    ...     values = np.random.default_rng(number).normal(size=4000)
    ...     np.savetxt(file, float(file.stem) * values)
    >>> scene = Scene(
    ...     structure=Isolator(frequency_hz=12.0, zeta=0.1),
    ...     impact_pairs=[ImpactPair(clearance=0.008, law=Restitution(coefficient=0.5))],
    ...     excitations=[RecordedNoise(file=str(files[0]), unit="m/s2", fs=400.0)],
    ... )
    >>> table = mean_over_records(scene, files, mission=60.0).set_index("quantity")
    >>> bool(0.0 < table.loc["mission.hit", "mean"] < table.loc["mission.hit", "high"] <= 1.0)
    True
    """
    check_method(method, arguments)
    records = [each for each in scene.excitations if isinstance(each, RecordedNoise)]
    if len(records) != 1:
        raise ValueError(f"scene must have one excitation of kind 'record', got {len(records)}")
    if len(files) < 2:
        raise ValueError(f"files must be two at least, got {len(files)}")
    (record,) = records
    made = [
        scene.replace(
            excitations=[
                record.replace(file=str(file)) if each is record else each
                for each in scene.excitations
            ]
        )
        for file in files
    ]
    grid: list[Change] = [(("record", float(number)),) for number in range(len(files))]
    rows = rows_of(
        scene, grid, lambda change: made[int(change[0][1])], method=method, common=False,
        arguments=arguments, out=out, progress=progress,
    )  # fmt: skip
    rows.insert(0, "file", [str(file) for file in files])
    return _each_quantity(rows, "records", _mean_over_records)


def _each_quantity(
    rows: DataFrame, of: str, mean: Callable[..., dict[str, Any]], *more: Any
) -> DataFrame:
    """A row for each quantity of answers, which a function makes of its numbers in their rows:
    values, standard errors and biases; the rows of the answers are an attribute of this name."""
    found = []
    for name in (str(each) for each in rows if f"{each}.{ERROR}" in rows):
        value, error, bias = (rows[f"{name}{end}"].to_numpy(float) for end in ENDS)
        if f"{name}.{LIMIT}" in rows:  # what was not seen may be as large as its limit
            bias = bias + rows[f"{name}.{LIMIT}"].fillna(0.0).to_numpy(float)
        found.append({"quantity": name} | mean(name, value, error, bias, *more))
    table = frame_of(found)
    table.attrs[of] = rows
    return table


ENDS = ("", f".{ERROR}", f".{BIAS}")
"""Endings of the columns of a quantity: its value and the errors that every row has."""


def _mean_over_records(
    quantity: str, value: Vector, error: Vector, bias: Vector
) -> dict[str, float]:
    """The mean of a quantity over records; NaN where the answer of any record lacks it."""
    count, mean, spread = len(value), float(value.mean()), float(value.std(ddof=1))
    left = float(abs(bias).mean())
    # the scatter of the values holds their statistical errors
    scatter = spread / math.sqrt(count)
    half = student_quantile(1.0 - CONFIDENCE, count - 1.0) * scatter + left
    low, high = mean - half, mean + half
    if value.min() > 0.0:
        low, high = logarithmic_interval(mean, scatter, count - 1, bias=left)
    if quantity.startswith("mission.") and quantity != "mission.expected_hits":
        low, high = max(low, 0.0), min(high, 1.0)  # a probability
    between = spread**2 - float((error**2).mean())
    return {
        "mean": mean, "low": low, "high": high, "bias": left,
        "statistical_error": math.sqrt(float((error**2).sum())) / count,
        "std_between_records": math.sqrt(max(between, 0.0)) if between == between else math.nan,
    }  # fmt: skip


# ------------------------------------------------------------------------------
# The mean of any method's answer over the units of a production, by Gauss quadrature.
#
# Each node is a unit with a scene of its own, for which the method answers as in a sweep. So
# whatever a method covers, it covers for units that differ.
# ------------------------------------------------------------------------------


@calculation
def mean_over_units(
    scene: Scene,
    spreads: Mapping[str, Spread] | None = None,
    *,
    method: str = "simulate",
    nodes: int = 5,
    out: str | Path | None = None,
    progress: Progress | None = None,
    **arguments: Any,
) -> DataFrame:
    """Mean over units, and spread between them, of every quantity of a method's answer.

        E q = sum_i w_i q(unit_i)

    The nodes are those of Gauss and Hermite for a normal distribution, and of Gauss and Legendre
    for a uniform one, in all combinations. A mean is exact for answers that are polynomials of a
    degree below 2 `nodes` in each amount. What higher degrees add is estimated from how fast the
    coefficients fall with the degree, and is a part of the bias: of rare events it may be all.

    Parameters
    ----------
    scene
        The scene about which the units vary.
    spreads
        Distribution of each quantity, as for `stochvi.isolators.production`. The clearance of each
        stop varies for itself. By default what the scene states (`stochvi.BetweenUnits`).
    method, out, progress
        As for `sweep`.
    nodes
        Number of nodes of each amount.
    **arguments
        Those of the method, as for `sweep`. Each unit has random numbers of its own.

    Returns
    -------
    DataFrame
        A row per quantity: `quantity`, its `mean` over the units with its statistical
        `standard_error` and its `bias`, and `std_between_units`, from which the statistical error
        of the units is taken off. `attrs["units"]` is the table of the units, a row each, with
        their `weight`.

    Raises
    ------
    ValueError
        If the spreads have more combinations than a sweep may have rows.

    See Also
    --------
    stochvi.sweep : The answers over ranges of keys.
    stochvi.isolators.production : The probability of any impact of a production.

    Examples
    --------
    >>> import stochvi
    >>> from stochvi.isolators import Spread
    >>> scene = stochvi.load_scene(stochvi.scenes.shipped_scene("oscillator-elastic"))
    >>> table = stochvi.mean_over_units(scene, {"clearance": Spread(std=0.05)}, method="exact")
    >>> rate = table.set_index("quantity").loc["stops.collision_rate"]
    >>> round(float(rate["mean"]), 4), round(float(rate["std_between_units"]), 4)
    (0.2835, 0.0172)
    """
    check_method(method, arguments)
    spreads = spreads_of(scene) if spreads is None else spreads
    check_spreads(scene, spreads)
    if nodes < 1:
        raise ValueError(f"nodes must be at least 1, got {nodes}")
    stops = np.array(own_distances(model_of(scene)))
    units = Units(scene=scene, spreads=spreads, mean=model_of(scene).mean_gaps, stops=stops)
    columns = units.columns
    if nodes ** len(columns) > MOST_ROWS:
        raise ValueError(
            f"spreads must have at most {MOST_ROWS} combinations of nodes, got {nodes} of each of "
            f"{len(columns)} amounts; give fewer spreads or nodes"
        )
    rules = [spreads[tolerance].nodes(tolerance, nodes) for tolerance, _ in columns]
    names = [name for _, name in columns]
    grid: list[Change] = [
        tuple(zip(names, place, strict=True))
        for place in itertools.product(*[rule[0].tolist() for rule in rules])
    ]
    weights = [math.prod(each) for each in itertools.product(*[rule[1] for rule in rules])]

    def made(change: Change) -> Scene:
        return units.built(np.array([amount for _, amount in change]))

    rows = rows_of(
        scene, grid, made, method=method, common=False, arguments=arguments, out=out,
        progress=progress,
    )  # fmt: skip
    rows.insert(0, "weight", weights)
    bases = [spreads[tolerance].polynomials(nodes) for tolerance, _ in columns]
    return _each_quantity(rows, "units", _mean_over_units, np.array(weights), bases)


def _left_out(value: Vector, weight: Vector, bases: Sequence[Matrix]) -> float:
    """Estimate of what the degrees beyond those of the quadrature add to a mean.

    A coefficient of the degree k is taken to be c_0 rho^k, rho as the largest of the last two.
    """
    if not bases or len(bases[0]) == 1 or not np.isfinite(value).all():
        return 0.0
    nodes, found = len(bases[0]), 0.0
    parts = np.reshape(weight * value, (nodes,) * len(bases))
    mean = abs(float(parts.sum()))
    for axis, basis in enumerate(bases):
        others = tuple(k for k in range(len(bases)) if k != axis)
        terms = np.abs(basis @ parts.sum(axis=others))
        degrees = range(max(1, nodes - 2), nodes)
        ratio = max((terms[k] / mean) ** (1.0 / k) for k in degrees) if mean else 0.0
        found += mean * min(ratio, 1.0) ** (2 * nodes)
    return found


def _mean_over_units(
    _: str, value: Vector, error: Vector, bias: Vector, weight: Vector, bases: Sequence[Matrix]
) -> dict[str, float]:
    """The mean of a quantity over units; NaN where the answer of any unit lacks it."""
    mean = float(weight @ value)
    between = float(weight @ (value - mean) ** 2 - weight @ error**2)
    return {
        "mean": mean,
        "standard_error": math.sqrt(float(weight**2 @ error**2)),
        "bias": float(weight @ np.abs(bias)) + _left_out(value, weight, bases),
        "std_between_units": math.sqrt(max(between, 0.0)) if between == between else math.nan,
    }


__all__ = ["Job", "mean_over_records", "mean_over_units", "once", "sweep", "values_of"]
