"""Options that several commands have in common, and their effects. Chapters: the options;
`--tolerances`."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import math
import os
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

import click

from stochvi.cli.program import FAILED, console_for, echo, progress_bar, stop
from stochvi.results.deadline import Deadline, asked_for, graceful_interrupt, of_command, showing
from stochvi.statistics.hardness import HARDNESS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.console import Console

    from stochvi.isolators.record_verdict import RecordVerdict
    from stochvi.isolators.tolerances import Spread, Tolerances
    from stochvi.mathematics.numerics import Vector
    from stochvi.mathematics.units import Choice
    from stochvi.results.deadline import Progress
    from stochvi.results.files import Origin
    from stochvi.scenes.scene import Scene
    from stochvi.views.pages import Told

BUDGET = 60.0
"""Wall time that a command may take to reach an accuracy, s, unless --budget is given."""

LEAST_SHARE = 0.3
"""Smallest share of a budget for calculations, however long the start of the program took."""

GRACE_SHARE, GRACE_SECONDS = 0.2, 0.6
"""Time after the end of the budget until which pictures of a page are still begun: this share of
the budget, and these seconds. The command ends within 2 s after the share; the last files take the
rest of that time."""

DRAWING_SECONDS, ALLOWED_SECONDS = 2.0, 1.3
"""Time that tables and a first picture take with the import of their libraries, s, measured on a
busy machine. The second number is the time that they may take after `GRACE_SHARE` of the budget, s.
The start of the program takes the rest of the 2 s."""


Found = TypeVar("Found")


@contextlib.contextmanager
def checked_targets(options: Common, given: Mapping[str, Any]) -> Iterator[None]:
    """Refuse, before any work, files that cannot be written or that the command also reads.

    Within the `with` block no answer replaces a file that the command reads.
    """
    from stochvi.cli.program import (
        check_apart,
        check_file_target,
        check_folder_target,
        check_formats,
        check_report_target,
        inputs_of,
    )
    from stochvi.views.files import also_written, kept_inputs

    read = inputs_of(_scenes(given))
    kept = [Path(given[key]) for key in ("checkpoint", "resume") if given.get(key)]
    check_formats(options.formats, options.out, has_report=options.force is not None)
    if options.out is not None:
        check_folder_target(options.out)
        if options.force is False:
            check_report_target(options.out, options.question)
    if options.json_file not in (None, "-"):
        check_file_target("--json", Path(options.json_file), read)
        check_apart(Path(options.json_file), kept)
    for file in kept:
        check_file_target("--checkpoint", file, read)
    with kept_inputs([*read, *kept]), also_written(options.formats):
        yield


@dataclass(frozen=True, kw_only=True)
class Common:
    """Values of the common options; an option that a command does not have keeps its default."""

    json_file: str | None = None
    out: Path | None = None
    seed: int = 0
    threads: int | None = None
    budget: float | None = None
    quiet: bool = False
    verbose: bool = True
    force: bool | None = None
    formats: frozenset[str] = frozenset()
    units: Choice = field(default_factory=dict)
    question: str = ""
    begun: Deadline = field(default_factory=lambda: Deadline.after(0.0))
    judged: list[RecordVerdict] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    """Warnings that were told before the work, and are not told again beside the answer."""

    def until(self, budget: float | None, drawing: float = DRAWING_SECONDS) -> Deadline:
        """The deadline of a budget that is counted from the start of the command.

        It is earlier if files are written and their `drawing` takes more seconds than a command may
        take after its budget. Raises `Interrupted` if Ctrl-C has come already.
        """
        if self.begun.interrupted:
            raise self.begun.fell_short("before the calculation began", "")
        if budget is None:
            return replace(self.begun, moment=math.inf, budget=None)
        early = 0.0
        if self.out is not None:
            early = max(drawing - ALLOWED_SECONDS - GRACE_SHARE * budget, 0.0)
        due = self.begun.sooner_by(early - budget).in_no_less_than(LEAST_SHARE * budget)
        return replace(due, budget=budget)

    @contextlib.contextmanager
    def within(self, budget: float | None) -> Iterator[None]:
        """Let messages name this budget, and pages leave out pictures once it is long over.

        Without a budget, messages name `BUDGET`, and every picture is drawn.
        """
        from stochvi.views.files import pictures_until

        late = math.inf if budget is None else (1.0 + GRACE_SHARE) * budget + GRACE_SECONDS
        deadline = replace(self.begun, moment=self.begun.moment + late, budget=budget)
        with asked_for(BUDGET if budget is None else budget), pictures_until(deadline):
            yield

    def origin(self, scene: str, provenance: Mapping[str, Any]) -> Origin:
        """The origin that a report states: this command, its scene file and the files it names."""
        from stochvi.cli.program import COMMAND_LINE, inputs_of
        from stochvi.results.files import digests, origin_of
        from stochvi.scenes.scene import file_and_phase
        from stochvi.scenes.text_tables import read_text

        file, _ = file_and_phase(Path(scene))
        return replace(
            origin_of(provenance),
            command=click.get_current_context().meta.get(COMMAND_LINE, ""),
            listing=read_text(file),
            files=digests(inputs_of([file])),
            question=self.question,
        )

    @property
    def console(self) -> Console:
        """The console for tables: standard output, or standard error if JSON goes to the output."""
        return console_for(self.json_file)

    @property
    def rest(self) -> float | None:
        """The seconds that are left of --budget, as the `budget` of a calculation that begins."""
        return self.until(self.budget).rest

    @property
    def sampling(self) -> dict[str, Any]:
        """Arguments of every calculation that samples: seed, threads and budget."""
        return {"seed": self.seed, "threads": self.threads, "budget": self.rest}

    def progress(self, title: str) -> AbstractContextManager[Progress]:
        """Progress of a calculation on standard error, unless --quiet is given."""
        return progress_bar(self.quiet, title)

    def show(
        self, found: Any, scene: Scene | None = None, *,
        documented: Mapping[str, Any] = MappingProxyType({}),
        verdict: tuple[RecordVerdict | None, str] = (None, ""), more: Sequence[Told] = (),
        **words: Any,
    ) -> None:  # fmt: skip
        """Show an answer as the options ask: its JSON document, what is told of it, its tables and
        its picture under the title of the scene. What is `documented` stands in the document, too,
        and `words` are for the description alone; `more` descriptions stand behind it."""
        from stochvi.results.base import plain
        from stochvi.views.files import write_table
        from stochvi.views.pictures import view_of

        view = view_of(found)
        known: dict[str, Any] = {}
        if self.json_file is not None:
            known = found.to_dict() | {name: plain(each) for name, each in documented.items()}
        self.tell(known, lambda: [view.tell(found, **words), *more], *verdict)
        if self.out is None:
            return
        for name, table in view.files(found).items():
            write_table(table, self.out / f"{name}.csv")
        if view.file and view.drawn is not None and view.has_picture(found):
            self.draw(view.file, lambda: view.draw(found, scene.title if scene else ""))
        for name, picture in view.pictures(found).items():
            self.draw(name, picture)

    def tell(
        self, document: Mapping[str, Any], told: Callable[[], Sequence[Told]],
        record: RecordVerdict | None = None, where: str = "",
    ) -> None:  # fmt: skip
        """Write the JSON document of an answer, and print it. Files stay if a later step fails.

        Parameters
        ----------
        told
            Describes the answer.
        record, where
            Whether a record of the scene agrees with the Gaussian noise of the answer, which stands
            first, and the phase that it shakes.
        """
        from stochvi.views.files import write_json

        self.judged.extend([] if record is None else [record])
        verdict = {} if record is None else {"record": record.to_dict()}
        try:
            if self.json_file is not None:
                write_json({**document, **verdict}, self.json_file)
        finally:  # a disk that is full costs the file, not the answer
            if not self.quiet:
                judged = []
                if record is not None:
                    from stochvi.views.isolator_tables import record_told

                    judged = [record_told(record, where)]
                self.say(*judged, *told())

    def say(self, *told: Told) -> None:
        """Print descriptions, unless --quiet is given, and behind brief ones what comes next."""
        from stochvi.views.pages import print_told

        for each in () if self.quiet else told:
            warnings = [warning for warning in each.warnings if warning not in self.said]
            print_told(self.console, replace(each, warnings=warnings), self.verbose)
        if not self.quiet and any(each.brief for each in told):
            self._say_what_comes_next(next((each.next for each in told if each.next), ()))

    def _say_what_comes_next(self, after: Sequence[str]) -> None:
        """Name the way to the evidence of a brief answer, and the next step: its page, if it has
        one (--force replaces it) and the answer names nothing else."""
        from stochvi.cli.program import COMMAND_LINE

        here, lines = click.get_current_context(), []
        asked = here.meta.get(COMMAND_LINE, "").removesuffix(" -v")
        if after:
            words, command, part = after
            lines = [f"Next, {words}: stochvi {command} {shlex.quote(here.params['scene'] + part)}"]
        elif self.force is not None:
            target = f"{asked} --out out" if self.out is None else self.out / "report.html"
            lines = [f"Next, a page to sign: {target}"]
        lines += [] if self.verbose else ["-v shows the tables, the method and the cost"]
        for line in lines:
            self.console.print(line, style="dim", highlight=False, markup=False)

    def draw(self, name: str, picture: Callable[[], Axes]) -> None:
        """Write a picture, if there is a folder for it; if that fails, print a note."""
        from stochvi.views.files import try_picture

        if self.out is not None:
            try_picture(picture, self.out / f"{name}.png")


class Folder(click.Path):
    """Name of a folder; an empty name is refused, because it would mean the current folder."""

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        if value == "":
            raise ValueError("--out must name a folder, got ''")
        return super().convert(value, param, ctx)


class Words(click.ParamType):  # type: ignore[type-arg]
    """A value that is read from words; one that is no text stays as it is."""

    def __init__(self, name: str, read: Callable[[str], Any]) -> None:
        self.name, self.read = name, read

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        if not isinstance(value, str):
            return float(value) if isinstance(value, int) else value
        try:
            return self.read(value)
        except ValueError as error:
            raise ValueError(f"{param.opts[0]} {error}") from None


def quantity(name: str) -> Words:
    """A number with a unit of one quantity ("10h", "30 min", "0.5 m/s"); a plain one is in SI."""

    def read(text: str) -> float:
        from stochvi.mathematics.units import measured

        return measured(text, name)

    return Words(name, read)


def _units(text: str) -> Choice:
    """Units in which answers are shown, separated by commas: "mm, g"."""
    from stochvi.mathematics.units import units_of

    return units_of(text)


def _chance(text: str) -> float:
    """A probability, as 0.01, 1% or 0,1%."""
    number = text.strip().removesuffix("%")
    try:
        if re.fullmatch(r"\s*\d*,\d+\s*", number):
            number = number.replace(",", ".")
        return float(number) / (100.0 if text.strip().endswith("%") else 1.0)
    except ValueError:
        raise ValueError(f"must be a probability such as 0.01 or 1%, got {text!r}") from None


def _rate(text: str) -> float:
    """A number of events per time: "0.1/h", "2 per min", "5/s"; a plain one is per second."""
    from stochvi.mathematics.units import measured

    number, per, time = text.replace(" per ", "/").partition("/")
    try:
        if per and not time.strip():
            raise ValueError
        return float(number) / (measured(f"1 {time}", "time") if per else 1.0)
    except ValueError:
        raise ValueError(
            f"must be a number per second, or with a time as 0.1/h, 2/min or 5/s, got {text!r}"
        ) from None


def _formats(text: str) -> frozenset[str]:
    """Forms of files, separated by commas: "mat,pdf"."""
    from stochvi.views.files import FORMATS

    found = frozenset(each.strip().lower() for each in text.split(",") if each.strip())
    if unknown := sorted(found - set(FORMATS)):
        raise ValueError(f"must be of {', '.join(FORMATS)}, got {unknown[0]!r}")
    return found


def listed(unit: str = "") -> Words:
    """Numbers with commas between them, in a unit, which each may bear: "2m/s"."""

    def read(text: str) -> list[float]:
        from stochvi.mathematics.units import measured_in

        try:
            return [measured_in(word, unit) for word in text.split(",")]
        except ValueError:
            own = f"; each is in {unit}, or bears its unit" if unit else ""
            raise ValueError(f"must be numbers with commas, got {text!r}{own}") from None

    return Words(f"list of {unit}", read)


def _lengths(text: str, plain: float = 1.0) -> list[float]:
    """Lengths in m with commas between them: "4mm" with its unit, a plain number times `plain`."""
    from stochvi.mathematics.units import measured

    return [measured(word, "length", plain) for word in text.split(",")]


def _multiples(text: str) -> Callable[[float], list[float]]:
    """Lengths by the length that a plain number is a multiple of."""
    _lengths(text)  # refused here, where the option is known
    return functools.partial(_lengths, text)


def _barriers(text: str) -> tuple[float | None, float | None]:
    """Lower and upper barrier in m from "3" or "3mm", on both sides, or from "LO,HI"."""
    words = [word.strip() for word in text.split(",")]
    if len(words) == 1 and words[0]:
        (either,) = _lengths(words[0])
        if not either > 0.0:
            raise ValueError(f"must be positive, or LO,HI, got {text!r}")
        return -either, either
    if len(words) != 2 or not any(words):
        raise ValueError(f"must be B, or LO,HI with at least one of them, got {text!r}")
    lower, upper = (_lengths(word)[0] if word else None for word in words)
    return lower, upper


def _names(text: str) -> list[str]:
    """Names that are separated by commas."""
    return [name.strip() for name in text.split(",")]


QUANTITIES = ("time", "speed", "frequency", "force", "length", "acceleration", "energy")
KINDS = {
    "int": int, "float": float, "probability": Words("chance", _chance),
    "rate": Words("rate", _rate), "lengths": Words("lengths", _lengths),
    **{each: quantity(each) for each in QUANTITIES},
    "multiples": Words("multiples", _multiples), "barriers": Words("barriers", _barriers),
    "names": Words("names", _names), "list": listed(),
    **{f"list of {unit}": listed(unit) for unit in ("s", "m/s", "m/s^2", "dB")},
    "units": Words("units", _units), "formats": Words("formats", _formats),
    "folder": Folder(path_type=Path), "path": click.Path(path_type=Path),
}  # fmt: skip
"""Kinds of values by the words that name them on a page."""

GROUPS = {
    "BUDGET": BUDGET,
    "limits": "\n".join(
        f"--{name.replace('_', '-')} {kind.argument}  Limit: {kind.help}."
        for name, kind in HARDNESS.items()
    ),
    "keeping": """
        --checkpoint FILE  Save the simulation to this file. It replaces a checkpoint there; a long
            one is kept as FILE.earlier.
        --checkpoint-interval TIME (time) = 1.0  Time between checkpoints: a crash loses at most
            this, and one task.
        --resume FILE  Continue from a checkpoint, with its options and seed, and keep saving to it.
    """,
    "range": """
        --from F as start (frequency)  Lowest frequency, Hz.
        --to F as end (frequency)  Highest frequency, Hz.
        --points (int) = 400  Number of frequencies, both ends included.
    """,
}
"""What pages name in braces: options that several commands have, and numbers."""

LINE = re.compile(
    r"(--[a-z-]+)( -[a-z])?(?: ([a-z-]+(?:\|[a-z-]+)+))?(?: ([^ (:=]\S*)(?<! as))?(?: as (\w+))?"
    r"(?: \(([^)]+)\))?(?: (:?=)(?: (\S+))?)?"
)
"""A line of an option on a page, without its help: the option, what it may be or what stands for
it, its argument, its kind, and its default."""


def on_page(page: str) -> tuple[str, list[Callable[[Any], Any]]]:
    """The help of a command, and its options, from a page that states both.

    A line "--name KEY as argument (kind) = default  Help." is an option. What is not said is left
    out: an option without anything else is a flag, "-v" behind its name is its short name. "a|b"
    are choices, ":=" is a default that
    help does not show; a kind may also be "needed" or "many".
    """
    words, *entries = re.split(r"\n\s*(?=--)", "\n" + page.format(**GROUPS))
    return words[1:], [
        _option(*re.split(r"  |\n\s*", each.strip(), maxsplit=1)) for each in entries
    ]


def _option(line: str, words: str) -> Callable[[Any], Any]:
    """An option of click, from its line on a page and its help."""
    if (match := LINE.fullmatch(line)) is None:
        raise ValueError(f"this is no line of an option: {line!r}")
    name, short, choices, metavar, argument, kinds, equals, default = match.groups()
    of = set() if kinds is None else set(kinds.split(", "))
    needed, many = "needed" in of, "many" in of
    kind: Any = next((KINDS[each] for each in of - {"needed", "many"}), str)
    if choices:
        kind = click.Choice(choices.split("|"))
    more: dict[str, Any] = {"type": kind, "metavar": metavar, "required": needed, "multiple": many}
    if not (choices or metavar or kinds):
        more = {"is_flag": True}
    if equals:
        more |= {"default": default or "", "show_default": equals == "="}
    names = [each.strip() for each in (name, short, argument) if each is not None]
    return click.option(*names, help=" ".join(words.split()), **more)


LARGEST = "Largest time; the exit code is 1 if the answer is not accurate enough by then"
OPTIONS = {
    "json": "--json FILE|- as json_file  File that gets the answer as JSON; - for standard output.",
    "out": "--out DIR (folder)  Folder that gets tables and pictures.",
    "formats": "--formats LIST (formats) :=  "
    "With --out, also as: mat, uff (tables), pdf (the report, if any).",
    "units": "--units LIST (units) :=  "
    "Units of tables, pictures, pages and CSV, as mm,g or in,lbf; JSON is in SI units.",
    "seed": "--seed (int) := 0  Seed of the random numbers: the same seed gives the same digits.",
    "threads": "--threads (int)  Number of threads; by default that of the cores.",
    "budget": f"--budget TIME (time) = {BUDGET}  {LARGEST}.",
    "open budget": f"--budget TIME (time)  {LARGEST} "
    f"[{BUDGET:g}; no limit with --paths, --checkpoint or --resume].",
    "kept budget": f"--budget TIME (time)  {LARGEST} "
    f"[{BUDGET:g}; no limit with --checkpoint or --resume].",
    "force": "--force  Replace the report of another scene or question in --out.",
    "quiet": "--quiet  Show neither tables nor progress.",
    "verbose": "--verbose -v  Show the tables, the method and the cost behind the answer, too.",
}
"""The common options by name. "open budget" and "kept budget" are --budget without a default. The
first is for commands that also end by a number of paths or keep their work; the second is for those
that only keep it."""

OPEN_BUDGETS, WITHOUT_BUDGET = {"open budget", "kept budget"}, ("paths", "checkpoint", "resume")
"""Names of the options --budget without a default, and the arguments with which there is none: a
number of paths bounds the work, and a checkpoint keeps it. Else the budget is `BUDGET`."""

FIELDS = {"json": "json_file", "open budget": "budget", "kept budget": "budget"}
"""Fields of `Common` by their option, where the two names differ."""


def judged_phase(scene: Scene) -> tuple[RecordVerdict | None, str]:
    """The verdict on the record of a scene, or of the phase whose record must be known first, and
    the name of this phase."""
    if not scene.has_records:
        return None, ""
    from stochvi.isolators.record_verdict import judged_phase  # compiles, through replay

    return judged_phase(scene)


def fail_unless_gaussian(record: RecordVerdict | None) -> None:
    """End with exit code 1 if a record contradicts Gaussian noise of its spectrum, or is too short
    to be judged."""
    if record is not None and not record.agrees:
        stop(f"{record.headline('the record')}; stochvi replay shows its motion", FAILED)


def common(*names: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command these options, whose values it gets as `Common`, its first argument."""
    names = (*names, "units", *(["formats"] if "out" in names else []))
    kept = [FIELDS.get(name, name) for name in names]

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(command)
        def run(**given: Any) -> None:
            has_budget = "budget" in given
            bounded = any(given.get(name) for name in WITHOUT_BUDGET)
            if OPEN_BUDGETS.intersection(names) and given["budget"] is None and not bounded:
                given["budget"] = BUDGET
            # with numpy: not for --help
            from stochvi.mathematics.units import shown_in, units_passed_over

            begun, budget = Deadline.after(0.0), given.get("budget", BUDGET)
            if budget is not None and not 0.0 < budget < math.inf:
                raise ValueError(f"budget must be a positive number of seconds, got {budget}")
            options = Common(
                **{name: given.pop(name) for name in kept},
                question=_question(given), begun=begun,
            )  # fmt: skip
            quiet = options.quiet
            with (
                checked_targets(options, given),
                showing(None if quiet else _each_once()),
                shown_in(options.units),
            ):
                if has_budget:
                    due = Deadline.after(budget)
                    with graceful_interrupt(), options.within(budget), of_command(due):
                        command(options, **given)
                else:
                    command(options, **given)
                if passed := units_passed_over():
                    echo(f"note: numbers in {', '.join(passed)} are shown as they are: --units "
                         "knows no other unit for them")  # fmt: skip
            for record in options.judged:
                fail_unless_gaussian(record)
            if has_budget and begun.interrupted:
                stop("interrupted by Ctrl-C; the answer was kept", FAILED)

        for name in reversed(names):
            (option,) = on_page(OPTIONS[name])[1]
            run = option(run)
        return run

    return decorate


def _each_once() -> Callable[[float, str], None]:
    """Print what is announced while no progress is shown: a command compiles many kernels, each of
    which says so."""
    said: set[str] = set()

    def say(done: float, text: str) -> None:
        if text not in said:
            said.add(text)
            echo(text)

    return say


def _scenes(given: Mapping[str, Any]) -> list[Path]:
    """The scene files of a command, with the name of a phase where one is asked for."""
    named = given.get("scenes") or [given[key] for key in ("scene",) if given.get(key)]
    return [Path(name) for name in named]


NO_QUESTION = ("scene", "scenes", "checkpoint", "resume", "rel_error", "checkpoint_interval")
"""Options that are not part of the question of a command: they change only the accuracy or the
course of its answer. Scene files enter the question by their paths."""


def _question(given: Mapping[str, Any]) -> str:
    """Digest of a command, its scene files and its options."""
    asked = {key: str(value) for key, value in given.items() if key not in NO_QUESTION}
    places = [os.path.realpath(path) for path in _scenes(given)]
    words = [click.get_current_context().info_name, places, sorted(asked.items())]
    return hashlib.sha256(repr(words).encode()).hexdigest()[:16]


def how_to_go_on(given: Mapping[str, Any]) -> str:
    """The remedy of a command that ended early and has kept its work; empty for others."""
    kept = given.get("checkpoint") or given.get("resume")
    return f"; go on with --resume {kept}" if kept and Path(kept).is_file() else ""


def shown(
    solve: Callable[[], Found],
    show: Callable[[Found], None],
    given: Mapping[str, Any] = MappingProxyType({}),
) -> None:
    """Show an answer. If its accuracy was not reached, or Ctrl-C ended it, the answer so far is
    shown and the error raised. The error names the file of the checkpoint if one was `given`."""
    from stochvi.results.errors import Interrupted, NotConverged

    try:
        found = solve()
    except (NotConverged, KeyboardInterrupt) as reason:
        so_far = getattr(reason, "partial", None)  # a second Ctrl-C carries none
        if so_far is not None:
            show(so_far)
        if remedy := how_to_go_on(given):
            kind = NotConverged if isinstance(reason, NotConverged) else Interrupted
            message = str(reason) or "interrupted by Ctrl-C"
            raise kind(message + remedy, so_far) from reason
        raise
    show(found)


@dataclass(frozen=True)
class Varied:
    """Values of --from, --to, --points and --vary: frequencies, or values of a key."""

    start: float | None
    end: float | None
    points: int
    vary: str | None

    @classmethod
    def of(cls, asked: dict[str, Any]) -> Varied:
        """The values, which are taken out of the options of a command."""
        return cls(**{each.name: asked.pop(each.name) for each in fields(cls)})

    @property
    def given(self) -> bool:
        """Whether any of them is given."""
        return self.start is not None or self.end is not None or self.vary is not None

    def frequencies(self) -> list[float] | None:
        """The frequencies, Hz; None without --from and --to."""
        from stochvi.results.errors import spaced

        if self.start is None and self.end is None:
            return None
        if self.start is None or self.end is None or not self.start < self.end:
            raise ValueError(
                "--from and --to must be two rising frequencies (Hz), got "
                f"{self.start} and {self.end}"
            )
        if self.points < 2:
            raise ValueError(f"--points must be at least 2, got {self.points}")
        return spaced("--points", self.start, self.end, self.points)

    def values(self, scene: Scene) -> dict[str, Any] | None:
        """The key of a scene that --vary names, and its values; None without --vary."""
        from stochvi.sweeps import values_of

        if self.vary is None:
            return None
        return dict([values_of(self.vary, scene.document(as_written=True))])

    def asked(self, scene: Scene) -> dict[str, Any]:
        """Frequencies or values as `harmonic_response` and `bifurcation` take them."""
        if self.vary is None:
            found = self.frequencies()
            return {} if found is None else {"frequency_hz": found}
        if self.start is not None or self.end is not None:
            raise ValueError("--vary takes the place of --from and --to, got both; leave out one")
        return {"vary": self.values(scene)}


def band(option: str, text: str) -> tuple[float, float] | Vector:
    """Two ends of a band of frequencies, Hz, from "20:2000"; or with a number of frequencies, as
    "20:2000:60", an array of all of them, evenly spaced in logarithms."""
    import numpy as np

    from stochvi.mathematics.units import measured
    from stochvi.results.errors import MOST_SPACED, check_size

    words = text.split(":")
    try:
        ends = [measured(word, "frequency") for word in words[:2]]
        number = int(words[2]) if len(words) == 3 else 2
        if len(words) not in (2, 3) or number < 2 or not 0.0 < ends[0] < ends[1]:
            raise ValueError
    except ValueError:
        raise ValueError(
            f"{option} must be LOW:HIGH or LOW:HIGH:NUMBER with rising frequencies (Hz), as "
            f"20:2000, got {text!r}"
        ) from None
    check_size(option, number, MOST_SPACED, "ask for fewer")
    return np.geomspace(ends[0], ends[1], number) if len(words) == 3 else (ends[0], ends[1])


# ------------------------------------------------------------------------------
# The option --tolerances: limits of quantities, and distributions between units.
# ------------------------------------------------------------------------------


WIDTHS = {"normal": "std", "uniform": "half_width"}
"""Distributions between units, each with the parameter of `Spread` for its width."""

WANTED = (
    "--tolerances must be usual, or frequency=10%,damping=30%,level=3dB,stiffness=20%,centre=5mm "
    "or some of these; or distributions, as frequency=normal:3%,clearance=uniform:0.1mm, with a "
    "mean as normal:3%:+1%"
)
"""What the option takes, in words."""


def tolerances_of(scene: Scene, text: str | None) -> tuple[Tolerances | None, dict[str, Spread]]:
    """Return the limits and the distributions that a text states, beside those of the scene.

    A text is "usual", or "frequency=normal:5%,level=2dB". Quantities that it leaves out keep the
    distributions that the scene states. None stands for a command without the option: there are no
    limits, and all distributions are those of the scene.
    """
    from stochvi.scenes.validation import varied

    if text is None and not any(varied(scene)):
        return None, {}
    from stochvi.isolators.tolerances import (
        KEYS,
        UNITS,
        Spread,
        bands_beside,
        spreads_beside,
        spreads_of,
    )

    if text is None:
        return None, spreads_of(scene)
    limits: dict[str, float] = {}
    spreads: dict[str, Spread] = {}
    parts = [part.strip() for part in text.split(",")]
    for part in parts:
        if part == "usual":
            continue
        name, _, words = (each.strip() for each in part.partition("="))
        kind, *numbers = words.split(":") if ":" in words else ("", words)
        try:
            unit, size = UNITS[name]
            width, *mean = (size * float(each.strip().removesuffix(unit)) for each in numbers)
            if kind:
                (offset,) = mean or [0.0]
                spreads[name] = Spread(**{WIDTHS[kind.strip()]: width, "mean": offset})
            else:
                limits[KEYS.get(name, name)] = width
        except (KeyError, ValueError):
            raise ValueError(f"{WANTED}, got {part!r}") from None
    if beyond := limits.keys() & {"clearance", "restitution"}:
        raise ValueError(
            f"the tolerance of {min(beyond)} must be a distribution, as normal:0.1 or uniform:0.1; "
            "add a limit of the clearance to the answer"
        )
    spreads = spreads_beside(scene, spreads, limits)
    return bands_beside(scene, spreads, usual="usual" in parts, **limits), spreads
