"""Errors and limits. Chapters: names of an earlier version; sizes that are refused before memory is
taken; control characters in names; errors that the package raises."""

from __future__ import annotations

import errno
import json
import math
import os
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

# ------------------------------------------------------------------------------
# Names of an earlier version, which are found for one version more.
# ------------------------------------------------------------------------------


RENAMED = {"jolt": "perturbations", "jolts": "perturbations", "stability": "growth"}
"""Earlier names of commands and functions with those of today."""


def told_of_name(name: str) -> str:
    """The sentence that tells the name of today to who uses an earlier one."""
    return f"{name} is called {RENAMED[name]} now; the next version drops it"


def name_of_today(name: str) -> str:
    """The name that is meant by an earlier one, with a warning to who asks a module for that."""
    if name in RENAMED:
        warnings.warn(told_of_name(name), DeprecationWarning, stacklevel=3)
    return RENAMED.get(name, name)


# ------------------------------------------------------------------------------
# Sizes beyond which something is refused before memory is taken for it.
# ------------------------------------------------------------------------------


MOST_NUMBERS = 2**25
"""Largest number of floats that one calculation keeps at a time: 256 MB."""

MOST_RECORDED = 2**28
"""Largest number of floats in records that are kept for a moment: 2 GB."""

MOST_SPACED = 10**6
"""Largest number of values that are put between two ends: more than any calculation takes."""

MOST_LINES = 20
"""Largest number of lines of a message."""


def check_size(name: str, number: float, most: float, remedy: str) -> None:
    """Raise ValueError if there is more of something than there may be.

    >>> check_size("--points", 10**8, MOST_SPACED, "ask for fewer")
    Traceback (most recent call last):
    ValueError: --points must be at most 1000000, got 100000000; ask for fewer
    """
    if number > most:
        raise ValueError(f"{name} must be at most {most:.7g}, got {number:.9g}; {remedy}")


def spaced(name: str, first: float, last: float, number: int) -> list[float]:
    """So many evenly spaced numbers, both ends included.

    >>> spaced("--points", 0.0, 1.0, 3)
    [0.0, 0.5, 1.0]
    """
    import numpy as np  # every command loads this file, also for its help

    check_size(name, number, MOST_SPACED, "ask for fewer")
    found: list[float] = np.linspace(first, last, number).tolist()
    return found


MOST_LETTERS = 2000
"""Largest number of letters in a line of a message."""


def short_line(line: str) -> str:
    """A line of a message, without the middle of a long one: its end is the remedy.

    >>> len(short_line(70_000 * "9")), short_line(70_000 * "9")[1000:1022]
    (2022, ' (68000 letters more) ')
    """
    left_out = len(line) - MOST_LETTERS
    if left_out <= 0:
        return line
    half = MOST_LETTERS // 2
    return f"{line[:half]} ({left_out} letters more) {line[-half:]}"


def few_lines(lines: list[str]) -> str:
    """The lines of a message, or the first of them and how many are left out; of long lines the
    ends.

    >>> few_lines(["one"] * 30).splitlines()[-1]
    'and 11 more like these'
    """
    if len(lines) > MOST_LINES:
        lines = [*lines[: MOST_LINES - 1], f"and {len(lines) - MOST_LINES + 1} more like these"]
    return "\n".join(map(short_line, lines))


# ------------------------------------------------------------------------------
# Control characters in names and files, which would act on a terminal.
# ------------------------------------------------------------------------------


CONTROLS = {
    number: f"\\x{number:02x}"
    for number in (*range(0x20), *range(0x7F, 0xA0))
    if chr(number) not in "\n\t"
}
"""Control characters by their numbers, and how they are shown."""


def visible(text: str) -> str:
    """The text with control characters as escapes, which do nothing to a terminal.

    >>> visible("red \\x1b[31m")
    'red \\\\x1b[31m'
    """
    return text.translate(CONTROLS)


# ------------------------------------------------------------------------------
# Errors that the package raises: one sentence each, with the remedy.
# ------------------------------------------------------------------------------


REASONS = {
    errno.EACCES: "permission denied", errno.EEXIST: "file exists", errno.EIO: "input/output error",
    errno.EISDIR: "is a directory", errno.ELOOP: "too many levels of symbolic links",
    errno.EMFILE: "too many open files", errno.ENAMETOOLONG: "file name too long",
    errno.ENOENT: "no such file or directory", errno.ENOSPC: "no space left on device",
    errno.ENOTDIR: "not a directory", errno.EPERM: "operation not permitted",
    errno.EPIPE: "broken pipe", errno.EROFS: "read-only file system",
}  # fmt: skip
"""Why a system refuses a file, by the number of its error."""


def reason_of(error: OSError) -> str:
    """Why a file could not be read or written, in English and small letters.

    A system states its reasons in the language of its user, in the middle of our sentences.

    >>> reason_of(FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT)))
    'no such file or directory'
    >>> reason_of(IsADirectoryError(errno.EISDIR, "Is a folder, expected a file name"))
    'is a folder, expected a file name'
    """
    said = error.strerror or str(error)
    number = error.errno or 0
    systems_own = getattr(error, "winerror", None) is not None or said == os.strerror(number)
    return (REASONS.get(number, said) if systems_own else said).lower()


BEYOND, EXTREME = (
    "has numbers that are too large, too small or too far apart to calculate with",
    20.0,
)
"""The words for an overflow, a division by 0 or a matrix without a solution; and the decimal
exponent from which a number of the scene is named with it."""

HOW_BEYOND: dict[type[Exception], str] = {
    ZeroDivisionError: "a divisor is 0", OverflowError: "a number is too large",
}  # fmt: skip
"""What a calculation came upon, in the place of the words of Python or the system."""


def beyond_arithmetic(error: Exception, document: Any = None) -> str:
    """The sentence for numbers beyond what a computer calculates with, with the most extreme one.

    >>> beyond_arithmetic(OverflowError(), {"mount": [{"mass": 1e300}]}).partition("with ")[2]
    '(a number is too large); look at mount.0.mass = 1e+300'
    """
    found = max(_numbers(document), key=lambda each: abs(math.log10(abs(each[1]))), default=None)
    where = ""
    if found is not None and abs(math.log10(abs(found[1]))) >= EXTREME:
        where = f"; look at {found[0]} = {found[1]:g}"
    said = HOW_BEYOND.get(type(error), "equations have no solution")
    return f"{BEYOND} ({said}){where}"


def not_json(error: Exception) -> str:
    """Why a text is not JSON, and where.

    >>> import json
    >>> try:
    ...     json.loads('{"mass": }')
    ... except ValueError as error:
    ...     not_json(error)
    'is not JSON from line 1, column 10, on'
    """
    if isinstance(error, json.JSONDecodeError):
        return f"is not JSON from line {error.lineno}, column {error.colno}, on"
    if isinstance(error, RecursionError):
        return "has brackets that are nested too deeply"
    return "is not JSON"


def _numbers(document: Any, key: str = "") -> Iterator[tuple[str, float]]:
    """The numbers of a document that are not 0, with their keys."""
    if isinstance(document, int | float) and not isinstance(document, bool):
        if document and math.isfinite(document):
            yield key, float(document)
    elif isinstance(document, Mapping | Sequence) and not isinstance(document, str | bytes):
        parts = document.items() if isinstance(document, Mapping) else enumerate(document)
        for name, part in parts:
            yield from _numbers(part, f"{key}.{name}".strip("."))


class StochviError(Exception):
    """Base of every error that this package raises on purpose.

    See Also
    --------
    stochvi.SceneError : The scene is not valid.
    stochvi.NotApplicable : The method does not cover the scene.
    """


class SceneError(StochviError, ValueError):
    """The scene, or a file it names, is not valid.

    `problems` holds (key, sentence) pairs; the message has a line for each of the first. A single
    one is given as its key and its sentence, or as a sentence alone.

    See Also
    --------
    stochvi.StochviError : The base of all errors of the package.
    """

    def __init__(self, problems: Sequence[tuple[str, str]] | str, sentence: str = "") -> None:
        if isinstance(problems, str):
            problems = [(problems, sentence) if sentence else ("", problems)]
        self.problems = list(problems)
        super().__init__(few_lines([f"{key} {text}".strip() for key, text in self.problems]))


class NotApplicable(StochviError):
    """A method does not cover this scene; `conditions` lists everything that is unmet.

    A single condition is given as a sentence.

    See Also
    --------
    stochvi.explain : Which methods apply to a scene, and why others do not.
    """

    def __init__(self, method: str, conditions: Sequence[str] | str) -> None:
        self.method = method
        self.conditions = (conditions,) if isinstance(conditions, str) else tuple(conditions)
        super().__init__(f"{method} does not apply: " + "; ".join(self.conditions) + ".")


class NoExactSolution(NotApplicable):
    """No closed form is known for this scene; `conditions` lists every unmet condition.

    See Also
    --------
    stochvi.exact : What raises it.
    """

    def __init__(self, conditions: Sequence[str]) -> None:
        super().__init__("exact", conditions)


class TargetError(StochviError, ValueError):
    """An answer cannot be written to the given file or folder, or would replace an input file."""


class _WithPartial(BaseException):
    """Part of an error that carries what was found before it.

    Parameters
    ----------
    partial : the answer so far, of the kind that the function would have returned; None where there
        is none yet.
    """

    def __init__(self, message: str, partial: Any = None) -> None:
        self.partial = partial
        super().__init__(message)

    @property
    def response(self) -> Any:
        """The name that `partial` had; it goes with the next version."""
        return self.partial

    @response.setter
    def response(self, partial: Any) -> None:
        self.partial = partial


class NotConverged(_WithPartial, StochviError):
    """The accuracy that was asked for was not reached; `partial` holds the answer so far.

    See Also
    --------
    stochvi.cost : What accuracy costs, before it is asked for.
    """


class CheckpointError(StochviError, ValueError):
    """A checkpoint is damaged, belongs to another scene, version or seed, or cannot be written.

    See Also
    --------
    stochvi.simulate : What writes and reads checkpoints.
    """


class Interrupted(_WithPartial, KeyboardInterrupt):
    """Stopped by Ctrl-C; `partial` holds the answer so far, None if there is none yet.

    It derives from KeyboardInterrupt, so that `except Exception` does not catch it.

    See Also
    --------
    stochvi.StochviError : The base of all errors of the package.
    """


LISTS = ("absorber", "cross_density", "excitation", "impact_pair", "structure.mount")
"""Keys of a scene file that may have several entries."""


def toml_remedy(error: ValueError) -> str:
    """The remedy for a part that a TOML file writes as a table twice; empty for other errors.

    >>> toml_remedy(ValueError("Cannot declare ('absorber',) twice (at line 9, column 10)"))
    '; for several, write each as [[absorber]]'
    >>> toml_remedy(ValueError("Cannot declare ('structure', 'mount') twice (at line 5)"))
    '; for several, write each as [[structure.mount]]'
    """
    declared = re.search(r"Cannot declare \((.*)\) twice", str(error))
    key = ".".join(re.findall(r"'(.*?)'", declared[1])) if declared else ""
    return f"; for several, write each as [[{key}]]" if key in LISTS else ""
