"""Run the commands that a page shows, and compare what they print: `python shown.py PAGE...`.

A `console` block holds commands after "$ ", each with what it prints on standard output. A block
after the comment `<!-- file: NAME -->` is a file that the commands find. The comment
`<!-- run: COMMAND -->` prepares the folder unseen; `$MANUAL` is the folder of the manual there. All
of a page are run in their order in one empty folder. With `--write` the page gets what was printed
now.

Words must be those of the page. Digits of a simulation depend on the processor and the libraries,
so that numbers may differ by their errors: see `differences`.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

FENCE = re.compile(
    r"<!-- run: (?P<run>[^\n]+) -->|"
    r"(?:<!-- file: (?P<file>\S+) -->\n+)?"
    r"^(?P<ticks>```+)(?P<language>[^`\n]*)\n(?P<text>.*?)^(?P=ticks)$",
    flags=re.DOTALL | re.MULTILINE,
)
"""Pattern of a fenced block, with the name of its file where a comment states one."""

NUMBER = re.compile(
    r"(?<![\w.])(?P<digits>[-+]?\d+(?:\.\d+)?)(?:\((?P<error>\d+(?:\.\d+)?)\))?"
    r"(?P<power>e[-+]?\d+)?(?:\+-(?P<bias>\d+(?:\.\d+)?(?:e[-+]?\d+)?))?"
    r"(?: ± (?P<half>\d+(?:\.\d+)?(?:e[-+]?\d+)?))?"
)
"""Pattern of a number, with its standard error in brackets and its bias, or half of its 95 %
interval, where these are stated."""

INTERVAL = re.compile(r"(\d[\d.e-]*)(?: %)? \((\d[\d.e-]*)(?: %)? to (\d[\d.e-]*)")
"""Pattern of a number with its 95 % interval."""

TIMES = re.compile(
    r"^cost: .*(?:\n(?!\w+:).+)*|, [\d.e+]+ ns a step here|: about [\d.]+(?: to [\d.]+)? s\b|"
    r"(?<=, 95 %)  .*$",
    flags=re.MULTILINE,
)
"""Pattern of what depends on the speed of the machine, and is not compared: behind the interval of
a probability stand its bias, the missions that a pilot chose, and CPU seconds. The cost of an
answer takes one line or two, as long as its numbers are: it ends at the next line with a
keyword."""

WIDTH = 100
"""Width of the terminal, characters."""

GAUSSIAN_95 = 1.96
"""Half of a 95 % interval over the standard error."""

Z = 4.5
"""Number of standard errors of a difference that two runs of one command may differ by."""


class Shown(NamedTuple):
    """A command of a page, and what the page says it prints."""

    command: str
    output: str


def commands_of(text: str) -> list[Shown]:
    """The commands of a `console` block."""
    parts = re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]
    found = []
    for part in parts:
        lines = part.splitlines()
        last = next(k for k, line in enumerate(lines) if not line.endswith("\\"))
        command = "\n".join(lines[: last + 1])
        found.append(Shown(command, "\n".join(lines[last + 1 :]).strip("\n")))
    return found


def run_page(path: Path, folder: Path) -> list[tuple[Shown, str]]:
    """Run all commands of a page in a folder; each with what it printed now."""
    found = []
    for block in FENCE.finditer(path.read_text(encoding="utf-8")):
        if block["run"]:
            printed_by(block["run"], folder)
        if block["file"]:
            (folder / block["file"]).write_text(block["text"], encoding="utf-8")
        if block["language"] == "console":
            found += [
                (each, printed_by(each.command, folder)) for each in commands_of(block["text"])
            ]
    return found


def printed_by(command: str, folder: Path) -> str:
    """What a command prints on standard output; lines without blanks at their ends.

    The exit code 1 is an answer too: that a record is no Gaussian noise, for one.
    """
    environment = os.environ | {
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
        "COLUMNS": str(WIDTH), "NO_COLOR": "1", "TERM": "dumb", "MPLBACKEND": "agg",
        "MANUAL": str(Path(__file__).parents[1]),
    }  # fmt: skip
    environment.pop("FORCE_COLOR", None)
    done = subprocess.run(
        ["sh", "-c", command], cwd=folder, env=environment, capture_output=True, text=True
    )
    if done.returncode > 1:
        raise RuntimeError(f"{command} ended with {done.returncode}: {done.stderr}")
    return "\n".join(line.rstrip() for line in done.stdout.splitlines()).strip("\n")


def differences(shown: str, now: str) -> list[str]:
    """Sentences on what differs between a page and what is printed now, but for the time it took.

    Numbers may differ by `Z` standard errors of a difference of two runs. A number that states no
    error gets the largest relative error of the output, as it comes from the same sample, by a
    standard error or by an interval; where there is none, it gets one unit of its last digit.
    Beside a standard error a bias may be left out, as one is that is small: it may differ by one
    error.

    >>> differences("12 impacts, 607(20)", "12 impacts, 601(20)")
    []
    >>> differences("12 impacts, 10 % (9 % to 11 %, 95 %)", "13 impacts, 9.8 % (9 % to 11 %, 95 %)")
    []
    >>> differences("error 0.01: about 10 s", "error 0.01: about 7 to 28 s")
    []
    >>> differences("12 impacts", "14 impacts")
    ['got 14, the page has 12']
    >>> differences("12 impacts", "12 hits")
    ['got the words: 12 hits']
    """
    shown, now = (_joined(text) for text in (shown, now))
    mine, yours = (NUMBER.sub("#", text).split() for text in (shown, now))
    if mine != yours:
        place = next((k for k, pair in enumerate(zip(mine, yours)) if pair[0] != pair[1]), 0)  # noqa: B905
        return [f"got the words: {' '.join(now.split()[max(place - 4, 0) : place + 5])}"]
    pairs = list(zip(NUMBER.finditer(shown), NUMBER.finditer(now), strict=True))
    relative = [_error(one) / abs(_value(one)) for one, _ in pairs if _error(one) and _value(one)]
    relative += [
        (float(high) - float(low)) / (2.0 * 1.96 * float(value))
        for value, low, high in INTERVAL.findall(shown)
    ]
    typical = max(relative, default=0.0)
    found = []
    for one, other in pairs:
        error = _error(one) or typical * abs(_value(one))
        allowed = max(Z * math.sqrt(2.0) * error, 1.001 * _last_digit(one))
        mine, yours = (float(each["bias"] or 0.0) for each in (one, other))
        bias = max(_error(one), Z * math.sqrt(2.0) * typical * mine, 1.001 * _last_of_bias(one))
        if abs(_value(one) - _value(other)) > allowed or abs(mine - yours) > bias:
            found.append(f"got {other[0]}, the page has {one[0]}")
    return found


def _joined(text: str) -> str:
    """A text without what is not compared, in which rules and lengths of lines do not count."""
    return " ".join(TIMES.sub("", text).split())


def _value(number: re.Match[str]) -> float:
    return float(number["digits"] + (number["power"] or ""))


def _last_digit(number: re.Match[str]) -> float:
    return _unit(number["digits"] + (number["power"] or ""))


def _last_of_bias(number: re.Match[str]) -> float:
    return _unit(number["bias"]) if number["bias"] else 0.0


def _unit(text: str) -> float:
    """What one unit of the last digit of a text is."""
    mantissa, _, exponent = text.partition("e")
    return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def _error(number: re.Match[str]) -> float:
    """The standard error that a number states: in brackets, in the places of its last digits, or as
    half of a 95 % interval."""
    if number["half"]:
        return float(number["half"]) / GAUSSIAN_95
    error = number["error"] or "0"
    if "." in error:
        return float(error + (number["power"] or ""))
    return float(error) * _last_digit(number)


def written(path: Path, answers: list[tuple[Shown, str]]) -> str:
    """The text of a page with what its commands printed now."""
    left = iter(answers)

    def renewed(block: re.Match[str]) -> str:
        if block["language"] != "console":
            return block[0]
        lines = []
        for each in commands_of(block["text"]):
            shown, now = next(left)
            assert shown == each
            lines += [f"$ {each.command}", *([now] if now else [])]
        head = block[0][: block.start("text") - block.start()]
        return f"{head}{chr(10).join(lines)}\n{block['ticks']}"

    return FENCE.sub(renewed, path.read_text(encoding="utf-8"))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="give pages what is printed now")
    parser.add_argument("pages", nargs="+", type=Path)
    options = parser.parse_args()
    wrong = 0
    for page in options.pages:
        with tempfile.TemporaryDirectory() as folder:
            answers = run_page(page, Path(folder))
        if options.write:
            page.write_text(written(page, answers), encoding="utf-8")
            continue
        for shown, now in answers:
            for sentence in differences(shown.output, now):
                wrong += 1
                print(f"{page}: {shown.command}: {sentence}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
