"""The program `stochvi`. Chapters: output of commands, and the cluster that does their work; the
group of commands, and how an error becomes a sentence and a code; checks that files can be written.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import re
import shlex
import sys
import time
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

import click

from stochvi.results.deadline import Pace, Progress
from stochvi.results.errors import RENAMED, SceneError, TargetError, told_of_name, visible
from stochvi.results.files import named_files
from stochvi.scenes.outside import Parts

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from rich.console import Console


# ------------------------------------------------------------------------------
# The output of commands (console, progress, notes), and the cluster that does their work.
# ------------------------------------------------------------------------------


LINE_SECONDS = 2.0
"""Time between two lines of progress if standard error is not a terminal, s."""

PLAIN_WIDTH, NARROWEST, WIDEST = 100, 80, 10_000
"""Width, in characters, of a table that does not go to a terminal, unless the variable COLUMNS
states another. The others are the smallest and largest value of that variable."""


def console_for(json_file: str | None) -> Console:
    """Standard output, or standard error where the JSON document has the output to itself."""
    return new_console(sys.stderr if json_file == "-" else sys.stdout)


def new_console(stream: TextIO) -> Console:
    """A console on this stream, as wide as its terminal or the variable COLUMNS says."""
    from stochvi.views.files import PlainConsole

    unknown = None if stream.isatty() else PLAIN_WIDTH
    # rich reads COLUMNS itself, and fails if it is "²"
    environment = {
        name: os.environ[name] for name in os.environ if name not in ("COLUMNS", "LINES")
    }
    return PlainConsole(file=stream, width=_columns() or unknown, _environ=environment)


def _columns() -> int | None:
    """The variable COLUMNS within its limits, None where it is not a plain number."""
    text = os.environ.get("COLUMNS", "")
    if not (text.isascii() and text.isdigit()):
        return None
    return max(NARROWEST, min(int(text[:9]), WIDEST))


@contextlib.contextmanager
def progress_bar(quiet: bool, title: str) -> Iterator[Progress]:
    """A bar on a terminal, elsewhere a line every few seconds."""
    from rich import progress
    from rich.markup import escape

    if quiet:
        yield lambda done, text: None
        return
    if not sys.stderr.isatty():
        yield _progress_in_lines(title)
        return
    with progress.Progress(console=new_console(sys.stderr), transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda done, text: bar.update(
            task, completed=done, description=escape(visible(f"{title}: {text}"))
        )


def _progress_in_lines(title: str) -> Progress:
    """Progress in plain lines, the first after some seconds, and none twice in a row."""
    pace = Pace(title)
    last, said = time.monotonic(), ""

    def line(done: float, text: str) -> None:
        nonlocal last, said
        sentence, now = pace(done, text), time.monotonic()
        if sentence != said and now - last >= LINE_SECONDS:
            last, said = now, sentence
            echo(sentence)

    return line


def echo(line: str) -> None:
    """Print a line on standard error, if that stream is still open."""
    with contextlib.suppress(BrokenPipeError):
        click.echo(visible(line), err=True)


@contextlib.contextmanager
def notes_of_warnings() -> Iterator[None]:
    """Print the warnings of the code inside as notes on standard error, each on a line.

    Warnings of libraries, such as an overflow in numpy, are for programmers. They are left out
    unless Python was started with -W or PYTHONWARNINGS.
    """

    def note(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if issubclass(category, UserWarning) and "missing from font" not in str(message):
            echo(f"note: {message}")

    with warnings.catch_warnings():
        if not sys.warnoptions:
            warnings.simplefilter("always", UserWarning)
            warnings.showwarning = note
        yield


@contextlib.contextmanager
def executor_at(address: str | None) -> Iterator[Executor | None]:
    """The executor of the Dask cluster at an address, None where there is no address."""
    if address is None:
        yield None
        return
    from stochvi.sampling.workers import dask_executor

    with dask_executor(address) as executor:
        yield executor


# ------------------------------------------------------------------------------
# The program `stochvi`: its group of commands, and how an error becomes a sentence and a code.
# ------------------------------------------------------------------------------


FAILED = 1
"""Exit code if a check failed, an accuracy was not reached, or Ctrl-C ended the command."""

BAD_INPUT = 2
"""Exit code if the input is wrong, or the method does not apply to the scene."""

FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO}
"""Errors of a disk, which are none of the input: it is full, or fails."""

COMMAND_LINE = "stochvi.command_line"
"""Key of the command line in the data (`meta`) that the contexts of click share."""


HELP = {
    "A system between its stops": (
        "new, profiles", "explain", "explore", "screen", "size", "reliability", "replay", "damage",
        "clearance", "sweep", "absorber", "identify, shocks",
    ),
    "Its motion": ("simulate", "impacts", "spectrum", "history", "sine"),
    "Methods and their agreement": (
        "exact, fokker-planck, first-passage, linearise, average, growth",
        "check, cost, judge, problems", "demo, schema",
    ),
}  # fmt: skip
"""Lines of the help of the program under their headings, each of a command or several."""

WORDS = {
    "new, profiles": "Write a commented scene file to start from, or list the environments that "
    "ship, and those of other packages.",
    "sine": "Find all periodic motions under a sine, and jumps; also sine basins, sine "
    "bifurcation, sine lifetimes and sine perturbations.",
    "identify, shocks": "Find the law of a stop from a test of it, or the shocks in a record.",
    "exact, fokker-planck, first-passage, linearise, average, growth": "Solve a scene by theory.",
    "check, cost, judge, problems": "Compare methods, measure what accuracy costs, and judge other "
    "programs.",
    "demo, schema": "Size a box on a truck; print the JSON Schema of scenes or answers.",
}
"""Words of lines of the help that are not those of one command."""

UNDER_SINE = ("basins", "bifurcation", "lifetimes", "perturbations", "jolts", "stability")
"""Commands that may follow `sine`; a scene of such a name is ./basins."""


class Command(click.Command):
    """A command that refuses an option with one value that is given twice; click keeps the last."""

    def make_parser(self, ctx: click.Context) -> Any:
        parser: Any = super().make_parser(ctx)
        read = parser.parse_args

        def once(args: list[str]) -> Any:
            *found, given = read(args=args)
            for each in given:
                single = isinstance(each, click.Option) and not (each.multiple or each.is_flag)
                if single and (times := given.count(each)) > 1:
                    own = each.opts[0]
                    listed = f"join its values by commas, as {own} A,B"
                    remedy = listed if each.metavar == "LIST" else "keep one"
                    raise ValueError(f"{own} must be given once, got it {times} times; {remedy}")
            return *found, given

        parser.parse_args = once
        return parser


class Commands(click.Group):
    """A group that turns every expected error into one sentence on stderr and its exit code."""

    command_class = Command

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.commands: Parts[click.Command] = Parts("commands", self.commands, _command_called)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The commands by what a user does, the theory and the judging in a line each; then those
        of other packages."""
        shipped = set(self.commands)
        with notes_of_warnings():
            others = self.commands.with_others().keys() - shipped
        more = {"Of other packages": tuple(sorted(others))} if others else {}
        for heading, lines in (HELP | more).items():
            known = [self.commands.get(line) for line in lines]
            own = [each.get_short_help_str(formatter.width) if each else "" for each in known]
            with formatter.section(heading):
                formatter.write_dl(
                    [(line, WORDS.get(line, words)) for line, words in zip(lines, own, strict=True)]
                )

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Keep the words of the command line, which reports state; "sine basins" is `basins`."""
        ctx.meta[COMMAND_LINE] = shlex.join(["stochvi", *args])
        if args[:1] == ["sine"] and args[1:] and args[1] in UNDER_SINE:
            args = args[1:]
        if args and args[0] in RENAMED:
            click.echo(f"note: {told_of_name(args[0])}", err=True)
            args = [RENAMED[args[0]], *args[1:]]
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        _prepare_streams()
        try:
            with notes_of_warnings():
                found = super().invoke(ctx)
            _end_output()
            return found
        except (Exception, KeyboardInterrupt) as error:
            _stop_for(error)


def _command_called(name: str, given: Any) -> click.Command:
    """The command of another package."""
    if not isinstance(given, click.Command):
        raise TypeError(f"must be a click.Command, got {given!r}")
    return given


def _stop_for(error: BaseException) -> NoReturn:
    """End with the sentence and the exit code of an error; raise it again if it has none."""
    from stochvi.results.errors import NotConverged, StochviError, beyond_arithmetic, reason_of

    if isinstance(error, KeyboardInterrupt):
        stop(str(error) or "interrupted by Ctrl-C; nothing was kept", FAILED)
    if isinstance(error, NotConverged):
        stop(with_options(str(error), _options()), FAILED)
    if isinstance(error, ArithmeticError) and not isinstance(error, StochviError):
        stop(f"the scene {beyond_arithmetic(error)}", BAD_INPUT)
    if isinstance(error, StochviError):
        stop(str(error), BAD_INPUT)
    if isinstance(error, ValueError):  # of an argument; keys of scenes are in SceneErrors
        stop(with_options(str(error), _options()), BAD_INPUT)
    if isinstance(error, MemoryError):
        stop(f"not enough memory ({error}); reduce paths or samples", BAD_INPUT)
    if isinstance(error, OSError):
        named = f"{error.filename}: " if error.filename else ""
        if error.errno in FULL:
            stop(f"{named}{reason_of(error)}; the work is done, but this was not written; make "
                 "room, or name another place", FAILED)  # fmt: skip
        stop(f"{named}{reason_of(error)}", BAD_INPUT)
    raise error


ARGUMENT = re.compile(r"(?<![\w'\".=-])(?:(?<=raise )|(?<=lower )|(?=\w+_))\w+")
"""A word of a message that may name an argument of Python: what to raise or lower, and what has an
underscore, outside quotes and dotted names."""

CHOICE = re.compile(r"(?<=exactly one of )\w+(?:, \w+)+|(?<=give )\w+ or \w+(?=, not both)")
"""Arguments of which one is to be given."""


def with_options(message: str, options: Mapping[str, str]) -> str:
    """A message with the options of a command in the place of the arguments of Python.

    >>> options = {"budget": "--budget", "rel_error": "--rel-error", "rate": "--rate"}
    >>> with_options("the rate is 3; lower rel_error or raise budget", options)
    'the rate is 3; lower --rel-error or raise --budget'
    >>> with_options("rel_error must be a number, got 'rel_error'", options)
    "--rel-error must be a number, got 'rel_error'"
    """

    def option(found: re.Match[str]) -> str:
        return options.get(found[0], found[0])

    chosen = CHOICE.sub(lambda found: re.sub(r"\w+", option, found[0]), message)
    return ARGUMENT.sub(option, chosen)


def _options() -> Mapping[str, str]:
    """The options of the command that runs, by the names of its arguments."""
    context = click.get_current_context()
    command = main.get_command(context, context.invoked_subcommand or "")
    known = [] if command is None else command.params
    return {
        str(each.name): max(each.opts, key=len) for each in known if isinstance(each, click.Option)
    }


def _prepare_streams() -> None:
    """Make standard output and error accept any character, and replace streams that are closed."""
    sys.stdout, sys.stderr = (
        open(os.devnull, "w", encoding="utf-8") if stream is None else stream  # noqa: SIM115
        for stream in (sys.stdout, sys.stderr)
    )
    for stream in (sys.stdout, sys.stderr):
        # a terminal of Windows may not know a character of a title: it gets a "?" then
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _end_output() -> None:
    """Flush standard output, unless its reader has closed it."""
    from stochvi.views.files import silence

    try:
        sys.stdout.flush()
    except BrokenPipeError:
        silence(sys.stdout)


def stop(message: str, code: int) -> NoReturn:
    """End the program with a message on stderr and an exit code."""
    from stochvi.results.errors import few_lines

    for line in few_lines(message.splitlines()).splitlines():
        echo(f"stochvi: {line.strip()}")
    sys.exit(code)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="stochvi")
def main() -> None:
    """Stochastic vibration of systems that hit their stops.

    A scene file says what moves, where it hits and what shakes it. Each command answers one
    question about it. Start with: stochvi new scene.toml, then stochvi explain scene.toml.
    """


# ------------------------------------------------------------------------------
# Checks, before the work of a command, that the files of its answer can be written.
# ------------------------------------------------------------------------------


def inputs_of(scenes: Sequence[Path]) -> list[Path]:
    """The scene files, and the files that they name. Unreadable scenes are refused elsewhere."""
    import tomllib

    from stochvi.scenes.scene import file_and_phase
    from stochvi.scenes.text_tables import read_text

    found = []
    for named in scenes:
        scene, _ = file_and_phase(named)
        found.append(scene)
        try:
            document = tomllib.loads(read_text(scene))
            found += [scene.parent / name for name in named_files(document)]
        except (SceneError, ValueError, RecursionError):
            continue
    return found


def check_folder_target(folder: Path) -> None:
    """Raise `TargetError` unless a folder can be made here, and files in it."""
    nearest = _nearest(folder)
    if not nearest.is_dir():
        raise TargetError(f"--out must name a folder, but {nearest} is a file; name another folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise TargetError(f"--out {folder}: {nearest} cannot be written to; name another folder")


def check_formats(formats: Collection[str], folder: Path | None, *, has_report: bool) -> None:
    """Raise a ValueError where answers cannot be written in these forms."""
    if formats and folder is None:
        raise ValueError("--formats needs --out, the folder that gets the files")
    if "pdf" not in formats:
        return
    if not has_report:
        raise ValueError("--formats pdf is for a command that writes a report; this one has none")
    from stochvi.views.files import missing_for_pdf

    if missing := missing_for_pdf():
        raise ValueError(f"--formats pdf {missing}")


REPORT, QUESTION = "report.html", re.compile(r'<meta name="stochvi-question" content="(\w*)">')
"""Name of the page of a report, and where it states the question that it answers."""

HEAD = 4000
"""Number of characters at the start of a page that are searched for its question."""


def check_report_target(folder: Path, question: str) -> None:
    """Raise `TargetError` if the folder holds the report of another scene or question."""
    page = folder / REPORT
    if not page.is_file():
        return
    with page.open(encoding="utf-8", errors="replace") as opened:
        found = QUESTION.search(opened.read(HEAD))
    if found is None or found[1] != question:
        raise TargetError(
            f"{page} is the report of another scene or question, and would be replaced; name "
            "another folder with --out, or replace it with --force"
        )


def check_file_target(option: str, file: Path, read: Sequence[Path]) -> None:
    """Raise `TargetError` unless this file can be written, and is none of those that are read."""
    nearest = _nearest(file)
    for each in read:
        if nearest == file and each.exists() and os.path.samefile(file, each):
            raise TargetError(
                f"{option} {file} would replace {each}, which this command reads; name another file"
            )
    if nearest == file:
        if file.is_dir():
            raise TargetError(f"{option} must name a file, but {file} is a folder")
        if not os.access(file, os.W_OK):
            raise TargetError(f"{option} {file} cannot be written to; name another file")
        return
    if not nearest.is_dir():
        raise TargetError(f"{option} {file}: {nearest} is a file, expected a folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise TargetError(f"{option} {file}: {nearest} cannot be written to; name another file")


def check_apart(document: Path, checkpoints: Sequence[Path]) -> None:
    """Raise `TargetError` if the document of an answer would replace a checkpoint of its run."""
    for each in checkpoints:
        if os.path.realpath(document) == os.path.realpath(each):
            raise TargetError(
                f"--json {document} and --checkpoint {each} are one file; give each its own name"
            )


def _nearest(path: Path) -> Path:
    """The path itself if it exists, also as a link to nowhere; else the nearest folder that does.

    A name that the system refuses, such as one of 5000 letters, is an OSError, which names it.
    """
    for found in (path, *path.parents):
        if os.path.lexists(found):
            if not found.exists():  # a link to what is not there yet
                target = Path(os.path.realpath(found))
                if os.path.lexists(target):
                    raise TargetError(f"{found} is a link that leads back to itself; remove it")
                return _nearest(target)
            return found
    return Path()
